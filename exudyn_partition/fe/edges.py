"""Edges between the facets of a patch: middles, neighbours across them, and which are sharp."""

from __future__ import annotations

import math

import numpy as np

from ..support.arrays import Array
from .facets import area_vectors, facet_corners
from .shapes import corners_of, shape_functions

_SHARP = math.cos(math.radians(30))  # between the normals on both sides of an edge: below, the edge is sharp
_FLAT = math.cos(1e-3)  # between the normals of two facets: above, they are coplanar but for round-off in files


def edge_middles(facets: Array) -> Array:
    """Local coordinates of the middles of a facet's edges, (number of edges, 2)."""
    corners = corners_of(facets)
    return (corners + np.roll(corners, -1, axis=0)) / 2


def neighbours_across(facets: Array) -> tuple[Array, Array]:
    """Neighbour across each facet's edges 01, 12, ..., and the number of the shared edge in the neighbour.

    Two (nf, number of edges) arrays; the neighbour is -1 where there is none.
    """
    corners = facet_corners(facets)
    edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    order = np.lexsort(edges.T)
    same = np.flatnonzero((edges[order[1:]] == edges[order[:-1]]).all(axis=1))
    twin = np.full(len(edges), -1)
    twin[order[same]], twin[order[same + 1]] = order[same + 1], order[same]
    facet, edge = np.divmod(twin, corners.shape[1])
    return facet.reshape(corners.shape), edge.reshape(corners.shape)


def sharp_edges(points: Array, facets: Array) -> tuple[Array, Array]:
    """Facets with convex edges at which the surface turns by more than 30 degrees, (k,), and the edges' numbers, (k,).

    Each edge is there twice, in both facets. Normals are those of the curved facets at the middle of their edge, so
    that coarse meshes of round bodies have no sharp edges. Facets of both shapes are in halves, see `halves`.
    """
    facet, edge, turns, convex = _turning(points, facets)
    return facet[turns & convex], edge[turns & convex]


def flat_facets(points: Array, facets: Array) -> Array:
    """Whether the surface is flat from a facet to those beside it, (nf,) bool; faces end at edges of 30 degrees."""
    facet, edge, turns, _ = _turning(points, facets)
    normals = area_vectors(points, facets)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    neighbour = neighbours_across(facets)[0][facet, edge]
    bends = ~turns & (np.einsum("kd,kd->k", normals[facet], normals[neighbour]) < _FLAT)
    flat = np.ones(len(facets), dtype=bool)
    flat[facet[bends]] = False
    return flat


def _turning(points: Array, facets: Array) -> tuple[Array, Array, Array, Array]:
    """Facets and their edges where another one follows, (k,) each, where it turns by 30 degrees, and where outwards."""
    across, its_edge = neighbours_across(facets)
    shape = shape_functions(edge_middles(facets), facets.shape[1])
    place, a, b = np.einsum("ein,fnd->ifed", shape, points[facets])
    normals = np.cross(a, b)
    normals /= np.maximum(np.linalg.norm(normals, axis=2), 1e-300)[:, :, None]
    facet, edge = np.nonzero(across >= 0)
    neighbour, normal = across[facet, edge], normals[facet, edge]
    turns = np.einsum("kd,kd->k", normal, normals[neighbour, its_edge[facet, edge]]) < _SHARP
    away = points[facet_corners(facets[neighbour])].mean(axis=1) - place[facet, edge]
    return facet, edge, turns, np.einsum("kd,kd->k", normal, away) < 0


def sharp_nodes(points: Array, facets: Array) -> Array:
    """Nodes on `sharp_edges`, ascending, (k,)."""
    facet, edge = sharp_edges(points, facets)
    nodes, across = facets[facet], facets[neighbours_across(facets)[0][facet, edge]]
    return np.unique(nodes[(nodes[:, :, None] == across[:, None, :]).any(axis=2)])
