"""Energy that long steps make or lose in contact: work of its forces against what it stores, rubs off and yields.

The work is summed within the steps, by the trapezoidal rule over the velocities with which the solver moves the bodies.
So samples may be further apart, and loads, springs and joints need not be known.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ..exudyn_contacts.model_run import runs_of
from ..exudyn_contacts.partition_contact import PartitionContact
from ..support.arrays import Array
from ..support.foreign import MainSystem


class _End(NamedTuple):
    """End of a step: generalised forces of all contacts, (nq,); velocities, (nq,); what contacts hold and took [J]."""

    force: Array
    q_t: Array
    energy: float


class ContactWork:
    """Work of the contacts in the steps of a run, against the energy that they hold and that they took.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    contacts : sequence of PartitionContact

    Attributes
    ----------
    made : float
        Energy for which nothing accounts, in the steps that count so far [J]; below zero if it was lost.
    """

    def __init__(self, mbs: MainSystem, contacts: Sequence[PartitionContact]) -> None:
        self._mbs, self._contacts, self.made = mbs, contacts, 0.0
        self._begin: _End | None = None
        self._end: _End | None = None  # of the last step, if the next one has not begun

    @classmethod
    def if_known(cls, mbs: MainSystem, contacts: Sequence[PartitionContact]) -> ContactWork | None:
        """The work of these contacts; None if not all of their work and energy is known.

        Carriers of rigid surfaces take work that their bodies give. Multipliers store nothing.
        """
        known = all(contact.carrier is None and not contact.mechanics.ahead for contact in contacts)
        return cls(mbs, contacts) if known and contacts else None

    def begin_step(self) -> None:
        """Begin a step whose work counts, in the model's present state; the step before has ended in this state."""
        self._begin, self._end = self._end or self._now(), None

    def end_step(self, step: float) -> None:
        """End a step [s] in the model's present state. Call it for every step; only steps that were begun count."""
        self._end = None
        if self._begin is None:
            return
        begin, end, self._begin = self._begin, self._now(), None
        self._end = end
        work = 0.25 * step * float((begin.force + end.force) @ (begin.q_t + end.q_t))
        self.made += end.energy - begin.energy + work

    def _now(self) -> _End:
        run = runs_of(self._mbs).now(self._mbs)
        energy = sum(run.contact_run(contact).energy for contact in self._contacts)
        return _End(run.contact_force(), self._mbs.systemData.GetODE2Coordinates_t(), energy)
