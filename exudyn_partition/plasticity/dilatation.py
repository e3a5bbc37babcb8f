"""Elements that do not lock in plastic flow: nearly one dilatation an element (B-bar).

Plastic flow keeps the volume. A quadratic tetrahedron whose volume must stay the same at each of its four integration
points can hardly flow, and a body of such elements is too stiff. With one dilatation an element, the mean one, it can.
A tenth of the stiffness against what differs from the mean is left. Without it nothing would hold some motions of an
element that flows without hardening, and the forces of plastic flow would not settle.

Bending stretches one side of a wall and compresses the other. An element with one dilatation does not feel that: a
plate of one such element across would lose a third of its stiffness, whether it yields or not, and one of n elements
a share of 1 / 3 n^2. So elements that are few across a wall keep their stiffness. They can flow, since a wall changes
its thickness.

References
----------
T. J. R. Hughes, The Finite Element Method, 1987, section 4.5.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ..fe.material import Material
from ..fe.model import FEModel, node_dofs
from ..fe.partition import Partition
from ..support.arrays import Array
from .integration import at_points

_LOCKING = (8, 10)  # nodes of the elements that lock, beside all that are kept as hexahedra
_FEW = 0.3  # of the thickness of a wall: elements that are higher keep their stiffness
LEFT = 0.1  # share of the stiffness that stays; from 0.02 to 0.5 the forces settle


def with_free_zones(fem: FEModel, partition: Partition) -> FEModel:
    """Return the model whose elements do not lock in the partition's plastic zones; itself without zones."""
    zones: dict[Material, list[Array]] = {}
    for patch in partition.patches:
        if patch.plastic is not None:
            zones.setdefault(patch.material or fem.material, []).append(patch.plastic.cells)
    for material, cells in zones.items():
        fem = with_mean_dilatation(fem, np.unique(np.concatenate(cells), axis=0), material)
    return fem


def locks(nodes: int, hexahedra: bool) -> bool:
    """Whether elements of a number of nodes lock in plastic flow.

    Cubic tetrahedra do not, and linear ones have one integration point.
    """
    return hexahedra or nodes in _LOCKING


def freed(fem: FEModel, cells: Array) -> Array:
    """Which of some elements, (c, k) nodes, have nearly one dilatation each if they are in a zone, (c,) bool."""
    if not locks(cells.shape[1], fem.hexahedra):
        return np.zeros(len(cells), dtype=bool)
    return np.asarray(fem.shares_of_walls(cells) < _FEW)


def mean_dilatation(points: Array, cells: Array, hexahedra: bool) -> tuple[Array, Array, Array]:
    """Volumes of the integration points of c elements, their dilatations by nodal displacements, and the mean of these.

    Returns
    -------
    (c, q), (c, q, 3k) and (c, 3k) arrays
        [m3, 1/m, 1/m]
    """
    gradient, volume = at_points(points, cells, hexahedra, exact=True)
    dilatation = gradient.reshape(*volume.shape, -1)
    return volume, dilatation, np.einsum("cq,cqi->ci", volume, dilatation) / volume.sum(axis=1)[:, None]


def with_mean_dilatation(fem: FEModel, cells: Array, material: Material) -> FEModel:
    """Return the model with nearly one dilatation in each of some elements, (c, k) nodes, of a material.

    Elements that do not lock, or are few across a wall, stay as they are.
    """
    k, cells = cells.shape[1], cells[freed(fem, cells)]
    if not len(cells):
        return fem
    volume, dilatation, mean = mean_dilatation(fem.points, cells, fem.hexahedra)
    apart = dilatation - mean[:, None]
    bulk = material.lame + 2 / 3 * material.shear_modulus
    change = (LEFT - 1) * bulk * np.einsum("cq,cqi,cqj->cij", volume, apart, apart, optimize=True)
    dofs = node_dofs(cells.ravel()).reshape(len(cells), 3 * k)
    places = np.repeat(dofs, 3 * k, axis=1).ravel(), np.tile(dofs, (1, 3 * k)).ravel()
    stiffness = fem.stiffness + sp.csr_matrix((change.ravel(), places), shape=fem.stiffness.shape)
    return replace(fem, stiffness=sp.csr_matrix(stiffness))
