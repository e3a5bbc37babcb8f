"""A ball bearing of 12 balls under a radial load, at rest and while its cage turns.

The balls are elastic, one reduced body used 12 times in floating frames; shaft and outer race are rigid. First the
shaft is pressed down (`ep.solve_static`). Then the cage turns: balls enter and leave the loaded zone, and the shaft
sways with each of them. Forces and sway are compared with those of Hertz springs between the races. The model is
models/ball_bearing.py, the theory models/ball_bearing_theory.py.
"""

import argparse
import json
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import exudyn_partition as ep
from models import ball_bearing as model
from models import ball_bearing_theory as theory

SPEED, RISE = 100.0, 1e-3  # of the cage [rad/s], time until it turns with that [s]
MESH, QUICK_MESH = (0.10e-3, 0.5e-3), (0.16e-3, 0.42e-3)  # elements at the poles, radius of the patches there [m]


def draw(bearing, moving, forces, by_springs, sway):
    """Figure of the balls' forces by their angle, and of the shaft's sway over time."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    angle = np.degrees(bearing.angles[:, None] + [bearing.turn(t) for t in moving.t]) + 90
    angle = (angle + 180) % 360 - 180  # from the direction of the load
    left.plot(angle.ravel(), forces.ravel(), ".", ms=2, color="0.5", label="elastic balls, all times")
    left.plot(angle[:, 0], by_springs[:, 0], "k+", label="Hertz springs, at rest")
    left.set(xlabel="angle from the load [degrees]", ylabel="force of a ball [N]", xlim=(-100, 100))
    for axis, name, colour in ((0, "across the load", "C0"), (1, "along the load", "C3")):
        for ways, by, line in zip(sway, ("elastic balls", "Hertz springs"), ("-", "--"), strict=True):
            way = 1e6 * (ways[:, axis] - ways[0, axis])
            right.plot(1e3 * moving.t, way, colour + line, label=f"{name}, {by}")
    right.set(xlabel="time [ms]", ylabel="sway of the shaft [µm]", ymargin=0.2)  # room for the legend
    left.legend(fontsize="small")
    right.legend(fontsize="small", ncols=2, loc="upper center")
    return figure


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--load", type=float, default=2000.0, metavar="N")
    parser.add_argument("--clearance", type=float, default=2e-6, metavar="M", help="along the diameter")
    parser.add_argument("--quick", action="store_true", help="a coarse mesh, a tenth of a pitch")
    parser.add_argument("--out", type=Path, default=Path("out/ball_bearing"), metavar="DIR")
    options = parser.parse_args(argv)
    end_time, step = (0.8e-3, 2e-4) if options.quick else (11e-3, 5e-5)

    begin = time.perf_counter()
    fem, part = model.ball_part(*(QUICK_MESH if options.quick else MESH))
    fem_s = time.perf_counter() - begin
    body = ep.reduce(fem, part, f_cut=model.F_CUT)
    bearing = model.bearing(body, options.load, options.clearance, model.Turn(SPEED, RISE))
    pressed, moving = model.run(bearing, end_time, step)

    forces = np.array([contact.force(moving) for contact in bearing.inner])
    turns = np.array([bearing.turn(t) for t in moving.t])
    expected = [theory.equilibrium(options.load, options.clearance, bearing.angles + turn) for turn in turns]
    places, by_springs = np.array([place for place, _ in expected]), np.array([own for _, own in expected]).T
    place = bearing.mbs.GetSensorStoredData(bearing.place)
    shaft = np.column_stack([np.interp(moving.t, place[:, 0], place[:, axis]) for axis in (1, 2)])
    at_rest = np.array([contact.force(pressed)[-1] for contact in bearing.inner])
    result = {
        "balls": model.BALLS,
        "dofs": model.BALLS * body.n_dofs,
        "fe_dofs": model.BALLS * fem.n_dofs,
        "contact_nodes": sum(contact.n_rows for contact in bearing.inner + bearing.outer),
        "peak_force_N": float(at_rest.max()),
        "stribeck": float(at_rest.max() * model.BALLS / options.load),
        "error": {
            "force_at_rest": float(abs(at_rest - by_springs[:, 0]).max() / at_rest.max()),
            "force": float(abs(forces - by_springs).max() / at_rest.max()),
            "deflection": float(shaft[0, 1] / places[0, 1] - 1),
        },
        "step_s": moving.step,
        "steps": moving.steps,
        "time": {"fem_s": fem_s, "reduce_s": body.reduce_s, "static_s": pressed.time_s, "online_s": moving.time_s},
        "left_out": [*body.left_out, *bearing.inner[0].left_out],
        "versions": ep.versions(),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    picture = options.out / "ball_bearing.png"
    draw(bearing, moving, forces, by_springs, (shaft, places)).savefig(picture, dpi=120)
    balls = [(ball, fem) for ball in bearing.balls]
    axes = ep.plot.bodies(moving, moving.t[-1], balls, colour="von_mises", end=20e6, scale=1, direction=(0, -0.3, 1))
    axes.figure.savefig(options.out / "bodies.png", dpi=150)
    moving.scene(options.out / "moving.html", title="ball bearing")
    for key in ("dofs", "fe_dofs", "peak_force_N", "stribeck", "error", "steps", "time"):
        print(f"{key}: {result[key]}")
    print(picture.resolve())
    return result


if __name__ == "__main__":
    main()
