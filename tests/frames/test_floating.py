"""Floating frame: integrals and forces by brute force, conservation, Exudyn's own formulation, kinematics, errors."""

from dataclasses import replace

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
import scipy.integrate
import scipy.sparse as sp
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from oracles import PLACE, SPIN, TURNED, box, in_frame, relative

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.frames.inertia_forces import TERMS


def explicit_step(body):
    """A step well below the stability limit [s]: nodes vibrate far above f_cut."""
    return 0.5e-6 if len(body.basis.nodal) else 2e-6


def spin(body, *, frame="floating", **options):
    """The body alone, assembled."""
    mbs = exu.SystemContainer().AddSystem()
    options = {"initialVelocity": [1, 2, 3], "initialAngularVelocity": SPIN, "referencePosition": PLACE, **options}
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


# --- runs


def test_torque_free_rotation_conserves_explicitly(body):
    """Errors are those of the step, of second order, and do not grow over two turns, or a part in short steps."""
    mbs, item = spin(body)
    step = explicit_step(body)
    turns = 0.05 if len(body.basis.nodal) else 2
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
    end_time = 300 * explicit_step(body)
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
    theirs = by_exudyn(other, 400 * explicit_step(body), explicit_step(body))
    mbs, item = spin(body)
    ours = by_exudyn(mbs, 400 * explicit_step(body), explicit_step(body))
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
    stiff = replace(plank[0].material, E=stiffer * ep.STEEL.E, yield_stress=None)
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
    centre = PLACE + TURNED @ body.centre_of_mass + np.outer(result.t, [1, 2, 3])
    arm = corner - body.centre_of_mass
    place = item.displacement(result, corner) + PLACE + TURNED @ corner
    np.testing.assert_allclose(place, centre + A @ arm, atol=1e-5 * 0.2)
    velocity = np.einsum("tab,tb->ta", A, np.cross(omega, arm)) + np.array([1, 2, 3])
    # Where elastic forces are a million times larger, one iteration meets Newton's goal, and leaves more than 1e-5.
    assert relative(item.velocity(result, corner), velocity) < 2e-5
    np.testing.assert_allclose(result.sensor(origin), centre - A @ body.centre_of_mass, atol=1e-5 * 0.2)


def test_newton_s_method_converges(body):
    """A few iterations a step, also in steps of a fiftieth of a radian, with Jacobians that take as long as five."""
    for step, iterations in ((2e-6, 3), (50e-6, 6)):
        mbs, item = spin(body)
        result = ep.solve_dynamic(mbs, end_time=200 * step, step=step, method="implicit")
        solver = mbs.sys["dynamicSolver"].it
        assert solver.newtonStepsCount + 5 * solver.newtonJacobiCount <= iterations * result.steps
        momentum = item.angular_momentum(result)
        assert abs(momentum - momentum[0]).max() < (300 * step) ** 2 * np.linalg.norm(momentum[0])


@pytest.mark.filterwarnings("ignore:the explicit steps .* above the stability limit")  # of modes, which nothing moves
def test_verlet_is_of_second_order_under_forces_of_others(body):
    """A torque that turns with the body, on the rigid node; the phases of vibration would hide the order."""
    ends = []
    for solver, step in (("RK44", 2e-6), ("VelocityVerlet", 4e-6), ("VelocityVerlet", 2e-6)):
        mbs, item = spin(body, inertiaTerms=["gyroscopic"])
        node = mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=item["nRigid"]))
        mbs.AddLoad(items.LoadTorqueVector(markerNumber=node, loadVector=[20, 50, 100], bodyFixed=True))
        mbs.Assemble()
        result = by_exudyn(mbs, 1e-3, step, getattr(exu.DynamicSolverType, solver))
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
        about = PLACE + body.centre_of_mass + [0, 0, 0.1]
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
        result = ep.solve_dynamic(mbs, end_time=0.5e-3)
        place = PLACE + A @ body.points[body.nearest_node(point)] + item.displacement(result, point)
        histories.append([(part - offset) @ A for part, offset in (
            (place, PLACE), (item.velocity(result, point), 0), (item.angular_momentum(result, PLACE), 0),
        )])  # fmt: skip
        histories[-1].append(item.energy(result))
    for straight, turned in zip(*histories, strict=True):
        assert relative(turned, straight) < 1e-8


def test_strains_do_not_see_the_rotation(body):
    """Rows on nodal displacements get those within the frame."""
    mbs, item = spin(body)
    result = ep.solve_dynamic(mbs, end_time=1e-3)
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
