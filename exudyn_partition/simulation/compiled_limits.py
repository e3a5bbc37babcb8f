"""Which models a compiled run can hold, and why it cannot hold others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..compiled.moving import can_follow, rows_of
from ..contact.formulations.choices import Compliance
from ..contact.formulations.coupled import SharedPatches
from ..contact.formulations.coupled_friction import SharedFriction
from ..errors import CompiledRunError
from ..exudyn_bodies.model import registered, user_function
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..frames.damping import ModeDamping
from ..frames.inertia_forces import TERMS
from ..support.foreign import ItemEntry, MainSystem

MOST_ROWS = 700  # of contacts with friction that are solved together: their matrices take 100 MB


def check_held(mbs: MainSystem, options: Sequence[str] = ()) -> None:
    """Raise an error with all reasons why a compiled run cannot hold a model; `options` are further reasons.

    Raises
    ------
    CompiledRunError
    """
    bodies, contacts = partition_items(mbs)
    parts = (
        _reasons_by_bodies(bodies),
        _reasons_by_contacts(contacts),
        _reasons_by_items(mbs, bodies, contacts),
        _reasons_by_sensors(mbs),
    )
    reasons = [*options, *(reason for part in parts for reason in part)]
    if reasons:
        listed = "".join(f"\n- {reason}" for reason in reasons)
        raise CompiledRunError(
            "compiled runs hold partition bodies, their contacts by compliance, rigid planes, spheres and cylinders, "
            "gravity, constant loads on coordinates and damping of modes; friction on rigid surfaces, and of bodies "
            "with each other; where no frame of these turns, as long as pairs do not slide. This one has more:"
            f"{listed}\n"
            "Leave it out, or run the model by solve_dynamic(..., solver='exudyn')"
        )


def _called(kind: str, item: PartitionBody | PartitionContact, place: int) -> str:
    return f"{kind} {item.name!r}" if item.name else f"{kind} {place}"


def _reasons_by_bodies(bodies: Sequence[PartitionBody]) -> Iterator[str]:
    """Reasons that bodies give why a compiled run cannot hold their model, see `check_held`."""
    for place, item in enumerate(bodies):
        named = _called("body", item, place)
        if item.frame == "floating" and not {*TERMS} - {"coupling"} <= {*item.inertia_terms}:
            yield f"{named} leaves out inertia forces by inertiaTerms"
        if len(item.body.basis.nodal):
            yield f"{named} keeps nodes, by basis {item.body.basis.name!r}"
        if item.body.stiffening is not None:
            yield f"{named} has geometric stiffness"
        if item.damping is not None and not isinstance(item.damping, ModeDamping):
            yield f"{named} has damping of nodes"


def _reasons_by_contacts(contacts: Sequence[PartitionContact]) -> Iterator[str]:
    """Reasons that contacts give, see `check_held`."""
    if not contacts:
        yield "no contact"
    for place, contact in enumerate(contacts):
        named, mechanics = _called("contact", contact, place), contact.mechanics
        if not isinstance(contact.formulation, Compliance):
            yield f"{named} has formulation {type(contact.formulation).__name__}"
        if mechanics.friction is not None and mechanics.gaps.sides.on_demand:
            yield f"{named} has friction on a large skin"
        rows = sum(len(rows_of(member.mechanics.gaps)) for member in contact.group)
        if has_friction(contact.group) and rows > MOST_ROWS:
            yield f"{named} is solved together with {rows} rows of which some have friction, more than {MOST_ROWS}"
        if mechanics.zones is not None:
            yield f"{named} has plastic zones"
        if contact.carrier is not None:
            yield f"{named} has a surface on a body that moves"
        if mechanics.viscous:
            yield f"{named} has a viscous flexibility, by damping in proportion to the stiffness"
        if mechanics.gaps.placement.overlap:
            yield f"{named} is a press fit"
        if contact.slave == contact.master:
            yield f"{named} is of a body that touches itself"
        if contact.moment_about is not None:
            yield f"{named} has a sensor of its moment"
        if isinstance(contact.together, SharedPatches | SharedFriction):
            yield f"{named} shares a patch with another contact"
        else:
            yield from _reasons_by_pairs(named, contact)


def _reasons_by_pairs(named: str, contact: PartitionContact) -> Iterator[str]:
    """Reasons that contacts give whose pairs follow the motion, see `check_held`."""
    gaps = contact.mechanics.gaps
    if not gaps.may_freeze and not can_follow(gaps):
        yield (
            f"{named} has pairs that follow the motion: of a RigidMesh, of Partition.surface on a rigid surface, or of "
            "large skins"
        )


def _reasons_by_items(
    mbs: MainSystem, bodies: Sequence[PartitionBody], contacts: Sequence[PartitionContact]
) -> Iterator[str]:
    """Reasons that other items and user functions of the model give, see `check_held`."""
    data = mbs.systemData
    ours = {int(item["oGenericODE2"]) for item in bodies} | {int(contact["oContact"]) for contact in contacts}
    for number in range(data.NumberOfObjects()):
        entry = mbs.GetObject(number)
        if number not in ours and entry["objectType"] != "Ground":
            yield f"object {entry['name']!r}, a {entry['objectType']}"
    if data.ODE2Size() != sum(item.body.n_dofs for item in bodies) or data.ODE1Size():
        yield "nodes with coordinates of their own"
    for number in range(data.NumberOfLoads()):
        load = mbs.GetLoad(number)
        if loaded_coordinate(mbs, bodies, load) is None:
            yield f"load {load['name']!r}, a {load['loadType']}, is not a constant one on a coordinate of a body"
    for name in ("PreStep", "PostStep", "PostNewton"):
        if user_function(getattr(mbs, f"Get{name}UserFunction")()) is not None:
            yield f"a {name} user function"


def loaded_coordinate(mbs: MainSystem, bodies: Sequence[PartitionBody], load: ItemEntry) -> int | None:
    """Number of the coordinate on which a constant load acts; None if it is another load."""
    if load["loadType"] != "Coordinate" or load["loadUserFunction"]:
        return None
    marker, nodes = mbs.GetMarker(load["markerNumber"]), {int(node) for item in bodies for node in item.nodes}
    if marker["markerType"] != "NodeCoordinate" or int(marker["nodeNumber"]) not in nodes:
        return None
    return int(mbs.GetNodeODE2Index(marker["nodeNumber"]) + marker["coordinate"])


def own_sensors(mbs: MainSystem) -> set[int]:
    """Numbers of the sensors that bodies and contacts made with them."""
    (bodies, contacts), damping = partition_items(mbs), registered(mbs).damping
    numbers = {int(n) for item in bodies for key in ("sCoordinates", "sCoordinates_t") for n in item[key]}
    of_damping = set() if damping is None else {int(damping.number)}
    of_contacts = {int(contact[key]) for contact in contacts for key in ("sForce", "sFriction") if key in contact}
    return numbers | of_contacts | of_damping


def _reasons_by_sensors(mbs: MainSystem) -> Iterator[str]:
    """Reasons that sensors give that the user has added, see `check_held`."""
    known = own_sensors(mbs)
    for number in range(mbs.systemData.NumberOfSensors()):
        entry = mbs.GetSensor(number)
        if number in known:
            continue
        if entry["sensorType"] == "UserFunction":
            yield f"sensor {entry['name']!r}, a user function"
        elif entry["fileName"] and entry["writeToFile"]:
            yield f"sensor {entry['name']!r} writes a file"


def has_friction(group: Sequence[PartitionContact]) -> bool:
    """Whether a contact of a group has friction."""
    return any(contact.mechanics.friction is not None for contact in group)
