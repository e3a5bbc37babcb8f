"""Ten thousand impacts in a row: a ball between two rigid planes.

Reference: conservation of energy; nothing is damped.
Quantity: deviation of kinetic, strain and contact energy from the start over the whole run, and its drift, the slope of
a straight line through it. Also the single pivots of the active sets, and the growth of the process' memory during the
second half of the run, of which few samples are kept.
Limits: 1e-3 for the energy, 5 MB, 10 000 impacts.

The explicit step is a tenth of the stability limit. Central differences conserve a shadow of the energy, which differs
from it by (w h)^2. This is largest for the highest modes, which take their share of it over thousands of impacts.

    python -m validation.contact.bouncing
"""

import json
import os
import platform
import sys
from pathlib import Path

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.exudyn_contacts.model_run import runs_of

RESULTS = Path(__file__).with_suffix(".json")
RADIUS, GAP, SPEED = 5e-3, 2e-6, 0.5
IMPACTS = 10_000
PERIOD = 36e-6  # between impacts: duration of a contact and of the flight across the gap, rounded up [s]
LIMITS = {"energy": 1e-3, "memory_MB": 5.0, "impacts": IMPACTS}


def reduced_ball():
    refine = [ep.Refine((0, 0, z), 0.5e-3, 0.15e-3) for z in (-RADIUS, RADIUS)]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), RADIUS), ep.STEEL, maxh=2.5e-3, refine=refine, grading=0.5)
    poles = [ep.Partition.ball(fem, (0, 0, z), 0.5e-3, name=name) for z, name in ((-RADIUS, "low"), (RADIUS, "high"))]
    return ep.reduce(fem, poles[0] | poles[1], f_cut=300e3)


def resident_MB():
    """Memory of this process now [MB]; 0 if the system does not report it."""
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return sum(float(line.split()[1]) / 1e3 for line in lines if line.startswith("VmRSS"))


def count_impacts(mbs, ball):
    """Count how often the ball turns round, looking ten times a period; compiled steps call no function of contacts.

    Return a list with the number so far.
    """
    count, last, next_look = [0], [-1.0], [0.0]

    def look(mbs, t):
        if t >= next_look[0]:
            next_look[0] = t + PERIOD / 10
            way = ball.kinematics.momentum(mbs.systemData.GetODE2Coordinates_t())[2]
            count[0] += bool(way * last[0] < 0)
            last[0] = way
        return True

    mbs.SetPreStepUserFunction(look)
    return count


def main():
    body = reduced_ball()
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -SPEED])
    low = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane((0, 0, -RADIUS - GAP), (0, 0, 1)), slavePatch="low")
    high = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane((0, 0, RADIUS + GAP), (0, 0, -1)), slavePatch="high")
    mbs.Assemble()
    count = count_impacts(mbs, ball)
    end_time, memory = IMPACTS * PERIOD * 1.05, []
    with ep.progress("bouncing") as report:

        def watch(share):
            memory.append(resident_MB())
            report(share)

        result = ep.solve_dynamic(
            mbs, end_time=end_time, step=ep.stability_limit(mbs) / 10, sample_period=1e-4, progress=watch
        )
    impacts, at_work = count[0], runs_of(mbs).at_work
    energy = ball.energy(result) + low.energy(result) + high.energy(result)
    deviation = energy / energy[0] - 1
    data = {
        "dofs": body.n_dofs,
        "impacts": impacts,
        "steps": result.steps,
        "step_s": result.step,
        "energy": float(abs(deviation).max()),
        "energy_drift": float(np.polyfit(result.t / result.t[-1], deviation, 1)[0]),
        "memory_MB": memory[-1] - memory[len(memory) // 2],
        "single_pivots": sum(at_work(contact).mechanics.law.problem.single_pivots for contact in (low, high)),
        "online_s": result.time_s,
        "step_time_us": 1e6 * result.time_s / result.steps,
        "limits": LIMITS,
        "machine": {"cpus": os.cpu_count(), "platform": platform.platform(), "versions": ep.versions()},
    }
    RESULTS.write_text(json.dumps(data, indent=1) + "\n")
    table = Table("quantity", "value", title="bouncing")
    for key, value in list(data.items())[:-2]:
        table.add_row(key, f"{value:.4g}")
    Console().print(table)
    failed = [f"{key} {data[key]:.3g}" for key in ("energy", "memory_MB") if data[key] > LIMITS[key]]
    failed += [f"impacts {impacts}"] if impacts < IMPACTS else []
    sys.exit(f"beyond the stated limits: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
