"""Bodies that enter what they touch beside their patches are told; those that touch within them are not."""

import numpy as np
import pytest
from oracles import TOP

import exudyn_partition as ep
from exudyn_partition.errors import ContactPatchWarning

TURNING = {"frame": "floating", "initialVelocity": [0, 0, -1.0], "initialAngularVelocity": [0, 500.0, 0]}
LONG = {"end_time": 2.5e-3, "step": 5e-6, "method": "implicit"}


@pytest.mark.parametrize("rigid", [True, False])
def test_a_body_that_turned_and_falls_into_another_warns(mbs, bodies, rigid):
    """Its patch looks aside when it arrives."""
    top = np.zeros(3) if rigid else TOP
    ball = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=np.add(top, [0, 0, 1e-3]), **TURNING)
    below = ep.RigidPlane() if rigid else ep.CreatePartitionBody(mbs, bodies[1], name="block")
    contact = ep.CreatePartitionContact(mbs, ball, below, name="floor")
    mbs.Assemble()
    within = "the rigid surface" if rigid else "body 'block'"
    with pytest.warns(ContactPatchWarning, match=rf"'floor': at t = .* m within {within} at .* beside its patch"):
        result = ep.solve_dynamic(mbs, **LONG)
    assert not contact.force(result).any()


def test_a_body_that_falls_past_another_one_is_not_told(mbs, bodies):
    """Boxes around both overlap."""
    aside = np.add(TOP, [0.9 * np.ptp(bodies[1].points[:, 0]), 0, 1e-3])
    ball = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=aside, **TURNING)
    contact = ep.CreatePartitionContact(mbs, ball, ep.CreatePartitionBody(mbs, bodies[1]))
    mbs.Assemble()
    with pytest.warns(ContactPatchWarning, match="never closed") as said:
        ep.solve_dynamic(mbs, **LONG)
    assert len(said) == 1
    assert contact is not None
