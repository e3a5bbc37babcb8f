"""Contact with friction against its conditions, closed forms, and limits that other solvers know."""

import numpy as np
import pytest
from oracles import broken_law

from exudyn_partition.algebra import friction
from exudyn_partition.algebra.complementarity import Complementarity, regularised
from exudyn_partition.algebra.friction import OPEN, SLIP, STICK, FrictionProblem
from exudyn_partition.algebra.friction_sweeps import one_row, sweep
from exudyn_partition.errors import ComplementarityError, IndefiniteMatrixError
from validation.friction.kernel import grid, half_space


def patch(rng, n=None, coupled=True):
    """Flexibility of some squares on a half-space, in units of its own."""
    return half_space(grid(n or int(rng.integers(2, 8)), 1.0), 1.0, 1.0, rng.uniform(0, 0.45), coupled)


def random_matrix(rng, n=None):
    n = 3 * (n or int(rng.integers(1, 30)))
    A = rng.standard_normal((n, n + 5))
    return A @ A.T / n + 1e-3 * np.eye(n)


def approach(rng, nr):
    """Gaps and slips, most of them closed, with a common slip."""
    h = rng.standard_normal((nr, 3)) - [rng.uniform(0, 2), 0, 0]
    h[:, 1:] *= 10 ** rng.uniform(-2, 2)
    h[:, 1:] += rng.uniform(-2, 2, 2)
    return h


@pytest.mark.parametrize("mu", [0.3, 1.0, 2.0])
@pytest.mark.parametrize("matrix", [patch, random_matrix])
def test_cold_starts_meet_the_law(matrix, mu):
    rng = np.random.default_rng(0)
    for _ in range(8):
        F = matrix(rng)
        problem, coefficients = FrictionProblem(F), np.full(len(F) // 3, mu)
        for h in (approach(rng, len(F) // 3), approach(rng, len(F) // 3)):  # the second from the first's state
            lam = problem.solve(h, coefficients)
            assert broken_law(F, h, coefficients, lam) < 1e-8
            force = np.linalg.norm(lam[:, 1:], axis=1)
            np.testing.assert_array_equal(problem.index, np.flatnonzero(problem.state))
            np.testing.assert_allclose(force[problem.state == SLIP], (mu * lam[:, 0])[problem.state == SLIP])
            assert not lam[problem.state == OPEN].any()
            w = h + (F @ lam.ravel()).reshape(-1, 3)
            assert abs(w[problem.state == STICK]).max(initial=0) < 1e-8 * abs(h).max()


@pytest.mark.parametrize("steps", [4, 1])
def test_what_follows_when_newton_does_not_settle(monkeypatch, steps):
    """With few steps at a time: friction that rises, then sweeps."""
    rng = np.random.default_rng(10)
    F, h, mu = patch(rng, 3), approach(rng, 9), np.full(9, 0.8)
    expected = FrictionProblem(F).solve(h, mu)
    monkeypatch.setattr(friction, "NEWTON_STEPS", steps)
    problem = FrictionProblem(F)
    np.testing.assert_allclose(problem.solve(h, mu), expected, atol=1e-8 * expected.max())
    assert (problem.sweeps > 0) == (steps == 1)


def test_a_sweep_solves_each_row_for_the_forces_that_others_have_by_then():
    """So the last row obeys the law; without friction it is the method of Gauss and Seidel."""
    rng = np.random.default_rng(3)
    F, h = patch(rng, 3), approach(rng, 9)
    h[-1, 0] = -3.0
    lam = sweep(F, h, np.full(9, 0.4), np.zeros((9, 3)))
    now = h.ravel() + F @ lam.ravel() - F[:, -3:] @ lam[-1]  # without the last row's own forces
    assert broken_law(F[-3:, -3:], now[None, -3:], np.array([0.4]), lam[-1:]) < 1e-9
    normal = np.zeros(9)
    for row in range(9):
        rest = h[row, 0] + F[3 * row, ::3] @ normal
        normal[row] = max(0.0, -rest / F[3 * row, 3 * row])
    np.testing.assert_allclose(sweep(F, h, np.zeros(9), np.zeros((9, 3)))[:, 0], normal, rtol=1e-9)


def test_what_does_not_settle_at_all_is_an_error(monkeypatch):
    monkeypatch.setattr(friction, "NEWTON_STEPS", -1)
    with pytest.raises(ComplementarityError, match=r"1 contact rows .* to 0\.5, "):
        FrictionProblem(np.eye(3)).solve(np.array([[-1.0, 2.0, 0.0]]), np.array([0.5]))


def test_without_friction_it_is_complementarity():
    rng = np.random.default_rng(1)
    F = patch(rng, 6)
    h = approach(rng, 36)
    lam = FrictionProblem(F).solve(h, np.zeros(36))
    normal = Complementarity(F[::3, ::3]).solve(h[:, 0])
    np.testing.assert_allclose(lam[:, 0], normal, atol=1e-9 * normal.max())
    assert not lam[:, 1:].any()


def test_a_single_row():
    """With equal tangential flexibility: stick by the stiffness, slip by Coulomb's force against the way."""
    F, mu, way = np.diag([2.0, 3.0, 3.0]), np.array([0.5]), np.array([0.6, -0.8])
    for length, state in ((0.5, STICK), (10.0, SLIP)):
        problem = FrictionProblem(F)
        lam = problem.solve(np.array([[-4.0, *(length * way)]]), mu)[0]
        assert problem.state[0] == state
        np.testing.assert_allclose(lam, [2.0, *(-min(length / 3, 0.5 * 2.0) * way)], rtol=1e-10)
    assert not FrictionProblem(F).solve(np.array([[0.0, 1.0, 1.0]]), mu).any()


def test_full_stick_is_linear_and_full_slip_is_along_the_way():
    rng = np.random.default_rng(2)
    F = patch(rng, 5, coupled=False)
    x, y = grid(5, 1.0).T
    h = np.column_stack([0.1 * (x**2 + y**2) - 2.0, np.full((25, 2), [0.3, 0.4])])
    problem = FrictionProblem(F)
    lam = problem.solve(0.1 * h, np.full(25, 10.0))
    assert (problem.state == STICK).all()
    np.testing.assert_allclose(lam.ravel(), np.linalg.solve(F, -0.1 * h.ravel()), rtol=1e-9)
    h[:, 1:] *= 1e9
    lam = problem.solve(h, np.full(25, 0.2))
    assert (problem.state == SLIP).all()
    np.testing.assert_allclose(lam[:, 1:], -0.2 * lam[:, :1] * [0.6, 0.8], rtol=1e-7)


def test_units_do_not_matter():
    rng = np.random.default_rng(3)
    F, h, mu = patch(rng, 5), approach(rng, 25), np.full(25, 0.4)
    lam = FrictionProblem(F).solve(h, mu)
    scaled = FrictionProblem(1e-12 * F).solve(1e-6 * h, mu)
    np.testing.assert_allclose(scaled, 1e6 * lam, atol=1e-3 * lam.max())


@pytest.mark.parametrize("slide", [0.02, 0.3, 5.0])
def test_derivative_of_the_forces(slide):
    rng = np.random.default_rng(4)
    F, mu = patch(rng, 5), np.full(25, 0.4)
    x, y = grid(5, 1.0).T
    h = np.column_stack([0.2 * (x**2 + y**2) - 1.0, slide * (1 + 0.1 * x), -0.3 * slide + 0.02 * y])
    problem = FrictionProblem(F)
    problem.solve(h, mu)
    assert len(set(problem.state[problem.index])) == (2 if slide == 0.3 else 1)
    index, stiffness = problem.index, problem.derivative()
    places = (3 * index[:, None] + np.arange(3)).ravel()
    change = rng.standard_normal((25, 3))
    ahead, behind = (FrictionProblem(F).solve(h + e * change, mu) for e in (1e-6, -1e-6))
    measured = (ahead - behind).ravel()[places] / 2e-6
    np.testing.assert_allclose(-stiffness @ change.ravel()[places], measured, atol=1e-5 * abs(measured).max())
    assert (abs(stiffness - stiffness.T).max() < 1e-9 * abs(stiffness).max()) == (slide == 0.02)


def test_a_smooth_path_seldom_needs_new_factors():
    rng = np.random.default_rng(5)
    F, mu = patch(rng, 8, coupled=False), np.full(64, 0.3)
    x, y = grid(8, 1.0).T
    problem, place, steps = FrictionProblem(F), np.zeros((64, 2)), 200
    for time in np.linspace(0, np.pi, steps):
        h = np.column_stack([0.1 * (x**2 + y**2) - np.sin(time), np.outer(np.ones(64), [np.sin(2 * time), 0]) - place])
        lam = problem.solve(h, mu)
        place += h[:, 1:] + (F @ lam.ravel()).reshape(-1, 3)[:, 1:]
        assert broken_law(F, h, mu, lam) < 1e-8
    assert problem.factorisations < steps / 2
    assert problem.iterations < 8 * steps
    before = problem.iterations, problem.factorisations
    assert not problem.solve(abs(h), mu).any()  # in free flight there is nothing to find
    assert (problem.iterations, problem.factorisations) == before


@pytest.mark.parametrize("seed", [4, 5, 11])
def test_rows_that_begin_to_slip_and_stick_again_do_not_hold_it_up(seed):
    """With factors of the other state, a step leads back to that state."""
    rng = np.random.default_rng(seed)
    F, mu = random_matrix(rng, 12), np.full(12, 0.6)
    problem, place, most = FrictionProblem(F), np.zeros((12, 2)), 0
    once, again, mean = rng.standard_normal((3, 12, 3)) - [[[0, 0, 0]], [[0, 0, 0]], [[1.5, 0, 0]]]
    for angle in np.linspace(0, 2 * np.pi, 80):
        h = mean + 0.5 * (once * np.sin(angle) + again * np.cos(angle)) - np.column_stack([np.zeros(12), place])
        before = problem.iterations
        lam = problem.solve(h, mu)
        most = max(most, problem.iterations - before)
        place += h[:, 1:] + (F @ lam.ravel()).reshape(-1, 3)[:, 1:]
        assert broken_law(F, h, mu, lam) < 1e-8
    assert most <= 13


def test_forces_that_go_on_as_before_are_guessed():
    rng = np.random.default_rng(7)
    F, mu = patch(rng, 4), np.full(16, 5.0)
    problem, forces = FrictionProblem(F), [np.zeros((16, 3))]
    for time in (1.0, 2.0, 3.0):  # full stick is linear
        if time == 3.0:
            problem.extrapolate(forces[-2])
            before = problem.iterations
        forces.append(problem.solve(np.tile([-time, 0.1 * time, 0.0], (16, 1)), mu).copy())
    assert problem.iterations == before
    np.testing.assert_allclose(forces[-1], 3.0 * forces[1], rtol=1e-8, atol=1e-10)


def test_other_rows_go_on_from_their_guesses():
    rng = np.random.default_rng(6)
    F, h, mu = patch(rng, 5), approach(rng, 25), np.full(25, 0.4)
    problem = FrictionProblem(F)
    lam, state = problem.solve(h, mu), problem.state
    other = FrictionProblem(np.eye(3))
    other.replace(F, state, lam)
    np.testing.assert_allclose(other.solve(h, mu), lam, atol=1e-9 * lam.max())
    assert not other.iterations


def test_rows_that_are_redundant_share_their_force():
    rng = np.random.default_rng(7)
    twice = np.kron(np.eye(9), np.ones((2, 1)))  # each row two times
    F = patch(rng, 3)
    h, mu = approach(rng, 9), np.full(9, 0.4)
    lam = FrictionProblem(F).solve(h, mu)
    both = np.kron(twice, np.eye(3))
    problem = FrictionProblem(regularised(both @ F @ both.T))
    shared = problem.solve(twice @ h, twice @ mu)
    np.testing.assert_allclose(twice.T @ shared, lam, atol=1e-6 * lam.max())


def test_sweeps_find_what_newton_finds():
    rng = np.random.default_rng(8)
    F, h, mu = patch(rng, 3), approach(rng, 9), np.full(9, 0.6)
    lam = np.zeros((9, 3))
    for _ in range(60):
        lam = sweep(F, h, mu, lam)
    np.testing.assert_allclose(lam, FrictionProblem(F).solve(h, mu), atol=1e-6 * lam.max())


def test_one_row_is_solved_exactly():
    rng = np.random.default_rng(9)
    for _ in range(100):
        F, h, mu = random_matrix(rng, 1), rng.standard_normal(3), np.array([rng.uniform(0, 2)])
        assert broken_law(F, h[None], mu, one_row(F, h, mu[0], np.zeros(3))[None]) < 1e-7


def test_bad_problems():
    with pytest.raises(IndefiniteMatrixError, match="not positive definite"):
        FrictionProblem(np.diag([1.0, -1.0, 1.0]))
    with pytest.raises(ComplementarityError, match="not finite"):
        FrictionProblem(np.eye(3)).solve(np.array([[-1.0, np.nan, 0.0]]), np.ones(1))
