"""Oblique impact of a ball on a plate with friction by CalculiX, compared with reduced bodies and the full FE model.

Scene: a steel ball of 10 mm radius meets a free aluminium plate at 0.5 m/s and 45 degrees; the coefficient of friction
is 0.3. The contact slips, sticks, and slips back. All use the same quadratic tetrahedra.
CalculiX has surface-to-surface contact with a penalty for overlap and one for slip of what sticks (`*FRICTION`, stick
slope). Both are varied, which shows its own error, and so is its step.
Reference: CalculiX with the stiffest penalties on the finest mesh. Quantity: relative L2 errors of normal and
tangential force; the impulses; run times.
Limits: normal force 2 %, tangential force 4 %. With --quick, on the coarse mesh: 4 % and 6 %.

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
MESHES = {"coarse": 0.15e-3, "fine": 0.11e-3}  # size of elements at the contact [m]
STIFF = {"stiffness": 1e17, "stick_slope": 1e16}  # [Pa/m]
RUNS = {  # of CalculiX, by mesh; the first of the last mesh is the reference
    "coarse": {
        "as judged": {},
        "a tenth of the penalty": {"stiffness": 1e16},
        "a tenth of the stick slope": {"stick_slope": 1e15},
        "half the step": {"step": STEP / 2},
    },
    "fine": {"as judged": {}},
}
QUICK_RUNS = {"coarse": {"as judged": {}}}
LIMITS = {"normal": 0.02, "tangential": 0.04}
QUICK_LIMITS = {"normal": 0.04, "tangential": 0.06}


def models(h):
    """FE models and partitions of ball, above, and plate; h [m] at the contact."""
    ball = occ.Sphere(occ.Pnt(0, 0, R), R)
    plate = occ.Box(occ.Pnt(-SIDE / 2, -SIDE / 2, -THICKNESS), occ.Pnt(SIDE / 2, SIDE / 2, 0))
    found = []
    for shape, material, reach, up in ((ball, scenes.STEEL, 0.5e-3, -1), (plate, ep.ALUMINIUM, 0.6e-3, 1)):
        fem = ep.fe_model(shape, material, maxh=4e-3, refine=[ep.Refine((0, 0, 0), 0.4e-3, h)], grading=0.5)
        found.append((fem, ep.Partition.ball(fem, (0, 0, 0), reach, direction=(0, 0, up), axes="xyz")))
    return found


def calculix_run(name, parts, end_time, again, step=STEP, **penalties):
    """Histories of both forces by CalculiX."""
    fems, patches = [fem for fem, _ in parts], [partition.patches[0] for _, partition in parts]
    pair, velocities = deck.Pair(friction=FRICTION, **(STIFF | penalties)), [(SPEED, 0, -SPEED), (0, 0, 0)]
    return deck.kept_run(name, deck.impact_input(fems, patches, velocities, pair, end_time, step), again)


def full_run(parts, end_time):
    velocities = (SPEED, 0, -SPEED), (0, 0, 0)
    bodies = [ep.reference.FullBody(*part, velocity=v) for part, v in zip(parts, velocities, strict=True)]
    history = ep.reference.simulate(bodies, end_time=end_time, step=STEP / 4, friction=FRICTION)
    history.info["offline_s"] = history.info["setup_s"]
    return history


def reduced_run(parts, end_time):
    bodies = [ep.reduce(*part, f_cut=F_CUT) for part in parts]
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[SPEED, 0, -SPEED])
    contact = ep.CreatePartitionContact(mbs, ball, ep.CreatePartitionBody(mbs, bodies[1]), friction=FRICTION)
    mbs.Assemble()
    history = ep.solve_dynamic(mbs, end_time=end_time, step=STEP / 4).history(contact)
    history.info["offline_s"] = sum(body.reduce_s for body in bodies)
    return history


def entry(mesh, nodes, name, run, reference):
    """What is told of a run."""
    error = ep.compare(run, reference).error if run is not reference else {"force": 0.0, "tangential": 0.0}
    along = run.tangential_force[:, 0]
    return {
        "mesh": mesh,
        "nodes": nodes,
        "name": name,
        "normal": error["force"],
        "tangential": error["tangential"],
        "peak_N": run.peak_force,
        "impulse_Ns": run.impulse,
        "impulse_along_Ns": float(np.trapezoid(along, run.t)),
        "largest_along_N": float(-along.min()),
        "offline_s": run.info["offline_s"],
        "online_s": run.info["time_s"],
    }


def measured(mesh, settings, again):
    """All runs on a mesh by name, and what is told of them."""
    parts = models(MESHES[mesh])
    ball, plate = (fem.total_mass for fem, _ in parts)
    hertz = ep.hertz.impact(ep.hertz.effective(ball, plate), SPEED, R, math.inf, scenes.STEEL, ep.ALUMINIUM)
    end_time = STEP * math.ceil(1.15 * hertz.duration / STEP)
    runs = {
        f"CalculiX, {name}": calculix_run(f"oblique, {mesh}, {name}", parts, end_time, again, **options)
        for name, options in settings.items()
    }
    runs |= {"full FE": full_run(parts, end_time), "contact-adapted": reduced_run(parts, end_time)}
    nodes, reference = sum(fem.n_nodes for fem, _ in parts), runs["CalculiX, as judged"]
    return runs, [entry(mesh, nodes, name, run, reference) for name, run in runs.items()]


def draw(runs):
    path, (figure, axes) = scenes.figure(__file__, ncols=2, figsize=(14, 5))
    for name, run in runs.items():
        style = {"color": "0.7", "lw": 4} if name == "CalculiX, as judged" else {"lw": 0.9}
        axes[0].plot(1e6 * run.t, run.force, label=name, **style)
        axes[1].plot(1e6 * run.t, -run.tangential_force[:, 0], label=name, **style)
    axes[1].plot(1e6 * run.t, FRICTION * run.force, "k:", lw=0.8, label="coefficient times normal force")
    for panel, title in zip(axes, ("normal force", "force against the motion"), strict=True):
        panel.set(title=title, xlabel="time [us]", ylabel="force [N]")
        panel.grid(alpha=0.3)
        panel.legend(fontsize=8)
    figure.savefig(path, dpi=120)
    return path


def main():
    options, rows = deck.arguments(__doc__, __file__), []
    for mesh, settings in (QUICK_RUNS if options.quick else RUNS).items():
        runs, found = measured(mesh, settings, options.again)
        rows += found
    print(draw(runs))
    found = {key: rows[-1][key] for key in LIMITS}
    head = ("mesh", "run", "normal", "tangential", "peak, N", "impulse, mNs", "along, mNs", "off-line", "on-line")
    lines = [
        (f"{r['mesh']}, {r['nodes']} nodes", r["name"], f"{r['normal']:.2%}", f"{r['tangential']:.2%}",
         f"{r['peak_N']:.1f}", f"{1e3 * r['impulse_Ns']:.4f}", f"{1e3 * r['impulse_along_Ns']:.4f}",
         f"{r['offline_s']:.2f} s", f"{r['online_s']:.3g} s")
        for r in rows
    ]  # fmt: skip
    title = "Oblique impact with friction: errors against CalculiX with its stiffest penalties on the same mesh"
    table = Table(*head, title=title)
    for line in lines:
        table.add_row(*line)
    Console(width=150).print(table)
    limits = QUICK_LIMITS if options.quick else LIMITS
    failed = [f"{key} {found[key]:.2%}" for key, limit in limits.items() if found[key] > limit]
    result = {"runs": rows, "found": found, "limits": limits, "tables": {title: (head, lines)}}
    deck.finish(options, result, failed)


if __name__ == "__main__":
    main()
