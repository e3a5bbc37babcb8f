"""Longitudinal impacts of bars: two equal bars, and a bar on a rigid wall, compared with Saint-Venant's waves.

Reference: two 2 x 2 x 10 bars, E = rho = 1, nu = 0, speeds +-0.1: force 0.4, contact lasts 20, velocities
swap exactly. Steel bar on a wall: L = 1 m, section 3.14e-4 m2, nu = 0, gap 50 um, 0.1 m/s: contact starts at 0.5 ms,
lasts 385.4 us, force 1270.8 N, the velocity is reversed.
Quantity: for several f_cut, the mean force over the middle half of the contact, its start (error over the duration),
the time from first to last force, and the velocities of the centres of mass afterwards. The table also has impulse,
energy, run times and the ripple of the force on its plateau.
Limits, at the highest f_cut: force and start within 0.5 %, duration and velocities within 1.5 %. Contact ends at some
phase of the ripple, whose period is 5 % of the contact: steps, meshes and f_cut change both by up to 1.3 %.

The ripple does not fall with f_cut. Each bar feels the other through the mobility of its end, 1 / Z for a wave
impedance Z. If modes above f_cut are replaced by their static flexibility, the mobility at x = f / f_cut > 1 is
j (2 x - ln((x + 1) / (x - 1))) / (pi Z). It vanishes at x = 1.2. This frequency is above all kept modes and rings
without damping: at 80 % of the plateau after a step of velocity (standard deviation 57 %), whatever f_cut is. Impacts
of round bodies hardly excite it. Implicit integration that damps high frequencies removes it. The table has one such
run.

    python -m validation.contact.bars
"""

import itertools
import tempfile
import time
from pathlib import Path

import exudyn as exu
import meshio
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.contact import scenes

LIMITS = {"force": 0.005, "start": 0.005, "duration": 0.015, "velocity": 0.015}
ROWS = ("node-to-segment", "integrated")
QUANTITIES = tuple(LIMITS)


def bar(side, length, material, cells, *, up):
    """FE model of a bar above or below z = 0, and the partition of its end there.

    A grid of (across, along) cells, six quadratic tetrahedra each, which are thin along the bar.
    """
    across, along = cells
    x = np.linspace(-side / 2, side / 2, across + 1)
    z = np.linspace(0, length, along + 1) - (0 if up else length)
    points = np.stack(np.meshgrid(x, x, z, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(across + 1, across + 1, along + 1)
    tets = []
    for order in itertools.permutations(range(3)):
        corner, path = np.zeros(3, dtype=int), [np.zeros(3, dtype=int)]
        for axis in order:
            corner = corner + np.eye(3, dtype=int)[axis]
            path.append(corner)
        at = [number[i : i + across, j : j + across, k : k + along].ravel() for i, j, k in path]
        if np.linalg.det(np.diff(path, axis=0)) < 0:
            at[2:] = at[:1:-1]
        tets.append(np.stack(at, axis=1))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bar.vtu"
        meshio.Mesh(points, [("tetra", np.vstack(tets))]).write(file)
        fem = ep.fe_model(file, material, order=2)
    return fem, ep.Partition.ball(fem, (0, 0, 0), 0.75 * side)


def two_bars():
    unit = ep.Material(E=1.0, nu=0.0, rho=1.0)
    models = [bar(2.0, 10.0, unit, (4, 84), up=True), bar(2.0, 10.0, unit, (3, 110), up=False)]
    # They touch first when the gap is closed.
    references = {"force": 0.4, "start": 0.5, "duration": 20.0, "velocity": 0.1}
    return {"models": models, "speed": 0.1, "gap": 0.1, "end": 26.0, "f_cuts": (0.1, 0.2, 0.45, 0.9), **references}


def bar_on_wall():
    steel = ep.Material(E=210e9, nu=0.0, rho=7800.0)
    models = [bar(3.14e-4**0.5, 1.0, steel, (2, 130), up=True)]
    c = steel.bar_wave_speed
    references = {"force": steel.rho * c * 0.1 * 3.14e-4, "start": 0.5e-3, "duration": 2.0 / c, "velocity": 0.1}
    return {
        "models": models,
        "speed": 0.1,
        "gap": 50e-6,
        "end": 1.1e-3,
        "f_cuts": (10e3, 25e3, 50e3, 100e3),
        **references,
    }


CASES = {"two bars": two_bars, "bar on a rigid wall": bar_on_wall}


def run(case, bodies, rows, solver):
    """One impact and its errors."""
    mbs = exu.SystemContainer().AddSystem()
    speed = case["speed"]
    upper = ep.CreatePartitionBody(
        mbs, bodies[0], referencePosition=[0, 0, case["gap"]], initialVelocity=[0, 0, -speed]
    )
    items = [upper]
    if len(bodies) > 1:
        items.append(ep.CreatePartitionBody(mbs, bodies[1], initialVelocity=[0, 0, speed]))
    contact = ep.CreatePartitionContact(mbs, upper, items[1] if items[1:] else ep.RigidPlane(), rows=rows)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=case["end"], **solver)
    t, force = result.t, contact.force(result)
    closed = np.flatnonzero(force)
    start, duration = t[closed[0]], t[closed[-1]] - t[closed[0]]
    # Weighted by Hann's window, so that an incomplete period of the ripple has no effect.
    x = (t - case["start"] - case["duration"] / 2) / (case["duration"] / 4)
    weight = np.where(abs(x) < 1, 1 + np.cos(np.pi * x), 0.0)
    plateau = weight @ force / weight.sum()
    after = [item.momentum(result)[-1, 2] / item.body.total_mass for item in items]
    # The lower bar is thrown down, the upper one up.
    wanted = [case["velocity"], -case["velocity"]]
    energy = sum(item.energy(result) for item in items) + contact.energy(result)
    impulse = np.trapezoid(force, t)
    errors = {
        "force": plateau / case["force"] - 1,
        "start": (start - case["start"]) / case["duration"],
        "duration": duration / case["duration"] - 1,
        "velocity": max((v / w - 1 for v, w in zip(after, wanted, strict=False)), key=abs),
    }
    return {
        "error": errors,
        "ripple": np.sqrt(weight @ (force - plateau) ** 2 / weight.sum()) / case["force"],
        "impulse_error": impulse / (case["force"] * case["duration"]) - 1,
        "energy_drift": abs(energy / energy[0] - 1).max(),
        "sub_impacts": len(contact.impacts(result)),
        "rows": contact.n_rows,
        "dofs": sum(body.n_dofs for body in bodies),
        "step_s": result.step,
        "steps": result.steps,
        "online_s": result.time_s,
        "t_s": list(t[:: max(1, len(t) // 600)]),
        "force_N": list(force[:: max(1, len(t) // 600)]),
    }


def evaluate(case):
    found, highest = [], case["f_cuts"][-1]
    # To compute all modes of a band takes long. One f_cut shows that the bases agree.
    for basis, f_cut in [*(("contact-adapted", f) for f in case["f_cuts"]), ("residual", case["f_cuts"][1])]:
        begin = time.perf_counter()
        bodies = [ep.reduce(*model, basis=basis, f_cut=f_cut) for model in case["models"]]
        offline = {"basis": basis, "f_cut_Hz": f_cut, "offline_s": time.perf_counter() - begin}
        found += [{**offline, "kind": rows, "solver": "explicit", **run(case, bodies, rows, {})} for rows in ROWS]
        if f_cut == highest:
            damped = run(case, bodies, ROWS[0], {"method": "implicit", "spectral_radius": 0.3, "step": 0.1 / f_cut})
            found.append({**offline, "kind": ROWS[0], "solver": "implicit, damped", **damped})
    return found


def show(name, runs, nodes):
    table = Table(
        "basis", "f_cut", "rows", "solver", "dofs", *QUANTITIES, "ripple", "impulse", "energy drift", "sub-impacts",
        "off-line", "on-line", title=f"{name}: {nodes} nodes",
    )  # fmt: skip
    for r in runs:
        table.add_row(
            r["basis"], f"{r['f_cut_Hz']:g} Hz", r["kind"], r["solver"], str(r["dofs"]),
            *(f"{r['error'][q]:+.2%}" for q in QUANTITIES),
            f"{r['ripple']:.1%}", f"{r['impulse_error']:+.2%}", f"{r['energy_drift']:.1e}", str(r["sub_impacts"]),
            f"{r['offline_s']:.1f} s", f"{r['online_s']:.2f} s",
        )  # fmt: skip
    Console(width=170).print(table)


def draw(cases):
    path, (fig, axes) = scenes.figure(__file__, nrows=len(cases), ncols=2, figsize=(13, 7), squeeze=False)
    for row, case in zip(axes, cases.values(), strict=True):
        for r in case["runs"]:
            ax = row[ROWS.index(r["kind"])]
            ax.plot(r["t_s"], r["force_N"], lw=0.8, label=f"{r['basis']}, {r['f_cut_Hz']:g} Hz, {r['solver']}")
            ax.set(title=r["kind"], xlabel="time [s]", ylabel="force [N]")
        for ax in row:
            start, end, force = case["start"], case["start"] + case["duration"], case["force"]
            ax.plot([start, start, end, end], [0, force, force, 0], "k--", lw=0.8)
            ax.legend(fontsize=6)
    fig.savefig(path, dpi=120)


def main():
    cases, failed = {}, []
    for name, make in CASES.items():
        case = make()
        nodes = sum(fem.n_nodes for fem, _ in case["models"])
        runs = evaluate(case)
        show(name, runs, nodes)
        references = {q: case[q] for q in QUANTITIES}
        cases[name] = {"nodes": nodes, **references, "runs": runs}
        for r in runs:
            if r["f_cut_Hz"] == case["f_cuts"][-1] and r["solver"] == "explicit":
                failed += [
                    f"{name}, {r['kind']}: {q} {r['error'][q]:+.2%}"
                    for q, limit in LIMITS.items()
                    if abs(r["error"][q]) > limit
                ]
    draw(cases)
    scenes.finish(__file__, {"limits": LIMITS, "cases": cases}, failed)


if __name__ == "__main__":
    main()
