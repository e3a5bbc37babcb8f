"""A ball on a thin wide plate by Zener (1941): a Hertz spring in series with the plate's wave impedance."""

from dataclasses import dataclass

import numpy as np
import scipy.integrate


@dataclass(frozen=True)
class Rebound:
    """Restitution, largest force [N] and time of contact [s]; without units if so is what they come from."""

    e: float
    force: float
    duration: float


def impedance(plate, thickness):
    """Force over velocity at a point of a thin infinite plate [Ns/m]."""
    stiffness = plate.E * thickness**3 / (12 * (1 - plate.nu**2))
    return 8 * np.sqrt(stiffness * plate.rho * thickness)


def inelasticity(ball, plate, radius, thickness, speed):
    """Zener's parameter lambda, and the mass [kg] and time [s] that make it one without units."""
    mass = 4 / 3 * np.pi * radius**3 * ball.rho
    effective = 1 / ((1 - ball.nu**2) / ball.E + (1 - plate.nu**2) / plate.E)
    time = (mass / (4 / 3 * effective * np.sqrt(radius * speed))) ** 0.4
    return mass / (impedance(plate, thickness) * time), mass, time


def rebound(parameter):
    """Solve d'' + lambda (d^1.5)' + d^1.5 = 0 from d = 0, d' = 1; all without units."""

    def rate(t, state):
        d, v = state
        d = max(d, 0.0)
        return [v, -parameter * 1.5 * np.sqrt(d) * v - d**1.5]

    def opened(t, state):
        return state[0] if t > 0.1 else 1.0

    opened.terminal, opened.direction = True, -1
    found = scipy.integrate.solve_ivp(rate, (0, 50), [0.0, 1.0], events=opened, rtol=1e-10, atol=1e-13, max_step=0.01)
    force = np.maximum(found.y[0], 0.0) ** 1.5
    # The ball's own velocity: what the force has taken from it.
    return Rebound(np.trapezoid(force, found.t) - 1, force.max(), found.t[-1])


def impact(ball, plate, radius, thickness, speed):
    """Restitution, force [N] and time [s] of a ball on a plate."""
    parameter, mass, time = inelasticity(ball, plate, radius, thickness, speed)
    found = rebound(parameter)
    return Rebound(found.e, found.force * mass * speed / time, found.duration * time)
