"""What a second worker of Dask is worth: a map of 500 plastic impacts, by wall time and by processor time.

An aluminium block that yields hits a rigid ball, at speeds of 0.1 to 0.5 m/s, in clusters of one worker and of two, in
turns; each turn has its share of the speeds. All is on this machine, with workers of one thread.
By wall time: time of one worker over that of two. It says something only on a machine with two free cores. So before
and after each turn two processes that only add numbers are measured against one: two free cores are worth 2. A turn
counts as quiet if that is at least 1.9 before and after it.
By processor time, which other work disturbs less: workers, times the share of their time within runs, over the
processor time of a run; of two workers over one. This is what two workers would be worth on cores of their own.
Reference: one worker for two, and the same restitution bit by bit.
Limits: 1.7 by wall time, of quiet turns; 1.7 by processor time, of all.

    python -m validation.benchmarks.second_worker [--impacts N] [--turns N]
"""

import argparse
import functools
import os
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

IMPACTS, TURNS = 500, 5
HERE = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "threads_per_worker": 1}
LIMITS = {"wall": 1.7, "processor": 1.7}
QUIET, SUMMANDS = 1.9, 6_000_000


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


def added(count):
    """Sum of some numbers, in plain Python."""
    total = 0
    for number in range(count):
        total += number
    return total


def free_cores(pool):
    """How many processes' work two processes do that only add numbers: 2 on two free cores."""
    begin = time.perf_counter()
    pool.submit(added, SUMMANDS).result()
    alone = time.perf_counter() - begin
    begin = time.perf_counter()
    list(pool.map(added, [SUMMANDS] * 2))
    return 2 * alone / (time.perf_counter() - begin)


def measured(function, speeds, client, n):
    """Wall time of a map by a cluster of n workers [s], processor time of an impact [s], and share of time in runs."""
    begin = time.perf_counter()
    found = ep.study(function, {"speed": speeds}, workers=client, stop=True)
    wall = time.perf_counter() - begin
    busy = float(found.info["wall_s"].sum()) / (n * wall)
    told = {"wall_s": wall, "processor_s": float(np.mean(found["processor_s"])), "busy": busy}
    return told | {"worth": n * busy / told["processor_s"]}, found["restitution"]


def turn(function, speeds, clients, pool):
    """One turn: two clusters, and how free the cores were before and after."""
    before = free_cores(pool)
    (alone, first), (both, second) = (measured(function, speeds, client, n) for n, client in clients.items())
    assert np.array_equal(first, second)
    cores = min(before, free_cores(pool))
    return {"one": alone, "two": both, "processor": both["worth"] / alone["worth"],
            "wall": alone["wall_s"] / both["wall_s"], "free_cores": cores, "quiet": cores >= QUIET}  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--impacts", type=int, default=IMPACTS, help="of all turns")
    parser.add_argument("--turns", type=int, default=TURNS)
    parser.add_argument("--out", type=Path, help="file of the results, instead of the JSON beside the script")
    options = parser.parse_args()
    console, function, rows = Console(), functools.partial(impact, block()), []
    speeds = np.linspace(0.1, 0.5, options.impacts)
    with (
        LocalCluster(n_workers=1, **HERE) as small,
        LocalCluster(n_workers=2, **HERE) as large,
        Client(small) as one,
        Client(large) as two,
        ProcessPoolExecutor(2, get_context("spawn")) as pool,
    ):
        clients = {1: one, 2: two}
        for client in clients.values():  # each worker loads and compiles
            ep.study(function, {"speed": speeds[:8].tolist()}, workers=client, chunk=1)
        list(pool.map(added, [1000] * 2))
        for number in range(options.turns):
            rows.append(turn(function, speeds[number :: options.turns].tolist(), clients, pool))
            console.print(rows[-1])
    quiet = [row["wall"] for row in rows if row["quiet"]]
    found = {"processor": float(np.median([row["processor"] for row in rows]))}
    if quiet:
        found["wall"] = float(np.median(quiet))
    result = {
        "found": found,
        "impacts": options.impacts,
        "quiet_turns": len(quiet),
        "wall_of_all_turns": float(np.median([row["wall"] for row in rows])),
        "turns": rows,
        "load": os.getloadavg(),
        "limits": LIMITS,
    }
    console.print(result)
    failed = [f"{name} {value:.3g}" for name, value in found.items() if value < LIMITS[name]]
    scenes.finish(__file__, result, failed, options.out)


if __name__ == "__main__":
    main()
