"""What a design costs beside a choice by hand: `ep.design_impact` at 1 %, and the quickest mesh of no larger error.

A choice by hand is an order and sizes of elements, at the contact and far from it, for each body, and f_cut. It is
given what a design has to find: contact radius, step, far sizes and f_cut, the last two also by a factor. Its time is
that of one mesh, reduction and run; the time of choices that failed does not count.
Reference and scenes: those of `validation.mesh.design`. Quantity: error of the force, no larger than the design's, and
stricter, of the velocities too; seconds off-line and on-line, after a first run that compiles. Nothing else may run on
the machine. The design runs six times, and the quickest counts: that of many near choices is the least disturbed one
too.
Limit: the design takes at most twice the time of the quickest choice of no larger error of the force.

    python -m validation.mesh.by_hand [--only spheres plate rod_on_plate] [--out FILE]
"""

import argparse
import functools
import itertools
import json
import time
import warnings
from pathlib import Path

from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.contact import scenes
from validation.mesh import design as designs

TOLERANCE = 0.01
ORDERS = (2, 2), (2, 3), (3, 3)
NEAR, FAR, CUT = (0.3, 0.45), (0.7, 1, 1.6), (1, 1.4)  # by contact radius; by the design's
TURNS = 6  # of the design
LIMITS = {"ratio": 2.0}


def timed(scene, work):
    """Curves of what `work` makes (FE models, bodies, step), and times off-line and on-line [s]."""
    begin = time.perf_counter()
    fems, bodies, step = work()
    between = time.perf_counter()
    curves, online_s = designs.run(scene, fems, bodies, step)
    return curves, {"offline_s": between - begin, "online_s": online_s}


def choice(scene, look, step, orders, near, far, cut):
    """Mesh both bodies and reduce them, as by hand."""
    models, radius = [], look.circle
    for (shape, material), own, order, reach, line in zip(
        scene.bodies, look.sizes, orders, designs.REACH, (-1, 1), strict=True
    ):
        fine = ep.Refine((0, 0, 0), 1.5 * radius, near * radius * (order - 1))  # as many functions with either order
        fem = ep.fe_model(shape, material, order=order, maxh=far * own.far, refine=[fine], grading=0.4)
        models.append((fem, ep.Partition.ball(fem, (0, 0, 0), reach * radius, direction=(0, 0, line))))
    f_cut = min(cut * look.truncation.f_cut, *(0.99 * fem.resolved_frequency for fem, _ in models))
    return [fem for fem, _ in models], [ep.reduce(*model, f_cut=f_cut) for model in models], step


def whole(found):
    """Time from the shapes to the forces [s]."""
    return found["offline_s"] + found["online_s"]


def measured(name):
    """A design, all choices, and the quickest one that is no worse."""
    scene = designs.SCENES[name]()
    made = []

    def by_design():
        options = {"speed": scene.speed, "duration": scene.duration, "correct": scene.correct}
        made.append(ep.design_impact(*scene.bodies, contact=(0, 0, 0), tolerance=TOLERANCE, **options))
        return made[-1].fems, made[-1].bodies, made[-1].step

    turns = [timed(scene, by_design) for _ in range(TURNS)]
    best = min(range(TURNS), key=lambda turn: whole(turns[turn][1]))
    (curves, times), look, step = turns[best], made[best].look, made[best].step
    by_design = [float(f"{x:.1e}") for x in (look.circle, designs.FINER * look.truncation.f_cut)]
    options, shapes = scene.options or by_design, scene.layered[1] if scene.layered else scene.bodies
    exact, _ = designs.reference(f"{name}_finer", scene, shapes, scene.finer, *options)
    design = {"true": designs.errors(curves, exact), "dofs": sum(look.dofs), **times}
    tried = []
    for orders, *factors in itertools.product(ORDERS, NEAR, FAR, CUT):
        found = {"orders": orders, **dict(zip(("near", "far", "cut"), factors, strict=True))}
        print(f"{name} {found}", flush=True)
        try:
            curves, times = timed(scene, functools.partial(choice, scene, look, step, orders, *factors))
        except ep.errors.PartitionError as error:
            tried.append(found | {"failed": str(error)})
            continue
        tried.append(found | {"true": designs.errors(curves, exact), **times})
    quickest = {}
    for label, names in (("force", ["force"]), ("all", [*design["true"]])):
        no_worse = [x for x in tried if "true" in x and all(x["true"][k] <= design["true"][k] for k in names)]
        quickest[label] = min(no_worse, key=whole, default=None)
    ratios = {label: whole(design) / whole(x) for label, x in quickest.items() if x}
    return {"design": design, "quickest": quickest, "ratios": ratios, "tried": tried}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=designs.SCENES, default=[*designs.SCENES])
    parser.add_argument("--out", type=Path, help="write the JSON result there")
    options = parser.parse_args()
    warnings.simplefilter("ignore", ep.errors.PartitionWarning)
    warm = designs.spheres()
    made = ep.design_impact(*warm.bodies, speed=warm.speed, contact=(0, 0, 0), tolerance=0.05, duration=warm.duration)
    designs.run(warm, made.fems, made.bodies, made.step)
    path = Path(__file__).with_suffix(".json")
    before = json.loads(path.read_text())["scenes"] if path.is_file() else {}
    result, failed = {"limits": LIMITS, "scenes": before}, []
    table = Table("scene", "no larger error of", "choice", "force", "velocities", "off-line", "on-line", "ratio")
    for name in options.only:
        result["scenes"][name] = measured(name)
        (options.out or path).write_text(json.dumps(result))  # kept, whatever becomes of the next scene
    for name, one in result["scenes"].items():
        if (ratio := one["ratios"].get("force", 0.0)) > LIMITS["ratio"]:
            failed.append(f"{name}: {ratio:.1f}")
        for label, x in (("", one["design"]), *one["quickest"].items()):
            if x:
                true = x["true"]
                table.add_row(
                    name, label, str([x.get(k) for k in ("orders", "near", "far", "cut")]) if label else "design",
                    f"{true['force']:.2%}", f"{true['velocity_1']:.2%} {true['velocity_2']:.2%}",
                    f"{x['offline_s']:.1f} s", f"{x['online_s']:.2f} s",
                    f"{one['ratios'][label]:.1f}" if label else "",
                )  # fmt: skip
    Console(width=130).print(table)
    result["found"] = {"ratio": max(x["ratios"].get("force", 0.0) for x in result["scenes"].values())}
    scenes.finish(__file__, result, failed, options.out)


if __name__ == "__main__":
    main()
