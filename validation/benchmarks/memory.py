"""Memory of a reduction: its peak against the estimate that comes before the work, and growth in repetitions.

Reference: the peak of a separate process, beyond what is in use before, for `reduce_pair` of two bodies: a steel rod of
20 mm with a hemispherical tip, and an aluminium plate of 10 mm. Also memory in use after each of five `reduce` of one
body of some 28 000 dofs.
Quantity: the estimate of `reduction.memory.needed`, the peak and their ratio, for several numbers of elements per
contact radius. The growth of memory in use from the second of the five reductions to the last.
Limits: estimates within a factor of 1.5 of the peak, growth below 50 MB (factors take some 200 MB).

    python -m validation.benchmarks.memory [--elements 2 3] [--no-leak]

Off-line time grows as the 2.3rd power of the number of patch nodes. The reason: the dofs of the refined region grow as
its power of 1.5, and the factorisations as the square of the dofs.
"""

import argparse
import json
import math
import os
import resource
import sys
import time
from pathlib import Path

from validation.processes import in_a_process

RESULTS = Path(__file__).with_suffix(".json")
FACTOR, GROWTH_MB = 1.5, 50.0
RADIUS, LENGTH, SIDE, THICKNESS = 0.010, 0.1, 0.1, 0.010  # [m]
FORCE, SPEED, DURATION = 800.0, 0.6, 300e-6
REPETITIONS = 5


def in_use():
    """Memory of this process [GB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e9


def models(elements):
    """Rod and plate with their partitions, so many elements in the contact's radius."""
    import netgen.occ as occ

    import exudyn_partition as ep

    a = ep.hertz.contact_radius(FORCE, RADIUS, math.inf, ep.STEEL, ep.ALUMINIUM)
    centre = occ.Pnt(0, 0, RADIUS)
    rod = occ.Cylinder(centre, occ.Z, r=RADIUS, h=LENGTH - RADIUS) + occ.Sphere(centre, RADIUS)
    plate = occ.Box(occ.Pnt(-SIDE / 2, -SIDE / 2, -THICKNESS), occ.Pnt(SIDE / 2, SIDE / 2, 0))
    refine = [ep.Refine((0, 0, 0), radius=1.7 * a, h=a / elements)]
    fems = [
        ep.fe_model(shape, material, maxh=6e-3, refine=refine)
        for shape, material in ((rod, ep.STEEL), (plate, ep.ALUMINIUM))
    ]
    return [(fem, ep.Partition.ball(fem, center=(0, 0, 0), radius=1.7 * a)) for fem in fems]


def peak_case(elements):
    """One pair, in this process."""
    import exudyn_partition as ep
    from exudyn_partition.reduction import memory

    pair = models(elements)
    before, begin = in_use(), time.perf_counter()
    ep.reduce_pair(*pair, tolerance=1e-2, speed=SPEED, duration=DURATION)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9 - before
    estimate = memory.needed(pair, "contact-adapted") / 1e9
    return {
        "elements_per_radius": elements,
        "dofs": [fem.n_dofs for fem, _ in pair],
        "patch_nodes": [len(partition.patch_nodes) for _, partition in pair],
        "estimate_GB": estimate,
        "peak_GB": peak,
        "ratio": estimate / peak,
        "time_s": time.perf_counter() - begin,
    }


def leak_case():
    """Memory in use after each of some reductions of one body."""
    import exudyn_partition as ep

    fem, partition = models(2.3)[1]
    used = []
    for _ in range(REPETITIONS):
        ep.reduce(fem, partition, f_cut=40e3)
        used.append(1e3 * in_use())
    return {"dofs": fem.n_dofs, "in_use_MB": used, "growth_MB": used[-1] - used[1]}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--elements", nargs="*", type=float, default=[2.0, 3.0], help="per contact radius")
    parser.add_argument("--no-leak", action="store_true", help="peaks alone")
    parser.add_argument("--case", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        print(json.dumps(leak_case() if options.case == "leak" else peak_case(float(options.case))))
        return
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {"peaks": {}, "leak": None}
    for elements in options.elements:
        results["peaks"][f"{elements:g}"] = case = in_a_process(__file__, "--case", elements)
        print(case, flush=True)
        RESULTS.write_text(json.dumps(results, indent=1) + "\n")
    if not options.no_leak:
        results["leak"] = in_a_process(__file__, "--case", "leak")
        print(results["leak"])
    failed = [k for k, case in results["peaks"].items() if not 1 / FACTOR < case["ratio"] < FACTOR]
    failed += ["leak"] if results["leak"] and results["leak"]["growth_MB"] > GROWTH_MB else []
    RESULTS.write_text(json.dumps(results | {"beyond_limits": failed}, indent=1) + "\n")
    sys.exit(f"beyond the stated limits: {failed}" if failed else 0)


if __name__ == "__main__":
    main()
