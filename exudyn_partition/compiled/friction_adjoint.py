"""Contacts with friction in a run that was made, as the pass back over its samples takes them.

A step leaves the forces of its rows and how far these have slipped to the next one: ways along the tangents are
w = T (q - q_before) + F (lambda - lambda_before). If the coefficient falls, the speed of slip goes there too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ..algebra.complementarity import REGULARISATION
from ..algebra.coulomb import Coulomb, coefficients
from ..algebra.friction import OPEN, SLIP, STICK
from ..support.arrays import Array
from .friction_back import FrictionBack
from .friction_plan import FrictionMemory, FrictionPlan

_MOST = 500  # samples whose slips are found at a time


class OnFriction(NamedTuple):
    """Derivatives of one number by what friction did, beside those by normal forces.

    Parameters
    ----------
    forces, slips : (m, 2 n) csr matrices
        By tangential forces and by slips.
    """

    forces: sp.csr_matrix
    slips: sp.csr_matrix


class Span(NamedTuple):
    """Samples of a run.

    Parameters
    ----------
    samples : slice
    rows : (n,) int array
        Rows that are closed in any of them, or were before the first one.
    """

    samples: slice
    rows: Array

    @property
    def directions(self) -> Array:
        """Numbers of all three directions, (3 n,)."""
        numbers: Array = (3 * self.rows[:, None] + np.arange(3)).ravel()
        return numbers

    @property
    def tangents(self) -> Array:
        """Numbers of the tangents, among those of all rows, (2 n,)."""
        numbers: Array = (2 * self.rows[:, None] + np.arange(2)).ravel()
        return numbers


@dataclass(frozen=True, eq=False)
class FrictionMade:
    """What n rows with friction did in m samples of a run, and with what.

    Parameters
    ----------
    plan : FrictionPlan
    memory : FrictionMemory
        With which the run began; its forces are those before the first two samples.
    h : float
        Step [s].
    F : (3 n, 3 n) array
        Regularised flexibility [m/N].
    B : (3 n, nq) array
        Gaps and tangential places by the coordinates.
    forces, before : (m, 3 n) csr matrices
        Forces, and those of the step before [N].
    status, status_before : (m, n) csr matrices
    slips : (m, 2 n) csr matrix
        How far rows that have or had a force have slipped in the step [m].
    """

    plan: FrictionPlan
    memory: FrictionMemory
    h: float
    F: Array
    B: Array
    forces: sp.csr_matrix
    before: sp.csr_matrix
    status: sp.csr_matrix
    status_before: sp.csr_matrix
    slips: sp.csr_matrix

    @classmethod
    def of(
        cls,
        plan: FrictionPlan,
        memory: FrictionMemory | None,
        h: float,
        q: Array,
        kept: tuple[sp.csr_matrix, sp.csr_matrix, sp.csr_matrix],
    ) -> FrictionMade:
        """Find it of a plan, the memory of its start, and samples: coordinates, and normal and tangential forces on
        rows with their states.
        """  # noqa: D205
        n, (lam, along, status) = plan.n_rows, kept
        memory = memory or FrictionMemory.none(n, len(plan.names))
        tangents = np.delete(np.arange(3 * n), np.s_[::3])
        forces = sp.csr_matrix(_onto(lam, 3 * np.arange(n), 3 * n) + _onto(along, tangents, 3 * n))
        first = np.where(memory.forces[:, 0] > 0.0, np.where(memory.slipped, SLIP, STICK), OPEN)
        before, F, B = _shifted(memory.forces.ravel(), forces), flexibility_of(plan), jacobian_of(plan, q.shape[1])
        slips = _slips(q, forces, before, F, B)
        return cls(plan, memory, h, F, B, forces, before, status, _shifted(first, status), slips)

    @property
    def slipping(self) -> sp.csr_matrix:
        """Which rows slip, (m, n)."""
        return sp.csr_matrix(self.status == SLIP)

    def span(self, samples: slice) -> Span:
        """Samples with their rows."""
        rows = np.unique(np.concatenate([self.status[samples].indices, self.before[samples.start].indices // 3]))
        return Span(samples, rows)

    def back(self, span: Span, given: tuple[Array, Array], carried: FrictionAdjoint) -> FrictionBack:
        """What the pass back needs of a span.

        `given` are derivatives of the numbers by forces, (m, k, 3 n), and by slips, (m, k, 2 n), on all rows.
        """
        rows, samples = span.rows, span.samples
        status, laws = _some(self.status, samples, rows).astype(np.int8), self._laws(rows)
        frictional = np.array([law is not None for law in laws])
        forces = _some(self.forces, samples, span.directions).reshape(*status.shape, 3)
        slips, mu = self.slips_of(span), self.coefficients(span)
        F = self.F[np.ix_(span.directions, span.directions)]
        own = F.diagonal().reshape(-1, 3)[:, 1:]
        stiffness = np.mean(1.0 / own, axis=1)
        trial = forces[:, :, 1:] - stiffness[:, None] * slips
        length, slides = np.hypot(trial[:, :, 0], trial[:, :, 1]), (status == SLIP) & frictional
        with np.errstate(invalid="ignore", divide="ignore"):
            along = np.where(slides[:, :, None] & (length > 0.0)[:, :, None], trial / length[:, :, None], 0.0)
            share = np.where(slides & (length > 0.0), np.minimum(mu * forces[:, :, 0] / length, 1.0), 0.0)
        # Nothing moves rows without friction along their tangents, nor rows whose trial force is zero.
        status = np.where((status == STICK) & ~frictional, np.int8(SLIP), status)
        yielding = np.where(along.any(axis=2), (1.0 - share) / stiffness, 1.0)
        by_forces, by_slips = given
        explicit = np.zeros_like(by_forces)
        explicit.reshape(*by_forces.shape[:2], -1, 3)[:, :, :, 1:] = by_slips.reshape(*by_slips.shape[:2], -1, 2)
        groups = np.searchsorted(rows, self.plan.rows.starts[self.plan.groups])
        return FrictionBack(
            status, mu, np.ascontiguousarray(forces[:, :, 0]), along, share, yielding, F,
            np.ascontiguousarray(self.B[span.directions]), groups, by_forces, self._by_speed(span, status, slips, laws),
            explicit, np.zeros((*by_forces.shape[:2], len(rows))),
            np.ascontiguousarray(carried.forces[:, span.directions]), np.ascontiguousarray(carried.mu[:, rows]),
        )  # fmt: skip

    def weights(self, rows: Array, forces: Array, slips: Array) -> OnFriction:
        """Derivatives of a number by tangential forces and slips of some rows, (m, 2 k) each, which rise."""
        columns, n = (2 * rows[:, None] + np.arange(2)).ravel(), 2 * self.plan.n_rows
        return OnFriction(*(_onto(sp.csr_matrix(values), columns, n) for values in (forces, slips)))

    def by_dissipation(self, rows: Array, closed: Array) -> tuple[Array, Array]:
        """Derivatives of the work of friction by forces and slips of the rows of a contact, (m, 2 k) each.

        It is -w (lambda_before + lambda) / 2 of the tangents in each step at whose end the contact is `closed`, (m,).
        """
        along = (3 * rows[:, None] + np.arange(1, 3)).ravel()
        taken = np.arange(len(closed)) > 0  # none at the start
        halves = -0.5 * (closed & taken)[:, None]
        slips = halves * self.slips[:, (2 * rows[:, None] + np.arange(2)).ravel()].toarray()
        by_forces = slips.copy()
        by_forces[1:-1] += slips[2:]  # forces at the start are no forces before the first step
        by_forces[:1] = 0.0
        return by_forces, halves * (self.forces + self.before)[:, along].toarray()

    def margins(self, q: Array) -> Array:
        """By how much the rows of each sample miss another status at least, (m,), as shares of the largest forces.

        Of rows without a force, it is their gap over the largest yielding; of rows that slip, the force by which they
        would have to stick more. `q` are the coordinates of the samples, (m, nq).
        """
        found, n = np.full(len(q), np.inf), self.plan.n_rows
        largest, yielding = self.forces.max(), 0.0
        normals, frictional = 3 * np.arange(n), np.array([law is not None for law in self._laws(np.arange(n))])
        stiffness = np.mean(1.0 / self.F.diagonal().reshape(-1, 3)[:, 1:], axis=1)
        gaps = list[Array]()
        for start in range(0, len(q), _MOST):
            samples = slice(start, min(start + _MOST, len(q)))
            span = Span(samples, np.arange(n))
            moved, status = self.forces[samples] @ self.F[:, normals], self.status[samples].toarray()
            yielding = max(yielding, abs(moved).max())
            gap = abs(q[samples] @ self.B[normals].T + self.plan.rows.start + moved)
            gaps.append(np.where(status == OPEN, gap, np.inf).min(axis=1, initial=np.inf))
            forces = self.forces[samples].toarray().reshape(-1, n, 3)
            bound, along = self.coefficients(span) * forces[:, :, 0], np.hypot(forces[:, :, 1], forces[:, :, 2])
            slips = stiffness * np.hypot(*np.moveaxis(self.slips_of(span), 2, 0))
            off = np.where(status == STICK, bound - along, slips)
            off = np.where(frictional, np.minimum(off, forces[:, :, 0]), forces[:, :, 0])
            found[samples] = np.where(status == OPEN, np.inf, off).min(axis=1, initial=np.inf)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.fmin(found / largest, np.concatenate(gaps) / yielding)

    def slips_of(self, span: Span) -> Array:
        """How far the rows of a span slip in its samples, (m, n, 2) [m]."""
        found: Array = _some(self.slips, span.samples, span.tangents).reshape(-1, len(span.rows), 2)
        return found

    def coefficients(self, span: Span) -> Array:
        """Coefficients of the rows of a span, (m, n)."""
        slipped, speed = self._slipped(span)
        found, laws = np.zeros(slipped.shape), self._laws(span.rows)
        for i, law in enumerate(laws):
            if law is not None:
                found[:, i] = coefficients(law, slipped[:, i], speed[:, i])
        return found

    def by_law(self, span: Span, by_mu: Array) -> Array:
        """Derivatives of k numbers by static and kinetic coefficient and decay of each contact, (nc, 3, k).

        `by_mu`, (m, k, n), are those by the coefficients of the rows of a span.
        """
        slipped, speed = self._slipped(span)
        found = np.zeros((len(self.plan.laws), 3, by_mu.shape[1]))
        contacts = self._contacts(span.rows)
        for i, (contact, law) in enumerate(zip(contacts, self._laws(span.rows), strict=True)):
            if law is None:
                continue
            share = np.where(slipped[:, i], _share(law, speed[:, i]), 1.0)
            falls = 0.0 if law.decay is None else _fall(law) * share * speed[:, i] / law.decay**2 * slipped[:, i]
            found[contact] += np.stack([share, 1.0 - share, falls + 0.0 * share]) @ by_mu[:, :, i]
        return found

    def _slipped(self, span: Span) -> tuple[Array, Array]:
        """Which rows of a span slipped one step earlier, and how fast, (m, n) [m/s]."""
        samples, rows = span.samples, span.rows
        slipped = _some(self.status_before, samples, rows) == SLIP
        earlier = np.maximum(np.arange(samples.start, samples.stop) - 1, 0)
        slips = self.slips[earlier][:, span.tangents].toarray().reshape(*slipped.shape, 2)
        speed = np.hypot(slips[:, :, 0], slips[:, :, 1]) / self.h
        begin = max(2 - samples.start, 0)
        speed[:begin] = self.memory.speed[rows]
        return slipped, np.where(slipped, speed, 0.0)

    def _by_speed(self, span: Span, status: Array, slips: Array, laws: Sequence[Coulomb | None]) -> Array:
        """Derivative of the next coefficients by how far rows slip, (m, n, 2) [1/m]."""
        found = np.zeros(slips.shape)
        for i, law in enumerate(laws):
            if law is not None and law.decay is not None:
                way = np.hypot(slips[:, i, 0], slips[:, i, 1])
                slope = -_fall(law) * _share(law, way / self.h) / (law.decay * self.h)
                found[:, i] = ((status[:, i] == SLIP) * slope / np.maximum(way, 1e-300))[:, None] * slips[:, i]
        if not span.samples.start:
            found[0] = 0.0  # the first step goes on from the memory of the start
        return found

    def by_parts(self, span: Span, slips: Array, parts: Sequence[Sequence[Array]]) -> list[Array]:
        """For each contact, (m, k): derivatives by factors of m parts of its flexibility, (3 nr, 3 nr) each [m/N].

        `slips`, (m, k, 3 n), are those by gaps and slips of the rows of a span.
        """
        contacts, found = self._contacts(span.rows), list[Array]()
        forces, before = (_some(given, span.samples, span.directions) for given in (self.forces, self.before))
        for j, of_contact in enumerate(parts):
            some = np.flatnonzero(contacts == j)
            own = (3 * (span.rows[some] - self.plan.rows.starts[j])[:, None] + np.arange(3)).ravel()
            here = (3 * some[:, None] + np.arange(3)).ravel()
            values = np.zeros((len(of_contact), slips.shape[1]))
            for place, F in enumerate(of_contact if len(some) else ()):
                block = F[np.ix_(own, own)]
                moved = forces[:, here] @ block
                tangents = np.arange(len(here)) % 3 > 0
                moved[:, tangents] -= before[:, here] @ block[:, tangents]
                values[place] = np.einsum("ski,si->k", slips[:, :, here], moved)
            found.append(values)
        return found

    def _contacts(self, rows: Array) -> Array:
        """Contacts of some rows."""
        found: Array = np.searchsorted(self.plan.rows.starts, rows, side="right") - 1
        return found

    def _laws(self, rows: Array) -> list[Coulomb | None]:
        """Laws of some rows."""
        return [self.plan.laws[contact] for contact in self._contacts(rows)]


@dataclass(frozen=True, eq=False)
class FrictionAdjoint:
    """Derivatives of k numbers by what the step before a span leaves.

    Parameters
    ----------
    forces : (k, 3 n) array
    mu : (k, n) array
        By the coefficients that follow from its slips.
    """

    forces: Array
    mu: Array

    @classmethod
    def none(cls, k: int, n: int) -> FrictionAdjoint:
        """Of the end of a run."""
        return cls(np.zeros((k, 3 * n)), np.zeros((k, n)))

    def before(self, span: Span, back: FrictionBack) -> FrictionAdjoint:
        """The same before a span, over which a pass back was made."""
        found = FrictionAdjoint(np.zeros_like(self.forces), np.zeros_like(self.mu))
        if span.samples.start > 1:  # earlier samples leave nothing: the first step goes on from the memory of the start
            found.forces[:, span.directions], found.mu[:, span.rows] = back.forces, back.mu_next
        return found


def flexibility_of(plan: FrictionPlan) -> Array:
    """Flexibility of all rows, (3 n, 3 n) [m/N], regularised contact by contact as in the steps."""
    F = np.zeros((3 * plan.n_rows,) * 2)
    for group, block in enumerate(plan.flexibilities):
        own = slice(3 * plan.rows_of(group).start, 3 * plan.rows_of(group).stop)
        F[own, own] = block
    diagonal = F.reshape(-1)[:: len(F) + 1].reshape(-1, 3)
    for j, law in enumerate(plan.laws):
        rows, d = slice(*plan.rows.starts[j : j + 2]), 1 if law is None else 3
        diagonal[rows, :d] += REGULARISATION * diagonal[rows, :d].mean()
    return F


def jacobian_of(plan: FrictionPlan, n: int) -> Array:
    """Derivatives of the gaps and tangential places of all rows by n coordinates, (3 nr, n)."""
    flat, B = plan.rows, np.zeros((plan.n_rows, 3, n))
    for j, T in enumerate(plan.ways):
        rows, dofs = slice(*flat.starts[j : j + 2]), flat.dofs[slice(*flat.places[j : j + 2])]
        nr = rows.stop - rows.start
        B[rows, 0, dofs] = flat.numbers[flat.H[j] :][: len(dofs) * nr].reshape(len(dofs), nr).T
        B[rows, 1:, dofs] = T.reshape(nr, 2, -1)
    return B.reshape(-1, n)


def _slips(q: Array, forces: sp.csr_matrix, before: sp.csr_matrix, F: Array, B: Array) -> sp.csr_matrix:
    """How far rows that have or had a force slip in each step, see `FrictionMade`."""
    parts, n = list[sp.csr_matrix](), len(F) // 3
    moved = np.diff(q, axis=0, prepend=q[:1])
    for start in range(0, len(q), _MOST):
        some = slice(start, start + _MOST)
        present = (abs(forces[some]) + abs(before[some])).tocsr()
        rows = np.unique(present.indices // 3)
        closed = present[:, 3 * rows].toarray() > 0.0
        tangents = (3 * rows[:, None] + np.arange(1, 3)).ravel()
        ways = moved[some] @ B[tangents].T + (forces[some] - before[some]) @ F[:, tangents]
        ways *= np.repeat(closed, 2, axis=1)
        parts.append(_onto(sp.csr_matrix(ways), (2 * rows[:, None] + np.arange(2)).ravel(), 2 * n))
    return sp.csr_matrix(sp.vstack(parts))


def _onto(values: sp.csr_matrix, columns: Array, n: int) -> sp.csr_matrix:
    """Values, (m, k), in k of n columns, which rise."""
    return sp.csr_matrix((values.data, columns[values.indices], values.indptr), (values.shape[0], n))


def _shifted(first: Array, values: sp.csr_matrix) -> sp.csr_matrix:
    """Values one sample earlier; before the first two, those of the start: it is evaluated, but no step."""
    return sp.csr_matrix(sp.vstack([sp.csr_matrix(first)] * 2 + [values[1:-1]])[: values.shape[0]])


def _some(values: sp.csr_matrix, samples: slice, columns: Array) -> Array:
    """Some columns in some samples, dense."""
    found: Array = values[samples][:, columns].toarray()
    return found


def _fall(law: Coulomb) -> float:
    """By how much the coefficient falls at most."""
    return 0.0 if law.kinetic is None else law.static - law.kinetic


def _share(law: Coulomb, speed: Array) -> Array:
    """Share of this fall that is not yet there at some speeds of slip."""
    return np.zeros_like(speed) if law.decay is None else np.exp(-speed / law.decay)
