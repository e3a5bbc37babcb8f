"""Figures of a contact patch at one time: pressure, and where rows stick and slip."""

from __future__ import annotations

import numpy as np

from ..algebra.friction import SLIP, STICK
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.run_result import RunResult as Result
from ..fe.facets import facet_corners, flat_triangles
from ..support.arrays import Array
from ..support.foreign import Axes
from .graphics import time_of
from .plot_input import axes_of, contact_of, name_of, plain

_STATES = {STICK: ("sticks", "C0", "o"), SLIP: ("slips", "C3", "^")}
_LONGEST = 0.12  # of the axes' width: the arrow beside the scale


def pressure(axes: Axes, result: Result, time: float | None = None, *, contact: PartitionContact | None = None) -> Axes:
    """Contact pressure [MPa] on the slave's patch [mm] at the sample nearest to a time.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    result : Result
    time : float, optional
        Time of the pressure [s]. Default: that of the contact's largest force.
    contact : PartitionContact, optional
        Of a Result with several.

    Returns
    -------
    matplotlib.axes.Axes
        A colour bar stands beside the axes.

    Raises
    ------
    InputError
        If an argument has a wrong type, or the time is not within the run.
    """
    axes, contact = axes_of(axes), contact_of(result, contact)
    sample = _sample(result, time, contact)
    item, number = contact.sides[0]
    patch = item.body.partition.patches[number]
    x = 1e3 * item.body.points[patch.nodes] @ _across(patch.direction)
    values = 1e-6 * contact.pressure(sample).toarray()[0, : len(patch.nodes)]
    facets = np.searchsorted(patch.nodes, patch.facets)
    triangles = flat_triangles(facet_corners(facets))[0]
    drawn = axes.tripcolor(*x.T, triangles, values, shading="gouraud", cmap="viridis")
    axes.figure.colorbar(drawn, ax=axes, label="contact pressure [MPa]")
    return _finish(axes, contact, sample)


def stick(axes: Axes, result: Result, time: float | None = None, *, contact: PartitionContact | None = None) -> Axes:
    """Closed rows of the slave's patch [mm] that stick and that slip, with arrows of the tangential forces on them.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    result : Result
    time : float, optional
        [s]; the sample nearest to it is drawn. Default: that of the contact's largest force.
    contact : PartitionContact, optional
        Of a Result with several.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If an argument has a wrong type, the time is not within the run, or the contact is frictionless.
    """
    axes, contact = axes_of(axes), contact_of(result, contact)
    sample = _sample(result, time, contact)
    state, forces = contact.friction.states(sample)[0], contact.friction.row_forces(sample)[0]
    item, number = contact.sides[0]
    patch = item.body.partition.patches[number]
    across = _across(patch.direction)
    turn = item.kinematics.frame(item.coordinates(sample)[0])[1]
    x, arrows = 1e3 * item.body.points[patch.nodes] @ across, forces @ turn @ across
    for kind, (label, color, marker) in _STATES.items():
        rows = state == kind
        axes.scatter(*x[rows].T, s=14, color=color, marker=marker, label=f"{label} ({np.count_nonzero(rows)} rows)")
    closed = state > 0
    axes.margins(0.1, 0.3)  # room for the legend above, and the length of the arrows below
    if arrows[closed].any():
        longest = float(f"{np.linalg.norm(arrows[closed], axis=1).max():.1g}")
        style = {"scale": longest / _LONGEST, "scale_units": "width", "color": "0.35", "width": 0.004, "zorder": 0}
        drawn = axes.quiver(*x[closed].T, *arrows[closed].T, **style)
        tip = 0.04 + _LONGEST
        axes.quiverkey(drawn, tip, 0.05, longest, f"{longest:g} N", labelpos="E", coordinates="axes")
    axes.legend(fontsize="small", loc="upper left")
    return _finish(axes, contact, sample)


def _sample(result: Result, time: float | None, contact: PartitionContact) -> Result:
    """Sample nearest to a time [s]; for None, that of the contact's largest force."""
    peak = float(result.t[contact.force(result).argmax()])
    return result.at([peak if time is None else time_of(result, time)])


def _across(direction: Array) -> Array:
    """Unit vectors to the right and upwards for who looks at a patch from outside the body, as columns, (3, 2)."""
    upwards = (0, 1, 0) if abs(direction[2]) > 0.9 else (0, 0, 1)
    right = np.cross(upwards, direction)
    right = right / np.linalg.norm(right)
    return np.column_stack([right, np.cross(direction, right)])


def _axis_near(way: Array) -> str:
    """Name of the body's axis along a unit vector within 2.5 degrees, with its sign; empty if there is none."""
    most = int(abs(way).argmax())
    return "-" * bool(way[most] < 0) + "xyz"[most] if abs(way[most]) > 0.999 else ""


def _finish(axes: Axes, contact: PartitionContact, sample: Result) -> Axes:
    axes.set_aspect("equal")
    axes.set_title(f"t = {1e3 * sample.t[0]:.4g} ms", fontsize="medium")
    item, number = contact.sides[0]
    ways, body = _across(item.body.partition.patches[number].direction).T, plain(name_of(item, "the slave"))
    axes.set_xlabel(f"{_axis_near(ways[0]) or 'across the patch'} of {body} [mm]")
    axes.set_ylabel(f"{_axis_near(ways[1]) or 'up the patch'} of {body} [mm]")
    return axes
