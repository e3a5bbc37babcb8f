"""Multipliers of several contacts solved together: contacts that share bodies, or that joints connect.

Theory: examples/site/theory.md, "Explicit steps".
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ...algebra.complementarity import Complementarity
from ...algebra.friction import SLIP, FrictionProblem
from ...frames.kinematics import Rows
from ...support.arrays import Array, consecutive
from .lagrange import FrictionalLagrange, LagrangeContact


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

    Attributes
    ----------
    G, push : lists of (nr, n) and (n, nr) arrays or csr matrices
        Rows of each contact in the problem, and the accelerations that unit forces on them cause.
    """

    problem: Complementarity
    G: Sequence[Rows]
    push: Sequence[Rows]

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
        if self.nearest(h) >= 0.0:
            return self.open()
        self.take_rows()
        return self.accelerations(self.solve(h))

    def predict(self, states: Sequence[tuple[Array, Array, Array]], step: float) -> Array:
        """Return h, (nr,), of the rows of all contacts."""
        self._step = step
        gaps = [law.predict(*state, step) for law, state in zip(self.laws, states, strict=True)]
        return np.concatenate(gaps) / step**2

    def nearest(self, h: Array) -> float:
        """Smallest gap in h, (nr,), as `predict` returns it; infinite without rows."""
        value: float = h.min(initial=np.inf)
        return value

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
        self.G, self.push, blocks = zip(*map(self._rows, self.laws), strict=True)
        self._slices = consecutive([len(F) for F in blocks])
        self._F = scipy.linalg.block_diag(*blocks)
        for i, j, own, others in self._links:
            block = self.G[i][:, own] @ self.push[j][others]
            rows, columns = self._slices[i], self._slices[j]
            self._F[rows, columns] = block.toarray() if sp.issparse(block) else block
            self._F[columns, rows] = self._F[rows, columns].T
        self._by_joints: Array | None = None
        self._index: Array | None = None
        self._begin()
        self._taken = True
        return True

    def _rows(self, law: LagrangeContact) -> tuple[Rows, Rows, Array]:
        """G, M^-1 G' and F of a contact's rows in the problem."""
        return law.G, law.push, law.F

    def _begin(self) -> None:
        """Set up the problem of the present rows."""
        if not self._taken:
            self.problem = Complementarity(self._F)
        self.problem.replace(self._F, np.concatenate([law.guess for law in self.laws]))

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


class FrictionalIncrement(ForwardIncrement):
    """The same with Coulomb friction: three directions a row, the normal and two tangents.

    Rows of contacts without friction have a coefficient of zero. Their tangents move nothing.
    """

    friction_problem: FrictionProblem

    @property
    def iterations(self) -> int:
        """See `ForwardIncrement`."""
        return self.friction_problem.iterations if self._taken else 0

    def predict(self, states: Sequence[tuple[Array, Array, Array]], step: float) -> Array:
        """Return h, (3 nr,), of the directions of all rows: gaps, and ways along the tangents in the coming step."""
        self._step = step
        found = []
        for law, state in zip(self.laws, states, strict=True):
            places = law.predict(*state, step)
            found.append(places if isinstance(law, FrictionalLagrange) else _in_three(places))
        return np.concatenate(found) / step**2

    def nearest(self, h: Array) -> float:
        """See `ForwardIncrement`."""
        return super().nearest(h[::3])

    def _rows(self, law: LagrangeContact) -> tuple[Rows, Rows, Array]:
        if isinstance(law, FrictionalLagrange):
            return law.G, law.push, law.F
        F = np.eye(3 * len(law.F)) * law.F.diagonal().mean()
        F[::3, ::3] = law.F
        expand = sp.csr_matrix(_in_three(np.eye(len(law.F))))
        return expand @ law.G, law.push @ expand.T, F

    def _begin(self) -> None:
        states = [
            law.last_states if isinstance(law, FrictionalLagrange) else np.where(law.guess, SLIP, 0)
            for law in self.laws
        ]
        forces = [
            law.last_forces() if isinstance(law, FrictionalLagrange) else np.zeros((len(law.F), 3)) for law in self.laws
        ]
        if not self._taken:
            self.friction_problem = FrictionProblem(self._F)
        self.friction_problem.replace(self._F, np.concatenate(states), np.vstack(forces))

    def solve(self, h: Array, by_joints: Array | None = None) -> Array:
        """See `ForwardIncrement`; of all directions, (3 nr,)."""
        problem = self.friction_problem
        if by_joints is not self._by_joints:
            problem.replace(self._F if by_joints is None else self._F + by_joints, problem.state, problem.lam)
            self._by_joints = by_joints
        coefficients = [
            law.coefficients() if isinstance(law, FrictionalLagrange) else np.zeros(len(law.F)) for law in self.laws
        ]
        lam: Array = problem.solve(h.reshape(-1, 3), np.concatenate(coefficients)).ravel()
        self._places = self._step**2 * (h + problem.F @ lam)
        return lam

    def accelerations(self, lam: Array) -> list[Array]:
        """See `ForwardIncrement`."""
        scale = self._step**2 * (self._F.diagonal() * lam).max()
        for law, own, forces, places in zip(
            self.laws, self._slices, self.split(lam), self.split(self._places), strict=True
        ):
            state = self.friction_problem.state[own.start // 3 : own.stop // 3]
            if isinstance(law, FrictionalLagrange):
                law.act(forces.reshape(-1, 3), state, places.reshape(-1, 3), scale)
            else:
                law.close(forces[::3], np.flatnonzero(state), places[::3], scale)
        return [push @ forces for push, forces in zip(self.push, self.split(lam), strict=True)]


def increment_of(laws: Sequence[LagrangeContact], dofs: Sequence[Array]) -> ForwardIncrement:
    """Return what solves these contacts together: with friction in all three directions if any contact has it."""
    kind = FrictionalIncrement if any(law.friction is not None for law in laws) else ForwardIncrement
    return kind(laws, dofs)


def _in_three(normal: Array) -> Array:
    """Values of rows, (nr, ...), with zeros for the two tangents of each, (3 nr, ...)."""
    values = np.zeros((3 * len(normal), *normal.shape[1:]))
    values[::3] = normal
    return values
