"""Runs in two parts are the run of one call, whatever contacts, joints and solvers remember."""

import exudyn as exu
import exudyn.itemInterface as items
import exudyn.utilities as utilities
import netgen.occ as occ
import numpy as np
import pytest
from oracles import MARBLE_RADIUS as R
from oracles import add_springs

import exudyn_partition as ep
from exudyn_partition.contact.plasticity.yielding_zone import YieldingZone
from exudyn_partition.errors import InputError, RunError, StoppedRunWarning

ROUND_OFF = 1e-9  # m/s
INITIAL = exu.ConfigurationType.Initial


def model():
    return exu.SystemContainer().AddSystem()


def slides(body, *, frame="inertial", friction=0.3, formulation="compliance", damping=None):
    """A ball that hits a plane at an angle."""
    mbs = model()
    options = {"initialVelocity": [0.5, 0, -1.0], "referencePosition": [0, 0, 1e-6], "damping": damping}
    item = ep.CreatePartitionBody(mbs, body, frame=frame, **options)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=friction, formulation=formulation)
    mbs.Assemble()
    return mbs, [item], [contact]


def hits(pair, *, frame="inertial", formulation="compliance", **options):
    """A ball that hits a block or a plate."""
    mbs, (ball, base) = model(), pair
    striker = ep.CreatePartitionBody(
        mbs, ball, frame=frame, initialVelocity=[0.3, 0, -1.0], referencePosition=[0, 0, base.points[:, 2].max() + 1e-6]
    )
    target = ep.CreatePartitionBody(mbs, base, frame=frame)
    contact = ep.CreatePartitionContact(mbs, striker, target, formulation=formulation, **options)
    mbs.Assemble()
    return mbs, [striker, target], [contact]


def row(marble):
    """Three balls in a row, whose patches move each other."""
    mbs, balls = model(), []
    for i in range(3):
        position, velocity = [0, 0, (2 * R + 1e-7) * i], [0, 0, -0.5 * (i == 2)]
        balls.append(
            ep.CreatePartitionBody(mbs, marble, name=str(i), referencePosition=position, initialVelocity=velocity)
        )
    patches = {"slavePatch": "south", "masterPatch": "north"}
    contacts = [ep.CreatePartitionContact(mbs, balls[i + 1], balls[i], **patches) for i in range(2)]
    mbs.Assemble()
    return mbs, balls, contacts


def in_two(made, cut, end, go_on, **options):
    """The second part of a run that ends at `cut` and goes on to `end`."""
    mbs = made[0]
    ep.solve_dynamic(mbs, end_time=cut, **options)
    if go_on:
        return ep.solve_dynamic(mbs, end_time=end, go_on=True, **options)
    mbs.systemData.SetSystemState(mbs.systemData.GetSystemState(), INITIAL)
    return ep.solve_dynamic(mbs, end_time=end, start_time=cut, **options)


def assert_one_run(make, cut, end, velocity=ROUND_OFF, ways=(True, False), **options):
    """At all samples of the second part; forces by the momentum that they change."""
    mbs, bodies, contacts = make()
    whole = ep.solve_dynamic(mbs, end_time=end, **options)
    assert whole.status == "finished"
    for go_on in ways:
        made = make()
        result = in_two(made, cut, end, go_on, **options)
        later = slice(len(whole.t) - len(result.t), None)
        np.testing.assert_allclose(result.t, whole.t[later], rtol=1e-12)
        for body, other in zip(made[1], bodies, strict=True):
            mass = body.body.total_mass
            np.testing.assert_allclose(
                body.momentum(result) / mass, other.momentum(whole)[later] / mass, rtol=0, atol=velocity
            )
        for contact, other in zip(made[2], contacts, strict=True):
            force = other.force(whole)[later]
            assert force[0] > 1
            np.testing.assert_allclose(contact.force(result)[1:], force[1:], atol=1e3 * velocity * force.max())
            taken = other.dissipated_energy(whole)[later]
            np.testing.assert_allclose(contact.dissipated_energy(result), taken, rtol=1e3 * velocity, atol=1e-15)
    return mbs


COMPLIANT = [
    {"frame": "floating"}, {"frame": "floating", "friction": 1.5}, {"friction": ep.Coulomb(0.4, 0.2, decay=0.1)},
    {"formulation": "penalty", "frame": "floating"}, {"friction": None, "damping": 0.05},
]  # fmt: skip


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("options", COMPLIANT)
def test_friction_and_damping(round_body, options):
    """With friction, velocities were off by 1e-5 m/s."""
    assert_one_run(lambda: slides(round_body, **options), 20e-6, 32e-6, step=0.25e-6)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("options", COMPLIANT[2:])
def test_generalized_alpha_goes_on_with_what_its_filter_remembers(round_body, options):
    """Exudyn begins with other accelerations: 6e-8 m/s. Its Newton's method leaves 1e-8 of the residual."""
    step = {"step": 0.25e-6, "method": "implicit", "spectral_radius": 0.6}
    assert_one_run(lambda: slides(round_body, **options), 20e-6, 30e-6, 5e-9, **step)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("options", [{}, {"frame": "floating", "friction": 0.3}])
def test_pairs_of_two_bodies_that_slide(round_body, flat_body, options):
    assert_one_run(lambda: hits((round_body, flat_body), **options), 20e-6, 30e-6, step=0.25e-6)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("friction", [None, 0.3])
def test_plastic_patches(yielding, friction, monkeypatch):
    """With friction, velocities were off by 4e-3 m/s.

    Rounding may decide in which iteration a zone settles, and then runs differ by what a step leaves, 1e-6 m/s. The
    lengths of these steps are powers of 2, so that both runs have the same. Products in single precision sum the nodes
    of a zone in the order in which they became active, which is no part of the state; in double precision, that does
    not grow.
    """
    h, single = 2.0**-22, YieldingZone.in_precision
    monkeypatch.setattr(YieldingZone, "in_precision", lambda zone, kind: single(zone, float))
    assert_one_run(lambda: slides(yielding, friction=friction), 50 * h, 84 * h, step=h)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("friction", [None, 0.3])
def test_plastic_patches_go_on_with_another_method(yielding, friction):
    """Friction's memory was lost there: 4e-3 m/s, where both methods differ by 5e-5 m/s."""
    mbs, (ball,), _ = slides(yielding, friction=friction)
    options, ends = {"step": 0.2e-6}, []
    for methods in (["explicit", "explicit"], ["explicit", "implicit"], ["implicit", "explicit"]):
        ep.solve_dynamic(mbs, end_time=12e-6, method=methods[0], **options)
        result = ep.solve_dynamic(mbs, end_time=20e-6, method=methods[1], go_on=True, **options)
        ends.append(ball.momentum(result)[-1] / yielding.total_mass)
    np.testing.assert_allclose(ends[1:], [ends[0]] * 2, rtol=0, atol=1e-4)


@pytest.mark.filterwarnings("ignore")
def test_multipliers(pair_of):
    """Those of the step that begins at the cut are in the velocities there."""
    limit = ep.stability_limit(hits(pair_of("free"), formulation="lagrange")[0])
    step = 4e-6 / np.ceil(4e-6 / (0.5 * limit))
    assert_one_run(lambda: hits(pair_of("free"), formulation="lagrange"), 4e-6, 8e-6, step=step)


@pytest.mark.filterwarnings("ignore")
def test_contacts_that_move_each_other(marble):
    assert_one_run(lambda: row(marble), 14e-6, 20e-6, step=0.1e-6)


def test_joints_in_explicit_steps():
    """A pendulum: its reactions go on too."""
    reactions = []
    for cut in (None, 0.1):
        mbs = model()
        inertia = utilities.InertiaCuboid(1000, [1.0, 0.1, 0.1])
        body = mbs.CreateRigidBody(
            inertia=inertia,
            nodeType=exu.NodeType.RotationRotationVector,
            referencePosition=[0.5, 0, 0],
            gravity=[0, -9.81, 0],
        )
        joint = mbs.CreateRevoluteJoint(itemNumbers=[mbs.CreateGround(), body], position=[0, 0, 0], axis=[0, 0, 1])
        kind = exu.OutputVariableType.ForceLocal
        sensor = mbs.AddSensor(items.SensorObject(objectNumber=joint, outputVariableType=kind, storeInternal=True))
        mbs.Assemble()
        if cut is not None:
            ep.solve_dynamic(mbs, end_time=cut, step=1e-3)
        result = ep.solve_dynamic(mbs, end_time=0.2, step=1e-3, go_on=cut is not None)
        reactions.append(result.sensor(sensor)[-99:])
    np.testing.assert_allclose(reactions[1], reactions[0], rtol=1e-9, atol=1e-9 * abs(reactions[0]).max())


@pytest.mark.filterwarnings("ignore")
def test_the_model_stays_as_it_was_and_each_run_can_be_repeated(round_body):
    mbs, (ball,), (contact,) = slides(round_body, frame="floating")
    options = {"step": 0.25e-6}
    first = ep.solve_dynamic(mbs, end_time=20e-6, **options)
    before = contact.friction.slip_path(first)
    second = ep.solve_dynamic(mbs, end_time=30e-6, go_on=True, **options)
    assert (contact.friction.slip_path(first) == before).all()
    assert contact.friction.slip_path(second).sum() > before.sum()
    third = ep.solve_dynamic(mbs, end_time=30e-6, **options)  # from the model's own start, without a memory
    assert third.t[0] == 0.0
    moved = ball.coordinates(first)  # its last step is longer by a rounding
    np.testing.assert_allclose(ball.coordinates(third)[: len(first.t)], moved, atol=1e-9 * abs(moved).max())
    np.testing.assert_allclose(ball.coordinates_t(third)[-1], ball.coordinates_t(second)[-1], rtol=1e-9, atol=1e-9)
    ep.solve_dynamic(mbs, end_time=20e-6, **options)
    mbs.systemData.SetSystemState(mbs.systemData.GetSystemState(), INITIAL)
    again = [ep.solve_dynamic(mbs, end_time=30e-6, start_time=20e-6, **options) for _ in range(3)]
    for result in again[1:]:
        np.testing.assert_array_equal(ball.coordinates_t(result), ball.coordinates_t(again[0]))


@pytest.mark.filterwarnings("ignore")
def test_a_run_that_was_stopped_goes_on(round_body):
    """With its step, to the end that was asked for at first."""
    mbs, (ball,), _ = slides(round_body)
    whole = ep.solve_dynamic(mbs, end_time=30e-6)
    mbs.SetPreStepUserFunction(lambda mbs, t: t < 15e-6)
    with pytest.warns(StoppedRunWarning):
        stopped = ep.solve_dynamic(mbs, end_time=30e-6)
    mbs.SetPreStepUserFunction(0)
    rest = ep.solve_dynamic(mbs, end_time=30e-6, go_on=True)
    assert rest.t[0] == stopped.t[-1] < 16e-6
    assert rest.step == pytest.approx(whole.step, rel=1e-9)
    momentum = ball.momentum(whole)[-1]
    np.testing.assert_allclose(ball.momentum(rest)[-1], momentum, rtol=0, atol=1e-11 * abs(momentum).max())


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_adaptive_steps_go_on_with_their_length(mbs, round_body, method):
    """In free flight the second part begins with the long step that the first one had."""
    ball = ep.CreatePartitionBody(mbs, round_body, referencePosition=[0, 0, 1e-4], initialVelocity=[0, 0, -0.5])
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), friction=0.3)
    mbs.Assemble()
    options = {"adaptive": True, "method": method, "step": 0.25e-6}
    whole = ep.solve_dynamic(mbs, end_time=300e-6, **options)
    first = ep.solve_dynamic(mbs, end_time=100e-6, **options)
    rest = ep.solve_dynamic(mbs, end_time=300e-6, go_on=True, **options)
    assert np.diff(rest.t)[0] > 0.7 * np.diff(first.t)[-3:].max()
    assert contact.force(rest).max() == pytest.approx(contact.force(whole).max(), rel=2e-3)
    assert ball.momentum(rest)[-1, 2] == pytest.approx(ball.momentum(whole)[-1, 2], rel=1e-3)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_static_preload_goes_on(mbs, round_body, method):
    """What statics pressed stays at rest, from time zero on, and the model's own start is that before the press."""
    weight, spring = 50.0, 1e5
    ball = ep.CreatePartitionBody(mbs, round_body, gravity=[0, 0, -weight / round_body.total_mass])
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), friction=0.3)
    add_springs(mbs, ball, spring / round_body.total_mass)
    mbs.Assemble()
    ep.solve_static(mbs)
    result = ep.solve_dynamic(mbs, end_time=20e-6, step=0.25e-6, method=method, go_on=True)
    assert result.t[0] == 0.0
    sunk = ball.rigid_motion(ball.coordinates(result))[:, 2]
    assert sunk[0] < -5e-7
    np.testing.assert_allclose(contact.force(result), weight + spring * sunk[0], rtol=1e-5)
    assert not np.any(mbs.systemData.GetODE2Coordinates(INITIAL))


def test_what_cannot_go_on_is_refused(round_body):
    mbs, *_ = slides(round_body)
    with pytest.raises(InputError, match="go_on: the model has not been run yet"):
        ep.solve_dynamic(mbs, end_time=1e-6, go_on=True)
    ep.solve_dynamic(mbs, end_time=1e-6, step=0.25e-6)
    with pytest.raises(InputError, match="start_time: a run that goes on begins where the last one ended, at 1e-06 s"):
        ep.solve_dynamic(mbs, end_time=2e-6, start_time=0.0, go_on=True)
    with pytest.raises(InputError, match=r"end_time: expected more than .*1e-06 s, got 1e-06 s"):
        ep.solve_dynamic(mbs, end_time=1e-6, go_on=True)
    with pytest.raises(InputError, match="go_on: expected True or False"):
        ep.solve_dynamic(mbs, end_time=2e-6, go_on="yes")
    zero = {name: [0] for name in ("referenceCoordinates", "initialCoordinates", "initialCoordinates_t")}
    mbs.AddNode(items.NodeGenericODE2(numberOfODE2Coordinates=1, **zero))
    mbs.Assemble()
    with pytest.raises(InputError, match="go_on: the model has other coordinates than in its last run"):
        ep.solve_dynamic(mbs, end_time=2e-6, go_on=True)


@pytest.mark.filterwarnings("ignore")
def test_a_sensor_that_is_added_between_two_runs_changes_neither(round_body):
    """Exudyn would assemble the model within the run, which then began from the nodes' initial values."""
    mbs, _, _ = slides(round_body)
    whole = ep.solve_dynamic(mbs, end_time=8e-6, step=0.2e-6)
    mbs, [item], [contact] = slides(round_body)
    ep.solve_dynamic(mbs, end_time=4e-6, step=0.2e-6)
    contact.AddMomentSensor(mbs)
    for run in (ep.solve_static, lambda mbs: ep.solve_dynamic(mbs, end_time=8e-6, go_on=True)):
        with pytest.raises(RunError, match=r"an item was added or deleted since mbs.Assemble\(\); call it again"):
            run(mbs)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=8e-6, go_on=True)
    expected = whole.bodies[0].coordinates_t(whole)[-len(result.t) :]
    np.testing.assert_allclose(item.coordinates_t(result), expected, atol=ROUND_OFF)
    assert abs(contact.moment_on_slave(result)[-1]).max() > 0


def test_a_drive_that_has_moved_a_joint_goes_on():
    """At the start of the second part the drive is far from where it was at time zero, and moves."""
    fem = ep.fe_model(occ.Box((0, 0, 0), (0.05, 0.01, 0.01)), ep.STEEL, maxh=10e-3)
    end = ep.Partition.interface(fem, "end", np.flatnonzero(fem.points[:, 0] < 1e-9), kind="averaged")
    body, found = ep.reduce(fem, end, f_cut=10e3), []
    for times in ([4e-3], [2e-3, 4e-3]):
        mbs = model()
        item = ep.CreatePartitionBody(mbs, body, frame="floating")
        ground = mbs.CreateGround(referencePosition=[0, 5e-3, 5e-3])
        markers = [mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground)), item.CreateInterfaceMarker(mbs, "end")]
        drive = {"offsetUserFunction": lambda mbs, t, *unused: [1e3 * t**2, 0, 0, 0, 0, 0]}
        mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=[1] * 6, **drive))
        mbs.Assemble()
        for i, end_time in enumerate(times):
            result = ep.solve_dynamic(mbs, end_time=end_time, method="implicit", step=2e-5, go_on=i > 0)
        found.append(item.momentum(result)[-1, 0] / body.total_mass)
    assert found[0] == pytest.approx(8.0, rel=0.01)  # 2000 m/s2 for 4 ms
    assert found[1] == pytest.approx(found[0], rel=1e-6)


def failing(mbs, place, at):
    """Let a user function of the model fail after a time; return what mends it when it is cleared."""
    on = [True]

    def check(mbs, t, *unused):
        if on and t > at:
            raise (OSError("away") if place != "Ctrl-C" else KeyboardInterrupt)
        return True

    match place:
        case "load":
            mass = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.CreateMassPoint(mass=1.0)))
            force = {"loadVectorUserFunction": lambda mbs, t, load: [0.0 * check(mbs, t)] * 3}
            mbs.AddLoad(items.LoadForceVector(markerNumber=mass, **force))
        case "sensor":
            sense = {"sensorUserFunction": lambda *arguments: [float(check(*arguments))]}
            mbs.AddSensor(items.SensorUserFunction(storeInternal=True, **sense))
        case "PostStep":
            mbs.SetPostStepUserFunction(check)
        case _:
            mbs.SetPreStepUserFunction(check)
    mbs.Assemble()
    return on


STOPPED = [
    ("explicit", "PreStep", {"frame": "floating"}), ("explicit", "load", {"frame": "floating"}),
    ("explicit", "sensor", {"formulation": "penalty"}), ("implicit", "PostStep", {"frame": "floating"}),
    ("implicit", "Ctrl-C", {"friction": None}), ("implicit", "load", {"friction": 0.3}),
]  # fmt: skip


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("method", "place", "options"), STOPPED)
def test_a_run_that_an_error_stopped_goes_on_from_its_last_whole_step(round_body, method, place, options):
    """It went on from a part of a step: a step too late, or with friction's energy off by a per cent."""
    steps, cut = {"step": 0.25e-6, "method": method}, 10e-6
    mbs, (ball,), (contact,) = slides(round_body, **options)
    whole = ep.solve_dynamic(mbs, end_time=16e-6, **steps)
    mbs, (same,), (again,) = slides(round_body, **options)
    on = failing(mbs, place, cut + 0.1e-6)
    first = ep.solve_dynamic(mbs, end_time=16e-6, **steps)
    assert first.status == "unstable"
    on.clear()
    rest = ep.solve_dynamic(mbs, end_time=16e-6, go_on=True, **steps)
    assert rest.t[0] == first.t[-1] == pytest.approx(cut)
    later = slice(len(whole.t) - len(rest.t), None)
    close = {"rtol": 0, "atol": ROUND_OFF * ball.body.total_mass}
    np.testing.assert_allclose(same.momentum(rest), ball.momentum(whole)[later], **close)
    # A floating body grows by its velocities, which the steps before knew a little earlier than the first sample does.
    share = 1e-7 if options.get("frame") == "floating" else 1e-8
    for of in ("force", "energy", "dissipated_energy"):
        mine, one = getattr(again, of)(rest), getattr(contact, of)(whole)
        np.testing.assert_allclose(mine, one[later], rtol=0, atol=share * abs(one).max() + 1e-15)


@pytest.mark.filterwarnings("ignore")
def test_reactions_of_joints_go_on_after_an_error():
    """A pendulum, whose PostStep function fails: the reactions are those of one run."""
    reactions = []
    for cut in (None, 0.1):
        mbs = model()
        inertia, turns = utilities.InertiaCuboid(1000, [1.0, 0.1, 0.1]), exu.NodeType.RotationRotationVector
        body = mbs.CreateRigidBody(
            inertia=inertia, nodeType=turns, referencePosition=[0.5, 0, 0], gravity=[0, -9.81, 0]
        )
        joint = mbs.CreateRevoluteJoint(bodyNumbers=[mbs.CreateGround(), body], position=[0, 0, 0], axis=[0, 0, 1])
        kind = exu.OutputVariableType.ForceLocal
        sensor = mbs.AddSensor(items.SensorObject(objectNumber=joint, outputVariableType=kind, storeInternal=True))
        mbs.Assemble()
        if cut is not None:
            on = failing(mbs, "PostStep", cut + 0.5e-3)
            ep.solve_dynamic(mbs, end_time=0.2, step=1e-3)
            on.clear()
        result = ep.solve_dynamic(mbs, end_time=0.2, step=1e-3, go_on=cut is not None)
        reactions.append(result.sensor(sensor)[-99:])
    np.testing.assert_allclose(reactions[1], reactions[0], rtol=1e-9, atol=1e-9 * abs(reactions[0]).max())


@pytest.mark.filterwarnings("ignore")
def test_multipliers_that_cannot_be_taken_back_are_refused_by_name(pair_of):
    """Those of implicit steps are means of the whole step. Until they are found, the step has not begun."""
    end = {"method": "implicit", "step": 0.1e-6, "end_time": 2e-6}
    for place, refused in (("PostStep", True), ("PreStep", False)):
        mbs, *_ = hits(pair_of("free"), formulation="lagrange")
        on = failing(mbs, place, 1.55e-6)
        first = ep.solve_dynamic(mbs, **end)
        on.clear()
        if refused:
            with pytest.raises(InputError, match="go_on: an error stopped the last run within a step, whose mult"):
                ep.solve_dynamic(mbs, go_on=True, **end)
        else:
            assert ep.solve_dynamic(mbs, go_on=True, **end).t[0] == first.t[-1]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("go_on", [False, True])
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_run_that_was_refused_leaves_the_last_one_to_go_on_from(round_body, method, go_on):
    """A second run failed in its first step, and the third began where no run had ended."""
    options = {"step": 0.25e-6, "method": method}
    mbs, (ball,), (contact,) = slides(round_body)
    whole = ep.solve_dynamic(mbs, end_time=16e-6, **options)
    first = ep.solve_dynamic(mbs, end_time=10e-6, **options)
    mbs.SetPreStepUserFunction(lambda mbs, t: 1 / 0)
    with pytest.raises(RunError, match="ZeroDivisionError"):
        ep.solve_dynamic(mbs, end_time=16e-6, go_on=go_on, **options)
    mbs.SetPreStepUserFunction(0)
    rest = ep.solve_dynamic(mbs, end_time=16e-6, go_on=True, **options)
    assert rest.t[0] == first.t[-1]
    end = ball.momentum(whole)[-1]
    np.testing.assert_allclose(ball.momentum(rest)[-1], end, rtol=0, atol=1e-8 * abs(end).max())
    taken = contact.friction.work(whole)[-1]
    assert contact.friction.work(rest)[-1] == pytest.approx(taken, rel=1e-7)


@pytest.mark.filterwarnings("ignore")
def test_a_plain_run_that_an_error_stopped_is_no_run_to_go_on_from(round_body):
    mbs, *_ = slides(round_body)
    settings = exu.SimulationSettings()
    settings.solution.file.write, settings.timeIntegration.verboseMode = False, 0
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = 4e-6, 16
    on = failing(mbs, "PostStep", 2.1e-6)
    with pytest.raises(Exception, match="away"):
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)
    on.clear()
    with pytest.raises(InputError, match="go_on: an error stopped the last run within a step"):
        ep.solve_dynamic(mbs, end_time=8e-6, go_on=True)
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)
    assert ep.solve_dynamic(mbs, end_time=8e-6, step=0.25e-6, go_on=True).t[0] == pytest.approx(4e-6)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("methods", [("explicit", "implicit"), ("implicit", "explicit")])
def test_energies_and_slip_go_on_with_another_method(yielding, methods):
    """They began again at zero."""
    mbs, _, (contact,) = slides(yielding)
    first = ep.solve_dynamic(mbs, end_time=12e-6, step=0.2e-6, method=methods[0])
    rest = ep.solve_dynamic(mbs, end_time=13e-6, step=0.2e-6, method=methods[1], go_on=True)
    for of in (contact.friction.work, contact.plastic.work):
        assert of(first)[-1] > 0
        assert of(rest)[0] == pytest.approx(of(first)[-1], rel=1e-3)
        assert of(rest)[-1] > of(rest)[0]
    assert (contact.friction.slip_path(rest) >= 0.999 * contact.friction.slip_path(first)).all()


@pytest.mark.filterwarnings("ignore")
def test_energies_and_slip_go_on_from_statics(mbs, round_body):
    """A load along the plane makes the rim of the contact slip. Nothing slips after it, at rest."""
    ball = ep.CreatePartitionBody(mbs, round_body, gravity=[10 / round_body.total_mass, 0, -50 / round_body.total_mass])
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), friction=0.3)
    add_springs(mbs, ball, 1e4 / round_body.total_mass)
    mbs.Assemble()
    first = ep.solve_static(mbs)  # once, for it takes most of the time
    taken, path = contact.friction.work(first)[-1], contact.friction.slip_path(first)
    assert taken > 0
    for method, start in (("explicit", True), ("implicit", first)):
        rest = ep.solve_dynamic(mbs, end_time=1e-6, step=0.25e-6, method=method, go_on=start)
        np.testing.assert_allclose(contact.friction.work(rest), taken, rtol=1e-4)
        np.testing.assert_allclose(contact.friction.slip_path(rest), path, atol=1e-3 * path.max())


@pytest.mark.filterwarnings("ignore")
def test_a_run_begins_anew_after_go_on_as_it_did_before(mbs, round_body):
    """From a preload, and from the end of a run that was made the initial state: what they held was forgotten."""
    ball = ep.CreatePartitionBody(mbs, round_body, gravity=[10 / round_body.total_mass, 0, -50 / round_body.total_mass])
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), friction=0.3)
    add_springs(mbs, ball, 1e4 / round_body.total_mass)
    mbs.Assemble()
    ep.solve_static(mbs, update_initial=True)  # once, for it takes most of the time

    def four_runs(method, start, length=2e-6):
        found = []
        for go_on in (False, False, True, False):
            end = {"end_time": start + (2 if go_on else 1) * length, "go_on": go_on, "step": 0.25e-6, "method": method}
            result = ep.solve_dynamic(mbs, **end, **({} if go_on else {"start_time": start}))
            if not go_on:
                found.append([contact.friction.tangential_force(result), ball.coordinates_t(result)])
        return found, result

    for method in ("explicit", "implicit"):
        found, last = four_runs(method, 0.0)
        assert abs(found[0][0][:, 0]).min() > 1.0  # friction holds
        for one in found[1:]:
            np.testing.assert_array_equal(one[0], found[0][0])
            np.testing.assert_array_equal(one[1], found[0][1])
    mbs.systemData.SetSystemState(mbs.systemData.GetSystemState(), INITIAL)
    for method in ("implicit", "explicit"):
        found, _ = four_runs(method, last.t[-1])
        for one in found[1:]:
            np.testing.assert_array_equal(one[1], found[0][1])
