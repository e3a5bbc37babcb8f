"""An oblique impact of a ball on a half-space, both elastic: squares with the exact flexibility of half-spaces.

Independent of finite elements, and without waves: the second method beside Kharaz' and Chung's impacts. Between unlike
materials, normal forces move the two surfaces sideways by different amounts, and they slip even without a tangential
force. Theories of oblique impacts (Maw, Barber, Fawcett 1976; Thornton) leave that out: `coupled=False`.
"""

import numpy as np

from exudyn_partition.algebra.friction import FrictionProblem
from validation.friction.kernel import grid, half_space

ACROSS, STEPS = 14, 250  # squares across the largest contact, steps in an impact


def shear(material):
    """Shear modulus [Pa]."""
    return material.E / (2 * (1 + material.nu))


def flexibility(centers, side, materials, coupled):
    """Of both surfaces against each other, (3n, 3n) [m/N]; sideways motions by normal forces are opposite."""
    first, second = (half_space(centers, side, shear(m), m.nu, coupled) for m in materials)
    kind = np.arange(len(first)) % 3 == 0
    return first + np.where(kind[:, None] == kind[None, :], second, -second)


def impact(radius, mass, materials, velocity, friction, *, coupled=True, inertia=0.4):
    """Velocities of the lowest point and of the centre after an impact with (along, down) velocity [m/s].

    Parameters
    ----------
    radius, mass : float
        Of the relative curvature [m], and of the ball, or half of it if two equal balls meet [kg].
    materials : (Material, Material)
    velocity : (float, float)
        Of the ball without spin, along the surface and towards it [m/s].
    friction : float
    coupled : bool
        Whether unlike surfaces slip under normal forces.
    inertia : float
        Moment of inertia over m R^2 of a ball.

    Returns
    -------
    dict of str to float
        "patch", "centre" along the surface, "normal" away from it [m/s].
    """
    along, down = velocity
    plane = 1 / sum((1 - m.nu**2) / m.E for m in materials)
    depth = (15 * mass * down**2 / (16 * plane * np.sqrt(radius))) ** 0.4
    a = np.sqrt(radius * depth)
    side = 2 * a / ACROSS
    centers = grid(int(1.2 * ACROSS), side)
    r = np.hypot(*centers.T)
    inside = r < 1.1 * a + side
    centers, height = centers[inside], r[inside] ** 2 / (2 * radius)
    F = flexibility(centers, side, materials, coupled)
    problem, mu = FrictionProblem(F), np.full(len(centers), friction)
    masses = np.array([mass, mass / (1 + 1 / inertia)])
    x, v, force, place = np.zeros(2), np.array([down, along]), np.zeros(2), np.zeros((len(centers), 2))
    dt, first = 2.943 * depth / down / STEPS, True
    while first or x[0] > 0:
        first = False
        x = x + dt * v + dt**2 / 2 * force / masses
        h = np.column_stack([height - x[0], x[1] - place[:, 0], -place[:, 1]])
        lam = problem.solve(h, mu)
        place = place + h[:, 1:] + (F @ lam.ravel()).reshape(-1, 3)[:, 1:]
        pressed, pulled = lam[:, :2].sum(axis=0)
        after = np.array([-pressed, pulled])
        v = v + dt / 2 * (force + after) / masses
        force = after
    centre = along + (v[1] - along) / (1 + 1 / inertia)
    return {"patch": float(v[1]), "centre": float(centre), "normal": float(-v[0])}
