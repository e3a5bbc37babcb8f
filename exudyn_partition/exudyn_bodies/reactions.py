"""Stiffness by reactions of joints: forces C' lambda change with the coordinates, because rows C turn with bodies.

Exudyn's Jacobians have the rows, but not how they change. A hanging link has no other stiffness against turns, and a
pressed strut in a floating frame misses a share of its load.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from ..support.arrays import Array
from ..support.foreign import ItemEntry, MainSystem, MarkerIndex, ObjectIndex
from ..support.optional import require
from .differences import Differences
from .joints import constraints


class _Joint(NamedTuple):
    """A constraint: its number, rows, (m,), and coordinates, (k,), and its markers on bodies with their coordinates."""

    number: ObjectIndex
    rows: Array
    columns: Array
    markers: list[tuple[MarkerIndex, Array]]


@dataclass(frozen=True, eq=False)
class Reactions:
    """Forces C' lambda of the joints of a model, and their changes with its coordinates.

    Each change takes two calls of Exudyn a coordinate and joint.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        An assembled model.
    joints : list of _Joint
        Its constraints that are switched on.
    differences : Differences
    """

    mbs: MainSystem
    joints: list[_Joint]
    differences: Differences

    @classmethod
    def of(cls, mbs: MainSystem) -> Reactions:
        """Reactions of an assembled model, with the joints that are switched on now."""
        return cls(mbs, [*_joints(mbs)], Differences.of(mbs))

    @property
    def turning(self) -> dict[int, slice]:
        """See `Differences`."""
        return self.differences.turning

    def stiffness(self, multipliers: Array) -> Array:
        """Changes of the forces of constant multipliers, (m,), with all coordinates, (nq, nq)."""
        result = np.zeros((self.differences.n,) * 2)
        for joint in self.joints:
            by = np.unique(joint.columns)
            result[:, by] += self.differences.changes(partial(self._forces, joint, multipliers), by)
        return result

    def stiffness_as_loads(self, multipliers: Array, columns: Array) -> Array:
        """Changes of these forces on one body with its own coordinates `columns`, (k,), as if they were loads, (k, k).

        Loads keep their directions in space. For motions that joints allow this adds up to `stiffness`, except where a
        body slides along another one that turns. Rotations by deformation count as linear.
        """
        result = np.zeros((self.differences.n,) * 2)
        for joint in self.joints:
            for marker, dofs in joint.markers:
                turns = np.array([i for i in dofs if i in self.turning], dtype=int)
                if turns.size and np.isin(dofs, columns).all():
                    load = np.linalg.lstsq(self._ways(marker).T, self._forces(joint, multipliers)[dofs])[0]
                    changes = self.differences.changes(partial(self._load, marker, load), turns)
                    others = np.isin(dofs, turns, invert=True)
                    result[np.ix_(dofs, turns)] += changes
                    result[np.ix_(turns, dofs[others])] += changes[others].T
        of_body: Array = result[np.ix_(columns, columns)]
        return of_body

    def _forces(self, joint: _Joint, multipliers: Array) -> Array:
        """Forces of a joint on the model's coordinates, (nq,)."""
        rows = np.asarray(self.mbs.ComputeItem(joint.number, require("exudyn").ComputeItemType.ConstraintJacobian))
        forces = np.zeros(self.differences.n)
        np.add.at(forces, joint.columns, rows.T @ multipliers[joint.rows])  # a joint may name a coordinate twice
        return forces

    def _ways(self, marker: MarkerIndex) -> Array:
        """Velocity and angular velocity of a marker by those of its coordinates, (6, k)."""
        kind = require("exudyn").ComputeItemType
        return np.vstack(
            [self.mbs.ComputeItem(marker, jacobian) for jacobian in (kind.PositionJacobian, kind.RotationJacobian)]
        )

    def _load(self, marker: MarkerIndex, load: Array) -> Array:
        """Forces of a force and a moment in space, (6,), on a marker's coordinates, (k,)."""
        forces: Array = self._ways(marker).T @ load
        return forces


def _joints(mbs: MainSystem) -> Iterator[_Joint]:
    for number, rows, columns, entry in constraints(mbs):
        of_one_body = len(np.unique(columns)) < len(columns)  # whose inner forces give it no stiffness
        yield _Joint(number, rows, columns, [] if of_one_body else [*_markers(mbs, entry)])


def _markers(mbs: MainSystem, entry: ItemEntry) -> Iterator[tuple[MarkerIndex, Array]]:
    """Markers of a joint that have a place and axes, with the coordinates, (k,), of what they are on."""
    data, kind = mbs.systemData, require("exudyn").ComputeItemType
    for marker in entry.get("markerNumbers", ()):
        if {kind.PositionJacobian, kind.RotationJacobian} <= {*mbs.ComputeItem(marker)}:
            on = mbs.GetMarker(marker)
            columns = (
                data.GetObjectLTGODE2(on["bodyNumber"]) if "bodyNumber" in on else data.GetNodeLTGODE2(on["nodeNumber"])
            )
            yield marker, np.array(columns, dtype=int)
