"""An eccentric cam lifts a spring-loaded follower, faster and faster, until the follower leaves it.

The whole rim of the cam and the whole face of the follower are contact patches (`ep.Partition.surface`), so that
contact wanders around the cam. `ep.solve_static` lets the spring press the follower on the cam; then the shaft speeds
up from rest. Up to the lift-off speed, the force is that of rigid
bodies and a spring. Beyond it, the follower flies over the top of the cam and comes down hard. The model is
models/cam_follower.py.
"""

import argparse
import json
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import exudyn_partition as ep
from models import cam_follower as model
from models import cam_follower_parts as shapes

MESH, QUICK_MESH = (1e-3, 1.5e-3, 4e-3, 10e-3), (2.5e-3, 4e-3, 6e-3, 20e-3)  # rim, face, inside of cam and follower [m]


def summary(mechanism, run, lift_off):
    """Main numbers of the run, for result.json."""
    force, rigid = mechanism.contact.force(run), mechanism.rigid_force(run.t)
    speed = mechanism.drive.turn(run.t)[1]
    slow, parted = speed < 0.5 * lift_off, np.flatnonzero(force <= 0)
    bodies = [mechanism.cam.body, mechanism.follower.body]
    return {
        "status": run.status,
        "dofs": sum(body.n_dofs for body in bodies),
        "fe_dofs": sum(body.fe_dofs for body in bodies),
        "modes": [body.n_shapes - 6 for body in bodies],
        "contact_nodes": mechanism.contact.n_rows,
        "step_s": run.step,
        "steps": run.steps,
        "preload_N": float(force[0]),
        "lift_off_speed_rad_s": lift_off,
        "parts_at_rad_s": float(speed[parted[0]]) if len(parted) else None,
        "error.force": float(np.linalg.norm((force - rigid)[slow]) / np.linalg.norm(rigid[slow])),
        "peak_force_N": float(force.max()),
        "left_out": [*bodies[0].left_out, *mechanism.contact.left_out],
        "versions": ep.versions(),
    }


def draw(mechanism, run, lift_off):
    """Force over time, whole and without the peaks, and the shaft's speed."""
    fig, (whole, above, below) = plt.subplots(3, 1, figsize=(9, 9), sharex=True, layout="constrained")
    turn, speed, _ = mechanism.drive.turn(run.t)
    rigid, t = mechanism.rigid_force(run.t), 1e3 * run.t
    for panel in (whole, above):
        panel.plot(t, mechanism.contact.force(run) / 1e3, lw=0.8, label="flexible bodies in contact")
        panel.plot(t, rigid / 1e3, "k--", lw=1, label="rigid bodies that cannot part")
        panel.axhline(0, color="0.7", lw=0.8)
    low, high = 1.2e-3 * min(rigid.min(), 0) - 0.2, 1.8e-3 * rigid.max()
    whole.set(ylabel="contact force [kN]")
    above.set(ylabel=f"the same up to {high:.2g} kN", ylim=(low, high))
    whole.legend(fontsize="small", loc="upper left")
    below.plot(t, speed / lift_off, label="speed of the shaft, by the lift-off speed")
    below.plot(t, turn / (2 * np.pi), label="turns")
    below.axhline(1, color="0.7", lw=0.8)
    below.set(xlabel="time [ms]")
    below.legend(fontsize="small")
    return fig


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--turns", type=float, default=4.0, help="how far the cam turns while it speeds up")
    parser.add_argument(
        "--fastest", type=float, default=1.2, help="last speed, by that at which the follower lifts off"
    )
    parser.add_argument("--step", type=float, default=2e-5, metavar="S")
    parser.add_argument("--quick", action="store_true", help="coarse meshes, a slow fifth of a turn")
    parser.add_argument("--out", type=Path, default=Path("out/cam_follower"), metavar="DIR")
    options = parser.parse_args(argv)
    rim, face, in_cam, in_follower = QUICK_MESH if options.quick else MESH
    turns, fastest = (0.2, 0.06) if options.quick else (options.turns, options.fastest)

    clock = [time.perf_counter()]
    parts = shapes.cam_part(rim, in_cam), shapes.follower_part(face, in_follower)
    clock.append(time.perf_counter())
    bodies = [ep.reduce(*part, f_cut=shapes.F_CUT) for part in parts]
    clock.append(time.perf_counter())
    lift_off = float(model.lift_off_speed(bodies[1].total_mass))
    ramp = 2 * turns * 2 * np.pi / (fastest * lift_off)
    mechanism = model.mechanism(*bodies, fastest * lift_off, ramp)
    run = model.run(mechanism, ramp, 2e-4 if options.quick else options.step)

    times = {"fem_s": clock[1] - clock[0], "reduce_s": clock[2] - clock[1], "online_s": run.time_s}
    result = {"time": times, **summary(mechanism, run, lift_off)}
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    picture = options.out / "cam_follower.png"
    draw(mechanism, run, lift_off).savefig(picture, dpi=120)
    shown = [(mechanism.cam, parts[0][0]), (mechanism.follower, parts[1][0])]
    axes = ep.plot.bodies(run, bodies=shown, colour="von_mises", direction=(0, -0.3, 1))  # nearly along the shaft
    axes.figure.savefig(options.out / "bodies.png", dpi=150)
    run.scene(options.out / "moving.html", title="cam and follower")
    for key in ("dofs", "fe_dofs", "contact_nodes", "steps", "lift_off_speed_rad_s", "parts_at_rad_s", "error.force"):
        print(f"{key}: {result[key]}")
    print(picture.resolve())
    return result


if __name__ == "__main__":
    main()
