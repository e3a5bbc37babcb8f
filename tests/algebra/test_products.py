"""Products with matrices that are not formed."""

import numpy as np
import pytest
import scipy.sparse as sp

from exudyn_partition.algebra.products import Solved, dense


@pytest.mark.parametrize(("columns", "solved"), [(1, 1), (3, 3), (6, 6), (40, 6)])
@pytest.mark.parametrize("sparse", [False, True])
def test_an_inverse_is_formed_only_for_more_columns_than_it_has(columns, solved, sparse):
    """Products are the same; the equations are solved for as few right-hand sides as may be."""
    random = np.random.default_rng(columns)
    A, B = random.random((6, 6)) + 6 * np.eye(6), random.random((6, columns))
    sides = []

    def solve(rhs):
        sides.append(rhs.shape[1])
        return np.linalg.solve(A, rhs)

    inverse = Solved(solve, 6)
    np.testing.assert_allclose(inverse @ (sp.csr_matrix(B) if sparse else B), np.linalg.solve(A, B), rtol=1e-12)
    assert sides == [solved]
    np.testing.assert_allclose(dense(inverse) @ A, np.eye(6), atol=1e-13)
