"""Bring your own part: a STEP file or a mesh file in millimetres, dropped onto a rigid floor.

Without --file the example makes a part, a rocker with a round nose and a bore, and writes it in both formats. With
--file it drops your part. Say where the part touches the floor (--at), in metres, and which direction is down (--down).
"""

import argparse
import json
import time
from pathlib import Path

import exudyn as exu
import matplotlib.pyplot as plt
import meshio
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

MILLIMETRE = 1e-3


def write_rocker(folder, h):
    """Write the part as rocker.step and, meshed, as rocker.vtu, both in millimetres; returns the paths."""
    nose = occ.Cylinder(occ.Pnt(0, 0, 8), occ.Z, r=8, h=12) + occ.Sphere(occ.Pnt(0, 0, 8), 8)
    arm = occ.Box(occ.Pnt(-8, -8, 15), occ.Pnt(72, 8, 25))
    bore = occ.Cylinder(occ.Pnt(60, 0, 0), occ.Z, r=5, h=40)
    rocker = nose + arm - bore
    step, mesh = folder / "rocker.step", folder / "rocker.vtu"
    rocker.WriteStep(str(step))
    fem = ep.fe_model(step, ep.STEEL, **mesh_options((0, 0, 0), h))
    # Any format of meshio works, such as Gmsh, Abaqus or Nastran. Elements must be fine where contact happens.
    meshio.Mesh(fem.points / MILLIMETRE, [(f"tetra{fem.cells.shape[1]}", fem.cells)]).write(mesh)
    return [step, mesh]


def mesh_options(at, h):
    """Options for Netgen's mesh of a STEP file: finer around the contact, with elements of size h [m] there."""
    return {"scale": MILLIMETRE, "maxh": 5e-3, "refine": [ep.Refine(at, radius=4 * h, h=h)]}


def drop(path, options):
    """FE model of a file, reduced and dropped; returns them and the run."""
    is_step = path.suffix.lower() in (".step", ".stp")
    fem = ep.fe_model(path, ep.STEEL, **(mesh_options(options.at, options.h) if is_step else {"scale": MILLIMETRE}))
    print(f"{path.name}: {fem}")  # size and mass show whether the unit was right
    down = np.array(options.down) / np.linalg.norm(options.down)
    partition = ep.Partition.ball(fem, center=options.at, radius=6 * options.h, direction=down)
    body = ep.reduce(fem, partition, f_cut=options.f_cut)
    mbs = exu.SystemContainer().AddSystem()
    part = ep.CreatePartitionBody(mbs, body, name=path.stem, initialVelocity=options.speed * down)
    floor = ep.RigidPlane(point=options.at, normal=-down)
    contact = ep.CreatePartitionContact(mbs, part, floor, name="floor")
    mbs.Assemble()
    return fem, part, contact, ep.solve_dynamic(mbs, end_time=options.end_time), down


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--file", type=Path, help="STEP (millimetres), VTU, Gmsh, Abaqus or Nastran")
    parser.add_argument("--at", type=float, nargs=3, default=[0, 0, 0], metavar="M", help="where it touches the floor")
    parser.add_argument("--down", type=float, nargs=3, default=[0, 0, -1])
    parser.add_argument("--speed", type=float, default=0.3, metavar="M/S")
    parser.add_argument("--h", type=float, metavar="M", help="element size at the contact")
    parser.add_argument("--f-cut", type=float, default=60e3, metavar="HZ")
    parser.add_argument("--end-time", type=float, default=0.5e-3, metavar="S")
    parser.add_argument("--quick", action="store_true", help="coarser mesh")
    parser.add_argument("--out", type=Path, default=Path("out/own_part"), metavar="DIR")
    options = parser.parse_args(argv)
    options.h = options.h or (0.2e-3 if options.quick else 0.1e-3)
    options.out.mkdir(parents=True, exist_ok=True)

    begin = time.perf_counter()
    runs = [drop(path, options) for path in ([options.file] if options.file else write_rocker(options.out, options.h))]
    total_s = time.perf_counter() - begin
    fem, part, contact, run, down = runs[0]
    history = run.history(contact)
    momentum = (part.momentum(run) - part.momentum(run)[0]) @ down
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
        "left_out": [*part.left_out, *contact.left_out],
        "versions": ep.versions(),
    }
    if len(runs) == 2:  # the same part from both files
        force = [c.force(r) for _, _, c, r, _ in runs]
        result["error"] = {"mesh_file": float(np.linalg.norm(force[1] - force[0]) / np.linalg.norm(force[0]))}
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    frames = ep.output.write_paraview(options.out / "frames", run, [(part, fem)], times=20)

    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.5), layout="constrained")
    ep.plot.force(left, run)
    right.imshow(ep.view.picture(run, run.t[-1], [(part, fem)], field="velocity", scale=200, size=(900, 700)))
    right.set_title(f"t = {1e3 * run.t[-1]:.3g} ms")
    right.set_axis_off()
    picture = options.out / "own_part.png"
    figure.savefig(picture, dpi=150)
    print(json.dumps({key: result[key] for key in ("dofs", "fe_dofs", "mass_kg", "time", "peak_force_N")}, indent=2))
    print(frames)
    print(picture.resolve())
    return result


if __name__ == "__main__":
    main()
