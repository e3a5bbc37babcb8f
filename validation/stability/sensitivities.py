"""Derivatives by the adjoint against differences of runs, in the random scenes of `compiled_runs`, without friction.

Reference: central differences of `run_many`, whose parameters change by a share of a usual size: 1 m/s, 10 rad/s, 1 um,
1e4 m/s2, a damping ratio of 0.02, E and rho of steel. The share is 1e-5 or 1e-6, whichever agrees better: where a row
closes or opens within the larger change, there is a kink, and the smaller one has more round-off.
Quantity: largest difference of the derivatives of peak force, impulse and duration, times the usual size, over the
number itself or the largest derivative of the kind. Scenes whose pairs slide are left out, and derivatives by places of
bodies that touch at the start: these hold for one direction alone, which `Sensitivity.edges` has to tell. Limit: 1e-6.

    python -m validation.stability.sensitivities [--count N] [--out FILE]
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
from rich.console import Console

import exudyn_partition as ep
from exudyn_partition.errors import RunError
from validation.contact import scenes
from validation.stability.compiled_runs import drawn, of_two

COUNT, LIMITS, SHARES = 100, {"difference": 1e-6}, (1e-5, 1e-6)
NUMBERS = {"peak_force": "peak", "impulse": "impulse", "duration": "duration"}
SIZES = {
    "initialVelocity": 1.0, "initialAngularVelocity": 10.0, "referencePosition": 1e-6, "gravity": 1e4,
    "damping": 0.02, "E": ep.STEEL.E, "rho": ep.STEEL.rho,
}  # fmt: skip


def values(seed, item, name):
    """Present value of a parameter, of a body of the scene."""
    scene = drawn(seed, friction=False)
    if name in ("E", "rho"):
        return np.array(SIZES[name])
    if name == "damping":
        return np.array(scene.damping or 0.0)
    thrown = item.name == "upper"
    given = {"referencePosition": item.position}
    if thrown:
        given |= {"initialVelocity": scene.velocity, "gravity": 1e3 * np.random.default_rng(seed).normal(size=3)}
    return np.array(given.get(name, np.zeros(3)), dtype=float)


def changed(value, name, share):
    """Values that differ from one by more and by less, (2 k,) or (2 k, 3); damping only by more, from zero on."""
    change = share * SIZES[name]
    ways = change * np.vstack([np.eye(max(value.size, 1)), -np.eye(max(value.size, 1))])
    return value + (ways if value.ndim else ways[:, 0])


def checked(seed):
    """Largest difference of the scene, and whether bodies touch at the start; None if pairs slide."""
    mbs, bodies, contact, end = of_two(seed, friction=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = {of: ep.sensitivity(mbs, end_time=end, of=of, at=contact) for of in NUMBERS}
        except RunError:
            return None
        step = ep.solve_dynamic(mbs, end_time=end, solver="compiled").step
        worst, touch = 0.0, any(one.edges for one in found.values())
        for item in bodies:
            for name in SIZES:
                value = values(seed, item, name)
                if (name == "damping" and not value) or (name == "referencePosition" and touch):
                    continue  # less than no damping is refused
                errors = []
                for share in SHARES:
                    runs = ep.run_many(mbs, end_time=end, step=step, vary={item: {name: changed(value, name, share)}})
                    errors.append([error(found[of], item, name, runs, share) for of in NUMBERS])
                worst = max(worst, np.min(errors, axis=0).max())
    return worst, touch


def error(found, item, name, runs, share):
    """Difference of a derivative from that of runs, see the module."""
    more, less = np.split(getattr(runs, NUMBERS[found.of])[:, 0], 2)
    by_runs, derivative = (more - less) / (2 * share), SIZES[name] * np.atleast_1d(found.by[item][name])
    return abs(derivative - by_runs).max() / max(abs(found.value), abs(derivative).max())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=COUNT, help="seeds, from 0 on")
    parser.add_argument("--out", type=Path, help="file of the results, instead of the JSON beside the script")
    options = parser.parse_args()
    found, touching = {}, 0
    with ep.progress("sensitivities") as report:
        for seed in range(options.count):
            if (row := checked(seed)) is not None:
                found[seed], touching = row[0], touching + row[1]
            report((seed + 1) / options.count)
    beyond = {seed: value for seed, value in found.items() if value > LIMITS["difference"]}
    result = {
        "scenes": len(found),
        "touching": touching,
        "sliding": options.count - len(found),
        "found": {"difference": max(found.values()), "median": float(np.median([*found.values()]))},
        "beyond": beyond,
        "limits": LIMITS,
    }
    Console().print(result)
    scenes.finish(__file__, result, [f"seed {seed}: {value:.2g}" for seed, value in beyond.items()], options.out)


if __name__ == "__main__":
    main()
