"""Compiled inertia forces of a floating frame; `inertia_forces` does the same by NumPy."""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array
from ..support.compiled import compiled


@compiled
def _solved(A: Array, b: Array) -> Array:
    """Solution of three equations, (3,), with a symmetric matrix whose upper half is given, by Cramer's rule."""
    d, e, f = A[0, 0], A[1, 1], A[2, 2]
    u, v, w = A[1, 2], A[0, 2], A[0, 1]
    xx, yy, zz = e * f - u * u, d * f - v * v, d * e - w * w
    yz, xz, xy = v * w - d * u, u * w - e * v, u * v - f * w
    x = np.empty(3)
    x[0] = xx * b[0] + xy * b[1] + xz * b[2]
    x[1] = xy * b[0] + yy * b[1] + yz * b[2]
    x[2] = xz * b[0] + yz * b[1] + zz * b[2]
    x /= d * xx + w * xy + v * xz
    return x


@compiled
def inertia_force(
    integrals: Array, cross: Array, tensor: Array, elastic: Array, omega: Array, z: Array, z_t: Array
) -> Array:
    """Torque and forces on the elastic coordinates, (3 + n,), with all terms; see `InertiaForces.force`.

    Parameters
    ----------
    integrals, cross : (6, n + 1, n + 1), (3, n, n) array
        Of `InertiaIntegrals`.
    tensor : (3, 3) array
        Inertia of the undeformed body.
    elastic : (n,) array
        K z.
    omega, z, z_t : (3,), (n,), (n,) array
    """
    n = len(z)
    by_place, J, J_t = np.empty((6, n)), np.empty(6), np.zeros(6)
    for c in range(6):
        total = integrals[c, 0, 0]
        for i in range(n):
            entry = integrals[c, i + 1, 0]
            for k in range(n):
                entry += integrals[c, i + 1, k + 1] * z[k]
            by_place[c, i] = entry
            total += (entry + integrals[c, 0, i + 1]) * z[i]
            J_t[c] += 2 * entry * z_t[i]
        J[c] = total
    C, force, spin = np.empty((3, n)), np.zeros(n), np.zeros(3)
    for a in range(3):
        for i in range(n):
            of_z, of_z_t = 0.0, 0.0
            for k in range(n):
                of_z += cross[a, i, k] * z[k]
                of_z_t += cross[a, i, k] * z_t[k]
            C[a, i] = -of_z
            spin[a] -= of_z * z_t[i]
            force[i] += 2 * omega[a] * of_z_t
    p, q, r = omega
    weights = (p * p, q * q, r * r, 2 * q * r, 2 * p * r, 2 * p * q)
    for c in range(6):
        for i in range(n):
            force[i] += weights[c] * by_place[c, i]
    x = J[0] * p + J[5] * q + J[4] * r + spin[0]
    y = J[5] * p + J[1] * q + J[3] * r + spin[1]
    w = J[4] * p + J[3] * q + J[2] * r + spin[2]
    torque, A = np.empty(3), np.empty((3, 3))
    torque[0] = r * y - q * w - (J_t[0] * p + J_t[5] * q + J_t[4] * r)
    torque[1] = p * w - r * x - (J_t[5] * p + J_t[1] * q + J_t[3] * r)
    torque[2] = q * x - p * y - (J_t[4] * p + J_t[3] * q + J_t[2] * r)
    A[0, 0], A[1, 1], A[2, 2] = J[0], J[1], J[2]
    A[1, 2], A[0, 2], A[0, 1] = J[3], J[4], J[5]
    for a in range(3):
        for i in range(n):
            torque[a] -= C[a, i] * (force[i] - elastic[i])
            for b in range(a, 3):
                A[a, b] -= C[a, i] * C[b, i]
    omega_t = _solved(A, torque)
    result = np.zeros(3 + n)
    for a in range(3):
        for b in range(3):
            result[a] += tensor[a, b] * omega_t[b]
        for i in range(n):
            result[3 + i] -= C[a, i] * omega_t[a]
    for i in range(n):
        result[3 + i] += force[i]
    return result


@compiled
def _turning(x: float, y: float, z: float) -> Array:
    """Matrix of the cross product with a vector, (3, 3)."""
    turn = np.zeros((3, 3))
    turn[0, 1], turn[0, 2], turn[1, 2] = -z, y, -x
    turn[1, 0], turn[2, 0], turn[2, 1] = z, -y, x
    return turn


@compiled
def inertia_derivatives(integrals: Array, cross: Array, omega: Array, z: Array, z_t: Array) -> tuple[Array, Array]:
    """Derivatives by z, (3 + n, n), and by omega and z_t, (3 + n, 3 + n), see `InertiaForces.derivatives`."""
    n = len(z)
    place = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
    by_z, by_velocity = np.zeros((3 + n, n)), np.zeros((3 + n, 3 + n))
    p, q, r = omega
    turn = _turning(p, q, r)
    weights = (p * p, q * q, r * r, 2 * q * r, 2 * p * r, 2 * p * q)
    by_place, by_shape_t, J, J_t = np.empty((6, n)), np.empty((6, n)), np.empty(6), np.zeros(6)
    for c in range(6):
        J[c] = integrals[c, 0, 0]
        for i in range(n):
            entry, entry_t = integrals[c, i + 1, 0], 0.0
            for k in range(n):
                entry += integrals[c, i + 1, k + 1] * z[k]
                entry_t += integrals[c, i + 1, k + 1] * z_t[k]
                by_z[3 + i, k] += weights[c] * integrals[c, i + 1, k + 1]
            by_place[c, i], by_shape_t[c, i] = entry, entry_t
            J[c] += (entry + integrals[c, 0, i + 1]) * z[i]
            J_t[c] += 2 * entry * z_t[i]
    C, cross_t, momentum = np.zeros((3, n)), np.zeros((3, n)), np.zeros(3)
    for a in range(3):
        for i in range(n):
            for k in range(n):
                C[a, i] -= cross[a, i, k] * z[k]
                cross_t[a, i] += cross[a, i, k] * z_t[k]
                by_velocity[3 + i, 3 + k] += 2 * omega[a] * cross[a, i, k]
            momentum[a] += C[a, i] * z_t[i]
        for b in range(3):
            momentum[a] += J[place[a, b]] * omega[b]
    by_velocity[:3, :3] = _turning(momentum[0], momentum[1], momentum[2])
    for a in range(3):
        for b in range(3):
            by_velocity[a, b] -= J_t[place[a, b]]
            for c in range(3):
                by_velocity[a, b] -= turn[a, c] * J[place[c, b]]
            for i in range(n):
                J_omega = by_place[place[b, 0], i] * p + by_place[place[b, 1], i] * q + by_place[place[b, 2], i] * r
                by_z[a, i] -= turn[a, b] * (2 * J_omega + cross_t[b, i]) + 2 * by_shape_t[place[a, b], i] * omega[b]
                by_velocity[a, 3 + i] -= turn[a, b] * C[b, i]
                if a == b:
                    by_velocity[a, 3 + i] -= 2 * J_omega
                    by_velocity[3 + i, a] += 2 * (cross_t[a, i] + J_omega)
    return by_z, by_velocity
