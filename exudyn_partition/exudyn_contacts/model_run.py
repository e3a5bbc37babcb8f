"""The run of a model: the state of all its contacts. Each run has its own. See `contact_run` for one contact."""

from __future__ import annotations

import contextlib
import logging
import math
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from ..contact.formulations.formulation import Method
from ..contact.patch_contact import PatchContact
from ..errors import ComplementarityError, RunError
from ..exudyn_bodies.item_work import acts_on_constant_mass
from ..exudyn_bodies.joints import Joints
from ..exudyn_bodies.model import coordinate_slices, latest_solver, method_of, registered
from ..exudyn_bodies.other_bodies import OtherBodies
from ..frames.floating import FloatingKinematics
from ..support.arrays import Array, as_slice
from ..support.foreign import MainSolver, MainSystem
from ..support.optional import require
from .central_differences import MultiplierStep
from .contact_run import ContactRun, GroupRun
from .contact_samples import ModelContact
from .run_record import RunRecord, sensors_keep_all
from .run_state import RunState
from .slip_secants import SlipSecants

_log = logging.getLogger(__name__)

RUNS = "exudynPartitionRun"  # key in mbs.sys
_ROUND_OFF = 1e-12  # relative difference of times that are the same
_NO_MORE = 2**30  # more iterations than Newton's method may make


class ModelRun:
    """State of a model's contacts in one run.

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

    Attributes
    ----------
    contacts : list of PartitionContact
    record : RunRecord
    dofs : (n,) int array
        Numbers of the coordinates on which contacts may act, in the order of Exudyn's object of contacts.
    of_object : slice or (n,) int array
        The same places, as a slice if that can be.
    method : {"explicit", "implicit", "static"}
    at : float
        Time at which contacts were evaluated last [s].
    ended : (float, (nq,) array) or None
        Time [s] and coordinates of the model at the end of the run, or when the sensors were last read.
    acts_within : bool
        Whether contacts have forces within steps; multipliers ahead of steps do not count.
    idle : bool
        Whether there is nothing to do ahead of steps.
    others : OtherBodies
        Record of where Exudyn's own bodies are, for pictures.
    unsampled : bool
        Whether the model has no contact whose sensor would keep this record.
    slip_secants : SlipSecants or None
        Adds to the Jacobian, if a static run needs it.
    divides : bool
        Whether the static solver repeats a load step with a shorter length where contact forces do not settle.
    solver : exudyn.MainSolver or None
        Exudyn's solver that makes the run, if the run was not begun for one that comes.
    unsettled : ComplementarityError or None
        Why contact forces did not settle in the present try of a load step.
    broken : bool
        Whether an error stopped the run in a step to whose start its multipliers cannot return.
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
    ) -> None:
        self.contacts, self._spent_s, self._began = [*contacts], 0.0, t
        self.method, self.at = method, t
        self.ended: tuple[float, Array] | None = None
        self.broken = False
        items = [*{id(item): item for contact in contacts for item, _ in contact.sides}.values()]
        for item in items:
            if isinstance(item.kinematics, FloatingKinematics):
                acts_on_constant_mass(mbs, item, item.kinematics.acting)
        self._floating = [
            (as_slice(np.concatenate([np.r_[s] for s in coordinate_slices(mbs, item)])), item.kinematics)
            for item in items
            if isinstance(item.kinematics, FloatingKinematics)
        ]
        self._turning = np.empty(0) if state is None else state.turning
        self._grow()
        self._runs: dict[int, ContactRun] = {}
        for contact in contacts:
            mechanics, place = contact.mechanics.for_run(method), _place_of_values(mbs, contact)
            self._runs[id(contact)] = run = ContactRun(contact.name, mechanics, contact.slices(mbs), t, method, place)
            last = None if state is None else state.find(_number(contact))
            if last is not None:
                run.begin(last, t)
        self._all_ask = all(run.place is None for run in self._runs.values())
        self.record = RunRecord(t, keep)
        self.slip_secants: SlipSecants | None = None
        self.divides = self._released = False
        self.solver: MainSolver | None = None
        self.unsettled: ComplementarityError | None = None
        carriers = [contact.carrier.body for contact in contacts if contact.carrier is not None]
        self.others, self.unsampled = OtherBodies(mbs, map(int, carriers)), not contacts
        self._steppers: list[MultiplierStep] = []
        self._groups: list[GroupRun] = []
        for group in {id(contact.group): contact.group for contact in contacts}.values():
            members = [self._runs[id(contact)] for contact in group]
            together = None
            if group[0].together is not None:
                together = group[0].together.for_run([member.mechanics for member in members])
            self._groups.append(GroupRun(members, together))
            if joints is None and members[0].forward is not None:
                self._steppers.append(MultiplierStep(members))
        self._openings: list[tuple[PatchContact, float]] | None = None  # at the start of a static run
        self._within = [group for group in self._groups if group.acts_within]
        self.acts_within = bool(self._within)
        if joints is not None:
            ahead = [run for run in self._runs.values() if run.forward is not None]
            for run in ahead:
                run.joined = True
            self._steppers.append(MultiplierStep(ahead, joints))
        self.idle = not self._steppers
        self._served = {self._served_by(stepper): stepper for stepper in self._steppers}
        for served in () if state is None else state.steppers:
            if (key := (served.joints is not None, served.numbers)) in self._served:
                self._served[key].begin(served, t)
        dofs = mbs.systemData.GetObjectLTGODE2(contacts[0]["oContact"]) if contacts else []
        self.dofs, self._total = np.array(dofs, dtype=int), np.zeros(mbs.systemData.ODE2Size())
        self.of_object = as_slice(self.dofs)

    def _served_by(self, stepper: MultiplierStep) -> tuple[bool, tuple[int, ...]]:
        """Whether the stepper closes joints, and the numbers of its contacts."""
        numbers = {id(self.of(contact)): _number(contact) for contact in self.contacts}
        return stepper.joints is not None, tuple(numbers[id(run)] for run in stepper.contacts)

    def state(self) -> RunState | None:
        """State at the end of the run; None if it has none. Contacts that stopped within a step have no state."""
        if self.ended is None:
            return None
        t, q = self.ended
        whole = not self.broken and abs(self.at - t) <= _ROUND_OFF * abs(t)
        contacts = tuple(self.of(contact).state(_number(contact)) for contact in self.contacts if whole)
        steppers = tuple(stepper.state(numbers) for (_, numbers), stepper in self._served.items() if whole)
        return RunState(self.method, t, self.at, q, self.has_steps, self.broken, contacts, steppers, self._turning)

    @property
    def contact_s(self) -> float:
        """Time in contacts so far [s]."""
        return self._spent_s

    @property
    def active_set_iterations(self) -> int:
        """Iterations of all contacts' active sets so far."""
        by_laws = sum(run.iterations for run in self._runs.values())
        return by_laws + sum(stepper.iterations for stepper in self._steppers)

    @property
    def pair_searches(self) -> int:
        """Searches of the pairs of all points so far."""
        return sum(run.mechanics.searches for run in self._runs.values())

    def of(self, contact: ModelContact) -> ContactRun:
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

    def find(self, contact: ModelContact) -> ContactRun | None:
        """State of a contact; None if it was not in the model when the run began."""
        return self._runs.get(id(contact))

    def resume(self, initial: Array, earlier: Sequence[RunState], t: float, *, goes_on: bool) -> RunState | None:
        """Let contacts go on from the end of earlier runs with another method or time, if that is the initial state.

        `initial`, (nq,), are the model's initial coordinates. Return the first end from which a contact goes on. The
        energies that contacts have taken go on too if the user said so by `goes_on`, or if that run ended at time t.
        """
        found = None
        for contact in self.contacts:
            run = self.of(contact)
            mechanics = run.mechanics
            for end in earlier:
                last = end.find(_number(contact))
                if last is None or not np.array_equal(run.of(end.q), run.of(initial)):
                    continue
                counts = end.ended_in(initial) and (goes_on or (end.has_steps and end.ended_when(t)))
                closed = bool(mechanics.gaps.overlap) and end.has_steps and end.ended_in(initial)  # by load steps
                if counts or mechanics.remembers or closed:
                    opening, moves = mechanics.opening, end.method != "static"
                    run.begin_contact(last.for_other_run(counts=counts, moves=moves, sticks=not mechanics.ahead), t)
                    mechanics.opening = min(opening, last.contact.opening) if closed else opening
                    found = found or end
                    break
        return found

    @property
    def has_steps(self) -> bool:
        """Whether the run has made steps."""
        return self.ended is not None and self.ended[0] > self._began

    def ended_in(self, q: Array) -> bool:
        """Whether the run ended at the model's coordinates q, (nq,), at any time."""
        return self.ended is not None and np.array_equal(self.ended[1], q)

    def step_back(self, mbs: MainSystem) -> None:
        """Return to the start of the step in which an error stopped the run; the model is there again.

        Forces within steps are found again from the memory of the last step that was made. Multipliers that were
        applied in this step cannot be taken back: then the run is `broken`.
        """
        t, q = float(mbs.systemData.GetTime()), mbs.systemData.GetODE2Coordinates()
        if self.method == "static" and t > self._began:
            self._press(mbs, t)
        within = [group.step_back(mbs, t, q) for group in self._within]
        ahead = [stepper.step_back(t) for stepper in self._served.values()]  # with those of joints
        self.broken, self.at = not all(within + ahead), t
        self.publish(mbs)

    def force(self, mbs: MainSystem, t: float) -> Array | None:
        """Generalised forces of all contacts within a step, (nq,), in the model's present state at t [s].

        None if there are none. The next call writes to the same array. Before, the record keeps the last step's end.
        """
        begin = time.perf_counter()
        if self.record.on:
            self.keep_last_step(mbs, t)
        self.at, total = t, None
        q = mbs.systemData.GetODE2Coordinates(copy=False)
        self._turn(mbs)
        if self.method == "static" and t > self._began:
            self._press(mbs, t)
        for group in self._within:
            group.evaluate(mbs, t, q)
            if group.pushes:
                if total is None:
                    total = self._total
                    total.fill(0.0)
                group.add_force(total)
        if not self._all_ask:
            self.publish(mbs)
        if total is not None and self._floating:
            for own, kinematics in self._floating:
                pushed = total[own]
                if pushed.any():
                    total[own] = kinematics.on_constant_mass(q[own], pushed)
        self._spent_s += time.perf_counter() - begin
        return total

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
        """Let the growth of bodies in floating frames follow their rotation."""
        if self._floating and self.method != "static":
            self._turning = mbs.systemData.GetODE2Coordinates_t()
            self._grow()

    def _grow(self) -> None:
        for own, kinematics in self._floating if len(self._turning) else ():
            kinematics.turn(self._turning[own])

    def _press(self, mbs: MainSystem, t: float) -> None:
        """Close overlaps that are meant, in proportion to the static time t."""
        if self._openings is None:
            pressed = [run.mechanics for run in self._runs.values() if run.mechanics.opening]
            self._openings = [(mechanics, mechanics.opening) for mechanics in pressed]
        if self._openings:
            solver = mbs.sys["staticSolver"].it
            left = (solver.endTime - t) / (solver.endTime - solver.startTime)
            for mechanics, opening in self._openings:
                mechanics.opening = opening * min(left, 1.0) if left > _ROUND_OFF else 0.0

    def publish(self, mbs: MainSystem) -> None:
        """Write the values of sensors `sForce` to the data that they read, in the state that was evaluated last."""
        data = mbs.systemData.GetDataCoordinates(copy=False)
        for group in self._groups:
            group.publish(data)

    def keep(self, t: float, q: Callable[[], Array]) -> None:
        """Keep the data that results need of the state at t; `q` returns the model's coordinates at t."""
        with np.errstate(over="ignore"):  # of energies in the last steps of an unstable run
            for group in self._groups:
                group.keep(t, q)

    def keep_last_step(self, mbs: MainSystem, t: float) -> None:
        """Keep the end of the last step in the record, before contacts are evaluated at time t [s]."""
        if self.record.on:
            self.record.advance(mbs, t, partial(self._recorded, mbs))

    def _recorded(self, mbs: MainSystem, t: float, q: Array) -> dict[int, list[float]]:
        """Values of the contacts' sensors at the start of the step, t, and coordinates q; keys are their numbers."""
        self.keep(t, lambda: q)
        if self.others:
            self.others.keep(mbs, t, start_of_step=True)
        found: dict[int, list[float]] = {}
        for contact in self.contacts:
            run = self.of(contact)
            found[int(contact["sForce"])] = run.force_values()
            if "sFriction" in contact:
                found[int(contact["sFriction"])] = run.friction_values()
            if "sPlastic" in contact:
                found[int(contact["sPlastic"])] = run.plastic_values()
            if contact.moment_about is not None:
                found[int(contact["sMoment"])] = run.mechanics.moment(contact.moment_about).tolist()
        return found

    def before_step(self, mbs: MainSystem, t: float, *, joined: bool) -> None:
        """Apply multipliers ahead of the explicit step that ends at t.

        With `joined`, these are the multipliers of joints and contacts together; otherwise those of contacts alone.
        A second call for the same step does nothing.
        """
        begin, self.at = time.perf_counter(), t
        self._turn(mbs)
        for stepper in self._steppers:
            if (stepper.joints is not None) == joined:
                stepper.before_step(mbs, t)
        self._spent_s += time.perf_counter() - begin

    def look_ahead(self, mbs: MainSystem, t: float) -> None:
        """Apply multipliers of contacts in the explicit step that begins at t; a second call does nothing."""
        begin = time.perf_counter()
        self._turn(mbs)
        for stepper in self._steppers:
            stepper.look_ahead(mbs, t)
        self._spent_s += time.perf_counter() - begin

    def after_step(self, mbs: MainSystem, t: float) -> None:
        """Correct velocities for the joints at the end of a step."""
        for stepper in self._steppers if t > self._began else ():
            stepper.after_step(mbs, t)

    @property
    def over(self) -> bool:
        """Whether the run has ended: who asks for a stiffness linearises about a state."""
        return self._released or (self.solver is not None and bool(self.solver.output.finishedSuccessfully))

    def release(self) -> None:
        """Drop the data that only the run needed. Results keep contacts and samples; joints would keep the model."""
        self._released, self.solver = True, None
        for _, kinematics in self._floating:
            kinematics.turn(None)
        for group in self._groups:
            group.end()
        jointed = [stepper for stepper in self._steppers if stepper.joints is not None]
        self._steppers = [stepper for stepper in self._steppers if stepper.joints is None]
        for stepper in jointed:
            stepper.joints = None


class Runs:
    """The present run of a model, or the last one when it has ended. User functions find their state here."""

    def __init__(self) -> None:
        self._now: ModelRun | None = None
        self._origin: RunState | None = None  # end from which the present run goes on
        self._solver: MainSolver = None
        self._solver_comes = self._outdated = False
        self._latest, self._goes_on = -math.inf, False
        self._given: tuple[RunState | None] | None = None  # end from which a run goes on by its user's choice

    def now(self, mbs: MainSystem) -> ModelRun:
        """The present run, which evaluates contacts. If there is none, or contacts were added, a run begins."""
        if self._now is None or self._outdated:
            return self.begin(mbs, float(mbs.systemData.GetTime()))
        return self._now

    def add_contact(self) -> None:
        """Record that the model has another contact: a new run must begin before contacts are evaluated again."""
        self._outdated = True

    def sample(self, mbs: MainSystem, t: float) -> ModelRun:
        """The run whose sensors are read at time t; all contacts keep their data of that time.

        Exudyn's first act in a run is to read the sensors. The run begins here, unless `begun` has begun it. The sensor
        of the first contact calls this method. The values that other sensors read are those of the last evaluation.
        They are written again in two cases: if multipliers are applied ahead of steps, and at the start, because Exudyn
        has then reset them to their initial values.
        """
        now = self._now
        first = self.last(mbs) is None or t < self._latest or self._outdated or self._solver_comes
        if now is None or (first and not self._solver_comes):
            now = self.begin(mbs, t)
        if first or not now.idle:
            now.publish(mbs)
        self._solver, self._solver_comes, self._latest = mbs.sys.get("dynamicSolver"), False, t
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
        self._solver, self._latest, self._outdated = mbs.sys.get("dynamicSolver"), t, False
        keep, solver = method is None and not sensors_keep_all(mbs), None
        if method is None:
            solver = latest_solver(mbs)
            method = "explicit" if solver is None else method_of(solver)
        contacts: list[ModelContact] = [*registered(mbs).contacts.values()]
        _log.debug("a run of %s contacts begins at %.6g s, %s", len(contacts), t, method)
        initial = mbs.systemData.GetODE2Coordinates(require("exudyn").ConfigurationType.Initial)
        ends = self._ends() if self._given is None else self._given
        earlier = [end for end in ends if end is not None]
        if self._now is not None and self._now.has_steps:  # otherwise a run begins again before its first step
            self._goes_on = any(end.ended_in(initial) for end in earlier)
        same = next((end for end in earlier if end.ended_at(t, method, initial)), None)
        if self._now is not None:
            self._now.release()
        self._now = ModelRun(mbs, contacts, t, method, joints, keep, same)
        if solver is not None and not solver.output.finishedSuccessfully:  # one that has finished made an earlier run
            self._now.solver = solver
        for contact in contacts:
            self._now.of(contact).goes_on = self._goes_on
        resumed = same or self._now.resume(initial, earlier, t, goes_on=self._given is not None)
        # Later runs from the same initial state go on from the same run, also if its contacts remember nothing.
        self._origin = next((end for end in earlier if end.has_steps and end.ended_in(initial)), resumed)
        return self._now

    @contextlib.contextmanager
    def begun(self, mbs: MainSystem, t: float, method: Method, joints: Joints | None = None) -> Iterator[ModelRun]:
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
        self._solver_comes = True
        try:
            yield run
        finally:
            self._solver_comes = False
            if run.unsampled:
                self._solver = mbs.sys.get("dynamicSolver")
            run.release()

    @contextlib.contextmanager
    def aside(self, mbs: MainSystem) -> Iterator[ModelRun]:
        """A static run at the initial state that makes no step; after it, the run before is the present one again."""
        kept, t = {**vars(self)}, mbs.systemData.GetTime(require("exudyn").ConfigurationType.Initial)
        try:
            with self.begun(mbs, float(t), "static") as run:
                yield run
        finally:
            vars(self).update(kept)

    @contextlib.contextmanager
    def going_on(self, mbs: MainSystem, end: RunState | None) -> Iterator[None]:
        """Let a run within the block go on from the end of an earlier one, whatever their methods.

        The model's initial state must be that end only within the block. Runs from its own initial state later go on
        from the same run as before the block.
        """
        initial = mbs.systemData.GetODE2Coordinates(require("exudyn").ConfigurationType.Initial)
        ends = (end for end in self._ends() if end is not None)
        origin = next((end for end in ends if end.has_steps and end.ended_in(initial)), None)
        self._given = (end,)
        try:
            yield
        finally:
            self._given, self._origin = None, origin

    @contextlib.contextmanager
    def unless_refused(self) -> Iterator[None]:
        """Forget what begins within the block if it raises an error: such a run was not made."""
        before = vars(self).copy()
        try:
            yield
        except BaseException:
            vars(self).update(before)
            raise

    def at_work(self, contact: ModelContact) -> ContactRun:
        """State of a contact in the present run."""
        assert self._now is not None
        return self._now.of(contact)

    def before_step(self, mbs: MainSystem, t: float) -> None:
        """Apply multipliers of contacts ahead of the step that ends at t. With joints, `solve_dynamic` does it."""
        run = self.now(mbs)
        run.keep_last_step(mbs, t)
        run.before_step(mbs, t, joined=False)

    def last(self, mbs: MainSystem) -> ModelRun | None:
        """The last run; None if Exudyn has run the model since, without contacts."""
        return self._now if mbs.sys.get("dynamicSolver") is self._solver else None

    def end(self, mbs: MainSystem, *, stopped: bool = False) -> None:
        """Record that the present run ended in the model's present state: without contacts no sensor records it.

        `stopped` is whether this state is the start of a step that an error has stopped, see `ModelRun.step_back`.
        """
        if self._now is not None:
            if stopped:
                self._now.step_back(mbs)
            self._now.ended = float(mbs.systemData.GetTime()), mbs.systemData.GetODE2Coordinates()

    def _ends(self) -> tuple[RunState | None, RunState | None]:
        """Ends from which a run may go on: that of the last run, and that from which it went on itself."""
        return None if self._now is None else self._now.state(), self._origin

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
    runs: Runs = mbs.sys.setdefault(RUNS, Runs())
    return runs


def _number(contact: ModelContact) -> int:
    """Number by which a contact is known in its model: that of its sensor `sForce`."""
    return int(contact["sForce"])


def _place_of_values(mbs: MainSystem, contact: ModelContact) -> int | None:
    """First of the data coordinates that `sForce` reads; None if the sensor calls the contact itself."""
    return int(mbs.systemData.GetNodeLTGData(contact["nGenericData"])[0]) if "nGenericData" in contact else None
