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
from .hertz import WIDEST, HertzCurve

_SPRINGS = 24
_INNERMOST = 1 / 30  # of the largest radius of contact: where the first spring ends
_MOST, _SETTLED = 60, 1e-13  # steps of Newton's method, and relative change of the last one
_SLIPS = 1 - 1e-9  # share of the largest tangential force with which all springs slip
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
        """Springs of stiffness k, (n,) [N/m], that would have elongations, (n, 2) [m], with forces up to bounds, (n,) [N]."""
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
    normal. Normal and tangential forces do not move each other's directions.

    Parameters
    ----------
    rows : RowDirections
    """

    elastic, memory = False, 2 * _SPRINGS

    def __init__(self, rows: RowDirections) -> None:
        assert isinstance(rows.gaps, SpotGaps)
        self.rows, self.gaps, contact = rows, rows.gaps, rows.gaps.contact
        self.springs = Springs(contact.radius, contact.modulus, rows.gaps.shear)
        self._known: tuple[Array, HertzCurve] | None = None

    def fresh(self, rows: RowDirections) -> Law:
        """See `Law`."""
        return HertzFriction(rows)

    def _series(self) -> tuple[HertzCurve, Array]:
        """Force by approach, and tangential flexibility, (2, 2) [m/N], at the present spots."""
        F, lacking = self.rows.flexibility(_ONE), self.gaps.spot_rows.lacking
        if self._known is None or self._known[0] is not F:
            self._known = F, HertzCurve(float(F[0, 0]) + lacking[0], self.gaps.contact)
        return self._known[1], F[1:, 1:] + lacking[1] * np.eye(2)

    def answer(self, places: Places) -> Forces:
        """See `Law`."""
        if places.gap[0] >= 0.0:
            none = np.zeros((1, 2))
            return Forces(
                np.zeros((1, 3)), _ONE[:0], np.array([OPEN], dtype=np.int8), none, memory=np.zeros((1, self.memory)),
                stored=0.0, stiffness=lambda: np.zeros((0, 0)),
            )  # fmt: skip
        curve, F = self._series()
        P, mu, last, springs = curve.force(-float(places.gap[0])), float(places.mu[0]), places.last[0], self.springs
        reach, before = springs.reach(P), springs.reach(last[0])
        k, k_before = springs.stiffness(reach), springs.stiffness(before)
        elongations = _turned(places.memory[0].reshape(-1, 2), k_before, last[1:])
        # Where the contact grows, new parts of springs have no elongation.
        kept = elongations * np.divide(np.minimum(k_before, k), k, out=np.zeros(len(k)), where=k > 0)[:, None]
        held = self._stretched(kept, k, mu * springs.normal(reach), F, places.way[0], last[1:])
        T = -held.force
        stored = 0.5 * T @ F @ T + 0.5 * k @ (held.elongations**2).sum(axis=1)
        stored_before = 0.5 * last[1:] @ F @ last[1:] + 0.5 * k_before @ (elongations**2).sum(axis=1)
        mean = (T + last[1:]) / 2
        taken = -mean @ places.way[0] - (stored - stored_before)
        size = mean @ mean
        slips = -taken * mean / size if size > 0 else np.zeros(2)
        status = SLIP if np.linalg.norm(T) >= _SLIPS * mu * P else STICK

        def stiffness() -> Array:
            K, normal = np.zeros((3, 3)), curve.stiffness(P)
            eased = np.linalg.inv(np.eye(2) + held.stiffness @ F)
            K[0, 0], K[1:, 1:] = normal, eased @ held.stiffness
            direction = held.elongations / np.maximum(np.linalg.norm(held.elongations, axis=1), 1e-300)[:, None]
            K[1:, 0] = -mu * normal * eased @ ((held.slipping * springs.normal_slope(reach)) @ direction)
            return K

        return Forces(
            np.array([[P, *T]]),
            _ONE,
            np.array([status], dtype=np.int8),
            slips[None],
            memory=held.elongations.reshape(1, -1),
            stored=curve.stored(P) + float(stored),
            stiffness=stiffness,
        )

    def _stretched(self, elongations: Array, k: Array, bounds: Array, F: Array, way: Array, last: Array) -> Held:
        """Springs after a way of the kernels, (2,) [m], with forces on the slave before it, (2,) [N]."""
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
        return held

    def closed_stiffness(self, rows: RowDirections) -> Array:
        """See `Law`; that at the largest contact for which the law is Hertz's."""
        H = dense(rows.jacobian(_ONE))
        curve, F = self._series()
        k = float(self.springs.stiffness(self.springs.reach(curve.largest)).sum()) * np.eye(2)
        K = np.zeros((3, 3))
        K[0, 0], K[1:, 1:] = curve.stiffest, np.linalg.inv(np.eye(2) + k @ F) @ k
        return np.asarray(H.T @ (K + K.T) / 2 @ H)

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
