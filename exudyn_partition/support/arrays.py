"""Types of arrays, and the layout of vectors that lie one behind the other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # docstrings say shapes, and where it is not floats
Vector = Sequence[float] | Array  # three numbers from a user, in a tuple, list or array


def as_read_only(array: Array) -> Array:
    """Return a view that cannot be written to; loops are compiled anew for arrays that can."""
    view = array.view()
    view.flags.writeable = False
    return view


def plain(array: Array) -> Array:
    """Return an array that can be written to and lies by rows: the same, or a copy.

    Loops are compiled anew for arrays of each kind; short arrays are copied in no time.
    """
    return array if array.flags.carray else array.copy()


def consecutive(sizes: Sequence[int]) -> list[slice]:
    """Slices of parts with these sizes that lie one behind the other."""
    return [slice(a, b) for a, b in pairwise(accumulate(map(int, sizes), initial=0))]


def as_slice(places: Array) -> slice | Array:
    """The same places, (n,) int array, as a slice if they are consecutive. Taking a slice is quicker."""
    start = int(places[0]) if len(places) else 0
    end = start + len(places)
    return slice(start, end) if np.array_equal(places, np.arange(start, end)) else places


def joined_slices(slices: Sequence[slice]) -> list[slice]:
    """The same places in the same order; slices that begin where the one before ends are joined with it."""
    result: list[slice] = []
    for each in slices:
        if result and result[-1].stop == each.start:
            result[-1] = slice(result[-1].start, each.stop)
        else:
            result.append(each)
    return result
