"""Memory and time to reduce a body of 650 000 dofs, beside one of 240 000, and beside an old checkout.

A steel block of 100 x 60 x 56 mm with a fine patch in the middle of its upper face is reduced with default options, at
40 kHz. Each reduction runs in a process of its own; its peak of memory is that of `getrusage`, and includes the model
and all libraries. What the model alone has needed, its mesh and matrices, is `before_GB`.
Reference: an old checkout, if it is given; it does the same.
Quantity: peak of memory, processor time and elapsed time; displacements of three patch nodes by unit forces there, of
the elastic body at rest, and three frequencies.
Limits: 9 GB at 650 000 dofs; frequencies of both sizes differ by no more than 0.1 %.

    python -m validation.benchmarks.huge_body [--old /path/to/old] [--only small large]

Results of sizes that are not run again are kept.
"""

import argparse
import json
import resource
import sys
import time
from pathlib import Path

RESULTS = Path(__file__).with_suffix(".json")
LIMITS = {"memory_GB": 9.0, "frequencies": 1e-3}
SIZES = {"small": 3.25e-3, "large": 1.9e-3}  # maxh [m]
LENGTH, WIDTH, HEIGHT, F_CUT = 0.1, 0.06, 0.056, 40e3


def part(maxh):
    """FE model and partition."""
    import netgen.occ as occ

    import exudyn_partition as ep

    middle = (LENGTH / 2, WIDTH / 2, HEIGHT)
    fem = ep.fe_model(
        occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(LENGTH, WIDTH, HEIGHT)), ep.STEEL, maxh=maxh,
        refine=[ep.Refine(middle, 2e-3, 0.5e-3)],
    )  # fmt: skip
    return fem, ep.Partition.ball(fem, middle, 2e-3)


def peak():
    """Most memory of this process so far [GB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def displacements(body, nodes):
    """Of the first nodes of the patch, by a unit force on each along its normal, of the elastic body at rest [m/N]."""
    elastic = body.basis.omega > 0
    modes = body.basis.shapes[3 * nodes + 2][:, elastic] / body.basis.omega[elastic]
    return (modes**2).sum(axis=1) + body.flexibility(0).diagonal()[: len(nodes)]


def case(maxh):
    """One reduction."""
    import exudyn_partition as ep

    ep.reduce(*part(6e-3), f_cut=F_CUT)  # what is compiled at first
    fem, partition = part(maxh)
    before, begin, cpu = peak(), time.perf_counter(), time.process_time()
    body = ep.reduce(fem, partition, f_cut=F_CUT)
    times = {"time_s": time.perf_counter() - begin, "cpu_s": time.process_time() - cpu}
    return {
        "fe_dofs": fem.n_dofs, "rows": len(partition.patch_nodes), "dofs": body.n_dofs, **times,
        "memory_GB": peak(), "before_GB": before,
        "displacements": displacements(body, partition.patches[0].nodes[:3]).tolist(),
        "omega": body.basis.omega[6:9].tolist(),
    }  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--old", type=Path, help="an old checkout, that does the same")
    parser.add_argument("--only", nargs="+", choices=SIZES, default=list(SIZES))
    parser.add_argument("--case", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        print(json.dumps(case(options.case)))
        return
    from validation.processes import ROOT, in_a_process  # an old checkout has no such module

    result = json.loads(RESULTS.read_text()) if RESULTS.exists() else {"new": {}, "old": {}}
    checkouts = {"new": ROOT} | ({"old": options.old.resolve()} if options.old else {})
    for size in options.only:
        for which, checkout in checkouts.items():
            result[which][size] = in_a_process(__file__, "--case", SIZES[size], checkout=checkout)
            print(which, result[which][size], flush=True)
            RESULTS.write_text(json.dumps(result, indent=1) + "\n")
    rows = list(result["new"].values())
    found = {
        "memory_GB": max(row["memory_GB"] for row in rows),
        "frequencies": max(
            abs(a / b - 1) for row in rows for a, b in zip(row["omega"], rows[-1]["omega"], strict=True)
        ),
    }
    failed = [f"{name} {value:.3g}" for name, value in found.items() if value > LIMITS[name]]
    result |= {"found": found, "limits": LIMITS, "beyond_limits": failed}
    RESULTS.write_text(json.dumps(result, indent=1) + "\n")
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
