"""What joins, drives and loads the bodies of a model, where it is, so that pictures can show signs of it.

Exudyn tells where markers are. Constraints and springs of single coordinates have no place, except drives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal, NamedTuple

import numpy as np

from ..support.arrays import Array
from ..support.foreign import ItemEntry, ItemIndex, MainSystem
from ..support.optional import require
from .carriers import pose_in
from .model import Registry, is_ours

Kind = Literal[
    "hinge", "ball joint", "slider", "fixed joint", "joint", "rod", "spring", "drive", "force", "torque", "gravity",
    "ground",
]  # fmt: skip
Pose = tuple[Array, Array]  # place, (3,) [m], and axes as columns, (3, 3)
Where = Callable[[MainSystem, object], Pose]  # in a configuration

_SPRINGS = (
    "ConnectorSpringDamper", "ConnectorCartesianSpringDamper", "ConnectorRigidBodySpringDamper",
    "ConnectorLinearSpringDamper", "ConnectorTorsionalSpringDamper",
)  # fmt: skip
_DRIVEN = ("offsetUserFunction", "springTorqueUserFunction")
_COORDINATES = ("ConnectorCoordinate", "ConnectorCoordinateSpringDamper")
# Axes of a sign whose z is the x, y or z of a joint.
_ALONG = [np.array(columns, dtype=float) for columns in (
    [[0, 0, 1], [1, 0, 0], [0, 1, 0]], [[0, 1, 0], [0, 0, 1], [1, 0, 0]], [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
)]  # fmt: skip


class Sign(NamedTuple):
    """A sign at a place of a model.

    Attributes
    ----------
    name : str
        Of the item.
    kind : str
    now : callable
        Returns its place [m], its axes, z along that of a joint, and its other end, (3,): of springs and rods that
        [m], of loads and gravity what acts, in space [N, N m, m/s2].
    """

    name: str
    kind: Kind
    now: Callable[[MainSystem, object], tuple[Array, Array, Array]]


def signs_of(mbs: MainSystem, ours: Registry) -> list[Sign]:
    """Signs of the joints, springs, drives and loads of a model, of its ground, and of gravity.

    `ours` are the bodies and contacts of this library in it.
    """
    return [*_connectors(mbs, ours), *_loads(mbs), *_weights(ours)]


def _connectors(mbs: MainSystem, ours: Registry) -> Iterator[Sign]:
    """Signs of joints, springs and drives, and of the ground where it holds them."""
    held = {int(marker) for item in ours.bodies.values() for marker in item.frame_markers}
    for number in sorted({*range(mbs.systemData.NumberOfObjects())} - ours.objects):
        entry = mbs.GetObject(number)
        markers = entry.get("markerNumbers", ())
        if len(markers) != 2 or not held.isdisjoint(map(int, markers)) or not entry.get("activeConnector", True):
            continue
        name, driven = entry["name"], any(isinstance(entry.get(key), dict) for key in _DRIVEN)
        places = [_where(mbs, marker) for marker in markers]
        if entry["objectType"] in _COORDINATES:
            if driven and (place := places[1] or places[0]) is not None:
                yield Sign(name, "drive", _at(place, np.eye(3)))
            continue
        shape, (first, second) = _shape(entry), places
        if shape is None or first is None or second is None:
            continue
        kind, axes = shape
        yield Sign(name, kind, _between(first, second, axes) if kind in ("spring", "rod") else _at(first, axes))
        if driven:
            yield Sign(name, "drive", _at(first, axes))
        for marker, place in zip(markers, places, strict=True):
            if place is not None and _on_ground(mbs, marker):
                yield Sign(name, "ground", _at(place, np.eye(3)))


def _shape(entry: ItemEntry) -> tuple[Kind, Array] | None:
    """Kind of a connector, and the axes of its sign in those of its first marker; None if it has no sign."""
    kind = entry["objectType"]
    own = np.asarray(entry.get("rotationMarker0", np.eye(3)), dtype=float).reshape(3, 3)
    if kind in _SPRINGS:
        return "spring", own
    if kind == "ConnectorDistance":
        return "rod", own
    if kind in ("JointRevoluteZ", "JointRevolute2D"):
        return "hinge", own
    if kind == "JointSpherical":
        return "ball joint", own
    if kind == "JointPrismaticX":
        return "slider", own @ _ALONG[0]
    if kind != "JointGeneric":
        return None
    free = np.flatnonzero(np.asarray(entry["constrainedAxes"]) == 0)
    moves, turns = free[free < 3], free[free >= 3] - 3
    if len(free) == 0:
        return "fixed joint", own
    if len(moves) == 0:
        return ("hinge", own @ _ALONG[turns[0]]) if len(turns) == 1 else ("ball joint", own)
    return ("slider", own @ _ALONG[moves[0]]) if len(free) == 1 else ("joint", own)


def _loads(mbs: MainSystem) -> Iterator[Sign]:
    """Signs of forces and torques, and of gravity on Exudyn's own bodies."""
    for load in range(mbs.systemData.NumberOfLoads()):
        entry = mbs.GetLoad(load)
        kind, marker = entry["loadType"], entry["markerNumber"]
        if is_ours(entry.get("loadVectorUserFunction")) or "loadVector" not in entry:
            continue
        if kind == "MassProportional":
            yield _gravity(np.asarray(entry["loadVector"], dtype=float))
        elif kind in ("ForceVector", "TorqueVector") and (place := _where(mbs, marker)) is not None:
            yield Sign(entry["name"], "force" if kind == "ForceVector" else "torque", _loaded(mbs, load, place))


def _weights(ours: Registry) -> Iterator[Sign]:
    """Signs of gravity= of partition bodies."""
    for item in ours.bodies.values():
        if item.weight is not None:
            of_axes = np.column_stack([item.kinematics.weight(axis) for axis in np.eye(3)])
            yield _gravity(np.linalg.lstsq(of_axes, item.weight, rcond=None)[0])


def _gravity(acceleration: Array) -> Sign:
    return Sign("gravity", "gravity", lambda mbs, configuration: (np.zeros(3), np.eye(3), acceleration))


def _where(mbs: MainSystem, marker: ItemIndex) -> Where | None:
    """Where a marker is; of a coordinate, the body that has its node. None if it has no place."""
    exu = require("exudyn")
    variable, reference = exu.OutputVariableType, exu.ConfigurationType.Reference
    entry = mbs.GetMarker(marker)
    if "coordinate" in entry and "nodeNumber" in entry:
        bodies = range(mbs.systemData.NumberOfObjects())
        node = int(entry["nodeNumber"])
        found = [body for body in bodies if int(mbs.GetObject(body).get("nodeNumber", -1)) == node]
        if not found or "Ground" in mbs.GetNode(node)["nodeType"]:
            return None
        try:
            pose_in(mbs, found[0], reference)
        except Exception:  # Exudyn raises several types of errors
            return None
        return lambda mbs, configuration: pose_in(mbs, found[0], configuration)
    try:
        mbs.GetMarkerOutput(marker, variable.Position, reference)
    except Exception:
        return None
    try:
        mbs.GetMarkerOutput(marker, variable.RotationMatrix, reference)
        turns = True
    except Exception:
        turns = False

    def pose(mbs: MainSystem, configuration: object) -> Pose:
        place = np.asarray(mbs.GetMarkerOutput(marker, variable.Position, configuration), dtype=float)
        if not turns:
            return place, np.eye(3)
        axes = mbs.GetMarkerOutput(marker, variable.RotationMatrix, configuration)
        return place, np.asarray(axes, dtype=float).reshape(3, 3)

    if _on_ground(mbs, marker):  # where it always is
        there = pose(mbs, reference)
        return lambda mbs, configuration: there
    return pose


def _at(where: Where, axes: Array) -> Callable[[MainSystem, object], tuple[Array, Array, Array]]:
    """A sign at one place, with its own axes in those of a marker."""

    def now(mbs: MainSystem, configuration: object) -> tuple[Array, Array, Array]:
        place, turn = where(mbs, configuration)
        return place, turn @ axes, place

    return now


def _between(first: Where, second: Where, axes: Array) -> Callable[[MainSystem, object], tuple[Array, Array, Array]]:
    """A sign between two places."""

    def now(mbs: MainSystem, configuration: object) -> tuple[Array, Array, Array]:
        place, turn = first(mbs, configuration)
        return place, turn @ axes, second(mbs, configuration)[0]

    return now


def _loaded(mbs: MainSystem, load: int, where: Where) -> Callable[[MainSystem, object], tuple[Array, Array, Array]]:
    """A load at a place, and what it is now; only a function of time is asked for at each time."""
    entry = mbs.GetLoad(load)
    varies, constant = isinstance(entry["loadVectorUserFunction"], dict), np.asarray(entry["loadVector"], dtype=float)
    fixed = bool(entry["bodyFixed"])

    def now(mbs: MainSystem, configuration: object) -> tuple[Array, Array, Array]:
        place, turn = where(mbs, configuration)
        value = np.asarray(mbs.GetLoadValues(load), dtype=float) if varies else constant
        return place, turn, turn @ value if fixed else value

    return now


def _on_ground(mbs: MainSystem, marker: ItemIndex) -> bool:
    entry = mbs.GetMarker(marker)
    return "bodyNumber" in entry and mbs.GetObject(entry["bodyNumber"])["objectType"] == "Ground"
