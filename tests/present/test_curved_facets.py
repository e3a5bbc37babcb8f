"""Bent facets: their triangles are finer, closed, and on the curved surface."""

import numpy as np
import pytest
from oracles import MARBLE_RADIUS, box

import exudyn_partition as ep
from exudyn_partition.present.curved_facets import rounded


def edges(triangles):
    """How often each edge is there, whatever its direction."""
    sides = np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    return np.unique(sides, axis=0, return_counts=True)[1]


def volume(points, triangles):
    """Within a closed surface."""
    a, b, c = points[triangles].swapaxes(0, 1)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def test_a_ball_is_rounder_and_closed(marble_parts):
    fem, _ = marble_parts
    nodes, numbers = np.unique(fem.facets, return_inverse=True)
    points, facets = fem.points[nodes], numbers.reshape(fem.facets.shape)
    triangles, places, values = rounded(points, facets)
    fine = places @ points
    np.testing.assert_array_equal(fine[: len(points)], points)
    assert (edges(triangles) == 2).all()  # without cracks, where finer triangles meet coarser ones
    assert len(points) < len(fine) < 4 * len(points)  # where the mesh is fine, nothing is added
    np.testing.assert_allclose(np.linalg.norm(fine, axis=1), MARBLE_RADIUS, rtol=5e-3)
    before = volume(points, rounded(points, facets[:, :3])[0])
    exact = 4 / 3 * np.pi * MARBLE_RADIUS**3
    assert exact - volume(fine, triangles) < 0.25 * (exact - before)
    pressure = np.maximum(points[:, 2], 0.0)
    shown = values @ pressure
    assert shown.min() == 0.0
    assert shown.max() == pytest.approx(pressure.max())


@pytest.mark.parametrize("order", [1, 2, 3])
def test_flat_faces_stay_as_they_are(order):
    fem = ep.fe_model(box(0.01, 0.02, 0.03), ep.STEEL, maxh=0.01, order=order)
    _, places, _ = rounded(fem.points, fem.facets)
    assert places.shape == (len(fem.points), len(fem.points))
