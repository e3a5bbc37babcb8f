"""Pictures of bodies by matplotlib alone: what a partition selects, and a run's bodies at one time.

Triangles are drawn from back to front, in the view of `direction`, without perspective. Large ones are split before,
for the middle of a large triangle does not tell what it hides.
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
from ..support.checks import validate_choice, validate_positive, validate_type, validate_vector
from ..support.foreign import Axes
from ..support.optional import require
from .body_fields import Shown
from .graphics import peak_time, time_of, validate_scale
from .motion import COLOUR_NAMES, LABELS, Colour, motion_of
from .plot_input import axes_of, check_samples, plain
from .scene import colour_map

_STEEL, _RIGID = (0.87, 0.89, 0.91), (0.6, 0.6, 0.63)
_LIGHT = np.array([0.3, 0.45, 0.84])  # towards the lamp: to the right, upwards, to the viewer
_DARKEST = 0.55  # brightness of what the lamp does not reach
_VIEW = (1.0, -1.6, 0.8)
_PIECES = 50  # all that is drawn is at least so many times as long as a piece of a triangle
_SEAM = 0.5  # pt: lines of a triangle's own colour cover the seam to its neighbours
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
    _draw(axes, [(1e3 * fem.points[triangles] @ turn, colours[owner])])
    axes.legend(handles=handles, fontsize="small", loc="upper left")  # the best place is sought for seconds
    return _finish(axes, own)


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

    Returns
    -------
    matplotlib.axes.Axes
        In mm, with a colour bar beside it.

    Raises
    ------
    InputError
        If an argument has a wrong type or is out of range, or the time is not within the run.
    """
    check_samples(result)
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
        values = many * body.colours[colour][0][body.triangles].mean(axis=1)
        drawn.append((1e3 * body.at(0, scale)[body.triangles] @ turn, shades.to_rgba(values)[:, :3]))
    for shape in motion.rigid:
        corners = shape.at(0)[shape.triangles]
        drawn.append((1e3 * corners @ turn, np.tile(_RIGID, (len(corners), 1))))
    _draw(axes, drawn)
    axes.figure.colorbar(shades, ax=axes, label=plain(f"{label} [{unit}]"), extend="max", shrink=0.8)
    said = "" if scale == 1 else f"\ndeformed x {scale:g}: bodies may seem to overlap"
    axes.set_title(f"t = {1e3 * motion.t[0]:.4g} ms{said}", fontsize="small")
    return _finish(axes, own)


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


def _draw(axes: Axes, surfaces: Sequence[tuple[Array, Array]]) -> None:
    """Draw triangles, (k, 3, 3) along the directions of `_turn`, in colours, (k, 3), from back to front."""
    corners, colours = (np.concatenate(parts) for parts in zip(*surfaces, strict=True))
    a, b, c = corners.swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    bright = _DARKEST + (1 - _DARKEST) * abs(normals @ _LIGHT)
    pieces, owner = _split(corners, float(np.ptp(corners, axis=(0, 1)).max()) / _PIECES)
    order = np.argsort(pieces[:, :, 2].mean(axis=1))
    shown = np.clip(colours * bright[:, None], 0, 1)[owner[order]]
    polygons = require("matplotlib.collections").PolyCollection(
        pieces[order, :, :2], facecolors=shown, edgecolors=shown, linewidths=_SEAM, antialiased=False
    )  # smooth edges would let through what lies behind
    axes.add_collection(polygons)
    axes.autoscale_view()


def _split(corners: Array, longest: float) -> tuple[Array, Array]:
    """Halve triangles, (k, 3, 3), until no edge is longer; returns the pieces, (n, 3, 3), and whose they are, (n,)."""
    owner, done = np.arange(len(corners)), []
    while len(corners):
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        large = edges.max(axis=1) > longest
        done.append((corners[~large], owner[~large]))
        first = edges[large].argmax(axis=1)[:, None] + np.arange(3)  # the corners from the longest edge on
        a, b, c = np.take_along_axis(corners[large], first[..., None] % 3, axis=1).swapaxes(0, 1)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        owner = np.tile(owner[large], 2)
    return np.concatenate([piece for piece, _ in done]), np.concatenate([number for _, number in done])


def _finish(axes: Axes, own: bool) -> Axes:
    """Label the axes; a figure of our `own` gets the shape of what is drawn."""
    axes.set_aspect("equal", adjustable="datalim" if own else None)  # slender bodies leave room at their sides
    axes.set_xlabel("to the right [mm]")
    axes.set_ylabel("upwards [mm]")
    if own:
        wide, high = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
        inches = np.minimum(np.array([wide, high]) * min(_LARGEST[0] / wide, _LARGEST[1] / high), _LARGEST)
        axes.figure.set_size_inches(np.maximum(inches, _LEAST) + _AROUND)
        axes.figure.set_layout_engine("compressed")
    return axes
