"""Many contacts with frozen pairs, evaluated together by compiled loops over flat arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..algebra.block_complementarity import FlatBlocks
from ..support.arrays import Array
from . import loops
from .gaps import Gaps
from .linear_gaps import FlatRows


class FrozenContacts:
    """Frictionless contacts with frozen pairs on common bodies, evaluated in one call if `loops.at_once()`.

    Parameters
    ----------
    gaps : sequence of Gaps
        Gaps of the contacts.
    dofs : sequence of (n,) int arrays
        Numbers of their coordinates in the model.
    blocks : FlatBlocks
        The problem for their forces, with guesses of the active rows.

    Attributes
    ----------
    starts : (n + 1,) int array
        Where the rows of each contact begin.
    h, pushed, lam : (nr,) arrays
        For all rows: gaps, gaps with the displacements that other contacts cause [m], and forces [N].
    force : (nq,) array
        Generalised forces on the model's coordinates.
    row_nodes : (nr,) int array
        Node of the slave's patch for each row of all contacts.
    leaves_at : (nr,) array
        Depth at which contact of each row leaves its patch [m].
    values : (n, 6) array
        Sensor values of each contact: the sum of the forces [N], the number of closed rows, the force on the slave [N],
        and the smallest gap of the rows, without the contact's own flexibility [m].
    stored : (n,) array
        Energy that each contact stores [J].
    pushes : bool
        Whether any force acts.
    kept : (k,) int array or None
        Closed rows for which results were kept last.
    """

    kept: Array | None = None

    def __init__(self, gaps: Sequence[Gaps], dofs: Sequence[Array], blocks: FlatBlocks) -> None:
        frozen = [contact_gaps.stage.linear for contact_gaps in gaps if contact_gaps.stage.linear is not None]
        assert len(frozen) == len(gaps)
        rows, self._blocks = FlatRows.of(frozen, [contact_gaps.stage.normal for contact_gaps in gaps], dofs), blocks
        self.pushes = True
        self._stages = [contact_gaps.stage for contact_gaps in gaps]
        self.starts, self.lam, self.pushed = blocks.starts, blocks.lam, blocks.pushed
        self.h, self.force = np.empty(len(self.lam)), np.empty(0)
        self.values, self.stored = np.empty((len(gaps), 6)), np.empty(len(gaps))
        self._flat = loops.flat_contacts(rows, blocks, self.h, self.values, self.stored)
        self.row_nodes = np.concatenate([contact_gaps.row_nodes for contact_gaps in gaps])
        self.leaves_at = np.concatenate([contact_gaps.stage.rows.leaves_at for contact_gaps in gaps])

    def at(self, q: Array) -> bool:
        """Find forces at the model's coordinates q, (nq,), and the values of sensors.

        Return False if pairs begin to slide, or if forces do not converge soon. Then each contact must be evaluated
        alone.
        """
        if len(q) != len(self.force):
            self.force = np.empty(len(q))
        pushing = loops.evaluate_frozen(self._flat, q, self.force)
        if pushing < 0:
            self._blocks.forget()
            return False
        self.pushes = pushing > 0
        return True

    def has_pairs_of(self, gaps: Sequence[Gaps]) -> bool:
        """Whether these gaps of the contacts still have their first pairs."""
        return [contact_gaps.stage for contact_gaps in gaps] == self._stages

    def guess(self, active: Array) -> None:
        """Start the next solution from these active rows, (nr,) bool."""
        self._blocks.active[:], self._blocks.n_closed[:] = active, -1

    def pop_iterations(self) -> Array:
        """Iterations of the active rows of each contact since the last call, (n,)."""
        iterations = self._blocks.iterations.copy()
        self._blocks.iterations[:] = 0
        return iterations
