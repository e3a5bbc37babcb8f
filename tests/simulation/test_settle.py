"""Bodies that come to rest under their weight: what is beneath carries it, and nothing moves afterwards."""

import itertools
import logging
import warnings

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import InputError, ModelLimitWarning, RunError

G = 9.81
GRAVITY = (0.0, 0.0, -G)


def rest(mbs, **options):
    """Settle, without the word that a ball at rest touches by less than a facet."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelLimitWarning)
        return ep.settle(mbs, **options)


def run(mbs, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelLimitWarning)
        return ep.solve_dynamic(mbs, end_time=0.1e-3, **options)


@pytest.mark.parametrize("frame", ["inertial", "floating"])
@pytest.mark.parametrize(("gap", "method"), [(0.0, "explicit"), (2e-3, "implicit")])
def test_a_ball_rests_on_a_plane(mbs, round_body, frame, gap, method):
    bottom = round_body.points[:, 2].min()
    ball = ep.CreatePartitionBody(
        mbs, round_body, gravity=GRAVITY, frame=frame, referencePosition=[0.1, 0, gap - bottom]
    )
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane())
    mbs.Assemble()
    static, weight = rest(mbs), G * round_body.total_mass
    assert contact.force(static)[-1] == pytest.approx(weight, rel=1e-6)
    result = run(mbs, method=method)
    np.testing.assert_allclose(contact.force(result), weight, rtol=1e-4)
    motion = ball.kinematics.rigid_motion(ball.coordinates(result))
    assert abs(motion[:, 2] + gap).max() < 1e-6  # it has fallen; its lowest facets are below their mean gap
    fall = G * (0.1e-3) ** 2 / 2  # what a body without support would do
    assert np.ptp(motion[:, :3], axis=0).max() < 1e-3 * fall
    assert abs(motion[0, :2]).max() < 1e-6  # it stays where it was placed


@pytest.mark.parametrize("friction", [None, 0.3])
def test_a_flat_body_stands(mbs, standing, friction):
    block = ep.CreatePartitionBody(mbs, standing, gravity=GRAVITY, referencePosition=[0, 0, 1e-3])
    contact = ep.CreatePartitionContact(mbs, block, ep.RigidPlane(), friction=friction)
    mbs.Assemble()
    ep.settle(mbs)
    result = ep.solve_dynamic(mbs, end_time=0.1e-3)
    np.testing.assert_allclose(contact.force(result), G * standing.total_mass, rtol=1e-5)
    assert np.ptp(block.kinematics.rigid_motion(block.coordinates(result)), axis=0).max() < 1e-12


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_a_body_with_markers_settles(mbs, block, standing, frame):
    """Its markers check in each run that the user changed nothing; the springs of `settle` are no change."""
    head = ep.Partition.interface(block, "head", plane=((0, 0, 0.03), (0, 0, 1)))
    body = ep.reduce(block, standing.partition | head, f_cut=80e3)
    item = ep.CreatePartitionBody(mbs, body, gravity=GRAVITY, frame=frame, referencePosition=[0, 0, 1e-3])
    place, weight = exu.OutputVariableType.Position, G * body.total_mass
    marker = item.CreateInterfaceMarker(mbs, "head")
    mbs.AddSensor(items.SensorMarker(markerNumber=marker, outputVariableType=place, storeInternal=True))
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
    mbs.Assemble()
    assert contact.force(ep.settle(mbs))[-1] == pytest.approx(weight, rel=1e-6)
    result = ep.solve_dynamic(mbs, end_time=0.1e-3)
    np.testing.assert_allclose(contact.force(result), weight, rtol=1e-4)


def test_what_stands_on_another_falls_with_it(mbs, kept_pair):
    """The lower contact carries both weights, the upper one that of the upper ball."""
    body, radius = kept_pair
    low = ep.CreatePartitionBody(mbs, body, gravity=GRAVITY, referencePosition=[0, 0, radius + 1e-4])
    high = ep.CreatePartitionBody(mbs, body, gravity=GRAVITY, referencePosition=[0, 0, 3 * radius + 3e-4])
    floor = ep.CreatePartitionContact(mbs, low, ep.RigidPlane(), slavePatch="south")
    between = ep.CreatePartitionContact(mbs, low, high, slavePatch="north", masterPatch="south")
    mbs.Assemble()
    static, weight = rest(mbs), G * body.total_mass
    assert floor.force(static)[-1] == pytest.approx(2 * weight, rel=1e-3)
    assert between.force(static)[-1] == pytest.approx(weight, rel=1e-3)
    fallen = [item.kinematics.rigid_motion(item.coordinates(static))[-1, 2] for item in (low, high)]
    np.testing.assert_allclose(fallen, [-1e-4, -3e-4], atol=1e-6)


def upright(width, depth, height, maxh):
    """A block with its bottom and top as patches."""
    shape = occ.Box((-width / 2, -depth / 2, 0), (width / 2, depth / 2, height))
    shape.faces.Min(occ.Z).name, shape.faces.Max(occ.Z).name = "bottom", "top"
    fem = ep.fe_model(shape, ep.STEEL, maxh=maxh)
    bottom, top = (ep.Partition.surface(fem, face, name=face, axes="xyz") for face in ("bottom", "top"))
    return ep.reduce(fem, bottom | top, f_cut=60e3)


@pytest.mark.parametrize("friction", [None, 0.3])
def test_a_small_block_on_a_larger_one_settles_at_once(mbs, friction, caplog):
    """The load on the floor moves the top of the lower block; the small one must not seem to lift off by that."""
    lower, upper = upright(15e-3, 15e-3, 20e-3, 6e-3), upright(12e-3, 10e-3, 8e-3, 5e-3)
    options = {"frame": "floating", "gravity": GRAVITY}
    column = ep.CreatePartitionBody(mbs, lower, **options)
    cap = ep.CreatePartitionBody(
        mbs, upper, referencePosition=[1e-3, 0, 20e-3], referenceRotationMatrix=about_z(0.3), **options
    )
    floor = ep.CreatePartitionContact(mbs, column, ep.RigidPlane(), slavePatch="bottom", friction=friction)
    seam = ep.CreatePartitionContact(mbs, cap, column, slavePatch="bottom", masterPatch="top", friction=friction)
    mbs.Assemble()
    with caplog.at_level(logging.INFO, logger="exudyn_partition"):
        static = rest(mbs)
    assert "again" not in caplog.text
    weight = G * upper.total_mass
    assert seam.force(static)[-1] == pytest.approx(weight, rel=1e-5)
    assert floor.force(static)[-1] == pytest.approx(weight + G * lower.total_mass, rel=1e-5)


@pytest.fixture(scope="module")
def cube():
    """A cube of 10 mm with patches below and on top."""
    fem = ep.fe_model(occ.Box((-5e-3, -5e-3, 0), (5e-3, 5e-3, 10e-3)), ep.STEEL, maxh=4e-3)
    foot, head = (
        ep.Partition.ball(fem, (0, 0, z), 6e-3, direction=(0, 0, sign), axes="xyz", name=name)
        for z, sign, name in ((0.0, -1, "foot"), (10e-3, 1, "head"))
    )
    return ep.reduce(fem, foot | head, f_cut=50e3)


@pytest.mark.parametrize("tilt", [0.0, 0.7])
def test_supports_of_a_stack_carry_its_weight_wherever_it_stands(mbs, cube, tilt):
    """Faces as stiff as these turn the rounding of a place 1 m from the origin into 1e-5 of a cube's weight."""
    axes = about_z(0.4) if not tilt else Rotation.from_rotvec([tilt, 0.3, 0.2]).as_matrix()
    up, place = axes[:, 2], np.array([0.8, -0.3, 1.1])
    bodies = [
        ep.CreatePartitionBody(
            mbs, cube, frame="floating", gravity=-G * up, name=f"cube {i}",
            referencePosition=place + axes @ [3e-4 * i, -2e-4 * i, 10e-3 * i], referenceRotationMatrix=axes,
        )
        for i in range(3)
    ]  # fmt: skip
    floor = ep.RigidPlane(point=place, normal=up)
    faces = [ep.CreatePartitionContact(mbs, bodies[0], floor, slavePatch="foot", friction=0.4)] + [
        ep.CreatePartitionContact(mbs, upper, lower, slavePatch="foot", masterPatch="head", friction=0.4)
        for lower, upper in itertools.pairwise(bodies)
    ]
    mbs.Assemble()
    static = ep.solve_static(mbs, load_steps=1)
    weight = G * cube.total_mass
    for face, above in zip(faces, (3, 2, 1), strict=True):
        np.testing.assert_allclose(face.force_on_slave(static)[-1], above * weight * up, atol=4e-7 * weight)


def test_stacked_cubes_stay_at_rest_in_the_steps_that_follow(mbs, cube):
    """Rows of the upper one reach past the edge of the lower, and steps find them as statics did."""
    options = {"frame": "floating", "gravity": (0.0, 0.0, -500 * G)}
    lower, upper = (
        ep.CreatePartitionBody(mbs, cube, referencePosition=place, **options) for place in ([0, 0, 0], [1e-3, 0, 10e-3])
    )
    floor = ep.CreatePartitionContact(mbs, lower, ep.RigidPlane(), slavePatch="foot", friction=0.3)
    seam = ep.CreatePartitionContact(mbs, upper, lower, slavePatch="foot", masterPatch="head", friction=0.3)
    mbs.Assemble()
    ep.solve_static(mbs, load_steps=1)
    result = ep.solve_dynamic(mbs, end_time=20e-6, step=2e-6, method="implicit", go_on=True)
    weight = 500 * G * cube.total_mass
    for contact, above in ((floor, 2), (seam, 1)):
        forces = contact.force_on_slave(result)
        np.testing.assert_allclose(forces, np.tile([0, 0, above * weight], (len(forces), 1)), atol=2e-5 * weight)


@pytest.mark.parametrize("angle", [8.0, 20.0])
def test_stacked_cubes_that_are_turned_begin_steps_with_the_forces_of_statics(mbs, cube, angle):
    """Flexibilities found at an anchor took points a little past the lower one's edge on the edge, not beyond it."""
    options = {"frame": "floating", "gravity": (0.0, 0.0, -500 * G)}
    lower = ep.CreatePartitionBody(mbs, cube, **options)
    options |= {"referencePosition": [9e-4, 7e-4, 10e-3], "referenceRotationMatrix": about_z(np.radians(angle))}
    upper = ep.CreatePartitionBody(mbs, cube, **options)
    ep.CreatePartitionContact(mbs, lower, ep.RigidPlane(), slavePatch="foot", friction=0.3)
    seam = ep.CreatePartitionContact(mbs, upper, lower, slavePatch="foot", masterPatch="head", friction=0.3)
    mbs.Assemble()
    ep.solve_static(mbs, load_steps=1, update_initial=True)
    result = ep.solve_dynamic(mbs, end_time=8e-6, step=2e-6, method="implicit")
    np.testing.assert_allclose(seam.force(result), 500 * G * cube.total_mass, rtol=1e-7)


def about_z(angle):
    """Rotation about the z axis, (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def test_a_striker_keeps_its_place_and_speed(mbs, kept_pair):
    body, radius = kept_pair
    low = ep.CreatePartitionBody(mbs, body, gravity=GRAVITY, referencePosition=[0, 0, radius])
    striker = ep.CreatePartitionBody(
        mbs, body, gravity=GRAVITY, referencePosition=[0, 0, 3 * radius + 1e-3], initialVelocity=[0, 0, -0.5]
    )
    floor = ep.CreatePartitionContact(mbs, low, ep.RigidPlane(), slavePatch="south")
    ep.CreatePartitionContact(mbs, low, striker, slavePatch="north", masterPatch="south")
    mbs.Assemble()
    rest(mbs)
    result = run(mbs)
    np.testing.assert_allclose(floor.force(result), G * body.total_mass, rtol=1e-4)
    motion = striker.kinematics.rigid_motion(striker.coordinates(result))[:, 2]
    np.testing.assert_allclose(motion, -0.5 * result.t - G * result.t**2 / 2, atol=1e-9)  # its weight is back


@pytest.mark.parametrize("weight", [{}, {"gravity": GRAVITY}])
@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_a_load_on_a_striker_does_not_matter(mbs, kept_pair, frame, weight):
    """Nothing carries it, so that the statics of all bodies had no equilibrium."""
    body, radius = kept_pair
    low = ep.CreatePartitionBody(mbs, body, gravity=GRAVITY, referencePosition=[0, 0, radius])
    above = {"referencePosition": [0, 0, 4 * radius], "initialVelocity": [0, 0, -0.5], "frame": frame}
    striker = ep.CreatePartitionBody(mbs, body, **weight, **above)
    floor = ep.CreatePartitionContact(mbs, low, ep.RigidPlane(), slavePatch="south")
    load = 0.1 * G * body.total_mass
    mbs.AddLoad(items.Force(markerNumber=striker.CreatePointMarker(mbs, (0, 0, radius)), loadVector=[load, 0, -load]))
    mbs.Assemble()
    static = rest(mbs)
    np.testing.assert_allclose(floor.force(static)[-1], G * body.total_mass, rtol=1e-4)
    result = run(mbs)
    speed = striker.kinematics.momentum(striker.coordinates_t(result)) / body.total_mass
    fall = 0.1 * G + (G if weight else 0.0)
    np.testing.assert_allclose(speed[:, 2], -0.5 - fall * result.t, atol=1e-6)
    np.testing.assert_allclose(speed[:, 0], 0.1 * G * result.t, atol=1e-6)


def test_what_cannot_rest_is_refused_and_the_model_stays_as_it_was(mbs, round_body):
    slope = np.array([0.3, 0.0, 1.0]) / np.hypot(0.3, 1.0)
    ball = ep.CreatePartitionBody(mbs, round_body, gravity=GRAVITY, referencePosition=[0, 0, 1e-3])
    lowest = round_body.points[:, 2].min()
    ep.CreatePartitionContact(mbs, ball, ep.RigidPlane((0, 0, lowest), slope))
    mbs.Assemble()
    kind = exu.ConfigurationType.Initial
    before = mbs.systemData.GetODE2Coordinates(kind)
    with pytest.raises(RunError, match="would slide, roll or tip over"):
        rest(mbs)
    np.testing.assert_array_equal(mbs.systemData.GetODE2Coordinates(kind), before)
    fall = ep.solve_dynamic(mbs, end_time=1e-5, step=1e-6, method="implicit")
    expected = ball.energy(fall)  # no spring is left behind: it falls freely
    assert expected[-1] == pytest.approx(0.5 * round_body.total_mass * (G * 1e-5) ** 2, rel=1e-3)


@pytest.mark.parametrize("steeper", [-2e-3, 2e-3])
def test_a_slope_too_steep_for_friction_by_a_little_is_told(mbs, standing, steeper):
    """What friction lacks, some thousandths of the weight, the springs of `settle` take, and the run has none."""
    mu = 0.2
    angle = np.arctan(mu) + steeper
    weight = G * np.array([-np.sin(angle), 0.0, -np.cos(angle)])  # the slope is drawn level
    block = ep.CreatePartitionBody(mbs, standing, name="block", gravity=weight)
    contact = ep.CreatePartitionContact(mbs, block, ep.RigidPlane(), friction=mu)
    mbs.Assemble()
    if steeper < 0:
        static = ep.settle(mbs)
    else:
        with pytest.warns(ModelLimitWarning, match=r"body 'block' does not quite rest.* 0.20% of its weight"):
            static = ep.settle(mbs)
    missing = np.linalg.norm(contact.force_on_slave(static)[-1] / standing.total_mass + weight) / G
    assert missing == pytest.approx(max(np.sin(angle) - mu * np.cos(angle), 0.0), rel=0.1, abs=1e-6)


def test_wrong_calls(mbs, round_body):
    plain = exu.SystemContainer().AddSystem()
    ep.CreatePartitionBody(plain, round_body)
    plain.Assemble()
    with pytest.raises(InputError, match="no body has a weight"):
        ep.settle(plain)
    item = ep.CreatePartitionBody(mbs, round_body, gravity=GRAVITY)
    flying = ep.CreatePartitionBody(mbs, round_body, gravity=GRAVITY, initialVelocity=[0, 0, 1])
    light = ep.CreatePartitionBody(mbs, round_body)
    mbs.Assemble()
    with pytest.raises(InputError, match="nothing lies beneath"):
        ep.settle(mbs, [item])
    with pytest.raises(InputError, match="moves at the start"):
        ep.settle(mbs, [flying])
    with pytest.raises(InputError, match="has no weight"):
        ep.settle(mbs, [light])
    with pytest.raises(InputError, match="bodies"):
        ep.settle(mbs, [3])


@pytest.fixture(scope="module")
def standing(block):
    """A steel block, 30 mm high, whose lower face is its patch."""
    foot = ep.Partition.ball(block, (0, 0, 0), 0.012, direction=(0, 0, -1), axes="xyz")
    return ep.reduce(block, foot, f_cut=80e3)


@pytest.fixture(scope="module")
def kept_pair(marble):
    """A marble with patches at both poles, and its radius [m]."""
    return marble, float(marble.points[:, 2].max())


@pytest.fixture(scope="module")
def tripod():
    """A plate on three round feet, and the feet's places, (3, 3) [m]."""
    feet = np.array([(-0.015, -0.015, -0.004), (0.015, -0.015, -0.004), (0.0, 0.015, -0.004)])
    shape = occ.Box((-0.02, -0.02, 0), (0.02, 0.02, 0.01))
    for x, y, _ in feet:
        shape += occ.Sphere(occ.Pnt(x, y, 0), 0.004)
    fem = ep.fe_model(shape, ep.STEEL, maxh=2e-2, refine=[ep.Refine(tuple(p), radius=1e-3, h=1e-3) for p in feet])
    patches = [ep.Partition.ball(fem, tuple(p), 1.5e-3, name=f"{i}") for i, p in enumerate(feet)]
    return ep.reduce(fem, patches[0] | patches[1] | patches[2], f_cut=20e3), feet


def on_supports(mbs, body, heights):
    """The plate above three supports of some heights [m], and its contacts."""
    plate = ep.CreatePartitionBody(mbs, body, gravity=GRAVITY, frame="floating", referencePosition=[0, 0, 1e-4])
    return plate, [
        ep.CreatePartitionContact(mbs, plate, ep.RigidPlane((0, 0, height - 0.004)), slavePatch=str(i), name=f"{i}")
        for i, height in enumerate(heights)
    ]


def test_a_plate_tips_until_it_stands_on_three_supports(mbs, tripod):
    """It falls on the highest one, and would be thrown about on that alone. Forces are those of the levers."""
    body, feet = tripod
    _, supports = on_supports(mbs, body, (0.0, 20e-6, 60e-6))
    mbs.Assemble()
    static = rest(mbs)
    forces = np.array([support.force_on_slave(static)[-1] for support in supports])
    weight = G * body.total_mass
    expected = np.linalg.solve(np.vstack([np.ones(3), feet[:, :2].T]), [weight, 0, 0])
    np.testing.assert_allclose(forces[:, 2], expected, rtol=0.05)  # a foot bears at nodes beside its tip
    assert forces.sum(axis=0) == pytest.approx([0, 0, weight], abs=1e-4 * weight)


@pytest.mark.parametrize("load", [0.05, 100.0])
def test_a_load_does_not_hold_a_body(mbs, tripod, load):
    """It is beside the triangle of the feet. The plate did not fall for it, and found no rest under a small one."""
    body, feet = tripod
    plate, supports = on_supports(mbs, body, (0.0, 20e-6, 60e-6))
    x, y = place = np.array([0.019, 0.015])
    marker = plate.CreatePointMarker(mbs, (x, y, 0.01))
    mbs.AddLoad(items.Force(markerNumber=marker, loadVector=[0, 0, -load]))
    mbs.Assemble()
    weight = G * body.total_mass
    expected = np.linalg.solve(np.vstack([np.ones(3), feet[:, :2].T]), [weight + load, *load * place])
    if expected.min() < 0:
        with pytest.raises(RunError, match="tips over"):
            rest(mbs)
        return
    static = rest(mbs)
    forces = [support.force(static)[-1] for support in supports]
    np.testing.assert_allclose(forces, expected, rtol=0.05)
    assert sum(forces) == pytest.approx(weight + load, rel=1e-6)


@pytest.mark.parametrize("aside", [0.0, 50e-6])
def test_a_ball_comes_to_lie_in_a_hollow_between_three(mbs, aside):
    """Without friction it must move aside from the first one that it touches, to where all three carry it."""
    large, small, out = 0.02, 0.01, 0.024
    angles = 0.3 + np.arange(3) * 2 * np.pi / 3
    centres = out * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(3)])
    height = np.sqrt((large + small) ** 2 - out**2)
    places = (centres - [0, 0, height]) * small / (large + small)
    refine = [ep.Refine(tuple(place), radius=1e-3, h=0.7e-3) for place in places]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), small), ep.STEEL, maxh=8e-3, refine=refine)
    patches = [ep.Partition.ball(fem, tuple(place), 1.2e-3, name=f"{i}") for i, place in enumerate(places)]
    body = ep.reduce(fem, patches[0] | patches[1] | patches[2], f_cut=50e3)
    ball = ep.CreatePartitionBody(mbs, body, gravity=GRAVITY, referencePosition=[aside, 0, height + 1e-4])
    contacts = [
        ep.CreatePartitionContact(mbs, ball, ep.RigidSphere(tuple(centre), large), slavePatch=str(i))
        for i, centre in enumerate(centres)
    ]
    mbs.Assemble()
    static, weight = rest(mbs), G * body.total_mass
    carried = (large + small) / height / 3  # by each, along the line of centres
    np.testing.assert_allclose([contact.force(static)[-1] / weight for contact in contacts], carried, rtol=0.02)
    total = sum(contact.force_on_slave(static)[-1] for contact in contacts)
    np.testing.assert_allclose(total, [0, 0, weight], atol=1e-3 * weight)
    place = ball.rigid_motion(ball.coordinates(static))[-1, :3]
    np.testing.assert_allclose(place, [-aside, 0, -1e-4], atol=2e-5)  # rows are means around nodes


@pytest.mark.parametrize("gap", [0.0, 1e-6])
def test_a_joint_that_is_open_is_told(mbs, arm_body, standing, gap):
    """As statics tell; a body that settles beside it is of no account."""
    block = ep.CreatePartitionBody(mbs, standing, gravity=GRAVITY, referencePosition=[1, 0, 1e-3])
    ep.CreatePartitionContact(mbs, block, ep.RigidPlane())
    arm = ep.CreatePartitionBody(mbs, arm_body, gravity=GRAVITY, referencePosition=[gap, 0, 0])
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground, arm.CreateInterfaceMarker(mbs, "foot")]))
    mbs.Assemble()
    if gap:
        with pytest.warns(ModelLimitWarning, match=r"JointGeneric .* is open by 1e-06 .* position="):
            ep.settle(mbs)
    else:
        ep.settle(mbs)


def test_bodies_settle_in_a_model_with_a_work_sensor(mbs, round_body):
    """One that flies has no weight meanwhile: its sensor took that for an item that is gone."""
    radius = -round_body.points[:, 2].min()
    options = {"gravity": GRAVITY, "referencePosition": [0, 0, radius + 1e-5]}
    resting = ep.CreatePartitionBody(mbs, round_body, name="resting", **options)
    flying = ep.CreatePartitionBody(mbs, round_body, name="flying", gravity=GRAVITY, initialVelocity=[0, 0, 1.0])
    ep.CreatePartitionContact(mbs, resting, ep.RigidPlane())
    work = ep.CreateWorkSensor(mbs)
    mbs.Assemble()
    rest(mbs)
    result = run(mbs)
    risen = flying.rigid_motion(flying.coordinates(result))[:, 2]
    expected = -G * round_body.total_mass * (risen - risen[0])
    np.testing.assert_allclose(work.work(result)["gravity on flying"], expected, atol=1e-8 * abs(expected).max())
