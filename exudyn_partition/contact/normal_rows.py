"""Rows of a contact without friction, whose normals are their only directions; `tangential` has those with friction."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..frames.kinematics import Rows
from ..support.arrays import Array
from .gaps import Gaps
from .stages import Standing


class NormalRows:
    """The present rows of a contact with their normals, see `law.RowDirections`.

    Parameters
    ----------
    gaps : Gaps
    """

    d = 1

    def __init__(self, gaps: Gaps) -> None:
        self.gaps = gaps

    def fresh(self, gaps: Gaps) -> NormalRows:
        """Return the rows for another run; `gaps` are the same gaps in their start state."""
        return NormalRows(gaps)

    def jacobian(self, index: Array) -> Rows:
        """Derivative of the gaps of some rows with respect to the coordinates, (na, n), for fixed pairs."""
        return self.gaps.jacobian(index)

    def carrier_rows(self, index: Array) -> Array:
        """Derivative of gap rates with respect to the velocities of the surface's carrier, (na, 6)."""
        return self.gaps.carrier_rows(index)

    def rates(self, q_t: Array) -> Array:
        """See `rates_of`."""
        return rates_of(self, q_t)

    def flexibility(self, index: Array) -> Array:
        """Residual flexibility of some rows, (na, na) [m/N]."""
        return self.gaps.flexibility(index)

    def pushing(self, index: Array) -> Array:
        """See `law.RowDirections`."""
        return self.gaps.pushing(index)

    def side_rows(self, side: int) -> Rows:
        """Present rows on the flexibility coordinates of one side's patch, (nr, d np)."""
        return self.gaps.side_rows(side)

    def side_flexibility(self, place: int) -> Array:
        """See `Gaps.side_flexibility`."""
        return self.gaps.side_flexibility(place)

    def across(self) -> Array:
        """See `Gaps.across`."""
        return self.gaps.across()

    def standing(self) -> Standing:
        """Where the rows stand."""
        return self.gaps.standing()

    def directions(self, index: Array) -> Array:
        """Numbers of the directions of some rows, (na,)."""
        return index

    def tractions(self, forces: Array) -> Array:
        """Tangential forces in space, (nr, 3) [N], from forces on rows, (nr, 1) [N]: zero."""
        return np.zeros((len(forces), 3))

    def acted(self, forces: Array) -> tuple[Array, Array]:
        """See `Gaps.acted`; forces on the present rows are (nr, 1) [N]."""
        return self.gaps.acted(forces[:, 0])

    def nodal_forces(self, forces: Array) -> list[Array]:
        """Forces on the nodes of the patches, (np, 3) for each side [N], from forces on the rows, (nr, 1) [N]."""
        return self.gaps.nodal_forces(forces[:, 0])

    def moment(self, forces: Array, point: Array) -> Array:
        """Moment on the slave about a point in space, (3,) [N m], from forces on the rows, (nr, 1) [N]."""
        return self.gaps.moment(forces[:, 0], point)


def rates_of(rows: Any, q_t: Array) -> Array:
    """Rates of `NormalRows` or `TangentialRows`, (nr, d) [m/s], at velocities q_t, (n,), for fixed pairs."""
    everything = np.arange(len(rows.gaps.row_nodes))
    rates = rows.jacobian(everything) @ q_t
    if rows.gaps.carried:
        rates = rates + rows.carrier_rows(everything) @ rows.gaps.carrier_motion
    return np.asarray(rates).reshape(-1, rows.d)
