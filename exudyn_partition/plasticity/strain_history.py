"""Plastic strain of a zone at the samples of a run."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..support.arrays import Array
from .flow import PlasticState
from .zone import PlasticZone

MOST = 1 << 26  # numbers that are kept of a run: a quarter of a gigabyte in single precision


class StrainHistory:
    """Plastic strain of a zone in a run, kept in single precision where it has changed since the time before.

    Parameters
    ----------
    zone : PlasticZone
    """

    def __init__(self, zone: PlasticZone) -> None:
        self.zone = zone
        self._times: list[float] = []
        self._kept: list[tuple[Array, Array]] = []
        self._last: PlasticState | None = None
        self._count = 0
        self._read = -1, np.zeros((len(zone), 6), dtype=np.float32)  # number of the last state that was read, and it

    @classmethod
    def of(cls, zone: PlasticZone, times: list[float], kept: list[tuple[Array, Array]]) -> StrainHistory:
        """Return the history that had these times [s], and points that flowed with their strains; see `kept`."""
        result = cls(zone)
        result._times, result._kept = times, kept
        return result

    @property
    def kept(self) -> tuple[list[float], list[tuple[Array, Array]]]:
        """Times of changes [s]; points that have flowed since the time before, (k,), and their strains, (k, 6)."""
        if self._count > MOST:
            self.numbers(np.zeros(1))
        return self._times, self._kept

    def keep(self, t: float, state: PlasticState) -> None:
        """Keep the plastic strains of a state at a time [s]; nothing if it is that of the last call."""
        if state is self._last or self._count > MOST:
            return
        while self._times and self._times[-1] >= t:  # asked for again
            self._times.pop()
            self._count -= 7 * len(self._kept.pop()[0])
            self._read = -1, np.zeros_like(self._read[1])
        now = state.strain.astype(np.float32)
        flowed = np.flatnonzero((now != self._state(len(self._kept) - 1)).any(axis=1))
        self._times.append(t)
        self._kept.append((flowed, now[flowed]))
        self._last, self._count = state, self._count + 7 * len(flowed)

    def numbers(self, t: Array) -> Array:
        """Numbers of the states at some times, (n,) int, for `strain`.

        Raises
        ------
        InputError
            If there were too many states for the memory.
        """
        if self._count > MOST:
            raise InputError(
                "result: plastic flow changed in too many samples of this run to keep all of its strains. Give "
                "solve_dynamic a longer sample_period, or a shorter time"
            )
        return np.maximum(np.searchsorted(self._times, t, side="right") - 1, 0)

    def strain(self, number: int) -> Array:
        """Plastic strains of a state, (g, 6), in Mandel's notation."""
        return self._state(number).astype(float)

    def _state(self, number: int) -> Array:
        """Plastic strains of a state, (g, 6), zero before the first: by the changes since the one read last."""
        last, strain = self._read
        if number < last:
            last, strain = -1, np.zeros_like(strain)
        for flowed, kept in self._kept[last + 1 : number + 1]:
            strain[flowed] = kept
        self._read = number, strain
        return strain
