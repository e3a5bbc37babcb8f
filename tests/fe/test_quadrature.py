"""Rules of integration over facets: what they integrate exactly, and the hat functions of the nodes."""

from math import factorial

import numpy as np
import pytest

from exudyn_partition.fe.facets import FLAT_TRIANGLES, NODAL_SHARES
from exudyn_partition.fe.quadrature import RULES
from exudyn_partition.fe.shapes import FACET_NODES, shape_functions


@pytest.mark.parametrize(("n_nodes", "degree"), [(3, 2), (6, 2), (10, 3)])
def test_triangles_are_integrated_to_the_degree_of_their_functions(n_nodes, degree):
    local, weight, hats = RULES[n_nodes]
    for i in range(degree + 1):
        for j in range(degree + 1 - i):
            exact = factorial(i) * factorial(j) / factorial(i + j + 2)
            assert weight @ (local[:, 0] ** i * local[:, 1] ** j) == pytest.approx(exact, rel=1e-13)
    assert weight.min() > 0
    # A uniform pressure on the points makes its consistent forces on the nodes.
    on_nodes = weight @ shape_functions(local, n_nodes)[:, 0] / weight.sum()
    np.testing.assert_allclose(on_nodes, NODAL_SHARES[n_nodes], atol=1e-13)
    # Hats are linear between the nodes, so they reproduce places.
    np.testing.assert_allclose(hats @ FACET_NODES[n_nodes], local, atol=1e-14)
    assert hats.min() >= 0


@pytest.mark.parametrize("n_nodes", [3, 6, 10])
def test_flat_triangles_cover_the_facet_and_keep_its_turn(n_nodes):
    nodes = FACET_NODES[n_nodes][FLAT_TRIANGLES[n_nodes]]
    area = np.linalg.det(np.diff(nodes, axis=1)) / 2
    np.testing.assert_allclose(area, 0.5 / len(area), atol=1e-14)
