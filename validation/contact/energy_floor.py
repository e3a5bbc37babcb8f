"""What is left of the energy's error when steps are short: a ball that bounces off a plate while it slides over it.

Reference: conservation of energy. Nothing is damped, and there is no friction.
Quantity: energy of the bodies and of the contact, beyond that of the start, by the energy of the ball's motion along
the normal. Rows carry forces lam. They yield by F lam and store lam' F lam / 2. F belongs to the places of the rows:
while these pass over facets of the elastic plate, F changes a little. The forces lack the derivative of the stored
energy that follows, so that the sum of all energies changes by the integral of -lam' dF lam / 2. This integral is found
by a replay of the run, from forces and flexibilities alone. On a rigid plane F is that of the ball's own nodes, and
does not change. A penalty layer on the elastic plate does not change either; gaps and rows there are the same.
Limits, at the shortest step: 1e-5 between the energy and the integral, 1e-5 for the rigid plane, 5e-5 for the layer.

    python -m validation.contact.energy_floor [--quick]
"""

import argparse
import itertools
import warnings

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.contact.normal_rows import NormalRows
from validation.contact import scenes
from validation.tables import PAGE, write_between

RADIUS, SPEED = 0.010, 0.3  # of the ball [m], along the normal [m/s]
ALONG = (8.0, 4.0, 2.0, -8.0)  # speeds along the plate [m/s]
STEPS = (4e-7, 2e-7, 1e-7, 5e-8)  # [s]
FACETS = (0.35e-3, 0.25e-3)  # of the plate [m]
START, END = -0.3e-3, 80e-6  # place at the start [m], time at the end [s]
LIMITS = {"unexplained": 1e-5, "rigid": 1e-5, "layer": 5e-5}


def reduced_ball():
    shape, fine = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS), ep.Refine((0, 0, 0), 1e-3, 0.25e-3)
    fem = ep.fe_model(shape, scenes.STEEL, maxh=3.5e-3, refine=[fine], grading=0.5)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1e-3), f_cut=150e3)


def reduced_plate(h):
    shape = occ.Box(occ.Pnt(-8e-3, -8e-3, -5e-3), occ.Pnt(8e-3, 8e-3, 0))
    fem = ep.fe_model(shape, scenes.STEEL, maxh=4e-3, refine=[ep.Refine((0, 0, 0), 1.2e-3, h)], grading=0.5)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1.6e-3), f_cut=120e3)


def bounce(ball, plate, along, step, formulation="compliance"):
    """Energy beyond that of the start over a bounce, (n,), and what the change of the flexibility explains of it."""
    mbs = exu.SystemContainer().AddSystem()
    items = [
        ep.CreatePartitionBody(
            mbs, ball, frame="floating", referencePosition=[START, 0, 1e-6], initialVelocity=[along, 0, -SPEED]
        )
    ]
    if plate is not None:
        items.append(ep.CreatePartitionBody(mbs, plate, frame="inertial"))
    target = ep.RigidPlane() if plate is None else items[1]
    contact = ep.CreatePartitionContact(mbs, items[0], target, formulation=formulation)
    mbs.Assemble()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ep.errors.PartitionWarning)  # of yield: both bodies are elastic here
        result = ep.solve_dynamic(mbs, end_time=END, step=step)
    energy = sum(item.energy(result) for item in items) + contact.energy(result)
    unit = ball.total_mass * SPEED**2 / 2
    lacking = missing_work(contact, result) if formulation == "compliance" else np.zeros(len(result.t))
    return (energy - energy[0]) / unit, lacking / unit


def missing_work(contact, result):
    """Integral of -lam' dF lam / 2 up to each sample, (n,) [J]; each step is a sample."""
    mechanics = contact.mechanics.for_run("explicit")
    q = np.hstack([item.coordinates(result) for item, _ in contact.sides])
    work, before, flexibility = np.zeros(len(q)), {}, np.empty((0, 0))
    for i, place in enumerate(q):
        lam, gaps = np.ravel(mechanics.at(place).lam), mechanics.gaps
        shared = [row for row, node in enumerate(gaps.row_nodes) if node in before]
        if shared:
            old = [before[gaps.row_nodes[row]] for row in shared]
            numbers = [number for number, _ in old]
            mean = (lam[shared] + [force for _, force in old]) / 2
            change = NormalRows(gaps).flexibility(np.array(shared)) - flexibility[np.ix_(numbers, numbers)]
            work[i] = -mean @ change @ mean / 2
        closed = np.flatnonzero(lam)
        if len(closed):  # asked for sooner than in the run, it would be that of other places from then on
            flexibility = NormalRows(gaps).flexibility(closed)
        before = {gaps.row_nodes[row]: (number, lam[row]) for number, row in enumerate(closed)}
    return np.cumsum(work)


def measure(ball, plate, along, steps, formulation="compliance"):
    """Energy at the end, largest amounts of it and of the integral, and their largest difference, for each step."""
    runs = [bounce(ball, plate, along, step, formulation) for step in steps]
    return {
        "along_m_s": along,
        "steps_s": list(steps),
        "end": [energy[-1] for energy, _ in runs],
        "largest": [abs(energy).max() for energy, _ in runs],
        "integral": [abs(lacking).max() for _, lacking in runs],
        "unexplained": [abs(energy - lacking).max() for energy, lacking in runs],
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one plate, one speed, two steps")
    options = parser.parse_args()
    few = 1 if options.quick else None
    steps = (STEPS[0], STEPS[-1]) if options.quick else STEPS
    ball, plates = reduced_ball(), {h: reduced_plate(h) for h in FACETS[:few]}
    cases = {
        f"elastic plate, facets of {1e3 * h:g} mm": [measure(ball, plate, along, steps) for along in ALONG[:few]]
        for h, plate in plates.items()
    }
    elastic = list(itertools.chain(*cases.values()))
    rigid = cases["rigid plane"] = [measure(ball, None, along, steps) for along in ALONG[:few]]
    layer = cases["the first plate, penalty layer"] = [
        measure(ball, plates[FACETS[0]], along, steps, "penalty") for along in ALONG[:few]
    ]
    found = {
        "floor": max(case["largest"][-1] for case in elastic),
        "unexplained": max(case["unexplained"][-1] for case in elastic),
        "rigid": max(case["largest"][-1] for case in rigid),
        "layer": max(case["largest"][-1] for case in layer),
    }
    missed = [f"{key} {found[key]:.3g}" for key in LIMITS if found[key] > LIMITS[key]]
    head = ("surface", *(f"{1e6 * step:g} us" for step in steps), "integral")
    rows = []
    for name, runs in cases.items():
        worst = [max(run["largest"][i] for run in runs) for i in range(len(steps))]
        without = "" if "facets" not in name else f"{max(run['integral'][-1] for run in runs):.1e}"
        rows.append((name, *(f"{value:.1e}" for value in worst), without))
    table = Table(*head, title="largest error of the energy, by the energy along the normal")
    for row in rows:
        table.add_row(*row)
    Console(width=130).print(table, found)
    if options.quick:
        raise SystemExit(f"limits missed: {missed}" if missed else 0)
    lines = [head, ["---"] * len(head), *rows]
    write_between(PAGE, "contact/energy_floor.py", "".join("| " + " | ".join(line) + " |\n" for line in lines))
    scenes.finish(__file__, {"found": found, "limits": LIMITS, "cases": cases}, missed)


if __name__ == "__main__":
    main()
