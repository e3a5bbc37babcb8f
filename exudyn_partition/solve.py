"""Explicit and implicit runs by Exudyn's own solvers, with checks before, progress during, and results kept after."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ._checks import validate_choice, validate_positive
from ._optional import require
from .contact.compliance import ComplianceContact
from .errors import ContactPatchWarning, InputError, RunError, StepSizeError, StoppedRunWarning
from .history import History
from .items import PartitionBody, PartitionContact, partition_items
from .linalg import one_blas_thread

Array = np.ndarray
Progress = Callable[[float], None]

_STEPS_A_PERIOD = 25  # default step: of the highest truncation frequency, whose period is then 0.3 % off at most
_SAFETY = 0.9  # default step: at most this share of the stability limit


@dataclass(frozen=True, eq=False)
class Result:
    """What a run leaves.

    Parameters
    ----------
    t : (n,) array
        Times of the samples [s].
    status : {"finished", "interrupted", "unstable"}
    message : str
        Why and where the run ended.
    step : float
        Time step [s].
    steps : int
        Steps taken.
    method : str
    time_s : float
        Run time of Exudyn's solver [s].
    sensors : dict of int to (n, k) array
        Samples of the model's internally stored sensors, by sensor number.
    """

    t: Array
    status: str
    message: str
    step: float
    steps: int
    method: str
    time_s: float
    sensors: Mapping[int, Array] = field(repr=False)

    def sensor(self, number: Any) -> Array:
        """Samples of a sensor, (n, k).

        Raises
        ------
        InputError
            If the run has no such sensor.
        """
        if int(number) not in self.sensors:
            raise InputError(f"number: sensor {int(number)} stored nothing in this run; set storeInternal=True")
        return self.sensors[int(number)]

    def history(
        self, contact: PartitionContact, points: Mapping[str, tuple[PartitionBody, Any]] | None = None
    ) -> History:
        """Force of a contact and velocities of named points, to compare, plot and save."""
        velocity = {name: body.velocity(self, point) for name, (body, point) in (points or {}).items()}
        bodies = (contact.slave.body, contact.master.body)
        info = {
            "label": f"{bodies[0].basis.name}, {self.method}",
            "dofs": sum(body.n_dofs for body in bodies),
            "contact_nodes": len(contact.law.rows),
            "step_s": self.step,
            "steps": self.steps,
            "time_s": self.time_s,
            "status": self.status,
        }
        return History(self.t, contact.force(self), velocity, info)


def stability_limit(mbs: Any) -> float:
    """Largest stable step of central differences for the partition bodies with all contact rows closed [s].

    2 / omega_max of K + H' F^-1 H against M, by Lanczos. Other items of the model are not included; multipliers of the
    lagrange formulation do not lower the limit.

    Parameters
    ----------
    mbs : exudyn.MainSystem

    Returns
    -------
    float
        `math.inf` for a model without partition bodies.
    """
    bodies, contacts = partition_items(mbs)
    if not bodies:
        return float("inf")
    ends = np.cumsum([0] + [item.body.n_dofs for item in bodies])
    place = {id(item): np.arange(a, b) for item, a, b in zip(bodies, ends[:-1], ends[1:], strict=True)}
    K = sp.block_diag([item.body.stiffness for item in bodies], format="csr")
    scale = 1 / np.sqrt(np.concatenate([item.body.mass.diagonal() for item in bodies]))
    closed = []
    for contact in contacts:
        if isinstance(contact.law, ComplianceContact):
            dofs = np.concatenate([place[id(contact.slave)], place[id(contact.master)]])
            closed.append((dofs, contact.law.H, np.linalg.inv(contact.law.problem.F)))

    def apply(x: Array) -> Array:
        x = scale * x.ravel()
        y = K @ x
        for dofs, H, stiffness in closed:
            y[dofs] += H.T @ (stiffness @ (H @ x[dofs]))
        return scale * y

    n = K.shape[0]
    operator = scipy.sparse.linalg.LinearOperator((n, n), matvec=apply, dtype=float)
    start = np.ones(n)
    largest = scipy.sparse.linalg.eigsh(operator, k=1, which="LA", tol=1e-4, v0=start, return_eigenvectors=False)[0]
    return float(2 / np.sqrt(largest))


def solve_dynamic(
    mbs: Any,
    *,
    end_time: float,
    step: float | None = None,
    method: str = "explicit",
    sample_period: float | None = None,
    spectral_radius: float = 0.9,
    settings: Any = None,
    progress: Progress | None = None,
) -> Result:
    """Run an assembled model in Exudyn's own solver.

    The same model can be run by `mbs.SolveDynamic` directly, with `collect` for its results; this adds the check of the
    step, progress, Ctrl-C that keeps what was computed, and warnings about the contact.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        Assembled.
    end_time : float
        [s]
    step : float, optional
        [s]. Default: 25 steps a period of the highest `f_cut`; explicit at most 0.9 of `stability_limit`.
    method : {"explicit", "implicit"}
        Exudyn's VelocityVerlet or generalized-alpha.
    sample_period : float, optional
        Time between samples [s], a multiple of the step; default: every step.
    spectral_radius : float
        Of generalized-alpha at infinity; 1 does not damp.
    settings : exudyn.SimulationSettings, optional
        Everything else; the entries named here are overwritten in it.
    progress : callable, optional
        Called with the share done, 0 to 1, a hundred times.

    Returns
    -------
    Result

    Raises
    ------
    StepSizeError
        If an explicit step is above the stability limit.
    RunError
        If the model is not assembled or its solver fails at the start.

    Warns
    -----
    StoppedRunWarning
        If the run ended early; the result holds what was computed.
    ContactPatchWarning
        If a contact reached the edge of its patch or slid further than its frozen pairs allow.
    """
    exu = require("exudyn")
    validate_choice("method", method, ("explicit", "implicit"))
    end_time = validate_positive("end_time", end_time, "s")
    if mbs.systemData.ODE2Size() == 0:
        raise RunError("mbs: the model has no coordinates yet; call mbs.Assemble() before solving")
    if method == "implicit":
        _refuse_multipliers(mbs)
    step = _checked_step(mbs, step, method)
    steps = max(1, round(end_time / step))
    step = end_time / steps
    settings = exu.SimulationSettings() if settings is None else settings
    integration = settings.timeIntegration
    integration.startTime, integration.endTime, integration.numberOfSteps = 0.0, end_time, steps
    integration.generalizedAlpha.spectralRadius = spectral_radius
    # Verlet's end-of-step accelerations double as the next step's; computing them again would double the cost.
    integration.explicit.computeEndOfStepAccelerations = False
    integration.verboseMode = 0
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    sample_period = step if sample_period is None else validate_positive("sample_period", sample_period, "s")
    settings.solution.sensors.writePeriod = max(step, sample_period)
    solver = exu.DynamicSolverType.VelocityVerlet if method == "explicit" else exu.DynamicSolverType.GeneralizedAlpha

    status, message = "finished", f"reached {end_time:.6g} s"
    with one_blas_thread(), _watched(mbs, end_time, progress) as watch:
        begin = time.perf_counter()
        try:
            mbs.SolveDynamic(settings, solverType=solver)
        except Exception as error:  # Exudyn wraps errors of user functions in its own types
            status, message = "unstable", f"the solver stopped: {_root(error)}"
        time_s = time.perf_counter() - begin
    if watch.interrupted:
        status, message = "interrupted", "interrupted by the user"
    return _finish(collect(mbs), mbs, status, message, step, method, time_s)


def collect(mbs: Any) -> Result:
    """Results of the last run of a model, also of one by `mbs.SolveDynamic` directly.

    Parameters
    ----------
    mbs : exudyn.MainSystem

    Returns
    -------
    Result
        Cut at the first sample that is not finite.

    Raises
    ------
    RunError
        If no sensor stored anything.
    """
    sensors = {}
    for number in range(mbs.systemData.NumberOfSensors()):
        if mbs.GetSensorParameter(number, "storeInternal"):
            data = np.atleast_2d(mbs.GetSensorStoredData(number))
            if data.size:
                sensors[number] = data
    if not sensors:
        raise RunError("mbs: no sensor stored anything; run the model first")
    samples = min(len(data) for data in sensors.values())
    finite = np.all([np.isfinite(data[:samples]).all(axis=1) for data in sensors.values()], axis=0)
    samples = int(finite.argmin()) if not finite.all() else samples
    first = next(iter(sensors.values()))
    return Result(
        t=first[:samples, 0].copy(),
        status="finished" if finite.all() else "unstable",
        message="",
        step=float("nan"),
        steps=0,
        method="",
        time_s=float("nan"),
        sensors={number: data[:samples, 1:] for number, data in sensors.items()},
    )


def _checked_step(mbs: Any, step: float | None, method: str) -> float:
    bodies, _ = partition_items(mbs)
    limit = stability_limit(mbs) if method == "explicit" else float("inf")
    if step is None:
        if not bodies:
            raise InputError("step: the model has no partition body to choose it from; give it [s]")
        return min(_SAFETY * limit, 1 / (_STEPS_A_PERIOD * max(item.body.f_cut for item in bodies)))
    step = validate_positive("step", step, "s")
    if step > limit:
        raise StepSizeError(
            f"step: {step:.4g} s is above the stability limit of explicit integration, {limit:.4g} s (all contact rows "
            f"closed). Take at most {limit:.3g} s, a lower f_cut, a region with larger elements, or method='implicit'"
        )
    return step


def _refuse_multipliers(mbs: Any) -> None:
    for contact in partition_items(mbs)[1]:
        if contact.explicit_only:
            raise InputError(
                f"method: the contact {contact.name or '(no name)'!r} has formulation 'lagrange', which runs in "
                "explicit central differences; use method='explicit', or formulation='compliance' with its bases"
            )


class _Watch:
    """What the hook before each step knows: whether the user asked to stop."""

    def __init__(self) -> None:
        self.interrupted = False


@contextlib.contextmanager
def _watched(mbs: Any, end_time: float, progress: Progress | None) -> Iterator[_Watch]:
    """Progress and Ctrl-C through Exudyn's PreStep function, in front of the model's own, which is put back after."""
    watch = _Watch()
    own = mbs.GetPreStepUserFunction()
    own_function = own["function"] if isinstance(own, dict) else None
    next_report = 0.0

    def before_step(mbs: Any, t: float) -> bool:
        nonlocal next_report
        if progress is not None and t >= next_report:
            next_report = t + end_time / 100
            progress(min(t / end_time, 1.0))
        if watch.interrupted:
            return False
        return own_function is None or own_function(mbs, t)

    def interrupt(number: int, frame: Any) -> None:
        watch.interrupted = True

    in_main_thread = threading.current_thread() is threading.main_thread()
    previous = signal.signal(signal.SIGINT, interrupt) if in_main_thread else None
    mbs.SetPreStepUserFunction(before_step)
    try:
        yield watch
    finally:
        mbs.SetPreStepUserFunction(own_function if own_function is not None else 0)
        if in_main_thread:
            signal.signal(signal.SIGINT, previous)


def _root(error: BaseException) -> str:
    """Return the message of the library's own error at the bottom of Exudyn's report, if there is one."""
    while error.__cause__ is not None:
        error = error.__cause__
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return next((line for line in lines if "Error: " in line), lines[0] if lines else type(error).__name__)


def _finish(result: Result, mbs: Any, status: str, message: str, step: float, method: str, time_s: float) -> Result:
    """Complete a result and say what needs saying."""
    last = float(result.t[-1]) if len(result.t) else 0.0
    if status == "finished" and result.status == "unstable":
        status, message = "unstable", "coordinates are no longer finite"
    if status != "finished":
        message = f"{message}; results are kept up to t = {last:.6g} s"
        warnings.warn(message, StoppedRunWarning, stacklevel=3)
    result = replace(
        result,
        status=status,
        message=message,
        step=step,
        steps=round(last / step),
        method=method,
        time_s=time_s,
    )
    for contact in partition_items(mbs)[1]:
        _warn_of_patch(contact, result)
    return result


def _warn_of_patch(contact: PartitionContact, result: Result) -> None:
    name = f"contact {contact.name!r}" if contact.name else "the contact"
    if contact.reached_edge_at is not None:
        warnings.warn(
            f"{name} reached the edge of its patch at t = {contact.reached_edge_at:.6g} s; the force is too small from "
            "then on. Enlarge the contact radius of both partitions",
            ContactPatchWarning,
            stacklevel=4,
        )
    slide, when = contact.largest_slide(result)
    size = contact.law.rows.facet_size
    if slide > size:
        warnings.warn(
            f"{name} slid by {slide:.3g} m at t = {when:.6g} s while closed, more than a facet ({size:.3g} m): its "
            "pairs are frozen in the reference configuration and no longer true",
            ContactPatchWarning,
            stacklevel=4,
        )
