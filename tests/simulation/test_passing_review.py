"""Bodies that enter what they touch beside their patches are told; those that touch within them are not."""

import numpy as np
import pytest
from exudyn.utilities import InertiaCuboid
from oracles import MARBLE_RADIUS, TOP

import exudyn_partition as ep
from exudyn_partition.errors import ContactPatchWarning

TURNING = {"frame": "floating", "initialVelocity": [0, 0, -1.0], "initialAngularVelocity": [0, 500.0, 0]}
LONG = {"end_time": 2.5e-3, "step": 5e-6, "method": "implicit"}


@pytest.mark.parametrize("below", ["plane", "carried plane", "body"])
def test_a_body_that_turned_and_falls_into_another_warns(mbs, bodies, below):
    """Its patch looks aside when it arrives. What carries the plane rises, else the ball would not reach it."""
    top, rises = np.array(TOP if below == "body" else (0.0, 0, 0)), 2e-3 if below == "carried plane" else 0.0
    start = top + np.array([0, 0, 1e-3 + rises])
    ball = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=start, **TURNING)
    if below == "body":
        lower, within, options = ep.CreatePartitionBody(mbs, bodies[1], name="block"), "body 'block'", {}
    else:
        lower, within, options = ep.RigidPlane(), "the rigid surface", {}
    if rises:
        speed = [0, 0, rises / LONG["end_time"]]
        options["masterBody"] = mbs.CreateRigidBody(inertia=InertiaCuboid(1e3, [1.0] * 3), initialVelocity=speed)
    contact = ep.CreatePartitionContact(mbs, ball, lower, name="floor", **options)
    mbs.Assemble()
    with pytest.warns(ContactPatchWarning, match=rf"'floor': at t = .* m within {within} at .* beside its patch"):
        result = ep.solve_dynamic(mbs, **LONG)
    assert not contact.force(result).any()


def test_a_body_that_falls_past_another_one_is_not_told(mbs, bodies):
    """It falls beside a vertical edge. Boxes around both overlap."""
    ball, block = bodies
    corner = block.points[:, :2].max(axis=0) + 0.8 * MARBLE_RADIUS  # 1.13 radii from the edge
    motion = TURNING | {"initialAngularVelocity": [0, 0, 0]}
    falling = ep.CreatePartitionBody(mbs, ball, referencePosition=[*corner, TOP[2] + 1e-3], **motion)
    ep.CreatePartitionContact(mbs, falling, ep.CreatePartitionBody(mbs, block))
    mbs.Assemble()
    with pytest.warns(ContactPatchWarning, match="never closed") as said:
        ep.solve_dynamic(mbs, **LONG)
    assert len(said) == 1
