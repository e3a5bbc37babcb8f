"""Gaps of frozen pairs, which are linear in the coordinates: of one contact, and of many in flat arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..algebra.block_complementarity import pooled
from ..support.arrays import Array

_CLEARLY = 1 - 1e-6  # margin for the rounding of how far pairs have slid, relative to their reach
_FEW = 8  # lowest rows


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
        numbers, at = pooled([*(g.H.T for g in frozen), *(g.drift for g in frozen), *normals])
        H, drift, normal = at.reshape(3, -1)
        return cls(
            _starts([g.start for g in frozen]),
            _starts(dofs),
            _starts([g.drift_start for g in frozen]),
            np.concatenate(dofs),
            numbers,
            H,
            drift,
            normal,
            np.concatenate([g.start for g in frozen]),
            np.concatenate([g.drift_start for g in frozen]),
            np.array([_CLEARLY * g.reach for g in frozen]),
        )


class LowestRows(NamedTuple):
    """Rows with the smallest gaps of each contact. While it moves little, one of them has its smallest gap.

    Parameters
    ----------
    H : array
        Transposes of the rows, (n, k), one contact after the other.
    start : (nc, k) array
    at : array
        Coordinates of each contact at which its rows were chosen.
    numbers : array
        Bounds of all contacts, (n,) each, see `turn` and `slide`; equal ones are stored once.
    turn, slide : (nc,) int arrays
        Where the two bounds of each contact begin in `numbers`. The first bounds the change of the difference of two
        gaps with each coordinate. The second bounds the sliding of pairs with each coordinate.
    room, slack : (nc,) arrays
        Limits from the coordinates `at` on [m]. The chosen rows are valid while the difference of two gaps changes by
        less than `room`. Pairs stay frozen while they slide by less than `slack`.
    """

    H: Array
    start: Array
    at: Array
    numbers: Array
    turn: Array
    slide: Array
    room: Array
    slack: Array

    @classmethod
    def of(cls, frozen: Sequence[LinearGaps]) -> LowestRows:
        """Return the rows before any is chosen."""
        nc, k, n = len(frozen), min(_FEW, *(len(g.start) for g in frozen)), sum(g.H.shape[1] for g in frozen)
        turns = {id(g.H): np.ptp(g.H, axis=0) for g in frozen}
        numbers, at = pooled([turns[id(g.H)] for g in frozen] + [abs(g.drift).max(axis=0, initial=0) for g in frozen])
        turn, slide = at.reshape(2, -1)
        return cls(np.empty(k * n), np.empty((nc, k)), np.empty(n), numbers, turn, slide, *np.zeros((2, nc)))


def _starts(arrays: Sequence[Array]) -> Array:
    """Where each of some arrays begins in all of them together, and their end, (n + 1,)."""
    return np.cumsum([0, *map(len, arrays)])
