"""Factorisation: solutions of blocks, counts of negative pivots, threads of BLAS."""

import functools
import threading
import tracemalloc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg
from oracles import box, without_numba
from threadpoolctl import threadpool_info, threadpool_limits

import exudyn_partition as ep
from exudyn_partition.algebra.blas_threads import one_blas_thread
from exudyn_partition.algebra.sparse import fronts, loops, multifrontal
from exudyn_partition.algebra.sparse.multifrontal import Analysis, Factorisation
from exudyn_partition.errors import IndefiniteMatrixError


def test_factorisation_solves_blocks(block):
    matrix = block.stiffness + 1e10 * block.mass
    rhs = np.random.default_rng(0).standard_normal((block.n_dofs, 101))
    factors = Factorisation(matrix)
    x = factors.solve(rhs)
    assert abs(matrix @ x - rhs).max() < 1e-9
    np.testing.assert_allclose(factors.solve(rhs[:, 7]), x[:, 7], rtol=1e-9, atol=1e-12 * abs(x).max())
    assert factors.solve(rhs[:, :0]).shape == (block.n_dofs, 0)
    assert factors.nnz > matrix.nnz / 2
    with ThreadPoolExecutor(2) as pool:
        for again in pool.map(factors.solve, [rhs, rhs]):
            np.testing.assert_allclose(again, x, rtol=1e-9, atol=1e-12 * abs(x).max())


def test_singular_matrix():
    with pytest.raises(IndefiniteMatrixError, match="cannot be factorised"):
        Factorisation(sp.csr_matrix((4, 4)))


@pytest.mark.parametrize("shift", [0.0, 0.5, 3.1, 9.0])
def test_negative_pivots_are_as_many_as_negative_eigenvalues(shift):
    springs = sp.diags([np.full(99, -1.0), np.full(100, 2.0), np.full(99, -1.0)], [-1, 0, 1], format="csr")
    eigenvalues = 2 - 2 * np.cos(np.pi * np.arange(1, 101) / 101)
    factors = Factorisation(springs - shift * sp.identity(100))
    assert factors.negative_pivots() == np.count_nonzero(eigenvalues < shift)


def test_pivots_of_two_rows_have_a_sign_each():
    swap = sp.csr_matrix(np.array([[0.0, 1.0], [1.0, 0.0]]))
    factors = Factorisation(swap)
    assert factors.negative_pivots() == 1
    np.testing.assert_allclose(factors.solve(np.array([2.0, 3.0])), [3.0, 2.0])


def springs(*shape):
    """Stiffness of springs on a grid that is held at its ends, a little uneven."""
    total = sp.csr_matrix((1, 1))
    for n in shape:
        total = sp.kronsum(total, sp.diags([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1]))
    return sp.csr_matrix(total + sp.diags(np.linspace(0.0, 0.1, total.shape[0])))


MATRICES = {
    "plane": lambda: springs(30, 35),
    "solid": lambda: springs(9, 10, 11),
    "two parts": lambda: sp.block_diag([springs(9), springs(30, 40)]),
    "three dofs a node": lambda: sp.kron(springs(7, 8, 9), np.eye(3) + 1),
}


@functools.cache
def by_dense_algebra(name, shift):
    """A matrix less a shift, the number of its negative eigenvalues, loads with their answers, and rows with theirs."""
    matrix = MATRICES[name]()
    matrix = sp.csr_matrix(matrix - shift * sp.identity(matrix.shape[0]))
    dense, n = matrix.toarray(), matrix.shape[0]
    rhs = np.random.default_rng(1).standard_normal((n, 5))
    rows = sp.csr_matrix(([1.0, 2.0, -1.0], ([0, 1, 1], [3, 5, n - 1])), shape=(2, n))
    answers = np.linalg.solve(dense, np.hstack([rhs, rows.T.toarray()]))
    return matrix, np.count_nonzero(np.linalg.eigvalsh(dense) < 0), rhs, answers[:, :5], rows, rows @ answers[:, 5:]


@pytest.mark.parametrize("way", ["loops", "loops in two threads", "NumPy"])
@pytest.mark.parametrize("shift", [0.0, 2.0])
@pytest.mark.parametrize("name", MATRICES)
def test_fronts_against_dense_algebra(name, shift, way, monkeypatch):
    """Chains of fronts, fronts that several children change, and fronts with negative pivots."""
    monkeypatch.setattr(fronts, "WIDEST", 40)
    if way == "NumPy":
        monkeypatch.setattr(loops, "kernels", lambda *layer: None)
    if way == "loops in two threads":
        monkeypatch.setattr(multifrontal, "TWO_THREADS_FROM", 0)
    matrix, negative, rhs, expected, rows, at_rows = by_dense_algebra(name, shift)
    factors = Factorisation(matrix)
    assert factors.negative_pivots() == negative
    before, few = rhs.copy(), rhs[:, :3]  # one by one
    for b, x in ((rhs, expected), (few, expected[:, :3]), (rhs[:, 4], expected[:, 4])):
        np.testing.assert_allclose(factors.solve(b), x, rtol=0, atol=1e-10 * abs(expected).max())
    np.testing.assert_array_equal(rhs, before)
    np.testing.assert_allclose(factors.inverse_at(rows), at_rows, rtol=0, atol=1e-10 * abs(at_rows).max())
    assert factors.inverse_at(rows[:0]).shape == (0, 0)


@pytest.mark.parametrize("with_loops", [True, False])
def test_single_precision(block, with_loops, monkeypatch):
    """Half of the memory, and six digits of what the matrix' condition leaves; what is not definite is refused."""
    if not with_loops:
        monkeypatch.setattr(loops, "kernels", lambda *layer: None)
    matrix = block.stiffness + 1e12 * block.mass
    rhs = np.random.default_rng(0).standard_normal((block.n_dofs, 6))
    exact, rough = Factorisation(matrix), Factorisation(matrix, single=True)
    for columns in (slice(6), slice(2), 0):
        expected, answer = exact.solve(rhs[:, columns]), rough.solve(rhs[:, columns])
        assert answer.dtype == np.float64
        np.testing.assert_allclose(answer, expected, rtol=0, atol=1e-4 * abs(expected).max())
    with pytest.raises(IndefiniteMatrixError, match="not positive definite in single precision"):
        Factorisation(block.stiffness - 1e12 * block.mass, single=True)


@pytest.mark.parametrize("matrix", [springs(30, 35), springs(9, 10, 11), sp.kron(springs(7, 8, 9), np.eye(3) + 1)])
def test_compiled_loops_find_the_same_fronts(matrix, monkeypatch):
    compiled = fronts.find_fronts(sp.csr_matrix(matrix))
    monkeypatch.setattr(loops, "kernels", lambda *layer: None)
    for one, other in zip(compiled, fronts.find_fronts(sp.csr_matrix(matrix)), strict=True):
        assert len(one) == len(other)
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_two_parts_share_the_work_and_no_front():
    """A root with trees of unequal size, and a tree of its own: the root comes after both parts."""
    children = [[], [], [0, 1], [], [], [3, 4], [], [2, 5, 6], []]
    parts = fronts.two_parts(children, [4, 4, 1, 4, 4, 1, 3, 1, 2])
    assert [part.tolist() for part in parts] == [[0, 1, 2, 6], [3, 4, 5, 8], [7]]
    assert [part.tolist() for part in fronts.two_parts([[]], [1])] == [[0], [], []]


def test_memory_of_factors_is_little_more_than_their_entries(block):
    """One triangle is stored, and it is no larger than that of SuperLU, which stores two."""
    matrix = sp.csc_matrix(block.stiffness + 1e10 * block.mass)
    both = scipy.sparse.linalg.splu(matrix, diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    tracemalloc.start()
    try:
        factors = Factorisation(matrix)
        memory, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert factors.nnz < 0.6 * both.nnz
    assert memory < 1.5 * 8 * factors.nnz


def test_factors_of_a_solid_body_need_little_memory_while_they_are_made():
    """Numbers by n^(4/3): 50 with cuts by spheres, and with squares of what fronts leave; 36 are usual."""
    solid = ep.fe_model(box(0.04, 0.03, 0.02), ep.STEEL, maxh=4.5e-3)
    matrix = solid.stiffness + 1e10 * solid.mass
    analysis = Analysis(lambda: matrix)
    assert len(analysis.fronts.order) == solid.n_dofs
    with without_numba():  # whose arrays are not traced
        tracemalloc.start()
        try:
            Factorisation(matrix, analysis)
            _, most = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
    assert most < 8 * 42 * solid.n_dofs ** (4 / 3)


def blas_threads():
    """Of NumPy and SciPy."""
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


def test_factors_that_lost_their_digits_are_refused(monkeypatch):
    """A front of one row has no other pivot than its own, however small that is."""
    monkeypatch.setattr(fronts, "WIDEST", 1)
    with pytest.raises(IndefiniteMatrixError, match="take another shift"):
        Factorisation(sp.csr_matrix([[1e-20, 1.0], [1.0, 1e-20]]))
