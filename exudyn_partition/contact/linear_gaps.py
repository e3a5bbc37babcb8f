"""Gaps of frozen pairs, which are linear in the coordinates: of one contact, and of many in flat arrays."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..algebra.block_complementarity import pooled
from ..support.arrays import Array

_CLEARLY = 1 - 1e-6  # margin for the rounding of how far pairs have slid, relative to their reach


@dataclass(frozen=True, eq=False)
class LinearGaps:
    """Gaps of frozen pairs. They hold while three of the pairs slide less than `reach`.

    Parameters
    ----------
    H : (nr, n) array
        Derivative of the gaps with respect to the coordinates.
    start : (nr,) array
        Gaps at zero coordinates [m].
    drift : (6, n) array
        Derivative of the sliding of three pairs along two tangents with respect to the coordinates; empty if pairs
        never change.
    drift_start : (6,) array
        Sliding at the coordinates at which the pairs were found [m].
    reach : float
        [m]
    """

    H: Array
    start: Array
    drift: Array
    drift_start: Array
    reach: float


class FlatRows(NamedTuple):
    """Rows of all contacts in flat arrays, see `LinearGaps`.

    Parameters
    ----------
    starts, places, drift_starts : (n + 1,) int arrays
        Where the rows of each contact begin, its coordinates in `dofs`, and its pairs in `drift_start`.
    dofs : array of int
        Numbers of each contact's coordinates in the model.
    numbers : array
        Matrices of all contacts; equal ones are stored once.
    H, drift, normals : (n,) int arrays
        Where the matrices of each contact begin in `numbers`; H is transposed.
    start, drift_start : arrays
    reach : (n,) array
        A little less than `LinearGaps.reach`, so that pairs that stay frozen here also stay frozen in `Gaps`.
    """

    starts: Array
    places: Array
    drift_starts: Array
    dofs: Array
    numbers: Array
    H: Array
    drift: Array
    normals: Array
    start: Array
    drift_start: Array
    reach: Array

    @classmethod
    def of(cls, frozen: Sequence[LinearGaps], normals: Sequence[Array], dofs: Sequence[Array]) -> FlatRows:
        """Put the rows of contacts one after the other."""
        numbers, begins = pooled([*(g.H.T for g in frozen), *(g.drift for g in frozen), *normals])
        H, drift, normal = begins.reshape(3, -1)
        return cls(
            _starts([g.start for g in frozen]),
            _starts(dofs),
            _starts([g.drift_start for g in frozen]),
            np.concatenate([np.empty(0, dtype=np.int64), *dofs]),
            numbers,
            H,
            drift,
            normal,
            np.concatenate([np.empty(0), *(g.start for g in frozen)]),
            np.concatenate([np.empty(0), *(g.drift_start for g in frozen)]),
            np.array([_CLEARLY * g.reach for g in frozen]),
        )

    def with_room(self, contacts: Sequence[int]) -> FlatRows:
        """The same with normals of some contacts in room of their own, as loops write to them; they are zero there."""
        normals, sizes = self.normals.copy(), 3 * np.diff(self.starts)
        ends = [*itertools.accumulate((int(sizes[j]) for j in contacts), initial=len(self.numbers))]
        normals[[*contacts]] = ends[:-1]
        room = np.zeros(ends[-1] - len(self.numbers))
        return self._replace(numbers=np.concatenate([self.numbers, room]), normals=normals)


def _starts(arrays: Sequence[Array]) -> Array:
    """Where each of some arrays begins in all of them together, and their end, (n + 1,)."""
    return np.array([*itertools.accumulate(map(len, arrays), initial=0)])
