"""Compiled runs against Exudyn's, in the random scenes of `random_scenes` as far as compiled runs hold them.

Of each scene, formulation, frame, plastic flow and spin are replaced by those that compiled runs hold. A random
acceleration of gravity of some thousand m/s2 is added, so that bodies also move aside. Even seeds are of two bodies.
Where these have friction, every other scene is of the upper body on a rigid plane, so that it slides on, and of every
third the coefficient falls. With odd seeds, the upper body alone flies at a rigid plane, sphere or cylinder without
friction, in a floating frame with a random spin of some thousand rad/s, or in an inertial frame on a curved surface.
With every other odd seed, it flies at the lower body instead, either of them in a floating frame, or fast aside, so
that the rows between them follow facets.
Reference: `solve_dynamic` by Exudyn's VelocityVerlet. Quantity: largest difference of each sensor (coordinates,
velocities, of the contact its force, resultant, number of closed rows and smallest gap, and of friction its force, rows
that stick and slip, work and stored energy), over its largest value; and the share of samples until pairs with friction
begin to slide, where a compiled run ends. Limit: 1e-9, or 1e-14 of places and rotations, which are rounded so.

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
from exudyn_partition.algebra.friction import SLIP, STICK
from validation.contact import scenes
from validation.stability import random_scenes

COUNT, LIMITS = 400, {"difference": 1e-9}
ROUNDING = 1e-14  # of places [m] and rotations [rad] of nodes
HELD = ("contact-adapted", "residual")


def drawn(number, *, friction=True):
    """A scene, as compiled runs hold it; with its friction or without."""
    scene = random_scenes.drawn(number)
    basis, mu = scene.basis if scene.basis in HELD else HELD[number % 2], scene.friction if friction else None
    held = {"formulation": "compliance", "frame": "inertial", "yields": False, "spin": (0.0,) * 3}
    return replace(scene, friction=mu, basis=basis, **held)


def law_of(scene, number):
    """Friction of a scene; the coefficient may fall."""
    if scene.friction is None or number % 3:
        return scene.friction
    return ep.Coulomb(scene.friction, 0.5 * scene.friction, 0.2 * np.linalg.norm(scene.velocity))


def surface_of(number):
    """A rigid surface below the origin, which its highest point touches."""
    rng = np.random.default_rng(number)
    radius, (x, y, _) = rng.uniform(0.02, 0.2), rng.normal(size=3)
    surfaces = (
        ep.RigidPlane(),
        ep.RigidSphere((0, 0, -radius), radius),
        ep.RigidCylinder((0, 0, -radius), (x, y, 0), radius),
        ep.RigidCylinder((0, 0, radius), (x, y, 0), radius, hollow=True),
    )
    return surfaces[number % 4]


def spin_of(number):
    """Angular velocity of a body in a floating frame that flies at a surface, if the frame is given [rad/s]."""
    return 2e3 * np.random.default_rng(number).normal(size=3)


def on_surface(number, frame=None, scene=None):
    """Model of a body that flies at a rigid surface, its body and contact, and how long it runs [s].

    Without a `frame`, some are inertial ones. With friction if another `scene` is given that has it.
    """
    law = None if scene is None else law_of(scene, number)
    scene, mbs = replace(scene or drawn(number), shapes=("ball", "ball")), exu.SystemContainer().AddSystem()
    rng, ((upper, _), _) = np.random.default_rng(number), random_scenes.bodies_of(scene)
    if frame is None:
        frame = "inertial" if number % 4 and rng.random() < 0.3 else "floating"
    spin = {"initialAngularVelocity": 2e3 * rng.normal(size=3)} if frame == "floating" else {}
    thrown = ep.CreatePartitionBody(
        mbs, upper, name="upper", damping=scene.damping, gravity=1e3 * rng.normal(size=3), frame=frame,
        initialVelocity=scene.velocity, **spin,
    )  # fmt: skip
    contact = ep.CreatePartitionContact(mbs, thrown, surface_of(number), name="contact", friction=law)
    mbs.Assemble()
    return mbs, (thrown,), contact, random_scenes.duration(scene)


def of_two(number, *, friction=True):
    """Model of a scene, its bodies and contact, and how long it runs [s]."""
    scene, mbs = drawn(number, friction=friction), exu.SystemContainer().AddSystem()
    (upper, _), (lower, _) = random_scenes.bodies_of(scene)
    place = (*scene.aside, 0.0) if scene.shapes == ("block", "block") else (0.0, 0.0, 0.0)
    motion = {"initialVelocity": scene.velocity, "referencePosition": place}
    gravity = 1e3 * np.random.default_rng(number).normal(size=3)
    thrown = ep.CreatePartitionBody(mbs, upper, name="upper", damping=scene.damping, gravity=gravity, **motion)
    on_plane = scene.friction is not None and number % 2 == 0
    rests = ep.RigidPlane() if on_plane else ep.CreatePartitionBody(mbs, lower, name="lower", damping=scene.damping)
    contact = ep.CreatePartitionContact(mbs, thrown, rests, name="contact", friction=law_of(scene, number))
    mbs.Assemble()
    return mbs, (thrown, rests), contact, random_scenes.duration(scene)


def of_two_that_move(number, scene=None):
    """Model of two bodies whose rows follow facets, its bodies and contact, and how long it runs [s].

    With friction if another `scene` is given that has it; then a frame turns.
    """
    scene, mbs = scene or drawn(number, friction=False), exu.SystemContainer().AddSystem()
    rng, ((upper, _), (lower, _)) = np.random.default_rng(number), random_scenes.bodies_of(scene)
    place = (*scene.aside, 0.0) if scene.shapes == ("block", "block") else (0.0, 0.0, 0.0)
    frames = (("floating", "floating"), ("floating", "inertial"), ("inertial", "floating"), ("inertial", "inertial"))
    upper_frame, lower_frame = frames[number // 2 % (4 if scene.friction is None else 3)]
    spins = [
        {"initialAngularVelocity": 1e3 * rng.normal(size=3)} if frame == "floating" else {}
        for frame in (upper_frame, lower_frame)
    ]
    fast = rng.uniform(3.0, 30.0) * np.r_[rng.normal(size=2), 0.0] if upper_frame == lower_frame == "inertial" else 0.0
    thrown = ep.CreatePartitionBody(
        mbs, upper, name="upper", damping=scene.damping, gravity=1e3 * rng.normal(size=3), frame=upper_frame,
        initialVelocity=np.add(scene.velocity, fast), referencePosition=place, **spins[0],
    )  # fmt: skip
    rests = ep.CreatePartitionBody(mbs, lower, name="lower", damping=scene.damping, frame=lower_frame, **spins[1])
    contact = ep.CreatePartitionContact(mbs, thrown, rests, name="contact", friction=law_of(scene, number))
    mbs.Assemble()
    return mbs, (thrown, rests), contact, random_scenes.duration(scene)


def columns_of(values):
    """Columns of a sensor that have a largest value in common: of friction, forces, counts and energies."""
    if values.shape[1] != 7:
        return [values]
    return np.split(values, [3, 5], axis=1)


def reverses(contact, right):
    """Whether the friction force turns round in a run."""
    force = contact.friction.tangential_force(right)
    some = force[np.linalg.norm(force, axis=1) > 0.1 * np.linalg.norm(force, axis=1).max()]
    return len(some) > 0 and bool((some @ some[0]).min() < 0.0)


def both(mbs, end):
    """Results of a model by Exudyn and by compiled steps."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return [ep.solve_dynamic(mbs, end_time=end, solver=solver) for solver in ("exudyn", "compiled")]


def checked(seed):
    """The row of a seed."""
    make = on_surface if seed % 4 == 1 else of_two_that_move if seed % 2 else of_two
    kind = ("", " on a rigid surface", "", " with rows that follow facets")[seed % 4]
    return row_of(seed, drawn(seed // 2, friction=not seed % 2), make(seed // 2), kind)


def row_of(seed, scene, made, kind):
    """The row of a scene, whose model is as `on_surface` returns it."""
    mbs, _, _, end = made
    right, found = both(mbs, end)
    n, difference, contact = len(found.t), 0.0, right.contacts[0]
    for number, values in right.sensors.items():
        for one, other in zip(columns_of(values[:n]), columns_of(found.sensors[number]), strict=True):
            finite = np.isfinite(one)
            scale, error = abs(one[finite]).max(initial=0.0), abs(other[finite] - one[finite]).max(initial=0.0)
            error = max(error - ROUNDING, 0.0) if one.shape[1] == 6 else error
            difference = max(difference, error / scale if scale else error)
    states = contact.friction.states(right)[:n] if scene.friction else np.zeros(1)
    return {
        "seed": seed,
        "scene": f"{scene}{kind}",
        "difference": difference,
        "share": n / len(right.t),
        "hit": bool(contact.force(right)[:n].any()),
        "sticks": bool((states == STICK).any()),
        "slips": bool((states == SLIP).any()),
        "reverses": bool(scene.friction) and reverses(contact, right),
    }


def options(said, count):
    """What the command line gives to a script with this docstring, and this number of seeds by default."""
    parser = argparse.ArgumentParser(description=said.splitlines()[0])
    parser.add_argument("--count", type=int, default=count, help="seeds, from 0 on")
    parser.add_argument("--out", type=Path, help="file of the results, instead of the JSON beside the script")
    return parser.parse_args()


def compare(checked, given, script, limits, judged=lambda seed: "difference"):
    """Run the scenes of all seeds, see `options`; write the JSON of a script. `judged` names the limit of a seed."""
    rows = []
    with ep.progress("compiled runs") as report:
        for seed in range(given.count):
            rows.append(checked(seed))
            report((seed + 1) / given.count)
    worst = max(rows, key=lambda row: row["difference"])
    result = {
        "scenes": len(rows),
        "touched": sum(row["hit"] for row in rows),
        **{f"with_friction_{name}": sum(row[name] for row in rows) for name in ("sticks", "slips", "reverses")},
        "until_the_end": sum(row["share"] == 1.0 for row in rows),
        "worst": worst,
        "found": {
            **{name: max(row["difference"] for row in rows if judged(row["seed"]) == name) for name in limits},
            "median": float(np.median([row["difference"] for row in rows])),
        },
        "limits": limits,
    }
    Console().print(result)
    failed = [f"{name} {result['found'][name]:.2g}" for name, limit in limits.items() if result["found"][name] > limit]
    scenes.finish(script, result, failed, given.out)


def main():
    compare(checked, options(__doc__, COUNT), __file__, LIMITS)


if __name__ == "__main__":
    main()
