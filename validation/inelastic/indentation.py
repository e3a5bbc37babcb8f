"""A rigid ball pressed into a block, unloaded and pressed again: statics of the plastic zone.

Reference: first yield at Hertz's p0 = 1.60 times the yield stress (Johnson, Contact Mechanics, section 6.1; nu = 0.3);
mean pressures of 2.7 to 3.0 times it in the fully plastic range, E* a / (Y R) >= 35 (section 6.3); a second loading to
the same depth makes no plastic work. Quantity: p0 at first yield by the yield stress, mean pressure by the yield stress
with the radius from the area of closed rows, for two meshes, and the plastic work of the second loading by that of the
first with a hardening of 500 MPa, after unloading to three quarters of the force. (With less hardening, and further
down, unloading itself makes material flow back at the rim, which the second loading then undoes.)
Limits: 3 % for first yield, 0.1 % for the work. The mean pressure falls with the mesh size, and is told without a
limit.

    python -m validation.inelastic.indentation
"""

import time
import warnings

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes

WIDTH, HEIGHT = 6e-3, 4e-3
RADIUS, LIMITS = 2e-3, {"first_yield": 0.03, "work_again": 1e-3}


def block(material, a, elements, zone):
    """A block below z = 0, with a patch for a contact of radius a, held at its lower face."""
    shape = occ.Box(occ.Pnt(-WIDTH / 2, -WIDTH / 2, -HEIGHT), occ.Pnt(WIDTH / 2, WIDTH / 2, 0))
    shape.faces.Min(occ.Z).name = "base"
    fem = ep.fe_model(shape, material, maxh=2e-3, refine=[ep.Refine((0, 0, 0), 1.1 * a, a / elements)], grading=0.6)
    part = ep.Partition.ball(fem, (0, 0, 0), 2.0 * a, direction=(0, 0, 1), plastic_radius=zone * a)
    return ep.reduce(fem, part | ep.Partition.interface(fem, "base", "base"), f_cut=200e3)


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
    body = block(material, a, elements, 1.0)
    depth = 1.2 * a**2 / RADIUS
    contact, result = press(body, RADIUS, lambda t: depth * t, 40)
    flows = int(np.argmax(contact.plastic_work(result) > 0))
    begins = contact.force(result)[flows - 1 : flows + 1].mean()
    p0 = (6 * begins * modulus**2 / (np.pi**3 * RADIUS**2)) ** (1 / 3)
    return {"p0_by_yield_stress": p0 / 1e9, "force_N": begins, "hertz_N": force, "online_s": result.time_s}


def fully_plastic(elements, hardening=50e6, zone=2.6):
    """Mean pressure by the yield stress at the largest load, and plastic work of the second loading by the first."""
    Y = 200e6
    material = ep.Material(E=70e9, nu=0.3, rho=2700.0, yield_stress=Y, hardening=hardening)
    a = 38 * Y * RADIUS / material.plane_strain_modulus
    begin = time.perf_counter()
    body = block(material, a, elements, zone)
    offline_s, depth = time.perf_counter() - begin, 0.75 * a**2 / RADIUS
    contact, result = press(body, RADIUS, lambda t: depth * np.interp(t, [0, 0.5, 0.75, 1.0], [0, 1, 0.95, 1]), 40)
    force, work = contact.force(result), contact.plastic_work(result)
    radius, top = np.sqrt(contact.area(result) / np.pi), int(np.argmin(abs(result.t - 0.5)))
    return {
        "elements_per_radius": elements,
        "zone_nodes": len(body.partition.patches[0].plastic.nodes),
        "E_a_by_Y_R": material.plane_strain_modulus * radius[top] / (Y * RADIUS),
        "mean_pressure_by_yield_stress": force[top] / (np.pi * radius[top] ** 2 * Y),
        "force_N": force[top],
        "work_again": (work[-1] - work[int(np.argmin(abs(result.t - 0.75)))]) / work[top],
        "offline_s": offline_s,
        "online_s": result.time_s,
    }


def main():
    begin, console = time.perf_counter(), Console(width=150)
    parts = {"first_yield": first_yield()}
    console.print(parts["first_yield"])
    for elements in (2.0, 3.0):
        parts[f"fully_plastic_{elements:g}"] = fully_plastic(elements)
        console.print(parts[f"fully_plastic_{elements:g}"])
    parts["twice"] = fully_plastic(2.0, hardening=500e6)
    console.print(parts["twice"])
    found = {
        "first_yield": parts["first_yield"]["p0_by_yield_stress"] / 1.60 - 1,
        "work_again": parts["twice"]["work_again"],
    }
    failed = [f"{key} {value:.3g}" for key, value in found.items() if not abs(value) <= LIMITS[key]]
    result = {**parts, "found": found, "limits": LIMITS, "time_s": time.perf_counter() - begin}
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
