"""Exudyn adapter: check that objects and sensors of bodies and contacts are still those that were made with them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..errors import RunError
from ..exudyn_bodies.model import Registry, check_objects, registered
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact
from ..support.foreign import MainSystem, NodeIndex, SensorIndex
from ..support.optional import require

_KINDS = {"sCoordinates": "Coordinates", "sCoordinates_t": "Coordinates_t"}
_BY_FUNCTION: dict[str, object] = {"sensorType": "UserFunction"}


def check_sensors(mbs: MainSystem) -> Registry:
    """Return the items of a model, or raise if an object or sensor was deleted: later ones then have other numbers.

    Raises
    ------
    RunError
    """
    items, sensors = registered(mbs), mbs.systemData.NumberOfSensors()
    check_objects(mbs, items)
    for what, number, expected in (*_of_bodies(items.bodies.values()), *_of_contacts(items.contacts.values())):
        known = int(number) < sensors
        entry = mbs.GetSensor(number) if known else {}
        if "nodeNumber" in entry:  # an index of Exudyn equals no number
            entry["nodeNumber"] = int(entry["nodeNumber"])
        if not expected.items() <= entry.items():
            raise RunError(
                f"{what} has lost its sensor {int(number)}: a sensor was deleted, and Exudyn then gives others new "
                "numbers. Delete no sensor of a model with partition bodies: leave it, or make the model anew without "
                "it"
            )
    return items


def _of_bodies(bodies: Iterable[PartitionBody]) -> Iterator[tuple[str, SensorIndex, dict[str, object]]]:
    """For each sensor of a body: its owner, its number, and the parameters that Exudyn must have for it."""
    kinds = require("exudyn").OutputVariableType
    for place, item in enumerate(bodies):
        what = f"body {item.name!r}" if item.name else f"body {place}"
        for key, kind in _KINDS.items():
            for node, number in zip(item.nodes, item[key], strict=True):
                yield what, number, _on_node(node) | {"outputVariableType": getattr(kinds, kind)}


def _of_contacts(contacts: Iterable[PartitionContact]) -> Iterator[tuple[str, SensorIndex, dict[str, object]]]:
    """See `_of_bodies`."""
    for place, contact in enumerate(contacts):
        what = f"contact {contact.name!r}" if contact.name else f"contact {place}"
        told = _on_node(contact["nGenericData"]) if "nGenericData" in contact else _BY_FUNCTION
        yield what, contact["sForce"], told | ({"name": contact.name} if contact.name else {})
        for key in ("sFriction", "sPlastic"):
            if key in contact:
                by_node = key == "sFriction" and "nFrictionData" in contact
                yield what, contact[key], _on_node(contact["nFrictionData"]) if by_node else _BY_FUNCTION


def _on_node(node: NodeIndex) -> dict[str, object]:
    return {"sensorType": "Node", "nodeNumber": int(node)}
