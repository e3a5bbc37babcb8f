"""Bring your own part: a STEP file or a mesh file in millimetres, dropped onto a rigid floor.

Without --file the example writes a part in both formats, the rocker with a round nose in models/rocker.py. With
--file it drops your part. Say where the part touches the floor (--at), in metres, and which direction is down (--down).
The part rings after the impact. A second run has a damping ratio for all kept modes, and the figure shows both.
"""

import argparse
import json
import time
from pathlib import Path

import exudyn as exu
import matplotlib.pyplot as plt
import numpy as np

import exudyn_partition as ep
from models.rocker import MILLIMETRE, mesh_options, write_rocker


def drop(path, options):
    """FE model of a file, reduced and dropped; returns it, and body, contact and run."""
    is_step = path.suffix.lower() in (".step", ".stp")
    fem = ep.fe_model(path, ep.STEEL, **(mesh_options(options.at, options.h) if is_step else {"scale": MILLIMETRE}))
    print(f"{path.name}: {fem}")  # size and mass show whether the unit was right
    partition = ep.Partition.ball(fem, center=options.at, radius=6 * options.h, direction=options.down)
    return fem, *fall(ep.reduce(fem, partition, f_cut=options.f_cut), options, path.stem)


def fall(body, options, name, damping=None):
    """Drop a reduced body; returns its item, the contact and the run."""
    mbs = exu.SystemContainer().AddSystem()
    speed = options.speed * options.down
    part = ep.CreatePartitionBody(mbs, body, name=name, initialVelocity=speed, damping=damping)
    floor = ep.RigidPlane(point=options.at, normal=-options.down)
    contact = ep.CreatePartitionContact(mbs, part, floor, name="floor")
    mbs.Assemble()
    return part, contact, ep.solve_dynamic(mbs, end_time=options.end_time)


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--file", type=Path, help="STEP (millimetres), VTU, Gmsh, Abaqus or Nastran")
    parser.add_argument("--at", type=float, nargs=3, default=[0, 0, 0], metavar="M", help="where it touches the floor")
    parser.add_argument("--down", type=float, nargs=3, default=[0, 0, -1])
    parser.add_argument("--speed", type=float, default=0.3, metavar="M/S")
    parser.add_argument("--h", type=float, metavar="M", help="element size at the contact")
    parser.add_argument("--f-cut", type=float, default=60e3, metavar="HZ")
    parser.add_argument("--damping", type=float, default=0.05, help="ratio of the second run")
    parser.add_argument("--end-time", type=float, default=0.5e-3, metavar="S")
    parser.add_argument("--quick", action="store_true", help="coarser mesh")
    parser.add_argument("--out", type=Path, default=Path("out/own_part"), metavar="DIR")
    options = parser.parse_args(argv)
    options.h = options.h or (0.2e-3 if options.quick else 0.1e-3)
    options.down = np.array(options.down) / np.linalg.norm(options.down)
    options.out.mkdir(parents=True, exist_ok=True)

    begin = time.perf_counter()
    files = [options.file] if options.file else write_rocker(options.out, options.h)
    runs = [drop(path, options) for path in files]
    total_s = time.perf_counter() - begin
    fem, part, contact, run = runs[0]
    damped, _, damped_run = fall(part.body, options, part.name, options.damping)
    history = run.history(contact)
    momentum = (part.momentum(run) - part.momentum(run)[0]) @ options.down
    energy = part.energy(run) + contact.energy(run)
    result = {
        "dofs": part.body.n_dofs,
        "fe_dofs": fem.n_dofs,
        "mass_kg": fem.total_mass,
        "contact_nodes": contact.n_rows,
        "step_s": run.step,
        "steps": run.steps,
        "time": {"total_s": total_s, "reduce_s": part.body.reduce_s, "online_s": run.time_s},
        "peak_force_N": history.peak_force,
        "impulse_Ns": history.impulse,
        "impacts": len(contact.impacts(run)),
        "momentum_error": float(abs(momentum[-1] + history.impulse) / history.impulse),
        "energy_error": float(energy[-1] / energy[0] - 1),
        "taken_by_damping": float(damped.dissipated_energy(damped_run)[-1] / energy[0]),
        "left_out": [*part.left_out, *contact.left_out],
        "versions": ep.versions(),
    }
    if len(runs) == 2:  # the same part from both files
        force = [c.force(r) for _, _, c, r in runs]
        result["error"] = {"mesh_file": float(np.linalg.norm(force[1] - force[0]) / np.linalg.norm(force[0]))}
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    frames = ep.output.write_paraview(options.out / "frames", run, [(part, fem)], times=20)

    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(16, 4.5), layout="constrained")
    ep.plot.force(left, run)
    end = fem.points[np.linalg.norm(fem.points - options.at, axis=1).argmax()]  # the farthest point
    for item, one, label in ((part, run, "undamped"), (damped, damped_run, f"damping ratio {options.damping:g}")):
        middle.plot(1e3 * one.t, item.velocity(one, end) @ options.down, linewidth=1, label=label)
    middle.set(xlabel="time [ms]", ylabel="speed of the far end, downwards [m/s]", ymargin=0.15)
    middle.legend(loc="upper center", ncols=2)
    ep.plot.bodies(run, run.t[-1], [(part, fem)], axes=right, scale=200)
    picture = options.out / "own_part.png"
    figure.savefig(picture, dpi=150)
    ep.plot.bodies(run, bodies=[(part, fem)], colour="von_mises").figure.savefig(options.out / "bodies.png", dpi=150)
    print(json.dumps({key: result[key] for key in ("dofs", "fe_dofs", "mass_kg", "time", "peak_force_N")}, indent=2))
    print(frames)
    print(picture.resolve())
    return result


if __name__ == "__main__":
    main()
