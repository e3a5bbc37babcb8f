"""The rod of the paper hits the plate at an angle, with friction: at 15 and 45 degrees, and grazing.

The model is models/rod_on_plate.py, with patches that also yield along the surface (axes="xyz"); numbers and figure are
made in models/oblique_results.py. The rod stands upright and moves down and sideways. At 15 degrees its tip sticks to
the plate in the middle of the contact; from 45 degrees on all of the contact slips. Forces and velocities at 15 degrees
are compared with the full FE model with that friction.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from models import oblique_results as results
from models import rod_on_plate as model

FRICTION = 0.3
ANGLES = {"15 degrees": 15.0, "45 degrees": 45.0, "grazing": 75.0}  # of the velocity, from the plate's normal
COMPARED = "15 degrees"  # with the full FE model


def speed_along(angle):
    """Speed of the rod along the plate [m/s], with the paper's speed along the normal."""
    return model.SPEED * np.tan(np.radians(angle))


def show(result):
    """Print errors and run times as a table."""
    table = Table(title=f"oblique impact, friction {FRICTION}: {result['dofs']} of {result['fe_dofs']} dofs")
    for column in ("quantity", *ANGLES):
        table.add_column(column)
    for key in ("peak_force_N", "peak_tangential_N", "impulse_ratio", "dissipated_J", "energy_error", "online_s"):
        table.add_row(key, *(f"{result['runs'][name][key]:.4g}" for name in ANGLES))
    table.add_section()
    for key, value in result["error"].items():
        table.add_row(f"error of {key}", f"{100 * value:.2f} %", "", "")
    table.add_row("full FE reference", f"{result['time']['reference_s']:.3g} s", "", "")
    Console().print(table)


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--f-cut", type=float, default=40e3, metavar="HZ")
    parser.add_argument("--end-time", type=float, default=0.3e-3, metavar="S")
    parser.add_argument("--quick", action="store_true", help="coarser mesh, a shorter run")
    parser.add_argument("--out", type=Path, default=Path("out/oblique_impact"), metavar="DIR")
    options = parser.parse_args(argv)
    end_time = min(options.end_time, 0.12e-3) if options.quick else options.end_time

    fems, partitions, times = model.fe_models(options.quick, maxh=18e-3 if options.quick else None, axes="xyz")
    bodies = [ep.reduce(fem, partition, f_cut=options.f_cut) for fem, partition in zip(fems, partitions, strict=True)]
    runs = {name: model.oblique_run(bodies, speed_along(angle), FRICTION, end_time) for name, angle in ANGLES.items()}
    along = speed_along(ANGLES[COMPARED])
    reference = model.full_reference(
        fems, partitions, end_time, points=model.NEAR_CONTACT, along=along, friction=FRICTION
    )
    history = results.history_of(*runs[COMPARED])
    errors = ep.compare(history, reference)
    found = {name: results.numbers(*run) for name, run in runs.items()}
    result = {
        "friction": FRICTION,
        "f_cut_Hz": options.f_cut,
        "end_time_s": end_time,
        **{key: history.info[key] for key in ("dofs", "contact_nodes", "step_s", "steps")},
        "fe_dofs": sum(fem.n_dofs for fem in fems),
        "time": {
            **times,
            "reduce_s": sum(body.reduce_s for body in bodies),
            "online_s": found[COMPARED]["online_s"],
            "reference_s": errors.reference_time_s,
        },
        "error": {
            "normal": errors.error["force"],
            "tangential": errors.error["tangential"],
            "velocity_tip": errors.error["tip"],
            "velocity_plate": errors.error["plate"],
        },
        "peak_force_N": found[COMPARED]["peak_force_N"],
        "dissipated_J": found[COMPARED]["dissipated_J"],
        "dissipated_reference_J": reference.info["dissipated_J"],
        "runs": found,
        "versions": ep.versions(),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    history.save(options.out / "history.npz")
    reference.save(options.out / "reference.npz")
    picture = options.out / "oblique_impact.png"
    results.figure(runs, reference, COMPARED, FRICTION).savefig(picture, dpi=150)
    items, _, run = runs["45 degrees"]
    axes = ep.plot.bodies(run, bodies=list(zip(items, fems, strict=True)), colour="von_mises")
    axes.figure.savefig(options.out / "bodies.png", dpi=150)
    run.scene(options.out / "moving.html", title="oblique impact, 45 degrees")
    show(result)
    print(picture.resolve())
    return result


if __name__ == "__main__":
    main()
