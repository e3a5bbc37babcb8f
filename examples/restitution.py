"""A steel ball falls on an aluminium plate that yields: how fast it rebounds, and what it leaves behind.

Impact speeds run from 0.02 to 5 m/s; the plate begins to yield at some 0.02 m/s. Elements beneath the contact are
plastic (von Mises, linear hardening), everything else is linear elastic. Each speed has a mesh of its own, for the
contact grows with the speed. Warnings tell that the ball would yield too. The figure shows the restitution, the dent,
where the energy went, and the forces.
"""

import argparse
import json
import math
from pathlib import Path

import exudyn as exu
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

PLATE = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=240e6, hardening=500e6)
RADIUS, WIDTH, THICKNESS = 5e-3, 20e-3, 5e-3  # of the ball, and of the plate [m]
SPEEDS, F_CUT = (0.02, 0.1, 0.5, 2.0, 5.0), 250e3  # [m/s], [Hz]
BALL = 4 / 3 * math.pi * RADIUS**3 * ep.STEEL.rho, WIDTH**2 * THICKNESS * PLATE.rho  # masses of both [kg]


def bodies(speed, elements):
    """Ball and plate with meshes for this speed, the plate's FE model, and how long contact would last by Hertz [s]."""
    hertz = ep.hertz.impact(ep.hertz.effective(*BALL), speed, RADIUS, math.inf, ep.STEEL, PLATE)
    # Plastic contact is as wide as a mean pressure of some 2.8 times the yield stress makes it.
    a = max(hertz.contact_radius, math.sqrt(hertz.peak_force / (2.8 * math.pi * PLATE.yield_stress)))
    h = a / elements
    ball = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)
    plate = occ.Box(occ.Pnt(-WIDTH / 2, -WIDTH / 2, -THICKNESS), occ.Pnt(WIDTH / 2, WIDTH / 2, 0))
    found = []
    for shape, material, maxh, sign in ((ball, ep.STEEL, 2e-3, -1), (plate, PLATE, 3e-3, 1)):
        fem = ep.fe_model(shape, material, maxh=maxh, refine=[ep.Refine((0, 0, 0), 1.6 * a, h)], grading=0.5)
        zone = {"plastic_radius": hertz.plastic_radius + 2 * h} if material.plastic else {}
        reach = 1.15 * a + (h if sign < 0 else 2 * h)
        part = ep.Partition.ball(fem, (0, 0, 0), reach, direction=(0, 0, sign), **zone)
        found.append(ep.reduce(fem, part, f_cut=F_CUT))
    return found, fem, hertz.duration


def fall(pair, speed, end):
    """Items, contact and result of the impact."""
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, pair[0], initialVelocity=[0, 0, -speed], name="ball")
    plate = ep.CreatePartitionBody(mbs, pair[1], name="plate")
    contact = ep.CreatePartitionContact(mbs, ball, plate)
    mbs.Assemble()
    return (ball, plate), contact, ep.solve_dynamic(mbs, end_time=end)


def outcome(items, contact, result, speed):
    """What an impact left behind."""
    energy = [item.energy(result) for item in items]
    speeds = [item.momentum(result)[-1, 2] / item.body.total_mass for item in items]
    rigid = sum(0.5 * item.body.total_mass * v**2 for item, v in zip(items, speeds, strict=True))
    work, stored, start = contact.plastic.work(result)[-1], contact.energy(result)[-1], sum(energy)[0]
    found = {
        "speed_m_s": speed,
        "restitution": (speeds[0] - speeds[1]) / speed,
        "peak_force_N": contact.force(result).max(),
        "dent_m": max(contact.plastic.dents(result).values()),
        "plastic_share": work / start,
        "rebound_share": rigid / start,
        "vibration_share": (sum(energy)[-1] + stored - rigid) / start,
        "balance": (sum(energy)[-1] + stored + work) / start - 1,
        "offline_s": sum(item.body.reduce_s for item in items),
        "online_s": result.time_s,
    }
    return {key: float(value) for key, value in found.items()}


def draw(found, forces):
    """Restitution, dent, shares of the energy and forces."""
    figure, ((left, right), (shares, below)) = plt.subplots(2, 2, figsize=(10, 7), layout="constrained")
    speed = [one["speed_m_s"] for one in found]
    left.semilogx(speed, [one["restitution"] for one in found], "o-")
    left.set(xlabel="speed [m/s]", ylabel="coefficient of restitution", ylim=(0, 1))
    right.loglog(speed, [1e6 * one["dent_m"] or np.nan for one in found], "o-")
    right.set(xlabel="speed [m/s]", ylabel="depth of the dent [µm]")
    parts = {"rebound_share": "rebound", "vibration_share": "vibration", "plastic_share": "plastic work"}
    shares.stackplot(speed, [[one[key] for one in found] for key in parts], labels=parts.values())
    shares.set(xscale="log", xlabel="speed [m/s]", ylabel="share of the energy", ylim=(0, 1))
    shares.legend()
    for one, (t, force) in zip(found, forces, strict=True):
        below.plot(1e6 * t, force / one["peak_force_N"], label=f"{one['speed_m_s']:g} m/s")
    below.set(xlabel="time [µs]", ylabel="force by its peak")
    below.legend()
    return figure


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two speeds, coarse meshes")
    parser.add_argument("--out", type=Path, default=Path("out/restitution"), metavar="DIR")
    options = parser.parse_args(argv)
    found, forces = [], []
    for speed in (0.2, 1.0) if options.quick else SPEEDS:
        pair, fem, duration = bodies(speed, 1.3 if options.quick else 2.0)
        items, contact, run = fall(pair, speed, 2 * duration)
        found.append(outcome(items, contact, run, speed))
        forces.append((run.t, contact.force(run)))
        print({key: float(f"{value:.4g}") for key, value in found[-1].items()})
    result = {"impacts": found, "left_out": [*pair[1].left_out, *contact.left_out], "versions": ep.versions()}
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    draw(found, forces).savefig(options.out / "restitution.png", dpi=150)
    axes = ep.plot.bodies(run, run.t[-1], [(items[1], fem)], colour="deformation", end=found[-1]["dent_m"], scale=10)
    axes.set(xlim=(-3, 3), ylim=(-2, 2), adjustable="box", title=f"dent after an impact at {speed:g} m/s, drawn x 10")
    axes.figure.savefig(options.out / "bodies.png", dpi=150)
    print((options.out / "restitution.png").resolve())
    return result


if __name__ == "__main__":
    main()
