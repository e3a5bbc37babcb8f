"""Large bodies that yield: time and memory of their reduction, and their impact against the full FE model.

The ball on the plate of `impact.py` at 10 times the speed at first yield, with the same contact and plastic zone, and
finer elements everywhere else: 120 000 unknowns, and 97 000 nodes.
Each case runs in a process of its own, so that its peak memory is its own. At the first size the bodies are reduced
with the plastic zone and, on the same mesh, as elastic ones. The impact runs, and the full FE model with the same mesh,
rows, zone and steps, from start to end. At the second size the bodies are reduced with the zone, for the memory.
Reference: the full FE model; the elastic reduction. Quantity: the time of the full FE model's stepping by that of the
run, in processor time, the latter with the set-up of the model; the relative L2 error of the force, the relative error
of plastic work; the processor time of the plastic reduction by the elastic one's, and its peak memory with meshing.
Limits: at least 200 times as fast, errors of 1 %, at most 3 times the elastic time, 8e9 bytes.

    python -m validation.inelastic.large [--only CASE ...]

Cases are kept in large.json. Without `--only` all run again; `--only` alone judges what is kept.
"""

import argparse
import json
import math
import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes
from validation.inelastic import impact
from validation.processes import in_a_process

RESULTS = Path(__file__).with_suffix(".json")
RATIO = 10.0
FINE, FINEST = "120 000 dofs", "97 000 nodes"
SIZES = {FINE: (0.6e-3, 0.9e-3), FINEST: (0.7e-3, 0.62e-3)}  # largest elements of ball and plate [m]
RUN = "impact"
CASES = [RUN, f"elastic, {FINE}", f"plastic, {FINE}", f"plastic, {FINEST}"]
LIMITS = {"faster": 200.0, "force": 0.01, "work": 0.01, "offline": 3.0, "memory_GB": 8.0}


def elastic(fem, part):
    """The same mesh and patches without plastic zones."""
    fem = replace(fem, material=replace(fem.material, hardening=None))
    return fem, replace(part, patches=tuple(replace(patch, plastic=None, material=None) for patch in part.patches))


def reduction(kind, size):
    """Both bodies: processor time of their reduction, and the peak memory of this process."""
    models, _, _ = impact.scene(RATIO, maxh=SIZES[size])
    if kind == "elastic":
        models = [elastic(*model) for model in models]
    begin = time.process_time()
    bodies = [ep.reduce(*model, f_cut=impact.F_CUT) for model in models]
    zone = models[1][1].patches[0].plastic
    return {
        "nodes": [fem.n_nodes for fem, _ in models],
        "dofs": sum(fem.n_dofs for fem, _ in models),
        "zone_nodes": 0 if zone is None else len(zone.nodes),
        "coordinates": sum(body.n_dofs for body in bodies),
        "cpu_s": time.process_time() - begin,
        "reduce_s": sum(body.reduce_s for body in bodies),
        "memory_GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
    }


def run():
    """The impact, and the full FE model with the same steps."""
    models, speed, _ = impact.scene(RATIO, maxh=SIZES[FINE])
    bodies = [ep.reduce(*model, f_cut=impact.F_CUT) for model in models]
    masses = [body.total_mass for body in bodies]
    hertz = ep.hertz.impact(ep.hertz.effective(*masses), speed, impact.RADIUS, math.inf, impact.STEEL, impact.ALUMINIUM)
    end = 2.5 * hertz.duration
    impact.reduced_run(bodies, speed, end / 10)  # loads what is compiled
    begin = time.process_time()
    items, contact, result = impact.reduced_run(bodies, speed, end)
    online_cpu_s = time.process_time() - begin
    full = [ep.reference.FullBody(*model, velocity=(0, 0, v)) for model, v in zip(models, (-speed, 0), strict=True)]
    if contact.slave is not items[0]:
        full = full[::-1]
    begin = time.process_time()
    reference = ep.reference.simulate(full, end_time=end, step=result.step)
    reference_cpu_s = time.process_time() - begin - reference.info["setup_s"]
    work = contact.plastic.work(result)
    plastic_steps = int(np.count_nonzero(np.diff(work) > 0))
    return {
        "dofs": sum(fem.n_dofs for fem, _ in models),
        "zone_nodes": len(models[1][1].patches[0].plastic.nodes),
        "steps": result.steps,
        "plastic_steps": plastic_steps,
        "force": ep.compare(result.history(contact), reference).error["force"],
        "work": abs(work[-1] / sum(reference.info["plastic_work_J"]) - 1),
        "online_s": result.time_s,
        "reference_s": reference.info["time_s"],
        "online_cpu_s": online_cpu_s,  # with the set-up of the model
        "reference_cpu_s": reference_cpu_s,
        "cpu_ms_a_plastic_step": 1e3 * online_cpu_s / plastic_steps,
        "faster": reference_cpu_s / online_cpu_s,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", choices=CASES, default=CASES, help="cases to run anew; others are kept")
    parser.add_argument("--case", choices=CASES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        print(json.dumps(run() if options.case == RUN else reduction(*options.case.split(", ")), default=float))
        return
    begin, console = time.perf_counter(), Console(width=150)
    cases = json.loads(RESULTS.read_text())["cases"] if RESULTS.exists() else {}
    for name in options.only:
        cases[name] = in_a_process(__file__, "--case", name)
        console.print(name, cases[name])
        RESULTS.write_text(json.dumps({"cases": cases}, indent=1) + "\n")
    found = {key: cases[RUN][key] for key in ("faster", "force", "work")} if RUN in cases else {}
    elastic_one, plastic_one = (cases.get(f"{kind}, {FINE}") for kind in ("elastic", "plastic"))
    if elastic_one and plastic_one:
        found["offline"] = plastic_one["cpu_s"] / elastic_one["cpu_s"]
    if finest := cases.get(f"plastic, {FINEST}"):
        found["memory_GB"] = finest["memory_GB"]
    failed = [
        f"{key} {value:.3g}, limit {LIMITS[key]:g}"
        for key, value in found.items()
        if not (value >= LIMITS[key] if key == "faster" else value <= LIMITS[key])
    ] + [f"not yet run: {name}" for name in CASES if name not in cases]
    result = {"found": found, "limits": LIMITS, "cases": cases, "time_s": time.perf_counter() - begin}
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
