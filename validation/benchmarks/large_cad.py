"""Large parts of a CAD program: what a mesh was said to take before it is made, and the time of each stage.

A crank shaft with round fillets, a ribbed housing with bolt holes, and a connecting rod, drawn here. A file of your own
is measured likewise, and not stored:

    python -m validation.benchmarks.large_cad crank.step 9e-3

Reference: the mesh that Netgen then makes.
Quantity: its nodes over those that were told before it is made, processor time of each stage [s], and that of the
reduction over that of mesh and matrices. Each part runs in a process of its own, so that memory is its own too.
Limits: between half and twice the nodes are told; the reduction takes at most twice the time of mesh and matrices.

    python -m validation.benchmarks.large_cad
"""

import contextlib
import json
import logging
import os
import platform
import re
import resource
import subprocess
import sys
import time
from pathlib import Path

import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.meshing import mesh_size

RESULTS = Path(__file__).with_suffix(".json")
F_CUT = 5e3  # [Hz]
LIMITS = {"most_off": 2.0, "over_mesh": 2.0}


def along(axis, place, radius, length):
    return occ.Cylinder(occ.Pnt(*place), axis, radius, length)


def crank():
    """Shaft of three journals and two pins, 0.29 m long, its webs round and its edges too."""
    shaft = along(occ.X, (0, 0, 0), 0.025, 0.29)
    for i, sign in enumerate((1, -1)):
        x = 0.05 + 0.1 * i
        shaft += along(occ.X, (x, 0, sign * 0.035), 0.02, 0.09)
        for web in (x, x + 0.07):
            disc = along(occ.X, (web, 0, sign * 0.015), 0.065, 0.02)
            shaft = shaft + disc.MakeFillet(disc.edges, 7e-3)
    return shaft - along(occ.X, (0, 0, 0), 0.008, 0.29)


def housing():
    """Box of 0.36 x 0.26 x 0.16 m with walls of 10 mm, open above, with ribs, two bores and bolt holes."""
    outer, wall = (0.36, 0.26, 0.16), 0.01
    box = occ.Box((0, 0, 0), outer) - occ.Box((wall, wall, wall), (outer[0] - wall, outer[1] - wall, outer[2]))
    for i in range(1, 4):
        x = i * outer[0] / 4
        box += occ.Box((x - 4e-3, -0.015, 0), (x + 4e-3, 0, outer[2]))
        box += occ.Box((x - 4e-3, outer[1], 0), (x + 4e-3, outer[1] + 0.015, outer[2]))
    rim = occ.Box((-0.025, -0.025, outer[2]), (outer[0] + 0.025, outer[1] + 0.025, outer[2] + 0.012))
    box += rim - occ.Box((wall, wall, outer[2]), (outer[0] - wall, outer[1] - wall, outer[2] + 0.012))
    for x in np.linspace(-0.012, outer[0] + 0.012, 4):
        for y in (-0.012, outer[1] + 0.012):
            box -= along(occ.Z, (float(x), y, outer[2]), 0.007, 0.012)
    for y in (0.08, 0.18):
        box -= along(occ.X, (-1e-3, y, 0.08), 0.03, outer[0] + 2e-3)
    return box


def rod():
    """Connecting rod, 0.2 m between its bores, with a shank of I section."""
    big, small = along(occ.Z, (0, 0, -0.015), 0.045, 0.03), along(occ.Z, (0.2, 0, -0.0125), 0.025, 0.025)
    shank = occ.Box((0, -0.016, -0.01), (0.2, 0.016, 0.01))
    for z in (-0.01, 0.004):
        shank -= occ.Box((0.06, -0.01, z), (0.165, 0.01, z + 0.006))
    body = big + small + shank
    body = body - along(occ.Z, (0, 0, -0.02), 0.03, 0.04) - along(occ.Z, (0.2, 0, -0.02), 0.014, 0.04)
    return body - along(occ.X, (-0.05, 0.037, 0), 0.004, 0.1) - along(occ.X, (-0.05, -0.037, 0), 0.004, 0.1)


CASES = {"crank shaft": (crank, 10e-3), "housing": (housing, 9e-3), "connecting rod": (rod, 4e-3)}


def nodes_told(lines):
    """Nodes that a line told before the mesh was made."""
    return int(re.search(r"elements with ([\d,]+) nodes are to come", lines)[1].replace(",", ""))


@contextlib.contextmanager
def clock(times, name):
    begin = time.process_time()
    yield
    times[name] = time.process_time() - begin


def measure(shape, maxh):
    """Nodes, what was told of them, and times of one part."""
    told, times = [], {}
    mesh_size.LARGE = 1.0  # nodes: small meshes tell it too
    handler = logging.Handler()
    handler.emit = lambda record: told.append(record.getMessage())
    log = logging.getLogger("exudyn_partition")
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    with clock(times, "mesh"):
        fem = ep.fe_model(shape, ep.STEEL, maxh=maxh)
    log.removeHandler(handler)
    top = fem.points[fem.points[:, 2].argmax()]
    with clock(times, "partition"):
        part = ep.Partition.ball(fem, center=top, radius=2 * maxh)
    with clock(times, "reduction"):
        body = ep.reduce(fem, part, f_cut=F_CUT)
    return {
        "nodes": fem.n_nodes,
        "told": nodes_told("\n".join(told)),
        "said": next((line for line in told if "are to come" in line), ""),
        "dofs": body.n_dofs,
        "processor_s": times,
        "peak_GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
    }


def show(results):
    table = Table("", "nodes", "told before", "mesh and matrices", "patch", "reduction", "coordinates", "peak memory")
    for name, case in results.items():
        times = (f"{case['processor_s'][key]:.1f} s" for key in ("mesh", "partition", "reduction"))
        table.add_row(
            name, str(case["nodes"]), str(case["told"]), *times, str(case["dofs"]), f"{case['peak_GB']:.1f} GB"
        )
    Console(width=120).print(table)


def main():
    results = {}
    for name in CASES:
        run = subprocess.run([sys.executable, "-m", __spec__.name, "--part", name], capture_output=True, check=True)
        results[name] = json.loads(run.stdout.splitlines()[-1])
    show(results)
    ratios = [case["nodes"] / case["told"] for case in results.values()]
    times = [case["processor_s"] for case in results.values()]
    found = {
        "most_off": max(max(ratio, 1 / ratio) for ratio in ratios),
        "over_mesh": max(one["reduction"] / one["mesh"] for one in times),
    }
    machine = {"cpus": os.cpu_count(), "platform": platform.platform()}
    result = {"parts": results, "found": found, "limits": LIMITS, "machine": machine, "versions": ep.versions()}
    RESULTS.write_text(json.dumps(result, indent=1) + "\n")
    failed = [f"{key} {value:.3g}, limit {LIMITS[key]:.3g}" for key, value in found.items() if value > LIMITS[key]]
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--part"]:
        make, largest = CASES[sys.argv[2]]
        print(json.dumps(measure(make(), largest)))
    elif len(sys.argv) == 3:
        (part,) = ep.read_step(sys.argv[1], scale=1e-3).solids.values()
        print(json.dumps(measure(part, float(sys.argv[2])), indent=1))
    else:
        main()
