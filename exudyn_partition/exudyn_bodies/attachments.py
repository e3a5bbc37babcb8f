"""Checks of markers and sensors that are attached to the wrong part of a partition body.

The super element that carries markers has no mass matrix. In an inertial frame, its rigid node is held in space. Loads,
joints and sensors on these have no effect or read wrong values, and Exudyn gives no warning.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from ..errors import InputError, RunError
from ..frames.inertial import InertialKinematics
from ..support.arrays import Array
from ..support.foreign import MainSystem, ObjectIndex
from ..support.optional import require
from .model import BodyItem

_FRAME_MARKERS = ("BodyPosition", "BodyRigid", "BodyCable2DShape", "BodyBeamShape")  # markers on the frame of a body
_OFFSET = 1e-6  # of a body's size: smaller offsets are round-off
_TORN = 0.5  # largest rotation of a body in an inertial frame [rad]; lengths are then wrong by 13 %
_OF_MASS = ("KineticEnergy", "PotentialEnergy", "Force")


class AttachableBody(BodyItem, Protocol):
    """A body to which markers can be attached."""

    frame_markers: list[int]

    @property
    def kinematics(self) -> object:
        """Its `Kinematics`."""

    @property
    def frame(self) -> str:
        """The frame, "inertial" or "floating"."""

    def __contains__(self, key: object) -> bool:
        """Whether the body has an Exudyn index with this name."""


def check_attachments(mbs: MainSystem, bodies: list[AttachableBody]) -> None:
    """Raise for markers and sensors that would have no effect or read wrong values.

    Raises
    ------
    InputError
        Its message names the item, the body, and what to use instead.
    """
    carriers = {int(item["oFFRFreducedOrder"]): item for item in bodies if "oFFRFreducedOrder" in item}
    if not carriers:
        return
    carried_in_space = {int(item["nRigidBody"]): item for item in carriers.values() if item.frame == "inertial"}
    own_markers = {number for item in carried_in_space.values() for number in item.frame_markers}
    for number in range(mbs.systemData.NumberOfMarkers()):
        marker = mbs.GetMarker(number)
        named = f"mbs: marker {number} {marker['name']!r}, a Marker{marker['markerType']}"
        if marker["markerType"] in _FRAME_MARKERS:
            item = carriers.get(int(marker.get("bodyNumber", -1)))
            if item is not None:
                raise InputError(
                    f"{named}, is on the frame of body {item.name!r}, not on its material: {_instead(item)}"
                )
        elif number not in own_markers and int(marker.get("nodeNumber", -1)) in carried_in_space:
            item = carried_in_space[int(marker["nodeNumber"])]
            raise InputError(
                f"{named}, is on a node of body {item.name!r} that is held in space, because its frame is "
                f"inertial: {_instead(item)}"
            )
        _check_mesh_nodes(named, carriers, marker.get("bodyNumber", -1), marker.get("meshNodeNumbers", ()))
        _check_offset(named, carriers.get(int(marker.get("bodyNumber", -1))), marker.get("offset", ()))
    for number in range(mbs.systemData.NumberOfSensors()):
        sensor = mbs.GetSensor(number)
        named = f"mbs: sensor {number} {sensor['name']!r}, a Sensor{sensor['sensorType']}"
        item = carriers.get(int(sensor.get("bodyNumber", sensor.get("objectNumber", -1))))
        quantity = str(sensor.get("outputVariableType", "")).rpartition(".")[2]
        if item is not None and sensor["sensorType"] in ("Body", "Object") and quantity in _OF_MASS:
            raise InputError(
                f"{named} of {quantity}, is on the object that carries the markers of body {item.name!r}. It has no "
                "mass and no stiffness: take energy(result) and momentum(result) of the body"
            )
        if sensor["sensorType"] == "Node" and int(sensor["nodeNumber"]) in carried_in_space:
            item = carried_in_space[int(sensor["nodeNumber"])]
            raise InputError(
                f"{named}, is on a node of body {item.name!r} that is held in space, because its frame is "
                "inertial: take a SensorMarker on what CreateInterfaceMarker or CreatePointMarker returns, or take "
                "frame='floating'"
            )
        if sensor["sensorType"] == "SuperElement":
            _check_mesh_nodes(named, carriers, sensor.get("bodyNumber", -1), [sensor["meshNodeNumber"]])


def _check_mesh_nodes(
    named: str, carriers: dict[int, AttachableBody], number: ObjectIndex, mesh_nodes: Sequence[int] | Array
) -> None:
    """Raise for mesh nodes inside a body that was saved without its inside.

    Numbers up to the number of FE nodes are nodes of the FE model; higher ones belong to interfaces.
    """
    item = carriers.get(int(number))
    if item is not None:
        nodes = np.array(mesh_nodes, dtype=np.int64)
        try:
            item.body.check_nodes(nodes[(nodes >= 0) & (nodes < len(item.body.points))])
        except InputError as error:
            raise InputError(f"{named}, on body {item.name!r}: {error}") from error


def _check_offset(named: str, item: AttachableBody | None, offset: Sequence[float] | Array) -> None:
    """Raise for an offset of a marker on mesh nodes, which Exudyn turns with the frame of the body.

    The nodes turn with their material. The difference moves the joint within the body whenever this vibrates.
    """
    length = float(np.linalg.norm(offset))
    if item is not None and length > _OFFSET * np.ptp(item.body.points, axis=0).max():
        raise InputError(
            f"{named}, has an offset of {length:.3g} m from the mean of its nodes on body {item.name!r}. Exudyn turns "
            "the offset with the frame of the body and not with the nodes, so forces of joints there would be wrong: "
            f"{_markers(item)}, or weightingFactors with which the mean of the nodes is the point, and no offset"
        )


def _markers(item: AttachableBody) -> str:
    names = ", ".join(repr(interface.name) for interface in item.body.partition.interfaces)
    return (
        "take CreateInterfaceMarker"
        + (f" (it has {names})" if names else ", with an interface in the partition,")
        + " or CreatePointMarker"
    )


def _instead(item: AttachableBody) -> str:
    return f"{_markers(item)}; for gravity, a MarkerBodyMass or gravity= of CreatePartitionBody"


def add_guard(mbs: MainSystem, item: AttachableBody, check: Callable[[MainSystem], None]) -> None:
    """Add a sensor that stores nothing, but calls `check` at the start of each run, when Exudyn reads it.

    It also stops a run in which a body in an inertial frame rotates too far. Joints would rotate by the full angle, but
    not the body, so that they would tear it.
    """
    latest, name, node, n = math.inf, item.name, item.nodes[0], item.body.n_dofs
    kinematics = item.kinematics
    turning = kinematics.projection[:, 3:].T if isinstance(kinematics, InertialKinematics) else None

    def value(mbs: MainSystem, t: float, *unused: object) -> list[float]:
        nonlocal latest
        if t <= latest:
            check(mbs)
        latest = t
        if turning is not None:
            first = mbs.GetNodeODE2Index(node)
            angle = math.hypot(*(turning @ mbs.systemData.GetODE2Coordinates(copy=False)[first : first + n]))
            if angle > _TORN:
                raise RunError(
                    f"body {name!r} has rotated by {angle:.2g} rad at t = {t:.6g} s, and its frame is inertial, "
                    "for small rotations only: its joints cannot follow. Take frame='floating' of "
                    "CreatePartitionBody, which allows any rotation"
                )
        return [0.0]

    mbs.AddSensor(
        require("exudyn.itemInterface").SensorUserFunction(
            sensorUserFunction=value, writeToFile=False, storeInternal=False
        )
    )
