"""What a run checks of its joints: where they are attached, whether they are closed, and at which velocities."""

import re

import exudyn as exu
import exudyn.itemInterface as items
import exudyn.utilities
import numpy as np
import pytest
from oracles import HINGE, ground, jointed

import exudyn_partition as ep
from exudyn_partition.errors import InputError, ModelLimitWarning, RunError

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


def test_joints_on_nodes_that_were_reduced_away_may_be_there_if_nothing_switches_them_on(mbs, arm_body):
    item = ep.CreatePartitionBody(mbs, arm_body, initialVelocity=[0, 0, 1.0])
    markers = [ground(mbs, (0.005, 0.004, 0.03)), item.CreateNodeMarker(mbs, (0.005, 0.004, 0.03))]
    joint = mbs.AddObject(items.SphericalJoint(markerNumbers=markers, activeConnector=False))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-5, method="implicit")
    assert item.energy(result)[-1] == pytest.approx(0.5 * arm_body.total_mass, rel=1e-9)

    def switch(mbs, t):
        mbs.SetObjectParameter(joint, "activeConnector", t > 5e-6)
        return True

    mbs.SetPreStepUserFunction(switch)
    with pytest.raises(InputError, match="reduced away"):
        ep.solve_dynamic(mbs, end_time=1e-5, method="implicit")
    mbs.SetPreStepUserFunction(0)
    mbs.SetObjectParameter(joint, "activeConnector", True)
    with pytest.raises(InputError, match="reduced away"):
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


@pytest.mark.parametrize("switch", [("activeConnector", False), ("constrainedAxes", [0] * 6)], ids=["off", "axes"])
def test_a_joint_that_lets_go_of_a_preload_is_not_open(arm_body, frame, switch):
    """The force that it had is no gap: that of gravity here counted as 0.37 m."""
    mbs, item, joint = jointed(arm_body, frame, gravity=[0, 0, -9.81])
    mbs.Assemble()
    ep.solve_static(mbs, update_initial=True)
    mbs.SetObjectParameter(joint, *switch)
    result = ep.solve_dynamic(mbs, end_time=1e-4, step=2e-6, method="implicit")
    assert item.momentum(result)[-1, 2] == pytest.approx(-9.81e-4 * arm_body.total_mass, rel=1e-6)


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


def test_a_small_gap_in_a_joint_shows_in_statics(arm_body, frame):
    """A clamp that is open moves its body by the gap, whatever stands beside it; gravity bends it by far less."""
    for gap in (0.0, 1e-6):
        mbs, *_ = jointed(arm_body, frame, gravity=[0.1, 0, 0], referencePosition=[gap, 0, 0])
        mbs.Assemble()
        if gap:
            with pytest.warns(ModelLimitWarning, match=r"JointGeneric .* is open by 1e-06 .* position=") as caught:
                ep.solve_static(mbs, load_steps=1)
            told = [float(x) for x in re.search(r"some (\S+) m, .* by (\S+) m", str(caught[0].message)).groups()]
            assert told == pytest.approx([gap, gap], rel=0.1)
        else:
            ep.solve_static(mbs, load_steps=1)


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


PACE = 0.3  # m/s, of the drives below


def driven_by(kind, mbs, speed, way=lambda t: PACE * t, **functions):
    """A mass at a speed along x that a joint of a kind drives by `functions`, or else along a way; sensor of velocity.

    `functions` are of time alone.
    """
    of_joint = kind == "JointGeneric"
    functions = functions or {
        "constraintUserFunction" if kind == "ConnectorCoordinateVector" else "offsetUserFunction": way
    }
    if of_joint:
        inertia = exudyn.utilities.RigidBodyInertia(mass=1.0, inertiaTensor=np.eye(3))
        shape = exu.NodeType.RotationRotationVector
        body = mbs.CreateRigidBody(inertia=inertia, initialVelocity=[speed, 0, 0], nodeType=shape)
        node, marker = mbs.GetObject(body)["nodeNumber"], mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body))
        along = {name: lambda mbs, t, *unused, of=of: [of(t), 0, 0, 0, 0, 0] for name, of in functions.items()}
        mbs.AddObject(items.GenericJoint(markerNumbers=[ground(mbs), marker], constrainedAxes=[1] * 6, **along))
    else:
        node = mbs.AddNode(items.NodePoint(initialVelocities=[speed, 0, 0]))
        mbs.AddObject(items.MassPoint(mass=1.0, nodeNumber=node))
        still = mbs.AddNode(items.NodePointGround())
    if kind == "ConnectorCoordinate":
        markers = [mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=n, coordinate=0)) for n in (still, node)]
        level = {"velocityLevel": functions.pop("velocityLevel", False)}
        along = {name: lambda mbs, t, *unused, of=of: float(of(t)) for name, of in functions.items()}
        mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=markers, **level, **along))
    if kind == "ConnectorCoordinateVector":
        markers = [mbs.AddMarker(items.MarkerNodeCoordinates(nodeNumber=n)) for n in (still, node)]
        (of,) = functions.values()
        mbs.AddObject(
            items.ObjectConnectorCoordinateVector(
                markerNumbers=markers, scalingMarker0=[], scalingMarker1=np.eye(3)[:1], offset=[0.0],
                constraintUserFunction=lambda mbs, t, i, q, *unused: [q[-3] - of(t)],
                jacobianUserFunction=lambda *unused: np.eye(3)[:1],
            )
        )  # fmt: skip
    speed = items.SensorNode(nodeNumber=node, outputVariableType=KIND.Velocity, storeInternal=True)
    number = mbs.AddSensor(speed)
    mbs.Assemble()
    return number


@pytest.mark.parametrize("method", ["implicit", "explicit"])
@pytest.mark.parametrize("kind", ["ConnectorCoordinate", "ConnectorCoordinateVector", "JointGeneric"])
def test_a_drive_that_begins_at_a_speed_moves_what_has_this_speed(mbs, kind, method):
    """Exudyn's rates of constraints leave that speed out; a body at another one would begin with an impulse."""
    for start_time in (0.0, 2.0):
        mbs.Reset()
        speed = driven_by(kind, mbs, PACE, way=lambda t, begin=start_time: PACE * (t - begin))
        result = ep.solve_dynamic(mbs, end_time=start_time + 0.02, start_time=start_time, step=1e-3, method=method)
        np.testing.assert_allclose(result.sensor(speed)[:, 0], PACE, rtol=1e-6)
    for other in (0.0, 0.9 * PACE, -PACE):
        mbs.Reset()
        driven_by(kind, mbs, other)
        with pytest.raises(InputError, match=rf"{kind} .* by {PACE - other:.4g} .* drive begins with {PACE:.4g}"):
            ep.solve_dynamic(mbs, end_time=0.02, step=1e-3, method=method)


@pytest.mark.parametrize("way", [lambda t: 40 * t**2, lambda t: 1e3 * t**3, lambda t: 0.01 * (1 - np.cos(90 * t))])
def test_drives_that_begin_softly_move_what_is_at_rest(mbs, way):
    for kind in ("ConnectorCoordinate", "ConnectorCoordinateVector", "JointGeneric"):
        mbs.Reset()
        driven_by(kind, mbs, 0.0, way)
        assert ep.solve_dynamic(mbs, end_time=0.01, step=1e-3, method="implicit").status == "finished"


@pytest.mark.parametrize("method", ["implicit", "explicit"])
def test_a_drive_that_tells_its_rate(mbs, arm_body, method):
    """Exudyn cannot take the rate of a generic joint's drive; the joint runs by its way, and carries a body along."""
    rates = {"offsetUserFunction": lambda t: PACE * t, "offsetUserFunction_t": lambda t: PACE}
    for kind in ("ConnectorCoordinate", "JointGeneric"):
        mbs.Reset()
        speed = driven_by(kind, mbs, PACE, **rates)
        result = ep.solve_dynamic(mbs, end_time=0.02, step=1e-3, method=method)
        np.testing.assert_allclose(result.sensor(speed)[:, 0], PACE, rtol=1e-6)
    mbs.Reset()
    item = ep.CreatePartitionBody(mbs, arm_body, frame="floating", initialVelocity=[PACE, 0, 0])
    along = {name: lambda mbs, t, *unused, of=of: [of(t), 0, 0, 0, 0, 0] for name, of in rates.items()}
    markers = [ground(mbs), item.CreateInterfaceMarker(mbs, "foot")]
    mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=[1] * 6, **along))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=2e-5, method=method)
    np.testing.assert_allclose(item.momentum(result)[:, 0] / arm_body.total_mass, PACE, rtol=1e-6)


def test_drives_that_exudyn_would_leave_idle_are_refused(mbs):
    """The rate of a joint on position level, and the way of one on velocity level, drive nothing."""
    rate, way = {"offsetUserFunction_t": lambda t: PACE}, {"offsetUserFunction": lambda t: PACE * t}
    for kind, level, given, missing in (
        ("JointGeneric", {}, rate, "no offsetUserFunction:"),
        ("ConnectorCoordinate", {}, rate, "no offsetUserFunction:"),
        ("ConnectorCoordinate", {"velocityLevel": True}, way, "no offsetUserFunction_t:"),
    ):
        mbs.Reset()
        driven_by(kind, mbs, PACE, **level, **given)
        with pytest.raises(InputError, match=rf"{kind} .* {missing} nothing would drive it"):
            ep.solve_dynamic(mbs, end_time=0.01, step=1e-3, method="implicit")
    mbs.Reset()
    speed = driven_by("ConnectorCoordinate", mbs, PACE, velocityLevel=True, **rate)
    result = ep.solve_dynamic(mbs, end_time=0.01, step=1e-3, method="implicit")
    np.testing.assert_allclose(result.sensor(speed)[:, 0], PACE, rtol=1e-6)


def test_settings_that_solve_rates_without_drives_are_refused(mbs):
    settings = exu.SimulationSettings()
    settings.timeIntegration.generalizedAlpha.useIndex2Constraints = True
    settings.timeIntegration.generalizedAlpha.useNewmark = True
    settings.solution.file.write = False
    both = {"offsetUserFunction": lambda t: PACE * t, "offsetUserFunction_t": lambda t: PACE}
    for kind, functions in (("ConnectorCoordinate", {}), ("JointGeneric", {}), ("JointGeneric", both)):
        mbs.Reset()
        driven_by(kind, mbs, PACE, **functions)
        with pytest.raises(
            InputError, match=rf"settings: .* rates of constraints, and those of {kind} .* lack its drive"
        ):
            ep.solve_dynamic(mbs, end_time=0.01, step=1e-3, method="implicit", settings=settings)
    mbs.Reset()
    speed = driven_by("ConnectorCoordinate", mbs, PACE, **both)
    result = ep.solve_dynamic(mbs, end_time=0.01, step=1e-3, method="implicit", settings=settings)
    np.testing.assert_allclose(result.sensor(speed)[:, 0], PACE, rtol=1e-6)


def test_a_static_drive_needs_no_velocity(mbs, arm_body):
    item = ep.CreatePartitionBody(mbs, arm_body, frame="floating")
    markers = [ground(mbs), item.CreateInterfaceMarker(mbs, "foot")]
    way = {"offsetUserFunction": lambda mbs, t, *unused: [1e-4 * t, 0, 0, 0, 0, 0]}
    mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=[1] * 6, **way))
    mbs.Assemble()
    result = ep.solve_static(mbs, load_steps=1)
    np.testing.assert_allclose(item.coordinates(result)[-1, 0], 1e-4, rtol=1e-6)


def test_what_exudyn_cannot_compute_at_the_start_is_told(mbs):
    """Its own errors, and those of the user's function, name the model."""
    driven_by("ConnectorCoordinate", mbs, 0.0, way=lambda t: {}["no such way"])
    with pytest.raises(RunError, match=r"mbs: Exudyn cannot run the model: .*no such way"):
        ep.solve_dynamic(mbs, end_time=0.01, step=1e-3, method="implicit")
    mbs.Reset()
    driven_by("ConnectorCoordinate", mbs, PACE)
    mbs.AddNode(items.NodePoint())
    with pytest.raises(RunError, match=r"mbs: an item was added or deleted since mbs\.Assemble"):
        ep.solve_dynamic(mbs, end_time=0.01, step=1e-3, method="implicit")
