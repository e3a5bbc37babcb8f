"""Contact through the residual flexibility: a force element without penalty parameter (method.md, section 2)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

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

    Raises
    ------
    InputError
        If neither basis carries a residual flexibility.
    IndefiniteMatrixError
        If the flexibility of the rows is not positive definite.
    """

    def __init__(self, rows: ContactRows, slave: ReducedBody, master: ReducedBody) -> None:
        self.rows = rows
        bodies = (slave, master)
        for body in bodies:
            if body.basis.flexibility is None:
                raise InputError(
                    f"formulation: 'compliance' needs a residual flexibility, which basis {body.basis.name!r} does not "
                    "have; take formulation='lagrange', or basis='contact-adapted' or 'residual'"
                )
        patches = [body.partition.patch_nodes for body in bodies]
        G = rows.matrices(*map(len, patches))
        self.H = np.hstack([g @ body.rows(nodes) for g, body, nodes in zip(G, bodies, patches, strict=True)])
        nc = len(rows)
        at_slave = sp.csr_matrix((np.ones(nc), (np.arange(nc), rows.slave)), shape=(nc, len(patches[0])))
        at_master = sp.csr_matrix(
            (rows.weights.ravel(), (np.repeat(np.arange(nc), rows.master.shape[1]), rows.master.ravel())),
            shape=(nc, len(patches[1])),
        )
        F = sum(w @ body.basis.flexibility @ w.T for w, body in zip((at_slave, at_master), bodies, strict=True))
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
