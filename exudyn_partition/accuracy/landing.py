"""Where a part that falls touches a plane first, and how fine its mesh must be there.

Small elements all over a skin would cost far more than the first impact needs. Later impacts at other places have the
elements of the rest, and the review of a run tells where these do not resolve them.
"""

from __future__ import annotations

import math

import numpy as np

from ..contact.rigid import RigidPlane
from ..errors import InputError
from ..fe.model import FEModel
from ..meshing.mesh_size import Refine
from ..prediction.hertz import impact
from ..support.arrays import Array
from ..support.foreign import Shape
from .contact_place import contact_place
from .mesh_rules import QUADRATIC, REFINED, near_size

_TOLERANCE = 0.04  # of the first peak of the force, as far as the mesh decides it


def landing(shape: Shape, fem: FEModel, normal: Array, speed: float) -> Refine | None:
    """Refinement where a part first touches a plane; None where an edge, a corner or a face touches it.

    Parameters
    ----------
    shape : netgen.occ.TopoDS_Shape
        The part [m].
    fem : FEModel
        Of its first mesh.
    normal : (3,) array
        Outward unit normal of the plane, in the axes of the shape.
    speed : float
        At which the part moves towards the plane [m/s].
    """
    lowest = fem.points[(fem.points @ normal).argmin()]
    mass = _effective_mass(fem, lowest, normal)

    def circle_of(radius: float) -> float:
        return impact(mass, speed, radius, math.inf, fem.material).contact_radius

    try:
        place = contact_place([shape], RigidPlane(point=lowest, normal=normal), lowest, circle_of)
    except InputError:  # it is no point of a smooth surface
        return None
    # The part's true lowest point: from there on its normal turns away from the plane's by the curvatures.
    tilt, along, across = -normal - place.normal, place.along, np.cross(place.normal, place.along)
    aside = sum(t * (tilt @ t) / k for t, k in zip((along, across), place.curvatures, strict=True))
    circle = circle_of(place.radius)
    radius, long_axis = place.region(circle, REFINED)
    size = QUADRATIC * near_size(place.semi_axes(circle), _TOLERANCE, slave=True)
    return Refine(place.points[0] + aside, radius, size, long_axis=long_axis)


def _effective_mass(fem: FEModel, point: Array, normal: Array) -> float:
    """Mass of a free rigid body that resists a force at a point along a normal [kg]."""
    turning = np.cross(point - fem.centre_of_mass, normal)
    return float(1 / (1 / fem.total_mass + turning @ np.linalg.solve(fem.inertia_tensor, turning)))
