"""Compiled runs give what Exudyn's explicit solver gives, up to round-off, and say what they cannot hold."""

import bisect
import signal

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from exudyn.utilities import InertiaCuboid
from oracles import MARBLE_RADIUS as R
from oracles import each_way, press_ctrl_c

import exudyn_partition as ep
from exudyn_partition.compiled import loops
from exudyn_partition.errors import CompiledRunError, InputError, RunError, StoppedRunWarning
from exudyn_partition.simulation import compiled_limits

pytestmark = pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")
CLOSE = 1e-9  # of the largest value
END = 30e-6


@pytest.fixture(scope="module")
def marble():
    """A marble with a patch at either pole."""
    refine = [ep.Refine(p, 0.5e-3, 0.25e-3) for p in ((0, 0, -R), (0, 0, R))]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), ep.STEEL, maxh=3e-3, refine=refine, grading=0.6)
    patches = [ep.Partition.ball(fem, (0, 0, z), 0.6e-3, name=name) for z, name in ((-R, "south"), (R, "north"))]
    return ep.reduce(fem, patches[0] | patches[1], f_cut=200e3)


@pytest.fixture(scope="module")
def rough():
    """A smaller marble with patches that carry friction, each with dozens of rows in contact."""
    fem = ep.fe_model(
        occ.Sphere(occ.Pnt(0, 0, 0), R), ep.STEEL, maxh=4e-3, grading=0.6,
        refine=[ep.Refine(p, 0.4e-3, 0.12e-3) for p in ((0, 0, -R), (0, 0, R))],
    )  # fmt: skip
    ends = (-R, "south"), (R, "north")
    patches = [ep.Partition.ball(fem, (0, 0, z), 0.3e-3, name=name, axes="xyz") for z, name in ends]
    return ep.reduce(fem, patches[0] | patches[1], f_cut=300e3)


def fall(marble, *, along=0.0, friction=None, loaded=False, **options):
    """A marble that falls on a plane; `loaded`: also pushed by a load on a coordinate."""
    mbs = exu.SystemContainer().AddSystem()
    at = {"referencePosition": [0, 0, R + 1e-6], "initialVelocity": [along, 0, -1.0]}
    ball = ep.CreatePartitionBody(mbs, marble, name="ball", **(at | options))
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), slavePatch="south", name="floor", friction=friction)
    if loaded:
        marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=ball["nModal"], coordinate=2))
        mbs.AddLoad(items.LoadCoordinate(markerNumber=marker, load=50.0))
    mbs.Assemble()
    return mbs, [ball], [contact]


def in_a_row(marble, count=3, *, along=0.0, frictions=(None,) * 3, **options):
    """Marbles in a row, the last of which hits the others: contacts that move each other."""
    mbs, balls = exu.SystemContainer().AddSystem(), []
    for i in range(count):
        velocity = [along, 0, -0.5] if i == count - 1 else [0, 0, 0]
        place = {"referencePosition": [0, 0, (2 * R + 1e-7) * i], "initialVelocity": velocity}
        balls.append(ep.CreatePartitionBody(mbs, marble, name=str(i), **place, **options))
    patches = {"slavePatch": "south", "masterPatch": "north"}
    contacts = [
        ep.CreatePartitionContact(mbs, balls[i + 1], balls[i], name=f"contact {i}", friction=frictions[i], **patches)
        for i in range(count - 1)
    ]
    mbs.Assemble()
    return mbs, balls, contacts


def two_pairs(marble, *, along=0.0, frictions=(None, None)):
    """Two pairs of marbles that know nothing of each other."""
    mbs, balls, contacts = exu.SystemContainer().AddSystem(), [], []
    for i, speed in enumerate((0.5, 1.5)):
        for z, velocity in ((0.0, 0.0), (2 * R + 1e-7, -speed)):
            at = {"referencePosition": [4 * R * i, 0, z], "initialVelocity": [-along * velocity, 0, velocity]}
            balls.append(ep.CreatePartitionBody(mbs, marble, name=f"{i} {z:.0e}", **at))
        patches = {"slavePatch": "south", "masterPatch": "north"}
        rub = {"friction": frictions[i], "name": f"pair {i}"}
        contacts.append(ep.CreatePartitionContact(mbs, balls[-1], balls[-2], **rub, **patches))
    mbs.Assemble()
    return mbs, balls, contacts


SCENES = {
    "plane": lambda m: fall(m),
    "plane, damping, gravity": lambda m: fall(m, damping=0.03, gravity=[30.0, 0.0, -2e4]),
    "plane, Rayleigh damping": lambda m: fall(m, damping=ep.Rayleigh(alpha=2e4)),
    "plane, load": lambda m: fall(m, loaded=True),
    "two": lambda m: in_a_row(m, 2),
    "three": lambda m: in_a_row(m, 3, damping=0.02),
    "two pairs": two_pairs,
}


SWINGING = {"gravity": [6e4, 2e4, -2e4], "initialVelocity": [-0.15, 0.1, -1.0]}  # the ball turns round in contact
ROUGH = {
    "sliding": lambda m: fall(m, along=1.0, friction=0.2),
    "turning round": lambda m: fall(m, friction=0.3, damping=0.02, **SWINGING),
    "falling coefficient": lambda m: fall(m, along=0.3, friction=ep.Coulomb(0.5, 0.2, 0.1)),
    "falling at once": lambda m: fall(m, along=0.3, friction=ep.Coulomb(0.5, 0.2)),
    "spinning": lambda m: fall(m, along=0.1, friction=0.4, initialAngularVelocity=[100.0, 50.0, 900.0]),
    "two": lambda m: in_a_row(m, 2, along=0.05, frictions=[0.3]),
    "three": lambda m: in_a_row(m, 3, along=0.02, frictions=[0.3, 0.3], damping=0.02),
    "some without": lambda m: in_a_row(m, 4, along=0.02, frictions=[None, 0.2, None]),
    "two pairs": lambda m: two_pairs(m, along=0.02, frictions=[0.3, None]),
    "two rough pairs": lambda m: two_pairs(m, along=0.02, frictions=[0.3, 0.1]),
}


def assert_same(one, other, bodies, contacts, *, slides=False):
    """Two results of the same model say the same; while pairs slide, iterations are counted in another way."""
    assert (one.status, one.message, one.steps, one.step) == (other.status, other.message, other.steps, other.step)
    np.testing.assert_allclose(one.t, other.t, rtol=1e-14)
    assert one.sensors.keys() == other.sensors.keys()
    for number, right in one.sensors.items():
        finite = np.isfinite(right)
        np.testing.assert_array_equal(np.isfinite(other.sensors[number]), finite)
        scale = np.where(finite, abs(right), 0.0).max(axis=0)
        error = abs(np.where(finite, other.sensors[number], 0.0) - np.where(finite, right, 0.0))
        assert (error <= CLOSE * max(scale.max(), 1e-300)).all()
    for contact in contacts:
        for name in ("force", "energy", "area"):
            right = getattr(contact, name)(one)
            np.testing.assert_allclose(getattr(contact, name)(other), right, rtol=0, atol=CLOSE * abs(right).max())
        rows = contact.row_forces(one)
        assert abs(contact.row_forces(other) - rows).max() <= CLOSE * abs(rows).max()
        for impact, right in zip(contact.impacts(other), contact.impacts(one), strict=True):
            assert (impact.impulse, impact.peak) == pytest.approx((right.impulse, right.peak), rel=CLOSE)
            assert (impact.start, impact.end) == pytest.approx((right.start, right.end), rel=1e-6)
    for item in bodies:
        for name in ("energy", "momentum", "dissipated_energy"):
            right = getattr(item, name)(one)
            np.testing.assert_allclose(getattr(item, name)(other), right, rtol=0, atol=CLOSE * abs(right).max() + 1e-18)
    assert one.warnings == other.warnings
    if not slides and (len(contacts) == 1 or contacts[0].group is contacts[1].group):
        assert other.work.active_set_iterations == one.work.active_set_iterations


@pytest.mark.parametrize("scene", SCENES)
def test_equal_to_exudyn(marble, scene):
    mbs, bodies, contacts = SCENES[scene](marble)
    right = ep.solve_dynamic(mbs, end_time=END)
    assert all(contact.force(right).any() for contact in contacts)
    assert_same(right, ep.solve_dynamic(mbs, end_time=END, solver="compiled"), bodies, contacts)


@pytest.mark.parametrize("scene", ROUGH)
def test_friction_is_equal_to_exudyn(rough, scene):
    mbs, bodies, contacts = ROUGH[scene](rough)
    right = ep.solve_dynamic(mbs, end_time=END)
    found = ep.solve_dynamic(mbs, end_time=END, solver="compiled")
    assert any(contact.force(right).any() for contact in contacts)
    assert_same(right, found, bodies, contacts)
    for contact in contacts:
        if not contact.friction:
            continue
        for name in ("tangential_force", "row_forces", "slip_path", "work"):
            value = getattr(contact.friction, name)(right)
            error = abs(getattr(contact.friction, name)(found) - value).max()
            scale = abs(contact.energy(right)).max() if name == "work" else abs(value).max()
            assert error <= CLOSE * scale
        np.testing.assert_array_equal(contact.friction.states(found), contact.friction.states(right))


def test_rows_stick_slip_and_turn_round(rough):
    """The scenes above have all that friction can do; what it takes leaves the bodies."""
    mbs, [ball], [contact] = ROUGH["turning round"](rough)
    result = ep.solve_dynamic(mbs, end_time=END, solver="compiled")
    assert {0, 1, 2} == set(contact.friction.states(result).ravel())
    force = contact.friction.tangential_force(result)[:, 0]
    assert force.min() < -0.1 * force.max() < 0.0
    mbs, [ball], [contact] = ROUGH["sliding"](rough)
    result = ep.solve_dynamic(mbs, end_time=END, solver="compiled")
    work = contact.friction.work(result)
    energy = ball.energy(result) + contact.energy(result) + work
    assert work[-1] > 0.02 * energy[0]
    assert (np.diff(work) >= -1e-12 * work[-1]).all()
    np.testing.assert_allclose(energy, energy[0], rtol=2e-3)
    slid = abs(contact.friction.tangential_force(result)[:, 0]) / np.maximum(contact.force(result), 1e-300)
    assert slid.max() == pytest.approx(0.2, rel=0.01)
    assert slid.max() <= 0.2 * (1 + CLOSE)


def test_adaptive_steps_with_friction(rough):
    mbs, _, contacts = fall(rough, along=0.3, gravity=[1e4, 0, -4e4], damping=0.02, friction=0.2)
    options = {"end_time": 100e-6, "step": 0.2e-6, "adaptive": True}
    right, found = (ep.solve_dynamic(mbs, solver=name, **options) for name in ("exudyn", "compiled"))
    assert_adaptive_same(right, found, contacts)


@pytest.mark.parametrize("later", ["exudyn", "compiled"])
@pytest.mark.parametrize("first", ["exudyn", "compiled"])
def test_runs_with_friction_go_on(rough, first, later, tmp_path):
    """Rows go on with their forces, slip and what friction has taken; also from a file."""
    step = {"step": 0.1e-6}
    whole_model, model, read = (ROUGH["turning round"](rough) for _ in range(3))
    whole = ep.solve_dynamic(whole_model[0], end_time=END, **step)
    first_part = ep.solve_dynamic(model[0], end_time=12e-6, solver=first, **step)
    first_part.save(tmp_path / "cut.npz")
    results = [
        ep.solve_dynamic(mbs, end_time=END, solver=later, go_on=go_on, **step)
        for mbs, go_on in ((model[0], True), (read[0], ep.Result.load(tmp_path / "cut.npz", read[0])))
    ]
    right, [of_whole] = whole.at(whole.t[120:]), whole_model[2]
    for result, [contact] in zip(results, (model[2], read[2]), strict=True):
        for name in ("tangential_force", "work"):
            value = getattr(of_whole.friction, name)(right)
            found = getattr(contact.friction, name)(result)
            np.testing.assert_allclose(found, value, rtol=0, atol=CLOSE * abs(value).max())
        path = of_whole.friction.slip_path(whole)
        np.testing.assert_allclose(contact.friction.slip_path(result), path, rtol=0, atol=CLOSE * path.max())


@pytest.mark.parametrize("scene", ["turning round", "three"])
def test_friction_by_numpy_is_the_same(rough, scene):
    def forces():
        mbs, _, contacts = ROUGH[scene](rough)
        result = ep.solve_dynamic(mbs, end_time=6e-6, step=0.1e-6, solver="compiled")
        return np.array([contact.friction.tangential_force(result) for contact in contacts])

    compiled, plain = each_way(forces)
    assert compiled.any()
    np.testing.assert_allclose(plain, compiled, rtol=0, atol=CLOSE * abs(compiled).max())


def test_steps_in_which_compiled_loops_do_not_settle(rough, monkeypatch):
    """They are made by NumPy."""
    mbs, _, [contact] = ROUGH["turning round"](rough)
    options = {"end_time": 6e-6, "step": 0.1e-6, "solver": "compiled"}
    right = contact.friction.tangential_force(ep.solve_dynamic(mbs, **options))
    monkeypatch.setattr(loops, "FRICTION_LIMITS", (*loops.FRICTION_LIMITS[:3], 3, loops.FRICTION_LIMITS[4]))
    found = contact.friction.tangential_force(ep.solve_dynamic(mbs, **options))
    assert (found != right).any()
    np.testing.assert_allclose(found, right, rtol=0, atol=CLOSE * abs(right).max())


def test_rough_pairs_that_slide_end_the_run_and_exudyn_goes_on(rough):
    mbs, _, [contact] = in_a_row(rough, 2, along=1.5, frictions=[0.1])
    options = {"step": 0.1e-6}
    whole = ep.solve_dynamic(mbs, end_time=END, **options)
    with pytest.warns(StoppedRunWarning, match="pairs of contact .contact 0. begin to slide"):
        first = ep.solve_dynamic(mbs, end_time=END, solver="compiled", **options)
    assert contact.force(first).any()
    later = ep.solve_dynamic(mbs, end_time=END, go_on=True, **options)
    for value in (contact.friction.tangential_force, contact.friction.work):
        right = value(whole)
        found = np.concatenate([value(result) for result in (first, later.at(later.t[1:]))])
        np.testing.assert_allclose(found, right, rtol=0, atol=CLOSE * abs(right).max())


def test_rows_with_friction_are_not_too_many(rough, monkeypatch):
    monkeypatch.setattr(compiled_limits, "MOST_ROWS", 10)
    mbs, _, _ = fall(rough, friction=0.3)
    with pytest.raises(CompiledRunError, match=r"'floor' is solved together with .* rows of which some have friction"):
        ep.solve_dynamic(mbs, end_time=END, solver="compiled")


def test_rare_samples(marble):
    mbs, bodies, contacts = in_a_row(marble)
    options = {"end_time": END, "sample_period": 1.5e-6}
    right, found = ep.solve_dynamic(mbs, **options), ep.solve_dynamic(mbs, solver="compiled", **options)
    assert len(found.t) == 21
    assert_same(right, found, bodies, contacts)


def assert_adaptive_same(right, found, contacts):
    """Times, forces and coordinates of adaptive runs."""
    assert (right.status, right.steps) == (found.status, found.steps)
    assert len(set(np.diff(right.t).round(12))) > 5  # steps differ
    np.testing.assert_allclose(found.t, right.t, rtol=1e-9)
    for contact in contacts:
        force = contact.force(right)
        np.testing.assert_allclose(contact.force(found), force, rtol=0, atol=CLOSE * force.max())
    for number, values in right.sensors.items():
        if number not in {int(contact["sForce"]) for contact in contacts}:
            np.testing.assert_allclose(found.sensors[number], values, rtol=0, atol=CLOSE * abs(values).max())


def test_adaptive_steps(marble):
    """A marble that bounces twice under a large weight, with long steps between."""
    mbs, _, contacts = fall(marble, gravity=[0, 0, -4e4], damping=0.02)
    options = {"end_time": 150e-6, "step": 0.2e-6, "adaptive": True}
    right, found = (ep.solve_dynamic(mbs, solver=name, **options) for name in ("exudyn", "compiled"))
    assert len(contacts[0].impacts(right)) == 2
    assert_adaptive_same(right, found, contacts)


def test_adaptive_runs_go_on(marble):
    """With the step, and all that the control knew."""
    later, options = [], {"step": 0.2e-6, "adaptive": True}
    for name in ("exudyn", "compiled"):
        mbs, _, [contact] = fall(marble, gravity=[0, 0, -4e4], damping=0.02)
        ep.solve_dynamic(mbs, end_time=60e-6, solver=name, **options)
        result = ep.solve_dynamic(mbs, end_time=150e-6, solver=name, go_on=True, **options)
        later.append((result.t, contact.force(result)))
    np.testing.assert_allclose(later[1][0], later[0][0], rtol=1e-9)
    np.testing.assert_allclose(later[1][1], later[0][1], rtol=0, atol=CLOSE * later[0][1].max())


def test_adaptive_steps_of_several_contacts(marble):
    mbs, _, contacts = in_a_row(marble)
    options = {"end_time": 60e-6, "step": 0.2e-6, "adaptive": True}
    right, found = (ep.solve_dynamic(mbs, solver=name, **options) for name in ("exudyn", "compiled"))
    assert_adaptive_same(right, found, contacts)


def test_the_edge_of_a_patch(marble):
    """It is recorded at the same time and place."""
    mbs, _, [contact] = fall(marble, initialVelocity=[0, 0, -15.0])
    edges = [ep.solve_dynamic(mbs, end_time=10e-6, solver=name).kept(contact).edge for name in ("exudyn", "compiled")]
    assert edges[0] is not None
    assert edges[1][0] == edges[0][0]
    np.testing.assert_allclose(edges[1][1], edges[0][1], rtol=0, atol=1e-12)


def test_the_users_own_sensor(marble):
    mbs, [ball], _ = fall(marble)
    kind = exu.OutputVariableType.Coordinates_t
    number = mbs.AddSensor(items.SensorNode(nodeNumber=ball["nModal"], outputVariableType=kind, storeInternal=True))
    mbs.Assemble()
    results = [ep.solve_dynamic(mbs, end_time=END, solver=name) for name in ("exudyn", "compiled")]
    values, right = results[1].sensor(number), results[0].sensor(number)
    np.testing.assert_allclose(values, right, rtol=0, atol=CLOSE * abs(right).max())


@pytest.mark.parametrize("later", ["exudyn", "compiled"])
@pytest.mark.parametrize("first", ["exudyn", "compiled"])
@pytest.mark.parametrize("read", [False, True])
def test_runs_go_on(marble, first, later, read, tmp_path):
    """Two runs are as one of Exudyn, in any order, also from a file in a new model."""
    mbs, _, contacts = in_a_row(marble)
    step = {"step": 0.1e-6}
    whole = ep.solve_dynamic(mbs, end_time=END, **step)
    mbs, _, _ = in_a_row(marble)
    result = ep.solve_dynamic(mbs, end_time=12e-6, solver=first, **step)
    if read:
        result.save(tmp_path / "cut.npz")
        mbs, _, fresh = in_a_row(marble)
        result = ep.solve_dynamic(
            mbs, end_time=END, solver=later, go_on=ep.Result.load(tmp_path / "cut.npz", mbs), **step
        )
    else:
        fresh = [contact for contact in result.contacts]
        result = ep.solve_dynamic(mbs, end_time=END, solver=later, go_on=True, **step)
    assert len(result.t) == 181
    for contact, other in zip(fresh, contacts, strict=True):
        right = other.force(whole)[120:]
        np.testing.assert_allclose(contact.force(result), right, rtol=0, atol=CLOSE * abs(right).max())


def test_the_model_stands_at_the_end(marble):
    mbs, _, _ = fall(marble, gravity=[0, 0, -100.0])
    states = []
    for name in ("exudyn", "compiled"):
        ep.solve_dynamic(mbs, end_time=END, solver=name)
        data = mbs.systemData
        states.append([data.GetODE2Coordinates(), data.GetODE2Coordinates_t(), data.GetODE2Coordinates_tt()])
        assert data.GetTime() == pytest.approx(END, rel=1e-12)
    for found, right in zip(states[1], states[0], strict=True):
        np.testing.assert_allclose(found, right, rtol=0, atol=CLOSE * abs(right).max())


def test_the_solvers_by_numpy_are_the_same(marble):
    def forces():
        mbs, _, contacts = in_a_row(marble)
        result = ep.solve_dynamic(mbs, end_time=10e-6, solver="compiled")
        return np.array([contact.force(result) for contact in contacts])

    compiled, plain = each_way(forces)
    assert compiled.any()
    np.testing.assert_allclose(plain, compiled, rtol=0, atol=CLOSE * compiled.max())


@pytest.mark.parametrize("period", [None, 0.7e-6])
def test_pairs_that_slide_are_followed(marble, period):
    """Also where samples are rare, so that none is at the step in which pairs begin to slide."""
    mbs, bodies, contacts = in_a_row(marble, 2, along=1.0)
    options = {"end_time": END, "step": 0.1e-6, "sample_period": period}
    right = ep.solve_dynamic(mbs, **options)
    assert right.end.contacts.contacts[0].contact.gaps.frozen is None
    assert_same(right, ep.solve_dynamic(mbs, solver="compiled", **options), bodies, contacts, slides=True)


def test_pairs_that_slide_in_the_first_step(marble):
    """Of a run that goes on from the last step in which pairs were frozen."""
    mbs, _, contacts = in_a_row(marble, 2, along=1.0)
    options = {"step": 0.1e-6}
    whole = ep.solve_dynamic(mbs, end_time=END, **options)

    def slides(steps):
        end = ep.solve_dynamic(mbs, end_time=steps * options["step"], **options).end
        return end.contacts.contacts[0].contact.gaps.frozen is None

    steps = bisect.bisect_left(range(2, len(whole.t) - 1), True, key=slides) + 1  # after 2 more, pairs slide
    assert not slides(steps)
    later = ep.solve_dynamic(mbs, end_time=END, solver="compiled", go_on=True, **options)
    force, right = contacts[0].force(later), contacts[0].force(whole)
    assert right[-len(force) :].any()
    np.testing.assert_allclose(force, right[-len(force) :], rtol=0, atol=CLOSE * right.max())


def test_adaptive_pairs_that_slide_end_the_run_and_exudyn_goes_on(marble):
    mbs, _, contacts = in_a_row(marble, 2, along=1.0)
    options = {"adaptive": True, "end_time": END}
    whole = ep.solve_dynamic(mbs, **options)
    with pytest.warns(StoppedRunWarning, match="pairs of contact .contact 0. begin to slide"):
        first = ep.solve_dynamic(mbs, solver="compiled", **options)
    assert first.status == "interrupted"
    assert 1 < len(first.t) < len(whole.t)
    with pytest.raises(RunError, match="cannot make its first step: pairs of contact 'contact 0' begin to slide"):
        ep.solve_dynamic(mbs, solver="compiled", go_on=True, **options)
    later = ep.solve_dynamic(mbs, go_on=True, **options)
    force, right = contacts[0].force(later), contacts[0].force(whole)
    assert force.any()
    there = np.interp(later.t, whole.t, right)  # the last step may have another length
    np.testing.assert_allclose(force, there, rtol=0, atol=2e-3 * right.max())


def test_rough_pairs_that_slide_already(rough):
    mbs, _, _ = in_a_row(rough, 2, along=1.5, frictions=[0.1])
    ep.solve_dynamic(mbs, end_time=END, step=0.1e-6)
    with pytest.raises(
        CompiledRunError, match="pairs of contact 'contact 0', which has friction, slide where this run"
    ):
        ep.solve_dynamic(mbs, end_time=1.2 * END, solver="compiled", go_on=True, step=0.1e-6)


def test_pages_and_tables(marble, tmp_path):
    mbs, _, _ = fall(marble)
    result = ep.solve_dynamic(mbs, end_time=END, solver="compiled")
    page, scene = result.report(tmp_path / "run.html"), tmp_path / "moving.html"
    result.scene(scene)
    assert page.stat().st_size > 10_000
    assert scene.stat().st_size > 10_000
    result.save(tmp_path / "run.npz")
    read = ep.Result.load(tmp_path / "run.npz")
    np.testing.assert_array_equal(read.contacts[0].force(read), result.contacts[0].force(result))


def test_ctrl_c(marble):
    mbs, _, _ = fall(marble)

    def press(share):
        if share > 0.2:
            press_ctrl_c()

    before = signal.getsignal(signal.SIGINT)
    with pytest.warns(StoppedRunWarning, match="interrupted by the user"):
        result = ep.solve_dynamic(mbs, end_time=2e-3, step=0.1e-6, solver="compiled", progress=press)
    assert result.status == "interrupted"
    assert 0 < result.steps < 20_000
    assert signal.getsignal(signal.SIGINT) == before


def test_progress(marble):
    mbs, _, _ = fall(marble)
    shares = []
    ep.solve_dynamic(mbs, end_time=2e-3, step=0.1e-6, solver="compiled", progress=shares.append, sample_period=1e-3)
    assert len(shares) > 5
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_all_reasons_are_listed(marble):
    """In one error."""
    mbs = exu.SystemContainer().AddSystem()
    terms = {"frame": "floating", "inertiaTerms": ("gyroscopic",)}
    ball = ep.CreatePartitionBody(mbs, marble, name="ball", referencePosition=[0, 0, R], **terms)
    other = ep.CreatePartitionBody(mbs, marble, name="other", referencePosition=[4 * R, 0, R])
    ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), slavePatch="south", name="floor")
    layer = {"formulation": "penalty", "slavePatch": "south", "name": "layer"}
    ep.CreatePartitionContact(mbs, other, ep.RigidPlane(), **layer).AddMomentSensor(mbs)
    mbs.CreateRigidBody(inertia=InertiaCuboid(7800, [0.02] * 3), name="brick")
    mbs.SetPreStepUserFunction(lambda mbs, t: True)
    mbs.Assemble()
    with pytest.raises(CompiledRunError) as raised:
        ep.solve_dynamic(
            mbs, end_time=END, solver="compiled", method="implicit", adaptive=True, sample_period=1e-6,
            settings=exu.SimulationSettings(),
        )  # fmt: skip
    said = str(raised.value)
    for part in (
        "- option method='implicit'", "- option settings", "- option sample_period with adaptive=True",
        "- body 'ball' leaves out inertia forces by inertiaTerms", "- contact 'layer' has formulation Penalty",
        "- contact 'layer' has a sensor of its moment", "- object 'brick', a RigidBody", "- nodes with coordinates",
        "- a PreStep user function",
    ):  # fmt: skip
        assert part in said


def test_a_single_reason(marble):
    mbs, _, _ = fall(marble, damping=ep.Rayleigh(0.0, 2e-7))
    with pytest.raises(CompiledRunError, match="'floor' has a viscous flexibility"):
        ep.solve_dynamic(mbs, end_time=END, solver="compiled")


def test_a_load_that_changes(marble):
    mbs, [ball], _ = fall(marble)
    marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=ball["nModal"], coordinate=0))
    mbs.AddLoad(items.LoadCoordinate(markerNumber=marker, loadUserFunction=lambda mbs, t, load: t, name="pulse"))
    mbs.Assemble()
    with pytest.raises(CompiledRunError, match="load 'pulse', a Coordinate, is not a constant one"):
        ep.solve_dynamic(mbs, end_time=END, solver="compiled")


def test_collect_has_nothing_of_it(marble):
    mbs, _, _ = fall(marble)
    ep.solve_dynamic(mbs, end_time=END)
    ep.solve_dynamic(mbs, end_time=END, solver="compiled")
    with pytest.raises(RunError, match="the last run was compiled"):
        ep.collect(mbs)
    ep.solve_dynamic(mbs, end_time=END)
    assert ep.collect(mbs).steps > 0


def test_an_unknown_solver(marble):
    with pytest.raises(InputError, match="solver: expected one of 'exudyn', 'compiled'"):
        ep.solve_dynamic(fall(marble)[0], end_time=END, solver="fast")
