"""Two equal elastic balls that hit each other, as FE models: Maw's curve of oblique impacts.

Two equal reduced balls of one mesh hit each other obliquely in Exudyn, at three speeds. The second ball is the
first one turned by half a turn. So normal forces move both surfaces alike and not against each other, as Maw, Barber
and Fawcett assume. They also assume half-spaces and no waves, which a small contact and a slow impact come near to.
Limit: |psi2 error| 0.03 at psi1 = 0.25 to 8, at the slowest speed.

    python -m validation.friction.two_balls [--quick]
"""

import argparse
import time

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes
from validation.friction import half_space
from validation.friction.half_space import KAPPA, MAW, MU, RADIUS

SPEEDS = (0.6, 0.25, 0.1)  # m/s, at which the balls come together
PSI = (0.25, 0.5, 1.0, 2.0, 3.0, 4.5, 8.0)
ELEMENTS = 4  # in the contact radius at the highest speed
LIMITS = {"maw": 0.03}
MATERIAL = ep.Material(E=half_space.E, nu=half_space.NU, rho=half_space.RHO)


def ball(a, elements):
    """FE model of a ball on its south pole, fine for a contact of radius a [m]."""
    shape = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)
    fine = ep.Refine((0, 0, 0), 1.3 * a, a / elements)
    return ep.fe_model(shape, MATERIAL, maxh=3e-3, refine=[fine], grading=0.4)


def balls():
    """The ball with its own patch, and with a larger one as the master, and how long an impact takes [s]."""
    mass = 4 / 3 * np.pi * RADIUS**3 * MATERIAL.rho
    fastest = ep.hertz.impact(mass / 2, SPEEDS[0], RADIUS, RADIUS, MATERIAL, MATERIAL)
    a = ep.hertz.contact_radius(fastest.peak_force, RADIUS, RADIUS, MATERIAL, MATERIAL)
    fem = ball(a, ELEMENTS)
    parts = [ep.Partition.ball(fem, (0, 0, 0), share * a, axes="xyz") for share in (1.3, 1.6)]
    return [ep.reduce(fem, part, f_cut=100e3) for part in parts], fastest.duration


def impact(bodies, speed, psi1, duration, steps):
    """Rebound psi2 and the changes of energy and momenta."""
    mbs = exu.SystemContainer().AddSystem()
    along = psi1 * MU * speed / KAPPA
    items = []
    for body, sign in zip(bodies, (1, -1), strict=True):
        items.append(
            ep.CreatePartitionBody(
                mbs,
                body,
                frame="floating",
                referencePosition=[0, 0, sign * 1e-9],
                referenceRotationMatrix=np.diag([1.0, sign, sign]),
                initialVelocity=[sign * along / 2, 0, -sign * speed / 2],
            )
        )
    contact = ep.CreatePartitionContact(mbs, *items, friction=MU)
    mbs.Assemble()
    end = 1.15 * duration * (SPEEDS[0] / speed) ** 0.2
    result = ep.solve_dynamic(mbs, end_time=end, step=end / steps)
    velocity = [item.momentum(result)[-1] / item.body.total_mass for item in items]
    inertia = 0.4 * bodies[0].total_mass * RADIUS**2
    at_contact = []
    for item, v, sign in zip(items, velocity, (1, -1), strict=True):
        centre = np.array([0, 0, sign * RADIUS]) + item.rigid_motion(item.coordinates(result))[-1, :3]
        spin = item.angular_momentum(result, centre)[-1, 1] / inertia
        at_contact.append(v[0] - sign * RADIUS * spin)
    energy = sum(item.energy(result) for item in (*items, contact)) + contact.dissipated_energy(result)
    turning = sum(item.angular_momentum(result, np.zeros(3)) for item in items)
    return {
        "psi2": float((at_contact[0] - at_contact[1]) * KAPPA / (MU * speed)),
        "energy": float(abs(energy / energy[0] - 1).max()),
        "angular_momentum": float(
            abs(turning - turning[0]).max() / (bodies[0].total_mass * RADIUS * max(along, speed))
        ),
        "rows": int(contact.closed_rows(result).max()),
        "open_at_end": bool(contact.closed_rows(result)[-1] == 0),
        "online_s": result.time_s,
    }


def draw(curves):
    path, (_, axes) = scenes.figure(__file__, figsize=(6, 4.5))
    axes.plot(list(MAW), list(MAW.values()), "k-", label="Maw, Barber, Fawcett")
    for speed, cases in curves.items():
        axes.plot(list(cases), [case["psi2"] for case in cases.values()], "o", mfc="none", label=f"{speed:g} m/s")
    axes.set(xlabel="psi1, incidence", ylabel="psi2, rebound")
    axes.legend(fontsize=7)
    axes.figure.savefig(path, dpi=120)
    return path


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three incidences at the slowest speed")
    options = parser.parse_args()
    begin, console = time.perf_counter(), Console(width=150)
    bodies, duration = balls()
    curves = {}
    for speed in SPEEDS[-1:] if options.quick else SPEEDS:
        curves[speed] = {}
        for psi1 in PSI[1::2] if options.quick else PSI:
            curves[speed][psi1] = case = impact(bodies, speed, psi1, duration, 200)
            case["error"] = case["psi2"] - MAW[psi1]
            console.print(speed, psi1, case)
    found = {f"maw_{speed:g}": max(abs(case["error"]) for case in cases.values()) for speed, cases in curves.items()}
    found["maw"] = found[f"maw_{SPEEDS[-1]:g}"]
    console.print(found)
    missed = [f"{key} {found[key]:.3g}" for key in LIMITS if abs(found[key]) > LIMITS[key]]
    if options.quick:
        raise SystemExit(f"limits missed: {missed}" if missed else 0)
    console.print(str(draw(curves)))
    result = {"found": found, "limits": LIMITS, "impacts": curves, "time_s": time.perf_counter() - begin}  # fmt: skip
    scenes.finish(__file__, result, missed)


if __name__ == "__main__":
    main()
