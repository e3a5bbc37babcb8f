"""A spot on a patch at which a contact is smaller than the facets: its kernel, and what the facets lack there.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..algebra.vectors import cross
from ..errors import InputError
from ..fe.facets import facet_corners
from ..fe.material import Material
from ..frames.kinematics import Kinematics
from ..reduction.body import ReducedBody
from ..support.arrays import Array
from ..support.once import once
from ..surfaces.smooth_kernel import Kernel, coverage_around, kernel_around
from .side import Side
from .smooth_faces import ORDERS, SmoothFace

NORMAL = 0.6  # E' s times the mean normal displacement of a half-space under the kernel, weighted by the kernel
_WIDEST = {2: 2.0, 3: 1.0}  # radius of the kernel by the length of edges, for each order
_NARROWEST = {2: 1.0, 3: 0.6}
_MISSED = {2: 0.0225, 3: 0.0}  # E' h times what facets miss of the flexibility under a kernel of radius h
_THIN = 0.45  # of a wall's thickness: largest radius of a kernel on it
_SOLID = 6.0  # thickness of a wall by the radius of a kernel, which is made smaller for that if facets allow
_WALL = 5.0  # below this, the change of the wall's flexibility with the radius is taken away
_COVERED = 0.97  # share of a kernel on its patch, above which it is there as a whole
_HALF = 0.5  # share of a kernel on its patch where the point of contact is on the edge of the patch
_FAR_INSIDE = 0.75  # the same above which the point is not at the edge, nor will be until the kernel is made anew
_BEHIND = -0.5  # cosine between a surface's normal and that of the wall's other side


@dataclass(frozen=True, eq=False)
class Spot:
    """A kernel on a patch, and the flexibility that its facets have too much of, or lack.

    Parameters
    ----------
    kernel : Kernel
        In the body's axes, from its centre of mass.
    radius : float
        Of the kernel, s [m].
    size : float
        Mean length of the facets' edges there, h [m].
    lacking : (2,) array
        Flexibility to be added to that of the patch's nodes under the kernel, along the normal and across it [m/N]:
        what facets miss and what a thin wall bends, less the half-space's under the kernel.
    curved : (3, 3) array
        Tangential flexibility that the curvature of the body adds for each factor of e by which the contact is smaller
        than the kernel, as a tensor in the body's axes [m/N].
    reach : float
        How far the patch should reach around it: s, on thin walls 2 s [m].
    whole : bool
        Whether the patch does.
    wall : float
        See `SpotMaker.wall` [m].
    """

    kernel: Kernel
    radius: float
    size: float
    lacking: Array
    curved: Array
    reach: float
    whole: bool
    wall: float

    @property
    def covered(self) -> bool:
        """Whether at least some part of the kernel lies on the patch."""
        return self.kernel.coverage > 1 - _COVERED

    def left(self, points: Array, facets: Array, point: Array, normal: Array) -> float:
        """Share of the contact at a point that is left where the patch ends; it falls to zero within the kernel.

        Parameters
        ----------
        points : (np, 3) array
            Nodes of the patch in the body's axes [m].
        facets : (nf, n) int array
        point, normal : (3,) arrays
            Of the true surface [m].
        """
        if self.kernel.coverage > _FAR_INSIDE:
            return 1.0
        nothing = 1 - _COVERED
        coverage = coverage_around(points, facets, point, normal, self.radius)
        return min(max((coverage - nothing) / (_HALF - nothing), 0.0), 1.0)


class SpotMaker:
    """Makes spots on one side's patch.

    Parameters
    ----------
    side : Side
    face : SmoothFace
        Of the patch.
    material : Material
    role : str
        "slave" or "master", for messages.
    """

    def __init__(self, side: Side, face: SmoothFace, material: Material, role: str) -> None:
        self._side, self.face, self.material, self._role = side, face, material, role
        facets = face.around
        self._order = ORDERS[facets.shape[1]]
        self.points: Array = side.kinematics.arms
        corners = self.points[facet_corners(facets)]
        self._middles = corners.mean(axis=1)
        self._edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
        self.widest = _WIDEST[self._order] * float(self._edges.max())  # radius of a kernel
        body = side.kinematics.body
        self._skin = _skin_of(body)

    def at(self, centre: Array, normal: Array) -> Spot:
        """Spot at a point of the true surface, (3,) [m], with an outward unit normal; both in the body's axes."""
        facets, widest = self.face.around, _WIDEST[self._order]
        distance = np.linalg.norm(self._middles - centre, axis=1)
        h = float(self._edges[distance.argmin()])
        h = float(self._edges[distance <= max(widest * h, distance.min())].mean())
        thickness = self._thickness(centre, normal)
        radius = min(widest * h, max(thickness / _SOLID, _NARROWEST[self._order] * h), _THIN * thickness)
        kernel = kernel_around(self.points, facets, centre, normal, radius)
        modulus, whole = self.material.plane_strain_modulus, kernel.coverage > _COVERED
        missed = self._missed(radius, h)
        lacking = missed - NORMAL / (modulus * radius)
        thin = thickness < _WALL * radius
        if thin and whole:
            wide = kernel_around(self.points, facets, centre, normal, 2 * radius)
            whole = wide.coverage > _COVERED
            narrow = self._static(kernel) - NORMAL / (modulus * radius) + missed
            lacking += (narrow - self._static(wide) + NORMAL / (2 * modulus * radius) - self._missed(2 * radius, h)) / 3
        nu, wall = self.material.nu, min(thickness, self._extent(centre, normal))
        across = (2 - nu) / (2 * (1 - nu)) * (missed - NORMAL / (modulus * radius))
        lacks, curved = np.array([lacking, across]), self._curved(normal)
        return Spot(kernel, radius, h, lacks, curved, (2 if thin else 1) * radius, whole, wall)

    def check(self, spot: Spot) -> None:
        """Raise InputError if a spot at the start cannot be computed."""
        needed = _NARROWEST[self._order] * spot.size
        if not spot.whole:
            raise InputError(
                f"{self._role}: formulation 'hertz' looks at {spot.reach:.3g} m around the point of contact, with "
                f"facets of {spot.size:.3g} m, and the patch does not reach as far. Take a larger radius of "
                "Partition.ball, or a finer mesh there"
            )
        if spot.radius < needed:
            raise InputError(
                f"{self._role}: the wall at the contact is {spot.radius / _THIN:.3g} m thick, and formulation 'hertz' "
                f"needs elements of at most {spot.radius / _NARROWEST[self._order]:.3g} m there, got {spot.size:.3g} "
                "m. Refine the mesh at the contact"
            )

    def _missed(self, radius: float, h: float) -> float:
        """Flexibility under a kernel that facets of size h miss [m/N]: their elements are stiffer than the body."""
        return _MISSED[self._order] * (h / radius) ** 4 / (self.material.plane_strain_modulus * h)

    def _curved(self, normal: Array) -> Array:
        """See `Spot`: the surface that curves away lacks the energy of a half-space's there, of a tangential force.

        On a half-space, the product of stress and strain at a distance r along the surface is ((Q / (2 pi G r^2))^2 G)
        (2 (1 + nu) cos^2 + (1 - 2 nu)^2 sin^2) of the direction from the force Q, and the depth of what lacks is r^2/2
        times the curvature there.
        """
        bending, nu = self.face.surface.bending(normal), self.material.nu
        even = np.trace(bending) / 2 * (np.eye(3) - np.outer(normal, normal))
        along, across = 2 * (1 + nu), (1 - 2 * nu) ** 2
        turned = (along + across) * even + (along - across) / 2 * (bending - even)
        return np.asarray(turned / (8 * np.pi * self.material.shear_modulus))

    def _static(self, kernel: Kernel) -> float:
        """Static flexibility of the body under a kernel along its normal, without rigid motion [m/N]."""
        side = self._side
        motion: Kinematics = side.kinematics
        nodal = kernel.weights[:, None] * kernel.normal
        body = motion.body
        nodes = motion.nodes[kernel.nodes]
        row = np.asarray(body.rows(nodes).T @ nodal.ravel()).ravel()[: body.n_shapes]
        omega = body.basis.omega
        elastic = omega > 0
        kept = float(np.sum((row[elastic] / omega[elastic]) ** 2))
        assert side.flexibility is not None
        if side.normal_only:
            return kept + float(kernel.weights @ side.flexibility[np.ix_(kernel.nodes, kernel.nodes)] @ kernel.weights)
        dofs = (3 * kernel.nodes[:, None] + np.arange(3)).ravel()
        return kept + float(nodal.ravel() @ side.flexibility[np.ix_(dofs, dofs)] @ nodal.ravel())

    def wall(self, centre: Array, normal: Array) -> float:
        """How far the body reaches behind a point of the surface [m]: as the wall is thick there.

        Beside an edge, where no wall is behind the point, it is the extent of the body.
        """
        return min(self._thickness(centre, normal), self._extent(centre, normal))

    def _extent(self, centre: Array, normal: Array) -> float:
        """Extent of the body behind a point of the surface, along the normal [m]."""
        return float(centre @ normal - (self._skin.points @ normal).min())

    def _thickness(self, centre: Array, normal: Array) -> float:
        """Thickness of the wall behind a point of the surface [m]; infinite if nothing of the surface is behind it."""
        skin = self._skin
        middles = skin.middles - centre
        beside = np.einsum("fd,fd->f", middles, middles) - (middles @ normal) ** 2
        met = np.flatnonzero((beside <= skin.squares) & (skin.facing @ normal < _BEHIND * skin.sizes))  # at most these
        a, first, second = (part[met] for part in (skin.starts, skin.first, skin.second))
        across = cross(np.broadcast_to(-normal, second.shape), second)
        determinant = np.einsum("fd,fd->f", first, across)
        inverse = np.divide(1.0, determinant, out=np.zeros(len(a)), where=abs(determinant) > 0)
        arm = centre - a
        u = np.einsum("fd,fd->f", arm, across) * inverse
        turned = cross(arm, first)
        v = (turned @ -normal) * inverse
        depth = np.einsum("fd,fd->f", turned, second) * inverse
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (depth > 0) & (inverse != 0)
        return float(depth[hit].min(initial=math.inf))


class _Skin(NamedTuple):
    """Triangles of a body's whole skin, in its axes, from the centre of mass.

    Parameters
    ----------
    points : (k, 3) array
        Their corners [m].
    starts, first, second : (nf, 3) arrays
        First corner of each, and its edges from there [m].
    facing : (nf, 3) array
        Outward normals, as long as twice the area of each [m2].
    sizes : (nf,) array
        Their lengths [m2].
    middles : (nf, 3) array
        Means of the corners [m].
    squares : (nf,) array
        Squares of the largest distances of corners from the middles, rounded up [m2].
    """

    points: Array
    starts: Array
    first: Array
    second: Array
    facing: Array
    sizes: Array
    middles: Array
    squares: Array


@once
def _skin_of(body: ReducedBody) -> _Skin:
    nodes = facet_corners(body.facets)[:, :3]
    points = body.points - body.centre_of_mass
    corners = points[nodes]
    starts, first, second = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    facing, middles = cross(first, second), corners.mean(axis=1)
    squares = (1 + 1e-9) * ((corners - middles[:, None]) ** 2).sum(axis=2).max(axis=1)
    return _Skin(
        points[np.unique(nodes)], starts, first, second, facing, np.linalg.norm(facing, axis=1), middles, squares
    )
