"""Damping of bodies that joints hold: ratios of their modes, rigid motion, energy, other joints in the same model."""

import exudyn as exu
import exudyn.itemInterface as items
import exudyn.utilities
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from oracles import HINGE, by_exudyn, ground, jointed

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.exudyn_bodies.held_damping import hold_damping
from exudyn_partition.exudyn_bodies.joints import mass_and_rows
from exudyn_partition.frames.damping import damping_of

RATIO = 0.02
CLAMP = [1] * 6
END = (0, 0, 0.06)  # place of the arm's head [m]


@pytest.fixture(scope="module", params=["contact-adapted", "residual", "craig-bampton", "free"])
def any_arm(request, arm):
    """The arm in each basis; the free one keeps no nodes, as it has no patch."""
    return ep.reduce(*arm, basis=request.param, f_cut=60e3)


def step_once(mbs, start=0.0):
    """One step of Exudyn's own implicit solver, without a call of this library."""
    settings = exu.SimulationSettings()
    settings.timeIntegration.startTime, settings.timeIntegration.endTime = start, start + 1e-7
    settings.timeIntegration.numberOfSteps = 1
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    mbs.SolveDynamic(settings)


def hold_head(mbs, item, axes, mass=None, rotation=exu.NodeType.RotationRotationVector):
    """Join the head with the ground, or with a rigid body of some mass [kg]."""
    other = ground(mbs, END) if mass is None else on_rigid_body(mbs, END, mass, rotation)
    joint = items.GenericJoint(markerNumbers=[other, item.CreateInterfaceMarker(mbs, "head")], constrainedAxes=axes)
    return mbs.AddObject(joint)


def on_rigid_body(mbs, place, mass, rotation):
    """Marker on a new rigid body."""
    body = mbs.CreateRigidBody(
        referencePosition=list(place),
        inertia=exu.utilities.RigidBodyInertia(mass=mass, inertiaTensor=mass * 1e-4 * np.eye(3)),
        nodeType=rotation,
    )
    return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=[0, 0, 0]))


def ratios(body, D, rows, more_mass=0.0, count=3):
    """Ratios and frequencies [rad/s] of the slowest damped modes of a body whose rows are held, from its matrices."""
    free = scipy.linalg.null_space(rows) if len(rows) else np.eye(body.n_dofs)
    M, K, D = (free.T @ A @ free for A in (body.mass.toarray() + more_mass, body.stiffness.toarray(), D))
    zero, one = np.zeros_like(M), np.eye(len(M))
    values = np.linalg.eigvals(np.block([[zero, one], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]]))
    values = values[values.imag > 1e-3 * body.basis.omega[6]]
    values = values[np.argsort(abs(values))][:count]
    return -values.real / abs(values), abs(values)


def held_by(body, foot, head=(0,) * 6):
    """Rows of the axes that joints hold at both ends."""
    ends = (np.asarray(body.interface_rows(name)) for name in ("foot", "head"))
    return np.vstack([rows[np.array(axes, dtype=bool)] for rows, axes in zip(ends, (foot, head), strict=True)])


@pytest.mark.parametrize(
    ("foot", "head"),
    [(CLAMP, (0,) * 6), (CLAMP, CLAMP), (HINGE, HINGE), (HINGE, (1, 1, 0, 1, 0, 1)), (HINGE, (0,) * 6)],
    ids=["cantilever", "clamped twice", "hinged twice", "hinged and sliding", "pendulum"],
)
def test_modes_of_a_held_body_have_the_ratio(any_arm, foot, head):
    mbs, item, _ = jointed(any_arm, "inertial", foot, damping=RATIO)
    if any(head):
        hold_head(mbs, item, list(head))
    mbs.Assemble()
    step_once(mbs)
    rows = held_by(any_arm, foot, head)
    np.testing.assert_allclose(ratios(any_arm, item.damping.matrix().toarray(), rows)[0], RATIO, rtol=1e-6)
    free = damping_of(item.kinematics, RATIO).matrix().toarray()
    assert ratios(any_arm, free, rows)[0][0] < 0.75 * RATIO  # the ratio of free modes is another one


@pytest.mark.parametrize("rotation", ["RotationRotationVector", "RotationEulerParameters", "RotationRxyz"])
def test_a_shaft_moves_with_the_mass_of_its_flywheel(any_arm, rotation):
    mass = 5 * any_arm.total_mass
    mbs, item, _ = jointed(any_arm, "inertial", damping=lambda f: 1e-4 * f**0.5)
    hold_head(mbs, item, CLAMP, mass, getattr(exu.NodeType, rotation))
    mbs.Assemble()
    step_once(mbs)
    P = np.asarray(any_arm.interface_rows("head"))
    of_wheel = P.T @ np.diag([mass] * 3 + [mass * 1e-4] * 3) @ P
    found, omega = ratios(any_arm, item.damping.matrix().toarray(), held_by(any_arm, CLAMP), of_wheel)
    np.testing.assert_allclose(found, 1e-4 * np.sqrt(omega / (2 * np.pi)), rtol=1e-4)


@pytest.mark.parametrize("rotation", ["RotationRotationVector", "RotationEulerParameters"])
def test_an_arm_moves_with_the_mass_of_exudyn_s_flexible_body(arm, arm_body, rotation):
    """Of the same shape, at its head. It counts as rigid: its first coordinates are its frame's."""
    mbs, item, _ = jointed(arm_body, "inertial", damping=lambda f: 1e-4 * f**0.5)
    foot, _ = by_exudyn(mbs, *arm, arm_body, at=END, node=rotation)
    markers = [item.CreateInterfaceMarker(mbs, "head"), foot]
    mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=CLAMP))
    mbs.Assemble()
    hold_damping(mbs)
    P, of_foot = (np.asarray(arm_body.interface_rows(name)) for name in ("head", "foot"))
    motion = arm_body.rigid @ np.linalg.inv(of_foot @ arm_body.rigid)  # by unit motion of the foot
    more = P.T @ motion.T @ (arm_body.mass @ motion) @ P
    found, omega = ratios(arm_body, item.damping.matrix().toarray(), held_by(arm_body, CLAMP), more, count=5)
    np.testing.assert_allclose(found, 1e-4 * np.sqrt(omega / (2 * np.pi)), rtol=1e-4)


@pytest.mark.parametrize("alpha_share", [0.0, 0.5, 1.0])
def test_rayleigh_damping_has_its_ratios_also_with_kept_nodes(arm, arm_body, alpha_share):
    link, ends = arm
    foot = ep.Partition.interface(link, "foot", ends.find_interface("foot").nodes)
    nodal = ep.reduce(link, foot | ep.Partition.ball(link, END, 4e-3), basis="free", f_cut=60e3)
    assert len(nodal.basis.nodal)
    for body in (arm_body, nodal):
        first = 2 * np.pi * 3e3
        rayleigh = ep.Rayleigh(alpha_share * 2 * RATIO * first, (1 - alpha_share) * 2 * RATIO / first)
        mbs, item, _ = jointed(body, "inertial", damping=rayleigh)
        mbs.Assemble()
        step_once(mbs)
        rows = np.asarray(body.interface_rows("foot"))
        found, omega = ratios(body, item.damping.matrix().toarray(), rows)
        np.testing.assert_allclose(found, rayleigh.alpha / (2 * omega) + rayleigh.beta * omega / 2, rtol=2e-3)


def test_ratios_in_order_are_of_the_held_modes_first(arm_body):
    given = np.linspace(0.001, 0.05, arm_body.n_dofs - 6)
    mbs, item, _ = jointed(arm_body, "inertial", damping=given)
    mbs.Assemble()
    step_once(mbs)
    found, omega = ratios(arm_body, item.damping.matrix().toarray(), held_by(arm_body, CLAMP))
    np.testing.assert_allclose(found, given[:3], rtol=1e-6)
    np.testing.assert_allclose(item.damping.omega[:3], omega, rtol=1e-6)
    assert len(item.damping.omega) == len(given)


def test_strains_that_joints_prevent_have_the_frequencies_of_their_own_static_answers(arm_body):
    """Clamped twice, a motion of one foot with unit strain energy has a kinetic energy by the body's own mass."""
    mbs, item, _ = jointed(arm_body, "inertial", damping=RATIO)
    hold_head(mbs, item, CLAMP)
    mbs.Assemble()
    hold_damping(mbs)
    damping, free = item.damping, arm_body.basis.omega[6:]
    strains = damping.omega[:, None] * damping.rows[:, 6:] / free  # of unit energy, by the free modes
    np.testing.assert_allclose(strains @ strains.T, np.eye(len(free)), atol=1e-8)
    prevented = strains[-6:] / free
    np.testing.assert_allclose(prevented @ prevented.T, np.diag(damping.omega[-6:] ** -2.0), atol=1e-8 / free[0] ** 2)
    assert (np.diff(damping.omega[-6:]) > 0).all()


def test_damping_is_that_of_the_reference_in_any_state(arm_body, frame):
    """It is found where the model is as it was made, and the state stays."""
    found = []
    for turned in (False, True):
        mbs, item, _ = jointed(arm_body, frame, HINGE, damping=RATIO)
        hold_head(mbs, item, [0, 0, 1, 0, 0, 0])
        mbs.Assemble()
        state = turned * np.linspace(0.3, -0.5, mbs.systemData.ODE2Size())
        mbs.systemData.SetODE2Coordinates(state)
        hold_damping(mbs)
        np.testing.assert_array_equal(mbs.systemData.GetODE2Coordinates(), state)
        found.append(item.damping.matrix().toarray())
    np.testing.assert_array_equal(*found)


def test_joints_that_hold_twice_hold_as_once(arm_body, frame):
    """Their rows are redundant, or nearly so."""
    found = []
    for often in (1, 2):
        mbs, item, _ = jointed(arm_body, frame, CLAMP, damping=RATIO)
        for _ in range(often):
            hold_head(mbs, item, CLAMP)
        mbs.Assemble()
        hold_damping(mbs)
        found.append(item.damping.matrix().toarray())
    np.testing.assert_allclose(found[1], found[0], atol=1e-9 * abs(found[0]).max())


def test_ring_down_of_a_cantilever(arm_body, frame):
    """In Exudyn's own run: the peaks of bending fall by exp(-2 pi zeta) in a period."""
    mbs, item, _ = jointed(arm_body, frame, damping=RATIO, gravity=[1000.0, 0, 0])
    mbs.Assemble()
    first = ratios(arm_body, np.zeros((arm_body.n_dofs,) * 2), held_by(arm_body, CLAMP), count=1)[1][0]
    settings = exu.SimulationSettings()
    time = settings.timeIntegration
    time.endTime, time.numberOfSteps, time.generalizedAlpha.spectralRadius = 5 * 2 * np.pi / first, 500, 1.0
    time.verboseMode, settings.solution.file.write = 0, False
    settings.solution.sensors.writePeriod = time.endTime / time.numberOfSteps
    mbs.SolveDynamic(settings)
    result = ep.collect(mbs)
    x = item.displacement(result, END)[:, 0]
    peaks = x[1:-1][(x[1:-1] - x[:-2]) * (x[2:] - x[1:-1]) < 0]
    swing = abs(np.diff(peaks))
    rate = np.log(swing[:-1] / swing[1:]).mean() / np.pi
    assert rate == pytest.approx(RATIO, rel=0.03)
    lost = item.dissipated_energy(result)[-1]
    fallen = item.coordinates(result) @ item.weight
    assert lost > 0.1 * fallen.max()
    energy = item.energy(result) + item.dissipated_energy(result) - fallen
    assert abs(energy - energy[0]).max() < 0.01 * lost


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_bodies_that_hold_each_other_keep_their_momenta(arm_body, frame, method):
    """Joints have no part in what damps a body: two of them fly, spin and ring, and their momenta are constant."""
    mbs = exu.SystemContainer().AddSystem()
    spin = [0, 0, 300.0] if frame == "floating" else [0, 0, 0]
    both = []
    for i, place in enumerate(([0, 0, 0], END)):
        options = {"initialVelocity": [1.0, 0.5, 0.0], "initialAngularVelocity": spin, "damping": 0.1}
        both.append(ep.CreatePartitionBody(mbs, arm_body, name=str(i), frame=frame, referencePosition=place, **options))
    markers = [both[0].CreateInterfaceMarker(mbs, "head"), both[1].CreateInterfaceMarker(mbs, "foot")]
    mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=CLAMP))
    mbs.Assemble()
    data, initial = mbs.systemData, exu.ConfigurationType.Initial
    mass, rows = (matrix.toarray() for matrix in mass_and_rows(mbs))
    kick = np.zeros(len(mass))
    for item in both:
        first = mbs.GetNodeODE2Index(item["nModal"]) + (6 if frame == "inertial" else 0)
        kick[first : first + 4] = 0.02
    free = scipy.linalg.null_space(rows)
    allowed = free @ np.linalg.solve(free.T @ mass @ free, free.T @ mass @ kick)
    data.SetODE2Coordinates_t(np.array(data.GetODE2Coordinates_t(initial)) + allowed, initial)
    step = 0.9 * ep.stability_limit(mbs) if method == "explicit" else 0.5e-6
    result = ep.solve_dynamic(mbs, end_time=300 * step, step=step, method=method, spectral_radius=1.0)
    assert sum(item.dissipated_energy(result)[-1] for item in both) > 1e-9
    momentum = sum(item.momentum(result) for item in both)
    assert abs(momentum - momentum[0]).max() < 1e-9 * abs(momentum[0]).max()
    for item in both:  # not one of the damping forces has a resultant or a moment
        D = item.damping.matrix().toarray()
        rigid = arm_body.rigid if frame == "inertial" else np.eye(arm_body.n_dofs)[:, :6]
        assert abs(D @ rigid).max() <= 1e-12 * abs(D).max() * abs(rigid).max()


def test_springs_and_free_axes_hold_nothing(arm_body):
    mbs, item, _ = jointed(arm_body, "inertial", [0] * 6, damping=RATIO)
    ends = [ground(mbs, END), item.CreateInterfaceMarker(mbs, "head")]
    mbs.AddObject(items.CartesianSpringDamper(markerNumbers=ends, stiffness=[1e7] * 3))
    mbs.Assemble()
    step_once(mbs)
    np.testing.assert_allclose(item.damping.rates, 2 * RATIO * arm_body.basis.omega[6:])


def test_other_joints_give_another_damping_and_leave_results(arm_body, frame):
    mbs, item, joint = jointed(arm_body, frame, damping=RATIO, gravity=[1000.0, 0, 0])
    mbs.Assemble()
    held = ep.solve_dynamic(mbs, end_time=1e-4, step=1e-6, method="implicit")
    taken, slowest = item.dissipated_energy(held), item.damping.omega[0]
    mbs.SetObjectParameter(joint, "constrainedAxes", [0] * 6)
    mbs.Assemble()
    ep.solve_dynamic(mbs, end_time=1e-4, step=1e-6, method="implicit")
    np.testing.assert_allclose(item.damping.omega, arm_body.basis.omega[6:])
    np.testing.assert_array_equal(item.dissipated_energy(held), taken)
    mbs.SetObjectParameter(joint, "constrainedAxes", CLAMP)
    mbs.Assemble()
    again = ep.solve_dynamic(mbs, end_time=1e-4, step=1e-6, method="implicit")
    assert item.damping.omega[0] == slowest
    np.testing.assert_array_equal(item.coordinates(again), item.coordinates(held))


def test_exudyn_s_own_run_that_begins_where_the_last_one_ended_finds_the_joints_anew(arm_body):
    mbs, item, joint = jointed(arm_body, "inertial", damping=RATIO)
    mbs.Assemble()
    step_once(mbs)
    assert item.damping.omega[0] < 0.5 * arm_body.basis.omega[6]
    mbs.SetObjectParameter(joint, "constrainedAxes", [0] * 6)
    mbs.Assemble()
    step_once(mbs, start=1e-7)
    np.testing.assert_allclose(item.damping.omega, arm_body.basis.omega[6:])


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_body_that_is_released_is_damped_as_a_free_one(arm_body, frame, method):
    """The damping of a clamped body would make explicit steps of the free one unstable."""
    mbs, item, joint = jointed(arm_body, frame, damping=RATIO, gravity=[1000.0, 0, 0])
    mbs.Assemble()

    def release(mbs, t):
        if t > 0.5e-3:
            mbs.SetObjectParameter(joint, "activeConnector", False)
        return True

    mbs.SetPreStepUserFunction(release)
    step = 0.9 * ep.stability_limit(mbs) if method == "explicit" else 1e-6
    result = ep.solve_dynamic(mbs, end_time=0.7e-3, step=step, method=method, spectral_radius=1.0)
    assert result.status == "finished"
    np.testing.assert_allclose(item.damping.omega, arm_body.basis.omega[6:])
    energy = item.energy(result) + item.dissipated_energy(result) - item.coordinates(result) @ item.weight
    work = (item.coordinates(result) @ item.weight).max()
    assert abs(energy - energy[0]).max() < 5e-3 * work


def test_a_joint_that_is_off_at_the_start_holds_nothing(arm_body):
    mbs, item, joint = jointed(arm_body, "inertial", damping=RATIO)
    mbs.SetObjectParameter(joint, "activeConnector", False)
    mbs.Assemble()
    step_once(mbs)
    np.testing.assert_allclose(item.damping.omega, arm_body.basis.omega[6:])


@pytest.mark.parametrize("ratio", [0.02, 0.5])
def test_explicit_steps_of_a_held_body_are_stable_up_to_the_limit(arm_body, ratio):
    """The rate that counts is that of the held body: the free one would have a thousand times this rate."""
    mbs, item, _ = jointed(arm_body, "inertial", damping=ratio, gravity=[1000.0, 0, 0])
    mbs.Assemble()
    limit = ep.stability_limit(mbs)
    assert item.damping.largest_rate(1.0) <= 2 * ratio * arm_body.basis.omega[-1] * (1 + 1e-9)
    result = ep.solve_dynamic(mbs, end_time=1500 * 0.995 * limit, step=0.995 * limit)
    assert result.status == "finished"
    energy = item.energy(result)
    assert energy[-1] <= energy.max() < arm_body.total_mass * 1000.0 * 1e-3


def test_both_frames_have_the_same_held_modes(arm_body):
    """Also where the axes of the frame's node are not those of the inertia, as with every floating frame."""
    found = []
    for frame in ("inertial", "floating"):
        mbs, item, _ = jointed(arm_body, frame, HINGE, damping=RATIO)
        hold_head(mbs, item, [1, 1, 0, 0, 0, 0], 2 * arm_body.total_mass)
        mbs.Assemble()
        step_once(mbs)
        found.append(item.damping.omega)
    np.testing.assert_allclose(found[0], found[1], rtol=1e-7)


def test_a_damping_matrix_of_the_users_own_is_refused(arm_body):
    """Again and again, until it is restored."""
    mbs, item, _ = jointed(arm_body, "inertial", damping=RATIO)
    number, n = item["oGenericODE2"], arm_body.n_dofs
    made = mbs.GetObjectParameter(number, "dampingMatrix")
    mbs.SetObjectParameter(number, "dampingMatrix", exu.MatrixContainer(sp.eye(n, format="csr")))
    mbs.Assemble()
    for _ in range(2):
        with pytest.raises(InputError, match="a change of dampingMatrix"):
            ep.stability_limit(mbs)
    mbs.SetObjectParameter(number, "dampingMatrix", made)
    ep.stability_limit(mbs)
    rows = held_by(arm_body, CLAMP)
    np.testing.assert_allclose(ratios(arm_body, item.damping.matrix().toarray(), rows)[0], RATIO, rtol=1e-6)
