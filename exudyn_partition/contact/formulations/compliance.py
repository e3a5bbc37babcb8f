"""Contact through the residual flexibility: forces without penalty parameter, with friction or without.

Theory: examples/site/theory.md, "Contact without a penalty".
"""

from __future__ import annotations

import math

import numpy as np
import scipy.linalg

from ...algebra.complementarity import Complementarity, regularised
from ...algebra.friction import FrictionProblem
from ...algebra.products import dense
from ...support.arrays import Array
from .. import loops
from ..followed import BULGE
from ..gaps import Gaps
from ..law import Forces, Law, Places, RowDirections

_MARGIN = 2 * BULGE  # of the deepest row's depth: rows with smaller gaps enter, so that the problem seldom changes
_SPARE = 10  # far rows that may stay in the problem before rows are chosen again


def compliance(rows: RowDirections) -> Law:
    """Law of a contact through the residual flexibility of its rows."""
    if rows.d == 1:
        return NormalCompliance(rows.gaps)
    return FrictionalCompliance(rows)


class NormalCompliance(Law):
    """Massless contact between two bodies whose rows have a residual flexibility.

    The modes and frames give the gaps h(q) of the rows. F is the flexibility of both bodies at the rows. The normal
    forces lambda solve

        lambda >= 0,    h + F lambda >= 0,    lambda'(h + F lambda) = 0.

    As long as the pairs stay the same, the forces are a continuous, piecewise linear function of q. They are the
    gradient of the potential 1/2 lambda' F lambda: contact stores energy and returns it, but creates none.

    While pairs slide, F is projected on the present normals and facets. It is computed again when the patches have slid
    by 1 % of a facet. Only rows that can close enter. These are rows with a negative gap, and rows whose gap is below a
    quarter of the deepest row's depth, because the surface bulges around a contact. The change of F itself causes no
    force, because rows are frictionless.

    Parameters
    ----------
    gaps : Gaps

    Raises
    ------
    IndefiniteMatrixError
        If the flexibility of the rows is not positive definite.
    """

    _held: object = None  # the frozen rows that `problem` belongs to
    _everything: Array  # their numbers
    _near: Array | None = None  # rows that could close at the last answer
    problem: Complementarity

    def __init__(self, gaps: Gaps) -> None:
        self.gaps, self._counted = gaps, 0
        self._closed_nodes = np.zeros(len(gaps.slave.surface.points), dtype=bool)
        self._take_held()

    def fresh(self, rows: RowDirections) -> NormalCompliance:
        """See `Law`."""
        return NormalCompliance(rows.gaps)

    @property
    def iterations(self) -> int:  # type: ignore[override]
        """See `Law`."""
        return self._counted + self.problem.iterations

    def _take_held(self) -> None:
        """Set up the problem for the rows that are frozen now."""
        self._everything = np.arange(len(self.gaps.row_nodes))
        self._held, self.problem = self.gaps.held, self.gaps.problem()

    def answer(self, at: Places) -> Forces:
        """See `Law`."""
        h = at.gap
        least = float(h.min())
        near = self.near(h, least)
        return self._on_rows(h, near, self.problem.solve(h if len(near) == len(h) else h[near], least))

    def closed_problem(self) -> tuple[Array, ...] | None:
        """See `Law`; None unless rows are followed and stay the same."""
        if not self.gaps.moving or self._near is None or not self.gaps.is_known(self.problem.F):
            return None
        return self._near, *self.problem.compiled

    def near(self, h: Array, least: float) -> Array:
        """Set up the problem of the rows that can close at gaps h, (nr,) [m]; return their numbers.

        `least` is the smallest gap. If rows are frozen, all of them enter.
        """
        if not self.gaps.moving:
            self.hold()
            return self._everything
        near = self._near = loops.rows_below(h, -BULGE * least, self._near)
        F = self.gaps.regularised_flexibility(near)
        if self.problem.F is not F:
            self.problem.replace(F, self._closed_nodes[self.gaps.row_nodes[near]])
            self._held = None  # the problem of the frozen rows is lost
        return near

    def hold(self) -> None:
        """Set up the problem of rows that became frozen after the last answer."""
        if not self.gaps.holds(self._held):
            self._counted += self.problem.iterations
            self._take_held()

    def found(self, h: Array, near: Array, lam: Array) -> Forces:
        """Forces on all rows, from forces lam on the rows `near`, (k,) [N], that were found elsewhere."""
        self.problem.take(lam > 0.0)
        return self._on_rows(h, near, lam)

    def _on_rows(self, h: Array, near: Array, lam: Array) -> Forces:
        if not self.gaps.moving:
            return Forces(lam[:, None], self.problem.index)
        forces, closed = np.zeros((len(h), 1)), near[self.problem.index]
        forces[near, 0] = lam
        self._closed_nodes[:] = False
        self._closed_nodes[self.gaps.row_nodes[closed]] = True
        return Forces(forces, closed)

    def stiffness(self) -> Array:
        """See `Law`: the inverse of the flexibility of the closed rows."""
        return self.problem.solve_active(np.eye(len(self.problem.index)))

    def active_flexibility(self) -> Array:
        """Flexibility of the closed rows, (na, na) [m/N]."""
        index = self.problem.index
        return self.problem.F[np.ix_(index, index)]

    def closed_stiffness(self, rows: RowDirections) -> Array:
        """See `Law`."""
        H = dense(rows.jacobian(np.arange(len(self.gaps.row_nodes))))
        half = scipy.linalg.solve_triangular(np.linalg.cholesky(self.gaps.problem().F), H, lower=True)
        value: Array = half.T @ half
        return value


class FrictionalCompliance(Law):
    """Massless contact with Coulomb friction between two bodies whose rows have a residual flexibility.

    h(q) are the gaps that the kept shapes give. s(q) is how far rows have slid along their tangents since the last
    accepted step. lambda* are the forces at the end of that step. With F for normals and tangents, the forces lambda
    solve::

        w_n = h + (F lambda)_n,    0 <= lambda_n,    0 <= w_n,    lambda_n w_n = 0,
        w_t = s + (F (lambda - lambda*))_t,    |lambda_t| <= mu lambda_n,    w_t = 0 where |lambda_t| < mu lambda_n,

    and where |lambda_t| = mu lambda_n, the slip w_t is opposite to lambda_t. There is no potential. The answer is
    unique for moderate coefficients only. For larger ones, the solver finds one answer, starting from the step before.

    Parameters
    ----------
    rows : RowDirections

    References
    ----------
    P. Alart, A. Curnier, A mixed formulation for frictional contact problems prone to Newton like solution methods,
    1991.
    """

    problem: FrictionProblem | None = None

    def __init__(self, rows: RowDirections) -> None:
        self.rows = rows
        n = len(rows.gaps.slave.surface.points)
        self._near, self._row_nodes = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
        self._F, self._guess = np.empty((0, 0)), np.zeros(n, dtype=np.int8)
        self._since = -math.inf
        self._last = np.zeros((n, 3))  # forces at the end of the last accepted step, at the slave's nodes
        self._moved = np.empty((0, 3))

    def fresh(self, rows: RowDirections) -> FrictionalCompliance:
        """See `Law`."""
        return FrictionalCompliance(rows)

    @property
    def iterations(self) -> int:  # type: ignore[override]
        """See `Law`."""
        return 0 if self.problem is None else self.problem.iterations

    def answer(self, at: Places) -> Forces:
        """See `Law`."""
        gap, last, nodes = at.gap, at.last, self.rows.gaps.row_nodes
        problem, near = self._take(gap, last)
        if at.since != self._since:  # a new step: guess that forces change as they did
            before, self._since = self._last[nodes], at.since
            self._last[:] = 0.0
            self._last[nodes] = last
            problem.extrapolate(before[near])
        h = np.column_stack([gap, at.way])[near]
        h[:, 1:] -= problem.moved_by(last[near])[:, 1:]
        found = problem.solve(h, at.mu[near])
        self._moved = problem.moved_by(found)
        forces, state, slips = np.zeros((len(gap), 3)), np.zeros(len(gap), dtype=np.int8), np.zeros((len(gap), 2))
        forces[near], state[near], slips[near] = found, problem.state, (h + self._moved)[:, 1:]
        self._guess[:] = 0
        self._guess[nodes[near]] = problem.state
        return Forces(forces, near[problem.index], state, slips)

    def _take(self, gap: Array, last: Array) -> tuple[FrictionProblem, Array]:
        """Set up the problem of rows that may close or were closed; return it and the rows' numbers."""
        least, row_nodes = float(gap.min()), self.rows.gaps.row_nodes
        needed = (gap < -BULGE * least) | (last[:, 0] > 0)
        many, kept = needed.sum(), self._row_nodes is row_nodes
        if kept and many == needed[self._near].sum() and len(self._near) < 2 * many + _SPARE:
            near = self._near
        else:
            near = np.flatnonzero(needed | (gap < -_MARGIN * least))
        F = self.rows.flexibility(near)
        if self.problem is not None and F is self._F:
            return self.problem, near
        own = regularised(F)
        if self.problem is None:
            self.problem = FrictionProblem(own)
        else:
            self.problem.replace(own, self._guess[row_nodes[near]], last[near])
        self._F, self._near, self._row_nodes = F, near, row_nodes
        return self.problem, near

    def stored(self, gap: Array, forces: Array) -> float:
        """See `Law`: 1/2 lambda' F lambda."""
        assert self.problem is not None
        return 0.5 * float(np.sum(self.problem.lam * self._moved))

    def stiffness(self) -> Array:
        """See `Law`; unsymmetric where rows slip."""
        assert self.problem is not None
        return self.problem.derivative()

    def closed_stiffness(self, rows: RowDirections) -> Array:
        """See `Law`."""
        everything = np.arange(len(self.rows.gaps.row_nodes))
        H = dense(rows.jacobian(everything))
        value: Array = H.T @ np.linalg.solve(regularised(self.rows.flexibility(everything)), H)
        return value
