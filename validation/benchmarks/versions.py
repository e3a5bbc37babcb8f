"""Two checkouts of the library side by side: time of a step, time of a reduction, and whether results are the same.

Reference: the old checkout, on the same machine in the same minutes. Both run in processes of their own, in turns.
Quantity: CPU time of a step in six scenes and of the reduction of two bodies, new over old, and the largest difference
of contact force and coordinates, relative to the largest of each. A run is cut into hundredths; each counts by its
quickest repetition, so that what else the machine does is left out.
Limits: times at most 3 % longer, results to 1e-9.

    python validation/benchmarks/versions.py /path/to/old /path/to/new [--rounds 6]
"""

import argparse
import contextlib
import io
import json
import os
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

RESULTS = Path(__file__).with_suffix(".json")
LIMITS = {"ratio": 1.03, "difference": 1e-9}
RADIUS = 5e-3
REPETITIONS = 5  # of a run in a process
IMPLICIT = {"method": "implicit", "step": 0.25e-6}


def bodies():
    """Reduced bodies by basis, each a ball and a block, one more ball with two patches, and the time of reductions."""
    from netgen.occ import Box, Pnt, Sphere

    import exudyn_partition as ep

    def reduced(fem, part, **options):
        begin = time.process_time()
        body = ep.reduce(fem, part, cache=False, **options)
        return body, time.process_time() - begin

    tip = ep.Refine((0, 0, 0), 1e-3, 0.25e-3)
    ball = ep.fe_model(Sphere(Pnt(0, 0, RADIUS), RADIUS), ep.STEEL, maxh=1.5e-3, refine=[tip])
    shape = Box(Pnt(-6e-3, -6e-3, -6e-3), Pnt(6e-3, 6e-3, 0))
    block = ep.fe_model(shape, ep.ALUMINIUM, maxh=3e-3, refine=[ep.Refine((0, 0, 0), 1e-3, 0.3e-3)])
    low, target = ep.Partition.ball(ball, (0, 0, 0), 0.8e-3), ep.Partition.ball(block, (0, 0, 0), 0.9e-3)
    high = ep.Partition.ball(ball, (0, 0, 2 * RADIUS), 0.8e-3)
    found, times = {}, {}
    for basis in ("contact-adapted", "craig-bampton"):
        pair = [reduced(ball, low, basis=basis, f_cut=400e3), reduced(block, target, basis=basis, f_cut=200e3)]
        found[basis] = [body for body, _ in pair]
        if basis == "contact-adapted":
            times = {f"reduce, {name}": [used] for name, (_, used) in zip(("ball", "block"), pair, strict=True)}
    found["two patches"] = [reduced(ball, low | high, f_cut=400e3)[0], found["contact-adapted"][1]]
    return found, times


def scene(pair, *, frame="inertial", velocity=(0.0, 0.0, -1.0), formulation="compliance", anvil=False):
    """Model of a ball above a block, at a rigid plane too with `anvil`; and what tells its results."""
    import exudyn as exu

    import exudyn_partition as ep

    mbs = exu.SystemContainer().AddSystem()
    place = [0, 0, 2e-6]
    ball = ep.CreatePartitionBody(mbs, pair[0], frame=frame, referencePosition=place, initialVelocity=[*velocity])
    block = ep.CreatePartitionBody(mbs, pair[1])
    low = 0 if anvil else None
    contacts = [ep.CreatePartitionContact(mbs, ball, block, formulation=formulation, slavePatch=low, passes="given")]
    if anvil:
        lid = ep.RigidPlane(point=(0, 0, 2 * RADIUS + 3e-6), normal=(0, 0, -1))
        contacts.append(ep.CreatePartitionContact(mbs, ball, lid, slavePatch=1))
    mbs.Assemble()

    def told(result):
        forces = np.column_stack([contact.force(result) for contact in contacts])
        return {"force": forces, "ball": ball.coordinates(result), "block": block.coordinates(result)}

    return mbs, told


SCENES = {
    "frozen pairs": ("contact-adapted", {}, {"end_time": 120e-6}),
    "moving pairs": ("contact-adapted", {"velocity": (30.0, 0.0, -1.0)}, {"end_time": 40e-6}),
    "floating frame": ("contact-adapted", {"frame": "floating", "velocity": (5.0, 0.0, -1.0)}, {"end_time": 40e-6}),
    "multipliers, explicit": ("craig-bampton", {"formulation": "lagrange"}, {"end_time": 30e-6}),
    "multipliers, implicit": ("craig-bampton", {"formulation": "lagrange"}, {"end_time": 60e-6, **IMPLICIT}),
    "coupled contacts": ("two patches", {"anvil": True}, {"end_time": 120e-6}),
}


def measured(pair, options, run):
    """CPU time of each hundredth of a run, (repetitions, n) [s], steps, and results."""
    import exudyn_partition as ep

    parts = []
    for _ in range(REPETITIONS):
        mbs, told = scene(pair, **options)
        marks = []
        result = ep.solve_dynamic(mbs, **run, progress=lambda share, marks=marks: marks.append(time.process_time()))
        parts.append(np.diff(marks[:-1]))  # the last is of the end, after the solver's
    return {"parts": np.array(parts).tolist(), "steps": result.steps, "step_s": result.step}, told(result)


def child(folder):
    """Measure the checkout on PYTHONPATH; times to a JSON file, results to an archive."""
    import exudyn_partition as ep

    warnings.simplefilter("ignore")
    with contextlib.redirect_stdout(io.StringIO()):
        found, times = bodies()
        again, more = bodies()
        del again
        reductions = {name: times[name] + more[name] for name in times}
        runs, arrays = {}, {}
        for name, (basis, options, run) in SCENES.items():
            runs[name], results = measured(found[basis], options, run)
            arrays |= {f"{name}/{key}": value for key, value in results.items()}
    np.savez(folder / "results.npz", **arrays)
    data = {"package": str(Path(ep.__file__).parents[1]), "reductions": reductions, "runs": runs}
    (folder / "times.json").write_text(json.dumps(data))


def measure(checkout, folder):
    """Run this script in a process that imports the library of a checkout."""
    environment = os.environ | {"PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
    subprocess.run(
        [sys.executable, __file__, "--child", str(folder)], env=environment, cwd=folder, check=True,
        stdout=subprocess.DEVNULL,
    )  # fmt: skip
    data = json.loads((folder / "times.json").read_text())
    if Path(data["package"]) != checkout:
        raise SystemExit(f"expected the library in {checkout}, got that in {data['package']}")
    return data


def quickest(rounds):
    """Seconds of a reduction or a step, by name, each hundredth of a run by its quickest repetition."""
    found = {name: min(min(r["reductions"][name]) for r in rounds) for name in rounds[0]["reductions"]}
    for name, run in rounds[0]["runs"].items():
        parts = np.concatenate([r["runs"][name]["parts"] for r in rounds])
        found[name] = float(parts.min(axis=0).sum()) / run["steps"]
    return found


def differences(old, new):
    """Largest difference of any result of a scene, relative to the largest of it; infinite if they do not match."""
    found = {}
    for key in old.files:
        a, b = old[key], new[key]
        share = np.inf if a.shape != b.shape else float(abs(a - b).max() / max(abs(a).max(), 1e-300))
        name = key.partition("/")[0]
        found[name] = max(found.get(name, 0.0), share)
    return found


def commit(checkout):
    """Its commit, with a mark if sources differ from it."""
    command = ["git", "-C", str(checkout), "describe", "--always", "--dirty", "--abbrev=12"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip() or "no commit"


def compare(checkouts, rounds):
    """Rows of the table, by name."""
    measurements = {which: [] for which in checkouts}
    with tempfile.TemporaryDirectory() as folder:
        folders = {which: Path(folder) / which for which in checkouts}
        for place in folders.values():
            place.mkdir()
        for k in range(rounds):
            for which in (("old", "new"), ("new", "old"))[k % 2]:
                measurements[which].append(measure(checkouts[which], folders[which]))
            print(f"round {k + 1} of {rounds}", flush=True)
        archives = [np.load(folders[which] / "results.npz") for which in ("old", "new")]
        difference = differences(*archives)
    times = {which: quickest(found) for which, found in measurements.items()}
    rows = {}
    for name, old_s in times["old"].items():
        run = measurements["old"][0]["runs"].get(name, {})
        rows[name] = {
            "old_s": old_s,
            "new_s": times["new"][name],
            "ratio": times["new"][name] / old_s,
            "difference": difference.get(name),
            "steps": run.get("steps"),
        }
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path, nargs="?")
    parser.add_argument("new", type=Path, nargs="?")
    parser.add_argument("--rounds", type=int, default=6, help="processes of each checkout")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        child(options.child)
        return
    if options.new is None:
        parser.error("two checkouts are needed")
    from rich.console import Console
    from rich.table import Table

    checkouts = {"old": options.old.resolve(), "new": options.new.resolve()}
    rows = compare(checkouts, options.rounds)
    table = Table("what", "steps", "old", "new", "new over old", "difference of results")
    for name, row in rows.items():
        unit, factor = ("us", 1e6) if row["steps"] else ("ms", 1e3)
        said = "" if row["difference"] is None else f"{row['difference']:.1e}"
        times = (f"{factor * row[key]:.4g} {unit}" for key in ("old_s", "new_s"))
        table.add_row(name, str(row["steps"] or ""), *times, f"{row['ratio']:.3f}", said)
    Console(width=120).print(table)
    failed = [f"{name}: {key} {row[key]:.3g}" for name, row in rows.items() for key in LIMITS if (row[key] or 0) > LIMITS[key]]
    commits = {which: commit(path) for which, path in checkouts.items()}
    data = {"commits": commits, "rounds": options.rounds, "rows": rows, "limits": LIMITS, "beyond_limits": failed}
    RESULTS.write_text(json.dumps(data, indent=1) + "\n")
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
