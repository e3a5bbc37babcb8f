"""Equilibria with contact by Exudyn's static solver, in load steps."""

from __future__ import annotations

import contextlib
import logging
import time
import warnings
from dataclasses import replace

import numpy as np
import scipy.linalg

from ..algebra.blas_threads import one_blas_thread
from ..errors import InputError, ModelLimitWarning, RunError
from ..exudyn_bodies.model import coordinate_slices
from ..exudyn_contacts.partition_contact import partition_items
from ..support.checks import validate_flag, validate_integer
from ..support.foreign import MainSystem, SimulationSettings
from ..support.interrupt import interruptible
from ..support.optional import require
from ..support.progress import LONG, Progress
from ..support.progress import progress as progress_bar
from .continuation import keep_end
from .hooks import begun, cause, held, kept_apart, residual, watched
from .joint_checks import check_start
from .result import Result, called, samples
from .review import noted, reviewed

_log = logging.getLogger(__name__)

_NEUTRAL = 1e-6  # share of f_cut: only round-off holds a motion with a lower frequency
_LEAST_MASS = 1e-12  # share of the mean on the diagonal
_MOST_DENSE = 1000  # largest number of coordinates for this check, which computes all eigenvalues
_REMEDY = (
    "What nothing holds before contact closes has no equilibrium: hold it by joints or soft springs, let bodies touch "
    "at the start, or set settings.staticSolver.stabilizerODE2term. Else take more load_steps; a spring's preload does "
    "not grow with them: give it as a load, and the spring no offset"
)


def solve_static(
    mbs: MainSystem,
    *,
    load_steps: int = 10,
    load_factor: bool = True,
    update_initial: bool = False,
    settings: SimulationSettings = None,
    progress: Progress | None = None,
) -> Result:
    """Find the equilibrium of an assembled model with its contacts, in load steps by Exudyn's static solver.

    Plain `mbs.SolveStatic` works too, with `collect` for its results. This function also checks the model, shows
    progress, keeps the results so far at Ctrl-C, and warns. The static time goes from 0 to 1. With friction, forces
    depend on the path of the loads.

    For natural frequencies about the equilibrium with closed contact, set `update_initial=True`. Then call Exudyn's
    `mbs.ComputeODE2Eigenvalues(convert2Frequencies=True)`. It linearises about the initial state: rows that are closed
    there stay closed.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        The model, assembled. The run begins in its initial state. Bodies without other support must touch another one.
    load_steps : int
        Number of steps. There is a sample of the initial state and one at the end of each step. Exudyn divides steps in
        which Newton's method does not converge.
    load_factor : bool
        Whether all of Exudyn's loads grow in proportion to the static time. If not, they act in full, or by their user
        functions of time. `gravity=` of bodies, springs and prescribed motion never grow by the factor.
    update_initial : bool
        Whether the equilibrium becomes the model's initial state. The next run then begins there: a preload.
    settings : exudyn.SimulationSettings, optional
        All other settings, such as `staticSolver.loadStepStart` and `loadStepDuration`, the static time. Number of load
        steps, load factor and the period of samples are set in it.
    progress : callable, optional
        Called with the share done, 0 to 1. Default: a bar on the terminal, if it takes long.

    Returns
    -------
    Result
        Its `t` is the static time, its `method` is "static".

    Raises
    ------
    InputError
        If an option is out of range, if a joint is open, or if it is attached to a node that was reduced away.
    RunError
        If the model is not assembled, if contacts have multipliers, which act on velocities, or if there is no
        equilibrium in the first load step.

    Warns
    -----
    StoppedRunWarning
        If the run ended early; the result holds the load steps until then.
    ModelLimitWarning
        If nothing holds a body against some motion, so that its place is arbitrary. Also as `solve_dynamic`.
    ContactPatchWarning, YieldWarning
        As `solve_dynamic`.
    """
    with interruptible():
        result = _run(
            mbs,
            load_steps=load_steps,
            load_factor=load_factor,
            update_initial=update_initial,
            settings=settings,
            progress=progress,
        )
        keep_end(mbs)
        with noted() as warned:
            result = reviewed(mbs, result)
            if result.status == "finished":
                _warn_if_neutral(mbs)
        return replace(result, warnings=tuple(warned))


def _run(
    mbs: MainSystem,
    *,
    load_steps: int,
    load_factor: bool,
    update_initial: bool,
    settings: SimulationSettings,
    progress: Progress | None,
) -> Result:
    """Run of `solve_static`; its result has had no review."""
    exu = require("exudyn")
    load_steps = validate_integer("load_steps", load_steps, least=1)
    validate_flag("load_factor", load_factor)
    validate_flag("update_initial", update_initial)
    check_start(mbs, settings, progress)
    if settings is None:
        settings = exu.SimulationSettings()
        settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        settings.solution.file.write = False
        settings.staticSolver.verboseMode = 0
        settings.staticSolver.newton.absoluteTolerance = residual(mbs)
    static = settings.staticSolver
    start, duration = float(static.loadStepStart), float(static.loadStepDuration)
    if not duration > 0:
        raise InputError(f"settings: expected a staticSolver.loadStepDuration above zero, got {duration!r}")
    static.numberOfLoadSteps, static.useLoadFactor = load_steps, load_factor
    settings.solution.sensors.writePeriod = 0.0
    step, end = duration / load_steps, start + duration

    _log.info("%s load steps to %.6g", load_steps, end)
    status, message = "finished", "reached the full load"
    bar = progress_bar("load steps", after=LONG) if progress is None else contextlib.nullcontext(progress)
    with one_blas_thread(), bar as report:

        def attempt(springs: contextlib.AbstractContextManager[None]) -> tuple[int, bool, Exception | None]:
            """Run Exudyn; returns the number of load steps, whether the user asked to stop, and the error."""
            with (
                begun(mbs, start, "static"),
                watched(mbs, start, end, step, report) as watch,
                springs,
                kept_apart(mbs, settings),
            ):
                try:
                    mbs.SolveStatic(settings)
                except Exception as error:  # Exudyn wraps errors of user functions in its own types
                    return watch.steps, watch.interrupted, error
            return watch.steps, watch.interrupted, None

        begin = time.perf_counter()
        steps, interrupted, error = attempt(contextlib.nullcontext())
        if error is not None and steps <= 1 and not interrupted and "terminated due to errors" in cause(error):
            _log.info("no equilibrium in the first load step: again, held by springs without forces")
            steps, interrupted, error = attempt(held(mbs, settings))
        if error is not None and steps <= 1:
            raise RunError(f"mbs: Exudyn finds no equilibrium: {cause(error)}. {_REMEDY}") from error
        if error is not None:
            status, message = "unstable", f"the solver stopped: {cause(error)}. {_REMEDY}"
        time_s = time.perf_counter() - begin
    result = replace(samples(mbs), step=step, steps=steps, method="static", time_s=time_s)
    if status == "finished" and end - mbs.systemData.GetTime() > 0.5 * step:
        user = f"a PreStep or other user function ended the run at {mbs.systemData.GetTime():.6g}"
        status, message = "interrupted", "interrupted by the user" if interrupted else user
    elif status == "finished" and progress is not None:
        progress(1.0)
    if status == "finished" and update_initial:
        mbs.systemData.SetSystemState(mbs.systemData.GetSystemState(), exu.ConfigurationType.Initial)
    return replace(result, status=status, message=message)


def _warn_if_neutral(mbs: MainSystem) -> None:
    """Warn of a body that nothing holds against some motion: round-off determines its place."""
    solver, n = mbs.sys["staticSolver"], mbs.systemData.ODE2Size()
    bodies = partition_items(mbs)[0]
    if not bodies or n + mbs.systemData.AEsize() > _MOST_DENSE:
        return
    solver.ComputeMassMatrix(mbs)
    M = np.array(solver.GetSystemMassMatrix())
    M += _LEAST_MASS * np.trace(M) / n * np.eye(n)  # nodes without mass are fine in statics
    solver.ComputeJacobianODE2RHS(mbs, scalarFactor_ODE2=-1, scalarFactor_ODE2_t=0, scalarFactor_ODE1=0)
    if mbs.systemData.AEsize():
        solver.ComputeJacobianAE(
            mbs, scalarFactor_ODE2=1.0, scalarFactor_ODE2_t=0.0, scalarFactor_ODE1=0.0, velocityLevel=False
        )
    system = np.array(solver.GetSystemJacobian())
    joints = system[len(system) - mbs.systemData.AEsize() :, :n]
    allowed = scipy.linalg.null_space(joints) if len(joints) else np.eye(n)  # SciPy 1.13 accepts no empty matrix
    M, K = (allowed.T @ matrix @ allowed for matrix in (M, system[:n, :n]))
    squares, motions = scipy.linalg.eigh((K + K.T) / 2, M)
    slowest = int(abs(squares).argmin())
    if abs(squares[slowest]) > (_NEUTRAL * 2 * np.pi * max(item.body.f_cut for item in bodies)) ** 2:
        return
    motion = abs(allowed @ motions[:, slowest])
    free = max(bodies, key=lambda item: max(motion[own].max(initial=0.0) for own in coordinate_slices(mbs, item)))
    warnings.warn(
        f"{called(free)}: nothing holds it against some motion, so that its place in this equilibrium is arbitrary, "
        "though forces balance. Hold it by joints or soft springs",
        ModelLimitWarning,
        stacklevel=3,
    )
