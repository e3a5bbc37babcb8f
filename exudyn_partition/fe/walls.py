"""Thin walls of a body, and the bending waves that their elements resolve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..support.arrays import Array
from .material import Material

_STEPS = 40  # elements that a ray may cross before it leaves a wall
_OPPOSITE = -0.9  # cosine between the normals of the two sides of a wall
_THICK = 2.0  # a wall with more elements than this across it counts as solid
# Elements in the length of a bending wave, by their order: so many times L / t, but at least and at most so many. With
# the first numbers a wave is seen at all, with the next its frequency is a quarter too high, with the last 8 %.
_SEEN = {2: (0.0, 1.3, 1.3), 3: (0.0, 0.87, 0.87)}
_ROUGH = {2: (0.55, 1.3, 2.0), 3: _SEEN[3]}
_FOLLOWED = {2: (4.0, 2.0, 4.0), 3: (0.0, 1.2, 1.2)}
_LOCKS, _LOCKS_LINEAR = 5.0, 3.0  # elements lock if they are longer than this many thicknesses
_LOCKING = {2: 2, 3: 1}  # power of that ratio by which a wave needs more elements
_STIFF = 0.05  # share of bending stiffness by which elements may be off
_EQUAL = 1e-6  # round-off
_SLENDER = 5.0  # a body that is longer than this many thicknesses of a wall bends it
_A_WALL = 0.1  # share of the surface that counts as a wall
_NEAREST = 8  # facets at which an element looks for its wall
_SHEAR = 5 / 6  # Mindlin's shear coefficient


@dataclass(frozen=True)
class Wall:
    """The wall whose bending waves limit a mesh.

    Parameters
    ----------
    thickness : float
        [m]
    element : float
        Length of its elements along it [m].
    order : {1, 2, 3}
        Of the elements.
    material : Material
    """

    thickness: float
    element: float
    order: int
    material: Material

    @property
    def frequency(self) -> float:
        """Highest frequency of bending waves that its elements resolve at all, however inaccurately [Hz]."""
        return float(_resolved(self.element, self.thickness, self.order, self.material, _SEEN))

    @property
    def rough_frequency(self) -> float:
        """Frequency up to which its elements give bending waves a frequency within a quarter [Hz]."""
        return float(_resolved(self.element, self.thickness, self.order, self.material, _ROUGH))

    @property
    def accurate_frequency(self) -> float:
        """Frequency up to which its elements give bending waves a frequency within 8 % [Hz]."""
        return float(_resolved(self.element, self.thickness, self.order, self.material, _FOLLOWED))

    def element_for(self, frequency: float) -> float:
        """Length of elements that resolve bending waves up to `frequency` [Hz], in [m]."""
        lengths = self.element * np.geomspace(1, 1e-4, 1000)
        return float(
            lengths[_resolved(lengths, self.thickness, self.order, self.material, _SEEN) >= frequency].max(
                initial=lengths[-1]
            )
        )


def at_facets(points: Array, corners: Array, facets: Array, number: Array) -> tuple[Array, Array]:
    """Length of the elements, and thickness of the wall, at each facet of the surface, (nf,) [m].

    The thickness is infinite where more than two elements lie in it.

    Parameters
    ----------
    points : (n, 3) array
    corners : (ne, faces of a cell, corners of a face) int array
        Outward faces of each cell, as corner nodes.
    facets : (nf, 2) int array
        Cell of each surface facet and its face there.
    number : (ne, faces of a cell) int array
        Numbers that equal faces have in common.
    """
    length = _lengths(points, corners[facets[:, 0], facets[:, 1]])
    return length, _thickness(points, corners, facets, number, _THICK * length)


def weakest_wall(length: Array, thickness: Array, order: int, materials: Sequence[tuple[Material, Array]]) -> Wall:
    """Wall whose bending waves its elements resolve worst; with infinite thickness if there is no thin wall.

    Let L be the length of a quadratic element and t the thickness of the wall. A bending wave needs at least 1.3
    elements in its length to be resolved, little more than two nodes. With two, it is a quarter too fast at most. It
    needs four to be accurate, or two where several elements span the wall. Beyond L = 5 t the elements lock in shear,
    and a wave needs (L / 5 t)^2 times as many. Cubic elements need 0.87 and 1.2 in its length, and beyond L = 5 t they
    need L / 5 t times as many. `tests/fe/test_walls.py` compares that with the exact waves of Rayleigh and Lamb, and
    with a free plate. Linear elements lock at once. If they are longer than t, no wave is accurate; beyond L = 3 t they
    are refused.

    References
    ----------
    R. D. Mindlin, Influence of rotatory inertia and shear on flexural motions of isotropic, elastic plates, 1951.
    """
    walls = []
    for material, rows in materials:
        worst = rows[_resolved(length[rows], thickness[rows], order, material, _SEEN).argmin()]
        walls.append(Wall(float(thickness[worst]), float(length[worst]), order, material))
    return min(walls, key=lambda wall: wall.frequency)


def stiff_wall(
    length: Array, thickness: Array, area: Array, size: float, order: int, material: Material
) -> Wall | None:
    """Wall, of a tenth of the surface at least, that its elements make more than 5 % too stiff in bending.

    A linear hexahedron shears where it should bend, so that a wall is too stiff by G / E' (L / t)^2, with E' that of
    plane strain; wedges and tetrahedra are stiffer still. Quadratic elements lock in shear beyond L = 5 t: plates that
    are clamped all around are too stiff then (`tests/fe/test_walls.py`). Where bending is even, they are exact.

    Parameters
    ----------
    length, thickness, area : (nf,) array
        See `at_facets`; area of each facet [m2].
    size : float
        Length of the body [m]. It bends where it is at least five times as long as a wall is thick.
    order : {1, 2, 3}
        Of the elements.
    material : Material

    Returns
    -------
    Wall or None
        A typical one of those that are too stiff.
    """
    ratio = length / thickness
    bound = {1: np.sqrt(_STIFF * material.plane_strain_modulus / material.shear_modulus), 2: _LOCKS, 3: np.inf}[order]
    stiff = (ratio > (1 + _EQUAL) * bound) & (size > _SLENDER * thickness)
    if area[stiff].sum() <= _A_WALL * area.sum():
        return None
    rows = np.flatnonzero(stiff)
    typical = rows[np.argsort(ratio[rows])[len(rows) // 2]]
    return Wall(float(thickness[typical]), float(length[typical]), order, material)


def weakest_between(points: Array, facets: Array, order: int, material: Material) -> Wall:
    """`weakest_wall` of a body whose elements are not known, by the corners of its facets, (nf, 3) or (nf, 4) int."""
    length = _lengths(points, facets)
    thickness = _distance_to_opposite(points, facets, _THICK * length)
    return weakest_wall(length, thickness, order, ((material, np.arange(len(facets))),))


def shares_of_walls(points: Array, elements: Array, corners: Array, facets: Array, number: Array) -> Array:
    """Height of elements by the thickness of the wall in which they lie, (k,); zero in solid parts of a body.

    The wall is the thinnest at the nearest facets of the surface, also at the edge of a plate. See `weakest_wall` for
    other arguments.

    Parameters
    ----------
    elements : (k, c) int array
        Their corners.
    """
    faces = points[corners[facets[:, 0], facets[:, 1]]]
    nearest = cKDTree(faces.mean(axis=1)).query(points[elements].mean(axis=1), k=min(_NEAREST, len(faces)))[1]
    used, place = np.unique(nearest, return_inverse=True)
    thickness = _thickness(points, corners, facets[used], number, np.full(len(used), np.inf))
    normal = np.cross(faces[used, 2] - faces[used, 0], faces[used, -1] - faces[used, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    of_walls = normal / thickness[:, None]
    heights = [
        np.ptp(np.einsum("eki,ei->ek", points[elements], of_walls[at]), axis=1) for at in place.reshape(nearest.shape).T
    ]
    shares: Array = np.max(heights, axis=0)
    return shares


def _resolved(
    length: Array | float,
    thickness: Array | float,
    order: int,
    material: Material,
    needs: Mapping[int, tuple[float, float, float]],
) -> Array:
    """Frequency up to which bending waves have the elements that they need, [Hz]; long elements need more of them."""
    ratio = length / thickness
    if order == 1:
        return np.where(ratio > (1.0 if needs == _FOLLOWED else _LOCKS_LINEAR), 0.0, np.inf)
    by_ratio, least, most = needs[order]
    needed = np.clip(by_ratio * ratio, least, most) * np.maximum(1, (ratio / _LOCKS) ** _LOCKING[order])
    return bending_frequency(2 * np.pi / (needed * length), thickness, material)


def bending_frequency(wavenumber: Array | float, thickness: Array | float, material: Material) -> Array:
    """Frequency of bending waves in plates by Mindlin's theory [Hz]; infinite if the thickness is.

    Parameters
    ----------
    wavenumber : (...) array
        [rad/m]
    thickness : (...) array
        [m]
    material : Material
    """
    finite = np.isfinite(thickness)
    t, k = np.where(finite, thickness, 1.0), wavenumber
    inertia, mass = material.rho * t**3 / 12, material.rho * t
    bending = material.plane_strain_modulus * t**3 / 12 * k**2
    shear = _SHEAR * material.shear_modulus * t
    # The lower root of a w^4 - b w^2 + c = 0, in the form without cancellation.
    a, c = mass * inertia, shear * k**2 * bending
    b = inertia * shear * k**2 + mass * (bending + shear)
    omega = np.sqrt(2 * c / (b + np.sqrt(b * b - 4 * a * c)))
    return np.where(finite, omega / (2 * np.pi), np.inf)


def _lengths(points: Array, facets: Array) -> Array:
    """(nf,) array: mean length of each facet and its neighbours [m]; of an equilateral triangle or square, its edge."""
    nodes = points[facets]
    arms = nodes - nodes.mean(axis=1, keepdims=True)
    largest = np.linalg.eigvalsh(np.einsum("fki,fkj->fij", arms, arms))[:, -1]
    length = np.sqrt(largest * (2 if facets.shape[1] == 3 else 1))
    # Several neighbours together resolve a wave.
    weight = np.bincount(facets.ravel(), minlength=len(points))
    at_nodes = np.bincount(facets.ravel(), np.repeat(length, facets.shape[1]), minlength=len(points))
    lengths: Array = (at_nodes / np.maximum(weight, 1))[facets].mean(axis=1)
    return lengths


def _thickness(points: Array, corners: Array, facets: Array, number: Array, limit: Array) -> Array:
    """(nf,) array: distance from the middle of each facet, through the body, to the opposite side [m].

    Infinite where it is above `limit`, or where the opposite side is not nearly parallel.
    """
    nodes = points[corners]
    middle = nodes.mean(axis=2)
    first, second, third, fourth = (nodes[:, :, i] for i in (0, 1, 2, -1))
    normal = np.cross(third - first, fourth - second)
    length = np.linalg.norm(normal, axis=2, keepdims=True)
    normal /= np.where(length > 0, length, 1.0)  # faces that a wedge or pyramid does not have have none
    across = _other_sides(number)
    cell, face = facets.T
    start, outward = middle[cell, face], normal[cell, face]
    thickness = np.full(len(facets), np.inf)
    ray = np.arange(len(facets))
    for _ in range(_STEPS):
        if not len(ray):
            break
        slope = -np.einsum("rfi,ri->rf", normal[cell], outward[ray])
        height = np.einsum("rfi,rfi->rf", normal[cell], middle[cell] - start[ray, None])
        way = np.divide(height, slope, out=np.full_like(height, np.inf), where=slope > 1e-9)
        way[np.arange(len(ray)), face] = np.inf  # where it came in
        face = way.argmin(axis=1)
        way = way[np.arange(len(ray)), face]
        code = across[cell, face]
        out = (code < 0) & (np.einsum("ri,ri->r", normal[cell, face], outward[ray]) < _OPPOSITE) & (way > 0)
        thickness[ray[out]] = way[out]
        on = (code >= 0) & (way < limit[ray])
        ray, code = ray[on], code[on]
        cell, face = code // number.shape[1], code % number.shape[1]
    return np.where(thickness < limit, thickness, np.inf)


def _distance_to_opposite(points: Array, facets: Array, limit: Array) -> Array:
    """(nf,) array: distance of each facet to the nearest parallel one that lies behind it, through the body [m].

    Infinite where that is above `limit`. A facet lies behind another one if the normal through the middle of that one
    passes its own middle at no more than its size.
    """
    nodes = points[facets]
    middle = nodes.mean(axis=1)
    normal = np.cross(nodes[:, 2] - nodes[:, 0], nodes[:, -1] - nodes[:, 1])
    size = np.linalg.norm(nodes - middle[:, None], axis=2).max(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    near = cKDTree(middle).query_ball_point(middle, limit + size.max())
    front = np.repeat(np.arange(len(facets)), [len(found) for found in near])
    back = np.concatenate(near).astype(np.int64)
    away = middle[back] - middle[front]
    depth = -np.einsum("pi,pi->p", away, normal[front])
    aside = np.linalg.norm(away + depth[:, None] * normal[front], axis=1)
    opposite = np.einsum("pi,pi->p", normal[front], normal[back]) < _OPPOSITE
    behind = opposite & (depth > 0) & (depth < limit[front]) & (aside <= size[back])
    thickness = np.full(len(facets), np.inf)
    np.minimum.at(thickness, front[behind], depth[behind])
    return thickness


def _other_sides(number: Array) -> Array:
    """(ne, faces of a cell) int array: of each face, its row in the neighbour, flat; -1 on the surface."""
    flat = number.ravel()
    order = np.argsort(flat, kind="stable")
    same = np.flatnonzero(flat[order][1:] == flat[order][:-1])
    opposite = np.full(len(flat), -1)
    same = same[flat[order][same] >= 0]
    opposite[order[same]], opposite[order[same + 1]] = order[same + 1], order[same]
    return opposite.reshape(number.shape)
