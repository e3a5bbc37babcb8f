"""Small signs of joints, springs, drives, loads, ground and gravity, so that a mechanism reads as one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..exudyn_bodies.other_bodies import OtherBody
from ..support.arrays import Array
from .graphics import RigidShape

Solid = tuple[Array, Array]  # points, (n, 3), and triangles, (k, 3) int

_SIZE = 0.022  # of a sign, by the size of what is shown
_ARROW = 4.0  # length of the arrow of the largest load, and of gravity, by that of a sign
_SLIM = 0.8  # radius of a spring and of an arrow, likewise
_AROUND = 20  # facets around a cylinder
_TURNS, _PER_TURN = 6, 14  # of a spring
_BLUE, _GREEN, _ORANGE = "#2f7fc1", "#2f9a55", "#e08a1e"
_RED, _VIOLET, _GREY = "#d23b3b", "#8a5bd6", "#5f6770"


@dataclass(frozen=True, eq=False)
class SignShape(RigidShape):
    """A sign at m frames; its axes need not be of length one.

    Parameters
    ----------
    colour : str
        As "#rrggbb".
    """

    colour: str

    @property
    def rgb(self) -> list[float]:
        """Red, green and blue, 0 to 1."""
        return [int(self.colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]


def sign_shapes(others: Iterable[OtherBody], times: Array, bounds: tuple[Array, Array]) -> list[SignShape]:
    """Signs of a run at m frames.

    Parameters
    ----------
    others : iterable of OtherBody
        Those with a kind are signs.
    times : (m,) array
        [s]
    bounds : (3,), (3,) arrays
        Lower and upper corner of what is shown [m].
    """
    low, high = bounds
    size = _SIZE * float(np.linalg.norm(high - low))
    signs = [other for other in others if other.kind]
    largest = {kind: _largest(other for other in signs if other.kind == kind) for kind in ("force", "torque")}
    found: list[SignShape] = []
    seen: set[tuple[float, ...]] = set()
    for other in signs:
        place, axes = other.at(times)
        end, name = other.end_at(times), other.kind
        if other.name and other.name != other.kind:
            name += f" {other.name!r}"
        if other.kind == "gravity":
            if tuple(end[0]) in seen:
                continue
            seen.add(tuple(end[0]))
            amount = float(np.linalg.norm(end[0]))
            beside = np.array([low[0] - 2 * size, low[1] - 2 * size, high[2] + _ARROW * size])
            place = np.repeat(beside[None], len(times), axis=0)
            axes = _along(_ARROW * size / max(amount, 1e-300) * end, _SLIM * size)
            name = f"gravity, {amount:.4g} m/s2"
        elif other.kind == "force":
            axes = _along(_ARROW * size / largest["force"] * end, _SLIM * size)
            place = place - axes[:, :, 2]  # its tip is where it acts
        elif other.kind == "torque":
            axes = _along(1.6 * size / largest["torque"] * end)
        elif other.kind in ("spring", "rod"):
            way = end - place
            length = np.linalg.norm(way, axis=1)
            short = length.max() < size  # both ends in one place, as of a bushing
            axes = size * axes if short else _along(way, _SLIM * size if other.kind == "spring" else 0.3 * size)
        else:
            axes = size * axes
        solid, colour = _SOLIDS[other.kind]
        found.append(SignShape(name, *solid, place, axes, colour))
    return found


def signs_around(others: Iterable[OtherBody], times: Array, shown: Iterable[Array]) -> list[SignShape]:
    """Signs of a run at m frames, of a size that suits what is shown: places, (n, 3) [m] each."""
    every = np.vstack([*shown])
    return sign_shapes(others, times, (every.min(axis=0), every.max(axis=0)))


def _largest(others: Iterable[OtherBody]) -> float:
    """Largest load that any of some signs ever has."""
    return max((float(np.linalg.norm(other.end, axis=1).max()) for other in others), default=0.0) or 1.0


def _along(ways: Array, width: float | None = None) -> Array:
    """Axes, (m, 3, 3), whose third ones are the ways, (m, 3), and whose others are as long as `width`, or as these."""
    length = np.linalg.norm(ways, axis=1)
    main = ways[length.argmax()]
    aside = np.eye(3)[abs(main).argmin()]
    first = np.cross(aside, ways)
    norm = np.linalg.norm(first, axis=1)
    first = np.divide(first, norm[:, None], out=np.tile(np.eye(3)[0], (len(ways), 1)), where=norm[:, None] > 0)
    second = np.divide(np.cross(ways, first), length[:, None], out=np.zeros_like(ways), where=length[:, None] > 0)
    wide = (length if width is None else width * (length > 0))[:, None]
    return np.stack([wide * first, wide * second, ways], axis=2)


def _joined(*solids: Solid) -> Solid:
    starts = np.cumsum([0, *(len(points) for points, _ in solids)])
    triangles = [corners + start for (_, corners), start in zip(solids, starts, strict=False)]
    return np.vstack([points for points, _ in solids]), np.vstack(triangles)


def _tube(path: Array, radii: Sequence[float], sides: Sequence[Array], around: int = _AROUND) -> Solid:
    """Surface around a path, (n, 3), with a radius at each point; `sides` are two vectors across it, (n, 3) each."""
    angle = 2 * np.pi * np.arange(around) / around
    rings = path[:, None] + np.asarray(radii)[:, None, None] * (
        np.cos(angle)[:, None] * sides[0][:, None] + np.sin(angle)[:, None] * sides[1][:, None]
    )
    n = len(path)
    i, j = (index.ravel() for index in np.indices((n - 1, around)))
    here, beside = i * around + j, i * around + (j + 1) % around
    above, beyond = here + around, beside + around
    return rings.reshape(-1, 3), np.vstack([
        np.column_stack([here, beside, beyond]), np.column_stack([here, beyond, above]),
    ])  # fmt: skip


def _round(profile: Sequence[tuple[float, float]]) -> Solid:
    """Solid of revolution about z; the profile has pairs of radius and height."""
    radii, heights = np.array(profile, dtype=float).T
    path = np.column_stack([0 * heights, 0 * heights, heights])
    across = [np.tile(axis, (len(path), 1)) for axis in np.eye(3)[:2]]
    return _tube(path, radii.tolist(), across)


def _box(low: Sequence[float], high: Sequence[float]) -> Solid:
    points = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return points, np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])


def _coil() -> Solid:
    """A spring from z = 0 to z = 1, of radius one."""
    share = np.linspace(0, 1, _TURNS * _PER_TURN + 1)
    angle = 2 * np.pi * _TURNS * share
    out, up = _around(angle)
    path = 0.86 * out + (0.03 + 0.94 * share)[:, None] * up
    return _wire(path, 0.14, [0.2 * up, out])  # thinner along z, which is stretched


def _ring_arrow() -> Solid:
    """An arrow around z, of radius one."""
    out, up = _around(np.linspace(0, 1.5 * np.pi, 28))
    head = np.array([[0, -1.0, 0], [0, -1.0, 0], [0.5, -1.0, 0]])
    across = [np.tile(axis, (3, 1)) for axis in np.eye(3)[1:]]
    return _joined(_wire(out, 0.09, [up, out]), _tube(head, [0.0, 0.26, 0.0], across))


def _around(angle: Array) -> tuple[Array, Array]:
    """Directions away from z, by an angle about it, and along it, (n, 3) each."""
    return np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]), np.tile([0.0, 0, 1], (len(angle), 1))


def _wire(path: Array, radius: float, sides: Sequence[Array]) -> Solid:
    """A tube whose ends are closed."""
    ends = [0, *range(len(path)), len(path) - 1]
    return _tube(path[ends], [0.0, *[radius] * len(path), 0.0], [side[ends] for side in sides], around=8)


_SOLIDS: dict[str, tuple[Solid, str]] = {
    "hinge": (_round([(0, -1.2), (0.5, -1.2), (0.5, 1.2), (0, 1.2)]), _BLUE),
    "ball joint": (
        _round([(0.7 * np.sin(polar), -0.7 * np.cos(polar)) for polar in np.linspace(0, np.pi, 13)]), _BLUE,
    ),
    "slider": (_joined(_box((-0.2, -0.2, -2.4), (0.2, 0.2, 2.4)), _box((-0.5, -0.5, -0.7), (0.5, 0.5, 0.7))), _BLUE),
    "fixed joint": (_box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)), _BLUE),
    "joint": (_round([(0, -0.8), (0.8, 0), (0, 0.8)]), _BLUE),
    "rod": (_round([(0, 0), (0.5, 0), (0.5, 1), (0, 1)]), _BLUE),
    "spring": (_coil(), _GREEN),
    "drive": (_ring_arrow(), _ORANGE),
    "torque": (_ring_arrow(), _RED),
    "force": (_round([(0, 0), (0.25, 0), (0.25, 0.7), (0.6, 0.7), (0, 1)]), _RED),
    "gravity": (_round([(0, 0), (0.25, 0), (0.25, 0.7), (0.6, 0.7), (0, 1)]), _VIOLET),
    "ground": (
        _joined(_round([(0, 0), (1.0, -1.3), (0, -1.3)]), _box((-1.5, -1.5, -1.6), (1.5, 1.5, -1.3))), _GREY,
    ),
}  # fmt: skip
