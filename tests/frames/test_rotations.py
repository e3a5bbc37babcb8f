"""Rotation matrices and moments."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from exudyn_partition.frames.rotations import composed, rotation_change, rotation_matrix, total_moment, turned


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


def test_composed_rotations_turn_about_the_axes_of_the_body():
    """By any angle; near zero, where the cosine has lost half its digits, to 1e-8."""
    rng = np.random.default_rng(1)
    for size, turn, close in ((1.0, 0.3, 1e-14), (3.1, 3.1, 1e-14), (6.2, 1e-3, 1e-13), (0.02, 1e-4, 1e-13)):
        v, way = (
            length * direction / np.linalg.norm(direction)
            for length, direction in zip((size, turn), rng.normal(size=(2, 3)), strict=True)
        )
        both = composed(v, way)
        np.testing.assert_allclose(rotation_matrix(both), rotation_matrix(v) @ rotation_matrix(way), atol=close)
        assert np.linalg.norm(both) < 2 * np.pi
    np.testing.assert_allclose(composed(v, np.zeros(3)), v, atol=1e-13)
    np.testing.assert_allclose(composed(np.zeros(3), v), v, atol=1e-13)
    assert np.linalg.norm(composed(v, -v)) < 1e-7
    assert not composed(np.zeros(3), np.zeros(3)).any()


def test_a_rotation_that_is_not_finite_gives_no_number():
    """Runs that have become unstable are told by it."""
    for v in ([np.inf, 0, 0], [1e200, 0, 0], [np.nan, 0, 0]):
        assert np.isnan(rotation_matrix(np.array(v))).all()


def test_the_total_moment_is_the_sum_of_vector_products():
    arms, forces = np.random.default_rng(1).normal(size=(2, 9, 3))
    np.testing.assert_allclose(total_moment(arms, forces), np.cross(arms, forces).sum(axis=0), rtol=1e-13)


def test_turned_is_the_product_of_the_rotations_and_keeps_digits_near_zero():
    rng = np.random.default_rng(3)
    for v, way in rng.normal(scale=2.0, size=(50, 2, 3)):
        both = turned(v, way)
        np.testing.assert_allclose(rotation_matrix(both), rotation_matrix(v) @ rotation_matrix(way), atol=1e-14)
        assert np.linalg.norm(both) <= np.pi
    little = np.array([1e-12, -2e-12, 3e-12])
    np.testing.assert_allclose(turned(little, little), 2 * little, rtol=1e-14)
    np.testing.assert_allclose(turned(np.array([0.3, 0.2, 0.1]), np.zeros(3)), [0.3, 0.2, 0.1], rtol=1e-14)
    assert np.isnan(turned(np.full(3, np.inf), little)).all()
