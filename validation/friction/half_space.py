"""Friction of a sphere on an elastic half-space of exact flexibility: Maw's curve, Cattaneo and Mindlin.

The solver of friction alone is measured here: rows are squares on a half-space, and bodies are rigid elsewhere. Normal
forces move no square sideways, as the theories assume.

Impact (Maw, Barber, Fawcett 1976): a sphere hits with the tangential velocity v_T at its lowest point. With kappa = 2
(1 - nu)/(2 - nu) and psi = kappa v_T / (mu v_N), the rebound psi2 depends on the incidence psi1 alone. Limit: 0.005.

Contact at rest under P: c/a = (1 - Q/(mu P))^(1/3) is the radius of the stick zone, and Q is a function of the way
delta. Limits: Q 2 %, c 3 % of a, and 3 % for the energy that friction takes in a cycle of +-Q.

    python -m validation.friction.half_space
"""

import argparse

import numpy as np
from rich.console import Console

from exudyn_partition.algebra.friction import SLIP, STICK, FrictionProblem
from validation.contact import scenes
from validation.friction.kernel import grid, half_space

RADIUS, SPEED, MU = 10e-3, 0.5, 0.3  # m, m/s
E, NU, RHO = 210e9, 0.3, 7850.0
SHEAR, PLANE = E / (2 + 2 * NU), E / (1 - NU**2)
MASS = 4 / 3 * np.pi * RHO * RADIUS**3
KAPPA = 2 * (1 - NU) / (2 - NU)
REST = 0.3e-3  # contact radius at rest [m]
ACROSS, STEPS = 18, 400  # squares across the largest contact, steps in an impact
MAW = {0.25: 0.042, 0.5: 0.048, 1.0: -0.060, 1.5: -0.428, 2.0: -0.837, 2.5: -1.162, 3.0: -1.380, 3.5: -1.477,
       4.0: -1.437, 4.5: -1.218, 6.0: 0.235, 8.0: 2.235}  # psi1: psi2, nu = 0.3  # fmt: skip
LIMITS = {"maw": 0.005, "force": 0.02, "stick_radius": 0.03, "loss": 0.03}


class Squares:
    """A rigid sphere on squares of a half-space, which remember where they stuck."""

    def __init__(self, radius_of_contact):
        side = 2 * radius_of_contact / ACROSS
        centers = grid(int(1.2 * ACROSS), side)
        r = np.hypot(*centers.T)
        inside = r < 1.1 * radius_of_contact + side
        self.centers, self.area, self.height = centers[inside], side**2, r[inside] ** 2 / (2 * RADIUS)
        self.flexibility = half_space(self.centers, side, SHEAR, NU, coupled=False)
        self.problem = FrictionProblem(self.flexibility)
        self.mu, self.place = np.full(len(self.centers), MU), np.zeros((len(self.centers), 2))
        self.dissipated, self.last = 0.0, np.zeros((len(self.centers), 3))

    def press(self, approach, way):
        """Normal and tangential force on the sphere after it has come nearer and moved to `way` along x [N]."""
        h = np.column_stack([self.height - approach, way - self.place[:, 0], -self.place[:, 1]])
        lam = self.problem.solve(h, self.mu)
        slip = h[:, 1:] + (self.flexibility @ lam.ravel()).reshape(-1, 3)[:, 1:]
        self.dissipated -= 0.5 * np.sum(slip * (lam + self.last)[:, 1:])
        self.place, self.last = self.place + slip, lam
        return lam[:, :2].sum(axis=0)

    def radius(self, *states):
        """Radius of a disc with the area of the squares in these states [m]."""
        return np.sqrt(np.sum(np.isin(self.problem.state, states) * self.area) / np.pi)


def impact(psi1):
    """Rebound psi2, the balance of energy, and the history of forces, of one impact."""
    depth = (15 * MASS * SPEED**2 / (16 * PLANE * np.sqrt(RADIUS))) ** 0.4
    squares = Squares(np.sqrt(RADIUS * depth))
    mass = np.array([MASS, MASS / 3.5])  # of the sphere, and at its lowest point along the surface
    dt = 2.943 * depth / SPEED / STEPS
    x, v, force = np.zeros(2), np.array([SPEED, psi1 * MU * SPEED / KAPPA]), np.zeros(2)
    energy, history = mass @ v**2 / 2, []
    while not history or x[0] > 0:
        x = x + dt * v + dt**2 / 2 * force / mass
        pressed, pulled = squares.press(*x)
        after = np.array([-pressed, pulled])
        v = v + dt / 2 * (force + after) / mass
        force = after
        history.append([*force, squares.radius(STICK), squares.radius(STICK, SLIP)])
    problem = squares.problem
    return {
        "psi2": v[1] * KAPPA / (MU * SPEED),
        "energy": (mass @ v**2 / 2 + squares.dissipated) / energy - 1,
        "steps": len(history),
        "newton_steps": problem.iterations / len(history),
        "factorisations": problem.factorisations / len(history),
        "sweeps": problem.sweeps,
        "history": np.array(history),
    }


def at_rest(squares, a, share=0.8, points=40):
    """Load up to `share` of mu P and a whole cycle at a contact radius near a [m], against Cattaneo and Mindlin."""
    approach = a**2 / RADIUS
    normal = squares.press(approach, 0.0)[0]
    a = (3 * normal * RADIUS / (4 * PLANE)) ** (1 / 3)
    slope = 3 * MU * normal * (2 - NU) / (16 * a * SHEAR)
    top = slope * (1 - (1 - share) ** (2 / 3))
    ways, forces, sticks, expected = [], [], [], []
    for way in top * np.arange(1, points + 1) / points:
        forces.append(-squares.press(approach, way)[1])
        ways.append(way)
        sticks.append(squares.radius(STICK) / squares.radius(STICK, SLIP))
        expected.append(MU * normal * (1 - (1 - way / slope) ** 1.5))
    forces, expected = np.array(forces), np.array(expected)
    for way in top * np.cos(np.pi * np.arange(1, 2 * points + 1) / (2 * points)):
        squares.press(approach, way)
    before, loop = squares.dissipated, []
    for way in -top * np.cos(2 * np.pi * np.arange(1, 4 * points + 1) / (4 * points)):
        loop.append([way, -squares.press(approach, way)[1]])
    q = max(abs(np.array(loop)[:, 1])) / (MU * normal)
    loss = 9 * (MU * normal) ** 2 / (10 * a) * (2 - NU) / SHEAR
    loss *= 1 - (1 - q) ** (5 / 3) - 5 * q / 6 * (1 + (1 - q) ** (2 / 3))
    radius = (1 - forces / (MU * normal)) ** (1 / 3)
    return {
        "force": np.max(abs(forces / expected - 1)),
        "stick_radius": np.max(abs(np.array(sticks) - radius)),
        "loss": (squares.dissipated - before) / loss - 1,
        "amplitude": q,
        "way": np.array(ways) / slope,
        "forces": forces / (MU * normal),
        "expected": expected / (MU * normal),
        "sticks": sticks,
        "radius": radius,
        "loop": np.array(loop) / [slope, MU * normal],
    }


def draw(impacts, rest):
    path, (_, axes) = scenes.figure(__file__, ncols=3, figsize=(15, 4.5))
    psi = list(MAW)
    axes[0].plot(psi, list(MAW.values()), "k-", label="Maw, Barber, Fawcett")
    axes[0].plot(psi, [impacts[key]["psi2"] for key in psi], "C0o", mfc="none", label="squares on a half-space")
    axes[0].set(xlabel="psi1, incidence", ylabel="psi2, rebound")
    for key in (0.5, 2.0, 4.0):
        history = impacts[key]["history"] / MU
        axes[1].plot(np.linspace(0, 1, len(history)), history[:, 1], label=f"psi1 = {key:g}")
    axes[1].plot(np.linspace(0, 1, len(history)), -MU * history[:, 0], "k:", label="normal force")
    axes[1].plot(np.linspace(0, 1, len(history)), MU * history[:, 0], "k:")
    axes[1].set(xlabel="time / duration", ylabel="tangential force / mu [N]")
    axes[2].plot(rest["way"], rest["expected"], "k", label="Q, Cattaneo and Mindlin")
    axes[2].plot(rest["way"], rest["forces"], "C0o", mfc="none", label="Q / (mu P)")
    axes[2].plot(rest["way"], rest["radius"], "k--", label="c, Cattaneo and Mindlin")
    axes[2].plot(rest["way"], rest["sticks"], "C1s", mfc="none", label="c / a")
    axes[2].plot(*rest["loop"].T, "C2-", lw=0.8, label="cycle")
    axes[2].set(xlabel="delta / delta of full slip")
    for ax in axes:
        ax.legend(fontsize=7)
    axes[0].figure.savefig(path, dpi=120)


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    rest, impacts, console = at_rest(Squares(REST), REST), {}, Console(width=150)
    for psi1, psi2 in MAW.items():
        impacts[psi1] = found = impact(psi1)
        found["error"] = found["psi2"] - psi2
        console.print(
            f"psi1 {psi1:4.2f}: psi2 {found['psi2']:+.4f}, off by {found['error']:+.4f}; "
            f"energy {found['energy']:+.1e}; {found['newton_steps']:.1f} Newton steps and "
            f"{found['factorisations']:.2f} factorisations a step"
        )
    draw(impacts, rest)
    found = {"maw": max(abs(case["error"]) for case in impacts.values())}
    found |= {key: float(rest[key]) for key in ("force", "stick_radius", "loss")}
    console.print(found)
    curves = {psi1: {k: v for k, v in case.items() if k != "history"} for psi1, case in impacts.items()}
    result = {"found": found, "limits": LIMITS, "impacts": curves, "amplitude": rest["amplitude"],
              "squares_across": ACROSS, "steps_of_an_impact": STEPS}  # fmt: skip
    scenes.finish(__file__, result, [f"{key} {found[key]:.3g}" for key in LIMITS if abs(found[key]) > LIMITS[key]])


if __name__ == "__main__":
    main()
