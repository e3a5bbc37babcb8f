"""Exudyn's user functions around the steps of a run. They call the model's own, which are restored after the run."""

from __future__ import annotations

import contextlib
import functools
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..contact.formulations.formulation import Method
from ..exudyn_bodies.joints import Joints
from ..exudyn_bodies.model import registered, start_of_step, user_function
from ..exudyn_contacts.contact_object import skip_needless_calls
from ..exudyn_contacts.model_run import ModelRun, runs_of
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..exudyn_contacts.slip_secants import SlipSecants
from ..support.arrays import Array
from ..support.foreign import Coordinates, ItemIndex, MainSystem, MatrixContainer, SimulationSettings, UserFunction
from ..support.interrupt import Interrupt, interruptible
from ..support.optional import require
from ..support.progress import LOOK, Progress
from .newton_goal import force_by_depth
from .renewals import Iterations, renew
from .step_control import Pace, Pacing, StepControl

_OVER = 1e-6  # share of a step: a run that has less time left is at its end
_SETTLED = 2  # divided load steps that settle before they are longer again
_FAR = 1e-3  # share of a facet's size: largest motion in an iteration of bodies that springs hold
_FAR_ALONE = 0.2  # share of a body's size: the same where nothing is in contact
_SLOW = 0.1  # rad/s, frequency of bodies on such springs if forces are balanced
_PRESSED = 0.03  # of f_cut: frequency of bodies on such springs if contacts press them from the start
_BALANCED = 1e-6  # share of the first forces that may stay without balance
_ASIDE, _CREEPS = 1e-5, 12  # the same of contact forces, once Newton's method has taken so many iterations
_BALANCED_BY_FACETS = 1e-4  # the same of press fits: facets push bodies that nothing holds along their surfaces


class Watch:
    """State of the hooks around steps: the number of steps, and whether the user asked to stop.

    Attributes
    ----------
    steps : int
    pace : Pacing or None
        What the control of an adaptive run knows.
    """

    def __init__(self, interrupt: Interrupt) -> None:
        self.steps = 0
        self.pace: Pacing | None = None
        self._interrupt = interrupt

    @property
    def interrupted(self) -> bool:
        """Whether the user asked to stop."""
        return self._interrupt.asked


@contextlib.contextmanager
def silence(asked: bool = True) -> Iterator[None]:
    """Keep Exudyn's texts off the terminal, as where a second try may succeed and our own error tells the cause."""
    config = require("exudyn").config
    printed, config.printToConsole = config.printToConsole, config.printToConsole and not asked
    try:
        yield
    finally:
        config.printToConsole = printed


@contextlib.contextmanager
def uncounted_allocations() -> Iterator[None]:
    """Keep back Exudyn's line that user functions allocate memory in every step: contacts are such functions.

    It comes after long runs, and no user can act on it.
    """
    solver: Any = require("exudyn.solver")
    threshold, solver.solverCheckMemoryAllocationsThreshold = solver.solverCheckMemoryAllocationsThreshold, math.inf
    try:
        yield
    finally:
        solver.solverCheckMemoryAllocationsThreshold = threshold


@functools.cache
def hear_of_verlet() -> None:
    """Let Exudyn say, unseen and of a model without coordinates, that its VelocityVerlet is under development.

    It says so once in a process, in the first run. No user can act on it, and no setting keeps back this line alone.
    """
    exu, settings = require("exudyn"), require("exudyn").SimulationSettings()
    settings.solution.file.write, settings.timeIntegration.verboseMode = False, 0
    mbs = exu.SystemContainer().AddSystem()
    mbs.Assemble()
    with silence():
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)


@contextlib.contextmanager
def begin_run(mbs: MainSystem, t: float, method: Method) -> Iterator[None]:
    """Begin a run at time t [s], and give contacts and joints the hooks that explicit steps need.

    Exudyn's explicit solvers ignore algebraic equations, with a warning. So joints are closed here, together with the
    contacts. Exudyn's PostStep function adds the part of multipliers to velocities. It calls the model's own function,
    which is restored after the run.
    """
    exu, jointed = require("exudyn"), method == "explicit" and mbs.systemData.AEsize() > 0
    with runs_of(mbs).open_run(mbs, t, method, Joints(mbs) if jointed else None) as run, skip_needless_calls(mbs, run):
        if run.idle:
            yield
            return
        own_function = user_function(mbs.GetPostStepUserFunction())

        def after_step(mbs: MainSystem, t: float) -> bool:
            run.after_step(mbs, t)
            go_on = own_function is None or own_function(mbs, t)
            run.look_ahead(mbs, t)  # also where the model's own function was set after contacts
            return go_on

        warnings_off, exu.config.suppressWarnings = exu.config.suppressWarnings, exu.config.suppressWarnings or jointed
        mbs.SetPostStepUserFunction(after_step)
        try:
            yield
        finally:
            exu.config.suppressWarnings = warnings_off
            mbs.SetPostStepUserFunction(own_function or 0)


@contextlib.contextmanager
def watch_steps(
    mbs: MainSystem,
    start_time: float,
    end_time: float,
    step: float,
    progress: Progress,
    accelerations: Array | None = None,
    *,
    renews: bool = False,
) -> Iterator[Watch]:
    """Progress and Ctrl-C in Exudyn's PreStep function. It calls the model's own, which is restored after the run.

    `accelerations`, (nq,), are set before the first step, if they are given. With `renews`, Newton's method gets a new
    Jacobian where that saves time, see `renewals`.
    """
    last_start, iterations = None, Iterations()
    own_function = user_function(mbs.GetPreStepUserFunction())
    runs, kinds = runs_of(mbs), require("exudyn").ConfigurationType
    damping = registered(mbs).damping
    next_report, next_look = start_time, time.perf_counter() + LOOK

    def before_step(mbs: MainSystem, t: float) -> bool:
        nonlocal next_report, next_look, last_start, iterations
        if t >= next_report or time.perf_counter() >= next_look:
            next_report, next_look = t + (end_time - start_time) / 100, time.perf_counter() + LOOK
            progress(min((t - start_time) / (end_time - start_time), 1.0))
        start, previous, stop = start_of_step(mbs), last_start, watch.interrupted
        if start > end_time - _OVER * step:
            return False
        if last_start is None and accelerations is not None:
            for configuration in (kinds.StartOfStep, kinds.Current):
                mbs.systemData.SetODE2Coordinates_tt(accelerations, configuration)
        if renews:
            iterations = renew(mbs, iterations)
        run = runs.now(mbs)
        run.unsettled = None
        if run.unsampled and run.others:
            run.others.keep(mbs, start, start_of_step=True)
        if not run.idle:
            run.before_step(mbs, t, joined=False)  # also where the model's own function was set after contacts
        go_on = own_function is None or own_function(mbs, t)
        if damping is not None:
            damping.update(mbs, start)  # after the function, which may have switched joints
        if not run.idle:
            run.before_step(mbs, t, joined=True)  # after the function, which may have moved joints
        watch.steps += start != previous  # steps that are repeated with a shorter length do not count
        last_start = start
        return go_on and not stop  # Exudyn still takes this step, so all its work was done above

    with interruptible() as interrupt:
        watch = Watch(interrupt)
        mbs.SetPreStepUserFunction(before_step)
        try:
            yield watch
        finally:
            mbs.SetPreStepUserFunction(own_function or 0)


@contextlib.contextmanager
def control_steps(
    mbs: MainSystem,
    control: StepControl | None,
    watch: Watch,
    earlier: Pace | None,
    settings: SimulationSettings,
    end_time: float,
) -> Iterator[None]:
    """Let the control choose the steps, by Exudyn's PostStep and PostNewton functions, after the model's own.

    `watch` has its pace, which begins from that of an `earlier` run, if there was one.

    The last step ends at `end_time`, also if Exudyn's own end is later, as for very short runs. PostStep runs at the
    start and after each step. The solver then reads the length of its next step from `it.currentStepSize`. PostNewton
    can ask to repeat the step with a shorter length.
    """
    if control is None:
        yield
        return
    own_after_step, own_after_newton = map(
        user_function, (mbs.GetPostStepUserFunction(), mbs.GetPostNewtonUserFunction())
    )
    refused = 2 * settings.timeIntegration.discontinuous.iterationTolerance
    pace = watch.pace = control.begin(earlier)

    def after_step(mbs: MainSystem, t: float) -> bool:
        nonlocal pace
        it = mbs.sys["dynamicSolver"].it
        pace = watch.pace = control.after_step(pace, it.currentStepSize)
        step = pace.step
        if _OVER * step < end_time - t < step:
            step = end_time - t
        if step != it.currentStepSize:
            it.currentStepSize = step
            mbs.solverSignalJacobianUpdate = True
        return own_after_step is None or own_after_step(mbs, t)

    def after_newton(mbs: MainSystem, t: float) -> list[float]:
        nonlocal pace
        shorter, pace = control.shorter_step(pace, mbs.sys["dynamicSolver"].it.currentStepSize)
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


@contextlib.contextmanager
def keep_apart(mbs: MainSystem, settings: SimulationSettings) -> Iterator[None]:
    """Repeat load steps in which bodies would pass through each other, with a shorter length.

    The model's own function runs first. An open contact has no stiffness. A body on soft springs may then pass the
    other body within one iteration, and would find an equilibrium there.
    """
    exu = require("exudyn")
    own_after_newton = user_function(mbs.GetPostNewtonUserFunction())
    refused = 2 * settings.staticSolver.discontinuous.iterationTolerance
    contacts = [contact for contact in partition_items(mbs)[1] if not contact.mechanics.gaps.carried]

    def after_newton(mbs: MainSystem, t: float) -> list[float]:
        start, now = (
            mbs.systemData.GetODE2Coordinates(kind)
            for kind in (exu.ConfigurationType.StartOfStep, exu.ConfigurationType.Current)
        )
        share = min((_share_of_way(contact, mbs, start, now) for contact in contacts), default=1.0)
        if runs_of(mbs).now(mbs).unsettled is not None:
            share = 0.5
        if share < 1.0:
            return [refused, share * mbs.sys["staticSolver"].it.currentStepSize]
        return [0.0, -1.0] if own_after_newton is None else own_after_newton(mbs, t)

    mbs.SetPostNewtonUserFunction(after_newton)
    try:
        yield
    finally:
        mbs.SetPostNewtonUserFunction(own_after_newton or 0)


@contextlib.contextmanager
def divide_load_steps(mbs: MainSystem, settings: SimulationSettings, start: float, step: float) -> Iterator[ModelRun]:
    """Repeat load steps in which contact forces do not settle, shorter; all load levels remain ends of steps.

    The model's own PostStep function runs first. A level is the end of a load step as the user asked for, from `start`
    in steps of `step`. Lengths double after some steps that settle. Exudyn's own growth would step over levels. Where
    a step was divided, the later ones get a stiffness along slips: without it, bodies that slide at once on several
    contacts would need ever shorter steps.
    """
    static, own_after_step = settings.staticSolver, user_function(mbs.GetPostStepUserFunction())
    run = runs_of(mbs).now(mbs)
    run.divides = True
    if static.loadStepGeometric:
        yield run
        return
    length, planned, settled = step, step, 0

    def after_step(mbs: MainSystem, t: float) -> bool:
        nonlocal length, planned, settled
        go_on, it = own_after_step is None or own_after_step(mbs, t), mbs.sys["staticSolver"].it
        if it.currentStepSize < (1 - _OVER) * planned:  # Exudyn has divided this step
            length, settled = it.currentStepSize, 0
            if run.slip_secants is None:
                run.slip_secants = SlipSecants(lasting=False)
        settled += 1
        if settled >= _SETTLED and length < step:
            length, settled = min(2 * length, step), 0
        left = step * (math.floor((t - start) / step + _OVER) + 1) - (t - start)
        it.currentStepSize = planned = left if left < (1 + _OVER) * length else length
        return go_on

    own_growth, static.adaptiveStepIncrease = static.adaptiveStepIncrease, 1.0
    mbs.SetPostStepUserFunction(after_step)
    try:
        yield run
    finally:
        static.adaptiveStepIncrease = own_growth
        mbs.SetPostStepUserFunction(own_after_step or 0)


@contextlib.contextmanager
def oppose_slips(mbs: MainSystem) -> Iterator[None]:
    """Add a stiffness along slips to the Jacobian of the static run that has begun, see `SlipSecants`."""
    runs_of(mbs).now(mbs).slip_secants = SlipSecants()
    yield


@contextlib.contextmanager
def hold_by_springs(mbs: MainSystem, settings: SimulationSettings) -> Iterator[None]:
    """Hold all bodies by springs in the Jacobian alone, so that a body without other support stays in its place.

    Without springs the system of such a body is singular. Springs without forces do not change the equilibrium. Their
    stiffness is in proportion to the residual, as in the method of Levenberg and Marquardt. So no iteration moves a
    body far. Forces count as balanced if they are below `_BALANCED` of those at the start of the step: contact along
    directions that turn with a body pushes it a little aside. Exudyn would base its tolerance on the largest residual
    of all iterations. Where Newton's method creeps along such a push, the next try bears `_ASIDE` of contact forces.
    Bodies that are pressed together from the start cannot fly apart, so that weak springs do, which change Newton's
    method little.
    """
    items, contacts = partition_items(mbs)
    sizes = (float(np.ptp(item.body.points, axis=0).max()) for item in items)
    facets = min((contact.slave_facet_size for contact in contacts), default=None)
    way = _FAR * facets if facets is not None else _FAR_ALONE * min(sizes, default=1.0)
    newton = settings.staticSolver.newton
    own_after_newton = user_function(mbs.GetPostNewtonUserFunction())
    own_tolerance, own_absolute = newton.relativeTolerance, newton.absoluteTolerance
    refused = 2 * settings.staticSolver.discontinuous.iterationTolerance
    of_overlaps = max((one.mechanics.gaps.placement.overlap * force_by_depth(one) for one in contacts), default=0.0)
    goal = max(own_tolerance, _BALANCED_BY_FACETS if of_overlaps else _BALANCED)
    start, former = _Start(runs_of(mbs).now(mbs), max(own_absolute, goal * of_overlaps)), {}

    def after_newton(mbs: MainSystem, t: float) -> list[float]:
        solver = mbs.sys["staticSolver"]
        if solver.conv.residual > max(goal * start.residual, solver.newton.absoluteTolerance):
            return [refused, 0.5 * solver.it.currentStepSize]
        solver.newton.absoluteTolerance = start.borne  # what a step that creeps bears more does not last
        return [0.0, -1.0] if own_after_newton is None else own_after_newton(mbs, t)

    for item in items:
        number = item["oGenericODE2"]
        former[number] = user_function(mbs.GetObjectParameter(number, "jacobianUserFunction"))
        mass = sp.diags(item.kinematics.mass, format="csr")
        by_residual, least = 1 / (way * item.body.total_mass), _SLOW
        if of_overlaps:
            by_residual, least = 0.0, _PRESSED * 2 * np.pi * item.body.f_cut
        spring = _with_spring(mass, by_residual, least, start, former[number])
        mbs.SetObjectParameter(number, "jacobianUserFunction", spring)
    mbs.SetPostNewtonUserFunction(after_newton)
    newton.relativeTolerance = goal
    newton.absoluteTolerance = start.borne
    try:
        yield
    finally:
        newton.relativeTolerance, newton.absoluteTolerance = own_tolerance, own_absolute
        mbs.SetPostNewtonUserFunction(own_after_newton or 0)
        for number, function in former.items():
            mbs.SetObjectParameter(number, "jacobianUserFunction", function or 0)


@dataclass
class _Start:
    """What Newton's method begins with in a load step of a run.

    Parameters
    ----------
    run : ModelRun
    borne : float
        Residual that each load step may leave [N].
    residual : float
        That at the start of the present one [N].
    """

    run: ModelRun
    borne: float
    residual: float = 0.0

    def look(self, solver: Any) -> None:
        """Look at an iteration of Newton's method; where it creeps, the next tries of this step bear more."""
        if solver.it.newtonSteps == 1:
            self.residual = solver.conv.residual
        if solver.it.newtonSteps == _CREEPS:
            newton, borne = solver.newton, float(np.linalg.norm(self.run.contact_force()))
            newton.absoluteTolerance = max(newton.absoluteTolerance, _ASIDE * borne)


def _with_spring(
    mass: sp.csr_matrix, by_residual: float, least: float, start: _Start, own_function: UserFunction | None
) -> UserFunction:
    """User function for a Jacobian: adds a spring's stiffness to the result of another function.

    The stiffness is `mass`, (n, n), times the square of a frequency. This square grows in proportion to the residual,
    from that of `least` [rad/s].
    """
    container = require("exudyn").MatrixContainer

    def jacobian(
        mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates, fODE2: float, fODE2_t: float
    ) -> MatrixContainer:
        solver = mbs.sys["staticSolver"]
        start.look(solver)
        stiffness = (by_residual * solver.conv.residual + least**2) * fODE2
        if own_function is None:
            return container(stiffness * mass)
        result = own_function(mbs, t, i, q, q_t, fODE2, fODE2_t)
        result.AddSparseMatrix(mass, stiffness)
        return result

    return jacobian


def _share_of_way(contact: PartitionContact, mbs: MainSystem, start: Array, now: Array) -> float:
    """Share of a step, from coordinates `start` to `now`, (n,), after which the slave's patch is one facet deep."""
    gaps = contact.mechanics.for_run("static").gaps
    q_start, q = (np.concatenate([x[s] for s in contact.slices(mbs)]) for x in (start, now))
    places = (gaps.sides.places(at, gaps.growing) for at in (q_start, q))
    moved = [(end - begin).mean(axis=0) for begin, end in zip(*places, strict=True)]
    way = float((moved[0] - sum(moved[1:], np.zeros(3))) @ gaps.placement.approach)
    allowed = max(gaps.surface_gap(q_start), 0.0) + contact.slave_facet_size
    return allowed / way if way > allowed else 1.0
