"""Unit loads of patches and interfaces: their resultants, and where they act."""

import numpy as np
from oracles import TOP

import exudyn_partition as ep
from exudyn_partition.reduction.loads import pressure, resultants, unit_loads


def test_a_patch_of_quadrilaterals_ends_at_its_rim_and_carries_a_uniform_pressure(bricks):
    (top,) = ep.Partition.ball(bricks, TOP, 0.1, contact_radius=5e-3).patches
    facets_at = np.bincount(top.facets.ravel(), minlength=bricks.n_nodes)
    face = bricks.facets[(bricks.points[bricks.facets, 2] > TOP[2] - 1e-9).all(axis=1)]
    all_at = np.bincount(face.ravel(), minlength=bricks.n_nodes)
    np.testing.assert_array_equal(top.rim, np.flatnonzero((facets_at > 0) & (facets_at < all_at)))
    load = pressure(bricks, top).reshape(-1, 3)
    np.testing.assert_allclose(load, np.outer(facets_at / (4 * len(top.facets)), top.direction), atol=1e-15)


def test_interfaces_and_patches_follow_a_rigid_motion(link, arm):
    """By the work of unit loads on it: an interface moves and turns with the body, a patch by its normal part."""
    side = ep.Partition.ball(link, (0.005, 0, 0.03), 5e-3)
    partition, motion = side | arm[1], np.array([1.0, -2, 3, 0.1, 0.2, -0.3])
    u = np.cross(motion[3:], link.points) + motion[:3]
    answers = unit_loads(link, partition) @ u.ravel()
    on_patch, on_ends = np.split(answers, [len(partition.patch_nodes)])
    normal = partition.patches[0].direction
    np.testing.assert_allclose(on_patch, u[partition.patches[0].nodes] @ normal, rtol=1e-12)
    for interface, found in zip(partition.interfaces, on_ends.reshape(-1, 6), strict=True):
        place = np.cross(motion[3:], interface.position) + motion[:3]
        np.testing.assert_allclose(found, np.r_[place, motion[3:]], rtol=1e-9)


def test_combined_loads_have_unit_resultants(link, arm):
    """A uniform traction on a patch pushes with 1 N along its direction, wherever its nodes lie."""
    side = ep.Partition.ball(link, (0.005, 0, 0.03), 5e-3)
    loads = resultants(link, side | arm[1]).T @ unit_loads(link, side | arm[1]).toarray()
    total = loads.reshape(len(loads), -1, 3).sum(axis=1)
    np.testing.assert_allclose(total[0], side.patches[0].direction, atol=1e-12)
    expected = np.vstack([np.eye(6)[:, :3]] * 2)  # moments have no resultant force
    np.testing.assert_allclose(total[1:], expected, atol=1e-9)
    np.testing.assert_allclose(loads[0], pressure(link, side.patches[0]), atol=1e-15)


def test_a_patch_with_all_axes_is_pushed_along_them_and_twisted_about_its_direction(link):
    """The twist has no force, and a moment of 1 N m about the direction through the middle; so anywhere."""
    side = ep.Partition.ball(link, (0.005, 0, 0.03), 5e-3, axes="xyz")
    loads = (resultants(link, side).T @ unit_loads(link, side).toarray()).reshape(4, -1, 3)
    np.testing.assert_allclose(loads.sum(axis=1), np.eye(4)[:, :3], atol=1e-9)
    moment = np.cross(link.points, loads[3]).sum(axis=0)
    np.testing.assert_allclose(side.patches[0].direction @ moment, 1.0, rtol=1e-9)


def test_a_body_that_friction_can_twist_keeps_its_torsion(bricks):
    """The mesh is symmetric, so that no force on the middle of its top excites the modes of torsion; a twist does."""
    top = ep.Partition.ball(bricks, TOP, 5e-3, axes="xyz")
    modes = ep.reduce(bricks, top, f_cut=80e3, basis="residual").basis
    loads = resultants(bricks, top).T @ (unit_loads(bricks, top) @ modes.shapes[:, 6:])
    force, twist = np.linalg.norm(loads[:3], axis=0), abs(loads[3])
    torsion = modes.omega[6:][(force < 1e-6 * force.max()) & (twist > 0.1 * twist.max())]
    assert len(torsion) == 2
    adapted = ep.reduce(bricks, top, f_cut=80e3).basis.omega
    np.testing.assert_allclose([adapted[abs(adapted - omega).argmin()] for omega in torsion], torsion, rtol=1e-6)
