"""Normal forces of a contact's rows at the samples of a result, as the run kept them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..support.arrays import Array
from .contact_record import ContactRecord
from .kept_run import KeptRun

_NONE = np.empty(0, dtype=np.int64), np.empty(0)


@dataclass(frozen=True, eq=False)
class RowSamples:
    """Normal forces of rows at some times.

    Parameters
    ----------
    by_sample : dict of int to ((k,) int array, (k,) array)
        Patch nodes of the closed rows, and the forces on them [N]; keys are numbers of samples, ascending.
    shape : (int, int)
        Numbers of samples and of the slave's patch nodes.
    """

    by_sample: dict[int, tuple[Array, Array]]
    shape: tuple[int, int]

    @classmethod
    def kept(cls, run: ContactRecord | KeptRun, times: Array) -> RowSamples:
        """Rows that a run kept, at some of its times, (n,) [s], ascending."""
        numbers = {t: i for i, t in enumerate(times.tolist())}
        kept = {numbers[t]: (nodes, forces) for t, nodes, forces in run.samples if t in numbers}
        return cls(kept, (len(times), len(run.areas)))

    def at_sample(self, sample: int) -> tuple[Array, Array]:
        """Patch nodes of the closed rows at a sample, (k,), and the forces on them, (k,) [N]."""
        return self.by_sample.get(sample, _NONE)

    def joined(self, samples: Sequence[int]) -> tuple[Array, Array, Array]:
        """Closed rows at some samples, one after the other.

        Returns
        -------
        (k,) int array, (k,) array, (n + 1,) int array
            Patch nodes, forces on them [N], and where the rows of each sample begin.
        """
        nodes, forces = zip(_NONE, *(self.at_sample(sample) for sample in samples), strict=True)
        return np.concatenate(nodes), np.concatenate(forces), np.cumsum([*map(len, nodes)])

    def matrix(self, samples: Array | None = None) -> sp.csr_matrix:
        """Force of the row of each patch node, (n, np) [N], at all samples or at some, (n,) int array."""
        chosen = range(self.shape[0]) if samples is None else samples.tolist()
        nodes, forces, starts = self.joined(chosen)
        return sp.csr_matrix((forces, nodes, starts), shape=(len(chosen), self.shape[1]))
