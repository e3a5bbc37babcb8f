"""Factors and solutions of FE matrices, and whole reductions: ours by fronts beside PARDISO of the extra `[fast]`.

Reference: the library's factors by fronts, as it works without the extra.
Quantity: seconds of one thread for the factors of K + s M and for 48 right-hand sides, entries of the factors, and
seconds of `reduce`; all in one run, each the least of two. Largest difference of the reduced frequencies.
Limits: PARDISO's reductions take no more time than ours, and frequencies agree to 1e-6.

    python -m validation.benchmarks.factorisation
"""

import functools
import time

import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.algebra import factorisation
from exudyn_partition.algebra.factorisation import Factorisation, one_blas_thread
from exudyn_partition.algebra.sparse.pardiso import library
from validation.contact import scenes

F_CUT, COLUMNS, TIMES = 40e3, 48, 2
LIMITS = {"reduction": 1.0, "frequencies": 1e-6}


def models():
    """A rod of quadratic elements and a plate of cubic ones, with their patches."""
    rod = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=0.01, h=0.2)
    plate = occ.Box(occ.Pnt(-0.125, -0.125, -0.005), occ.Pnt(0.125, 0.125, 0))
    fine = ep.Refine((0, 0, 0), 1e-3, 0.4e-3)
    rod = ep.fe_model(rod, ep.STEEL, maxh=4e-3, refine=[fine], grading=0.35)
    plate = ep.fe_model(plate, ep.ALUMINIUM, order=3, maxh=14e-3, refine=[fine], grading=0.35)
    return {
        name: (fem, ep.Partition.ball(fem, (0, 0, 0), 1e-3)) for name, fem in (("rod", rod), ("plate, cubic", plate))
    }


def seconds(work):
    """Least time of some calls, and the last result."""
    taken = []
    for _ in range(TIMES):
        begin = time.perf_counter()
        result = work()
        taken.append(time.perf_counter() - begin)
    return min(taken), result


def measured(fem, partition, by):
    """Times of one way, and the reduced body."""
    matrix = fem.stiffness + (2 * np.pi * F_CUT) ** 2 * fem.mass
    rhs = np.random.default_rng(0).normal(size=(fem.n_dofs, COLUMNS))
    with one_blas_thread():
        factor_s, factors = seconds(lambda: Factorisation(matrix, by))
        solve_s, _ = seconds(functools.partial(factors.solve, rhs, threads=1))
    entries = factors.nnz
    del factors
    found = factorisation.library
    factorisation.library = found if by == "pardiso" else lambda: None
    try:
        reduce_s, body = seconds(lambda: ep.reduce(fem, partition, f_cut=F_CUT))
    finally:
        factorisation.library = found
    return {"factor_s": factor_s, "solve_s": solve_s, "entries": entries, "reduce_s": reduce_s}, body


def main():
    if library() is None:
        print("skipped: mkl is not installed, pip install exudyn-partition[fast]")
        return
    cases, table = {}, Table("body", "unknowns", "by", "factors", f"{COLUMNS} solutions", "entries", "reduction")
    for name, (fem, partition) in models().items():
        runs, bodies = {}, []
        for by in ("multifrontal", "pardiso"):
            runs[by], body = measured(fem, partition, by)
            bodies.append(body.basis.omega[6:])
            r = runs[by]
            table.add_row(
                name, str(fem.n_dofs), by, f"{r['factor_s']:.2f} s", f"{r['solve_s']:.2f} s", f"{r['entries']:.3g}",
                f"{r['reduce_s']:.1f} s",
            )  # fmt: skip
        difference = abs(bodies[1] / bodies[0] - 1).max() if len(bodies[0]) == len(bodies[1]) else np.inf
        ratio = runs["pardiso"]["reduce_s"] / runs["multifrontal"]["reduce_s"]
        cases[name] = {"dofs": fem.n_dofs, **runs, "reduction": ratio, "frequencies": difference}
    Console(width=110).print(table)
    result = {key: max(case[key] for case in cases.values()) for key in LIMITS}
    print(f"reductions take {result['reduction']:.2f} of the time; frequencies differ by {result['frequencies']:.1e}")
    failed = [key for key, limit in LIMITS.items() if result[key] > limit]
    scenes.finish(__file__, {"limits": LIMITS, **result, "cases": cases}, failed)


if __name__ == "__main__":
    main()
