"""What an Exudyn model holds of this library: its bodies and contacts, their coordinates, and the step at work."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..support.checks import validate_text
from ..support.optional import require

if TYPE_CHECKING:
    from ..exudyn_contacts.contact_items import PartitionContact
    from .partition_body import PartitionBody

REGISTRY = "exudynPartition"  # key in mbs.sys


def validate_model(mbs: Any) -> None:
    """Raise unless `mbs` is a model of Exudyn."""
    exu = require("exudyn")
    if not isinstance(mbs, exu.MainSystem):
        hint = "; make one by its AddSystem()" if isinstance(mbs, exu.SystemContainer) else ""
        raise InputError(f"mbs: expected a model of Exudyn, a MainSystem, got {type(mbs).__name__}{hint}")


def validate_new_name(mbs: Any, name: Any, kinds: Collection[str]) -> str:
    """Return `name` if none of the model's items of these kinds, such as "Object", has it, so that all can be added."""
    validate_text("name", name)
    for kind in kinds:
        if name and int(getattr(mbs, f"Get{kind}Number")(name)) >= 0:
            raise InputError(
                f"name: the model already has the {kind.lower()} {name!r}, and Exudyn takes each name once. Choose "
                "another; a notebook cell that builds a model and is run again begins with a new one, AddSystem()"
            )
    return str(name)


def partition_items(mbs: Any) -> tuple[list[PartitionBody], list[PartitionContact]]:
    """Partition bodies and contacts that a model holds; those from before an `mbs.Reset()` are forgotten."""
    validate_model(mbs)
    bodies, contacts = mbs.sys.setdefault(REGISTRY, ({}, {}))
    objects, sensors = mbs.systemData.NumberOfObjects(), mbs.systemData.NumberOfSensors()
    for number, item in list(bodies.items()):
        if number >= objects or not item.is_in(mbs):
            del bodies[number]
    for number, contact in list(contacts.items()):
        both_there = all(any(item is body for body in bodies.values()) for item, _ in contact.sides)
        if number >= sensors or not both_there:
            del contacts[number]
    return list(bodies.values()), list(contacts.values())


def coordinate_slices(mbs: Any, item: PartitionBody) -> list[slice]:
    """Places of a body's coordinates in the system vector, asked anew: a model may be assembled again."""
    starts = [mbs.GetNodeODE2Index(node) for node in item.nodes]
    return [slice(a, a + size) for a, size in zip(starts, item.node_sizes, strict=True)]


def start_of_step(mbs: Any) -> float:
    """Time at the start of the present step [s]."""
    return float(mbs.systemData.GetTime(require("exudyn").ConfigurationType.StartOfStep))


def runs_implicit(mbs: Any) -> bool:
    """Whether an implicit dynamic solver is at work."""
    solver = mbs.sys.get("dynamicSolver")
    if solver is None or "implicit" not in solver.GetSolverName():
        return False
    return bool(solver.it.currentTime == mbs.systemData.GetTime())  # not one that ran before a static solver
