"""Contact by a penalty: an elastic layer on the slave's patch, for comparison and for other kinds of bodies."""

from __future__ import annotations

import math

import numpy as np

from ..errors import ComplementarityError
from .gaps import Gaps

Array = np.ndarray


class PenaltyContact:
    """Each row pushes with its area times a layer's stiffness times the depth that its gap is closed beyond zero.

    Parameters
    ----------
    gaps : Gaps
    stiffness : float
        Of the layer [N/m3].

    Attributes
    ----------
    lam : (nr,) array
        Forces on the present rows of `gaps` [N].
    index : (na,) int array
        Those that are closed.
    """

    def __init__(self, gaps: Gaps, stiffness: float) -> None:
        self.gaps, self.stiffness = gaps, stiffness
        self._zero = np.zeros(gaps.n)
        self.reset()

    def reset(self) -> None:
        """Forget the last state, before a new run."""
        self.gaps.reset()
        self.lam, self.index = np.zeros(len(self.gaps.row_nodes)), np.empty(0, dtype=np.int64)

    def force(self, q: Array) -> Array:
        """Generalised contact force, (n,), on the coordinates of slave and master, q (n,)."""
        h = self.gaps.at(q)
        if not math.isfinite(h.min(initial=0.0)):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        self.h = np.minimum(h, 0.0)
        self.lam = -self.stiffness * self.gaps.area * self.h
        self.index = np.flatnonzero(self.lam)
        return self.gaps.generalised(self.lam) if self.index.size else self._zero

    def tangent(self) -> Array:
        """Contact stiffness -d force / d q of the closed rows, (n, n), pairs held."""
        return self._stiffness(self.index)

    def closed_stiffness(self) -> Array:
        """Contact stiffness with all rows closed, (n, n)."""
        return self._stiffness(np.arange(len(self.gaps.row_nodes)))

    def _stiffness(self, index: Array) -> Array:
        H = self.gaps.jacobian(index)
        H = H.toarray() if hasattr(H, "toarray") else H
        return H.T @ ((self.stiffness * self.gaps.area[index])[:, None] * H)

    def potential(self, q: Array) -> float:
        """Energy stored in the layer [J]."""
        self.force(q)
        return 0.5 * float(self.lam @ -self.h)


def bed_stiffness(gaps: Gaps) -> float:
    """Stiffness of the layer that yields under a uniform pressure as the bodies' residual flexibility does [N/m3].

    With the rows' areas A and flexibility F, a unit pressure moves them by F A; the layer's mean is the same.
    """
    index, A = np.arange(len(gaps.row_nodes)), gaps.area
    return float(A.sum() / (A @ gaps.flexibility(index) @ A))
