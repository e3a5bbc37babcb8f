"""Points of a body: interpolation between nodes."""

import numpy as np
import pytest

from exudyn_partition.errors import InputError
from exudyn_partition.fe.places import interpolation


def test_points_reproduce_linear_fields(arm):
    nodes_of_arm = arm[0].points
    for point in ([0.001, 0.002, 0.033], [0.005, 0.0013, 0.021], [-0.005, 0.004, 0.06]):
        nodes, weights = interpolation(nodes_of_arm, point)
        assert weights.sum() == pytest.approx(1, abs=1e-12)
        np.testing.assert_allclose(weights @ nodes_of_arm[nodes], point, atol=1e-14)
    assert len(nodes) == 1  # a corner is a node
    with pytest.raises(InputError, match=r"point: expected a point on or in the body, got .* away from its nearest"):
        interpolation(nodes_of_arm, [0.02, 0, 0.03])


def test_nodes_of_a_fine_face_alone_do_not_tell_the_motion_beneath_it():
    """The nodes around a point beneath a refined face may all lie in the face."""
    grid = np.linspace(-1, 1, 9)
    face = np.stack(np.meshgrid(grid, grid, [0.0]), axis=-1).reshape(-1, 3)
    points = np.vstack([face, face[::8] - [0, 0, 5.0]])
    nodes, weights = interpolation(points, [0.1, 0.2, -0.3])
    np.testing.assert_allclose(weights @ points[nodes], [0.1, 0.2, -0.3], atol=1e-12)
