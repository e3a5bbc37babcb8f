"""Points of a study: grids, lists, Latin squares and Sobol points, as plain values that a file can hold."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import InputError
from ..support.checks import listed, validate_choice, validate_integer, validate_number
from ..support.foreign import JSON
from ..support.optional import require

Parameters = dict[str, Any]  # plain values by the names of a function's arguments

METHODS = ("sobol", "latin")
_PLAIN = "numbers, text, truth values, None, lists or dicts of these"


def sample_parameters(
    ranges: Mapping[str, Any], count: int, *, method: str = "sobol", seed: int = 0
) -> list[dict[str, Any]]:
    """Spread points over ranges of parameters, for `study`.

    Parameters
    ----------
    ranges : dict
        Of each parameter by its name (low, high); what is no pair is the same in all points.
    count : int
        Number of points; of Sobol points a power of two, as their balance needs it.
    method : {"sobol", "latin"}
        Scrambled Sobol points, or a Latin square: one point in each of `count` slices of each range.
    seed : int
        Of the generator of random numbers: the same one gives the same points.

    Returns
    -------
    list of dict

    Raises
    ------
    InputError
        If an argument is out of range, or no parameter has a range.

    Notes
    -----
    By `scipy.stats.qmc`, `Sobol` and `LatinHypercube`.
    """
    if not isinstance(ranges, Mapping) or not all(isinstance(name, str) for name in ranges):
        raise InputError(f"ranges: expected a dict of (low, high) by names of parameters, got {type(ranges).__name__}")
    bounds = {name: listed(value) for name, value in ranges.items()}
    fixed = {name: plain(f"ranges[{name!r}]", ranges[name]) for name, pair in bounds.items() if pair is None}
    varied = {name: _bounds(name, pair) for name, pair in bounds.items() if pair is not None}
    if not varied:
        raise InputError('ranges: expected at least one parameter with (low, high), such as {"speed": (0.2, 0.8)}')
    count, method = validate_integer("count", count, 1), validate_choice("method", method, METHODS)
    if method == "sobol" and count & (count - 1):
        power = 2 ** int(math.log2(count))
        raise InputError(
            f"count: expected a power of two for Sobol points, got {count}; take {power}, {2 * power}, or "
            'method="latin"'
        )
    qmc, random = require("scipy.stats.qmc", "scipy"), np.random.default_rng(validate_integer("seed", seed, 0))
    engine = {"sobol": qmc.Sobol, "latin": qmc.LatinHypercube}[method](len(varied), seed=random)
    points = qmc.scale(engine.random(count), *zip(*varied.values(), strict=True))
    return [{**dict(zip(varied, map(float, point), strict=True)), **fixed} for point in points]


def _bounds(name: str, pair: list[Any]) -> tuple[float, float]:
    """Ends of a range."""
    if len(pair) != 2:
        raise InputError(f"ranges[{name!r}]: expected (low, high), got {len(pair)} values")
    low, high = (validate_number(f"ranges[{name!r}]", value) for value in pair)
    if low >= high:
        raise InputError(f"ranges[{name!r}]: expected (low, high) that ascend, got ({low:g}, {high:g})")
    return low, high


def points_of(parameters: object) -> tuple[list[Parameters], tuple[int, ...]]:
    """Points of a grid or a list, and the shape of the grid.

    A list in the dict of a grid is an axis, with the last one changing first; all else is the same in all points.
    """
    if isinstance(parameters, Mapping):
        _check_names("parameters", parameters)
        axes = {name: listed(values) for name, values in parameters.items()}
        if not axes:
            raise InputError("parameters: expected at least one, with a list of values by its name; got an empty dict")
        if empty := [name for name, values in axes.items() if values is not None and not values]:
            raise InputError(f"parameters[{empty[0]!r}]: expected at least one value, got none")
        each = [
            [plain(f"parameters[{name!r}]", value) for value in (values if values is not None else [parameters[name]])]
            for name, values in axes.items()
        ]
        shape = tuple(len(values) for values in axes.values() if values is not None)
        return [dict(zip(axes, values, strict=True)) for values in itertools.product(*each)], shape
    if isinstance(parameters, Sequence) and not isinstance(parameters, str | bytes):
        if not parameters:
            raise InputError("parameters: expected at least one point, got an empty list")
        for i, point in enumerate(parameters):
            if not isinstance(point, Mapping):
                raise InputError(f"parameters[{i}]: expected a dict of values by names, got {type(point).__name__}")
            _check_names(f"parameters[{i}]", point)
        points = [
            {name: plain(f"parameters[{i}][{name!r}]", value) for name, value in point.items()}
            for i, point in enumerate(parameters)
        ]
        return points, (len(points),)
    raise InputError(
        "parameters: expected a dict with a list of values by the name of each parameter, which is a grid, or a list "
        f"of dicts, got {type(parameters).__name__}"
    )


def _check_names(name: str, point: Mapping[Any, Any]) -> None:
    if wrong := [key for key in point if not isinstance(key, str)]:
        raise InputError(f"{name}: expected names of parameters as keys, got {wrong[0]!r}")


def key_of(point: Mapping[str, Any]) -> str:
    """Text that two points share if they are equal."""
    return json.dumps(point, sort_keys=True)


def plain(name: str, value: object) -> JSON:
    """Value in the types of JSON, and tuples; numbers of NumPy become Python's, and its arrays lists.

    Raises
    ------
    InputError
        If it is none, such as a body.
    """
    match value:
        case None | bool() | str():
            return value
        case np.generic() | np.ndarray() if value.dtype.kind in "biufU":
            return value.tolist()
        case int() | float():
            return value
        case tuple():
            return tuple(plain(name, item) for item in value)
        case list():
            return [plain(name, item) for item in value]
        case dict() if all(isinstance(key, str) for key in value):
            return {key: plain(f"{name}[{key!r}]", item) for key, item in value.items()}
    raise InputError(f"{name}: expected {_PLAIN}, got {type(value).__name__}")
