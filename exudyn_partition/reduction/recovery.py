"""Recovery of strain and stress, on request: at points, along strain gauges, and as nodal fields.

Quantities that are linear in the nodal displacements are sparse rows on them, xyz interleaved as in `FEModel`. The same
rows are used for the full model, `rows @ u`, and for a reduced one, `ReducedBody.reduced_rows` and
`PartitionBody.recover`.

The six components are in Voigt order xx, yy, zz, yz, xz, xy. Shear strains are engineering strains, gamma_xy = 2
eps_xy.

With the residual and contact-adapted bases the recovered field is that of the kept shapes. The static answer of all
other shapes is known at the contact only, as its residual flexibility, and is missing here. This part is large, and
fades only beyond a wavelength at f_cut. `static_correction` adds it (mode acceleration). The other bases do not need
it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from ..errors import InputError
from ..fe.elements import Kind
from ..fe.facets import flat_triangles
from ..fe.model import FEModel
from ..support.arrays import Array, Vector
from ..support.checks import (
    read_only,
    shape_of,
    validate_array,
    validate_items,
    validate_positive,
    validate_text,
    validate_type,
    validate_vector,
)
from ..surfaces.surface import closest_points
from .static_answer import StaticAnswer, static_correction

__all__ = [
    "StaticAnswer",
    "StrainGauge",
    "displacement_rows",
    "gauge_rows",
    "nodal_strain",
    "nodal_stress",
    "static_correction",
    "strain_rows",
    "stress_rows",
    "von_mises",
]

# eps_v = sum_ab _VOIGT[v, a, b] du_a/dx_b
_VOIGT = np.zeros((6, 3, 3))
_VOIGT[[0, 1, 2], [0, 1, 2], [0, 1, 2]] = 1.0
_VOIGT[[3, 4, 5], [1, 0, 0], [2, 2, 1]] = 1.0
_VOIGT[[3, 4, 5], [2, 2, 1], [1, 0, 0]] = 1.0

# How far outside a point may lie, as a share of an element's height: facets differ from a curved surface.
_OVERSHOOT = 0.05
_FLAT = 0.1  # volume of a cell near a node, by that in its middle, below which it knows no strain at that node
_NEWTON_STEPS = 20
_CONVERGED = 1e-9  # local coordinates


@dataclass(frozen=True, eq=False)
class StrainGauge:
    """A strain gauge bonded to a body: it measures the mean normal strain along its length.

    On a surface, `direction` must lie in it such that both ends of the gauge are in the body; nothing is projected.

    Parameters
    ----------
    position : (3,) array
        The middle of the gauge, in the body's own coordinates [m].
    direction : (3,) array
        Its axis, a vector of any length but zero; stored as a unit vector.
    length : float
        Gauge length [m].
    name : str
        For messages and legends.

    Raises
    ------
    InputError
    """

    position: Array
    direction: Array
    length: float
    name: str = ""

    if TYPE_CHECKING:  # any three numbers will do; they are kept as arrays

        def __init__(self, position: Vector, direction: Vector, length: float, name: str = "") -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", validate_vector("position", self.position))
        direction = validate_vector("direction", self.direction)
        size = np.linalg.norm(direction)
        if not 0 < size < np.inf:
            raise InputError(
                f"direction: expected the gauge's axis, a vector that has a length, got {self.direction!r}"
            )
        direction = direction / size
        read_only(direction)
        object.__setattr__(self, "direction", direction)
        object.__setattr__(self, "length", validate_positive("length", self.length, "m"))
        validate_text("name", self.name)

    @property
    def ends(self) -> Array:
        """(2, 3) array: its two ends [m]."""
        ends: Array = self.position + np.outer([-0.5, 0.5], self.length * self.direction)
        return ends


def gauge_rows(fem: FEModel, gauges: Sequence[StrainGauge]) -> sp.csr_matrix:
    """Strain of gauges, (u(x + d L / 2) - u(x - d L / 2)) . d / L: the exact mean of d . eps d along each.

    Parameters
    ----------
    fem : FEModel
    gauges : sequence of k StrainGauge

    Returns
    -------
    (k, 3n) csr matrix
        [1/m]; times nodal displacements [m] it gives strains.

    Raises
    ------
    InputError
        If an argument is no such thing, or an end of a gauge lies outside the body, beyond 5 % of an element's height.
    """
    gauges = validate_items("gauges", gauges, StrainGauge, "StrainGauge()")
    if not gauges:
        raise InputError("gauges: expected at least one StrainGauge, got none")
    k = len(gauges)
    ends = np.array([gauge.ends for gauge in gauges]).reshape(-1, 3)
    weights = np.array([np.outer([-1, 1], gauge.direction / gauge.length) for gauge in gauges])
    difference = sp.csr_matrix((weights.ravel(), np.arange(6 * k), 6 * np.arange(k + 1)), shape=(k, 6 * k))
    return difference @ _interpolation(fem, *locate(fem, ends, lambda i: f"gauges[{i // 2}] {gauges[i // 2].name!r}"))


def displacement_rows(fem: FEModel, points: Array) -> sp.csr_matrix:
    """Displacement of points, interpolated by the shape functions.

    Parameters
    ----------
    fem : FEModel
    points : (k, 3) array
        In the body's own coordinates [m].

    Returns
    -------
    (3k, 3n) csr matrix
        x, y, z of each point.

    Raises
    ------
    InputError
        See `gauge_rows`.
    """
    return _interpolation(fem, *locate(fem, validate_array("points", points, (None, 3))))


def strain_rows(fem: FEModel, points: Array) -> sp.csr_matrix:
    """Strain at points, from the gradients of the shape functions.

    Strain is discontinuous between elements; on their common boundary it is that of one of them.

    Parameters
    ----------
    fem : FEModel
    points : (k, 3) array
        In the body's own coordinates [m].

    Returns
    -------
    (6k, 3n) csr matrix
        xx, yy, zz, yz, xz, xy of each point [1/m], engineering shear strains.

    Raises
    ------
    InputError
        See `gauge_rows`.
    """
    return _rows(fem, *_strain_rows(fem, points))


def stress_rows(fem: FEModel, points: Array) -> sp.csr_matrix:
    """Stress at points by Hooke's law, as `strain_rows`.

    Parameters
    ----------
    fem : FEModel
    points : (k, 3) array
        In the body's own coordinates [m].

    Returns
    -------
    (6k, 3n) csr matrix
        xx, yy, zz, yz, xz, xy of each point [Pa/m].

    Raises
    ------
    InputError
        See `gauge_rows`.
    """
    cell, strain = _strain_rows(fem, points)
    return _rows(fem, cell, np.einsum("mwv,mvka->mwka", _elasticity(fem, cell), strain))


def nodal_strain(fem: FEModel, displacement: Array) -> Array:
    """Strain field: at each node, the mean of the strains of its elements there, weighted by mass.

    An element that curved sides nearly flatten at a node counts there with the strain in its middle.

    Parameters
    ----------
    fem : FEModel
    displacement : (n, 3) array
        Nodal displacements [m], as `ReducedBody.displacement` gives them.

    Returns
    -------
    (n, 6) array
        xx, yy, zz, yz, xz, xy, engineering shear strains.

    Raises
    ------
    InputError
    """
    displacement = _validate_field(fem, displacement)
    strain = _strains(_mean_slopes(fem, displacement[..., None], np.arange(fem.n_nodes), 1.0))
    return np.ascontiguousarray(strain[..., 0].T)


def nodal_stress(fem: FEModel, displacement: Array) -> Array:
    """Stress field by Hooke's law, averaged as `nodal_strain`, also where two materials meet.

    Parameters
    ----------
    fem : FEModel
    displacement : (n, 3) array
        Nodal displacements [m].

    Returns
    -------
    (n, 6) array
        xx, yy, zz, yz, xz, xy [Pa].

    Raises
    ------
    InputError
    """
    displacement = _validate_field(fem, displacement)
    return np.ascontiguousarray(nodal_stresses(fem, displacement[..., None], np.arange(fem.n_nodes))[0])


def nodal_stresses(fem: FEModel, displacements: Array, nodes: Array) -> Array:
    """`nodal_stress` of m displacement fields, (n, 3, m) [m], at some nodes, (k,) int: (m, k, 6) [Pa]."""
    shear, lame = fem.elastic.shear_modulus, fem.elastic.lame
    if np.ndim(shear) == np.ndim(lame) == 0:
        stress = _strains(_mean_slopes(fem, displacements, nodes, 1.0))
        dilatation = lame * stress[:3].sum(axis=0)
        stress *= shear
    else:
        stress, stretched = (_strains(_mean_slopes(fem, displacements, nodes, scale)) for scale in (shear, lame))
        dilatation = stretched[:3].sum(axis=0)
    stress[:3] *= 2
    stress[:3] += dilatation
    return stress.transpose(2, 1, 0)


def _strains(slopes: Array) -> Array:
    """Strains, (6, k, m), from derivatives of m displacement fields at k nodes, see `_mean_slopes`."""
    strain = np.empty((6, len(slopes), slopes.shape[-1]))
    strain[:3] = np.einsum("kaam->akm", slopes)
    for shear, (a, b) in zip(strain[3:], ((1, 2), (0, 2), (0, 1)), strict=True):
        np.add(slopes[:, b, a], slopes[:, a, b], out=shear)
    return strain


def _mean_slopes(fem: FEModel, displacements: Array, nodes: Array, scale: float | Array) -> Array:
    """Derivatives of displacement fields at nodes: means over their elements there, weighted by mass.

    One sparse matrix finds them for all fields.

    Parameters
    ----------
    fem : FEModel
    displacements : (n, 3, m) array
        [m]
    nodes : (k,) int array
    scale : float or (ne,) array
        Factor of the derivatives in each element.

    Returns
    -------
    (k, 3, 3, m) array
        Entry (i, b, a, j) is the derivative of component a of field j along axis b at node i.
    """
    place, weight = np.full(fem.n_nodes, -1), np.zeros(len(nodes))
    place[nodes] = np.arange(len(nodes))
    rows, columns, values = [], [], []
    scales = np.broadcast_to(scale, len(fem.cells))
    for kind, cells in fem.kinds:
        of_nodes = fem.cells[cells][:, kind.columns]
        element, corner = np.nonzero(place[of_nodes] >= 0)
        cell, around, here = cells[element], of_nodes[element], place[of_nodes[element, corner]]
        gradient = _gradients_at_nodes(kind, fem.points[around], corner)
        values.append(((fem.cell_mass[cell] * scales[cell])[:, None, None] * gradient).ravel())
        rows.append(np.broadcast_to(3 * here[:, None, None] + np.arange(3), gradient.shape).ravel())
        columns.append(np.broadcast_to(around[:, :, None], gradient.shape).ravel())
        weight += np.bincount(here, fem.cell_mass[cell], minlength=len(nodes))
    where = np.concatenate(rows), np.concatenate(columns)
    mean = np.concatenate(values) / weight[where[0] // 3]
    derivatives = sp.csr_matrix((mean, where), shape=(3 * len(nodes), fem.n_nodes))
    return np.asarray(derivatives @ displacements.reshape(fem.n_nodes, -1)).reshape(len(nodes), 3, 3, -1)


def von_mises(stress: Array) -> Array:
    """Von Mises stress, (...) [Pa], of stresses (..., 6) [Pa] in the order xx, yy, zz, yz, xz, xy.

    Raises
    ------
    InputError
        If the last axis is not of length six, or they are no finite numbers.
    """
    shape = shape_of(stress)
    if shape[-1:] != (6,):
        raise InputError(f"stress: expected six components on the last axis, got shape {shape}")
    stress = validate_array("stress", stress, (*[None] * (len(shape) - 1), 6))
    normal, shear = stress[..., :3], stress[..., 3:]
    differences = normal - np.roll(normal, 1, axis=-1)
    mises: Array = np.sqrt(0.5 * (differences**2).sum(axis=-1) + 3 * (shear**2).sum(axis=-1))
    return mises


def _strain_rows(fem: FEModel, points: Array) -> tuple[Array, Array]:
    """Cell of each of m points, and its strain by displacements of the cell's k nodes, (m, 6, k, 3)."""
    cell, local = locate(fem, validate_array("points", points, (None, 3)))
    gradient = np.empty((len(cell), fem.cells.shape[1], 3))
    for kind, of_kind in _by_kind(fem, cell):
        nodes = fem.points[fem.cells[cell[of_kind]][:, kind.columns]]
        gradient[of_kind] = kind.on_row(_gradients_of(kind, nodes, local[of_kind]))
    return cell, np.einsum("vab,mkb->mvka", _VOIGT, gradient)


def _elasticity(fem: FEModel, cells: Array) -> Array:
    """Matrices of Hooke's law on engineering strains in some elements, (m,) int: (m, 6, 6) [Pa]."""
    shear, lame = (
        np.broadcast_to(value, len(fem.cells))[cells, None, None]
        for value in (fem.elastic.shear_modulus, fem.elastic.lame)
    )
    stiffness: Array = shear * np.diag([2.0, 2, 2, 1, 1, 1])
    stiffness[:, :3, :3] += lame
    return stiffness


def _rows(fem: FEModel, cell: Array, coefficients: Array) -> sp.csr_matrix:
    """Rows with `coefficients`, (m, r, nodes of a cell, 3), on the displacements of m cells: (m r, 3n)."""
    m, r, k, _ = coefficients.shape
    columns = np.broadcast_to((3 * fem.cells[cell][:, :, None] + np.arange(3))[:, None], coefficients.shape)
    starts = 3 * k * np.arange(m * r + 1)
    matrix = sp.csr_matrix((coefficients.ravel(), columns.ravel(), starts), shape=(m * r, fem.n_dofs))
    matrix.eliminate_zeros()
    return matrix


def _interpolation(fem: FEModel, cell: Array, local: Array) -> sp.csr_matrix:
    values = np.empty((len(cell), fem.cells.shape[1]))
    for kind, of_kind in _by_kind(fem, cell):
        values[of_kind] = kind.on_row(kind.functions(local[of_kind])[0])
    return _rows(fem, cell, values[:, None, :, None] * np.eye(3)[:, None])


def _gradients_of(kind: Kind, nodes: Array, local: Array) -> Array:
    """Derivatives of the shape functions in space [1/m], of cells with `nodes`; both (m, nodes of a cell, 3)."""
    _, derivatives = kind.functions(local)
    return derivatives @ np.linalg.inv(np.einsum("mka,mkj->maj", nodes, derivatives))


def _gradients_at_nodes(kind: Kind, nodes: Array, corner: Array) -> Array:
    """`_gradients_of` m cells at one of their nodes each, (m,) int; in their middles where they are nearly flat there.

    Curved sides can flatten a cell at a node so far that derivatives there are a hundred times those around.
    """
    local, middle = kind.nodes[corner], np.broadcast_to(kind.middle, (len(corner), 3))
    here, within = (np.einsum("mka,mkj->maj", nodes, kind.functions(at)[1]) for at in (local, middle))
    flat = abs(np.linalg.det(here)) < _FLAT * abs(np.linalg.det(within))
    return _gradients_of(kind, nodes, np.where(flat[:, None], middle, local))


def _by_kind(fem: FEModel, cell: Array) -> list[tuple[Kind, Array]]:
    """Places in a list of cells, (m,) int, of each kind of elements."""
    places = [(kind, np.flatnonzero(np.isin(cell, rows))) for kind, rows in fem.kinds]
    return [(kind, of_kind) for kind, of_kind in places if len(of_kind)]


def _validate_fem(fem: FEModel) -> None:
    validate_type("fem", fem, FEModel, "fe_model()")
    fem.need_cells("strain and stress")


def _validate_field(fem: FEModel, displacement: Array) -> Array:
    """Return nodal displacements, (n, 3), checked."""
    _validate_fem(fem)
    return validate_array("displacement", displacement, (fem.n_nodes, 3))


def locate(fem: FEModel, points: Array, name: Callable[[int], str] = "points[{}]".format) -> tuple[Array, Array]:
    """Cell of each point and its local coordinates there, (m,) and (m, 3).

    A point slightly outside has coordinates outside the cell, so that linear fields are extrapolated exactly.
    """
    _validate_fem(fem)
    nodes = fem.points[fem.cells]
    # Spheres around cells, not nearest centroids: in a graded mesh, centroids of many small cells can be nearer.
    centre = nodes.mean(axis=1)
    radius = 1.1 * np.linalg.norm(nodes - centre[:, None], axis=2).max(axis=1)
    near = cKDTree(points).query_ball_point(centre, radius)
    cell = np.repeat(np.arange(len(nodes)), [len(inside) for inside in near])
    point = np.fromiter(chain.from_iterable(near), dtype=np.int64, count=len(cell))
    local, depth = np.empty((len(cell), 3)), np.empty(len(cell))
    for kind, of_kind in _by_kind(fem, cell):
        local[of_kind] = _local_coordinates(kind, nodes[cell[of_kind]][:, kind.columns], points[point[of_kind]])
        depth[of_kind] = kind.depth(local[of_kind])
    order = np.argsort(depth)
    order = order[depth[order] >= -_OVERSHOOT]
    pair = np.full(len(points), -1)
    pair[point[order]] = order  # the last one is kept: the cell in which the point lies deepest
    outside = np.flatnonzero(pair < 0)
    if len(outside):
        i = int(outside[0])
        facets = fem.points[flat_triangles(fem.facets)[0]] if fem.hexahedra else fem.points[fem.facets]
        surface = closest_points(points[[i]], facets)
        nearest = surface.weights[0] @ facets[surface.facet[0]]
        raise InputError(
            f"{name(i)}: {points[i]} m lies outside the body, {np.linalg.norm(points[i] - nearest):.4g} m from the "
            f"nearest point of its surface, {nearest} m"
        )
    return cell[pair], local[pair]


def _local_coordinates(kind: Kind, nodes: Array, targets: Array) -> Array:
    """Local coordinates of `targets`, (m, 3), in cells with `nodes`, by Newton; nan where it does not converge."""
    local = np.tile(kind.middle, (len(nodes), 1))
    for _ in range(_NEWTON_STEPS):
        values, derivatives = kind.functions(local)
        miss = targets - np.einsum("mk,mka->ma", values, nodes)
        jacobian = np.einsum("mka,mkj->maj", nodes, derivatives)
        before = local
        # Far outside a curved cell the map is not unique; points outside this box are not in the cell.
        local = np.clip(local + np.linalg.solve(jacobian, miss[:, :, None])[:, :, 0], -1, 2)
        if kind.corners == 5:  # beyond its tip a pyramid is none
            local[:, 2] = np.minimum(local[:, 2], 1.0)
        moving = abs(local - before).max(axis=1, initial=0) > _CONVERGED
        if not moving.any():
            break
    local[moving] = np.nan
    return local


def __dir__() -> list[str]:
    return __all__
