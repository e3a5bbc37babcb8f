"""Exudyn bodies that carry rigid surfaces: their pose, their motion, and the loads of contact on them."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Protocol

import numpy as np

from ..errors import InputError, RunError
from ..support.arrays import Array
from ..support.foreign import ItemIndex, MainSystem, ObjectIndex
from ..support.optional import require

Pose = Callable[[], tuple[Array, Array]]  # place, (3,) [m], and axes as columns, (3, 3)
Motion = Callable[[], tuple[Array, Array]]  # velocity, (3,) [m/s], and angular velocity, (3,) [rad/s]

_ORIGIN = [0.0, 0.0, 0.0]  # of a body
_POINTS = "MassPoint"  # how types of bodies without axes begin; for all others Exudyn itself tells


class OnCarrier(Protocol):
    """A contact with a rigid surface, as far as its carrier needs it."""

    @property
    def acts_on_carrier(self) -> bool:
        """Whether this force may not be zero."""

    def force_on_carrier(self) -> Array:
        """Force on the body that carries the surface, (3,) [N]."""

    def moment_on_carrier(self, point: Array) -> Array:
        """Its moment about a point in space, (3,) [N m]."""


def weakly(mbs: MainSystem) -> Callable[[], MainSystem]:
    """Return a function that returns the model as long as the user holds it.

    The model holds its user functions. If a user function also held the model, neither would ever be freed.
    """
    model = weakref.ref(mbs)

    def model_in_use() -> MainSystem:
        target = model()
        if target is None:
            raise RunError("mbs: the model is in use but was deleted; keep what AddSystem() returned in a variable")
        return target

    return model_in_use


def validate_carrier(name: str, mbs: MainSystem, body: object) -> None:
    """Raise InputError unless `body` is the number of an Exudyn body that has a place and axes."""
    exu = require("exudyn")
    expected = f"{name}: expected the number of a body of this model, as mbs.CreateRigidBody or mbs.AddObject returns"
    if isinstance(body, bool):
        raise InputError(f"{expected}, got {body}")
    try:
        for what in (exu.OutputVariableType.Position, exu.OutputVariableType.RotationMatrix):
            mbs.GetObjectOutputBody(
                body, what, localPosition=[0.0, 0.0, 0.0], configuration=exu.ConfigurationType.Reference
            )
    except Exception as error:  # Exudyn raises several types of errors
        raise InputError(f"{expected}; Exudyn says: {error}") from error
    kind = mbs.GetObject(body)["objectType"]
    if kind.startswith(_POINTS):  # Exudyn gives them axes that stand still
        raise InputError(
            f"{name}: expected a body that has axes, because contact turns what carries a surface; got a {kind}. Take "
            "mbs.CreateRigidBody, and joints if it must not turn"
        )


def pose(mbs: MainSystem, body: ObjectIndex) -> Pose:
    """Return the present pose of an Exudyn body; before the model is assembled, its reference pose."""
    exu, model = require("exudyn"), weakly(mbs)
    current, reference = exu.ConfigurationType.Current, exu.ConfigurationType.Reference
    position, rotation = exu.OutputVariableType.Position, exu.OutputVariableType.RotationMatrix

    def pose_now() -> tuple[Array, Array]:  # in each evaluation: to look these up takes as long as the call
        mbs = model()
        where = current if mbs.systemData.ODE2Size() else reference
        axes = mbs.GetObjectOutputBody(body, rotation, _ORIGIN, where)
        return mbs.GetObjectOutputBody(body, position, _ORIGIN, where), axes.reshape(3, 3)

    return pose_now


def pose_in(mbs: MainSystem, body: ItemIndex, configuration: object) -> tuple[Array, Array]:
    """Pose of an Exudyn body in one of its configurations."""
    axes = mbs.GetObjectOutputBody(body, require("exudyn").OutputVariableType.RotationMatrix, _ORIGIN, configuration)
    return place_in(mbs, body, configuration), np.asarray(axes).reshape(3, 3)


def place_in(mbs: MainSystem, body: ItemIndex, configuration: object) -> Array:
    """Place of an Exudyn body in one of its configurations, (3,) [m]."""
    position = require("exudyn").OutputVariableType.Position
    return np.asarray(mbs.GetObjectOutputBody(body, position, _ORIGIN, configuration))


def motion(mbs: MainSystem, body: ObjectIndex) -> Motion:
    """Return the present velocity and angular velocity of an Exudyn body."""
    variable, model = require("exudyn").OutputVariableType, weakly(mbs)

    def motion_now() -> tuple[Array, Array]:
        mbs = model()
        velocity, omega = (
            mbs.GetObjectOutputBody(body, what, localPosition=[0.0, 0.0, 0.0])
            for what in (variable.Velocity, variable.AngularVelocity)
        )
        return np.asarray(velocity), np.asarray(omega)

    return motion_now


class Carrier:
    """The Exudyn body that carries a rigid surface, with its nodes.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    body : exudyn.ObjectIndex

    Attributes
    ----------
    nodes : list of exudyn.NodeIndex
        Without those of the ground.
    """

    def __init__(self, mbs: MainSystem, body: ObjectIndex) -> None:
        entry = mbs.GetObject(body)
        nodes = [entry["nodeNumber"]] if "nodeNumber" in entry else entry.get("nodeNumbers", [])
        self.nodes = [node for node in nodes if "Ground" not in mbs.GetNode(node)["nodeType"]]
        self.body, self._motion_now = body, motion(mbs, body)

    def drawn_pose(self, mbs: MainSystem) -> tuple[Array, Array]:
        """Place, (3,) [m], and axes as columns, (3, 3), where the renderer draws it."""
        return pose_in(mbs, self.body, require("exudyn").ConfigurationType.Visualization)

    def by_coordinates(self, mbs: MainSystem) -> Array:
        """Derivative of velocity and angular velocity in space by the rates of the nodes' k coordinates, (6, k)."""
        exu, data = require("exudyn"), mbs.systemData
        q_t, columns = data.GetODE2Coordinates_t(copy=False), []
        before = q_t.copy()
        try:
            for node in self.nodes:
                start = mbs.GetNodeODE2Index(node)
                for coordinate in range(np.size(mbs.GetNodeOutput(node, exu.OutputVariableType.Coordinates))):
                    q_t[:] = 0.0
                    q_t[start + coordinate] = 1.0
                    columns.append(np.concatenate(self._motion_now()))
        finally:
            q_t[:] = before
        return np.array(columns).T


def load_carrier(mbs: MainSystem, contact_now: Callable[[], OnCarrier], body: ObjectIndex) -> None:
    """Add loads that apply the reaction of a contact to the body that carries the rigid surface.

    `contact_now` returns the contact in the present run. Exudyn evaluates loads after objects, so that
    its forces belong to the same coordinates.
    """
    items, current = require("exudyn.itemInterface"), require("exudyn").ConfigurationType.Current
    marker = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=[0.0, 0.0, 0.0]))

    zero = [0.0, 0.0, 0.0]

    def force(mbs: MainSystem, t: float, load: object) -> list[float]:
        contact = contact_now()
        return [*map(float, contact.force_on_carrier())] if contact.acts_on_carrier else zero

    def torque(mbs: MainSystem, t: float, load: object) -> list[float]:
        contact = contact_now()
        if not contact.acts_on_carrier:
            return zero
        return [*map(float, contact.moment_on_carrier(place_in(mbs, body, current)))]

    mbs.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=zero, loadVectorUserFunction=force))
    mbs.AddLoad(items.LoadTorqueVector(markerNumber=marker, loadVector=zero, loadVectorUserFunction=torque))
