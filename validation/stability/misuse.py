"""Wrong inputs over the whole public interface and the command line: each ends in a named error or a warning.

Reference: every argument of every public function gets values that are wrong for it, and arguments are exchanged with
each other (`misuse_calls.py`). Scenes are set up wrongly, and command lines are wrong (`misuse_scenes.py`). The same
calls with right values alone show that nothing else is refused.
Quantity: how each call ends.
Limit: raw errors from inside, wrong values that are accepted silently, hangs and crashes: none, except those that
`KNOWN` explains. Right values that end in an error: none.

    python -m validation.stability.misuse [--only PART OF A NAME] [--out FILE] [--limit SECONDS]
"""

import argparse
import contextlib
import json
import os
import platform
import re
import sys
import time
import traceback
import warnings
from collections import Counter
from functools import cache
from pathlib import Path

import exudyn as exu
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.errors import PartitionError, PartitionWarning, YieldWarning
from validation.stability.misuse_calls import misuses, right_calls
from validation.stability.misuse_scenes import SCENES
from validation.stability.misuse_values import Scene
from validation.stability.worker import Worker

LIMIT = 60.0  # seconds a call
KINDS = ("named error", "warning", "raw", "silent", "hang", "crash")
GOOD, RIGHT = ("named error", "warning"), ("silent", "warning")  # ends of wrong calls, and of right ones
# What a dependency does in its own process and cannot be caught, by the case's name, with the reason.
KNOWN: dict[str, str] = {}
# A message leads to the fix: it says what was expected, or what to do.
_REMEDY = re.compile(
    r"expected|there is no|cannot|belongs to|only|is no |nearest|no effect|needs|at most|at least|must |is it |"
    r"\b(take|give|make|call|choose|check|move|enlarge|refine|lower|coarsen|restore|use|run|join|compute|put|add|set|"
    r"leave|name|ask|remove|pip install)\b",
    re.IGNORECASE,
)


def classify(misuse, scene):
    """How a wrong call ends: kind, what was said, seconds."""
    begin, said = time.perf_counter(), ""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PartitionWarning)
        warnings.simplefilter("ignore", YieldWarning)  # of right speeds too: it tells nothing of a wrong call
        try:
            misuse(scene)
            kind = "silent"
        except PartitionError as error:
            kind, said = "named error", f"{type(error).__name__}: {error}"
            if not _REMEDY.search(str(error)):
                kind, said = "raw", f"without a remedy: {said}"
        except BaseException:  # also SystemExit, which a library must not raise
            kind, said = "raw", traceback.format_exc(limit=-3)
    told = [str(w.message) for w in caught if isinstance(w.message, PartitionWarning)]
    if kind == "silent" and told:
        kind, said = "warning", told[0]
    return {"case": misuse.name, "kind": kind, "said": said, "time_s": time.perf_counter() - begin}


@cache
def _all():
    return {misuse.name: misuse for misuse in [*misuses(), *SCENES, *right_calls()]}


@cache
def _scene():
    exu.config.suppressWarnings = True
    scene = Scene()
    os.chdir(scene.folder)  # names that turn out to be right are written there
    return scene


def classify_named(name):
    """`classify` by the case's name, in another process, without what Exudyn and NGSolve print."""
    with open(os.devnull, "w") as silence:  # noqa: PTH123
        with contextlib.suppress(OSError):
            os.dup2(silence.fileno(), 1)
            os.dup2(silence.fileno(), 2)
        with contextlib.redirect_stdout(silence), contextlib.redirect_stderr(silence):
            return classify(_all()[name], _scene())


def tried(names, limit, report=lambda share: None):
    """Rows of all cases, each guarded against crash and hang."""
    rows, worker = [], Worker(limit, classify_named, _scene)
    for i, name in enumerate(names):
        report(i / len(names))
        row, end = worker(name)
        kind = "hang" if end.startswith("not done") else "crash"
        rows.append(row or {"case": name, "kind": kind, "said": end, "time_s": limit})
    worker.close()
    for row in rows:
        row["known"] = KNOWN.get(row["case"], "")
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="cases whose name holds this; the JSON is not written then")
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".json"), help="file of the results")
    parser.add_argument("--limit", type=float, default=LIMIT, help="seconds a call")
    options = parser.parse_args()
    console, begin = Console(width=170), time.perf_counter()
    with ep.progress("wrong inputs") as report:
        rows = tried([name for name in _all() if options.only in name], options.limit, report)
    names = {call.name for call in right_calls()}
    right, rows = [row for row in rows if row["case"] in names], [row for row in rows if row["case"] not in names]
    counts = Counter(row["kind"] for row in rows)
    beyond = [row for row in rows if row["kind"] not in GOOD and not row["known"]]
    beyond += [row for row in right if row["kind"] not in RIGHT]
    for row in beyond:
        console.print(f"{row['kind']}: {row['case']}: {row['said'].strip().splitlines()[-1:]}", markup=False)
    calls = f"{len(rows)} wrong inputs, {len(right)} right calls"
    table = Table(*KINDS, title=f"{calls}, {time.perf_counter() - begin:.0f} s")
    table.add_row(*(str(counts[kind]) for kind in KINDS))
    console.print(table)
    for row in rows:
        if row["known"]:
            console.print(f"{row['case']}: {row['kind']}, {row['known']}", markup=False)
    if not options.only:
        machine = {"cpus": os.cpu_count(), "platform": platform.platform(), "versions": ep.versions()}
        data = {
            "tried": len(rows),
            "right_calls": len(right),
            "counts": {kind: counts[kind] for kind in KINDS},
            "known": KNOWN,
            "functions": Counter(row["case"].partition("(")[0] for row in rows),
            "beyond_limits": [f"{row['kind']}: {row['case']}" for row in beyond],
            "slowest_s": max(row["time_s"] for row in rows),
            "machine": machine,
        }
        options.out.write_text(json.dumps(data, indent=1) + "\n")
    sys.exit(f"{len(beyond)} do not end as they must" if beyond else 0)


if __name__ == "__main__":
    main()
