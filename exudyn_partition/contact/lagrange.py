"""Contact by Lagrange multipliers on nodal coordinates, forward-increment central differences (paper, eq. 27-29)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..body import ReducedBody
from ..errors import InputError, RunError
from .complementarity import Complementarity
from .rows import ContactRows

Array = np.ndarray


_CLOSED = 1e-6  # of a facet's size: central differences close gaps to round-off


def _not_central_differences(reason: str) -> RunError:
    return RunError(
        f"{reason}: contact with formulation 'lagrange' needs Exudyn's explicit solver VelocityVerlet with a constant "
        "step (solve_dynamic(..., method='explicit'))"
    )


class LagrangeContact:
    """Multipliers of the paper's basis, chosen so that no gap is closed further than zero at the end of the step.

    Eq. 24 alone, relative acceleration zero, keeps the approach velocity of a node that has just touched, which then
    drifts into penetration. Here lambda_n >= 0 makes g(q_{n+1}) >= 0, complementary: the forward-increment form
    (Carpenter, Taylor, Katona 1991) of the same central differences.

    Parameters
    ----------
    rows : ContactRows
    slave, master : ReducedBody
    patches : (int, int)
        Which patch of each.

    Raises
    ------
    InputError
        If a basis gives its patch a residual flexibility instead of coordinates with mass.
    """

    def __init__(
        self, rows: ContactRows, slave: ReducedBody, master: ReducedBody, patches: tuple[int, int] = (0, 0)
    ) -> None:
        self.rows = rows
        bodies = (slave, master)
        for body in bodies:
            if body.basis.flexibility is not None:
                raise InputError(
                    f"formulation: 'lagrange' needs a contact patch that moves by coordinates with mass, which basis "
                    f"{body.basis.name!r} does not have; take formulation='compliance', or basis='free'"
                )
        nodes = [body.partition.patches[i].nodes for body, i in zip(bodies, patches, strict=True)]
        G = rows.matrices(*map(len, nodes))
        self.G = sp.hstack(
            [sp.csr_matrix(g @ body.rows(n)) for g, body, n in zip(G, bodies, nodes, strict=True)],
            format="csr",
        )
        inverse_mass = 1 / np.concatenate([body.mass.diagonal() for body in bodies])
        self.push = sp.csr_matrix(self.G.multiply(inverse_mass)).T.tocsr()
        self.problem = Complementarity((self.G @ self.push).toarray())
        self.lam = np.zeros(len(rows))
        self._expected: Array | None = None

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
        gap = self.rows.gap + self.G @ (q + step * q_t + 0.5 * step**2 * q_tt)
        self.lam = self.problem.solve(gap / step**2)
        if not self.problem.index.size:
            self._expected = None
            return None
        closing = step**2 * (self.problem.F @ self.lam)
        self._expected, self._scale = gap + closing, abs(closing).max()
        return self.push @ self.lam

    def _check_last_step(self, q: Array) -> None:
        """Refuse to go on if the last step did not do with the multipliers what central differences do."""
        if self._expected is None:
            return
        gap = self.rows.gap + self.G @ q
        if abs(gap - self._expected).max() > 1e-3 * self._scale + 1e-12 * abs(q).max():
            raise _not_central_differences("the last step did not close the gaps as predicted")

    def check_gaps(self, q: Array) -> None:
        """Refuse coordinates in which a gap is closed further than zero."""
        gap = self.rows.gap + self.G @ q
        if gap.min() < -_CLOSED * self.rows.facet_size:
            raise _not_central_differences(f"a gap is {gap.min():.3g} m")

    def reset(self) -> None:
        """Forget the last step, before a new run."""
        self._expected = None
        self.lam = np.zeros(len(self.rows))
        self.problem.reset()
