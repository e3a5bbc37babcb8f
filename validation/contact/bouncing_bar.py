"""A bar that is dropped on a wall and bounces: the benchmark of Doyen, Ern and Piperno (2011).

Reference: D. Doyen, A. Ern, S. Piperno, Time-integration schemes for the finite element dynamic Signorini problem, SIAM
J. Sci. Comput. 33 (2011) 223-249. Length 10, E = 900, density 1, nu = 0, dropped from a height of 5 with gravity 10, so
waves travel at 30. The bar falls for 1. It touches for 2/3, half a period of a clamped bar; then everything except its
static deformation has the opposite sign. So it leaves upwards with the speed at which it came, and with twice the
static deformation. It flies for 2 and vibrates three times. It touches for 2/3 as before, leaves undeformed, and rises
to where it came from. The period is 16/3 with two impacts. Each has the impulse 2 m v plus that of the weight during
the contact.
Quantity: starts, ends and impulses of the first three impacts, the period, energy, and the largest strain.
Limits, at the highest f_cut: 1 % of the period for starts and the period, 1 % for durations and impulses.

The strain is a third. Only linear elasticity is tested here; the library's warnings are counted.

    python -m validation.contact.bouncing_bar
"""

import warnings

import exudyn as exu
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.contact import scenes
from validation.contact.bars import bar

LIMIT = 0.01
LENGTH, SIDE, HEIGHT, GRAVITY = 10.0, 0.5, 5.0, 10.0
MATERIAL = ep.Material(E=900.0, nu=0.0, rho=1.0)
SPEED = (2 * GRAVITY * HEIGHT) ** 0.5
LASTS = 2 * LENGTH / MATERIAL.bar_wave_speed
PERIOD = 16 / 3
STARTS = (1.0, 1.0 + LASTS + 2.0, 1.0 + PERIOD)
F_CUTS = (7.5, 15.0, 30.0)  # 5, 10 and 20 times the lowest frequency of the free bar


def drop(cells, f_cut, **options):
    """The bar's first three impacts on a rigid plane: result, body, contact, and the names of the warnings."""
    fem, part = bar(SIDE, LENGTH, MATERIAL, cells, up=True)
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs, ep.reduce(fem, part, f_cut=f_cut), referencePosition=[0, 0, HEIGHT], gravity=[0, 0, -GRAVITY], name="bar"
    )
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), name="wall")
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ep.errors.PartitionWarning)
        warnings.simplefilter("ignore", ep.errors.YieldWarning)  # compared with elastic bodies
        result = ep.solve_dynamic(mbs, end_time=7.5, **options)
    return result, item, contact, sorted({warning.category.__name__ for warning in caught})


def rebounds(t, force):
    """Starts, ends and impulses of impacts, (n, 3). Parts less than a third of a contact apart count as one."""
    closed = t[force > 0]
    breaks = np.flatnonzero(np.diff(closed) > LASTS / 3)
    starts, ends = closed[np.r_[0, breaks + 1]], closed[np.r_[breaks, len(closed) - 1]]
    impulses = [np.trapezoid(np.where((t >= a) & (t <= b), force, 0.0), t) for a, b in zip(starts, ends, strict=True)]
    return np.column_stack([starts, ends, impulses])


def measure(cells, f_cut, **options):
    result, item, contact, warned = drop(cells, f_cut, **options)
    force = contact.force(result)
    found = rebounds(result.t, force)[:3]
    m = item.body.total_mass
    q = item.coordinates(result)
    height = item.rigid_motion(q)[:, 2] + HEIGHT
    energy = item.energy(result) + contact.energy(result) + m * GRAVITY * height
    impulse = m * 2 * SPEED + m * GRAVITY * LASTS
    return {
        "f_cut_Hz": f_cut,
        "status": result.status,
        "starts_s": [*found[:, 0]],
        "lasts_s": [*(found[:, 1] - found[:, 0])],
        "period_s": found[2, 0] - found[0, 0],
        "error": {
            "start": abs(found[:, 0] - STARTS).max() / PERIOD,
            "duration": abs(found[:, 1] - found[:, 0] - LASTS).max() / LASTS,
            "period": abs(found[2, 0] - found[0, 0] - PERIOD) / PERIOD,
            "impulse": abs(found[:, 2] / impulse - 1).max(),
        },
        "energy_drift": abs(energy / energy[0] - 1).max(),
        "strain": item.deformation(q).max() * 2 / LENGTH,
        "warned": warned,
        "step_s": result.step,
        "steps": result.steps,
        "online_s": result.time_s,
        "t_s": [*result.t[:: max(1, len(result.t) // 800)]],
        "force_N": [*force[:: max(1, len(result.t) // 800)]],
    }


def main():
    runs = [measure((2, 120), f_cut) for f_cut in F_CUTS]
    table = Table(
        "f_cut", "starts", "last", "period", "start", "duration", "impulse", "energy drift", "strain", "warned"
    )
    for r in runs:
        table.add_row(
            f"{r['f_cut_Hz']:g} Hz", *(", ".join(f"{x:.4f}" for x in r[key]) for key in ("starts_s", "lasts_s")),
            f"{r['period_s']:.4f}", *(f"{r['error'][key]:.2%}" for key in ("start", "duration", "impulse")),
            f"{r['energy_drift']:.1e}", f"{r['strain']:.2f}", ", ".join(r["warned"]),
        )  # fmt: skip
    Console(width=150).print(table)
    path, (fig, ax) = scenes.figure(__file__, figsize=(9, 3.5))
    for r in runs:
        ax.plot(r["t_s"], r["force_N"], lw=0.8, label=f"{r['f_cut_Hz']:g} Hz")
    ax.set(xlabel="time", ylabel="force")
    ax.legend()
    fig.savefig(path, dpi=120)
    failed = [f"{key} {error:.2%}" for key, error in runs[-1]["error"].items() if error > LIMIT]
    failed += [f"{r['f_cut_Hz']:g} Hz ended as {r['status']}" for r in runs if r["status"] != "finished"]
    scenes.finish(__file__, {"limit": LIMIT, "period": PERIOD, "lasts": LASTS, "runs": runs}, failed)


if __name__ == "__main__":
    main()
