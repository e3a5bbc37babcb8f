"""Stiffness and damping of Exudyn's own items in a model, such as springs and dampers, at its initial state."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ..support.arrays import Array
from ..support.foreign import MainSystem, ObjectIndex
from ..support.optional import require
from .model import coordinate_slices, registered
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


def tangents(mbs: MainSystem) -> list[Tangent]:
    """Tangents of all items that are not of this library: springs, dampers, and objects with matrices of their own.

    They are those at the initial state. Exudyn knows few of them in closed form, and the others are found by
    differences of forces. An item whose user function cannot be called outside of a run is left out. A model that is
    not assembled has none.
    """
    if not mbs.systemIsConsistent:
        return []
    data, initial = mbs.systemData, require("exudyn").ConfigurationType.Initial
    present = data.GetODE2Coordinates(), data.GetODE2Coordinates_t()
    found = []
    for number in _numbers(mbs):
        columns = np.array(data.GetObjectLTGODE2(number), dtype=int)
        if not 0 < len(columns) <= _MOST:
            continue
        _set(mbs, data.GetODE2Coordinates(initial), data.GetODE2Coordinates_t(initial))
        try:
            if _has_forces(mbs, number):
                entry = mbs.GetObject(number)
                of_both = (_derivative(mbs, number, columns, rates=rates) for rates in (False, True))
                found.append(Tangent(f"{entry['name']} ({entry['objectType']})", columns, *of_both))
        except Exception:  # of a user function, in whatever type Exudyn wraps it: the run will tell of it
            continue
        finally:
            _set(mbs, *present)
    return found


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
        at = np.concatenate([np.r_[place] for place in coordinate_slices(mbs, item)])
        value[at] += way * _of_translation(item)
    return np.asarray(value)


def _of_translation(item: PartitionBody) -> Array:
    """Coordinates by a translation of a body [1/m], the largest of three directions, (n_dofs,)."""
    if not item.kinematics.linear:
        return np.repeat([1.0, 0.0], [3, item.body.n_dofs - 3])
    return np.asarray(abs(item.body.rigid[:, :3]).max(axis=1))


def _numbers(mbs: MainSystem) -> Iterator[ObjectIndex]:
    """Objects that are not of this library, with forces that may depend on coordinates or velocities."""
    held = registered(mbs)
    keys = ("oGenericODE2", "oFFRFreducedOrder")
    ours = {int(item[key]) for item in held.bodies.values() for key in keys if key in item}
    ours |= {int(contact["oContact"]) for contact in held.contacts.values()}
    for number in map(require("exudyn").ObjectIndex, range(mbs.systemData.NumberOfObjects())):
        algebraic = len(mbs.systemData.GetObjectLTGAE(number))
        if int(number) not in ours and not algebraic and not mbs.GetObject(number)["objectType"].startswith(_RIGID):
            yield number


def _set(mbs: MainSystem, q: Array, q_t: Array) -> None:
    mbs.systemData.SetODE2Coordinates(q)
    mbs.systemData.SetODE2Coordinates_t(q_t)


def _has_forces(mbs: MainSystem, number: ObjectIndex) -> bool:
    """Whether an object opposes motion by forces."""
    active = mbs.GetObject(number).get("activeConnector", True)
    return bool(active) and require("exudyn").ComputeItemType.ODE2LHS in mbs.ComputeItem(number)


def _derivative(mbs: MainSystem, number: ObjectIndex, columns: Array, *, rates: bool) -> Array:
    """Derivative of an object's forces by its coordinates or their rates, (k, k), by central differences."""
    data, what = mbs.systemData, require("exudyn").ComputeItemType.ODE2LHS
    at: Callable[[], Array] = data.GetODE2Coordinates_t if rates else data.GetODE2Coordinates
    move: Callable[[Array], None] = data.SetODE2Coordinates_t if rates else data.SetODE2Coordinates
    start, value = at(), np.zeros((len(columns),) * 2)
    for j, column in enumerate(columns):
        if column in columns[:j]:  # the forces of one that is there twice are those of its first entry
            continue
        step, ends = _STEP * (_LEAST + abs(start[column])), []
        for side in (1, -1):
            moved = start.copy()
            moved[column] += side * step
            move(moved)
            ends.append(np.array(mbs.ComputeItem(number, what), dtype=float).ravel())
        value[:, j] = (ends[0] - ends[1]) / (2 * step)
    move(start)
    return value
