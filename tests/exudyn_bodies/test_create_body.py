"""Arguments of CreatePartitionBody by Exudyn's names, and what superElement=True adds: a surface, a frame, markers."""

import exudyn as exu
import numpy as np
import pytest
from oracles import relative, sensors
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.contact.plasticity.zone_motion import ZoneMotion
from exudyn_partition.errors import InputError
from exudyn_partition.frames.inertial import InertialKinematics
from exudyn_partition.plasticity.flow import PlasticState

KIND = exu.OutputVariableType
TURNED = Rotation.from_rotvec([0.5, -1.0, 0.7]).as_matrix()
OFFSETS = np.array([[0.01, -0.02, 0.0], [0.0, 0.015, 0.03]])


def vibration(mbs, body, **options):
    """Coordinates of a short free vibration of a body that is created with options."""
    item = ep.CreatePartitionBody(mbs, body, **options)
    mbs.SetNodeParameter(item["nModal"], "initialCoordinates_t", [1e-3] * (body.n_dofs - 6))
    mbs.Assemble()
    return item.coordinates(ep.solve_dynamic(mbs, end_time=1e-4, step=5e-7))


def test_exudyn_s_names_give_the_same_motion(arm_body):
    turned = [
        vibration(exu.SystemContainer().AddSystem(), arm_body, frame="floating", **options)
        for options in (
            {"referenceRotation": TURNED, "damping": ep.Rayleigh(1e3, 1e-7)},
            {
                "referenceRotationMatrix": TURNED,
                "massProportionalDamping": 1e3,
                "stiffnessProportionalDamping": 1e-7,
            },
            {"rotationMatrixRef": TURNED, "positionRef": [1, 2, 3]},
            {"rotationMatrixRef": [], "positionRef": [1, 2, 3], "initialVelocity": [0, 0, 0]},
        )
    ]
    np.testing.assert_array_equal(turned[0], turned[1])
    assert relative(turned[2], turned[0]) > 1e-3
    assert relative(turned[3], turned[0]) > 1e-3


def test_other_names_of_place_and_axes_are_those_of_exudyn(mbs, arm_body, capsys):
    place = [0.3, 0.1, -0.2]
    items = [
        ep.CreatePartitionBody(mbs, arm_body, superElement=True, **options)
        for options in (
            {"referencePosition": place, "referenceRotationMatrix": TURNED, "showMarkers": False},
            {"positionRef": place, "rotationMatrixRef": TURNED, "verbose": True},
        )
    ]
    np.testing.assert_array_equal(items[0].position, items[1].position)
    np.testing.assert_array_equal(items[0].kinematics.rotation, items[1].kinematics.rotation)
    assert [mbs.GetMarker(item["head"])["Vshow"] for item in items] == [False, True]
    assert "left out: damping of the kept modes" in capsys.readouterr().out


def test_super_elements_float_unless_a_frame_is_given(mbs, arm_body):
    frames = [{}, {"superElement": True}, {"superElement": True, "frame": "inertial"}]
    assert [ep.CreatePartitionBody(mbs, arm_body, **given).frame for given in frames] == [
        "inertial", "floating", "inertial",
    ]  # fmt: skip


def test_super_elements_are_drawn_as_they_deform(arm_body, frame):
    SC = exu.SystemContainer()
    mbs = SC.AddSystem()
    item = ep.CreatePartitionBody(
        mbs, arm_body, frame=frame, superElement=True, color=(0.1, 0.2, 0.9, 1.0), initialVelocity=[0, 0, 30.0]
    )
    unseen = ep.CreatePartitionBody(mbs, arm_body, frame=frame, referencePosition=[1, 0, 0])
    unseen.CreateInterfaceMarker(mbs, "head")
    first = mbs.GetNodeParameter(item["nModal"], "initialCoordinates_t")
    mbs.SetNodeParameter(item["nModal"], "initialCoordinates_t", np.array(first) + 3.0)
    mbs.Assemble()
    q = item.coordinates(ep.solve_dynamic(mbs, end_time=2e-5, step=5e-7))[-1]
    at = item.kinematics.at(np.unique(arm_body.facets))
    assert abs(at.deformation(q)).max() > 1e-5
    drawn = SC.renderer.GetGraphicsData()["triangles"]
    points = np.asarray(drawn["points"]).reshape(-1, 3)
    expected = at.place(q)
    for some, others in ((points, expected), (expected, points)):  # in single precision
        assert cKDTree(others).query(some)[0].max() < 1e-7
    np.testing.assert_allclose(
        np.asarray(drawn["colors"]).reshape(-1, 4)[:, :3], [[0.1, 0.2, 0.9]] * len(points), atol=1e-6
    )
    ep.CreatePartitionView(mbs, [item])
    assert not mbs.GetObject(item["oFFRFreducedOrder"])["Vshow"]


def test_offset_markers_are_fixed_to_their_interfaces(arm, arm_body, frame):
    """Places, and forces by virtual work: an offset force is the force and its moment on the interface."""
    interfaces, force, found = arm[1].interfaces, np.array([3.0, -2.0, 1.0]), []
    for offset in (False, True):
        mbs = exu.SystemContainer().AddSystem()
        offsets = {"superElementRigidMarkersOffsets": OFFSETS} if offset else {}
        item = ep.CreatePartitionBody(mbs, arm_body, frame=frame, superElement=True, **offsets)
        head = item["head"]
        place, axes = sensors(mbs, head, [KIND.Position, KIND.RotationMatrix])
        mbs.AddLoad(exu.itemInterface.LoadForceVector(markerNumber=head, loadVector=force))
        if not offset:
            moment = np.cross(OFFSETS[1], force)
            mbs.AddLoad(exu.itemInterface.LoadTorqueVector(markerNumber=head, loadVector=moment))
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=2e-5, step=5e-7)
        found.append((item.coordinates(result), result.sensor(place), result.sensor(axes).reshape(-1, 3, 3)))
    (q, x, _), (q_offset, x_offset, A) = found
    assert relative(q_offset, q) < 1e-5
    assert interfaces[1].name == "head"
    assert abs((A - A[0]) @ OFFSETS[1]).max() > 1e-6
    np.testing.assert_allclose(x_offset - A @ OFFSETS[1], x, atol=1e-9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"referenceRotation": np.eye(3), "referenceRotationMatrix": np.eye(3)},
            "another name of referenceR",
        ),
        ({"referencePosition": [0, 0, 1], "positionRef": [0, 0, 0]}, "positionRef: is another name of referencePos"),
        ({"referencePosition": [0, 0]}, r"referencePosition: expected shape \(3,\)"),
        ({"referenceRotationMatrix": np.eye(3)}, "referenceRotationMatrix: an inertial frame keeps"),
        ({"referenceRotationMatrix": 2 * np.eye(3), "frame": "floating"}, "referenceRotationMatrix: expected a rotat"),
        ({"damping": 0.1, "massProportionalDamping": 1.0}, "damping: expected one kind .* massProportionalDamping"),
        ({"stiffnessProportionalDamping": -1e-9}, "stiffnessProportionalDamping: expected a finite number, zero or"),
        ({"massProportionalDamping": "x"}, "massProportionalDamping: expected a finite number"),
        ({"color": (1, 0, 0, 1)}, "color: has no effect without superElement=True"),
        ({"color": (1, 0, 0), "superElement": True}, r"color: expected shape \(4,\)"),
        ({"color": (2, 0, 0, 1), "superElement": True}, "color: expected red, green, blue"),
        ({"superElementRigidMarkersOffsets": OFFSETS}, "superElementRigidMarkersOffsets: has no effect without"),
        ({"superElementRigidMarkersOffsets": OFFSETS[:1], "superElement": True}, r"Offsets: expected shape \(2, 3\)"),
    ],
)
def test_what_does_not_fit_is_named(mbs, arm_body, options, message):
    before = mbs.systemData.NumberOfNodes()
    with pytest.raises(InputError, match=message):
        ep.CreatePartitionBody(mbs, arm_body, **options)
    assert mbs.systemData.NumberOfNodes() == before


def test_plastic_states_of_a_user_are_copied(mbs, yielding):
    """What changed after CreatePartitionBody had changed the run."""
    points = len(ZoneMotion.of(InertialKinematics(yielding, np.zeros(3)), 0).zone)
    state = PlasticState(np.full((points, 6), 1e-3), np.full(points, 2e-3), np.zeros((points, 6)))
    item = ep.CreatePartitionBody(mbs, yielding, plasticStates={0: state})
    for array in (state.strain, state.equivalent, state.back):
        array[:] = 7.0  # still the user's own
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
    ((_, zone),) = contact.plastic.zones
    assert (zone.start.strain == 1e-3).all()
    assert (zone.start.equivalent == 2e-3).all()
    assert not zone.start.back.any()


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_wrong_plastic_states_leave_the_model_as_it_is(mbs, yielding, frame):
    """A body without them was left in the model, with nodes, sensors and no name of its own any more."""
    before = mbs.systemData.NumberOfObjects(), mbs.systemData.NumberOfNodes()
    with pytest.raises(InputError, match="plasticStates"):
        ep.CreatePartitionBody(mbs, yielding, name="plate", frame=frame, plasticStates={0: None})
    assert (mbs.systemData.NumberOfObjects(), mbs.systemData.NumberOfNodes()) == before
    ep.CreatePartitionBody(mbs, yielding, name="plate", frame=frame)  # the name is free
