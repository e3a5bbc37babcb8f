"""Contact by Lagrange multipliers on nodal coordinates, forward-increment central differences (paper, eq. 27-29)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import RunError
from .complementarity import Complementarity, regularised
from .gaps import Gaps
from .law import ContactLaw

Array = np.ndarray


_CLOSED = 1e-6  # of a facet's size: central differences close gaps to round-off


def _not_central_differences(reason: str) -> RunError:
    return RunError(
        f"{reason}: contact with formulation 'lagrange' needs Exudyn's explicit solver VelocityVerlet with a constant "
        "step (solve_dynamic(..., method='explicit')), or its generalized-alpha (method='implicit')"
    )


class LagrangeContact(ContactLaw):
    """Multipliers of the paper's basis, chosen so that no gap is closed further than zero at the end of the step.

    Eq. 24 alone, relative acceleration zero, keeps the approach velocity of a node that has just touched, which then
    drifts into penetration. Here lambda_n >= 0 makes g(q_{n+1}) >= 0, complementary: the forward-increment form
    (Carpenter, Taylor, Katona 1991) of the same central differences. Pairs are those at the predicted q_{n+1}.

    Parameters
    ----------
    gaps : Gaps
    inverse_mass : (n,) array
        Inverse of the diagonal mass of both bodies' coordinates.
    """

    def __init__(self, gaps: Gaps, inverse_mass: Array) -> None:
        self._inverse_mass = inverse_mass
        super().__init__(gaps)

    def reset(self) -> None:
        """Forget the last run."""
        super().reset()
        self._expected: Array | None = None
        self._held: Any = None
        self.problem: Any = None
        self._take_rows()

    def _take_rows(self) -> None:
        """G, M^-1 G' and G M^-1 G' of the present rows, if they are others than before."""
        gaps = self.gaps
        if not gaps.moving and self._held is gaps.held and self.problem:
            return
        self.G = gaps.jacobian(np.arange(len(gaps.row_nodes)))
        if sp.issparse(self.G):
            self.push = sp.csr_matrix(self.G.multiply(self._inverse_mass)).T.tocsr()
            F = (self.G @ self.push).toarray()
        else:
            self.push = (self.G * self._inverse_mass).T
            F = self.G @ self.push
        F = regularised(F)  # flat on flat, there are more rows than coordinates
        if self.problem is None or not gaps.moving:
            self.problem = Complementarity(F)
        else:
            self.problem.replace(F, self._closed_nodes[gaps.row_nodes])
        self._held = gaps.held

    def increment(self, q: Array, q_t: Array, q_tt: Array, step: float) -> Array | None:
        """Acceleration M^-1 G' lambda, (n,), that keeps all gaps open over the coming step; None without contact.

        Parameters
        ----------
        q, q_t, q_tt : (n,) arrays
            Coordinates of slave and master, their velocities and accelerations without contact.
        step : float
            [s]
        """
        self._check_last_step(q)
        gap = self.gaps.at(q + step * q_t + 0.5 * step**2 * q_tt)
        self._expected, self.least_gap = None, gap.min(initial=np.inf)
        if self.least_gap >= 0.0:
            self._open()
            return None
        self._take_rows()
        lam = self.problem.solve(gap / step**2)
        self._close(lam, self.problem.index)
        if not self.gaps.moving:
            closing = step**2 * (self.problem.F @ self.lam)
            self._expected, self._scale = gap + closing, abs(closing).max()
        return self.push @ self.lam

    def _check_last_step(self, q: Array) -> None:
        """Refuse to go on if the last step did not do with the multipliers what central differences do."""
        if self._expected is None:
            return
        gap = self.gaps.at(q)
        if self.gaps.moving:  # with other pairs, gaps of other rows
            return
        if abs(gap - self._expected).max() > 1e-3 * self._scale + 1e-12 * abs(q).max():
            raise _not_central_differences("the last step did not close the gaps as predicted")

    def check_gaps(self, q: Array) -> None:
        """Refuse coordinates in which a gap is closed further than zero."""
        deepest = self.gaps.at(q).min(initial=0.0)
        if deepest < -_CLOSED * self.gaps.size:
            raise _not_central_differences(f"a gap is {deepest:.3g} m")

    def potential(self, q: Array) -> float:
        """Multipliers store no energy."""
        return 0.0
