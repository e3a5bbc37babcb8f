"""Rotation matrices and moments."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from exudyn_partition.frames.rotations import rotation_change, rotation_matrix, total_moment


def test_rotation_matrices_are_scipys_one_by_one_and_together():
    """A single vector has its own formula."""
    directions = np.random.default_rng(0).normal(size=(7, 3))
    vectors = directions * np.array([0.0, 1e-300, 1e-9, 1e-3, 1.0, np.pi, 40.0])[:, None]
    expected = Rotation.from_rotvec(vectors).as_matrix()
    np.testing.assert_allclose(rotation_matrix(vectors), expected, atol=1e-14)
    np.testing.assert_allclose([rotation_matrix(v) for v in vectors], expected, atol=1e-14)


@pytest.mark.parametrize("size", [0.0, 1e-9, 0.02, 1.0, 3.0, 40.0])
def test_the_change_of_a_rotation_matrix_is_as_exact_as_the_way(size):
    """A small one is the derivative times the way, a large one the difference; ways may also lead back to zero."""
    v, way = size * np.array([0.6, 0.0, 0.8]), np.array([0.2, -0.7, 0.5])
    derivative = (rotation_matrix(v + 1e-5 * way) - rotation_matrix(v - 1e-5 * way)) / 2e-5
    np.testing.assert_allclose(rotation_change(v, 1e-13 * way) / 1e-13, derivative, atol=1e-9)
    ways = np.array([way, 30 * way, -v, -0.5 * v, 1e-9 * way - v, 0 * v])
    np.testing.assert_allclose(rotation_change(v, ways), rotation_matrix(v + ways) - rotation_matrix(v), atol=2e-15)
    np.testing.assert_allclose([rotation_change(v, each) for each in ways], rotation_change(v, ways), atol=1e-15)


def test_a_rotation_that_is_not_finite_gives_no_number():
    """Runs that have become unstable are told by it."""
    for v in ([np.inf, 0, 0], [1e200, 0, 0], [np.nan, 0, 0]):
        assert np.isnan(rotation_matrix(np.array(v))).all()


def test_the_total_moment_is_the_sum_of_vector_products():
    arms, forces = np.random.default_rng(1).normal(size=(2, 9, 3))
    np.testing.assert_allclose(total_moment(arms, forces), np.cross(arms, forces).sum(axis=0), rtol=1e-13)
