"""User functions and settings of the caller around a run, Ctrl-C, and runs that end early."""

import signal
import subprocess
import sys

import exudyn as exu
import exudyn.itemInterface as items
import exudyn.solver
import numpy as np
import pytest
from oracles import LONGEST, ctrl_c_after

import exudyn_partition as ep
from exudyn_partition.errors import (
    InputError,
    PartitionWarning,
    RunError,
    StoppedRunWarning,
)

END = 60e-6


def test_the_caller_s_model_keeps_working(impact):
    """A mass on a spring beside the impact, its sensor, and a PreStep function of the user's own."""
    mbs, _, _, contact = impact
    mass = mbs.AddObject(
        items.MassPoint(mass=1.0, nodeNumber=mbs.AddNode(items.NodePoint(initialVelocities=[1, 0, 0])))
    )
    ground = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.AddObject(items.ObjectGround())))
    end = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mass))
    omega = 2 * np.pi / END
    mbs.AddObject(items.CartesianSpringDamper(markerNumbers=[ground, end], stiffness=[omega**2] * 3, damping=[0] * 3))
    sensor = mbs.AddSensor(
        items.SensorBody(bodyNumber=mass, outputVariableType=exu.OutputVariableType.Position, storeInternal=True)
    )
    calls = []
    mbs.SetPreStepUserFunction(lambda mbs, t: calls.append(t) or True)
    own = mbs.GetPreStepUserFunction()["function"]
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=END, step=0.1e-6)
    assert len(calls) == 600
    assert mbs.GetPreStepUserFunction()["function"] is own
    np.testing.assert_allclose(result.sensor(sensor)[:, 0], np.sin(omega * result.t) / omega, atol=1e-3 / omega)
    assert contact.force(result).max() > 1e3


def test_ctrl_c_keeps_what_was_computed(impact):
    mbs, _, _, contact = impact
    before = signal.getsignal(signal.SIGINT)
    with pytest.warns(StoppedRunWarning, match="interrupted by the user; results are kept up to") as caught:
        result = ep.solve_dynamic(mbs, end_time=END, step=0.1e-6, progress=ctrl_c_after(0.5))
    assert caught[0].filename == __file__  # the user's line, not one of the library
    assert result.status == "interrupted"
    assert 0.45 * END < result.t[-1] < 0.6 * END
    assert contact.force(result).max() > 1e3
    assert signal.getsignal(signal.SIGINT) is before


def test_an_unstable_run_keeps_what_was_computed(impact):
    """Made unstable by a user's own force, which no check beforehand can see."""
    mbs, striker, _, contact = impact
    n = striker.body.n_dofs
    mbs.AddObject(
        items.ObjectGenericODE2(
            nodeNumbers=[striker["nModal"]],
            forceUserFunction=lambda mbs, t, i, q, v: 1e16 * np.asarray(q) if t > 30e-6 else np.zeros(n),
            visualization=items.VObjectGenericODE2(show=False),
        )
    )
    mbs.Assemble()
    with pytest.warns(PartitionWarning) as caught:
        result = ep.solve_dynamic(mbs, end_time=2000e-6, step=0.5e-6)
    said = [str(warning.message) for warning in caught if warning.category is StoppedRunWarning]
    assert len(said) == 1
    assert "results are kept up to t = " in said[0]
    assert not any(issubclass(warning.category, RuntimeWarning) for warning in caught)
    assert result.status == "unstable"
    assert 30e-6 <= result.t[-1] < 1500e-6
    assert np.isfinite(contact.force(result)).all()
    assert np.isfinite(striker.coordinates(result)).all()


def test_a_run_that_grows_beyond_all_bounds_is_not_finished(impact):
    """Far above the stability limit by plain SolveDynamic, which nothing checks beforehand."""
    mbs, *_ = impact
    step = 3 * ep.stability_limit(mbs)
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = 40 * step, 40
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    settings.solution.sensors.writePeriod = step
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)
    with pytest.warns(PartitionWarning) as caught:
        result = ep.collect(mbs)
    assert result.status == "unstable"
    assert any("grown beyond all bounds" in str(warning.message) for warning in caught)
    assert 0 < len(result.t) < 40


@pytest.mark.parametrize("sample_period", [0.5e-6, END])
def test_a_user_function_that_ends_the_run(impact, sample_period):
    mbs, *_ = impact
    mbs.SetPreStepUserFunction(lambda mbs, t: t < 20e-6)
    with pytest.warns(StoppedRunWarning, match="user function ended the run at .* s; results are kept"):
        result = ep.solve_dynamic(mbs, end_time=END, step=0.5e-6, sample_period=sample_period)
    assert result.status == "interrupted"
    assert result.steps in (40, 41)


def test_the_user_s_settings_are_kept(impact, tmp_path):
    mbs, *_ = impact
    settings = exu.SimulationSettings()
    settings.solution.file.name = str(tmp_path / "solution.txt")
    settings.timeIntegration.verboseMode = 0
    ep.solve_dynamic(mbs, end_time=END, settings=settings)
    assert (tmp_path / "solution.txt").stat().st_size > 1000
    settings.timeIntegration.startTime = 1.0
    with pytest.raises(InputError, match=r"end_time: expected more than timeIntegration.startTime, 1 s, got 6e-05 s"):
        ep.solve_dynamic(mbs, end_time=END, settings=settings)
    with pytest.raises(InputError, match=r"end_time: expected more than start_time, 2 s, got 6e-05 s"):
        ep.solve_dynamic(mbs, end_time=END, start_time=2.0, settings=settings)


def add_load(mbs, item, answer):
    def load(mbs, t, value):
        return answer()

    marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=item.nodes[0], coordinate=0))
    mbs.AddLoad(items.LoadCoordinate(markerNumber=marker, load=0.0, loadUserFunction=load))


def fail(error):
    raise error


@pytest.mark.parametrize("method", ["explicit", "implicit"])
@pytest.mark.parametrize(("answer", "said"), [
    (lambda: fail(ValueError("no load")), r"ValueError: no load, in the user function \w+::load\w*UserFunction"),
    (lambda: fail(KeyError(7)), r"KeyError: 7, in the user function \w+::load\w*UserFunction"),
    (lambda: fail(InputError("load: expected less")), r"load: expected less$"),
    (lambda: [0.0, 0.0], r"the user function \w+::load\w*UserFunction returned a list of another kind or length"),
    (lambda: None, r"the user function \w+::load\w*UserFunction returned a NoneType of another kind or length"),
])  # fmt: skip
def test_an_error_in_a_user_function_is_told_with_its_place(impact, answer, said, method):
    mbs, striker, *_ = impact
    add_load(mbs, striker, answer)
    mbs.Assemble()
    with pytest.raises(RunError, match=said):
        ep.solve_dynamic(mbs, end_time=1e-6, step=0.2e-6, method=method)


def test_a_user_function_may_end_the_program(impact):
    mbs, *_ = impact
    mbs.SetPreStepUserFunction(lambda mbs, t: fail(SystemExit(3)) if t > 1e-6 else True)
    own = mbs.GetPreStepUserFunction()["function"]
    with pytest.raises(SystemExit, match="3"):
        ep.solve_dynamic(mbs, end_time=2e-6, step=0.2e-6)
    assert mbs.GetPreStepUserFunction()["function"] is own


@pytest.mark.parametrize("value", [[0, 0], None, "x", [0, 0, float("nan")]])
def test_a_traction_that_is_none_names_its_function(mbs, arm_body, value):
    item = ep.CreatePartitionBody(mbs, arm_body)
    item.CreateSurfaceLoad(mbs, "head", (0, 0, -1.0), loadVectorUserFunction=lambda mbs, t, load: value)
    mbs.Assemble()
    with pytest.raises(RunError, match="loadVectorUserFunction: expected"):
        ep.solve_dynamic(mbs, end_time=1e-6, step=0.2e-6)


@pytest.mark.parametrize("which", [("body", "sCoordinates"), ("body", "sCoordinates_t"), ("contact", "sForce")])
def test_a_deleted_sensor_is_named(impact, which):
    """Exudyn gives those behind it other numbers; what they tell would be taken for something else."""
    mbs, striker, _, contact = impact
    thing, key = which
    number = striker[key][0] if thing == "body" else contact[key]
    mbs.DeleteSensor(number)
    mbs.Assemble()
    with pytest.raises(RunError, match=r"has lost its sensor \d+: a sensor was deleted"):
        ep.solve_dynamic(mbs, end_time=1e-6, step=0.2e-6)


PRINTS = """
import exudyn as exu, exudyn.itemInterface as items
import exudyn_partition as ep

mbs = exu.SystemContainer().AddSystem()
mass = mbs.CreateMassPoint(mass=1.0, initialVelocity=[1, 0, 0])
place = exu.OutputVariableType.Position
mbs.AddSensor(items.SensorBody(bodyNumber=mass, outputVariableType=place, storeInternal=True))
mbs.SetPreStepUserFunction(lambda mbs, t: (print("the user's"), exu.Print("by Exudyn"), True)[-1])
mbs.Assemble()
ep.solve_dynamic(mbs, end_time=1.0, step=1.0)
mbs.SetPreStepUserFunction(lambda mbs, t: 1 / 0)
try:
    ep.solve_dynamic(mbs, end_time=1.0, step=1.0)
except ep.errors.RunError:
    print("and after", exu.config.printToConsole)
"""


def test_a_run_prints_what_its_user_prints_and_errors_alone():
    """Each first run of a process had a line on VelocityVerlet, which no user can act on."""
    run = subprocess.run([sys.executable, "-c", PRINTS], capture_output=True, text=True, check=True, timeout=LONGEST)
    printed = [line for line in run.stdout.splitlines() if line]
    assert printed[:2] == ["the user's", "by Exudyn"]
    assert printed[-1] == "and after True"
    assert "DYNAMIC SOLVER FAILED" in run.stdout
    assert "WARNING" not in run.stdout + run.stderr


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_long_runs_print_nothing_of_allocations(impact, monkeypatch, capfd, method):
    """After 100 000 allocations Exudyn warns of user functions. Contacts are such, and no user can act on it."""
    monkeypatch.setattr(exudyn.solver, "solverCheckMemoryAllocationsThreshold", 10)
    ep.solve_dynamic(impact[0], end_time=20e-6, step=0.5e-6, method=method)
    assert "allocations" not in capfd.readouterr().out
    assert exudyn.solver.solverCheckMemoryAllocationsThreshold == 10
