"""Work of each joint, spring, damper and load on the partition bodies of a model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError, RunError
from ..frames.floating import ActingMass
from ..support.arrays import Array
from ..support.checks import validate_result
from ..support.foreign import ItemEntry, ItemIndex, MainSystem, SensorIndex
from ..support.optional import require
from .joints import HOLONOMIC
from .model import OBJECTS, WORK, BodyItem, Registry, Samples, dofs_of, is_ours, registered

Force = Callable[[MainSystem], tuple[Array, Array]]  # numbers of coordinates, (k,) int, and the force on them, (k,)

_GRAVITY = "gravity on"  # begin of the name of the force of a body's own object
_SENSED = ("MassProportional", "Coordinate", "ForceVector", "TorqueVector")  # loads


class WorkSensor:
    """Work of the items of a model on its partition bodies; `CreateWorkSensor` returns it.

    Parameters
    ----------
    number : exudyn.SensorIndex
        Of the sensor that stores the work of each item [J].
    names : tuple of str
        Of the items.
    """

    def __init__(self, number: SensorIndex, names: tuple[str, ...]) -> None:
        self.number, self.names = number, names

    def work(self, result: Samples) -> dict[str, Array]:
        """Work on the partition bodies since the start of the run, (n,) [J], by the name of the item that did it.

        Between two samples it is the mean of the forces times the way. That is exact for linear springs, gravity and
        constant forces. For others the samples must resolve the forces, as those of `solve_dynamic` do by default. A
        spring that is loaded by bodies has done negative work.

        Parameters
        ----------
        result : Result
            Of the model that has this sensor.

        Raises
        ------
        InputError
            If the result is of another model, or of statics, whose load steps are no motion.
        """
        validate_result(result)
        if result.method == "static":
            raise InputError("result: expected one of dynamics, got one of statics, whose load steps are no motion")
        work = result.sensor_of(self, self.number)
        return dict(zip(self.names, (work - work[0]).T, strict=True))


def CreateWorkSensor(mbs: MainSystem) -> WorkSensor:
    """Sensor of the work that each joint, spring, damper and load does on the partition bodies of a model.

    Call it after all items, and before `mbs.Assemble()`. `result.report` then has a line for each item. Contacts,
    damping and plastic flow have lines of their own there. The sensor asks Exudyn for the forces of each item at each
    sample, which takes time; so it is not there by default. A distributed load and gravity= of `CreatePartitionBody`
    count as items.

    Parameters
    ----------
    mbs : exudyn.MainSystem

    Returns
    -------
    WorkSensor

    Raises
    ------
    InputError
        If the model has no partition body, nothing acts on its bodies, or it has such a sensor already.
    """
    registry = registered(mbs)
    if registry.work is not None:
        raise InputError("mbs: the model has a work sensor already, which knows the items that were there then")
    if not registry.bodies:
        raise InputError("mbs: expected a model with partition bodies; call CreatePartitionBody first")
    heavy = {number for number, item in registry.bodies.items() if _own_force(mbs, item).any()}
    names = _unlike([name for name, _ in _forces(mbs, registry, heavy)])
    if not names:
        raise InputError("mbs: expected joints, springs or loads on partition bodies; add them before this sensor")
    time, work, start = np.inf, np.zeros(len(names)), np.zeros(0)
    forces, before, counts = list[Force](), list[tuple[Array, Array]](), (0, 0)

    def sample(mbs: MainSystem, t: float, *unused: object) -> Array:
        nonlocal time, work, start, forces, before, counts
        now_there = mbs.systemData.NumberOfObjects(), mbs.systemData.NumberOfLoads()
        if t <= time or counts != now_there:  # another run: items have other numbers now if some were deleted
            forces, counts = _known(mbs, registry, heavy, names), now_there
        q, now = mbs.systemData.GetODE2Coordinates(), [force(mbs) for force in forces]
        if t < time:
            work, start, before = np.zeros(len(forces)), q, now
        way = _way(mbs, registry.bodies.values(), start, q)
        done = [(first + last) / 2 @ way[at] for (_, first), (at, last) in zip(before, now, strict=True)]
        time, work, start, before = t, work + done, q, now
        return work

    items = require("exudyn.itemInterface")
    number = mbs.AddSensor(items.SensorUserFunction(name=WORK, sensorUserFunction=sample, storeInternal=True))
    registry.work = sensor = WorkSensor(number, names)
    return sensor


def _forces(mbs: MainSystem, registry: Registry, heavy: Set[int]) -> list[tuple[str, Force]]:
    """Name and force of each item that acts on the bodies, of which those of numbers `heavy` have gravity."""
    return [*_weights(mbs, registry, heavy), *_forces_of_objects(mbs, registry), *_forces_of_loads(mbs, registry)]


def _known(mbs: MainSystem, registry: Registry, heavy: Set[int], names: tuple[str, ...]) -> list[Force]:
    """Forces of the items with these names, which are to be all that act on the bodies."""
    forces = _forces(mbs, registry, heavy)
    present = _unlike([name for name, _ in forces])
    if present != names:
        if missing := [name for name in present if name.startswith(_GRAVITY) and name not in names]:
            raise RunError(
                f"mbs: {', '.join(missing)} was set after CreateWorkSensor, which does not know it. Call it after the "
                "forces of bodies are set, or give gravity= to CreatePartitionBody"
            )
        raise RunError(
            f"mbs: items were added or deleted since CreateWorkSensor: it knows {', '.join(names)}, and now there are "
            f"{', '.join(present) or 'none'}. Make the model anew, and call it after all items"
        )
    return [force for _, force in forces]


def _way(mbs: MainSystem, bodies: Iterable[Any], start: Array, end: Array) -> Array:
    """Way of partition bodies between coordinates of a model, (nq,) each: (nq,), zero of all that is no such body."""
    way = np.zeros(len(end))
    for item in bodies:
        dofs = dofs_of(mbs, item)
        way[dofs] = item.kinematics.way(start[dofs], end[dofs])
    return way


def _unlike(names: list[str]) -> tuple[str, ...]:
    """Names of which each is there once: numbers follow those that are there more often."""
    count, seen, unlike = Counter(names), Counter[str](), []
    for name in names:
        seen[name] += 1
        unlike.append(f"{name} ({seen[name]})" if count[name] > 1 else name)
    return tuple(unlike)


def _own_force(mbs: MainSystem, item: BodyItem) -> Array:
    """Constant force of a body's own object, (n_dofs,)."""
    return np.asarray(mbs.GetObjectParameter(item["oGenericODE2"], "forceVector"), dtype=float)


def _weights(mbs: MainSystem, registry: Registry, heavy: Set[int]) -> list[tuple[str, Force]]:
    """Name and force of each body's own object: gravity. A run may change it.

    Those of the numbers `heavy` are there also while they have none, as what flies while others settle.
    """

    def of_body(item: BodyItem) -> Force:
        return lambda mbs: (dofs_of(mbs, item), _own_force(mbs, item))

    return [
        (f"{_GRAVITY} {item.name or f'body {number}'}", of_body(item))
        for number, item in registry.bodies.items()
        if number in heavy or _own_force(mbs, item).any()
    ]


def _forces_of_objects(mbs: MainSystem, registry: Registry) -> list[tuple[str, Force]]:
    """Name and force of each joint and connector on the bodies, and of objects such as distributed loads."""
    exu = require("exudyn")
    (objects, nodes), ours, terms = _numbers(registry.bodies), registry.objects, []
    for index in range(mbs.systemData.NumberOfObjects()):
        entry = mbs.GetObject(index)
        if index in ours:
            continue
        if "markerNumbers" in entry:
            touches = any(_is_on(mbs.GetMarker(marker), objects, nodes) for marker in entry["markerNumbers"])
        else:  # without a function it has no force
            touches = bool(entry.get("forceUserFunction")) and not nodes.isdisjoint(map(int, entry["nodeNumbers"]))
        if touches:
            terms.append((f"{entry['name']} ({entry['objectType']})", _of_object(exu.ObjectIndex(index))))
    return terms


def _of_object(number: ItemIndex) -> Force:
    kind = require("exudyn").ComputeItemType

    def force(mbs: MainSystem) -> tuple[Array, Array]:
        data = mbs.systemData
        what = kind.ReactionForces if len(data.GetObjectLTGAE(number)) else kind.ODE2LHS
        columns = np.asarray(data.GetObjectLTGODE2(number), dtype=int)
        acts = -np.asarray(mbs.ComputeItem(number, what))
        return columns, acts if len(acts) else np.zeros(len(columns))  # a connector that is switched off

    return force


def _forces_of_loads(mbs: MainSystem, registry: Registry) -> list[tuple[str, Force]]:
    """Name and force of each of Exudyn's loads on markers of the bodies."""
    kind = require("exudyn").ComputeItemType

    def columns_of(mbs: MainSystem, marker: ItemEntry) -> Array:
        data = mbs.systemData
        on_body = "bodyNumber" in marker
        return np.array(
            data.GetObjectLTGODE2(marker["bodyNumber"]) if on_body else data.GetNodeLTGODE2(marker["nodeNumber"]),
            dtype=int,
        )

    def of_vector(load: int, number: ItemIndex, marker: ItemEntry, torque: bool, fixed: bool) -> Force:
        ways = kind.RotationJacobian if torque else kind.PositionJacobian

        def force(mbs: MainSystem) -> tuple[Array, Array]:
            value = np.asarray(mbs.GetLoadValues(load))
            if fixed:
                value = mbs.ComputeItem(number, kind.Kinematics)["rotationMatrix"] @ value
            return columns_of(mbs, marker), np.asarray(mbs.ComputeItem(number, ways)).T @ value

        return force

    def of_mass(load: int, marker: ItemEntry) -> Force:
        def force(mbs: MainSystem) -> tuple[Array, Array]:
            by_mass = np.asarray(mbs.ComputeItem(marker["bodyNumber"], kind.MassWeightedPositionJacobian))
            return columns_of(mbs, marker), by_mass.T @ np.asarray(mbs.GetLoadValues(load))

        return force

    def of_coordinate(load: int, node: ItemIndex, coordinate: int) -> Force:
        def force(mbs: MainSystem) -> tuple[Array, Array]:
            return np.array([mbs.GetNodeODE2Index(node) + coordinate]), np.array([float(mbs.GetLoadValues(load))])

        return force

    objects, nodes = _numbers(registry.bodies)
    terms = []
    for load in range(mbs.systemData.NumberOfLoads()):
        entry = mbs.GetLoad(load)
        number, marker = entry["markerNumber"], mbs.GetMarker(entry["markerNumber"])
        if not _is_on(marker, objects, nodes):
            continue
        match entry["loadType"]:
            case "MassProportional":
                force = of_mass(load, marker)
            case "Coordinate" if "coordinate" in marker:
                force = of_coordinate(load, marker["nodeNumber"], marker["coordinate"])
            case "ForceVector" | "TorqueVector" as name:
                force = of_vector(load, number, marker, name == "TorqueVector", bool(entry["bodyFixed"]))
            case _:
                continue
        terms.append((f"{entry['name']} ({entry['loadType']})", force))
    return terms


def all_loads(mbs: MainSystem, q: Array, t: float) -> Array:
    """Force of all loads on partition bodies at coordinates q, (nq,), and time t [s]: (nq,).

    The model's present state is as before in the end.
    """
    registry, data, total = registered(mbs), mbs.systemData, np.zeros(len(q))
    forces = [force for _, force in _forces_of_loads(mbs, registry)]
    for number in range(data.NumberOfObjects()):
        if number not in registry.objects and _is_load(mbs.GetObject(number)):
            forces.append(_of_object(require("exudyn").ObjectIndex(number)))
    before, now = data.GetODE2Coordinates(), data.GetTime()
    try:
        data.SetTime(t)
        data.SetODE2Coordinates(q)
        for force in forces:
            columns, acts = force(mbs)
            np.add.at(total, columns, acts)
    finally:
        data.SetTime(now)
        data.SetODE2Coordinates(before)
    return total


@dataclass(frozen=True)
class Others:
    """What acts on the partition bodies of a model besides their contacts.

    Parameters
    ----------
    bodies : frozenset of int
        Identities of the bodies that anything but gravity acts on.
    held : frozenset of int
        Those of these that joints or springs act on which are switched on, not loads alone.
    not_told : tuple of str
        Names of items whose work on all bodies together may not be zero, and is in no sensor.
    driven : bool
        Whether joints or constraints move the bodies: by functions of time, or by bodies of other kinds.
    """

    bodies: frozenset[int]
    held: frozenset[int]
    not_told: tuple[str, ...]
    driven: bool

    @classmethod
    def of(cls, mbs: MainSystem, *, told: bool = False) -> Others:
        """Items of a model, as they are; `told` is whether a sensor has their work."""
        registry = registered(mbs)
        acted_on, held, not_told, driven = set[int](), set[int](), [], False
        for number, item in registry.bodies.items():
            force = _own_force(mbs, item)
            expected = np.zeros(len(force)) if item.weight is None else item.weight
            if not np.array_equal(force, expected):
                acted_on.add(id(item))
                not_told += [] if told else [f"the force vector of {item.name or f'body {number}'}"]
        others, everything = [*_others(mbs, registry)], _numbers(registry.bodies)
        each = {number: _numbers({number: item}) for number, item in registry.bodies.items()} if others else {}
        for entry, nodes, markers in others:
            touched = [n for n, of_item in each.items() if _touches(markers, nodes, of_item)]
            identities = {id(registry.bodies[n]) for n in touched}
            acted_on |= identities
            held |= identities if not _is_load(entry) and entry.get("activeConnector", True) else set()
            sensed = told and (entry.get("loadType") in _SENSED or "markerNumbers" in entry or _has_force(entry))
            if touched and not _is_workless(mbs, entry, markers, everything):
                driven |= entry.get("objectType") in HOLONOMIC
                not_told += [] if sensed else [f"{entry['name']} ({entry.get('objectType') or entry['loadType']})"]
        return cls(frozenset(acted_on), frozenset(held), tuple(not_told), driven)


def acts_on_constant_mass(mbs: MainSystem, item: BodyItem, acting: ActingMass) -> bool:
    """Whether forces on a body act on its constant mass; it is looked at again when the model has other items.

    They do if Exudyn alone knows some of them: those of joints, springs and loads, but not of gravity.
    """
    items = mbs.systemData.NumberOfObjects(), mbs.systemData.NumberOfLoads()
    if not acting.settled and items != acting.items:
        of_item = _numbers({0: item})
        acting.constant, acting.items = False, items
        for entry, nodes, markers in _others(mbs, registered(mbs)):
            known = entry.get("loadType") == "MassProportional" or is_ours(entry.get("forceUserFunction"))
            acting.constant |= not known and _touches(markers, nodes, of_item)
    return acting.constant


def _others(mbs: MainSystem, registry: Registry) -> Iterator[tuple[ItemEntry, set[int], list[ItemEntry]]]:
    """Each object and load that is not of this library, with its nodes and markers."""
    ours = registry.objects
    for index in range(mbs.systemData.NumberOfObjects()):
        if index not in ours and not _is_idle(entry := mbs.GetObject(index)):
            yield (
                entry,
                {*map(int, entry.get("nodeNumbers", ()))},
                [*map(mbs.GetMarker, entry.get("markerNumbers", ()))],
            )
    for index in range(mbs.systemData.NumberOfLoads()):
        entry = mbs.GetLoad(index)
        yield entry, set(), [mbs.GetMarker(entry["markerNumber"])]


def _is_load(entry: ItemEntry) -> bool:
    """Whether an item is one of Exudyn's loads, or a distributed load of this library."""
    return "loadType" in entry or is_ours(entry.get("forceUserFunction"))


def _has_force(entry: ItemEntry) -> bool:
    return isinstance(entry.get("forceUserFunction"), dict)


def _is_idle(entry: ItemEntry) -> bool:
    """Whether an object has neither mass nor force, as one that only carries markers."""
    matrices = [entry.get(name) for name in ("massMatrix", "stiffnessMatrix", "dampingMatrix")]
    full = any(np.size(matrix.GetPythonObject()) for matrix in matrices if matrix is not None)
    none = not full and not np.size(entry.get("forceVector", ()))
    return entry["objectType"] == "GenericODE2" and none and not _has_force(entry)


def _touches(markers: Iterable[ItemEntry], nodes: set[int], of_body: tuple[set[int], set[int]]) -> bool:
    return any(_is_on(marker, *of_body) for marker in markers) or not of_body[1].isdisjoint(nodes)


def _is_workless(
    mbs: MainSystem, entry: ItemEntry, markers: Sequence[ItemEntry], bodies: tuple[set[int], set[int]]
) -> bool:
    """Whether an item is a constraint between partition bodies and ground, which does not depend on time."""
    if entry.get("objectType") not in HOLONOMIC or any(isinstance(value, dict) for value in entry.values()):
        return False
    return all(_is_on(marker, *bodies) or _is_on_ground(mbs, marker) for marker in markers)


def _is_on_ground(mbs: MainSystem, marker: ItemEntry) -> bool:
    if "bodyNumber" in marker:
        return bool(mbs.GetObject(marker["bodyNumber"])["objectType"] == "Ground")
    return "nodeNumber" in marker and "Ground" in mbs.GetNode(marker["nodeNumber"])["nodeType"]


def _numbers(bodies: Mapping[int, BodyItem]) -> tuple[set[int], set[int]]:
    """Objects and nodes of bodies."""
    items: list[Any] = [*bodies.values()]
    objects = {int(item[key]) for item in items for key in OBJECTS if key in item}
    return objects, {int(node) for item in items for node in item.nodes}


def _is_on(marker: ItemEntry, objects: set[int], nodes: set[int]) -> bool:
    """Whether a marker is on a partition body."""
    numbers = {int(marker[key]) for key in ("bodyNumber", "objectNumber") if key in marker}
    return not objects.isdisjoint(numbers) or int(marker.get("nodeNumber", -1)) in nodes
