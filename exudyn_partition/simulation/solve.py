"""Explicit and implicit runs by Exudyn's own solvers, with checks before, progress meanwhile, and results after."""

from __future__ import annotations

import contextlib
import logging
import time
from dataclasses import replace
from typing import Literal, get_args

import numpy as np

from ..algebra.blas_threads import one_blas_thread
from ..contact.formulations.formulation import Integrator
from ..errors import InputError, RunError
from ..exudyn_bodies.model import validate_model
from ..support.checks import validate_choice, validate_flag
from ..support.foreign import MainSystem, SimulationSettings
from ..support.interrupt import interruptible
from ..support.optional import require
from ..support.progress import LONG, Progress
from ..support.progress import progress as progress_bar
from ..support.spelling import spelled
from .adaptive_options import AdaptiveOptions
from .causes import cause, unsettled
from .compiled_limits import check_held
from .compiled_run import run_compiled
from .continuation import RunEnd, keep_end, last_end, set_accelerations, start_from, undo_if_refused
from .hooks import (
    Watch,
    begin_run,
    control_steps,
    hear_of_verlet,
    uncounted_allocations,
    watch_steps,
)
from .result import Result, cut, end_for, samples
from .reviews.review import reviewed
from .reviews.reviewed_run import ReviewedRun
from .run_plan import RunOptions, RunPlan, RunTimes, plan_run

_log = logging.getLogger(__name__)

Solver = Literal["exudyn", "compiled"]
SOLVERS: tuple[Solver, ...] = get_args(Solver)
_ROUNDING = 1e-3  # share of a step: rounding error of the time after very many steps


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
    solver: Solver = "exudyn",
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
    solver : {"exudyn", "compiled"}
        "compiled" makes the same explicit steps in one loop, without Exudyn and without Python between steps, several
        times faster. The result is the same up to round-off. It holds less: partition bodies, their contacts by
        compliance with each other and with rigid planes, spheres and cylinders, gravity, constant loads on coordinates
        and damping of modes; friction on these surfaces, and of bodies in inertial frames with each other. Where pairs
        of two bodies begin to slide with friction, or with `adaptive` in inertial frames, it stops, and Exudyn may go
        on from there. Adaptive steps in free flight are chosen one by one, and cost as much as Exudyn's. Without numba
        it is slow.
    progress : callable, optional
        Called with the share done, 0 to 1: a hundred times, and each second where steps are slow. Default: a bar on the
        terminal, or lines elsewhere, if it takes long; a run of more than some ten seconds says ahead how long.

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
    CompiledRunError
        If a compiled run cannot hold the model or an option; the message lists all reasons.
    RunError
        If the model is not assembled, or its first step cannot be run.

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
    if validate_choice("solver", solver, SOLVERS) == "compiled":
        validate_model(mbs)
        check_held(mbs, _other_options(method, adaptive, sample_period, settings))
    options = RunOptions(
        end_time=end_time,
        start_time=start_time,
        step=step,
        method=method,
        sample_period=sample_period,
        spectral_radius=spectral_radius,
        adaptive=adaptive,
        of_adaptive=AdaptiveOptions(free_step, gap_tolerance, unresolved, velocity_tolerance),
        settings=settings,
    )
    last = _end_of(mbs, start_time, go_on)
    with interruptible(), start_from(mbs, last):  # from before the first step until the last check of results
        plan = plan_run(mbs, options, last, progress)
        if solver == "compiled":
            result, made = run_compiled(mbs, plan, progress), 0.0
        else:
            result, made = _run(mbs, plan, progress)
        return reviewed(
            ReviewedRun(mbs, result, open_joints=plan.open_joints, share_made=made, equal_steps=not adaptive)
        )


def _other_options(method: str, adaptive: bool, sample_period: float | None, settings: SimulationSettings) -> list[str]:
    """Options that a compiled run does not have."""
    given = {
        "method='implicit'": method == "implicit",
        "sample_period with adaptive=True": adaptive and sample_period is not None,
        "settings": settings is not None,
    }
    return [f"option {name}" for name, is_given in given.items() if is_given]


def _run(mbs: MainSystem, plan: RunPlan, progress: Progress | None) -> tuple[Result, float]:
    """Make a run: its result without a review, and `share_made`, see `StepControl`."""
    times, method, control = plan.times, plan.method, plan.control
    if method == "explicit":
        hear_of_verlet()
    earlier, kind = None if plan.origin is None else plan.origin.pace, "equal" if control is None else "adaptive"
    _log.info("%s steps of %.4g s to %.6g s, %s", times.steps, times.step, times.end, kind)
    bar = progress_bar("stepping", after=LONG) if progress is None else contextlib.nullcontext(progress)
    with (
        undo_if_refused(mbs),
        one_blas_thread(),
        bar as report,
        begin_run(mbs, times.start, method),
        set_accelerations(mbs, plan.origin, plan.settings) as accelerations,
        watch_steps(mbs, times.start, times.end, times.step, report, accelerations, renews=plan.renews) as watch,
        control_steps(mbs, control, watch, earlier, plan.settings, times.end),
    ):
        begin = time.perf_counter()
        failure = _steps(mbs, plan, watch)
        time_s = time.perf_counter() - begin
    end = keep_end(mbs, watch.pace and watch.pace.at_end, stopped=bool(failure))
    status, message = _ending(mbs, times, watch, failure)
    result = replace(
        samples(mbs), end=end, step=times.step, steps=watch.steps, method=method, time_s=time_s,
        status=status, message=message,
    )  # fmt: skip
    _log.debug("%s steps in %.4g s: %s", watch.steps, time_s, result.work)
    made = 0.0 if control is None or watch.pace is None else control.share_made(watch.pace)
    _log.debug("long steps in contact made %.2g of the energy", made)
    if times.beyond:  # a run that a hook ends has a sample too many, of the step that was not made
        result = cut(result, int(np.searchsorted(result.t, times.end + _ROUNDING * times.step)))
    if status == "finished" and progress is not None:
        progress(1.0)
    return result, made


def _steps(mbs: MainSystem, plan: RunPlan, watch: Watch) -> str:
    """Let Exudyn make the steps; returns what stopped its solver, if anything did."""
    kinds = require("exudyn").DynamicSolverType
    solver = kinds.VelocityVerlet if plan.method == "explicit" else kinds.GeneralizedAlpha
    try:
        with uncounted_allocations():
            mbs.SolveDynamic(plan.settings, solverType=solver)
    except Exception as error:  # Exudyn wraps errors of user functions in its own types
        said = cause(error)
        if not watch.steps:
            raise RunError(f"mbs: Exudyn cannot run the model: {said}{plan.open_joints}") from error
        more = unsettled(mbs, said) if plan.method == "implicit" else ""
        return f"the solver stopped: {said}{more}"
    return ""


def _ending(mbs: MainSystem, times: RunTimes, watch: Watch, failure: str) -> tuple[str, str]:
    """Status of a run that has ended, and a message on how."""
    if failure:
        return "unstable", failure
    t = mbs.systemData.GetTime()
    if times.end - t <= 0.5 * times.step:
        return "finished", f"reached {times.end:.6g} s"
    if watch.interrupted:
        return "interrupted", "interrupted by the user"
    return "interrupted", f"a PreStep or other user function ended the run at {t:.6g} s"


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
