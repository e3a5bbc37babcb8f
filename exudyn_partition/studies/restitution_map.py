"""Restitution over speed, angle, place and friction: many impacts, in a loop, in processes or on a cluster."""

from __future__ import annotations

import functools
import itertools
import json
import math
import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from .. import errors
from ..errors import InputError, OutputError, PartitionError
from ..support.archive import digest
from ..support.arrays import Array, Vector
from ..support.checks import (
    validate_array,
    validate_callable,
    validate_integer,
    validate_path,
    validate_positive,
    validate_vector,
)
from ..support.files import replacing, writable
from ..support.progress import Progress, shown
from ..support.spelling import spelled
from ..support.warn import warn
from .free_impact import QUANTITIES, free_impact
from .impact_setup import Pair, Point, approach, default_duration, sideways, validate_pair
from .restitution_values import AXES, RestitutionMap

Record = dict[str, Any]

_PARTS = 4  # tasks a worker, at least: so that none waits long for the last one
_FORMAT = 1


@spelled
def restitution_map(
    bodies: Pair | Callable[[float], Pair],
    *,
    speed: float | Sequence[float] | Array,
    angle: float | Sequence[float] | Array = 0.0,
    friction: float | Sequence[float] | Array = 0.0,
    place: float | Sequence[float] | Array | None = None,
    along: Vector | None = None,
    duration: float | None = None,
    file: str | Path | None = None,
    workers: int | Executor = 1,
    progress: Progress | None = None,
) -> RestitutionMap:
    """Compute free impacts on a grid of speed, angle, friction and place, and what a rigid code has to know of them.

    The first body flies at the second one, which rests, or at a rigid surface, and does not spin. Both are free, in
    floating frames, without gravity. Each impact is watched until no vibration can close the contact again.

    Parameters
    ----------
    bodies : (ReducedBody, ReducedBody or rigid surface), or callable
        Placed as at the impact, with one contact patch each; with friction, patches of axes="xyz". A function is called
        with each `place` and returns them, such as a bar that is tilted by this angle. It must be one that processes
        can be told by its name, if `workers` are several.
    speed : float or sequence
        Of the first body against the second one [m/s].
    angle : float or sequence
        Of its velocity from the normal of the contact [rad], 0 up to below pi/2.
    friction : float or sequence
        Coefficient of Coulomb friction; 0 is none.
    place : float or sequence, optional
        What the function of bodies is called with. Default: 0.
    along : (3,) array, optional
        Direction of the motion along the surface. Default: the x axis, or y where x is nearly the normal.
    duration : float, optional
        Time to watch after the first touch [s]; if more contacts may come, up to eight times that. Default: 30
        crossings of a longitudinal wave through the larger body.
    file : path, optional
        Of JSON lines. Impacts are added as soon as they are known, and those that it holds are not computed again. It
        must be of the same bodies, or of a function of the same name.
    workers : int or concurrent.futures.Executor
        Number of processes; or an executor, as that of a Dask cluster, `Client.get_executor()`.
    progress : callable, optional
        Called with the share done, 0 to 1. Default: a bar on the terminal, if it takes long.

    Returns
    -------
    RestitutionMap

    Raises
    ------
    InputError
        If an argument is out of range, the bodies do not touch as they are placed, or `file` is of other bodies.
    OutputError
        If `file` cannot be written.
    PartitionError
        Of the impact that failed, with its point of the grid; `file` keeps what was computed.

    Warns
    -----
    PartitionWarning
        Once for each kind of warning that impacts gave, with how many did.
    """
    axes = _grid(speed, angle, friction, place)
    if progress is not None:
        validate_callable("progress", progress, "a function of the share done, 0 to 1")
    if callable(bodies):
        source: Pair | Callable[[float], Pair] = bodies
        about = _named(bodies)
    else:
        if place is not None:
            raise InputError("place: expected none beside given bodies; give a function of place that returns them")
        source = validate_pair("bodies", bodies)
        about = digest(source)
    given = None if along is None else validate_vector("along", along)
    if not callable(bodies):
        sideways(approach(source), given)  # type: ignore[arg-type]
    lasts = None if duration is None else validate_positive("duration", duration, "s")
    if not isinstance(workers, Executor):
        workers = validate_integer("workers", workers, 1)
    settings = {"bodies": about, "along": None if given is None else given.tolist(), "duration": lasts}
    kept = _File(file, settings)
    points = [Point(*values) for values in itertools.product(*axes.values())]
    known = {point: record for point, record in kept.records() if point in set(points)}
    # The largest friction comes first: a patch without rows for it is refused before any impact is run.
    missing = [point for point in points[::-1] if point not in known]
    with shown(progress, "restitution map") as report, _executor(workers) as (submit, count):
        for records in submit([(source, part, given, lasts) for part in _parts(missing, count)]):
            kept.add(records)
            known |= {Point(*(record[axis] for axis in AXES)): record for record in records}
            report(len(known) / len(points))
    _warn([record for record in known.values()])
    shape = tuple(len(values) for values in axes.values())
    values = {
        name: np.array([known[point][name] for point in points], dtype=float).reshape(shape) for name in QUANTITIES
    }
    return RestitutionMap(**axes, values=values, info=settings | {"new": len(missing)})


def _named(function: Callable[..., Any]) -> str:
    """Name of a function of bodies, with the arguments that `functools.partial` has given it."""
    if isinstance(function, functools.partial):
        given = [repr(x) for x in function.args] + [f"{name}={x!r}" for name, x in function.keywords.items()]
        return f"{_named(function.func)}({', '.join(given)})"
    return f"{getattr(function, '__module__', '')}.{getattr(function, '__qualname__', type(function).__name__)}"


def _grid(speed: Any, angle: Any, friction: Any, place: Any) -> dict[str, Array]:
    """Values of each axis, ascending, by its name."""
    axes = {"place": 0.0 if place is None else place, "speed": speed, "angle": angle, "friction": friction}
    found = {}
    for name, given in axes.items():
        values = validate_array(name, [given] if isinstance(given, int | float | np.number) else given, (None,))
        if not len(values):
            raise InputError(f"{name}: expected at least one number, got none")
        found[name] = np.unique(values)
        if len(found[name]) < len(values):
            raise InputError(f"{name}: expected numbers that differ, got {list(map(float, values))}")
    if found["speed"][0] <= 0:
        raise InputError(f"speed: expected speeds above zero [m/s], got {found['speed'][0]:g}")
    if found["angle"][0] < 0 or found["angle"][-1] >= math.pi / 2:
        worst = found["angle"][0] if found["angle"][0] < 0 else found["angle"][-1]
        raise InputError(
            f"angle: expected angles from the normal, 0 up to below pi/2 = 1.5708 rad, got {worst:g}. "
            "Degrees are turned into rad by np.radians()"
        )
    if found["friction"][0] < 0:
        raise InputError(f"friction: expected coefficients of zero or above, got {found['friction'][0]:g}")
    return found


def _parts(points: list[Point], workers: int) -> Iterator[list[Point]]:
    """Points of the tasks: of one place each, whose bodies are made once; of parts of it where places are few."""
    places = [[*group] for _, group in itertools.groupby(points, key=lambda point: point.place)]
    cuts = 1 if len(places) >= workers else _PARTS * workers
    for group in places:
        size = max(1, math.ceil(len(group) / cuts))
        yield from (group[i : i + size] for i in range(0, len(group), size))


def impacts_at(
    source: Pair | Callable[[float], Pair], points: list[Point], along: Array | None, duration: float | None
) -> list[Record]:
    """Impacts at points of one place; a function of plain values and bodies, which any process can call."""
    pair = validate_pair(f"bodies({points[0].place:g})", source(points[0].place)) if callable(source) else source
    lasts, found = default_duration(pair) if duration is None else duration, []
    for point in points:
        try:
            values, told = free_impact(pair, point, along, lasts)
        except PartitionError as error:
            raise type(error)(f"{error} (at {point})") from error
        found.append({**asdict(point), **values, "warnings": told})
    return found


@contextmanager
def _executor(workers: int | Executor) -> Iterator[tuple[Callable[[list[Any]], Iterable[list[Record]]], int]]:
    """What computes tasks, and how many at a time."""
    if workers == 1:
        yield lambda tasks: (impacts_at(*task) for task in tasks), 1
        return
    # Forked processes would wait for ever for threads of NGSolve that only their parent has.
    spawned = multiprocessing.get_context("spawn")
    own = ProcessPoolExecutor(workers, mp_context=spawned) if isinstance(workers, int) else None

    def submit(tasks: list[Any]) -> Iterator[list[Record]]:
        executor = own or workers
        futures = [executor.submit(impacts_at, *task) for task in tasks]  # type: ignore[union-attr]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            for future in futures:
                future.cancel()

    try:
        yield submit, workers if isinstance(workers, int) else 2
    finally:
        if own is not None:
            own.shutdown(cancel_futures=True)


class _File:
    """JSON lines: first the settings, then an impact a line."""

    def __init__(self, path: str | Path | None, settings: Record) -> None:
        self.path = None if path is None else validate_path("file", path)
        self.settings = json.loads(json.dumps({"restitution map": _FORMAT, **settings}))

    def records(self) -> Iterator[tuple[Point, Record]]:
        """Impacts that the file holds; one whose line was cut off is none, and the next one begins a new line."""
        if self.path is None:
            return
        writable(self.path, "file")
        text = self.path.read_text(encoding="utf-8", errors="replace") if self.path.exists() else ""
        lines = text.splitlines(keepends=True)
        if lines and not lines[-1].endswith("\n"):
            lines.pop()
        try:
            found = [json.loads(line) for line in lines]
            if not found:
                self._begin([self.settings])
                return
            if found[0].get("restitution map") != _FORMAT:
                raise ValueError("its first line is not that of a restitution map")
            points = [Point(*(float(record[axis]) for axis in AXES)) for record in found[1:]]
            if not all(QUANTITIES.keys() <= record.keys() for record in found[1:]):
                raise ValueError("a line has not all quantities")
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(
                f"file: {self.path} holds no impacts of a restitution map, or is damaged ({error}). Take another file"
            ) from error
        if found[0] != self.settings:
            differ = ", ".join(key for key in self.settings if found[0].get(key) != self.settings[key])
            raise InputError(f"file: {self.path} is of other {differ}. Take another file, or delete this one")
        if "".join(lines) != text:
            self._begin(found)
        yield from zip(points, found[1:], strict=True)

    def add(self, records: list[Record]) -> None:
        """Write impacts to the end of the file."""
        if self.path is None:
            return
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.writelines(json.dumps(record) + "\n" for record in records)
        except OSError as error:
            raise OutputError(
                f"file: {self.path} cannot be written: {error.strerror or error}. The impacts before are in it; free "
                "the disk and go on"
            ) from error

    def _begin(self, lines: list[Record]) -> None:
        """Write the file anew with these lines."""
        assert self.path is not None
        with replacing(self.path, "w") as file:
            file.writelines(json.dumps(line) + "\n" for line in lines)


def _warn(records: list[Record]) -> None:
    """Warn once of each kind, with how many impacts gave it and what the first one said."""
    counts = Counter(kind for record in records for kind in {kind for kind, _ in record["warnings"]})
    for kind, count in counts.items():
        text = next(text for record in records for name, text in record["warnings"] if name == kind)
        category = getattr(errors, kind, errors.PartitionWarning)
        warn(f"{count} of {len(records)} impacts warn, the first: {text}", category)
    left = sum(not record["over"] for record in records)
    if left:
        warn(
            f"duration: {left} of {len(records)} impacts may not be over: bodies vibrate so much, or part so slowly, "
            "that they may touch again. Give a longer one",
            errors.ModelLimitWarning,
        )
