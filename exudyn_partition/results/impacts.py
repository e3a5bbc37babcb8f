"""Impacts in the history of a contact force, how the force rings in them, and means that ringing does not reach."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..support.arrays import Array
from ..support.optional import require

_TRACE = 1e-10  # of the largest force: what round-off makes of bodies that lie on each other
_LOOKED_AT = 200  # samples beside an impact, until its surface has opened
_PROMINENT = 0.2  # of an impact's mean force: how far a maximum of the force stands out
_MAXIMA = 3  # fewest in an impact that rings
_FAST = 1.5  # of the shortest resolved period: oscillations of longer periods are those of the bodies
_OVERSHOOT = 0.2  # of the largest mean over the shortest resolved period: how far the peak is above it
_LONG_FOR_A_SPIKE, _NARROW = 3.0, 0.5  # shortest resolved periods: of an impact, and of a spike that has no place in it
_SAMPLES = 4  # fewest in the shortest resolved period, to judge a force by them
_PERIODS = 2  # of the ringing, over which means are taken
_PASSED = 10  # fewest facets, and maxima of the force, that tell that these belong together
_SMOOTHED = 3  # facets that pass within the window of means about which a force oscillates
_LONG = 2  # facets that pass within an opening, above which bodies have left each other
_NEAR = 2  # largest ratio of a frequency to that of facets, either way


@dataclass(frozen=True)
class SubImpact:
    """A time of uninterrupted contact, or several that follow each other soon.

    Parameters
    ----------
    start, end : float
        [s]
    impulse : float
        Of the total normal force [N s].
    peak : float
        Largest total normal force [N].
    parts : int
        Number of times of uninterrupted contact.
    speed_before, speed_after : float or None
        Approach at `start` and separation at `end` along the contact's normal [m/s], see `PartitionContact.impacts`;
        None if not known.
    """

    start: float
    end: float
    impulse: float
    peak: float
    parts: int = 1
    speed_before: float | None = None
    speed_after: float | None = None

    @property
    def mean_force(self) -> float:
        """Impulse over the time from start to end [N]; zero if it is no time."""
        return self.impulse / (self.end - self.start) if self.end > self.start else 0.0

    @property
    def restitution(self) -> float | None:
        """Newton's coefficient of restitution e, separation over approach; None if these are not known.

        It is None too without an approach, as where another contact pushes a body on.
        """
        if self.speed_before is None or self.speed_after is None or self.speed_before <= 0:
            return None
        return self.speed_after / self.speed_before


@dataclass(frozen=True)
class Ringing:
    """A contact force that oscillates faster than the bodies' bases resolve.

    Parameters
    ----------
    start, end : float
        Of the impact in which the force rises highest above its mean [s].
    period : float
        Median time between maxima of the force there [s]; of a single spike, the shortest that bases resolve.
    window : float
        Two periods, over which means are taken [s].
    peak : float
        Largest force there [N].
    mean : float
        Largest mean over `window` there [N].
    """

    start: float
    end: float
    period: float
    window: float
    peak: float
    mean: float

    def beside(self, limit: float) -> str:
        """Return what the ringing means for a peak that is beyond a limit of the force [N], in a sentence."""
        beyond = "and these are beyond it too" if self.mean > limit else "below it, so that this may be a false alarm"
        return (
            f"The peak is one of a force that rings: means over {self.window:.3g} s reach {self.mean:.4g} N, {beyond}"
        )


def closed_spans(force: Array) -> list[tuple[int, int]]:
    """First and last sample with a force, of each time of uninterrupted contact.

    Times with no more than a trace of the largest force of all are none: bodies that lie on each other touch by
    round-off.
    """
    padded = np.zeros(len(force) + 2, dtype=bool)
    np.greater(force, 0, out=padded[1:-1])
    changes = np.flatnonzero(padded[1:] != padded[:-1])
    firsts, lasts = changes[::2], changes[1::2] - 1
    if len(firsts) > 1:
        real = np.maximum.reduceat(force, firsts) > _TRACE * force.max()
        firsts, lasts = firsts[real], lasts[real]
    return [*zip(firsts.tolist(), lasts.tolist(), strict=True)]


def joined(spans: list[tuple[float, float]], apart: float) -> list[list[int]]:
    """Numbers of the spans, (start, end), that make one impact: such as are at most `apart` from each other."""
    groups: list[list[int]] = []
    for i, (start, _) in enumerate(spans):
        if groups and start - spans[i - 1][1] <= apart:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def running_mean(t: Array, force: Array, window: float) -> Array:
    """Mean of a force over `window` [s] around each time, (n,) [N], or over the part of it within the history.

    Parameters
    ----------
    t, force : (n,) arrays
        [s, N]
    window : float
        [s]
    """
    if len(t) < 2:
        return force
    total = np.zeros(len(t))
    np.cumsum((t[1:] - t[:-1]) * (force[1:] + force[:-1]) / 2.0, out=total[1:])
    low, high = np.maximum(t - window / 2, t[0]), np.minimum(t + window / 2, t[-1])
    mean: Array = (np.interp(high, t, total) - np.interp(low, t, total)) / (high - low)
    return mean


def ringing(t: Array, force: Array, resolved: float) -> Ringing | None:
    """How a contact force rings, measured from its history; None if it does not, or samples are too few to tell.

    An impact rings if its peak is a fifth above the largest mean over the shortest resolved period, and if its force
    has three maxima or more, which follow each other faster than the bases resolve. Damping may leave a single spike of
    less than half that period, in an impact of three. A pulse is the whole impact, however short it is.

    Parameters
    ----------
    t, force : (n,) arrays
        [s, N]
    resolved : float
        Shortest period that both bodies' bases resolve, 1 / f_cut [s]. Contacts within it are one impact.
    """
    spans, found = closed_spans(force), []
    smooth = running_mean(t, force, resolved)
    for group in joined([(t[first], t[last]) for first, last in spans], resolved):
        around = slice(max(spans[group[0]][0] - 1, 0), spans[group[-1]][1] + 2)
        time, part = t[around], force[around]
        if (time[1:] - time[:-1]).max(initial=0.0) * _SAMPLES > resolved:
            continue
        level = float(smooth[around].max())
        if part.max() < (1 + _OVERSHOOT) * level:
            continue
        padded = np.r_[0.0, part, 0.0]
        prominence = _PROMINENT * np.trapezoid(part, time) / np.ptp(time)
        maxima = require("scipy.signal").find_peaks(padded, prominence=prominence)[0] - 1
        period = float(np.median(np.diff(time[maxima]))) if len(maxima) >= _MAXIMA else np.inf
        if period > _FAST * resolved:
            if np.ptp(time) < _LONG_FOR_A_SPIKE * resolved or _width(time, part, level) > _NARROW * resolved:
                continue
            period = resolved
        window = _PERIODS * period
        mean = float(running_mean(t, force, window)[around].max())
        found.append(Ringing(float(time[0]), float(time[-1]), period, window, float(part.max()), mean))
    return max(found, key=lambda rings: rings.peak - rings.mean, default=None)


def _width(t: Array, force: Array, level: float) -> float:
    """How long a force is above the middle between its peak and a level, around the peak [s]."""
    top = int(force.argmax())
    low = force <= (force[top] + level) / 2
    before, after = np.flatnonzero(low[:top]), np.flatnonzero(low[top:])
    return float(t[top + after[0] if after.size else -1] - t[before[-1] if before.size else 0])


def crossing(t: Array, gap: Callable[[int], float] | None, sample: int, other: int) -> float:
    """Time at which a gap vanishes [s], from a sample in contact towards another one, which is in contact or none.

    Where the gap is not known, or stays closed on the way, it is that of the next sample, which has no force.
    """
    way = 1 if other > sample else -1
    if gap is not None:
        for inside in range(sample, sample + way * _LOOKED_AT, way):
            if inside + way == other or gap(inside) > 0:
                break
            if gap(inside + way) > 0:
                share = gap(inside) / (gap(inside) - gap(inside + way))
                return float(t[inside] + share * (t[inside + way] - t[inside]))
    return float(t[min(max(sample + way, 0), len(t) - 1)])


def at_border(t: Array, free: Array, value: Callable[[int], float], time: float, way: int) -> float:
    """Value at a time where contact starts, `way` -1, or ends, 1, by a line through two samples without a force.

    Parameters
    ----------
    t : (n,) array
        [s]
    free : (n,) bool array
        Samples without a force; the first one from `time` on, along `way`, is one of them.
    value : callable
        Of a sample.
    time : float
        [s]
    way : {-1, 1}
    """
    outside = int(np.searchsorted(t, time)) if way > 0 else int(np.searchsorted(t, time, side="right")) - 1
    for other in (outside - way, outside + way):
        if 0 <= other < len(t) and free[other]:
            share = float((time - t[outside]) / (t[other] - t[outside]))
            return value(outside) + share * (value(other) - value(outside))
    return value(outside)


def line_at(times: Array, t: Array, values: Array, weights: Array) -> Array:
    """Values at some times, (k, m), of a line through values, (n, m), at t, (n,), and not beyond the range of these.

    The line has the least squares of its distances, each counted by its weight, (n,).
    """
    share = weights / weights.sum()
    middle, mean = share @ t, share @ values
    spread = share @ (t - middle) ** 2
    slope = (share * (t - middle)) @ values / spread if spread > 0.0 else np.zeros_like(mean)
    line: Array = np.clip(mean + np.outer(times - middle, slope), values.min(axis=0), values.max(axis=0))
    return line


def rings_by_facets(t: Array, force: Array, rate: float) -> float | None:
    """Frequency of a force that oscillates as facets pass by [Hz]; None if it does not, or for another reason.

    It oscillates by a fifth of its mean and more, about as often as facets pass, for ten periods and more. A contact
    that opens for longer than two facets pass is a real one: bodies have left each other.

    Parameters
    ----------
    t, force : (n,) arrays
        [s, N]
    rate : float
        Facets that pass each second [1/s].
    """
    spans = closed_spans(force)
    if not spans or rate * (t[spans[-1][1]] - t[spans[0][0]]) < _PASSED:
        return None
    part = slice(spans[0][0], spans[-1][1] + 1)
    longest = max((t[after[0]] - t[before[1]] for before, after in itertools.pairwise(spans)), default=0.0)
    ripple = force[part] - running_mean(t[part], force[part], _SMOOTHED / rate)
    deviation = float(np.sqrt(np.mean(ripple**2)))
    if longest * rate > _LONG or deviation < _OVERSHOOT * force[part].mean():
        return None
    maxima = require("scipy.signal").find_peaks(ripple, prominence=deviation)[0]
    if len(maxima) < _PASSED:
        return None
    frequency = 1 / float(np.median(np.diff(t[part][maxima])))
    return frequency if rate / _NEAR <= frequency <= rate * _NEAR else None
