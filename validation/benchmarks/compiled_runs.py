"""Compiled runs beside Exudyn's: README's two balls, without friction and with it, and the wait for the compiler.

Reference: `solve_dynamic` by Exudyn, of the same 500 steps. Quantity: processor time of one process and one thread, the
least of five repetitions by turns, over that of the reference: of `solve_dynamic(solver="compiled")`, with all its
checks and reviews; of its steps alone, `compiled.run.run`, which keep all samples and forces on rows; and of an entry
of `run_many` with 64 speeds. Also the largest difference of the force, over the largest force. With friction, the balls
have coarser patches of some 60 rows, and one flies aside, so that rows stick and slip.
The same of a ball that tumbles, in a floating frame, and hits a rigid plane: of its steps alone, of `solve_dynamic` and
of the force; its reference is Exudyn's run of the same scene in the same process.
A gradient: the pass back over the steps alone, `compiled.adjoint.backwards`, over these steps: derivatives of the peak
force by all velocities, places, masses, stiffnesses, damping, loads, and by the contact's flexibility, twice. The same
of a ball that hits a rigid sphere in an inertial frame, so that rows and their flexibility follow the motion, and of
the ball that tumbles.
The wait for the compiler: processor time of a new process that loads the balls from files, makes the model and runs it
compiled, without compiled code on disk, and with it.
Limits: the steps alone take at most 0.25 of the reference, an entry of `run_many` 0.25, a compiled run 0.9, with
friction 0.25, 0.25 and 0.6, each gradient 0.5 of its steps; differences are at most 1e-9. Of the ball that tumbles:
0.3 and 0.9.

    python -m validation.benchmarks.compiled_runs
"""

import gc
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
from exudyn_partition.compiled.adjoint import backwards
from exudyn_partition.compiled.made_run import MadeRun
from exudyn_partition.compiled.run import EqualSteps, run
from exudyn_partition.compiled.start import Start
from exudyn_partition.errors import YieldWarning
from exudyn_partition.exudyn_contacts.partition_contact import partition_items
from exudyn_partition.simulation.compiled_plan import at_start, moving_contacts, read_plan, with_anchors
from exudyn_partition.studies.run_numbers import number_of_contact
from validation.contact import scenes

R, SPEED, END, STEP, MANY, REPETITIONS = 0.010, 0.5, 100e-6, 2e-7, 64, 24
SPIN = (300.0, -200.0, 100.0)  # [rad/s]
LIMITS = {"steps": 0.25, "many": 0.25, "compiled": 0.9, "difference": 1e-9}
LIMITS |= {"rough_steps": 0.25, "rough_many": 0.25, "rough_compiled": 0.6, "rough_difference": 1e-9}
LIMITS |= {"gradient": 0.5, "rough_gradient": 0.5}
LIMITS |= {"tumbling_steps": 0.3, "tumbling": 0.9, "tumbling_difference": 1e-9}
LIMITS |= {"curved_gradient": 0.5, "tumbling_gradient": 0.5}
FRICTION, ASIDE = 0.3, 0.03  # of SPEED


def balls(*, rough=False):
    """Both balls, reduced, as in the README; `rough`: for friction, with coarser patches."""
    h, axes = (0.18e-3, "xyz") if rough else (0.1e-3, "normal")
    bodies = []
    for side in (1, -1):
        ball = occ.Sphere(occ.Pnt(0, 0, side * R), R)
        fem = ep.fe_model(ball, ep.STEEL, maxh=3e-3, refine=[ep.Refine((0, 0, 0), radius=0.3e-3, h=h)])
        part = ep.Partition.ball(fem, center=(0, 0, 0), radius=0.5e-3 if side == 1 else 0.7e-3, axes=axes)
        bodies.append(ep.reduce(fem, part, f_cut=200e3))
    return bodies


def model(bodies, *, rough=False):
    """Model of their impact: the ball that flies, and the contact."""
    mbs, velocity = exu.SystemContainer().AddSystem(), [SPEED * ASIDE * rough, 0, -SPEED]
    upper = ep.CreatePartitionBody(mbs, bodies[0], name="upper", initialVelocity=velocity)
    lower = ep.CreatePartitionBody(mbs, bodies[1], name="lower")
    contact = ep.CreatePartitionContact(mbs, upper, lower, friction=FRICTION if rough else None)
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


def on_a_sphere(body):
    """Model of a ball that hits a rigid sphere."""
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, body, name="ball", initialVelocity=[SPEED, 0, -SPEED])
    ep.CreatePartitionContact(mbs, ball, ep.RigidSphere((0, 0, -R), R))
    mbs.Assemble()
    return mbs


def least_ms(works):
    """Least processor time of functions by turns [ms], by their names.

    Each call is timed after one that does not count, so that nobody pays for what others left in the machine's caches.
    """
    spent = {name: [] for name in works}
    for _ in range(REPETITIONS):
        for name, work in works.items():
            gc.collect()
            work()
            begin = time.process_time()
            work()
            spent[name].append(time.process_time() - begin)
    return {name: 1e3 * min(some) for name, some in spent.items()}


def arrays_of(mbs):
    """Plan, start and steps."""
    data, initial = mbs.systemData, exu.ConfigurationType.Initial
    start = Start(np.array(data.GetODE2Coordinates(initial)), np.array(data.GetODE2Coordinates_t(initial)))
    groups, steps = at_start(partition_items(mbs)[1]), EqualSteps(STEP, round(END / STEP))
    plan, start = read_plan(mbs, groups), with_anchors(start, moving_contacts(mbs, groups))
    return plan, start, steps


def steps_alone(mbs):
    """A function that makes the steps alone, from arrays."""
    plan, start, steps = arrays_of(mbs)
    return lambda: run(plan, start, steps)


def gradient_alone(mbs):
    """A function that goes back over the steps."""
    plan, start, steps = arrays_of(mbs)
    contacts, made = plan.contacts, run(plan, start, steps)
    whole = MadeRun(plan, steps, made)
    weights, parts = number_of_contact("peak_force", 0, whole).weights, [whole.part(contacts, [0])] * 2
    return lambda: backwards(MadeRun(plan, steps, made), weights, parts)


def works_of(mbs, options):
    """What is timed of each model, by name."""
    return {
        "exudyn": lambda: ep.solve_dynamic(mbs, **options),
        "compiled": lambda: ep.solve_dynamic(mbs, solver="compiled", **options),
        "steps": steps_alone(mbs),
        "gradient": gradient_alone(mbs),
    }


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
def times(bodies, *, rough=False):
    """Times [ms], by what is timed, and what `LIMITS` are for."""
    mbs, upper, contact = model(bodies, rough=rough)
    options, velocities = {"end_time": END, "step": STEP, "progress": lambda share: None}, np.zeros((MANY, 3))
    velocities[:, 2], velocities[:, 0] = -SPEED * np.linspace(1.0, 1.2, MANY), SPEED * ASIDE * rough
    vary = {upper: {"initialVelocity": velocities}}
    right, compiled = (ep.solve_dynamic(mbs, solver=solver, **options) for solver in ("exudyn", "compiled"))
    force = contact.force(right)
    works = works_of(mbs, options) | {"many": lambda: ep.run_many(mbs, vary=vary, **options)}
    spent = least_ms(works)
    spent["many"] /= MANY
    found = {name: spent[name] / spent["exudyn"] for name in ("steps", "many", "compiled")}
    found["gradient"] = spent["gradient"] / spent["steps"]
    found["difference"] = float(abs(contact.force(compiled) - force).max() / force.max())
    return spent, found


@one_blas_thread()
def curved_times(body):
    """Steps and a gradient of a ball that hits a rigid sphere."""
    mbs = on_a_sphere(body)
    spent = least_ms({"steps": steps_alone(mbs), "gradient": gradient_alone(mbs)})
    return spent, {"curved_gradient": spent["gradient"] / spent["steps"]}


@one_blas_thread()
def tumbling_times(body):
    """The same of a ball that tumbles."""
    (mbs, contact), options = tumbling(body), {"end_time": END, "step": STEP, "progress": lambda share: None}
    right, found = (contact.force(ep.solve_dynamic(mbs, solver=name, **options)) for name in ("exudyn", "compiled"))
    spent = least_ms(works_of(mbs, options))
    shares = {"tumbling": spent["compiled"] / spent["exudyn"], "tumbling_steps": spent["steps"] / spent["exudyn"]}
    shares["tumbling_gradient"] = spent["gradient"] / spent["steps"]
    return spent, shares | {"tumbling_difference": float(abs(found - right).max() / right.max())}


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
        rough, of_rough = times(balls(rough=True), rough=True)
        tumbling_ms, of_tumbling = tumbling_times(bodies[0])
        curved_ms, of_curved = curved_times(bodies[0])
    found |= {f"rough_{name}": value for name, value in of_rough.items()} | of_tumbling | of_curved
    first, second = waits(bodies)
    result = {
        "ms": spent,
        "rough_ms": rough,
        "tumbling_ms": tumbling_ms,
        "curved_ms": curved_ms,
        "found": found,
        "limits": LIMITS,
        "first_process_s": first,
        "second_process_s": second,
    }
    Console().print(result)
    failed = [f"{name} {found[name]:.3g}" for name, limit in LIMITS.items() if found[name] > limit]
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
