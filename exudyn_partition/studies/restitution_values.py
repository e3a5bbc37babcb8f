"""What a restitution map holds: the grid, the quantities on it, tables, figures, files, and the law that follows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..present.plot_input import axes_of
from ..support.archive import Format
from ..support.arrays import Array
from ..support.checks import check_floats, read_only, validate_choice
from ..support.foreign import Axes, DataFrame
from ..support.optional import require
from .free_impact import QUANTITIES
from .restitution_law import RestitutionLaw

AXES = {"place": "", "speed": "m/s", "angle": "rad", "friction": ""}
_MARKERS = "os^Dv<>p"


@dataclass(frozen=True, eq=False)
class RestitutionMap:
    """Impacts on a grid, from `restitution_map`.

    Parameters
    ----------
    place, speed, angle, friction : (n,) arrays
        Axes of the grid, ascending: what the function of bodies was called with, [m/s], [rad], coefficient.
    values : dict of str to (n_place, n_speed, n_angle, n_friction) array
        - "restitution": Newton's coefficient, of the normal velocities of rigid bodies with the same momenta, at the
          centre of the contact force; along the normal of the start, which turns by slide over radius where two curved
          surfaces slide along each other: then it is off by the order of that turn times the tangent of the angle;
        - "tangential_restitution": the same along the surface, -1 where nothing holds it; nan without angle;
        - "impulse_ratio": tangential over normal impulse, positive against the motion;
        - "centre_tangential": tangential velocity of the first body's centre of mass, against that of the second one,
          after over before, as it is measured; nan without angle;
        - "rebound_angle": of the first body's centre of mass from the normal, against that of the second one [rad];
        - "spin": of the first body about the normal cross the direction along the surface [rad/s];
        - "contacts": number of contacts; "contact_time": their sum [s]; "span": from the first to the last [s];
        - "peak_force" [N], "impulse": of the normal force [N s];
        - shares of the energy of the start: "rigid_share" of rigid motion, "vibration_first" and "vibration_second" of
          each body, "plastic_share" and "friction_share", "contact_share" that residual stress keeps where a body has
          yielded; "balance": what their sum is above 1;
        - "over": 1 if no contact can follow.
    info : dict
        What it was computed with; "new": impacts that were not in the file; "compiled": a bool array of the shape of
        the values, True where compiled steps ran the impact.
    """

    place: Array
    speed: Array
    angle: Array
    friction: Array
    values: Mapping[str, Array]
    info: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in AXES:
            check_floats(name, getattr(self, name), (None,))
            if not len(getattr(self, name)) or (np.diff(getattr(self, name)) <= 0).any():
                raise InputError(f"{name}: expected numbers that ascend, got {getattr(self, name)}")
            read_only(getattr(self, name))
        if not isinstance(self.values, Mapping) or self.values.keys() != QUANTITIES.keys():
            raise InputError(f"values: expected a dict of arrays named {', '.join(QUANTITIES)}")
        for name, array in self.values.items():
            if not isinstance(array, np.ndarray) or array.shape != self.shape or array.dtype != float:
                raise InputError(f"values: expected an array of floats of shape {self.shape} for {name}")
            read_only(array)
        if not isinstance(self.info, Mapping):
            raise InputError(f"info: expected a dict, got {type(self.info).__name__}")

    def __getitem__(self, name: str) -> Array:
        """Return a quantity on the grid, see `values`."""
        return self.values[validate_choice("name", name, QUANTITIES)]

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of places, speeds, angles and coefficients of friction."""
        return tuple(len(getattr(self, axis)) for axis in AXES)

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of the axes with several values."""
        return tuple(axis for axis in AXES if len(getattr(self, axis)) > 1)

    def to_dataframe(self) -> DataFrame:
        """One row an impact, with axes and quantities as columns; their names have units.

        Raises
        ------
        MissingPackageError
            If pandas is not installed: `pip install "exudyn-partition[tables]"`.
        """
        grid = np.meshgrid(*(getattr(self, axis) for axis in AXES), indexing="ij")
        columns = {_titled(axis, unit): of.ravel() for (axis, unit), of in zip(AXES.items(), grid, strict=True)}
        columns |= {_titled(name, unit): self.values[name].ravel() for name, unit in QUANTITIES.items()}
        return require("pandas").DataFrame(columns)

    def plot(self, axes: Axes = None, *, quantity: str = "restitution", over: str | None = None) -> Axes:
        """Draw a quantity over an axis of the grid, a curve for each combination of the others.

        Marks tell the number of contacts: full for one, open for several.

        Parameters
        ----------
        axes : matplotlib.axes.Axes, optional
            Default: those of a new figure.
        quantity : str
            See `values`.
        over : {"place", "speed", "angle", "friction"}, optional
            Default: the axis with the most values.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        InputError
            If a name is none of these.
        """
        quantity = validate_choice("quantity", quantity, QUANTITIES)
        over = max(AXES, key=lambda axis: len(getattr(self, axis))) if over is None else over
        at = [*AXES].index(validate_choice("over", over, AXES))
        axes, x = axes_of(axes), getattr(self, over)
        values, counts = (np.moveaxis(self.values[name], at, -1) for name in (quantity, "contacts"))
        others = [axis for axis in AXES if axis != over]
        for number, index in enumerate(np.ndindex(values.shape[:-1])):
            label = ", ".join(
                f"{axis} {getattr(self, axis)[i]:.4g}{f' {AXES[axis]}' if AXES[axis] else ''}"
                for axis, i in zip(others, index, strict=True)
                if axis in self.varied
            )
            (line,) = axes.plot(x, values[index], lw=1, label=label or None)
            marker, several = _MARKERS[number % len(_MARKERS)], counts[index] > 1
            for which, face in ((~several, line.get_color()), (several, "white")):
                axes.plot(x[which], values[index][which], marker, color=line.get_color(), mfc=face, ms=5)
        axes.set(xlabel=_titled(over, AXES[over]), ylabel=_titled(quantity, QUANTITIES[quantity]))
        if len(self.varied) > (over in self.varied):
            axes.legend(fontsize=8)
        return axes

    def save(self, path: str | Path) -> None:
        """Write to an npz file at `path`; no ending is added to the name.

        Raises
        ------
        InputError
            If no file can be written there.
        OutputError
            If the disk is full or protected; an old file is kept.
        """
        FILE.save(path, self)

    @classmethod
    def load(cls, path: str | Path) -> RestitutionMap:
        """Read what `save` wrote to `path`.

        Raises
        ------
        InputError
            If the file is missing, damaged, or of another format.
        """
        found: RestitutionMap = FILE.load(path)
        return found

    def law(self) -> RestitutionLaw:
        """Interpolate restitution and friction between the impacts: what a rigid code takes, with validity and error.

        Raises
        ------
        InputError
            If an impact made no contact.
        """
        if not (self.values["contacts"] > 0).all():
            raise InputError("values: expected a contact in each impact, but some missed; take another grid or place")
        axes = {axis: getattr(self, axis) for axis in self.varied}
        shape = tuple(len(values) for values in axes.values())
        fixed = {axis: float(getattr(self, axis)[0]) for axis in AXES if axis not in axes}
        tables = {name: self.values[name].reshape(shape) for name in ("restitution", "impulse_ratio")}
        return RestitutionLaw(axes, fixed, tables)


def _titled(name: str, unit: str) -> str:
    """Name with its unit, for columns and axes."""
    return name.replace("_", " ") + (f" [{unit}]" if unit not in ("", "1") else "")


FILE = Format("restitution map", 1, "SI (m, kg, s, N, rad)", (RestitutionMap,))
