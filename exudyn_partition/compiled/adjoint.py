"""Derivatives of a number that follows from a run, by the discrete adjoint of the very steps that were made.

One pass backwards gives the derivatives by start, masses, stiffnesses, damping, loads and flexibilities, however many
these are. Forces of contacts by compliance are Lipschitz in the coordinates, so that no jump conditions are needed.
Where a row is at the edge of another status in a step, derivatives are one-sided: without force and gap, or, with
friction, with all the force that it bears without slip.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ..support.arrays import Array
from .friction_adjoint import FrictionAdjoint, FrictionMade, OnFriction, Window, jacobian_of
from .friction_back import FrictionBack
from .friction_plan import FrictionMemory
from .loops import Adjoint, ContactParts, go_back
from .plan import Bodies, FrozenPlan, StepPlan
from .run import EqualSteps, Histories

_MOST = 500  # samples whose adjoints are kept at a time
_NUMBERS = 1 << 21  # of the slips of rows with friction that are kept at a time: 16 MB


class Weights(Protocol):
    """Derivatives of k numbers by what a run with n samples has kept."""

    @property
    def friction(self) -> OnFriction | None:
        """By what friction did, the same for all numbers."""

    @property
    def lam(self) -> sp.csr_matrix:
        """By forces on rows, (n, nr) [1/N], the same for all numbers."""

    @property
    def count(self) -> int:
        """Number of numbers, k."""

    def of_block(self, block: slice) -> tuple[Array, Array]:
        """By coordinates and velocities at m samples, new arrays, (m, nq, k) each."""


@dataclass(frozen=True, eq=False)
class OneNumber:
    """Derivatives of one number, see `Weights`.

    Parameters
    ----------
    lam : (n, nr) csr matrix
    q : (n, nq) array
        By coordinates.
    v_end : (nq,) array
        By velocities at the end.
    friction : OnFriction, optional
    """

    lam: sp.csr_matrix
    q: Array
    v_end: Array
    friction: OnFriction | None = None

    count = 1

    def of_block(self, block: slice) -> tuple[Array, Array]:
        """See `Weights.of_block`."""
        by_q, n = self.q[block][:, :, None].copy(), len(self.q)
        by_v = np.zeros_like(by_q)
        if block.stop == n:
            by_v[-1, :, 0] = self.v_end
        return by_q, by_v


@dataclass(frozen=True, eq=False)
class Sums:
    """Derivatives of k sums over samples of one value, which is linear in coordinates and velocities, see `Weights`.

    Parameters
    ----------
    lam : (n, nr) csr matrix
        Zero.
    samples : (n, k) array
        Weight of the value at each sample in each sum.
    q, v : (nq,) arrays
        The value by coordinates and velocities.
    """

    lam: sp.csr_matrix
    samples: Array
    q: Array
    v: Array

    friction = None

    @property
    def count(self) -> int:
        """See `Weights.count`."""
        return int(self.samples.shape[1])

    def of_block(self, block: slice) -> tuple[Array, Array]:
        """See `Weights.of_block`."""
        of_samples = self.samples[block][:, None, :]
        return self.q[:, None] * of_samples, self.v[:, None] * of_samples


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of k numbers by a plan and its start.

    Parameters
    ----------
    q, v : (nq, k) arrays
        By coordinates and velocities at the start.
    bodies : Bodies
        By masses, stiffnesses, damping and loads, (nq, k) each.
    flexibility : list of (m, k) arrays
        For each contact, by factors of the m parts of its flexibility.
    friction : (nf, 3, k) array
        By static and kinetic coefficient and decay of each contact with friction, or of those that it moves.
    """

    q: Array
    v: Array
    bodies: Bodies
    flexibility: list[Array]
    friction: Array


class _Closed:
    """Closed rows, and the samples in which they are the same.

    Parameters
    ----------
    rows : (na,) int array
    samples : slice
    H : (na, nq) array
    flexibility : (na, na) array
    """

    def __init__(self, rows: Array, samples: slice, H: Array, flexibility: Array) -> None:
        self.rows, self.samples, self.H = rows, samples, H
        self._factor = scipy.linalg.cho_factor(flexibility, lower=True) if len(rows) else None

    def solve(self, rhs: Array) -> Array:
        """Solve F x = rhs, (na, k)."""
        return rhs if self._factor is None else np.asarray(scipy.linalg.cho_solve(self._factor, rhs))

    def blocks(self, most: int) -> Iterator[slice]:
        """Samples in parts of `most`, the last ones first."""
        start, stop = self.samples.start, self.samples.stop
        for end in range(stop, start, -most):
            yield slice(max(end - most, start), end)

    @property
    def stiffness(self) -> Array:
        """Stiffness of the closed rows, (nq, nq); (0, nq) without."""
        return self.H.T @ self.solve(self.H) if len(self.rows) else np.zeros((0, self.H.shape[1]))

    def by_flexibility(
        self, y: Array, given: Array, forces: Array, parts: Sequence[Sequence[Array]], starts: Array
    ) -> list[Array]:
        """For each contact, (m, k): y' H' F^-1 dF lambda of m parts of its flexibility, summed over n samples.

        `y` is (n, nq, k), the weights and the forces on the closed rows are (n, na).
        """
        rhs = np.einsum("ri,sik->rsk", self.H, y) + given.T[:, :, None]
        x = self.solve(rhs.reshape(len(rhs), -1)).reshape(rhs.shape)
        found = []
        for j, of_contact in enumerate(parts):
            some = np.flatnonzero((self.rows >= starts[j]) & (self.rows < starts[j + 1]))
            index = np.ix_(self.rows[some] - starts[j], self.rows[some] - starts[j])
            gaps = [F[index] @ forces.T[some] for F in of_contact]
            found.append(np.array([np.einsum("rsk,rs->k", x[some], gap) for gap in gaps]).reshape(len(gaps), -1))
        return found


def backwards(
    plan: StepPlan,
    steps: EqualSteps,
    made: Histories,
    weights: Weights,
    parts: Sequence[Sequence[Array]],
    made_friction: FrictionMade | None = None,
) -> Derivatives:
    """Go back from the end of a run to its start.

    A step is u = v + h a / 2, q = q + h u, a = (f(q) + load - K q - D u) / M, v = u + h a / 2. With adjoints q', u',
    v', a' and y = a' / M, it gives back: K and D times -y, forces lambda' = H y + their weights. On closed rows
    F lambda = -h, so that h' = -F^-1 lambda'. Module `friction_back` has rows with friction.

    Parameters
    ----------
    plan : StepPlan
    steps : EqualSteps
        With a sample after each step.
    made : Histories
        With coordinates and forces on rows, of a run that no earlier one went ahead of.
    weights : Weights
    parts : sequence of sequences of (nr, nr) arrays
        For each contact, parts of its flexibility [m/N], with friction (3 nr, 3 nr) arrays.
    made_friction : FrictionMade, optional
        What contacts with friction did, see `friction_made`.
    """
    h, bodies, nq = steps.step, plan.bodies, made.q.shape[1]
    a, lam, starts = accelerations(plan, steps, made), _lam(made), plan.contacts.rows.starts
    n = int(starts[-1])
    middle = np.vstack([made.v[:1], made.v[1:] - 0.5 * h * a[1:]])
    adjoint, k = Adjoint(*np.zeros((3, nq, weights.count))), weights.count
    sums, flexibility = Bodies(*np.zeros((4, nq, k))), [np.zeros((len(of_contact), k)) for of_contact in parts]
    of_friction = parts[len(plan.contacts.names) :]
    friction = None if made_friction is None else _FrictionBackwards(made_friction, weights, of_friction)
    most = _MOST if friction is None else friction.most
    for group in reversed(closed_rows(plan.contacts, lam[:, :n], nq, apart=bool(friction))):
        stiffness = np.ascontiguousarray(group.stiffness)
        for block in group.blocks(most):
            given, (by_q, by_v) = weights.lam[block][:, group.rows].toarray(), weights.of_block(block)
            by_q -= (group.solve(given.T).T @ group.H)[:, :, None]  # weights of forces act on coordinates
            rows = None if friction is None else friction.begin(block)
            y = go_back(bodies, stiffness, by_q, by_v, h, block.start == 0, adjoint, rows)
            if friction is not None:
                friction.end()
            new = [-np.einsum("sik,si->ik", y, motion[block]) for motion in (a, made.q, middle)]
            sums = Bodies(*(part + more for part, more in zip(sums, [*new, y.sum(axis=0)], strict=True)))
            if len(group.rows) and any(map(len, parts)):
                forces = lam[block][:, group.rows].toarray()
                more = group.by_flexibility(y, given, forces, parts[: len(plan.contacts.names)], starts)
                for part, by_parts in zip(flexibility, more, strict=False):
                    part -= by_parts
    if friction is None:
        return Derivatives(adjoint.q, adjoint.v, sums, flexibility, np.zeros((0, 3, k)))
    flexibility[len(plan.contacts.names) :] = friction.flexibility
    return Derivatives(adjoint.q, adjoint.v, sums, flexibility, friction.by_law)


class _FrictionBackwards:
    """Contacts with friction in a pass back, see `backwards`.

    Attributes
    ----------
    most : int
        Samples that take little memory at a time.
    by_law : (nf, 3, k) array
    flexibility : list of (m, k) arrays
        See `Derivatives`, of contacts with friction.
    """

    def __init__(self, made: FrictionMade, weights: Weights, parts: Sequence[Sequence[Array]]) -> None:
        self._made, self._weights, self._parts, k = made, weights, parts, weights.count
        self._after = FrictionAdjoint.none(k, made.plan.n_rows)
        self.most = samples_at_once(made, k)
        self.by_law = np.zeros((len(made.plan.names), 3, k))
        self.flexibility = [np.zeros((len(of_contact), k)) for of_contact in parts]

    def begin(self, block: slice) -> FrictionBack | None:
        """What the pass back over a block needs; None if no row is closed."""
        made, self._window, self._back = self._made, self._made.window(block), None
        if self._window.status.any():
            self._back = made.back(self._window, self._given(self._window), self._after)
        return self._back

    def _given(self, w: Window) -> tuple[Array, Array]:
        """Weights by forces and slips of the rows of a window, (m, k, 3 n) each."""
        weights, shape = self._weights, (*w.status.shape, 3)
        forces, slips = np.zeros(shape), np.zeros(shape)
        first = weights.lam.shape[1] - self._made.plan.n_rows
        forces[:, :, 0] = weights.lam[w.samples].toarray()[:, first + w.rows]
        if weights.friction is not None:
            forces[:, :, 1:], slips[:, :, 1:] = w.weights(weights.friction)
        of_all = (np.repeat(part.reshape(len(part), 1, -1), weights.count, axis=1) for part in (forces, slips))
        by_forces, by_slips = of_all
        return by_forces, by_slips

    def end(self) -> None:
        """Take what the pass back over the block has found."""
        made, w, back = self._made, self._window, self._back
        if back is None:
            self._after = FrictionAdjoint.none(self._weights.count, made.plan.n_rows)
            return
        self.by_law += made.by_law(w, back.by_mu)
        for part, more in zip(self.flexibility, made.by_parts(w, back.slips, self._parts), strict=True):
            part += more
        self._after = self._after.before(w, back)


def samples_at_once(made: FrictionMade, k: int = 1) -> int:
    """Samples of rows with friction that take little memory with k numbers each."""
    rows = max(len(np.unique(made.status.indices)), 1)
    return max(min(_MOST, _NUMBERS // (3 * rows * k)), 1)


def friction_margins(made: FrictionMade) -> Array:
    """By how much the rows of each sample miss another status at least, (n,): see `FrictionMade.margins`.

    They are shares of the largest force, and of the largest yielding.
    """
    n, most = len(made.q), samples_at_once(made)
    found = np.concatenate([made.margins(slice(start, min(start + most, n))) for start in range(0, n, most)])
    smallest: Array = (found[:, :2] / np.maximum(found[:, 2:].max(axis=0), 1e-300)).min(axis=1)
    return smallest


def friction_made(plan: StepPlan, steps: EqualSteps, made: Histories, memory: FrictionMemory | None) -> FrictionMade:
    """What contacts with friction did in a run that began with a memory."""
    friction = plan.contacts.friction
    assert friction is not None
    assert made.along is not None
    assert made.status is not None
    lam = _lam(made)[:, plan.contacts.n_rows - friction.n_rows :]
    memory = memory or FrictionMemory.none(friction.n_rows, len(friction.names))
    return FrictionMade(friction, memory, steps.step, made.q, lam, made.along, made.status)


def accelerations(plan: StepPlan, steps: EqualSteps, made: Histories) -> Array:
    """Accelerations at all samples, (n, nq)."""
    bodies, contacts, nq = plan.bodies, plan.contacts, made.q.shape[1]
    forces = _lam(made) @ row_jacobian(contacts, nq)
    if contacts.friction is not None:
        T = np.delete(jacobian_of(contacts.friction, nq), np.s_[::3], axis=0)
        forces = forces + made.along @ T
    rest = forces + bodies.load - bodies.stiffness * made.q - bodies.damping * made.v
    found: Array = rest / (bodies.mass - 0.5 * steps.step * bodies.damping)  # velocities half a step before count
    found[0] = rest[0] / bodies.mass
    return found


def row_jacobian(contacts: FrozenPlan, n: int) -> Array:
    """Derivative of the gaps of all rows by n coordinates, (nr, n); rows of contacts with friction come last."""
    H = np.zeros((len(contacts.rows.start), n))
    for j in range(len(contacts.names)):
        part = ContactParts.of(contacts, j)
        H[part.rows, part.dofs] = part.H.T
    return H if contacts.friction is None else np.vstack([H, jacobian_of(contacts.friction, n)[::3]])


def row_starts(contacts: FrozenPlan) -> Array:
    """Gaps of all rows at coordinates of zero, (nr,) [m]; rows of contacts with friction come last."""
    rows = contacts.rows.start
    return rows if contacts.friction is None else np.concatenate([rows, contacts.friction.rows.start])


def closed_rows(contacts: FrozenPlan, lam: sp.csr_matrix, n: int, *, apart: bool = False) -> list[_Closed]:
    """Closed rows without friction of samples with forces on these, (m, nr), each set once as long as it stays.

    There are n coordinates. `apart` parts the start from the samples after it.
    """
    H, changes = row_jacobian(contacts, n), sorted({*set_changes(lam).tolist(), *([1] if apart else [])})
    spans = zip([0, *changes], [*changes, lam.shape[0]], strict=True)
    sets = ((lam.indices[lam.indptr[start] : lam.indptr[start + 1]], slice(start, stop)) for start, stop in spans)
    return [_Closed(rows, samples, H[rows], flexibility_between(contacts, rows)) for rows, samples in sets]


def set_changes(lam: sp.csr_matrix) -> Array:
    """Samples, (k,) int, at which other rows have a force than at the sample before, of forces on rows, (m, nr)."""
    closed = np.zeros(lam.shape, dtype=bool)
    closed[np.repeat(np.arange(len(closed)), np.diff(lam.indptr)), lam.indices] = True
    return np.flatnonzero((closed[1:] != closed[:-1]).any(axis=1)) + 1


def flexibility_between(contacts: FrozenPlan, rows: Array) -> Array:
    """Flexibility between some rows of all contacts, (na, na) [m/N]."""
    starts, F = contacts.rows.starts, np.zeros((len(rows), len(rows)))
    places = [np.flatnonzero((rows >= begin) & (rows < end)) for begin, end in itertools.pairwise(starts)]
    numbers = [rows[place] - begin for place, begin in zip(places, starts, strict=False)]
    for j, own in enumerate(contacts.own):
        F[np.ix_(places[j], places[j])] = own[np.ix_(numbers[j], numbers[j])]
    for (j, k), core in contacts.core.items():
        F[np.ix_(places[j], places[k])] += contacts.fields[j][numbers[j]] @ core @ contacts.fields[k][numbers[k]].T
    return F


def _lam(made: Histories) -> sp.csr_matrix:
    assert made.lam is not None
    return made.lam
