"""Exudyn bodies that carry rigid surfaces: where they are, how they move, and what contact does to them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ._optional import require

if TYPE_CHECKING:
    from .contact_items import PartitionContact

Array = np.ndarray


def pose(mbs: Any, body: Any) -> Any:
    """Where an Exudyn body is now, in a model that is not assembled yet at its reference; None without a body."""
    if body is None:
        return None
    exu = require("exudyn")
    variable, configuration = exu.OutputVariableType, exu.ConfigurationType

    def pose_now() -> tuple[Array, Array]:
        now = configuration.Current if mbs.systemData.ODE2Size() else configuration.Reference
        place, axes = (
            mbs.GetObjectOutputBody(body, what, localPosition=[0.0, 0.0, 0.0], configuration=now)
            for what in (variable.Position, variable.RotationMatrix)
        )
        return np.asarray(place), np.asarray(axes).reshape(3, 3)

    return pose_now


def motion(mbs: Any, body: Any) -> Any:
    """Velocity and angular velocity of an Exudyn body now; None without a body."""
    if body is None:
        return None
    variable = require("exudyn").OutputVariableType

    def motion_now() -> tuple[Array, Array]:
        velocity, omega = (
            mbs.GetObjectOutputBody(body, what, localPosition=[0.0, 0.0, 0.0])
            for what in (variable.Velocity, variable.AngularVelocity)
        )
        return np.asarray(velocity), np.asarray(omega)

    return motion_now


def load_carrier(mbs: Any, contact: PartitionContact, body: Any) -> None:
    """Put the contact's reaction on the body that carries the rigid surface, as loads.

    Exudyn evaluates loads after objects, so that the contact's forces are those of the same coordinates.
    """
    items, pose_now = require("exudyn.itemInterface"), pose(mbs, body)
    marker = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=[0.0, 0.0, 0.0]))

    def force(mbs: Any, t: float, load: Any) -> list[float]:
        return [*map(float, -contact.law.resultant())]

    def torque(mbs: Any, t: float, load: Any) -> list[float]:
        return [*map(float, -contact.law.moment(pose_now()[0]))] if contact.law.index.size else [0.0, 0.0, 0.0]

    zero = [0.0, 0.0, 0.0]
    mbs.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=zero, loadVectorUserFunction=force))
    mbs.AddLoad(items.LoadTorqueVector(markerNumber=marker, loadVector=zero, loadVectorUserFunction=torque))
