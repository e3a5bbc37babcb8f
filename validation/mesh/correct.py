"""Bodies that the next order of elements corrects: true error of an impact with `correct=True` and without.

Reference: reduced bodies of cubic elements on a finer mesh, as in `effectivity`, whose scenes these are.
Quantity: relative L2 difference of the contact force over the impact; time of the reduction, and of estimate and
correction together. The estimate is that of the bodies before.
Limits: in every scene, the error of the first mesh falls by a factor of 2 at least, and no error grows.

    python -m validation.mesh.correct [--only spheres plate ...]
"""

import argparse
import time
import warnings

import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.accuracy.correction import Finer
from validation.contact import scenes
from validation.mesh import effectivity

NAMES = ("spheres", "plate")
MESHES = 2  # of each scene, the first ones
LIMITS = {"least_first": 2.0, "least": 1.0}


def measured(name, scene):
    """Runs of a scene, printed as a table."""
    fine = effectivity.reduced(scene, scene.fine)
    t, exact = effectivity.forces(scene, fine)
    dofs = sum(fem.n_dofs for fem, _ in fine)
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
            float(np.linalg.norm(np.interp(t, *effectivity.forces(scene, each)) - exact) / np.linalg.norm(exact))
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
    parser.add_argument("--only", nargs="+", choices=effectivity.SCENES, default=[*NAMES])
    warnings.simplefilter("ignore", ep.errors.PartitionWarning)  # coarse meshes say so
    found = {name: measured(name, effectivity.SCENES[name]()) for name in parser.parse_args().only}
    factors = {name: [run["factor"] for run in one["runs"]] for name, one in found.items()}
    result = {
        "limits": LIMITS, "scenes": found, "least_first": min(each[0] for each in factors.values()),
        "least": min(min(each) for each in factors.values()),
    }  # fmt: skip
    failed = [name for name, each in factors.items() if each[0] < LIMITS["least_first"] or min(each) < LIMITS["least"]]
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
