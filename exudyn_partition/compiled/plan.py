"""What an explicit run of bodies and contacts needs, as one frozen value of arrays.

Bodies are linear, with diagonal mass. The pairs of contacts are frozen, so that gaps are linear in the coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ..algebra.block_complementarity import BlockComplementarity, FlatBlocks
from ..algebra.complementarity import Complementarity
from ..contact.linear_gaps import FlatRows
from ..support.arrays import Array


class FlatBodies(NamedTuple):
    """Matrices of all bodies in flat arrays, as compiled loops take them. Stiffness K and damping D are csr.

    Parameters
    ----------
    mass : (nq,) array
        Diagonal of the mass matrix.
    starts, columns, values : arrays
        K.
    damping_starts, damping_columns, damping_values : arrays
        D.
    load : (nq,) array
        Generalised forces that do not change.
    """

    mass: Array
    starts: Array
    columns: Array
    values: Array
    damping_starts: Array
    damping_columns: Array
    damping_values: Array
    load: Array


@dataclass(frozen=True, eq=False)
class GroupPlan:
    """Contacts whose forces are found together, see `formulations.coupled.CoupledContacts`.

    Parameters
    ----------
    names : tuple of str
        Of the contacts.
    rows : FlatRows
        Gaps of all rows. Numbers of coordinates are those of the plan.
    own, fields : tuples of arrays
        Flexibility of each contact's rows, (nr, nr) [m/N], and their displacements in common fields, (nr, m).
    core : dict of (int, int) to (m, m) array
        What contacts exchange, see `BlockComplementarity`.
    """

    names: tuple[str, ...]
    rows: FlatRows
    own: tuple[Array, ...]
    fields: tuple[Array, ...]
    core: Mapping[tuple[int, int], Array]

    @cached_property
    def joint(self) -> BlockComplementarity:
        """Solver of the forces by NumPy; `fresh_blocks` is what compiled loops take."""
        return BlockComplementarity(len(self.names), self.core)

    @cached_property
    def _blocks(self) -> FlatBlocks:
        return self.joint.flat(self.own, self.fields)

    @cached_property
    def problems(self) -> tuple[Complementarity, ...]:
        """Problem of each contact's own rows, by NumPy."""
        return tuple(map(Complementarity, self.own))

    def fresh_blocks(self) -> FlatBlocks:
        """The problem in flat arrays, with room of its own for what changes in a run; matrices are shared."""
        blocks = self._blocks
        working = "active", "closed", "n_closed", "factors", "responses", "G", "amplitudes", "lam", "pushed"
        changing = {name: getattr(blocks, name).copy() for name in (*working, "iterations")}
        return blocks._replace(**changing)


@dataclass(frozen=True, eq=False)
class StepPlan:
    """Bodies, contacts and loads of an explicit run.

    Parameters
    ----------
    mass : (nq,) array
        Diagonal of the mass matrix.
    stiffness, damping : (nq, nq) csr matrices
    load : (nq,) array
        Generalised forces that do not change.
    groups : tuple of GroupPlan
    """

    mass: Array
    stiffness: sp.csr_matrix
    damping: sp.csr_matrix
    load: Array
    groups: tuple[GroupPlan, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all contacts, group by group."""
        return tuple(name for group in self.groups for name in group.names)

    @property
    def n_rows(self) -> int:
        """Number of rows of all contacts."""
        return sum(len(group.rows.start) for group in self.groups)

    @cached_property
    def flat(self) -> FlatBodies:
        """The bodies in flat arrays."""
        K, D = (sp.csr_matrix(matrix) for matrix in (self.stiffness, self.damping))
        index = [part.astype(np.int64) for part in (K.indptr, K.indices, D.indptr, D.indices)]
        return FlatBodies(self.mass, index[0], index[1], K.data, index[2], index[3], D.data, self.load)

    def with_flexibility(self, own: Sequence[Sequence[Array]]) -> StepPlan:
        """Return the plan with other flexibilities of the rows of each group's contacts, (nr, nr) [m/N]."""
        both = zip(self.groups, own, strict=True)
        return replace(self, groups=tuple(replace(group, own=tuple(parts)) for group, parts in both))
