"""Tangents of rows, wherever the body that they follow has turned."""

import numpy as np
import pytest
from oracles import floating, moved

from exudyn_partition.contact.rigid import RigidGaps, RigidSphere
from exudyn_partition.contact.tangential import TangentialRows


@pytest.mark.parametrize("about", [0, 1])
def test_tangents_turn_no_faster_than_normals_where_an_axis_becomes_a_normal(round_body, about):
    """A body that rolls on a sphere by a quarter of a turn: each of its axes is once along a normal there."""
    side = floating(round_body)
    gaps = RigidGaps(side, RigidSphere((0, 0, -0.02), 0.02), "node-to-segment")
    rows = TangentialRows(gaps)
    for angle in np.linspace(0, np.pi / 2, 7):
        gaps.at(moved(side, [0, 0, 1e-3], angle * np.eye(3)[about]))
        frames = np.concatenate([gaps.stage.normal[:, None], rows.tangents], axis=1)
        np.testing.assert_allclose(frames @ frames.swapaxes(1, 2), np.tile(np.eye(3), (len(frames), 1, 1)), atol=1e-12)
        apart = np.linalg.norm(frames[:, None] - frames, axis=3)
        assert (apart[:, :, 1:].max(axis=2) <= 4 * apart[:, :, 0] + 1e-12).all()


@pytest.mark.parametrize("about", [0, 1])
def test_tangents_depend_on_the_present_place_alone(round_body, about):
    """A body that has rolled further and back has those of one that has not: a saved run begins there anew."""
    side, found = floating(round_body), []
    for angles in ([np.pi / 4], [4 * np.pi / 9, np.pi / 4]):
        gaps = RigidGaps(side, RigidSphere((0, 0, -0.02), 0.02), "node-to-segment")
        rows = TangentialRows(gaps)
        for angle in angles:
            gaps.at(moved(side, [0, 0, 1e-3], angle * np.eye(3)[about]))
            found.append(rows.tangents)
    np.testing.assert_array_equal(found[2], found[0])
