"""Two elastic bars that meet end on, one clamped: force, duration and rebound (Code_Aster's test SDNL111).

Reference: waves in bars. The force is rho c A V0 / 2 from the first touch until the wave is back from the clamped end,
4 L / c; then the moving bar leaves with -V0, and the clamped one is at rest. Flat ends ring: `contact.impacts(merge=)`
joins the parts, and means are compared. f_cut is 20 / (2 L / c), by the table of the page on contact ("f_cut").

Quantity: mean force over the middle half of the contact, duration, velocity of the moving bar afterwards, and what the
clamped bar keeps of the energy.
Limits: force 1 %, duration 1.5 %, velocity 1.5 %, energy kept 2 %.

    python -m validation.experiments.sdnl111 [--quick] [--out JSON]
"""

import time

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np

import exudyn_partition as ep
from validation.contact.bars import bar
from validation.experiments import common

DATA = common.data("sdnl111")
SETUP = DATA["setup"]
LENGTH, SIDE, SPEED = SETUP["length_m"], SETUP["side_m"], SETUP["speed_m_s"]
STEEL = ep.Material(E=SETUP["E_Pa"], nu=SETUP["nu"], rho=SETUP["rho_kg_m3"])
LASTS = 4 * LENGTH / STEEL.bar_wave_speed
FORCE = STEEL.rho * STEEL.bar_wave_speed * SIDE**2 * SPEED / 2
LIMITS = {"force": 0.01, "duration": 0.015, "velocity": 0.015, "energy kept": 0.02, "balance": 1e-3}


def run(passages):
    """The impact with f_cut so many times 1 / (2 L / c): what is compared, and the force over time."""
    begin, f_cut = time.perf_counter(), passages * STEEL.bar_wave_speed / (2 * LENGTH)
    fem, part = bar(SIDE, LENGTH, STEEL, (2, 130), up=True)
    upper = ep.reduce(fem, part, f_cut=f_cut)
    fem, part = bar(SIDE, LENGTH, STEEL, (3, 140), up=False)
    foot = np.flatnonzero(fem.points[:, 2] < -LENGTH + 1e-9)
    end = ep.Partition.interface(fem, "foot", foot, position=(0, 0, -LENGTH))
    lower = ep.reduce(fem, part | end, f_cut=f_cut)
    offline = time.perf_counter() - begin
    mbs = exu.SystemContainer().AddSystem()
    moving = ep.CreatePartitionBody(mbs, upper, referencePosition=[0, 0, 1e-7], initialVelocity=[0, 0, -SPEED])
    clamped = ep.CreatePartitionBody(mbs, lower)
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround(), localPosition=[0, 0, -LENGTH]))
    markers = [ground, clamped.CreateInterfaceMarker(mbs, "foot")]
    mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=[1] * 6))
    contact = ep.CreatePartitionContact(mbs, moving, clamped)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1.3 * LASTS)
    (whole,) = contact.impacts(result, merge=1 / f_cut)
    force, t = contact.force(result), result.t
    window = np.interp(t, whole.start + (whole.end - whole.start) * np.array([0.25, 0.5, 0.75]), [0, 1, 0])
    energy = [item.energy(result) for item in (moving, clamped)]
    balance = sum(energy) + contact.energy(result)
    return {
        "f_cut_kHz": 1e-3 * f_cut,
        "dofs": upper.n_dofs + lower.n_dofs,
        "force": float(np.trapezoid(window * force, t) / np.trapezoid(window, t) / FORCE - 1),
        "duration": (whole.end - whole.start) / LASTS - 1,
        "velocity": float(moving.momentum(result)[-1, 2] / upper.total_mass / SPEED - 1),
        "energy kept": float(energy[1][-1] / energy[0][0]),
        "balance": float(abs(balance / balance[0] - 1).max()),
        "offline_s": offline,
        "online_s": result.time_s,
    }, (t, force, contact.mean_force(result))


def draw(path, curve):
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(6.5, 4), layout="constrained")
    t, force, mean = curve
    ax.plot(1e6 * t, force, color="0.75", lw=0.6, label="this library: it rings above f_cut")
    ax.plot(1e6 * t, mean, "C3-", lw=1.2, label="its mean over two periods of the ringing")
    ax.plot(1e6 * np.array([0, 0, LASTS, LASTS]), [0, FORCE, FORCE, 0], "k--", lw=1, label="waves in bars")
    ax.set(xlabel="time [µs]", ylabel="force [N]")
    ax.legend(fontsize=8)
    figure.savefig(path, dpi=110)


def main():
    given = common.options(__doc__, "the same, without the coarser f_cuts")
    rows, curve = [], None
    for passages in (20,) if given.quick else (5, 10, 20):
        row, curve = run(passages)
        rows.append(row)
    common.show("two bars, SDNL111", rows)
    found = {name: rows[-1][name] for name in LIMITS}
    common.finish(__file__, {"rows": rows}, found, LIMITS, given, lambda path: draw(path, curve))


if __name__ == "__main__":
    main()
