"""Floating frame: integrals and forces by brute force, conservation, Exudyn's own formulation, kinematics, errors."""

from dataclasses import replace

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
import scipy.integrate
import scipy.sparse as sp
from conftest import box, relative
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.fe.model import rigid_modes
from exudyn_partition.frames.floating import FloatingKinematics
from exudyn_partition.frames.inertia_forces import TERMS, InertiaForces
from exudyn_partition.frames.inertial import InertialKinematics
from exudyn_partition.frames.rotations import rotation_matrix

SPIN = np.array([100.0, 200.0, 200.0])  # rad/s, 300 in all
POSITION = np.array([0.1, -0.2, 0.3])
TURNED = Rotation.from_rotvec([0.5, -1.0, 0.7]).as_matrix()


@pytest.fixture(scope="module")
def plank():
    """A steel plank, 200 x 30 x 20 mm: no two moments of inertia are equal."""
    fem = ep.fe_model(occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(0.2, 0.03, 0.02)), ep.STEEL, maxh=0.015)
    return fem, ep.Partition.ball(fem, (0.2, 0.015, 0.01), 8e-3)


@pytest.fixture(scope="module", params=["residual", "free"])
def body(request, plank):
    """Of shapes alone, and with nodal columns."""
    return ep.reduce(*plank, basis=request.param, f_cut=20e3)


@pytest.fixture(scope="module")
def of_shapes(plank):
    return ep.reduce(*plank, basis="residual", f_cut=20e3)


def explicit_step(body):
    """A step well below the stability limit [s]: nodes vibrate far above f_cut."""
    return 0.5e-6 if len(body.basis.nodal) else 2e-6


@pytest.fixture(scope="module", params=["contact-adapted", "residual", "craig-bampton", "free", "all nodes"])
def any_body(request, plank):
    """A body in its frame, and the FE mass of its basis."""
    fem, part = plank
    if request.param == "all nodes":  # the full FE model
        fem = ep.fe_model(box(0.03, 0.02, 0.01), ep.STEEL, maxh=0.02, order=1)
        part = ep.Partition.ball(fem, (0, 0, 0.01), 0.1, contact_radius=0.02)
    basis = "free" if request.param == "all nodes" else request.param
    body = ep.reduce(fem, part, basis=basis, f_cut=20e3)
    return in_frame(body), fem.mass if body.basis.mass == "consistent" else fem.lumped_mass_matrix


def in_frame(body):
    """Kinematics of all nodes of a body, whose frame has the axes of the mesh."""
    return FloatingKinematics(body, np.zeros(3), np.zeros(3), np.arange(len(body.points)))


def state(body, seed=0):
    """Angular velocity, elastic coordinates large enough to see their squares, and their velocities."""
    rng = np.random.default_rng(seed)
    n = body.n_dofs - 6
    return SPIN, 2e-3 * rng.standard_normal(n) / np.arange(1, n + 1), rng.standard_normal(n)


def fields(kinematics, z, z_t):
    """Arms from the centre of mass and elastic velocities of all nodes, (N, 3)."""
    return kinematics.arms + (kinematics.rows @ z).reshape(-1, 3), (kinematics.rows @ z_t).reshape(-1, 3)


def spin(body, *, frame="floating", **options):
    """The body alone, assembled."""
    mbs = exu.SystemContainer().AddSystem()
    options = {"initialVelocity": [1, 2, 3], "initialAngularVelocity": SPIN, "referencePosition": POSITION, **options}
    item = ep.CreatePartitionBody(mbs, body, frame=frame, **options)
    mbs.Assemble()
    return mbs, item


def by_exudyn(mbs, end_time, step, solver=exu.DynamicSolverType.RK44, **options):
    """Plain mbs.SolveDynamic."""
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = end_time, round(end_time / step)
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    settings.solution.sensors.writePeriod = end_time / 50
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    mbs.SolveDynamic(settings, solverType=solver, **options)
    return ep.collect(mbs)


# --- integrals and forces


def test_integrals_against_the_fe_mass(any_body):
    kinematics, mass = any_body
    omega, z, z_t = state(kinematics.body)
    arms, u_t = fields(kinematics, z, z_t)
    v = np.cross(omega, arms) + u_t
    momentum = (mass @ v.ravel()).reshape(-1, 3)
    inertia = kinematics.inertia
    np.testing.assert_allclose(inertia.angular_momentum(omega, z, z_t), np.cross(arms, momentum).sum(axis=0), rtol=1e-9)
    assert inertia.kinetic_energy(omega, z, z_t) == pytest.approx((v * momentum).sum() / 2, rel=1e-9)
    rotations = rigid_modes(kinematics.arms)[:, 3:]
    np.testing.assert_allclose(inertia.tensor, rotations.T @ (mass @ rotations), atol=1e-9 * inertia.tensor.max())
    J, C = inertia.of_place(z)
    np.testing.assert_allclose(J @ omega + C @ z_t, inertia.angular_momentum(omega, z, z_t), rtol=1e-9)


def test_mean_axes(any_body):
    """Deformation of unit mass, without momentum, that spans with rigid motion all that the basis does."""
    kinematics, _ = any_body
    body, axes = kinematics.body, kinematics.mean_axes
    E = axes.expand(np.eye(body.n_dofs - 6)).T
    M = body.mass.toarray()
    np.testing.assert_allclose(E.T @ M @ E, np.eye(body.n_dofs - 6), atol=1e-12)
    np.testing.assert_allclose(body.rigid.T @ M @ E, 0, atol=1e-12 * abs(M @ body.rigid).max())
    assert np.linalg.matrix_rank(np.hstack([body.rigid, E])) == body.n_dofs
    rng = np.random.default_rng(4)
    q, z = rng.standard_normal((3, body.n_dofs)), rng.standard_normal((3, body.n_dofs - 6))
    np.testing.assert_allclose(axes.of(axes.expand(z) + rng.standard_normal((3, 6)) @ body.rigid.T), z, atol=1e-10)
    np.testing.assert_allclose(axes.restrict(q), q @ E, atol=1e-12 * abs(E).max() * body.n_dofs)
    K = body.stiffness.toarray()
    np.testing.assert_allclose(kinematics.elastic_stiffness, E.T @ K @ E, atol=1e-12 * abs(E.T @ K @ E).max())
    np.testing.assert_allclose(kinematics.elastic_force(z[0]), E.T @ K @ E @ z[0], rtol=1e-6, atol=1e-9 * abs(K).max())


def test_integrals_of_histories(body):
    inertia = in_frame(body).inertia
    states = [state(body, seed) for seed in range(3)]
    together = [np.array(part) for part in zip(*states, strict=True)]
    for method in (inertia.angular_momentum, inertia.kinetic_energy):
        np.testing.assert_allclose(method(*together), [method(*one) for one in states], rtol=1e-12)


def test_accelerations_balance_all_virtual_motion(any_body):
    """The principle of virtual power with the FE mass: no rotation nor shape finds force left over."""
    kinematics, mass = any_body
    omega, z, z_t = state(kinematics.body)
    elastic = kinematics.elastic_force(z)
    force = InertiaForces(kinematics.inertia, kinematics.elastic_force).force(omega, z, z_t)
    omega_t = np.linalg.solve(kinematics.inertia.tensor, force[:3])
    z_tt = force[3:] - elastic
    arms, u_t = fields(kinematics, z, z_t)
    u_tt = fields(kinematics, z, z_tt)[1]
    turning = np.cross(omega_t, arms) + np.cross(omega, np.cross(omega, arms)) + 2 * np.cross(omega, u_t)
    inertia = (mass @ (u_tt + turning).ravel()).reshape(-1, 3)
    scale = np.linalg.norm(np.cross(arms, inertia), axis=1).sum()
    np.testing.assert_allclose(np.cross(arms, inertia).sum(axis=0), 0, atol=1e-9 * scale)
    np.testing.assert_allclose(inertia.sum(axis=0), 0, atol=1e-9 * abs(inertia).sum())
    np.testing.assert_allclose(kinematics.rows.T @ inertia.ravel(), -elastic, atol=1e-9 * abs(elastic).max())


@pytest.mark.parametrize("terms", [(name,) for name in TERMS if name != "coupling"] + [tuple(TERMS)[:3]])
def test_derivatives_by_finite_differences(body, terms):
    kinematics = in_frame(body)
    forces = InertiaForces(kinematics.inertia, kinematics.elastic_force, terms)
    omega, z, z_t = state(body)
    x, n = np.concatenate([z, omega, z_t]), len(z)
    got = np.hstack(forces.derivatives(omega, z, z_t))

    def at(x):
        return forces.force(x[n : n + 3], x[:n], x[n + 3 :])

    # The forces are cubic, so that differences of this size are exact but for their third derivatives.
    steps = 1e-4 * np.concatenate([np.full(n, 1e-3), np.full(3, 300.0), np.ones(n)])
    expected = np.array([(at(x + d) - at(x - d)) / (2 * d.sum()) for d in np.diag(steps)]).T
    for block in (slice(0, 3), slice(3, None)):
        np.testing.assert_allclose(got[block], expected[block], atol=1e-6 * abs(expected[block]).max())


# --- runs


def test_torque_free_rotation_conserves_explicitly(body):
    """Errors are those of the step, of second order, and do not grow over three turns, or a part in short steps."""
    mbs, item = spin(body)
    step = explicit_step(body)
    turns = 0.3 if len(body.basis.nodal) else 3
    result = ep.solve_dynamic(mbs, end_time=turns * 2 * np.pi / 300, step=step, sample_period=turns * 2e-5)
    momentum, energy = item.angular_momentum(result), item.energy(result)
    assert abs(momentum - momentum[0]).max() < 1e-6 * np.linalg.norm(momentum[0])
    assert abs(energy / energy[0] - 1).max() < 1e-6
    np.testing.assert_allclose(item.momentum(result), body.total_mass * np.array([[1, 2, 3]] * len(result.t)))
    half = len(result.t) // 2
    errors = np.linalg.norm(momentum - momentum[0], axis=1)
    assert errors[half:].max() < 1.2 * errors[:half].max()
    assert abs(energy[half:] - energy[0]).max() < 1.2 * abs(energy[:half] - energy[0]).max()


def test_every_solver_of_exudyn_runs_it(body):
    """Runge-Kutta conserves to round-off, for the equations do."""
    mbs, item = spin(body)
    end_time = 600 * explicit_step(body)
    result = by_exudyn(mbs, end_time, explicit_step(body))
    momentum = item.angular_momentum(result)
    assert abs(momentum - momentum[0]).max() < 1e-10 * np.linalg.norm(momentum[0])
    fine = item.coordinates(result)
    for solver in (exu.DynamicSolverType.VelocityVerlet, exu.DynamicSolverType.GeneralizedAlpha):
        other = item.coordinates(by_exudyn(mbs, end_time, explicit_step(body) / 2, solver))
        assert relative(other[:, :6], fine[:, :6]) < 1e-6
        assert relative(other[:, 6:], fine[:, 6:]) < 0.1  # phase of the highest modes


def test_against_exudyn_s_own_floating_frame(plank, body):
    """ObjectFFRFreducedOrder with all its terms, on the same modes."""
    fem, kinematics = plank[0], in_frame(body)
    mass = fem.mass if body.basis.mass == "consistent" else fem.lumped_mass_matrix
    model = FEMinterface()
    model.nodes["Position"] = fem.points - fem.centre_of_mass
    model.massMatrix, model.stiffnessMatrix = sp.csr_matrix(mass), sp.csr_matrix(fem.stiffness)
    model.modeBasis = {"matrix": kinematics.rows, "type": "NormalModes"}
    model.elements = [{"Name": "solid", "Tet4": fem.cells[:, :4]}]
    modes = ObjectFFRFreducedOrderInterface(model, rigidBodyNodeType=exu.NodeType.RotationRotationVector)
    other = exu.SystemContainer().AddSystem()
    nodes = modes.AddObjectFFRFreducedOrder(other, initialVelocity=[0, 0, 0], initialAngularVelocity=SPIN)
    sensors = [
        other.AddSensor(items.SensorNode(nodeNumber=nodes[key], outputVariableType=kind, storeInternal=True))
        for key, kind in (
            ("nRigidBody", exu.OutputVariableType.AngularVelocityLocal),
            ("nGenericODE2", exu.OutputVariableType.Coordinates),
        )
    ]
    other.Assemble()
    theirs = by_exudyn(other, 800 * explicit_step(body), explicit_step(body))
    mbs, item = spin(body)
    ours = by_exudyn(mbs, 800 * explicit_step(body), explicit_step(body))
    omega = item.coordinates_t(ours)[:, 3:6] @ item.kinematics.node_axes.T
    assert relative(omega, theirs.sensor(sensors[0])) < 1e-10
    assert relative(item.coordinates(ours)[:, 6:], theirs.sensor(sensors[1])) < 1e-8


@pytest.mark.parametrize(
    ("stiffer", "f_cut", "options"),
    [
        (1e6, 20e6, {"method": "implicit", "spectral_radius": 1.0}),
        (1.0, 1e3, {"method": "implicit", "spectral_radius": 1.0}),  # no mode below: no elastic coordinates at all
        (1.0, 1e3, {"method": "explicit"}),
    ],
)
def test_a_stiff_body_moves_like_a_rigid_one(plank, stiffer, f_cut, options):
    stiff = replace(plank[0].material, E=stiffer * ep.STEEL.E)
    fem = replace(plank[0], stiffness=stiffer * plank[0].stiffness, material=stiff)
    body = ep.reduce(fem, plank[1], f_cut=f_cut)
    assert (body.n_dofs > 6) == (stiffer > 1)
    mbs, item = spin(body, referenceRotation=TURNED)
    marker = item.CreateNodeMarker(mbs, (0, 0, 0))
    kind = exu.OutputVariableType.Position
    origin = mbs.AddSensor(items.SensorMarker(markerNumber=marker, outputVariableType=kind, storeInternal=True))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=10e-3, step=5e-6, **options)
    J = body.inertia.tensor

    def rigid(t, y):
        A, omega = y[:9].reshape(3, 3), y[9:]
        return np.r_[np.cross(A, omega).ravel(), np.linalg.solve(J, -np.cross(omega, J @ omega))]

    start = np.r_[TURNED.ravel(), TURNED.T @ SPIN]
    y = scipy.integrate.solve_ivp(rigid, (0, 10e-3), start, t_eval=result.t, rtol=1e-10, atol=1e-10).y.T
    A, omega = y[:, :9].reshape(-1, 3, 3), y[:, 9:]
    corner = np.array([0.2, 0.03, 0.02])
    centre = POSITION + TURNED @ body.centre_of_mass + np.outer(result.t, [1, 2, 3])
    arm = corner - body.centre_of_mass
    place = item.displacement(result, corner) + POSITION + TURNED @ corner
    np.testing.assert_allclose(place, centre + A @ arm, atol=1e-5 * 0.2)
    velocity = np.einsum("tab,tb->ta", A, np.cross(omega, arm)) + np.array([1, 2, 3])
    assert relative(item.velocity(result, corner), velocity) < 1e-5
    np.testing.assert_allclose(result.sensor(origin), centre - A @ body.centre_of_mass, atol=1e-5 * 0.2)


def test_newton_s_method_converges(body):
    """One Jacobian for the run, a few iterations a step, also in steps of a fiftieth of a radian."""
    for step, iterations in ((2e-6, 3), (50e-6, 6)):
        mbs, item = spin(body)
        result = ep.solve_dynamic(mbs, end_time=200 * step, step=step, method="implicit")
        solver = mbs.sys["dynamicSolver"].it
        assert solver.newtonStepsCount <= iterations * result.steps
        assert solver.newtonJacobiCount <= 2
        momentum = item.angular_momentum(result)
        assert abs(momentum - momentum[0]).max() < (300 * step) ** 2 * np.linalg.norm(momentum[0])


@pytest.mark.filterwarnings("ignore:the explicit steps .* above the stability limit")  # of modes, which nothing moves
def test_verlet_is_of_second_order_under_forces_of_others(body):
    """A torque that turns with the body, on the rigid node; the phases of vibration would hide the order."""
    ends = []
    for solver, step in (("RK44", 1e-6), ("VelocityVerlet", 4e-6), ("VelocityVerlet", 2e-6)):
        mbs, item = spin(body, inertiaTerms=["gyroscopic"])
        node = mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=item["nRigid"]))
        mbs.AddLoad(items.LoadTorqueVector(markerNumber=node, loadVector=[20, 50, 100], bodyFixed=True))
        mbs.Assemble()
        result = by_exudyn(mbs, 2e-3, step, getattr(exu.DynamicSolverType, solver))
        ends.append(item.coordinates_t(result)[-1, 3:6])
    errors = [np.linalg.norm(end - ends[0]) for end in ends[1:]]
    assert errors[1] < 1e-5 * np.linalg.norm(ends[0])
    assert 3.8 < errors[0] / errors[1] < 4.2


def test_vibration_of_a_rotor_neither_grows_nor_decays():
    """Pairs of equal frequency, near the stability limit, are where late velocities in Coriolis forces pump energy.

    Judged by the invariant of central differences, from which the energy itself differs by beats of the modes.
    """
    fem = ep.fe_model(box(0.02, 0.02, 0.2), ep.STEEL, maxh=0.015)
    body = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0.2), 8e-3), basis="residual", f_cut=20e3)
    mbs, item = spin(body, initialAngularVelocity=[0, 0, 1000.0])
    omega = body.basis.omega[6:]
    start = 1e-2 / omega * np.random.default_rng(3).choice([-1.0, 1.0], len(omega))
    mbs.SetNodeParameter(item["nModal"], "initialCoordinates", start)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=0.1, step=0.9 * ep.stability_limit(mbs), sample_period=1e-4)
    z, z_t = item.coordinates(result)[:, 6:], item.coordinates_t(result)[:, 6:]
    invariant = np.sum(z_t**2 + (omega * z) ** 2 * (1 - (omega * result.step / 2) ** 2), axis=1)
    early, late = (part.mean() for part in (invariant[:200], invariant[-200:]))
    assert late == pytest.approx(early, rel=5e-3)


def test_small_rotation_is_that_of_an_inertial_frame(body):
    point, histories = (0.2, 0.03, 0.02), []
    for frame in ("inertial", "floating"):
        mbs, item = spin(body, frame=frame, initialAngularVelocity=[0.1, 0.2, -0.1])
        result = ep.solve_dynamic(mbs, end_time=1e-3)
        about = POSITION + body.centre_of_mass + [0, 0, 0.1]
        histories.append(
            (item.displacement(result, point), item.velocity(result, point), item.angular_momentum(result, about))
        )
        assert item.momentum(result)[-1] == pytest.approx(body.total_mass * np.array([1, 2, 3]))
        assert item.rigid_motion(item.coordinates(result))[-1] == pytest.approx(
            np.array([1e-3, 2e-3, 3e-3, 1e-4, 2e-4, -1e-4]), rel=1e-3
        )
    for inertial, floating in zip(*histories, strict=True):
        assert relative(floating, inertial) < 1e-4


def test_axes_of_the_mesh_do_not_matter(body):
    """A body that is turned, in a motion that is turned, moves like the other, turned."""
    point, histories = (0.2, 0.03, 0.02), []
    for A in (np.eye(3), TURNED):
        mbs, item = spin(body, referenceRotation=A, initialVelocity=A @ [1, 2, 3], initialAngularVelocity=A @ SPIN)
        result = ep.solve_dynamic(mbs, end_time=1.5e-3)
        place = POSITION + A @ body.points[body.nearest_node(point)] + item.displacement(result, point)
        histories.append([(part - offset) @ A for part, offset in (
            (place, POSITION), (item.velocity(result, point), 0), (item.angular_momentum(result, POSITION), 0),
        )])  # fmt: skip
        histories[-1].append(item.energy(result))
    for straight, turned in zip(*histories, strict=True):
        assert relative(turned, straight) < 1e-8


def test_strains_do_not_see_the_rotation(body):
    """Rows on nodal displacements get those within the frame."""
    mbs, item = spin(body)
    result = ep.solve_dynamic(mbs, end_time=3e-3)
    far, near = body.nearest_node((0.2, 0.03, 0.02)), body.nearest_node((0, 0.03, 0.02))
    rows = sp.csr_matrix(([1.0, -1.0], ([0, 0], [3 * far, 3 * near])), shape=(1, body.fe_dofs))
    stretch = item.recover(result, rows)
    # Half of rho omega^2 l^3 / 12 E: loads that come at once stretch up to twice as far as in rest.
    rho, E = ep.STEEL.rho, ep.STEEL.E
    static = rho * (SPIN[1] ** 2 + SPIN[2] ** 2) * 0.2**3 / (12 * E)
    assert stretch.mean() == pytest.approx(static, rel=0.2)


# --- what is left out


@pytest.mark.parametrize("left", TERMS)
def test_each_term_matters_and_is_named(of_shapes, left):
    body = of_shapes
    mbs, item = spin(body)
    whole = item.coordinates_t(by_exudyn(mbs, 2e-3, 2e-6))
    assert not any("inertiaTerms" in sentence for sentence in item.left_out)
    mbs, item = spin(body, inertiaTerms=[name for name in TERMS if name != left])
    part = item.coordinates_t(by_exudyn(mbs, 2e-3, 2e-6))
    assert f"{TERMS[left]} (inertiaTerms)" in item.left_out
    assert max(relative(part[:, 3:6], whole[:, 3:6]), relative(part[:, 6:], whole[:, 6:])) > 1e-7


def test_auto_frame(body):
    for options, frame in (
        ({}, "floating"),
        ({"initialAngularVelocity": [0, 0, 0]}, "inertial"),
        ({"initialAngularVelocity": [0, 0, 0], "referenceRotation": TURNED}, "floating"),
    ):
        item = spin(body, frame="auto", **options)[1]
        assert item.frame == frame
        assert item["nModal"] in item.nodes
        assert ("nRigid" in item) == (frame == "floating")
        assert any("large rotation" in sentence for sentence in item.left_out) == (frame == "inertial")


# --- kinematics of nodes


@pytest.fixture(params=["inertial", "floating", "floating off the node's axes"])
def kinematics(request, plank, body):
    nodes = plank[1].patch_nodes
    if "floating" in request.param:
        node_rotation = np.array([0.3, -0.2, 0.9]) if "off" in request.param else None
        return FloatingKinematics(body, POSITION, Rotation.from_matrix(TURNED).as_rotvec(), nodes, node_rotation)
    return InertialKinematics(body, POSITION, nodes)


def moved(kinematics, q, q_t, dt):
    """Coordinates after dt at constant velocities."""
    after = q + dt * q_t
    if isinstance(kinematics, FloatingKinematics):
        axes = Rotation.from_matrix(kinematics.frame(q)[1] @ kinematics.node_axes)
        turn = axes * Rotation.from_rotvec(dt * q_t[3:6])
        after[3:6] = turn.as_rotvec() - kinematics.rotation
    return after


def test_velocities_and_forces_of_nodes(kinematics):
    """Velocities by finite differences of places; generalised forces by their power on all motions."""
    rng = np.random.default_rng(1)
    n = kinematics.body.n_dofs
    q, q_t = 1e-3 * rng.standard_normal((2, n))
    forces = rng.standard_normal((len(kinematics.arms), 3))
    if isinstance(kinematics, FloatingKinematics):
        q[3:6], q_t[3:6] = [0.3, 0.8, -0.4], [0.02, -0.03, 0.05]
    dt = 1e-3
    difference = kinematics.place(moved(kinematics, q, q_t, dt)) - kinematics.place(moved(kinematics, q, q_t, -dt))
    np.testing.assert_allclose(kinematics.velocities(q, q_t), difference / (2 * dt), atol=1e-8)
    power = [np.sum(forces * kinematics.velocities(q, unit)) for unit in np.eye(n)]
    np.testing.assert_allclose(kinematics.generalised(q, forces), power, atol=1e-12 * abs(np.array(power)).max())
    np.testing.assert_allclose(
        kinematics.place(q), kinematics.place(np.zeros(n)) + kinematics.displacements(q), atol=1e-15
    )


def test_histories_are_one_state_after_the_other(kinematics):
    rng = np.random.default_rng(2)
    q, q_t = 1e-3 * rng.standard_normal((2, 4, kinematics.body.n_dofs))
    for method, arguments in (
        (kinematics.place, (q,)), (kinematics.displacements, (q,)), (kinematics.deformation, (q,)),
        (kinematics.velocities, (q, q_t)), (kinematics.momentum, (q_t,)), (kinematics.kinetic_energy, (q, q_t)),
        (kinematics.rigid_motion, (q,)), (kinematics.elastic, (q,)),
        (lambda *both: kinematics.angular_momentum(*both, POSITION), (q, q_t)),
    ):  # fmt: skip
        each = [method(*one) for one in zip(*arguments, strict=True)]
        np.testing.assert_allclose(method(*arguments), each, atol=1e-12 * abs(np.array(each)).max())


def test_the_reference_place_is_the_mesh_turned_and_shifted(plank, body):
    nodes = plank[1].patch_nodes
    kinematics = FloatingKinematics(body, POSITION, Rotation.from_matrix(TURNED).as_rotvec()).at(nodes)
    np.testing.assert_allclose(
        kinematics.place(np.zeros(body.n_dofs)), POSITION + body.points[nodes] @ TURNED.T, atol=1e-12
    )


def test_rotation_matrices():
    vectors = np.array([[0, 0, 0], [1e-9, 0, 0], [0.1, 0.2, -0.3], [2, -2, 1], [0, 0, 2 * np.pi]])
    np.testing.assert_allclose(rotation_matrix(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-14)


# --- errors


def test_misuse(mbs, of_shapes):
    body = of_shapes
    floating = {"frame": "floating"}
    for matrix in (1.001 * TURNED, np.diag([1, 1, -1]), np.ones((3, 3))):
        with pytest.raises(InputError, match="referenceRotation: expected a rotation matrix, got one with determinant"):
            ep.CreatePartitionBody(mbs, body, referenceRotation=matrix, **floating)
    with pytest.raises(InputError, match=r"referenceRotation: expected shape \(3, 3\)"):
        ep.CreatePartitionBody(mbs, body, referenceRotation=[0, 0, 1], **floating)
    with pytest.raises(InputError, match="referenceRotation: an inertial frame keeps the axes"):
        ep.CreatePartitionBody(mbs, body, referenceRotation=TURNED)
    with pytest.raises(InputError, match=r"inertiaTerms: expected one of 'gyroscopic', .*, got 'euler'"):
        ep.CreatePartitionBody(mbs, body, inertiaTerms=["euler"], **floating)
    needle = body.inertia.inertia.copy()
    needle[[0, 4, 5], 0, 0] = 0.0
    thin = replace(body, inertia=replace(body.inertia, inertia=needle))
    with pytest.raises(InputError, match="body: expected moments of inertia above zero about all axes"):
        ep.CreatePartitionBody(mbs, thin, **floating)
    assert mbs.systemData.NumberOfNodes() == 0


def test_a_solver_that_is_not_known(body):
    mbs, _ = spin(body)
    with pytest.raises(Exception, match="leave storeSolver=True"):
        by_exudyn(mbs, 1e-5, 1e-6, storeSolver=False)
