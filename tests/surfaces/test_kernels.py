"""Compiled loops over points and facets against NumPy."""

import numpy as np
import pytest
import scipy.sparse as sp
from oracles import each_way

from exudyn_partition.fe.halves import in_halves
from exudyn_partition.fe.shapes import FACET_NODES
from exudyn_partition.surfaces.holders import least_depth
from exudyn_partition.surfaces.loops import on_nodes
from exudyn_partition.surfaces.pairs import MovingPairs, follow
from exudyn_partition.surfaces.points import ContactPoints, contact_points
from exudyn_partition.surfaces.surface import Surface, closest_points

KINDS = [3, 4, 6, 10, 7, 13]  # nodes of a facet; the last two are of triangles and quadrilaterals
UP = np.array([0.0, 0.0, 1.0])


def saddle(n_nodes):
    """A curved square of 4 x 4 cells, two triangles or one quad each, or on one half these and those on the other."""
    facets, corners = [], [[0, 0], [1, 0], [1, 1], [0, 1]]
    n_of = {7: 4, 13: 8}.get(n_nodes, n_nodes)
    for cell in np.ndindex(4, 4):
        a, b, c, d = np.add(corners, cell) + 0.1 * np.sin(np.add(corners, cell) * [[1, 2]])
        r, s = FACET_NODES[n_of].T[:, :, None]
        if n_of != n_nodes and cell[0] < 2:
            for o, p, q in ((a, b, c), (a, c, d)):
                facets.append(np.array([o, p, q, q, (o + p) / 2, (p + q) / 2, q, (q + o) / 2])[:n_of])
        elif n_of in (4, 8):
            facets.append(a + r * (b - a) + s * (d - a) + r * s * (a - b + c - d))
        else:
            facets += [o + r * (p - o) + s * (q - o) for o, p, q in ((a, b, c), (a, c, d))]
    flat = np.concatenate(facets)
    _, first, number = np.unique(flat.round(9), axis=0, return_index=True, return_inverse=True)
    x, y = flat[first].T
    points = np.column_stack([x, y, 0.05 * np.sin(x) * np.cos(1.3 * y)])
    nodes = number.reshape(-1, n_of)
    nodes = nodes if n_of == n_nodes else in_halves(nodes)
    ends = np.array([x.min(), x.max()])
    rim = np.flatnonzero(np.isin(x.round(9), ends.round(9)))
    return Surface(points, nodes, UP, rim, np.arange(len(points)))


def cloud(n, seed=0):
    """Contact points, of two nodes each, and places of these nodes above and below the surface."""
    rng = np.random.default_rng(seed)
    share = rng.uniform(0.2, 0.8, n)
    mean = sp.random(n // 3, n, 0.2, format="csr", random_state=1)
    nodes = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    points = ContactPoints(nodes, np.column_stack([share, 1 - share]), mean, np.arange(n // 3), share, mean)
    x = rng.uniform([0.3, 0.3, -0.05], [3.5, 3.5, 0.2], (n + 1, 3))
    return points, x


def same(a, b):
    """Whether all arrays of two results are equal but for the order of sums."""
    for one, other in zip(a, b, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("n_nodes", KINDS)
def test_points_are_followed_equally(n_nodes):
    """Over facets and their edges, and past the rim, while the surface moves too."""
    master, (points, x) = saddle(n_nodes), cloud(60)
    found = closest_points(points.at(x), master.points[master.facets])

    def follow():
        pairs, seen = MovingPairs(master, found.facet, found.local), []
        for step in range(60):
            x_s = x + 0.012 * step * np.array([1.0, 0.4, 0.02])
            x_m = master.points + 0.01 * np.sin(0.1 * step + master.points[:, ::-1])
            index = np.arange(60)[step % 3 :: 2]
            some = ContactPoints(points.nodes[index], points.weights[index], points.mean[:, index], *[None] * 3)
            normal, gap = pairs.follow(some, index, x_s, x_m)
            seen.append((pairs.local[index], *pairs.carriers, normal, gap, gap == pairs.size, pairs.facet[index]))
        return seen, pairs.facet

    (compiled, facet), (plain, _) = each_way(follow)
    for one, other in zip(compiled, plain, strict=True):
        same(one, other)
    assert (facet != found.facet).mean() > 0.5
    past = sum(np.count_nonzero(least_depth(step[0], n_nodes) < -1e-3) for step in compiled)
    assert 0 < past < 500


@pytest.mark.parametrize("n_nodes", KINDS)
def test_closest_points_are_equal(n_nodes):
    """Near the surface, far from it, and past its rim."""
    master = saddle(n_nodes)
    x = np.random.default_rng(2).uniform([-1, -1, -3], [5, 5, 3], (80, 3))
    x[:40, 2] *= 0.03
    compiled, plain = each_way(lambda: closest_points(x, master.points[master.facets]))
    same(*([p.facet, p.local, p.weights, p.normal, p.gap, p.offset] for p in (compiled, plain)))


@pytest.mark.parametrize("n_nodes", KINDS)
def test_points_on_continued_facets_are_equal(n_nodes):
    """Each on its facet, also past its edges, from a guess beside the answer."""
    master, rng = saddle(n_nodes), np.random.default_rng(4)
    x = rng.uniform([0.2, 0.2, -0.1], [3.6, 3.6, 0.1], (50, 3))
    near = closest_points(x + np.array([0.2, -0.1, 0.0]), master.points[master.facets])
    nodes = master.points[master.facets[near.facet]]
    compiled, plain = each_way(lambda: follow(x, nodes, near.facet, near.local))
    same(*([p.facet, p.local, p.weights, p.normal, p.gap, p.offset] for p in (compiled, plain)))
    foot = np.einsum("kn,knd->kd", compiled.weights, nodes)
    np.testing.assert_allclose(foot + compiled.gap[:, None] * compiled.normal, x, rtol=0, atol=1e-8)


@pytest.mark.parametrize("kind", ["integrated", "node-to-segment"])
def test_means_of_rows_and_forces_on_nodes_are_equal(kind):
    points, rng = contact_points(saddle(6), kind), np.random.default_rng(3)
    p, rows = len(points.nodes), len(points.row_nodes)
    values, forces = rng.normal(size=(p, 3)), rng.normal(size=(rows, 3))
    forces[::2], values[::3] = 0.0, 0.0

    def work():
        means = points.average(values), points.average(values[:, 0])
        return *means, points.spread(forces), points.spread(forces[:, 1]), carried(points, values)

    same(*each_way(work))
    assert np.sum(points.average(values) * forces) == pytest.approx(np.sum(values * points.spread(forces)))


@pytest.mark.parametrize("chosen", [[], [2], [1, 3, 6], [6, 1]])
def test_some_rows_are_means_of_their_own_points(chosen):
    """With all that belongs to them; points of other rows alone are left out."""
    points, _ = cloud(24)
    rows = np.array(chosen, dtype=np.int64)
    some, numbers = points.of_rows(rows)
    values = np.random.default_rng(5).normal(size=(24, 3))
    np.testing.assert_allclose(some.mean @ values[numbers], (points.mean @ values)[rows], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(numbers, np.flatnonzero(points.mean.toarray()[rows].any(axis=0)))
    np.testing.assert_array_equal(some.nodes, points.nodes[numbers])
    np.testing.assert_array_equal(some.area, points.area[rows])


def carried(points, values):
    return on_nodes(points.nodes, points.weights, values, 1 + points.nodes.max())
