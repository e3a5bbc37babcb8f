"""Multipliers of several contacts solved together: contacts that share bodies, or that joints connect."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ...algebra.complementarity import Complementarity
from ...support.arrays import Array, consecutive
from .lagrange import LagrangeContact


class ForwardIncrement:
    """One complementarity problem for all rows of several contacts.

    The problem is lambda >= 0, w >= 0, lambda'w = 0 with

        w = h + F lambda,    h = g / step^2,    F = G M^-1 G',

    where g are the gaps at the end of the step without contact forces.

    Parameters
    ----------
    laws : list of LagrangeContact
    dofs : list of (n,) int arrays
        Numbers of each contact's coordinates among all. They show which coordinates contacts share.
    """

    def __init__(self, laws: Sequence[LagrangeContact], dofs: Sequence[Array]) -> None:
        self.laws = laws
        self._links = []
        for i, j in combinations(range(len(laws)), 2):
            _, own, others = np.intersect1d(dofs[i], dofs[j], return_indices=True)
            if own.size:
                self._links.append((i, j, own, others))
        self._taken = False

    @property
    def iterations(self) -> int:
        """Number of iterations of the active set so far."""
        return self.problem.iterations if self._taken else 0

    def increment(self, states: Sequence[tuple[Array, Array, Array]], step: float) -> list[Array]:
        """Accelerations M^-1 G' lambda, (n,) for each contact, that prevent penetration; empty if no gap closes.

        Parameters
        ----------
        states : list of three (n,) arrays
            For each contact: coordinates of its bodies, their velocities, and their accelerations without contact.
        step : float
            Length of the step [s].
        """
        h = self.predict(states, step)
        if h.min(initial=np.inf) >= 0.0:
            return self.open()
        self.take_rows()
        return self.accelerations(self.solve(h))

    def predict(self, states: Sequence[tuple[Array, Array, Array]], step: float) -> Array:
        """Return h, (nr,), of the rows of all contacts."""
        self._step = step
        gaps = [law.predict(*state, step) for law, state in zip(self.laws, states, strict=True)]
        return np.concatenate(gaps) / step**2

    def open(self) -> list[Array]:
        """Leave all rows open in the coming step; returns no accelerations."""
        for law in self.laws:
            law.open()
        return []

    def take_rows(self) -> bool:
        """Compute F of the present rows; return whether the rows have changed."""
        changed = [law.take_rows() for law in self.laws]
        if self._taken and not any(changed):
            return False
        self._slices = consecutive([len(law.F) for law in self.laws])
        self._F = scipy.linalg.block_diag(*(law.F for law in self.laws))
        for i, j, own, others in self._links:
            block = self.laws[i].G[:, own] @ self.laws[j].push[others]
            rows, columns = self._slices[i], self._slices[j]
            self._F[rows, columns] = block.toarray() if sp.issparse(block) else block
            self._F[columns, rows] = self._F[rows, columns].T
        self._by_joints: Array | None = None
        self._index: Array | None = None
        if not self._taken:
            self.problem, self._taken = Complementarity(self._F), True
        self.problem.replace(self._F, np.concatenate([law.guess for law in self.laws]))
        return True

    def split(self, lam: Array) -> list[Array]:
        """Split lam, (nr,), into the parts of the contacts."""
        return [lam[self._slices[i]] for i in range(len(self.laws))]

    def solve(self, h: Array, by_joints: Array | None = None) -> Array:
        """Return lambda, (nr,), for h, (nr,).

        `by_joints`, (nr, nr), is what joints add to F, because their forces answer to lambda.
        """
        if by_joints is not self._by_joints:
            self.problem.replace(self._F if by_joints is None else self._F + by_joints, self.problem.active)
            self._by_joints = by_joints
        lam = self.problem.solve(h)
        self._gaps = self._step**2 * (h + self.problem.F @ lam)
        return lam

    def accelerations(self, lam: Array) -> list[Array]:
        """Use lam, (nr,), in the coming step; return the accelerations that it causes, (n,) for each contact."""
        if self.problem.index is not self._index:
            self._index = self.problem.index
            self._closed = [np.flatnonzero(self.problem.active[self._slices[i]]) for i in range(len(self.laws))]
        scale = self._step**2 * (self._F.diagonal() * lam).max()
        parts = zip(self.laws, self.split(lam), self._closed, self.split(self._gaps), strict=True)
        for law, on_rows, closed, gaps in parts:
            law.close(on_rows, closed, gaps, scale)
        return [law.push @ law.lam for law in self.laws]
