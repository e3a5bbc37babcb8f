"""Newton's method for many rows with friction at once, against that for few, and its parts against differences."""

import numpy as np
import pytest
from oracles import broken_law

from exudyn_partition.algebra import friction
from exudyn_partition.algebra.block_friction import BlockFlexibility, BlockFriction
from exudyn_partition.algebra.friction import FrictionProblem
from exudyn_partition.algebra.many_rows import ManyRows, gmres, project
from validation.friction.kernel import grid, half_space

N = 16  # squares of a face along each side
CENTRES = grid(N, 1.0)


@pytest.fixture(scope="module")
def face():
    """Flexibility of a square face."""
    return half_space(CENTRES, 1.0, 1.0, 0.3, True)


def landing(step):
    """Gaps and slips of a plate that comes down on a face, a little bent, slides and turns: at first all rows close."""
    x, y = (CENTRES - CENTRES.mean(axis=0)).T
    depth = 1.0 - 0.25 * step + 0.02 * (x + 0.3 * y) - 0.002 * (x**2 + y**2)
    return np.column_stack([-depth, 0.3 - 0.05 * y, 0.05 * x - 0.1 * step])


def test_forces_are_those_of_few_rows(face, monkeypatch):
    """From nothing, then from step to step, while rows open, stick and slip."""
    mu, many = np.full(len(face) // 3, 0.3), FrictionProblem(face)
    found, states = [], []
    for step in range(4):
        found.append(many.solve(landing(step), mu))
        states.append(many.state)
        assert broken_law(face, landing(step), mu, found[-1]) < 1e-8
    assert many.factorisations < many.iterations  # kept ones precondition
    monkeypatch.setattr(friction, "MANY", 10**6)
    few = FrictionProblem(face)
    for step, (lam, state) in enumerate(zip(found, states, strict=True)):
        np.testing.assert_allclose(lam, few.solve(landing(step), mu), rtol=0, atol=1e-8 * lam.max())
        np.testing.assert_array_equal(state, few.state)
    assert {*np.concatenate(states)} == {friction.OPEN, friction.STICK, friction.SLIP}


def test_a_plate_that_leaves_at_once_has_no_force(face):
    """No row is closed then, and the Jacobian has no rows: LAPACK refused it with an error of its own."""
    mu, inverse = np.full(len(face) // 3, 0.3), np.repeat(1 / np.diag(face)[::3, None], 3, axis=1)
    pressed = ManyRows(face, inverse).solve(landing(0), mu, np.zeros((len(mu), 3)))
    assert pressed.closed.any()
    away = ManyRows(face, inverse).solve(landing(0) + np.array([100.0, 0.0, 0.0]), mu, pressed.forces)
    assert not away.forces.any()


def test_the_derivative_is_that_of_few_rows(face, monkeypatch):
    mu, problems = np.full(len(face) // 3, 0.3), []
    for most in (friction.MANY, 10**6):
        monkeypatch.setattr(friction, "MANY", most)
        problems.append(FrictionProblem(face))
        problems[-1].solve(landing(1), mu)
    one, other = (problem.derivative() for problem in problems)
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-6 * abs(other).max())


def test_blocks_of_rows(face):
    """Two faces of which each moves the other: their forces obey the law of all rows."""
    n, field = len(face), np.zeros((len(face), 1))
    field[::3, 0] = 0.3
    between = field @ field.T
    blocks = BlockFlexibility(
        [face, face], {(0, 1): between, (1, 0): between}, [field, field], np.array([[0.0, 1.0], [1.0, 0.0]])
    )
    h, mu = np.concatenate([landing(0), landing(1)]), np.full(2 * n // 3, 0.3)
    lam = BlockFriction(blocks).solve(h, mu)
    assert broken_law(blocks.whole, h, mu, lam) < 1e-8


def test_what_does_not_settle_is_left_to_the_method_of_few_rows(face, monkeypatch):
    mu, h = np.full(len(face) // 3, 0.3), landing(0)
    expected = FrictionProblem(face).solve(h, mu)
    monkeypatch.setattr(ManyRows, "solve", lambda rows, h, mu, lam: None)
    np.testing.assert_allclose(FrictionProblem(face).solve(h, mu), expected, rtol=0, atol=1e-8 * expected.max())


def test_blocks_are_the_derivative_of_the_projection_at_an_answer():
    """There, forces are the projected trial forces."""
    rng = np.random.default_rng(4)
    trial, mu = rng.standard_normal((30, 3)), rng.uniform(0.2, 1.5, 30)
    forces = project(trial, trial, mu).forces
    now = project(forces, trial, mu)
    assert 3 < now.slips.sum() < now.closed.sum() < 30
    assert not now.residual.any()
    for k in range(3):
        way = np.zeros(3)
        way[k] = 1e-7
        ahead, back = (project(forces, trial + sign * way, mu).forces for sign in (1.0, -1.0))
        np.testing.assert_allclose((ahead - back) / 2e-7, now.blocks[:, :, k], rtol=0, atol=1e-6)


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_gmres_solves(precision):
    rng = np.random.default_rng(5)
    A = (np.eye(40) + 0.1 * rng.standard_normal((40, 40))).astype(precision)
    rhs, left = rng.standard_normal(40).astype(precision), 100 * np.finfo(precision).eps
    diagonal = A.diagonal()
    x, count, rest = gmres(lambda v: A @ v, lambda v: v / diagonal, rhs, left, 40)
    assert x.dtype == precision
    assert count < 40
    assert rest <= left
    assert np.linalg.norm(rhs - A @ x) < 10 * left * np.linalg.norm(rhs)
    *_, rest = gmres(lambda v: A @ v, lambda v: v / diagonal, rhs, left, 3)
    assert rest > left
