"""Loads of a scene on the FE model: on the nodes of contact patches, and resultants of interfaces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ..fe.facets import nodal_area
from ..fe.model import FEModel, node_dofs
from ..fe.partition import Partition
from ..fe.patches import Interface, Patch
from ..support.arrays import Array


def pressure(fem: FEModel, patch: Patch) -> Array:
    """(3n,) load of a unit resultant, a uniform pressure on a contact patch along its direction."""
    share = nodal_area(fem.points, patch.facets)
    return np.outer(share / share.sum(), patch.direction).ravel()


def patch_rows(fem: FEModel, partition: Partition) -> sp.csr_matrix:
    """(r, 3n) rows G: displacements of the patches' nodes, patch after patch, node after node, in its directions."""
    rows = [sp.csr_matrix((0, fem.n_dofs))]
    for patch in partition.patches:
        nodes, directions = patch.nodes, patch.directions
        select = sp.csr_matrix((np.ones(len(nodes)), (np.arange(len(nodes)), nodes)), shape=(len(nodes), fem.n_nodes))
        rows.append(sp.kron(select, directions))
    return sp.vstack(rows, format="csr")


def patch_slice(partition: Partition, patch: int) -> slice:
    """Rows of one patch among those of `patch_rows`."""
    sizes = [len(p.nodes) * len(p.directions) for p in partition.patches]
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


def unit_loads(fem: FEModel, partition: Partition) -> sp.csr_matrix:
    """(r + 6 i, 3n) rows of all loads of the scene: of the patches' nodes, then of the interfaces."""
    return sp.vstack([patch_rows(fem, partition), interface_loads(fem, partition.interfaces)], format="csr")


def resultants(fem: FEModel, partition: Partition) -> Array:
    """(r + 6 i, p) combinations of `unit_loads` with unit resultants.

    These are uniform tractions on each patch, and each resultant of interfaces. A patch with all axes, as friction
    needs them, is also twisted about its direction: by tractions that grow with the distance from its middle.
    """
    blocks = []
    for patch in partition.patches:
        share = nodal_area(fem.points, patch.facets)[patch.nodes]
        uniform = np.kron((share / share.sum())[:, None], np.eye(len(patch.directions)))
        blocks.append(uniform if patch.axes == "normal" else np.hstack([uniform, _twist(fem, patch, share)]))
    resultants: Array = scipy.linalg.block_diag(*blocks, np.eye(6 * len(partition.interfaces)))
    return resultants


def _twist(fem: FEModel, patch: Patch, share: Array) -> Array:
    """(3 np, 1) tractions of a unit moment about a patch's direction; `share`, (np,), are areas of its nodes."""
    points = fem.points[patch.nodes]
    ways = np.cross(patch.direction, points - share @ points / share.sum())
    tractions = share[:, None] * ways
    value: Array = (tractions / np.sum(tractions * ways)).reshape(-1, 1)
    return value
