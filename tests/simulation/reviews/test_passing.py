"""Bodies that enter what they touch beside their patches are told; those that touch within them are not."""

import itertools

import numpy as np
import pytest
from exudyn.utilities import InertiaCuboid
from oracles import MARBLE_RADIUS, TOP, box
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import ContactPatchWarning

SIDE = 10e-3
TURNING = {"frame": "floating", "initialVelocity": [0, 0, -1.0], "initialAngularVelocity": [0, 500.0, 0]}
LONG = {"end_time": 2.5e-3, "step": 1e-5, "method": "implicit"}


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


@pytest.fixture(scope="module")
def fine_cube():
    """A cube with more nodes beside its patch, in the middle of its skin, than are looked at."""
    fem = ep.fe_model(box(SIDE, SIDE, SIDE).Move((0, 0, -SIDE / 2)), ep.STEEL, maxh=SIDE / 5)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, SIDE / 2), SIDE / 4), f_cut=20e3)


@pytest.mark.filterwarnings("ignore:.*contact.* never closed")
@pytest.mark.parametrize("corner", [*itertools.product((-1.0, 1.0), repeat=3)])
def test_the_first_corner_that_enters_is_told(mbs, fine_cube, corner):
    """The cube falls on it; all other nodes are still above the plane."""
    turn = Rotation.align_vectors([[0, 0, -1.0]], [corner])[0].as_matrix()
    place = [0, 0, SIDE / 2 * 3**0.5 + 1e-6]
    options = {"referencePosition": place, "referenceRotationMatrix": turn, "initialVelocity": [0, 0, -1.0]}
    falling = ep.CreatePartitionBody(mbs, fine_cube, frame="floating", **options)
    ep.CreatePartitionContact(mbs, falling, ep.RigidPlane())
    mbs.Assemble()
    with pytest.warns(ContactPatchWarning, match="beside its patch, where nothing holds it"):
        result = ep.solve_dynamic(mbs, end_time=50e-6, method="implicit", step=1e-5)
    x = falling.kinematics.at(np.arange(len(fine_cube.points))).place(falling.coordinates(result)[-1])
    assert np.count_nonzero(x[:, 2] < 0) == 1


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
