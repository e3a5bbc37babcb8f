"""Objects with several arrays, which compiled loops take as one argument."""

import sys

import numpy as np
import pytest

from exudyn_partition.support.compiled import kernels


def test_an_object_holds_its_arrays_until_it_is_deleted():
    """Loops read those that were given, with what is written to them later; none is kept for ever."""
    loops = kernels("contact")
    if loops is None:
        pytest.skip("numba is not there")
    nodes, weights = np.array([[0, 1]]), np.array([[0.25, 0.75]])
    starts, columns, means = np.array([0, 1], dtype=np.int32), np.array([0], dtype=np.int32), np.ones(1)
    before = sys.getrefcount(means)
    points = loops.flat_points(nodes, weights, starts, columns, means)
    assert sys.getrefcount(means) == before + 1
    means[0] = 2.0
    total = loops.resultant(points, np.array([3.0]), np.array([[0.0, 0.0, 1.0]]))
    np.testing.assert_array_equal(total, [0.0, 0.0, 6.0])
    del points
    assert sys.getrefcount(means) == before
