"""The distance of hulls against the least distance of all their points, by least squares."""

import numpy as np
import pytest
from scipy.optimize import nnls

from exudyn_partition.surfaces.hulls import hull_distance


def least_distance(first, second):
    """Distance of convex hulls: shares of the points of each sum to one, and differ least."""
    weight = 1e4
    rows = [np.hstack([first.T, -second.T])]
    rows += [weight * np.repeat(ones, (len(first), len(second)))[None] for ones in ([1.0, 0.0], [0.0, 1.0])]
    shares = nnls(np.vstack(rows), [0.0, 0.0, 0.0, weight, weight])[0]
    return float(np.linalg.norm(rows[0] @ shares))


@pytest.mark.parametrize("seed", range(20))
def test_it_is_a_close_lower_bound(seed):
    rng = np.random.default_rng(seed)
    first, second = rng.normal(size=(2, 30, 3)) * rng.uniform(0.1, 2.0, (2, 1, 3))
    second += rng.normal(size=3) * rng.uniform(2.0, 8.0)
    distance = least_distance(first, second)
    found = hull_distance(first, second)
    assert found <= distance * (1 + 1e-4) + 1e-9
    assert found >= 0.85 * distance - 0.02 or distance < 1e-3


def test_hulls_that_overlap_have_none():
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    assert hull_distance(corners, 0.5 * corners) <= 0.0
    assert hull_distance(corners, corners + np.array([0.5, 0.3, 1.9])) <= 0.0
