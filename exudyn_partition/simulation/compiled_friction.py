"""Contacts with friction of a compiled run: their records, and their state where Exudyn's model stands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..compiled.friction_plan import FrictionMemory, FrictionPlan
from ..compiled.moving import rows_of
from ..compiled.run import Histories
from ..compiled.start import Start
from ..contact.law import Forces
from ..contact.memory import RowMemory, by_nodes, normal_by_nodes
from ..contact.patch_gaps import PatchGaps
from ..contact.state import ContactState
from ..contact.tangential import TangentialRows
from ..exudyn_contacts.contact_run import ContactRun
from ..exudyn_contacts.group_run import GroupRun
from ..support.arrays import Array

_AT_ONCE = 1000  # samples whose rows are dense arrays


class FrictionGroups:
    """Contacts with friction of a run, and those that they move.

    Parameters
    ----------
    plan : FrictionPlan
    groups : sequence of GroupRun
        In the order of the plan.
    """

    def __init__(self, plan: FrictionPlan, groups: Sequence[GroupRun]) -> None:
        self._plan, self._groups = plan, groups
        self._members = [member for group in groups for member in group.members]

    def stand(self, state: Start, values: Array, stored: Array, t: float) -> None:
        """Let the contacts be where a run is at a time t [s].

        Parameters
        ----------
        state : Start
        values, stored : (n, 6), (n,) arrays
            Of the sensors of all contacts of the run, and their energies [J]; those with friction come last.
        t : float
        """
        memory, first = state.friction, len(stored) - len(self._members)
        assert memory is not None
        states = iter([
            self._state(j, member, memory, float(values[first + j, 5]), float(stored[first + j]), state)
            for j, member in enumerate(self._members)
        ])  # fmt: skip
        for group in self._groups:
            group.begin([next(states) for _ in group.members], t)

    def _state(
        self, j: int, member: ContactRun, memory: FrictionMemory, least_gap: float, stored: float, end: Start
    ) -> ContactState:
        """State of a contact at the end of a step."""
        mechanics = member.mechanics
        gaps, turning = mechanics.gaps, member.coordinates_in(end.v if end.turning is None else end.turning)
        parts = zip(gaps.sides, gaps.sides.split(turning), strict=True)
        gaps.grow([side.kinematics.growing(part) for side, part in parts])
        gaps.at(member.coordinates_in(end.q))
        return ContactState(
            mechanics.gaps.after(), self._memory(j, member, memory), mechanics.state.creep, opening=mechanics.opening,
            stored=stored, least_gap=least_gap, law=mechanics.state.law,
        )  # fmt: skip

    def _memory(self, j: int, member: ContactRun, memory: FrictionMemory) -> RowMemory:
        """What the rows of a contact remember, by the nodes of its patch."""
        rows, mechanics, some = member.mechanics.rows, member.mechanics, slice(*self._plan.rows.starts[j : j + 2])
        forces, n = memory.forces[some], len(mechanics.state.memory.path)
        if not isinstance(rows, TangentialRows):
            return mechanics.state.memory.with_forces(normal_by_nodes(rows_of(rows.gaps), forces[:, :1], n))
        slipped, speed, path = np.zeros(n, dtype=bool), np.zeros(n), mechanics.state.memory.path.copy()
        nodes = rows_of(rows.gaps)
        for at_nodes, on_rows in ((slipped, memory.slipped), (speed, memory.speed), (path, memory.path)):
            at_nodes[nodes] = on_rows[some]
        if rows.gaps.moving:  # in the body's axes
            on_nodes = np.zeros((n, 4))
            on_nodes[nodes, 0], on_nodes[nodes, 1:] = forces[:, 0], memory.tractions[some]
        else:
            on_nodes = by_nodes(rows, forces[:, 0], rows.tractions(forces), n)
        return RowMemory(on_nodes, slipped, speed, path, float(memory.dissipated[j]))

    def keep(self, made: Histories, t: Array) -> None:
        """Let contacts keep the forces on their rows at all samples, (n,) [s], and where they reached an edge."""
        assert made.lam is not None
        assert made.traction is not None
        assert made.status is not None
        assert made.end.friction is not None
        first, place = made.lam.shape[1] - self._plan.n_rows, made.values.shape[1] - len(self._members)
        for begin in range(0, len(t), _AT_ONCE):
            some = slice(begin, begin + _AT_ONCE)
            parts = made.lam[some, first:].toarray(), made.traction[some].toarray(), made.status[some].toarray()
            for j, member in enumerate(self._members):
                start, end = self._plan.rows.starts[j : j + 2]
                lam, traction, status = parts[0][:, start:end], parts[1][:, 3 * start : 3 * end], parts[2][:, start:end]
                traction = traction.reshape(*lam.shape, 3)
                for i in np.flatnonzero(status.any(axis=1)).tolist():
                    closed = np.flatnonzero(status[i])
                    tangential = (traction[i, closed], status[i, closed]) if self._plan.laws[j] is not None else None
                    kept = lam[i, closed], float(made.stored[begin + i, place + j]), tangential
                    self._keep_sample(member, float(t[begin + i]), made.q[begin + i], closed, *kept)
                    left = made.left.get(place + j)
                    if left is not None and (made.q[begin + i] == left).all():
                        self._look_for_edge(member, float(t[begin + i]), left, closed, lam[i, closed])
        for j, member in enumerate(self._members):
            member.record.end_with(self._memory(j, member, made.end.friction))

    @classmethod
    def _keep_sample(
        cls, member: ContactRun, t: float, q: Array, closed: Array, lam: Array, stored: float,
        tangential: tuple[Array, Array] | None,
    ) -> None:  # fmt: skip
        """Let a contact keep a sample of its closed rows, (na,)."""
        record, gaps = member.record, member.mechanics.gaps
        record.keep_rows(t, rows_of(gaps)[closed], lam, stored, tangential)
        followed = isinstance(gaps, PatchGaps) and gaps.moving  # loops have looked where these leave their patch
        if record.edge is None and not followed and np.isfinite(gaps.stage.rows.leaves_at[closed]).any():
            cls._look_for_edge(member, t, q, closed, lam)

    @staticmethod
    def _look_for_edge(member: ContactRun, t: float, q: Array, closed: Array, lam: Array) -> None:
        """Let a contact record where it leaves its patch, if it does so in a sample with these closed rows, (na,)."""
        mechanics, gaps = member.mechanics, member.mechanics.gaps
        nodes, gap = rows_of(gaps)[closed], gaps.at(member.coordinates_in(q))
        present = np.isin(gaps.row_nodes, nodes)
        if (np.maximum(-gap[present], 0.0) >= gaps.stage.rows.leaves_at[present]).any():
            forces = np.zeros((len(gap), mechanics.rows.d))
            forces[present, 0] = lam[np.isin(nodes, gaps.row_nodes)]
            answer = mechanics.answered(Forces(forces, np.flatnonzero(present)), gap, float(gap.min()))
            member.record.look_for_edge(t, answer)
