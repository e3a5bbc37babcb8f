"""Times of a run's pictures: equally spaced, and more where something happens.

An impact may take a thousandth of a run, and fall between two pictures. So each has a dozen of its own.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..results.impacts import closed_spans
from ..support.arrays import Array

_DOZEN = 12  # pictures of an impact, beside that of its peak
_MOST_DIGITS = 7
_FEWEST = 2  # when it begins and ends


def spans_of(forces: Iterable[Array], t: Array) -> list[tuple[int, int]]:
    """First and last sample with a force, of each impact of any contact, in order.

    Times in contact make one impact if they are closer to each other than the longer of them lasts.

    Parameters
    ----------
    forces : iterable of (n,) arrays
        Of each contact [N].
    t : (n,) array
        [s]
    """
    found = []
    for force in forces:
        spans: list[tuple[int, int]] = []
        for first, last in closed_spans(abs(force)):
            if spans:
                begun, ended = spans[-1]
                if t[first] - t[ended] <= max(t[ended] - t[begun], t[last] - t[first]):
                    spans[-1] = begun, last
                    continue
            spans.append((first, last))
        found += spans
    return sorted(found)


def frame_times(t: Array, forces: Iterable[Array], even: int, more: int) -> Array:
    """Times of `even` pictures that are equally spaced, and at most `more` of impacts, ascending [s].

    Each impact gets a dozen, with its peak, unless equal spacing does so already: then its peak alone. If there are too
    many for that, each gets fewer, and the strongest at least three.

    Parameters
    ----------
    t : (n,) array
        Samples of the run [s].
    forces : iterable of (n,) arrays
        Of each contact [N].
    even, more : int
    """
    forces = [abs(force) for force in forces]
    times = np.linspace(t[0], t[-1], even)
    needed: list[tuple[float, float, Array]] = []  # minus the largest force, the peak's time, all times
    for force in forces:
        for first, last in spans_of([force], t):
            peak = first + int(force[first : last + 1].argmax())
            inside = np.searchsorted(times, [t[first], t[last]])
            enough = inside[1] - inside[0] >= _DOZEN
            around = t[[max(first - 1, 0), min(last + 1, len(t) - 1)]]
            own = around[:0] if enough else np.union1d(around, np.linspace(t[first], t[last], _DOZEN - 2))
            needed.append((-float(force[peak]), float(t[peak]), own))
    needed.sort(key=lambda entry: entry[0])
    each = min(_DOZEN, more // max(len(needed), 1) - 1)
    if each < _FEWEST:
        each, needed = _FEWEST, needed[: more // (_FEWEST + 1)]
    for _, peak_time, own in needed:
        some = own[np.unique(np.linspace(0, len(own) - 1, each).astype(int))] if len(own) else own
        times = np.r_[times, peak_time, some]
    found: Array = np.unique(times)
    return found


def slow_spans(t: Array, forces: Iterable[Array], least: float) -> list[tuple[float, float]]:
    """Times of impacts that last less than `least`, with a margin, which are to be played slowly, in order [s].

    Parameters
    ----------
    t : (n,) array
        [s]
    forces : iterable of (n,) arrays
        Of each contact [N].
    least : float
        [s]
    """
    slow: list[tuple[float, float]] = []
    for first, last in spans_of(forces, t):
        margin = 0.25 * float(t[last] - t[first])
        start = max(float(t[max(first - 1, 0)]), float(t[first]) - margin)
        end = min(float(t[min(last + 1, len(t) - 1)]), float(t[last]) + margin)
        if slow and start <= slow[-1][1]:
            slow[-1] = slow[-1][0], max(end, slow[-1][1])
        else:
            slow.append((start, end))
    return [(start, end) for start, end in slow if 0 < end - start < least]


def time_digits(t: Array, factor: float) -> int:
    """Digits behind the point that tell times apart, (m,) [s], where a unit is 1 / `factor` [s]."""
    shortest = factor * float(np.diff(t).min(initial=max(np.ptp(t), 1e-2 * abs(t).max(), 1e-9)))
    return int(np.clip(np.ceil(-np.log10(shortest)), 0, _MOST_DIGITS))
