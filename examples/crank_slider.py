"""A crank slider strikes a block on a spring-damper (Wang, Liu, Hong 2018, section 6).

A rigid crank turns at constant speed and drives, by a flexible link, block 3 along a slide. Near the outer dead centre
its spherical head strikes that of block 4, which a spring-damper holds. The paper gives crank, speed, spring and
damper, shapes and duration; lengths, sections and the place of block 4 are reconstructed, for its Table 4 is missing
from our copy (crank angle at first contact: 150 degrees).
"""

import argparse
import json
import math
import time
from dataclasses import dataclass
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as items
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep

CRANK, CRANK_MASS, SPEED = 0.150, 0.234, 10 * math.pi  # [m], [kg], [rad/s]
LINK, WIDTH, THICKNESS = 0.300, 0.020, 0.010  # [m]
RADIUS, LENGTHS = 0.010, (0.071, 0.058)  # of the blocks 3 and 4 and their heads [m]
STIFFNESS, DAMPING = 1e5, 1e3  # of the spring-damper [N/m], [N s/m]
CONTACT_ANGLE = math.radians(150)  # of the crank from the inner dead centre
TURN = 2 * math.pi / SPEED  # [s]
STEEL = ep.Material(E=210e9, nu=0.3, rho=7800.0)
LINK_SIZE = 8e-3  # of its elements [m]
# Element size at the head and within which radius, and elsewhere [m]; some 11000 nodes, as the paper's blocks have.
FULL_MESH, QUICK_MESH = (0.22e-3, 1.1e-3, 4e-3), (0.3e-3, 1.2e-3, 6e-3)
PAPER_MESH = 0.4e-3, 1e-3, 4e-3  # some 150 nodes in each impact region
SCHEMES = {  # basis of the blocks, formulation and rows of their contact
    "contact-adapted": ("contact-adapted", "compliance", "integrated"),
    "paper": ("free", "lagrange", "node-to-segment"),  # explicit, for its nodes have mass: the first impact alone
}


def slider(angle):
    """Place of the slider [m] and its derivative by the crank's angle, from the inner dead centre."""
    root = np.sqrt(LINK**2 - (CRANK * np.sin(angle)) ** 2)
    return root - CRANK * np.cos(angle), CRANK * np.sin(angle) * (1 - CRANK * np.cos(angle) / root)


def block_shape(number):
    """Shape of block 3 or 4: head at the origin, towards the other block; the face at its back has a name."""
    side, length = (1, LENGTHS[0]) if number == 3 else (-1, LENGTHS[1])
    centre = occ.Pnt(-side * RADIUS, 0, 0)
    shape = occ.Cylinder(centre, occ.Vec(-side, 0, 0), r=RADIUS, h=length - RADIUS) + occ.Sphere(centre, RADIUS)
    (shape.faces.Min(occ.X) if number == 3 else shape.faces.Max(occ.X)).name = "back"
    return shape


def block(number, h, region, maxh):
    """FE model and partition of block 3 or 4, with an interface at its back."""
    refined = [ep.Refine((0, 0, 0), region, h)]
    fem = ep.fe_model(block_shape(number), STEEL, maxh=maxh, refine=refined, grading=0.5)
    head = ep.Partition.ball(fem, (0, 0, 0), region, direction=(1 if number == 3 else -1, 0, 0))
    return fem, head | ep.Partition.interface(fem, "back", "back", kind="averaged")


def link_shape():
    """Shape of the link, along x about the origin; the faces at its pins have names."""
    half = np.array([LINK, WIDTH, THICKNESS]) / 2
    shape = occ.Box(occ.Pnt(*-half), occ.Pnt(*half))
    shape.faces.Min(occ.X).name, shape.faces.Max(occ.X).name = "crank pin", "slider pin"
    return shape


def link():
    """FE model and partition of the link, with interfaces for its two pins."""
    fem = ep.fe_model(link_shape(), STEEL, maxh=LINK_SIZE)
    pins = [ep.Partition.interface(fem, name, name, kind="averaged") for name in ("crank pin", "slider pin")]
    return fem, pins[0] | pins[1]


@dataclass
class Mechanism:
    """The assembled model, its bodies, and the sensors of the drive."""

    mbs: object
    link: dict
    blocks: list
    contact: object
    drive: object
    angle: float  # of the crank at the start

    def histories(self, result):
        """Time series: angle, force, torque of the drive, velocity of the link's centre, places, energies."""
        ends = (-LENGTHS[0], 0, 0), (LENGTHS[1], 0, 0)
        back = [item.displacement(result, end) for item, end in zip(self.blocks, ends, strict=True)]
        spring, rate = (
            (q(result) @ self.blocks[1].body.interface_rows("back")[0])
            for q in (self.blocks[1].coordinates, self.blocks[1].coordinates_t)
        )
        torque = -result.sensor(self.drive)[:, 0]  # of the drive on the crank
        bodies = [self.link, *self.blocks]
        return {
            "t": result.t,
            "angle": self.angle + SPEED * result.t,
            "force": self.contact.force(result),
            "torque": torque,
            "link_velocity": self.link.velocity(result, (0, 0, 0)),
            "slider": back[0][:, 0],
            "block_4": back[1][:, 0],
            "work": integral(result.t, torque * SPEED),
            "stored": sum(item.energy(result) for item in (*bodies, self.contact)) + STIFFNESS * spring**2 / 2,
            "dissipated": integral(result.t, DAMPING * rate**2),
        }


def integral(t, x):
    """Running integral by the trapezoidal rule."""
    return np.r_[0.0, np.cumsum(np.diff(t) * (x[1:] + x[:-1]) / 2)]


@dataclass
class Start:
    """Where all parts are with the crank at `angle` [rad], and how they move as rigid bodies."""

    angle: float

    def __post_init__(self):
        self.pin = -CRANK * np.array([math.cos(self.angle), math.sin(self.angle), 0.0])
        self.place, rate = slider(self.angle)
        self.speed = SPEED * rate  # of block 3
        self.heads = self.place + LENGTHS[0], slider(CONTACT_ANGLE)[0] + LENGTHS[0]
        arm = np.array([self.place, 0, 0]) - self.pin
        self.centre, c, s = self.pin + arm / 2, arm[0] / LINK, arm[1] / LINK
        self.axes = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])  # of the link
        self.turning = np.array([0, 0, SPEED * CRANK * math.cos(self.angle) / arm[0]])
        self.velocity = np.cross([0, 0, SPEED], self.pin) + np.cross(self.turning, arm / 2)


def connect(mbs, start, pins, backs):
    """Add crank, drive, joints and spring-damper to the markers of link and blocks; returns the drive's sensor."""
    crank_node = mbs.AddNode(items.Node1D(referenceCoordinates=[start.angle], initialVelocities=[SPEED]))
    crank = mbs.AddObject(items.ObjectRotationalMass1D(nodeNumber=crank_node, inertia=CRANK_MASS * CRANK**2 / 3))
    ground = mbs.AddObject(items.ObjectGround())

    def on(body, x):
        return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=[x, 0, 0]))

    slides = [on(ground, start.place), on(ground, start.heads[1] + LENGTHS[1])]
    mbs.AddObject(items.GenericJoint(markerNumbers=[on(crank, -CRANK), pins[0]], constrainedAxes=[1, 1, 1, 1, 1, 0]))
    mbs.AddObject(items.GenericJoint(markerNumbers=[backs[0], pins[1]], constrainedAxes=[1, 1, 0, 0, 0, 0]))
    for slide, back in zip(slides, backs, strict=True):
        mbs.AddObject(items.GenericJoint(markerNumbers=[slide, back], constrainedAxes=[0, 1, 1, 1, 1, 1]))
    mbs.AddObject(
        items.CartesianSpringDamper(
            markerNumbers=[slides[1], backs[1]], stiffness=[STIFFNESS, 0, 0], damping=[DAMPING, 0, 0]
        )
    )
    axes = [
        mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
        for node in (mbs.AddNode(items.NodePointGround()), crank_node)
    ]
    drive = mbs.AddObject(
        items.CoordinateConstraint(
            markerNumbers=axes,
            offsetUserFunction=lambda mbs, t, *unused: SPEED * t,
            offsetUserFunction_t=lambda mbs, t, *unused: SPEED,
        )
    )
    return mbs.AddSensor(
        items.SensorObject(objectNumber=drive, outputVariableType=exu.OutputVariableType.Force, storeInternal=True)
    )


def add_link(mbs, body, start):
    """Add the link, which turns; returns it and the markers of its pins."""
    rod = ep.CreatePartitionBody(
        mbs,
        body,
        name="link",
        frame="floating",
        referencePosition=start.centre,
        referenceRotation=start.axes,
        initialVelocity=start.velocity,
        initialAngularVelocity=start.turning,
    )
    return rod, [rod.CreateInterfaceMarker(mbs, name) for name in ("crank pin", "slider pin")]


def mechanism(link_body, block_bodies, scheme="contact-adapted", angle=0.0):
    """The mechanism with the crank at `angle` [rad], assembled."""
    mbs, start = exu.SystemContainer().AddSystem(), Start(angle)
    rod, pins = add_link(mbs, link_body, start)
    blocks = [
        ep.CreatePartitionBody(
            mbs, body, name=f"block {number}", referencePosition=[head, 0, 0], initialVelocity=[speed, 0, 0]
        )
        for body, number, head, speed in zip(block_bodies, (3, 4), start.heads, (start.speed, 0.0), strict=True)
    ]
    drive = connect(mbs, start, pins, [item.CreateInterfaceMarker(mbs, "back") for item in blocks])
    _, formulation, rows = SCHEMES[scheme]
    contact = ep.CreatePartitionContact(mbs, *blocks, formulation=formulation, rows=rows, name="heads")
    mbs.Assemble()
    return Mechanism(mbs, rod, blocks, contact, drive, angle)


def run(model, end_time, step, scheme="contact-adapted", free_step=2e-4):
    """Implicit steps that grow in free flight and resolve the impact; the paper's central differences in its scheme."""
    if scheme == "paper":
        step = 0.5 * ep.stability_limit(model.mbs)
        return ep.solve_dynamic(model.mbs, end_time=end_time, step=step, sample_period=1e-6)
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write, settings.timeIntegration.verboseMode = False, 0
    settings.timeIntegration.newton.absoluteTolerance = 1e-8
    settings.timeIntegration.newton.relativeTolerance = 1e-5  # forces change by 1e-5, run time by a third
    # What rings on after the impact, undamped, holds less than 1 % of the energy; without contact it is not resolved.
    return ep.solve_dynamic(
        model.mbs,
        end_time=end_time,
        step=step,
        method="implicit",
        adaptive=True,
        free_step=free_step,
        unresolved=1e-2,
        settings=settings,
    )


def draw(found, folder):
    """Contact force, torque, velocity and energies (the paper's Figs. 13 to 15), and the mechanism as it moves."""
    t, first = 1e3 * found["t"], int(np.flatnonzero(found["force"])[0])
    fig, axes = plt.subplots(5, 1, figsize=(8, 13), layout="constrained")
    axes[0].plot(t, found["force"] / 1e3, lw=0.8)
    axes[0].set_ylabel("contact force [kN]")
    near = slice(max(first - 20, 0), first + 400)
    axes[1].plot(t[near], found["force"][near] / 1e3)
    axes[1].set_ylabel("first impacts [kN]")
    axes[2].plot(t, found["torque"], lw=0.8)
    axes[2].set_ylabel("driving torque [N m]")
    for i, name in enumerate("xy"):
        axes[3].plot(t, found["link_velocity"][:, i], lw=0.8, label=f"along {name}")
    axes[3].set_ylabel("link's centre [m/s]")
    for label in ("work", "stored", "dissipated"):
        axes[4].plot(t, found[label] - (found[label][0] if label == "stored" else 0), label=label)
    axes[4].set_ylabel("energy [J]")
    for panel in axes[3:]:
        panel.legend()
    for panel in axes:
        panel.set_xlabel("time [ms]")
        panel.grid(alpha=0.3)
    fig.savefig(folder / "crank_slider.png", dpi=150)

    fig, axes = plt.subplots(4, 2, figsize=(10, 9), layout="constrained")
    for panel, i in zip(axes.ravel(), np.searchsorted(found["t"], np.linspace(0, found["t"][-1], 8)), strict=True):
        angle = found["angle"][i]
        x = slider(found["angle"][0])[0] + found["slider"][i]
        x4 = slider(CONTACT_ANGLE)[0] + sum(LENGTHS) + found["block_4"][i]
        pin = -CRANK * np.cos(angle), -CRANK * np.sin(angle)
        panel.plot([0, pin[0]], [0, pin[1]], "k-o", lw=3)
        panel.plot([pin[0], x], [pin[1], 0], "C0-o", lw=3)
        for end, length, side, colour in ((x, LENGTHS[0], 1, "C1"), (x4, LENGTHS[1], -1, "C2")):
            head = np.linspace(-np.pi / 2, np.pi / 2, 30)
            neck = end + side * (length - RADIUS)
            outline = np.column_stack([neck + side * RADIUS * np.cos(head), RADIUS * np.sin(head)])
            panel.fill(*np.vstack([[end, -RADIUS], outline, [end, RADIUS]]).T, colour)
        coil = np.linspace(0, 1, 60)
        panel.plot(x4 + coil * (0.62 - x4), 0.01 * np.sin(12 * np.pi * coil), "0.5")
        panel.set(xlim=(-0.17, 0.64), ylim=(-0.17, 0.17), aspect="equal", xlabel="x [m]", ylabel="y [m]")
        panel.set_title(f"{t[i]:.1f} ms, {math.degrees(angle):.0f} deg")
    fig.savefig(folder / "mechanism.png", dpi=120)
    plt.close("all")


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scheme", default="contact-adapted", choices=[*SCHEMES])
    parser.add_argument("--f-cut", type=float, default=100e3, metavar="HZ", help="of the blocks; the link has 5 kHz")
    parser.add_argument("--step", type=float, default=2e-6, metavar="S", help="in contact")
    parser.add_argument("--quick", action="store_true", help="coarser meshes, 2.2 ms around the first impact")
    parser.add_argument("--out", type=Path, default=Path("out/crank_slider"), metavar="DIR")
    options = parser.parse_args(argv)
    mesh = QUICK_MESH if options.quick else FULL_MESH
    before, end_time = (0.2e-3, 2.2e-3) if options.quick else (CONTACT_ANGLE / SPEED, TURN)
    if options.scheme == "paper":
        mesh, before, end_time = PAPER_MESH, 20e-6, 0.4e-3
    basis = SCHEMES[options.scheme][0]

    clock = [time.perf_counter()]
    parts = [link(), *(block(number, *mesh) for number in (3, 4))]
    clock.append(time.perf_counter())
    bodies = [
        ep.reduce(*parts[0], f_cut=5e3),
        *(ep.reduce(*part, basis=basis, f_cut=options.f_cut) for part in parts[1:]),
    ]
    clock.append(time.perf_counter())
    model = mechanism(bodies[0], bodies[1:], options.scheme, CONTACT_ANGLE - before * SPEED)
    result = run(model, end_time, options.step, options.scheme)
    found = model.histories(result)

    balance = found["work"] - (found["stored"] - found["stored"][0]) - found["dissipated"]
    impacts = model.contact.impacts(result)
    summary = {
        "scheme": options.scheme,
        "status": result.status,
        "dofs": sum(body.n_dofs for body in bodies),
        "fe_dofs": sum(fem.n_dofs for fem, _ in parts),
        "modes": [body.n_shapes - 6 for body in bodies],
        "contact_nodes": model.contact.n_rows,
        "step_s": result.step,
        "steps": result.steps,
        "time": {"fem_s": clock[1] - clock[0], "reduce_s": clock[2] - clock[1], "online_s": result.time_s},
        "first_contact_s": impacts[0].start,
        "peak_force_N": float(found["force"].max()),
        "impacts": len(impacts),
        "contact_duration_s": sum(impact.end - impact.start for impact in impacts),
        "impulse_Ns": sum(impact.impulse for impact in impacts),
        "largest_torque_Nm": float(abs(found["torque"]).max()),
        "work_J": float(found["work"][-1]),
        "dissipated_J": float(found["dissipated"][-1]),
        "energy_error": float(abs(balance).max() / abs(found["work"]).max()),
        "left_out": [*bodies[1].left_out, *model.contact.left_out],
        "versions": ep.versions(),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(summary, indent=2))
    np.savez_compressed(options.out / "histories.npz", **found)
    draw(found, options.out)
    table = Table(title=f"crank slider, {options.scheme}: {summary['dofs']} of {summary['fe_dofs']} dofs")
    table.add_column("quantity")
    table.add_column("value")
    for key in ("steps", "impacts", "peak_force_N", "impulse_Ns", "largest_torque_Nm", "energy_error"):
        table.add_row(key, f"{summary[key]:.5g}")
    for key, seconds in summary["time"].items():
        table.add_row(key, f"{seconds:.3g}")
    Console().print(table)
    print((options.out / "crank_slider.png").resolve())
    return summary


if __name__ == "__main__":
    main()
