"""Work of single joints, springs, dampers and loads: against their own energies, and against those of the bodies."""

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from oracles import TOP
from scipy.integrate import cumulative_simpson

import exudyn_partition as ep
from exudyn_partition.errors import InputError, RunError

KIND = exu.OutputVariableType
STIFFNESS, DAMPING, FORCE = 1e6, 50.0, 100.0
SPEED, GRAVITY = 5.0, np.array([0, 0, -9.81])


@pytest.fixture(scope="module")
def bar():
    """A bar of 200 mm with an interface at each end and a load on one face."""
    shape = occ.Box((0, -0.01, -0.01), (0.2, 0.01, 0.01))
    for name, face in (("left", occ.X), ("right", -occ.X)):
        shape.faces.Min(face).name = name
    shape.faces.Max(occ.Z).name = "top"
    fem = ep.fe_model(shape, ep.STEEL, maxh=0.02)
    ends = ep.Partition.interface(fem, "left", "left") | ep.Partition.interface(fem, "right", "right")
    return ep.reduce(fem, ends | ep.Partition.load(fem, "top", "top"), f_cut=5e3)


def swinging(bar, frame, **options):
    """A model of the bar, which turns about a hinge at its left; the bar, and markers of ground and its right end."""
    mbs = exu.SystemContainer().AddSystem()
    turning = np.array([0, SPEED, 0])
    item = ep.CreatePartitionBody(
        mbs, bar, name="bar", frame=frame, initialAngularVelocity=turning,
        initialVelocity=np.cross(turning, bar.centre_of_mass), **options,
    )  # fmt: skip
    ground = mbs.CreateGround()
    held = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground))
    markers = [held, item.CreateInterfaceMarker(mbs, "left")]
    mbs.AddObject(items.GenericJoint(name="hinge", markerNumbers=markers, constrainedAxes=[1, 1, 1, 1, 0, 1]))
    end = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=[0.2, 0, 0]))
    return mbs, item, [end, item.CreateInterfaceMarker(mbs, "right")]


@pytest.mark.parametrize(
    ("frame", "method", "step"), [("inertial", "explicit", 1.5e-6), ("floating", "implicit", 5e-6)]
)
def test_each_item_has_its_own_energy_and_all_have_that_of_the_body(bar, frame, method, step):
    mbs, item, markers = swinging(bar, frame, gravity=GRAVITY)
    springs = [
        mbs.AddObject(items.CartesianSpringDamper(name=name, markerNumbers=markers, **constants))
        for name, constants in (("spring", {"stiffness": [STIFFNESS] * 3}), ("damper", {"damping": [DAMPING] * 3}))
    ]
    load = {"markerNumber": markers[1], "bodyFixed": True}
    mbs.AddLoad(items.LoadForceVector(name="push", loadVector=[0, 0, FORCE], **load))
    mbs.AddLoad(items.LoadTorqueVector(name="twist", loadVector=[1, 5, 0], **load))
    ep.CreateDistributedLoad(mbs, item, "top", 2e4, name="pressure")
    sensors = [
        mbs.AddSensor(items.SensorObject(objectNumber=springs[0], outputVariableType=quantity, storeInternal=True))
        for quantity in (KIND.Displacement, KIND.Velocity)
    ]
    work = ep.CreateWorkSensor(mbs)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=0.9e-3, step=step, method=method)
    found = {name.split(" (")[0]: values for name, values in work.work(result).items()}
    assert [*found] == ["gravity on bar", "hinge", "spring", "damper", "pressure", "push", "twist"]

    stretch, speed = (result.sensor(number) for number in sensors)
    stored = STIFFNESS / 2 * (stretch**2).sum(axis=1)
    np.testing.assert_allclose(found["spring"], -stored, atol=1e-4 * stored.max())  # its way bends as the bar turns
    loss = DAMPING * cumulative_simpson((speed**2).sum(axis=1), x=result.t, initial=0.0)
    np.testing.assert_allclose(found["damper"], -loss, atol=1e-3 * loss[-1])
    assert loss[-1] > 0.1 * stored.max()
    fallen = item.rigid_motion(item.coordinates(result))[:, 2]
    weight = bar.total_mass * GRAVITY[2] * (fallen - fallen[0])
    np.testing.assert_allclose(found["gravity on bar"], weight, atol=1e-8 * abs(weight).max())
    assert abs(found["hinge"]).max() < 1e-5 * stored.max()  # what it holds does not move

    given = item.energy(result) - item.energy(result)[0]
    np.testing.assert_allclose(sum(found.values()), given, atol=1e-3 * abs(given).max())
    assert min(abs(found[name]).max() for name in ("push", "twist", "pressure")) > 0.01 * abs(given).max()


def test_a_report_of_an_impact_has_a_line_for_each_item(mbs, bodies, tmp_path):
    """A ball that a spring pulls at hits a block: what is left of the balance is the error of the steps."""
    striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -0.5])
    target = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target)
    ground = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.CreateGround(), localPosition=[*TOP]))
    own = striker.CreateNodeMarker(mbs, bodies[0].points[bodies[0].points[:, 2].argmax()])
    for _ in range(2):
        mbs.AddObject(items.SpringDamper(name="", markerNumbers=[ground, own], stiffness=1e5, referenceLength=0.0))
    ep.CreateWorkSensor(mbs)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=40e-6, step=0.2e-6)
    work = result.item_work.work(result)
    assert len(work) == 2
    given = sum(item.energy(result) for item in (striker, target, contact))
    np.testing.assert_allclose(sum(work.values()), given - given[0], atol=2e-3 * abs(given - given[0]).max())
    page = result.report(tmp_path / "run.html").read_text(encoding="utf-8")
    assert all(f"given by {name} [J]" in page for name in work)
    assert "given by other items; else the steps&#39; error [J]" in page
    again = ep.Result.load(saved(result, tmp_path / "run.npz"), mbs)
    np.testing.assert_array_equal([*again.item_work.work(again).values()], [*work.values()])


@pytest.mark.parametrize("every", [1, 20])
def test_work_of_a_spring_over_an_impact_is_its_energy(mbs, bodies, every):
    """Velocities turn within a few steps there, so that integrated powers were off, mostly between rare samples."""
    striker = ep.CreatePartitionBody(
        mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -0.5], gravity=GRAVITY.tolist()
    )
    target = ep.CreatePartitionBody(mbs, bodies[1])
    ep.CreatePartitionContact(mbs, striker, target)
    ground = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.CreateGround(), localPosition=[*TOP]))
    own = striker.CreateNodeMarker(mbs, bodies[0].points[bodies[0].points[:, 2].argmax()])
    spring = mbs.AddObject(items.CartesianSpringDamper(markerNumbers=[ground, own], stiffness=[STIFFNESS] * 3))
    stretch = mbs.AddSensor(
        items.SensorObject(objectNumber=spring, outputVariableType=KIND.Displacement, storeInternal=True)
    )
    work = ep.CreateWorkSensor(mbs)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=40e-6, step=0.2e-6, sample_period=every * 0.2e-6)
    weight, pull = work.work(result).values()
    stored = STIFFNESS / 2 * (result.sensor(stretch) ** 2).sum(axis=1)
    np.testing.assert_allclose(pull, stored[0] - stored, atol=1e-9 * stored.max())
    fallen = striker.rigid_motion(striker.coordinates(result))[:, 2]
    expected = bodies[0].total_mass * GRAVITY[2] * (fallen - fallen[0])
    np.testing.assert_allclose(weight, expected, atol=1e-9 * abs(expected).max())


@pytest.mark.parametrize("first", [True, False])
def test_a_connector_that_is_switched_off_does_no_work(bar, first):
    """Exudyn tells no forces of it: the run ended at the sensor."""
    mbs, item, markers = swinging(bar, "floating")
    spring = mbs.AddObject(
        items.CartesianSpringDamper(markerNumbers=markers, stiffness=[STIFFNESS] * 3, activeConnector=first)
    )

    def switch(mbs, t):
        mbs.SetObjectParameter(spring, "activeConnector", (t < 1e-4) == first)
        return True

    mbs.SetPreStepUserFunction(switch)
    work = ep.CreateWorkSensor(mbs)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=2e-4, step=5e-6, method="implicit")
    assert result.status == "finished"
    pull, off = [*work.work(result).values()][-1], result.t > 1.05e-4 if first else result.t < 0.95e-4
    assert np.ptp(pull[off]) == 0.0
    given = item.energy(result) - item.energy(result)[0]
    assert abs(pull).max() > 0.0
    np.testing.assert_allclose(pull[result.t < 1e-4], given[result.t < 1e-4], atol=1e-3 * abs(given).max())


@pytest.mark.parametrize("added", [False, True])
def test_items_that_come_or_go_after_the_sensor_are_told(bar, added):
    """It read the loads that had got the numbers of others."""
    mbs, item, markers = swinging(bar, "inertial")
    places = markers[1], item.CreateInterfaceMarker(mbs, "left")  # Exudyn deletes a marker with its load
    loads = [mbs.AddLoad(items.LoadForceVector(markerNumber=place, loadVector=[0, 0, 1.0])) for place in places]
    ep.CreateWorkSensor(mbs)
    if added:
        mbs.AddLoad(items.LoadForceVector(name="late", markerNumber=places[1], loadVector=[0, 0, FORCE]))
    else:
        mbs.DeleteLoad(loads[0])
    mbs.Assemble()
    with pytest.raises(RunError, match=r"items were added or deleted since CreateWorkSensor: it knows .*load0"):
        ep.solve_dynamic(mbs, end_time=1e-5, step=1e-6)


def saved(result, path):
    result.save(path)
    return path


def test_what_has_no_work(bar):
    mbs, _, markers = swinging(bar, "inertial")
    empty = exu.SystemContainer().AddSystem()
    with pytest.raises(InputError, match="expected a model with partition bodies"):
        ep.CreateWorkSensor(empty)
    ep.CreatePartitionBody(empty, bar)
    with pytest.raises(InputError, match="expected joints, springs or loads on partition bodies"):
        ep.CreateWorkSensor(empty)
    mbs.AddObject(items.CartesianSpringDamper(markerNumbers=markers, stiffness=[STIFFNESS] * 3))
    work = ep.CreateWorkSensor(mbs)
    with pytest.raises(InputError, match="has a work sensor already"):
        ep.CreateWorkSensor(mbs)
    mbs.Assemble()
    with pytest.raises(InputError, match="got one of statics"):
        work.work(ep.solve_static(mbs))


def test_a_sensor_from_before_a_reset_is_forgotten(bar):
    mbs, *_ = swinging(bar, "inertial")
    before = ep.CreateWorkSensor(mbs)
    mbs.Reset()
    ep.CreatePartitionBody(mbs, bar, gravity=GRAVITY)
    assert ep.CreateWorkSensor(mbs).names == ("gravity on body 0",)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-5, step=1e-6)
    with pytest.raises(InputError, match="expected one of the model that this sensor of work belongs to"):
        before.work(result)


def test_a_run_by_exudyn_that_reads_the_sensor_seldom_can_be_collected(mbs, bodies):
    """The contacts keep all steps, the sensor of work does not: the balance does without it."""
    striker = ep.CreatePartitionBody(
        mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0], gravity=GRAVITY.tolist()
    )
    target = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target, rows="node-to-segment")
    sensor = ep.CreateWorkSensor(mbs)
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = 40e-6, 80
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)
    result = ep.collect(mbs)
    assert contact.force(result).max() > 0
    with pytest.raises(InputError, match=r"read sensor \d+ less often"):
        sensor.work(result)


def with_weight(mbs, item, gravity):
    """Let a body have another weight, as scripts do that switch gravity."""
    weight = item.kinematics.weight(np.asarray(gravity))
    mbs.SetObjectParameter(item["oGenericODE2"], "forceVector", weight)


def test_gravity_that_comes_after_the_sensor_is_named(bar):
    mbs, item, _ = swinging(bar, "inertial")
    mbs.AddLoad(items.LoadForceVector(markerNumber=item.CreateInterfaceMarker(mbs, "right"), loadVector=[0, 0, 1.0]))
    ep.CreateWorkSensor(mbs)
    with_weight(mbs, item, GRAVITY)
    mbs.Assemble()
    with pytest.raises(RunError, match="gravity on bar was set after CreateWorkSensor"):
        ep.solve_dynamic(mbs, end_time=5e-6, step=5e-6, method="implicit")


@pytest.mark.parametrize("start", [0.0, 3e-3])
def test_work_of_gravity_that_is_switched_between_runs_is_that_of_each_run(bar, start):
    """A run that began later than the last one ended took the weight from before."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, bar, name="bar", gravity=GRAVITY)
    work = ep.CreateWorkSensor(mbs)
    mbs.Assemble()
    for gravity, begin in ((GRAVITY, 0.0), (-3 * GRAVITY, start)):
        with_weight(mbs, item, gravity)
        result = ep.solve_dynamic(mbs, start_time=begin, end_time=begin + 2e-4)
        done = work.work(result)["gravity on bar"]
        np.testing.assert_allclose(done, item.energy(result), rtol=1e-6, atol=1e-12 * done[-1])
