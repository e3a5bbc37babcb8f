"""Adaptive steps of compiled runs: the control of Exudyn's runs chooses them; steps in contact are made at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..compiled.loops import Stepper
from ..compiled.moving import Moves
from ..compiled.plan import StepPlan
from ..compiled.run import Histories, Record
from ..compiled.start import Start
from ..exudyn_contacts.model_run import ModelRun
from ..support.arrays import Array
from ..support.foreign import MainSystem
from .compiled_friction import FrictionGroups
from .compiled_plan import give_anchors
from .run_plan import RunPlan
from .step_control import Pace, StepControl

_OVER = 1e-6  # share of a step: a run that has less time left is at its end
_AT_ONCE = 32  # steps in contact that are made before one looks whether contacts have opened or closed


def run_adaptive(
    mbs: MainSystem,
    step_plan: StepPlan,
    start: Start,
    plan: RunPlan,
    control: StepControl,
    following: Moves,
    model_run: ModelRun,
    friction: FrictionGroups | None,
    report: Callable[[float], bool],
) -> tuple[Array, Histories, Pace]:
    """Run a plan by steps that a control chooses, with a sample after each.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        It follows the run where the control looks at it.
    step_plan : StepPlan
    start : Start
    plan : RunPlan
    control : StepControl
    following : Moves
        Contacts whose rows follow the motion.
    model_run : ModelRun
        The present run.
    friction : FrictionGroups or None
        Its contacts with friction.
    report : callable
        Called with the time that is reached [s]; the run ends early if it returns False.

    Returns
    -------
    Times of the samples, (n,) [s], what the run leaves, and what the control knows at its end.
    """
    end, times, stepper = plan.times.end, [plan.times.start], Stepper(step_plan.contacts, len(step_plan.bodies.mass))
    stopped = stepper.begin(step_plan, start)
    record, last = Record(step_plan, stepper), plan.times.step
    pace = control.begin(None if plan.origin is None else plan.origin.pace)
    while not stopped:
        t = times[-1]
        before = stepper.state()
        set_state(mbs, t, before.q, before.v, before.a)
        if friction is not None:
            friction.stand(before, stepper.values, stepper.stored, t)
        give_anchors(following, before)
        model_run.force(mbs, t)
        pace = control.after_step(pace, last)
        if end - t <= _OVER * plan.times.step or not report(t):
            break
        step = pace.step if end - t >= pace.step else end - t
        closed = stepper.closed.copy()
        in_contact = closed.any() and step == last == control.step and control.gap_tolerance is None
        count = max(min(_AT_ONCE, int((end - t) / step) - 1), 1) if in_contact else 1
        samples = record.room(count)
        made, stopped = stepper.advance(step, 1, count, 1, samples)
        changed = np.flatnonzero(((samples.values[:made, :, 1] > 0.0) != closed).any(axis=1))
        if len(changed) and changed[0] + 1 < made:  # the control looks at the step in which a contact opens or closes
            stepper.go_back(before)
            samples = record.room(int(changed[0]) + 1)
            made, stopped = stepper.advance(step, 1, len(samples.values), 1, samples)
        record.add(samples, made)
        for number in range(made):
            times.append(times[-1] + step)
            if number < made - 1:  # nothing has changed: the step stays
                pace = control.after_step(pace, step)
        last = step
    return np.array(times), record.histories(len(times) - 1, stopped), pace.at_end


def set_state(mbs: MainSystem, t: float, q: Array, q_t: Array, q_tt: Array | None = None) -> None:
    """Put the model into a state."""
    data = mbs.systemData
    data.SetODE2Coordinates(q)
    data.SetODE2Coordinates_t(q_t)
    if q_tt is not None:
        data.SetODE2Coordinates_tt(q_tt)
    data.SetTime(t)
