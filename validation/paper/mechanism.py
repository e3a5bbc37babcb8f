"""Crank slider: Figs. 13 to 15, from one turn with the contact-adapted basis.

The paper prints no numbers for these figures and only describes them; the descriptions are measured here. Lengths,
sections and the place of block 4 are reconstructed, so magnitudes cannot be compared. The paper's own scheme needs
steps of nanoseconds. Its results around the first impact are read from joints/crank_slider.json, whose reference has
full FE blocks. After the blocks have parted, adaptive steps grow and damp the vibration: the decay there is not
physical.
"""

import json
import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import exudyn_partition as ep
from examples.models import crank_slider as example
from examples.models.crank_slider_parts import (
    CONTACT_ANGLE,
    DAMPING,
    FULL_MESH,
    QUICK_MESH,
    SPEED,
    STIFFNESS,
    TURN,
    block,
    link,
)
from examples.models.crank_slider_results import histories, imbalance, integral
from validation.paper.statements import statement

ROOT = Path(__file__).resolve().parents[2]

STORED = ROOT / "validation" / "joints" / "crank_slider.json"
F_CUT, LINK_F_CUT, STEP = 100e3, 5e3, 2e-6
GRID, SMOOTH = 5e-6, 1e-3  # [s]: even samples, and the span whose mean is taken off for high frequencies
BEFORE, AFTER = 5e-3, 5e-3  # [s] beside the first contact
PEAK, ACTIVATED = 3.0, 5.0  # at least: a large peak over everything before; high frequencies after over those before
COUNTS = {3: 15, 4: 12}  # modes below 100 kHz, paper
LIMITS = {"impulse": 0.01, "modes": 0.15, "energy": 0.005, "time": 0.001}


def mode_counts(parts):
    """Elastic modes of the blocks below 100 kHz."""
    rows = []
    for (number, printed), (fem, _) in zip(COUNTS.items(), parts, strict=True):
        head = ep.Partition.ball(fem, (0, 0, 0), 1e-3)
        omega = ep.reduce(fem, head, basis="residual", f_cut=F_CUT).basis.omega[6:]
        count = int(np.count_nonzero(omega <= 2 * np.pi * F_CUT))
        rows.append(
            statement(f"crank slider: modes of block {number} below 100 kHz", printed, count, count / printed - 1,
                      LIMITS["modes"], why="lengths are reconstructed from these counts")
        )  # fmt: skip
    nodes = sum(fem.n_nodes for fem, _ in parts)
    rows.append(statement("crank slider: FE nodes of both blocks", 9478, nodes, nodes / 9478 - 1))
    return rows


def windows(t, x, start):
    """Largest magnitude and high-frequency part (rms) before and after a time."""
    even = np.arange(t[0], t[-1], GRID)
    y = np.interp(even, t, x)
    span = round(SMOOTH / GRID)
    fast = y - np.convolve(np.pad(y, span, mode="edge"), np.ones(span) / span, mode="same")[span:-span]
    parts = (even > start - BEFORE) & (even < start), (even >= start) & (even < start + AFTER)
    return [(abs(y[part]).max(), float(np.sqrt(np.mean(fast[part] ** 2)))) for part in parts]


def statements(model, result, found, impacts, quick):
    start, t, force = impacts[0].start, found["t"], found["force"]
    due = (CONTACT_ANGLE - found["angle"][0]) / SPEED
    rise = float(t[force.argmax()] - start)
    longest = max(impacts, key=lambda i: i.end - i.start)
    settled = (t > start + 0.5 * (longest.end - start)) & (t < longest.end)
    level = float(np.trapezoid(force[settled], t[settled]) / np.ptp(t[settled]))
    lasting = longest is impacts[-1] and longest.end - longest.start > 10 * (impacts[0].end - impacts[0].start)
    gradual = lasting and level < force.max() / 3
    rows = [
        statement("Figs. 13-15: first contact", "at some moment of the turn", f"{1e3 * start:.3f} ms", start / due - 1,
                  LIMITS["time"], why=f"kinematics: {1e3 * due:.3f} ms; the place of block 4 is reconstructed"),
        statement("Fig. 13: sharp jump of the contact force at impact", "sharp jump",
                  f"{force.max() / 1e3:.1f} kN, {1e6 * rise:.0f} us after first contact", agrees=rise < 0.5e-3,
                  why="magnitudes cannot be compared: the block's place, and with it the speed, is reconstructed"),
        statement("Fig. 13: then it comes gradually into contact", "gradually into the contact state",
                  f"{len(impacts)} impacts, the last of them {1e3 * (longest.end - longest.start):.1f} ms long, "
                  f"{level / 1e3:.2f} kN in the mean of its second half", agrees=gradual),
    ]  # fmt: skip
    for what, said, x in (
        ("Fig. 14: torque at the origin", "activated", found["torque"]),
        ("Fig. 15: velocity of the link's centre, along x", "obviously excited", found["link_velocity"][:, 0]),
        ("Fig. 15: velocity of the link's centre, along y", "obviously excited", found["link_velocity"][:, 1]),
    ):
        (before, fast), (after, faster) = windows(t, x, start)
        if "torque" in what:
            rows.append(
                statement(f"{what}: large peak during contact", "large peak",
                          f"{after:.0f} N m, {after / before:.3g} times all before", agrees=after > PEAK * before)
            )  # fmt: skip
        rows.append(
            statement(f"{what}: high frequencies after impact", said,
                      f"{faster / fast:.3g} times those before (rms, faster than {1e3 * SMOOTH:g} ms)",
                      agrees=faster > ACTIVATED * fast)
        )  # fmt: skip
    # What block 4 took against what its spring-damper gave away and it kept: another way to the same force.
    held = model.blocks[1]
    spring = STIFFNESS * integral(t, found["block_4"])[-1]
    damper = DAMPING * (found["block_4"][-1] - found["block_4"][0])
    impulse = float(np.trapezoid(force, t))
    kept = held.momentum(result)[:, 0]
    balance = impulse / (spring + damper + kept[-1] - kept[0]) - 1
    rows.append(
        statement("crank slider: impulse of the contact force against block 4's spring, damper and momentum",
                  "equal (balance)", f"{impulse:.4g} N s", balance, LIMITS["impulse"])
    )  # fmt: skip
    energy = imbalance(found)
    rows.append(
        statement("crank slider: energy", "equal (balance)", f"{energy:.2%} of the drive's work", energy,
                  None if quick else LIMITS["energy"])
    )  # fmt: skip
    return rows


def own_scheme():
    """The paper's scheme around the first impact, from the stored comparison with full FE blocks."""
    runs = {r["name"]: r for r in json.loads(STORED.read_text())["window"]}
    paper, ours = runs["paper's scheme, free"], runs["contact-adapted"]
    why = (
        "the paper shows no reference. At 100 kHz its basis lacks the static field of the heads: the contact is too "
        "stiff, and its force rings"
    )
    return [
        statement("Fig. 13: force by the paper's scheme against full FE blocks, first 0.4 ms", "accurate at 100 kHz",
                  f"{paper['force']:.0%} (peak {paper['peak']:+.0%}); contact-adapted {ours['force']:.2%}",
                  paper["force"], 0.1, known=True, why=why),
    ]  # fmt: skip


def draw(found, start):
    t = 1e3 * found["t"]
    panels = [
        ("Fig. 13: contact force", "force [kN]", found["force"][:, None] / 1e3, ("",)),
        ("Fig. 14: torque at the origin", "torque [N m]", found["torque"][:, None], ("",)),
        ("Fig. 15: velocity of the link's centre", "velocity [m/s]", found["link_velocity"][:, :2], ("x", "y")),
    ]  # fmt: skip
    figure, axes = plt.subplots(3, 2, figsize=(15, 11), layout="constrained", width_ratios=(2, 1))
    for line, (title, unit, curves, names) in zip(axes, panels, strict=True):
        for panel in line:
            for curve, name in zip(curves.T, names, strict=True):
                panel.plot(t, curve, lw=0.8, label=name)
            panel.set(xlabel="time [ms]", ylabel=unit)
            panel.grid(alpha=0.3)
        line[0].set_title(title)
        line[1].set(title="around the first impact", xlim=(1e3 * start - 0.5, 1e3 * start + 3))
    axes[2, 0].legend()
    figure.savefig(ROOT / "out" / "paper_crank_slider.png", dpi=100)


def run(quick):
    """Rows of the report."""
    mesh = QUICK_MESH if quick else FULL_MESH
    parts = [block(number, *mesh) for number in (3, 4)]
    bodies = [
        ep.reduce(*link(), f_cut=LINK_F_CUT),
        *(ep.reduce(*part, basis="contact-adapted", f_cut=F_CUT) for part in parts),
    ]
    angle, end_time = (CONTACT_ANGLE - 3e-3 * SPEED, 8e-3) if quick else (0.0, TURN)
    model = example.mechanism(bodies[0], bodies[1:], angle=angle)
    result = example.run(model, end_time, STEP)
    found, impacts = histories(model, result), model.contact.impacts(result)
    draw(found, impacts[0].start)
    return {
        "rows": [*mode_counts(parts), *statements(model, result, found, impacts, quick), *own_scheme()],
        "dofs": [body.n_dofs for body in bodies],
        "link_modes": bodies[0].n_shapes - 6,
        "impacts": [{"start_s": i.start, "end_s": i.end, "impulse_Ns": i.impulse, "peak_N": i.peak} for i in impacts],
        "online_s": result.time_s,
        "turned_deg": math.degrees(SPEED * end_time),
    }
