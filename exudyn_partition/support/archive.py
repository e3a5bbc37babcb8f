"""Values of the library as npz files: dataclasses of arrays, sparse matrices, numbers and text, without pickle.

A file holds each array as a member of its own. The member `about` is JSON: it names format, version and units, and
describes the value field by field. So NumPy is enough to look into a file.

A format may be packed. Then larger arrays are stored as planes and deflated: the first bytes of all numbers, then the
second ones, and so on, (itemsize, size) of uint8, with the numbers in Fortran's order. Signs, exponents and the high
bytes of whole numbers compress so, the ends of mantissas never do.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import math
import stat
import struct
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._version import __version__
from ..errors import InputError
from .arrays import Array
from .checks import validate_path
from .files import replacing
from .foreign import JSON

_CSR = {"csr_matrix": sp.csr_matrix, "csr_array": sp.csr_array}
_CSR_PARTS = ("data", "indices", "indptr")
_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
_ZIP_START = b"PK\x03\x04"
PACK_FROM = 4096  # bytes of an array: below, planes save nothing worth it
_PROJECTIONS = 4  # of an array in a sketch
_LEVEL = 1  # of deflate: 6 takes twice the time and makes files 1 % smaller
_MOST_DEFLATED = 1100  # times as much as a deflated member holds is the most that it can unpack to
_MOST_UNPACKED, ALWAYS = 50, 1 << 27  # times a file's size, and bytes: what is larger than both is no file of ours
# Errors that zipfile, NumPy and JSON raise for a damaged file.
_DAMAGE = (
    OSError,
    EOFError,
    KeyError,
    RuntimeError,
    TypeError,
    ValueError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Parameters
    ----------
    name : str
        What the files hold, for messages.
    version : int
        Raised whenever the meaning of a field changes; only files of this version are read.
    units : str
        Note for people who look into a file.
    classes : tuple of type
        Dataclasses that may occur in it: first the value's own, or that of each value of a tuple, then nested ones. All
        their fields are stored. What they check when they are made is checked when they are read.
    packed : bool
        Whether larger arrays are packed, which takes some time to write and little to read.
    """

    name: str
    version: int
    units: str
    classes: tuple[type, ...]
    packed: bool = False

    @property
    def _title(self) -> str:
        return f"exudyn_partition {self.name}"

    def save(self, path: str | Path, value: object, key: str = "") -> None:
        """Write `value`. Even if the process is killed, `path` holds the complete new file or the old one.

        Parameters
        ----------
        path : str or Path
        value : object
        key : str
            What the value belongs to, for those who ask for it when they `load`.

        Raises
        ------
        InputError
            If no file can stand at `path`: there is no such folder, or it is a folder, a device or a pipe.
        OutputError
            If the system cannot write; the old file is kept.
        """
        arrays: dict[str, Any] = {}  # whose names are not those of options
        about = {
            "format": self._title,
            "version": self.version,
            "library": __version__,
            "units": self.units,
            "content": _describe(value, "", arrays, self.packed),
        }
        if key:
            about["key"] = key
        with replacing(path) as file, zipfile.ZipFile(file, "w") as archive:
            _write_member("about", np.array(json.dumps(about)), archive)
            for name, array in arrays.items():
                if self.packed and _is_packable(array):
                    _write_member(name, _planes(array), archive, zipfile.ZIP_DEFLATED)
                else:
                    _write_member(name, array, archive)

    def load(self, path: str | Path, key: str = "") -> Any:
        """Read what `save` wrote.

        Parameters
        ----------
        path : str or Path
        key : str
            That which the file was saved with; by default, any will do.

        Raises
        ------
        InputError
            If the file is missing, damaged, of another kind or of another version, or has another key.
        """
        path = validate_path("path", path)
        try:
            self._check_file(path)
            with path.open("rb") as file:
                if file.read(len(_ZIP_START)) != _ZIP_START:
                    raise InputError(f"path: {path} is not an npz file; expected a saved {self.name}")
                with zipfile.ZipFile(file) as archive:
                    check_sizes(archive, path.stat().st_size)
                    content = self._content(path, archive, key)
                    try:
                        return self._checked(_restore(content, archive, {c.__name__: c for c in self.classes}))
                    except InputError as error:  # of a class that refuses what it is given
                        raise ValueError(str(error)) from error
        except InputError:
            raise
        except FileNotFoundError as error:
            raise InputError(
                f"path: expected a saved {self.name}, but there is no file {path} (working directory {Path.cwd()})"
            ) from error
        except _DAMAGE as error:
            raise InputError(
                f"path: {path} is damaged or cannot be read: {error or type(error).__name__}. "
                f"Restore it from a copy, or compute and save the {self.name} anew"
            ) from error

    def _check_file(self, path: Path) -> None:
        """Refuse a pipe, which would wait for a writer, and a device, which may never end."""
        kind = path.stat().st_mode
        if not stat.S_ISREG(kind) and not stat.S_ISDIR(kind):
            raise InputError(f"path: expected a saved {self.name}, got {path}, a device or a pipe")

    def _checked(self, value: Any) -> Any:
        """Return `value` if it is of the first class, or a tuple of such."""
        kind = self.classes[0]
        for item in value if isinstance(value, tuple) else (value,):
            if not isinstance(item, kind):
                raise ValueError(f"expected a {kind.__name__} in it, got a {type(item).__name__}")
        return value

    def _content(self, path: Path, archive: zipfile.ZipFile, key: str) -> JSON:
        """Description of the value, if the file is of this kind and version, and has this key."""
        members = archive.namelist()
        about = json.loads(str(read_member("about", archive))) if "about.npy" in members else {}
        if not isinstance(about, dict) or about.get("format") != self._title:
            names = ", ".join(name.removesuffix(".npy") for name in members[:5])
            raise InputError(f"path: {path} is an npz file of another kind, with {names}; expected a saved {self.name}")
        version = about["version"]
        if version != self.version:
            remedy = "update the library, or " if version > self.version else ""
            raise InputError(
                f"path: {path} is of version {version}, from exudyn_partition {about['library']}; this one, "
                f"{__version__}, reads version {self.version}: {remedy}compute and save the {self.name} anew"
            )
        if key and about.get("key") != key:
            raise InputError(f"path: {path} holds another {self.name} than its name says: it was copied or moved there")
        return about["content"]


def digest(value: object) -> str:
    """SHA-256 of a value: of its structure, field by field, and of every array's type, shape and numbers.

    The order of a dict's keys and of an array's memory does not matter.
    """
    arrays: dict[str, Array] = {}
    sha = hashlib.sha256(json.dumps(_describe(value, "", arrays), sort_keys=True).encode())
    for _, array in sorted(arrays.items()):
        sha.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8))
    return sha.hexdigest()


def sketch(value: object) -> tuple[str, dict[str, Array]]:
    """Digest of what a value is exactly, and projections of its numbers, which rounding changes by rounding alone.

    Returns
    -------
    str
        Of the structure, of texts, of whole numbers and of shapes of arrays.
    dict of str to (n,) array
        For each array of floats, by its dotted name: its norm, then its projections on random directions. Floats
        outside of arrays are together under "".
    """
    arrays: dict[str, Array] = {}
    floats: list[float] = []
    structure = json.dumps(_without_floats(_describe(value, "", arrays), floats), sort_keys=True)
    sha, projections = hashlib.sha256(structure.encode()), {"": np.array(floats)}
    for name, array in sorted(arrays.items()):
        if array.dtype.kind == "f":
            projections[name] = _projections(array)
        else:
            sha.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8))
    return sha.hexdigest(), projections


def _without_floats(node: JSON, floats: list[float]) -> JSON:
    """Description without its floats, which are put into `floats`."""
    match node:
        case float():
            floats.append(node)
            return "float"
        case dict():
            return {key: _without_floats(x, floats) for key, x in node.items()}
        case list():
            return [_without_floats(x, floats) for x in node]
    return node


def _projections(array: Array) -> Array:
    """Norm of an array, and its projections on some directions, which are products of random rows and columns."""
    rows_of = len(array) if array.ndim else 1
    flat = array.reshape(rows_of, array.size // max(rows_of, 1))
    random = np.random.default_rng(0)
    rows, columns = (random.choice([-1.0, 1.0], (size, _PROJECTIONS)) for size in flat.shape)
    return np.append(np.linalg.norm(flat), np.einsum("mk,mk->k", flat.T @ rows, columns))


def _describe(value: object, name: str, arrays: dict[str, Array], packed: bool = False) -> JSON:
    """Description of `value` in JSON types; its arrays are put into `arrays` by their dotted names."""

    def each(children: dict[str, object]) -> dict[str, JSON]:
        return {key: _describe(x, f"{name}.{key}" if name else key, arrays, packed) for key, x in children.items()}

    match value:
        case None | bool() | int() | float() | str():
            return value
        case np.ndarray() if not value.dtype.hasobject:
            while name in arrays:  # of a key with a dot, which reads as one within another
                name += "'"
            arrays[name] = value
            said = {"array": name, "dtype": value.dtype.str, "shape": list(value.shape)}
            if packed and _is_packable(value):
                said["planes"] = "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
            return said
        case sp.csr_matrix() | sp.csr_array():
            parts = each({part: getattr(value, part) for part in _CSR_PARTS})
            return {"sparse": type(value).__name__, "parts": parts, "shape": list(value.shape)}
        case tuple():
            return {"tuple": list(each({str(i): x for i, x in enumerate(value)}).values())}
        case dict():
            return {"dict": each(value)}
        case _ if dataclasses.is_dataclass(value):
            fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
            return {"class": type(value).__name__, "fields": each(fields)}
    raise TypeError(f"{name}: a {type(value).__name__} cannot be stored")


def _restore(node: JSON, archive: zipfile.ZipFile, classes: dict[str, type]) -> Any:
    """Value that `_describe` described as `node`."""

    def each(nodes: dict[str, JSON]) -> dict[str, Any]:
        return {key: _restore(x, archive, classes) for key, x in nodes.items()}

    match node:
        case {"array": name, "dtype": dtype, "shape": shape, "planes": order}:
            return _numbers(
                name, read_member(name, archive, zipfile.ZIP_DEFLATED), np.dtype(dtype), tuple(shape), order
            )
        case {"array": name, "dtype": dtype, "shape": shape}:
            array = read_member(name, archive)
            if (array.dtype.str, list(array.shape)) != (dtype, shape):
                raise ValueError(
                    f"{name}: expected {dtype} of shape {tuple(shape)}, got {array.dtype.str} of shape {array.shape}"
                )
            return array
        case {"sparse": kind, "parts": parts, "shape": shape}:
            arrays = each(parts)
            matrix = _CSR[kind](tuple(arrays[part] for part in _CSR_PARTS), shape=tuple(shape))
            matrix.check_format(full_check=True)  # every index is in range
            return matrix
        case {"tuple": items}:
            return tuple(_restore(x, archive, classes) for x in items)
        case {"dict": items}:
            return each(items)
        case {"class": name, "fields": fields}:
            if differing := fields.keys() ^ {field.name for field in dataclasses.fields(classes[name])}:
                raise ValueError(f"fields of {name} that only the file or only the library has: {sorted(differing)}")
            return classes[name](**each(fields))
    return node


def _is_packable(array: Array) -> bool:
    """Whether it is worthwhile to compress an array in planes of its bytes."""
    return array.nbytes >= PACK_FROM and array.dtype.kind in "iuf"


def _planes(array: Array) -> Array:
    """Bytes of an array, (itemsize, size): first bytes of all numbers, in Fortran's order, then second bytes, ..."""
    numbers = array.ravel(order="F")
    return np.ascontiguousarray(numbers.view(np.uint8).reshape(numbers.size, numbers.itemsize).T)


def _numbers(name: str, planes: Array, dtype: np.dtype[Any], shape: tuple[int, ...], order: str) -> Array:
    """Array of `shape`, in its order of memory; `_planes` made `planes` of it."""
    expected = (dtype.itemsize, math.prod(shape))
    if dtype.kind not in "iuf" or planes.dtype != np.uint8 or planes.shape != expected or order not in ("C", "F"):
        raise ValueError(
            f"{name}: expected planes of {dtype.str} in shape {shape}, so {expected} bytes, got {planes.dtype.str} of "
            f"shape {planes.shape} in order {order!r}"
        )
    array = np.ascontiguousarray(planes.T).view(dtype).reshape(shape, order="F")
    return np.ascontiguousarray(array) if order == "C" else array


def _write_member(name: str, array: Array, archive: zipfile.ZipFile, kind: int = zipfile.ZIP_STORED) -> None:
    """Write one array of a file, as NumPy's `savez` does."""
    data = io.BytesIO()
    np.lib.format.write_array(data, array, allow_pickle=False)
    # Not a view of it: Python 3.12.1 crashes when it collects a view that the traceback of a full disk has held.
    archive.writestr(zipfile.ZipInfo(f"{name}.npy"), data.getvalue(), kind, _LEVEL)


def check_sizes(archive: zipfile.ZipFile, size: int) -> None:
    """Refuse an archive in a file of `size` bytes, before anything is unpacked, whose members cannot be what it holds.

    Arrays of numbers hardly compress: what would unpack to many times the file is no array that was saved.
    """
    members = archive.infolist()
    if sum(info.compress_size for info in members) > size:
        raise ValueError("its members claim to be larger than the file")
    if (unpacked := sum(info.file_size for info in members)) > max(ALWAYS, _MOST_UNPACKED * size):
        raise ValueError(f"its {size} bytes would unpack to {unpacked}")


def read_member(name: str, archive: zipfile.ZipFile, kind: int = zipfile.ZIP_STORED) -> Array:
    """Array of the member `name`; its size is compared with that of the file before memory is allocated.

    `read` checks the member's CRC before NumPy looks at it.

    Raises
    ------
    ValueError
        If it is another kind of member, or claims what it cannot hold; also other errors of zipfile and NumPy.
    """
    info = archive.getinfo(f"{name}.npy")
    if info.compress_type != kind:
        expected = "not compressed" if kind == zipfile.ZIP_STORED else "deflated"
        raise ValueError(f"{name}: expected a member that is {expected}")
    if info.file_size > info.compress_size * (1 if kind == zipfile.ZIP_STORED else _MOST_DEFLATED):
        raise ValueError(f"{name}: {info.compress_size} bytes cannot hold the {info.file_size} that it claims")
    with archive.open(info) as file:
        data = io.BytesIO(file.read(info.file_size))  # no more, even if it would unpack to more
    version = np.lib.format.read_magic(data)
    if version not in _HEADERS:
        raise ValueError(f"{name}: expected an array in NumPy's format 1.0 or 2.0, got {version}")
    shape, _, dtype = _HEADERS[version](data)
    claimed, size = math.prod(shape) * dtype.itemsize, info.file_size - data.tell()
    if dtype.hasobject or min(shape, default=0) < 0 or claimed != size:
        raise ValueError(f"{name}: its header claims {claimed} bytes of {dtype} in shape {shape}, the file has {size}")
    data.seek(0)
    return np.lib.format.read_array(data, allow_pickle=False)
