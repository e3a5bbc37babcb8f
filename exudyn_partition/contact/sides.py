"""Both sides of a contact: their coordinates stand one after the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from ..algebra.products import dense
from ..frames.kinematics import STILL, Rows
from ..reduction.body import ReducedBody
from ..support.arrays import Array, consecutive
from ..support.attributes import FoundOnce
from .side import Side

MANY = 5_000  # entries that can be spared, see `Side.spares`: above it, only the needed nodes are followed


class Sides(tuple[Side, ...]):
    """The slave, and the master if that is a patch too."""

    @property
    def bodies(self) -> list[ReducedBody]:
        """Reduced body of each side."""
        return [side.kinematics.body for side in self]

    @FoundOnce
    def n(self) -> int:
        """Number of coordinates of all sides."""
        return sum(side.n for side in self)

    @FoundOnce
    def linear(self) -> bool:
        """Whether places of all sides are linear in the coordinates, so that increments add up."""
        return all(side.kinematics.linear for side in self)

    @FoundOnce
    def on_demand(self) -> bool:
        """Whether the flexibility of a side is found on demand."""
        return any(side.on_demand for side in self)

    def split(self, q: Array) -> list[Array]:
        """Split q, (n,), into the coordinates of each side."""
        n = self[0].n
        return [q] if len(self) == 1 else [q[:n], q[n:]]

    def growths(self, growing: Array) -> list[Array]:
        """Split products by which the k sides grow, (6 k,) or empty, into those of each side, (6,) or empty."""
        return [growing[:6], growing[6:]][: len(self)]

    def places(self, q: Array, growing: Array = STILL) -> list[Array]:
        """Places of the nodes of the patches, (np, 3) for each side [m], at coordinates q, (n,), see `Side.place`.

        `growing`, (6 k,), are the products by which the k sides grow; empty if none does.
        """
        return [side.place(*part) for side, *part in zip(self, self.split(q), self.growths(growing), strict=True)]

    def dented(self, q: Array, growing: Array, dents: Sequence[Array] | None) -> list[Array]:
        """Places of all nodes, (np, 3) for each side [m], with dents of the sides, see `Side.dented`."""
        of_sides: Sequence[Array | None] = dents or [None] * len(self)
        parts = zip(self, self.split(q), self.growths(growing), of_sides, strict=True)
        return [side.dented(part, grown, dent) for side, part, grown, dent in parts]

    def moved(self, q: Array, way: Array) -> Array:
        """Coordinates, (n,), after an increment `way`, (n,), from q, (n,); `way` is velocity times time."""
        if self.linear:
            return q + way
        parts = zip(self, self.split(q), self.split(way), strict=True)
        return np.concatenate([side.kinematics.moved(*part) for side, *part in parts])

    def way(self, q: Array, end: Array) -> Array:
        """Increment, (n,), that leads from coordinates q to `end`, (n,): the inverse of `moved`."""
        if self.linear:
            return end - q
        parts = zip(self, self.split(q), self.split(end), strict=True)
        return np.concatenate([side.kinematics.way(*part) for side, *part in parts])

    def rigid_part(self, q_t: Array) -> Array:
        """Velocities, (n,), of the bodies' rigid motions within velocities q_t, (n,)."""
        parts = zip(self, self.split(q_t), strict=True)
        return np.concatenate([side.kinematics.rigid_part(part) for side, part in parts])

    def accelerations(self, q: Array, rows: Rows) -> Rows:
        """Accelerations of the coordinates, (n, nr), at q, (n,), by unit forces on rows, (nr, n); csr if rows are."""
        slices = consecutive([side.n for side in self])
        parts = [
            side.kinematics.accelerations(part, rows[:, columns].T)
            for side, part, columns in zip(self, self.split(q), slices, strict=True)
        ]
        return sp.vstack(parts, format="csr") if sp.issparse(rows) else np.vstack([*map(dense, parts)])

    def following(self, nodes: Sequence[Array]) -> Sides:
        """The sides that follow only some nodes of each, (k,) int arrays, if that saves time."""
        both = zip(self, nodes, strict=True)
        return Sides(side.following(some) if side.spares(some) > MANY else side for side, some in both)
