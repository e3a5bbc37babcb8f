"""Markers of interfaces, nodes and points: kinematics, Jacobians, joints, springs, loads, gravity, existing models."""

import exudyn as exu
import exudyn.itemInterface as items
import exudyn.utilities
import numpy as np
import pytest
from oracles import ground, relative, sensors
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import InputError, PenetrationError

F_CUT = 60e3


PLACE = np.array([0.1, -0.2, 0.3])


TURNED = Rotation.from_rotvec([0.5, -1.0, 0.7]).as_matrix()


KIND = exu.OutputVariableType


def in_frame(frame):
    """Options of a body somewhere in space; one that floats is turned."""
    return {"frame": frame, "referencePosition": PLACE} | ({"referenceRotation": TURNED} if frame == "floating" else {})


# --- kinematics


def test_markers_move_as_interfaces_nodes_and_points(mbs, arm, arm_body, frame):
    partition = arm[1]
    item = ep.CreatePartitionBody(mbs, arm_body, **in_frame(frame))
    start = 1e-6 * np.random.default_rng(0).standard_normal((2, arm_body.n_dofs))
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
    grown = item.kinematics.at(mean.nodes).grown(q_t)  # by rotation, which markers on nodes do not follow
    size = 0.0 if grown is None else abs(grown).max()
    apart = size * np.linalg.norm(q_t[:, 3:6], axis=1).max()
    assert apart < 1e-7 * abs(q_t[:, :3]).max()

    end = item.kinematics.at(mean.nodes)
    np.testing.assert_allclose(result.sensor(head[0]), mean.weights @ end.place(q), atol=1e-12)
    np.testing.assert_allclose(result.sensor(head[1]), mean.weights @ end.velocities(q, q_t), atol=1e-9 + apart)
    A = item.kinematics.frame(q)[1]
    rows = mean.motion[3:] @ end.rows
    elastic = rows.shape[1]
    turn = Rotation.from_rotvec(q[:, -elastic:] @ rows.T).as_matrix()
    np.testing.assert_allclose(result.sensor(head[2]).reshape(-1, 3, 3), A @ turn, atol=1e-12)
    turning = q_t[:, 3:6] @ item.kinematics.node_axes.T if frame == "floating" else 0
    spin = turning + q_t[:, -elastic:] @ rows.T
    expected = np.einsum("tab,tb->ta", A, spin)  # but for the curvature of rotations
    assert relative(result.sensor(head[3]), expected) < abs(q[:, -elastic:] @ rows.T).max()

    near = item.kinematics.at(np.array([arm_body.nearest_node((0.005, 0.004, 0.06))]))
    np.testing.assert_allclose(result.sensor(corner[0]), near.place(q)[:, 0], atol=1e-12)
    np.testing.assert_allclose(result.sensor(corner[1]), near.velocities(q, q_t)[:, 0], atol=1e-9 + apart)
    assert relative(result.sensor(point[0])[0], PLACE + item.kinematics.frame(q)[1][0] @ inside) < 1e-4
    np.testing.assert_allclose(item.velocity(result, inside), result.sensor(point[1]), atol=1e-9 + apart)
    way = item.displacement(result, inside)
    np.testing.assert_allclose(way - way[0], result.sensor(point[0]) - result.sensor(point[0])[0], atol=1e-12 + size)


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


def test_jacobians_by_finite_differences(mbs, arm_body):
    """Forces of springs and dampers by rotations of the body's axes, as Exudyn's Lie group integrators take them."""
    item = ep.CreatePartitionBody(mbs, arm_body, inertiaTerms=[], **in_frame("floating"))
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


def test_loads_are_generalised_forces(mbs, arm_body, frame):
    """Force and moment on an interface, force on a node and a point, by their power."""
    item = ep.CreatePartitionBody(mbs, arm_body, **in_frame(frame))
    force, moment = np.array([3.0, -2.0, 5.0]), np.array([0.1, 0.4, -0.2])
    head = item.CreateInterfaceMarker(mbs, "head")
    mbs.AddLoad(items.LoadForceVector(markerNumber=head, loadVector=force))
    mbs.AddLoad(items.LoadTorqueVector(markerNumber=head, loadVector=moment))
    corner = (0.005, -0.004, 0.0)
    mbs.AddLoad(items.LoadForceVector(markerNumber=item.CreateNodeMarker(mbs, corner), loadVector=force))
    mbs.Assemble()
    solver = static_solver(mbs)
    n = mbs.systemData.ODE2Size()
    got = right_hand_side(mbs, solver, np.zeros(n), np.zeros(n))[: arm_body.n_dofs]
    interface = arm_body.partition.find_interface("head")
    A = TURNED if frame == "floating" else np.eye(3)
    nodal = (np.r_[A.T @ force, A.T @ moment] @ interface.motion).reshape(-1, 3) @ A.T
    zero = np.zeros(arm_body.n_dofs)
    expected = item.kinematics.at(interface.nodes).generalised(zero, nodal)
    expected = expected + item.kinematics.at(np.array([arm_body.nearest_node(corner)])).generalised(zero, force[None])
    np.testing.assert_allclose(abs(got), abs(expected), atol=1e-9 * abs(expected).max())


# --- existing models


def test_keys_of_exudyn_s_own_reduced_bodies(mbs, arm, arm_body, frame):
    """What `mbs.CreateFFRFReducedOrderObject` and `AddObjectFFRFreducedOrder` return, and what attaches to it."""
    item = ep.CreatePartitionBody(mbs, arm_body, name="link", superElement=True, **in_frame(frame))
    own = item["FFRFReducedOrderObjectDict"]
    assert {"nRigidBody", "nGenericODE2", "oFFRFreducedOrder"} == set(own)
    assert all(item[key] == own[key] for key in own)
    assert item["link:foot"] == item.CreateInterfaceMarker(mbs, "foot") != item["link:head"]
    interface = arm[1].find_interface("head")
    by_nodes = mbs.AddMarker(
        items.MarkerSuperElementRigid(
            bodyNumber=item["oFFRFreducedOrder"],
            meshNodeNumbers=[*map(int, interface.nodes)],
            weightingFactors=interface.weights,
        )
    )
    node = arm_body.nearest_node((0.005, 0.004, 0.06))
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


def test_bodies_without_names(mbs, arm_body, frame):
    first, second = (ep.CreatePartitionBody(mbs, arm_body, frame=frame, superElement=True) for _ in range(2))
    assert first["head"] != second["head"]


# --- bad input


def test_misuse(mbs, arm, arm_body):
    item = ep.CreatePartitionBody(mbs, arm_body)
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
    region = ep.Partition.ball(arm[0], (0.005, 0, 0.03), 5e-3)
    nodal = ep.CreatePartitionBody(mbs, ep.reduce(arm[0], region | arm[1], basis="free", f_cut=F_CUT))
    with pytest.raises(InputError, match=r"basis 'free' keeps nodes as coordinates, .* Take frame='floating'"):
        nodal.CreateNodeMarker(mbs, (0, 0, 0))
    with pytest.raises(InputError, match=r"gravity: expected shape \(3,\)"):
        ep.CreatePartitionBody(mbs, arm_body, gravity=-9.81)


def test_a_mechanism_that_overlaps_at_the_start(mbs, bodies, frame):
    """Floating or not, turned or not: a contact looks where its bodies are put."""
    upside_down = {"referenceRotation": np.diag([1.0, -1.0, -1.0])} if frame == "floating" else {}
    target = ep.CreatePartitionBody(mbs, bodies[1], frame=frame, referencePosition=PLACE, **upside_down)
    down = -1 if upside_down else 1
    place = PLACE + np.array([0, 0, down * (0.03 - 1e-4)])
    striker = ep.CreatePartitionBody(mbs, bodies[0], frame=frame, referencePosition=place, **upside_down)
    with pytest.raises(PenetrationError, match=r"start inside the other body, the worst by (0\.0001|9\.99\d*e-05) m"):
        ep.CreatePartitionContact(mbs, striker, target)


def test_wrong_types_are_named(mbs, arm, arm_body):
    item = ep.CreatePartitionBody(mbs, arm_body, name="bar")
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
        lambda: ep.CreatePartitionBody(mbs, arm_body, superElement=1),
        lambda: ep.CreatePartitionBody(mbs, arm_body, inertiaTerms=None),
        lambda: ep.Partition.interface(arm[0], "pin", [None] * 3),
        lambda: ep.Partition.interface(arm[0], "pin", [0.0, 1.0, 2.0]),
        lambda: ep.Partition.interface(arm[0], "pin", [0, 1, 2], position="here"),
        lambda: arm[1] | None,
    ):
        with pytest.raises(InputError, match="expected"):
            call()
