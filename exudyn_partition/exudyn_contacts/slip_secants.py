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
    lengths, which Weiszfeld's iteration minimises by secants. So their share is the residual over the largest one of
    the load step. No iteration then moves a body by much more than the ways so far: a body that may slide freely,
    since opposed slips leave it no stiffness, gets to where rows stick in a few iterations, and does not shoot past.
    See `Evaluation.slip_secants`.

    References
    ----------
    E. Weiszfeld, F. Plastria, On the point for which the sum of the distances to n given points is minimum, Annals of
    Operations Research 167 (2009) 7.
    """

    def __init__(self) -> None:
        self._largest = 0.0

    def share(self, solver: MainSolver) -> float:
        """Share in the iteration of Newton's method that the static solver begins now; none in the first."""
        residual, first = solver.conv.residual, solver.it.newtonSteps == 1
        self._largest = residual if first else max(self._largest, residual)
        if first:
            return 0.0
        return residual / self._largest if self._largest else 1.0
