"""Complementarity problems against non-negative least squares, and problems that are none."""

import itertools

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import rows_on_few_nodes

from exudyn_partition.algebra import complementarity
from exudyn_partition.algebra.complementarity import Complementarity, regularised
from exudyn_partition.errors import (
    ComplementarityError,
    IndefiniteMatrixError,
)


def conditions(F, h, lam):
    w = F @ lam + h
    scale = abs(h).max() + 1e-300
    assert (lam >= 0).all()
    assert w.min() > -1e-9 * scale
    assert abs(lam * w).max() <= 1e-9 * scale * max(lam.max(), 1e-300)


@pytest.mark.parametrize("patience", [10, 0])
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(1, 40), shift=st.floats(-3, 3))
def test_complementarity_conditions(patience, seed, n, shift):
    """Also with no patience at all, which leaves single pivots alone to find the answer."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n + 2))
    F = A @ A.T + 1e-3 * np.eye(n)
    problem = Complementarity(F)
    before, complementarity.PATIENCE = complementarity.PATIENCE, patience
    try:
        for _ in range(3):  # warm-started from the last active set
            h = rng.standard_normal(n) + shift
            lam = problem.solve(h)
            conditions(F, h, lam)
            L = np.linalg.cholesky(F)  # the oracle: min |L' x + L^-1 h| over x >= 0
            expected = scipy.optimize.nnls(L.T, -np.linalg.solve(L, h), maxiter=1000)[0]
            np.testing.assert_allclose(lam, expected, atol=1e-6 * (1 + expected.max()))
    finally:
        complementarity.PATIENCE = before


@pytest.mark.parametrize("own", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("curvature", [0.0, 0.02, 0.3])
def test_many_stiff_rows_on_few_soft_nodes(own, curvature):
    """As of a steel ball with a fine mesh on rubber with a coarse one: some rows for each node would do."""
    for seed in range(3):
        F, places = rows_on_few_nodes(seed, own=own)
        h = curvature * (places**2).sum(axis=1) - 1.0
        problem = Complementarity(F)
        lam = problem.solve(h)
        conditions(F, h, lam)
        assert problem.iterations < 3 * len(h)


def test_rows_that_only_rounding_violates_do_not_hold_it_up():
    """Seven nearly redundant rows that move each other in both senses: w is a small difference of large numbers."""
    rows = np.array([[1, 0], [0, 0], [0, -1], [1, 0], [0, -1], [-1, 0], [-1, 0]])
    apart = np.array([[1, -1], [1, -1], [-1, 0], [0, 1], [-1, 0], [0, 0], [-1, 0]])
    A = np.hstack([rows, 1e-5 * apart])
    F = regularised(A @ A.T)
    for x in itertools.product(range(-3, 4), repeat=4):
        h = A @ x
        if h.any():
            lam = Complementarity(F).solve_one_by_one(h, np.zeros(len(h)))
            w, rounding = F @ lam + h, 1e-12 * abs(h).max() + 1e-14 * (abs(F) @ lam).max()
            assert (lam >= 0).all()
            assert w.min() >= -rounding
            assert abs(w[lam > 0]).max(initial=0.0) <= rounding


def test_an_unchanged_active_set_takes_one_iteration():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((60, 80))
    problem = Complementarity(A @ A.T)
    h = rng.standard_normal(60)
    problem.solve(h)
    before = problem.iterations
    problem.solve(1.001 * h)
    assert problem.iterations == before + 1


def test_rows_that_are_replaced_are_solved_anew(each_path):
    """With the same guess of the active rows, as where a flexibility changes because pairs slide."""
    rng = np.random.default_rng(1)
    A, h = rng.standard_normal((20, 30)), rng.standard_normal(20)
    problem = Complementarity(A @ A.T)
    lam = problem.solve(h)
    problem.replace(2 * A @ A.T, problem.active)
    np.testing.assert_allclose(problem.solve(h), lam / 2, rtol=1e-10)
    fewer = np.delete(np.delete(A @ A.T, 3, axis=0), 3, axis=1)
    problem.replace(fewer, np.delete(problem.active, 3))
    np.testing.assert_allclose(problem.solve(np.delete(h, 3)), Complementarity(fewer).solve(np.delete(h, 3)), rtol=1e-9)


def test_a_problem_without_a_guess_remembers_nothing():
    """So that a run is the same whether another one came before it or not; gaps that are open leave none active."""
    problem, h = Complementarity(np.diag([1.0, 2.0, 3.0])), np.array([-1.0, 1.0, -1.0])
    problem.solve(h)
    anew = problem.without_guess()
    assert problem.active.tolist() == [True, False, True]
    assert not anew.active.any()
    assert anew.iterations == anew.index.size == 0
    problem.solve(abs(h))
    assert problem.index.size == 0


def test_bad_complementarity_problems():
    with pytest.raises(IndefiniteMatrixError, match="not positive definite"):
        Complementarity(np.array([[1.0, 2.0], [2.0, 1.0]]))
    with pytest.raises(IndefiniteMatrixError, match="symmetric"):
        Complementarity(np.array([[1.0, 0.5], [0.0, 1.0]]))
    with pytest.raises(ComplementarityError, match="not finite"):
        Complementarity(np.eye(2)).solve(np.array([1.0, np.nan]))


@pytest.mark.usefixtures("each_path")
def test_active_rows_that_are_not_definite_are_an_error():
    """The first row closes, its force closes the second, and both together have no factor."""
    problem = Complementarity(np.eye(2))
    problem.replace(np.array([[1.0, -2.0], [-2.0, 1.0]]), np.zeros(2, dtype=bool))
    with pytest.raises(IndefiniteMatrixError, match="not positive definite"):
        problem.solve(np.array([-1.0, 0.5]))


def test_rows_that_are_all_open_do_not_respond():
    response, G = Complementarity(np.eye(3)).response(np.ones((3, 2)))
    assert response.shape == (0, 2)
    np.testing.assert_array_equal(G, np.zeros((2, 2)))
