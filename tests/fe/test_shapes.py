"""Shape functions of facets and elements."""

import numpy as np
import pytest
from oracles import dome

from exudyn_partition.fe.shapes import shape_functions


@pytest.mark.parametrize("n_nodes", [3, 6, 4])
def test_shape_functions_reproduce_positions_and_their_derivatives(n_nodes):
    local = np.random.default_rng(0).random((20, 2)) / 2
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) if n_nodes == 4 else dome(0.0)[:n_nodes]
    values, *derivatives = shape_functions(local, n_nodes).swapaxes(0, 1)
    np.testing.assert_allclose(values.sum(axis=1), 1, atol=1e-14)
    np.testing.assert_allclose((values @ nodes)[:, :2], local, atol=1e-14)
    for i, h in enumerate(1e-6 * np.eye(2)):
        slope = (shape_functions(local + h, n_nodes)[:, 0] - shape_functions(local - h, n_nodes)[:, 0]) / 2e-6
        np.testing.assert_allclose(derivatives[i], slope, atol=1e-9)
