"""Natural modes at a preload: springs and flexibility by hand, differences of forces, joints, and what is refused."""

import warnings

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
import scipy.linalg
from exudyn.utilities import RigidBodyInertia
from oracles import add_loads, add_springs
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import ModelLimitWarning, RunError

FORCE = 50.0


def pressed(mbs, round_body, friction=0.5):
    """A ball that springs hold, with loads that press it on a plane and aside: some rows will slip and others stick."""
    item = ep.CreatePartitionBody(mbs, round_body, name="ball")
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), name="floor", friction=friction)
    K = add_springs(mbs, item, np.diag([1e5, 1e7, 1e5, 1e3, 1e3, 1e3]))
    for axis, force in ((2, 10 * FORCE), (0, 4 * friction * FORCE)):
        load = np.asarray(item.body.mass @ item.body.rigid)[:, axis] * -force / item.body.total_mass
        add_loads(mbs, item, load)
    mbs.Assemble()
    return item, contact, K


@pytest.fixture
def held(mbs, round_body, request):
    """The ball after a preload, and its result."""
    item, contact, K = pressed(mbs, round_body, getattr(request, "param", 0.5))
    result = ep.solve_static(mbs, load_steps=2, update_initial=True)
    assert 0 < contact.friction.stuck_rows(result)[-1] < np.count_nonzero(contact.friction.states(result)[-1])
    return item, contact, K, result


def frequencies(K, item):
    squares = scipy.linalg.eigh((K + K.T) / 2, item.body.mass.toarray(), eigvals_only=True)
    return np.sign(squares) * np.sqrt(abs(squares)) / (2 * np.pi)


@pytest.mark.parametrize("held", [0.5, 0.02], indirect=True)
def test_closed_rows_stick(mbs, held):
    """Stiffness by hand: springs and modes, and the inverse of the flexibility of all closed rows."""
    item, contact, K, result = held
    rows = contact.mechanics.for_run("static").rows
    rows.gaps.at(item.coordinates(result)[-1])
    closed = np.flatnonzero(np.isin(rows.gaps.row_nodes, np.flatnonzero(contact.friction.states(result)[-1])))
    H, F = rows.jacobian(closed), rows.flexibility(closed)
    H = H.toarray() if hasattr(H, "toarray") else H
    right = frequencies(item.body.stiffness.toarray() + K + H.T @ np.linalg.solve(F, H), item)
    found, modes = ep.natural_modes(mbs)
    np.testing.assert_allclose(found, right, rtol=1e-5)
    np.testing.assert_allclose(modes.T @ item.body.mass @ modes, np.eye(len(found)), atol=1e-8)
    assert (ep.natural_modes(mbs, slipping=True)[0] / right).min() < 0.99


def test_exudyn_reads_half_of_what_slips_and_says_so(mbs, held):
    """The symmetric part of the whole stiffness has the modes of `slipping`; one triangle has not."""
    with pytest.warns(ModelLimitWarning, match="contact 'floor': rows slip, so that the stiffness is not symmetric"):
        [M, K, _] = mbs.ComputeLinearizedSystem()
    squares = scipy.linalg.eigh((K + K.T) / 2, M, eigvals_only=True)
    found, _ = ep.natural_modes(mbs, slipping=True)
    np.testing.assert_allclose(found, np.sqrt(squares) / (2 * np.pi), rtol=1e-6)
    ep.natural_modes(mbs)
    np.testing.assert_allclose(ep.natural_modes(mbs, slipping=True)[0], found, rtol=1e-6)


def test_exudyn_says_so_after_its_own_solver_too(mbs, round_body):
    """The stiffness within a run warns of nothing; the one after it does, until another run begins."""
    pressed(mbs, round_body)
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.staticSolver.numberOfLoadSteps = settings.timeIntegration.numberOfSteps = 2
    settings.timeIntegration.endTime = 1e-6
    for _ in range(2):
        with warnings.catch_warnings():
            warnings.simplefilter("error", ModelLimitWarning)
            mbs.SolveDynamic(settings)
            mbs.SolveStatic(settings, updateInitialValues=True)
        with pytest.warns(ModelLimitWarning, match="contact 'floor': rows slip"):
            mbs.ComputeODE2Eigenvalues()


def test_masses_on_a_joint(mbs):
    """A mass on a spring, another on a stiffer one; a joint makes both move as one."""
    ground = mbs.CreateGround()
    masses = [mbs.CreateMassPoint(referencePosition=[0, 0, z], mass=m) for z, m in ((0, 2.0), (1, 3.0))]
    for mass, k in zip(masses, (1e4, 5e4), strict=True):
        mbs.CreateCartesianSpringDamper(itemNumbers=[ground, mass], stiffness=[k] * 3, localPosition0=[0, 0, 0])
    one, other = (
        mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.GetObject(mass)["nodeNumber"], coordinate=0))
        for mass in masses
    )
    mbs.AddObject(items.CoordinateConstraint(markerNumbers=[one, other]))
    mbs.Assemble()
    found, modes = ep.natural_modes(mbs)
    assert "staticSolver" not in mbs.sys  # no run was made
    right = np.sort(np.sqrt([1e4 / 2, 1e4 / 2, 5e4 / 3, 5e4 / 3, 6e4 / 5])) / (2 * np.pi)
    np.testing.assert_allclose(found, right, rtol=1e-9)
    np.testing.assert_allclose(modes[0], modes[3], atol=1e-12)
    np.testing.assert_allclose(modes.T @ np.diag([2.0] * 3 + [3.0] * 3) @ modes, np.eye(5), atol=1e-12)


def test_an_unstable_motion_has_a_negative_frequency(mbs):
    """A mass on springs, one of which pushes it away."""
    mass = mbs.CreateMassPoint(physicsMass=2.0)
    mbs.CreateCartesianSpringDamper(itemNumbers=[mbs.CreateGround(), mass], stiffness=[1e4, -3e4, 2e4])
    mbs.Assemble()
    found, modes = ep.natural_modes(mbs)
    np.testing.assert_allclose(found, [-np.sqrt(3e4 / 2) / (2 * np.pi), *np.sqrt([1e4 / 2, 2e4 / 2]) / (2 * np.pi)])
    np.testing.assert_allclose(abs(modes), np.eye(3)[:, [1, 0, 2]] / np.sqrt(2.0), atol=1e-12)


def test_what_has_no_modes_is_refused(mbs, bodies, pair_of):
    with pytest.raises(RunError, match="not assembled"):
        ep.natural_modes(mbs)
    item = ep.CreatePartitionBody(mbs, pair_of("craig-bampton")[0])
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation="lagrange", name="floor")
    mbs.Assemble()
    with pytest.raises(RunError, match="contact 'floor': multipliers have no stiffness"):
        ep.natural_modes(mbs)
    other = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(other, bodies[0])
    ep.CreatePartitionContact(other, item, ep.RigidPlane())
    other.Assemble()
    with pytest.raises(RunError, match="slipping: which rows slip is known only after solve_static"):
        ep.natural_modes(other, slipping=True)


def test_rows_slip_only_in_the_state_that_statics_have_found(mbs, held):
    data, initial = mbs.systemData, exu.ConfigurationType.Initial
    ep.natural_modes(mbs, slipping=True)
    data.SetODE2Coordinates(0.5 * np.array(data.GetODE2Coordinates(initial)), initial)
    with pytest.raises(RunError, match="slipping: which rows slip is known only after solve_static"):
        ep.natural_modes(mbs, slipping=True)


def test_coordinates_of_first_order_are_refused(mbs):
    mbs.CreateMassPoint(physicsMass=1.0)
    node = mbs.AddNode(
        items.NodeGenericODE1(referenceCoordinates=[0], initialCoordinates=[0], numberOfODE1Coordinates=1)
    )
    mbs.AddObject(items.ObjectGenericODE1(nodeNumbers=[node], systemMatrix=[[-1.0]]))
    mbs.Assemble()
    with pytest.raises(RunError, match="first order have no natural modes"):
        ep.natural_modes(mbs)


GRAVITY, RADIUS, BORE = 2e4, 0.01, 0.03  # [m/s2], of a ball and of a round surface [m]


@pytest.fixture(scope="module")
def marble(kept):
    """A ball around the origin that touches beneath, with all three directions, for contact on a coarse mesh."""
    shape = occ.Sphere(occ.Pnt(0, 0, 0), RADIUS)
    fem = ep.fe_model(shape, ep.STEEL, maxh=5e-3, refine=[ep.Refine((0, 0, -RADIUS), 4e-3, 1.2e-3)])
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, -RADIUS), 4e-3, axes="xyz"), f_cut=50e3, cache=kept)


@pytest.fixture(scope="module")
def flat_block(kept):
    """A block of steel that stands on a square, with all three directions."""
    shape = occ.Box(occ.Pnt(-5e-3, -5e-3, 0), occ.Pnt(5e-3, 5e-3, 0.02))
    fem = ep.fe_model(shape, ep.STEEL, maxh=6e-3)
    foot = ep.Partition.surface(fem, plane=((0, 0, 0), (0, 0, -1)), axes="xyz")
    return ep.reduce(fem, foot, f_cut=30e3, cache=kept)


def rolled(friction):
    """Moment of inertia that goes with the way of a ball, by its mass and radius squared."""
    return 0.0 if friction is None else 0.4


def slow(mbs, n):
    """The n lowest frequencies of a ball that rests, after rigid motions that nothing holds."""
    ep.settle(mbs)
    found = ep.natural_modes(mbs)[0]
    lowest = found[abs(found) < 1e3]
    return lowest[np.sort(np.argsort(abs(lowest))[-n:])]


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.YieldWarning")
@pytest.mark.parametrize("friction", [None, 0.5])
@pytest.mark.parametrize(("curvature", "place"), [(1.0, BORE - RADIUS), (-1.0, BORE + RADIUS)])
def test_a_ball_swings_in_a_bore_and_falls_off_a_roller(mbs, marble, friction, curvature, place):
    """As a pendulum of the length between both middles, slower if it rolls: levers and normals of rows turn."""
    item = ep.CreatePartitionBody(mbs, marble, frame="floating", gravity=[0, 0, -GRAVITY])
    round_ = ep.RigidCylinder((0, 0, curvature * place), (0, 1, 0), BORE, hollow=curvature > 0)
    ep.CreatePartitionContact(mbs, item, round_, formulation="hertz", friction=friction)
    mbs.Assemble()
    right = curvature * np.sqrt(GRAVITY / place / (1 + rolled(friction))) / (2 * np.pi)
    np.testing.assert_allclose(slow(mbs, 1), right, rtol=2e-3)


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.YieldWarning")
@pytest.mark.parametrize("friction", [None, 0.5])
def test_a_ball_swings_in_a_bore_that_slides_on_a_spring(mbs, marble, friction):
    """Two coordinates by hand, the way of the block with the bore and the angle of the ball in it."""
    M, k, length, m = 0.1, 2e5, BORE - RADIUS, marble.total_mass
    inertia = RigidBodyInertia(mass=M, inertiaTensor=1e-3 * np.eye(3))
    kind = exu.NodeType.RotationRotationVector
    block = mbs.CreateRigidBody(inertia=inertia, referencePosition=[0, 0, length], nodeType=kind)
    ground = mbs.CreateGround(referencePosition=[0, 0, length])
    markers = [mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body)) for body in (ground, block)]
    mbs.AddObject(items.ObjectJointGeneric(markerNumbers=markers, constrainedAxes=[0, 1, 1, 1, 1, 1]))
    mbs.AddObject(items.CartesianSpringDamper(markerNumbers=markers, stiffness=[k, 0, 0]))
    item = ep.CreatePartitionBody(mbs, marble, frame="floating", gravity=[0, 0, -GRAVITY])
    bore = ep.RigidCylinder((0, 0, 0), (0, 1, 0), BORE, hollow=True)
    ep.CreatePartitionContact(mbs, item, bore, masterBody=block, formulation="hertz", friction=friction)
    mbs.Assemble()
    mass = [[M + m, m * length], [m * length, m * length**2 * (1 + rolled(friction))]]
    squares = scipy.linalg.eigh(np.diag([k, m * GRAVITY * length]), mass, eigvals_only=True)
    np.testing.assert_allclose(slow(mbs, 2), np.sqrt(squares) / (2 * np.pi), rtol=2e-3)


@pytest.mark.parametrize("friction", [None, 0.5])
def test_modes_do_not_depend_on_how_a_scene_is_turned(flat_block, friction):
    """A block that is pressed on a plane; nothing holds it along a smooth one."""
    found = []
    for axis in ([0.0, 0.0, 0.0], [0.4, 0.8, -0.5], [0.0, 2.0, 1.0]):
        mbs, axes = exu.SystemContainer().AddSystem(), Rotation.from_rotvec(axis).as_matrix()
        down = (-GRAVITY * axes[:, 2]).tolist()
        item = ep.CreatePartitionBody(mbs, flat_block, frame="floating", gravity=down, referenceRotationMatrix=axes)
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, 0), axes[:, 2]), friction=friction)
        mbs.Assemble()
        ep.settle(mbs)
        found.append(ep.natural_modes(mbs)[0])
    highest = found[0].max()
    np.testing.assert_allclose(found[1:], [found[0]] * 2, rtol=1e-6, atol=1e-6 * highest)
    assert np.count_nonzero(abs(found[0]) < 1e-6 * highest) == (3 if friction is None else 0)


def resting(mbs, body, place, surface, **options):
    """Frequencies of a body that rests on a surface."""
    item = ep.CreatePartitionBody(mbs, body, name="body", gravity=[0, 0, -GRAVITY], **place)
    ep.CreatePartitionContact(mbs, item, surface, name="floor", **options)
    mbs.Assemble()
    ep.settle(mbs)
    return ep.natural_modes(mbs)[0]


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.YieldWarning")
@pytest.mark.filterwarnings("ignore:contact 'floor' at t = .* rows is closed", "ignore:settle. .* does not quite rest")
@pytest.mark.parametrize("friction", [None, 0.5])
def test_a_ball_on_one_row_falls_over_like_a_pencil_and_says_so(mbs, marble, friction):
    """By hand: the weight on the lowest node; the foot of the pencil is free to slide, or held by friction."""
    with pytest.warns(ModelLimitWarning, match="contact 'floor': a motion is unstable.*Take formulation='hertz'"):
        found = resting(mbs, marble, {"frame": "floating"}, ep.RigidPlane((0, 0, -RADIUS)), friction=friction)
    right = -np.sqrt(GRAVITY / RADIUS / (0.4 + (friction is not None))) / (2 * np.pi)
    np.testing.assert_allclose(found[:2], right, rtol=2e-3)


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.YieldWarning")
@pytest.mark.filterwarnings("ignore:contact 'floor' at t = .* rows is closed", "ignore:settle. .* does not quite rest")
@pytest.mark.parametrize("friction", [None, 0.5])
@pytest.mark.parametrize("formulation", ["hertz", "compliance"])
def test_a_ball_in_an_inertial_frame_says_that_it_does_not_roll(mbs, marble, friction, formulation):
    """The bodies of `test_a_ball_swings_in_a_bore_and_falls_off_a_roller`, whose modes another frame gets wrong."""
    bore = ep.RigidCylinder((0, 0, BORE - RADIUS), (0, 1, 0), BORE, hollow=True)
    with pytest.warns(ModelLimitWarning, match=r"body 'body' has an inertial frame.*'floor'.*Take frame='floating'"):
        resting(mbs, marble, {}, bore, friction=friction, formulation=formulation)


@pytest.mark.parametrize("friction", [None, 0.5])
def test_a_block_has_the_same_modes_in_both_frames(flat_block, friction):
    """It is pressed on its whole face, so that large turns do not matter; warnings would be errors here."""
    found = []
    for frame in ("inertial", "floating"):
        mbs = exu.SystemContainer().AddSystem()
        found.append(resting(mbs, flat_block, {"frame": frame}, ep.RigidPlane(), friction=friction))
    np.testing.assert_allclose(found[0], found[1], rtol=2e-3, atol=1e-4 * found[1].max())
