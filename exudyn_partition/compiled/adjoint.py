"""Derivatives of a number that follows from a run, by the discrete adjoint of the very steps that were made.

One pass backwards gives the derivatives by start, masses, stiffnesses, damping, loads and flexibilities, however many
these are. Forces of contacts by compliance are Lipschitz in the coordinates, so that no jump conditions are needed.
Where a row has neither force nor gap in a step, derivatives are one-sided.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ..support.arrays import Array
from .loops import ContactParts
from .plan import Bodies, FrozenPlan, StepPlan
from .run import EqualSteps, Histories


@dataclass(frozen=True, eq=False)
class Weights:
    """Derivatives of a number by what a run with n samples has kept.

    Parameters
    ----------
    lam : (n, nr) csr matrix
        By forces on rows [1/N].
    q : (n, nq) array
        By coordinates.
    v_end : (nq,) array
        By velocities at the end.
    """

    lam: sp.csr_matrix
    q: Array
    v_end: Array


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of a number by a plan and its start.

    Parameters
    ----------
    q, v : (nq,) arrays
        By coordinates and velocities at the start.
    bodies : Bodies
        By masses, stiffnesses, damping and loads.
    flexibility : list of (k,) arrays
        For each contact, by factors of parts of its flexibility.
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
    h, bodies = steps.step, plan.bodies
    a, lam, nq = accelerations(plan, steps, made), _lam(made), made.q.shape[1]
    groups, y, explicit = closed_rows(plan.contacts, lam, nq), np.zeros_like(made.q), weights.q.copy()
    for group in groups:  # weights of forces act on coordinates
        given = weights.lam[group.samples][:, group.rows].toarray()
        explicit[group.samples] -= group.solve(given.T).T @ group.H
    q, u, v = np.zeros(nq), np.zeros(nq), weights.v_end
    for group in reversed(groups):
        stiffness = np.diag(bodies.stiffness) + group.H.T @ group.solve(group.H)
        for s in range(group.samples.stop - 1, group.samples.start - 1, -1):
            y[s] = 0.5 * h * (u + v if s else u) / bodies.mass
            q = q + explicit[s] - stiffness @ y[s]
            v = v - bodies.damping * y[s]
            if s:
                u = v = v + h * q
    middle = np.vstack([made.v[:1], made.v[1:] - 0.5 * h * a[1:]])
    by_bodies = Bodies(-(y * a).sum(axis=0), -(y * made.q).sum(axis=0), -(y * middle).sum(axis=0), y.sum(axis=0))
    flexibility, starts = [np.zeros(len(of_contact)) for of_contact in parts], plan.contacts.rows.starts
    for group in groups if any(map(len, parts)) else ():
        given = weights.lam[group.samples][:, group.rows].toarray()
        x, forces = group.solve(group.H @ y[group.samples].T + given.T), lam[group.samples][:, group.rows].toarray().T
        for j, of_contact in enumerate(parts):
            some = np.flatnonzero((group.rows >= starts[j]) & (group.rows < starts[j + 1]))
            index = np.ix_(group.rows[some] - starts[j], group.rows[some] - starts[j])
            flexibility[j] -= [float(np.vdot(x[some], F[index] @ forces[some])) for F in of_contact]
    return Derivatives(q, v, by_bodies, flexibility)


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
    sets, H = np.split(lam.indices, lam.indptr[1:-1]), row_jacobian(contacts, n)
    changes = [s for s, pair in enumerate(itertools.pairwise(sets), 1) if not np.array_equal(*pair)]
    spans = zip([0, *changes], [*changes, len(sets)], strict=True)
    return [
        _Closed(sets[start], slice(start, stop), H[sets[start]], flexibility_between(contacts, sets[start]))
        for start, stop in spans
    ]


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
