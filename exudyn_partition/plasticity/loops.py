"""The loops of plastic zones: compiled if numba is there, else by NumPy.

This is the only module of `plasticity` that knows which. `kernels` beside it has the compiled loops.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..support.arrays import Array, as_read_only, plain
from ..support.compiled import kernels
from .flow import Flow, PlasticState


class Points(Protocol):
    """The g integration points of a zone with nz nodes, see `PlasticZone`.

    Attributes
    ----------
    flow : Flow
    gradient : (g, k, 3) array
        Of the shape functions of each point's element [1/m].
    own : (g, k) int array
        Nodes of that element, by their numbers in the zone.
    weight : (g,) array
        [m3]
    """

    flow: Flow
    gradient: Array
    own: Array
    weight: Array

    def strains(self, displacement: Array) -> Array:
        """Deviatoric strains, (g, 6), by displacements of the nodes, (3 nz,) [m]."""

    def pseudo_forces(self, strain: Array) -> Array:
        """Forces on the nodes, (3 nz,) [N], by which plastic strain, (g, 6), acts."""


def excess(points: Points, displacement: Array, state: PlasticState) -> Array:
    """Von Mises stress beyond the flow stress, (g,) [Pa], by displacements of the nodes, (3 nz,) [m]."""
    if compiled := kernels("plasticity"):
        now = state.strain, state.equivalent, state.back
        beyond: Array = compiled.excess(points.gradient, points.own, plain(displacement), *now, points.flow.tables)
        return beyond
    flow = points.flow
    return flow.excess(flow.stress(points.strains(displacement), state), state)


def answer(points: Points, displacement: Array, state: PlasticState) -> tuple[PlasticState, Array, Array]:
    """State at the end of a step, its strains, (g, 6), and the change of the pseudo-forces, (3 nz,) [N].

    `displacement`, (3 nz,) [m], are those of the nodes at the end of the step, `state` is that at its begin.
    """
    if compiled := kernels("plasticity"):
        before = state.strain, state.equivalent, state.back
        at = points.gradient, points.own, displacement
        strain, *after, change = compiled.answer(*at, *before, points.flow.tables, points.weight)
        return PlasticState(*after), strain, change
    strain = points.strains(displacement)
    new = points.flow.answer(strain, state)
    return new, strain, points.pseudo_forces(new.strain - state.strain)


def combined(rows: Array, weights: Array) -> Array:
    """Sum of rows, (r, n), times their weights, (r,), many of which are zero: (n,), in the precision of the rows."""
    weights = weights.astype(rows.dtype, copy=False)
    if compiled := kernels("plasticity"):
        total: Array = compiled.combined(as_read_only(rows), weights)
        return total
    loaded = np.flatnonzero(weights)
    return np.asarray(weights[loaded] @ rows[loaded])
