"""Sharp edges between the facets of a patch."""

import netgen.occ as occ
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.fe.edges import sharp_nodes
from exudyn_partition.fe.facets import of_one_shape

SIDE = 0.02


def whole(fem):
    return sharp_nodes(fem.points, of_one_shape(fem.facets))


@pytest.mark.parametrize("order", [1, 2, 3])
def test_nodes_on_the_edges_of_a_box_are_sharp(order):
    fem = ep.fe_model(box(SIDE, SIDE, SIDE).Move((0, 0, -SIDE / 2)), ep.STEEL, maxh=SIDE / 2, order=order)
    on_faces = np.isclose(abs(fem.points), SIDE / 2).sum(axis=1)
    np.testing.assert_array_equal(whole(fem), np.flatnonzero(on_faces > 1))


@pytest.mark.parametrize("order", [1, 2])
def test_a_ball_has_no_sharp_edges_however_coarse_its_mesh(order):
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), SIDE), ep.STEEL, maxh=SIDE / 2, order=order)
    assert not whole(fem).size


def test_only_convex_edges_are_sharp():
    """The inner corner of an angle is not."""
    angle = box(2 * SIDE, SIDE, SIDE) - box(2 * SIDE, 2 * SIDE, SIDE).Move((SIDE, 0, SIDE / 2))
    fem = ep.fe_model(angle, ep.STEEL, maxh=SIDE / 2)
    inner = np.isclose(fem.points[:, [0, 2]], [0.0, SIDE / 2]).all(axis=1) & (abs(fem.points[:, 1]) < 0.4 * SIDE)
    found = np.zeros(fem.n_nodes, dtype=bool)
    found[whole(fem)] = True
    assert inner.any()
    assert not found[inner].any()
    assert found[np.isclose(fem.points[:, [0, 2]], [0.0, SIDE]).all(axis=1)].all()


def roof(degrees):
    """Points of a ridge along y, 0 and 1, and of the ends of both slopes, which turn by an angle, upwards outside."""
    x, z = np.cos(np.radians(degrees / 2)), -np.sin(np.radians(degrees / 2))
    return np.array([[0, 0, 0], [0, 1, 0], [x, 0, z], [x, 1, z], [-x, 0, z], [-x, 1, z]])


QUADS = np.array([[0, 2, 3, 1], [1, 5, 4, 0]])
BOTH = np.array([[0, 2, 3, 1], [1, 5, 0, 0], [5, 4, 0, 0]])  # a triangle among quadrilaterals is a b c c


@pytest.mark.parametrize("facets", [QUADS, BOTH])
@pytest.mark.parametrize(("degrees", "sharp"), [(-90, False), (20, False), (29, False), (31, True), (150, True)])
def test_an_edge_is_sharp_beyond_thirty_degrees(degrees, sharp, facets):
    np.testing.assert_array_equal(sharp_nodes(roof(degrees), of_one_shape(facets)), [0, 1] if sharp else [])
