"""Fronts of a sparse symmetric matrix: which rows are eliminated together, and which others they change.

Theory: J. W. H. Liu, The multifrontal method for sparse matrix solution: theory and practice, SIAM Review 34, 1992.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...support.arrays import Array
from .ordering import nested_dissection, node_graph

_ZEROS = 0.15  # most zeros that a front may hold, by its entries: few large fronts are quicker than many small ones
_SMALL, _SMALL_ZEROS = 56, 0.5  # and that one with at most so many rows to eliminate may hold
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
    n_children : list of (nf,) int
    """

    order: Array
    starts: Array
    below: list[Array]
    n_children: list[int]


@dataclass
class _Front:
    """A front of nodes; numbers of rows, and of entries that are zero."""

    nodes: list[int]
    below: Array
    n_rows: int
    n_below: int
    zeros: int = 0
    children: list[_Front] = field(default_factory=list)
    peak: int = 0

    def take(self, child: _Front) -> bool:
        """Eliminate a child's nodes with one's own, if that stores few zeros; whether it does."""
        rows = child.n_rows + self.n_rows
        zeros = self.zeros + child.zeros + child.n_rows * (self.n_rows + self.n_below - child.n_below)
        entries = rows * (rows + 1) // 2 + rows * self.n_below
        if zeros > (_SMALL_ZEROS if rows <= _SMALL else _ZEROS) * entries:
            return False
        self.nodes, self.n_rows, self.zeros = child.nodes + self.nodes, rows, zeros
        self.children += child.children
        return True

    def arrange(self) -> None:
        """Put first the child whose elimination needs most memory beyond what it leaves (Liu 1986)."""
        self.children.sort(key=lambda child: child.n_below**2 - child.peak)
        left = 0
        for child in self.children:
            self.peak = max(self.peak, left + child.peak)
            left += child.n_below**2
        self.peak = max(self.peak, left + self.n_below**2)


def find_fronts(matrix: sp.csr_matrix) -> Fronts:
    """Find the fronts of a matrix of symmetric pattern, (n, n), in the order of nested dissection."""
    graph, node = node_graph(matrix)
    order = nested_dissection(graph)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    node = rank[node]  # nodes are numbered in that order from here on
    sizes = np.bincount(node, minlength=len(order))
    fronts, todo = [], _roots(graph[order][:, order], sizes)
    while todo:
        fronts.append(todo.pop())
        todo += fronts[-1].children
    fronts.reverse()  # children before their parents
    nodes = np.array([number for front in fronts for number in front.nodes], dtype=np.int64)
    place = np.empty(len(nodes), dtype=np.int64)  # of the first row of each node
    place[nodes] = np.cumsum(sizes[nodes]) - sizes[nodes]
    starts, below, n_children = [0], [], []
    for front in fronts:
        nodes = front.below[np.argsort(place[front.below])]
        count, end = sizes[nodes], starts[-1] + front.n_rows
        beyond = np.repeat(place[nodes] - np.cumsum(count) + count, count) + np.arange(front.n_below)
        children = len(front.children)
        while starts[-1] < end:
            starts.append(min(starts[-1] + WIDEST, end))
            below.append(np.r_[starts[-1] : end, beyond])
            n_children.append(children)
            children = 1
    return Fronts(np.argsort(place[node], kind="stable"), np.array(starts), below, n_children)


def _roots(graph: sp.csr_matrix, sizes: Array) -> list[_Front]:
    """Eliminate nodes one by one, and put those together that may share a front; return the fronts without a parent."""
    lower = sp.csc_matrix(sp.tril(graph, -1))
    lower.sort_indices()
    neighbours = np.split(lower.indices, lower.indptr[1:-1])
    roots: list[_Front] = []
    children: list[list[_Front]] = [[] for _ in sizes]
    for node, below in enumerate(neighbours):
        own, children[node] = children[node], []
        if own:
            below = np.concatenate([below, *(child.below[1:] for child in own)])
            below.sort()
            below = below[np.concatenate([[True], below[1:] != below[:-1]])[: len(below)]]
        front = _Front([node], below, int(sizes[node]), int(sizes[below].sum()))
        own.sort(key=lambda child: child.n_rows * (front.n_rows + front.n_below - child.n_below))
        front.children += [child for child in own if not front.take(child)]
        front.arrange()
        (children[below[0]] if len(below) else roots).append(front)
    return roots
