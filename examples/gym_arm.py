"""A flexible arm that hits an anvil, as an environment of gymnasium: any learner can drive it.

Each action is a torque on the arm's hinge for a millisecond, and `go_on=True` lets the run go on from action to action.
The task is a blow of a given force. A cross-entropy search, the shortest learner, finds the torque. A rigid arm would
need less, by energy and Hertz: this one bends while it hits. It needs `pip install ".[learning]"`.
"""

import argparse
import json
import math
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import exudyn_partition as ep
from models.gym_arm import GAP, NOSE, RADIUS, TARGET, TORQUE, HittingArm, arm, inertia


def episode(env, torque):
    """Reward and peak force [N] of a blow with a steady torque [N m]."""
    env.reset()
    done = False
    while not done:
        _, reward, left, late, _ = env.step(np.array([torque / TORQUE], np.float32))
        done = left or late
    return reward, env.peak * TARGET


def rigid_torque(fem):
    """Torque [N m] with which a rigid arm hits with the target: Hertz's force grows with the speed to the 6/5."""
    reach = NOSE[0]
    at_1 = ep.hertz.impact(inertia(fem) / reach**2, 1.0, RADIUS, math.inf, ep.STEEL).peak_force
    speed = (TARGET / at_1) ** (5 / 6)
    return -0.5 * inertia(fem) * (speed / reach) ** 2 / (GAP / reach)


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a coarser mesh, and fewer blows")
    parser.add_argument("--out", type=Path, default=Path("out/gym_arm"), metavar="DIR")
    options = parser.parse_args(argv)
    fem, body = arm(options.quick)
    env, begin, tried = HittingArm(fem, body), time.perf_counter(), []
    env.reset(seed=0)
    middle, width = -TORQUE / 2, TORQUE / 4
    for _ in range(2 if options.quick else 6):  # the better half of the tries says where to try next
        torques = np.clip(env.np_random.normal(middle, width, 4 if options.quick else 8), -TORQUE, -0.1)
        tried += (found := [(torque, *episode(env, torque)) for torque in torques])
        best = [torque for torque, *_ in sorted(found, key=lambda one: -one[1])[: len(found) // 2]]
        middle, width = float(np.mean(best)), float(np.std(best))
    seconds, (_, force) = time.perf_counter() - begin, episode(env, middle)
    result = {
        "dofs": body.n_dofs,
        "fe_dofs": fem.n_dofs,
        "time": {"reduce_s": body.reduce_s, "s_a_blow": seconds / len(tried)},
        "blows": len(tried),
        "peak_force_N": force,
        "torque_Nm": middle,
        "rigid_torque_Nm": rigid_torque(fem),
        "error": {"force": force / TARGET - 1},
        "versions": ep.versions(),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    axes = plt.subplots(layout="constrained")[1]
    axes.scatter([-one[0] for one in tried], [one[2] for one in tried], c=range(len(tried)), label="later: brighter")
    axes.axhline(TARGET, color="k", linestyle="--", label="target")
    axes.set(xlabel="torque [N m]", ylabel="force of the blow [N]")
    axes.legend()
    axes.figure.savefig(picture := options.out / "gym_arm.png", dpi=150)
    print(json.dumps({key: result[key] for key in list(result)[:-1]}, indent=1), picture.resolve(), sep="\n")
    return result


if __name__ == "__main__":
    main()
