"""What a study holds: its points, what the function returned at each, failures, tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..support.arrays import Array
from ..support.foreign import DataFrame
from ..support.optional import require
from .run_records import read_all


@dataclass(frozen=True)
class Failure:
    """Why a run failed.

    Parameters
    ----------
    parameters : dict
        What the function was called with.
    error : str
        Name of the exception's class; "WorkerDied" if the process of the run ended.
    message : str
    traceback : str
        Lines of the exception; empty if the process ended.
    """

    parameters: Mapping[str, Any]
    error: str
    message: str
    traceback: str

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> Failure:
        """Failure of a run's record."""
        return cls(*(record[key] for key in ("parameters", "error", "message", "traceback")))

    def __str__(self) -> str:
        point = ", ".join(f"{name}={value!r}" for name, value in self.parameters.items())
        return f"{self.error}: {self.message} (at {point})"


@dataclass(frozen=True, eq=False)
class Study:
    """Runs of a function, from `study`.

    Parameters
    ----------
    parameters : tuple of dict
        Points in the order in which they were given.
    values : tuple
        Of each point the dict that the function returned, {"value": number} for a number; None if the run failed.
    shape : tuple of int
        Lengths of the axes of a grid, in their order; the number of points of a list.
    failures : dict of int to Failure
        By the number of the point.
    info : dict
        "new": runs that were not in the file; "wall_s": of each run, (n,) [s].
    """

    parameters: tuple[Mapping[str, Any], ...]
    values: tuple[Mapping[str, Any] | None, ...]
    shape: tuple[int, ...]
    failures: Mapping[int, Failure] = field(default_factory=dict)
    info: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.parameters) != len(self.values) or np.prod(self.shape, dtype=int) != len(self.values):
            raise InputError(
                f"shape: expected one of {len(self.parameters)} points with a value each, got {self.shape} and "
                f"{len(self.values)} values"
            )

    def __len__(self) -> int:
        return len(self.parameters)

    def __getitem__(self, name: str) -> Array:
        """Return a quantity that the function returned, or else a parameter, at all points.

        Returns
        -------
        array of `shape`, with further axes if the quantity is a list
            Numbers are nan where the run failed; else None is there.

        Raises
        ------
        InputError
            If no run returned it, or lists differ in their lengths.
        """
        values: list[Any] = [None if value is None else value.get(name) for value in self.values]
        if all(value is None for value in values):
            values = [point.get(name) for point in self.parameters]
        known = [value for value in values if value is not None]
        if not known:
            raise InputError(f"name: expected one of {', '.join(self.names)}, got {name!r}")
        try:
            first = np.array(known)
        except ValueError as error:
            raise InputError(f"name: {name!r} is of different lengths at different points; take .values") from error
        if first.dtype.kind not in "biuf":
            first = np.array(known, dtype=object)
        missing: Any = None if first.dtype.kind == "O" else np.nan
        kind = first.dtype if len(known) == len(values) else np.result_type(first.dtype, type(missing))
        result = np.full((len(values), *first.shape[1:]), missing, dtype=kind) if len(known) < len(values) else first
        result[[value is not None for value in values]] = first
        return result.reshape(*self.shape, *first.shape[1:])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of parameters, then of quantities."""
        each = [*self.parameters, *(value for value in self.values if value is not None)]
        return tuple(dict.fromkeys(name for names in each for name in names))

    def to_dataframe(self) -> DataFrame:
        """One row a run, with parameters and quantities as columns, and "error", which says why a run failed.

        Raises
        ------
        MissingPackageError
            If pandas is not installed: `pip install "exudyn-partition[tables]"`.
        """
        rows = [
            {**point, **(value or {}), "error": str(self.failures[i]) if i in self.failures else ""}
            for i, (point, value) in enumerate(zip(self.parameters, self.values, strict=True))
        ]
        return require("pandas").DataFrame(rows)

    @classmethod
    def load(cls, path: str | Path) -> Study:
        """Read the file of a study at `path`, and those of its tasks, whatever runs they have; by ascending parameters.

        Raises
        ------
        InputError
            If there is none, or it is damaged.
        """
        records = read_all(path)
        records.sort(key=lambda record: [(type(x).__name__, str(x) if x is None else x) for x in _ordered(record)])
        return of_records(records, (len(records),), {})


def _ordered(record: Mapping[str, Any]) -> list[Any]:
    """Values of a run's parameters, as they are compared: whole numbers are numbers, lists and dicts text."""
    values = record["parameters"].values()
    return [float(x) if isinstance(x, int | float) else x if isinstance(x, str) else str(x) for x in values]


def of_records(records: list[dict[str, Any]], shape: tuple[int, ...], info: Mapping[str, Any]) -> Study:
    """Study of records in the order of its points."""
    return Study(
        parameters=tuple(record["parameters"] for record in records),
        values=tuple(record.get("values") for record in records),
        shape=shape,
        failures={i: Failure.of(record) for i, record in enumerate(records) if "error" in record},
        info={"wall_s": np.array([record["wall_s"] for record in records], dtype=float), **info},
    )
