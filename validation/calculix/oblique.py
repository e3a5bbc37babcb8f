"""Oblique impact of a ball on a plate with friction by CalculiX, compared with reduced bodies and the full FE model.

Scene: a steel ball of 10 mm radius meets a free aluminium plate at 0.5 m/s; the coefficient of friction is 0.3. Along
the plate it moves at 0.5 m/s, so that all of the contact slips, or at 0.15 m/s, so that much of it sticks for a while.
All use the same quadratic tetrahedra.
CalculiX has surface-to-surface contact with a penalty for overlap and one for slip of what sticks (`*FRICTION`, stick
slope). Where much sticks it diverges with stiff ones, and what sticks with softer ones yields too much. That error goes
with the inverse of the slope. So the reference is then the limit of two slopes, by a straight line at each time.
Reference: CalculiX. Quantity: relative L2 errors of normal and tangential force; the impulses; run times.
Limits: normal force 2 %, tangential force 4 %. With --quick the first speed alone.

Without `ccx` the script says so, writes nothing, and ends with exit code 0.

    python -m validation.calculix.oblique [--quick] [--again] [--out FILE]
"""

import math

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.calculix import deck
from validation.contact import scenes

R, SIDE, THICKNESS = 10e-3, 24e-3, 8e-3  # ball, plate [m]
SPEED, FRICTION, F_CUT, STEP = 0.5, 0.3, 150e3, 2e-6
H = 0.15e-3  # size of elements at the contact [m]
ALONG = {"slip": 0.5, "partial slip": 0.15}  # [m/s]
STIFFNESS = 1e17  # [Pa/m]
STICK_SLOPES = {"slip": (1e16,), "partial slip": (3e15, 1e15)}  # [Pa/m]
LIMITS = {"normal": 0.02, "tangential": 0.04}


def models():
    """FE models and partitions of ball, above, and plate."""
    ball = occ.Sphere(occ.Pnt(0, 0, R), R)
    plate = occ.Box(occ.Pnt(-SIDE / 2, -SIDE / 2, -THICKNESS), occ.Pnt(SIDE / 2, SIDE / 2, 0))
    found = []
    for shape, material, reach, up in ((ball, scenes.STEEL, 0.5e-3, -1), (plate, ep.ALUMINIUM, 0.6e-3, 1)):
        fem = ep.fe_model(shape, material, maxh=4e-3, refine=[ep.Refine((0, 0, 0), 0.4e-3, H)], grading=0.5)
        found.append((fem, ep.Partition.ball(fem, (0, 0, 0), reach, direction=(0, 0, up), axes="xyz")))
    return found


def calculix_run(case, slope, parts, end_time, again):
    """Histories of both forces by CalculiX."""
    fems, patches = [fem for fem, _ in parts], [partition.patches[0] for _, partition in parts]
    velocities = [(ALONG[case], 0, -SPEED), (0, 0, 0)]
    pair = deck.Pair(STIFFNESS, FRICTION, slope)
    text = deck.impact_input(fems, patches, velocities, pair, end_time, STEP)
    return deck.kept_run(f"oblique, {case}, {slope:g}", text, again)


def limit(stiffer, softer, ratio):
    """History for an infinite stick slope, of those for two slopes; `ratio` is that of the slopes."""
    force, along = (
        getattr(stiffer, name) + (getattr(stiffer, name) - getattr(softer, name)) / (ratio - 1)
        for name in ("force", "tangential_force")
    )
    info = {"time_s": stiffer.info["time_s"] + softer.info["time_s"], "offline_s": 0.0}
    return ep.History(stiffer.t, np.maximum(force, 0.0), {}, info, tangential_force=along)


def full_run(parts, along, end_time):
    velocities = (along, 0, -SPEED), (0, 0, 0)
    bodies = [ep.reference.FullBody(*part, velocity=v) for part, v in zip(parts, velocities, strict=True)]
    history = ep.reference.simulate(bodies, end_time=end_time, step=STEP / 4, friction=FRICTION)
    history.info["offline_s"] = history.info["setup_s"]
    return history


def reduced_run(bodies, along, end_time):
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[along, 0, -SPEED])
    contact = ep.CreatePartitionContact(mbs, ball, ep.CreatePartitionBody(mbs, bodies[1]), friction=FRICTION)
    mbs.Assemble()
    history = ep.solve_dynamic(mbs, end_time=end_time, step=STEP / 4).history(contact)
    history.info["offline_s"] = sum(body.reduce_s for body in bodies)
    return history


def entry(case, name, run, reference):
    """What is told of a run."""
    error = ep.compare(run, reference).error if run is not reference else {"force": 0.0, "tangential": 0.0}
    return {
        "case": case,
        "name": name,
        "normal": error["force"],
        "tangential": error["tangential"],
        "peak_N": run.peak_force,
        "impulse_Ns": run.impulse,
        "impulse_along_Ns": float(np.trapezoid(run.tangential_force[:, 0], run.t)),
        "offline_s": run.info["offline_s"],
        "online_s": run.info["time_s"],
    }


def measured(cases, again):
    """All runs by case and name, what is told of them, and the number of nodes."""
    parts = models()
    ball, plate = (fem.total_mass for fem, _ in parts)
    hertz = ep.hertz.impact(ep.hertz.effective(ball, plate), SPEED, R, math.inf, scenes.STEEL, ep.ALUMINIUM)
    end_time = STEP * math.ceil(1.15 * hertz.duration / STEP)
    bodies = [ep.reduce(*part, f_cut=F_CUT) for part in parts]
    every, rows = {}, []
    for case in cases:
        slopes = STICK_SLOPES[case]
        runs = {f"CalculiX, {k:g} Pa/m": calculix_run(case, k, parts, end_time, again) for k in slopes}
        if len(slopes) > 1:
            runs = {"CalculiX, limit": limit(*runs.values(), slopes[0] / slopes[1])} | runs
        reference = next(iter(runs.values()))
        runs["full FE"] = full_run(parts, ALONG[case], end_time)
        runs["contact-adapted"] = reduced_run(bodies, ALONG[case], end_time)
        every[case] = runs
        rows += [entry(case, name, run, reference) for name, run in every[case].items()]
    return every, rows, sum(fem.n_nodes for fem, _ in parts)


def draw(every):
    path, (figure, axes) = scenes.figure(__file__, ncols=len(every), figsize=(7 * len(every), 5), squeeze=False)
    for panel, (case, runs) in zip(axes[0], every.items(), strict=True):
        for i, (name, run) in enumerate(runs.items()):
            style = {"lw": 0.9} if i else {"color": "0.7", "lw": 4}
            (line,) = panel.plot(1e6 * run.t, run.force, label=name, **style)
            panel.plot(1e6 * run.t, -run.tangential_force[:, 0], **(style | {"color": line.get_color()}))
        panel.plot(1e6 * run.t, FRICTION * run.force, "k:", lw=0.8, label="coefficient times normal force")
        panel.set(title=f"{case}: normal force, and that against the motion", xlabel="time [µs]", ylabel="force [N]")
        panel.grid(alpha=0.3)
        panel.legend(fontsize=8)
    figure.savefig(path, dpi=120)
    return path


def main():
    options = deck.arguments(__doc__, __file__)
    every, rows, nodes = measured([*ALONG][:1] if options.quick else ALONG, options.again)
    print(draw(every))
    found = {key: max(row[key] for row in rows if row["name"] == "contact-adapted") for key in LIMITS}
    head = ("case", "run", "normal", "tangential", "peak, N", "impulse, mNs", "along, mNs", "off-line", "on-line")
    lines = [
        (r["case"], r["name"], f"{r['normal']:.2%}", f"{r['tangential']:.2%}", f"{r['peak_N']:.1f}",
         f"{1e3 * r['impulse_Ns']:.4f}", f"{1e3 * r['impulse_along_Ns']:.4f}", f"{r['offline_s']:.2f} s",
         f"{r['online_s']:.3g} s")
        for r in rows
    ]  # fmt: skip
    title = f"Oblique impact with friction: errors against CalculiX on the same mesh, {nodes} nodes"
    table = Table(*head, title=title)
    for line in lines:
        table.add_row(*line)
    Console(width=150).print(table)
    failed = [f"{key} {found[key]:.2%}" for key, limit in LIMITS.items() if found[key] > limit]
    result = {"runs": rows, "nodes": nodes, "found": found, "limits": LIMITS, "tables": {title: (head, lines)}}
    deck.finish(options, result, failed)


if __name__ == "__main__":
    main()
