"""Runs that go on where one ended, bodies that start pressed, and run lengths that no solver finishes."""

import exudyn as exu
import numpy as np
import pytest
from oracles import add_springs

import exudyn_partition as ep
from exudyn_partition.errors import InputError, ModelLimitWarning

END, HALF = 60e-6, 30e-6


INITIAL = exu.ConfigurationType.Initial


def go_on(mbs):
    """Make the state that the last run ended in the initial one."""
    mbs.systemData.SetSystemState(mbs.systemData.GetSystemState(), INITIAL)


def settings_from(start):
    settings = exu.SimulationSettings()
    settings.timeIntegration.startTime = start
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    return settings


@pytest.mark.parametrize("options", [
    {"method": "explicit", "step": 0.25e-6}, {"method": "implicit", "step": 0.25e-6},
    {"method": "explicit", "step": 0.25e-6, "adaptive": True}, {"step": 0.25e-6, "start_time": HALF},
])  # fmt: skip
def test_a_run_that_goes_on_in_the_middle_of_an_impact(impact, options):
    """Times go on, and force, momentum and energy are those of one run."""
    mbs, striker, target, contact = impact
    options = dict(options)
    begins = options.pop("start_time", None)  # wins over that of the settings
    whole = ep.solve_dynamic(mbs, end_time=END, settings=settings_from(0.0), **options)
    force = contact.force(whole)
    momentum = striker.momentum(whole)[-1]
    first = ep.solve_dynamic(mbs, end_time=HALF, settings=settings_from(0.0), **options)
    start = contact.force(first)[-1]
    go_on(mbs)
    shares = []
    again = {"settings": settings_from(HALF if begins is None else 0.7 * END), "start_time": begins}
    second = ep.solve_dynamic(mbs, end_time=END, progress=shares.append, **again, **options)
    assert second.status == "finished"
    assert (second.t[0], second.t[-1]) == (pytest.approx(HALF), pytest.approx(END))
    assert shares[0] < 0.1
    assert start > 100
    assert contact.force(second)[0] == pytest.approx(start, rel=1e-9)
    expected = np.interp(second.t, whole.t, force)
    np.testing.assert_allclose(contact.force(second), expected, atol=5e-3 * force.max())
    np.testing.assert_allclose(striker.momentum(second)[-1], momentum, atol=1e-3 * abs(momentum).max())
    energy = [sum(x.energy(result) for x in (striker, target, contact)) for result in (whole, second)]
    assert energy[1][-1] == pytest.approx(energy[0][-1], rel=1e-3)
    (impact_,) = contact.impacts(second)
    assert impact_.start == pytest.approx(HALF)


def pressed(mbs, body, weight, spring):
    """The ball on a plane under its weight [N], with springs on its rigid motion, `spring` [N/m] on translations."""
    item = ep.CreatePartitionBody(mbs, body, name="ball", gravity=[0, 0, -weight / body.total_mass])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), name="floor")
    add_springs(mbs, item, spring / body.total_mass)
    mbs.Assemble()
    return item, contact


@pytest.mark.filterwarnings("ignore:contact .floor. at t = .* of 123 rows is closed at the peak")
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_body_that_starts_pressed_stays_at_rest(mbs, bodies, method):
    """Statics first: then the contact carries the weight from the first sample on, and nothing moves."""
    weight, spring = 50.0, 1e5
    item, contact = pressed(mbs, bodies[0], weight, spring)
    settings = settings_from(0.0)
    settings.staticSolver.verboseMode = 0
    mbs.SolveStatic(settings, updateInitialValues=True)
    assert ep.collect(mbs).method == "static"
    result = ep.solve_dynamic(mbs, end_time=40e-6, step=0.25e-6, method=method)
    force, sunk = contact.force(result), item.rigid_motion(item.coordinates(result))[:, 2]
    assert -5e-6 < sunk[0] < -5e-7
    np.testing.assert_allclose(force, weight + spring * sunk[0], rtol=1e-5)
    np.testing.assert_allclose(sunk, sunk[0], rtol=1e-5)
    assert abs(item.momentum(result)).max() < 1e-5 * weight * 40e-6


@pytest.mark.parametrize(("options", "message"), [
    ({"end_time": 1e30, "step": 1e-6}, r"step: .* in steps of 1e-06 s are 1e\+36 steps; Exudyn counts to 2.15e\+09"),
    ({"end_time": 1.0, "step": 1e-30}, "step: 1 s in steps of 1e-30 s are"),
    ({"end_time": 1e-20}, "end_time: a run of 1e-20 s is too short for Exudyn.* expected at least 9.3e-20 s"),
])  # fmt: skip
def test_runs_that_no_solver_finishes(impact, options, message):
    with pytest.raises(InputError, match=message):
        ep.solve_dynamic(impact[0], **options)


@pytest.mark.filterwarnings("ignore:a PreStep or other user function ended the run")
def test_an_adaptive_run_of_many_steps_is_told_at_once(impact):
    """Even if nothing ever touches, each explicit step is bounded by stability."""
    mbs, *_ = impact
    mbs.SetPreStepUserFunction(lambda mbs, t: False)
    with pytest.warns(ModelLimitWarning, match=r"adaptive: 10 s take at least .* never touch. Take method='implicit'"):
        ep.solve_dynamic(mbs, end_time=10.0, adaptive=True)
