"""Changes of what depends on a model's coordinates, by central differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..frames.rotations import turned
from ..support.arrays import Array
from ..support.foreign import MainSystem
from ..support.optional import require
from .rotation_vectors import rotation_vectors

WAY = 1e-6  # of a coordinate: rows of joints are almost linear over it


@dataclass(frozen=True, eq=False)
class Differences:
    """Moves a model's coordinates a little, and back. Rotation vectors move by turns about their node's axes.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        An assembled model.
    turning : dict
        Place of the rotation vector of each coordinate that is a component of one.
    references : (nq,) array
        Coordinates of the reference configuration.
    """

    mbs: MainSystem
    turning: dict[int, slice]
    references: Array

    @classmethod
    def of(cls, mbs: MainSystem) -> Differences:
        """Differences about the present state of an assembled model."""
        turning = {i: slice(first, first + 3) for first in rotation_vectors(mbs) for i in range(first, first + 3)}
        return cls(mbs, turning, mbs.systemData.GetODE2Coordinates(require("exudyn").ConfigurationType.Reference))

    @property
    def n(self) -> int:
        """Number of the model's coordinates."""
        return len(self.references)

    def changes(self, function: Callable[[], Array], by: Array, ways: Array | None = None) -> Array:
        """Changes of a function's value, (j,), with coordinates `by`, (k,): (j, k). These move by `ways`, (k,)."""
        q, result = self.mbs.systemData.GetODE2Coordinates(copy=False), []
        for i, size in zip(by.tolist(), np.full(len(by), WAY) if ways is None else ways, strict=True):
            place, ends = self.turning.get(i, slice(i, i + 1)), []
            start = q[place].copy()
            for way in (size, -size):
                q[place] = self._moved(place, start, i, way)
                ends.append(function())
            q[place] = start
            result.append((ends[0] - ends[1]) / (2 * size))
        return np.column_stack(result)

    def _moved(self, place: slice, start: Array, i: int, way: float) -> Array:
        """Coordinates at a place, (1,) or (3,) for a rotation vector, after number i of the model's has moved."""
        ways = np.zeros(len(start))
        ways[i - place.start] = way
        if i not in self.turning:
            return start + ways
        return turned(self.references[place] + start, ways) - self.references[place]
