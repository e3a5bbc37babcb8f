"""Kinds of volume elements: nodes, shape functions, integration, faces; and several kinds in one array of cells.

Shape functions are Lagrange's on a space of monomials. That of hexahedra of 20 nodes is the serendipity space: of all
monomials those whose squared coordinates have a degree of at most two (Arnold and Awanou 2011). Wedges have products of
polynomials on their triangle and along their axis. Pyramids have rational functions, which are polynomials on each face
(Bedrosian 1992), so that elements of several kinds fit together.

A mesh that is not of tetrahedra alone is kept as hexahedra, with 8 or 20 nodes. A wedge, pyramid or tetrahedron among
them is a hexahedron some of whose corners have fallen together, as SOLID185 and SOLID186 of Ansys:
    wedge       a b c c  d e f f
    pyramid     a b c d  e e e e
    tetrahedron a b c c  d d d d
A node on an edge without length is the corner there. A triangle is a quadrilateral a b c c in the same way.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ..support.arrays import Array
from .facets import facet_corners, folded
from .shapes import (
    CELL_FACES,
    TET_EDGES,
    TET_NODES,
    integration_gradients,
    integration_points,
    integration_weights,
    tetrahedron_functions,
)

_BOX = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=float)
_WEDGE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]], dtype=float)
_PYRAMID = _BOX[:5]
HEX_EDGES = np.array(
    [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]]
)  # in the order in which VTK lists the nodes on them, as those of wedges and pyramids
_WEDGE_EDGES = np.array([[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]])
_PYRAMID_EDGES = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 4], [1, 4], [2, 4], [3, 4]])
# Corners of each kind at the eight corners of the hexahedron that it is kept as.
_AT_CORNERS = {8: [0, 1, 2, 3, 4, 5, 6, 7], 6: [0, 1, 2, 2, 3, 4, 5, 5], 5: [0, 1, 2, 3, 4, 4, 4, 4],
               4: [0, 1, 2, 2, 3, 3, 3, 3]}  # fmt: skip
_TIP = 1e-6  # from the tip of a pyramid, where gradients are not defined, to where they are taken


@dataclass(frozen=True, eq=False)
class Kind:
    """A kind of volume elements with n nodes, in VTK order.

    Parameters
    ----------
    name : str
        That of meshio.
    order : {1, 2, 3}
    corners : {4, 5, 6, 8}
    nodes : (n, 3) array
        In local coordinates.
    edges : (k, 2) int array
        Corners at the ends of each edge.
    hexahedral : bool
        Whether rows of cells are those of hexahedra, see this module.
    """

    name: str
    order: int
    corners: int
    nodes: Array
    edges: Array
    hexahedral: bool = True

    @cached_property
    def columns(self) -> Array:
        """(n,) int array: column of each node in a row of cells."""
        return np.array([self.of_row.tolist().index(i) for i in range(len(self.nodes))])

    @cached_property
    def of_row(self) -> Array:
        """Node in each column of a row of cells."""
        if not self.hexahedral:
            return np.arange(len(self.nodes))
        at = np.array(_AT_CORNERS[self.corners])
        if self.order == 1:
            return at
        known = {frozenset(edge): self.corners + i for i, edge in enumerate(self.edges.tolist())}
        on_edges = [known.get(frozenset(ends), ends[0]) for ends in at[HEX_EDGES].tolist()]
        return np.asarray(np.r_[at, on_edges])

    @cached_property
    def _powers(self) -> Array:
        """(n, 4) int array: powers of r, s, t and 1 - t in each monomial."""
        box = np.stack(np.meshgrid(*[np.arange(self.order + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        if self.corners == 8:
            box = box[np.where(box > 1, box, 0).sum(axis=1) <= self.order]
        elif self.corners == 6:
            across, along = box[:, :2].sum(axis=1), box[:, 2]
            box = box[(across <= self.order) & (across + along <= self.order + 1)]
        else:
            box = box[box.sum(axis=1) <= self.order]
        powers = np.column_stack([box, np.zeros(len(box), dtype=int)])
        if self.corners == 5:
            rational = [[1, 1, 0, -1]] if self.order == 1 else [[1, 1, 0, -1], [2, 1, 0, -1], [1, 2, 0, -1]]
            powers = np.vstack([powers, rational])
        return powers

    @cached_property
    def _coefficients(self) -> Array:
        return np.asarray(np.linalg.inv(_monomials(self.nodes, self._powers)))

    def functions(self, local: Array) -> tuple[Array, Array]:
        """Shape functions, (m, n), and their derivatives, (m, n, 3), at `local`, (m, 3)."""
        if self.corners == 4:
            return tetrahedron_functions(local, len(self.nodes))
        values = _monomials(local, self._powers) @ self._coefficients
        if self.corners == 5:
            local = np.where(1 - local[:, 2:] < _TIP, [_TIP / 2, _TIP / 2, 1 - _TIP], local)
        slopes = np.stack([_monomials(local, self._powers, axis) @ self._coefficients for axis in range(3)], axis=2)
        return values, slopes

    def on_row(self, values: Array) -> Array:
        """Values of nodes, (m, n, ...), in the columns of rows of cells, (m, columns, ...); zero in columns beside."""
        if not self.hexahedral:
            return values
        result = np.zeros((len(values), len(self.of_row), *values.shape[2:]))
        result[:, self.columns] = values
        return result

    @cached_property
    def rule(self) -> tuple[Array, Array]:
        """Points, (q, 3), and weights, (q,), that integrate volumes and gradients of elements exactly.

        Tetrahedra that are alone have the fewer points of `integration_gradients`, exact for straight sides.
        """
        if not self.hexahedral:
            return integration_points(len(self.nodes)), integration_weights(len(self.nodes))
        return self.gauss(self.order + 1)

    def gauss(self, n: int) -> tuple[Array, Array]:
        """Gauss' n points each way, (n^3, 3), on the element as a cube that may have collapsed, and weights."""
        x, w = (values / 2 for values in np.polynomial.legendre.leggauss(n))
        x = x + 0.5
        r, s, t = (grid.ravel() for grid in np.meshgrid(x, x, x, indexing="ij"))
        weight = np.einsum("i,j,k->ijk", w, w, w).ravel()
        if self.corners == 6:  # a cube whose edge has collapsed
            return np.column_stack([r, s * (1 - r), t]), weight * (1 - r)
        if self.corners == 5:
            return np.column_stack([r * (1 - t), s * (1 - t), t]), weight * (1 - t) ** 2
        if self.corners == 4:
            return np.column_stack([r, s * (1 - r), t * (1 - r) * (1 - s)]), weight * (1 - r) ** 2 * (1 - s)
        return np.column_stack([r, s, t]), weight

    def masses(self, x: Array) -> Array:
        """Integrals of products of the shape functions over elements with nodes x, (m, n, 3) [m]: (m, n, n) [m3].

        They are exact: on the cube, functions and places are polynomials of the element's order in each coordinate.
        """
        local, weights = self.gauss((5 * self.order + 1) // 2)
        values, slopes = self.functions(local)
        volumes = weights * np.linalg.det(np.einsum("qnr,mnd->mqrd", slopes, x))
        return np.asarray(np.swapaxes(values[None] * volumes[:, :, None], 1, 2) @ values)

    @cached_property
    def gradients(self) -> Array:
        """(q, n, 3) array: derivatives of the shape functions at the points of `rule`."""
        if not self.hexahedral:
            return integration_gradients(len(self.nodes))
        return self.functions(self.rule[0])[1]

    @cached_property
    def mass_shares(self) -> Array:
        """Share of its mass that each column of a row carries, HRZ lumping: the diagonal of the consistent mass."""
        if self.corners == 4:
            shares = _TETRAHEDRON_SHARES[len(self.nodes)]
        else:
            fine = Kind(self.name, 4, self.corners, self.nodes, self.edges).rule
            values = self.functions(fine[0])[0]
            shares = fine[1] @ values**2
            shares = shares / shares.sum()
        return np.asarray(self.on_row(shares[None])[0])

    def depth(self, local: Array) -> Array:
        """Least distance of points from the faces, in local coordinates, (m,); positive inside."""
        r, s, t = local.T
        if self.corners == 8:
            faces = [r, s, t, 1 - r, 1 - s, 1 - t]
        elif self.corners == 6:
            faces = [r, s, 1 - r - s, t, 1 - t]
        elif self.corners == 5:
            faces = [r, s, t, 1 - r - t, 1 - s - t]
        else:
            faces = [r, s, t, 1 - r - s - t]
        return np.asarray(np.min(faces, axis=0))

    @cached_property
    def middle(self) -> Array:
        """(3,) array: mean of the corners in local coordinates."""
        return np.asarray(self.nodes[: self.corners].mean(axis=0))


# Of tetrahedra, as fractions.
_TETRAHEDRON_SHARES = {
    4: np.full(4, 1 / 4),
    10: np.r_[np.full(4, 1 / 36), np.full(6, 4 / 27)],
    20: np.r_[np.full(4, 4), np.full(12, 27), np.full(4, 108)] / 772,
}


def _monomials(local: Array, powers: Array, by: int | None = None) -> Array:
    """Monomials r^i s^j t^k (1 - t)^l at points, (m, n), or their derivatives by one coordinate."""
    r, s, t = (local[:, [i]] for i in range(3))
    i, j, k, below = powers.T
    at = [(r, i), (s, j), (t, k)]

    def power(x: Array, exponent: Array) -> Array:
        return np.asarray(x ** exponent.astype(float))

    tip = np.where(powers[:, 3] < 0, power(np.maximum(1 - t, 1e-30), below), 1.0)
    if by is None:
        return np.asarray(power(r, i) * power(s, j) * power(t, k) * tip)
    x, exponent = at[by]
    others = np.prod([power(y, n) for axis, (y, n) in enumerate(at) if axis != by], axis=0)
    slope = exponent * power(x, np.maximum(exponent - 1, 0)) * others * tip
    if by == 2:
        rising = np.where(below < 0, power(np.maximum(1 - t, 1e-30), below - 1), 0.0)
        slope = slope - below * power(r, i) * power(s, j) * power(t, k) * rising
    return np.asarray(slope)


def _with_middles(corners: Array, edges: Array) -> Array:
    return np.vstack([corners, corners[edges].mean(axis=1)])


_TETRAHEDRA = {
    4: Kind("tetra", 1, 4, TET_NODES[4], TET_EDGES, False),
    10: Kind("tetra10", 2, 4, TET_NODES[10], TET_EDGES, False),
    20: Kind("VTK_LAGRANGE_TETRAHEDRON", 3, 4, TET_NODES[20], TET_EDGES, False),
}
# By the number of columns of the cells, then by the number of corners.
HEXAHEDRA = {
    8: {
        8: Kind("hexahedron", 1, 8, _BOX, HEX_EDGES),
        6: Kind("wedge", 1, 6, _WEDGE, _WEDGE_EDGES),
        5: Kind("pyramid", 1, 5, _PYRAMID, _PYRAMID_EDGES),
        4: Kind("tetra", 1, 4, TET_NODES[4], TET_EDGES),
    },
    20: {
        8: Kind("hexahedron20", 2, 8, _with_middles(_BOX, HEX_EDGES), HEX_EDGES),
        6: Kind("wedge15", 2, 6, _with_middles(_WEDGE, _WEDGE_EDGES), _WEDGE_EDGES),
        5: Kind("pyramid13", 2, 5, _with_middles(_PYRAMID, _PYRAMID_EDGES), _PYRAMID_EDGES),
        4: Kind("tetra10", 2, 4, TET_NODES[10], TET_EDGES),
    },
}
BY_NAME = {kind.name: kind for kinds in HEXAHEDRA.values() for kind in kinds.values()}


def kinds_named(names: Collection[str]) -> list[Kind]:
    """Kinds of elements of one mesh by their names."""
    if set(names) <= {"tetra"} or set(names) <= {"tetra10"}:
        return [_TETRAHEDRA[len(BY_NAME[name].nodes)] for name in names]
    return [BY_NAME[name] for name in names]


def kinds_of(cells: Array, hexahedra: bool) -> list[tuple[Kind, Array]]:
    """Kinds of elements in an array of cells, (ne, k), each with its rows, (m,) int.

    Parameters
    ----------
    cells : (ne, k) int array
    hexahedra : bool
        Whether rows are those of hexahedra, see this module.
    """
    n = cells.shape[1]
    if not hexahedra:
        return [(_TETRAHEDRA[n], np.arange(len(cells)))]
    number = np.full(len(cells), 8)
    folded = cells[:, 2] == cells[:, 3]
    number[folded & (cells[:, 6] == cells[:, 7])] = 6
    top = (cells[:, 5:8] == cells[:, 4:5]).all(axis=1)
    number[top] = 5
    number[top & folded] = 4
    return [(kind, rows) for corners, kind in HEXAHEDRA[n].items() if len(rows := np.flatnonzero(number == corners))]


def centres_of(points: Array, cells: Array, hexahedra: bool) -> Array:
    """Means of the elements' nodes, (ne, 3) [m]; parameters are those of `kinds_of`."""
    centres = np.empty((len(cells), 3))
    for kind, rows in kinds_of(cells, hexahedra):
        centres[rows] = points[cells[rows][:, kind.columns]].mean(axis=1)
    return centres


@lru_cache
def hexahedron_faces(n: int) -> Array:
    """Local faces of hexahedra with n nodes, (6, 4) or (6, 8), outward, see `FACET_NODES`."""
    corners = CELL_FACES[8]
    if n == 8:
        return corners
    known = {frozenset(edge): 8 + i for i, edge in enumerate(HEX_EDGES.tolist())}
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
    return np.hstack([corners, [[known[frozenset(edge)] for edge in face] for face in ends.tolist()]])


def corner_keys(faces: Array) -> Array:
    """Corners of faces in a form that is the same for equal faces, (nf, 3) or (nf, 4) int."""
    corners = facet_corners(faces).copy()
    corners[folded(faces), 3:] = -1
    return np.sort(corners, axis=1)


def faces_of(cells: Array, hexahedra: bool) -> tuple[Array, Array]:
    """Faces of all elements, and the numbers that equal faces have in common.

    Returns
    -------
    (ne * f, k) int array
        Nodes of f faces of each element; of a triangle among quadrilaterals as `a b c c`.
    (ne, f) int array
        -1 for a face of a hexahedron that has fallen to a line or a point. A linear quadrilateral and the two triangles
        that cover it have one number.
    """
    local = hexahedron_faces(cells.shape[1]) if hexahedra else CELL_FACES[cells.shape[1]]
    faces = cells[:, local].reshape(-1, local.shape[1])
    lost = np.zeros(len(faces), dtype=bool)
    if hexahedra:
        corners = faces[:, :4]
        same = corners == np.roll(corners, -1, axis=1)
        lost = same.sum(axis=1) > 1
        triangles = np.flatnonzero(same.sum(axis=1) == 1)
        turn = (np.arange(4) + same[triangles].argmax(axis=1)[:, None] - 2) % 4
        parts = [np.take_along_axis(faces[triangles, i : i + 4], turn, axis=1) for i in range(0, faces.shape[1], 4)]
        faces[triangles] = np.hstack(parts)
    number = np.full(len(faces), -1)
    number[~lost] = np.unique(corner_keys(faces[~lost]), axis=0, return_inverse=True)[1].ravel()
    if local.shape[1] == 4:
        _join_covered(faces, number)
    return faces, number.reshape(len(cells), len(local))


def _join_covered(faces: Array, number: Array) -> None:
    """Give quadrilaterals and the two triangles that cover them one number; others have no face on the other side."""
    alone = np.flatnonzero((np.bincount(number[number >= 0])[number] == 1) & (number >= 0))
    triangles, quads = (alone[of] for of in (folded(faces[alone]), ~folded(faces[alone])))
    if not len(triangles) or not len(quads):
        return
    halves = faces[quads][:, [(0, 1, 2), (2, 3, 0), (1, 2, 3), (3, 0, 1)]].reshape(-1, 3)  # by each of two diagonals
    keys = np.unique(np.sort(np.vstack([faces[triangles][:, :3], halves])), axis=0, return_inverse=True)[1].ravel()
    known = np.full(keys.max() + 1, -1)
    known[keys[: len(triangles)]] = triangles
    covers = known[keys[len(triangles) :]].reshape(-1, 2, 2)
    quad, diagonal = np.nonzero((covers >= 0).all(axis=2))
    number[covers[quad, diagonal]] = number[quads[quad], None]


def rows_of_cells(blocks: Sequence[tuple[str, Array]]) -> tuple[Array, bool]:
    """Put elements, kind by kind in VTK order, into one array of cells; the second value is whether of hexahedra."""
    kinds = kinds_named([name for name, _ in blocks])
    rows = [cells[:, kind.of_row] for kind, (_, cells) in zip(kinds, blocks, strict=True)]
    return np.concatenate(rows), kinds[0].hexahedral
