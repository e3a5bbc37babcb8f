"""What users give as numbers is refused where NumPy or `float` would drop or change its meaning."""

import array
import datetime
from collections import deque
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp

from exudyn_partition.errors import InputError, MeshError
from exudyn_partition.support.checks import (
    answer_of,
    check_floats,
    listed,
    shape_of,
    validate_array,
    validate_callable,
    validate_integer,
    validate_items,
    validate_number,
    validate_positive,
    validate_times,
    validate_whole,
)


class Quantity(np.ndarray):
    """As packages for quantities have it: an array that knows its unit."""

    unit = "mm"


class Pair(float):
    """A number that knows its unit, and that NumPy and `float` take as a plain one."""

    units = "mm"


VECTORS = {
    "durations": (np.array([0, 0, 1], "m8[s]"), "durations"),
    "durations in a list": ([0.0, 0.0, np.timedelta64(1, "s")], "durations"),
    "durations of Python": ([datetime.timedelta(seconds=1)] * 3, ""),
    "dates": (np.array([0, 0, 1], "M8[s]"), "dates"),
    "masked": (np.ma.array([0.0, 0.0, -1.0], mask=[0, 0, 1]), "masked"),
    "masked rows in a list": ([np.ma.array([0.0], mask=[1]), [0.0], [0.0]], "masked"),
    "the masked constant": ([0.0, 0.0, np.ma.masked], "masked"),
    "truth values": (np.array([False, False, True]), "truth values"),
    "a truth value in a list": ([0.0, 0.0, True], "truth values"),
    "a truth value among objects": (np.array([0.0, 0.0, True], object), ""),
    "a truth value of NumPy among objects": (np.array([0.0, 0.0, np.True_], object), "truth values"),
    "complex": (np.array([0, 0, 1 + 1j]), "complex"),
    "a complex number of NumPy": ([0.0, 0.0, np.complex128(1)], "complex"),
    "fields": (np.array([(0.0, 0.0, 1.0)], dtype="f8,f8,f8"), "fields"),
    "text": (np.array(["0", "0", "1"]), "text"),
    "text without axes in a list": ([0.0, 0.0, np.array("1")], "text"),
    "text as bytes": (np.array([b"0", b"0", b"1"]), "text"),
    "bytes": (bytearray(b"\0\0\1"), "bytes"),
    "memory": (memoryview(b"\0\0\1"), "bytes"),
    "of a unit": (np.array([0.0, 0.0, 1.0]).view(Quantity), "unit, 'mm'"),
    "some of a unit": ([0.0, 0.0, np.array(1.0).view(Quantity)], "unit, 'mm'"),
    "numbers of a unit": ([0.0, 0.0, Pair(1.0)], "unit, 'mm'"),
    "None": ([0.0, 0.0, None], ""),
    "ragged": ([0.0, [0.0], 1.0], ""),
}


@pytest.mark.parametrize("name", VECTORS)
def test_a_vector_that_would_lose_its_meaning_is_refused(name):
    value, said = VECTORS[name]
    with pytest.raises(InputError, match=rf"v: expected numbers of shape \(3,\), got (?s:.)*{said}"):
        validate_array("v", value, (3,))


@pytest.mark.parametrize(
    "value",
    [
        [0, 0, 1],
        (0.0, np.float32(0), np.int8(1)),
        range(-1, 2),
        deque([0.0, 0.0, 1.0]),
        [Fraction(0), Decimal(0), 1],
        np.array([0, 0, 1], dtype=np.uint16),
        np.array([0, 0, 1], dtype=object),
        np.ma.array([0.0, 0.0, 1.0]),
        [np.array(0.0), np.array([0.0])[0], np.longdouble(1)],
        array.array("d", [0.0, 0.0, 1.0]),
    ],
    ids=repr,
)
def test_plain_numbers_of_every_kind_are_taken(value):
    found = validate_array("v", value, (3,))
    assert found.dtype == float
    assert found[-1] == 1.0
    assert not found.flags.writeable


NUMBERS = {
    "complex of NumPy": np.complex128(1 + 1j),
    "complex without axes": np.array(1 + 1j),
    "True": True,
    "True of NumPy": np.True_,
    "True without axes": np.array(True),
    "text": "1.0",
    "text without axes": np.array("1.0"),
    "bytes": b"1.0",
    "changeable bytes": bytearray(b"12"),
    "memory": memoryview(b"12"),
    "an array of bytes": array.array("b", b"12"),
    "duration": np.timedelta64(1, "s"),
    "date": np.datetime64(1, "s"),
    "masked": np.ma.array(1.0, mask=True),
    "the masked constant": np.ma.masked,
    "of a unit": np.array(1.0).view(Quantity),
    "a number of a unit": Pair(1.0),
    "one in an array": np.ones(1),
    "one in a list": [1.0],
    "None": None,
    "too large": 10**400,
    "nan": float("nan"),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_that_would_lose_its_meaning_is_refused(name):
    with pytest.raises(InputError, match="r: expected a length, got "):
        validate_number("r", NUMBERS[name], "a length")


@pytest.mark.parametrize(
    "value", [1, 1.0, np.float32(1), np.array(1.0), np.uint8(1), Fraction(1), Decimal(1)], ids=repr
)
def test_a_plain_number_of_every_kind_becomes_a_float(value):
    found = validate_number("r", value)
    assert type(found) is float
    assert found == 1.0


WHOLE = {
    "duration": np.timedelta64(1, "s"),
    "masked": np.ma.array(1, mask=True),
    "of a unit": np.array(1).view(Quantity),
    "True without axes": np.array(True),
    "half": 1.5,
}


@pytest.mark.parametrize("name", WHOLE)
def test_what_is_no_whole_number_is_refused(name):
    with pytest.raises(InputError, match="n: expected a whole number"):
        validate_integer("n", WHOLE[name])
    with pytest.raises(InputError, match="n: expected node numbers"):
        validate_whole("n", WHOLE[name], "node numbers")
    with pytest.raises(InputError, match="n: expected node numbers"):
        validate_whole("n", [0, WHOLE[name]], "node numbers")


def test_whole_numbers_are_taken_as_they_are():
    assert validate_integer("n", np.int16(3)) == 3
    numbers = np.array([3, 1], dtype=np.uint8)
    assert validate_whole("n", numbers) is numbers
    assert validate_whole("n", [3, 1]).tolist() == [3, 1]
    assert validate_whole("n", []).dtype.kind == "i"


def test_arrays_of_files_and_dataclasses_are_not_masked():
    check_floats("x", np.zeros(2), (2,))
    with pytest.raises(InputError, match="x: expected an array of floats"):
        check_floats("x", np.ma.array([0.0, 1.0], mask=[0, 1]), (2,))


@pytest.mark.parametrize("value", [5e-324, 4e-276, 1e-31, 1e31, 5e102])
def test_numbers_that_no_quantity_reaches_are_refused(value):
    """Their powers, or what they divide, would be zero or infinite."""
    with pytest.raises(InputError, match=r"^length: expected 1e-30 to 1e\+30 in m, got"):
        validate_positive("length", value, "m")


@pytest.mark.parametrize(
    "value", [np.array(1.0), np.array("a"), sp.dia_matrix(np.eye(3)), 1, "text", b"text", {"a": 1}, None]
)
def test_what_has_no_items_is_no_list(value):
    """Arrays without axes are iterable by their type, and raise an error of NumPy where somebody tries."""
    assert listed(value) is None
    with pytest.raises(InputError, match="gauges: expected a list of what"):
        validate_items("gauges", value, int, "int()")


@pytest.mark.parametrize("value", [(), [1, 2], np.arange(3), iter([1]), {1}])
def test_all_that_has_items_is_a_list(value):
    assert listed(value) is not None


def test_a_class_is_no_function_of_the_share_done():
    """Its call would make a value of it, or end in an error of Python."""
    with pytest.raises(InputError, match="progress: expected a function, got type"):
        validate_callable("progress", dict, "a function")


@pytest.mark.parametrize(("value", "shape"), [
    (np.zeros((2, 6)), (2, 6)), ([[1, 2]], (1, 2)), ((), (0,)), ([0, [0], 0], ()), ("ab", ()), (None, ()), ({}, ()),
])  # fmt: skip
def test_what_is_no_array_has_the_shape_of_one_without_axes(value, shape):
    assert shape_of(value) == shape


def test_no_time_is_no_choice_of_times():
    with pytest.raises(InputError, match="frames: expected at least one time"):
        validate_times("frames", [], np.arange(3.0))


def test_an_error_of_a_user_s_function_is_named_and_is_the_cause():
    """An error of the library, as of bodies that a function reduces, names what is wrong itself."""

    def fails(x):
        raise (LookupError if x == 3 else MeshError)(f"no {x}")

    with pytest.raises(InputError, match=r"curve: expected a function of angles, .* LookupError: no 3") as caught:
        answer_of("curve", fails, 3, "angles")
    assert type(caught.value.__cause__) is LookupError
    with pytest.raises(MeshError, match=r"^no 4$"):
        answer_of("curve", fails, 4, "angles")
