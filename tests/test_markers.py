"""Markers of interfaces, nodes and points: kinematics, Jacobians, joints, springs, loads, gravity, existing models."""

import re

import exudyn as exu
import exudyn.itemInterface as items
import exudyn.utilities
import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg
from conftest import box, relative
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import InputError, ModelLimitWarning, PenetrationError
from exudyn_partition.exudyn_bodies.markers import interpolation
from exudyn_partition.fe.model import node_dofs
from exudyn_partition.reduction.tied import tie

F_CUT = 60e3
PLACE = np.array([0.1, -0.2, 0.3])
TURNED = Rotation.from_rotvec([0.5, -1.0, 0.7]).as_matrix()
HINGE = [1, 1, 1, 1, 0, 1]  # free about y
KIND = exu.OutputVariableType


@pytest.fixture(scope="module")
def link():
    """A bar along z, 10 x 8 x 60 mm, with an interface at each end."""
    fem = ep.fe_model(box(0.010, 0.008, 0.060), ep.STEEL, maxh=6e-3)
    foot, head = (np.flatnonzero(abs(fem.points[:, 2] - z) < 1e-9) for z in (0.0, 0.06))
    return fem, ep.Partition.interface(fem, "foot", foot) | ep.Partition.interface(fem, "head", head, kind="averaged")


@pytest.fixture(scope="module")
def body(link):
    return ep.reduce(*link, f_cut=F_CUT)


def ground(mbs, place=(0, 0, 0), axes=None):
    """Marker fixed in space."""
    frame = np.eye(4)
    frame[:3, 3], frame[:3, :3] = place, np.eye(3) if axes is None else axes
    return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.AddObject(items.ObjectGround()), localHT=frame))


def sensors(mbs, marker, kinds):
    return [
        mbs.AddSensor(items.SensorMarker(markerNumber=marker, outputVariableType=k, storeInternal=True)) for k in kinds
    ]


def in_frame(frame):
    """Options of a body somewhere in space; one that floats is turned."""
    return {"frame": frame, "referencePosition": PLACE} | ({"referenceRotation": TURNED} if frame == "floating" else {})


@pytest.fixture(params=["inertial", "floating"])
def frame(request):
    return request.param


# --- kinematics


def test_markers_move_as_interfaces_nodes_and_points(mbs, link, body, frame):
    partition = link[1]
    item = ep.CreatePartitionBody(mbs, body, **in_frame(frame))
    start = 1e-6 * np.random.default_rng(0).standard_normal((2, body.n_dofs))
    if frame == "floating":
        start = start[:, 6:]
        mbs.SetNodeParameter(item["nRigid"], "initialVelocities", [1, 2, 3, 100, 200, -100])
    mbs.SetNodeParameter(item["nModal"], "initialCoordinates", start[0])
    mbs.SetNodeParameter(item["nModal"], "initialCoordinates_t", 1e5 * start[1])
    both = (KIND.Position, KIND.Velocity)
    mean = partition.find_interface("head")
    head = sensors(mbs, item.CreateInterfaceMarker(mbs, "head"), (*both, KIND.RotationMatrix, KIND.AngularVelocity))
    corner = sensors(mbs, item.CreateNodeMarker(mbs, (0.005, 0.004, 0.06)), both)
    inside = (0.0021, 0.0013, 0.0307)
    point = sensors(mbs, item.CreatePointMarker(mbs, inside), both)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=2e-5, step=5e-7)
    q, q_t = item.coordinates(result), item.coordinates_t(result)

    end = item.kinematics.at(mean.nodes)
    np.testing.assert_allclose(result.sensor(head[0]), mean.weights @ end.place(q), atol=1e-12)
    np.testing.assert_allclose(result.sensor(head[1]), mean.weights @ end.velocities(q, q_t), atol=1e-9)
    A = item.kinematics.frame(q)[1]
    rows = mean.motion[3:] @ end.rows
    elastic = rows.shape[1]
    turn = Rotation.from_rotvec(q[:, -elastic:] @ rows.T).as_matrix()
    np.testing.assert_allclose(result.sensor(head[2]).reshape(-1, 3, 3), A @ turn, atol=1e-12)
    turning = q_t[:, 3:6] @ item.kinematics.node_axes.T if frame == "floating" else 0
    spin = turning + q_t[:, -elastic:] @ rows.T
    expected = np.einsum("tab,tb->ta", A, spin)  # but for the curvature of rotations
    assert relative(result.sensor(head[3]), expected) < abs(q[:, -elastic:] @ rows.T).max()

    near = item.kinematics.at(np.array([body.nearest_node((0.005, 0.004, 0.06))]))
    np.testing.assert_allclose(result.sensor(corner[0]), near.place(q)[:, 0], atol=1e-12)
    np.testing.assert_allclose(result.sensor(corner[1]), near.velocities(q, q_t)[:, 0], atol=1e-9)
    assert relative(result.sensor(point[0])[0], PLACE + item.kinematics.frame(q)[1][0] @ inside) < 1e-4


def test_points_reproduce_linear_fields(body):
    for point in ([0.001, 0.002, 0.033], [0.005, 0.0013, 0.021], [-0.005, 0.004, 0.06]):
        nodes, weights = interpolation(body.points, np.array(point))
        assert weights.sum() == pytest.approx(1, abs=1e-12)
        np.testing.assert_allclose(weights @ body.points[nodes], point, atol=1e-14)
    assert len(nodes) == 1  # a corner is a node
    with pytest.raises(InputError, match=r"point: expected a point on or in the body, got .* away from its nearest"):
        interpolation(body.points, np.array([0.02, 0, 0.03]))


def static_solver(mbs):
    solver, settings = exu.MainSolverStatic(), exu.SimulationSettings()
    settings.staticSolver.verboseMode, settings.solution.file.write = 0, False
    solver.InitializeSolver(mbs, settings)
    mbs.sys["dynamicSolver"] = solver
    return solver


def right_hand_side(mbs, solver, q, q_t):
    data = mbs.systemData
    data.SetODE2Coordinates(q)
    data.SetODE2Coordinates_t(q_t)
    solver.ComputeODE2RHS(mbs)
    return np.array(solver.GetSystemResidual())[: len(q)]


def test_jacobians_by_finite_differences(mbs, body):
    """Forces of springs and dampers by rotations of the body's axes, as Exudyn's Lie group integrators take them."""
    item = ep.CreatePartitionBody(mbs, body, inertiaTerms=[], **in_frame("floating"))
    head, point = item.CreateInterfaceMarker(mbs, "head"), item.CreatePointMarker(mbs, (0.005, 0.001, 0.021))
    stiffness, damping = np.diag([1e6, 2e6, 3e6, 1e3, 2e3, 3e3]), np.diag([1e2, 2e2, 3e2, 0.1, 0.2, 0.3])
    ends = ground(mbs, PLACE + TURNED @ [0, 0, 0.06], TURNED), ground(mbs, PLACE)
    mbs.AddObject(items.RigidBodySpringDamper(markerNumbers=[ends[0], head], stiffness=stiffness, damping=damping))
    mbs.AddObject(items.SpringDamper(markerNumbers=[ends[1], point], stiffness=1e6, damping=1e2, referenceLength=0.02))
    mbs.Assemble()
    n = mbs.systemData.ODE2Size()
    rng = np.random.default_rng(1)
    q, q_t = 1e-6 * rng.standard_normal((2, n))
    q[3:6] = [0.02, -0.01, 0.03]
    solver = static_solver(mbs)
    reference = mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Reference)[3:6]
    axes = Rotation.from_rotvec(reference + q[3:6])

    def moved(k, step):
        x = q.copy()
        x[k] += step
        if 3 <= k < 6:
            x[3:6] = (axes * Rotation.from_rotvec(step * np.eye(n)[k, 3:6])).as_rotvec() - reference
        return x

    for factors, at in (
        ((-1.0, 0.0), lambda k, h: right_hand_side(mbs, solver, moved(k, h), q_t)),
        ((0.0, -1.0), lambda k, h: right_hand_side(mbs, solver, q, q_t + h * np.eye(n)[k])),
    ):
        right_hand_side(mbs, solver, q, q_t)
        solver.ComputeJacobianODE2RHS(mbs, scalarFactor_ODE2=factors[0], scalarFactor_ODE2_t=factors[1])
        jacobian = np.array(solver.GetSystemJacobian())[:n, :n]
        expected = np.array([(at(k, 1e-6) - at(k, -1e-6)) / 2e-6 for k in range(n)]).T
        assert min(relative(jacobian, expected), relative(-jacobian, expected)) < 1e-6


def test_loads_are_generalised_forces(mbs, body, frame):
    """Force and moment on an interface, force on a node and a point, by their power."""
    item = ep.CreatePartitionBody(mbs, body, **in_frame(frame))
    force, moment = np.array([3.0, -2.0, 5.0]), np.array([0.1, 0.4, -0.2])
    head = item.CreateInterfaceMarker(mbs, "head")
    mbs.AddLoad(items.LoadForceVector(markerNumber=head, loadVector=force))
    mbs.AddLoad(items.LoadTorqueVector(markerNumber=head, loadVector=moment))
    corner = (0.005, -0.004, 0.0)
    mbs.AddLoad(items.LoadForceVector(markerNumber=item.CreateNodeMarker(mbs, corner), loadVector=force))
    mbs.Assemble()
    solver = static_solver(mbs)
    n = mbs.systemData.ODE2Size()
    got = right_hand_side(mbs, solver, np.zeros(n), np.zeros(n))[: body.n_dofs]
    interface = body.partition.find_interface("head")
    A = TURNED if frame == "floating" else np.eye(3)
    nodal = (np.r_[A.T @ force, A.T @ moment] @ interface.motion).reshape(-1, 3) @ A.T
    zero = np.zeros(body.n_dofs)
    expected = item.kinematics.at(interface.nodes).generalised(zero, nodal)
    expected = expected + item.kinematics.at(np.array([body.nearest_node(corner)])).generalised(zero, force[None])
    np.testing.assert_allclose(abs(got), abs(expected), atol=1e-9 * abs(expected).max())


# --- joints


def tied_matrices(link, held):
    """FE model with rigid interfaces tied, without columns `held` of the foot: stiffness, mass, others' columns."""
    model = tie(*link)
    moving = np.setdiff1d(np.arange(model.n), model.interface_columns[:6][np.array(held, dtype=bool)])
    return model, moving, model.stiffness[moving][:, moving].tocsc(), model.mass[moving][:, moving].tocsc()


def jointed(body, frame, axes=(1,) * 6, **options):
    """The foot on a joint at the origin."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame=frame, **options)
    joint = items.GenericJoint(markerNumbers=[ground(mbs), item.CreateInterfaceMarker(mbs, "foot")])
    joint.constrainedAxes = list(axes)
    return mbs, item, mbs.AddObject(joint)


def test_frequencies_of_the_hinged_body(link, body, frame):
    mbs, _, _ = jointed(body, frame, HINGE)
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    values = np.sort(mbs.ComputeODE2Eigenvalues(settings)[0])
    _, _, K, M = tied_matrices(link, HINGE)
    expected = np.sort(scipy.sparse.linalg.eigsh(K, 6, M, sigma=-1e6, return_eigenvectors=False))
    assert abs(values[0]) < 1e-6 * expected[1]  # it swings
    np.testing.assert_allclose(np.sqrt(values[1:5] / expected[1:5]), 1, atol=1e-3)


def test_hanging_body(link, body, frame):
    """Static answer and reaction to gravity: what the joint takes is in the basis, and so is the answer to weight."""
    gravity = np.array([3.0, 0.0, 9.0])
    mbs, item, joint = jointed(body, frame, gravity=gravity)
    head = item.CreateInterfaceMarker(mbs, "head")
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write, settings.staticSolver.verboseMode = False, 0
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    mbs.SolveStatic(settings)
    reaction = mbs.GetObjectOutput(joint, KIND.ForceLocal)
    np.testing.assert_allclose(abs(reaction), body.total_mass * gravity, atol=1e-8)
    moment = np.cross(body.centre_of_mass, body.total_mass * gravity)
    np.testing.assert_allclose(abs(mbs.GetObjectOutput(joint, KIND.TorqueLocal)), abs(moment), atol=1e-8)
    model, moving, K, _ = tied_matrices(link, [1] * 6)
    load = model.expand.T @ (link[0].mass @ np.tile(gravity, link[0].n_nodes))
    u = np.zeros(model.n)
    u[moving] = scipy.sparse.linalg.spsolve(K, load[moving])
    mean = link[1].find_interface("head")
    expected = mean.motion[:3] @ (model.expand @ u)[node_dofs(mean.nodes)]
    got = mbs.GetMarkerOutput(head, KIND.Position) - mean.position
    assert relative(got, expected) < 1e-6
    assert got[2] == pytest.approx(9.0 * ep.STEEL.rho * 0.06**2 / (2 * ep.STEEL.E), rel=0.02)


GRAVITY = np.array([2e4, 0.0, 0.0])  # m/s2, so that the pendulum bends while it swings through a quarter


def by_exudyn(fem, body, partition):
    """Exudyn's own floating frame on the same modes: model, markers of foot and head."""
    model = FEMinterface()
    model.nodes["Position"] = fem.points - fem.centre_of_mass
    model.massMatrix, model.stiffnessMatrix = sp.csr_matrix(fem.mass), sp.csr_matrix(fem.stiffness)
    model.modeBasis = {"matrix": np.array(body.basis.shapes[:, 6:]), "type": "NormalModes"}
    model.elements = [{"Name": "solid", "Tet4": fem.cells[:, :4]}]
    modes = ObjectFFRFreducedOrderInterface(model, rigidBodyNodeType=exu.NodeType.RotationRotationVector)
    mbs = exu.SystemContainer().AddSystem()
    keys = modes.AddObjectFFRFreducedOrder(mbs, positionRef=fem.centre_of_mass, gravity=list(GRAVITY))
    markers = [
        mbs.AddMarker(
            items.MarkerSuperElementRigid(
                bodyNumber=keys["oFFRFreducedOrder"],
                meshNodeNumbers=[*map(int, interface.nodes)],
                weightingFactors=interface.weights,
            )
        )
        for interface in partition.interfaces
    ]
    return mbs, markers


def swing(mbs, foot, head):
    """The pendulum on a hinge: result, places of the head, deflection of the head in the foot's axes."""
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground(mbs), foot], constrainedAxes=HINGE))
    place, axes = sensors(mbs, head, [KIND.Position]) + sensors(mbs, foot, [KIND.RotationMatrix])
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=4e-3, step=2e-5, method="implicit")
    x = result.sensor(place)
    return result, x, np.einsum("tba,tb->ta", result.sensor(axes).reshape(-1, 3, 3), x) - x[0]


def test_flexible_pendulum_against_exudyn_s_own_floating_frame(mbs, link, body):
    """All but outer forces on inertia that has changed with deformation; it swings through a quarter and bends."""
    item = ep.CreatePartitionBody(mbs, body, frame="floating", gravity=GRAVITY)
    result, x, bent = swing(mbs, item.CreateInterfaceMarker(mbs, "foot"), item.CreateInterfaceMarker(mbs, "head"))
    other, markers = by_exudyn(link[0], body, link[1])
    _, expected, expected_bent = swing(other, *markers)
    assert np.ptp(x, axis=0).max() > 0.06
    assert relative(x - x[0], expected - expected[0]) < 1e-4
    assert relative(bent, expected_bent) < 1e-2
    centre = item.kinematics.frame(item.coordinates(result))[0]
    energy = item.energy(result) - body.total_mass * centre @ GRAVITY
    assert abs(energy - energy[0]).max() < 5e-3 * item.energy(result).max()


def test_joint_forces_near_zero_rotation_keep_their_digits(body):
    """Exudyn's composition of small rotation vectors loses half of them, which short steps turn into forces."""
    forces = []
    for frame in ("inertial", "floating"):
        mbs, _, joint = jointed(body, frame, gravity=[9.81, 0, 0])
        force = mbs.AddSensor(
            items.SensorObject(objectNumber=joint, outputVariableType=KIND.ForceLocal, storeInternal=True)
        )
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=5e-4, step=2e-6, method="implicit")
        forces.append(result.sensor(force)[:, 0])
    assert relative(forces[1], forces[0]) < 1e-3


def test_bushing_explicit_and_implicit(body, frame):
    """Springs and dampers at an interface: one motion by every solver and in both frames."""
    heads = []
    for method, step in (("explicit", 2e-7), ("implicit", 5e-7)):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, body, frame=frame, gravity=[9.81, 0, 0])
        foot, head = (item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
        mbs.AddObject(
            items.RigidBodySpringDamper(
                markerNumbers=[ground(mbs), foot],
                stiffness=np.diag([1e6] * 3 + [30.0] * 3),
                damping=np.diag([10.0] * 3 + [1e-3] * 3),
            )
        )
        (place,) = sensors(mbs, head, [KIND.Position])
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=1e-3, step=step, method=method, sample_period=1e-5)
        heads.append(result.sensor(place)[:, 0])
    assert heads[0].max() > 1e-6
    assert relative(*heads) < 1e-3


# --- existing models


def test_keys_of_exudyn_s_own_reduced_bodies(mbs, link, body, frame):
    """What `mbs.CreateFFRFReducedOrderObject` and `AddObjectFFRFreducedOrder` return, and what attaches to it."""
    item = ep.CreatePartitionBody(mbs, body, name="link", superElement=True, **in_frame(frame))
    own = item["FFRFReducedOrderObjectDict"]
    assert {"nRigidBody", "nGenericODE2", "oFFRFreducedOrder"} == set(own)
    assert all(item[key] == own[key] for key in own)
    assert item["link:foot"] == item.CreateInterfaceMarker(mbs, "foot") != item["link:head"]
    interface = link[1].find_interface("head")
    by_nodes = mbs.AddMarker(
        items.MarkerSuperElementRigid(
            bodyNumber=item["oFFRFreducedOrder"],
            meshNodeNumbers=[*map(int, interface.nodes)],
            weightingFactors=interface.weights,
        )
    )
    node = body.nearest_node((0.005, 0.004, 0.06))
    corner = mbs.AddSensor(
        items.SensorSuperElement(
            bodyNumber=item["oFFRFreducedOrder"],
            meshNodeNumber=node,
            outputVariableType=KIND.Position,
            storeInternal=True,
        )
    )
    both = [sensors(mbs, m, [KIND.Position, KIND.RotationMatrix, KIND.Velocity]) for m in (by_nodes, item["link:head"])]
    mbs.AddLoad(items.LoadForceVector(markerNumber=item["link:head"], loadVector=[10, 20, 30]))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=5e-5, step=5e-7)
    for by_nodes, by_interface in zip(*both, strict=True):
        np.testing.assert_allclose(result.sensor(by_nodes), result.sensor(by_interface), rtol=1e-6, atol=1e-9)
    place = item.kinematics.at(np.array([node])).place(item.coordinates(result))[:, 0]
    np.testing.assert_allclose(result.sensor(corner), place, atol=1e-12)


def test_bodies_without_names(mbs, body, frame):
    first, second = (ep.CreatePartitionBody(mbs, body, frame=frame, superElement=True) for _ in range(2))
    assert first["head"] != second["head"]


# --- bad input


def test_misuse(mbs, link, body):
    item = ep.CreatePartitionBody(mbs, body)
    for missing in ("pin", None):
        with pytest.raises(
            InputError, match=r"expected one of 'foot', 'head', got .* reduced away.*Partition.interface"
        ):
            item.CreateInterfaceMarker(mbs, missing)
    other = exu.SystemContainer().AddSystem()
    for create in (
        lambda: item.CreateInterfaceMarker(other, "foot"),
        lambda: item.CreateNodeMarker(other, (0, 0, 0)),
        lambda: item.CreatePointMarker(other, (0, 0, 0)),
    ):
        with pytest.raises(InputError, match="mbs: body '' belongs to another model, or to this one before a Reset"):
            create()
    mbs.Reset()
    with pytest.raises(InputError, match="before a Reset"):
        item.CreateInterfaceMarker(mbs, "foot")
    region = ep.Partition.ball(link[0], (0.005, 0, 0.03), 5e-3)
    nodal = ep.CreatePartitionBody(mbs, ep.reduce(link[0], region | link[1], basis="free", f_cut=F_CUT))
    with pytest.raises(InputError, match=r"basis 'free' keeps nodes as coordinates, .* Take frame='floating'"):
        nodal.CreateNodeMarker(mbs, (0, 0, 0))
    with pytest.raises(InputError, match=r"gravity: expected shape \(3,\)"):
        ep.CreatePartitionBody(mbs, body, gravity=-9.81)


def test_both_frames_of_a_basis_that_keeps_nodes(link):
    """A tip hung on a joint and pushed, moves by its tied marker as by that of a floating frame."""
    region = ep.Partition.ball(link[0], (0.005, 0, 0.03), 5e-3)
    body = ep.reduce(link[0], region | link[1], basis="free", f_cut=F_CUT)
    histories = []
    for frame in ("inertial", "floating"):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, body, frame=frame, gravity=[0, 0, -9.81])
        foot, head = (item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
        mbs.AddObject(items.GenericJoint(markerNumbers=[ground(mbs), foot], constrainedAxes=[1] * 6))
        mbs.AddLoad(items.Force(markerNumber=head, loadVector=[5.0, 3.0, 0.0]))
        sensor, *_ = sensors(mbs, head, [KIND.Position])
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=1e-3, step=2e-6, method="implicit")
        histories.append(result.sensor(sensor) - (0, 0, 0.06))
    assert abs(histories[0]).max() > 1e-6
    assert relative(histories[1], histories[0]) < 1e-4


def test_an_interface_of_a_basis_that_keeps_nodes(mbs, link):
    """Its marker goes where the interface goes: a free body that turns slowly, and a joint that stops it."""
    region = ep.Partition.ball(link[0], (0.005, 0, 0.03), 5e-3)
    body = ep.reduce(link[0], region | link[1], basis="free", f_cut=F_CUT)
    item = ep.CreatePartitionBody(
        mbs, body, name="bar", referencePosition=[1, 2, 3], initialVelocity=[1, 2, 3], initialAngularVelocity=[1, 2, 3]
    )
    marker = item.CreateInterfaceMarker(mbs, "head")
    assert item.CreateInterfaceMarker(mbs, "head") == marker
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-5, step=1e-6, method="implicit")
    rows = body.interface_rows("head")
    place = np.add(body.partition.find_interface("head").position, [1, 2, 3])
    position, velocity = (
        mbs.GetMarkerOutput(marker, getattr(exu.OutputVariableType, kind)) for kind in ("Position", "Velocity")
    )
    np.testing.assert_allclose(position, place + (rows @ item.coordinates(result)[-1])[:3], atol=1e-12)
    np.testing.assert_allclose(velocity, (rows @ item.coordinates_t(result)[-1])[:3], rtol=1e-6)
    assert item.momentum(result)[-1] == pytest.approx(body.total_mass * np.array([1, 2, 3]), rel=1e-5)


def test_joints_on_nodes_that_were_reduced_away(mbs, body, frame):
    item = ep.CreatePartitionBody(mbs, body, frame=frame)
    assert not any("dents" in sentence for sentence in item.left_out)
    marker = item.CreateNodeMarker(mbs, (0.005, 0.004, 0.03))
    assert any("dents" in sentence for sentence in item.left_out)
    mbs.AddObject(items.SphericalJoint(name="ball", markerNumbers=[ground(mbs, (0.005, 0.004, 0.03)), marker]))
    mbs.Assemble()
    with pytest.raises(
        InputError, match=r"JointSpherical 'ball', object \d+, is attached to the body's point .* reduced"
    ):
        ep.solve_dynamic(mbs, end_time=1e-5, method="implicit")


def test_joints_on_nodes_of_a_rigid_interface(mbs, body, frame):
    """Their motion is the interface's; Euler parameters of other bodies have constraints without markers."""
    item = ep.CreatePartitionBody(mbs, body, frame=frame)
    corner = item.CreateNodeMarker(mbs, (0.005, 0.004, 0.0))
    inertia = exudyn.utilities.RigidBodyInertia(mass=1.0, inertiaTensor=np.eye(3))
    other = mbs.CreateRigidBody(inertia=inertia, referencePosition=[0.005, 0.004, 0])
    mbs.AddObject(items.SphericalJoint(markerNumbers=[mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=other)), corner]))
    mbs.Assemble()
    assert ep.solve_dynamic(mbs, end_time=1e-5, method="implicit").status == "finished"


def test_a_mechanism_that_overlaps_at_the_start(mbs, bodies, frame):
    """Floating or not, turned or not: a contact looks where its bodies are put."""
    upside_down = {"referenceRotation": np.diag([1.0, -1.0, -1.0])} if frame == "floating" else {}
    target = ep.CreatePartitionBody(mbs, bodies[1], frame=frame, referencePosition=PLACE, **upside_down)
    down = -1 if upside_down else 1
    place = PLACE + np.array([0, 0, down * (0.03 - 1e-4)])
    striker = ep.CreatePartitionBody(mbs, bodies[0], frame=frame, referencePosition=place, **upside_down)
    with pytest.raises(PenetrationError, match=r"start inside the other body, the worst by (0\.0001|9\.99\d*e-05) m"):
        ep.CreatePartitionContact(mbs, striker, target)


def test_initial_velocities_that_violate_a_joint(body, frame):
    for velocity, allowed in (([0.15, 0, 0], True), ([0.16, 0, 0], False), ([0, 0, 0], False)):
        mbs, *_ = jointed(body, frame, HINGE, initialVelocity=velocity, initialAngularVelocity=[0, 5, 0])
        mbs.Assemble()
        if allowed:
            assert ep.solve_dynamic(mbs, end_time=2e-5, step=2e-6, method="implicit").status == "finished"
        else:
            with pytest.raises(InputError, match=r"JointGeneric .* violated by the initial velocities, by 0\.\d+"):
                ep.solve_dynamic(mbs, end_time=2e-5, step=2e-6, method="implicit")


@pytest.mark.parametrize("method", ["implicit", "explicit"])
def test_a_joint_whose_markers_do_not_meet(body, frame, method):
    mbs, *_ = jointed(body, frame, HINGE, referencePosition=[0.2, 0, 0])
    mbs.Assemble()
    with pytest.raises(InputError, match=r"JointGeneric .* is open by 0\.2 \(m or rad\) at the start, where bodies"):
        ep.solve_dynamic(mbs, end_time=2e-5, step=2e-6, method=method)


@pytest.mark.parametrize(("method", "step"), [("implicit", 2e-6), ("implicit", 2e-5), ("explicit", 5e-7)])
def test_a_small_gap_in_a_joint(body, frame, method, step):
    """A hinge that is open by a micrometre: what closing it brings is told, and is what the first step has."""
    for gap in (0.0, 1e-6):
        mbs, item, hinge = jointed(body, frame, HINGE, gravity=[9.81, 0, 0], referencePosition=[gap, 0, gap])
        kind = {"outputVariableType": KIND.ForceLocal, "storeInternal": True}
        force = mbs.AddSensor(items.SensorObject(objectNumber=hinge, **kind))
        mbs.Assemble()
        options = {"end_time": 60 * step, "step": step, "method": method}
        if not gap:
            sound = ep.solve_dynamic(mbs, **options)
            assert abs(sound.sensor(force)).max() < 2 * 9.81 * body.total_mass
            continue
        with pytest.warns(ModelLimitWarning, match=r"JointGeneric .* is open by 1e-06 .* position=") as caught:
            result = ep.solve_dynamic(mbs, **options)
    brings = float(re.search(r"brings (\S+) J", str(caught[0].message))[1])
    assert brings == pytest.approx(item.energy(result)[1], rel=0.5)
    assert brings > 100 * body.total_mass * 9.81 * 1e-6  # far more than gravity does over the gap
    if step == 2e-6:  # a spike in the force, too: with longer steps it goes on
        assert "N or N m in its sensor" in str(caught[0].message)


def test_joints_of_round_off_are_closed(body, frame):
    """A mechanism far from the origin, whose places are not exact in binary: none of its joints is named."""
    place = np.array([0.7, -1.3, 2.1])
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame=frame, referencePosition=place, gravity=[9.81, 0, 0])
    foot = item.CreateInterfaceMarker(mbs, "foot")
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground(mbs, place), foot], constrainedAxes=HINGE))
    mbs.Assemble()
    assert ep.solve_dynamic(mbs, end_time=2e-5, step=1e-6, method="implicit").status == "finished"


def test_wrong_types_are_named(mbs, link, body):
    item = ep.CreatePartitionBody(mbs, body, name="bar")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-6)
    for call in (
        lambda: item.coordinates(None),
        lambda: item.velocity(result, None),
        lambda: item.displacement((0, 0, 0), result),
        lambda: item.velocity(result, (0, 0, 0), fem="bar"),
        lambda: item.recover(result, np.eye(3)),
        lambda: item.deformation(None),
        lambda: item.CreateInterfaceMarker(mbs, np.zeros(2)),
        lambda: item.CreateInterfaceMarker("head", mbs),
        lambda: item.CreatePointMarker(mbs, [np.nan] * 3),
        lambda: ep.CreatePartitionBody(mbs, body, superElement=1),
        lambda: ep.CreatePartitionBody(mbs, body, inertiaTerms=None),
        lambda: ep.Partition.interface(link[0], "pin", [None] * 3),
        lambda: ep.Partition.interface(link[0], "pin", [0.0, 1.0, 2.0]),
        lambda: ep.Partition.interface(link[0], "pin", [0, 1, 2], position="here"),
        lambda: link[1] | None,
    ):
        with pytest.raises(InputError, match="expected"):
            call()
