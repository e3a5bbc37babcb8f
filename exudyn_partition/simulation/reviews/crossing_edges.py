"""Sharp edges that no row holds: edges of two bodies that cross, and corners of the master."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from ...contact.rigid_mesh import RigidMesh
from ...errors import ContactPatchWarning
from ...exudyn_bodies.other_bodies import surface_motion
from ...fe.edges import neighbours_across, sharp_edges, sharp_nodes
from ...fe.facets import area_vectors, facet_corners
from ...fe.shapes import corners_of, shape_functions
from ...support.arrays import Array
from ...support.once import once
from ...surfaces.surface import Surface, closest_points
from ..result import called, when
from .reviewed_run import Finding, ReviewedContact, ReviewedRun, evenly, surface_of

_LOOKED_AT, _STARTS = 64, 16  # largest number of samples, and of times of contact, at which nodes are checked
_WITHIN = 0.01  # depth of an edge within another body, as a share of a facet's size
_ROUND_OFF = 1e-7  # of a facet's size
_ALIKE = 1e-3  # sine of the angle between edges below which they do not cross
_ASIDE = 0.1  # by that much (a sine) may edges pass each other beside the directions between their facets
_NOWHERE = 0.0, np.zeros(3)


def looked_at(run: ReviewedRun, history: ReviewedContact) -> Array:
    """Samples at which nodes are checked, among them those before the first times of contact, (k,) int.

    Until the load steps of a press fit have closed its overlap, surfaces lie within each other as they are meant to.
    """
    n = len(history.force)
    if history.contact.mechanics.gaps.placement.pressed and run.result.method == "static":
        return np.arange(n)[-1:] if run.result.status == "finished" else np.empty(0, dtype=int)
    starts = [first - 1 for first, _ in history.spans[:_STARTS] if first > 0]
    return np.union1d(np.array(starts, dtype=int), evenly(n, _LOOKED_AT))


@once
def neighbours(surface: Surface) -> sp.csr_matrix:
    """Number of facets that two nodes share, (np, np)."""
    nf, k = surface.facets.shape
    cells = surface.facets.ravel(), np.repeat(np.arange(nf), k)
    of_facets = sp.csr_matrix((np.ones(nf * k), cells), shape=(len(surface.points), nf))
    return sp.csr_matrix(of_facets @ of_facets.T)


def crossing_edges(run: ReviewedRun) -> Iterator[Finding]:
    """Sharp edges of the master within the slave where no row is closed."""
    for history in run.contacts:
        if history.contact.master != history.contact.slave and history.contact.rows != "edges":
            yield from _crossing(run, history)


def _crossing(run: ReviewedRun, history: ReviewedContact) -> Iterator[Finding]:
    """Finding on edges of the two sides of a contact that cross, away from rows that hold them."""
    contact, result = history.contact, run.result
    surfaces = [surface_of(item.body, number) for item, number in contact.sides]
    rigid = isinstance(contact.master, RigidMesh)
    if isinstance(contact.master, RigidMesh):
        surfaces.append(_surface_of(contact.master))
    if len(surfaces) < 2 or not len(surfaces[1].sharp):
        return
    chosen = looked_at(run, history)
    if not len(chosen):
        return
    pressed, around = np.maximum(history.pressed[chosen], 0.0), neighbours(surfaces[0])
    places = [
        item.kinematics.at(surface.nodes).place(run.body(item).q[chosen])
        for (item, _), surface in zip(contact.sides, surfaces, strict=False)
    ]
    if rigid:
        motion = surface_motion(contact.carrier, result.others, result.t[chosen])
        if motion is None:
            return
        place, axes = motion
        places.append(place[:, None] + surfaces[1].points @ axes.swapaxes(1, 2))
    x_s, x_m = places
    edges, size = [_Edges.of_surface(surface) for surface in surfaces], min(surface.facet_size for surface in surfaces)
    lower, upper = ([pick(x, axis=1) for x in (x_s, x_m)] for pick in (np.min, np.max))
    overlap = ((lower[0] < upper[1]) & (lower[1] < upper[0])).all(axis=1)  # of the boxes around both
    for i, sample in zip(np.flatnonzero(overlap), chosen[overlap], strict=True):
        near_closed = np.zeros(len(surfaces[0].points), dtype=bool)
        nodes, forces = history.rows.at_sample(int(sample))
        near_closed[nodes[forces > 0]] = True
        near_closed |= around @ near_closed > 0
        deepest = [_deepest_crossing(edges, x_s[i], x_m[i], near_closed)]
        if contact.beside is None:
            deepest.append(_deepest_corner(surfaces, x_s[i], x_m[i], near_closed))
        depth, where = max(deepest, key=lambda crossing: crossing[0])
        if not _WITHIN * size < depth - pressed[i] < size:
            continue
        slave, master = (*contact.side_names, "the rigid surface")[:2]
        first, last = (
            ("make it a partition body and ", "") if rigid else ("", ", or give that body first, with passes='given'")
        )
        yield Finding(
            f"{called(contact)} at {when(result, result.t[sample])}: a sharp edge of {master} is {depth:.3g} m within "
            f"{slave} at {where} m, with no closed row around. Rows are those of the slave, {slave}: faces of {master} "
            f"hold its edges, but nothing holds edges that cross, or edges of {master}. Round one of them by a radius "
            f"that facets resolve; or, if an edge of {master} meets a face, {first}add CreatePartitionContact of the "
            f"same two patches with rows='edges'{last}",
            ContactPatchWarning,
        )
        return


@once
def _surface_of(mesh: RigidMesh) -> Surface:
    """A rigid mesh with its sharp edges."""
    nodes, no_line = np.arange(len(mesh.points)), np.zeros(3)
    sharp = sharp_nodes(mesh.points, mesh.triangles)
    return Surface(mesh.points, mesh.triangles, no_line, nodes[:0], nodes, sharp=sharp)


@dataclass(frozen=True, eq=False)
class _Edges:
    """Sharp edges of a surface, each in two straight pieces.

    Parameters
    ----------
    facets : (nf, n) int array
        All facets.
    beside : (k, 2) int array
        Both facets of each edge; where the surface ends, the same one twice.
    weights : (k, 3, n) array
        Shape functions of the first of them at start, middle and end of the edge.
    """

    facets: Array
    beside: Array
    weights: Array

    @classmethod
    def of_surface(cls, surface: Surface) -> _Edges:
        """Find those of a surface at the start."""
        across = neighbours_across(surface.facets)[0]
        facet, edge = sharp_edges(surface.points, surface.facets)
        once = facet < across[facet, edge]
        ends = np.isin(facet_corners(surface.facets), surface.ends)
        last, at_end = np.nonzero((across < 0) & ends & np.roll(ends, -1, axis=1))
        facet, edge = np.r_[facet[once], last], np.r_[edge[once], at_end]
        neighbour = across[facet, edge]
        start = corners_of(surface.facets)
        end = np.roll(start, -1, axis=0)
        local = np.stack([start, (start + end) / 2, end], axis=1)[edge]
        shape = shape_functions(local.reshape(-1, 2), surface.facets.shape[1])[:, 0]
        beside = np.stack([facet, np.where(neighbour < 0, facet, neighbour)], axis=1)
        return cls(surface.facets, beside, shape.reshape(len(beside), 3, surface.facets.shape[1]))

    def pieces(self, points: Array) -> tuple[Array, Array, Array]:
        """Pieces at places of the nodes, (np, 3) [m].

        Returns ends, (2 k, 2, 3) [m], mean outward unit normals, (2 k, 3), and the cosine between these and the normals
        of the facets, (2 k,): zero where the surface ends, because its other facet is not known.
        """
        x = self.weights @ points[self.facets[self.beside[:, 0]]]
        normals = _unit(area_vectors(points, self.facets))[self.beside]
        mean = _unit(normals.sum(axis=1))
        known = self.beside[:, 0] != self.beside[:, 1]
        cosine = np.where(known, np.einsum("kd,kd->k", normals[:, 0], mean), 0.0)
        ends = np.stack([x[:, :2], x[:, 1:]], axis=2).reshape(-1, 2, 3)
        return ends, np.repeat(mean, 2, axis=0), np.repeat(cosine, 2)

    def touch(self, nodes: Array) -> Array:
        """Whether the facets of each piece have one of some nodes, (np,) bool: (2 k,) bool."""
        return np.repeat(nodes[self.facets[self.beside]].any(axis=(1, 2)), 2)


def _unit(vectors: Array) -> Array:
    """Vectors, (n, 3), by their lengths."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None])


def _deepest_crossing(edges: list[_Edges], x_s: Array, x_m: Array, near_closed: Array) -> tuple[float, Array]:
    """Largest depth to which edges of both surfaces have passed each other [m], zero if none have, and its place.

    They pass each other along a direction that lies between the facets on both sides of each edge.
    """
    (a, n_a, cosine_a), (b, n_b, cosine_b) = (edge.pieces(x) for edge, x in zip(edges, (x_s, x_m), strict=True))
    if not len(a) or not len(b):
        return _NOWHERE
    reach = sum(np.linalg.norm(x[:, 1] - x[:, 0], axis=1).max() for x in (a, b)) / 2
    near = cKDTree(a.mean(axis=1)).query_ball_tree(cKDTree(b.mean(axis=1)), reach)
    i = np.repeat(np.arange(len(a)), [len(partners) for partners in near])
    j = np.fromiter(chain.from_iterable(near), dtype=np.int64, count=len(i))
    along_a, along_b, apart = a[i, 1] - a[i, 0], b[j, 1] - b[j, 0], a[i, 0] - b[j, 0]
    pairs = (along_a, along_a), (along_a, along_b), (along_b, along_b), (apart, along_a), (apart, along_b)
    aa, ab, bb, wa, wb = (np.einsum("kd,kd->k", *pair) for pair in pairs)
    squared = aa * bb - ab**2
    crossing = squared > _ALIKE**2 * aa * bb
    squared[~crossing] = 1.0
    s, t = (ab * wb - bb * wa) / squared, (aa * wb - ab * wa) / squared
    way = apart + s[:, None] * along_a - t[:, None] * along_b  # from the master's edge to the slave's
    crossing &= (s > 0) & (s < 1) & (t > 0) & (t < 1) & ~edges[0].touch(near_closed)[i]
    depth = np.linalg.norm(way, axis=1)
    outward, inward = (np.einsum("kd,kd->k", way, normal) for normal in (n_a[i], n_b[j]))
    crossing &= outward > np.maximum(cosine_a[i] - _ASIDE, 0.0) * depth
    crossing &= -inward > np.maximum(cosine_b[j] - _ASIDE, 0.0) * depth
    if not crossing.any():
        return _NOWHERE
    depth = np.where(crossing, depth, 0.0)
    worst = int(depth.argmax())
    return float(depth[worst]), a[i[worst], 0] + s[worst] * along_a[worst]


def _deepest_corner(surfaces: list[Surface], x_s: Array, x_m: Array, near_closed: Array) -> tuple[float, Array]:
    """Largest depth of the master's nodes at edges within the slave [m], zero if none is, and its place, (3,)."""
    corners = x_m[surfaces[1].sharp]
    corners = corners[((corners > x_s.min(axis=0)) & (corners < x_s.max(axis=0))).all(axis=1)]
    if not len(corners):
        return _NOWHERE
    facets, size = surfaces[0].facets, surfaces[0].facet_size
    closest = closest_points(corners, x_s[facets])
    passed = near_closed[facets[closest.facet]].any(axis=1) | (closest.offset > _ROUND_OFF * size)
    depth = np.where(passed, 0.0, -closest.gap)
    worst = int(depth.argmax())
    return float(depth[worst]), corners[worst]
