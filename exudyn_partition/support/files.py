"""Files that are complete or not there: a new file gets its final name when all of it is on the disk."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shutil
import stat
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO, Any

try:
    import fcntl
except ImportError:  # on Windows
    fcntl = None  # type: ignore[assignment]

from ..errors import InputError, OutputError
from .checks import validate_path

_KEPT_NAME = 40  # characters of the final name in the temporary one, which must not be longer than a name may be
_TEMPORARY = re.compile(r"\..{0,40}\.[0-9a-f]{16}\.tmp", re.DOTALL)  # names that `_locked` makes
_TRIES = 10  # to make a temporary file; another process may take a new one for left over


@contextlib.contextmanager
def replacing(path: str | Path, mode: str = "wb") -> Iterator[IO[Any]]:
    """Open a new file; it replaces the one at `path` when the block ends, and disappears if the block raises.

    Even if the process is killed, `path` holds the old file or the complete new one. A symbolic link stays, and the
    file that it leads to is replaced. The new file has the mode of the old one. Temporary files that killed processes
    have left in the folder are deleted.

    Parameters
    ----------
    path : str or Path
        Taken as it is, nothing is appended.
    mode : {"wb", "w"}
        Bytes, or text in UTF-8.

    Yields
    ------
    file object
        Its `name` is the path of the temporary file, beside the final one.

    Raises
    ------
    InputError
        If no file can stand at `path`, see `writable`.
    OutputError
        If the system cannot write: the disk is full, or the folder is protected. The old file is kept.

    Examples
    --------
    >>> with replacing("run.html", "w") as file:
    ...     file.write(page)
    """
    path = writable(path)
    target = Path(os.path.realpath(path))
    _delete_left_over(target.parent)
    try:
        with _new_file(target) as temporary:
            with temporary.open(mode, encoding=None if "b" in mode else "utf-8") as file:
                if target.exists():
                    temporary.chmod(stat.S_IMODE(target.stat().st_mode))
                yield file
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(target)
    except OSError as error:
        kept = "The file that was there is unchanged" if target.exists() else "No file was left there"
        raise OutputError(
            f"path: {path} cannot be written: {error.strerror or error}. {kept}. Free the disk or choose another folder"
        ) from error


@contextlib.contextmanager
def _new_file(target: Path) -> Iterator[Path]:
    """Yield an empty temporary file beside the target, locked; what is left of it is deleted when the block ends."""
    with _locked(target.parent, target.name, lambda path: path.touch(exist_ok=False)) as path:
        try:
            yield path
        finally:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)


@contextlib.contextmanager
def _new_folder(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder within a folder, locked; it is deleted when the block ends."""
    with _locked(folder, "", lambda path: path.mkdir(mode=0o700)) as path:
        try:
            yield path
        finally:
            shutil.rmtree(path, ignore_errors=True)


@contextlib.contextmanager
def _locked(folder: Path, name: str, make: Callable[[Path], None]) -> Iterator[Path]:
    """Yield what `make` makes at a new temporary path in a folder, locked until the block ends: so it is in use.

    Not made by tempfile: only the owner may read its files, and that would not change with the final name.
    """
    for _ in range(_TRIES):
        path = folder / f".{name[:_KEPT_NAME]}.{secrets.token_hex(8)}.tmp"
        make(path)
        with contextlib.ExitStack() as stack:
            if fcntl is not None:
                try:
                    lock(stack.enter_context(_opened(path)), fcntl.LOCK_EX)
                except FileNotFoundError:
                    continue
                if not path.exists():  # somebody took it for left over before it was locked
                    continue
            yield path
            return
    raise FileNotFoundError(2, "another process deletes its temporary files")


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[int]:
    """Yield a descriptor of a file or folder, not of what a link leads to, and wait for no pipe."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def lock(descriptor: int, kind: int) -> bool:
    """Lock an open file or folder until it is closed, or the process ends; whether that was possible."""
    try:
        fcntl.flock(descriptor, kind)
    except OSError:  # others have it, or the file system has no locks
        return False
    return True


def _delete_left_over(folder: Path) -> None:
    """Delete temporary files and folders in a folder that nobody has locked: their processes were killed."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for path in [Path(entry.path) for entry in entries if _TEMPORARY.fullmatch(entry.name)]:
            with contextlib.suppress(OSError):
                _delete_unlocked(path)


def _delete_unlocked(path: Path) -> None:
    if fcntl is None:  # on Windows, which deletes no file that somebody has open; one of a folder may not be open
        path.unlink()
        return
    with _opened(path) as descriptor:
        if lock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB):
            shutil.rmtree(path) if stat.S_ISDIR(os.fstat(descriptor).st_mode) else path.unlink()


def locked_by_others(descriptor: int) -> bool:
    """Lock an open file for this process alone until it is closed; whether another process has it."""
    if fcntl is None:  # on Windows
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # the file system has no locks
        return False
    return False


@contextlib.contextmanager
def filling(folder: str | Path, last: str) -> Iterator[Path]:
    """Yield a new folder. Its files are moved into `folder` when the block ends, or deleted if the block raises.

    Parameters
    ----------
    folder : str or Path
        Made if it is not there. Files of the same names are replaced; for links and modes see `replacing`.
    last : str
        The file that lists the others: it is moved after them.

    Yields
    ------
    Path
        Within `folder`.

    Raises
    ------
    InputError
        If `folder` is no path, or there is a file of that name.
    OutputError
        If the system cannot write; the files that were there are kept.
    """
    folder = validate_path("folder", folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _delete_left_over(folder)
        with _new_folder(folder) as new:
            yield new
            for file in sorted(new.iterdir(), key=lambda file: (file.name == last, file.name)):
                target = Path(os.path.realpath(folder / file.name))
                if target.exists():
                    file.chmod(stat.S_IMODE(target.stat().st_mode))
                file.replace(target)
    except (FileExistsError, NotADirectoryError) as error:
        raise InputError(f"folder: expected a folder or the name of a new one, {error.filename} is a file") from error
    except OSError as error:
        raise OutputError(
            f"folder: nothing can be written into {str(folder)[:100]}: {error.strerror or error}. Files that were "
            "there are unchanged. Free the disk or choose another folder"
        ) from error


def writable(path: str | Path, name: str = "path") -> Path:
    """Return `path` if a file can be written there, as far as one can tell without writing.

    Parameters
    ----------
    path : str or Path
    name : str
        Of the argument, for messages.

    Raises
    ------
    InputError
        If `path` is no path, its folder does not exist, or it leads to a folder, a device, a pipe or a file that is
        protected against writing.
    """
    if not isinstance(path, str | Path) or not str(path):
        raise InputError(f"{name}: expected the path of a file, got {path!r}")
    path = Path(path)
    try:
        target = Path(os.path.realpath(path))
        folder = target.parent.is_dir()
        kind = _kind(path)
    except (OSError, ValueError) as error:  # too long, NUL in it, links in a circle
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{name}: no file can have the name {str(path)[:100]!r}: {reason}; choose another") from error
    if not folder:
        raise InputError(f"{name}: there is no folder {target.parent} to write {target.name} into; make it first")
    if kind is not None and stat.S_ISDIR(kind):
        raise InputError(f"{name}: expected the name of a file, got the folder {path}")
    if kind is not None and not stat.S_ISREG(kind):
        raise InputError(f"{name}: expected the name of a file, got {path}, a device or a pipe")
    if kind is not None and not kind & (stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH):
        raise InputError(f"{name}: {path} is protected against writing; choose another name, or chmod u+w {path.name}")
    return path


def _kind(path: Path) -> int | None:
    """Mode of what a path leads to; None if there is nothing."""
    try:
        return path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return None


def distinct(names: Iterable[str]) -> list[str]:
    """Names for files, with a number where two differ in nothing, or in capitals alone."""
    found: list[str] = []
    taken: set[str] = set()
    for wanted in names:
        name, number = wanted, 1
        while name.casefold() in taken:
            number += 1
            name = f"{wanted}_{number}"
        taken.add(name.casefold())
        found.append(name)
    return found
