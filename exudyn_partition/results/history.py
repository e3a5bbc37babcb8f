"""Histories of a run over time, to compare, plot and store."""

from __future__ import annotations

import functools
import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..support.archive import check_sizes, read_member
from ..support.arrays import Array
from ..support.attributes import no_attribute
from ..support.checks import validate_array, validate_file, validate_number, validate_path, validate_text
from ..support.files import replacing

_FORMAT = 1
_OF_FRICTION: dict[str, tuple[int, ...]] = {"tangential_force": (3,), "dissipated": ()}  # with the shape of a sample
# Errors of NumPy and zipfile for a file that is not a history.
_DAMAGE = (OSError, EOFError, KeyError, RuntimeError, TypeError, ValueError, zipfile.BadZipFile, zlib.error)


def at_times(t: Array, means: Array) -> Array:
    """Values at times, from means over the interval before each time.

    Parameters
    ----------
    t : (n,) array
        Times [s].
    means : (n, ...) array
        Entry i is the mean from t[i - 1] to t[i]; entry 0 is not used.

    Returns
    -------
    (n, ...) array
        Mean over the two intervals beside each time; at the ends, over the only one. Its integral by the trapezoidal
        rule is that of the means.
    """
    if len(t) < 2:
        return means
    dt = np.diff(t).reshape(-1, *[1] * (means.ndim - 1))
    integral = means[1:] * dt
    return np.concatenate([means[1:2], (integral[:-1] + integral[1:]) / (dt[:-1] + dt[1:]), means[-1:]])


_MEANT = {  # names that other libraries and a Result have
    "time": "t, the times of the samples [s]",
    "times": "t, the times of the samples [s]",
    "time_s": 'info["time_s"], the run time [s]',
    "forces": "force, the contact force [N]",
    "velocities": "velocity, a dict by the names of points",
}


@dataclass(frozen=True, eq=False)
class History:
    """Contact force and velocities of one run.

    Parameters
    ----------
    t : (n,) array
        Time [s], ascending; at least one sample.
    force : (n,) array
        Total normal contact force [N], >= 0.
    velocity : dict of str to (n, 3) array
        Velocities of named points [m/s].
    info : dict
        Data of the run, such as `time_s`, `dofs`, `step_s` and versions; JSON types.
    tangential_force : (n, 3) array, optional
        Sum of the tangential forces on the slave in space [N]; None without friction.
    dissipated : (n,) array, optional
        Energy that friction has taken since the start [J]; None without friction.

    Raises
    ------
    InputError
        If there is no sample, a number is not finite, times do not ascend, or lengths differ.
    """

    t: Array
    force: Array
    velocity: Mapping[str, Array]
    info: dict[str, Any] = field(default_factory=dict)
    tangential_force: Array | None = None
    dissipated: Array | None = None

    if not TYPE_CHECKING:  # for type checkers it would be every attribute

        def __getattr__(self, name: str) -> object:
            """Say what is meant by an attribute that is not there."""
            raise no_attribute(self, name, _MEANT)

    def __post_init__(self) -> None:
        t = validate_array("t", self.t, (None,))
        if not len(t):
            raise InputError("t: expected at least one sample, got none; the run kept nothing")
        if (np.diff(t) < 0).any():
            i = int((np.diff(t) < 0).argmax())
            raise InputError(f"t: expected times that ascend, got {t[i + 1]:.6g} s after {t[i]:.6g} s")
        if not isinstance(self.velocity, Mapping):
            raise InputError(
                f"velocity: expected a dict of names and (n, 3) arrays, got {type(self.velocity).__name__}"
            )
        if not isinstance(self.info, dict):
            raise InputError(f"info: expected a dict, got {type(self.info).__name__}")
        velocity = {
            validate_text("velocity", name): validate_array(name, v, (len(t), 3)) for name, v in self.velocity.items()
        }
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "force", validate_array("force", self.force, (len(t),)))
        object.__setattr__(self, "velocity", velocity)
        for name, columns in _OF_FRICTION.items():
            if getattr(self, name) is not None:
                value = validate_array(name, getattr(self, name), (len(t), *columns))
                object.__setattr__(self, name, value)

    @property
    def impulse(self) -> float:
        """Impulse of the contact force [N s], by the trapezoidal rule."""
        return float(np.trapezoid(self.force, self.t))

    @property
    def peak_force(self) -> float:
        """Largest contact force [N]."""
        return float(self.force.max())

    @property
    def contact_duration(self) -> float:
        """Time with a contact force, summed over sub-impacts [s]."""
        in_contact = self.force > 1e-6 * max(self.peak_force, 1e-300)
        if len(self.t) < 2:
            return 0.0
        return float(np.gradient(self.t, np.arange(len(self.t)))[in_contact].sum())  # half the steps on both sides

    def until(self, end_time: float) -> History:
        """Return the part up to `end_time` [s].

        Raises
        ------
        InputError
            If there is no sample until then.
        """
        end_time = validate_number("end_time", end_time, "a time in s")
        keep = self.t <= end_time + 1e-9 * abs(end_time)
        if not keep.any():
            begin = f"{self.t[0]:.6g} s, where the history begins"
            raise InputError(f"end_time: expected at least {begin}, got {end_time:.6g} s")
        velocity, friction = ({k: v[keep] for k, v in of.items()} for of in (self.velocity, self._of_friction()))
        return History(self.t[keep], self.force[keep], velocity, self.info, **friction)

    def _of_friction(self) -> dict[str, Array]:
        """What there is of friction, by its name."""
        found = {name: getattr(self, name) for name in _OF_FRICTION}
        return {name: value for name, value in found.items() if value is not None}

    def save(self, path: str | Path) -> None:
        """Write to an npz file at `path`; no ending is added to the name.

        Times are written in double precision, all else in single precision where that holds it.

        Raises
        ------
        InputError
            If no file can be written there, or JSON cannot hold `info`.
        OutputError
            If the disk is full or protected; an old file is kept.
        """
        try:
            info = json.dumps(self.info)
        except (TypeError, ValueError) as error:
            raise InputError(f"info: expected text, numbers, lists and dicts, which JSON can hold: {error}") from error
        named = {f"velocity_{k}": v for k, v in self.velocity.items()} | self._of_friction()
        arrays: dict[str, Any] = {k: _single(v) for k, v in named.items()}
        with replacing(path) as file:
            np.savez_compressed(file, format=_FORMAT, t=self.t, force=_single(self.force), info=info, **arrays)

    @classmethod
    def load(cls, path: str | Path) -> History:
        """Read what `save` wrote to `path`.

        Raises
        ------
        InputError
            If the file is missing, damaged, or of another format.
        """
        path = validate_path("path", path)
        validate_file("path", path)
        try:
            with path.open("rb") as file, zipfile.ZipFile(file) as archive:
                check_sizes(archive, path.stat().st_size)
                # By the full names of members: np.load takes "a.npy" for the member of "a".
                names = [name.removesuffix(".npy") for name in archive.namelist()]
                read = functools.partial(read_member, archive=archive, kind=zipfile.ZIP_DEFLATED)
                if "format" in names and int(read("format")) == _FORMAT:
                    named = {k.removeprefix("velocity_"): read(k) for k in names if k.startswith("velocity_")}
                    velocity = {name: array.astype(float) for name, array in named.items()}
                    friction = {name: read(name).astype(float) for name in _OF_FRICTION if name in names}
                    info = json.loads(str(read("info")))
                    return cls(read("t"), read("force").astype(float), velocity, info, **friction)
        except _DAMAGE as error:
            raise InputError(
                f"path: {path} is no history, or a damaged one. Restore it from a copy, or compute and save it again"
            ) from error
        raise InputError(f"path: {path} is no history of format {_FORMAT}; compute and save it again")


def _single(values: Array) -> Array:
    """Values in single precision, if that holds them to its round-off: no overflow, and no underflow of all."""
    with np.errstate(over="ignore", under="ignore"):
        single = values.astype(np.float32)
    off = abs(single - values).max(initial=0.0)
    return single if off <= np.finfo(np.float32).eps * abs(values).max(initial=0.0) else values
