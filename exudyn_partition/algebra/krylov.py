"""Block Krylov vectors and eigenmodes of free bodies.

Theory: examples/site/theory.md, "Contact-adapted".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg

from ..errors import ModeAccuracyError, ModeCountWarning
from ..support.arrays import Array
from ..support.progress import Progress
from ..support.warn import warn
from .sparse.multifrontal import Analysis
from .sparse.solver import factorise

_COLUMNS = 24, 96  # least and most unit loads that are solved for at a time
_BLOCK = 1e7  # numbers in them, which bounds the memory for large bodies
_DEPENDENT = 1e-10  # a vector is dropped if less than this of its length lies outside the basis
_MOST = 3.0  # a pass is the last if it took less than this from the vectors' squares: half of their length
_TOO_CLOSE = 1e-9  # relative distance from the shift, below which a mode hides all others in the solves
_ENERGY_OFF = 1e-7  # largest error of the modes' strain energy, by omega_max^2; it is below 1e-9 in sound models


def columns(n: int) -> int:
    """Number of unit loads on a body of n dofs that are solved for at a time; only what is needed of the answers stays.

    With fewer, each solution takes a little longer.
    """
    least, most = _COLUMNS
    return max(least, min(most, int(_BLOCK / n)))


def mass_normalised(vectors: Array, mass: sp.spmatrix) -> Array:
    """V with V' M V = 1 in the span of well-conditioned `vectors`, (n, k), by Cholesky."""
    gram = vectors.T @ (mass @ vectors)
    normalised: Array = scipy.linalg.solve_triangular(np.linalg.cholesky(gram), vectors.T, lower=True).T
    return normalised


def orthonormal_complement(vectors: Array, mass: sp.spmatrix, basis: Array) -> Array:
    """Mass-orthonormal vectors, (n, at most k), that extend `basis`, (n, m), by the span of `vectors`, (n, k).

    The basis is mass-orthonormal. Directions in its span, to 1e-6 of their length, are dropped.
    """
    lengths = np.sqrt(np.einsum("ij,ij->j", vectors, mass @ vectors))
    vectors = vectors[:, lengths > 0] / lengths[lengths > 0]
    mass_basis = mass @ basis
    for _ in range(2):
        vectors = vectors - basis @ (mass_basis.T @ vectors)
    values, combination = np.linalg.eigh(vectors.T @ (mass @ vectors))
    keep = values > 1e-12
    vectors = vectors @ (combination[:, keep] / np.sqrt(values[keep]))
    # Normalising may amplify a rest of the basis in them.
    vectors -= basis @ (mass_basis.T @ vectors)
    return mass_normalised(vectors, mass) if vectors.shape[1] else vectors


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


def _finished(loads: Array) -> Array:
    raise RuntimeError("a Krylov space that is finished cannot grow")


def improved(omega: Array, coupling: Array, own: Array) -> Array:
    """Frequencies of Ritz pairs in a larger space, (k,) [rad/s]: of each, that of the new pair which has most of it.

    Answers to the pairs' residuals make the space larger by one step of inverse iteration. A frequency then loses most
    of its error.

    Parameters
    ----------
    omega : (k,) array
        Frequencies of the pairs [rad/s].
    coupling : (k, p) array
        Phi' K N of the pairs and of vectors N, all mass-orthonormal.
    own : (p, p) array
        N' K N.
    """
    values, vectors = np.linalg.eigh(np.block([[np.diag(omega**2), coupling], [coupling.T, own]]))
    alike = abs(vectors[: len(omega)]).argmax(axis=1)
    found: Array = np.sqrt(np.maximum(values[alike], 0.0))
    return found


class BlockKrylov:
    """Block Lanczos vectors of (K + s M)^-1 M, mass-orthonormal to the rigid modes and to each other.

    Every block is orthogonalised against those that it depends on by theory, and then against all predecessors until
    little changes. So the basis stays orthonormal to round-off at any size and growth needs no restart. The projected
    operator comes from the same inner products.

    Parameters
    ----------
    apply : callable
        (n, p) array -> (K + s M)^-1 of it.
    mass : (n, n) csr matrix
    shift : float
        s [rad2/s2]; it may be negative, but not minus an eigenvalue.
    rigid : (n, 6) array
        Mass-normalised rigid modes, kept out of the basis.
    start : (n, p) array
        Loads [N]; the first block is the answer to them.
    lead : (n, m) array, optional
        First vectors of the basis, mass-orthonormal and without rigid motion. Ritz pairs are then those of
        `rayleigh_ritz` only.
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
        self._apply, self._mass, self._shift = apply, mass, shift
        first = rigid if lead is None else np.hstack([rigid, lead])
        self._first, self._n_rigid = int(first.shape[1]), int(rigid.shape[1])
        self._store = np.asfortranarray(first)
        self._mass_store = np.asfortranarray(mass @ first)
        self._blocks: list[int] = [self._first]  # where each begins in the store, and where the last one ends
        self._operator = np.zeros((self.size, self.size))
        self._projected = np.empty((0, 0))
        self._next, self._mass_next, *_ = self._orthonormal(self._apply(start))

    @property
    def size(self) -> int:
        """Number of vectors."""
        return self._blocks[-1] - self._n_rigid

    def _reserve(self, columns: int) -> None:
        if self._store.shape[1] < columns:
            for name in ("_store", "_mass_store"):
                grown = np.empty((len(self._store), max(columns, 2 * self._store.shape[1])), order="F")
                grown[:, : self._blocks[-1]] = getattr(self, name)[:, : self._blocks[-1]]
                setattr(self, name, grown)

    def _orthonormal(self, block: Array) -> tuple[Array, Array, Array, Array]:
        """Mass-orthonormalise `block` against the rigid modes and the basis; drop what is dependent.

        Returns the new columns, M times them, and the coefficients of `block` in the basis and in the new columns.
        """
        mass_block = self._mass @ block
        norms = np.sqrt(np.einsum("ij,ij->j", block, mass_block))
        new, mass_new = block.copy(), mass_block
        coefficients = np.zeros((self._blocks[-1], block.shape[1]))

        def without(part: slice) -> Array:
            """Take from the new columns what they have in common with some vectors; return how much."""
            common: Array = self._mass_store[:, part].T @ new
            np.subtract(new, self._store[:, part] @ common, out=new)
            return common

        # By theory there is nothing in common with others than these: the first vectors and the last two blocks.
        near = slice(self._first), slice(self._blocks[-3:][0], self._blocks[-1])
        for part in near:
            coefficients[part] = without(part)
        settled = False
        while new.shape[1] and not settled:
            common = without(slice(self._blocks[-1]))
            mass_new = self._mass @ new
            squares = np.einsum("ij,ij->j", new, mass_new)
            independent = squares > (_DEPENDENT * norms) ** 2
            scale = np.sqrt(squares[independent])
            gram = new[:, independent].T @ mass_new[:, independent] / np.outer(scale, scale)
            values, turn = np.linalg.eigh(gram)
            # The vectors have unit length; smaller eigenvalues are round-off.
            keep = values > 1e-14
            turn = turn[:, keep] / (scale[:, None] * np.sqrt(values[keep]))
            new, mass_new = new[:, independent] @ turn, mass_new[:, independent] @ turn
            # What is left of the basis is amplified where columns were long before, or nearly dependent.
            longer = np.einsum("ij,ij->j", common, common)
            settled = bool((longer <= _MOST * squares).all() and (values > 1 / _MOST).all())
            norms = np.ones(new.shape[1])
        return new, mass_new, coefficients[self._n_rigid :], new.T @ mass_block

    def grow(self, size: int) -> bool:
        """Add blocks until the basis has at least `size` vectors; False if the Krylov space is exhausted."""
        while self.size < size:
            new = self._next
            if not new.shape[1]:
                return False
            begin = self._blocks[-1]
            end = begin + new.shape[1]
            self._reserve(max(self._n_rigid + size, end))
            self._store[:, begin:end] = new
            self._mass_store[:, begin:end] = self._mass_next
            self._blocks.append(end)
            columns = slice(begin - self._n_rigid, self.size)
            answer = self._apply(self._mass_next)
            self._next, self._mass_next, coefficients, self._coupling = self._orthonormal(answer)
            operator = np.zeros((self.size, self.size))
            operator[: columns.start, : columns.start] = self._operator
            operator[:, columns] = coefficients
            operator[columns, :] = coefficients.T
            self._operator = operator
        return True

    def finish(self) -> None:
        """Release the operator and its factors: the basis stays, but cannot grow any more."""
        self._apply = _finished

    @property
    def vectors(self) -> Array:
        """(n, size) array: the basis."""
        return self._store[:, self._n_rigid : self._blocks[-1]]

    def ritz_values(self) -> tuple[Array, Array, Array]:
        """Frequencies ascending [rad/s], residuals and combinations of `vectors`, by the shifted operator.

        A residual is relative to the Ritz value of (K + s M)^-1 M. The relative error of that value is smaller.
        """
        theta, combination = np.linalg.eigh(self._operator)
        omega_squared = 1 / theta - self._shift
        order = np.argsort(omega_squared)
        order = order[omega_squared[order] > 0]  # others have not converged: K has no negative eigenvalue
        combination = combination[:, order]
        last = self._coupling.shape[1]
        residual = np.linalg.norm(self._coupling @ combination[-last:], axis=0) / abs(theta[order])
        return np.sqrt(omega_squared[order]), residual, combination

    def rayleigh_ritz(self, stiffness: sp.csr_matrix) -> tuple[Array, Array]:
        """Frequencies ascending [rad/s] and combinations of `vectors` by projecting K itself.

        These frequencies are never below the exact ones. Those of `ritz_values` may be, until they have converged.
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

    def grown(self, stiffness: sp.csr_matrix) -> Array:
        """Frequencies of `rayleigh_ritz` in the space with its next block too, see `improved`, (size,) [rad/s].

        That block is known already. With the basis, it spans (K + s M)^-1 M times the basis.
        """
        omega, combination = self.rayleigh_ritz(stiffness)
        moved = stiffness @ self._next
        return improved(omega, combination.T @ (self.vectors.T @ moved), self._next.T @ moved)


def eigenmodes(
    stiffness: sp.csr_matrix,
    mass: sp.spmatrix,
    rigid: Array,
    omega_max: float,
    *,
    tolerance: float = 1e-6,
    block: int = 8,
    progress: Progress | None = None,
    analysis: Analysis | None = None,
) -> RitzPairs:
    """All elastic modes of a free body below `omega_max`.

    K - omega_max^2 M is factorised once. The signs of its pivots count the modes in the band, and its solves are the
    operator of a block Krylov basis. The first block is random, and wider than the multiplicities that symmetry causes.
    The basis grows until as many Ritz pairs have converged as were counted, so none is missing.

    Parameters
    ----------
    stiffness, mass : (n, n) csr matrix
    rigid : (n, 6) array
        Mass-normalised rigid modes; (n, 0) for a held body.
    omega_max : float
        End of the band [rad/s].
    tolerance : float
        Bound on each pair's residual.
    block : int
        Vectors in a block.
    progress : callable, optional
        Called with the converged share of the band, 0 to 1.
    analysis : Analysis, optional
        Of the sum of both matrices.

    Returns
    -------
    RitzPairs
        Empty if there is no elastic mode in the band.

    Raises
    ------
    ModeAccuracyError
        If Phi' K Phi of the modes is not diag(omega^2) to 1e-7 omega_max^2. Then the factors have lost accuracy, which
        can happen with pivots on the diagonal of an indefinite matrix.

    Warns
    -----
    ModeCountWarning
        If more or fewer modes converge than were counted.
    """
    shift = -(omega_max**2)
    factor = factorise(stiffness + shift * mass, analysis)
    expected = factor.negative_pivots() - rigid.shape[1]
    if expected == 0:
        return RitzPairs(np.empty((len(rigid), 0)), np.empty(0))
    start = np.random.default_rng(0).standard_normal((len(rigid), block))
    krylov = BlockKrylov(factor.solve, mass, shift, rigid, start)
    size = 4 * block
    while True:
        more = krylov.grow(size)
        omega, residual, combination = krylov.ritz_values()
        if (abs(omega - omega_max) < _TOO_CLOSE * omega_max).any():
            beyond = (1 + 1e3 * _TOO_CLOSE) * omega_max
            return eigenmodes(
                stiffness, mass, rigid, beyond, tolerance=tolerance, block=block, progress=progress, analysis=analysis
            )
        inside = int(np.searchsorted(omega, omega_max))
        settled = residual < tolerance
        if progress:
            progress(min(1.0, float(settled[:inside].sum()) / expected))
        if inside == expected and settled[:inside].all():
            break
        # Pairs far above the band converge last. If they have converged, all pairs in the band are found.
        above = int(np.searchsorted(omega, 1.5 * omega_max))
        if (len(omega) > above and settled[: above + 1].all()) or not more:
            _warn_of_count(omega_max, expected, inside)
            break
        size = krylov.size + max(block, krylov.size // 20)
    modes = RitzPairs(krylov.vectors @ combination[:, :inside], omega[:inside])
    _check_strain_energy(modes, stiffness, omega_max)
    return modes


def _check_strain_energy(modes: RitzPairs, stiffness: sp.csr_matrix, omega_max: float) -> None:
    """Check Phi' K Phi = diag(w^2) with K itself: the residuals do not show factors that small pivots have spoilt."""
    energy = modes.vectors.T @ (stiffness @ modes.vectors)
    off = abs(energy - np.diag(modes.omega**2)).max(initial=0.0) / omega_max**2
    if not off <= _ENERGY_OFF:
        raise ModeAccuracyError(
            f"the elastic modes below {omega_max / (2 * np.pi):.6g} Hz are not accurate: their strain energy is off by "
            f"{off:.2g} of that at the end of the band, expected at most {_ENERGY_OFF:.2g}. A pivot of "
            "K - omega^2 M is too small there; move the end of the band, f_cut, by some percent"
        )


def _warn_of_count(omega_max: float, expected: int, found: int) -> None:
    warn(
        f"expected {expected} elastic modes below {omega_max / (2 * np.pi):.6g} Hz, as many as the signs of the pivots "
        f"count, found {found}. Check that mass and stiffness are those of one free body with six rigid modes; if they "
        "are, move the end of the band a little",
        ModeCountWarning,
    )
