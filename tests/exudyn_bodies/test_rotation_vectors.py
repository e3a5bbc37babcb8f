"""Rotation vectors of Exudyn's nodes against the rotations that they stand for."""

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np

from exudyn_partition.exudyn_bodies.rotation_vectors import rotation_vectors, turns
from exudyn_partition.frames.rotations import composed


def test_turns_by_changes_of_rotation_vectors():
    """About the axes of each node; other coordinates stay what they are."""
    mbs, start = exu.SystemContainer().AddSystem(), np.array([0.3, -0.5, 0.7])
    mbs.AddNode(items.NodePoint(referenceCoordinates=[1, 2, 3]))
    mbs.AddNode(items.NodeRigidBodyRotVecLG(referenceCoordinates=[0, 0, 0, *start], initialVelocities=[0] * 6))
    mbs.Assemble()
    (first,) = vectors = tuple(rotation_vectors(mbs))
    assert first == 6
    q, change = np.zeros(9), np.array([1e-6, 2e-6, -3e-6])
    q[first:] = 0.1, 0.2, 0.3
    mbs.systemData.SetODE2Coordinates(q)
    found = turns(mbs, vectors).toarray()
    np.testing.assert_array_equal(found[:6, :6], np.eye(6))
    vector = start + q[first:]
    np.testing.assert_allclose(composed(vector, found[6:, 6:] @ change), vector + change, rtol=0, atol=1e-11)
