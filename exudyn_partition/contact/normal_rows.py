"""Rows of a contact without friction, whose normals are their only directions; `tangential` has those with friction."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..algebra.complementarity import Complementarity, regularised
from ..frames.kinematics import Rows
from ..support.arrays import Array
from ..surfaces.rows import directed_matrix, point_matrix
from .anchoring import SAME
from .gaps import Gaps
from .row_flexibility import RowFlexibility, through
from .side import LoadedNodes
from .stages import OF_SIDE, Standing


class NormalRows:
    """The present rows of a contact with their normals, see `law.RowDirections`.

    Parameters
    ----------
    gaps : Gaps
    """

    d = 1

    def __init__(self, gaps: Gaps) -> None:
        self.gaps = gaps

    def jacobian(self, index: Array) -> Rows:
        """Derivative of the gaps of some rows with respect to the coordinates, (na, n), for fixed pairs."""
        return self.gaps.jacobian(index)

    def carrier_rows(self, index: Array) -> Array:
        """Derivative of gap rates with respect to the velocities of the surface's carrier, (na, 6)."""
        gaps = self.gaps
        return gaps.carrier.rows(gaps.stage, gaps.present.places[0])[index]

    def rates(self, q_t: Array) -> Array:
        """See `rates_of`."""
        return rates_of(self, q_t)

    # Residual flexibility. That of rows that move is found at the anchor of the gaps, and kept while they move little.

    def flexibility(self, index: Array) -> Array:
        """Residual flexibility between some present rows, (na, na) [m/N]; for the same rows, the same array."""
        return self.row_flexibility(index).between(index)

    def pushing(self, index: Array) -> Array:
        """Motion of all present rows by unit forces on some, (nr, na) [m/N]; not if `Gaps.on_demand`."""
        return self.row_flexibility(index).pushing(index)

    def row_flexibility(self, index: Array) -> RowFlexibility:
        """Flexibility that knows these rows: of all present rows, or of these alone if it is found on demand."""
        gaps = self.gaps
        if gaps.sides.on_demand:
            return gaps.anchoring.kept("flexibility", SAME, lambda: self._of_some_rows(index), index)
        return gaps.anchoring.kept("flexibility", SAME, self._of_all_rows)

    def _of_some_rows(self, index: Array) -> RowFlexibility:
        gaps, F = self.gaps, np.zeros((len(index),) * 2)
        for place, (side, share) in enumerate(zip(gaps.sides, gaps.yielding_shares, strict=True)):
            if side.flexibility is not None:
                F += share * self._part_of_rows(place, index)
        if gaps.between is not None:
            pushed, pushing = (self.side_rows(place)[index] for place in (0, 1))
            across = through(pushed, gaps.between, pushing)
            F += gaps.yielding_shares[0] * (across + across.T)
        return RowFlexibility(F, index)

    def _part_of_rows(self, place: int, index: Array) -> Array:
        """Contribution of one side to the flexibility of some rows, (na, na) [m/N]; only their nodes are asked for."""
        gaps, stage = self.gaps, self.gaps.stage
        points, numbers = stage.rows.points.of_rows(index)
        nodes, weights = (values[numbers] for values in stage.shares[place])
        loaded = LoadedNodes.of(gaps.sides[place], nodes)
        return loaded.flexibility(gaps.present.coordinates[place], points, (nodes, weights), stage.normals[numbers])

    def _of_all_rows(self) -> RowFlexibility:
        return RowFlexibility(self.gaps.stage.by_pairs("flexibility", self._all_flexibility))

    def _all_flexibility(self) -> Array:
        gaps, n_rows = self.gaps, len(self.gaps.row_nodes)
        F, shares = np.zeros((n_rows, n_rows)), gaps.yielding
        for place, side in enumerate(gaps.sides):
            if side.flexibility is not None:
                F += self._part_of_side(place) if shares is None else shares[place] * self.side_flexibility(place)
        if gaps.between is not None:
            across = self.across()
            F += across + across.T if shares is None else shares[0] * (across + across.T)
        return F

    def side_flexibility(self, place: int) -> Array:
        """Contribution of one side to the flexibility of the present rows, (nr, nr) [m/N], whatever yields of it."""
        return self.gaps.anchoring.kept((OF_SIDE, place), SAME, lambda: self._part_of_side(place))

    def _part_of_side(self, place: int) -> Array:
        gaps, stage = self.gaps, self.gaps.stage
        loaded, q = gaps.anchoring.loaded_nodes(place), gaps.present.coordinates[place]
        return loaded.flexibility(q, stage.rows.points, stage.shares[place], stage.normals)

    def across(self) -> Array:
        """Motion of the slave's rows by forces on the master's, (nr, nr) [m/N], of a body that touches itself."""
        assert self.gaps.between is not None
        return through(self.side_rows(0), self.gaps.between, self.side_rows(1))

    def side_rows(self, side: int) -> Rows:
        """Present rows on the flexibility coordinates of one side's patch, (nr, d np)."""
        gaps, stage, patch = self.gaps, self.gaps.stage, self.gaps.sides[side]
        (nodes, weights), n = stage.shares[side], len(patch.surface.points)
        if patch.normal_only:
            rows = point_matrix(nodes, weights if side else -weights, n)  # contact pushes towards the inside
        else:
            along = patch.kinematics.in_frame(gaps.present.coordinates[side], stage.normals)
            rows = directed_matrix(nodes, weights, along, n)
        return stage.rows.points.mean @ rows

    def work_of(self, forces: Array) -> float:
        """Work of forces on all present rows, (nr,) [N], on their own answer, lam' F lam [m N]."""
        gaps = self.gaps
        if not gaps.sides.on_demand:
            return float(forces @ self.flexibility(np.arange(len(forces))) @ forces)
        on_sides = [np.asarray(self.side_rows(place).T @ forces).ravel() for place in range(len(gaps.sides))]
        parts = zip(on_sides, gaps.sides, gaps.yielding_shares, strict=True)
        work = sum(share * (f @ (side.flexibility @ f)) for f, side, share in parts if side.flexibility is not None)
        if gaps.between is not None:
            work += 2 * gaps.yielding_shares[0] * (on_sides[0] @ (gaps.between @ on_sides[1]))
        return float(work)

    def problem(self) -> Complementarity:
        """Return the regularised problem of the forces on all present rows. Rows on few points may be redundant.

        Contacts with the same pairs share its matrix, and so do runs in which the same rows stay frozen.

        Raises
        ------
        IndefiniteMatrixError
            If the flexibility of the rows is not positive definite.
        """
        return self.gaps.stage.by_pairs("problem", self._problem).without_guess()

    def _problem(self) -> Complementarity:
        return Complementarity(regularised(self.flexibility(np.arange(len(self.gaps.row_nodes)))))

    def standing(self) -> Standing:
        """Which rows are present, and where their flexibility was found."""
        return Standing(self.gaps.stage.rows, self.gaps.anchoring.anchor(SAME))

    # Directions.

    def directions(self, index: Array) -> Array:
        """Numbers of the directions of some rows, (na,)."""
        return index

    def tractions(self, forces: Array) -> Array:
        """Tangential forces in space, (nr, 3) [N], from forces on rows, (nr, 1) [N]: zero."""
        return np.zeros((len(forces), 3))

    def acted(self, forces: Array) -> tuple[Array, Array]:
        """See `Stage.acted`; forces on the present rows are (nr, 1) [N]."""
        return self.gaps.stage.acted(forces[:, 0], self.gaps.present.q)

    def nodal_forces(self, forces: Array) -> list[Array]:
        """Forces on the nodes of the patches, (np, 3) for each side [N], from forces on the rows, (nr, 1) [N]."""
        return self.gaps.stage.nodal_forces(forces[:, 0])

    def moment(self, forces: Array, point: Array) -> Array:
        """Moment on the slave about a point in space, (3,) [N m], from forces on the rows, (nr, 1) [N]."""
        gaps = self.gaps
        return gaps.stage.moment(forces[:, 0], point - gaps.centre, gaps.present.places[0])


def rates_of(rows: Any, q_t: Array) -> Array:
    """Rates of `NormalRows` or `TangentialRows`, (nr, d) [m/s], at velocities q_t, (n,), for fixed pairs."""
    everything = np.arange(len(rows.gaps.row_nodes))
    rates = rows.jacobian(everything) @ q_t
    if rows.gaps.carried:
        rates = rates + rows.carrier_rows(everything) @ rows.gaps.carrier.motion
    return np.asarray(rates).reshape(-1, rows.d)
