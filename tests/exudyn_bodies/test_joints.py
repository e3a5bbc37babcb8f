"""Joints on a reduced body in both frames: frequencies, statics, pendulum, bushing, and bases that keep nodes."""

from functools import partial

import exudyn as exu
import exudyn.itemInterface as items
import exudyn.utilities
import numpy as np
import pytest
import scipy.sparse.linalg
from oracles import HINGE, by_exudyn, each_way, ground, jointed, relative, sensors

import exudyn_partition as ep
from exudyn_partition.exudyn_bodies.joints import Joints, mass_and_rows
from exudyn_partition.fe.model import node_dofs
from exudyn_partition.reduction.tied import tie

# --- joints

F_CUT = 60e3
KIND = exu.OutputVariableType


def tied_matrices(arm, held):
    """FE model with rigid interfaces tied, without columns `held` of the foot: stiffness, mass, others' columns."""
    model = tie(*arm)
    moving = np.setdiff1d(np.arange(model.n), model.interface_columns[:6][np.array(held, dtype=bool)])
    return model, moving, model.stiffness[moving][:, moving].tocsc(), model.mass[moving][:, moving].tocsc()


def test_frequencies_of_the_hinged_body(arm, arm_body, frame):
    mbs, _, _ = jointed(arm_body, frame, HINGE)
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    values = np.sort(mbs.ComputeODE2Eigenvalues(settings)[0])
    _, _, K, M = tied_matrices(arm, HINGE)
    expected = np.sort(scipy.sparse.linalg.eigsh(K, 6, M, sigma=-1e6, return_eigenvectors=False))
    assert abs(values[0]) < 1e-6 * expected[1]  # it swings
    np.testing.assert_allclose(np.sqrt(values[1:5] / expected[1:5]), 1, atol=1e-3)


def test_hanging_body(arm, arm_body, frame):
    """Static answer and reaction to gravity: what the joint takes is in the basis, and so is the answer to weight."""
    gravity = np.array([3.0, 0.0, 9.0])
    mbs, item, joint = jointed(arm_body, frame, gravity=gravity)
    head = item.CreateInterfaceMarker(mbs, "head")
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write, settings.staticSolver.verboseMode = False, 0
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    mbs.SolveStatic(settings)
    reaction = mbs.GetObjectOutput(joint, KIND.ForceLocal)
    np.testing.assert_allclose(abs(reaction), arm_body.total_mass * gravity, atol=1e-8)
    moment = np.cross(arm_body.centre_of_mass, arm_body.total_mass * gravity)
    np.testing.assert_allclose(abs(mbs.GetObjectOutput(joint, KIND.TorqueLocal)), abs(moment), atol=1e-8)
    model, moving, K, _ = tied_matrices(arm, [1] * 6)
    load = model.expand.T @ (arm[0].mass @ np.tile(gravity, arm[0].n_nodes))
    u = np.zeros(model.n)
    u[moving] = scipy.sparse.linalg.spsolve(K, load[moving])
    mean = arm[1].find_interface("head")
    expected = mean.motion[:3] @ (model.expand @ u)[node_dofs(mean.nodes)]
    got = mbs.GetMarkerOutput(head, KIND.Position) - mean.position
    assert relative(got, expected) < 1e-6
    assert got[2] == pytest.approx(9.0 * ep.STEEL.rho * 0.06**2 / (2 * ep.STEEL.E), rel=0.02)


GRAVITY = np.array([2e4, 0.0, 0.0])  # m/s2, so that the pendulum bends while it swings through a quarter


def swing(mbs, foot, head):
    """The pendulum on a hinge: result, places of the head, deflection of the head in the foot's axes."""
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground(mbs), foot], constrainedAxes=HINGE))
    place, axes = sensors(mbs, head, [KIND.Position]) + sensors(mbs, foot, [KIND.RotationMatrix])
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=4e-3, step=2e-5, method="implicit")
    x = result.sensor(place)
    return result, x, np.einsum("tba,tb->ta", result.sensor(axes).reshape(-1, 3, 3), x) - x[0]


def test_flexible_pendulum_against_exudyn_s_own_floating_frame(mbs, arm, arm_body):
    """It swings through a quarter and bends. Ours keeps the inertia of its undeformed shape, as a joint acts on it."""
    item = ep.CreatePartitionBody(mbs, arm_body, frame="floating", gravity=GRAVITY)
    result, x, bent = swing(mbs, item.CreateInterfaceMarker(mbs, "foot"), item.CreateInterfaceMarker(mbs, "head"))
    other = exu.SystemContainer().AddSystem()
    markers = by_exudyn(other, *arm, arm_body, gravity=GRAVITY)
    _, expected, expected_bent = swing(other, *markers)
    assert np.ptp(x, axis=0).max() > 0.06
    assert relative(x - x[0], expected - expected[0]) < 2e-5
    assert relative(bent, expected_bent) < 2e-3
    centre = item.kinematics.frame(item.coordinates(result))[0]
    energy = item.energy(result) - arm_body.total_mass * centre @ GRAVITY
    assert abs(energy - energy[0]).max() < 5e-3 * item.energy(result).max()


def test_a_bent_body_rests_in_dynamics_as_in_statics(mbs, arm_body):
    """The axial force has a moment about the joint, by the deflection. Elastic forces must not add to it."""
    item = ep.CreatePartitionBody(mbs, arm_body, frame="floating")
    foot, head = (item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground(mbs), foot], constrainedAxes=[1] * 6))
    mbs.AddLoad(items.LoadForceVector(markerNumber=head, loadVector=[3e3, 0, 2e4]))
    mbs.Assemble()
    ep.solve_static(mbs, load_steps=1, update_initial=True)
    result = ep.solve_dynamic(mbs, end_time=1e-3, step=1e-5, method="implicit")
    bent = item.displacement(result, (0, 0, 0.06))
    assert abs(bent[0, 0]) > 1e-3
    assert abs(bent - bent[0]).max() < 1e-5 * abs(bent[0, 0])


def test_forces_act_on_the_true_mass_where_all_are_known(mbs, arm_body):
    """Gravity, by either way, deforms nothing; each other item of Exudyn is one whose force is not known."""
    item = ep.CreatePartitionBody(mbs, arm_body, frame="floating", gravity=GRAVITY)
    other = ep.CreatePartitionBody(mbs, arm_body, frame="floating")
    head = other.CreateInterfaceMarker(mbs, "head")
    item.CreateInterfaceMarker(mbs, "head")
    mass = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=item["oFFRFreducedOrder"]))
    mbs.AddLoad(items.LoadMassProportional(markerNumber=mass, loadVector=[0, 0, 1.0]))
    mbs.Assemble()
    ep.solve_dynamic(mbs, end_time=1e-6, step=1e-6, method="implicit")
    assert not item.kinematics.acting.constant
    mbs.AddLoad(items.LoadForceVector(markerNumber=head, loadVector=[1.0, 0, 0]))
    mbs.Assemble()
    ep.solve_dynamic(mbs, end_time=1e-6, step=1e-6, method="implicit")
    assert other.kinematics.acting.constant
    assert not item.kinematics.acting.constant


def test_bodies_tell_what_mass_forces_act_on(mbs, arm, arm_body):
    """In a floating frame; a body with geometric stiffness keeps its mass whatever acts on it."""
    item = ep.CreatePartitionBody(mbs, arm_body, frame="floating")
    assert any("where joints, springs or loads act: the change of the body's inertia" in said for said in item.left_out)
    stiffened = ep.reduce(*arm, f_cut=F_CUT, geometric_stiffness=True)
    other = ep.CreatePartitionBody(mbs, stiffened, frame="floating")
    assert any(said.startswith("inertia that changes with deformation") for said in other.left_out)
    assert other.kinematics.acting.constant


def test_joint_forces_near_zero_rotation_keep_their_digits(arm_body):
    """Exudyn's composition of small rotation vectors loses half of them, which short steps turn into forces."""
    forces = []
    for frame in ("inertial", "floating"):
        mbs, _, joint = jointed(arm_body, frame, gravity=[9.81, 0, 0])
        force = mbs.AddSensor(
            items.SensorObject(objectNumber=joint, outputVariableType=KIND.ForceLocal, storeInternal=True)
        )
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=5e-4, step=2e-6, method="implicit")
        forces.append(result.sensor(force)[:, 0])
    assert relative(forces[1], forces[0]) < 1e-3


def test_bushing_explicit_and_implicit(arm_body, frame):
    """Springs and dampers at an interface: one motion by every solver and in both frames."""
    heads = []
    for method, step in (("explicit", 2e-7), ("implicit", 5e-7)):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, arm_body, frame=frame, gravity=[9.81, 0, 0])
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


def test_explicit_steps_hold_joints_without_numba(arm_body):
    """As with it; a model whose joints are all springs has no rows that hold."""

    def swung(joint):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, arm_body, gravity=[9.81, 0, 0])
        mbs.AddObject(joint(markerNumbers=[ground(mbs), item.CreateInterfaceMarker(mbs, "foot")]))
        mbs.Assemble()
        return item.coordinates(ep.solve_dynamic(mbs, end_time=1e-5, step=1.5e-7))

    for joint in (items.SphericalJoint, partial(items.RigidBodySpringDamper, stiffness=1e6 * np.eye(6))):
        compiled, plain = each_way(lambda joint=joint: swung(joint))
        np.testing.assert_allclose(plain, compiled, rtol=0, atol=1e-10 * abs(compiled).max())


def test_masses_of_a_body_on_a_shaft(arm_body):
    """Those of the frame and of the shaft; the object that markers hang on has none. None of them varies."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, arm_body, frame="floating")
    node = mbs.AddNode(items.Node1D(referenceCoordinates=[0.0]))
    shaft = mbs.AddObject(items.ObjectRotationalMass1D(nodeNumber=node, inertia=2.5e-4))
    markers = [mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=shaft)), item.CreateInterfaceMarker(mbs, "foot")]
    mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=[1] * 6))
    mbs.Assemble()
    mass = mass_and_rows(mbs)[0]
    np.testing.assert_allclose(mass.diagonal(), np.append(item.kinematics.mass, 2.5e-4), rtol=1e-12)
    assert mass[-1].nnz == 1
    joints = Joints(mbs)
    assert joints.update()  # rows
    assert not joints.update()


def test_both_frames_of_a_basis_that_keeps_nodes(arm):
    """A tip hung on a joint and pushed, moves by its tied marker as by that of a floating frame."""
    region = ep.Partition.ball(arm[0], (0.005, 0, 0.03), 5e-3)
    arm_body = ep.reduce(arm[0], region | arm[1], basis="free", f_cut=F_CUT)
    histories = []
    for frame in ("inertial", "floating"):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, arm_body, frame=frame, gravity=[0, 0, -9.81])
        foot, head = (item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
        mbs.AddObject(items.GenericJoint(markerNumbers=[ground(mbs), foot], constrainedAxes=[1] * 6))
        mbs.AddLoad(items.Force(markerNumber=head, loadVector=[5.0, 3.0, 0.0]))
        sensor, *_ = sensors(mbs, head, [KIND.Position])
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=1e-3, step=2e-6, method="implicit")
        histories.append(result.sensor(sensor) - (0, 0, 0.06))
    assert abs(histories[0]).max() > 1e-6
    assert relative(histories[1], histories[0]) < 1e-4


def test_an_interface_of_a_basis_that_keeps_nodes(mbs, arm):
    """Its marker goes where the interface goes: a free body that turns slowly, and a joint that stops it."""
    region = ep.Partition.ball(arm[0], (0.005, 0, 0.03), 5e-3)
    arm_body = ep.reduce(arm[0], region | arm[1], basis="free", f_cut=F_CUT)
    item = ep.CreatePartitionBody(
        mbs,
        arm_body,
        name="bar",
        referencePosition=[1, 2, 3],
        initialVelocity=[1, 2, 3],
        initialAngularVelocity=[1, 2, 3],
    )
    marker = item.CreateInterfaceMarker(mbs, "head")
    assert item.CreateInterfaceMarker(mbs, "head") == marker
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-5, step=1e-6, method="implicit")
    rows = arm_body.interface_rows("head")
    place = np.add(arm_body.partition.find_interface("head").position, [1, 2, 3])
    position, velocity = (
        mbs.GetMarkerOutput(marker, getattr(exu.OutputVariableType, kind)) for kind in ("Position", "Velocity")
    )
    np.testing.assert_allclose(position, place + (rows @ item.coordinates(result)[-1])[:3], atol=1e-12)
    np.testing.assert_allclose(velocity, (rows @ item.coordinates_t(result)[-1])[:3], rtol=1e-6)
    assert item.momentum(result)[-1] == pytest.approx(arm_body.total_mass * np.array([1, 2, 3]), rel=1e-5)
