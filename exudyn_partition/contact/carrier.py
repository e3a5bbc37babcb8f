"""The body that carries a rigid surface: gaps depend on where it is, and their rates on how it moves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import InputError
from ..support.arrays import Array
from ..surfaces.loops import at_points
from .stages import NOTHING, Stage


class Carrier:
    """What carries a rigid surface; without arguments, nothing does. It keeps nothing: it asks the body each time.

    Parameters
    ----------
    find_pose : callable, optional
        Returns the place of the surface's frame, (3,) [m], and its rotation matrix, (3, 3).
    find_motion : callable, optional
        Returns the velocity of that place [m/s] and the angular velocity in space [rad/s], (3,) each. Default: at rest.
    """

    def __init__(
        self,
        find_pose: Callable[[], tuple[Array, Array]] | None = None,
        find_motion: Callable[[], tuple[Array, Array]] | None = None,
    ) -> None:
        self._find_pose, self._find_motion = find_pose, find_motion

    @property
    def pose(self) -> Array:
        """Place and axes of the surface, (12,), on which gaps depend too; empty if nothing carries it."""
        if self._find_pose is None:
            return NOTHING
        place, axes = self._find_pose()
        return np.concatenate([place, axes.ravel()])

    @property
    def motion(self) -> Array:
        """Velocity and angular velocity, (6,) [m/s, rad/s]; empty if nothing carries the surface."""
        if self._find_motion is None:
            return NOTHING if self._find_pose is None else np.zeros(6)
        return np.concatenate(self._find_motion())

    def rows(self, stage: Stage, places: Array) -> Array:
        """Derivative of the rates of the gaps of all rows, (nr, 6), with respect to `motion`.

        Parameters
        ----------
        stage : Stage
        places : (np, 3) array
            Of the slave's nodes [m]; beside a surface that is carried, they count from the origin.
        """
        if self._find_pose is None:
            raise InputError("carrier: nothing carries the surface")
        arms = at_points(*stage.shares[0], places) - self.pose[:3]
        return stage.rows.points.average(-np.hstack([stage.normals, np.cross(arms, stage.normals)]))
