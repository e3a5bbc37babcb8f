"""How far plastic flow reaches in an impact, and whether `hertz.impact(...).plastic_radius` is wide enough for it.

A steel ball of 20 mm falls on an aluminium disc of 50 x 20 mm, at 0.1 to 5 m/s and for other yield stresses. The zone
is half as wide again as the estimate, and elements at the contact have two fifths of its radius.
Quantity: the radius about the first contact in which all flow lies, and that of 99.9 % of plastic strain times volume,
by the estimate; and that by the radius of Hertz's contact.
Limits: no flow beyond the estimate, and at least half of it reached: a zone is neither too small nor far too large.

    python -m validation.inelastic.zone_radius
"""

import argparse
import math
import time
import warnings
from dataclasses import replace

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes
from validation.inelastic.impact import ALUMINIUM, STEEL

RADIUS, DISC, THICKNESS, F_CUT, STEPS = 10e-3, 25e-3, 20e-3, 100e3, 250
SOFT, HARD = replace(ALUMINIUM, yield_stress=100e6, hardening=0.0), replace(ALUMINIUM, yield_stress=500e6)
CASES = [(0.1, ALUMINIUM), (0.5, ALUMINIUM), (2.0, ALUMINIUM), (5.0, ALUMINIUM), (1.0, SOFT), (1.0, HARD)]
LIMITS = {"reached": 1.0, "least": 0.5}


def case(speed, material):
    """One impact, until the ball has left."""
    mass = ep.hertz.effective(4 / 3 * np.pi * RADIUS**3 * STEEL.rho, np.pi * DISC**2 * THICKNESS * material.rho)
    hertz = ep.hertz.impact(mass, speed, RADIUS, math.inf, STEEL, material)
    a = max(hertz.contact_radius, math.sqrt(hertz.peak_force / (2.8 * math.pi * material.yield_stress)))
    ball = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)
    disc = occ.Cylinder(occ.Pnt(0, 0, -THICKNESS), occ.Z, DISC, THICKNESS)
    bodies = []
    for shape, own, h_far, sign in ((ball, STEEL, 4e-3, -1), (disc, material, 6e-3, 1)):
        fem = ep.fe_model(shape, own, maxh=h_far, refine=[ep.Refine((0, 0, 0), 1.6 * a, 0.4 * a)], grading=0.6)
        zone = {"plastic_radius": 1.5 * hertz.plastic_radius} if own.plastic else {}
        bodies.append(
            ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 2 * a, direction=(0, 0, sign), **zone), f_cut=F_CUT)
        )
    mbs = exu.SystemContainer().AddSystem()
    upper = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -speed], name="ball")
    lower = ep.CreatePartitionBody(mbs, bodies[1], name="disc")
    contact = ep.CreatePartitionContact(mbs, upper, lower)
    mbs.Assemble()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ep.errors.YieldWarning)  # of the ball, which has no yield stress
        result = ep.solve_dynamic(mbs, end_time=1.5 * hertz.duration, step=hertz.duration / STEPS)
    ((side, run),) = contact.plastic.zones
    state = contact.plastic.states(result)["slave" if side == 0 else "master"]
    away = np.linalg.norm(run.zone.place(np.arange(len(run.zone))), axis=1)
    volume = state.equivalent * run.zone.weight
    order = np.argsort(away)
    share = np.cumsum(volume[order]) / volume.sum()
    most, nearly_all = away[state.equivalent > 0].max(), away[order][np.searchsorted(share, 0.999)]
    return {
        "speed_m_s": speed,
        "yield_stress_Pa": material.yield_stress,
        "hardening_Pa": material.hardening,
        "yield_ratio": hertz.yield_ratio,
        "hertz_radius_m": hertz.contact_radius,
        "plastic_radius_m": hertz.plastic_radius,
        "reached": most / hertz.plastic_radius,
        "reached_by_99.9_percent": nearly_all / hertz.plastic_radius,
        "reached_by_hertz_radius": most / hertz.contact_radius,
        "peak_N": contact.force(result).max(),
        "zone_nodes": len(run.zone.nodes),
    }


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    begin, console, cases = time.perf_counter(), Console(width=150), []
    for given in CASES:
        cases.append(case(*given))
        console.print(cases[-1])
    reached = [one["reached"] for one in cases]
    found = {"reached": max(reached), "least": min(reached)}
    failed = [f"reached {found['reached']:.3g} of the estimate"] if found["reached"] > LIMITS["reached"] else []
    failed += [f"only {found['least']:.3g} of the estimate reached"] if found["least"] < LIMITS["least"] else []
    result = {"found": found, "limits": LIMITS, "cases": cases, "time_s": time.perf_counter() - begin}
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
