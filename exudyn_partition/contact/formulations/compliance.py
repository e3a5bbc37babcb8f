"""Contact through the residual flexibility: a force element without penalty parameter.

Theory: examples/site/theory.md, "Contact without a penalty".
"""

from __future__ import annotations

import math

import numpy as np
import scipy.linalg

from ...algebra.complementarity import Complementarity, regularised
from ...algebra.products import dense, smallest
from ...errors import ComplementarityError
from ...frames.kinematics import Rows
from ...support.arrays import Array
from .. import loops
from ..followed import BULGE
from ..gaps import Gaps
from ..plasticity.yielding_patches import YieldingPatches
from ..side import Standing
from .formulation import Law, Method, Motion
from .law import ElasticContact


class ComplianceContact(ElasticContact):
    """Massless contact between two bodies whose rows have a residual flexibility.

    The modes and frames give the gaps h(q) of the rows. F is the flexibility of both bodies at the rows. The normal
    forces lambda solve

        lambda >= 0,    h + F lambda >= 0,    lambda'(h + F lambda) = 0.

    As long as the pairs stay the same, the forces are a continuous, piecewise linear function of q. They are the
    gradient of the potential 1/2 lambda' F lambda: contact stores energy and returns it, but creates none.

    While pairs slide, F is projected on the present normals and facets. It is computed again when the patches have
    slid by 1 % of a facet. Only rows that can close enter: rows with a negative gap, and rows whose gap is below a
    quarter of the deepest row's depth, as the surface bulges around a contact. The change of F itself makes no force,
    because rows are frictionless.

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
    _closed_of: tuple[Array | None, ...] = (None, None, None)  # present rows, those near, and closed ones of these
    _regularised_of: Array | None = None  # the flexibility that `_regularised` is made of
    _regularised: Array | None = None
    problem: Complementarity

    @property
    def iterations(self) -> int:
        """See `Law`."""
        return self._iterations + self.problem.iterations

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        self._iterations = 0
        self._take_held()

    def _take_held(self) -> None:
        """Set up the problem for the rows that are frozen now; reuse F if they are the same."""
        if self._held is self.gaps.held is not None:
            self.problem = self.problem.fresh()  # with the same F
            return
        self._held, self._everything = self.gaps.held, np.arange(len(self.gaps.row_nodes))
        self.problem = self.gaps.problem()

    def _flexibility(self, index: Array) -> Array:
        """Flexibility of some present rows, (na, na) [m/N], regularised as in `Gaps.problem`."""
        F = self.gaps.flexibility(index)
        if self._regularised is None or F is not self._regularised_of:
            self._regularised_of, self._regularised = F, regularised(F)
        return self._regularised

    def answer(self, gap: Array, pushed: float | Array = 0.0) -> None:
        """Find the forces on the present rows from their gaps, (nr,) [m].

        `pushed`, (nr,) [m], is what the forces of other contacts add to the gaps.
        """
        self.h = gap
        h = gap if isinstance(pushed, float) else gap + pushed
        if self.gaps.moving and self._answered_again(h):
            return
        self.least_gap = smallest(h)
        if self.gaps.moving and self.least_gap >= 0.0:
            self.open_rows()
            return
        near = self.near(h, self.least_gap)
        self._take_forces(near, self.problem.solve(h if near is self._everything else h[near], self.least_gap))

    def force(self, q: Array) -> Array:
        """See `ElasticContact.force`; while the closed rows stay the same, gaps and forces are found in one call."""
        F, near = self._regularised_of, self._near
        if not self.gaps.moving or not self._same_rows or F is None or near is None:
            return super().force(q)
        self.h, found = self.gaps.pressed_at(q, F, (near, *self.problem.compiled))
        if found is None:
            self.answer(self.h)
            return self.generalised()
        self.lam, value, self.least_gap = found
        self.problem.iterations += 1
        return value

    @property
    def _same_rows(self) -> bool:
        """Whether the problem is that of the last answer, which had closed rows, and the same rows are present."""
        rows, near, closed = self._closed_of
        same = near is self._near and closed is self.problem.index and self.problem.F is self._regularised
        return same and rows is self.gaps.row_nodes and self.index.size > 0

    def _answered_again(self, h: Array) -> bool:
        """Find the forces, if the rows that can close and those that are closed stay the same."""
        problem, near = self.problem, self._near
        if near is None or not self._same_rows or problem.F is not self._flexibility(near):
            return False
        found = loops.answer_again(h, near, problem, BULGE)
        if found is not None:
            problem.iterations += 1
            self.lam, self.least_gap = found
        return found is not None

    def near(self, h: Array, least: float) -> Array:
        """Set up the problem of the rows that can close at gaps h, (nr,) [m]; return their numbers.

        `least` is the smallest gap. Of frozen rows, these are all.
        """
        if not self.gaps.moving:
            self.hold()
            return self._everything
        if math.isnan(least):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        near = self._near = loops.rows_below(h, -BULGE * least, self._near)
        F = self._flexibility(near)
        if self.problem.F is not F:
            self.problem.replace(F, self._closed_nodes[self.gaps.row_nodes[near]])
            self._held = None  # the problem of the frozen rows is lost
        return near

    def hold(self) -> None:
        """Set up the problem of rows that have been frozen since the last answer."""
        if self._held is not self.gaps.held:
            self._iterations += self.problem.iterations
            self._take_held()

    def take(self, gap: Array, moved: Array, near: Array, lam: Array) -> None:
        """Take forces lam on the rows `near`, (k,) [N], that were found together with those of other contacts.

        `moved`, (nr,) [m], are the gaps where the forces of the others have moved them.
        """
        self.h, self.least_gap = gap, moved.min(initial=np.inf)
        self.problem.take(lam > 0.0)
        self._take_forces(near, lam)

    def stay_open(self, gap: Array, moved: Array) -> None:
        """Open all rows; their gaps are `moved`, (nr,) [m], where the forces of other contacts have moved them."""
        self.h, self.least_gap = gap, moved.min(initial=np.inf)
        self.open_rows()

    def _take_forces(self, near: Array, lam: Array) -> None:
        if near is self._everything:
            self.lam, self.index = lam, self.problem.index
            return
        forces = np.zeros(len(self.h))
        forces[near] = lam
        self.close_rows(forces, near[self.problem.index])
        self._closed_of = self.gaps.row_nodes, near, self.problem.index

    @property
    def forces(self) -> Array:
        """`lam`; with friction, laws have forces in three directions here, see `FrictionalContact`."""
        return self.lam

    @property
    def pushes(self) -> bool:
        """Whether its forces move the rows of other contacts."""
        return self.index.size > 0

    @property
    def since(self) -> float:
        """Start of the step that forces depend on; no step matters here."""
        return 0.0

    def side_rows(self, side: int) -> Rows:
        """Present rows on the flexibility coordinates of one side's patch, (nr, d np)."""
        return self.gaps.side_rows(side)

    def standing(self) -> Standing:
        """Where the rows stand."""
        return self.gaps.standing()

    def directions(self, index: Array) -> Array:
        """Numbers of the directions of some rows: one for each row."""
        return index

    def tangent_of(self, H: Array) -> Array:
        """Stiffness H' F_AA^-1 H, (m, m), of the closed rows on any coordinates, H (na, m)."""
        return H.T @ self.problem.solve_active(H) if len(H) else np.zeros((H.shape[1],) * 2)

    def active_flexibility(self) -> Array:
        """Flexibility of the closed rows, (na, na) [m/N]."""
        index = self.problem.index if self.index.size else self.index
        return self.problem.F[np.ix_(index, index)]

    def closed_stiffness(self) -> Array:
        """Contact stiffness with all rows closed, (n, n): the largest that the element can have."""
        H = dense(self.gaps.jacobian(np.arange(len(self.gaps.row_nodes))))
        half = scipy.linalg.solve_triangular(np.linalg.cholesky(self.gaps.problem().F), H, lower=True)
        value: Array = half.T @ half
        return value


class PlasticCompliance(ComplianceContact):
    """Frictionless contact of patches that yield, see `YieldingPatches`. It remembers, and has no potential.

    Parameters
    ----------
    gaps : Gaps
    """

    elastic = False
    remembers = True
    yielding: YieldingPatches

    def __init__(self, gaps: Gaps) -> None:
        super().__init__(gaps)
        self.yielding = YieldingPatches(self)

    def for_run(self, method: Method) -> Law:
        """See `Law`."""
        result = self.fresh()
        result.yielding = self.yielding.for_run(result, method)
        return result

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        self._start, self._answered = -math.inf, False

    def answer(self, gap: Array, pushed: float | Array = 0.0) -> None:
        """See `ComplianceContact`."""
        self._answered = True
        more = np.zeros(len(gap)) if isinstance(pushed, float) else pushed
        self.yielding.solve(lambda moved: super(PlasticCompliance, self).answer(gap, moved), more)

    def press(self, gap: Array) -> tuple[float, int]:
        """See `Law`; while nothing yields."""
        super().answer(gap)
        return super().stored(), len(self.index)

    def evaluate(self, motion: Motion) -> Array:
        """See `Law`."""
        return self.force(motion.q)

    def generalised(self) -> Array:
        """Generalised forces, (n,), of rows and zones."""
        return self.yielding.generalised(super().generalised())

    def tangent(self) -> Array:
        """Contact stiffness -d force / d q of closed rows and zones, (n, n), with the pairs held."""
        return self.yielding.tangent(super().tangent())

    @property
    def since(self) -> float:
        """Start of the step that forces depend on [s]."""
        return self._start

    def stored(self) -> float:
        """See `Law`."""
        lam = self.lam[self.index]
        return 0.5 * float(lam @ (self.active_flexibility() @ lam)) + self.yielding.stored()

    def commit(self, start: float) -> None:
        """See `Law`."""
        if self._answered and start > self._start:
            self.yielding.commit()
        self._start, self._answered = start, False

    def resume(self, earlier: Law, q: Array) -> bool:
        """See `Law`."""
        if not isinstance(earlier, PlasticCompliance) or not earlier.ended_at(q):
            return False
        self.yielding.resume(earlier.yielding)
        return True
