"""Where two shapes touch: normal and curvatures there, from the shapes themselves, and the size of their contact.

The share of a small cube around a point that lies within a solid, and the middle of that share, tell on which side the
solid is, and whether the point lies on a smooth surface. Heights of the surface above its tangent plane, on two
circles, give its curvatures; so poles of spheres need no special care. Heights are where straight lines enter the
solid: near poles and seams of spline surfaces, such as OCC's Ellipsoid, OCC finds these, but often not the nearest
point. Heights that fit no paraboloid are refused, as at tips of cones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..contact.rigid import RigidSurface
from ..errors import EmptyRegionError, InputError
from ..meshing.netgen_mesh import depths, distances, scaled, share_of_cube
from ..support.arrays import Array
from ..support.foreign import Shape

_REACH = 1e-2  # first radius of the circles, by the smallest side of the bodies
_NEAR = 2e-2  # farthest that a surface may lie from the point of contact, by that side
_DIRECTIONS = 12  # on a circle
_SMOOTH = 0.2  # a smooth surface divides a small cube into halves, to this share
_FACES = -0.98  # cosine between the normals of the two bodies, at most
_ROUND = 1.1  # ratio of semi-axes, up to which a contact counts as round
_SLENDER = 200.0  # ratio of relative curvatures beyond which a contact is a line
_ROUNDS = 6  # of circles that become as large as the contact
_LARGEST = 0.25  # radius of the contact, by the smallest side of the bodies
_FAR = 10.0  # distance, by the smallest side, from which on a unit may have slipped
_TOUCHES = 1e-6  # a point is on a surface if it is nearer than this, by the radius of the circles
_TURNS = 2  # of a normal; each leaves the square of its error
_MISFIT = 0.1  # of heights above the fitted paraboloid, by its largest height; 0.22 at the tip of a cone
_FLAT = 1e-5  # misfit that rounding makes on planes, by the radius of the circles
_SIDE = 100.0  # smallest side of a shape, enlarged or not, in which OCC is asked
_MARCHES = 4  # towards the surface; each leaves the square of its slope


@dataclass(frozen=True, eq=False)
class ContactPlace:
    """Where and how two bodies touch.

    Parameters
    ----------
    points : tuple of (3,) arrays
        On each body [m].
    normal : (3,) array
        Outward unit normal of the first body there.
    curvatures : (float, float)
        Principal relative curvatures, the smaller one first [1/m].
    along : (3,) array
        Unit tangent of the smaller one, along which the contact is longest.
    """

    points: tuple[Array, ...]
    normal: Array
    curvatures: tuple[float, float]
    along: Array

    @property
    def radius(self) -> float:
        """Of the sphere on a plane with the same product of curvatures [m]."""
        return 1 / math.sqrt(self.curvatures[0] * self.curvatures[1])

    def semi_axes(self, circle: float) -> tuple[float, float]:
        """Semi-axes of the ellipse of Hertz with the area of a circle of that radius [m], the larger one first.

        Their ratio is 1.0339 (k2 / k1)^0.636 (Brewe and Hamrock 1977).
        """
        low, high = self.curvatures
        stretch = math.sqrt(max(1.0, 1.0339 * (high / low) ** 0.636))
        return circle * stretch, circle / stretch

    def region(self, circle: float, factor: float, more: float = 0.0) -> tuple[float, Array | None]:
        """Shorter semi-axis [m] and longer one, (3,) [m], of a region as long and wide as the contact by a factor.

        Contacts that are nearly round get a ball.
        """
        long, short = (factor * x + more for x in self.semi_axes(circle))
        return (short, long * self.along) if long > _ROUND * short else (long, None)


def contact_place(
    shapes: Sequence[Shape], rigid: RigidSurface | None, point: Array, radius_of: Callable[[float], float]
) -> ContactPlace:
    """Find normal and curvatures of two bodies, or of one and a rigid surface, where they touch.

    Parameters
    ----------
    shapes : sequence of netgen.occ.TopoDS_Shape
    rigid : RigidSurface, optional
        In place of the second shape.
    point : (3,) array
        Where they touch [m].
    radius_of : callable
        Radius of the contact circle by that of a sphere on a plane [m].

    Raises
    ------
    EmptyRegionError
        If a surface is not near the point, or the bodies do not face each other there.
    InputError
        If the point lies on an edge or a tip, or the surfaces touch along a line or an area, or their heights there
        fit no paraboloid.
    """
    names = ("the first shape", "the rigid surface" if rigid is not None else "the second shape")
    sizes = [sides_of(shape).min() for shape in shapes]
    size = float(min(sizes))
    probes: list[_Probe] = [_OfShape(shape) for shape in shapes]
    if rigid is not None:
        probes.append(_OfRigid(rigid))
    feet = []
    for name, probe in zip(names, probes, strict=True):
        away = probe.distance(point[None])[0]
        if abs(away) > _NEAR * size:
            _refuse_far(name, probe, point, float(abs(away)), size)
        feet.append(probe.foot(point, _REACH * size))
    normals = [probe.normal(foot, _REACH * size, name) for name, probe, foot in zip(names, probes, feet, strict=True)]
    if normals[0] @ normals[1] > _FACES:
        raise EmptyRegionError(
            f"contact: the bodies do not face each other at {point} m: the outward normals there are {normals[0]} and "
            f"{normals[1]}, expected opposite ones. Place the shapes as they touch, and give the point where they do"
        )
    reach = _REACH * size
    for _ in range(_ROUNDS):
        curvatures, axes = np.linalg.eigh(relative_curvature(probes, feet, normals[0], reach))
        low, high = map(float, curvatures)
        if high * size < 1e-3 or low < high / _SLENDER:
            raise InputError(
                f"contact: expected surfaces that touch at a point, got relative curvatures of {low:.3g} and "
                f"{high:.3g} per metre at {point} m: they touch along a line or an area. Mesh these bodies yourself "
                "and take reduce_pair"
            )
        place = ContactPlace(tuple(feet), normals[0], (low, high), axes[:, 0] @ tangents_of(normals[0]))
        circle = radius_of(place.radius)
        if place.semi_axes(circle)[0] > _LARGEST * size:
            raise InputError(
                f"contact: its radius would be {circle:.3g} m, too large for bodies whose smallest side is {size:.3g} "
                f"m; expected at most {_LARGEST:g} of it. Is a length in millimetres? Then give scale=1e-3"
            )
        if 0.8 * reach < circle < 1.25 * reach:
            break
        reach = circle
    return place


def _refuse_far(name: str, probe: _Probe, point: Array, away: float, size: float) -> None:
    """Raise because a surface is not near the point; say if it were with the other unit."""
    for factor, advice in ((1e-3, "Give the point in metres"), (1e3, "Is the shape in millimetres? Give scale=1e-3")):
        near = abs(probe.distance(factor * point[None])[0]) <= _NEAR * size
        if near and max(away, factor * away) > _FAR * size:
            raise EmptyRegionError(
                f"contact: {name} is {away:.4g} m away from {point} m, but it would touch at {factor * point} m. "
                f"{advice}; lengths are in metres after scaling"
            )
    raise EmptyRegionError(
        f"contact: {name} is {away:.4g} m away from {point} m, expected a point where the bodies touch, at most "
        f"{_NEAR * size:.3g} m from both surfaces. Place the shapes as they touch; lengths are in metres"
    )


def sides_of(shape: Shape) -> Array:
    """Lengths of the box around a shape, (3,) [m]."""
    low, high = (np.array([p.x, p.y, p.z]) for p in shape.bounding_box)
    lengths: Array = high - low
    return lengths


class _Probe(Protocol):
    """What is asked of a surface."""

    def distance(self, points: Array) -> Array:
        """Of points, (k, 3) [m], from the surface, (k,) [m]."""

    def foot(self, point: Array, reach: float) -> Array:
        """Return the nearest point of the surface, (3,) [m]."""

    def normal(self, foot: Array, reach: float, name: str) -> Array:
        """Outward unit normal there, (3,)."""

    def depths(self, starts: Array, way: Array, reach: float) -> Array:
        """Ways from points, (k, 3) [m], along a unit vector to the surface, (k,) [m], below 4 times `reach`."""


class _OfRigid:
    """A rigid surface."""

    def __init__(self, surface: RigidSurface) -> None:
        self._surface = surface

    def distance(self, points: Array) -> Array:
        """See `_Probe`."""
        gap: Array = self._surface.project(points)[0]
        return gap

    def foot(self, point: Array, reach: float) -> Array:
        """See `_Probe`."""
        gap, normal = self._surface.project(point[None])
        value: Array = point - gap[0] * normal[0]
        return value

    def normal(self, foot: Array, reach: float, name: str) -> Array:
        """See `_Probe`."""
        value: Array = self._surface.project(foot[None])[1][0]
        return value

    def depths(self, starts: Array, way: Array, reach: float) -> Array:
        """See `_Probe`."""
        depth = np.zeros(len(starts))
        for _ in range(_MARCHES):
            depth += self.distance(starts + depth[:, None] * way)
        return depth


class _OfShape:
    """The surface of a shape."""

    def __init__(self, shape: Shape) -> None:
        # OCC takes points that are 1e-7 apart as one, in any unit. In metres that is as much as the heights here.
        self._scale = _SIDE / float(sides_of(shape).min())
        self._shape = scaled(shape, self._scale)

    def distance(self, points: Array) -> Array:
        """See `_Probe`."""
        value: Array = distances(self._shape, self._scale * points) / self._scale
        return value

    def foot(self, point: Array, reach: float) -> Array:
        """See `_Probe`."""
        away = self.distance(point[None])[0]
        if away < _TOUCHES * reach:
            return point
        value: Array = point - away * self._slope(point, 0.1 * away)
        return value

    def normal(self, foot: Array, reach: float, name: str) -> Array:
        """See `_Probe`."""
        share, middle = share_of_cube(self._shape, self._scale * foot, self._scale * reach)
        if abs(share - 0.5) > _SMOOTH:
            raise InputError(
                f"contact: expected a point on a smooth surface, got an edge or a corner of {name} at {foot} m: "
                f"{share:.0%} of a small cube there is solid. Round the edge, or mesh it yourself and take reduce_pair"
            )
        normal: Array = self._scale * foot - middle
        normal /= np.linalg.norm(normal)
        for _ in range(_TURNS):
            tangents = tangents_of(normal)
            starts = foot + reach * np.vstack([tangents, -tangents]) + 2 * reach * normal
            ahead, behind = self.depths(starts, -normal, reach).reshape(2, 2)
            normal = normal + (ahead - behind) / (2 * reach) @ tangents
            normal /= np.linalg.norm(normal)
        return normal

    def depths(self, starts: Array, way: Array, reach: float) -> Array:
        """See `_Probe`."""
        depth = depths(self._shape, self._scale * starts, way, self._scale * 4 * reach) / self._scale
        if np.isnan(depth).any():
            raise InputError(
                f"contact: expected smooth surfaces around the point, got none within {4 * reach:.3g} m of {starts[0]} "
                "m: an edge is near. Round it, or mesh these bodies yourself and take reduce_pair"
            )
        return depth

    def _slope(self, point: Array, step: float) -> Array:
        """Unit vector along which the distance grows, by central differences."""
        ends = point + step * np.vstack([np.eye(3), -np.eye(3)])
        ahead, behind = self.distance(ends).reshape(2, 3)
        value: Array = (ahead - behind) / np.linalg.norm(ahead - behind)
        return value


def tangents_of(normal: Array) -> Array:
    """Two unit vectors across a normal and each other, (2, 3)."""
    value: Array = np.linalg.svd(normal[None])[2][1:]
    return value


def relative_curvature(probes: Sequence[_Probe], feet: Sequence[Array], normal: Array, reach: float) -> Array:
    """Matrix of relative curvatures by `tangents_of` the normal, (2, 2) [1/m], by the gap on two circles."""
    tangents = tangents_of(normal)
    angle = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    x, y = places = reach * np.vstack([circle, 0.5 * circle]).T
    gap = np.zeros(len(x))
    for probe, foot, outward in zip(probes, feet, (normal, -normal), strict=True):
        start = foot + places.T @ tangents + reach * outward
        gap += probe.depths(start, -outward, reach) - reach
    # A tilt tells that the first point to touch lies aside, by little.
    terms = np.column_stack([x**2 / 2, x * y, y**2 / 2, x, y])
    coefficients = np.linalg.lstsq(terms, gap, rcond=None)[0]
    curved, misfit = abs(terms[:, :3] @ coefficients[:3]).max(), abs(terms @ coefficients - gap).max()
    if misfit > max(_MISFIT * curved, _FLAT * reach):
        raise InputError(
            f"contact: expected surfaces with curvatures at {feet[0]} m, got heights that are off a paraboloid by "
            f"{misfit / curved:.0%}: there is the tip of a cone, or curvature changes within {reach:.3g} m. Round the "
            "tip, or mesh these bodies yourself and take reduce_pair"
        )
    xx, xy, yy = coefficients[:3]
    return np.array([[xx, xy], [xy, yy]])
