"""What `ep.study` costs a run beside its function.

Cost: functions that sleep 1, 10 and 100 ms, in a loop, in two processes and by two workers of Dask, with the chunks
that a study chooses and with one run a task; each with a file. Workers have started before. A run costs the wall time
of the study times the number of workers, less the time within its function, over the number of runs. Sleep takes no
processor, so that other work on the machine disturbs little.
Reference: none.
Limits: with chunks that the study chooses, a run of 1 ms costs 0.2 ms in a loop and 0.5 ms by two workers.

    python -m validation.benchmarks.study
"""

import functools
import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from distributed import Client, LocalCluster
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes
from validation.tables import write_between

RUNS = {1e-3: 2000, 10e-3: 400, 100e-3: 60}  # of functions that last so long [s]
HERE = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "threads_per_worker": 1}
LIMITS = {"loop": 0.2e-3, "workers": 0.5e-3}
PAGE = Path(__file__).resolve().parents[2] / "examples" / "site" / "many-runs.md"


def sleep(x, duration):
    time.sleep(duration)
    return x


def cost(duration, count, workers, n, chunk):
    """Time that a run costs a worker beside its function [s]."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        found = ep.study(
            functools.partial(sleep, duration=duration),
            {"x": list(range(count))},
            file=Path(folder) / "study.jsonl",
            workers=workers,
            chunk=chunk,
        )
        return float((n * (time.perf_counter() - begin) - found.info["wall_s"].sum()) / count)


def costs(client):
    """Cost of a run by duration of its function and by the way [s]."""
    found = {}
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        ways = {
            "loop": (1, 1, None),
            "two processes": (pool, 2, None),
            "two processes, one run a task": (pool, 2, 1),
            "Dask, two workers": (client, 2, None),
            "Dask, one run a task": (client, 2, 1),
        }
        for workers, n, _ in ways.values():
            cost(1e-3, 20, workers, n, 1)  # the first tasks import the library
        for duration, count in RUNS.items():
            found[f"{1e3 * duration:g} ms"] = {
                name: cost(duration, count, workers, n, chunk) for name, (workers, n, chunk) in ways.items()
            }
    return found


def table(found):
    """Costs for the page."""
    ways = [*next(iter(found.values()))]
    lines = ["| function lasts | " + " | ".join(ways) + " |", "| --- " * (len(ways) + 1) + "|"]
    for duration, of in found.items():
        lines.append(f"| {duration} | " + " | ".join(f"{1e3 * of[way]:.2g} ms" for way in ways) + " |")
    return "\n".join(lines) + "\n"


def main():
    with LocalCluster(n_workers=2, **HERE) as cluster, Client(cluster) as client:
        found = costs(client)
    chosen = found["1 ms"]
    result = {
        "found": {"loop": chosen["loop"], "workers": max(chosen["two processes"], chosen["Dask, two workers"])},
        "costs_s": found,
        "load": os.getloadavg(),
        "limits": LIMITS,
    }
    Console().print(result)
    failed = [f"{name} {result['found'][name]:.3g} s" for name in LIMITS if result["found"][name] > LIMITS[name]]
    write_between(PAGE, "benchmarks/study.py", table(found))
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
