"""Validation of user input: small functions that return the checked value or raise `InputError`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from .errors import InputError

Array = np.ndarray


def validate_array(name: str, value: Any, shape: tuple[int | None, ...]) -> Array:
    """Return `value` as a read-only float array of `shape` (None: any length), all finite; text is no number."""
    try:
        if np.asarray(value).dtype.kind in "SU":  # NumPy reads numbers from text
            raise TypeError
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: expected numbers of shape {_show(shape)}, got {value!r}") from error
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        raise InputError(f"{name}: expected shape {_show(shape)}, got {array.shape}")
    if not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))[0]
        raise InputError(f"{name}: expected finite numbers, got {array[tuple(bad)]} at index {tuple(map(int, bad))}")
    array.flags.writeable = False
    return array


def validate_vector(name: str, value: Any) -> Array:
    """Return `value` as a read-only vector of three finite floats."""
    return validate_array(name, value, (3,))


def validate_number(name: str, value: Any, expected: str = "a finite number") -> float:
    """Return `value` as a finite float; text that reads like a number is none."""
    try:
        number = float("nan") if isinstance(value, str | bytes) else float(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: expected {expected}, got {value!r}") from error
    if not np.isfinite(number):
        raise InputError(f"{name}: expected {expected}, got {value!r}")
    return number


def validate_positive(name: str, value: Any, unit: str = "") -> float:
    """Return `value` as a finite float above zero."""
    expected = f"a finite number above zero{_in(unit)}"
    number = validate_number(name, value, expected)
    if number <= 0:
        raise InputError(f"{name}: expected {expected}, got {number!r}")
    return number


def validate_type(name: str, value: Any, kind: type, source: str) -> None:
    """Raise unless `value` is of a kind, which `source` returns."""
    if not isinstance(value, kind):
        raise InputError(f"{name}: expected what {source} returns, a {kind.__name__}, got {type(value).__name__}")


def validate_choice(name: str, value: Any, choices: Iterable[str]) -> str:
    """Return `value` if it is one of `choices`."""
    options = list(choices)
    if value not in options:
        raise InputError(f"{name}: expected one of {', '.join(map(repr, options))}, got {value!r}")
    return value


def validate_file(name: str, path: Path) -> None:
    """Raise unless there is a file at `path`."""
    if not path.is_file():
        raise InputError(f"{name}: expected a file, there is none at {path} (working directory {Path.cwd()})")


def read_only(*arrays: Array) -> None:
    """Make arrays read-only, as the fields of frozen dataclasses are."""
    for array in arrays:
        array.flags.writeable = False


def _show(shape: tuple[int | None, ...]) -> str:
    return "(" + ", ".join("n" if n is None else str(n) for n in shape) + ("," if len(shape) == 1 else "") + ")"


def _in(unit: str) -> str:
    return f" in {unit}" if unit else ""
