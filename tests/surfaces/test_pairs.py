"""Pairs that move: points are followed over the facets of the other surface."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from exudyn_partition.surfaces.facing import EDGE_TOLERANCE, closest_met, opposite
from exudyn_partition.surfaces.pairs import MovingPairs
from exudyn_partition.surfaces.points import ContactPoints
from exudyn_partition.surfaces.surface import Surface, closest_points


def single_points(n):
    """Contact points that are the slave's nodes themselves."""
    one = sp.identity(n, format="csr")
    return ContactPoints(np.arange(n)[:, None], np.ones((n, 1)), one, np.arange(n), np.ones(n), one)


def sharp_corner():
    """The lower face of a body, at z = 0, which ends at x = 0 in a wall."""
    x = np.array([[-1, 0, 0], [-1, 1, 0], [0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1]], dtype=float)
    facets = np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
    direction, rim, sharp = np.array([0.0, 0.0, -1.0]), np.empty(0, dtype=int), np.array([2, 3])
    return Surface(x, facets, direction, rim, np.arange(6), wanders=True, sharp=sharp)


@pytest.mark.usefixtures("each_path")
@pytest.mark.parametrize("quadratic", [True, False])
def test_points_that_are_followed_over_facets_are_on_the_closest(round_body, flat_body, quadratic):
    surface = round_body.surface(np.zeros(3))
    facets = surface.facets if quadratic else surface.facets[:, :3]
    surface = replace(surface, facets=facets)
    neighbour, edge = surface.neighbours
    inner = neighbour >= 0
    mine = np.nonzero(inner)
    np.testing.assert_array_equal(neighbour[neighbour[inner], edge[inner]], mine[0])
    np.testing.assert_array_equal(edge[neighbour[inner], edge[inner]], mine[1])
    rng = np.random.default_rng(1)
    x = np.c_[rng.uniform(-0.3e-3, 0.3e-3, (40, 2)), np.full(40, -5e-6)]
    found = closest_points(x, surface.points[facets])
    pairs, alone = MovingPairs(surface, found.facet, found.local), single_points(40)
    places = surface.points.copy()  # as in runs: loops would be compiled again for arrays that are read-only
    start = pairs.facet.copy()
    for _ in range(50):
        x = x + np.array([4e-6, 2e-6, 0.0])
        normal, gap = pairs.follow(alone, np.arange(40), x, places)
        assert (gap < pairs.size).all()
        found = closest_points(x, surface.points[facets])
        same = pairs.facet == found.facet  # points on an edge may belong to either facet
        np.testing.assert_allclose(gap, found.gap, rtol=1e-4)
        np.testing.assert_allclose(gap[same], found.gap[same], rtol=1e-10)
        np.testing.assert_allclose(normal[same], found.normal[same], rtol=0, atol=1e-9)  # whatever the way there
    assert (pairs.facet != start).mean() > 0.5


@pytest.mark.usefixtures("each_path")
def test_points_on_an_edge_stay_on_their_facets(round_body):
    """Normals differ a little on both sides. Where points changed sides each time, Newton's method did not settle."""
    surface = round_body.surface(np.zeros(3))
    facet, edge = np.nonzero(surface.neighbours[0] >= 0)
    on_edge = surface.points[surface.facets[facet, 3 + edge]]
    x = on_edge + 1e-6 * closest_points(on_edge, surface.points[surface.facets]).normal
    found = closest_points(x, surface.points[surface.facets])
    pairs, alone, places = MovingPairs(surface, found.facet, found.local), single_points(len(x)), surface.points.copy()
    for _ in range(2):
        pairs.follow(alone, np.arange(len(x)), x, places)
    settled = pairs.facet.copy()
    pairs.follow(alone, np.arange(len(x)), x, places)
    np.testing.assert_array_equal(pairs.facet, settled)


@pytest.mark.usefixtures("each_path")
@pytest.mark.parametrize("quadratic", [True, False])
@pytest.mark.parametrize("height", [-2e-5, -1e-6, 0.0, 1e-6, 2e-5])
def test_points_have_the_same_facets_wherever_they_come_from(round_body, quadratic, height):
    """On nodes and edges, and beside them. The way there decided, by which normals differ by the angle at the edge."""
    surface = round_body.surface(np.zeros(3))
    surface = replace(surface, facets=surface.facets if quadratic else surface.facets[:, :3])
    nodes = np.setdiff1d(surface.facets, surface.rim)
    normals = surface.normals_at(nodes[:, None], np.ones((len(nodes), 1)))
    rng, size = np.random.default_rng(4), surface.facet_size
    beside = np.where(np.arange(len(nodes)) % 3, 0.0, 3e-7 * size)[:, None] * rng.normal(size=normals.shape)
    x, places = surface.points[nodes] + height * normals + beside, surface.points.copy()
    alone, index = single_points(len(x)), np.arange(len(x))

    def followed(*ways):
        found = closest_points(x + ways[0], surface.points[surface.facets])
        pairs = MovingPairs(surface, found.facet, found.local)
        for way in ways:
            normal, gap = pairs.follow(alone, index, x + way, places)
        return pairs.facet, normal, gap

    expected = followed(0.0 * x)
    for _ in range(4):
        aside = rng.normal(size=x.shape)
        aside *= 0.1 * size / np.linalg.norm(aside, axis=1)[:, None]
        facet, normal, gap = followed(*(share * aside for share in (1.0, 0.4, 1e-5, 1e-6, 0.0)))
        np.testing.assert_array_equal(facet, expected[0])
        np.testing.assert_allclose(normal, expected[1], rtol=0, atol=1e-9)
        np.testing.assert_allclose(gap, expected[2], rtol=0, atol=1e-12 * size)


@pytest.mark.usefixtures("each_path")
def test_points_a_little_past_the_edge_have_the_same_carriers_when_searched_and_when_followed(flat_body):
    """Those around the point itself, not around the nearest place of the patch, which would turn forces aside."""
    surface = flat_body.surface(np.zeros(3))
    facet, edge = np.nonzero(surface.neighbours[0] < 0)
    ends = surface.points[surface.facets[facet[:, None], np.c_[edge, (edge + 1) % 3]]]
    middle, centre = ends.mean(axis=1), surface.points[surface.facets[facet, :3]].mean(axis=1)
    outwards = middle - centre
    x = middle + 0.3 * EDGE_TOLERANCE * surface.facet_size * outwards / np.linalg.norm(outwards, axis=1)[:, None]
    found = closest_points(x, surface.points[surface.facets])
    pairs, alone, places = MovingPairs(surface, found.facet, found.local), single_points(len(x)), surface.points.copy()
    for _ in range(3):  # the first time all are searched
        gap = pairs.follow(alone, np.arange(len(x)), x, places)[1]
        nodes, weights = pairs.carriers
        on_patch = np.einsum("kn,kni->ki", weights, surface.points[nodes])
        np.testing.assert_allclose(on_patch, x, atol=1e-6 * surface.facet_size)
        np.testing.assert_allclose(gap, 0.0, atol=1e-9 * surface.facet_size)


@pytest.mark.usefixtures("each_path")
@pytest.mark.parametrize("quadratic", [True, False])
def test_points_past_the_end_of_a_patch_have_the_same_facets_wherever_they_come_from(round_body, quadratic):
    """They slide out and along the end. They stayed on the facet by which they left, as long as none was searched."""
    surface = round_body.surface(np.zeros(3))
    surface = replace(surface, facets=surface.facets if quadratic else surface.facets[:, :3])
    facet, edge = np.nonzero(surface.neighbours[0] < 0)
    ends, size, rng = surface.points[surface.facets[facet, edge]], surface.facet_size, np.random.default_rng(3)
    x, places = np.repeat(0.95 * ends + [0.0, 0.0, -2e-5], 4, axis=0), surface.points.copy()
    ways = size * rng.normal(size=x.shape) * [1.0, 1.0, 0.05]
    ways *= (0.4 / np.linalg.norm(ways, axis=1) * size)[:, None]
    alone, index = single_points(len(x)), np.arange(len(x))

    def begun(x):
        found = closest_points(x, surface.points[surface.facets])
        pairs = MovingPairs(surface, found.facet, found.local)
        pairs.follow(alone, index, x, places)
        return pairs

    pairs = begun(x)
    for share in np.linspace(0.05, 1.0, 20):
        there = x + share * ways
        normal, gap = pairs.follow(alone, index, there, places)
        right, expected = begun(there).follow(alone, index, there, places)
        np.testing.assert_allclose(gap, expected, rtol=0, atol=1e-9 * size)
        np.testing.assert_allclose(normal, right, rtol=0, atol=1e-8)
    assert (pairs.facet != begun(x).facet).mean() > 0.2


@pytest.mark.usefixtures("each_path")
def test_points_do_not_cross_a_sharp_edge_because_they_moved_far_before():
    """The corner below. A point within the body, whose last way leads past the corner, was one of the wall."""
    surface, up = sharp_corner(), np.array([0.0, 0.0, 1.0])
    depth, alone, places = 0.05, single_points(1), surface.points.copy()
    found = closest_met(np.array([[-0.8, 0.9, depth]]), up, surface)
    pairs = MovingPairs(surface, found.facet, found.local)
    for x in (-0.8, -0.15, -0.1):
        place = np.array([[x, 0.9, depth]])

        def meet(points, place=place):
            met = closest_met(place, up, surface)
            return met, opposite(met.normal, up), place, places

        normal, seen = pairs.follow(alone, np.arange(1), place, places, meet)
        np.testing.assert_allclose(normal, [surface.direction], atol=1e-12)
        np.testing.assert_allclose(seen, -depth, rtol=1e-9)


@pytest.mark.usefixtures("each_path")
@pytest.mark.parametrize("past_the_end", [1e-6, 1e-4])
def test_points_beside_a_sharp_corner_stay_with_the_face_that_they_met(past_the_end):
    """The lower face of a body, at z = 0, ends in a wall at x = 0, which looks the way of the point's own wall.

    The point lies under the corner, flush with that wall and with the end of the patch. It slides a little past both,
    then back under the body. There it was still a point of the wall, with a negative gap though nothing touches.
    """
    surface = sharp_corner()
    gap, aside = 1e-3, 1e-5
    up, alone, places = np.array([0.6, 0.0, 0.8]), single_points(1), surface.points.copy()
    found = closest_met(np.array([[0.0, 0.0, -gap]]), up, surface)
    pairs = MovingPairs(surface, found.facet, found.local)
    for way in (aside, aside, -aside, -10 * aside):
        place = np.array([[way, -past_the_end, -gap]])

        def meet(points, place=place):
            met = closest_met(place, up, surface)
            return met, opposite(met.normal, up), place, places

        normal, seen = pairs.follow(alone, np.arange(1), place, places, meet)
        np.testing.assert_allclose(normal, [surface.direction], atol=1e-12)
        np.testing.assert_allclose(seen, gap, rtol=1e-9)
