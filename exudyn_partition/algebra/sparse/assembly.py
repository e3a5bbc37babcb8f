"""Sums of small matrices at coordinates of a model: assembled once, from the entries of all of them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import scipy.sparse as sp

from ...support.arrays import Array

Part = tuple[Array, Array | sp.sparray | sp.spmatrix]  # coordinates, and a matrix on them


def assembled(parts: Iterable[Part], n: int) -> sp.csr_matrix:
    """Sum of matrices on some of n coordinates, (n, n).

    Parameters
    ----------
    parts : iterable of ((k,) int array, (k, k) array or sparse matrix)
        Coordinates of each matrix, which may be repeated, and the matrix.
    n : int
    """
    entries = [(np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0))]
    for columns, matrix in parts:
        if sp.issparse(matrix):
            triplets = sp.coo_matrix(matrix)
            entries.append((columns[triplets.row], columns[triplets.col], triplets.data))
        else:
            entries.append((np.repeat(columns, len(columns)), np.tile(columns, len(columns)), np.ravel(matrix)))
    rows, columns, values = (np.concatenate(each) for each in zip(*entries, strict=True))
    total = sp.csr_matrix((values, (rows, columns)), shape=(n, n))
    total.eliminate_zeros()
    return total
