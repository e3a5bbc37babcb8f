"""Smooth faces of a contact patch, each with its true surface: where a contact may touch at points of its own.

A face is grown from a facet: a surface through the corners around it takes all facets on which it lies.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..algebra.vectors import cross
from ..errors import InputError
from ..fe.facets import area_vectors, facet_corners
from ..reduction.body import ReducedBody
from ..support.arrays import Array
from .rigid import RigidPlane
from .side import Side
from .true_surface import TrueSurface, not_known, surface_of

ORDERS = {6: 2, 10: 3}  # of elements, by the nodes of their facets
_RINGS = (2, 1)  # of facets around one, through which a surface is looked for
_GROWN = 10  # most times that a face is grown and its surface found anew
_WIDE = 4.0  # facets by whose sagitta corners may lie beside the surface
_ROUNDING = 1e-6  # of a face's size: by how much they may do so at least
_ALONG = 0.7  # cosine between the normals of a facet and of the surface on which it lies
_GOES_ON = 0.985  # cosine between the normals of two surfaces where one goes on as the other
_BENT = 0.85  # the same of facets that lie on no known surface
_AS_NEAR = 1 + 1e-9  # square of distances from parts of a seam that are the same
_NONE = 1e-6  # of the length of such parts: distance from the seam that is none
_REACH = 2.0 + 1e-9  # square of the distance by a facet's size, above which a line does not meet it within its size
_BESIDE = 0.8  # of the length of such parts: within it, the seam decides which face has a point
_PARTS, _STEPS = 8, 3  # of an edge on a seam, and steps of Newton's method to its true place
_ASIDE, _ENDS = 0.5, 0.05  # of an edge's length: how far the seam may be beside it, and its ends
_FAILED = 60  # facets around which no surface is found, after which nobody looks for more
_KNOWN: WeakKeyDictionary[ReducedBody, dict[int, Faces]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class SmoothFace:
    """A face of a patch.

    Parameters
    ----------
    surface : TrueSurface
    points : (np, 3) array
        Nodes of the patch, in the axes of its body [m].
    facets : (nf, n) int array
        Its facets, by nodes of the patch.
    beside : (nb, n) int array
        Facets of the patch with which the surface goes on beyond it without an edge.
    seam : (m, 2, 3) array
        Ends of parts of the line between it and those [m].
    outside : (m, 3) array
        Directions across these parts, away from the face.
    neighbours : list of SmoothFace
        Known faces with which it has a seam.
    """

    surface: TrueSurface
    points: Array
    facets: Array
    beside: Array
    seam: Array
    outside: Array
    neighbours: list[SmoothFace] = field(default_factory=list)

    @cached_property
    def around(self) -> Array:
        """Facets on which a force near the face is spread."""
        return np.concatenate([self.facets, self.beside])

    def from_seam(self, point: Array) -> float:
        """Distance of a point, (3,), from the seam [m]; infinite without one."""
        return float(np.linalg.norm(self._on_seam(point) - point, axis=1).min(initial=math.inf))

    def beyond(self, point: Array, outward: Array) -> tuple[float, Array]:
        """Distance of a point, (3,), from the seam along a surface with an outward normal there [m], and its direction.

        It is below zero on the face itself. The direction is that of its growth, (3,).
        """
        edges = self.seam - point
        edges = edges - (edges @ outward)[..., None] * outward
        start, way = edges[:, 0], edges[:, 1] - edges[:, 0]
        square = np.einsum("md,md->m", way, way)  # zero of a part along the normal, as of a box's other faces
        share = np.einsum("md,md->m", -start, way) / np.maximum(square, _NONE**2 * self._part**2)
        away = -start - np.clip(share, 0.0, 1.0)[:, None] * way
        square = np.einsum("md,md->m", away, away)
        nearest = square <= square.min() * _AS_NEAR
        to_outside = self.outside[nearest].sum(axis=0)
        distance = math.sqrt(square.min())
        if distance <= _NONE * self._part:  # whose direction would be round-off
            return 0.0, to_outside / np.linalg.norm(to_outside)
        direction = away[nearest][0] / distance
        sign = 1.0 if float(to_outside @ direction) >= 0.0 else -1.0
        return sign * distance, sign * direction

    def nearest_on_seam(self, point: Array) -> Array:
        """Place of the surface on the seam that is nearest to a point, (3,) [m]."""
        on_seam = self._on_seam(point)
        nearest = on_seam[np.linalg.norm(on_seam - point, axis=1).argmin()]
        gap, normal = self.surface.shape.project(nearest[None])
        return np.asarray(nearest - gap[0] * normal[0])

    def _on_seam(self, point: Array) -> Array:
        """Nearest place on each edge of the seam, (m, 3) [m]."""
        start, way = self.seam[:, 0], self.seam[:, 1] - self.seam[:, 0]
        share = np.einsum("md,md->m", point - start, way) / np.einsum("md,md->m", way, way)
        return np.asarray(start + np.clip(share, 0.0, 1.0)[:, None] * way)

    def holds(self, point: Array, normal: Array) -> bool:
        """Whether a point of the surface, with an outward unit normal, lies on this face, and not on those beside it.

        Where no facet is, as beyond the patch, the face has the point, unless that is beyond the seam.
        """
        distance = self.beyond(point, normal)[0] if len(self.seam) else -math.inf
        if abs(distance) < _BESIDE * self._part:
            return distance <= 0.0
        over, height = self._over(point, normal)
        return bool(over[height.argmin()] < len(self.facets)) if len(over) else distance <= 0.0

    def covers(self, point: Array, normal: Array) -> bool:
        """Whether facets of this face, or of those beside it, lie at a point of the surface; see `holds`."""
        return len(self._over(point, normal)[0]) > 0

    def _over(self, point: Array, normal: Array) -> tuple[Array, Array]:
        """Facets of `around` at a point of the surface, and how far they are along the normal, at most their size [m].

        Others, which the line along the normal meets further away, are elsewhere on the body.
        """
        corners, middles, sizes = self._triangles
        arms = middles - point
        near = np.flatnonzero(np.einsum("fd,fd->f", arms, arms) <= _REACH * sizes**2)  # others are not met
        if not len(near):
            return near, np.zeros(0)
        a, b, c = (corners[near, k] - point for k in range(3))
        sides = [cross(one, other) @ normal for one, other in ((a, b), (b, c), (c, a))]
        height = abs(arms[near] @ normal)
        over = (np.array(sides) >= 0.0).all(axis=0) & (height <= sizes[near])
        return near[over], height[over]

    @cached_property
    def nodes(self) -> Array:
        """Nodes of its facets, (k,) int array."""
        return np.unique(self.facets)

    @cached_property
    def bulge(self) -> float:
        """How far the surface is from its facets at most, for these are chords of it [m]."""
        if isinstance(self.surface.shape, RigidPlane):
            return 0.0
        corners = self.points[facet_corners(self.facets)]
        longest = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())
        radius = self.surface.least_radius  # each place of a facet is at most longest / sqrt(3) from a corner
        return radius - math.sqrt(max(radius**2 - longest**2 / 3, 0.0))

    @cached_property
    def ends(self) -> bool:
        """Whether `around` has an end: an edge of one facet alone."""
        corners = facet_corners(self.around)
        edges = np.sort(np.stack([corners, np.roll(corners, 1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        return bool((np.unique(edges, axis=0, return_counts=True)[1] == 1).any())

    @cached_property
    def _triangles(self) -> tuple[Array, Array, Array]:
        """Corners of `around`, (nf, 3, 3) [m], their middles, (nf, 3) [m], and their largest distances from it [m]."""
        corners = self.points[self.around[:, :3]]
        middles = corners.mean(axis=1)
        return corners, middles, np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)

    @cached_property
    def _part(self) -> float:
        """Length of the shortest part of the seam [m]; infinite without one."""
        return float(np.linalg.norm(self.seam[:, 1] - self.seam[:, 0], axis=1).min(initial=math.inf))


@dataclass(frozen=True, eq=False)
class Faces:
    """Smooth faces of a patch.

    Parameters
    ----------
    known : list of SmoothFace
        The largest first.
    unknown : int
        Number of facets that lie on no known surface.
    """

    known: list[SmoothFace]
    unknown: int


def faces_of(side: Side, patch: int, role: str) -> Faces:
    """Smooth faces of a side's patch, in the axes of its body, from the centre of mass.

    Raises
    ------
    InputError
        If no surface is found; `role` names the side.
    """
    check_facets(side, role)
    body = side.kinematics.body
    known = _KNOWN.setdefault(body, {})
    if patch not in known:
        points, facets = side.kinematics.arms, side.surface.facets
        faces = smooth_faces(points, facets)
        if not faces.known:
            raise not_known(points, facets, role)
        known[patch] = faces
    return known[patch]


def check_facets(side: Side, role: str) -> None:
    """Raise InputError if a side's facets are not those of quadratic or cubic tetrahedra."""
    n_nodes = side.surface.facets.shape[1]
    if n_nodes not in ORDERS:
        raise InputError(
            f"{role}: formulation 'hertz' knows what facets of quadratic and cubic tetrahedra lack, of 6 and 10 "
            f"nodes, got facets of {n_nodes} nodes. Take fe_model(..., order=2), or "
            "formulation='compliance' with facets that resolve the contact"
        )


def smooth_faces(points: Array, facets: Array) -> Faces:
    """Divide a patch into smooth faces.

    Parameters
    ----------
    points : (np, 3) array
        Nodes of the patch [m].
    facets : (nf, n) int array
        Triangles, with normals that point outward.
    """
    edges, corners = _neighbours(facets)
    whole = surface_of(points, facets) if connected_components(corners, directed=False)[0] == 1 else None
    if whole is not None:
        return Faces([SmoothFace(whole, points, facets, facets[:0], np.empty((0, 2, 3)), np.empty((0, 3)))], 0)
    face, surfaces = _grown(points, facets, edges, corners)
    first, second = sp.triu(edges).nonzero()
    apart = face[first] != face[second]
    first, second = first[apart], second[apart]
    places = _ends_of_edges(points, facets, first, second)
    smooth = _go_on(points, facets, (face, surfaces), (first, second), places)
    groups = _joined(face, first[smooth], second[smooth], len(surfaces))
    faces = []
    for number, surface in enumerate(surfaces):
        in_face = face == number
        others = (groups[face] == groups[number]) & ~in_face
        ends = smooth & (in_face[first] | in_face[second])
        beside = np.where(in_face[first], second, first)[ends]
        inner = np.where(in_face[first], first, second)[ends]
        seam, outside = _seam(points, facets, (surface, face, surfaces), (inner, beside), places[ends])
        faces.append(SmoothFace(surface, points, facets[in_face], facets[others], seam, outside))
    between = {(face[i], face[j]) for i, j in zip(first[smooth], second[smooth], strict=True)}
    for i, j in sorted(between | {(j, i) for i, j in between}):
        if min(i, j) >= 0:
            faces[i].neighbours.append(faces[j])
    faces.sort(key=lambda smooth_face: -len(smooth_face.facets))
    return Faces(faces, int(np.count_nonzero(face < 0)))


def _neighbours(facets: Array) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Which facets have an edge in common, and which a corner, themselves included, (nf, nf) each."""
    corners = facet_corners(facets)
    rows = np.repeat(np.arange(len(corners)), corners.shape[1])
    has = sp.csr_matrix((np.ones(corners.size), (rows, corners.ravel())))
    common = sp.csr_matrix(has @ has.T)
    return sp.csr_matrix(common > 1), sp.csr_matrix(common > 0)


def _grown(
    points: Array, facets: Array, edges: sp.csr_matrix, corners: sp.csr_matrix
) -> tuple[Array, list[TrueSurface]]:
    """Number of the face of each facet, -1 for those on no known surface, (nf,), and the surfaces of faces."""
    face, surfaces = np.full(len(facets), -1), list[TrueSurface]()
    tried, failed = np.zeros(len(facets), dtype=bool), 0
    for seed in range(len(facets)):
        if face[seed] >= 0 or tried[seed] or failed > _FAILED:
            continue
        rings = [_ring(seed, corners, face < 0, count) for count in _RINGS]
        surface = next((fitted for ring in rings if (fitted := surface_of(points, facets[ring])) is not None), None)
        if surface is None:
            tried[rings[-1]], failed = True, failed + 1
            continue
        taken, surface = _spread(points, facets, edges, seed, surface, face < 0)
        if len(taken):
            face[taken] = len(surfaces)
            surfaces.append(surface)
        tried[seed] = True
    return face, surfaces


def _ring(seed: int, corners: sp.csr_matrix, free: Array, count: int) -> Array:
    """Facets around one, by so many rings, that are free, in ascending order."""
    ring = np.array([seed])
    for _ in range(count):
        ring = np.unique(corners[ring].indices)
        ring = ring[free[ring]]
    return ring


def _spread(
    points: Array, facets: Array, edges: sp.csr_matrix, seed: int, surface: TrueSurface, free: Array
) -> tuple[Array, TrueSurface]:
    """Facets around one on a surface, in ascending order, and the surface through all of them."""
    taken, corners = np.empty(0, dtype=np.int64), facet_corners(facets)
    near_size = _WIDE * float(np.linalg.norm(np.ptp(points[corners[seed]], axis=0)))
    size = near_size
    normals = area_vectors(points, facets)
    normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    middles = points[corners].mean(axis=1)
    for _ in range(_GROWN):
        near = abs(surface.shape.project(points)[0]) <= max(surface.tolerance(near_size), _ROUNDING * size)
        fits = free & near[corners].all(axis=1)
        fits &= np.einsum("fd,fd->f", surface.shape.project(middles)[1], normals) > _ALONG
        some = np.flatnonzero(fits)
        if not fits[seed]:
            break
        parts = connected_components(edges[some][:, some], directed=False)[1]
        now = some[parts == parts[np.searchsorted(some, seed)]]
        if len(now) == len(taken) and (now == taken).all():
            break
        taken, size = now, float(np.linalg.norm(np.ptp(points[corners[now]].reshape(-1, 3), axis=0)))
        surface = surface_of(points, facets[now]) or surface
    return taken, surface


def _ends_of_edges(points: Array, facets: Array, first: Array, second: Array) -> Array:
    """Ends of the common edges of facets, (ne, 2, 3) [m]."""
    corners = facet_corners(facets)
    common = (corners[first][:, :, None] == corners[second][:, None, :]).any(axis=2)
    return np.asarray(points[corners[first][common].reshape(-1, 2)])


def _go_on(
    points: Array, facets: Array, faces: tuple[Array, list[TrueSurface]], pairs: tuple[Array, Array], places: Array
) -> Array:
    """Whether the surface goes on without an edge between two facets of different faces, (ne,)."""
    (face, surfaces), (first, second) = faces, pairs
    normals = area_vectors(points, facets)
    normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    cosine = np.einsum("ed,ed->e", normals[first], normals[second])
    bound = np.full(len(first), _BENT)
    known = np.flatnonzero((face[first] >= 0) & (face[second] >= 0))
    for e in known:
        middle = places[e].mean(axis=0)[None]
        of = (surfaces[face[k]].shape.project(middle)[1][0] for k in (first[e], second[e]))
        cosine[e], bound[e] = float(np.dot(*of)), _GOES_ON
    return np.asarray(cosine > bound)


def _seam(
    points: Array,
    facets: Array,
    faces: tuple[TrueSurface, Array, list[TrueSurface]],
    pairs: tuple[Array, Array],
    places: Array,
) -> tuple[Array, Array]:
    """Line in parts on which the surface of a face ends, (m, 2, 3) [m], and directions across these, (m, 3).

    `pairs` are facets within it and beyond its edges, whose ends are `places`, (ne, 2, 3) [m].
    """
    surface, face, surfaces = faces
    middles = points[facet_corners(facets)].mean(axis=1)
    parts, outside = [places[:0]], [np.empty((0, 3))]
    for inner, beside, ends in zip(*pairs, places, strict=True):
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        across = ends.mean(axis=0) - middles[inner]
        across = across - (across @ along) * along
        across /= np.linalg.norm(across)
        line = ends if face[beside] < 0 else _between(surface, surfaces[face[beside]], ends, across)
        parts.append(np.stack([line[:-1], line[1:]], axis=1))
        outside.append(np.tile(across, (len(line) - 1, 1)))
    return np.concatenate(parts), np.concatenate(outside)


def _between(first: TrueSurface, second: TrueSurface, ends: Array, across: Array) -> Array:
    """Places from end to end of an edge, (k, 3) [m], where two surfaces have the same normal; its ends, if nowhere."""
    line = ends[0] + np.linspace(0.0, 1.0, _PARTS + 1)[:, None] * (ends[1] - ends[0])
    length = float(np.linalg.norm(ends[1] - ends[0]))
    for _ in range(_STEPS):
        gap, normals = first.shape.project(line)
        line = line - gap[:, None] * normals
        middle = normals[len(normals) // 2]
        steeper = across @ (second.bending(middle) - first.bending(middle)) @ across
        off = (second.shape.project(line)[1] - normals) @ across
        if abs(off).max() > _ASIDE * length * abs(steeper) or abs(off[[0, -1]]).max() > _ENDS * length * abs(steeper):
            return ends
        line = line - off[:, None] / steeper * across
    return np.asarray(line)


def _joined(face: Array, first: Array, second: Array, n: int) -> Array:
    """Number of the group of faces that go on as each other, (n + 1,); the last is that of facets on no surface."""
    ends = face[first] % (n + 1), face[second] % (n + 1)
    graph = sp.csr_matrix((np.ones(len(first)), ends), shape=(n + 1, n + 1))
    return np.asarray(connected_components(graph, directed=False)[1])
