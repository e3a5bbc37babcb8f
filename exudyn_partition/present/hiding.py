"""What hides what: a drum around balls, or a plate before them, is drawn so that one looks through it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..support.arrays import Array

_PIXELS = 96  # of the picture that tells what is in front, along each side
_LEAST = 0.25  # of what would be seen of a part alone, below which it is hidden
_BEHIND = 2e-3  # of the size of all: parts that are nearer to each other touch

Part = tuple[Array, Array]  # points, (n, 3) [m], and triangles, (k, 3) int


def hiding(parts: Sequence[Part], matter: Sequence[bool], towards: Array) -> list[bool]:
    """Whether each part hides another one that matters, so that it should be seen through.

    Parameters
    ----------
    parts : sequence of ((n, 3) array, (k, 3) int array)
        Points [m] and triangles.
    matter : sequence of bool
        Whether each part should be seen.
    towards : (3,) array
        Direction to the viewer.
    """
    faded = [False] * len(parts)
    if len(parts) < 2:
        return faded
    depths, size = _depths([points for points, _ in parts], [triangles for _, triangles in parts], towards)
    seen = np.isfinite(depths)
    while True:
        before = np.zeros((len(parts), len(parts)))  # share of a part, by rows, that another one covers
        visible = np.ones(len(parts))
        solid = [number for number, is_faded in enumerate(faded) if not is_faded]
        for number in solid:
            alone = seen[number]
            if not (matter[number] and alone.any()):
                continue
            covers = np.array([
                seen[other][alone] & (depths[other][alone] > depths[number][alone] + _BEHIND * size)
                if other in solid and other != number else np.zeros(np.count_nonzero(alone), dtype=bool)
                for other in range(len(parts))
            ])  # fmt: skip
            before[number], visible[number] = covers.mean(axis=1), 1 - covers.any(axis=0).mean()
        hidden = visible < _LEAST
        if not hidden.any():
            return faded
        faded[int(before[hidden].sum(axis=0).argmax())] = True


def _depths(points: Sequence[Array], triangles: Sequence[Array], towards: Array) -> tuple[Array, float]:
    """Nearness of each part to a far viewer at each pixel, (parts, pixels, pixels) [m], and the size of all [m]."""
    back = towards / np.linalg.norm(towards)
    right = np.cross(np.eye(3)[2 if abs(back[2]) < 0.9 else 0], back)
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(back, right), back])
    seen = [places @ axes.T for places in points]
    every = np.vstack(seen)
    low = every.min(axis=0)
    size = float(np.ptp(every[:, :2], axis=0).max()) or 1.0
    depths = np.full((len(points), _PIXELS, _PIXELS), -np.inf)
    for depth, places, corners in zip(depths, seen, triangles, strict=True):
        sampled = _samples(places[corners], size / _PIXELS)
        column, row = ((sampled[:, :2] - low[:2]) / size * (_PIXELS - 1)).astype(int).T
        np.maximum.at(depth, (row, column), sampled[:, 2])
    return depths, float(np.linalg.norm(np.ptp(every, axis=0)))


def _samples(corners: Array, apart: float) -> Array:
    """Points on triangles, (k, 3, 3), that are at most `apart` from each other as seen, (n, 3)."""
    sides = np.linalg.norm(corners[:, :, :2] - np.roll(corners[:, :, :2], 1, axis=1), axis=2).max(axis=1)
    parts = np.clip(np.ceil(1.5 * sides / apart).astype(int), 1, 2 * _PIXELS)
    found = []
    for count in np.unique(parts):
        i, j = (index.ravel() for index in np.indices((count + 1, count + 1)))
        inside = i + j <= count
        shares = np.column_stack([count - i - j, i, j])[inside] / count
        found.append(np.einsum("sc,kcd->ksd", shares, corners[parts == count]).reshape(-1, 3))
    return np.vstack(found)
