"""A compiled run of a model: steps that `compiled.run` makes without Exudyn, with the result of a run by Exudyn."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ..algebra.blas_threads import one_blas_thread
from ..compiled.moving import rows_of
from ..compiled.plan import StepPlan
from ..compiled.run import EqualSteps, Histories, joined, run, without_start
from ..compiled.start import Start
from ..contact.patch_gaps import PatchGaps
from ..errors import RunError
from ..exudyn_bodies.model import coordinate_slices, registered
from ..exudyn_contacts.group_run import GroupRun
from ..exudyn_contacts.model_run import ModelRun, runs_of
from ..exudyn_contacts.partition_contact import partition_items
from ..support.arrays import Array
from ..support.foreign import MainSystem
from ..support.interrupt import Interrupt, interruptible
from ..support.optional import require
from ..support.progress import LONG, Progress
from ..support.progress import progress as progress_bar
from .compiled_adaptive import run_adaptive, set_state
from .compiled_friction import FrictionGroups
from .compiled_limits import has_friction, own_sensors
from .compiled_plan import (
    contacts_by_group,
    follow_frozen,
    friction_memory,
    give_anchors,
    moving_contacts,
    read_plan,
    with_anchors,
)
from .continuation import keep_compiled_end, undo_if_refused
from .result import Result
from .run_plan import RunPlan, RunTimes
from .sensor_checks import check_sensors
from .step_control import Pace
from .work import Work

_log = logging.getLogger(__name__)


def run_compiled(mbs: MainSystem, plan: RunPlan, progress: Progress | None) -> Result:
    """Make a planned run by compiled steps, and return its result without a review.

    Raises
    ------
    RunError
        If the first step cannot be made.
    """
    check_sensors(mbs)
    times, (bodies, contacts) = plan.times, partition_items(mbs)
    bar = progress_bar("stepping", after=LONG) if progress is None else contextlib.nullcontext(progress)
    with (
        undo_if_refused(mbs),
        one_blas_thread(),
        interruptible() as interrupt,
        bar as report,
        runs_of(mbs).open_run(mbs, times.start, "explicit") as model_run,
    ):
        begin = time.perf_counter()
        start = _start(mbs, plan)
        if model_run.others:
            model_run.others.keep(mbs, times.start)
        grouped = contacts_by_group(contacts)
        groups = [model_run.group_run(members[0]) for members in grouped]
        parts = [(group.together, [run.mechanics for run in group.members]) for group in groups]
        step_plan, following = read_plan(mbs, parts), moving_contacts(mbs, parts)
        start, friction = with_anchors(start, following), None
        if (friction_plan := step_plan.contacts.friction) is not None:
            of_friction = [group for group, members in zip(groups, grouped, strict=True) if has_friction(members)]
            friction = FrictionGroups(friction_plan, of_friction)
            mechanics = [[run.mechanics for run in group.members] for group in of_friction]
            start = replace(start, friction=friction_memory(mechanics))
        if plan.control is None:
            steps, told = EqualSteps(times.step, times.steps, times.between), _told(times.steps, report, interrupt)
            made = run(step_plan, start, steps, report=told)
            _keep_rows(mbs, model_run, step_plan, made, _ends(times, 0, made.made), friction)
            slides = made.stopped is not None and made.stopped.kind == "slides" and not made.stopped.rough
            if slides:  # these pairs follow facets from now on
                states = follow_frozen(mbs, parts, following.pairs, made.end)
                step_plan, following = read_plan(mbs, parts), moving_contacts(mbs, parts)
                goes_on = replace(made.end, pairs=tuple(states))
                rest = without_start(run(step_plan, goes_on, steps, report=told, earlier=made.made))
                _keep_rows(mbs, model_run, step_plan, rest, _ends(times, made.made, rest.made)[1:], friction)
                made = joined(made, rest)
            ends = _ends(replace(times, between=1), 0, made.made)
            t, pace = _ends(times, 0, made.made), Pace()
        else:
            told_time = _told(times.end - times.start, report, interrupt)
            ends, made, pace = run_adaptive(
                mbs, step_plan, start, plan, plan.control, following, model_run, friction,
                lambda t: told_time(t - times.start),
            )  # fmt: skip
            t = ends
            _keep_rows(mbs, model_run, step_plan, made, t, friction)
        if made.stopped and not made.made:
            raise RunError(f"mbs: a compiled run cannot make its first step: {made.stopped.text}")
        sensors = _of_bodies(mbs, made) | _samples_of_contacts(mbs, made) | _replayed(mbs, t, made)
        give_anchors(following, made.end)
        _go_to_end(mbs, model_run, float(ends[-1]), made, friction)
        time_s = time.perf_counter() - begin
    end = keep_compiled_end(mbs, times.step, pace)
    status, message = _ending(plan, made, float(ends[-1]))
    _log.debug("%s compiled steps in %.4g s", made.made, time_s)
    if status == "finished" and progress is not None:
        progress(1.0)
    return Result(
        t=t,
        status=status,
        message=message,
        step=times.step,
        steps=made.made,
        method=plan.method,
        time_s=time_s,
        sensors=sensors,
        bodies=tuple(bodies),
        contacts=tuple(contacts),
        runs=tuple(model_run.contact_run(contact).record for contact in contacts),
        work=Work(active_set_iterations=made.iterations),
        others=model_run.others.motions(mbs),
        dampings=tuple(item.dampings for item in bodies),
        end=end,
    )


def _start(mbs: MainSystem, plan: RunPlan) -> Start:
    """Put the model into its initial state; return it, with accelerations of a run from which this one goes on."""
    data, initial = mbs.systemData, require("exudyn").ConfigurationType.Initial
    data.SetSystemState(data.GetSystemState(initial))
    data.SetTime(plan.times.start)
    if (damping := registered(mbs).damping) is not None:
        damping.begin(mbs)
    q, q_t = np.array(data.GetODE2Coordinates()), np.array(data.GetODE2Coordinates_t())
    if plan.origin is None:
        return Start(q, q_t)
    earlier = plan.origin.contacts
    turning = None if earlier is None or not len(earlier.turning) else earlier.turning
    return Start(q, q_t, plan.origin.q_tt, turning=turning)


def _ends(times: RunTimes, first: int, made: int) -> Array:
    """Times of samples, (n,) [s]: that of step `first`, and those of the samples in the next steps that were made."""
    ends = np.cumsum(np.r_[times.start, np.full(first + made, times.step)])  # as Exudyn's solver adds them up
    if first + made == times.steps and not times.beyond:
        ends[-1] = times.end
    sampled = np.arange(first + 1, first + made + 1)
    return np.asarray(ends[[first, *sampled[sampled % times.between == 0].tolist()]])


def _told(whole: float, report: Progress, interrupt: Interrupt) -> Callable[[float], bool]:
    """Return what a run calls with what it has made of the whole, steps or time: whether it goes on."""

    def told(made: float) -> bool:
        report(min(made / whole, 1.0))
        return not interrupt.asked

    return told


def _of_bodies(mbs: MainSystem, made: Histories) -> dict[int, Array]:
    """Samples of the bodies' sensors, by their numbers."""
    sensors = dict[int, Array]()
    for item in partition_items(mbs)[0]:
        for key, values in (("sCoordinates", made.q), ("sCoordinates_t", made.v)):
            places = zip(item[key], coordinate_slices(mbs, item), strict=True)
            sensors |= {int(number): values[:, place].copy() for number, place in places}
    return sensors


def _samples_of_contacts(mbs: MainSystem, made: Histories) -> dict[int, Array]:
    """Samples of the contacts' sensors, by their numbers."""
    groups = contacts_by_group(partition_items(mbs)[1])
    ordered = [contact for group in groups for contact in group]
    by_sensor = {int(contact["sForce"]): made.values[:, place].copy() for place, contact in enumerate(ordered)}
    with_friction = [contact for group in groups if has_friction(group) for contact in group]
    for place, contact in enumerate(with_friction):
        if "sFriction" in contact:
            by_sensor[int(contact["sFriction"])] = made.friction[:, place].copy()
    return by_sensor


def _replayed(mbs: MainSystem, t: Array, made: Histories) -> dict[int, Array]:
    """Samples of the user's own sensors, by their numbers: Exudyn reads them in the states of the run."""
    data, ours = mbs.systemData, own_sensors(mbs)
    numbers = [n for n in range(data.NumberOfSensors()) if n not in ours and mbs.GetSensor(n)["storeInternal"]]
    read: dict[int, list[Array]] = {number: [] for number in numbers}
    for state in zip(t, made.q, made.v, strict=True) if numbers else ():
        set_state(mbs, *state)
        for number in numbers:
            read[number].append(np.atleast_1d(mbs.GetSensorValues(number)))
    return {number: np.array(values) for number, values in read.items()}


def _keep_rows(
    mbs: MainSystem, model_run: ModelRun, plan: StepPlan, made: Histories, t: Array, friction: FrictionGroups | None
) -> None:
    """Let contacts keep the forces on their rows at all samples, (n,) [s], and where they have left their patches."""
    assert made.lam is not None
    if friction is not None:
        friction.keep(made, t)
    first, starts = 0, plan.contacts.rows.starts
    for contacts in contacts_by_group(partition_items(mbs)[1]):
        if has_friction(contacts):
            continue
        group = model_run.group_run(contacts[0])
        of_group = slice(first, first := first + len(contacts))
        bounds_of_rows = starts[of_group.start : of_group.stop + 1] - starts[of_group.start]
        lam = made.lam[:, starts[of_group.start] : starts[of_group.stop]]
        nodes = np.concatenate([rows_of(member.mechanics.gaps) for member in group.members])
        for i, (begin, end) in enumerate(zip(lam.indptr[:-1], lam.indptr[1:], strict=True)):
            if end > begin:
                rows = lam.indices[begin:end]
                bounds = np.searchsorted(rows, bounds_of_rows).tolist()
                group.samples.add(
                    float(t[i]), nodes[rows], bounds, lam.data[begin:end], made.stored[i, of_group].tolist()
                )
        _look_for_edges(mbs, model_run, group, lam.tocsc(), bounds_of_rows, t, made)
        for place, number in enumerate(range(of_group.start, of_group.stop)):
            if number in made.left:
                sample = int((made.q == made.left[number]).all(axis=1).argmax())
                _look_there(mbs, model_run, group, place, sample, t, made)


def _look_for_edges(
    mbs: MainSystem,
    model_run: ModelRun,
    group: GroupRun,
    lam: sp.csc_matrix,
    starts: Array,
    t: Array,
    made: Histories,
) -> None:
    """Let members whose closed rows leave their patch record it, from forces on rows, (n, nr), and all states."""
    for place, (member, begin) in enumerate(zip(group.members, starts[:-1], strict=True)):
        gaps = member.mechanics.gaps
        if isinstance(gaps, PatchGaps) and gaps.moving:
            continue
        at_edge = np.flatnonzero(np.isfinite(gaps.stage.rows.leaves_at))
        leaving = lam[:, begin + at_edge].toarray() > 0.0
        if not leaving.any():
            continue
        if gaps.stage.linear is not None:
            h = gaps.stage.linear.start[at_edge] + made.q[:, member.dofs] @ gaps.stage.linear.H[at_edge].T
            leaving &= np.maximum(-h, 0.0) >= gaps.stage.rows.leaves_at[at_edge]
        at = leaving.any(axis=1)  # moving rows are those of a patch's rim, which leave it at once
        if at.any():
            _look_there(mbs, model_run, group, place, int(at.argmax()), t, made)


def _look_there(
    mbs: MainSystem, model_run: ModelRun, group: GroupRun, place: int, sample: int, t: Array, made: Histories
) -> None:
    """Let a member of a group record where it leaves its patch in a sample."""
    set_state(mbs, float(t[sample]), made.q[sample], made.v[sample])
    model_run.force(mbs, float(t[sample]))
    group.members[place].record.look_for_edge(float(t[sample]), group.evaluation(place))


def _go_to_end(
    mbs: MainSystem, model_run: ModelRun, t: float, made: Histories, friction: FrictionGroups | None
) -> None:
    """Put the model, and its contacts, into the state at the end of the run."""
    end = made.end
    # Exudyn evaluates contacts at velocities in the middle of a step.
    set_state(mbs, t, end.q, end.v if end.turning is None else end.turning, end.a)
    if friction is not None:
        friction.stand(end, made.end_values, made.end_stored, t)
    model_run.force(mbs, t)
    if end.turning is not None:
        set_state(mbs, t, end.q, end.v, end.a)


def _ending(plan: RunPlan, made: Histories, t: float) -> tuple[str, str]:
    """Status of a run that has ended at a time [s], and a message on how."""
    if made.stopped:
        status = "interrupted" if made.stopped.kind == "slides" else "unstable"
        return status, f"the compiled run stopped: {made.stopped.text}"
    if plan.times.end - t > 0.5 * plan.times.step:
        return "interrupted", "interrupted by the user"
    return "finished", f"reached {plan.times.end:.6g} s"
