"""Sparse symmetric factorisation, blocked solves, block Krylov vectors and eigenmodes of free bodies."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg
from threadpoolctl import threadpool_limits

from .errors import IndefiniteMatrixError

Array = np.ndarray
Progress = Callable[[float], None]

_BLOCK = 48  # right-hand sides a call: enough for BLAS 3 inside SuperLU, and little memory


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context or decorator in which BLAS uses one thread: SuperLU calls it on such small blocks that more only wait."""
    with threadpool_limits(1, user_api="blas"):
        yield


class Factorisation:
    """LU factors of a sparse symmetric positive definite matrix.

    SuperLU with the minimum degree of A + A' and pivots on the diagonal: without `diag_pivot_thresh=0` partial
    pivoting destroys the ordering, and the fill grows a hundredfold.

    Parameters
    ----------
    matrix : (n, n) sparse matrix
        Symmetric positive definite.

    Raises
    ------
    IndefiniteMatrixError
        If the matrix is singular.
    """

    def __init__(self, matrix: sp.spmatrix) -> None:
        try:
            self._lu = scipy.sparse.linalg.splu(
                sp.csc_matrix(matrix),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise IndefiniteMatrixError(
                f"the matrix of order {matrix.shape[0]} cannot be factorised: {error}"
            ) from error

    def solve(self, rhs: Array) -> Array:
        """Solve for one, (n,), or many, (n, k), right-hand sides, these in blocks."""
        if rhs.ndim == 1:
            return self._lu.solve(rhs)
        result = np.empty(rhs.shape, order="F")
        for start in range(0, rhs.shape[1], _BLOCK):
            block = slice(start, start + _BLOCK)
            result[:, block] = self._lu.solve(np.asfortranarray(rhs[:, block]))
        return result


def mass_normalised(vectors: Array, mass: sp.spmatrix) -> Array:
    """Combine the columns of `vectors`, (n, k), to V with V' M V = 1 in the same span (Cholesky; well-conditioned)."""
    gram = vectors.T @ (mass @ vectors)
    return scipy.linalg.solve_triangular(np.linalg.cholesky(gram), vectors.T, lower=True).T


def orthonormal_complement(vectors: Array, mass: sp.spmatrix, basis: Array) -> Array:
    """What `vectors`, (n, k), hold beyond a mass-orthonormal `basis`, (n, m): (n, at most k), mass-orthonormal.

    Directions that are in the span of the basis to 1e-6 of their length are dropped.
    """
    lengths = np.sqrt(np.einsum("ij,ij->j", vectors, mass @ vectors))
    vectors = vectors / lengths
    mass_basis = mass @ basis
    for _ in range(2):
        vectors = vectors - basis @ (mass_basis.T @ vectors)
    values, combination = np.linalg.eigh(vectors.T @ (mass @ vectors))
    keep = values > 1e-12
    vectors = vectors @ (combination[:, keep] / np.sqrt(values[keep]))
    # Normalising may amplify what was left of the basis.
    vectors -= basis @ (mass_basis.T @ vectors)
    return mass_normalised(vectors, mass) if vectors.shape[1] else vectors


class FreeBodyFlexibility:
    """Elastic (inertia-relief) flexibility of a free body, F_e = P' Kc^-1 P with P = 1 - M R R' (method.md, section 2).

    Kc holds six statically determinate dofs, chosen so that the rigid modes are as independent there as can be.
    F_e answers a load balanced by the inertia of rigid motion, and its answer contains no rigid motion.

    Parameters
    ----------
    stiffness, mass : (n, n) csr matrix
    rigid : (n, 6) array
        Mass-normalised rigid modes.
    """

    def __init__(self, stiffness: sp.csr_matrix, mass: sp.spmatrix, rigid: Array) -> None:
        self._rigid, self._mass_rigid = rigid, mass @ rigid
        _, held = scipy.linalg.qr(rigid.T, mode="r", pivoting=True)
        self._free = np.delete(np.arange(len(rigid)), np.sort(held[: rigid.shape[1]]))
        self._factor = Factorisation(stiffness[self._free][:, self._free])

    def __call__(self, loads: Array) -> Array:
        """Elastic displacements of `loads`, (n, k)."""
        balanced = loads - self._mass_rigid @ (self._rigid.T @ loads)
        result = np.zeros(loads.shape, order="F")
        result[self._free] = self._factor.solve(balanced[self._free])
        result -= self._rigid @ (self._mass_rigid.T @ result)
        return result


@dataclass(frozen=True, eq=False)
class RitzPairs:
    """Mass-normalised Ritz vectors and their frequencies.

    Parameters
    ----------
    vectors : (n, k) array
    omega : (k,) array
        Circular frequencies, ascending [rad/s].
    """

    vectors: Array
    omega: Array


class BlockKrylov:
    """Block Lanczos vectors of (K + s M)^-1 M, mass-orthonormal to the rigid modes and to each other.

    Every block is orthogonalised twice against all predecessors, so the basis stays orthonormal to round-off at any
    size and growth needs no restart. The projected operator comes from the same inner products.

    Parameters
    ----------
    apply : callable
        (n, p) array -> (K + s M)^-1 of it.
    mass : (n, n) csr matrix
    shift : float
        s [rad2/s2].
    rigid : (n, 6) array
        Mass-normalised rigid modes, kept out of the basis.
    start : (n, p) array
        Loads [N]; the first block is the answer to them.
    lead : (n, m) array, optional
        Mass-orthonormal vectors without rigid motion that lead the basis; Ritz pairs are by `rayleigh_ritz` then.
    """

    def __init__(
        self,
        apply: Callable[[Array], Array],
        mass: sp.spmatrix,
        shift: float,
        rigid: Array,
        start: Array,
        lead: Array | None = None,
    ) -> None:
        self._apply, self._mass, self._shift, self._rigid = apply, mass, shift, rigid
        self._mass_rigid = mass @ rigid
        lead = np.empty((len(start), 0)) if lead is None else lead
        self.size = lead.shape[1]
        self._store = np.asfortranarray(lead)
        self._mass_store = np.asfortranarray(mass @ lead)
        self._operator = np.zeros((self.size, self.size))
        self._projected = np.empty((0, 0))
        self._next = self._orthonormal(self._apply(start))[0]

    def _reserve(self, columns: int) -> None:
        if self._store.shape[1] < columns:
            for name in ("_store", "_mass_store"):
                grown = np.empty((len(self._store), max(columns, 2 * self._store.shape[1])), order="F")
                grown[:, : self.size] = getattr(self, name)[:, : self.size]
                setattr(self, name, grown)

    def _orthonormal(self, block: Array) -> tuple[Array, Array]:
        """Mass-orthonormalise `block` against the rigid modes and the basis; drop what is dependent.

        Returns the new columns and the coefficients of `block` in the basis.
        """
        basis, mass_basis = self._store[:, : self.size], self._mass_store[:, : self.size]
        norms = np.sqrt(np.einsum("ij,ij->j", block, self._mass @ block))
        coefficients = np.zeros((self.size, block.shape[1]))
        for _ in range(2):
            block = block - self._rigid @ (self._mass_rigid.T @ block)
            step = mass_basis.T @ block
            block -= basis @ step
            coefficients += step
        values, vectors = np.linalg.eigh(block.T @ (self._mass @ block) / np.outer(norms, norms))
        keep = values > 1e-20
        block = (block / norms) @ (vectors[:, keep] / np.sqrt(values[keep]))
        # A second pass: normalising may amplify what the first left of the basis.
        block -= self._rigid @ (self._mass_rigid.T @ block)
        block -= basis @ (mass_basis.T @ block)
        return mass_normalised(block, self._mass) if block.shape[1] else block, coefficients

    def grow(self, size: int) -> bool:
        """Add blocks until the basis has at least `size` vectors; False if the Krylov space is exhausted."""
        while self.size < size:
            new = self._next
            if not new.shape[1]:
                return False
            self._reserve(max(size, self.size + new.shape[1]))
            columns = slice(self.size, self.size + new.shape[1])
            self._store[:, columns] = new
            self._mass_store[:, columns] = self._mass @ new
            self.size = columns.stop
            answer = self._apply(self._mass_store[:, columns])
            self._next, coefficients = self._orthonormal(answer)
            operator = np.zeros((self.size, self.size))
            operator[: columns.start, : columns.start] = self._operator
            operator[:, columns] = coefficients
            operator[columns, :] = coefficients.T
            self._operator = operator
            self._coupling = self._next.T @ (self._mass @ answer)
        return True

    @property
    def vectors(self) -> Array:
        """(n, size) array: the basis."""
        return self._store[:, : self.size]

    def ritz_values(self) -> tuple[Array, Array, Array]:
        """Frequencies ascending [rad/s], residuals and combinations of `vectors`, from the shifted operator.

        A residual is relative to the Ritz value of (K + s M)^-1 M; the relative error of that value is below it.
        """
        theta, combination = np.linalg.eigh(self._operator)
        theta, combination = theta[::-1], combination[:, ::-1]
        keep = theta > 0
        theta, combination = theta[keep], combination[:, keep]
        last = self._coupling.shape[1]
        residual = np.linalg.norm(self._coupling @ combination[-last:], axis=0) / theta
        omega = np.sqrt(np.maximum(1 / theta - self._shift, 0.0))
        return omega, residual, combination

    def rayleigh_ritz(self, stiffness: sp.csr_matrix) -> tuple[Array, Array]:
        """Frequencies ascending [rad/s] and combinations of `vectors` by projecting K itself.

        Unlike those of `ritz_values`, which lie anywhere until settled, these frequencies are never below the true.
        """
        known = len(self._projected)
        if known < self.size:
            new = self.vectors.T @ (stiffness @ self.vectors[:, known:])
            projected = np.zeros((self.size, self.size))
            projected[:known, :known] = self._projected
            projected[:, known:] = new
            projected[known:, :known] = new[:known].T
            self._projected = projected
        omega_squared, combination = np.linalg.eigh(self._projected)
        return np.sqrt(np.maximum(omega_squared, 0.0)), combination


def eigenmodes(
    stiffness: sp.csr_matrix,
    mass: sp.spmatrix,
    rigid: Array,
    omega_max: float,
    *,
    tolerance: float = 1e-7,
    block: int = 8,
    progress: Progress | None = None,
) -> RitzPairs:
    """All elastic modes of a free body below `omega_max`.

    Block Krylov from a random block, wider than any multiplicity that symmetry brings, with the shift in the middle
    of the band. It grows until every Ritz pair below `omega_max` and the first one above have converged: such a basis
    converges from below, so nothing within the band is missed.

    Parameters
    ----------
    stiffness, mass : (n, n) csr matrix
    rigid : (n, 6) array
        Mass-normalised rigid modes.
    omega_max : float
        End of the band [rad/s].
    tolerance : float
        Bound on each pair's residual.
    block : int
        Vectors a block.
    progress : callable, optional
        Called with the converged share of the band, 0 to 1.

    Returns
    -------
    RitzPairs
        Empty if there is no elastic mode in the band.
    """
    shift = (omega_max / 2) ** 2
    factor = Factorisation(stiffness + shift * mass)
    start = np.random.default_rng(0).standard_normal((len(rigid), block))
    krylov = BlockKrylov(factor.solve, mass, shift, rigid, start)
    size = 4 * block
    while True:
        more = krylov.grow(size)
        omega, residual, combination = krylov.ritz_values()
        inside = int(np.searchsorted(omega, omega_max))
        settled = residual[: inside + 1] < tolerance
        if progress:
            progress(float(settled.mean()) * min(1.0, krylov.size / (2 * inside + 1)))
        if (len(omega) > inside and settled.all()) or not more:
            return RitzPairs(krylov.vectors @ combination[:, :inside], omega[:inside])
        size = max(krylov.size + 4 * block, int(1.1 * krylov.size), inside + 4 * block)
