"""Items of Exudyn's tutorials on a reduced body: gravity by its mass, and what would silently have no effect."""

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import InputError, StoppedRunWarning

KIND = exu.OutputVariableType
G = np.array([1.0, -9.81, 2.0])


@pytest.fixture(scope="module")
def body():
    """A bar along z, 10 x 8 x 60 mm, with an interface at its foot."""
    fem = ep.fe_model(box(0.010, 0.008, 0.060), ep.STEEL, maxh=8e-3)
    foot = np.flatnonzero(abs(fem.points[:, 2]) < 1e-9)
    return ep.reduce(fem, ep.Partition.interface(fem, "foot", foot), f_cut=30e3)


def link(mbs, body, frame):
    return ep.CreatePartitionBody(mbs, body, name="link", frame=frame, superElement=True, referencePosition=[0.1, 0, 0])


def tutorial_gravity(mbs, item):
    """As `CMSexampleCourse.py` and seven other examples have it."""
    marker = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=item["oFFRFreducedOrder"]))
    mbs.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=G))


@pytest.mark.parametrize("frame", ["inertial", "floating"])
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_gravity_by_a_marker_of_mass(mbs, body, frame, method):
    """Free fall: v = g t without deformation."""
    item = link(mbs, body, frame)
    tutorial_gravity(mbs, item)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-4, step=1e-6, method=method)
    np.testing.assert_allclose(item.momentum(result)[-1], body.total_mass * G * 1e-4, rtol=1e-9)
    assert item.deformation(item.coordinates(result)).max() < 1e-15


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_both_ways_to_give_gravity_are_one(body, frame):
    """A clamped bar bends under its weight, the same to round-off."""
    ends = []
    for tutorial in (True, False):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, body, frame=frame, superElement=True, gravity=[0, 0, 0] if tutorial else G)
        if tutorial:
            tutorial_gravity(mbs, item)
        ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
        mbs.AddObject(
            items.RigidBodySpringDamper(
                markerNumbers=[ground, item.CreateInterfaceMarker(mbs, "foot")],
                stiffness=np.diag([1e6] * 3 + [1e2] * 3),
            )
        )
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=1e-3, step=2e-6, method="implicit")
        ends.append(item.displacement(result, (0, 0, 0.06))[-1])
    assert abs(ends[0]).max() > 1e-6
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-6)


def marker_of_frame(mbs, item):
    return mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=item["oFFRFreducedOrder"]))


def nodes_marker(mbs, item, weights, **options):
    """As `CMSexampleCourse.py` has it, on the first nodes of the foot."""
    nodes = item.body.partition.find_interface("foot").nodes[: len(weights)]
    number = item["oFFRFreducedOrder"]
    return mbs.AddMarker(
        items.MarkerSuperElementRigid(bodyNumber=number, meshNodeNumbers=nodes, weightingFactors=weights, **options)
    )


WRONG = {
    "position": (marker_of_frame, "MarkerBodyPosition, is on the frame of body 'link'.*CreateInterfaceMarker"),
    "rigid": (
        lambda mbs, item: mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=item["oFFRFreducedOrder"])),
        "MarkerBodyRigid, is on the frame of body 'link'.*'foot'",
    ),
    "node": (
        lambda mbs, item: mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=item["nRigidBody"])),
        "MarkerNodeRigid, is on a node of body 'link' that is held in space",
    ),
    "sensor of node": (
        lambda mbs, item: mbs.AddSensor(
            items.SensorNode(nodeNumber=item["nRigidBody"], outputVariableType=KIND.Displacement)
        ),
        "SensorNode, is on a node of body 'link' that is held in space",
    ),
    "energy": (
        lambda mbs, item: mbs.AddSensor(
            items.SensorBody(bodyNumber=item["oFFRFreducedOrder"], outputVariableType=KIND.KineticEnergy)
        ),
        r"SensorBody of KineticEnergy, .* no mass .* energy\(result\) and momentum\(result\)",
    ),
    "offset": (
        lambda mbs, item: nodes_marker(mbs, item, np.full(3, 1 / 3), offset=[1e-6, 0, 0]),
        r"MarkerSuperElementRigid, has an offset of 1e-06 m .*'foot'.* weightingFactors",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_would_have_no_effect_is_refused(mbs, body, wrong):
    add, message = WRONG[wrong]
    add(mbs, link(mbs, body, "inertial"))
    mbs.Assemble()
    with pytest.raises(InputError, match=message):
        ep.solve_dynamic(mbs, end_time=1e-5)
    settings = exu.SimulationSettings()
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    with pytest.raises(Exception, match=message.partition(".*")[0]):
        mbs.SolveDynamic(settings)


def test_weights_do_what_an_offset_cannot(mbs, body):
    """Nodes of a rigid foot with any weights whose mean is its point move as the foot does; round-off is no offset."""
    item = link(mbs, body, "floating")
    foot = body.partition.find_interface("foot")
    weights = np.random.default_rng(0).uniform(0.5, 1.5, len(foot.nodes)) / len(foot.nodes)
    linear = np.vstack([np.ones(len(weights)), body.points[foot.nodes].T])
    weights += np.linalg.lstsq(linear, np.r_[1, foot.position] - linear @ weights, rcond=None)[0]
    ours, nodes = item["link:foot"], nodes_marker(mbs, item, weights, offset=[1e-12, 0, 0])
    mbs.AddLoad(items.Force(markerNumber=item.CreateNodeMarker(mbs, (0, 0, 0.06)), loadVector=[100.0, 200.0, 0]))
    sensors = [
        mbs.AddSensor(items.SensorMarker(markerNumber=marker, outputVariableType=kind, storeInternal=True))
        for kind in (KIND.Position, KIND.AngularVelocity)
        for marker in (ours, nodes)
    ]
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=5e-4, step=1e-6)
    place, place_of_nodes, turning, turning_of_nodes = map(result.sensor, sensors)
    np.testing.assert_allclose(place_of_nodes, place, atol=1e-11)
    np.testing.assert_allclose(turning_of_nodes, turning, atol=1e-3 * abs(turning).max())


def test_a_floating_frame_s_node_is_a_node_like_any(mbs, body):
    """A force at the centre of mass; but places on the frame are not those of the mesh."""
    item = link(mbs, body, "floating")
    marker = mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=item["nRigidBody"]))
    mbs.AddLoad(items.Force(markerNumber=marker, loadVector=body.total_mass * G))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-4, step=1e-6)
    np.testing.assert_allclose(item.momentum(result)[-1], body.total_mass * G * 1e-4, rtol=1e-9)
    marker_of_frame(mbs, item)
    mbs.Assemble()
    with pytest.raises(InputError, match="is on the frame of body 'link'"):
        ep.solve_dynamic(mbs, end_time=1e-5)


def hinged(mbs, body, kind):
    """The bar on a hinge, in the default frame, under gravity across it."""
    item = ep.CreatePartitionBody(mbs, body, name="arm", gravity=[9.81, 0, 0])
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    ends = [ground, item.CreateInterfaceMarker(mbs, "foot")]
    if kind == "revolute":
        mbs.AddObject(items.GenericJoint(markerNumbers=ends, constrainedAxes=[1, 1, 1, 1, 0, 1]))
    else:
        mbs.AddObject(items.ObjectJointSpherical(markerNumbers=ends))
    mbs.Assemble()
    return item


@pytest.mark.filterwarnings("ignore:body 'arm' has rotated by more than 0.1 rad")
@pytest.mark.parametrize("kind", ["revolute", "spherical"])
def test_a_pendulum_in_an_inertial_frame_says_what_it_needs(mbs, body, kind):
    item = hinged(mbs, body, kind)
    said = r"body 'arm' has rotated by 0\.5\d* rad at t = 0\.0\d* s, and its frame is inertial.*frame='floating'"
    with pytest.warns(StoppedRunWarning, match=said):
        result = ep.solve_dynamic(mbs, end_time=0.4, step=5e-4, method="implicit")
    assert result.status == "unstable"
    angle = np.linalg.norm(item.rigid_motion(item.coordinates(result))[:, 3:], axis=1)
    assert 0.49 < angle[-1] < 0.51
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = 0.4, 800
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    settings.solution.sensors.writePeriod = 2e-3
    with pytest.raises(Exception, match=r"body 'arm' has rotated by .* frame='floating'"):
        mbs.SolveDynamic(settings)
