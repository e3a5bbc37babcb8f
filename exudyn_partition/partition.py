"""Partition of a body: which nodes belong to the impact region, and which of them may touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ._checks import read_only, validate_positive, validate_vector
from .errors import EmptyRegionError, InputError
from .fem import FEModel, area_vectors, facet_corners

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Partition:
    """Impact region II of a body (paper, eq. 11) and its contact patch.

    Parameters
    ----------
    nodes : (k,) int array
        Nodes of the impact region, ascending.
    facets : (nf, 3), (nf, 6) or (nf, 4) int array
        Surface facets of the contact patch, as nodes of the body.
    direction : (3,) array
        Unit outward normal of the patch, area-weighted mean: the line of contact, along which the residual
        flexibility is computed.
    rim : (k,) int array
        Nodes of the patch at which the body's surface goes on towards the other body: contact that reaches them
        leaves the patch.
    n_nodes : int
        Nodes of the FE model.
    direction_given : bool
        Whether the user gave `direction`.
    """

    nodes: Array
    facets: Array
    direction: Array
    rim: Array
    n_nodes: int
    direction_given: bool = False

    def __post_init__(self) -> None:
        read_only(self.nodes, self.facets, self.direction, self.rim)

    @property
    def patch_nodes(self) -> Array:
        """(np,) int array: nodes of the contact patch, ascending."""
        return np.unique(self.facets)

    @classmethod
    def ball(
        cls,
        fem: FEModel,
        center: Array,
        radius: float,
        *,
        contact_radius: float | None = None,
        direction: Array | None = None,
    ) -> Partition:
        """Impact region of all nodes within a ball; the facets centred within it are the contact patch.

        Parameters
        ----------
        fem : FEModel
        center : (3,) array
            Centre of the ball [m], usually the point of first contact.
        radius : float
            Radius of the impact region [m].
        contact_radius : float, optional
            Radius of the patch where contact can happen, at most `radius` [m]; nodes that can never touch need no
            contact rows. Default: `radius`. `hertz.contact_radius` estimates how far a contact reaches.
        direction : (3,) array, optional
            The line of contact, outward; default: the patch's mean normal, which its mesh makes uncertain by some
            1e-3 rad. Give it for curved patches that start far apart.

        Raises
        ------
        EmptyRegionError
            If the ball holds no node, no surface facet, or lies outside the body.
        InputError
            If an argument has a wrong shape or is not finite.
        """
        center = validate_vector("center", center)
        radius = validate_positive("radius", radius, "m")
        reach = radius if contact_radius is None else validate_positive("contact_radius", contact_radius, "m")
        if reach > radius:
            raise InputError(f"contact_radius: expected at most radius = {radius:.4g} m, got {reach:.4g} m")
        distance = np.linalg.norm(fem.points - center, axis=1)
        nodes = np.flatnonzero(distance <= radius)
        if not len(nodes):
            raise EmptyRegionError(
                f"no node lies within {radius:.4g} m of {_show(center)}: the nearest is {distance.min():.4g} m away, "
                f"at {_show(fem.points[distance.argmin()])}; the body spans {_show(fem.points.min(axis=0))} to "
                f"{_show(fem.points.max(axis=0))} m. Move the center, enlarge the radius or refine the mesh there"
            )
        centres = fem.points[facet_corners(fem.facets)].mean(axis=1)
        within = np.linalg.norm(centres - center, axis=1) <= reach
        if not within.any():
            raise EmptyRegionError(
                f"no surface facet lies within {reach:.4g} m of {_show(center)}, so nothing there can touch: "
                f"{len(nodes)} nodes are in the region. Put the center on the surface, or refine the mesh to elements "
                f"below {reach:.2g} m"
            )
        normals = area_vectors(fem.points, fem.facets)
        # The normal at the center leads; the mean of all would be lost on a patch that goes around an edge.
        surface = np.unique(fem.facets)
        foot = surface[distance[surface].argmin()]
        line = _direction(normals[(fem.facets == foot).any(axis=1)], direction)
        # Side walls beyond an edge cannot touch along the line of contact.
        facing = normals @ line > 0.5 * np.linalg.norm(normals, axis=1)
        if direction is None:
            line = _direction(normals[within & facing], None)
        facets = fem.facets[within & facing]
        if not len(facets):
            raise EmptyRegionError(
                f"no facet within {reach:.4g} m of {_show(center)} faces the line of contact {_show(line)}; give "
                "another direction or center"
            )
        rim = np.intersect1d(facets, fem.facets[~within & facing])
        return cls(np.union1d(nodes, facets), facets, line, rim, fem.n_nodes, direction is not None)


def _direction(normals: Array, direction: Array | None) -> Array:
    mean = normals.sum(axis=0)
    mean = mean / np.linalg.norm(mean)
    if direction is None:
        return mean
    given = validate_vector("direction", direction)
    length = np.linalg.norm(given)
    if length == 0 or given @ mean < 0.5 * length:
        raise InputError(
            f"direction: expected a vector that points out of the patch, whose mean normal is {_show(mean)}, "
            f"got {_show(given)}"
        )
    return given / length


def _show(vector: Array) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in vector) + ")"
