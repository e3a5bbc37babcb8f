"""Kinds of arrays that compiled loops get."""

import numpy as np
import pytest

from exudyn_partition.algebra.products import moved
from exudyn_partition.support.arrays import as_read_only, plain
from exudyn_partition.support.compiled import compiles, kernels


@pytest.mark.parametrize("array", [np.arange(6.0).reshape(3, 2)[:, 0], as_read_only(np.arange(3.0)), np.ones((2, 3)).T])
def test_an_array_of_another_kind_is_copied(array):
    found = plain(array)
    assert found.flags.carray
    np.testing.assert_array_equal(found, array)
    assert plain(found) is found


def test_a_loop_is_compiled_once_for_what_is_read_only_or_a_column():
    if not compiles():
        pytest.skip("numba does not load here")
    start, rows, way = np.ones(2), np.eye(2), np.arange(4.0).reshape(2, 2)
    for column in (way[:, 0].copy(), way[:, 0], as_read_only(way[:, 0].copy())):
        np.testing.assert_array_equal(moved(start, rows, column), [1.0, 3.0])
    assert len({kinds[2] for kinds in kernels("algebra", "product_kernels").moved.signatures}) == 1
