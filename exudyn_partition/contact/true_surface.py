"""The true surface of a contact patch, whose facets are only chords of it: a plane, a ball, a cylinder or a bore.

It is fitted to the corners of the facets, which lie on the surface in any mesh of a shape.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.optimize

from ..errors import InputError
from ..fe.facets import area_vectors, facet_corners
from ..support.arrays import Array
from .rigid import RigidCylinder, RigidPlane, RigidSphere

_FLAT = 1e-5  # of a patch's size: corners that lie nearer to a plane are on it
_FITS = 2e-3  # of the sagitta of a patch: corners that lie nearer to a curved surface are on it
_ROUNDING = 1e-7  # of a patch's size, of places from a file
_WIDEST = 1e3  # radius by the size of a patch, above which no curvature can be told

Shape = RigidPlane | RigidSphere | RigidCylinder


@dataclass(frozen=True, eq=False)
class TrueSurface:
    """A surface of constant curvatures.

    Parameters
    ----------
    shape : RigidPlane, RigidSphere or RigidCylinder
        It gives the distance of points.
    """

    shape: Shape

    @property
    def ball(self) -> tuple[Array, float] | None:
        """Centre, (3,) [m], and radius [m] of a ball; None of other surfaces."""
        return (self.shape.center, self.shape.radius) if isinstance(self.shape, RigidSphere) else None

    @property
    def curvatures(self) -> tuple[float, float]:
        """Principal curvatures [1/m], below zero where the surface is hollow."""
        if isinstance(self.shape, RigidSphere):
            return (1 / self.shape.radius,) * 2
        if isinstance(self.shape, RigidCylinder):
            return math.copysign(1 / self.shape.radius, -1 if self.shape.hollow else 1), 0.0
        return 0.0, 0.0

    def bending(self, normal: Array) -> Array:
        """Curvatures at the place with an outward unit normal, (3,), as a tensor in the tangent plane, (3, 3) [1/m]."""
        first = self.curvatures[0]
        tangential = np.eye(3) - np.outer(normal, normal)
        if not isinstance(self.shape, RigidCylinder):
            return np.asarray(first * tangential)
        return np.asarray(first * (tangential - np.outer(self.shape.axis, self.shape.axis)))


def fitted(points: Array, facets: Array, role: str) -> TrueSurface:
    """Surface on which the corners of facets lie.

    Parameters
    ----------
    points : (np, 3) array
        Nodes of a patch [m].
    facets : (nf, k) int array
        Its facets, with normals that point outward.
    role : str
        Name of the side, for messages.

    Raises
    ------
    InputError
        If it is neither a plane, nor a ball, nor a cylinder or bore.
    """
    corners = np.unique(facet_corners(facets))
    x, outward = points[corners], area_vectors(points, facets)
    middle, size = x.mean(axis=0), float(np.linalg.norm(np.ptp(x, axis=0)))
    plane = np.linalg.svd(x - middle, full_matrices=False)[2][-1]
    deviation = abs((x - middle) @ plane).max()
    if deviation <= _FLAT * size:
        return TrueSurface(RigidPlane(middle, plane if plane @ outward.sum(axis=0) > 0 else -plane))
    middles = points[facet_corners(facets)].mean(axis=1)
    found: list[RigidSphere | RigidCylinder] = [*_balls(x, outward, middles), *_cylinders(x, middles, outward)]
    for shape in found:
        off = float(abs(shape.project(x)[0]).max())
        sagitta = min(size**2 / (8 * shape.radius), shape.radius)
        if off <= max(_FITS * sagitta, _ROUNDING * size) and shape.radius < _WIDEST * size:
            return TrueSurface(shape)
    raise InputError(
        f"{role}: formulation 'hertz' needs the true surface of the patch, a plane, a ball, a cylinder or a bore, but "
        f"the corners of its {len(facets)} facets lie on none of them: they are {deviation:.3g} m from a plane over "
        f"{size:.3g} m. Choose a patch within one face (Partition.ball, Partition.surface), or take "
        "formulation='compliance' with facets that resolve the contact"
    )


def _balls(x: Array, outward: Array, middles: Array) -> list[RigidSphere]:
    """Ball through points x, (k, 3) [m], by least squares; none if they are in a hollow, or on a plane."""
    middle = x.mean(axis=0)
    arms = x - middle
    A = np.column_stack([2 * arms, np.ones(len(arms))])
    solution, _, rank, _ = np.linalg.lstsq(A, np.einsum("kd,kd->k", arms, arms), rcond=None)
    square = solution[3] + solution[:3] @ solution[:3]
    if rank < 4 or square <= 0:
        return []
    centre = middle + solution[:3]
    convex = float(np.einsum("fd,fd->", middles - centre, outward)) > 0
    return [RigidSphere(centre, math.sqrt(square))] if convex else []


def _cylinders(x: Array, middles: Array, outward: Array) -> list[RigidCylinder]:
    """Cylinder or bore through points x, (k, 3) [m], by least squares."""
    normals = outward / np.linalg.norm(outward, axis=1)[:, None]
    axis = np.linalg.svd(normals, full_matrices=False)[2][-1]
    across = np.linalg.svd(axis[None])[2][1:]
    middle, arms = x.mean(axis=0), x - x.mean(axis=0)
    in_plane = arms @ across.T
    A = np.column_stack([2 * in_plane, np.ones(len(x))])
    start, _, rank, _ = np.linalg.lstsq(A, (in_plane**2).sum(axis=1), rcond=None)
    square = start[2] + start[:2] @ start[:2]
    if rank < 3 or square <= 0 or len(x) < 6:
        return []
    scale = math.sqrt(square)

    def off(values: Array) -> Array:
        along = axis + values[2:4] @ across
        along /= np.linalg.norm(along)
        arm = arms - (values[:2] * scale) @ across
        return np.asarray(np.linalg.norm(arm - np.outer(arm @ along, along), axis=1) / scale - values[4])

    best = scipy.optimize.least_squares(off, [*(start[:2] / scale), 0.0, 0.0, 1.0], xtol=1e-14, ftol=1e-14).x
    along, centre, radius = axis + best[2:4] @ across, middle + (best[:2] * scale) @ across, best[4] * scale
    along /= np.linalg.norm(along)
    arm = middles - centre
    hollow = bool(np.einsum("fd,fd->", arm - np.outer(arm @ along, along), outward) < 0)
    return [RigidCylinder(centre, along, float(radius), hollow=hollow)]
