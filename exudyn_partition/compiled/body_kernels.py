"""Compiled places of the bodies' nodes, as the steps of contacts with rigid surfaces and of pairs need them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..frames.kernels import moved_places, places
from ..support.arrays import Array
from ..support.compiled import called, inlined, inner

place_moved, place_turned = called(moved_places), called(places)

if TYPE_CHECKING:
    from .moving import Frames, MovingState


@inlined
def gathered(dofs: Array, first: int, end: int, values: Array) -> Array:
    """Values of some coordinates, (n,)."""
    result = np.empty(end - first)
    for i in range(end - first):
        result[i] = values[dofs[first + i]]
    return result


@inlined
def matrix_at(numbers: Array, place: int, rows: int, columns: int) -> Array:
    """A matrix among numbers."""
    return numbers[place:][: rows * columns].reshape(rows, columns)


@inner
def moved_nodes(
    frames: Frames,
    state: MovingState,
    b: int,
    q: Array,
    start: Array,
    arms: Array,
    rows: Array,
    growth: Array,
    axes: Array,
) -> Array:
    """Places of nodes of a body, (k, 3) [m], at its coordinates.

    Parameters
    ----------
    frames : Frames
    state : MovingState
    b : int
        Number of the body; -1 in an inertial frame.
    q : (n,) array
    start, arms, rows, growth : (k, 3), (k, 3), (3k, n), (3k, 6) arrays
        Of the nodes; growth is empty where there is none.
    axes : (3, 3) array
        Axes of the body at q = 0.
    """
    if b < 0:
        return place_moved(start, rows, q)
    if state.grows[b] and len(growth) > 0:
        start, arms, grown = start.copy(), arms.copy(), np.empty(3)
        for node in range(len(arms)):
            for i in range(3):
                grown[i] = 0.0
                for c in range(6):
                    grown[i] += growth[3 * node + i, c] * state.products[b, c]
                arms[node, i] += grown[i]
            for i in range(3):
                start[node, i] += axes[i, 0] * grown[0] + axes[i, 1] * grown[1] + axes[i, 2] * grown[2]
    return place_turned(q, start, frames.rotation[b], frames.node_axes[b], arms, rows)
