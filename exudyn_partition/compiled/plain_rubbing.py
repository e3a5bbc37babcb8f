"""What `rubbing_kernels` does, by NumPy, for those who have no numba and where compiled loops give up.

`rubbing_pairs` does so for two bodies.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..algebra.friction import OPEN
from ..contact.loops import tangents_of
from ..contact.tangential import STEEP
from ..support.arrays import Array
from .friction_plan import FlatFrictionRows, FrictionState
from .moving import MovingState
from .plain_moving import PlainBody, PlainSurface
from .rubbing import Rubbing, RubbingState
from .rubbing_pairs import RubbingPair


class PlainRubbing:
    """Contacts with friction whose rows follow the motion, in a run.

    Parameters
    ----------
    plan : Rubbing
    state : RubbingState
    flat : FlatFrictionRows
        Of this run; normals, tangents and flexibilities are written to it.
    moving : MovingState
        By which bodies grow.
    bodies : sequence of PlainBody
        Those in floating frames.
    pairs : sequence of RubbingPair
        Contacts of two bodies.
    """

    def __init__(
        self, plan: Rubbing, state: RubbingState, flat: FlatFrictionRows, moving: MovingState,
        bodies: Sequence[PlainBody], pairs: Sequence[RubbingPair],
    ) -> None:  # fmt: skip
        self._plan, self._state, self._flat, self._moving, surfaces = plan, state, flat, moving, plan.surfaces
        of_surfaces = [bodies[b] if b >= 0 else None for b in surfaces.body.tolist()]
        self._contacts = [PlainSurface(surfaces, s, body) for s, body in enumerate(of_surfaces)]
        self._blocks, self._pairs = flat.blocks(), pairs

    def _rows(self, j: int) -> slice:
        """Rows of a contact."""
        return slice(*self._flat.rows.starts[j : j + 2].tolist())

    def stand(self, q: Array) -> None:
        """Let rows slide from where they are at the model's coordinates q, (nq,)."""
        for one in self._contacts:
            self._place(one, q)
            self._state.before[self._rows(one.contact)] = self._state.place[self._rows(one.contact)]
        for pair in self._pairs:
            pair.stand(q)

    def _place(self, one: PlainSurface, q: Array) -> Array:
        """Set places, normals and tangents of the rows of a contact; return their gaps, (nr,) [m]."""
        state, flat, s, rows = self._state, self._flat, one.s, self._rows(one.contact)
        gap, x, normals = one.placed(self._moving, q)
        state.normals[one.points], state.place[rows] = normals, one.mean @ x
        state.axes[s] = one.body_axes(q)
        of_rows = flat.rows.numbers[flat.rows.normals[one.contact] :][: 3 * len(gap)].reshape(-1, 3)
        of_rows[:] = one.mean @ normals
        if flat.frictional[one.contact]:
            least = np.inf
            for number in (self._plan.first_axis[s] + np.arange(3)) % 3:
                tangents, cosines = tangents_of(of_rows, state.axes[s][:, number])
                if (steepest := cosines.max(initial=0.0)) < least:
                    least, state.axis[s], flat.tangents[rows] = steepest, number, tangents
                if steepest <= STEEP:
                    break
        return gap

    def rub(self, f: FrictionState, q: Array, q_before: Array) -> None:
        """See `friction_kernels.place_moving`; the step began at coordinates `q_before`, (nq,)."""
        state, memory = self._state, f.memory
        for one in self._contacts:
            rows = self._rows(one.contact)
            f.gap[rows] = f.pushed[rows] = self._place(one, q)
            if self._flat.frictional[one.contact]:
                tangents = self._flat.tangents[rows]
                f.way[rows] = np.einsum("rkd,rd->rk", tangents, state.place[rows] - state.before[rows])
                in_space = memory.tractions[rows] @ state.axes[one.s].T
                memory.forces[rows, 1:] = np.einsum("rkd,rd->rk", tangents, in_space)
        for pair in self._pairs:
            pair.rub(q, q_before)

    def lacks_rows(self) -> bool:
        """Whether forces may push rows shut that are not followed, see `friction_kernels.lack_rows`."""
        several = np.diff(self._flat.groups) > 1
        return any([pair.lacks_rows(shared=bool(several[pair.group])) for pair in self._pairs])

    def anchor(self, f: FrictionState, group: int, q: Array) -> None:
        """See `friction_kernels.anchor_moving`."""
        state, plan = self._state, self._plan
        for one in self._contacts:
            s = one.s
            if plan.groups[s] != group:
                continue
            here = state.normals[one.points] @ state.axes[s]
            far = not state.anchored[s]
            if one.d > 1:
                far = far or not abs(here - state.along[one.points]).max() <= plan.same[s]
            if far:
                state.anchored[s], state.found_axis[s], state.anchors[s] = True, -1, q
                state.growing[s, :6] = 0.0 if one.body is None else self._moving.products[one.body.b]
                if one.d > 1:
                    state.along[one.points] = here
            if state.found_axis[s] != state.axis[s]:
                self._find_flexibility(one, group)
                f.fresh[group] = True
        for pair in self._pairs:
            if pair.group == group:
                pair.anchor()

    def _find_flexibility(self, one: PlainSurface, group: int) -> None:
        """See `rubbing_kernels.find_flexibility`."""
        state, plan, flat, j = self._state, self._plan, self._flat, one.contact
        starts, rows, on_nodes = flat.rows.starts, self._rows(j), self._at_anchor(one)
        top, F, nr = int(starts[flat.groups[group]]), self._blocks[group], rows.stop - rows.start
        places = np.arange(3 * nr) if flat.frictional[j] else np.arange(0, 3 * nr, 3)
        own = on_nodes @ one.flexibility @ on_nodes.T
        within = 3 * (rows.start - top) + np.arange(3 * nr)
        F[np.ix_(within, within)] = np.diag(np.full(3 * nr, own.diagonal().mean()))
        F[np.ix_(within[places], within[places])] = 0.5 * (own + own.T)
        m = plan.n_fields
        fields = state.numbers[plan.fields[j] :][: 3 * nr * m].reshape(3 * nr, m)
        fields[places] = on_nodes @ one.node_fields[:, :m]
        for (of, by), core in zip(plan.links.tolist(), plan.cores.tolist(), strict=True):
            if of == j:
                others = self._rows(by)
                there = 3 * (others.start - top) + np.arange(3 * (others.stop - others.start))
                of_others = state.numbers[plan.fields[by] :][: len(there) * m].reshape(len(there), m)
                between = fields @ state.numbers[core:][: m * m].reshape(m, m) @ of_others.T
                F[np.ix_(within, there)], F[np.ix_(there, within)] = between, between.T
        state.found_axis[one.s], state.fresh[one.s] = state.axis[one.s], True

    def _at_anchor(self, one: PlainSurface) -> Array:
        """See `rubbing_kernels.rows_at_anchor`."""
        along = self._state.along[one.points] if one.d > 1 else np.full((len(one.on_points), 1), -1.0)
        normal, nr = np.einsum("rp,pk,pa->rka", one.mean, one.on_points, along), len(one.mean)
        if not self._flat.frictional[one.contact]:
            return np.asarray(normal.reshape(nr, -1))
        tangents, _ = tangents_of(one.mean @ along, np.eye(3)[self._state.axis[one.s]])
        carried = np.asarray(one.mean @ one.on_points)
        rows = np.concatenate([normal[:, None], carried[:, None, :, None] * tangents[:, :, None]], axis=1)
        return np.asarray(rows.reshape(3 * nr, -1))

    def push(self, f: FrictionState, q: Array, force: Array) -> None:
        """See `friction_kernels.push_moving`."""
        for one in self._contacts:
            rows = self._rows(one.contact)
            if (f.status[rows] != OPEN).any():
                traction = np.einsum("rk,rkd->rd", f.lam[rows, 1:], self._flat.tangents[rows])
                pushes = (one.mean.T @ f.lam[rows, 0])[:, None] * self._state.normals[one.points]
                one.act(q, pushes + one.mean.T @ traction, force)
        for pair in self._pairs:
            pair.push(force)

    def accept(self, f: FrictionState) -> None:
        """See `friction_kernels.accept_moving`."""
        state = self._state
        for one in self._contacts:
            rows = self._rows(one.contact)
            state.before[rows] = state.place[rows]
            traction = np.einsum("rk,rkd->rd", f.lam[rows, 1:], self._flat.tangents[rows])
            f.memory.tractions[rows] = traction @ state.axes[one.s]
        for pair in self._pairs:
            pair.accept()
