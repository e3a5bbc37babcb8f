"""A rigid surface with a profile: a closed planar curve, such as that of a cam, extruded along an axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from ..errors import InputError
from ..support.arrays import Array, Vector
from ..support.checks import answer_of, validate_array, validate_vector
from ..support.optional import require
from ..surfaces.surface import nearest_places

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

_FEWEST = 8  # points of a curve
_SAMPLED = 720  # points of a curve that is given as a function
_TASK = "angles, (k,) [rad], that returns points, (k, 2) [m]"
_STARTS = 8  # places between two points; the search for the closest point starts from the nearest place
_STEPS = 8  # of Newton's method
_CLOSE = 1e-7  # of the curve's length: last step; errors: of the place its square, of the gap its fourth power
_CONVEX = 0.1  # of the squared tangent: below it, Newton's method takes the curve as straight


@dataclass(frozen=True, eq=False)
class RigidProfile:
    """Solid inside a closed planar curve, of infinite length along an axis.

    The curve is a periodic cubic spline through its points. The error of a circle through n points is about its radius
    times (1.4 / n)^4. Gaps are right if each point of the patch has one closest point on the curve. Where the curve is
    hollow, this holds within its radius of curvature.

    Parameters
    ----------
    curve : (n, 2) array or callable
        At least eight points of the curve in order, in either sense, each once [m]. Or a function that returns points,
        (k, 2) [m], for angles from 0 to 2 pi, (k,) [rad]; it is called for 720 angles.
    point : (3,)
        Where the origin of the curve's plane is [m].
    axis : (3,)
        Direction along which the curve is extruded; any length.
    first : (3,), optional
        Direction of the plane's first axis; its component along `axis` is removed. The second one is axis x first.
        Default: x, or y if the axis is parallel to x.

    Raises
    ------
    InputError
        If the points do not make such a curve, or an argument has a wrong shape.
    """

    curve: Array
    point: Array = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    axis: Array = (0.0, 0.0, 1.0)  # type: ignore[assignment]
    first: Array | None = None

    if TYPE_CHECKING:  # any three numbers are accepted; they are kept as arrays

        def __init__(
            self,
            curve: Array | Callable[[Array], Array],
            point: Vector = ...,
            axis: Vector = ...,
            first: Vector | None = ...,
        ) -> None: ...

    def __post_init__(self) -> None:
        given = self.curve
        if callable(given):
            given = answer_of("curve", given, np.linspace(0.0, 2 * np.pi, _SAMPLED, endpoint=False), _TASK)
        curve = validate_array("curve", given, (None, 2))
        if len(curve) < _FEWEST:
            raise InputError(f"curve: expected at least {_FEWEST} points, got {len(curve)}")
        way = np.linalg.norm(np.roll(curve, -1, axis=0) - curve, axis=1)
        if way.min() <= 1e-9 * way.sum():
            twice = int(way.argmin())
            raise InputError(
                f"curve: expected each point once, also the first one, got {curve[twice]} twice; leave one out"
            )
        x, y = curve.T
        area = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
        if abs(area) <= 1e-6 * way.sum() ** 2:
            raise InputError("curve: expected points around an area, got some that enclose none")
        if area < 0:
            curve = curve[::-1].copy()
        axis, first = _axes(self.axis, self.first)
        checked = {"curve": curve, "point": validate_vector("point", self.point), "axis": axis, "first": first}
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def plane(self) -> Array:
        """(3, 2) array: axes of the curve's plane, as columns."""
        first = np.asarray(self.first)
        return np.column_stack([first, np.cross(self.axis, first)])

    @cached_property
    def _spline(self) -> CubicSpline:
        """The curve as a function of the length of its chords."""
        closed = np.vstack([self.curve, self.curve[:1]])
        way = np.linalg.norm(np.diff(closed, axis=0), axis=1)
        return require("scipy.interpolate").CubicSpline(
            np.concatenate([[0.0], np.cumsum(way)]), closed, bc_type="periodic"
        )

    @cached_property
    def _starts(self) -> tuple[Array, cKDTree]:
        """Places along the curve from which closest points are found, and the tree of their points."""
        knots = self._spline.x
        starts = (knots[:-1, None] + np.outer(np.diff(knots), np.arange(_STARTS) / _STARTS)).ravel()
        return starts, cKDTree(self._spline(starts))

    def project(self, x: Array) -> tuple[Array, Array]:
        """Gaps, (k,) [m], and outward unit normals, (k, 3), at points x, (k, 3)."""
        in_plane = (x - self.point) @ self.plane
        starts, tree = self._starts
        s = starts[nearest_places(tree, in_plane)[:, 0]]
        for _ in range(_STEPS):
            place, tangent, bend = self._along(s)
            squared, miss = np.einsum("kd,kd->k", tangent, tangent), in_plane - place
            bent = squared - np.einsum("kd,kd->k", miss, bend)
            step = np.einsum("kd,kd->k", tangent, miss) / np.where(bent > _CONVEX * squared, bent, squared)
            s = s + step
            if abs(step).max(initial=0.0) <= _CLOSE * self._spline.x[-1]:
                break
        place, tangent, _ = self._along(s)
        normal = np.column_stack([tangent[:, 1], -tangent[:, 0]])
        normal /= np.sqrt(np.einsum("kd,kd->k", normal, normal))[:, None]
        return np.einsum("kd,kd->k", in_plane - place, normal), normal @ self.plane.T

    def _along(self, s: Array) -> tuple[Array, Array, Array]:
        """Places on the curve, (k, 2), and their first and second derivatives; faster than the spline itself."""
        knots, c = self._spline.x, self._spline.c
        s = s % knots[-1]
        span = np.minimum(np.searchsorted(knots, s, side="right"), len(knots) - 1) - 1
        h, (c3, c2, c1, c0) = (s - knots[span])[:, None], c[:, span]
        return ((c3 * h + c2) * h + c1) * h + c0, (3 * c3 * h + 2 * c2) * h + c1, 6 * c3 * h + 2 * c2


def _axes(axis: Vector, first: Vector | None) -> tuple[Array, Array]:
    """Unit vectors along and across the axis, (3,) each."""
    along = validate_vector("axis", axis)
    length = np.linalg.norm(along)
    if length == 0:
        raise InputError("axis: expected a vector of any length other than zero")
    along = along / length
    if first is None:
        across = np.eye(3)[0 if np.linalg.norm(along[1:]) > 1e-6 else 1]
    else:
        across = validate_vector("first", first)
    rest = across - (across @ along) * along
    if np.linalg.norm(rest) <= 1e-6 * np.linalg.norm(across) or not across.any():
        raise InputError(f"first: expected a direction across the axis {along}, got {across}")
    return along, rest / np.linalg.norm(rest)
