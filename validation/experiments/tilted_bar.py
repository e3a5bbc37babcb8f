"""A slender steel bar falls on a rigid plane, tilted: restitution, micro-collisions, peak force and impulse.

Stoianovici and Hurmuzlu (1996) counted the contacts of such bars by an electric circuit, and found that vibration and
several contacts in one impact decide on the restitution. Their tables are not public. The reference is beam theory:
modes of a Timoshenko beam and of a rod on the Hertz spring of the tip, `beam_theory.py`, with the numbers of
`data/tilted_bar.json`. With friction, the spring of the tip also yields along the plane (Mindlin) and slides.
Bodies, meshes and step are what `ep.design_impact` gives for 1 %; with friction its mesh has a patch with axes="xyz".

Quantity: e = (J (1 / m + a^2 / I) - T a b / I) / v - 1 of the impulses J across and T along the plane, with the centre
of mass a beside and b above the contact; number of contacts, their end, peak force, impulse.
Limits: all contacts counted; e within 0.012; peak force within 2 %; impulse within 1 %; the energy in the balance 1e-3.
With friction 0.1: e within 0.02, and the impulse along the plane within 0.02 of that across it.

Beam theory is of the order (diameter over wave length) squared: at the 20 kHz of these pulses 0.5 %.

    python -m validation.experiments.tilted_bar [--quick] [--out JSON]
"""

import json
import time
import warnings
from pathlib import Path

import exudyn as exu
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep
from validation.experiments import beam_theory, common

DATA = common.data("tilted_bar")
BAR = DATA["setup"]
DIAMETER, SPEED = BAR["diameter_m"], BAR["speed_m_s"]
RADIUS = DIAMETER / 2
STEEL = ep.Material(E=BAR["E_Pa"], nu=BAR["nu"], rho=BAR["rho_kg_m3"])
CURVES = Path(__file__).resolve().parents[2] / "examples" / "restitution_map_theory.json"
FRICTION, REACH = 0.1, 1.3  # REACH: of the patch with friction, in contact radii, beside an element
LIMITS = {"contacts": 0, "e": 0.012, "peak": 0.02, "impulse": 0.01, "balance": 1e-3,
          "e, friction": 0.02, "tangential impulse": 0.02}  # fmt: skip


def shape(length, angle):
    """The bar with its lower tip at the origin."""
    along = occ.Dir(np.cos(angle), 0, np.sin(angle))
    ends = [occ.Pnt(0, 0, RADIUS), occ.Pnt(length * np.cos(angle), 0, RADIUS + length * np.sin(angle))]
    return occ.Cylinder(ends[0], along, RADIUS, length) + occ.Sphere(ends[0], RADIUS) + occ.Sphere(ends[1], RADIUS)


def inertia(length):
    """Mass [kg] and moment of inertia across the bar [kg m2]."""
    cylinder, half = STEEL.rho * np.pi * RADIUS**2 * length, STEEL.rho * 2 / 3 * np.pi * RADIUS**3
    beyond = 3 / 8 * RADIUS  # of the centre of a half ball, from the end of the cylinder
    caps = 2 * half * (0.4 * RADIUS**2 - beyond**2 + (length / 2 + beyond) ** 2)
    return cylinder + 2 * half, cylinder * (length**2 / 12 + RADIUS**2 / 4) + caps


def restitution(impulse, along, length, angle):
    """Newton's coefficient for the rigid part of the tip's normal velocity, from both impulses."""
    mass, moment = inertia(length)
    beside, above = length / 2 * np.cos(angle), length / 2 * np.sin(angle) + RADIUS  # of the centre, from the contact
    return float((impulse * (1 / mass + beside**2 / moment) - along * beside * above / moment) / SPEED - 1)


def by_beam_theory(length, angle, friction=0.0, end=1e-3, highest=400e3, step=2e-8, elements=80):
    """Impact of the beam's and the rod's modes on the tip's Hertz spring; the half balls are rigid."""
    section = beam_theory.circle(STEEL, DIAMETER)
    bending = beam_theory.bending(section, length, elements)
    rod = beam_theory.stretching(section, length, elements)
    half = STEEL.rho * 2 / 3 * np.pi * RADIUS**3
    for node, side in ((0, -1), (elements, 1)):
        at, moment = slice(2 * node, 2 * node + 2), side * half * 3 / 8 * RADIUS
        bending[1][at, at] += [[half, moment], [moment, half * 0.4 * RADIUS**2]]
        rod[1][node, node] += half
    (bend, bends), (stretch, stretches) = (beam_theory.modes(*one, 2 * np.pi * highest) for one in (bending, rod))
    sin, cos = np.sin(angle), np.cos(angle)
    # The tip's centre moves across the beam by (-sin, cos) and along it by (cos, sin); friction acts a radius below.
    normal = np.r_[cos * bends[0], sin * stretches[0]]
    along = np.r_[-sin * bends[0] + RADIUS * bends[1], cos * stretches[0]]
    start = np.zeros(len(bends))
    start[::2] = -SPEED * cos
    speeds = np.r_[bends.T @ bending[1] @ start, stretches.T @ rod[1] @ np.full(elements + 1, -SPEED * sin)]
    hertz = 4 / 3 * STEEL.E / (1 - STEEL.nu**2) * np.sqrt(RADIUS)
    ratio = 2 * (1 - STEEL.nu) / (2 - STEEL.nu)  # Mindlin's
    return beam_theory.impact(
        np.r_[bend, stretch], normal, speeds, hertz, end, step, along=along, friction=friction, ratio=ratio
    )


def run(body, end, step, friction=None):
    """One impact: what is compared, and the force over time."""
    mbs = exu.SystemContainer().AddSystem()
    bar = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -SPEED], frame="inertial", name="bar")
    contact = ep.CreatePartitionContact(mbs, bar, ep.RigidPlane(), passes="given", friction=friction, name="plane")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=end, step=step)
    force, energy = contact.force(result), bar.energy(result) + contact.energy(result)
    impacts = contact.impacts(result)
    along = 0.0
    if friction:
        along = float(np.trapezoid(contact.friction.tangential_force(result)[:, 0], result.t))
        energy = energy + contact.dissipated_energy(result)
    return {
        "contacts": len(impacts),
        "end_us": 1e6 * impacts[-1].end,
        "peak_N": float(force.max()),
        "impulse_Ns": float(np.trapezoid(force, result.t)),
        "along_Ns": along,
        "balance": float(abs(energy / energy[0] - 1).max()),
        "online_s": result.time_s,
        "dofs": body.n_dofs,
    }, (result.t, force)


def compare(length, degrees):
    """Compare with beam theory, without and with friction."""
    angle, begin = np.radians(degrees), time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ep.errors.YieldWarning)  # compared with elastic beams
        design = ep.design_impact((shape(length, angle), STEEL), ep.RigidPlane(), speed=SPEED, contact=(0, 0, 0))
        offline = time.perf_counter() - begin
        smooth, curve = run(design.bodies[0], design.duration, design.step)
        fem = design.fems[0]
        part = ep.Partition.ball(fem, (0, 0, 0), REACH * design.look.circle + design.look.sizes[0].near, axes="xyz")
        begin = time.perf_counter()
        body = ep.reduce(fem, part, f_cut=design.bodies[0].f_cut)
        rough_offline = time.perf_counter() - begin
        rough, _ = run(body, design.duration, design.step, FRICTION)
    found = []
    for friction, ours, seconds in ((0.0, smooth, offline), (FRICTION, rough, rough_offline)):
        theory = by_beam_theory(length, angle, friction, design.duration)
        both = (ours["impulse_Ns"], ours["along_Ns"]), (theory.impulse, theory.impulse_along)
        e, e_theory = (restitution(*impulses, length, angle) for impulses in both)
        found.append({
            "length_mm": 1e3 * length, "degrees": degrees, "friction": friction,
            "e": e, "e_theory": e_theory, "e_error": e - e_theory,
            "contacts": ours["contacts"], "contacts_theory": len(theory.contacts()),
            "end_us": ours["end_us"], "end_theory_us": 1e6 * theory.contacts()[-1][1],
            "peak_N": ours["peak_N"], "peak_error": ours["peak_N"] / theory.force.max() - 1,
            "impulse_error": ours["impulse_Ns"] / theory.impulse - 1,
            "along": ours["along_Ns"] / ours["impulse_Ns"], "along_theory": theory.impulse_along / theory.impulse,
            "balance": ours["balance"], "dofs": ours["dofs"], "offline_s": seconds, "online_s": ours["online_s"],
        })  # fmt: skip
    return found, (curve, by_beam_theory(length, angle, end=design.duration))


def worst(rows, stored):
    """Largest errors, against beam theory and against the stored numbers, which another program gave."""
    smooth, rough = ([row for row in rows if bool(row["friction"]) == kind] for kind in (False, True))
    table = [abs(ours["e"] - row["e"]) for ours, row in zip(smooth, stored, strict=True)]
    return {
        "contacts": sum(abs(row["contacts"] - row["contacts_theory"]) for row in rows)
        + sum(abs(ours["contacts"] - row["contacts"]) for ours, row in zip(smooth, stored, strict=True)),
        "e": max(*(abs(row["e_error"]) for row in smooth), *table),
        "peak": max(abs(row["peak_error"]) for row in rows),
        "impulse": max(abs(row["impulse_error"]) for row in smooth),
        "balance": max(row["balance"] for row in rows),
        "e, friction": max(abs(row["e_error"]) for row in rough),
        "tangential impulse": max(abs(row["along"] - row["along_theory"]) for row in rough),
    }


def draw(path, rows, curves):
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    for color, length in enumerate(sorted({row["length_mm"] for row in rows})):
        angles = np.arange(5, 86, 1.0)
        impacts = [by_beam_theory(1e-3 * length, np.radians(a), end=0.8e-3, step=5e-8, elements=40) for a in angles]
        e = [
            restitution(one.impulse, 0.0, 1e-3 * length, np.radians(a)) for a, one in zip(angles, impacts, strict=True)
        ]
        left.plot(angles, e, f"C{color}-", lw=1, label=f"beam theory, {length:g} mm")
        for friction, marker in ((0.0, "o"), (FRICTION, "x")):
            ours = [row for row in rows if (row["length_mm"], row["friction"]) == (length, friction)]
            label = f"this library, friction {friction:g}"
            left.plot([r["degrees"] for r in ours], [r["e"] for r in ours], f"C{color}{marker}", label=label)
    left.set(xlabel="tilt from the plane [degrees]", ylabel="coefficient of restitution", ylim=(0, 1))
    left.legend(fontsize=7)
    (length, degrees), ((t, force), theory) = max(curves.items(), key=lambda item: len(item[1][1].contacts()))
    right.plot(1e6 * theory.t, theory.force, "k-", lw=2.5, alpha=0.3, label="beam theory")
    right.plot(1e6 * t, force, "C3-", lw=1, label="this library")
    end = 1.1e6 * theory.contacts()[-1][1]
    right.set(xlabel="time [µs]", ylabel="force [N]", xlim=(0, end), title=f"{1e3 * length:g} mm, {degrees:g} degrees")
    right.legend()
    figure.savefig(path, dpi=110)


def write_curves():
    """Write restitution by beam theory over the tilt, for three lengths, which an example draws beside its own."""
    tilts, curves = np.arange(8, 87, 1.0), {}
    for length in (0.1, 0.2, 0.3):
        impacts = [by_beam_theory(length, np.radians(a), end=1.5e-3, step=5e-8, elements=40) for a in tilts]
        e = [restitution(one.impulse, 0.0, length, np.radians(a)) for a, one in zip(tilts, impacts, strict=True)]
        curves[f"{1e3 * length:.0f} mm"] = [round(value, 4) for value in e]
    CURVES.write_text(json.dumps({"source": "validation/experiments/tilted_bar.py", "tilt": tilts.tolist(), **curves}))


def main():
    given = common.options(__doc__, "two of the seven tilts")
    stored = DATA["rows"][:2] if given.quick else DATA["rows"]
    rows, curves = [], {}
    for row in stored:
        found, curves[row["length_m"], row["degrees"]] = compare(row["length_m"], row["degrees"])
        rows += found
        print(found, flush=True)
    common.show("tilted bar", rows)
    if not given.quick:
        write_curves()
    common.finish(__file__, {"rows": rows}, worst(rows, stored), LIMITS, given, lambda path: draw(path, rows, curves))


if __name__ == "__main__":
    main()
