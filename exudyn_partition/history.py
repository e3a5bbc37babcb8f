"""Histories of one run: what is compared, plotted and stored."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ._checks import read_only
from .errors import InputError

Array = np.ndarray

_FORMAT = 1


def at_times(t: Array, means: Array) -> Array:
    """Values at times from means over the intervals before them.

    Parameters
    ----------
    t : (n,) array
        [s]
    means : (n, ...) array
        Entry i is the mean from t[i - 1] to t[i]; entry 0 counts for nothing.

    Returns
    -------
    (n, ...) array
        Mean over the intervals on both sides, at the ends over the one there is: the trapezoidal rule over it gives
        the integral of the means.
    """
    if len(t) < 2:
        return means
    dt = np.diff(t).reshape(-1, *[1] * (means.ndim - 1))
    integral = means[1:] * dt
    return np.concatenate([means[1:2], (integral[:-1] + integral[1:]) / (dt[:-1] + dt[1:]), means[-1:]])


@dataclass(frozen=True, eq=False)
class History:
    """Contact force and velocities of one run.

    Parameters
    ----------
    t : (n,) array
        Time [s].
    force : (n,) array
        Total normal contact force [N], >= 0.
    velocity : dict of str to (n, 3) array
        Velocities of named points [m/s].
    info : dict
        What is worth knowing of the run: `time_s`, `dofs`, `step_s`, versions; JSON types.
    """

    t: Array
    force: Array
    velocity: Mapping[str, Array]
    info: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        read_only(self.t, self.force, *self.velocity.values())
        for name, array in {"force": self.force, **self.velocity}.items():
            if len(array) != len(self.t):
                raise InputError(f"{name}: expected {len(self.t)} samples, one a time, got {len(array)}")

    @property
    def impulse(self) -> float:
        """Impulse of the contact force [N s], trapezoidal."""
        return float(np.trapezoid(self.force, self.t))

    @property
    def peak_force(self) -> float:
        """Largest contact force [N]."""
        return float(self.force.max())

    @property
    def contact_duration(self) -> float:
        """Time with a contact force, sub-impacts added [s]."""
        in_contact = self.force > 1e-6 * max(self.peak_force, 1e-300)
        if len(self.t) < 2:
            return 0.0
        return float(np.gradient(self.t, np.arange(len(self.t)))[in_contact].sum())  # half the steps on both sides

    def until(self, end_time: float) -> History:
        """Return the part up to `end_time` [s]."""
        keep = self.t <= end_time * (1 + 1e-9)
        return History(
            self.t[keep].copy(),
            self.force[keep].copy(),
            {k: v[keep].copy() for k, v in self.velocity.items()},
            self.info,
        )

    def save(self, path: str | Path) -> None:
        """Write to an npz file at `path`, in single precision but for the times."""
        arrays: dict[str, Any] = {f"velocity_{k}": v.astype(np.float32) for k, v in self.velocity.items()}
        np.savez_compressed(
            path,
            format=_FORMAT,
            t=self.t,
            force=self.force.astype(np.float32),
            info=json.dumps(self.info),
            **arrays,
        )

    @classmethod
    def load(cls, path: str | Path) -> History:
        """Read what `save` wrote to `path`.

        Raises
        ------
        InputError
            If the file is missing, or of another format.
        """
        if not Path(path).is_file():
            raise InputError(f"path: expected a history file, but there is no {path}")
        with np.load(path, allow_pickle=False) as data:
            if int(data.get("format", -1)) != _FORMAT:
                raise InputError(f"path: {path} is no history of format {_FORMAT}; compute it anew")
            velocity = {k.removeprefix("velocity_"): data[k].astype(float) for k in data if k.startswith("velocity_")}
            return cls(data["t"], data["force"].astype(float), velocity, json.loads(str(data["info"])))
