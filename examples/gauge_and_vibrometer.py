"""Strain gauges and a laser vibrometer on a computed bar: what an impact experiment would measure, and a check of it.

A ball hits the end of a bar. The force travels along the bar as a wave at c = sqrt(E / rho). A gauge measures it as
strain F / (E A), and a laser on the far end as velocity 2 F / (rho c A). Both signals, converted back to forces,
must agree with the contact force.
"""

import argparse
import json
from pathlib import Path

import exudyn as exu
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

R_BAR, LENGTH, R_BALL = 0.005, 0.4, 0.006  # [m]; the bar lies on z > 0, the ball hits it at the origin
AREA, WAVE = np.pi * R_BAR**2, ep.STEEL.bar_wave_speed
SPOT, TILT = 1e-3, np.radians(10)  # laser: radius of the spot [m], angle between beam and bar


def fe_models(quick):
    """FE models of ball and bar with their partitions."""
    fine = ep.Refine((0, 0, 0), radius=0.5e-3, h=0.25e-3 if quick else 0.12e-3)
    ball = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, -R_BALL), R_BALL), ep.STEEL, maxh=2e-3, refine=[fine])
    cylinder = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=R_BAR, h=LENGTH)
    bar = ep.fe_model(cylinder, ep.STEEL, maxh=5e-3 if quick else 4e-3, refine=[fine])
    return (ball, ep.Partition.ball(ball, (0, 0, 0), 0.7e-3)), (bar, ep.Partition.ball(bar, (0, 0, 0), 1e-3))


def laser_row(fem):
    """Mean displacement over the spot on the far end along the beam, as a (1, 3 nodes) sparse row.

    Whatever is linear in the nodal displacements is such a row: an extensometer, a mean over an electrode, a force.
    """
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(12)])
    points = np.add(np.vstack([np.zeros(3), SPOT / 2 * ring, SPOT * ring]), [0, 0, LENGTH])
    beam = np.array([np.sin(TILT), 0, np.cos(TILT)])
    return np.tile(beam, len(points))[None] / len(points) @ ep.recovery.displacement_rows(fem, points)


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="coarser meshes")
    parser.add_argument("--out", type=Path, default=Path("out/gauge_and_vibrometer"), metavar="DIR")
    options = parser.parse_args(argv)

    models = fe_models(options.quick)
    # Each body has its own f_cut. A value below the first mode of the small ball would be refused.
    bodies = [ep.reduce(*model, f_cut=f_cut) for model, f_cut in zip(models, (300e3, 100e3), strict=True)]
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, bodies[0], name="ball", initialVelocity=[0, 0, 1.0])
    bar = ep.CreatePartitionBody(mbs, bodies[1], name="bar")
    contact = ep.CreatePartitionContact(mbs, ball, bar, name="ball on bar")
    mbs.Assemble()
    run = ep.solve_dynamic(mbs, end_time=2e-3)
    t, force = run.t, contact.force(run)

    # Instruments are rows on the nodal displacements. They are made after the run; the reduction does not need them.
    fem = models[1][0]
    gauges = [ep.StrainGauge((x, 0, LENGTH / 2), (0, 0, 1), 3e-3, f"at x = {1e3 * x:g} mm") for x in (R_BAR, -R_BAR)]
    rows = ep.recovery.gauge_rows(fem, gauges)
    strain = bar.recover(run, rows)
    # The part that the contact's static answer adds to the kept shapes. Half a bar away from the contact it is tiny.
    strain += np.outer(force, rows @ ep.recovery.static_correction(fem, bar.body).ravel())
    velocity = bar.coordinates_t(run) @ bar.body.reduced_rows(laser_row(fem))[0]

    # Convert to forces, until the first reflection arrives. Bending cancels in the mean of the gauges.
    by_gauges = np.interp(t + LENGTH / 2 / WAVE, t, -ep.STEEL.E * AREA * strain.mean(axis=1))
    by_laser = np.interp(t + LENGTH / WAVE, t, velocity / np.cos(TILT) * ep.STEEL.rho * WAVE * AREA / 2)
    first = t < 0.9 * LENGTH / WAVE
    f, amplitude = ep.amplitude_spectrum(t, velocity, window="hann")

    error = [float(np.linalg.norm((x - force)[first]) / np.linalg.norm(force)) for x in (by_gauges, by_laser)]
    result = {
        "dofs": sum(body.n_dofs for body in bodies),
        "fe_dofs": sum(fem.n_dofs for fem, _ in models),
        "step_s": run.step,
        "steps": run.steps,
        "time": {"reduce_s": sum(body.reduce_s for body in bodies), "online_s": run.time_s},
        "peak_force_N": float(force.max()),
        "impulse_Ns": float(np.trapezoid(force, t)),
        "error": dict(zip(("force_by_gauges", "force_by_laser"), error, strict=True)),
        "loudest_frequency_Hz": float(f[amplitude.argmax()]),
        "bar_theory_Hz": WAVE / 2 / LENGTH,
        "left_out": [*bar.left_out, *contact.left_out],
        "versions": ep.versions(),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))

    figure, axes = plt.subplots(2, 2, figsize=(11, 7), layout="constrained")
    for x, style, label in ((force, "-", "contact"), (by_gauges, "--", "from gauges"), (by_laser, ":", "from laser")):
        axes[0, 0].plot(1e6 * t[first], x[first], style, linewidth=2, label=label)
    axes[0, 0].legend()
    axes[0, 0].set(xlabel="time at the contact [µs]", ylabel="force [N]")
    for gauge, one, style in zip(gauges, strain.T, ("-", "--"), strict=True):  # both measure the same
        axes[0, 1].plot(1e3 * t, 1e6 * one, style, label=gauge.name)
    axes[0, 1].legend(loc="lower right", ncols=2)
    axes[0, 1].set(xlabel="time [ms]", ylabel="strain in the middle [µm/m]", xlim=(0, 0.5), ymargin=0.2)
    axes[1, 0].plot(1e3 * t, velocity)
    axes[1, 0].set(xlabel="time [ms]", ylabel="velocity along the beam [m/s]", xlim=(0, 0.5))
    axes[1, 1].semilogy(1e-3 * f, amplitude)
    axes[1, 1].vlines(1e-3 * np.arange(1, 8) * WAVE / 2 / LENGTH, 0, 1, color="k", linewidth=0.6, linestyle="--")
    axes[1, 1].set(xlabel="frequency [kHz]; dashed: n c / 2 L", ylabel="spectrum of the velocity [m]")
    axes[1, 1].set(xlim=(0, 50), ylim=(1e-6 * amplitude.max(), 2 * amplitude.max()))
    for panel in axes.flat:
        panel.grid(alpha=0.3)
    figure.savefig(picture := options.out / "gauge_and_vibrometer.png", dpi=150)
    ep.plot.bodies(run, 5e-5, scale=1, direction=(0, -1, 0)).figure.savefig(options.out / "bodies.png", dpi=150)
    print(json.dumps({key: result[key] for key in ("dofs", "fe_dofs", "time", "error")}), picture.resolve(), sep="\n")
    return result


if __name__ == "__main__":
    main()
