"""Derivatives of a number that follows from a run, by the discrete adjoint of the very steps that were made.

One pass backwards gives the derivatives by start, masses, stiffnesses, damping, loads and flexibilities, however many
these are. Forces of contacts by compliance are Lipschitz in the coordinates, so that no jump conditions are needed.
Where a row has neither force nor gap in a step, derivatives are one-sided.
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
from .loops import Adjoint, ContactParts, go_back
from .plan import Bodies, FrozenPlan, StepPlan
from .run import EqualSteps, Histories

_MOST = 500  # samples whose adjoints are kept at a time


class Weights(Protocol):
    """Derivatives of k numbers by what a run with n samples has kept."""

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
    """

    lam: sp.csr_matrix
    q: Array
    v_end: Array

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
    """

    q: Array
    v: Array
    bodies: Bodies
    flexibility: list[Array]


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

    def blocks(self) -> Iterator[slice]:
        """Samples in parts that take little memory, the last ones first."""
        start, stop = self.samples.start, self.samples.stop
        for end in range(stop, start, -_MOST):
            yield slice(max(end - _MOST, start), end)

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
    plan: StepPlan, steps: EqualSteps, made: Histories, weights: Weights, parts: Sequence[Sequence[Array]]
) -> Derivatives:
    """Go back from the end of a run to its start.

    A step is u = v + h a / 2, q = q + h u, a = (f(q) + load - K q - D u) / M, v = u + h a / 2. With adjoints q', u',
    v', a' and y = a' / M, it gives back: K and D times -y, forces lambda' = H y + their weights. On closed rows
    F lambda = -h, so that h' = -F^-1 lambda'.

    Parameters
    ----------
    plan : StepPlan
    steps : EqualSteps
        With a sample after each step.
    made : Histories
        With coordinates and forces on rows, of a run that no earlier one went ahead of.
    weights : Weights
    parts : sequence of sequences of (nr, nr) arrays
        For each contact, parts of its flexibility [m/N].
    """
    h, bodies, nq = steps.step, plan.bodies, made.q.shape[1]
    a, lam, starts = accelerations(plan, steps, made), _lam(made), plan.contacts.rows.starts
    middle = np.vstack([made.v[:1], made.v[1:] - 0.5 * h * a[1:]])
    adjoint, k = Adjoint(*np.zeros((3, nq, weights.count))), weights.count
    sums, flexibility = Bodies(*np.zeros((4, nq, k))), [np.zeros((len(of_contact), k)) for of_contact in parts]
    for group in reversed(closed_rows(plan.contacts, lam, nq)):
        stiffness = np.ascontiguousarray(group.stiffness)
        for block in group.blocks():
            given, (by_q, by_v) = weights.lam[block][:, group.rows].toarray(), weights.of_block(block)
            by_q -= (group.solve(given.T).T @ group.H)[:, :, None]  # weights of forces act on coordinates
            y = go_back(bodies, stiffness, by_q, by_v, h, block.start == 0, adjoint)
            new = [-np.einsum("sik,si->ik", y, motion[block]) for motion in (a, made.q, middle)]
            sums = Bodies(*(part + more for part, more in zip(sums, [*new, y.sum(axis=0)], strict=True)))
            if len(group.rows) and any(map(len, parts)):
                more = group.by_flexibility(y, given, lam[block][:, group.rows].toarray(), parts, starts)
                flexibility = [part - by_parts for part, by_parts in zip(flexibility, more, strict=True)]
    return Derivatives(adjoint.q, adjoint.v, sums, flexibility)


def accelerations(plan: StepPlan, steps: EqualSteps, made: Histories) -> Array:
    """Accelerations at all samples, (n, nq)."""
    bodies = plan.bodies
    forces = _lam(made) @ row_jacobian(plan.contacts, made.q.shape[1])
    rest = forces + bodies.load - bodies.stiffness * made.q - bodies.damping * made.v
    found: Array = rest / (bodies.mass - 0.5 * steps.step * bodies.damping)  # velocities half a step before count
    found[0] = rest[0] / bodies.mass
    return found


def row_jacobian(contacts: FrozenPlan, n: int) -> Array:
    """Derivative of the gaps of all rows by n coordinates, (nr, n)."""
    H = np.zeros((len(contacts.rows.start), n))
    for j in range(len(contacts.names)):
        part = ContactParts.of(contacts, j)
        H[part.rows, part.dofs] = part.H.T
    return H


def closed_rows(contacts: FrozenPlan, lam: sp.csr_matrix, n: int) -> list[_Closed]:
    """Closed rows of samples with forces on rows, (m, nr), each set once as long as it stays; n coordinates."""
    H, changes = row_jacobian(contacts, n), set_changes(lam).tolist()
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
