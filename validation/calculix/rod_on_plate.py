"""A short rod on a free plate by CalculiX on a finer mesh, compared with reduced bodies of few unknowns.

Scene: a steel rod of 60 mm, 10 mm thick, with a tip of 8 mm radius falls at 0.5 m/s on the middle of a free aluminium
plate of 120 x 80 x 8 mm. CalculiX has a quarter of both with quadratic tetrahedra, held by the planes of symmetry.
The reduced bodies are whole: cubic tetrahedra in the plate, quadratic ones in the rod.
Reference: CalculiX on its finer mesh; the coarser one shows how far it has converged. Quantity: relative L2 error of
the force over the impact, its peak and impulse; unknowns; times from CAD to force, and the reference's beside them.
Limits: 1 % of the force with at most 20 000 unknowns.

Without `ccx` the script says so, writes nothing, and ends with exit code 0.

    python -m validation.calculix.rod_on_plate [--quick] [--again] [--out FILE]
"""

import math
import time

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.calculix import deck
from validation.contact import scenes

RADIUS, TIP, LENGTH = 5e-3, 8e-3, 60e-3  # of the rod [m]
PLATE = 0.12, 0.08, 0.008  # [m]
SPEED, F_CUT = 0.5, 60e3
PENALTY, STEP = 1e17, 2e-6  # of CalculiX: pressure over overlap [Pa/m]; [s]
# Elements of rod and plate far away [m], and at the contact by its radius.
MESHES = {"fine": (4e-3, 4e-3, 0.4), "coarse": (4e-3, 6e-3, 0.4)}
OURS = {"order": (2, 3), "far": (6e-3, 20e-3), "near": (0.5, 0.85), "within": 1.2}
LIMITS = {"force": 0.01, "dofs": 20_000}


def shapes():
    """Rod, its tip at the origin, and plate below."""
    x, y, z = PLATE
    tip = occ.Sphere(occ.Pnt(0, 0, TIP), TIP) + occ.Cylinder(occ.Pnt(0, 0, TIP), occ.Z, r=TIP, h=LENGTH)
    rod = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=RADIUS, h=LENGTH) * tip
    return rod, occ.Box(occ.Pnt(-x / 2, -y / 2, -z), occ.Pnt(x / 2, y / 2, 0))


MATERIALS = scenes.STEEL, ep.ALUMINIUM
MASS = ep.hertz.effective(np.pi * RADIUS**2 * LENGTH * scenes.STEEL.rho, math.prod(PLATE) * ep.ALUMINIUM.rho)
HERTZ = ep.hertz.impact(MASS, SPEED, TIP, math.inf, *MATERIALS)
END = STEP * math.ceil(1.15 * HERTZ.duration / STEP)


def models(bodies, order, far, near, within=1.5):
    """FE models and partitions of rod, the slave, and plate."""
    found, a = [], HERTZ.contact_radius
    for shape, material, k, maxh, h, up in zip(bodies, MATERIALS, order, far, near, (-1, 1), strict=True):
        fine = ep.Refine((0, 0, 0), within * a, h * a)
        fem = ep.fe_model(shape, material, order=k, maxh=maxh, refine=[fine], grading=0.5)
        reach = (1.6 + h) * a if up < 0 else (2.2 + h) * a
        found.append((fem, ep.Partition.ball(fem, (0, 0, 0), reach, direction=(0, 0, up))))
    return found


def calculix_run(mesh, again):
    rod, plate, near = MESHES[mesh]
    quarter = occ.Box(occ.Pnt(0, 0, -1), occ.Pnt(1, 1, 1))
    parts = models([shape * quarter for shape in shapes()], (2, 2), (rod, plate), (near, near))
    fems, patches = [fem for fem, _ in parts], [part.patches[0] for _, part in parts]
    points = np.vstack([fem.points for fem in fems])
    held = [f"{node}, {axis + 1}, {axis + 1}" for axis in range(2)
            for node in np.flatnonzero(abs(points[:, axis]) < 1e-9) + 1]  # fmt: skip
    lines = [
        *deck.model_cards(fems, patches), "*BOUNDARY", *held, *deck.Pair(PENALTY).cards(),
        *deck.velocity_cards([(0, 0, -SPEED), (0, 0, 0)]), *deck.dynamic_cards(END, STEP), *deck.FORCE, "*END STEP", "",
    ]  # fmt: skip
    history = deck.kept_run(f"rod on plate, {mesh}", "\n".join(lines), again, scale=4.0)
    history.info["dofs"] = 3 * len(points)
    return history


def reduced_run():
    begin, cpu = time.perf_counter(), time.process_time()
    parts = models(shapes(), **OURS)
    mesh_s = time.perf_counter() - begin
    bodies = [ep.reduce(*part, f_cut=F_CUT) for part in parts]
    mbs = exu.SystemContainer().AddSystem()
    rod = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -SPEED])
    contact = ep.CreatePartitionContact(mbs, rod, ep.CreatePartitionBody(mbs, bodies[1]), passes="given")
    mbs.Assemble()
    history = ep.solve_dynamic(mbs, end_time=END).history(contact)
    history.info.update(
        offline_s=mesh_s + sum(body.reduce_s for body in bodies),
        from_cad_s=time.perf_counter() - begin,
        from_cad_cpu_s=time.process_time() - cpu,
        dofs=sum(fem.n_dofs for fem, _ in parts),
    )
    return history


def draw(runs):
    path, (figure, axis) = scenes.figure(__file__, figsize=(8, 5))
    for i, (name, run) in enumerate(runs.items()):
        axis.plot(1e6 * run.t, run.force, label=name, **({"color": "0.7", "lw": 4} if i == 0 else {"lw": 1}))
    axis.set(title="rod on plate: contact force", xlabel="time [µs]", ylabel="force [N]")
    axis.grid(alpha=0.3)
    axis.legend()
    figure.savefig(path, dpi=120)
    return path


def main():
    options = deck.arguments(__doc__, __file__)
    meshes = ("coarse",) if options.quick else MESHES
    runs = {f"CalculiX, {mesh} quarter": calculix_run(mesh, options.again) for mesh in meshes}
    runs["reduced"] = ours = reduced_run()
    reference = next(iter(runs.values()))
    print(draw(runs))
    rows = [
        {
            "name": name,
            "dofs": run.info["dofs"],
            "force": ep.compare(run, reference).error["force"],
            "peak": run.peak_force / reference.peak_force - 1,
            "impulse": run.impulse / reference.impulse - 1,
            "peak_N": run.peak_force,
            "offline_s": run.info["offline_s"],
            "online_s": run.info["time_s"],
        }
        for name, run in runs.items()
    ]
    found = {"force": rows[-1]["force"], "dofs": ours.info["dofs"]}
    head = ("run", "unknowns", "force", "peak", "impulse", "peak, N", "off-line", "on-line")
    lines = [
        (r["name"], f"{r['dofs']}", f"{r['force']:.2%}", f"{r['peak']:+.2%}", f"{r['impulse']:+.2%}",
         f"{r['peak_N']:.1f}", f"{r['offline_s']:.1f} s", f"{r['online_s']:.3g} s")
        for r in rows
    ]  # fmt: skip
    title = "Rod on plate: errors against CalculiX' quarter model on its finer mesh"
    table = Table(*head, title=title)
    for line in lines:
        table.add_row(*line)
    Console(width=130).print(table)
    failed = [f"{key} {found[key]:.3g}" for key, limit in LIMITS.items() if found[key] > limit]
    seconds = {key: ours.info[key] for key in ("from_cad_s", "from_cad_cpu_s")}
    seconds |= {"ratio": reference.info["time_s"] / ours.info["from_cad_s"]}
    result = {"runs": rows, "found": found, "limits": LIMITS, **seconds, "tables": {title: (head, lines)}}
    deck.finish(options, result, failed)


if __name__ == "__main__":
    main()
