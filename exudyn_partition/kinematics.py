"""Motion of a reduced body's nodes in space (temporary: the branch `floating` brings the full module)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from .body import ReducedBody

Array = np.ndarray


class InertialKinematics:
    """A body whose frame does not move: x = X + position + Phi q.

    Parameters
    ----------
    body : ReducedBody
    position : (3,) array
        Where the origin of the body's mesh is put [m].
    nodes : (k,) int array
    """

    linear = True

    def __init__(self, body: ReducedBody, position: Array, nodes: Array) -> None:
        self.points = body.points[nodes] + position
        self.rows: Any = body.rows(nodes)
        # The products below want the rows contiguous as they take them.
        self._transposed = sp.csr_matrix(self.rows.T) if sp.issparse(self.rows) else np.ascontiguousarray(self.rows.T)
        self.n = self.rows.shape[1]

    def place(self, q: Array) -> Array:
        """Places of the nodes, (k, 3) [m]."""
        return self.points + (self.rows @ q).reshape(-1, 3)

    def jacobian(self, q: Array) -> Any:
        """Derivative of the places by the coordinates, (3k, n), dense or csr."""
        return self.rows

    def generalised(self, q: Array, forces: Array) -> Array:
        """Generalised forces, (n,), of forces on the nodes, (k, 3) [N]."""
        return self._transposed @ forces.ravel()

    def in_frame(self, q: Array, directions: Array) -> Array:
        """Directions in space, (m, 3), in the body's own frame."""
        return directions
