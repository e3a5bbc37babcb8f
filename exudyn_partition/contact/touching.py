"""Which contacts touch at a point: the true surfaces of both sides, and Hertz's contact between them.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import InputError
from ..fe.material import Material
from ..prediction.point_contact import PointContact
from ..support.arrays import Array
from .rigid import RigidCylinder, RigidPlane, RigidSphere, RigidSurface
from .side import Side
from .smooth_faces import check_facets
from .true_surface import Torus, TrueSurface, fitted

ROLES = ("slave", "master")
_CONFORMING = 0.05  # smaller relative curvature by the larger one, below which a ball fits its bore too closely
_LINE = 5e-4  # the same, below which round surfaces touch along a line: equal cylinders that cross at 2.6 degrees


@dataclass(frozen=True, eq=False)
class Touching:
    """Two true surfaces that touch at a point.

    Parameters
    ----------
    shapes : list of TrueSurface
        Of the slave, and of the master; those of bodies in their axes, from the centre of mass.
    materials : list of Material
        Of the sides that are bodies.
    ball : int or None
        Number of a shape that is a ball, or a torus that meets a plane; None of tori and solid cylinders among
        themselves.
    modulus : float
        E* of both bodies [Pa].
    """

    shapes: list[TrueSurface]
    materials: list[Material]
    ball: int | None
    modulus: float

    @cached_property
    def round(self) -> PointContact | None:
        """Hertz's contact of both; None where it depends on the place, as on a torus, or on how cylinders cross."""
        if self.ball is None or any(isinstance(shape.shape, Torus) for shape in self.shapes):
            return None
        return PointContact(_relative_curvatures(self.shapes), self.modulus)

    @property
    def circular(self) -> bool:
        """Whether they touch at a circle wherever that is: it has no axes."""
        return self.round is not None and self.round.circular

    @property
    def mismatch(self) -> float:
        """Dundurs' constant beta of both bodies: how much normal forces move their surfaces along each other."""
        along = [(1 - 2 * material.nu) / material.shear_modulus for material in self.materials]
        normal = sum((1 - material.nu) / material.shear_modulus for material in self.materials)
        return (along[0] - sum(along[1:])) / (2 * normal)

    def contact(self, axes: Sequence[Array], normal: Array) -> PointContact:
        """Hertz's contact where the master's normal is `normal`, (3,); axes of both sides are columns, (3, 3)."""
        if self.round is not None:
            return self.round
        bent = self.bending(axes, normal)
        small, large = np.linalg.eigvalsh(bent + 2 * np.abs(bent).sum() * np.outer(normal, normal))[:2]
        return at_point((float(small), float(large)), self.modulus)

    def check_crossing(self, axes: Sequence[Array]) -> None:
        """Raise InputError if both are cylinders that are parallel, with axes of both sides as columns, (3, 3)."""
        ways = [
            turn @ shape.shape.axis
            for shape, turn in zip(self.shapes, axes, strict=True)
            if isinstance(shape.shape, RigidCylinder) and self.ball is None
        ]
        if len(ways) == 2:
            # The last direction is across both, also if they are parallel.
            self.contact(axes, np.linalg.svd(np.array(ways))[2][2])

    def bending(self, axes: Sequence[Array], normal: Array) -> Array:
        """Sum of the curvatures of both sides, see `contact`, as a tensor in space, (3, 3) [1/m]."""
        parts = zip(self.shapes, axes, strict=True)
        return np.asarray(
            sum(
                turn @ shape.bending(turn.T @ outward) @ turn.T
                for (shape, turn), outward in zip(parts, (-normal, normal), strict=True)
            )
        )


def at_point(curvatures: tuple[float, float], modulus: float) -> PointContact:
    """Hertz's contact with relative curvatures, the smaller one first [1/m], and E* of both bodies [Pa].

    Raises
    ------
    InputError
        If the surfaces touch along a line, as parallel cylinders do.
    """
    small, large = curvatures
    if small < _LINE * large:
        raise InputError(
            "slave, master: formulation 'hertz' needs surfaces that touch at a point, and these touch along a line, as "
            f"parallel cylinders: their relative curvatures are {small:.3g} and {large:.3g} 1/m. Turn one of the "
            "bodies, or take formulation='compliance' with facets that resolve the contact"
        )
    return PointContact(curvatures, modulus)


def touching(
    sides: Sequence[Side],
    patches: Sequence[int],
    surface: RigidSurface | None,
    shapes: Sequence[TrueSurface] | None = None,
) -> Touching:
    """Find the true surfaces of two sides that touch at a point.

    Parameters
    ----------
    sides : sequence of Side
        Slave, and master if that is a patch too.
    patches : sequence of int
        Numbers of their patches.
    surface : RigidSurface, optional
        The master, if it is rigid.
    shapes : sequence of TrueSurface, optional
        Those of the sides; by default, each patch is one.

    Raises
    ------
    InputError
        If the facets are not those of quadratic or cubic tetrahedra, a material is not known, a surface is neither a
        plane, a ball, a cylinder, a bore nor a torus, none is a ball, nor a torus on a plane, cylinder or torus, nor
        both solid cylinders, or a ball fits its bore too closely.
    """
    materials, of_sides = [], [*(shapes or ())]
    for side, patch, role in zip(sides, patches, ROLES, strict=False):
        materials.append(_material(side, patch, role))
        check_facets(side, role)
        if shapes is None:
            of_sides.append(fitted(side.kinematics.arms, side.surface.facets, role))
    if surface is not None:
        if not isinstance(surface, RigidPlane | RigidSphere | RigidCylinder):
            raise InputError(
                "master: formulation 'hertz' knows the curvatures of RigidPlane, RigidSphere and RigidCylinder, "
                f"got a {type(surface).__name__}; take formulation='compliance'"
            )
        of_sides.append(TrueSurface(surface))
    modulus = 1 / sum(1 / material.plane_strain_modulus for material in materials)
    pair = Touching(of_sides, materials, _ball(of_sides), modulus)
    _ = pair.round
    return pair


def _ball(shapes: list[TrueSurface]) -> int | None:
    """Number of a shape that touches as a ball does, wherever the other one is; None if both are tubes."""
    for number, shape in enumerate(shapes):
        if shape.ball is not None:
            return number
    for number, shape in enumerate(shapes):
        if isinstance(shape.shape, Torus) and isinstance(shapes[1 - number].shape, RigidPlane):
            return number
    if all(shape.middle for shape in shapes):
        return None
    kinds = " and a ".join(type(shape.shape).__name__.removeprefix("Rigid").lower() for shape in shapes)
    raise InputError(
        "slave, master: formulation 'hertz' needs a ball that touches at a point, a torus on a plane, cylinder or "
        f"torus, or two solid cylinders that cross, got a {kinds}. Round the patch of one body, or take "
        "formulation='compliance' with facets that resolve the contact"
    )


def _material(side: Side, patch: int, role: str) -> Material:
    """Material of a patch."""
    body = side.kinematics.body
    material = body.partition.patches[patch].material or body.material
    if material is None:
        raise InputError(f"{role}: formulation 'hertz' needs the body's material; reduce it anew, its file has none")
    return material


def _relative_curvatures(shapes: list[TrueSurface]) -> tuple[float, float]:
    """Sums of the principal curvatures of two shapes [1/m]; raises InputError if they do not touch at a point."""
    first, second = sorted((shape.curvatures for shape in shapes), reverse=True)
    sums = first[0] + second[0], first[1] + second[1]
    if min(sums) < _CONFORMING * max(sums):
        raise InputError(
            "slave, master: formulation 'hertz' needs a ball that is smaller than the bore in which it is, so that "
            f"they touch at a point; their radii are {1 / max(first):.4g} m and {-1 / min(second):.4g} m. Take "
            "formulation='compliance' with facets that resolve the contact"
        )
    return sums
