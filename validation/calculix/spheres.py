"""Two spheres by CalculiX, an independent FE code, compared with the full FE model and the contact-adapted basis.

Scene: two equal steel spheres of 10 mm radius meet at 0.5 m/s. All use the same quadratic tetrahedra.
CalculiX (`ccx`, Debian's calculix-ccx) has surface-to-surface contact by penalty and implicit HHT steps. Its contact
force is what it prints for the pair (CF). Its stiffness matrix equals ours to round-off. Its mass matrix does not,
because it is integrated at four points in an element (tests/validation/test_calculix.py). Only modes of the
length of an element show this.
Reference: this library's full FE model (HHT, exact complementarity), with its own error from half the step. The table
also has Hertz' peak and duration.
Quantity: relative L2 error of the contact force, peak, impulse, duration; run times. CalculiX' penalty stiffness, its
step and its damping alpha are varied one at a time. The penalty limits its accuracy; step and damping do not. The
penalty must be stiff against the material over the size of an element, E / h = 2e15 Pa/m. Beyond 1e16 Pa/m only the
mesh matters, because CalculiX enforces contact at integration points of facets, and this library by integrated rows.
Limits: contact-adapted against the full FE model 1 % (force). CalculiX with the stiffest penalty on the fine mesh
against it: 1 % in force and peak, 0.1 % in impulse. With --quick, on the coarse mesh with 1e16 Pa/m: 3 % in force.

Without `ccx` the script says so, writes nothing, and ends with exit code 0.

    python -m validation.calculix.spheres [--quick] [--again] [--out FILE]
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

MESHES = {"coarse": 0.15e-3, "fine": 0.1e-3}  # size of elements at the contact [m]
PENALTY = 1e16  # pressure over overlap [Pa/m]
RUNS = {  # of CalculiX, by mesh; those of the last mesh are judged
    "coarse": {
        "1e15 Pa/m": {"stiffness": 1e15},
        "1e16 Pa/m": {},
        "1e17 Pa/m": {"stiffness": 1e17},
        "1e16 Pa/m, half the step": {"step": 0.5e-6},
        "1e16 Pa/m, alpha 0.3": {"alpha": 0.3},
    },
    "fine": {"1e17 Pa/m": {"stiffness": 1e17}},
}
QUICK_RUNS = {"coarse": {"1e16 Pa/m": {}}}
R, SPEED = 0.010, 0.5  # [m], [m/s]
STEEL = scenes.STEEL
PATCH = 0.4e-3, 0.5e-3  # radii of the patches of slave and master [m]
STEP, F_CUT = 1e-6, 150e3
LIMITS = {"contact-adapted": 0.01, "force": 0.01, "peak": 0.01, "impulse": 0.001}
QUICK_LIMITS = LIMITS | {"force": 0.03}


def calculix_run(name, parts, end_time, again, stiffness=PENALTY, step=STEP, alpha=deck.ALPHA):
    """Force history by CalculiX."""
    fems, patches = [fem for fem, _ in parts], [partition.patches[0] for _, partition in parts]
    velocities, pair = [(0, 0, -SPEED), (0, 0, 0)], deck.Pair(stiffness)
    return deck.kept_run(name, deck.impact_input(fems, patches, velocities, pair, end_time, step, alpha), again)


def full_run(parts, end_time, step):
    bodies = [ep.reference.FullBody(*part, velocity=(0, 0, v)) for part, v in zip(parts, (-SPEED, 0.0), strict=True)]
    history = ep.reference.simulate(bodies, end_time=end_time, step=step)
    history.info["offline_s"] = history.info["setup_s"]
    return history


def adapted_run(parts, end_time):
    reduced = [ep.reduce(*part, f_cut=F_CUT) for part in parts]
    mbs = exu.SystemContainer().AddSystem()
    upper = ep.CreatePartitionBody(mbs, reduced[0], initialVelocity=[0, 0, -SPEED])
    lower = ep.CreatePartitionBody(mbs, reduced[1])
    contact = ep.CreatePartitionContact(mbs, upper, lower)
    mbs.Assemble()
    history = ep.solve_dynamic(mbs, end_time=end_time).history(contact)
    history.info["offline_s"] = sum(body.reduce_s for body in reduced)
    return history


def sphere(side, h):
    """FE model and partition of the sphere above (side 1) or below (side -1) the origin; h [m] at the contact."""
    shape = occ.Sphere(occ.Pnt(0, 0, side * R), R)
    fem = ep.fe_model(shape, STEEL, maxh=4e-3, refine=[ep.Refine((0, 0, 0), 0.3e-3, h)], grading=0.5)
    return fem, ep.Partition.ball(fem, (0, 0, 0), PATCH[0 if side == 1 else 1], direction=(0, 0, -side))


def measured(mesh, settings, again):
    """Hertz' impact, and all runs on a mesh by name; `settings` are those of CalculiX."""
    parts = [sphere(side, MESHES[mesh]) for side in (1, -1)]
    mass = parts[0][0].total_mass
    hertz = ep.hertz.impact(ep.hertz.effective(mass, mass), SPEED, R, R, STEEL, STEEL)
    end_time = STEP * math.ceil(1.2 * hertz.duration / STEP)
    runs = {
        "full FE": full_run(parts, end_time, STEP / 2),
        "full FE, half the step": full_run(parts, end_time, STEP / 4),
        "contact-adapted": adapted_run(parts, end_time),
    }
    for name, options in settings.items():
        runs[f"CalculiX, {name}"] = calculix_run(f"spheres, {mesh}, {name}", parts, end_time, again, **options)
    nodes = sum(fem.n_nodes for fem, _ in parts)
    return hertz, runs, [entry(mesh, nodes, name, run, runs["full FE"], mass) for name, run in runs.items()]


def entry(mesh, nodes, name, run, reference, mass):
    return {
        "mesh": mesh,
        "nodes": nodes,
        "name": name,
        "force": ep.compare(run, reference).error["force"],
        "peak": run.peak_force / reference.peak_force - 1,
        "impulse": run.impulse / reference.impulse - 1,
        "momentum": run.impulse / (mass * SPEED) - 1,
        "peak_N": run.peak_force,
        "duration_s": run.contact_duration,
        "offline_s": run.info["offline_s"],
        "online_s": run.info["time_s"],
    }


def draw(runs, hertz):
    path, (figure, axes) = scenes.figure(__file__, ncols=2, figsize=(14, 5))
    reference = runs["full FE"]
    axes[0].plot(1e6 * hertz.t, hertz.force, "k--", lw=1, label="Hertz")
    for name, run in runs.items():
        style = {"color": "0.7", "lw": 4} if run is reference else {"lw": 0.9}
        axes[0].plot(1e6 * run.t, run.force, label=name, **style)
        if run is not reference:
            difference = np.interp(reference.t, run.t, run.force) - reference.force
            axes[1].plot(1e6 * reference.t, difference, label=name, lw=0.9)
    axes[0].set(title="contact force", xlabel="time [µs]", ylabel="force [N]")
    axes[1].set(title="difference from the full FE model", xlabel="time [µs]", ylabel="force [N]")
    for panel in axes:
        panel.grid(alpha=0.3)
        panel.legend(fontsize=8)
    figure.savefig(path, dpi=120)
    return path


def main():
    options = deck.arguments(__doc__, __file__)
    rows = []
    for mesh, settings in (QUICK_RUNS if options.quick else RUNS).items():
        hertz, runs, found = measured(mesh, settings, options.again)
        rows += found
    print(draw(runs, hertz))
    ours, calculix = (next(r for r in reversed(rows) if name in r["name"]) for name in ("contact-adapted", "CalculiX"))
    found = {key: abs(calculix[key]) for key in ("force", "peak", "impulse")} | {"contact-adapted": ours["force"]}
    head = ("mesh", "run", "force", "peak", "impulse", "impulse / (m v)", "peak, N", "duration, us", "off-line",
            "on-line")  # fmt: skip
    lines = [
        (f"{r['mesh']}, {r['nodes']} nodes", r["name"], f"{r['force']:.2%}", f"{r['peak']:+.2%}",
         f"{r['impulse']:+.2%}", f"{r['momentum']:+.2%}", f"{r['peak_N']:.1f}", f"{1e6 * r['duration_s']:.1f}",
         f"{r['offline_s']:.2f} s", f"{r['online_s']:.3g} s")
        for r in rows
    ]  # fmt: skip
    lines.append(("", "Hertz", "", "", "", "", f"{hertz.peak_force:.1f}", f"{1e6 * hertz.duration:.1f}", "", ""))
    title = (
        "Two spheres: errors against the full FE model of this library on the same mesh; CalculiX with steps of "
        f"{1e6 * STEP:g} us and alpha {deck.ALPHA:g} unless said"
    )
    table = Table(*head, title=title)
    for line in lines:
        table.add_row(*line)
    Console(width=150).print(table)
    limits = QUICK_LIMITS if options.quick else LIMITS
    failed = [f"{key} {found[key]:.2%}" for key, limit in limits.items() if found[key] > limit]
    result = {
        "runs": rows,
        "hertz": {"peak_N": hertz.peak_force, "duration_s": hertz.duration},
        "found": found,
        "limits": limits,
        "tables": {title: (head, lines)},
    }
    deck.finish(options, result, failed)


if __name__ == "__main__":
    main()
