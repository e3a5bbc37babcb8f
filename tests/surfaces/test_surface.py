"""Closest points of facets, and gaps to a meshed sphere."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from oracles import dome

from exudyn_partition.errors import ComplementarityError
from exudyn_partition.fe.shapes import FACET_NODES, shape_functions
from exudyn_partition.surfaces.surface import Surface, closest_points


def saddle(height=0.1):
    """One quad, not a parallelogram, with its corners up and down in turn."""
    return np.array([[0.0, 0, height], [1, 0, -height], [1.1, 0.9, height], [0, 1, -height]])


def wave(height=0.1):
    """One cubic triangle that bends to both sides."""
    flat = FACET_NODES[10]
    return np.column_stack([flat, height * np.sin(4 * flat[:, 0] + 2 * flat[:, 1])])


@pytest.mark.parametrize("facet", [dome, saddle, wave])
@settings(max_examples=60, deadline=None)
@given(
    foot=arrays(float, 2, elements=st.floats(-0.4, 1.2)),
    lift=st.floats(-0.3, 0.3),
    height=st.floats(-0.1, 0.1),
)
def test_closest_point_is_the_nearest_of_the_whole_facet(facet, foot, lift, height):
    """Within a third of a facet's size; further away a curved facet may have several nearest points."""
    point = np.array([*foot, lift])
    nodes = facet(height)
    got = closest_points(point[None], nodes[None])
    grid = np.array([(i / 60, j / 60) for i in range(61) for j in range(61 if len(nodes) == 4 else 61 - i)])
    nearest = np.linalg.norm(shape_functions(grid, len(nodes))[:, 0] @ nodes - point, axis=1).min()
    distance = np.linalg.norm(got.weights[0] @ nodes - point)
    assert distance <= nearest + 1e-9
    assert np.hypot(got.gap[0], got.offset[0]) == pytest.approx(distance, abs=1e-12)


def test_gap_to_a_sphere(sphere):
    """Points around a quadratic mesh of a sphere: the gap is their distance from it, inside negative."""
    fem, partition = sphere
    surface = Surface.of(fem.points, partition.patches[0], np.zeros(3))
    around = np.random.default_rng(0).uniform(-0.15e-3, 0.15e-3, (50, 2))
    for height in (-5e-6, 5e-6):
        z = 0.01 - np.sqrt(0.01**2 - (around**2).sum(axis=1)) - height
        got = closest_points(np.column_stack([around, z]), surface.points[surface.facets])
        np.testing.assert_allclose(got.gap, height, atol=2e-8)


@pytest.mark.parametrize("distance", [0.005, 0.5])
def test_closest_point_from_afar(distance):
    """Of a curved facet the foot of the normal, however far: Gauss and Newton's steps would go past it."""
    nodes = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0.03], [0.5, 0.5, 0.05], [0, 0.5, 0.04]]) * 1e-3
    local = np.array([[0.2, 0.3], [0.5, 0.1], [0.1, 0.7]])
    shape = shape_functions(local, 6) @ nodes
    normal = np.cross(shape[:, 1], shape[:, 2])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    found = closest_points(shape[:, 0] + distance * normal, nodes[None])
    np.testing.assert_allclose(found.local, local, atol=1e-9)
    np.testing.assert_allclose(found.gap, distance, rtol=1e-12)


@pytest.mark.parametrize("far", [1e200, np.inf, np.nan])
def test_points_beyond_all_bounds_are_refused(far):
    """Squares of distances are not finite there, and no facet is nearest: compiled loops must not look for one."""
    with pytest.raises(ComplementarityError, match="unstable"):
        closest_points(np.array([[far, 0.0, 0.0]]), np.eye(3)[None])
