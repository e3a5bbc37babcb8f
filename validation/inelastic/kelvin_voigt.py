"""Impacts of bodies with stiffness-proportional damping, whose material is then that of Kelvin and Voigt.

Reference 1: a rigid ball with this mass on a half-space of the material: rings of pressure (Boussinesq), with the same
time in all strains, and its own integration in time. Reference 2: the law of Kuwabara and Kono,
F = k (d^1.5 + 1.5 beta d^0.5 d'), which is exact while the contact grows, and for little damping.
Quantity: restitution and peak of the force of a ball on a rigid plane for three times and two speeds, in both frames,
by both integrators and with friction; restitution of two balls with different times, for which the mean counts at
first order; the balance of energy; and the ratio of errors when steps are halved, 2 for a method of first order.
Limits: 0.005 in restitution by the half-space, 0.02 by the law, 0.005 for two balls, 2.5 % in peak force, 1e-3 in
energy, 1.4 to 2.6 for the ratio.

    python -m validation.inelastic.kelvin_voigt
"""

import json
import math
import os
import platform
import sys
from pathlib import Path

import exudyn as exu
import netgen.occ as occ
import numpy as np
import scipy.integrate
import scipy.special
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep

RESULTS = Path(__file__).with_suffix(".json")
RADIUS, MATERIAL = 0.010, ep.Material(E=210e9, nu=0.3, rho=7850.0)
MASS = 4 / 3 * math.pi * RADIUS**3 * MATERIAL.rho
SPEEDS, PARTS = (0.03, 0.3), (100, 30, 10)  # [m/s]; times are durations of the impact by these
RINGS, STEPS = 48, 2000  # of the half-space, whose rings reach 1.2 contact radii; in the duration
LIMITS = {"restitution": 0.005, "kuwabara_kono": 0.02, "peak": 0.025, "two_balls": 0.005, "energy": 1e-3, "order": 0.6}


def impact(speed, parts=1):
    """Hertz's impact on a rigid plane, or of two balls, without damping."""
    plane = ep.Material(E=1e19, nu=0.3, rho=1e4)
    if parts == 1:
        return ep.hertz.impact(MASS, speed, RADIUS, math.inf, MATERIAL, plane)
    return ep.hertz.impact(MASS / 2, speed, RADIUS, RADIUS, MATERIAL, MATERIAL)


def kuwabara_kono(beta, speed, parts=1):
    """Restitution and peak force [N]; with parts = 2 of two equal balls."""
    mass, radius = MASS / parts, RADIUS / parts
    k = 4 / 3 * MATERIAL.E / (1 - MATERIAL.nu**2) / parts * math.sqrt(radius)

    def force(depth, rate):
        depth = max(depth, 0.0)
        return max(k * (depth**1.5 + 1.5 * beta * math.sqrt(depth) * rate), 0.0)

    def leaves(t, y):
        return y[0] - 1e-14

    leaves.terminal, leaves.direction = True, -1
    end = 3 * impact(speed, parts).duration
    found = scipy.integrate.solve_ivp(
        lambda t, y: [y[1], -force(*y) / mass], (0, end), [1e-13, speed], rtol=1e-9, atol=1e-15, max_step=end / 600,
        events=leaves,
    )  # fmt: skip
    return -found.y[1, -1] / speed, max(force(*y) for y in found.y.T)


def half_space(beta, speed):
    """Restitution and peak force [N] of a rigid ball on rings of a half-space that yields with a time."""
    hertz = impact(speed)
    edges = np.linspace(0, 1.2 * hertz.contact_radius, RINGS + 1)
    r = (edges[1:] + edges[:-1]) / 2

    def of_disc(a):
        """Displacement at r by unit pressure within a, times E / (1 - nu^2): Johnson, Contact mechanics, 3.29."""
        inside, x = r < a, np.minimum(r, a) / np.maximum(r, a)
        m = x**2
        E, K = scipy.special.ellipe(m), scipy.special.ellipk(m)
        return 4 / math.pi * np.where(inside, a * E, r * (E - (1 - m) * K))

    discs = np.column_stack([np.zeros(RINGS), *map(of_disc, edges[1:])])
    areas = math.pi * np.diff(edges**2)
    F = np.diff(discs, axis=1) / areas * (1 - MATERIAL.nu**2) / MATERIAL.E  # by force on a ring
    h = hertz.duration / STEPS
    share = h / (h + beta)
    carried, active = np.zeros(RINGS), np.zeros(RINGS, dtype=bool)
    depth, rate, peak, touched = 0.0, speed, 0.0, False
    while True:
        depth += h * rate
        gap = r**2 / (2 * RADIUS) - depth + (1 - share) * F @ carried
        for _ in range(50):
            lam = np.zeros(RINGS)
            lam[active] = np.linalg.solve(share * F[np.ix_(active, active)], -gap[active])
            wrong = np.where(active, lam < 0, gap + share * F @ lam < -1e-12 * abs(depth))
            if not wrong.any():
                break
            active = active ^ wrong
        carried = share * lam + (1 - share) * carried
        total = lam.sum()
        peak, touched = max(peak, total), touched or total > 0
        rate -= h * total / MASS
        if rate < 0 and touched and not total:
            return -rate / speed, peak


def ball(speed, up=True, rough=False):
    """A ball on the origin, or below it, with a mesh for the impact at this speed."""
    a, sign = impact(speed).contact_radius, 1 if up else -1
    shape = occ.Sphere(occ.Pnt(0, 0, sign * RADIUS), RADIUS)
    fine = ep.Refine((0, 0, 0), 1.4 * a, (0.25 if up else 0.27) * a)
    fem = ep.fe_model(shape, MATERIAL, maxh=4e-3, refine=[fine])
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1.6 * a, axes="xyz" if rough else "normal"), f_cut=150e3)


def energy_error(items, contact, result):
    """Largest change of energies and all that was taken, relative."""
    total = sum(each.energy(result) + each.dissipated_energy(result) for each in (*items, contact))
    return float(abs(total / total[0] - 1).max())


def run(body, beta, speed, steps=400, *, frame="inertial", method="explicit", friction=None):
    """Restitution, peak force [N], and error of energy of a ball on a rigid plane."""
    mbs = exu.SystemContainer().AddSystem()
    start = {"referencePosition": [0, 0, 1e-9], "initialVelocity": [0, 0, -speed]}
    item = ep.CreatePartitionBody(mbs, body, damping=ep.Rayleigh(0.0, beta), frame=frame, **start)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=friction)
    mbs.Assemble()
    duration = impact(speed).duration
    step = duration / steps
    if method == "explicit":
        step = min(step, 0.9 * ep.stability_limit(mbs))
    result = ep.solve_dynamic(mbs, end_time=1.5 * duration, step=step, method=method, spectral_radius=1.0)
    rebound = float(item.momentum(result)[-1, 2] / body.total_mass / speed)
    return rebound, float(contact.force(result).max()), energy_error([item], contact, result), result.time_s


def two_balls(bodies, betas, speed):
    """Restitution and error of energy of two balls with times of their own."""
    mbs = exu.SystemContainer().AddSystem()
    items = [
        ep.CreatePartitionBody(
            mbs, body, damping=ep.Rayleigh(0.0, beta), referencePosition=[0, 0, sign * 1e-9],
            initialVelocity=[0, 0, -sign * speed / 2],
        )
        for body, beta, sign in zip(bodies, betas, (1, -1), strict=True)
    ]  # fmt: skip
    contact = ep.CreatePartitionContact(mbs, *items)
    mbs.Assemble()
    duration = impact(speed, 2).duration
    step = min(duration / 400, 0.9 * ep.stability_limit(mbs))
    result = ep.solve_dynamic(mbs, end_time=1.5 * duration, step=step)
    apart = items[0].momentum(result)[-1, 2] - items[1].momentum(result)[-1, 2]
    return float(apart / bodies[0].total_mass / speed), energy_error(items, contact, result)


def main():
    rows, errors = [], []
    for speed in SPEEDS:
        body, duration = ball(speed), impact(speed).duration
        for part in PARTS:
            beta = duration / part
            exact, peak = half_space(beta, speed)
            by_law, _ = kuwabara_kono(beta, speed)
            ways = [("inertial", "explicit", None)]
            if speed == SPEEDS[1] and part == PARTS[1]:
                ways += [("inertial", "implicit", None), ("floating", "explicit", None), ("inertial", "implicit", 0.3)]
            for frame, method, friction in ways:
                own = ball(speed, rough=True) if friction else body
                e, found, error, time_s = run(own, beta, speed, frame=frame, method=method, friction=friction)
                errors.append(error)
                rows.append(
                    {
                        "speed": speed,
                        "time": f"T/{part}",
                        "frame": frame,
                        "method": method,
                        "friction": friction or 0.0,
                        "restitution": e,
                        "half_space": exact,
                        "kuwabara_kono": by_law,
                        "peak": found / peak - 1,
                        "energy": error,
                        "online_s": time_s,
                    }
                )
    speed = SPEEDS[1]
    body, duration = ball(speed), impact(speed).duration
    ends = [run(body, duration / 30, speed, steps, method="implicit")[0] for steps in (100, 200, 400)]
    ratio = (ends[1] - ends[0]) / (ends[2] - ends[1])
    pair, beta = (body, ball(speed, up=False)), impact(speed, 2).duration / 100
    both = [two_balls(pair, betas, speed) for betas in ((beta, beta), (2 * beta, 0.0), (0.0, 2 * beta))]
    expected, _ = kuwabara_kono(beta, speed, 2)
    found = {
        "restitution": max(abs(row["restitution"] - row["half_space"]) for row in rows),
        "kuwabara_kono": max(abs(row["restitution"] - row["kuwabara_kono"]) for row in rows),
        "peak": max(abs(row["peak"]) for row in rows),
        "two_balls": max(abs(e - expected) for e, _ in both),
        "energy": max(errors + [error for _, error in both]),
        "order": abs(ratio - 2),
    }
    data = {
        "dofs": body.n_dofs,
        "fe_dofs": body.fe_dofs,
        "rows": rows,
        "step_ratio": ratio,
        "two_balls": {"restitution": [e for e, _ in both], "kuwabara_kono": expected},
        "found": found,
        "limits": LIMITS,
        "machine": {"cpus": os.cpu_count(), "platform": platform.platform(), "versions": ep.versions()},
    }
    RESULTS.write_text(json.dumps(data, indent=1) + "\n")
    table = Table(*rows[0], title="balls of Kelvin-Voigt's material on a rigid plane")
    for row in rows:
        table.add_row(*(value if isinstance(value, str) else f"{value:.4g}" for value in row.values()))
    Console().print(table)
    print(f"steps halved: {ratio:.3g}; two balls {data['two_balls']}")
    failed = [f"{key} {value:.2g}" for key, value in found.items() if value > LIMITS[key]]
    sys.exit(f"beyond the stated limit: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
