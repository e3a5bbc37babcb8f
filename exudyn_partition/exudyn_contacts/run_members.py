"""Who takes part in a run: contacts, the groups that find their forces, multipliers, and bodies in floating frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..contact.formulations.coupled import Coupled
from ..contact.formulations.formulation import Method
from ..contact.gaps import Gaps
from ..contact.stages import NOTHING
from ..exudyn_bodies.item_work import acts_on_constant_mass
from ..exudyn_bodies.joints import Joints
from ..exudyn_bodies.model import dofs_of
from ..frames.floating import FloatingKinematics
from ..support.arrays import Array, as_slice
from ..support.foreign import MainSystem
from ..support.optional import require
from .central_differences import MultiplierStep
from .contact_group import groups_of
from .contact_run import ContactRun
from .contact_samples import ModelContact
from .group_run import CoupledRun, GroupRun
from .run_state import RunState

Place = slice | Array  # of coordinates among the model's
Served = tuple[bool, tuple[int, ...]]  # whether multipliers close joints, and the numbers of their contacts


@dataclass(frozen=True, eq=False)
class RunMembers:
    """Members of a run. They are found at its start and stay the same, though each has a state of its own.

    Parameters
    ----------
    contacts : list of PartitionContact
    runs : tuple of ContactRun
        State of each contact.
    groups : tuple of GroupRun
        Contacts whose forces are found together.
    steppers : dict of (bool, tuple of int) to MultiplierStep
        Multipliers that act ahead of explicit steps. Keys say what they serve: whether they close joints, and the
        numbers of their contacts.
    floating : tuple of (slice or (n,) int array, FloatingKinematics)
        Bodies in floating frames, with the places of their coordinates.
    growing : tuple of (Gaps, tuple of int)
        Contacts with such bodies, and the numbers of these in `floating`; -1 for others.
    """

    contacts: list[ModelContact]
    runs: tuple[ContactRun, ...]
    groups: tuple[GroupRun, ...]
    steppers: dict[Served, MultiplierStep]
    floating: tuple[tuple[Place, FloatingKinematics], ...]
    growing: tuple[tuple[Gaps, tuple[int, ...]], ...]

    def grow(self, q_t: Array) -> None:
        """Let bodies in floating frames grow by their rotation at the model's velocities, (nq,), if there are any.

        All contacts that see a body see the same growth.
        """
        of_bodies = [kinematics.growing(q_t[place]) if len(q_t) else q_t for place, kinematics in self.floating]
        for gaps, numbers in self.growing:
            gaps.grow([NOTHING if number < 0 else of_bodies[number] for number in numbers])

    def group_of(self, run: ContactRun) -> GroupRun:
        """Group in which a contact is; it is in one."""
        return self._group_of[id(run)]

    @cached_property
    def _group_of(self) -> dict[int, GroupRun]:
        return {id(run): group for group in self.groups for run in group.members}

    @property
    def carriers(self) -> list[int]:
        """Numbers of the bodies of other kinds that carry rigid surfaces."""
        return [int(contact.carrier.body) for contact in self.contacts if contact.carrier is not None]

    @classmethod
    def at_start(
        cls,
        mbs: MainSystem,
        contacts: Sequence[ModelContact],
        t: float,
        method: Method,
        joints: Joints | None,
        state: RunState | None,
    ) -> RunMembers:
        """Members at the start of a run; see `ModelRun` for its parameters."""
        floating = tuple(_floating(mbs, contacts))
        runs = tuple(_contact_run(mbs, contact, t, method, state) for contact in contacts)
        groups = tuple(_groups(contacts, runs, method))
        numbers = {id(run): number_of(contact) for contact, run in zip(contacts, runs, strict=True)}
        steppers = {
            (stepper.joints is not None, tuple(numbers[id(run)] for run in stepper.contacts)): stepper
            for stepper in _steppers(groups, runs, joints)
        }
        for served in () if state is None else state.steppers:
            if (key := (served.joints is not None, served.numbers)) in steppers:
                steppers[key].begin(served, t)
        members = cls([*contacts], runs, groups, steppers, floating, tuple(_growing(contacts, runs, floating)))
        if state is None and method != "static":
            members._begin_grown(mbs.systemData.GetODE2Coordinates_t(require("exudyn").ConfigurationType.Initial))
        return members

    def _begin_grown(self, q_t: Array) -> None:
        """Let bodies be grown already where the run begins, so that rows do not slide by that in the first step."""
        self.grow(q_t)
        for gaps, _ in self.growing:
            gaps.begin_grown()


def number_of(contact: ModelContact) -> int:
    """Return the number by which a contact is known in its model: that of its sensor `sForce`."""
    return int(contact["sForce"])


def acted_on(mbs: MainSystem, contacts: Sequence[ModelContact]) -> Array:
    """Numbers of the coordinates on which contacts may act, (n,) int, in the order of Exudyn's object of contacts."""
    return np.array(mbs.systemData.GetObjectLTGODE2(contacts[0]["oContact"]) if contacts else [], dtype=int)


def _floating(mbs: MainSystem, contacts: Sequence[ModelContact]) -> Iterator[tuple[Place, FloatingKinematics]]:
    """Bodies of contacts in floating frames, with the places of their coordinates."""
    for item in {id(item): item for contact in contacts for item, _ in contact.sides}.values():
        kinematics = item.kinematics
        if isinstance(kinematics, FloatingKinematics):
            acts_on_constant_mass(mbs, item, kinematics.acting)
            yield as_slice(dofs_of(mbs, item)), kinematics


def _growing(
    contacts: Sequence[ModelContact], runs: Sequence[ContactRun], floating: Sequence[tuple[Place, FloatingKinematics]]
) -> Iterator[tuple[Gaps, tuple[int, ...]]]:
    """See `RunMembers`."""
    number = {id(kinematics): i for i, (_, kinematics) in enumerate(floating) if kinematics.spin is not None}
    for contact, run in zip(contacts, runs, strict=True):
        numbers = tuple(number.get(id(item.kinematics), -1) for item, _ in contact.sides)
        if max(numbers) >= 0:
            yield run.mechanics.gaps, numbers


def _contact_run(
    mbs: MainSystem, contact: ModelContact, t: float, method: Method, state: RunState | None
) -> ContactRun:
    """State of a contact at the start of a run at t [s]."""
    mechanics = contact.mechanics.for_run(method)
    places = (_place_of_values(mbs, contact, node) for node in ("nGenericData", "nFrictionData"))
    run = ContactRun(contact.name, mechanics, contact.slices(mbs), t, method, *places)
    last = None if state is None else state.find(number_of(contact))
    if last is not None:
        run.begin(last, t)
    return run


def _place_of_values(mbs: MainSystem, contact: ModelContact, node: str) -> int | None:
    """First of the data coordinates of a node, by its key, that a sensor reads; None if it calls the contact itself."""
    return int(mbs.systemData.GetNodeLTGData(contact[node])[0]) if node in contact else None


def _groups(contacts: Sequence[ModelContact], runs: Sequence[ContactRun], method: Method) -> Iterator[GroupRun]:
    """Contacts that are solved together, or each of the others alone."""
    run_of = {id(contact): run for contact, run in zip(contacts, runs, strict=True)}
    for group in groups_of(contacts):
        members = [run_of[id(contact)] for contact in group]
        together = group[0].together.for_run([member.mechanics for member in members])
        if isinstance(together, Coupled):
            yield CoupledRun(members, together, sleeps=method != "static")
        else:
            yield GroupRun(members, together)


def _steppers(groups: Sequence[GroupRun], runs: Sequence[ContactRun], joints: Joints | None) -> list[MultiplierStep]:
    """Multipliers ahead of steps: those of each group alone, or of all contacts together with the model's joints."""
    if joints is None:
        return [MultiplierStep(group.members) for group in groups if group.members[0].forward is not None]
    ahead = [run for run in runs if run.forward is not None]
    for run in ahead:
        run.joined = True
    return [MultiplierStep(ahead, joints)]
