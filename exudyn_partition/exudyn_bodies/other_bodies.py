"""Exudyn's own bodies in a run, and signs of joints, springs, drives and loads: where they are, for pictures.

Shapes are those that Exudyn's renderer draws: what the user gave each body, or the brick that CreateRigidBody derives
from the inertia. Lines and texts are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ..support.arrays import Array
from ..support.checks import read_only
from ..support.foreign import ItemEntry, MainSystem
from ..support.optional import require
from .carriers import Carrier, pose_in
from .model import registered
from .signs import signs_of

_MOST = 1000  # places of a body that are kept
_MOST_OF_SIGNS = 250  # of a sign: Exudyn takes longer to tell where markers of flexible bodies are
_AROUND, _ALONG = 48, 24  # facets of a sphere
_STRAIGHT = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]  # triangles of one with nodes at the middles of its sides


@dataclass(frozen=True, eq=False)
class OtherBody:
    """Motion of one of Exudyn's own bodies in a run, or of a sign of what joins, drives or loads bodies.

    Parameters
    ----------
    number : int
        Of its object; -1 of a sign.
    name : str
    points : (n, 3) array
        Of its shape, in its own axes [m].
    triangles : (k, 3) int array
        As rows of `points`; none if it has no shape.
    t : (m,) array
        [s]
    place : (m, 3) array
        Of its origin [m].
    turn : (m, 3, 3) array
        Its axes, as columns.
    kind : str
        Of a sign, see `signs.Kind`; empty of a body.
    end : (m, 3) array
        Of a sign, see `signs.Sign`; of a body its place.
    """

    number: int
    name: str
    points: Array
    triangles: Array
    t: Array
    place: Array
    turn: Array
    kind: str
    end: Array

    def __post_init__(self) -> None:
        read_only(self.points, self.triangles, self.t, self.place, self.turn, self.end)

    @property
    def moves(self) -> bool:
        """Whether it was ever elsewhere than at the start."""
        return bool((self.place != self.place[0]).any() or (self.turn != self.turn[0]).any())

    def at(self, times: Array) -> tuple[Array, Array]:
        """Place, (k, 3) [m], and axes, (k, 3, 3), at times, (k,) [s]."""
        times = np.clip(times, self.t[0], self.t[-1])
        place = self._between(times, self.place)
        if len(self.t) == 1:
            return place, np.repeat(self.turn, len(times), axis=0)
        turn: Array = Slerp(self.t, Rotation.from_matrix(self.turn))(times).as_matrix()
        return place, turn

    def end_at(self, times: Array) -> Array:
        """The other end, (k, 3), at times, (k,) [s]."""
        return self._between(np.clip(times, self.t[0], self.t[-1]), self.end)

    def _between(self, times: Array, values: Array) -> Array:
        return np.column_stack([np.interp(times, self.t, along) for along in values.T])

    def velocity_within(self, start: float, end: float, point: Array, *, late: bool) -> Array | None:
        """Velocity of its point that is at `point` in space, (3,) [m/s], by two of its places between two times [s].

        These are the last two, or the first two; None if there are not as many. The error is that of a difference over
        the time between them, a step in a run of up to a thousand steps.
        """
        low, high = np.searchsorted(self.t, start), np.searchsorted(self.t, end, side="right")
        if high - low < 2:
            return None
        pair = slice(high - 2, high) if late else slice(low, low + 2)
        near = high - 1 if late else low
        moved = self.place[pair] + self.turn[pair] @ (self.turn[near].T @ (point - self.place[near]))
        velocity: Array = (moved[1] - moved[0]) / (self.t[pair][1] - self.t[pair][0])
        return velocity


def surface_motion(carrier: Carrier | None, bodies: Iterable[OtherBody], times: Array) -> tuple[Array, Array] | None:
    """Place, (m, 3) [m], and axes, (m, 3, 3), of a rigid surface at times, (m,) [s]; None if they are not known.

    Without a carrier it is at rest. `bodies` are those of a run.
    """
    if carrier is None:
        return np.zeros((len(times), 3)), np.tile(np.eye(3), (len(times), 1, 1))
    return next((body.at(times) for body in bodies if body.number == int(carrier.body)), None)


class _Watched(NamedTuple):
    """A body or sign whose motion is recorded; see `OtherBody`."""

    number: int
    name: str
    kind: str
    points: Array
    triangles: Array
    now: Callable[[MainSystem, object], tuple[Array, Array, Array]]


class _Record:
    """Poses of what is watched at some times of a run: of a longer run each second, then each fourth, and so on.

    Parameters
    ----------
    watched : list of _Watched
    most : int
        Times that are kept.
    """

    def __init__(self, watched: list[_Watched], most: int) -> None:
        self._watched, self._most = watched, most
        self._t: list[float] = []
        self._poses: list[list[tuple[Array, Array, Array]]] = []
        self._stride, self._left = 1, 0

    def __bool__(self) -> bool:
        """Whether anything is watched."""
        return bool(self._watched)

    def keep(self, mbs: MainSystem, t: float, start_of_step: bool) -> None:
        """See `OtherBodies.keep`."""
        if not self._watched:
            return
        if self._t and t <= self._t[-1]:
            if t == self._t[-1]:
                self._poses[-1] = self._now(mbs, start_of_step)
            return
        if self._left:
            self._left -= 1
            return
        self._add(t, self._now(mbs, start_of_step))
        if len(self._t) >= self._most:
            self._t, self._poses, self._stride = self._t[::2], self._poses[::2], 2 * self._stride
        self._left = self._stride - 1

    def _add(self, t: float, poses: list[tuple[Array, Array, Array]]) -> None:
        self._t.append(t)
        self._poses.append(poses)

    def _now(self, mbs: MainSystem, start_of_step: bool) -> list[tuple[Array, Array, Array]]:
        kinds = require("exudyn").ConfigurationType
        configuration = kinds.StartOfStep if start_of_step else kinds.Current
        return [watched.now(mbs, configuration) for watched in self._watched]

    def motions(self, mbs: MainSystem) -> list[OtherBody]:
        """Motion of each until the model's present state."""
        if not self._watched:
            return []
        end = float(mbs.systemData.GetTime())
        if not self._t or end > self._t[-1]:
            self._add(end, self._now(mbs, False))
        t, motions = np.array(self._t), []
        for i, watched in enumerate(self._watched):
            place, turn, other = (np.array([poses[i][part] for poses in self._poses]) for part in range(3))
            motions.append(
                OtherBody(
                    watched.number, watched.name, watched.points, watched.triangles, t, place, turn, watched.kind, other
                )
            )
        return motions


class OtherBodies:
    """Record of where Exudyn's own bodies with shapes, those that carry rigid surfaces, and signs are in a run.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    carriers : iterable of int
        Numbers of the bodies that carry rigid surfaces.
    """

    def __init__(self, mbs: MainSystem, carriers: Iterable[int]) -> None:
        held = registered(mbs)
        bodies, carrying, ours = list[_Watched](), {*carriers}, held.objects
        for number in range(mbs.systemData.NumberOfObjects()):
            if number in ours:  # they are no other bodies, and entries with large matrices take long
                continue
            entry = mbs.GetObject(number)
            points, triangles = _shape(mbs, number, entry)
            if len(triangles) or number in carrying:
                bodies.append(_Watched(number, entry["name"], "", points, triangles, partial(_pose, number)))
        none = np.zeros((0, 3)), np.zeros((0, 3), dtype=int)
        signs = [_Watched(-1, sign.name, sign.kind, *none, sign.now) for sign in signs_of(mbs, held)]
        self._records = _Record(bodies, _MOST), _Record(signs, _MOST_OF_SIGNS)

    def __bool__(self) -> bool:
        """Whether there are any."""
        return any(self._records)

    def keep(self, mbs: MainSystem, t: float, *, start_of_step: bool = False) -> None:
        """Keep where the bodies are at time t [s], in the model's present state, or in that at the start of the step.

        Times must not decrease. A second call for the same time replaces the first one.
        """
        for record in self._records:
            record.keep(mbs, t, start_of_step)

    def motions(self, mbs: MainSystem) -> tuple[OtherBody, ...]:
        """Motion of each until the model's present state, which is the end of the run; signs come last."""
        return tuple(motion for record in self._records for motion in record.motions(mbs))


def _pose(number: int, mbs: MainSystem, configuration: object) -> tuple[Array, Array, Array]:
    place, turn = pose_in(mbs, number, configuration)
    return place, turn, place


def _shape(mbs: MainSystem, number: int, entry: ItemEntry) -> tuple[Array, Array]:
    """Points, (n, 3) [m], and triangles, (k, 3) int, of the graphics of an object; none if it shows none."""
    shown = entry.get("VgraphicsData") and entry["Vshow"]
    graphics = mbs.GetObjectParameter(number, "VgraphicsData") if shown else []
    parts = [part for data in graphics if isinstance(data, dict) for part in _triangles(data)]
    if not parts:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=int)
    starts = np.cumsum([0, *(len(points) for points, _ in parts)])
    triangles = np.vstack([corners + start for (_, corners), start in zip(parts, starts, strict=False)])
    points, numbers = np.unique(np.vstack([points for points, _ in parts]), axis=0, return_inverse=True)
    return points, numbers.reshape(-1)[triangles]  # Exudyn's triangles share no points, and edges could not be told


def _triangles(graphics: dict[str, object]) -> list[tuple[Array, Array]]:
    """Points and triangles of one entry of Exudyn's graphics."""
    points = np.asarray(graphics.get("points", ()), dtype=float).reshape(-1, 3)
    if graphics.get("type") == "Spheres":
        radii = np.asarray(graphics["radii"], dtype=float)
        round_points, triangles = _unit_sphere()
        return [(centre + radius * round_points, triangles) for centre, radius in zip(points, radii, strict=True)]
    if graphics.get("type") != "TriangleList":
        return []
    flat = np.asarray(graphics.get("triangles", ()), dtype=int).reshape(-1, 3)
    curved = np.asarray(graphics.get("triangles6", ()), dtype=int).reshape(-1, 6)
    return [(points, np.vstack([flat, curved[:, _STRAIGHT].reshape(-1, 3)]))]


def _unit_sphere() -> tuple[Array, Array]:
    """Points and triangles of a sphere with radius one."""
    along, around = np.linspace(0, np.pi, _ALONG + 1), np.linspace(0, 2 * np.pi, _AROUND + 1)
    polar, azimuth = (angle.ravel() for angle in np.meshgrid(along, around, indexing="ij"))
    points = np.column_stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    corner = (np.arange(_ALONG)[:, None] * (_AROUND + 1) + np.arange(_AROUND)).ravel()
    below = corner + _AROUND + 1
    triangles = np.vstack([
        np.column_stack([corner, below, corner + 1]),
        np.column_stack([corner + 1, below, below + 1]),
    ])  # fmt: skip
    return points, triangles
