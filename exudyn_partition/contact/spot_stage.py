"""Where the row of a contact at a point is, and the force that it has as its stored energy depends on the place.

The energy depends on the approach of the surfaces, and on the place of the contact on them: by the curvatures, where
these change, and by the slope of the bodies' displacements. The derivative by the approach is the normal force. Those
by the places are a small force along the surfaces and a couple, for the places wander as the bodies roll and slide.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..frames.rotations import skew
from ..prediction.point_contact import PointContact
from ..support.arrays import Array
from ..support.attributes import FoundOnce
from .seams import Shared
from .stages import Frozen, Stage
from .touching import at_point


class Pose(NamedTuple):
    """Where the true surface of a side is: x = place + axes (X - body).

    Parameters
    ----------
    place : (3,) array
        Place in space, from the gaps' centre [m], of
    body : (3,) array
        this point of the body, in its axes [m].
    axes : (3, 3) array
        Axes of the body, as columns.
    """

    place: Array
    body: Array
    axes: Array

    def out(self, point: Array) -> Array:
        """Places of points of the body, (..., 3) [m]."""
        return np.asarray(self.place + (point - self.body) @ self.axes.T)

    def into(self, place: Array) -> Array:
        """Points of the body at places, (..., 3) [m]."""
        return np.asarray(self.body + (place - self.place) @ self.axes)


class Meeting(NamedTuple):
    """Where two true surfaces are nearest.

    Parameters
    ----------
    gap : float
        [m]
    normal : (3,) array
        Outward unit normal of the master, in space.
    points : list of (3,) arrays
        Nearest point of the surface of each side that is a body, in its axes [m].
    outward : list of (3,) arrays
        Outward unit normals there, in its axes.
    """

    gap: float
    normal: Array
    points: list[Array]
    outward: list[Array]


class Push(NamedTuple):
    """Force on the slave along the surfaces, and its couple, besides forces on the row.

    Parameters
    ----------
    force, couple : (3,) arrays
        In space; the couple is about the point of contact [N, N m].
    """

    force: Array
    couple: Array


class SpotStage(Stage):
    """Where the row of a contact at a point is.

    Attributes
    ----------
    meeting : Meeting
    share : float
        Share of the contact that is on the faces of both sides.
    shared_by : tuple of Shared
        How faces share it, for both sides, a rigid surface included.
    poses : tuple of Pose
        Of both sides, a rigid surface included.
    modulus : float
        E* of both bodies [Pa].
    tilts : tuple of (3,) arrays
        Slope of the normal displacements of each side that is a body, out of its surface, in its axes.
    """

    places: list[Array]
    meeting: Meeting
    share: float
    shared_by: tuple[Shared, ...]
    poses: tuple[Pose, ...]
    modulus: float
    tilts: tuple[Array, ...]

    @FoundOnce
    def bendings(self) -> tuple[Array, Array]:
        """Curvatures of both sides, each as a tensor in space, (3, 3) [1/m]."""
        slave, master = (
            pose.axes @ by.bending(outward @ pose.axes) @ pose.axes.T
            for by, pose, outward in zip(self.shared_by, self.poses, self._outward, strict=True)
        )
        return slave, master

    @property
    def _outward(self) -> tuple[Array, Array]:
        """Outward normals of both sides, in space."""
        return -self.meeting.normal, self.meeting.normal

    @FoundOnce
    def _principal(self) -> tuple[tuple[float, float], Array]:
        """Relative curvatures, the smaller one first [1/m], and their directions in space as columns, (3, 2)."""
        bent, normal = self.bendings[0] + self.bendings[1], self.meeting.normal
        values, ways = np.linalg.eigh(bent + 2 * np.abs(bent).sum() * np.outer(normal, normal))
        return (float(values[0]), float(values[1])), ways[:, :2]

    @FoundOnce
    def contact(self) -> PointContact:
        """Hertz's contact here; raises InputError if the surfaces touch along a line."""
        return at_point(self._principal[0], self.modulus)

    @FoundOnce
    def _varies(self) -> bool:
        """Whether the curvatures depend on the place."""
        return any(by.varies for by in self.shared_by)

    @FoundOnce
    def _of_unit(self) -> Push:
        """Push of a force of 1 N, to which it is proportional if all curvatures stay."""
        return self._push(1.0)

    def push(self, force: float) -> Push:
        """Force along the surfaces under a normal force on the row [N].

        At a fixed approach, the stored energy falls by P/10 of the sum of the squared semi-axes times the change of the
        curvatures along them: the work of Hertz's pressure on the change of the gap around.
        """
        if self._varies:
            return self._push(force)
        return Push(force * self._of_unit.force, force * self._of_unit.couple)

    def _push(self, force: float) -> Push:
        """See `push`."""
        normal, weights = self.meeting.normal, self._weights(force)
        bent = [
            pose.axes @ by.surface.bending(outward @ pose.axes) @ pose.axes.T
            for by, pose, outward in zip(self.shared_by, self.poses, self._outward, strict=True)
        ]
        both = bent[0] + bent[1]
        rolling = np.linalg.inv(both + np.abs(both).sum() * np.outer(normal, normal))
        rolls = [rolling @ (way - (way @ normal) * normal) for way in self._by_place(force, weights)]
        quarter = skew(normal)
        spin = quarter @ self.bendings[0] - self.bendings[0] @ quarter
        couple = -quarter @ (rolls[0] + rolls[1]) - float(np.sum(weights * spin)) * normal
        return Push(bent[1] @ rolls[0] - bent[0] @ rolls[1], couple)

    def _weights(self, force: float) -> Array:
        """Derivative of the energy by the curvatures under a force on the row [N], (3, 3) [J m]; zero if all stay."""
        if not self._varies:
            return np.zeros((3, 3))
        axes, directions = np.array(self.contact.semi_axes(force / self.share)), self._principal[1]
        return np.asarray(-force / 10 * (directions * axes**2) @ directions.T)

    def _by_place(self, force: float, weights: Array) -> list[Array]:
        """Derivative of the energy by the place on each side, in space, (3,) [N]."""
        ways = [np.zeros(3), np.zeros(3)]
        for number, (by, pose, outward) in enumerate(zip(self.shared_by, self.poses, self._outward, strict=True)):
            if by.varies:
                ways[number] = pose.axes @ by.bent(pose.axes.T @ weights @ pose.axes, outward @ pose.axes)
            if number < len(self.tilts):
                ways[number] = ways[number] + force * (pose.axes @ self.tilts[number])
        return ways

    def resultant(self, lam: Array) -> Array:
        """See `Stage`."""
        return super().resultant(lam) + self.push(float(lam[0])).force

    def pushed(self, force: float) -> list[tuple[Array, Array]]:
        """Nodes of each side, and forces on them, (k, 3) [N], by `push` under a normal force on the row [N].

        They act on the nodes of the kernels as on rigid bodies. In an inertial frame the surface of a body does not
        turn, so that no couple works on it.
        """
        if not force:
            return []
        push, result = self.push(force), []
        for number, ((nodes, weights), side) in enumerate(zip(self.shares, self.rows.sides, strict=True)):
            forces = np.outer(weights[0], push.force)
            if not side.kinematics.linear:
                sign = (1.0, -1.0)[number]
                x, point = self.places[number][nodes[0]], self.poses[number].out(self.meeting.points[number])
                lever = point - sign * weights[0] @ x
                forces += _turning(x, sign * (push.couple + skew(lever) @ push.force))
            result.append((nodes[0], forces))
        return result

    def nodal_forces(self, lam: Array) -> list[Array]:
        """See `Stage`."""
        on_nodes = super().nodal_forces(lam)
        for forces, (nodes, more) in zip(on_nodes, self.pushed(float(lam[0])), strict=False):
            forces[nodes] += more
        return on_nodes

    def push_moment(self, force: float, about: Array) -> Array:
        """Moment on the slave about a point, (3,) [N m], by `push` under a normal force [N]; see `Stage.moment_of`."""
        if not force:
            return np.zeros(3)
        along, couple = self.push(force)
        arm = self.poses[0].out(self.meeting.points[0]) - about
        return np.asarray(couple + skew(arm) @ along)

    def moment(self, lam: Array, about: Array, places: Array) -> Array:
        """See `Stage`."""
        return super().moment(lam, about, places) + self.push_moment(float(lam[0]), about)


class FrozenSpot(Frozen):
    """The same, while the point of contact stays where it is on both sides.

    Attributes
    ----------
    meeting, share, contact
        See `SpotStage`.
    """

    meeting: Meeting
    share: float
    contact: PointContact

    def pushed(self, force: float) -> list[tuple[Array, Array]]:
        """See `SpotStage`: nothing."""
        return []

    def push_moment(self, force: float, about: Array) -> Array:
        """See `SpotStage`: nothing."""
        return np.zeros(3)


def _turning(places: Array, couple: Array) -> Array:
    """Forces on nodes at places, (k, 3) [m], that turn them as a rigid body by a couple, (3,) [N m]: (k, 3) [N]."""
    arms = places - places.mean(axis=0)
    inertia = np.eye(3) * (arms**2).sum() - arms.T @ arms
    return np.asarray(arms @ skew(np.linalg.solve(inertia, couple)).T)
