"""Wrong inputs over the whole public interface and the command line: each ends in a named error or a warning.

Reference: every argument of every public function gets values that are wrong for it, and its first arguments are
exchanged with each other (table `misuse_calls.py`, values `misuse_values.py`). Scenes are set up wrongly, and command
lines are wrong (table `misuse_scenes.py`). All calls are made with the objects of `misuse_objects.py`. The same calls
with right values alone show that nothing else is refused.
Quantity: how each call ends.
Limit: raw errors from inside, wrong values that are accepted silently, hangs and crashes: none, except those that
`KNOWN` explains. Right values that end in an error: none.

    python -m validation.stability.misuse [--only PART OF A NAME] [--out FILE] [--limit SECONDS]
"""

import argparse
import contextlib
import inspect
import json
import os
import platform
import re
import sys
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass
from functools import cache, partial
from itertools import combinations
from pathlib import Path
from types import ModuleType
from typing import Any

import exudyn as exu
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.errors import PartitionError, PartitionWarning, YieldWarning
from validation.stability.misuse_calls import ARGUMENTS, CALLS, EXCHANGEABLE, NOT_EVERYWHERE, OBJECTS
from validation.stability.misuse_objects import Made, Scene
from validation.stability.misuse_scenes import SCENES
from validation.stability.misuse_values import Kind
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


@cache
def public():
    """Functions, methods with arguments, and classes that a user can call, by their names behind `ep.`."""
    found = {}
    for name in sorted(ep.__all__, key=lambda name: isinstance(getattr(ep, name), ModuleType)):  # its own name first
        thing = getattr(ep, name)
        members = vars(thing) if isinstance(thing, ModuleType) else {name: thing}
        for key, value in members.items():
            own = not isinstance(thing, ModuleType) or key in exported(thing)
            if not own or key.startswith("_") or not (inspect.isclass(value) or inspect.isfunction(value)):
                continue
            if inspect.isclass(value) and issubclass(value, BaseException):
                continue
            if value in found.values():
                continue
            full = f"{name}.{key}" if isinstance(thing, ModuleType) else key
            found[full] = value
            if inspect.isclass(value):
                found |= _methods(full, value)
    return {name: value for name, value in found.items() if _takes_something(value)}


def exported(module):
    """Names that a module offers: those it says, or all that are defined in it."""
    own = [key for key, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__]
    return getattr(module, "__all__", own)


def _methods(full, kind):
    found = {}
    for base in reversed([c for c in kind.__mro__ if c.__module__.startswith("exudyn_partition")]):
        for key in vars(base):
            if not key.startswith("_") and callable(getattr(kind, key)):
                found[f"{full}.{key}"] = getattr(kind, key)
    return found


def _takes_something(thing):
    return bool({*inspect.signature(thing).parameters} - {"self", "cls"})


@dataclass(frozen=True)
class Call:
    """A public function, the kinds of its arguments, and what makes the object that it is a method of."""

    function: Any
    arguments: dict[str, Kind]
    of: Made | None

    @property
    def right(self):
        """Right values of all arguments."""
        return {name: kind.right for name, kind in self.arguments.items()}

    def __call__(self, scene, values):
        """Make the call with values, by argument."""
        function = getattr(made(self.of, scene), self.function.__name__) if self.of else self.function
        found = function(**{name: made(value, scene) for name, value in values.items()})
        if hasattr(found, "__enter__"):
            with found:
                pass


def made(value, scene):
    """The value itself, or what is made of the scene."""
    return value.make(scene) if isinstance(value, Made) else value


def call(name, entry=None):
    """A public function with the kinds of its arguments, as the tables say, or another entry of `CALLS`."""
    function, entry = public()[name], CALLS[name] if entry is None else entry
    arguments = [*inspect.signature(function).parameters]
    if unknown := {*entry} - {*arguments}:
        raise LookupError(f"{name}: CALLS has values for {unknown}, expected some of {arguments}")
    of = (entry.get("self") or OBJECTS[name.rpartition(".")[0]]) if "self" in arguments else None
    return Call(function, {a: _kind(name, a, entry) for a in arguments if a not in ("self", "cls")}, of)


def _kind(name, argument, entry):
    said = entry.get(argument)
    if isinstance(said, Kind):
        return said
    if argument not in ARGUMENTS:
        raise LookupError(f"{name}: add a kind of values for {argument!r} to its entry in CALLS")
    return ARGUMENTS[argument](said) if argument in entry else ARGUMENTS[argument]


@dataclass(frozen=True)
class Case:
    """Something that is tried with a scene, by its name."""

    name: str
    run: Any


def wrong_calls():
    """Each argument of each function with each wrong value, and the first arguments given for each other."""
    found = []
    for name in CALLS:
        wrong, right = call(name), call(name).right
        for argument, kind in wrong.arguments.items():
            for said, value in kind.wrong.items():
                found.append(Case(f"{name}({argument}={said})", partial(wrong, values={**right, argument: value})))
        for one, other in combinations([*right][:3], 2):
            title = f"{name}({one} and {other} swapped)"
            if right[one] is not None and right[other] is not None and title not in EXCHANGEABLE:
                swapped = {**right, one: right[other], other: right[one]}
                found.append(Case(title, partial(wrong, values=swapped)))
    return found


def scenes():
    """Scenes that are set up wrongly, files that are damaged, and wrong command lines."""
    return [Case(name, run) for name, run in SCENES.items()]


def right_calls():
    """Each function called with its right values: what refuses these tells nothing of the wrong ones."""
    names = [name for name in CALLS if name not in NOT_EVERYWHERE]
    return [Case(f"{name}, right", partial(call(name), values=call(name).right)) for name in names]


def classify(case, scene):
    """How a wrong call ends: kind, what was said, seconds."""
    begin, said = time.perf_counter(), ""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PartitionWarning)
        warnings.simplefilter("ignore", YieldWarning)  # of right speeds too: it tells nothing of a wrong call
        try:
            case.run(scene)
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
    return {"case": case.name, "kind": kind, "said": said, "time_s": time.perf_counter() - begin}


@cache
def _all():
    return {case.name: case for case in [*wrong_calls(), *scenes(), *right_calls()]}


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
