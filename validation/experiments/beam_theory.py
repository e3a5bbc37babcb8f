"""Beam theory for the experiments here: free modes of Timoshenko beams and rods, and impacts of Hertz springs on them.

Independent of the library: two-node elements with shape functions of static Timoshenko beams (Friedman and Kosmatka
1993), whose modes are integrated with small explicit steps. Friction is that of Mindlin's tangential spring with a
slider at its end.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg


@dataclass(frozen=True)
class Section:
    """A prismatic bar: material, area [m2], second moment [m4], shear factor; no shear by a factor of infinity."""

    material: object
    area: float
    inertia: float
    shear: float


def circle(material, diameter):
    """Round section; the shear factor is Cowper's."""
    nu = material.nu
    return Section(material, np.pi * diameter**2 / 4, np.pi * diameter**4 / 64, 6 * (1 + nu) / (7 + 6 * nu))


def square(material, side):
    """Square section; the shear factor is Cowper's."""
    nu = material.nu
    return Section(material, side**2, side**4 / 12, 10 * (1 + nu) / (12 + 11 * nu))


def bending_element(section, h):
    """Stiffness and mass of an element of length h, of deflection and slope at both ends, (4, 4) each."""
    material, area, inertia = section.material, section.area, section.inertia
    ei = material.E * inertia
    phi = 12 * ei / (section.shear * area * material.E / (2 * (1 + material.nu)) * h**2)
    stiffness = (
        ei / (h**3 * (1 + phi))
        * np.array([
            [12, 6 * h, -12, 6 * h],
            [6 * h, (4 + phi) * h**2, -6 * h, (2 - phi) * h**2],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, (2 - phi) * h**2, -6 * h, (4 + phi) * h**2],
        ])
    )  # fmt: skip
    x, weights = np.polynomial.legendre.leggauss(4)
    x, weights, mass = (x + 1) / 2, weights * h / 2, np.zeros((4, 4))
    for s, w in zip(x, weights, strict=True):
        deflection = np.array([
            1 - 3 * s**2 + 2 * s**3 + phi * (1 - s), h * (s - 2 * s**2 + s**3 + phi / 2 * (s - s**2)),
            3 * s**2 - 2 * s**3 + phi * s, h * (-(s**2) + s**3 - phi / 2 * (s - s**2)),
        ]) / (1 + phi)  # fmt: skip
        turn = np.array([
            6 / h * (s**2 - s), 1 - 4 * s + 3 * s**2 + phi * (1 - s),
            -6 / h * (s**2 - s), -2 * s + 3 * s**2 + phi * s,
        ]) / (1 + phi)  # fmt: skip
        mass += material.rho * w * (area * np.outer(deflection, deflection) + inertia * np.outer(turn, turn))
    return stiffness, mass


def bending(section, length, elements):
    """Stiffness and mass of a beam, of (deflection, slope) at each node."""
    n, part = 2 * (elements + 1), bending_element(section, length / elements)
    stiffness, mass = np.zeros((n, n)), np.zeros((n, n))
    for i in range(elements):
        at = slice(2 * i, 2 * i + 4)
        stiffness[at, at] += part[0]
        mass[at, at] += part[1]
    return stiffness, mass


def stretching(section, length, elements):
    """Stiffness and mass of a rod, of the displacement along it at each node; mass between lumped and consistent."""
    n, h = elements + 1, length / elements
    stiffness, mass = np.zeros((n, n)), np.zeros((n, n))
    for i in range(elements):
        at = slice(i, i + 2)
        stiffness[at, at] += section.material.E * section.area / h * np.array([[1, -1], [-1, 1]])
        mass[at, at] += section.material.rho * section.area * h / 12 * np.array([[5, 1], [1, 5]])
    return stiffness, mass


def modes(stiffness, mass, highest):
    """Angular frequencies up to `highest` [rad/s], and mass-normalised shapes."""
    squares, shapes = scipy.linalg.eigh(stiffness, mass, subset_by_value=(-np.inf, highest**2))
    return np.sqrt(np.maximum(squares, 0.0)), shapes


@dataclass(frozen=True)
class Impact:
    """Force over time of an impact, and what follows from it."""

    t: np.ndarray
    force: np.ndarray
    along: np.ndarray

    @property
    def impulse(self):
        """Normal one [Ns]."""
        return float(np.trapezoid(self.force, self.t))

    @property
    def impulse_along(self):
        """Of friction [Ns]."""
        return float(np.trapezoid(self.along, self.t))

    def contacts(self):
        """Start, end and peak of each contact [s, s, N]."""
        edges = np.flatnonzero(np.diff(np.r_[0, self.force > 0, 0]))
        return [
            (float(self.t[a]), float(self.t[min(b, len(self.t) - 1)]), float(self.force[a:b].max()))
            for a, b in edges.reshape(-1, 2)
        ]


def impact(omega, normal, speeds, hertz, end, step, *, along=None, friction=0.0, ratio=1.0):
    """Impact of modes on a Hertz spring.

    Parameters
    ----------
    omega : (n,) array
        [rad/s]
    normal, along : (n,) arrays
        Work of a unit of normal, and of tangential, force on the modes.
    speeds : (n,) array
        Of the modes at the start; the spring just touches.
    hertz : float
        Force over approach to the power 3/2 [N/m^1.5].
    friction : float
        Coefficient.
    ratio : float
        Tangential over normal stiffness of the spring.
    """
    q, v, count = np.zeros_like(omega), np.array(speeds, dtype=float), int(np.ceil(end / step))
    square, force, tangential = omega**2, np.zeros(count + 1), np.zeros(count + 1)
    pull = place = last = 0.0
    for i in range(1, count + 1):
        q = q + step * v
        approach = max(-(normal @ q), 0.0)
        force[i] = hertz * approach**1.5
        push = normal * force[i]
        if friction:
            now, stiffness = along @ q, ratio * 1.5 * hertz * approach**0.5
            # Area that is new carries nothing yet; area that is lost takes its share away.
            pull = pull * min(1.0, stiffness / last) if last else 0.0
            pull -= stiffness * (now - place)
            bound = friction * force[i]
            pull, place, last = min(max(pull, -bound), bound), now, stiffness
            tangential[i] = pull
            push = push + along * pull
        v = v + step * (push - square * q)
    return Impact(step * np.arange(count + 1), force, tangential)
