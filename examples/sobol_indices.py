"""Which of speed, angle and friction matters for an oblique impact: first-order and total Sobol indices.

A ball flies at a rigid plane and slides to the end. `ep.restitution_map` computes each impact, `ep.study` many of them,
in processes and with a file that goes on, and `scipy.stats.sobol_indices` the indices. Here they are known: by Coulomb
the spin is a product of functions of speed, angle and friction, and by Hertz the peak force one of speed and angle.
"""

import argparse
import functools
import json
from pathlib import Path

import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np
from scipy.stats import sobol_indices, uniform

import exudyn_partition as ep

R, STEEL = 0.010, ep.Material(E=210e9, nu=0.3, rho=7850.0)
RANGES = {"speed": (0.3, 0.5), "angle": (0.9, 1.1), "friction": (0.05, 0.15)}  # [m/s], [rad] from the normal
TOLD = ("spin", "peak_force")
LAWS = {  # factors of each result, by parameter: a sliding ball by Coulomb, a normal impact by Hertz
    "spin": {"speed": lambda v: v, "angle": np.cos, "friction": lambda mu: mu},
    "peak_force": {"speed": lambda v: v**1.2, "angle": lambda a: np.cos(a) ** 1.2, "friction": np.ones_like},
}


def impact(ball, speed, angle, friction):
    """One impact on a rigid plane."""
    found = ep.restitution_map((ball, ep.RigidPlane()), speed=speed, angle=angle, friction=friction)
    return {name: found[name].item() for name in TOLD}


def expected(factors):
    """First-order and total indices of a product of functions of one parameter each, (3,) and (3,)."""
    ratios = []  # variance of each factor over its squared mean
    for name, (low, high) in RANGES.items():
        nodes, weights = np.polynomial.legendre.leggauss(20)
        values = factors[name](low + (high - low) * (nodes + 1) / 2)
        ratios.append((weights @ values**2 / 2) / (weights @ values / 2) ** 2 - 1)
    ratios = np.array(ratios)
    whole = np.prod(1 + ratios) - 1
    return ratios / whole, ratios * np.prod(1 + ratios) / (1 + ratios) / whole


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="10 impacts in place of 640")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes")
    parser.add_argument("--out", type=Path, default=Path("out/sobol_indices"), metavar="DIR")
    options = parser.parse_args(argv)
    options.out.mkdir(parents=True, exist_ok=True)
    count, file = (2, "quick") if options.quick else (128, "fine")
    ball = options.out / f"ball_{file}.npz"
    if not ball.exists():
        refine = [ep.Refine((0, 0, 0), radius=0.4e-3, h=0.15e-3)]
        fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, R), R), STEEL, maxh=5e-3, refine=refine)
        ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), radius=0.5e-3, axes="xyz"), f_cut=80e3).save(ball)
    function = functools.partial(impact, ep.load_body(ball))

    def results(points):
        """Results of (3, n) points, (2, n), for SciPy."""
        table, lines = [dict(zip(RANGES, point, strict=True)) for point in points.T], options.out / f"{file}.jsonl"
        found = ep.study(function, table, file=lines, workers=options.workers, stop=True)
        return np.array([found[name] for name in TOLD])

    dists = [uniform(low, high - low) for low, high in RANGES.values()]
    indices = sobol_indices(func=results, n=count, dists=dists, rng=np.random.default_rng(0))
    result, figure = {"versions": ep.versions()}, plt.figure(figsize=(9, 4), layout="constrained")
    for panel, name in enumerate(TOLD):
        both = {"first order": indices.first_order[panel], "total": indices.total_order[panel]}
        known = dict(zip(both, expected(LAWS[name]), strict=True))
        axes, x = figure.add_subplot(1, 2, panel + 1), np.arange(len(RANGES))
        for shift, (kind, values) in zip((-0.2, 0.2), both.items(), strict=True):
            axes.bar(x + shift, values, 0.38, label=kind)
            axes.plot(x + shift, known[kind], "k_", ms=16)
            result[f"{name}, {kind}"] = {"computed": values.tolist(), "exact": known[kind].tolist()}
            print(
                f"{name}, {kind}:",
                *(f"{n} {v:.3f} ({k:.3f})" for n, v, k in zip(RANGES, values, known[kind], strict=True)),
            )
        axes.set(xticks=x, xticklabels=RANGES, title=f"{name.replace('_', ' ')}; lines: Coulomb and Hertz")
        axes.legend()
    figure.savefig(picture := (options.out / "sobol_indices.png").resolve(), dpi=150)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    print(picture)
    return result


if __name__ == "__main__":
    main()
