"""Faces of a body by their geometry, as of bores and flat sides: for meshes of CAD and of files alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..errors import EmptyRegionError, InputError, SelectionWarning
from ..support.arrays import Array, Vector
from ..support.checks import validate_positive, validate_vector
from ..support.warn import warn
from .facets import area_vectors, facet_corners
from .model import FEModel
from .patch_facets import Faces, chosen_facets, show

Cylinder = tuple[Vector, Vector, float]  # point of the axis [m], its direction, radius [m]
Plane = tuple[Vector, Vector]  # point [m], outward normal of the body there

_ROUND, _FLAT = 2e-3, 1e-5  # how far corners may be from a cylinder, by its radius, or a plane, by the body's size
_ACROSS, _ALONG = 0.3, 0.99  # between normals: largest cosine with a cylinder's axis, least with a plane's normal
_SMOOTH = np.cos(np.radians(30))  # beyond this angle two facets belong to different faces
_LATTICE = 4  # in whose parts facets are divided to find the nearest one
_LISTED = 4  # faces, radii or planes in a message


def selected_facets(
    fem: FEModel, faces: Faces | None, cylinder: Cylinder | None, plane: Plane | None, near: Vector | None
) -> Array:
    """Numbers of the facets that a caller named, or chose by geometry, (k,), ascending.

    Parameters
    ----------
    fem : FEModel
    faces : optional
        See `Partition.surface`.
    cylinder : (point, axis, radius), optional
        Facets on a cylinder [m], of a bore or a pin.
    plane : (point, normal), optional
        Facets in a plane [m] whose outward normal is that one.
    near : (3,) array, optional
        Of all these, or of the whole surface, the face that is nearest to a point [m]: up to edges of 30 degrees.

    Raises
    ------
    InputError
        If nothing says which facets, or both a name and a shape do.
    EmptyRegionError
        If there are none; the message has what is there instead.

    Warns
    -----
    SelectionWarning
        If a cylinder or a plane catches several separate faces.
    """
    shapes = {"cylinder": cylinder, "plane": plane, "near": near}
    given = [name for name, value in shapes.items() if value is not None]
    if (faces is None) == (not given):
        raise InputError(
            "faces, cylinder, plane, near: expected faces, or one or more of the others, got "
            + (f"faces and {', '.join(given)}" if given else "none")
        )
    if faces is not None:
        return chosen_facets(fem, faces)
    number = np.arange(len(fem.facets))
    if cylinder is not None:
        number = np.intersect1d(number, _on_cylinder(fem, cylinder))
    if plane is not None:
        number = np.intersect1d(number, _in_plane(fem, plane))
    if not len(number):
        raise EmptyRegionError("cylinder, plane: no facet is on both; give one of them")
    part = parts(fem, number, _SMOOTH if given == ["near"] else -1.0)
    if near is not None:
        nearest = _nearest(fem, number, validate_vector("near", near))
        return np.asarray(number[part == part[nearest]])
    if part.max() > 0:
        _warn_of_parts(fem, number, part, " and ".join(given))
    return number


def parts(fem: FEModel, number: Array, smooth: float) -> Array:
    """Number of the part, from 0 on, that each of some facets, (k,) int, belongs to.

    Facets of a part hang together by edges between normals whose cosine is above `smooth`.
    """
    corners = facet_corners(fem.facets[number])
    normals = area_vectors(fem.points, fem.facets[number])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    k = corners.shape[1]
    sides = np.sort(np.column_stack([corners.ravel(), np.roll(corners, -1, axis=1).ravel()]), axis=1)
    owner = np.repeat(np.arange(len(number)), k)
    order = np.lexsort(sides.T)
    sides, owner = sides[order], owner[order]
    long = sides[1:, 0] < sides[1:, 1]  # a triangle among quadrilaterals has one without length
    same = np.flatnonzero((sides[1:] == sides[:-1]).all(axis=1) & long)
    facet, neighbour = owner[same], owner[same + 1]
    is_smooth = np.einsum("ij,ij->i", normals[facet], normals[neighbour]) > smooth
    pairs = facet[is_smooth], neighbour[is_smooth]
    joined = sp.coo_matrix((np.ones(is_smooth.sum()), pairs), shape=(len(number),) * 2)
    return np.asarray(connected_components(joined, directed=False)[1])


def _on_cylinder(fem: FEModel, cylinder: Cylinder) -> Array:
    """Facets all of whose corners are on a cylinder."""
    if not isinstance(cylinder, Sequence) or isinstance(cylinder, str) or len(cylinder) != 3:
        raise InputError(f"cylinder: expected (point of the axis, direction, radius), got {cylinder!r}")
    point = validate_vector("cylinder, point of the axis", cylinder[0])
    axis = _unit("cylinder, direction of the axis", cylinder[1])
    radius = validate_positive("cylinder, radius", cylinder[2], "m")
    away = np.linalg.norm(np.cross(fem.points - point, axis), axis=1)[facet_corners(fem.facets)]
    normals = area_vectors(fem.points, fem.facets)
    across = abs(normals @ axis) < _ACROSS * np.linalg.norm(normals, axis=1)
    on_cylinder = np.flatnonzero(across & (abs(away - radius) < _ROUND * radius).all(axis=1))
    if not len(on_cylinder):
        round_ones = across & (np.ptp(away, axis=1) < _ROUND * away.mean(axis=1))
        radii = np.unique(np.round(away[round_ones].mean(axis=1), 9))
        near = radii[np.argsort(abs(radii - radius))[:_LISTED]]
        there = ", ".join(f"{r:.6g}" for r in np.sort(near)) or "none"
        raise EmptyRegionError(
            f"cylinder: no face of the body lies on one of radius {radius:.6g} m about the axis through {show(point)} "
            f"along {show(axis)}; radii of faces about this axis [m]: {there}"
        )
    return on_cylinder


def _in_plane(fem: FEModel, plane: Plane) -> Array:
    """Facets in a plane, whose outward normal is that of the plane."""
    if not isinstance(plane, Sequence) or isinstance(plane, str) or len(plane) != 2:
        raise InputError(f"plane: expected (point, outward normal), got {plane!r}")
    point, normal = validate_vector("plane, point", plane[0]), _unit("plane, normal", plane[1])
    heights = ((fem.points - point) @ normal)[facet_corners(fem.facets)]
    normals = area_vectors(fem.points, fem.facets)
    facing = normals @ normal > _ALONG * np.linalg.norm(normals, axis=1)
    size = float(np.ptp(fem.points, axis=0).max())
    in_plane = np.flatnonzero(facing & (abs(heights) < _FLAT * size).all(axis=1))
    if not len(in_plane):
        levels = np.unique(np.round(heights[facing].mean(axis=1) / (_FLAT * size)) * _FLAT * size)
        near = levels[np.argsort(abs(levels))[:_LISTED]]
        there = ", ".join(f"{h:.6g}" for h in np.sort(near)) or "none"
        raise EmptyRegionError(
            f"plane: no face of the body with the outward normal {show(normal)} lies in the plane through "
            f"{show(point)}; faces with this normal are away from it, along the normal, by [m]: {there}"
        )
    return in_plane


def _unit(name: str, vector: Vector) -> Array:
    """Unit vector, checked."""
    value = validate_vector(name, vector)
    if not value.any():
        raise InputError(f"{name}: expected a vector that has a length, got zero")
    unit: Array = value / np.linalg.norm(value)
    return unit


def _nearest(fem: FEModel, number: Array, point: Array) -> int:
    """Place in `number` of the facet that is nearest to a point."""
    corners = fem.points[facet_corners(fem.facets[number])]
    if corners.shape[1] == 4:
        corners = np.stack([corners, np.roll(corners, 2, axis=1)])[:, :, :3]  # two triangles
    i, j = np.triu_indices(_LATTICE + 1)
    weights = np.column_stack([i, j - i, _LATTICE - j]) / _LATTICE
    away = np.linalg.norm(np.einsum("pw,...wd->...pd", weights, corners) - point, axis=-1).min(axis=-1)
    return int((away if away.ndim == 1 else away.min(axis=0)).argmin())


def _warn_of_parts(fem: FEModel, number: Array, part: Array, name: str) -> None:
    """Say which faces were caught, if there are several."""
    vectors, centres = area_vectors(fem.points, fem.facets[number]), fem.points[fem.facets[number]].mean(axis=1)
    said = []
    for face in range(min(part.max() + 1, _LISTED)):
        of_face = part == face
        area = np.linalg.norm(vectors[of_face], axis=1)
        said.append(f"{of_face.sum()} facets, {area.sum():.4g} m2, around {show(area @ centres[of_face] / area.sum())}")
    more = part.max() + 1 - len(said)
    warn(
        f"{name}: caught {part.max() + 1} separate faces: {'; '.join(said)}{f'; and {more} more' if more else ''}. If "
        "one of them is meant, give near= with a point on it",
        SelectionWarning,
    )
