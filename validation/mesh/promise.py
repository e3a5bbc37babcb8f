"""A tolerance as a promise: total error of reduced pairs on given meshes, estimated and true, in nine scenes.

Bodies are reduced to a tolerance (`ep.reduce_pair`), with the error of their meshes beside it (`ep.with_mesh_error`),
and run at the default step.
Reference: that of `effectivity`, of finer cubic elements. Its difference from a coarser one is told.
Quantity: relative L2 error of the contact force over the impact. The estimates of truncation, step and meshes are sums.
Limits: the true error is below the tolerance, or a ToleranceWarning has named what limits it. In each scene 5 % and 1 %
are promised by some mesh without a warning.

    python -m validation.mesh.promise [--only spheres plate ...] [--quick] [--out FILE]
"""

import argparse
import json
import time
import warnings
from pathlib import Path

from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.contact import scenes
from validation.mesh import effectivity

# Meshes as in `effectivity`, with the tolerances that are asked for on them.
STOCKY = (((2, 0.6, 1.0), (0.05, 0.01)), ((3, 0.65, 1.0), (0.01, 0.005)))
LEANING = (STOCKY[0], ((3, 0.65, 0.7), (0.01, 0.005)))  # cubic elements of 3 mm would be inverted in its rod
THIN = (((2, 0.55, 0.4), (0.05, 0.01)), ((3, 0.6, 0.5), (0.01, 0.005)))
TOLERANCES = (0.05, 0.01, 0.005)
LIMITS = {"failed": 0, "largest_share": 1.0}  # of the tolerances, by the true errors where nothing warned


def promised(scene, models, tolerance, exact):
    """Pair of one tolerance: estimates, warning, true error and times."""
    begin = time.process_time()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        bodies = ep.reduce_pair(*models, tolerance=tolerance, speed=scene.speed, duration=scene.end)
        reduce_s, begin = time.process_time() - begin, time.process_time()
        bodies = ep.with_mesh_error(*((fem, body) for (fem, _), body in zip(models, bodies, strict=True)))
    estimate_s, estimate = time.process_time() - begin, bodies[0].estimate
    true = effectivity.off(*effectivity.forces(scene, bodies), *exact)
    return {
        "tolerance": tolerance, "warned": any(s.category is ep.errors.ToleranceWarning for s in said),
        "limit": estimate.limit, "reduced": [body.n_dofs for body in bodies],
        "estimated": {"mesh": estimate.mesh_force, "truncation_and_step": estimate.force, "step": estimate.step,
                      "force": estimate.mesh_force + estimate.force, "total": estimate.total},
        "true": true, "reduce_cpu_s": reduce_s, "estimate_cpu_s": estimate_s,
    }  # fmt: skip


def measured(name, meshes):
    """Runs of a scene, printed as a table."""
    exact, about = effectivity.reference(name)
    scene, runs = effectivity.SCENES[name](), []
    table = Table("order", "h/a", "unknowns", "reduced", "tolerance", "estimated", "true", "total", "limit",
                  title=f"{name}; references differ by {about['references_differ']:.2%}")  # fmt: skip
    for sizes, tolerances in meshes:
        models = scene.models(*sizes)
        dofs = sum(fem.n_dofs for fem, _ in models)
        for tolerance in tolerances:
            run = promised(scene, models, tolerance, exact)
            runs.append({"order": sizes[0], "size": sizes[1:], "dofs": dofs, **run})
            found = run["estimated"]
            table.add_row(
                str(sizes[0]), " ".join(f"{s:g}" for s in sizes[1:]), str(dofs), "+".join(map(str, run["reduced"])),
                f"{tolerance:.1%}" + " warns" * run["warned"], f"{found['force']:.2%}", f"{run['true']:.2%}",
                f"{found['total']:.2%}", run["limit"][:40],
            )  # fmt: skip
    Console(width=140).print(table)
    return {**about, "runs": runs}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", nargs="*", choices=effectivity.SCENES, default=[*effectivity.SCENES])
    parser.add_argument("--quick", action="store_true", help="two spheres on the coarsest mesh alone")
    parser.add_argument("--out", type=Path, help="write the JSON result there")
    options = parser.parse_args()
    path, quick = Path(__file__).with_suffix(".json"), options.quick
    names = ["spheres"] if quick else options.only
    whole = quick or len(names) == len(effectivity.SCENES)
    found = json.loads(path.read_text())["scenes"] if path.is_file() and not whole else {}
    for name in names:
        thin = effectivity.SCENES[name]().meshes is effectivity.THIN
        meshes = THIN if thin else LEANING if name == "tilted" else STOCKY
        found[name] = measured(name, meshes[: 1 if quick else None])
    found = {name: found[name] for name in effectivity.SCENES if name in found}
    runs = [
        (f"{name} {r['order']}, {r['size']}, {r['tolerance']}", r) for name, one in found.items() for r in one["runs"]
    ]
    shares = {name: run["true"] / run["tolerance"] for name, run in runs if not run["warned"]}
    failed = [name for name, share in shares.items() if share > LIMITS["largest_share"]]
    result = {
        "limits": LIMITS, "scenes": found, "failed": len(failed), "largest_share": max(shares.values()),
        "promised": {
            f"{tolerance:g}": [
                name for name, one in found.items()
                if any(r["tolerance"] == tolerance and not r["warned"] for r in one["runs"])
            ]
            for tolerance in TOLERANCES
        },
    }  # fmt: skip
    failed += [f"{name}: {t:g} is promised by no mesh" for t in TOLERANCES[: 1 if quick else 2] for name in found
               if name not in result["promised"][f"{t:g}"]]  # fmt: skip
    scenes.finish(__file__, result, failed, options.out)


if __name__ == "__main__":
    main()
