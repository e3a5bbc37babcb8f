"""Many contacts whose pairs are all frozen, evaluated at once by compiled loops over flat arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..algebra.block_complementarity import FlatBlocks, pooled
from ..support.arrays import Array
from ..support.compiled import kernels
from .gaps import Gaps
from .pairings import LinearGaps

_CLEARLY = 1 - 1e-6  # rounding of what pairs have slid, relative to their reach
_FEW = 8  # lowest rows


class FlatRows(NamedTuple):
    """Rows of all contacts in flat arrays, see `LinearGaps`.

    Parameters
    ----------
    starts, places, drift_starts : (n + 1,) int arrays
        Where the rows of each contact begin, its coordinates in `dofs`, and its pairs in `drift_start`.
    dofs : array of int
        Numbers of each contact's coordinates in the model.
    numbers : array
        Matrices of all contacts; equal ones are there once.
    H, drift, normals : (n,) int arrays
        Where these of each contact begin in `numbers`; H is transposed.
    start, drift_start : arrays
    reach : (n,) array
        A little less, so that pairs that stay frozen here do so in their laws too.
    """

    starts: Array
    places: Array
    drift_starts: Array
    dofs: Array
    numbers: Array
    H: Array
    drift: Array
    normals: Array
    start: Array
    drift_start: Array
    reach: Array

    @classmethod
    def of(cls, frozen: Sequence[LinearGaps], normals: Sequence[Array], dofs: Sequence[Array]) -> FlatRows:
        """Put the rows of contacts one after the other."""
        numbers, at = pooled([*(g.H.T for g in frozen), *(g.drift for g in frozen), *normals])
        H, drift, normal = at.reshape(3, -1)
        return cls(
            _starts([g.start for g in frozen]),
            _starts(dofs),
            _starts([g.drift_start for g in frozen]),
            np.concatenate(dofs),
            numbers,
            H,
            drift,
            normal,
            np.concatenate([g.start for g in frozen]),
            np.concatenate([g.drift_start for g in frozen]),
            np.array([_CLEARLY * g.reach for g in frozen]),
        )


class LowestRows(NamedTuple):
    """Rows with the smallest gaps of each contact: one of them keeps the smallest while the contact moves a little.

    Parameters
    ----------
    H : array
        Transposes of the rows, (n, k), one contact after the other.
    start : (nc, k) array
    at : array
        Coordinates of each contact where they were chosen.
    numbers : array
        `turn` and `slide` of all contacts; equal ones are there once.
    turn, slide : (nc,) int arrays
        Where these begin, (n,) each: how much the gaps of two rows change against each other, and pairs slide, at most
        with each coordinate.
    room, slack : (nc,) arrays
        How much they may from there, so that the rows hold and pairs stay frozen [m].
    """

    H: Array
    start: Array
    at: Array
    numbers: Array
    turn: Array
    slide: Array
    room: Array
    slack: Array

    @classmethod
    def of(cls, frozen: Sequence[LinearGaps]) -> LowestRows:
        """Return none chosen yet."""
        nc, k, n = len(frozen), min(_FEW, *(len(g.start) for g in frozen)), sum(g.H.shape[1] for g in frozen)
        turns = {id(g.H): np.ptp(g.H, axis=0) for g in frozen}
        numbers, at = pooled([turns[id(g.H)] for g in frozen] + [abs(g.drift).max(axis=0, initial=0) for g in frozen])
        turn, slide = at.reshape(2, -1)
        return cls(np.empty(k * n), np.empty((nc, k)), np.empty(n), numbers, turn, slide, *np.zeros((2, nc)))


class FrozenContacts:
    """Frictionless contacts with frozen pairs on common bodies, evaluated at once. Only where loops are compiled.

    Parameters
    ----------
    gaps : sequence of Gaps
        Of the contacts.
    dofs : sequence of (n,) int arrays
        Numbers of their coordinates in the model.
    blocks : FlatBlocks
        The problem of their forces, with guesses of the active rows.

    Attributes
    ----------
    starts : (n + 1,) int array
        Where the rows of each contact begin.
    h, pushed, lam : (nr,) arrays
        Of all rows: gaps, gaps where the forces of the other contacts have moved them [m], and forces [N].
    force : (nq,) array
        Generalised forces on the model's coordinates.
    row_nodes : (nr,) int array
        Node of the slave's patch for each row of all.
    at_edge : (nr,) bool array
        Rows at the edge of their patch.
    told : (n, 6) array
        Of each contact: the sum of the forces [N], the number of closed rows, the force on the slave [N], and the
        smallest gap of the rows, without the contact's own flexibility [m].
    stored : (n,) array
        Energy that each contact stores [J].
    whole : bool
        Whether `h` and `pushed` are those of the last evaluation: the lowest rows of open contacts do without them.
    pushes : bool
        Whether there are forces.
    """

    def __init__(self, gaps: Sequence[Gaps], dofs: Sequence[Array], blocks: FlatBlocks) -> None:
        frozen = [each.linear for each in gaps if each.linear is not None]
        assert len(frozen) == len(gaps)
        self._rows, self._blocks = FlatRows.of(frozen, [each.normal for each in gaps], dofs), blocks
        self._lowest, self.whole, self.pushes = LowestRows.of(frozen), True, True
        self._held = [each.held for each in gaps]
        self.starts, self.lam, self.pushed = blocks.starts, blocks.lam, blocks.pushed
        self.h, self.force = np.empty(len(self.lam)), np.empty(0)
        self.told, self.stored = np.empty((len(gaps), 6)), np.empty(len(gaps))
        self.row_nodes = np.concatenate([each.row_nodes for each in gaps])
        self.at_edge = np.concatenate([each.at_edge for each in gaps])

    def evaluate(self, q: Array) -> bool:
        """Find forces at the model's coordinates q, (nq,), and what the contacts tell.

        Return False if pairs begin to slide, or forces do not settle soon; then each contact must be evaluated. While
        all contacts stay open, their lowest rows are enough; `evaluate_rows` finds the gaps of all.
        """
        loops = kernels("contact")
        assert loops is not None
        if not self.pushes and loops.fly_on(self._rows, self._lowest, q, self.h, self.told):
            self.whole = False
            return True
        return self.evaluate_rows(q)

    def evaluate_rows(self, q: Array) -> bool:
        """Find gaps of all rows too, see `evaluate`."""
        loops = kernels("contact")
        assert loops is not None
        self.whole = self.pushes = True
        if len(q) != len(self.force):
            self.force = np.empty(len(q))
        if not loops.gaps_of_frozen(self._rows, q, self.h) or not self._blocks.solve(self.h):
            return False
        loops.forces_of_frozen(self._rows, self.h, self.lam, self.pushed, self.force, self.told, self.stored)
        self.pushes = bool(self.told[:, 1].any())
        return True

    def has_pairs_of(self, gaps: Sequence[Gaps]) -> bool:
        """Whether these gaps of the contacts still have the pairs that they had at first."""
        known = zip(gaps, self._held, strict=True)
        return all(not each.moving and each.held is held for each, held in known)

    def guess(self, active: Array) -> None:
        """Begin with some active rows, (nr,) bool."""
        self._blocks.active[:], self._blocks.n_closed[:] = active, -1

    def take_iterations(self) -> Array:
        """Iterations of the active rows of each contact since the last call, (n,)."""
        found = self._blocks.iterations.copy()
        self._blocks.iterations[:] = 0
        return found


def _starts(arrays: Sequence[Array]) -> Array:
    """Where each of some arrays begins in all of them together, and their end, (n + 1,)."""
    return np.cumsum([0, *map(len, arrays)])
