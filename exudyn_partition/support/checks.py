"""Validation of user input: small functions that return the checked value or raise `InputError`.

Every public function calls them before it does anything else. So a wrong argument is named, and nothing is half done.
"""

from __future__ import annotations

import math
import operator
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..errors import InputError, PartitionError
from .arrays import Array

Item = TypeVar("Item")
Choice = TypeVar("Choice", bound=str)

_EXTREME = 1e30  # bound of all quantities in SI units, and its inverse: their products stay finite
_LONGEST_SHOWN = 120  # characters of a wrong value in a message
_PLAIN = frozenset({float, int, np.float64, np.float32, np.int64, np.int32})
_NOT_NUMBERS = (TypeError, ValueError, OverflowError, RuntimeError)  # of float, NumPy, and arrays of other packages
_KINDS = {  # of NumPy's arrays
    "b": "truth values are no numbers",
    "S": "text is no number",
    "U": "text is no number",
    "c": "complex numbers have an imaginary part; take .real or abs() of them",
    "m": "durations are no numbers; divide them by numpy.timedelta64(1, 's')",
    "M": "dates are no numbers; subtract the first one, and divide by numpy.timedelta64(1, 's')",
    "V": "an array with named fields is no array of numbers; take its columns",
}


def validate_array(name: str, value: object, shape: tuple[int | None, ...]) -> Array:
    """Return `value` as a read-only float array of `shape` (None: any length); finite plain numbers only."""
    try:
        _refuse_other_than_numbers(value)
        array = np.array(value, dtype=float)
    except _NOT_NUMBERS as error:
        raise InputError(
            f"{name}: expected numbers of shape {_show(shape)}, got {_called(value)}{_why(error)}"
        ) from error
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        raise InputError(f"{name}: expected shape {_show(shape)}, got {array.shape}")
    if not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))[0]
        raise InputError(f"{name}: expected finite numbers, got {array[tuple(bad)]} at index {tuple(map(int, bad))}")
    array.flags.writeable = False
    return array


def validate_whole(name: str, value: object, expected: str = "whole numbers") -> Array:
    """Return `value` as an array of whole numbers of any shape, as it is; an empty one of any type will do."""
    try:
        _refuse_other_than_numbers(value)
        array = np.asarray(value)
    except _NOT_NUMBERS as error:
        raise InputError(f"{name}: expected {expected}, got {_called(value)}{_why(error)}") from error
    if array.size and array.dtype.kind not in "iu":
        raise InputError(f"{name}: expected {expected}, got {array.dtype} of shape {array.shape}")
    return array if array.size else array.astype(np.int64)


def check_floats(name: str, value: object, shape: tuple[int | None, ...]) -> None:
    """Raise unless `value` is an array of floats of `shape` (None: any length), all finite; it is not copied."""
    finite = np.isfinite(_array(name, value, shape, "f"))
    if not finite.all():
        raise InputError(f"{name}: expected finite numbers, got {np.count_nonzero(~finite)} that are not")


def check_indices(name: str, value: object, shape: tuple[int | None, ...], below: int | None = None) -> None:
    """Raise unless `value` is an array of whole numbers of `shape`, none negative or from `below` on."""
    array = _array(name, value, shape, "iu")
    if array.size and (array.min() < 0 or (below is not None and array.max() >= below)):
        upwards = "0 upwards" if below is None else f"0 to {below - 1}"
        raise InputError(f"{name}: expected numbers from {upwards}, got {array.min()} to {array.max()}")


def check_tuple(name: str, value: object, kind: type) -> None:
    """Raise unless `value` is a tuple of a kind."""
    if not isinstance(value, tuple) or not all(isinstance(item, kind) for item in value):
        raise InputError(f"{name}: expected a tuple of {kind.__name__}, got {_called(value)}")


def _array(name: str, value: object, shape: tuple[int | None, ...], kinds: str) -> Array:
    """Return `value` if it is an array of one of NumPy's kinds and of `shape`."""
    kind = "whole numbers" if "i" in kinds else "floats"
    if not isinstance(value, np.ndarray) or value.dtype.kind not in kinds or _loses(value):
        got = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else _called(value)
        raise InputError(f"{name}: expected an array of {kind} of shape {_show(shape)}, got {got}")
    if value.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, value.shape, strict=True)):
        raise InputError(f"{name}: expected shape {_show(shape)}, got {value.shape}")
    return value


def validate_vector(name: str, value: object) -> Array:
    """Return `value` as a read-only vector of three finite floats."""
    return validate_array(name, value, (3,))


def validate_number(name: str, value: object, expected: str = "a finite number") -> float:
    """Return `value` as a finite float; an array without axes is one number, and all but plain numbers is refused."""
    if type(value) is float and math.isfinite(value):  # as nearly always: progress has a number in each step
        return value
    try:
        _refuse_other_than_numbers(value)
        if np.ndim(value):  # type: ignore[arg-type]
            raise TypeError
        number = float(value)  # type: ignore[arg-type]  # what has no float raises a TypeError
    except _NOT_NUMBERS as error:
        raise InputError(f"{name}: expected {expected}, got {_called(value)}{_why(error)}") from error
    if not np.isfinite(number):
        raise InputError(f"{name}: expected {expected}, got {_called(value)}")
    return number


def validate_positive(name: str, value: object, unit: str = "") -> float:
    """Return `value` as a finite float above zero, within bounds that no quantity reaches."""
    expected = f"a finite number above zero{_in(unit)}"
    number = validate_number(name, value, expected)
    if number <= 0:
        raise InputError(f"{name}: expected {expected}, got {number!r}")
    if not 1 / _EXTREME <= number <= _EXTREME:
        raise InputError(f"{name}: expected {1 / _EXTREME:g} to {_EXTREME:g}{_in(unit)}, got {number!r}")
    return number


def validate_integer(name: str, value: object, least: int | None = None, most: int | None = None) -> int:
    """Return `value` as an int from `least` to `most`; integers of NumPy will do, 2.0 and True will not."""
    bounds = f" of at least {least}" * (least is not None) + f" of at most {most}" * (most is not None)
    if isinstance(value, bool | np.bool_) or not hasattr(value, "__index__") or _loses(value):
        raise InputError(f"{name}: expected a whole number{bounds}, got {_called(value)}")
    try:
        number = operator.index(value)
    except TypeError as error:  # an array of several
        raise InputError(f"{name}: expected a whole number{bounds}, got {_called(value)}") from error
    if (least is not None and number < least) or (most is not None and number > most):
        raise InputError(f"{name}: expected a whole number{bounds}, got {number}")
    return number


def validate_flag(name: str, value: object) -> bool:
    """Return `value` if it is True or False."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name}: expected True or False, got {_called(value)}")
    return bool(value)


def validate_text(name: str, value: object) -> str:
    """Return `value` if it is text without the character NUL, which ends a text in Exudyn and in file systems."""
    if not isinstance(value, str):
        raise InputError(f"{name}: expected text, got {_called(value)}")
    if "\0" in value:
        raise InputError(f"{name}: expected text without the character NUL, got {_called(value)}")
    return value


def validate_path(name: str, value: object) -> Path:
    """Return `value` as a path, if it can be one."""
    if not isinstance(value, str | os.PathLike):
        raise InputError(f"{name}: expected a path as text or pathlib.Path, got {_called(value)}")
    text = os.fspath(value)
    if not isinstance(text, str) or not text or "\0" in text:
        raise InputError(f"{name}: expected a path as text that is not empty and has no character NUL, got {text!r}")
    return Path(text)


def validate_file(name: str, path: Path) -> None:
    """Raise unless there is a file at `path`."""
    try:
        there = path.is_file()
    except OSError as error:  # a name that is too long
        raise InputError(f"{name}: {_shown(path)} cannot be read: {error.strerror}") from error
    if not there:
        raise InputError(f"{name}: expected a file, there is none at {_shown(path)} (working directory {Path.cwd()})")


def validate_type(name: str, value: object, kind: type, source: str) -> None:
    """Raise unless `value` is of a kind; `source` is the function that makes such values, for the message."""
    if not isinstance(value, kind):
        raise InputError(f"{name}: expected what {source} returns, a {kind.__name__}, got {type(value).__name__}")


def listed(values: Any) -> list[Any] | None:
    """Items of a collection; None if the value is none: a number, a text, a mapping, an array without axes."""
    if isinstance(values, str | bytes | Mapping):
        return None
    try:
        return list(values)
    except TypeError:  # also of sparse matrices that cannot be indexed
        return None


def shape_of(values: object) -> tuple[int, ...]:
    """Shape of an array, or of a list of equal lists; that without axes for all else."""
    try:
        return np.shape(values) if isinstance(values, np.ndarray | list | tuple) else ()
    except ValueError:
        return ()


def validate_items(name: str, values: object, kind: type[Item], source: str) -> list[Item]:
    """Return `values` as a list of values of a kind; for `source` see `validate_type`."""
    expected = f"a list of what {source} returns, each a {kind.__name__}"
    if (items := listed(values)) is None:
        raise InputError(f"{name}: expected {expected}, got {_called(values)}")
    for i, item in enumerate(items):
        if not isinstance(item, kind):
            raise InputError(f"{name}: expected {expected}, got {type(item).__name__} at index {i}")
    return items


def validate_result(value: object, name: str = "result") -> None:
    """Raise unless `value` is a Result. It is known by its methods, since its class is in a higher layer."""
    if isinstance(value, type) or not hasattr(value, "sensor_of"):
        raise InputError(
            f"{name}: expected what solve_dynamic() or collect() returns, a Result, got {type(value).__name__}"
        )


def validate_times(name: str, values: object, t: Array) -> Array:
    """Return times, (k,) [s], that lie within the samples `t` of a run, or raise `InputError`."""
    times = validate_array(name, values, (None,))
    if not len(times):
        raise InputError(f"{name}: expected at least one time, got none")
    slack = 1e-9 * (t[-1] - t[0])
    outside = (times < t[0] - slack) | (times > t[-1] + slack)
    if outside.any():
        raise InputError(
            f"{name}: expected times of the run, {t[0]:.6g} to {t[-1]:.6g} s, got {times[outside.argmax()]:.6g}"
        )
    return times


def validate_callable(name: str, value: object, expected: str) -> None:
    """Raise unless `value` can be called and is no class, as dict is; `expected` says with what."""
    if not callable(value) or isinstance(value, type):
        raise InputError(f"{name}: expected {expected}, got {_called(value)}")


def answer_of(name: str, function: Callable[[Any], Any], value: Any, task: str) -> Any:
    """Answer of a user's function to a value; `task` says what it takes and returns.

    Raises
    ------
    InputError
        If the function raises an error, which is its cause.
    """
    try:
        return function(value)
    except PartitionError:
        raise  # it says itself what is wrong
    except Exception as error:
        said = f"{type(error).__name__}: {error}".rstrip(": ")
        raise InputError(f"{name}: expected a function of {task}, got one that raises {said}") from error


def validate_choice(name: str, value: object, choices: Iterable[Choice]) -> Choice:
    """Return `value` if it is one of `choices`."""
    options = list(choices)
    if not isinstance(value, str) or value not in options:
        raise InputError(f"{name}: expected one of {', '.join(map(repr, options))}, got {_called(value)}")
    return options[options.index(value)]


def read_only(*arrays: Array) -> None:
    """Make arrays read-only, as the fields of frozen dataclasses are."""
    for array in arrays:
        array.flags.writeable = False


class _OtherKindError(TypeError):
    """What a value is that is no plain number."""


def _refuse_other_than_numbers(value: object) -> None:
    """Raise a TypeError if `value`, or anything in it, is no plain real number.

    NumPy and `float` read numbers from text, bytes, times and truth values. They drop imaginary parts, masks and units
    without a word.
    """
    if type(value) in _PLAIN:
        return
    if isinstance(value, list | tuple):
        for item in value:
            if type(item) not in _PLAIN:  # most are, and calls cost
                _refuse_other_than_numbers(item)
        return
    if lost := _loses(value):
        raise _OtherKindError(lost)
    if isinstance(value, bytes | bytearray | memoryview):
        raise _OtherKindError("bytes are no numbers")
    array = np.asarray(value)
    if array.dtype.kind == "O":
        for item in array.flat:
            if type(item) in _PLAIN:
                continue
            if item is value or not isinstance(item, np.ndarray | np.generic):
                _refuse_without_float(item)
            else:
                _refuse_other_than_numbers(item)
    elif array.dtype.kind not in "iuf":
        raise _OtherKindError(_KINDS.get(array.dtype.kind, f"{array.dtype} is no kind of number"))


def _refuse_without_float(value: object) -> None:
    """Raise a TypeError unless `value`, which NumPy does not know, is a number: a fraction, a decimal, ..."""
    if lost := _loses(value):
        raise _OtherKindError(lost)
    if isinstance(value, bool | str) or not hasattr(type(value), "__float__"):
        raise TypeError


def _loses(value: object) -> str:
    """What a value has beside its numbers, and would lose; empty if nothing."""
    for name in ("unit", "units"):
        unit = getattr(value, name, None)
        if unit is not None and not callable(unit):
            return f"it has a unit, {_shown(unit)!r}; give its plain number in the unit that is asked for"
    if np.ma.is_masked(value):
        return "entries are masked; fill them, or leave them out"
    return ""


def _why(error: BaseException) -> str:
    """Reason why a value is refused, where there is more to say than its type."""
    return f": {error}" if isinstance(error, _OtherKindError) else ""


def _called(value: object) -> str:
    """Text for a wrong value in a message: plain values as they are written, all others by their type."""
    if isinstance(value, str | bytes | int | float | complex | list | tuple | dict | set | np.ndarray | None):
        return _shown(repr(value))
    return type(value).__name__


def _shown(value: object) -> str:
    text = str(value)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}... ({len(text)} characters)"


def _show(shape: tuple[int | None, ...]) -> str:
    return "(" + ", ".join("n" if n is None else str(n) for n in shape) + ("," if len(shape) == 1 else "") + ")"


def _in(unit: str) -> str:
    return f" in {unit}" if unit else ""
