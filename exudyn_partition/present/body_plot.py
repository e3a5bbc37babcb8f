"""Pictures of bodies by matplotlib alone: what a partition selects, and a run's bodies at one time.

Triangles are drawn from back to front, in the view of `direction`, without perspective. Large ones are split before,
for the middle of a large triangle does not tell what it hides. Colours and light change within a triangle, so that
round bodies look round.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..exudyn_contacts.run_result import RunResult as Result
from ..fe.facets import by_shape, flat_triangles
from ..fe.model import FEModel
from ..fe.partition import Partition
from ..support.arrays import Array
from ..support.checks import validate_choice, validate_flag, validate_positive, validate_type, validate_vector
from ..support.foreign import Axes
from ..support.optional import require
from .body_fields import Shown
from .graphics import peak_time, time_of, validate_scale
from .motion import COLOUR_NAMES, LABELS, Colour, motion_of, pressing_at
from .plot_input import axes_of, check_samples, plain
from .scene import colour_map, split_at_edges

_STEEL, _RIGID = (0.87, 0.89, 0.91), (0.6, 0.6, 0.63)
_LIGHT = np.array([0.3, 0.45, 0.84])  # towards the lamp: to the right, upwards, to the viewer
_DARKEST = 0.55  # brightness of what the lamp does not reach
_VIEW = (1.0, -1.6, 0.8)
_PIECES = 50  # all that is drawn is at least so many times as long as a piece of a triangle
_SEAM = 0.5  # pt: lines of a triangle's own colour cover the seam to its neighbours
_SHINING = 0.25  # opacity of signs that bodies hide, of each of their sides
_RING, _RING_COLOUR = 13.0, "#0072d6"  # pt: circles around contacts that press, in a colour that no map has
_ARROWS = 34.0, 20.0  # pt: place of the arrows along the axes of space, from the corner, and their length
_LARGEST, _LEAST, _AROUND = (6.0, 4.6), (2.4, 2.0), (1.6, 1.0)  # inches: of what is drawn, and of what is around it


def selection(fem: FEModel, partition: Partition, *, axes: Axes = None, direction: Sequence[float] = _VIEW) -> Axes:
    """Draw what a partition selects on the surface of a body, before anything is reduced.

    Parameters
    ----------
    fem : FEModel
    partition : Partition
        Its patches, interfaces and loads are drawn in colours, with names and numbers of nodes.
    axes : matplotlib.axes.Axes, optional
        Default: those of a new figure.
    direction : (3,)
        Where the viewer is, seen from the body.

    Returns
    -------
    matplotlib.axes.Axes
        In mm.

    Raises
    ------
    InputError
        If an argument has a wrong type, or the partition is of another mesh.

    Examples
    --------
    >>> ep.plot.selection(fem, partition).figure.savefig("selection.png")
    """
    validate_type("fem", fem, FEModel, "fe_model()")
    validate_type("partition", partition, Partition, "Partition.ball(), surface(), interface() or load()")
    partition.check_mesh(fem)
    own, axes, turn = axes is None, axes_of(axes), _turn(direction)
    facets = fem.facets
    colours = np.tile(_STEEL, (len(facets), 1))
    handles = []
    patch_of = require("matplotlib.patches").Patch
    for number, (label, nodes, of_facets) in enumerate(_selected(partition)):
        colour = require("matplotlib.colors").to_rgb(f"C{number % 10}")
        chosen = _rows_in(facets, of_facets) if of_facets is not None else np.isin(facets, nodes).all(axis=1)
        colours[chosen] = colour
        handles.append(patch_of(facecolor=colour, label=label))
        if not chosen.any():  # nodes of a line, or inside
            axes.plot(*(1e3 * fem.points[nodes] @ turn[:, :2]).T, ".", color=colour, markersize=3, zorder=3)
    triangles, owner = flat_triangles(facets)
    _draw(axes, [_lit(fem.points, triangles, np.repeat(colours[owner][:, None], 3, axis=1), turn)])
    axes.legend(handles=handles, fontsize="small", loc="upper left")  # the best place is sought for seconds
    return _finish(axes, own, turn)


def bodies(
    result: Result,
    time: float | None = None,
    bodies: Sequence[Shown] | None = None,
    *,
    axes: Axes = None,
    colour: Colour = "speed",
    end: float | None = None,
    scale: float | None = None,
    direction: Sequence[float] = _VIEW,
    signs: bool = True,
) -> Axes:
    """Draw a run's bodies at the sample nearest to a time.

    Parameters
    ----------
    result : Result
    time : float, optional
        [s]. Default: that of the largest contact force; without contacts the last one.
    bodies : sequence of PartitionBody or (PartitionBody, FEModel), optional
        Default: all. With its FE model a body also shows the static answer to the contacts' forces.
    axes : matplotlib.axes.Axes, optional
        Default: those of a new figure.
    colour : {"speed", "deformation", "von_mises", "contact_pressure"}
        "von_mises" needs the FE models.
    end : float, optional
        Value at the upper end of the colours [m/s, m, Pa]. Default: what 99.5 % of the area stay below, and more.
    scale : float, optional
        Factor on the deformation. Default: the power of ten that makes it visible.
    direction : (3,)
        Where the viewer is, seen from the bodies.
    signs : bool
        Whether small signs show joints, springs, drives, loads, ground and gravity. Within bodies they shine through.

    Returns
    -------
    matplotlib.axes.Axes
        In mm, with a colour bar beside it, and circles around the contacts that press.

    Raises
    ------
    InputError
        If an argument has a wrong type or is out of range, or the time is not within the run.
    """
    check_samples(result)
    signs = validate_flag("signs", signs)
    own, axes, turn = axes is None, axes_of(axes), _turn(direction)
    at = peak_time(result) if time is None else time_of(result, time)
    validate_choice("colour", colour, COLOUR_NAMES)
    motion = motion_of(result, bodies, colours=[colour], frames=[at])
    scale = motion.visible_scale if scale is None else validate_scale(scale)
    label, unit, many = LABELS[colour]
    top = many * (motion.end_of(colour) if end is None else validate_positive("end", end))
    norm = require("matplotlib.colors").Normalize(0.0, top)
    shades = require("matplotlib.cm").ScalarMappable(norm, colour_map())
    drawn = []
    for body in motion.bodies:
        shown = shades.to_rgba(many * body.colours[colour][0])[:, :3][body.triangles]
        drawn.append(_lit(body.at(0, scale), body.triangles, shown, turn))
    for shape in motion.rigid:
        drawn.append(_lit(shape.at(0), shape.triangles, np.tile(_RIGID, (len(shape.triangles), 3, 1)), turn))
    of_signs = [
        _lit(sign.at(0), sign.triangles, np.tile(sign.rgb, (len(sign.triangles), 3, 1)), turn)
        for sign in motion.signs * signs
    ]
    _draw(axes, [*drawn, *of_signs])
    if of_signs:
        _draw(axes, of_signs, _SHINING)
    axes.figure.colorbar(shades, ax=axes, label=plain(f"{label} [{unit}]"), extend="max", shrink=0.8)
    pressing = pressing_at(result, at, scale)
    for place, _ in pressing:
        axes.plot(*(1e3 * place @ turn)[:2], "o", mfc="none", mec=_RING_COLOUR, ms=_RING, mew=1.8, zorder=3)
    said = [f"t = {1e3 * motion.t[0]:.4g} ms"]
    if pressing:
        which = "circle: contact force" if len(pressing) == 1 else "circles: contact forces, up to"
        most = max(force for _, force in pressing)
        said.append(f"{which} {1e-3 * most:.3g} kN" if most >= 1e4 else f"{which} {most:.4g} N")
    elif result.contacts:
        said.append("no contact presses now")
    if scale != 1:
        said.append(f"deformed x {scale:g}: bodies may seem to overlap")
    axes.set_title("\n".join(said), fontsize="small")
    return _finish(axes, own, turn)


def _selected(partition: Partition) -> list[tuple[str, Array, Array | None]]:
    """Label, nodes and facets (if known) of each patch, interface and load."""
    found: list[tuple[str, Array, Array | None]] = []
    for number, patch in enumerate(partition.patches):
        name = f" {patch.name!r}" if patch.name else ""
        found.append((f"patch {number}{name}: {len(patch.nodes)} nodes", patch.nodes, patch.facets))
    for kind, items in (("interface", partition.interfaces), ("load", partition.loads)):
        found += [(f"{kind} {item.name!r}: {len(item.nodes)} nodes", item.nodes, None) for item in items]
    return [(plain(label), nodes, facets) for label, nodes, facets in found]


def _rows_in(facets: Array, some: Array) -> Array:
    """Which of the facets are among `some`, (nf,) bool."""
    known = {row.tobytes() for row in np.sort(some, axis=1).astype(np.int64)}
    found = np.zeros(len(facets), dtype=bool)
    for rows, columns in by_shape(facets):
        if len(columns) == some.shape[1]:
            own = np.sort(facets[rows][:, columns], axis=1).astype(np.int64)
            found[rows] = [row.tobytes() in known for row in own]
    return found


def _turn(direction: Sequence[float]) -> Array:
    """Directions to the right, upwards and towards the viewer, as columns, (3, 3)."""
    towards = validate_vector("direction", direction)
    if not towards.any():
        raise InputError("direction: expected where the viewer is, seen from the bodies, got zeros")
    towards = towards / np.linalg.norm(towards)
    right = np.cross((0, 0, 1) if np.hypot(*towards[:2]) > 1e-6 else (0, 1, 0), towards)
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(towards, right), towards])


def _lit(points: Array, triangles: Array, colours: Array, turn: Array) -> Array:
    """What is drawn of a surface: places [mm], normals and colours of the corners of its triangles, (k, 3, 9).

    `points` are in space, (n, 3) [m], `colours` of each corner, (k, 3, 3). Places and normals are along the directions
    of `_turn`.
    """
    split, nodes = split_at_edges(points, triangles)
    a, b, c = points[triangles].swapaxes(0, 1)
    across = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    normals: Array = np.column_stack([np.bincount(split.ravel(), along, minlength=len(nodes)) for along in across.T])
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    return np.concatenate([1e3 * points[triangles] @ turn, normals[split] @ turn, colours], axis=2)


def _draw(axes: Axes, surfaces: Sequence[Array], opacity: float = 1.0) -> None:
    """Draw triangles, (k, 3, 9) each, see `_lit`, from back to front."""
    corners = np.concatenate(surfaces)
    pieces = _split(corners, float(np.ptp(corners[..., :3], axis=(0, 1)).max()) / _PIECES)
    middles = pieces.mean(axis=1)
    pieces, middles = (values[np.argsort(middles[:, 2])] for values in (pieces, middles))
    normals = middles[:, 3:6] * np.where(middles[:, [5]] < 0, -1.0, 1.0)  # of sheets, both sides are seen
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    bright = _DARKEST + (1 - _DARKEST) * np.maximum(normals @ _LIGHT, 0.0)
    shown = np.clip(middles[:, 6:] * bright[:, None], 0, 1)
    edges = _SEAM if opacity == 1 else 0.0
    polygons = require("matplotlib.collections").PolyCollection(
        pieces[:, :, :2], facecolors=shown, edgecolors=shown, linewidths=edges, antialiased=False, alpha=opacity
    )  # smooth edges would let through what lies behind
    axes.add_collection(polygons)
    axes.autoscale_view()


def _split(corners: Array, longest: float) -> Array:
    """Halve triangles, (k, 3, m), until no edge is longer in the first three of their m entries: (n, 3, m)."""
    done = []
    while len(corners):
        edges = np.linalg.norm((np.roll(corners, -1, axis=1) - corners)[..., :3], axis=2)
        large = edges.max(axis=1) > longest
        done.append(corners[~large])
        first = edges[large].argmax(axis=1)[:, None] + np.arange(3)  # the corners from the longest edge on
        a, b, c = np.take_along_axis(corners[large], first[..., None] % 3, axis=1).swapaxes(0, 1)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)


def _axis_along(way: Array) -> str:
    """Name of the axis of space along a unit vector, (3,), with its sign; empty if there is none."""
    most = int(abs(way).argmax())
    return "-" * bool(way[most] < 0) + "xyz"[most] if abs(way[most]) > 1 - 1e-9 else ""


def _finish(axes: Axes, own: bool, turn: Array) -> Axes:
    """Name the axes, and show those of space; a figure of our `own` gets the shape of what is drawn."""
    axes.set_aspect("equal", adjustable="datalim" if own else None)  # slender bodies leave room at their sides
    names = [_axis_along(way) for way in turn[:, :2].T]
    axes.set_xlabel(f"{names[0] or 'across the picture'} [mm]")
    axes.set_ylabel(f"{names[1] or 'up the picture'} [mm]")
    if not all(names):
        start, length = _ARROWS
        style = {"arrowstyle": "-|>", "color": "0.25", "shrinkA": 0, "shrinkB": 0}
        for name, way in zip("xyz", length * turn[:, :2], strict=True):
            ends = {"xy": tuple(start + way), "xytext": (start, start), "xycoords": "axes points"}
            axes.annotate("", **ends, textcoords="axes points", arrowprops=style, zorder=4)
            if np.linalg.norm(way) > length / 4:
                at = tuple(start + way * (1 + 7 / np.linalg.norm(way)))
                axes.annotate(name, at, xycoords="axes points", ha="center", va="center", fontsize="small", zorder=4)
    if own:
        wide, high = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
        inches = np.minimum(np.array([wide, high]) * min(_LARGEST[0] / wide, _LARGEST[1] / high), _LARGEST)
        axes.figure.set_size_inches(np.maximum(inches, _LEAST) + _AROUND)
        axes.figure.set_layout_engine("compressed")
    return axes
