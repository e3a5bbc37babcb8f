"""Fronts of a sparse symmetric matrix: which rows are eliminated together, and which others they change.

Theory: J. W. H. Liu, The multifrontal method for sparse matrix solution: theory and practice, SIAM Review 34, 1992.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...support.arrays import Array
from . import loops
from .ordering import nested_dissection, node_graph

_ZEROS = 0.15  # most zeros that a front may hold, by its entries: few large fronts are quicker than many small ones
_SMALL, _SMALL_ZEROS = 56, 0.5  # and that one with at most so many rows to eliminate may hold
_EVEN = 0.55  # largest share of two parts that is even enough
WIDEST = 1024  # most rows that a front eliminates; more do so in a chain of fronts, whose triangles are smaller


class Fronts(NamedTuple):
    """Fronts in order of elimination, children before their parents; each front follows its last child.

    Parameters
    ----------
    order : (n,) int array
        Rows of the matrix in order of elimination.
    starts : (nf + 1,) int array
        Which of these each front eliminates.
    below : list of (m,) int arrays
        Places in `order` of the rows beyond them that each front changes, ascending.
    children : list of lists of int
        The fronts whose changes each front takes up.
    parts : three int arrays
        Fronts of two parts that do not touch each other, for two threads, and those that come after both; ascending.
    """

    order: Array
    starts: Array
    below: list[Array]
    children: list[list[int]]
    parts: tuple[Array, Array, Array]

    @classmethod
    def of(cls, order: Array, starts: Array, below: list[Array]) -> Fronts:
        """Fronts by their rows alone: the first row that a front changes tells its parent."""
        n_rows = np.diff(starts)
        front_of = np.repeat(np.arange(len(below)), n_rows)
        children: list[list[int]] = [[] for _ in below]
        for number, rows in enumerate(below):
            if len(rows):
                children[front_of[rows[0]]].append(number)
        work = n_rows * (n_rows + [len(rows) for rows in below])
        return cls(order, starts, below, children, two_parts(children, work.tolist()))


@dataclass
class _Front:
    """A front of nodes, and numbers of rows."""

    nodes: list[int]
    below: Array
    n_rows: int
    n_below: int
    children: list[_Front] = field(default_factory=list)
    peak: int = 0

    def arrange(self) -> None:
        """Put first the child whose elimination needs most memory beyond what it leaves (Liu 1986)."""
        self.children.sort(key=lambda child: child.n_below**2 - child.peak)
        left = 0
        for child in self.children:
            self.peak = max(self.peak, left + child.peak)
            left += child.n_below**2
        self.peak = max(self.peak, left + self.n_below**2)


def find_fronts(matrix: sp.csr_matrix, last: Sequence[Array] = ()) -> Fronts:
    """Find the fronts of a matrix of symmetric pattern, (n, n), in the order of nested dissection.

    Parameters
    ----------
    matrix : (n, n) csr matrix
    last : sequence of int arrays
        Groups of rows that come after all others, group by group. No front eliminates rows of two groups, so that what
        lies before a group does not make its fronts larger.
    """
    graph, node = node_graph(matrix)
    group = np.zeros(graph.shape[0], dtype=np.int64)
    for number, rows in enumerate(last, 1):
        group[node[rows]] = number
    order = nested_dissection(graph, np.argsort(group, kind="stable")[np.count_nonzero(group == 0) :])
    group = group[order]
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    node = rank[node]  # nodes are numbered in that order from here on
    sizes = np.bincount(node, minlength=len(order))
    fronts, todo = [], _roots(graph[order][:, order], sizes, group)
    while todo:
        fronts.append(todo.pop())
        todo += fronts[-1].children
    fronts.reverse()  # children before their parents
    nodes = np.array([number for front in fronts for number in front.nodes], dtype=np.int64)
    place = np.empty(len(nodes), dtype=np.int64)  # of the first row of each node
    place[nodes] = np.cumsum(sizes[nodes]) - sizes[nodes]
    starts, below = [0], []
    for front in fronts:
        nodes = front.below[np.argsort(place[front.below])]
        count, end = sizes[nodes], starts[-1] + front.n_rows
        beyond = np.repeat(place[nodes] - np.cumsum(count) + count, count) + np.arange(front.n_below)
        while starts[-1] < end:
            starts.append(min(starts[-1] + WIDEST, end))
            below.append(np.r_[starts[-1] : end, beyond])
    return Fronts.of(np.argsort(place[node], kind="stable"), np.array(starts), below)


def two_parts(children: list[list[int]], work: list[int]) -> tuple[Array, Array, Array]:
    """Divide fronts into two parts of about equal work that do not touch each other, and what comes after both.

    Parameters
    ----------
    children : list of lists of int
        Of each front; they come before it.
    work : list of int
        Of each front.
    """
    whole, roots = list(work), set(range(len(work)))  # with all before it
    for front, of_front in enumerate(children):
        whole[front] += sum(whole[child] for child in of_front)
        roots.difference_update(of_front)
    trees = [(-whole[root], root) for root in roots]
    heapq.heapify(trees)
    part = np.empty(len(work), dtype=np.int64)
    last = []
    while True:  # the largest tree is cut at its root, until the others can be shared out
        loads = [0, 0]
        for size, root in sorted(trees):
            part[root] = np.argmin(loads)
            loads[part[root]] -= size
        if not trees or max(loads) <= _EVEN * sum(loads) or not children[trees[0][1]]:
            break
        last.append(heapq.heappop(trees)[1])
        for child in children[last[-1]]:
            heapq.heappush(trees, (-whole[child], child))
    for front in range(len(work) - 1, -1, -1):
        if front not in last:
            part[children[front]] = part[front]
    part[last] = 2
    return np.flatnonzero(part == 0), np.flatnonzero(part == 1), np.flatnonzero(part == 2)


def _roots(graph: sp.csr_matrix, sizes: Array, group: Array) -> list[_Front]:
    """Eliminate nodes one by one, and put those together that may share a front; return the fronts without a parent.

    Nodes of a front are of one group, (n,) int array.
    """
    lower = sp.csc_matrix(sp.tril(graph, -1))
    lower.sort_indices()
    limits = _SMALL, _SMALL_ZEROS, _ZEROS
    front, n_rows, n_below, ends, below = loops.eliminate_nodes(lower.indptr, lower.indices, sizes, group, *limits)
    while (front[front] != front).any():
        front = front[front]
    leading, counts = np.unique(front, return_counts=True)
    nodes = np.split(np.argsort(front, kind="stable"), np.cumsum(counts)[:-1])
    roots: list[_Front] = []
    fronts: dict[int, _Front] = {}
    for last, members in zip(leading.tolist(), nodes, strict=True):
        beyond = below[ends[last] : ends[last + 1]]
        fronts[last] = _Front(members.tolist(), beyond, int(n_rows[last]), int(n_below[last]))
    for each in fronts.values():
        each.arrange()
        (fronts[int(front[each.below[0]])].children if len(each.below) else roots).append(each)
    return roots
