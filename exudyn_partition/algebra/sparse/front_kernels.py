"""Compiled loops that find fronts; module `fronts` does the same by NumPy."""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array
from ...support.compiled import unlocked


@unlocked
def eliminate_nodes(
    starts: Array,
    neighbours: Array,
    sizes: Array,
    group: Array,
    small: int,
    zeros_of_small: float,
    zeros_of_large: float,
) -> tuple[Array, Array, Array, Array, Array]:
    """Eliminate nodes one by one, and put those together that may share a front; see `fronts._roots`.

    Parameters
    ----------
    starts : (n + 1,) int array
        Where the later neighbours of each node begin in `neighbours`.
    neighbours : int array
        Ascending for each node.
    sizes : (n,) int array
        Rows of each node.
    group : (n,) int array
        Nodes of one front are of one group.
    small, zeros_of_small, zeros_of_large :
        Fronts that eliminate at most so many rows may hold such a share of zeros; larger ones.

    Returns
    -------
    taken_by : (n,) int array
        The node in whose front each node is eliminated, its own number if that is its own; follow it to its end.
    n_rows, n_below : (n,) int arrays
        Rows that each front eliminates, and that it changes.
    ends : (n + 1,) int array
        Where the nodes begin in `below` that each front changes.
    below : int array
        The first of each front is the least.
    """
    n = len(sizes)
    taken_by, n_rows, n_below = np.empty(n, np.int64), np.empty(n, np.int64), np.zeros(n, np.int64)
    n_zeros, ends, seen = np.zeros(n, np.int64), np.zeros(n + 1, np.int64), np.empty(n, np.int64)
    first_child, next_child = np.empty(n, np.int64), np.empty(n, np.int64)
    for node in range(n):
        taken_by[node], n_rows[node] = node, sizes[node]
        seen[node] = first_child[node] = next_child[node] = -1
    below = np.empty(4 * len(neighbours) + 1, np.int64)
    own, cost = np.empty(n, np.int64), np.empty(n, np.int64)
    for node in range(n):
        count = 0
        child = first_child[node]
        needed = starts[node + 1] - starts[node]
        while child >= 0:
            own[count] = child
            count += 1
            needed += ends[child + 1] - ends[child]
            child = next_child[child]
        for i in range(count // 2):  # ascending
            own[i], own[count - 1 - i] = own[count - 1 - i], own[i]
        begin = ends[node]
        if begin + needed > len(below):
            grown = np.empty(2 * len(below) + needed, np.int64)
            for place in range(begin):
                grown[place] = below[place]
            below = grown
        end, least = begin, n
        for place in range(starts[node], starts[node + 1]):
            other = neighbours[place]
            seen[other] = node
            below[end] = other
            end += 1
            n_below[node] += sizes[other]
            least = min(least, other)
        for i in range(count):
            for place in range(ends[own[i]], ends[own[i] + 1]):
                other = below[place]
                if other != node and seen[other] != node:
                    seen[other] = node
                    below[end] = other
                    end += 1
                    n_below[node] += sizes[other]
                    least = min(least, other)
        for place in range(begin, end):  # the least comes first
            if below[place] == least:
                below[place], below[begin] = below[begin], least
                break
        ends[node + 1] = end
        for i in range(count):  # few: sorted by insertion
            child, j = own[i], i
            zeros_more = n_rows[child] * (n_rows[node] + n_below[node] - n_below[child])
            while j > 0 and cost[j - 1] > zeros_more:
                own[j], cost[j] = own[j - 1], cost[j - 1]
                j -= 1
            own[j], cost[j] = child, zeros_more
        for i in range(count):
            child = own[i]
            rows = n_rows[child] + n_rows[node]
            lacking = n_zeros[node] + n_zeros[child] + n_rows[child] * (n_rows[node] + n_below[node] - n_below[child])
            entries = rows * (rows + 1) // 2 + rows * n_below[node]
            most = (zeros_of_small if rows <= small else zeros_of_large) * entries
            if group[child] == group[node] and lacking <= most:
                taken_by[child], n_rows[node], n_zeros[node] = node, rows, lacking
        if end > begin:
            next_child[node], first_child[least] = first_child[least], node
    return taken_by, n_rows, n_below, ends, below
