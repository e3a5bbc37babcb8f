"""Two checkouts of the library side by side: time of a step, time of a reduction, and whether results are the same.

Reference: the old checkout, on the same machine in the same minutes. Each runs in a process of its own; the two take
turns. Quantity: CPU time of a step in eight scenes and of the reduction of two bodies, new over old, and the largest
difference of contact force and coordinates, relative to the largest of each. A run is cut into hundredths; each counts
by its quickest repetition, so that what else the machine does is left out. Hundredths that some repetition has not
told of count together with the one before.
Limits: times at most 3 % longer, results to 1e-9.

    python -m validation.benchmarks.versions /path/to/old /path/to/new [--rounds 2] [--turns 5]
"""

import argparse
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
RADIUS, F_CUT = 5e-3, 300e3
IMPLICIT = {"method": "implicit", "step": 0.25e-6}


_now = time.process_time


class Workshop:
    """Models and reduced bodies of a checkout; each call does one thing and tells its CPU time."""

    def __init__(self):
        from netgen.occ import Box, Pnt, Sphere

        import exudyn_partition as ep

        tip = ep.Refine((0, 0, 0), 0.8e-3, 0.35e-3)
        ball = ep.fe_model(Sphere(Pnt(0, 0, RADIUS), RADIUS), ep.STEEL, maxh=2.5e-3, refine=[tip])
        shape = Box(Pnt(-6e-3, -6e-3, -6e-3), Pnt(6e-3, 6e-3, 0))
        block = ep.fe_model(shape, ep.ALUMINIUM, maxh=3.5e-3, refine=[tip])
        low, target = ep.Partition.ball(ball, (0, 0, 0), 0.8e-3), ep.Partition.ball(block, (0, 0, 0), 0.9e-3)
        high = ep.Partition.ball(ball, (0, 0, 2 * RADIUS), 1.5e-3)
        self.parts = {"ball": (ball, low), "block": (block, target)}
        self.bodies = {
            basis: [ep.reduce(*part, basis=basis, f_cut=F_CUT) for part in self.parts.values()]
            for basis in ("contact-adapted", "craig-bampton")
        }
        both = ep.reduce(ball, low | high, f_cut=F_CUT)
        self.bodies["two patches"] = [both, self.bodies["contact-adapted"][1]]
        radii = {"ball": 0.8e-3, "block": 0.9e-3}
        self.bodies["all directions"] = [
            ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), radii[name], axes="xyz"), f_cut=F_CUT)
            for name, (fem, _) in self.parts.items()
        ]
        self.bodies["skin"] = [ep.reduce(ball, ep.Partition.surface(ball, near=(0, 0, 0), axes="xyz"), f_cut=F_CUT)]

    def reduction(self, name):
        """Seconds of a reduction, (1,)."""
        import exudyn_partition as ep

        begin = time.process_time()
        ep.reduce(*self.parts[name], f_cut=F_CUT)
        return {"marks": {0: 0.0, 100: time.process_time() - begin}}, {}

    def run(self, name):
        """Times at which hundredths of a run were told, by their numbers, its steps, and the results."""
        import exudyn_partition as ep

        basis, options, run = SCENES[name]
        make = on_carried if basis == "skin" else scene
        mbs, told = make(self.bodies[basis], **options)
        marks = {}  # of hundredths; on a busy machine progress is told more often
        result = ep.solve_dynamic(mbs, **run, progress=lambda share: marks.setdefault(int(100 * share), _now()))
        marks.pop(max(marks))  # of the end, after the solver's
        return {"marks": marks, "steps": result.steps, "step_s": result.step}, told(result)


def scene(pair, *, frame="inertial", velocity=(0.0, 0.0, -1.0), formulation="compliance", anvil=False, friction=0.0):
    """Model of a ball above a block, at a rigid plane too with `anvil`; and what tells its results."""
    import exudyn as exu

    import exudyn_partition as ep

    mbs = exu.SystemContainer().AddSystem()
    place = [0, 0, 2e-6]
    ball = ep.CreatePartitionBody(mbs, pair[0], frame=frame, referencePosition=place, initialVelocity=[*velocity])
    block = ep.CreatePartitionBody(mbs, pair[1])
    low = 0 if anvil else None
    how = {"formulation": formulation, "passes": "given", "friction": friction}
    contacts = [ep.CreatePartitionContact(mbs, ball, block, slavePatch=low, **how)]
    if anvil:
        lid = ep.RigidPlane(point=(0, 0, 2 * RADIUS + 3e-6), normal=(0, 0, -1))
        contacts.append(ep.CreatePartitionContact(mbs, ball, lid, slavePatch=1))
    mbs.Assemble()

    def told(result):
        forces = np.column_stack([contact.force(result) for contact in contacts])
        return {"force": forces, "ball": ball.coordinates(result), "block": block.coordinates(result)}

    return mbs, told


def on_carried(bodies, velocity=(2.0, 0.0, -1.0)):
    """Model of a ball that rolls off a rigid cylinder, which another body carries; and what tells its results."""
    import exudyn as exu
    from exudyn.utilities import InertiaCuboid

    import exudyn_partition as ep

    mbs = exu.SystemContainer().AddSystem()
    motion = {"frame": "floating", "referencePosition": [0, 0, 2e-6], "initialVelocity": [*velocity]}
    ball = ep.CreatePartitionBody(mbs, bodies[0], **motion)
    carrier = {"referencePosition": [0, 0, -0.01], "initialAngularVelocity": [5.0, 3.0, 0.0]}
    carrier |= {"inertia": InertiaCuboid(7800, [0.02] * 3), "nodeType": exu.NodeType.RotationRotationVector}
    cylinder = ep.RigidCylinder((0, 0, 0), (0, 1, 0), 0.01)
    contact = ep.CreatePartitionContact(mbs, ball, cylinder, masterBody=mbs.CreateRigidBody(**carrier))
    mbs.Assemble()
    return mbs, lambda result: {"force": contact.force(result), "ball": ball.coordinates(result)}


SCENES = {
    "frozen pairs": ("contact-adapted", {}, {"end_time": 100e-6}),
    "moving pairs": ("contact-adapted", {"velocity": (30.0, 0.0, -1.0)}, {"end_time": 20e-6}),
    "floating frame": ("contact-adapted", {"frame": "floating", "velocity": (5.0, 0.0, -1.0)}, {"end_time": 20e-6}),
    "friction": ("all directions", {"friction": 0.3, "velocity": (0.5, 0.0, -1.0)}, {"end_time": 50e-6}),
    "multipliers, explicit": ("craig-bampton", {"formulation": "lagrange"}, {"end_time": 15e-6}),
    "multipliers, implicit": ("craig-bampton", {"formulation": "lagrange"}, {"end_time": 30e-6, **IMPLICIT}),
    "coupled contacts": ("two patches", {"anvil": True}, {"end_time": 100e-6}),
    "carried surface": ("skin", {}, {"end_time": 30e-6, **IMPLICIT}),
}


def serve(folder):
    """Do what the lines of standard input name, one after the other, with the checkout on PYTHONPATH."""
    import exudyn_partition as ep

    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what Exudyn and NGSolve print
    workshop = Workshop()
    answers.write(str(Path(ep.__file__).parents[1]) + "\n")
    for line in sys.stdin:
        name = line.strip()
        data, results = workshop.run(name) if name in SCENES else workshop.reduction(name)
        np.savez(folder / f"{name}.npz", **results)
        answers.write(json.dumps(data) + "\n")


class Checkout:
    """A process that imports the library of a checkout, and does what it is asked for."""

    def __init__(self, path, folder):
        folder.mkdir()
        self.folder = folder
        self.process = subprocess.Popen(
            [sys.executable, __file__, "--serve", str(folder)], cwd=folder, text=True, bufsize=1,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": str(path), "OMP_NUM_THREADS": "1"},
        )  # fmt: skip
        found = self.process.stdout.readline().strip()
        if found != str(path):
            raise SystemExit(f"expected the library in {path}, got that in {found or 'nothing'}")

    def ask(self, name):
        """What a reduction or run tells of its time."""
        self.process.stdin.write(name + "\n")
        return json.loads(self.process.stdout.readline())

    def results(self, name):
        """Results of the last run of this name."""
        return np.load(self.folder / f"{name}.npz")

    def close(self):
        """End the process."""
        self.process.stdin.close()
        self.process.wait()


def difference(old, new):
    """Largest difference of any result of a scene, relative to the largest of it; infinite if they do not match."""
    worst = 0.0
    for key in old.files:
        a, b = old[key], new[key]
        worst = max(worst, np.inf if a.shape != b.shape else abs(a - b).max() / max(abs(a).max(), 1e-300))
    return float(worst)


def commit(checkout):
    """Its commit, with a mark if sources differ from it."""
    command = ["git", "-C", str(checkout), "describe", "--always", "--dirty", "--abbrev=12"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip() or "no commit"


def quickest(runs):
    """Seconds that a whole run takes in each checkout, each part of it by its quickest repetition.

    `runs` are the repetitions of each checkout: times at which hundredths were told, by their numbers. Progress is told
    as time passes, so that runs may leave out different ones. Parts lie between those that all runs have told.
    """
    every = [marks for of_checkout in runs.values() for marks in of_checkout]
    common = sorted(set.intersection(*(set(marks) for marks in every)), key=int)
    if len(common) < 2:
        raise SystemExit(f"expected two hundredths that all repetitions tell, got {common}: make the run longer")
    share = (int(common[-1]) - int(common[0])) / 100
    parts = {which: np.diff([[marks[k] for k in common] for marks in found]) for which, found in runs.items()}
    return {which: float(found.min(axis=0).sum()) / share for which, found in parts.items()}


def compare(paths, rounds, turns):
    """Rows of the table, by name."""
    names = ["ball", "block", *SCENES]
    found, steps = {which: {name: [] for name in names} for which in paths}, {}
    differences = dict.fromkeys(SCENES, 0.0)
    for k in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            checkouts = {which: Checkout(path, Path(folder) / which) for which, path in paths.items()}
            for name in names:
                for turn in range(turns):
                    for which in (("old", "new"), ("new", "old"))[turn % 2]:
                        data = checkouts[which].ask(name)
                        found[which][name].append(data["marks"])
                        steps[name] = data.get("steps", 0)
                if name in SCENES:
                    now = difference(*(checkouts[which].results(name) for which in ("old", "new")))
                    differences[name] = max(differences[name], now)
            for checkout in checkouts.values():
                checkout.close()
        print(f"round {k + 1} of {rounds}", flush=True)
    rows = {}
    for name in names:
        whole = quickest({which: found[which][name] for which in paths})
        old_s, new_s = (whole[which] / max(steps[name], 1) for which in ("old", "new"))
        row = {"old_s": old_s, "new_s": new_s, "ratio": new_s / old_s, "steps": steps[name]}
        if name in SCENES:
            row["difference"] = differences[name]
        rows[name if name in SCENES else f"reduce, {name}"] = row
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path, nargs="?")
    parser.add_argument("new", type=Path, nargs="?")
    parser.add_argument("--rounds", type=int, default=2, help="pairs of processes")
    parser.add_argument("--turns", type=int, default=5, help="repetitions in each process")
    parser.add_argument("--serve", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve(options.serve)
        return
    if options.new is None:
        parser.error("two checkouts are needed")
    from rich.console import Console
    from rich.table import Table

    checkouts = {"old": options.old.resolve(), "new": options.new.resolve()}
    rows = compare(checkouts, options.rounds, options.turns)
    table = Table("what", "steps", "old", "new", "new over old", "difference of results")
    for name, row in rows.items():
        unit, factor = ("us", 1e6) if row["steps"] else ("ms", 1e3)
        said = f"{row['difference']:.1e}" if "difference" in row else ""
        times = (f"{factor * row[key]:.4g} {unit}" for key in ("old_s", "new_s"))
        table.add_row(name, str(row["steps"] or ""), *times, f"{row['ratio']:.3f}", said)
    Console(width=120).print(table)
    failed = [
        f"{name}: {key} {row[key]:.3g}"
        for name, row in rows.items()
        for key, limit in LIMITS.items()
        if row.get(key, 0.0) > limit
    ]
    commits = {which: commit(path) for which, path in checkouts.items()}
    data = {
        "commits": commits,
        "rounds": options.rounds,
        "turns": options.turns,
        "rows": rows,
        "limits": LIMITS,
        "beyond_limits": failed,
    }
    RESULTS.write_text(json.dumps(data, indent=1) + "\n")
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
