"""Flat ends that meet at once: how the force rings, what damps it, what this takes of the energy, and what steps add.

A bar cut at f_cut rings above it about the true force, because nothing damps it there. `bars.py` derives 1.2 f_cut for
a basis of modes alone; the default basis reaches higher, and rings at 1.8 f_cut. One impact of a steel bar on a rigid
wall is computed in four ways: without damping, with implicit steps that damp high frequencies, with damping of the last
modes, and by Craig and Bampton's basis with multipliers. A compact block and a cube hit with their whole flat face, and
all rows close within a step. They start at several gaps, and the worst of these shows how much energy the default step
adds or takes, whatever its phase.
The bar is also cut at several f_cut, by the time 2 L / c that its impact lasts: a rule for flat contacts, which have no
Hertz pulse to choose f_cut from.

Reference: Saint-Venant's plateau, and conservation of energy.
Quantity: ripple of the force, as a standard deviation over the plateau, and energy after the impact; by f_cut, mean
force, duration and speed after the impact, all relative to Saint-Venant's, the largest mean over two periods of the
ringing, and the frequency of this.
Limits: means of the force within 1 %; the library warns of all runs that ring by more than 20 %; at the default step
the energy changes by less than 0.1 %; from f_cut = 5 c / 2 L on, duration and mean force are within 5 %, and
the speed after is within 5 % without damping.

    python -m validation.contact.ringing
"""

import warnings

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.contact import scenes
from validation.contact.bars import bar

F_CUT, SPEED = 25e3, 0.1
STEEL = ep.Material(E=210e9, nu=0.0, rho=7800.0)
LENGTH, SIDE = 1.0, 3.14e-4**0.5
LIMITS = {"force": 0.01, "block_energy": 1e-3, "by_f_cut": 0.05}
LASTS = 2 * LENGTH / STEEL.bar_wave_speed
PLATEAU = STEEL.rho * STEEL.bar_wave_speed * SPEED * SIDE**2
PASSAGES = (2.5, 5, 10, 20)  # f_cut by 1 / LASTS
ENOUGH = 5
PHASES = 8  # of a step, in which flat faces touch
WAYS = {
    "as it comes": ({}, {}),
    "implicit, default": ({}, {"method": "implicit"}),
    "implicit, spectral radius 0.3, step 0.1 / f_cut": (
        {},
        {"method": "implicit", "spectral_radius": 0.3, "step": 0.1 / F_CUT},
    ),
    "damping of 0.3 above 0.7 f_cut": ({"damping": lambda f: np.where(f > 0.7 * F_CUT, 0.3, 0.0)}, {}),
    "damping of 0.02": ({"damping": 0.02}, {}),
}


def impact(body, end_time, item_options=(), solver=(), *, gap=2e-6, **contact_options):
    """Result, ratio of the energy after to that before, contact, and whether the library warned of ringing."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs, body, referencePosition=[0, 0, gap], initialVelocity=[0, 0, -SPEED], **dict(item_options)
    )
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), **contact_options)
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ep.errors.PartitionWarning)
        result = ep.solve_dynamic(mbs, end_time=end_time, **dict(solver))
    energy = item.energy(result) + contact.energy(result)
    return result, energy[-1] / energy[0] - 1, contact, any("the force rings" in str(w.message) for w in caught)


def bar_run(name, body, *options, **contact_options):
    result, energy, contact, warned = impact(body, 0.5e-3, *options, **contact_options)
    force = contact.force(result)
    x = (result.t - 2e-6 / SPEED - LASTS / 2) / (LASTS / 4)
    weight = np.where(abs(x) < 1, 1 + np.cos(np.pi * x), 0.0)
    mean = weight @ force / weight.sum()
    return {
        "way": name,
        "dofs": body.n_dofs,
        "force": mean / PLATEAU - 1,
        "ripple": np.sqrt(weight @ (force - mean) ** 2 / weight.sum()) / PLATEAU,
        "peak": force.max() / PLATEAU,
        "energy": energy,
        "warned": warned,
        "step_s": result.step,
        "online_s": result.time_s,
    }


def f_cut_runs(fem, part):
    found = []
    for passages in PASSAGES:
        f_cut = passages / LASTS
        body = ep.reduce(fem, part, f_cut=f_cut)
        for damping in (None, lambda f, limit=0.7 * f_cut: np.where(f > limit, 0.3, 0.0)):
            result, _, contact, _ = impact(body, 1.5 * LASTS, {"damping": damping}.items())
            (whole,) = contact.impacts(result, merge=1 / f_cut)
            rings = contact.ringing(result)
            found.append({
                "passages": passages, "damped": damping is not None, "dofs": body.n_dofs,
                "duration": (whole.end - whole.start) / LASTS - 1, "mean": whole.mean_force / PLATEAU - 1,
                "speed": whole.speed_after / whole.speed_before, "peak": whole.peak / PLATEAU,
                "largest_mean": rings.mean / PLATEAU - 1, "frequency": 1 / (rings.period * f_cut),
            })  # fmt: skip
    return found


def block_runs():
    found = []
    for height, f_cuts in ((30e-3, (60e3, 150e3)), (10e-3, (60e3,))):
        shape = occ.Box(occ.Pnt(-5e-3, -5e-3, 0), occ.Pnt(5e-3, 5e-3, height))
        fem = ep.fe_model(shape, ep.STEEL, maxh=5e-3)
        for f_cut in f_cuts:
            body = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 7.2e-3), f_cut=f_cut)
            for step in (None, 1 / (25 * f_cut)):
                phases = [impact(body, 0.1e-3, (), {"step": step})]
                way = phases[0][0].step * SPEED
                for phase in np.arange(1, PHASES) / PHASES:
                    phases.append(impact(body, 0.1e-3, (), {"step": step}, gap=2e-6 + phase * way))
                result, energy, contact, _ = max(phases, key=lambda run: abs(run[1]))
                closed = contact.closed_rows(result)
                found.append({
                    "height_m": height, "f_cut_Hz": f_cut, "default": step is None, "step_s": result.step,
                    "energy": energy, "phases": PHASES, "steps_in_contact": int(np.count_nonzero(closed)),
                    "rows_at_once": int(closed[np.flatnonzero(closed)[0]]), "rows": contact.n_rows,
                })  # fmt: skip
    return found


def main():
    fem, part = bar(SIDE, LENGTH, STEEL, (2, 60), up=True)
    body = ep.reduce(fem, part, f_cut=F_CUT)
    runs = [bar_run(name, body, *options) for name, options in WAYS.items()]
    craig_bampton = ep.reduce(fem, part, basis="craig-bampton", f_cut=F_CUT)
    options = (), {"method": "implicit", "step": 1 / (25 * F_CUT)}
    runs.append(bar_run("craig-bampton, multipliers", craig_bampton, *options, formulation="lagrange"))
    table = Table("way", "dofs", "step", "force", "ripple", "peak", "energy", "warns", "on-line")
    for r in runs:
        table.add_row(
            r["way"], str(r["dofs"]), f"{1e6 * r['step_s']:.3g} us", f"{r['force']:+.2%}", f"{r['ripple']:.1%}",
            f"{r['peak']:.2f}", f"{r['energy']:+.2%}", "yes" if r["warned"] else "no", f"{r['online_s']:.2f} s",
        )  # fmt: skip
    by_f_cut = f_cut_runs(fem, part)
    names = "f_cut 2 L / c", "damped", "dofs", "duration", "mean", "speed after", "peak", "largest mean", "rings at"
    rule = Table(*names, title="by f_cut")
    for r in by_f_cut:
        rule.add_row(
            f"{r['passages']:g}", "yes" if r["damped"] else "no", str(r["dofs"]), f"{r['duration']:+.1%}",
            f"{r['mean']:+.1%}", f"{r['speed']:.3f}", f"{r['peak']:.2f}", f"{r['largest_mean']:+.1%}",
            f"{r['frequency']:.2f} f_cut",
        )  # fmt: skip
    blocks = block_runs()
    names = "height", "f_cut", "step", "worst energy", "steps in contact", "rows at once"
    faces = Table(*names, title="whole flat face")
    for b in blocks:
        chosen = " (default)" if b["default"] else " (25 a period of f_cut)"
        step = f"{1e6 * b['step_s']:.3g} us{chosen}"
        faces.add_row(
            f"{1e3 * b['height_m']:g} mm", f"{b['f_cut_Hz']:g} Hz", step, f"{b['energy']:+.3%}",
            str(b["steps_in_contact"]), f"{b['rows_at_once']} of {b['rows']}",
        )  # fmt: skip
    for shown in (table, rule, faces):
        Console(width=150).print(shown)
    failed = [f"{r['way']}: force {r['force']:+.2%}" for r in runs if abs(r["force"]) > LIMITS["force"]]
    failed += [f"{r['way']}: no warning" for r in runs if r["ripple"] > 0.25 and not r["warned"]]
    failed += [
        f"f_cut {r['passages']:g} c / 2 L: {name} {r[name] - (name == 'speed'):+.2%}"
        for r in by_f_cut
        for name in ("duration", "mean", *["speed"] * (not r["damped"]))
        if r["passages"] >= ENOUGH and abs(r[name] - (name == "speed")) > LIMITS["by_f_cut"]
    ]
    failed += [
        f"{1e3 * b['height_m']:g} mm at {b['f_cut_Hz']:g} Hz: energy {b['energy']:+.3%}"
        for b in blocks
        if b["default"] and abs(b["energy"]) > LIMITS["block_energy"]
    ]
    scenes.finish(__file__, {"limits": LIMITS, "runs": runs, "by_f_cut": by_f_cut, "blocks": blocks}, failed)


if __name__ == "__main__":
    main()
