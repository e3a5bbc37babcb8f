"""A rigid ball pressed into a block, unloaded and pressed again: statics of the plastic zone.

Reference: first yield at Hertz's p0 = 1.60 times the yield stress (Johnson, Contact Mechanics, section 6.1; nu = 0.3);
mean pressures of 2.7 to 3.0 times it in the fully plastic range, E* a / (Y R) >= 35 (section 6.3); a second loading to
the same depth makes no plastic work. Quantity: p0 at first yield by the yield stress, mean pressure by the yield stress
for two meshes, and the plastic work of the second loading by that of the first with a hardening of 500 MPa, after
unloading to three quarters of the force. (With less hardening, and further down, unloading itself makes material flow
back at the rim, which the second loading then undoes.) The radius a of the contact is that at which the deformed
surface leaves the ball. The area of the closed rows has a smaller one, because rows that lie partly outside are open.

Unloading, hardening 500 MPa: as an elastic contact with the dent, with the contact radius a of the largest load P.
References, by the depth that is recovered when the force is gone: Hertz's pressure, that is a sphere in a dent of
larger radius, 3 P / (4 E* a) (Johnson, section 6.4), and an even pressure, 2 P / (pi E* a) (Mesarovic and Johnson,
J. Mech. Phys. Solids 48, 2000, 2009). Both begin with the stiffness 2 E* a. The depths are those of a half-space: what
the block of finite size adds, C P, is known from an elastic run. Quantity: that stiffness by 2 E* a, and how far the
depth at each force lies outside of what both theories span, by the depth recovered.
Limits: 3 % for first yield, 2.7 to 3.0 for the mean pressure on the finer mesh, 0.1 % for the work, 5 % for unloading,
where elements are a third of a.

    python -m validation.inelastic.indentation
"""

import time
import warnings
from dataclasses import replace

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes

WIDTH, HEIGHT = 6e-3, 4e-3
RADIUS, LIMITS = (
    2e-3,
    {"first_yield": 0.03, "work_again": 1e-3, "mean_pressure": 0.15, "stiffness": 0.05, "unloading": 0.05},
)


def block(material, a, elements, zone):
    """A block below z = 0, with a patch for a contact of radius a, held at its lower face; and its FE model."""
    shape = occ.Box(occ.Pnt(-WIDTH / 2, -WIDTH / 2, -HEIGHT), occ.Pnt(WIDTH / 2, WIDTH / 2, 0))
    shape.faces.Min(occ.Z).name = "base"
    fem = ep.fe_model(shape, material, maxh=2e-3, refine=[ep.Refine((0, 0, 0), 1.1 * a, a / elements)], grading=0.6)
    part = ep.Partition.ball(fem, (0, 0, 0), 2.0 * a, direction=(0, 0, 1), plastic_radius=zone * a)
    return ep.reduce(fem, part | ep.Partition.interface(fem, "base", "base"), f_cut=200e3), fem


def contact_radius(contact, result, sample, fem):
    """Radius at which the surface leaves the ball at a sample [m]: between two nodes, beyond which all are apart."""
    item, at = contact.slave, result.at([result.t[sample]])
    nodes = item.body.points[item.body.partition.patches[0].nodes]
    r, rough = np.linalg.norm(nodes[:, :2], axis=1), np.sqrt(contact.area(at)[0] / np.pi)
    near = np.flatnonzero((r > 0.8 * rough) & (r < 1.4 * rough))
    near = near[np.argsort(r[near])]
    answer = ep.recovery.StaticAnswer(fem, item.body)
    up = np.array([item.displacement(at, point, fem=answer)[0, 2] for point in nodes[near]])
    apart = RADIUS - np.sqrt(RADIUS**2 - r[near] ** 2) - up
    last = int(np.flatnonzero(apart <= 0)[-1])
    return r[near[last : last + 2]].mean()


def press(body, radius, travel, load_steps):
    """Contact and result of the block whose base moves up by `travel`, a function of time from 0 to 1 [m]."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidSphere((0, 0, radius), radius))
    place = np.eye(4)
    place[2, 3] = -HEIGHT
    fixed = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround(), localHT=place))
    joint = items.GenericJoint(markerNumbers=[fixed, item.CreateInterfaceMarker(mbs, "base")])
    joint.offsetUserFunction = lambda mbs, t, i, parameters: [0, 0, travel(t), 0, 0, 0]
    mbs.AddObject(joint)
    mbs.Assemble()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ep.errors.YieldWarning)
        return contact, ep.solve_static(mbs, load_steps=load_steps)


def first_yield(elements=5.0):
    """Relative error of p0 at first yield, with a yield stress so large that the yielded core is resolved."""
    material = ep.Material(E=70e9, nu=0.3, rho=2700.0, yield_stress=1e9, hardening=0.0)
    modulus = material.plane_strain_modulus
    force = np.pi**3 * RADIUS**2 * (1.6e9) ** 3 / (6 * modulus**2)
    a = ep.hertz.contact_radius(1.2 * force, RADIUS, np.inf, material)
    body, _ = block(material, a, elements, 1.0)
    depth = 1.2 * a**2 / RADIUS
    contact, result = press(body, RADIUS, lambda t: depth * t, 40)
    flows = int(np.argmax(contact.plastic.work(result) > 0))
    begins = contact.force(result)[flows - 1 : flows + 1].mean()
    p0 = (6 * begins * modulus**2 / (np.pi**3 * RADIUS**2)) ** (1 / 3)
    return {"p0_by_yield_stress": p0 / 1e9, "force_N": begins, "hertz_N": force, "online_s": result.time_s}


def fully_plastic(elements, hardening=50e6, zone=2.6):
    """Mean pressure by the yield stress at the largest load, and plastic work of the second loading by the first."""
    Y = 200e6
    material = ep.Material(E=70e9, nu=0.3, rho=2700.0, yield_stress=Y, hardening=hardening)
    a = 38 * Y * RADIUS / material.plane_strain_modulus
    begin = time.perf_counter()
    body, fem = block(material, a, elements, zone)
    offline_s, depth = time.perf_counter() - begin, 0.75 * a**2 / RADIUS
    contact, result = press(body, RADIUS, lambda t: depth * np.interp(t, [0, 0.5, 0.75, 1.0], [0, 1, 0.95, 1]), 40)
    force, work = contact.force(result), contact.plastic.work(result)
    top = int(np.argmin(abs(result.t - 0.5)))
    radius = contact_radius(contact, result, top, fem)
    return {
        "elements_per_radius": elements,
        "zone_nodes": len(body.partition.patches[0].plastic.nodes),
        "E_a_by_Y_R": material.plane_strain_modulus * radius / (Y * RADIUS),
        "mean_pressure_by_yield_stress": force[top] / (np.pi * radius**2 * Y),
        "mean_pressure_by_closed_rows": force[top] / (contact.area(result)[top] * Y),
        "force_N": force[top],
        "work_again": (work[-1] - work[int(np.argmin(abs(result.t - 0.75)))]) / work[top],
        "offline_s": offline_s,
        "online_s": result.time_s,
    }


def unloading(elements=3.0, zone=2.6):
    """Unloading from the fully plastic range, down to no force, against elastic contact with the dent."""
    Y = 200e6
    material = ep.Material(E=70e9, nu=0.3, rho=2700.0, yield_stress=Y, hardening=500e6)
    modulus = material.plane_strain_modulus
    a = 38 * Y * RADIUS / modulus
    (body, fem), depth = block(material, a, elements, zone), 0.75 * a**2 / RADIUS
    # What the block adds to the depth of a half-space, by an elastic run to the same depth.
    strong = replace(body, material=replace(material, yield_stress=material.E))
    contact, result = press(strong, RADIUS, lambda t: 0.6 * depth * t, 4)
    elastic = contact.force(result)[-1]
    hertz = (3 * elastic / (4 * modulus * np.sqrt(RADIUS))) ** (2 / 3)
    more = (0.6 * depth - hertz) / elastic

    def travel(t):
        """Most steps are for the way back, which begins slowly and ends beyond the last contact."""
        return depth * np.interp(t, [0, 0.3, 0.4, 1.0], [0, 1, 0.98, 0.7])

    contact, result = press(body, RADIUS, travel, 60)
    force, top = contact.force(result), int(contact.force(result).argmax())
    radius, deep = contact_radius(contact, result, top, fem), travel(result.t) - more * force
    back = slice(top, int(np.flatnonzero(force > 0)[-1]) + 1)
    load, recovered = force[back], deep[top] - deep[back]
    largest = load[0]
    # Depths recovered at these forces: Hertz, and an even pressure by the angle whose sine is the contact's radius / a.
    by_hertz = 3 * largest / (4 * modulus * radius) * (1 - (load / largest) ** (2 / 3))
    angle = np.linspace(np.pi / 2, 0, 2000)
    cosine = np.interp(-load / largest, -2 / np.pi * (angle - np.sin(2 * angle) / 2), np.cos(angle))
    by_even_pressure = 2 * largest / (np.pi * modulus * radius) * cosine
    low, high = np.minimum(by_hertz, by_even_pressure), np.maximum(by_hertz, by_even_pressure)
    outside = np.maximum(low - recovered, recovered - high)
    first = int(np.argmax(load < 0.97 * largest))
    stiffness = (largest - load[first]) / recovered[first]
    work = contact.plastic.work(result)
    return {
        "radius_mm": 1e3 * radius,
        "mean_pressure_by_yield_stress": largest / (np.pi * radius**2 * Y),
        "stiffness_by_2_E_a": stiffness / (2 * modulus * radius),
        "recovered_um": 1e6 * recovered[-1],
        "hertz_um": 1e6 * by_hertz[-1],
        "even_pressure_um": 1e6 * by_even_pressure[-1],
        "outside_by_recovered": max(0.0, outside.max() / recovered[-1]),
        "work_of_unloading_by_all": 1 - work[top] / work[-1],
        "block_by_half_space": more * elastic / hertz,
        "depth_um": (1e6 * recovered).tolist(),
        "force_N": load.tolist(),
        "by_hertz_um": (1e6 * by_hertz).tolist(),
        "by_even_pressure_um": (1e6 * by_even_pressure).tolist(),
    }


def draw(parts):
    path, (figure, ax) = scenes.figure(__file__, figsize=(5.5, 4))
    found = parts["unloading"]
    for key, style, label in (
        ("depth_um", "C3.-", "plastic zone"),
        ("by_hertz_um", "k-", "sphere in its dent (Johnson)"),
        ("by_even_pressure_um", "k--", "even pressure (Mesarovic, Johnson)"),
    ):
        ax.plot(found[key], found["force_N"], style, linewidth=1, label=label)
    ax.set(xlabel="depth recovered [µm]", ylabel="force [N]")
    ax.legend()
    figure.savefig(path, dpi=150)
    return path


def main():
    begin, console = time.perf_counter(), Console(width=150)
    parts = {"first_yield": first_yield()}
    console.print(parts["first_yield"])
    for elements in (2.0, 3.0):
        parts[f"fully_plastic_{elements:g}"] = fully_plastic(elements)
        console.print(parts[f"fully_plastic_{elements:g}"])
    parts["twice"] = fully_plastic(2.0, hardening=500e6)
    console.print(parts["twice"])
    parts["unloading"] = unloading()
    console.print(parts["unloading"], str(draw(parts)))
    found = {
        "stiffness": parts["unloading"]["stiffness_by_2_E_a"] - 1,
        "unloading": parts["unloading"]["outside_by_recovered"],
        "first_yield": parts["first_yield"]["p0_by_yield_stress"] / 1.60 - 1,
        "mean_pressure": parts["fully_plastic_3"]["mean_pressure_by_yield_stress"] - 2.85,
        "work_again": parts["twice"]["work_again"],
    }
    failed = [f"{key} {value:.3g}" for key, value in found.items() if not abs(value) <= LIMITS[key]]
    result = {**parts, "found": found, "limits": LIMITS, "time_s": time.perf_counter() - begin}
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
