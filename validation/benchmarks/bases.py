"""Error against number of coordinates and run time, for the four bases on the rod on plate over 5 ms.

Mesh: the example's `--quick` one, for the bases whose impact region has mass take steps of nanoseconds. Their patches
are the example's too, so that every case and the reference have the same contact rows.
Cases: all four bases at 5, 10, 20 and 40 kHz, `free` with an impact region of 1 mm radius in both bodies. Beside them
`free` with the patch's own nodes only, with the example's region of 1.5 mm, and at 80 kHz; `contact-adapted` and
`residual` at lower and higher frequencies: so numbers of coordinates come as near to each other as they can.
Reference: the full FE model, 1 us HHT steps; how much steps of half the length change it over the first millisecond
says how far down errors mean anything.
Quantities: relative L2 errors over 5 ms (ep.compare) of contact force and velocities of P1 and P2; number of reduced
coordinates of both bodies; times of reduction (off-line) and of Exudyn's solver (on-line), default steps.

Criteria, for each quantity and each `free` case that reached the end, none left out:
- at equal error: among the `contact-adapted` cases with no larger error, the one with fewest coordinates; it has at
  most a tenth of those of `free`;
- at equal coordinates: among the `contact-adapted` cases with no more coordinates, the one with the smallest error; it
  has at most a tenth of that of `free`.
Both compare from the safe side: no error is interpolated, and `free` has the larger error or more coordinates.
The contact force decides; P1 and P2 are reported beside it.

Each case goes to bases.json as soon as it is done, and is not repeated without --again.

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
QUANTITIES = ("force", "P1", "P2")
TENTH = 0.1
PATCH, REGION, EXAMPLE = 0.0, 1.0e-3, 1.5e-3  # radii of the impact region [m]


@dataclass(frozen=True)
class Case:
    """A basis, its truncation frequency [Hz], and the radius of the impact region [m], which only `free` has."""

    basis: str
    f_cut: float
    region: float = REGION

    def __str__(self):
        at = f"{self.basis}, {1e-3 * self.f_cut:g} kHz"
        return at + f", {region_name(self.region)}" if self.basis == "free" else at


def region_name(radius):
    return f"region {1e3 * radius:g} mm" if radius else "patch only"


REQUIRED = [
    Case(basis, f_cut)
    for basis in ("contact-adapted", "residual", "craig-bampton", "free")
    for f_cut in (5e3, 10e3, 20e3, 40e3)
]
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


def run(case, fems, partitions, reference):
    """One case; one that cannot be run, becomes unstable or ends early says so in its status and message."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", ep.errors.PartitionWarning)
            rod, plate, contact, result, reduce_s = example.partition_run(
                fems, with_region(fems, partitions, case.region), case.basis, case.f_cut, "explicit", END_TIME
            )
        history = result.history(contact, {"P1": (rod, example.P1), "P2": (plate, example.P2)})
        errors = ep.compare(history, reference)
    except ep.errors.PartitionError as error:
        return {"status": "failed", "message": str(error)}
    return {
        "status": result.status,
        "message": result.message,
        "warnings": [str(w.message) for w in said if issubclass(w.category, ep.errors.PartitionWarning)],
        "dofs": rod.body.n_dofs + plate.body.n_dofs,
        "dofs_rod_plate": [rod.body.n_dofs, plate.body.n_dofs],
        "error": errors.error,
        "compared_until_s": errors.end_time,
        "offline_s": reduce_s,
        "online_s": result.time_s,
        "step_s": result.step,
        "steps": result.steps,
        "peak_force_N": history.peak_force,
        "impulse_Ns": history.impulse,
        "load_average": load,
    }


def model(fems, partitions, times):
    """What the mesh and the regions are."""
    return {
        "source": "examples/rod_on_plate.py --quick: rod, plate",
        "fe_dofs": [fem.n_dofs for fem in fems],
        "resolved_frequency_Hz": [fem.resolved_frequency for fem in fems],
        "patch_nodes": [len(p.patch_nodes) for p in partitions],
        "region_nodes": {
            region_name(radius): [len(p.nodes) for p in with_region(fems, partitions, radius)]
            for radius in (PATCH, REGION, EXAMPLE)
        },
        **times,
    }


def measure(again):
    """Measure what bases.json lacks; returns all that it holds then."""
    data = {} if again or not RESULTS.exists() else json.loads(RESULTS.read_text())
    here = {"versions": ep.versions(), "cpus": os.cpu_count(), "platform": platform.platform()}
    if data.setdefault("environment", here) != here:
        print(f"{RESULTS.name} was measured elsewhere, or with other versions: --again measures all of it here")
    cases = data.setdefault("cases", {})
    missing = [case for case in REQUIRED + BESIDE if str(case) not in cases]
    if not missing:
        return data

    begin, spent = time.perf_counter(), data.get("script_s", 0.0)

    def keep():
        data["script_s"] = spent + time.perf_counter() - begin
        RESULTS.write_text(json.dumps(data, indent=1) + "\n")

    fems, partitions, times = example.fe_models(quick=True)
    data.setdefault("model", model(fems, partitions, times))
    stored = OUT / "bases_reference.npz"
    OUT.mkdir(parents=True, exist_ok=True)
    if "reference" not in data or not stored.exists():
        reference = example.full_reference(fems, partitions, END_TIME)
        reference.save(stored)
        finer = example.full_reference(fems, partitions, 1e-3, step=0.5e-6)
        data["reference"] = reference.info | {
            "peak_force_N": reference.peak_force,
            "error_of_step": ep.compare(reference.until(1e-3), finer).error,
        }
        print(f"reference: {reference.info['time_s']:.0f} s", flush=True)
        keep()
    reference = ep.History.load(stored)
    for number, case in enumerate(missing, 1):
        entry = run(case, fems, partitions, reference)
        cases[str(case)] = {"basis": case.basis, "f_cut_Hz": case.f_cut, "region_m": case.region} | entry
        keep()
        print(f"{number}/{len(missing)} {case}: {line(entry)}", flush=True)
    return data


def line(entry):
    """One case in a line."""
    if "error" not in entry:
        return f"{entry['status']}: {entry['message']}"
    errors = ", ".join(f"{name} {value:.2%}" for name, value in entry["error"].items())
    end = "" if entry["status"] == "finished" else f" {entry['status'].upper()}: {entry['message']}"
    return (
        f"{entry['dofs']} coordinates, {errors}, off-line {entry['offline_s']:.1f} s, "
        f"on-line {entry['online_s']:.3g} s{end}"
    )


def ordered(cases):
    """All cases by basis, region and number of coordinates."""
    order = [case.basis for case in REQUIRED]
    return sorted(cases.items(), key=lambda item: (order.index(item[1]["basis"]), item[1]["region_m"], rank(item[1])))


def rank(entry):
    return entry.get("dofs", np.inf)


def table(data):
    """All cases, as text."""
    reference, cases = data["reference"], data["cases"]
    rows = [f"{'case':32} {'coord.':>6} {'force':>8} {'P1':>8} {'P2':>8} {'off-line':>9} {'on-line':>9} {'steps':>7}"]
    for name, entry in ordered(cases):
        if "error" not in entry:
            rows.append(f"{name:32} {entry['status']}: {entry['message']}")
            continue
        errors = " ".join(f"{entry['error'][quantity]:8.2%}" for quantity in QUANTITIES)
        rows.append(
            f"{name:32} {entry['dofs']:6} {errors} {entry['offline_s']:7.1f} s {entry['online_s']:7.3g} s "
            f"{entry['steps']:7}" + f"  {entry['status']}" * (entry["status"] != "finished")
        )
    halved = ", ".join(f"{key} {value:.2%}" for key, value in reference["error_of_step"].items())
    rows.append(f"full FE: {reference['dofs']} dofs, {reference['time_s']:.0f} s; half the step changes {halved}")
    return "\n".join(rows)


def criteria(cases):
    """Both criteria for each quantity and each `free` case, and the worst ratios of each quantity."""
    finished = {name: case for name, case in cases.items() if case["status"] == "finished"}
    adapted = {name: case for name, case in finished.items() if case["basis"] == "contact-adapted"}
    paper = [(name, case) for name, case in ordered(finished) if case["basis"] == "free"]
    found = {}
    for quantity in QUANTITIES:
        ratios = {}
        for name, case in paper:
            error = {key: other["error"][quantity] for key, other in adapted.items()}
            as_good = [key for key in adapted if error[key] <= case["error"][quantity]]
            as_small = [key for key in adapted if adapted[key]["dofs"] <= case["dofs"]]
            fewest = min(as_good, key=lambda key: adapted[key]["dofs"], default=None)
            best = min(as_small, key=lambda key: error[key], default=None)
            ratios[name] = {
                "at_equal_error": fewest,
                "coordinates_ratio": adapted[fewest]["dofs"] / case["dofs"] if fewest else None,
                "at_equal_coordinates": best,
                "error_ratio": error[best] / case["error"][quantity] if best else None,
            }
        found[quantity] = {
            "free_cases": ratios,
            **{key: worst([r[key] for r in ratios.values()]) for key in ("coordinates_ratio", "error_ratio")},
        }
    return found


def worst(ratios):
    """The largest, None if there is none or one case found no counterpart."""
    return None if not ratios or None in ratios else max(ratios)


def met(ratio):
    return ratio is not None and ratio <= TENTH


def verdict(found):
    """Both criteria as text."""

    def show(ratio):
        return "none" if ratio is None else f"1/{1 / ratio:.1f}"

    rows = []
    for quantity, result in found.items():
        rows.append(f"{quantity}: contact-adapted over free")
        for name, r in result["free_cases"].items():
            rows.append(
                f"  {name:30} coordinates {show(r['coordinates_ratio']):>7} at no larger error ({r['at_equal_error']}), "
                f"error {show(r['error_ratio']):>7} at no more coordinates ({r['at_equal_coordinates']})"
            )
        for key, what in (("coordinates_ratio", "coordinates"), ("error_ratio", "error")):
            rows.append(f"  worst {what}: {show(result[key])}, {'met' if met(result[key]) else 'NOT MET'}")
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
        error = [case["error"]["force"] for case in cases]
        for ax, key in zip(axes, ("dofs", "online_s"), strict=True):
            ax.loglog([case[key] for case in cases], error, markersize=4, label=name, **style)
    reference = data["reference"]
    for ax in axes:
        ax.axhline(reference["error_of_step"]["force"], color="0.6", linewidth=1, label="reference, half the step")
        ax.grid(True, which="major", color="0.9")
    axes[1].axvline(reference["time_s"], color="0.6", linestyle="--", linewidth=1, label="reference's run time")
    axes[0].set(xlabel="reduced coordinates", ylabel="relative L2 error of the contact force")
    axes[1].set(xlabel="on-line time [s]")
    axes[1].legend(fontsize="small")
    figure.savefig(path, dpi=150)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--again", action="store_true", help="measure everything anew")
    data = measure(parser.parse_args().again)
    data["criteria"] = criteria(data["cases"])
    RESULTS.write_text(json.dumps(data, indent=1) + "\n")
    print(table(data))
    print(verdict(data["criteria"]))
    OUT.mkdir(parents=True, exist_ok=True)
    picture(data, OUT / "bases.png")
    print(OUT / "bases.png")
    failed = [f"{case} {data['cases'][str(case)]['status']}" for case in REQUIRED if not finished(data, case)]
    force = data["criteria"]["force"]
    failed += [key for key in ("coordinates_ratio", "error_ratio") if not met(force[key])]
    sys.exit(f"beyond the stated limits, contact force: {', '.join(failed)}" if failed else 0)


def finished(data, case):
    return data["cases"][str(case)]["status"] == "finished"


if __name__ == "__main__":
    main()
