"""Contacts of a chain, which one element applies in `solve_dynamic`, against the contacts' own elements."""

import itertools

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
from oracles import MARBLE_RADIUS as R

import exudyn_partition as ep
from exudyn_partition.contact.frozen import FrozenContacts
from exudyn_partition.exudyn_contacts.contact_run import ContactRun, GroupRun
from exudyn_partition.support.compiled import compiles

STEP, END = 0.1e-6, 15e-6


def chain(marble, aside=(0.0, 0.0, 0.0), plate=None, frame="inertial"):
    """Marbles that meet, with speeds across the line of contact, on a rigid plane below if there is one."""
    mbs = exu.SystemContainer().AddSystem()
    balls = [
        ep.CreatePartitionBody(
            mbs,
            marble,
            frame=frame,
            referencePosition=[0, 0, 2 * R * i],
            initialVelocity=[v, 0, 0.6 * ((1 if plate is None else -1) - i)],
        )
        for i, v in enumerate(aside)
    ]
    between = {"slavePatch": "north", "masterPatch": "south"}
    contacts = [ep.CreatePartitionContact(mbs, *pair, **between) for pair in itertools.pairwise(balls)]
    if plate is not None:
        contacts.append(ep.CreatePartitionContact(mbs, balls[0], plate, slavePatch="south"))
    mbs.Assemble()
    return mbs, contacts


def by_own_elements(mbs, solver=exu.DynamicSolverType.VelocityVerlet, sample_period=STEP):
    """Run the model by Exudyn directly."""
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = END, round(END / STEP)
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.explicit.computeEndOfStepAccelerations = False
    settings.solution.sensors.writePeriod = sample_period
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    mbs.SolveDynamic(settings, solverType=solver)
    return ep.collect(mbs)


def all_told(mbs, contacts, result):
    """What the contacts tell of a run."""
    for contact in contacts:
        told = mbs.GetSensorStoredData(contact["sForce"]), contact.row_forces(result).toarray(), contact.energy(result)
        yield from (*told, contact.nodal_forces(result)[0])


@pytest.mark.usefixtures("each_path")
@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ContactPatchWarning")
@pytest.mark.parametrize(
    ("aside", "plate", "frame"),
    [
        ((0, 0, 0), None, "inertial"),
        ((0, 3, 0), None, "inertial"),
        ((0, 0, 0), ep.RigidPlane((0, 0, -R), (0, 0, 1)), "inertial"),
        ((0, 0, 0), None, "floating"),
    ],
    ids=["pressed", "begin to slide", "on a plane", "floating"],
)
def test_forces_are_those_of_the_contacts_own_elements(marble, aside, plate, frame):
    """While pairs are frozen, compiled loops find them, and Python when they slide; without numba always Python."""
    mbs, contacts = chain(marble, aside, plate, frame)
    result = ep.solve_dynamic(mbs, end_time=END, step=STEP)
    own, own_contacts = chain(marble, aside, plate, frame)
    expected = by_own_elements(own)
    assert min(contact.force(result).max() for contact in contacts) > 10.0
    moving = [run.law.gaps.moving for run in result.runs]
    assert moving == [any(aside) or frame == "floating"] * len(moving)
    for found, wanted in zip(all_told(mbs, contacts, result), all_told(own, own_contacts, expected), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12 * abs(wanted[np.isfinite(wanted)]).max())
    for run, other in zip(result.runs, expected.runs, strict=True):
        assert [t for t, *_ in run.samples] == [t for t, *_ in other.samples]
        assert (run.edge is None) == (other.edge is None)
        np.testing.assert_array_equal(run.law.index, other.law.index)
        np.testing.assert_allclose(run.law.resultant(), other.law.resultant(), rtol=1e-9, atol=1e-9)


def test_implicit_steps_take_the_jacobian_of_the_same_state(marble):
    """The contacts' own elements still give it, so that Newton's method converges as fast."""
    mbs, contacts = chain(marble)
    result = ep.solve_dynamic(mbs, end_time=END, step=STEP, method="implicit")
    own, own_contacts = chain(marble)
    expected = by_own_elements(own, exu.DynamicSolverType.GeneralizedAlpha)
    assert result.work.newton_iterations <= 1.2 * expected.work.newton_iterations
    for contact, other in zip(contacts, own_contacts, strict=True):
        np.testing.assert_allclose(contact.force(result), other.force(expected), rtol=1e-6, atol=1e-4)


def test_a_run_by_exudyn_after_one_at_once_is_as_before(marble):
    """The common element is idle again, and the contacts' own apply their forces."""
    mbs, contacts = chain(marble)
    assert len({int(contact["oCommon"]) for contact in contacts}) == 1
    first = contacts[0].force(ep.solve_dynamic(mbs, end_time=END, step=STEP))
    np.testing.assert_allclose(contacts[0].force(by_own_elements(mbs)), first, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(contacts[0].force(ep.solve_dynamic(mbs, end_time=END, step=STEP)), first)


def test_sensors_of_moments_see_the_laws(marble):
    """They ask a law in every sample, which takes over what the loops have found."""
    mbs, contacts = chain(marble)
    contacts[0].AddMomentSensor(mbs, (0.0, 1.0, 0.0))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=END, step=STEP)
    arm = contacts[0].moment_on_slave(result)[:, 0] / np.minimum(contacts[0].force_on_slave(result)[:, 2], -1e-300)
    closed = contacts[0].force(result) > 1.0
    assert closed.any()
    np.testing.assert_allclose(arm[closed], -1.0, atol=1e-3)


def grouped(marble):
    """Laws of a chain to be evaluated alone and in a group, the former together, runs, group, and size of facets."""
    mbs, contacts = chain(marble)
    laws = [[contact.law.for_run("explicit") for contact in contacts] for _ in range(2)]
    alone, together = (contacts[0].together.for_run(some) for some in laws)
    each = zip(laws[1], contacts, strict=True)
    runs = [ContactRun("", law, contact.slices(mbs), 0.0, "explicit") for law, contact in each]
    for run in runs:
        run.join(together, runs)
    return laws, alone, runs, GroupRun(together, runs), contacts[0].slave_facet_size


@pytest.mark.skipif(not compiles(), reason="numba does not load here")
def test_pairs_that_stop_to_slide_go_on_in_loops(marble):
    """They are other pairs than at the start. Forces are those of the laws alone, before, during and after."""
    laws, alone, runs, group, size = grouped(marble)
    moved = np.zeros((3, len(marble.rigid)))
    for step in range(700):
        slide = size * min(max(0.001 * (step - 20), 0.0), 0.05)
        for ball, place in enumerate(moved):
            place[:] = marble.rigid[:, :3] @ [slide * (ball == 1), 0.0, -ball * (1e-6 + 1e-8 * np.sin(step))]
        q = moved.ravel()
        expected = np.zeros(len(q))
        for run, force in zip(runs, alone.forces([run.of(q) for run in runs]), strict=True):
            expected[run.dofs] += force
        np.testing.assert_allclose(group.force(q), expected, rtol=1e-9, atol=1e-9 * abs(expected).max())
        if step in (10, 100, 699):
            assert [law.gaps.moving for law in laws[0]] == [step == 100] * 2
            assert (group.told is None) == (step == 100)
    assert all(law.gaps.searches for law in laws[0])
    # Somebody moves the pairs of a law: then the laws find the present state themselves.
    laws[1][0].gaps.at(runs[0].of(np.concatenate([moved[0], moved[1] + marble.rigid[:, 0] * size, moved[2]])))
    assert runs[0].law.gaps.moving
    np.testing.assert_allclose(runs[0].law.resultant(), laws[0][0].resultant(), rtol=0.02, atol=0.02)
    assert group.told is None


@pytest.mark.skipif(not compiles(), reason="numba does not load here")
def test_contacts_that_fly_tell_the_smallest_gap(marble, monkeypatch):
    """As long as all are open, their lowest rows are enough. Laws that are looked at have all rows."""
    evaluate_rows, counted = FrozenContacts.evaluate_rows, []
    monkeypatch.setattr(FrozenContacts, "evaluate_rows", lambda self, q: counted.append(step) or evaluate_rows(self, q))
    laws, alone, runs, group, size = grouped(marble)
    for step in range(300):
        away = size * ((-0.01 if 100 <= step < 120 else 0.01) + 1e-5 * step)
        q = (marble.rigid[:, 2] * away * [[0], [1], [2]]).ravel()
        force, expected = group.force(q), np.zeros(len(q))
        for run, own in zip(runs, alone.forces([run.of(q) for run in runs]), strict=True):
            expected[run.dofs] += own
        np.testing.assert_allclose(force, expected, rtol=1e-9, atol=1e-9 * abs(expected).max())
        assert group.pushes == expected.any() == (100 <= step < 120)
        gaps = [law.least_gap for law in laws[0]]
        np.testing.assert_allclose(group.told[:, 5], gaps, rtol=1e-9)
        if step == 200:
            assert [run.law.least_gap for run in runs] == pytest.approx(gaps, rel=1e-9)
    assert counted == [0, *range(100, 121), 200]


@pytest.mark.usefixtures("each_path")
@pytest.mark.parametrize("method", ["explicit", "implicit", "own elements"])
def test_sensors_tell_in_each_step(marble, method):
    """Users' functions read them there, however seldom Exudyn stores them. All but the first do without Python."""

    def told(sample_period, read=None):
        mbs, contacts = chain(marble)
        kinds = [mbs.GetSensor(contact["sForce"])["sensorType"] for contact in contacts]
        assert kinds == ["UserFunction", "Node"]
        if read is not None:
            mbs.SetPreStepUserFunction(lambda mbs, t: read.append(mbs.GetSensorValues(contacts[1]["sForce"])) is None)
        if method == "own elements":
            by_own_elements(mbs, sample_period=sample_period)
        else:
            ep.solve_dynamic(mbs, end_time=END, step=STEP, method=method, sample_period=sample_period)
        return mbs.GetSensorStoredData(contacts[1]["sForce"])

    each_step, at_starts = told(STEP), []
    last = told(END, at_starts)[-1]
    assert each_step[:, 1].max() > 10.0
    np.testing.assert_array_equal(at_starts[1:], each_step[1:-1, 1:])
    np.testing.assert_array_equal(last, each_step[-1])


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ContactPatchWarning")
@pytest.mark.filterwarnings("ignore:.* starts with an overlap")  # that presses them
@pytest.mark.parametrize("added", [0.0, 0.3], ids=["alone", "with another item's mass"])
def test_bodies_that_press_on_each_other_at_the_start_move_as_by_own_elements(marble, added):
    """Contacts push at the end of each step, and at first accelerations alone; mass that couples coordinates counts."""

    def pressed():
        mbs, contacts = chain(marble)
        if added:
            matrix = marble.mass.toarray()
            matrix[:3, :3] += added
            node = mbs.GetObject(1)["nodeNumbers"][0]
            mbs.AddObject(items.ObjectGenericODE2(nodeNumbers=[node], massMatrix=added * matrix))
            mbs.Assemble()
        q = mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Initial)
        q[: marble.n_dofs] += 2e-6 * marble.rigid[:, 2]
        mbs.systemData.SetODE2Coordinates(q, exu.ConfigurationType.Initial)
        return mbs, contacts[0]

    mbs, contact = pressed()
    settings = exu.SimulationSettings()  # by which Exudyn computes accelerations at the end of steps once more
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write, settings.timeIntegration.verboseMode = False, 0
    assert settings.timeIntegration.explicit.computeEndOfStepAccelerations
    result = ep.solve_dynamic(mbs, end_time=END, step=STEP, settings=settings)
    own, other = pressed()
    expected = by_own_elements(own)
    assert contact.force(result)[0] > 10.0
    np.testing.assert_allclose(contact.force(result), other.force(expected), rtol=1e-9, atol=1e-9)
    for kind in ("GetODE2Coordinates", "GetODE2Coordinates_t", "GetODE2Coordinates_tt"):
        found, wanted = (getattr(model.systemData, kind)() for model in (mbs, own))
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * abs(wanted).max())
