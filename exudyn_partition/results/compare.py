"""Comparison of a run with its reference: relative errors and run times."""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..support.arrays import Array
from ..support.checks import validate_choice, validate_number, validate_type
from .history import History

__all__ = ["Comparison", "compare", "front", "versions"]


@dataclass(frozen=True)
class Comparison:
    """Errors of a run against a reference.

    Parameters
    ----------
    error : dict of str to float
        ||x - x_ref|| / ||x_ref|| over the common time, for "force" and for the velocity of each point. x is then the
        change of the velocity from its initial value. With friction also for "tangential", the tangential force on the
        slave, if the reference has any.
    time_s, reference_time_s : float
        Run times of the run and of its reference [s]; nan if not known.
    end_time : float
        End of the common time [s].

    Raises
    ------
    InputError
        If an error or a time is not a number, or one is below zero.
    """

    error: dict[str, float]
    time_s: float
    reference_time_s: float
    end_time: float

    def __post_init__(self) -> None:
        if not isinstance(self.error, Mapping):
            raise InputError(f"error: expected a dict of names and numbers, got {type(self.error).__name__}")
        error = {name: validate_number(f"error[{name!r}]", value) for name, value in self.error.items()}
        for name, value in error.items():
            if value < 0:
                raise InputError(f"error[{name!r}]: expected at least zero, got {value!r}")
        object.__setattr__(self, "error", error)
        for name, value in (("time_s", self.time_s), ("reference_time_s", self.reference_time_s)):
            object.__setattr__(self, name, _run_time(name, value))
        object.__setattr__(self, "end_time", validate_number("end_time", self.end_time, "a time in s"))

    @property
    def speedup(self) -> float:
        """Run time of the reference divided by that of the run; nan if one is not known."""
        return self.reference_time_s / self.time_s if self.time_s else math.nan


def compare(run: History, reference: History) -> Comparison:
    """Relative L2 errors of a run over the common time, at the samples of the reference.

    Parameters
    ----------
    run, reference : History
        Histories with the same named points.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If a named point is missing, the runs have no time in common, or only one of them has friction. Also if in the
        common time the reference has no force, or the velocity of a point is constant: then there is no relative error.
    """
    for name, history in (("run", run), ("reference", reference)):
        validate_type(name, history, History, "Result.history(), reference.simulate() or History.load()")
    missing = set(reference.velocity) - set(run.velocity)
    if missing:
        said = ", ".join(sorted(missing))
        raise InputError(f"run: has no velocity of {said}, which the reference has; name all its points in history()")
    if run.tangential_force is None and reference.tangential_force is not None:
        raise InputError("run: is frictionless, but the reference is not; give friction= to CreatePartitionContact too")
    if run.tangential_force is not None and reference.tangential_force is None:
        raise InputError("reference: is frictionless, but the run is not; give friction= to reference.simulate too")
    begin, end = max(run.t[0], reference.t[0]), min(run.t[-1], reference.t[-1])
    slack = 1e-9 * abs(end)
    common = (reference.t >= begin - slack) & (reference.t <= end + slack)
    if not begin < end or common.sum() < 2:
        raise InputError(
            f"run, reference: expected a time in common, with samples of the reference. The run goes from "
            f"{run.t[0]:.6g} to {run.t[-1]:.6g} s, the reference from {reference.t[0]:.6g} to {reference.t[-1]:.6g} s"
        )
    t = reference.t[common]
    error = {"force": _relative("contact force", _resample(run.force, run.t, t), reference.force[common])}
    if run.tangential_force is not None and reference.tangential_force is not None:
        expected = reference.tangential_force[common]
        if expected.any():
            error["tangential"] = _relative("tangential force", _resample(run.tangential_force, run.t, t), expected)
    for name, velocity in reference.velocity.items():
        got, expected = _resample(run.velocity[name], run.t, t), velocity[common]
        error[name] = _relative(f"change of the velocity of {name}", got - got[0], expected - expected[0])
    run_s, reference_s = (_run_time("info['time_s']", h.info.get("time_s", math.nan)) for h in (run, reference))
    return Comparison(error, run_s, reference_s * len(t) / len(reference.t), float(end))


def front(runs: Mapping[str, Comparison], quantity: str = "force") -> list[str]:
    """Names of the runs for which no other run is better in both run time and error (Pareto front), fastest first.

    Parameters
    ----------
    runs : mapping of str to Comparison
    quantity : str
        What the error is of: "force" or the name of a point.

    Raises
    ------
    InputError
        If a run is no Comparison, or has no such error or run time.
    """
    validate_runs(runs, quantity)
    best, names = math.inf, []
    for name, run in sorted(runs.items(), key=lambda item: (item[1].time_s, item[1].error[quantity])):
        if run.error[quantity] < best:
            best = run.error[quantity]
            names.append(name)
    return names


def validate_runs(runs: Mapping[str, Comparison], quantity: str) -> None:
    """Raise `InputError` unless all runs have an error of that quantity, and a run time."""
    if not isinstance(runs, Mapping):
        raise InputError(f"runs: expected a dict of labels and comparisons, got {type(runs).__name__}")
    for label, run in runs.items():
        validate_type("runs", run, Comparison, "compare()")
        validate_choice("quantity", quantity, run.error)
        if not run.time_s > 0:
            raise InputError(f"runs: the run time of {label!r} is not known; give the run's info['time_s'], in s")


def _relative(name: str, x: Array, x_ref: Array) -> float:
    size = np.linalg.norm(x_ref)
    if not size:
        raise InputError(f"reference: has no {name} in the common time, so that there is no relative error")
    return float(np.linalg.norm(x - x_ref) / size)


def _run_time(name: str, value: Any) -> float:
    """Check a run time [s]; nan if it is not known."""
    seconds = (
        math.nan if isinstance(value, float) and math.isnan(value) else validate_number(name, value, "a time in s")
    )
    if seconds < 0:
        raise InputError(f"{name}: expected a time in s of at least zero, got {seconds!r}")
    return seconds


def _resample(x: Array, t: Array, t_new: Array) -> Array:
    columns = x.reshape(len(t), -1).T
    return np.stack([np.interp(t_new, t, column) for column in columns], axis=-1).reshape(-1, *x.shape[1:])


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that affect results."""
    found: dict[str, Any] = {"python": platform.python_version()}
    for package in ("exudyn-partition", "exudyn", "ngsolve", "numpy", "scipy"):
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def __dir__() -> list[str]:
    return __all__
