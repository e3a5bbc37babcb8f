"""A map of 10 000 impacts by `ep.run_many`, and arrows of its gradient by `ep.sensitivity`.

A hammer head hits the middle of a free steel bar. Restitution falls with the mass of the head, for the bar takes energy
into vibration, and comes back where the bar swings against the head a second time. Speed and density of the head vary:
one model, and one file that an interrupted map goes on from. At some points arrows show in which direction restitution
grows most, by derivatives of the very steps. They are compared with differences of the map.
"""

import argparse
import json
import time
from pathlib import Path

import exudyn as exu
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

STEEL = ep.Material(E=210e9, nu=0.3, rho=7850.0)
SPEEDS, MASSES = (0.05, 1.0), (0.1, 5.0)  # of the head [m/s], and its mass over that of steel
END = 1.5e-3  # of each run [s]: three quarters of the bar's first period


def scene(quick):
    """The model, the head and the bar."""
    head = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=0.008, h=0.010) * occ.Sphere((0, 0, 0.020), 0.020)
    bar = occ.Box((-0.100, -0.010, -0.004), (0.100, 0.010, 0))
    fine, bodies = ep.Refine((0, 0, 0), 0.6e-3, 0.3e-3 if quick else 0.2e-3), []
    for shape in (head, bar):
        fem = ep.fe_model(shape, STEEL, maxh=8e-3 if quick else 5e-3, refine=[fine], grading=0.6)
        bodies.append(ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1.1e-3), f_cut=60e3))
    mbs = exu.SystemContainer().AddSystem()
    items = [
        ep.CreatePartitionBody(mbs, body, name=name, referencePosition=[0, 0, gap])
        for body, name, gap in zip(bodies, ("head", "bar"), (1e-6, 0), strict=True)
    ]
    ep.CreatePartitionContact(mbs, *items)
    mbs.Assemble()
    return mbs, *items


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="64 impacts, a coarser mesh")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="threads")
    parser.add_argument("--out", type=Path, default=Path("out/impact_map"), metavar="DIR")
    options = parser.parse_args(argv)
    options.out.mkdir(parents=True, exist_ok=True)
    (mbs, head, bar), n = scene(options.quick), 8 if options.quick else 100
    speeds, masses = np.geomspace(*SPEEDS, n), np.geomspace(*MASSES, n)
    v, m = (grid.ravel() for grid in np.meshgrid(speeds, masses))
    down = np.column_stack([0 * v, 0 * v, -v])
    begin, step = time.process_time(), 0.9 * ep.stability_limit(mbs) * np.sqrt(MASSES[0])
    runs = ep.run_many(
        mbs, end_time=END, step=step, vary={head: {"initialVelocity": down, "rho": m * STEEL.rho}},
        file=options.out / ("quick.jsonl" if options.quick else "fine.jsonl"), workers=options.workers,
    )  # fmt: skip
    seconds, restitution = time.process_time() - begin, runs.restitution[:, 0].reshape(n, n)

    def gradient(speed, mass):
        """Restitution, and its derivatives by the logarithms of speed and mass."""
        values = {head: {"initialVelocity": [0, 0, -speed], "rho": mass * STEEL.rho}}
        after, by_v, by_m = 0.0, 0.0, 0.0
        for item, sign in ((head, 1), (bar, -1)):
            found = ep.sensitivity(mbs, end_time=END, step=step, of="velocity", at=item, values=values)
            after += sign * found.value
            by_v -= sign * speed * found.by[head]["initialVelocity"][2]
            by_m += sign * mass * STEEL.rho * found.by[head]["rho"]
        return after / speed, (by_v - after) / speed, by_m / speed

    places = range(1, n - 1, 2) if options.quick else range(5, n, 10)
    at = [(i, j) for i in places for j in places]
    begin = time.process_time()
    arrows = np.array([gradient(speeds[j], masses[i]) for i, j in at])
    by_map = np.gradient(restitution, np.log(masses), np.log(speeds))  # by mass, by speed
    differences = np.array([[by_map[1][place], by_map[0][place]] for place in at])
    result = {
        "impacts": n * n, "failed": len(runs.failures), "ms_an_impact": 1e3 * seconds / n**2,
        "ms_a_gradient": 1e3 * (time.process_time() - begin) / len(at), "restitution": restitution.tolist(),
        "contacts": runs.counts[:, 0].reshape(n, n).tolist(), "places": at, "arrows": arrows.tolist(),
        "value_error": float(abs(arrows[:, 0] - [restitution[place] for place in at]).max()),
        "median_difference": float(np.median(abs(arrows[:, 1:] - differences))), "versions": ep.versions(),
    }  # fmt: skip
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    figure, axes = plt.subplots(figsize=(8, 6), layout="constrained")
    shown = axes.pcolormesh(speeds, masses, restitution, shading="nearest", cmap="viridis")
    x, y = np.array([(speeds[j], masses[i]) for i, j in at]).T
    dx, dy = 0.15 * arrows[:, 1:].T / np.hypot(*arrows[:, 1:].T)  # of equal length, as the axes are logarithmic
    ends = {"angles": "xy", "scale_units": "xy", "scale": 1.0}
    axes.quiver(x, y, x * np.expm1(dx), y * np.expm1(dy), color="white", width=3e-3, **ends)
    axes.set(xscale="log", yscale="log", xlabel="speed of the head [m/s]", ylabel="mass of the head over that of steel")
    axes.contour(speeds, masses, runs.counts[:, 0].reshape(n, n), np.arange(1.5, 6), colors="k", linewidths=0.7)
    axes.set_title(f"{n * n} impacts, {result['ms_an_impact']:.1f} ms each; lines: one contact more")
    figure.colorbar(shown, label="restitution")
    figure.savefig(picture := (options.out / "impact_map.png").resolve(), dpi=150)
    print(f"{n * n} impacts, {result['failed']} failed, restitution {restitution.min():.3f} to {restitution.max():.3f}")
    print(f"arrows differ from the map by {result['median_difference']:.1g} in the median", picture, sep="\n")
    return result


if __name__ == "__main__":
    main()
