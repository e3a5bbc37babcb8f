"""From CAD to a promise: estimated and true total error of `ep.design_impact`, and its time beside the full FE model's.

Reference: reduced bodies of cubic elements on finer meshes, kept in out/. A second one, with smaller elements and more
layers, tells how far the first is from the truth.
Quantity: relative L2 error of the contact force, and of the velocity at the far end of each body over its change, over
the impact; seconds from the shapes to the forces, and of the full FE model (HHT, one factorisation) on the same meshes,
which has the same error, in the same run; of the clock, and of the processor, which other programs change less, after a
first design that compiles.
Limits: the true error of the force is below the tolerance, or a warning has named what limits it.

    python -m validation.mesh.design [--quick] [--only spheres plate rod_on_plate] [--out FILE]
"""

import argparse
import itertools
import json
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.contact import scenes

FINER = 3  # frequencies of the reference, by those of the design
SAMPLES = 5000  # steps of the reference, at least
REACH = (1.8, 2.3)  # radii of the reference's patches by that of the contact


@dataclass(frozen=True)
class Scene:
    """Two bodies that touch at the origin; sizes of the reference's elements, and of those of the second one.

    Parameters
    ----------
    bodies : ((shape, Material), (shape, Material))
    ends : two points
        Where velocities are compared [m].
    speed, duration, step : float
        [m/s], [s]; of the full FE model [s].
    fine, finer : ((far, near), (far, near))
        Element sizes of each body, far [m] and at the contact over its radius.
    layered : (bodies, bodies), optional
        Of both references, where shapes make layers of elements; default: `bodies`.
    options : (float, float), optional
        Radius of the contact [m] and f_cut [Hz] of both references; default: by the finest design.
    correct : bool
        Whether the design corrects the bodies.
    ellipse : (float, (3,) array)
        Ratio of the contact's semi-axes, and the direction of the longer one; 1 for a circle.
    share : float
        Of the duration, over which the full FE model runs where all of it takes too long; its steps' time is scaled.
    """

    bodies: tuple
    ends: tuple
    speed: float
    duration: float
    step: float
    fine: tuple
    finer: tuple
    layered: tuple = ()
    options: tuple = ()
    correct: bool = False
    ellipse: tuple = (1.0, (1, 0, 0))
    share: float = 1.0


def stretched(scene, radius):
    """Radius of a contact across, and options of a region that is as long as the contact, by its mean radius."""
    ratio, along = scene.ellipse
    short, long = radius / ratio**0.5, radius * ratio**0.5
    return short, lambda factor: {"long_axis": factor * long * np.array(along)} if ratio > 1 else {}


def spheres():
    """Two steel balls of 20 mm."""
    radius = 10e-3
    bodies = [(occ.Sphere(occ.Pnt(0, 0, z), radius), scenes.STEEL) for z in (radius, -radius)]
    ends = ((0, 0, 2 * radius), (0, 0, -2 * radius))
    return Scene(bodies, ends, 0.5, 100e-6, 0.2e-6, ((5e-3, 0.6),) * 2, ((4e-3, 0.4),) * 2)


def plate():
    """A steel rod of 60 mm with a tip radius of 8 mm on a free aluminium plate of 120 x 80 x 8 mm."""
    radius, tip, length = 5e-3, 8e-3, 60e-3
    rod = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=radius, h=length) * (
        occ.Sphere(occ.Pnt(0, 0, tip), tip) + occ.Cylinder(occ.Pnt(0, 0, tip), occ.Z, r=tip, h=length)
    )
    sheet = occ.Box(occ.Pnt(-60e-3, -40e-3, -8e-3), occ.Pnt(60e-3, 40e-3, 0))
    bodies = (rod, ep.STEEL), (sheet, ep.ALUMINIUM)
    ends = ((0, 0, length), (0, 0, -8e-3))
    return Scene(bodies, ends, 0.5, 300e-6, 0.5e-6, ((3.5e-3, 0.6), (7e-3, 0.6)), ((3e-3, 0.45), (4e-3, 0.45)))


def rod_on_plate():
    """The paper's rod of 800 mm on a plate of 250 x 250 x 5 mm."""
    radius, length, side, thickness = 10e-3, 0.8, 0.25, 5e-3
    centre = occ.Pnt(0, 0, radius)
    rod = occ.Cylinder(centre, occ.Z, r=radius, h=length - radius) + occ.Sphere(centre, radius)

    def sheet(top, bottom):
        solid = occ.Box(occ.Pnt(-side / 2, -side / 2, bottom), occ.Pnt(side / 2, side / 2, top))
        return solid.mat("plate")

    bodies = (rod, ep.STEEL), (sheet(0, -thickness), ep.ALUMINIUM)

    def layers(n):
        heights = -thickness * np.linspace(0, 1, n + 1)
        return occ.Glue([sheet(*ends) for ends in itertools.pairwise(map(float, heights))])

    layered = [((rod, ep.STEEL), (layers(n), {"plate": ep.ALUMINIUM})) for n in (2, 3)]
    ends = ((0, 0, length), (0, 0, -thickness))
    sizes = ((10e-3, 0.5), (7e-3, 0.6)), ((10e-3, 0.5), (8e-3, 0.7))
    return Scene(bodies, ends, 0.596, 1.5e-3, 0.5e-6, *sizes, layered, (4.5e-4, 100e3), correct=True, share=0.05)


SCENES = {"spheres": spheres, "plate": plate, "rod_on_plate": rod_on_plate}
TOLERANCES = (0.05, 0.01)
LIMITS = {"failed": 0, "largest_share": 1.0}  # of the tolerances, by the true error of the force


def run(scene, fems, bodies, step):
    """Times, forces and velocities at the far ends of a run in Exudyn, and its time [s]."""
    mbs = exu.SystemContainer().AddSystem()
    striker = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -scene.speed])
    struck = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, struck, passes="given")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=scene.duration, step=step)
    if result.t[-1] < scene.duration - step:  # errors would be those of its beginning
        raise RuntimeError(f"the run of {scene.duration:.3g} s stopped at {result.t[-1]:.3g} s")
    of_ends = zip((striker, struck), scene.ends, fems, strict=True)
    ends = [item.velocity(result, end, fem=fem)[:, 2] for item, end, fem in of_ends]
    return (result.t, contact.force(result), *ends), result.time_s


def warmed_up():
    """A scene and its design, after a run of it: what is timed later finds all loops compiled."""
    scene = spheres()
    options = {"contact": (0, 0, 0), "tolerance": max(TOLERANCES), "duration": scene.duration}
    design = ep.design_impact(*scene.bodies, speed=scene.speed, **options)
    run(scene, design.fems, design.bodies, design.step)
    return scene, design


def reference_options(look):
    """Radius of the contact [m] and f_cut [Hz] of a reference, by a design; f_cut is that of its richest bodies."""
    f_cut = max(FINER * look.truncation.f_cut, look.truncation.f_top)
    # Two digits, so that a small change of the design leaves the reference as it is.
    return [float(f"{x:.1e}") for x in (look.circle, f_cut)]


def reference(name, scene, shapes, sizes, radius, f_cut):
    """A run of finer meshes, from out/ if it is there."""
    path = scenes.ROOT / "out" / f"mesh_design_{name}.npz"
    key = json.dumps([scene.ends, sizes, scene.speed, scene.duration, radius, f_cut])
    if path.is_file() and str((kept := np.load(path))["key"]) == key:
        return kept["curves"], int(kept["dofs"])
    models, (short, long) = [], stretched(scene, radius)
    for (shape, material), (far, near), reach, line in zip(shapes, sizes, REACH, (-1, 1), strict=True):
        fine = ep.Refine((0, 0, 0), 1.5 * short, near * short, **long(1.5))
        fem = ep.fe_model(shape, material, order=3, maxh=far, refine=[fine], grading=0.5)
        models.append((fem, ep.Partition.ball(fem, (0, 0, 0), reach * short, direction=(0, 0, line), **long(reach))))
    f_cut = min(f_cut, *(0.99 * fem.resolved_frequency for fem, _ in models))
    bodies = [ep.reduce(*model, f_cut=f_cut) for model in models]
    curves, _ = run(scene, [fem for fem, _ in models], bodies, min(scene.duration / SAMPLES, scene.step))
    path.parent.mkdir(exist_ok=True)
    dofs = sum(fem.n_dofs for fem, _ in models)
    np.savez(path, key=key, curves=np.array(curves), dofs=dofs)
    return np.array(curves), dofs


def errors(curves, exact):
    """Relative L2 errors of the force, and of the velocities over their changes."""
    t, names = exact[0], ("force", "velocity_1", "velocity_2")
    found = {}
    for name, one, other in zip(names, curves[1:], exact[1:], strict=True):
        scale = np.linalg.norm(other - other[0])
        found[name] = float(np.linalg.norm(np.interp(t, curves[0], one) - other) / scale)
    return found


def full_model(scene, design):
    """Errors are of these curves; and the time of the full FE model on the design's meshes [s]."""
    velocities = ((0, 0, -scene.speed), (0, 0, 0))
    bodies = [
        ep.reference.FullBody(*model, velocity=velocity)
        for model, velocity in zip(zip(design.fems, design.partitions, strict=True), velocities, strict=True)
    ]
    points = {str(i): (i, end) for i, end in enumerate(scene.ends)}
    begin = time.process_time()
    history = ep.reference.simulate(bodies, end_time=scene.share * scene.duration, step=scene.step, points=points)
    cpu = time.process_time() - begin
    ends = [history.velocity[name][:, 2] for name in points]
    run_s, setup_s = history.info["time_s"], history.info["setup_s"]
    whole_s = run_s / scene.share + setup_s
    times = {"time_s": whole_s, "cpu_s": cpu * whole_s / (run_s + setup_s), "share_run": scene.share}
    return (history.t, history.force, *ends), times


def measured(name, scene, tolerances, *, full):
    """Designs of a scene beside the reference, and the curves for a figure."""
    designs = {}
    for tolerance in tolerances:
        begin, cpu = time.perf_counter(), time.process_time()
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            design = ep.design_impact(
                *scene.bodies, speed=scene.speed, contact=(0, 0, 0), tolerance=tolerance, duration=scene.duration,
                correct=scene.correct,
            )  # fmt: skip
        times = {"offline_s": time.perf_counter() - begin, "offline_cpu_s": time.process_time() - cpu}
        cpu = time.process_time()
        curves, times["online_s"] = run(scene, design.fems, design.bodies, design.step)
        times["online_cpu_s"] = time.process_time() - cpu
        designs[tolerance] = design, curves, times, any(s.category is ep.errors.ToleranceWarning for s in said)
    finest = designs[min(tolerances)][0]
    options, (one, other) = scene.options or reference_options(finest.look), scene.layered or [scene.bodies] * 2
    exact, dofs = reference(name if full else f"{name}_quick", scene, one, scene.fine, *options)
    result = {"reference_dofs": dofs, "duration_s": scene.duration, "runs": []}
    if full:
        finer, dofs = reference(f"{name}_finer", scene, other, scene.finer, *options)
        result |= {"finer_dofs": dofs, "reference": errors(exact, finer)}
        exact = finer
    for tolerance, (design, curves, times, warned) in designs.items():
        look = design.look
        found = {
            "tolerance": tolerance, "warned": warned, "dofs": look.dofs, "orders": [s.order for s in look.sizes],
            "far_m": [s.far for s in look.sizes], "near_m": [s.near for s in look.sizes], "looks": len(design.looks),
            "reduced": [body.n_dofs for body in design.bodies], "step_s": design.step,
            "estimated": {"mesh": look.mesh.force, "truncation_and_step": look.truncation.force, "force": look.force,
                          "error": design.error}, "true": errors(curves, exact), **times,
        }  # fmt: skip
        if full:
            of_full, fe = full_model(scene, design)
            found["full_fe"] = fe | ({"true": errors(of_full, exact)} if scene.share == 1 else {})
            found["times_faster_cpu"] = fe["cpu_s"] / (times["offline_cpu_s"] + times["online_cpu_s"])
            found["times_faster"] = fe["time_s"] / (times["offline_s"] + times["online_s"])
            found["times_faster_online"] = fe["time_s"] / times["online_s"]
        result["runs"].append(found)
        print(design, "\n")
    return result, {tolerance: curves for tolerance, (_, curves, *_) in designs.items()}, exact


def shown(name, result):
    """Print a scene's runs."""
    table = Table("tolerance", "unknowns", "reduced", "estimated", "true", "velocities", "off-line", "on-line",
                  "full FE", title=f"{name}; reference: {result['reference_dofs']} unknowns")  # fmt: skip
    for one in result["runs"]:
        true, full = one["true"], one.get("full_fe")
        of_full = [f"{full['time_s']:.0f} s"] if full else []
        of_full += [f"{full['true']['force']:.2%}"] if full and "true" in full else []
        table.add_row(
            f"{one['tolerance']:.1%}" + " warns" * one["warned"], "+".join(map(str, one["dofs"])),
            "+".join(map(str, one["reduced"])), f"{one['estimated']['force']:.2%}", f"{true['force']:.2%}",
            f"{true['velocity_1']:.2%} {true['velocity_2']:.2%}", f"{one['offline_s']:.1f} s",
            f"{one['online_s']:.2f} s", ", ".join(of_full),
        )  # fmt: skip
    Console(width=130).print(table)


def draw(found):
    """Forces of designs and reference, one scene beside the other."""
    path, (figure, axes) = scenes.figure(__file__, ncols=len(found), figsize=(5 * len(found), 3.6), squeeze=False)
    for (name, (_, curves, exact)), axis in zip(found.items(), axes[0], strict=True):
        axis.plot(1e6 * exact[0], exact[1], "k", lw=2.5, alpha=0.3, label="reference")
        for tolerance, of_run in curves.items():
            axis.plot(1e6 * of_run[0], of_run[1], lw=0.9, label=f"tolerance {tolerance:.0%}")
        axis.set(xlabel="time [µs]", ylabel="force [N]", title=name.replace("_", " "))
        axis.legend()
    figure.savefig(path, dpi=150)
    print(path)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="two spheres at 5 % alone, without the full FE model")
    parser.add_argument("--only", nargs="+", choices=SCENES, default=[*SCENES])
    parser.add_argument("--out", type=Path, help="write the JSON result there")
    options = parser.parse_args()
    names, tolerances = (["spheres"], TOLERANCES[:1]) if options.quick else (options.only, TOLERANCES)
    path = Path(__file__).with_suffix(".json")
    before = json.loads(path.read_text())["scenes"] if path.is_file() and not options.quick else {}
    found, result = {}, {"scenes": before}
    if not options.quick:
        warmed_up()
    for name in names:
        found[name] = measured(name, SCENES[name](), tolerances, full=not options.quick)
        result["scenes"][name] = found[name][0]
        (options.out or path).write_text(json.dumps(result, default=float))  # if a later scene fails, this one is kept
    draw(found)
    failed = []
    for name, one in result["scenes"].items():
        shown(name, one)
        failed += [
            f"{name} {r['tolerance']:g}" for r in one["runs"] if r["true"]["force"] > r["tolerance"] and not r["warned"]
        ]
    result |= {"limits": LIMITS, "failed": len(failed), "largest_share": max(
        r["true"]["force"] / r["tolerance"] for one in result["scenes"].values() for r in one["runs"] if not r["warned"]
    )}  # fmt: skip
    scenes.finish(__file__, result, failed, options.out)


if __name__ == "__main__":
    main()
