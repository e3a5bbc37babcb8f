"""Compiled loops over the integration points of plastic zones; module `flow` does the same by NumPy."""

from __future__ import annotations

import math

import numpy as np

from ..support.arrays import Array
from ..support.compiled import compiled
from .flow import FlowTables


@compiled
def _between(x: float, at: Array, values: Array, slope: float) -> float:
    """Linear interpolation of `values` at x, from the first place `at` on; beyond the last one, with a slope."""
    last = len(at) - 1
    if x >= at[last]:
        return float(values[last] + slope * (x - at[last]))
    i = 0
    while x > at[i + 1]:
        i += 1
    return float(values[i] + (values[i + 1] - values[i]) * max(x - at[i], 0.0) / (at[i + 1] - at[i]))


@compiled
def _strain(gradient: Array, nodes: Array, moved: Array, found: Array) -> None:
    """Deviatoric strain of a point, `found` (6,), by the gradients, (k, 3), of its nodes' functions."""
    H = np.zeros((3, 3))
    for n in range(len(nodes)):
        for a in range(3):
            u = moved[3 * nodes[n] + a]
            for b in range(3):
                H[a, b] += u * gradient[n, b]
    mean = (H[0, 0] + H[1, 1] + H[2, 2]) / 3
    for a in range(3):
        found[a] = H[a, a] - mean
    found[3] = math.sqrt(0.5) * (H[1, 2] + H[2, 1])
    found[4] = math.sqrt(0.5) * (H[0, 2] + H[2, 0])
    found[5] = math.sqrt(0.5) * (H[0, 1] + H[1, 0])


@compiled
def _length(found: Array, plastic: Array, back: Array, shear: float) -> float:
    """Length of the deviatoric stress about the back stress."""
    square = 0.0
    for v in range(6):
        square += (2 * shear * (found[v] - plastic[v]) - back[v]) ** 2
    return math.sqrt(square)


@compiled
def excess(
    gradient: Array, nodes: Array, moved: Array, plastic: Array, equivalent: Array, back: Array, flow: FlowTables
) -> Array:
    """Von Mises stress beyond the flow stress, (g,): see `Flow.excess`.

    Parameters
    ----------
    gradient : (g, k, 3) array
        Of the functions of the nodes at each point.
    nodes : (g, k) int array
    moved : (m,) array
        Displacements of all nodes.
    plastic, equivalent, back : (g, 6), (g,), (g, 6) arrays
        The state.
    flow : FlowTables
    """
    points = len(nodes)
    result, found = np.empty(points), np.empty(6)
    for i in range(points):
        _strain(gradient[i], nodes[i], moved, found)
        length = _length(found, plastic[i], back[i], flow.shear_modulus)
        result[i] = math.sqrt(1.5) * length - _between(equivalent[i], flow.strain, flow.stress, flow.slope)
    return result


@compiled
def answer(
    gradient: Array,
    nodes: Array,
    moved: Array,
    plastic: Array,
    equivalent: Array,
    back: Array,
    flow: FlowTables,
    weight: Array,
) -> tuple[Array, Array, Array, Array, Array]:
    """Strains, the state after radial return, and what the flow adds to the pseudo-forces: see `PlasticZone.answer`.

    `weight`, (g,), are volumes; the other arguments are those of `excess`.
    """
    points = len(nodes)
    strains, force, stress = np.empty((points, 6)), np.zeros(len(moved)), np.empty((3, 3))
    new, after, pulled = plastic.copy(), equivalent.copy(), back.copy()
    for i in range(points):
        found = strains[i]
        _strain(gradient[i], nodes[i], moved, found)
        length = _length(found, plastic[i], back[i], flow.shear_modulus)
        trial = math.sqrt(1.5) * length
        if trial - _between(equivalent[i], flow.strain, flow.stress, flow.slope) <= flow.least:
            continue
        after[i] = _between(trial + flow.stiff * equivalent[i], flow.known, flow.strain, 1 / flow.last_slope)
        share = math.sqrt(1.5) * (after[i] - equivalent[i]) / length
        for v in range(6):
            step = share * (2 * flow.shear_modulus * (found[v] - plastic[i, v]) - back[i, v])
            new[i, v] += step
            pulled[i, v] += 2 / 3 * flow.back_slope * step
        volume = 2 * flow.shear_modulus * weight[i]
        for a in range(3):
            stress[a, a] = volume * (new[i, a] - plastic[i, a])
        for v in range(3, 6):
            a, b = (v == 3) * 1, 2 - (v == 5) * 1  # yz, xz, xy
            stress[a, b] = stress[b, a] = math.sqrt(0.5) * volume * (new[i, v] - plastic[i, v])
        for n in range(nodes.shape[1]):
            for a in range(3):
                for b in range(3):
                    force[3 * nodes[i, n] + a] += stress[a, b] * gradient[i, n, b]
    return strains, new, after, pulled, force
