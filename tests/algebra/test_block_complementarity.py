"""Blocks of rows that move each other by few fields, against the same problem as one matrix."""

import numpy as np
import pytest
import scipy.linalg
from oracles import rows_on_few_nodes

from exudyn_partition.algebra.block_complementarity import BlockComplementarity, shared_fields
from exudyn_partition.algebra.complementarity import Complementarity
from exudyn_partition.errors import ComplementarityError
from exudyn_partition.support.compiled import compiles

BLOCKS, FIELDS = 4, 3


def chain(strength, rows=9):
    """Diagonal blocks, fields and cores of a chain, and the whole matrix, which is positive definite."""
    random = np.random.default_rng(0)
    roots = random.normal(size=(BLOCKS, rows, rows)) / np.sqrt(rows)
    own = dict(enumerate(roots @ roots.swapaxes(1, 2) + 0.5 * np.eye(rows)))
    fields = dict(enumerate(np.linalg.qr(random.normal(size=(BLOCKS, rows, FIELDS)))[0]))
    core = {}
    for j in range(BLOCKS - 1):
        block = random.normal(size=(FIELDS, FIELDS))
        core[j, j + 1] = strength * block / np.linalg.norm(block, 2)
        core[j + 1, j] = core[j, j + 1].T
    F = np.zeros((BLOCKS, rows, BLOCKS, rows))
    for j in range(BLOCKS):
        F[j, :, j] = own[j]
    for (j, k), block in core.items():
        F[j, :, k] = fields[j] @ block @ fields[k].T
    return own, fields, core, F.reshape(BLOCKS * rows, BLOCKS * rows)


@pytest.mark.parametrize("strength", [0.05, 0.6])
def test_blocks_have_the_answer_of_the_whole_matrix(strength, each_path):
    """The stronger coupling is beyond what the iteration settles."""
    own, fields, core, F = chain(strength)
    problems = {key: Complementarity(block) for key, block in own.items()}
    whole, blocks = Complementarity(F), BlockComplementarity(BLOCKS, core)
    for seed in range(20):
        h = np.random.default_rng(seed).normal(size=(BLOCKS, 9)) - 0.3
        found = blocks.solve(problems, dict(enumerate(h)), fields)
        np.testing.assert_allclose(np.concatenate([*found.values()]), whole.solve(h.ravel()), atol=1e-10)


def test_blocks_of_many_stiff_rows_on_few_soft_nodes(each_path):
    """Three stiff bodies on a soft one with few nodes, which they move as a whole."""
    found = [rows_on_few_nodes(seed) for seed in range(3)]
    own = {key: F for key, (F, _) in enumerate(found)}
    h = {key: 0.02 * (places**2).sum(axis=1) - 1.0 for key, (_, places) in enumerate(found)}
    fields, core = (
        {key: np.ones((100, 1)) for key in own},
        {(j, k): np.full((1, 1), 0.1) for j in own for k in own if j != k},
    )
    blocks = BlockComplementarity(len(own), core)
    lam = np.concatenate([*blocks.solve({key: Complementarity(F) for key, F in own.items()}, h, fields).values()])
    w = (
        scipy.linalg.block_diag(*(F - 0.1 for F in own.values())) @ lam
        + 0.1 * lam.sum()
        + np.concatenate([*h.values()])
    )
    assert lam.min() >= 0.0
    assert w.min() > -1e-9
    assert abs(lam * w).max() < 1e-9 * lam.max()
    np.testing.assert_allclose(
        np.concatenate([*blocks.pushed.values()])[lam > 0],
        (w - scipy.linalg.block_diag(*own.values()) @ lam)[lam > 0],
        atol=1e-9,
    )


def test_fields_that_have_changed_are_taken_with_the_same_active_rows(each_path):
    """As where rows have moved on their facets by little."""
    own, fields, core, F = chain(0.05)
    problems = {key: Complementarity(block) for key, block in own.items()}
    blocks, h = BlockComplementarity(BLOCKS, core), {j: own[j] @ np.full(9, -1.0) for j in own}  # closes all rows
    found = np.concatenate([*blocks.solve(problems, h, fields).values()])
    np.testing.assert_allclose(found, np.linalg.solve(F, -np.concatenate([*h.values()])), atol=1e-10)
    across = F - scipy.linalg.block_diag(*own.values())
    found = np.concatenate([*blocks.solve(problems, h, {j: 1.2 * W for j, W in fields.items()}).values()])
    np.testing.assert_allclose(found, np.linalg.solve(F + 0.44 * across, -np.concatenate([*h.values()])), atol=1e-10)


def test_blocks_without_forces_feel_those_of_the_others():
    own, fields, core, F = chain(0.1)
    blocks = BlockComplementarity(BLOCKS, core)
    lam = blocks.solve({1: Complementarity(own[1])}, {1: -np.ones(9)}, fields)[1]
    assert lam.any()
    pushed = fields[2] @ blocks.amplitudes[2]
    np.testing.assert_allclose(pushed, F[18:27, 9:18] @ lam, atol=1e-12)
    assert not blocks.amplitudes[3].any()


@pytest.mark.parametrize("strength", [0.05, 0.6])
def test_compiled_loops_have_the_same_answer_or_none(strength):
    """All blocks at once, from the active rows of the problem before; the iteration does not settle all of them."""
    if not compiles():
        pytest.skip("numba does not load here")
    own, fields, core, F = chain(strength)
    whole = Complementarity(F)
    flat = BlockComplementarity(BLOCKS, core).flat([*own.values()], [*fields.values()])
    settled = 0
    for seed in range(20):
        h = np.random.default_rng(seed).normal(size=BLOCKS * 9) - 0.3
        if flat.solve(h):
            settled += 1
            np.testing.assert_allclose(flat.lam, whole.solve(h), atol=1e-10)
            np.testing.assert_allclose(
                flat.pushed[9:18], h[9:18] + (F @ flat.lam)[9:18] - own[1] @ flat.lam[9:18], atol=1e-10
            )
    assert settled == 20 if strength < 0.1 else settled < 20
    assert not flat.solve(np.full(BLOCKS * 9, np.nan))
    assert flat.solve(np.ones(BLOCKS * 9))
    assert not flat.lam.any()


def test_gaps_that_are_not_finite_are_an_error():
    own, fields, core, _ = chain(0.1)
    with pytest.raises(ComplementarityError, match="not finite"):
        BlockComplementarity(BLOCKS, core).solve({0: Complementarity(own[0])}, {0: np.full(9, np.nan)}, fields)


def test_shared_fields_hold_all_columns():
    """Three blocks of a smooth kernel: few fields; a block of noise: as many as rows."""
    x = np.linspace(0, 1, 80)
    blocks = [1 / (distance + x[:, None] + x) for distance in (2, 3, 5)]
    fields = shared_fields(blocks)
    assert fields.shape[1] < 12  # a smooth kernel has no more beyond the accuracy that is asked for
    np.testing.assert_allclose(fields.T @ fields, np.eye(fields.shape[1]), atol=1e-13)
    for block in blocks:
        np.testing.assert_allclose(fields @ (fields.T @ block), block, atol=1e-9)
    assert shared_fields([np.random.default_rng(2).normal(size=(20, 50))]).shape == (20, 20)
