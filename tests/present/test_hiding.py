"""What hides what: parts around or before others are seen through, and nothing else is."""

import numpy as np
import pytest

from exudyn_partition.present.hiding import hiding

UP = np.array([0.0, 0.0, 1.0])
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TRIANGLES = np.array([t for a, b, c, d in FACES for t in ((a, b, c), (a, c, d))])


def cube(centre, size):
    """Points and triangles of a box."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    return np.asarray(centre) + corners * size, TRIANGLES


@pytest.mark.parametrize("towards", [UP, np.array([1.0, -1.6, 0.8])])
def test_a_housing_is_seen_through(towards):
    parts = [cube((0, 0, 0), 1.0), cube((0, 0, 0), 3.0), cube((5, 5, 0), 1.0)]
    assert hiding(parts, [True] * 3, towards) == [False, True, False]


def test_two_housings_are_seen_through():
    parts = [cube((0, 0, 0), 4.0), cube((0, 0, 0), 3.0), cube((0, 0, 0), 1.0)]
    assert hiding(parts, [True] * 3, UP) == [True, True, False]


def test_a_plate_before_bodies_is_seen_through_and_one_behind_is_not():
    ball, above, below = cube((0, 0, 0), 1.0), cube((0, 0, 2), (4, 4, 0.1)), cube((0, 0, -2), (4, 4, 0.1))
    assert hiding([ball, above, below], [True, False, False], UP) == [False, True, False]


def test_what_is_seen_in_part_stays():
    parts = [cube((0, 0, 0), 1.0), cube((0.6, 0, 1), 1.0)]  # half is covered
    assert hiding(parts, [True, True], UP) == [False, False]
    assert hiding(parts[:1], [True], UP) == [False]


def test_what_does_not_matter_may_be_hidden():
    parts = [cube((0, 0, -1), (1, 1, 0.1)), cube((0, 0, 1), 2.0)]
    assert hiding(parts, [False, True], UP) == [False, False]
    assert hiding(parts, [True, True], UP) == [False, True]
