"""Friction of a contact at a point: Cattaneo's and Mindlin's partial slip for any history, by rings of springs.

The method of dimensionality reduction is exact for circular contacts of similar materials: a contact of radius a is a
row of independent springs, of stiffness E* along the normal and G* across it per length, under the profile x^2 / R.
Each spring slips by itself. So partial slip needs no case for each history of forces.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".

References
----------
V.L. Popov, M. Hess, Method of Dimensionality Reduction in Contact Mechanics and Friction, 2015, chapter 5.

R.D. Mindlin, Compliance of elastic bodies in contact, Journal of Applied Mechanics 16 (1949) 259.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...algebra.friction import OPEN, SLIP, STICK
from ...algebra.products import dense
from ...support.arrays import Array
from ..law import Forces, Law, Places, RowDirections
from ..spot_gaps import SpotGaps
from .hertz import LEFT_OUT, WIDEST, HertzCurve

_SPRINGS = 24
_INNERMOST = 1 / 30  # of the largest radius of contact: where the first spring ends
_MOST, _SETTLED = 60, 1e-13  # steps of Newton's method, and relative change of the last one
_SLIPS = 1 - 1e-9  # share of the largest tangential force with which all springs slip
_PASSES = 3  # by which normal and tangential forces settle with each other: each leaves a ten-thousandth
_ONE = np.zeros(1, dtype=np.int64)


class Held(NamedTuple):
    """Springs at a stretch of their ends.

    Parameters
    ----------
    elongations : (n, 2) array
        Of the springs [m].
    force : (2,) array
        Their sum, which opposes the way of the slave [N].
    stiffness : (2, 2) array
        Derivative of the sum by the way [N/m].
    slipping : (n,) bool array
    """

    elongations: Array
    force: Array
    stiffness: Array
    slipping: Array


class Springs:
    """Springs beneath a circular contact, by their places x from its middle; each stands for both x and -x.

    Parameters
    ----------
    radius, modulus, shear : float
        R [m], E* and G* [Pa], where 4 / G* is the sum of (2 - nu) / G of both bodies.
    """

    def __init__(self, radius: float, modulus: float, shear: float) -> None:
        self.radius, self.modulus, self.shear = radius, modulus, shear
        self.ends = WIDEST * radius * np.r_[0.0, np.geomspace(_INNERMOST, 1.0, _SPRINGS)]

    def reach(self, force: float) -> float:
        """Radius of contact under a force [N]: [m]."""
        return float((0.75 * force * self.radius / self.modulus) ** (1 / 3))

    def stiffness(self, reach: float) -> Array:
        """Tangential stiffness of the springs, (n,) [N/m], with a contact of a radius [m]; the last has all beyond."""
        ends = np.minimum(self.ends, reach)
        ends[-1] = max(ends[-1], reach)
        return np.asarray(2 * self.shear * np.diff(ends))

    def normal(self, reach: float) -> Array:
        """Normal forces of the springs, (n,) [N]."""
        ends = np.minimum(self.ends, reach)
        ends[-1] = max(ends[-1], reach)
        return np.asarray(2 * self.modulus / self.radius * np.diff(reach**2 * ends - ends**3 / 3))

    def normal_slope(self, reach: float) -> Array:
        """Derivative of the normal forces of springs by their sum, (n,)."""
        covered = self.stiffness(reach)
        return np.asarray(covered / covered.sum()) if reach else covered

    def held(self, elongations: Array, k: Array, bounds: Array) -> Held:
        """Springs of stiffness k, (n,) [N/m], that would have elongations, (n, 2) [m], by forces up to bounds, (n,)."""
        size = np.maximum(np.sqrt(np.einsum("nk,nk->n", elongations, elongations)), 1e-300)
        trial = k * size
        slipping = trial > bounds
        share = np.divide(bounds, trial, out=np.ones(len(k)), where=slipping)
        direction = elongations / size[:, None]
        turning = np.einsum("n,nk,nl->kl", np.where(slipping, k * share, 0.0), direction, direction)
        stays = elongations * share[:, None]
        return Held(stays, k @ stays, np.eye(2) * float(k @ share) - turning, slipping)


class HertzFriction(Law):
    """Forces of a contact at a point with Coulomb friction, see `hertz.HertzPoint` for the normal one.

    The tangential way of the kernels, less what the tangential flexibility of the bodies yields, stretches springs.
    From the flexibility under the kernels a half-space's is taken away, (2 - nu) / (2 (1 - nu)) times that along the
    normal. Normal forces do not move the springs themselves, as in bodies of the same material.

    Parameters
    ----------
    rows : RowDirections
    """

    elastic, memory = False, 2 * _SPRINGS

    def __init__(self, rows: RowDirections) -> None:
        assert isinstance(rows.gaps, SpotGaps)
        self.rows, self.gaps, contact = rows, rows.gaps, rows.gaps.contact
        self.springs = Springs(contact.radius, contact.modulus, rows.gaps.shear)
        self._known: tuple[Array, HertzCurve, Array] | None = None

    def fresh(self, rows: RowDirections) -> Law:
        """See `Law`."""
        return HertzFriction(rows)

    def _series(self) -> tuple[HertzCurve, Array]:
        """Force by approach, and flexibility in three directions without that of the point, (3, 3) [m/N]."""
        F, lacking = self.rows.flexibility(_ONE), self.gaps.spot_rows.lacking
        if self._known is None or not np.array_equal(self._known[0], F):
            series = F + np.diag([lacking[0], lacking[1], lacking[1]])
            self._known = F, HertzCurve(float(series[0, 0]), self.gaps.contact), series
        return self._known[1:]

    def answer(self, places: Places) -> Forces:
        """See `Law`."""
        curve, F = self._series()
        gap, mu, last = float(places.gap[0]), float(places.mu[0]), places.last[0]
        before = self.springs.stiffness(self.springs.reach(last[0]))
        elongations = _turned(places.memory[0].reshape(-1, 2), before, last[1:])
        T = last[1:]
        for _ in range(_PASSES):
            approach = -gap - float(F[0, 1:] @ T)
            if approach <= 0.0:
                return self._opened()
            P = curve.force(approach)
            reach = self.springs.reach(P)
            k, bounds = self.springs.stiffness(reach), mu * self.springs.normal(reach)
            # Where the contact grows, new parts of springs have no elongation.
            kept = elongations * np.divide(np.minimum(before, k), k, out=np.zeros(len(k)), where=k > 0)[:, None]
            way = places.way[0] + F[1:, 0] * (P - last[0])
            stretch, held = self._stretched(kept, k, bounds, F[1:, 1:], way, last[1:])
            T = -held.force
        lost, mean = before @ (elongations**2).sum(axis=1) - k @ (held.elongations**2).sum(axis=1), (T + last[1:]) / 2
        taken, size = 0.5 * lost - mean @ stretch, mean @ mean
        status = SLIP if np.linalg.norm(T) >= _SLIPS * mu * P else STICK
        across = 0.5 * (T @ F[1:, 1:] @ T + k @ (held.elongations**2).sum(axis=1)) + P * (F[0, 1:] @ T)
        return Forces(
            np.array([[P, *T]]),
            _ONE,
            np.array([status], dtype=np.int8),
            -taken * mean[None] / size if size > 0 else np.zeros((1, 2)),
            memory=held.elongations.reshape(1, -1),
            stored=curve.stored(P) + float(across),
            stiffness=lambda: self._stiffness(curve.stiffness(P), mu * self.springs.normal_slope(reach), held, F),
        )

    def _opened(self) -> Forces:
        """Answer without contact."""
        none = np.zeros((1, 3))
        return Forces(
            none, _ONE[:0], np.array([OPEN], dtype=np.int8), none[:, 1:], memory=np.zeros((1, self.memory)), stored=0.0
        )

    @staticmethod
    def _stiffness(normal: float, bounds: Array, held: Held, F: Array) -> Array:
        """See `Forces`, (3, 3) [N/m]; `bounds` are derivatives of the springs' largest forces by the normal force."""
        K, eased = np.zeros((3, 3)), np.linalg.inv(np.eye(2) + held.stiffness @ F[1:, 1:])
        K[0, 0], K[1:, 1:] = normal, eased @ held.stiffness
        direction = held.elongations / np.maximum(np.linalg.norm(held.elongations, axis=1), 1e-300)[:, None]
        K[1:, 0] = -normal * eased @ ((held.slipping * bounds) @ direction - held.stiffness @ F[1:, 0])
        return K

    def _stretched(
        self, elongations: Array, k: Array, bounds: Array, F: Array, way: Array, last: Array
    ) -> tuple[Array, Held]:
        """How far springs are stretched by a way of the kernels, (2,) [m], with forces before of `last`, (2,) [N]."""
        stretch = way.copy()
        held = self.springs.held(elongations + stretch, k, bounds)
        scale = float(np.abs(elongations).max(initial=0.0) + np.abs(way).max()) or 1.0
        for _ in range(_MOST):
            off = stretch - way + F @ (held.force + last)
            step = np.linalg.solve(np.eye(2) + F @ held.stiffness, off)
            stretch = stretch - step
            held = self.springs.held(elongations + stretch, k, bounds)
            if np.abs(step).max() <= _SETTLED * scale:
                break
        return stretch, held

    def closed_stiffness(self, rows: RowDirections) -> Array:
        """See `Law`; that at the largest contact for which the law is Hertz's."""
        H = dense(rows.jacobian(_ONE))
        curve, F = self._series()
        k = float(self.springs.stiffness(self.springs.reach(curve.largest)).sum()) * np.eye(2)
        K = np.zeros((3, 3))
        K[0, 0], K[1:, 1:] = curve.stiffest, np.linalg.inv(np.eye(2) + k @ F[1:, 1:]) @ k
        return np.asarray(H.T @ ((K + K.T) / 2) @ H)

    @property
    def left_out(self) -> list[str]:
        """See `Law`."""
        return [*LEFT_OUT, "friction against spin about the line of contact"]

    def semi_axes(self, force: float) -> tuple[float, float]:
        """See `Law`."""
        return self.gaps.contact.semi_axes(force)


def _turned(elongations: Array, k: Array, last: Array) -> Array:
    """Elongations, (n, 2) [m], in the present tangents, in which the force on the slave was `last`, (2,) [N]."""
    remembered = -(k @ elongations)
    size = np.hypot(*remembered) * np.hypot(*last)
    if size == 0.0:
        return elongations
    c = float(remembered @ last) / size
    s = float(remembered[0] * last[1] - remembered[1] * last[0]) / size
    return np.asarray(elongations @ np.array([[c, s], [-s, c]]))
