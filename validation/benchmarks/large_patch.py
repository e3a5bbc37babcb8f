"""What a large contact patch costs: off-line time, memory and size of the file, by its number of nodes.

The cam of the example is reduced on one mesh, with a small patch by `Partition.ball`, and with the whole rim or a part
of it by `Partition.surface`. Each reduction runs in a process of its own, so that its peak of memory is its own.

    python -m validation.benchmarks.large_patch
"""

import argparse
import json
import multiprocessing
import resource
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console

import exudyn_partition as ep
from examples.models import cam_follower_parts as shapes
from validation.contact import scenes
from validation.tables import write_between

LIMITS = {"memory_GB": 4.0, "file_MB": 200.0, "ratio": 3.0}  # of the largest patch; ratio to the small one
RIM = 0.675e-3  # elements on the rim [m]
PAGE = Path(__file__).parents[2] / "examples" / "site" / "wandering-contact.md"


def partitions(fem):
    """Partitions of the cam by name: a small ball, parts of the rim, all of it."""
    rim = np.asarray(fem.boundaries["rim"])
    heights = fem.points[fem.facets[rim, :3]].mean(axis=1)[:, 1]
    bore = ep.Partition.interface(fem, "bore", "bore")
    top = (shapes.ECCENTRICITY, shapes.RADIUS, 0)
    return {
        "ball of 2 mm": ep.Partition.ball(fem, top, 2e-3) | bore,
        "an eighth of the rim": ep.Partition.surface(fem, rim[heights > 0.92 * shapes.RADIUS]) | bore,
        "half of the rim": ep.Partition.surface(fem, rim[heights > 0]) | bore,
        "the whole rim": ep.Partition.surface(fem, rim) | bore,
    }


def measure(size, name, queue):
    """Reduce the cam with one patch, save it, and tell what that took."""
    fem, _ = shapes.cam_part(size, 4e-3)
    partition = partitions(fem)[name]
    before, begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
    cpu = time.process_time()
    body = ep.reduce(fem, partition, f_cut=shapes.F_CUT)
    seconds, cpu = time.perf_counter() - begin, time.process_time() - cpu
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cam.npz"
        body.save(path)
        size = path.stat().st_size
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    queue.put({"name": name, "fe_dofs": fem.n_dofs, "nodes": len(partition.patch_nodes), "dofs": body.n_dofs,
               "time_s": seconds, "cpu_s": cpu, "memory_GB": peak / 1e6, "before_GB": before / 1e6,
               "file_MB": size / 1e6})  # fmt: skip


def rows_of(size):
    """Measurements of all patches, each in a new process."""
    context, found = multiprocessing.get_context("spawn"), []
    for name in ("ball of 2 mm", "an eighth of the rim", "half of the rim", "the whole rim"):
        queue = context.Queue()
        process = context.Process(target=measure, args=(size, name, queue))
        process.start()
        found.append(queue.get())
        process.join()
        Console().print(found[-1])
    return found


def write_table(rows):
    """Write the table on the site's page of contact."""
    lines = [
        f"A cam of {rows[0]['fe_dofs']} FE dofs:",
        "",
        "| patch | nodes | off-line, time of the processor | peak of memory | file |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row['name']} | {row['nodes']} | {row['cpu_s']:.2g} s | {row['memory_GB']:.2g} GB | "
            f"{row['file_MB']:.3g} MB |"
        )
    write_between(PAGE, "benchmarks/large_patch.py", "\n".join(lines) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a coarse mesh; nothing is stored")
    parser.add_argument("--table", action="store_true", help="write the table from the stored results alone")
    options = parser.parse_args()
    if options.table:
        write_table(json.loads(Path(__file__).with_suffix(".json").read_text())["patches"])
        return
    begin = time.perf_counter()
    rows = rows_of(4e-3 if options.quick else RIM)
    small, large = rows[0], rows[-1]
    found = {"memory_GB": large["memory_GB"], "file_MB": large["file_MB"], "ratio": large["cpu_s"] / small["cpu_s"]}
    per_node = {
        "time_ms": 1e3 * (large["time_s"] - small["time_s"]) / (large["nodes"] - small["nodes"]),
        "memory_kB": 1e6 * (large["memory_GB"] - small["memory_GB"]) / large["nodes"],
    }
    Console().print(found, per_node)
    if options.quick:
        return
    write_table(rows)
    result = {"patches": rows, "found": found, "limits": LIMITS, "per_node": per_node,
              "time_s": time.perf_counter() - begin}  # fmt: skip
    scenes.finish(__file__, result, [f"{key} {found[key]:.3g}" for key in LIMITS if found[key] > LIMITS[key]])


if __name__ == "__main__":
    main()
