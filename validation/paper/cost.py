"""Table 3: numbers of coordinates and run times, the full FE model by the same explicit integrator."""

import time
from dataclasses import replace

import exudyn as exu
import numpy as np

import exudyn_partition as ep
from validation.paper.statements import statement

PRINTED_HOURS = 20.0, 0.973  # FEM (more than that), partition method
DURATION = 5e-3  # [s]
COUNTS = 40, 240  # steps of two runs, whose difference is the time of steps alone
PRODUCTS = 30


def explicit_stepping(fems, partitions):
    """Step and its time, of the full FE model with lumped mass: a partition whose impact region is the whole body."""
    whole = [replace(p, nodes=np.arange(fem.n_nodes)) for fem, p in zip(fems, partitions, strict=True)]
    bodies = [ep.reduce(fem, p, basis="free", f_cut=40e3) for fem, p in zip(fems, whole, strict=True)]
    mbs = exu.SystemContainer().AddSystem()
    rod = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -0.596])
    plate = ep.CreatePartitionBody(mbs, bodies[1])
    ep.CreatePartitionContact(mbs, rod, plate, formulation="lagrange", rows="node-to-segment")
    mbs.Assemble()
    step = 0.9 * ep.stability_limit(mbs)
    times = [ep.solve_dynamic(mbs, end_time=n * step, step=step, sample_period=n * step).time_s for n in COUNTS]
    return {
        "dofs": sum(fem.n_dofs for fem in fems),
        "step_s": step,
        "steps": int(np.ceil(DURATION / step)),
        "step_time_s": (times[1] - times[0]) / (COUNTS[1] - COUNTS[0]),
        "product_s": sum(product_time(fem.stiffness) for fem in fems),
    }


def product_time(K):
    """Time of a product K u alone. No explicit FE code with assembled matrices needs less time for a step."""
    u, begin = np.random.default_rng(0).normal(size=K.shape[0]), time.perf_counter()
    for _ in range(PRODUCTS):
        K @ u
    return (time.perf_counter() - begin) / PRODUCTS


def table_3(impact, schemes):
    """Rows of the report, and the table, from what the runs on both meshes measured."""
    head = ("model", "nodes", "modes", "dofs", "step", "steps", "off-line", "on-line, 5 ms", "source")
    lines = [
        ("FEM", 95218, "", 285654, "", "", "", "> 20 h", "paper"),
        ("partition method, scheme 4", 250, "94 + 276", 1120, "", "", "", "0.973 h", "paper"),
    ]
    hours = {}
    for name, mesh, nodes in (("coarse", schemes, "fe_nodes"), ("fine", impact, "fe_nodes")):
        full = mesh["full"]
        hours[name] = full["steps"] * full["step_time_s"] / 3600
        lines.append(
            (f"FEM, {name} mesh", sum(mesh[nodes]), "", full["dofs"], f"{1e9 * full['step_s']:.2f} ns", full["steps"],
             "", f"{hours[name]:.3g} h", f"{1e3 * full['step_time_s']:.1f} ms a step, measured, times the steps "
             f"({1e3 * full['product_s']:.1f} ms are K u alone)")
        )  # fmt: skip
    for name, label, mesh, basis in (
        ("paper", "partition method, scheme 4, coarse mesh", schemes, "free"),
        ("coarse", "contact-adapted, coarse mesh", schemes, "contact-adapted"),
        ("fine", "contact-adapted, fine mesh", impact, "contact-adapted"),
    ):
        run = mesh[basis]
        hours[name, basis] = run["online_s"] / 3600
        nodes, modes = sum(mesh["region_nodes"]) if basis == "free" else "", " + ".join(map(str, run["modes"]))
        lines.append(
            (label, nodes, modes, run["dofs"], f"{1e9 * run['step_s']:.4g} ns", run["steps"],
             f"{run['offline_s']:.1f} s", f"{run['online_s']:.3g} s", "measured")
        )  # fmt: skip
    printed = PRINTED_HOURS[0] / PRINTED_HOURS[1]
    same = hours["coarse"] / hours["paper", "free"]
    ours = hours["fine"] / hours["fine", "contact-adapted"]
    with_offline = hours["fine", "contact-adapted"] + impact["contact-adapted"]["offline_s"] / 3600
    end_to_end = hours["fine"] / with_offline
    dofs = schemes["free"]["dofs"]
    rows = [
        statement("Table 3: dofs of scheme 4", 1120, dofs, dofs / 1120 - 1, 0.15,
                  why="three a node, and the modes; rigid motion comes to it"),
        statement("Table 3: FE over partition method, run times, the paper's own scheme", f"> {printed:.1f}",
                  f"{same:.3g}", agrees=same > printed / 2, known=True,
                  why="one mesh, one integrator, equal steps: this is what the fewer coordinates alone save"),
        statement("Table 3: FE over contact-adapted basis, on-line, fine mesh", f"> {printed:.1f}", f"{ours:.3g}",
                  agrees=ours > printed, why="no nodal mass: steps of 1 us, not of nanoseconds"),
        statement("Table 3: FE over contact-adapted basis, off-line time counted", f"> {printed:.1f}",
                  f"{end_to_end:.3g}", agrees=end_to_end > printed),
    ]  # fmt: skip
    title = "Table 3: dofs and run times, all with explicit steps; the paper's on its machine, ours on one core of this"
    return {"rows": rows, "tables": {title: (head, lines)}}
