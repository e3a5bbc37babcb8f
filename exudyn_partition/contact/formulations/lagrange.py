"""Contact by Lagrange multipliers on nodal coordinates, forward-increment central differences (paper, eq. 21-28)."""

from __future__ import annotations

import numpy as np

from ...algebra.complementarity import regularised
from ...errors import RunError
from ...support.arrays import Array
from ..gaps import dense
from .formulation import Law, Method
from .law import ContactLaw
from .stabilised import StabilisedContact

_CLOSED = 1e-6  # of a facet's size; central differences keep gaps closed up to round-off


def _not_central_differences(reason: str) -> RunError:
    return RunError(
        f"{reason}: contact with formulation 'lagrange' needs Exudyn's explicit solver VelocityVerlet with a constant "
        "step (solve_dynamic(..., method='explicit')), or its solver generalized-alpha (method='implicit')"
    )


class LagrangeContact(ContactLaw):
    """Multipliers for the paper's basis. They make all gaps zero or positive at the end of the step.

    Eq. 24 alone sets the relative acceleration to zero. A node that has just touched would keep its approach velocity
    and drift into penetration. Here lambda_n >= 0 and g(q_{n+1}) >= 0 are complementary: this is the forward-increment
    form (Carpenter, Taylor, Katona 1991) of the same central differences. Pairs are those at the predicted q_{n+1}.
    `forward_increment.ForwardIncrement` computes lambda for one contact or several.

    Parameters
    ----------
    gaps : Gaps

    Attributes
    ----------
    G, push : (nr, n), (n, nr) arrays or csr matrices
        Present rows, and the accelerations M^-1 G' that unit forces on the rows cause.
    F : (nr, nr) array
        G M^-1 G', with a small addition on the diagonal, because rows may be redundant.
    """

    ahead = True

    def for_run(self, method: Method) -> Law:
        """Return this law for explicit runs, or `StabilisedContact` for implicit ones; none is for statics."""
        if method == "static":
            raise RunError(
                "contact with formulation 'lagrange' has no statics, for its multipliers act on velocities: it needs "
                "Exudyn's explicit solver VelocityVerlet, or generalized-alpha (solve_dynamic). Take a basis with "
                "residual flexibility and formulation='compliance' for static runs, or press slowly in a damped run"
            )
        return StabilisedContact(self.gaps.fresh()) if method == "implicit" else self.fresh()

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        self._expected: Array | None = None
        self._held: object = None
        self.take_rows()

    def take_rows(self) -> bool:
        """Compute G, `push` and F of the present rows; return whether the rows have changed."""
        gaps = self.gaps
        if not gaps.moving and self._held is gaps.held:
            return False
        self.G = gaps.jacobian(np.arange(len(gaps.row_nodes)))
        self.push = gaps.accelerations(self.G)
        self.F = regularised(dense(self.G @ self.push))  # between flat patches there are more rows than coordinates
        self._held = gaps.held
        return True

    @property
    def guess(self) -> Array:
        """Present rows that were closed in the last step, (nr,) bool."""
        return self._closed_nodes[self.gaps.row_nodes]

    def predict(self, q: Array, q_t: Array, q_tt: Array, step: float) -> Array:
        """Gaps, (nr,) [m], at the end of the coming step without contact forces.

        Parameters
        ----------
        q, q_t, q_tt : (n,) arrays
            Coordinates of slave and master, their velocities, and their accelerations without contact.
        step : float
            Length of the step [s].
        """
        self._check_last_step(q)
        gap = self.gaps.at(self.gaps.moved(q, step * q_t + 0.5 * step**2 * q_tt))
        self._expected, self.least_gap = None, gap.min(initial=np.inf)
        return gap

    def open(self) -> None:
        """Leave all rows open in the coming step."""
        self.open_rows()

    def close(self, lam: Array, index: Array, gap: Array, scale: float) -> None:
        """Apply lam, (nr,) [N], to the rows `index` in the coming step.

        At its end the gaps are `gap`, (nr,) [m]. `scale` [m] is the largest change of a gap by one multiplier.
        """
        self.close_rows(lam, index)
        if not self.gaps.moving:
            self._expected, self._scale = gap, scale

    def _check_last_step(self, q: Array) -> None:
        """Raise unless the last step moved the gaps as central differences with these multipliers do."""
        if self._expected is None:
            return
        gap = self.gaps.at(q)
        if self.gaps.moving:  # the pairs have changed: these are gaps of other rows
            return
        round_off = 1e-12 * (abs(q).max() + abs(gap).max())
        if abs(gap - self._expected).max() > 1e-3 * self._scale + round_off:
            raise _not_central_differences("the last step did not close the gaps as predicted")

    def check(self, q: Array) -> None:
        """Raise if a gap at coordinates q, (n,), is negative."""
        deepest = self.gaps.of_present(q).min(initial=0.0)
        if deepest < -_CLOSED * self.gaps.size:
            raise _not_central_differences(f"a gap is {deepest:.3g} m")
