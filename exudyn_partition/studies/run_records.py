"""What a study knows of its runs, and the file of JSON lines that keeps it: first what was computed, then a run a line.

A line is complete or not there: one that was cut off when a process was killed counts as none. Tasks of an array write
into files of their own beside the study's, and a study reads them all.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import json
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import IO, Any

from .._version import __version__
from ..errors import InputError, OutputError
from ..support.archive import digest
from ..support.checks import validate_file, validate_path
from ..support.files import locked_by_others, writable
from ..support.foreign import JSON
from .points import key_of, plain

Record = dict[str, Any]  # parameters, and values or error; warnings; wall_s

_FORMAT = 1
_START = b'{"study": '  # of a file
_PART = re.compile(r"\.\d+of\d+$")  # end of the stem of a file of a task


def about_function(function: Callable[..., Any]) -> JSON:
    """What says that a file is of this function: its name, and what `functools.partial` has given it."""
    if isinstance(function, functools.partial):
        inner = about_function(function.func)
        return {"function": inner["function"], "fixed": inner["fixed"] | _given(function)}
    module = getattr(function, "__module__", "")
    if module == "__main__":  # the same function has this name where others import it
        module = Path(getattr(sys.modules[module], "__file__", module)).stem
    return {"function": f"{module}.{getattr(function, '__qualname__', type(function).__name__)}", "fixed": {}}


def _given(function: functools.partial[Any]) -> dict[str, JSON]:
    """Arguments that a partial function has, by their names."""
    try:
        bound = inspect.signature(function.func).bind_partial(*function.args, **function.keywords).arguments
    except (TypeError, ValueError):  # of a function that tells no signature, or does not take them
        bound = {**{str(i): value for i, value in enumerate(function.args)}, **function.keywords}
    return {name: _described(value) for name, value in bound.items()}


def _described(value: object) -> JSON:
    """A plain value as it is, a function by its name, all else by its digest."""
    try:
        return json.loads(json.dumps(plain("", value)))
    except InputError:
        pass
    if callable(value):
        return about_function(value)
    try:
        return digest(value)
    except TypeError:  # of a type that no file of the library holds
        return repr(value)


class RecordFile:
    """Records of a study in a file, and those of the tasks beside it.

    Parameters
    ----------
    path : Path
        Of the study.
    about : dict
        See `about_function`.
    task : (i, n) or None
        Write into the file of this task of an array, instead of the study's.
    """

    def __init__(self, path: Path, about: JSON, task: tuple[int, int] | None = None) -> None:
        self.path = path if task is None else path.with_name(f"{path.stem}.{task[0]}of{task[1]}{path.suffix}")
        self.head = {"study": _FORMAT, **about, "library": __version__}
        writable(self.path, "file")
        self._file = _opened(self.path)
        try:
            self.known = self._read(path)
        except BaseException:
            self._file.close()
            raise

    def _read(self, path: Path) -> dict[str, Record]:
        """Records of all files by the keys of their points; this one then ends with a whole line."""
        this_file = self._checked(self.path)
        others: dict[str, Record] = {}
        for part in [path, *parts_of(path)]:
            if part != self.path and part.exists():
                others = merged(others, self._checked(part))
        self._file.truncate(_whole(self.path)[1])
        if not self.path.stat().st_size:
            self.add([self.head])
        known = merged({}, this_file)
        records = merged(known, others.values())
        if self.path == path:  # what tasks have computed becomes part of the study
            self.add(
                record for key, record in records.items() if "values" in record and "values" not in known.get(key, {})
            )
        return records

    def _checked(self, path: Path) -> list[Record]:
        """Records of a file, if it is of this study."""
        lines = read(path)
        if not lines:
            return []
        head, *records = lines
        differ = [key for key in ("function", "fixed") if head[key] != self.head[key]]
        if differ == ["fixed"]:
            fixed = head["fixed"].keys() | self.head["fixed"].keys()
            differ = sorted(key for key in fixed if head["fixed"].get(key) != self.head["fixed"].get(key))
        if differ:
            raise InputError(f"file: {path} is of other {', '.join(differ)}. Take another file, or delete this one")
        return records

    def add(self, records: Iterable[Record]) -> None:
        """Write records to the end of the file; they are in it even if the process is killed then."""
        try:
            self._file.writelines(json.dumps(record) + "\n" for record in records)
            self._file.flush()
        except OSError as error:
            raise OutputError(
                f"file: {self.path} cannot be written: {error.strerror or error}. The runs before are in it; free the "
                "disk and go on"
            ) from error

    def close(self) -> None:
        """Let others write into it."""
        with contextlib.suppress(OSError):  # of a full disk, which `add` has told
            self._file.close()


def _opened(path: Path) -> IO[str]:
    """Open a file to write to its end, for this process alone."""
    try:
        file = path.open("a", encoding="utf-8")
    except OSError as error:
        raise OutputError(f"file: {path} cannot be written: {error.strerror or error}; choose another") from error
    if locked_by_others(file.fileno()):
        file.close()
        raise InputError(
            f"file: another process writes into {path}. Wait for it, or take another file; tasks of an array are told "
            "apart by task="
        )
    return file


def parts_of(path: Path) -> list[Path]:
    """Files that tasks of an array have written for the study of this path."""
    with contextlib.suppress(OSError):  # no folder, or none that can be read
        names = [file.name for file in path.parent.iterdir() if _PART.search(file.stem)]
        return [path.with_name(name) for name in sorted(names) if _PART.sub(path.suffix, Path(name).stem) == path.name]
    return []


def _whole(path: Path) -> tuple[str, int]:
    """Text of the whole lines of a file, and how many bytes they are."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"file: {path} cannot be read: {error.strerror or error}; take another") from error
    if data[: len(_START)] != _START[: len(data)]:
        raise InputError(f"file: {path} holds no study: its first line is not that of one. Take another file")
    end = data.rfind(b"\n") + 1
    return data[:end].decode(errors="replace"), end


def read(path: Path) -> list[Record]:
    """Lines of a file, the head first; none if there is nothing whole in it.

    Raises
    ------
    InputError
        If they are no lines of a study.
    """
    text, _ = _whole(path)
    try:
        records = [json.loads(line) for line in text.splitlines()]
        if records and (records[0]["study"] != _FORMAT or not {"function", "fixed"} <= records[0].keys()):
            raise ValueError("its first line is not that of a study of this version")
        if not all(isinstance(r["parameters"], dict) and ("values" in r) != ("error" in r) for r in records[1:]):
            raise ValueError("a line is no run")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"file: {path} holds no study, or is damaged ({error or type(error).__name__}). Take another file"
        ) from error
    return records


def read_all(path: str | Path) -> list[Record]:
    """Records of a study's file and of its tasks', one a point.

    Raises
    ------
    InputError
        If there is none, or they are of different studies.
    """
    path = validate_path("path", path)
    if not (parts := parts_of(path)):
        validate_file("path", path)
    heads: dict[Path, JSON] = {}
    known: dict[str, Record] = {}
    for file in [path, *parts] if path.exists() else parts:
        for head in (lines := read(file))[:1]:
            heads[file] = {key: head[key] for key in ("function", "fixed")}
        known = merged(known, lines[1:])
    if not heads:
        raise InputError(f"file: {path} holds no run yet; run the study first")
    first, *more = heads.values()
    if any(head != first for head in more):
        raise InputError(f"file: {', '.join(map(str, heads))} are of different studies")
    return [*known.values()]


def merged(known: dict[str, Record], records: Iterable[Record]) -> dict[str, Record]:
    """Records by the keys of their points, with further ones; a failure does not replace values."""
    result = dict(known)
    for record in records:
        key = key_of(record["parameters"])
        if "values" in record or "values" not in result.get(key, {}):
            result[key] = record
    return result
