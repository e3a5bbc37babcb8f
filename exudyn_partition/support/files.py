"""Files that are complete or not there: a new file gets its final name when all of it is on the disk."""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from ..errors import InputError, OutputError
from .checks import validate_path

_KEPT_NAME = 40  # characters of the final name in the temporary one, which must not be longer than a name may be


@contextlib.contextmanager
def replacing(path: str | Path, mode: str = "wb") -> Iterator[IO[Any]]:
    """Open a new file; it replaces the one at `path` when the block ends, and disappears if the block raises.

    Even if the process is killed, `path` holds the old file or the complete new one. A symbolic link stays, and the
    file that it leads to is replaced. The new file has the mode of the old one.

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
    temporary = target.with_name(f".{target.name[:_KEPT_NAME]}.{secrets.token_hex(8)}.tmp")
    try:
        # Not tempfile: only the owner may read its files, and that would not change with the final name.
        with temporary.open(mode.replace("w", "x"), encoding=None if "b" in mode else "utf-8") as file:
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
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


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
        with tempfile.TemporaryDirectory(prefix=".", suffix=".tmp", dir=folder) as name:
            yield Path(name)
            for file in sorted(Path(name).iterdir(), key=lambda file: (file.name == last, file.name)):
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
