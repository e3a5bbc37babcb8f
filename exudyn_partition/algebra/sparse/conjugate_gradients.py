"""Rough solutions of well-conditioned systems with many right-hand sides."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...support.arrays import Array
from . import loops

_STEPS = 40  # at most


def solve_roughly(matrix: sp.csr_matrix, rhs: Array, solved: float) -> Array:
    """Solve by conjugate gradients of all columns at once, with the diagonal as preconditioner.

    What is as rough needs no more than single precision, whose products read half of the bytes.

    Parameters
    ----------
    matrix : (3 n, 3 n) csr matrix
        Symmetric and positive definite, dofs xyz interleaved.
    rhs : (3 n, k) array
    solved : float
        Residual of each column at the end, by that at the start, in the norm of the inverse of the diagonal.
    """
    scale = np.linalg.norm(rhs, axis=0)
    r = np.ascontiguousarray(rhs / np.where(scale > 0, scale, 1.0), dtype=np.float32)
    matrix, inverse = matrix.astype(np.float32), (1 / matrix.diagonal()).astype(np.float32)
    return np.asarray(loops.conjugate_gradients(matrix, inverse, r, solved, _STEPS) * scale)
