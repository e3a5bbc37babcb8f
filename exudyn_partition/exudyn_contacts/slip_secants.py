"""Stiffness along slips in static runs, so that Newton's method does not shoot past an equilibrium.

Where all rows of a face slip in one direction, friction does not grow with the way, so that the stiffness along it is
zero. A block that only friction holds then moves in one iteration much further than faces slip at rest. There it may
tilt and lose contact.
"""

from __future__ import annotations

from ..support.foreign import MainSolver

_OVER = 1e-6  # relative: round-off of the lengths of load steps


class SlipSecants:
    """Share of the secants of friction, forces by ways, in the Jacobian, beside its tangents.

    Secants lead to the equilibrium surely, tangents quickly once it is near: what friction dissipates is a sum of
    lengths, which Weiszfeld's iteration minimises by secants. See `Evaluation.slip_secants`.

    Parameters
    ----------
    lasting : bool
        How long secants last. Where no load step has settled, their share is one at first and wherever the residual
        has grown, and falls with its square root. Else it is the residual over the largest one of the load step: a
        body that slides on all its contacts gets in a few iterations to where rows stick, and not far past that.
        Such secants go when the load step is divided, and come again at the next division: a table whose legs slip a
        little settles by tangents alone.

    References
    ----------
    E. Weiszfeld, F. Plastria, On the point for which the sum of the distances to n given points is minimum, Annals of
    Operations Research 167 (2009) 7.
    """

    def __init__(self, *, lasting: bool = True) -> None:
        self._lasting, self._share, self._residual, self._largest = lasting, 1.0, 0.0, 0.0
        self._acts, self._length = True, 0.0

    def share(self, solver: MainSolver) -> float:
        """Share in the iteration of Newton's method that the static solver begins now; none in the first."""
        residual, first = solver.conv.residual, solver.it.newtonSteps == 1
        falls = 0.0 < residual < self._residual and not first
        self._largest = residual if first else max(self._largest, residual)
        self._share = self._share * (residual / self._residual) ** 0.5 if falls else 1.0
        self._residual = residual
        if first:
            divided, self._length = solver.it.currentStepSize < (1 - _OVER) * self._length, solver.it.currentStepSize
            self._acts = self._lasting or self._acts != divided
        if first or not self._acts:
            return 0.0
        return self._share if self._lasting or not self._largest else residual / self._largest
