"""A clip that closes on itself and rubs, against the full FE model of the same mesh, and in a frame that turns.

The arms of a C come together at 1 m/s, and shear at three speeds: the ends stick, slip in part, and slip. The contact
is between two patches, by explicit steps in a floating frame, and of one patch that folds, by implicit steps in an
inertial frame. The reference has all nodes, `reference.integrator.HHT`, and the law of friction of `reference.laws`.
The runs end when the ends have parted: when they meet again, they have vibrated so often that the tangential force
changes with the smallest error.

Then the clip is held at its back by a shaft. Pressures and tractions on its arms close it, rub it to and fro and open
it, by implicit steps that are long beside its vibrations. The shaft rests, or makes one turn meanwhile. It turns so
slowly, in a minute, that centrifugal forces hardly count.

Quantity: relative L2 errors of normal and tangential force; error of the energy that friction takes, by the most that
it takes at one of the speeds; momentum of the free clip by the impulse of its contact; and the largest difference
between the forces on the clip that turns, in axes of the shaft, and on the one at rest, by the largest force.
Limits: 2 % of the full FE model, 1e-12 of the momentum, 1e-6 between turning and rest.

    python -m validation.friction.clip
"""

import json
import os
import platform
import sys
import time
import warnings
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as items
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.algebra.complementarity import regularised
from exudyn_partition.reference.full_body import rows_on_dofs
from exudyn_partition.reference.integrator import HHT
from exudyn_partition.reference.laws import Frictional
from exudyn_partition.surfaces.rows import pair_surfaces

RESULTS = Path(__file__).with_suffix(".json")
FIGURE = Path(__file__).resolve().parents[2] / "out" / "friction_clip.png"
ARM, THICK, MOUTH, CLEARANCE = 20e-3, 4e-3, 3e-3, 5e-6  # of the clip [m]
R, PAD = 0.1, 1.9e-3  # of the round end of a pad on its lower arm, and of the pad [m]
TIP, FACE, REACH = (17e-3, 0, -CLEARANCE), (17e-3, 0, 0), 1e-3
INSIDE = [(13e-3, -1.6e-3, -MOUTH + 0.1e-3), (19.5e-3, 1.6e-3, 0.1e-3)]  # of the mouth, which folds
FRICTION, F_CUT, SPEED, END, STEP = 0.3, 425e3, 1.0, 20e-6, 0.0625e-6
SHEARS = {"stick": 0.1, "partial slip": 0.5, "gross slip": 1.0}  # m/s
PRESSURE, TRACTION, TURN_TIME, TURN_STEPS = 2.5e6, 0.6e6, 60.0, 240  # on the arms [Pa]; of the turn [s]
LIMITS = {"normal": 0.02, "tangential": 0.02, "work": 0.02, "momentum": 1e-12, "turning": 1e-6}


def clip(h):
    """FE model; the pad's end is the tip that meets the upper arm, with elements of size h [m] around it."""
    outside = occ.Box(occ.Pnt(-THICK, -THICK / 2, -MOUTH - THICK), occ.Pnt(ARM, THICK / 2, THICK))
    mouth = occ.Box(occ.Pnt(0, -THICK, -MOUTH), occ.Pnt(2 * ARM, THICK, 0))
    ball = occ.Sphere(occ.Pnt(TIP[0], 0, TIP[2] - R), R)
    pad = occ.Cylinder(occ.Pnt(TIP[0], 0, -MOUTH - THICK / 2), occ.Z, r=PAD, h=MOUTH + THICK)
    refine = [ep.Refine(place, REACH, h) for place in (TIP, FACE)]
    return ep.fe_model((outside - mouth) + ball * pad * (outside + mouth), ep.STEEL, maxh=2.2e-3, refine=refine)


def ends(fem):
    """Partition with both ends as patches."""
    tip = ep.Partition.ball(fem, TIP, REACH, direction=(0, 0, 1), axes="xyz", name="tip")
    return tip | ep.Partition.ball(fem, FACE, REACH, direction=(0, 0, -1), axes="xyz", name="face")


def motion(body, shear):
    """Velocities of all nodes, (n, 3) [m/s]: those of the lowest shapes that close the ends, and that shear them."""
    shapes, (tip, face) = np.eye(body.n_dofs), [patch.nodes for patch in body.partition.patches]
    moved, found = np.array([body.displacement(shape) for shape in shapes]), 0.0
    for axis, speed in ((2, SPEED), (1, shear)):
        apart = moved[:, tip, axis].mean(axis=1) - moved[:, face, axis].mean(axis=1)
        first = np.flatnonzero(np.abs(apart) > 0.5 * np.abs(apart).max())[0]
        found = found + moved[first] * speed / apart[first]
    return found


def full(fem, partition, velocity):
    """History of the full FE model."""
    sides = [ep.reference.FullBody(fem, partition, patch=name) for name in ("tip", "face")]
    pairs, steps = pair_surfaces(*(side.surface for side in sides)), round(END / STEP)
    patch_nodes = [len(side.contact.nodes) for side in sides]
    law = Frictional(pairs, patch_nodes, steps, friction=ep.Coulomb(FRICTION), step=STEP)
    rows = sum(rows_on_dofs(side, own) for side, own in zip(sides, law.matrices, strict=True))
    integration = HHT(fem.mass, fem.stiffness, rows, STEP, velocity=velocity.ravel())
    law.begin(regularised(integration.compliance()))
    for n in range(1, steps + 1):
        lam = law.forces(integration.predict())
        integration.correct(lam)
        law.record(lam, n)
    return law.history(STEP * np.arange(steps + 1), {}, {})


def coordinates(fem, body, velocity):
    """Velocities of the coordinates that are nearest to those of all nodes in the norm of the mass."""
    shapes = np.array([body.displacement(shape).ravel() for shape in np.eye(body.n_dofs)])
    weighted = fem.mass @ shapes.T
    return np.linalg.solve(shapes @ weighted, weighted.T @ velocity.ravel())


def close(fem, body, velocity, frame, **how):
    """Clip, contact and result of a run that begins with velocities of all nodes, (n, 3) [m/s]."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame=frame)
    patches = {"slavePatch": 0, "masterPatch": len(body.partition.patches) - 1}
    contact = ep.CreatePartitionContact(mbs, item, item, passes="given", friction=FRICTION, **patches)
    mbs.Assemble()
    start = item.kinematics.from_basis @ coordinates(fem, body, velocity)
    mbs.systemData.SetODE2Coordinates_t(start, exu.ConfigurationType.Initial)
    result = ep.solve_dynamic(mbs, end_time=END, **how)
    return item, contact, result


def compared(item, contact, result, reference, most):
    """Errors of a run against the reference, and the momentum of the clip by the impulse of its contact.

    `most` is the energy that friction takes at most [J].
    """
    normal, tangential = contact.force(result), contact.friction.tangential_force(result)
    there = np.column_stack([np.interp(reference.t, result.t, x) for x in tangential.T])
    apart = np.linalg.norm(there - reference.tangential_force) / np.linalg.norm(reference.tangential_force)
    force = np.interp(reference.t, result.t, normal)
    return {
        "normal": float(np.linalg.norm(force - reference.force) / np.linalg.norm(reference.force)),
        "tangential": float(apart),
        "work": float(abs(contact.dissipated_energy(result)[-1] - reference.dissipated[-1]) / most),
        "momentum": float(abs(item.momentum(result)).max() / np.trapezoid(normal, result.t)),
        "peak_N": float(normal.max()),
        "along_N": float(np.linalg.norm(tangential, axis=1).max()),
        "stuck": int(contact.friction.stuck_rows(result).max()),
        "online_s": result.time_s,
    }


def held(fem):
    """The clip with its back for the shaft, and loads on its arms, reduced."""
    back = np.flatnonzero(abs(fem.points[:, 0] + THICK) < 1e-9)
    part = ends(fem) | ep.Partition.interface(fem, "back", nodes=back)
    for name, z, normal in (("upper", THICK, 1.0), ("lower", -MOUTH - THICK, -1.0)):
        plane = ((0, 0, z), (0, 0, normal))
        part = part | ep.Partition.load(fem, f"press {name}", plane=plane)
        part = part | ep.Partition.load(fem, f"shear {name}", plane=plane, direction=(0, 1, 0))
    return ep.reduce(fem, part, f_cut=F_CUT)


def loads(t):
    """Pressure and traction on the arms [Pa] at a share t of the time: they close, rub twice to and fro, and open."""
    press = PRESSURE * np.clip(5 * min(t, 1 - t), 0.0, 1.0)
    return press * (0.8 + 0.2 * np.cos(6 * np.pi * t)), TRACTION * np.sin(4 * np.pi * t)


def turn(body, turns):
    """Forces on the held clip in axes of its shaft, (n, 3) [N], while that makes some turns, and rows that stick."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame="floating")
    contact = ep.CreatePartitionContact(mbs, item, item, passes="given", friction=FRICTION, slavePatch=0, masterPatch=1)

    def angle(t):
        return 2 * np.pi * turns * (t / TURN_TIME - np.sin(2 * np.pi * t / TURN_TIME) / (2 * np.pi))

    node = mbs.AddNode(items.Node1D(referenceCoordinates=[0.0]))
    shaft = mbs.AddObject(items.ObjectRotationalMass1D(nodeNumber=node, inertia=1e-4))
    nodes = mbs.AddNode(items.NodePointGround()), node
    driven = [mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=number, coordinate=0)) for number in nodes]
    drive = items.CoordinateConstraint(markerNumbers=driven, offsetUserFunction=lambda mbs, t, *_: float(angle(t)))
    mbs.AddObject(drive)
    back, place = item.CreateInterfaceMarker(mbs, "back"), body.partition.interfaces[0].position
    on_shaft = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=shaft, localPosition=place))
    mbs.AddObject(items.GenericJoint(markerNumbers=[on_shaft, back], constrainedAxes=[1] * 6))
    for name, sign in (("upper", 1.0), ("lower", -1.0)):
        for k, kind in enumerate(("press", "shear")):
            size = 1.0 if kind == "press" else sign
            ep.CreateDistributedLoad(
                mbs, item, f"{kind} {name}", size,
                loadUserFunction=lambda mbs, t, size, k=k: float(size * loads(t / TURN_TIME)[k]),
            )  # fmt: skip
    mbs.Assemble()
    result = ep.solve_dynamic(
        mbs, end_time=TURN_TIME, step=TURN_TIME / TURN_STEPS, method="implicit", spectral_radius=0.0
    )
    along, a = contact.friction.tangential_force(result).copy(), angle(result.t)
    back_by = np.moveaxis(np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]), 2, 0)
    along[:, :2] = np.einsum("tij,tj->ti", back_by, along[:, :2])
    return result.t, np.column_stack([contact.force(result), along]), contact.friction.stuck_rows(result)


def draw(histories, turning):
    """Tangential forces of all runs beside the full FE model, and those of the clip on its shaft."""
    fig, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    for name, (reference, (contact, result)) in histories.items():
        (line,) = axes[0].plot(1e6 * result.t, contact.friction.tangential_force(result)[:, 1], label=name)
        axes[0].plot(1e6 * reference.t, reference.tangential_force[:, 1], "k--", lw=0.8)
        axes[0].plot(1e6 * result.t, -FRICTION * contact.force(result), ":", lw=0.8, color=line.get_color())
    axes[0].set(xlabel="time [µs]", ylabel="tangential force [N]", title="dashed: full FE; dotted: slips")
    t, forces, _ = turning
    axes[1].plot(t, forces[:, 0], label="normal")
    axes[1].plot(t, forces[:, 2], label="tangential")
    axes[1].set(xlabel="time [s]", ylabel="force [N]", title="held by a shaft that makes one turn")
    for ax in axes:
        ax.legend(fontsize="small")
    FIGURE.parent.mkdir(exist_ok=True)
    fig.savefig(FIGURE, dpi=120)


def main():
    warnings.simplefilter("ignore", ep.errors.ModelLimitWarning)  # of steps that are long beside vibrations
    fem = clip(0.3e-3)
    parts = {"two patches": ends(fem), "one that folds": ep.Partition.surface(fem, INSIDE, axes="xyz", name="mouth")}
    begin = time.process_time()
    bodies = {name: ep.reduce(fem, part, f_cut=F_CUT) for name, part in parts.items()}
    offline = time.process_time() - begin
    ways = {"two patches": ("floating", {}), "one that folds": ("inertial", {"method": "implicit", "step": 2 * STEP})}
    velocities = {name: motion(bodies["two patches"], shear) for name, shear in SHEARS.items()}
    begin = time.process_time()
    references = {name: full(fem, parts["two patches"], velocity) for name, velocity in velocities.items()}
    full_s = (time.process_time() - begin) / len(references)
    most = max(reference.dissipated[-1] for reference in references.values())
    rows, histories = [], {}
    for shear, velocity in velocities.items():
        for name, body in bodies.items():
            frame, how = ways[name]
            item, contact, result = close(fem, body, velocity, frame, **how)
            errors = compared(item, contact, result, references[shear], most)
            rows.append({"patches": name, "shear": shear, **errors})
            histories.setdefault(shear, (references[shear], (contact, result)))
    body = held(clip(0.4e-3))
    (t, rest, stuck), turning = turn(body, 0.0), turn(body, 1.0)
    apart = abs(turning[1] - rest).max(axis=0) / abs(rest[:, 0]).max()
    draw(histories, turning)
    found = {key: max(row[key] for row in rows) for key in ("normal", "tangential", "work", "momentum")}
    found["turning"] = float(apart.max())
    table = Table("patches", "shear", "normal", "tangential", "work", "peak", "along", "stuck", title="clip")
    for row in rows:
        errors = [f"{100 * row[key]:.2f} %" for key in ("normal", "tangential", "work")]
        sizes = f"{row['peak_N']:.0f} N", f"{row['along_N']:.1f} N", str(row["stuck"])
        table.add_row(row["patches"], row["shear"], *errors, *sizes)
    console = Console(width=120)
    console.print(table)
    console.print(
        f"{found}; {rest[:, 0].max():.1f} N, along {abs(rest[:, 2]).max():.1f} N; stuck {stuck.min()} to {stuck.max()}"
    )
    data = {
        "fe_dofs": fem.n_dofs,
        "dofs": {name: body.n_dofs for name, body in bodies.items()},
        "offline_s": offline,
        "full_s": full_s,
        "rows": rows,
        "turning": {"steps": len(t) - 1, "normal_N": float(rest[:, 0].max()), "along_N": float(abs(rest[:, 2]).max()),
                    "stuck": [int(stuck.min()), int(stuck.max())]},
        "found": found,
        "limits": LIMITS,
        "machine": {"cpus": os.cpu_count(), "platform": platform.platform(), "versions": ep.versions()},
    }  # fmt: skip
    RESULTS.write_text(json.dumps(data, indent=1) + "\n")
    failed = [f"{key} {found[key]:.1e}" for key, limit in LIMITS.items() if not found[key] <= limit]
    sys.exit(f"beyond the stated limits: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
