"""What a design costs beside a choice by hand: `ep.design_impact`, and the cheapest mesh of no larger error.

A choice by hand is an order and sizes of elements, at the contact and far from it, for each body. It is given what a
design has to find: size and shape of the contact, far sizes, also larger ones, f_cut and step. Its time is that of one
mesh, reduction and run; the time of choices that failed does not count. Choices that are finer in all sizes than one
of no larger error, or than one that costs more than the design, are left out.
Scenes: those of `validation.mesh.design`; crossed cylinders, whose contact is 2.5 times as long as wide; a ball in a
seat of nearly its radius, at 0.5 %; a ball on a beam; a ball on a tube; a barrel on a block, a contact of 4.5 : 1; a
ball on the end of a tube; a ball on a stepped shaft, at 0.5 %; a blunt cone on a block, at 2 %.
Reference: cubic elements on finer meshes. Quantity: error of the force, no larger than the design's; dofs; seconds of
the clock, and of the processor, which other programs change less, off-line and on-line, after a first run that
compiles.
Limits: the design takes at most twice the dofs, and twice the processor time, of the cheapest choice of no larger error
of the force; the true error is below the tolerance, and at most 1.25 times the estimated one.

    python -m validation.mesh.by_hand [--only NAME ...] [--before] [--out FILE]

With `--before` only designs are measured and kept as those of an earlier version, which the search path then names.
"""

import argparse
import functools
import itertools
import json
import time
import warnings
from dataclasses import replace
from pathlib import Path

import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.contact import scenes
from validation.mesh import design as designs

TOLERANCE = 0.01
ORDERS = (3, 3), (2, 2)
NEAR, FAR = (0.6, 0.5, 0.4, 0.3), (1.6, 1.0)  # by the contact's radius across; by the design's
LIMITS = {"ratio": 2.0, "dofs": 2.0, "share": 1.0, "true_by_estimated": 1.25}


def cylinders():
    """Crossed steel cylinders of 4 and 16 mm radius."""
    shapes = (
        occ.Cylinder(occ.Pnt(-6e-3, 0, 4e-3), occ.X, r=4e-3, h=12e-3),
        occ.Cylinder(occ.Pnt(0, -8e-3, -16e-3), occ.Y, r=16e-3, h=16e-3),
    )
    ends = ((0, 0, 8e-3), (0, 0, -32e-3))
    fine = ((2.5e-3, 0.5), (5e-3, 0.5))
    return designs.Scene(steel(*shapes), ends, 0.15, 60e-6, 0.1e-6, fine, fine, ellipse=(2.5, (1, 0, 0)))


def seat():
    """A steel ball of 20 mm in a seat of 10.4 mm radius."""
    ball, hollow = (occ.Sphere(occ.Pnt(0, 0, radius), radius) for radius in (10e-3, 10.4e-3))
    block = occ.Cylinder(occ.Pnt(0, 0, -12e-3), occ.Z, r=15e-3, h=14e-3) - hollow
    ends = ((0, 0, 20e-3), (0, 0, -12e-3))
    fine = ((5e-3, 0.35), (5e-3, 0.35))
    return designs.Scene(steel(ball, block), ends, 0.3, 120e-6, 0.1e-6, fine, fine)


def beam():
    """A steel ball of 20 mm on the middle of a free steel beam of 200 x 15 x 10 mm."""
    ball = occ.Sphere(occ.Pnt(0, 0, 10e-3), 10e-3)
    bar = occ.Box(occ.Pnt(-100e-3, -7.5e-3, -10e-3), occ.Pnt(100e-3, 7.5e-3, 0))
    ends = ((0, 0, 20e-3), (0, 0, -10e-3))
    fine = ((5e-3, 0.4), (6e-3, 0.4))
    return designs.Scene(steel(ball, bar), ends, 0.5, 400e-6, 0.2e-6, fine, fine)


def tube():
    """A steel ball of 16 mm on an aluminium tube of 40 mm, with a wall of 3 mm."""
    ball = occ.Sphere(occ.Pnt(0, 0, 8e-3), 8e-3)
    outer, inner = (occ.Cylinder(occ.Pnt(0, -30e-3, -20e-3), occ.Y, r=r, h=60e-3) for r in (20e-3, 17e-3))
    ends = ((0, 0, 16e-3), (0, 0, -3e-3))
    fine = ((4e-3, 0.4), (5e-3, 0.4))
    bodies = (ball, ep.STEEL), (outer - inner, ep.ALUMINIUM)
    return designs.Scene(bodies, ends, 0.5, 200e-6, 0.2e-6, fine, fine, ellipse=(1.3, (0, 1, 0)))


def barrel():
    """A steel barrel of 6 mm radius and 60 mm crown on a steel block."""
    radius, crown, half = 6e-3, 60e-3, 10e-3
    drop = crown - np.sqrt(crown**2 - half**2)
    corners = [occ.Pnt(0, y, z) for y, z in ((-half, radius), (-half, drop), (0, 0), (half, drop), (half, radius))]
    sides = occ.Segment(*corners[:2]), occ.ArcOfCircle(*corners[1:4]), occ.Segment(*corners[3:])
    face = occ.Face(occ.Wire([*sides, occ.Segment(corners[4], corners[0])]))
    body = face.Revolve(occ.Axis(occ.Pnt(0, 0, radius), occ.Y), 360)
    block = occ.Box(occ.Pnt(-12e-3, -15e-3, -10e-3), occ.Pnt(12e-3, 15e-3, 0))
    ends = ((0, 0, 2 * radius), (0, 0, -10e-3))
    fine = ((4e-3, 0.65), (6e-3, 0.65))
    return designs.Scene(steel(body, block), ends, 0.3, 100e-6, 0.1e-6, fine, fine, ellipse=(4.47, (0, 1, 0)))


def tube_end():
    """A steel ball of 12 mm on the end of a steel tube of 22 mm, in the middle of its wall of 4 mm."""
    ball = occ.Sphere(occ.Pnt(0, 0, 6e-3), 6e-3)
    outer, inner = (occ.Cylinder(occ.Pnt(-9e-3, 0, -40e-3), occ.Z, r=r, h=40e-3) for r in (11e-3, 7e-3))
    ends = ((0, 0, 12e-3), (-18e-3, 0, -40e-3))
    fine = ((3e-3, 0.4), (2.5e-3, 0.4))
    return designs.Scene(steel(ball, outer - inner), ends, 0.4, 120e-6, 0.1e-6, fine, fine)


def shaft():
    """A steel ball of 16 mm on the thin side of a steel shaft of 12 and 15 mm, 4 mm from the step."""
    ball = occ.Sphere(occ.Pnt(0, 0, 8e-3), 8e-3)
    thin = occ.Cylinder(occ.Pnt(-30e-3, 0, -6e-3), occ.X, r=6e-3, h=36e-3)
    thick = occ.Cylinder(occ.Pnt(4e-3, 0, -6e-3), occ.X, r=7.5e-3, h=30e-3)
    ends = ((0, 0, 16e-3), (0, 0, -12e-3))
    fine = ((4e-3, 0.4), (3.5e-3, 0.4))
    return designs.Scene(steel(ball, thin + thick), ends, 0.4, 150e-6, 0.1e-6, fine, fine)


def cone():
    """A steel cone of 30 degrees to its axis, with a blunt end of 3 mm radius, on an aluminium block."""
    radius, height, slope = 3e-3, 20e-3, np.radians(30)
    angles = np.array([0, 0.5, 1]) * (np.pi / 2 - slope)  # of the blunt end
    x, z = radius * np.sin(angles), radius * (1 - np.cos(angles))
    x, z = np.r_[x, x[-1] + (height - z[-1]) * np.tan(slope), 0], np.r_[z, height, height]
    tip, middle, edge, rim, back = (occ.Pnt(*place) for place in np.column_stack([x, 0 * x, z]).tolist())
    sides = [occ.ArcOfCircle(tip, middle, edge), *map(occ.Segment, (edge, rim, back), (rim, back, tip))]
    body = occ.Face(occ.Wire(sides)).Revolve(occ.Axis(tip, occ.Z), 360)
    block = occ.Box(occ.Pnt(-15e-3, -15e-3, -15e-3), occ.Pnt(15e-3, 15e-3, 0))
    ends = ((0, 0, height), (0, 0, -15e-3))
    fine = ((3e-3, 0.4), (5e-3, 0.4))
    bodies = (body, ep.STEEL), (block, ep.ALUMINIUM)
    return designs.Scene(bodies, ends, 0.2, 150e-6, 0.1e-6, fine, fine)


def steel(*shapes):
    """Bodies of steel."""
    return tuple((shape, ep.STEEL) for shape in shapes)


SCENES = designs.SCENES | {f.__name__: f for f in (cylinders, seat, beam, tube, barrel, tube_end, shaft, cone)}
TOLERANCES = {"seat": 0.005, "shaft": 0.005, "cone": 0.02}


def timed(scene, work):
    """Curves of what `work` makes (FE models, bodies, step); its dofs, and times off-line and on-line [s]."""
    begin, cpu = time.perf_counter(), time.process_time()
    fems, bodies, step = work()
    found = {"dofs": sum(fem.n_dofs for fem in fems)}
    found |= {"offline_s": time.perf_counter() - begin, "offline_cpu_s": time.process_time() - cpu}
    begin, cpu = time.perf_counter(), time.process_time()
    curves, _ = designs.run(scene, fems, bodies, step)
    return curves, found | {"online_s": time.perf_counter() - begin, "online_cpu_s": time.process_time() - cpu}


def choice(scene, look, step, orders, near, far):
    """Mesh both bodies and reduce them, as by hand."""
    models, (short, long) = [], designs.stretched(scene, look.circle)
    for (shape, material), own, order, reach, line in zip(
        scene.bodies, look.sizes, orders, designs.REACH, (-1, 1), strict=True
    ):
        # As many functions with either order.
        fine = ep.Refine((0, 0, 0), 1.5 * short, near * short * (order - 1), **long(1.5))
        fem = ep.fe_model(shape, material, order=order, maxh=far * own.far, refine=[fine], grading=0.5)
        models.append((fem, ep.Partition.ball(fem, (0, 0, 0), reach * short, direction=(0, 0, line), **long(reach))))
    f_cut = min(look.truncation.f_cut, *(0.99 * fem.resolved_frequency for fem, _ in models))
    return [fem for fem, _ in models], [ep.reduce(*model, f_cut=f_cut) for model in models], step


def whole(found):
    """Processor time from the shapes to the forces [s]."""
    return found["offline_cpu_s"] + found["online_cpu_s"]


def clock(found):
    """The same by the clock [s]: a design does some of its work on a second core."""
    return found["offline_s"] + found["online_s"]


def designed(name):
    """A scene, its design, its curves, and what it took."""
    scene, made = SCENES[name](), []

    def by_design():
        options = {"speed": scene.speed, "duration": scene.duration, "correct": scene.correct}
        tolerance = TOLERANCES.get(name, TOLERANCE)
        made.append(ep.design_impact(*scene.bodies, contact=(0, 0, 0), tolerance=tolerance, **options))
        return made[0].fems, made[0].bodies, made[0].step

    curves, found = timed(scene, by_design)
    (design,) = made
    told = {"tolerance": design.tolerance, "estimated": design.look.force, "promised": not design.limit}
    return scene, design, curves, told | {"looks": len(design.looks), **found}


def measured(name):
    """A design, all choices, and the cheapest ones that are no worse."""
    scene, design, curves, told = designed(name)
    look, step = design.look, design.step
    scene = replace(scene, ellipse=(np.divide(*design.place.semi_axes(1.0)), scene.ellipse[1]))
    by_design = designs.reference_options(look)
    options, shapes = scene.options or by_design, scene.layered[1] if scene.layered else scene.bodies
    exact, dofs = designs.reference(f"{name}_finer", scene, shapes, scene.finer, *options)
    told |= {"true": designs.errors(curves, exact), "reference_dofs": dofs}
    tried = []
    for near, far, orders in itertools.product(NEAR, FAR, ORDERS):
        found = {"orders": orders, "near": near, "far": far}
        enough = [x for x in tried if "true" in x and (is_no_worse(x, told) or costs_more(x, told))]
        if any(x["orders"] == orders and x["near"] >= near and x["far"] >= far for x in enough):
            continue
        print(f"{name} {found}", flush=True)
        try:
            curves, times = timed(scene, functools.partial(choice, scene, look, step, orders, near, far))
        except ep.errors.PartitionError as error:
            tried.append(found | {"failed": str(error)})
            continue
        tried.append(found | {"true": designs.errors(curves, exact), **times})
    good = [x for x in tried if "true" in x and is_no_worse(x, told)]
    cheapest = {"time": min(good, key=whole, default=None), "dofs": min(good, key=lambda x: x["dofs"], default=None)}
    ratios = {}
    if good:
        ratios = {
            "time": clock(told) / clock(cheapest["time"]),
            "processor": whole(told) / whole(cheapest["time"]),
            "dofs": told["dofs"] / cheapest["dofs"]["dofs"],
        }
    return {"design": told, "cheapest": cheapest, "ratios": ratios, "tried": tried}


def is_no_worse(found, design):
    """Whether the error of a choice's force is no larger than the design's."""
    return found["true"]["force"] <= design["true"]["force"]


def costs_more(found, design):
    """Whether a choice costs more than the design, in dofs and in time."""
    return found["dofs"] > design["dofs"] and whole(found) > whole(design)


def shown(result):
    """Print all scenes; return what misses a limit."""
    table = Table("scene", "before", "design", "estimated", "true", "velocities", "off-line", "on-line", "by hand",
                  "its error", "dofs by those", "time by its, clock")  # fmt: skip
    failed, worst = [], {"ratio": 0.0, "dofs": 0.0, "share": 0.0, "true_by_estimated": 0.0}
    for name, one in result["scenes"].items():
        own, ratios, before = one["design"], one["ratios"], one.get("before")
        true = own["true"]
        found = {
            "ratio": ratios.get("processor", 0.0),
            "dofs": ratios.get("dofs", 0.0),
            "share": true["force"] / own["tolerance"] if own["promised"] else 0.0,
            "true_by_estimated": true["force"] / own["estimated"],
        }
        failed += [f"{name}: {key} {x:.2f}" for key, x in found.items() if x > LIMITS[key]]
        worst = {key: max(worst[key], x) for key, x in found.items()}
        by_hand = one["cheapest"]["time"]
        table.add_row(
            name, f"{before['dofs']}, {before['offline_cpu_s']:.0f} s" if before else "",
            f"{own['dofs']}", f"{own['estimated']:.2%}", f"{true['force']:.2%}",
            f"{true['velocity_1']:.2%} {true['velocity_2']:.2%}", f"{own['offline_cpu_s']:.1f} s",
            f"{own['online_cpu_s']:.1f} s",
            f"{by_hand['dofs']} {by_hand['orders']}, {whole(by_hand):.1f} s" if by_hand else "none is cheaper",
            f"{by_hand['true']['force']:.2%}" if by_hand else "",
            f"{found['dofs']:.2f}", f"{found['ratio']:.2f} {ratios.get('time', 0.0):.2f}",
        )  # fmt: skip
    Console(width=150).print(table)
    result["found"] = worst
    return failed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=SCENES, default=[*SCENES])
    parser.add_argument("--before", action="store_true", help="keep the designs as those of an earlier version")
    parser.add_argument("--out", type=Path, help="write the JSON result there")
    options = parser.parse_args()
    warnings.simplefilter("ignore", ep.errors.PartitionWarning)
    warm, made = designs.warmed_up()
    timed(warm, functools.partial(choice, warm, made.look, made.step, (2, 3), max(NEAR), max(FAR)))
    path = options.out or Path(__file__).with_suffix(".json")
    known = json.loads(path.read_text())["scenes"] if path.is_file() else {}
    result = {"limits": LIMITS, "scenes": known}
    for name in options.only:
        now = {"before": designed(name)[-1]} if options.before else measured(name)
        result["scenes"][name] = known.get(name, {}) | now
        path.write_text(json.dumps(result, default=float))  # kept, whatever becomes of the next scene
    if not options.before:
        scenes.finish(__file__, result, shown(result), options.out)


if __name__ == "__main__":
    main()
