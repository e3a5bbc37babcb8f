"""Runs that are cut, saved, read, and gone on with by a new model, against one run: the state of a run is one value.

Each seed draws a scene as `random_scenes` does, over bases, formulations, frames, friction, damping and plasticity. Its
run is made in one piece. It is made again up to the middle of the contact, and its result is written to a file. A new
model of the same bodies reads it and goes on: new items, new contacts, nothing that was kept. Both ends are compared.

Quantities: difference of the next force, by the largest force; of the forces until the end; of the velocities at the
end, by the speed of the impact. Steps are short binary fractions: their sums are exact, so that both runs have the same
step to the last digit. Limits: 1e-12 in explicit steps, in floating frames too, and a hundred times that for what grows
until the end; ten times as much with multipliers. Plastic zones have products in single precision: 1e-6, and 1e-3
until the end, for a zone may settle in another iteration, which changes a force by its tolerance of 1e-4. Implicit
steps end where Newton's method ends: 1e-6 and 1e-4. The first force of multipliers is left out: it is a mean over both
sides of the cut.

    python -m validation.stability.cut_runs [--count N] [--only SEED ...] [--out FILE]
"""

import argparse
import tempfile
import time
import warnings
from pathlib import Path

import exudyn as exu
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes
from validation.stability.random_scenes import bodies_of, drawn, duration

COUNT = 40
LIMITS = {
    "explicit": (1e-12, 1e-10), "multipliers": (1e-11, 1e-9), "floating": (1e-12, 1e-10), "zones": (1e-6, 1e-3),
    "implicit": (1e-6, 1e-4),
}  # fmt: skip
STEPS = 400  # in a scene
DIGITS = 20  # binary ones of a step


def kind_of(scene, method):
    """Name of the limits that a run has."""
    if method == "implicit":
        return method
    if scene.yields:
        return "zones"
    if scene.frame == "floating":
        return scene.frame
    return "multipliers" if scene.formulation == "lagrange" else method


def short(step):
    """The step, no longer than the given one, with few binary digits: multiples of it are exact numbers."""
    mantissa, exponent = np.frexp(step)
    return float(np.ldexp(np.floor(np.ldexp(mantissa, DIGITS)), exponent - DIGITS))


def made(scene):
    """Model, bodies and contact of a scene."""
    mbs = exu.SystemContainer().AddSystem()
    (upper, _), (lower, _) = bodies_of(scene)
    turning = {"initialAngularVelocity": scene.spin} if any(scene.spin) else {}
    common = {"frame": scene.frame, "damping": scene.damping}
    place = (*scene.aside, 0.0) if scene.shapes == ("block", "block") else (0.0, 0.0, 0.0)
    moving = {"initialVelocity": scene.velocity, "referencePosition": place} | common | turning
    items = [
        ep.CreatePartitionBody(mbs, upper, name="upper", **moving),
        ep.CreatePartitionBody(mbs, lower, name="lower", **common),
    ]
    contact = ep.CreatePartitionContact(mbs, *items, formulation=scene.formulation, friction=scene.friction)
    mbs.Assemble()
    return mbs, items, contact


def ends(items, contact, result):
    """Forces, and velocities of all coordinates at the end."""
    return contact.force(result), np.concatenate([item.coordinates_t(result)[-1] for item in items])


def compared(seed, method):
    """Row of a seed: differences between the run in two pieces and that in one."""
    scene, begin = drawn(seed), time.perf_counter()
    row = {"seed": seed, "method": method, "scene": str(scene), "kind": kind_of(scene, method)}
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as folder:
        warnings.simplefilter("ignore")
        mbs, items, contact = made(scene)
        whole = duration(scene)
        step = whole / STEPS
        if method == "explicit":
            step = min(step, 0.9 * ep.stability_limit(mbs))
        count = int(np.ceil(whole / step))
        step = short(whole / count)
        last = count * step
        options = {"step": step, "method": method}
        force, velocity = ends(items, contact, ep.solve_dynamic(mbs, end_time=last, **options))
        at = int(np.median(np.flatnonzero(force > 0.0))) if force.any() else count // 2
        mbs, items, contact = made(scene)
        path = Path(folder) / "cut.npz"
        ep.solve_dynamic(mbs, end_time=at * step, **options).save(path)
        mbs, items, contact = made(scene)
        result = ep.solve_dynamic(mbs, end_time=last, go_on=ep.Result.load(path, mbs), **options)
        rest, after = ends(items, contact, result)
    later, largest = force[-len(rest) :], force.max()
    row["closed"] = bool(later[0] > 0.0)
    if largest > 0.0:
        row["next"] = float(abs(rest[1] - later[1]) / largest)
        row["forces"] = float(abs(rest[1:] - later[1:]).max() / largest)
    row["velocity"] = float(abs(after - velocity).max() / abs(velocity).max())
    limits = LIMITS[row["kind"]]
    row["beyond"] = [
        name
        for name, limit in (("next", limits[0]), ("forces", limits[1]), ("velocity", limits[1]))
        if not row.get(name, 0.0) <= limit
    ]
    return row | {"time_s": time.perf_counter() - begin}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=COUNT, help="seeds, from 0 on")
    parser.add_argument("--only", type=int, nargs="+", help="these seeds; nothing is stored")
    parser.add_argument("--out", type=Path, help="file of the results, instead of the JSON beside the script")
    options = parser.parse_args()
    console, begin, rows = Console(width=170), time.perf_counter(), []
    seeds = options.only or range(options.count)
    with ep.progress("cut runs") as report:
        for seed in seeds:
            methods = ("explicit", "implicit") if drawn(seed).formulation != "lagrange" else ("explicit",)
            rows += [compared(seed, method) for method in methods]
            report((len(rows)) / (2 * len(seeds)))
    for row in rows:
        if options.only or row["beyond"]:
            console.print(row, markup=False)
    if options.only:
        return
    found, counts = {}, {}
    for kind in LIMITS:
        own = [row for row in rows if row["kind"] == kind]
        counts[kind] = {"runs": len(own), "closed at the cut": sum(row["closed"] for row in own)}
        found[f"{kind}, next"] = max((row.get("next", 0.0) for row in own), default=0.0)
        later = [row.get(name, 0.0) for row in own for name in ("forces", "velocity")]
        found[f"{kind}, until the end"] = max(later, default=0.0)
    limits = {
        f"{kind}, {what}": limit
        for kind, both in LIMITS.items()
        for what, limit in zip(("next", "until the end"), both, strict=True)
    }
    beyond = [f"seed {row['seed']}, {row['method']}: {row['scene']}" for row in rows if row["beyond"]]
    result = {
        "limits": limits, "found": found, "counts": counts, "beyond_limits": beyond, "rows": rows,
        "time_s": time.perf_counter() - begin,
    }  # fmt: skip
    console.print(found, counts)
    scenes.finish(__file__, result, beyond, options.out)


if __name__ == "__main__":
    main()
