"""Oblique impact of the rod on the plate with friction, against the full FE model of the same mesh, rows and friction.

Three speeds along the plate: the tip sticks, slips in part, and slips. Quantity: relative L2 errors of normal and
tangential force and of velocities near the contact; energy, momentum, and run times of the same session, on-line and of
the reference's stepping.
Limits: normal force 1 %, tangential force 2 %, velocities of the tip 2 %, energy with what friction took 1e-4, momentum
1e-9, at most 2 ms a step in contact.

    python -m validation.friction.oblique [--quick]
"""

import argparse
import runpy
from types import SimpleNamespace

import numpy as np
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes

FRICTION, F_CUT, END = 0.3, 40e3, 0.3e-3
ALONG = {"stick": 0.03, "partial slip": 0.16, "gross slip": 0.6}  # m/s
LIMITS = {"normal": 0.01, "tangential": 0.02, "velocity_tip": 0.02, "energy": 1e-4, "momentum": 1e-9, "ms_a_step": 2.0}


def compared(model, fems, partitions, bodies, along, end):
    """Errors and times of one speed, and both histories."""
    items, contact, run = model.oblique_run(bodies, along, FRICTION, end)
    points = {name: (items[index], point) for name, (index, point) in model.NEAR_CONTACT.items()}
    history = run.history(contact, points)
    reference = model.full_reference(fems, partitions, end, points=model.NEAR_CONTACT, along=along, friction=FRICTION)
    errors = ep.compare(history, reference)
    energy = sum(item.energy(run) for item in (*items, contact)) + contact.dissipated_energy(run)
    momentum = sum(item.momentum(run) for item in items)
    closed = int(np.count_nonzero(contact.closed_rows(run)))
    return {
        "normal": errors.error["force"],
        "tangential": errors.error["tangential"],
        "velocity_tip": errors.error["tip"],
        "velocity_plate": errors.error["plate"],
        "energy": float(abs(energy / energy[0] - 1).max()),
        "momentum": float(abs(momentum - momentum[0]).max() / abs(momentum[0]).max()),
        "dissipated_J": float(contact.dissipated_energy(run)[-1]),
        "dissipated_reference_J": reference.info["dissipated_J"],
        "rows": int(contact.closed_rows(run).max()),
        "stuck_rows": int(contact.stuck_rows(run).max()),
        "ms_a_step": 1e3 * run.work.contact_s / closed,
        "online_s": run.time_s,
        "steps": run.steps,
        "reference_s": errors.reference_time_s,
        "reference_steps": reference.info["steps"],
    }, (history, reference)


def draw(histories):
    path, (_, axes) = scenes.figure(__file__, ncols=len(histories), figsize=(5 * len(histories), 4.5))
    for ax, (name, (run, reference)) in zip(axes, histories.items(), strict=True):
        for history, style in ((reference, {"color": "0.7", "linewidth": 3}), (run, {"color": "C3", "linewidth": 1})):
            ax.plot(1e3 * history.t, history.force, **style)
            ax.plot(1e3 * history.t, -history.tangential_force[:, 0], linestyle="--", **style)
        ax.plot(1e3 * run.t, FRICTION * run.force, "k:", linewidth=0.8)
        ax.set(xlabel="time [ms]", ylabel="normal and tangential force [N]", title=name)
    axes[0].figure.savefig(path, dpi=150)
    return path


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="coarser mesh, 0.12 ms")
    options = parser.parse_args()
    model = SimpleNamespace(**runpy.run_path(str(scenes.ROOT / "examples" / "models" / "rod_on_plate.py")))
    fems, partitions, _ = model.fe_models(options.quick, axes="xyz")
    bodies = [ep.reduce(fem, part, f_cut=F_CUT) for fem, part in zip(fems, partitions, strict=True)]
    cases, histories, console = {}, {}, Console(width=150)
    for name, along in ALONG.items():
        end = 0.4 * END if options.quick else END
        cases[name], histories[name] = compared(model, fems, partitions, bodies, along, end)
        console.print(name, cases[name])
    console.print(str(draw(histories)))
    found = {key: max(case[key] for case in cases.values()) for key in LIMITS}
    found["speedup"] = min(case["reference_s"] / case["online_s"] for case in cases.values())
    result = {
        "found": found,
        "limits": LIMITS,
        "cases": cases,
        "reduce_s": sum(body.reduce_s for body in bodies),
        "dofs": sum(body.n_dofs for body in bodies),
        "fe_dofs": sum(fem.n_dofs for fem in fems),
        "quick": options.quick,
    }
    missed = [f"{key} {found[key]:.3g}" for key in LIMITS if found[key] > LIMITS[key]]
    if options.quick:
        raise SystemExit(f"limits missed: {missed}" if missed else 0)
    scenes.finish(__file__, result, missed)


if __name__ == "__main__":
    main()
