"""Factorisation: solutions of blocks, counts of negative pivots, threads of BLAS."""

import threading

import numpy as np
import pytest
import scipy.sparse as sp
from threadpoolctl import threadpool_info, threadpool_limits

from exudyn_partition.algebra.factorisation import Factorisation, one_blas_thread
from exudyn_partition.algebra.krylov import sturm_count
from exudyn_partition.errors import IndefiniteMatrixError


def test_factorisation_solves_blocks(block):
    matrix = block.stiffness + 1e10 * block.mass
    rhs = np.random.default_rng(0).standard_normal((block.n_dofs, 101))
    x = Factorisation(matrix).solve(rhs)
    assert abs(matrix @ x - rhs).max() < 1e-9
    np.testing.assert_allclose(Factorisation(matrix).solve(rhs[:, 7]), x[:, 7], rtol=1e-12)


def test_singular_matrix():
    with pytest.raises(IndefiniteMatrixError, match="cannot be factorised"):
        Factorisation(sp.csr_matrix((4, 4)))


def test_no_count_without_pivots_on_the_diagonal():
    swap = sp.csr_matrix(np.array([[0.0, 1.0], [1.0, 0.0]]))
    with pytest.raises(IndefiniteMatrixError, match="move the shift"):
        sturm_count(swap, sp.identity(2), 0.0)


def blas_threads():
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_blas_has_its_threads_back_after_two_threads_of_ours():
    """The first in is the first out: what the second found was the first one's limit."""
    second_in, first_out = threading.Event(), threading.Event()

    def second():
        with one_blas_thread():
            second_in.set()
            first_out.wait(10)

    given = threadpool_limits(2, user_api="blas")
    try:
        other = threading.Thread(target=second)
        with one_blas_thread():
            assert blas_threads() == {1}
            other.start()
            assert second_in.wait(10)
            assert blas_threads() == {1}
        first_out.set()
        other.join()
        assert blas_threads() == {2}
    finally:
        given.restore_original_limits()


def test_blas_has_its_threads_back_after_an_error():
    before = blas_threads()
    with pytest.raises(ZeroDivisionError), one_blas_thread(), one_blas_thread():
        raise ZeroDivisionError
    assert blas_threads() == before
