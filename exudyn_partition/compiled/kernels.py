"""Compiled explicit steps; `loops` does the same by NumPy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..contact.kernels import FlatContacts, evaluate_frozen
from ..support.arrays import Array
from ..support.compiled import compiled, inlined, unlocked

if TYPE_CHECKING:
    from .loops import Motion, Peaks, Samples
    from .plan import FlatBodies

Limits = tuple[float, float, int, int]  # see `block_complementarity.LIMITS`


@compiled
def push(groups: tuple[FlatContacts, ...], q: Array, force: Array, part: Array, limits: Limits) -> int:
    """Set the forces of all contacts; return the number of the first group that has none, or -1."""
    rounding, settled, steps, patience = limits
    force[:] = 0.0
    for number, group in enumerate(groups):
        pushing = evaluate_frozen(group, q, part, rounding, settled, steps, patience)
        if pushing < 0:
            return number
        if pushing > 0:
            for k in range(len(q)):
                force[k] += part[k]
    return -1


@inlined
def accelerate(bodies: FlatBodies, m: Motion) -> None:
    """Set accelerations from coordinates, velocities and contact forces."""
    for k in range(len(m.q)):
        total = m.force[k] + bodies.load[k]
        for i in range(bodies.starts[k], bodies.starts[k + 1]):
            total -= bodies.values[i] * m.q[bodies.columns[i]]
        for i in range(bodies.damping_starts[k], bodies.damping_starts[k + 1]):
            total -= bodies.damping_values[i] * m.v[bodies.damping_columns[i]]
        m.a[k] = total / bodies.mass[k]


@inlined
def watch(groups: tuple[FlatContacts, ...], peaks: Peaks, q: Array) -> None:
    """Keep the largest force of each contact, with forces on rows and coordinates then."""
    contact = row = 0
    for group in groups:
        starts, values, lam = group.blocks.starts, group.values, group.blocks.lam
        for j in range(len(values)):
            if values[j, 0] > peaks.force[contact]:
                peaks.force[contact] = values[j, 0]
                for k in range(len(q)):
                    peaks.q[contact, k] = q[k]
                for i in range(starts[j], starts[j + 1]):
                    peaks.lam[row + i] = lam[i]
            contact += 1
        row += len(lam)


@inlined
def keep(groups: tuple[FlatContacts, ...], m: Motion, samples: Samples, place: int) -> None:
    """Write a sample of what is kept."""
    if len(samples.q) > 0:
        for k in range(len(m.q)):
            samples.q[place, k], samples.v[place, k] = m.q[k], m.v[k]
    contact = row = 0
    for group in groups:
        values, stored, lam = group.values, group.stored, group.blocks.lam
        for j in range(len(values)):
            for k in range(values.shape[1]):
                samples.values[place, contact + j, k] = values[j, k]
        if len(samples.stored) > 0:
            for j in range(len(stored)):
                samples.stored[place, contact + j] = stored[j]
            for i in range(len(lam)):
                samples.lam[place, row + i] = lam[i]
        contact, row = contact + len(values), row + len(lam)


@unlocked
def advance(
    bodies: FlatBodies,
    groups: tuple[FlatContacts, ...],
    m: Motion,
    samples: Samples,
    peaks: Peaks,
    limits: Limits,
    h: float,
    count: int,
    between: int,
) -> tuple[int, int]:
    """See `loops.Stepper.advance`."""
    n = len(m.q)
    for step in range(count):
        for k in range(n):
            m.q_start[k], m.v_start[k] = m.q[k], m.v[k]
            m.v[k] += 0.5 * h * m.a[k]
            m.q[k] += h * m.v[k]
        failed = push(groups, m.q, m.force, m.part, limits)
        if failed >= 0:
            return step, failed
        accelerate(bodies, m)
        for k in range(n):
            m.v[k] += 0.5 * h * m.a[k]
        watch(groups, peaks, m.q)
        if (step + 1) % between == 0:
            keep(groups, m, samples, (step + 1) // between - 1)
    return count, -1
