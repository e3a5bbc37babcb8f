"""The run of a model: the state of all its contacts. Each run has its own. See `contact_run` for one contact."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from ..contact.formulations.formulation import Method
from ..contact.patch_contact import PatchContact
from ..errors import ComplementarityError, RunError
from ..exudyn_bodies.joints import Joints
from ..exudyn_bodies.model import latest_solver, method_of, registered
from ..exudyn_bodies.other_bodies import OtherBodies
from ..exudyn_bodies.rotation_vectors import rotation_vectors
from ..support.arrays import Array, as_slice
from ..support.foreign import MainSolver, MainSystem
from ..support.optional import require
from .contact_run import ContactRun
from .contact_samples import ModelContact
from .group_run import GroupRun
from .run_members import RunMembers, acted_on, number_of
from .run_record import RunRecord, sensors_keep_all
from .run_state import RunState
from .slip_secants import SlipSecants

_log = logging.getLogger(__name__)

RUNS = "exudynPartitionRun"  # key in mbs.sys
_ROUND_OFF = 1e-12  # relative difference of times that are the same
_NO_MORE = 2**30  # more iterations than Newton's method may make


def _unstable_energies() -> np.errstate:
    """Context in which energies may overflow, without a warning by NumPy.

    An unstable run ends when its gaps are no longer finite. Energies are products of gaps and forces: they are infinite
    some steps before. Reviews find where energies grow without bound, end the result there, and tell it.
    """
    return np.errstate(over="ignore")


class ModelRun:
    """State of a model's contacts in one run.

    Who takes part is fixed at its start, see `RunMembers`. In a run only these attributes change: `evaluated_at` and
    the state of the last answer in each evaluation, `ended` at each sample, `unsettled` in load steps, `broken` and
    `over` at the end. So do the time spent in contacts, and the velocities by which bodies in floating frames grow.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        The model, assembled.
    contacts : sequence of PartitionContact
        All contacts of the model.
    t : float
        Time at which the run begins [s].
    method : {"explicit", "implicit", "static"}
    joints : Joints, optional
        Joints of the model, if explicit steps close them together with the contacts.
    keep : bool
        Whether the record keeps the ends of steps. It need not if Exudyn's sensors keep them.
    state : RunState, optional
        End of a run from which this one goes on as if both were one.
    solver : exudyn.MainSolver, optional
        Exudyn's solver that makes the run. Default: one that comes.

    Attributes
    ----------
    contacts : list of PartitionContact
    record : RunRecord
    dofs : (n,) int array
        Numbers of the coordinates on which contacts may act, in the order of Exudyn's object of contacts.
    of_object : slice or (n,) int array
        The same places, as a slice if that can be.
    method : {"explicit", "implicit", "static"}
    acts_within : bool
        Whether contacts have forces within steps; multipliers ahead of steps do not count.
    idle : bool
        Whether there is nothing to do ahead of steps.
    vectors : tuple of int
        First coordinates of rotation vectors, to which the static solver adds its steps.
    others : OtherBodies
        Record of where Exudyn's own bodies are, for pictures.
    unsampled : bool
        Whether the model has no contact whose sensor would keep this record.
    evaluated_at : float
        Time at which contacts were evaluated last [s].
    ended : (float, (nq,) array) or None
        Time [s] and coordinates of the model at the end of the run, or when the sensors were last read.
    broken : bool
        Whether an error stopped the run in a step to whose start its multipliers cannot return.
    unsettled : ComplementarityError or None
        Why contact forces did not settle in the present try of a load step.
    slip_secants : SlipSecants or None
        Adds to the Jacobian, if a static run needs it; `solve_static` sets it when the run has begun.
    divides : bool
        Whether the static solver repeats a load step with a shorter length where contact forces do not settle; set
        likewise.
    """

    def __init__(
        self,
        mbs: MainSystem,
        contacts: Sequence[ModelContact],
        t: float,
        method: Method,
        joints: Joints | None,
        keep: bool,
        state: RunState | None = None,
        solver: MainSolver | None = None,
    ) -> None:
        self._members = members = RunMembers.at_start(mbs, contacts, t, method, joints, state)
        self.contacts, self.method, self._began = members.contacts, method, t
        self._run_of = {id(contact): run for contact, run in zip(contacts, members.runs, strict=True)}
        self._all_ask = all(run.asks for run in members.runs)
        self._elastic = all(run.mechanics.elastic for run in members.runs)  # their energies overflow in silence
        self._within = [group for group in members.groups if group.acts_within]
        self.acts_within, self.idle, self.unsampled = bool(self._within), not members.steppers, not contacts
        self.others, self.record = OtherBodies(mbs, members.carriers), RunRecord(t, keep)
        self.dofs, self._total = acted_on(mbs, contacts), np.zeros(mbs.systemData.ODE2Size())
        self.of_object = as_slice(self.dofs)
        self.slip_secants: SlipSecants | None = None
        self.divides = False
        self.vectors = tuple(rotation_vectors(mbs)) if method == "static" else ()

        self.evaluated_at, self._spent_s = t, 0.0
        self.ended: tuple[float, Array] | None = None
        self.unsettled: ComplementarityError | None = None
        self.broken = self._released = False
        self._turning = np.empty(0) if state is None else state.turning
        self._known: tuple[float, bytes, bytes] | None = None  # time, coordinates, velocities of the last answer
        self._by_motion = method != "explicit" and all(run.impulses is None for run in members.runs)
        self._solver = solver

    def state(self) -> RunState | None:
        """State at the end of the run; None if it has none. Contacts that stopped within a step have no state."""
        if self.ended is None:
            return None
        t, q = self.ended
        whole = not self.broken and abs(self.evaluated_at - t) <= _ROUND_OFF * abs(t)
        with _unstable_energies():
            contacts = tuple(self.contact_run(contact).state(number_of(contact)) for contact in self.contacts if whole)
        steppers = tuple(stepper.state(numbers) for (_, numbers), stepper in self._members.steppers.items() if whole)
        return RunState(
            self.method, t, self.evaluated_at, q, self.has_steps, self.broken, contacts, steppers, self._turning
        )

    @property
    def contact_s(self) -> float:
        """Time in contacts so far [s]."""
        return self._spent_s

    @property
    def active_set_iterations(self) -> int:
        """Iterations of all contacts' active sets so far."""
        by_laws = sum(run.iterations for run in self._members.runs)
        return by_laws + sum(stepper.iterations for stepper in self._members.steppers.values())

    @property
    def pair_searches(self) -> int:
        """Searches of the pairs of all points so far."""
        return sum(run.mechanics.gaps.searches for run in self._members.runs)

    def contact_run(self, contact: ModelContact) -> ContactRun:
        """State of a contact.

        Raises
        ------
        RunError
            If the model did not hold the contact as it was created, when the run began.
        """
        run = self.find(contact)
        if run is None:
            raise RunError(
                f"contact {contact.name!r} is not in the model as CreatePartitionContact left it: an item was deleted, "
                "which gives others new numbers. Delete no objects, nodes, markers or sensors of a model with "
                "partition bodies; make it anew"
            )
        return run

    def group_run(self, contact: ModelContact) -> GroupRun:
        """State of the contacts that belong together with a contact; it is in one group."""
        return self._members.group_of(self.contact_run(contact))

    def find(self, contact: ModelContact) -> ContactRun | None:
        """State of a contact; None if it was not in the model when the run began."""
        return self._run_of.get(id(contact))

    def begin(self, initial: Array, earlier: Sequence[RunState], t: float, *, goes_on: bool) -> RunState | None:
        """Let contacts begin from the end of earlier runs with another method or time, if that is the initial state.

        `initial`, (nq,), are the model's initial coordinates. Return the first end from which a contact goes on. The
        energies that contacts have taken go on too if the user said so by `goes_on`, or if that run ended at time t.
        """
        first_end = None
        for contact in self.contacts:
            run = self.contact_run(contact)
            mechanics = run.mechanics
            for end in earlier:
                last = end.find(number_of(contact))
                if last is None or not np.array_equal(run.coordinates_in(end.q), run.coordinates_in(initial)):
                    continue
                counts = end.ended_in(initial) and (goes_on or (end.has_steps and end.ended_when(t)))
                overlaps = bool(mechanics.gaps.placement.overlap)
                closed = overlaps and end.has_steps and end.ended_in(initial)  # by load steps
                if counts or mechanics.remembers or closed:
                    opening, moves = mechanics.opening, end.method != "static"
                    state = last.for_other_run(counts=counts, moves=moves, sticks=not mechanics.ahead)
                    run.begin(state, t, as_one=False)
                    mechanics.opening = min(opening, last.contact.opening) if closed else opening
                    first_end = first_end or end
                    break
        return first_end

    @property
    def has_steps(self) -> bool:
        """Whether the run has made steps."""
        return self.ended is not None and self.ended[0] > self._began

    @property
    def latest(self) -> float:
        """Time at which the sensors were last read, or at which the run began [s]."""
        return self._began if self.ended is None else self.ended[0]

    def ended_in(self, q: Array) -> bool:
        """Whether the run ended at the model's coordinates q, (nq,), at any time."""
        return self.ended is not None and np.array_equal(self.ended[1], q)

    def at_start_of_step(self, mbs: MainSystem) -> None:
        """Find forces at the start of the step in which an error stopped the run; the model is there again.

        Forces within steps are found again from the state after the last step that was made. Multipliers that were
        applied in this step cannot be taken back: then the run is `broken`.
        """
        t, q = float(mbs.systemData.GetTime()), mbs.systemData.GetODE2Coordinates()
        self._known = None
        if self.method == "static" and t > self._began:
            self._press(mbs, t)
        within = [group.at_start(mbs, t, q) for group in self._within]
        ahead = [stepper.at_start(t) for stepper in self._members.steppers.values()]  # with those of joints
        self.broken, self.evaluated_at = not all(within + ahead), t
        self.publish(mbs, whole=True)

    def force(self, mbs: MainSystem, t: float) -> Array | None:
        """Generalised forces of all contacts within a step, (nq,), in the model's present state at t [s].

        None if there are none. The next call writes to the same array. Before, the record keeps the last step's end.
        """
        begin = time.perf_counter()
        if self.record.on:
            self.keep_last_step(mbs, t)
        self.evaluated_at, total, self._known = t, None, None
        q = mbs.systemData.GetODE2Coordinates(copy=False)
        self._turn(mbs)
        if self.method == "static" and t > self._began:
            self._press(mbs, t)
        for group in self._within:
            group.at(mbs, t, q)
            if group.pushes:
                if total is None:
                    total = self._total
                    total.fill(0.0)
                group.add_force(total)
        if not self._all_ask:
            self.publish(mbs)
        if total is not None:
            for place, kinematics in self._members.floating:
                pushed = total[place]
                if np.count_nonzero(pushed):  # is quicker than any()
                    total[place] = kinematics.on_constant_mass(q[place], pushed)
        if self._by_motion:
            self._known = t, q.tobytes(), mbs.systemData.GetODE2Coordinates_t(copy=False).tobytes()
        self._spent_s += time.perf_counter() - begin
        return total

    def knows(self, mbs: MainSystem, t: float) -> bool:
        """Whether the last answer is that of the model's present state at t [s].

        Implicit solvers ask for a Jacobian where they have asked for forces before.
        """
        if self._known is None or t != self._known[0]:
            return False
        data, (_, q, q_t) = mbs.systemData, self._known
        now, now_t = data.GetODE2Coordinates(copy=False), data.GetODE2Coordinates_t(copy=False)
        return bool(now.tobytes() == q and now_t.tobytes() == q_t)

    def look_at_start(self, mbs: MainSystem, t: float) -> None:
        """Find forces and gaps where a static run begins, t [s], for its first sample.

        Exudyn asks for forces in iterations alone, so that a preload would seem to begin without any. Where forces do
        not settle, none is told.
        """
        with contextlib.suppress(ComplementarityError):
            self.force(mbs, t)

    def settled_force(self, mbs: MainSystem, t: float) -> Array | None:
        """See `force`. Where it `divides`, a load step is given up if forces do not settle; then it returns None.

        Newton's method then makes no more iterations, so that Exudyn repeats the step with a shorter length.
        """
        if not self.divides:
            return self.force(mbs, t)
        if self.unsettled is None:
            try:
                return self.force(mbs, t)
            except ComplementarityError as error:
                self.unsettled = error
        mbs.sys["staticSolver"].it.newtonSteps = _NO_MORE
        return None

    def contact_force(self) -> Array:
        """Generalised forces of all contacts within the step in the state that was evaluated last, (nq,)."""
        total = np.zeros_like(self._total)
        for group in self._within:
            if group.pushes:
                group.add_force(total)
        return total

    def _turn(self, mbs: MainSystem) -> None:
        """Let the growth of bodies in floating frames follow their rotation; statics know none."""
        if self._members.floating:
            self._turning = np.empty(0) if self.method == "static" else mbs.systemData.GetODE2Coordinates_t()
            self._members.grow(self._turning)

    @cached_property
    def _openings(self) -> list[tuple[PatchContact, float]]:
        """Contacts with overlaps that are meant, and how far these are open at the start of a static run [m]."""
        return [(run.mechanics, run.mechanics.opening) for run in self._members.runs if run.mechanics.opening]

    def _press(self, mbs: MainSystem, t: float) -> None:
        """Close overlaps that are meant, in proportion to the static time t."""
        if self._openings:
            solver = mbs.sys["staticSolver"].it
            left = (solver.endTime - t) / (solver.endTime - solver.startTime)
            for mechanics, opening in self._openings:
                mechanics.opening = opening * min(left, 1.0) if left > _ROUND_OFF else 0.0

    def publish(self, mbs: MainSystem, *, whole: bool = False) -> None:
        """Write the values of sensors `sForce` to the data that they read, in the state that was evaluated last.

        With `whole`, also of contacts whose values were written before and have not changed.
        """
        data = mbs.systemData.GetDataCoordinates(copy=False)
        for group in self._members.groups:
            group.publish(data, whole=whole)

    def keep(self, t: float, q: Callable[[], Array]) -> None:
        """Keep the data that results need of the state at t; `q` returns the model's coordinates at t."""
        if self._elastic or self._all_open:  # a context takes some microseconds, and open contacts have no energies
            self._keep(t, q)
            return
        with _unstable_energies():
            self._keep(t, q)

    def _keep(self, t: float, q: Callable[[], Array]) -> None:
        for group in self._members.groups:
            group.keep(t, q)

    @property
    def _all_open(self) -> bool:
        """Whether no contact has forces in the state that was evaluated last."""
        groups = self._members.groups
        return self.idle and not any([group.pushes for group in groups])

    def keep_last_step(self, mbs: MainSystem, t: float) -> None:
        """Keep the end of the last step in the record, before contacts are evaluated at time t [s]."""
        if self.record.on:
            self.record.advance(mbs, t, partial(self._recorded, mbs))

    def _recorded(self, mbs: MainSystem, t: float, q: Array) -> dict[int, list[float]]:
        """Values of the contacts' sensors at the start of the step, t, and coordinates q; keys are their numbers."""
        self.keep(t, lambda: q)
        if self.others:
            self.others.keep(mbs, t, start_of_step=True)
        values: dict[int, list[float]] = {}
        for contact in self.contacts:
            run = self.contact_run(contact)
            values[int(contact["sForce"])] = run.force_values()
            if "sFriction" in contact:
                values[int(contact["sFriction"])] = run.friction_values()
            if "sPlastic" in contact:
                values[int(contact["sPlastic"])] = run.plastic_values()
            if contact.moment_about is not None:
                values[int(contact["sMoment"])] = run.evaluation.moment(contact.moment_about).tolist()
        return values

    def before_step(self, mbs: MainSystem, t: float, *, joined: bool) -> None:
        """Apply multipliers ahead of the explicit step that ends at t.

        With `joined`, these are the multipliers of joints and contacts together; otherwise those of contacts alone.
        A second call for the same step does nothing.
        """
        self.evaluated_at = t
        begin = time.perf_counter()
        for (joins, _), stepper in self._members.steppers.items():
            if joins == joined and not stepper.has_made(t):
                self._turn(mbs)
                stepper.before_step(mbs, t)
        self._spent_s += time.perf_counter() - begin

    def look_ahead(self, mbs: MainSystem, t: float) -> None:
        """Apply multipliers of contacts in the explicit step that begins at t; a second call does nothing."""
        begin = time.perf_counter()
        self._turn(mbs)
        for stepper in self._members.steppers.values():
            stepper.look_ahead(mbs, t)
        self._spent_s += time.perf_counter() - begin

    def after_step(self, mbs: MainSystem, t: float) -> None:
        """Correct velocities for the joints at the end of a step."""
        for stepper in self._members.steppers.values() if t > self._began else ():
            stepper.after_step(mbs, t)

    @property
    def over(self) -> bool:
        """Whether the run has ended: who asks for a stiffness linearises about a state."""
        return self._released or (self._solver is not None and bool(self._solver.output.finishedSuccessfully))

    def release(self) -> None:
        """Drop the data that only the run needed. Results keep contacts and samples; joints would keep the model."""
        self._released, self._solver = True, None
        for group in self._members.groups:
            group.end()
        for stepper in self._members.steppers.values():
            stepper.joints = None


@dataclass(frozen=True, eq=False)
class _Present:
    """What a model knows of its present run, or of the last one when it has ended.

    Parameters
    ----------
    run : ModelRun or None
    origin : RunState or None
        End from which this run goes on.
    solver : exudyn.MainSolver or None
        Exudyn's solver as the run last met it.
    solver_comes : bool
        Whether the run has begun ahead of its solver.
    outdated : bool
        Whether contacts were added since.
    goes_on : bool
        Whether the run begins where the last one ended.
    given : tuple of (RunState or None), optional
        End from which a run goes on by its user's choice, if there is such a choice.
    """

    run: ModelRun | None = None
    origin: RunState | None = None
    solver: MainSolver = None
    solver_comes: bool = False
    outdated: bool = False
    goes_on: bool = False
    given: tuple[RunState | None] | None = None


class Runs:
    """The present run of a model, or the last one when it has ended. User functions find their state here."""

    def __init__(self) -> None:
        self._present = _Present()

    def _note(self, **changes: Any) -> None:
        """Change some of what is known of the present run."""
        self._present = replace(self._present, **changes)

    def now(self, mbs: MainSystem) -> ModelRun:
        """The present run, which evaluates contacts. If there is none, or contacts were added, a run begins."""
        run = self._present.run
        if run is None or self._present.outdated:
            return self.begin(mbs, float(mbs.systemData.GetTime()))
        return run

    def add_contact(self) -> None:
        """Record that the model has another contact: a new run must begin before contacts are evaluated again."""
        self._note(outdated=True)

    def sample(self, mbs: MainSystem, t: float) -> ModelRun:
        """The run whose sensors are read at time t; all contacts keep their data of that time.

        Exudyn's first act in a run is to read the sensors. The run begins here, unless `open_run` has begun it. The
        sensor of the first contact calls this method. The values that other sensors read are those of the last
        evaluation. They are written again in two cases: if multipliers are applied ahead of steps, and at the start,
        because Exudyn has then reset them to their initial values.
        """
        present, now, last = self._present, self._present.run, self.last(mbs)
        first = now is None or last is None or t < now.latest or present.outdated or present.solver_comes
        if now is None or (first and not present.solver_comes):
            now = self.begin(mbs, t)
        if first and now.method == "static":
            now.look_at_start(mbs, t)
        if first or not now.idle:
            now.publish(mbs, whole=first)
        if last is None or self._present.solver_comes:
            self._note(solver=mbs.sys.get("dynamicSolver"), solver_comes=False)
        q = mbs.systemData.GetODE2Coordinates()
        now.ended = t, q
        now.keep(t, lambda: q)
        if now.others:
            now.others.keep(mbs, t)
        return now

    def begin(self, mbs: MainSystem, t: float, method: Method | None = None, joints: Joints | None = None) -> ModelRun:
        """Begin a run at time t [s].

        Without a method, the run has the method of Exudyn's solver. Its record keeps steps that Exudyn's sensors do not
        keep. With a method, only sensors keep steps, with the period that the user chose.
        """
        keep, solver = method is None and not sensors_keep_all(mbs), None
        if method is None:
            solver = latest_solver(mbs)
            method = "explicit" if solver is None else method_of(solver)
        if solver is not None and solver.output.finishedSuccessfully:  # it made an earlier run
            solver = None
        contacts: list[ModelContact] = [*registered(mbs).contacts.values()]
        _log.debug("a run of %s contacts begins at %.6g s, %s", len(contacts), t, method)
        initial, present = mbs.systemData.GetODE2Coordinates(require("exudyn").ConfigurationType.Initial), self._present
        earlier = [end for end in (self._ends() if present.given is None else present.given) if end is not None]
        goes_on = present.goes_on
        if present.given is not None or (
            present.run is not None and present.run.has_steps  # otherwise a run begins again before its first step
        ):
            goes_on = any(end.ended_in(initial) for end in earlier)
        same = next((end for end in earlier if end.ended_at(t, method, initial)), None)
        if present.run is not None:
            present.run.release()
        run = ModelRun(mbs, contacts, t, method, joints, keep, same, solver)
        for contact in contacts:
            run.contact_run(contact).record.goes_on = goes_on
        resumed = same or run.begin(initial, earlier, t, goes_on=present.given is not None)
        # Later runs from the same initial state go on from the same run, also if its contacts remember nothing.
        origin = next((end for end in earlier if end.has_steps and end.ended_in(initial)), resumed)
        solver = mbs.sys.get("dynamicSolver")
        self._note(run=run, origin=origin, solver=solver, outdated=False, goes_on=goes_on)
        return run

    @contextlib.contextmanager
    def open_run(self, mbs: MainSystem, t: float, method: Method, joints: Joints | None = None) -> Iterator[ModelRun]:
        """Begin a run at time t [s]. The solver that Exudyn makes within the block belongs to this run.

        Parameters
        ----------
        mbs : exudyn.MainSystem
        t : float
        method : {"explicit", "implicit", "static"}
        joints : Joints, optional
            Joints that explicit steps close together with the contacts.
        """
        run = self.begin(mbs, t, method, joints)
        self._note(solver_comes=True)
        try:
            yield run
        finally:
            self._note(solver_comes=False)
            if run.unsampled:
                self._note(solver=mbs.sys.get("dynamicSolver"))
            run.release()

    @contextlib.contextmanager
    def linearise_aside(self, mbs: MainSystem) -> Iterator[ModelRun]:
        """A static run at the initial state that makes no step; after it, the run before is the present one again.

        The stiffness of its contacts is that by turns, as mass matrices are, since no solver adds to rotation vectors.
        """
        before, t = self._present, mbs.systemData.GetTime(require("exudyn").ConfigurationType.Initial)
        try:
            with self.open_run(mbs, float(t), "static") as run:
                run.vectors = ()
                yield run
        finally:
            self._present = before

    @contextlib.contextmanager
    def go_on_from(self, mbs: MainSystem, end: RunState | None) -> Iterator[None]:
        """Let a run within the block go on from the end of an earlier one, whatever their methods.

        The model's initial state must be that end only within the block. Runs from its own initial state later go on
        from the same run as before the block.
        """
        initial = mbs.systemData.GetODE2Coordinates(require("exudyn").ConfigurationType.Initial)
        ends = (end for end in self._ends() if end is not None)
        origin = next((end for end in ends if end.has_steps and end.ended_in(initial)), None)
        self._note(given=(end,))
        try:
            yield
        finally:
            self._note(given=None, origin=origin)

    @contextlib.contextmanager
    def undo_if_refused(self) -> Iterator[None]:
        """Forget what begins within the block if it raises an error: such a run was not made."""
        before = self._present
        try:
            yield
        except BaseException:
            self._present = before
            raise

    def at_work(self, contact: ModelContact) -> ContactRun:
        """State of a contact in the present run."""
        assert self._present.run is not None
        return self._present.run.contact_run(contact)

    def before_step(self, mbs: MainSystem, t: float) -> None:
        """Apply multipliers of contacts ahead of the step that ends at t. With joints, `solve_dynamic` does it."""
        run = self.now(mbs)
        run.keep_last_step(mbs, t)
        run.before_step(mbs, t, joined=False)

    def last(self, mbs: MainSystem) -> ModelRun | None:
        """The last run; None if Exudyn has run the model since, without contacts."""
        return self._present.run if mbs.sys.get("dynamicSolver") is self._present.solver else None

    def end(self, mbs: MainSystem, *, stopped: bool = False) -> None:
        """Record that the present run ended in the model's present state: without contacts no sensor records it.

        `stopped` is whether this is the start of a step that an error has stopped, see `ModelRun.at_start_of_step`.
        """
        run = self._present.run
        if run is not None:
            if stopped:
                run.at_start_of_step(mbs)
            run.ended = float(mbs.systemData.GetTime()), mbs.systemData.GetODE2Coordinates()

    def _ends(self) -> tuple[RunState | None, RunState | None]:
        """Ends from which a run may go on: that of the last run, and that from which it went on itself."""
        run, origin = self._present.run, self._present.origin
        return None if run is None else run.state(), origin

    def end_state(self, mbs: MainSystem) -> RunState | None:
        """State of the contacts at the end of the last run; None if there was none with contacts."""
        run = self.last(mbs)
        return None if run is None else run.state()

    def is_whole(self, mbs: MainSystem) -> bool:
        """Whether the last run ended with a step that was made whole, so that another one can go on from there."""
        run, t = self.last(mbs), float(mbs.systemData.GetTime())
        if run is None or run.unsampled or run.ended is None:
            return run is None or not run.broken
        return not run.broken and abs(run.ended[0] - t) <= _ROUND_OFF * abs(t)


def runs_of(mbs: MainSystem) -> Runs:
    """The runs of a model."""
    runs: Runs | None = mbs.sys.get(RUNS)
    if runs is None:
        runs = mbs.sys[RUNS] = Runs()
    return runs
