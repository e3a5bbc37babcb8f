"""The residual at which Newton's method may end: what rounding of places leaves in the forces of a model."""

from __future__ import annotations

import math

import numpy as np

from ..contact.normal_rows import NormalRows
from ..exudyn_bodies.model import coordinate_slices
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_bodies.tangents import places, tangents
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..support.foreign import MainSystem
from ..support.optional import require

_RESIDUAL = 3e-18  # share of forces that move bodies by their size in a period of f_cut: 1e-8 N for some centimetres
_ROUNDINGS = 4  # number of roundings of places, of patches or markers, that reach their forces


def newton_goal(mbs: MainSystem, duration: float = 0.0) -> float:
    """Residual at which Newton's method ends if it cannot reach Exudyn's relative tolerance.

    Residuals are generalised forces: those of modes are forces over the square root of a mass.

    Gaps are differences of places, which count from the contact, and have their rounding errors. A stiff patch turns
    them into forces, and no iteration reaches a smaller residual. So do stiff springs of Exudyn. So has the elastic
    force of a body that keeps nodes and flies far, in a run of some duration [s].
    """
    bodies, contacts = partition_items(mbs)
    goal = max((max(_RESIDUAL * _by_size(item), _rounding(mbs, item, duration)) for item in bodies), default=0.0)
    goal = max(goal, _rounding_of_springs(mbs))
    for contact in contacts:
        goal = max(goal, _ROUNDINGS * np.finfo(float).eps * _extent(mbs, contact, duration) * force_by_depth(contact))
    return goal or require("exudyn").SimulationSettings().timeIntegration.newton.absoluteTolerance


def force_by_depth(contact: PartitionContact) -> float:
    """Norm of the generalised forces of a uniform depth of all rows [N/m]; zero if it is not known.

    The stiffness of n rows against equal forces is n^2 / (1' F 1).
    """
    gaps = contact.mechanics.gaps
    if not contact.mechanics.compliant or any(side.flexibility is None for side in gaps.sides):
        return 0.0
    n = len(gaps.row_nodes)
    yielding = NormalRows(gaps).work_of(np.ones(n))
    of_unit = max(_norm_of_weight(item) / item.body.total_mass for item, _ in contact.sides)
    return n**2 / yielding * of_unit if yielding > 0.0 else 0.0


def _by_size(item: PartitionBody) -> float:
    """Norm of the generalised forces that accelerate a body by its size times the square of 2 pi f_cut."""
    size = np.ptp(item.body.points, axis=0).max()
    return float(_norm_of_weight(item) * size * (2 * np.pi * item.body.f_cut) ** 2)


def _rounding(mbs: MainSystem, item: PartitionBody, duration: float) -> float:
    """Norm of the elastic forces that rounding leaves in a body that flies for some duration [s] at its first speed.

    Nodes in an inertial frame have a stiffness also in rigid motion. Their elastic forces then are sums that cancel
    out, but for rounding. The body may be moved by its size, too.
    """
    if item.frame == "floating" or not len(item.body.basis.nodal):
        return 0.0
    way = np.ptp(item.body.points, axis=0).max() + duration * _speed(mbs, item)
    sums = abs(item.body.stiffness) @ abs(item.body.rigid[:, :3]).max(axis=1)
    return float(np.finfo(float).eps * way * np.linalg.norm(sums))


def _rounding_of_springs(mbs: MainSystem) -> float:
    """Norm of the forces that rounding of places leaves in items of Exudyn."""
    forces = np.zeros(mbs.systemData.ODE2Size())
    way = places(mbs)
    for item in tangents(mbs):
        np.add.at(forces, item.columns, abs(item.stiffness) @ way[item.columns])
    return float(_ROUNDINGS * np.finfo(float).eps * np.linalg.norm(forces))


def _norm_of_weight(item: PartitionBody) -> float:
    """Norm of the generalised forces that accelerate a body by 1 m/s2."""
    return float(np.linalg.norm(item.kinematics.weight(np.array([0.0, 0.0, 1.0]))))


def _speed(mbs: MainSystem, item: PartitionBody) -> float:
    """Speed of a body's centre of mass at the start [m/s]."""
    q_t = mbs.systemData.GetODE2Coordinates_t(require("exudyn").ConfigurationType.Initial)
    momentum = item.kinematics.momentum(np.concatenate([q_t[place] for place in coordinate_slices(mbs, item)]))
    return float(np.linalg.norm(momentum) / item.body.total_mass)


def _extent(mbs: MainSystem, contact: PartitionContact, duration: float) -> float:
    """How far from its centre a contact may be in a run of some duration [s]; rounding errors of places grow with it.

    Bodies fly at their first speed, and fall. Farther than by their size they have left the contact.
    """
    gaps = contact.mechanics.gaps
    far = max(gaps.placement.clearance, 0.0) if math.isfinite(gaps.placement.clearance) else 0.0
    for item, _ in contact.sides:
        speed = _speed(mbs, item)
        if item.weight is not None:
            falling = item.kinematics.momentum(item.weight / item.kinematics.mass) / item.body.total_mass
            speed += duration * float(np.linalg.norm(falling))
        far += min(duration * speed, float(np.ptp(item.body.points, axis=0).max()))
    return far + max(float(abs(side.surface.points - side.centre).max()) for side in gaps.sides)
