"""Equilibria with contact by Exudyn's static solver, in load steps."""

from __future__ import annotations

import contextlib
import copy
import itertools
import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ..algebra.blas_threads import one_blas_thread
from ..algebra.products import smallest
from ..errors import ComplementarityError, InputError, RunError
from ..exudyn_bodies.item_work import Others, all_loads
from ..exudyn_bodies.model import coordinate_slices, registry, validate_model
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..support.arrays import Array
from ..support.checks import validate_flag, validate_integer, validate_items
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
from .step_control import time_to_contact
from .tipping import tipped

_log = logging.getLogger(__name__)

_NEUTRAL = 1e-6  # share of f_cut: only round-off holds a motion with a lower frequency
_LEAST_MASS = 1e-12  # share of the mean on the diagonal
_MOST_FALLS, _TOUCHING = 30, 1e-4  # bodies fall in steps until their gap is this share of a facet
_STANDING = 1e-6  # the same of bodies that have tipped: from deeper places, friction would hold them as in a wedge
# Springs that hold a resting body begin anew where it has come to rest, until their pull is this share of its weight.
_MOORINGS, _SLACK = (1.0,) * 6, 1e-9
_STIFFER = 1e4, 1e2  # times their stiffness, at first, for a body that finds no rest where it has fallen
_PULLED = 1e-2  # a larger share is no rest
_PUSHED = 1e-4  # largest share of a weight that friction may leave without balance, and nobody is told
_RELATIVE = 1e-9  # share of the first forces that may stay without balance; a light body bears a tenth of these
_STIFF = 100.0  # square of the springs' frequency, by that of a pendulum
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
        result, open_joints = _run(
            mbs,
            load_steps=load_steps,
            load_factor=load_factor,
            update_initial=update_initial,
            settings=settings,
            progress=progress,
        )
        result = replace(result, end=keep_end(mbs, stopped=result.status == "unstable"))
        return reviewed(ReviewedRun(mbs, result, open_joints), _equilibrium)


def _static_start(settings: SimulationSettings) -> float:
    """Static time at which a run begins [s]."""
    return 0.0 if settings is None else settings.staticSolver.loadStepStart


def _static_end(settings: SimulationSettings) -> float:
    """Static time at which a run ends [s]."""
    return 1.0 if settings is None else _static_start(settings) + settings.staticSolver.loadStepDuration


@spelled
def settle(
    mbs: MainSystem,
    bodies: Sequence[PartitionBody] | None = None,
    *,
    settings: SimulationSettings = None,
    progress: Progress | None = None,
) -> Result:
    """Let bodies rest on what lies beneath them under their weight; the next run begins there, at rest.

    Call it after `mbs.Assemble()`. A body falls without turning, along its gravity, until it touches a rigid surface or
    another body; one that stands on another falls with it. One that does not rest on what it touches first, as on one
    of three feet, tips until it stands, or moves aside, as into a hollow. Then `solve_static` finds the equilibrium of
    all: forces of contacts carry weights and loads, and bodies are as deformed as these make them. Bodies that move, as
    one that will hit those at rest, keep their places and velocities, and have no weight meanwhile. Bodies that joints
    or springs hold, or that loads lift, do not fall; their equilibrium is found too.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        The model, assembled.
    bodies : sequence of PartitionBody, optional
        Bodies that come to rest. Default: all with `gravity=` that do not move at the start.
    settings, progress :
        See `solve_static`.

    Returns
    -------
    Result
        That of the statics; its last sample is the rest.

    Raises
    ------
    InputError
        If no body has gravity, one moves at the start, is of another model, or has nothing beneath it.
    RunError
        As `solve_static`, as where a body would slide or tip over, also by a load.

    Warns
    -----
    StoppedRunWarning, ContactPatchWarning, ModelLimitWarning
        As `solve_static`, and if friction leaves some of a weight without balance. Nothing is said of motions that
        nothing holds, as along a plane without friction: such a body stays where it was placed.

    Examples
    --------
    >>> ball = ep.CreatePartitionBody(mbs, body, gravity=[0, 0, -9.81])
    >>> contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane())
    >>> mbs.Assemble()
    >>> ep.settle(mbs)
    >>> result = ep.solve_dynamic(mbs, end_time=1e-3)
    """
    validate_model(mbs)
    everything, contacts = partition_items(mbs)
    chosen = _resting(mbs, everything, bodies)
    check_start(mbs, settings, progress, partial(_static_start, settings), judges_velocities=False)
    data, initial = mbs.systemData, require("exudyn").ConfigurationType.Initial
    start = data.GetODE2Coordinates(initial)
    held = Others.of(mbs).held
    loads = all_loads(mbs, start, _static_end(settings))
    free = [item for item in everything if id(item) not in held]
    forces = {item: _force(mbs, item, loads) for item in chosen if item in free}
    falling = {item: force for item, force in forces.items() if force @ _way_down(item) > 0}  # no load lifts it
    kept = [item for item in free if item not in chosen]
    fallen = _fallen(mbs, start.copy(), [*falling], contacts)
    options = {"settings": settings, "progress": progress}
    try:
        with interruptible(), _remove_weight(mbs, [item for item in kept if item.weight is not None]):
            result, before, rest, open_joints = _rest(mbs, fallen, falling, kept, contacts, **options)
            pushes = {item: _push(mbs, item, rest - before) for item in falling if _rubs(item, contacts)}
            result = replace(result, end=keep_end(mbs, stopped=result.status == "unstable"))
            result = reviewed(ReviewedRun(mbs, result, open_joints), partial(_creeping, pushes))
        for place in itertools.chain.from_iterable(coordinate_slices(mbs, item) for item in kept):
            rest[place] = start[place]
    except BaseException:
        rest = start
        raise
    finally:
        data.SetODE2Coordinates(rest, initial)
    return result


class _Rest(NamedTuple):
    """Where bodies rest: the last static run, coordinates where it begins and ends, (nq,), and joints open at first."""

    result: Result
    before: Array
    rest: Array
    open_joints: OpenJoints


def _rest(
    mbs: MainSystem,
    fallen: Array,
    falling: Mapping[PartitionBody, Array],
    kept: Sequence[PartitionBody],
    contacts: Sequence[PartitionContact],
    **options: Any,
) -> _Rest:
    """Rest of bodies from coordinates to which they have fallen, (nq,): there, tipped, or beside it, in a hollow.

    Those that are `kept` stay where they are, whatever loads act on them.

    Raises
    ------
    RunError
        That of the first of these, if none is a rest.
    """
    refused = None
    for moved, start, moorings in _starts(mbs, fallen, falling, contacts):
        try:
            found = _rested(mbs, start, [*falling], kept, moorings, **options)
            _refuse_pulled({item: _pull(mbs, item, found.rest - found.before) for item in falling})
        except RunError as error:
            _log.info("no rest where bodies have %s: %s", moved, error)
            refused = refused or error
        else:
            return found
    assert refused is not None
    raise refused


def _starts(
    mbs: MainSystem, fallen: Array, falling: Mapping[PartitionBody, Array], contacts: Sequence[PartitionContact]
) -> Iterator[tuple[str, Array, Sequence[float]]]:
    """Where bodies may find rest: how they have moved there, coordinates, (nq,), and springs, see `_rested`."""
    yield "fallen", fallen, _MOORINGS
    tried = [fallen]
    for slides in (False, True):
        start = _standing(mbs, fallen, falling, contacts, slides=slides)
        if start is not None and not any(np.array_equal(start, other) for other in tried):
            tried.append(start)
            yield "moved aside" if slides else "tipped", start, (*_STIFFER, *_MOORINGS)


def _refuse_pulled(pulls: Mapping[PartitionBody, float]) -> None:
    """Raise if springs, beside what lies beneath, had to hold a body; `pulls` are those of `_pull`."""
    for item, pull in pulls.items():
        if pull > _PULLED:
            raise RunError(
                f"settle: {called(item)} would slide, roll or tip over: what lies beneath it leaves {pull:.1%} of its "
                "weight, or of the moment of it over its size, without balance. Place it where it can rest, give the "
                "contact friction, or hold it by joints or soft springs"
            )


def _creeping(pushes: Mapping[PartitionBody, float], run: ReviewedRun) -> Iterator[Finding]:
    """Bodies that friction does not quite hold; `pushes` are those of `_push`."""
    for item, push in pushes.items():
        if push > _PUSHED:
            yield Finding(
                f"settle: {called(item)} does not quite rest: contact and friction leave a force of {push:.2%} of its "
                "weight without balance, which springs held meanwhile. It will slide in the next run. Give the contact "
                "more friction, place the body where it can rest, or hold it by joints or soft springs"
            )


def _rubs(item: PartitionBody, contacts: Sequence[PartitionContact]) -> bool:
    """Whether a body has a contact with friction. Without any, it stays where it was placed."""
    return any(contact.friction and item in [own for own, _ in contact.sides] for contact in contacts)


def _resting(
    mbs: MainSystem, held_bodies: Sequence[PartitionBody], bodies: Sequence[PartitionBody] | None
) -> list[PartitionBody]:
    """Bodies that come to rest: those chosen, or all with weight that do not move at the start."""
    speeds = mbs.systemData.GetODE2Coordinates_t(require("exudyn").ConfigurationType.Initial)

    def moves(item: PartitionBody) -> bool:
        return any(speeds[place].any() for place in coordinate_slices(mbs, item))

    if bodies is None:
        found = [item for item in held_bodies if item.weight is not None and not moves(item)]
        if not found:
            raise InputError(
                "mbs: no body has a weight and is at rest; give gravity=[0, 0, -9.81] to CreatePartitionBody"
            )
        return found
    for item in validate_items("bodies", bodies, PartitionBody, "CreatePartitionBody()"):
        if item not in held_bodies:
            raise InputError(f"bodies: {called(item)} belongs to another model, or to this one before a Reset")
        if item.weight is None:
            raise InputError(f"bodies: {called(item)} has no weight; give gravity= to CreatePartitionBody")
        if moves(item):
            raise InputError(f"bodies: {called(item)} moves at the start; one that rests has no initial velocity")
    return [*bodies]


def _fallen(mbs: MainSystem, q: Array, falling: Sequence[PartitionBody], contacts: Sequence[PartitionContact]) -> Array:
    """Initial coordinates, (nq,), from which bodies have fallen along their gravity until they touch what is beneath.

    A row that closes at an angle is met in some steps, since its direction changes on the way.
    """
    ways = {item: _way_down(item) for item in falling}
    touching = _TOUCHING * min((contact.slave_facet_size for contact in contacts), default=1.0)
    for _ in range(_MOST_FALLS):
        beneath: dict[PartitionBody, list[tuple[float, PartitionBody | None]]] = {item: [] for item in falling}
        for contact in contacts:
            items = [item for item, _ in contact.sides]
            if len({*items}) < len(items):
                continue
            at = np.concatenate([q[place] for place in contact.slices(mbs)])
            for item in items:
                if item in ways:
                    down = [ways[item] if other == item else np.zeros(other.kinematics.mass.shape) for other in items]
                    distance = time_to_contact(contact, at, np.concatenate(down))  # at a speed of one
                    other = next((one for one in items if one != item), None)
                    beneath[item].append((distance, other if other in ways else None))
        depths = _depths(beneath)
        for item, depth in depths.items():
            if not math.isfinite(depth):
                raise InputError(
                    f"settle: nothing lies beneath {called(item)}; give it a contact with what it rests on, or hold it"
                )
            for place, part in zip(coordinate_slices(mbs, item), _split(ways[item], item), strict=True):
                q[place] += depth * part
        if max(depths.values(), default=0.0) <= touching:
            break
    return q


def _standing(
    mbs: MainSystem,
    q: Array,
    falling: Mapping[PartitionBody, Array],
    contacts: Sequence[PartitionContact],
    *,
    slides: bool,
) -> Array | None:
    """Coordinates, (nq,), to which bodies that have fallen tip or move aside, see `tipped`; None if they do not."""
    touching = _STANDING * min((contact.slave_facet_size for contact in contacts), default=1.0)
    return tipped(mbs, q, falling, contacts, {item: _pendulum(item) for item in falling}, touching, slides=slides)


def _rested(
    mbs: MainSystem,
    q: Array,
    falling: Sequence[PartitionBody],
    kept: Sequence[PartitionBody],
    moorings: Sequence[float],
    *,
    settings: SimulationSettings,
    progress: Progress | None,
) -> _Rest:
    """Last static run of those that find rest from coordinates q, (nq,).

    Each run begins where the last one ended, with springs of that many times the usual stiffness. From q on, springs as
    stiff as contacts keep Newton's method from throwing bodies about while rows close and open.
    """
    data, initial = mbs.systemData, require("exudyn").ConfigurationType.Initial
    before, rest, open_joints = q, q, list[OpenJoints]()
    grips = {item: _grip(item) for item in kept}
    for times in moorings:
        data.SetODE2Coordinates(rest, initial)
        springs = grips | {item: _mooring(item, times) for item in falling}
        result, open_now = _run(
            mbs, partial(_moor, mbs, springs, rest), load_steps=1, load_factor=True, update_initial=True,
            settings=settings, progress=progress,
        )  # fmt: skip
        open_joints.append(open_now)
        before, rest = rest, data.GetODE2Coordinates(initial)
        pulled = max((_pull(mbs, item, rest - before) for item in falling), default=0.0)
        if result.status != "finished" or (times == 1.0 and pulled <= _SLACK):
            break
    return _Rest(result, before, rest, open_joints[0])


def _force(mbs: MainSystem, item: PartitionBody, loads: Array) -> Array:
    """Weight of a body, as its object has it, and its share of the `loads` of a model, (nq,): (n,)."""
    own = np.asarray(mbs.GetObjectParameter(item["oGenericODE2"], "forceVector"), dtype=float)
    return np.asarray(own + np.concatenate([loads[place] for place in coordinate_slices(mbs, item)]))


def _way_down(item: PartitionBody) -> Array:
    """Change of a body's coordinates, (n,), by a motion of 1 m along its gravity."""
    acceleration = item.weight / item.kinematics.mass
    return np.asarray(acceleration / np.linalg.norm(item.kinematics.momentum(acceleration)) * item.body.total_mass)


def _split(values: Array, item: PartitionBody) -> list[Array]:
    """Values of a body's coordinates, (n,), by its nodes."""
    return np.split(values, np.cumsum(item.node_sizes)[:-1])


def _grip(item: PartitionBody) -> Array:
    """Stiffness, (n, n), of springs that hold a body where it is against loads: on rigid motions, as stiff as f_cut."""
    return np.asarray((2 * np.pi * item.body.f_cut) ** 2 * _rigid_mass(item))


def _rigid_mass(item: PartitionBody) -> Array:
    """Mass matrix of the rigid part of a body's motion, (n, n)."""
    kinematics = item.kinematics
    rigid = np.column_stack([kinematics.rigid_part(one) for one in np.eye(len(kinematics.mass))])
    return np.asarray(rigid.T @ (kinematics.mass[:, None] * rigid))


def _mooring(item: PartitionBody, times: float = 1.0) -> Array:
    """Stiffness, (n, n), of springs on all rigid motions of a body except that along its gravity.

    They hold what does not hold the body by itself, as rolling. Their frequency is some times that at which a pendulum
    of the body's size swings, so that a body on a point does not tip over. Springs of several `times` this stiffness
    hold it along its gravity too.
    """
    way, mass = _way_down(item), _rigid_mass(item)
    mass_way = item.kinematics.mass * way
    if times == 1.0:
        mass -= np.outer(mass_way, mass_way) / (way @ mass_way)
    return np.asarray(times * _pendulum(item) * mass)


def _pendulum(item: PartitionBody) -> float:
    """Stiffness of the springs that hold a resting body, over its mass [1/s2]; see `_mooring`."""
    kinematics = item.kinematics
    weight = float(np.linalg.norm(kinematics.momentum(item.weight / kinematics.mass)))
    return _STIFF * weight / (item.body.total_mass * _size(item))


def _size(item: PartitionBody) -> float:
    """Largest extent of a body [m]."""
    return float(np.ptp(item.body.points, axis=0).max())


def _pull(mbs: MainSystem, item: PartitionBody, moved: Array) -> float:
    """Force of the springs by the weight, or their moment by weight and size, after the model's coordinates moved."""
    force, kinematics = _mooring_force(mbs, item, moved), item.kinematics
    weight = float(item.weight @ _way_down(item))
    inertia = np.sqrt(np.maximum(force @ (force / kinematics.mass), 0.0))  # its norm by the mass, as that of the weight
    return float(inertia / (weight / np.sqrt(item.body.total_mass)))


def _push(mbs: MainSystem, item: PartitionBody, moved: Array) -> float:
    """Resultant of the springs by the weight, without their moment, after the model's coordinates moved."""
    kinematics = item.kinematics
    resultant = kinematics.momentum(_mooring_force(mbs, item, moved) / kinematics.mass)
    return float(np.linalg.norm(resultant) / np.linalg.norm(kinematics.momentum(item.weight / kinematics.mass)))


def _mooring_force(mbs: MainSystem, item: PartitionBody, moved: Array) -> Array:
    """Generalised force of a body's springs, (n,), after the model's coordinates moved."""
    q = np.concatenate([moved[place] for place in coordinate_slices(mbs, item)])
    return np.asarray(_mooring(item) @ q)


@contextlib.contextmanager
def _moor(mbs: MainSystem, holding: Mapping[PartitionBody, Array], q: Array) -> Iterator[None]:
    """Hold bodies within the block by springs of these stiffnesses, (n, n), at the model's coordinates q, (nq,)."""
    container, springs, former = require("exudyn").MatrixContainer, registry(mbs).springs, {}
    try:
        for item, spring in holding.items():
            number, stiffness = int(item["oGenericODE2"]), item.as_made["stiffnessMatrix"].csr
            former[number] = stiffness, mbs.GetObjectParameter(number, "forceVector")
            springs[number] = sp.csr_matrix(spring)
            at = np.concatenate([q[place] for place in coordinate_slices(mbs, item)])
            mbs.SetObjectParameter(number, "stiffnessMatrix", container(stiffness + springs[number]))
            own = former[number][1] if np.size(former[number][1]) else 0.0
            mbs.SetObjectParameter(number, "forceVector", own + springs[number] @ at)
        yield
    finally:
        for number, (stiffness, force) in former.items():
            springs.pop(number, None)
            mbs.SetObjectParameter(number, "stiffnessMatrix", container(stiffness))
            mbs.SetObjectParameter(number, "forceVector", force)


def _depths(
    beneath: Mapping[PartitionBody, Sequence[tuple[float, PartitionBody | None]]],
) -> dict[PartitionBody, float]:
    """How far each body falls [m]: the least way to what it meets, which may fall itself.

    `beneath` has the ways to all that a body may meet, with the body met, or None for what does not fall.
    """
    depths = dict.fromkeys(beneath, math.inf)
    for _ in beneath:  # as far as a stack is high
        for item, ways in beneath.items():
            found = [way + (0.0 if other is None else depths[other]) for way, other in ways]
            depths[item] = min([depths[item], *found])
    return depths


@contextlib.contextmanager
def _remove_weight(mbs: MainSystem, items: Sequence[PartitionBody]) -> Iterator[None]:
    """Take the weight of bodies away within the block."""
    numbers = [item["oGenericODE2"] for item in items]
    weights = [mbs.GetObjectParameter(number, "forceVector") for number in numbers]
    for number, weight in zip(numbers, weights, strict=True):
        mbs.SetObjectParameter(number, "forceVector", np.zeros_like(weight))
    try:
        yield
    finally:
        for number, weight in zip(numbers, weights, strict=True):
            mbs.SetObjectParameter(number, "forceVector", weight)


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


def _run(
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
    open_joints = check_start(mbs, settings, progress, partial(_static_start, settings), judges_velocities=False)
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
    pressed = any(contact.mechanics.gaps.overlap for contact in partition_items(mbs)[1])
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
            mechanics, touching = contact.mechanics.for_run("static"), _TOUCHING * contact.slave_facet_size
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
