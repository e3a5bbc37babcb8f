"""Motion of bodies' surfaces over a run, frame by frame: rigid motion, deformation, and colours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.run_result import RunResult as Result
from ..fe.facets import facet_corners, flat_triangles
from ..reduction.body import ReducedBody
from ..reduction.static_answer import StaticAnswer
from ..support.arrays import Array
from ..support.checks import validate_choice, validate_integer, validate_times
from ..support.progress import Progress
from .body_fields import BodyFields, Shown, contact_loads, shown_bodies
from .curved_facets import rounded
from .frame_times import frame_times
from .graphics import RigidShape, corners, rigid_shapes
from .hiding import hiding
from .signs import SignShape, sign_shapes

Colour = Literal["speed", "deformation", "von_mises", "contact_pressure"]
COLOUR_NAMES: tuple[Colour, ...] = get_args(Colour)
# What colours are called, their unit, and how many of it an SI unit has.
LABELS: dict[Colour, tuple[str, str, float]] = {
    "speed": ("speed", "m/s", 1.0),
    "deformation": ("deformation", "mm", 1e3),
    "von_mises": ("von Mises stress", "MPa", 1e-6),
    "contact_pressure": ("contact pressure", "MPa", 1e-6),
}
_SOURCES = {"speed": "velocity", "deformation": "deformation"}  # fields whose magnitude is the colour
_MOST_FRAMES = 2000
_VISIBLE = 0.03  # largest deformation in pictures, relative to the size of the bodies
_ROUNDING = 1e-11  # a deformation below this, relative to that size, is none
_SHARE, _MARGIN = 0.995, 1.3  # the colours end at 1.3 times what 99.5 % of the area stay below
_LOOKED_AT = 25  # frames that tell how far bodies move


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Motion of the surface of a body at m frames.

    Its n nodes are at x = place + turn (points + deformation).

    Parameters
    ----------
    name : str
    points : (n, 3) array
        Undeformed, from the centre of mass, in the body's axes [m].
    triangles : (k, 3) int array
        Outward, as rows of `points`.
    facets : (nf, 3 to 10) int array
        The facets that they are parts of, likewise.
    place : (m, 3) array
        Of the centre of mass of rigid motion [m].
    turn : (m, 3, 3) array
        Its rotation; of an inertial frame, that of small rotations, 1 + theta x.
    turns : bool
        Whether `turn` is a rotation of any size.
    deformation : (m, n, 3) array
        In the body's axes [m].
    colours : dict of str to (m, n) array
        Some of `COLOUR_NAMES`, in SI units.
    """

    name: str
    points: Array
    triangles: Array
    facets: Array
    place: Array
    turn: Array
    turns: bool
    deformation: Array
    colours: dict[Colour, Array]

    def at(self, frame: int, scale: float = 1.0) -> Array:
        """Places of the nodes at a frame, their deformation scaled, (n, 3) [m]."""
        local = self.points + scale * self.deformation[frame]
        places: Array = self.place[frame] + local @ self.turn[frame].T
        return places

    def rounded(self) -> BodyMotion:
        """The same with more points where facets are bent, for drawing."""
        triangles, places, values = rounded(self.points, self.facets)
        count = places.shape[0]
        frames = self.deformation.transpose(1, 0, 2).reshape(len(self.points), -1)
        deformation = (places @ frames).reshape(count, -1, 3).transpose(1, 0, 2)
        colours = {name: (values @ field.T).T for name, field in self.colours.items()}
        return replace(self, points=places @ self.points, triangles=triangles, deformation=deformation, colours=colours)

    @cached_property
    def areas(self) -> Array:
        """Share of each node in the area of the triangles, (n,) [m2]."""
        a, b, c = self.points[self.triangles].swapaxes(0, 1)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
        return np.bincount(self.triangles.ravel(), np.repeat(area, 3), minlength=len(self.points))


@dataclass(frozen=True, eq=False)
class Spot:
    """Where a contact presses at its peak.

    Parameters
    ----------
    name : str
        Of the contact.
    place : (3,) array
        Middle of its pressures [m].
    reach : float
        Distance from there to the farthest node that is pressed [m].
    push : (3,) array
        Unit vector of the force on the slave.
    time : float
        [s]
    bodies : list of int
        Numbers of slave and master among those shown; -1 of one that is not shown.
    """

    name: str
    place: Array
    reach: float
    push: Array
    time: float
    bodies: list[int]


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of a run's bodies at m frames.

    Parameters
    ----------
    t : (m,) array
        [s]
    bodies : list of BodyMotion
    forces : dict of str to (n,) array
        Normal force of each contact [N] at the times `force_t` of all samples of the run.
    force_t : (n,) array
        [s]
    spots : list of Spot
        Of contacts that press.
    peak : float
        Time of the largest force [s].
    rigid : list of RigidShape
        Rigid surfaces of the contacts, and Exudyn's own bodies.
    signs : list of SignShape
        Of joints, springs, drives, loads, ground and gravity.
    """

    t: Array
    bodies: list[BodyMotion]
    forces: dict[str, Array]
    force_t: Array
    spots: list[Spot]
    peak: float
    rigid: list[RigidShape]
    signs: list[SignShape] = field(default_factory=list)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper corner of the box that holds all bodies that move, at all frames, (3,) each [m]."""
        moving: list[BodyMotion | RigidShape] = [*self.bodies]
        moving += [shape for shape in self.rigid if shape.name and shape.moves]
        every = np.vstack([corners(body.at(frame)) for body in moving for frame in _looked_at(len(self.t))])
        return every.min(axis=0), every.max(axis=0)

    @property
    def size(self) -> float:
        """Diagonal of that box [m]."""
        low, high = self.bounds
        return float(np.linalg.norm(high - low))

    @property
    def visible_scale(self) -> float:
        """Power of ten by which the deformation is scaled to be seen."""
        size = max(float(np.ptp(body.points, axis=0).max()) for body in self.bodies)
        largest = max(float(abs(body.deformation).max()) for body in self.bodies)
        if largest <= _ROUNDING * size:
            return 1.0
        return float(10.0 ** max(0, np.floor(np.log10(_VISIBLE * size / largest))))

    def rounded(self) -> Motion:
        """The same, of bodies with more points where facets are bent."""
        return replace(self, bodies=[body.rounded() for body in self.bodies])

    def look_through(self, frame: int, towards: Array) -> tuple[list[bool], list[bool]]:
        """Whether bodies and rigid shapes hide a body from a viewer in a direction, (3,), at a frame."""
        bodies = [(body.at(frame), body.triangles) for body in self.bodies]
        rigid = [(shape.at(frame), shape.triangles) for shape in self.rigid]
        matter = [*(True for _ in bodies), *(bool(shape.name) for shape in self.rigid)]
        faded = hiding([*bodies, *rigid], matter, towards)
        return faded[: len(bodies)], faded[len(bodies) :]

    def end_of(self, colour: Colour) -> float:
        """Value at the upper end of the colours: what most of the area stays below, so that a small dent does not rule.

        Fine meshes have most of the nodes, so each node counts with its area.
        """
        largest = max(float(body.colours[colour].max()) for body in self.bodies)
        parts = []
        for body in self.bodies:
            values = body.colours[colour]
            acting = values > max(1e-3 * largest, 0.0)  # a pressure is zero nearly everywhere
            parts.append((values[acting], np.broadcast_to(body.areas, values.shape)[acting]))
        values, weights = (np.concatenate(column) for column in zip(*parts, strict=True))
        if not len(values):
            return 1.0
        order = np.argsort(values)
        summed = np.cumsum(weights[order])
        most = float(values[order][min(len(order) - 1, int(np.searchsorted(summed, _SHARE * summed[-1])))])
        return min(largest, _MARGIN * most)


def motion_of(
    result: Result,
    bodies: Sequence[Shown] | None = None,
    *,
    colours: Sequence[Colour] | None = None,
    frames: int | Sequence[float] | Array = 100,
    more: int = 0,
    progress: Progress | None = None,
) -> Motion:
    """Motion of a run's bodies, by default all, at some frames.

    Parameters
    ----------
    result : Result
    bodies : sequence of PartitionBody or (PartitionBody, FEModel), optional
        Bodies with their FE models also show the static answer to the contacts' forces, and can have stresses.
    colours : sequence of str, optional
        Some of `COLOUR_NAMES`. Default: all that bodies and contacts have.
    frames : int or (m,) array
        How many, or their times [s], see `Result.at`.
    more : int
        Largest number of further frames at impacts, if `frames` says how many: equally spaced ones miss these.

    Raises
    ------
    InputError
        If an argument has a wrong type or is out of range, or stress is asked of a body without its FE model.
    """
    force = {contact.name: contact.force(result) for contact in result.contacts}
    total = np.sum([*force.values()], axis=0) if force else np.zeros(len(result.t))
    if isinstance(frames, int | np.integer):
        frames = validate_integer("frames", frames, 2, _MOST_FRAMES)
        if more and len(result.t):
            frames = frame_times(result.t, force.values(), frames, more)
            frames = np.r_[frames, result.t[np.argmax(total)], _pressure_peaks(result)]
    elif len(result.t):
        frames = validate_times("frames", frames, result.t)
    run = result.at(frames)
    chosen = shown_bodies(result.bodies, bodies)
    wanted = _colours(result, chosen, colours)
    names = ["deformation", *(_SOURCES.get(colour, colour) for colour in wanted)]
    answers: dict[ReducedBody, StaticAnswer] = {}
    pieces = [BodyFields(entry, list(dict.fromkeys(names)), surface=True, answers=answers) for entry in chosen]
    loads = contact_loads(result.contacts, run) if any(piece.fem is not None for piece in pieces) else []
    moved = []
    for i, piece in enumerate(pieces):
        fields: dict[str, list[Array]] = {}
        for data in piece.frames(run, result.contacts, loads):
            for name, values in data.items():
                fields.setdefault(name, []).append(values)
            if progress is not None:
                progress((i + len(fields["deformation"]) / len(run.t)) / len(pieces))
        found = {name: np.array(values) for name, values in fields.items()}
        moved.append(_body(piece, piece.item.name or f"body {i}", run, wanted, found))
    frame_numbers = _looked_at(len(run.t))
    nearest = np.searchsorted(frame_numbers, np.arange(len(run.t)))
    places = {
        piece.item: np.array([corners(body.at(frame)) for frame in frame_numbers])[nearest]
        for piece, body in zip(pieces, moved, strict=True)
    }
    rigid = rigid_shapes(result, run.t, places)
    spots = _spots(result, [piece.item for piece in pieces])
    motion = Motion(run.t, moved, force, result.t, spots, float(result.t[int(np.argmax(total))]), rigid)
    return replace(motion, signs=sign_shapes(result.others, run.t, motion.bounds))


def _looked_at(count: int) -> Array:
    """Some of `count` frames, with the first and the last one, (k,) int: not each frame needs a look."""
    return np.unique(np.linspace(0, count - 1, _LOOKED_AT).astype(int))


def _colours(result: Result, chosen: Sequence[Shown], colours: Sequence[Colour] | None) -> list[Colour]:
    """Colours to compute: those asked for, or all that there are."""
    if colours is None:
        stressed = all(isinstance(entry, tuple) for entry in chosen)
        pressed = bool(result.contacts) and all(_pressure(result, contact) is not None for contact in result.contacts)
        return ["speed", "deformation", *["von_mises"] * stressed, *["contact_pressure"] * pressed]  # type: ignore[list-item]
    if isinstance(colours, str) or not isinstance(colours, Sequence):
        raise InputError(f"colours: expected a list of some of {', '.join(COLOUR_NAMES)}, got {colours!r}")
    found: list[Colour] = [validate_choice("colours", colour, COLOUR_NAMES) for colour in colours]
    if not found:
        raise InputError(f"colours: expected some of {', '.join(COLOUR_NAMES)}, got none")
    return found


def _body(piece: BodyFields, name: str, run: Result, wanted: Sequence[Colour], found: dict[str, Array]) -> BodyMotion:
    """Motion of one body from its fields in the axes of space, (m, n, ...)."""
    kinematics, q = piece.kinematics, piece.item.coordinates(run)
    origin, axes = kinematics.frame(q)
    undeformed = piece.points + kinematics.displacements(q[0]) - kinematics.deformation(q[0]) @ axes[0].T
    if kinematics.linear:  # small rotations are within the frame
        motion = kinematics.rigid_motion(q)
        place, turn = origin + motion[:, :3], np.eye(3) + np.cross(np.eye(3), motion[:, None, 3:])
    else:
        place, turn = origin, axes
    back = np.linalg.inv(turn).swapaxes(1, 2)
    points, deformation = (undeformed - place[0]) @ back[0], found["deformation"] @ back
    colours: dict[Colour, Array] = {}
    for colour in wanted:
        values = found.get(_SOURCES.get(colour, colour), np.zeros(deformation.shape[:2]))
        colours[colour] = np.linalg.norm(values, axis=2) if values.ndim == 3 else values
    triangles = flat_triangles(piece.cells)[0]
    return BodyMotion(name, points, triangles, piece.cells, place, turn, not kinematics.linear, deformation, colours)


def pressing_at(result: Result, time: float, scale: float = 1.0) -> list[tuple[Array, float]]:
    """Where contacts press at a time, (3,) [m], with the deformation scaled, and their forces [N]."""
    now = result.at([time])
    forces = [(contact, float(contact.force(now)[0])) for contact in result.contacts]
    return [(_spot(contact, now, scale), force) for contact, force in forces if force > 0]


def _spots(result: Result, items: Sequence[PartitionBody]) -> list[Spot]:
    """Where each contact that presses does so at its peak; `items` are the bodies that are shown."""
    spots = []
    for contact in result.contacts:
        force = abs(contact.force(result))
        if force.any():
            time = float(result.t[int(force.argmax())])
            now = result.at([time])
            place, weight = _pressed(contact, now)
            spot = np.average(place, axis=0, weights=weight)
            far = np.linalg.norm(place[weight > 0] - spot, axis=1)
            push = contact.force_on_slave(now)[0]
            size = float(np.linalg.norm(push))
            spots.append(
                Spot(
                    name=contact.name,
                    place=spot,
                    reach=float(far.max()),
                    push=push / size if size else np.array([0.0, 0.0, 1.0]),
                    time=time,
                    bodies=[items.index(item) if item in items else -1 for item, _ in contact.sides],
                )
            )
    return spots


def _pressed(contact: PartitionContact, now: Result, scale: float = 1.0) -> tuple[Array, Array]:
    """Places of the slave's nodes at one time, (n, 3) [m], and the weight with which they are pressed, (n,)."""
    item, patch = contact.sides[0]
    nodes = item.body.partition.patches[patch].nodes
    pressure = _pressure(now, contact)
    weight = np.zeros(len(nodes)) if pressure is None else abs(pressure.toarray()[0, : len(nodes)])
    kinematics, (q,) = item.kinematics.at(nodes), item.coordinates(now)
    place = kinematics.place(q) + (scale - 1) * kinematics.deformation(q) @ kinematics.frame(q)[1].T
    return place, weight if weight.any() else np.ones(len(nodes))


def _spot(contact: PartitionContact, now: Result, scale: float = 1.0) -> Array:
    """Where a contact presses at one time, (3,) [m]: the middle of its pressures, or of its patch."""
    place, weight = _pressed(contact, now, scale)
    spot: Array = np.average(place, axis=0, weights=weight)
    return spot


def _pressure_peaks(result: Result) -> list[float]:
    """Times of the largest pressure of each contact [s], which may be before or after the largest force."""
    times = []
    for contact in result.contacts:
        pressure = _pressure(result, contact)
        if pressure is not None and pressure.nnz:
            item, number = contact.sides[0]
            patch = item.body.partition.patches[number]
            shown = np.flatnonzero(np.isin(patch.nodes, facet_corners(patch.facets)))  # the others are drawn as means
            times.append(float(result.t[int(pressure[:, shown].max(axis=1).toarray().argmax())]))
    return times


def _pressure(result: Result, contact: PartitionContact) -> sp.csr_matrix | None:
    """Pressures of a contact, (n, rows) [Pa]; None if they are not known, as of a run of which nothing was kept."""
    try:
        return contact.pressure(result)
    except InputError:
        return None
