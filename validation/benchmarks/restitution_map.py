"""How long a map of restitution takes: 1000 impacts of a tilted bar, 20 tilts by 50 speeds, in two processes.

Each tilt has a mesh and a reduction of its own. The impacts are those of `validation/experiments/tilted_bar.py`, of the
bar of 100 mm, each watched until no contact can follow.
Quantity: processor time of all processes over two cores, wall time, and the largest change of energy.
Limits: 600 s of processor time by two cores; energy 1e-3. Wall time is that of the machine with what else it did.

Some of the fastest and steepest impacts reach the edge of the patch, and warn; they take as long.

    python -m validation.benchmarks.restitution_map
"""

import os
import time

import numpy as np
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes
from validation.experiments.tilted_bar import RADIUS, STEEL, shape

LENGTH, TILTS, SPEEDS = 0.1, np.linspace(10, 86, 20), np.linspace(0.1, 1.0, 50)
LIMITS = {"cpu_s": 600.0, "balance": 1e-3}


def pair(tilt):
    """The bar at a tilt [degrees], with elements and cut that `ep.design_impact` gives for 2 %, and the plane."""
    fine = [ep.Refine((0, 0, 0), radius=0.35e-3, h=0.13e-3)]
    for maxh in RADIUS * 0.9 ** np.arange(6):
        try:
            fem = ep.fe_model(shape(LENGTH, np.radians(tilt)), STEEL, maxh=maxh, refine=fine)
            break
        except ep.errors.MeshError:  # an element without volume, by chance
            continue
    part = ep.Partition.ball(fem, (0, 0, 0), 0.5e-3, direction=(0, 0, -1))
    return ep.reduce(fem, part, f_cut=45e3), ep.RigidPlane()


def main():
    begin = time.perf_counter()
    found = ep.restitution_map(pair, speed=SPEEDS, place=TILTS, workers=2)
    used = sum(os.times()[:4])  # of this process and of those that have ended, user and system
    result = {
        "impacts": int(found["restitution"].size),
        "cpu_s": used / 2,
        "wall_s": time.perf_counter() - begin,
        "balance": float(abs(found["balance"]).max()),
        "contacts": [int(found["contacts"].min()), int(found["contacts"].max())],
        "restitution": [float(found["restitution"].min()), float(found["restitution"].max())],
        "not_over": int((found["over"] == 0).sum()),
        "limits": LIMITS,
    }
    Console().print(result)
    failed = [f"{name} {result[name]:.3g}" for name, limit in LIMITS.items() if result[name] > limit]
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
