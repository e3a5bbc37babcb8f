"""The first 20 elastic modes of a free plate, compared with Exudyn's own FEMinterface on the same mesh.

Reference: exudyn.FEM.FEMinterface, ImportMeshFromNGsolve and ComputeEigenmodes (ARPACK, shift-invert about zero). It
needs a number of modes, 21. This library needs a band of frequencies. Its end is the geometric mean of the 20th and the
21st frequency of FEMinterface.
Quantity: time of the computation of modes, time of assembly, and relative difference of the 20 frequencies.
Limits: three times faster, frequencies equal to 1e-6, at least 40 000 nodes.

Both sides have quadratic tetrahedra with straight edges. They run one after the other, twice, and the shorter time of
each counts.

    python -m validation.benchmarks.feminterface
"""

import json
import os
import platform
import sys
import time
from pathlib import Path

import netgen.occ as occ
import ngsolve
import numpy as np
from exudyn.FEM import FEMinterface
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.algebra import krylov as linalg
from exudyn_partition.algebra.blas_threads import one_blas_thread

RESULTS = Path(__file__).with_suffix(".json")
SIDE, THICKNESS, MAXH = 0.250, 0.005, 4.5e-3  # the plate of examples/models/rod_on_plate.py [m]
N_MODES = 20
LIMITS = {"ratio": 3.0, "difference": 1e-6, "nodes": 40_000}


def clocked(function, *arguments, **options):
    """Result of a call and its time [s]."""
    begin = time.perf_counter()
    result = function(*arguments, **options)
    return result, time.perf_counter() - begin


def feminterface(mesh, material):
    """First 21 elastic frequencies [Hz] by Exudyn and the times of assembly and modes."""
    fem = FEMinterface()
    properties = {"density": material.rho, "youngsModulus": material.E, "poissonsRatio": material.nu}
    _, assembly_s = clocked(fem.ImportMeshFromNGsolve, mesh, **properties, meshOrder=2)
    _, modes_s = clocked(fem.ComputeEigenmodes, N_MODES + 1, excludeRigidBodyModes=6)
    return fem.GetEigenFrequenciesHz(), {"assembly_s": assembly_s, "modes_s": modes_s}


def own_modes(mesh, material, band):
    """Elastic frequencies up to `band` [Hz] by this library, the times, and the number of nodes."""
    fem, assembly_s = clocked(ep.fe_model, mesh, material)
    begin = time.perf_counter()
    with one_blas_thread():
        rigid = linalg.mass_normalised(fem.rigid_modes, fem.mass)
        modes = linalg.eigenmodes(fem.stiffness, fem.mass, rigid, 2 * np.pi * band)
    modes_s = time.perf_counter() - begin
    return modes.omega / (2 * np.pi), {"assembly_s": assembly_s, "modes_s": modes_s}, fem.n_nodes


def show(result):
    table = Table(title=f"{N_MODES} elastic modes of a plate of {result['nodes']} nodes")
    for column in ("", "FEMinterface", "exudyn_partition", "ratio"):
        table.add_column(column)
    for key, label in (("assembly_s", "assembly"), ("modes_s", "modes")):
        theirs, ours = result["feminterface"][key], result["exudyn_partition"][key]
        table.add_row(label, f"{theirs:.2f} s", f"{ours:.2f} s", f"{theirs / ours:.1f}")
    Console().print(table, f"largest relative difference of the frequencies: {result['difference']:.1e}", sep="\n")


def main():
    plate = occ.Box(occ.Pnt(-SIDE / 2, -SIDE / 2, -THICKNESS), occ.Pnt(SIDE / 2, SIDE / 2, 0))
    their_times, our_times = {}, {}
    for _ in range(2):
        # FEMinterface makes its mesh quadratic, so it cannot use the same mesh twice.
        mesh = ngsolve.Mesh(occ.OCCGeometry(plate).GenerateMesh(maxh=MAXH))
        theirs, times = feminterface(mesh, ep.ALUMINIUM)
        their_times = {key: min(time, their_times.get(key, time)) for key, time in times.items()}
        band = float(np.sqrt(theirs[N_MODES - 1] * theirs[N_MODES]))
        ours, times, nodes = own_modes(mesh, ep.ALUMINIUM, band)
        our_times = {key: min(time, our_times.get(key, time)) for key, time in times.items()}
    same = len(ours) == N_MODES
    result = {
        "nodes": nodes,
        "band_Hz": band,
        "modes_found": len(ours),
        "feminterface": their_times,
        "exudyn_partition": our_times,
        "ratio": their_times["modes_s"] / our_times["modes_s"],
        "difference": float(abs(ours / theirs[:N_MODES] - 1).max()) if same else float("inf"),
        "frequencies_Hz": list(ours),
        "limits": LIMITS,
        "machine": {"cpus": os.cpu_count(), "platform": platform.platform()},
        "versions": ep.versions(),
    }
    RESULTS.write_text(json.dumps(result, indent=1) + "\n")
    show(result)
    failed = [
        f"{key} {result[key]:.3g}, expected {LIMITS[key]:.3g}"
        for key, good in {
            "ratio": result["ratio"] >= LIMITS["ratio"],
            "difference": result["difference"] <= LIMITS["difference"],
            "nodes": nodes >= LIMITS["nodes"],
        }.items()
        if not good
    ]
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
