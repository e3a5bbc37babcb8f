"""Joints, constraints and prescribed motion in explicit runs, by themselves and with contacts of every formulation."""

import exudyn as exu
import exudyn.itemInterface as items
import exudyn.utilities as utilities
import numpy as np
import pytest
from oracles import TOP, box, ctrl_c_after, relative, rigid_rows

import exudyn_partition as ep
from exudyn_partition.errors import InputError, RunError, StoppedRunWarning

G, LENGTH = 9.81, 1.0
BAR = utilities.InertiaCuboid(1000, [LENGTH, 0.1, 0.1])
ROTATION_VECTOR = exu.NodeType.RotationRotationVector
FORCE, JOINT_FORCE, POSITION, VELOCITY = (
    getattr(exu.OutputVariableType, name) for name in ("Force", "ForceLocal", "Position", "Velocity")
)


def bar(mbs, ground, nodeType=ROTATION_VECTOR, axis=(0, 0, 1), **options):
    """A bar that hangs on a revolute joint at the origin, and turns about z; returns body and joint."""
    body = mbs.CreateRigidBody(
        inertia=BAR, nodeType=nodeType, referencePosition=[LENGTH / 2, 0, 0], gravity=[0, -G, 0], **options
    )
    joint = mbs.CreateRevoluteJoint(itemNumbers=[ground, body], position=[0, 0, 0], axis=list(axis))
    return body, joint


def sensor(mbs, kind, number, variable):
    what = {"bodyNumber": number} if kind is items.SensorBody else {"objectNumber": number}
    what = {"nodeNumber": number} if kind is items.SensorNode else what
    return mbs.AddSensor(kind(**what, outputVariableType=variable, storeInternal=True))


def test_pendulum_against_the_energy_integral(mbs):
    """Released from the horizontal: speed and reaction by angle, of second order, without drift."""
    body, joint = bar(mbs, mbs.CreateGround())
    place, reaction = sensor(mbs, items.SensorBody, body, POSITION), sensor(mbs, items.SensorObject, joint, JOINT_FORCE)
    mbs.Assemble()
    m, d = BAR.mass, LENGTH / 2
    inertia = m * d**2 + BAR.inertiaTensor[2, 2]
    errors = []
    for step in (2e-3, 1e-3):
        result = ep.solve_dynamic(mbs, end_time=1.0, step=step)
        x = result.sensor(place)
        np.testing.assert_allclose(np.linalg.norm(x, axis=1), d, rtol=1e-9)
        sine, cosine = -x[:, 1] / d, x[:, 0] / d  # of the angle that it has fallen
        radial = m * G * sine * (1 + 2 * m * d**2 / inertia)
        tangential = m * G * cosine * (1 - m * d**2 / inertia)
        expected = np.hypot(radial, tangential)
        found = np.linalg.norm(result.sensor(reaction), axis=1)
        errors.append(relative(found[1:], (expected[1:] + expected[:-1]) / 2))  # reactions are means over steps
    assert errors[0] < 1e-3
    assert errors[1] < 0.3 * errors[0]


def test_two_bars_in_space_against_the_implicit_solver():
    """A chain that leaves its plane, of Euler parameters there and of rotation vectors here; energy is kept."""
    runs = {}
    for method, node_type, steps in (
        ("implicit", exu.NodeType.RotationEulerParameters, [1e-4]),
        ("explicit", ROTATION_VECTOR, [1e-3, 5e-4]),
    ):
        mbs = exu.SystemContainer().AddSystem()
        upper, joint = bar(mbs, mbs.CreateGround(), node_type)
        lower = mbs.CreateRigidBody(
            inertia=BAR, nodeType=node_type, referencePosition=[1.5 * LENGTH, 0, 0], gravity=[0, -G, 0]
        )
        mbs.CreateRevoluteJoint(
            itemNumbers=[upper, lower], position=[LENGTH, 0, 0], axis=[0, 1, 1], useGlobalFrame=True
        )
        place, reaction = (
            sensor(mbs, items.SensorBody, lower, POSITION),
            sensor(mbs, items.SensorObject, joint, JOINT_FORCE),
        )
        mbs.Assemble()
        for step in steps:
            result = ep.solve_dynamic(mbs, end_time=0.6, step=step, method=method)
            every = round(1e-3 / step)
            runs[method, step] = result.sensor(place)[::every], result.sensor(reaction)[::every]
    expected = runs["implicit", 1e-4]
    errors = [relative(runs["explicit", step][0], expected[0]) for step in (1e-3, 5e-4)]
    assert errors[0] < 1e-4
    # Verlet takes gyroscopic forces with the velocities of mid-step: first order, in bodies that turn in space.
    assert errors[1] < 0.6 * errors[0]
    assert relative(runs["explicit", 5e-4][1][1:], expected[1][1:]) < 5e-3


def test_prescribed_motion_and_redundant_constraints(mbs):
    """A mass follows a function of time; two equal constraints share its force, and a third is switched off."""
    node = mbs.AddNode(items.NodePoint())
    mbs.AddObject(items.MassPoint(mass=2.0, nodeNumber=node))
    ground = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=1))
    omega, amplitude = 20.0, 1e-2

    def offset(mbs, t, i, value):
        return amplitude * (1 - np.cos(omega * t))

    constraints = [
        mbs.AddObject(
            items.ObjectConnectorCoordinate(
                markerNumbers=[ground, marker], offsetUserFunction=function, activeConnector=active
            )
        )
        for function, active in ((offset, True), (offset, True), (0, False))
    ]
    forces = [sensor(mbs, items.SensorObject, c, FORCE) for c in constraints]
    place, velocity = (sensor(mbs, items.SensorNode, node, what) for what in (POSITION, VELOCITY))
    mbs.Assemble()
    step = 1e-4
    result = ep.solve_dynamic(mbs, end_time=0.3, step=step)
    np.testing.assert_allclose(result.sensor(place)[:, 1], offset(mbs, result.t, 0, 0), atol=1e-9 * amplitude)
    speed = amplitude * omega * np.sin(omega * result.t)
    np.testing.assert_allclose(result.sensor(velocity)[:, 1], speed, atol=1e-5 * amplitude * omega)
    needed = 2.0 * amplitude * omega**2 * np.cos(omega * (result.t[2:] - step / 2))
    for force in forces[:2]:
        np.testing.assert_allclose(abs(result.sensor(force)[2:, 0]), abs(needed) / 2, atol=1e-4 * needed.max())
    assert not result.sensor(forces[2]).any()


def test_the_model_is_as_before_and_its_functions_are_called(mbs):
    """PreStep may move the joint itself; PostStep sees velocities that obey the joints; Ctrl-C keeps what was found."""
    body, joint = bar(mbs, mbs.CreateGround())
    velocity = sensor(mbs, items.SensorBody, body, VELOCITY)
    calls, seen = [], []

    def before(mbs, t):
        calls.append(t)
        return True

    def after(mbs, t):
        seen.append(mbs.GetSensorValues(velocity))
        return True

    mbs.SetPreStepUserFunction(before)
    mbs.SetPostStepUserFunction(after)
    mbs.Assemble()
    warnings = exu.config.suppressWarnings
    result = ep.solve_dynamic(mbs, end_time=0.1, step=1e-3)
    assert len(calls) == result.steps == 100
    np.testing.assert_array_equal(np.array(seen[1:]), result.sensor(velocity)[1:])
    assert exu.config.suppressWarnings == warnings
    assert mbs.GetPreStepUserFunction()["function"] is before
    assert mbs.GetPostStepUserFunction()["function"] is after

    with pytest.warns(StoppedRunWarning, match="interrupted by the user"):
        stopped = ep.solve_dynamic(mbs, end_time=0.1, step=1e-3, progress=ctrl_c_after(0.4))
    assert 30 < len(stopped.t) < 70
    np.testing.assert_array_equal(stopped.sensor(velocity)[:30], result.sensor(velocity)[:30])
    mbs.SetPreStepUserFunction(lambda mbs, t: mbs.SetObjectParameter(joint, "activeConnector", t < 0.05) or True)
    fallen = ep.solve_dynamic(mbs, end_time=0.1, step=1e-3)
    acceleration = np.diff(fallen.sensor(velocity), axis=0)[60:] / 1e-3
    np.testing.assert_allclose(acceleration, np.tile([0, -G, 0], (len(acceleration), 1)), atol=1e-6)


def test_a_linear_joint_whose_offset_a_user_sets():
    """A mass follows the offset of its joint at the end of each step."""
    mbs = exu.SystemContainer().AddSystem()
    node = mbs.AddNode(items.Node1D(referenceCoordinates=[0.3]))
    mbs.AddObject(items.Mass1D(nodeNumber=node, mass=2.0))
    ends = mbs.AddNode(items.NodePointGround()), node
    markers = [mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=end, coordinate=0)) for end in ends]
    joint = mbs.AddObject(items.CoordinateConstraint(markerNumbers=markers, offset=0.0))
    place = mbs.AddSensor(
        items.SensorNode(nodeNumber=node, outputVariableType=exu.OutputVariableType.Coordinates, storeInternal=True)
    )

    def before(mbs, t):
        mbs.SetObjectParameter(joint, "offset", t**2)
        return True

    mbs.SetPreStepUserFunction(before)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=0.1, step=1e-3)
    np.testing.assert_allclose(result.sensor(place)[:, 0], result.t**2, atol=1e-14)


def test_a_constant_joint_carries_the_inertia_of_what_hangs_on_it(mbs):
    """Two masses on one spring, linked by a joint; a third one is held under a weight."""
    omega, amplitude, step = 20.0, 1e-3, 1e-4
    starts = amplitude, amplitude, 0.0
    ends = [mbs.AddNode(items.Node1D(referenceCoordinates=[0.0], initialCoordinates=[x])) for x in starts]
    for node, mass in zip(ends, (1.0, 3.0, 2.0), strict=True):
        mbs.AddObject(items.Mass1D(nodeNumber=node, mass=mass))
    ground, *own = (
        mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
        for node in (mbs.AddNode(items.NodePointGround()), *ends)
    )
    mbs.AddObject(items.CoordinateSpringDamper(markerNumbers=[ground, own[0]], stiffness=4.0 * omega**2))
    mbs.AddLoad(items.LoadCoordinate(markerNumber=own[2], load=5.0))
    link, hold = (
        sensor(mbs, items.SensorObject, mbs.AddObject(items.CoordinateConstraint(markerNumbers=pair)), FORCE)
        for pair in (own[:2], [ground, own[2]])
    )
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=0.3, step=step)
    inertia = 3.0 * amplitude * omega**2 * np.cos(omega * (result.t[2:] - step / 2))  # reactions are means over steps
    np.testing.assert_allclose(abs(result.sensor(link)[2:, 0]), abs(inertia), atol=1e-4 * inertia.max())
    np.testing.assert_allclose(abs(result.sensor(hold)[2:, 0]), 5.0, rtol=1e-9)


def test_what_explicit_steps_cannot_take_is_refused_by_name():
    def refused(match, build):
        mbs = exu.SystemContainer().AddSystem()
        build(mbs, mbs.CreateGround())
        mbs.Assemble()
        with pytest.raises(InputError, match=match):
            ep.solve_dynamic(mbs, end_time=1e-2, step=1e-3)

    refused(
        "rotates by Euler parameters.* nodeType=exu.NodeType.RotationRotationVector",
        lambda mbs, ground: bar(mbs, ground, exu.NodeType.RotationEulerParameters),
    )

    def rolling(mbs, ground):
        body = mbs.CreateRigidBody(inertia=BAR, nodeType=ROTATION_VECTOR, referencePosition=[0, 0, 0.5])
        mbs.CreateRollingDisc(
            bodyNumbers=[ground, body], discRadius=0.5, axisPosition=[0, 0, 0], axisVector=[1, 0, 0],
            planePosition=[0, 0, 0], planeNormal=[0, 0, 1],
        )  # fmt: skip

    refused("is of type JointRollingDisc", rolling)

    def speed(mbs, ground):
        node = mbs.AddNode(items.NodePoint())
        mbs.AddObject(items.MassPoint(mass=1.0, nodeNumber=node))
        markers = [
            mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=n, coordinate=0))
            for n in (mbs.AddNode(items.NodePointGround()), node)
        ]
        mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=markers, velocityLevel=True, name="speed"))

    refused("'speed' constrains velocities", speed)


def test_joints_that_do_not_fit_together_stop_the_run(mbs):
    """Two distances that no place has: named, not silently apart."""
    node = mbs.AddNode(items.NodePoint(referenceCoordinates=[0.4, 0, 0]))
    mass = mbs.AddObject(items.MassPoint(mass=1.0, nodeNumber=node))
    for x in (0.0, 1.0):
        mbs.CreateDistanceConstraint(
            itemNumbers=[mbs.CreateGround(referencePosition=[x, 0, 0]), mass], localPosition0=[0, 0, 0],
            localPosition1=[0, 0, 0], distance=0.4,
        )  # fmt: skip
    mbs.Assemble()
    with pytest.raises(RunError, match=r"leaves them open by .* Check that they fit together"):
        ep.solve_dynamic(mbs, end_time=1e-2, step=1e-3)


@pytest.fixture(scope="module", params=["craig-bampton", "contact-adapted"])
def pair(request, pair_of):
    """Ball and block, and the formulation of their contact."""
    return pair_of(request.param), "compliance" if request.param == "contact-adapted" else "lagrange"


def strike(pair, joint=None):
    """The ball about to hit the block at 1 m/s, with a joint between bodies by `joint(mbs, striker, target)`."""
    bodies, formulation = pair
    mbs = exu.SystemContainer().AddSystem()
    striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0])
    target = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target, formulation=formulation)
    extra = joint(mbs, striker, target) if joint else None
    mbs.Assemble()
    return mbs, striker, target, contact, extra


def constrain(mbs, item, rows, other=None):
    """Constraints of rows, (k, n_dofs), of a body's coordinates: to the coordinates of a node, or held in place."""
    markers = [
        mbs.AddMarker(
            items.MarkerNodeCoordinates(nodeNumber=mbs.AddNode(items.NodePointGround()) if other is None else other)
        ),
        mbs.AddMarker(items.MarkerObjectODE2Coordinates(objectNumber=item["oGenericODE2"])),
    ]
    own = np.zeros((0, 0)) if other is None else np.eye(3)
    joint = items.ObjectConnectorCoordinateVector(markerNumbers=markers, scalingMarker0=own, scalingMarker1=rows)
    return sensor(mbs, items.SensorObject, mbs.AddObject(joint), FORCE)


def test_an_idle_guide_changes_nothing(pair):
    """The ball slides along z as it would anyway: equal forces, constant momentum, and no drift off the guide."""

    def guide(mbs, striker, target):
        return constrain(mbs, striker, rigid_rows(striker.body)[[0, 1, 3, 4, 5]])

    runs = []
    for joint in (None, guide):
        mbs, striker, target, contact, reaction = strike(pair, joint)
        step = 0.5 * ep.stability_limit(mbs)
        result = ep.solve_dynamic(mbs, end_time=15e-6, step=step)
        assert result.status == "finished"
        momentum = striker.momentum(result) + target.momentum(result)
        np.testing.assert_allclose(momentum[:, 2], momentum[0, 2], rtol=1e-9)
        energy = striker.energy(result) + target.energy(result) + contact.energy(result)
        runs.append((contact.force(result), energy, striker.momentum(result)[:, 2]))
        assert result.work.active_set_iterations >= np.count_nonzero(runs[-1][0][1:])
    assert runs[0][0].max() > 300
    assert relative(runs[1][0], runs[0][0]) < 2e-3
    assert abs(runs[1][1] - runs[0][1]).max() < 1e-3 * runs[0][1][0]
    assert relative(runs[1][2], runs[0][2]) < 1e-3
    motion = striker.rigid_motion(striker.coordinates(result))
    assert abs(motion[:, [0, 1, 3, 4, 5]]).max() < 1e-12 * abs(motion[:, 2]).max()
    assert abs(result.sensor(reaction)).max() < 0.05 * runs[0][0].max()


def test_a_mass_on_a_joint_against_the_implicit_solver(pair):
    """A mass hangs below the block: contact force, reaction and its impulse; momentum of all three."""

    def hang(mbs, striker, target):
        body = target.body
        row = body.rows(np.array([body.nearest_node((0, 0, 0))]))
        node = mbs.AddNode(items.NodePoint())
        mbs.AddObject(items.MassPoint(mass=0.02, nodeNumber=node))
        reaction = constrain(mbs, target, row if isinstance(row, np.ndarray) else row.toarray(), node)
        return sensor(mbs, items.SensorNode, node, VELOCITY), reaction

    found = {}
    for method in ("explicit", "implicit"):
        mbs, striker, target, contact, (velocity, reaction) = strike(pair, hang)
        result = ep.solve_dynamic(mbs, end_time=20e-6, method=method, step=0.1e-6 if method == "implicit" else None)
        v, force = result.sensor(velocity), result.sensor(reaction)
        momentum = striker.momentum(result) + target.momentum(result) + 0.02 * v
        np.testing.assert_allclose(momentum - momentum[0], 0, atol=1e-9 * abs(momentum[0, 2]))
        np.testing.assert_allclose(target.velocity(result, (0, 0, 0)), v, atol=1e-9 * abs(v).max())
        if method == "explicit":  # multipliers act in the first half of a step, velocities are at its end
            assert force[1:, 2].sum() * result.step == pytest.approx(0.02 * v[-1, 2], rel=1e-9)
        common = np.linspace(0, 19.5e-6, 100)
        found[method] = [np.interp(common, result.t, x) for x in (contact.force(result), force[:, 2], v[:, 2])]
    for explicit, implicit in zip(found["explicit"], found["implicit"], strict=True):
        assert relative(explicit, implicit) < 0.02
    assert abs(found["explicit"][2][-1]) > 0.05


@pytest.mark.parametrize("pair", ["free", "craig-bampton", "contact-adapted"], indirect=True)
def test_a_joint_presses_on_a_contact(pair):
    """The block is pulled against a ball that is held: a joint pushes on contact rows and the contact back."""

    bodies, formulation = pair
    mbs = exu.SystemContainer().AddSystem()
    held = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP)
    thrown = ep.CreatePartitionBody(mbs, bodies[1], initialVelocity=[0, 0, 1.0])
    contact = ep.CreatePartitionContact(mbs, held, thrown, formulation=formulation)
    reaction = constrain(mbs, held, rigid_rows(held.body))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=15e-6)
    force, pull = contact.force(result), result.sensor(reaction)
    assert force.max() > 300
    impulse = thrown.momentum(result)[0, 2] - thrown.momentum(result)[-1, 2]
    # The ball's mean motion is held, so that the wall takes the impulse of the contact in every step.
    assert abs(pull[1:, 2].sum() * result.step) == pytest.approx(impulse, rel=1e-3)
    taken = -np.diff(thrown.momentum(result)[:, 2])
    np.testing.assert_allclose(pull[1:, 2] * result.step, taken, rtol=0, atol=1e-9 * taken.max())
    assert abs(held.momentum(result)).max() < 1e-9 * abs(thrown.momentum(result)).max()


def test_a_flexible_pendulum_in_a_floating_frame():
    """A bar of a contact-adapted basis swings about its centre on a revolute joint, as by the implicit solver."""
    fem = ep.fe_model(box(0.010, 0.008, 0.060), ep.STEEL, maxh=6e-3)
    body = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 5e-3), f_cut=60e3)
    runs = {}
    for method, step in (("explicit", None), ("implicit", 1e-6)):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(
            mbs, body, frame="floating", initialVelocity=[0, 20.0, 0], initialAngularVelocity=[-20.0 / 0.03, 0, 0]
        )
        ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround(), localPosition=[0, 0, 0]))
        centre = mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=item["nRigid"]))
        joint = mbs.AddObject(items.ObjectConnectorDistance(markerNumbers=[ground, centre], distance=0.03))
        reaction = sensor(mbs, items.SensorObject, joint, FORCE)
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=1e-3, step=step, method=method, sample_period=5e-6)
        place = item.rigid_motion(item.coordinates(result))[:, :3]
        runs[method] = np.interp(np.linspace(0, 0.99e-3, 50), result.t, place[:, 1]), result.sensor(reaction)
        energy = item.energy(result)
        assert abs(energy / energy[0] - 1).max() < 1e-3
    assert relative(runs["explicit"][0], runs["implicit"][0]) < 1e-3
