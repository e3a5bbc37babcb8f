"""Contact with friction of many rows: Newton's method with steps by Krylov vectors, for bodies that lie on their faces.

With the trial forces u = lambda - D (h + F lambda), the law says that lambda is the projection of u: normal forces do
not pull, and tangential ones stay within the bounds of the trial normal forces. D scales gaps and slips to forces. The
derivative of the projection are blocks M of three rows, and the Jacobian is 1 - M (1 - D F), for all rows at once: they
open, close, stick and slip in the same steps. A block of a row that slips has in place of the direction d of the trial
force twice, d d', the direction of the present force and d. Hüeber, Stadler and Wohlmuth found that this leads to the
answer from far away, where Newton's method goes round in circles.

Factors of n rows take as long as many products with F. So a step is found by GMRES, preconditioned by factors of an
earlier Jacobian, which may be one of the time step before. All this is done in single precision: it needs half of the
time, and residuals in double precision correct it.

Theory: examples/site/theory.md, "Friction".

References
----------
S. Hüeber, G. Stadler, B.I. Wohlmuth, A primal-dual active set algorithm for three-dimensional contact problems with
Coulomb friction, SIAM J. Sci. Comput. 30 (2008) 572. Y. Saad, M.H. Schultz, GMRES, SIAM J. Sci. Stat. Comput. 7 (1986)
856. S.C. Eisenstat, H.F. Walker, Choosing the forcing terms in an inexact Newton method, SIAM J. Sci. Comput. 17 (1996)
16.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from ..support.arrays import Array

MOST_STEPS = 60
_VECTORS = 15  # most of GMRES in a step: then new factors are cheaper
_MANY_VECTORS = 12  # a step that needs more asks for new factors in the next
_USELESS = 0.5  # share of the residual: steps that leave more are found again with new factors
_LOOSE, _TIGHT = 0.3, 1e-4  # shares of the residual that a step may leave
_TOLERANCE = 1e-10  # of the largest force
_ROUNDING = 1e-12  # of the largest force


class Projection(NamedTuple):
    """Forces of nr rows compared with what the law makes of their trial forces.

    Parameters
    ----------
    forces : (nr, 3) array
        Projected trial forces [N].
    residual : (3 nr,) array
        How far the forces are from these [N].
    blocks : (nr, 3, 3) array
        Derivative of the projected forces by the trial forces.
    closed, slips : (nr,) bool arrays
    """

    forces: Array
    residual: Array
    blocks: Array
    closed: Array
    slips: Array


def project(lam: Array, trial: Array, mu: Array) -> Projection:
    """Project trial forces, (nr, 3) [N], on those that the law allows, and compare these with forces, (nr, 3) [N]."""
    normal, x = np.maximum(trial[:, 0], 0.0), trial[:, 1:]
    closed, bound, length = normal > 0.0, mu * normal, np.hypot(x[:, 0], x[:, 1])
    slips = closed & (length > bound)
    share = np.where(slips, bound / np.maximum(length, 1e-300), closed)
    forces = np.column_stack([normal, share[:, None] * x])
    d, along = x[slips] / length[slips, None], lam[slips, 1:]
    at_least = np.maximum(np.hypot(along[:, 0], along[:, 1]), bound[slips])
    turning = np.eye(2) - (along / np.maximum(at_least, 1e-300)[:, None])[:, :, None] * d[:, None, :]
    blocks = closed[:, None, None] * np.eye(3)
    blocks[slips, 1:, 1:] = share[slips, None, None] * turning
    blocks[slips, 1:, 0] = mu[slips, None] * d
    return Projection(forces, (lam - forces).ravel(), blocks, closed, slips)


class ManyRows:
    """Newton's method for all rows at once.

    Parameters
    ----------
    F : (3 nr, 3 nr) array
        Symmetric positive definite flexibility of the rows [m/N].
    inverse : (nr, 3) array
        D, scales of gaps and slips to forces [N/m].

    Attributes
    ----------
    iterations, factorisations : int
        Newton steps and factorisations of the last answer.
    """

    def __init__(self, F: Array, inverse: Array) -> None:
        self._F, self._inverse = F, inverse
        self._single = np.empty(F.shape, dtype=np.float32)  # D F
        np.multiply(F, inverse.ravel()[:, None], out=self._single, casting="same_kind")
        self._factors: _Factors | None = None
        self.iterations = self.factorisations = 0

    def solve(self, h: Array, mu: Array, lam: Array) -> Projection | None:
        """Iterate from forces lam, (nr, 3) [N]; return the answer, or None if they do not settle.

        Parameters
        ----------
        h : (nr, 3) array
            Gaps and slips of the rows without forces [m].
        mu : (nr,) array
            Coefficients of friction.
        lam : (nr, 3) array
        """
        self.iterations = self.factorisations = 0
        share, size, left, many = np.inf, 0.0, _LOOSE, False
        for _ in range(MOST_STEPS + 1):
            now = project(lam, lam - self._inverse * (h + (self._F @ lam.ravel()).reshape(-1, 3)), mu)
            before, size, largest = size, float(abs(now.residual).max()), float(abs(now.forces).max())
            if size <= _ROUNDING * largest or share * size <= _TOLERANCE * largest:
                return now
            if before:
                left = min(_LOOSE, max(_TIGHT, 0.9 * (size / before) ** 2))
            if not np.isfinite(size):
                break
            step, many = self._step(now, size, left, anew=many)
            lam = lam + step.reshape(-1, 3)
            share = float(abs(step).max()) / size
        return None

    def _step(self, now: Projection, size: float, left: float, *, anew: bool) -> tuple[Array, bool]:
        """Newton step, (3 nr,) [N], and whether it took many vectors; it leaves a share of the residual.

        `size` is the largest residual [N]. Factors are made `anew`, or if others are not good enough.
        """
        self.iterations += 1
        single, blocks = self._single, now.blocks.astype(np.float32)
        rhs = (-now.residual / size).astype(np.float32)

        def jacobian(v: Array) -> Array:
            through = (v - single @ v).reshape(-1, 3)
            return np.asarray(v - np.einsum("nij,nj->ni", blocks, through).ravel())

        def newton_step() -> tuple[Array, int, float]:
            assert self._factors is not None
            return gmres(jacobian, self._factors.solve, rhs, left, _VECTORS)

        fresh = self._factors is None or anew
        if fresh:
            self._factorise(blocks, now.closed)
        step, n_vectors, rest = newton_step()
        if rest > _USELESS and not fresh:
            self._factorise(blocks, now.closed)
            step, n_vectors, _ = newton_step()
        return size * step.astype(float), n_vectors > _MANY_VECTORS

    def _factorise(self, blocks: Array, closed: Array) -> None:
        self._factors = _Factors(self._single, blocks, closed)
        self.factorisations += 1


class _Factors:
    """LU factors of the Jacobian on the rows that are closed; where others are, it is the unit matrix.

    Parameters
    ----------
    F : (3 nr, 3 nr) float32 array
        Scaled to forces.
    blocks : (nr, 3, 3) float32 array
        See `Projection`.
    closed : (nr,) bool array
    """

    def __init__(self, F: Array, blocks: Array, closed: Array) -> None:
        some = np.flatnonzero(closed)
        self._places = (3 * some[:, None] + np.arange(3)).ravel()
        n = len(self._places)
        through = F.take(self._places, axis=0).take(self._places, axis=1)
        through.flat[:: n + 1] -= 1.0
        J = (blocks[some] @ through.reshape(len(some), 3, n)).reshape(n, n)
        J.flat[:: n + 1] += 1.0
        # The transpose is in the order of LAPACK, which needs no copy of it.
        self._lu = lapack.sgetrf(J.T, overwrite_a=1)[:2] if n else None  # LAPACK refuses a matrix without rows

    def solve(self, rhs: Array) -> Array:
        """Solve for a right-hand side, (3 nr,) float32."""
        solution = rhs.copy()
        if self._lu is not None:
            solution[self._places] = lapack.sgetrs(*self._lu, rhs[self._places], trans=1)[0]
        return solution


def gmres(
    apply: Callable[[Array], Array], precondition: Callable[[Array], Array], rhs: Array, left: float, most: int
) -> tuple[Array, int, float]:
    """Solution of a linear system by preconditioned Krylov vectors, their number, and the share that is left.

    Parameters
    ----------
    apply : callable
        From a vector, (n,), to the product with the matrix.
    precondition : callable
        From a vector, (n,), to what nearly solves for it.
    rhs : (n,) array
        Not zero. Its precision is that of all vectors.
    left : float
        Share of the right-hand side that may be left.
    most : int
        Most vectors.
    """
    n, size = len(rhs), float(np.linalg.norm(rhs))
    V, Z = np.empty((most + 1, n), rhs.dtype), np.empty((most, n), rhs.dtype)
    H, goal = np.zeros((most + 1, most)), np.zeros(most + 1)
    V[0], goal[0] = rhs / size, size
    for k in range(most):
        Z[k] = precondition(V[k])
        w = apply(Z[k])
        for _ in range(2):  # once leaves rounding
            shares = V[: k + 1] @ w
            w -= shares @ V[: k + 1]
            H[: k + 1, k] += shares
        H[k + 1, k] = np.linalg.norm(w)
        weights = np.linalg.lstsq(H[: k + 2, : k + 1], goal[: k + 2], rcond=None)[0]
        rest = float(np.linalg.norm(goal[: k + 2] - H[: k + 2, : k + 1] @ weights)) / size
        if rest <= left or H[k + 1, k] <= 0.0:
            break
        V[k + 1] = w / H[k + 1, k]
    return weights.astype(rhs.dtype) @ Z[: k + 1], k + 1, rest
