"""A rigid surface of triangles: an STL file, a STEP file, or a shape.

The distance of a point is the distance to its closest triangle. Its sign comes from the normal of the closest face,
edge or corner. The normal of an edge is the sum of both faces' normals. The normal of a corner is their sum weighted by
the faces' angles.

References
----------
C. Ericson, Real-Time Collision Detection, 2005, section 5.1.5: the closest point of a triangle.

J.A. Baerentzen, H. Aanaes, Signed distance computation using the angle weighted pseudonormal, IEEE Transactions on
Visualization and Computer Graphics 11 (2005) 243.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from ..errors import InputError, MeshError, UnitsWarning
from ..meshing.mesh_files import read_triangles
from ..meshing.netgen_mesh import shape_of, surface_triangles
from ..meshing.step_files import ENDINGS
from ..support.arrays import Array
from ..support.checks import validate_array, validate_path, validate_positive
from ..support.foreign import Shape
from ..support.warn import warn
from ..surfaces.surface import nearest_places
from . import loops
from .triangle_tree import TriangleTree

_SAME = 1e-9  # of the size of the mesh: corners that are nearer to each other are merged
_FLAT = 1e-10  # of the squared longest edge: triangles with a smaller area are left out
_ON = 1e-9  # of the size of the mesh: points that are nearer lie on an edge or a corner
_LARGEST = 20.0  # [m]: files of larger meshes may be in millimetres
_OPPOSED = 0.1  # cosine: a face whose normal opposes a body's less than this is not the one that the body meets
_BACK = 0.5  # cosine from which on a face looks the way of the body, and away from the face that the body met
_CHUNK = 4096  # points that are projected at once, to bound the memory


@dataclass(frozen=True, eq=False)
class RigidMesh:
    """Solid inside a closed surface of triangles, or behind an open one.

    Triangles are flat. On a curved surface of radius R, edges of length d lie d^2 / 8 R beneath it. A patch that slides
    over them meets each edge. Choose edges so short that this depth is a small part of the approach under the force.

    Parameters
    ----------
    points : (n, 3) array
        Corners [m].
    triangles : (m, 3) int array
        Corners of each triangle, counter-clockwise as seen from outside. For a closed surface, either sense is
        accepted.

    Raises
    ------
    InputError
        If arrays have wrong shapes, or triangles refer to corners that do not exist.
    MeshError
        If no triangle has an area, more than two share an edge, or two that share one have opposite senses.

    Warns
    -----
    UnitsWarning
        If the mesh is so large that its file may be in millimetres.
    """

    points: Array
    triangles: Array

    if TYPE_CHECKING:  # any sequences of numbers are accepted; they are kept as arrays

        def __init__(self, points: object, triangles: object) -> None: ...

    def __post_init__(self) -> None:
        points = validate_array("points", self.points, (None, 3))
        numbers = validate_array("triangles", self.triangles, (None, 3))
        triangles = numbers.astype(np.int64)
        if not len(triangles) or (triangles != numbers).any() or triangles.min() < 0 or triangles.max() >= len(points):
            raise InputError(f"triangles: expected at least one, of whole numbers from 0 to {len(points) - 1}")
        size = float(np.ptp(points[triangles.ravel()], axis=0).max())
        if size > _LARGEST:
            warn(
                f"points: the mesh is {size:.4g} m large. If its file is in millimetres, give scale=1e-3",
                UnitsWarning,
            )
        _, first, number = np.unique(
            np.round(points / (_SAME * size or 1.0)), axis=0, return_index=True, return_inverse=True
        )
        points, triangles = points[first], number.reshape(-1)[triangles]
        a, b, c = (points[corner] for corner in triangles.T)
        longest = np.max([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
        triangles = triangles[np.linalg.norm(np.cross(b - a, c - a), axis=1) > _FLAT * longest]
        if not len(triangles):
            raise MeshError("triangles: expected some with an area, got none")
        if _is_closed(triangles) and np.einsum("td,td->", points[triangles[:, 0]], np.cross(
            points[triangles[:, 1]], points[triangles[:, 2]]
        )) < 0:  # fmt: skip
            triangles = triangles[:, ::-1].copy()
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "triangles", triangles)

    @classmethod
    def of(cls, source: Shape | str | Path, *, maxh: float | None = None, scale: float = 1.0) -> RigidMesh:
        """Read the triangles of a file, or mesh the surface of a shape.

        Parameters
        ----------
        source : str, Path or shape
            STL, OBJ, PLY, or another file of triangles that meshio reads; a STEP file; or a solid of `netgen.occ`.
        maxh : float, optional
            Longest edge [m], for STEP files and shapes, which need it.
        scale : float
            Factor of all lengths, 1e-3 for a file in millimetres.

        Raises
        ------
        InputError, MeshError
            See `RigidMesh` and `generate_mesh`; or if the file cannot be read, has no triangles, or needs `maxh`.
        """
        scale = validate_positive("scale", scale)
        if isinstance(source, str | Path) and validate_path("source", source).suffix.lower() not in ENDINGS:
            if maxh is not None:
                raise InputError(
                    "maxh: only for STEP files and shapes; the triangles of other files are taken as they are"
                )
            points, triangles = read_triangles(validate_path("source", source))
            return cls(scale * points, triangles)
        shape = shape_of(source, scale)
        if maxh is None:
            raise InputError("maxh: expected the longest edge of the triangles, which a STEP file or a shape needs")
        return cls(*surface_triangles(shape, validate_positive("maxh", maxh, "m")))

    @cached_property
    def _rounding(self) -> float:
        """Distance below which a point lies on an edge or a corner [m]."""
        return _ON * float(np.ptp(self.points, axis=0).max())

    @cached_property
    def _corners(self) -> Array:
        """Places of the corners, (m, 3, 3) [m]."""
        return np.asarray(self.points[self.triangles])

    @cached_property
    def _tree(self) -> TriangleTree:
        return TriangleTree.of(self._corners)

    @cached_property
    def _classes(self) -> list[tuple[float, Array, cKDTree]]:
        """Triangles of similar size: their largest radius about the centroid [m], their numbers, and centroids."""
        centroid = self._corners.mean(axis=1)
        radius = np.linalg.norm(self._corners - centroid[:, None], axis=2).max(axis=1)
        kind = np.floor(np.log2(radius.max() / radius)).astype(int)
        groups = [np.flatnonzero(kind == k) for k in np.unique(kind)]
        return [(float(radius[group].max()), group, cKDTree(centroid[group])) for group in groups]

    @cached_property
    def _normals(self) -> Array:
        """Unit normals of each triangle's face, its corners and its edges 01, 12 and 20, (m, 7, 3)."""
        corners, triangles = self._corners, self.triangles
        ways = np.roll(corners, -1, axis=1) - corners
        ways /= np.linalg.norm(ways, axis=2)[:, :, None]
        face = np.cross(ways[:, 0], ways[:, 1])
        face /= np.linalg.norm(face, axis=1)[:, None]
        angle = np.arccos(np.clip(-np.einsum("tkd,tkd->tk", ways, np.roll(ways, 1, axis=1)), -1.0, 1.0))
        at_corner = np.zeros_like(self.points)
        for k in range(3):
            np.add.at(at_corner, triangles[:, k], angle[:, k, None] * face)
        edges = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
        _, number = np.unique(edges, axis=0, return_inverse=True)
        number = number.reshape(-1)
        at_edge = np.zeros((number.max() + 1, 3))
        np.add.at(at_edge, number, np.repeat(face, 3, axis=0))
        normals = np.concatenate([face[:, None], at_corner[triangles], at_edge[number].reshape(-1, 3, 3)], axis=1)
        length = np.linalg.norm(normals, axis=2)[:, :, None]
        return np.where(length > _ON, normals / np.maximum(length, _ON), face[:, None])

    def project(self, x: Array) -> tuple[Array, Array]:
        """Gaps, (k,) [m], and outward unit normals, (k, 3), at points x, (k, 3)."""
        parts = [self._project(x[i : i + _CHUNK]) for i in range(0, max(len(x), 1), _CHUNK)]
        return np.concatenate([gap for gap, _ in parts]), np.vstack([normal for _, normal in parts])

    def entered(self, x: Array, outward: Array, gap: Array, normals: Array) -> tuple[Array, Array, Array]:
        """Gaps, (k,) [m], and normals, (k, 3), of points inside by the faces through which their body has come.

        The closest face is the wrong one where a point has passed half the thickness of a sheet: its normal does not
        oppose the body's. The right one lies behind the point, against the body's outward normal. The last value,
        (k,), is the thickness that is left before the point [m], infinite where no sheet has a back there.

        Parameters
        ----------
        x, outward : (k, 3) arrays
            Points [m], and the body's outward unit normals there.
        gap, normals : (k,), (k, 3) arrays
            Those of `project`.
        """
        left = np.full(len(gap), np.inf)
        opposing = np.einsum("kd,kd->k", normals, outward)
        wrong = np.flatnonzero((gap < 0.0) & (opposing > -_OPPOSED))
        if not len(wrong):
            return gap, normals, left
        gap, normals = gap.copy(), normals.copy()
        for point in wrong:
            triangle = self._behind(x[point], -outward[point])
            if triangle is None:
                continue
            met = self._normals[triangle, 0]
            if opposing[point] > _BACK and normals[point] @ met < -_BACK:  # the side of an edge is no back
                left[point] = -gap[point]
            normals[point] = met
            gap[point] = (x[point] - self._corners[triangle, 0]) @ normals[point]
        return gap, normals, left

    def _behind(self, x: Array, way: Array) -> int | None:
        """First triangle on a ray from x along `way`, (3,) each, that it leaves the solid through; None without one."""
        a, faces = self._corners[:, 0], self._normals[:, 0]
        slope = faces @ way
        distance = np.einsum("td,td->t", a - x, faces) / _not_zero(slope)
        ahead = np.flatnonzero((slope > _OPPOSED) & (distance >= 0.0))
        hit = x + distance[ahead, None] * way
        place, _ = _on_triangles(hit, self._corners[ahead])
        met = ahead[np.linalg.norm(hit - place, axis=1) <= self._rounding]
        return int(met[distance[met].argmin()]) if len(met) else None

    def _project(self, x: Array) -> tuple[Array, Array]:
        """Gaps, (k,) [m], and outward unit normals, (k, 3), at points x, (k, 3), by their closest triangles."""
        triangle, place, feature = self._closest(x)
        normal, miss = self._normals[triangle, feature], x - place
        distance = np.linalg.norm(miss, axis=1)
        along = np.einsum("kd,kd->k", miss, normal)
        beside = (feature > 0) & (distance > self._rounding)
        side = np.where(along < 0, -1.0, 1.0)
        normal = np.where(beside[:, None], side[:, None] * miss / np.maximum(distance, 1e-300)[:, None], normal)
        return np.where(beside, side * distance, along), normal

    def _closest(self, x: Array) -> tuple[Array, Array, Array]:
        """Closest triangle of each point, (k,), the closest place on it, (k, 3), and its feature, (k,), see `_normals`.

        A triangle cannot be nearer than the distance to its centroid less its radius. So all triangles are tried that
        may be nearer than the ones with the nearest centroids. Compiled loops go through a tree of boxes.
        """
        if loops.at_once():
            return loops.closest_triangles(x, self._corners, self._tree)
        bound = np.full(len(x), np.inf)
        for _, group, tree in self._classes:
            place, _ = _on_triangles(x, self._corners[group[nearest_places(tree, x)[:, 0]]])
            bound = np.minimum(bound, np.linalg.norm(x - place, axis=1))
        points, triangles = [], []
        for radius, group, tree in self._classes:
            near = tree.query_ball_point(x, (1 + _ON) * (bound + radius))
            points.append(np.repeat(np.arange(len(x)), [len(numbers) for numbers in near]))
            triangles.append(group[np.fromiter(chain.from_iterable(near), dtype=np.int64, count=len(points[-1]))])
        point, triangle = np.concatenate(points), np.concatenate(triangles)
        place, feature = _on_triangles(x[point], self._corners[triangle])
        distance = ((x[point] - place) ** 2).sum(axis=1)
        order = np.lexsort((distance, point))
        best = order[np.searchsorted(point, np.arange(len(x)), sorter=order)]
        return triangle[best], place[best], feature[best]


def _on_triangles(x: Array, corners: Array) -> tuple[Array, Array]:
    """Closest place to each point on its triangle, (k, 3), and its feature, (k,): face, corners, edges.

    Parameters
    ----------
    x : (k, 3) array
    corners : (k, 3, 3) array
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac = b - a, c - a
    (d1, d2), (d3, d4), (d5, d6) = (
        (np.einsum("kd,kd->k", ab, x - p), np.einsum("kd,kd->k", ac, x - p)) for p in (a, b, c)
    )
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    ways = [
        ((d1 <= 0) & (d2 <= 0), 1, 0.0, 0.0),
        ((d3 >= 0) & (d4 <= d3), 2, 1.0, 0.0),
        ((d6 >= 0) & (d5 <= d6), 3, 0.0, 1.0),
        ((vc <= 0) & (d1 >= 0) & (d3 <= 0), 4, d1 / _not_zero(d1 - d3), 0.0),
        ((va <= 0) & (d4 >= d3) & (d5 >= d6), 5, None, (d4 - d3) / _not_zero(d4 - d3 + d5 - d6)),
        ((vb <= 0) & (d2 >= 0) & (d6 <= 0), 6, 0.0, d2 / _not_zero(d2 - d6)),
    ]
    where = [way[0] for way in ways]
    area = _not_zero(va + vb + vc)
    w = np.select(where, [np.broadcast_to(way[3], len(x)) for way in ways], vc / area)
    v = np.select(where, [np.broadcast_to(1.0 - w if way[2] is None else way[2], len(x)) for way in ways], vb / area)
    feature = np.select(where, [np.full(len(x), way[1]) for way in ways], 0)
    return a + v[:, None] * ab + w[:, None] * ac, feature


def _not_zero(values: Array) -> Array:
    return np.where(values == 0, 1.0, values)


def _is_closed(triangles: Array) -> bool:
    """Whether each edge has two triangles.

    Raises
    ------
    MeshError
        If more than two triangles share an edge, or two run along it in the same sense.
    """
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    _, times = np.unique(edges, axis=0, return_counts=True)
    if times.max() > 1:
        raise MeshError(
            f"triangles: {np.count_nonzero(times > 1)} edges have more than two triangles, or two of opposite senses. "
            "Repair the mesh: one closed surface with all normals outwards"
        )
    _, sharing = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    return bool((sharing == 2).all())
