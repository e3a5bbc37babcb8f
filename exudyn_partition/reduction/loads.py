"""Loads of a scene on the FE model: on the nodes of contact patches, resultants of interfaces, distributed loads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..fe.facets import nodal_area
from ..fe.model import FEModel, node_dofs
from ..fe.partition import Partition
from ..fe.patches import Interface, LoadPattern, Patch
from ..support.arrays import Array
from .inertia import PAIRS

_FEWEST = 8  # load patterns on a patch over which contact wanders, in each direction
_MIXED = 32  # loads to which the cells of all such patches are mixed, if they are more than twice as many
_CELL = 1 / 8  # radius of the cell of a pattern, by the shortest wave at the truncation frequency


def pressure(fem: FEModel, patch: Patch) -> Array:
    """(3n,) load of a unit resultant, a uniform pressure on a contact patch along its direction.

    Raises
    ------
    InputError
        If contact wanders over the patch: its pressure is never uniform.
    """
    if patch.wanders:
        raise InputError(
            f"patch: contact wanders over patch {patch.name!r}, so that a uniform pressure on all of it means nothing; "
            "take StaticAnswer(fem, body) with the forces of the nodes, or results with fem="
        )
    share = nodal_area(fem.points, patch.facets)
    return np.outer(share / share.sum(), patch.direction).ravel()


def patch_rows(fem: FEModel, partition: Partition) -> sp.csr_matrix:
    """(r, 3n) rows G: displacements of the patches' nodes, patch after patch, node after node, in its directions."""
    rows = [sp.csr_matrix((0, fem.n_dofs))]
    for patch in partition.patches:
        dofs = node_dofs(patch.nodes)
        # A row has one entry, or the three of a normal.
        each, values = (3, patch.node_normals.ravel()) if patch.axes == "normal" else (1, np.ones(len(dofs)))
        starts = np.arange(0, len(dofs) + 1, each)
        rows.append(sp.csr_matrix((values, dofs, starts), shape=(len(starts) - 1, fem.n_dofs)))
    return sp.vstack(rows, format="csr")


def patch_slice(partition: Partition, patch: int) -> slice:
    """Rows of one patch among those of `patch_rows`."""
    sizes = [len(p.nodes) * p.n_axes for p in partition.patches]
    return slice(sum(sizes[:patch]), sum(sizes[: patch + 1]))


def interface_loads(fem: FEModel, interfaces: Sequence[Interface]) -> sp.csr_matrix:
    """(6 i, 3n) rows: mean translations and rotations of interfaces; transposed, their loads."""
    rows = [sp.csr_matrix((0, fem.n_dofs))]
    for interface in interfaces:
        dofs = node_dofs(interface.nodes)
        columns = np.tile(dofs, 6)
        where = (np.repeat(np.arange(6), len(dofs)), columns)
        rows.append(sp.csr_matrix((interface.motion.ravel(), where), shape=(6, fem.n_dofs)))
    return sp.vstack(rows, format="csr")


def attached_loads(fem: FEModel, interfaces: Sequence[Interface], patterns: Sequence[LoadPattern]) -> sp.csr_matrix:
    """(6 i + l, 3n) rows of loads whose static answers become shapes: of interfaces, and of distributed loads.

    Distributed loads are scaled such that the sizes of their nodal forces add up to one.
    """
    rows = [interface_loads(fem, interfaces)]
    for pattern in patterns:
        values = (pattern.forces / np.linalg.norm(pattern.forces, axis=1).sum()).ravel()
        dofs = node_dofs(pattern.nodes)
        rows.append(sp.csr_matrix((values, dofs, [0, len(dofs)]), shape=(1, fem.n_dofs)))
    return sp.vstack(rows, format="csr")


def unit_loads(fem: FEModel, partition: Partition) -> sp.csr_matrix:
    """(r + 6 i + l, 3n) rows of all loads of the scene: of the patches' nodes, interfaces, and distributed loads."""
    attached = attached_loads(fem, partition.interfaces, partition.loads)
    return sp.vstack([patch_rows(fem, partition), attached], format="csr")


def centrifugal_accelerations(fem: FEModel) -> Array:
    """Accelerations, (3n, 6) [m], by products of angular velocities about the centre of mass, in order of `PAIRS`."""
    arms = fem.points - fem.centre_of_mass
    fields = np.zeros((6, fem.n_nodes, 3))
    for field, (a, b) in zip(fields, PAIRS, strict=True):
        field[:, a] -= arms[:, b]
        field[:, b] -= arms[:, a] if a != b else 0.0
        field += arms if a == b else 0.0
    return fields.reshape(6, -1).T


def resultants(fem: FEModel, partition: Partition, f_cut: float = 0.0) -> sp.csc_matrix:
    """(r + 6 i + l, p) sparse combinations of `unit_loads` with unit resultants.

    These are uniform tractions on each patch, each resultant of interfaces, and each distributed load. A patch with all
    axes, as friction needs them, is also twisted about its direction: by tractions that grow with the distance from its
    middle.

    Over a patch of `Partition.surface` contact wanders. It is divided into cells, each with uniform tractions, so that
    the basis answers forces anywhere on it. No node is further from the middle of its cell than an eighth of the
    shortest wave at `f_cut` [Hz], and there are at least eight cells.
    """
    blocks = [sp.csc_matrix((0, 0))]
    for patch in partition.patches:
        share = nodal_area(fem.points, patch.facets)[patch.nodes]
        if patch.wanders:
            blocks.append(sp.kron(_cells(fem, patch, share, f_cut), sp.identity(patch.n_axes)))
            continue
        uniform = np.kron((share / share.sum())[:, None], np.eye(patch.n_axes))
        blocks.append(uniform if patch.axes == "normal" else np.hstack([uniform, _twist(fem, patch, share)]))
    attached = sp.identity(6 * len(partition.interfaces) + len(partition.loads))
    return sp.block_diag([*blocks, attached], format="csc")


def leading(partition: Partition, resultants: sp.csc_matrix) -> sp.csc_matrix:
    """(p, k) combinations of the loads of `resultants` that lead a Krylov space: these loads if they are few.

    Many cells of patches over which contact wanders are mixed at random to few loads, which excite the same modes: a
    space of all cells would have several vectors for each, but far fewer modes are found.
    """
    rows = [np.full(len(patch.nodes) * patch.n_axes, patch.wanders, dtype=float) for patch in partition.patches]
    wanders = np.concatenate([np.empty(0), *rows])
    cells = abs(resultants[: len(wanders)]).T @ wanders > 0
    n_cells = int(cells.sum())
    if n_cells <= 2 * _MIXED:
        return sp.identity(resultants.shape[1], format="csc")
    mix = np.zeros((len(cells), _MIXED))
    mix[cells] = np.random.default_rng(0).choice([-1.0, 1.0], (n_cells, _MIXED)) / np.sqrt(n_cells)
    return sp.hstack([mix, sp.identity(len(cells), format="csc")[:, ~cells]], format="csc")


def _cells(fem: FEModel, patch: Patch, share: Array, f_cut: float) -> sp.csc_matrix:
    """(np, m) shares of a patch's nodes in the uniform pressures on cells; `share`, (np,), are areas of its nodes.

    Each new middle is the node furthest from all others, so that cells are about equally wide.
    """
    points, widest = fem.points[patch.nodes], _CELL * _shortest_wave(fem, f_cut)
    loaded = np.flatnonzero(share > 0)
    first = int(share.argmax())
    cell, distance = np.zeros(len(points), dtype=np.int64), np.linalg.norm(points - points[first], axis=1)
    count = 1
    while count < len(loaded) and (count < _FEWEST or distance.max() > widest):
        away = np.linalg.norm(points - points[loaded[distance[loaded].argmax()]], axis=1)
        nearer = away < distance
        if not nearer.any():
            break
        cell[nearer], distance[nearer] = count, away[nearer]
        count += 1
    values = share / np.bincount(cell, share, count)[cell]
    return sp.csc_matrix((values, (np.arange(len(points)), cell)), (len(points), count))


def _shortest_wave(fem: FEModel, frequency: float) -> float:
    """Length [m] of a shear wave at a frequency [Hz], or of a bending wave in a thin wall if that is shorter."""
    if frequency == 0.0:
        return np.inf
    material, wall = fem.material, fem.weakest_wall
    plate = material.bar_wave_speed * wall.thickness / np.sqrt(12 * (1 - material.nu**2))  # sqrt(D / rho t) of a plate
    return float(min(material.shear_wave_speed / frequency, np.sqrt(2 * np.pi * plate / frequency)))


def _twist(fem: FEModel, patch: Patch, share: Array) -> Array:
    """(3 np, 1) tractions of a unit moment about a patch's direction; `share`, (np,), are areas of its nodes."""
    points = fem.points[patch.nodes]
    ways = np.cross(patch.direction, points - share @ points / share.sum())
    tractions = share[:, None] * ways
    value: Array = (tractions / np.sum(tractions * ways)).reshape(-1, 1)
    return value
