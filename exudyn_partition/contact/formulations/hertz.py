"""Contact at a point by Hertz's law, for contacts that are smaller than the facets around them.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...algebra.products import dense
from ...prediction.point_contact import PointContact
from ...support.arrays import Array
from ...support.attributes import FoundOnce
from ..law import Forces, Law, Places, RowDirections
from ..spot_gaps import SpotGaps

WIDEST = 0.2  # radius of contact by the effective radius of the surfaces, up to which the law is Hertz's
LEFT_OUT = [
    "how pressure is spread over the contact: Hertz's law stands for that, whether facets resolve it or not, with "
    f"radii that are small beside those of the surfaces (up to {WIDEST:g} of them)",
    "the residual flexibility between this contact and those of other formulations on the same body",
]
_STIFFEST = 0.25  # share of Hertz's own compliance there, that is left at least beside that of the bodies
_SETTLED, _MOST = 1e-14, 100  # relative change of the last step of Newton's method, and most steps
_SAME = 1e-12  # relative change of a force that is none
_NOT_MOVED = np.zeros(1)


class HertzCurve:
    """Force by approach of two bodies at a point: d = f P + k P^(2/3), up to a largest force, and a line beyond.

    Parameters
    ----------
    series : float
        f, flexibility of the bodies without that of the point itself [m/N]; it may be negative.
    contact : PointContact
    share : float
        Share of the forces that is on the faces of this contact, see `spot.Spot.share`.
    """

    def __init__(self, series: float, contact: PointContact, share: float = 1.0) -> None:
        self.f, self.k = series / share, contact.yielding / math.cbrt(share) ** 2
        self.largest: float = share * contact.force(WIDEST * contact.radius)
        of_dent = 2 / 3 * self.k / math.cbrt(self.largest)
        if self.f < (_STIFFEST - 1) * of_dent:  # else the bodies would be stiffer than rigid ones
            self.largest *= math.pow(of_dent * (1 - _STIFFEST) / -self.f, 3)
            of_dent = 2 / 3 * self.k / math.cbrt(self.largest)
        self.stiffest = 1 / (self.f + of_dent)
        self._deepest = self.approach(self.largest)
        self._stored = self._curved(self.largest)

    def approach(self, force: float) -> float:
        """Approach under a force [N]: [m]."""
        if force > self.largest:
            return self._deepest + (force - self.largest) / self.stiffest
        return float(self.f * force + self.k * force ** (2 / 3))

    def _curved(self, force: float) -> float:
        return float(0.5 * self.f * force**2 + 0.4 * self.k * force ** (5 / 3))

    def force(self, approach: float) -> float:
        """Force [N] at an approach above zero [m]."""
        if approach >= self._deepest:
            return self.largest + self.stiffest * (approach - self._deepest)
        f, k = self.f, self.k
        low, high = 0.0, math.cbrt(self.largest)
        x = min(math.sqrt(approach / k), high)
        for _ in range(_MOST):
            excess = f * x**3 + k * x**2 - approach
            low, high = (low, x) if excess > 0 else (x, high)
            slope = 3 * f * x**2 + 2 * k * x
            new = x - excess / slope if slope > 0 else low
            if not low <= new <= high:
                new = (low + high) / 2
            if abs(new - x) <= _SETTLED * x:
                return float(new**3)
            x = new
        return float(x**3)

    def stored(self, force: float) -> float:
        """Energy stored under a force [J]."""
        if force <= self.largest:
            return self._curved(force)
        more = force - self.largest
        return self._stored + (self.largest + 0.5 * more) * more / self.stiffest

    def stiffness(self, force: float) -> float:
        """Derivative of the force by the approach [N/m]."""
        if force >= self.largest:
            return self.stiffest
        root = math.cbrt(force)
        return root / (self.f * root + 2 / 3 * self.k) if root else 0.0


class HertzTouch(NamedTuple):
    """Force at a point, see `point_step.Touch`."""

    on_row: Array
    settled: bool = False


class HertzStep:
    """A step of a contact at a point without friction, see `point_step.PointStep`.

    Parameters
    ----------
    law : HertzPoint
    gap : float
        [m]
    """

    def __init__(self, law: HertzPoint, gap: float) -> None:
        self._law, self._gap = law, gap

    @FoundOnce
    def _curve(self) -> HertzCurve:
        return self._law.curve(self._law.gaps.spot_stage.share or 1.0)

    def begin(self) -> HertzTouch:
        """See `PointStep`."""
        return _OPEN

    def better(self, touch: HertzTouch, moved: Array) -> HertzTouch:
        """See `PointStep`."""
        approach = -self._gap - float(moved[0])
        force, before = self._curve.force(approach) if approach > 0.0 else 0.0, float(touch.on_row[0])
        if abs(force - before) <= _SAME * force:
            return HertzTouch(touch.on_row, settled=True)
        return HertzTouch(np.array([force]))

    def forces(self, touch: HertzTouch) -> Forces:
        """See `PointStep`."""
        curve, force = self._curve, float(touch.on_row[0])
        return Forces(
            touch.on_row[None],
            np.flatnonzero(touch.on_row),
            stored=curve.stored(force),
            stiffness=lambda: np.array([[curve.stiffness(force)]]),
        )


_OPEN = HertzTouch(np.zeros(1))


class HertzPoint(Law):
    """Force of a contact at a point without friction.

    The kept shapes give the approach d of the true surfaces, as a mean over a kernel on each side. F is the residual
    flexibility under the kernels. A half-space would yield by 0.6 / (E' s) under a kernel of radius s; what remains is
    the flexibility of the bodies without that of the point. Hertz gives the latter, with k of the two surfaces:

        d = f P + k P^(2/3),    f = F + sum of sides [ - 0.6 / (E' s) + what facets miss ].

    Its potential is f P^2 / 2 + 2/5 k P^(5/3).

    Parameters
    ----------
    rows : RowDirections
    """

    def __init__(self, rows: RowDirections) -> None:
        assert isinstance(rows.gaps, SpotGaps)
        self.rows, self.gaps = rows, rows.gaps
        self._known: tuple[tuple[float, PointContact, float], HertzCurve] | None = None

    def curve(self, share: float) -> HertzCurve:
        """Force by approach at the present spots, of a share of the contact."""
        series = float(self.rows.flexibility(np.zeros(1, dtype=np.int64))[0, 0]) + self.gaps.spot_rows.lacking[0]
        key = series, self.gaps.contact, share
        if self._known is None or self._known[0] != key:
            self._known = key, HertzCurve(*key)
        return self._known[1]

    def step(self, places: Places) -> HertzStep:
        """See `point_step.PointLaw`."""
        return HertzStep(self, float(places.gap[0]))

    def answer(self, places: Places) -> Forces:
        """See `Law`."""
        step = self.step(places)
        return step.forces(step.better(step.begin(), _NOT_MOVED))

    def closed_stiffness(self, rows: RowDirections) -> Array:
        """See `Law`; that at the largest contact for which the law is Hertz's."""
        H = dense(rows.jacobian(np.zeros(1, dtype=np.int64)))
        return np.asarray(self.curve(1.0).stiffest * (H.T @ H))

    @property
    def left_out(self) -> list[str]:
        """See `Law`."""
        return LEFT_OUT

    def semi_axes(self, force: float) -> tuple[float, float]:
        """See `Law`."""
        return self.gaps.contact.semi_axes(force)
