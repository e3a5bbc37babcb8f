"""Chains of equal balls that are all pressed together: time of a step over the number of contacts.

One ball is reduced once and used several times, as in `examples/newtons_cradle.py`. The balls of a chain approach its
middle, so that every contact closes. All contacts are coupled, for each ball has two of them.

Reference: the second chain, of 50 balls; shorter ones fit into the processor's cache. Quantity: processor time of a
step in contact [us] over closed contacts, between two steps of one run, so that what comes before the first step and
after the last does not count. The smallest of five repetitions counts. The table also has the same by
`mbs.SolveDynamic`; the time that an open contact adds to a step of balls that are apart, which rest or fly side by
side, of which the time without contacts is taken; and the time to set up a contact, of the first model of a chain and
the second. BLAS has one thread, as others would spin and count.
Limits: the longest chain, of 200 balls, needs at most 1.2 times the time of the second for each closed contact; chains
from the second on take at most 15 us a closed contact, by `mbs.SolveDynamic` too, and 4 us an open one; forces on both
sides of the middle are equal to 1e-6.

    python -m validation.benchmarks.many_contacts [--quick]
"""

import argparse
import gc
import time
from itertools import pairwise

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

import exudyn_partition as ep
from validation.contact import scenes

R, SPEED, STEP = 0.010, 0.1, 5e-7  # [m], of neighbours to each other [m/s], [s]
APART = 1e-5  # between balls that are to stay apart [m]
CHAINS, QUICK_CHAINS = (12, 50, 200), (5, 12, 24)  # balls
BEGIN, END, END_APART, QUICK_END_APART = 40, 100, 1600, 600  # steps
REPETITIONS = 5
LIMITS = {"growth": 1.2, "closed_us": 15.0, "open_us": 4.0, "symmetry": 1e-6}


def reduced_ball():
    """A ball with a patch at either pole, reduced."""
    poles = {"back": (0, 0, -R), "front": (0, 0, R)}
    fine = [ep.Refine(pole, 0.35e-3, 0.12e-3) for pole in poles.values()]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), ep.STEEL, maxh=R / 3, refine=fine)
    back, front = (ep.Partition.ball(fem, pole, radius=0.6e-3, name=name) for name, pole in poles.items())
    return ep.reduce(fem, back | front, f_cut=200e3)


def chain(body, balls, frame, speed=None, contacts=True):
    """Model of a chain, its contacts, and the time to set one up [s]; balls with one `speed` [m/s] stay apart."""
    mbs = exu.SystemContainer().AddSystem()
    items = [
        ep.CreatePartitionBody(
            mbs, body, frame=frame, referencePosition=[0, 0, (2 * R + (0.0 if speed is None else APART)) * i],
            initialVelocity=[0, 0, SPEED * ((balls - 1) / 2 - i) if speed is None else speed],
        )
        for i in range(balls)
    ]  # fmt: skip
    pairs, begin = [*pairwise(items)] if contacts else [], time.process_time()
    found = [ep.CreatePartitionContact(mbs, *pair, slavePatch="front", masterPatch="back") for pair in pairs]
    setup_s = (time.process_time() - begin) / (balls - 1)
    mbs.Assemble()
    return mbs, found, setup_s


def by_library(mbs, steps):
    """Run by this library."""
    return ep.solve_dynamic(mbs, end_time=steps * STEP, step=STEP)


def by_exudyn(mbs, steps):
    """Run by Exudyn alone."""
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = STEP
    integration = settings.timeIntegration
    integration.endTime, integration.numberOfSteps, integration.verboseMode = steps * STEP, steps, 0
    integration.explicit.computeEndOfStepAccelerations = False
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)


def step_us(models, run, end=END):
    """Time of a step up to the step `end` [us], and what the last of the runs left; `models` makes a model."""
    spent = []
    for _ in range(REPETITIONS):
        mbs, begun = models(), {}

        def before_step(mbs, t, begun=begun):
            if (step := round(t / STEP)) in (BEGIN, end):
                begun[step] = time.process_time()
            return True

        mbs.SetPreStepUserFunction(before_step)
        gc.collect()  # what earlier models left is not freed in the run
        result = run(mbs, end)
        spent.append((begun[end] - begun[BEGIN]) / (end - BEGIN))
    return 1e6 * min(spent), result


def measured(body, balls, frame, end_apart=END_APART):
    """Times and closed contacts of one chain; balls that are apart are watched up to the step `end_apart`."""
    made = []

    def pressed():
        made.append(chain(body, balls, frame))
        return made[-1][0]

    time_us, result = step_us(pressed, by_library)
    contacts, setups = made[-1][1], [setup_s for *_, setup_s in made]
    rows = np.array([contact.closed_rows(result)[BEGIN:] for contact in contacts])
    force = np.array([contact.force(result) for contact in contacts])
    closed = np.count_nonzero(rows) / rows.shape[1]
    resting, flying, alone = (
        step_us(lambda v=v, c=c: chain(body, balls, frame, v, c)[0], by_library, end_apart)[0]
        for v, c in ((0.0, True), (SPEED, True), (SPEED, False))
    )
    return {
        "contacts": len(contacts),
        "closed": closed,
        "rows": int(rows.max()),
        "us_a_closed_contact": time_us / closed,
        "us_by_exudyn": step_us(pressed, by_exudyn)[0] / closed,
        "us_a_resting_contact": (resting - alone) / len(contacts),
        "us_a_flying_contact": (flying - alone) / len(contacts),
        "symmetry": float(abs(force - force[::-1]).max() / force.max()),
        "setup_ms": 1e3 * setups[0],
        "setup_again_ms": 1e3 * min(setups[1:]),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="short chains")
    options = parser.parse_args()
    threadpool_limits(1)
    chains, end_apart = (QUICK_CHAINS, QUICK_END_APART) if options.quick else (CHAINS, END_APART)
    body = reduced_ball()
    gc.freeze()  # collections between runs pass over the modules, which would take as long as the runs
    results = {
        frame: [measured(body, balls, frame, end_apart) for balls in (chains if frame == "inertial" else chains[:1])]
        for frame in ("inertial", "floating")
    }
    table = Table("frame", *results["inertial"][0])
    for frame, found in results.items():
        for entry in found:
            table.add_row(frame, *(f"{value:.4g}" for value in entry.values()))
    Console(width=180).print(table)
    times, longer = [entry["us_a_closed_contact"] for entry in results["inertial"]], results["inertial"][1:]
    found = {
        "growth": times[-1] / times[1],
        "closed_us": max(entry[key] for entry in longer for key in ("us_a_closed_contact", "us_by_exudyn")),
        "open_us": max(entry[key] for entry in longer for key in ("us_a_resting_contact", "us_a_flying_contact")),
        "symmetry": max(entry["symmetry"] for each in results.values() for entry in each),
    }
    missed = [f"{key} {found[key]:.3g}" for key in LIMITS if found[key] > LIMITS[key]]
    if options.quick:
        raise SystemExit(f"limits missed: {missed}" if missed else 0)
    result = {
        "found": found,
        "limits": LIMITS,
        "chains": results,
        "dofs": body.n_dofs,
        "quick": False,
    }
    scenes.finish(__file__, result, missed)


if __name__ == "__main__":
    main()
