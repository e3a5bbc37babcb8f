"""Oblique impact of a ball on a rigid plane with Coulomb friction: the solution of Maw, Barber and Fawcett.

N. Maw, J.R. Barber, J.N. Fawcett, The oblique impact of elastic spheres, Wear 38 (1976) 101. The ball is rigid but for
its contact. Its partial slip is found with many springs by the method of dimensionality reduction, which is exact for
circular contacts of similar materials. The normal force is that of a whole elastic sphere.

Maw's contact is that of half-spaces along the tangent. With `whole`, the springs act through what a whole sphere yields
more, which is of the order of contact radius over radius, as in normal direction.
"""

import numpy as np

from validation.contact.elastic_sphere import ElasticSphere

SPRINGS, STEPS = 200, 8000
REACH = 0.05  # of the radius: where the springs end
SIZES = (0.01, 0.03)  # contact radii by the radius at which the whole sphere is asked
STUCK = 0.25  # mean logarithm of distances under Hertz's pressure, less that under the traction of what sticks
PASSES = 8  # each leaves a twentieth of the error


def oblique_impact(radius, material, speed, sliding, friction, duration, *, whole=True):
    """Times [s], normal and tangential forces [N], and energy that friction takes [J].

    `sliding` is the speed of the point of contact along the plane at the start [m/s].
    """
    mass, sphere = material.rho * 4 / 3 * np.pi * radius**3, ElasticSphere(radius, material)
    stiffening = sphere.stiffening
    modulus, shear = material.plane_strain_modulus, 4 * material.shear_modulus / (2 - material.nu)
    mobility = 3.5 / mass  # of the point of contact along the plane
    ends = np.linspace(0, REACH * radius, SPRINGS + 1)
    x, k = (ends[1:] + ends[:-1]) / 2, 2 * shear * np.diff(ends)

    def normal_force(depth):
        s = np.sqrt(max(depth, 0.0) / radius)
        return float(sphere.hertz(depth)) * (1 + stiffening[0] * s + stiffening[1] * s**2)

    rests = [sphere.rest(size * radius) for size in SIZES] if whole else [0.0, 0.0]
    slope = np.diff(rests)[0] / np.diff(np.log(SIZES))[0]

    def rest(square):
        """Flexibility beyond the half-space's, with a contact of a squared radius [m2]: [m/N]."""
        return rests[0] + slope * (0.5 * np.log(max(square, 1e-30)) - np.log(SIZES[0] * radius) + STUCK)

    t, stretch, yielded = np.linspace(0, duration, STEPS + 1), np.zeros(SPRINGS), 0.0
    depth, rate, slide, P, T = 0.0, speed, sliding, 0.0, 0.0
    normal, tangential, dt = [P], [T], t[1]
    for _ in t[1:]:
        rate, slide = rate - 0.5 * dt * P / mass, slide - 0.5 * dt * mobility * T
        depth = depth + dt * rate
        P = normal_force(depth)
        square = (0.75 * P * radius / modulus) ** (2 / 3)
        bound = friction * modulus / shear * k / radius * np.maximum(square - x**2, 0.0)
        before, most, flexibility = stretch, np.where(bound > 0, bound / k, 0.0), rest(square)
        for _ in range(PASSES):
            stretch = np.clip(before + dt * slide - (flexibility * T - yielded), -most, most)
            T = float(k @ stretch)
        yielded = flexibility * T
        rate, slide = rate - 0.5 * dt * P / mass, slide - 0.5 * dt * mobility * T
        normal.append(P)
        tangential.append(T)
    return t, np.array(normal), np.array(tangential), 0.5 * (sliding**2 - slide**2) / mobility
