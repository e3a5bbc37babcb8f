"""Pairs of two patches at the start of a contact, kept with the slave's body for the next model of the same bodies."""

from __future__ import annotations

import weakref
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..algebra.products import dense
from ..errors import EmptyRegionError
from ..reduction.body import ReducedBody
from ..support.arrays import Array
from ..surfaces.near import pair_as_placed, pair_wandering
from ..surfaces.points import ContactPoints, RowKind, contact_points
from ..surfaces.rows import ContactRows, directed_matrix, pair_surfaces
from ..surfaces.witnesses import spread
from .side import Side

_MOST = 16  # pairings that are kept with a body: the last used
_ROUNDING = 64 * np.finfo(float).eps  # of the distance from the origin: places that differ by less are the same

# Pairings hold arrays alone. A pairing that held its body would keep both of them in memory for ever.
KEPT: weakref.WeakKeyDictionary[ReducedBody, list[tuple[object, Pairing]]] = weakref.WeakKeyDictionary()
_POINTS: weakref.WeakKeyDictionary[ReducedBody, dict[object, ContactPoints]] = weakref.WeakKeyDictionary()
_ON_PLANES: weakref.WeakKeyDictionary[ReducedBody, dict[object, dict[Hashable, Any]]] = weakref.WeakKeyDictionary()


@dataclass(eq=False)
class Pairing:
    """Pairs of two patches at the start.

    Parameters
    ----------
    points : ContactPoints
        All points of the slave.
    rows : ContactRows
        Rows in the pose in which the patches face each other.
    pose : (n,) array
        Coordinates of both sides in that pose; zero if the patches face each other at the start.
    places : (k, 3) array
        The nodes of both patches, relative to the first node of the master [m].
    values : dict
        What follows from the pairs alone, see `Stage.by_pairs`.
    """

    points: ContactPoints
    rows: ContactRows
    pose: Array
    places: Array
    values: dict[Hashable, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, slave: Side, master: Side, kind: RowKind, itself: bool = False, *, pressed: bool = False) -> Pairing:
        """Pair two sides, or return their earlier pairing in the same relative place.

        `itself`: both are patches of one body in the model, so that each moves the other's nodes. `pressed`: they may
        overlap.

        Raises
        ------
        EmptyRegionError, PenetrationError
            See `rows.pair_surfaces`.
        """
        kept = KEPT.setdefault(slave.kinematics.body, [])
        key = (kind, itself, pressed, *_attitude(slave), weakref.ref(master.kinematics.body), *_attitude(master))
        points = np.vstack([slave.surface.points, master.surface.points])
        places, rounding = points - master.surface.points[0], _ROUNDING * abs(points).max()
        for i, (kept_key, pairing) in enumerate(kept):
            if kept_key == key and abs(pairing.places - places).max() <= rounding:
                kept.append(kept.pop(i))
                return pairing
        kept.append((key, cls._paired(slave, master, kind, places, pressed)))
        del kept[:-_MOST]
        return kept[-1][1]

    @classmethod
    def as_placed(cls, slave: Side, master: Side, kind: RowKind) -> Pairing:
        """Pair two sides where they are, however far that is; see `near.pair_as_placed`.

        Raises
        ------
        PenetrationError
        """
        points, pose = points_of(slave, kind), np.zeros(slave.n + master.n)
        return cls(points, pair_as_placed(points, slave.surface, master.surface), pose, np.empty((0, 3)))

    @classmethod
    def _paired(cls, slave: Side, master: Side, kind: RowKind, places: Array, pressed: bool) -> Pairing:
        """Pair two sides where they are, or, if they face away, where a body that can turn would face the other."""
        points, pose = points_of(slave, kind), np.zeros(slave.n + master.n)
        if slave.surface.wanders or master.surface.wanders:
            return cls(points, pair_wandering(slave.surface, master.surface, kind, pressed=pressed), pose, places)
        try:
            rows = pair_surfaces(slave.surface, master.surface, kind, pressed=pressed)
        except EmptyRegionError:
            # Floating bodies may turn until their patches face each other.
            pose = _facing_pose((slave, master))
            if not pose.any():
                raise
            rows = pair_surfaces(slave.at(pose[: slave.n]), master.at(pose[slave.n :]), kind)
        return cls(points, rows, pose, places)


def points_of(side: Side, kind: RowKind) -> ContactPoints:
    """All contact points of a side, which are computed once for a body: they do not depend on its place.

    They are those of its mesh. By places in space, they would differ in rounding from one first placement to another.
    """
    body = side.kinematics.body
    kept, key = _POINTS.setdefault(body, {}), _key_of_points(side, kind)
    if key not in kept:
        kept[key] = contact_points(replace(side.surface, points=side.kinematics.arms + body.centre_of_mass), kind)
    return kept[key]


def _key_of_points(side: Side, kind: RowKind) -> tuple[object, ...]:
    surface = side.surface
    arrays = surface.nodes, surface.facets, surface.sharp, side.kinematics.arms  # part of a patch, grown or not
    return (kind, *(array.tobytes() for array in arrays))


def values_on_plane(side: Side, kind: RowKind, normal: Array) -> dict[Hashable, Any]:
    """What follows from the rows of a side on a plane, wherever it stands, see `Stage.by_pairs`."""
    kept = _ON_PLANES.setdefault(side.kinematics.body, {})
    key = *_key_of_points(side, kind), *_attitude(side), normal.tobytes()
    kept[key] = values = kept.pop(key, {})  # the last used ones come last
    for old in [*kept][:-_MOST]:
        del kept[old]
    return values


def drift_rows(sides: Sequence[Side], shares: Sequence[tuple[Array, Array]], rows: ContactRows) -> Array:
    """Rows, (6, n), that give the sliding of three pairs along two tangents; `shares` as in `Gaps`."""
    some = spread(rows.points.at(sides[0].surface.points))
    blocks = []
    for tangent in np.linalg.svd(rows.approach[None])[2][1:]:
        along, block = np.tile(tangent, (len(some), 1)), []
        for (nodes, weights), side in zip(shares, sides, strict=True):
            G = directed_matrix(nodes[some], weights[some], along, len(side.surface.points))
            block.append(dense(G @ side.kinematics.rows))
        blocks.append(block)
    return np.block(blocks)


def _attitude(side: Side) -> tuple[object, ...]:
    """Key that distinguishes the patches of a body, and their directions."""
    surface, kinematics = side.surface, side.kinematics
    arrays = surface.nodes, surface.sharp, surface.direction, kinematics.rotation, kinematics.node_axes
    return (kinematics.linear, surface.direction_given, *(array.tobytes() for array in arrays))


def _facing_pose(sides: tuple[Side, Side]) -> Array:
    """Coordinates, (n,), at which a side that can turn faces the other; zero if no side can turn."""
    parts = [np.zeros(side.n) for side in sides]
    radii = [float(np.linalg.norm(np.ptp(side.surface.points, axis=0))) for side in sides]
    for i, (side, counterpart) in enumerate((sides, sides[::-1])):
        if not side.kinematics.linear:
            surface = counterpart.surface
            parts[i] = side.turned_to(surface.points.mean(axis=0), surface.direction, sum(radii))
            break
    return np.concatenate(parts)
