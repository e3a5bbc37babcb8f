"""A sparse solver without fronts to keep: plastic zones of bodies that it factorises have a dense flexibility."""

from exudyn_partition.algebra.sparse.multifrontal import Factorisation
from exudyn_partition.algebra.sparse.solver import SparseFactors


class WithoutFronts(SparseFactors):
    """The own solver as one that has no fronts to keep: a zone then has one dense front."""

    def __init__(self, matrix):
        self._own = Factorisation(matrix)

    def solve(self, rhs):
        """Solve, see `SparseFactors`."""
        return self._own.solve(rhs)

    def inverse_at(self, rows):
        """Inverse at some rows, see `SparseFactors`."""
        return self._own.inverse_at(rows)

    def negative_pivots(self):
        """Negative pivots, see `SparseFactors`."""
        return self._own.negative_pivots()
