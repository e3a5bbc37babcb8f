"""What is drawn: bodies with a field; and as Exudyn's graphics data the scale of colours and rigid surfaces."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from ..contact.profile import RigidProfile
from ..contact.rigid import RigidCylinder, RigidPlane, RigidSphere
from ..contact.rigid_mesh import RigidMesh
from ..errors import InputError
from ..exudyn_bodies.other_bodies import surface_motion
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.run_result import RunResult as Result
from ..reduction.body import ReducedBody
from ..reduction.static_answer import StaticAnswer
from ..support.arrays import Array
from ..support.checks import (
    shape_of,
    validate_choice,
    validate_integer,
    validate_number,
    validate_positive,
    validate_times,
)
from .body_fields import BodyFields, Shown, contact_loads, shown_bodies

GraphicsData = dict[str, object]  # in the format of Exudyn
Pose = tuple[Array, Array]  # place, (3,) [m], and axes as columns, (3, 3)

ViewField = Literal["displacement", "deformation", "velocity", "von_mises"]
UNITS: dict[ViewField, str] = {"displacement": "m", "deformation": "m", "velocity": "m/s", "von_mises": "Pa"}
COLOURS = "viridis"
WINDOW = (1024, 768)
_LARGEST_SCALE = 1e12  # of deformation: pictures are drawn in single precision
_SHORTEST, _LONGEST = 0.01, 600  # times from one picture of a film to the next [s]
_MOST_PIXELS = 8192  # along a side: for larger pictures Exudyn may run out of memory and end the process

_STEPS = 32  # of the colour bar, and of a surface along each straight side
_SIDES = 96  # of a round surface
_GREY = (0.6, 0.6, 0.63, 1.0)
_NEARLY_ROUND = 2.2  # rad: a cylinder that is drawn so far to either side is drawn whole
_BEYOND = 0.65  # half the side of a rigid surface that is drawn, by the size of the bodies
# Above the bodies in the view, by their size: lower and upper side of the bar, its numbers, and lines of the title.
_LOWER, _UPPER, _NUMBERS, _LINE = 0.04, 0.07, 0.085, 0.06


def time_of(result: Result, time: float) -> float:
    """Return a time within the run [s] that a user gave."""
    (found,) = validate_times("time", [validate_number("time", time, "a time in s")], result.t)
    return float(found)


def peak_time(result: Result) -> float:
    """Time of the largest contact force, or of the last sample if there is no contact [s]."""
    forces = [contact.force(result) for contact in result.contacts]
    return float(result.t[int(np.argmax(np.max(forces, axis=0)))] if forces else result.t[-1])


def pieces_of(held: Sequence[PartitionBody], bodies: Sequence[Shown] | None, field: ViewField) -> list[BodyFields]:
    """Surfaces of the bodies to draw, by default all that are `held`, with what a picture of `field` needs."""
    validate_choice("field", field, UNITS)
    answers: dict[ReducedBody, StaticAnswer] = {}
    return [BodyFields(entry, ("displacement", "deformation", field), surface=True, answers=answers)
            for entry in shown_bodies(held, bodies)]  # fmt: skip


def fields_at(
    result: Result, pieces: Sequence[BodyFields], now: Callable[[], int]
) -> Callable[[BodyFields], dict[str, Array]]:
    """Return a function of a piece that returns its fields at the sample whose number `now` returns."""
    for piece in pieces:  # an error within Exudyn's drawing would end nothing
        result.sensor_of(piece.item, piece.item["sCoordinates"][0])
    loads = contact_loads(result.contacts, result) if any(piece.fem is not None for piece in pieces) else []

    def fields(piece: BodyFields) -> dict[str, Array]:
        found = piece.at_samples(result, loads, np.array([now()]))
        return {name: values[0] for name, values in found.items()}

    return fields


def drawn_fields(
    pieces: Sequence[BodyFields], fields: Callable[[BodyFields], dict[str, Array]], field: ViewField, scale: float
) -> tuple[list[Array], list[Array]]:
    """Places of the pieces' nodes, (n, 3) [m], their deformation scaled, and the magnitudes of a field there, (n,)."""
    places, values = [], []
    for piece in pieces:
        data = fields(piece)
        places.append(piece.points + data["displacement"] + (scale - 1) * data["deformation"])
        colour = data[field]
        values.append(colour if colour.ndim == 1 else np.linalg.norm(colour, axis=1))
    return places, values


def places_of(pieces: Sequence[BodyFields], places: Sequence[Array]) -> dict[PartitionBody, Array]:
    """Places of the pieces' nodes at one time, (n, 3) each [m], as `rigid_shapes` takes them."""
    return {piece.item: place[None] for piece, place in zip(pieces, places, strict=True)}


def title_of(field: ViewField, scale: float) -> list[str]:
    """Lines of a picture's title: the field with its unit, and what a scaled deformation makes."""
    return [f"{field} [{UNITS[field]}]"] + [f"deformed x {scale:g}: bodies may seem to overlap"] * (scale != 1)


def validate_period(period: object, pictures: int = 1) -> float:
    """Return the time of so many pictures of a film [s]; GIF files count hundredths of a second, up to 655 s."""
    value = validate_positive("period", period, "s")
    if not _SHORTEST <= value / pictures <= _LONGEST:
        raise InputError(
            f"period: expected {_SHORTEST} to {_LONGEST} s from one picture to the next, got {value / pictures:.3g} s"
        )
    return value


def validate_scale(scale: float) -> float:
    """Check the factor on the drawn deformation."""
    scale = validate_positive("scale", scale)
    if scale > _LARGEST_SCALE:
        raise InputError(f"scale: expected at most {_LARGEST_SCALE:g} times the deformation, got {scale:g}")
    return scale


def validate_pixels(size: tuple[int, int]) -> list[int]:
    """Check width and height of a picture."""
    if shape_of(size) != (2,):
        raise InputError(f"size: expected width and height in pixels, such as {WINDOW}, got {size!r}")
    return [validate_integer("size", pixels, 1, _MOST_PIXELS) for pixels in size]


def colour_bar(
    places: Array, turn: Rotation, colours: Callable[[Array], Array], lines: Sequence[str], ends: tuple[str, str]
) -> list[GraphicsData]:
    """Bar of colours above the bodies in the view, with texts at its ends and a title.

    Parameters
    ----------
    places : (n, 3) array
        Where the bodies are drawn [m].
    turn : Rotation
        Of the view.
    colours : callable
        Returns RGBA, (k, 4), of shares from 0 to 1, (k,).
    lines : sequence of str
        Title, from its last line upwards.
    ends : (str, str)
        Values at the lower and upper end.
    """
    seen = turn.apply(places)  # coordinates to the right, upwards, and towards the viewer
    low, high = seen.min(axis=0), seen.max(axis=0)
    size = float((high - low).max())
    share = np.linspace(0.0, 1.0, _STEPS + 1)
    right = low[0] + 0.6 * size * share
    edges = [np.column_stack([right, np.full_like(right, high[1] + y * size), np.full_like(right, high[2])])
             for y in (_LOWER, _UPPER)]  # fmt: skip

    def at(x: float, y: float) -> list[float]:
        place: list[float] = turn.inv().apply([x, high[1] + y * size, high[2]]).tolist()
        return place

    i, n = np.arange(_STEPS), _STEPS + 1
    triangles = np.vstack([np.column_stack([i, i + 1, i + n]), np.column_stack([i + 1, i + 1 + n, i + n])])
    return [
        {
            "type": "TriangleList",
            "points": turn.inv().apply(np.vstack(edges)),
            "colors": np.tile(colours(share), (2, 1)),
            "triangles": triangles,
        },
        {"type": "Text", "text": ends[0], "position": at(low[0], _NUMBERS)},
        {"type": "Text", "text": ends[1], "position": at(low[0] + 0.5 * size, _NUMBERS)},
        *(
            {"type": "Text", "text": line, "position": at(low[0], _NUMBERS + _LINE * i)}
            for i, line in enumerate(lines, 1)
        ),
    ]


@dataclass(frozen=True, eq=False)
class RigidShape:
    """Motion of a rigid surface, or of one of Exudyn's own bodies, at m frames.

    Parameters
    ----------
    name : str
        Of the body; empty for the surface of a contact.
    points : (n, 3) array
        In its own axes [m].
    triangles : (k, 3) int array
        As rows of `points`.
    place : (m, 3) array
        Of its origin [m].
    turn : (m, 3, 3) array
        Its axes, as columns.
    """

    name: str
    points: Array
    triangles: Array
    place: Array
    turn: Array

    def at(self, frame: int) -> Array:
        """Places of its points at a frame, (n, 3) [m]."""
        places: Array = self.place[frame] + self.points @ self.turn[frame].T
        return places

    @property
    def moves(self) -> bool:
        """Whether it is ever elsewhere than at the first frame."""
        return bool((self.place != self.place[0]).any() or (self.turn != self.turn[0]).any())


def rigid_shapes(result: Result, times: Array, places: Mapping[PartitionBody, Array]) -> list[RigidShape]:
    """Rigid surfaces of a run's contacts, and Exudyn's own bodies that have a shape, at m frames.

    Parameters
    ----------
    result : Result
    times : (m,) array
        Of the frames [s].
    places : dict of PartitionBody to (m, n, 3) array
        Places of the shown bodies at these times [m]. A surface without an end is drawn as far as those extend that may
        touch it.
    """
    found = []
    touching: dict[tuple[int, int], list[PartitionContact]] = {}
    for contact in result.contacts:
        number = -1 if contact.carrier is None else int(contact.carrier.body)
        touching.setdefault((id(contact.master), number), []).append(contact)
    for contact, *more in touching.values():
        near = [places[one.slave] for one in (contact, *more) if one.slave in places]
        seen = np.concatenate(near or [*places.values()], axis=1)
        motion = surface_motion(contact.carrier, result.others, times)
        if motion is None:
            continue
        place, turn = motion
        surface = _surface(contact.master, np.einsum("mnk,mkl->mnl", seen - place[:, None], turn).reshape(-1, 3))
        if surface is not None:
            found.append(RigidShape("", *surface, place, turn))
    for other in result.others:
        if len(other.triangles):
            found.append(RigidShape(other.name, other.points, other.triangles, *other.at(times)))
    return found


def corners(places: Array) -> Array:
    """Corners of the box around points, (n, 3) -> (8, 3)."""
    ends = places.min(axis=0), places.max(axis=0)
    return np.array([[ends[i][0], ends[j][1], ends[k][2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def rigid_surfaces(
    contacts: Iterable[PartitionContact], places: Array, poses: Callable[[PartitionContact], Pose | None]
) -> list[GraphicsData]:
    """Rigid surfaces of contacts, as far as the bodies at `places`, (n, 3) [m], extend.

    `poses` returns place and axes of the body that carries a contact's surface, or None if they are not known; such a
    surface is not drawn.
    """
    drawn = []
    for contact in {id(contact.master): contact for contact in contacts}.values():
        pose = (np.zeros(3), np.eye(3)) if contact.carrier is None else poses(contact)
        if pose is not None:
            origin, axes = pose
            if (surface := _surface(contact.master, (places - origin) @ axes)) is not None:
                points, triangles = surface
                drawn.append(grey(origin + points @ axes.T, triangles))
    return drawn


def _surface(surface: object, places: Array) -> tuple[Array, Array] | None:
    """Points, (n, 3) [m], and triangles of a rigid surface, as far as bodies at `places`, (m, 3), extend."""
    if isinstance(surface, RigidMesh):
        return surface.points, surface.triangles
    grid = _grid_on(surface, places)
    return None if grid is None else (grid.reshape(-1, 3), _grid_triangles(*grid.shape[:2]))


def _grid_on(surface: object, places: Array) -> Array | None:
    """Grid of points, (m, n, 3) [m], on a rigid surface, as far as bodies at `places`, (k, 3), extend."""
    middle, half = places.mean(axis=0), _BEYOND * float(np.ptp(places, axis=0).max())
    share, round_share = (np.linspace(-1.0, 1.0, count + 1) for count in (_STEPS, _SIDES))
    if isinstance(surface, RigidCylinder | RigidProfile):
        along = _BEYOND * float(np.ptp(places @ surface.axis))
    if isinstance(surface, RigidPlane):
        one, two = _across(surface.normal)
        foot = middle - surface.project(middle[None])[0][0] * surface.normal
        grid = foot + half * (share[:, None, None] * one + share[:, None] * two)
    elif isinstance(surface, RigidSphere):
        towards = _unit(middle - surface.center)
        one, two = _across(towards)
        polar = min(np.pi, 2 * half / surface.radius) * (share[:, None, None] + 1) / 2
        around = np.pi * round_share[:, None]
        side = np.cos(around) * one + np.sin(around) * two
        grid = surface.center + surface.radius * (np.cos(polar) * towards + np.sin(polar) * side)
    elif isinstance(surface, RigidCylinder):
        foot = surface.point + ((middle - surface.point) @ surface.axis) * surface.axis
        towards = _unit(middle - foot) if np.linalg.norm(middle - foot) else _across(surface.axis)[0]
        reach = 2 * half / surface.radius
        around = (np.pi if reach > _NEARLY_ROUND else reach) * round_share[:, None, None]
        side = np.cos(around) * towards + np.sin(around) * np.cross(surface.axis, towards)
        grid = foot + surface.radius * side + along * share[:, None] * surface.axis
    elif isinstance(surface, RigidProfile):
        foot = surface.point + ((middle - surface.point) @ surface.axis) * surface.axis
        around = np.linspace(0, len(surface.curve), len(round_share)).astype(int) % len(surface.curve)
        side = surface.curve[around] @ surface.plane.T
        grid = foot + side[:, None] + along * share[:, None] * surface.axis
    else:
        return None
    return np.asarray(grid)


def _grid_triangles(m: int, n: int) -> Array:
    """Triangles between the points of a grid, (m, n), by their numbers."""
    corner = (n * np.arange(m - 1)[:, None] + np.arange(n - 1)).ravel()
    return np.vstack([
        np.column_stack([corner, corner + 1, corner + n]),
        np.column_stack([corner + 1, corner + n + 1, corner + n]),
    ])  # fmt: skip


def grey(points: Array, triangles: Array) -> GraphicsData:
    """Grey triangles, (m, 3), with corners, (n, 3) [m]."""
    return {
        "type": "TriangleList",
        "points": points,
        "colors": np.tile(_GREY, (len(points), 1)),
        "triangles": triangles,
    }


def _across(direction: Array) -> tuple[Array, Array]:
    """Two unit vectors, (3,) each, perpendicular to a direction and to each other."""
    one = _unit(np.cross(direction, np.eye(3)[np.argmin(abs(direction))]))
    return one, np.cross(_unit(direction), one)


def _unit(vector: Array) -> Array:
    value: Array = vector / (np.linalg.norm(vector) or 1.0)
    return value
