"""Results that are kept from one run to the next, in files whose names depend on the inputs."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import platformdirs

from .._version import __version__
from ..errors import CacheWarning, InputError
from .archive import Format, digest
from .checks import validate_path
from .warn import warn

_LOG = logging.getLogger(__name__)

Made = TypeVar("Made")

VARIABLE = "EXUDYN_PARTITION_CACHE"  # environment variable that names the cache folder
_PACKAGE = Path(__file__).parents[1]


def cached(cache: bool | str | Path, inputs: object, file: Format, make: Callable[[], Made]) -> Made:
    """Return what `make` returned for the same inputs before, or call it and keep the result.

    A file has the digest of its inputs as name and within: one that was copied to another name is not taken.

    Two processes may compute the same result at once: each writes a complete file, and the later one stays. If a file
    cannot be read or written, there is a warning, and the result is computed.

    Parameters
    ----------
    cache : bool or path
        Whether to keep results, in `user_folder()`; or the folder to keep them in.
    inputs : dict, dataclass, array, ...
        Everything that the result depends on, except the code of this library.
    file : Format
    make : callable

    Warns
    -----
    CacheWarning
        If a file is damaged, is that of other inputs, or cannot be written.
    """
    if not isinstance(cache, bool | str | Path):
        raise InputError(f"cache: expected True, False or a folder, got {cache!r}")
    if cache is False:
        return make()
    folder = user_folder() if cache is True else validate_path("cache", cache)
    key = digest({"inputs": inputs, "format": file.version, "library": __version__, "code": code_digest()})
    try:
        path = folder / f"{key}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        kept = path.exists()
    except (OSError, RuntimeError) as error:
        warn(
            f"the cache cannot be used: {error}. Name a folder that can be written, by cache= or by {VARIABLE}",
            CacheWarning,
        )
        return make()
    if kept:
        try:
            result: Made = file.load(path, key)
            _LOG.info("%s: read from the cache, %s", file.name, path)
            return result
        except InputError as error:
            warn(f"{error}. It is computed anew", CacheWarning)
    result = make()
    try:
        file.save(path, result, key)
        _LOG.info("%s: kept in the cache, %s", file.name, path)
    except (OSError, InputError) as error:
        warn(
            f"the result is not kept: {error}. Name a folder that can be written, by cache= or by {VARIABLE}",
            CacheWarning,
        )
    return result


def user_folder() -> Path:
    """Folder of `cache=True`: that of EXUDYN_PARTITION_CACHE, or else one in the platform's folder for caches.

    Its files may be deleted at any time.
    """
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE])
    return platformdirs.user_cache_path("exudyn_partition", appauthor=False)


def code_digest(package: Path = _PACKAGE) -> str:
    """SHA-256 of the library's own source: between two releases results may change, while the version does not."""
    sha = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        sha.update(path.read_bytes())
    return sha.hexdigest()
