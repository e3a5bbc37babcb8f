"""Contacts with friction in explicit steps by NumPy: where loops are not compiled, or do not settle in a step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..algebra.complementarity import regularised
from ..algebra.coulomb import coefficients
from ..algebra.friction import OPEN, SLIP, STICK, FrictionProblem
from ..contact.loops import choose_rows, close_pushed
from ..errors import ComplementarityError
from ..support.arrays import Array
from .friction_plan import CHOICES, FlatFrictionRows, FrictionPlan, FrictionState
from .plain_rubbing import PlainRubbing


class _Part(NamedTuple):
    """One contact: its rows among all, its coordinates, and derivatives of gaps and tangential places, transposed."""

    rows: slice
    dofs: Array
    H: Array
    normals: Array
    along: Array


class FrictionSteps:
    """Finds the forces of all contacts; results are in a state, as those of compiled loops.

    Parameters
    ----------
    plan : FrictionPlan
    flat : FlatFrictionRows
        Its rows in this run.
    rubbing : PlainRubbing or None
        Those of its contacts whose rows follow the motion.
    """

    def __init__(self, plan: FrictionPlan, flat: FlatFrictionRows, rubbing: PlainRubbing | None) -> None:
        self._plan, rows, self._parts = plan, flat.rows, list[_Part]()
        self._flexibilities, self._tangents, self._rubbing = flat.blocks(), flat.tangents, rubbing
        for j, T in enumerate(plan.ways):
            some, dofs = slice(*rows.starts[j : j + 2]), rows.dofs[slice(*rows.places[j : j + 2])]
            n, nr = len(dofs), some.stop - some.start
            H = rows.numbers[rows.H[j] :][: n * nr].reshape(n, nr)
            normals = rows.numbers[rows.normals[j] :][: 3 * nr].reshape(nr, 3)
            self._parts.append(_Part(some, dofs, H, normals, np.ascontiguousarray(T.T)))

    def find(self, s: FrictionState, q: Array, q_from: Array, force: Array) -> None:
        """Add generalised forces at coordinates q, (nq,), in a step from q_from, and set values of sensors.

        Raises
        ------
        ComplementarityError
            If forces do not settle.
        """
        lacking = True
        while lacking:
            self._place(s, q, q_from)
            for group in range(len(self._flexibilities)):
                self._solve(s, group, q)
            lacking = self._rubbing is not None and self._rubbing.lacks_rows()
        for j in range(len(self._parts)):
            self._values(s, j, force)
        if self._rubbing is not None:
            self._rubbing.push(s, q, force)

    def recall(self, s: FrictionState, q: Array, force: Array) -> None:
        """Add the forces that a state begins with, at its coordinates q, (nq,), and set values of sensors."""
        self._place(s, q, q)
        s.slips[:], s.lam[:] = 0.0, s.memory.forces
        for group, F in enumerate(self._flexibilities):
            rows = self._plan.rows_of(group)
            if self._rubbing is not None:
                self._rubbing.anchor(s, group, q)
            lam = s.lam[rows].ravel()
            s.energy[rows] = 0.5 * (lam * (F @ lam)).reshape(-1, 3).sum(axis=1)
            s.pushed[rows] = self._pushed(s, group, F)
        for j in range(len(self._parts)):
            self._values(s, j, force)
        if self._rubbing is not None:
            self._rubbing.push(s, q, force)

    def _place(self, s: FrictionState, q: Array, q_from: Array) -> None:
        """Set gaps, ways and coefficients."""
        start, memory, laws = self._plan.rows.start, s.memory, self._plan.laws
        for part, law in zip(self._parts, laws, strict=True):
            rows, dofs = part.rows, part.dofs
            s.gap[rows] = s.pushed[rows] = start[rows] + q[dofs] @ part.H
            s.way[rows] = ((q[dofs] - q_from[dofs]) @ part.along).reshape(-1, 2)
            s.mu[rows] = 0.0 if law is None else coefficients(law, memory.slipped[rows], memory.speed[rows])
        if self._rubbing is not None:
            self._rubbing.rub(s, q, q_from)

    def _pushed(self, s: FrictionState, group: int, F: Array) -> Array:
        """Gaps with the displacements that forces on other contacts cause, (k,) [m]."""
        of_group, lam = self._plan.rows_of(group), s.lam[self._plan.rows_of(group)]
        pushed = s.gap[of_group].copy()
        for j in self._plan.contacts_of(group):
            rows = self._parts[j].rows
            in_group, others = slice(rows.start - of_group.start, rows.stop - of_group.start), lam.copy()
            others[in_group] = 0.0
            if others.any():
                pushed[in_group] += (F[::3][in_group] @ others.ravel()).ravel()
        return pushed

    def _solve(self, s: FrictionState, group: int, q: Array) -> None:
        """Find the forces of a group."""
        rows, F, contacts = self._plan.rows_of(group), self._flexibilities[group], self._plan.contacts_of(group)
        several, last = len(contacts) > 1, s.memory.forces[rows]
        pushing = several and (s.lam[rows].any() or last.any())
        if s.gap[rows].min(initial=0.0) >= 0.0 and not pushing:
            self._answer(s, rows, np.empty(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.empty(0))
            return
        if self._rubbing is not None:
            self._rubbing.anchor(s, group, q)
        if pushing:
            s.pushed[rows] = self._pushed(s, group, F)
        for number in range(CHOICES[6]):
            for j in contacts:
                part = self._parts[j].rows
                choose_rows(s.pushed[part], s.memory.forces[part], s.near[part], number > 0, CHOICES[:5])
            self._solve_near(s, group)
            if several:
                s.pushed[rows] = self._pushed(s, group, F)
            if not any([self._shuts(s, F, rows.start, self._parts[j].rows) for j in contacts]):
                return
        raise ComplementarityError(
            f"the rows that close in {len(contacts)} contacts on common bodies did not settle in {CHOICES[6]} passes"
        )

    @staticmethod
    def _shuts(s: FrictionState, F: Array, first: int, rows: slice) -> bool:
        """Whether forces on the rows of a contact push others of them shut, which are near then.

        F, (3 k, 3 k), is the flexibility of the group, whose first row has the number `first`.
        """
        gap, columns = s.pushed[rows], slice(3 * (rows.start - first), 3 * (rows.stop - first))
        least = float(gap.min(initial=0.0))
        pushing = np.ascontiguousarray(F[columns, columns][::3])
        return least < 0.0 and close_pushed(pushing, gap, s.near[rows], s.lam[rows].ravel(), CHOICES[7] * least)

    def _solve_near(self, s: FrictionState, group: int) -> None:
        """Find the forces on the rows that can close."""
        rows, F_all, first = self._plan.rows_of(group), self._flexibilities[group], self._plan.rows_of(group).start
        near = np.flatnonzero(s.near[rows])
        some = (3 * near[:, None] + np.arange(3)).ravel()
        F, last, before = F_all[np.ix_(some, some)], s.memory.forces[rows][near], s.memory.before[rows][near]
        for j in self._plan.contacts_of(group):
            part, d = self._parts[j].rows, 1 if self._plan.laws[j] is None else 3
            of_part = np.flatnonzero((near + first >= part.start) & (near + first < part.stop))
            of_part = (3 * of_part[:, None] + np.arange(d)).ravel()
            F[np.ix_(of_part, of_part)] = regularised(F[np.ix_(of_part, of_part)])
        ahead = 2.0 * last - before
        go_on = (last[:, 0] > 0.0) & (before[:, 0] > 0.0) & (ahead[:, 0] > 0.0)
        h = np.column_stack([s.gap[rows][near], s.way[rows][near] - (F @ last.ravel()).reshape(-1, 3)[:, 1:]])
        lam, state, iterations = np.zeros((len(near), 3)), np.zeros(len(near), dtype=np.int8), 0
        if len(near):
            problem = FrictionProblem(np.eye(3))
            problem.replace(F, s.status[rows][near], np.where(go_on[:, None], ahead, last))
            lam = problem.solve(h, s.mu[rows][near])
            state = problem.state
            iterations = problem.iterations
        moved = (F @ lam.ravel()).reshape(-1, 3)
        self._answer(s, rows, near, lam, h + moved, state)
        s.energy[rows][near] = 0.5 * (lam * moved).sum(axis=1)
        contacts = self._plan.contacts_of(group)
        for j in contacts:
            if self._plan.laws[j] is not None and (len(contacts) == 1 or s.status[self._parts[j].rows].any()):
                s.iterations[j] += iterations

    @staticmethod
    def _answer(s: FrictionState, rows: slice, near: Array, lam: Array, w: Array, state: Array) -> None:
        """Write the answer on some rows of a group; the others are open."""
        for values, answer in ((s.lam, lam), (s.status, state), (s.slips, w[:, 1:])):
            values[rows] = 0
            values[rows][near] = answer

    def _values(self, s: FrictionState, j: int, force: Array) -> None:
        """Set values of sensors and energies of a contact, and add its generalised forces."""
        part, frictional = self._parts[j], self._plan.laws[j] is not None
        rows = part.rows
        lam, status = s.lam[rows], s.status[rows]
        closed = bool((status != OPEN).any())
        pulls = np.einsum("rk,rkd->d", lam[:, 1:], self._tangents[rows])
        s.values[j] = [
            lam[:, 0].sum(), np.count_nonzero(status), *(lam[:, 0] @ part.normals + pulls),
            s.pushed[rows].min(initial=np.inf),
        ]  # fmt: skip
        taken = -0.5 * float(np.vdot(s.slips[rows], (s.memory.forces[rows] + lam)[:, 1:]))
        s.taken[j] = taken if closed and frictional else 0.0
        s.stored[j] = s.energy[rows][status != OPEN].sum()
        counts = (np.count_nonzero(status == kind) for kind in (STICK, SLIP))
        s.friction[j] = [*pulls, *counts, s.memory.dissipated[j] + s.taken[j], s.stored[j]]
        force[part.dofs] += part.H @ lam[:, 0] + part.along @ lam[:, 1:].ravel()

    def accept(self, s: FrictionState, step: float) -> None:
        """Take the answer as the end of a step [s], see `contact.memory.RowMemory.after`."""
        memory, slides = s.memory, s.status == SLIP
        way = np.where(slides, np.hypot(*s.slips.T), 0.0)
        memory.before[:], memory.forces[:] = memory.forces, s.lam
        memory.slipped[:], memory.speed[:] = slides, way / step
        memory.path[:] += way
        memory.dissipated[:] += s.taken
        if self._rubbing is not None:
            self._rubbing.accept(s)
