"""What plastic impacts owe to the tolerance and the precision of their steps, and to the mesh.

A steel ball of 10 mm falls on a free aluminium plate of 20 x 20 x 5 mm (Y 200 MPa, H 500 MPa) at 0.1 to 2 m/s, as in
`impact.py`, with two elements in the radius of the contact.
Quantities: coefficient of restitution, depth of the dent, plastic work. Each is compared with
- the same steps in double precision, which settle to 1e-8 (the library: single precision, 1e-4),
- steps half as long,
- a mesh with three elements in the radius of the contact.
Limits: 0.05 % for what tolerance and precision change, 0.2 % for the step. For the mesh, with which the deepest node of
the dent changes most: 2 % of restitution, 3 % of work, 12 % of the dent.

With --quick it takes one speed, and the numbers of the fine mesh that the whole run has left in its JSON file.

    python -m validation.inelastic.settling [--quick] [--out FILE]
"""

import argparse
import json
import math
import time
import warnings
from pathlib import Path
from unittest import mock

import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.contact.plasticity import yielding_patches
from exudyn_partition.contact.plasticity.yielding_zone import YieldingZone
from validation.contact import scenes
from validation.inelastic.impact import ALUMINIUM, F_CUT, RADIUS, STEEL, THICKNESS, WIDTH, reduced_run, scene

SPEEDS, QUICK = (0.1, 0.3, 0.6, 1.0, 2.0), 0.6  # [m/s]
ELEMENTS, FINE, CLOSE = 2.0, 3.0, 1e-8
QUANTITIES = ("restitution", "dent_m", "work_J")
LIMITS = {"settling": 5e-4, "step": 2e-3, "mesh: restitution": 0.02, "mesh: work": 0.03, "mesh: dent": 0.12}


def hertz_of(speed):
    """Hertz' elastic impact at a speed [m/s]."""
    mass = ep.hertz.effective(4 / 3 * np.pi * RADIUS**3 * STEEL.rho, WIDTH**2 * THICKNESS * ALUMINIUM.rho)
    return ep.hertz.impact(mass, speed, RADIUS, math.inf, STEEL, ALUMINIUM)


def bodies_of(speed, elements):
    models, _, _ = scene(speed / hertz_of(speed).yield_speed, elements)
    return [ep.reduce(*model, f_cut=F_CUT) for model in models]


def measured(bodies, speed, step=None):
    """Quantities of one impact, and its step [s]."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ep.errors.YieldWarning)  # of flow at the edge of the zone
        (ball, plate), contact, run = reduced_run(bodies, speed, 1.5 * hertz_of(speed).duration, step)
    after = [item.momentum(run)[-1, 2] / item.body.total_mass for item in (ball, plate)]
    found = (after[0] - after[1]) / speed, max(contact.plastic.dents(run).values()), contact.plastic.work(run)[-1]
    return dict(zip(QUANTITIES, map(float, found), strict=True)), run.step


def settled_closely(bodies, speed, step):
    """The same in double precision, with steps that settle to `CLOSE`."""
    in_precision = YieldingZone.in_precision
    with (
        mock.patch.object(yielding_patches, "_SETTLED", CLOSE),
        mock.patch.object(YieldingZone, "in_precision", lambda zone, kind: in_precision(zone, np.float64)),
    ):
        return measured(bodies, speed, step)[0]


def case(speed, fine):
    """Quantities at one speed [m/s], and what changes them; `fine` are those of the fine mesh, if they are known."""
    bodies = bodies_of(speed, ELEMENTS)
    found, step = measured(bodies, speed)
    others = {
        "settling": settled_closely(bodies, speed, step),
        "step": measured(bodies, speed, step / 2)[0],
        "mesh": fine or measured(bodies_of(speed, FINE), speed)[0],
    }
    return {
        "speed_m_s": speed,
        "yield_speed_ratio": speed / hertz_of(speed).yield_speed,
        "found": found,
        "others": others,
        "changes": {name: {key: found[key] / one[key] - 1 for key in QUANTITIES} for name, one in others.items()},
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one speed, against the stored numbers of the fine mesh")
    parser.add_argument("--out", type=Path, help="where to write the JSON result; default: beside this script")
    options = parser.parse_args()
    begin, cases, kept = time.perf_counter(), [], {}
    if options.quick:
        stored = json.loads(Path(__file__).with_suffix(".json").read_text())["cases"]
        kept = {one["speed_m_s"]: one["others"]["mesh"] for one in stored}
    for speed in (QUICK,) if options.quick else SPEEDS:
        cases.append(case(speed, kept.get(speed)))
        Console(width=150).print(cases[-1])
    names = "settling", "step", "mesh"
    largest = {
        name: {key: max(abs(one["changes"][name][key]) for one in cases) for key in QUANTITIES} for name in names
    }
    worst = {name: max(largest[name].values()) for name in names[:2]}
    worst |= {f"mesh: {key.partition('_')[0]}": value for key, value in largest["mesh"].items()}
    failed = [f"{name} {worst[name]:.3g}" for name, limit in LIMITS.items() if not worst[name] <= limit]
    head = ("speed", "e", "dent", "work", *(f"{name}: {key}" for name in names for key in ("e", "dent", "work")))
    rows = [
        (f"{one['speed_m_s']:g} m/s", f"{one['found']['restitution']:.4f}", f"{1e6 * one['found']['dent_m']:.3f} um",
         f"{1e6 * one['found']['work_J']:.2f} uJ",
         *(f"{one['changes'][name][key]:+.3%}" for name in names for key in QUANTITIES))
        for one in cases
    ]  # fmt: skip
    title = "Plastic impacts: what tolerance and precision, the step, and the mesh change"
    table = Table(*head, title=title)
    for row in rows:
        table.add_row(*row)
    Console(width=180).print(table)
    result = {
        "found": worst,
        "limits": LIMITS,
        "cases": cases,
        "tables": {title: (head, rows)},
        "time_s": time.perf_counter() - begin,
    }
    scenes.finish(__file__, result, failed, options.out)


if __name__ == "__main__":
    main()
