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
    """As `rotation_matrix`, of one vector; without arrays, which is quicker."""
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


def rotation_change(v: Array, way: Array) -> Array:
    """Change of the rotation matrix, (..., 3, 3), from a rotation vector v, (3,), to v + way, with way (..., 3) [rad].

    Its rounding error is relative to the change. The difference of two matrices has that of the matrices. With
    a = sin(t) / t, h = sin(t / 2) / t and b = 2 h^2 for an angle t, a matrix is 1 + a v x + b v x v x.
    """
    end = v + way
    before, after = float(np.linalg.norm(v)), np.linalg.norm(end, axis=-1)
    both = before + after
    longer = np.einsum("...i,...i->...", way, v + end) / np.where(both > 0.0, both, 1.0)  # after - before
    (_, a_end, a_more), (h, h_end, h_more) = (_sines(part, before, after, longer) for part in (1.0, 0.5))
    b, b_more = (np.asarray(value)[..., None, None] for value in (2 * h_end**2, 2 * (h + h_end) * h_more))
    turn, more, turned = skew(v), skew(way), skew(end)
    change: Array = (
        np.asarray(a_end)[..., None, None] * more
        + np.asarray(a_more)[..., None, None] * turn
        + b * (more @ turned + turn @ more)
        + b_more * (turn @ turn)
    )
    return change


def _sines(part: float, before: float, after: Array, longer: Array) -> tuple[float, Array, Array]:
    """sin(part t) / t of an angle before and after a change by `longer`, (...), and how much more the latter is."""
    of_end = part * np.sinc(part * after / np.pi)
    of_start = float(part * np.sinc(part * before / np.pi))
    more = of_end - of_start
    little = 2 * abs(longer) < after
    size = np.where(little, after, 1.0)
    sine = 2 * np.cos(part * (before + after) / 2) * np.sin(part * longer / 2)
    return of_start, of_end, np.where(little, (sine - of_start * longer) / size, more)


def composed(v: Array, way: Array) -> Array:
    """Rotation vector, (3,), after a turn `way`, (3,), about the body's axes from a rotation vector v, (3,) [rad].

    Its angle is below 2 pi. It is rounded as by Exudyn's NodeRigidBodyRotVecLG: near zero it keeps half the digits.
    """
    before, turn = float(np.linalg.norm(v)) / 2, float(np.linalg.norm(way)) / 2
    a, b, s, t = math.cos(before), math.cos(turn), 0.5 * np.sinc(before / np.pi), 0.5 * np.sinc(turn / np.pi)
    axis = s * b * v + t * a * way + s * t * np.cross(v, way)
    size = float(np.linalg.norm(axis))
    angle = 2 * math.acos(min(max(a * b - s * t * float(v @ way), -1.0), 1.0))
    result: Array = axis * (angle / size) if size else axis
    return result


def turned(v: Array, way: Array) -> Array:
    """Rotation vector, (3,), after a turn `way`, (3,), about the body's axes from a rotation vector v, (3,) [rad].

    Its angle is at most pi. It keeps all digits near zero, unlike `composed`; without arrays, which is quicker.
    """
    (x, y, z, a), (u, v_, w, b) = _half_turn(v), _half_turn(way)
    along = a * b - x * u - y * v_ - z * w
    axis = [a * u + b * x + y * w - z * v_, a * v_ + b * y + z * u - x * w, a * w + b * z + x * v_ - y * u]
    size = math.hypot(*axis)
    if not math.isfinite(size):
        return np.full(3, np.nan)
    scale = math.copysign(2 * math.atan2(size, abs(along)) / size if size > 0.0 else 2.0, along)
    return np.array([scale * part for part in axis])


def _half_turn(v: Array) -> tuple[float, float, float, float]:
    """Quaternion of a rotation vector, (3,), its scalar part last."""
    x, y, z = v.tolist()
    angle = math.hypot(x, y, z)
    if not math.isfinite(angle):
        return (math.nan,) * 4
    share = math.sin(angle / 2) / angle if angle > 0.0 else 0.5
    return share * x, share * y, share * z, math.cos(angle / 2)


def total_moment(arms: Array, forces: Array) -> Array:
    """Sum of arms x forces, (3,), of k arms and forces, (k, 3); without the single products, which np.cross makes."""
    (_, xy, xz), (yx, _, yz), (zx, zy, _) = (arms.T @ forces).tolist()
    return np.array([yz - zy, zx - xz, xy - yx])
