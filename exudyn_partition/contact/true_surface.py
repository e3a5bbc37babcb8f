"""The true surface of a contact patch, whose facets are only chords of it: plane, ball, cylinder, bore or round edge.

It is fitted to the corners of the facets, which lie on the surface in any mesh of a shape.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..fe.facets import area_vectors, facet_corners
from ..support.arrays import Array
from ..support.optional import require
from .rigid import RigidCylinder, RigidPlane, RigidSphere

_FLAT = 1e-5  # of a patch's size: corners that lie nearer to a plane are on it
_FITS = 2e-3  # of the sagitta of a patch: corners that lie nearer to a curved surface are on it
_ROUNDING = 1e-7  # of a patch's size, of places from a file
_WIDEST = 1e3  # radius by the size of a patch, above which no curvature can be told

_BY_TURNS, _MOST, _NEAREST = 3, 30, 1e-13  # steps to places nearest to each other, and the last one by the radii
_FEWEST = 12  # corners of facets from which a torus is found
_TRIES = 60  # steps to a torus from one start
_SLANTS = (0.3, 0.8, 1.3, -0.3, -0.8, -1.3)  # angles from the ring's plane with which a torus is looked for


@dataclass(frozen=True, eq=False)
class Torus:
    """Outer half of a torus, the rounded edge of a round body or corner.

    Parameters
    ----------
    centre : (3,) array
        [m]
    axis : (3,) array
        Unit vector.
    ring, tube : float
        Radius of the circle in the middle of the tube, and of the tube [m].
    """

    centre: Array
    axis: Array
    ring: float
    tube: float

    def project(self, x: Array) -> tuple[Array, Array]:
        """Gaps, (k,) [m], and outward unit normals, (k, 3), at points x, (k, 3)."""
        arm = x - self.centre
        flat = arm - np.outer(arm @ self.axis, self.axis)
        arm = arm - self.ring * flat / np.linalg.norm(flat, axis=1)[:, None]
        size = np.linalg.norm(arm, axis=1)
        return size - self.tube, arm / size[:, None]

    def gaps_by(self, x: Array) -> Array:
        """Derivatives of the gaps at points x, (k, 3), by centre, axis, ring and tube, (k, 8); the axis turns."""
        arm = x - self.centre
        along = arm @ self.axis
        flat = arm - np.outer(along, self.axis)
        radius = np.linalg.norm(flat, axis=1)
        size = np.hypot(radius - self.ring, along)
        radial = flat / radius[:, None]
        normal = ((radius - self.ring) / size)[:, None] * radial + (along / size)[:, None] * self.axis
        by_axis = (along * self.ring / size)[:, None] * radial
        return np.column_stack([-normal, by_axis, (self.ring - radius) / size, -np.ones(len(x))])

    def middle(self, normal: Array) -> Array:
        """Middle of the tube beneath the place with an outward unit normal, (3,) [m]."""
        flat = normal - (normal @ self.axis) * self.axis
        return np.asarray(self.centre + self.ring * flat / np.linalg.norm(flat))

    def bending(self, normal: Array) -> Array:
        """See `TrueSurface.bending`."""
        around = np.cross(self.axis, normal)
        cosine = float(np.linalg.norm(around))
        around /= cosine
        across = np.cross(normal, around)
        second = cosine / (self.ring + self.tube * cosine)
        return np.asarray(np.outer(across, across) / self.tube + second * np.outer(around, around))

    def bent(self, weights: Array, normal: Array) -> Array:
        """See `TrueSurface.bent`."""
        around = np.cross(self.axis, normal)
        cosine = float(np.linalg.norm(around))
        around /= cosine
        across = np.cross(normal, around)
        size = self.ring + self.tube * cosine
        second, sine = cosine / size, float(normal @ self.axis)
        # Over the way across, the circle around the axis grows or shrinks; over the way around, directions turn.
        by_cosine = self.ring / size**2 * float(around @ weights @ around)
        steeper = -sine * float(across @ self.axis) / (cosine * self.tube) * by_cosine
        turned = -2 * (1 / self.tube - second) * sine / cosine * second * float(across @ weights @ around)
        return np.asarray(steeper * across + turned * around)


class Middle(NamedTuple):
    """Circle in the middle of a tube, or the axis of a cylinder.

    Parameters
    ----------
    centre : (3,) array
        [m]
    axis : (3,) array
        Unit vector.
    ring : float
        Radius of the circle [m]; zero of a cylinder.
    radius : float
        Of the tube or cylinder [m].
    """

    centre: Array
    axis: Array
    ring: float
    radius: float

    def nearest(self, x: Array) -> Array:
        """Place on it that is nearest to a point, (3,) [m]."""
        along = ((x - self.centre) @ self.axis) * self.axis
        if not self.ring:
            return np.asarray(self.centre + along)
        flat = x - self.centre - along
        return np.asarray(self.centre + self.ring * flat / np.linalg.norm(flat))

    def course(self, x: Array) -> tuple[Array, Array]:
        """Unit tangent at a place x on it, (3,), and its derivative by the way, (3,) [1/m]."""
        if not self.ring:
            return self.axis, np.zeros(3)
        inward = (self.centre - x) / self.ring
        return np.asarray(np.cross(inward, self.axis)), inward / self.ring


def nearest_places(first: Middle, second: Middle) -> tuple[Array, Array]:
    """Places on both that are nearest to each other, (3,) each [m], by Newton's method."""
    x = first.nearest(second.centre)
    for _ in range(_BY_TURNS):
        y = second.nearest(x)
        x = first.nearest(y)
    for _ in range(_MOST):
        arm = x - y
        (along, bent), (other, other_bent) = first.course(x), second.course(y)
        off = np.array([along @ arm, -other @ arm])
        across = -along @ other
        slope = np.array([[1 + bent @ arm, across], [across, 1 - other_bent @ arm]])
        step = np.linalg.lstsq(slope, off, rcond=None)[0]
        x, y = first.nearest(x - step[0] * along), second.nearest(y - step[1] * other)
        if abs(step).max() <= _NEAREST * (first.radius + second.radius):
            break
    return x, y


Shape = RigidPlane | RigidSphere | RigidCylinder | Torus


@dataclass(frozen=True, eq=False)
class TrueSurface:
    """A surface whose curvatures are known.

    Parameters
    ----------
    shape : RigidPlane, RigidSphere, RigidCylinder or Torus
        It gives the distance of points.
    """

    shape: Shape

    @property
    def ball(self) -> tuple[Array, float] | None:
        """Centre, (3,) [m], and radius [m] of a ball; None of other surfaces."""
        return (self.shape.center, self.shape.radius) if isinstance(self.shape, RigidSphere) else None

    def ball_at(self, normal: Array) -> tuple[Array, float] | None:
        """Centre, (3,) [m], and radius [m] of a ball that touches as the surface does, where it has an outward normal.

        It is a ball itself, or the tube of a torus; None of other surfaces.
        """
        return (self.shape.middle(normal), self.shape.tube) if isinstance(self.shape, Torus) else self.ball

    @property
    def middle(self) -> Middle | None:
        """Middle of a tube or of a cylinder; None of other surfaces, and of bores."""
        shape = self.shape
        if isinstance(shape, Torus):
            return Middle(shape.centre, shape.axis, shape.ring, shape.tube)
        if isinstance(shape, RigidCylinder) and not shape.hollow:
            return Middle(shape.point, shape.axis, 0.0, shape.radius)
        return None

    def tolerance(self, size: float) -> float:
        """How far from it corners may lie that are on it, of facets over a size [m]: [m]."""
        if isinstance(self.shape, RigidPlane):
            return _FLAT * size
        radius = self.least_radius
        return max(_FITS * min(size**2 / (8 * radius), radius), _ROUNDING * size)

    @property
    def least_radius(self) -> float:
        """Smallest radius of curvature [m]; infinite of a plane."""
        if isinstance(self.shape, RigidPlane):
            return math.inf
        return self.shape.tube if isinstance(self.shape, Torus) else self.shape.radius

    @property
    def curvatures(self) -> tuple[float, float]:
        """Principal curvatures [1/m], below zero where the surface is hollow; they are the same all over."""
        if isinstance(self.shape, RigidSphere):
            return (1 / self.shape.radius,) * 2
        if isinstance(self.shape, RigidCylinder):
            return math.copysign(1 / self.shape.radius, -1 if self.shape.hollow else 1), 0.0
        return 0.0, 0.0

    def bending(self, normal: Array) -> Array:
        """Curvatures at the place with an outward unit normal, (3,), as a tensor in the tangent plane, (3, 3) [1/m]."""
        if isinstance(self.shape, Torus):
            return self.shape.bending(normal)
        if isinstance(self.shape, RigidPlane):
            return np.zeros((3, 3))
        first = self.curvatures[0]
        tangential = np.eye(3) - normal[:, None] * normal
        if not isinstance(self.shape, RigidCylinder):
            return np.asarray(first * tangential)
        return np.asarray(first * (tangential - np.outer(self.shape.axis, self.shape.axis)))

    @property
    def steepest(self) -> float:
        """Largest curvature anywhere [1/m]; zero where it is flat or hollow."""
        return 1 / self.shape.tube if isinstance(self.shape, Torus) else max(*self.curvatures, 0.0)

    def bent(self, weights: Array, normal: Array) -> Array:
        """Derivative by the place, (3,), of the sum of weights, (3, 3), times `bending`; weights turn with the normal.

        Only tori have one: other surfaces are bent the same all over.
        """
        return self.shape.bent(weights, normal) if isinstance(self.shape, Torus) else np.zeros(3)


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
        If it is neither a plane, nor a ball, a cylinder, a bore nor the outside of a torus.
    """
    surface = surface_of(points, facets)
    if surface is None:
        raise not_known(points, facets, role)
    return surface


def not_known(points: Array, facets: Array, role: str) -> InputError:
    """Error that the facets of a patch lie on no known surface, see `fitted`."""
    x = points[np.unique(facet_corners(facets))]
    return InputError(
        f"{role}: formulation 'hertz' needs the true surface of the patch, a plane, a ball, a cylinder, a bore or the "
        f"outside of a torus, but the corners of its {len(facets)} facets lie on none of them: they are "
        f"{_from_plane(x)[0]:.3g} m from a plane over {np.linalg.norm(np.ptp(x, axis=0)):.3g} m. Choose a patch within "
        "one face (Partition.ball, Partition.surface), or take formulation='compliance' with facets that resolve the "
        "contact"
    )


def surface_of(points: Array, facets: Array) -> TrueSurface | None:
    """Surface on which the corners of facets lie, see `fitted`; None if it is none that is known."""
    corners = np.unique(facet_corners(facets))
    x, outward = points[corners], area_vectors(points, facets)
    middle, size = x.mean(axis=0), float(np.linalg.norm(np.ptp(x, axis=0)))
    deviation, plane = _from_plane(x)
    if deviation <= _FLAT * size:
        return TrueSurface(RigidPlane(middle, plane if plane @ outward.sum(axis=0) > 0 else -plane))
    middles = points[facet_corners(facets)].mean(axis=1)
    for find in (_balls, _cylinders, _tori):
        for shape in find(x, outward, middles):
            surface = TrueSurface(shape)
            if abs(shape.project(x)[0]).max() <= surface.tolerance(size) and surface.least_radius < _WIDEST * size:
                return surface
    return None


def _from_plane(x: Array) -> tuple[float, Array]:
    """Largest distance of points, (k, 3), from the plane through them [m], and its unit normal, (3,)."""
    middle = x.mean(axis=0)
    plane = np.linalg.svd(x - middle, full_matrices=False)[2][-1]
    return float(abs((x - middle) @ plane).max()), plane


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


def _cylinders(x: Array, outward: Array, middles: Array) -> list[RigidCylinder]:
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

    best = require("scipy.optimize").least_squares(off, [*(start[:2] / scale), 0.0, 0.0, 1.0], xtol=1e-14, ftol=1e-14).x
    along, centre, radius = axis + best[2:4] @ across, middle + (best[:2] * scale) @ across, best[4] * scale
    along /= np.linalg.norm(along)
    arm = middles - centre
    hollow = bool(np.einsum("fd,fd->", arm - np.outer(arm @ along, along), outward) < 0)
    return [RigidCylinder(centre, along, float(radius), hollow=hollow)]


def _tori(x: Array, outward: Array, middles: Array) -> list[Torus]:
    """Outer half of a torus through points x, (k, 3) [m], that face one way, by least squares from several slants.

    The start has the curvatures of a paraboloid through the points; the ring's place is not known from these.
    """
    normal = outward.sum(axis=0)
    if len(x) < _FEWEST or (outward @ normal).min() <= 0.0:
        return []
    normal = normal / np.linalg.norm(normal)
    tangents, middle = np.linalg.svd(normal[None])[2][1:], x.mean(axis=0)
    size = float(np.linalg.norm(np.ptp(x, axis=0)))
    arms = (x - middle) / size
    u, v = (arms @ tangents.T).T
    terms = np.column_stack([np.ones(len(x)), u, v, u**2, u * v, v**2])
    height, _, rank, _ = np.linalg.lstsq(terms, arms @ normal, rcond=None)
    curvatures, along = np.linalg.eigh(-np.array([[2 * height[3], height[4]], [height[4], 2 * height[5]]]))
    if rank < terms.shape[1] or curvatures[0] <= 0:
        return []
    steep, tube = along[:, 1] @ tangents, 1 / curvatures[1]

    def torus(values: Array) -> Torus:
        axis = values[3:6] / np.linalg.norm(values[3:6])
        return Torus(values[:3], axis, float(values[6]), float(values[7]))

    def off(values: Array) -> Array:
        return torus(values).project(arms)[0]

    def off_by(values: Array) -> Array:
        scale = np.ones(8)
        scale[3:6] = np.linalg.norm(values[3:6])
        return np.asarray(torus(values).gaps_by(arms) / scale)

    fit, shape, least = require("scipy.optimize").least_squares, None, math.inf
    for slant in _SLANTS:
        ring = math.cos(slant) * (1 / curvatures[0] - tube)
        radial = math.cos(slant) * normal - math.sin(slant) * steep
        axis = math.sin(slant) * normal + math.cos(slant) * steep
        start = [*((height[0] - tube) * normal - ring * radial), *axis, ring, tube]
        best = fit(off, start, off_by, method="lm", xtol=1e-14, ftol=1e-14, max_nfev=_TRIES)
        if best.cost < least:
            shape, least = torus(best.x), best.cost
        if least < len(arms) * _ROUNDING**2:
            break
    assert shape is not None
    facing = shape.project((middles - middle) / size)[1]
    from_axis = np.linalg.norm(np.cross(shape.axis, (middles - middle) / size - shape.centre), axis=1)
    outside = min(shape.ring, shape.tube) > 0 and from_axis.min() > shape.ring
    if not outside or np.einsum("fd,fd->", facing, outward) <= 0:
        return []
    return [Torus(middle + size * shape.centre, shape.axis, size * shape.ring, size * shape.tube)]
