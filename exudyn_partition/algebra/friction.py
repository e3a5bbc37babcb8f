"""Unilateral contact with Coulomb friction: the forces that answer given gaps and slips of contact rows.

Theory: examples/site/theory.md, "Friction".
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..errors import ComplementarityError
from ..support.arrays import Array
from . import loops
from .closed_rows import ClosedRows
from .complementarity import Complementarity
from .flat_friction import (
    CHORD_STEPS,
    FACTORISATIONS,
    ITERATIONS,
    N_CLOSED,
    NEWTON_STEPS,
    PROGRESS,
    ROUNDING,
    TOLERANCE,
    FlatFriction,
)
from .friction_sweeps import sweep
from .many_rows import ManyRows
from .products import Solved, weighted_rows

OPEN, STICK, SLIP = 0, 1, 2

_LEAST_STRIDE = 1e-3  # by which friction rises
_SWEEPS = (5, 10, 20, 40, 80, 160, 320)  # before each further attempt of Newton's method
MANY = 200  # rows that close from which `many_rows` is quicker


class FrictionProblem:
    """Forces of contact rows with unilateral contact and Coulomb's friction.

    Each row has a normal force and two tangential forces, and w = h + F lambda are its gap and its slip::

        0 <= lambda_n,   w_n >= 0,   lambda_n w_n = 0
        |lambda_t| <= mu lambda_n,   w_t = -kappa lambda_t,   kappa >= 0,   kappa (mu lambda_n - |lambda_t|) = 0

    Newton's method solves the equations of Alart and Curnier, which the projections on these sets give. Closed rows
    alone enter. The states, the forces and the factors of the Jacobian are kept between calls; as long as the factors
    reduce the residual, Broyden's formula corrects them. Rows open or close when the forces of the others have
    settled. If that does not end, friction rises from zero in steps. The last resort is Newton's method after sweeps
    over the rows, each of which is solved exactly.

    A solution exists for every positive definite F and every mu. It is unique only if mu is moderate; beyond that, the
    result is the solution that the last state leads to.

    Parameters
    ----------
    F : (3 nr, 3 nr) array
        Symmetric positive definite flexibility of the rows [m/N]; each row has a normal, then two tangents. Rows may
        be redundant if it is `regularised`.

    Attributes
    ----------
    state : (nr,) int8 array
        OPEN, STICK or SLIP, for each row.
    lam : (nr, 3) array
        Forces of the last answer [N].
    index : (na,) int array
        Closed rows.
    iterations, factorisations, sweeps : int
        How many Newton steps, factorisations and sweeps there were so far.

    Raises
    ------
    IndefiniteMatrixError
        If F is not symmetric positive definite.

    References
    ----------
    P. Alart, A. Curnier, A mixed formulation for frictional contact problems prone to Newton like solution methods,
    Comput. Methods Appl. Mech. Eng. 92 (1991) 353. C.T. Kelley, Solving Nonlinear Equations with Newton's Method,
    SIAM 2003, chapter 4.
    """

    def __init__(self, F: Array) -> None:
        self.F = Complementarity(F).F  # which checks it
        self.iterations = self.factorisations = self.sweeps = 0
        self._scale(self.F.diagonal())
        self._open_all()

    def _open_all(self) -> None:
        """Open all rows."""
        nr = len(self._inverse)
        self._restart(np.zeros(nr, dtype=np.int8), np.zeros((nr, 3)))

    def replace(self, F: Array, state: Array, lam: Array) -> None:
        """Go on with other rows.

        Parameters
        ----------
        F : (3 nr, 3 nr) array
            Their flexibility [m/N], which is not checked.
        state : (nr,) array
            Guess of their states.
        lam : (nr, 3) array
            Guess of their forces [N].
        """
        self.F = F
        self._scale(F.diagonal())
        self._restart(state, lam)

    def _scale(self, diagonal: Array) -> None:
        """Scale slips and gaps to forces by the diagonal of F, (3 nr,)."""
        nr = len(diagonal) // 3
        self._flat: FlatFriction | None = None  # the problem as compiled loops take it, made when it is needed
        self._many: ManyRows | None = None  # the problem of many rows, made when it is needed
        self._asked = np.zeros((nr, 3)), np.zeros(nr)  # gaps and slips, and coefficients, of the last answer
        self._inverse = 1.0 / diagonal.reshape(-1, 3)
        self._inverse[:, 1:] = self._inverse[:, 1:].mean(axis=1, keepdims=True)

    def _restart(self, state: Array, lam: Array) -> None:
        """Go on with the same rows from guesses, see `replace`."""
        self.state, self.lam = np.array(state, dtype=np.int8), np.array(lam, dtype=float)
        self._close(np.flatnonzero(self.state))

    def _close(self, index: Array) -> None:
        """Take these rows as the closed ones, (na,)."""
        self._rows: ClosedRows | None = None
        self.index, self._closes = index, True

    @property
    def _closed(self) -> ClosedRows:
        """Equations of the closed rows, which compiled loops do not need."""
        if self._rows is None:
            self._rows = self._equations(self.index)
        return self._rows

    @property
    def _dense(self) -> bool:
        """Whether the flexibility is one matrix."""
        return True

    def _equations(self, index: Array) -> ClosedRows:
        """Equations of some closed rows, (na,)."""
        return ClosedRows(self.F, self._inverse, index)

    @property
    def _by_rows(self) -> Array:
        """F, row after row in memory; F is symmetric."""
        F = self.F
        return F if F.flags.c_contiguous else np.ascontiguousarray(F.T)

    def extrapolate(self, before: Array) -> None:
        """Guess that forces change again as they have from `before`, (nr, 3) [N], to the last answer."""
        ahead = 2.0 * self.lam - before
        go_on = (self.lam[:, 0] > 0.0) & (before[:, 0] > 0.0) & (ahead[:, 0] > 0.0)
        self.lam = np.where(go_on[:, None], ahead, self.lam)

    def solve(self, h: Array, mu: Array) -> Array:
        """Return the forces, (nr, 3) [N].

        Parameters
        ----------
        h : (nr, 3) array
            Gap of each row, and its tangential way since the last accepted step, without the forces [m].
        mu : (nr,) array
            Coefficient of friction of each row.

        Raises
        ------
        ComplementarityError
            If h is not finite, or no solution was found.
        """
        if not math.isfinite(h.sum()):
            raise ComplementarityError("the gaps or slips are not finite: the run has become unstable")
        if h[:, 0].min(initial=np.inf) >= 0.0:
            if self.index.size:
                self._open_all()
            return np.zeros_like(h)
        if not self.index.size:
            self._close(np.flatnonzero(h[:, 0] < 0.0))
        self._asked = h, mu
        if self._settle_many(h, mu) or self._newton(h, mu) or self._continue(h, mu) or self._sweep(h, mu):
            return self.lam
        raise ComplementarityError(
            f"the forces of {len(h)} contact rows with friction did not settle: not in {NEWTON_STEPS} Newton steps, "
            f"not while the coefficients rose from zero to {mu.max():g}, and not after {sum(_SWEEPS)} sweeps. Rows are "
            "nearly redundant, or friction is too high"
        )

    def _settle_many(self, h: Array, mu: Array) -> bool:
        """Find the forces of many rows from the last ones, see `many_rows`; return whether they settled."""
        if len(self.index) < MANY and np.count_nonzero(h[:, 0] < 0.0) < MANY:
            return False
        if self._many is None:
            self._many = ManyRows(self.F, self._inverse)
        solution = self._many.solve(h, mu, self.lam)
        self.iterations += self._many.iterations
        self.factorisations += self._many.factorisations
        if solution is None:
            return False
        self._close(np.flatnonzero(solution.closed))
        self.state = np.where(solution.slips, SLIP, np.where(solution.closed, STICK, OPEN)).astype(np.int8)
        self.lam = solution.forces
        return True

    def moved_by(self, lam: Array) -> Array:
        """How far forces, (nr, 3) [N], move the rows, F lambda, (nr, 3) [m]; most of them are on closed rows."""
        return weighted_rows(lam.ravel(), self._by_rows).reshape(-1, 3)

    def _continue(self, h: Array, mu: Array) -> bool:
        """Let friction rise from zero in steps, each of which begins at the last answer; return whether it settled."""
        reached, stride = 0.0, 0.25
        self._close(np.flatnonzero(h[:, 0] < 0.0))
        self.lam = np.zeros_like(h)
        settled = self._newton(h, 0.0 * mu)
        while settled and reached < 1.0:
            share, state, lam = min(1.0, reached + stride), self.state, self.lam
            if self._newton(h, share * mu):
                reached, stride = share, 2.0 * stride
            else:
                self._restart(state, lam)
                stride /= 2.0
                settled = stride > _LEAST_STRIDE
        return settled

    def _sweep(self, h: Array, mu: Array) -> bool:
        """Begin Newton's method after sweeps over the rows; return whether it settled."""
        lam = np.zeros_like(h)
        for count in _SWEEPS:
            for _ in range(count):
                lam = sweep(self.F, h, mu, lam)
            self.sweeps += count
            self._restart(lam[:, 0] > 0.0, lam)
            if self._newton(h, mu):
                return True
        return False

    def _newton(self, h: Array, mu: Array) -> bool:
        """Iterate from the last forces; return whether they settled."""
        settled = self._loop(h, mu)
        return self._iterate(h, mu) if settled is None else settled

    def _loop(self, h: Array, mu: Array) -> bool | None:
        """Iterate by compiled loops; None if there are none for this problem."""
        if not (self._dense and loops.newton_at_once()):
            return None
        if self._flat is None:
            self._flat, self._closes = FlatFriction.of(len(h), self._by_rows.ravel(), self._inverse.ravel()), True
            self._object = loops.friction_object(self._flat)
        flat, closes = self._flat, self._closes
        if closes:
            flat.counts[N_CLOSED] = len(self.index)
            flat.closed[: len(self.index)] = self.index
        flat.state[:], flat.lam[:] = self.state, self.lam.ravel()
        flat.counts[[ITERATIONS, FACTORISATIONS]] = 0
        limits = TOLERANCE, ROUNDING, PROGRESS, NEWTON_STEPS, CHORD_STEPS
        settled = loops.newton_friction(self._object, h, mu, closes, limits)
        self.iterations += int(flat.counts[ITERATIONS])
        self.factorisations += int(flat.counts[FACTORISATIONS])
        self.index, self._rows, self._closes = flat.closed[: flat.counts[N_CLOSED]].copy(), None, False
        self.state, self.lam = flat.state.copy(), flat.lam.reshape(-1, 3).copy()
        return settled

    def _iterate(self, h: Array, mu: Array) -> bool:
        """See `_newton`; by NumPy and LAPACK."""
        deepest = abs(h[:, 0]).max()
        lam, size = self._load(h, mu)
        share = np.inf  # of the residual, by which the next step will move the largest force
        for _ in range(NEWTON_STEPS + 1):
            closed, largest = self._closed, abs(lam).max()
            settled = size <= ROUNDING * largest or share * size <= TOLERANCE * largest
            if settled or closed.steps == 1:
                leaving = lam[::3] < -ROUNDING * largest
                entering = h[closed.open, 0] + closed.moved_open(lam) < -ROUNDING * deepest
                if leaving.any() or entering.any():
                    self._keep_forces(lam)
                    self._exchange(leaving, entering, h)
                    lam, size = self._load(h, mu)
                    share, closed, settled = np.inf, self._closed, False
                if settled:
                    self._keep_forces(closed.allowed(lam))
                    return True
            if closed.stale:
                closed.factorise(lam)
                self.factorisations += 1
            self.iterations += 1
            step, largest = closed.step()
            lam = lam + step
            before, size = size, closed.residual(lam)
            share = largest / before if before else 0.0
            slow = closed.steps > 1 and size > PROGRESS * before
            # Steps with the factors of other states may lead back to those, again and again.
            closed.stale = slow or closed.steps > CHORD_STEPS or closed.changed
        return False

    def _load(self, h: Array, mu: Array) -> tuple[Array, float]:
        """Take the problem for the closed rows; return their forces, (3 na,), and the largest residual."""
        self._closed.load(h[self.index], mu[self.index])
        lam = self.lam[self.index].ravel()
        return lam, self._closed.residual(lam)

    def _exchange(self, leaving: Array, entering: Array, h: Array) -> None:
        """Open some of the closed rows, (na,) bool, and close some of the open ones; never open all."""
        self.lam[self.index[leaving]] = 0.0
        self.state[self.index[leaving]] = OPEN
        self.state[self._closed.open[entering]] = STICK
        if not self.state.any():
            self.state[h[:, 0] < 0.0] = STICK
        self._close(np.flatnonzero(self.state))

    def _keep_forces(self, lam: Array) -> None:
        """Keep forces, (3 na,), and the states that they show."""
        self.state, self.lam = np.zeros(len(self.state), dtype=np.int8), np.zeros(self.lam.shape)
        self.state[self.index] = np.where(self._closed.slips, SLIP, STICK)
        self.lam[self.index] = lam.reshape(-1, 3)

    def derivative(self) -> Array:
        """Derivative of the forces on the closed rows by -h at the last answer, (3 na, 3 na) [N/m].

        It is unsymmetric where rows slip.
        """
        self.linearise()
        return self.response(np.eye(3 * len(self.index)))

    def tangent(self) -> Callable[[], Solved]:
        """Return what finds `derivative` at the present answer, also when another answer was found since."""
        F, inverse, index, lam, (h, mu) = self.F, self._inverse, self.index, self.lam, self._asked

        def tangent() -> Solved:
            closed, forces = ClosedRows(F, inverse, index), lam[index].ravel()
            closed.load(h[index], mu[index])
            closed.residual(forces)
            closed.factorise(forces)
            return Solved(closed.response, len(forces))

        return tangent

    def linearise(self) -> None:
        """Factorise the Jacobian at the last answer, for `response`."""
        if self.index.size:
            lam, _ = self._load(*self._asked)
            self._closed.factorise(lam, wholly=True)

    def response(self, way: Array) -> Array:
        """Minus the change of the forces on the closed rows, (3 na, m) [N], if these move by ways, (3 na, m) [m].

        `linearise` must be called before.
        """
        return self._closed.response(way) if self.index.size else np.zeros_like(way)
