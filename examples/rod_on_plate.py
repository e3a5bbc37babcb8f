"""A hemispherical-tip steel rod hits a square aluminium plate (Wang, Liu, Hong 2018, sections 4 and 5).

Lengths and thickness are reconstructed, for the paper's Table 1 is missing from our copy; speed, duration, tip radius,
materials' names and the measured points are the paper's.
"""

import argparse
import json
import math
import time
from pathlib import Path

import exudyn as exu
import netgen.occ as occ
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep

RADIUS, LENGTH = 0.010, 0.800  # rod [m], tip included
SIDE, THICKNESS = 0.250, 0.005  # plate [m]
SPEED = 0.596  # [m/s]
PEAK_FORCE = 800.0  # [N], the paper's estimate from Hertz
P1, P2 = (0, 0, LENGTH), (0, 0, -THICKNESS)  # back end of the rod; plate's face opposite to the impact
WITH_MASS = ("free", "craig-bampton")  # bases whose patch has mass: multipliers, steps of nanoseconds
PAPER = {"free": "node-to-segment"}  # the paper's basis comes with the paper's rows
STORED = Path(__file__).with_name("rod_on_plate_reference.npz")


def fe_models(quick, maxh=None):
    """FE models of rod and plate with their partitions, and the times of meshing and assembly; maxh [m] far away."""
    rod = occ.Cylinder(occ.Pnt(0, 0, RADIUS), occ.Z, r=RADIUS, h=LENGTH - RADIUS) + occ.Sphere(
        occ.Pnt(0, 0, RADIUS), RADIUS
    )
    plate = occ.Box(occ.Pnt(-SIDE / 2, -SIDE / 2, -THICKNESS), occ.Pnt(SIDE / 2, SIDE / 2, 0))
    coarse, h_rod, h_plate = (12e-3, 0.35e-3, 0.45e-3) if quick else (6e-3, 0.20e-3, 0.25e-3)
    maxh = maxh or coarse
    begin = time.perf_counter()
    meshes = [
        ep.generate_mesh(rod, maxh=maxh, refine=[ep.Refine((0, 0, 0), 0.6e-3, h_rod)], grading=0.35),
        ep.generate_mesh(plate, maxh=maxh, refine=[ep.Refine((0, 0, 0), 0.6e-3, h_plate)], grading=0.4),
    ]
    mesh_s, begin = time.perf_counter() - begin, time.perf_counter()
    fems = [ep.fe_model(mesh, material) for mesh, material in zip(meshes, (ep.STEEL, ep.ALUMINIUM), strict=True)]
    times = {"mesh_s": mesh_s, "fem_s": time.perf_counter() - begin}
    # The tip's patch is larger than the contact circle, the plate's larger still: all but rim nodes have a partner.
    reach = 1.7 * ep.hertz.contact_radius(PEAK_FORCE, RADIUS, math.inf, ep.STEEL, ep.ALUMINIUM)
    region = 1.5e-3 if quick else 1e-3
    partitions = [
        ep.Partition.ball(fems[0], center=(0, 0, 0), radius=region, contact_radius=reach),
        ep.Partition.ball(fems[1], center=(0, 0, 0), radius=region),
    ]
    return fems, partitions, times


def partition_run(fems, partitions, basis, f_cut, method, end_time):
    """Reduce both bodies, let them collide in Exudyn; returns bodies, contact, result and the time of reduction."""
    reduced = []
    for name, fem, partition in zip(("rod", "plate"), fems, partitions, strict=True):
        with ep.progress(f"reduce {name}, {basis}") as report:
            reduced.append(ep.reduce(fem, partition, basis=basis, f_cut=f_cut, progress=report))
    mbs = exu.SystemContainer().AddSystem()
    rod = ep.CreatePartitionBody(mbs, reduced[0], name="rod", initialVelocity=[0, 0, -SPEED])
    plate = ep.CreatePartitionBody(mbs, reduced[1], name="plate")
    formulation = "lagrange" if basis in WITH_MASS else "compliance"
    rows = PAPER.get(basis, "integrated")
    contact = ep.CreatePartitionContact(mbs, rod, plate, formulation=formulation, rows=rows, name="tip on plate")
    mbs.Assemble()
    with ep.progress(f"Exudyn, {method}") as report:
        sample_period = 0.5e-6 if basis in WITH_MASS else None
        result = ep.solve_dynamic(mbs, end_time=end_time, method=method, sample_period=sample_period, progress=report)
    return rod, plate, contact, result, sum(body.reduce_s for body in reduced)


def full_reference(fems, partitions, end_time, step=1e-6):
    """The full FE model under integrated contact rows."""
    bodies = [
        ep.reference.FullBody(fems[0], partitions[0], velocity=(0, 0, -SPEED)),
        ep.reference.FullBody(fems[1], partitions[1]),
    ]
    with ep.progress("full FE reference") as report:
        history = ep.reference.simulate(
            bodies, end_time=end_time, step=step, points={"P1": (0, P1), "P2": (1, P2)}, progress=report
        )
    history.info["versions"] = ep.versions()
    return history


def stored_reference(fems):
    """The stored full FE history."""
    reference = ep.History.load(STORED)
    dofs = sum(fem.n_dofs for fem in fems)
    if reference.info["dofs"] != dofs:
        mesher = reference.info["versions"]["ngsolve"]
        print(
            f"{STORED.name} is of another mesh, {reference.info['dofs']} dofs by NGSolve {mesher}, not {dofs}: errors"
        )
        print("hold the meshes' difference; run with --reference for your own")
    return reference


def peak_memory():
    """Peak memory of this process [GB], where the system tells."""
    try:
        import resource
    except ImportError:
        return None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def summary(fems, times, run, reduce_s, reference, source):
    """What goes into result.json."""
    rod, plate, contact, result = run
    history = result.history(contact, {"P1": (rod, P1), "P2": (plate, P2)})
    errors = ep.compare(history, reference)
    energy = rod.energy(result) + plate.energy(result) + contact.energy(result)
    change = [item.momentum(result)[-1, 2] - item.momentum(result)[0, 2] for item in (rod, plate)]
    return history, {
        "basis": rod.body.basis.name,
        "f_cut_Hz": rod.body.f_cut,
        "method": result.method,
        "status": result.status,
        "end_time_s": float(result.t[-1]),
        "dofs": rod.body.n_dofs + plate.body.n_dofs,
        "fe_dofs": sum(fem.n_dofs for fem in fems),
        "modes": [item.body.n_shapes - 6 for item in (rod, plate)],
        "rows": PAPER.get(rod.body.basis.name, "integrated"),
        "contact_nodes": contact.n_rows,
        "step_s": result.step,
        "steps": result.steps,
        "time": {
            **times,
            "reduce_s": reduce_s,
            "online_s": result.time_s,
            "reference_s": errors.reference_time_s,
        },
        "reference": source,
        "error": {
            "force": errors.error["force"],
            "velocity_p1": errors.error["P1"],
            "velocity_p2": errors.error["P2"],
        },
        "peak_force_N": history.peak_force,
        "contact_duration_s": history.contact_duration,
        "impulse_Ns": history.impulse,
        "momentum_error": max(abs(change[0] - history.impulse), abs(change[1] + history.impulse)) / history.impulse,
        "energy_error": float(energy[-1] / energy[0] - 1),
        "memory_peak_GB": peak_memory(),
        "left_out": [*rod.body.left_out, *contact.left_out],
        "versions": ep.versions(),
    }


def show(result):
    """Errors beside times, on the terminal."""
    table = Table(title=f"rod on plate, {result['basis']}: {result['dofs']} of {result['fe_dofs']} dofs")
    for column in ("quantity", "relative L2 error"):
        table.add_column(column)
    for key, value in result["error"].items():
        table.add_row(key, f"{100 * value:.2f} %")
    table.add_section()
    for key, value in result["time"].items():
        table.add_row(
            key.replace("_s", ""),
            f"{value:.3g} s" + (f" ({result['reference']})" if "reference" in key else ""),
        )
    table.add_row("reference / online", f"{result['time']['reference_s'] / result['time']['online_s']:.0f}")
    Console().print(table)


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--basis", default="contact-adapted", choices=["contact-adapted", "residual", "craig-bampton", "free"]
    )
    parser.add_argument("--f-cut", type=float, default=40e3, metavar="HZ")
    parser.add_argument("--method", default="explicit", choices=["explicit", "implicit"])
    parser.add_argument(
        "--end-time", type=float, metavar="S", help="default 5 ms; 0.5 ms with --quick; 0.3 ms if the patch has mass"
    )
    parser.add_argument("--quick", action="store_true", help="coarser mesh, 0.5 ms, its own reference")
    parser.add_argument("--reference", action="store_true", help="compute the full FE reference anew")
    parser.add_argument("--out", type=Path, default=Path("out/rod_on_plate"), metavar="DIR")
    options = parser.parse_args(argv)
    end_time = options.end_time or (0.5e-3 if options.quick else 0.3e-3 if options.basis in WITH_MASS else 5e-3)

    fems, partitions, times = fe_models(options.quick)
    *run, reduce_s = partition_run(fems, partitions, options.basis, options.f_cut, options.method, end_time)
    own = options.quick or options.reference
    reference = full_reference(fems, partitions, end_time) if own else stored_reference(fems)
    source = "this run" if own else f"stored in {STORED.name}"
    if reference.t[-1] < 0.999 * end_time:
        source += f", which ended at {reference.t[-1]:.3g} s"
    history, result = summary(fems, times, run, reduce_s, reference, source)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    history.save(options.out / "history.npz")
    reference.save(options.out / "reference.npz")
    picture = options.out / "rod_on_plate.png"
    ep.plot.overview(history, reference).savefig(picture, dpi=150)
    show(result)
    print(picture.resolve())
    return result


if __name__ == "__main__":
    main()
