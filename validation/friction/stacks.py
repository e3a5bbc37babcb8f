"""Flat faces with friction in groups: stacked blocks and a table at rest, and a thousand random stacks.

Cubes of 10 mm of steel are stacked under a thousandfold weight, turned by 20 degrees against each other or not; a table
stands on four legs, with a load off its centre.
Reference: the weights above the faces, and for times the version that swept from contact to contact, in a process of
its own in the same minutes; git has to know it.
Quantity: processor time of an implicit step of 2 us [ms], as a share of that version's too, and of one static load step
of the table [s]; forces between the faces after the steps, over the weights above; forces on the table's legs after
five load steps against those after 40; how much the steps change the faces' forces at rest, over the weights above.

Random stacks: two to five blocks of four sizes and two materials, shifted and turned at random on each other, in
inertial or floating frames, with coefficients of 0.05 to 1 and accelerations of 1000 to 30 000 m/s2. First one static
load step, then implicit or explicit steps from random velocities along the faces. Some stacks must tip over: the
centre of mass above a face lies beside the rows that bear it. Quantities: runs that fail; stacks that stand, for which
the static solver finds no rest; static forces over the weights above each face; how far tangential forces exceed the
cone, over the largest of a row.

Limits: with two and three blocks 2 / 15 and 4 / 37.5 of the earlier version's time, turned ones too; 2 s for the table;
forces 1e-8, of the table 5e-4, for friction has a path, which load steps follow more or less closely; changes of forces
at rest 1e-5, for flexibilities are kept while bodies move little; no failure; a rest for all that stand; weights 1e-8;
cone 1e-9.

    python -m validation.friction.stacks [--old REVISION | --checkout FOLDER] [--only rest|random] [--stacks 1000]

With `--only`, the other scenes are those that stacks.json keeps.
"""

import argparse
import contextlib
import json
import sys
import time
import warnings
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.spatial import ConvexHull, Delaunay
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import PartitionError, RunError

ROOT = Path(__file__).parents[2]
OLD = "675b59d"
EDGE, GRAVITY, STEP = 0.010, 9810.0, 2e-6  # [m], [m/s2], [s]
LOAD_STEPS, FINE = 5, 40  # of the table for its forces, which friction makes depend on how the load grows
STACKS, DYNAMIC = 1000, 4  # random stacks, and the time of each in implicit steps
SIZES = ((8e-3, 10e-3, 8e-3), (12e-3, 9e-3, 9e-3), (10e-3, 10e-3, 12e-3), (14e-3, 8e-3, 8e-3))  # [m]
LIMITS = {"two": 2 / 15, "two_turned": 2 / 15, "three": 4 / 37.5, "three_turned": 4 / 37.5, "table_s": 2.0,
          "forces": 1e-8, "table_forces": 5e-4, "rest": 1e-8, "still": 1e-5, "failures": 0, "no_rest": 0,
          "weights": 1e-8, "cone": 1e-9}  # fmt: skip
SCENES = {"one": (1, 0.0), "two": (2, 0.0), "two_turned": (2, 20.0), "three": (3, 0.0), "three_turned": (3, 20.0)}


def block(x, y, z, material=ep.STEEL, *, maxh=3e-3, f_cut=50e3, share=0.6):
    """A block that stands on the origin, with patches on this share of its lower and upper face's diagonal, reduced."""
    fem = ep.fe_model(occ.Box((-x / 2, -y / 2, 0), (x / 2, y / 2, z)), material, maxh=maxh)
    reach = share * np.hypot(x, y)
    foot = ep.Partition.ball(fem, (0, 0, 0), reach, direction=(0, 0, -1), axes="xyz", name="foot")
    head = ep.Partition.ball(fem, (0, 0, z), reach, direction=(0, 0, 1), axes="xyz", name="head")
    return ep.reduce(fem, foot | head, f_cut=f_cut)


def stand(mbs, bodies, places, angles, frictions, gravity, velocities=None, frame="floating"):
    """Put bodies on the ground and on each other; returns their contacts, from below.

    Parameters
    ----------
    bodies : sequence of ReducedBody
    places : (n, 3) array
        [m]
    angles : (n,) array
        About the vertical [degrees].
    frictions : (n,) array
    gravity : float
        [m/s2]
    velocities : (n, 3) array, optional
        [m/s]
    """
    turned = [Rotation.from_euler("z", angle, degrees=True).as_matrix() for angle in angles]
    moving = np.zeros((len(bodies), 3)) if velocities is None else velocities
    blocks = [
        ep.CreatePartitionBody(
            mbs, body, name=f"block {i}", frame=frame, gravity=[0, 0, -gravity], referencePosition=places[i],
            referenceRotationMatrix=turned[i] if frame == "floating" else None, initialVelocity=moving[i],
        )
        for i, body in enumerate(bodies)
    ]  # fmt: skip
    ground = {"slavePatch": "foot", "friction": frictions[0], "name": "ground"}
    contacts = [ep.CreatePartitionContact(mbs, blocks[0], ep.RigidPlane(), **ground)]
    for i in range(1, len(blocks)):
        face = {"slavePatch": "foot", "masterPatch": "head", "friction": frictions[i], "name": f"face {i}"}
        contacts.append(ep.CreatePartitionContact(mbs, blocks[i], blocks[i - 1], **face))
    mbs.Assemble()
    return contacts


def at_rest(body, count, angle, steps=20):
    """Processor time of a step of stacked cubes [ms], its counts, and normal forces of the faces at the end [N]."""
    mbs = exu.SystemContainer().AddSystem()
    shifts = np.array([[0, 0], [9e-4, 0], [0, 7e-4]])[:count]
    places = np.column_stack([shifts, EDGE * np.arange(count)])
    angles = angle * (np.arange(count) == count - 1)
    contacts = stand(mbs, [body] * count, places, angles, np.full(count, 0.3), GRAVITY)
    static = ep.solve_static(mbs, load_steps=1, update_initial=True)
    ep.solve_dynamic(mbs, end_time=2 * STEP, method="implicit", step=STEP)  # so that loops are compiled
    begin = time.process_time()
    result = ep.solve_dynamic(mbs, end_time=steps * STEP, method="implicit", step=STEP)
    step_ms = 1e3 * (time.process_time() - begin) / result.steps
    above = body.total_mass * GRAVITY * np.arange(count, 0, -1)
    return {
        "step_ms": step_ms,
        "active_set_iterations": result.work.active_set_iterations,
        "jacobians": result.work.jacobians,
        "forces": [float(contact.force(result)[-1]) for contact in contacts],
        "weights": above.tolist(),
        "rest": float(contacts[0].force(static)[-1] / above[0] - 1),
        "still": max(
            float(abs(contact.force(result) / weight - 1).max())
            for contact, weight in zip(contacts, above, strict=True)
        ),
    }


def table(fine=LOAD_STEPS):
    """Processor time of a static load step of a table [s], and forces on its legs after `fine` load steps [N]."""
    legs = [(x, y, 0.0) for x in (-0.18, 0.18) for y in (-0.08, 0.08)]
    shape = occ.Box((-0.2, -0.1, 0.1), (0.2, 0.1, 0.12))
    for x, y, _ in legs:
        shape = shape + occ.Box((x - 0.01, y - 0.01, 0), (x + 0.01, y + 0.01, 0.1))
    fem = ep.fe_model(shape, ep.STEEL, maxh=0.02)
    feet = [
        ep.Partition.ball(fem, leg, 0.015, direction=(0, 0, -1), axes="xyz", name=f"leg {i}")
        for i, leg in enumerate(legs)
    ]
    body = ep.reduce(fem, feet[0] | feet[1] | feet[2] | feet[3], f_cut=4e3)
    found = {}
    for load_steps in (1, 1, fine):  # the first one compiles
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, body, frame="floating", gravity=[0, 0, -9.81])
        contacts = [
            ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch=f"leg {i}", friction=0.3, name=f"leg {i}")
            for i in range(len(legs))
        ]
        load = item.CreatePointMarker(mbs, (0.1, 0.05, 0.12))
        mbs.AddLoad(items.LoadForceVector(markerNumber=load, loadVector=[0, 0, -100]))
        mbs.Assemble()
        begin = time.process_time()
        result = ep.solve_static(mbs, load_steps=load_steps)
        forces = [float(contact.force(result)[-1]) for contact in contacts]
        found |= {"forces": forces, "rest": sum(forces) / (100 + 9.81 * body.total_mass) - 1}
        if load_steps == 1:
            found["step_s"] = time.process_time() - begin
    return found


def case():
    """All scenes at rest of the checkout that is imported."""
    body = block(EDGE, EDGE, EDGE)
    found = {name: at_rest(body, *scene) for name, scene in SCENES.items()}
    return found | {"table": table(), "fine_table": table(FINE)}


def beside(old, folder=None):
    """Scenes at rest of an earlier version, and of this one: a revision, or a folder that has it."""
    from validation.processes import checkout_of, in_a_process  # an earlier version has no such module

    with contextlib.nullcontext(folder) if folder is not None else checkout_of(old) as checkout:
        return in_a_process(__file__, "--case", checkout=checkout), in_a_process(__file__, "--case")


def blocks():
    """Blocks of some sizes, of steel with many rows and of aluminium with few, with coarse meshes."""
    kinds = (ep.STEEL, 0.35), (ep.Material(E=70e9, nu=0.33, rho=2700.0), 0.22)
    return [block(*size, kind, maxh=2.7e-3, f_cut=150e3, share=share) for size in SIZES for kind, share in kinds]


def random_stack(bodies, seed):
    """Relative error of the weights on the faces at rest, and how far tangential forces exceed the cone in motion.

    The first is NaN if the static solver finds no equilibrium. The third value is the least distance by which the
    centre of mass above a face lies within its rows [m]; negative if the stack must tip over.
    """
    rng = np.random.default_rng(seed)
    chosen = [bodies[i] for i in rng.integers(len(bodies), size=rng.integers(2, 6))]
    n, mu, gravity = len(chosen), rng.uniform(0.05, 1.0, len(chosen)), 10 ** rng.uniform(3, 4.5)
    heights = [np.ptp(body.points[:, 2]) for body in chosen]
    places = np.column_stack([rng.uniform(-8e-4, 8e-4, (n, 2)), np.cumsum([0, *heights[:-1]])])
    velocities = np.column_stack([rng.normal(size=(n, 2)) * 10 ** rng.uniform(-4, -1), np.zeros(n)])
    mbs, frame = exu.SystemContainer().AddSystem(), str(rng.choice(["floating", "inertial"]))
    angles = rng.uniform(-180, 180, n) if frame == "floating" else np.zeros(n)
    contacts = stand(mbs, chosen, places, angles, mu, gravity, velocities, frame)
    within = min(support(contact, chosen, places, angles, i) for i, contact in enumerate(contacts))
    settings = exu.SimulationSettings()
    settings.solution.file.write, settings.staticSolver.verboseMode = False, 0
    settings.staticSolver.newton.relativeTolerance, settings.staticSolver.adaptiveStep = 3e-9, False
    above, weights = np.cumsum([body.total_mass * gravity for body in chosen][::-1])[::-1], [np.nan]
    with contextlib.suppress(RunError):
        result = ep.solve_static(mbs, load_steps=1, update_initial=True, settings=settings)
        forces = [abs(contact.force_on_slave(result)[-1, 2]) for contact in contacts]
        weights = [force / weight - 1 for force, weight in zip(forces, above, strict=True)]
    method, step = ("implicit", STEP) if rng.random() < 0.7 else ("explicit", None)
    result = ep.solve_dynamic(mbs, end_time=DYNAMIC * STEP, method=method, step=step)
    if result.status != "finished":
        raise RuntimeError(f"the run ended as {result.status!r}")
    cone = 0.0
    for contact, friction in zip(contacts, mu, strict=True):
        normal = contact.row_forces(result).toarray()
        along = np.linalg.norm(contact.friction.row_forces(result), axis=2)
        cone = max(cone, (along - friction * normal).max() / max(normal.max(), 1e-300))
    return float(np.abs(weights).max()), float(cone), within


def support(contact, bodies, places, angles, i):
    """Distance by which the centre of mass above a face lies within its rows [m]; negative if beside them.

    Rows of face i that lie beside the upper patch of the block beneath bear nothing.
    """
    turns = [Rotation.from_euler("z", angle, degrees=True).as_matrix() for angle in angles]
    masses, gaps = np.array([body.total_mass for body in bodies[i:]]), contact.mechanics.gaps
    rows = (gaps.slave.surface.points[gaps.row_nodes] @ turns[i].T + places[i])[:, :2]
    if i:
        head = bodies[i - 1].points[bodies[i - 1].partition.patches[1].nodes]
        rows = rows[Delaunay((head @ turns[i - 1].T + places[i - 1])[:, :2]).find_simplex(rows) >= 0]
    if len(rows) < 3:
        return -np.inf
    edges = ConvexHull(rows).equations
    return float(-(edges[:, :2] @ (masses @ places[i:, :2] / masses.sum()) + edges[:, 2]).max())


def random_stacks(first, count):
    """Seeds that fail, with the reason, and the largest errors of the others."""
    bodies, failures, found = blocks(), {}, []
    begin = time.process_time()
    for seed in range(first, first + count):
        try:
            found.append(random_stack(bodies, seed))
            if np.isnan(found[-1][0]):
                print(seed, "has no rest, support", found[-1][2], file=sys.stderr, flush=True)
        except (PartitionError, RuntimeError) as error:
            failures[seed] = f"{type(error).__name__}: {error}"[:300]
            print(seed, failures[seed], file=sys.stderr, flush=True)
    weights, cone, within = np.transpose(found)
    return {
        "count": count,
        "failures": failures,
        "tip": int(np.count_nonzero(np.isnan(weights) & (within < 0))),
        "no_rest": int(np.count_nonzero(np.isnan(weights) & (within >= 0))),
        "weights": np.nanmax(weights),
        "cone": cone.max(),
        "stack_s": (time.process_time() - begin) / count,
    }


def apart(forces, reference):
    """Largest relative difference."""
    return float(np.abs(np.divide(forces, reference) - 1).max())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--old", default=OLD, help="the earlier version")
    parser.add_argument("--checkout", help="a folder that has the earlier version, instead")
    parser.add_argument("--stacks", type=int, default=STACKS)
    parser.add_argument("--first", type=int, default=0, help="seed of the first random stack")
    parser.add_argument(
        "--only", choices=["rest", "random"], help="run the scenes at rest, or the random stacks, alone"
    )
    parser.add_argument("--case", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.case:
        print(json.dumps(case()))
        return
    from validation.contact import scenes

    kept = json.loads(Path(__file__).with_suffix(".json").read_text()) if options.only else {}
    if options.only == "random":
        old, new = kept["old"], kept["new"]
    else:
        old, new = beside(options.old, options.checkout)
    stacks = kept["stacks"] if options.only == "rest" else random_stacks(options.first, options.stacks)
    found = {name: new[name]["step_ms"] / old[name]["step_ms"] for name in SCENES if name != "one"}
    found |= {
        "table_s": new["table"]["step_s"],
        "forces": max(apart(new[name]["forces"], new[name]["weights"]) for name in SCENES),
        "table_forces": apart(new["table"]["forces"], new["fine_table"]["forces"]),
        "rest": max(abs(scene["rest"]) for scene in new.values()),
        "still": max(new[name]["still"] for name in SCENES),
        "failures": len(stacks["failures"]),
        "no_rest": stacks["no_rest"],
        "weights": stacks["weights"],
        "cone": stacks["cone"],
    }
    shown = Table("", "before", "now", "iterations before", "now", title="flat faces with friction")
    for name in SCENES:
        counts = (str(each[name]["active_set_iterations"]) for each in (old, new))
        shown.add_row(name, *(f"{each[name]['step_ms']:.1f} ms" for each in (old, new)), *counts)
    shown.add_row("table, a load step", *(f"{each['table']['step_s']:.2f} s" for each in (old, new)), "", "")
    Console(width=120).print(shown, {key: float(f"{value:.3g}") for key, value in found.items()})
    failed = [f"{key} {found[key]:.3g}, limit {limit:.3g}" for key, limit in LIMITS.items() if found[key] > limit]
    scenes.finish(__file__, {"found": found, "limits": LIMITS, "old": old, "new": new, "stacks": stacks}, failed)


if __name__ == "__main__":
    main()
