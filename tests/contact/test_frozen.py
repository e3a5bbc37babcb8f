"""Smallest gaps by the lowest rows of contacts that fly, against the gaps of all rows."""

import numpy as np
import pytest

from exudyn_partition.contact import loops
from exudyn_partition.contact.linear_gaps import FlatRows, LinearGaps, LowestRows
from exudyn_partition.support.compiled import compiles

pytestmark = pytest.mark.skipif(not compiles(), reason="numba does not load here")
N = 12  # coordinates of a contact


def contacts(rng, sizes, ties=False):
    """Rows of contacts that two of a few bodies share, and their pairs."""
    found = []
    for nr in sizes:
        start = np.ones(nr) if ties else 1 + rng.uniform(0, 1, nr) ** 2
        H = np.repeat(rng.normal(size=(1, N)), nr, axis=0) if ties else rng.normal(size=(nr, N))
        found.append(LinearGaps(H, start, rng.normal(size=(6, N)), rng.normal(size=6), 10.0))
    dofs = [np.arange(N) + j * N // 2 for j in range(len(sizes))]
    return found, dofs, FlatRows.of(found, [np.zeros((nr, 3)) for nr in sizes], dofs)


@pytest.mark.parametrize("sizes", [(150, 9, 60), (150, 5, 8)], ids=["many rows", "all rows of a contact"])
@pytest.mark.parametrize("ties", [False, True])
def test_the_smallest_gap_is_that_of_all_rows(sizes, ties):
    """Wherever coordinates go, until a contact closes."""
    rng, rows_of_smallest = np.random.default_rng(1), set()
    frozen, dofs, rows = contacts(rng, sizes, ties)
    lowest, told = LowestRows.of(frozen), np.zeros((len(sizes), 6))
    work, chosen = np.full(sum(sizes), np.nan), 0
    phases = rng.uniform(0, 6, dofs[-1][-1] + 1)
    for step in range(2000):
        q, before = 0.05 * np.sin(0.01 * step + phases), lowest.at.copy()
        assert loops.fly_on(rows, lowest, q, work, told)
        gaps = [g.start + g.H @ q[own] for g, own in zip(frozen, dofs, strict=True)]
        np.testing.assert_allclose(told[:, 5], [gap.min() for gap in gaps], rtol=1e-12)
        assert not told[:, :5].any()
        chosen += not np.array_equal(before, lowest.at)
        rows_of_smallest.add(int(gaps[0].argmin()))
    assert (len(rows_of_smallest) > 5 and chosen < 1000) or ties
    for one in range(len(sizes)):  # closes
        q = np.zeros(len(phases))
        q[dofs[one]] = -2.0 * frozen[one].H[0] / (frozen[one].H[0] @ frozen[one].H[0])
        assert (frozen[one].start + frozen[one].H @ q[dofs[one]]).min() < 0.0
        assert not loops.fly_on(rows, lowest, q, work, told)


def test_a_row_that_comes_down_alone_becomes_the_lowest():
    """All others stay where they are, so that it is the lowest as soon as it may be, from wherever it came."""
    nr, told = 20, np.zeros((1, 6))
    start, H = np.linspace(1.0, 1.1, nr), np.zeros((nr, N))
    for height in np.linspace(0.05, 0.3, 26):
        start[-1], H[-1, 0] = 1.0 + height, -1.0
        frozen = [LinearGaps(H, start, np.zeros((6, N)), np.zeros(6), 1.0)]
        rows, lowest = FlatRows.of(frozen, [np.zeros((nr, 3))], [np.arange(N)]), LowestRows.of(frozen)
        for way in np.linspace(0.0, height + 0.5, 200):
            assert loops.fly_on(rows, lowest, way * np.eye(N)[0], np.zeros(nr), told)
            assert told[0, 5] == pytest.approx(min(1.0, 1.0 + height - way))


def test_pairs_that_slide_are_found():
    """Also where no gap changes, and numbers that are not finite."""
    rng = np.random.default_rng(2)
    frozen, dofs, _ = contacts(rng, (20, 20))
    for g in frozen:
        g.H[:] = 0.0
    rows, lowest = FlatRows.of(frozen, np.zeros((2, 20, 3)), dofs), LowestRows.of(frozen)
    work, told, along = np.zeros(40), np.zeros((2, 6)), rng.normal(size=dofs[-1][-1] + 1)
    for size in np.linspace(0, 10, 300):
        q = size * along
        slides = [abs(g.drift @ q[own] - g.drift_start).max() for g, own in zip(frozen, dofs, strict=True)]
        assert loops.fly_on(rows, lowest, q, work, told) == (max(slides) <= 10.0)
    assert max(slides) > 10.0
    for wrong in (np.nan, np.inf):
        assert not loops.fly_on(rows, lowest, np.full(len(along), wrong), work, told)
