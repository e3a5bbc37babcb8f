"""Contact of a whole elastic sphere with a rigid plane, by series: the limit of meshes of a sphere.

Hertz presses half-spaces. Here a sphere is pressed against a plane by its own inertia. For each Legendre component of
the surface traction, its deformation is Lurie's solution for the solid sphere (Theory of Elasticity, section 6.3). The
difference to Hertz is of the order of contact radius over radius, and no mesh can remove it. The contact is rings of
uniform pressure. Their middles must not enter the plane, on the deformed positions of the sphere's points and without
friction.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.integrate import solve_ivp

RINGS, TERMS, GAUSS = 60, 16_000, 12
EXTENT = 1.15  # of Hertz' contact radius: the outermost ring
SIZES = (0.015, 0.02, 0.03, 0.04, 0.055)  # sqrt(approach / radius) at which the force is computed


@dataclass(frozen=True)
class ElasticSphere:
    """A sphere of an `ep.Material` and radius [m] against a rigid plane; approach is that of its centre of mass."""

    radius: float
    material: object

    def hertz(self, approach):
        """Force by Hertz [N]."""
        return 4 / 3 * self.material.plane_strain_modulus * self.radius**0.5 * np.maximum(approach, 0.0) ** 1.5

    @cached_property
    def stiffening(self):
        """Force over that of Hertz, at sqrt(approach / radius) = s: coefficients of 1 + c0 s + c1 s^2."""
        s = np.array(SIZES)
        ratio = [self.contact(self.radius * x**2)[0] / self.hertz(self.radius * x**2) for x in s]
        return np.linalg.lstsq(np.stack([s, s**2], axis=1), np.array(ratio) - 1, rcond=None)[0]

    def force(self, approach):
        """Force [N]."""
        s = np.sqrt(np.maximum(approach, 0.0) / self.radius)
        return self.hertz(approach) * (1 + self.stiffening[0] * s + self.stiffening[1] * s**2)

    def contact(self, approach):
        """Force [N], contact radius [m], radii of the rings' middles [m] and their pressures [Pa]."""
        R, extent = self.radius, EXTENT * np.sqrt(approach / self.radius)
        edges = np.linspace(0, extent, RINGS + 1)
        middle = (edges[1:] + edges[:-1]) / 2
        yields = self._influence(edges, middle)
        depth = approach - R * (1 - np.cos(middle))
        closed = depth > 0
        while True:
            p = np.zeros(RINGS)
            p[closed] = np.linalg.solve(yields[np.ix_(closed, closed)], depth[closed])
            if (p >= 0).all():
                break
            closed &= p > 0
        area = 2 * np.pi * R**2 * -np.diff(np.cos(edges))
        return float(p @ area), R * edges[1:][closed][-1], R * middle, p

    def _influence(self, edges, at):
        """Motion of points at angles `at` away from the plane by unit vertical pressure on each ring [m/Pa]."""
        n = np.arange(TERMS)
        x, w = np.polynomial.legendre.leggauss(GAUSS)
        theta = (edges[:-1, None] + edges[1:, None] + np.diff(edges)[:, None] * x) / 2
        weight = np.diff(edges)[:, None] / 2 * w * np.sin(theta)
        P, dP = _legendre(np.r_[theta.ravel(), at])
        m = theta.size
        ring = (TERMS, len(edges) - 1, GAUSS)
        sigma = -np.einsum("nrg,rg->nr", P[:, :m].reshape(ring), weight * np.cos(theta)) * (n + 0.5)[:, None]
        tau = np.einsum("nrg,rg->nr", dP[:, :m].reshape(ring), weight * np.sin(theta))
        tau[1:] *= ((n + 0.5) / np.maximum(n * (n + 1), 1))[1:, None]
        radial, along = self._answers(sigma, tau)
        down = (P[:, m:] * np.cos(at)).T @ radial - (dP[:, m:] * np.sin(at)).T @ along
        return -self.radius * down

    def _answers(self, sigma, tau):
        """Motion along r and along the surface by radius, (TERMS, k), from the tractions of each degree, (TERMS, k).

        They are factors of a surface harmonic and of its gradient; which one of its degree is all the same.
        """
        mu, lam, nu, n = self.material.shear_modulus, self.material.lame, self.material.nu, np.arange(TERMS)
        # Solutions grad(r^n P_n) and Lurie's second one, from the tractions of degree n.
        A, B = np.zeros_like(sigma), np.zeros_like(sigma)
        k = n[2:, None].astype(float)
        a11, a12, a21, a22 = k * (k - 1), (k + 1) * (k**2 - k - 2 - 2 * nu), k - 1, k**2 + 2 * k - 1 + 2 * nu
        s, t, det = sigma[2:] / (2 * mu), tau[2:] / (2 * mu), a11 * a22 - a12 * a21
        A[2:], B[2:] = (a22 * s - a12 * t) / det, (a11 * t - a21 * s) / det
        B[0] = sigma[0] / (2 * mu * (-2 - 2 * nu))
        k = n[:, None]
        radial = k * A + (k + 1) * (k - 2 + 4 * nu) * B
        along = A + (k + 5 - 4 * nu) * B
        # Degree 1 accelerates the sphere: c r^2 e_z answers the inertia; the centre of mass stays.
        c = (sigma[1] + 2 * tau[1]) / (2 * lam + 8 * mu)
        b = (tau[1] / (2 * mu) - c) / (2 + 2 * nu)
        shift = -0.6 * c - 2 * b
        radial[1], along[1] = c + 2 * (4 * nu - 1) * b + shift, c + (6 - 4 * nu) * b + shift
        return radial, along

    def rest(self, contact_radius):
        """Tangential flexibility of the sphere beyond a half-space's [m/N], under and over Hertz's pressure.

        The traction has the shape of that pressure over the contact radius [m], and follows the surface of the sphere.
        Of each degree, its part that is a gradient is Lurie's solution, and the other one turns shells.
        """
        R, nu, mu, n = self.radius, self.material.nu, self.material.shear_modulus, np.arange(TERMS, dtype=float)
        x, w = np.polynomial.legendre.leggauss(200)
        psi = np.pi / 4 * (x + 1)
        theta, traction = contact_radius / R * np.sin(psi), np.cos(psi)
        weight = traction * w * np.pi / 4 * contact_radius / R * np.cos(psi) * np.sin(theta)
        total = np.pi * R**2 * np.sum(weight * (np.cos(theta) + 1))
        P, dP = _legendre(theta)
        both = dP * ((1 - np.cos(theta)) / np.sin(theta)) - (n * (n + 1))[:, None] * P
        size = np.maximum(2 * np.pi * (n * (n + 1)) ** 2 / (2 * n + 1), 1.0)
        shares = np.pi * (both @ weight) / size
        shares[0] = 0.0
        along = self._answers(np.zeros((TERMS, 1)), shares[:, None])[1][:, 0]
        turning = np.r_[0.0, shares[1] / 7, shares[2:] / (n[2:] - 1)] / mu
        whole = R**3 * np.sum(size * shares * (along + turning)) / total**2
        half_space = 0.6 * (2 - nu) / (2 - 2 * nu) / (self.material.plane_strain_modulus * contact_radius)
        return float(whole - half_space)

    def impact(self, speed, *, two=False):
        """Peak force [N], approach [m] and duration [s] of a sphere hitting a plane, or another one like it.

        By symmetry each of two equal spheres meets a rigid plane, with half of the speed and of the approach.
        """
        if two:
            peak, approach, duration = self.impact(speed / 2)
            return peak, 2 * approach, duration
        mass = self.material.rho * 4 / 3 * np.pi * self.radius**3
        unit = self.radius * (mass * speed**2 / self.hertz(self.radius) / self.radius) ** 0.4

        def rates(t, y):
            return [y[1], -self.force(unit * y[0]) * unit / (mass * speed**2)]

        def parts(t, y):
            return y[0] if t > 1 else 1.0

        def turns(t, y):
            return y[1]

        parts.terminal = True
        run = solve_ivp(rates, (0, 10), (0.0, 1.0), events=(turns, parts), rtol=1e-10, atol=1e-12)
        deepest = unit * run.y_events[0][0][0]
        return float(self.force(deepest)), float(deepest), float(run.t[-1] * unit / speed)


def _legendre(theta):
    """P_n and its derivative by theta, (TERMS, k) each."""
    x, s = np.cos(theta), np.sin(theta)
    P, dP = np.empty((TERMS, len(theta))), np.zeros((TERMS, len(theta)))
    P[0], P[1] = 1.0, x
    dP[1] = -s
    for n in range(2, TERMS):
        P[n] = ((2 * n - 1) * x * P[n - 1] - (n - 1) * P[n - 2]) / n
        dP[n] = dP[n - 2] - (2 * n - 1) * s * P[n - 1]
    return P, dP
