"""Stiff and extreme cases, each with both integrators where this makes sense: right, or stopped by a named error.

Reference: for each case in `cases/`, from analytic answers, rigid bodies and conservation.
Quantity: energy, momentum, complementarity (forces and gaps are computed again from stored coordinates), and the
quantity of the reference.
Limit: in the table. All results are finite, all warnings are stated, and no answer is silently wrong.

    python -m validation.stability.stability [--quick] [--only PART OF A NAME] [--out FILE]
"""

import argparse
import json
import os
import platform
import sys
import time
import traceback
import warnings
from pathlib import Path

from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.errors import PartitionError, PartitionWarning, YieldWarning
from validation.stability import cases
from validation.stability.worker import Worker


def evaluate(case, method):
    """One line of the table: what was found, and whether it is what must hold."""
    begin, found, failure, raised = time.perf_counter(), {}, "", ""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PartitionWarning)
        warnings.simplefilter("ignore", YieldWarning)  # speeds and forces are extreme, and what is checked is elastic
        try:
            found = case.function(method) or {}
        except PartitionError as error:
            raised, failure = type(error).__name__, str(error)
        except Exception:
            raised, failure = "not a named error", traceback.format_exc(limit=-3)
    said = sorted({type(w.message).__name__ for w in caught if isinstance(w.message, PartitionWarning)})
    checks = {name: {"value": value, "limit": limit} for name, (value, limit) in found.items()}
    beyond = [name for name, (value, limit) in found.items() if not value <= limit]  # also if it is not a number
    if raised != case.raises:
        beyond.append(raised or f"no {case.raises}")
    if said != sorted(case.warns):
        beyond.append(f"warned {', '.join(said) or 'of nothing'}")
    if not found and not case.raises and not raised:
        beyond.append("nothing checked")
    return {
        "case": case.name, "method": method, "must": case.must, "passed": not beyond, "beyond": beyond,
        "checks": checks, "error": raised, "message": failure, "warnings": said,
        "time_s": time.perf_counter() - begin,
    }  # fmt: skip


def evaluate_named(name, method):
    """`evaluate` by the case's name, in another process."""
    return evaluate(next(c for c in cases.CASES if c.name == name and method in c.methods), method)


def lost(case, method, end):
    """Row of a case that crashed or hung."""
    return {"case": case.name, "method": method, "must": case.must, "passed": False, "beyond": [end], "checks": {},
            "error": "", "message": "", "warnings": [], "time_s": float("nan")}  # fmt: skip


def show(rows, console):
    table = Table("case", "integrator", "must hold", "found", "", title="stiff and extreme cases")
    for row in rows:
        worst = max(row["checks"].items(), key=lambda c: share(**c[1]), default=None)
        found = row["error"] or ", ".join(row["warnings"])
        if worst and not found:
            found = f"{worst[0]} {worst[1]['value']:.2g} (limit {worst[1]['limit']:.2g})"
        if not row["passed"]:
            found = "; ".join(row["beyond"])
        mark = "[green]holds" if row["passed"] else "[red]FAILS"
        table.add_row(row["case"], row["method"], row["must"], found, mark)
    console.print(table)


def share(value, limit):
    """Return how much of its limit a value takes."""
    return value / limit if limit else float(value > 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="cases whose name holds this; the JSON is not written then")
    parser.add_argument(
        "--quick", action="store_true", help="the fast cases, those of tests/validation/test_stability.py"
    )
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".json"), help="file of the results")
    parser.add_argument("--limit", type=float, default=300.0, help="seconds a case")
    options = parser.parse_args()
    wanted = [c for c in cases.CASES if options.only in c.name and (c.quick or not options.quick)]
    chosen = [(c, m) for c in wanted for m in c.methods]
    rows, console, worker = [], Console(width=170), Worker(options.limit, evaluate_named)
    with ep.progress("cases") as report:
        for i, (case, method) in enumerate(chosen):
            report(i / len(chosen))
            row, end = worker(case.name, method)
            rows.append(row or lost(case, method, end))
    worker.close()
    show(rows, console)
    failed = [f"{r['case']} ({r['method']}): {'; '.join(r['beyond'])}" for r in rows if not r["passed"]]
    for row in rows:
        if not row["passed"] and row["message"]:
            console.print(f"{row['case']} ({row['method']}): {row['message']}", markup=False)
    if not options.only:
        machine = {"cpus": os.cpu_count(), "platform": platform.platform(), "versions": ep.versions()}
        data = {"cases": len({c.name for c, _ in chosen}), "rows": rows, "beyond_limits": failed, "machine": machine}
        options.out.write_text(json.dumps(data, indent=1) + "\n")
    console.print(f"{len(rows) - len(failed)} of {len(rows)} hold, of {len({c.name for c, _ in chosen})} cases")
    sys.exit(f"{len(failed)} do not hold: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
