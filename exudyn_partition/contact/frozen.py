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
        smallest gap, zero if it is closed [m].
    stored : (n,) array
        Energy that each contact stores [J].
    """

    def __init__(self, gaps: Sequence[Gaps], dofs: Sequence[Array], blocks: FlatBlocks) -> None:
        frozen = [each.linear for each in gaps if each.linear is not None]
        assert len(frozen) == len(gaps)
        self._rows, self._blocks = FlatRows.of(frozen, [each.normal for each in gaps], dofs), blocks
        self._held = [each.held for each in gaps]
        self.starts, self.lam, self.pushed = blocks.starts, blocks.lam, blocks.pushed
        self.h, self.force = np.empty(len(self.lam)), np.empty(0)
        self.told, self.stored = np.empty((len(gaps), 6)), np.empty(len(gaps))
        self.row_nodes = np.concatenate([each.row_nodes for each in gaps])
        self.at_edge = np.concatenate([each.at_edge for each in gaps])

    def evaluate(self, q: Array) -> bool:
        """Find gaps and forces at the model's coordinates q, (nq,).

        Return False if pairs begin to slide, or forces do not settle soon; then each contact must be evaluated.
        """
        loops = kernels("contact")
        assert loops is not None
        if len(q) != len(self.force):
            self.force = np.empty(len(q))
        if not loops.gaps_of_frozen(self._rows, q, self.h) or not self._blocks.solve(self.h):
            return False
        loops.forces_of_frozen(self._rows, self.h, self.lam, self.pushed, self.force, self.told, self.stored)
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
