"""How far plastic flow reaches in an impact, and whether `hertz.impact(...).plastic_radius` is wide enough for it.

A steel ball of 20 mm falls on an aluminium disc of 50 x 20 mm, at 0.1 to 5 m/s and for other yield stresses. The zone
is half as wide again as the estimate, and elements at the contact have two fifths of its radius.
Quantity: the radius about the first contact in which all flow lies, and that of 99.9 % of plastic strain times volume,
by the estimate; and that by the radius of Hertz's contact.
Two balls of 8 and 14 mm that both yield, of aluminium or steel, on meshes as of the page on plastic zones: in zones as
wide as it advises (the estimate and two elements), and of half and 1.5 times that width.
Quantity: share of plastic strain times volume at the edge of either zone, whether the run warns of it, and force (L2)
and plastic work by those of the widest zone. There no flow is cut off; elements that do not lock change them too.
Limits: no flow beyond the estimate, and at least half of it reached: a zone is neither too small nor far too large.
Zones as advised and wider never warn, those of half the width always; 0.2 % of force between the two wider ones.

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
PAIR, WIDTHS = (4e-3, 7e-3), (0.5, 1.0, 1.5)
HARDENED = replace(ep.STEEL, yield_stress=355e6, hardening=2e9)
PAIRS = [(0.1, ALUMINIUM), (1.5, ALUMINIUM), (5.0, ALUMINIUM), (0.1, HARDENED), (1.5, HARDENED), (5.0, HARDENED)]
LIMITS = {"reached": 1.0, "least": 0.5, "force": 2e-3, "warned": 0, "silent": 0}


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


def pair(speed, material):
    """One impact of two balls of a material, in zones of several widths."""
    mass = ep.hertz.effective(*(4 / 3 * np.pi * R**3 * material.rho for R in PAIR))
    hertz = ep.hertz.impact(mass, speed, *PAIR, material, material)
    a = 1.4 * hertz.contact_radius
    models = []
    for R, sign in zip(PAIR, (-1, 1), strict=True):
        ball, refine = occ.Sphere(occ.Pnt(0, 0, -sign * R), R), [ep.Refine((0, 0, 0), 2 * a, a / 1.5)]
        models.append((ep.fe_model(ball, material, maxh=4e-3, refine=refine, grading=0.6), sign))
    runs = [strike(models, speed, hertz, a, width * (hertz.plastic_radius + 2 * a / 1.5)) for width in WIDTHS]
    force, work = runs[-1][:2]
    return {
        "speed_m_s": speed,
        "yield_stress_Pa": material.yield_stress,
        "yield_ratio": hertz.yield_ratio,
        "force": [float(np.linalg.norm(run[0] - force) / np.linalg.norm(force)) for run in runs],
        "work": [run[1] / work - 1 for run in runs],
        "at_edge": [run[2] for run in runs],
        "warns": [run[3] for run in runs],
    }


def strike(models, speed, hertz, a, radius):
    """Force, plastic work, the larger share of flow at the edge of a zone, and whether the run warns of it."""
    mbs = exu.SystemContainer().AddSystem()
    items = []
    for (fem, sign), v in zip(models, (-speed, 0.0), strict=True):
        part = ep.Partition.ball(fem, (0, 0, 0), 1.7 * a, direction=(0, 0, sign), plastic_radius=radius)
        items.append(ep.CreatePartitionBody(mbs, ep.reduce(fem, part, f_cut=F_CUT), initialVelocity=[0, 0, v]))
    contact = ep.CreatePartitionContact(mbs, *items)
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        result = ep.solve_dynamic(mbs, end_time=1.7 * hertz.duration, step=hertz.duration / STEPS)
    states, shares = contact.plastic.states(result), []
    for side, run in contact.plastic.zones:
        flow = states["slave" if side == 0 else "master"].equivalent * run.zone.weight
        shares.append(flow[run.zone.border].sum() / flow.sum())
    warns = any("edge of its plastic zone" in str(one.message) for one in told)
    return contact.force(result), contact.plastic.work(result)[-1], max(shares), warns


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    begin, console, cases = time.perf_counter(), Console(width=150), []
    for given in CASES:
        cases.append(case(*given))
        console.print(cases[-1])
    pairs = []
    for given in PAIRS:
        pairs.append(pair(*given))
        console.print(pairs[-1])
    reached = [one["reached"] for one in cases]
    warns = np.array([one["warns"] for one in pairs])
    found = {
        "reached": max(reached),
        "least": min(reached),
        "force": max(one["force"][1] for one in pairs),
        "warned": int(warns[:, 1:].sum()),
        "silent": int((~warns[:, 0]).sum()),
    }
    failed = [f"reached {found['reached']:.3g} of the estimate"] if found["reached"] > LIMITS["reached"] else []
    failed += [f"only {found['least']:.3g} of the estimate reached"] if found["least"] < LIMITS["least"] else []
    failed += [f"force {found['force']:.2g} off"] if found["force"] > LIMITS["force"] else []
    failed += [f"{found['warned']} zones as advised warn"] if found["warned"] else []
    failed += [f"{found['silent']} narrow zones do not warn"] if found["silent"] else []
    result = {"found": found, "limits": LIMITS, "cases": cases, "pairs": pairs, "time_s": time.perf_counter() - begin}
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
