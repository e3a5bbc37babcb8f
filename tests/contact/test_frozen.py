"""Gaps of many contacts with frozen pairs by compiled loops, against those by products of NumPy."""

from types import SimpleNamespace

import numpy as np
import pytest

from exudyn_partition.algebra.block_complementarity import BlockComplementarity
from exudyn_partition.contact.frozen import FrozenContacts
from exudyn_partition.contact.linear_gaps import LinearGaps
from exudyn_partition.support.compiled import compiles

pytestmark = pytest.mark.skipif(not compiles(), reason="numba does not load here")
N, REACH = 12, 10.0  # coordinates of a contact, way up to which its pairs stay frozen


def contacts(rng, sizes, H=None):
    """Contacts each of which shares a body with the next, their rows, and the numbers of their coordinates."""
    rows = [
        LinearGaps(
            rng.normal(size=(nr, N)) if H is None else H, 1 + rng.uniform(0, 1, nr) ** 2,
            rng.normal(size=(6, N)), rng.normal(size=6), REACH,
        )
        for nr in sizes
    ]  # fmt: skip
    dofs = [np.arange(N) + j * N // 2 for j in range(len(sizes))]
    gaps = [
        SimpleNamespace(row_nodes=np.arange(nr), stage=SimpleNamespace(
            linear=own, normal=np.zeros((nr, 3)), rows=SimpleNamespace(leaves_at=np.full(nr, np.inf)),
        ))
        for own, nr in zip(rows, sizes, strict=True)
    ]  # fmt: skip
    blocks = BlockComplementarity(len(sizes), {}).flat(
        [np.eye(nr) for nr in sizes], [np.zeros((nr, 0)) for nr in sizes]
    )
    return FrozenContacts(gaps, dofs, blocks), rows, dofs


def test_the_smallest_gap_is_that_of_all_rows():
    """Wherever coordinates go, until a contact closes; contacts have many rows, few, and one."""
    rng, rows_of_smallest = np.random.default_rng(1), set()
    together, rows, dofs = contacts(rng, (150, 9, 1))
    phases = rng.uniform(0, 6, dofs[-1][-1] + 1)
    for step in range(500):
        q = 0.05 * np.sin(0.04 * step + phases)
        assert together.at(q)
        gaps = [own.start + own.H @ q[some] for own, some in zip(rows, dofs, strict=True)]
        np.testing.assert_allclose(together.values[:, 5], [gap.min() for gap in gaps], rtol=1e-12)
        assert not together.pushes
        assert not together.values[:, :5].any()
        assert not together.force.any()
        rows_of_smallest.add(int(gaps[0].argmin()))
    assert len(rows_of_smallest) > 5
    for own, some in zip(rows, dofs, strict=True):  # closes
        q = np.zeros(len(phases))
        q[some] = -3.0 * own.H[0] / (own.H[0] @ own.H[0])
        assert together.at(q)
        assert together.pushes


def test_pairs_that_slide_are_found():
    """Also where no gap changes, and numbers that are not finite."""
    rng = np.random.default_rng(2)
    together, rows, dofs = contacts(rng, (20, 20), np.zeros((20, N)))
    along = rng.normal(size=dofs[-1][-1] + 1)
    for size in np.linspace(0, REACH, 300):
        q = size * along
        slides = [abs(own.drift @ q[some] - own.drift_start).max() for own, some in zip(rows, dofs, strict=True)]
        assert together.at(q) == (max(slides) <= REACH)
    assert max(slides) > REACH
    for wrong in (np.nan, np.inf):
        assert not together.at(np.full(len(along), wrong))
