"""A chain of steel beads: speed of its solitary wave against its force (Nesterenko 1984; Coste, Falcon, Fauve 1997).

Coste and others measured a chain of beads of 8 mm and found V = 0.6802 (2 E / (a rho^1.5 (1 - nu^2)))^(1/3) F^(1/6)
without a parameter to fit, a the diameter and F the largest force between beads. Their curve is not public in numbers.
The formula is that of a long wave; the wave is only five beads long. Point masses on Hertz springs, integrated by
`scipy`, are exact for a small contact.

Quantity: speed of the wave between the sixth contact and the sixth from the end, for three speeds of the striking bead,
which is one of them; and largest force there.
Limits: speed within 1 % of point masses, and within 3 % of the formula.

A whole bead is stiffer than half-spaces, by the order of the contact's radius over its own; and it takes a little
energy into its vibration.

    python -m validation.experiments.granular_chain [--quick] [--out JSON]
"""

import time
import warnings
from itertools import pairwise

import exudyn as exu
import netgen.occ as occ
import numpy as np
import scipy.integrate

import exudyn_partition as ep
from validation.experiments import common

DATA = common.data("granular_chain")
SETUP = DATA["setup"]
R, BALLS, AT = SETUP["diameter_m"] / 2, 20, 5
STEEL = ep.Material(E=SETUP["E_Pa"], nu=SETUP["nu"], rho=SETUP["rho_kg_m3"])
SPEEDS = (0.05, 0.2, 0.6)
LIMITS = {"point masses": 0.01, "formula": 0.03, "force": 0.02}


def by_formula(force):
    """Speed of the solitary wave [m/s] by its largest force [N]."""
    return 0.6802 * (2 * STEEL.E / (2 * R * STEEL.rho**1.5 * (1 - STEEL.nu**2))) ** (1 / 3) * force ** (1 / 6)


def wave(t, forces):
    """Speed of the wave between two contacts far from the ends [m/s], and mean of the peaks there [N]."""
    peaks = []
    for force in (forces[AT], forces[-AT - 1]):
        top = slice(force.argmax() - 3, force.argmax() + 4)
        a, b, _ = np.polyfit(t[top] - t[force.argmax()], force[top], 2)
        peaks.append((t[force.argmax()] - b / (2 * a), force.max()))
    (first, strong), (last, weak) = peaks
    return 2 * R * (len(forces) - 2 * AT - 1) / (last - first), (strong + weak) / 2


def by_point_masses(mass, speed, end):
    """Speed and force of the wave in a chain of masses on Hertz springs."""
    stiffness = 4 / 3 * STEEL.E / (2 * (1 - STEEL.nu**2)) * np.sqrt(R / 2)

    def forces(places):
        return stiffness * np.maximum(places[:-1] - places[1:], 0.0) ** 1.5

    def rate(t, state):
        force = np.concatenate([[0 * t], forces(state[:BALLS]), [0.0]])
        return np.r_[state[BALLS:], -np.diff(force) / mass]

    start, t = np.r_[np.zeros(BALLS), speed, np.zeros(BALLS - 1)], np.linspace(0, end, 4000)
    found = scipy.integrate.solve_ivp(rate, (0, end), start, t_eval=t, rtol=1e-9, atol=1e-14, max_step=end / 2000)
    return wave(t, forces(found.y[:BALLS]))


def reduced_bead(speed):
    """Bead with a patch at either pole, whose mesh is right for the force of the wave."""
    mass = 4 / 3 * np.pi * R**3 * STEEL.rho
    force = ep.hertz.impact(mass / 2, speed, R, R, STEEL, STEEL).peak_force
    a = ep.hertz.contact_radius(force, R, R, STEEL, STEEL)
    poles = {"back": (0, 0, -R), "front": (0, 0, R)}
    fine = [ep.Refine(pole, 1.3 * a, a / 3) for pole in poles.values()]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), STEEL, maxh=R / 2, refine=fine, grading=0.4)
    back, front = (
        ep.Partition.ball(fem, pole, reach * a, name=name)
        for (name, pole), reach in zip(poles.items(), (1.8, 1.4), strict=True)
    )
    return ep.reduce(fem, back | front, f_cut=200e3)


def run(speed):
    """The chain in Exudyn, beside formula and point masses."""
    begin = time.perf_counter()
    body = reduced_bead(speed)
    offline = time.perf_counter() - begin
    end = 1.3 * 2 * R * BALLS / by_formula(ep.hertz.impact(body.total_mass / 2, speed, R, R, STEEL, STEEL).peak_force)
    mbs = exu.SystemContainer().AddSystem()
    beads = [
        ep.CreatePartitionBody(
            mbs, body, frame="inertial", referencePosition=[0, 0, 2 * R * i], initialVelocity=[0, 0, speed * (i == 0)]
        )
        for i in range(BALLS)
    ]
    contacts = [
        ep.CreatePartitionContact(mbs, *pair, slavePatch="front", masterPatch="back") for pair in pairwise(beads)
    ]
    mbs.Assemble()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ep.errors.YieldWarning)  # compared with elastic beads
        result = ep.solve_dynamic(mbs, end_time=end, step=2.5e-7)
    found, force = wave(result.t, np.array([contact.force(result) for contact in contacts]))
    masses, force_masses = by_point_masses(body.total_mass, speed, end)
    return {
        "striker_m_s": speed, "force_N": force, "wave_m_s": found, "point masses_m_s": masses,
        "formula_m_s": by_formula(force), "error, point masses": found / masses / (force / force_masses) ** (1 / 6) - 1,
        "error, formula": found / by_formula(force) - 1, "error, force": force / force_masses - 1,
        "dofs": BALLS * body.n_dofs, "offline_s": offline, "online_s": result.time_s,
    }  # fmt: skip


def draw(path, rows):
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(6, 4), layout="constrained")
    forces = np.geomspace(0.5 * rows[0]["force_N"], 2 * rows[-1]["force_N"], 30)
    ax.loglog(forces, by_formula(forces), "k-", lw=1, label="Nesterenko; fits Coste's measurements")
    ax.loglog([r["force_N"] for r in rows], [r["wave_m_s"] for r in rows], "C3o", label="this library")
    ax.set(xlabel="largest force [N]", ylabel="speed of the solitary wave [m/s]")
    ax.legend()
    figure.savefig(path, dpi=110)


def main():
    given = common.options(__doc__, "one speed of the striker")
    rows = [run(speed) for speed in (SPEEDS[1:2] if given.quick else SPEEDS)]
    common.show("granular chain", rows)
    found = {
        "point masses": max(abs(row["error, point masses"]) for row in rows),
        "formula": max(abs(row["error, formula"]) for row in rows),
        "force": max(abs(row["error, force"]) for row in rows),
    }
    common.finish(__file__, {"rows": rows}, found, LIMITS, given, lambda path: draw(path, rows))


if __name__ == "__main__":
    main()
