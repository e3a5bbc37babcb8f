"""Warnings name the user's line, whatever is between it and the check that warns."""

import re
import warnings
from pathlib import Path

import exudyn as exu
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import ModelLimitWarning, PartitionWarning, StoppedRunWarning, UnitsWarning
from exudyn_partition.support.warn import warn

PACKAGE = Path(ep.__file__).parent

TETRAHEDRON = np.array([[0, 0, 0], [900.0, 0, 0], [0, 900.0, 0], [0, 0, 900.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def turning(marble):
    """A model whose body turns further than its frame allows."""
    mbs = exu.SystemContainer().AddSystem()
    ep.CreatePartitionBody(mbs, marble, initialAngularVelocity=[2e3, 0, 0], frame="inertial")
    mbs.Assemble()
    return mbs


def settings():
    """Of a run in Exudyn's own solver."""
    chosen = exu.SimulationSettings()
    chosen.timeIntegration.endTime, chosen.timeIntegration.numberOfSteps = 1e-4, 200
    chosen.solution.sensors.writePeriod, chosen.solution.file.write = 1e-6, False
    return chosen


def mesh(marble):
    return ep.fe_model(box(10, 20, 30), ep.STEEL, maxh=10)


def rigid_mesh(marble):
    return ep.RigidMesh(TETRAHEDRON, FACES)


def body(marble):
    mbs = exu.SystemContainer().AddSystem()
    return ep.CreatePartitionBody(mbs, marble, gravity=[0, 0, -9810.0])


def run(marble):
    mbs = turning(marble)
    return ep.solve_dynamic(mbs, end_time=1e-4, step=5e-7)


def run_that_stops(marble):
    mbs = turning(marble)
    mbs.SetPreStepUserFunction(lambda mbs, t: t < 5e-5)
    return ep.solve_dynamic(mbs, end_time=1e-4, step=5e-7)


def collected(marble):
    mbs = turning(marble)
    mbs.SolveDynamic(settings(), solverType=exu.DynamicSolverType.VelocityVerlet)
    return ep.collect(mbs)


def within_a_user_s_function(marble):
    mbs = exu.SystemContainer().AddSystem()
    mbs.CreateMassPoint(referencePosition=[0, 0, 0], mass=1.0)
    made = []

    def before_step(mbs, t):
        if not made:
            made.append(ep.RigidMesh(TETRAHEDRON, FACES))
        return True

    mbs.SetPreStepUserFunction(before_step)
    mbs.Assemble()
    mbs.SolveDynamic(settings())


@pytest.mark.parametrize(
    ("call", "category", "at"),
    [
        (mesh, UnitsWarning, "fe_model("),
        (rigid_mesh, UnitsWarning, "RigidMesh("),
        (body, UnitsWarning, "CreatePartitionBody("),
        (run, ModelLimitWarning, "solve_dynamic("),
        (run_that_stops, StoppedRunWarning, "solve_dynamic("),
        (collected, ModelLimitWarning, "collect("),
        (within_a_user_s_function, UnitsWarning, "RigidMesh("),
    ],
)
def test_a_warning_names_the_user_s_file_and_line(marble, call, category, at):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call(marble)
    told = [one for one in caught if issubclass(one.category, PartitionWarning)]
    assert category in {one.category for one in told}
    first, lines = call.__code__.co_firstlineno, Path(__file__).read_text().splitlines()
    for one in told:
        assert one.filename == __file__
        assert first < one.lineno < first + 20
        assert at in lines[one.lineno - 1]


def test_a_line_is_told_once_and_another_one_again():
    """As Python does by default: the registry of what was told belongs to the user's module."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        for _ in range(3):
            warn("at one line", UnitsWarning)
        warn("at one line", UnitsWarning)
    assert len(caught) == 2


def test_all_of_the_package_warns_in_this_way():
    """Frames that are counted by hand are right until someone puts a function between them."""
    told = re.compile(r"\bwarnings\.warn\(|stacklevel")
    assert [path.name for path in PACKAGE.rglob("*.py") if told.search(path.read_text())] == ["warn.py"]
