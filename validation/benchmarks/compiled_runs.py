"""Compiled runs beside Exudyn's: README's two balls, one run and many, and the wait for the compiler.

Reference: `solve_dynamic` by Exudyn, of the same 500 steps. Quantity: processor time of one process and one thread, the
least of five repetitions, over that of the reference: of `solve_dynamic(solver="compiled")`, with all its checks and
reviews; of its steps alone, `compiled.run.run`, which keep all samples and forces on rows; and of an entry of
`run_many` with 64 speeds. Also the largest difference of the force, over the largest force.
The same of a ball that tumbles, in a floating frame, and hits a rigid plane: of its steps alone, of `solve_dynamic` and
of the force; its reference is Exudyn's run of the same scene in the same process.
The wait for the compiler: processor time of a new process that loads the balls from files, makes the model and runs it
compiled, without compiled code on disk, and with it.
Limits: the steps alone take at most 0.25 of the reference, an entry of `run_many` 0.25, a compiled run 0.9; the
differences are at most 1e-9. Of the ball that tumbles: 0.25 and 0.9.

    python -m validation.benchmarks.compiled_runs
"""

import os
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from exudyn_partition.algebra.blas_threads import one_blas_thread
from exudyn_partition.compiled.run import EqualSteps, Start, run
from exudyn_partition.errors import YieldWarning
from exudyn_partition.exudyn_contacts.partition_contact import partition_items
from exudyn_partition.simulation.compiled_plan import at_start, moving_contacts, read_plan, with_anchors
from validation.contact import scenes

R, SPEED, END, STEP, MANY, REPETITIONS = 0.010, 0.5, 100e-6, 2e-7, 64, 5
SPIN = (300.0, -200.0, 100.0)  # [rad/s]
LIMITS = {
    "steps": 0.25, "many": 0.25, "compiled": 0.9, "difference": 1e-9,
    "tumbling_steps": 0.25, "tumbling": 0.9, "tumbling_difference": 1e-9,
}  # fmt: skip


def balls():
    """Both balls, reduced, as in the README."""
    bodies = []
    for side in (1, -1):
        ball = occ.Sphere(occ.Pnt(0, 0, side * R), R)
        fem = ep.fe_model(ball, ep.STEEL, maxh=3e-3, refine=[ep.Refine((0, 0, 0), radius=0.3e-3, h=0.1e-3)])
        part = ep.Partition.ball(fem, center=(0, 0, 0), radius=0.5e-3 if side == 1 else 0.7e-3)
        bodies.append(ep.reduce(fem, part, f_cut=200e3))
    return bodies


def model(bodies):
    """Model of their impact: the ball that flies, and the contact."""
    mbs = exu.SystemContainer().AddSystem()
    upper = ep.CreatePartitionBody(mbs, bodies[0], name="upper", initialVelocity=[0, 0, -SPEED])
    contact = ep.CreatePartitionContact(mbs, upper, ep.CreatePartitionBody(mbs, bodies[1], name="lower"))
    mbs.Assemble()
    return mbs, upper, contact


def tumbling(body):
    """Model of a ball that spins and hits a rigid plane: the model and the contact."""
    mbs = exu.SystemContainer().AddSystem()
    motion = {"initialVelocity": [0.1, 0, -SPEED], "initialAngularVelocity": SPIN}
    ball = ep.CreatePartitionBody(mbs, body, name="ball", frame="floating", **motion)
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane())
    mbs.Assemble()
    return mbs, contact


def least_ms(work):
    """Least processor time of a function [ms], after one call that does not count."""
    work()
    spent = []
    for _ in range(REPETITIONS):
        begin = time.process_time()
        work()
        spent.append(time.process_time() - begin)
    return 1e3 * min(spent)


def steps_alone(mbs):
    """A function that makes the steps alone, from arrays."""
    data, initial = mbs.systemData, exu.ConfigurationType.Initial
    start = Start(np.array(data.GetODE2Coordinates(initial)), np.array(data.GetODE2Coordinates_t(initial)))
    groups, steps = at_start(partition_items(mbs)[1]), EqualSteps(STEP, round(END / STEP))
    plan, start = read_plan(mbs, groups), with_anchors(start, moving_contacts(mbs, groups))
    return lambda: run(plan, start, steps)


def waits(bodies):
    """Processor time of new processes that run the model compiled [s], without compiled code on disk, and with it."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder, f"{name}.npz") for name in ("upper", "lower")]
        for body, path in zip(bodies, paths, strict=True):
            body.save(path)
        command = [sys.executable, "-W", "ignore", "-m", "validation.benchmarks.compiled_runs", *map(str, paths)]
        environment = os.environ | {"NUMBA_CACHE_DIR": folder}
        return [
            float(
                subprocess.run(command, env=environment, capture_output=True, check=True, text=True).stdout.split()[-1]
            )
            for _ in range(2)
        ]


@one_blas_thread()
def times(bodies):
    """Times [ms], by what is timed, and what `LIMITS` are for."""
    mbs, upper, contact = model(bodies)
    options, velocities = {"end_time": END, "step": STEP, "progress": lambda share: None}, np.zeros((MANY, 3))
    velocities[:, 2] = -SPEED * np.linspace(1.0, 1.2, MANY)
    vary = {upper: {"initialVelocity": velocities}}
    right, compiled = (ep.solve_dynamic(mbs, solver=solver, **options) for solver in ("exudyn", "compiled"))
    turns, touches = tumbling(bodies[0])
    results = [ep.solve_dynamic(turns, solver=solver, **options) for solver in ("exudyn", "compiled")]
    force, of_turning = contact.force(right), [touches.force(result) for result in results]
    spent = {
        "exudyn": least_ms(lambda: ep.solve_dynamic(mbs, **options)),
        "compiled": least_ms(lambda: ep.solve_dynamic(mbs, solver="compiled", **options)),
        "steps": least_ms(steps_alone(mbs)),
        "many": least_ms(lambda: ep.run_many(mbs, vary=vary, **options)) / MANY,
        "exudyn_tumbling": least_ms(lambda: ep.solve_dynamic(turns, **options)),
        "tumbling": least_ms(lambda: ep.solve_dynamic(turns, solver="compiled", **options)),
        "tumbling_steps": least_ms(steps_alone(turns)),
    }
    found = {name: spent[name] / spent["exudyn"] for name in ("steps", "many", "compiled")}
    found |= {name: spent[name] / spent["exudyn_tumbling"] for name in ("tumbling_steps", "tumbling")}
    found["difference"] = float(abs(contact.force(compiled) - force).max() / force.max())
    found["tumbling_difference"] = float(abs(of_turning[1] - of_turning[0]).max() / of_turning[0].max())
    return spent, found


def main():
    if paths := sys.argv[1:]:
        mbs, *_ = model([ep.load_body(path) for path in paths])
        ep.solve_dynamic(mbs, end_time=END, step=STEP, solver="compiled")
        print(time.process_time())
        return
    bodies = balls()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", YieldWarning)  # steel would dent
        spent, found = times(bodies)
    first, second = waits(bodies)
    result = {"ms": spent, "found": found, "limits": LIMITS, "first_process_s": first, "second_process_s": second}
    Console().print(result)
    failed = [f"{name} {found[name]:.3g}" for name, limit in LIMITS.items() if found[name] > limit]
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
