"""Lasting contact: adaptive implicit steps that grow in it, beside the same runs with the steps of an impact there.

- block: a steel cube of 10 mm drops 0.5 um, rattles on its flat face and comes to rest, in 20 ms;
- valve: a poppet of 6 g on a spring of 20 N with a damper, between seat and stop. A force of 60 N opens it for 2 ms, it
  falls back, chatters on its seat and rests, in 20 ms;
- pressed: a ball that a spring of 20 N presses on a plane, at rest from the start, for 2 ms;
- crank slider: a turn of the example, whose blocks press each other for 26 ms; the coarse meshes of its quick run.

Reference: the same run whose velocity_tolerance is so small that no step grows in contact; the weight and the spring's
force, which the contact carries at rest.
Quantity: steps, Jacobians and processor time of both runs, impulses of the first three impacts of each contact as far
as they have a hundredth of the largest, mean force over the last tenth of the time, sum of all impulses, and warnings
of energy that long steps made or lost, which the library gives above 1e-3. A contact that chatters is chaotic: later
impacts are not compared.
Limits: processor time 1/2 (valve), 1/3 (block) and 3/5 (crank slider) of that before; 300 steps of the pressed ball;
impulses of first impacts 2 %; force at rest 0.1 %; no warning of energy.

    python -m validation.contact.lasting
"""

import time
import warnings

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from examples.models import crank_slider
from examples.models.crank_slider_parts import QUICK_MESH, TURN, block, link
from validation.contact import scenes

G = 9.81
AS_BEFORE = 1e-12  # velocity_tolerance
LIMITS = {"valve": 0.5, "block": 1 / 3, "crank slider": 0.6, "steps": 300, "impulse": 0.02, "rest": 1e-3}


def cube():
    """A cube above the plane on which it will rest, its contact, and the force there at rest [N]."""
    fem = ep.fe_model(occ.Box((-5e-3, -5e-3, 0), (5e-3, 5e-3, 10e-3)), ep.STEEL, maxh=3e-3)
    part = ep.Partition.ball(fem, (0, 0, 0), 8e-3, direction=(0, 0, -1), name="foot")
    body = ep.reduce(fem, part, f_cut=150e3)

    def model():
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, body, damping=0.5, gravity=[0, 0, -G], referencePosition=[0, 0, 0.5e-6])
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch="foot", name="foot")
        mbs.Assemble()
        return mbs, [contact], body.total_mass * G

    return model, 20e-3


def guided(mbs, body, top, *, damping, damper=0.0):
    """Add a body that joints lead along z, with a spring and a damper between the ground and its interface at `top`."""
    item = ep.CreatePartitionBody(mbs, body, damping=damping, gravity=[0, 0, -G])
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround(), localPosition=[0, 0, top]))
    markers = [ground, item.CreateInterfaceMarker(mbs, "top")]
    mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=[1, 1, 0, 1, 1, 1]))
    along = {"stiffness": [0, 0, 5e3], "damping": [0, 0, damper], "offset": [0, 0, -20.0 / 5e3]}
    mbs.AddObject(items.CartesianSpringDamper(markerNumbers=markers, **along))
    return item, markers[1]


def poppet():
    """A valve between its seat and a stop."""
    disc, stem, lift = 3e-3, 15e-3, 0.3e-3
    shape = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, 8e-3, disc) * occ.Sphere(occ.Pnt(0, 0, 20e-3), 20e-3)
    shape += occ.Cylinder(occ.Pnt(0, 0, disc), occ.Z, 2.5e-3, stem)
    fem = ep.fe_model(shape, ep.STEEL, maxh=2.5e-3, refine=[ep.Refine((0, 0, 0), radius=1e-3, h=0.35e-3)])
    part = ep.Partition.ball(fem, (0, 0, 0), 1.2e-3, name="foot")
    part |= ep.Partition.ball(fem, (0, 0, disc + stem), 2e-3, direction=(0, 0, 1), name="head")
    x, y, z = fem.points.T
    ring = np.flatnonzero((abs(z - 10e-3) < 1.5e-3) & (np.hypot(x, y) > 2.4e-3))
    part |= ep.Partition.interface(fem, "top", ring, kind="averaged", position=(0, 0, 10e-3))
    body = ep.reduce(fem, part, f_cut=80e3)

    def model():
        mbs = exu.SystemContainer().AddSystem()
        item, marker = guided(mbs, body, 10e-3, damping=0.02, damper=15.0)

        def push(mbs, t, load):
            return [0, 0, 60.0 if t < 2e-3 else 0.0]

        mbs.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=[0, 0, 1], loadVectorUserFunction=push))
        stop = ep.RigidPlane(point=(0, 0, disc + stem + lift), normal=(0, 0, -1))
        contacts = [
            ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch="foot", name="seat"),
            ep.CreatePartitionContact(mbs, item, stop, slavePatch="head", name="stop"),
        ]
        mbs.Assemble()
        return mbs, contacts, 20.0 + body.total_mass * G

    return model, 20e-3


def pressed():
    """A ball that a spring presses on a plane, in equilibrium."""
    fine = ep.Refine((0, 0, 0), radius=0.5e-3, h=0.25e-3)
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0.01), 0.01), ep.STEEL, maxh=6e-3, refine=[fine])
    top = np.flatnonzero(fem.points[:, 2] > 17e-3)
    part = ep.Partition.ball(fem, (0, 0, 0), 0.8e-3, name="foot")
    part |= ep.Partition.interface(fem, "top", top, kind="averaged", position=(0, 0, 0.02))
    body = ep.reduce(fem, part, f_cut=60e3)

    def model():
        mbs = exu.SystemContainer().AddSystem()
        item, _ = guided(mbs, body, 0.02, damping=0.05)
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch="foot", name="foot")
        mbs.Assemble()
        ep.solve_static(mbs, load_steps=3, update_initial=True)
        return mbs, [contact], 20.0 + body.total_mass * G

    return model, 2e-3


def crank(end_time=TURN):
    """The example's crank slider."""
    rod = ep.reduce(*link(), f_cut=5e3)
    blocks = [ep.reduce(*block(number, *QUICK_MESH), f_cut=100e3) for number in (3, 4)]

    def model():
        made = crank_slider.mechanism(rod, blocks)
        return made.mbs, [made.contact], 0.0

    return model, end_time


def as_in_example():
    """Options with which the example of the crank slider runs."""
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write, settings.timeIntegration.verboseMode = False, 0
    newton = settings.timeIntegration.newton
    newton.absoluteTolerance, newton.relativeTolerance, newton.modifiedNewtonContractivity = 1e-8, 1e-5, 0.02
    newton.numericalDifferentiation.jacobianConnectorDerivative = False
    return {"step": 2e-6, "free_step": 2e-4, "unresolved": 1e-2, "settings": settings}


def run(model, end_time, tolerance, **options):
    """Figures of one run."""
    mbs, contacts, at_rest = model()
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = ep.solve_dynamic(
            mbs, end_time=end_time, method="implicit", adaptive=True, velocity_tolerance=tolerance, **options
        )
    spent = time.process_time() - begin
    forces = [contact.force(result) for contact in contacts]
    end = result.t > 0.9 * end_time
    mean = np.trapezoid(forces[0][end], result.t[end]) / np.ptp(result.t[end])
    return {
        "steps": result.steps,
        "jacobians": result.work.jacobians,
        "newton_iterations": result.work.newton_iterations,
        "cpu_s": spent,
        "impulses_Ns": [[impact.impulse for impact in contact.impacts(result)[:3]] for contact in contacts],
        "total_Ns": float(sum(np.trapezoid(force, result.t) for force in forces)),
        "rest_N": float(mean),
        "rest_error": float(mean / at_rest - 1) if at_rest else 0.0,
        "energy_warnings": [text for text in result.warnings if "grew in lasting contact" in text],
    }


def compared(name, scene, **options):
    """Both runs of a scene, and how they differ."""
    model, end_time = scene
    now, before = (run(model, end_time, tolerance, **options) for tolerance in (1e-3, AS_BEFORE))
    both = zip(now["impulses_Ns"], before["impulses_Ns"], strict=True)
    pairs = np.array([pair for contact in both for pair in zip(*contact, strict=False)]).T
    pairs = pairs[:, pairs[1] > 0.01 * pairs[1].max()]
    return {
        "name": name,
        "before": before,
        "now": now,
        "time": now["cpu_s"] / before["cpu_s"],
        "impulse": float(abs(pairs[0] / pairs[1] - 1).max()),
        "total": now["total_Ns"] / before["total_Ns"] - 1,
    }


def failures(rows):
    """Limits that are missed."""
    failed = [f"{r['name']}: time {r['time']:.0%}" for r in rows if r["time"] > LIMITS.get(r["name"], 1.0)]
    failed += [f"{r['name']}: impulse {r['impulse']:.1%}" for r in rows if r["impulse"] > LIMITS["impulse"]]
    for r in rows:
        if abs(r["now"]["rest_error"]) > LIMITS["rest"]:
            failed.append(f"{r['name']}: force at rest {r['now']['rest_error']:+.2%}")
        failed += r["now"]["energy_warnings"]
        if r["name"] == "pressed" and r["now"]["steps"] > LIMITS["steps"]:
            failed.append(f"pressed: {r['now']['steps']} steps")
    return failed


def main():
    """Run all scenes, print the table and write the JSON file."""
    run(*pressed(), 1e-3)  # compiles what all runs need
    rows = [compared("pressed", pressed()), compared("valve", poppet()), compared("block", cube())]
    run(*crank(0.086), 1e-3, **as_in_example())
    rows.append(compared("crank slider", crank(), **as_in_example()))
    table = Table("scene", "steps", "before", "Jacobians", "before", "time", "impulses", "all impulses", "rest")
    for r in rows:
        now, before = r["now"], r["before"]
        table.add_row(
            r["name"], str(now["steps"]), str(before["steps"]), str(now["jacobians"]), str(before["jacobians"]),
            f"{r['time']:.0%} of {before['cpu_s']:.3g} s", f"{r['impulse']:.1e}", f"{r['total']:+.1e}",
            f"{now['rest_error']:+.1e}",
        )  # fmt: skip
    Console(width=150).print(table)
    scenes.finish(__file__, {"limits": LIMITS, "scenes": rows}, failures(rows))


if __name__ == "__main__":
    main()
