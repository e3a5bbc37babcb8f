"""A ribbed housing drops somehow: the contact is its whole skin, whose flexibility is found on demand.

Off-line, the whole skin is compared with a patch of some 300 nodes on the same mesh: time, peak of memory, size of the
file, and the time until the flexibility of a loaded body answers. Each measurement runs in a process of its own.
On-line, the housing falls tilted on a plane with friction, and turns and bounces from corner to corner. On the coarser
mesh the same run with an array of the flexibility is the reference: forces, and time of a step. The bottom face alone,
which one would choose who knows where it lands, is the other. Impulses of the contact and of the weight are compared
with the change of momentum; energy is that of motion, strain, contact and weight, and what friction takes.

On a mesh with 10 000 nodes of the skin it falls slowly, and bounces three times, with adaptive steps: several corners
and edges hit the plane in each. The bottom alone is again the other.

    python -m validation.wandering.skin [--quick | --bounces]
"""

import argparse
import itertools
import json
import multiprocessing
import resource
import tempfile
import time
import warnings
from pathlib import Path

import netgen.occ as occ
import numpy as np
from rich.console import Console
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.reduction import free_body
from validation.contact import scenes
from validation.tables import write_between

PAGE = Path(__file__).parents[2] / "examples" / "site" / "wandering-contact.md"
MESHES = {"coarse": 5e-3, "fine": 3.2e-3}  # maxh [m]
PLASTIC, F_CUT = ep.Material(E=2.3e9, nu=0.37, rho=1050), 8e3
TILT, SPEED, MU, STEP, END = (2.0, 1.5, 0.0), 2.0, 0.3, 2e-6, 2.5e-3  # [degrees], [m/s], -, [s], [s]
BOUNCING, SLOW, LATER, APART = 3e-3, 0.3, 40e-3, 2e-3  # maxh [m], [m/s], [s], free flight between bounces [s]
GRAVITY = np.array([0.0, 0.0, -9.81])
LIMITS = {
    "force": 1e-6,  # of the largest force, against an array
    "momentum": 1e-6,
    "energy": 1e-2,
    "reduce": 2.0,  # times the processor time with 300 nodes
    "memory_GB": 2.0,
    "file_MB": 100.0,
    "again_s": 2.0,  # until the flexibility of a loaded body answers
    "step": 3.0,  # times the processor time with the bottom alone
    "bounces_missing": 0,  # of three
    "bounces_run": 3.0,  # processor time of the run, times that with the bottom alone
}


def housing(maxh):
    """FE model of an open box of 80 x 50 x 20 mm with walls of 2 mm and three ribs."""
    box = occ.Box((0, 0, 0), (0.08, 0.05, 0.02)) - occ.Box((0.002, 0.002, 0.002), (0.078, 0.048, 0.03))
    for x in (0.02, 0.04, 0.06):
        box = box + occ.Box((x - 0.0008, 0.002, 0.002), (x + 0.0008, 0.048, 0.012))
    return ep.fe_model(box, PLASTIC, maxh=maxh)


def partition(fem, what):
    """The whole skin, some 300 nodes around the middle of the bottom, or the bottom."""
    if what == "300 nodes":
        away = np.linalg.norm(fem.points[fem.facets[:, :3]].mean(axis=1) - [0.04, 0.025, 0.0], axis=1)
        return ep.Partition.surface(fem, np.argsort(away)[:125], axes="xyz")
    if what == "bottom":
        return ep.Partition.surface(fem, plane=((0, 0, 0), (0, 0, -1)), axes="xyz")
    return ep.Partition.skin(fem)


def model(body, speed=SPEED):
    """The housing above a plane; the model, the housing and the contact."""
    import exudyn as exu

    turn = Rotation.from_euler("xyz", TILT, degrees=True).as_matrix()
    low = (body.points @ turn.T)[:, 2].min()
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs, body, name="housing", referenceRotationMatrix=turn, frame="floating",
        initialVelocity=[0.3 * speed, 0.0, -speed], gravity=[*GRAVITY],
    )  # fmt: skip
    plane = ep.RigidPlane((0, 0, low - 2e-6), (0, 0, 1))
    contact = ep.CreatePartitionContact(mbs, item, plane, name="floor", friction=MU)
    mbs.Assemble()
    return mbs, item, contact


def run(body, end, speed=SPEED, **options):
    """Result of a drop, the housing, the contact, and the processor time of a step [s]."""
    mbs, item, contact = model(body, speed)
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ep.errors.PartitionWarning)  # a drop on edges rings, and says so
        result = ep.solve_dynamic(mbs, end_time=end, step=STEP, method="explicit", **options)
    return result, item, contact, (time.process_time() - begin) / (len(result.t) - 1)


def balances(body, result, item, contact):
    """Largest relative errors of momentum and of energy."""
    t, p = result.t, item.momentum(result)
    force = contact.friction.tangential_force(result) + contact.force(result)[:, None] * [0.0, 0.0, 1.0]
    impulse = np.sum((force[1:] + force[:-1]) / 2 * np.diff(t)[:, None], axis=0)
    weight = body.total_mass * GRAVITY * t[-1]
    momentum = np.linalg.norm(p[-1] - p[0] - impulse - weight) / np.linalg.norm(impulse)
    by_weight = np.concatenate([[0.0], np.cumsum((p[1:] + p[:-1]) @ GRAVITY / 2 * np.diff(t))])
    energy = item.energy(result) + contact.energy(result) + contact.dissipated_energy(result) - by_weight
    return float(momentum), float(abs(energy - energy[0]).max() / energy[0])


def bounces(impacts):
    """How many groups of impacts there are, between which the housing flies."""
    return 1 + sum(later.start - earlier.end > APART for earlier, later in itertools.pairwise(impacts))


def measure(maxh, what, dense, drops, queue):
    """Reduce and save the housing, load it and let it drop; tell what that took."""
    if dense:
        free_body.SMALL = 10**9  # the array that on demand is not made
    fem = housing(maxh)
    part = partition(fem, what)
    ep.reduce(fem, partition(fem, "300 nodes"), f_cut=F_CUT)  # compiled loops are loaded
    before, cpu = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    body = ep.reduce(fem, part, f_cut=F_CUT)
    found = {"what": what, "dense": dense, "maxh": maxh, "nodes": len(part.patch_nodes), "fe_dofs": fem.n_dofs,
             "dofs": body.n_dofs, "reduce_s": time.process_time() - cpu}  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "housing.npz"
        body.save(path)
        found |= {"file_MB": path.stat().st_size / 1e6}
        cpu = time.process_time()
        body = ep.load_body(path)
        _ = np.asarray(body.flexibility()[np.ix_(np.arange(3), np.arange(3))])
        found |= {"again_s": time.process_time() - cpu}
    if drops:
        run(body, 60 * STEP)  # what is kept and compiled
        options = {"end": LATER, "speed": SLOW, "adaptive": True} if drops == "bounces" else {"end": END}
        result, item, contact, step = run(body, **options)
        momentum, energy = balances(body, result, item, contact)
        impacts = contact.impacts(result)
        found |= {
            "step_ms": 1e3 * step,
            "steps": len(result.t) - 1,
            "run_s": step * (len(result.t) - 1),
            "momentum": momentum,
            "energy": energy,
            "force": contact.force(result),
            "closed": int(contact.closed_rows(result).max()),
            "impacts": len(impacts),
            "bounces": bounces(impacts),
            "impulse": float(sum(impact.impulse for impact in impacts)),
        }
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    queue.put({**found, "memory_GB": peak / 1e6, "before_GB": before / 1e6})


def measured(*job):
    """What `measure` tells, from a process of its own."""
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    process = context.Process(target=measure, args=(*job, queue))
    process.start()
    found = queue.get()
    process.join()
    Console().print({key: value for key, value in found.items() if key != "force"})
    return found


def compare(mesh, maxh):
    """All measurements on a mesh, by name, and the figures that have limits."""
    rows = {
        "300 nodes": measured(maxh, "300 nodes", False, None),
        "bottom": measured(maxh, "bottom", False, "drop"),
        "skin": measured(maxh, "skin", False, "drop"),
    }
    skin, found = rows["skin"], {}
    if mesh == "coarse":
        dense = rows["array"] = measured(maxh, "skin", True, "drop")
        off = abs(skin["force"] - dense["force"]).max() / abs(dense["force"]).max()
        found |= {"force": float(off), "step_of_array": skin["step_ms"] / dense["step_ms"]}
    found |= {key: skin[key] for key in ("momentum", "energy", "memory_GB", "file_MB", "again_s")}
    found |= {
        "reduce": skin["reduce_s"] / rows["300 nodes"]["reduce_s"],
        "step": skin["step_ms"] / rows["bottom"]["step_ms"],
    }
    return rows, found


def compare_bounces():
    """Both measurements of three bounces, by name, and the figures that have limits."""
    rows = {what: measured(BOUNCING, what, False, "bounces") for what in ("bottom", "skin")}
    skin = rows["skin"]
    found = {key: skin[key] for key in ("momentum", "energy", "memory_GB", "file_MB", "again_s")}
    found |= {"bounces_missing": max(3 - skin["bounces"], 0), "bounces_run": skin["run_s"] / rows["bottom"]["run_s"]}
    return {name: {k: v for k, v in row.items() if k != "force"} for name, row in rows.items()}, found


def worse(worst, found):
    """Larger values of two sets of figures."""
    return {key: max(found.get(key, 0.0), worst.get(key, 0.0)) for key in {**worst, **found}}


def write_table(meshes, bouncing):
    """Write the table on the site's page of contact that wanders."""
    lines = [
        "| mesh | patch | nodes | reduce | peak of memory | file | loaded in | a step on-line |",
        "|---|---|---|---|---|---|---|---|",
    ]
    names = {"300 nodes": "some 300 nodes", "bottom": "the bottom", "skin": "**the skin, on demand**",
             "array": "the skin, as an array"}  # fmt: skip
    for mesh, rows in meshes.items():
        for name, row in rows.items():
            step = f"{row['step_ms']:.2g} ms" if "step_ms" in row else "-"
            lines.append(
                f"| {mesh}, {row['fe_dofs']} dofs | {names[name]} | {row['nodes']} | {row['reduce_s']:.2g} s | "
                f"{row['memory_GB']:.2g} GB | {row['file_MB']:.3g} MB | {row['again_s']:.2g} s | {step} |"
            )
    skin, bottom = bouncing["skin"], bouncing["bottom"]
    lines += [
        "",
        f"On a mesh with {skin['nodes']} nodes of the skin, a slower drop with {skin['bounces']} bounces of "
        f"{skin['impacts']} impacts and adaptive steps takes {skin['run_s']:.2g} s; with the bottom alone it takes "
        f"{bottom['run_s']:.2g} s.",
        f"Momentum errs by {skin['momentum']:.1g}, energy by {skin['energy']:.2g}.",
    ]  # fmt: skip
    write_between(PAGE, "wandering/skin.py", "\n".join(lines) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the coarser mesh alone; nothing is stored")
    parser.add_argument("--bounces", action="store_true", help="the bounces alone; all else is as it was stored")
    parser.add_argument("--table", action="store_true", help="write the table from the stored results alone")
    options = parser.parse_args()
    if options.table:
        stored = json.loads(Path(__file__).with_suffix(".json").read_text())
        write_table(stored["meshes"], stored["bounces"])
        return
    begin, meshes, worst = time.perf_counter(), {}, {}
    if options.bounces:
        stored = json.loads(Path(__file__).with_suffix(".json").read_text())
        meshes, worst = stored["meshes"], stored["found"]
    for mesh, maxh in MESHES.items():
        if options.bounces or (options.quick and mesh != "coarse"):
            continue
        rows, found = compare(mesh, maxh)
        meshes[mesh] = {name: {k: v for k, v in row.items() if k != "force"} for name, row in rows.items()}
        Console().print(mesh, found)
        worst = worse(worst, found)
    if not options.quick:
        bouncing, found = compare_bounces()
        Console().print("bounces", found)
        worst = worse(worst, found)
    failed = [f"{key} {worst[key]:.3g}" for key in LIMITS if key in worst and not worst[key] <= LIMITS[key]]
    if options.quick:
        Console().print("beyond the limits:", failed)
        raise SystemExit(1 if failed else 0)
    write_table(meshes, bouncing)
    result = {
        "meshes": meshes,
        "bounces": bouncing,
        "found": worst,
        "limits": LIMITS,
        "time_s": time.perf_counter() - begin,
    }
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
