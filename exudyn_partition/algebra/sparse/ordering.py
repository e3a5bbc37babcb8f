"""Order of elimination that keeps the factors of a sparse symmetric matrix small: nested dissection.

Theory: A. George, Nested dissection of a regular finite element mesh, SIAM Journal on Numerical Analysis 10, 1973.
B. Hendrickson, E. Rothberg, Improving the run time and quality of nested dissection ordering, SIAM Journal on
Scientific Computing 20, 1998.

`validation/benchmarks/ordering.py` compares it with the orders of SciPy's SuperLU. A binding to metis would be one more
package to install.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow

from ...support.arrays import Array

_LEAF = 400  # parts with fewer nodes are not cut any more
_WHOLE = 4000  # parts with more are cut by groups of nodes first
_FEWER = 0.7  # largest number of groups, by that of nodes, that is worth it
_BALANCE = 0.2  # least share of the nodes on each side of a cut, as far as it is not moved afterwards
_UNIT = 8  # price of a node in the middle, so that whole numbers are fine enough
_WAYS = 2  # pairs of far ends between which groups are cut; of nodes it is one, as they take more time
_NO_CUT = 2**30  # capacity of what must not be cut, beyond all numbers of nodes


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
    separates. The last parts are ordered by minimum degree. The gain over minimum degree alone is largest for solid
    bodies.

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
    graph = graph + sp.identity(graph.shape[0], format="csr")  # so that no row of any part is empty
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


def cut(graph: sp.csr_matrix, weights: Array | None = None) -> Array | None:
    """Cut a graph in two parts of similar size by few nodes.

    A large graph is cut by groups of nodes first, as a smaller graph. Then the cut moves to the best place nearby.

    Parameters
    ----------
    graph : (n, n) csr matrix
        Of symmetric pattern; its entries are positive.
    weights : (n,) int array, optional
        Size of each node. Default: 1.

    Returns
    -------
    (n,) int array or None
        Side of each node, -1 or 1, and 0 on the cut; None if there is no cut.
    """
    n = graph.shape[0]
    ways = 1 if weights is None else _WAYS
    weights = np.ones(n, dtype=np.int64) if weights is None else weights
    group = _groups(graph) if n > _WHOLE else np.arange(n)
    if group.max() + 1 > _FEWER * n:
        return _cut_between_ends(graph, weights, ways)
    side = cut(_merged(graph, group), np.bincount(group, weights).astype(np.int64))
    if side is None:
        return None
    side = side[group]
    band = side.copy()
    band[graph @ (side == 0) > 0] = 0
    return least_cut(graph, band, weights) if (band < 0).any() and (band > 0).any() else side


def _groups(graph: sp.csr_matrix) -> Array:
    """Number the group of each node, (n,) int array: groups are around centres, two nodes wide."""

    def most_around(values: Array) -> Array:
        most: Array = np.maximum.reduceat(values[graph.indices], graph.indptr[:-1])
        return most

    n = graph.shape[0]
    drawn = 1 + np.random.default_rng(0).permutation(n).astype(np.int32)
    group = np.where(most_around(drawn) == drawn, drawn, 0)  # at centres, of which no two are neighbours
    for _ in range(2):
        group = np.where(group > 0, group, most_around(group))
    group = np.where(group > 0, group, drawn)
    used = np.zeros(n + 1, dtype=np.int32)
    used[group] = 1
    numbers: Array = np.cumsum(used, dtype=np.int32)[group] - 1
    return numbers


def _merged(graph: sp.csr_matrix, group: Array) -> sp.csr_matrix:
    """Graph of groups of nodes."""
    n = len(group)
    member = sp.csr_matrix((np.ones(n), group, np.arange(n + 1)), shape=(n, group.max() + 1))
    return member.T.tocsr() @ (graph @ member)


def _cut_between_ends(graph: sp.csr_matrix, weights: Array, ways: int) -> Array | None:
    """Cut a graph, see `cut`, between the ends of some breadth-first searches; it is not cut near these ends."""
    n, start, found = graph.shape[0], 0, []
    if n == 1:
        return None
    for way in range(1 + ways):
        order = breadth_first_order(graph, start, return_predecessors=False)
        if len(order) < n:
            count, part = connected_components(graph, directed=False)
            return np.where(part < count // 2, -1, 1)
        start = order[-1]
        if way == 0:
            continue
        share = (np.cumsum(weights[order]) - 0.5 * weights[order]) / weights.sum()  # of what comes first
        lesser = np.empty(n)
        lesser[order] = np.minimum(share, 1 - share)
        side = np.zeros(n, dtype=np.int64)
        side[order[share < _BALANCE]] = side[order[0]] = -1
        side[order[share > 1 - _BALANCE]] = side[start] = 1
        side[(side > 0) & (graph @ (side < 0) > 0)] = 0
        if (side > 0).any():
            price = np.rint(_UNIT * weights * np.sqrt(0.5 / np.maximum(lesser, _BALANCE)))
            found.append(least_cut(graph, side, weights, price))
    return min(found, key=lambda side: _cost(side, weights), default=None)


def _cost(side: Array, weights: Array) -> float:
    """Size of a cut, by the root of what it cuts off."""
    below, on, above = np.bincount(side + 1, weights, 3)
    return float(on / np.sqrt(max(min(below, above), 1.0)))


def least_cut(graph: sp.csr_matrix, side: Array, weights: Array, price: Array | None = None) -> Array:
    """Find the cheapest nodes that part two sides of a graph, by a largest flow (Menger's theorem).

    Parameters
    ----------
    graph : (n, n) csr matrix
    side : (n,) int array
        Side of each node, -1 or 1, or 0 if it may be on the cut. No node of one side touches the other one.
    weights : (n,) int array
    price : (n,) array of whole numbers, optional
        Of each node on the cut. Default: its weight.

    Returns
    -------
    (n,) int array
        The same with sides for all but the nodes on the cut. Of several cuts it is one of the two nearest to the sides.
    """
    free = np.flatnonzero(side == 0)
    n = len(free)
    number = np.full(len(side), -1, dtype=np.int32)
    number[free] = np.arange(n)
    rows = graph[free]
    node, beside = np.repeat(np.arange(n, dtype=np.int32), np.diff(rows.indptr)), side[rows.indices]
    first, last = (np.flatnonzero(np.bincount(node[beside == which], minlength=n)) for which in (-1, 1))
    inside = beside == 0
    # Each free node is an edge from its entry, i, to its exit, n + i.
    source, sink = 2 * n, 2 * n + 1
    starts = [np.arange(n), n + node[inside], np.full(len(first), source), n + last]
    ends = [n + np.arange(n), number[rows.indices[inside]], first, np.full(len(last), sink)]
    most = np.full(sum(map(len, starts)), _NO_CUT, dtype=np.int32)
    most[:n] = (weights if price is None else price)[free]
    net = sp.csr_matrix((most, (np.concatenate(starts), np.concatenate(ends))), shape=(2 * n + 2,) * 2)
    left = net - maximum_flow(net, source, sink).flow
    left.eliminate_zeros()
    near_first, near_last = side.copy(), side.copy()  # the cuts that are nearest to either side
    reached = _reached(left, source)
    near_first[free] = np.where(reached[n : 2 * n], -1, np.where(reached[:n], 0, 1))
    reached = _reached(left.T.tocsr(), sink)
    near_last[free] = np.where(reached[:n], 1, np.where(reached[n : 2 * n], 0, -1))
    return min(near_first, near_last, key=lambda side: _cost(side, weights))


def _reached(graph: sp.csr_matrix, start: int) -> Array:
    """Whether each node can be reached, (n,) bool array."""
    reached = np.zeros(graph.shape[0], dtype=bool)
    reached[breadth_first_order(graph, start, return_predecessors=False)] = True
    return reached


def _minimum_degree(graph: sp.csr_matrix) -> Array:
    """Minimum degree order of SuperLU, which returns it only together with the factors of a matrix."""
    dominant = (graph.shape[0] + 2) * sp.identity(graph.shape[0]) - graph
    factors = scipy.sparse.linalg.splu(sp.csc_matrix(dominant), permc_spec="MMD_AT_PLUS_A")
    return np.argsort(factors.perm_c)
