"""Derivatives by the adjoint are those of differences between runs, and those of Hertz."""

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
import scipy.sparse as sp
from oracles import MARBLE_RADIUS as R
from oracles import SPHERE_RADIUS

import exudyn_partition as ep
from exudyn_partition.errors import CompiledRunError, InputError, RunError

pytestmark = pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")
STEP, END = 0.1e-6, 25e-6
WITHIN = 1e-6  # of the largest derivative of a kind
# Sizes of the parameters, for differences and to compare derivatives.
SIZES = {
    "initialVelocity": 0.5, "initialAngularVelocity": 100.0, "referencePosition": 1e-6, "gravity": 1e4,
    "damping": 0.02, "E": ep.STEEL.E, "rho": ep.STEEL.rho,
}  # fmt: skip
OF_CONTACT = {"peak_force": "peak", "impulse": "impulse", "duration": "duration"}


@pytest.fixture(scope="module")
def marble():
    """A marble with a patch at either pole."""
    refine = [ep.Refine(p, 0.5e-3, 0.25e-3) for p in ((0, 0, -R), (0, 0, R))]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), ep.STEEL, maxh=3e-3, refine=refine, grading=0.6)
    patches = [ep.Partition.ball(fem, (0, 0, z), 0.6e-3, name=name) for z, name in ((-R, "south"), (R, "north"))]
    return ep.reduce(fem, patches[0] | patches[1], f_cut=200e3)


def fall(marble, **options):
    """A marble that falls on a plane."""
    mbs = exu.SystemContainer().AddSystem()
    at = {"referencePosition": [1e-5, 0, R + 1e-6], "initialVelocity": [0, 0, -1.0]}
    ball = ep.CreatePartitionBody(mbs, marble, name="ball", **(at | options))
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), slavePatch="south", name="floor")
    mbs.Assemble()
    return mbs, [ball], [contact]


def in_a_row(marble, count=2, **options):
    """Marbles in a row, the last of which hits the others."""
    mbs, balls = exu.SystemContainer().AddSystem(), []
    for i in range(count):
        velocity = [0, 0, -0.5 if i == count - 1 else 0.0]
        place = {"referencePosition": [0, 0, (2 * R + 1e-7) * i], "initialVelocity": velocity}
        balls.append(ep.CreatePartitionBody(mbs, marble, name=str(i), **place, **options))
    patches = {"slavePatch": "south", "masterPatch": "north"}
    contacts = [
        ep.CreatePartitionContact(mbs, balls[i + 1], balls[i], name=f"contact {i}", **patches) for i in range(count - 1)
    ]
    mbs.Assemble()
    return mbs, balls, contacts


def value_of(item, name, moving):
    """Present value of a parameter; only the body `moving` has a velocity."""
    if name in ("E", "rho"):
        return np.array(SIZES[name])
    if name == "damping":
        return np.array(item.ratios or 0.0)
    given = {
        "initialVelocity": [0, 0, -(item == moving) * (1.0 if item.name == "ball" else 0.5)],
        "referencePosition": item.position,
        "gravity": [0, 0, -2e4],
    }
    return np.array(given.get(name, np.zeros(3)), dtype=float)


def differences(mbs, item, name, moving, read):
    """Central differences of what `read` finds in many runs, by the entries of a parameter."""
    value, change = value_of(item, name, moving), 1e-5 * SIZES[name]
    ways = change * np.concatenate([np.eye(max(value.size, 1)), -np.eye(max(value.size, 1))])
    values = (value + ways) if value.ndim else value + ways[:, 0]
    found = read(ep.run_many(mbs, end_time=END, step=STEP, vary={item: {name: values}}))
    return (found[: len(found) // 2] - found[len(found) // 2 :]) / (2 * change)


def assert_derivatives(found, mbs, bodies, read, scale):
    """All derivatives are those of differences; `scale` is the size of the number."""
    for item in bodies:
        for name, right in found.by[item].items():
            by_runs = differences(mbs, item, name, bodies[-1], read)
            error = abs(np.atleast_1d(right) - by_runs).max() * SIZES[name]
            assert error <= WITHIN * max(scale, abs(np.atleast_1d(right)).max() * SIZES[name]), (item.name, name)


SCENES = {
    "plane": lambda m: fall(m, gravity=[0, 0, -2e4], damping=0.03),
    "pair": lambda m: in_a_row(m, gravity=[0, 0, -2e4], damping=0.02),
    "row": lambda m: in_a_row(m, 3, gravity=[0, 0, -2e4], damping=0.02),
}


@pytest.mark.parametrize("of", OF_CONTACT)
@pytest.mark.parametrize("scene", SCENES)
def test_numbers_of_a_contact(marble, scene, of):
    mbs, bodies, contacts = SCENES[scene](marble)
    if (scene, of) == ("row", "duration"):
        with pytest.raises(InputError, match="'duration' is not known where contacts move each other"):
            ep.sensitivity(mbs, end_time=END, step=STEP, of=of, at=contacts[-1])
        return
    found = ep.sensitivity(mbs, end_time=END, step=STEP, of=of, at=contacts[-1])
    many = ep.run_many(mbs, end_time=END, step=STEP, vary={bodies[0]: {"damping": np.array([bodies[0].ratios])}})
    assert found.value == pytest.approx(getattr(many, OF_CONTACT[of])[0, -1], rel=1e-12)
    assert found.changes > 0
    assert {*SIZES} == {*found.by[bodies[0]]}
    assert_derivatives(found, mbs, bodies, lambda runs: getattr(runs, OF_CONTACT[of])[:, -1], found.value)


@pytest.mark.parametrize("scene", SCENES)
def test_numbers_of_a_body(marble, scene):
    mbs, bodies, _ = SCENES[scene](marble)
    item, place = bodies[0], 0
    energy = ep.sensitivity(mbs, end_time=END, step=STEP, of="energy", at=item)
    assert_derivatives(energy, mbs, bodies, lambda runs: runs.energy[:, 1, place], energy.value)
    direction = np.array([0.1, 0.0, 1.0])
    velocity = ep.sensitivity(mbs, end_time=END, step=STEP, of="velocity", at=item, direction=direction)
    by_velocities = {one: {n: v for n, v in of.items() if n != "rho"} for one, of in velocity.by.items()}

    def read(runs):
        return runs.momentum[:, 1, place] @ direction / item.body.total_mass

    for one in bodies:  # with rho momentum would change by the mass too
        for name, right in by_velocities[one].items():
            by_runs = differences(mbs, one, name, bodies[-1], read)
            assert abs(np.atleast_1d(right) - by_runs).max() * SIZES[name] <= WITHIN


def test_momentum_is_kept(marble):
    """Velocities of equal marbles add up to what they were, for every parameter."""
    mbs, bodies, _ = in_a_row(marble)
    found = [ep.sensitivity(mbs, end_time=END, step=STEP, of="velocity", at=item) for item in bodies]
    for item in bodies:
        total = {name: found[0].by[item][name] + found[1].by[item][name] for name in SIZES}
        np.testing.assert_allclose(total["initialVelocity"], [0, 0, 1], rtol=0, atol=1e-9)
        for name in ("referencePosition", "damping", "E"):
            assert abs(np.atleast_1d(total[name])).max() * SIZES[name] < 1e-9


def test_equal_bodies_exchange_their_velocities(marble):
    """The gradient of a velocity afterwards by both before is 1 and 0."""
    mbs, bodies, _ = in_a_row(marble)
    found = ep.sensitivity(mbs, end_time=60e-6, step=STEP, of="velocity", at=bodies[0])
    by_velocities = [found.by[item]["initialVelocity"][2] for item in bodies]
    np.testing.assert_allclose(by_velocities, [0, 1], rtol=0, atol=0.01)


def test_hertz():
    """Logarithmic slopes of force and duration over speed, mass and modulus."""
    bodies = []
    for side in (1, -1):
        ball = occ.Sphere(occ.Pnt(0, 0, side * SPHERE_RADIUS), SPHERE_RADIUS)
        fem = ep.fe_model(ball, ep.STEEL, maxh=5e-3, refine=[ep.Refine((0, 0, 0), radius=0.3e-3, h=0.1e-3)])
        part = ep.Partition.ball(fem, center=(0, 0, 0), radius=0.5e-3 if side == 1 else 0.7e-3)
        bodies.append(ep.reduce(fem, part, f_cut=150e3))
    mbs = exu.SystemContainer().AddSystem()
    upper = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -0.5])
    lower = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, upper, lower)
    mbs.Assemble()
    for of, slopes in (("peak_force", (6 / 5, 3 / 5, 2 / 5)), ("duration", (-1 / 5, 2 / 5, -2 / 5))):
        found = ep.sensitivity(mbs, end_time=90e-6, of=of, at=contact)
        by = [found.by[item] for item in (upper, lower)]
        values = (
            -0.5 * by[0]["initialVelocity"][2],
            ep.STEEL.rho * sum(one["rho"] for one in by),
            ep.STEEL.E * sum(one["E"] for one in by),
        )
        np.testing.assert_allclose(np.array(values) / found.value, slopes, rtol=0, atol=0.01 * max(map(abs, slopes)))


def test_bodies_that_touch_at_the_start(marble):
    """Their rows have neither forces nor gaps there, so that derivatives by places hold for one direction alone."""
    mbs, _, [contact] = fall(marble)
    apart = ep.sensitivity(mbs, end_time=END, step=STEP, of="impulse", at=contact)
    gap_of_rows = ep.solve_dynamic(mbs, end_time=STEP, step=STEP).sensor(contact["sForce"])[0, 5]
    mbs, _, [contact] = fall(marble, referencePosition=[1e-5, 0, R + 1e-6 - gap_of_rows])
    touching = ep.sensitivity(mbs, end_time=END, step=STEP, of="impulse", at=contact)
    assert (apart.edges, touching.edges) == (0, 1)


# Histories, modes, and values that differ from the model.


def assert_jacobian(found, runs_of, right):
    """Derivatives of k numbers, (k,) or (k, m), are central differences of `runs_of(values)`, which returns (B, k)."""
    change = 1e-5 * abs(right).max()
    ways = change * np.atleast_1d(np.eye(max(right.size, 1)))
    more, less = (runs_of(right + sign * (ways if right.ndim else ways[:, 0])) for sign in (1, -1))
    by_runs = ((more - less) / (2 * change)).T.reshape(found.shape)
    np.testing.assert_allclose(found, by_runs, rtol=0, atol=WITHIN * max(abs(by_runs).max(), abs(found).max()))


@pytest.fixture(scope="module")
def damped(marble):
    """Falling marble with a ratio for each mode, and other values than those of the model."""
    n = len(marble.basis.omega) - 6
    mbs, [ball], [contact] = fall(marble, damping=np.full(n, 0.02), gravity=[0, 0, -2e4])
    ratios = np.linspace(0.01, 0.05, n)
    return mbs, ball, contact, {"E": 150e9, "rho": 7000.0, "initialVelocity": np.array([0, 0, -1.3]), "damping": ratios}


@pytest.mark.parametrize("name", ["E", "rho", "initialVelocity", "damping"])
def test_velocity_of_a_point_at_times_and_other_values(damped, name):
    mbs, ball, _, values = damped
    point, direction, times = (0, 0, R), np.array([0.2, 0.1, 1.0]), np.array([0.0, 8.03e-6, 13e-6, 25e-6])
    options = {"end_time": END, "step": STEP, "times": times, "point": point, "direction": direction}
    found = ep.sensitivity(mbs, of="velocity", at=ball, values={ball: values}, **options)

    def at_times(varied):
        vary = {key: np.array([value] * len(np.atleast_1d(varied))) for key, value in values.items()} | {name: varied}
        runs = ep.run_many(mbs, end_time=END, step=STEP, vary={ball: vary}, histories=("coordinates",))
        history = runs.q_t @ (direction @ ball.velocity_rows(point))
        return np.array([np.interp(times, runs.t, of_run) for of_run in history])

    np.testing.assert_allclose(found.value, at_times(np.array([values[name]]))[0], rtol=1e-12, atol=1e-12)
    assert_jacobian(found.by[ball][name], at_times, np.array(values[name], dtype=float))


def test_a_strain_and_sums_over_times(damped, marble):
    """Sums of values at times have the sums of their derivatives, and a strain those of runs."""
    mbs, ball, _, values = damped
    n = len(marble.points)
    rows = sp.csr_matrix(
        ([1 / (2 * R), -1 / (2 * R)], ([0, 0], [3 * nearest(marble, z) + 2 for z in (R, -R)])), (1, 3 * n)
    )
    times, weights = np.linspace(2e-6, 24e-6, 12), np.random.default_rng(0).normal(size=(3, 12))
    options = {"end_time": END, "step": STEP, "of": "strain", "at": ball, "rows": rows, "times": times}
    each = ep.sensitivity(mbs, values={ball: values}, **options)
    sums = ep.sensitivity(mbs, values={ball: values}, weights=weights, **options)
    np.testing.assert_allclose(sums.value, weights @ each.value, rtol=1e-10, atol=1e-15)
    for name, of_sums in sums.by[ball].items():
        right = np.tensordot(weights, each.by[ball][name], axes=1)
        np.testing.assert_allclose(of_sums, right, rtol=0, atol=1e-9 * max(abs(right).max(), 1e-30))

    def strains(moduli):
        vary = {key: np.array([value] * len(moduli)) for key, value in values.items()} | {"E": moduli}
        runs = ep.run_many(mbs, end_time=END, step=STEP, vary={ball: vary}, histories=("coordinates",))
        history = runs.q @ marble.reduced_rows(rows)[0]
        return np.array([np.interp(times, runs.t, of_run) for of_run in history])

    assert_jacobian(each.by[ball]["E"], strains, np.array(values["E"]))


def nearest(marble, z):
    return marble.nearest_node(np.array([0, 0, z]))


def test_a_ratio_of_each_mode_adds_up_to_one_of_all(damped):
    mbs, ball, contact, _ = damped
    of_modes, of_all = (
        ep.sensitivity(mbs, end_time=END, step=STEP, of="impulse", at=contact, values={ball: {"damping": damping}})
        for damping in (np.full(len(ball.body.basis.omega) - 6, 0.03), 0.03)
    )
    assert of_modes.value == of_all.value
    assert of_modes.by[ball]["damping"].sum() == pytest.approx(of_all.by[ball]["damping"], rel=1e-12)


def test_pairs_that_slide_in_free_flight(marble):
    """The run goes on without contact, as one by Exudyn does; derivatives are differences of such runs."""
    mbs, balls, _ = in_a_row(marble)
    times, thrown = np.array([20e-6, 110e-6, 120e-6]), np.array([0.12, 0.0, -0.5])
    options = {"end_time": 120e-6, "step": STEP, "of": "velocity", "at": balls[0], "point": (0, 0, R), "times": times}

    def velocities(varied):
        values = ({balls[1]: {"initialVelocity": velocity}} for velocity in varied)
        return np.array([ep.sensitivity(mbs, values=one, **options).value for one in values])

    runs = ep.run_many(mbs, end_time=120e-6, step=STEP, vary={balls[1]: {"initialVelocity": thrown[None]}})
    assert times[0] < runs.ends[0] < times[1]
    found = ep.sensitivity(mbs, values={balls[1]: {"initialVelocity": thrown}}, **options)
    assert_jacobian(found.by[balls[1]]["initialVelocity"], velocities, thrown)
    mbs = exu.SystemContainer().AddSystem()
    places = (([0, 0, 0], [0, 0, 0]), ([0, 0, 2 * R + 1e-7], thrown))
    items = [ep.CreatePartitionBody(mbs, marble, referencePosition=x, initialVelocity=v) for x, v in places]
    ep.CreatePartitionContact(mbs, items[1], items[0], slavePatch="south", masterPatch="north")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=120e-6, step=STEP)
    right = np.interp(times, result.t, items[0].velocity(result, (0, 0, R))[:, 2])
    np.testing.assert_allclose(found.value, right, rtol=0, atol=1e-9)


def test_what_is_refused_of_histories(damped):
    mbs, ball, contact, _ = damped
    options = {"end_time": END, "step": STEP}
    for of, at, wrong, message in (
        ("energy", ball, {"times": [1e-6]}, "times: expected None for 'energy', got list"),
        ("impulse", contact, {"point": (0, 0, R)}, "point: expected None for 'impulse'"),
        ("strain", ball, {}, "rows: expected a sparse matrix with one row for 'strain', .* got NoneType"),
        ("velocity", ball, {"weights": [[1.0]]}, "weights: expected None without times"),
        ("velocity", ball, {"times": [1e-6], "weights": [1.0]}, "weights: expected"),
        ("velocity", ball, {"times": [2 * END]}, "times: expected times from 0 to the end"),
        ("velocity", ball, {"point": (0, 0, 9 * R)}, "point"),
        ("velocity", ball, {"values": {ball: 1.0}}, "values: expected a dict of body: dict of name: value"),
        ("velocity", ball, {"values": {ball: {"speed": 1.0}}}, "values: expected names among"),
        ("velocity", ball, {"values": {ball: {"damping": [0.1, 0.2]}}}, "values: damping: expected shape"),
    ):
        with pytest.raises(InputError, match=message):
            ep.sensitivity(mbs, of=of, at=at, **wrong, **options)


def test_what_is_refused(marble):
    mbs, [ball], [contact] = fall(marble)
    options = {"end_time": END, "step": STEP}
    with pytest.raises(InputError, match="of: expected one of 'peak_force', 'impulse'"):
        ep.sensitivity(mbs, of="force", at=contact, **options)
    with pytest.raises(InputError, match=r"at: for 'energy' expected what CreatePartitionBody\(\) returned"):
        ep.sensitivity(mbs, of="energy", at=contact, **options)
    with pytest.raises(InputError, match=r"at: for 'impulse' expected what CreatePartitionContact\(\) returned"):
        ep.sensitivity(mbs, of="impulse", at=ball, **options)
    with pytest.raises(InputError, match="contact 'floor' never closes in this run"):
        ep.sensitivity(mbs, of="impulse", at=contact, end_time=2e-7, step=STEP)
    following, _, [other] = in_a_row(marble, frame="floating")
    with pytest.raises(CompiledRunError, match="contact 'contact 0' has rows that follow facets of another body"):
        ep.sensitivity(following, of="impulse", at=other, **options)


def test_a_run_that_stops(marble):
    mbs = exu.SystemContainer().AddSystem()
    balls = [
        ep.CreatePartitionBody(mbs, marble, referencePosition=[0, 0, z], initialVelocity=[v, 0, -0.5 * bool(v)])
        for z, v in ((0.0, 0.0), (2 * R + 1e-7, 5.0))
    ]
    contact = ep.CreatePartitionContact(mbs, balls[1], balls[0], slavePatch="south", masterPatch="north")
    mbs.Assemble()
    with pytest.raises(RunError, match="begin to slide"):
        ep.sensitivity(mbs, end_time=END, step=STEP, of="impulse", at=contact)
