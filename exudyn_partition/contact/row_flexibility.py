"""Residual flexibility between the rows of a contact."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..algebra.complementarity import regularised
from ..algebra.sparse.skin_flexibility import Flexibility
from ..frames.kinematics import Rows
from ..support.arrays import Array
from . import loops
from .stages import NOTHING


class RowFlexibility:
    """Residual flexibility between rows, and between some of them.

    Parameters
    ----------
    F : (nr, nr) array
        [m/N]
    index : (nr,) int array, optional
        Numbers of these rows, if they are only some of the present rows: then only they may be asked for.

    Attributes
    ----------
    regularised : (na, na) array or None
        Last return value of `regularised_between`.
    """

    def __init__(self, F: Array, index: Array | None = None) -> None:
        self._F, self._index = F, NOTHING if index is None else index
        self._some: Array = F[:0, :0] if index is None else F
        self.regularised: Array | None = None

    def between(self, index: Array) -> Array:
        """Flexibility between some rows, (na, na); the same array for the same rows."""
        if index is not self._index and not np.array_equal(index, self._index):
            self._index, self.regularised = index, None
            self._some = self._F.take(index, axis=0).take(index, axis=1)
        return self._some

    def pushing(self, index: Array) -> Array:
        """See `NormalRows.pushing`."""
        return self._F.take(index, axis=1)

    def shuts(self, gap: Array, index: Array, forces: Array, depth: float) -> bool:
        """Whether forces on some rows push others deeper than to a gap `depth` [m].

        Parameters
        ----------
        gap : (nr,) array
            Of the present rows without these forces [m].
        index, forces : (k,) arrays
            Rows, ascending, and the forces on them [N].
        """
        return loops.shuts(self._F, gap, index, forces, depth)

    def regularised_between(self, index: Array) -> Array:
        """Regularised flexibility between some rows, (na, na); the same array for the same rows."""
        some = self.between(index)
        if self.regularised is None:
            self.regularised = regularised(some)
        return self.regularised


def through(rows: Rows, flexibility: Flexibility, columns: Rows) -> Array:
    """Motion of rows, (m, r), by forces on others, (j, c), through a flexibility between their nodes: (m, j) [m/N]."""
    if isinstance(flexibility, np.ndarray):
        return np.asarray(rows @ (columns @ flexibility.T).T)
    rows, columns = sp.csr_matrix(rows), sp.csr_matrix(columns)
    used, pushing = np.unique(rows.indices), np.unique(columns.indices)
    return np.asarray(rows[:, used] @ (columns[:, pushing] @ flexibility[np.ix_(used, pushing)].T).T)
