"""Which facets of a master points meet, beside sharp edges."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from exudyn_partition.fe.edges import sharp_nodes
from exudyn_partition.surfaces.facing import EDGE_TOLERANCE, closest_met, facing
from exudyn_partition.surfaces.surface import Surface

UP, OUTWARD = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def corner():
    """A block's top, z = 0, and its side, x = 0, with five facets along each edge: quadrilaterals of size 1."""
    along = np.arange(6.0)
    down, y = (grid.ravel() for grid in np.meshgrid(along[1:], along, indexing="ij"))
    points = np.vstack([np.c_[np.repeat(-along, 6), np.tile(along, 6), np.zeros(36)], np.c_[0 * y, y, -down]])
    first = (6 * np.arange(5)[:, None] + np.arange(5)).ravel()
    rows = np.vstack([np.arange(6), 36 + np.arange(30).reshape(5, 6)])
    side = np.stack([rows[:-1, :-1], rows[1:, :-1], rows[1:, 1:], rows[:-1, 1:]], axis=-1).reshape(-1, 4)
    facets = np.vstack([np.c_[first, first + 1, first + 7, first + 6], side])
    empty = np.empty(0, dtype=np.int64)
    return Surface(points, facets, UP, empty, np.arange(len(points)), wanders=True, sharp=sharp_nodes(points, facets))


HEIGHTS, PAST = (-1e-3, -1e-9, 0.0, 1e-9, 0.2), (-1e-3, -1e-12, 1e-12, 1e-9, 0.8 * EDGE_TOLERANCE)


@pytest.mark.parametrize(
    ("past", "height"), [(p, h) for p, h in itertools.product(PAST, HEIGHTS) if p < 1e-6 or h > -1e-4]
)
def test_a_point_just_past_a_sharp_edge_meets_the_face_that_faces_it(corner, past, height):
    """By round-off it is nearest to the face beside the edge; flush bodies lost these points."""
    places = np.c_[[past, past], [0.3, 2.7], [height, height]]
    for normals in (-UP, np.tile(-UP, (2, 1))):
        found = closest_met(places, normals, corner)
        assert facing(found, normals, corner.facet_size).all()
        np.testing.assert_allclose(found.normal, [UP, UP], atol=1e-12)
        np.testing.assert_allclose(found.gap, height, atol=1e-12)
    if height > 1e-6 and past < -1e-4:
        return
    turned = closest_met(places[:, [2, 1, 0]], -OUTWARD, corner)  # the same point of a body beside the block
    np.testing.assert_allclose(turned.normal, [OUTWARD, OUTWARD], atol=1e-12)
    np.testing.assert_allclose(turned.gap, height, atol=1e-12)


def test_points_beside_a_face_do_not_meet_the_one_above(corner):
    """Below the edge by more than the tolerance, or past it by more, a point that looks down meets nothing."""
    for past, height in ((1e-3, -0.5), (1e-3, -1e-3), (2 * EDGE_TOLERANCE, 1e-3), (2 * EDGE_TOLERANCE, 0.3)):
        found = closest_met(np.array([[past, 2.2, height]]), -UP, corner)
        assert not facing(found, -UP, corner.facet_size).any()


def test_points_of_several_faces_each_meet_their_own(corner):
    """Also where nobody says that the edge is sharp: the facet in front of a point counts."""
    places = np.array([[1e-10, 1.4, 1e-10], [1e-10, 1.4, 1e-10]])
    for master in (corner, replace(corner, sharp=corner.sharp[:0])):
        found = closest_met(places, np.array([-UP, -OUTWARD]), master)
        np.testing.assert_allclose(found.normal, [UP, OUTWARD], atol=1e-12)


def test_what_is_outside_beside_an_edge_is_not_inside_beneath_its_other_face(corner):
    """A plate below a block that stands on its edge: the face that hardly faces the plate is in front of the point."""
    leans = (0.447 * OUTWARD + 0.894 * UP) / np.hypot(0.447, 0.894)
    found = closest_met(np.array([[3e-3, 2.2, -6e-3]]), -leans, corner)
    np.testing.assert_allclose(found.normal, [OUTWARD], atol=1e-12)
    assert found.gap[0] == pytest.approx(3e-3)


@pytest.fixture(scope="module")
def walls():
    """Walls of quadrilaterals of size 1 that face each other in a slot from x = 0 to 0.3, and a back at x = -0.2."""
    along = np.arange(6.0)
    y, z = (grid.ravel() for grid in np.meshgrid(along, along, indexing="ij"))
    first = (6 * np.arange(5)[:, None] + np.arange(5)).ravel()
    sheet = np.c_[first, first + 6, first + 7, first + 1]  # looks along x
    points = np.vstack([np.c_[np.full(36, x), y, z] for x in (0.0, 0.3, -0.2)])
    facets = np.vstack([sheet, 36 + sheet[:, ::-1], 72 + sheet[:, ::-1]])
    empty = np.empty(0, dtype=np.int64)
    return Surface(points, facets, UP, empty, np.arange(len(points)), wanders=True)


@pytest.mark.parametrize("place", [0.02, 0.1, 0.16])
def test_both_sides_of_a_tongue_in_a_narrow_slot_meet_its_walls(walls, place):
    """A tongue of a third of the slot's width, wherever it is: one side is nearer to the wall at its back."""
    places = np.array([[place, 2.3, 2.6], [place + 0.1, 2.3, 2.6]])
    normals = np.array([-OUTWARD, OUTWARD])
    found = closest_met(places, normals, walls)
    assert facing(found, normals, walls.facet_size).all()
    np.testing.assert_allclose(found.normal, -normals, atol=1e-12)
    np.testing.assert_allclose(found.gap, [place, 0.2 - place], atol=1e-12)


def test_what_looks_away_from_a_plate_does_not_meet_its_far_side(walls):
    """A thin plate from x = -0.2 to 0, hit from both sides, by bodies with upper sides of their own."""
    for side, ahead in ((0.05, -OUTWARD), (-0.25, OUTWARD), (-0.05, -OUTWARD), (-0.15, OUTWARD)):
        found = closest_met(np.array([[side, 2.3, 2.6]]), ahead, walls)
        np.testing.assert_allclose(found.normal, [-ahead], atol=1e-12)
        assert found.gap[0] == pytest.approx(side if ahead[0] < 0 else -0.2 - side, abs=1e-12)
    away = closest_met(np.array([[-0.25, 2.3, 2.6]]), -OUTWARD, walls)  # a side that looks away from the plate
    assert not facing(away, -OUTWARD, walls.facet_size).any()
