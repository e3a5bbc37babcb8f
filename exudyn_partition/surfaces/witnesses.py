"""Three nodes of a patch, far from each other, which tell how it lies in space."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..algebra.vectors import triangle_frame
from ..errors import ComplementarityError
from ..support.arrays import Array
from . import loops
from .surface import Surface


def seen_from(places: Sequence[Array], witnesses: Sequence[Array]) -> Array:
    """Places of three nodes of the first patch in the frame of three of the second, (3, 3) [m].

    Raises
    ------
    ComplementarityError
        If they are not finite.
    """
    (x_s, x_m), (some, others) = places, witnesses
    here = loops.seen_from(x_s, some, x_m, others)
    if not math.isfinite(here.sum()):
        raise ComplementarityError("the places of the patches are not finite: the run has become unstable")
    return here


def pose_of(points: Array) -> Array:
    """Origin and axes of the frame of three points as one vector, (12,)."""
    origin, axes = triangle_frame(points)
    return np.concatenate([origin, axes.ravel()])


def witnesses_of(surface: Surface) -> Array:
    """Three nodes of a surface's facets that are far from each other, (3,) int array."""
    nodes = np.unique(surface.facets)
    return np.asarray(nodes[spread(surface.points[nodes])])


def spread(points: Array) -> Array:
    """Return the numbers of three points that are far from each other, (3,)."""
    first = int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())
    second = int(np.linalg.norm(points - points[first], axis=1).argmax())
    aside = np.linalg.norm(np.cross(points - points[first], points[second] - points[first]), axis=1)
    return np.array([first, second, int(aside.argmax())])
