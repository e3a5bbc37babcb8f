"""The default step of a run: one rule, by which runs choose their steps and estimates of a tolerance judge them."""

from __future__ import annotations

import math
from collections.abc import Callable

from ..support.arrays import Array

STEPS_A_PERIOD = 25  # of the truncation frequency, whose period is then 0.3 % off at most
SAFETY = 0.9  # explicit steps: at most this share of the stability limit
_STEPS_AN_IMPACT = 32  # of Hertz, ten of which are in the rise of its force
_LASTS = 2.94  # times the largest depth over the speed of approach: an impact by Hertz; by a linear spring pi
_FIRM = 10.0  # facets' sizes: a depth at which all rows are closed
_SEARCHES, _FOUND = 40, 1.05  # halvings of the depth at most, and the ratio of its bounds in the end
_AT_ONCE = 0.5  # of the rows of the largest depth, closed at a tenth of it: of flat patches all are, by Hertz a tenth
_SHARE = 0.15  # of the stability limit: steps in which flat patches gain no more than a few thousandths of energy


def resolving_step(
    gap: Array,
    rate: Array,
    mobility: float,
    press: Callable[[Array], tuple[float, int]],
    *,
    size: float,
    limit: Callable[[], float],
) -> float:
    """Step that resolves an impact [s], as the bodies' rigid motion enters it.

    The bodies' rigid masses hit the contact's own flexibility, a spring that is the stiffer the deeper: what energy it
    takes at a depth is known, so the largest depth and how long the impact lasts, of which a step is a 32nd. Modes and
    what carries a rigid surface yield too; f_cut, which resolves them, is for another rule.

    On a flat patch all rows close at once, in the middle of a step, so that energy changes by the square of the step
    over the contact's shortest period, and modes yield more than the contact does. There it is 0.15 of the stability
    limit.

    Parameters
    ----------
    gap, rate : (nc,) arrays
        Of the rows when the first of them touches [m], [m/s]; only differences of the gaps count.
    mobility : float
        Acceleration along that row by a unit force on it, of the bodies' rigid motion [1/kg].
    press : callable
        Gaps, (nc,) -> the energy stored in the contact [J], and the number of closed rows.
    size : float
        Of the facets [m].
    limit : callable
        Returns the stability limit [s].

    Returns
    -------
    float
        Infinite if the first row does not close, or nothing moves.
    """
    first = int(gap.argmin())
    if rate[first] >= 0 or mobility <= 0:
        return math.inf
    way = rate / -rate[first]
    touching = gap - gap[first]

    def pressed(depth: float) -> tuple[float, int]:
        return press(touching + depth * way)

    wanted = rate[first] ** 2 / (2 * mobility)
    firm = _FIRM * size
    deepest = firm * math.sqrt(wanted / max(pressed(firm)[0], 1e-300))  # or deeper: there all rows push
    above = deepest
    for _ in range(_SEARCHES):
        if pressed(above)[0] >= wanted:
            break
        deepest, above = above, 2 * above
    while above > _FOUND * deepest:
        middle = math.sqrt(above * deepest)
        deepest, above = (deepest, middle) if pressed(middle)[0] >= wanted else (middle, above)
    step = _LASTS * above / -rate[first] / _STEPS_AN_IMPACT
    closed, soon = pressed(above)[1], pressed(0.1 * above)[1]
    flat = closed > 3 and soon > _AT_ONCE * closed
    return _SHARE * limit() if flat else float(step)
