"""One sample of the adjoint of rows of contacts by NumPy; `adjoint_kernels` does the same in compiled loops.

The status of each row is known. Forces on a row that sticks may change along its normal and both tangents, so that
nothing moves there; without friction, along its normal alone. On a row that slips they change along its normal, where
the tangential force goes with it, and across the direction d of that force. With c = mu lambda_n / |x| of the trial
force x, the row then slips across d by -(1 - c) / (c F_t) of the change: see `algebra.closed_rows`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..support.arrays import Array

SLIPS, STICKS = 2, 3  # in how many ways the forces of a row with friction may change


class RowsBack(NamedTuple):
    """Rows in m samples, and adjoints of k numbers.

    There are n rows: those that are closed in any of the samples, or were before the first one. The last nf of them
    have tangents too, so that there are d = n + 2 nf directions.

    Parameters
    ----------
    plain : int
        Number of rows without tangents, n - nf.
    ways : (m, n) int8 array
        In how many ways the force of each row may change: 0 if it is open, 1 without friction, `SLIPS` or `STICKS`.
    mu, push : (m, nf) arrays
        Coefficients and normal forces [N].
    along : (m, nf, 2) array
        Direction of the tangential force on rows that slip.
    across, yielding : (m, nf) arrays
        Of rows that slip: share c, and (1 - c) F_t [m/N], or one where F_t does not matter.
    F : (d, d) array
        Flexibility [m/N].
    B : (d, nq) array
        Gaps and tangential places by the coordinates.
    groups : (ng + 1,) int array
        First row of each group whose rows move each other.
    order : (n,) int array
        Rows of each group, first those that are closed longest, whose factors are kept when others close or open.
    by_forces : (m, k, d) array
        Derivatives of the numbers by the forces.
    by_speed : (m, nf, 2) array
        Derivative of the next coefficient by how far a row slips.
    slips : (m, k, d) array
        Derivatives of the numbers by slips, to which those by gaps and slips are added.
    by_mu : (m, k, nf) array
        Derivatives by the coefficients, which are set.
    forces : (k, d) array
        Derivatives by the forces, from the samples after.
    mu_next : (k, nf) array
        Derivatives by the coefficients of the sample after.
    given, total : (k, d) arrays
        Room of compiled loops: derivatives by forces, without and with those by slips.
    factors, pivots, changes : (d * d,), (d,), (d, 3) arrays
        Of the Jacobian of each group, and how forces on its rows may change: first direction, kind, row with tangents.
    before : (k, nq) array
        Derivatives by the coordinates of the sample before.
    """

    plain: int
    ways: Array
    mu: Array
    push: Array
    along: Array
    across: Array
    yielding: Array
    F: Array
    B: Array
    groups: Array
    order: Array
    by_forces: Array
    by_speed: Array
    slips: Array
    by_mu: Array
    forces: Array
    mu_next: Array
    given: Array
    total: Array
    factors: Array
    pivots: Array
    changes: Array
    before: Array


def back_over_rows(rows: RowsBack, s: int, y: Array) -> tuple[Array, Array]:
    """Go back over the forces of sample s: derivatives by coordinates, (k, nq), and those by the tangents alone.

    The former are by coordinates of the sample, and the latter belong to those of the sample before, with another sign:
    ways along the tangents are differences of both. `y`, (k, nq), is the adjoint of the accelerations over the masses.
    """
    k, F, first, nf = len(y), rows.F, rows.plain, rows.mu.shape[1]
    moves, tests, yielding = _ways(rows, s)
    slips = rows.slips[s]
    slips[:, first:].reshape(k, nf, 3)[:, :, 1:] += rows.mu_next[:, :, None] * rows.by_speed[s]
    given = y @ rows.B.T + rows.by_forces[s] + rows.forces
    J = tests @ F @ moves.T + np.diag(yielding)
    slips -= np.linalg.solve(J.T, moves @ (given + slips @ F).T).T @ tests
    tangential = slips.copy()
    tangential[:, :first] = tangential[:, first::3] = 0.0
    changes = (given + slips @ F)[:, first:].reshape(k, nf, 3)[:, :, 1:]
    rows.by_mu[s] = rows.push[s] * np.einsum("kid,id->ki", changes, rows.along[s])
    rows.mu_next[:] = rows.by_mu[s]
    rows.forces[:] = -tangential @ F
    return slips @ rows.B, tangential @ rows.B


def _ways(rows: RowsBack, s: int) -> tuple[Array, Array, Array]:
    """How forces may change, (m, d), which displacements these forces cancel, (m, d), and how rows yield, (m,)."""
    ways, unit, plain = rows.ways[s], np.eye(len(rows.F)), rows.plain
    normals = unit[:plain][ways[:plain] > 0]
    moves, tests, yielding = [*normals], [*normals], [0.0] * len(normals)
    for i, (way, of_row) in enumerate(zip(ways[plain:], unit[plain:].reshape(-1, 3, len(unit)), strict=True)):
        if way != SLIPS:
            moves += [*of_row[:way]]
            tests += [*of_row[:way]]
            yielding += [0.0] * way
            continue
        d1, d2 = rows.along[s, i]
        beside = d1 * of_row[2] - d2 * of_row[1]
        moves += [of_row[0] + rows.mu[s, i] * (d1 * of_row[1] + d2 * of_row[2]), beside]
        tests += [of_row[0], rows.across[s, i] * beside]
        yielding += [0.0, float(rows.yielding[s, i])]
    return np.reshape(moves, (-1, len(unit))), np.reshape(tests, (-1, len(unit))), np.array(yielding)
