"""Stages of two patches that slide. Points are followed over the facets, unless the patches are far apart.

Between searches only rows that can close are followed. To choose them, all points are projected, and the rows with
small gaps are taken. The choice is repeated when another row could close. The gap of such a row is estimated from the
rigid motion of the patches since the choice. Twice the largest error of this estimate for followed rows is subtracted.
Rows that can close are those that the deepest row's bulge may reach, and all that forces may push shut, as of bodies
that bend, see `Gaps.follow_pushed`.
While the patches are more than one facet apart, there are no rows.
"""

from __future__ import annotations

import math
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from ..algebra.products import largest_change
from ..algebra.vectors import triangle_frame
from ..frames.kinematics import Rows
from ..support.arrays import Array
from ..support.attributes import FoundOnce
from ..surfaces.holders import FOLLOWED
from ..surfaces.pairs import STEPS, MovingPairs
from ..surfaces.points import ContactPoints
from ..surfaces.rows import ContactRows
from ..surfaces.witnesses import pose_of, seen_from
from . import loops
from .sides import Sides
from .stages import FEW, NOTHING, Anchor, Pair, PresentRows, Shares, Stage

if TYPE_CHECKING:
    from ..surfaces.moving_kernels import Followed as CompiledRows
    from .kernels import FlatPair

BULGE = 0.25  # of the deepest row's depth: smaller gaps may close, because the surface bulges around a contact
NEAR = 1.0  # of a facet's size: rows with larger gaps are not followed, as closest points jump there
SEARCHED = 0.25  # of a facet's size: motion after which all points are searched again
MET = 0.1  # of a facet's size: sides that may meet anywhere have no rows, and no past, while they are further apart
WIDER = 4.0  # largest gap of rows that enter, over that of rows that close, where no flexibility tells more
_AHEAD = 0.006  # of a facet's size: rows are followed up to this margin above the gaps that matter now


class Apart(Stage):
    """Patches that are so far apart that there are no rows.

    Parameters
    ----------
    rows, normals, shares
        See `Stage`; empty.
    here : (3, 3) array
        Place of the slave relative to the master when all points were searched [m].
    reach : float
        Motion after which all points are searched again [m].
    anchor : Anchor
        Where they were searched.
    """

    def __init__(
        self, rows: PresentRows, normals: Array, shares: Shares, here: Array, reach: float, anchor: Anchor
    ) -> None:
        super().__init__(rows, normals, shares)
        self.here, self.reach, self.anchor = here, reach, anchor

    def advance(self, pair: Pair, q: Array) -> tuple[Stage, Array]:
        """See `Stage.advance`."""
        here = seen_from(self.rows.sides.places(q, pair.growing), pair.witnesses)
        return (self, NOTHING) if largest_change(here, self.here) <= self.reach else pair.search(q)

    def with_more_rows(self, pair: Pair, q: Array) -> tuple[Stage, Array]:
        """See `Stage.with_more_rows`."""
        stage, gap = pair.search(q, pair.furthest)
        return stage.with_more_rows(pair, q) if isinstance(stage, Followed) else (stage, gap)


class Search:
    """Pairs of all points of two patches that are near each other.

    Parameters
    ----------
    pair : Pair
    every : ContactRows
        Rows of all points that face the master.
    x_s : (np, 3) array
        Places of the slave's nodes [m].
    here : (3, 3) array
        Place of the slave relative to the master [m].
    reach : float
        Motion after which all points are searched again [m].
    anchor : Anchor
        Where they were searched.

    Attributes
    ----------
    projections : int
        How often points were projected since: `pairs` belong to the last time.
    """

    def __init__(self, pair: Pair, every: ContactRows, x_s: Array, here: Array, reach: float, anchor: Anchor) -> None:
        self.every, self.here, self.reach, self.anchor, self.projections = every, here, reach, anchor, 0
        self.pairs = MovingPairs(pair.sides[1].surface, every.facet, every.local)
        # Places of the slave's nodes in the frame of its three witness nodes: rigid motion is found from them.
        origin, axes = triangle_frame(x_s[pair.witnesses[0]])
        self._arms = (x_s[every.points.row_nodes] - origin) @ axes

    def choose(self, pair: Pair, places: list[Array], here: Array, near: float | None = None) -> tuple[Followed, Array]:
        """Return the stage with the rows that may close next, or with gaps below `near` [m], and their gaps, (nr,) [m].

        `places` are those of all nodes, (np, 3) for each side, `here` is the place of the slave relative to the master,
        (3, 3) [m].
        """
        (x_s, x_m), every, pairs = places, self.every, self.pairs
        pairs.rest()
        self.projections += 1
        normal, gap = pairs.follow(every.points, np.arange(len(every.facet)), x_s, x_m, partial(pair.met, places))
        row_gap = every.points.average(gap)
        if near is None:
            near = min(needed(row_gap, pair.reach, pair.within) + _AHEAD * pair.size, NEAR * pair.size)
        chosen = row_gap < near
        points, index = every.points.of_rows(np.flatnonzero(chosen))
        nodes, weights = pairs.carriers
        shares = (points.nodes, points.weights), (nodes[index], -weights[index])
        # Change of the gaps to first order in the slave's rigid motion relative to the master.
        normals = every.points.average(normal) @ triangle_frame(x_m[pair.witnesses[1]])[1]
        turning = (normals[:, :, None] * self._arms[:, None, :]).reshape(-1, 9)
        order = np.r_[np.flatnonzero(chosen), np.flatnonzero(~chosen)]
        rows = FollowedRows(
            (points, every.leaves_at[chosen], pair.sides_with(points, pairs.facet[index]), every.unpaired),
            self,
            index,
            (row_gap[order], np.hstack([normals, turning])[order], pose_of(here)),
            pair.witnesses,
        )
        return Followed(rows, normal[index], here, shares), row_gap[chosen]


class FollowedRows(PresentRows):
    """Rows that can close, chosen from those of a search.

    Parameters
    ----------
    present : tuple
        Arguments of `PresentRows`.
    search : Search
    index : (p,) int array
        Numbers of the points within the search.
    rigid : tuple of (n,), (n, 12), (12,) arrays
        Gaps of all rows when the choice was made [m], the chosen rows first. Their derivative with respect to the pose
        of the slave. That pose, see `witnesses.pose_of`.
    witnesses : list of (3,) int arrays
        Nodes that give the pose of each side.
    """

    def __init__(
        self,
        present: tuple[ContactPoints, Array, Sides, int],
        search: Search,
        index: Array,
        rigid: tuple[Array, Array, Array],
        witnesses: list[Array],
    ) -> None:
        super().__init__(*present)
        self.search, self.index, self._rigid, self._witnesses = search, index, rigid, witnesses

    @cached_property
    def compiled(self) -> CompiledRows:
        """Data with which compiled loops follow the rows."""
        search = self.search
        return search.pairs.followed(self.points, self.index, *self._witnesses, search.here, *self._rigid)

    @FoundOnce
    def flat_pair(self) -> FlatPair:
        """`compiled` with the nodes of both sides."""
        return loops.flat_pair(self.compiled, self.sides)

    @FoundOnce
    def flattens(self) -> bool:
        """Whether loops find generalised forces of both sides."""
        return loops.at_once() and all(side.flattens for side in self.sides)

    @property
    def leaves_out(self) -> bool:
        """Whether some rows of the search are not followed."""
        return len(self.row_nodes) < len(self._rigid[0])

    def others_close(self, gap: Array, here: Array, pair: Pair) -> bool:
        """Whether rows that are not followed may close, or come nearer than those that are followed.

        Their gaps are estimated from rigid motion. Deformation and curvature make this estimate inexact. For
        rows that are not followed, the error is taken as twice the largest error of the followed rows.
        """
        start, rigidly, pose = self._rigid
        estimated = start + rigidly @ (pose_of(here) - pose)
        off = abs(gap - estimated[: len(gap)]).max(initial=0.0)
        nearest = estimated[len(gap) :].min(initial=np.inf) - 2 * off
        return bool(nearest < min(needed(gap, pair.reach, pair.within), NEAR * pair.size))


class Followed(Stage):
    """Rows at some coordinates, whose points are followed over the master's facets.

    Closest points are found from the last ones, which `Search.pairs` holds. So only the newest stage can advance, and
    the one that was asked for more rows. Others know their pairs only if somebody has asked for them in time, see
    `knows_pairs`.

    Parameters
    ----------
    rows : FollowedRows
    normals : (p, 3) array
    here : (3, 3) array
        Place of the slave relative to the master [m].
    shares : Shares, optional
        See `Stage`. Default: found from `Search.pairs` when they are needed first; these must be those of `rows` then.
    """

    rows: FollowedRows

    def __init__(self, rows: FollowedRows, normals: Array, here: Array, shares: Shares | None = None) -> None:
        self.rows, self.normals, self.here, self.shared = rows, normals, here, None
        self._values, self._shares, self._alone = {}, shares, shares is None
        self._projection = rows.search.projections

    @property
    def _newest(self) -> bool:
        """Whether `Search.pairs` belong to this stage."""
        return self._alone and self._projection == self.rows.search.projections

    @property
    def knows_pairs(self) -> bool:
        """Whether its pairs are known."""
        return self._shares is not None or self._newest

    @property
    def shares(self) -> Shares:  # type: ignore[override]
        """See `Stage`."""
        if self._shares is None:
            points, (nodes, weights) = self.rows.points, self.rows.search.pairs.carriers
            self._shares = (points.nodes, points.weights), (nodes, -weights)
        return self._shares

    def nodal_forces(self, lam: Array) -> list[Array]:
        """See `Stage.nodal_forces`; one compiled call."""
        n_nodes, pairs = (len(side.surface.points) for side in self.rows.sides), self.rows.search.pairs
        at_once = pairs.nodal_forces(lam, self.normals, *n_nodes) if self._newest else None
        return super().nodal_forces(lam) if at_once is None else at_once

    def acted(self, lam: Array, q: Array) -> tuple[Array, Array]:
        """See `Stage.acted`; one compiled call."""
        if not (self._newest and self.rows.flattens):
            return super().acted(lam, q)
        return loops.pushed_pairs(self.rows.flat_pair, lam, self.normals, q)

    def jacobian(self, index: Array, q: Array) -> Rows:
        """See `Stage.jacobian`; one compiled call for few rows."""
        if len(index) > FEW or not (self._newest and self.rows.flattens):
            return super().jacobian(index, q)
        return loops.pair_rows(self.rows.flat_pair, index, self.normals, q, len(self.rows.area))

    def advance(self, pair: Pair, q: Array) -> tuple[Stage, Array]:
        """See `Stage.advance`; rows are chosen again when others may close."""
        search = self.rows.search
        followed = self._follow(pair, q, search.reach, self.rows.sides)
        if followed is None:
            return pair.search(q)
        stage, gap, enough = followed
        return (stage, gap) if enough else search.choose(pair, pair.sides.places(q, pair.growing), stage.here)

    def keep_rows(self, pair: Pair, q: Array) -> tuple[Stage, Array] | None:
        """See `Stage.keep_rows`; the points may move any distance."""
        followed = self._follow(pair, q, math.inf, pair.sides)
        return None if followed is None else followed[:2]

    def with_more_rows(self, pair: Pair, q: Array) -> tuple[Stage, Array]:
        """See `Stage.with_more_rows`; this stage can advance after it, with what is known of its rows."""
        _, self._alone = self.shares, False  # from now on, `Search.pairs` has projected other points
        for outdated in ("compiled", "flat_pair"):
            vars(self.rows).pop(outdated, None)
        return self.rows.search.choose(pair, pair.sides.places(q, pair.growing), self.here, NEAR * pair.size)

    def _follow(self, pair: Pair, q: Array, reach: float, sides: Sides) -> tuple[Followed, Array, bool] | None:
        """The same rows at coordinates q, (n,), their gaps, (nr,) [m], and whether no other row can close.

        None if the patches have moved by more than `reach` [m] since the search, or a point has come to a facet that is
        not followed. `sides` follow the nodes.
        """
        rows, search = self.rows, self.rows.search
        search.projections += 1
        if loops.at_once():
            return self._follow_at_once(pair, q, reach, sides)
        places = sides.places(q, pair.growing)
        here = seen_from(places, pair.witnesses)
        if not largest_change(here, search.here) <= reach:
            return None
        x_s, x_m = places
        meet = partial(pair.met_at, q)
        normals, of_points = search.pairs.follow(rows.points, rows.index, x_s, x_m, meet)
        gap = rows.points.average(of_points)
        if math.isnan(gap.sum()):
            return None
        return self._next(normals, here, places), gap, not rows.others_close(gap, here, pair)

    def _follow_at_once(self, pair: Pair, q: Array, reach: float, sides: Sides) -> tuple[Followed, Array, bool] | None:
        """Do the same as `_follow` in one compiled call."""
        rows, bounds = self.rows, (BULGE, NEAR * pair.size, pair.reach, pair.within)
        how, growing = (reach, FOLLOWED, STEPS, pair.size, *bounds), pair.sides.growths(pair.growing)
        places = [side.places_begun(*part) for side, *part in zip(sides, pair.sides.split(q), growing, strict=True)]
        flat = rows.flat_pair if sides == rows.sides else loops.flat_pair(rows.compiled, sides)
        followed = loops.followed_gaps(flat, q, growing, places, how)
        here, normals, of_points, lost, gap, least, more_close = followed
        if not len(normals):
            return None
        if len(lost):
            rows.search.pairs.search(rows.points, rows.index, lost, partial(pair.met_at, q), normals, of_points)
            gap, least, more_close = loops.row_gaps(rows.compiled, of_points, here, *bounds)
        return None if math.isnan(least) else (self._next(normals, here, places), gap, not more_close)

    def _next(self, normals: Array, here: Array, places: list[Array]) -> Followed:
        result = Followed(self.rows, normals, here)
        result.places = places
        return result


def needed(gap: Array, begins: float, within: float) -> float:
    """Gap up to which rows must be present [m]. Open: the smallest gap. In contact: what bulging may close.

    `begins` is the gap at which forces begin [m], `within` the gap up to which they may push rows shut, if it is known.
    """
    return max(limit_at(float(gap.min(initial=np.inf)), begins), within)


def limit_at(least: float, begins: float) -> float:
    """Gap up to which rows are present, whatever the forces are [m]; `least` is the smallest gap."""
    return max(least, begins - BULGE * (least - begins))
