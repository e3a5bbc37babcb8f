"""Figures of runs. Every function draws on given axes, or on those of a new figure, and returns the axes.

A run is a `History` or a `Result`. If a Result has several contacts or bodies, `contact` and `body` say which is meant.
Curves differ in dashes as well as in colour, for prints in black and white.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ..errors import InputError
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.balance import taken_by
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.run_result import RunResult as Result
from ..prediction.spectrum import amplitude_spectrum
from ..reduction.body import ReducedBody
from ..results.compare import Comparison, front, validate_runs
from ..results.history import History
from ..support.arrays import Array, Vector
from ..support.checks import validate_choice, validate_integer, validate_positive, validate_type
from ..support.foreign import Axes, Figure
from ..support.optional import require
from .body_fields import validate_contacts
from .body_plot import bodies, selection
from .patch_plot import pressure, stick
from .plot_input import (
    axes_of,
    check_samples,
    contact_of,
    history_of,
    history_of_point,
    label_of,
    labelled,
    name_of,
    plain,
    validate_bodies,
)

__all__ = [
    "bodies",
    "energy",
    "force",
    "modes",
    "overview",
    "pareto",
    "pressure",
    "selection",
    "spectrum",
    "stick",
    "velocity",
]

_REFERENCE_STYLE = {"color": "0.6", "linewidth": 3.0}
_RUN_STYLE = {"color": "C3", "linewidth": 1.0}
_DASHES = ("-", "--", "-.", ":")
_MARKERS = "os^Dv<>p"
_MOST_SAMPLES = 2**20  # of a history that is resampled for a spectrum
_PREFIXES = {1e9: "G", 1e6: "M", 1e3: "k", 1.0: "", 1e-3: "m", 1e-6: "µ", 1e-9: "n"}


def force(
    axes: Axes, run: History | Result, reference: History | None = None, *, contact: PartitionContact | None = None
) -> Axes:
    """Total contact force [N] over time [ms], drawn over the reference.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    run : History or Result
    reference : History, optional
        Of one contact.
    contact : PartitionContact, optional
        Of a Result with several. Default: all of them, each with a curve of its own.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If an argument has a wrong type, or a Result has no contact, or several contacts and none is named beside a
        reference.
    """
    axes = axes_of(axes)
    if contact is None and reference is None and not isinstance(run, History):
        check_samples(run, "run")
        if len(run.contacts) > 1:
            for i, one in enumerate(run.contacts):
                curve = {"linestyle": _DASHES[i % len(_DASHES)], "linewidth": 1.0}
                axes.plot(1e3 * run.t, one.force(run), label=plain(one.name), **curve)
            return _finish(axes, "contact force [N]")
    for history, style in _layers(history_of(run, contact), reference):
        axes.plot(1e3 * history.t, history.force, label=label_of(history), **style)
    name = "" if isinstance(run, History) else contact_of(run, contact, "run").name
    return _finish(axes, f"contact force of '{plain(name)}' [N]" if name else "contact force [N]")


def velocity(
    axes: Axes,
    point: str | Vector,
    run: History | Result,
    reference: History | None = None,
    *,
    axis: int = 2,
    body: PartitionBody | None = None,
) -> Axes:
    """Velocity of a point along one axis [m/s] over time [ms], drawn over the reference.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    point : str or (3,) array
        For a History, a name in `History.velocity`. For a Result, a point of `body` in its own coordinates [m].
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
        If an argument has a wrong type, or there is no such point or body.
    """
    axes, axis = axes_of(axes), validate_integer("axis", axis, 0, 2)
    shown, name = history_of_point(run, point, body)
    for history, style in _layers(shown, reference):
        axes.plot(1e3 * history.t, _velocity(history, name)[:, axis], label=label_of(history), **style)
    return _finish(axes, f"velocity of {plain(name)} along {'xyz'[axis]} [m/s]")


def spectrum(
    axes: Axes,
    run: History | Result,
    point: str | Vector | None = None,
    *,
    axis: int = 2,
    contact: PartitionContact | None = None,
    body: PartitionBody | None = None,
    f_cut: float | None = None,
) -> Axes:
    """Amplitude spectrum of the contact force [N s], or of the velocity of a point [m], over frequency [kHz].

    It is the magnitude of the Fourier integral, see `spectrum.amplitude_spectrum`. A velocity is faded out at both
    ends. Samples of a run with variable steps are interpolated.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    run : History or Result
    point, axis, body :
        See `velocity`. Default: the spectrum of the force.
    contact : PartitionContact, optional
        Of a Result with several.
    f_cut : float, optional
        Truncation frequency [Hz], drawn as a line. Default: the highest f_cut of a Result's bodies.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        See `force` and `velocity`; also if there are less than three samples, or the signal is constant.
    """
    axes, axis = axes_of(axes), validate_integer("axis", axis, 0, 2)
    if f_cut is not None:
        f_cut = validate_positive("f_cut", f_cut, "Hz")
    if point is None:
        history = history_of(run, contact)
        x, label = history.force, "spectrum of the contact force [N s]"
    else:
        history, name = history_of_point(run, point, body)
        x, label = _velocity(history, name)[:, axis], f"spectrum of the velocity of {plain(name)} [m]"
    if len(history.t) < 3 or np.diff(history.t).min() <= 0 or not np.ptp(x):
        raise InputError("run: expected a signal that changes, with at least three samples at ascending times")
    t = np.linspace(history.t[0], history.t[-1], _equal_samples(history.t))
    x = np.interp(t, history.t, x)
    f, amplitude = amplitude_spectrum(t, x, window="none" if point is None else "hann")
    axes.semilogy(1e-3 * f, amplitude, label=label_of(history), **_RUN_STYLE)
    if f_cut is None and not isinstance(run, History):
        f_cut = max((item.body.f_cut for item in run.bodies), default=None)
    if f_cut is not None:
        axes.axvline(1e-3 * f_cut, color="k", linestyle="--", linewidth=0.8, label="f_cut")
    shown = f <= (2 * f_cut if f_cut else f[-1])
    axes.set_xlim(0, 1e-3 * f[shown][-1])
    axes.set_ylim(1e-5 * amplitude.max(), 2 * amplitude.max())
    return _finish(axes, label, "frequency [kHz]")


def energy(
    axes: Axes,
    result: Result,
    *,
    bodies: Sequence[PartitionBody] | None = None,
    contacts: Sequence[PartitionContact] | None = None,
) -> Axes:
    """Energy of bodies and contacts, energy taken by damping and friction, and their sum over time [ms].

    The sum is constant if nothing else in the model does work on the bodies.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    result : Result
    bodies, contacts : sequences, optional
        Default: all of the run.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If an argument has a wrong type, there is neither body nor contact, the run has no samples, or the energy of a
        contact is not known after the run.
    """
    axes = axes_of(axes)
    check_samples(result)
    bodies = result.bodies if bodies is None else validate_bodies(bodies)
    contacts = result.contacts if contacts is None else validate_contacts(contacts)
    if not bodies and not contacts:
        raise InputError("bodies, contacts: expected at least one of them, got none")
    curves = {name_of(item, f"body {i}"): item.energy(result) for i, item in enumerate(bodies)}
    curves |= {item.name: item.energy(result) for item in contacts}
    curves |= {f"taken by {what}": taken for what, taken in taken_by(bodies, contacts, result).items()}
    curves["sum"] = np.sum(list(curves.values()), axis=0)
    scale, prefix = _prefix(max(abs(curve).max() for curve in curves.values()))
    for i, (label, curve) in enumerate(curves.items()):
        style = {"color": "k", "linewidth": 0.8} if label == "sum" else {"linestyle": _DASHES[i % len(_DASHES)]}
        axes.plot(1e3 * result.t, curve / scale, label=plain(label), **style)
    return _finish(axes, f"energy [{prefix}J]")


def modes(axes: Axes, body: ReducedBody | PartitionBody) -> Axes:
    """Frequencies [kHz] of the shapes of a body by their number, with a marker for each kind, and f_cut.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    body : ReducedBody or PartitionBody

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If an argument has a wrong type.
    """
    axes = axes_of(axes)
    body = body.body if isinstance(body, PartitionBody) else body
    validate_type("body", body, ReducedBody, "reduce() or CreatePartitionBody()")
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
    axes: Axes, runs: Mapping[str, Comparison] | Iterable[tuple[str, Comparison]], quantity: str = "force"
) -> Axes:
    """Relative error [%] over run time [s] of several runs; a line joins the runs that no other run dominates.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
    runs : mapping of str to Comparison
        Label and comparison of each run.
    quantity : str
        What the error is of: "force" or the name of a point.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If an argument has a wrong type, there are no runs, or one has no such error or run time.
    """
    axes, runs = axes_of(axes), labelled(runs)
    if not runs:
        raise InputError("runs: expected at least one comparison, got none")
    validate_runs(runs, quantity)
    line = [(runs[label].time_s, 100 * runs[label].error[quantity]) for label in front(runs, quantity)]
    axes.loglog(*zip(*line, strict=True), "-", color="0.6", linewidth=1.0, zorder=1)
    for i, (label, run) in enumerate(runs.items()):
        axes.loglog(run.time_s, 100 * run.error[quantity], _MARKERS[i % len(_MARKERS)], label=plain(label))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(lambda y, _: f"{y:g}" if f"{y:e}"[0] in "25" else "")  # all nine would overlap
    reference = max(run.reference_time_s for run in runs.values())
    if math.isfinite(reference):
        axes.axvline(reference, color="k", linestyle="--", linewidth=0.8, label="reference")
    what = "the force" if quantity == "force" else f"the velocity of {plain(quantity)}"
    return _finish(axes, f"error of {what} [%]", "run time [s]")


def overview(
    run: History | Result, reference: History | None = None, *, contact: PartitionContact | None = None
) -> Figure:
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

    Raises
    ------
    InputError
        See `force` and `velocity`.
    """
    run = history_of(run, contact)
    figure_class = require("matplotlib.figure").Figure
    figure = figure_class(figsize=(8.0, 2.6 * (1 + len(run.velocity))), layout="constrained")
    panels = figure.subplots(1 + len(run.velocity), 1, sharex=True, squeeze=False)[:, 0]
    force(panels[0], run, reference)
    for axes, point in zip(panels[1:], run.velocity, strict=True):
        velocity(axes, point, run, reference)
    for axes in panels[:-1]:
        axes.set_xlabel("")
    return figure


def _velocity(history: History, name: str) -> Array:
    validate_choice("point", name, history.velocity)
    return history.velocity[name]


def _equal_samples(t: Array) -> int:
    step = np.diff(t)
    if np.ptp(step) <= 1e-3 * step.mean():
        return len(t)
    return int(min(math.ceil((t[-1] - t[0]) / step.min()) + 1, _MOST_SAMPLES))


def _prefix(largest: float) -> tuple[float, str]:
    """Factor and name of the multiple of a unit in which `largest` is 1 to 1000."""
    return next(((scale, name) for scale, name in _PREFIXES.items() if largest >= scale), (1.0, ""))


def _layers(run: History, reference: History | None) -> list[tuple[History, dict[str, object]]]:
    if reference is not None:
        validate_type("reference", reference, History, "Result.history(), reference.simulate() or History.load()")
    below = [] if reference is None else [(reference.until(float(run.t[-1])), _REFERENCE_STYLE)]
    return [*below, (run, _RUN_STYLE)]


def _finish(axes: Axes, label: str, x_label: str = "time [ms]") -> Axes:
    axes.set_xlabel(x_label)
    axes.set_ylabel(label)
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[1]:
        axes.legend()
    return axes


def __dir__() -> list[str]:
    return __all__
