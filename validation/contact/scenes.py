"""Functions that the scripts here share: spheres, quasi-static states, and the output."""

import json
import os
import platform
import sys
from pathlib import Path

import netgen.occ as occ
import numpy as np
import scipy.linalg

import exudyn_partition as ep

ROOT = Path(__file__).resolve().parents[2]
STEEL = ep.Material(E=210e9, nu=0.3, rho=7850.0)


def sphere(radius, material, contact_radius, h, *, up=True, rng=None, spare=0.0, maxh=0.25):
    """FE model and partition of a sphere that touches z = 0 at the origin, from above or below.

    `contact_radius` is the largest that the contact will have, `h` the size of elements there, `maxh` that elsewhere
    over the radius. The patch is larger than the contact, by `spare` [m] more than a slave needs. With `rng` the mesh
    is placed and turned at random, because one mesh can be good by chance.
    """
    sign = 1 if up else -1
    shape = occ.Sphere(occ.Pnt(0, 0, sign * radius), radius)
    offset = np.zeros(3)
    if rng is not None:
        # The poles of an OCC sphere are vertices of each mesh.
        offset = rng.uniform(-0.5, 0.5, 3) * h
        axis = occ.Axis(occ.Pnt(0, 0, sign * radius), occ.Dir(*rng.normal(size=3)))
        shape = shape.Rotate(axis, rng.uniform(30, 150))
    fine = ep.Refine(offset, 1.2 * contact_radius, h)
    fem = ep.fe_model(shape, material, maxh=maxh * radius, refine=[fine], grading=0.4)
    reach = 1.1 * contact_radius + 1.2 * h + spare
    return fem, ep.Partition.ball(fem, (0, 0, 0), reach, direction=(0, 0, -sign))


def equilibrium(law, q, free, load=0.0, tolerance=1e-12):
    """Coordinates at rest under a contact law and loads, by Newton on the active set. Those not in `free` are held."""
    omega = np.concatenate([side.kinematics.body.basis.omega for side in law.gaps.sides])
    q, free = q.copy(), np.flatnonzero(free)
    for _ in range(60):
        residual = (law.at(q).generalised + load - omega**2 * q)[free]
        tangent = (law.evaluation.tangent() + np.diag(omega**2))[np.ix_(free, free)]
        scale = 1 / np.sqrt(np.maximum(np.diag(tangent), 1e-12 * np.diag(tangent).max()))
        # Motions along the surfaces have no stiffness.
        step = scale * scipy.linalg.lstsq(scale[:, None] * tangent * scale, scale * residual, cond=1e-13)[0]
        q[free] += step
        if abs(step).max() <= tolerance * abs(q).max():
            law.at(q)
            return q
    raise RuntimeError("the quasi-static state did not settle in 60 steps")


def figure(script, **options):
    """Path of a script's figure, and an empty figure."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    out = ROOT / "out"
    out.mkdir(exist_ok=True)
    return out / f"{Path(script).resolve().parent.name}_{Path(script).stem}.png", plt.subplots(
        layout="constrained", **options
    )


def front(script, runs, full, error, xlabel, ylabel):
    """Draw errors over run time, on-line and with what is off-line, of runs and of the full FE model; return the path.

    `runs` and `full` have entries "offline_s" and "online_s" [s] by the name of each run, and `error` gives the error
    of an entry.
    """
    path, (picture, axes) = figure(script, ncols=2, figsize=(11, 4.8), sharey=True)
    both = {"on-line": "online_s"}, {"off-line": "offline_s", "on-line": "online_s"}
    for ax, what in zip(axes, both, strict=True):
        for found, kind in ((runs, "full"), (full, "none")):
            for (name, run), marker in zip(found.items(), "os^vDP*Xp<>hd8H", strict=False):
                time_s = sum(run[one] for one in what.values())
                ax.loglog(time_s, 100 * error(run), marker, color="k", fillstyle=kind, label=name)
        ax.set(xlabel=f"{xlabel} [s], {' and '.join(what)}")
        ax.grid(alpha=0.3, which="both")
    axes[0].set(ylabel=f"{ylabel} [%]")
    axes[1].legend(fontsize=7)
    picture.savefig(path, dpi=150)
    return path


def without_curves(value):
    """Leave out lists of more than a dozen numbers: figures show them, and a run makes them again."""
    if isinstance(value, dict):
        return {
            k: without_curves(v) for k, v in value.items() if not (isinstance(v, list) and len(v) > 12 and _is_curve(v))
        }
    return [without_curves(v) for v in value] if isinstance(value, list) else value


def _is_curve(values):
    return not any(isinstance(v, dict) for v in values)


def finish(script, result, failed, out=None):
    """Write the JSON result beside the script, or to `out`; exit with a message if limits are missed."""
    machine = {"cpus": os.cpu_count(), "platform": platform.platform(), "versions": ep.versions()}
    result = {
        **without_curves(json.loads(json.dumps(result, default=float))),
        "beyond_limits": failed,
        "machine": machine,
    }
    (out or Path(script).with_suffix(".json")).write_text(json.dumps(result, indent=1) + "\n")
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)
