"""Contacts with friction in a run that was made, as the pass back over its samples takes them.

A step leaves the forces of its rows and how far these have slipped to the next one: ways along the tangents are
w = T (q - q_before) + F (lambda - lambda_before). If the coefficient falls, the speed of slip goes there too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ..algebra.complementarity import REGULARISATION
from ..algebra.coulomb import Coulomb, coefficients
from ..algebra.friction import OPEN, SLIP, STICK
from ..support.arrays import Array
from .friction_back import FrictionBack
from .friction_plan import FrictionMemory, FrictionPlan


class OnFriction(NamedTuple):
    """Derivatives of one number by what friction did, beside those by normal forces.

    Parameters
    ----------
    samples : (m,) array
    along : (n, 2) array
        By tangential forces: a weight of each sample times one of each row and tangent.
    taken : (n,) bool array
        Rows whose work is the number.
    closed : (m,) bool array
        Samples in which the contact of these rows is closed, with which this work counts.
    """

    samples: Array
    along: Array
    taken: Array
    closed: Array


class Window(NamedTuple):
    """What rows with friction did in m samples: n rows that are closed there, or just before or after.

    Parameters
    ----------
    samples : slice
    rows : (n,) int array
    status : (m, n) array
    forces, before : (m, n, 3) arrays
        Forces, and those of the step before [N].
    slips, after : (m, n, 2) arrays
        How far rows slip in the step, and in the step after [m].
    slipped, speed : (m, n) arrays
        Whether they slipped in the step before, and how fast [m/s].
    mu : (m, n) array
    """

    samples: slice
    rows: Array
    status: Array
    forces: Array
    before: Array
    slips: Array
    after: Array
    slipped: Array
    speed: Array
    mu: Array

    @property
    def directions(self) -> Array:
        """Numbers of all three directions of the rows, (3 n,)."""
        numbers: Array = (3 * self.rows[:, None] + np.arange(3)).ravel()
        return numbers

    def weights(self, of: OnFriction) -> tuple[Array, Array]:
        """Derivatives of a number by tangential forces and slips, (m, n, 2) each.

        The work of friction is -w (lambda_before + lambda) / 2 in each step at whose end the contact is closed.
        """
        m, last = len(self.slips), len(of.samples)
        numbers = np.arange(self.samples.start, self.samples.start + m)
        forces = (of.samples[numbers, None] * (self.status != OPEN))[:, :, None] * of.along[self.rows]
        halves = -0.5 * of.taken[self.rows][:, None]
        now, then = (
            ((0 < some) & (some < last) & of.closed[np.minimum(some, last - 1)])[:, None, None] * halves
            for some in (numbers, numbers + 1)
        )
        forces += now * self.slips + (numbers > 0)[:, None, None] * then * self.after  # the first step has no forces
        return forces, now * (self.before + self.forces)[:, :, 1:]


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
    q : (m, nq) array
        Coordinates.
    lam, along, status : (m, n), (m, 2 n), (m, n) csr matrices
        Normal and tangential forces [N], and states.
    """

    plan: FrictionPlan
    memory: FrictionMemory
    h: float
    q: Array
    lam: sp.csr_matrix
    along: sp.csr_matrix
    status: sp.csr_matrix

    @cached_property
    def F(self) -> Array:
        """Flexibility of all rows, (3 n, 3 n) [m/N], regularised contact by contact as in the steps."""
        return flexibility_of(self.plan)

    @cached_property
    def B(self) -> Array:
        """Derivatives of the gaps and tangential places of all rows by the coordinates, (3 n, nq)."""
        return jacobian_of(self.plan, self.q.shape[1])

    @property
    def slipping(self) -> sp.csr_matrix:
        """Which rows slip, (m, n)."""
        return sp.csr_matrix(self.status == SLIP)

    def window(self, samples: slice) -> Window:
        """Find what rows did in some samples."""
        first, last = max(samples.start - 2, 0), min(samples.stop + 1, len(self.q))
        status, lam = self.status[first:last].toarray(), self.lam[first:last].toarray()
        begins = [self.memory] if samples.start < 2 else []
        rows = np.flatnonzero(status.any(axis=0) | np.any([one.forces[:, 0] > 0.0 for one in begins], axis=0))
        tangents, n = (2 * rows[:, None] + np.arange(2)).ravel(), len(rows)
        along = self.along[first:last].toarray()[:, tangents].reshape(last - first, n, 2)
        forces = np.concatenate([lam[:, rows, None], along], axis=2)
        status = status[:, rows]
        slipped, before = (np.concatenate([values[:1], values[:-1]]) for values in (status == SLIP, forces))
        if begins:  # the forces of the start are found, but no step is made
            before[:2], slipped[:2] = self.memory.forces[rows], self.memory.slipped[rows]
        way = np.diff(self.q[first:last], axis=0, prepend=self.q[first : first + 1])
        some = (3 * rows[:, None] + np.arange(3)).ravel()
        along_rows = some.reshape(-1, 3)[:, 1:].ravel()
        slips = (
            way @ self.B[along_rows].T
            + (forces - before).reshape(last - first, 3 * n) @ self.F[np.ix_(some, along_rows)]
        )
        slips = slips.reshape(last - first, n, 2) * (np.maximum(forces, before)[:, :, :1] > 0.0)
        speed = np.hypot(*np.moveaxis(slips, 2, 0)) / self.h
        speed = slipped * np.concatenate([speed[:1], speed[:-1]])
        if begins:
            speed[:2] = self.memory.speed[rows]
        own = slice(samples.start - first, samples.stop - first)
        after = np.concatenate([slips, np.zeros_like(slips[:1])])[own.start + 1 : own.stop + 1]
        found = Window(
            samples, rows, status[own], forces[own], before[own], slips[own], after, slipped[own], speed[own],
            np.zeros((own.stop - own.start, n)),
        )  # fmt: skip
        for i, law in enumerate(self._laws(rows)):
            if law is not None:
                found.mu[:, i] = coefficients(law, found.slipped[:, i], found.speed[:, i])
        return found

    def margins(self, block: slice) -> Array:
        """By how much the rows of each sample miss another status at least, (m, 2) [N, m].

        It is a force of rows that are closed, of those that slip the force by which they would have to stick more, and
        a gap of others. The next numbers are the largest force and yielding, (m, 2).
        """
        w = self.window(block)
        push, along = w.forces[:, :, 0], np.hypot(w.forces[:, :, 1], w.forces[:, :, 2])
        slips = self._stiffness(w) * np.hypot(w.slips[:, :, 0], w.slips[:, :, 1])
        frictional = np.array([law is not None for law in self._laws(w.rows)], dtype=bool)
        off = np.where(frictional, np.minimum(np.where(w.status == STICK, w.mu * push - along, slips), push), push)
        moved = w.forces.reshape(len(push), -1) @ self.F[w.directions, ::3]
        gaps = abs(self.q[block] @ self.B[::3].T + self.plan.rows.start + moved)
        gaps[:, w.rows] = np.where(w.status == OPEN, gaps[:, w.rows], np.inf)
        closest = np.where(w.status == OPEN, np.inf, off).min(axis=1, initial=np.inf), gaps.min(axis=1, initial=np.inf)
        largest = push.max(axis=1, initial=0.0), abs(moved).max(axis=1, initial=0.0)
        return np.column_stack([*closest, *largest])

    def back(self, w: Window, given: tuple[Array, Array], carried: FrictionAdjoint) -> FrictionBack:
        """What the pass back needs of a window.

        `given` are derivatives of the numbers by forces and slips, (m, k, 3 n) each.
        """
        laws, k = self._laws(w.rows), given[0].shape[1]
        frictional = np.array([law is not None for law in laws])
        F, stiffness, slides = self.F[np.ix_(w.directions, w.directions)], self._stiffness(w), w.status == SLIP
        trial = w.forces[:, :, 1:] - stiffness[:, None] * w.slips
        length = np.hypot(trial[:, :, 0], trial[:, :, 1])
        slides &= frictional & (length > 0.0)
        along, share = np.zeros(trial.shape), np.zeros(length.shape)
        np.divide(trial, length[:, :, None], out=along, where=slides[:, :, None])
        np.divide(w.mu * w.forces[:, :, 0], length, out=share, where=slides)
        # Nothing moves rows without friction along their tangents, nor rows whose trial force is zero.
        status = np.where((w.status == STICK) & ~frictional, np.int8(SLIP), w.status)
        yielding = np.where(slides, np.maximum(1.0 - share, 0.0) / stiffness, 1.0)
        groups = np.searchsorted(w.rows, self.plan.rows.starts[self.plan.groups])
        return FrictionBack(
            status, w.mu, np.ascontiguousarray(w.forces[:, :, 0]), along, share, yielding, F, self.B[w.directions],
            groups, given[0], self._by_speed(w, laws), given[1], np.zeros((len(status), k, len(w.rows))),
            np.ascontiguousarray(carried.forces[:, w.directions]), np.ascontiguousarray(carried.mu[:, w.rows]),
        )  # fmt: skip

    def by_law(self, w: Window, by_mu: Array) -> Array:
        """Derivatives of k numbers by static and kinetic coefficient and decay of each contact, (nc, 3, k).

        `by_mu`, (m, k, n), are those by the coefficients of the rows of a window.
        """
        found = np.zeros((len(self.plan.laws), 3, by_mu.shape[1]))
        contacts = self._contacts(w.rows)
        for contact, law in enumerate(self.plan.laws):
            if law is None:
                continue
            of_contact = contacts == contact
            slipped, speed = w.slipped[:, of_contact], w.speed[:, of_contact]
            share = np.where(slipped, _share(law, speed), 1.0)
            falls = 0.0 if law.decay is None else _fall(law) * share * speed / law.decay**2 * slipped
            for place, by in enumerate((share, 1.0 - share, falls + 0.0 * share)):
                found[contact, place] = np.einsum("ski,si->k", by_mu[:, :, of_contact], by)
        return found

    def by_parts(self, w: Window, slips: Array, parts: Sequence[Sequence[Array]]) -> list[Array]:
        """For each contact, (m, k): derivatives by factors of m parts of its flexibility, (3 nr, 3 nr) each [m/N].

        `slips`, (m, k, 3 n), are those by gaps and slips of the rows of a window.
        """
        contacts, found = self._contacts(w.rows), list[Array]()
        changes = w.forces - w.before  # rows yield along the tangents by these, along the normal by all forces
        for j, of_contact in enumerate(parts):
            some = np.flatnonzero(contacts == j)
            own = (3 * (w.rows[some] - self.plan.rows.starts[j])[:, None] + np.arange(3)).ravel()
            here = (3 * some[:, None] + np.arange(3)).ravel()
            values = np.zeros((len(of_contact), slips.shape[1]))
            for place, F in enumerate(of_contact if len(some) else ()):
                block, normal = F[np.ix_(own, own)], np.arange(len(own)) % 3 == 0
                moved, changed = (given[:, some].reshape(-1, len(own)) @ block for given in (w.forces, changes))
                values[place] = np.einsum("ski,si->k", slips[:, :, here], np.where(normal, moved, changed))
            found.append(values)
        return found

    def _stiffness(self, w: Window) -> Array:
        """By which slips of rows are scaled to forces, (n,) [N/m]."""
        diagonal = self.F.diagonal().reshape(-1, 3)[w.rows, 1:]
        found: Array = np.mean(1.0 / diagonal, axis=1)
        return found

    def _by_speed(self, w: Window, laws: Sequence[Coulomb | None]) -> Array:
        """Derivative of the next coefficients by how far rows slip, (m, n, 2) [1/m]."""
        found = np.zeros(w.slips.shape)
        for i, law in enumerate(laws):
            if law is not None and law.decay is not None:
                way = np.hypot(w.slips[:, i, 0], w.slips[:, i, 1])
                slope = -_fall(law) * _share(law, way / self.h) / (law.decay * self.h)
                found[:, i] = ((w.status[:, i] == SLIP) * slope / np.maximum(way, 1e-300))[:, None] * w.slips[:, i]
        if not w.samples.start:
            found[0] = 0.0  # the first step goes on from the memory of the start
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
    """Derivatives of k numbers by what the step before a window leaves.

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

    def before(self, w: Window, back: FrictionBack) -> FrictionAdjoint:
        """The same before a window, over which a pass back was made."""
        found = FrictionAdjoint(np.zeros_like(self.forces), np.zeros_like(self.mu))
        if w.samples.start > 1:  # the first step goes on from the memory of the start
            found.forces[:, w.directions], found.mu[:, w.rows] = back.forces, back.mu_next
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


def _fall(law: Coulomb) -> float:
    """By how much the coefficient falls at most."""
    return 0.0 if law.kinetic is None else law.static - law.kinetic


def _share(law: Coulomb, speed: Array) -> Array:
    """Share of this fall that is not yet there at some speeds of slip."""
    return np.zeros_like(speed) if law.decay is None else np.exp(-speed / law.decay)
