"""Oblique impact of a ball on a rigid plane with Coulomb friction: the solution of Maw, Barber and Fawcett.

N. Maw, J.R. Barber, J.N. Fawcett, The oblique impact of elastic spheres, Wear 38 (1976) 101. The ball is rigid but for
its contact, which is that of half-spaces along the tangent. Its partial slip is found with many springs by the method
of dimensionality reduction, which is exact for circular contacts. The normal force is that of a whole elastic sphere.
"""

import numpy as np

from validation.contact.elastic_sphere import ElasticSphere

SPRINGS, STEPS = 200, 8000
REACH = 0.05  # of the radius: where the springs end


def oblique_impact(radius, material, speed, sliding, friction, duration):
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

    t, stretch = np.linspace(0, duration, STEPS + 1), np.zeros(SPRINGS)
    depth, rate, slide, P, T = 0.0, speed, sliding, 0.0, 0.0
    normal, tangential, dt = [P], [T], t[1]
    for _ in t[1:]:
        rate, slide = rate - 0.5 * dt * P / mass, slide - 0.5 * dt * mobility * T
        depth, stretch = depth + dt * rate, stretch + dt * slide
        P = normal_force(depth)
        square = (0.75 * P * radius / modulus) ** (2 / 3)
        bound = friction * modulus / shear * k / radius * np.maximum(square - x**2, 0.0)
        stretch = np.where(bound > 0, np.clip(k * stretch, -bound, bound) / k, 0.0)
        T = float(k @ stretch)
        rate, slide = rate - 0.5 * dt * P / mass, slide - 0.5 * dt * mobility * T
        normal.append(P)
        tangential.append(T)
    return t, np.array(normal), np.array(tangential), 0.5 * (sliding**2 - slide**2) / mobility
