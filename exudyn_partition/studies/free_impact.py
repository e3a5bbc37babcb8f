"""One free impact in Exudyn, and what a rigid code has to know of it: restitution, friction, and where energy went."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..contact.rigid import RigidSurface
from ..errors import CompiledRunError, InputError, PartitionError, PartitionWarning
from ..exudyn_bodies.create_body import CreatePartitionBody
from ..exudyn_bodies.model import coordinate_slices
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.contact_replay import force_centres
from ..exudyn_contacts.create_contact import CreatePartitionContact
from ..exudyn_contacts.partition_contact import PartitionContact
from ..frames.kinematics import Frame
from ..reduction.body import ReducedBody
from ..results.impacts import SubImpact
from ..simulation.compiled_limits import check_held
from ..simulation.result import Result
from ..simulation.solve import Solver, solve_dynamic
from ..simulation.step_control import time_to_contact
from ..support.arrays import Array
from ..support.foreign import MainSystem
from ..support.optional import require
from ..support.warn import warn
from .impact_setup import Pair, Point, approach, sideways

QUANTITIES = {
    "restitution": "1",
    "tangential_restitution": "1",
    "impulse_ratio": "1",
    "centre_tangential": "1",
    "rebound_angle": "rad",
    "spin": "rad/s",
    "contacts": "1",
    "contact_time": "s",
    "span": "s",
    "peak_force": "N",
    "impulse": "N s",
    "rigid_share": "1",
    "vibration_first": "1",
    "vibration_second": "1",
    "plastic_share": "1",
    "friction_share": "1",
    "contact_share": "1",
    "balance": "1",
    "over": "1",
}
_TWICE = 3  # times that an impact is watched twice as long, if more contacts may come
_STANDS = 1e-9  # of the speed: a tangential speed that is none
_LONGEST_FLIGHT = 10  # times the time that an impact is watched
_STEPS_AHEAD = 4  # before the first touch, so that the run begins with an open contact


def free_impact(
    pair: Pair, point: Point, along: Array | None, duration: float, largest_turn: float = 0.0
) -> dict[str, float]:
    """Run one impact until no contact can follow.

    Where frames that do not move are near enough, and compiled steps hold the impact, it is run so; else in floating
    frames, by compiled steps where they hold it, and by Exudyn where not.

    Parameters
    ----------
    pair : (ReducedBody, ReducedBody or rigid surface)
    point : Point
    along : (3,) array or None
        Direction of the motion along the surface.
    duration : float
        Time to watch after the first touch, at first [s].
    largest_turn : float
        Angle that bodies may turn by until the last contact opens, if their frames do not move [rad].

    Returns
    -------
    dict of str to float
        `QUANTITIES`, nan where one is not defined; and "compiled", 1 if compiled steps have found them.

    Warns
    -----
    PartitionWarning
        As the last of its runs does; shorter ones are not told of.
    """
    hardly, compiled, quantities = largest_turn > 0.0, True, dict[str, float]()
    for again in range(_TWICE + 1):
        lasts = duration * 2**again
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            by_steps = _hardly_turning(pair, point, along, lasts, largest_turn) if hardly else None
        if by_steps is None:
            hardly = False
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                run = _watched(pair, point, along, lasts, "floating")
                by_steps, compiled = _measured(run, point), run.compiled
        quantities = by_steps
        if quantities["over"]:
            break
    for told in caught:
        if issubclass(told.category, PartitionWarning):
            warn(str(told.message), told.category)
    return quantities | {"compiled": float(compiled)}


def _hardly_turning(
    pair: Pair, point: Point, along: Array | None, duration: float, largest_turn: float
) -> dict[str, float] | None:
    """What follows from compiled steps in frames that do not move, over this time [s].

    None if these cannot hold the impact, or bodies turn too far.
    """
    try:
        run = _watched(pair, point, along, duration, "inertial")
    except PartitionError:  # if the impact is wrong itself, Exudyn's run tells
        return None
    if run.impacts and _turned(run, run.impacts[-1].end) > largest_turn:
        return None
    quantities = _measured(run, point)
    # Pairs slide as bodies fly apart aside; then no contact may follow.
    return quantities if run.result.status == "finished" or quantities["over"] else None


def _turned(run: _Watched, end: float) -> float:
    """Largest angle by which a body, whose frame does not move, turns until a time [s]: [rad]."""
    both = run.result.at(run.result.t[[0, min(int(np.searchsorted(run.result.t, end)), len(run.result.t) - 1)]])
    motions = [item.kinematics.rigid_motion(item.coordinates(both))[:, 3:] for item in run.items]
    return max(float(np.linalg.norm(after - before)) for before, after in motions)


@dataclass(frozen=True, eq=False)
class _Watched:
    """A run of an impact, with its model; the first body flies along `normal`, and aside along `beside`.

    `compiled` is whether compiled steps have made it.
    """

    result: Result
    compiled: bool
    items: list[PartitionBody]
    contact: PartitionContact
    normal: Array
    beside: Array

    @cached_property
    def impacts(self) -> list[SubImpact]:
        """Times of contact."""
        return self.contact.impacts(self.result)


def _watched(pair: Pair, point: Point, along: Array | None, duration: float, frame: Frame) -> _Watched:
    """Run an impact for this time after the first touch [s].

    In frames that do not move it is compiled. In floating ones it is where compiled steps hold it, else by Exudyn.

    Raises
    ------
    CompiledRunError
        If compiled steps cannot hold it in frames that do not move.
    """
    normal = approach(pair)
    beside = sideways(normal, along)
    velocity = point.speed * (math.cos(point.angle) * normal + math.sin(point.angle) * beside)
    mbs = require("exudyn").SystemContainer().AddSystem()
    first, second = pair
    # It begins apart, by some steps of the highest frequency, so that the start of the contact is seen.
    clearance = _STEPS_AHEAD * float(velocity @ normal) / (25 * first.f_cut)
    apart = -clearance * normal
    items = [
        CreatePartitionBody(mbs, first, name="first", frame=frame, referencePosition=apart, initialVelocity=velocity)
    ]
    if isinstance(second, ReducedBody):
        items.append(CreatePartitionBody(mbs, second, name="second", frame=frame))
    partner: PartitionBody | RigidSurface = items[1] if isinstance(second, ReducedBody) else second
    contact = CreatePartitionContact(mbs, items[0], partner, friction=point.friction or None, name="contact")
    mbs.Assemble()
    data, initial = mbs.systemData, require("exudyn").ConfigurationType.Initial
    places = [part for item, _ in contact.sides for part in coordinate_slices(mbs, item)]
    q, q_t = (
        np.concatenate([np.asarray(get(initial))[part] for part in places])
        for get in (data.GetODE2Coordinates, data.GetODE2Coordinates_t)
    )
    flight = time_to_contact(contact, q, q_t)
    if not flight < _LONGEST_FLIGHT * duration:
        raise InputError(
            f"bodies: expected a pair that touches as it is placed, or nearly so; flying along {normal.round(6)}, the "
            f"first body needs {flight:.3g} s until it touches"
        )
    held, end = frame == "inertial" or _is_held(mbs), duration + flight
    solver: Solver = "compiled" if held else "exudyn"
    result = solve_dynamic(mbs, end_time=end, solver=solver, progress=lambda share: None)
    return _Watched(result, held, items, contact, normal, beside)


def _is_held(mbs: MainSystem) -> bool:
    """Whether compiled runs hold a model."""
    try:
        check_held(mbs)
    except CompiledRunError:
        return False
    return True


def _measured(run: _Watched, point: Point) -> dict[str, float]:
    """`QUANTITIES` of a run."""
    result, items, contact, normal, beside = run.result, run.items, run.contact, run.normal, run.beside
    force, impacts = contact.force(result), run.impacts
    if not impacts:
        return dict.fromkeys(QUANTITIES, math.nan) | {"contacts": 0.0, "over": 0.0}
    ends = result.at(result.t[[0, -1]])
    closed, span = np.flatnonzero(force), (impacts[0].start, impacts[-1].end)
    centres = force_centres(contact, result, force, (closed[0], int(force.argmax()), closed[-1]), span, normal)
    assert centres is not None  # these contacts know their forces
    # Bodies that spin carry other points of theirs through the centre later, whose velocities are others.
    opened = min(int(np.searchsorted(result.t, span[1])), len(result.t) - 1)
    moments = result.at(result.t[[0, opened]])  # before and after
    velocity = np.array([relative_velocity(items, moments, centre)[i] for i, centre in enumerate(centres)])
    middles = [item.momentum(ends) / item.body.total_mass for item in items]
    middle = middles[0] - sum(middles[1:])
    tangential = velocity @ beside
    spin = rigid_spin(items[0], ends) @ np.cross(normal, beside)
    impulse = np.trapezoid(force, result.t)
    friction = contact.friction
    along = np.trapezoid(friction.tangential_force(result) @ beside, result.t) if friction else 0.0
    sign = 1.0 if contact.slave == items[0] else -1.0
    quantities = {
        "restitution": -(velocity[1] @ normal) / (velocity[0] @ normal),
        "tangential_restitution": -speed_ratio(tangential[1], tangential[0], point.speed),
        "impulse_ratio": -sign * along / impulse,
        "centre_tangential": speed_ratio(middle[1] @ beside, middle[0] @ beside, point.speed),
        "rebound_angle": math.atan2(middle[1] @ beside, -(middle[1] @ normal)),
        "spin": spin,
        "contacts": len(impacts),
        "contact_time": sum(impact.end - impact.start for impact in impacts),
        "span": impacts[-1].end - impacts[0].start,
        "peak_force": force.max(),
        "impulse": impulse,
        **_shares(items, contact, result, ends),
        "over": is_over(items, contact, ends, normal),
    }
    return {key: float(quantities[key]) for key in QUANTITIES}


def relative_velocity(items: list[PartitionBody], result: Result, point: Array) -> Array:
    """Velocity of the first body at a point of space, (3,), against the second one or space, (n, 3) [m/s].

    The bodies count as rigid ones with their momenta.
    """
    motions = [
        item.kinematics.mean_velocity(item.coordinates(result), item.coordinates_t(result), point) for item in items
    ]
    velocity: Array = motions[0] - sum(motions[1:])
    return velocity


def speed_ratio(after: float, before: float, speed: float) -> float:
    """After over before; nan if before is nothing beside the speed."""
    return after / before if abs(before) > _STANDS * speed else math.nan


def rigid_spin(item: PartitionBody, ends: Result) -> Array:
    """Angular velocity of the body as a rigid one at the end, (3,) [rad/s]."""
    q, q_t = item.coordinates(ends)[1], item.coordinates_t(ends)[1]
    at = [item.kinematics.mean_velocity(q, q_t, place) for place in (np.zeros(3), *np.eye(3))]
    turns = np.array(at[1:]) - at[0]  # rows: omega x e_i
    spin: Array = np.array([turns[1, 2], turns[2, 0], turns[0, 1]])
    return spin


def _shares(items: list[PartitionBody], contact: PartitionContact, result: Result, ends: Result) -> dict[str, float]:
    """Where the energy of the start is at the end, by its amount."""
    energy = [item.energy(ends) for item in items]
    start, vibration = sum(e[0] for e in energy), [vibration_energy(item, ends)[1] for item in items]
    rigid = sum(e[1] for e in energy) - sum(vibration)
    plastic = contact.plastic.work(result)[-1] if contact.plastic else 0.0
    friction = contact.friction.work(result)[-1] if contact.friction else 0.0
    stored = contact.energy(ends)[1]  # by residual stress, if it yields
    return {
        "rigid_share": rigid / start,
        "vibration_first": vibration[0] / start,
        "vibration_second": vibration[1] / start if len(items) == 2 else 0.0,
        "plastic_share": plastic / start,
        "friction_share": friction / start,
        "contact_share": stored / start,
        "balance": (rigid + sum(vibration) + plastic + friction + stored) / start - 1,
    }


def vibration_energy(item: PartitionBody, result: Result) -> Array:
    """Energy of the body beyond that of a rigid one with its momenta, (n,) [J]."""
    q, q_t = item.coordinates(result), item.coordinates_t(result)
    rigid = np.array([item.kinematics.rigid_part(v) for v in q_t])
    vibration: Array = item.energy(result) - item.kinematics.kinetic_energy(q, rigid)
    return vibration


def is_over(items: list[PartitionBody], contact: PartitionContact, result: Result, normal: Array) -> bool:
    """Whether no vibration can close the contact again after a result, however its modes come together.

    A body with the strain and kinetic energy E of vibration moves a point that has the flexibility c by sqrt(2 E c) at
    most. The gap of the bodies without vibration must be wider, and not shrink: bodies that spin may come back.

    Parameters
    ----------
    items : list of PartitionBody
        The first body, and the second one unless that is a rigid surface.
    contact : PartitionContact
    result : Result
        Its last sample counts.
    normal : (3,) array
        Direction in which the first body flew at the second one.
    """
    last = result.at(result.t[[-1]])
    (slave, patch), *_ = contact.sides
    places = slave.kinematics.at(slave.body.partition.patches[patch].nodes).place(slave.coordinates(last)[0])
    foremost = places[int((places @ normal * (1.0 if slave == items[0] else -1.0)).argmax())]
    if relative_velocity(items, last, foremost)[0] @ normal >= 0:
        return False
    gap, reach = float(contact.gap(last)[-1]), 0.0
    for item, patch in contact.sides:
        body, part = item.body, item.body.partition.patches[patch]
        row = part.direction @ (body.rows(part.nodes[:1]) @ np.eye(body.n_dofs))
        gap += float(row @ item.kinematics.deformed(item.coordinates(last)[0]))
        flexibility = float(row @ np.linalg.lstsq(body.stiffness.toarray(), row, rcond=1e-10)[0])
        reach += math.sqrt(max(2 * vibration_energy(item, last)[0] * flexibility, 0.0))
    return bool(gap > reach)
