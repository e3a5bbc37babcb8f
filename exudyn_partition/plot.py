"""Figures of runs; every function draws on given axes, or on those of a new figure, and returns them.

A run is a `History`, or a `Result` itself, of which `contact` and `body` say what is meant where there are several.
Curves differ in dashes too, so that they can be told apart in print without colour.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ._checks import validate_choice
from ._optional import require
from .body import ReducedBody
from .contact_items import PartitionContact
from .errors import InputError
from .history import History
from .partition_body import PartitionBody
from .report import Comparison, front
from .spectrum import amplitude_spectrum

if TYPE_CHECKING:
    from .result import Result

Array = np.ndarray

_REFERENCE_STYLE = {"color": "0.6", "linewidth": 3.0}
_RUN_STYLE = {"color": "C3", "linewidth": 1.0}
_DASHES = ("-", "--", "-.", ":")
_MARKERS = "os^Dv<>p"
_SIZE = (6.0, 3.4)  # inches: a column and a half
_MOST_SAMPLES = 2**20  # of a history that is resampled for its spectrum
_PREFIXES = {1e9: "G", 1e6: "M", 1e3: "k", 1.0: "", 1e-3: "m", 1e-6: "µ", 1e-9: "n"}


def force(
    axes: Any, run: History | Result, reference: History | None = None, *, contact: PartitionContact | None = None
) -> Any:
    """Total contact force [N] over time [ms], the run over its reference.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    run : History or Result
    reference : History, optional
    contact : PartitionContact, optional
        Of a Result with several.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If a Result has no contact, or several and none is named.
    """
    axes = _axes(axes)
    for history, style in _layers(_history(run, contact), reference):
        axes.plot(1e3 * history.t, history.force, label=history.info.get("label"), **style)
    return _finish(axes, "contact force [N]")


def velocity(
    axes: Any,
    point: str | Sequence[float] | Array,
    run: History | Result,
    reference: History | None = None,
    *,
    axis: int = 2,
    body: PartitionBody | None = None,
) -> Any:
    """Velocity of a point along one axis [m/s] over time [ms], the run over its reference.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    point : str or (3,) array
        Name in `History.velocity`; of a Result, a point of `body` in its own coordinates [m].
    run : History or Result
    reference : History, optional
    axis : {0, 1, 2}
    body : PartitionBody, optional
        Of a Result with several.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If there is no such point or body.
    """
    axes, name = _axes(axes), _point_name(point)
    for history, style in _layers(_history_of_point(run, point, body), reference):
        axes.plot(1e3 * history.t, _velocity(history, name)[:, axis], label=history.info.get("label"), **style)
    return _finish(axes, f"velocity of {name} along {'xyz'[axis]} [m/s]")


def spectrum(
    axes: Any,
    run: History | Result,
    point: str | Sequence[float] | Array | None = None,
    *,
    axis: int = 2,
    contact: PartitionContact | None = None,
    body: PartitionBody | None = None,
    f_cut: float | None = None,
) -> Any:
    """Amplitude spectrum of the contact force [N s], or of the velocity of a point [m], over frequency [kHz].

    It is the magnitude of the Fourier integral, see `spectrum.amplitude_spectrum`; the velocity is faded out at both
    ends. Samples of an adaptive run are interpolated.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    run : History or Result
    point, axis, body :
        As for `velocity`; default: the force.
    contact : PartitionContact, optional
        Of a Result with several.
    f_cut : float, optional
        Truncation frequency [Hz], drawn as a line. Default: the highest of a Result's bodies.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        As `force` and `velocity`.
    """
    axes = _axes(axes)
    history = _history(run, contact) if point is None else _history_of_point(run, point, body)
    if point is None:
        x, label = history.force, "spectrum of the contact force [N s]"
    else:
        name = _point_name(point)
        x, label = _velocity(history, name)[:, axis], f"spectrum of the velocity of {name} [m]"
    t = np.linspace(history.t[0], history.t[-1], _equal_samples(history.t))
    x = np.interp(t, history.t, x)
    f, amplitude = amplitude_spectrum(t, x, window="none" if point is None else "hann")
    axes.semilogy(1e-3 * f, amplitude, label=history.info.get("label"), **_RUN_STYLE)
    if f_cut is None and not isinstance(run, History):
        f_cut = max((item.body.f_cut for item in run.bodies), default=None)
    if f_cut is not None:
        axes.axvline(1e-3 * f_cut, color="k", linestyle="--", linewidth=0.8, label="f_cut")
    shown = f <= (2 * f_cut if f_cut else f[-1])
    axes.set_xlim(0, 1e-3 * f[shown][-1])
    axes.set_ylim(1e-5 * amplitude.max(), 2 * amplitude.max())
    return _finish(axes, label, "frequency [kHz]")


def energy(
    axes: Any,
    result: Result,
    *,
    bodies: Sequence[PartitionBody] | None = None,
    contacts: Sequence[PartitionContact] | None = None,
) -> Any:
    """Energy of bodies, kinetic and strain, in contacts, what damping has taken, and their sum over time [ms].

    The sum is constant as far as nothing else in the model does work on the bodies.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    result : Result
    bodies, contacts : sequences, optional
        Default: all of the run.

    Returns
    -------
    matplotlib.axes.Axes
    """
    axes = _axes(axes)
    bodies = result.bodies if bodies is None else bodies
    contacts = result.contacts if contacts is None else contacts
    curves = {_name(item, f"body {i}"): item.energy(result) for i, item in enumerate(bodies)}
    curves |= {_name(item, f"contact {i}"): item.energy(result) for i, item in enumerate(contacts)}
    damped = np.sum([item.dissipated_energy(result) for item in bodies], axis=0)
    if np.any(damped):
        curves["taken by damping"] = damped
    curves["sum"] = np.sum(list(curves.values()), axis=0)
    scale, prefix = _prefix(max(abs(curve).max() for curve in curves.values()))
    for i, (label, curve) in enumerate(curves.items()):
        style = {"color": "k", "linewidth": 0.8} if label == "sum" else {"linestyle": _DASHES[i % len(_DASHES)]}
        axes.plot(1e3 * result.t, curve / scale, label=label, **style)
    return _finish(axes, f"energy [{prefix}J]")


def pressure(axes: Any, result: Result, time: float, *, contact: PartitionContact | None = None) -> Any:
    """Contact pressure [MPa] on the slave's patch [mm] at the sample nearest to a time.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    result : Result
    time : float
        [s]
    contact : PartitionContact, optional
        Of a Result with several.

    Returns
    -------
    matplotlib.axes.Axes
        A colour bar stands beside them.

    Raises
    ------
    InputError
        If the time is not within the run.
    """
    axes, contact = _axes(axes), _contact(result, contact)
    sample = result.at([time])
    item, number = contact.sides[0]
    patch = item.body.partition.patches[number]
    x = 1e3 * item.body.points[patch.nodes] @ np.linalg.svd(patch.direction[None])[2][1:].T
    values = 1e-6 * contact.pressure(sample).toarray()[0, : len(patch.nodes)]
    facets = np.searchsorted(patch.nodes, patch.facets)
    if facets.shape[1] == 4:
        facets = np.vstack([facets[:, [0, 1, 2]], facets[:, [0, 2, 3]]])
    drawn = axes.tripcolor(*x.T, facets[:, :3], values, shading="gouraud", cmap="viridis")
    axes.figure.colorbar(drawn, ax=axes, label="contact pressure [MPa]")
    axes.set_aspect("equal")
    axes.set_title(f"t = {1e3 * sample.t[0]:.4g} ms", fontsize="medium")
    axes.set_xlabel(f"across the patch of {_name(item, 'the slave')} [mm]")
    axes.set_ylabel("across the patch [mm]")
    return axes


def modes(axes: Any, body: ReducedBody | PartitionBody) -> Any:
    """Frequencies [kHz] of a body's shapes by their number, each kind with its own marker, and its f_cut.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    body : ReducedBody or PartitionBody

    Returns
    -------
    matplotlib.axes.Axes
    """
    axes = _axes(axes)
    body = body.body if isinstance(body, PartitionBody) else body
    frequency = 1e-3 * body.basis.omega / (2 * np.pi)
    kinds = np.array(
        ["rigid" if f == 0 else label.rsplit(" ", 2)[0] for f, label in zip(frequency, body.basis.labels, strict=True)]
    )
    for i, kind in enumerate(dict.fromkeys(kinds)):
        own = np.flatnonzero(kinds == kind)
        axes.plot(own, frequency[own], _MARKERS[i % len(_MARKERS)], markersize=4, label=f"{kind}: {len(own)}")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.axhline(1e-3 * body.f_cut, color="k", linestyle="--", linewidth=0.8, label="f_cut")
    return _finish(axes, "frequency [kHz]", "number of the shape")


def pareto(
    axes: Any, runs: Mapping[str, Comparison] | Iterable[tuple[str, Comparison]], quantity: str = "force"
) -> Any:
    """Relative error [%] over run time [s] of several runs against their reference; a line joins those not dominated.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    runs : mapping of str to Comparison
        Label and comparison of each run.
    quantity : str
        Whose error: "force" or the name of a point.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If there are no runs, or one has no such error.
    """
    axes, runs = _axes(axes), dict(runs)
    if not runs:
        raise InputError("runs: expected at least one comparison, got none")
    for run in runs.values():
        validate_choice("quantity", quantity, run.error)
    line = [(runs[label].time_s, 100 * runs[label].error[quantity]) for label in front(runs, quantity)]
    axes.loglog(*zip(*line, strict=True), "-", color="0.6", linewidth=1.0, zorder=1)
    points = sorted((run.time_s, 100 * run.error[quantity], label) for label, run in runs.items())
    for i, (x, y, label) in enumerate(points):
        axes.loglog(x, y, _MARKERS[i % len(_MARKERS)], label=label)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:g}")
    reference = max(run.reference_time_s for run in runs.values())
    if math.isfinite(reference):
        axes.axvline(reference, color="k", linestyle="--", linewidth=0.8, label="reference")
    return _finish(
        axes, f"error of {'the force' if quantity == 'force' else 'the velocity of ' + quantity} [%]", "run time [s]"
    )


def overview(
    run: History | Result, reference: History | None = None, *, contact: PartitionContact | None = None
) -> Any:
    """Contact force and the velocities of all named points, one below the other.

    Parameters
    ----------
    run : History or Result
    reference : History, optional
    contact : PartitionContact, optional
        Of a Result with several.

    Returns
    -------
    matplotlib.figure.Figure
    """
    run = _history(run, contact)
    figure_class = require("matplotlib.figure").Figure
    figure = figure_class(figsize=(8.0, 2.6 * (1 + len(run.velocity))), layout="constrained")
    panels = figure.subplots(1 + len(run.velocity), 1, sharex=True, squeeze=False)[:, 0]
    force(panels[0], run, reference)
    for axes, point in zip(panels[1:], run.velocity, strict=True):
        velocity(axes, point, run, reference)
    for axes in panels[:-1]:
        axes.set_xlabel("")
    return figure


def _axes(axes: Any) -> Any:
    """Return the axes, or those of a new figure for None."""
    if axes is None:
        return require("matplotlib.figure").Figure(figsize=_SIZE, layout="constrained").subplots()
    if not hasattr(axes, "plot"):
        raise InputError(f"axes: expected those of matplotlib, or None for a new figure, got {type(axes).__name__}")
    return axes


def _contact(result: Result, contact: PartitionContact | None) -> PartitionContact:
    if contact is not None:
        return contact
    if len(result.contacts) != 1:
        names = ", ".join(repr(c.name) for c in result.contacts)
        raise InputError(f"contact: expected one of the run's {len(result.contacts)} contacts ({names}), got none")
    return result.contacts[0]


def _history(run: History | Result, contact: PartitionContact | None) -> History:
    return run if isinstance(run, History) else run.history(_contact(run, contact))


def _history_of_point(run: History | Result, point: Any, body: PartitionBody | None) -> History:
    """History with the velocity of a point, by its name."""
    if isinstance(run, History):
        return run
    if isinstance(point, str):
        raise InputError(f"point: a Result has no named points; give a point of a body, (3,) [m], instead of {point!r}")
    if body is None:
        if len(run.bodies) != 1:
            names = ", ".join(repr(item.name) for item in run.bodies)
            raise InputError(f"body: expected one of the run's {len(run.bodies)} bodies ({names}), got none")
        body = run.bodies[0]
    return History(run.t, np.zeros(len(run.t)), {_point_name(point): body.velocity(run, point)}, {"label": body.name})


def _point_name(point: Any) -> str:
    return point if isinstance(point, str) else "(" + ", ".join(f"{1e3 * x:.4g}" for x in point) + ") mm"


def _velocity(history: History, name: str) -> Array:
    validate_choice("point", name, history.velocity)
    return history.velocity[name]


def _name(item: Any, otherwise: str) -> str:
    return item.name or otherwise


def _equal_samples(t: Array) -> int:
    step = np.diff(t)
    if np.ptp(step) <= 1e-3 * step.mean():
        return len(t)
    return min(math.ceil((t[-1] - t[0]) / step.min()) + 1, _MOST_SAMPLES)


def _prefix(largest: float) -> tuple[float, str]:
    """Factor and name of the unit's multiple in which the largest of some values is 1 to 1000."""
    return next(((scale, name) for scale, name in _PREFIXES.items() if largest >= scale), (1.0, ""))


def _layers(run: History, reference: History | None) -> list[tuple[History, dict[str, Any]]]:
    below = [] if reference is None else [(reference.until(float(run.t[-1])), _REFERENCE_STYLE)]
    return [*below, (run, _RUN_STYLE)]


def _finish(axes: Any, label: str, x_label: str = "time [ms]") -> Any:
    axes.set_xlabel(x_label)
    axes.set_ylabel(label)
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[1]:
        axes.legend()
    return axes
