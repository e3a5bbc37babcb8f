"""Order of elimination that keeps the factors of a sparse symmetric matrix small: nested dissection.

`validation/benchmarks/ordering.py` compares it with the orders of SciPy's SuperLU. A binding to metis would be one more
package to install.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_bipartite_matching

from ...support.arrays import Array

_LEAF = 500  # parts with fewer nodes are not cut any more
_BALANCE = 0.25  # least share of the nodes on each side of a cut


def node_graph(matrix: sp.csr_matrix) -> tuple[sp.csr_matrix, Array]:
    """Graph of the nodes of a matrix of symmetric pattern, (n, n), and the node of each row, (n,) int array.

    The dofs of a node have the same neighbours. They stay together.
    """
    pattern = sp.csr_matrix((np.ones(matrix.nnz, dtype=np.int64), matrix.indices, matrix.indptr), matrix.shape)
    label = pattern @ np.random.default_rng(0).integers(2**62, size=pattern.shape[0])
    _, first, node = np.unique(label, return_index=True, return_inverse=True)
    return pattern[first][:, first].astype(float), node


def nested_dissection(graph: sp.csr_matrix, last: Array | None = None) -> Array:
    """Order the nodes of a graph, so that the factors of a matrix with its pattern fill little.

    A small set of nodes cuts the graph in two, and each half is cut again. A cut is eliminated after the parts that it
    separates (George 1973). Cuts follow the fronts of a breadth-first search between far ends of the graph, and are
    least vertex covers there. The last parts are ordered by minimum degree. The gain over minimum degree alone is
    largest for solid bodies.

    Parameters
    ----------
    graph : (n, n) csr matrix
        Of symmetric pattern; its entries are positive.
    last : (k,) int array, optional
        Nodes that come after all others, in this order.

    Returns
    -------
    (n,) int array
        The nodes in order of elimination.
    """
    pieces = []  # last eliminated first
    parts = [(graph, np.arange(graph.shape[0]))]
    if last is not None and len(last):
        others = np.delete(parts[0][1], last)
        pieces, parts = [last], [(graph[others][:, others], others)]
    while parts:
        graph, nodes = parts.pop()
        side = cut(graph) if len(nodes) > _LEAF else None
        if side is None:
            pieces.append(nodes[_minimum_degree(graph)])
            continue
        pieces.append(nodes[side == 0])
        for half in (np.flatnonzero(side < 0), np.flatnonzero(side > 0)):
            parts.append((graph[half][:, half], nodes[half]))
    return np.concatenate(pieces[::-1])


def cut(graph: sp.csr_matrix) -> Array | None:
    """Side of each node, -1 or 1, and 0 on the cut; None if there is no balanced cut."""
    n = graph.shape[0]
    best, start, side = np.inf, 0, None
    for _ in range(3):
        order, level = _fronts(graph, start)
        if len(order) < n:
            count, part = connected_components(graph, directed=False)
            return np.where(part < count // 2, -1, 1)
        start = order[-1]
        size = np.bincount(level)
        before = np.cumsum(size)[:-1]
        smaller = np.minimum(before, n - before)
        cost = np.where(smaller > _BALANCE * n, np.minimum(size[:-1], size[1:]) / np.sqrt(smaller), np.inf)
        if len(cost) and cost.min() < best:
            front = cost.argmin()
            best, side = cost[front], np.where(level <= front, -1, 1)
            touching = np.flatnonzero(level == front), np.flatnonzero(level == front + 1)
    if side is not None:
        side[least_cover(graph, *touching)] = 0
    return side


def _fronts(graph: sp.csr_matrix, start: int) -> tuple[Array, Array]:
    """Nodes in breadth-first order, and each node's distance from `start`, -1 if it cannot be reached."""
    order, parent = breadth_first_order(graph, start)
    place = np.empty(graph.shape[0], dtype=np.int64)
    place[order] = np.arange(len(order))
    parents = place[parent[order[1:]]]  # ascending
    bounds = [0, 1]
    while bounds[-1] < len(order):
        bounds.append(1 + int(np.searchsorted(parents, bounds[-1])))
    level = np.full(graph.shape[0], -1)
    level[order] = np.repeat(np.arange(len(bounds) - 1), np.diff(bounds))
    return order, level


def least_cover(graph: sp.csr_matrix, left: Array, right: Array) -> Array:
    """Fewest nodes that touch every edge between `left` and `right`, by a largest matching (Koenig's theorem)."""
    edges = graph[left][:, right]
    mate = maximum_bipartite_matching(edges, perm_type="column")
    alone, paired = np.flatnonzero(mate < 0), np.flatnonzero(mate >= 0)
    n_left, n_right = edges.shape
    # Of the left nodes, the right ones, and one from which those without a mate are reached.
    source = n_left + n_right
    starts = [np.repeat(np.arange(n_left), np.diff(edges.indptr)), n_left + mate[paired], np.full(len(alone), source)]
    ends = np.concatenate([n_left + edges.indices, paired, alone])
    paths = sp.csr_matrix((np.ones(len(ends)), (np.concatenate(starts), ends)), shape=(source + 1,) * 2)
    reached = np.zeros(n_left + n_right + 1, dtype=bool)
    reached[breadth_first_order(paths, source, return_predecessors=False)] = True
    return np.concatenate([left[~reached[:n_left]], right[reached[n_left:-1]]])


def _minimum_degree(graph: sp.csr_matrix) -> Array:
    """Minimum degree order of SuperLU, which returns it only together with the factors of a matrix."""
    dominant = (graph.shape[0] + 1) * sp.identity(graph.shape[0]) - graph
    factors = scipy.sparse.linalg.splu(sp.csc_matrix(dominant), permc_spec="MMD_AT_PLUS_A")
    return np.argsort(factors.perm_c)
