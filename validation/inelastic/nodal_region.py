"""The paper's basis with an impact region that yields: the ball on the plate of `impact.py`, at 10 times first yield.

Reference: the full FE model of the same mesh, rows and zone, HHT in steps of a tenth of a microsecond. The mesh has one
element in the radius of contact. Quantity: relative L2 error of the force, relative error of the plastic work, energy
balance, and run times, off-line and on-line.
Varied: the radius of the impact region, in which all nodes are coordinates. In a region of all nodes the basis is the
full FE model with lumped mass. The contact-adapted basis is there for comparison.
Limits: 1 % for the contact-adapted basis and for the region of all nodes; energy balance 1e-3 at the end of each run.

    python -m validation.inelastic.nodal_region
"""

import time

import exudyn as exu
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.contact import scenes
from validation.inelastic import front, impact

RATIO, ELEMENTS = 10.0, 1.0  # speed by that at first yield; elements in the radius of the contact
REGIONS = {"as the patch": 1.0, "three times as wide": 3.0, "all nodes": 100.0}  # radius by that of the patch
END, SAMPLES, STEP = 60e-6, 0.25e-6, 0.1e-6  # [s]; with most of the rebound
LIMITS = {"contact-adapted": 0.01, "all nodes": 0.01, "balance": 1e-3}


def nodal_run(bodies, speed):
    """Items, contact and result with multipliers on nodes that have mass."""
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -speed], name="ball")
    plate = ep.CreatePartitionBody(mbs, bodies[1], name="plate")
    contact = ep.CreatePartitionContact(mbs, ball, plate, formulation="lagrange", rows="integrated")
    mbs.Assemble()
    return (ball, plate), contact, ep.solve_dynamic(mbs, end_time=END, sample_period=SAMPLES)


def measured(run, offline_s, reference):
    """Errors and times of one run."""
    items, contact, result = run
    energy = sum(item.energy(result) for item in (*items, contact)) + contact.plastic.work(result)
    return {
        **front.errors(result.history(contact), contact.plastic.work(result)[-1], reference),
        "balance": abs(energy[-1] / energy[0] - 1),
        "coordinates": sum(item.body.n_dofs for item in items),
        "offline_s": offline_s,
        "online_s": result.time_s,
        "steps": result.steps,
    }


def main():
    begin = time.perf_counter()
    models, speed, _ = impact.scene(RATIO, ELEMENTS)
    bodies = [ep.reduce(*model, f_cut=impact.F_CUT) for model in models]
    run = impact.reduced_run(bodies, speed, END)
    reference = front.full_fe(models, run[1], speed, STEP, END)
    runs = {"contact-adapted": measured(run, sum(body.reduce_s for body in bodies), reference)}
    for name, region in REGIONS.items():
        bodies = [
            ep.reduce(*model, basis="free", f_cut=impact.F_CUT)
            for model in impact.scene(RATIO, ELEMENTS, region=region)[0]
        ]
        runs[name] = measured(nodal_run(bodies, speed), sum(body.reduce_s for body in bodies), reference)
        print(name, runs[name], flush=True)
    table = Table("basis", *runs["all nodes"])
    for name, entry in runs.items():
        table.add_row(name, *(f"{value:.3g}" for value in entry.values()))
    Console(width=150).print(table)
    found = {name: front.worse(runs[name]) for name in ("contact-adapted", "all nodes")}
    found["balance"] = max(entry["balance"] for entry in runs.values())
    result = {
        "found": found,
        "limits": LIMITS,
        "runs": runs,
        "reference_s": reference.info["time_s"],
        "fe_dofs": sum(fem.n_dofs for fem, _ in models),
        "zone_nodes": len(models[1][1].patches[0].plastic.nodes),
        "time_s": time.perf_counter() - begin,
    }
    scenes.finish(__file__, result, [f"{name} {found[name]:.3g}" for name in LIMITS if found[name] > LIMITS[name]])


if __name__ == "__main__":
    main()
