"""Forces on the rows of a contact, and what follows from them where the rows were then, as one value."""

from __future__ import annotations

import numpy as np

from ..algebra.coulomb import Coulomb
from ..algebra.friction import OPEN, SLIP
from ..support.arrays import Array
from ..support.attributes import FoundOnce
from .law import Forces
from .memory import RowMemory, by_nodes, normal_by_nodes, on_rows
from .normal_rows import NormalRows
from .tangential import TangentialRows

_NONE = np.empty(0, dtype=np.int64)


class RowForces:
    """Forces on the present rows of a contact. They do not change.

    What follows from them is found when somebody asks. The rows then go back to the place that belongs to these forces,
    if others have moved them since.

    Parameters
    ----------
    rows : NormalRows or TangentialRows
    forces : Forces

    Attributes
    ----------
    on_rows : (nr, d) array
        Forces on the rows [N].
    index : (na,) int array
        Rows that are closed.
    """

    def __init__(self, rows: NormalRows | TangentialRows, forces: Forces) -> None:
        self.rows, self.forces, self._present = rows, forces, rows.gaps.present
        self.on_rows, self.index = forces.on_rows, forces.closed

    def _there(self) -> NormalRows | TangentialRows:
        """The rows, at the place of these forces."""
        gaps = self.rows.gaps
        if gaps.present != self._present:
            gaps.return_to(self._present)
        return self.rows

    @property
    def lam(self) -> Array:
        """Normal forces, (nr,) [N]."""
        value: Array = self.on_rows[:, 0]
        return value

    @FoundOnce
    def status(self) -> Array:
        """Whether each row is open, sticks or slips, (nr,) int8; closed rows without friction slip."""
        if self.forces.state is not None:
            return self.forces.state
        status = np.full(len(self.on_rows), OPEN, dtype=np.int8)
        status[self.index] = SLIP
        return status

    @FoundOnce
    def traction(self) -> Array:
        """Tangential forces in space, (nr, 3) [N]; zero without friction."""
        return self._there().tractions(self.on_rows)

    @property
    def row_nodes(self) -> Array:
        """Node of the slave's patch for each row, (nr,)."""
        return self._present.stage.rows.row_nodes

    @FoundOnce
    def _acted(self) -> tuple[Array, Array]:
        """Generalised forces, (n,), by the rows, and the sum of their normal forces, (3,) [N]."""
        return self._there().acted(self.on_rows) if self.index.size else (np.zeros(self.rows.gaps.n), np.zeros(3))

    @property
    def by_rows(self) -> Array:
        """Generalised forces, (n,), by the rows."""
        return self._acted[0]

    def resultant(self) -> Array:
        """Force on the slave, (3,) [N]."""
        return self._resultant.copy()

    @FoundOnce
    def _resultant(self) -> Array:
        if not self.index.size:
            return np.zeros(3)
        acted = vars(self).get("_acted")  # most contacts need both, and one loop finds them
        along = self._present.stage.resultant(self.lam) if acted is None else acted[1]
        return along if self.rows.d == 1 else along + self.traction.sum(axis=0)

    def moment(self, point: Array) -> Array:
        """Moment on the slave about a point in space, (3,) [N m]."""
        return self._there().moment(self.on_rows, point) if self.index.size else np.zeros(3)

    def on_carrier(self, point: Array) -> Array:
        """Force on the body that carries the rigid surface, and moment about a point in space, (6,) [N, N m]."""
        return -np.concatenate([self.resultant(), self.moment(point)])

    def nodal_forces(self) -> list[Array]:
        """Forces on the nodes of the patches, in axes of space, (np, 3) for each side [N]."""
        return self._there().nodal_forces(self.on_rows)

    def impulse(self, step: float) -> Array:
        """Impulses in a step [s], (7,) [N s]: of normal forces, sum and vector on the slave, and of tangential forces.

        The vector on the slave includes tangential forces.
        """
        impulse = np.zeros(7)
        if self.index.size:
            impulse[0], impulse[1:4] = self.lam.sum(), self.resultant()
            if self.rows.d > 1:
                impulse[4:] = self.traction.sum(axis=0)
            impulse *= step
        return impulse

    def memory_after(self, memory: RowMemory, slips: Array, speeds: Array, taken: float) -> RowMemory:
        """What rows remember after a step that ends with these forces.

        `memory` is that of its start. For slips, speeds and energy taken, which are of no use without friction, see
        `RowMemory.after`.
        """
        rows = self._there()
        if isinstance(rows, TangentialRows):
            return memory.after(rows, self.lam, self.traction, self.status, slips, speeds, taken)
        return with_forces(memory, rows.gaps.row_nodes, self.on_rows)

    def at_nodes(self, n: int) -> Array:
        """Forces stored for the n nodes of the slave's patch, as in `RowMemory`."""
        rows = self._there()
        if isinstance(rows, TangentialRows):
            return by_nodes(rows, self.lam, self.traction, n)
        return normal_by_nodes(self.row_nodes, self.on_rows, n)


def with_forces(memory: RowMemory, nodes: Array, on_rows: Array) -> RowMemory:
    """What rows without friction remember, with other forces, (nr, 1) [N], on rows of some nodes, (nr,)."""
    return memory.with_forces(normal_by_nodes(nodes, on_rows, len(memory.path)))


def no_forces(d: int, n: int) -> Forces:
    """Forces on n open rows in d directions."""
    return Forces(np.zeros((n, d)), _NONE)


def no_memory(rows: NormalRows | TangentialRows) -> RowMemory:
    """What rows remember at the start of a run."""
    return RowMemory.none(len(rows.gaps.slave.surface.points), 4 if rows.d > 1 else 1)


def friction_before(
    rows: NormalRows | TangentialRows, friction: Coulomb | None, memory: RowMemory
) -> tuple[Array, Array]:
    """What friction in a step depends on: remembered forces, (nr, 3) [N], and coefficients, (nr,); else zeros."""
    nodes = rows.gaps.row_nodes
    if friction is None:
        return np.zeros((len(nodes), 3)), np.zeros(len(nodes))
    return on_rows(rows, memory.forces), memory.coefficients(friction, nodes)
