"""Fig. 11: the paper's four partition schemes and the contact-adapted basis, against the full FE model.

The mesh is that of the example's `--quick`. The distance of its nodes in the impact region is the paper's (0.2 mm). Its
regions of 1 mm radius have 227 nodes where the paper has 250. All runs have the paper's contact rows, node to segment.
Errors are relative L2 over the run; that of the velocities is of their change.
"""

import warnings
from dataclasses import replace
from pathlib import Path

import exudyn as exu
import matplotlib.pyplot as plt
import numpy as np

import exudyn_partition as ep
from examples.models import rod_on_plate as example
from validation.paper import cost
from validation.paper.statements import statement

ROOT = Path(__file__).resolve().parents[2]

SCHEMES = {5e3: (21, 30), 10e3: (32, 56), 20e3: (54, 124), 40e3: (94, 276)}  # Table 2: modes of rod and plate
REGION, ROWS = 1e-3, "node-to-segment"  # radius of the impact region [m]
END, QUICK_END = 5e-3, 0.25e-3  # [s]
QUANTITIES = ("force", "P1", "P2")
LARGE, WELL, OURS = 0.2, 0.05, 0.01  # a large deviation, very good agreement, and what our basis has to reach


def regions(fems, partitions):
    """The same patches in impact regions of REGION; the patch belongs to the region."""
    return [
        replace(p, nodes=np.union1d(p.patch_nodes, np.flatnonzero(np.linalg.norm(fem.points, axis=1) <= REGION)))
        for fem, p in zip(fems, partitions, strict=True)
    ]


def reference(fems, partitions, end_time):
    bodies = [
        ep.reference.FullBody(fem, partition, velocity=(0, 0, -v))
        for fem, partition, v in zip(fems, partitions, (example.SPEED, 0.0), strict=True)
    ]
    points = {"P1": (0, example.P1), "P2": (1, example.P2)}
    with ep.progress("full FE") as report:
        return ep.reference.simulate(bodies, end_time=end_time, step=1e-6, points=points, rows=ROWS, progress=report)


def partition_run(fems, partitions, basis, f_cut, end_time):
    """History of a scheme; `info` holds the time of reduction and the numbers of modes too."""
    bodies = [ep.reduce(fem, p, basis=basis, f_cut=f_cut) for fem, p in zip(fems, partitions, strict=True)]
    mbs = exu.SystemContainer().AddSystem()
    rod = ep.CreatePartitionBody(mbs, bodies[0], name="rod", initialVelocity=[0, 0, -example.SPEED])
    plate = ep.CreatePartitionBody(mbs, bodies[1], name="plate")
    formulation = "lagrange" if basis == "free" else "compliance"
    contact = ep.CreatePartitionContact(mbs, rod, plate, formulation=formulation, rows=ROWS)
    mbs.Assemble()
    with ep.progress(f"{basis}, {f_cut / 1e3:g} kHz") as report, warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", ep.errors.ContactPatchWarning)
        period = 0.5e-6 if basis == "free" else None
        result = ep.solve_dynamic(mbs, end_time=end_time, sample_period=period, progress=report)
    history = result.history(contact, {"P1": (rod, example.P1), "P2": (plate, example.P2)})
    history.info.update(
        offline_s=sum(body.reduce_s for body in bodies),
        modes=[body.n_shapes - 6 for body in bodies],
        left_patch=any(issubclass(w.category, ep.errors.ContactPatchWarning) for w in said),
    )
    return history


def statements(errors):
    """Rows on what the paper says of Fig. 11; `errors` are by basis and frequency, in a quick run without scheme 4."""
    free, adapted = errors["free"], errors["contact-adapted"]
    first, *_, last = free
    static = (
        "free modes hold nothing of the static field around the indentation, which decays as 1 / r only: the contact "
        "is too stiff until the modes are many (more of them or a larger region: error_against_time/rod_on_plate.json)"
    )
    rows = [
        statement("Fig. 11: scheme 1 deviates largely (force)", "large deviation", f"{free[first]['force']:.1%}",
                  free[first]["force"], agrees=free[first]["force"] > LARGE),
    ]  # fmt: skip
    for key in QUANTITIES:
        falling = [free[f_cut][key] for f_cut in free]
        name = "force" if key == "force" else f"velocity of {key}"
        rows.append(
            statement(f"Fig. 11: more modes, more accurate ({name})", "more accurate",
                      ", ".join(f"{x:.1%}" for x in falling), agrees=falling[-1] < 0.7 * falling[0],
                      why="from the first scheme to the last")
        )  # fmt: skip
    if 40e3 not in free:
        return rows
    for key in QUANTITIES:
        name = "force" if key == "force" else f"velocity of {key}"
        rows.append(
            statement(f"Fig. 11: scheme 4 agrees with FE, {name}, the paper's basis", "agrees very well",
                      f"{free[last][key]:.1%}", free[last][key], WELL, known=True,
                      why=static if free[last][key] > WELL else "")
        )  # fmt: skip
    rows.append(
        statement("Fig. 11: scheme 4 with the contact-adapted basis, force", "agrees very well",
                  f"{adapted[last]['force']:.2%}", adapted[last]["force"], OURS,
                  why="the residual flexibility holds the static field")
    )  # fmt: skip
    needed = min((f for f in adapted if adapted[f]["force"] <= WELL), default=None)
    rows.append(
        statement("Fig. 11: truncation must be twice the highest measured frequency (20 kHz)", "40 kHz",
                  "none" if needed is None else f"{needed / 1e3:g} kHz for {WELL:.0%} of force", agrees=needed == last,
                  known=True, why="with the contact-adapted basis; the paper's needs its modes for the static field")
    )  # fmt: skip
    return rows


def draw(runs, full):
    tried = [f_cut for basis, f_cut in runs if basis == "free"]
    figure, axes = plt.subplots(len(tried), 3, figsize=(17, 3.5 * len(tried)), layout="constrained")
    for line, f_cut, scheme in zip(axes, tried, range(1, 1 + len(tried)), strict=True):
        for panel, key in zip(line, QUANTITIES, strict=True):
            for name, run, style in (
                ("full FE", full, {"color": "0.7", "lw": 3}),
                ("free (paper)", runs["free", f_cut], {"color": "C3", "lw": 0.8}),
                ("contact-adapted", runs["contact-adapted", f_cut], {"color": "C0", "lw": 0.8}),
            ):
                x = run.force if key == "force" else run.velocity[key][:, 2]
                panel.plot(1e3 * run.t, x, label=name, **style)
            panel.set(title=f"Fig. 11, scheme {scheme} ({f_cut / 1e3:g} kHz): {key}", xlabel="time [ms]")
            panel.set_ylabel("contact force [N]" if key == "force" else f"velocity of {key} [m/s]")
            panel.grid(alpha=0.3)
        line[0].set(xlim=(0, min(2.5, 1e3 * full.t[-1])), ylim=(-50, 1500))
    axes[0, 0].legend()
    figure.savefig(ROOT / "out" / "paper_fig11.png", dpi=100)


def run(quick):
    """Rows of the report, the table of all runs, and what Table 3 needs."""
    end_time = QUICK_END if quick else END
    fems, partitions, _ = example.fe_models(quick=True)
    partitions = regions(fems, partitions)
    full = reference(fems, partitions, end_time)
    tried = list(SCHEMES)[:3] if quick else SCHEMES
    runs = {(basis, f_cut): partition_run(fems, partitions, basis, f_cut, end_time)
            for basis in ("free", "contact-adapted") for f_cut in tried}  # fmt: skip
    errors = {basis: {f: ep.compare(runs[basis, f], full).error for f in tried} for basis, _ in runs}
    head = ("basis", "scheme", "f_cut", "modes of rod, plate (paper)", "dofs", *QUANTITIES, "off-line", "on-line",
            "contact left its patch")  # fmt: skip
    lines = [
        (
            basis, list(SCHEMES).index(f_cut) + 1, f"{f_cut / 1e3:g} kHz",
            f"{' + '.join(map(str, run.info['modes']))} ({' + '.join(map(str, SCHEMES[f_cut]))})", run.info["dofs"],
            *(f"{errors[basis][f_cut][key]:.2%}" for key in QUANTITIES), f"{run.info['offline_s']:.1f} s",
            f"{run.info['time_s']:.3g} s", "yes, force too small then" if run.info["left_patch"] else "",
        )
        for (basis, f_cut), run in runs.items()
    ]  # fmt: skip
    draw(runs, full)
    title = (
        f"Fig. 11: errors against the full FE model ({full.info['dofs']} dofs, HHT, {full.info['time_s']:.0f} s for "
        f"{1e3 * end_time:g} ms) of {sum(len(p.nodes) for p in partitions)} nodes in the impact regions and these modes"
    )
    found = {
        "rows": statements(errors),
        "tables": {title: (head, lines)},
        "errors": {basis: {f"{f:g}": error for f, error in by_f.items()} for basis, by_f in errors.items()},
        "fe_nodes": [fem.n_nodes for fem in fems],
        "region_nodes": [len(p.nodes) for p in partitions],
    }
    if quick:
        return found
    for basis in errors:
        info = runs[basis, 40e3].info
        found[basis] = {key: info[key] for key in ("dofs", "modes", "offline_s", "step_s", "steps")}
        found[basis]["online_s"] = info["time_s"]
    return found | {"full": cost.explicit_stepping(fems, partitions)}
