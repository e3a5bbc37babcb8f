"""Gaps between two patches in motion: pairs are frozen while the patches do not slide, and followed while they do.

Frozen pairs: gaps are linear, h = h0 + H q, and cost one product. When the patches have slid by 2 % of a facet, pairs
are followed: every evaluation takes positions from the coordinates of the bodies and projects the contact points again,
starting from their last closest points (`surfaces.pairs`). When the patches have moved by a quarter of a facet, all
points are searched with a tree. When the sliding stops, pairs are frozen again. So the motion itself decides, and users
need not know it beforehand.

Between searches only rows that can close are followed. To choose them, all points are projected, and the rows with
small gaps are taken. The choice is repeated when another row could close. The gap of such a row is estimated from the
rigid motion of the patches since the choice, less twice the error that this estimate has for followed rows. While the
patches are more than one facet apart, there are no rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..algebra.complementarity import Complementarity
from ..algebra.products import largest_change, moved, weighted_rows
from ..support.arrays import Array
from ..support.twins import Known, copied
from ..surfaces.pairs import FOLLOWED, STEPS, MovingPairs
from ..surfaces.points import ContactPoints, RowKind
from ..surfaces.rows import ContactRows, facing, rows_of
from ..surfaces.surface import closest_points
from ..surfaces.witnesses import pose_of, seen_from, triangle_frame, witnesses_of
from . import loops
from .gaps import BULGE, SAME, Gaps, Pressed, needed
from .linear_gaps import LinearGaps
from .pairings import Pairing, drift_rows
from .side import Side

if TYPE_CHECKING:
    from typing import Self

    from ..surfaces.moving_kernels import Followed

_HELD = 0.02  # of a facet's size: sliding up to which pairs stay frozen
_STILL = 0.1  # of _HELD: pairs that slide less than that in _PATIENCE evaluations are frozen again
_PATIENCE = 200
_SEARCHED = 0.25  # of a facet's size: motion after which all points are searched again
_Found = tuple[Array, bool] | None  # see `PatchGaps._follow`
_NO_GAPS = np.empty(0)
_NOT_ASKED = np.zeros((3, 3)), 0.0, np.empty(0, dtype=np.int64), *np.empty((2, 0, 0)), np.empty(0, dtype=np.int64)
_NEAR = 1.0  # of a facet's size: larger gaps are not followed between searches, as closest points jump there
_AHEAD = 0.006  # of a facet's size: rows are followed up to this margin above the gaps that matter now


class PatchGaps(Gaps):
    """Gaps between two patches in motion.

    Parameters
    ----------
    slave, master : Side
    kind : {"integrated", "node-to-segment"}
    between : (d np, d np) array, optional
        See `Gaps`.

    Raises
    ------
    EmptyRegionError, PenetrationError
        See `rows.pair_surfaces`.
    """

    def __init__(self, slave: Side, master: Side, kind: RowKind = "integrated", between: Array | None = None) -> None:
        self.sides, self._kind, self.between = (slave, master), kind, between
        self._paired, self._here, self.held, self.moving = self.sides, np.zeros((3, 3)), None, True
        self._pairing = pairing = Pairing.of(slave, master, kind, itself=between is not None)
        self._all, self._start, self._start_q = pairing.points, pairing.rows, pairing.pose
        self.n, self.faced = len(pairing.pose), not pairing.pose.any()
        self.size, self.approach = self._start.facet_size, self._start.approach
        self._linear = all(side.kinematics.linear and not side.surface.wanders for side in self.sides)
        self._witnesses = [witnesses_of(side.surface) for side in self.sides]
        self.reset()

    def reset(self) -> None:
        """Go back to the pairs at the start, before a new run."""
        self._since, self._apart = 0, False
        self._searched_at: Array | None = None
        self._rows_followed: Followed | None = None
        self._asked: tuple[Array | float, ...] | None = None
        self._pressed: Pressed | None = None
        self._stood_at: Array | None = None
        self.follow_nodes(None)
        if self.moving or self.held is not self._start:
            self._hold(self._start, self._start_q)
            self.moving = not self._linear

    def twin(self, known: Known) -> Self:
        """See `support.twins`; what compiled loops follow is set up anew."""
        result = copied(self, known)
        result._rows_followed = None
        return result

    # Frozen pairs.

    def _hold(self, rows: ContactRows, q: Array) -> None:
        """Freeze these pairs; their gaps belong to coordinates q, (n,)."""
        self.follow_nodes(None)
        self._take(rows.points, rows.at_edge)
        self._meet(rows.master, rows.weights, rows.normals)
        self.unpaired = rows.unpaired
        self.moving, self.held, self._q = True, rows, q
        if self._linear:
            at_start = rows is self._start
            self._frozen = (self._pairing.frozen if at_start else None) or self._linearised(rows)
            if at_start:
                self._pairing.frozen = self._frozen
            self.H, self.moving = self._frozen.H, False

    def _linearised(self, rows: ContactRows) -> LinearGaps:
        H, drift = self.jacobian(np.arange(len(rows))), drift_rows(self.sides, self.shares, rows)
        start = moved(rows.gap.copy(), H, -self._q)
        _ = weighted_rows(start, H), self.normal  # so that these loops, too, are compiled before a run begins
        return LinearGaps(H, start, drift, drift @ self._q, _HELD * self.size)

    @property
    def linear(self) -> LinearGaps | None:
        """See `Gaps.linear`."""
        return None if self.moving else self._frozen

    def stance(self) -> Array:
        """See `Gaps.stance`."""
        return self._here / self.size

    def problem(self) -> Complementarity:
        """See `Gaps.problem`. Contacts with the same pairs share its matrix."""
        if not self._at_start:
            return super().problem()
        if self._pairing.problem is None:
            self._pairing.problem = super().problem()
        return self._pairing.problem.fresh()

    @property
    def _at_start(self) -> bool:
        """Whether the rows stand as they were paired, on sides that have not yielded since."""
        return self._q is self._start_q and self.sides is self._paired

    def _all_flexibility(self) -> Array:
        if not self._at_start:
            return super()._all_flexibility()
        if self._pairing.flexibility is None:
            self._pairing.flexibility = super()._all_flexibility()
        return self._pairing.flexibility

    def _take(self, points: ContactPoints, at_edge: Array) -> None:
        """Set the present rows."""
        self.points, self.row_nodes, self.area, self.at_edge = points, points.row_nodes, points.area, at_edge
        self._flexible_at = None

    def _meet(self, nodes: Array, weights: Array, normals: Array) -> None:
        """Set what the present points face: nodes and weights, (p, k), and normals, (p, 3), of the master."""
        self._just_followed = False
        self._shares: Sequence[tuple[Array, Array]] | None = (self.points.nodes, self.points.weights), (nodes, -weights)
        self.normals = normals

    @property
    def shares(self) -> Sequence[tuple[Array, Array]]:  # type: ignore[override]
        """See `Gaps`; while points are followed, they are found when they are asked for."""
        if self._shares is None:
            nodes, weights = self._pairs.carriers
            self._shares = (self.points.nodes, self.points.weights), (nodes, -weights)
        return self._shares

    def _generalised(self, lam: Array) -> Array:
        """See `Gaps._generalised`; one compiled call while points are followed, if no frame moves."""
        slave, master = (side.fixed for side in self.near_sides)
        if not loops.at_once() or slave is None or master is None or not self._just_followed:
            return super()._generalised(lam)
        moving = self._pairs.moving(self.points, self._followed_points)
        return loops.generalised(moving, lam, self.normals, slave, master)

    def nodal_forces(self, lam: Array) -> list[Array]:
        """See `Gaps.nodal_forces`."""
        if self._just_followed:
            found = self._pairs.nodal_forces(lam, self.normals, *(len(side.surface.points) for side in self.sides))
            if found is not None:
                return found
        return super().nodal_forces(lam)

    # Followed pairs.

    def at(self, q: Array) -> Array:
        """Gaps of the present rows, (nr,) [m], at coordinates q, (n,)."""
        if not self.moving:
            frozen = self._frozen
            if largest_change(frozen.drift @ q, frozen.drift_start) <= frozen.reach:
                self._q = q
                return moved(frozen.start, frozen.H, q)
            self.moving, self._since, self._searched_at = True, 0, None
        self._q = q
        found = self._follow(self._reach) if self._searched_at is not None and self._narrowed else None
        if found is None:
            self._here = here = seen_from(self.places_now(), self._witnesses)
            at = None if self._searched_at is None or self._narrowed else self._searched_at
            if at is None or largest_change(here, at) > self._reach:
                self._search(self._everywhere(), here)
            if self._apart:
                return _NO_GAPS
        gap, enough = found or (_NO_GAPS, False)
        if not enough:
            gap = self._narrow(self._everywhere(), self._here)
        self._since += 1
        if self._since >= _PATIENCE and self._linear:
            self._since = 0
            # Only if they touch: patches that are apart may meet with other pairs.
            if self._stands_still(self._here) and gap.min(initial=np.inf) < _HELD * self.size:
                rows = self.project(*self._everywhere())[0]
                self._hold(rows, q)
                return rows.gap
        return gap

    def pressed_at(self, q: Array, flexibility: Array, problem: tuple[Array, ...]) -> tuple[Array, Pressed | None]:
        """See `Gaps.pressed_at`."""
        if self._flexible_at is not None and self._flexible_some is flexibility:
            self._asked = self._flexible_at.stance, SAME, *problem
        gap, found = self.at(q), self._pressed
        self._asked = self._pressed = None
        return gap, found if self.moving else None  # pairs may have been frozen

    def of_present(self, q: Array) -> Array:
        """See `Gaps.of_present`."""
        if not self.moving:
            return moved(self._frozen.start, self._frozen.H, q)
        if self._searched_at is None or not self._narrowed:
            return self.at(q)
        self._q = q
        found = self._follow(math.inf, self.places(q))  # wherever the points go
        return self.at(q) if found is None else found[0]

    def surface_gap(self, q: Array, dents: Sequence[Array] | None = None) -> float:
        """See `Gaps.surface_gap`."""
        x_s, x_m = self.dented(self.sides, q, dents)
        found = closest_points(np.vstack([x_s, self._all.at(x_s)]), x_m[self.sides[1].surface.facets])
        direction = replace(self.slave.surface, points=x_s).normal_here
        return float(found.gap[facing(found, direction, self.size)].min(initial=np.inf))

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """See `Gaps.closing`; the last entry bounds all points without rows: the least gap, the largest speed."""
        self.at(q)
        if not self.moving:
            return super().closing(q, q_t, q_tt)
        x_s, x_m = places = self.places(q)
        gap = np.empty(0)
        if not self._apart:
            gap = self._narrow(places, seen_from(places, self._witnesses), _NEAR * self.size)
            self._narrowed = False  # forces need fewer rows
        H = self.jacobian(np.arange(len(gap)))
        beyond = (_NEAR - 2 * _SEARCHED) * self.size if len(gap) else self._distance(x_s, x_m)
        of_slave, of_master = (
            side.kinematics.velocities(*parts)
            for side, *parts in zip(self.sides, self.split(q), self.split(q_t), strict=True)
        )
        mean = of_master.mean(axis=0)
        speed = sum(np.linalg.norm(v - mean, axis=1).max() for v in (of_slave, of_master))
        return np.append(gap, beyond), np.append(H @ q_t, -speed), np.append(H @ q_tt, 0.0)

    def _distance(self, x_s: Array, x_m: Array) -> float:
        """Least gap or a lower bound [m]; while the patches are apart, the cheap gap between balls around them."""
        centres = x_s.mean(axis=0), x_m.mean(axis=0)
        radii = [np.linalg.norm(x - centre, axis=1).max() for x, centre in zip((x_s, x_m), centres, strict=True)]
        between = float(np.linalg.norm(centres[1] - centres[0]) - sum(radii))
        return between if between > 0 else self.project(x_s, x_m)[1]

    def project(self, x_s: Array, x_m: Array) -> tuple[ContactRows, float]:
        """Rows of all points that face the master, and the least gap [m]."""
        slave, master = (replace(side.surface, points=x) for side, x in zip(self.sides, (x_s, x_m), strict=True))
        found = closest_points(self._all.at(x_s), x_m[master.facets])
        paired = facing(found, slave.normal_here, self.size)
        least = found.gap[paired].min(initial=np.hypot(found.gap, found.offset).min())
        return rows_of(self._all, found, paired, slave, master, self.approach), float(least)

    def _search(self, places: list[Array], here: Array) -> None:
        """Find the pairs of all points, by the places of all nodes of each side."""
        x_s, x_m = places
        self.searches += 1
        self._every, least = self.project(x_s, x_m)
        self.unpaired = self._every.unpaired
        self._searched_at, self._narrowed = here, False
        # If the patches are far apart, the next search waits until they may be near.
        self._reach = max(_SEARCHED * self.size, 0.25 * (least - _NEAR * self.size))
        self._apart = least > _NEAR * self.size
        if self._apart:
            points, index = self._every.points.of_rows(np.empty(0, dtype=np.int64))
            self._take(points, self._every.at_edge[:0])
            self._meet(self._every.master[index], self._every.weights[index], self._every.normals[index])
            self.follow_nodes(self._witnesses)
            return
        self._pairs = MovingPairs(self.sides[1].surface, self._every.facet, self._every.local)
        # Places of the slave's nodes in the frame of its three witness nodes: they tell how rigid motion changes gaps.
        origin, axes = triangle_frame(x_s[self._witnesses[0]])
        self._arms = (x_s[self._every.points.row_nodes] - origin) @ axes

    def _narrow(self, places: list[Array], here: Array, near: float | None = None) -> Array:
        """Set the present rows to those that may close next, or those with gaps below `near` [m]; return their gaps."""
        (_, x_m), every = places, self._every
        self._pairs.rest()
        normal, gap = self._followed(every.points, np.arange(len(every.facet)), places)
        row_gap = every.points.average(gap)
        if near is None:
            near = min(needed(row_gap) + _AHEAD * self.size, _NEAR * self.size)
        chosen = row_gap < near
        points, self._followed_points = every.points.of_rows(np.flatnonzero(chosen))
        self._take(points, every.at_edge[chosen])
        nodes, weights = self._pairs.carriers
        some = self._followed_points
        self._meet(nodes[some], weights[some], normal[some])
        # Change of the gaps to first order in the slave's rigid motion as seen from the master.
        normals = every.points.average(normal) @ triangle_frame(x_m[self._witnesses[1]])[1]
        turning = (normals[:, :, None] * self._arms[:, None, :]).reshape(-1, 9)
        order = np.r_[np.flatnonzero(chosen), np.flatnonzero(~chosen)]
        self._rigidly = np.hstack([normals, turning])[order]
        self._from, self._pose = row_gap[order], pose_of(here)
        self._narrowed, self._rows_followed = True, None
        self._follow_around(self._pairs.facet[some])
        value: Array = row_gap[chosen]
        return value

    def _follow_around(self, facets: Array) -> None:
        """Follow the nodes of the present points, and those of the master around these facets, (p,) int array."""
        slave, master = (side.surface for side in self.sides)
        near = np.zeros(len(master.points), dtype=bool)
        near[master.facets[facets]] = True
        near[master.facets[near[master.facets].any(axis=1)]] = True
        near[self._witnesses[1]] = True
        own = np.zeros(len(slave.points), dtype=bool)
        own[self.points.nodes] = own[self._witnesses[0]] = True
        self.follow_nodes([np.flatnonzero(own), np.flatnonzero(near)])

    def _everywhere(self) -> list[Array]:
        """Places of all nodes of the sides at the last coordinates."""
        if self._near_sides is not None:
            self.follow_nodes(None)
        return self.places_now()

    def _others_close(self, gap: Array, here: Array) -> bool:
        """Whether rows that are not followed may close, or come nearer than those that are followed.

        Their gaps are estimated from rigid motion. Deformation and curvature make an error. For rows that are not
        followed, the error is taken as twice the largest error of the followed rows.
        """
        rigid = self._from + self._rigidly @ (pose_of(here) - self._pose)
        off = abs(gap - rigid[: len(gap)]).max(initial=0.0)
        nearest = rigid[len(gap) :].min(initial=np.inf) - 2 * off
        return bool(nearest < min(needed(gap), _NEAR * self.size))

    def _follow(self, reach: float, places: list[Array] | None = None) -> _Found:
        """Gaps of the present rows, (nr,) [m], and whether these are all that can close.

        None if the patches have moved by more than `reach` [m] since the last search, or a point has come to a facet
        that is not followed. `places` are those of the nodes of both sides, by default those that are followed.
        """
        if loops.at_once():
            return self._follow_at_once(reach, places)
        places = self.places_now() if places is None else places
        here = seen_from(places, self._witnesses)
        if self._searched_at is None or largest_change(here, self._searched_at) > reach:
            return None
        self.normals, of_points = self._followed(self.points, self._followed_points, places)
        self._here, self._shares, self._just_followed = here, None, True
        gap = self.points.average(of_points)
        return None if math.isnan(gap.sum()) else (gap, not self._others_close(gap, here))

    def _follow_at_once(self, reach: float, places: list[Array] | None) -> _Found:
        """Do the same as `_follow` in one call."""
        if self._rows_followed is None:
            assert self._searched_at is not None
            at_choice = self._searched_at, self._from, self._rigidly, self._pose
            self._rows_followed = self._pairs.followed(self.points, self._followed_points, *self._witnesses, *at_choice)
        rows, bounds = self._rows_followed, (BULGE, _NEAR * self.size)
        how = reach, FOLLOWED, STEPS, self.size, *bounds
        slave, master = (side.fixed for side in self.near_sides)
        if places is None and slave is not None and master is not None:
            found = loops.pressed_at(self._q, slave, master, rows, how, self._asked or _NOT_ASKED)
            here, normals, of_points, lost, gap, least, others, lam, force, settled = found
            self._pressed = (lam, force, least) if settled else None
        else:
            places = self.places_now() if places is None else places
            here, normals, of_points, lost, gap, least, others = loops.followed_gaps(rows, places, how)
        if not len(normals):
            return None
        if len(lost):
            x_s, x_m = self.places(self._q)
            self._pairs.search(self.points, self._followed_points, lost, x_s, x_m, normals, of_points)
            gap, least, others = loops.row_gaps(rows, of_points, here, *bounds)
        self._here, self.normals, self._shares, self._just_followed = here, normals, None, True
        return None if math.isnan(least) else (gap, not others)

    def _followed(self, points: ContactPoints, index: Array, places: list[Array]) -> tuple[Array, Array]:
        """Normals, (p, 3), and gaps, (p,) [m], of some of the points."""
        x_s, x_m = places
        return self._pairs.follow(points, index, x_s, x_m, lambda: self.places(self._q)[1])

    def _stands_still(self, here: Array) -> bool:
        """Whether the patches have hardly slid since the last call."""
        last, self._stood_at = self._stood_at, here
        return last is not None and bool(abs(here - last)[:, :2].max() < _STILL * _HELD * self.size)
