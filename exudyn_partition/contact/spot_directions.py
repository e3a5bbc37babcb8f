"""Tangential directions of a contact at a point, whose forces act on the true surfaces.

The mean place of a kernel lies beneath a curved surface, by s^2 / (5 R). A tangential force there would turn a
ball less than one at its surface. So each side's kernel also carries the couple of that lever, as normal forces, and
the sliding of the kernel includes its turning times the lever.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..algebra.products import dense, joined
from ..fe.model import node_dofs
from ..frames.kinematics import Rows
from ..support.arrays import Array
from .gaps import GapState
from .side import LoadedNodes
from .spot_gaps import SpotGaps
from .stages import Anchor
from .tangential import TangentialRows

_TURN = np.array([[0, 0], [1, 0], [0, 1]])  # from the two tangents to all three directions


class SpotDirections(TangentialRows):
    """The row of a contact at a point with its tangents.

    Parameters
    ----------
    gaps : SpotGaps
    """

    gaps: SpotGaps

    def _couples(self, place: int) -> tuple[Array, Array, Array]:
        """Nodes of one side's kernel, (k,), and its couples under unit tangential forces on the slave.

        These are the shares of the nodes in them, (k, 2), along a vector in space, (3,).
        """
        gaps = self.gaps
        spot, sign = gaps.spot_rows.spots[place], (1.0, -1.0)[place]
        meeting, axes = gaps.spot_stage.meeting, gaps.sides[place].kinematics.frame(gaps.present.coordinates[place])[1]
        kernel, outward = spot.kernel, meeting.outward[place]
        nodes, weights = gaps.stage.shares[place]
        mean = sign * weights[0] @ gaps.makers[place].points[nodes[0]]
        lever = float((meeting.points[place] - mean) @ outward)
        turned = self.tangents[0] @ axes
        return kernel.nodes, -sign * lever * (kernel.slopes @ turned.T), axes @ outward

    def _rows_on_coordinates(self, index: Array | None = None) -> Rows:
        """See `TangentialRows`."""
        rows = super()._rows_on_coordinates(index)
        if index is not None and not len(index):
            return rows
        return np.asarray(dense(rows) + _TURN @ dense(self._turning()))

    def _turning(self) -> Rows:
        """Part of the tangential rows that is the turning of the kernels times their levers, (2, n)."""
        parts = []
        for place, (side, q) in enumerate(zip(self.gaps.stage.rows.sides, self.gaps.present.coordinates, strict=True)):
            nodes, shares, along = self._couples(place)
            values = shares.T[:, :, None] * along
            columns = np.tile(node_dofs(nodes), (2, 1))
            ends = np.arange(3) * columns.shape[1]
            shape = 2, 3 * len(side.surface.points)
            parts.append(side.on_coordinates(q, sp.csr_matrix((values.ravel(), columns.ravel(), ends), shape=shape)))
        return joined(parts)

    def way(self) -> Array:
        """See `TangentialRows`."""
        way, gaps = super().way(), self.gaps
        if self._from is None or not gaps.moving:
            return way
        return np.asarray(way + dense(self._turning()) @ gaps.sides.way(self._from.q, gaps.present.q))

    def _carried(self, offsets: Array, then: Anchor | GapState) -> Array:
        """See `TangentialRows`; two bodies have their levers, and a rigid surface moves at the point of contact."""
        if not self.gaps.carried:
            return offsets
        lever = self._lever()
        return super()._carried(offsets + lever, then) - lever

    def _some_side_rows(self, place: int, index: Array) -> tuple[LoadedNodes, Array]:
        """See `TangentialRows`."""
        loaded, rows = super()._some_side_rows(place, index)
        if not len(index):
            return loaded, rows
        nodes, shares, along = self._couples(place)
        side, q = self.gaps.sides[place], self.gaps.present.coordinates[place]
        values = shares.T[:, :, None] * side.kinematics.in_frame(q, along[None])[0]
        rows[1:, node_dofs(loaded.column[nodes])] += values.reshape(2, -1)
        return loaded, rows

    def nodal_forces(self, lam: Array) -> list[Array]:
        """See `TangentialRows`; forces on the master act on its true surface, so that there is no couple between."""
        on_nodes = self.gaps.stage.on_nodes(self.at_points(lam))
        for place, forces in enumerate(on_nodes):
            nodes, shares, along = self._couples(place)
            forces[nodes] += np.outer(shares @ lam[0, 1:], along)
        for forces, (nodes, more) in zip(on_nodes, self.gaps.spot_stage.pushed(float(lam[0, 0])), strict=False):
            forces[nodes] += more
        return on_nodes

    def moment(self, forces: Array, point: Array) -> Array:
        """See `TangentialRows`."""
        couple = np.cross(self._lever(), self.in_space(forces[:, 1:])[0])
        pushed = self.gaps.spot_stage.push_moment(float(forces[0, 0]), point - self.gaps.centre)
        return np.asarray(super().moment(forces, point) + couple + pushed)

    def _lever(self) -> Array:
        """From the mean place of the slave's kernel to its true surface, in space, (3,) [m]."""
        gaps = self.gaps
        axes = gaps.sides[0].kinematics.frame(gaps.present.coordinates[0])[1]
        nodes, weights = gaps.stage.shares[0]
        return np.asarray(axes @ (gaps.spot_stage.meeting.points[0] - weights[0] @ gaps.makers[0].points[nodes[0]]))

    def carrier_rows(self, index: Array) -> Array:
        """See `TangentialRows`."""
        rows = super().carrier_rows(index)
        if len(index):
            rows[1:, 3:] -= np.cross(self._lever(), self.tangents[0])
        return rows
