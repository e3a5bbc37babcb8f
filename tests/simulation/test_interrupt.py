"""Ctrl-C at any time of a run: what was computed is kept, and is what an undisturbed run computes."""

import signal

import exudyn as exu
import numpy as np
import pytest
from oracles import TOP, press_ctrl_c

import exudyn_partition as ep
from exudyn_partition.errors import StoppedRunWarning
from exudyn_partition.simulation import joint_checks, solve

END = 4e-6
# Runs that end with the first touch have one row closed.
pytestmark = pytest.mark.filterwarnings("ignore:.* rows is closed:exudyn_partition.errors.ModelLimitWarning")


@pytest.fixture(scope="module")
def with_mass(pair_of):
    """Ball and block whose patches have mass, for multipliers."""
    return pair_of("craig-bampton")


def run(bodies, formulation, at=None):
    """The ball in contact with the block, pushed by a load that a PreStep function sets; Ctrl-C in its call `at`."""
    mbs, calls = exu.SystemContainer().AddSystem(), []
    options = {"referencePosition": TOP, "initialVelocity": [0, 0, -1.0]}
    striker = ep.CreatePartitionBody(mbs, bodies[0], **options)
    contact = ep.CreatePartitionContact(
        mbs, striker, ep.CreatePartitionBody(mbs, bodies[1]), formulation=formulation, rows="node-to-segment"
    )
    weight = striker.kinematics.weight(np.array([0, 0, -1.0]))

    def push(mbs, t):
        mbs.SetObjectParameter(striker["oGenericODE2"], "forceVector", 1e9 * t * weight)
        calls.append(t)
        if len(calls) == at:
            press_ctrl_c()
        return True

    mbs.SetPreStepUserFunction(push)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=END, step=10e-9)
    return result, contact.force(result), striker.coordinates(result)


@pytest.mark.parametrize("at", [1, 2, 50])
@pytest.mark.parametrize("formulation", ["compliance", "lagrange"])
def test_what_is_kept_is_the_beginning_of_the_whole_run(bodies, with_mass, formulation, at):
    """The last step went without multipliers, and without what the model's own PreStep function does."""
    bodies = with_mass if formulation == "lagrange" else bodies
    with pytest.warns(StoppedRunWarning, match="interrupted by the user"):
        result, force, q = run(bodies, formulation, at)
    _, whole_force, whole_q = run(bodies, formulation)
    kept = len(result.t)
    assert at < kept <= at + 2
    assert result.steps == kept - 1
    np.testing.assert_array_equal(q, whole_q[:kept])
    if formulation == "compliance":  # those of multipliers are means over the steps on both sides
        np.testing.assert_array_equal(force, whole_force[:kept])
    assert (np.diff(whole_q[:, 2]) != 0).any()


def test_before_the_first_step(impact, monkeypatch):
    """The checks before a run take a thousandth of it, and Ctrl-C in them left nothing."""
    checked = joint_checks.check_joints
    monkeypatch.setattr(joint_checks, "check_joints", lambda *a, **options: (press_ctrl_c(), checked(*a, **options))[1])
    before = signal.getsignal(signal.SIGINT)
    with pytest.warns(StoppedRunWarning, match="interrupted by the user"):
        result = ep.solve_dynamic(impact[0], end_time=1e-3)
    assert signal.getsignal(signal.SIGINT) is before
    assert result.status == "interrupted"
    assert 1 <= len(result.t) <= 2


def test_after_the_last_step(impact, monkeypatch):
    reviewed = solve.reviewed
    monkeypatch.setattr(solve, "reviewed", lambda *arguments: (press_ctrl_c(), reviewed(*arguments))[1])
    result = ep.solve_dynamic(impact[0], end_time=END)
    assert result.status == "finished"
    assert result.t[-1] == pytest.approx(END)
