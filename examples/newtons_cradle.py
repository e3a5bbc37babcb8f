"""Balls in a row, the first of which moves: Newton's cradle, with one reduced body used several times.

Every ball has two contact patches. The results are compared with point masses between Hertz springs, an equation that
SciPy solves. Schoolbooks say that the last ball takes all of the velocity. If the balls touch at the start it does not,
because it leaves before the others have come to rest.
"""

import argparse
import json
from pathlib import Path

import exudyn as exu
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np
from scipy.integrate import solve_ivp

import exudyn_partition as ep

R, SPEED = 0.010, 0.5  # [m], [m/s]
POLES = {"back": (-R, 0, 0), "front": (R, 0, 0)}


def reduced_ball(h):
    """One ball around the origin with a patch at either pole, reduced; and its FE model."""
    shape = occ.Sphere(occ.Pnt(0, 0, 0), R)
    fem = ep.fe_model(shape, ep.STEEL, maxh=R / 3, refine=[ep.Refine(pole, 0.35e-3, h) for pole in POLES.values()])
    back, front = (ep.Partition.ball(fem, pole, radius=0.6e-3, name=name) for name, pole in POLES.items())
    return ep.reduce(fem, back | front, f_cut=200e3), fem


def hertz_chain(mass, balls, t):
    """Forces, (n, balls - 1) [N], and velocities, (n, balls) [m/s], of touching point masses between Hertz springs."""
    stiffness = 4 / 3 * ep.STEEL.plane_strain_modulus / 2 * np.sqrt(R / 2)

    def forces(x):
        return stiffness * np.maximum(x[:-1] - x[1:], 0) ** 1.5

    def rates(_, state):
        x, v = state.reshape(2, -1)
        return np.r_[v, np.diff(np.r_[0, -forces(x), 0]) / mass]

    start = np.zeros(2 * balls)
    start[balls] = SPEED
    x, v = solve_ivp(rates, (0, t[-1]), start, t_eval=t, rtol=1e-9, atol=1e-14).y.reshape(2, balls, -1)
    return np.array([forces(state) for state in x.T]), v.T


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--balls", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="coarser mesh")
    parser.add_argument("--out", type=Path, default=Path("out/newtons_cradle"), metavar="DIR")
    options = parser.parse_args(argv)

    body, fem = reduced_ball(0.12e-3 if options.quick else 0.08e-3)

    # The same reduced body is placed several times. Each patch has a name.
    mbs = exu.SystemContainer().AddSystem()
    balls = []
    for i in range(options.balls):
        place, velocity = [2 * R * i, 0, 0], [0 if i else SPEED, 0, 0]
        balls.append(
            ep.CreatePartitionBody(mbs, body, name=f"ball {i + 1}", referencePosition=place, initialVelocity=velocity)
        )
    contacts = ep.CreatePartitionContact(mbs, balls, name="contact")  # between all patches that face each other nearby
    mbs.Assemble()
    alone = ep.hertz.impact(body.total_mass / 2, SPEED, R, R, ep.STEEL, ep.STEEL)
    run = ep.solve_dynamic(mbs, end_time=alone.duration * options.balls)

    force = np.column_stack([contact.force(run) for contact in contacts])
    velocity = np.column_stack([ball.momentum(run)[:, 0] for ball in balls]) / body.total_mass
    expected_force, expected_velocity = hertz_chain(body.total_mass, options.balls, run.t)
    energy = sum(item.energy(run) for item in (*balls, *contacts))
    result = {
        "dofs": body.n_dofs * options.balls,
        "fe_dofs": fem.n_dofs * options.balls,
        "step_s": run.step,
        "steps": run.steps,
        "time": {"reduce_s": body.reduce_s, "online_s": run.time_s},
        "peak_force_N": force.max(axis=0).tolist(),
        "velocity_after_m_per_s": velocity[-1].tolist(),
        "error": {
            "force": float(np.linalg.norm(force - expected_force) / np.linalg.norm(expected_force)),
            "velocity_after": float(abs(velocity[-1] - expected_velocity[-1]).max() / SPEED),
        },
        "momentum_error": float(np.ptp(velocity.sum(axis=1)) / SPEED),
        "energy_error": float(energy[-1] / energy[0] - 1),
        "left_out": [*body.left_out, *contacts[0].left_out],
        "versions": ep.versions(),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))

    figure, (above, below) = plt.subplots(2, sharex=True, figsize=(7, 6), layout="constrained")
    for panel, ours, theirs, names in (
        (above, force, expected_force, [contact.name for contact in contacts]),
        (below, velocity, expected_velocity, [ball.name for ball in balls]),
    ):
        panel.plot(1e6 * run.t, ours, label=names)
        panel.plot(1e6 * run.t, theirs[:, 0], "k--", linewidth=1, label="masses and Hertz springs")
        panel.plot(1e6 * run.t, theirs[:, 1:], "k--", linewidth=1)
        panel.grid(alpha=0.3)
        panel.legend(loc="center right")
    above.set(ylabel="contact force [N]")
    below.set(ylabel="velocity of the centre of mass [m/s]", xlabel="time [µs]")
    figure.savefig(picture := options.out / "newtons_cradle.png", dpi=150)
    middle = run.t[velocity[:, options.balls // 2].argmax()]  # when that ball is fastest
    look = {"colour": "von_mises", "end": 5e6, "scale": 1, "direction": (0, -1, 0)}
    axes = ep.plot.bodies(run, middle, [(ball, fem) for ball in balls], **look)
    axes.figure.savefig(options.out / "bodies.png", dpi=150)
    run.scene(options.out / "moving.html", title="Newton's cradle")
    print(json.dumps({key: result[key] for key in ("dofs", "fe_dofs", "time", "velocity_after_m_per_s", "error")}))
    print(picture.resolve())
    return result


if __name__ == "__main__":
    main()
