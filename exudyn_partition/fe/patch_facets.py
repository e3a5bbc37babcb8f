"""Which facets of a body's surface a contact patch has, their normals, and where the patch ends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import EmptyRegionError, InputError
from ..support.arrays import Array, Vector
from ..support.checks import validate_array, validate_choice, validate_vector, validate_whole
from .edges import flat_facets, sharp_nodes
from .facets import area_vectors, by_shape, facet_corners, of_one_shape, unfolded
from .model import FEModel
from .places import distance_within

Faces = str | Sequence[str] | Array | Sequence[int] | tuple[Vector, Vector]

_FACING = 0.5  # cosine between two normals: below it there is an edge between them
_NO_NORMAL = 1e-3  # of the area around a node: its normals cancel each other


def ball_facets(
    fem: FEModel, center: Array, reach: float, long_axis: Array | None, direction: Vector | None, nodes: Array
) -> tuple[Array, Array, Array]:
    """Numbers of the facets of a patch within `reach` [m] of a point, its line of contact, (3,), and nodes at its rim.

    Parameters
    ----------
    fem : FEModel
    center : (3,) array
    reach : float
    long_axis : (3,) array, optional
        Longer semi-axis of an ellipsoid [m], across which `reach` is.
    direction : (3,) array, optional
        The line of contact that the user gave.
    nodes : (k,) int array
        Nodes of the impact region, for messages.

    Raises
    ------
    EmptyRegionError
        If there is none.
    InputError
        If the direction does not point out of the patch.
    """
    centres = fem.points[facet_corners(fem.facets)].mean(axis=1)
    within = distance_within(centres, center, reach, long_axis) <= reach
    if not within.any():
        raise EmptyRegionError(
            f"no surface facet lies within {reach:.4g} m of {show(center)}, so nothing there can touch: "
            f"{len(nodes)} nodes are in the region. Put the center on the surface, or refine the mesh to elements "
            f"below {reach:.2g} m"
        )
    normals = area_vectors(fem.points, fem.facets)
    distance = np.linalg.norm(fem.points - center, axis=1)
    # Begin with the normal at the center: the mean of all normals means little on a patch around an edge.
    surface = np.unique(fem.facets[_facing(normals, within, direction)])
    foot = surface[distance[surface].argmin()]
    line = _direction(normals[(fem.facets == foot).any(axis=1)], direction)
    # Facets beyond an edge, such as side walls, cannot touch along the line of contact.
    facing = normals @ line > _FACING * np.linalg.norm(normals, axis=1)
    chosen = np.flatnonzero(within & facing)
    if not len(chosen):
        met = "" if direction is not None else ", the mean normal there, because faces meet at an edge or a corner"
        raise EmptyRegionError(
            f"no facet within {reach:.4g} m of {show(center)} faces the line of contact {show(line)}{met}. Give "
            f"{'another' if direction is not None else 'a'} direction=, outward, or another center, or enlarge the "
            "radius"
        )
    if direction is None:
        line = _direction(normals[chosen], None)
    return chosen, line, np.intersect1d(fem.facets[chosen], fem.facets[~within & facing])


def named_facets(fem: FEModel, argument: str, name: str) -> Array:
    """Numbers of the facets on the boundary that `argument` names, (k,) int array.

    Raises
    ------
    InputError
        If no boundary has this name.
    EmptyRegionError
        If none of its faces is on the surface.
    """
    if not fem.boundaries:
        raise InputError(
            f"{argument}: expected numbers, for no boundary of this mesh has a name, got {name!r}. Name faces of the "
            "shape, or surface elements or sets of nodes of the file"
        )
    facets = fem.boundaries[validate_choice(argument, name, fem.boundaries)]
    if not len(facets):
        raise EmptyRegionError(
            f"{argument}: expected a boundary on the body's surface, but no face of {name!r} is there; it lies inside "
            "the body, as between two of its regions, or beside it"
        )
    return facets


def chosen_facets(fem: FEModel, faces: Faces) -> Array:
    """Numbers of the facets that `Partition.surface` was asked for, (k,), ascending.

    Raises
    ------
    InputError, EmptyRegionError
    """
    n = len(fem.facets)
    if isinstance(faces, str):
        faces = [faces]
    if isinstance(faces, list | tuple) and faces and all(isinstance(face, str) for face in faces):
        return np.unique(np.concatenate([named_facets(fem, "faces", face) for face in faces]))
    wrong = InputError(
        "faces: expected names of boundaries, numbers of facets, (k,), a choice of them, (nf,) bool, or two corners of "
        f"a box, ((3,), (3,)), got {type(faces).__name__}"
    )
    try:
        given = np.asarray(faces)
    except ValueError as error:
        raise wrong from error
    if given.shape == (2, 3) and given.dtype.kind in "iuf":
        lower, upper = validate_array("faces", faces, (2, 3))
        if (lower > upper).any():
            raise InputError(f"faces: expected lower and upper corner of a box, got {show(lower)} and {show(upper)}")
        centres = fem.points[facet_corners(fem.facets)].mean(axis=1)
        number = np.flatnonzero(((centres >= lower) & (centres <= upper)).all(axis=1))
        if not len(number):
            raise EmptyRegionError(
                f"faces: no facet is centred in the box from {show(lower)} to {show(upper)} m; the body spans "
                f"{show(fem.points.min(axis=0))} to {show(fem.points.max(axis=0))} m. Move or enlarge the box"
            )
        return number
    if given.shape == (n,) and given.dtype.kind == "b" and not np.ma.is_masked(faces):
        given = np.flatnonzero(given)
    elif given.ndim != 1 or (given.size and given.dtype.kind not in "iu"):
        raise wrong
    else:
        given = validate_whole("faces", faces, "numbers of facets")
    if not given.size:
        raise EmptyRegionError("faces: no facet is chosen; expected at least one")
    if given.min() < 0 or given.max() >= n:
        raise InputError(f"faces: expected numbers of facets, 0 to {n - 1}, got {given.min()} to {given.max()}")
    return np.unique(given)


def local_normals(points: Array, facets: Array) -> Array:
    """(k, 3) unit outward normals of the facets' nodes, ascending: means over the areas of their facets.

    Raises
    ------
    InputError
        If the normals around a node cancel each other.
    """
    nodes, place = np.unique(facets, return_inverse=True)
    vectors = area_vectors(points, facets)
    around = np.zeros((len(nodes), 4))
    each = np.column_stack([vectors, np.linalg.norm(vectors, axis=1)])
    place = place.reshape(facets.shape)
    for rows, columns in by_shape(facets):
        for column in place[rows][:, columns].T:
            np.add.at(around, column, each[rows])
    length = np.linalg.norm(around[:, :3], axis=1)
    flat = np.flatnonzero(length <= _NO_NORMAL * around[:, 3])
    if len(flat):
        raise InputError(
            f"faces: at node {nodes[flat[0]]}, {show(points[nodes[flat[0]]])} m, the normals of the facets cancel each "
            "other, as where both sides of a sheet or of a sharp edge belong to one patch. Make a patch of each side"
        )
    normals: Array = around[:, :3] / length[:, None]
    return normals


def mean_direction(points: Array, facets: Array) -> Array:
    """Unit mean normal of facets, (3,); that of the first one if the facets go around the body."""
    vectors = area_vectors(points, facets)
    total = vectors.sum(axis=0)
    if np.linalg.norm(total) <= _NO_NORMAL * np.linalg.norm(vectors, axis=1).sum():
        total = vectors[0]
    line: Array = total / np.linalg.norm(total)
    return line


def smooth_rim(fem: FEModel, number: Array, normals: Array) -> Array:
    """Nodes of a patch beyond which the surface continues without an edge, (k,).

    `number`, (nf,), are the facets of the patch, `normals`, (k, 3), those of its nodes, ascending.
    """
    return np.unique(_beyond(fem, number, normals)[1])


def sharp_ends(fem: FEModel, number: Array) -> Array:
    """Nodes of a patch of facets `number`, (nf,), on sharp edges of the body at which it ends and is flat, (k,).

    Where a face is curved, its nodes lie further out than its facets by their sag. Rows of their own would close before
    those of the nodes within.
    """
    ours = of_one_shape(unfolded(fem.facets[number]))
    around = fem.facets[np.isin(fem.facets, ours).any(axis=1)]
    on_edges = np.intersect1d(sharp_nodes(fem.points, of_one_shape(unfolded(around))), ours)
    between = sharp_nodes(fem.points, ours)
    curved = np.setdiff1d(ours[~flat_facets(fem.points, ours)], between)
    curved = ours[np.isin(ours, curved).any(axis=1)]  # a corner's facet may be flat with the only one beside it
    return np.setdiff1d(on_edges, np.union1d(curved, between))


def widened(fem: FEModel, number: Array) -> Array:
    """Facets of a patch, (nf,), and those around it where the surface continues without an edge, ascending."""
    return np.union1d(number, _beyond(fem, number, local_normals(fem.points, fem.facets[number]))[0])


def _beyond(fem: FEModel, number: Array, normals: Array) -> tuple[Array, Array]:
    """Facets beside a patch where the surface continues without an edge, each with a node that both have, (k,)."""
    nodes = np.unique(fem.facets[number])
    outside = np.setdiff1d(np.arange(len(fem.facets)), number)
    vectors = area_vectors(fem.points, fem.facets[outside])
    vectors /= np.linalg.norm(vectors, axis=1)[:, None]
    facet, column = np.nonzero(np.isin(fem.facets[outside], nodes))
    shared = fem.facets[outside[facet], column]
    smooth = np.einsum("kd,kd->k", vectors[facet], normals[np.searchsorted(nodes, shared)]) > _FACING
    return outside[facet[smooth]], shared[smooth]


def _facing(normals: Array, within: Array, direction: Vector | None) -> Array:
    """Facets within reach that face a given direction, (nf,) bool; all facets if there are none.

    On a thin sheet, nodes of the other side may be nearer to the center than those of this side.
    """
    everywhere = np.ones(len(normals), dtype=bool)
    if direction is None:
        return everywhere
    given = validate_vector("direction", direction)
    facing = within & (normals @ given > _FACING * np.linalg.norm(normals, axis=1) * np.linalg.norm(given))
    return facing if facing.any() else everywhere


def _direction(normals: Array, direction: Vector | None) -> Array:
    """Unit mean of normals weighted by areas, (k, 3), or the direction that was given, if it agrees with that mean."""
    total = normals.sum(axis=0)
    sum_of_areas = np.linalg.norm(normals, axis=1).sum()
    if np.linalg.norm(total) <= _NO_NORMAL * sum_of_areas:
        raise InputError(
            "direction: the normals around the center cancel each other, so that the line of contact is not defined. "
            "Move the center onto one face"
        )
    mean: Array = total / np.linalg.norm(total)
    if direction is None:
        return mean
    given = validate_vector("direction", direction)
    length = np.linalg.norm(given)
    if length == 0 or given @ mean < _FACING * length:
        raise InputError(
            f"direction: expected a vector that points out of the patch, whose mean normal is {show(mean)}, "
            f"got {show(given)}"
        )
    line: Array = given / length
    return line


def show(vector: Array) -> str:
    """Three numbers for a message."""
    return "(" + ", ".join(f"{x:.4g}" for x in vector) + ")"
