"""Histories, main numbers and the figure of the oblique impact, for examples/oblique_impact.py."""

import matplotlib.pyplot as plt
import numpy as np

import exudyn_partition as ep

from . import rod_on_plate as model


def history_of(items, contact, result):
    """Forces of a run, and velocities of the tip and of the plate's far side."""
    return result.history(contact, {name: (items[index], point) for name, (index, point) in model.NEAR_CONTACT.items()})


def numbers(items, contact, result):
    """Main numbers of a run, for result.json."""
    energy = sum(item.energy(result) for item in (*items, contact)) + contact.dissipated_energy(result)
    normal, along = contact.force(result), contact.friction.tangential_force(result)
    momentum = sum(item.momentum(result) for item in items)
    return {
        "peak_force_N": float(normal.max()),
        "peak_tangential_N": float(np.linalg.norm(along, axis=1).max()),
        "impulse_ratio": float(-np.trapezoid(along[:, 0], result.t) / np.trapezoid(normal, result.t)),
        "most_stuck_rows": int(contact.friction.stuck_rows(result).max()),
        "most_closed_rows": int(contact.closed_rows(result).max()),
        "dissipated_J": float(contact.dissipated_energy(result)[-1]),
        "energy_error": float(abs(energy / energy[0] - 1).max()),
        "momentum_error": float(abs(momentum - momentum[0]).max() / abs(momentum[0]).max()),
        "online_s": result.time_s,
        "steps": result.steps,
        "step_s": result.step,
    }


def figure(runs, reference, compared, friction):
    """Forces, the tip's hodograph, and the patch at the peak of the force."""
    fig, axes = plt.subplots(3, 3, figsize=(13, 11), layout="constrained")
    for row, (name, (items, contact, result)) in zip(axes, runs.items(), strict=True):
        history = history_of(items, contact, result)
        known = reference if name == compared else None
        t = 1e3 * result.t
        if known is not None:
            row[0].plot(1e3 * known.t, known.force, color="0.7", linewidth=3, label="full FE")
            row[0].plot(1e3 * known.t, -known.tangential_force[:, 0], color="0.7", linewidth=3)
            row[1].plot(known.velocity["tip"][:, 0], known.velocity["tip"][:, 2], color="0.7", linewidth=3)
        row[0].plot(t, history.force, "C0-", label="normal")
        row[0].plot(t, friction * history.force, color="gold", linewidth=4, label="limit of friction")
        row[0].plot(t, -contact.friction.tangential_force(result)[:, 0], "C3--", label="tangential")
        row[0].set(xlabel="time [ms]", ylabel="force [N]", title=name)
        row[0].set_ylim(top=1.35 * history.force.max())  # room for the legend
        row[0].legend(fontsize="small", ncols=2, loc="upper left")
        tip = history.velocity["tip"]
        row[1].plot(tip[:, 0], tip[:, 2], "C0-", linewidth=1)
        row[1].plot(*tip[0, [0, 2]], "ko", markersize=4)
        row[1].set(
            xlabel="velocity along the plate [m/s]", ylabel="velocity off the plate [m/s]", title="tip of the rod"
        )
        ep.plot.stick(row[2], result)
    return fig
