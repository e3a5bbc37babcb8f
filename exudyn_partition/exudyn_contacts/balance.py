"""Balance of energy of a run: energy of bodies and contacts, energy taken from them, and energy given to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..exudyn_bodies.damping_work import has_all_steps
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_bodies.user_functions import RIGID
from ..support.arrays import Array
from .contact_replay import viscous_work
from .partition_contact import PartitionContact
from .run_result import RunResult

DAMPING, FRICTION, FLOW = "damping", "friction", "plastic flow"
STEPS = "the damping of the steps"


@dataclass(frozen=True, eq=False)
class Balance:
    """Energies of partition bodies and contacts at the times of a run, (n,) arrays [J].

    Parameters
    ----------
    bodies, contacts : (n,) arrays
        Kinetic and strain energy of the bodies, and energy that contacts store.
    taken : dict of str to (n,) array
        Energy taken so far, by the name of the cause; empty if nothing took any.
    given : dict of str to (n,) array
        Work of gravity, and of joints, springs and loads that a `CreateWorkSensor` measures, by their names.
    """

    bodies: Array
    contacts: Array
    taken: dict[str, Array]
    given: dict[str, Array]

    @classmethod
    def of_run(cls, result: RunResult, samples: Array | None = None) -> Balance:
        """Balance of a run with at least one partition body, at all samples or at some, (m,) int array."""
        chosen = np.arange(len(result.t)) if samples is None else samples
        some = result if samples is None else result.at(result.t[samples])
        return cls(
            bodies=np.sum([item.energy(some) for item in result.bodies], axis=0),
            contacts=np.sum([np.zeros(len(chosen)), *(c.energy(some) for c in result.contacts)], axis=0),
            taken={what: work[chosen] for what, work in taken(result).items()},
            given={what: work[chosen] for what, work in given(result).items()},
        )

    @property
    def total(self) -> Array:
        """Energy of bodies and contacts."""
        return self.bodies + self.contacts

    @property
    def with_taken(self) -> Array:
        """Sum of the energy of bodies and contacts and of the energy taken from them."""
        value: Array = np.sum([self.total, *self.taken.values()], axis=0)
        return value

    @property
    def rest(self) -> Array:
        """Energy without a known cause, (n,): work that no sensor measures, or the error of the steps."""
        whole = self.with_taken
        value: Array = whole - whole[0] - np.sum([np.zeros(len(whole)), *self.given.values()], axis=0)
        return value


def taken_by(
    bodies: Sequence[PartitionBody], contacts: Sequence[PartitionContact], result: RunResult
) -> dict[str, Array]:
    """Energy taken from bodies and contacts so far, (n,) [J], by the name of the cause; empty if nothing took any."""
    works_by_cause = {
        DAMPING: [
            *(body.dissipated_energy(result) for body in bodies if result.dampings_of(body)),
            *(viscous_work(contact, result) for contact in contacts if contact.mechanics.damped),
        ],
        FRICTION: [contact.friction.work(result) for contact in contacts if contact.friction],
        FLOW: [contact.plastic.work(result) for contact in contacts if contact.plastic],
    }
    return {what: np.sum(works, axis=0) for what, works in works_by_cause.items() if works and np.any(works)}


def taken(result: RunResult) -> dict[str, Array]:
    """Energy taken from bodies and contacts so far, and by damping of the steps, (n,) [J], by the name of the cause."""
    return taken_by(result.bodies, result.contacts, result) | taken_by_steps(result)


def taken_by_steps(result: RunResult) -> dict[str, Array]:
    """Energy that implicit steps with damping took from the bodies. It is known only if each step has a sample."""
    if result.newmark is None or not result.newmark.damps or not has_all_steps(result):
        return {}
    works = []
    for item in result.bodies:
        q = item.coordinates(result)
        if not item.kinematics.linear:  # angular velocities are no rates of rotation vectors
            q = np.concatenate([q[:, :3], np.full((len(q), 3), np.nan), q[:, RIGID:]], axis=1)
        works.append(result.newmark.taken(result.t, q, item.coordinates_t(result), item.kinematics.mass))
    return {STEPS: np.sum(works, axis=0)}


def given(result: RunResult) -> dict[str, Array]:
    """Work of gravity, and of each joint, spring and load if the model has a sensor of their work; (n,) [J]."""
    if result.item_work is not None and result.method != "static":
        return result.item_work.work(result)
    works = {}
    for i, item in enumerate(result.bodies):
        if item.weight is not None:
            q = item.coordinates(result)
            works[f"gravity on {item.name or f'body {i}'}"] = (q - q[0]) @ item.weight
    return works


def doubt(result: RunResult) -> Array:
    """Bound on the error of the trapezoidal rule in the terms that are integrated over samples, (n,) [J]."""
    value = np.zeros(len(result.t))
    integrated = [item.dissipated_energy(result) for item in result.bodies if result.dampings_of(item)]
    if result.item_work is not None:
        integrated += [*result.item_work.work(result).values()]
    for work in integrated:
        bends = np.diff(work, n=3)  # the rule's error in an interval is a twelfth of the power's second difference
        value += np.r_[0.0, np.cumsum(abs(np.r_[bends[:1], bends, bends[-1:]]))][: len(value)] / 12
    return value
