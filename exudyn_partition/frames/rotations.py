"""Matrices of vector products and rotations.

`skew` is the matrix of eq. 3 of the paper.
"""

from __future__ import annotations

import numpy as np

from ..support.arrays import Array

_SKEW = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2).reshape(3, 9)  # of the three axes


def skew(v: Array) -> Array:
    """Matrix of v x, (..., 3, 3), of vectors (..., 3)."""
    matrix: Array = (v @ _SKEW).reshape(*v.shape, 3)
    return matrix


def rotation_matrix(v: Array) -> Array:
    """Rotation matrices, (..., 3, 3), of rotation vectors (..., 3) [rad]."""
    half = np.linalg.norm(v, axis=-1)[..., None, None] / (2 * np.pi)
    turn = skew(v)
    matrix: Array = np.eye(3) + np.sinc(2 * half) * turn + np.sinc(half) ** 2 / 2 * (turn @ turn)
    return matrix
