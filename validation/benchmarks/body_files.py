"""Size of body files, and the time to write and to read them: whole files, and files without the inside.

Reference: the arrays of a body as they are in memory, byte for byte.
Quantity: sizes, their shares of the bytes of the arrays, and the shortest of three times. The bodies are the ball of
README's complete program, and rod and plate of examples/rod_on_plate.py in their quick meshes. The plate is also
reduced with the bases that keep more.
Limits: a whole file takes at most 95 % of the arrays' bytes. Without the inside, the file of the ball takes at most
35 %, and all others 75 %. What is read equals what was written, to the last bit.

    python -m validation.benchmarks.body_files
"""

import json
import os
import platform
import sys
import tempfile
import time
from pathlib import Path

import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from examples.models import rod_on_plate as example
from exudyn_partition.support.archive import digest

RESULTS = Path(__file__).with_suffix(".json")
RADIUS = 0.010  # of the ball [m]
RUNS = 3
LIMITS = {"whole": 0.95, "ball_without_inside": 0.35, "without_inside": 0.75}


def bodies():
    """Bodies by name."""
    ball = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)
    fem = ep.fe_model(ball, ep.STEEL, maxh=3e-3, refine=[ep.Refine((0, 0, 0), radius=0.3e-3, h=0.1e-3)])
    yield "ball", ep.reduce(fem, ep.Partition.ball(fem, center=(0, 0, 0), radius=0.5e-3), f_cut=200e3)
    fems, partitions, _ = example.fe_models(quick=True)
    for name, fem, partition in zip(("rod", "plate"), fems, partitions, strict=True):
        yield name, ep.reduce(fem, partition, f_cut=40e3)
    for basis in ("craig-bampton", "free"):
        yield f"plate, {basis}", ep.reduce(fems[1], partitions[1], basis=basis, f_cut=20e3)


def array_bytes(value):
    """Bytes of all arrays of a body."""
    if isinstance(value, np.ndarray):
        return value.nbytes
    if hasattr(value, "indptr"):
        return value.data.nbytes + value.indices.nbytes + value.indptr.nbytes
    if isinstance(value, tuple):
        return sum(map(array_bytes, value))
    return sum(map(array_bytes, vars(value).values())) if hasattr(value, "__dataclass_fields__") else 0


def shortest(function, *arguments, **options):
    """Shortest time of some calls [s], and the result of the last call."""
    times = []
    for _ in range(RUNS):
        begin = time.perf_counter()
        found = function(*arguments, **options)
        times.append(time.perf_counter() - begin)
    return min(times), found


def measure(body, path):
    """Sizes, shares and times of one body's files."""
    result = {"basis": body.basis.name, "dofs": body.n_dofs, "fe_dofs": body.fe_dofs, "MB": array_bytes(body) / 1e6}
    for name, inside in (("whole", True), ("without_inside", False)):
        save_s, _ = shortest(body.save, path, inside=inside)
        load_s, again = shortest(ep.load_body, path)
        size = path.stat().st_size / 1e6
        same = digest(again) == digest(body if inside else body.without_inside())
        result[name] = {"MB": size, "share": size / result["MB"], "save_s": save_s, "load_s": load_s, "same": same}
    return result


def show(results):
    table = Table("", "coordinates", "FE dofs", "arrays", "whole", "save", "load", "no inside", "save", "load")
    for name, case in results.items():
        files = (
            text
            for kind in ("whole", "without_inside")
            for text in (f"{case[kind]['MB']:.2f}", f"{case[kind]['save_s']:.2g} s", f"{case[kind]['load_s']:.2g} s")
        )
        table.add_row(name, str(case["dofs"]), str(case["fe_dofs"]), f"{case['MB']:.2f} MB", *files)
    Console(width=120).print(table)


def main():
    with tempfile.TemporaryDirectory() as folder:
        results = {name: measure(body, Path(folder) / "body.npz") for name, body in bodies()}
    show(results)
    others = [case for name, case in results.items() if name != "ball"]
    found = {
        "whole": max(case["whole"]["share"] for case in results.values()),
        "ball_without_inside": results["ball"]["without_inside"]["share"],
        "without_inside": max(case["without_inside"]["share"] for case in others),
    }
    failed = [f"{key} {value:.3g}, limit {LIMITS[key]:.3g}" for key, value in found.items() if value > LIMITS[key]]
    failed += [
        f"{name}, {kind}: not the same when it is read"
        for name, case in results.items()
        for kind in ("whole", "without_inside")
        if not case[kind]["same"]
    ]
    result = {
        "bodies": results,
        "found": found,
        "limits": LIMITS,
        "machine": {"cpus": os.cpu_count(), "platform": platform.platform()},
        "versions": ep.versions(),
    }
    RESULTS.write_text(json.dumps(result, indent=1) + "\n")
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
