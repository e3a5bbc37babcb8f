"""What a run of the crank slider shows: histories, balance of energies, the paper's figures, pictures of the motion.

What to learn here: methods of bodies and contacts give their histories, as arrays over the result's times. Sensors of
Exudyn's own items, such as the drive's, can be read in the same way.
"""

import math

import matplotlib.pyplot as plt
import numpy as np

from .crank_slider_parts import CRANK, DAMPING, LENGTHS, RADIUS, SPEED, STIFFNESS


def integral(t, x):
    """Running integral by the trapezoidal rule."""
    return np.r_[0.0, np.cumsum(np.diff(t) * (x[1:] + x[:-1]) / 2)]


def histories(model, result):
    """Time series: angle, force, torque of the drive, velocity of the link's centre, places, energies."""
    ends = (-LENGTHS[0], 0, 0), (LENGTHS[1], 0, 0)
    back = [item.displacement(result, end)[:, 0] for item, end in zip(model.blocks, ends, strict=True)]
    held, along = model.blocks[1], model.blocks[1].body.interface_rows("back")[0]
    spring, rate = held.coordinates(result) @ along, held.coordinates_t(result) @ along
    torque = -result.sensor(model.drive)[:, 0]  # of the drive on the crank
    stored = sum(item.energy(result) for item in (model.link, *model.blocks, model.contact))
    return {
        "t": result.t,
        "angle": model.start.angle + SPEED * result.t,
        "force": model.contact.force(result),
        "torque": torque,
        "link_velocity": model.link.velocity(result, (0, 0, 0)),
        "slider": back[0],
        "block_4": back[1],
        "work": integral(result.t, torque * SPEED),
        "stored": stored + STIFFNESS * spring**2 / 2,
        "dissipated": integral(result.t, DAMPING * rate**2),
    }


def imbalance(found):
    """Largest difference of the drive's work from what is stored and dissipated, relative to the largest work."""
    balance = found["work"] - (found["stored"] - found["stored"][0]) - found["dissipated"]
    return float(abs(balance).max() / abs(found["work"]).max())


def draw_histories(found):
    """Figure of contact force, torque, velocity and energies (the paper's Figs. 13 to 15)."""
    t, first = 1e3 * found["t"], int(np.flatnonzero(found["force"])[0])
    near = slice(max(first - 20, 0), first + 400)
    figure, axes = plt.subplots(5, 1, figsize=(8, 13), layout="constrained")
    axes[0].plot(t, found["force"] / 1e3, lw=0.8)
    axes[1].plot(t[near], found["force"][near] / 1e3)
    axes[2].plot(t, found["torque"], lw=0.8)
    axes[3].plot(t, found["link_velocity"][:, :2], lw=0.8, label=["along x", "along y"])
    for label in ("work", "stored", "dissipated"):
        axes[4].plot(t, found[label] - (found[label][0] if label == "stored" else 0), label=label)
    labels = (
        "contact force [kN]",
        "first impacts [kN]",
        "driving torque [N m]",
        "link's centre [m/s]",
        "energy [J]",
    )
    for panel, label in zip(axes, labels, strict=True):
        panel.set(xlabel="time [ms]", ylabel=label)
        panel.grid(alpha=0.3)
    for panel in axes[3:]:
        panel.legend()
    return figure


def draw_motion(found, start):
    """Figure of the mechanism at six times, that of the largest contact force among them."""
    figure, axes = plt.subplots(3, 2, figsize=(10, 7), sharex=True, sharey=True, layout="constrained")
    instants = np.sort([found["force"].argmax(), *np.searchsorted(found["t"], np.linspace(0, found["t"][-1], 5))])
    for panel, i in zip(axes.ravel(), instants, strict=True):
        angle = found["angle"][i]
        pin = -CRANK * np.cos(angle), -CRANK * np.sin(angle)
        backs = start.place + found["slider"][i], start.heads[1] + LENGTHS[1] + found["block_4"][i]
        panel.plot([0, pin[0]], [0, pin[1]], "k-o", lw=3)
        panel.plot([pin[0], backs[0]], [pin[1], 0], "C0-o", lw=3)
        for back, length, side, colour in zip(backs, LENGTHS, (1, -1), ("C1", "C2"), strict=True):
            head = np.linspace(-np.pi / 2, np.pi / 2, 30)
            neck = back + side * (length - RADIUS)
            outline = np.column_stack([neck + side * RADIUS * np.cos(head), RADIUS * np.sin(head)])
            panel.fill(*np.vstack([[back, -RADIUS], outline, [back, RADIUS]]).T, colour)
        coil = np.linspace(0, 1, 60)
        panel.plot(backs[1] + coil * (0.62 - backs[1]), 0.01 * np.sin(12 * np.pi * coil), "0.5")
        panel.set(xlim=(-0.17, 0.64), ylim=(-0.18, 0.18), aspect="equal")
        touch = ""
        if found["force"][i] > 0:
            touch, head = f", contact force {1e-3 * found['force'][i]:.3g} kN", backs[0] + LENGTHS[0]
            arrow = {"arrowstyle": "->", "shrinkB": 6}
            panel.annotate("heads touch", (head, 0), (head, 0.07), arrowprops=arrow, ha="center", fontsize="small")
        turned = f"{1e3 * found['t'][i]:.1f} ms, crank at {math.degrees(angle):.0f} degrees{touch}"
        panel.set_title(turned, fontsize="medium")
        panel.label_outer()
    names = {"crank": (-0.12, 0.03), "link": (0.03, 0.03), "block 3": (0.18, 0.03), "block 4": (0.44, 0.03)}
    for name, at in (*names.items(), ("spring and damper", (0.39, -0.06))):
        axes[0, 0].annotate(name, at, fontsize="small")
    figure.supxlabel("x [m]")
    figure.supylabel("y [m]")
    return figure
