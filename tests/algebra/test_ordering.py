"""Nested dissection: an order of all rows, cuts that separate, and factors that fill less."""

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.csgraph
import scipy.sparse.linalg
from oracles import box

import exudyn_partition as ep
from exudyn_partition.algebra.sparse.multifrontal import Factorisation
from exudyn_partition.algebra.sparse.ordering import cut, least_cut, nested_dissection, node_graph


def grid(*shape):
    """Stiffness of springs on a grid."""
    chains = [sp.diags([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1]) for n in shape]
    total = chains[0]
    for chain in chains[1:]:
        total = sp.kronsum(total, chain)
    return sp.csr_matrix(total)


@pytest.mark.parametrize(
    "matrix", [grid(3), grid(40, 50), sp.block_diag([grid(30, 30), grid(7, 90)]), sp.identity(20000)]
)
def test_every_row_once(matrix):
    order = nested_dissection(abs(sp.csr_matrix(matrix)))
    np.testing.assert_array_equal(np.sort(order), np.arange(matrix.shape[0]))


def test_a_cut_separates_and_is_as_small_as_the_body_is_narrow():
    graph = abs(grid(10, 80)).astype(float)
    side = cut(graph)
    assert np.count_nonzero(side == 0) <= 10
    assert min(np.count_nonzero(side < 0), np.count_nonzero(side > 0)) >= 0.25 * 800 - 10
    assert graph[side < 0][:, side > 0].nnz == 0


def test_a_cut_through_a_solid_body_is_no_larger_than_a_plane():
    block = ep.fe_model(box(0.04, 0.03, 0.02), ep.STEEL, maxh=3e-3)
    graph, node = node_graph(block.stiffness)
    x = np.empty(graph.shape[0])
    x[node] = np.repeat(block.points[:, 0], 3)
    left = x < np.median(x)
    on_the_plane = np.count_nonzero(left & (graph @ ~left > 0))
    side = cut(graph)
    assert np.count_nonzero(side == 0) < 0.67 * on_the_plane  # a search from a corner cuts by a sphere: 0.72
    assert min(np.count_nonzero(side < 0), np.count_nonzero(side > 0)) > 0.4 * graph.shape[0]
    assert graph[side < 0][:, side > 0].nnz == 0


def test_the_least_cut_of_all():
    rng = np.random.default_rng(3)
    for _ in range(6):
        side = np.r_[-1, np.zeros(9, dtype=int), 1]
        edges = np.triu(rng.random((11, 11)) < 0.35, 1)
        edges[0, -1] = False  # or no cut parts the sides
        graph = sp.csr_matrix(edges + edges.T + np.eye(11))
        weights = rng.integers(1, 4, 11)

        def parts(some, graph=graph):
            left = np.setdiff1d(np.arange(11), some)
            label = scipy.sparse.csgraph.connected_components(graph[left][:, left])[1]
            return label[0] != label[-1]

        sets = (np.flatnonzero(number >> np.arange(11) & 1) for number in range(0, 1 << 10, 2))  # without the ends
        least = min(weights[some].sum() for some in sets if parts(some))
        found = least_cut(graph, side, weights)
        on = np.flatnonzero(found == 0)
        assert weights[on].sum() == least
        assert graph[found < 0][:, found > 0].nnz == 0
        assert (found[[0, -1]] == (-1, 1)).all()


def test_a_part_that_cannot_be_cut_is_said():
    assert cut(sp.csr_matrix(np.ones((2000, 2000)))) is None


def test_the_dofs_of_a_node_stay_together():
    springs = abs(grid(30, 30))
    graph, node = node_graph(sp.csr_matrix(sp.kron(springs, np.ones((3, 3)))))
    numbers = node.reshape(-1, 3)
    assert (numbers == numbers[:, :1]).all()
    assert ((graph[numbers[:, 0]][:, numbers[:, 0]] > 0) != (springs > 0)).nnz == 0


def test_factors_of_a_solid_body_fill_less_than_by_minimum_degree():
    cube = ep.fe_model(box(0.02, 0.02, 0.02), ep.STEEL, maxh=3e-3)
    matrix = cube.stiffness + 1e10 * cube.mass
    options = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    by_degree = scipy.sparse.linalg.splu(sp.csc_matrix(matrix), permc_spec="MMD_AT_PLUS_A", **options)
    assert Factorisation(matrix).nnz < 0.85 / 2 * by_degree.nnz  # which has two triangles
