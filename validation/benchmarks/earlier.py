"""Off-line cost at the paper's size, by an earlier version and by this one: rod and plate with 97 000 nodes.

Reference: the version before fronts, friction and yield, which factorised by SuperLU, on the same machine in the same
minutes; git has to know it.
Each case runs in a process of its own, so that its peak memory is its own.
Quantity: time of meshing and assembly, and of the reduction of both bodies (contact-adapted, 40 kHz), processor time of
both together, and peak memory; of this version without and with numba of the extra `[fast]`. Times are those of the
quickest turn. This version uses a second core, so that nothing else may run on the machine.
Limits: off-line in all, 1 / 1.5 of the time without the extra and a third with it; 4e9 bytes.

    python -m validation.benchmarks.earlier [--old REVISION] [--turns 1]
"""

import argparse
import json
import os
import platform
import sys
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[2]
RESULTS = Path(__file__).with_suffix(".json")
OLD = "b77fb07"
MAXH, F_CUT = 3.7e-3, 40e3  # [m], [Hz]
LIMITS = {"time": 1 / 1.5, "time_with_extra": 1 / 3, "memory_GB": 4.0}


def case():
    """Times [s] and peak memory of the checkout that is imported."""
    import resource
    import warnings

    import exudyn_partition as ep
    from examples.models import rod_on_plate as example

    warnings.simplefilter("ignore")
    begin, used = time.perf_counter(), time.process_time()
    fems, partitions, _ = example.fe_models(quick=False, maxh=MAXH)
    between = time.perf_counter()
    bodies = [ep.reduce(fem, part, f_cut=F_CUT) for fem, part in zip(fems, partitions, strict=True)]
    end = time.perf_counter()
    return {
        "nodes": sum(fem.n_nodes for fem in fems),
        "reduced_dofs": sum(body.n_dofs for body in bodies),
        "models_s": between - begin,
        "reduce_s": end - between,
        "offline_s": end - begin,
        "processor_s": time.process_time() - used,
        "memory_GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
    }


def measured(old, turns):
    """The quickest turn of each case."""
    from exudyn_partition.support.compiled import compiles
    from validation.processes import checkout_of, in_a_process  # the earlier version has no such module

    if not compiles():
        sys.exit("numba is missing: pip install exudyn-partition[fast]")
    runs = {}
    with checkout_of(old) as checkout:
        for _ in range(turns):
            for name, where in (("old", checkout), ("new", ROOT), ("new_with_extra", ROOT)):
                print(f"{name} ...", file=sys.stderr, flush=True)
                plain = {"NUMBA_DISABLE_JIT": str(int(name != "new_with_extra"))}
                runs.setdefault(name, []).append(in_a_process(__file__, "--case", checkout=where, **plain))
    return {name: min(turns, key=lambda one: one["offline_s"]) for name, turns in runs.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--old", default=OLD, help="the earlier version")
    parser.add_argument("--turns", type=int, default=1)
    parser.add_argument("--case", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        print(json.dumps(case()))
        return
    import exudyn_partition as ep

    cases = measured(options.old, options.turns)
    old, new, fast = cases.values()
    found = {
        "time": new["offline_s"] / old["offline_s"],
        "time_with_extra": fast["offline_s"] / old["offline_s"],
        "memory_GB": max(new["memory_GB"], fast["memory_GB"]),
    }
    table = Table("", *cases, title=f"rod and plate, {new['nodes']} nodes; old: {options.old}")
    for key in old:
        table.add_row(key, *(f"{one[key]:.4g}" for one in cases.values()))
    Console().print(table)
    failed = [f"{key} {found[key]:.3g}, limit {limit:.3g}" for key, limit in LIMITS.items() if found[key] > limit]
    machine = {"cpus": os.cpu_count(), "platform": platform.platform(), "versions": ep.versions()}
    results = {"old": options.old, "cases": cases, "found": found, "limits": LIMITS, "machine": machine}
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
