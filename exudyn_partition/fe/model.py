"""The FE model of one free body: points, mass and stiffness in Exudyn's xyz order, and its surface.

The mass M_F and stiffness K_F of the paper (section 2.1, eq. 6 and 13) are made by `meshing.ngsolve_fem`; the lumped
mass is made here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
import scipy.sparse as sp

from ..errors import InputError, LockingError, MeshError, UnitsWarning
from ..support.arrays import Array, Vector
from ..support.attributes import for_users
from ..support.checks import (
    check_indices,
    read_only,
    validate_array,
    validate_flag,
    validate_text,
    validate_type,
    validate_whole,
)
from ..support.warn import warn
from .consistency import check_elements, check_symmetric, integrals, largest_entry, plain_matrix
from .elements import HEXAHEDRA, Kind, faces_of, kinds_of
from .facets import by_shape, check_connected, check_neighbours, facet_corners
from .given_matrices import (
    cells_beneath,
    check_against_surface,
    check_free,
    check_surface,
    given_elastic,
    given_material,
    lumped_by_diagonal,
    ordered,
    reach,
)
from .material import Material, Regions
from .places import nearest_node
from .quadrature import facet_integration
from .shapes import ORDERS, QUADS
from .walls import Wall, at_facets, shares_of_walls, stiff_wall, weakest_between, weakest_wall

_CALLED = {4: "tetrahedra", 5: "pyramids", 6: "wedges", 8: "hexahedra"}  # elements by their corners

MassKind = Literal["consistent", "lumped"]
MASSES: tuple[MassKind, ...] = get_args(MassKind)

# Volume of the regular tetrahedron, pyramid and wedge, and of the cube, with edges of length one; by their corners.
_VOLUMES = {4: 2**-0.5 / 6, 5: 2**-0.5 / 3, 6: 3**0.5 / 4, 8: 1.0}
# Largest distance of two nodes of an element by that edge: measured of meshes of Netgen, and of a cube.
_TETRAHEDRA, _HEXAHEDRA = 1.35, 3**0.5

# Speeds of waves in bars, sqrt(E / rho), in metres and in millimetres a second: from foam to beyond diamond.
_WAVE_SPEEDS = ((10.0, 2e4), (1e6, 2e7))
# A material with less than this is not given in SI units: foam rubber has E = 1e5 Pa, aerogel rho = 50 kg/m3.
_SOFTEST_SI, _LIGHTEST_SI = 1e5, 50.0
_ROUND_OFF = 1e-8  # of sums over matrices that were assembled twice, maybe on another machine
_LINEAR_NU = 0.49  # Poisson's ratio up to which linear elements are usable
_LOWEST_PLAUSIBLE_HZ = 10.0  # a steel bar of 260 m
_LARGEST_PLAUSIBLE_MASS = 2e3  # kg; a steel part of 0.05 kg in inches, taken for metres, has 3000 kg
_SMALLEST_IN_MM = 0.3  # where lengths are in mm: a part of 30 mm in metres has 0.03; few balls of bearings are smaller
_SMALLEST_PLAUSIBLE = 1e-4  # m; a part of 30 mm scaled by 1e-3 twice has 30 um
_SLENDEREST_PLAUSIBLE = 2000  # length by thickness; a wire of 0.2 mm drawn 1 long for 1 mm has 5000


@dataclass(frozen=True, eq=False)
class FEModel:
    """Finite-element model of one unconstrained elastic body.

    Parameters
    ----------
    points : (n, 3) array
        Nodal positions in the body's reference configuration [m].
    cells : (ne, 4), (ne, 10), (ne, 20) or (ne, 8) int array
        Tetrahedra, linear, quadratic or cubic, or hexahedra with 8 or 20 nodes, in VTK order with positive volume.
        Wedges, pyramids and tetrahedra among hexahedra repeat nodes, see `fe.elements`.
    mass, stiffness : (3n, 3n) csr matrix
        Consistent mass [kg] and stiffness [N/m], dofs interleaved x y z x y z. Other sparse formats and dense arrays
        are converted.
    cell_mass : (ne,) array
        Mass of each element [kg], density times volume.
    material : Material
        The material that the matrices were made with; of several, the one with the largest volume.
    boundaries : dict of str to int array
        Named boundaries as rows of `facets`.
    regions : Regions or None
        Which element is of which material, if there are several or the modulus differs from place to place.
    surface : (nf, 3), (nf, 6), (nf, 10), (nf, 4) or (nf, 8) int array or None
        Outward surface facets of a model whose elements are not known, with `cells` of shape (0, k); see
        `from_matrices`.
    hexahedra : bool
        Whether cells with 20 nodes are hexahedra, not cubic tetrahedra. Those with 8 always are.

    Raises
    ------
    MeshError
        If shapes of arrays do not fit together, a matrix is not symmetric, rigid motion strains the body, the body is
        in several parts, or elements are inverted, overlap, occur twice or share a face with two others.
    InputError
        If points, cells, material, mass and stiffness are not of one model; see `fe.consistency`.
    LockingError
        If elements are linear and the material is nearly incompressible.
    """

    points: Array
    cells: Array
    mass: sp.csr_matrix
    stiffness: sp.csr_matrix
    cell_mass: Array
    material: Material
    boundaries: dict[str, Array]
    regions: Regions | None = None
    surface: Array | None = None
    hexahedra: bool = False

    def __post_init__(self) -> None:
        validate_type("material", self.material, Material, "ep.Material()")
        validate_flag("hexahedra", self.hexahedra)
        if self.regions is not None:
            validate_type("regions", self.regions, Regions, "fe_model()")
        points = validate_array("points", self.points, (None, 3))
        object.__setattr__(self, "points", points)
        expected = "integers, (ne, 4), (ne, 10), (ne, 20) or (ne, 8)"
        cells = validate_whole("cells", self.cells, expected).copy()
        if cells.ndim != 2:
            raise MeshError(f"cells: expected {expected}, got shape {cells.shape}")
        if cells.size and not (0 <= cells.min() and cells.max() < len(points)):
            raise MeshError(
                f"cells: expected node numbers from 0 to {len(points) - 1}, got {cells.min()} to {cells.max()}"
            )
        object.__setattr__(self, "cells", cells)
        object.__setattr__(self, "cell_mass", validate_array("cell_mass", self.cell_mass, (len(cells),)))
        if not (self.cell_mass > 0).all():
            raise MeshError(
                f"cell_mass: {np.count_nonzero(self.cell_mass <= 0)} elements have no mass, or negative; expected "
                "density times volume of each"
            )
        if self.cells.shape[1] not in ORDERS:
            raise MeshError(
                "cells: expected tetrahedra with 4, 10 or 20 nodes or hexahedra with 8 or 20, got "
                f"{self.cells.shape[1]} nodes; wedges and pyramids are hexahedra that repeat nodes, see fe.elements"
            )
        if self.hexahedra and self.cells.shape[1] not in HEXAHEDRA:
            raise MeshError(f"cells: expected hexahedra with 8 or 20 nodes, got {self.cells.shape[1]} nodes")
        object.__setattr__(self, "hexahedra", self.hexahedra or self.cells.shape[1] == 8)
        for name in ("mass", "stiffness"):
            matrix = plain_matrix(name, getattr(self, name), 3 * len(points))
            if not (matrix.diagonal() > 0).all():
                raise MeshError(
                    f"{name}: {np.count_nonzero(matrix.diagonal() <= 0)} diagonal entries are not positive, expected "
                    "those of a body that nothing holds, whose nodes all have mass and stiffness"
                )
            check_symmetric(name, matrix)
            object.__setattr__(self, name, matrix)
        read_only(self.cells)
        if self.regions is not None and len(self.regions.number) != len(cells):
            raise MeshError(f"regions: expected one for each of {len(cells)} elements, got {len(self.regions.number)}")
        if not len(cells):
            self._check_without_cells()
            return
        if self.surface is not None:
            raise InputError("surface: expected none beside cells, whose faces it would be")
        nu = float(np.max(self.elastic.nu))
        if self.order == 1 and nu > _LINEAR_NU:
            raise LockingError(
                f"nu: linear elements lock volumetrically near incompressibility, expected at most {_LINEAR_NU} with "
                f"them, got {nu}. Take quadratic tetrahedra (order=2), which do not"
            )
        if self.order == 1:
            unused = self.n_nodes - len(np.unique(self.cells))
            if unused:
                raise MeshError(f"points: {unused} nodes belong to no element; remove them")
        check_neighbours(self.cells, *self._faces)
        check_connected(self._faces[1])
        self._check_rigid_motion()
        self._check_boundaries()
        check_elements(points, cells, self.hexahedra, self.cell_mass, self.mass, self.stiffness, self.elastic)

    def _check_without_cells(self) -> None:
        if self.surface is None:
            raise MeshError("cells: expected elements, got none; without them give facets to FEModel.from_matrices")
        check_indices("facets", self.surface, (None, None), self.n_nodes)
        read_only(self.surface)
        check_free(self.mass, self.stiffness)
        check_surface(self.points, self.surface)
        self._check_rigid_motion()
        self._check_boundaries()
        check_against_surface(self.points, self.surface, self.mass, self.stiffness, self.material)

    def _check_rigid_motion(self) -> None:
        scale = largest_entry(self.stiffness) * np.ptp(self.points, axis=0).max()
        strain_force = abs(self.stiffness @ self.rigid_modes).max()
        if strain_force > 1e-8 * scale:
            raise MeshError(
                f"stiffness: rigid motion gives forces of {strain_force:.3g}, expected none; is a node held, or the "
                "order of dofs not x y z x y z? Files need ten digits"
            )

    def _check_boundaries(self) -> None:
        if not isinstance(self.boundaries, dict):
            raise InputError(f"boundaries: expected a dict of names, got {type(self.boundaries).__name__}")
        for name, rows in self.boundaries.items():
            check_indices(f"boundaries[{validate_text('boundaries', name)!r}]", rows, (None,), len(self.facets))

    def warn_if_units_slipped(self) -> None:
        """Warn (`UnitsWarning`) of a material that no solid has, or of an unlikely size, shape, frequency or mass."""
        speed = self.material.bar_wave_speed
        dimensionless = 1.0 in (self.material.E, self.material.rho)
        if not dimensionless and not any(low <= speed <= high for low, high in _WAVE_SPEEDS):
            warn(
                f"material: the speed of waves in a bar, sqrt(E / rho), is {speed:.3g}, that of no solid: expected "
                f"10 to 2e4 in m/s, or 1e6 to 2e7 in mm/s, got E={self.material.E:.6g} and rho={self.material.rho:.6g}."
                " Steel has E=210e9 and rho=7800 in SI units, 210e3 and 7.8e-9 in mm, t and s",
                UnitsWarning,
            )
            return
        size = np.ptp(self.points, axis=0).max()
        if not dimensionless and self.material.in_millimetres and size < _SMALLEST_IN_MM:
            warn(
                f"the body is {size:.4g} long and weighs {self.total_mass:.3g} in the material's units, whose E="
                f"{self.material.E:.6g} and rho={self.material.rho:.6g} are those of a solid in millimetres. If the "
                "geometry is in metres, scale it by 1e3 (scale=1e3 of fe_model), or give the material in SI units: "
                "steel has E=210e9 and rho=7800. Go on if that is its size",
                UnitsWarning,
            )
        if self.material.E < _SOFTEST_SI or self.material.rho < _LIGHTEST_SI:
            return  # another system of units, mm-t-s or dimensionless
        lowest = speed / (2 * size)
        thickness = 3.5 * np.sqrt(np.linalg.eigvalsh(np.cov(self.points.T))[1])  # as of a rectangle, the second side
        if size < _SMALLEST_PLAUSIBLE or size > _SLENDEREST_PLAUSIBLE * thickness:
            warn(
                f"the body is {size:.4g} long and {thickness:.3g} thick in the material's units, metres with an SI "
                "material. Was it scaled twice, or drawn in two units? Go on if that is its size",
                UnitsWarning,
            )
        elif lowest < _LOWEST_PLAUSIBLE_HZ or self.total_mass > _LARGEST_PLAUSIBLE_MASS:
            warn(
                f"the body is {size:.4g} long and weighs {self.total_mass:.3g} in the material's units, its first "
                f"longitudinal frequency would be about {lowest:.3g} Hz. With an SI material the geometry must be in "
                "metres: if it is in millimetres, scale it by 1e-3 (scale=1e-3 of fe_model), in inches by 0.0254",
                UnitsWarning,
            )

    @classmethod
    def from_matrices(
        cls,
        mass: sp.spmatrix | Array,
        stiffness: sp.spmatrix | Array,
        points: Array,
        facets: Array | None = None,
        *,
        material: Material | Mapping[str, Material],
        cells: Array | None = None,
        regions: Sequence[str] | Array | None = None,
        dofs: Array | None = None,
        boundaries: dict[str, Array] | None = None,
        hexahedra: bool = False,
    ) -> FEModel:
        """FE model with the mass and stiffness of another program, by its elements or by its surface alone.

        All that comes of mass, stiffness and surface needs no elements: bodies, contact, joints, forces and motion.
        Strain and stress inside, plastic flow and the error of the mesh need them. The matrices are compared with the
        material: the mass with density times volume, energies of uniform strains, and the forces at all nodes under
        one of them.

        Parameters
        ----------
        mass, stiffness : (3n, 3n) sparse matrix or array
            Of the free body [kg, N/m], both triangles. `ep.read_matrices` reads files of other programs.
        points : (n, 3) array
            Nodes [m].
        facets : (nf, 3), (nf, 6), (nf, 10), (nf, 4) or (nf, 8) int array, optional
            The whole surface, as rows of `points`: corners counter-clockwise seen from outside, then nodes on edges.
        material : Material or dict of str to Material
            The one that the matrices were made with, for waves and contact; or one for each name of `regions`.
        cells : (ne, k) int array, optional
            Instead of facets: all elements, see `FEModel`.
        regions : (ne,) sequence of str, optional
            Name of the material of each element.
        dofs : (3n, 2) int array, optional
            What each row and column is: a row of `points`, and 0, 1 or 2 for x, y, z. Default: x y z of each node.
        boundaries : dict of str to int array, optional
            Named boundaries, as rows of the facets.
        hexahedra : bool
            Whether cells with 20 nodes are hexahedra, see `FEModel`.

        Returns
        -------
        FEModel

        Raises
        ------
        MeshError
            If a matrix is not symmetric, rigid motion strains the body, or facets are not a closed surface.
        InputError
            If both or none of facets and cells are given, regions and materials do not fit, dofs are held or missing,
            or points, material, mass and stiffness are not of one model.

        Warns
        -----
        UnitsWarning
            If sizes or the material are unlikely.
        """
        validate_flag("hexahedra", hexahedra)
        if (facets is None) == (cells is None):
            raise InputError(f"facets, cells: expected one of them, got {'none' if facets is None else 'both'}")
        points = validate_array("points", points, (None, 3))
        M = ordered("mass", mass, len(points), dofs)
        K = ordered("stiffness", stiffness, len(points), dofs)
        check_free(M, K)
        if facets is None:
            elements, surface = validate_whole("cells", cells, "integers, (ne, k)"), None
            check_indices("cells", elements, (None, None), len(points))
            elastic = given_elastic(material, regions, len(elements))
            known = len(elements) and elements.shape[1] in ORDERS
            as_hexahedra = hexahedra or elements.shape[1] == 8
            volume = np.ones(len(elements))
            if known and not (as_hexahedra and elements.shape[1] not in HEXAHEDRA):
                volume = integrals(points, elements, as_hexahedra)[0]
            cell_mass = elastic.rho * volume
            main = elastic.largest(volume) if isinstance(elastic, Regions) else elastic
        else:
            elastic = main = given_material(material, regions)
            surface = validate_whole("facets", facets, "integers, (nf, k)").copy()
            check_indices("facets", surface, (None, None), len(points))
            elements, cell_mass = np.empty((0, cells_beneath(surface)), dtype=np.int64), np.empty(0)
            hexahedra = surface.shape[1] in QUADS
        named = {} if boundaries is None else boundaries
        several = elastic if isinstance(elastic, Regions) else None
        model = cls(points, elements, M, K, cell_mass, main, named, several, surface, hexahedra)
        model.warn_if_units_slipped()
        return model

    def need_cells(self, what: str) -> None:
        """Raise `InputError` that names what needs elements, if this model has none."""
        if self.surface is not None:
            raise InputError(
                f"fem: {what} needs the elements, which this model of matrices and a surface has not; give cells= to "
                "FEModel.from_matrices instead of facets"
            )

    @property
    def elastic(self) -> Material | Regions:
        """Elastic constants: of the one material, or one number an element."""
        return self.material if self.regions is None else self.regions

    def material_beneath(self, facets: Array) -> Material:
        """Material of the elements beneath some facets, rows of `facets`, (k,) int; see `Regions.of_cells`."""
        check_indices("facets", facets, (None,), len(self.facets))
        return self.material if self.regions is None else self.regions.of_cells(self._facet_faces[facets, 0])

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def n_dofs(self) -> int:
        """Number of dofs, three a node."""
        return 3 * len(self.points)

    @property
    def order(self) -> int:
        """Polynomial order of the elements, 1, 2 or 3."""
        return 2 if self.hexahedra and self.cells.shape[1] == 20 else ORDERS[self.cells.shape[1]]

    @property
    def tetrahedral(self) -> bool:
        """Whether all elements are tetrahedra, kept as such."""
        return not self.hexahedra

    @cached_property
    def kinds(self) -> list[tuple[Kind, Array]]:
        """Kinds of its elements, each with its rows of `cells`, (m,) int."""
        return kinds_of(self.cells, self.hexahedra)

    @cached_property
    def facets(self) -> Array:
        """(nf, 3), (nf, 6) or (nf, 10) int array: outward surface triangles, see `FACET_NODES`.

        Quads of hexahedra are (nf, 4) or (nf, 8); a triangle among them is `a b c c`, see `fe.elements`.
        """
        if self.surface is not None:
            return self.surface
        cell, face = self._facet_faces.T
        facets: Array = self._faces[0].reshape(*self._faces[1].shape, -1)[cell, face]
        read_only(facets)
        return facets

    @cached_property
    def _facet_faces(self) -> Array:
        """(nf, 2) int array: element of each surface facet, and its face there."""
        number = self._faces[1]
        flat = number.ravel()
        of_surface = np.flatnonzero((np.bincount(flat[flat >= 0])[flat] == 1) & (flat >= 0))
        return np.column_stack(np.divmod(of_surface, number.shape[1]))

    @cached_property
    def _faces(self) -> tuple[Array, Array]:
        """Faces of all elements, (6 ne or 4 ne, k), and the number, (ne, 6 or 4), that equal faces have in common."""
        return faces_of(self.cells, self.hexahedra)

    @property
    def element_faces(self) -> tuple[Array, Array]:
        """Faces of all elements, (f ne, k), and numbers that equal ones share, (ne, f); see `elements.faces_of`."""
        return self._faces

    @property
    def neighbours(self) -> Array:
        """(ne, 4) or (ne, 6) int array: numbers of the elements' faces; two elements that share one are neighbours.

        It is -1 where a wedge, pyramid or tetrahedron among hexahedra has no face.
        """
        return self._faces[1]

    @cached_property
    def fingerprint(self) -> Array:
        """(9,) array: sums over nodes and facets that distinguish this mesh from all others; see `same_mesh`."""
        return mesh_fingerprint(self.points, self.facets)

    @cached_property
    def matrix_fingerprint(self) -> Array:
        """(4,) array: quadratic forms that distinguish mass and stiffness from all others; see `same_matrices`."""
        products = []
        for matrix in (self.mass, self.stiffness):
            # Nodes far apart in space have numbers beside each other: no motion of a body is like these.
            for motion in (np.sin(1.0 + np.arange(self.n_dofs)), np.cos(1.7 * np.arange(self.n_dofs))):
                products.append(float(motion @ (matrix @ motion)))
        fingerprint = np.array(products)
        read_only(fingerprint)
        return fingerprint

    @cached_property
    def lumped_mass(self) -> Array:
        """(n,) array: nodal masses [kg] by HRZ lumping, positive for all orders (paper, section 2.1).

        Hinton, Rock and Zienkiewicz (1976): the diagonal of the consistent mass of each element, scaled to its mass.
        """
        if self.surface is not None:
            lumped = lumped_by_diagonal(self.mass)
            read_only(lumped)
            return lumped
        share = np.empty(self.cells.shape)
        for kind, rows in self.kinds:
            share[rows] = self.cell_mass[rows, None] * kind.mass_shares
        lumped = np.bincount(self.cells.ravel(), share.ravel(), minlength=self.n_nodes)
        read_only(lumped)
        return lumped

    @property
    def lumped_mass_matrix(self) -> sp.csr_matrix:
        """(3n, 3n) diagonal csr matrix of `lumped_mass` [kg]."""
        return sp.diags(np.repeat(self.lumped_mass, 3), format="csr")

    @cached_property
    def total_mass(self) -> float:
        """Mass of the body [kg]."""
        return float(self.cell_mass.sum()) if self.surface is None else float(self.mass.sum()) / 3

    @cached_property
    def centre_of_mass(self) -> Array:
        """(3,) array: centre of mass [m], from the consistent mass."""
        ones = np.tile([1.0, 0, 0], self.n_nodes)
        weight = (self.mass @ ones)[::3]
        centre: Array = weight @ self.points / weight.sum()
        return centre

    @cached_property
    def inertia_tensor(self) -> Array:
        """(3, 3) array: moments of inertia about the centre of mass [kg m2], in the axes of the mesh.

        Off the diagonal are the negative products of inertia, as in Exudyn's `ObjectRigidBody`. About another point p
        it is `J + m (|r|^2 I - r r')` with r = p - centre_of_mass (Steiner).
        """
        turning = self.rigid_modes[:, 3:]
        tensor: Array = turning.T @ (self.mass @ turning)
        read_only(tensor)
        return tensor

    @cached_property
    def rigid_modes(self) -> Array:
        """(3n, 6) array: unit translations [m] and unit rotations [rad] about the centre of mass."""
        modes = rigid_modes(self.points - self.centre_of_mass)
        read_only(modes)
        return modes

    @property
    def cell_volume(self) -> Array:
        """(ne,) array: volume of each element [m3]."""
        return self.cell_mass / self.elastic.rho

    @property
    def max_size(self) -> float:
        """Edge of the regular tetrahedron, cube, wedge or pyramid that has the volume of the largest element [m].

        If elements are not known, by the distance of nodes that the stiffness couples.
        """
        return float(self._sizes.max())

    @property
    def _sizes(self) -> Array:
        if self.surface is not None:
            return reach(self.points, self.stiffness) / (_HEXAHEDRA if self.surface.shape[1] in QUADS else _TETRAHEDRA)
        volume: Array = self.cell_volume.copy()
        for kind, rows in self.kinds:
            volume[rows] /= _VOLUMES[kind.corners]
        return np.cbrt(volume)

    @property
    def resolved_frequency(self) -> float:
        """Highest frequency that the mesh resolves [Hz], of shear waves and of bending waves in thin walls.

        A shear wave needs four node spacings of the largest element; for bending waves see `walls.weakest_wall`.
        """
        return min(self.resolved_shear_frequency, self.weakest_wall.frequency)

    @property
    def resolved_shear_frequency(self) -> float:
        """Frequency of a shear wave as long as four node spacings of the largest element [Hz]."""
        return float((self.elastic.shear_wave_speed * self.order / (4 * self._sizes)).min())

    @cached_property
    def weakest_wall(self) -> Wall:
        """The wall whose bending waves the mesh resolves worst."""
        if self.surface is not None:
            return weakest_between(self.points, facet_corners(self.surface), self.order, self.material)
        facets = self._facet_faces
        every = ((self.material, np.arange(len(facets))),)
        materials = every if self.regions is None else self.regions.softest(facets[:, 0])
        return weakest_wall(*self._at_facets, self.order, materials)

    @property
    def stiff_wall(self) -> Wall | None:
        """A wall that the elements make too stiff in bending, if there is one; see `walls.stiff_wall`."""
        size = float(np.ptp(self.points, axis=0).max())
        area = np.zeros(len(self.facets))
        for rows, columns in by_shape(self.facets):
            area[rows] = facet_integration(self.points, self.facets[rows][:, columns])[1].sum(axis=1)
        return stiff_wall(*self._at_facets, area, size, self.order, self.material)

    @cached_property
    def _at_facets(self) -> tuple[Array, Array]:
        """Length of the elements, and thickness of the wall, at each facet, (nf,) [m]."""
        return at_facets(self.points, *self._walls)

    def shares_of_walls(self, cells: Array) -> Array:
        """Height of elements by the thickness of the wall in which they lie; see `walls.shares_of_walls`.

        Parameters
        ----------
        cells : (k, c) int array
            Rows of elements of the body.

        Returns
        -------
        (k,) array
        """
        return shares_of_walls(self.points, cells[:, : 8 if self.hexahedra else 4], *self._walls)

    @property
    def _walls(self) -> tuple[Array, Array, Array]:
        """Outward faces of each cell by their corners, facets of the surface, and numbers of faces; see `walls`."""
        faces, number = self._faces
        return facet_corners(faces).reshape(*number.shape, -1), self._facet_faces, number

    def nearest_node(self, point: Vector) -> int:
        """Index of the node nearest to `point`, (3,) [m]; see `places.nearest_node`."""
        return nearest_node(self.points, point)

    def __dir__(self) -> list[str]:
        return for_users(
            self,
            {
                "fingerprint",
                "matrix_fingerprint",
                "need_cells",
                "neighbours",
                "shares_of_walls",
                "stiff_wall",
                "warn_if_units_slipped",
                "weakest_wall",
            },
        )

    def __repr__(self) -> str:
        counts = {kind.corners: len(rows) for kind, rows in self.kinds}
        shape = " and ".join(f"{count} {_CALLED[corners]}" for corners, count in counts.items())
        if self.surface is not None:
            shape = f"{len(self.surface)} facets around elements"
        return (
            f"FEModel({self.n_nodes} nodes, {shape} of order {self.order}, "
            f"{self.n_dofs} dofs, {self.total_mass:.4g} kg)"
        )


def mesh_fingerprint(points: Array, facets: Array) -> Array:
    """(9,) array: numbers of points and facets, weighted sums over both, and the place of the first point.

    The weights have no pattern that a mesh could have. All but the last three numbers stay when the mesh is moved.
    """
    weight = np.sin(1.0 + np.arange(len(points)))
    surface = (weight[facets].sum(axis=1) ** 2).mean()  # whatever the order of facets
    size = np.ptp(points, axis=0).max()
    shape, place = weight @ (points - points[0]) / size, points[0] / size
    fingerprint = np.array([len(points), len(facets), surface, *shape, *place])
    read_only(fingerprint)
    return fingerprint


def same_mesh(first: Array, second: Array, *, same_place: bool = True) -> bool:
    """Whether two fingerprints are of the same mesh; they may differ by round-off."""
    n = 9 if same_place else 6
    return bool(np.allclose(first[:n], second[:n], rtol=1e-9, atol=1e-9 * np.sqrt(first[0])))


def same_matrices(first: Array, second: Array) -> tuple[bool, bool]:
    """Whether two `FEModel.matrix_fingerprint` are of the same mass, and of the same stiffness, but for round-off."""
    same = abs(first - second) <= _ROUND_OFF * abs(second)
    return bool(same[:2].all()), bool(same[2:].all())


def node_dofs(nodes: Array) -> Array:
    """(3k,) int array: the dofs x, y, z of each of k nodes."""
    return (3 * np.asarray(nodes)[:, None] + np.arange(3)).ravel()


def rigid_modes(arms: Array) -> Array:
    """Unit translations and rotations of points at `arms`, (n, 3) [m], as a (3n, 6) array."""
    n = len(arms)
    modes = np.zeros((n, 3, 6))
    modes[:, :, :3] = np.eye(3)
    for axis in range(3):
        modes[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arms)
    return modes.reshape(3 * n, 6)
