"""The reduced body: coordinates q, matrices (paper, eq. 14 and 16), contact patches, and the recovery u = T q."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from ..algebra.sparse.flexibility import KeptFlexibility
from ..algebra.sparse.kept_fronts import KeptFronts
from ..algebra.sparse.skin_flexibility import SkinBlock, SkinFlexibility, StoredFactors, check_flexibility
from ..errors import InputError
from ..fe.facets import nodal_area
from ..fe.material import Material
from ..fe.model import FEModel, node_dofs, rigid_modes, same_matrices
from ..fe.partition import Partition, interface_named, number_of_patch
from ..fe.patches import PARTS, check_facets
from ..fe.places import nearest_node
from ..plasticity.dilatation import with_free_zones
from ..plasticity.zone_flexibility import ZoneFlexibility
from ..support.archive import Format
from ..support.arrays import Array, Vector
from ..support.attributes import for_users
from ..support.checks import (
    check_floats,
    check_indices,
    read_only,
    validate_array,
    validate_flag,
    validate_number,
    validate_positive,
    validate_type,
    validate_vector,
    validate_whole,
)
from ..support.files import replacing, writable
from ..support.once import once
from ..surfaces.surface import Surface
from .basis import ReducedBasis
from .estimate import Estimate
from .geometric_stiffness import GeometricStiffness
from .inertia import PAIRS, InertiaIntegrals
from .inertia_relief import static_answers
from .loads import patch_slice
from .matrices import BodyMatrices, ContactRows
from .sid import Frame, sid_lines

_SAME_PLACE = 1e-8  # by the body's size or mass: round-off of meshes that were made twice
_INSIDE = {"check_fem", "check_inside", "check_nodes", "fingerprint", "has_inside", "stiffening", "strain_energy"}
_SAME_ENERGY = 1e-4  # of shapes, which are eigenmodes but for the tolerance of their search


@dataclass(frozen=True, eq=False)
class ReducedBody:
    """A body in reduced coordinates q: shape coordinates first, then x, y, z of each nodal column.

    Parameters
    ----------
    basis : ReducedBasis
    partition : Partition
    points : (n, 3) array
        Nodes of the FE model [m].
    facets : (nf, 3), (nf, 6), (nf, 10) or (nf, 4) int array
        Its surface for pictures, as `FEModel.facets`.
    mass, stiffness : (n_dofs, n_dofs) csr matrix
        T' M T and T' K T (paper, eq. 16).
    total_mass : float
        [kg]
    centre_of_mass : (3,) array
        [m]
    f_cut : float
        Truncation frequency [Hz].
    reduce_s : float
        Time that the reduction took [s]; for a body of a pair, half of the time for both.
    inertia : InertiaIntegrals
        What a floating frame needs of the mass: integrals of the elastic shapes. With nodal columns: of all shapes,
        over the body without those nodes.
    estimate : Estimate or None
        Estimated errors, if the body was reduced to a tolerance.
    material : Material or None
        Of several the one with the largest volume; None if the body is from a file of before it was stored.
    fingerprint : (4,) array or None
        `FEModel.matrix_fingerprint` of the FE model, by which `check_fem` knows it; None as for `material`.
    stiffening : GeometricStiffness or None
        Geometric stiffness, if `reduce` was asked for it.
    """

    basis: ReducedBasis
    partition: Partition
    points: Array
    facets: Array
    mass: sp.csr_matrix
    stiffness: sp.csr_matrix
    total_mass: float
    centre_of_mass: Array
    f_cut: float
    reduce_s: float
    inertia: InertiaIntegrals
    estimate: Estimate | None = None
    material: Material | None = None
    fingerprint: Array | None = None
    stiffening: GeometricStiffness | None = None

    def __post_init__(self) -> None:
        validate_type("basis", self.basis, ReducedBasis, "BASES")
        validate_type("partition", self.partition, Partition, "Partition.ball()")
        validate_type("inertia", self.inertia, InertiaIntegrals, "InertiaIntegrals.of()")
        for name, kind, source in (("estimate", Estimate, "reduce(tolerance=)"), ("material", Material, "Material()")):
            if getattr(self, name) is not None:
                validate_type(name, getattr(self, name), kind, source)
        check_floats("points", self.points, (None, 3))
        n_nodes, nodal = len(self.points), self.basis.nodal
        check_facets(self.facets, n_nodes)
        if self.partition.n_nodes != n_nodes:
            raise InputError(f"partition: it is of a mesh with {self.partition.n_nodes} nodes, the body has {n_nodes}")
        shape_nodes = self.basis.shape_nodes
        if shape_nodes is not None:
            check_indices("shape_nodes", shape_nodes, (None,), n_nodes)
        check_floats("shapes", self.basis.shapes, (3 * (n_nodes if shape_nodes is None else len(shape_nodes)), None))
        n_shapes = self.basis.shapes.shape[1]
        for name in ("mass", "stiffness"):
            matrix = getattr(self, name)
            if not sp.issparse(matrix) or matrix.shape != (n_shapes + 3 * len(nodal),) * 2:
                raise InputError(f"{name}: expected a sparse matrix of order {n_shapes + 3 * len(nodal)}")
            check_floats(name, matrix.data, (None,))
        if not (self.mass.diagonal() > 0).all():
            raise InputError("mass: expected a positive mass of each coordinate")
        if self.basis.flexibility is not None:
            rows = patch_slice(self.partition, len(self.partition.patches)).start
            check_flexibility("flexibility", self.basis.flexibility, rows)
        n_fields = n_shapes if len(nodal) else n_shapes - 6
        check_floats("inertia", self.inertia.cross, (3, n_fields, n_fields))
        for name, unit in (("total_mass", "kg"), ("f_cut", "Hz")):
            object.__setattr__(self, name, validate_positive(name, getattr(self, name), unit))
        object.__setattr__(self, "reduce_s", validate_number("reduce_s", self.reduce_s))
        check_floats("centre_of_mass", self.centre_of_mass, (3,))
        read_only(self.points, self.facets, self.centre_of_mass)
        if self.fingerprint is not None:
            check_floats("fingerprint", self.fingerprint, (4,))
            read_only(self.fingerprint)
        if self.stiffening is not None:
            validate_type("stiffening", self.stiffening, GeometricStiffness, "reduce(geometric_stiffness=True)")
            if self.stiffening.n_dofs != self.n_dofs:
                raise InputError(
                    f"stiffening: expected that of {self.n_dofs} coordinates, got {self.stiffening.n_dofs}"
                )

    @property
    def n_dofs(self) -> int:
        """Number of reduced coordinates."""
        return int(self.mass.shape[0])

    @property
    def n_shapes(self) -> int:
        """Number of shape coordinates, rigid ones included; they stand first."""
        return int(self.basis.shapes.shape[1])

    @property
    def fe_dofs(self) -> int:
        """Number of dofs of the FE model."""
        return 3 * len(self.points)

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the body leaves out, in sentences."""
        said = [*self.basis.left_out, *self.partition.left_out]
        elastic = [patch.material or self.material for patch in self.partition.patches if not patch.plastic]
        if elastic:
            known = all(material and material.yield_stress is not None for material in elastic)
            said.append(f"plastic deformation (yield_stress= of Material {'tells' if known else 'would tell'} of it)")
        said.append("strain and stress, which `recovery` computes on request")
        if self.basis.growth is None:  # from a file of before it was stored
            said.append("growth by rotation beyond the coordinates (reduce it anew)")
        if self.stiffening is None:
            said.append(
                "geometric stiffness: tension and rotation do not stiffen, compression does not soften "
                "(geometric_stiffness=True of reduce)"
            )
        else:
            said.append("geometric stiffness of forces elsewhere than on patches, interfaces and distributed loads")
        inside = "the shapes inside the body, which was saved without them (save with inside=True keeps them)"
        return (*said, *[inside] * (not self.has_inside))

    @property
    def has_inside(self) -> bool:
        """Whether the shapes are known at all nodes, not only where runs and drawing need them."""
        return self.basis.shape_nodes is None

    def check_inside(self, what: str) -> None:
        """Raise unless the shapes are also known inside the body.

        Parameters
        ----------
        what : str
            What needs these shapes, for the message.

        Raises
        ------
        InputError
        """
        if not self.has_inside:
            raise InputError(
                f"body: {what} needs the shapes inside the body, which was saved without them (inside=False). Load it "
                "from a file that was saved whole, save(path), or reduce it anew"
            )

    def check_fem(self, fem: FEModel, name: str = "fem") -> FEModel:
        """Return the FE model as the body was reduced from it, with free plastic zones, if `fem` is that model.

        Mesh, place, mass, stiffness and the law of plastic flow are compared, but for round-off. A body from a file of
        before these were stored is compared by its mass, and by the energy of its shapes.

        Parameters
        ----------
        fem : FEModel
        name : str
            Name of the argument, for messages.

        Raises
        ------
        InputError
            If it is no FE model, or another one.
        """
        validate_type(name, fem, FEModel, "fe_model()")
        self.partition.check_mesh(fem, f"{name}: expected the body's own mesh")
        size = np.ptp(self.points, axis=0).max()
        away = abs(self.points - fem.points).max()
        if away > _SAME_PLACE * size:
            raise InputError(
                f"{name}: expected the body's own FE model, got one with the same mesh, moved or stretched by up to "
                f"{away:.3g} m; reduce that one, or give the one that the body was reduced from"
            )
        with_zones = with_free_zones(fem, self.partition)
        mass, stiffness = self._same_matrices(with_zones)
        differs = [what for what, same in (("mass", mass), ("stiffness", stiffness)) if not same]
        if not differs and self._flows_otherwise(fem.material):
            differs = ["plastic flow"]
        if differs:
            made_with = "" if self.material is None else f" The body was made with {_constants(self.material)}."
            raise InputError(
                f"{name}: expected the FE model that the body was reduced from, got one of the same mesh with another "
                f"{' and '.join(differs)}: {fem.total_mass:.6g} kg, the body has {self.total_mass:.6g} kg.{made_with} "
                f"This one has {_constants(fem.material)}; give the body's own, or reduce this one"
            )
        return with_zones

    def _same_matrices(self, fem: FEModel) -> tuple[bool, bool]:
        """Whether an FE model of the body's mesh has its mass, and its stiffness."""
        if self.fingerprint is not None:
            return same_matrices(fem.matrix_fingerprint, self.fingerprint)
        away = np.linalg.norm(fem.centre_of_mass - self.centre_of_mass)
        mass = abs(fem.total_mass - self.total_mass) <= _SAME_PLACE * self.total_mass
        mass = mass and bool(away <= _SAME_PLACE * np.ptp(self.points, axis=0).max())
        if not self.has_inside or not self.basis.omega.any():
            return mass, self.material is None or _elastic(self.material) == _elastic(fem.material)
        q = np.zeros(self.n_dofs)
        q[: self.n_shapes] = np.where(self.basis.omega > 0, np.cos(np.arange(self.n_shapes)), 0.0)
        motion = self.displacement(q).ravel()
        stored, expected = motion @ (fem.stiffness @ motion), q @ (self.stiffness @ q)
        return mass, bool(abs(stored - expected) <= _SAME_ENERGY * expected)

    def _flows_otherwise(self, material: Material) -> bool:
        """Whether a plastic zone takes its flow from the body's material, and `material` is another one."""
        asked = any(patch.plastic is not None and patch.material is None for patch in self.partition.patches)
        return asked and self.material is not None and _flow(material) != _flow(self.material)

    def without_inside(self) -> ReducedBody:
        """Return the body with its shapes only at nodes of surface, interfaces, plastic zones and nodal columns.

        Runs, their results on the surface, and drawing need no others; `save` with inside=False writes this body.
        """
        zones = [patch.plastic.nodes for patch in self.partition.patches if patch.plastic]
        joints = [interface.nodes for interface in self.partition.interfaces]
        kept = np.unique(np.concatenate([self.facets.ravel(), self.basis.nodal, *joints, *zones]))
        if not self.has_inside or len(kept) == len(self.points):
            return self
        dofs, growth = node_dofs(kept), self.basis.growth
        growth = None if growth is None else growth[dofs]
        return replace(self, basis=replace(self.basis, shapes=self.basis.shapes[dofs], shape_nodes=kept, growth=growth))

    @cached_property
    def rigid(self) -> Array:
        """(n_dofs, 6) array: coordinates of unit translations [m] and rotations [rad] about the centre of mass."""
        arms = self.points[self.basis.nodal] - self.centre_of_mass
        result = np.vstack([self.basis.rigid, rigid_modes(arms)])
        read_only(result)
        return result

    def rows(self, nodes: Array) -> sp.csr_matrix | Array:
        """Rows of T at some nodes, (3k, n_dofs): dense if there are only shapes, csr with nodal columns.

        Parameters
        ----------
        nodes : (k,) int array

        Raises
        ------
        InputError
            If they are no numbers of nodes, or the body has no shapes there.
        """
        nodes = validate_whole("nodes", nodes, f"numbers of nodes, 0 to {len(self.points) - 1}, an array of shape (k,)")
        if nodes.ndim != 1 or not ((nodes >= 0) & (nodes < len(self.points))).all():
            raise InputError(f"nodes: expected numbers of nodes, 0 to {len(self.points) - 1}, an array of shape (k,)")
        dofs = node_dofs(nodes)
        shapes = self.shape_rows(nodes)
        nodal = self.basis.nodal
        if not len(nodal):
            return shapes
        column = np.full(len(self.points), -1)
        column[nodal] = np.arange(len(nodal))
        kept_node = column[dofs // 3]
        kept = np.flatnonzero(kept_node >= 0)
        identity = sp.csr_matrix(
            (np.ones(len(kept)), (kept, 3 * kept_node[kept] + dofs[kept] % 3)), shape=(len(dofs), 3 * len(nodal))
        )
        return sp.hstack([sp.csr_matrix(shapes), identity], format="csr")

    def reduced_rows(self, rows: sp.csr_matrix) -> Array:
        """Rows on the coordinates, rows T, (k, n_dofs), of rows on the nodal displacements, (k, 3n).

        Parameters
        ----------
        rows : (k, 3n) csr matrix
            As `recovery` makes them. The result times q is rows @ u for the recovered displacements u.

        Raises
        ------
        InputError
            If they are of another mesh, or need shapes that the body lacks.
        """
        if not sp.issparse(rows) and not (isinstance(rows, np.ndarray) and rows.ndim == 2):
            raise InputError(f"rows: expected a csr matrix, as `recovery` makes them, got {type(rows).__name__}")
        if rows.dtype.kind not in "biuf":
            raise InputError(f"rows: expected real numbers, got entries of type {rows.dtype}")
        if rows.shape[1] != self.fe_dofs:
            raise InputError(f"rows: expected {self.fe_dofs} columns, the dofs of the FE model, got {rows.shape[1]}")
        dofs = (3 * self.basis.nodal[:, None] + np.arange(3)).ravel()
        rows = sp.csr_matrix(rows)
        return np.hstack([self._known_columns(rows) @ self.basis.shapes, rows[:, dofs].toarray()])

    def _known_columns(self, rows: sp.csr_matrix) -> sp.csr_matrix:
        """Columns of rows on the nodal displacements, (k, 3n), at the nodes at which the shapes are known."""
        if self.basis.shape_nodes is None:
            return rows
        self.check_nodes(np.unique(rows.indices[rows.data != 0] // 3))
        return rows[:, node_dofs(self.basis.shape_nodes)]

    def growth_in(self, rows: sp.csr_matrix) -> Array:
        """The same of the growth by rotation, rows U, (k, 6); see `growth_rows`."""
        known: Array = self._known_columns(sp.csr_matrix(rows)) @ self.basis.growth
        return known

    def check_nodes(self, nodes: Array) -> None:
        """Raise unless the shapes are known at nodes, (k,) int array.

        Raises
        ------
        InputError
            Naming the first node that lies inside a body which was saved without its inside.
        """
        known = self.basis.shape_nodes
        if known is not None and len(missing := nodes[~np.isin(nodes, known)]):
            self.check_inside(f"node {missing[0]} at {self.points[missing[0]]} m")

    def shape_rows(self, nodes: Array | None = None) -> Array:
        """Rows of the shapes at nodes, (k,) int array, or at all: (3k, n_shapes).

        Raises
        ------
        InputError
            If the body has no shapes there.
        """
        if nodes is None:
            self.check_inside("what is asked at all nodes")
            return self.basis.shapes
        self.check_nodes(nodes)
        return self.basis.shapes[self._known_dofs(nodes)]

    def _known_dofs(self, nodes: Array) -> Array:
        """Rows of the shapes, (3k,), at nodes, (k,) int array."""
        known = self.basis.shape_nodes
        return node_dofs(nodes if known is None else np.searchsorted(known, nodes))

    def growth_rows(self, nodes: Array) -> Array | None:
        """Growth by rotation at nodes, (k,) int array, that the coordinates do not have: (3k, 6) [m s2].

        It is times products of angular velocities, in the order of `inertia.PAIRS`. None if it is not known.
        """
        growth = self.basis.growth
        self.check_nodes(nodes)
        return None if growth is None else growth[self._known_dofs(nodes)].astype(float)

    def displacement(self, q: Array) -> Array:
        """Displacements of all nodes, (n, 3) [m], of coordinates q, (n_dofs,); velocities likewise.

        Raises
        ------
        InputError
            If q has another shape, or the body was saved without its inside.
        """
        q = validate_array("q", q, (self.n_dofs,))
        self.check_inside("the displacement of all nodes")
        u = (self.basis.shapes @ q[: self.n_shapes]).reshape(-1, 3)
        u[self.basis.nodal] += q[self.n_shapes :].reshape(-1, 3)
        return u

    def strain_energy(self, q: Array) -> Array:
        """Strain energy, (...) [J], of coordinates q, (..., n_dofs); with geometric stiffness to the fourth order."""
        energy: Array = np.sum(q * (self.stiffness @ q.reshape(-1, self.n_dofs).T).T.reshape(q.shape), axis=-1) / 2
        return energy if self.stiffening is None else energy + self.stiffening.energy(q)

    def nearest_node(self, point: Vector) -> int:
        """Index of the node nearest to `point`, (3,) [m], in the body's own coordinates; see `places.nearest_node`."""
        return nearest_node(self.points, point)

    def surface(self, position: Vector, patch: int | str = 0) -> Surface:
        """Contact patch `patch`, by number or name, with the body shifted by `position`, (3,) [m].

        Raises
        ------
        InputError
            If there is no such patch, or the position is no vector.
        """
        place = validate_vector("position", position)
        surface = _surface(self, number_of_patch(self.partition, patch, "patch"))
        return replace(surface, points=surface.points + place) if place.any() else surface

    def flexibility(self, patch: int | str = 0, other: int | str | None = None) -> Array | SkinBlock:
        """Residual flexibility of the rows of `patch`, (nr, nr) [m/N], or between those and the rows of `other`.

        Both are numbers or names of patches. That of a large skin is found on demand, see `SkinFlexibility`: it
        multiplies as an array does, and `numpy.asarray` makes an array of what is not too large.

        Raises
        ------
        InputError
            If the basis has none, or there is no such patch.
        """
        if self.basis.flexibility is None:
            raise InputError(f"body: basis {self.basis.name!r} has no residual flexibility, its patch has mass instead")
        partition, row = self.partition, number_of_patch(self.partition, patch, "patch")
        column = row if other is None else number_of_patch(partition, other, "other")
        rows, columns = (patch_slice(partition, number) for number in (row, column))
        part: Array | SkinBlock = self.basis.flexibility[rows, columns]
        return part

    def interface_rows(self, name: str) -> Array:
        """Rows of an interface, (6, n_dofs): its mean translation [m] and rotation [rad] by the coordinates.

        Transposed, they are the generalised forces of a unit force and moment on it.

        Parameters
        ----------
        name : str

        Raises
        ------
        InputError
            If there is no such interface.
        """
        interface = interface_named(self.partition, name, "name")
        return interface.motion @ self.rows(interface.nodes)

    def centrifugal_load(self, angular_velocity: Vector) -> Array:
        """Generalised centrifugal forces, (n_dofs,), of rotation about an axis through the centre of mass.

        Those of another axis also accelerate the body as a whole, which stresses nothing.

        Parameters
        ----------
        angular_velocity : (3,)
            In the axes of the mesh [rad/s].

        Raises
        ------
        InputError
            If it is no vector of three numbers.
        """
        omega, nodal = validate_vector("angular_velocity", angular_velocity), self.basis.nodal
        products = np.outer(omega, omega)
        weights = [products[pair] * (1 if pair[0] == pair[1] else 2) for pair in PAIRS]
        on_shapes = np.asarray(weights) @ self.inertia.inertia[:, 0, 1:]
        if len(nodal):
            arms = self.points[nodal] - self.centre_of_mass
            masses = self.mass.diagonal()[self.n_shapes :: 3, None]
            return np.concatenate([on_shapes, (masses * np.cross(np.cross(omega, arms), omega)).ravel()])
        torque = np.r_[np.zeros(3), -np.cross(omega, self.inertia.tensor @ omega)]
        return np.concatenate([np.linalg.solve(self.rigid[:6].T, torque), on_shapes])

    def geometric_stiffness(self, load: Vector) -> Array:
        """Geometric stiffness, (n_dofs, n_dofs) [of energy], of a load; inertia balances what supports do not.

        It is linear in the load, so that a support's reaction must be in it. For a strut, `load` is P times the
        difference of the axial rows of its ends, see `interface_rows`. For rotation see `centrifugal_load`.

        Parameters
        ----------
        load : (n_dofs,) array
            Generalised forces on the coordinates.

        Raises
        ------
        InputError
            If the body was reduced without geometric stiffness, or the load has another shape.
        """
        load = validate_array("load", load, (self.n_dofs,))
        if self.stiffening is None:
            raise InputError("body: it has no geometric stiffness; reduce it with geometric_stiffness=True")
        answer = static_answers(self.stiffness, self.mass, self.rigid, load[:, None])[:, 0]
        return self.stiffening.of_answer(answer)

    def matrices(self) -> BodyMatrices:
        """Matrices of the body for other codes: mass, stiffness, and rows of its patches, interfaces and loads.

        Returns
        -------
        BodyMatrices
        """
        contacts = {}
        named = {patch.name for patch in self.partition.patches}
        for number, patch in enumerate(self.partition.patches):
            unnamed = f"patch {number}" if str(number) in named else str(number)
            moved = self.rows(patch.nodes)
            if patch.axes == "normal":
                directions = patch.node_normals
                starts = np.arange(0, 3 * len(directions) + 1, 3)
                moved = sp.csr_matrix((directions.ravel(), np.arange(directions.size), starts)) @ moved
            else:
                directions = np.tile(np.eye(3), (len(patch.nodes), 1))
            contacts[patch.name or unnamed] = ContactRows(
                points=self.points[patch.nodes],
                directions=directions,
                area=nodal_area(self.points, patch.facets)[patch.nodes],
                rows=moved,
                flexibility=None if self.basis.flexibility is None else np.asarray(self.flexibility(number)),
            )
        loads = {load.name: self.rows(load.nodes).T @ load.forces.ravel() for load in self.partition.loads}
        interfaces = {joint.name: np.asarray(self.interface_rows(joint.name)) for joint in self.partition.interfaces}
        return BodyMatrices(
            mass=sp.csr_matrix(self.mass),
            stiffness=sp.csr_matrix(self.stiffness),
            rigid=self.rigid,
            coordinates=self.labels,
            contacts=contacts,
            interfaces=interfaces,
            loads=loads,
        )

    def save_sid(self, path: str | Path, nodes: Sequence[int] | Array = ()) -> Path:
        """Write the body as standard input data (SID) for other multibody codes; see `reduction.sid`.

        Frames are those of the interfaces, numbered from 1 on, then of nodes, which have no rotation. There is no
        contact flexibility in this format: coordinates beyond f_cut are left out. A body with geometric stiffness has
        that of forces and moments at its frames, and of rotation.

        Parameters
        ----------
        path : str or Path
            Usually `.SID_FEM`.
        nodes : (k,) int array
            Nodes of the FE model that get a frame too, for loads, springs and pictures.

        Returns
        -------
        Path

        Raises
        ------
        InputError
            If the basis keeps nodes, a node is not kept, or no file can stand there.
        OutputError
            If the system cannot write.
        """
        if len(self.basis.nodal):
            raise InputError(
                f"body: basis {self.basis.name!r} keeps nodes, and standard input data have modes alone; take "
                "another basis of reduce()"
            )
        numbers = validate_whole("nodes", nodes, "numbers of nodes of the FE model, (k,)")
        of_nodes = np.asarray(self.rows(numbers)).reshape(-1, 3, self.n_dofs)[:, :, 6:]
        moved = [(joint.position, self.interface_rows(joint.name)[:, 6:]) for joint in self.partition.interfaces]
        places = [place for place, _ in moved] + list(self.points[numbers])
        motions = [np.split(rows, 2) for _, rows in moved] + [[phi, np.zeros(phi.shape)] for phi in of_nodes]
        frames = [
            Frame(number, place - self.centre_of_mass, *motion, *map(self._elastic_stiffening, motion))
            for number, (place, motion) in enumerate(zip(places, motions, strict=True), 1)
        ]
        doubled = np.array([1 if a == b else 2 for a, b in PAIRS])
        of_rotation = self._elastic_stiffening(doubled[:, None] * self.inertia.inertia[:, 0, 1:])
        path, data = writable(path), (self.total_mass, self.inertia, self.basis.omega[6:])
        with replacing(path, "w") as file:
            for line in sid_lines(*data, frames, self.labels[6:], of_rotation):
                file.write(f"{line}\n")
        return path

    def _elastic_stiffening(self, loads: Array) -> Array | None:
        """Geometric stiffness of loads on the elastic shapes, (k, n): (k, n, n), or None if there is none."""
        if self.stiffening is None:
            return None
        rigid = np.zeros((len(loads), 6))
        return np.array([self.geometric_stiffness(load)[6:, 6:] for load in np.hstack([rigid, loads])])

    @property
    def labels(self) -> tuple[str, ...]:
        """What each column of T is, n_dofs of them."""
        return self.basis.labels + tuple(f"nodal {axis} of node {node}" for node in self.basis.nodal for axis in "xyz")

    def table(self) -> str:
        """Columns of T, one in a line: its number and what it is."""
        return "\n".join(f"{i:5d}  {label}" for i, label in enumerate(self.labels))

    def save(self, path: str | Path, *, inside: bool = True) -> None:
        """Write to an npz file, all fields in full precision; `load_body` reads it.

        The file is written under another name and then renamed. So a process that is killed leaves no partial file.

        Parameters
        ----------
        path : str or Path
            Taken as it is, nothing is appended.
        inside : bool
            False leaves out the shapes at nodes inside the body. Runs, motion of the surface's nodes, and drawing do
            without them, equal in every bit; stresses, strains and points inside need them, and say so.

        Raises
        ------
        InputError
            If the folder does not exist, or `path` is one.
        """
        FILE.save(path, self if validate_flag("inside", inside) else self.without_inside())

    def __dir__(self) -> list[str]:
        return for_users(
            self,
            _INSIDE,
        )

    def __repr__(self) -> str:
        return (
            f"ReducedBody({self.basis.name!r}, {self.n_dofs} of {self.fe_dofs} dofs, f_cut {self.f_cut:.6g} Hz, "
            f"{len(self.partition.patch_nodes)} patch nodes{'' if self.has_inside else ', without its inside'})"
        )


def _elastic(material: Material) -> tuple[float, ...]:
    """Young's modulus, Poisson's ratio and density, without round-off."""
    return tuple(float(f"{number:.9g}") for number in (material.E, material.nu, material.rho))


def _flow(material: Material) -> tuple[object, ...]:
    """What plastic flow depends on."""
    return material.yield_stress, material.hardening, material.kinematic_hardening


def _constants(material: Material) -> str:
    E, nu, rho = _elastic(material)
    return f"E={E:.6g}, nu={nu:.6g}, rho={rho:.6g}"


FILE = Format(
    name="reduced body",
    version=1,
    units="SI (m, kg, s, N, rad), or the consistent units that the FE model was made in",
    classes=(
        ReducedBody,
        ReducedBasis,
        ZoneFlexibility,
        KeptFlexibility,
        KeptFronts,
        SkinFlexibility,
        StoredFactors,
        InertiaIntegrals,
        GeometricStiffness,
        Estimate,
        Material,
        Partition,
        *PARTS,
    ),
    packed=True,
)


def load_body(path: str | Path) -> ReducedBody:
    """Read a body that `ReducedBody.save` wrote.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    ReducedBody
        Equal to the saved one in every bit, but for what inside=False left out.

    Raises
    ------
    InputError
        If the file is missing, damaged, of another kind, or of another version of the format.
    """
    body = FILE.load(path)
    if not isinstance(body, ReducedBody):
        raise InputError(f"path: expected a saved reduced body, got {len(body)} of them in {path}, a file of the cache")
    return body


@once
def _surface(body: ReducedBody, number: int) -> Surface:
    """Contact patch of a body where its mesh is, by its number."""
    surface = Surface.of(body.points, body.partition.patches[number], np.zeros(3))
    read_only(surface.points)
    return surface
