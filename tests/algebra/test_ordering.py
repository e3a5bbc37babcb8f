"""Nested dissection: an order of all rows, cuts that separate, and factors that fill less."""

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg
from oracles import box

import exudyn_partition as ep
from exudyn_partition.algebra.sparse.multifrontal import Factorisation
from exudyn_partition.algebra.sparse.ordering import cut, nested_dissection, node_graph


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
