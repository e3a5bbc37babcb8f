"""Factors of K + s M by fronts in the order of nested dissection, beside SuperLU in its own orders.

Reference: SciPy's SuperLU with its best own order. Bodies: a solid block of quadratic elements, and a thin plate.
Quantity: seconds of one thread for order and factors, for one right-hand side and for 48, and entries of one triangle
of the factors, all in one run, each way in a process of its own with at most 7 GB and 250 s.
Limits: our factors take at most 0.5 of the time of SuperLU in its best order, of each body.

    python -m validation.benchmarks.ordering
"""

import json
import multiprocessing
import resource
import sys
import time
from pathlib import Path

import netgen.occ as occ
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.algebra.blas_threads import one_blas_thread
from exudyn_partition.algebra.sparse.multifrontal import Factorisation

F_CUT, COLUMNS, LIMIT = 40e3, 48, 0.5
MEMORY, PATIENCE_S = 7 << 30, 250.0
SHAPES = {"block": ((0.1, 0.06, 0.04), 4.05e-3), "plate": ((0.25, 0.25, 0.006), 6.4e-3)}  # [m]
TIMES = "factor_s", "solve_one_s", "solve_s"
SUPERLU = ("MMD_AT_PLUS_A", "COLAMD")


def factors(matrix, way):
    """Factors of SciPy's SuperLU in one of its own orders, or ours by fronts."""
    if way == "ours":
        return Factorisation(matrix)
    options = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": way != "COLAMD"}}
    return scipy.sparse.linalg.splu(sp.csc_matrix(matrix), permc_spec=way, **options)


def triangle(found, way):
    """Entries of one triangle; SuperLU stores two."""
    return int(found.nnz) // (2 if way in SUPERLU else 1)


def measure(matrix, way, pipe):
    """Seconds and entries by one way, sent through a pipe; nothing if the memory does not do."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    rhs = np.random.default_rng(0).normal(size=(matrix.shape[0], COLUMNS))
    with one_blas_thread():
        times = [time.perf_counter()]
        found = factors(matrix, way)
        found.solve(rhs[:, 0])  # compiles
        times.append(time.perf_counter())
        found.solve(rhs[:, 0])
        times.append(time.perf_counter())
        solution = found.solve(np.asfortranarray(rhs))
        times.append(time.perf_counter())
    residual = np.linalg.norm(matrix @ solution - rhs) / np.linalg.norm(rhs)
    taken = dict(zip(TIMES, np.diff(times).tolist(), strict=True))
    pipe.send({**taken, "entries": triangle(found, way), "residual": float(residual)})


def in_process(matrix, way):
    """What `measure` found; None if it ran out of memory or time."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=measure, args=(matrix, way, theirs))
    process.start()
    theirs.close()
    found = None
    try:
        if ours.poll(PATIENCE_S):
            found = ours.recv()
    except EOFError:
        pass
    process.kill()
    process.join()
    return found


def main():
    """Run the script; returns whether the limit holds."""
    cases, table = {}, Table("body", "unknowns", "order", "factors", "one solution", f"{COLUMNS}", "entries")
    for name, (size, maxh) in SHAPES.items():
        fem = ep.fe_model(occ.Box((0, 0, 0), size), ep.STEEL, maxh=maxh)
        matrix = fem.stiffness + (2 * np.pi * F_CUT) ** 2 * fem.mass
        runs = {}
        for way in ("ours", *SUPERLU):
            runs[way] = in_process(matrix, way)
            said = ["no memory or time", "", "", ""]
            if runs[way]:
                said = [*(f"{runs[way][key]:.3f} s" for key in TIMES), f"{runs[way]['entries']:.3g}"]
            table.add_row(name, str(fem.n_dofs), way, *said)
            print(name, way, runs[way], flush=True)
        best = min((runs[way]["factor_s"] for way in SUPERLU if runs[way]), default=np.inf)
        cases[name] = {"dofs": fem.n_dofs, "runs": runs, "factors": runs["ours"]["factor_s"] / best}
    Console(width=110).print(table)
    result = {"limit": LIMIT, "cases": cases, "versions": ep.versions()}
    Path(__file__).with_suffix(".json").write_text(json.dumps(result, indent=1) + "\n")
    return all(case["factors"] < LIMIT for case in cases.values())


if __name__ == "__main__":
    sys.exit(not main())
