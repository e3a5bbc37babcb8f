"""Partition of a body (paper, eq. 11): impact region, contact patches, and interfaces for joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import overload

import numpy as np

from ..errors import EmptyRegionError, InputError, UnitsWarning
from ..support.arrays import Array, Vector
from ..support.checks import (
    check_floats,
    check_indices,
    check_tuple,
    read_only,
    validate_choice,
    validate_integer,
    validate_items,
    validate_positive,
    validate_text,
    validate_type,
    validate_vector,
)
from ..support.warn import warn
from .edges import sharp_nodes
from .facets import of_one_shape, unfolded
from .facing import Side, connected, facing_facets
from .model import FEModel, same_mesh
from .patch_facets import Faces, ball_facets, local_normals, mean_direction, sharp_ends, show, smooth_rim, widened
from .patches import (
    AXES,
    Interface,
    InterfaceKind,
    LoadPattern,
    Patch,
    PatchAxes,
    interface_of,
    load_pattern,
    plastic_region,
)
from .places import distance_within, validate_long_axis
from .selection import Cylinder, Plane, selected_facets

_TOO_LARGE = 10.0  # radius of a ball, by the size of the body within it


@dataclass(frozen=True, eq=False)
class Partition:
    """Impact region II of a body (paper, eq. 11), its contact patches, and its interfaces for joints.

    Partitions of the same FE model are joined by `|`::

        tip = ep.Partition.ball(fem, center=(0, 0, 0), radius=1e-3, name="tip")
        pin = ep.Partition.interface(fem, "pin", nodes="bore")
        body = ep.reduce(fem, tip | pin, f_cut=40e3)

    Parameters
    ----------
    nodes : (k,) int array
        Nodes of the impact region, ascending.
    patches : tuple of Patch
    interfaces : tuple of Interface
    n_nodes : int
        Nodes of the FE model.
    mesh : (9,) array
        `FEModel.fingerprint` of the FE model.
    loads : tuple of LoadPattern

    Raises
    ------
    InputError
        If two patches, two interfaces, or an interface and the impact region share nodes, or names are not unique.
    """

    nodes: Array = field(repr=False)
    patches: tuple[Patch, ...]
    interfaces: tuple[Interface, ...]
    n_nodes: int
    mesh: Array = field(repr=False)
    loads: tuple[LoadPattern, ...] = ()

    def __post_init__(self) -> None:
        n_nodes = validate_integer("n_nodes", self.n_nodes, 1)
        check_tuple("patches", self.patches, Patch)
        check_tuple("interfaces", self.interfaces, Interface)
        check_tuple("loads", self.loads, LoadPattern)
        for patch in self.patches:
            check_indices("facets", patch.facets, patch.facets.shape, n_nodes)
            check_indices("rim", patch.rim, (None,), n_nodes)
        parts = [interface.nodes for interface in self.interfaces] + [load.nodes for load in self.loads]
        for nodes in (self.nodes, *parts):
            check_indices("nodes", nodes, (None,), n_nodes)
            if (np.diff(nodes) <= 0).any():
                raise InputError("nodes: expected each node once, ascending")
        check_floats("mesh", self.mesh, (9,))
        read_only(self.nodes, self.mesh)
        owners = [(f"patch {i} {patch.name!r}", patch.nodes) for i, patch in enumerate(self.patches)]
        joints = [(f"interface {interface.name!r}", interface.nodes) for interface in self.interfaces]
        region = [("the impact region", self.nodes)]
        for group in (owners + joints, region + joints):
            for i, (name, nodes) in enumerate(group):
                for other, others in group[:i]:
                    shared = np.intersect1d(nodes, others)
                    if len(shared):
                        raise InputError(
                            f"partition: {other} and {name} share {len(shared)} nodes, such as node {shared[0]}; "
                            "expected none. Make one of them smaller, or move it"
                        )
        named = [p.name for p in self.patches if p.name]
        for names in ([i.name for i in self.interfaces], [load.name for load in self.loads], named):
            if len(set(names)) < len(names):
                raise InputError(f"name: expected each name once, got {', '.join(map(repr, names))}")

    def __or__(self, other: Partition) -> Partition:
        validate_type("partition", other, Partition, "Partition.ball() or Partition.interface()")
        if other.n_nodes != self.n_nodes:
            raise InputError(f"partition: one is of a mesh with {self.n_nodes} nodes, the other with {other.n_nodes}")
        if not same_mesh(self.mesh, other.mesh):
            raise InputError(
                f"partition: both are of meshes with {self.n_nodes} nodes, but these differ; expected two partitions "
                "of one FE model"
            )
        return Partition(
            np.union1d(self.nodes, other.nodes),
            self.patches + other.patches,
            self.interfaces + other.interfaces,
            self.n_nodes,
            self.mesh,
            self.loads + other.loads,
        )

    def is_of(self, fem: FEModel) -> bool:
        """Whether the partition was made for the mesh of `fem`, that is for the same points and facets.

        A mesh may be moved as a whole under its patches, but not under the points of interfaces.
        """
        return same_mesh(self.mesh, fem.fingerprint, same_place=bool(self.interfaces))

    def find_load(self, name: str) -> LoadPattern:
        """Return the distributed load of that name; InputError if there is none."""
        return load_named(self, name, "name")

    def check_mesh(self, fem: FEModel, name: str = "partition") -> None:
        """Raise unless the partition is of the mesh of `fem`.

        Raises
        ------
        InputError
            Names `name`, what does not fit to the FE model.
        """
        if self.n_nodes != fem.n_nodes:
            raise InputError(
                f"{name}: is of a mesh with {self.n_nodes} nodes, made for another mesh than this FE model's, which "
                f"has {fem.n_nodes}; make it of this one"
            )
        if not self.is_of(fem):
            raise InputError(
                f"{name}: was made for another mesh with as many nodes, {fem.n_nodes}, but at other places or "
                "with other facets. Its patches would lie at the wrong place; make it anew for this FE model"
            )

    @property
    def patch_nodes(self) -> Array:
        """(np,) int array: nodes of all contact patches, ascending."""
        return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(patch.nodes for patch in self.patches)]))

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the patches leave out of the impact region, in sentences."""
        beside = np.setdiff1d(self.nodes, self.patch_nodes)
        said = (
            f"contact rows at {len(beside)} nodes of the impact region, inside the body or beside the patch "
            "(contact_radius of the partition widens the patch)"
        )
        return (said,) * bool(len(beside))

    def patch(self, key: int | str | None = None) -> int:
        """Number of a patch by `key`, its number or name; of the only one by None.

        Raises
        ------
        InputError
            If there is no such patch, or none is named and there are several.
        """
        return number_of_patch(self, key, "key")

    def find_interface(self, name: str) -> Interface:
        """Return the interface of that name; InputError if there is none."""
        return interface_named(self, name, "name")

    @classmethod
    def ball(
        cls,
        fem: FEModel,
        center: Vector,
        radius: float,
        *,
        contact_radius: float | None = None,
        long_axis: Vector | None = None,
        direction: Vector | None = None,
        axes: PatchAxes = "normal",
        plastic_radius: float | None = None,
        name: str = "",
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
            Radius of the contact patch [m], at most `radius`, the default; nodes that can never touch need no rows.
            `hertz.contact_radius` estimates how far a contact reaches.
        long_axis : (3,) array, optional
            Longer semi-axis of an ellipsoid in place of the ball [m], a vector from its centre; `radius` is then its
            size across. The patch is stretched as much. Contacts are ellipses where curvatures differ, as of crossed
            cylinders of two radii; `ImpactDesign.place` knows them for given shapes.
        direction : (3,) array, optional
            The line of contact, outward. Default: the mean normal of the patch, which depends on the mesh by some
            1e-3 rad. Give a direction for curved patches that start far apart.
        axes : {"normal", "xyz"}
            Directions in which the basis knows the flexibility of the patch: along the line of contact, which is
            enough without friction, or in all three.
        plastic_radius : float, optional
            Elements this near to `center` may yield [m], if the material has `hardening`: by their centres, and by
            their nodes up to three quarters of it. `hertz.impact` tells how far flow may reach: take its
            `plastic_radius`, and the size of two elements. A warning tells if flow reaches the edge. Default: `radius`,
            or the length of `long_axis`.
        name : str
            To tell patches of one body apart.

        Raises
        ------
        EmptyRegionError
            If the ball holds no node, no surface facet, or lies outside the body.
        InputError
            If an argument has a wrong shape or is not finite, or `long_axis` is shorter than `radius`.

        Warns
        -----
        UnitsWarning
            If a radius is ten times the size of the body. One beside `contact_radius` may be, for all nodes.
        """
        validate_type("fem", fem, FEModel, "fe_model()")
        validate_choice("axes", axes, AXES)
        center = validate_vector("center", center)
        radius = validate_positive("radius", radius, "m")
        long_axis = validate_long_axis(long_axis, radius)
        longest = None if long_axis is None else float(np.linalg.norm(long_axis))
        reach = radius if contact_radius is None else validate_positive("contact_radius", contact_radius, "m")
        if reach > radius:
            raise InputError(f"contact_radius: expected at most radius = {radius:.4g} m, got {reach:.4g} m")
        if plastic_radius is not None:
            plastic_radius = validate_positive("plastic_radius", plastic_radius, "m")
        distance = distance_within(fem.points, center, radius, long_axis)
        nodes = np.flatnonzero(distance <= radius)
        if not len(nodes):
            raise EmptyRegionError(
                f"no node lies within {radius:.4g} m of {show(center)}: the nearest is "
                f"{np.linalg.norm(fem.points[distance.argmin()] - center):.4g} m away, at "
                f"{show(fem.points[distance.argmin()])}; the body spans {show(fem.points.min(axis=0))} to "
                f"{show(fem.points.max(axis=0))} m, and the largest elements have edges of {fem.max_size:.4g} m. Move "
                "the center, enlarge the radius or refine the mesh there"
            )
        _warn_of_size(
            fem,
            radius=radius if contact_radius is None else None,
            long_axis=longest if contact_radius is None else None,
            plastic_radius=plastic_radius,
        )
        patch_axis = None if long_axis is None else long_axis * (reach / radius)
        chosen, line, rim = ball_facets(fem, center, reach, patch_axis, direction, nodes)
        facets = unfolded(fem.facets[chosen])
        material, plastic = fem.material_beneath(chosen), None
        if plastic_radius is not None and not material.plastic:
            raise InputError("plastic_radius: the material is elastic; give hardening= to it, 0 for none")
        if material.plastic:
            plastic = plastic_region(fem, center, plastic_radius or longest or radius)
        patch_material, size = None if fem.regions is None else material, np.ptp(fem.points[facets], axis=(0, 1))
        patch = Patch(facets, line, rim, axes, direction is not None, name, plastic, patch_material, extent=size)
        return cls(np.union1d(nodes, facets), (patch,), (), fem.n_nodes, fem.fingerprint)

    @classmethod
    def surface(
        cls,
        fem: FEModel,
        faces: Faces | None = None,
        *,
        cylinder: Cylinder | None = None,
        plane: Plane | None = None,
        near: Vector | None = None,
        axes: PatchAxes | None = None,
        name: str = "",
    ) -> Partition:
        """Contact patch of whole faces, over which contact may wander: the rim of a cam, a gear's flanks, a guide.

        Contact rows act along the local normals, so that a patch may curve by any angle, even around the body. The
        flexibility between all nodes is an array of up to 3000 rows, one a node, or three with `axes="xyz"`. That of
        more rows is found on demand, see `SkinFlexibility`: memory then is about that of the body's factors. Load
        patterns all over it lead the basis (`loads.resultants`).

        Sharp edges between its faces, and those at which a flat face ends, have contact rows of their own.

        Parameters
        ----------
        fem : FEModel
        faces : str, sequence of str, (k,) int array, (nf,) bool array, or two (3,) arrays
            Names of boundaries of the FE model; numbers of rows of `fem.facets`; a choice of all of them; or lower and
            upper corner of a box [m]: facets centred within it belong to the patch.
        cylinder : (point, axis, radius), optional
            Instead of `faces`: faces on a cylinder, such as a bore or a pin; a point of its axis [m], its
            direction, and its radius [m].
        plane : (point, normal), optional
            Instead: flat faces in a plane, through a point [m], with this outward normal.
        near : (3,) array, optional
            A point [m]: of these faces the one nearest to it; alone, of all faces. Faces end at edges of 30 degrees.
        axes : {"normal", "xyz"}, optional
            Directions in which the basis knows the flexibility of the nodes: along their normals, which is enough
            without friction where the surface is smooth, or in all three. Default: in all three if faces of the patch
            meet at a convex edge of more than 30 degrees.
        name : str
            To tell patches of one body apart.

        Raises
        ------
        EmptyRegionError
            If no facet is chosen.
        InputError
            If `faces` is none of these, or a node of the patch has no normal, as on a sheet whose both sides are given.

        Warns
        -----
        SelectionWarning
            If a cylinder or a plane catches several faces.
        """
        validate_type("fem", fem, FEModel, "fe_model()")
        if axes is not None:
            validate_choice("axes", axes, AXES)
        number = selected_facets(fem, faces, cylinder, plane, near)
        facets = unfolded(fem.facets[number])
        if axes is None:
            axes = "xyz" if len(sharp_nodes(fem.points, of_one_shape(facets))) else "normal"
        normals, size = local_normals(fem.points, facets), np.ptp(fem.points[facets], axis=(0, 1))
        line, rim = mean_direction(fem.points, facets), smooth_rim(fem, number, normals)
        material = None if fem.regions is None else fem.material_beneath(number)
        ends = sharp_ends(fem, number)
        patch = Patch(facets, line, rim, axes, name=name, material=material, normals=normals, extent=size, ends=ends)
        return cls(patch.nodes, (patch,), (), fem.n_nodes, fem.fingerprint)

    @classmethod
    def skin(
        cls, fem: FEModel, beside: Partition | None = None, *, axes: PatchAxes = "xyz", name: str = "skin"
    ) -> Partition:
        """Contact patch of all faces of a body, where nobody knows beforehand which of them will touch.

        See `surface` for such patches.

        Parameters
        ----------
        fem : FEModel
        beside : Partition, optional
            Interfaces, patches and loads that the body has, too. Faces that share a node with these interfaces and
            patches are left to them.
        axes : {"xyz", "normal"}
            See `surface`; friction needs all three directions.
        name : str
            Of the patch.

        Returns
        -------
        Partition
            The skin, and what is beside it.

        Raises
        ------
        EmptyRegionError
            If interfaces and patches leave no face.
        InputError
            If `beside` is no partition, or one of another mesh.
        """
        validate_type("fem", fem, FEModel, "fe_model()")
        validate_choice("axes", axes, AXES)
        if beside is None:
            return cls.surface(fem, np.arange(len(fem.facets)), axes=axes, name=name)
        validate_type("beside", beside, Partition, "Partition.interface() or Partition.ball()")
        beside.check_mesh(fem, "beside")
        taken = [beside.patch_nodes, *(joint.nodes for joint in beside.interfaces)]
        free = np.flatnonzero(~np.isin(fem.facets, np.concatenate(taken)).any(axis=1))
        if not len(free):
            raise EmptyRegionError(
                "beside: its interfaces and patches touch all faces, so that none is left for the skin. Take fewer or "
                "smaller ones"
            )
        return cls.surface(fem, free, axes=axes, name=name) | beside

    @overload
    @classmethod
    def facing(cls, fems: Sequence[FEModel], *, within: float, axes: PatchAxes | None = None) -> list[Partition]: ...
    @overload
    @classmethod
    def facing(
        cls, fems: Mapping[str, FEModel], *, within: float, axes: PatchAxes | None = None
    ) -> dict[str, Partition]: ...
    @classmethod
    def facing(
        cls, fems: Sequence[FEModel] | Mapping[str, FEModel], *, within: float, axes: PatchAxes | None = None
    ) -> list[Partition] | dict[str, Partition]:
        """Contact patches of an assembly, wherever two of its bodies come near each other.

        `CreatePartitionContact(mbs, bodies)` then finds the pairs. Patches are like those of `surface`: each has the
        facets that are connected there, one ring more where the surface continues without an edge, and the name of the
        body that they face, or of several by " and ".

        Parameters
        ----------
        fems : dict of str to FEModel, or sequence of FEModel
            The bodies in common coordinates, as they are assembled; names that a sequence has not are their numbers.
        within : float
            Distance up to which facets belong to a patch [m]. It should be above the gaps and the play of the assembly,
            and leave room for what slides.
        axes : {"normal", "xyz"}, optional
            See `surface`.

        Returns
        -------
        dict of str to Partition, or list of Partition
            One for each FE model.

        Raises
        ------
        EmptyRegionError
            If a body faces no other one within this distance.
        InputError
            If there are less than two FE models, or one is given twice.
        """
        given = list(fems.values()) if isinstance(fems, Mapping) else fems
        models = validate_items("fems", given, FEModel, "fe_model()")
        names = [
            validate_text("fems", key) for key in (fems if isinstance(fems, Mapping) else map(str, range(len(models))))
        ]
        if len(models) < 2 or len(set(map(id, models))) < len(models):
            raise InputError(f"fems: expected at least two FE models, each of them once, got {len(models)}")
        if axes is not None:
            validate_choice("axes", axes, AXES)
        within = validate_positive("within", within, "m")
        partitions = []
        sides = [Side.of(fem.points, fem.facets) for fem in models]
        for name, fem, near in zip(names, models, facing_facets(sides, within), strict=True):
            if not near:
                raise EmptyRegionError(
                    f"fems: no other body faces {name!r} within {within:.4g} m, which spans "
                    f"{show(fem.points.min(axis=0))} to {show(fem.points.max(axis=0))} m. Are all in the coordinates "
                    "of the assembly? Enlarge within=, or leave this body out"
                )
            partitions.append(cls._near_others(fem, {names[i]: facets for i, facets in near.items()}, axes))
        return dict(zip(names, partitions, strict=True)) if isinstance(fems, Mapping) else partitions

    @classmethod
    def _near_others(cls, fem: FEModel, near: Mapping[str, Array], axes: PatchAxes | None) -> Partition:
        """Patches of facets near others, (k,) int each, by the names of the others."""
        number = np.unique(np.concatenate([*near.values()]))
        part = connected(fem.facets[number])
        owner = np.full(fem.n_nodes, -1)
        owner[fem.facets[number]] = part[:, None]
        patches: list[Patch] = []
        for i in range(part.max() + 1):
            of_patch = widened(fem, number[part == i])
            of_patch = of_patch[np.isin(owner[fem.facets[of_patch]], (-1, i)).all(axis=1)]
            owner[fem.facets[of_patch]] = i
            name = " and ".join(other for other, facets in near.items() if np.isin(of_patch, facets).any())
            same = sum(patch.name == name or patch.name.startswith(f"{name} ") for patch in patches)
            patches += cls.surface(fem, of_patch, axes=axes, name=f"{name} {same + 1}" if same else name).patches
        nodes = np.unique(np.concatenate([patch.nodes for patch in patches]))
        return cls(nodes, tuple(patches), (), fem.n_nodes, fem.fingerprint)

    @classmethod
    def interface(
        cls,
        fem: FEModel,
        name: str,
        nodes: Sequence[int] | Array | str | None = None,
        *,
        cylinder: Cylinder | None = None,
        plane: Plane | None = None,
        near: Vector | None = None,
        kind: InterfaceKind = "rigid",
        position: Vector | None = None,
    ) -> Partition:
        """Interface for joints, springs and loads: a named node set with six resultants.

        Parameters
        ----------
        fem : FEModel
        name : str
        nodes : (k,) int array or str, optional
            Nodes of the FE model, or the name of one of its boundaries.
        cylinder : (point, axis, radius), optional
            Instead of `nodes`: faces on a cylinder, such as a bore or a pin; a point of its axis [m], its
            direction, and its radius [m].
        plane : (point, normal), optional
            Instead: flat faces in a plane, through a point [m], with this outward normal.
        near : (3,) array, optional
            A point [m]: of these faces the one nearest to it; alone, of all faces. Faces end at edges of 30 degrees.
        kind : {"rigid", "averaged"}
            The nodes move as one rigid body (RBE2), or a joint's forces are spread over them (RBE3).
        position : (3,) array, optional
            Where joints attach: the reference point of the motion [m]. Default: the mean over the area, if the nodes
            are those of a surface, and on the axis of a bore or a pin (see `faces.middle`); else the mean of the nodes.
            It should be exactly where the other marker of the joint is.

        Raises
        ------
        EmptyRegionError
            If there are no nodes.
        InputError
            If the nodes lie on one line, which leaves the rotation about it undefined; if they are no nodes of the FE
            model; or if `position` is further from the nodes than the body is long.

        Warns
        -----
        SelectionWarning
            If a cylinder or a plane catches several faces.
        """
        validate_type("fem", fem, FEModel, "fe_model()")
        if nodes is None:
            nodes = np.unique(fem.facets[selected_facets(fem, None, cylinder, plane, near)])
        elif any(given is not None for given in (cylinder, plane, near)):
            raise InputError("nodes: expected nodes, or a cylinder, plane or point near the face, got both")
        joint = interface_of(fem, name, nodes, kind, position)
        return cls(np.empty(0, dtype=np.int64), (), (joint,), fem.n_nodes, fem.fingerprint)

    @classmethod
    def load(
        cls,
        fem: FEModel,
        name: str,
        faces: Faces | None = None,
        *,
        cylinder: Cylinder | None = None,
        plane: Plane | None = None,
        near: Vector | None = None,
        line: Sequence[int] | Array | None = None,
        direction: Vector | None = None,
    ) -> Partition:
        """Distributed load with its static answer: a pressure or traction on faces, curved ones too, or a line load.

        `CreateDistributedLoad` gives it a size that may change with time. The basis holds the static answer to it.

        Parameters
        ----------
        fem : FEModel
        name : str
        faces : str, sequence of str, (k,) int array, (nf,) bool array, or two (3,) arrays, optional
            Where a pressure or traction acts, as in `surface`.
        cylinder : (point, axis, radius), optional
            Instead of `faces`: faces on a cylinder, such as a bore or a pin; a point of its axis [m], its
            direction, and its radius [m].
        plane : (point, normal), optional
            Instead: flat faces in a plane, through a point [m], with this outward normal.
        near : (3,) array, optional
            A point [m]: of these faces the one nearest to it; alone, of all faces. Faces end at edges of 30 degrees.
        line : (k,) int array, optional
            Instead of faces: nodes on edges of the mesh's surface, in any order, along which a line load acts.
        direction : (3,) array, optional
            Of a traction or line load, in the body's axes; any length. Default: a pressure, against the normals.

        Raises
        ------
        EmptyRegionError
            If no facet is chosen, or no edge has all its nodes in `line`.
        InputError
            If both or none of faces and `line` are given, or a line load without `direction`.

        Warns
        -----
        SelectionWarning
            If a cylinder or a plane catches several faces.
        """
        validate_type("fem", fem, FEModel, "fe_model()")
        if any(given is not None for given in (cylinder, plane, near)):
            faces = selected_facets(fem, faces, cylinder, plane, near)
        pattern = load_pattern(fem, name, faces, line, direction)
        return cls(np.empty(0, dtype=np.int64), (), (), fem.n_nodes, fem.fingerprint, (pattern,))


def check_one_line(partition: Partition, patch: int, argument: str) -> None:
    """Raise if contact wanders over a patch, so that it has no single line of contact, which `argument` needs.

    Raises
    ------
    InputError
    """
    if partition.patches[patch].wanders:
        raise InputError(
            f"{argument}: is that of an impact along one line of contact, but contact wanders over patch {patch} "
            f"{partition.patches[patch].name!r}, made by Partition.surface. Reduce such a body with f_cut, or judge an "
            "impact at one place with a patch of Partition.ball"
        )


def _warn_of_size(fem: FEModel, **radii: float | None) -> None:
    """Warn of radii [m] far beyond the body, which are as good as infinite."""
    size = float(np.linalg.norm(np.ptp(fem.points, axis=0)))
    for name, radius in radii.items():
        if radius is not None and radius > _TOO_LARGE * size:
            warn(
                f"{name}: {radius:g} m is {radius / size:.3g} times the size of the body, {size:.4g} m, so that all of "
                "it lies within. Is it in millimetres? Give it in metres",
                UnitsWarning,
            )


def number_of_patch(partition: Partition, key: int | str | None, argument: str) -> int:
    """Do the work of `Partition.patch`; messages name the argument as the caller wrote it."""
    names = [patch.name for patch in partition.patches]
    if key is None and len(names) == 1:
        return 0
    if isinstance(key, str) and key and key in names:
        return names.index(key)
    if isinstance(key, int | np.integer) and not isinstance(key, bool | np.timedelta64) and 0 <= key < len(names):
        return int(key)
    raise InputError(
        f"{argument}: expected the name or number of one of the {len(names)} contact patches {names}, got {key!r}"
    )


def interface_named(partition: Partition, name: str, argument: str) -> Interface:
    """Do the work of `Partition.find_interface`; messages name the argument as the caller wrote it."""
    names = [interface.name for interface in partition.interfaces]
    if not isinstance(name, str) or name not in names:
        raise InputError(
            f"{argument}: expected one of {', '.join(map(repr, names)) or 'none, for the body has no interfaces'}, "
            f"got {name!r}. Nodes beside interfaces are reduced away, and with them the body's static answer to "
            f"a joint's forces; join Partition.interface(fem, {name!r}, nodes) to the partition by | and reduce "
            "the body again"
        )
    return partition.interfaces[names.index(name)]


def load_named(partition: Partition, name: str, argument: str) -> LoadPattern:
    """Do the work of `Partition.find_load`; messages name the argument as the caller wrote it."""
    names = [load.name for load in partition.loads]
    if not isinstance(name, str) or name not in names:
        raise InputError(
            f"{argument}: expected one of {', '.join(map(repr, names)) or 'none, for the body has none'}, got "
            f"{name!r}. Join Partition.load(fem, {name!r}, faces) to the partition by | and reduce the body again"
        )
    return partition.loads[names.index(name)]
