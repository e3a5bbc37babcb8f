"""Two steel balls collide: the shortest way from shapes to contact forces, checked against Hertz.

Hertz's theory replaces the balls by half spaces, and has no waves. Both are nearly true here. So the reduced balls must
give Hertz's force within 1 %, because whole balls are stiffer by that much. They must also give Hertz's duration and
pressure, and they must swap their velocities.
"""

import argparse
import json
import time
from pathlib import Path

import exudyn as exu
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

R = 0.010  # [m]


def ball(side, h):
    """FE model of a ball above (side 1) or below (side -1) the origin, and its partition; h [m] is fine enough there.

    One patch reaches further than the other, so that every node of the smaller one finds a partner.
    """
    shape = occ.Sphere(occ.Pnt(0, 0, side * R), R)
    fem = ep.fe_model(shape, ep.STEEL, maxh=R / 3, refine=[ep.Refine((0, 0, 0), radius=0.35e-3, h=h)])
    return fem, ep.Partition.ball(fem, center=(0, 0, 0), radius=0.45e-3 if side == 1 else 0.6e-3)


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--speed", type=float, default=0.5, metavar="M/S")
    parser.add_argument("--quick", action="store_true", help="coarser meshes")
    parser.add_argument("--out", type=Path, default=Path("out/two_spheres"), metavar="DIR")
    options = parser.parse_args(argv)

    # 1. Before any mesh: Hertz's answer for two balls of this mass.
    mass = 4 / 3 * np.pi * R**3 * ep.STEEL.rho
    hertz = ep.hertz.impact(ep.hertz.effective(mass, mass), options.speed, R, R, ep.STEEL, ep.STEEL)

    # 2. FE models, off-line. Motion faster than f_cut is kept as a static answer. The pulse of 70 us needs far less.
    begin = time.perf_counter()
    models = [ball(side, 0.13e-3 if options.quick else 0.07e-3) for side in (1, -1)]
    fem_s = time.perf_counter() - begin
    bodies = [ep.reduce(fem, partition, f_cut=200e3) for fem, partition in models]
    print(bodies[0].table())

    # 3. An ordinary Exudyn model, with two partition bodies and their contact.
    mbs = exu.SystemContainer().AddSystem()
    upper = ep.CreatePartitionBody(mbs, bodies[0], name="upper", initialVelocity=[0, 0, -options.speed])
    lower = ep.CreatePartitionBody(mbs, bodies[1], name="lower")
    contact = ep.CreatePartitionContact(mbs, upper, lower, name="contact")
    mbs.Assemble()
    run = ep.solve_dynamic(mbs, end_time=1.3 * hertz.duration)

    # 4. Histories are arrays over run.t.
    force = contact.force(run)
    energy = upper.energy(run) + lower.energy(run) + contact.energy(run)
    momentum = upper.momentum(run) + lower.momentum(run)
    history = run.history(contact)
    at_peak = run.at([run.t[force.argmax()]])
    result = {
        "dofs": sum(body.n_dofs for body in bodies),
        "fe_dofs": sum(fem.n_dofs for fem, _ in models),
        "modes": [body.n_shapes - 6 for body in bodies],
        "contact_nodes": contact.n_rows,
        "step_s": run.step,
        "steps": run.steps,
        "time": {"fem_s": fem_s, "reduce_s": sum(body.reduce_s for body in bodies), "online_s": run.time_s},
        "peak_force_N": history.peak_force,
        "contact_duration_s": history.contact_duration,
        "impulse_Ns": history.impulse,
        "contact_radius_m": float(contact.radius(at_peak)[0]),
        "hertz": {"peak_force_N": hertz.peak_force, "duration_s": hertz.duration, "radius_m": hertz.contact_radius},
        "error": {
            "peak_force": history.peak_force / hertz.peak_force - 1,
            "duration": history.contact_duration / hertz.duration - 1,
            "velocity_after": float(lower.momentum(run)[-1, 2] / (lower.body.total_mass * -options.speed)) - 1,
        },
        "momentum_error": float(np.ptp(momentum[:, 2]) / abs(momentum[0, 2])),
        "energy_error": float(energy[-1] / energy[0] - 1),
        "left_out": [*bodies[0].left_out, *contact.left_out],
        "versions": ep.versions(),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))

    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    ep.plot.force(axes[0], run)
    axes[0].plot(1e3 * hertz.t, hertz.force, "k--", label="Hertz")
    axes[0].legend(loc="upper right", fontsize="small")
    r, p = np.linspace(0, hertz.contact_radius, 200), 1.5 * hertz.peak_force / (np.pi * hertz.contact_radius**2)
    slave, number = contact.sides[0]
    patch = slave.body.partition.patches[number]
    corners = np.unique(patch.facets[:, :3])  # pressures are means around corners
    pressure = contact.pressure(at_peak).toarray()[0, np.searchsorted(patch.nodes, corners)]
    distance = np.linalg.norm(slave.body.points[corners, :2], axis=1)
    axes[1].plot(1e3 * distance, 1e-6 * pressure, "o", markersize=3, label="around the mesh's corners")
    axes[1].plot(1e3 * r, 1e-6 * p * np.sqrt(1 - (r / r[-1]) ** 2), "k--", label="Hertz")
    axes[1].set(xlabel="distance from the axis [mm]", ylabel="pressure at the peak of the force [MPa]")
    axes[1].grid(alpha=0.3)
    axes[1].legend(loc="upper right")
    ep.plot.energy(axes[2], run)
    figure.savefig(picture := options.out / "two_spheres.png", dpi=150)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 5), layout="compressed")
    shown, look = [(upper, models[0][0]), (lower, models[1][0])], {"colour": "von_mises", "scale": 1}
    ep.plot.bodies(run, bodies=shown, axes=left, end=10e6, direction=(0, -1, 0), **look)
    ep.plot.bodies(run, bodies=shown[1:], axes=right, end=1e9, direction=(0, 0, 1), **look)
    right.set(xlim=(-1, 1), ylim=(-1, 1), title="the lower ball alone, where it is touched")
    figure.savefig(options.out / "bodies.png", dpi=150, bbox_inches="tight")
    print(json.dumps({key: result[key] for key in ("dofs", "fe_dofs", "time", "error")}), picture.resolve(), sep="\n")
    return result


if __name__ == "__main__":
    main()
