"""Restitution between computed impacts, for rigid codes: multilinear interpolation, its validity and its error."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..support.arrays import Array
from ..support.checks import validate_number

_DIGITS = 6  # of the table in a program
_PROGRAM = '''"""Restitution and friction of an impact, by multilinear interpolation between {count} computed impacts.

{about}
"""

AXES = {axes}
TABLES = {tables}


def rebound({arguments}):
    """Return {names} at {arguments}; raise ValueError beyond the table."""
    corners = [(1.0, ())]
    for (name, values), x in zip(AXES.items(), ({arguments},)):
        if not values[0] <= x <= values[-1]:
            raise ValueError(f"{{name}}: the table holds from {{values[0]}} to {{values[-1]}}, got {{x}}")
        i = max(k for k in range(len(values) - 1) if values[k] <= x)
        s = (x - values[i]) / (values[i + 1] - values[i])
        corners = [(w * f, (*at, i + k)) for w, at in corners for k, f in ((0, 1 - s), (1, s)) if f]
    found = []
    for table in TABLES.values():
        total = 0.0
        for weight, at in corners:
            value = table
            for i in at:
                value = value[i]
            total += weight * value
        found.append(total)
    return tuple(found)
'''


@dataclass(frozen=True, eq=False)
class RestitutionLaw:
    """Restitution and ratio of impulses as functions of the varied axes of a `RestitutionMap`.

    Parameters
    ----------
    axes : dict of str to (n,) array
        Axes with several values, ascending: where the law is valid.
    fixed : dict of str to float
        The other axes.
    tables : dict of str to array
        "restitution" and "impulse_ratio" on the grid of `axes`.
    """

    axes: Mapping[str, Array]
    fixed: Mapping[str, float]
    tables: Mapping[str, Array]

    def __call__(self, **point: float) -> dict[str, float]:
        """Return restitution and ratio of tangential over normal impulse at a point of the axes.

        Parameters
        ----------
        **point : float
            One number for each of `axes`, in its unit.

        Raises
        ------
        InputError
            If an axis is missing, unknown, or its number is beyond the grid.
        """
        if point.keys() != self.axes.keys():
            named = ", ".join(self.axes) or "no arguments"
            raise InputError(f"point: expected {named}, got {', '.join(point) or 'none'}")
        places = []
        for name, values in self.axes.items():
            x = validate_number(name, point[name])
            if not values[0] <= x <= values[-1]:
                raise InputError(f"{name}: the law holds from {values[0]:g} to {values[-1]:g}, got {x:g}")
            places.append(float(np.interp(x, values, np.arange(len(values)))))
        return {name: _interpolated(table, places) for name, table in self.tables.items()}

    @property
    def error(self) -> dict[str, float]:
        """Largest error of interpolation, by table: each inner value of the grid against that between its neighbours.

        The grid is twice as coarse there, so the error between its points is about a quarter, where tables are smooth;
        nan if no axis has three values. Where the number of contacts changes, restitution has kinks.
        """
        errors = {}
        for name, table in self.tables.items():
            worst = [np.nan]
            for axis, values in enumerate(self.axes.values()):
                if len(values) > 2:
                    along = np.moveaxis(table, axis, 0)
                    share = ((values[1:-1] - values[:-2]) / (values[2:] - values[:-2])).reshape(
                        -1, *[1] * (along.ndim - 1)
                    )
                    between = (1 - share) * along[:-2] + share * along[2:]
                    worst.append(float(abs(along[1:-1] - between).max()))
            errors[name] = float(np.nanmax(worst)) if len(worst) > 1 else float("nan")
        return errors

    def source(self) -> str:
        """Python program with the table and a function `rebound`, to paste into a rigid code; it needs no package.

        Raises
        ------
        InputError
            If no axis varies.
        """
        if not self.axes:
            raise InputError("axes: expected one that varies; of a single impact take the numbers themselves")
        said = [f"Valid for {axis} from {v[0]:g} to {v[-1]:g}" for axis, v in self.axes.items()]
        said += [f"all at {axis} {value:g}" for axis, value in self.fixed.items()]
        said += [f"largest error of {name} on every second point: {x:.2g}" for name, x in self.error.items()]
        return _PROGRAM.format(
            count=int(np.prod([len(values) for values in self.axes.values()])),
            about="\n".join(f"{line}." for line in said),
            axes={axis: _rounded(values) for axis, values in self.axes.items()},
            tables={name: _rounded(table) for name, table in self.tables.items()},
            arguments=", ".join(self.axes),
            names=" and ".join(name.replace("_", " ") for name in self.tables),
        )


def _rounded(values: Array) -> list[object]:
    """Numbers of a table with the digits that a program holds."""
    found: list[object] = [_rounded(v) if isinstance(v, np.ndarray) else float(f"{v:.{_DIGITS}g}") for v in values]
    return found


def _interpolated(table: Array, places: list[float]) -> float:
    """Value between the points of a table, at places in steps of its axes."""
    lower = [min(int(place), n - 2) for place, n in zip(places, table.shape, strict=True)]
    total = 0.0
    for corner in itertools.product((0, 1), repeat=len(places)):
        shares = [place - low if k else 1 - (place - low) for k, place, low in zip(corner, places, lower, strict=True)]
        total += float(np.prod(shares)) * float(table[tuple(low + k for low, k in zip(lower, corner, strict=True))])
    return total
