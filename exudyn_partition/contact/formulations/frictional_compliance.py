"""Contact through the residual flexibility with friction: an incremental problem of normal and tangential forces.

Theory: examples/site/theory.md, "Friction".
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...algebra.complementarity import Complementarity, regularised
from ...algebra.coulomb import Coulomb
from ...algebra.friction import FrictionProblem
from ...algebra.products import dense
from ...frames.kinematics import Rows
from ...support.arrays import Array
from ..followed import BULGE
from ..gaps import Gaps
from ..plasticity.yielding_patches import YieldingPatches
from ..side import Standing
from ..tangential import directions
from .formulation import Law, Method
from .frictional import FrictionalContact

_MARGIN = 2 * BULGE  # of the deepest row's depth: rows with smaller gaps are taken, so that the problem seldom changes
_SPARE = 10  # rows that are taken though they are far, before others are chosen


class FrictionalCompliance(FrictionalContact):
    """Massless contact with Coulomb friction between two bodies whose rows have a residual flexibility.

    h(q) are the gaps of the kept shapes, s(q) the ways that rows have slid along their tangents since the last accepted
    step. With F of normals and tangents, and lambda* the forces at the end of that step, the forces lambda solve::

        w_n = h + (F lambda)_n,    0 <= lambda_n,    0 <= w_n,    lambda_n w_n = 0,
        w_t = s + (F (lambda - lambda*))_t,    |lambda_t| <= mu lambda_n,    w_t = 0 where |lambda_t| < mu lambda_n,

    and where |lambda_t| = mu lambda_n, the slip w_t is opposite to lambda_t. There is no potential. The answer is
    unique for moderate coefficients only; beyond, it is the one found from that of the step before.

    References
    ----------
    P. Alart, A. Curnier, A mixed formulation for frictional contact problems prone to Newton like solution methods,
    1991.
    """

    problem: FrictionProblem

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        self._taken = False
        self._before: Array | None = None  # forces at the end of the step before the last, by the nodes
        self._near, self._rows = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
        self._F = np.empty((0, 0))
        self._guess = np.zeros(len(self._closed_nodes), dtype=np.int8)

    @property
    def iterations(self) -> int:
        """See `Law`."""
        return self.problem.iterations if self._taken else 0

    def _find(self, gap: Array, pushed: Array) -> None:
        last, nodes = self.last_forces(), self.gaps.row_nodes
        near = self._take(gap + pushed[:, 0], last[:, 0] > 0)
        if self._before is not None:
            self.problem.extrapolate(self.on_rows(self._before)[near])
            self._before = None
        carried = self.problem.moved_by(last[near])
        h = pushed[near]
        h[:, 0] += gap[near]
        h[:, 1:] += self.tangential.way()[near] - carried[:, 1:]
        self._h = h
        found = self.problem.solve(h, self.coefficients()[near])
        self._moved = self.problem.moved_by(found)
        self.forces = np.zeros((len(gap), 3))
        self.forces[near] = found
        self._state = np.zeros(len(gap), dtype=np.int8)
        self._state[near] = self.problem.state
        self._guess[:] = 0
        self._guess[nodes[near]] = self.problem.state
        self.close_rows(self.forces[:, 0].copy(), near[self.problem.index])

    def remember(self, slips: Array, speeds: Array) -> None:
        """See `FrictionalRows`; the forces before are kept for a guess of those to come."""
        self._before = self._last.copy()
        super().remember(slips, speeds)

    def _take(self, gap: Array, closed: Array) -> Array:
        """Set up the problem of rows that may close, and of those that were `closed`; return their numbers."""
        needed = (gap < -BULGE * self.least_gap) | closed
        many, kept = needed.sum(), self._taken and self._rows is self.gaps.row_nodes
        if kept and many == needed[self._near].sum() and len(self._near) < 2 * many + _SPARE:
            near = self._near
        else:
            near = np.flatnonzero(needed | (gap < -_MARGIN * self.least_gap))
        F = self.tangential.flexibility(near)
        if self._taken and F is self._F:
            return near
        own = regularised(F)
        if not self._taken:
            self.problem, self._taken = FrictionProblem(own), True
        else:
            nodes = self.gaps.row_nodes[near]
            self.problem.replace(own, self._guess[nodes], self.last_forces()[near])
        self._F, self._near, self._rows = F, near, self.gaps.row_nodes
        return near

    def slips(self) -> Array:
        """See `FrictionalContact`."""
        slips = np.zeros((len(self.forces), 2))
        if self.index.size:
            slips[self._near] = (self._h + self._moved)[:, 1:]
        return slips

    def stored(self) -> float:
        """See `Law`: 1/2 lambda' F lambda."""
        if not self.index.size:
            return 0.0
        return 0.5 * float(np.sum(self.problem.lam * self._moved))

    @property
    def pushes(self) -> bool:
        """Whether its forces, or those at the end of the last accepted step, move the rows of other contacts."""
        return self.index.size > 0 or bool(self._last.any())

    @property
    def since(self) -> float:
        """Start of the step that forces depend on [s]."""
        return self._start

    def side_rows(self, side: int) -> Array:
        """Directions of the present rows on the flexibility coordinates of one side's patch, (3 nr, d np)."""
        return self.tangential.side_rows(side)

    def standing(self) -> Standing:
        """Where the rows stand, and which axis their tangents follow."""
        return self.tangential.standing()

    def directions(self, index: Array) -> Array:
        """Numbers of the three directions of some rows, (3 na,)."""
        return directions(index)

    def tangent_of(self, H: Rows) -> Array:
        """Stiffness of the closed rows on some coordinates, (m, m); H, (3 na, m), are derivatives of their places."""
        H = dense(H)
        return H.T @ (self.problem.derivative() @ H) if len(H) else np.zeros((H.shape[1],) * 2)

    def tangent_matrix(self, by_q: float, by_q_t: float) -> sp.csr_matrix:
        """See `Law`; unsymmetric where rows slip."""
        return sp.csr_matrix(by_q * self.tangent_of(self.tangential.jacobian(self.index)))

    def row_stiffness(self) -> Array:
        """See `Law`; in all three directions of the closed rows, (3 na, 3 na)."""
        return self.problem.derivative() if self.index.size else np.zeros((0, 0))

    def closed_stiffness(self) -> Array:
        """Contact stiffness with all rows closed and stuck, (n, n): the largest that the element can have."""
        everything = np.arange(len(self.gaps.row_nodes))
        H = dense(self.tangential.jacobian(everything))
        value: Array = H.T @ np.linalg.solve(regularised(self.tangential.flexibility()), H)
        return value

    def press(self, gap: Array) -> tuple[float, int]:
        """See `Law`; without friction."""
        F = regularised(self.gaps.flexibility(np.arange(len(gap))))
        lam = Complementarity(F).solve(gap)
        return -0.5 * float(lam @ gap), int(np.count_nonzero(lam))


class PlasticFrictionalCompliance(FrictionalCompliance):
    """Contact with friction of patches that yield, see `YieldingPatches`.

    Parameters
    ----------
    gaps : Gaps
    friction : Coulomb
    """

    yielding: YieldingPatches

    def __init__(self, gaps: Gaps, friction: Coulomb) -> None:
        super().__init__(gaps, friction)
        self.yielding = YieldingPatches(self)

    def for_run(self, method: Method) -> Law:
        """See `Law`."""
        result = self.fresh()
        result.yielding = self.yielding.for_run(result, method)
        return result

    def answer(self, gap: Array, pushed: Array | None = None) -> None:
        """See `FrictionalContact`."""
        more = np.zeros((len(gap), 3)) if pushed is None else pushed
        self.yielding.solve(lambda moved: super(PlasticFrictionalCompliance, self).answer(gap, moved), more)

    def generalised(self) -> Array:
        """Generalised forces, (n,), of rows and zones."""
        return self.yielding.generalised(super().generalised())

    def tangent_matrix(self, by_q: float, by_q_t: float) -> sp.csr_matrix:
        """See `Law`."""
        return sp.csr_matrix(by_q * self.yielding.tangent(super().tangent_matrix(1.0, 0.0).toarray()))

    def stored(self) -> float:
        """See `Law`."""
        return super().stored() + self.yielding.stored()

    def _remember(self, step: float) -> None:
        super()._remember(step)
        self.yielding.commit()

    def resume(self, earlier: Law, q: Array) -> bool:
        """See `Law`."""
        if not isinstance(earlier, PlasticFrictionalCompliance) or not earlier.ended_at(q):
            return False
        self.yielding.resume(earlier.yielding)
        super().resume(earlier, q)  # of an open contact nothing else is to be remembered
        return True
