"""Checks of a finished mesh: they find damage that does not break the format of a file."""

from __future__ import annotations

import numpy as np

from ..errors import InvertedElementsError, MeshQualityWarning
from ..support.arrays import Array
from ..support.warn import warn
from .consistency import integrals
from .elements import kinds_of
from .facets import by_shape, covered_quads
from .model import FEModel
from .shapes import QUADS, TET_EDGES, nodes_on_edges, shape_functions

_VOLUME, _INERTIA = 1e-6, 1e-3  # allowed relative difference of elements and surface
_FAR = 3.0  # largest distance of a node from its nearest neighbour, by the longest edge opposite to it
_BENT = 0.35  # largest distance of a node from its place on a straight edge, by the edge's length
_FLAT = 0.01  # least shape quality of an element, by the mean of its neighbours


_OF_SHAPE = (
    "Small edges, thin walls and sharp corners of a shape make such elements, and so do large sizes at curves. "
    "Take a smaller maxh, a Refine there, or a shape without such places"
)
_OF_FILE = (
    "Is the file damaged? Checked were volume and inertia against the surface's, places of nodes, and shapes of "
    "elements; mesh anew if this place is not as you drew it"
)


def check_inside(fem: FEModel) -> None:
    """Check that volume and second moments of the elements are those of the space inside the surface.

    The divergence theorem gives the latter.

    Raises
    ------
    InvertedElementsError
        If elements and surface have different volumes or second moments.
    """
    origin = fem.points.mean(axis=0)
    volume, moments = volume_inside(fem.points - origin, fem.facets)
    by_cells = fem.cell_volume.sum()
    if abs(by_cells - volume) > _VOLUME * by_cells:
        off = abs(integrals(fem.points, fem.cells, fem.hexahedra)[0] - fem.cell_volume)
        worst = int(off.argmax())
        where = ", ".join(f"{x:.4g}" for x in fem.points[fem.cells[worst]].mean(axis=0))
        named = f" One is element {worst} (counted from 0) at ({where})." if off[worst] > _VOLUME * by_cells else ""
        raise InvertedElementsError(
            f"mesh: its elements have a volume of {by_cells:.6g} m3, its surface encloses {volume:.6g} m3, expected "
            f"the same: elements overlap, or sides turn some inside out.{named} Check the places of nodes, or mesh "
            "anew, with smaller elements there"
        )
    if fem.regions is not None:
        return  # the mass matrix is of several densities
    arms = fem.points - origin
    mass = fem.mass[::3][:, ::3]
    by_mass = np.einsum("ni,ni->i", arms, mass @ arms) / fem.material.rho
    if (abs(by_mass - moments) > _INERTIA * moments.sum()).any():
        raise InvertedElementsError(
            f"mesh: the second moments of its mass matrix are {by_mass} m5, those inside its surface {moments} m5, "
            "expected the same within 0.1 %: elements overlap or are turned inside out. Mesh anew"
        )


def warn_of_damage(fem: FEModel, *, meshed: bool = False) -> None:
    """Warn of what looks damaged in a mesh.

    It finds nodes far from all nodes around them, elements much flatter than their neighbours, and mid-side nodes far
    from the middle of their edge. It does not find a node that was moved by less than the size of an element.

    Parameters
    ----------
    fem : FEModel
    meshed : bool
        Whether its mesh was just made of a shape, so that no file can be damaged.

    Warns
    -----
    MeshQualityWarning
        With the number and place of what looks damaged.
    """
    covered = np.count_nonzero(covered_quads(*fem.element_faces))
    if covered:
        warn(
            f"mesh: {covered} quadrilaterals of elements meet two triangles each. Their edges fit, but their "
            "displacements do not, so that stress is wrong around them. Put pyramids between hexahedra and tetrahedra",
            MeshQualityWarning,
        )
    for said, which, points in (
        (
            f"nodes lie {_FAR:g} times as far from the nodes around them as those from each other",
            *_far_nodes(fem),
        ),
        (f"elements have less than {_FLAT:g} of the shape quality of their neighbours", *_flat_cells(fem)),
        (f"elements have a node {_BENT:g} of an edge away from where it is on a straight one", *_bent_cells(fem)),
    ):
        if len(which):
            x, y, z = points[0]
            warn(
                f"mesh: {len(which)} {said}, the first is {which[0]} (counted from 0) at ({x:.4g}, {y:.4g}, {z:.4g}). "
                + (_OF_SHAPE if meshed else _OF_FILE),
                MeshQualityWarning,
            )
            return  # other findings have the same cause


def warn_of_stiff_walls(fem: FEModel, *, meshed: bool) -> None:
    """Warn of walls that the elements make more than 5 % too stiff in bending; see `warn_of_damage`.

    Warns
    -----
    MeshQualityWarning
        With the thickness of the wall and the length of the elements, and how much too stiff linear ones are.
    """
    wall = fem.stiff_wall
    if wall is None:
        return
    ratio, material = wall.element / wall.thickness, wall.material
    if wall.order == 1:
        factor = 1 + material.shear_modulus / material.plane_strain_modulus * ratio**2
        said = f"linear elements make it {factor:.3g} times as stiff in bending as it is, or stiffer"
        advice = "Give order=2, which adds nodes in the middle of edges; or order=1, to take them as they are"
    else:
        said = "quadratic elements longer than 5 thicknesses can make it 5 % too stiff and more where bending varies"
        advice = "Take a smaller maxh, or order=3" if meshed else "Mesh it finer, or with two elements across"
    warn(
        f"mesh: elements are {wall.element:.3g} m long in a wall of {wall.thickness:.3g} m, {ratio:.2g} times as long "
        f"as thick; {said}. {advice}",
        MeshQualityWarning,
    )


def volume_inside(points: Array, facets: Array) -> tuple[float, Array]:
    """Volume inside facets, and its second moments of x, y and z, (3,), by the divergence theorem."""
    x, w = np.polynomial.legendre.leggauss(6)
    volume, moments = 0.0, np.zeros(3)
    for rows, columns in by_shape(facets):
        r, s = (grid.ravel() for grid in np.meshgrid((x + 1) / 2, (x + 1) / 2))
        weight = np.outer(w, w).ravel() / 4
        if len(columns) not in QUADS:  # map the square to the triangle
            weight, s = weight * (1 - r), s * (1 - r)
        values, *derivatives = shape_functions(np.column_stack([r, s]), len(columns)).swapaxes(0, 1)
        nodes = points[facets[rows][:, columns]]
        position = values @ nodes  # (facets, points, 3)
        flux = weight[:, None] * np.cross(*(derivative @ nodes for derivative in derivatives)) * position
        volume += float(flux.sum() / 3)
        moments += (position * position * flux).sum(axis=(0, 1)) / 3
    return volume, moments


def _far_nodes(fem: FEModel) -> tuple[Array, Array]:
    """Corner nodes much farther from all neighbours than these are from each other, and their points."""
    nearest, opposite = np.full(fem.n_nodes, np.inf), np.zeros(fem.n_nodes)
    for kind, rows in kinds_of(fem.cells, fem.hexahedra):
        cells = fem.cells[rows][:, kind.columns]
        ends = cells[:, kind.edges]  # (ne, edges, 2)
        length = np.linalg.norm(fem.points[ends[:, :, 1]] - fem.points[ends[:, :, 0]], axis=2)
        np.minimum.at(nearest, ends, length[:, :, None])
        for corner in range(kind.corners):
            without = length[:, (kind.edges != corner).all(axis=1)].max(axis=1)
            np.maximum.at(opposite, cells[:, corner], without)
    far = np.flatnonzero(np.isfinite(nearest) & (nearest > _FAR * opposite))
    return far, fem.points[far]


def _flat_cells(fem: FEModel) -> tuple[Array, Array]:
    """Elements much flatter than their neighbours, and their centres; measured by volume over the cube of the size."""
    corners = fem.points[fem.cells[:, : 8 if fem.hexahedra else 4]]
    extent = np.linalg.norm(np.ptp(corners, axis=1), axis=1)
    quality = fem.cell_volume / extent**3
    number = fem.neighbours
    real = number >= 0
    total = np.bincount(number[real], np.broadcast_to(quality[:, None], number.shape)[real])
    count = np.bincount(number[real])
    others = np.where(real, count[number] - 1, 0).sum(axis=1)
    around = np.where(real, total[number], 0.0).sum(axis=1)
    mean = (around - real.sum(axis=1) * quality) / np.maximum(others, 1)
    flat = np.flatnonzero((others > 0) & (quality < _FLAT * mean))
    return flat, corners[flat].mean(axis=1)


def _bent_cells(fem: FEModel) -> tuple[Array, Array]:
    """Elements with a node far from where it would be if its edge were straight, and their centres."""
    if fem.order == 1:
        return np.empty(0, dtype=int), np.empty((0, 3))
    is_bent = np.zeros(len(fem.cells), dtype=bool)
    for kind, rows in kinds_of(fem.cells, fem.hexahedra):
        nodes = fem.points[fem.cells[rows][:, kind.columns]]
        ends, c = nodes[:, kind.edges], kind.corners
        straight = ends.mean(axis=2) if fem.order == 2 else nodes_on_edges(nodes[:, :4], TET_EDGES)
        off = np.linalg.norm(nodes[:, c : c + straight.shape[1]] - straight, axis=2)
        length = np.repeat(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2), fem.order - 1, axis=1)
        is_bent[rows] = (off > _BENT * length).any(axis=1)
    bent = np.flatnonzero(is_bent)
    return bent, fem.points[fem.cells[bent]].mean(axis=1)
