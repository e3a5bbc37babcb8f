"""Sums of matrices at coordinates against entries that are added one by one."""

import numpy as np
import pytest
import scipy.sparse as sp

from exudyn_partition.algebra.sparse.assembly import assembled


@pytest.mark.parametrize("kinds", [(np.asarray, np.asarray), (np.asarray, sp.csr_matrix), ()])
def test_matrices_are_added_at_their_coordinates(kinds):
    """Dense and sparse ones, which have coordinates in common; one has a coordinate twice."""
    rng, expected, parts = np.random.default_rng(3), np.zeros((7, 7)), []
    for columns, kind in zip(([5, 0, 2], [2, 6, 2, 1]), kinds, strict=False):
        matrix = rng.integers(-2, 3, (len(columns),) * 2).astype(float)
        np.add.at(expected, np.ix_(columns, columns), matrix)
        parts.append((np.array(columns), kind(matrix)))
    total = assembled(parts, 7)
    assert np.array_equal(total.toarray(), expected)
    assert total.nnz == np.count_nonzero(expected)
