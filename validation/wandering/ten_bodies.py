"""Ten parts of CAD tumble in a box, and nothing is selected: contact is wherever their skins meet.

Six kinds of parts of aluminium fall into a rigid box and hit each other, its floor and its walls, with friction. All
pairs have a contact from the start; those far apart sleep, see `exudyn_contacts.broad_phase`. Momentum is compared with
the impulses of floor, walls and weight, each body by itself with those of its contacts. Energy is that of motion,
strain, contacts and weight, and what friction takes. Costs: the processor time of a step with the first n bodies, with
and without the broad phase, on the first milliseconds; and with 100 bodies.

    python -m validation.wandering.ten_bodies [--quick]
"""

import argparse
import json
import time
import warnings
from pathlib import Path

import netgen.occ as occ
import numpy as np
from rich.console import Console
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.exudyn_contacts.broad_phase import BroadPhase
from validation.contact import scenes
from validation.tables import write_between

PAGE = Path(__file__).parents[2] / "examples" / "site" / "wandering-contact.md"
F_CUT, MU, GRAVITY = 40e3, 0.3, np.array([0.0, 0.0, -9.81])
PITCH, END, STEP = 17e-3, 20e-3, 0.8e-6  # between bodies at the start [m]; [s]
COSTS = {3: 300, 10: 300, 30: 100, 100: 40}  # bodies, and steps that are timed
WITHIN = {100: 10e-3}  # how near bodies must be at the start for a contact [m]; by default any distance
LIMITS = {"momentum": 1e-4, "energy": 2e-2, "asleep": 0.5}  # relative; times the step without the broad phase


def shapes():
    """Solids within balls of 8 mm radius about the origin [m]."""
    mm, at = 1e-3, occ.Pnt
    plate = occ.Box(at(-6 * mm, -4 * mm, -2 * mm), at(6 * mm, 4 * mm, 2 * mm))
    ring = occ.Cylinder(at(0, 0, -2 * mm), occ.Z, r=6 * mm, h=4 * mm) - occ.Cylinder(
        at(0, 0, -2 * mm), occ.Z, r=3 * mm, h=4 * mm
    )
    angle = occ.Box(at(-5 * mm, -4 * mm, -5 * mm), at(5 * mm, 4 * mm, -2 * mm)) + occ.Box(
        at(-5 * mm, -4 * mm, -5 * mm), at(-2 * mm, 4 * mm, 5 * mm)
    )
    return {
        "block": occ.Box(at(-5 * mm, -4 * mm, -3 * mm), at(5 * mm, 4 * mm, 3 * mm)),
        "ball": occ.Sphere(at(0, 0, 0), 5 * mm),
        "pin": occ.Cylinder(at(0, 0, -5 * mm), occ.Z, r=3.5 * mm, h=10 * mm),
        "plate": plate,
        "ring": ring,
        "angle": angle,
    }


def parts():
    """The reduced bodies, with their skins."""
    found = []
    for shape in shapes().values():
        fem = ep.fe_model(shape, ep.ALUMINIUM, maxh=2.5e-3)
        found.append(ep.reduce(fem, skin=True, f_cut=F_CUT))
    return found


def scene(bodies, n):
    """A box with n bodies that fly about; the model, the bodies and the contacts, and the time to make these [s]."""
    import exudyn as exu

    mbs, side, rng = exu.SystemContainer().AddSystem(), max(2, round(n ** (1 / 3))), np.random.default_rng(3)
    items = []
    for i in range(n):
        place = np.array([i % side, i // side % side, i // side**2]) * PITCH + PITCH / 2 + [0.0, 0.0, 1e-3]
        speed = rng.uniform(-1.0, 1.0, 3) - [0.0, 0.0, 1.0]
        items.append(
            ep.CreatePartitionBody(
                mbs,
                bodies[i % len(bodies)],
                name=f"part {i}",
                frame="floating",
                referencePosition=place,
                referenceRotationMatrix=Rotation.random(random_state=i).as_matrix(),
                initialVelocity=speed,
                initialAngularVelocity=rng.uniform(-100.0, 100.0, 3),
                gravity=[*GRAVITY],
            )
        )
    length = side * PITCH
    walls = [ep.RigidPlane()] + [
        ep.RigidPlane(point, normal)
        for point, normal in (((0, 0, 0), (1, 0, 0)), ((0, 0, 0), (0, 1, 0)), ((length, 0, 0), (-1, 0, 0)),
                              ((0, length, 0), (0, -1, 0)))
    ]  # fmt: skip
    begin = time.process_time()
    contacts = ep.CreatePartitionContact(mbs, [*items, *walls], friction=MU, within=WITHIN.get(n))
    spent = time.process_time() - begin
    mbs.Assemble()
    return mbs, items, contacts, spent


def run(mbs, end):
    """Result of a run, and the processor time of a step [s]."""
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ep.errors.PartitionWarning)  # edges cross, and skins are coarse: they say so
        result = ep.solve_dynamic(mbs, end_time=end, step=STEP, method="explicit")
    return result, (time.process_time() - begin) / (len(result.t) - 1)


def balances(result, items, contacts):
    """Largest relative errors of the momentum of each body, and of the energy of all."""
    t, momentum, largest = result.t, [], 0.0
    steps = np.diff(t)[:, None]
    for item in items:
        force = np.zeros((len(t), 3))
        for contact in contacts:
            sign = (contact.slave == item) * 1.0 - (contact.master == item)
            if sign:
                force += sign * contact.force_on_slave(result)  # with friction
        impulse = np.sum((force[1:] + force[:-1]) / 2 * steps, axis=0) + item.body.total_mass * GRAVITY * t[-1]
        p = item.momentum(result)
        momentum.append(np.linalg.norm(p[-1] - p[0] - impulse))
        largest = max(largest, float(np.linalg.norm(p, axis=1).max()))
    weight = sum(np.concatenate([[0.0], np.cumsum((p[1:] + p[:-1]) @ GRAVITY / 2 * steps[:, 0])])
                 for p in (item.momentum(result) for item in items))  # fmt: skip
    energy = sum(item.energy(result) for item in items) - weight
    energy = energy + sum(c.energy(result) + c.dissipated_energy(result) for c in contacts)
    return float(max(momentum) / largest), float(abs(energy - energy[0]).max() / energy[0])


def cost(bodies, n, steps, *, awake):
    """Processor times of a step with n bodies and of making the contacts, and numbers of contacts and of awake ones."""
    counts, look = [], BroadPhase.look

    def counted(phase, q):
        found = phase.awake if awake else look(phase, q)
        counts.append(len(found))
        return found

    mbs, _, contacts, made = scene(bodies, n)
    BroadPhase.look = counted
    try:
        run(mbs, 20 * STEP)  # what is compiled and kept
        once, twice = (n * run(mbs, n * STEP)[1] for n in (steps, 2 * steps))  # reviews take as long after both
    finally:
        BroadPhase.look = look
    return {"bodies": n, "contacts": len(contacts), "awake": float(np.mean(counts)), "make_s": made,
            "step_ms": 1e3 * (twice - once) / steps}  # fmt: skip


def write_table(found):
    """Write the table on the site's page of contact that wanders."""
    lines = [
        "| bodies | contacts | awake, mean | contacts made in | a step on-line |",
        "|---|---|---|---|---|",
    ]
    for row in found["costs"]:
        near = WITHIN.get(row["bodies"])
        what = f"{row['bodies']}" + (", none may sleep" if row["all_awake"] else "")
        what += f", pairs within {1e3 * near:g} mm" if near else ""
        lines.append(
            f"| {what} | {row['contacts']} | {row['awake']:.3g} | {row['make_s']:.2g} s | {row['step_ms']:.2g} ms |"
        )
    lines += [
        "",
        f"These are first steps, in which few bodies touch. In {1e3 * found['end_s']:.3g} ms the ten bodies have "
        f"{found['impacts']} impacts, and a step takes {found['step_ms']:.2g} ms in the mean, reviews included.",
        f"Momentum errs by {found['found']['momentum']:.1g}, energy by {found['found']['energy']:.2g}.",
    ]
    write_between(PAGE, "wandering/ten_bodies.py", "\n".join(lines) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="2 ms, and up to ten bodies; nothing is stored")
    parser.add_argument("--table", action="store_true", help="write the table from the stored results alone")
    options = parser.parse_args()
    if options.table:
        write_table(json.loads(Path(__file__).with_suffix(".json").read_text()))
        return
    begin, bodies = time.perf_counter(), parts()
    costs = []
    for n, steps in COSTS.items():
        if n <= 10 or not options.quick:
            costs.append(cost(bodies, n, steps, awake=False) | {"all_awake": False})
            Console().print(costs[-1])
        if n == 10:
            costs.append(cost(bodies, n, steps // 4, awake=True) | {"all_awake": True})
            Console().print(costs[-1])
    mbs, items, contacts, _ = scene(bodies, 10)
    result, step = run(mbs, 2e-3 if options.quick else END)
    momentum, energy = balances(result, items, contacts)
    forces = np.array([contact.force(result) for contact in contacts])
    ten, all_awake = (row for row in costs if row["bodies"] == 10)
    found = {
        "momentum": momentum,
        "energy": energy,
        "asleep": ten["step_ms"] / all_awake["step_ms"],
    }
    more = {
        "costs": costs,
        "skin_nodes": [len(body.partition.patch_nodes) for body in bodies],
        "dofs": [body.n_dofs for body in bodies],
        "end_s": float(result.t[-1]),
        "status": result.status,
        "step_ms": 1e3 * step,
        "hit": int((forces.max(axis=1) > 0).sum()),
        "impacts": sum(len(contact.impacts(result)) for contact in contacts),
        "peak_force_N": float(forces.max()),
    }
    Console().print(found, {key: value for key, value in more.items() if key != "costs"})
    failed = [f"{key} {found[key]:.3g}" for key in LIMITS if not found[key] <= LIMITS[key]]
    if options.quick:
        Console().print("beyond the limits:", failed)
        raise SystemExit(1 if failed else 0)
    stored = {**more, "found": found, "limits": LIMITS, "time_s": time.perf_counter() - begin}
    write_table(stored)
    scenes.finish(__file__, stored, failed)


if __name__ == "__main__":
    main()
