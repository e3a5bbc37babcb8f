"""Static answers of a free body: inertia balances the loads that nothing else holds (inertia relief)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ..support.arrays import Array


def static_answers(stiffness: sp.csr_matrix, mass: sp.csr_matrix, rigid: Array, loads: Array) -> Array:
    """Coordinates, (n, k), by loads on the coordinates, (n, k), without rigid motion.

    Parameters
    ----------
    stiffness, mass : (n, n) csr matrix
    rigid : (n, 6) array
        Coordinates of rigid motion.
    loads : (n, k) array
    """
    border = mass @ sp.csr_matrix(rigid)
    scale = (stiffness.diagonal().max() or 1.0) / abs(border).max()  # a rigid body has no stiffness
    system = sp.bmat([[stiffness, scale * border], [scale * border.T, None]], format="csc")
    balanced = loads - border @ np.linalg.solve(rigid.T @ border, rigid.T @ loads)
    right = np.vstack([balanced, np.zeros((6, loads.shape[1]))])
    return np.asarray(scipy.sparse.linalg.splu(system).solve(right)[: len(loads)])
