"""How soft a buffer should be, and how fast it may hit: `scipy.optimize.minimize` with derivatives of the impact.

A plastic ball hits a steel block, as the tip of an impact hammer does. The blow must have an impulse, and be short
enough for the frequencies that it is to excite. Among all moduli and speeds that do so, the one with the smallest peak
force is wanted. `ep.sensitivity` gives peak, impulse and duration with their derivatives by modulus and speed; SLSQP
then needs some ten runs. By Hertz' law the answer is known: both conditions are met exactly.
"""

import argparse
import json
from pathlib import Path

import exudyn as exu
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np
from scipy.optimize import fsolve, minimize

import exudyn_partition as ep

R, EDGE = 0.020, 0.040  # radius of the ball, edge of the block [m]
IMPULSE, DURATION = 0.10, 0.40e-3  # of the blow: at least [N s], at most [s]
PLASTIC = ep.Material(E=2e9, nu=0.4, rho=1400.0)  # the first guess of the modulus
SPEED, END = 0.8, 0.8e-3  # the first guess of the speed [m/s], end of the runs [s]
OF = ("peak_force", "impulse", "duration")


def scene(quick):
    """The model, the ball and the contact."""
    ball = occ.Sphere(occ.Pnt(0, 0, R), R)
    block = occ.Box((-EDGE / 2, -EDGE / 2, -EDGE), (EDGE / 2, EDGE / 2, 0))
    bodies, h = [], 0.9e-3 if quick else 0.45e-3
    for shape, material, radius in ((ball, PLASTIC, 3.0e-3), (block, ep.STEEL, 3.6e-3)):
        fem = ep.fe_model(shape, material, maxh=10e-3, refine=[ep.Refine((0, 0, 0), radius, h)])
        bodies.append(ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), radius), f_cut=20e3))
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, bodies[0], name="ball", referencePosition=[0, 0, 1e-6])
    contact = ep.CreatePartitionContact(mbs, item, ep.CreatePartitionBody(mbs, bodies[1], name="block"))
    mbs.Assemble()
    return mbs, item, contact


def hertz(modulus, speed, mass, block_mass):
    """Peak, impulse and duration by Hertz."""
    both = mass * block_mass / (mass + block_mass)
    plastic = ep.Material(E=modulus, nu=PLASTIC.nu, rho=PLASTIC.rho)
    found = ep.hertz.impact(both, speed, R, np.inf, plastic, ep.STEEL)
    return np.array([found.peak_force, 2 * both * speed, found.duration])


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a coarser mesh")
    parser.add_argument("--out", type=Path, default=Path("out/buffer_design"), metavar="DIR")
    options = parser.parse_args(argv)
    options.out.mkdir(parents=True, exist_ok=True)
    mbs, ball, contact = scene(options.quick)
    tried = {}  # by modulus and speed: logarithms of the three numbers, (3,), and their slopes, (3, 2)

    def logarithms(x):
        """Logarithms of all numbers, and their derivatives by those of modulus and speed over the guesses."""
        key = tuple(x)
        if key not in tried:
            E, v = PLASTIC.E * np.exp(x[0]), SPEED * np.exp(x[1])
            values = {ball: {"E": E, "initialVelocity": [0, 0, -v]}}
            found = [ep.sensitivity(mbs, end_time=END, step=1e-6, of=of, at=contact, values=values) for of in OF]
            by = [[E * one.by[ball]["E"], -v * one.by[ball]["initialVelocity"][2]] for one in found]
            numbers = np.array([one.value for one in found])
            tried[key] = np.log(numbers), np.array(by) / numbers[:, None]
        return tried[key]

    conditions = [
        {"type": "ineq", "fun": lambda x: logarithms(x)[0][1] - np.log(IMPULSE), "jac": lambda x: logarithms(x)[1][1]},
        {
            "type": "ineq",
            "fun": lambda x: np.log(DURATION) - logarithms(x)[0][2],
            "jac": lambda x: -logarithms(x)[1][2],
        },
    ]
    best = minimize(
        lambda x: logarithms(x)[0][0], np.zeros(2), jac=lambda x: logarithms(x)[1][0], constraints=conditions,
        method="SLSQP", options={"ftol": 1e-8},
    )  # fmt: skip
    (logs, slopes), masses = logarithms(best.x), [body.body.total_mass for body in (ball, contact.sides[1][0])]

    def missed(y):
        """By how much a modulus and a speed miss both conditions by Hertz."""
        _, impulse, duration = hertz(PLASTIC.E * np.exp(y[0]), SPEED * np.exp(y[1]), *masses)
        return np.log(impulse / IMPULSE), np.log(duration / DURATION)

    known = fsolve(missed, np.zeros(2))
    by_hertz = [PLASTIC.E * np.exp(known[0]), SPEED * np.exp(known[1])]
    design = {"modulus_Pa": float(PLASTIC.E * np.exp(best.x[0])), "speed_m_s": float(SPEED * np.exp(best.x[1]))}
    result = {
        **design, "hertz": [float(value) for value in by_hertz],
        **dict(zip(OF, np.exp(logs).tolist(), strict=True)), "slopes": slopes.tolist(), "runs": 3 * len(tried),
        "hertz_peak_N": float(hertz(*by_hertz, *masses)[0]), "success": bool(best.success), "versions": ep.versions(),
    }  # fmt: skip
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    for name, x in (("first guess", np.zeros(2)), ("best", best.x)):
        E, v = PLASTIC.E * np.exp(x[:1]), SPEED * np.exp(x[1])
        vary = {ball: {"E": E, "initialVelocity": [[0, 0, -v]]}}
        runs = ep.run_many(mbs, end_time=END, step=1e-6, vary=vary, histories=("force",))
        axes.plot(1e3 * runs.t, runs.force[0, 0], label=f"{name}: {E[0] / 1e9:.2f} GPa, {v:.2f} m/s")
    axes.axvline(1e3 * DURATION, color="k", ls=":", lw=1, label="longest blow")
    axes.legend(title=f"impulse of {IMPULSE:g} N s with the smallest peak")
    axes.set(xlabel="time [ms]", ylabel="contact force [N]")
    figure.savefig(picture := (options.out / "buffer_design.png").resolve(), dpi=150)
    print(f"E = {design['modulus_Pa'] / 1e9:.3f} GPa (Hertz {by_hertz[0] / 1e9:.3f}), {design['speed_m_s']:.3f} m/s")
    print(f"peak {result['peak_force']:.0f} N (Hertz {result['hertz_peak_N']:.0f}), {result['runs']} runs\n{picture}")
    return result


if __name__ == "__main__":
    main()
