"""Matrices of vector products and rotations.

`skew` is the matrix of eq. 3 of the paper.
"""

from __future__ import annotations

import math

import numpy as np

from ..support.arrays import Array

_SKEW = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2).reshape(3, 9)  # of the three axes


def skew(v: Array) -> Array:
    """Matrix of v x, (..., 3, 3), of vectors (..., 3)."""
    matrix: Array = (v @ _SKEW).reshape(*v.shape, 3)
    return matrix


def rotation_matrix(v: Array) -> Array:
    """Rotation matrices, (..., 3, 3), of rotation vectors (..., 3) [rad]."""
    if v.ndim == 1:
        return _one_rotation_matrix(*v.tolist())
    half = np.linalg.norm(v, axis=-1)[..., None, None] / (2 * np.pi)
    turn = skew(v)
    matrix: Array = np.eye(3) + np.sinc(2 * half) * turn + np.sinc(half) ** 2 / 2 * (turn @ turn)
    return matrix


def _one_rotation_matrix(x: float, y: float, z: float) -> Array:
    """The same of one vector, without arrays, which is quicker."""
    angle = math.sqrt(x * x + y * y + z * z)
    if not math.isfinite(angle):
        return np.full((3, 3), np.nan)
    if angle > 0.0:
        half = math.sin(angle / 2) / angle
        a, b = math.sin(angle) / angle, 2 * half * half
    else:
        a, b = 1.0, 0.5
    xx, yy, zz, xy, xz, yz = b * x * x, b * y * y, b * z * z, b * x * y, b * x * z, b * y * z
    x, y, z = a * x, a * y, a * z
    return np.array([[1.0 - yy - zz, xy - z, xz + y], [xy + z, 1.0 - xx - zz, yz - x], [xz - y, yz + x, 1.0 - xx - yy]])


def total_moment(arms: Array, forces: Array) -> Array:
    """Sum of arms x forces, (3,), of k arms and forces, (k, 3); without the single products, which np.cross makes."""
    (_, xy, xz), (yx, _, yz), (zx, zy, _) = (arms.T @ forces).tolist()
    return np.array([yz - zy, zx - xz, xy - yx])
