"""Plastic zones of thousands of nodes: time and memory off-line and on-line, and the same results as with a dense zone.

A steel ball of 20 mm on an aluminium disc of 50 x 10 mm (Y 200 MPa, H 500 MPa) at 0.6 m/s; steps of 0.4 us over the
first 60 us, in nearly all of which the disc flows. The zone has 2.6 contact radii, those of a plastic contact, and
elements of a third of that radius in the middle. Each case runs in a process of its own, so that its peak memory is
its own. Coarser elements make a zone of some 800 nodes, whose products are dense; finer ones in a wider middle make
more than 10 000.
Reference: the same run with the zone's dense flexibility, on a mesh of 2100 zone nodes: another sparse solver, which
has no fronts to keep. Quantity: relative L2 error of the force, relative error of plastic work; processor time of the
reduction of the disc, and its peak memory with meshing; processor time of the run, by that of a dense zone of 800 nodes
in an earlier version, which had no other zones, times the ratio of the nodes; both take turns; time of the wider zone's
reduction and run, by the other one's.
Limits: 1e-4 each; 25 s and 3e9 bytes, of the largest zone 60 s and 4e9 bytes; 1 by the nodes; 1.25 times each for the
wider zone. The time by that of 800 nodes in this version is told too.

    python -m validation.inelastic.zones [--only CASE ...] [--old REVISION]

Cases are kept in zones.json. Without `--only` all run again; `--only` alone judges what is kept.
"""

import argparse
import json
import math
import resource
import sys
import time
import warnings
from pathlib import Path

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes
from validation.inelastic.impact import ALUMINIUM, STEEL

RESULTS = Path(__file__).with_suffix(".json")
RADIUS, DISC, THICKNESS, SPEED, F_CUT = 10e-3, 25e-3, 10e-3, 0.6, 150e3
END, STEP, ZONE, FINE, WIDER = 60e-6, 0.4e-6, 2.6, 1.7, 1.85
SMALL, SAME, THIRD, LARGE = "800 nodes", "as a dense zone", "elements of a third", "more than 10 000 nodes"
WIDE, WIDTH = "half as wide again", 1.5
SHARES = {SMALL: 0.55, SAME: 0.42, THIRD: 1 / 3, LARGE: 0.222}  # size of elements by the contact radius
BY_NODES, OLD = "by nodes", "549f5d0"
CASES = (*SHARES, BY_NODES, WIDE)
LIMITS = {"force": 1e-4, "work": 1e-4, "offline_s": 25.0, "memory_GB": 3.0, "large_offline_s": 60.0, "large_GB": 4.0,
          "online_by_nodes": 1.0, "wide_offline": 1.25, "wide_online": 1.25}  # fmt: skip


def scene(share, fine=FINE, zone=ZONE):
    """FE models and partitions of ball and disc; the ball stands above z = 0, `zone` is in contact radii."""
    mass = ep.hertz.effective(4 / 3 * np.pi * RADIUS**3 * STEEL.rho, np.pi * DISC**2 * THICKNESS * ALUMINIUM.rho)
    elastic = ep.hertz.impact(mass, SPEED, RADIUS, math.inf, STEEL, ALUMINIUM)
    a = max(elastic.contact_radius, np.sqrt(elastic.peak_force / (2.8 * np.pi * ALUMINIUM.yield_stress)))
    ball = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)
    disc = occ.Cylinder(occ.Pnt(0, 0, -THICKNESS), occ.Z, DISC, THICKNESS)
    found = []
    for shape, material, h_far, h, sign in ((ball, STEEL, 4e-3, a / 2, -1), (disc, ALUMINIUM, 6e-3, share * a, 1)):
        fem = ep.fe_model(shape, material, maxh=h_far, refine=[ep.Refine((0, 0, 0), fine * a, h)], grading=0.6)
        plastic, reach = {"plastic_radius": zone * a} if material.plastic else {}, (1.65 + 1.5 * share) * a
        found.append((fem, ep.Partition.ball(fem, (0, 0, 0), reach, direction=(0, 0, sign), **plastic)))
    return found


def run(bodies, end=END):
    """Contact, result and processor time of the ball that falls on the disc."""
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -SPEED], name="ball")
    disc = ep.CreatePartitionBody(mbs, bodies[1], name="disc")
    contact = ep.CreatePartitionContact(mbs, ball, disc)
    mbs.Assemble()
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ep.errors.YieldWarning)  # of the ball, which has no yield stress
        result = ep.solve_dynamic(mbs, end_time=end, step=STEP)
    return contact, result, time.process_time() - begin


def case(name):
    """One mesh: reduction and run; once more with a dense zone, if it is to be the same."""
    models = scene(SHARES[name], WIDER if name == LARGE else FINE)
    ball, begin, wall = ep.reduce(*models[0], f_cut=F_CUT), time.process_time(), time.perf_counter()
    disc = ep.reduce(*models[1], f_cut=F_CUT)
    found = {
        "zone_nodes": len(models[1][1].patches[0].plastic.nodes),
        "dofs": models[1][0].n_dofs,
        "offline_cpu_s": time.process_time() - begin,
        "offline_wall_s": time.perf_counter() - wall,
        "memory_GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
        "zone_MB": disc.basis.zones[0].own.fronts.store.nbytes / 1e6,
    }
    run((ball, disc), 5 * STEP)  # loads what is compiled
    runs = [run((ball, disc)) for _ in range(1 if name == LARGE else 2)]
    contact, result, _ = runs[0]
    force, work = contact.force(result), contact.plastic.work(result)
    found |= {
        "online_cpu_s": min(one[-1] for one in runs),
        "plastic_steps": int(np.count_nonzero(np.diff(work) > 0)),
        "peak_N": force.max(),
        "work_J": work[-1],
        "online_GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
    }
    if name == SAME:
        from exudyn_partition.algebra.sparse.solver import solved_by  # the earlier version has neither
        from validation.inelastic.without_fronts import WithoutFronts

        with solved_by(WithoutFronts):
            contact, result, online = run((ball, ep.reduce(*models[1], f_cut=F_CUT)))
        dense = contact.force(result)
        found["force"] = np.linalg.norm(force - dense) / np.linalg.norm(dense)
        found["work"] = abs(work[-1] / contact.plastic.work(result)[-1] - 1)
        found["dense_online_cpu_s"] = online
    return found


def quickest(name):
    """Nodes of a zone, and the least processor time of three runs; an earlier version runs this too."""
    models = scene(SHARES[name])
    bodies = [ep.reduce(*model, f_cut=F_CUT) for model in models]
    run(bodies, 5 * STEP)
    nodes = len(models[1][1].patches[0].plastic.nodes)
    return {"zone_nodes": nodes, "online_cpu_s": min(run(bodies)[-1] for _ in range(3))}


def by_nodes(old):
    """Processor times of runs with a dense zone of an earlier version, and of this one with that zone and a larger one.

    Each is the least of two turns, by a process of its own; then the ratios.
    """
    from validation.processes import ROOT, checkout_of, in_a_process  # the earlier version has no such module

    found = {}
    with checkout_of(old) as checkout:
        for _ in range(2):
            for name, zone, where in (("dense", SMALL, checkout), ("now", SMALL, ROOT), ("third", THIRD, ROOT)):
                one = in_a_process(__file__, "--quickest", zone, checkout=where)
                found[name] = min(found.get(name, one), one, key=lambda turn: turn["online_cpu_s"])
    nodes = found["third"]["zone_nodes"] / found["dense"]["zone_nodes"]
    times = {name: found["third"]["online_cpu_s"] / found[name]["online_cpu_s"] for name in ("dense", "now")}
    return {**found, "online_by_nodes": times["dense"] / nodes, "by_nodes_of_now": times["now"] / nodes}


def wider():
    """Nodes of a zone half as wide again, and its times by those of the zone as it is; each is the least of two."""
    times = {ZONE: [], WIDTH * ZONE: []}
    found = {}
    for zone in (*times, *times):
        models = scene(SHARES[THIRD], zone=zone)
        ball, begin = ep.reduce(*models[0], f_cut=F_CUT), time.process_time()
        disc = ep.reduce(*models[1], f_cut=F_CUT)
        offline = time.process_time() - begin
        run((ball, disc), 5 * STEP)
        times[zone].append((offline, run((ball, disc))[-1]))
        found["zone_nodes"] = len(models[1][1].patches[0].plastic.nodes)
    as_it_is, wide = (np.min(one, axis=0) for one in times.values())
    return found | dict(zip(("wide_offline", "wide_online"), wide / as_it_is, strict=True))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", choices=CASES, default=[*CASES], help="cases to run anew; others are kept")
    parser.add_argument("--old", default=OLD, help="the earlier version")
    parser.add_argument("--case", choices=[*SHARES, WIDE], help=argparse.SUPPRESS)
    parser.add_argument("--quickest", choices=SHARES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.quickest:
        print(json.dumps(quickest(options.quickest)))
        return
    if options.case:
        print(json.dumps(wider() if options.case == WIDE else case(options.case), default=float))
        return
    from validation.processes import in_a_process  # the earlier version has no such module

    begin, console = time.perf_counter(), Console(width=150)
    cases = json.loads(RESULTS.read_text())["cases"] if RESULTS.exists() else {}
    for name in options.only:
        cases[name] = by_nodes(options.old) if name == BY_NODES else in_a_process(__file__, "--case", name)
        console.print(name, cases[name])
        RESULTS.write_text(json.dumps({"cases": cases}, indent=1) + "\n")
    if lacking := {*CASES} - cases.keys():
        sys.exit(f"not yet run: {', '.join(sorted(lacking))}")
    same, third, large = (cases[name] for name in (SAME, THIRD, LARGE))
    found = {
        "force": same["force"],
        "work": same["work"],
        "offline_s": third["offline_cpu_s"],
        "memory_GB": third["online_GB"],
        "large_offline_s": large["offline_cpu_s"],
        "large_GB": large["online_GB"],
        "wide_offline": cases[WIDE]["wide_offline"],
        "wide_online": cases[WIDE]["wide_online"],
        "online_by_nodes": cases[BY_NODES]["online_by_nodes"],
    }
    failed = [f"{key} {found[key]:.3g}, limit {limit:g}" for key, limit in LIMITS.items() if found[key] > limit]
    result = {"found": found, "limits": LIMITS, "cases": cases, "time_s": time.perf_counter() - begin}
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
