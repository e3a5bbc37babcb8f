"""Tangents of rows, wherever the body that they follow has turned."""

import numpy as np
import pytest
from oracles import floating, moved

from exudyn_partition.contact.rigid import RigidGaps, RigidPlane
from exudyn_partition.contact.tangential import TangentialRows


@pytest.mark.parametrize("about", [0, 1])
def test_tangents_are_perpendicular_also_where_their_axis_becomes_the_normal(round_body, about):
    """A body that rolls by a quarter of a turn: each of its axes is once along the plane's normal."""
    side = floating(round_body)
    gaps = RigidGaps(side, RigidPlane())
    rows = TangentialRows(gaps)
    for angle in np.linspace(0, np.pi / 2, 7):
        gaps.at(moved(side, [0, 0, 0.1], angle * np.eye(3)[about]))
        frames = np.concatenate([gaps.normal[:, None], rows.tangents], axis=1)
        np.testing.assert_allclose(frames @ frames.swapaxes(1, 2), np.tile(np.eye(3), (len(frames), 1, 1)), atol=1e-12)
