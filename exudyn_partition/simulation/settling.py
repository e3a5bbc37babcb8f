"""Bodies come to rest on what lies beneath them: they fall or tip, and statics find their equilibrium."""

from __future__ import annotations

import contextlib
import itertools
import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ..errors import InputError, RunError
from ..exudyn_bodies.item_work import Others, all_loads
from ..exudyn_bodies.model import coordinate_slices, registry, validate_model
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..support.arrays import Array
from ..support.checks import validate_items
from ..support.foreign import MainSystem, SimulationSettings
from ..support.interrupt import interruptible
from ..support.optional import require
from ..support.progress import Progress
from ..support.spelling import spelled
from .continuation import keep_end
from .joint_checks import OpenJoints, check_start
from .result import Result, called
from .reviews.review import reviewed
from .reviews.reviewed_run import Finding, ReviewedRun
from .statics import TOUCHING, run_load_steps, static_end, static_start
from .step_control import time_to_contact
from .tipping import tipped

_log = logging.getLogger(__name__)

_MOST_FALLS = 30  # steps in which bodies fall until their gap is a small share of a facet
_STANDING = 1e-6  # the same of bodies that have tipped: from deeper places, friction would hold them as in a wedge
# Springs that hold a resting body begin anew where it has come to rest, until their pull is this share of its weight.
_MOORINGS, _SLACK = (1.0,) * 6, 1e-9
_STIFFER = 1e4, 1e2  # times their stiffness, at first, for a body that finds no rest where it has fallen
_PULLED = 1e-2  # a larger share is no rest
_PUSHED = 1e-4  # largest share of a weight that friction may leave without balance, and nobody is told
_STIFF = 100.0  # square of the springs' frequency, by that of a pendulum


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
    check_start(mbs, settings, progress, partial(static_start, settings), judges_velocities=False)
    data, initial = mbs.systemData, require("exudyn").ConfigurationType.Initial
    start = data.GetODE2Coordinates(initial)
    held = Others.of(mbs).held
    loads = all_loads(mbs, start, static_end(settings))
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
    touching = TOUCHING * min((contact.slave_facet_size for contact in contacts), default=1.0)
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
        result, open_now = run_load_steps(
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
