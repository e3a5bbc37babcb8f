"""Error against number of coordinates and run time, for the four bases on the rod on plate over 5 ms.

Mesh: the example's `--quick` one, for bases whose patch has mass take steps of nanoseconds. The patches are the
example's too, so that all cases and references have the same contact rows (in the stored results node-to-segment).
Cases: all four bases at 5, 10, 20 and 40 kHz, `free` with an impact region of 1 mm radius in both bodies. Beside them
`free` with the patch's own nodes only, with the example's region of 1.5 mm, and at 80 kHz; `contact-adapted` and
`residual` at lower and higher frequencies: so numbers of coordinates come as near to each other as they can.
References: the full FE model, HHT steps of 1 us, and of half that, which says how far down errors mean anything.
Quantities: relative L2 errors over 5 ms (ep.compare) of contact force and velocities of P1 and P2; number of reduced
coordinates of both bodies; times of reduction (off-line) and of Exudyn's solver (on-line) with its default step.

Criteria, for each quantity and each `free` case that reached the end, none left out:
- at equal error: among the `contact-adapted` cases with no larger error, the one with fewest coordinates; it has at
  most a tenth of those of `free`;
- at equal coordinates: among the `contact-adapted` cases with no more coordinates, the one with the smallest error; it
  has at most a tenth of that of `free`.
Both compare from the safe side: nothing is interpolated, `free` has the larger error or more coordinates. The contact
force against the 1 us reference decides; P1, P2 and the finer reference are reported beside it.

Each case goes to bases.json as soon as it is done, and is not repeated without --again; references are kept in out/.

    python validation/benchmarks/bases.py [--again]
"""

import argparse
import json
import os
import platform
import sys
import time
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import exudyn_partition as ep

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "examples"))
import rod_on_plate as example  # noqa: E402

RESULTS = Path(__file__).with_suffix(".json")
OUT = ROOT / "out" / "benchmarks"
END_TIME = 5e-3  # [s]
REFERENCES = {"1 us": 1e-6, "0.5 us": 0.5e-6}  # steps [s]; the first decides
JUDGE, FINER = REFERENCES
QUANTITIES = ("force", "P1", "P2")
RATIOS = {"coordinates": "dofs at no larger error", "error": "error at no more dofs"}
TENTH = 0.1
PATCH, REGION, EXAMPLE = 0.0, 1.0e-3, 1.5e-3  # radii of the impact region [m]


@dataclass(frozen=True)
class Case:
    """A basis, its truncation frequency [Hz], and the radius of the impact region [m], which only `free` has."""

    basis: str
    f_cut: float
    region: float = REGION

    def __str__(self):
        name = f"{self.basis}, {1e-3 * self.f_cut:g} kHz"
        return f"{name}, {region_name(self.region)}" if self.basis == "free" else name


def region_name(radius):
    return f"region {1e3 * radius:g} mm" if radius else "patch only"


BASES = ("contact-adapted", "residual", "craig-bampton", "free")
REQUIRED = [Case(basis, f_cut) for basis in BASES for f_cut in (5e3, 10e3, 20e3, 40e3)]
BESIDE = [
    *(Case("contact-adapted", f_cut) for f_cut in (1.25e3, 2.5e3, 80e3, 120e3)),
    *(Case("residual", f_cut) for f_cut in (2.5e3, 80e3)),
    *(Case("free", f_cut, PATCH) for f_cut in (5e3, 10e3, 20e3, 40e3)),
    Case("free", 80e3),
    *(Case("free", f_cut, EXAMPLE) for f_cut in (20e3, 40e3, 80e3)),
]


def with_region(fems, partitions, radius):
    """The same patches with the impact region of all nodes within `radius`, which holds at least the patch."""
    return [
        replace(p, nodes=np.union1d(p.patch_nodes, np.flatnonzero(np.linalg.norm(fem.points, axis=1) <= radius)))
        for fem, p in zip(fems, partitions, strict=True)
    ]


def run(case, fems, partitions, references):
    """One case; one that cannot be run, becomes unstable or ends early says so in its status and message."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    regions = with_region(fems, partitions, case.region)
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", ep.errors.PartitionWarning)
            rod, plate, contact, result, reduce_s = example.partition_run(
                fems, regions, case.basis, case.f_cut, "explicit", END_TIME
            )
        history = result.history(contact, {"P1": (rod, example.P1), "P2": (plate, example.P2)})
        error = {name: ep.compare(history, reference).error for name, reference in references.items()}
    except ep.errors.PartitionError as problem:
        return {"status": "failed", "message": str(problem)}
    return {
        "status": result.status,
        "message": result.message,
        "warnings": [str(w.message) for w in said if issubclass(w.category, ep.errors.PartitionWarning)],
        "dofs": rod.body.n_dofs + plate.body.n_dofs,
        "dofs_rod_plate": [rod.body.n_dofs, plate.body.n_dofs],
        "error": error,
        "offline_s": reduce_s,
        "online_s": result.time_s,
        "step_s": result.step,
        "steps": result.steps,
        "end_time_s": float(result.t[-1]),
        "peak_force_N": history.peak_force,
        "impulse_Ns": history.impulse,
        "load_average": load,
    }


def model(fems, partitions, times):
    """What mesh and regions are."""
    return {
        "source": "examples/rod_on_plate.py --quick: rod, plate",
        "fe_nodes": [fem.n_nodes for fem in fems],
        "fe_dofs": [fem.n_dofs for fem in fems],
        "resolved_frequency_Hz": [fem.resolved_frequency for fem in fems],
        "patch_nodes": [len(p.patch_nodes) for p in partitions],
        "region_nodes": {
            region_name(radius): [len(p.nodes) for p in with_region(fems, partitions, radius)]
            for radius in (PATCH, REGION, EXAMPLE)
        },
        **times,
    }


def reference_of(fems, partitions, step, again):
    """The full FE history, kept in out/ for the next run of the same mesh and versions."""
    path = OUT / f"bases_reference_{1e9 * step:.0f}_ns.npz"
    if path.exists() and not again:
        kept = ep.History.load(path)
        if kept.info["dofs"] == sum(fem.n_dofs for fem in fems) and kept.info["versions"] == ep.versions():
            return kept
    history = example.full_reference(fems, partitions, END_TIME, step)
    OUT.mkdir(parents=True, exist_ok=True)
    history.save(path)
    print(f"reference, steps of {step:g} s: {history.info['time_s']:.0f} s", flush=True)
    return history


def measure(again):
    """Measure what bases.json lacks; returns all that it holds then."""
    data = {} if again or not RESULTS.exists() else json.loads(RESULTS.read_text())
    here = {"versions": ep.versions(), "cpus": os.cpu_count(), "platform": platform.platform()}
    if data.setdefault("environment", here) != here:
        print(f"{RESULTS.name} was measured elsewhere or with other versions: --again measures all of it here")
    cases = data.setdefault("cases", {})
    missing = [case for case in REQUIRED + BESIDE if str(case) not in cases]
    if not missing:
        return data
    fems, partitions, times = example.fe_models(quick=True)
    references = {name: reference_of(fems, partitions, step, again) for name, step in REFERENCES.items()}
    data["model"] = model(fems, partitions, times)
    data["references"] = {name: r.info | {"peak_force_N": r.peak_force} for name, r in references.items()}
    data["reference_step_error"] = ep.compare(references[JUDGE], references[FINER]).error
    for number, case in enumerate(missing, 1):
        begin = time.perf_counter()
        entry = run(case, fems, partitions, references)
        about = {"basis": case.basis, "f_cut_Hz": case.f_cut, "region_m": case.region}
        cases[str(case)] = about | entry | {"case_s": time.perf_counter() - begin}
        write(data)
        print(f"{number:2}/{len(missing)} {line(str(case), entry)}", flush=True)
    return data


def write(data):
    RESULTS.write_text(json.dumps(data, indent=1) + "\n")


def line(name, case):
    """One case in a line."""
    if "error" not in case:
        return f"{name:32} {case['status']}: {case['message']}"
    errors = " ".join(f"{case['error'][JUDGE][quantity]:8.2%}" for quantity in QUANTITIES)
    finer = " ".join(f"{case['error'][FINER][quantity]:8.2%}" for quantity in QUANTITIES)
    end = "" if case["status"] == "finished" else f"  {case['status']} at {case['end_time_s']:.3g} s"
    return (
        f"{name:32} {case['dofs']:5} {errors}  {finer} {case['offline_s']:7.1f} s {case['online_s']:8.3g} s "
        f"{case['steps']:7}{end}"
    )


def table(data):
    """All cases as text."""
    head = " ".join(f"{quantity:>8}" for quantity in QUANTITIES)
    rows = [f"{'case':32} {'dofs':>5} {head}  {head} {'off-line':>9} {'on-line':>10} {'steps':>7}"]
    rows += [line(name, case) for name, case in ordered(data["cases"])]
    for name, reference in data["references"].items():
        rows.append(f"full FE, steps of {name}: {reference['dofs']} dofs, {reference['time_s']:.0f} s")
    errors = ", ".join(f"{key} {value:.2%}" for key, value in data["reference_step_error"].items())
    rows.append(f"errors against {JUDGE} on the left, {FINER} on the right; between these {errors}")
    return "\n".join(rows)


def ordered(cases):
    """All cases by basis, region and frequency."""
    return sorted(cases.items(), key=lambda i: (BASES.index(i[1]["basis"]), i[1]["region_m"], i[1]["f_cut_Hz"]))


def finished(cases, basis):
    return {name: case for name, case in ordered(cases) if case["basis"] == basis and case["status"] == "finished"}


def criteria(cases, reference, quantity):
    """Both criteria of one quantity for each `free` case, and the worst ratio of each, None if one has no answer."""
    adapted = finished(cases, "contact-adapted")
    error = {name: case["error"][reference][quantity] for name, case in adapted.items()}
    found = {}
    for name, free in finished(cases, "free").items():
        free_error = free["error"][reference][quantity]
        as_good = [other for other in adapted if error[other] <= free_error]
        as_small = [other for other in adapted if adapted[other]["dofs"] <= free["dofs"]]
        fewest = min(as_good, key=lambda other: adapted[other]["dofs"], default=None)
        best = min(as_small, key=error.get, default=None)
        found[name] = {
            "at_equal_error": fewest,
            "coordinates": adapted[fewest]["dofs"] / free["dofs"] if fewest else None,
            "at_equal_coordinates": best,
            "error": error[best] / free_error if best else None,
        }
    return {"free_cases": found} | {key: worst([f[key] for f in found.values()]) for key in RATIOS}


def worst(ratios):
    return None if not ratios or None in ratios else max(ratios)


def met(ratio):
    return ratio is not None and ratio <= TENTH


def show(ratio):
    return f"{'none':>8}" if ratio is None else f"{f'1/{1 / ratio:.1f}':>7}{' ' if met(ratio) else '!'}"


def verdict(found):
    """Both criteria as text, a table for each reference."""
    rows = []
    for reference, results in found.items():
        for key, what in RATIOS.items():
            rows.append(f"contact-adapted over free, {what} ({', '.join(QUANTITIES)}; reference {reference})")
            for name in results[QUANTITIES[0]]["free_cases"]:
                rows.append(
                    f"  {name:30}" + " ".join(show(results[quantity]["free_cases"][name][key]) for quantity in results)
                )
            rows.append(f"  {'worst':30}" + " ".join(show(results[quantity][key]) for quantity in results))
    return "\n".join(rows)


def picture(data, path):
    """Error of the force against coordinates and against on-line time, a line a basis and region."""
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.6), sharey=True, layout="constrained")
    lines = {}
    for _, case in ordered(data["cases"]):
        if case["status"] == "finished":
            name = f"free, {region_name(case['region_m'])}" if case["basis"] == "free" else case["basis"]
            lines.setdefault(name, []).append(case)
    colours = {"contact-adapted": "C3", "residual": "C1", "craig-bampton": "C2", "free": "C0"}
    dashes = {PATCH: ":", REGION: "-", EXAMPLE: "--"}
    for name, cases in lines.items():
        style = {"color": colours[cases[0]["basis"]], "linestyle": dashes[cases[0]["region_m"]], "marker": "o"}
        error = [case["error"][JUDGE]["force"] for case in cases]
        for ax, key in zip(axes, ("dofs", "online_s"), strict=True):
            ax.loglog([case[key] for case in cases], error, markersize=4, label=name, **style)
    for ax in axes:
        ax.axhline(data["reference_step_error"]["force"], color="0.6", linewidth=1, label="reference, half the step")
        ax.grid(True, which="major", color="0.9")
    run_time = data["references"][JUDGE]["time_s"]
    axes[1].axvline(run_time, color="0.6", linestyle="--", linewidth=1, label="reference's run time")
    axes[0].set(xlabel="reduced coordinates", ylabel="relative L2 error of the contact force")
    axes[1].set(xlabel="on-line time [s]")
    axes[1].legend(fontsize="small")
    figure.savefig(path, dpi=150)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--again", action="store_true", help="measure everything anew")
    data = measure(parser.parse_args().again)
    cases = data["cases"]
    data["criteria"] = {
        reference: {quantity: criteria(cases, reference, quantity) for quantity in QUANTITIES}
        for reference in REFERENCES
    }
    write(data)
    print(table(data))
    print(verdict(data["criteria"]))
    OUT.mkdir(parents=True, exist_ok=True)
    picture(data, OUT / "bases.png")
    print(OUT / "bases.png")
    failed = [f"{case}: {cases[str(case)]['status']}" for case in REQUIRED if cases[str(case)]["status"] != "finished"]
    force = data["criteria"][JUDGE]["force"]
    failed += [f"force, {what}: {show(force[key]).strip()}" for key, what in RATIOS.items() if not met(force[key])]
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
