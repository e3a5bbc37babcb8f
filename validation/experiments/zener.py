"""A steel ball on a thin wide aluminium disc: restitution by bending waves alone, against Zener (1941).

Nothing is lost in the material. What the ball does not get back goes away as a bending wave. Zener's theory puts the
Hertz spring in series with the impedance of a thin infinite plate; `zener_theory.py` solves it, and is compared with
the table of `data/zener.json`, which another program gave. The discs are free and have a radius of 100 mm, so no wave
returns before the ball has left. Bodies, meshes and step are what `ep.design_impact` gives for 1 %, here for the time
in which the ball leaves.

Quantity: e = J / (m v) - 1 of the ball, peak force, time of contact.
Limits: e at most 0.02 below the theory and not above it, force and time within 1 and 2 %; the table within 1e-4.

Zener's plate does not yield by shear, and his ball carries no waves. Both take energy from the rebound, so e is lower,
by the order (thickness over wave length) squared, and more for thicker plates.

    python -m validation.experiments.zener [--quick] [--out JSON]
"""

import time
import warnings

import exudyn as exu
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep
from validation.experiments import common, zener_theory

DATA = common.data("zener")
SETUP = DATA["setup"]
RADIUS, DISC = SETUP["ball_radius_m"], SETUP["disc_radius_m"]
BALL = ep.Material(E=SETUP["ball_E_Pa"], nu=SETUP["ball_nu"], rho=SETUP["ball_rho_kg_m3"])
PLATE = ep.Material(E=SETUP["disc_E_Pa"], nu=SETUP["disc_nu"], rho=SETUP["disc_rho_kg_m3"])
LIMITS = {"e below": 0.02, "e above": 0.0, "force": 0.01, "duration": 0.02, "table": 1e-4, "balance": 1e-3}


def run(thickness, speed):
    """One impact beside Zener's theory, and the force over time."""
    theory, begin = zener_theory.impact(BALL, PLATE, RADIUS, thickness, speed), time.perf_counter()
    ball = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)
    disc = occ.Cylinder(occ.Pnt(0, 0, -thickness), occ.Dir(0, 0, 1), DISC, thickness)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ep.errors.YieldWarning)  # compared with elastic bodies
        design = ep.design_impact(
            (ball, BALL), (disc, PLATE), speed=speed, contact=(0, 0, 0), duration=1.15 * theory.duration
        )
        offline = time.perf_counter() - begin
        mbs = exu.SystemContainer().AddSystem()
        items = [
            ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -v], frame="inertial")
            for body, v in zip(design.bodies, (speed, 0.0), strict=True)
        ]
        contact = ep.CreatePartitionContact(mbs, *items, passes="given")
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=design.duration, step=design.step)
    force, energy = contact.force(result), sum(item.energy(result) for item in (*items, contact))
    impacts = contact.impacts(result)
    e = np.trapezoid(force, result.t) / (items[0].body.total_mass * speed) - 1
    return {
        "thickness_mm": 1e3 * thickness,
        "speed_m_s": speed,
        "lambda": float(zener_theory.inelasticity(BALL, PLATE, RADIUS, thickness, speed)[0]),
        "e": float(e),
        "e_theory": float(theory.e),
        "e_error": float(e - theory.e),
        "peak_N": float(force.max()),
        "peak_error": float(force.max() / theory.force - 1),
        "duration_us": 1e6 * (impacts[-1].end - impacts[0].start),
        "duration_error": float((impacts[-1].end - impacts[0].start) / theory.duration - 1),
        "contacts": len(impacts),
        "balance": float(abs(energy / energy[0] - 1).max()),
        "dofs": sum(body.n_dofs for body in design.bodies),
        "offline_s": offline,
        "online_s": result.time_s,
    }, (result.t, force)


def off_table():
    """Largest relative difference of the theory's solution from the table."""
    worst = 0.0
    for row in DATA["table"]:
        found = zener_theory.rebound(row["lambda"])
        pairs = ((found.e, row["e"]), (found.force, row["force"]), (found.duration, row["duration"]))
        worst = max(worst, *(abs(ours - stored) for ours, stored in pairs))
    return float(worst)


def draw(path, rows, curve):
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    parameters = np.linspace(0, 1.6, 60)
    left.plot(parameters, [zener_theory.rebound(x).e for x in parameters], "k-", lw=1, label="Zener")
    left.plot([row["lambda"] for row in rows], [row["e"] for row in rows], "C3o", label="this library")
    for row in rows:
        text = f"  {row['thickness_mm']:g} mm, {row['speed_m_s']:g} m/s"
        left.annotate(text, (row["lambda"], row["e"]), fontsize=8)
    left.set(xlabel="inelasticity of Zener", ylabel="coefficient of restitution", ylim=(0, 1))
    left.legend()
    t, force = curve
    right.plot(1e6 * t, force, "C3-")
    right.set(
        xlabel="time [µs]", ylabel="force [N]", title=f"{rows[0]['thickness_mm']:g} mm, {rows[0]['speed_m_s']:g} m/s"
    )
    figure.savefig(path, dpi=110)


def main():
    given = common.options(__doc__, "one of the four discs")
    stored = DATA["rows"][:1] if given.quick else DATA["rows"]
    rows, curves = [], []
    for row in stored:
        found, curve = run(row["thickness_m"], row["speed_m_s"])
        found["e_stored"] = row["e"]
        rows.append(found)
        curves.append(curve)
    common.show("ball on disc, Zener", rows)
    errors = [row["e"] - min(row["e_theory"], row["e_stored"]) for row in rows]
    found = {
        "e below": max(0.0, -min(row["e_error"] for row in rows)),
        "e above": max(0.0, *errors),
        "force": max(abs(row["peak_error"]) for row in rows),
        "duration": max(abs(row["duration_error"]) for row in rows),
        "table": off_table(),
        "balance": max(row["balance"] for row in rows),
    }
    common.finish(__file__, {"rows": rows}, found, LIMITS, given, lambda path: draw(path, rows, curves[0]))


if __name__ == "__main__":
    main()
