"""Inertia of a deformable body in a floating frame: mean axes at the centre of mass.

With x = r + A (X - c + Phi z), shapes Phi mass-normalised and orthogonal to rigid motion, the kinetic energy is

    T = m r_t^2 / 2 + omega' J(z) omega / 2 + omega' C(z) z_t + z_t' z_t / 2,

where omega is the angular velocity. All components but those of r are in the body's axes. J is quadratic in z and C is
linear, so integrals of products of two shapes are enough. Lagrange's equations, with outer forces (tau, f), are:

    J(z) omega_t + C(z) z_tt  = tau - omega x (J(z) omega + C(z) z_t) - J_t omega
    z_tt + C(z)' omega_t + K z = f + d(omega' J(z) omega)/dz / 2 + 2 (omega . N) z_t

These are the paper's equations of motion of one body (eq. 6 to 9). On the right-hand side, the parts with omega are -w
(eq. 8b). The paper sums over accelerations of nodes (eq. 2b, 4b, 5b); here the integrals over the body are computed
beforehand.

Shabana, Dynamics of Multibody Systems (2013), chapter 5; mean axes: Agrawal and Shabana (1985).

Theory: examples/site/theory.md, "Floating frame".
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Literal, NamedTuple

import numpy as np

from ..reduction.inertia import PLACE
from ..support.arrays import Array
from . import loops
from .inertia import Inertia, angular_acceleration
from .rotations import skew

InertiaTerm = Literal["gyroscopic", "coriolis", "centrifugal", "coupling"]

TERMS: dict[InertiaTerm, str] = {
    "gyroscopic": "gyroscopic torque omega x J omega: the axis of rotation stays where it is in the body",
    "coriolis": "Coriolis forces of vibration and rotation on each other",
    "centrifugal": "centrifugal forces: rotation does not stretch the body",
    "coupling": "inertia that changes with deformation, but for that of gyroscopic, Coriolis and centrifugal forces",
}
"""Inertia forces of a floating frame, and what the model lacks without each of them."""


class StepStart(NamedTuple):
    """Start of a step.

    Parameters
    ----------
    half_step : float
        Half of the step's length [s].
    z : (n,) array
        Elastic coordinates.
    q_t, q_tt : (3 + n,) arrays
        Angular velocity in the body's axes and velocities of the elastic coordinates; their accelerations.
    """

    half_step: float
    z: Array
    q_t: Array
    q_tt: Array


class InertiaForces:
    """Inertia forces on constant mass diag(J, 1): what a solver is given instead of the equations above.

    The true mass changes with deformation and would have to be factorised in every step. Instead, accelerations by
    inertia and elastic forces are computed here with the true mass, and returned times the constant mass. This takes
    one 3 x 3 solve, because the elastic mass is the identity. Outer forces must then do the same. Where some act on the
    constant mass, so must all, without `coupling`: see `FloatingKinematics.on_constant_mass`.

    Parameters
    ----------
    inertia : Inertia
    elastic : callable
        Elastic forces K z, (n,), of the elastic coordinates z, (n,).
    terms : collection of str
        Those of `TERMS` to be kept.
    """

    def __init__(
        self,
        inertia: Inertia,
        elastic: Callable[[Array], Array],
        terms: Collection[InertiaTerm] = tuple(TERMS),
    ) -> None:
        self.tensor, self._inertia = inertia.tensor, inertia
        self.elastic = elastic
        self.gyroscopic, self.coriolis, self.centrifugal, self.coupling = (name in terms for name in TERMS)
        self._all = self.gyroscopic and self.coriolis and self.centrifugal

    def on_body(self, q: Array, q_t: Array, start: StepStart | None = None, *, constant_mass: bool = False) -> Array:
        """Generalised forces, (6 + n,), at coordinates q and velocities q_t, (6 + n,); see `force`.

        With the start of a step of VelocityVerlet, the velocities are those in the middle of the step. Inertia forces
        from them would be of first order, and add energy to modes of equal frequency. So those of `end_velocities` are
        taken.
        """
        z, coupling = q[6:], self.coupling and not constant_mass
        half_step, change, then = 0.0, z, (z, z)
        if start is not None:
            half_step, change, then = start.half_step, self.elastic(z - start.z), (start.q_t, start.q_tt)
        if self._all:
            elastic = self.elastic(z) if coupling else z
            at_once = loops.frame_force(self._inertia, elastic, change, coupling, q, q_t, then, half_step)
            if at_once is not None:
                return at_once
        v = q_t[3:]
        if start is not None:
            v = self.end_velocities(v, z - start.z, *then, half_step)
        return np.concatenate([np.zeros(3), self.force(v[:3], z, v[3:], constant_mass=constant_mass)])

    def end_velocities(self, middle: Array, way: Array, q_t: Array, q_tt: Array, half_step: float) -> Array:
        """Velocities at the end of a step of VelocityVerlet, (3 + n,), from those in its middle.

        The remaining half step takes the accelerations at the start of the step. Only elastic and Coriolis forces are
        updated, because they change fast and their change is known.

        Parameters
        ----------
        middle : (3 + n,) array
            Angular velocity in the body's axes and velocities of the elastic coordinates, in the middle of the step.
        way : (n,) array
            Change of the elastic coordinates in the step.
        q_t, q_tt : (3 + n,) arrays
            Velocities and accelerations at its start.
        half_step : float
            Half of its length [s].
        """
        change = self.elastic(way)
        v = middle + half_step * q_tt
        v[3:] -= half_step * change
        if self.coriolis:
            v[3:] += 2 * half_step * (v[:3] @ self._inertia.crossed(v[3:] - q_t[3:]))
        return v

    def force(self, omega: Array, z: Array, z_t: Array, *, constant_mass: bool = False) -> Array:
        """Torque in the body's axes [N m] and forces on the elastic coordinates, (3 + n,).

        Parameters
        ----------
        omega : (3,) array
            Angular velocity in the body's axes [rad/s].
        z, z_t : (n,) array
            Elastic coordinates and their velocities.
        constant_mass : bool, optional
            Leave out `coupling`, because other forces on the body act on the constant mass.
        """
        coupling = self.coupling and not constant_mass
        by_place, J, C, cross_t = self._inertia.products(z, z_t)
        torque, force, turn = np.zeros(3), np.zeros(len(z)), skew(omega)
        if self.gyroscopic:
            torque -= turn @ (J @ omega)
        if self.coriolis:
            J_t = 2 * (by_place @ z_t)[PLACE]
            torque -= turn @ (C @ z_t) + J_t @ omega
            force += 2 * (omega @ cross_t)
        if self.centrifugal:
            force += _products(omega) @ by_place
        if coupling:
            omega_t = angular_acceleration(J, C, torque, force - self.elastic(z))
            torque, force = self.tensor @ omega_t, force - C.T @ omega_t
        return np.concatenate([torque, force])

    def derivatives(self, omega: Array, z: Array, z_t: Array) -> tuple[Array, Array]:
        """Derivatives of `force` by z, (3 + n, n), and by omega and z_t, (3 + n, 3 + n).

        The derivatives of the coupling are left out. They are of second order in the deformation, and only Newton's
        method uses the result.
        """
        if self._all and (at_once := loops.inertia_derivatives(self._inertia, omega, z, z_t)) is not None:
            return at_once
        by_place, J, C, cross_t = self._inertia.products(z, z_t)
        n = len(z)
        by_z, by_velocity = np.zeros((3 + n, n)), np.zeros((3 + n, 3 + n))
        turn, J_omega = skew(omega), by_place[PLACE].transpose(0, 2, 1) @ omega  # d(J omega)/dz = 2 J_omega
        if self.gyroscopic:
            by_z[:3] -= 2 * turn @ J_omega
            by_velocity[:3, :3] += skew(J @ omega) - turn @ J
        if self.coriolis:
            J_t = 2 * (by_place @ z_t)[PLACE]
            by_shape_t = self._inertia.by_shapes(z_t)[PLACE].transpose(0, 2, 1) @ omega
            by_z[:3] -= turn @ cross_t + 2 * by_shape_t
            by_velocity[:3, :3] += skew(C @ z_t) - J_t
            by_velocity[:3, 3:] -= turn @ C + 2 * J_omega
            by_velocity[3:, :3] += 2 * cross_t.T
            by_velocity[3:, 3:] += 2 * self._inertia.cross_form(omega)
        if self.centrifugal:
            by_velocity[3:, :3] += 2 * J_omega.T
            by_z[3:] += self._inertia.inertia_form(_products(omega))
        return by_z, by_velocity


def _products(omega: Array) -> Array:
    """Weights of the six components in omega' J omega."""
    a, b, c = omega
    return np.array([a * a, b * b, c * c, 2 * b * c, 2 * a * c, 2 * a * b])
