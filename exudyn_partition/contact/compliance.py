"""Contact through the residual flexibility: a force element without penalty parameter (method.md, section 2)."""

from __future__ import annotations

import math

import numpy as np

from ..errors import ComplementarityError
from .complementarity import Complementarity
from .gaps import Gaps

Array = np.ndarray


class ComplianceContact:
    """Massless contact between two bodies whose rows have a residual flexibility.

    With the gap h(q) of the rows, where modes and frames have brought them, and the flexibility F of both bodies at the
    rows, the normal forces solve lambda >= 0, h + F lambda >= 0, lambda'(h + F lambda) = 0. As long as pairs hold, they
    are a continuous, piecewise linear function of q and the gradient of the potential 1/2 lambda' F lambda, so that
    contact stores and returns energy but makes none.

    While pairs move, F is projected on the present normals and facets, for the rows that are no further off than the
    deepest is inside: the bulge around a contact reaches no further.

    Parameters
    ----------
    gaps : Gaps

    Raises
    ------
    IndefiniteMatrixError
        If the flexibility of the rows is not positive definite.

    Attributes
    ----------
    lam : (nr,) array
        Forces on the present rows of `gaps` [N].
    index : (na,) int array
        Those that are closed.
    """

    def __init__(self, gaps: Gaps) -> None:
        self.gaps = gaps
        self._problems: dict[int, Complementarity] = {}
        self._zero = np.zeros(gaps.n)
        self.reset()

    def reset(self) -> None:
        """Forget the last state, before a new run."""
        self.gaps.reset()
        self._held = self.gaps.held
        self.problem = Complementarity(self.gaps.flexibility(np.arange(len(self.gaps.row_nodes))))
        self._closed = np.zeros(len(self.gaps.slave.surface.points), dtype=bool)
        self._none()

    def _none(self) -> Array:
        self.lam, self.index = np.zeros(len(self.gaps.row_nodes)), np.empty(0, dtype=np.int64)
        return self._zero

    def force(self, q: Array) -> Array:
        """Generalised contact force H' lambda, (n,), on the coordinates of slave and master, q (n,)."""
        h = self.gaps.at(q)
        if self.gaps.moving:
            if not self._solve_near(h):
                return self._none()
        else:
            if self._held is not self.gaps.held:
                self._take_held()
            self.lam = self.problem.solve(h)
            self.index = self.problem.index
        self.h = h
        return self.gaps.generalised(self.lam) if self.index.size else self._zero

    def _take_held(self) -> None:
        """Go on with pairs that have been frozen anew."""
        self._held = self.gaps.held
        self.problem = Complementarity(self.gaps.flexibility(np.arange(len(self.gaps.row_nodes))))

    def _solve_near(self, h: Array) -> bool:
        deepest = h.min(initial=0.0)
        if not math.isfinite(deepest):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        if deepest >= 0.0:
            self._closed[:] = False
            return False
        near = np.flatnonzero(h < -deepest)
        nodes = self.gaps.row_nodes[near]
        self.problem.replace(self.gaps.flexibility(near), self._closed[nodes])
        self._held = None  # the frozen problem has been replaced
        self.lam = np.zeros(len(h))
        self.lam[near] = self.problem.solve(h[near])
        self.index = near[self.problem.index]
        self._closed[:] = False
        self._closed[self.gaps.row_nodes[self.index]] = True
        return True

    def tangent(self) -> Array:
        """Contact stiffness -d force / d q of the present active set, (n, n): H_A' F_AA^-1 H_A, pairs held."""
        if not self.index.size:
            return np.zeros((self.gaps.n,) * 2)
        H = self.gaps.jacobian(self.index)
        return H.T @ self.problem.solve_active(H)

    def closed_stiffness(self) -> Array:
        """Contact stiffness with all rows closed, (n, n): the stiffest that the element can be."""
        everything = np.arange(len(self.gaps.row_nodes))
        H = self.gaps.jacobian(everything)
        return H.T @ np.linalg.solve(self.gaps.flexibility(everything), H)

    def potential(self, q: Array) -> float:
        """Energy stored in the contact's flexibility, 1/2 lambda' F lambda [J]."""
        self.force(q)
        return 0.5 * float(-self.lam[self.index] @ self.h[self.index]) if self.index.size else 0.0
