"""What a run checks of its joints: where they are attached, whether they are closed, and at which velocities."""

import re

import exudyn as exu
import exudyn.itemInterface as items
import exudyn.utilities
import numpy as np
import pytest
from oracles import HINGE, ground, jointed

import exudyn_partition as ep
from exudyn_partition.errors import InputError, ModelLimitWarning

KIND = exu.OutputVariableType


def test_joints_on_nodes_that_were_reduced_away(mbs, arm_body, frame):
    item = ep.CreatePartitionBody(mbs, arm_body, frame=frame)
    assert not any("dents" in sentence for sentence in item.left_out)
    marker = item.CreateNodeMarker(mbs, (0.005, 0.004, 0.03))
    assert any("dents" in sentence for sentence in item.left_out)
    mbs.AddObject(items.SphericalJoint(name="ball", markerNumbers=[ground(mbs, (0.005, 0.004, 0.03)), marker]))
    mbs.Assemble()
    with pytest.raises(
        InputError, match=r"JointSpherical 'ball', object \d+, is attached to the body's point .* reduced"
    ):
        ep.solve_dynamic(mbs, end_time=1e-5, method="implicit")


def test_joints_on_nodes_of_a_rigid_interface(mbs, arm_body, frame):
    """Their motion is the interface's; Euler parameters of other bodies have constraints without markers."""
    item = ep.CreatePartitionBody(mbs, arm_body, frame=frame)
    corner = item.CreateNodeMarker(mbs, (0.005, 0.004, 0.0))
    inertia = exudyn.utilities.RigidBodyInertia(mass=1.0, inertiaTensor=np.eye(3))
    other = mbs.CreateRigidBody(inertia=inertia, referencePosition=[0.005, 0.004, 0])
    mbs.AddObject(items.SphericalJoint(markerNumbers=[mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=other)), corner]))
    mbs.Assemble()
    assert ep.solve_dynamic(mbs, end_time=1e-5, method="implicit").status == "finished"


def test_initial_velocities_that_violate_a_joint(arm_body, frame):
    for velocity, allowed in (([0.15, 0, 0], True), ([0.16, 0, 0], False), ([0, 0, 0], False)):
        mbs, *_ = jointed(arm_body, frame, HINGE, initialVelocity=velocity, initialAngularVelocity=[0, 5, 0])
        mbs.Assemble()
        if allowed:
            assert ep.solve_dynamic(mbs, end_time=2e-5, step=2e-6, method="implicit").status == "finished"
        else:
            with pytest.raises(InputError, match=r"JointGeneric .* violated by the initial velocities, by 0\.\d+"):
                ep.solve_dynamic(mbs, end_time=2e-5, step=2e-6, method="implicit")


@pytest.mark.parametrize("method", ["implicit", "explicit"])
def test_a_joint_whose_markers_do_not_meet(arm_body, frame, method):
    mbs, *_ = jointed(arm_body, frame, HINGE, referencePosition=[0.2, 0, 0])
    mbs.Assemble()
    with pytest.raises(InputError, match=r"JointGeneric .* is open by 0\.2 \(m or rad\) at the start, where bodies"):
        ep.solve_dynamic(mbs, end_time=2e-5, step=2e-6, method=method)


@pytest.mark.parametrize(("method", "step"), [("implicit", 2e-6), ("implicit", 2e-5), ("explicit", 5e-7)])
def test_a_small_gap_in_a_joint(arm_body, frame, method, step):
    """A hinge that is open by a micrometre: what closing it brings is told, and is what the first step has."""
    for gap in (0.0, 1e-6):
        mbs, item, hinge = jointed(arm_body, frame, HINGE, gravity=[9.81, 0, 0], referencePosition=[gap, 0, gap])
        kind = {"outputVariableType": KIND.ForceLocal, "storeInternal": True}
        force = mbs.AddSensor(items.SensorObject(objectNumber=hinge, **kind))
        mbs.Assemble()
        options = {"end_time": 60 * step, "step": step, "method": method}
        if not gap:
            sound = ep.solve_dynamic(mbs, **options)
            assert abs(sound.sensor(force)).max() < 2 * 9.81 * arm_body.total_mass
            continue
        with pytest.warns(ModelLimitWarning, match=r"JointGeneric .* is open by 1e-06 .* position=") as caught:
            result = ep.solve_dynamic(mbs, **options)
    brings = float(re.search(r"brings (\S+) J", str(caught[0].message))[1])
    assert brings == pytest.approx(item.energy(result)[1], rel=0.5)
    assert brings > 100 * arm_body.total_mass * 9.81 * 1e-6  # far more than gravity does over the gap
    if step == 2e-6:  # a spike in the force, too: with longer steps it goes on
        assert "N or N m in its sensor" in str(caught[0].message)


def test_what_an_open_joint_brings_is_that_of_its_own_body(mbs, arm_body):
    """Whether it is the first of the model or the last one."""
    for name in ("first", "last"):
        item = ep.CreatePartitionBody(mbs, arm_body, gravity=[9.81, 0, 0], referencePosition=[1e-6, 0, 1e-6])
        markers = [ground(mbs), item.CreateInterfaceMarker(mbs, "foot")]
        mbs.AddObject(items.GenericJoint(name=name, markerNumbers=markers, constrainedAxes=HINGE))
    mbs.Assemble()
    with pytest.warns(ModelLimitWarning, match="is open by 1e-06") as caught:
        ep.solve_dynamic(mbs, end_time=4e-6, step=2e-6, method="implicit")
    told = [re.search(r"'(\w+)', .* brings (\S+) J", str(warning.message)) for warning in caught]
    brings = {found[1]: float(found[2]) for found in told if found}
    assert brings["first"] == pytest.approx(brings["last"], rel=1e-2)


def test_joints_of_round_off_are_closed(arm_body, frame):
    """A mechanism far from the origin, whose places are not exact in binary: none of its joints is named."""
    place = np.array([0.7, -1.3, 2.1])
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, arm_body, frame=frame, referencePosition=place, gravity=[9.81, 0, 0])
    foot = item.CreateInterfaceMarker(mbs, "foot")
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground(mbs, place), foot], constrainedAxes=HINGE))
    mbs.Assemble()
    assert ep.solve_dynamic(mbs, end_time=2e-5, step=1e-6, method="implicit").status == "finished"
