"""Surfaces, gap rows, complementarity and the contact laws."""

import re
from dataclasses import replace

import numpy as np
import pytest
from oracles import SPHERE_RADIUS, TOP, hexahedra, relative, write

import exudyn_partition as ep
from exudyn_partition.contact.side import Side
from exudyn_partition.errors import (
    EmptyRegionError,
    PenetrationError,
)
from exudyn_partition.frames.inertial import InertialKinematics
from exudyn_partition.surfaces.rows import pair_surfaces
from exudyn_partition.surfaces.surface import Surface


@pytest.fixture(scope="module")
def surfaces(sphere, other_sphere):
    fem, partition = sphere
    other, other_partition = other_sphere
    return Surface.of(fem.points, partition.patches[0], np.zeros(3)), Surface.of(
        other.points, other_partition.patches[0], np.zeros(3)
    )


def test_action_is_reaction_and_rigid_motion_opens_the_gap(surfaces):
    slave, master = surfaces
    rows = pair_surfaces(slave, master)
    G_s, G_m = rows.matrices(len(slave.points), len(master.points))
    push = np.random.default_rng(0).random(len(rows))
    forces = [(G.T @ push).reshape(-1, 3) for G in (G_s, G_m)]
    np.testing.assert_allclose(forces[0].sum(axis=0), -forces[1].sum(axis=0), atol=1e-12)
    np.testing.assert_allclose(G_s @ np.tile([0, 0, 1.0], len(slave.points)), rows.normal[:, 2], atol=1e-12)
    # Lifted by 3 um, the reference gaps of the same pairs are that much larger along their normals.
    lifted = pair_surfaces(replace(slave, points=slave.points + np.array([0, 0, 3e-6])), master)
    assert relative(lifted.gap, rows.gap + 3e-6 * rows.normal[:, 2]) < 1e-3


def test_gap_between_two_spheres(surfaces):
    rows = pair_surfaces(*surfaces, "node-to-segment")
    r = np.linalg.norm(surfaces[0].points[rows.points.row_nodes, :2], axis=1)
    np.testing.assert_allclose(rows.gap, r**2 / 0.01, atol=1e-7)


@pytest.mark.parametrize("ball_is_slave", [True, False])
def test_pairs_do_not_depend_on_the_way_to_go(bodies, ball_is_slave):
    """From 0.2 m above: the flat patch gives the line, the ball's own normal is off by its mesh."""
    target = bodies[1].surface(np.zeros(3))
    touching, apart = (bodies[0].surface(np.add(TOP, [0, 0, height])) for height in (0.0, 0.2))
    pairs = [(ball, target) if ball_is_slave else (target, ball) for ball in (touching, apart)]
    near, far = (pair_surfaces(*both) for both in pairs)
    np.testing.assert_array_equal(near.points.row_nodes, far.points.row_nodes)
    sizes = [len(surface.points) for surface in pairs[0]]
    for ours, theirs in zip(far.interpolation(*sizes), near.interpolation(*sizes), strict=True):
        np.testing.assert_allclose(ours.toarray(), theirs.toarray(), atol=2e-3)
    np.testing.assert_allclose(far.gap, near.gap + 0.2 * abs(far.normal[:, 2]), atol=1e-7)


def test_a_direction_that_is_given_leads(sphere, other_sphere):
    """Two spheres ten metres apart: along the mesh's own mean normals they would miss each other."""
    (fem, part), (other, other_part) = sphere, other_sphere
    given = ep.Partition.ball(fem, (0, 0, 0), 0.45e-3, direction=[0, 0, -1])
    master = Surface.of(other.points, other_part.patches[0], np.zeros(3))
    touching = pair_surfaces(Surface.of(fem.points, given.patches[0], np.zeros(3)), master)
    apart = pair_surfaces(Surface.of(fem.points, given.patches[0], np.array([0, 0, 10.0])), master)
    np.testing.assert_array_equal(touching.points.row_nodes, apart.points.row_nodes)
    np.testing.assert_allclose(apart.gap, touching.gap + 10 * abs(touching.normal[:, 2]), rtol=1e-6)
    with pytest.raises(EmptyRegionError):
        pair_surfaces(Surface.of(fem.points, part.patches[0], np.array([0, 0, 10.0])), master)


def test_penetration_at_the_start(surfaces):
    slave, master = surfaces
    pushed = replace(slave, points=slave.points - [0, 0, 1e-4])
    with pytest.raises(
        PenetrationError, match=r"start inside the other body, the worst by .* Move the slave by"
    ) as caught:
        pair_surfaces(pushed, master)
    way = np.array(re.search(r"along \[(.*?)\]", str(caught.value))[1].split(), dtype=float)
    pair_surfaces(replace(pushed, points=pushed.points + 1.01e-4 * way), master)  # as it says


def test_patches_that_do_not_face_each_other(surfaces):
    slave, master = surfaces
    with pytest.raises(EmptyRegionError, match=r"none of the .* contact points of the slave faces a facet"):
        pair_surfaces(replace(slave, points=slave.points + np.array([0.05, 0, 0])), master)
    with pytest.raises(EmptyRegionError, match="outward normals"):
        pair_surfaces(replace(slave, direction=-slave.direction), master)


def sides(bodies, slave_at=TOP):
    """Patches of two bodies, the first shifted."""
    return [
        Side.of(InertialKinematics(body, np.array(at))) for body, at in zip(bodies, (slave_at, (0, 0, 0)), strict=True)
    ]


@pytest.mark.parametrize("hexahedra_are_slave", [True, False])
def test_rows_between_hexahedra_and_a_sphere(ball, tmp_path, hexahedra_are_slave):
    bricks = ep.fe_model(write(tmp_path / "flat.vtu", *hexahedra(24, 48, 2)), ep.STEEL)
    top = ep.Partition.ball(bricks, TOP, 2e-3)
    assert top.patches[0].facets.shape[1] == 4
    np.testing.assert_allclose(top.patches[0].direction, [0, 0, 1], atol=1e-12)
    plate, tip = (
        Surface.of(bricks.points, top.patches[0], np.zeros(3)),
        Surface.of(ball[0].points, ball[1].patches[0], np.array(TOP)),
    )
    slave, master = (plate, tip) if hexahedra_are_slave else (tip, plate)
    rows = pair_surfaces(slave, master, "node-to-segment")
    r = np.linalg.norm(slave.points[rows.points.row_nodes, :2], axis=1)
    feet = np.einsum("ck,ckd->cd", rows.weights, master.points[rows.master])
    np.testing.assert_allclose(feet, slave.points[rows.points.row_nodes] - rows.gap[:, None] * rows.normal, atol=2e-6)
    if hexahedra_are_slave:
        np.testing.assert_allclose(rows.gap, np.hypot(r, SPHERE_RADIUS) - SPHERE_RADIUS, atol=2e-6)
        assert rows.unpaired  # the plate's patch is the wider one, so rows end where the tip's facets do
        assert np.isfinite(rows.leaves_at[r > 1.1e-3]).all()
    else:
        np.testing.assert_allclose(rows.gap, tip.points[rows.points.row_nodes, 2] - TOP[2], atol=1e-15)
        assert not rows.unpaired
    assert not np.isfinite(rows.leaves_at[r < 0.5e-3]).any()
    np.testing.assert_allclose(rows.weights.sum(axis=1), 1, atol=1e-14)
    push = np.random.default_rng(0).random(len(rows))
    matrices = rows.matrices(len(slave.points), len(master.points))
    on_slave, on_master = ((G.T @ push).reshape(-1, 3).sum(axis=0) for G in matrices)
    np.testing.assert_allclose(on_slave, -on_master, atol=1e-12)


FINE, SIZE = 9, 0.1e-3  # nodes along a side of the wide grid, and their distance [m]


def grid(n, radius, sign):
    """Surface over n x n nodes of a square grid about the origin, z = sign r^2 / (2 |radius|), that looks along z."""
    x = SIZE * (np.arange(n) - (n - 1) / 2)
    points = np.array([(a, b, sign * (a * a + b * b) / (2 * radius)) for a in x for b in x])
    number = np.arange(n * n).reshape(n, n)
    facets = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    rim = np.unique(np.r_[number[[0, -1]].ravel(), number[:, [0, -1]].ravel()])
    return Surface(points, facets, np.array([0, 0, 1.0]), rim, np.arange(n * n))


@pytest.mark.parametrize("kind", ["node-to-segment", "integrated"])
@pytest.mark.parametrize("hollow", [False, True])
def test_contact_leaves_a_patch_when_the_points_beside_it_touch(kind, hollow):
    """A ball on a narrow patch of another ball, or of a socket that hardly is wider: by the surfaces' own formulas."""
    radius, other = 5e-3, 6e-3 if hollow else np.inf
    turned = grid(FINE, radius, -1)
    slave = replace(
        turned, points=turned.points * [1, 1, -1], facets=turned.facets[:, ::-1], direction=np.array([0, 0, -1.0])
    )
    master = grid(5, other, 1)
    rows = pair_surfaces(slave, master, kind)

    def apart(points):
        return (points[:, :2] ** 2).sum(axis=1) / 2 * (1 / radius - 1 / other)

    places = slave.points[rows.points.row_nodes]
    half = 2 * SIZE  # of the master's patch
    assert np.isfinite(rows.leaves_at[abs(places[:, :2]).max(axis=1) > 0.99 * half]).all()
    assert not np.isfinite(rows.leaves_at[abs(places[:, :2]).max(axis=1) < 0.99 * SIZE]).any()
    told = (rows.gap + rows.leaves_at).min()  # approach of the bodies at which the first row says so
    at_rim, beyond = apart(np.array([[half, 0, 0], [1.5 * half, 0, 0]]))  # the first nodes beyond
    assert (0.7 if hollow else 1.0) * at_rim < told < 1.0001 * beyond
    if kind == "node-to-segment" and not hollow:
        assert told == pytest.approx(beyond)
