"""Energy that damping takes from a body, from samples of a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from ..frames.damping import Damping
from ..support.arrays import Array
from ..support.optional import require
from .model import Samples

Kind = TypeVar("Kind", bound=Damping)


def has_all_steps(result: Samples) -> bool:
    """Whether there is a sample at the end of each step."""
    return 0 < result.steps < len(result.t)


def damping_work(
    result: Samples,
    q: Array,
    q_t: Array,
    dampings: Sequence[tuple[float, Kind]],
    power: Callable[[Kind, Array], Array],
) -> Array:
    """Energy that damping has taken since the start of a result, (n,) [J].

    It is what the steps take, if each has a sample. Damping forces of an explicit step are those of the velocity half a
    step before, v, and act on the velocity at its end, w: they take v' D w. So the balance closes with the kinetic
    energy of the velocities in the middle of steps and the strain energy x' K y / 2 of their ends. An implicit step
    takes the power of its mean velocity: exactly with the trapezoidal rule, to the order of its own damping with
    generalized-alpha (`results.newmark`). So this holds for modes too that the steps do not resolve, whose velocity
    turns round in each step. Powers at the ends of steps would count those several times.

    Parameters
    ----------
    result : Samples
    q, q_t : (n, k) arrays
        The body's coordinates and velocities at the samples.
    dampings : sequence of (float, Damping)
        Each with the time from which it acted [s], in this order.
    power : callable
        Of a damping and velocities, (m, k): the power that it takes, (m,) [W], a quadratic form.
    """
    if not dampings:
        return np.zeros(len(result.t))
    steps, whole = np.diff(result.t), has_all_steps(result)
    if result.method == "implicit" and whole:
        powers = _powers(result.t[:-1], (q_t[1:] + q_t[:-1]) / 2, dampings, power)
        return np.concatenate([[0.0], np.cumsum(powers * steps)])
    if result.method == "explicit" and whole:
        before = np.concatenate([q_t[:1], np.diff(q, axis=0) / steps[:, None]])
        mean, half = (q_t + before) / 2, (q_t - before) / 2  # v' D w of a quadratic form
        powers = _powers(result.t, mean, dampings, power) - _powers(result.t, half, dampings, power)
    else:
        powers = _powers(result.t, q_t, dampings, power)
    work: Array = require("scipy.integrate").cumulative_trapezoid(powers, result.t, initial=0.0)
    return work


def _powers(
    t: Array, velocities: Array, dampings: Sequence[tuple[float, Kind]], power: Callable[[Kind, Array], Array]
) -> Array:
    """Power of the damping that acted at times t, (n,) [W]."""
    powers = np.zeros(len(t))
    for since, damping in dampings:
        then = t >= since
        powers[then] = power(damping, velocities[then])
    return powers
