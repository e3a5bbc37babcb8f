"""A run's bodies as one HTML page that plays: it opens from disk, without a network, in any browser and on a phone.

A frame of n nodes would be 3 n numbers. The page holds less: the rigid motion of each body, few shapes of its
deformation, found by a singular value decomposition of all frames, and their amplitudes. The browser computes places
and normals from them. Shapes of the reduced body would lack the static answer at the contact.
"""

from __future__ import annotations

import base64
import gzip
import html
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..exudyn_contacts.run_result import RunResult as Result
from ..support.arrays import Array
from ..support.checks import validate_callable, validate_integer, validate_result, validate_text
from ..support.files import replacing, writable
from ..support.foreign import JSON
from ..support.optional import require
from ..support.progress import Progress, shown
from .body_fields import Shown
from .frame_times import slow_spans, time_digits
from .graphics import RigidShape, validate_scale
from .motion import LABELS, BodyMotion, Colour, Motion, motion_of

_TEMPLATE = "scene_page.html"
_TOLERANCE = 5e-3  # largest error of a node's place, relative to the largest deformation of its body
_ROUNDED = 2e-4  # step of a shape's entries, likewise: rounded numbers are packed smaller
_CREASE = np.cos(np.radians(35))  # beyond this angle neighbours have normals of their own: an edge is seen
_LEVELS = 255  # of colours: square roots, since contacts have many times the stress of a wave
_CURVE = 1200  # parts of the curve of forces, of each the least and the largest value: no screen is much wider
_STEEL = ("#dde3e8", "magma_r", 0.16, 0.86)  # of unstressed bodies, and the part of the map for the others
_COLOURS = 256
_SPEEDS = (60, 20, 8, 3, 1)  # seconds in which the run is played
_SPEED = 2  # which of these is the first choice
_MORE = 200  # most frames at impacts, beside those that are equally spaced
_SLOW, _ALL_SLOW = 1.5, 20.0  # seconds in which an impact is played at least, and all of them at most
_VIEW = (-1.05, 0.42)  # azimuth and elevation of the first view [rad]
_IN_MILLISECONDS = 2.0  # shorter runs are told in milliseconds [s]
_HEIGHT = 560  # of the page in a notebook's cell [pixels]
_TYPES = {"f4": np.float32, "i2": np.int16, "u4": np.uint32, "u1": np.uint8}


@dataclass(frozen=True, eq=False)
class Scene:
    """A page that shows a run; what `Result.scene` returns. In a notebook it is its own picture.

    Parameters
    ----------
    page : str
        HTML that needs no other file.
    path : Path or None
        Where it was written.
    height : int
        Of the page in a cell of a notebook [pixels].
    """

    page: str = field(repr=False)
    path: Path | None = None
    height: int = _HEIGHT

    def save(self, path: str | Path) -> Scene:
        """Write the page to a file.

        Raises
        ------
        InputError
            If the folder does not exist.
        """
        path = writable(path)
        with replacing(path, "w") as file:
            file.write(self.page)
        return Scene(self.page, path, self.height)

    def _repr_html_(self) -> str:
        return self.in_frame()

    def in_frame(self) -> str:
        """HTML of a frame that holds the page, as notebooks show it."""
        style = f"width:100%;height:{self.height}px;border:0"
        return f'<iframe title="moving bodies" style="{style}" srcdoc="{html.escape(self.page)}"></iframe>'


def scene_of(
    result: Result,
    bodies: Sequence[Shown] | None = None,
    *,
    colours: Sequence[Colour] | None = None,
    frames: int | Sequence[float] | Array = 100,
    scale: float | None = None,
    title: str = "",
    height: int = _HEIGHT,
    progress: Progress | None = None,
) -> Scene:
    """Make the page of a run; see `Result.scene`."""
    validate_result(result)
    validate_text("title", title)
    height = validate_integer("height", height, 100, 10_000)
    if scale is not None:
        scale = validate_scale(scale)
    if progress is not None:
        validate_callable("progress", progress, "a function of the share done, 0 to 1")
    with shown(progress, "moving bodies") as report:
        motion = motion_of(result, bodies, colours=colours, frames=frames, more=_MORE, progress=report).rounded()
    middle = np.mean(motion.bounds, axis=0)
    blob = _Blob()
    facts = _facts(motion, title, motion.visible_scale if scale is None else scale)
    azimuth, elevation = _VIEW
    flat = np.cos(elevation)
    towards = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    faded = motion.look_through(int(np.searchsorted(motion.t, motion.peak).clip(0, len(motion.t) - 1)), towards)
    facts["bodies"] = [
        {**_packed(body, middle, motion, blob), "faded": look}
        for body, look in zip(motion.bodies, faded[0], strict=True)
    ]
    facts["rigid"] = [
        {**_packed_shape(shape, middle, blob), "faded": look}
        for shape, look in zip(motion.rigid, faded[1], strict=True)
    ]
    facts["signs"] = [{**_packed_shape(sign, middle, blob), "colour": sign.rgb} for sign in motion.signs]
    seen = (motion.force_t >= motion.t[0]) & (motion.force_t <= motion.t[-1])
    facts["forces"] = [
        {"name": name, "curve": blob.put(force_curve(motion.force_t[seen], own[seen]), "f4")}
        for name, own in motion.forces.items()
    ]
    facts["spots"] = [
        {
            "name": spot.name,
            "place": (spot.place - middle).tolist(),
            "reach": spot.reach,
            "push": spot.push.tolist(),
            "time": spot.time,
            "bodies": spot.bodies,
        }
        for spot in motion.spots
    ]
    jinja2 = require("jinja2")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=jinja2.StrictUndefined
    )
    page = environment.get_template(_TEMPLATE).render(
        title=title or "run",
        names=", ".join(body.name for body in motion.bodies),
        facts=json.dumps(facts).replace("<", "\\u003c"),
        data=base64.b64encode(gzip.compress(blob.content, 6, mtime=0)).decode(),
    )
    return Scene(page, None, height)


class _Blob:
    """Bytes of many arrays, one after the other, each at a multiple of four."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def put(self, values: Array, kind: str) -> tuple[str, int, int]:
        """Append an array; returns its type, first byte and number of entries."""
        array = np.ascontiguousarray(values, dtype=_TYPES[kind])
        raw = array.tobytes()
        start, padding = self._size, -len(raw) % 4
        self._parts += [raw, b"\0" * padding]
        self._size += len(raw) + padding
        return kind, start, array.size

    @property
    def content(self) -> bytes:
        """All of them."""
        return b"".join(self._parts)


def _facts(motion: Motion, title: str, scale: float) -> JSON:
    """What the page needs beside arrays."""
    span = float(motion.t[-1] - motion.t[0]) or 1.0  # s; a page of one instant does not play
    unit, factor = ("ms", 1e3) if span < _IN_MILLISECONDS else ("s", 1.0)
    colours = []
    for name in motion.bodies[0].colours:
        label, of, many = LABELS[name]
        largest = max(float(body.colours[name].max()) for body in motion.bodies) or 1.0
        colours.append(
            {"name": label, "unit": of, "largest": many * largest, "end": min(1.0, motion.end_of(name) / largest)}
        )
    least = _SLOW / _SPEEDS[_SPEED] * span
    slow = slow_spans(motion.force_t, motion.forces.values(), least)
    return {
        "title": title,
        "t": motion.t.tolist(),
        "unit": unit,
        "factor": factor,
        "digits": time_digits(motion.t, factor),
        "start": motion.peak,
        "size": motion.size,
        "half": (0.51 * np.subtract(*motion.bounds[::-1])).tolist(),
        "view": _VIEW,
        "scale": scale,
        "largestScale": max(10.0, 100 * scale),
        "speeds": [span / seconds for seconds in _SPEEDS],
        "speed": span / _SPEEDS[_SPEED],
        "slow": slow,
        "slowSeconds": min(_SLOW, _ALL_SLOW / max(1, len(slow))),
        "colours": colours,
        "levels": _LEVELS,
        "map": _map(),
    }


def force_curve(t: Array, force: Array) -> Array:
    """Samples of a curve, (k, 2): times [s] and values, of each part the least and the largest, the first and the last.

    Parts are as wide as pixels, so that a drawing of these is that of all samples.
    """
    if not len(t):
        return np.zeros((0, 2))
    edges = np.searchsorted(t, np.linspace(t[0], t[-1], _CURVE + 1)[1:-1])
    parts = np.split(np.arange(len(t)), edges)
    ends = [part[[force[part].argmin(), force[part].argmax()]] for part in parts if len(part)]
    kept = np.unique(np.concatenate([[0, len(t) - 1], *ends]))
    return np.column_stack([t[kept], force[kept]])


def colour_map() -> object:
    """Matplotlib's map for moving bodies: light where nothing happens, so that shape stays visible, then darker."""
    light, name, low, high = _STEEL
    parts = require("matplotlib").colormaps[name](np.linspace(low, high, 12))
    return require("matplotlib.colors").LinearSegmentedColormap.from_list("steel", [light, *parts], N=_COLOURS)


def _map() -> list[list[int]]:
    """The map's colours as red, green, blue of 0 to 255."""
    values: list[list[int]] = np.round(_LEVELS * colour_map()(np.linspace(0, 1, _COLOURS))[:, :3]).astype(int).tolist()  # type: ignore[operator]
    return values


def _packed(body: BodyMotion, middle: Array, motion: Motion, blob: _Blob) -> JSON:
    """One body for the page, its arrays in the blob."""
    shapes, amplitudes = few_shapes(body.deformation)
    steps = _steps(shapes, amplitudes, float(abs(body.deformation).max()))
    triangles, nodes = split_at_edges(body.points, body.triangles)
    levels = []
    for name, values in body.colours.items():
        largest = max(float(other.colours[name].max()) for other in motion.bodies) or 1.0
        levels.append(np.round(_LEVELS * np.sqrt(np.clip(values / largest, 0, 1))))
    return {
        "name": body.name,
        "turns": body.turns,
        "points": blob.put(body.points, "f4"),
        "triangles": blob.put(triangles, "u4"),
        "nodes": blob.put(nodes, "u4"),
        "shapes": blob.put(np.round(shapes / steps[:, None, None]), "i2"),
        "amplitudes": blob.put(amplitudes * steps, "f4"),
        "place": blob.put(body.place - middle, "f4"),
        "turn": blob.put(body.turn, "f4"),
        "colours": [blob.put(values, "u1") for values in levels],
    }


def _steps(shapes: Array, amplitudes: Array, largest: float) -> Array:
    """Steps, (r,), to which entries of shapes, (r, n, 3), are rounded: no finer than the largest deformation asks."""
    finest = abs(shapes).max(axis=(1, 2)) / np.iinfo(np.int16).max
    enough = _ROUNDED * largest / np.maximum(abs(amplitudes).max(axis=0), 1e-300)
    steps: Array = np.maximum(np.maximum(finest, enough), 1e-300)
    return steps


def _packed_shape(shape: RigidShape, middle: Array, blob: _Blob) -> JSON:
    """A rigid surface or body for the page."""
    triangles, nodes = split_at_edges(shape.points, shape.triangles)
    kept = slice(None) if shape.moves else slice(1)  # one frame of what stays in its place
    return {
        "name": shape.name,
        "points": blob.put(shape.points[nodes], "f4"),
        "triangles": blob.put(triangles, "u4"),
        "place": blob.put(shape.place[kept] - middle, "f4"),
        "turn": blob.put(shape.turn[kept], "f4"),
    }


def few_shapes(frames: Array, tolerance: float = _TOLERANCE) -> tuple[Array, Array]:
    """Fewest shapes, (r, n, 3), and amplitudes, (m, r), whose products are frames, (m, n, 3), up to a tolerance.

    Parameters
    ----------
    frames : (m, n, 3) array
    tolerance : float
        Largest error of an entry, relative to the largest entry.

    Notes
    -----
    Singular vectors of the frames, from the eigenvectors of their products with each other, since m is small.
    """
    flat = frames.reshape(len(frames), -1)
    most = float(abs(flat).max(initial=0.0))
    energies, vectors = np.linalg.eigh(flat @ flat.T)
    order = np.flatnonzero(energies > 1e-14 * max(energies.max(initial=0.0), 1e-300))[::-1]
    left, count = flat.copy(), 0
    shapes = vectors.T @ flat
    for number in order:
        if abs(left).max() <= tolerance * most:
            break
        left -= np.outer(vectors[:, number], shapes[number])
        count += 1
    kept = order[: max(count, 1)] if len(order) else np.zeros(1, dtype=int)
    return shapes[kept].reshape(-1, *frames.shape[1:]), vectors[:, kept]


def split_at_edges(points: Array, triangles: Array) -> tuple[Array, Array]:
    """Triangles, (k, 3) int, of vertices that neighbours across an edge do not share, and the node of each vertex."""
    a, b, c = points[triangles].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    count = len(triangles)
    sides = np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    of = np.tile(np.arange(count), 3)
    order = np.lexsort(sides.T)
    sides, of = sides[order], of[order]
    same = np.flatnonzero((sides[1:] == sides[:-1]).all(axis=1))
    one, other, ends = of[same], of[same + 1], sides[same]
    smooth = np.einsum("ij,ij->i", normals[one], normals[other]) > _CREASE
    one, other, ends = one[smooth], other[smooth], ends[smooth]

    def corners(face: Array, node: Array) -> Array:
        """Numbers, 3 face + corner, of nodes in faces."""
        numbers: Array = 3 * face + np.argmax(triangles[face] == node[:, None], axis=1)
        return numbers

    row, column = (np.concatenate([corners(face, ends[:, k]) for k in (0, 1)]) for face in (one, other))
    joined = sp.coo_matrix((np.ones(len(row)), (row, column)), shape=(3 * count, 3 * count))
    vertices, vertex = connected_components(joined, directed=False)
    nodes = np.zeros(vertices, dtype=np.int64)
    nodes[vertex] = triangles.ravel()
    return vertex.reshape(-1, 3), nodes
