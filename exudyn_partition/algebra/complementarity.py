"""Linear complementarity with a positive definite matrix: lambda >= 0, w = F lambda + h >= 0, lambda'w = 0.

Theory: examples/site/theory.md, "Contact without a penalty".
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.linalg import lapack

from ..errors import ComplementarityError, IndefiniteMatrixError
from ..support.arrays import Array
from ..support.attributes import copied
from . import loops
from .products import Solved
from .products import smallest as least_of

REGULARISATION = 1e-9  # of the mean diagonal
ROUNDING = 1e-12  # of the largest entry of h, by which w may be negative
_FEW = 60  # active rows up to which compiled loops are faster than LAPACK
PATIENCE = 10  # block steps without progress before single pivots begin
SOLVING = ROUNDING, PATIENCE, _FEW  # as `loops.solve_active` takes them


def regularised(F: Array) -> Array:
    """F with a billionth of its mean diagonal added to the diagonal.

    With redundant rows the single forces are not unique. The added term selects those of least norm, and changes their
    sum and their effect on the bodies by about a billionth.
    """
    result = F.copy()
    result.flat[:: len(F) + 1] += REGULARISATION * np.trace(F) / max(len(F), 1)
    return result


class Complementarity:
    """Warm-started block principal pivoting (Júdice and Pires 1994).

    All rows that violate their condition change sides at once, as in a primal-dual active set (semi-smooth Newton). If
    their number does not fall for some steps, single rows change (Lawson and Hanson 1974): the one that is violated
    most comes in, and those whose forces would pull go. The energy 1/2 lambda'F lambda + h'lambda falls with each
    change, so that this ends for every symmetric positive definite F. The active set and its Cholesky factor are kept
    between calls: with an unchanged set, a call costs one product and two triangular solves.

    Parameters
    ----------
    F : (nc, nc) array
        Symmetric positive definite, for contact the flexibility of the rows [m/N].

    Raises
    ------
    IndefiniteMatrixError
        If F is not symmetric positive definite.
    """

    def __init__(self, F: Array) -> None:
        self.F = np.asfortranarray(F, dtype=float)
        if not np.allclose(F, F.T, rtol=1e-8, atol=1e-10 * abs(F).max()):
            raise IndefiniteMatrixError("F: expected a symmetric matrix")
        if lapack.dpotrf(self.F, lower=1)[1]:
            lowest = np.linalg.eigvalsh(self.F)[0] / abs(F).max()
            raise IndefiniteMatrixError(
                f"the flexibility of the contact rows is not positive definite (lowest eigenvalue {lowest:.2g} of its "
                "largest entry): the basis leaves no local flexibility, or rows are redundant. Keep fewer modes "
                "(lower f_cut) or use formulation='lagrange'"
            )
        self.iterations = 0
        self.single_pivots = 0
        self._open_all()

    def without_guess(self) -> Complementarity:
        """Return the same problem, whose first guess is that all rows are open; F is shared."""
        result = copied(self)
        result.iterations = result.single_pivots = 0
        result._open_all()
        return result

    def replace(self, F: Array, active: Array) -> None:
        """Go on with other rows: their F, (nc, nc), which is not checked, and a guess of the active ones, (nc,)."""
        self.F = F
        self._set(active)

    def set_active(self, active: Array) -> None:
        """Take an active set, (nc,) bool, that was found elsewhere."""
        if not np.array_equal(active, self.active):
            self._set(active)

    def _open_all(self) -> None:
        """Forget the active set of the last call."""
        self._set(np.zeros(len(self.F), dtype=bool))

    def _set(self, active: Array) -> None:
        self.active, self.index = active, np.flatnonzero(active)
        self._factor: Array | None = None  # made when it is needed
        self._response: tuple[Array, Array, Array] | None = None  # fields, and `response` to them

    @property
    def _by_rows(self) -> Array:
        """F, row after row in memory; F is symmetric."""
        return self.F if self.F.flags.c_contiguous else self.F.T

    def _active_factor(self) -> Array:
        """Lower factor of Cholesky of the active part, (na, na)."""
        if self._factor is None:
            self._factor = _factor_of(self._by_rows, self.index)
        return self._factor

    def inverse(self) -> Callable[[], Solved]:
        """Return what finds F_AA^-1, (na, na), of the present active set, also when that has changed since."""
        F, index, factor = self._by_rows, self.index, self._factor

        def inverse() -> Solved:
            L = _factor_of(F, index) if factor is None else factor
            return Solved(lambda rhs: lapack.dpotrs(L, rhs, lower=1)[0], len(index))

        return inverse

    def solve_active(self, rhs: Array) -> Array:
        """Solve F_AA x = rhs on the present active set; rhs (na,) or (na, k)."""
        if not self.index.size:  # LAPACK solves no systems without unknowns
            return np.zeros_like(rhs)
        solution: Array = lapack.dpotrs(self._active_factor(), rhs, lower=1)[0]
        return solution

    def response(self, fields: Array) -> tuple[Array, Array]:
        """-D^-1 W, (na, m), and G = W' D^-1 W, (m, m), of the active rows W of fields, (nc, m), and D = F_AA.

        They are kept for the same fields while the active set stays the same.
        """
        if self._response is None or self._response[0] is not fields:
            active = fields[self.index]
            response = -self.solve_active(active)
            self._response = fields, response, -active.T @ response
        return self._response[1:]

    @property
    def compiled(self) -> tuple[Array, Array, Array]:
        """F, the factor of its active part and the active rows, as loops take them, see `loops.check_active`."""
        return self._by_rows, self._active_factor().T, self.index

    def check(self, h: Array, scale: float = 0.0) -> tuple[Array, Array, int]:
        """Forces on the present active set, which rows violate their condition, (nc,) each, and how many do.

        Rounding is that of gaps of size `scale`; by default, of the largest entry of h.
        """
        return loops.check_active(*self.compiled, h, ROUNDING, scale)

    def solve(self, h: Array, smallest: float | None = None) -> Array:
        """Return lambda, (nc,), for h, (nc,); `smallest` is the least entry of h, if it is known.

        Raises
        ------
        ComplementarityError
            If h is not finite.
        """
        smallest = least_of(h) if smallest is None else smallest
        if not math.isfinite(smallest):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        if smallest >= 0.0:
            if self.index.size:
                self._open_all()
            return np.zeros(len(h))
        lam, upper, index, changes, count = loops.solve_active(*self.compiled, h, *SOLVING)
        self.iterations += changes + 1
        if changes:
            self.active, self.index, self._factor = np.zeros(len(h), dtype=bool), index, upper.T
            self._response = None
            self.active[index] = True
        if not count:
            return lam
        fewest, patience = len(h) + 1, PATIENCE
        for _ in range(50 + 20 * len(h)):
            self.iterations += 1
            lam, wrong, count = self.check(h)
            if not count:
                return lam
            if count < fewest:
                fewest, patience = count, PATIENCE
            elif patience:
                patience -= 1
            else:
                return self.solve_one_by_one(h, np.maximum(lam, 0.0))
            self._set(self.active ^ wrong)
        raise self._not_settled()

    def solve_one_by_one(self, h: Array, lam: Array) -> Array:
        """Return lambda, (nc,) [N], for gaps h, (nc,) [m], by changes of single rows, from forces that do not pull."""
        self._set(lam > 0.0)
        lowest, at_zero, worst = -ROUNDING * abs(h).max(), np.zeros(len(h), dtype=bool), 0
        for _ in range(50 + 20 * len(h)):
            lam = self._without_pull(h, lam)
            if self.active[worst]:
                at_zero[:] = False
            w = h + self.F @ lam
            w[self.active | at_zero] = np.inf
            worst = int(w.argmin())
            if w[worst] >= lowest:
                return lam
            at_zero[worst] = True  # if it goes at once, only rounding has violated it
            active = self.active.copy()
            active[worst] = True
            self.single_pivots += 1
            self._set(active)
        raise self._not_settled()

    def _without_pull(self, h: Array, lam: Array) -> Array:
        """Least energy on the active rows, from lambda, (nc,), on the way to which rows go whose forces would pull."""
        while self.index.size:
            self.iterations += 1
            now, least = lam[self.index], self.solve_active(-h[self.index])
            pulls = least <= 0.0
            share = np.divide(now, now - least, out=np.ones(len(now)), where=pulls)
            way = share.min()
            lam = np.zeros(len(h))
            lam[self.index] = np.where(pulls & (share <= way), 0.0, now + way * (least - now))
            if not pulls.any():
                break
            self._set(self.active & (lam > 0.0))
        return lam

    def _not_settled(self) -> ComplementarityError:
        n = len(self.F)
        return ComplementarityError(f"no active set of {n} contact rows settled; the rows are nearly redundant")


def _factor_of(F: Array, index: Array) -> Array:
    """Lower factor of Cholesky of the part of a symmetric matrix, (nc, nc), with some rows and columns, (na,)."""
    active = F.take(index, axis=0).take(index, axis=1)
    factor, info = lapack.dpotrf(active.T, lower=1, overwrite_a=1)
    if info:
        raise IndefiniteMatrixError("the flexibility of the active contact rows is not positive definite")
    return np.asarray(factor)
