"""Contact by a penalty: an elastic layer on the slave's patch, for comparison, and for bodies with any basis.

Theory: examples/site/theory.md, "Penalty".
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...algebra.friction import OPEN, SLIP, STICK
from ...frames.kinematics import Rows
from ...support.arrays import Array
from ..gaps import Gaps
from ..law import Forces, Law, Places, RowDirections
from ..normal_rows import NormalRows

_POISSON = 0.3  # Poisson's ratio of the layer
_SHEAR = 2 * (1 - _POISSON) / (2 - _POISSON)  # its tangential stiffness relative to its normal one
_SOFT = 0.1  # the layer may add so much of the bodies' highest squared frequency


class PenaltyLayer(Law):
    """An elastic layer: the force on a row is its area times the layer's stiffness times its depth, -gap.

    With friction, it also yields along the tangents, and its ends slip. By Mindlin's ratio for equal bodies, its
    tangential stiffness is 2 (1 - nu) / (2 - nu) times the normal one, with nu = 0.3. A is the area of a row, s how far
    it has slid since the last accepted step, and lambda_t* the tangential force at the end of that step::

        lambda_n = k A max(0, -gap),    x = lambda_t* - k_t A s,    lambda_t = x min(1, mu lambda_n / |x|).

    The answer of each row is independent of the others, and unique for every coefficient.

    Parameters
    ----------
    rows : RowDirections
    layer : float
        Normal stiffness of the layer [N/m3].

    References
    ----------
    R.D. Mindlin, Compliance of elastic bodies in contact, 1949.
    """

    def __init__(self, rows: RowDirections, layer: float) -> None:
        self.rows, self.layer = rows, layer

    @property
    def _area(self) -> Array:
        value: Array = self.rows.gaps.area
        return value

    def answer(self, places: Places) -> Forces:
        """See `Law`."""
        lam = np.where(places.gap < 0.0, -self.layer * self._area * places.gap, 0.0)
        closed = np.flatnonzero(lam)
        row_stiffness = self._row_stiffness(closed)
        if self.rows.d == 1:
            return Forces(lam[:, None], closed, stiffness=lambda: sp.diags(row_stiffness[:, 0]))
        shear = _SHEAR * self.layer * self._area
        trial = places.last[:, 1:] - shear[:, None] * places.way
        length, bound = np.linalg.norm(trial, axis=1), places.mu * lam
        slipping = length > bound
        share = np.divide(bound, length, out=np.ones(len(lam)), where=slipping)
        tangential = share[:, None] * trial
        slips = places.way + _yields(tangential - places.last[:, 1:], shear)
        stored = -0.5 * float(lam.dot(places.gap)) + 0.5 * float(np.sum(tangential * _yields(tangential, shear)))

        def stiffness() -> sp.spmatrix:
            along = (trial / np.maximum(length, 1e-300)[:, None])[closed]
            return _of_slipping(row_stiffness, slipping[closed], along, places.mu[closed], share[closed])

        state = np.where(lam > 0, np.where(slipping, SLIP, STICK), OPEN).astype(np.int8)
        forces = np.column_stack([lam, tangential])
        return Forces(forces, closed, state, slips, stored=stored, stiffness=stiffness)

    def _row_stiffness(self, index: Array) -> Array:
        """Stiffness of some rows, (na, d) [N/m]: along the normal, and along both tangents while they stick."""
        value: Array = self.layer * self._area[index][:, None] * np.array([1.0, _SHEAR, _SHEAR])[: self.rows.d]
        return value

    def closed_stiffness(self, rows: RowDirections) -> Array:
        """See `Law`."""
        everything = np.arange(len(self._area))
        return _springs(self._row_stiffness(everything).ravel(), rows.jacobian(everything))


def _of_slipping(stiffness: Array, slips: Array, along: Array, mu: Array, share: Array) -> sp.spmatrix:
    """Stiffness of closed rows with friction, (3 na, 3 na) [N/m].

    A force that slips turns with its trial force, and grows with the normal force.

    Parameters
    ----------
    stiffness : (na, 3) array
        Stiffness while rows stick [N/m].
    slips : (na,) bool array
        Whether rows slip.
    along : (na, 2) array
        Directions of the trial forces.
    mu, share : (na,) arrays
        Coefficients of friction, and what is left of the trial forces.
    """
    n, blocks = len(stiffness), np.zeros((len(stiffness), 3, 3))
    turning = np.eye(2) - slips[:, None, None] * (along[:, :, None] * along[:, None, :])
    blocks[:, 0, 0] = stiffness[:, 0]
    blocks[:, 1:, 0] = (slips * stiffness[:, 0] * mu)[:, None] * along
    blocks[:, 1:, 1:] = (stiffness[:, 1] * share)[:, None, None] * turning
    return sp.bsr_matrix((blocks, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n))


def _yields(along: Array, shear: Array) -> Array:
    """Tangential deformation of a layer of stiffness `shear`, (nr,) [N/m], under forces, (nr, 2) [N]: (nr, 2) [m]."""
    stiffness = shear[:, None]
    return np.divide(along, stiffness, out=np.zeros(along.shape), where=stiffness > 0)


def _springs(k: Array, H: Rows) -> Array:
    """Stiffness of springs k, (na,) [N/m], along rows H, (na, n): H' k H."""
    value: Array = (H.T @ sp.diags(k) @ H).toarray() if sp.issparse(H) else H.T @ (k[:, None] * H)
    return value


def bed_stiffness(gaps: Gaps) -> float:
    """Stiffness of a layer that yields under uniform pressure as much as the residual flexibility [N/m3].

    A are the areas of the rows and F is their flexibility. A unit pressure moves the rows by F A. The layer yields by
    the mean of this motion.
    """
    A = gaps.area
    return float(A.sum() / NormalRows(gaps).work_of(A))


def inertial_stiffness(gaps: Gaps, inverse_mass: Array, omega_max: float) -> float:
    """Stiffness of a layer that adds at most a tenth to the highest squared frequency of the bodies [N/m3].

    A row with mobility g = G M^-1 G' and stiffness k adds at most k g to omega_max^2.
    """
    H = gaps.jacobian(np.arange(len(gaps.area)))
    mobility = np.asarray((H.multiply(H) if sp.issparse(H) else H * H) @ inverse_mass).ravel()
    return float(_SOFT * omega_max**2 / np.max(mobility * gaps.area))
