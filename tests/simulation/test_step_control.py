"""Step control: time to contact, adaptive runs against uniform ones, and the stability limit that steps keep to."""

import itertools
from types import SimpleNamespace

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import MARBLE_RADIUS, TOP, add_force, ctrl_c_after

import exudyn_partition as ep
from exudyn_partition.errors import InputError, ModelLimitWarning, StoppedRunWarning
from exudyn_partition.simulation import solve
from exudyn_partition.simulation.step_control import LONGEST, Closing, StepControl, first_root, impact_step

GRAVITY = 9.81


@pytest.fixture(scope="module")
def body(reduced_sphere):
    return reduced_sphere


def fall(body, height, gravity=GRAVITY, surface=None, velocity=(0, 0, 0), frame="inertial", **options):
    """Model, sphere and contact: the sphere falls on a rigid surface, by default the plane at its south pole."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, referencePosition=[0, 0, height], initialVelocity=velocity, frame=frame)
    contact = ep.CreatePartitionContact(mbs, item, surface or ep.RigidPlane(), **options)
    add_force(mbs, item, np.array([0, 0, -gravity * body.total_mass]))
    mbs.Assemble()
    return mbs, item, contact


def speeds(item, contact, result):
    """Velocities of the centre of mass just after each impact [m/s]."""
    v = item.momentum(result)[:, 2] / item.body.total_mass
    return np.array([v[np.searchsorted(result.t, impact.end) + 1] for impact in contact.impacts(result)])


def overshoots(contact, result):
    """Depth to which each first touch closes the gap [m]."""
    q = np.hstack([item.coordinates(result) for item, _ in contact.sides])
    touched = [first for first, _ in contact.closed_samples(result)]
    gaps = contact.mechanics.gaps.for_run()
    return np.array([-gaps.at(x).min() for x in q[touched]])


# Time to contact.


@settings(max_examples=200, deadline=None)
@given(gap=st.integers(0, 10**6), rate=st.integers(-(10**6), 10**6), acceleration=st.integers(-(10**6), 10**6))
def test_first_root(gap, rate, acceleration):
    gap, rate, acceleration = 1e-6 * gap, 1e-5 * rate, 1e-4 * acceleration
    t = first_root(*np.array([[gap], [rate], [acceleration]]))[0]
    a = min(acceleration, 0.0)
    if np.isinf(t):
        assert rate >= 0 == a
        return
    assert t >= 0
    scale = gap + abs(rate) * t + abs(a) * t**2
    assert gap + rate * t + a * t**2 / 2 == pytest.approx(0, abs=1e-9 * scale)
    early = t * np.linspace(0, 1, 9)[1:-1]
    assert (gap + rate * early + a * early**2 / 2 >= -1e-9 * scale).all()


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_time_to_contact_of_a_fall_is_exact(body, frame):
    height, speed = 1e-3, 0.3
    *_, contact = fall(body, height, frame=frame, rows="node-to-segment")
    up = body.rigid[:, 2] if frame == "inertial" else np.eye(body.n_dofs)[2]
    start = np.zeros(body.n_dofs)
    assert ep.time_to_contact(contact, start, -speed * up) == pytest.approx(height / speed, rel=1e-9)
    assert ep.time_to_contact(contact, start, speed * up) == np.inf
    assert ep.time_to_contact(contact, start, 0 * up) == np.inf
    for v in (-speed, 0.0, speed):
        exact = (v + np.sqrt(v**2 + 2 * GRAVITY * height)) / GRAVITY
        assert ep.time_to_contact(contact, start, v * up, -GRAVITY * up) == pytest.approx(exact, rel=1e-9)


def test_the_step_for_an_impact_is_that_of_its_speed(body):
    """A body that falls from rest, and one that is thrown from next to the surface with the speed of that fall."""
    height = 1e-3
    *_, contact = fall(body, height)
    up, start = body.rigid[:, 2], np.zeros(body.n_dofs)
    speed = np.sqrt(2 * GRAVITY * height)
    falls = impact_step(contact, start, 0 * up, -GRAVITY * up, lambda: 1e-8)
    thrown = impact_step(contact, -0.999 * height * up, -speed * up, 0 * up, lambda: 1e-8)
    assert falls == pytest.approx(thrown, rel=1e-2)
    slower = impact_step(contact, -0.999 * height * up, -0.1 * speed * up, 0 * up, lambda: 1e-8)
    assert slower > 1.1 * thrown
    assert impact_step(contact, start, speed * up, 0 * up, lambda: 1e-8) == np.inf


def test_two_equal_bodies_need_the_step_of_one_on_a_plane(marble):
    """By symmetry, if the one on the plane has half of their speed to each other."""
    steps, speed = [], 0.2
    for two in (True, False):
        mbs = exu.SystemContainer().AddSystem()
        upper = ep.CreatePartitionBody(mbs, marble, referencePosition=[0, 0, MARBLE_RADIUS])
        lower = ep.RigidPlane()
        if two:
            lower = ep.CreatePartitionBody(mbs, marble, referencePosition=[0, 0, -MARBLE_RADIUS])
        named = {"slavePatch": "south", "passes": "given"} | ({"masterPatch": "north"} if two else {})
        contact = ep.CreatePartitionContact(mbs, upper, lower, **named)
        q_t = np.concatenate([-speed * marble.rigid[:, 2], speed * marble.rigid[:, 2]][: 1 + two])
        steps.append(impact_step(contact, np.zeros_like(q_t), q_t, np.zeros_like(q_t), lambda: 1e-9))
    assert steps[0] == pytest.approx(steps[1], rel=0.1)


class Watched:
    """Motion of one marble, and how often somebody asked for it."""

    def __init__(self, mbs, body):
        self.item, self.asked = ep.CreatePartitionBody(mbs, body), 0
        self.q, self.q_t, self.q_tt = np.zeros((3, body.n_dofs))
        self.q_t[:] = 0.1 * body.rigid[:, 2]

    def __call__(self):
        self.asked += 1
        return self.q, self.q_t, self.q_tt

    def control(self, **options):
        return Steps(StepControl([], [self.item], self, None, step=1e-8, **options))


class Steps:
    """Steps that a control chooses, one after the other."""

    def __init__(self, control):
        self.control, self.pace = control, control.begin()

    def after(self, last):
        self.pace = self.control.after_step(self.pace, last)
        return self.pace.step


@pytest.mark.parametrize("tolerance", [None, 1e-3], ids=["explicit", "implicit"])
def test_vibration_that_forbids_growth_is_looked_at_in_few_steps(mbs, marble, tolerance):
    """And the step grows soon after it has faded."""
    motion = Watched(mbs, marble)
    motion.q_t[-1] = 1e-2  # the fastest mode, with more energy than all rigid motion
    step = 1 / (25 * marble.basis.omega[-1] / (2 * np.pi))
    control = StepControl([], [motion.item], motion, None, step=step, longest=1.0, velocity_tolerance=tolerance)
    control = Steps(control)
    last, steps = step, 400
    for _ in range(steps):
        last = control.after(last)
        assert last == step
    assert motion.asked < steps / 7
    motion.q_t[-1] = 0.0
    taken = [last := control.after(last) for _ in range(20)]
    assert np.count_nonzero(np.equal(taken, step)) <= 8
    assert taken[-1] > 10 * step


def test_steps_that_cannot_grow_need_no_look_at_the_motion(mbs, marble):
    motion = Watched(mbs, marble)
    control, last = motion.control(longest=1.05e-8), 1e-8
    for _ in range(50):
        last = control.after(last)
        assert last == 1e-8
    assert motion.asked <= 1


def test_long_steps_get_shorter_as_soon_as_a_fast_mode_vibrates(mbs, marble):
    """Implicit steps, which stability does not limit."""
    motion, last = Watched(mbs, marble), 1e-8
    control = motion.control(longest=1e-4, velocity_tolerance=1e-3)
    for _ in range(60):
        last = control.after(last)
    assert last > 0.9e-4
    motion.q_t[-1] = 1e-2
    assert control.after(last) == pytest.approx(1 / (25 * marble.basis.omega[-1] / (2 * np.pi)))


class Closed:
    """The run of a contact that is closed with a constant force."""

    is_open, forward, normal_force = False, None, 1.0
    evaluation = SimpleNamespace(stored=0.0)


def closed_control(motion):
    contact = SimpleNamespace(sides=[(motion.item, 0)])
    return StepControl(
        [contact], [motion.item], motion, lambda contact: Closed, step=1e-8, longest=1e-4, velocity_tolerance=1e-3
    )


def test_a_step_follows_from_the_pace_alone(mbs, marble):
    """Whatever steps the control has chosen meanwhile."""
    motion = Watched(mbs, marble)
    control, last = closed_control(motion), 1e-8
    pace = control.begin()
    motion.q_tt = 1e3 * marble.rigid[:, 2]
    for _ in range(30):
        motion.q_t = motion.q_t + last * motion.q_tt
        before, pace = pace, control.after_step(pace, last)
        again = control.after_step(before, last)
        assert (again.step, again.calm, again.closings) == (pace.step, pace.calm, pace.closings)
        last = pace.step
    assert last > 2e-8


def test_a_try_that_was_refused_does_not_judge_the_step_that_replaces_it(mbs, marble):
    """The refused try ended with accelerations that the shorter one does not reach."""
    motion = Watched(mbs, marble)
    control = closed_control(motion)
    pace = control.after_step(control.begin(), 1e-8)
    motion.q_t = motion.q_t + 0.01 * marble.rigid[:, 2]
    pace = control.after_step(pace, 1e-8)
    motion.q_tt = 1e6 * marble.rigid[:, 2]
    shorter, tried = control.shorter_step(pace, 1e-3)
    assert shorter is not None
    motion.q_tt = np.zeros_like(motion.q_tt)
    accepted, tried = control.shorter_step(tried, 1e-8)
    assert accepted is None
    assert control.after_step(tried, 1e-8).errors.rate == control.after_step(pace, 1e-8).errors.rate


def test_time_to_contact_with_a_surface_that_a_body_carries(body):
    """The carrier rises at 0.2 m/s and turns, so that the plane's far side sinks."""
    mbs = exu.SystemContainer().AddSystem()
    node = mbs.AddNode(
        items.NodeRigidBodyRotVecLG(
            referenceCoordinates=[-0.05, 0, 0, 0, 0, 0], initialVelocities=[0, 0, 0.2, 0, 1.0, 0]
        )
    )
    carrier = mbs.AddObject(items.ObjectRigidBody(nodeNumber=node, mass=1.0, inertia=[1, 1, 1, 0, 0, 0]))
    item = ep.CreatePartitionBody(mbs, body, referencePosition=[0, 0, 1e-3])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), masterBody=carrier)
    mbs.Assemble()
    at_rest = np.zeros(body.n_dofs)
    assert ep.time_to_contact(contact, at_rest, at_rest) == pytest.approx(1e-3 / (0.2 - 0.05 * 1.0), rel=0.02)


@pytest.mark.parametrize("height", [20e-6, 20e-3])
def test_time_to_contact_of_moving_pairs(body, bodies, height):
    """Two floating bodies: near and far, the time is that of the approach, or earlier: far apart patches are balls."""
    mbs = exu.SystemContainer().AddSystem()
    striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=np.add(TOP, [0, 0, height]), frame="floating")
    target = ep.CreatePartitionBody(mbs, bodies[1], frame="floating")
    contact = ep.CreatePartitionContact(mbs, striker, target, rows="node-to-segment")
    mbs.Assemble()
    q_t = np.zeros(contact.mechanics.gaps.n)
    contact.mechanics.gaps.sides.split(q_t)[contact.slave is not striker][2] = -0.5
    time = ep.time_to_contact(contact, np.zeros_like(q_t), q_t)
    assert (0.99 if height < 1e-3 else 0.5) * height / 0.5 < time < 1.001 * height / 0.5
    far_apart = height > 1e-3  # without rows, so that the step for their impact is not known yet
    assert (impact_step(contact, 0 * q_t, q_t, 0 * q_t, lambda: 1e-8) == np.inf) == far_apart


def test_a_body_that_spins_takes_25_steps_a_turn_at_least(mbs, marble):
    """Whatever else the longest step is."""
    item = ep.CreatePartitionBody(mbs, marble, frame="floating")
    q_t = np.zeros(marble.n_dofs)
    q_t[3:6] = [300.0, 0.0, -400.0]
    state = np.zeros(marble.n_dofs), q_t, np.zeros(marble.n_dofs)
    control = Steps(StepControl([], [item], lambda: state, None, step=1e-9, longest=1.0))
    assert control.after(1.0) == pytest.approx(2 * np.pi / 500.0 / 25)


@pytest.mark.parametrize("gap_tolerance", [None, 2e-9])
def test_predictions_are_few_until_a_contact_is_near(mbs, marble, gap_tolerance):
    """A ball flies at a plane: long steps, few predictions of when it touches, and it touches in a short step."""
    speed, height, step, longest = 0.1, 1e-3, 1e-7, 1e-5
    item, rows = ep.CreatePartitionBody(mbs, marble), np.zeros(1)
    at_rest = np.zeros(marble.n_dofs)
    state = at_rest, -speed * marble.rigid[:, 2], at_rest
    asked, t, taken = [], 0.0, [step]

    def closing(*motion):
        asked.append(t)
        return np.array([height - speed * t]), rows - speed, rows

    contact, run = SimpleNamespace(sides=[(item, 0)]), SimpleNamespace(is_open=True, closing=closing)
    control = Steps(StepControl(
        [contact], [item], lambda: state, lambda contact: run,
        step=step, longest=longest, gap_tolerance=gap_tolerance,
    ))  # fmt: skip
    while t < height / speed:
        taken.append(control.after(taken[-1]))
        t += taken[-1]
    assert taken[-1] <= step * (1 + 1e-9)
    assert t - height / speed <= (step if gap_tolerance is None else gap_tolerance / speed)
    assert len(taken) < height / speed / longest + 200
    assert len(asked) < 0.2 * len(taken)


# Adaptive runs.


def test_a_sphere_bounces_from_a_millimetre(body):
    """Three impacts in 0.1 s, which would be 500 000 steps."""
    height, end = 1e-3, 0.1
    mbs, item, contact = fall(body, height)
    result = ep.solve_dynamic(mbs, end_time=end, method="implicit", adaptive=True)
    assert result.status == "finished"
    assert result.t[-1] == pytest.approx(end)
    steps = np.diff(result.t)
    assert result.steps == len(steps) < 0.02 * end / result.step
    assert len(contact.impacts(result)) == 3
    assert 0.9 < steps.max() / (LONGEST * result.step) < 1 + 1e-9

    begins = [np.searchsorted(result.t, impact.start) for impact in contact.impacts(result)]
    for first in begins:
        np.testing.assert_allclose(steps[first : first + 10], result.step, rtol=1e-6)
    fall_time = np.sqrt(2 * height / GRAVITY)
    assert contact.impacts(result)[0].start == pytest.approx(fall_time, abs=2 * result.step)

    speed = GRAVITY * fall_time
    assert (overshoots(contact, result) < 1.01 * speed * result.step).all()
    weight = GRAVITY * body.total_mass
    energy = item.energy(result) + contact.energy(result) + weight * item.rigid_motion(item.coordinates(result))[:, 2]
    np.testing.assert_allclose(energy, energy[0], atol=2e-4 * weight * height)


def impacts_close_together(body, **options):
    """A sphere under a hundred times its weight bounces from 10 um three times; the result and what it came from."""
    mbs, item, contact = fall(body, 10e-6, gravity=1000.0)
    return item, contact, ep.solve_dynamic(mbs, end_time=1.1e-3, **options)


@pytest.fixture(scope="module")
def uniform(body):
    """The same in equal steps, a quarter of the default ones."""
    return impacts_close_together(body, method="implicit", step=0.05e-6, spectral_radius=1.0)


@pytest.mark.parametrize("method", ["implicit", "explicit"])
def test_adaptive_steps_agree_with_a_fine_uniform_run(body, uniform, method):
    item, contact, result = impacts_close_together(body, method=method, adaptive=True)
    expected, got = uniform[1].impacts(uniform[2]), contact.impacts(result)
    assert len(got) == len(expected) == 3
    np.testing.assert_allclose([i.impulse for i in got], [i.impulse for i in expected], rtol=1e-4)
    np.testing.assert_allclose([i.peak for i in got], [i.peak for i in expected], rtol=2e-3)
    np.testing.assert_allclose([i.start for i in got], [i.start for i in expected], atol=0.5e-6)
    np.testing.assert_allclose(speeds(item, contact, result), speeds(*uniform), rtol=5e-3)
    assert result.steps < (0.1 if method == "implicit" else 0.15) * uniform[2].steps
    history = result.history(contact)
    assert history.contact_duration == pytest.approx(uniform[2].history(uniform[1]).contact_duration, rel=0.01)
    assert ep.compare(history, uniform[2].history(uniform[1])).error["force"] < 0.03


def test_the_step_grows_again_after_separation(body):
    _, contact, result = impacts_close_together(body, method="implicit", adaptive=True)
    steps, t = np.diff(result.t), result.t[:-1]
    for impact, following in itertools.pairwise(contact.impacts(result)):
        flight = steps[(t > impact.end) & (t < following.start)]
        assert flight.max() > 50 * result.step
        assert flight.min() >= 0.999 * result.step
        assert (flight[1:] <= 1.2501 * flight[:-1]).all()


def test_no_first_touch_is_deeper_than_the_gap_tolerance(body):
    tolerance = 2e-9
    coarse, fine = (
        impacts_close_together(body, method="implicit", adaptive=True, gap_tolerance=limit)
        for limit in (None, tolerance)
    )
    assert overshoots(*coarse[1:]).max() > tolerance
    depths = overshoots(*fine[1:])
    assert len(depths) == 3
    assert (depths > 0).all()
    assert depths.max() < tolerance
    assert fine[2].steps < 1.1 * coarse[2].steps


def test_an_impact_that_nothing_foretold_is_taken_again_in_short_steps(body):
    """Flight away from the plane; at 200 um a force that no gap knows of throws the sphere back."""
    mbs, item, contact = fall(body, 1e-6, gravity=0.0, velocity=(0, 0, 0.01))
    up = body.mass @ body.rigid[:, 2]
    calls = []

    def throw(mbs, t, i, q, q_t):
        return -4e4 * up if 200e-6 < t < 220e-6 else 0 * up

    mbs.AddObject(
        items.ObjectGenericODE2(
            nodeNumbers=item.nodes, forceUserFunction=throw, visualization=items.VObjectGenericODE2(show=False)
        )
    )
    mbs.SetPreStepUserFunction(lambda mbs, t: calls.append(t) or True)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=400e-6, method="implicit", adaptive=True, gap_tolerance=100e-9)
    assert result.status == "finished"
    assert result.steps == len(result.t) - 1 < len(calls)
    assert (np.diff(calls) < 0).any()
    assert 0 < overshoots(contact, result)[0] < 100e-9
    before = item.momentum(result)[result.t < contact.impacts(result)[0].start][-1, 2]
    assert contact.impacts(result)[0].impulse > abs(before)


def test_vibration_keeps_steps_short(body):
    """A mode that holds a thousandth of the energy is resolved, one with a hundred-thousandth is not."""
    mode = 6
    frequency = body.basis.omega[mode] / (2 * np.pi)
    longest = []
    for share in (1e-3, 1e-5):
        mbs, item, _ = fall(body, 1e-3, gravity=0.0, velocity=(0, 0, 0.1))
        velocity = mbs.GetNodeParameter(item["nModal"], "initialCoordinates_t")
        velocity[mode] = np.sqrt(share * body.total_mass) * 0.1
        mbs.SetNodeParameter(item["nModal"], "initialCoordinates_t", velocity)
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=100e-6, method="implicit", adaptive=True)
        longest.append(np.diff(result.t).max())
    assert 0.9 < 25 * frequency * longest[0] < 1 + 1e-6
    assert longest[1] > 20 * longest[0]


def test_multipliers_and_two_bodies_in_adaptive_explicit_steps(pair_of):
    free = pair_of("craig-bampton")
    runs = []
    for adaptive in (False, True):
        mbs = exu.SystemContainer().AddSystem()
        striker = ep.CreatePartitionBody(
            mbs, free[0], referencePosition=np.add(TOP, [0, 0, 15e-6]), initialVelocity=[0, 0, -1.0]
        )
        contact = ep.CreatePartitionContact(mbs, striker, ep.CreatePartitionBody(mbs, free[1]), formulation="lagrange")
        mbs.Assemble()
        step = 0.3 * ep.stability_limit(mbs)
        result = ep.solve_dynamic(mbs, end_time=25e-6, step=step, adaptive=adaptive)
        runs.append((result, result.history(contact).impulse, striker.momentum(result)[:, 2]))
    assert runs[1][0].steps < 0.75 * runs[0][0].steps
    assert runs[1][1] == pytest.approx(runs[0][1], rel=5e-3)
    momentum = runs[1][2]
    assert momentum[-1] - momentum[0] == pytest.approx(runs[1][1], rel=1e-9)


def test_two_bodies_in_floating_frames_as_in_inertial_ones(bodies):
    """Moving pairs, flight in a few dozen steps: the impulse of an impact without rotation is the same."""
    impulses = []
    for frame in ("inertial", "floating"):
        mbs = exu.SystemContainer().AddSystem()
        striker = ep.CreatePartitionBody(
            mbs, bodies[0], referencePosition=np.add(TOP, [0, 0, 0.5e-3]), initialVelocity=[0, 0, -1.0], frame=frame
        )
        target = ep.CreatePartitionBody(mbs, bodies[1], frame=frame)
        contact = ep.CreatePartitionContact(mbs, striker, target, rows="node-to-segment")
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=0.56e-3, method="implicit", adaptive=True)
        flight = result.t < contact.impacts(result)[0].start
        assert np.count_nonzero(flight) < 60
        assert contact.impacts(result)[0].start == pytest.approx(0.5e-3, abs=2 * result.step)
        momentum = striker.momentum(result) + target.momentum(result)
        np.testing.assert_allclose(momentum - momentum[0], 0, atol=1e-9 * abs(momentum[0, 2]))
        impulses.append(result.history(contact).impulse)
    assert impulses[1] == pytest.approx(impulses[0], rel=2e-3)


def test_free_step_and_sample_period(body):
    mbs, *_ = fall(body, 1e-3)
    for options in ({"free_step": 0.2e-3}, {"free_step": 1e-3, "sample_period": 0.2e-3}):
        result = ep.solve_dynamic(mbs, end_time=10e-3, method="implicit", adaptive=True, **options)
        assert np.diff(result.t).max() < 0.2e-3 + options.get("sample_period", 1e-9)
    assert len(result.t) == pytest.approx(51, abs=2)  # the first ones after each period


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"free_step": 1e-6}, "free_step: .* only with adaptive=True"),
        ({"gap_tolerance": 1e-9}, "gap_tolerance: .* only with adaptive=True"),
        ({"adaptive": True, "free_step": 1e-8}, "free_step: expected at least the step in contact"),
        ({"adaptive": True, "gap_tolerance": 0.0}, "gap_tolerance: expected a finite number above zero in m"),
        ({"velocity_tolerance": 1e-4}, "velocity_tolerance: .* only with adaptive=True"),
        ({"adaptive": True, "velocity_tolerance": 0.0}, "velocity_tolerance: expected a finite number above zero"),
        ({"adaptive": True, "velocity_tolerance": 1e-2}, "velocity_tolerance: expected at most 0.001, got 0.01"),
        ({"adaptive": True, "velocity_tolerance": 1e-4, "method": "explicit"}, "velocity_tolerance: explicit steps"),
    ],
)
def test_options_that_make_no_sense(body, options, message):
    mbs, *_ = fall(body, 1e-3)
    with pytest.raises(InputError, match=message):
        ep.solve_dynamic(mbs, end_time=1e-3, **({"method": "implicit"} | options))


def test_user_functions_are_called_and_put_back(body):
    mbs, *_ = fall(body, 1e-3)
    after_step, after_newton = [], []
    mbs.SetPostStepUserFunction(lambda mbs, t: after_step.append(t) or t < 5e-3)
    mbs.SetPostNewtonUserFunction(lambda mbs, t: after_newton.append(t) or [0.0, -1.0])
    own = mbs.GetPostStepUserFunction()["function"], mbs.GetPostNewtonUserFunction()["function"]
    with pytest.warns(StoppedRunWarning, match="user function ended the run"):
        result = ep.solve_dynamic(mbs, end_time=10e-3, method="implicit", adaptive=True)
    np.testing.assert_allclose(after_step[1:], after_newton)
    assert result.t[-1] == pytest.approx(after_step[-1])
    assert (mbs.GetPostStepUserFunction()["function"], mbs.GetPostNewtonUserFunction()["function"]) == own


def test_ctrl_c_keeps_what_an_adaptive_run_computed(body):
    mbs, *_ = fall(body, 1e-3)

    with pytest.warns(StoppedRunWarning, match="interrupted by the user; results are kept up to"):
        result = ep.solve_dynamic(mbs, end_time=10e-3, method="implicit", adaptive=True, progress=ctrl_c_after(0.5))
    assert 4.9e-3 < result.t[-1] < 6.1e-3
    assert mbs.GetPostStepUserFunction() == mbs.GetPostNewtonUserFunction() == 0


def test_a_run_shows_a_bar_unless_it_is_told_whom_to_report_to(body, monkeypatch):
    shown, own = [], solve.progress_bar
    monkeypatch.setattr(solve, "progress_bar", lambda *a, **k: shown.append((a, k)) or own(*a, **k))
    mbs, *_ = fall(body, 1e-3)
    ep.solve_dynamic(mbs, end_time=1e-6, progress=lambda share: None)
    assert not shown
    ep.solve_dynamic(mbs, end_time=1e-6)
    assert shown == [(("stepping",), {"after": 2.0})]


def test_vibration_that_need_not_be_resolved(body):
    """After the impact the sphere rings with a small share of its energy."""
    steps = []
    for unresolved in (1e-9, 1e-2):
        mbs, item, contact = fall(body, 2e-6, velocity=(0, 0, -0.3))
        result = ep.solve_dynamic(
            mbs, end_time=0.4e-3, step=0.5e-6, method="implicit", adaptive=True, unresolved=unresolved
        )
        assert len(contact.impacts(result)) == 1
        steps.append(result.steps)
        assert speeds(item, contact, result)[0] == pytest.approx(0.3, rel=0.02)
    assert steps[1] < 0.5 * steps[0]
    with pytest.raises(InputError, match="unresolved: equal steps have none"):
        ep.solve_dynamic(mbs, end_time=1e-6, unresolved=1e-2)


def test_implicit_steps_that_do_not_resolve_an_impact_warn(body):
    """The ball leaves with another energy than it came with; with the default step with the same."""
    mbs, item, _ = fall(body, 4e-6, gravity=0.0, velocity=(0, 0, -0.2))
    with pytest.warns(ModelLimitWarning, match=r"is over within \d steps of 0.0001 s"):
        result = ep.solve_dynamic(mbs, end_time=0.4e-3, step=100e-6, method="implicit")
    assert abs(item.energy(result)[-1] / item.energy(result)[0] - 1) > 0.02
    result = ep.solve_dynamic(mbs, end_time=0.4e-3, method="implicit")  # a warning would fail the test
    assert item.energy(result)[-1] == pytest.approx(item.energy(result)[0], rel=2e-3)


@pytest.mark.parametrize(
    ("forces", "lasts"),
    [
        ([2, 10, 7, 4, 1], False),  # an impact that ends
        ([2, 10, 4, 6, 4], True),  # it was about to end, but the force rose again
        ([2, 10, 4, 4.9, 4], False),
        ([2, 4, 1, 10, 4], False),  # of two bumps, only the later one counts
        ([10, 4, 4, 4, 4, 4, 4, 4, 4, 4], True),  # as long as no impact
    ],
)
def test_a_contact_lasts_if_its_force_rises_again_or_it_is_closed_for_long(forces, lasts):
    closing = Closing(0.0, 0.0, 0.0, np.inf)
    for force in forces:
        closing = closing.after(1.0, force)
    assert closing.lasts == lasts


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_adaptive_steps_need_no_contact(mbs, arm_body, method):
    """An arm falls about its pin. With implicit steps the run stopped in its first growing steps."""
    link = ep.CreatePartitionBody(mbs, arm_body, frame="floating", gravity=[0, -9.81, 0], damping=0.02)
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    markers = [ground, link.CreateInterfaceMarker(mbs, "foot")]
    mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=[1, 1, 1, 0, 1, 1]))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=2e-3, method=method, adaptive=True)
    assert result.status == "finished"
