"""Time of a step in four mechanisms: Exudyn's own part, and the part of bodies and contacts.

A slider crank whose rod has a clearance joint, three balls in a drum, the cam of `examples/cam_follower.py`, and the
gears of `examples/gear_pair.py`, with coarse meshes. Each runs in a process of its own.
Quantity: processor time of a step; Exudyn's own part of it, found by a profile of the run, which does not slow compiled
code; evaluations of contact in a step; peak force. With `--old`, the same by another checkout, and the ratio of both.
Reference: the other checkout. Limit: peak forces differ by at most 1 %, which the step of the crank leaves open.

    python -m validation.benchmarks.mechanisms [--old /path/to/old] [--rounds 3] [NAME ...]
"""

import argparse
import cProfile
import json
import os
import pstats
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parents[2]
RESULTS, LIMITS = Path(__file__).with_suffix(".json"), {"force": 0.01}
CRANK, ROD, PIN, CLEARANCE, SPEED = 0.02, 0.1, 5e-3, 20e-6, 150.0  # lengths [m] and [rad/s]


def connecting_rod():
    """Rod with two eyes; the large one has room for the pin."""
    from netgen.occ import Box, Cylinder, Pnt, Z

    import exudyn_partition as ep

    def round_part(x, radius):
        return Cylinder(Pnt(x, 0, -5e-3), Z, r=radius, h=10e-3)

    shape = Box(Pnt(0, -6e-3, -5e-3), Pnt(ROD, 6e-3, 5e-3)) + round_part(0, 11e-3) + round_part(ROD, 9e-3)
    fem = ep.fe_model(shape - round_part(0, PIN + CLEARANCE) - round_part(ROD, 4e-3), ep.STEEL, maxh=4e-3)
    corners = fem.facets[:, :3]
    inside = np.hypot(fem.points[corners, 0], fem.points[corners, 1]) < PIN + 2 * CLEARANCE
    bore = ep.Partition.surface(fem, np.flatnonzero(inside.all(axis=1)), name="bore", axes="xyz")
    eye = ep.Partition.interface(fem, "small end", cylinder=((ROD, 0, 0), (0, 0, 1), 4e-3))
    return ep.reduce(fem, bore | eye, f_cut=20e3)


def slider_crank():
    """The crank turns at a constant speed; its pin hits the rod as the slider comes to its dead centre."""
    import exudyn as exu
    import exudyn.itemInterface as items
    from exudyn.utilities import InertiaCuboid

    import exudyn_partition as ep

    mbs, body = exu.SystemContainer().AddSystem(), connecting_rod()
    turning = {"nodeType": exu.NodeType.RotationRotationVector}
    ground = mbs.CreateGround()
    crank = mbs.CreateRigidBody(
        inertia=InertiaCuboid(7800, [CRANK, 0.01, 0.01]), initialAngularVelocity=[0, 0, SPEED], **turning
    )
    slider = mbs.CreateRigidBody(
        inertia=InertiaCuboid(7800, [0.02] * 3), referencePosition=[CRANK + ROD, 0, 0], **turning
    )
    swing = np.array([0, 0, -SPEED * CRANK / ROD])
    velocity = np.cross([0, 0, SPEED], [CRANK, 0, 0]) + np.cross(swing, body.centre_of_mass)
    motion = {"frame": "floating", "referencePosition": [CRANK, 0, 0], "damping": 0.02}
    rod = ep.CreatePartitionBody(mbs, body, initialVelocity=velocity, initialAngularVelocity=swing, **motion)

    def marker(number, *place):
        return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=number, localPosition=[*place] or [0, 0, 0]))

    mbs.AddObject(items.ObjectJointRevoluteZ(markerNumbers=[marker(ground), marker(crank)]))
    fixed = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    turn = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.GetObject(crank)["nodeNumber"], coordinate=5))
    mbs.AddObject(items.CoordinateConstraint(markerNumbers=[fixed, turn], offset=SPEED, velocityLevel=True))
    ends = [rod.CreateInterfaceMarker(mbs, "small end"), marker(slider)]
    mbs.AddObject(items.GenericJoint(markerNumbers=ends, constrainedAxes=[1, 1, 1, 1, 1, 0]))
    guide = [marker(ground, CRANK + ROD, 0, 0), marker(slider)]
    mbs.AddObject(items.GenericJoint(markerNumbers=guide, constrainedAxes=[0, 1, 1, 1, 1, 1]))
    pin = ep.RigidCylinder((CRANK, 0, 0), (0, 0, 1), PIN)
    ep.CreatePartitionContact(mbs, rod, pin, masterBody=crank, slavePatch="bore", name="pin")
    mbs.Assemble()
    options = {"method": "implicit", "spectral_radius": 0.6}
    return lambda: ep.solve_dynamic(mbs, end_time=1e-3, step=2e-6, **options)


def drum():
    """Three balls, followed over their whole skins, hit a drum with friction."""
    import exudyn as exu
    from netgen.occ import Cylinder, Pnt, Sphere, Z

    import exudyn_partition as ep

    ball = ep.fe_model(Sphere(Pnt(0, 0, 0), 0.01), ep.STEEL, maxh=3e-3)
    rings = [Cylinder(Pnt(0, 0, -0.012), Z, r=radius, h=0.024) for radius in (0.04, 0.035)]
    hollow = ep.fe_model(rings[0] - rings[1], ep.STEEL, maxh=4e-3)
    corners = hollow.facets[:, :3]
    inside = (np.hypot(hollow.points[corners, 0], hollow.points[corners, 1]) < 0.0352).all(axis=1)
    skin = ep.Partition.surface(ball, np.arange(len(ball.facets)), axes="xyz")
    part = ep.reduce(ball, skin, f_cut=60e3)
    wall = ep.reduce(hollow, ep.Partition.surface(hollow, np.flatnonzero(inside), axes="xyz"), f_cut=20e3)

    mbs = exu.SystemContainer().AddSystem()
    around = ep.CreatePartitionBody(mbs, wall, frame="floating")
    balls = []
    for angle in (-2.1, -1.1, 0.5):
        place = [0.02495 * np.cos(angle), 0.02495 * np.sin(angle), 0]
        motion = {"frame": "floating", "referencePosition": place, "initialVelocity": [0.5, -1.0, 0]}
        balls.append(ep.CreatePartitionBody(mbs, part, gravity=[0, -9.81, 0], **motion))
        ep.CreatePartitionContact(mbs, balls[-1], around, friction=0.2)
    for first, second in ((0, 1), (0, 2), (1, 2)):
        ep.CreatePartitionContact(mbs, balls[second], balls[first], friction=0.2)
    mbs.Assemble()
    return lambda: ep.solve_dynamic(mbs, end_time=100e-6, step=1e-6)


def cam():
    """The eccentric cam speeds up beneath its follower, for a part of a turn."""
    import exudyn_partition as ep
    from cam_follower import QUICK_MESH
    from models import cam_follower as model
    from models import cam_follower_parts as shapes

    rim, face, in_cam, in_follower = QUICK_MESH
    parts = shapes.cam_part(rim, in_cam), shapes.follower_part(face, in_follower)
    bodies = [ep.reduce(*part, f_cut=shapes.F_CUT) for part in parts]
    speed = 0.06 * float(model.lift_off_speed(bodies[1].total_mass))
    mechanism = model.mechanism(*bodies, speed, 0.4 * 2 * np.pi / speed)
    ep.solve_static(mechanism.mbs, update_initial=True)
    mechanism.drive.turning = True
    return lambda: ep.solve_dynamic(
        mechanism.mbs, end_time=0.02, step=2e-4, method="implicit", spectral_radius=0.5, settings=sparse_settings()
    )


def gears():
    """A wheel stands still while the torque on the pinion changes its sign."""
    import exudyn_partition as ep
    import gear_pair as example
    from models import gear_pair as model
    from models import gear_pair_parts as shapes

    pair = example.QUICK_GEARS
    parts = [shapes.gear_part(gear, **example.QUICK_MESH) for gear in pair]
    bodies = [ep.reduce(*part[:2], f_cut=shapes.F_CUT) for part in parts]

    def torque(t):
        return example.TORQUE * (1 - 2 * min(max((t - example.BEGINS) / example.CHANGE, 0), 1))

    work = model.Work(torque, lambda t: (0.0, 0.0))
    mechanism = model.pair(bodies, pair, work, damping=example.DAMPING)
    mechanism.settle()
    return lambda: mechanism.run(1.5e-3, 1e-5)


MECHANISMS = {"slider crank": slider_crank, "balls in a drum": drum, "cam and follower": cam, "gear pair": gears}


def sparse_settings():
    """Settings of Exudyn with its sparse solver, quiet."""
    import exudyn as exu

    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write, settings.timeIntegration.verboseMode = False, 0
    return settings


def measure(name, rounds):
    """Numbers of a mechanism, by the checkout on PYTHONPATH."""
    run, times = MECHANISMS[name](), []
    run()  # compiles what it needs
    for _ in range(rounds):
        begin = time.process_time()
        result = run()
        times.append(time.process_time() - begin)
    profile = cProfile.Profile(time.process_time)
    profile.runcall(run)
    entries = pstats.Stats(profile).stats
    own = sum(entry[2] for (_, _, function), entry in entries.items() if "exudynCPP.Solve" in function)
    calls = sum(
        entry[1] for (path, _, function), entry in entries.items() if function == "force" and "contact_object" in path
    )
    return {
        "step_ms": 1e3 * min(times) / result.steps,
        "exudyn_ms": 1e3 * own / result.steps,
        "evaluations": calls / result.steps,
        "steps": result.steps,
        "force_N": max(float(contact.force(result).max()) for contact in result.contacts),
    }


def asked(path, name, rounds):
    """The same in a process of its own, by a checkout."""
    folders = os.pathsep.join(map(str, (path, ROOT / "examples", ROOT)))
    command = [sys.executable, __file__, "--serve", name, "--rounds", str(rounds)]
    environment = os.environ | {"PYTHONPATH": folders, "OMP_NUM_THREADS": "1"}
    found = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if found.returncode:
        raise SystemExit(found.stderr[-2000:])
    return json.loads(found.stdout.splitlines()[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[[], *MECHANISMS], metavar="NAME")
    parser.add_argument("--old", type=Path, help="another checkout")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--serve", help=argparse.SUPPRESS)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.serve:
        print(json.dumps(measure(options.serve, options.rounds)))
        return
    found = {}
    for name in options.names or MECHANISMS:
        rows = {"new": asked(ROOT, name, options.rounds)}
        if options.old:
            rows["old"] = asked(options.old.resolve(), name, options.rounds)
            rows["ratio"] = rows["new"]["step_ms"] / rows["old"]["step_ms"]
            rows["force"] = rows["new"]["force_N"] / rows["old"]["force_N"] - 1
        found[name] = rows
    columns = "mechanism", "steps", "evaluations a step", "step", "of it Exudyn", "old", "new over old", "peak force"
    table = Table(*columns)
    for name, rows in found.items():
        new, old = rows["new"], rows.get("old")
        by_old = ["", ""] if old is None else [f"{old['step_ms']:.2f} ms", f"{rows['ratio']:.2f}"]
        numbers = (
            f"{new['steps']}",
            f"{new['evaluations']:.1f}",
            f"{new['step_ms']:.2f} ms",
            f"{new['exudyn_ms']:.2f} ms",
        )
        table.add_row(name, *numbers, *by_old, f"{new['force_N']:.4g} N")
    Console(width=130).print(table)
    if not options.names:
        worst = max((abs(rows["force"]) for rows in found.values() if "force" in rows), default=0.0)
        RESULTS.write_text(json.dumps({"limits": LIMITS, "force": worst, "mechanisms": found}, indent=1) + "\n")
        if worst > LIMITS["force"]:
            raise SystemExit(f"peak forces differ by {worst:.2%}")


if __name__ == "__main__":
    main()
