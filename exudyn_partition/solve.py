"""Explicit and implicit runs by Exudyn's own solvers, with checks before, progress during, and results kept after."""

from __future__ import annotations

import contextlib
import math
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg

from ._checks import validate_array, validate_choice, validate_positive
from ._optional import require
from ._progress import LONG
from ._progress import progress as progress_bar
from .central_differences import MultiplierStep
from .contact.rigid import RigidGaps
from .contact_items import PartitionContact
from .errors import (
    ContactPatchWarning,
    InputError,
    ModelLimitWarning,
    RunError,
    StepSizeError,
    StoppedRunWarning,
)
from .estimate import SAFETY, STEPS_A_PERIOD
from .history import History
from .items import PartitionBody, coordinate_slices, partition_items, start_of_step, validate_model
from .joints import Joints
from .linalg import one_blas_thread
from .markers import check_joints
from .step_control import LONGEST, UNRESOLVED, StepControl
from .summary import write_report

Array = np.ndarray
Progress = Callable[[float], None]

_LARGEST_DEFORMATION = 0.1  # of a body's size: linear elasticity ends long before
_LARGEST_ROTATION = 0.1  # rad, of a body in an inertial frame
_LARGEST_TURN = 1.0  # rad, of a floating frame in a step: six steps a turn
_RESIDUAL = 1e-8  # N, to which Newton's method solves where it cannot reach Exudyn's relative tolerance
_OVERLAP = 1e-2  # of the bodies' largest energy: what those that overlap at the start may store
_ROUND_OFF = 1e-7  # of a facet's size: overlap that is none
_EARLY = 2e-10  # s, more than what Exudyn's solvers stop ahead of their end time, for whatever steps
_SHORTEST = 1e-6  # of the step in contact, below which Exudyn gives up shortening it


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
        Time step [s]; of an adaptive run, that in contact.
    steps : int
        Steps taken.
    method : str
    time_s : float
        Run time of Exudyn's solver [s].
    sensors : dict of int to (n, k) array
        Samples of the model's internally stored sensors, by sensor number.
    bodies : tuple of PartitionBody
        The model's.
    contacts : tuple of PartitionContact
        The model's. What they know beside their sensors, such as the forces of rows, is that of the model's last run.
    """

    t: Array
    status: str
    message: str
    step: float
    steps: int
    method: str
    time_s: float
    sensors: Mapping[int, Array] = field(repr=False)
    bodies: tuple[PartitionBody, ...] = field(default=(), repr=False)
    contacts: tuple[PartitionContact, ...] = field(default=(), repr=False)

    def sensor(self, number: Any) -> Array:
        """Samples of the sensor with Exudyn's `number`, (n, k), at the times of the result.

        Raises
        ------
        InputError
            If the run has no such sensor.
        """
        if int(number) not in self.sensors:
            raise InputError(f"number: sensor {int(number)} stored nothing in this run; set storeInternal=True")
        return self.sensors[int(number)]

    def at(self, times: Sequence[float] | Array | int) -> Result:
        """Return the samples nearest to some times, each once: for frames of a film.

        Parameters
        ----------
        times : (k,) [s] or int
            Times, or how many of them, equally spaced over the run.

        Raises
        ------
        InputError
            If a time is not within the run, or the run kept nothing.
        """
        if not len(self.t):
            raise InputError(f"result: the run kept no samples ({self.message})")
        if isinstance(times, int):
            validate_positive("times", times)
            wanted = np.linspace(self.t[0], self.t[-1], times)
        else:
            wanted = validate_array("times", times, (None,))
            slack = 1e-9 * (self.t[-1] - self.t[0])
            outside = (wanted < self.t[0] - slack) | (wanted > self.t[-1] + slack)
            if outside.any():
                raise InputError(
                    f"times: expected times of the run, {self.t[0]:.6g} to {self.t[-1]:.6g} s, got "
                    f"{wanted[outside.argmax()]:.6g}"
                )
        middles = (self.t[1:] + self.t[:-1]) / 2
        nearest = np.unique(np.searchsorted(middles, wanted))
        return replace(self, t=self.t[nearest], sensors={n: data[nearest] for n, data in self.sensors.items()})

    def report(self, path: str | Path, *, title: str = "") -> Path:
        """Write the run as one HTML page: scene, step, conservation, contacts, timings, what was left out, figures.

        Parameters
        ----------
        path : str or Path
            Of the page, which needs no other file.
        title : str
            Default: the file's name.

        Returns
        -------
        Path

        Raises
        ------
        InputError
            If the folder does not exist, or the run kept nothing.
        """
        return write_report(path, self, title=title)

    def history(
        self, contact: PartitionContact, points: Mapping[str, tuple[PartitionBody, Any]] | None = None
    ) -> History:
        """Force of a contact and velocities of named points, to compare, plot and save."""
        velocity = {name: body.velocity(self, point) for name, (body, point) in (points or {}).items()}
        bodies = [item.body for item, _ in contact.sides]
        info = {
            "label": f"{bodies[0].basis.name}, {self.method}",
            "dofs": sum(body.n_dofs for body in bodies),
            "contact_nodes": contact.n_rows,
            "step_s": self.step,
            "steps": self.steps,
            "time_s": self.time_s,
            "status": self.status,
        }
        return History(self.t, contact.force(self), velocity, info)


def stability_limit(mbs: Any) -> float:
    """Largest stable step of central differences for the partition bodies with all contact rows closed [s].

    2 / omega_max of K + H' F^-1 H against M, by Lanczos, with the pairs and normals of the start. Other items of the
    model are not included, nor is the mass of what carries a rigid surface; multipliers of the lagrange formulation do
    not lower the limit.

    Parameters
    ----------
    mbs : exudyn.MainSystem

    Returns
    -------
    float
        `math.inf` for a model without partition bodies.
    """
    return _stability_limit(*partition_items(mbs))


def _stability_limit(bodies: list[PartitionBody], contacts: list[PartitionContact]) -> float:
    if not bodies:
        return float("inf")
    ends = np.cumsum([0] + [item.body.n_dofs for item in bodies])
    place = {id(item): np.arange(a, b) for item, a, b in zip(bodies, ends[:-1], ends[1:], strict=True)}
    K = sp.block_diag([item.body.stiffness for item in bodies], format="csr")
    scale = 1 / np.sqrt(np.concatenate([item.body.mass.diagonal() for item in bodies]))
    closed = []
    for contact in contacts:
        if not contact.multipliers:
            contact.law.reset()  # to the pairs at the start, which are all that can close
            items = [item for item, _ in contact.sides]
            to_coordinates = scipy.linalg.block_diag(*(item.kinematics.from_basis for item in items))
            stiffness = to_coordinates.T @ contact.law.closed_stiffness() @ to_coordinates
            closed.append((np.concatenate([place[id(item)] for item in items]), stiffness))

    def apply(x: Array) -> Array:
        x = scale * x.ravel()
        y = K @ x
        for dofs, stiffness in closed:
            y[dofs] += stiffness @ x[dofs]
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
    adaptive: bool = False,
    free_step: float | None = None,
    gap_tolerance: float | None = None,
    unresolved: float | None = None,
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
        Exudyn's VelocityVerlet or generalized-alpha. Both take contacts of every formulation, joints and prescribed
        motion; explicit steps close joints by `central_differences.MultiplierStep`, and joint sensors tell reactions
        that are means over the step before. Exudyn's rigid bodies that turn in space are of first order there.
    sample_period : float, optional
        Time between samples [s], rounded to a multiple of the step; default: every step. The steps of an adaptive run
        are at most that long, and samples stand where they end.
    spectral_radius : float
        Of generalized-alpha at infinity; 1 does not damp.
    adaptive : bool
        Take `step` in contact and longer ones in free flight, as far as the bodies' vibration lets them, see
        `step_control.StepControl`. The times of the result are then not equally spaced.
    free_step : float, optional
        Longest step of an adaptive run [s]. Default: 100 steps in contact; explicit at most 0.9 of the stability limit
        with all contact rows open.
    gap_tolerance : float, optional
        Depth to which a step of an adaptive run may close a gap that was open before [m]; it is halved until it does.
        Default: what the approach covers in one step in contact.
    unresolved : float, optional
        Share of the bodies' energy that vibration may have in free flight without an adaptive run resolving it; steps
        then are longer, and damp it. Default: 1e-4.
    settings : exudyn.SimulationSettings, optional
        Everything else; end time, number of steps, spectral radius and the period of samples are set in it, and those
        of adaptive steps.
    progress : callable, optional
        Called with the share done, 0 to 1, a hundred times. Default: a bar on the terminal, if it takes long.

    Returns
    -------
    Result

    Raises
    ------
    StepSizeError
        If an explicit step is above the stability limit.
    InputError
        If an option is out of range, or would have no effect; if a joint is attached to a node that was reduced away,
        or the initial velocities violate a joint or drive; if the model has constraints that explicit steps cannot
        take: of velocities, or of Euler parameters.
    RunError
        If the model is not assembled, or Exudyn cannot run its first step.

    Warns
    -----
    StoppedRunWarning
        If the run ended early; the result holds what was computed.
    ModelLimitWarning
        If a body rotated further than its frame allows, or turned by more than a radian in a step; if bodies overlapped
        at the start by so much that it drives them apart.
    ContactPatchWarning
        If a contact reached the edge of its patch.
    """
    exu = require("exudyn")
    validate_choice("method", method, ("explicit", "implicit"))
    end_time = validate_positive("end_time", end_time, "s")
    validate_model(mbs)
    if mbs.systemData.ODE2Size() == 0:
        raise RunError("mbs: the model has no coordinates yet; call mbs.Assemble() before solving")
    check_joints(mbs, {m: point for item in partition_items(mbs)[0] for m, point in item.point_markers.items()})
    for name, value in (("free_step", free_step), ("gap_tolerance", gap_tolerance), ("unresolved", unresolved)):
        if value is not None and not adaptive:
            raise InputError(f"{name}: equal steps have none, it is taken only with adaptive=True")
    step = _checked_step(mbs, step, method)
    steps = math.ceil(end_time / step * (1 - 1e-9))
    step = end_time / steps
    if settings is None:
        settings = exu.SimulationSettings()
        settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        settings.solution.file.write = False
        settings.timeIntegration.verboseMode = 0
        # Stiff springs on light bodies leave round-off above Exudyn's 1e-10; Newton's method would search for less.
        settings.timeIntegration.newton.absoluteTolerance = _RESIDUAL
        # Verlet's accelerations at the end of a step are the next one's; asked for, they are computed twice.
        settings.timeIntegration.explicit.computeEndOfStepAccelerations = False
    integration = settings.timeIntegration
    if integration.startTime != 0.0:
        raise InputError(f"settings: expected timeIntegration.startTime 0, got {integration.startTime}")
    # Steps that are so short need more of them to get there; the hook before each step ends the run.
    beyond = math.ceil(_EARLY / step) if step < _EARLY else 0
    integration.endTime, integration.numberOfSteps = end_time + beyond * step, steps + beyond
    integration.generalizedAlpha.spectralRadius = spectral_radius
    integration.explicit.eliminateConstraints = False  # as MultiplierStep closes them
    if sample_period is not None:
        sample_period = validate_positive("sample_period", sample_period, "s")
    settings.solution.sensors.writePeriod = step * max(1, round((sample_period or step) / step))
    control = None
    if adaptive:
        control = _step_control(mbs, step, method, free_step, sample_period, gap_tolerance, unresolved)
        settings.solution.sensors.writePeriod = sample_period or 0.0
        integration.adaptiveStep, integration.minimumStepSize = True, _SHORTEST * step
        # The control lengthens steps; Exudyn only shortens those that fail.
        integration.adaptiveStepRecoverySteps = steps
    solver = exu.DynamicSolverType.VelocityVerlet if method == "explicit" else exu.DynamicSolverType.GeneralizedAlpha

    status, message = "finished", f"reached {end_time:.6g} s"
    for contact in partition_items(mbs)[1]:
        contact.restart()
    bar = progress_bar("stepping", after=LONG) if progress is None else contextlib.nullcontext(progress)
    with (
        one_blas_thread(),
        bar as report,
        _without_stabilised(mbs, method),
        _multipliers(mbs, method) as steppers,
        _watched(mbs, end_time, step, report, steppers) as watch,
        _controlled(mbs, control, settings),
    ):
        begin = time.perf_counter()
        try:
            mbs.SolveDynamic(settings, solverType=solver)
        except Exception as error:  # Exudyn wraps errors of user functions in its own types
            if not watch.steps:
                raise RunError(f"mbs: Exudyn cannot run the model: {_root(error)}") from error
            status, message = "unstable", f"the solver stopped: {_root(error)}"
        time_s = time.perf_counter() - begin
    result = replace(_samples(mbs), step=step, steps=watch.steps, method=method, time_s=time_s)
    if beyond:  # a run that a hook ends leaves a sample of the step that was not taken
        result = _cut(result, int(np.searchsorted(result.t, end_time + 0.5 * step)))
    if watch.interrupted:
        status, message = "interrupted", "interrupted by the user"
    elif status == "finished" and end_time - mbs.systemData.GetTime() > 0.5 * step:
        status = "interrupted"
        message = f"a PreStep or other user function ended the run at {mbs.systemData.GetTime():.6g} s"
    elif status == "finished" and progress is not None:
        progress(1.0)
    result = _reviewed(mbs, replace(result, status=status, message=message))
    if not adaptive:
        _warn_of_turns(result)
    return result


def collect(mbs: Any) -> Result:
    """Results of the last run of a model, also of one by `mbs.SolveDynamic` directly.

    Parameters
    ----------
    mbs : exudyn.MainSystem

    Returns
    -------
    Result
        Cut where coordinates stop to be finite, or deformations to be small.

    Raises
    ------
    InputError
        If `mbs` is no model of Exudyn.
    RunError
        If no sensor stored anything.

    Warns
    -----
    StoppedRunWarning, ModelLimitWarning, ContactPatchWarning
        As `solve_dynamic`.
    """
    validate_model(mbs)
    return _reviewed(mbs, _samples(mbs))


def _samples(mbs: Any) -> Result:
    """What the sensors stored, as it is."""
    sensors = {}
    for number in range(mbs.systemData.NumberOfSensors()):
        if mbs.GetSensorParameter(number, "storeInternal"):
            data = np.atleast_2d(mbs.GetSensorStoredData(number))
            if data.size:
                sensors[number] = data
    if not sensors:
        raise RunError("mbs: no sensor stored anything; run the model first")
    samples = min(len(data) for data in sensors.values())
    first = next(iter(sensors.values()))
    bodies, contacts = partition_items(mbs)
    return Result(
        t=first[:samples, 0].copy(),
        status="finished",
        message="samples of the model's last run",
        step=float("nan"),
        steps=0,
        method="",
        time_s=float("nan"),
        sensors={number: data[:samples, 1:] for number, data in sensors.items()},
        bodies=tuple(bodies),
        contacts=tuple(contacts),
    )


def _checked_step(mbs: Any, step: float | None, method: str) -> float:
    bodies, _ = partition_items(mbs)
    limit = stability_limit(mbs) if method == "explicit" else float("inf")
    if step is None:
        if not bodies:
            raise InputError("step: the model has no partition body to choose it from; give it [s]")
        return min(SAFETY * limit, 1 / (STEPS_A_PERIOD * max(item.body.f_cut for item in bodies)))
    step = validate_positive("step", step, "s")
    if step > limit:
        raise StepSizeError(
            f"step: {step:.4g} s is above the stability limit of explicit integration, {limit:.4g} s (all contact rows "
            f"closed). Take at most {limit:.3g} s, a lower f_cut, a region with larger elements, or method='implicit'"
        )
    return step


def _step_control(
    mbs: Any,
    step: float,
    method: str,
    free_step: float | None,
    sample_period: float | None,
    gap_tolerance: float | None,
    unresolved: float | None,
) -> StepControl:
    bodies, contacts = partition_items(mbs)
    longest = LONGEST * step if free_step is None else validate_positive("free_step", free_step, "s")
    if longest < step * (1 - 1e-9):
        raise InputError(f"free_step: expected at least the step in contact, {step:.4g} s, got {longest:.4g} s")
    if gap_tolerance is not None:
        gap_tolerance = validate_positive("gap_tolerance", gap_tolerance, "m")
    unresolved = UNRESOLVED if unresolved is None else validate_positive("unresolved", unresolved, "")
    if method == "explicit":
        longest = min(longest, SAFETY * _stability_limit(bodies, []))
    longest = max(step, min(longest, sample_period or math.inf))

    def state(item: PartitionBody) -> tuple[Array, Array, Array]:
        data, slices = mbs.systemData, coordinate_slices(mbs, item)
        views = (
            get(copy=False) for get in (data.GetODE2Coordinates, data.GetODE2Coordinates_t, data.GetODE2Coordinates_tt)
        )
        q, q_t, q_tt = (np.concatenate([view[s] for s in slices]) for view in views)
        return q, q_t, q_tt

    return StepControl(
        contacts,
        bodies,
        state,
        step=step,
        longest=longest,
        gap_tolerance=gap_tolerance,
        unresolved=unresolved,
    )


class _Watch:
    """What the hook before each step knows: how many there were, and whether the user asked to stop."""

    def __init__(self) -> None:
        self.steps = 0
        self.interrupted = False


@contextlib.contextmanager
def _multipliers(mbs: Any, method: str) -> Iterator[list[MultiplierStep]]:
    """Multipliers to apply before steps: of contacts, in explicit runs together with those of the model's joints.

    Exudyn's explicit solvers leave algebraic equations alone, with a warning. Velocities are corrected for joints
    through its PostStep function, in front of the model's own, which is put back after.
    """
    exu = require("exudyn")
    contacts = [contact for contact in partition_items(mbs)[1] if contact.multipliers]
    own_steppers = [contact.stepper for contact in contacts]
    if method == "implicit" or not mbs.systemData.AEsize():
        yield own_steppers
        return
    stepper = MultiplierStep(contacts, Joints(mbs))
    own_function = _function(mbs.GetPostStepUserFunction())

    def after_step(mbs: Any, t: float) -> bool:
        stepper.after_step(mbs, t)
        return own_function is None or own_function(mbs, t)

    warnings_off, exu.config.suppressWarnings = exu.config.suppressWarnings, True
    mbs.SetPostStepUserFunction(after_step)
    for contact in contacts:
        contact.stepper = stepper
    try:
        yield [stepper]
    finally:
        exu.config.suppressWarnings = warnings_off
        mbs.SetPostStepUserFunction(own_function or 0)
        for contact, own in zip(contacts, own_steppers, strict=True):
            contact.stepper = own


@contextlib.contextmanager
def _without_stabilised(mbs: Any, method: str) -> Iterator[None]:
    """Switch off the force elements that multipliers have for implicit runs: explicit ones only pay for their calls."""
    elements = [contact["oContact"] for contact in partition_items(mbs)[1] if contact.multipliers]
    if method == "implicit":
        elements = []
    functions = [_function(mbs.GetObjectParameter(element, "forceUserFunction")) for element in elements]
    for element in elements:
        mbs.SetObjectParameter(element, "forceUserFunction", 0)
    try:
        yield
    finally:
        for element, function in zip(elements, functions, strict=True):
            mbs.SetObjectParameter(element, "forceUserFunction", function)


@contextlib.contextmanager
def _watched(
    mbs: Any, end_time: float, step: float, progress: Progress, steppers: Sequence[MultiplierStep]
) -> Iterator[_Watch]:
    """Progress and Ctrl-C through Exudyn's PreStep function, around the model's own, which is put back after."""
    watch, last_start = _Watch(), None
    own_function = _function(mbs.GetPreStepUserFunction())
    contacts_alone = [stepper for stepper in steppers if stepper.joints is None]
    with_joints = [stepper for stepper in steppers if stepper.joints is not None]
    next_report = 0.0

    def before_step(mbs: Any, t: float) -> bool:
        nonlocal next_report, last_start
        if t >= next_report:
            next_report = t + end_time / 100
            progress(min(t / end_time, 1.0))
        start, previous = start_of_step(mbs), last_start
        if watch.interrupted or start > end_time - 1e-6 * step:
            return False
        for stepper in contacts_alone:  # also where the model's own function was set after them
            stepper.before_step(mbs, t)
        go_on = own_function is None or own_function(mbs, t)
        for stepper in with_joints:  # which the function may have moved
            stepper.before_step(mbs, t)
        watch.steps += start != previous  # not those that are taken again, shorter
        last_start = start
        return go_on

    def interrupt(number: int, frame: Any) -> None:
        watch.interrupted = True

    in_main_thread = threading.current_thread() is threading.main_thread()
    previous = signal.signal(signal.SIGINT, interrupt) if in_main_thread else None
    mbs.SetPreStepUserFunction(before_step)
    try:
        yield watch
    finally:
        mbs.SetPreStepUserFunction(own_function or 0)
        if in_main_thread:
            signal.signal(signal.SIGINT, previous)


@contextlib.contextmanager
def _controlled(mbs: Any, control: StepControl | None, settings: Any) -> Iterator[None]:
    """Steps as the control wants them, through Exudyn's PostStep and PostNewton functions, behind the model's own.

    PostStep runs at the start and when a step is done, and the solver takes its next step from what stands in its
    `it.currentStepSize` then. PostNewton can ask to repeat the step with a shorter one.
    """
    if control is None:
        yield
        return
    own_after_step, own_after_newton = map(_function, (mbs.GetPostStepUserFunction(), mbs.GetPostNewtonUserFunction()))
    refused = 2 * settings.timeIntegration.discontinuous.iterationTolerance

    def after_step(mbs: Any, t: float) -> bool:
        it = mbs.sys["dynamicSolver"].it
        step = control.next_step(it.currentStepSize)
        if step != it.currentStepSize:
            it.currentStepSize = step
            mbs.solverSignalJacobianUpdate = True
        return own_after_step is None or own_after_step(mbs, t)

    def after_newton(mbs: Any, t: float) -> list[float]:
        shorter = control.shorter_step(mbs.sys["dynamicSolver"].it.currentStepSize)
        if shorter is not None:
            return [refused, shorter]
        return [0.0, -1.0] if own_after_newton is None else own_after_newton(mbs, t)

    mbs.SetPostStepUserFunction(after_step)
    mbs.SetPostNewtonUserFunction(after_newton)
    try:
        yield
    finally:
        mbs.SetPostStepUserFunction(own_after_step or 0)
        mbs.SetPostNewtonUserFunction(own_after_newton or 0)


def _function(entry: Any) -> Callable[..., Any] | None:
    """User function that Exudyn's Get...UserFunction returns, if there is one."""
    return entry["function"] if isinstance(entry, dict) else None


def _root(error: BaseException) -> str:
    """Return the message of the library's own error at the bottom of Exudyn's report, if there is one."""
    while error.__cause__ is not None:
        error = error.__cause__
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return next((line for line in lines if "Error: " in line), lines[0] if lines else type(error).__name__)


def _reviewed(mbs: Any, result: Result) -> Result:
    """Cut a result where it stops to mean anything, and say what needs saying."""
    bodies, contacts = partition_items(mbs)
    valid = np.ones(len(result.t), dtype=bool)
    for item in bodies:
        q = item.coordinates(result)
        finite = np.isfinite(q).all(axis=1)
        q = np.where(finite[:, None], q, 0.0)
        size = np.ptp(item.body.points, axis=0).max()
        valid &= finite & (item.deformation(q) < _LARGEST_DEFORMATION * size)
    if not valid.all():
        result = _cut(result, int(valid.argmin()))
        reason = result.message if result.status == "unstable" else "deformations have grown beyond all bounds"
        result = replace(result, status="unstable", message=reason)
    if result.status != "finished":
        last = f"results are kept up to t = {result.t[-1]:.6g} s" if len(result.t) else "nothing could be kept"
        result = replace(result, message=f"{result.message}; {last}")
        warnings.warn(result.message, StoppedRunWarning, stacklevel=4)
    if len(result.t):
        for item in bodies:
            if item.frame == "inertial":
                _warn_of_rotation(item, result)
        for contact in contacts:
            _warn_of_patch(contact, result)
            _warn_of_overlap(contact, result)
    return result


def _cut(result: Result, samples: int) -> Result:
    sensors = {number: data[:samples] for number, data in result.sensors.items()}
    return replace(result, t=result.t[:samples], sensors=sensors)


def _warn_of_rotation(item: PartitionBody, result: Result) -> None:
    angle = np.linalg.norm(item.rigid_motion(item.coordinates(result))[:, 3:], axis=1)
    if angle.max() > _LARGEST_ROTATION:
        when = result.t[int((angle > _LARGEST_ROTATION).argmax())]
        warnings.warn(
            f"body {item.name!r} has rotated by more than {_LARGEST_ROTATION} rad at t = {when:.6g} s: "
            "frame='inertial' takes rotations as small, results from then on are wrong by their square. Take "
            "frame='floating'",
            ModelLimitWarning,
            stacklevel=5,
        )


def _warn_of_overlap(contact: PartitionContact, result: Result) -> None:
    """What placing tolerates as round-off of meshes is much energy for slow bodies."""
    placed = all(not item.coordinates(result)[0].any() for item, _ in contact.sides)
    carried = isinstance(contact.law.gaps, RigidGaps) and contact.law.gaps.carried
    if contact.multipliers or carried or not placed or not contact.closed_rows(result)[0]:
        return
    stored, depth = contact.energy(result.at(result.t[:1]))[0], -contact.law.least_gap
    largest = max(item.energy(result).max() for item, _ in contact.sides)
    if depth > _ROUND_OFF * contact.slave.body.surface(np.zeros(3)).facet_size and stored > _OVERLAP * largest:
        warnings.warn(
            f"contact {contact.name!r} starts with an overlap of {depth:.3g} m, within the tolerance of meshes, but "
            f"the {stored:.3g} J that it stores are {stored / largest:.2g} of the bodies' largest energy: it throws "
            "them apart. Move one by that much (referencePosition)",
            ModelLimitWarning,
            stacklevel=5,
        )


def _warn_of_turns(result: Result) -> None:
    for item in result.bodies:
        if item.frame == "floating" and len(result.t):
            turn = result.step * np.linalg.norm(item.coordinates_t(result)[:, 3:6], axis=1).max()
            if turn > _LARGEST_TURN:
                warnings.warn(
                    f"body {item.name!r} turns by {turn:.3g} rad in a step of {result.step:.4g} s: no integrator "
                    f"follows that. Take steps of at most {0.25 * result.step / turn:.2g} s, 25 a turn, or "
                    "adaptive=True",
                    ModelLimitWarning,
                    stacklevel=3,
                )


def _warn_of_patch(contact: PartitionContact, result: Result) -> None:
    name = f"contact {contact.name!r}" if contact.name else "the contact"
    if contact.reached_edge_at is not None:
        warnings.warn(
            f"{name} reached the edge of its patch at t = {contact.reached_edge_at:.6g} s, {contact.reached_edge} m; "
            "the force is too small from then on. Enlarge the contact radius of both partitions",
            ContactPatchWarning,
            stacklevel=5,
        )
