"""The default step: runs choose their steps by this rule, and estimates of a tolerance judge steps by it.

Theory: examples/site/theory.md, "The default step".
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..support.arrays import Array

STEPS_A_PERIOD = 25  # of the truncation frequency; the error of that period is then at most 0.3 %
SAFETY = 0.9  # explicit steps: at most this share of the stability limit
_STEPS_AN_IMPACT = 32  # of Hertz; ten of them are in the rise of the force
_LASTS = 2.94  # duration of an impact by Hertz, by largest depth over approach speed; with a linear spring pi
_FIRM = 10.0  # depth at which all rows are closed, in sizes of a facet
_SEARCHES, _FOUND = 40, 1.05  # most steps of the search for the depth, and the ratio of its bounds in the end
_AT_ONCE, _SOON = 0.5, 0.1  # a patch is flat if this share of its rows closes in the first tenth of the depth
_LOST = 7e-4  # of the energy: what rows that close or open at once may change
_SHARE = 0.15  # of the stability limit: steps that resolve how the force of flat patches rings


def resolving_step(
    gap: Array,
    rate: Array,
    mobility: Callable[[Array], float],
    press: Callable[[Array], tuple[float, int]],
    *,
    size: float,
    limit: Callable[[], float],
) -> float:
    """Step that resolves the impact of two bodies in rigid motion [s].

    The rigid masses hit the flexibility of the contact, a spring that becomes stiffer with depth. The energy that the
    spring stores at each depth gives the largest depth and the duration of the impact; the step is a 32nd of that.
    Modes, and the body that carries a rigid surface, yield too. Another rule resolves them, by f_cut.

    On a flat patch all rows close at once, in the middle of a step. Let it take h, let v be the approach, and let rows
    be w v h deep at its end. It changes the energy by w^2 - w of what the contact stores at the depth v h; when rows
    open, the energy changes the other way. So the phase of the step decides, and the change is a quarter of that energy
    at most. There the step is so short that this is 0.07 % of the impact's energy, and 0.15 of the stability limit at
    most.

    Parameters
    ----------
    gap, rate : (nc,) arrays
        Gaps of the rows and their rates when the first one touches [m], [m/s]; only differences of gaps count.
    mobility : callable
        Some rows, (nc,) bool -> their mean acceleration by a unit force on their mean, of the bodies' rigid motion
        [1/kg].
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
    alone = np.arange(len(gap)) == first
    if rate[first] >= 0 or (lightness := mobility(alone)) <= 0:
        return math.inf
    way = rate / -rate[first]
    touching = gap - gap[first]

    def pressed(depth: float) -> tuple[float, int]:
        return press(touching + depth * way)

    wanted = rate[first] ** 2 / (2 * lightness)
    firm = _FIRM * size
    deepest = firm * math.sqrt(wanted / max(pressed(firm)[0], 1e-300))  # or deeper, for there all rows push
    above = deepest
    for _ in range(_SEARCHES):
        if pressed(above)[0] >= wanted:
            break
        deepest, above = above, 2 * above
    while above > _FOUND * deepest:
        middle = math.sqrt(above * deepest)
        deepest, above = (deepest, middle) if pressed(middle)[0] >= wanted else (middle, above)
    depth = _SOON * above
    closed, soon = pressed(above)[1], pressed(depth)[1]
    if closed > 3 and soon > _AT_ONCE * closed:
        at_once = touching + depth * way < 0.0
        stored = press(np.where(at_once, depth * way, size))[0]
        energy = float(rate[at_once].mean()) ** 2 / (2 * mobility(at_once))
        return min(depth / -float(rate[first]) * math.sqrt(4 * _LOST * energy / stored), _SHARE * limit())
    return float(_LASTS * above / -rate[first] / _STEPS_AN_IMPACT)
