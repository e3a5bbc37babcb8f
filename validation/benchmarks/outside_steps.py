"""What a run costs outside of its steps, and what it costs to create contacts.

Balls hit planes of their own, one and 50, in 150 steps. Quantities: processor time of `solve_dynamic` before its first
step and after its last one [ms], and by the time of the steps; time to create a contact of a chain whose contacts are
created one after the other [ms], of 200 by that of 50. Each least of some repetitions counts.
Limits: one ball takes at most 4.5 ms; 50 balls a third of the time of the steps; contacts of the long chain 1.2 times
the time of the short one each.

    python -m validation.benchmarks.outside_steps
"""

import gc
import time
from itertools import pairwise

import exudyn as exu
import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

import exudyn_partition as ep
from validation.benchmarks.many_contacts import SPEED, STEP, R, reduced_ball
from validation.contact import scenes

ON_PLANES, PLANE_STEPS = {1: 60, 50: 8}, 150  # repetitions by number of balls, and steps
CHAINS, REPETITIONS = (50, 200), 4  # contacts
LIMITS = {"one_ms": 4.5, "fifty": 1 / 3, "creation": 1.2}


def on_planes(body, balls):
    """Model of balls that begin to hit planes of their own."""
    mbs = exu.SystemContainer().AddSystem()
    for i in range(balls):
        ball = ep.CreatePartitionBody(mbs, body, referencePosition=[3 * R * i, 0, R], initialVelocity=[0, 0, -SPEED])
        ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), slavePatch="back")
    mbs.Assemble()
    return mbs


def outside_of_steps(body, balls, repetitions):
    """Least times of `solve_dynamic` before its first step, in its steps and after its last one [ms]."""
    spent = []
    for _ in range(repetitions):
        mbs, times = on_planes(body, balls), []

        def before_step(mbs, t, times=times):
            times.append(time.process_time())
            return True

        def after_step(mbs, t, times=times):
            times[1:] = [time.process_time()]
            return True

        mbs.SetPreStepUserFunction(before_step)
        mbs.SetPostStepUserFunction(after_step)
        gc.collect()
        begin = time.process_time()
        ep.solve_dynamic(mbs, end_time=PLANE_STEPS * STEP, step=STEP)
        first, last = times
        spent.append((first - begin, last - first, time.process_time() - last))
    before, steps, after = 1e3 * np.min(spent, axis=0)
    return {"balls": balls, "before_ms": before, "steps_ms": steps, "after_ms": after}


def creation_ms(body, contacts):
    """Least time to create a contact of a chain [ms]."""
    spent = []
    for _ in range(REPETITIONS):
        mbs = exu.SystemContainer().AddSystem()
        balls = [ep.CreatePartitionBody(mbs, body, referencePosition=[0, 0, 2 * R * i]) for i in range(contacts + 1)]
        gc.collect()
        begin = time.process_time()
        for pair in pairwise(balls):
            ep.CreatePartitionContact(mbs, *pair, slavePatch="front", masterPatch="back")
        spent.append(1e3 * (time.process_time() - begin) / contacts)
    return min(spent)


def main():
    threadpool_limits(1)
    body = reduced_ball()
    outside_of_steps(body, 1, 1)  # loops are compiled or loaded
    gc.freeze()  # collections between runs pass over the modules, which would take as long as the runs
    planes = [outside_of_steps(body, *case) for case in ON_PLANES.items()]
    creation = {contacts: creation_ms(body, contacts) for contacts in CHAINS}
    table = Table(*planes[0])
    for entry in planes:
        table.add_row(*(f"{value:.4g}" for value in entry.values()))
    Console(width=180).print(table, creation)
    outside_ms = [entry["before_ms"] + entry["after_ms"] for entry in planes]
    found = {
        "one_ms": outside_ms[0],
        "fifty": outside_ms[-1] / planes[-1]["steps_ms"],
        "creation": creation[CHAINS[-1]] / creation[CHAINS[0]],
    }
    missed = [f"{key} {found[key]:.3g}" for key in LIMITS if found[key] > LIMITS[key]]
    result = {"found": found, "limits": LIMITS, "on_planes": planes, "creation_ms": creation}
    scenes.finish(__file__, result, missed)


if __name__ == "__main__":
    main()
