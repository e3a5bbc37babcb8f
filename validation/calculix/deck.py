"""Input decks of CalculiX, an independent FE code, and what its results say; the scripts beside this one share them.

A deck is a list of lines. Its bodies are FE models of this library with quadratic tetrahedra, so that both codes have
the same mesh. `axisymmetric` has bodies of revolution. Contact is surface to surface by penalty.
"""

import argparse
import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import exudyn_partition as ep
from validation.contact import scenes

KEPT = scenes.ROOT / "out" / "calculix"
ALPHA = 0.05  # HHT, damping; CalculiX' default
FACES = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])  # S1 to S4 of C3D10, corners


@dataclass(frozen=True)
class Pair:
    """Contact of the surface S1, the slave, with S2, the master.

    Parameters
    ----------
    stiffness : float
        Penalty: pressure over overlap [Pa/m].
    friction : float
        Coefficient of friction.
    stick_slope : float
        Shear stress over slip of what sticks [Pa/m].
    """

    stiffness: float
    friction: float = 0.0
    stick_slope: float = 0.0

    def cards(self):
        """Lines that make the contact."""
        lines = [
            "*SURFACE INTERACTION, NAME=HARD",
            "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR",
            f"{self.stiffness:.6g}",
        ]
        if self.friction:
            lines += ["*FRICTION", f"{self.friction:g}, {self.stick_slope:.6g}"]
        return [*lines, "*CONTACT PAIR, INTERACTION=HARD, TYPE=SURFACE TO SURFACE", "S1, S2"]


FORCE = ["*CONTACT PRINT, SLAVE=S1, MASTER=S2", "CF"]  # printed at each step


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


def node_cards(points):
    """Nodes at points, (n, 2) or (n, 3) [m], numbered from one."""
    return ["*NODE", *(f"{i}, " + ", ".join(f"{x:.12g}" for x in point) for i, point in enumerate(points, 1))]


def element_cards(kind, number, cells, before):
    """Elements of the body B of a number, with nodes counted from one, after `before` elements of other bodies."""
    return [
        f"*ELEMENT, TYPE={kind}, ELSET=B{number}",
        *(f"{before + i}, " + ", ".join(map(str, cell)) for i, cell in enumerate(cells, 1)),
    ]


def material_cards(number, material):
    """Material and section of the body B of a number."""
    lines = [f"*MATERIAL, NAME=M{number}", "*ELASTIC", f"{material.E:.12g}, {material.nu:.12g}",
             "*DENSITY", f"{material.rho:.12g}"]  # fmt: skip
    if material.plastic:
        lines += ["*PLASTIC", f"{material.yield_stress:.12g}, 0.",
                  f"{material.yield_stress + material.hardening:.12g}, 1."]  # fmt: skip
    return [*lines, f"*SOLID SECTION, ELSET=B{number}, MATERIAL=M{number}"]


def model_cards(fems, surfaces=()):
    """Nodes, elements (C3D10) and materials of the bodies B1, B2, ..., and a surface S1, S2, ... of each if given.

    Nodes and elements have consecutive numbers, those of the first body first.
    """
    lines = node_cards(np.vstack([fem.points for fem in fems]))
    nodes = cells = 0
    for number, fem in enumerate(fems, 1):
        lines += [f"*NSET, NSET=N{number}, GENERATE", f"{nodes + 1}, {nodes + fem.n_nodes}, 1"]
        # The mid-side nodes follow the corners by edges 12 23 31 14 24 34, as VTK's do.
        lines += element_cards("C3D10", number, fem.cells + nodes + 1, cells)
        if surfaces:
            lines.append(f"*SURFACE, NAME=S{number}, TYPE=ELEMENT")
            lines += [f"{cells + cell + 1}, S{face}" for cell, face in patch_faces(fem, surfaces[number - 1])]
        lines += material_cards(number, fem.material)
        nodes, cells = nodes + fem.n_nodes, cells + len(fem.cells)
    return lines


def velocity_cards(velocities):
    """Initial velocities of the bodies, (3,) [m/s] each."""
    lines = [f"N{number}, {axis}, {v:.12g}" for number, velocity in enumerate(velocities, 1)
             for axis, v in enumerate(velocity, 1) if v]  # fmt: skip
    return ["*INITIAL CONDITIONS, TYPE=VELOCITY", *lines]


def dynamic_cards(end_time, step, alpha=ALPHA, option=""):
    """Lines that begin a run of implicit steps [s]."""
    steps = [f"*DYNAMIC, DIRECT, ALPHA={0.0 - alpha:g}", f"{step:.6g}, {end_time:.6g}"]
    return [f"*STEP, INC={10 * round(end_time / step) + 1}{option}", *steps]


def impact_input(fems, patches, velocities, pair, end_time, step, alpha=ALPHA):
    """Input of an impact of two bodies with their initial velocities [m/s]."""
    lines = [*model_cards(fems, patches), *pair.cards(), *velocity_cards(velocities)]
    return "\n".join([*lines, *dynamic_cards(end_time, step, alpha), *FORCE, "*END STEP", ""])


def frequency_input(fem, modes):
    """Input of the lowest modes of a free body, the six rigid ones counted."""
    return "\n".join([*model_cards([fem]), "*STEP", "*FREQUENCY", str(modes), "*END STEP", ""])


def solve(text, folder):
    """Run CalculiX on an input; returns the text of its .dat file and the time [s]."""
    folder = Path(folder)
    (folder / "job.inp").write_text(text)
    begin = time.perf_counter()
    one = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run([executable(), "job"], cwd=folder, capture_output=True, text=True, check=False, env=one)
    time_s = time.perf_counter() - begin
    if done.returncode or "*ERROR" in done.stdout:
        said = [line for line in done.stdout.splitlines() if "ERROR" in line] or done.stdout.splitlines()[-5:]
        raise RuntimeError(f"CalculiX stopped with exit code {done.returncode}: {' '.join(said[:5])}")
    return (folder / "job.dat").read_text(), time_s


def frequencies(dat):
    """Frequencies of the modes that a .dat file lists, (n,) [Hz]; those of rigid modes may be zero."""
    rows = re.findall(r"^ +\d+ +\S+ +\S+ +(\S+) +\S+$", dat.split("P A R T I C I P A T I O N")[0], flags=re.MULTILINE)
    return np.array(rows, dtype=float)


def contact_force(dat):
    """Times, (n,) [s], and total contact forces on the slave, (n, 3) [N], of what a .dat file holds."""
    number = r"(-?\d\.\d+E[+-]\d+)"
    times = re.findall(r"slave set S1, master set S2 and time\s+(\S+)", dat)
    forces = re.findall(rf"total surface force.*\n\s*\n\s*{number}\s+{number}\s+{number}", dat)
    if not times or len(times) != len(forces):
        raise RuntimeError(f"expected a contact force at each time of the .dat file, got {len(forces)} at {len(times)}")
    return np.array(times, dtype=float), np.array(forces, dtype=float)


def kept_run(name, text, again, axis=2, scale=1.0):
    """History by CalculiX, kept in a file for the next run of the same input.

    The slave is above, the normal is a coordinate axis; forces are multiplied by `scale`.
    """
    path = KEPT / f"{re.sub(r'[^A-Za-z0-9.]+', '_', name)}.npz"
    mark = hashlib.sha256(text.encode()).hexdigest()
    if path.exists() and not again:
        kept = ep.History.load(path)
        if kept.info["input"] == mark:
            return kept
    with tempfile.TemporaryDirectory() as folder:
        dat, time_s = solve(text, folder)
    t, force = contact_force(dat)
    t, force = np.r_[0.0, t], scale * np.vstack([np.zeros(3), force])
    info = {"time_s": time_s, "offline_s": 0.0, "input": mark, "calculix": version()}
    along = {"tangential_force": force * (np.arange(3) != axis)} if "*FRICTION" in text else {}
    found = ep.History(t, force[:, axis], {}, info, **along)
    path.parent.mkdir(parents=True, exist_ok=True)
    found.save(path)
    print(f"CalculiX, {name}: {time_s:.0f} s", flush=True)
    return found


def arguments(description, script, since=(2, 0)):
    """Arguments of a script; without CalculiX of this version or a later one the script ends here, without error."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one run of CalculiX, on a coarse mesh")
    parser.add_argument("--out", type=Path, default=Path(script).with_suffix(".json"), help="file of the results")
    parser.add_argument("--again", action="store_true", help="run CalculiX also where its result is kept in out/")
    options = parser.parse_args()
    if executable() is None:
        print("skipped: `ccx`, CalculiX' solver, is not on the path (Debian: apt-get install calculix-ccx)")
        sys.exit(0)
    if tuple(int(number) for number in re.findall(r"\d+", version())[:2]) < since:
        print(f"skipped: needs CalculiX {'.'.join(map(str, since))} or later, `ccx` is {version()}")
        sys.exit(0)
    return options


def finish(options, result, failed):
    """Write the JSON result; exit with a message if limits are missed."""
    machine = {"cpus": os.cpu_count(), "platform": platform.platform(), "versions": ep.versions()}
    told = {"quick": options.quick, **result, "calculix": version(), "beyond_limits": failed, "machine": machine}
    options.out.write_text(json.dumps(told, indent=1, default=float) + "\n")
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)
