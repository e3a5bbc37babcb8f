"""Compiled loops of dense problems against NumPy and LAPACK."""

import numpy as np
import pytest
from oracles import each_way

from exudyn_partition.algebra.complementarity import Complementarity
from exudyn_partition.algebra.friction import FrictionProblem
from exudyn_partition.algebra.products import congruence, hold_rows


def flexibility(n, seed):
    """A flexibility of n rows that move each other."""
    A = np.random.default_rng(seed).normal(size=(n, 2 * n))
    return 1e-9 * (A @ A.T / n + np.eye(n))


@pytest.mark.parametrize("order", ["C", "F"])
def test_complementarity_has_the_same_answers(order):
    F, rng = flexibility(40, 0), np.random.default_rng(1)
    gaps = 1e-6 * (rng.normal(size=(30, 40)) + np.linspace(-1, 1, 30)[:, None])

    def answers():
        problem = Complementarity(F)
        problem.replace(np.array(F, order=order), np.zeros(40, dtype=bool))
        found = [(problem.solve(h), problem.active.copy()) for h in gaps]
        return found, problem.iterations

    (compiled, n_compiled), (plain, n_plain) = each_way(answers)
    assert n_compiled == n_plain
    for (lam, active), (expected, as_well) in zip(compiled, plain, strict=True):
        np.testing.assert_allclose(lam, expected, rtol=1e-9, atol=1e-12 * expected.max())
        np.testing.assert_array_equal(active, as_well)


def test_friction_has_the_same_answers():
    F, rng = flexibility(45, 2), np.random.default_rng(3)
    way = 1e-6 * np.cumsum(0.3 * rng.normal(size=(25, 15, 3)), axis=0)

    def answers():
        problem = FrictionProblem(F)
        return [(problem.solve(h, np.full(15, 0.3)).copy(), problem.state.copy()) for h in way]

    compiled, plain = each_way(answers)
    assert {0, 1, 2} <= set(np.concatenate([state for _, state in plain]))
    for (lam, state), (expected, as_well) in zip(compiled, plain, strict=True):
        np.testing.assert_allclose(lam, expected, atol=1e-9 * abs(expected).max())
        np.testing.assert_array_equal(state, as_well)


@pytest.mark.parametrize("threes", [False, True])
def test_congruence_leaves_out_products_with_zeros(threes):
    rng, F = np.random.default_rng(4), flexibility(30, 5)
    rows = rng.normal(size=(13, 30)) * (rng.random((13, 30)) < 0.2)
    for product in each_way(lambda: congruence(rows, F, threes=threes)):
        np.testing.assert_allclose(product, rows @ F @ rows.T, rtol=1e-12, atol=1e-14 * F.max())


def test_rows_are_held_the_same():
    """Multipliers leave the rows the velocities or accelerations that they are asked for."""
    rng, step = np.random.default_rng(4), 1e-3
    C, mass, dofs = rng.normal(size=(3, 8)), rng.uniform(1, 2, 8), np.array([0, 2, 3, 4, 6, 7, 8, 9])
    push, state = (C / mass).T.copy(), rng.normal(size=(3, 10))
    scale = 1 / np.sqrt((C @ push).diagonal())
    factor = np.asfortranarray(np.linalg.cholesky(scale[:, None] * (C @ push) * scale))

    def held(shares, by):
        q, q_t, q_tt = state.copy()
        found = hold_rows(C, np.ones(3), by, push, factor, scale, shares, (q, q_t, q_tt), step, dofs)
        return *found, q_t, q_tt

    nothing, ahead, after = ((0.0,) * 3, -1.0), ((1.0, step, step**2 / 2), -1 / step**2), ((0.0, 1.0, 0.0), -2 / step)
    for shares, by in (nothing, ahead, after):
        compiled, plain = each_way(lambda shares=shares, by=by: held(shares, by))
        for one, other in zip(compiled, plain, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-10)
        x = sum(share * values[dofs] for share, values in zip(shares, state, strict=True))
        np.testing.assert_allclose(C @ compiled[1], by * (1 + C @ x), rtol=1e-9)
    np.testing.assert_allclose(C @ compiled[2][dofs], -1.0, rtol=1e-9)
