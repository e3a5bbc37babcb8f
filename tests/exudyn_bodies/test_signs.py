"""Signs of joints, springs, drives, loads and gravity: what they are, and where they are over a run."""

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
from exudyn.utilities import InertiaCuboid
from oracles import HINGE

import exudyn_partition as ep

GRAVITY = np.array([1.0, 0.0, -9.81])
FORCE, TORQUE = np.array([5.0, 0.0, 0.0]), np.array([0.0, 0.1, 0.0])
TOP = np.array([0.02, 0.0, 0.1])  # of the spring [m]


def swing(mbs, arm_body, frame):
    """The bar hangs on a hinge about y, with a spring to the ground, loads and gravity; returns it and the run."""
    arm = ep.CreatePartitionBody(mbs, arm_body, name="arm", frame=frame, gravity=GRAVITY.tolist())
    ground = mbs.CreateGround()
    foot, head = (arm.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
    hinge = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=[0, 0, 0]))
    mbs.AddObject(items.GenericJoint(name="pin", markerNumbers=[hinge, foot], constrainedAxes=HINGE))
    top = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=ground, localPosition=TOP.tolist()))
    mbs.AddObject(
        items.ObjectConnectorSpringDamper(name="wire", markerNumbers=[top, head], stiffness=100.0, referenceLength=0.03)
    )
    mbs.AddLoad(items.LoadForceVector(name="push", markerNumber=head, loadVector=FORCE.tolist()))
    mbs.AddLoad(items.LoadTorqueVector(markerNumber=head, loadVector=TORQUE.tolist(), bodyFixed=True))
    mbs.Assemble()
    return head, ep.solve_dynamic(mbs, end_time=4e-3, step=2e-5, method="implicit")


@pytest.mark.parametrize("frame", ["floating", "inertial"])
def test_signs_are_where_the_items_are(mbs, arm_body, frame, tmp_path):
    head, run = swing(mbs, arm_body, frame)
    kinds = [other.kind for other in run.others]
    assert sorted(kinds) == sorted(["hinge", "ground", "spring", "ground", "force", "torque", "gravity"])
    by_kind = {other.kind: other for other in run.others}
    pin, wire, push, torque, weight = (by_kind[kind] for kind in ("hinge", "spring", "force", "torque", "gravity"))
    assert (pin.name, wire.name, push.name) == ("pin", "wire", "push")
    np.testing.assert_allclose(pin.place, np.zeros_like(pin.place), atol=1e-12)
    np.testing.assert_allclose(abs(pin.turn[:, 1, 2]), 1.0, atol=1e-12)  # along y
    np.testing.assert_array_equal(wire.place, np.tile(TOP, (len(wire.t), 1)))
    now = mbs.GetMarkerOutput(head, exu.OutputVariableType.Position)
    for sign, end in ((wire, wire.end), (push, push.place), (torque, torque.place)):
        np.testing.assert_allclose(end[-1], now, atol=1e-12)
        np.testing.assert_allclose(end[0], [0, 0, 0.06], atol=1e-6)
        assert sign.moves == (sign is not wire)
    assert np.linalg.norm(wire.end[-1] - wire.end[0]) > 1e-4
    np.testing.assert_array_equal(push.end, np.tile(FORCE, (len(push.t), 1)))
    np.testing.assert_allclose(torque.end[-1], torque.turn[-1] @ TORQUE, atol=1e-12)
    np.testing.assert_allclose(weight.end[0], GRAVITY, rtol=1e-9, atol=1e-9)
    run.save(tmp_path / "run.npz")
    for before, after in zip(run.others, ep.Result.load(tmp_path / "run.npz").others, strict=True):
        assert after.kind == before.kind
        np.testing.assert_array_equal(after.end, before.end)


GENERIC = {
    (1, 1, 1, 1, 1, 1): "fixed joint",
    (1, 1, 1, 0, 1, 1): "hinge",
    (1, 1, 1, 0, 0, 0): "ball joint",
    (0, 1, 1, 1, 1, 1): "slider",
    (0, 1, 1, 1, 1, 0): "joint",
}


@pytest.mark.parametrize(("axes", "kind"), GENERIC.items())
def test_a_generic_joint_is_what_it_leaves_free(mbs, arm_body, axes, kind):
    arm = ep.CreatePartitionBody(mbs, arm_body)
    hinge = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    markers = [hinge, arm.CreateInterfaceMarker(mbs, "foot")]
    mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=list(axes)))
    mbs.Assemble()
    found, _ = ep.solve_dynamic(mbs, end_time=2e-5, step=1e-5, method="implicit").others
    assert found.kind == kind
    if kind in ("hinge", "slider"):
        np.testing.assert_allclose(found.turn[0][:, 2], [1, 0, 0], atol=1e-12)


def test_a_crank_that_is_driven_has_a_drive(mbs, arm_body):
    """A constraint of the crank's only coordinate, which is a function of time, is a drive where the crank is."""
    arm = ep.CreatePartitionBody(mbs, arm_body, frame="floating")
    node = mbs.AddNode(items.Node1D(referenceCoordinates=[0.0]))
    crank = mbs.AddObject(items.ObjectRotationalMass1D(nodeNumber=node, inertia=1.0, referencePosition=[0, 0, -0.02]))
    pin = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=crank, localPosition=[0, 0, 0.02]))
    foot = arm.CreateInterfaceMarker(mbs, "foot")
    mbs.AddObject(items.GenericJoint(markerNumbers=[pin, foot]))
    nodes = mbs.AddNode(items.NodePointGround()), node
    ends = [mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=number, coordinate=0)) for number in nodes]
    mbs.AddObject(
        items.CoordinateConstraint(
            name="motor", markerNumbers=ends, offsetUserFunction=lambda mbs, t, *unused: 5.0 * t**2,
            offsetUserFunction_t=lambda mbs, t, *unused: 10.0 * t,
        )
    )  # fmt: skip
    mbs.Assemble()
    run = ep.solve_dynamic(mbs, end_time=2e-4, step=1e-5, method="implicit")
    (motor,) = (other for other in run.others if other.kind == "drive")
    assert motor.name == "motor"
    np.testing.assert_allclose(motor.place[0], [0, 0, -0.02], atol=1e-12)


def test_what_the_library_adds_itself_has_no_sign(mbs, round_body):
    """Contact loads the body that carries a plane, and an inertial frame holds the node of its markers."""
    item = ep.CreatePartitionBody(mbs, round_body, initialVelocity=[0, 0, -1.0], superElement=True)
    plate = mbs.CreateRigidBody(
        referencePosition=[0, 0, -0.01], inertia=InertiaCuboid(7800, [0.02] * 3),
        nodeType=exu.NodeType.RotationRotationVector,
    )  # fmt: skip
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, 0.01)), masterBody=plate)
    mbs.Assemble()
    run = ep.solve_dynamic(mbs, end_time=5e-6, step=1e-6)
    assert [other.kind for other in run.others] == [""]
