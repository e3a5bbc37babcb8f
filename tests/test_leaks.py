"""Memory that is given back: the same work over and over needs no more of it."""

import os
from pathlib import Path

import pytest

import exudyn_partition as ep

WARM_UP, CYCLES = 2, 10
GROWTH = 5.0  # MB


def resident():
    """Memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="there is no such file on this system")
def test_reductions_give_their_factors_back(block, top):
    """Factors of this size, 6 MB a reduction, made in one thread and dropped in another, are not freed."""
    used = []
    for _ in range(WARM_UP + CYCLES):
        ep.reduce(block, top, f_cut=80e3)
        used.append(resident())
    assert used[-1] - used[WARM_UP - 1] < GROWTH
