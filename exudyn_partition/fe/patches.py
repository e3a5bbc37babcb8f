"""Parts of a body's surface: contact patches, and interfaces for joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from ..errors import EmptyRegionError, InputError
from ..support.arrays import Array, Vector
from ..support.checks import (
    check_floats,
    check_indices,
    read_only,
    validate_choice,
    validate_flag,
    validate_text,
    validate_type,
    validate_vector,
    validate_whole,
)
from .elements import centres_of
from .faces import middle
from .facets import nodal_area
from .material import Material
from .model import FEModel, rigid_modes
from .patch_facets import Faces, chosen_facets, named_facets, show
from .quadrature import edge_lengths, edges_between, facet_forces

PatchAxes = Literal["normal", "xyz"]
InterfaceKind = Literal["rigid", "averaged"]

AXES: tuple[PatchAxes, ...] = get_args(PatchAxes)
KINDS: tuple[InterfaceKind, ...] = get_args(InterfaceKind)

_NODES = (3, 4, 6, 8, 10)  # of a facet
_UNIT = 1e-9  # allowed error of a unit vector's length
_REACHES = 0.75  # of the radius of a plastic zone: elements with a node nearer to its centre belong to it
_FLAT = 1e-6  # least extent of an interface across its longest axis, by its size


@dataclass(frozen=True, eq=False)
class PlasticRegion:
    """Elements beneath a contact patch that may yield (the paper's impact region II).

    Parameters
    ----------
    cells : (nc, k) int array
        The elements, as nodes of the body.
    border : (k,) int array
        Nodes that they share with other elements.
    hexahedra : bool
        Whether rows of cells are those of hexahedra, see `fe.elements`; those of 8 nodes always are.
    """

    cells: Array
    border: Array
    hexahedra: bool = False

    def __post_init__(self) -> None:
        check_indices("cells", self.cells, (None, None))
        check_indices("border", self.border, (None,))
        validate_flag("hexahedra", self.hexahedra)
        if self.cells.shape[1] == 8:
            object.__setattr__(self, "hexahedra", True)
        read_only(self.cells, self.border)

    @property
    def nodes(self) -> Array:
        """(nz,) int array: nodes of the elements, ascending."""
        return np.unique(self.cells)


def plastic_region(fem: FEModel, center: Array, radius: float) -> PlasticRegion:
    """Elements whose centre lies within `radius` [m] of a point, (3,) [m], and those that reach far into this ball.

    A mesh gets coarser outwards. A large element whose centre lies outside may reach to the middle of the ball. There
    the zone would be as narrow as that. So elements with a node within three quarters of the radius belong to it too.

    Raises
    ------
    EmptyRegionError
        If there is none.
    InputError
        If the elements are not known, or of several materials.
    """
    fem.need_cells("plastic flow")
    away = np.linalg.norm(centres_of(fem.points, fem.cells, fem.hexahedra) - center, axis=1)
    within = away <= radius
    if not within.any():
        raise EmptyRegionError(
            f"plastic_radius: no element has its centre within {radius:.4g} m of the patch's center, the nearest is "
            f"{away.min():.4g} m away. Refine the mesh there, or enlarge the radius"
        )
    if fem.regions is not None and (np.ptp(fem.regions.number[within]) or np.ptp(fem.regions.E[within])):
        raise InputError(
            f"plastic_radius: expected elements of one material within {radius:.4g} m of the patch's center, got "
            "several materials or moduli. Take a smaller radius"
        )
    reaches = (np.linalg.norm(fem.points - center, axis=1) <= _REACHES * radius)[fem.cells].any(axis=1)
    if fem.regions is not None:
        for kind in (fem.regions.number, fem.regions.E):
            reaches &= kind == kind[within][0]
    within |= reaches
    border = np.intersect1d(fem.cells[within], fem.cells[~within])
    return PlasticRegion(fem.cells[within], border, fem.hexahedra)


@dataclass(frozen=True, eq=False)
class Patch:
    """A contact patch: the surface facets that may touch, and the directions of its residual flexibility.

    Parameters
    ----------
    facets : (nf, 3), (nf, 6), (nf, 10), (nf, 4) or (nf, 8) int array
        Surface facets, as nodes of the body; a triangle among quadrilaterals is `a b c c`, see `fe.elements`.
    direction : (3,) array
        Unit outward normal, area-weighted mean: the line of contact. With `normals` it only turns pictures.
    rim : (k,) int array
        Nodes of the patch beyond which the surface continues: contact that reaches them leaves the patch.
    axes : {"normal", "xyz"}
        Whether contact forces act along the normals only, or along all three axes.
    direction_given : bool
        Whether the user gave `direction`.
    name : str
    plastic : PlasticRegion or None
        What may yield beneath it.
    material : Material or None
        That of the elements beneath it, if the body consists of several; see `FEModel.material_beneath`.
    normals : (np, 3) array or None
        Unit outward normals of its nodes, if contact wanders over it; None: `direction` everywhere.
    extent : (3,) array or None
        Lengths along the body's axes [m], for print; None: not known, as of old files.
    ends : (k,) int array or None
        Nodes on sharp edges of the body at which it ends, see `patch_facets.sharp_ends`; None: there are none.
    """

    facets: Array
    direction: Array
    rim: Array
    axes: PatchAxes = "normal"
    direction_given: bool = False
    name: str = ""
    plastic: PlasticRegion | None = None
    material: Material | None = None
    normals: Array | None = None
    extent: Array | None = None
    ends: Array | None = None

    def __post_init__(self) -> None:
        check_facets(self.facets)
        check_floats("direction", self.direction, (3,))
        if abs(np.linalg.norm(self.direction) - 1) > _UNIT:
            raise InputError(f"direction: expected a unit vector, got {self.direction}")
        check_indices("rim", self.rim, (None,))
        validate_choice("axes", self.axes, AXES)
        validate_flag("direction_given", self.direction_given)
        validate_text("name", self.name)
        read_only(self.facets, self.direction, self.rim)
        if self.normals is not None:
            check_floats("normals", self.normals, (len(self.nodes), 3))
            if (abs(np.linalg.norm(self.normals, axis=1) - 1) > _UNIT).any():
                raise InputError("normals: expected unit vectors")
            read_only(self.normals)
        if self.extent is not None:
            check_floats("extent", self.extent, (3,))
            read_only(self.extent)
        if self.ends is not None:
            check_indices("ends", self.ends, (None,))
            read_only(self.ends)

    def __repr__(self) -> str:
        size = (
            ""
            if self.extent is None
            else " x ".join(f"{length:.4g}" for length in 1e3 * self.extent.round(9)) + " mm, "
        )
        kind = "a surface" if self.wanders else "a region"
        return (
            f"Patch({self.name!r}, {kind}, {len(self.nodes)} nodes, {len(self.facets)} facets, {size}"
            f"axes={self.axes!r}, outwards {(self.direction.round(3) + 0.0).tolist()})"  # no -0.0
        )

    @property
    def wanders(self) -> bool:
        """Whether contact wanders over it, along local normals; see `Partition.surface`."""
        return self.normals is not None

    @cached_property
    def nodes(self) -> Array:
        """(np,) int array: nodes of the patch, ascending."""
        nodes = np.unique(self.facets)
        read_only(nodes)
        return nodes

    @property
    def n_axes(self) -> int:
        """Number of rows of each node, one or three."""
        return 1 if self.axes == "normal" else 3

    @property
    def node_normals(self) -> Array:
        """(np, 3) array: unit outward normals of its nodes."""
        return np.tile(self.direction, (len(self.nodes), 1)) if self.normals is None else self.normals


@dataclass(frozen=True, eq=False)
class Interface:
    """Nodes of a joint; their mean motion has three translations and three rotations.

    Parameters
    ----------
    name : str
    nodes : (k,) int array
        Ascending.
    kind : {"rigid", "averaged"}
        "rigid": the nodes move as one rigid body (RBE2). "averaged": the nodes stay flexible, and a force or moment of
        the joint is spread over them (RBE3).
    position : (3,) array
        Reference point of the motion, where joints attach [m].
    weights : (k,) array
        Share of each node in the mean; the sum is one. By area if the nodes are those of a surface, else equal.
    motion : (6, 3k) array
        Mean translation [m] and rotation [rad] by the nodes' displacements, by weighted least squares. The transposed
        matrix gives the nodal forces of unit forces and moments on the interface.
    """

    name: str
    nodes: Array
    kind: InterfaceKind
    position: Array
    weights: Array
    motion: Array

    def __post_init__(self) -> None:
        validate_text("name", self.name)
        check_indices("nodes", self.nodes, (None,))
        validate_choice("kind", self.kind, KINDS)
        check_floats("position", self.position, (3,))
        check_floats("weights", self.weights, (len(self.nodes),))
        check_floats("motion", self.motion, (6, 3 * len(self.nodes)))
        read_only(self.nodes, self.position, self.weights, self.motion)

    def __repr__(self) -> str:
        at = (self.position.round(6) + 0.0).tolist()
        return f"Interface({self.name!r}, {self.kind}, {len(self.nodes)} nodes, position {at} m)"

    def rigid_motion(self, fem: FEModel) -> Array:
        """(3k, 6) array: displacements of the nodes by unit translations and rotations about `position`."""
        return rigid_modes(fem.points[self.nodes] - self.position)


@dataclass(frozen=True, eq=False)
class LoadPattern:
    """A distributed load: the nodal forces of a unit of it.

    Parameters
    ----------
    name : str
    nodes : (k,) int array
        Ascending.
    forces : (k, 3) array
        By a pressure or traction of 1 Pa [N/Pa], or by a line load of 1 N/m [m], in the body's axes.
    """

    name: str
    nodes: Array
    forces: Array

    def __post_init__(self) -> None:
        validate_text("name", self.name)
        check_indices("nodes", self.nodes, (None,))
        check_floats("forces", self.forces, (len(self.nodes), 3))
        read_only(self.nodes, self.forces)

    def __repr__(self) -> str:
        return f"LoadPattern({self.name!r}, {len(self.nodes)} nodes)"


def interface_of(
    fem: FEModel, name: str, nodes: Sequence[int] | Array | str, kind: InterfaceKind, position: Vector | None
) -> Interface:
    """Do the work of `Partition.interface`."""
    validate_type("fem", fem, FEModel, "fe_model()")
    validate_choice("kind", kind, KINDS)
    if isinstance(nodes, str):
        nodes = fem.facets[named_facets(fem, "nodes", nodes)]
    nodes = np.unique(validate_whole("nodes", nodes, "whole numbers of nodes or the name of a boundary"))
    if not nodes.size:
        raise EmptyRegionError(f"nodes: interface {name!r} has none; expected at least three that span a plane")
    if nodes[0] < 0 or nodes[-1] >= fem.n_nodes:
        raise InputError(f"nodes: expected numbers of nodes, 0 to {fem.n_nodes - 1}, got {nodes[0]} to {nodes[-1]}")
    spanned = fem.facets[np.isin(fem.facets, nodes).all(axis=1)]
    if np.isin(nodes, spanned).all():
        area = nodal_area(fem.points, spanned)[nodes]
        weights = area / area.sum()
        mean = middle(fem.points, spanned)
    else:  # some nodes may span a few facets by chance, which must not carry everything
        weights = np.full(len(nodes), 1 / len(nodes))
        mean = weights @ fem.points[nodes]
    sizes = np.linalg.svd(np.sqrt(weights)[:, None] * (fem.points[nodes] - mean), compute_uv=False)
    if len(nodes) < 3 or sizes[1] <= _FLAT * sizes[0]:
        raise InputError(
            f"nodes: interface {name!r} has {len(nodes)} nodes that lie on one line, so that its rotation about it "
            "is not defined; expected at least three that span a plane"
        )
    place = mean if position is None else _checked_place(fem, name, mean, position)
    motions = rigid_modes(fem.points[nodes] - place)
    weighted = motions * np.repeat(weights, 3)[:, None]
    motion = np.linalg.solve(motions.T @ weighted, weighted.T)
    return Interface(name, nodes, kind, place, weights, motion)


def _checked_place(fem: FEModel, name: str, mean: Array, position: Vector) -> Array:
    """Return an interface's point that the user gave."""
    place = validate_vector("position", position)
    away, size = np.linalg.norm(place - mean), np.ptp(fem.points, axis=0).max()
    if away > size:
        raise InputError(
            f"position: expected the point where joints attach, in the body's own coordinates, got {show(place)}, "
            f"{away:.4g} m away from the nodes of interface {name!r} around {show(mean)}, of a body of {size:.4g} m"
        )
    return place


def _node_numbers(name: str, value: Sequence[int] | Array | None, fem: FEModel) -> Array:
    """Return numbers of nodes of an FE model."""
    nodes = validate_whole(name, value, "numbers of nodes, (k,)")
    if nodes.ndim != 1:
        raise InputError(f"{name}: expected numbers of nodes, (k,), got shape {nodes.shape}")
    if not nodes.size:
        raise EmptyRegionError(f"{name}: has no nodes; expected some along edges of the mesh")
    if nodes.min() < 0 or nodes.max() >= fem.n_nodes:
        raise InputError(
            f"{name}: expected numbers of nodes, 0 to {fem.n_nodes - 1}, got {nodes.min()} to {nodes.max()}"
        )
    return nodes


def load_pattern(
    fem: FEModel, name: str, faces: Faces | None, line: Sequence[int] | Array | None, direction: Vector | None
) -> LoadPattern:
    """Do the work of `Partition.load`."""
    if (faces is None) == (line is None):
        raise InputError("faces, line: expected one of them, got " + ("none" if faces is None else "both"))
    way = None
    if direction is not None:
        way = validate_vector("direction", direction)
        if not np.linalg.norm(way):
            raise InputError("direction: expected a vector that has a length, got zero")
        way = way / np.linalg.norm(way)
    forces = np.zeros((fem.n_nodes, 3))
    if faces is not None:
        facets = fem.facets[chosen_facets(fem, faces)]
        np.add.at(forces, facets, facet_forces(fem.points, facets, way))
    else:
        if way is None:
            raise InputError("direction: a line load needs one, in the body's axes")
        edges = edges_between(fem.facets, _node_numbers("line", line, fem))
        np.add.at(forces, edges, edge_lengths(fem.points, edges)[:, :, None] * way)
    nodes = np.flatnonzero(forces.any(axis=1))
    return LoadPattern(name, nodes, forces[nodes])


def check_facets(facets: Array, n_nodes: int | None = None) -> None:
    """Refuse what are no facets of known kinds, or facets with nodes beyond `n_nodes`.

    Raises
    ------
    InputError
    """
    check_indices("facets", facets, (None, None), n_nodes)
    if facets.shape[1] not in _NODES or not len(facets):
        raise InputError(f"facets: expected shape (n, 3), (n, 4), (n, 6), (n, 8) or (n, 10), got {facets.shape}")


PARTS = (Patch, PlasticRegion, Interface, LoadPattern)  # of a partition, as files know them
