"""Contact with friction in blocks of rows that move each other, against the law itself and against one matrix."""

import numpy as np
import pytest
from oracles import broken_law

from exudyn_partition.algebra.block_friction import BlockFlexibility, BlockFriction
from exudyn_partition.algebra.complementarity import regularised
from exudyn_partition.algebra.friction import OPEN, SLIP, STICK, FrictionProblem
from validation.friction.kernel import grid, half_space

MU = 0.4


def patches(n, few, count=3):
    """Square patches of n x n squares side by side on a half-space: its whole flexibility, and that in blocks.

    The factors know of `few` fields by which they move each other.
    """
    places = np.concatenate([grid(n, 1.0) + np.array([1.5 * n * k, 0]) for k in range(count)])
    F = regularised(half_space(places, 1.0, 1.0, 0.3))
    parts = [slice(3 * n * n * k, 3 * n * n * (k + 1)) for k in range(count)]
    between = {(j, k): F[a, b] for j, a in enumerate(parts) for k, b in enumerate(parts) if j != k}
    fields = []
    for j in range(count):
        together = np.hstack([block for (row, _), block in between.items() if row == j])
        fields.append(np.linalg.svd(together, full_matrices=False)[0][:, :few])
    core = np.zeros((count, few, count, few))
    for (j, k), block in between.items():
        core[j, :, k] = fields[j].T @ block @ fields[k]
    return F, BlockFlexibility([F[a, a] for a in parts], between, fields, core.reshape((count * few,) * 2))


def approaches(n, count=3, steps=12):
    """Gaps and slips of patches that are pressed, pushed along and tilted, so that each is open at times."""
    x = grid(n, 1.0)[:, 0] / n
    for time in np.linspace(0, 2 * np.pi, steps):
        h = []
        for k in range(count):
            gap = -1.0 - 1.2 * np.sin(time + 2 * k) + 0.8 * np.cos(time) * x
            h.append(np.column_stack([gap, 0.6 * np.sin(2 * time + k) + 0.2 * x, 0.3 * np.cos(time + k) - 0.1 * x]))
        yield np.concatenate(h)


@pytest.mark.parametrize(("n", "few"), [(4, 4), (6, 8), (6, 0)])
def test_blocks_obey_the_law_and_have_the_forces_of_one_matrix(n, few):
    """With one dense factor, with factors coupled by few fields, and where factors know of no coupling at all."""
    F, blocks = patches(n, few)
    whole, problem = FrictionProblem(F), BlockFriction(blocks)
    mu, states = np.full(len(F) // 3, MU), set()
    for h in approaches(n):
        found, expected = problem.solve(h, mu), whole.solve(h, mu)
        assert broken_law(F, h, mu, found) < 1e-8
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * abs(expected).max())
        moved = F @ found.ravel()
        np.testing.assert_allclose(problem.moved_by(found).ravel(), moved, rtol=0, atol=1e-12 * abs(moved).max())
        states |= {(k, s) for k, own in enumerate(np.split(problem.state, 3)) for s in own.tolist()}
    assert {(k, s) for k in range(3) for s in (OPEN, STICK, SLIP)} == states
    assert problem.sweeps == 0


def test_few_fields_make_factors_good():
    """So Newton's method needs about as many steps as with one dense factor, from one state to the next."""
    F, blocks = patches(6, 8)
    whole, problem, mu = FrictionProblem(F), BlockFriction(blocks), np.full(len(F) // 3, MU)
    for h in approaches(6, steps=60):
        problem.solve(h, mu)
        whole.solve(h, mu)
    assert problem.iterations < 1.3 * whole.iterations


def test_derivative_of_the_forces():
    """What the fields leave out is corrected."""
    F, blocks = patches(6, 8)
    whole, problem, mu = FrictionProblem(F), BlockFriction(blocks), np.full(len(F) // 3, MU)
    for h in [*approaches(6)][:5]:
        problem.solve(h, mu)
        whole.solve(h, mu)
    assert {STICK, SLIP} < {*problem.state.tolist()}
    expected = whole.derivative()
    np.testing.assert_allclose(problem.derivative(), expected, rtol=0, atol=1e-4 * abs(expected).max())


def test_blocks_without_rows_take_no_part():
    blocks, mu = patches(6, 8, count=2)[1], np.full(72, MU)
    none = np.zeros((0, 0))
    problem = BlockFriction(BlockFlexibility([*blocks.own, none], blocks.between, [*blocks.fields, none], blocks.core))
    for h in approaches(6, count=2):
        expected = BlockFriction(blocks).solve(h, mu)
        np.testing.assert_allclose(problem.solve(h, mu), expected, rtol=0, atol=1e-8 * abs(expected).max())
    assert problem.derivative().shape == (3 * problem.index.size,) * 2


def test_other_rows_go_on_from_their_guesses():
    blocks, mu, h = patches(6, 8)[1], np.full(108, MU), [*approaches(6)][2]
    problem = BlockFriction(blocks)
    lam, state, made = problem.solve(h, mu), problem.state, problem.iterations
    problem.replace_blocks(blocks, state, lam)
    np.testing.assert_allclose(problem.solve(h, mu), lam, rtol=0, atol=1e-9 * lam.max())
    assert problem.iterations <= made + 1
