"""Unit loads of patches and interfaces: their resultants, and where they act."""

import numpy as np
from oracles import TOP

import exudyn_partition as ep
from exudyn_partition.reduction.loads import pressure


def test_a_patch_of_quadrilaterals_ends_at_its_rim_and_carries_a_uniform_pressure(bricks):
    (top,) = ep.Partition.ball(bricks, TOP, 0.1, contact_radius=5e-3).patches
    facets_at = np.bincount(top.facets.ravel(), minlength=bricks.n_nodes)
    face = bricks.facets[(bricks.points[bricks.facets, 2] > TOP[2] - 1e-9).all(axis=1)]
    all_at = np.bincount(face.ravel(), minlength=bricks.n_nodes)
    np.testing.assert_array_equal(top.rim, np.flatnonzero((facets_at > 0) & (facets_at < all_at)))
    load = pressure(bricks, top).reshape(-1, 3)
    np.testing.assert_allclose(load, np.outer(facets_at / (4 * len(top.facets)), top.direction), atol=1e-15)
