"""Equilibria with contact by Exudyn's static solver, in load steps."""

from __future__ import annotations

import contextlib
import copy
import logging
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy.linalg

from ..algebra.blas_threads import one_blas_thread
from ..algebra.products import smallest
from ..errors import ComplementarityError, InputError, RunError
from ..exudyn_bodies.model import coordinate_slices
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import partition_items
from ..support.checks import validate_flag, validate_integer
from ..support.foreign import MainSystem, SimulationSettings
from ..support.interrupt import interruptible
from ..support.optional import require
from ..support.progress import LONG, Progress
from ..support.progress import progress as progress_bar
from ..support.spelling import spelled
from .causes import cause
from .continuation import keep_end, undo_if_refused
from .hooks import (
    begin_run,
    divide_load_steps,
    hold_by_springs,
    keep_apart,
    oppose_slips,
    silence,
    watch_steps,
)
from .joint_checks import OpenJoints, check_start
from .joint_jacobian import turn_reactions
from .modes import ignore_slips, linearised
from .newton_goal import newton_goal
from .result import Result, called, samples
from .reviews.review import reviewed
from .reviews.reviewed_run import Finding, ReviewedRun

_log = logging.getLogger(__name__)

_NEUTRAL = 1e-6  # share of f_cut: only round-off holds a motion with a lower frequency
_LEAST_MASS = 1e-12  # share of the mean on the diagonal
TOUCHING = 1e-4  # share of a facet's size: a smaller gap is none
_RELATIVE = 1e-9  # share of the first forces that may stay without balance; a light body bears a tenth of these
_MOST_DENSE = 1000  # largest number of coordinates for this check, which computes all eigenvalues
_REMEDY = (
    "What nothing holds before contact closes has no equilibrium: hold it by joints or soft springs, let bodies touch "
    "at the start, or set settings.staticSolver.stabilizerODE2term. Nor has a stack that tips over, because the weight "
    "above a face lies beside it, nor a body that slides, because more pushes it along a contact than friction holds. "
    "Else take more load_steps; a spring's preload does not grow with them: give it as a load, and the spring no offset"
)
_FINER = (
    "Shorter load steps did not help. Take a finer mesh of the patches, so that each row has nodes of its own, or less "
    "friction"
)
_SHORTEST = 2.0**-20  # of a load step: no further is it divided
_MOST_NAMED = 4  # contacts in a message
_MEANS = (
    "Rows are means around nodes, so that a convex surface closes its first row later than its lowest point touches: "
    "take smaller facets there. "
)
_FINER_STEPS = 4, 16  # parts of load steps in which a run that has ended too early begins again: friction has a path
_UNSETTLED, _SINGULAR = "terminated due to errors", "Jacobian seems to be singular"  # what Exudyn says then
_THROWN = "are not finite"  # what contacts say of bodies that Newton's method has thrown far away
_PARTS = 16  # of a load step: shortest one of a press fit before bodies are held by springs without forces
_PARTS_HELD = 256  # the same of bodies that are held so: what comes to lie on its first row needs short ones
_PRESSED = (
    "In a press fit, hold one body wholly; contact without friction does not hold the other one along and around the "
    "axis, where facets push it aside"
)


@spelled
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
    depend on the path of the loads. Overlaps of contacts with `interference=` close in proportion to the static time,
    unless the model already is in the state in which a run has closed them.

    All bodies are at rest in it, so that dampers and inertia give no force. Velocities of the initial state remain
    there, and a dynamic run begins with them.

    For natural frequencies about the equilibrium with closed contact, set `update_initial=True`. Then call
    `natural_modes`.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        The model, assembled. The run begins in its initial state. Bodies without other support must touch another one.
    load_steps : int
        Number of steps. There is a sample of the initial state and one at the end of each step. A step in which
        Newton's method or contact forces do not settle is halved, again and again, down to a millionth. Lengths grow
        again where two shorter steps have settled. If that does not help, the run begins again, with 4 and then 16
        times as many load steps. Samples of shorter steps come in addition.
    load_factor : bool
        Whether all of Exudyn's loads grow in proportion to the static time. If not, they act in full, or by their user
        functions of time. `gravity=` of bodies, springs and prescribed motion never grow by the factor.
    update_initial : bool
        Whether the equilibrium becomes the model's initial state. The next run then begins there: a preload.
    settings : exudyn.SimulationSettings, optional
        All other settings, such as `staticSolver.loadStepStart` and `loadStepDuration`, the static time; the run takes
        a copy. Number of load steps, load factor and the period of samples are those of this call.
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
        result, open_joints = run_load_steps(
            mbs,
            load_steps=load_steps,
            load_factor=load_factor,
            update_initial=update_initial,
            settings=settings,
            progress=progress,
        )
        result = replace(result, end=keep_end(mbs, stopped=result.status == "unstable"))
        return reviewed(ReviewedRun(mbs, result, open_joints), _equilibrium)


def static_start(settings: SimulationSettings) -> float:
    """Static time at which a run begins [s]."""
    return 0.0 if settings is None else settings.staticSolver.loadStepStart


def static_end(settings: SimulationSettings) -> float:
    """Static time at which a run ends [s]."""
    return 1.0 if settings is None else static_start(settings) + settings.staticSolver.loadStepDuration


@dataclass(frozen=True, eq=False)
class _Plan:
    """A static run before its first load step.

    Parameters
    ----------
    settings : exudyn.SimulationSettings
        Exudyn's settings, of this run alone.
    load_steps : int
    start, end, step : float
        Static time.
    pressed : bool
        Whether overlaps of contacts close in it.
    springs : callable
        Returns a context in which the model is held.
    """

    settings: SimulationSettings
    load_steps: int
    start: float
    end: float
    step: float
    pressed: bool
    springs: Callable[[], contextlib.AbstractContextManager[None]]


class _Attempt(NamedTuple):
    """What Exudyn has made of a static run: load steps, whether the user asked to stop, and the error that ended it."""

    steps: int
    interrupted: bool
    error: Exception | None


def run_load_steps(
    mbs: MainSystem,
    springs: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext,
    *,
    load_steps: int,
    load_factor: bool,
    update_initial: bool,
    settings: SimulationSettings,
    progress: Progress | None,
) -> tuple[Result, OpenJoints]:
    """Run of `solve_static`, and joints open at its start. It has had no review; `springs` hold the model meanwhile."""
    load_steps = validate_integer("load_steps", load_steps, least=1)
    validate_flag("load_factor", load_factor)
    validate_flag("update_initial", update_initial)
    open_joints = check_start(mbs, settings, progress, partial(static_start, settings), judges_velocities=False)
    plan = _planned(mbs, springs, load_steps, load_factor, settings)

    _log.info("%s load steps to %.6g", load_steps, plan.end)
    bar = progress_bar("load steps", after=LONG) if progress is None else contextlib.nullcontext(progress)
    quiet = silence(plan.settings.staticSolver.verboseMode == 0)
    with undo_if_refused(mbs), one_blas_thread(), _stop_bodies(mbs), quiet, bar as report:
        begin = time.perf_counter()
        made = _best_attempt(mbs, plan, partial(_attempt, mbs, plan, report))
        if made.error is not None and made.steps <= 1:
            said = f"{cause(made.error)}. {_open_at_start(mbs)}{_remedy(plan, made.error)}"
            raise RunError(f"mbs: Exudyn finds no equilibrium: {said}{open_joints}") from made.error
        status, message = _ending(mbs, plan, made)
        time_s = time.perf_counter() - begin
    result = replace(samples(mbs), step=plan.step, steps=made.steps, method="static", time_s=time_s)
    if status == "finished" and progress is not None:
        progress(1.0)
    if status == "finished" and update_initial:
        initial = require("exudyn").ConfigurationType.Initial
        mbs.systemData.SetSystemState(mbs.systemData.GetSystemState(), initial)
    return replace(result, status=status, message=message), open_joints


def _planned(
    mbs: MainSystem,
    springs: Callable[[], contextlib.AbstractContextManager[None]],
    load_steps: int,
    load_factor: bool,
    settings: SimulationSettings,
) -> _Plan:
    """Plan a static run of some load steps, by the user's settings or our own."""
    settings = _default_settings(mbs, load_steps) if settings is None else copy.copy(settings)
    static = settings.staticSolver
    start, duration = float(static.loadStepStart), float(static.loadStepDuration)
    if not duration > 0:
        raise InputError(f"settings: expected a staticSolver.loadStepDuration above zero, got {duration!r}")
    static.useLoadFactor, settings.solution.sensors.writePeriod = load_factor, 0.0
    pressed = any(contact.mechanics.gaps.placement.overlap for contact in partition_items(mbs)[1])
    return _Plan(settings, load_steps, start, start + duration, duration / load_steps, pressed, springs)


def _default_settings(mbs: MainSystem, load_steps: int) -> SimulationSettings:
    """Settings for a user who gave none."""
    exu = require("exudyn")
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    settings.staticSolver.verboseMode = 0
    settings.staticSolver.adaptiveStepDecrease = 0.5
    settings.staticSolver.minimumStepSize = _SHORTEST / load_steps
    newton = settings.staticSolver.newton
    newton.adaptInitialResidual = False  # else a huge residual on the way would count as the first forces
    newton.absoluteTolerance = newton_goal(mbs)
    if all(contact.mechanics.zones is None for contact in partition_items(mbs)[1]):
        newton.relativeTolerance = _RELATIVE  # forces of plastic zones are not known as closely
    return settings


def _attempt(
    mbs: MainSystem,
    plan: _Plan,
    report: Progress,
    more: contextlib.AbstractContextManager[None] | None = None,
    parts: int = 1,
) -> _Attempt:
    """Run Exudyn, with each load step in some parts, and within one more context."""
    static = plan.settings.staticSolver
    static.numberOfLoadSteps = parts * plan.load_steps
    with (
        begin_run(mbs, plan.start, "static"),
        watch_steps(mbs, plan.start, plan.end, plan.step, report) as watch,
        divide_load_steps(mbs, plan.settings, plan.start, plan.step / parts) as run,
        plan.springs(),
        turn_reactions(mbs),
        more or contextlib.nullcontext(),
        keep_apart(mbs, plan.settings),
    ):
        try:
            mbs.SolveStatic(plan.settings)
        except Exception as error:  # Exudyn wraps errors of user functions in its own types
            return _Attempt(watch.steps, watch.interrupted, run.unsettled or error)
    return _Attempt(watch.steps, watch.interrupted, None)


def _best_attempt(mbs: MainSystem, plan: _Plan, attempt: Callable[..., _Attempt]) -> _Attempt:
    """Try again where there is no equilibrium: with helps for Newton's method, and with finer load steps."""
    made = attempt(_limit_division(plan.settings, plan.step / _PARTS) if plan.pressed else None)
    for how, more, said in _helps(mbs, plan):
        again = made.error is not None and (plan.pressed or made.steps <= 1) and not made.interrupted
        if again and made.error is not None and any(text in cause(made.error) for text in said):
            _log.info("no equilibrium: again, %s", how)
            made = attempt(more)
    for parts in _FINER_STEPS:
        if made.error is None or made.steps <= 1 or made.interrupted or not _settles_later(made.error):
            break
        _log.info("load steps end without an equilibrium: again, in %s parts each", parts)
        made = attempt(parts=parts)
    return made


def _helps(
    mbs: MainSystem, plan: _Plan
) -> Iterator[tuple[str, contextlib.AbstractContextManager[None], tuple[str, ...]]]:
    """Contexts in which Newton's method may find an equilibrium, with their names, and the errors that they help."""
    if any(contact.mechanics.friction is not None for contact in partition_items(mbs)[1]):
        yield "with a stiffness along slips", oppose_slips(mbs), (_UNSETTLED, _SINGULAR)
    yield "held by springs without forces", _held(mbs, plan), (_UNSETTLED, _THROWN)


@contextlib.contextmanager
def _held(mbs: MainSystem, plan: _Plan) -> Iterator[None]:
    """Hold bodies by springs without forces. What slides even so does not settle in much shorter load steps."""
    with _limit_division(plan.settings, plan.step / _PARTS_HELD), hold_by_springs(mbs, plan.settings):
        yield


def _open_at_start(mbs: MainSystem) -> str:
    """Sentence that names the contacts that are open where the run began, and by how much; empty if there are none.

    A surface may touch although all rows are open: on a convex tip these are means around nodes.
    """
    q = mbs.systemData.GetODE2Coordinates(require("exudyn").ConfigurationType.Initial)
    said, above_tips = [], False
    for contact in partition_items(mbs)[1]:
        if not contact.mechanics.gaps.carried:
            own = np.concatenate([q[place] for place in contact.slices(mbs)])
            mechanics, touching = contact.mechanics.for_run("static"), TOUCHING * contact.slave_facet_size
            gap, of_rows = mechanics.gaps.surface_gap(own), smallest(mechanics.gap_at(own)) - mechanics.reach
            if touching < gap < math.inf:
                said.append(f"{contact.name!r} by {gap:.3g} m")
            elif touching < of_rows < math.inf:
                said.append(f"{contact.name!r} by {of_rows:.3g} m in its first row, though surfaces touch")
                above_tips = True
    if not said:
        return ""
    named = said if len(said) <= _MOST_NAMED else [*said[:_MOST_NAMED], f"{len(said) - _MOST_NAMED} more"]
    return f"Open at the start: contact {', '.join(named)}. {_MEANS if above_tips else ''}"


def _remedy(plan: _Plan, error: Exception) -> str:
    """What the user may do about an error that ended a static run."""
    if isinstance(error, ComplementarityError):
        return _FINER
    return f"{_REMEDY}. {_PRESSED}" if plan.pressed else _REMEDY


def _ending(mbs: MainSystem, plan: _Plan, made: _Attempt) -> tuple[str, str]:
    """Status of a run that has ended, and a message on how."""
    if made.error is not None:
        return "unstable", f"the solver stopped: {cause(made.error)}. {_remedy(plan, made.error)}"
    t = mbs.systemData.GetTime()
    if plan.end - t <= 0.5 * plan.step:
        return "finished", "reached the full load"
    if made.interrupted:
        return "interrupted", "interrupted by the user"
    return "interrupted", f"a PreStep or other user function ended the run at {t:.6g}"


def _settles_later(error: Exception) -> bool:
    """Whether a run that ended with this error may succeed with shorter load steps from its start."""
    return isinstance(error, ComplementarityError) or _UNSETTLED in cause(error)


@contextlib.contextmanager
def _stop_bodies(mbs: MainSystem) -> Iterator[None]:
    """Begin with all velocities zero within the block; after it, the initial and the last states have them again."""
    data, configurations = mbs.systemData, require("exudyn").ConfigurationType
    speeds = data.GetODE2Coordinates_t(configurations.Initial)
    data.SetODE2Coordinates_t(np.zeros_like(speeds), configurations.Initial)
    try:
        yield
    finally:
        for state in (configurations.Initial, configurations.Current, configurations.StartOfStep):
            data.SetODE2Coordinates_t(speeds, state)


@contextlib.contextmanager
def _limit_division(settings: SimulationSettings, least: float) -> Iterator[None]:
    """Divide load steps no further than to a length: a body that nothing holds does not settle in shorter ones."""
    static = settings.staticSolver
    former, static.minimumStepSize = static.minimumStepSize, max(least, static.minimumStepSize)
    try:
        yield
    finally:
        static.minimumStepSize = former


def _unstable(pressed: Sequence[PartitionBody]) -> str:
    """What to do about an unstable equilibrium; `pressed` bodies have geometric stiffness."""
    if not pressed:
        return (
            "This equilibrium is unstable, as that of a link that stands on its hinge. Start nearer to the stable one, "
            "or let a dynamic run with damping find it"
        )
    return (
        f"{' and '.join(called(item) for item in pressed)}: this equilibrium is unstable, compression has buckled "
        "what should hold it. Lower the load. To find the bent shape, add a small force across, and take more "
        "load steps"
    )


def _equilibrium(run: ReviewedRun) -> Iterator[Finding]:
    """Equilibrium in which nothing holds a body against some motion, or which no body keeps."""
    mbs, bodies = run.mbs, run.result.bodies
    n = mbs.systemData.ODE2Size()
    if run.result.status != "finished" or not bodies or n + mbs.systemData.AEsize() > _MOST_DENSE:
        return
    least = (_NEUTRAL * 2 * np.pi * max(item.body.f_cut for item in bodies)) ** 2
    pressed = [item for item in bodies if item.body.stiffening is not None]
    for reactions in (bool(pressed), True):  # which take long, and seldom decide
        with ignore_slips():
            M, K, allowed = linearised(mbs, mbs.sys["staticSolver"], reactions)
        M += _LEAST_MASS * np.trace(M) / n * np.eye(len(M))  # nodes without mass are fine in statics
        squares, motions = scipy.linalg.eigh((K + K.T) / 2, M)
        if reactions or squares[0] > least:
            break
    # The stiffness of friction is not symmetric, and tells nothing.
    if squares[0] < -least and not run.contacts:
        yield Finding(_unstable(pressed))
        return
    slowest = int(abs(squares).argmin())
    if abs(squares[slowest]) > least:
        return
    motion = abs(allowed @ motions[:, slowest])
    free = max(bodies, key=lambda item: max(motion[place].max(initial=0.0) for place in coordinate_slices(mbs, item)))
    yield Finding(
        f"{called(free)}: nothing holds it against some motion, so that its place in this equilibrium is arbitrary, "
        "though forces balance. Hold it by joints or soft springs"
    )
