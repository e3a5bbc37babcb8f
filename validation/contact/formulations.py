"""Rod on plate by all formulations and kinds of rows: where they agree, and how much they differ.

Reference: the full FE model with the same mesh and the same kind of rows (HHT, 0.5 us), over the first 0.5 ms, which
contain the first two sub-impacts.
Quantity: relative L2 error of the contact force, impulse and peak relative to the reference's, reduced dofs and run
time. The difference of the two references is the effect of the kind of rows. No reference has a penalty, which
is compared with that of its kind of rows.
Limits: with the residual flexibility, impulse within 0.5 % and force within 3 % of the reference. With multipliers on
nodes, impulse within 10 %, because their bases lack the static answer of the modes that are cut
(../error_against_time/rod_on_plate.py).

    python -m validation.contact.formulations
"""

import json
import os
import platform
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import exudyn as exu
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from examples.models import rod_on_plate as example

RESULTS = Path(__file__).with_suffix(".json")
END_TIME, STEP, F_CUT = 0.5e-3, 0.5e-6, 40e3
NODES, INTEGRATED = "node-to-segment", "integrated"
LIMITS = {"compliance": (0.03, 0.005), "lagrange": (None, 0.10)}  # force, impulse; penalty is for comparison


@dataclass(frozen=True)
class Case:
    """Options of a run."""

    basis: str
    formulation: str
    rows: str = NODES
    method: str = "explicit"


CASES = [
    Case("contact-adapted", "compliance"),
    Case("contact-adapted", "compliance", method="implicit"),
    Case("contact-adapted", "compliance", INTEGRATED),
    Case("contact-adapted", "penalty"),
    Case("contact-adapted", "penalty", INTEGRATED),
    Case("craig-bampton", "lagrange"),
    Case("craig-bampton", "lagrange", INTEGRATED),
    Case("free", "lagrange"),
]


def reference(fems, partitions, rows):
    bodies = [
        ep.reference.FullBody(fem, partition, velocity=(0, 0, -v))
        for fem, partition, v in zip(fems, partitions, (example.SPEED, 0.0), strict=True)
    ]
    with ep.progress(f"full FE, {rows}") as report:
        return ep.reference.simulate(bodies, end_time=END_TIME, step=STEP, rows=rows, progress=report)


def run(case, bodies):
    """Force history of a case."""
    mbs = exu.SystemContainer().AddSystem()
    rod = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -example.SPEED])
    plate = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, rod, plate, formulation=case.formulation, rows=case.rows, passes="given")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=END_TIME, method=case.method, sample_period=0.5e-6)
    return result.history(contact)


def main():
    fems, partitions, _ = example.fe_models(quick=True)
    references = {rows: reference(fems, partitions, rows) for rows in (NODES, INTEGRATED)}
    reduced = {}
    entries = []
    for case in CASES:
        if case.basis not in reduced:
            reduced[case.basis] = [
                ep.reduce(fem, partition, basis=case.basis, f_cut=F_CUT)
                for fem, partition in zip(fems, partitions, strict=True)
            ]
        history, full = run(case, reduced[case.basis]), references[case.rows]
        entries.append(
            asdict(case)
            | {
                "dofs": history.info["dofs"],
                "rows_n": history.info["contact_nodes"],
                "force": ep.compare(history, full).error["force"],
                "impulse": history.impulse / full.impulse - 1,
                "peak": history.peak_force / full.peak_force - 1,
                "offline_s": sum(body.reduce_s for body in reduced[case.basis]),
                "online_s": history.info["time_s"],
            }
        )
    between = ep.compare(references[INTEGRATED], references[NODES]).error["force"]
    table = Table(*entries[0], title=f"rod on plate, {1e3 * END_TIME:g} ms; the references differ by {between:.2%}")
    for entry in entries:
        *words, dofs, rows_n, force, impulse, peak, offline_s, online_s = entry.values()
        errors = (f"{force:.2%}", f"{impulse:+.2%}", f"{peak:+.2%}")
        table.add_row(*words, str(dofs), str(rows_n), *errors, f"{offline_s:.1f}", f"{online_s:.3g}")
    Console(width=150).print(table)
    data = {
        "fe_dofs": sum(fem.n_dofs for fem in fems),
        "cases": entries,
        "between_references": between,
        "reference_s": {rows: full.info["time_s"] for rows, full in references.items()},
        "limits": LIMITS,
        "machine": {"cpus": os.cpu_count(), "platform": platform.platform(), "versions": ep.versions()},
    }
    RESULTS.write_text(json.dumps(data, indent=1) + "\n")
    failed = []
    for entry in entries:
        for key, limit in zip(("force", "impulse"), LIMITS.get(entry["formulation"], ()), strict=False):
            if limit is not None and abs(entry[key]) > limit:
                failed.append(f"{entry['basis']}, {entry['rows']}: {key} {entry[key]:.2%}")
    sys.exit(f"beyond the stated limits: {'; '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
