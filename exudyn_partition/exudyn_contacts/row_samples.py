"""Normal forces of a contact's rows at the samples of a result, as the run kept them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..support.arrays import Array
from .contact_record import ContactRecord
from .kept_run import KeptRun

_NONE = np.empty(0, dtype=np.int64), np.empty(0)


@dataclass(frozen=True, eq=False)
class RowSamples:
    """Normal forces of rows at some times of a run. They are looked up when somebody asks.

    Parameters
    ----------
    run : ContactRecord or KeptRun
        What the contact kept of it.
    times : (n,) array
        Times of the samples [s], ascending.
    """

    run: ContactRecord | KeptRun
    times: Array

    def at_sample(self, sample: int) -> tuple[Array, Array]:
        """Patch nodes of the closed rows at a sample, (k,), and the forces on them, (k,) [N]."""
        return self.run.rows_at([float(self.times[sample])])[0] or _NONE

    def joined(self, samples: Array) -> tuple[Array, Array, Array]:
        """Closed rows at some samples, one after the other.

        Returns
        -------
        (k,) int array, (k,) array, (n + 1,) int array
            Patch nodes, forces on them [N], and where the rows of each sample begin.
        """
        closed_rows = self.run.rows_at(self.times[samples].tolist())
        nodes, forces = zip(_NONE, *[rows or _NONE for rows in closed_rows], strict=True)
        return np.concatenate(nodes), np.concatenate(forces), np.cumsum([*map(len, nodes)])

    def matrix(self, samples: Array | None = None) -> sp.csr_matrix:
        """Force of the row of each patch node, (n, np) [N], at all samples or at some, (n,) int array."""
        chosen = np.arange(len(self.times)) if samples is None else samples
        nodes, forces, starts = self.joined(chosen)
        return sp.csr_matrix((forces, nodes, starts), shape=(len(chosen), len(self.run.areas)))
