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
from ..meshing.netgen_mesh import ONE_AT_A_TIME, meshed
from ..meshing.ngsolve_fem import fe_model
from ..prediction.hertz import effective, impact
from ..reduction.estimate import FIRST
from ..support.foreign import NGSolveMesh, Shape
from .contact_place import ContactPlace
from .mesh_rules import GRADING, GRADING_CORRECTED, REACH, REFINED, Sizes

Model = tuple[FEModel, Partition]

_MORE = 1.01  # meshes are a little smaller than their shapes


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
        """Frequency up to which the bodies are to be known at least [Hz]; a bit more than for `grow_to_tolerance`."""
        crossings = [
            _longest(shape) / own.bar_wave_speed for shape, own in zip(self.shapes, self.materials, strict=True)
        ]
        return _MORE * FIRST / (2 * min(crossings))

    def mesh(self, i: int, sizes: Sizes, circle: float) -> NGSolveMesh:
        """Mesh of a body."""
        long, _ = self.place.semi_axes(circle)
        fine = [Refine(self.place.points[i], REFINED * long, sizes.near)] if sizes.near < sizes.far else []
        grading = GRADING_CORRECTED if self.left < 1 else GRADING[sizes.order]
        with ONE_AT_A_TIME:
            return meshed(self.shapes[i], sizes.far, fine, grading, sizes.order, sizes.curvature)

    def missed(self, i: int, fem: FEModel) -> float:
        """Share of a body's volume that its mesh misses."""
        return float(abs(fem.cell_volume.sum() / abs(self.shapes[i].mass) - 1))

    def model(self, i: int, mesh: NGSolveMesh, sizes: Sizes, circle: float) -> Model:
        """FE model of a body and its partition."""
        fem = fe_model(mesh, self.materials[i], order=sizes.order)
        line = self.place.normal if i == 0 else -self.place.normal
        reach = REACH[i] * self.place.semi_axes(circle)[0] + sizes.near / 2
        return fem, Partition.ball(fem, self.place.points[i], reach, direction=line)


def first_circle(shapes: Sequence[Shape], materials: Sequence[Material], speed: float, radius: float) -> float:
    """Contact radius by Hertz, for compact bodies that do not turn [m]: an upper estimate."""
    masses = [material.rho * abs(shape.mass) for shape, material in zip(shapes, materials, strict=True)]
    mass = effective(*masses) if len(masses) == 2 else masses[0]
    return impact(mass, speed, radius, np.inf, *materials).contact_radius


def _longest(shape: Shape) -> float:
    """Longest side of the box around a shape [m]."""
    low, high = shape.bounding_box
    return float(max(high.x - low.x, high.y - low.y, high.z - low.z))
