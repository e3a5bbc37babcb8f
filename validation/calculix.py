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

    python validation/calculix.py [--quick] [--again] [--out FILE]
"""

import argparse
import hashlib
import json
import math
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import exudyn as exu
import matplotlib as mpl
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep

mpl.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[1]
FIGURE, KEPT = ROOT / "out" / "calculix.png", ROOT / "out" / "calculix"
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
STEEL = ep.Material(E=210e9, nu=0.3, rho=7850.0)
PATCH = 0.4e-3, 0.5e-3  # radii of the patches of slave and master [m]
STEP, F_CUT = 1e-6, 150e3
ALPHA = 0.05  # HHT, damping; CalculiX' default
LIMITS = {"contact-adapted": 0.01, "force": 0.01, "peak": 0.01, "impulse": 0.001}
QUICK_LIMITS = LIMITS | {"force": 0.03}
FACES = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])  # S1 to S4 of C3D10, corners


def executable():
    """Path of CalculiX' solver, or None."""
    return shutil.which("ccx")


def version():
    """Version of CalculiX."""
    said = subprocess.run([executable(), "-v"], capture_output=True, text=True, check=False).stdout
    return " ".join(said.split()).removeprefix("This is Version ")


def patch_faces(fem, patch):
    """Elements, from 0, and faces, 1 to 4, of a patch's facets."""
    corners = np.sort(fem.cells[:, FACES], axis=2).reshape(-1, 3)
    place = {tuple(face): i for i, face in enumerate(corners)}
    found = np.array([place[tuple(face)] for face in np.sort(patch.facets[:, :3], axis=1)])
    return np.column_stack([found // 4, found % 4 + 1])


def model_cards(fems, surfaces=()):
    """Nodes, elements (C3D10) and materials of the bodies B1, B2, ..., and a surface S1, S2, ... of each if given.

    Nodes and elements have consecutive numbers, those of the first body first.
    """
    points = np.vstack([fem.points for fem in fems])
    lines = ["*NODE", *(f"{i}, {x:.12g}, {y:.12g}, {z:.12g}" for i, (x, y, z) in enumerate(points, 1))]
    nodes = cells = 0
    for number, fem in enumerate(fems, 1):
        lines += [f"*NSET, NSET=N{number}, GENERATE", f"{nodes + 1}, {nodes + fem.n_nodes}, 1"]
        # The mid-side nodes follow the corners by edges 12 23 31 14 24 34, as VTK's do.
        lines.append(f"*ELEMENT, TYPE=C3D10, ELSET=B{number}")
        lines += [f"{cells + i}, " + ", ".join(map(str, cell + nodes + 1)) for i, cell in enumerate(fem.cells, 1)]
        if surfaces:
            lines.append(f"*SURFACE, NAME=S{number}, TYPE=ELEMENT")
            lines += [f"{cells + cell + 1}, S{face}" for cell, face in patch_faces(fem, surfaces[number - 1])]
        material = fem.material
        lines += [
            f"*MATERIAL, NAME=M{number}", "*ELASTIC", f"{material.E:.12g}, {material.nu:.12g}",
            "*DENSITY", f"{material.rho:.12g}", f"*SOLID SECTION, ELSET=B{number}, MATERIAL=M{number}",
        ]  # fmt: skip
        nodes, cells = nodes + fem.n_nodes, cells + len(fem.cells)
    return lines


def impact_input(fems, patches, velocities, stiffness, end_time, step, alpha):
    """Input of an impact of two bodies; `stiffness` is the penalty, pressure over overlap [Pa/m]."""
    lines = model_cards(fems, patches)
    lines += [
        "*SURFACE INTERACTION, NAME=HARD", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{stiffness:.6g}",
        "*CONTACT PAIR, INTERACTION=HARD, TYPE=SURFACE TO SURFACE", "S1, S2",
        "*INITIAL CONDITIONS, TYPE=VELOCITY",
        *(f"N{number}, {axis}, {v:.12g}" for number, velocity in enumerate(velocities, 1)
          for axis, v in enumerate(velocity, 1) if v),
        f"*STEP, INC={round(end_time / step) + 1}", f"*DYNAMIC, DIRECT, ALPHA={-alpha:g}",
        f"{step:.6g}, {end_time:.6g}",
        "*CONTACT PRINT, SLAVE=S1, MASTER=S2", "CF", "*END STEP",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def frequency_input(fem, modes):
    """Input of the lowest modes of a free body, the six rigid ones counted."""
    return "\n".join([*model_cards([fem]), "*STEP", "*FREQUENCY", str(modes), "*END STEP"]) + "\n"


def solve(text, folder):
    """Run CalculiX on an input; returns the text of its .dat file and the time [s]."""
    folder = Path(folder)
    (folder / "job.inp").write_text(text)
    begin = time.perf_counter()
    done = subprocess.run([executable(), "job"], cwd=folder, capture_output=True, text=True, check=False)
    time_s = time.perf_counter() - begin
    if done.returncode or "*ERROR" in done.stdout:
        said = [line for line in done.stdout.splitlines() if "ERROR" in line] or done.stdout.splitlines()[-5:]
        raise RuntimeError(f"CalculiX stopped with exit code {done.returncode}: {' '.join(said)}")
    return (folder / "job.dat").read_text(), time_s


def frequencies(dat):
    """Frequencies of the modes that a .dat file lists, (n,) [Hz]; those of rigid modes may be zero."""
    rows = re.findall(r"^ +\d+ +\S+ +\S+ +(\S+) +\S+$", dat.split("P A R T I C I P A T I O N")[0], flags=re.MULTILINE)
    return np.array(rows, dtype=float)


def contact_force(dat):
    """Times and total contact force along z on the first body, (n,) [s], [N], of what a .dat file holds."""
    number = r"(-?\d\.\d+E[+-]\d+)"
    times = re.findall(r"slave set S1, master set S2 and time\s+(\S+)", dat)
    forces = re.findall(rf"total surface force.*\n\s*\n\s*{number}\s+{number}\s+{number}", dat)
    if not times or len(times) != len(forces):
        raise RuntimeError(f"expected a contact force at each time of the .dat file, got {len(forces)} at {len(times)}")
    return np.array(times, dtype=float), np.array(forces, dtype=float)[:, 2]


def calculix_run(path, parts, end_time, again, stiffness=PENALTY, step=STEP, alpha=ALPHA):
    """Force history by CalculiX, kept in a file for the next run of the same mesh and settings."""
    fems, patches = [fem for fem, _ in parts], [partition.patches[0] for _, partition in parts]
    text = impact_input(fems, patches, [(0, 0, -SPEED), (0, 0, 0)], stiffness, end_time, step, alpha)
    mark = hashlib.sha256(text.encode()).hexdigest()
    if path.exists() and not again:
        kept = ep.History.load(path)
        if kept.info["input"] == mark:
            return kept
    with tempfile.TemporaryDirectory() as folder:
        dat, time_s = solve(text, folder)
    t, force = contact_force(dat)
    info = {"time_s": time_s, "offline_s": 0.0, "input": mark}
    history = ep.History(np.r_[0.0, t], np.r_[0.0, force], {}, info)
    path.parent.mkdir(parents=True, exist_ok=True)
    history.save(path)
    return history


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
        path = KEPT / f"{mesh}_{name.replace(' ', '_').replace('/', '_')}.npz"
        runs[f"CalculiX, {name}"] = run = calculix_run(path, parts, end_time, again, **options)
        print(f"{mesh}, CalculiX, {name}: {run.info['time_s']:.0f} s", flush=True)
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
    figure, axes = plt.subplots(1, 2, figsize=(14, 5), layout="constrained")
    reference = runs["full FE"]
    axes[0].plot(1e6 * hertz.t, hertz.force, "k--", lw=1, label="Hertz")
    for name, run in runs.items():
        style = {"color": "0.7", "lw": 4} if run is reference else {"lw": 0.9}
        axes[0].plot(1e6 * run.t, run.force, label=name, **style)
        if run is not reference:
            difference = np.interp(reference.t, run.t, run.force) - reference.force
            axes[1].plot(1e6 * reference.t, difference, label=name, lw=0.9)
    axes[0].set(title="contact force", xlabel="time [us]", ylabel="force [N]")
    axes[1].set(title="difference from the full FE model", xlabel="time [us]", ylabel="force [N]")
    for panel in axes:
        panel.grid(alpha=0.3)
        panel.legend(fontsize=8)
    FIGURE.parent.mkdir(exist_ok=True)
    figure.savefig(FIGURE, dpi=120)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the coarse mesh alone, one run of CalculiX")
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".json"), help="file of the results")
    parser.add_argument("--again", action="store_true", help="run CalculiX also where its result is kept in out/")
    options = parser.parse_args()
    if executable() is None:
        print("skipped: `ccx`, CalculiX' solver, is not on the path (Debian: apt-get install calculix-ccx)")
        return
    rows = []
    for mesh, settings in (QUICK_RUNS if options.quick else RUNS).items():
        hertz, runs, found = measured(mesh, settings, options.again)
        rows += found
    draw(runs, hertz)
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
        f"{1e6 * STEP:g} us and alpha {ALPHA:g} unless said"
    )
    table = Table(*head, title=title)
    for line in lines:
        table.add_row(*line)
    Console(width=150).print(table)
    limits = QUICK_LIMITS if options.quick else LIMITS
    failed = [f"{key} {found[key]:.2%}" for key, limit in limits.items() if found[key] > limit]
    data = {
        "quick": options.quick,
        "runs": rows,
        "hertz": {"peak_N": hertz.peak_force, "duration_s": hertz.duration},
        "found": found,
        "limits": limits,
        "calculix": version(),
        "tables": {title: (head, lines)},
        "beyond_limits": failed,
        "machine": {"cpus": os.cpu_count(), "platform": platform.platform(), "versions": ep.versions()},
    }
    options.out.write_text(json.dumps(data, indent=1) + "\n")
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
