"""Forces on the rows of a contact after the last accepted step, and with friction their slip, as one value."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..algebra.coulomb import Coulomb, coefficients
from ..algebra.friction import OPEN, SLIP, STICK
from ..support.arrays import Array
from .normal_rows import NormalRows
from .tangential import TangentialRows


@dataclass(frozen=True, eq=False)
class RowMemory:
    """Forces on rows, and their slip, at the end of the last accepted step.

    They are stored for the slave's nodes, because rows appear and vanish.

    Parameters
    ----------
    forces : (np, 4) array
        Normal forces, and tangential forces as vectors in axes that turn with the master [N]. Without friction, (np, 1)
        with normal forces.
    slipped : (np,) bool array
        Whether the row of each node slipped.
    speed : (np,) array
        Their slip speed [m/s].
    path : (np,) array
        Path that each row has slipped so far [m].
    dissipated : float
        Energy that friction has dissipated so far [J].
    """

    forces: Array
    slipped: Array
    speed: Array
    path: Array
    dissipated: float = 0.0

    @classmethod
    def none(cls, n: int, columns: int = 4) -> RowMemory:
        """Return the memory of n nodes at the start of a run; `columns` are those of `forces`."""
        return cls(np.zeros((n, columns)), np.zeros(n, dtype=bool), np.zeros(n), np.zeros(n))

    @cached_property
    def closed(self) -> bool:
        """Whether any row was closed."""
        return bool(self.forces[:, 0].any())

    @cached_property
    def status(self) -> Array:
        """Whether each row was open, stuck or slipped, (np,) int8; closed rows without friction slip."""
        frictional = self.forces.shape[1] > 1
        status = np.where(self.slipped, np.int8(SLIP), np.int8(STICK if frictional else SLIP))
        status[self.forces[:, 0] == 0.0] = OPEN
        return status

    def after(
        self,
        rows: TangentialRows,
        lam: Array,
        traction: Array,
        status: Array,
        slips: Array,
        speeds: Array,
        taken: float,
    ) -> RowMemory:
        """Return the memory after the next step.

        Parameters
        ----------
        rows : TangentialRows
        lam, traction, status : (nr,), (nr, 3), (nr,) arrays
            Normal forces, tangential forces in space [N], and status at the end of the step.
        slips : (nr, 2) array
            How far the rows have slipped in the step [m].
        speeds : (nr,) array
            Slip speed of the rows at the end of the step [m/s].
        taken : float
            Energy that friction dissipated in the step [J].
        """
        nodes, slides, n = rows.gaps.row_nodes, status == SLIP, len(self.path)
        slipped, speed, path = np.zeros(n, dtype=bool), np.zeros(n), self.path
        if slides.any():
            path = path.copy()
            path[nodes[slides]] += np.hypot(*slips[slides].T)
        slipped[nodes] = slides
        speed[nodes] = np.where(slides, speeds, 0.0)
        return RowMemory(by_nodes(rows, lam, traction, n), slipped, speed, path, self.dissipated + taken)

    def with_forces(self, forces: Array) -> RowMemory:
        """Return the memory with other forces at the nodes, as `forces` [N]."""
        return RowMemory(forces, self.slipped, self.speed, self.path, self.dissipated)

    def coefficients(self, friction: Coulomb, nodes: Array) -> Array:
        """Coefficients of friction of some nodes' rows in the next step, (k,)."""
        return coefficients(friction, self.slipped[nodes], self.speed[nodes])


def by_nodes(rows: TangentialRows, lam: Array, traction: Array, n: int) -> Array:
    """Forces stored for the n nodes of the slave's patch, (n, 4) [N], from forces on the present rows.

    These are normal forces lam, (nr,), and tangential forces in space, (nr, 3) [N].
    """
    stored, of_rows = np.zeros((n, 4)), np.empty((len(lam), 4))
    of_rows[:, 0], of_rows[:, 1:] = lam, traction @ rows.axes
    stored[rows.gaps.row_nodes] = of_rows
    return stored


def normal_by_nodes(nodes: Array, on_rows: Array, n: int) -> Array:
    """Normal forces stored for n nodes, (n, 1) [N], from those on the rows of some nodes, (nr, 1) [N] and (nr,)."""
    stored = np.zeros((n, 1))
    stored[nodes] = on_rows
    return stored


def on_rows(rows: NormalRows | TangentialRows, remembered: Array) -> Array:
    """Forces on the present rows, (nr, d) [N], from those stored for the slave's nodes, (np, 4) or (np, 1) [N]."""
    stored: Array = remembered[rows.gaps.row_nodes]
    if not isinstance(rows, TangentialRows):
        return stored
    forces = np.empty((len(stored), 3))
    forces[:, 0], forces[:, 1:] = stored[:, 0], rows.along(stored[:, 1:] @ rows.axes.T)
    return forces
