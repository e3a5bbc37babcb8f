"""Two involute spur gears: a torque that turns back across the backlash, and a slow turn under torque.

The flanks of some teeth of each gear are one contact patch (`ep.Partition.surface`), and one contact finds which of
them touch. In the first run the wheel stands still, and the torque on the pinion changes its sign. The teeth leave
their flanks, cross the backlash and hit the others. In the second run the wheel turns slowly by a tooth. The force on
each tooth and the transmission error show where one pair of teeth bears, where two. The model: models/gear_pair.py.
"""

import argparse
import json
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import exudyn_partition as ep
from models import gear_pair as model
from models import gear_pair_parts as shapes

GEARS, QUICK_GEARS = (shapes.Gear(20, 20e-3), shapes.Gear(30, 30e-3)), (shapes.Gear(20, 20e-3),) * 2
MESH = {"fine": 0.45e-3, "maxh": 4e-3, "grading": 0.4, "curvaturesafety": 0.7}
QUICK_MESH = {"fine": 0.8e-3, "maxh": 8e-3, "grading": 0.7, "curvaturesafety": 0.5}
TORQUE, BEGINS, CHANGE, DAMPING = 100.0, 0.5e-3, 0.5e-3, 0.3  # [N m]; of the change, and its time [s]; [N m s]


def reversal(bodies, gears, end, step):
    """The torque changes its sign while the wheel stands still; returns pair and result."""

    def torque(t):
        return TORQUE * (1 - 2 * min(max((t - BEGINS) / CHANGE, 0), 1))

    pair = model.pair(bodies, gears, model.Work(torque, lambda t: (0.0, 0.0)), damping=DAMPING)
    pair.settle()
    return pair, pair.run(end, step)


def slow_turn(bodies, gears, first, last, duration, steps):
    """Turn the wheel so that the pinion goes from `first` to `last`, by a tooth; returns pair and result."""
    tooth, ramp = 2 * np.pi / gears[0].teeth, 0.1 * duration
    speed = -(last - first) * 2 * np.pi / gears[1].teeth / (duration - ramp / 2)

    def turn(t):
        return speed * (t - ramp / 2 if t > ramp else t * t / (2 * ramp)), speed * min(t / ramp, 1)

    pair = model.pair(bodies, gears, model.Work(lambda t: TORQUE, turn), first * tooth)
    pair.settle()
    return pair, pair.run(duration, duration / steps)


def draw(gears, histories):
    """Force on each tooth, and way of the pinion into the wheel, of both runs."""
    fig, panels = plt.subplots(2, 2, figsize=(12, 7), sharex="col", layout="constrained")
    labels = "time [ms]", "turn of the pinion, by a tooth"
    for (above, below), label, (x, teeth, way) in zip(panels.T, labels, histories, strict=True):
        for name, force in teeth.items():
            above.plot(x, force / 1e3, lw=1, label=name)
        above.set(ylabel="force on a tooth [kN]")
        above.legend(fontsize="small", title="of the pinion", title_fontsize="small")
        below.plot(x, 1e6 * way)
        below.set(xlabel=label, ylabel="transmission error [µm]")
    panels[1, 0].axhspan(-2e6 * shapes.play(), 0, color="0.9", label="backlash")
    panels[1, 0].legend(fontsize="small")
    return fig


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--step", type=float, default=5e-6, metavar="S", help="of the reversal")
    parser.add_argument("--quick", action="store_true", help="coarse meshes, short runs")
    parser.add_argument("--out", type=Path, default=Path("out/gear_pair"), metavar="DIR")
    options = parser.parse_args(argv)
    gears, sizes = (QUICK_GEARS, QUICK_MESH) if options.quick else (GEARS, MESH)
    clock = [time.perf_counter()]
    parts = {gear: shapes.gear_part(gear, **sizes) for gear in dict.fromkeys(gears)}  # equal gears share a body
    clock.append(time.perf_counter())
    reduced = {gear: ep.reduce(*part, f_cut=shapes.F_CUT) for gear, part in parts.items()}
    clock.append(time.perf_counter())
    bodies, (fem, partition) = [reduced[gear] for gear in gears], parts[gears[0]]
    back = reversal(bodies, gears, *(1.2e-3, 2e-5) if options.quick else (5e-3, options.step))
    first, *rest = (0.1, 0.2, 5e-3, 25) if options.quick else (-0.5, 0.6, 0.05, 500)
    slow = slow_turn(bodies, gears, first, *rest)

    nodes, tooth = fem.points[partition.patch_nodes], 2 * np.pi / gears[0].teeth
    ways, teeth = zip(*[(pair.way(run), pair.tooth_forces(run, nodes)) for pair, run in (back, slow)], strict=True)
    turned = first + slow[1].sensor(slow[0].turns[0])[:, 0] / tooth
    error = (slow[0].contact.force(slow[1]) * gears[0].base / TORQUE - 1)[slow[1].steps // 2 :]
    result = {
        "time": dict(fem_s=clock[1] - clock[0], reduce_s=clock[2] - clock[1], online_s=back[1].time_s + slow[1].time_s),
        "status": [back[1].status, slow[1].status],
        "dofs": sum(body.n_dofs for body in bodies),
        "fe_dofs": sum(body.fe_dofs for body in bodies),
        "contact_nodes": [len(body.partition.patch_nodes) for body in bodies],
        "steps": [back[1].steps, slow[1].steps],
        "step_s": [back[1].step, slow[1].step],
        "crossed_m": float(ways[0][0] - ways[0].min()),
        "backlash_m": 2 * shapes.play(),
        "peak_force_N": float(back[0].contact.force(back[1]).max()),
        "error.force": float(abs(error).max()),
        "transmission_error_m": [float(ways[1].min()), float(ways[1].max())],
        "left_out": [*bodies[0].left_out, *back[0].contact.left_out],
        "versions": ep.versions(),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    picture = options.out / "gear_pair.png"
    draw(gears, [(1e3 * back[1].t, teeth[0], ways[0]), (turned, teeth[1], ways[1])]).savefig(picture, dpi=120)
    fems = [(body, parts[gear][0]) for body, gear in zip(slow[1].bodies, gears, strict=True)]
    axes = ep.plot.bodies(slow[1], bodies=fems, colour="von_mises", scale=1, direction=(0, -0.3, 1))
    axes.set(xlim=(20, 60), ylim=(-12, 14), adjustable="box")  # where the teeth meet
    axes.figure.savefig(options.out / "bodies.png", dpi=150)
    slow[1].scene(options.out / "moving.html", title="gears that turn slowly")
    shown = {key: result[key] for key in ("dofs", "fe_dofs", "steps", "error.force", "transmission_error_m")}
    print(json.dumps(shown), picture.resolve(), sep="\n")
    return result


if __name__ == "__main__":
    main()
