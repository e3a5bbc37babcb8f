"""Contacts of a chain, whose forces one object of the model holds, against an element for each that asks the laws."""

import itertools
from types import SimpleNamespace

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
from oracles import MARBLE_RADIUS as R

import exudyn_partition as ep
from exudyn_partition.exudyn_contacts.contact_replay import forces_in_group
from exudyn_partition.exudyn_contacts.contact_run import ContactRun
from exudyn_partition.exudyn_contacts.group_run import CoupledRun
from exudyn_partition.exudyn_contacts.model_run import ModelRun, runs_of
from exudyn_partition.support.compiled import compiles

STEP, END = 0.1e-6, 15e-6


def row_of_balls(marble, aside=(0.0, 0.0, 0.0), plate=None, frame="inertial"):
    """Marbles that meet, with speeds across the line of contact, on a rigid plane below if there is one."""
    mbs = exu.SystemContainer().AddSystem()
    return mbs, [
        ep.CreatePartitionBody(
            mbs,
            marble,
            frame=frame,
            referencePosition=[0, 0, 2 * R * i],
            initialVelocity=[v, 0, 0.6 * ((1 if plate is None else -1) - i)],
        )
        for i, v in enumerate(aside)
    ]


def chain(marble, aside=(0.0, 0.0, 0.0), plate=None, frame="inertial"):
    """The same with their contacts."""
    mbs, balls = row_of_balls(marble, aside, plate, frame)
    between = {"slavePatch": "north", "masterPatch": "south"}
    contacts = [ep.CreatePartitionContact(mbs, *pair, **between) for pair in itertools.pairwise(balls)]
    if plate is not None:
        contacts.append(ep.CreatePartitionContact(mbs, balls[0], plate, slavePatch="south"))
    mbs.Assemble()
    return mbs, contacts


def with_elements(marble, *options):
    """The same balls without contacts, but with an element for each, which asks the laws of contacts elsewhere."""
    _, (first, *_) = chain(marble, *options)
    contacts = first.group
    mbs, balls = row_of_balls(marble, *options)
    laws = [contact.mechanics.for_run("explicit") for contact in contacts]
    together = first.together.for_run(laws)
    places = [[round(item.kinematics.position[2] / (2 * R)) for item, _ in contact.sides] for contact in contacts]
    size = sum(balls[0].node_sizes)

    def element(j):
        def force(mbs, t, i, q, q_t):
            each = np.reshape(mbs.systemData.GetODE2Coordinates(), (-1, size))
            of_sides = np.reshape(together.forces([each[place].ravel() for place in places])[j], (-1, size))
            for place, own in zip(places[j], of_sides, strict=True):
                if options[2:] == ("floating",) and own.any():
                    own[:] = balls[place].kinematics.on_constant_mass(each[place], own)
            return of_sides.ravel()

        force.__module__ = f"{ep.__name__}.contacts"  # as the library's own, it knows the mass that forces act on
        return force

    for j, place in enumerate(places):
        nodes = [node for k in place for node in balls[k].nodes]
        mbs.AddObject(items.ObjectGenericODE2(nodeNumbers=nodes, forceUserFunction=element(j)))
    mbs.Assemble()
    return mbs, {tuple(place): law for place, law in zip(places, laws, strict=True)}


def run_by_exudyn(mbs, solver=exu.DynamicSolverType.VelocityVerlet, sample_period=STEP):
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


def assert_same_motion(mbs, other, rtol=1e-9):
    """Both models have ended in the same state."""
    for kind in ("GetODE2Coordinates", "GetODE2Coordinates_t", "GetODE2Coordinates_tt"):
        found, wanted = (getattr(model.systemData, kind)() for model in (mbs, other))
        np.testing.assert_allclose(found, wanted, rtol=rtol, atol=rtol * abs(wanted).max())


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
def test_forces_are_those_of_an_element_for_each_contact(marble, aside, plate, frame):
    """While pairs are frozen, compiled loops find them, and Python when they slide; without numba always Python."""
    mbs, contacts = chain(marble, aside, plate, frame)
    result = ep.solve_dynamic(mbs, end_time=END, step=STEP)
    other, laws = with_elements(marble, aside, plate, frame)
    run_by_exudyn(other)
    assert min(contact.force(result).max() for contact in contacts) > 10.0
    runs = [runs_of(mbs).at_work(contact) for contact in contacts]
    moving = [run.mechanics.gaps.moving for run in runs]
    assert moving == [any(aside) or frame == "floating"] * len(moving)
    assert_same_motion(mbs, other)
    for run, law in zip(runs, (laws[0, 1], laws[1, 2], *([] if plate is None else [laws[0,]])), strict=True):
        np.testing.assert_array_equal(run.evaluation.index, law.evaluation.index)
        np.testing.assert_allclose(run.evaluation.resultant(), law.evaluation.resultant(), rtol=1e-9, atol=1e-9)


def test_forces_on_nodes_of_a_group_are_evaluated_once_for_all_its_contacts(marble, monkeypatch):
    """A review asks for them at samples of each contact; one by one the cost goes with the cube of their number."""
    mbs, contacts = chain(marble)
    result = ep.solve_dynamic(mbs, end_time=END, step=STEP)
    two = result.at(result.t[[-20, -1]])
    alone = [contact.nodal_forces(two) for contact in contacts]
    kind, asked = type(contacts[0].together), []
    forces = kind.forces
    monkeypatch.setattr(kind, "forces", lambda self, *given: asked.append(given) or forces(self, *given))
    found = forces_in_group(contacts, two)
    assert len(asked) == len(two.t)
    for one, own in zip(found, alone, strict=True):
        assert all(side.any() for side in own)
        for side, known in zip(one, own, strict=True):
            np.testing.assert_array_equal(side, known)


def test_the_jacobian_is_the_derivative_of_the_forces(marble):
    """Of each contact, and between contacts on one ball."""
    mbs, contacts = chain(marble)
    common = {int(contact["oContact"]) for contact in contacts}
    assert len(common) == 1
    (number,) = common
    entry, q = mbs.GetObject(exu.ObjectIndex(number)), mbs.systemData.GetODE2Coordinates()
    q[: marble.n_dofs] += 2e-6 * marble.rigid[:, 2]
    q[-marble.n_dofs :] -= 2e-6 * marble.rigid[:, 2]
    force, jacobian = (entry[f"{name}UserFunction"]["function"] for name in ("force", "jacobian"))

    def at(q):
        mbs.systemData.SetODE2Coordinates(q)
        return np.array(force(mbs, 0.0, number, q, 0 * q))

    change = 1e-12
    columns = [(at(q + change * axis) - at(q - change * axis)) / (2 * change) for axis in np.eye(len(q))]
    at(q)
    K = jacobian(mbs, 0.0, number, q, 0 * q, 1.0, 0.0).GetPythonObject()
    found = np.zeros((len(q),) * 2)
    for row, column, value in K["triplets"]:
        found[int(row), int(column)] += value
    assert abs(found[: marble.n_dofs, -marble.n_dofs :]).max() > 1e-3 * abs(found).max()
    np.testing.assert_allclose(found, -np.array(columns).T, rtol=0, atol=1e-5 * abs(found).max())


def test_a_jacobian_takes_the_answer_of_its_own_state_alone(marble, monkeypatch):
    """Implicit solvers ask for it where they have asked for forces before; elsewhere, contacts are evaluated there."""
    mbs, contacts = chain(marble)
    number, asked, evaluate = exu.ObjectIndex(int(contacts[0]["oContact"])), [], ModelRun.force
    entry, data = mbs.GetObject(number), mbs.systemData
    force, jacobian = (entry[f"{name}UserFunction"]["function"] for name in ("force", "jacobian"))
    monkeypatch.setattr(ModelRun, "force", lambda run, *where: asked.append(where[1]) or evaluate(run, *where))
    q, pressed = data.GetODE2Coordinates(), data.GetODE2Coordinates()
    pressed[: marble.n_dofs] += 2e-6 * marble.rigid[:, 2]

    def stiffness():
        data.SetODE2Coordinates(pressed)
        return np.array(jacobian(mbs, 0.0, number, pressed, 0 * q, 1.0, 0.0).GetPythonObject()["triplets"])

    with runs_of(mbs).open_run(mbs, 0.0, "implicit"):
        alone = stiffness()
        assert len(alone)
        for before in (pressed, q):  # only after the first, it is known
            data.SetODE2Coordinates(before)
            force(mbs, 0.0, number, before, 0 * before)
            asked.clear()
            np.testing.assert_allclose(stiffness(), alone, rtol=1e-12)
            assert len(asked) == (0 if before is pressed else 1)
        data.SetODE2Coordinates_t(1e-3 * pressed)  # on which laws may depend
        asked.clear()
        stiffness()
        assert len(asked) == 1


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_run_by_exudyn_itself_is_the_same(marble, method):
    """Before and after one by `solve_dynamic`: there is one way for the forces."""
    mbs, contacts = chain(marble)
    solver = {"explicit": exu.DynamicSolverType.VelocityVerlet, "implicit": exu.DynamicSolverType.GeneralizedAlpha}
    run_by_exudyn(mbs, solver[method])
    alone = ep.collect(mbs)
    result = ep.solve_dynamic(mbs, end_time=END, step=STEP, method=method)
    assert contacts[1].force(result).max() > 10.0
    tolerance = 0.0 if method == "explicit" else 1e-6
    for contact in contacts:
        np.testing.assert_allclose(contact.force(alone), contact.force(result), rtol=tolerance, atol=tolerance)
        np.testing.assert_allclose(contact.energy(alone), contact.energy(result), rtol=tolerance, atol=tolerance)
    again = ep.solve_dynamic(mbs, end_time=END, step=STEP, method=method)
    np.testing.assert_array_equal(contacts[0].force(again), contacts[0].force(result))


def test_a_contact_that_is_added_after_a_run_acts_in_the_next(marble):
    """The object that holds the forces takes it too, and what was kept of the first run stays."""
    mbs, balls = row_of_balls(marble)
    between = {"slavePatch": "north", "masterPatch": "south"}
    first = ep.CreatePartitionContact(mbs, *balls[:2], **between)
    mbs.Assemble()
    run_by_exudyn(mbs)
    second = ep.CreatePartitionContact(mbs, *balls[1:], **between)
    assert int(second["oContact"]) == int(first["oContact"])
    mbs.Assemble()
    run_by_exudyn(mbs)
    whole, contacts = chain(marble)
    run_by_exudyn(whole)
    assert_same_motion(mbs, whole, rtol=0)
    np.testing.assert_array_equal(second.force(ep.collect(mbs)), contacts[1].force(ep.collect(whole)))


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
    mbs, (first, _) = chain(marble)
    contacts = first.group
    laws = [[contact.mechanics.for_run("explicit") for contact in contacts] for _ in range(2)]
    alone, together = (contacts[0].together.for_run(some) for some in laws)
    each = zip(laws[1], contacts, strict=True)
    runs = [ContactRun("", law, contact.slices(mbs), 0.0, "explicit") for law, contact in each]
    return laws, alone, runs, CoupledRun(runs, together), contacts[0].slave_facet_size


def force_of(group, q, start=0.0):
    """Generalised forces of a group at the model's coordinates, (nq,), in the step that begins at a time."""
    force, mbs = np.zeros(len(q)), SimpleNamespace(systemData=SimpleNamespace(GetTime=lambda configuration: start))
    group.at(mbs, start + 1.0, q)
    group.add_force(force)
    return force


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
        for law in laws[0]:
            law.accept(float(step))
        for run, force in zip(runs, alone.forces([run.coordinates_in(q) for run in runs]), strict=True):
            expected[run.dofs] += force
        np.testing.assert_allclose(
            force_of(group, q, float(step)), expected, rtol=1e-9, atol=1e-9 * abs(expected).max()
        )
        if step in (10, 100, 699):
            assert [law.gaps.moving for law in laws[0]] == [step == 100] * 2
            assert (group.values is None) == (step == 100)
    assert all(law.gaps.searches for law in laws[0])
    # Somebody moves the pairs of a law: then the laws find the present state themselves.
    laws[1][0].gaps.at(
        runs[0].coordinates_in(np.concatenate([moved[0], moved[1] + marble.rigid[:, 0] * size, moved[2]]))
    )
    assert runs[0].mechanics.gaps.moving
    np.testing.assert_allclose(runs[0].evaluation.resultant(), laws[0][0].evaluation.resultant(), rtol=0.02, atol=0.02)
    assert group.values is None


@pytest.mark.skipif(not compiles(), reason="numba does not load here")
def test_contacts_that_fly_tell_the_smallest_gap(marble):
    """Also laws that are looked at in between."""
    laws, alone, runs, group, size = grouped(marble)
    for step in range(300):
        away = size * ((-0.01 if 100 <= step < 120 else 0.01) + 1e-5 * step)
        q = (marble.rigid[:, 2] * away * [[0], [1], [2]]).ravel()
        force, expected = force_of(group, q), np.zeros(len(q))
        for run, own in zip(runs, alone.forces([run.coordinates_in(q) for run in runs]), strict=True):
            expected[run.dofs] += own
        np.testing.assert_allclose(force, expected, rtol=1e-9, atol=1e-9 * abs(expected).max())
        assert group.pushes == expected.any() == (100 <= step < 120)
        gaps = [law.evaluation.least_gap for law in laws[0]]
        np.testing.assert_allclose(group.values[:, 5], gaps, rtol=1e-9)
        if step == 200:
            assert [run.evaluation.least_gap for run in runs] == pytest.approx(gaps, rel=1e-9)


@pytest.mark.usefixtures("each_path")
@pytest.mark.parametrize("method", ["explicit", "implicit", "by Exudyn"])
def test_sensors_tell_in_each_step(marble, method):
    """Users' functions read them there, however seldom Exudyn stores them. All but the first do without Python."""

    def told(sample_period, read=None):
        mbs, contacts = chain(marble)
        kinds = [mbs.GetSensor(contact["sForce"])["sensorType"] for contact in contacts]
        assert kinds == ["UserFunction", "Node"]
        if read is not None:
            mbs.SetPreStepUserFunction(lambda mbs, t: read.append(mbs.GetSensorValues(contacts[1]["sForce"])) is None)
        if method == "by Exudyn":
            run_by_exudyn(mbs, sample_period=sample_period)
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
def test_bodies_that_press_on_each_other_at_the_start_move_as_by_elements(marble, added):
    """Also where mass couples coordinates, and where Exudyn computes accelerations at the end of steps once more."""

    def pressed(mbs):
        if added:
            matrix = marble.mass.toarray()
            matrix[:3, :3] += added
            node = mbs.GetObject(1)["nodeNumbers"][0]
            mbs.AddObject(items.ObjectGenericODE2(nodeNumbers=[node], massMatrix=added * matrix))
            mbs.Assemble()
        q = mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Initial)
        q[: marble.n_dofs] += 2e-6 * marble.rigid[:, 2]
        mbs.systemData.SetODE2Coordinates(q, exu.ConfigurationType.Initial)

    mbs, (contact, _) = chain(marble)
    pressed(mbs)
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write, settings.timeIntegration.verboseMode = False, 0
    assert settings.timeIntegration.explicit.computeEndOfStepAccelerations
    result = ep.solve_dynamic(mbs, end_time=END, step=STEP, settings=settings)
    other, _ = with_elements(marble)
    pressed(other)
    run_by_exudyn(other)
    assert contact.force(result)[0] > 10.0
    assert_same_motion(mbs, other)
