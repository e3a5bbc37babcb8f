"""Time of a step in mechanisms: Exudyn's own part, and the part of bodies and contacts.

A slider crank whose rod has a clearance joint, three balls in a drum, the cam of `examples/cam_follower.py`, the gears
of `examples/gear_pair.py`, the pawl of a ratchet, a compressed strut that a ball hits, and a valve that falls on its
seat, with coarse meshes. Each runs in a process of its own.
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


def ratchet():
    """A pawl on a hinge, pressed by a spring, falls from tooth to tooth of a rigid wheel that turns."""
    import exudyn as exu
    import exudyn.itemInterface as items
    from exudyn.utilities import InertiaCuboid
    from netgen.occ import Axis, Box, Cylinder, Pnt, Z

    import exudyn_partition as ep

    hinge, depth, slope = np.array([0.03, 0.012, 0.0]), 4e-3, 12.0
    wheel = Cylinder(Pnt(0, 0, -depth), Z, r=9e-3, h=2 * depth)
    for tooth in range(8):  # a face along the radius, and a back that falls
        step = Box(Pnt(0, 0, -depth), Pnt(12e-3, 4e-3, depth)).Rotate(Axis((12e-3, 0, 0), Z), slope)
        wheel += step.Rotate(Axis((0, 0, 0), Z), 45.0 * tooth)
    arm = Box(Pnt(10e-3, 9e-3, -3e-3), Pnt(34e-3, 14e-3, 3e-3)) - Cylinder(Pnt(*hinge[:2], -3e-3), Z, r=1.5e-3, h=6e-3)
    nose = arm + Cylinder(Pnt(10e-3, 10e-3, -3e-3), Z, r=2e-3, h=6e-3)
    fem = ep.fe_model(nose, ep.STEEL, maxh=2e-3)
    tip = ep.Partition.ball(fem, (9e-3, 8.5e-3, 0), 3e-3, axes="xyz")
    eye = ep.Partition.interface(fem, "eye", cylinder=(hinge, (0, 0, 1), 1.5e-3))
    body = ep.reduce(fem, tip | eye, f_cut=30e3)

    mbs = exu.SystemContainer().AddSystem()
    ground, turning = mbs.CreateGround(), {"nodeType": exu.NodeType.RotationRotationVector}
    shaft = mbs.CreateRigidBody(inertia=InertiaCuboid(7800, [0.02] * 3), initialAngularVelocity=[0, 0, 40.0], **turning)
    pawl = ep.CreatePartitionBody(mbs, body, frame="floating", damping=0.02)

    def marker(number, place=(0, 0, 0)):
        return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=number, localPosition=[*place]))

    mbs.AddObject(items.ObjectJointRevoluteZ(markerNumbers=[marker(ground), marker(shaft)]))
    fixed = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    turn = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.GetObject(shaft)["nodeNumber"], coordinate=5))
    mbs.AddObject(items.CoordinateConstraint(markerNumbers=[fixed, turn], offset=40.0, velocityLevel=True))
    ends = [marker(ground, hinge), pawl.CreateInterfaceMarker(mbs, "eye")]
    mbs.AddObject(items.GenericJoint(markerNumbers=ends, constrainedAxes=[1, 1, 1, 1, 1, 0]))
    mbs.AddObject(items.TorsionalSpringDamper(markerNumbers=ends, stiffness=1.0, damping=0.0, offset=0.2))
    profile = ep.RigidMesh.of(wheel, maxh=2e-3)
    ep.CreatePartitionContact(mbs, pawl, profile, masterBody=shaft, friction=0.1, name="pawl")
    mbs.Assemble()
    return lambda: ep.solve_dynamic(mbs, end_time=1e-3, step=2e-6, method="implicit", spectral_radius=0.6)


def strut():
    """A ball hits the side of a strut that bears a third of the load at which it buckles."""
    import exudyn as exu
    import exudyn.itemInterface as items
    from netgen.occ import Box, Pnt, Sphere

    import exudyn_partition as ep

    length, width, radius = 0.2, 8e-3, 6e-3
    middle = (0, width / 2, length / 2)
    shape = Box(Pnt(-width / 2, -width / 2, 0), Pnt(width / 2, width / 2, length))
    fem = ep.fe_model(shape, ep.ALUMINIUM, maxh=8e-3, refine=[ep.Refine(middle, 1.5e-3, 0.6e-3)])
    part = ep.Partition.ball(fem, middle, 1.5e-3, axes="xyz")
    for name, at in (("foot", 0.0), ("head", length)):
        part |= ep.Partition.interface(fem, name, plane=((0, 0, at), (0, 0, 1 if at else -1)))
    body = ep.reduce(fem, part, f_cut=20e3, geometric_stiffness=True)
    near = (0, middle[1] + 2e-6, middle[2])
    sphere = Sphere(Pnt(0, near[1] + radius, near[2]), radius)
    ball = ep.fe_model(sphere, ep.STEEL, maxh=4e-3, refine=[ep.Refine(near, 1.2e-3, 0.5e-3)])
    striker = ep.reduce(ball, ep.Partition.ball(ball, near, 1.2e-3, axes="xyz"), f_cut=60e3)

    mbs = exu.SystemContainer().AddSystem()
    column = ep.CreatePartitionBody(mbs, body, frame="floating", name="strut")
    hits = ep.CreatePartitionBody(mbs, striker, initialVelocity=[0, -1.0, 0])
    for name, axes, at in (("foot", [1, 1, 1, 0, 1, 1], 0.0), ("head", [1, 1, 0, 0, 1, 1], length)):
        place = items.MarkerBodyRigid(bodyNumber=mbs.CreateGround(), localPosition=[0, 0, at])
        ends = [mbs.AddMarker(place), column.CreateInterfaceMarker(mbs, name)]
        mbs.AddObject(items.GenericJoint(markerNumbers=ends, constrainedAxes=axes))
    buckles = np.pi**2 * ep.ALUMINIUM.E * width**4 / 12 / length**2
    mbs.AddLoad(items.Force(markerNumber=ends[1], loadVector=[0, 0, -buckles / 3]))
    ep.CreatePartitionContact(mbs, hits, column, name="ball")
    mbs.Assemble()
    ep.solve_static(mbs, update_initial=True)
    return lambda: ep.solve_dynamic(mbs, end_time=100e-6)


def valve():
    """A disc on a spring falls on its seat, a rigid plane, and rebounds."""
    import exudyn as exu
    import exudyn.itemInterface as items
    from netgen.occ import Cylinder, Pnt, Z

    import exudyn_partition as ep

    disc = Cylinder(Pnt(0, 0, 0), Z, r=12e-3, h=2e-3) - Cylinder(Pnt(0, 0, 0), Z, r=9e-3, h=0.3e-3)
    shape = disc + Cylinder(Pnt(0, 0, 2e-3), Z, r=3e-3, h=20e-3)
    fem = ep.fe_model(shape, ep.STEEL, maxh=2.5e-3)
    seat = ep.Partition.surface(fem, plane=((11e-3, 0, 0), (0, 0, -1)))
    stem = ep.Partition.interface(fem, "stem", plane=((0, 0, 22e-3), (0, 0, 1)))
    body = ep.reduce(fem, seat | stem, f_cut=40e3)
    mbs = exu.SystemContainer().AddSystem()
    poppet = ep.CreatePartitionBody(mbs, body, referencePosition=[0, 0, 5e-6], initialVelocity=[0, 0, -0.3])
    place = items.MarkerBodyRigid(bodyNumber=mbs.CreateGround(), localPosition=[0, 0, 22e-3 + 5e-6])
    ends = [mbs.AddMarker(place), poppet.CreateInterfaceMarker(mbs, "stem")]
    mbs.AddObject(items.GenericJoint(markerNumbers=ends, constrainedAxes=[1, 1, 0, 1, 1, 1]))
    mbs.AddObject(items.CartesianSpringDamper(markerNumbers=ends, stiffness=[0, 0, 2e4], offset=[0, 0, -2e-3]))
    ep.CreatePartitionContact(mbs, poppet, ep.RigidPlane(), name="seat")
    mbs.Assemble()
    return lambda: ep.solve_dynamic(mbs, end_time=1e-3, step=1e-6, method="implicit", spectral_radius=0.8)


MECHANISMS = {
    "slider crank": slider_crank,
    "balls in a drum": drum,
    "cam and follower": cam,
    "gear pair": gears,
    "ratchet": ratchet,
    "strut and ball": strut,
    "valve": valve,
}


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
