"""Entries of sparse matrices as text files have them: row, column and value, maybe of one triangle only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ..support.arrays import Array

_DIRECTIONS = 8  # more than a node has


class Triples(NamedTuple):
    """Rows, columns, both from 0 on, and values of the entries, (k,) each."""

    rows: Array
    columns: Array
    values: Array

    @property
    def last(self) -> int:
        """Largest row or column; -1 if there is no entry."""
        return int(max(self.rows.max(initial=-1), self.columns.max(initial=-1)))

    def matrix(self, n: int) -> sp.csr_matrix:
        """(n, n) matrix; if no entry has its mirror image, the other triangle is the same.

        Rows may be in another order than in the program that wrote one triangle.
        """
        found = sp.csr_matrix((self.values, (self.rows, self.columns)), shape=(n, n))
        diagonal = sp.diags(found.diagonal())
        there = (found != 0) - (diagonal != 0)
        return found if there.multiply(there.T).nnz else (found + found.T - diagonal).tocsr()


def joined(tables: Sequence[Sequence[Array]]) -> tuple[Array, Array, list[sp.csr_matrix]]:
    """Matrices on common rows, and the node and the direction of each row.

    Parameters
    ----------
    tables : sequence of (node, direction, node, direction, value)
        Of the entries of each matrix, (k,) arrays: of the row, of the column, and the value.
    """
    keys = [[_DIRECTIONS * node + way for node, way in ((t[0], t[1]), (t[2], t[3]))] for t in tables]
    rows = np.unique(np.concatenate([part for pair in keys for part in pair]))
    nodes, directions = np.divmod(rows, _DIRECTIONS)
    matrices = [
        Triples(np.searchsorted(rows, row), np.searchsorted(rows, column), table[4]).matrix(len(rows))
        for (row, column), table in zip(keys, tables, strict=True)
    ]
    return nodes, directions, matrices
