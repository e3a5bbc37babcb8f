"""The run of a model: the state of all its contacts, made anew for each run, and noticed where a run begins."""

from __future__ import annotations

import contextlib
import logging
import math
import time
from collections.abc import Iterator, Sequence

from ..contact.formulations.formulation import Method
from ..exudyn_bodies.joints import Joints
from ..exudyn_bodies.model import registered, runs_implicit
from ..support.arrays import Array
from ..support.foreign import MainSolver, MainSystem
from .central_differences import MultiplierStep
from .contact_results import ContactResults
from .contact_run import ContactRun
from .run_record import RunRecord, sensors_keep_all

_log = logging.getLogger(__name__)

RUNS = "exudynPartitionRun"  # key in mbs.sys


class ModelRun:
    """State of a model's contacts in one run.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        Assembled.
    contacts : sequence of ContactResults
        The model's.
    t : float
        When the run begins [s].
    method : {"explicit", "implicit", "static"}
    joints : Joints, optional
        Of the model, that explicit steps close together with the contacts.
    keep : bool
        Whether the ends of steps are kept, beside Exudyn's sensors.

    Attributes
    ----------
    record : RunRecord
    contact_s : float
        Time in contacts so far [s].
    """

    def __init__(
        self,
        mbs: MainSystem,
        contacts: Sequence[ContactResults],
        t: float,
        method: Method,
        joints: Joints | None,
        keep: bool,
    ) -> None:
        self._contacts, self.contact_s = [*contacts], 0.0
        self._runs = {
            id(contact): ContactRun(contact.name, contact.law.for_run(method), contact.slices(mbs), t)
            for contact in contacts
        }
        self.record = RunRecord(self._recorded, t, keep)
        self._steppers: list[MultiplierStep] = []
        for group in {id(contact.group): contact.group for contact in contacts}.values():
            members = [self._runs[id(contact)] for contact in group]
            if group[0].together is not None:
                together = group[0].together.for_run([member.law for member in members])
                for place, member in enumerate(members):
                    member.together, member.place = together, place
            if joints is None and members[0].law.ahead:
                self._steppers.append(MultiplierStep(members))
        if joints is not None:
            ahead = [run for run in self._runs.values() if run.law.ahead]
            for run in ahead:
                run.joined = True
            self._steppers.append(MultiplierStep(ahead, joints))

    @property
    def active_set_iterations(self) -> int:
        """Iterations of all contacts' active sets so far."""
        return sum(run.law.iterations for run in self._runs.values()) + sum(s.iterations for s in self._steppers)

    @property
    def pair_searches(self) -> int:
        """Searches of the pairs of all points so far."""
        return sum(run.law.searches for run in self._runs.values())

    def of(self, contact: ContactResults) -> ContactRun:
        """State of a contact."""
        return self._runs[id(contact)]

    def knows(self, contact: ContactResults) -> bool:
        """Whether the contact was in the model when the run began."""
        return id(contact) in self._runs

    def _recorded(self, t: float, q: Array) -> dict[int, list[float]]:
        """Values of the contacts' sensors at t, by their numbers, with the model's coordinates q there."""
        found: dict[int, list[float]] = {}
        for contact in self._contacts:
            run = self.of(contact)
            found[int(contact["sForce"])] = run.values(t, q)
            if contact.moment_about is not None:
                found[int(contact["sMoment"])] = run.law.moment(contact.moment_about).tolist()
        return found

    def before_step(self, mbs: MainSystem, t: float, *, joined: bool) -> None:
        """Apply multipliers ahead of the explicit step that ends at t: of contacts alone, or those joined with joints.

        Each is applied once a step, however often it is asked for.
        """
        begin = time.perf_counter()
        for stepper in self._steppers:
            if (stepper.joints is not None) == joined:
                stepper.before_step(mbs, t)
        self.contact_s += time.perf_counter() - begin

    def after_step(self, mbs: MainSystem, t: float) -> None:
        """Make velocities obey the joints at the end of a step."""
        for stepper in self._steppers:
            stepper.after_step(mbs, t)

    def forget_joints(self) -> None:
        """End what is done around steps: joints know the model, which results must not hold."""
        self._steppers = [stepper for stepper in self._steppers if stepper.joints is None]

    def force_together(self, mbs: MainSystem, run: ContactRun) -> Array:
        """Generalised force of a contact, (n,), found together with those of the contacts that it is coupled with."""
        together, data = run.together, mbs.systemData.GetODE2Coordinates(copy=False)
        assert together is not None
        return together.forces_at(data, lambda: [other.of(data) for other in self._coupled_with(run)])[run.place]

    def _coupled_with(self, run: ContactRun) -> list[ContactRun]:
        """Contacts that are found together with one, itself included, in the order of their places."""
        members = [other for other in self._runs.values() if other.together is run.together]
        return sorted(members, key=lambda member: member.place)


class Runs:
    """Where the user functions of a model find the run at work, and the last one after it.

    Attributes
    ----------
    joints : Joints or None
        What the next runs close together with the contacts.
    """

    def __init__(self) -> None:
        self.joints: Joints | None = None
        self._left_to_sensors = False
        self._now: ModelRun | None = None
        self._solver: MainSolver = None
        self._latest = -math.inf

    def now(self, mbs: MainSystem, contact: ContactResults | None = None) -> ModelRun:
        """The run at work; one that begins now if there was none, or if it does not know the contact."""
        run = self._now
        if run is None or (contact is not None and not run.knows(contact)):
            run = self.begin(mbs, float(mbs.systemData.GetTime()))
        return run

    def advanced(self, mbs: MainSystem, t: float, contact: ContactResults) -> ModelRun:
        """The run at work, once the end of the last step is kept; to be asked before contacts are evaluated at t."""
        run = self.now(mbs, contact)
        if run.record.on:
            run.record.advance(mbs, t)
        return run

    def see(self, mbs: MainSystem, t: float) -> ModelRun:
        """Notice a new run: its sensors are read at its start, before anything else is."""
        if self._now is None or mbs.sys.get("dynamicSolver") is not self._solver or t < self._latest:
            self.begin(mbs, t)
        self._latest = t
        return self.now(mbs)

    def begin(self, mbs: MainSystem, t: float, method: Method | None = None) -> ModelRun:
        """Begin a run at time t [s]; its method is that of the solver at work, if it is not given."""
        self._solver, self._latest = mbs.sys.get("dynamicSolver"), t
        keep = not self._left_to_sensors and not sensors_keep_all(mbs)
        method = method or ("implicit" if runs_implicit(mbs) else "explicit")
        contacts: list[ContactResults] = [*registered(mbs).contacts.values()]
        _log.debug("a run of %s contacts begins at %.6g s, %s", len(contacts), t, method)
        self._now = ModelRun(mbs, contacts, t, method, self.joints, keep)
        return self._now

    def at_work(self, contact: ContactResults) -> ContactRun:
        """State of a contact that has been evaluated before, in the run at work."""
        assert self._now is not None
        return self._now.of(contact)

    def before_step(self, mbs: MainSystem, t: float) -> None:
        """Apply multipliers of contacts ahead of the explicit step that ends at t; `solve_dynamic` does with joints."""
        run = self.now(mbs)
        if run.record.on:
            run.record.advance(mbs, t)
        run.before_step(mbs, t, joined=False)

    def last(self, mbs: MainSystem) -> ModelRun | None:
        """The last run; None if that was without contacts, after a Reset."""
        return self._now if mbs.sys.get("dynamicSolver") is self._solver else None

    @contextlib.contextmanager
    def sensors_alone(self) -> Iterator[None]:
        """Keep nothing beside Exudyn's sensors, whose period the user chose."""
        self._left_to_sensors = True
        try:
            yield
        finally:
            self._left_to_sensors = False

    @contextlib.contextmanager
    def closing(self, joints: Joints) -> Iterator[None]:
        """Close joints together with the contacts, in the runs that begin meanwhile."""
        self.joints = joints
        try:
            yield
        finally:
            self.joints = None
            if self._now is not None:
                self._now.forget_joints()


def runs_of(mbs: MainSystem) -> Runs:
    """The runs of a model."""
    runs: Runs = mbs.sys.setdefault(RUNS, Runs())
    return runs
