"""Compiled explicit steps; `loops` does the same by NumPy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..contact.kernels import FlatContacts, evaluate_frozen
from ..support.arrays import Array
from ..support.compiled import inlined, unlocked

if TYPE_CHECKING:
    from .loops import Motion, Peaks, Samples
    from .plan import Bodies

Limits = tuple[float, float, int, int]  # see `block_complementarity.LIMITS`


@inlined
def accelerate(bodies: Bodies, m: Motion) -> None:
    """Set accelerations from coordinates, velocities and contact forces."""
    for k in range(len(m.q)):
        inner = bodies.stiffness[k] * m.q[k] + bodies.damping[k] * m.v[k]
        m.a[k] = (m.force[k] + bodies.load[k] - inner) / bodies.mass[k]


@inlined
def watch(contacts: FlatContacts, peaks: Peaks, q: Array) -> None:
    """Keep the largest force of each contact, with forces on rows and coordinates then."""
    starts, values, lam = contacts.blocks.starts, contacts.values, contacts.blocks.lam
    for j in range(len(values)):
        if values[j, 0] > peaks.force[j]:
            peaks.force[j] = values[j, 0]
            for k in range(len(q)):
                peaks.q[j, k] = q[k]
            for i in range(starts[j], starts[j + 1]):
                peaks.lam[i] = lam[i]


@inlined
def keep(contacts: FlatContacts, m: Motion, samples: Samples, place: int) -> None:
    """Write a sample of what is kept."""
    values, stored, lam = contacts.values, contacts.stored, contacts.blocks.lam
    if len(samples.q) > 0:
        for k in range(len(m.q)):
            samples.q[place, k], samples.v[place, k] = m.q[k], m.v[k]
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
    contacts: FlatContacts,
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
    are then those with which the forces would be found.
    """
    n, (rounding, settled, steps, patience) = len(m.q), limits
    for step in range(first, count + 1):
        for k in range(n):
            m.q_start[k], m.v_start[k] = m.q[k], m.v[k]
            m.v[k] += 0.5 * h * m.a[k]
            m.q[k] += h * m.v[k]
        if evaluate_frozen(contacts, m.q, m.force, rounding, settled, steps, patience) < 0:
            return step
        accelerate(bodies, m)
        for k in range(n):
            m.v[k] += 0.5 * h * m.a[k]
        watch(contacts, peaks, m.q)
        if step % between == 0:
            keep(contacts, m, samples, step // between - 1)
    return count + 1
