"""One sample of the adjoint of contacts with friction by NumPy; `adjoint_kernels` does the same in compiled loops.

The status of each row is known. Forces on a row that sticks may change along its normal and both tangents, so that
nothing moves there. On a row that slips they change along its normal, where the tangential force goes with it,
and across the direction d of that force. With c = mu lambda_n / |x| of the trial force x, the row then slips across d
by -(1 - c) / (c F_t) of the change: see `algebra.closed_rows`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..algebra.friction import OPEN, STICK
from ..support.arrays import Array


class FrictionBack(NamedTuple):
    """Rows with friction in m samples, and adjoints of k numbers.

    There are n rows: those that are closed in any of the samples, or were before the first one.

    Parameters
    ----------
    status : (m, n) int8 array
        OPEN, STICK or SLIP.
    mu, push : (m, n) arrays
        Coefficients and normal forces [N].
    along : (m, n, 2) array
        Direction of the tangential force on rows that slip.
    across, yielding : (m, n) arrays
        Of rows that slip: share c, and (1 - c) F_t [m/N], or one where F_t does not matter.
    F : (3 n, 3 n) array
        Flexibility [m/N].
    B : (3 n, nq) array
        Gaps and tangential places by the coordinates.
    groups : (ng + 1,) int array
        First row of each group whose rows move each other.
    by_forces : (m, k, 3 n) array
        Derivatives of the numbers by the forces.
    by_speed : (m, n, 2) array
        Derivative of the next coefficient by how far a row slips.
    slips : (m, k, 3 n) array
        Derivatives of the numbers by slips, to which those by gaps and slips are added.
    by_mu : (m, k, n) array
        Derivatives by the coefficients, which are set.
    forces : (k, 3 n) array
        Derivatives by the forces, from the samples after.
    mu_next : (k, n) array
        Derivatives by the coefficients of the sample after.
    """

    status: Array
    mu: Array
    push: Array
    along: Array
    across: Array
    yielding: Array
    F: Array
    B: Array
    groups: Array
    by_forces: Array
    by_speed: Array
    slips: Array
    by_mu: Array
    forces: Array
    mu_next: Array


def back_over_rows(rows: FrictionBack, s: int, y: Array) -> tuple[Array, Array]:
    """Go back over the forces of sample s: derivatives by coordinates, (nq, k), and those by the tangents alone.

    The former are by coordinates of the sample, and the latter belong to those of the sample before, with another sign:
    ways along the tangents are differences of both. `y`, (nq, k), is the adjoint of the accelerations over the masses.
    """
    k, F = y.shape[1], rows.F
    moves, tests, yielding = _ways(rows, s)
    slips = rows.slips[s].reshape(k, -1, 3).copy()
    slips[:, :, 1:] += rows.mu_next[:, :, None] * rows.by_speed[s]
    given = y.T @ rows.B.T + rows.by_forces[s] + rows.forces
    J = tests @ F @ moves.T + np.diag(yielding)
    answer = np.linalg.solve(J.T, moves @ (given + slips.reshape(k, -1) @ F).T)
    slips -= (answer.T @ tests).reshape(slips.shape)
    rows.slips[s] = slips.reshape(k, -1)
    tangential = slips.copy()
    tangential[:, :, 0] = 0.0
    changes = (given + rows.slips[s] @ F).reshape(slips.shape)[:, :, 1:]
    rows.by_mu[s] = rows.push[s] * np.einsum("kid,id->ki", changes, rows.along[s])
    rows.mu_next[:] = rows.by_mu[s]
    rows.forces[:] = -tangential.reshape(k, -1) @ F
    return (rows.slips[s] @ rows.B).T, (tangential.reshape(k, -1) @ rows.B).T


def _ways(rows: FrictionBack, s: int) -> tuple[Array, Array, Array]:
    """How forces may change, (m, 3 n), which displacements these forces cancel, (m, 3 n), and how rows yield, (m,)."""
    moves, tests, yielding = list[Array](), list[Array](), list[float]()
    for i, status in enumerate(rows.status[s]):
        if status == OPEN:
            continue
        unit = np.zeros((3, 3 * len(rows.status[s])))
        unit[:, 3 * i : 3 * i + 3] = np.eye(3)
        if status == STICK:
            moves += [*unit]
            tests += [*unit]
            yielding += [0.0] * 3
            continue
        d1, d2 = rows.along[s, i]
        beside = d1 * unit[2] - d2 * unit[1]
        moves += [unit[0] + rows.mu[s, i] * (d1 * unit[1] + d2 * unit[2]), beside]
        tests += [unit[0], rows.across[s, i] * beside]
        yielding += [0.0, float(rows.yielding[s, i])]
    n = 3 * len(rows.status[s])
    return np.reshape(moves, (-1, n)), np.reshape(tests, (-1, n)), np.array(yielding)
