"""Forces on contact rows that move each other: complementarity in d = 1 direction a row, with friction in d = 3."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array
from .complementarity import Complementarity
from .friction import FrictionProblem


class RowProblem:
    """Forces lambda on rows whose places are h + F lambda, see `Complementarity` and `FrictionProblem`.

    Parameters
    ----------
    d : {1, 3}
        Directions a row: its normal, or the normal and two tangents.
    F : (d nr, d nr) array
        Flexibility of the rows, symmetric positive definite.

    Raises
    ------
    IndefiniteMatrixError
        If F is not symmetric positive definite.
    """

    def __init__(self, d: int, F: Array) -> None:
        self.d = d
        self._normal = Complementarity(F) if d == 1 else None
        self._frictional = FrictionProblem(F) if d == 3 else None

    @property
    def F(self) -> Array:
        """Flexibility of the rows, (d nr, d nr)."""
        return self._problem.F

    @property
    def iterations(self) -> int:
        """Iterations so far."""
        return self._problem.iterations

    @property
    def _problem(self) -> Complementarity | FrictionProblem:
        problem = self._normal or self._frictional
        assert problem is not None
        return problem

    @property
    def index(self) -> Array:
        """Rows that were closed in the last answer, (na,)."""
        return self._problem.index

    @property
    def state(self) -> Array | None:
        """With friction, whether each row is OPEN, sticks or slips in the last answer, (nr,) int8."""
        return None if self._frictional is None else self._frictional.state

    def replace(self, F: Array, state: Array, forces: Array) -> None:
        """Go on with other rows: their F, which is not checked, and guesses of their state, (nr,), and forces.

        `forces`, (nr, 3), are of no use without friction.
        """
        if self._frictional is not None:
            self._frictional.replace(F, state, forces)
        else:
            assert self._normal is not None
            self._normal.replace(F, np.asarray(state) > 0)

    def exchange(self, F: Array) -> None:
        """Go on with the same rows, whose flexibility is now F."""
        if self._frictional is not None:
            self._frictional.replace(F, self._frictional.state, self._frictional.lam)
        else:
            assert self._normal is not None
            self._normal.replace(F, self._normal.active)

    def solve(self, h: Array, mu: Array) -> Array:
        """Return the forces, (nr, d).

        Parameters
        ----------
        h : (nr, d) array
            Places of the rows without the forces.
        mu : (nr,) array
            Coefficients of friction; without friction they are not used.

        Raises
        ------
        ComplementarityError
            If h is not finite, or no solution was found.
        """
        if self._frictional is not None:
            return self._frictional.solve(h, mu)
        assert self._normal is not None
        return self._normal.solve(h[:, 0])[:, None]

    def moved_by(self, forces: Array) -> Array:
        """How far forces, (nr, d), move the rows, F lambda, (nr, d)."""
        return (self.F @ forces.ravel()).reshape(-1, self.d)
