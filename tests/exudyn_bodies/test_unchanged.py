"""Runs refuse items of a body that were changed since they were made: contacts and results know nothing of it."""

import exudyn as exu
import numpy as np
import pytest
import scipy.sparse as sp

import exudyn_partition as ep
from exudyn_partition.errors import InputError, RunError

STEP = 1e-7


def dynamic(mbs):
    return ep.solve_dynamic(mbs, end_time=3 * STEP, step=STEP)


def static(mbs):
    return ep.solve_static(mbs, load_steps=1)


@pytest.fixture
def model(mbs, arm_body, frame):
    """A bar that may spin, and a marker on it, whose super element has nodes of its own."""
    item = ep.CreatePartitionBody(mbs, arm_body, name="arm", frame=frame, damping=0.01, gravity=[0, 0, -9.81])
    item.CreateInterfaceMarker(mbs, "head")
    return mbs, item


def container(matrix, factor=1.0):
    """One of Exudyn's containers with a matrix of another one."""
    held = matrix.GetPythonObject()
    rows, columns, values = held["triplets"].T
    return exu.MatrixContainer(sp.csr_matrix((factor * values, (rows.astype(int), columns.astype(int)))))


@pytest.mark.parametrize("run", [dynamic, static])
@pytest.mark.parametrize("name", ["massMatrix", "stiffnessMatrix", "dampingMatrix"])
def test_a_changed_matrix_is_refused(model, name, run):
    mbs, item = model
    before = mbs.GetObjectParameter(item["oGenericODE2"], name)
    mbs.SetObjectParameter(item["oGenericODE2"], name, container(before, 1 + 1e-9))
    mbs.Assemble()
    with pytest.raises(InputError, match=f"mbs: a change of {name} of its ObjectGenericODE2 .* body 'arm'"):
        run(mbs)
    mbs.SetObjectParameter(item["oGenericODE2"], name, container(before))
    mbs.Assemble()
    dynamic(mbs)


@pytest.mark.parametrize("key", ["nRigid", "nModal", "nRigidBody"])
def test_changed_reference_coordinates_are_refused(mbs, arm_body, frame, key):
    """The contact would still be where the body was made. Initial coordinates may change: they are its state."""
    item = ep.CreatePartitionBody(mbs, arm_body, name="arm", frame=frame)
    if key == "nRigidBody":
        item.CreateInterfaceMarker(mbs, "head")
    if key not in item:
        pytest.skip("an inertial frame has no rigid node")
    place = mbs.GetNodeParameter(item[key], "referenceCoordinates")
    mbs.SetNodeParameter(item[key], "referenceCoordinates", [*place[:2], place[2] + 1e-3, *place[3:]])
    mbs.Assemble()
    with pytest.raises(InputError, match=r"a change of referenceCoordinates of its node .* give referencePosition="):
        dynamic(mbs)


def test_changed_reference_coordinates_of_the_system_are_refused(model):
    mbs, _ = model
    mbs.Assemble()
    kind = exu.ConfigurationType.Reference
    reference = np.array(mbs.systemData.GetODE2Coordinates(kind))
    mbs.systemData.SetODE2Coordinates(reference + 1e-3, kind)
    with pytest.raises(InputError, match="a change of the model's reference coordinates"):
        dynamic(mbs)


def test_functions_of_a_body_that_are_replaced_are_refused(mbs, arm_body):
    """Inertia forces would be lost, or a mass would be another one than contacts know."""
    item = ep.CreatePartitionBody(mbs, arm_body, name="arm", frame="floating", initialAngularVelocity=[0, 0, 100])
    number, n = item["oGenericODE2"], arm_body.n_dofs
    mbs.SetObjectParameter(number, "forceUserFunction", lambda mbs, t, i, q, q_t: np.zeros(n))
    mbs.Assemble()
    with pytest.raises(InputError, match="a change of forceUserFunction"):
        dynamic(mbs)


def test_what_may_change_may_change(mbs, arm_body):
    """State, weight, and a force where there was none."""
    item = ep.CreatePartitionBody(mbs, arm_body, name="arm")
    number, n = item["oGenericODE2"], arm_body.n_dofs
    mbs.SetNodeParameter(item["nModal"], "initialCoordinates_t", arm_body.rigid[:, 2])
    mbs.SetObjectParameter(number, "forceVector", item.kinematics.weight(np.array([0, 0, -9.81])))
    mbs.SetObjectParameter(number, "forceUserFunction", lambda mbs, t, i, q, q_t: np.zeros(n))
    mbs.Assemble()
    assert item.momentum(dynamic(mbs))[-1, 2] == pytest.approx(arm_body.total_mass, rel=1e-4)


def test_a_run_within_a_run_of_the_same_model_is_refused(mbs, arm_body):
    """It would change the state beneath the first one. Another model may run in a user function."""
    item = ep.CreatePartitionBody(mbs, arm_body, name="arm", initialVelocity=[0, 0, 1])
    other = exu.SystemContainer().AddSystem()
    ep.CreatePartitionBody(other, arm_body, initialVelocity=[0, 0, 1])
    other.Assemble()
    said = []

    def before_step(mbs, t):
        for run in (dynamic, static):
            try:
                run(mbs)
            except RunError as error:
                said.append(str(error))
        dynamic(other)
        return True

    mbs.SetPreStepUserFunction(before_step)
    mbs.Assemble()
    result = dynamic(mbs)
    assert len(said) == 6
    assert all("a run of this model is under way" in one for one in said)
    np.testing.assert_allclose(item.momentum(result)[:, 2], arm_body.total_mass)
    said.clear()
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = STEP, 1
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    mbs.SolveDynamic(settings)
    assert len(said) == 2


def test_a_body_whose_number_changed_by_a_deletion_is_named(mbs, arm_body):
    """Exudyn numbers objects anew. Bodies were forgotten then, and a run went on without them."""
    other = mbs.CreateGround()
    for name in ("first", "last"):
        ep.CreatePartitionBody(mbs, arm_body, name=name)
    mbs.DeleteObject(other)
    mbs.Assemble()
    with pytest.raises(RunError, match=r"'last' has another number .* an item was deleted"):
        dynamic(mbs)


@pytest.mark.parametrize("what", ["markers", "contacts", "before a contact"])
def test_objects_whose_numbers_changed_by_a_deletion_are_named(mbs, arm_body, round_body, what):
    """Those of markers and of contacts come after the bodies, which keep their numbers."""
    arm = ep.CreatePartitionBody(mbs, arm_body, name="arm")
    ball = ep.CreatePartitionBody(mbs, round_body, name="ball")
    other = mbs.CreateGround()
    if what == "markers":
        arm.CreateInterfaceMarker(mbs, "foot")
    else:
        ep.CreatePartitionContact(mbs, ball, ep.RigidPlane((0, 0, -1)))
    mbs.DeleteObject(other)
    owner = "an object of body 'arm'" if what == "markers" else "the object of all contacts"
    told = f"{owner} has another number .* an item was deleted"
    if what == "before a contact":
        with pytest.raises(RunError, match=told):
            ep.CreatePartitionContact(mbs, ball, ep.RigidPlane((0, 0, -2)))
    else:
        mbs.Assemble()
        with pytest.raises(RunError, match=told):
            dynamic(mbs)
