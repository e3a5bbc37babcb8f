"""Who computes the runs of a study: this process, others, an executor, or a cluster of Dask.

A task is some runs, so that short ones do not wait for messages. A worker gets the function as bytes, and reads them
once: what the function holds, as reduced bodies, is then the same object in all runs of the worker.
"""

from __future__ import annotations

import contextlib
import functools
import math
import multiprocessing
import os
import pickle
import signal
import statistics
import sys
import threading
import time
import traceback
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from typing import Any

from ..algebra.blas_threads import one_blas_thread
from ..errors import InputError, MissingPackageError, PartitionWarning, RunError
from ..support.foreign import DaskClient
from ..support.interrupt import InterruptNow, interruptible
from ..support.machine import beside_other_work
from ..support.optional import require
from .points import Parameters, key_of, plain
from .run_records import Record

Run = tuple[int, Parameters]  # number of a run, and what its function is called with
Outcome = tuple[int, Record]
Function = Callable[..., Any]

_MOMENT = 0.25  # that a task of short runs lasts [s]: messages then cost little, and a kill loses little
_RECENT = 20  # runs whose median says how long the next ones last
_AHEAD = 2  # tasks a worker, so that none waits for the next one
_CUTS = 4  # parts a worker, of runs that were asked to stay together, if there are few such groups
_UNKNOWN = 32  # workers of an executor that does not tell them
DEAD = "WorkerDied"  # kind of a failure that ended the process


def computed(function: Function, parameters: Parameters) -> Record:
    """Record of a run: values, or the failure with its cause; warnings of the library; wall time."""
    begin, outcome = time.perf_counter(), {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PartitionWarning)
        try:
            values = plain("returned value", function(**parameters))
            outcome = {"values": values if isinstance(values, dict) else {"value": values}}
        except (Exception, SystemExit) as error:  # of any kind: it is the run's, not the study's
            outcome = _failure(type(error).__name__, str(error), "".join(traceback.format_exception(error)))
    told = [(w.category.__name__, str(w.message)) for w in caught if issubclass(w.category, PartitionWarning)]
    for w in caught:
        if not issubclass(w.category, PartitionWarning):
            warnings.warn_explicit(w.message, w.category, w.filename, w.lineno, source=w.source)
    return {"parameters": parameters, **outcome, "warnings": told, "wall_s": time.perf_counter() - begin}


def _failure(kind: str, message: str, trace: str = "") -> Record:
    return {"error": kind, "message": message, "traceback": trace}


def each(function: Function, runs: Sequence[Run]) -> Iterator[Outcome]:
    """Records of runs, one after the other; of a run that Ctrl-C has ended there is none."""
    for number, parameters in runs:
        with interruptible(InterruptNow) as interrupt:
            record = computed(function, parameters)
        if interrupt.asked:
            raise KeyboardInterrupt
        yield number, record


def run_task(function: bytes | Function, runs: list[Run]) -> list[Outcome]:
    """Records of the runs of a task, in a worker."""
    with beside_other_work(), one_blas_thread():
        return list(each(_read(function) if isinstance(function, bytes) else function, runs))


def is_ready(function: bytes | Function) -> bool:
    """Read the function in a worker, before its first run."""
    return callable(_read(function) if isinstance(function, bytes) else function)


@functools.lru_cache(maxsize=1)  # what its bodies keep for the next run must outlive a task
def _read(packed: bytes) -> Function:
    function: Function = pickle.loads(packed)
    return function


def _packed(function: Function, by_value: bool) -> bytes:
    """Bytes from which other processes read the function: its name, or all of it if they cannot import it."""
    interactive = not hasattr(sys.modules["__main__"], "__file__")  # a notebook or a prompt, which nobody can import
    ways: list[Callable[[Function], bytes]] = [pickle.dumps, _dump_whole]
    why: Exception | None = None
    for dump in reversed(ways) if by_value or interactive else ways:
        try:
            return dump(function)
        except (MissingPackageError, pickle.PicklingError, AttributeError, TypeError) as error:
            why = error
    raise InputError(
        f"function: expected one of a module, which processes can import ({why}). Move it to a file, make models "
        "within it, or pip install cloudpickle for lambdas and functions within others"
    ) from why


def _dump_whole(function: Function) -> bytes:
    """Bytes with the code of a function that has no name elsewhere."""
    packed: bytes = require("cloudpickle").dumps(function)
    return packed


class Workers:
    """An executor, and how tasks are told to it.

    Parameters
    ----------
    executor : concurrent.futures.Executor
    count : int
        Tasks that it computes at a time.
    function : bytes, callable, or what the executor makes one of them
    """

    def __init__(self, executor: Executor, count: int, function: Any) -> None:
        self.executor, self.count, self.function = executor, count, function

    def check(self) -> None:
        """Raise if a worker cannot read the function."""
        try:
            self.executor.submit(is_ready, self.function).result()
        except BrokenExecutor as error:
            raise RunError(
                "workers: a process ended before its first run. A script must start its study below "
                '`if __name__ == "__main__":`, for each process imports it'
            ) from error
        except (AttributeError, ImportError, pickle.UnpicklingError) as error:
            raise InputError(
                f"function: a worker cannot import it ({error}). Put it into a module that workers find, too"
            ) from error
        except (CancelledError, RuntimeError) as error:
            raise RunError(
                f"workers: the executor or cluster takes no task ({error or type(error).__name__}). Give one that is "
                "not closed"
            ) from error

    def submit(self, runs: list[Run]) -> Future[list[Outcome]]:
        """Begin a task."""
        return self.executor.submit(run_task, self.function, runs)

    def renew(self) -> None:
        """Go on after a worker's death has broken the executor."""
        raise RunError(
            "workers: the executor is broken, for one of its processes died. What was computed before is kept in "
            "file=. With workers= as a number, the runs of that process are run again alone"
        )

    def close(self) -> None:
        """End what was begun for the study."""


class Processes(Workers):
    """Processes of the study itself; after the death of one, new ones."""

    def __init__(self, count: int, function: bytes) -> None:
        super().__init__(self._new(count), count, function)

    @staticmethod
    def _new(count: int) -> Executor:
        # Forked processes would wait for ever for threads of NGSolve that only their parent has.
        return ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), initializer=_begin_process)

    def renew(self) -> None:
        """Start new processes."""
        self.close()
        self.executor = self._new(self.count)

    def close(self) -> None:
        """End the processes."""
        self.executor.shutdown(cancel_futures=True)


def _begin_process() -> None:
    """Let this process end with its parent, also with one that was killed: it would wait for tasks for ever.

    Ctrl-C, which the terminal sends to all processes, ends its run; between runs the parent ends it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class Cluster(Workers):
    """A cluster of Dask: its workers get the function once."""

    def __init__(self, client: DaskClient, function: Function) -> None:
        # Not by a hash: data of the same name, which an earlier study has just given back, would be deleted again.
        packed = client.scatter(_packed(function, by_value=True), broadcast=True, hash=False)
        self._client = client
        super().__init__(client.get_executor(pure=False), sum(client.nthreads().values()), packed)

    def submit(self, runs: list[Run]) -> Future[list[Outcome]]:
        """Begin a task."""
        self.count = max(1, sum(self._client.nthreads().values()))  # it may grow
        return super().submit(runs)


def is_client(workers: object) -> bool:
    """Whether it is a client of Dask; without an import of Dask, which a caller that has a client has done."""
    distributed = sys.modules.get("distributed")
    return distributed is not None and isinstance(workers, distributed.Client)


@contextlib.contextmanager
def workers_of(given: int | Executor | DaskClient, function: Function) -> Iterator[Workers]:
    """What computes tasks, until the block ends."""
    if isinstance(given, int):
        workers: Workers = Processes(given, _packed(function, by_value=False))
    elif is_client(given):
        workers = Cluster(given, function)
    else:
        told = getattr(given, "_max_workers", None) or getattr(given, "num_workers", None)
        by_name = function if isinstance(given, ThreadPoolExecutor) else _packed(function, by_value=False)
        workers = Workers(given, told if isinstance(told, int) else _UNKNOWN, by_name)
    try:
        workers.check()
        yield workers
    finally:
        workers.close()


def spread(workers: Workers, runs: list[Run], chunk: int | None, together: str | None) -> Iterator[list[Outcome]]:
    """Records of runs, as tasks end.

    A task whose worker dies gives none. Its runs are run again at the end, each one alone, so that it is known which
    of them ends a process. That one is recorded as a failure.
    """
    tasks = _Tasks(runs, chunk, together, workers.count)
    suspects: deque[Run] = deque()
    running: dict[Future[list[Outcome]], list[Run]] = {}
    broken = False

    def begin(task: list[Run]) -> None:
        nonlocal broken
        try:
            running[workers.submit(task)] = task
        except BrokenExecutor:  # by a worker that died since the last look
            broken = True
            suspects.extend(task)

    try:
        while tasks.left or suspects or running:
            while tasks.left and len(running) < _AHEAD * workers.count and not broken:
                begin(tasks.next(workers.count))
            if alone := bool(suspects) and not tasks.left and not running and not broken:
                begin([suspects.popleft()])
            ended, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in ended:
                task = running.pop(future)
                try:
                    records = future.result()
                except CancelledError as error:
                    raise RunError("workers: the executor or the cluster gave up its tasks; it was closed") from error
                except Exception as error:  # a dead worker, in the way that its executor tells it
                    broken = broken or isinstance(error, BrokenExecutor)
                    if alone:
                        yield [(number, _died(parameters, error)) for number, parameters in task]
                    else:
                        suspects.extend(task)
                    continue
                tasks.learn(records)
                yield records
            if broken and not running:
                workers.renew()
                broken = False
    finally:
        for future in running:
            future.cancel()


def _died(parameters: Parameters, error: Exception) -> Record:
    """Record of a run that ended its worker."""
    message = (
        "its worker gave no answer: it was killed, as the system does where memory is short, or compiled code crashed "
        f"({type(error).__name__})"
    )
    return {"parameters": parameters, **_failure(DEAD, message), "warnings": [], "wall_s": math.nan}


class _Tasks:
    """Runs that wait, and how many of them are a task.

    Parameters
    ----------
    runs : list of Run
    chunk : int or None
        Runs a task; by default as many as last a moment, by the median of those before.
    together : str or None
        Parameter whose equal values stay in one task, cut where they are few.
    workers : int
    """

    def __init__(self, runs: list[Run], chunk: int | None, together: str | None, workers: int) -> None:
        self._runs, self._chunk = deque(runs), chunk
        self._groups = None if together is None else deque(_grouped(runs, together, workers))
        self._seconds: deque[float] = deque(maxlen=_RECENT)

    @property
    def left(self) -> int:
        """Number of runs, or of groups, that no task has yet."""
        return len(self._runs if self._groups is None else self._groups)

    def next(self, workers: int) -> list[Run]:
        """Runs of the next task."""
        if self._groups is not None:
            return self._groups.popleft()
        return [self._runs.popleft() for _ in range(min(self.left, self._chunk or self._moment(workers)))]

    def learn(self, records: list[Outcome]) -> None:
        """Take the times of runs."""
        self._seconds.extend(record["wall_s"] for _, record in records)

    def _moment(self, workers: int) -> int:
        """Number of runs that last a moment; fewer towards the end, so that all workers end together."""
        if not self._seconds:
            return 1
        fitting = int(_MOMENT / max(statistics.median(self._seconds), 1e-9))
        return max(1, min(fitting, math.ceil(self.left / (_AHEAD * workers))))


def _grouped(runs: list[Run], name: str, workers: int) -> Iterator[list[Run]]:
    """Runs of equal values of a parameter; of parts of them, if there are fewer values than workers."""
    groups: dict[str, list[Run]] = {}
    for run in runs:
        groups.setdefault(key_of({name: run[1].get(name)}), []).append(run)
    cuts = 1 if len(groups) >= workers else _CUTS * workers
    for group in groups.values():
        size = math.ceil(len(group) / cuts)
        yield from (group[i : i + size] for i in range(0, len(group), size))
