"""Elastic flexibility of a free body.

Theory: examples/site/theory.md, "Residual flexibility".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ...support.arrays import Array
from ...support.checks import check_floats, read_only
from .kept_fronts import KeptFronts
from .multifrontal import Analysis, Factorisation
from .skin_flexibility import SkinFlexibility, StoredFactors
from .solver import factorise


@dataclass(frozen=True, eq=False)
class KeptFlexibility:
    """Flexibility of k dofs of a body, C + V S V' [m/N], where fronts of the body's factors multiply by C.

    Parameters
    ----------
    fronts : KeptFronts
    vectors : (k, c) array
        V.
    weights : (c, c) array
        S, symmetric.
    """

    fronts: KeptFronts
    vectors: Array
    weights: Array

    def __post_init__(self) -> None:
        check_floats("vectors", self.vectors, (len(self.fronts), None))
        check_floats("weights", self.weights, (self.vectors.shape[1],) * 2)
        read_only(self.vectors, self.weights)

    def __len__(self) -> int:
        return len(self.fronts)

    def plus(self, vectors: Array, weights: Array) -> KeptFlexibility:
        """Return C + V S V' + U diag(w) U' for vectors U, (k, j), and weights w, (j,)."""
        weights = scipy.linalg.block_diag(self.weights, np.diag(weights))
        return KeptFlexibility(self.fronts, np.hstack([self.vectors, vectors]), weights)

    def single(self) -> KeptFlexibility:
        """Return the same in single precision."""
        thin = (values.astype(np.float32) for values in (self.vectors, self.weights))
        return KeptFlexibility(self.fronts.single(), *thin)

    def __matmul__(self, forces: Array) -> Array:
        """Displacements of the dofs, (k,) or (k, p) [m], by forces on them [N]."""
        found: Array = self.fronts @ forces + self.vectors @ (self.weights @ (self.vectors.T @ forces))
        return found

    def at(self, dofs: Array) -> LoadedDofs:
        """Flexibility by forces on some of the dofs, (j,) places, alone."""
        return LoadedDofs(self, dofs)


class LoadedDofs:
    """Flexibility by forces on j of the dofs of a `KeptFlexibility`.

    Parameters
    ----------
    flexibility : KeptFlexibility
    dofs : (j,) int array
    """

    def __init__(self, flexibility: KeptFlexibility, dofs: Array) -> None:
        self._all, self._rows = flexibility, flexibility.fronts.rows[dofs]
        self._fronts = flexibility.fronts.reached(dofs)
        self._vectors = flexibility.vectors[dofs]

    def answer(self, forces: Array) -> tuple[Array, Array]:
        """Displacements of these dofs, (j,) or (j, p) [m], by forces on them [N]; what `spread` needs of these forces.

        Both are linear in the forces.
        """
        forces = forces.astype(self._vectors.dtype)
        solved = self._all.fronts.solve(forces, self._rows, self._fronts)
        weights = self._all.weights @ (self._vectors.T @ forces)
        return solved[self._rows] + self._vectors @ weights, np.concatenate([solved, weights])

    def spread(self, answered: Array) -> Array:
        """Displacements of all dofs, (k,) or (k, p) [m], by the forces that were answered."""
        solved, weights = np.split(answered.astype(self._vectors.dtype), [-len(self._all.weights)])
        found: Array = self._all.fronts.complete(solved, self._fronts) + self._all.vectors @ weights
        return found


def selection(dofs: Array, n: int) -> sp.csr_matrix:
    """Rows of the identity, (k, n), that select k of n dofs."""
    return sp.csr_matrix((np.ones(len(dofs)), dofs, np.arange(len(dofs) + 1)), shape=(len(dofs), n))


class FreeBodyFlexibility:
    """Elastic (inertia-relief) flexibility of a free body, F_e = P' Kc^-1 P with P = 1 - M R R'.

    In Kc six statically determinate dofs are held; they are chosen such that the rigid modes there are as independent
    as possible. F_e first balances a load by the inertia of rigid motion. Its answer contains no rigid motion.

    Parameters
    ----------
    stiffness, mass : (n, n) csr matrix
    rigid : (n, 6) array
        Mass-normalised rigid modes.
    analysis : Analysis, optional
        Of matrices with entries where the stiffness has them, or more.
    rows : (r, n) csr matrix, optional
        The only rows that `at` will be asked for: factors then take half of the memory, see `factorise`.

    Attributes
    ----------
    free : (n - 6,) int array
        Dofs that are not held.
    """

    def __init__(
        self,
        stiffness: sp.csr_matrix,
        mass: sp.spmatrix,
        rigid: Array,
        analysis: Analysis | None = None,
        rows: sp.csr_matrix | None = None,
    ) -> None:
        self._stiffness, self._rigid, self._mass_rigid = stiffness, rigid, mass @ rigid
        _, held = scipy.linalg.qr(rigid.T, mode="r", pivoting=True)
        self._held = np.sort(held[: rigid.shape[1]])
        self.free = np.delete(np.arange(len(rigid)), self._held)
        asked = None if rows is None else self._of_free(rows)
        self._factor = factorise(lambda: _uncoupled(stiffness, self._held), analysis=analysis, rows=asked)

    def __call__(self, loads: Array) -> Array:
        """Elastic displacements of `loads`, (n, k)."""
        result = self.held_response(loads - self._mass_rigid @ (self._rigid.T @ loads))
        result -= self._rigid @ (self._mass_rigid.T @ result)
        return result

    def energies(self, loads: Array) -> Array:
        """Work of `loads` L, (n, k), on each other's elastic displacements, L' F_e L, (k, k)."""
        return self._factor.energies(self._on_free(loads - self._mass_rigid @ (self._rigid.T @ loads)))

    def held_response(self, loads: Array) -> Array:
        """Displacements of `loads`, (n, k), with the six dofs held."""
        return self._factor.solve(self._on_free(np.array(loads)))

    def _on_free(self, loads: Array) -> Array:
        """Leave out what acts on dofs that are held, in place."""
        loads[self._held] = 0.0
        return loads

    def of_rows(self, rows: sp.csr_matrix) -> Array:
        """Elastic flexibility of some rows G, (r, n), of few dofs: G F_e G', (r, r)."""
        return self.balanced(self.held_at(rows), rows)

    def held_at(self, rows: sp.csr_matrix) -> Array:
        """Flexibility of some rows, (r, n), of few dofs, with the six dofs held, (r, r)."""
        return self._factor.inverse_at(self._of_free(rows))

    def _of_free(self, rows: sp.csr_matrix) -> sp.csr_matrix:
        """Rows, (r, n), without what acts on dofs that are held."""
        free = np.ones(rows.shape[1])
        free[self._held] = 0.0
        return sp.csr_matrix(rows @ sp.diags(free))

    def balanced(self, held: Array, rows: sp.csr_matrix) -> Array:
        """Elastic flexibility of some rows, (r, n), from that of the held body at them, (r, r)."""
        at, moved = rows @ self._rigid, self._moved
        mixed = (rows @ moved) @ at.T
        result: Array = held - mixed - mixed.T + at @ (self._mass_rigid.T @ moved) @ at.T
        return result

    def kept(self, dofs: Array) -> KeptFlexibility:
        """Elastic flexibility of some dofs, (k,) int array, by the fronts that they reach."""
        fronts = self._factor.kept(selection(dofs, len(self._rigid)))
        at, moved, work = self._rigid[dofs], self._moved[dofs], self._mass_rigid.T @ self._moved
        held = selection(np.flatnonzero(np.isin(dofs, self._held)), len(dofs)).T.toarray()  # its equation does move
        own, one, none = held.T @ (fronts @ held), np.eye(len(work)), np.zeros_like(work)
        weights = scipy.linalg.block_diag(np.block([[(work + work.T) / 2, -one], [-one, none]]), -own)
        return KeptFlexibility(fronts, np.hstack([at, moved, held]), weights)

    @property
    def may_wait(self) -> bool:
        """Whether flexibilities can be found on demand: they need factors of the own solver in double precision."""
        return isinstance(self._factor, Factorisation)

    def on_demand(self, rows: sp.csr_matrix) -> SkinFlexibility:
        """Elastic flexibility of many rows, (r, n), of few dofs, as `of_rows` gives it, but on demand."""
        assert isinstance(self._factor, Factorisation)
        dofs = np.unique(rows.indices).astype(np.int64)
        kept, on_dofs = self.kept(dofs), sp.csr_matrix(rows[:, dofs])
        held = _uncoupled(self._stiffness, self._held)
        factors = StoredFactors.of(held, self._factor.fronts, dofs, kept.fronts)
        return SkinFlexibility(factors, on_dofs, on_dofs @ kept.vectors, kept.weights)

    @cached_property
    def _moved(self) -> Array:
        """Answers to the inertia of rigid motion with the six dofs held, (n, 6)."""
        return self.held_response(self._mass_rigid)


def _uncoupled(matrix: sp.csr_matrix, dofs: Array) -> sp.csr_matrix:
    """A matrix with entries in the same places, of which those of some dofs are zero beside the diagonal."""
    matrix = sp.csr_matrix(matrix)
    data, size = matrix.data.copy(), abs(matrix.data).max(initial=0.0) or 1.0
    data[np.isin(matrix.indices, dofs)] = 0.0
    lacking = np.zeros(matrix.shape[0])
    for dof in dofs:
        row = slice(*matrix.indptr[dof : dof + 2])
        data[row] = np.where(matrix.indices[row] == dof, size, 0.0)
        lacking[dof] = size - data[row].sum()
    result = sp.csr_matrix((data, matrix.indices, matrix.indptr), shape=matrix.shape)
    return result + sp.diags(lacking, format="csr") if lacking.any() else result
