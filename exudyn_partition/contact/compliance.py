"""Contact through the residual flexibility: a force element without penalty parameter (method.md, section 2)."""

from __future__ import annotations

import numpy as np

from ..body import ReducedBody
from ..errors import InputError
from .complementarity import Complementarity
from .rows import ContactRows

Array = np.ndarray


class ComplianceContact:
    """Massless contact between two bodies whose bases carry a residual flexibility.

    With the modal gap h(q) = g0 + H q and the flexibility F of both bodies at the rows, the normal forces solve
    lambda >= 0, h + F lambda >= 0, lambda'(h + F lambda) = 0. They are a continuous, piecewise linear function of q and
    the gradient of the potential 1/2 lambda' F lambda, so that contact stores and returns energy but makes none.

    Parameters
    ----------
    rows : ContactRows
    slave, master : ReducedBody
    patches : (int, int)
        Which patch of each.

    Raises
    ------
    InputError
        If neither basis carries a residual flexibility.
    IndefiniteMatrixError
        If the flexibility of the rows is not positive definite.
    """

    def __init__(
        self, rows: ContactRows, slave: ReducedBody, master: ReducedBody, patches: tuple[int, int] = (0, 0)
    ) -> None:
        self.rows = rows
        bodies = (slave, master)
        for body in bodies:
            if body.basis.flexibility is None:
                raise InputError(
                    f"formulation: 'compliance' needs a residual flexibility, which basis {body.basis.name!r} does not "
                    "have; take formulation='lagrange', or basis='contact-adapted' or 'residual'"
                )
        surfaces = [body.partition.patches[i] for body, i in zip(bodies, patches, strict=True)]
        sizes = [len(patch.nodes) for patch in surfaces]
        G = rows.matrices(*sizes)
        self.H = np.hstack([g @ body.rows(p.nodes) for g, body, p in zip(G, bodies, surfaces, strict=True)])
        nc = len(rows)
        F = np.zeros((nc, nc))
        for body, i, patch, g, weights in zip(bodies, patches, surfaces, G, rows.interpolation(*sizes), strict=True):
            # Along the line of contact alone, a row's flexibility is that of its nodes.
            at_nodes = g if patch.axes == "xyz" else weights
            F += at_nodes @ body.flexibility(i) @ at_nodes.T
        self.problem = Complementarity(F)
        self.lam = np.zeros(nc)
        self._zero = np.zeros(self.H.shape[1])

    def force(self, q: Array) -> Array:
        """Generalised contact force H' lambda, (n,), on the coordinates of slave and master, q (n,)."""
        self.lam = self.problem.solve(self.rows.gap + self.H @ q)
        index = self.problem.index
        return self.lam[index] @ self.H[index] if index.size else self._zero

    def reset(self) -> None:
        """Forget the last state, before a new run."""
        self.problem.reset()
        self.lam = np.zeros(len(self.rows))

    def tangent(self) -> Array:
        """Contact stiffness -d force / d q of the present active set, (n, n): H_A' F_AA^-1 H_A."""
        H = self.H[self.problem.index]
        return H.T @ self.problem.solve_active(H) if len(H) else np.zeros((self.H.shape[1],) * 2)

    def closed_stiffness(self) -> Array:
        """Contact stiffness with all rows closed, (n, n): the stiffest that the element can be."""
        return self.H.T @ np.linalg.solve(self.problem.F, self.H)

    def potential(self, q: Array) -> float:
        """Energy stored in the contact's flexibility, 1/2 lambda' F lambda [J]."""
        lam = self.problem.solve(self.rows.gap + self.H @ q)
        return 0.5 * float(lam @ (self.problem.F @ lam))
