"""Hertz's theory: contact radius (paper, eq. 30) and the impact of two bodies on a Hertz spring."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ._checks import validate_positive
from .errors import InputError
from .material import Material

# Duration of a Hertz impact over approach / speed: 2 int_0^1 dx / sqrt(1 - x^(5/2)) = 2 B(2/5, 1/2) / (5/2).
_DURATION = 2 * math.sqrt(math.pi) * math.gamma(0.4) / (2.5 * math.gamma(0.9))


@dataclass(frozen=True)
class HertzImpact:
    """Impact of two bodies on a Hertz spring, all else rigid (Johnson, Contact Mechanics, section 11.4).

    Parameters
    ----------
    peak_force : float
        Largest force [N].
    approach : float
        Largest approach of the two bodies [m].
    duration : float
        Time in contact [s].
    contact_radius : float
        Radius of the contact circle at the peak [m].
    """

    peak_force: float
    approach: float
    duration: float
    contact_radius: float


def _combined(
    radius_1: float, radius_2: float, material_1: Material, material_2: Material | None
) -> tuple[float, float]:
    for name, radius in (("radius_1", radius_1), ("radius_2", radius_2)):
        if not radius > 0:
            raise InputError(f"{name}: expected a radius above zero [m], math.inf for a plane, got {radius!r}")
    curvature = 1 / radius_1 + 1 / radius_2
    if curvature == 0:
        raise InputError("radius_1, radius_2: two planes have no Hertz contact; one radius must be finite")
    compliance = 1 / material_1.plane_strain_modulus
    if material_2 is not None:
        compliance += 1 / material_2.plane_strain_modulus
    return 1 / curvature, 1 / compliance


def contact_radius(
    force: float, radius_1: float, radius_2: float, material_1: Material, material_2: Material | None = None
) -> float:
    """Radius of the contact circle under a force, (3 P R / 4 E*)^(1/3) (paper, eq. 30).

    Parameters
    ----------
    force : float
        P [N].
    radius_1, radius_2 : float
        Radii of the surfaces [m], `math.inf` for a plane.
    material_1, material_2 : Material
        Their materials; None for a rigid second body.

    Returns
    -------
    float
        [m]
    """
    R, E = _combined(radius_1, radius_2, material_1, material_2)
    return (3 * validate_positive("force", force, "N") * R / (4 * E)) ** (1 / 3)


def impact(
    mass: float,
    speed: float,
    radius_1: float,
    radius_2: float,
    material_1: Material,
    material_2: Material | None = None,
) -> HertzImpact:
    """Peak force, approach, duration and contact radius of an impact on a Hertz spring.

    Parameters
    ----------
    mass : float
        Effective mass m1 m2 / (m1 + m2) [kg]; the striker's own for a wall.
    speed : float
        Approach speed [m/s].
    radius_1, radius_2, material_1, material_2 :
        As for `contact_radius`.

    Returns
    -------
    HertzImpact
    """
    R, E = _combined(radius_1, radius_2, material_1, material_2)
    stiffness = 4 / 3 * E * math.sqrt(R)
    energy = validate_positive("mass", mass, "kg") * validate_positive("speed", speed, "m/s") ** 2
    approach = (1.25 * energy / stiffness) ** 0.4
    force = stiffness * approach**1.5
    return HertzImpact(force, approach, _DURATION * approach / speed, math.sqrt(R * approach))
