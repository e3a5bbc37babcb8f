"""Rows without friction between two bodies in compiled steps, and their flexibility."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from ..algebra.block_complementarity import FlatBlocks
from ..contact.normal_rows import NormalRows
from ..contact.stages import Frozen, Stage
from ..support.arrays import Array
from .followed_pairs import FollowedPair
from .moving import Following, MovingState


class PairRows(FollowedPair):
    """The rows of a contact without friction, see `FollowedPair`.

    Parameters
    ----------
    following : Following
    s : int
        Number of the contact among the moving ones.
    state : MovingState
    blocks : FlatBlocks
        Of the run.
    loops : module or None
        `pair_kernels`, if loops are compiled.
    """

    def __init__(
        self, following: Following, s: int, state: MovingState, blocks: FlatBlocks, loops: ModuleType | None
    ) -> None:
        rows = slice(*blocks.starts[following.contact : following.contact + 2])
        super().__init__(following, s, rows, state, state, loops)
        self._state, self._blocks = state, blocks

    def take_rows(self, stage: Stage) -> None:
        """See `FollowedPair`; the flexibility of frozen rows is known."""
        state, blocks, s = self._state, self._blocks, self.s
        state.found[s], state.frozen[s], blocks.n_closed[self.contact] = False, isinstance(stage, Frozen), -1
        self.own[:], self.fields[:] = 0.0, 0.0
        np.fill_diagonal(self.own, 1.0)
        if isinstance(stage, Frozen):
            self._set_flexibility(NormalRows(self.gaps).problem().F)

    @property
    def own(self) -> Array:
        """Flexibility of all rows of the patch, (n, n) [m/N]; a view."""
        n = self._rows.stop - self._rows.start
        return self._blocks.numbers[self._blocks.own[self.contact] :][: n * n].reshape(n, n)

    @property
    def fields(self) -> Array:
        """Displacements of all rows of the patch in the fields, (m, n); a view."""
        n, m = self._rows.stop - self._rows.start, self._blocks.amplitudes.shape[1]
        return self._blocks.numbers[self._blocks.fields[self.contact] :][: n * m].reshape(m, n)

    def _set_flexibility(self, F: Array) -> None:
        """Set the flexibility of the present rows, (nr, nr) [m/N], and their fields."""
        state, slots, rows = self._state, self._slots, NormalRows(self.gaps)
        self.own[np.ix_(slots, slots)] = F
        state.diagonal[self._rows] = self.own.diagonal()
        moved = [rows.side_rows(side) @ fields for side, fields in enumerate(self._following.fields) if fields.size]
        if moved:
            of_rows = np.sum(moved, axis=0)
            self.fields[: of_rows.shape[1], slots] = of_rows.T
        state.found[self.s], self._blocks.n_closed[self.contact], state.added[self.s] = True, -1, -1.0

    def regularise(self, gap: Array, bulge: float, share: float) -> None:
        """See `moving_kernels.regularise_rows`."""
        state, diagonal = self._state, self._state.diagonal[self._rows]
        near = state.near[self._rows] = gap < -bulge * gap.min()
        if state.frozen[self.s]:
            state.near[self._rows] = True
            return
        added = share * diagonal[near].sum() / max(np.count_nonzero(near), 1)
        if added != state.added[self.s]:
            state.added[self.s], self._blocks.n_closed[self.contact] = added, -1
            np.fill_diagonal(self.own, diagonal + added)

    def lacks_rows(self, lam: Array, h: Array, pushed: Array) -> bool:
        """See `pair_kernels.lacks_rows`; `lam`, `h` and `pushed`, (n,), are of all rows of all contacts."""
        gaps, (of_rows, gap, moved) = self.gaps, (values[self._rows][self._slots] for values in (lam, h, pushed))
        if not (gaps.leaves_out and of_rows.any()):
            return False
        shared, least = not np.array_equal(gap, moved), float(moved.min())
        lacks = gaps.follow_pushed(of_rows, gap, least, lambda: gaps.stage.nodal_forces(of_rows), shared=shared)
        self._within[0] = gaps.within
        return lacks

    def push(self, lam: Array, force: Array, values: Array) -> None:
        """See `moving_kernels.forces_of_pairs`; `lam`, (n,), are the forces on all rows of the patch [N]."""
        if not len(self._slots):
            values[5] = np.inf
        of_rows = lam[self._slots]
        if of_rows.any():
            pushed, values[2:5] = self.gaps.stage.acted(of_rows, self.gaps.present.q)
            force[self._following.dofs] += pushed

    def anchor(self, same: float) -> bool:
        """See `moving_kernels.anchor_rows`."""
        gaps, state = self.gaps, self._state
        if not gaps.moving or not len(self._slots):
            return False
        if self.renew_anchor(same):
            state.found[self.s] = False
        if state.found[self.s]:
            return False
        every = np.arange(len(self._slots))
        F, anchor = NormalRows(gaps).flexibility(every), gaps.anchoring.anchor(same)
        gaps.anchoring.found_at(anchor, lambda: self._set_flexibility(F))
        return True
