"""The FE model with its rigid interfaces tied: their nodes move by six coordinates each (RBE2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..fe.model import FEModel, MassKind, node_dofs
from ..fe.partition import Partition
from ..support.arrays import Array
from ..support.checks import read_only


@dataclass(frozen=True, eq=False)
class TiedModel:
    """Matrices on the coordinates z that rigid interfaces leave, u = T z.

    First come the dofs of all other nodes in their order, then translations and rotations of each rigid interface about
    its position. Without rigid interfaces z is u.

    Parameters
    ----------
    expand : (3n, nz) csr matrix
        T.
    mass, stiffness : (nz, nz) csr matrix
        T' M T [kg] and T' K T [N/m]; moments and rotations in the rows of interfaces.
    rigid_modes : (nz, 6) array
        Unit translations [m] and rotations [rad] of the body about its centre of mass.
    column : (3n,) int array
        Column of each dof of the FE model; -1 if it is tied.
    """

    expand: sp.csr_matrix
    mass: sp.csr_matrix
    stiffness: sp.csr_matrix
    rigid_modes: Array
    column: Array

    def __post_init__(self) -> None:
        read_only(self.rigid_modes, self.column)

    @property
    def n(self) -> int:
        """Number of coordinates z."""
        return int(self.mass.shape[0])

    @property
    def interface_columns(self) -> Array:
        """(6 r,) int array: columns of the r rigid interfaces."""
        return np.arange(np.count_nonzero(self.column >= 0), self.n)


def tie(fem: FEModel, partition: Partition, mass: MassKind = "consistent") -> TiedModel:
    """Tie the rigid interfaces of `partition`.

    Parameters
    ----------
    fem : FEModel
    partition : Partition
    mass : {"consistent", "lumped"}
    """
    M = fem.mass if mass == "consistent" else fem.lumped_mass_matrix
    rigid = [interface for interface in partition.interfaces if interface.kind == "rigid"]
    column = np.ones(fem.n_dofs, dtype=np.int64)
    for interface in rigid:
        column[node_dofs(interface.nodes)] = 0
    kept = np.flatnonzero(column)
    column[:] = -1
    column[kept] = np.arange(len(kept))
    if not rigid:
        return TiedModel(sp.identity(fem.n_dofs, format="csr"), M, fem.stiffness, fem.rigid_modes, column)
    rows, columns, values = [kept], [np.arange(len(kept))], [np.ones(len(kept))]
    modes = [fem.rigid_modes[kept]]
    for i, interface in enumerate(rigid):
        dofs = node_dofs(interface.nodes)
        rows.append(np.repeat(dofs, 6))
        columns.append(np.tile(len(kept) + 6 * i + np.arange(6), len(dofs)))
        values.append(interface.rigid_motion(fem).ravel())
        modes.append(interface.motion @ fem.rigid_modes[dofs])
    T = sp.csr_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
        shape=(fem.n_dofs, len(kept) + 6 * len(rigid)),
    )
    return TiedModel(T, (T.T @ M @ T).tocsr(), (T.T @ fem.stiffness @ T).tocsr(), np.vstack(modes), column)
