"""Contact by Lagrange multipliers on nodal coordinates, forward-increment central differences (paper, eq. 27-29)."""

from __future__ import annotations

import numpy as np

from ...algebra.complementarity import regularised
from ...errors import RunError
from ...support.arrays import Array
from ..gaps import dense
from .formulation import Law, Method
from .law import ContactLaw
from .stabilised import StabilisedContact

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
    `forward_increment.ForwardIncrement` finds lambda, of one contact or several.

    Parameters
    ----------
    gaps : Gaps

    Attributes
    ----------
    G, push : (nr, n), (n, nr) arrays or csr matrices
        Present rows, and the accelerations M^-1 G' that unit forces on them make.
    F : (nr, nr) array
        G M^-1 G', with a trace on the diagonal for rows that are redundant.
    """

    ahead = True

    def for_run(self, method: Method) -> Law:
        """Return the multipliers of explicit runs, or those that implicit ones take."""
        return StabilisedContact(self.gaps.fresh()) if method == "implicit" else self.fresh()

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        self._expected: Array | None = None
        self._held: object = None
        self.take_rows()

    def take_rows(self) -> bool:
        """Take G, `push` and F of the present rows; whether they are others than before."""
        gaps = self.gaps
        if not gaps.moving and self._held is gaps.held:
            return False
        self.G = gaps.jacobian(np.arange(len(gaps.row_nodes)))
        self.push = gaps.accelerations(self.G)
        self.F = regularised(dense(self.G @ self.push))  # flat on flat, there are more rows than coordinates
        self._held = gaps.held
        return True

    @property
    def guess(self) -> Array:
        """Present rows that were closed in the last step, (nr,) bool."""
        return self._closed_nodes[self.gaps.row_nodes]

    def predict(self, q: Array, q_t: Array, q_tt: Array, step: float) -> Array:
        """Gaps, (nr,) [m], at the end of the coming step, if nothing pushed.

        Parameters
        ----------
        q, q_t, q_tt : (n,) arrays
            Coordinates of slave and master, their velocities and accelerations without contact.
        step : float
            [s]
        """
        self._check_last_step(q)
        gap = self.gaps.at(self.gaps.moved(q, step * q_t + 0.5 * step**2 * q_tt))
        self._expected, self.least_gap = None, gap.min(initial=np.inf)
        return gap

    def open(self) -> None:
        """Leave all rows open in the coming step."""
        self.open_rows()

    def close(self, lam: Array, index: Array, gap: Array, scale: float) -> None:
        """Push with lam, (nr,) [N], on the rows `index` in the coming step.

        Its gaps are then `gap`, (nr,) [m]; `scale` [m] is the most that one multiplier closes.
        """
        self.close_rows(lam, index)
        if not self.gaps.moving:
            self._expected, self._scale = gap, scale

    def _check_last_step(self, q: Array) -> None:
        """Refuse to go on if the last step did not do with the multipliers what central differences do."""
        if self._expected is None:
            return
        gap = self.gaps.at(q)
        if self.gaps.moving:  # with other pairs, gaps of other rows
            return
        round_off = 1e-12 * (abs(q).max() + abs(gap).max())
        if abs(gap - self._expected).max() > 1e-3 * self._scale + round_off:
            raise _not_central_differences("the last step did not close the gaps as predicted")

    def check(self, q: Array) -> None:
        """Refuse coordinates in which a gap is closed further than zero."""
        deepest = self.gaps.of_present(q).min(initial=0.0)
        if deepest < -_CLOSED * self.gaps.size:
            raise _not_central_differences(f"a gap is {deepest:.3g} m")
