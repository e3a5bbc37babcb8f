"""Figures of histories; every function draws on given axes and returns them."""

from __future__ import annotations

from typing import Any

from ._optional import require
from .history import History

_REFERENCE_STYLE = {"color": "0.6", "linewidth": 3.0}
_RUN_STYLE = {"color": "C3", "linewidth": 1.0}


def force(axes: Any, run: History, reference: History | None = None) -> Any:
    """Total contact force [N] over time [ms], the run over its reference.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    run : History
    reference : History, optional

    Returns
    -------
    matplotlib.axes.Axes
    """
    for history, style in _layers(run, reference):
        axes.plot(1e3 * history.t, history.force, label=history.info.get("label"), **style)
    return _finish(axes, "contact force [N]")


def velocity(axes: Any, point: str, run: History, reference: History | None = None, *, axis: int = 2) -> Any:
    """Velocity of a named point along one axis [m/s] over time [ms], the run over its reference.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    point : str
        Name in `History.velocity`.
    run : History
    reference : History, optional
    axis : {0, 1, 2}

    Returns
    -------
    matplotlib.axes.Axes
    """
    for history, style in _layers(run, reference):
        axes.plot(1e3 * history.t, history.velocity[point][:, axis], label=history.info.get("label"), **style)
    return _finish(axes, f"velocity of {point} along {'xyz'[axis]} [m/s]")


def overview(run: History, reference: History | None = None) -> Any:
    """Contact force and the velocities of all named points, one below the other.

    Parameters
    ----------
    run : History
    reference : History, optional

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure_class = require("matplotlib.figure").Figure
    figure = figure_class(figsize=(8.0, 2.6 * (1 + len(run.velocity))), layout="constrained")
    panels = figure.subplots(1 + len(run.velocity), 1, sharex=True, squeeze=False)[:, 0]
    force(panels[0], run, reference)
    for axes, point in zip(panels[1:], run.velocity, strict=True):
        velocity(axes, point, run, reference)
    for axes in panels[:-1]:
        axes.set_xlabel("")
    return figure


def _layers(run: History, reference: History | None) -> list[tuple[History, dict[str, Any]]]:
    below = [] if reference is None else [(reference.until(float(run.t[-1])), _REFERENCE_STYLE)]
    return [*below, (run, _RUN_STYLE)]


def _finish(axes: Any, label: str) -> Any:
    axes.set_xlabel("time [ms]")
    axes.set_ylabel(label)
    axes.grid(alpha=0.3)
    axes.legend()
    return axes
