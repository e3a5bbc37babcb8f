"""Comparison of a run with its reference: relative errors beside run times."""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .errors import InputError
from .history import History

Array = np.ndarray


@dataclass(frozen=True)
class Comparison:
    """Errors of a run against a reference.

    Parameters
    ----------
    error : dict of str to float
        ||x - x_ref|| / ||x_ref|| over the common time, for "force" and each point's velocity; a velocity is taken from
        its initial value.
    time_s, reference_time_s : float
        Run times of both [s].
    end_time : float
        Common time [s].
    """

    error: dict[str, float]
    time_s: float
    reference_time_s: float
    end_time: float

    @property
    def speedup(self) -> float:
        """The reference's run time over the run's."""
        return self.reference_time_s / self.time_s


def compare(run: History, reference: History) -> Comparison:
    """Relative L2 errors of a run over the time that both cover, on the reference's samples.

    Parameters
    ----------
    run, reference : History
        With the same named points.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If a named point is missing, or the runs have no time in common.
    """
    missing = set(reference.velocity) - set(run.velocity)
    if missing:
        raise InputError(f"run: has no velocity of {', '.join(sorted(missing))}, which the reference has")
    end = min(run.t[-1], reference.t[-1]) if len(run.t) else 0.0
    if end <= 0:
        raise InputError("run, reference: they have no time in common")
    full = reference
    reference = reference.until(end)
    error = {"force": _relative(_resample(run.force, run.t, reference.t), reference.force)}
    for name, expected in reference.velocity.items():
        got = _resample(run.velocity[name], run.t, reference.t)
        error[name] = _relative(got - got[0], expected - expected[0])
    share = len(reference.t) / len(full.t)
    return Comparison(
        error,
        float(run.info.get("time_s", np.nan)),
        float(reference.info.get("time_s", np.nan)) * share,
        float(end),
    )


def front(runs: Mapping[str, Comparison], quantity: str = "force") -> list[str]:
    """Names of the runs that no other beats in both run time and error (Pareto's front), the quickest first.

    Parameters
    ----------
    runs : mapping of str to Comparison
    quantity : str
        Whose error: "force" or the name of a point.
    """
    best, names = math.inf, []
    for name, run in sorted(runs.items(), key=lambda item: (item[1].time_s, item[1].error[quantity])):
        if run.error[quantity] < best:
            best = run.error[quantity]
            names.append(name)
    return names


def _relative(x: Array, x_ref: Array) -> float:
    size = np.linalg.norm(x_ref)
    return float(np.linalg.norm(x - x_ref) / size) if size else float(np.linalg.norm(x) > 0)


def _resample(x: Array, t: Array, t_new: Array) -> Array:
    columns = x.reshape(len(t), -1).T
    return np.stack([np.interp(t_new, t, column) for column in columns], axis=-1).reshape(-1, *x.shape[1:])


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that results depend on."""
    found: dict[str, Any] = {"python": platform.python_version()}
    for package in ("exudyn-partition", "exudyn", "ngsolve", "numpy", "scipy"):
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found
