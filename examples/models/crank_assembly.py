"""Crank, link and block as CAD would export them, in one STEP file; their speed as rigid bodies; figures and results.

What to learn here: names of solids are all that is needed to find them again.
"""

import json

import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

CRANK, LINK = 0.05, 0.15  # between the bores [m]


def bar(name, start, end, low, high):
    """A bar along x between two bores of 4 mm radius, between two heights [mm]."""
    shape = occ.Box((start - 8, -8, low), (end + 8, 8, high))
    for x in (start, end):
        shape -= occ.Cylinder(occ.Pnt(x, 0, low - 1), occ.Z, r=4, h=high - low + 2)
    shape.name = name
    return shape


def write_step(path):
    """Write the assembly in millimetres, each solid where it stands, and return the path."""
    block = occ.Box((190, -10, 8), (230, 10, 28)) + occ.Sphere(occ.Pnt(190, 0, 18), 10)
    block -= occ.Cylinder(occ.Pnt(200, 0, 0), occ.Z, r=4, h=40)
    block.name = "block"
    occ.Compound([bar("crank", 0, 50, -8, 0), bar("link", 50, 200, 0, 8), block]).WriteStep(str(path))
    return path


def rigid_speed(fems, torque, way):
    """Speed of the block [m/s] after a way [m] from rest: the torque's work is the kinetic energy of rigid bodies."""
    crank, link, block = (fems[name] for name in ("crank", "link", "block"))
    about_shaft = crank.inertia_tensor[2, 2] + crank.total_mass * (crank.centre_of_mass[:2] ** 2).sum()

    def places(angle):
        pin = CRANK * np.array([np.cos(angle), np.sin(angle)])
        slider = np.array([pin[0] + np.sqrt(LINK**2 - pin[1] ** 2), 0.0])
        return pin, slider, np.arcsin(-pin[1] / LINK)

    angles = np.linspace(1e-3, 1.0, 2000)
    ways = CRANK + LINK - np.array([places(angle)[1][0] for angle in angles])
    angle, d = float(np.interp(way, ways, angles)), 1e-6
    (pin, slider, turn), (pin_, slider_, turn_) = places(angle - d), places(angle + d)
    middle = ((pin_ + slider_) - (pin + slider)) / (4 * d)  # of the link, by the crank's angle
    by_angle = (slider_ - slider)[0] / (2 * d)
    mass = about_shaft + link.total_mass * (middle**2).sum() + block.total_mass * by_angle**2
    mass += link.inertia_tensor[2, 2] * ((turn_ - turn) / (2 * d)) ** 2
    return abs(by_angle) * np.sqrt(2 * torque * angle / mass)


def write_results(folder, machine, fems, bodies, contact, run, rigid):
    """Write figures, a page on which the bodies move, and result.json, which is returned.

    `rigid` is the speed [m/s] of rigid bodies before the impact.
    """
    force, speed = contact.force(run), bodies["block"].velocity(run, (0.23, 0, 0.018))[:, 0]
    before, rigid = float(-speed[(force > 0).argmax() - 1]), float(rigid)
    fig, axes = plt.subplots(layout="constrained")
    axes.plot(1e3 * run.t, force)
    axes.set(xlabel="time [ms]", ylabel="contact force [N]")
    fig.savefig(folder / "assembly.png")
    shown = [(bodies[name], fem) for name, fem in fems.items()]
    axes = ep.plot.bodies(run, bodies=shown, colour="von_mises", end=150e6, direction=(-0.7, -1.6, 0.8))
    axes.figure.savefig(folder / "bodies.png", dpi=150)
    run.scene(folder / "moving.html", title="assembly of a STEP file")
    result = {
        "solids": list(machine.names), "dofs": sum(b.body.n_dofs for b in bodies.values()), "steps": run.steps,
        "fe_dofs": sum(fem.n_dofs for fem in fems.values()), "peak_force_N": float(force.max()),
        "speed_m_s": before, "error": {"speed": before / rigid - 1}, "versions": ep.versions(),
    }  # fmt: skip
    (folder / "result.json").write_text(json.dumps(result, indent=1) + "\n")
    print(machine, f"{before:.4f} m/s before the impact, {rigid:.4f} m/s as rigid bodies", sep="\n")
    print(folder.resolve() / "assembly.png")
    return result
