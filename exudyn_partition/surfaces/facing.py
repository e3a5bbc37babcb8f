"""Which facets of a master points meet: the closest ones that face them, with a tolerance at the edges of faces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ..fe.facets import area_vectors
from ..support.arrays import Array
from . import loops
from .projection import Projection
from .surface import Surface, closest_points, nearest_places

EDGE_TOLERANCE = 0.02  # of a facet's size: a point that projects past the edge of a face by less is paired with it
LOCALLY, ALONG_LINE = 0.5, 0.9  # points meet if the cosine between their normal, or the line of contact, and the
# master's inward normal is above
PENETRATION_TOLERANCE = 1e-4  # of a facet's size: round-off and the faceting of curved surfaces
_BESIDE = 1e-6  # of a facet's size: round-off of a point that lies on the face beside an edge
_NEARLY = 0.4  # as LOCALLY, of points' normals that are rounded to tenths
_AROUND = 24  # facets that are tried for points beside a sharp edge, nearest centroids first


def facing(projection: Projection, normals: Array, size: float, above: float = LOCALLY) -> Array:
    """Which points meet the surface that they were projected on, (k,) bool: neither past its edge nor too oblique.

    Parameters
    ----------
    projection : Projection
        Of k points.
    normals : (k, 3) or (3,) array
        Outward unit normals of their body there, or one for all.
    size : float
        Of the master's facets [m].
    above : float
        Least cosine between the master's inward normal and the points' normals.
    """
    return (projection.offset <= EDGE_TOLERANCE * size) & opposite(projection.normal, normals, above)


def closest_met(places: Array, normals: Array, master: Surface) -> Projection:
    """Project points on a surface, where faces meet at sharp edges and in thin walls on the face that they come from.

    A point just past a sharp edge is nearest to the face beside the edge, by round-off where bodies are flush. It is
    projected on the face that faces it, if that is hardly further away. But a point outside beside the edge is not
    taken as one inside, as below a body that stands on its edge. A point that has passed half the thickness of a wall
    is nearest to the wall's back, which looks the way of its body. It is projected on the facets that face it. So is a
    point of a tongue in a slot that is nearest to the slot's other side.

    Parameters
    ----------
    places : (k, 3) array
        Points [m].
    normals : (k, 3) or (3,) array
        Outward unit normals of their body there, or one for all.
    master : Surface
    """
    found = closest_points(places, master.points[master.facets])
    aside = np.flatnonzero(~opposite(found.normal, normals))
    if len(aside):
        some = np.broadcast_to(normals, places.shape)[aside]
        _put_beside_edges(found, aside, places[aside], some, master)
        _put_within_walls(found, aside, places[aside], some, master)
        _put_across_slots(found, aside, places[aside], some, master)
    return found


def opposite(outward: Array, normals: Array, above: float = LOCALLY) -> Array:
    """Which normals of the master, (k, 3), are opposite to those of points, (k, 3) or (3,)."""
    return np.asarray((outward * normals).sum(axis=-1) < -above)


def _put_beside_edges(found: Projection, aside: Array, places: Array, normals: Array, master: Surface) -> None:
    """Put projections on facets that face their points, of those `aside` that pass a sharp edge by the tolerance."""
    at_edges = np.asarray(np.isin(master.facets, master.sharp).any(axis=1))
    some = np.flatnonzero(at_edges[found.facet[aside]])
    if not len(some):
        return
    index, places, normals = aside[some], places[some], normals[some]
    tried, before = _on_facing(places, normals, master, np.flatnonzero(at_edges)), found.part(index)
    further = np.hypot(tried.gap, tried.offset) - np.hypot(before.gap, before.offset)
    size = master.facet_size
    right = (tried.gap >= -PENETRATION_TOLERANCE * size) | (before.gap <= _BESIDE * size)
    taken = np.flatnonzero(facing(tried, normals, size) & (further <= EDGE_TOLERANCE * size) & right)
    found.put(index[taken], tried.part(taken))


def _on_facing(places: Array, normals: Array, master: Surface, few: Array) -> Projection:
    """Project points on the nearest of some facets, few (m,) int array, that face them, of those close to them."""
    facets = master.points[master.facets[few]]
    outward = area_vectors(master.points, master.facets[few])
    outward /= np.maximum(np.linalg.norm(outward, axis=1), 1e-300)[:, None]
    near = nearest_places(cKDTree(facets.mean(axis=1)), places, min(_AROUND, len(few)))
    faces = opposite(outward[near], normals[:, None])
    first = near[np.arange(len(near)), faces.argmax(axis=1)]
    centre = facets.mean(axis=(0, 1))  # reduces round-off, as in `closest_points`
    tried = loops.closest(places - centre, facets - centre, np.where(faces, near, first[:, None]))
    return replace(tried, facet=few[tried.facet])


def _put_within_walls(found: Projection, aside: Array, places: Array, normals: Array, master: Surface) -> None:
    """Put projections on facets that face their points, of those `aside` that are nearest to the back of a wall."""
    now = found.part(aside)
    on_back = np.flatnonzero((now.gap < 0.0) & ((now.normal * normals).sum(axis=1) > LOCALLY))
    if not len(on_back):
        return
    outward = area_vectors(master.points, master.facets)
    length = np.linalg.norm(outward, axis=1)
    fronts = np.flatnonzero(outward @ normals[on_back].mean(axis=0) < -LOCALLY * length)
    if len(fronts):
        front = closest_points(places[on_back], master.points[master.facets[fronts]])
        found.put(aside[on_back], replace(front, facet=fronts[front.facet]))


def _put_across_slots(found: Projection, aside: Array, places: Array, normals: Array, master: Surface) -> None:
    """Put projections on facets in front of their points, of those `aside` that are in front of another face.

    In a slot that is narrower than its facets, a tongue moves from one side to the other before points are searched
    again. So the points that face the far side have to be known while the near side is nearer to them.
    """
    now, size = found.part(aside), master.facet_size
    outside = np.flatnonzero((now.gap >= -_BESIDE * size) & ~opposite(now.normal, normals))
    if not len(outside):
        return
    outward, some = area_vectors(master.points, master.facets), normals[outside]
    ways = np.unique(some.round(1), axis=0)  # nearly the same as theirs, and fewer
    fronts = np.flatnonzero((outward @ ways.T).min(axis=1) < -_NEARLY * np.linalg.norm(outward, axis=1))
    if not len(fronts):
        return
    tried = _on_facing(places[outside], some, master, fronts)
    taken = np.flatnonzero(facing(tried, some, size) & (tried.gap >= -_BESIDE * size) & (tried.gap <= size))
    found.put(aside[outside[taken]], tried.part(taken))
