"""Explicit and implicit runs by Exudyn's own solvers, with checks before, progress meanwhile, and results after."""

from __future__ import annotations

import contextlib
import copy
import logging
import math
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from ..algebra.blas_threads import one_blas_thread
from ..contact.formulations.formulation import INTEGRATORS, Integrator
from ..errors import (
    InputError,
    ModelLimitWarning,
    RunError,
    StepSizeError,
)
from ..exudyn_bodies.model import coordinate_slices, validate_model
from ..exudyn_contacts.contact_run import ContactRun
from ..exudyn_contacts.model_run import runs_of
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..prediction.default_step import SAFETY, STEPS_A_PERIOD
from ..support.arrays import Array, joined_slices
from ..support.checks import validate_choice, validate_flag, validate_number, validate_positive
from ..support.foreign import MainSystem, SimulationSettings
from ..support.interrupt import interruptible
from ..support.optional import require
from ..support.progress import LONG, Progress
from ..support.progress import progress as progress_bar
from ..support.spelling import spelled
from ..support.warn import warn
from .contact_work import ContactWork
from .continuation import RunEnd, accelerated, keep_end, last_end, origin_of, started_from, unless_refused
from .hooks import begun, cause, controlled, hear_of_verlet, residual, unsettled, watched
from .joint_checks import OpenJoints, check_start, refuse_drives_by_rates
from .result import Result, cut, end_for, samples
from .reviews.review import reviewed
from .reviews.reviewed_run import ReviewedRun
from .stability import limit_of, stability_limit
from .step_control import LONGEST, UNRESOLVED, StepControl, impact_step
from .velocity_error import TOLERANCE

_log = logging.getLogger(__name__)

_ABOVE = 8  # of the residual that rounding leaves: where implicit steps end, which keep their Jacobian
_CONTRACTIVITY = 0.02  # contractivity of Newton's iterations above which the Jacobian is computed again
_EARLY = 2e-10  # s; Exudyn's solvers stop ahead of their end time by less than this, for all steps
_ROUNDING = 1e-3  # share of a step: rounding error of the time after very many steps
_SHORTER = 100  # an adaptive run may lose a last step that is shorter by more than this factor
_MOST_STEPS = 2**31 - 1  # largest number of steps that Exudyn counts
_MANY_STEPS = 200_000  # number of steps of an adaptive run in free flight that take minutes
_SHORTEST = 1e-6  # share of the step in contact; Exudyn makes no shorter steps


@spelled
def solve_dynamic(
    mbs: MainSystem,
    *,
    end_time: float,
    start_time: float | None = None,
    go_on: bool | Result = False,
    step: float | None = None,
    method: Integrator = "explicit",
    sample_period: float | None = None,
    spectral_radius: float = 0.9,
    adaptive: bool = False,
    free_step: float | None = None,
    gap_tolerance: float | None = None,
    unresolved: float | None = None,
    velocity_tolerance: float | None = None,
    settings: SimulationSettings = None,
    progress: Progress | None = None,
) -> Result:
    """Run an assembled model in Exudyn's own solver.

    The same model can be run by `mbs.SolveDynamic` directly, with `collect` for its results. This function also checks
    the step, shows progress, keeps the results so far at Ctrl-C, and warns about contacts.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        The model, assembled.
    end_time : float
        Time at which the run ends [s].
    start_time : float, optional
        Time at which the run begins [s], from the model's initial values. Default:
        `settings.timeIntegration.startTime`, which is 0 by default.
    go_on : bool or Result
        Go on from the end of the last run, dynamic or static, as if both were one. Or from the end of this result, also
        one that was read from a file, in another process, for the same model. The run begins at the time of this
        end; after a static run, at `start_time`. It takes the coordinates, velocities and accelerations, and the memory
        of contacts: pairs, rows that stick, plastic strains, multipliers, the energy taken so far. With the same method
        and step, the run is equal to one call, up to round-off. The model's initial values do not change.
    step : float, optional
        Time step [s]. Default: the step of the last run, if this one goes on with the same method. Otherwise 25 steps
        in a period of the highest `f_cut`, and 32 in the first impact as bodies fly at the start
        (`step_control.impact_step`); more if patches are flat. Explicit steps are at most 0.9 of `stability_limit`.
        It is shortened so that the run ends after a whole number of steps.
    method : {"explicit", "implicit"}
        Exudyn's VelocityVerlet or generalized-alpha. Both work with contacts of every formulation, joints and
        prescribed motion. Explicit steps close joints by `central_differences.MultiplierStep`. Joint sensors then
        record mean reactions over the step before. Exudyn's rigid bodies that turn in space have first-order accuracy
        in explicit steps.
    sample_period : float, optional
        Time between samples [s], rounded so that the duration is a multiple of it: samples are equally spaced. Steps
        are shortened so that it is a multiple of them; if it is shorter than a step, each has a sample. If it is longer
        than the run, only start and end have one. Default: every step. The steps of an adaptive run are at most this
        long, and it has samples at the ends of steps.
    spectral_radius : float
        Spectral radius of generalized-alpha at infinity; 1 does not damp.
    adaptive : bool
        Take `step` in impacts and longer steps where less happens: in free flight, as far as the bodies' vibration
        allows, and with implicit steps also in lasting contact, as far as the error of velocities allows. See
        `step_control.StepControl`. The times of the result are then not equally spaced.
    free_step : float, optional
        Longest step of an adaptive run [s]. Default: 100 steps in an impact. Explicit steps are at most 0.9 of the
        stability limit with all contact rows open.
    gap_tolerance : float, optional
        Depth to which a step of an adaptive run may close a gap that was open before [m]. Longer steps are halved.
        Default: the approach in one step in an impact.
    unresolved : float, optional
        Share of the bodies' energy in vibration that an adaptive run need not resolve in free flight. Steps are then
        longer, and damp it. Default: 1e-4.
    velocity_tolerance : float, optional
        Error of velocities that an implicit step of an adaptive run may have in lasting contact, as a share of the
        largest changes of velocity so far; in impacts a twentieth of it. Default, and most: 1e-3. Take 1e-4 for
        histories of forces, or if gentle impacts follow a hard one.
    settings : exudyn.SimulationSettings, optional
        All other settings; the run takes a copy. End, number of steps, spectral radius, period of samples and adaptive
        steps are those of this call. For all else Exudyn's own defaults hold: they solve by dense matrices, and write a
        file with the solution. Default: sparse matrices, no file, and options of Newton's method that suit contacts.
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
        If an option is out of range, or would have no effect. If there is no run to go on from. If a joint is attached
        to a node that was reduced away, or the initial velocities violate a joint or drive. If the model has
        constraints that explicit steps cannot use: those of velocities, or of Euler parameters.
    RunError
        If the model is not assembled, or Exudyn cannot run its first step.

    Warns
    -----
    StoppedRunWarning
        If the run ended early; the result holds all samples until then.
    ModelLimitWarning
        If a body rotated further than its frame allows, or turned by more than a radian in a step. If bodies overlapped
        so much at the start that they fly apart. If they penetrated each other by a depth that is not small beside the
        contact. If a joint was so far open that closing it has a visible effect.
    ContactPatchWarning
        If a contact reached the edge of its patch, or if a corner or edge without a row sank into a rigid surface.
    """
    last = _end_of(mbs, start_time, go_on)
    with interruptible(), started_from(mbs, last):  # from before the first step until the last check of results
        result, open_joints, made = _run(
            mbs,
            last,
            end_time=end_time,
            start_time=start_time,
            step=step,
            method=method,
            sample_period=sample_period,
            spectral_radius=spectral_radius,
            adaptive=adaptive,
            free_step=free_step,
            gap_tolerance=gap_tolerance,
            unresolved=unresolved,
            velocity_tolerance=velocity_tolerance,
            settings=settings,
            progress=progress,
        )
        return reviewed(ReviewedRun(mbs, result, open_joints=open_joints, share_made=made, equal_steps=not adaptive))


def _run(
    mbs: MainSystem,
    last: RunEnd | None,
    *,
    end_time: float,
    start_time: float | None,
    step: float | None,
    method: Integrator,
    sample_period: float | None,
    spectral_radius: float,
    adaptive: bool,
    free_step: float | None,
    gap_tolerance: float | None,
    unresolved: float | None,
    velocity_tolerance: float | None,
    settings: SimulationSettings,
    progress: Progress | None,
) -> tuple[Result, OpenJoints, float]:
    """Run of `solve_dynamic`: the result without a review, the joints that were open at its start, and `share_made`.

    `last` is the end from which the run goes on, if the user chose that.
    """
    exu = require("exudyn")
    validate_choice("method", method, INTEGRATORS)
    validate_flag("adaptive", adaptive)
    spectral_radius = validate_number("spectral_radius", spectral_radius)
    if not 0 <= spectral_radius <= 1:
        raise InputError(f"spectral_radius: expected 0 to 1, got {spectral_radius!r}")
    end_time = validate_positive("end_time", end_time, "s")
    begin_at = start_time if last is None or last.method == "static" else last.t
    begins = partial(_start, begin_at, end_time, settings)
    open_joints = check_start(mbs, settings, progress, begins, judges_velocities=last is None)
    if method == "implicit":
        refuse_drives_by_rates(mbs, settings)
    only_adaptive = {
        "free_step": free_step,
        "gap_tolerance": gap_tolerance,
        "unresolved": unresolved,
        "velocity_tolerance": velocity_tolerance,
    }
    for name, value in only_adaptive.items():
        if value is not None and not adaptive:
            raise InputError(f"{name}: equal steps have none, it is taken only with adaptive=True")
    start = _start(begin_at, end_time, settings)
    step = _checked_step(mbs, last.step if step is None and last and last.method == method else step, method)
    if sample_period is not None:
        sample_period = validate_positive("sample_period", sample_period, "s")
    steps, between = _counts(end_time - start, step, None if adaptive else sample_period)
    step = (end_time - start) / steps
    settings = _own_settings(mbs, method, end_time - (start_time or 0.0)) if settings is None else copy.copy(settings)
    integration = settings.timeIntegration
    # Very short steps do not reach the end, because Exudyn stops early. So there are more, and a hook ends the run.
    # The last step of an adaptive run has only the time that is left, and may be very short.
    beyond = math.ceil(_EARLY / step) if step < _EARLY * (_SHORTER if adaptive else 1) else 0
    if steps + beyond > _MOST_STEPS:
        raise InputError(
            f"end_time: a run of {end_time - start:.4g} s is too short for Exudyn, whose solvers stop 1e-10 s before "
            f"the end; expected at least {_EARLY / _MOST_STEPS:.2g} s"
        )
    integration.startTime = start
    integration.endTime, integration.numberOfSteps = end_time + beyond * step, steps + beyond
    integration.generalizedAlpha.spectralRadius = spectral_radius
    integration.explicit.eliminateConstraints = False  # MultiplierStep closes joints
    settings.solution.sensors.writePeriod = between * step
    control = None
    if adaptive:
        control = _step_control(
            mbs, step, method, free_step, sample_period, gap_tolerance, unresolved, velocity_tolerance
        )
        _warn_of_many_steps(end_time - start, control.longest, method)
        settings.solution.sensors.writePeriod = sample_period or 0.0
        integration.adaptiveStep, integration.minimumStepSize = True, _SHORTEST * step
        # The control makes steps longer; Exudyn only makes failed steps shorter.
        integration.adaptiveStepRecoverySteps = steps
    solver = exu.DynamicSolverType.GeneralizedAlpha
    if method == "explicit":
        solver = exu.DynamicSolverType.VelocityVerlet
        hear_of_verlet()

    end = origin_of(mbs, start, method, last)
    if control is not None and end is not None:
        control.go_on(end.pace)

    _log.info("%s steps of %.4g s to %.6g s, %s", steps, step, end_time, "adaptive" if adaptive else "equal")
    status, message = "finished", f"reached {end_time:.6g} s"
    bar = progress_bar("stepping", after=LONG) if progress is None else contextlib.nullcontext(progress)
    with (
        unless_refused(mbs),
        one_blas_thread(),
        bar as report,
        begun(mbs, start, method),
        accelerated(mbs, end, settings) as accelerations,
        watched(mbs, start, end_time, step, report, accelerations) as watch,
        controlled(mbs, control, settings, end_time),
    ):
        begin = time.perf_counter()
        try:
            mbs.SolveDynamic(settings, solverType=solver)
        except Exception as error:  # Exudyn wraps errors of user functions in its own types
            if not watch.steps:
                raise RunError(f"mbs: Exudyn cannot run the model: {cause(error)}{open_joints}") from error
            said = cause(error)
            more = unsettled(mbs, said) if method == "implicit" else ""
            status, message = "unstable", f"the solver stopped: {said}{more}"
        time_s = time.perf_counter() - begin
    end = keep_end(mbs, control, stopped=status == "unstable")
    result = replace(samples(mbs), end=end, step=step, steps=watch.steps, method=method, time_s=time_s)
    _log.debug("%s steps in %.4g s: %s", watch.steps, time_s, result.work)
    made = 0.0 if control is None else control.share_made
    _log.debug("long steps in contact made %.2g of the energy", made)
    if beyond:  # a run that a hook ends has a sample too many, of the step that was not made
        result = cut(result, int(np.searchsorted(result.t, end_time + _ROUNDING * step)))
    if status == "finished" and end_time - mbs.systemData.GetTime() > 0.5 * step:
        user = f"a PreStep or other user function ended the run at {mbs.systemData.GetTime():.6g} s"
        status, message = "interrupted", "interrupted by the user" if watch.interrupted else user
    elif status == "finished" and progress is not None:
        progress(1.0)
    return replace(result, status=status, message=message), open_joints, made


def _end_of(mbs: MainSystem, start_time: float | None, go_on: bool | Result) -> RunEnd | None:
    """End from which a run goes on; None if it begins anew."""
    if isinstance(go_on, Result):
        validate_model(mbs)
        end = end_for(go_on, mbs)
    elif validate_flag("go_on", go_on):
        validate_model(mbs)
        end = last_end(mbs)
    else:
        return None
    if start_time is not None and end.method != "static":
        raise InputError(
            f"start_time: a run that goes on begins where the last one ended, at {end.t:.6g} s; leave it out"
        )
    return end


def _start(start_time: float | None, end_time: float, settings: SimulationSettings | None) -> float:
    """Time at which the run begins [s]."""
    begins, start = "timeIntegration.startTime", 0.0 if settings is None else float(settings.timeIntegration.startTime)
    if start_time is not None:
        begins, start = "start_time", validate_number("start_time", start_time, "a finite number in s")
    if not start < end_time:
        raise InputError(f"end_time: expected more than {begins}, {start:.6g} s, got {end_time:.6g} s")
    return start


def _count(duration: float, step: float) -> int:
    """Number of equal steps that are not longer than `step` [s]."""
    if not duration / step < _MOST_STEPS:
        raise InputError(
            f"step: {duration:.4g} s in steps of {step:.4g} s are {duration / step:.3g} steps; Exudyn counts to "
            f"{_MOST_STEPS:.3g}. Take longer steps or a shorter end_time"
        )
    return math.ceil(duration / step * (1 - 1e-9))


def _counts(duration: float, step: float, sample_period: float | None) -> tuple[int, int]:
    """Number of equal steps that are not longer than `step` [s], and how many lie between samples, a whole part."""
    if sample_period is None or sample_period <= step:
        return _count(duration, step), 1
    intervals = max(1, round(duration / sample_period))
    between = _count(duration / intervals, step)
    return _count(duration, duration / (intervals * between)), between


def _own_settings(mbs: MainSystem, method: Integrator, duration: float) -> SimulationSettings:
    """Settings for a user who gave none, and a run of some duration [s]."""
    exu = require("exudyn")
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    integration = settings.timeIntegration
    integration.verboseMode = 0
    # Stiff springs on light bodies have round-off above Exudyn's 1e-10, which Newton's method would never reach. Near
    # round-off, a step with an old Jacobian gains little, so that Exudyn would ask for new ones in vain.
    if method == "implicit":
        integration.newton.absoluteTolerance = _ABOVE * residual(mbs, duration)
        # Exudyn finds this small part of the Jacobian of a spring on an interface by differences of all coordinates.
        integration.newton.numericalDifferentiation.jacobianConnectorDerivative = False
    # Where rows open or close, a new Jacobian costs less than the iterations that an old one takes.
    integration.newton.modifiedNewtonContractivity = _CONTRACTIVITY
    # Verlet's accelerations at the end of a step are those of the next one. This option would compute them twice.
    integration.explicit.computeEndOfStepAccelerations = False
    return settings


def _checked_step(mbs: MainSystem, step: float | None, method: Integrator) -> float:
    bodies, _ = partition_items(mbs)
    limit = stability_limit(mbs) if method == "explicit" else float("inf")
    if step is None:
        if not bodies:
            raise InputError("step: the model has no partition body to choose it from; give it [s]")
        by_modes = 1 / (STEPS_A_PERIOD * max(item.body.f_cut for item in bodies))
        return min(SAFETY * limit, by_modes, *_impact_steps(mbs, limit))
    step = validate_positive("step", step, "s")
    if step > limit:
        raise StepSizeError(
            f"step: {step:.4g} s is above the stability limit of explicit integration, {limit:.4g} s (all contact rows "
            f"closed). Take at most {limit:.3g} s, a lower f_cut, a region with larger elements, or method='implicit'"
        )
    return step


def _warn_of_many_steps(duration: float, longest: float, method: Integrator) -> None:
    if duration / longest > _MANY_STEPS:
        remedy = "method='implicit', whose steps stability does not limit" if method == "explicit" else "free_step="
        warn(
            f"adaptive: {duration:.4g} s take at least {duration / longest:.2g} steps, for those in free flight are at "
            f"most {longest:.4g} s, even if the bodies never touch. Take {remedy}, or a shorter end_time",
            ModelLimitWarning,
        )


def _impact_steps(mbs: MainSystem, limit: float) -> Iterator[float]:
    """Steps that resolve each contact's next impact, from the model's initial state [s]."""
    exu, data = require("exudyn"), mbs.systemData
    initial = exu.ConfigurationType.Initial
    q, q_t = data.GetODE2Coordinates(initial), data.GetODE2Coordinates_t(initial)
    q_tt = np.zeros_like(q)
    bodies, contacts = partition_items(mbs)
    for item in bodies:
        weight = np.asarray(mbs.GetObjectParameter(item["oGenericODE2"], "forceVector"))
        if weight.any():
            dofs = np.concatenate([np.r_[s] for s in coordinate_slices(mbs, item)])
            q_tt[dofs] = weight / item.kinematics.mass

    def finite_limit() -> float:
        return limit if math.isfinite(limit) else stability_limit(mbs)

    for contact in contacts:
        at, rate, acceleration = (np.concatenate([x[s] for s in contact.slices(mbs)]) for x in (q, q_t, q_tt))
        yield impact_step(contact, at, rate, acceleration, finite_limit)


def _velocity_tolerance(value: float | None) -> float:
    """Error of velocities that an implicit step in lasting contact may have."""
    value = TOLERANCE if value is None else validate_positive("velocity_tolerance", value, "")
    if value > TOLERANCE:
        raise InputError(
            f"velocity_tolerance: expected at most {TOLERANCE:g}, got {value:.4g}; with larger errors bodies that "
            "chatter in contact never come to rest, and nothing else would show it"
        )
    return value


def _step_control(
    mbs: MainSystem,
    step: float,
    method: Integrator,
    free_step: float | None,
    sample_period: float | None,
    gap_tolerance: float | None,
    unresolved: float | None,
    velocity_tolerance: float | None,
) -> StepControl:
    bodies, contacts = partition_items(mbs)
    longest = LONGEST * step if free_step is None else validate_positive("free_step", free_step, "s")
    if longest < step * (1 - 1e-9):
        raise InputError(f"free_step: expected at least the step in contact, {step:.4g} s, got {longest:.4g} s")
    if gap_tolerance is not None:
        gap_tolerance = validate_positive("gap_tolerance", gap_tolerance, "m")
    unresolved = UNRESOLVED if unresolved is None else validate_positive("unresolved", unresolved, "")
    if method == "explicit":
        if velocity_tolerance is not None:
            raise InputError(
                "velocity_tolerance: explicit steps in contact keep to the stability limit; take method='implicit'"
            )
        longest = min(longest, SAFETY * limit_of(bodies, []))
    else:
        velocity_tolerance = _velocity_tolerance(velocity_tolerance)
    longest = max(step, min(longest, sample_period or math.inf))

    places = joined_slices([own for item in bodies for own in coordinate_slices(mbs, item)])

    def state() -> tuple[Array, Array, Array]:
        data = mbs.systemData
        views = data.GetODE2Coordinates, data.GetODE2Coordinates_t, data.GetODE2Coordinates_tt
        if len(places) == 1:
            q, q_t, q_tt = [get(copy=False)[places[0]].copy() for get in views]
        else:
            q, q_t, q_tt = [np.concatenate([[], *(get(copy=False)[own] for own in places)]) for get in views]
        return q, q_t, q_tt

    runs = runs_of(mbs)

    def run_of(contact: PartitionContact) -> ContactRun:
        return runs.at_work(contact)

    return StepControl(
        contacts,
        bodies,
        state,
        run_of,
        step=step,
        longest=longest,
        gap_tolerance=gap_tolerance,
        unresolved=unresolved,
        velocity_tolerance=velocity_tolerance,
        work=None if method == "explicit" else ContactWork.of(mbs, contacts),
    )
