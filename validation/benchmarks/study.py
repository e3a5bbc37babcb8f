"""What `ep.study` costs a run beside its function, and what a second worker of Dask is worth.

Cost: functions that sleep 1, 10 and 100 ms, in a loop, in two processes and by two workers of Dask, with the chunks
that a study chooses and with one run a task; each with a file. Workers have started before. A run costs the wall time
of the study times the number of workers, less the time within its function, over the number of runs. Sleep takes no
processor, so that other work on the machine disturbs little.
Two workers: 500 impacts of an aluminium block that yields on a rigid ball, by clusters of one worker and of two, in
turns. The ratio of wall times is that of a machine with other work, where two processes may get no more than one. So it
is also told what a cluster is worth on cores of its own: how many workers there are, times the share of their time
within runs, over the processor time of a run; of two workers over one.
Reference: none for the cost; one worker for two.
Limits: with chunks that the study chooses, a run of 1 ms costs 0.2 ms in a loop and 0.5 ms by two workers; on cores of
their own two workers are worth 1.7 of one.

    python -m validation.benchmarks.study
"""

import functools
import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import netgen.occ as occ
import numpy as np
from distributed import Client, LocalCluster
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes
from validation.tables import write_between

RUNS = {1e-3: 2000, 10e-3: 400, 100e-3: 60}  # of functions that last so long [s]
IMPACTS, TURNS = 500, 2
HERE = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "threads_per_worker": 1}
LIMITS = {"loop": 0.2e-3, "workers": 0.5e-3, "second_worker": 1.7}
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


def block():
    """A block of aluminium that yields beneath its lower face."""
    soft = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=100e6, hardening=500e6)
    shape, fine = occ.Box(occ.Pnt(-5e-3, -5e-3, 0), occ.Pnt(5e-3, 5e-3, 8e-3)), ep.Refine((0, 0, 0), 0.5e-3, 0.25e-3)
    fem = ep.fe_model(shape, soft, maxh=4e-3, refine=[fine], grading=0.6)
    part = ep.Partition.ball(fem, (0, 0, 0), 0.6e-3, direction=(0, 0, -1), plastic_radius=0.9e-3)
    return ep.reduce(fem, part, f_cut=100e3)


def impact(body, speed):
    """Restitution of an impact on a rigid ball, and the processor time that it took [s]."""
    begin = time.thread_time()
    found = ep.restitution_map((body, ep.RigidSphere((0, 0, -5e-3), 5e-3)), speed=speed)
    return {"restitution": found["restitution"].item(), "processor_s": time.thread_time() - begin}


def measured(function, speeds, client, n):
    """Wall time of a map by a cluster of n workers [s], processor time of an impact [s], and share of time in runs."""
    begin = time.perf_counter()
    found = ep.study(function, {"speed": speeds}, workers=client, stop=True)
    wall = time.perf_counter() - begin
    busy = float(found.info["wall_s"].sum()) / (n * wall)
    told = {"wall_s": wall, "processor_s": float(np.mean(found["processor_s"])), "busy": busy}
    return told | {"worth": n * busy / told["processor_s"]}, found["restitution"]


def table(found):
    """Costs for the page."""
    ways = [*next(iter(found.values()))]
    lines = ["| function lasts | " + " | ".join(ways) + " |", "| --- " * (len(ways) + 1) + "|"]
    for duration, of in found.items():
        lines.append(f"| {duration} | " + " | ".join(f"{1e3 * of[way]:.2g} ms" for way in ways) + " |")
    return "\n".join(lines) + "\n"


def main():
    console, body = Console(), block()
    function, speeds = functools.partial(impact, body), np.linspace(0.1, 0.5, IMPACTS // TURNS).tolist()
    with LocalCluster(n_workers=1, **HERE) as small, LocalCluster(n_workers=2, **HERE) as large:
        with Client(small) as one, Client(large) as two:
            for client in (one, two):
                ep.study(function, {"speed": speeds[:8]}, workers=client, chunk=1)  # each worker loads and compiles
            rows = []
            for _ in range(TURNS):
                (alone, first), (both, second) = (measured(function, speeds, c, n) for c, n in ((one, 1), (two, 2)))
                rows.append({"one": alone, "two": both, "worth": both["worth"] / alone["worth"],
                             "wall": alone["wall_s"] / both["wall_s"]})  # fmt: skip
                assert np.array_equal(first, second)
                console.print(rows[-1])
            found = costs(two)
    chosen = found["1 ms"]
    result = {
        "found": {
            "loop": chosen["loop"],
            "workers": max(chosen["two processes"], chosen["Dask, two workers"]),
            "second_worker": float(np.mean([row["worth"] for row in rows])),
        },
        "costs_s": found,
        "impacts": IMPACTS,
        "turns": rows,
        "wall": float(np.mean([row["wall"] for row in rows])),
        "load": os.getloadavg(),
        "limits": LIMITS,
    }
    console.print(result)
    failed = [f"{name} {result['found'][name]:.3g} s" for name in ("loop", "workers")
              if result["found"][name] > LIMITS[name]]  # fmt: skip
    if result["found"]["second_worker"] < LIMITS["second_worker"]:
        failed.append(f"second worker {result['found']['second_worker']:.3g}")
    write_between(PAGE, "benchmarks/study.py", table(found))
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
