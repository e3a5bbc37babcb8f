"""A radial bearing of massless balls on Hertz springs between rigid races: what the elastic balls are compared with.

The approach of a ball and a race is that of half spaces in an elliptic contact (Johnson, Contact Mechanics, 1985,
section 4.2). Forces of the balls balance the load (Stribeck 1901): without clearance the largest is 4.37 times the
load over the number of balls.
"""

import numpy as np
from scipy.optimize import brentq, fsolve
from scipy.special import ellipe, ellipk

from .ball_bearing import BALLS, PITCH, RADIUS, SOFT, STEEL


def approach(force, side):
    """Approach [m] of a ball under a force [N] on the race of the shaft, side -1, or the outer one, side 1."""
    low, high = sorted((1 / RADIUS, 1 / RADIUS - side / (PITCH + side * RADIUS)))  # curvatures [1/m]

    def integrals(ratio):
        square = 1 - ratio**-2
        return ellipk(square), ellipe(square), square

    def excess(ratio):
        K, E, _ = integrals(ratio)
        return (ratio**2 * E - K) / (K - E) - high / low

    K, E, square = integrals(brentq(excess, 1 + 1e-6, 1e3))
    modulus = STEEL.plane_strain_modulus  # the races are rigid
    semi_axis = np.cbrt(3 * force * (K - E) / (np.pi * modulus * low * square))
    return 3 * force * K / (2 * np.pi * modulus * semi_axis)


STIFFNESS = (approach(1.0, -1) + approach(1.0, 1)) ** -1.5  # force by approach^(3/2) between both races [N/m^(3/2)]


def equilibrium(load, clearance, angles):
    """Place of the shaft, (2,) [m], and forces of the balls, (n,) [N], under a load along -y [N]."""
    unit = (load / (BALLS * STIFFNESS)) ** (2 / 3)

    def forces(place):
        nearer = place[0] * np.cos(angles) + place[1] * np.sin(angles) - clearance / 2
        return STIFFNESS * np.maximum(nearer, 0) ** 1.5

    def unbalanced(scaled):
        place, own = unit * scaled, forces(unit * scaled)
        away = np.array([own @ np.cos(angles), own @ np.sin(angles) + load]) + SOFT * place
        return away / load

    place = unit * fsolve(unbalanced, [0.0, -2.6 - clearance / 2 / unit], xtol=1e-12)
    return place, forces(place)
