"""Stiffness and damping of Exudyn's own items in a model, such as springs and dampers, at its initial state."""

from __future__ import annotations

import functools
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from operator import or_
from typing import NamedTuple

import numpy as np

from ..support.arrays import Array
from ..support.foreign import Exudyn, MainSystem, ObjectIndex
from ..support.optional import require
from .model import dofs_of, registered
from .partition_body import PartitionBody

_STEP, _LEAST = 1e-6, 1e-2  # of differences: a share of a coordinate, which counts as this much at least
_MOST = 300  # coordinates of an item: those with more have dense matrices that nobody can wait for
_RIGID = ("Ground", "Mass", "RigidBody", "RotationalMass", "KinematicTree")  # begins of types without springs


class Tangent(NamedTuple):
    """An item's forces against small motions.

    Parameters
    ----------
    name : str
        The item's, with its type.
    columns : (k,) int array
        Coordinates of the model, which may be there twice.
    stiffness, damping : (k, k) arrays
        Derivatives of the forces that oppose them by coordinates and by velocities.
    """

    name: str
    columns: Array
    stiffness: Array
    damping: Array


class _Item(NamedTuple):
    """An item of a model, with the coordinates that its forces depend on, (k,) int; `by_functions` of the user."""

    number: ObjectIndex
    name: str
    columns: Array
    by_functions: bool


def tangents(mbs: MainSystem) -> list[Tangent]:
    """Tangents of all items that are not of this library: springs, dampers, and objects with matrices of their own.

    They are those at the initial state. Exudyn knows few of them in closed form, and the others are found by
    differences of forces. An item whose user function cannot be called outside of a run is left out. A model that is
    not assembled has none.
    """
    items = [*_items(mbs)] if mbs.systemIsConsistent else []
    if not items:
        return []
    data, initial = mbs.systemData, require("exudyn").ConfigurationType.Initial
    present, by_item = (data.GetODE2Coordinates(), data.GetODE2Coordinates_t()), dict[int, Tangent]()
    try:
        _set(mbs, data.GetODE2Coordinates(initial), data.GetODE2Coordinates_t(initial))
        items = [item for item in items if _ode2_forces() in mbs.ComputeItem(item.number)]
        for group in _apart(items):
            of_both = (_derivatives(mbs, group, rates=rates) for rates in (False, True))
            for item, stiffness, damping in zip(group, *of_both, strict=True):
                if stiffness is not None and damping is not None:
                    by_item[int(item.number)] = Tangent(item.name, item.columns, stiffness, damping)
    finally:
        _set(mbs, *present)
    return [by_item[int(item.number)] for item in items if int(item.number) in by_item]


def places(mbs: MainSystem) -> Array:
    """Size of the numbers that the places of a model's markers are sums of, by its coordinates, (nq,).

    These are the coordinates with their references, of bodies the way by their distance and their size, and of nodes
    that rotate a radian at least.
    """
    exu, data = require("exudyn"), mbs.systemData
    kinds = exu.ConfigurationType
    value = abs(data.GetODE2Coordinates(kinds.Initial) + data.GetODE2Coordinates(kinds.Reference))
    for number in map(exu.NodeIndex, range(data.NumberOfNodes())):
        if mbs.GetNode(number)["nodeType"].startswith("RigidBody"):
            first, size = mbs.GetNodeODE2Index(number), len(mbs.GetNode(number)["referenceCoordinates"])
            value[first + size // 2 : first + size] = np.maximum(value[first + size // 2 : first + size], 1.0)
    for item in registered(mbs).bodies.values():
        way = np.linalg.norm(item.kinematics.position) + np.ptp(item.body.points, axis=0).max()
        at = dofs_of(mbs, item)
        value[at] += way * _of_translation(item)
    return np.asarray(value)


def _of_translation(item: PartitionBody) -> Array:
    """Coordinates by a translation of a body [1/m], the largest of three directions, (n_dofs,)."""
    if not item.kinematics.linear:
        return np.repeat([1.0, 0.0], [3, item.body.n_dofs - 3])
    return np.asarray(abs(item.body.rigid[:, :3]).max(axis=1))


def _items(mbs: MainSystem) -> Iterator[_Item]:
    """Objects that are not of this library, with forces that may depend on coordinates or velocities."""
    registry, data = registered(mbs), mbs.systemData
    ours = registry.objects
    for place in range(data.NumberOfObjects()):
        if place in ours or len(data.GetObjectLTGAE(place)):
            continue
        columns = np.array(data.GetObjectLTGODE2(place), dtype=int)
        if not 0 < len(columns) <= _MOST:
            continue
        entry, number = mbs.GetObject(place), require("exudyn").ObjectIndex(place)
        if entry["objectType"].startswith(_RIGID) or not entry.get("activeConnector", True):
            continue
        by_functions = any(isinstance(value, dict) for value in entry.values())
        yield _Item(number, f"{entry['name']} ({entry['objectType']})", columns, by_functions)


def _apart(items: Iterable[_Item]) -> Iterable[list[_Item]]:
    """Items in groups whose forces depend on none of each other's coordinates, so that all can be moved at once.

    To set the coordinates of a large model takes longer than all else. User functions may read any coordinates.
    """
    taken, groups = defaultdict[int, int](int), defaultdict[int, list[_Item]](list)
    for item in items:
        if item.by_functions:
            groups[-1 - int(item.number)].append(item)
            continue
        of_groups = functools.reduce(or_, (taken[column] for column in item.columns))  # a bit for each group
        free = ~of_groups & (of_groups + 1)
        groups[free].append(item)
        for column in item.columns:
            taken[column] |= free
    return groups.values()


@functools.cache  # it is asked for thousands of times
def _ode2_forces() -> Exudyn:
    """Exudyn's name of the forces by which an item opposes motion."""
    return require("exudyn").ComputeItemType.ODE2LHS


def _set(mbs: MainSystem, q: Array, q_t: Array) -> None:
    mbs.systemData.SetODE2Coordinates(q)
    mbs.systemData.SetODE2Coordinates_t(q_t)


def _forces(mbs: MainSystem, item: _Item) -> Array | None:
    """Forces by which an item opposes motion, in the present state, (k,); None if they cannot be found."""
    try:
        return np.array(mbs.ComputeItem(item.number, _ode2_forces()), dtype=float).ravel()
    except Exception:  # of a user function, in whatever type Exudyn wraps it: the run will tell of it
        return None


def _derivatives(mbs: MainSystem, items: Sequence[_Item], *, rates: bool) -> list[Array | None]:
    """Derivative of each item's forces by its coordinates or their rates, (k, k), by central differences.

    No coordinate is of two of the items. None of an item whose forces are not known.
    """
    data = mbs.systemData
    at: Callable[[], Array] = data.GetODE2Coordinates_t if rates else data.GetODE2Coordinates
    move: Callable[[Array], None] = data.SetODE2Coordinates_t if rates else data.SetODE2Coordinates
    start, values = at(), [np.zeros((len(item.columns),) * 2) for item in items]
    steps, failed = _STEP * (_LEAST + abs(start)), set[int]()
    for j in range(max(len(item.columns) for item in items)):
        # The forces of a column that is there twice are those of its first entry.
        moving = [i for i, item in enumerate(items) if j < len(item.columns) and _is_first(item.columns, j)]
        columns, ends = [items[i].columns[j] for i in moving], []
        for side in (1, -1):
            moved = start.copy()
            moved[columns] += side * steps[columns]
            move(moved)
            ends.append([_forces(mbs, items[i]) for i in moving])
        for i, column, ahead, behind in zip(moving, columns, *ends, strict=True):
            if ahead is None or behind is None:
                failed.add(i)
            else:
                values[i][:, j] = (ahead - behind) / (2 * steps[column])
    move(start)
    return [None if i in failed else value for i, value in enumerate(values)]


def _is_first(columns: Array, j: int) -> bool:
    return columns[j] not in columns[:j]
