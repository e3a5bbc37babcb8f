"""Factorisation: solutions of blocks, counts of negative pivots, threads of BLAS."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.sparse as sp
from threadpoolctl import threadpool_info, threadpool_limits

from exudyn_partition.algebra.factorisation import Factorisation, one_blas_thread
from exudyn_partition.algebra.pardiso import library
from exudyn_partition.errors import IndefiniteMatrixError


@pytest.fixture(params=["superlu", "pardiso"])
def by(request):
    if request.param == "pardiso" and library() is None:
        pytest.skip("mkl is not installed")
    return request.param


def test_factorisation_solves_blocks(block, by):
    matrix = block.stiffness + 1e10 * block.mass
    rhs = np.random.default_rng(0).standard_normal((block.n_dofs, 101))
    factors = Factorisation(matrix, by)
    x = factors.solve(rhs)
    assert abs(matrix @ x - rhs).max() < 1e-9
    np.testing.assert_allclose(factors.solve(rhs[:, 7]), x[:, 7], rtol=1e-9, atol=1e-12 * abs(x).max())
    assert factors.solve(rhs[:, :0]).shape == (block.n_dofs, 0)
    assert factors.nnz > matrix.nnz / 2
    with ThreadPoolExecutor(2) as pool:
        for again in pool.map(factors.solve, [rhs, rhs]):
            np.testing.assert_allclose(again, x, rtol=1e-9, atol=1e-12 * abs(x).max())


def test_singular_matrix(by):
    with pytest.raises(IndefiniteMatrixError, match="cannot be factorised"):
        Factorisation(sp.csr_matrix((4, 4)), by)


@pytest.mark.parametrize("shift", [0.0, 0.5, 3.1, 9.0])
def test_negative_pivots_are_as_many_as_negative_eigenvalues(shift, by):
    springs = sp.diags([np.full(99, -1.0), np.full(100, 2.0), np.full(99, -1.0)], [-1, 0, 1], format="csr")
    eigenvalues = 2 - 2 * np.cos(np.pi * np.arange(1, 101) / 101)
    factors = Factorisation(springs - shift * sp.identity(100), by)
    assert factors.negative_pivots() == np.count_nonzero(eigenvalues < shift)


def test_no_count_without_pivots_on_the_diagonal():
    """PARDISO takes pivots of two rows, which have a sign each."""
    swap = sp.csr_matrix(np.array([[0.0, 1.0], [1.0, 0.0]]))
    with pytest.raises(IndefiniteMatrixError, match="move the shift"):
        Factorisation(swap, "superlu").negative_pivots()
    if library() is not None:
        assert Factorisation(swap, "pardiso").negative_pivots() == 1


def blas_threads():
    """Of NumPy and SciPy; MKL has one thread anyway."""
    pools = [pool for pool in threadpool_info() if pool["user_api"] == "blas" and pool["internal_api"] != "mkl"]
    return {pool["num_threads"] for pool in pools}


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
