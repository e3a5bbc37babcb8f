"""Stiffness along slips in static runs, so that Newton's method does not shoot past an equilibrium.

Where all rows of a face slip in one direction, friction does not grow with the way, so that the stiffness along it is
zero. A block that only friction holds then moves in one iteration much further than faces slip at rest. There it may
tilt and lose contact.
"""

from __future__ import annotations

from ..support.foreign import MainSolver


class SlipSecants:
    """Share of the secants of friction, forces by ways, in the Jacobian, beside its tangents.

    Secants lead to the equilibrium surely, tangents quickly once it is near: what friction dissipates is a sum of
    lengths, which Weiszfeld's iteration minimises by secants. So their share is one at first and wherever the residual
    has grown, and falls with its square root. See `PatchContact.slip_secants`.

    References
    ----------
    E. Weiszfeld, F. Plastria, On the point for which the sum of the distances to n given points is minimum, Annals of
    Operations Research 167 (2009) 7.
    """

    def __init__(self) -> None:
        self._share, self._residual = 1.0, 0.0

    def share(self, solver: MainSolver) -> float:
        """Share in the iteration of Newton's method that the static solver begins now; none in the first."""
        residual, first = solver.conv.residual, solver.it.newtonSteps == 1
        falls = 0.0 < residual < self._residual and not first
        self._share = self._share * (residual / self._residual) ** 0.5 if falls else 1.0
        self._residual = residual
        return 0.0 if first else self._share
