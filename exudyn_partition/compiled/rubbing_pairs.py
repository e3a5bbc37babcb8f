"""Rows with friction between two bodies in compiled steps: found by `followed_pairs`, and evaluated by NumPy.

They are those of `contact.tangential`, or without friction in a group that has it, of `contact.normal_rows`.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np

from ..algebra.friction import OPEN
from ..contact.gaps import GapState
from ..contact.normal_rows import NormalRows
from ..contact.stages import NOTHING, Stage
from ..contact.tangential import TangentialRows
from ..support.arrays import Array
from .followed_pairs import FollowedPair
from .friction_plan import FlatFrictionRows, FrictionState
from .moving import Following, MovingState, growing_of
from .rubbing import Rubbing, RubbingState


class RubbingPair(FollowedPair):
    """The rows of a contact with friction, or of one that such a contact moves, in a run.

    Parameters
    ----------
    following : Following
    number : int
        Among the contacts of two bodies of the plan.
    plan : Rubbing
    state : RubbingState
    flat : FlatFrictionRows
        Of this run; normals, tangents and flexibilities are written to it.
    friction : FrictionState
    moving : MovingState
        By which bodies grow.
    loops : module or None
        `pair_kernels`, if loops are compiled.
    """

    def __init__(
        self, following: Following, number: int, plan: Rubbing, state: RubbingState, flat: FlatFrictionRows,
        friction: FrictionState, moving: MovingState, loops: ModuleType | None,
    ) -> None:  # fmt: skip
        s, j = len(plan.surfaces.contact) + number, following.contact
        super().__init__(following, s, slice(*flat.rows.starts[j : j + 2].tolist()), state, moving, loops)
        self._number, self._plan, self._state, self._rough, self._friction = number, plan, state, flat, friction
        self._tangential = TangentialRows(self.gaps) if flat.frictional[j] else None
        self._normal, self.group = NormalRows(self.gaps), int(plan.groups[s])
        self._F, self._q_before = flat.blocks()[self.group], NOTHING

    @property
    def _directed(self) -> NormalRows | TangentialRows:
        """The present rows."""
        return self._normal if self._tangential is None else self._tangential

    def begin(self, before: GapState | None) -> None:
        """See `FollowedPair`."""
        super().begin(before)
        if self._tangential is not None:
            self._tangential.forget_places()

    def beyond(self, gap: Array) -> float:
        """See `FollowedPair`; nothing that others push closes them."""
        return np.inf

    def take_rows(self, stage: Stage) -> None:
        """See `FollowedPair`; rows that are not present forget their forces."""
        friction, absent = self._friction, np.ones(self._rows.stop - self._rows.start, dtype=bool)
        absent[self._slots] = False
        gone, memory = np.arange(self._rows.start, self._rows.stop)[absent], friction.memory
        for values in (memory.forces, memory.before, memory.tractions, memory.slipped, memory.speed, friction.lam):
            values[gone] = 0
        friction.status[gone], friction.near[self._rows], friction.fresh[self.group] = OPEN, False, True
        self._state.found_axis[self.s] = -1

    def place_rows(self, q: Array, q_before: Array) -> None:
        """Find the rows at the model's coordinates q, (nq,), in a step from others, and set their gaps."""
        rows = self._stage
        self.gaps.growing = growing_of(self.gaps, self.products)
        self.find_rows(q, q_before, self._friction.gap)
        self._friction.pushed[self._rows] = self._friction.gap[self._rows]
        self._q_before = q_before[self._following.dofs]
        if rows != self._stage:  # other nodes are followed
            then = self._then
            self._write(self.gaps.stage.rows.sides.places(then.q, then.growing))

    @property
    def _then(self) -> GapState:
        """Where the step began."""
        return GapState(self._q_before, NOTHING, growing=growing_of(self.gaps, self._state.growing_before[self.s]))

    def _write(self, places: list[Array]) -> None:
        """Let loops know places of the nodes at the start of the step, (np, 3) for each side [m]."""
        for begin, x in zip(self._state.nodes_from[self._number].tolist(), places, strict=True):
            self._state.nodes[begin : begin + len(x)] = x

    def stand(self, q: Array) -> None:
        """Let rows slide from where they are at the model's coordinates q, (nq,)."""
        self.place_rows(q, q)
        self._known[0] = False  # the next evaluation is elsewhere
        self._record()

    def _record(self) -> None:
        """Let rows slide from where they are."""
        state, gaps = self._state, self.gaps
        self._write(gaps.present.places)
        state.growing_before[self.s] = self.products
        state.axes_before[self.s] = gaps.sides[1].kinematics.frame(gaps.present.coordinates[1])[1]

    # By NumPy, see `rubbing_pair_kernels`.

    def rub(self, q: Array, q_before: Array) -> None:
        """See `rub_pairs`."""
        self.place_rows(q, q_before)
        self._known[0] = False
        f, gaps, rows = self._friction, self.gaps, self._tangential
        places = self._rows.start + self._slots
        flat = self._rough.rows
        normals = flat.numbers[flat.normals[self.contact] :][: 3 * (self._rows.stop - self._rows.start)].reshape(-1, 3)
        normals[:] = 0.0
        normals[self._slots] = gaps.stage.normal
        self._state.axes[self.s] = gaps.sides[1].kinematics.frame(gaps.present.coordinates[1])[1]
        if rows is not None:
            rows.record_places(self._then, soon=False)
            self._state.axis[self.s], self._rough.tangents[places] = rows.axis, rows.tangents
            f.way[places] = rows.way()
            f.memory.forces[places, 1:] = rows.along(f.memory.tractions[places] @ rows.axes.T)

    def anchor(self) -> None:
        """See `anchor_pairs`."""
        s, state = self.s, self._state
        if self.renew_anchor(self._plan.same[s]):
            state.found_axis[s] = -1
        if state.found_axis[s] != state.axis[s]:
            every, rows = np.arange(len(self._slots)), self._directed
            F, anchor = rows.flexibility(every), self.gaps.anchoring.anchor(self._plan.same[s])
            self.gaps.anchoring.found_at(anchor, lambda: self._set_flexibility(F))

    def _set_flexibility(self, F: Array) -> None:
        """Set the flexibility of the present rows, (d nr, d nr) [m/N], and their fields."""
        state, plan, flat, j, rows = self._state, self._plan, self._rough, self.contact, self._directed
        top, starts, m = int(flat.rows.starts[flat.groups[self.group]]), flat.rows.starts, plan.n_fields
        n = self._rows.stop - self._rows.start
        within = 3 * (self._rows.start - top) + np.arange(3 * n)
        places = (3 * self._slots[:, None] + np.arange(rows.d)).ravel()
        own = np.zeros((3 * n, 3 * n))
        if rows.d == 1 and len(F):
            along = (3 * self._slots[:, None] + np.arange(3)).ravel()
            own[along, along] = F.diagonal().mean()
        own[np.ix_(places, places)] = F
        self._F[np.ix_(within, within)] = own
        fields = state.numbers[plan.fields[j] :][: 3 * n * m].reshape(3 * n, m)
        fields[:] = 0.0
        if m:
            moved = [rows.side_rows(side) @ of_side for side, of_side in enumerate(self._following.fields)]
            fields[places] = np.sum(moved, axis=0)
        for (of, by), core in zip(plan.links.tolist(), plan.cores.tolist(), strict=True):
            if of == j:
                others = slice(*starts[by : by + 2].tolist())
                there = 3 * (others.start - top) + np.arange(3 * (others.stop - others.start))
                of_others = state.numbers[plan.fields[by] :][: len(there) * m].reshape(len(there), m)
                between = fields @ state.numbers[core:][: m * m].reshape(m, m) @ of_others.T
                self._F[np.ix_(within, there)], self._F[np.ix_(there, within)] = between, between.T
        state.found_axis[self.s], state.fresh[self.s] = state.axis[self.s], True
        self._friction.fresh[self.group] = True

    def lacks_rows(self, *, shared: bool) -> bool:
        """See `lack_rough_rows`; `shared` tells whether other contacts push the rows too."""
        f, places, rows = self._friction, self._rows.start + self._slots, self._directed
        lam, gap, least = f.lam[places], f.gap[places], float(f.pushed[places].min(initial=np.inf))
        if not (self.gaps.leaves_out and lam[:, 0].any()):
            return False
        on_rows = np.ascontiguousarray(lam[:, : rows.d])
        lacks = self.gaps.follow_pushed(
            np.ascontiguousarray(lam[:, 0]), gap, least, lambda: rows.nodal_forces(on_rows), shared=shared
        )
        self._within[0] = self.gaps.within
        return lacks

    def push(self, force: Array) -> None:
        """See `push_pairs`."""
        f, places = self._friction, self._rows.start + self._slots
        if not len(places):
            f.values[self.contact, 5] = np.inf
        if (f.status[places] != OPEN).any():
            lam = np.ascontiguousarray(f.lam[places, : self._directed.d])
            force[self._following.dofs] += self._directed.acted(lam)[0]

    def accept(self) -> None:
        """See `accept_pairs`."""
        f, flat = self._friction, self._rough
        self._record()
        traction = np.einsum("rk,rkd->rd", f.lam[self._rows, 1:], flat.tangents[self._rows])
        f.memory.tractions[self._rows] = traction @ self._state.axes[self.s]
