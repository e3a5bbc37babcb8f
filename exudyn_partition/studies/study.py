"""Studies of any function of plain values: in this process, in others, on a cluster, or as an array of tasks."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from pathlib import Path
from typing import Any, NoReturn

from .. import errors
from ..errors import InputError, PartitionError, RunError
from ..support.checks import validate_callable, validate_flag, validate_integer, validate_path, validate_text
from ..support.foreign import DaskClient
from ..support.progress import Progress, shown
from ..support.spelling import spelled
from ..support.warn import warn
from .points import key_of, points_of
from .run_records import Record, RecordFile, about_function
from .study_values import Failure, Study, of_records
from .workers import Outcome, Run, each, is_client, spread, workers_of


@spelled
def study(
    function: Callable[..., Any],
    parameters: Mapping[str, Any] | Sequence[Mapping[str, Any]],
    *,
    file: str | Path | None = None,
    workers: int | Executor | DaskClient = 1,
    chunk: int | None = None,
    together: str | None = None,
    task: str | tuple[int, int] | None = None,
    stop: bool = False,
    progress: Progress | None = None,
) -> Study:
    """Call a function at many points, and keep what it returns.

    Parameters
    ----------
    function : callable
        Called with the parameters by their names. It returns a number, or a dict of numbers, text and lists of these.
        Reduced bodies and all else that is the same in each run are given by `functools.partial`; each worker gets
        them once.
    parameters : dict, or list of dict
        A dict is a grid: of each parameter a list of values, with the last one changing first, or what is the same
        in all runs. A list has the points themselves, as from `sample_parameters`. All values are plain.
    file : path, optional
        Of JSON lines. Runs are added as they end, and those that it holds are not run again, also after the process
        was killed; failures are. It must be of the same function, by its name and by what `functools.partial` gave it.
    workers : int, concurrent.futures.Executor or distributed.Client
        Number of processes; or an executor of your own, or a client of Dask's.
    chunk : int, optional
        Runs a task of a worker. Default: as many as last a quarter of a second.
    together : str, optional
        A parameter: runs with the same value of it go to one worker after each other. So a function that keeps what
        it made for this value, as a mesh, makes it once.
    task : str or (int, int), optional
        "3/10" runs the third of ten parts, into a file of its own beside `file`. A study without `task` reads these
        files too, and runs what is missing.
    stop : bool
        Raise at the first failure, instead of going on.
    progress : callable, optional
        Called with the share done, 0 to 1. Default: a bar on the terminal, if it takes long.

    Returns
    -------
    Study
        Points and values in the order of `parameters`, whatever worker was first.

    Raises
    ------
    InputError
        If an argument is out of range, workers cannot import the function, or `file` is of another one, or in use.
    OutputError
        If `file` cannot be written.
    RunError
        If an executor broke or was closed; or with `stop`, if a run failed. An error of the library is raised as such.

    Warns
    -----
    FailedRunsWarning
        How many runs failed, and why the first one did.
    PartitionWarning
        Once for each kind of warning that runs gave, with how many did.

    See Also
    --------
    sample_parameters : Latin squares and Sobol points.
    restitution_map : A study of impacts.
    """
    validate_callable("function", function, "a function of the parameters")
    points, shape = points_of(parameters)
    part = None if task is None else _task(task)
    if part is not None and file is None:
        raise InputError("file: expected a path beside task=, for tasks find each other's runs by it")
    if not (isinstance(workers, Executor) or is_client(workers)):
        workers = validate_integer("workers", workers, 1)
    if chunk is not None:
        chunk = validate_integer("chunk", chunk, 1)
    if together is not None and not all(validate_text("together", together) in point for point in points):
        raise InputError(f"together: expected a name that each point has, got {together!r}")
    if progress is not None:
        validate_callable("progress", progress, "a function of the share done, 0 to 1")
    stop = validate_flag("stop", stop)
    if part is not None:
        points = points[part[0] - 1 :: part[1]]
        shape = (len(points),)
    wanted = {key_of(point): point for point in points}
    kept = None if file is None else RecordFile(validate_path("file", file), about_function(function), part)
    try:
        held = {} if kept is None else kept.known
        known = {key: held[key] for key in wanted if "values" in held.get(key, {})}
        missing = [key for key in wanted if key not in known]
        runs = [(number, wanted[key]) for number, key in enumerate(missing)]
        with shown(progress, "study") as report, closing(_new(function, runs, workers, chunk, together)) as new:
            for records in new:
                if kept is not None:
                    kept.add(record for _, record in records)
                known |= {missing[number]: record for number, record in records}
                report(len(known) / len(wanted))
                if stop and (failed := [record for _, record in records if "error" in record]):
                    _raise(Failure.of(failed[0]))
    finally:
        if kept is not None:
            kept.close()
    _tell([known[key] for key in wanted])
    return of_records([{**known[key_of(p)], "parameters": p} for p in points], shape, {"new": len(missing)})


def _new(
    function: Callable[..., Any],
    runs: list[Run],
    workers: int | Executor | DaskClient,
    chunk: int | None,
    together: str | None,
) -> Generator[list[Outcome]]:
    """Records of runs as they end."""
    if workers == 1 or not runs:
        yield from ([outcome] for outcome in each(function, runs))
        return
    with workers_of(workers, function) as ready:
        yield from spread(ready, runs, chunk, together)


def _task(value: str | tuple[int, int]) -> tuple[int, int]:
    """Number of a task of an array, and how many there are."""
    match = re.fullmatch(r"\s*(\d+)\s*/\s*(\d+)\s*", value) if isinstance(value, str) else None
    pair = tuple(map(int, match.groups())) if match else value
    if not isinstance(pair, tuple) or len(pair) != 2:
        raise InputError(f'task: expected "i/n", such as "3/10" for the third of ten, got {value!r}')
    n = validate_integer("task", pair[1], 1)
    return validate_integer("task", pair[0], 1, n), n


def _raise(failure: Failure) -> NoReturn:
    """Raise the error of a run that failed: of its own class if that is one of the library."""
    kind = getattr(errors, failure.error, None)
    if isinstance(kind, type) and issubclass(kind, PartitionError):
        raise kind(str(failure).removeprefix(f"{failure.error}: "))
    raise RunError(str(failure))


def _tell(records: list[Record]) -> None:
    """Warn of failures, and once of each kind of warning, with how many runs gave it and what the first one said."""
    failed = [record for record in records if "error" in record]
    if failed:
        warn(
            f"{len(failed)} of {len(records)} runs failed, the first: {Failure.of(failed[0])}. Study.failures has all; "
            "a study with the same file runs these again",
            errors.FailedRunsWarning,
        )
    counts = Counter(kind for record in records for kind in {kind for kind, _ in record["warnings"]})
    for kind, count in counts.items():
        text = next(text for record in records for name, text in record["warnings"] if name == kind)
        several = f"{count} of {len(records)} runs warn, the first: " if len(records) > 1 else ""
        warn(several + text, getattr(errors, kind, errors.PartitionWarning))
