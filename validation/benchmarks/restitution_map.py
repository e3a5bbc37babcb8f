"""How long a map of restitution takes: 1000 impacts of a tilted bar, 20 tilts by 50 speeds, in two processes.

Each tilt has a mesh and a reduction of its own. The impacts are those of `validation/experiments/tilted_bar.py`, of the
bar of 100 mm, each watched until no contact can follow.
Quantity: processor time of all processes over two cores, wall time, the largest change of energy, and the share of
impacts that compiled steps ran, in either frame.
Old beside new, one process: eight impacts at a tilt of 40 degrees, slow enough that the bar turns by less than
`largest_turn`, of a ball on a plane, and of two balls, with `largest_turn=0`, in floating frames by Exudyn, as if
compiled steps held none of them, and as the map does by itself. Quantity: processor time of new over old, the largest
difference of restitution, and the largest angle by which the first body turns in contact, spin times duration.
Limits: 600 s of processor time by two cores; energy 1e-3; new over old 0.5, restitution 1e-3. Wall time is that of the
machine with what else it did.

Some of the fastest and steepest impacts reach the edge of the patch, and warn; they take as long.

    python -m validation.benchmarks.restitution_map
"""

import contextlib
import os
import time
from unittest.mock import patch

import netgen.occ as occ
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from exudyn_partition.errors import CompiledRunError
from exudyn_partition.studies import free_impact
from validation.contact import scenes
from validation.experiments.tilted_bar import RADIUS, STEEL, shape

LENGTH, TILTS, SPEEDS = 0.1, np.linspace(10, 86, 20), np.linspace(0.1, 1.0, 50)
SLOW = np.linspace(0.05, 0.2, 8)  # speeds of both ways [m/s]
LIMITS = {"cpu_s": 600.0, "balance": 1e-3, "new_over_old": 0.5, "difference": 1e-3}


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


def ball(side, radius):
    """A ball above or below the origin, with a patch there of this radius [m]."""
    refine = [ep.Refine((0, 0, 0), radius=0.8 * radius, h=0.3 * radius)]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0.01 * side), 0.01), STEEL, maxh=5e-3, refine=refine)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), radius=radius), f_cut=80e3)


def refused(mbs, options=()):
    """What `check_held` does where compiled steps hold nothing."""
    raise CompiledRunError("not in this benchmark")


def both_ways(bodies):
    """Processor time of an impact by Exudyn and as a map does it [ms], their ratio, difference of restitution, turn."""
    spent, found = {}, {}
    for way, options in (("exudyn", {"largest_turn": 0.0}), ("map", {})):
        by_exudyn = patch.object(free_impact, "check_held", refused) if way == "exudyn" else contextlib.nullcontext()
        with by_exudyn:
            ep.restitution_map(bodies, speed=SLOW, **options)  # so that all is compiled
            begin = time.process_time()
            found[way] = ep.restitution_map(bodies, speed=SLOW, **options)
            spent[way] = 1e3 * (time.process_time() - begin) / len(SLOW)
    difference = float(abs(found["map"]["restitution"] - found["exudyn"]["restitution"]).max())
    turn = float(abs(found["exudyn"]["spin"] * found["exudyn"]["span"]).max())
    compiled = int(found["map"].info["compiled"].sum())
    of_both = {"ratio": spent["map"] / spent["exudyn"], "difference": difference, "turn": turn, "compiled": compiled}
    return spent | of_both


def main():
    upper, plane = ball(1, 0.5e-3), ep.RigidPlane()
    pairs = {"bar": pair(40.0), "ball": (upper, plane), "balls": (upper, ball(-1, 0.7e-3))}
    ways = {name: both_ways(bodies) for name, bodies in pairs.items()}
    before = sum(os.times()[:4])
    begin = time.perf_counter()
    found = ep.restitution_map(pair, speed=SPEEDS, place=TILTS, workers=2)
    used = sum(os.times()[:4])  # of this process and of those that have ended, user and system
    result = {
        "impacts": int(found["restitution"].size),
        "cpu_s": (used - before) / 2,
        "wall_s": time.perf_counter() - begin,
        "balance": float(abs(found["balance"]).max()),
        "contacts": [int(found["contacts"].min()), int(found["contacts"].max())],
        "restitution": [float(found["restitution"].min()), float(found["restitution"].max())],
        "not_over": int((found["over"] == 0).sum()),
        "compiled": float(found.info["compiled"].mean()),
        "ways": ways,
        "new_over_old": max(way["ratio"] for way in ways.values()),
        "difference": max(way["difference"] for way in ways.values()),
        "limits": LIMITS,
    }
    Console().print(result)
    failed = [f"{name} {result[name]:.3g}" for name, limit in LIMITS.items() if result[name] > limit]
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
