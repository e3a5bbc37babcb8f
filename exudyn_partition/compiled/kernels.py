"""Compiled explicit steps; `loops` does the same by NumPy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..contact.kernels import FlatContacts, evaluate_frozen
from ..support.arrays import Array
from ..support.compiled import called, inlined, unlocked
from .friction_kernels import accept_friction, find_friction, keep_friction, watch_edges_of_rough, watch_friction
from .moving_kernels import (
    act_on_masses,
    add_inertia,
    count_steps,
    evaluate_moving,
    keep_fresh,
    turn_accelerations,
    turn_on,
    watch_edges,
)

if TYPE_CHECKING:
    from .loops import Peaks, Samples
    from .moving_kernels import Moving
    from .plan import Bodies, Motion
    from .rough_kernels import Friction, Rubs

Limits = tuple[float, float, int, int]  # see `block_complementarity.LIMITS`

find_at_rest, find_in_motion, find_rough = called(evaluate_frozen), called(evaluate_moving), called(find_friction)


@inlined
def evaluate(contacts: FlatContacts | None, moving: Moving | None, m: Motion, limits: Limits) -> int:
    """Find forces of contacts without friction, see `evaluate_moving`."""
    rounding, settled, steps, patience = limits
    if moving is not None:
        return find_in_motion(contacts, moving, m.q, m.v, m.force, limits)
    if contacts is not None:
        return find_at_rest(contacts, m.q, m.force, rounding, settled, steps, patience)
    for k in range(len(m.force)):
        m.force[k] = 0.0
    return 0


@inlined
def accelerate(bodies: Bodies, moving: Moving | None, m: Motion, half_step: float) -> None:
    """Set accelerations from coordinates, velocities half a step before, and contact forces."""
    if moving is not None:
        add_inertia(bodies, moving.frames, m, half_step)
    for k in range(len(m.q)):
        inner = bodies.stiffness[k] * m.q[k] + bodies.damping[k] * m.v[k]
        m.a[k] = (m.force[k] + bodies.load[k] - inner) / bodies.mass[k]
    if moving is not None:
        turn_accelerations(bodies, moving.frames, m)


@inlined
def watch(contacts: FlatContacts | None, peaks: Peaks, q: Array) -> None:
    """Keep the largest force of each contact, with forces on rows and coordinates then, and depths of closed rows."""
    if contacts is not None:
        starts, values, lam, h = contacts.blocks.starts, contacts.values, contacts.blocks.lam, contacts.h
        for j in range(len(values)):
            if values[j, 1] > 0.0:
                for i in range(starts[j], starts[j + 1]):
                    if lam[i] > 0.0 and -h[i] > peaks.depth[i]:
                        peaks.depth[i] = -h[i]
            if values[j, 0] > peaks.force[j]:
                peaks.force[j] = values[j, 0]
                for k in range(len(q)):
                    peaks.q[j, k] = q[k]
                for i in range(starts[j], starts[j + 1]):
                    peaks.lam[i] = lam[i]


@inlined
def keep(contacts: FlatContacts | None, m: Motion, samples: Samples, place: int) -> None:
    """Write a sample of what is kept."""
    if len(samples.q) > 0:
        for k in range(len(m.q)):
            samples.q[place, k], samples.v[place, k], samples.a[place, k] = m.q[k], m.v[k], m.a[k]
    if contacts is not None:
        values, stored, lam = contacts.values, contacts.stored, contacts.blocks.lam
        for j in range(len(values)):
            for k in range(values.shape[1]):
                samples.values[place, j, k] = values[j, k]
        if len(samples.stored) > 0:
            for j in range(len(stored)):
                samples.stored[place, j] = stored[j]
            for i in range(len(lam)):
                samples.lam[place, i] = lam[i]


@unlocked
def advance(
    bodies: Bodies,
    contacts: FlatContacts | None,
    friction: Friction | None,
    rubs: Rubs | None,
    moving: Moving | None,
    m: Motion,
    samples: Samples,
    peaks: Peaks,
    limits: Limits,
    h: float,
    first: int,
    count: int,
    between: int,
) -> int:
    """Make steps with the numbers `first` to `count`, from 1, see `loops.Stepper.advance`.

    Return the number of the first step whose forces are not found, `count` + 1 if all are. Coordinates and velocities
    are then those with which the forces would be found. What a plan does not have is not compiled for it.
    """
    n = len(m.q)
    for step in range(first, count + 1):
        for k in range(n):
            m.q_start[k], m.v_start[k] = m.q[k], m.v[k]
            m.v[k] += 0.5 * h * m.a[k]
            m.q[k] += h * m.v[k]
        if moving is not None:
            turn_on(moving.frames, m, h)
        if evaluate(contacts, moving, m, limits) < 0:
            return step
        if friction is not None:
            if not find_rough(friction, rubs, m.q, m.q_start, m.force):
                return step
            accept_friction(friction, rubs, h)
        if moving is not None:
            act_on_masses(moving.frames, m.q, m.force)
            count_steps(moving.pairs)
        accelerate(bodies, moving, m, 0.5 * h)
        for k in range(n):
            m.v[k] += 0.5 * h * m.a[k]
        watch(contacts, peaks, m.q)
        if friction is not None:
            watch_friction(friction, peaks, m.q)
        if step % between == 0:
            keep(contacts, m, samples, step // between - 1)
            if moving is not None:
                if contacts is not None:
                    watch_edges(contacts, moving.pairs, moving.state, m.q)
                keep_fresh(moving.state, rubs, samples.fresh[step // between - 1])
            if friction is not None:
                watch_edges_of_rough(friction, rubs, m.q)
                keep_friction(friction, samples, step // between - 1)
    return count + 1
