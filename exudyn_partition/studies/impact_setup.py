"""One free impact: how two bodies, or one and a rigid surface, are set flying, and until when they are watched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..contact.profile import RigidProfile
from ..contact.rigid import RigidCylinder, RigidPlane, RigidSphere, RigidSurface
from ..contact.rigid_mesh import RigidMesh
from ..errors import InputError
from ..reduction.body import ReducedBody
from ..support.arrays import Array

Partner = ReducedBody | RigidSurface
Pair = tuple[ReducedBody, Partner]

RIGID = (RigidPlane, RigidSphere, RigidCylinder, RigidProfile, RigidMesh)
_CROSSINGS = 30  # of a wave through the larger body, the rule of `design_impact`
_PARALLEL = 0.9  # cosine beyond which another axis gives the direction along the surface
_FLAT = 1e-6  # sine of the smallest angle between `along` and the normal


@dataclass(frozen=True)
class Point:
    """One point of the grid.

    Parameters
    ----------
    place : float
        What the function of bodies is called with.
    speed : float
        Of the first body against the second one [m/s].
    angle : float
        Of its velocity from the normal of the contact [rad].
    friction : float
        Coefficient; 0 is no friction.
    """

    place: float
    speed: float
    angle: float
    friction: float

    def __str__(self) -> str:
        return (
            f"place {self.place:.6g}, speed {self.speed:.6g} m/s, angle {self.angle:.6g} rad, "
            f"friction {self.friction:.6g}"
        )


def validate_pair(name: str, value: object) -> Pair:
    """Return the pair of bodies, or of a body and a rigid surface; `name` says where it is from."""
    expected = "expected (ReducedBody, ReducedBody or rigid surface), from ep.reduce() or ep.load_body()"
    if not isinstance(value, Sequence) or len(value) != 2:
        raise InputError(f"{name}: {expected}, got {type(value).__name__}")
    first, second = value
    if not isinstance(first, ReducedBody):
        raise InputError(f"{name}: {expected}, got first a {type(first).__name__}")
    if not isinstance(second, (ReducedBody, *RIGID)):
        raise InputError(f"{name}: {expected}, got second a {type(second).__name__}")
    for body in (first, second):
        if isinstance(body, ReducedBody) and len(body.partition.patches) != 1:
            raise InputError(f"{name}: expected bodies with one contact patch, got {len(body.partition.patches)}")
    return first, second


def approach(pair: Pair) -> Array:
    """Direction in which the first body flies at the second one along the normal of the contact, (3,)."""
    first, second = pair
    patch = first.partition.patches[0]
    if isinstance(second, ReducedBody):
        second_patch = second.partition.patches[0]
        both = [p.direction * s for p, s in ((patch, 1.0), (second_patch, -1.0)) if p.direction_given]
        line = sum(both) if both else patch.direction - second_patch.direction
    else:
        gaps, normals = second.project(first.points[patch.nodes])
        line = -normals[int(gaps.argmin())]
    direction: Array = np.asarray(line) / np.linalg.norm(line)
    return direction


def sideways(normal: Array, along: Array | None) -> Array:
    """Unit vector of the motion along the surface, (3,): `along` without its part along the normal."""
    if along is None:
        along = np.eye(3)[0 if abs(normal[0]) < _PARALLEL else 1]
    flat = along - (along @ normal) * normal
    size = np.linalg.norm(flat)
    if size < _FLAT * np.linalg.norm(along):
        raise InputError(f"along: expected a direction along the surface, got {along}, which is that of its normal")
    direction: Array = flat / size
    return direction


def default_duration(pair: Pair) -> float:
    """Time to watch after the first touch [s]: 30 crossings of a longitudinal wave through the larger body."""
    crossings = [
        float(np.ptp(body.points, axis=0).max()) / body.material.bar_wave_speed
        for body in pair
        if isinstance(body, ReducedBody) and body.material is not None
    ]
    if not crossings:
        raise InputError("duration: expected a time in s, for these bodies are from files that tell no material")
    return _CROSSINGS * max(crossings)
