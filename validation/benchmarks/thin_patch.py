"""What a surface patch of a thin tube costs off-line, by the truncation frequency: the walls have many modes.

Reference: all modes below 1.5 times the truncation frequency, counted by the signs of the pivots (basis "residual").
Each reduction runs in a process of its own; an old checkout does the same if it is given.
Quantity: processor time, dofs of the body, peak of memory, by frequency; the largest error of a frequency below the
truncation; the error of the mobility of every tenth node in that band, relative to the largest entry (L2 over it).
Limits: at 20 kHz at most twice as long as at 5 kHz, frequencies to 1e-5, mobilities to 1e-2.

    python -m validation.benchmarks.thin_patch [--old /path/to/old] [--quick]
"""

import argparse
import json
import resource
import sys
import time
from pathlib import Path

import numpy as np

LIMITS = {"ratio": 2.0, "frequency": 1e-5, "mobility": 1e-2}
FREQUENCIES = 5e3, 10e3, 20e3
RADIUS, WALL, LENGTH, SIZE = 0.025, 1e-3, 0.06, 5e-3  # [m]


def tube(length):
    """FE model, and the partition of its whole outer face."""
    import netgen.occ as occ

    import exudyn_partition as ep

    solid = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=RADIUS, h=length)
    solid -= occ.Cylinder(occ.Pnt(0, 0, -1), occ.Z, r=RADIUS - WALL, h=2)
    fem = ep.fe_model(solid, ep.STEEL, maxh=SIZE)
    return fem, ep.Partition.surface(fem, cylinder=((0, 0, 0), (0, 0, 1), RADIUS))


def mobility(body, rows, f_cut):
    """Mobility of some rows at 20 frequencies below f_cut, by the shapes and the residual flexibility."""
    at, chosen = rows @ body.basis.shapes, slice(None, None, 10)
    s = 2 * np.pi * f_cut * (0.02 + 1j * np.linspace(0.05, 1.0, 20))
    return np.array(
        [x * ((at / (body.basis.omega**2 + x**2)) @ at.T + body.basis.flexibility[chosen, chosen]) for x in s]
    )


def case(f_cut, length, *, checked):
    """One reduction; with its errors if it is checked."""
    import exudyn_partition as ep
    from exudyn_partition.reduction.loads import patch_rows

    fem, part = tube(length)
    ep.reduce(*tube(length / 4), f_cut=5e3)  # what is compiled at first
    begin = time.process_time()
    body = ep.reduce(fem, part, f_cut=f_cut)
    found = {"f_cut_Hz": f_cut, "fe_dofs": fem.n_dofs, "rows": len(part.patch_nodes), "dofs": body.n_dofs,
             "cpu_s": time.process_time() - begin,
             "memory_GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9}  # fmt: skip
    if checked:
        exact = ep.reduce(fem, part, f_cut=1.5 * f_cut, basis="residual")
        omega = exact.basis.omega[6:]
        omega = omega[omega < 2 * np.pi * f_cut]
        rows = patch_rows(fem, part)[::10]
        ours, theirs = (mobility(one, rows, f_cut) for one in (body, exact))
        errors = np.linalg.norm(ours - theirs, axis=0) / np.linalg.norm(theirs, axis=0).max()
        found |= {"modes": len(omega), "frequency": float(abs(body.basis.omega[6:][: len(omega)] / omega - 1).max()),
                  "mobility": float(errors.max())}  # fmt: skip
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--old", type=Path, help="an old checkout, for 5 and 20 kHz")
    parser.add_argument("--quick", action="store_true", help="a short tube; nothing is stored")
    parser.add_argument("--case", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        f_cut, length, checked = options.case
        print(json.dumps(case(float(f_cut), float(length), checked=checked == "checked")))
        return
    from validation.processes import in_a_process  # an old checkout has no such module

    length = LENGTH / 3 if options.quick else LENGTH
    rows = {"new": [], "old": []}
    for f_cut in FREQUENCIES:
        rows["new"].append(in_a_process(__file__, "--case", f_cut, length, "checked"))
        print("new", rows["new"][-1], flush=True)
        if options.old and f_cut in (5e3, 20e3):
            arguments = "--case", f_cut, length, "plain"
            rows["old"].append(in_a_process(__file__, *arguments, checkout=options.old.resolve()))
            print("old", rows["old"][-1], flush=True)
    found = {
        "ratio": rows["new"][2]["cpu_s"] / rows["new"][0]["cpu_s"],
        **{key: max(row[key] for row in rows["new"]) for key in ("frequency", "mobility")},
    }
    print(found)
    failed = [f"{key} {value:.3g}" for key, value in found.items() if value > LIMITS[key]]
    if options.quick:
        sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)
    from validation.contact import scenes

    scenes.finish(__file__, {"rows": rows, "found": found, "limits": LIMITS}, failed)


if __name__ == "__main__":
    main()
