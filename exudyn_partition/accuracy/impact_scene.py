"""What a design is asked for, and the FE models of its bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..contact.rigid import RigidSurface
from ..fe.material import Material
from ..fe.model import FEModel
from ..fe.partition import Partition
from ..meshing.mesh_size import Refine
from ..meshing.netgen_mesh import ONE_AT_A_TIME, in_metres, meshed, volume_of
from ..meshing.ngsolve_fem import fe_model
from ..prediction.hertz import effective, impact
from ..support.foreign import NGSolveMesh, Shape
from .contact_place import ContactPlace
from .mesh_rules import GRADING, REACH, REFINED, Sizes

Model = tuple[FEModel, Partition]

_CURVED = 2  # order of curved sides: on coarse meshes, cubic ones turn elements inside out
_TOP = 8.08  # least f_top, by the frequency of longitudinal waves in the smaller body


@dataclass(frozen=True, eq=False)
class Scene:
    """What is asked for: shapes, materials, partner, place and impact."""

    shapes: tuple[Shape, ...]
    materials: tuple[Material, ...]
    rigid: RigidSurface | None
    place: ContactPlace
    speed: float
    tolerance: float
    max_dofs: int
    left: float = 1.0  # share of the error by functions of one order more that stays

    @property
    def least_top(self) -> float:
        """Frequency up to which the bodies are to be known at least [Hz]."""
        crossings = [
            _longest(shape) / material.bar_wave_speed
            for shape, material in zip(self.shapes, self.materials, strict=True)
        ]
        return _TOP / (2 * min(crossings))

    def mesh(self, i: int, sizes: Sizes, circle: float) -> NGSolveMesh:
        """Mesh of a body."""
        radius, long_axis = self.place.region(circle, REFINED)
        fine = Refine(self.place.points[i], radius, sizes.near, long_axis=long_axis)
        regions = [fine] if sizes.near < sizes.far else []
        with ONE_AT_A_TIME:
            made = meshed(self.shapes[i], sizes.far, regions, GRADING, sizes.order, sizes.curvature)
            return in_metres(self.shapes[i], *made, _CURVED)

    def missed(self, i: int, mesh: FEModel | NGSolveMesh) -> float:
        """Share of a body's volume that its mesh misses."""
        volume = mesh.cell_volume.sum() if isinstance(mesh, FEModel) else volume_of(mesh)
        return float(abs(volume / abs(self.shapes[i].mass) - 1))

    def model(self, i: int, mesh: NGSolveMesh, sizes: Sizes, circle: float) -> Model:
        """FE model of a body and its partition."""
        fem = fe_model(mesh, self.materials[i], order=sizes.order)
        line = self.place.normal if i == 0 else -self.place.normal
        radius, long_axis = self.place.region(circle, REACH[i], sizes.near / 2)
        return fem, Partition.ball(fem, self.place.points[i], radius, long_axis=long_axis, direction=line)


def first_circle(shapes: Sequence[Shape], materials: Sequence[Material], speed: float, radius: float) -> float:
    """Contact radius by Hertz, for compact bodies that do not turn [m]: an upper estimate."""
    masses = [material.rho * abs(shape.mass) for shape, material in zip(shapes, materials, strict=True)]
    mass = effective(*masses) if len(masses) == 2 else masses[0]
    return impact(mass, speed, radius, np.inf, *materials).contact_radius


def _longest(shape: Shape) -> float:
    """Longest side of the box around a shape [m]."""
    low, high = shape.bounding_box
    return float(max(high.x - low.x, high.y - low.y, high.z - low.z))
