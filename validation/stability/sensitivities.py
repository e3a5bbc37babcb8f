"""Derivatives by the adjoint against differences of runs, in the random scenes of `compiled_runs`.

A quarter of the seeds are scenes that have friction, half of them on a rigid plane; of a third of these the
coefficient falls as contact slips. A quarter are all scenes, without friction. A quarter are balls on rigid spheres,
cylinders and bores: rows follow the motion, and normals and flexibility with them. A quarter are balls in floating
frames that spin and hit a rigid plane.
Reference: central differences of `run_many`, whose parameters change by a share of a usual size: 1 m/s, 10 rad/s, 1 um,
1e4 m/s2, a damping ratio of 0.02, E and rho of steel, a coefficient of 0.1. Vectors change along a random direction, of
each scene and parameter another one: a wrong entry shows there as well as in three differences, at a third of the runs.
The share is 1e-5, 1e-6 or, with friction, 1e-7 or 2e-8, on curved surfaces 3e-6, in floating frames 1e-3 or 1e-4. The
next one is taken only where all before miss by more than a tenth of the limit; the one that agrees best counts.
Differences are curved where a coefficient falls with the speed of slip. Where a row changes its status within the
larger change, there is a kink, and the smaller one has more round-off, most on curved surfaces, where gaps are
differences of lengths. There the flexibility of rows is found again where normals have changed by a hundredth; it jumps
if a change moves that to another step. Rotation vectors of floating frames have few digits at the start, as Exudyn
composes them, so that small changes have much round-off.
Quantity: largest difference of the derivatives of peak force, impulse, duration and the work of friction along these
directions, times the usual size, over the number itself or the largest derivative of the kind. Scenes whose pairs slide
are left out, and derivatives by places of bodies that touch at the start: these hold for one direction alone, which
`Sensitivity.edges` has to tell. Limit: 1e-6.

    python -m validation.stability.sensitivities [--count N] [--workers N] [--out FILE]
"""

import argparse
import itertools
import warnings
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from rich.console import Console

import exudyn_partition as ep
from exudyn_partition.errors import InputError, RunError
from validation.contact import scenes
from validation.stability.compiled_runs import drawn, of_two, on_surface, spin_of

ENOUGH = 0.1  # share of the limit below which no smaller change is taken
KINDS = ("with_friction", "without", "curved", "floating")
COUNT, LIMITS, SHARES = 400, {"difference": 1e-6}, (1e-5, 1e-6)
SHARES_OF = {"with_friction": (*SHARES, 1e-7, 2e-8), "without": SHARES, "curved": (1e-5, 3e-6, 1e-6)}
SHARES_OF |= {"floating": (1e-3, 1e-4, *SHARES)}
NUMBERS = {"peak_force": "peak", "impulse": "impulse", "duration": "duration", "dissipated": "dissipated"}
SIZES = {
    "initialVelocity": 1.0, "initialAngularVelocity": 10.0, "referencePosition": 1e-6, "gravity": 1e4,
    "damping": 0.02, "E": ep.STEEL.E, "rho": ep.STEEL.rho,
    "friction": 0.1,
}  # fmt: skip


def values(number, item, name):
    """Present value of a parameter, of a body of the scene or of its contact."""
    floats = getattr(item, "frame", None) == "floating"
    scene = drawn(number)
    if name == "friction":
        return np.array(scene.friction)
    if name in ("E", "rho"):
        return np.array(SIZES[name])
    if name == "damping":
        return np.array(scene.damping or 0.0)
    thrown = item.name == "upper"
    given = {"referencePosition": item.position}
    if thrown:
        force = item.weight[:3] if floats else item.weight @ item.body.rigid[:, :3]
        given |= {"initialVelocity": scene.velocity, "gravity": force / item.body.total_mass}
        given |= {"initialAngularVelocity": spin_of(number)} if floats else {}
    return np.array(given.get(name, np.zeros(3)), dtype=float)


def direction_of(number, item, name):
    """Along which a parameter changes, (3,), or one for a number; a random direction, the same in each process."""
    value = values(number, item, name)
    way = np.random.default_rng([number, len(item.name), [*SIZES].index(name)]).normal(size=value.shape)
    return way / np.linalg.norm(way) if value.ndim else np.array(1.0)


def changed(value, way, name, share):
    """A value that is more along a way, and one that is less, (2,) or (2, 3)."""
    change = share * SIZES[name] * way
    return np.array([value + change, value - change])


def scene_of(seed):
    """Number of a scene, and its kind."""
    kind, place = KINDS[seed % len(KINDS)], seed // len(KINDS)
    if kind == "without":
        return place, kind
    if kind == "floating":
        return 4 * place, kind
    if kind == "curved":  # every fourth surface is a plane
        return place // 3 * 4 + place % 3 + 1, kind
    rough = (number for number in itertools.count() if drawn(number).friction is not None)
    return next(itertools.islice(rough, place, None)), kind


def checked(seed):
    """The row of a seed, see `row_of`; where a ball misses the plane, of a later scene."""
    number, kind = scene_of(seed)
    while True:
        try:
            return row_of(number, kind)
        except InputError as error:
            if kind != "floating" or "never closes" not in str(error):
                raise
            number += COUNT


def row_of(number, kind):
    """The row of a scene: its largest difference, and whether bodies touch at the start; None if pairs slide."""
    friction, frame = kind == "with_friction", {"curved": "inertial", "floating": "floating"}.get(kind)
    mbs, _, contact, end = of_two(number, friction=friction) if frame is None else on_surface(number, frame)
    numbers = [of for of in NUMBERS if friction or of != "dissipated"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = {of: ep.sensitivity(mbs, end_time=end, of=of, at=contact) for of in numbers}
        except RunError:
            return None
        step = ep.solve_dynamic(mbs, end_time=end, solver="compiled").step
        touch, one = any(of_one.edges for of_one in found.values()), found["impulse"]
        worst = dict.fromkeys(numbers, 0.0)
        for item, of_item in one.by.items():
            for name in {*SIZES} & {*of_item}:
                value = values(number, item, name)
                if (name == "damping" and not value) or (name == "referencePosition" and touch):
                    continue  # less than no damping is refused
                least, way = np.full(len(numbers), np.inf), direction_of(number, item, name)
                for share in SHARES_OF[kind]:
                    vary = {item: {name: changed(value, way, name, share)}}
                    runs = ep.run_many(mbs, end_time=end, step=step, vary=vary, histories=())
                    errors = [error(found[of], item, name, way, runs, share) for of in numbers]
                    least = np.minimum(least, errors)
                    if least.max() <= ENOUGH * LIMITS["difference"]:
                        break
                worst = {of: max(worst[of], one) for of, one in zip(numbers, least, strict=True)}
    return {"difference": float(max(worst.values())), "touch": touch, "kind": kind, "margin": one.margin}


def error(found, item, name, way, runs, share):
    """Difference of a derivative along a way from that of runs, see the module."""
    (more, less), derivative = getattr(runs, NUMBERS[found.of])[:, 0], SIZES[name] * np.array(found.by[item][name])
    return abs(np.sum(derivative * way) - (more - less) / (2 * share)) / max(abs(found.value), abs(derivative).max())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=COUNT, help="seeds, from 0 on")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="file of the results, instead of the JSON beside the script")
    options = parser.parse_args()
    rows = {}
    with ep.progress("sensitivities") as report, ProcessPoolExecutor(options.workers) as pool:
        for seed, row in enumerate(pool.map(checked, range(options.count))):
            if row is not None:
                rows[seed] = row
            report((seed + 1) / options.count)
    beyond = {seed: row for seed, row in rows.items() if row["difference"] > LIMITS["difference"]}
    differences = {kind: [row["difference"] for row in rows.values() if row["kind"] == kind] for kind in KINDS}
    result = {
        "scenes": {kind: len(some) for kind, some in differences.items()},
        "touching": sum(row["touch"] for row in rows.values()),
        "sliding": options.count - len(rows),
        "found": {
            "difference": max(row["difference"] for row in rows.values()),
            "largest": {kind: max(some, default=0.0) for kind, some in differences.items()},
            "median": {kind: float(np.median(some)) if some else 0.0 for kind, some in differences.items()},
        },
        "beyond": beyond,
        "limits": LIMITS,
    }
    Console().print(result)
    scenes.finish(
        __file__, result, [f"seed {seed}: {row['difference']:.2g}" for seed, row in beyond.items()], options.out
    )


if __name__ == "__main__":
    main()
