"""Contact by a penalty: an elastic layer on the slave's patch, for comparison, and for bodies with any basis.

Theory: examples/site/theory.md, "Penalty".
"""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp

from ...algebra.coulomb import Coulomb
from ...algebra.friction import OPEN, SLIP, STICK
from ...errors import ComplementarityError
from ...frames.kinematics import Rows
from ...support.arrays import Array
from ..gaps import Gaps
from .frictional import FrictionalContact
from .law import ElasticContact

_POISSON = 0.3  # Poisson's ratio of the layer
_SHEAR = 2 * (1 - _POISSON) / (2 - _POISSON)  # its tangential stiffness relative to its normal one
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
        return _springs(self.stiffness * self.gaps.area[index], H)


class FrictionalPenalty(FrictionalContact):
    """An elastic layer with Coulomb friction: it also yields along the tangents, and its ends slip.

    The tangential stiffness of the layer is 2 (1 - nu) / (2 - nu) times the normal one, Mindlin's ratio for equal
    bodies, with nu = 0.3. With A the area of a row, s the way that it has slid since the last accepted step, and
    lambda_t* the tangential force then::

        lambda_n = k A max(0, -gap),    x = lambda_t* - k_t A s,    lambda_t = x min(1, mu lambda_n / |x|).

    Each row has its own answer, which is unique for every coefficient.

    Parameters
    ----------
    gaps : Gaps
    friction : Coulomb
    stiffness : float
        Normal stiffness of the layer [N/m3].

    References
    ----------
    R.D. Mindlin, Compliance of elastic bodies in contact, 1949.
    """

    def __init__(self, gaps: Gaps, friction: Coulomb, stiffness: float) -> None:
        self.stiffness = stiffness
        super().__init__(gaps, friction)

    def _find(self, gap: Array, pushed: Array) -> None:
        lam = self._pressed(gap)
        self._way = self.tangential.way()
        self._trial = self.last_forces()[:, 1:] - self._shear[:, None] * self._way
        self._length, self._bound = np.linalg.norm(self._trial, axis=1), self.coefficients() * lam
        slips = self._length > self._bound
        self._share = np.divide(self._bound, self._length, out=np.ones(len(lam)), where=slips)
        self.forces = np.column_stack([lam, self._share[:, None] * self._trial])
        self._state = np.where(lam > 0, np.where(slips, SLIP, STICK), OPEN).astype(np.int8)
        self.close_rows(lam, np.flatnonzero(lam))

    def _pressed(self, gap: Array) -> Array:
        """Normal forces of gaps, (nr,) [N]."""
        lam: Array = np.where(gap < 0.0, -self.stiffness * self.gaps.area * gap, 0.0)
        return lam

    @property
    def _shear(self) -> Array:
        """Tangential stiffness of the rows, (nr,) [N/m]."""
        shear: Array = _SHEAR * self.stiffness * self.gaps.area
        return shear

    def slips(self) -> Array:
        """See `FrictionalContact`."""
        if not self.index.size:
            return np.zeros((len(self.forces), 2))
        return self._way + self._yields(self.forces[:, 1:] - self.last_forces()[:, 1:])

    def _yields(self, along: Array) -> Array:
        """Ways by which the layer yields to tangential forces, (nr, 2) [m]."""
        shear = self._shear[:, None]
        return np.divide(along, shear, out=np.zeros(along.shape), where=shear > 0)

    def stored(self) -> float:
        """See `Law`; in the layer, which yields along the normal and the tangents."""
        if not self.index.size:
            return 0.0
        lam, along = self.lam[self.index], self.forces[:, 1:]
        normal = lam @ (lam / (self.stiffness * self.gaps.area[self.index]))
        return 0.5 * float(normal + np.sum(along * self._yields(along)))

    def _blocks(self) -> sp.bsr_matrix:
        """Derivative of the forces on the closed rows by their places, (3 na, 3 na) [N/m], with the sign changed.

        A force that slips turns with its trial force, and grows with the normal force.
        """
        some, blocks = self.index, np.zeros((len(self.index), 3, 3))
        normal, shear = self.stiffness * self.gaps.area[some], self._shear[some]
        slips = self._state[some] == SLIP
        along = self._trial[some] / np.maximum(self._length[some], 1e-300)[:, None]
        turning = np.eye(2) - slips[:, None, None] * (along[:, :, None] * along[:, None, :])
        blocks[:, 0, 0] = normal
        blocks[:, 1:, 0] = (slips * normal * self.coefficients()[some])[:, None] * along
        blocks[:, 1:, 1:] = (shear * self._share[some])[:, None, None] * turning
        return sp.bsr_matrix((blocks, np.arange(len(some)), np.arange(len(some) + 1)), shape=(3 * len(some),) * 2)

    def tangent_matrix(self, by_q: float, by_q_t: float) -> sp.csr_matrix:
        """See `Law`; unsymmetric where rows slip."""
        if not self.index.size:
            return super().tangent_matrix(by_q, by_q_t)
        H = self.row_jacobian()
        return sp.csr_matrix(by_q * (H.T @ (self._blocks() @ H)))

    def row_stiffness(self) -> Array:
        """See `Law`; in all three directions of the closed rows, (3 na, 3 na)."""
        return self._blocks().toarray() if self.index.size else np.zeros((0, 0))

    def closed_stiffness(self) -> Array:
        """Contact stiffness with all rows closed and stuck, (n, n): the largest that the element can have."""
        each = self.stiffness * self.gaps.area[:, None] * [1.0, _SHEAR, _SHEAR]
        return _springs(each.ravel(), self.tangential.jacobian(np.arange(len(self.gaps.row_nodes))))

    def press(self, gap: Array) -> tuple[float, int]:
        """See `Law`; without friction."""
        lam = self._pressed(gap)
        return -0.5 * float(lam @ gap), int(np.count_nonzero(lam))


def _springs(k: Array, H: Rows) -> Array:
    """Stiffness of springs k, (na,) [N/m], along rows H, (na, n): H' k H."""
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
