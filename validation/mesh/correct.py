"""Bodies that the next order of elements corrects: true error of an impact with `correct=True` and without.

Reference: reduced bodies of cubic elements on a finer mesh, as in `effectivity`, whose scenes these are.
Quantity: relative L2 difference of the contact force over the impact; time of the reduction, and of estimate and
correction together. The estimate is that of the bodies before.
Limits: errors fall by a factor of 2 at least where `effectivity` judges the estimate; no error grows.

    python -m validation.mesh.correct [--only spheres plate ...]

With `--only` and no name, the stored runs are judged again.
"""

import argparse
import json
import time
import warnings
from pathlib import Path

from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.accuracy.correction import Finer
from validation.contact import scenes
from validation.mesh import effectivity

NAMES = ("spheres", "plate")
MESHES = 2  # of each scene, the first ones
JUDGED = {2: 0.7, 3: 1.0}  # largest elements at the contact over its radius, by order
LIMITS = {"least_judged": 2.0, "least": 1.0}


def measured(name, scene):
    """Runs of a scene, printed as a table."""
    exact, about = effectivity.reference(name)
    dofs = about["reference_dofs"]
    table = Table("order", "h/a", "unknowns", "estimated", "true", "corrected", "factor", "reduce", "estimate",
                  "correct", title=f"{name}; reference: {dofs} unknowns")  # fmt: skip
    runs = []
    for sizes in scene.meshes[:MESHES]:
        begin = time.process_time()
        pairs = effectivity.reduced(scene, sizes)
        times = [time.process_time() - begin]
        begin = time.process_time()
        estimate = ep.mesh_error(*pairs, speed=scene.speed, duration=scene.end)
        times.append(time.process_time() - begin)
        begin = time.process_time()
        better = [(fem, Finer(fem, body).corrected(0)) for fem, body in pairs]
        times.append(time.process_time() - begin)
        before, after = (
            effectivity.off(*effectivity.forces(scene, [body for _, body in each], scene.end / 500), *exact)
            for each in (pairs, better)
        )
        runs.append({
            "order": sizes[0], "size": sizes[1:], "dofs": sum(fem.n_dofs for fem, _ in pairs),
            "estimated": estimate.force, "rows": estimate.rows, "true": before, "corrected": after,
            "factor": before / after,
            **dict(zip(("reduce_cpu_s", "estimate_cpu_s", "correct_cpu_s"), times, strict=True)),
        })  # fmt: skip
        table.add_row(
            str(sizes[0]), " ".join(f"{s:g}" for s in sizes[1:]), str(runs[-1]["dofs"]), f"{estimate.force:.2%}",
            f"{before:.2%}", f"{after:.2%}", f"{before / after:.2f}", *(f"{s:.1f} s" for s in times),
        )  # fmt: skip
    Console(width=120).print(table)
    return {"reference_dofs": dofs, "runs": runs}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", nargs="*", default=[*NAMES], help=", ".join(effectivity.SCENES))
    warnings.simplefilter("ignore", ep.errors.PartitionWarning)  # coarse meshes say so
    only = parser.parse_args().only
    path = Path(__file__).with_suffix(".json")
    before = json.loads(path.read_text())["scenes"] if path.is_file() and len(only) < len(NAMES) else {}
    found = before | {name: measured(name, effectivity.SCENES[name]()) for name in only}
    factors = [
        (name, run["size"][0] <= JUDGED[run["order"]], run["factor"])
        for name, one in found.items()
        for run in one["runs"]
    ]
    result = {
        "limits": LIMITS, "scenes": found, "least_judged": min(factor for _, judged, factor in factors if judged),
        "least": min(factor for *_, factor in factors),
    }  # fmt: skip
    failed = [
        f"{name} {factor:.2f}"
        for name, judged, factor in factors
        if factor < LIMITS["least_judged" if judged else "least"]
    ]
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
