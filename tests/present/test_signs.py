"""Shapes of signs: closed, small, and where the items are."""

import numpy as np
import pytest

from exudyn_partition.exudyn_bodies.other_bodies import OtherBody
from exudyn_partition.present.signs import sign_shapes

TIMES = np.array([0.0, 1.0, 2.0])
BOUNDS = np.zeros(3), np.array([0.3, 0.4, 0.0])  # half a metre across


def sign(kind, place, end, name="", turn=None):
    """One with a motion at `TIMES`."""
    turns = np.tile(np.eye(3), (3, 1, 1)) if turn is None else turn
    none = np.zeros((0, 3)), np.zeros((0, 3), dtype=int)
    places, ends = (np.tile(np.asarray(p, dtype=float), (3, 1)) if np.ndim(p) == 1 else p for p in (place, end))
    return OtherBody(-1, name, *none, TIMES, places, turns, kind, ends)


@pytest.mark.parametrize(
    "kind",
    [
        "hinge", "ball joint", "slider", "fixed joint", "joint", "rod", "spring", "drive", "force", "torque", "gravity",
        "ground",
    ],
)  # fmt: skip
def test_each_is_closed_outward_and_small(kind):
    (shape,) = sign_shapes([sign(kind, [0.1, 0.1, 0.0], [0.1, 0.15, 0.02])], TIMES, BOUNDS)
    places = shape.at(1)
    a, b, c = places[shape.triangles].swapaxes(0, 1)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0  # outward
    np.testing.assert_allclose(np.cross(b - a, c - a).sum(axis=0), 0.0, atol=1e-12)  # closed
    assert np.linalg.norm(np.ptp(places, axis=0)) < 0.15
    assert shape.name.startswith(kind)
    assert all(0 <= share <= 1 for share in shape.rgb)


def test_a_spring_reaches_from_end_to_end():
    ends = np.array([[0.1, 0, 0], [0.2, 0, 0], [0.1, 0.1, 0.1]])
    (shape,) = sign_shapes([sign("spring", [0.0, 0.0, 0.0], ends, "wire")], TIMES, BOUNDS)
    assert shape.name == "spring 'wire'"
    for frame, end in enumerate(ends):
        places = shape.at(frame)
        way = end / np.linalg.norm(end)
        assert (places @ way).min() == pytest.approx(0, abs=2e-3)
        assert (places @ way).max() == pytest.approx(np.linalg.norm(end), abs=2e-3)
        assert np.linalg.norm(places - np.outer(places @ way, way), axis=1).max() < 0.015


def test_arrows_show_loads():
    """The tip of a force is where it acts, and the arrow is as long as the force is large."""
    values = np.array([[0, 0, 10.0], [0, 0, -5.0], [0, 0, 0]])
    push, pull = sign("force", [0.1, 0.0, 0.0], values), sign("force", [0.2, 0.0, 0.0], [2.0, 0, 0])
    one, other = sign_shapes([push, pull], TIMES, BOUNDS)
    heights = [np.ptp(one.at(frame)[:, 2]) for frame in range(3)]
    assert heights[1] == pytest.approx(heights[0] / 2)
    assert heights[2] == 0
    assert one.at(0)[:, 2].max() == pytest.approx(0.0, abs=1e-12)
    assert one.at(1)[:, 2].min() == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(other.at(0)[:, 0]) == pytest.approx(heights[0] / 5)


def test_gravity_is_there_once():
    down = sign("gravity", [0, 0, 0], [0, 0, -9.81], "gravity")
    (shape,) = sign_shapes([down, down], TIMES, BOUNDS)
    assert shape.name == "gravity, 9.81 m/s2"
    assert not shape.moves
    assert shape.at(0)[:, 2].min() > -1e-12
    assert sign_shapes([sign("", [0, 0, 0], [0, 0, 0])], TIMES, BOUNDS) == []
