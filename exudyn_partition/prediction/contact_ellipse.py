"""Semi-axes of a contact, from the forces on its rows.

Theory: examples/site/theory.md, "Hertz's impact and first yield".
"""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp

from ..support.arrays import Array

_HAT = 4 * math.sqrt(3)  # second moment of a hat function on equilateral triangles: its integral by this


def semi_axes(nodes: Array, forces: Array, starts: Array, points: Array, areas: Array, integrated: bool) -> Array:
    """Semi-axes of the Hertz contact with the same second moments of pressure, (n, 2) [m], the larger first.

    Beneath an ellipse with Hertz's pressure, the mean of x^2, weighted by the pressure, is a^2 / 5. Peaks and areas of
    rows are ragged, sums over rows are not. The force on an integrated row is spread by a hat function, whose own
    moment is added; the force on a node is not, and the moments are at least those of one hat function.

    With two or more rows in the radius, p0 = 3 P / (2 pi a b) is within 5 % of Hertz for spheres (`test_yield.py`);
    with one it may be 10 % off and more. Under an even pressure on a disc of radius R, both semi-axes are 1.12 R, and
    p0 is 1.2 times the pressure. Along a line contact of length L they are 0.65 L and 1.12 a, and p0 is 4 % too large.

    Parameters
    ----------
    nodes : (k,) int array
        Patch nodes of the rows that are pressed, of all samples one after the other.
    forces : (k,) array
        Forces on them [N], above zero.
    starts : (n,) int array
        Where the rows of each sample begin; each has some.
    points : (np, 3) array
        Their places in the body [m].
    areas : (np,) array
        Areas that the rows stand for [m2].
    integrated : bool
        Whether rows are mean gaps, and not nodes.
    """
    x = points - points.mean(axis=0)
    squares = (x[:, :, None] * x[:, None, :]).reshape(-1, 9)
    of_nodes = np.concatenate([x, areas[:, None], squares], axis=1)
    weights = forces / np.repeat(np.add.reduceat(forces, starts), np.diff(starts, append=len(forces)))
    means = sp.csr_matrix((weights, nodes, np.append(starts, len(nodes))), shape=(len(starts), len(x))) @ of_nodes
    first, area = means[:, :3], means[:, 3]
    moments = means[:, 4:].reshape(-1, 3, 3) - first[:, :, None] * first[:, None, :]
    principal = np.linalg.eigvalsh(moments)[:, :0:-1]
    hat = areas.sum() / len(points) / _HAT
    own = area / _HAT if integrated else np.zeros(len(area))
    value: Array = np.sqrt(5 * np.maximum(principal + own[:, None], hat))
    return value
