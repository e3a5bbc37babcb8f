"""An experiment: alumina balls of 5 mm hit thick glass at 3.9 m/s at several angles (Kharaz, Gorham, Salman 2001).

Quantity: spin after the impact at five angles of incidence, from the normal, with the coefficient of friction that the
authors found from the impulses of sliding impacts, 0.092. The glass is a block large enough that no wave returns.
Reference: their measurements, which scatter by about a tenth about the theory of Maw, Barber and Fawcett.
Limits: 12 % for each spin, energy with what friction took 1e-4.

    python -m validation.friction.kharaz
"""

import argparse

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes

RADIUS, SPEED, MU = 2.5e-3, 3.9, 0.092
ALUMINA, GLASS = ep.Material(E=380e9, nu=0.23, rho=4000.0), ep.Material(E=70e9, nu=0.25, rho=2500.0)
MEASURED = {5.9: 135.0, 10.9: 261.0, 21.1: 574.0, 31.1: 612.0, 39.0: 595.0}  # degrees: rad/s
EDGE, END = 40e-3, 16e-6  # of the glass [m], of a run [s]: 16 us are 80 mm of a longitudinal wave
LIMITS = {"spin": 0.12, "energy": 1e-4}


def bodies():
    """The ball on its south pole, and the glass below it."""
    mass = 4 / 3 * np.pi * RADIUS**3 * ALUMINA.rho
    force = ep.hertz.impact(mass, SPEED, RADIUS, np.inf, ALUMINA, GLASS).peak_force
    a = ep.hertz.contact_radius(force, RADIUS, np.inf, ALUMINA, GLASS)
    block = occ.Box(occ.Pnt(-EDGE / 2, -EDGE / 2, -EDGE / 2), occ.Pnt(EDGE / 2, EDGE / 2, 0))
    shapes = (
        (occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS), ALUMINA, 0.9e-3, 1.35 * a, 600e3),
        (block, GLASS, 6e-3, 1.8 * a, 150e3),
    )
    found = []
    for shape, material, maxh, reach, f_cut in shapes:
        fem = ep.fe_model(shape, material, maxh=maxh, refine=[ep.Refine((0, 0, 0), 1.3 * a, a / 3.5)], grading=0.4)
        part = ep.Partition.ball(fem, (0, 0, 0), reach, axes="xyz")
        found.append(ep.reduce(fem, part, f_cut=min(f_cut, 0.9 * fem.resolved_frequency)))
    return found


def impact(ball, glass, angle):
    """Spin after the impact [rad/s], and the change of energy."""
    mbs = exu.SystemContainer().AddSystem()
    angle = np.radians(angle)
    velocity = [SPEED * np.sin(angle), 0, -SPEED * np.cos(angle)]
    items = [
        ep.CreatePartitionBody(mbs, ball, referencePosition=[0, 0, 1e-7], initialVelocity=velocity, frame="floating"),
        ep.CreatePartitionBody(mbs, glass, frame="floating"),
    ]
    contact = ep.CreatePartitionContact(mbs, *items, friction=MU)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=END)
    energy = sum(item.energy(result) for item in (*items, contact)) + contact.dissipated_energy(result)
    along = np.trapezoid(contact.friction.tangential_force(result)[:, 0], result.t)
    return {
        "spin": float(items[0].coordinates_t(result)[-1, 4]),
        "energy": float(abs(energy / energy[0] - 1).max()),
        "ratio": float(-along / np.trapezoid(contact.force(result), result.t)),
        "rows": int(contact.closed_rows(result).max()),
        "stuck": int(contact.friction.stuck_rows(result).max()),
        "restitution": float(items[0].momentum(result)[-1, 2] / ball.total_mass / -velocity[2]),
        "online_s": result.time_s,
    }


def draw(cases):
    path, (_, axes) = scenes.figure(__file__, figsize=(6, 4.5))
    axes.plot(list(MEASURED), list(MEASURED.values()), "ks", mfc="none", label="measured")
    axes.plot(list(cases), [case["spin"] for case in cases.values()], "C0o-", label="this library")
    axes.set(xlabel="angle of incidence [degrees]", ylabel="spin [rad/s]")
    axes.legend()
    axes.figure.savefig(path, dpi=150)
    return path


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    ball, glass = bodies()
    cases, console = {}, Console(width=150)
    for angle, spin in MEASURED.items():
        cases[angle] = case = impact(ball, glass, angle)
        case["error"] = case["spin"] / spin - 1
        console.print(angle, case)
    console.print(str(draw(cases)))
    found = {
        "spin": max(abs(case["error"]) for case in cases.values()),
        "energy": max(case["energy"] for case in cases.values()),
    }
    result = {"found": found, "limits": LIMITS, "cases": cases, "reduce_s": ball.reduce_s + glass.reduce_s}
    scenes.finish(__file__, result, [f"{key} {found[key]:.3g}" for key in LIMITS if found[key] > LIMITS[key]])


if __name__ == "__main__":
    main()
