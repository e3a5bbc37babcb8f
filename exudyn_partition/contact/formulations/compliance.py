"""Contact through the residual flexibility: forces without penalty parameter, with friction or without.

Theory: examples/site/theory.md, "Contact without a penalty".
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import scipy.linalg

from ...algebra.complementarity import Complementarity, regularised
from ...algebra.friction import MANY, OPEN, FrictionProblem
from ...algebra.products import Solved, dense
from ...support.arrays import Array
from .. import loops
from ..anchoring import SAME
from ..followed import BULGE, WIDER
from ..gaps import Gaps
from ..law import Forces, Law, Places, RowDirections
from ..normal_rows import NormalRows
from ..row_flexibility import RowFlexibility
from ..stages import NOTHING

_MARGIN = 2 * BULGE  # of the deepest row's depth: rows with smaller gaps enter, so that the problem seldom changes
_SPARE = 10  # far rows that may stay in the problem before rows are chosen again
_FEW_SPARE = 1.3  # as many times the rows that can close are left if these are many: the rest costs time
CHOOSING = BULGE, _MARGIN, _SPARE, MANY, _FEW_SPARE  # as `loops.choose_rows` takes them
SHUT = 1e-9  # of the deepest row's depth: rows that are pushed no deeper than this stay out


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
    quarter of the deepest row's depth, because the surface bulges around a contact. Where a body bends, as a plate on a
    plane, rows with larger gaps close too: if the forces push one shut, four times as large gaps enter. Where F is
    found on demand, this is not known of other rows: there, those enter whose gaps are below four times the largest
    gap of a closed row. The change of F itself causes no force, because rows are frictionless.

    Parameters
    ----------
    gaps : Gaps

    Raises
    ------
    IndefiniteMatrixError
        If the flexibility of the rows is not positive definite.
    """

    residual = True
    _posed: object = None  # the stage whose frozen rows `problem` belongs to
    _everything: Array  # their numbers
    _near: Array | None = None  # rows that could close at the last answer
    # These rows, their anchor, their stance there, and the share of the depth below which gaps entered.
    _stood: tuple[object, object, Array, float] = (None, None, NOTHING, BULGE)
    _flexibility: RowFlexibility  # that of these rows there
    problem: Complementarity

    def __init__(self, gaps: Gaps) -> None:
        self.gaps, self.rows = gaps, NormalRows(gaps)
        none = np.empty(0, dtype=np.int64)
        self._closed = none, none  # nodes of the rows at the last answer with rows that moved, and which were closed
        self._set_up_problem()

    def _set_up_problem(self) -> None:
        """Set up the problem for the rows that are frozen now."""
        self._everything = np.arange(len(self.gaps.row_nodes))
        few = self.gaps.moving and (self.gaps.sides.on_demand or self.gaps.anywhere)
        self._posed = self.gaps.stage
        self.problem = Complementarity(np.eye(1)) if few else self.rows.problem()  # until rows near each other ask

    def answer(self, places: Places) -> Forces:
        """See `Law`."""
        h, least = places.gap, places.least
        if self.gaps.moving and (repeated := self._answer_as_before(h, least)) is not None:
            return repeated
        share, iterations = BULGE, 0
        while True:
            near, before = self.near(h, least, share), self.problem.iterations
            lam = self.problem.solve(h if len(near) == len(h) else h[near], least)
            iterations += self.problem.iterations - before
            if not self.misses(h, near, lam, least, share):
                return self._on_rows(h, near, lam, iterations)
            share *= WIDER

    def _answer_as_before(self, h: Array, least: float) -> Forces | None:
        """Answer in one compiled call if the same rows may close as before, and have hardly moved since; else None."""
        gaps, near = self.gaps, self._near
        if near is None or self._stood[:2] != (gaps.stage.rows, gaps.present.anchor) or not loops.at_once():
            return None
        problem, (_, _, then, share) = self.problem, self._stood
        stance = gaps.stance(), then, SAME
        wrong, forces = loops.answer_as_before(h, -share * least, near, stance, problem.compiled)
        if wrong < 0:
            return None
        before = problem.iterations
        if wrong:
            forces[near, 0] = problem.solve(h[near], least)
        else:
            problem.iterations += 1
        if self.misses(h, near, forces[near, 0], least, share):
            return None
        return self._of_near(near, forces, problem.iterations - before)

    def misses(self, h: Array, near: Array, lam: Array, least: float, share: float) -> bool:
        """Whether rows close that did not enter.

        Gaps are h, (nr,) [m], the smallest is `least`. Those below a share of its depth, `near`, have entered, and have
        forces lam, (k,) [N].
        """
        if len(near) == len(h) or least >= 0.0:  # others may have moved all rows apart
            return False
        if self.gaps.sides.on_demand:
            return bool(WIDER * h[near[lam > 0.0]].max(initial=least) > -share * least)
        return self._flexibility.shuts(h, near, lam, SHUT * least)

    def near(self, h: Array, least: float, share: float = BULGE) -> Array:
        """Set up the problem of the rows that can close at gaps h, (nr,) [m]; return their numbers.

        `least` is the smallest gap. Gaps below a share of its depth enter; if rows are frozen, all of them.
        """
        if not self.gaps.moving:
            self.renew_problem()
            return self._everything
        near = self._near = loops.rows_below(h, -share * least, self._near)
        self._flexibility = self.rows.row_flexibility(near)
        F = self._flexibility.regularised_between(near)
        if self.problem.F is not F:
            (nodes, rows), closed = self._closed, np.zeros(len(self.gaps.slave.surface.points), dtype=bool)
            closed[nodes[rows]] = True
            self.problem.replace(F, closed[self.gaps.row_nodes[near]])
            self._posed = None  # the problem of the frozen rows is lost
        anchor = self.gaps.present.anchor
        stance = NOTHING if anchor is None else self.gaps.anchoring.stance(anchor)
        self._stood = self.gaps.stage.rows, anchor, stance, share
        return near

    def renew_problem(self) -> None:
        """Set up the problem of rows that became frozen after the last answer."""
        if self.gaps.stage != self._posed:
            self._set_up_problem()

    def forces_on_all(self, h: Array, near: Array, lam: Array, iterations: int) -> Forces:
        """Forces on all rows, from forces lam on the rows `near`, (k,) [N], that were found elsewhere."""
        self.problem.set_active(lam > 0.0)
        return self._on_rows(h, near, lam, iterations)

    def _on_rows(self, h: Array, near: Array, lam: Array, iterations: int) -> Forces:
        if not self.gaps.moving:
            return Forces(lam[:, None], self.problem.index, stiffness=self.problem.inverse(), iterations=iterations)
        forces = np.zeros((len(h), 1))
        forces[near, 0] = lam
        return self._of_near(near, forces, iterations)

    def _of_near(self, near: Array, forces: Array, iterations: int) -> Forces:
        """Forces, (nr, 1) [N], of rows that move, of which some are near, (k,)."""
        closed = near[self.problem.index]
        self._closed = self.gaps.row_nodes, closed
        return Forces(forces, closed, stiffness=self.problem.inverse(), iterations=iterations)

    def active_flexibility(self) -> Array:
        """Flexibility of the closed rows, (na, na) [m/N]."""
        index = self.problem.index
        return self.problem.F[np.ix_(index, index)]

    def closed_stiffness(self, rows: RowDirections) -> Array:
        """See `Law`."""
        return self.gaps.stage.by_pairs("closed stiffness", lambda: self._closed_stiffness(rows))

    def _closed_stiffness(self, rows: RowDirections) -> Array:
        H = dense(rows.jacobian(np.arange(len(self.gaps.row_nodes))))
        half = scipy.linalg.solve_triangular(np.linalg.cholesky(self.rows.problem().F), H, lower=True)
        value: Array = half.T @ half
        return value


class FrictionalCompliance(Law):
    """Massless contact with Coulomb friction between two bodies whose rows have a residual flexibility.

    h(q) are the gaps that the kept shapes give. s(q) is how far rows have slid along their tangents since the last
    accepted step. lambda* are the forces at the end of that step. With F for normals and tangents, the forces lambda
    solve::

        w_n = h + (F lambda)_n,    0 <= lambda_n,    0 <= w_n,    lambda_n w_n = 0,
        w_t = s + (F (lambda - lambda*))_t,    |lambda_t| <= mu lambda_n,    w_t = 0 where |lambda_t| < mu lambda_n,

    and where |lambda_t| = mu lambda_n, the slip w_t is opposite to lambda_t. Rows that forces push shut enter, see
    `NormalCompliance`. There is no potential. The answer is unique for moderate coefficients only. For larger ones, the
    solver finds one answer, starting from the step before.

    Parameters
    ----------
    rows : RowDirections

    References
    ----------
    P. Alart, A. Curnier, A mixed formulation for frictional contact problems prone to Newton like solution methods,
    1991.
    """

    residual = True
    problem: FrictionProblem | None = None

    def __init__(self, rows: RowDirections) -> None:
        self.rows, self.closing = rows, ClosingRows(rows)

    def answer(self, places: Places) -> Forces:
        """See `Law`."""
        closing, before = self.closing, 0 if self.problem is None else self.problem.iterations
        closing.choose(places.gap, places.last)
        while True:
            h, lam, problem = self._solve(places)
            closing.remember(problem.state)
            if not closing.shuts(places.gap, lam, places.least):
                break
        iterations = problem.iterations - before
        return self.forces_on_all(closing, lam, problem.moved_by(lam), h, problem.state, iterations, problem.tangent())

    def _solve(self, places: Places) -> tuple[Array, Array, FrictionProblem]:
        """Gaps and slips without forces of the rows that can close, (k, 3) [m], forces, (k, 3) [N], and the problem."""
        closing, near, last = self.closing, self.closing.index, places.last
        F, is_new = closing.flexibility()
        if self.problem is None:
            self.problem = FrictionProblem(F)
        elif is_new:
            self.problem.replace(F, closing.states, last[near])
        problem, before = self.problem, closing.exchange(places.since, last)
        if before is not None:  # a new step: guess that forces change as they did
            problem.extrapolate(before)
        h = np.empty((len(near), 3))
        h[:, 0], h[:, 1:] = places.gap[near], places.way[near] - problem.moved_by(last[near])[:, 1:]
        return h, problem.solve(h, places.mu[near]), problem

    def forces_on_all(
        self,
        closing: ClosingRows,
        lam: Array,
        moved: Array,
        h: Array,
        state: Array,
        iterations: int,
        stiffness: Callable[[], Solved] | None = None,
    ) -> Forces:
        """Forces on all rows.

        Parameters
        ----------
        closing : ClosingRows
        lam : (k, 3) array
            Forces on the rows that can close [N].
        moved : (k, 3) array
            How far forces move them [m].
        h : (k, 3) array
            Their gaps and slips without forces [m].
        state : (k,) int8 array
        iterations, stiffness
            See `Forces`.
        """
        stored = 0.5 * float(np.vdot(lam, moved))
        near, n = closing.index, len(self.rows.gaps.row_nodes)
        forces, states, slips = np.zeros((n, 3)), np.zeros(n, dtype=np.int8), np.zeros((n, 2))
        forces[near], states[near], slips[near] = lam, state, (h + moved)[:, 1:]
        closed = near[state != OPEN]
        return Forces(forces, closed, states, slips, stored=stored, stiffness=stiffness, iterations=iterations)

    def closed_stiffness(self, rows: RowDirections) -> Array:
        """See `Law`."""
        everything = np.arange(len(self.rows.gaps.row_nodes))
        H = dense(rows.jacobian(everything))
        value: Array = H.T @ np.linalg.solve(regularised(self.rows.flexibility(everything)), H)
        return value


class ClosingRows:
    """Rows of a contact that can close, and what is guessed of them.

    They change seldom: rows that have left stay for a while.

    Parameters
    ----------
    rows : RowDirections
        With d = 1 or 3 directions.

    Attributes
    ----------
    index : (k,) int array
        Their numbers among the present rows.
    """

    def __init__(self, rows: RowDirections) -> None:
        self.rows = rows
        n = len(rows.gaps.slave.surface.points)
        self.index, self._row_nodes = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
        self._near = np.empty(0, dtype=bool)  # which of the present rows are chosen
        self._F: Array = np.empty((0, 0))
        self._regularised = self._F
        self._pushing: Array | None = None  # motion of all rows by forces on those of `_F`, found when it is needed
        self._states = np.zeros(n, dtype=np.int8)  # at the slave's nodes
        self._since = -math.inf
        self._last = np.zeros((n, 3))  # forces at the end of the last accepted step, at the slave's nodes

    def choose(self, gap: Array, last: Array, *, more: bool = False) -> Array:
        """Choose the rows for gaps, (nr,) [m], and forces at the end of the last step, (nr, 3) [N]; return them.

        With `more`, those that were chosen stay.
        """
        row_nodes = self.rows.gaps.row_nodes
        if self._row_nodes is not row_nodes:
            self._row_nodes, self._near = row_nodes, np.zeros(len(row_nodes), dtype=bool)
            self.index = np.empty(0, dtype=np.int64)
        if loops.choose_rows(gap, last, self._near, more, CHOOSING):
            self.index = np.flatnonzero(self._near)
        return self.index

    def shuts(self, gap: Array, lam: Array, least: float) -> bool:
        """Whether forces on the rows, (k, 3) [N], push others shut, which are among them then.

        Gaps are those without these forces, (nr,) [m], the least is known. Where flexibility is found on demand, this
        is not known of other rows: see `NormalCompliance`.
        """
        if least >= 0.0 or len(self.index) == len(gap):
            return False
        if self._pushing is None and not self.rows.gaps.sides.on_demand:
            self._pushing = self.rows.pushing(self.index)
        if self._pushing is None:
            largest = float(gap[self.index[lam[:, 0] > 0.0]].max(initial=least))
            shuts = self._enter(gap < max(-BULGE * least, WIDER * largest))
        else:
            on_rows = lam[:, : self.rows.d].ravel()
            shuts = loops.close_pushed(self._pushing, gap, self._near, on_rows, SHUT * least)
        if shuts:
            self.index = np.flatnonzero(self._near)
        return shuts

    def _enter(self, rows: Array) -> bool:
        """Let more rows enter, (nr,) bool; return whether there are any."""
        more = bool((rows & ~self._near).any())
        self._near |= rows
        return more

    def flexibility(self) -> tuple[Array, bool]:
        """Regularised flexibility of the rows, (d k, d k) [m/N], and whether it is another than last time."""
        F = self.rows.flexibility(self.index)
        is_new = F is not self._F
        if is_new:
            self._F, self._regularised, self._pushing = F, regularised(F), None
        return self._regularised, is_new

    @property
    def states(self) -> Array:
        """Guess of the rows' states, (k,)."""
        value: Array = self._states[self._row_nodes[self.index]]
        return value

    def remember(self, states: Array) -> None:
        """Take states of the rows, (k,), as the next guess."""
        self._states[:] = 0
        self._states[self._row_nodes[self.index]] = states

    def forget(self) -> None:
        """Guess that no row was closed in the last steps."""
        self._last[:] = 0.0

    def exchange(self, since: float, last: Array) -> Array | None:
        """Keep the last forces; return those of the step before, on the rows, (k, 3) [N]; None if the step is known."""
        if since == self._since:
            return None
        nodes = self._row_nodes
        before, self._since = self._last[nodes], since
        self._last[:] = 0.0
        self._last[nodes] = last
        return np.asarray(before[self.index])
