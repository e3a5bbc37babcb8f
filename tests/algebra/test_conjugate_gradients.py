"""Rough solutions against exact ones."""

import numpy as np
import pytest
import scipy.sparse as sp
from oracles import each_way

from exudyn_partition.algebra.sparse.conjugate_gradients import solve_roughly
from exudyn_partition.algebra.sparse.multifrontal import Factorisation

N, COLUMNS = 200, 7


@pytest.fixture(scope="module")
def system():
    """A matrix of blocks of 3 by 3, and right-hand sides of which one is zero."""
    rng = np.random.default_rng(5)
    A = sp.kron(sp.random(N, N, density=0.03, random_state=2), np.ones((3, 3))).tocsr()
    A.data = rng.normal(size=A.nnz)
    rhs = rng.normal(size=(3 * N, COLUMNS)) * 10.0 ** np.arange(COLUMNS)
    rhs[:, 3] = 0.0
    return (A @ A.T + sp.diags(rng.uniform(5, 50, 3 * N))).tocsr(), rhs


@pytest.mark.parametrize("solved", [0.1, 1e-3])
def test_every_column_is_solved_as_well_as_is_asked(system, solved):
    matrix, rhs = system
    compiled, plain = each_way(lambda: solve_roughly(matrix, rhs, solved))
    np.testing.assert_allclose(compiled, plain, atol=1e-4 * abs(plain).max(axis=0).max(), rtol=1e-3)
    assert not compiled[:, 3].any()
    weights = 1 / np.sqrt(matrix.diagonal())
    left, begun = (np.linalg.norm(weights[:, None] * x, axis=0) for x in (rhs - matrix @ compiled, rhs))
    assert (left <= 1.01 * solved * begun).all()
    assert left.max() > 1e-6 * begun.max()  # and no better


def test_energies_are_those_of_the_answers(system):
    matrix, rhs = system
    for shift in (0.0, 30.0):
        factors = Factorisation(matrix - shift * sp.identity(3 * N, format="csr"))
        for energies in each_way(lambda factors=factors: factors.energies(rhs)):
            np.testing.assert_allclose(energies, rhs.T @ factors.solve(rhs), rtol=1e-9, atol=1e-9)
