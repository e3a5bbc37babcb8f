"""Elastoplastic impact of a ball on a round plate: CalculiX' axisymmetric model, compared with reduced bodies.

Scene: a steel ball of 10 mm falls on a free round aluminium plate of 20 x 5 mm (Y 200 MPa, H 500 MPa, von Mises), at
2, 10 and 50 times the speed at which it begins to yield by Hertz; the last one also without plastic flow. CalculiX has
quadrilaterals with eight nodes and reduced integration, surface-to-surface contact by penalty, and implicit HHT steps.
The reduced bodies have quadratic tetrahedra.
Reference: CalculiX. Quantity: relative L2 error of the force, its peak, and the coefficient of restitution, which
follows from the impulse and the masses; run times. Coarser meshes of both codes show how far each has converged.
Limits: 2 % of the force, 0.01 of the coefficient of restitution.

Without `ccx` the script says so, writes nothing, and ends with exit code 0. So it does with a CalculiX before 2.21:
that one reads a plastic state that it has not set when a dynamic step with surface-to-surface contact begins.

    python -m validation.calculix.plastic [--quick] [--again] [--out FILE]
"""

import math
import warnings
from dataclasses import replace

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.calculix import axisymmetric, deck
from validation.contact import scenes

ALUMINIUM = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=200e6, hardening=500e6)
ELASTIC = replace(ALUMINIUM, yield_stress=None, hardening=None)
STEEL = replace(ep.STEEL, yield_stress=None)
RADIUS, WIDTH, THICKNESS = 5e-3, 10e-3, 5e-3  # of the ball, of the plate [m]
F_CUT, ZONE, GROWTH = 250e3, 1.8, 1.35
CASES = {  # speed by that at first yield, whether metal flows, penalty [Pa/m]
    "2 V_Y": (2.0, True, 2e17),
    "10 V_Y": (10.0, True, 1e17),
    "50 V_Y": (50.0, True, 3e16),
    "50 V_Y, elastic": (50.0, False, 3e16),
}
MESHES = {  # elements in the contact radius and steps of CalculiX; those of the reduced bodies
    "2 V_Y": (((4, 300),), (2.0,)),
    "10 V_Y": (((4, 300),), (2.0,)),
    "50 V_Y": (((6, 400), (4, 300), (3, 300)), (2.5, 2.0)),
    "50 V_Y, elastic": (((6, 300),), (3.0,)),
}
LIMITS = {"force": 0.02, "restitution": 0.01}
SINCE = 2, 21  # version of CalculiX


def masses():
    """Of ball and plate [kg]."""
    return 4 / 3 * np.pi * RADIUS**3 * STEEL.rho, np.pi * WIDTH**2 * THICKNESS * ALUMINIUM.rho


def impact(ratio):
    """Hertz' elastic impact, its speed [m/s], and the radius of the contact [m] as plastic flow widens it."""
    mass = ep.hertz.effective(*masses())
    speed = ratio * ep.hertz.impact(mass, 1.0, RADIUS, math.inf, STEEL, ALUMINIUM).yield_speed
    hertz = ep.hertz.impact(mass, speed, RADIUS, math.inf, STEEL, ALUMINIUM)
    # A plastic contact is as wide as a mean pressure of 2.8 times the yield stress makes it.
    wide = np.sqrt(hertz.peak_force / (2.8 * np.pi * ALUMINIUM.yield_stress))
    return hertz, speed, max(hertz.contact_radius, wide)


def restitution(run, speed):
    """Of a run whose impulse both bodies get."""
    return run.impulse * sum(1 / mass for mass in masses()) / speed - 1


def calculix_run(case, elements, steps, again):
    ratio, plastic, stiffness = CASES[case]
    hertz, speed, a = impact(ratio)
    text = axisymmetric.impact_input(
        (STEEL, ALUMINIUM if plastic else ELASTIC), (RADIUS, WIDTH, THICKNESS), speed, deck.Pair(stiffness), a,
        elements, GROWTH, 1.25 * hertz.duration, steps,
    )  # fmt: skip
    return deck.kept_run(f"plastic, {case}, {elements}", text, again, axis=1, scale=axisymmetric.SECTORS)


def reduced_run(case, elements):
    ratio, plastic, _ = CASES[case]
    hertz, speed, a = impact(ratio)
    h, bodies, zone = a / elements, [], 0
    ball = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)
    plate = occ.Cylinder(occ.Pnt(0, 0, -THICKNESS), occ.Z, r=WIDTH, h=THICKNESS)
    for shape, material, maxh, up in (
        (ball, STEEL, 2e-3, -1), (plate, ALUMINIUM if plastic else ELASTIC, 3e-3, 1)
    ):  # fmt: skip
        fem = ep.fe_model(shape, material, maxh=maxh, refine=[ep.Refine((0, 0, 0), 1.7 * a, h)], grading=0.4)
        reach = 1.15 * a + (h if up < 0 else 2 * h)
        yielding = {"plastic_radius": ZONE * a} if material.plastic else {}
        part = ep.Partition.ball(fem, (0, 0, 0), reach, direction=(0, 0, up), **yielding)
        zone += len(part.patches[0].plastic.nodes) if material.plastic else 0
        bodies.append(ep.reduce(fem, part, f_cut=F_CUT))
    mbs = exu.SystemContainer().AddSystem()
    falling = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -speed])
    contact = ep.CreatePartitionContact(mbs, falling, ep.CreatePartitionBody(mbs, bodies[1]))
    mbs.Assemble()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ep.errors.YieldWarning)  # that of the elastic run
        history = ep.solve_dynamic(mbs, end_time=1.25 * hertz.duration).history(contact)
    history.info.update(offline_s=sum(body.reduce_s for body in bodies), zone_nodes=zone)
    return history


def compared(case, quick, again):
    """Runs of one case by name, and what is told of them."""
    speed = impact(CASES[case][0])[1]
    of_calculix, ours = MESHES[case]
    if quick:
        of_calculix, ours = of_calculix[-1:], ours[-1:]
    runs = {f"CalculiX, {n} elements a radius": calculix_run(case, n, steps, again) for n, steps in of_calculix}
    runs |= {f"reduced, {n:g} elements a radius": reduced_run(case, n) for n in ours}
    reference = next(iter(runs.values()))
    rows = [
        {
            "case": case,
            "name": name,
            "force": ep.compare(run, reference).error["force"],
            "peak": run.peak_force / reference.peak_force - 1,
            "peak_N": run.peak_force,
            "restitution": restitution(run, speed),
            "restitution_difference": restitution(run, speed) - restitution(reference, speed),
            "zone_nodes": run.info.get("zone_nodes"),
            "offline_s": run.info["offline_s"],
            "online_s": run.info["time_s"],
        }
        for name, run in runs.items()
    ]
    return runs, rows


def draw(every):
    path, (figure, axes) = scenes.figure(__file__, ncols=len(every), figsize=(4.5 * len(every), 4), squeeze=False)
    for panel, (case, runs) in zip(axes[0], every.items(), strict=True):
        for i, (name, run) in enumerate(runs.items()):
            style = {"color": "0.7", "lw": 4} if i == 0 else {"lw": 0.9}
            panel.plot(1e6 * run.t, run.force, label=name, **style)
        panel.set(title=case, xlabel="time [µs]", ylabel="force [N]")
        panel.grid(alpha=0.3)
        panel.legend(fontsize=7)
    figure.savefig(path, dpi=120)
    return path


def main():
    options = deck.arguments(__doc__, __file__, since=SINCE)
    every, rows, found = {}, [], dict.fromkeys(LIMITS, 0.0)
    for case in ("50 V_Y",) if options.quick else CASES:
        every[case], told = compared(case, options.quick, options.again)
        rows += told
        judged = next(row for row in told if "reduced" in row["name"])  # on its finest mesh
        for key, value in (("force", judged["force"]), ("restitution", abs(judged["restitution_difference"]))):
            found[key] = max(found[key], value)
    print(draw(every))
    head = ("case", "run", "force", "peak", "peak, N", "restitution", "difference", "zone", "off-line", "on-line")
    lines = [
        (r["case"], r["name"], f"{r['force']:.2%}", f"{r['peak']:+.2%}", f"{r['peak_N']:.3f}",
         f"{r['restitution']:.4f}", f"{r['restitution_difference']:+.4f}", f"{r['zone_nodes'] or ''}",
         f"{r['offline_s']:.1f} s", f"{r['online_s']:.3g} s")
        for r in rows
    ]  # fmt: skip
    title = "Elastoplastic impact: errors against CalculiX' axisymmetric model on its finest mesh"
    table = Table(*head, title=title)
    for line in lines:
        table.add_row(*line)
    Console(width=150).print(table)
    failed = [f"{key} {found[key]:.3g}" for key, limit in LIMITS.items() if found[key] > limit]
    result = {"runs": rows, "found": found, "limits": LIMITS, "tables": {title: (head, lines)}}
    deck.finish(options, result, failed)


if __name__ == "__main__":
    main()
