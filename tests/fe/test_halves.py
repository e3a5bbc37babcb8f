"""Facets that are triangles or halves of quadrilaterals have the functions of the facets that they are of."""

import numpy as np
import pytest

from exudyn_partition.fe.facets import NODAL_SHARES
from exudyn_partition.fe.halves import in_halves, in_square, whole_facets
from exudyn_partition.fe.quadrature import RULES, facet_forces, facet_integration
from exudyn_partition.fe.shapes import FACET_NODES, shape_functions

# A quadrilateral and a triangle beside it, with nodes on edges or without; the triangle among quadrilaterals.
TRIANGLES = {4: [1, 4, 2, 2], 8: [1, 8, 2, 2, 9, 10, 2, 5]}


def pair(n, bend=0.0):
    square = FACET_NODES[n]
    beside = [[1.8, 0.6]] if n == 4 else [[1.8, 0.6], [1.4, 0.3], [1.4, 0.8]]
    flat = np.vstack([square, beside])
    points = np.column_stack([flat, bend * np.sin(3 * flat[:, 0] + flat[:, 1])])
    return points, np.array([np.arange(n), TRIANGLES[n]])


@pytest.mark.parametrize("n", [4, 8])
def test_functions_are_those_of_the_whole_facets(n):
    points, facets = pair(n, bend=0.2)
    triangle, half, other = in_halves(facets)
    local = np.random.default_rng(0).dirichlet([1, 1, 1], 20)[:, 1:]
    places = shape_functions(local, len(half))
    nodes = points[facets[1][[0, 1, 2] if n == 4 else [0, 1, 2, 4, 5, 7]]]
    np.testing.assert_allclose(places @ points[triangle], shape_functions(local, len(nodes)) @ nodes, atol=1e-14)
    for own, there in ((half, in_square(local)), (other, 1 - in_square(local))):
        expected = shape_functions(there, n)[:, 0] @ points[facets[0]]
        np.testing.assert_allclose((places @ points[own])[:, 0], expected, atol=1e-14)
        h = 1e-6
        for axis, by in enumerate(np.eye(2) * h):
            slope = [(shape_functions(local + step, len(half))[:, 0] @ points[own]) for step in (by, -by)]
            np.testing.assert_allclose((places @ points[own])[:, 1 + axis], (slope[0] - slope[1]) / 2 / h, atol=1e-9)
    np.testing.assert_allclose(places[:, 0] @ FACET_NODES[len(half)], local, atol=1e-14)
    triangles, quads = whole_facets(in_halves(facets))
    assert {*quads[0]} == {*quads[1]} == {*facets[0]}
    assert {*triangles[0]} == {*facets[1]}


@pytest.mark.parametrize("n", [4, 8])
def test_hats_cover_the_facets_and_a_uniform_pressure_makes_the_exact_forces(n):
    points, facets = pair(n)
    halves = in_halves(facets)
    shape, area = facet_integration(points, halves)
    forces, shares, hats = np.zeros((3, len(points)))
    np.add.at(forces, halves, area @ shape)
    np.add.at(shares, halves, np.outer(area.sum(axis=1), NODAL_SHARES[halves.shape[1]]))
    expected = np.zeros((len(points), 3))
    np.add.at(expected, facets, -facet_forces(points, facets, None))
    np.testing.assert_allclose(forces, expected[:, 2], atol=1e-14)
    each = RULES[halves.shape[1]][2]
    for facet, own in zip(halves, area, strict=True):
        of_nodes = np.zeros((len(each), len(points)))
        np.add.at(of_nodes.T, facet, each.T)
        assert of_nodes.min() > -1e-15
        assert np.count_nonzero(abs(of_nodes) > 1e-15, axis=1).max() <= 4
        hats += own @ of_nodes
    np.testing.assert_allclose(hats.sum(), area.sum(), rtol=1e-15)
    if n == 4:  # of linear facets hats are the functions themselves
        np.testing.assert_allclose(hats, forces, atol=1e-14)
        np.testing.assert_allclose(shares, forces, atol=1e-14)
    else:
        np.testing.assert_allclose(shares[:4], [1 / 24] * 4, atol=1e-14)  # corners of triangles have none
