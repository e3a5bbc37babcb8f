"""Impact regions and contact patches."""

from dataclasses import replace

import netgen.occ as occ
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import EmptyRegionError, InputError, UnitsWarning
from exudyn_partition.fe.model import mesh_fingerprint, same_mesh
from exudyn_partition.reference import FullBody


def test_ball_takes_the_nodes_within_it(block):
    partition = ep.Partition.ball(block, (0, 0, 0.03), 8e-3, contact_radius=5e-3)
    distance = np.linalg.norm(block.points - [0, 0, 0.03], axis=1)
    assert set(np.flatnonzero(distance <= 8e-3)) <= set(partition.nodes)
    assert set(partition.patch_nodes) <= set(partition.nodes)
    (patch,) = partition.patches
    centres = block.points[patch.facets[:, :3]].mean(axis=1)
    assert np.linalg.norm(centres - [0, 0, 0.03], axis=1).max() <= 5e-3
    np.testing.assert_allclose(patch.direction, [0, 0, 1], atol=1e-12)


def test_an_ellipsoid_is_a_ball_that_is_stretched_along_its_long_axis(block):
    """Region and patch: their nodes lie within the ball once ways along the axis are shortened by its stretch."""
    center, axis = np.array([0, 0, 0.03]), np.array([9e-3, 9e-3, 0]) / np.sqrt(2)
    long = ep.Partition.ball(block, center, 4.5e-3, contact_radius=4e-3, long_axis=axis)
    along = axis / 9e-3

    def away(points):
        ways = (points - center) @ along
        return np.hypot(ways / 2, np.linalg.norm(points - center - np.outer(ways, along), axis=1))

    (patch,) = long.patches
    centres = block.points[block.facets[:, :3]].mean(axis=1)
    within = (away(centres) <= 4e-3) & (centres[:, 2] > 0.03 - 1e-9)
    assert len(patch.facets) == np.count_nonzero(within)
    assert away(block.points[patch.facets[:, :3]].mean(axis=1)).max() <= 4e-3
    assert set(np.flatnonzero(away(block.points) <= 4.5e-3)) <= set(long.nodes)
    round_one = ep.Partition.ball(block, center, 9e-3)
    assert len(patch.facets) < len(round_one.patches[0].facets)
    same = ep.Partition.ball(block, center, 9e-3, long_axis=axis)  # as long as it is wide
    np.testing.assert_array_equal(same.nodes, round_one.nodes)
    with pytest.raises(InputError, match=r"long_axis: expected .* at least radius = 0\.0045 m, .*got 0\.001 m"):
        ep.Partition.ball(block, center, 4.5e-3, long_axis=(1e-3, 0, 0))
    with pytest.warns(UnitsWarning, match="long_axis: 9 m is"):
        ep.Partition.ball(block, center, 4.5e-3, long_axis=1e3 * axis)


def test_direction_can_be_given_within_the_patch_s_half_space(block):
    given = ep.Partition.ball(block, (0, 0, 0.03), 8e-3, direction=[0, 0.1, 2.0])
    np.testing.assert_allclose(given.patches[0].direction, np.array([0, 0.1, 2.0]) / np.hypot(0.1, 2.0))
    with pytest.raises(InputError, match="points out of the patch"):
        ep.Partition.ball(block, (0, 0, 0.03), 8e-3, direction=[0, 0, -1])


def test_region_outside_the_body(block):
    with pytest.raises(EmptyRegionError, match=r"no node lies within .* the nearest is .* Move the center"):
        ep.Partition.ball(block, (1, 1, 1), 1e-3)


def test_region_without_contact_nodes(block):
    with pytest.raises(EmptyRegionError, match="so nothing there can touch"):
        ep.Partition.ball(block, (0, 0, 0.015), 4.5e-3)


@pytest.mark.parametrize(
    ("center", "radius", "message"),
    [
        ((0, 0), 1e-3, r"center: expected shape \(3,\), got \(2,\)"),
        ((0, 0, np.nan), 1e-3, "center: expected finite numbers"),
        ("abc", 1e-3, "center: expected numbers"),
        ((0, 0, 0), 0.0, "radius: expected a finite number above zero in m, got 0.0"),
    ],
)
def test_bad_arguments(block, center, radius, message):
    with pytest.raises(InputError, match=message):
        ep.Partition.ball(block, center, radius)


def test_contact_radius_above_the_region(block):
    with pytest.raises(InputError, match="contact_radius: expected at most radius"):
        ep.Partition.ball(block, (0, 0, 0.03), 8e-3, contact_radius=9e-3)


@pytest.mark.parametrize("side", [1, -1])
def test_a_given_direction_finds_its_side_of_a_thin_sheet(side):
    """The nearest node may be on the other side; it used to lead, and the direction was refused."""
    sheet = occ.Box(occ.Pnt(-0.01, -0.01, -5e-5), occ.Pnt(0.01, 0.01, 5e-5))
    fem = ep.fe_model(sheet, ep.STEEL, maxh=4e-3, grading=0.9)
    other = fem.points[np.isclose(fem.points[:, 2], -side * 5e-5)]
    center = other[np.linalg.norm(other, axis=1).argmin()] * [1, 1, -0.9]
    patch = ep.Partition.ball(fem, center, 3e-3, direction=(0, 0, side)).patches[0]
    np.testing.assert_allclose(fem.points[patch.facets][:, :, 2], side * 5e-5)


def test_a_partition_knows_its_mesh_and_not_only_its_number_of_nodes(block, top):
    """Nodes at other places: patches of such a partition would lie at the wrong place."""
    again = ep.fe_model(box(0.01, 0.02, 0.03), ep.STEEL, maxh=5e-3)
    assert (top | ep.Partition.ball(again, (0, 0, 0), 4e-3)).n_nodes == block.n_nodes  # one mesh, made twice
    heights = (0.030001, 0.029999, 0.03001, 0.02999)  # each version of Netgen meshes some of them alike
    near = (ep.fe_model(box(0.01, 0.02, height), ep.STEEL, maxh=5e-3) for height in heights)
    stretched = next(fem for fem in near if fem.n_nodes == block.n_nodes)
    assert top.is_of(block)
    assert not top.is_of(stretched)
    for call in (lambda: ep.reduce(stretched, top, f_cut=8e4), lambda: FullBody(stretched, top)):
        with pytest.raises(InputError, match="partition: was made for another mesh with as many nodes"):
            call()
    with pytest.raises(InputError, match=r"both are of meshes with .* these differ"):
        top | ep.Partition.ball(stretched, (0, 0, 0), 4e-3)


def test_patches_go_along_with_a_mesh_that_is_moved_and_interfaces_do_not(block, top):
    moved = replace(block, points=block.points + 1e-3)
    assert top.is_of(moved)
    base = ep.Partition.interface(block, "base", np.flatnonzero(block.points[:, 2] < 1e-9))
    assert base.is_of(block)
    assert not base.is_of(moved)


def test_a_fingerprint_depends_on_places_order_and_facets_of_nodes(block):
    def differs(points, facets):
        return not same_mesh(block.fingerprint, mesh_fingerprint(points, facets))

    order = np.random.default_rng(0).permutation(block.n_nodes)
    assert differs(block.points[order], block.facets)
    assert differs(block.points, order[block.facets])
    assert differs(block.points + 1e-7 * (np.arange(block.n_nodes) == 99)[:, None], block.facets)
    assert not differs(block.points * (1 + 1e-15), block.facets[::-1])


def test_a_partition_is_printed_in_a_line(block):
    """Numbers, lengths and axes of its parts, no arrays."""
    part = ep.Partition.surface(block, [(-1, -1, 0.0299), (1, 1, 1)], name="land", axes="xyz")
    said = repr(part | ep.Partition.interface(block, "foot", np.flatnonzero(block.points[:, 2] < 1e-9)))
    patch = part.patches[0]
    assert f"Patch('land', a surface, {len(patch.nodes)} nodes, {len(patch.facets)} facets, 10 x 20 x 0 mm" in said
    assert "axes='xyz', outwards [0.0, 0.0, 1.0]" in said
    assert "Interface('foot', rigid, " in said
    assert "array" not in said


def test_balls_around_corners_and_edges_name_the_direction_to_give():
    bar = ep.fe_model(occ.Box((0, 0, 0), (0.04, 0.01, 0.01)), ep.STEEL, maxh=3.5e-3)
    said = []
    for center in ((0, 0, 0), (0.04, 0, 0), (0, 0.01, 0.01), (0, 0, 5e-3), (0.02, 0, 0)):
        for radius in np.arange(1e-3, 7e-3, 0.25e-3):
            try:
                partition = ep.Partition.ball(bar, center, radius)
                assert np.isfinite(partition.patches[0].direction).all()
            except EmptyRegionError as error:
                said.append(str(error))
    assert not any("nan" in text for text in said)
    assert any("faces meet at an edge or a corner. Give a direction=" in text for text in said)
