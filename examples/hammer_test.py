"""Modulus and damping ratios of a beam from a hammer test, by `scipy.optimize.least_squares` with a Jacobian.

Measured are natural frequencies and damping ratios of a beam on foam: the modal data that the Showcase notebook of
sdypy-EMA prints (github.com/sdypy/sdypy-EMA). It does not tell what the beam is. Its frequencies are in the ratios of
a bar whose height is a fiftieth of its length; a steel bar of 600 x 40 x 12 mm is assumed here. For another length L
and density rho, but the same proportions, the modulus goes with rho L^2.

A steel head taps the model of the beam, and its acceleration at the other end is cut into two windows of time. Spectra
of both at a mode differ by the phase and the decay between them, which are frequency and ratio. `ep.sensitivity` gives
these spectra and their derivatives by E and the ratio of each mode, at other values than those of the model.
"""

import argparse
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import least_squares

import exudyn_partition as ep
from models.hammer_test import ACCELEROMETER, DELAY, FREQUENCIES, GUESS, RATIOS, spectra, tapped

SIGMA = 2e-3, 0.05  # of frequencies and ratios, relative: what the fit asks for


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="coarser meshes and longer steps")
    parser.add_argument("--out", type=Path, default=Path("out/hammer_test"), metavar="DIR")
    options = parser.parse_args(argv)
    options.out.mkdir(parents=True, exist_ok=True)
    (mbs, beam), (times, weights), n = tapped(options.quick), spectra(), len(FREQUENCIES)
    free = beam.body.basis.omega[6:] / (2 * np.pi)
    moves = abs(beam.velocity_rows(ACCELEROMETER)[2, 6:])  # most by bending across the flat side
    modes = [int(np.where(abs(free / f - 1) < 0.08, moves, 0).argmax()) for f in FREQUENCIES]

    def fitted(x):
        """Frequencies and ratios, (2 n,), and their derivatives by x: modulus and n ratios over the guesses."""
        ratios = np.full(len(free), GUESS[1])
        ratios[modes] *= x[1:]
        found = ep.sensitivity(
            mbs, end_time=times[-1] + 1e-4, step=8e-6 if options.quick else 3e-6, of="velocity", at=beam,
            point=ACCELEROMETER, times=times, weights=weights.reshape(-1, len(times)),
            values={beam: {"E": GUESS[0] * x[0], "damping": ratios}},
        )  # fmt: skip
        by = np.column_stack([GUESS[0] * found.by[beam]["E"], GUESS[1] * found.by[beam]["damping"][:, modes]])
        parts = np.column_stack([found.value, by]).reshape(2, n, 2, -1)
        early, late = np.moveaxis(parts[0] + 1j * parts[1], 1, 0)
        rate = np.log(late[:, 0] / early[:, 0]) / DELAY + 2j * np.pi * FREQUENCIES  # -zeta omega + i omega
        by_rate = (late[:, 1:] / late[:, :1] - early[:, 1:] / early[:, :1]) / DELAY
        omega, by_omega = rate.imag, by_rate.imag
        by_ratio = -by_rate.real / omega[:, None] + (rate.real / omega**2)[:, None] * by_omega
        return np.r_[omega / (2 * np.pi), -rate.real / omega], np.vstack([by_omega / (2 * np.pi), by_ratio])

    measured, known = np.r_[FREQUENCIES, RATIOS], {}  # known: residuals and Jacobian are asked for one after the other
    sigma = measured * np.repeat(SIGMA, n)

    def at(x):
        if tuple(x) not in known:
            known[tuple(x)] = fitted(x)
        return known[tuple(x)]

    fit = least_squares(
        lambda x: (at(x)[0] - measured) / sigma, np.ones(n + 1), jac=lambda x: at(x)[1] / sigma[:, None],
        loss="soft_l1", bounds=(0.01, np.inf),
    )  # fmt: skip
    (found, _), modulus = at(fit.x), GUESS[0] * fit.x[0]
    result = {
        "modulus_Pa": float(modulus), "ratios": (GUESS[1] * fit.x[1:]).tolist(), "evaluations": int(fit.nfev),
        "frequencies_Hz": found[:n].tolist(), "difference": (found[:n] / FREQUENCIES - 1).tolist(),
        "by_modes_Hz": (free[modes] * np.sqrt(fit.x[0])).tolist(), "versions": ep.versions(),
    }  # fmt: skip
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    left.bar(x := np.arange(1, n + 1), 100 * (found[:n] / FREQUENCIES - 1))
    left.set(xlabel="mode", ylabel="frequency, model over measurement - 1 [%]", title=f"E = {modulus / 1e9:.1f} GPa")
    for shift, name, ratios in ((-0.2, "measured", RATIOS), (0.2, "found", GUESS[1] * fit.x[1:])):
        right.bar(x + shift, 100 * ratios, 0.4, label=name)
    right.set(xlabel="mode", ylabel="damping ratio [%]", title="mode 1: the foam, which also stiffens it")
    right.legend()
    figure.savefig(picture := (options.out / "hammer_test.png").resolve(), dpi=150)
    print(f"E = {modulus / 1e9:.2f} GPa after {fit.nfev} evaluations; ratios", *(f"{r:.5f}" for r in result["ratios"]))
    print("frequencies differ by [%]:", *(f"{100 * d:.2f}" for d in result["difference"]), f"\n{picture}")
    return result


if __name__ == "__main__":
    main()
