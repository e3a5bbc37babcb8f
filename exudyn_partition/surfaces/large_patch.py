"""Flexibility of a large contact patch by few solutions: exact between near nodes, interpolated between far ones.

The displacement that a force makes far away depends smoothly on the place of the force. So exact answers to forces on
coarse nodes, some two nodes apart, are interpolated for all other forces, as far as they act on distant nodes.

Near a force the answer is exact but for round-off and what is left of that interpolation: many forces, far from each
other, act in one solution, and the interpolated answers to all but the nearest one are subtracted (probing with
colours; compare Lin, Lu and Ying 2011, Fast construction of hierarchical matrices from matrix-vector products).
"""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from ..support.arrays import Array

_LOG = logging.getLogger(__name__)

FEWEST = 1000  # nodes from which it pays
_COARSE = 2.0  # distance of coarse nodes, by that of nodes
_NEAR = 5.0  # of the distance of coarse nodes: pairs of nodes that are nearer are exact
_SUPPORT = 14  # coarse nodes from which an answer is interpolated
_SAME_SIDE = 0.5  # cosine between normals of nodes that are interpolated from each other
PAYS = 0.6  # of all solutions: if more are needed, all are made

Answers = Callable[[sp.csr_matrix], Array]  # combinations of unit loads, (m, r), to displacements of rows, (r, m)


def large_flexibility(points: Array, normals: Array, n_axes: int, answers: Answers) -> Array | None:
    """Symmetric flexibility of the rows of k nodes, (n_axes k, n_axes k) [m/N]; None if few solutions are not enough.

    Parameters
    ----------
    points, normals : (k, 3) arrays
        Of the nodes.
    n_axes : int
        Rows of each node.
    answers : callable
        Takes combinations of the rows' unit loads, (m, n_axes k), and returns the displacements of all rows,
        (n_axes k, m) [m/N].
    """
    k = len(points)
    if k < FEWEST:
        return None
    spacing = float(np.median(cKDTree(points).query(points, k=5)[0][:, 1:].mean(axis=1)))
    coarse = _spread(points, _COARSE * spacing)
    reach = _NEAR * _COARSE * spacing
    colours = _colours(points, 2 * reach, coarse)
    count = len(coarse) + colours.max(initial=-1) + 1
    if count > PAYS * k:
        return None
    _LOG.info("patch of %d nodes: %d coarse ones, %d solutions an axis", k, len(coarse), count)
    axes = np.arange(n_axes)
    at_coarse = (n_axes * coarse[:, None] + axes).ravel()
    unit = sp.identity(n_axes * k, format="csr")
    exact = answers(unit[at_coarse])
    far = exact @ sp.kron(_interpolation(points, normals, coarse), sp.identity(n_axes), format="csr").T
    F = far.copy()
    probed = np.flatnonzero(colours >= 0)
    of_colours = sp.csr_matrix((np.ones(len(probed)), (colours[probed], probed)), shape=(colours.max() + 1, k))
    loads = sp.kron(of_colours, sp.identity(n_axes), format="csr")
    # What the answers to all forces of a colour lack of the interpolated ones belongs to the nearest force.
    rest = answers(loads) - far @ loads.T
    for node, around in zip(probed, cKDTree(points).query_ball_point(points[probed], reach), strict=True):
        rows = (n_axes * np.asarray(around)[:, None] + axes).ravel()
        columns = n_axes * colours[node] + axes
        F[np.ix_(rows, n_axes * node + axes)] += rest[np.ix_(rows, columns)]
    F = (F + F.T) / 2
    F[:, at_coarse] = exact
    F[at_coarse] = exact.T
    return np.asarray(F)


def _spread(points: Array, distance: float) -> Array:
    """Numbers of points at least a distance apart that cover all, (m,): each is the furthest from those before."""
    chosen = [0]
    away = np.linalg.norm(points - points[0], axis=1)
    while away.max() > distance:
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


def _colours(points: Array, distance: float, left_out: Array) -> Array:
    """Colours of points, (k,) int, of which equal ones are a distance apart; -1 for those that are left out."""
    colours = np.full(len(points), -1)
    skipped = np.zeros(len(points), dtype=bool)
    skipped[left_out] = True
    for node, around in enumerate(cKDTree(points).query_ball_point(points, distance)):
        if not skipped[node]:
            used = np.zeros(len(around) + 1, dtype=bool)
            taken = colours[around]
            used[taken[(taken >= 0) & (taken < len(used))]] = True
            colours[node] = int(used.argmin())
    return colours


def _interpolation(points: Array, normals: Array, coarse: Array) -> sp.csr_matrix:
    """Weights of coarse nodes, (k, m), that give quadratic functions on the surface exactly, nearer ones more."""
    m = len(coarse)
    support = min(_SUPPORT, m)
    _, nearest = cKDTree(points[coarse]).query(points, k=support)
    nearest = nearest.reshape(len(points), support)
    weights = np.zeros(nearest.shape)
    for node, some in enumerate(nearest):
        some = coarse[some]
        aside = points[some] - points[node]
        across = np.linalg.svd(normals[node][None])[2][1:]
        u, v = across @ aside.T
        size = np.hypot(u, v).max() or 1.0
        u, v = u / size, v / size
        close = np.exp(-4 * (u**2 + v**2)) * (normals[some] @ normals[node] > _SAME_SIDE)
        P = np.column_stack([np.ones(support), u, v, u * u, u * v, v * v])
        weights[node] = np.linalg.pinv(close[:, None] * P, rcond=1e-6)[0] * close
    at = np.repeat(np.arange(len(points)), support)
    W = sp.csr_matrix((weights.ravel(), (at, nearest.ravel())), shape=(len(points), m)).tolil()
    W[coarse] = 0
    W[coarse, np.arange(m)] = 1.0
    return W.tocsr()
