"""Rigid surfaces that Exudyn bodies carry: hammer and anvil, the stiffness of the reaction, and statics."""

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
from exudyn.utilities import InertiaCuboid
from oracles import MARBLE_RADIUS as R
from scipy.integrate import solve_ivp

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.exudyn_bodies.model import coordinate_slices

HEAD = 0.01  # m, from the hammer's face to its centre
HERTZ = 4 / 3 * ep.STEEL.plane_strain_modulus * np.sqrt(R)


def anvil(mbs, marble, carrier, patches=("south", "north")):
    """The marble at rest on a floor, and under a plane that a body carries: marble and contacts, by patch."""
    ball = ep.CreatePartitionBody(mbs, marble, name="ball", referencePosition=[0, 0, R])
    contacts = {}
    for patch in patches:
        plane, body = (
            (ep.RigidPlane(), None) if patch == "south" else (ep.RigidPlane((0, 0, -HEAD), (0, 0, -1)), carrier)
        )
        contacts[patch] = ep.CreatePartitionContact(mbs, ball, plane, slavePatch=patch, masterBody=body, name=patch)
    return ball, contacts


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_hammer_strikes_a_ball_at_rest_on_an_anvil(mbs, marble, method):
    """Two Hertz springs in series. The ball is at rest until the hammer's plane comes: its coordinates tell nothing."""
    speed, m, end = 0.3, marble.total_mass, 120e-6
    node = mbs.AddNode(
        items.NodeRigidBodyRotVecLG(
            referenceCoordinates=[0, 0, 2 * R + HEAD, 0, 0, 0], initialVelocities=[0, 0, -speed, 0, 0, 0]
        )
    )
    hammer = mbs.AddObject(items.ObjectRigidBody(nodeNumber=node, mass=m, inertia=[1e-5] * 3 + [0] * 3))
    ball, contacts = anvil(mbs, marble, hammer)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=end, step=0.5e-6, method=method)

    def rates(t, y):
        force = HERTZ * np.maximum([y[0] - y[1], y[1]], 0.0) ** 1.5
        return [y[2], y[3], -force[0] / m, (force[0] - force[1]) / m]

    hertz = solve_ivp(rates, (0, end), [0, 0, speed, 0], rtol=1e-9, atol=1e-15)
    after = -hertz.y[2:, -1]
    velocity = mbs.GetObjectOutputBody(hammer, exu.OutputVariableType.Velocity, localPosition=[0, 0, 0])[2]
    assert velocity == pytest.approx(after[0], abs=0.02 * speed)
    assert ball.momentum(result)[-1, 2] / m == pytest.approx(after[1], abs=0.02 * speed)
    peaks = HERTZ * np.maximum([hertz.y[1], hertz.y[0] - hertz.y[1]], 0.0).max(axis=1) ** 1.5
    found = [contacts[patch].force(result).max() for patch in ("south", "north")]
    np.testing.assert_allclose(found, peaks, rtol=0.07)  # some ten rows, and few points in time of the second bounce
    impulse = np.trapezoid(contacts["south"].force(result), result.t)
    assert m * velocity + ball.momentum(result)[-1, 2] == pytest.approx(impulse - m * speed, abs=1e-6 * m * speed)


def test_a_shaft_of_one_coordinate_carries_a_surface(mbs, marble):
    """A plane beside the axis pushes the ball. Exudyn gives a single coordinate as a number."""
    ball = ep.CreatePartitionBody(mbs, marble, name="ball", referencePosition=[0.1, 0, R + 1e-9])
    node = mbs.AddNode(items.Node1D(referenceCoordinates=[0.0], initialVelocities=[3.0]))
    turned = {"referencePosition": [0, 0, 0], "referenceRotation": [[1, 0, 0], [0, 0, -1], [0, 1, 0]]}  # about -y
    shaft = mbs.AddObject(items.ObjectRotationalMass1D(nodeNumber=node, inertia=1.0, **turned))
    plane = ep.RigidPlane((0, 0, 0), (0, 1, 0))
    contact = ep.CreatePartitionContact(mbs, ball, plane, slavePatch="south", masterBody=shaft)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=60e-6, step=0.5e-6, method="implicit")
    assert contact.impacts(result)
    assert ball.momentum(result)[-1, 2] / marble.total_mass == pytest.approx(0.6, rel=0.03)  # elastic: twice 0.3 m/s


def rigid_body(mbs, kind):
    """A body whose frame is HEAD above the marble's top: its object, and a ground."""
    body = mbs.CreateRigidBody(
        referencePosition=[0, 0, 2 * R + HEAD],
        inertia=InertiaCuboid(1000, [HEAD] * 3),
        nodeType=kind,
        returnDict=True,
    )
    return body["bodyNumber"], mbs.CreateGround()


def static_settings():
    settings = exu.SimulationSettings()
    settings.staticSolver.verboseMode, settings.solution.file.write = 0, False
    return settings


@pytest.mark.parametrize("formulation", ["compliance", "penalty"])
def test_the_stiffness_has_what_carries_the_surface(mbs, marble, formulation):
    """By finite differences, with both contacts of a marble closed, which push each other's patches."""
    carrier, _ = rigid_body(mbs, exu.NodeType.RotationRxyz)
    ball = ep.CreatePartitionBody(mbs, marble, referencePosition=[0, 0, R])
    for plane, patch, body in (
        (ep.RigidPlane((0, 0, -HEAD), (0, 0, -1)), "north", carrier),
        (ep.RigidPlane(), "south", None),
    ):
        ep.CreatePartitionContact(mbs, ball, plane, slavePatch=patch, masterBody=body, formulation=formulation)
    mbs.Assemble()
    solver = exu.MainSolverStatic()
    solver.InitializeSolver(mbs, static_settings())
    n = mbs.systemData.ODE2Size()
    own = np.r_[tuple(range(s.start, s.stop) for s in [*coordinate_slices(mbs, ball)])]
    others = np.setdiff1d(np.arange(n), own)  # of the carrier

    def force(q):
        mbs.systemData.SetODE2Coordinates(q)
        solver.ComputeODE2RHS(mbs)
        return np.array(solver.GetSystemResidual())[:n]

    q = np.zeros(n)
    q[own] = -1e-6 * marble.rigid[:, 2]
    q[others[:3]] = 1e-6, 0, -3e-6
    scale = np.where(np.isin(np.arange(n), own), 1e-11, 1e-10)
    by_differences = np.array([(force(q + h) - force(q - h)) / (2 * h.max()) for h in np.diag(scale)]).T
    pressing = abs(force(q)[others[2]])
    assert pressing > 10
    solver.ComputeJacobianODE2RHS(mbs, 1.0, 0.0, 0.0)
    tangent = np.array(solver.GetSystemJacobian())[:n, :n]
    # Pairs and normals are held: what is left is of the order of the force, over lengths that are not small.
    np.testing.assert_allclose(tangent, by_differences, atol=1e-7 * abs(by_differences).max(), rtol=1e-4)
    translation = np.ix_(others[:3], others[:3])
    np.testing.assert_allclose(tangent[translation], by_differences[translation], rtol=1e-4, atol=100 * pressing)
    assert tangent[others[2], others[2]] < -1e6
    assert abs(tangent[np.ix_(others[2:3], own)]).max() > 1e6


@pytest.mark.parametrize("kind", ["RotationRxyz", "RotationEulerParameters"])
@pytest.mark.parametrize("patches", [("north",), ("south", "north")])
def test_a_load_presses_a_plane_on_a_sphere(mbs, marble, kind, patches):
    """Statics by Exudyn's own solver: the whole load goes through the sphere, which yields as Hertz says."""
    load, weak = 50.0, 1e5
    carrier, ground = rigid_body(mbs, getattr(exu.NodeType, kind))
    ball, contacts = anvil(mbs, marble, carrier, patches)
    # What meets no force is held: on the floor the marble goes up and down by itself, else not.
    fixed = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    for coordinate in range(6):
        marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=ball["nModal"], coordinate=coordinate))
        if "south" in patches and abs(marble.rigid[coordinate, 2]) > 1e-3 * abs(marble.rigid[:6, 2]).max():
            spring = items.ObjectConnectorCoordinateSpringDamper(
                markerNumbers=[fixed, marker], stiffness=weak / marble.total_mass
            )
            mbs.AddObject(spring)
        else:
            mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=[fixed, marker]))
    top = [0, 0, 2 * R + HEAD]
    frame = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=top))
    marker = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=carrier))
    mbs.AddObject(items.ObjectJointGeneric(markerNumbers=[frame, marker], constrainedAxes=[1, 1, 0, 1, 1, 1]))
    spring = items.ObjectConnectorCartesianSpringDamper(markerNumbers=[frame, marker], stiffness=[0, 0, weak])
    mbs.AddObject(spring)
    mbs.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=[0, 0, -load]))
    mbs.Assemble()
    mbs.SolveStatic(static_settings())
    assert mbs.sys["staticSolver"].it.newtonStepsCount <= 12
    down = -mbs.GetObjectOutputBody(carrier, exu.OutputVariableType.Displacement, localPosition=[0, 0, 0])[2]
    force = mbs.GetSensorValues(contacts["north"]["sForce"])[0]
    assert force == pytest.approx(load - weak * down, rel=1e-8)
    assert down == pytest.approx(len(patches) * (force / HERTZ) ** (2 / 3), rel=0.06)


@pytest.mark.parametrize(("friction", "spin"), [(None, 0.0), (None, 500.0), (0.3, 500.0)])
def test_forces_on_nodes_are_known_after_the_run(mbs, round_body, friction, spin):
    """What carries the plane has moved and turned it; the sum of the forces is that of the sensors."""
    inertia = InertiaCuboid(7800, [0.02] * 3)
    rotates = {"nodeType": exu.NodeType.RotationRotationVector, "initialAngularVelocity": [spin, 0, 0]}
    carrier = mbs.CreateRigidBody(referencePosition=[0, 0, -HEAD], inertia=inertia, **rotates)
    ball = ep.CreatePartitionBody(mbs, round_body, name="ball", initialVelocity=[0, 0, -1.0])
    plane = ep.RigidPlane((0, 0, HEAD))
    contact = ep.CreatePartitionContact(mbs, ball, plane, masterBody=carrier, friction=friction)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=10e-6, step=0.1e-6)
    total = contact.nodal_forces(result)[0].sum(axis=1)
    assert abs(total).max() > 10.0
    np.testing.assert_allclose(total, contact.force_on_slave(result), atol=1e-12 * abs(total).max())


def test_a_point_near_the_contact_moves_as_on_a_plane_that_stands_still(bodies, ball):
    """Of a carrier that is much heavier than the ball: with the static answer to the forces on nodes."""
    found = []
    for mass in (None, 1e9):
        mbs = exu.SystemContainer().AddSystem()
        item, carrier = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -1.0]), None
        if mass:
            free = {"nodeType": exu.NodeType.RotationRotationVector}
            carrier = mbs.CreateRigidBody(inertia=InertiaCuboid(mass, [1.0] * 3), **free)
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), masterBody=carrier)
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=10e-6, step=0.1e-6)
        point = bodies[0].points[bodies[0].partition.patch_nodes[0]]
        found.append(item.displacement(result, point, fem=ball[0]))
    np.testing.assert_allclose(found[1], found[0], atol=1e-6 * abs(found[0]).max())


@pytest.mark.parametrize("kind", ["point", "point in a plane", "cable", "spring", "nobody"])
def test_what_has_no_axes_carries_no_surface(mbs, marble, kind):
    """Exudyn gives points axes that stand still, and said at Assemble alone that nothing can turn them."""
    ball = ep.CreatePartitionBody(mbs, marble, referencePosition=[0, 0, R])
    match kind:
        case "point":
            carrier = mbs.CreateMassPoint(mass=0.05)
        case "point in a plane":
            node = mbs.AddNode(items.NodePoint2D(referenceCoordinates=[0, 0]))
            carrier = mbs.AddObject(items.MassPoint2D(mass=0.05, nodeNumber=node))
        case "cable":
            ends = [mbs.AddNode(items.Point2DS1(referenceCoordinates=[x, 0, 1, 0])) for x in (0, 1)]
            carrier = mbs.AddObject(items.Cable2D(length=1, massPerLength=1, axialStiffness=1, nodeNumbers=ends))
        case "spring":
            points = [mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.CreateGround())) for _ in range(2)]
            carrier = mbs.AddObject(items.CartesianSpringDamper(markerNumbers=points))
        case _:
            carrier = 99
    before = mbs.systemData.NumberOfMarkers()
    with pytest.raises(InputError, match=r"masterBody: expected .*body"):
        ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), slavePatch="south", masterBody=carrier)
    assert mbs.systemData.NumberOfMarkers() == before
