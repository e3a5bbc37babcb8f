"""Time of one evaluation of a contact: about 100 slave nodes against 250 facets, frozen and moving pairs.

Reference: the same in NumPy, in a process of its own where numba does not compile. The limits are 0.7 of its time with
frozen pairs and 0.45 with moving ones, for the default rows, which are integrated.
Quantity: median time of `law.at(q).generalised` in 2000 calls, with the contact closed as deep as in an impact. In the
case "frozen" the coordinates change but do not slide. In the case "moving" they slide by 0.1 % of a facet in a call,
over edges of facets. The table also has node-to-segment rows, the numbers of closed rows, sliding at four and a half
times the depth, which closes 60 integrated rows, at six times, which closes most, and the same with the patches apart.

    python -m validation.benchmarks.contact_evaluation
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path

import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.algebra.blas_threads import one_blas_thread
from exudyn_partition.contact.formulations.choices import Compliance
from exudyn_partition.contact.patch_contact import PatchContact
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.side import Side
from exudyn_partition.frames.inertial import InertialKinematics
from exudyn_partition.support.compiled import compiles
from exudyn_partition.surfaces.points import ROWS

RESULTS = Path(__file__).with_suffix(".json")
CALLS = 2000
DEPTH = 8e-6  # of a steel ball of 10 mm radius, a few hundred newtons [m]
LIMITS = {"frozen": 0.7, "moving": 0.45}  # of NumPy's time


def ball_on_plate():
    """A ball and a plate, reduced, whose patches have about 100 nodes and 250 facets."""
    ball = ep.fe_model(
        occ.Sphere(occ.Pnt(0, 0, 0.010), 0.010),
        ep.STEEL,
        maxh=3e-3,
        refine=[ep.Refine((0, 0, 0), 0.6e-3, 0.22e-3)],
        grading=0.5,
    )
    plate = ep.fe_model(
        occ.Box(occ.Pnt(-0.01, -0.01, -0.005), occ.Pnt(0.01, 0.01, 0)),
        ep.STEEL,
        maxh=4e-3,
        refine=[ep.Refine((0, 0, 0), 1.5e-3, 0.25e-3)],
        grading=0.5,
    )
    parts = ep.Partition.ball(ball, (0, 0, 0), 0.75e-3), ep.Partition.ball(plate, (0, 0, 0), 2.3e-3)
    return [ep.reduce(fem, part, f_cut=150e3) for fem, part in zip((ball, plate), parts, strict=True)]


def median_us(law, coordinates):
    """Median time of `law.at(q).generalised` [us]."""
    times = []
    for q in coordinates:
        begin = time.perf_counter()
        _ = law.at(q).generalised
        times.append(time.perf_counter() - begin)
    return 1e6 * float(np.median(times))


def motions(bodies, gaps):
    """CALLS coordinates of each motion: small changes without sliding, sliding, and both with the ball lifted."""
    n = sum(body.n_dofs for body in bodies)
    rigid = np.zeros((n, 3))
    rigid[: bodies[0].n_dofs] = bodies[0].rigid[:, :3]
    down = rigid @ [0, 0, -DEPTH]
    trembling = 0.05 * DEPTH * np.sin(np.arange(CALLS))[:, None] * rigid[:, 2]
    way = 1e-3 * gaps.size * np.arange(CALLS)[:, None]
    sliding = 0.3e-3 * np.sin(way / 0.3e-3) * rigid[:, 0]
    return {
        "frozen": down + trembling,
        "moving": down + sliding,
        "sixty": 4.5 * down + sliding,
        "deep": 6 * down + sliding,
        "apart": -25 * down + sliding,
    }


@one_blas_thread()
def measure(bodies, kind):
    entry = {}
    for name in ("frozen", "moving", "sixty", "deep", "apart"):
        gaps = PatchGaps(*[Side.of(InertialKinematics(b, np.zeros(3))) for b in bodies], kind)
        law = PatchContact(gaps, Compliance())
        entry["rows"] = len(law.gaps.row_nodes)
        entry[f"{name}_us"] = median_us(law, motions(bodies, law.gaps)[name])
        if name in ("moving", "sixty", "deep"):
            entry[f"{name}_closed_rows"] = len(law.evaluation.index)
    return entry


def in_numpy():
    """The results of this script in a process where nothing is compiled."""
    command = [sys.executable, "-m", "validation.benchmarks.contact_evaluation", "--results"]
    run = subprocess.run(command, env=os.environ | {"NUMBA_DISABLE_JIT": "1"}, capture_output=True, check=True)
    return json.loads(run.stdout.splitlines()[-1])


def shares(results):
    """Times of compiled loops over those of NumPy."""
    return {key: results["compiled"][ROWS[0]][f"{key}_us"] / results["numpy"][ROWS[0]][f"{key}_us"] for key in LIMITS}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", action="store_true", help="print the results of this process alone, as JSON")
    options = parser.parse_args()
    bodies = ball_on_plate()
    found = {kind: measure(bodies, kind) for kind in ROWS}
    if options.results:
        print(json.dumps(found))
        return
    if not compiles():
        sys.exit("numba is missing: pip install exudyn-partition[fast]")
    patches = [body.partition.patches[0] for body in bodies]
    results = {"compiled": found, "numpy": in_numpy()}
    title = f"{len(patches[0].nodes)} slave nodes, {len(patches[1].facets)} facets"
    table = Table("loops", "rows", *found[ROWS[0]], title=title)
    for path, of_path in results.items():
        for kind, entry in of_path.items():
            table.add_row(path, kind, *(f"{value:.4g}" for value in entry.values()))
    Console(width=180).print(table)
    data = {
        "slave_nodes": len(patches[0].nodes),
        "facets": len(patches[1].facets),
        "dofs": [body.n_dofs for body in bodies],
        "results": results,
        "found": shares(results),
        "limits": LIMITS,
        "machine": {
            "cpus": os.cpu_count(),
            "platform": platform.platform(),
            "versions": ep.versions() | {"numba": metadata.version("numba")},
        },
    }
    RESULTS.write_text(json.dumps(data, indent=1) + "\n")
    failed = [f"{key} {found:.2f}" for key, found in data["found"].items() if found > LIMITS[key]]
    sys.exit(f"beyond the stated limits: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
