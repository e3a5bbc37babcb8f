"""Compiled runs against Exudyn's, in the random scenes of `random_scenes` as far as compiled runs hold them.

Of each scene, formulation, frame, friction, plastic flow and spin are replaced by those that compiled runs hold. A
random acceleration of gravity of some thousand m/s2 is added, so that bodies also move aside. With the other seeds, the
upper body alone flies at a rigid plane, sphere or cylinder, in a floating frame with a random spin of some thousand
rad/s, or in an inertial frame on a curved surface.
Reference: `solve_dynamic` by Exudyn's VelocityVerlet. Quantity: largest difference of each sensor (coordinates,
velocities, and of the contact its force, resultant, number of closed rows and smallest gap), over its largest value;
and the share of samples until pairs begin to slide, where a compiled run ends. Limit: 1e-9.

    python -m validation.stability.compiled_runs [--count N] [--out FILE]
"""

import argparse
import warnings
from dataclasses import replace
from pathlib import Path

import exudyn as exu
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes
from validation.stability import random_scenes

COUNT, LIMITS = 200, {"difference": 1e-9}
HELD = ("contact-adapted", "residual")


def drawn(seed):
    """The scene of a seed, as compiled runs hold it."""
    scene = random_scenes.drawn(seed)
    basis = scene.basis if scene.basis in HELD else HELD[seed % 2]
    return replace(
        scene, formulation="compliance", frame="inertial", friction=None, yields=False, spin=(0.0,) * 3, basis=basis
    )


def surface_of(seed):
    """A rigid surface below the origin, which its highest point touches."""
    rng = np.random.default_rng(seed)
    radius, (x, y, _) = rng.uniform(0.02, 0.2), rng.normal(size=3)
    surfaces = (
        ep.RigidPlane(),
        ep.RigidSphere((0, 0, -radius), radius),
        ep.RigidCylinder((0, 0, -radius), (x, y, 0), radius),
        ep.RigidCylinder((0, 0, radius), (x, y, 0), radius, hollow=True),
    )
    return surfaces[seed % 4]


def on_surface(seed):
    """Model of a body that flies at a rigid surface, its body and contact, and how long it runs [s]."""
    scene, mbs = replace(drawn(seed), shapes=("ball", "ball")), exu.SystemContainer().AddSystem()
    rng, ((upper, _), _) = np.random.default_rng(seed), random_scenes.bodies_of(scene)
    frame = "inertial" if seed % 4 and rng.random() < 0.3 else "floating"
    spin = {"initialAngularVelocity": 2e3 * rng.normal(size=3)} if frame == "floating" else {}
    thrown = ep.CreatePartitionBody(
        mbs, upper, name="upper", damping=scene.damping, gravity=1e3 * rng.normal(size=3), frame=frame,
        initialVelocity=scene.velocity, **spin,
    )  # fmt: skip
    contact = ep.CreatePartitionContact(mbs, thrown, surface_of(seed), name="contact")
    mbs.Assemble()
    return mbs, (thrown,), contact, random_scenes.duration(scene)


def model(seed):
    """Model of the scene, its bodies and contact, and how long it runs [s]."""
    if seed % 2:
        return on_surface(seed // 2)
    scene, mbs = drawn(seed), exu.SystemContainer().AddSystem()
    (upper, _), (lower, _) = random_scenes.bodies_of(scene)
    place = (*scene.aside, 0.0) if scene.shapes == ("block", "block") else (0.0, 0.0, 0.0)
    motion = {"initialVelocity": scene.velocity, "referencePosition": place}
    gravity = 1e3 * np.random.default_rng(seed).normal(size=3)
    thrown = ep.CreatePartitionBody(mbs, upper, name="upper", damping=scene.damping, gravity=gravity, **motion)
    rests = ep.CreatePartitionBody(mbs, lower, name="lower", damping=scene.damping)
    contact = ep.CreatePartitionContact(mbs, thrown, rests, name="contact")
    mbs.Assemble()
    return mbs, (thrown, rests), contact, random_scenes.duration(scene)


def both(seed):
    """Results of the scene by Exudyn and by compiled steps."""
    mbs, _, _, end = model(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return [ep.solve_dynamic(mbs, end_time=end, solver=solver) for solver in ("exudyn", "compiled")]


def checked(seed):
    """The row of a seed."""
    right, found = both(seed)
    n, difference = len(found.t), 0.0
    for number, values in right.sensors.items():
        finite = np.isfinite(values[:n])
        scale = abs(values[:n][finite]).max(initial=0.0)
        error = abs(found.sensors[number][finite] - values[:n][finite]).max(initial=0.0)
        difference = max(difference, error / scale if scale else error)
    touched = bool(right.contacts[0].force(right)[:n].any())
    return {
        "seed": seed,
        "scene": str(drawn(seed // 2 if seed % 2 else seed)) + (" on a rigid surface" if seed % 2 else ""),
        "difference": difference,
        "share": n / len(right.t),
        "hit": touched,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=COUNT, help="seeds, from 0 on")
    parser.add_argument("--out", type=Path, help="file of the results, instead of the JSON beside the script")
    options = parser.parse_args()
    rows = []
    with ep.progress("compiled runs") as report:
        for seed in range(options.count):
            rows.append(checked(seed))
            report((seed + 1) / options.count)
    worst = max(rows, key=lambda row: row["difference"])
    result = {
        "scenes": len(rows),
        "touched": sum(row["hit"] for row in rows),
        "until_the_end": sum(row["share"] == 1.0 for row in rows),
        "worst": worst,
        "found": {"difference": worst["difference"], "median": float(np.median([row["difference"] for row in rows]))},
        "limits": LIMITS,
    }
    Console().print(result)
    failed = [f"{name} {result['found'][name]:.2g}" for name, limit in LIMITS.items() if result["found"][name] > limit]
    scenes.finish(__file__, result, failed, options.out)


if __name__ == "__main__":
    main()
