"""Cost of the reduction, off-line and on-line, against the size of the mesh: rod and plate of examples/rod_on_plate.py.

Reference: the full FE model on the largest mesh; for everything else none, only times and peak memory of this machine.
Each case runs in a process of its own, so that its peak memory is its own. The meshes differ only in the global `maxh`.
The local refinement is the same, so the number of contact rows is nearly the same too. This refinement alone has some
17 000 nodes, which limits the smallest mesh.
Quantity:
- times of meshing, assembly and reduction (contact-adapted, 40 kHz, both bodies), and of a step of the explicit run of
  1 ms, the quickest of ten runs;
- the exponent of growth of the reduction's time with the number of nodes;
- all four bases on the largest mesh;
- also on the largest mesh, the time of 5 ms of the full FE model, from the time of one step. Implicit steps are HHT of
  1 us; 0.3 ms of them are run and compared with the force of the reduced bodies. Explicit steps are the paper's, of
  nanoseconds.
Limits:
- at the largest size, of at least 95 000 nodes, the default reduction takes less than 150 s and 8 GB, and all four
  bases less than 15 min;
- the exponent is below 1.5, and the time of a step at each size within 20 % of their mean;
- the force error is 1 %;
- the on-line run is 3000 times faster than the full FE model's implicit stepping;
- reduction and run together are 50 times faster than its explicit stepping, from which the paper has its factor of 20.

    python -m validation.benchmarks.size [--only small medium large bases full]

Cases are kept in size.json. Without `--only` all run again.
"""

import argparse
import json
import os
import platform
import resource
import sys
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from validation.processes import in_a_process

RESULTS = Path(__file__).with_suffix(".json")
F_CUT, END_TIME, RUNS = 40e3, 1e-3, 10
WHOLE, COMPARED, STEP = 5e-3, 0.3e-3, 1e-6  # the paper's duration, the part that the full FE model runs, its step [s]
MAXH = {"small": 18e-3, "medium": 8e-3, "large": 3.7e-3}  # [m]
CASES = [*MAXH, "bases", "full"]
LIMITS = {
    "nodes": 95_000, "reduce_s": 150.0, "memory_GB": 8.0, "bases_s": 900.0, "exponent": 1.5, "spread": 0.20,
    "force_error": 0.01, "implicit_over_online": 3000.0, "explicit_over_all": 50.0,
}  # fmt: skip
AT_LEAST = "nodes", "implicit_over_online", "explicit_over_all"


def reduce_both(fems, partitions, basis):
    import exudyn_partition as ep

    bodies = []
    for fem, partition in zip(fems, partitions, strict=True):
        with ep.progress(f"reduce {fem.n_nodes} nodes, {basis}") as report:
            bodies.append(ep.reduce(fem, partition, basis=basis, f_cut=F_CUT, progress=report))
    return bodies


def run_online(bodies, end_time=END_TIME):
    """Result of the impact in Exudyn."""
    import exudyn as exu

    import exudyn_partition as ep
    from examples.models import rod_on_plate as example

    mbs = exu.SystemContainer().AddSystem()
    rod = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -example.SPEED])
    plate = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, rod, plate)
    mbs.Assemble()
    return contact, ep.solve_dynamic(mbs, end_time=end_time, method="explicit")


def peak_memory():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def size_case(maxh):
    """One mesh: off-line times, peak memory, and the quickest of the on-line runs, the least disturbed one."""
    from examples.models import rod_on_plate as example

    fems, partitions, times = example.fe_models(quick=False, maxh=maxh)
    bodies = reduce_both(fems, partitions, "contact-adapted")
    memory = peak_memory()
    runs = [run_online(bodies) for _ in range(RUNS)]
    contact, result = runs[0]
    online_s = min(result.time_s for _, result in runs)
    return {
        "maxh_m": maxh,
        "nodes": sum(fem.n_nodes for fem in fems),
        "nodes_of_each": [fem.n_nodes for fem in fems],
        **times,
        "reduce_s": sum(body.reduce_s for body in bodies),
        "reduce_s_of_each": [body.reduce_s for body in bodies],
        "memory_GB": memory,
        "reduced_dofs": sum(body.n_dofs for body in bodies),
        "contact_rows": contact.n_rows,
        "online_s": online_s,
        "steps": result.steps,
        "step_size_s": result.step,
        "time_per_step_s": online_s / result.steps,
    }


def bases_case(maxh):
    """All bases on one mesh, off-line."""
    from examples.models import rod_on_plate as example

    fems, partitions, times = example.fe_models(quick=False, maxh=maxh)
    result = {"maxh_m": maxh, "nodes": sum(fem.n_nodes for fem in fems), **times, "bases": {}}
    for basis in ("contact-adapted", "residual", "craig-bampton", "free"):
        bodies = reduce_both(fems, partitions, basis)
        result["bases"][basis] = {
            "reduce_s": sum(body.reduce_s for body in bodies),
            "reduced_dofs": sum(body.n_dofs for body in bodies),
            "memory_so_far_GB": peak_memory(),
        }
        del bodies
    result["reduce_s"] = sum(case["reduce_s"] for case in result["bases"].values())
    return result


def full_case(maxh):
    """The full FE model on one mesh: its implicit and explicit steps, compared with the reduced bodies."""
    from examples.models import rod_on_plate as example
    from validation.paper import cost

    fems, partitions, _ = example.fe_models(quick=False, maxh=maxh)
    reference = example.full_reference(fems, partitions, COMPARED, STEP)
    bodies = reduce_both(fems, partitions, "contact-adapted")
    contact, short = run_online(bodies, COMPARED)
    force = np.interp(reference.t, short.t, contact.force(short))
    runs = [run_online(bodies, WHOLE)[1] for _ in range(RUNS)]
    online_s = min(run.time_s for run in runs)
    reduce_s = sum(body.reduce_s for body in bodies)
    explicit = cost.explicit_stepping(fems, partitions)
    implicit_s = reference.info["time_s"] / reference.info["steps"] * WHOLE / STEP
    explicit_s = explicit["step_time_s"] * explicit["steps"]
    return {
        "maxh_m": maxh,
        "nodes": sum(fem.n_nodes for fem in fems),
        "force_error": float(np.linalg.norm(force - reference.force) / np.linalg.norm(reference.force)),
        "reduce_s": reduce_s,
        "online_s": online_s,
        "implicit_s": implicit_s,
        "explicit": explicit,
        "explicit_s": explicit_s,
        "implicit_over_online": implicit_s / online_s,
        "implicit_over_all": implicit_s / (reduce_s + online_s),
        "explicit_over_all": explicit_s / (reduce_s + online_s),
    }


def evaluate(cases):
    """Results of the three sizes, and the limits that do not hold."""
    sizes = [cases[name] for name in MAXH]
    large, bases, full = cases["large"], cases["bases"], cases["full"]
    logs = np.log([[case["nodes"], case["reduce_s"]] for case in sizes])
    exponent = float(np.polyfit(*logs.T, 1)[0])
    per_step = np.array([case["time_per_step_s"] for case in sizes])
    spread = float(abs(per_step / per_step.mean() - 1).max())
    found = {
        "nodes": large["nodes"],
        "reduce_s": large["reduce_s"],
        "memory_GB": large["memory_GB"],
        "bases_s": bases["reduce_s"],
        "exponent": exponent,
        "spread": spread,
        **{key: full[key] for key in ("force_error", "implicit_over_online", "explicit_over_all")},
    }
    failed = [
        f"{key} {value:.3g}, limit {LIMITS[key]:.3g}"
        for key, value in found.items()
        if (value < LIMITS[key] if key in AT_LEAST else value > LIMITS[key])
    ]
    return found, failed


def show(cases):
    table = Table("", *(name for name in MAXH if name in cases), title="rod on plate, contact-adapted, 40 kHz")
    for key in ("mesh_s", "fem_s", "reduce_s", "memory_GB", "online_s", "time_per_step_s"):
        table.add_row(key, *(f"{cases[name][key]:.3g}" for name in MAXH if name in cases))
    for key in ("nodes", "reduced_dofs", "contact_rows", "steps"):
        table.add_row(key, *(str(cases[name][key]) for name in MAXH if name in cases))
    Console().print(table)
    if "bases" in cases:
        table = Table("basis", "reduction [s]", "reduced dofs", title=f"{cases['bases']['nodes']} nodes")
        for basis, case in cases["bases"]["bases"].items():
            table.add_row(basis, f"{case['reduce_s']:.1f}", str(case["reduced_dofs"]))
        Console().print(table)
    if "full" in cases:
        table = Table("", "", title=f"full FE model, {cases['full']['nodes']} nodes, 5 ms by the time of a step")
        for key, value in cases["full"].items():
            if isinstance(value, float):
                table.add_row(key, f"{value:.4g}")
        Console().print(table)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=CASES, default=CASES, help="cases to run anew; others are kept")
    parser.add_argument("--case", choices=CASES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        on_largest = {"bases": bases_case, "full": full_case}
        measure = on_largest.get(options.case, size_case)
        print(json.dumps(measure(MAXH.get(options.case, MAXH["large"]))))
        return
    import exudyn_partition as ep

    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {"cases": {}}
    for name in options.only:
        begin = time.perf_counter()
        print(f"{name} ...", file=sys.stderr, flush=True)
        results["cases"][name] = in_a_process(__file__, "--case", name) | {"versions": ep.versions()}
        print(f"{name}: {time.perf_counter() - begin:.0f} s in all", file=sys.stderr, flush=True)
        results |= {"limits": LIMITS, "machine": {"cpus": os.cpu_count(), "platform": platform.platform()}}
        RESULTS.write_text(json.dumps(results, indent=1) + "\n")
    show(results["cases"])
    if missing := [name for name in CASES if name not in results["cases"]]:
        sys.exit(f"not yet run: {', '.join(missing)}")
    results["found"], failed = evaluate(results["cases"])
    RESULTS.write_text(json.dumps(results, indent=1) + "\n")
    print(*(f"{key}: {value:.4g} (limit {LIMITS[key]:.4g})" for key, value in results["found"].items()), sep="\n")
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
