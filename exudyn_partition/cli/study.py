"""Studies from the command line, as tasks of an array of a cluster's queue need them."""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import CallError
from ..studies.points import METHODS, points_of, sample_parameters
from ..studies.study import study as run_study


def study(options: argparse.Namespace) -> tuple[int, dict[str, object]]:
    """Run a study, or a part of it; the exit code is 1 if a run failed."""
    points = _points(options)
    runs = run_study(
        _function(options.function),
        points,
        file=options.out,
        workers=options.workers,
        chunk=options.chunk,
        together=options.together,
        task=options.task,
    )
    told: dict[str, object] = {
        "file": str(options.out),
        "runs": len(runs),
        "new": runs.info["new"],
        "failed": len(runs.failures),
    }
    if runs.failures:
        told["failures"] = [str(failure) for failure in runs.failures.values()]
    return int(bool(runs.failures)), told


def _function(text: str) -> Callable[..., Any]:
    """Function that "impact.py:impact" or "package.module:impact" names."""
    source, colon, name = text.rpartition(":")
    if not (source and colon and name):
        raise CallError(f"FUNCTION: expected a file or module and a function, such as impact.py:impact, got {text!r}")
    folder, module = Path(), source
    if source.endswith(".py"):
        path = Path(source)
        if not path.is_file():
            raise CallError(f"FUNCTION: there is no file {path} (working directory {Path.cwd()})")
        folder, module = path.parent, path.stem
    sys.path.insert(0, str(folder.resolve()))  # where processes look for it, too
    try:
        function = getattr(importlib.import_module(module), name, None)
    except Exception as error:  # of whatever the user's module does
        raise CallError(f"FUNCTION: {source} could not be imported: {type(error).__name__}: {error}") from error
    if not callable(function):
        raise CallError(f"FUNCTION: {source} has no function {name}")
    found: Callable[..., Any] = function
    return found


def _points(options: argparse.Namespace) -> list[dict[str, Any]]:
    """Points of the study: those of a file, or a grid, at each point of which there are the samples."""
    if options.points is not None:
        if options.grid or options.between:
            raise CallError("--points: expected none of --grid and --between beside it")
        try:
            given = json.loads(options.points.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise CallError(f"--points: {options.points} is no file of JSON that can be read: {error}") from error
        return points_of(given)[0]
    if not (options.grid or options.between):
        raise CallError("expected --grid, --between with --count, or --points")
    if bool(options.between) != (options.count is not None):
        raise CallError("--count: expected together with --between, which it is the number of points of")
    grid, _ = points_of(dict(options.grid))
    if not options.between:
        return grid
    samples = sample_parameters(dict(options.between), options.count, method=options.method, seed=options.seed)
    return [{**point, **sample} for point in grid for sample in samples]


def _axis(text: str) -> tuple[str, list[Any]]:
    """Parameter and its values, from NAME=V,V,..."""
    name, equal, values = text.strip().partition("=")
    if not (name and equal and values):
        raise argparse.ArgumentTypeError(f"expected NAME=VALUE,VALUE,..., got {text.strip()!r}")
    return name, [_value(value) for value in values.split(",")]


def _value(text: str) -> Any:
    """Number, truth value or None in JSON's writing; all else is text."""
    try:
        return json.loads(text)
    except ValueError:
        return text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    parser.add_argument("function", metavar="FUNCTION", help="impact.py:impact, or package.module:impact")
    parser.add_argument("-o", "--out", required=True, type=Path, metavar="FILE.jsonl", help="what is there is kept")
    parser.add_argument("--grid", action="append", type=_axis, default=[], metavar="NAME=V,V,...", help="values")
    parser.add_argument("--between", action="append", type=_axis, default=[], metavar="NAME=LOW,HIGH", help="a range")
    parser.add_argument("--count", type=int, help="number of points within the ranges")
    parser.add_argument("--method", choices=METHODS, default="sobol", help="how they spread (default: sobol)")
    parser.add_argument("--seed", type=int, default=0, help="of the points (default: 0)")
    parser.add_argument("--points", type=Path, metavar="FILE.json", help="a list of objects, or of each name a list")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes (default: 1)")
    parser.add_argument("--task", metavar="I/N", help="the I-th of N parts, into a file of its own")
    parser.add_argument("--chunk", type=int, help="runs that a process gets at a time")
    parser.add_argument("--together", metavar="NAME", help="runs with the same value go to one process")
