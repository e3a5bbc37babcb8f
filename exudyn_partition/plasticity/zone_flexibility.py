"""Residual flexibility of the nodes of a plastic zone, without a solution for each of them.

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ..algebra.sparse.flexibility import FreeBodyFlexibility
from ..support.arrays import Array
from ..support.checks import check_floats, read_only


@dataclass(frozen=True, eq=False)
class ZoneFlexibility:
    """Flexibility of a zone [m/N], of all motion or of what the kept shapes leave.

    Parameters
    ----------
    own : (3 nz, 3 nz) array
        Displacements of the zone's nodes by forces there.
    of_patch : (3 nz, r) array
        Displacements of the zone's nodes by forces on the rows of the zone's patch.
    """

    own: Array
    of_patch: Array

    def __post_init__(self) -> None:
        check_floats("own", self.own, (len(self.own),) * 2)
        check_floats("of_patch", self.of_patch, (len(self.own), None))
        read_only(self.own, self.of_patch)

    def without(self, at_zone: Array, at_patch: Array, omega: Array) -> ZoneFlexibility:
        """Return what is left without the static answer of shapes: F - Phi W^-2 Phi'.

        Parameters
        ----------
        at_zone, at_patch : (3 nz, k), (r, k) arrays
            Mass-normalised shapes.
        omega : (k,) array
            Their circular frequencies [rad/s].
        """
        by_force = at_zone / omega**2
        return ZoneFlexibility(self.own - by_force @ at_zone.T, self.of_patch - by_force @ at_patch.T)


def selection(dofs: Array, n: int) -> sp.csr_matrix:
    """Rows, (k, n), that select k of n dofs."""
    return sp.csr_matrix((np.ones(len(dofs)), dofs, np.arange(len(dofs) + 1)), shape=(len(dofs), n))


def zone_answers(flexibility: FreeBodyFlexibility, stiffness: sp.csr_matrix, dofs: Array) -> Array:
    """Elastic displacements of some dofs of a free body by unit forces on them, (k, k) [m/N].

    Only the edge of the zone needs the body's factors. Within it, elements touch no others, so that with C the inverse
    stiffness of the held body, b the edge and i the inside,

        C_ib = X C_bb,    C_ii = K_ii^-1 + C_ib X',    X = -K_ii^-1 K_ib.

    Parameters
    ----------
    flexibility : FreeBodyFlexibility
    stiffness : (n, n) csr matrix
        Of the free body.
    dofs : (k,) int array
    """
    inside_zone = np.zeros(stiffness.shape[0], dtype=bool)
    inside_zone[dofs] = True
    rows = stiffness[dofs]
    coupled = np.asarray(abs(rows) @ (~inside_zone).astype(float)).ravel() > 0
    held = ~np.isin(dofs, flexibility.free)
    edge, inner = np.flatnonzero(coupled & ~held), np.flatnonzero(~coupled & ~held)
    K = rows[:, dofs]
    inverse = scipy.linalg.cho_solve(
        scipy.linalg.cho_factor(K[inner][:, inner].toarray()), np.eye(len(inner)), overwrite_b=True
    )
    X = -inverse @ K[inner][:, edge].toarray()
    of_dofs = selection(dofs, stiffness.shape[0])
    at_edge = flexibility.held_at(of_dofs[edge])
    C = np.zeros((len(dofs),) * 2)
    C[np.ix_(edge, edge)] = at_edge
    C[np.ix_(inner, edge)] = X @ at_edge
    C[np.ix_(edge, inner)] = C[np.ix_(inner, edge)].T
    C[np.ix_(inner, inner)] = inverse + C[np.ix_(inner, edge)] @ X.T
    own: Array = flexibility.balanced(C, of_dofs)
    return (own + own.T) / 2
