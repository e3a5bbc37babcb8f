"""Contact by a penalty: an elastic layer on the slave's patch, for comparison, and for bodies with any basis."""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp

from ...errors import ComplementarityError
from ...frames.kinematics import Rows
from ...support.arrays import Array
from ..gaps import Gaps
from .law import ElasticContact

_SOFT = 0.1  # share of the bodies' highest squared frequency that the layer may add


class PenaltyContact(ElasticContact):
    """An elastic layer: the force on a row is its area times the layer's stiffness times its depth, -gap.

    Parameters
    ----------
    gaps : Gaps
    stiffness : float
        Stiffness of the layer [N/m3].
    """

    def __init__(self, gaps: Gaps, stiffness: float) -> None:
        self.stiffness = stiffness
        super().__init__(gaps)

    def answer(self, gap: Array) -> None:
        """Find the forces on the present rows from their gaps, (nr,) [m]."""
        self.h = gap
        self.least_gap = gap.min(initial=np.inf)
        if math.isnan(self.least_gap):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        if self.least_gap >= 0.0:
            self.open_rows()
            return
        lam = np.where(gap < 0.0, -self.stiffness * self.gaps.area * gap, 0.0)
        self.close_rows(lam, np.flatnonzero(lam))

    def tangent_of(self, H: Array) -> Array:
        """Stiffness of the closed rows on some coordinates, (m, m); H, (na, m), are the derivatives of their gaps."""
        return self._tangent(self.index, H)

    def closed_stiffness(self) -> Array:
        """Contact stiffness with all rows closed, (n, n)."""
        everything = np.arange(len(self.gaps.row_nodes))
        return self._tangent(everything, self.gaps.jacobian(everything))

    def _tangent(self, index: Array, H: Rows) -> Array:
        k = self.stiffness * self.gaps.area[index]
        value: Array = (H.T @ sp.diags(k) @ H).toarray() if sp.issparse(H) else H.T @ (k[:, None] * H)
        return value


def bed_stiffness(gaps: Gaps) -> float:
    """Stiffness of a layer that yields under uniform pressure as the bodies' residual flexibility does [N/m3].

    A are the areas of the rows and F is their flexibility. A unit pressure moves the rows by F A. The layer yields by
    the mean of this motion.
    """
    A = gaps.area
    return float(A.sum() / (A @ gaps.flexibility(np.arange(len(A))) @ A))


def inertial_stiffness(gaps: Gaps, inverse_mass: Array, omega_max: float) -> float:
    """Stiffness of a layer that adds at most a tenth to the highest squared frequency of the bodies [N/m3].

    A row with mobility g = G M^-1 G' and stiffness k adds at most k g to omega_max^2.
    """
    H = gaps.jacobian(np.arange(len(gaps.area)))
    mobility = np.asarray((H.multiply(H) if sp.issparse(H) else H * H) @ inverse_mass).ravel()
    return float(_SOFT * omega_max**2 / np.max(mobility * gaps.area))
