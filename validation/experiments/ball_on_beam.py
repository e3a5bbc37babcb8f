"""A steel ball falls on the middle of a simply supported steel beam: contacts, forces, restitution (Timoshenko 1913).

Timoshenko put a Hertz spring in series with the modes of a beam. The reference does so with modes of a Timoshenko beam,
`beam_theory.py`, and with the numbers of `data/ball_on_beam.json`, which another program gave. Meshes and cuts are
those that `ep.design_impact` gives for ball and free beam and 1 %. The supports are averaged interfaces of the end
faces, held by joints, which the beam's reduction knows.

Quantity: start, end and peak force of the first two contacts; restitution of the small ball, which touches once.
Limits: peak forces within 2 %; ends, and the second start, within 2 %; restitution within 0.012; energy 1e-3.

Later contacts depend on the beam model: the second one begins at a phase of the bending vibration that a difference of
1 % in a frequency moves. Beam theory is of the order (height over wave length) squared, and has no local bending of
the section beneath the ball.

    python -m validation.experiments.ball_on_beam [--quick] [--out JSON]
"""

import time
import warnings

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep
from validation.experiments import beam_theory, common

DATA = common.data("ball_on_beam")
SETUP = DATA["setup"]
STEEL = ep.Material(E=SETUP["E_Pa"], nu=SETUP["nu"], rho=SETUP["rho_kg_m3"])
SIDE, SPEED = SETUP["side_m"], SETUP["speed_m_s"]
LIMITS = {"peak": 0.02, "times": 0.02, "e": 0.012, "balance": 1e-3, "first contacts": 0}


def by_beam_theory(length, radius, end, highest=400e3, step=1e-7, elements=80):
    """Impact of the ball on the modes of the beam: one more mode is the ball itself."""
    stiffness, mass = beam_theory.bending(beam_theory.square(STEEL, SIDE), length, elements)
    free = np.delete(np.arange(len(stiffness)), [0, 2 * elements])
    omega, shapes = beam_theory.modes(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)], 2 * np.pi * highest)
    middle = shapes[np.flatnonzero(free == elements)[0]]
    ball = STEEL.rho * 4 / 3 * np.pi * radius**3
    normal = np.r_[-middle, 1 / np.sqrt(ball)]
    speeds = np.r_[np.zeros(len(omega)), -SPEED * np.sqrt(ball)]
    hertz = 4 / 3 * STEEL.E / (2 * (1 - STEEL.nu**2)) * np.sqrt(radius)
    return beam_theory.impact(np.r_[omega, 0.0], normal, speeds, hertz, end, step), ball


def ends(length):
    """Middles of the end faces, where the supports are [m]."""
    return {"left": (-length / 2, 0, -SIDE / 2), "right": (length / 2, 0, -SIDE / 2)}


def bodies(length, radius):
    """Ball and beam, the beam with interfaces at its ends; what the reduction took [s]."""
    begin = time.perf_counter()
    ball = occ.Sphere(occ.Pnt(0, 0, radius), radius)
    beam = occ.Box(occ.Pnt(-length / 2, -SIDE / 2, -SIDE), occ.Pnt(length / 2, SIDE / 2, 0))
    design = ep.design_impact((ball, STEEL), (beam, STEEL), speed=SPEED, contact=(0, 0, 0))
    fem, part = design.fems[1], design.partitions[1]
    for name, end in ends(length).items():
        part |= ep.Partition.interface(fem, name, plane=(end, (end[0], 0, 0)), kind="averaged", position=end)
    held = ep.reduce(fem, part, f_cut=design.bodies[1].f_cut)
    return (design.bodies[0], held), time.perf_counter() - begin


def run(pair, length, end):
    """The impact: contacts, restitution, balance, and the force over time."""
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, pair[0], initialVelocity=[0, 0, -SPEED], frame="inertial", name="ball")
    beam = ep.CreatePartitionBody(mbs, pair[1], frame="inertial", name="beam")
    ground = mbs.CreateGround()
    for (name, place), axes in zip(ends(length).items(), ([1, 1, 1, 1, 0, 0], [0, 1, 1, 0, 0, 0]), strict=True):
        fixed = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=place))
        joint = [fixed, beam.CreateInterfaceMarker(mbs, name)]
        mbs.AddObject(items.GenericJoint(markerNumbers=joint, constrainedAxes=axes))
    contact = ep.CreatePartitionContact(mbs, ball, beam, passes="given")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=end)
    force, energy = contact.force(result), sum(item.energy(result) for item in (ball, beam, contact))
    return {
        "contacts": [(one.start, one.end, one.peak) for one in contact.impacts(result)],
        "velocity": float(ball.momentum(result)[-1, 2] / pair[0].total_mass),
        "balance": float(abs(energy / energy[0] - 1).max()),
        "dofs": sum(body.n_dofs for body in pair),
        "online_s": result.time_s,
    }, (result.t, force)


def compare(row):
    length, radius = row["length_m"], row["radius_m"]
    theory, mass = by_beam_theory(length, radius, row["until_s"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ep.errors.YieldWarning)  # compared with elastic bodies
        pair, offline = bodies(length, radius)
        ours, curve = run(pair, length, row["until_s"])
    of_theory, count = theory.contacts(), len(row["contacts"])
    found = {"length_mm": 1e3 * length, "radius_mm": 1e3 * radius, "offline_s": offline, **ours}
    found["e"] = found.pop("velocity") / SPEED
    found["e_theory"] = theory.impulse / (mass * SPEED) - 1
    found["contacts_theory"] = of_theory
    pairs = [*zip(ours["contacts"][:count], of_theory[:count], strict=True)]
    pairs += zip(ours["contacts"][:count], row["contacts"], strict=True)
    found["peak_error"] = max(abs(a[2] / b[2] - 1) for a, b in pairs)
    found["times_error"] = max(abs(a[i] / b[i] - 1) for a, b in pairs for i in (0, 1) if b[i] > 1e-6)
    return found, curve, theory


def draw(path, runs):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(runs), figsize=(5.5 * len(runs), 4), layout="constrained", squeeze=False)
    for ax, (row, (t, force), theory) in zip(axes[0], runs, strict=True):
        ax.plot(1e6 * theory.t, theory.force, "k-", lw=2.5, alpha=0.3, label="Timoshenko beam, Hertz")
        ax.plot(1e6 * t, force, "C3-", lw=1, label="this library")
        title = f"beam of {row['length_mm']:g} mm, ball of {row['radius_mm']:g} mm radius"
        ax.set(xlabel="time [µs]", ylabel="force [N]", title=title)
        ax.legend()
    figure.savefig(path, dpi=110)


def main():
    given = common.options(__doc__, "the short beam only")
    stored = DATA["rows"][:1] if given.quick else DATA["rows"]
    runs = [compare(row) for row in stored]
    rows = [run[0] for run in runs]
    common.show("ball on beam", [{k: v for k, v in row.items() if "contacts" not in k} for row in rows])
    print(rows)
    found = {
        "peak": max(row["peak_error"] for row in rows),
        "times": max(row["times_error"] for row in rows),
        "e": abs(rows[0]["e"] - rows[0]["e_theory"]),
        "balance": max(row["balance"] for row in rows),
        "first contacts": abs(len(rows[0]["contacts"]) - 1),
    }
    common.finish(__file__, {"rows": rows}, found, LIMITS, given, lambda path: draw(path, runs))


if __name__ == "__main__":
    main()
