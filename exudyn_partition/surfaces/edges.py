"""Weights of integrated rows beside sharp edges of a patch.

A mean around a node at a sharp edge closes long after the edge touches: a cube that falls on its corner would sink in
by a tenth of a facet. So a node there has a row that is its own gap. The hat functions of the nodes at edges are shared
among the other nodes of the same facet. Weights of these rows then sum up to one as before, so that they still carry an
even pressure, with no force on the edges. Mortar methods do the same at the ends of interfaces.

References
----------
C. Bernardi, Y. Maday, A.T. Patera, A new nonconforming approach to domain decomposition: the mortar element method,
1994.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..support.arrays import Array


def beside_edges(hats: sp.csr_matrix, facets: sp.csc_matrix, area: Array, sharp: Array) -> sp.csr_matrix:
    """Hat functions without those at sharp edges, which are shared among the other nodes of the same facet.

    Shares are as the overlaps of hats. They stay zero on a facet all of whose nodes are at edges.

    Parameters
    ----------
    hats : (np, p) csr matrix
        Hats of the nodes at the points, times `area`.
    facets : (nf, p) csc matrix
        Whether each facet has each point.
    area : (p,) array
        Area of each point [m2].
    sharp : (k,) int array
        The nodes at edges.

    Returns
    -------
    (np, p) csr matrix
        As `hats`; empty rows for the nodes at edges.
    """
    inside = np.ones(hats.shape[0])
    inside[sharp] = 0.0
    others, at_edges = sp.diags(inside) @ hats, np.asarray(hats[sharp].sum(axis=0)).ravel()
    overlap = others @ sp.diags(at_edges / area) @ facets.T
    total = np.asarray(overlap.sum(axis=0)).ravel()
    shares = overlap @ sp.diags(np.divide(1.0, total, out=np.zeros(len(total)), where=total > 0))
    found = sp.csr_matrix(others + shares @ facets @ sp.diags(at_edges))
    found.eliminate_zeros()
    return found
