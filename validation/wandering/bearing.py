"""A ball bearing of 12 elastic balls between rigid races, against Hertz springs between the races.

Reference: `examples/models/ball_bearing_theory.py`, elliptic contacts of half spaces, massless balls. Quantity: forces
of the balls and deflection of the shaft at rest, for three clearances, with a ball or a gap below the load; forces
while the cage turns by a pitch, with the processor's time of a step and of a closed contact. Error of a force: by the
largest force.
Limits: 2 % each; 1 % for the largest force without clearance by Stribeck's 4.37 times load over balls; forces of the
balls bear the load to 1e-3 at rest.

    python -m validation.wandering.bearing [--quick]
"""

import argparse
import time

import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from examples.models import ball_bearing as model
from examples.models import ball_bearing_theory as theory
from validation.contact import scenes

LOAD, CLEARANCES = 2000.0, (1e-8, 2e-6, 10e-6)  # [N], along the diameter [m]; the first is as good as none
MESH, QUICK_MESH = (0.10e-3, 0.5e-3), (0.16e-3, 0.42e-3)  # as in the example
SPEED, RISE, STRIBECK = 100.0, 1e-3, 4.37
LIMITS = {"force": 0.02, "deflection": 0.02, "moving": 0.02, "stribeck": 0.01, "balance": 1e-3}


def at_rest(body, clearance, half):
    """Errors at rest; `half` of a pitch the balls are turned."""
    bearing = model.bearing(body, LOAD, clearance, model.Turn(0.0, RISE), half * np.pi / model.BALLS)
    result = ep.solve_static(bearing.mbs, load_steps=4)
    force = np.array([contact.force(result)[-1] for contact in bearing.inner])
    place, expected = theory.equilibrium(LOAD, clearance, bearing.angles)
    found = bearing.mbs.GetSensorStoredData(bearing.place)[-1, 1:3]
    return {
        "clearance_m": clearance,
        "half_pitch": half,
        "largest": force.max() * model.BALLS / LOAD,
        "force": abs(force - expected).max() / expected.max(),
        "deflection": found[1] / place[1] - 1,
        "balance": abs(force @ np.sin(bearing.angles) + model.SOFT * found[1] + LOAD) / LOAD,
    }


def turning(body, end_time, step):
    """Largest error of the forces while the cage turns, and times."""
    clearance = CLEARANCES[1]
    bearing = model.bearing(body, LOAD, clearance, model.Turn(SPEED, RISE))
    begin = time.process_time()
    _, run = model.run(bearing, end_time, step)
    cpu_s = time.process_time() - begin
    force = np.array([contact.force(run) for contact in bearing.inner])
    expected = np.array([theory.equilibrium(LOAD, clearance, bearing.angles + bearing.turn(t))[1] for t in run.t]).T
    closed = sum(np.count_nonzero(contact.closed_rows(run)) for contact in bearing.inner + bearing.outer)
    return {
        "pitches": bearing.turn(run.t[-1]) * model.BALLS / (2 * np.pi),
        "moving": abs(force - expected).max() / expected.max(),
        "steps": run.steps,
        "online_cpu_s": cpu_s,
        "ms_a_step": 1e3 * cpu_s / run.steps,
        "ms_a_step_and_closed_contact": 1e3 * cpu_s / closed,
        "online_s": run.time_s,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a coarse mesh, one clearance, a short turn")
    options = parser.parse_args()
    fem, part = model.ball_part(*(QUICK_MESH if options.quick else MESH))
    body = ep.reduce(fem, part, f_cut=model.F_CUT)
    rest = [at_rest(body, c, half) for c in CLEARANCES[: 1 if options.quick else None] for half in (0, 1)]
    moving = turning(body, *((1.2e-3, 2e-4) if options.quick else (6e-3, 5e-5)))
    table = Table(*rest[0])
    for entry in rest:
        table.add_row(*(f"{value:.4g}" for value in entry.values()))
    Console(width=150).print(table, moving)
    found = {
        "force": max(entry["force"] for entry in rest),
        "deflection": max(abs(entry["deflection"]) for entry in rest),
        "moving": moving["moving"],
        "stribeck": abs(rest[0]["largest"] / STRIBECK - 1),
        "balance": max(entry["balance"] for entry in rest),
    }
    missed = [f"{key} {found[key]:.3g}" for key in LIMITS if found[key] > LIMITS[key]]
    if options.quick:
        raise SystemExit(f"limits missed: {missed}" if missed else 0)
    result = {
        "found": found,
        "limits": LIMITS,
        "at_rest": rest,
        "turning": moving,
        "reduce_s": body.reduce_s,
        "dofs": model.BALLS * body.n_dofs,
        "fe_dofs": model.BALLS * fem.n_dofs,
    }
    scenes.finish(__file__, result, missed)


if __name__ == "__main__":
    main()
