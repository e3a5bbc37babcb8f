"""Energy that damping takes from a body, from samples of a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from scipy.integrate import cumulative_trapezoid

from ..frames.damping import Damping
from ..support.arrays import Array
from .model import Samples

Kind = TypeVar("Kind", bound=Damping)


def has_all_steps(result: Samples) -> bool:
    """Whether there is a sample at the end of each step."""
    return 0 < result.steps < len(result.t)


def damping_work(
    result: Samples, q_t: Array, dampings: Sequence[tuple[float, Kind]], power: Callable[[Kind, Array], Array]
) -> Array:
    """Energy that damping has taken since the start of a result, (n,) [J].

    An implicit step takes the power of its mean velocity: exactly with the trapezoidal rule, to the order of its own
    damping with generalized-alpha (`results.newmark`). So this holds for modes too that the steps do not resolve, whose
    velocity turns round in each step. Powers at the ends of steps would count those several times.

    Parameters
    ----------
    result : Samples
    q_t : (n, k) array
        Velocities of the body's coordinates at the samples.
    dampings : sequence of (float, Damping)
        Each with the time from which it acted [s], in this order.
    power : callable
        Of a damping and velocities, (m, k): the power that it takes, (m,) [W].
    """
    if not dampings:
        return np.zeros(len(result.t))
    by_step = result.method == "implicit" and has_all_steps(result)
    velocities = (q_t[1:] + q_t[:-1]) / 2 if by_step else q_t
    powers = np.zeros(len(velocities))
    for since, damping in dampings:
        then = result.t[: len(powers)] >= since
        powers[then] = power(damping, velocities[then])
    if by_step:
        return np.concatenate([[0.0], np.cumsum(powers * np.diff(result.t))])
    work: Array = cumulative_trapezoid(powers, result.t, initial=0.0)
    return work
