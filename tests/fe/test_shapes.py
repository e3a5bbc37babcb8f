"""Shape functions of facets and elements."""

import numpy as np
import pytest

from exudyn_partition.fe.shapes import FACET_NODES, TET_NODES, curvature, shape_functions, tetrahedron_functions


@pytest.mark.parametrize("n_nodes", [3, 6, 10, 4])
def test_shape_functions_reproduce_positions_and_their_derivatives(n_nodes):
    local = np.random.default_rng(0).random((20, 2)) / 2
    values, *derivatives = shape_functions(local, n_nodes).swapaxes(0, 1)
    np.testing.assert_allclose(values.sum(axis=1), 1, atol=1e-14)
    np.testing.assert_allclose(values @ FACET_NODES[n_nodes], local, atol=1e-14)
    np.testing.assert_allclose(shape_functions(FACET_NODES[n_nodes], n_nodes)[:, 0], np.eye(n_nodes), atol=1e-14)
    for i, h in enumerate(1e-6 * np.eye(2)):
        slope = (shape_functions(local + h, n_nodes)[:, 0] - shape_functions(local - h, n_nodes)[:, 0]) / 2e-6
        np.testing.assert_allclose(derivatives[i], slope, atol=1e-9)


@pytest.mark.parametrize("n_nodes", [6, 10, 4])
def test_curvature_is_the_slope_of_the_slopes(n_nodes):
    rng, h = np.random.default_rng(1), 1e-6
    local, arms = rng.random((20, 2)) / 2, rng.normal(size=(20, n_nodes))

    def slopes(local):
        return np.einsum("kin,kn->ik", shape_functions(local, n_nodes)[:, 1:], arms)

    by_r, by_s = ((slopes(local + step) - slopes(local - step)) / (2 * h) for step in h * np.eye(2))
    np.testing.assert_allclose(curvature(local, arms), [by_r[0], by_r[1], by_s[1]], atol=1e-7)


@pytest.mark.parametrize("n_nodes", [4, 10, 20])
def test_functions_of_tetrahedra_are_one_at_their_node_and_their_derivatives_are_slopes(n_nodes):
    np.testing.assert_allclose(tetrahedron_functions(TET_NODES[n_nodes], n_nodes)[0], np.eye(n_nodes), atol=1e-14)
    local = np.random.default_rng(2).dirichlet(np.ones(4), 10)[:, 1:]
    values, derivatives = tetrahedron_functions(local, n_nodes)
    np.testing.assert_allclose(values @ TET_NODES[n_nodes], local, atol=1e-14)
    for i, h in enumerate(1e-6 * np.eye(3)):
        slope = (tetrahedron_functions(local + h, n_nodes)[0] - tetrahedron_functions(local - h, n_nodes)[0]) / 2e-6
        np.testing.assert_allclose(derivatives[:, :, i], slope, atol=1e-8)
