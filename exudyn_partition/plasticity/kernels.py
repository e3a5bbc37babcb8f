"""Compiled loops of plastic zones; modules `flow` and `loops` do the same by NumPy."""

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
def _strain(gradient: Array, nodes: Array, moved: Array, i: int) -> tuple[float, float, float, float, float, float]:
    """Deviatoric strain of point i. Views of its rows, or an array to fill, would cost more than the sums."""
    xx = yy = zz = yz = xz = xy = 0.0
    for n in range(nodes.shape[1]):
        first = 3 * nodes[i, n]
        u, v, w = moved[first], moved[first + 1], moved[first + 2]
        x, y, z = gradient[i, n, 0], gradient[i, n, 1], gradient[i, n, 2]
        xx += u * x
        yy += v * y
        zz += w * z
        yz += v * z + w * y
        xz += u * z + w * x
        xy += u * y + v * x
    mean, root = (xx + yy + zz) / 3, math.sqrt(0.5)
    return xx - mean, yy - mean, zz - mean, root * yz, root * xz, root * xy


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
    result, double = np.empty(len(nodes)), 2 * flow.shear_modulus
    for i in range(len(nodes)):
        xx, yy, zz, yz, xz, xy = _strain(gradient, nodes, moved, i)
        square = (double * (xx - plastic[i, 0]) - back[i, 0]) ** 2
        square += (double * (yy - plastic[i, 1]) - back[i, 1]) ** 2
        square += (double * (zz - plastic[i, 2]) - back[i, 2]) ** 2
        square += (double * (yz - plastic[i, 3]) - back[i, 3]) ** 2
        square += (double * (xz - plastic[i, 4]) - back[i, 4]) ** 2
        square += (double * (xy - plastic[i, 5]) - back[i, 5]) ** 2
        result[i] = math.sqrt(1.5 * square) - _between(equivalent[i], flow.strain, flow.stress, flow.slope)
    return result


@compiled
def combined(rows: Array, weights: Array) -> Array:
    """Sum of rows, (r, n), times their weights, (r,): see `loops.combined`."""
    result = np.zeros(rows.shape[1], rows.dtype)
    for i in range(len(rows)):
        if weights[i] != 0:
            for j in range(len(result)):
                result[j] += weights[i] * rows[i, j]
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
    strains, force, stress = np.empty((len(nodes), 6)), np.zeros(len(moved)), np.empty((3, 3))
    new, after, pulled = plastic.copy(), equivalent.copy(), back.copy()
    double = 2 * flow.shear_modulus
    for i in range(len(nodes)):
        xx, yy, zz, yz, xz, xy = _strain(gradient, nodes, moved, i)
        strains[i, 0], strains[i, 1], strains[i, 2] = xx, yy, zz
        strains[i, 3], strains[i, 4], strains[i, 5] = yz, xz, xy
        square = 0.0
        for v in range(6):
            square += (double * (strains[i, v] - plastic[i, v]) - back[i, v]) ** 2
        trial = math.sqrt(1.5 * square)
        if trial - _between(equivalent[i], flow.strain, flow.stress, flow.slope) <= flow.least:
            continue
        after[i] = _between(trial + flow.stiff * equivalent[i], flow.known, flow.strain, 1 / flow.last_slope)
        share = 1.5 * (after[i] - equivalent[i]) / trial
        for v in range(6):
            step = share * (double * (strains[i, v] - plastic[i, v]) - back[i, v])
            new[i, v] += step
            pulled[i, v] += 2 / 3 * flow.back_slope * step
        volume = double * weight[i]
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
