"""A study over the impact speed of a ball, by a plain loop or by processes; by a client of Dask it runs on a cluster.

One function of plain values computes an impact, and `ep.study` calls it. Each result becomes a line of a file at once,
so a study that was stopped goes on.
"""

import argparse
import functools
import json
import math
from dataclasses import replace
from pathlib import Path

import exudyn as exu
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

R, MATERIAL = 0.010, replace(ep.STEEL, yield_stress=None)  # an elastic study: no word on yielding


def impact(body, speed):
    """One impact on a rigid floor."""
    hertz = ep.hertz.impact(body.total_mass, speed, R, math.inf, MATERIAL)
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, body, name="ball", initialVelocity=[0, 0, -speed])
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), name="floor")
    mbs.Assemble()
    force = contact.force(ep.solve_dynamic(mbs, end_time=1.3 * hertz.duration))
    return {"peak_force_N": force.max(), "hertz_N": hertz.peak_force}


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes; 1 is a plain loop")
    parser.add_argument("--quick", action="store_true", help="four speeds, a coarser mesh")
    parser.add_argument("--out", type=Path, default=Path("out/parameter_study"), metavar="DIR")
    options = parser.parse_args(argv)
    (out := options.out).mkdir(parents=True, exist_ok=True)
    mesh, count, h = ("quick", 4, 0.2e-3) if options.quick else ("fine", 25, 0.1e-3)
    if not (file := out / f"ball_{mesh}.npz").exists():
        refine = [ep.Refine((0, 0, 0), radius=0.6e-3, h=h)]  # contact rows of size h
        fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, R), R), MATERIAL, maxh=4e-3, refine=refine)
        ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), radius=0.7e-3), f_cut=150e3).save(file)
    function, speeds = functools.partial(impact, ep.load_body(file)), np.linspace(0.2, 0.8, count).round(4)
    found = ep.study(function, {"speed": speeds}, file=out / f"results_{mesh}.jsonl", workers=options.workers)
    error = float(abs(found["peak_force_N"] / found["hertz_N"] - 1).max())
    result = {name: found[name].tolist() for name in found.names} | {"new": found.info["new"], "error": error}
    result |= {"time": {"wall_s": found.info["wall_s"].tolist()}, "versions": ep.versions()}
    (out / "result.json").write_text(json.dumps(result, indent=2))
    axes = plt.subplots(layout="constrained")[1]
    axes.plot(speeds, found["peak_force_N"], "o", speeds, found["hertz_N"], "k--")
    axes.set(xlabel="speed [m/s]", ylabel="peak force [N]", title="computed, and by Hertz (dashed)")
    axes.figure.savefig(picture := (out / "parameter_study.png").resolve(), dpi=150)
    print(f"{result['new']} of {count} impacts are new; the largest difference is {error:.2%}", picture, sep="\n")
    return result


if __name__ == "__main__":
    main()
