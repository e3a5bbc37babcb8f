"""A study over the impact speed of a ball: by a plain loop, by processes, by Exudyn's ParameterVariation, or by Dask.

The ball is reduced once and kept in a file. One function of plain values computes an impact, so every way can call it.
Each result becomes a line of a file at once. A study that was stopped goes on with the speeds that this file lacks.
"""

import argparse
import json
import logging
import math
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import exudyn as exu
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np
from exudyn.processing import ParameterVariation

import exudyn_partition as ep

R, MATERIAL = 0.010, replace(ep.STEEL, yield_stress=None)  # an elastic study: no word on yielding
LOG, BALLS = logging.getLogger("parameter_study"), {}  # bodies by file: models of one share what their contacts need


def reduced_ball(path, h):
    """Store the ball, with contact rows of size h [m], unless it is there."""
    if not path.exists():
        shape = occ.Sphere(occ.Pnt(0, 0, R), R)
        fem = ep.fe_model(shape, MATERIAL, maxh=4e-3, refine=[ep.Refine((0, 0, 0), radius=0.6e-3, h=h)])
        ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), radius=0.7e-3), f_cut=150e3).save(path)


def impact(parameters):
    """One impact on a rigid floor: a plain function of plain values, which can run anywhere."""
    begin, path, speed = time.perf_counter(), parameters["ball"], parameters["speed"]
    body = BALLS[path] = BALLS.get(path) or ep.load_body(path)
    hertz = ep.hertz.impact(body.total_mass, speed, R, math.inf, MATERIAL)
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, body, name="ball", initialVelocity=[0, 0, -speed])
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), name="floor")
    mbs.Assemble()
    history = ep.solve_dynamic(mbs, end_time=1.3 * hertz.duration).history(contact)
    found = {"peak_force_N": history.peak_force, "contact_duration_s": history.contact_duration}
    return {"speed": speed, **found, "hertz_N": hertz.peak_force, "wall_s": time.perf_counter() - begin}


def records(path):
    """Results that are there, by speed; a last line that was cut off is no result."""
    lines = path.read_text().splitlines(keepends=True) if path.exists() else []
    return {record["speed"]: record for record in (json.loads(line) for line in lines if line.endswith("\n"))}


def study(how, sets, workers, keep):
    """Compute the impacts in one of the ways; `keep` takes each result as soon as it is known."""
    if how == "plain" or not sets:
        for parameters in sets:
            keep(impact(parameters))
    elif how == "exudyn":
        by_speed = {parameters["speed"]: parameters for parameters in sets}
        ParameterVariation(lambda one: keep(impact(by_speed[one["speed"]])), {"speed": [*by_speed]}, showProgress=False)
    elif how == "processes":
        with ProcessPoolExecutor(workers, get_context("spawn")) as pool:  # a fork would copy threads that hold locks
            for done in as_completed([pool.submit(impact, parameters) for parameters in sets]):
                keep(done.result())
    else:
        import distributed

        own = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}  # the dashboard takes no password
        with distributed.Client(n_workers=workers, threads_per_worker=1, **own) as client:
            for done in distributed.as_completed(client.map(impact, sets, pure=False)):
                keep(done.result())


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--how", choices=("plain", "processes", "exudyn", "dask"), default="processes")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes, for two of the ways")
    parser.add_argument("--quick", action="store_true", help="four speeds, a coarser mesh")
    parser.add_argument("--out", type=Path, default=Path("out/parameter_study"), metavar="DIR")
    options = parser.parse_args(argv)
    logging.basicConfig(format="%(asctime)s %(message)s")
    LOG.setLevel(logging.INFO)
    options.out.mkdir(parents=True, exist_ok=True)
    mesh, count, h = ("quick", 4, 0.2e-3) if options.quick else ("fine", 25, 0.1e-3)
    ball, lines = options.out / f"ball_{mesh}.npz", options.out / f"results_{mesh}.jsonl"
    reduced_ball(ball, h)
    known, begin, speeds = records(lines), time.perf_counter(), np.linspace(0.2, 0.8, count).round(4).tolist()
    lines.write_text("".join(json.dumps(record) + "\n" for record in known.values()))
    missing = [{"speed": speed, "ball": str(ball)} for speed in speeds if speed not in known]
    LOG.info("%d of %d impacts are known, the others by %s", count - len(missing), count, options.how)

    def keep(record):
        known[record["speed"]] = record
        with lines.open("a") as file:
            file.write(json.dumps(record) + "\n")
        LOG.info("%d of %d: %.4g m/s, %.0f N", len(known), count, record["speed"], record["peak_force_N"])

    study(options.how, missing, options.workers, keep)
    wall = (time.perf_counter() - begin) / max(len(missing), 1)
    print(f"{len(missing)} new impacts by {options.how}, {wall:.3f} s of wall time an impact")
    impacts = [known[speed] for speed in speeds]
    force, hertz = (np.array([one[key] for one in impacts]) for key in ("peak_force_N", "hertz_N"))
    result = {"how": options.how, "new": len(missing), "time": {"wall_s_an_impact": wall}, "impacts": impacts}
    result |= {"error": {"peak_force": float(abs(force / hertz - 1).max())}, "versions": ep.versions()}
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    axes = plt.subplots(layout="constrained")[1]
    axes.plot(speeds, force, "o", speeds, hertz, "k--")
    axes.set(xlabel="speed [m/s]", ylabel="peak force [N]", title="computed, and by Hertz (dashed)")
    axes.figure.savefig(options.out / "parameter_study.png", dpi=150)
    print((options.out / "parameter_study.png").resolve())
    return result


if __name__ == "__main__":
    main()
