"""Small values for the tests of files, which processes of their own import too."""

import dataclasses
import json
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from exudyn_partition.support import archive


@dataclass(frozen=True, eq=False)
class Sample:
    """A small value with a field of every kind."""

    name: str
    array: np.ndarray
    matrix: sp.csr_matrix
    labels: tuple[str, ...] = ("µ", "")
    nothing: np.ndarray | None = None
    limits: tuple[float, ...] = (0.1, float("inf"), -0.0)
    named: dict[str, np.ndarray] = dataclasses.field(default_factory=lambda: {"a b": np.empty((0, 3))})


SAMPLES = archive.Format("sample", 3, "none", (Sample,))


PACKED = replace(SAMPLES, packed=True)


def sample(number=1.0, n=5):
    """A sample that holds a number many times."""
    return Sample("s", np.full((n, n), number), sp.diags(np.full(n, number), format="csr"))


def assert_same(x, y):
    """Same types, bits, memory order and write protection, down to the last field."""
    assert type(x) is type(y)
    if dataclasses.is_dataclass(x):
        for f in dataclasses.fields(x):
            assert_same(getattr(x, f.name), getattr(y, f.name))
    elif isinstance(x, np.ndarray):
        assert (x.dtype, x.shape) == (y.dtype, y.shape)
        assert x.tobytes() == y.tobytes()
        for flag in ("C_CONTIGUOUS", "F_CONTIGUOUS", "WRITEABLE"):
            assert x.flags[flag] == y.flags[flag]
    elif sp.issparse(x):
        assert x.shape == y.shape
        for part in ("data", "indices", "indptr"):
            assert_same(getattr(x, part), getattr(y, part))
    elif isinstance(x, dict):
        assert_same(tuple(x), tuple(y))
        assert_same(tuple(x.values()), tuple(y.values()))
    elif isinstance(x, tuple):
        assert len(x) == len(y)
        for a, b in zip(x, y, strict=True):
            assert_same(a, b)
    else:
        assert repr(x) == repr(y)


def content(path):
    """Arrays of an npz file, and what it says about itself, by NumPy alone; none of them packed any more."""
    with np.load(path) as data:
        arrays = dict(data)
    about = json.loads(str(arrays["about"]))

    def unpack(node):
        match node:
            case {"array": name, "dtype": dtype, "shape": shape}:
                if node.pop("planes", None):
                    numbers = np.frombuffer(arrays[name].T.tobytes(), dtype)
                    arrays[name] = np.ascontiguousarray(numbers.reshape(shape, order="F"))
            case dict():
                for child in node.values():
                    unpack(child)
            case list():
                for child in node:
                    unpack(child)

    unpack(about["content"])
    return arrays, about


def rewrite(path, change):
    """Pass the arrays of an npz file, and what it says about itself, through `change`."""
    arrays, about = content(path)
    change(arrays, about)
    np.savez(path, **{**arrays, "about": np.array(json.dumps(about))})


def save_for_ever(path, number):
    """Write one file again and again, until the process is killed."""
    while True:
        SAMPLES.save(path, sample(number, n=300))
