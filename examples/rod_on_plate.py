"""A hemispherical-tip steel rod hits a square aluminium plate (Wang, Liu, Hong 2018, sections 4 and 5).

The model is models/rod_on_plate.py. This script runs it with the basis of your choice, compares force and velocities
with the full FE model, and prints the run times of both. Try the paper's basis, --basis free, to see what the others
save.
"""

import argparse
import json
from pathlib import Path

from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from models import rod_on_plate as model


def peak_memory():
    """Peak memory of this process [GB], if the system reports it."""
    try:
        import resource
    except ImportError:
        return None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def summary(bodies, contact, run, history, reference):
    """Main numbers of the run, for result.json."""
    errors = ep.compare(history, reference)
    energy = sum(item.energy(run) for item in (*bodies, contact))
    change = [body.momentum(run)[-1, 2] - body.momentum(run)[0, 2] for body in bodies]
    basis = bodies[0].body.basis.name
    return {
        "basis": basis,
        "f_cut_Hz": bodies[0].body.f_cut,
        "method": run.method,
        "end_time_s": float(run.t[-1]),
        **{key: history.info[key] for key in ("status", "dofs", "contact_nodes", "step_s", "steps")},
        "modes": [body.body.n_shapes - 6 for body in bodies],
        "rows": model.PAPER.get(basis, "integrated"),
        "time": {"online_s": run.time_s, "reference_s": errors.reference_time_s},
        "error": {"force": errors.error["force"]}
        | {f"velocity_{point.lower()}": errors.error[point] for point in ("P1", "P2")},
        "peak_force_N": history.peak_force,
        "contact_duration_s": history.contact_duration,
        "impulse_Ns": history.impulse,
        "momentum_error": max(abs(change[0] - history.impulse), abs(change[1] + history.impulse)) / history.impulse,
        "energy_error": float(energy[-1] / energy[0] - 1),
        "memory_peak_GB": peak_memory(),
        "left_out": [*bodies[0].body.left_out, *contact.left_out],
        "versions": ep.versions(),
    }


def show(result):
    """Print errors and run times as a table."""
    time = result["time"]
    table = Table(title=f"rod on plate, {result['basis']}: {result['dofs']} of {result['fe_dofs']} dofs")
    table.add_column("quantity")
    table.add_column("relative L2 error")
    for key, value in result["error"].items():
        table.add_row(key, f"{100 * value:.2f} %")
    table.add_section()
    for key, value in time.items():
        source = f" ({result['reference']})" if "reference" in key else ""
        table.add_row(key.replace("_s", ""), f"{value:.3g} s{source}")
    table.add_row("reference / online", f"{time['reference_s'] / time['online_s']:.0f}")
    Console().print(table)


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    bases = ["contact-adapted", "residual", "craig-bampton", "free"]
    parser.add_argument("--basis", default=bases[0], choices=bases)
    parser.add_argument("--f-cut", type=float, default=40e3, metavar="HZ")
    parser.add_argument("--method", default="explicit", choices=["explicit", "implicit"])
    default = "default 5 ms; 0.5 ms with --quick; 0.3 ms if the patch has mass"
    parser.add_argument("--end-time", type=float, metavar="S", help=default)
    parser.add_argument("--quick", action="store_true", help="coarser mesh, 0.5 ms, its own reference")
    parser.add_argument("--reference", action="store_true", help="compute the full FE reference again")
    parser.add_argument("--out", type=Path, default=Path("out/rod_on_plate"), metavar="DIR")
    options = parser.parse_args(argv)
    end_time = options.end_time or (0.5e-3 if options.quick else 0.3e-3 if options.basis in model.WITH_MASS else 5e-3)

    fems, partitions, times = model.fe_models(options.quick, maxh=18e-3 if options.quick else None)
    rod, plate, contact, run, reduce_s = model.partition_run(
        fems, partitions, options.basis, options.f_cut, options.method, end_time
    )
    own = options.quick or options.reference
    reference = model.full_reference(fems, partitions, end_time) if own else model.stored_reference(fems)
    source = "this run" if own else f"stored in {model.STORED.name}"
    if reference.t[-1] < 0.999 * end_time:
        source += f", which ended at {reference.t[-1]:.3g} s"

    history = run.history(contact, {"P1": (rod, model.P1), "P2": (plate, model.P2)})
    result = summary((rod, plate), contact, run, history, reference)
    result["time"] = {**times, "reduce_s": reduce_s, **result["time"]}
    result |= {"fe_dofs": sum(fem.n_dofs for fem in fems), "reference": source}
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    history.save(options.out / "history.npz")
    reference.save(options.out / "reference.npz")
    picture = options.out / "rod_on_plate.png"
    ep.plot.overview(history, reference).savefig(picture, dpi=150)
    axes = ep.plot.bodies(run, bodies=[(rod, fems[0]), (plate, fems[1])], colour="von_mises", scale=50)
    axes.figure.savefig(options.out / "bodies.png", dpi=150)
    run.scene(options.out / "moving.html", title="rod on plate")
    show(result)
    print(picture.resolve())
    return result


if __name__ == "__main__":
    main()
