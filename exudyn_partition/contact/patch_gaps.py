"""Gaps between two patches in motion. Pairs are frozen while the patches do not slide, else they are followed.

The gaps of frozen pairs are linear, h = h0 + H q, and cost one product. When the patches have slid by 2 % of a facet,
pairs are followed (`contact.followed`). Then every evaluation finds the positions of the nodes from the coordinates. It
projects the contact points again, starting from their last closest points. When the patches have moved by a quarter of
a facet, all points are searched with a tree. When the sliding stops, pairs are frozen again. So the motion decides, and
users need not know it beforehand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from ..algebra.products import moved, weighted_rows
from ..algebra.sparse.skin_flexibility import Flexibility
from ..support.arrays import Array
from ..surfaces.facing import ALONG_LINE, closest_met, facing, opposite
from ..surfaces.loops import at_points
from ..surfaces.pairs import continue_past_ends, hold
from ..surfaces.points import ContactPoints, RowKind
from ..surfaces.projection import Projection
from ..surfaces.rows import ContactRows, rows_of
from ..surfaces.surface import Surface
from ..surfaces.witnesses import seen_from, witnesses_of
from .anchoring import Anchoring
from .followed import MET, NEAR, SEARCHED, WIDER, Apart, Followed, FollowedRows, Search, limit_at
from .gaps import Gaps, GapState, Placement
from .linear_gaps import LinearGaps
from .pairings import Pairing, drift_rows
from .side import Side
from .sides import Sides
from .stages import NOTHING, Anchor, Frozen, Present, PresentRows, Shared, Stage

_HELD = 0.02  # of a facet's size: sliding up to which pairs stay frozen
_STILL = 0.1  # of _HELD: pairs that slide less than that in PATIENCE steps are frozen again
PATIENCE = 200  # steps
ROOM = 1.25  # gap up to which rows are followed, over that up to which forces may push them shut


class PatchGaps(Gaps):
    """Gaps between two patches in motion.

    Parameters
    ----------
    slave, master : Side
    kind : {"integrated", "node-to-segment"}
    between : (d np, d np) array, optional
        See `Gaps`.
    pressed : bool
        Whether the patches may overlap at the start.
    pairing : Pairing, optional
        Pairs at the start. Default: those along the line of contact, see `Pairing.of`.

    Raises
    ------
    EmptyRegionError, PenetrationError
        See `rows.pair_surfaces`.
    """

    _froze_at: Array | None  # coordinates at which the pairs were found that are frozen; None if they are followed

    def __init__(
        self,
        slave: Side,
        master: Side,
        kind: RowKind = "integrated",
        between: Flexibility | None = None,
        *,
        pressed: bool = False,
        pairing: Pairing | None = None,
    ) -> None:
        self._kind, self.between = kind, between
        if pairing is None:
            pairing = Pairing.of(slave, master, kind, itself=between is not None, pressed=pressed)
        self._pairing = pairing
        centre = slave.surface.points[pairing.rows.points.row_nodes].sum(axis=0) / max(len(pairing.rows.gap), 1)
        self.sides = Sides((slave.seen_from(centre), master.seen_from(centre)))
        self.all_points, self._start_q, self.anchoring = pairing.points, pairing.pose, Anchoring(self)
        rows = pairing.rows
        clearance, faced = float(rows.gap.min(initial=np.inf)), not pairing.pose.any()
        self.placement = Placement(rows.approach, clearance, faced, pressed)
        self.size = rows.facet_size
        self.furthest = NEAR * self.size
        self.witnesses = [witnesses_of(side.surface) for side in self.sides]
        self._start = self._at_start()
        self.present = Present(self._start, self._start_q, None, None, NOTHING)
        self.begin()

    def return_to(self, present: Present) -> None:
        """See `Gaps`. Where the pairs have gone on since, rows are projected anew."""
        stage = present.stage
        if isinstance(stage, Followed) and not stage.knows_pairs:
            stage = self.stage_at(Anchor(present.q, NOTHING, present.growing), stage.rows)
            present = Present(stage, present.q, stage.places, present.anchor, present.growing)
        super().return_to(present)

    def _go_to_start(self) -> None:
        """See `Gaps`."""
        self._go_to_stage(self._start, self._start_q)
        self._froze_at = None if self._start.moving else self._start_q
        self._stage_frozen: Frozen | None = None if self._froze_at is None else cast("Frozen", self._start)

    # State.

    def after(self) -> GapState:
        """See `Gaps`."""
        present, stage = self.present, self.stage
        stood, steps, frozen = self.accepted.stood, self.accepted.steps, self._frozen_at()
        if frozen is None and self.may_freeze and len(stage.rows.row_nodes):
            steps += 1
            if steps >= PATIENCE:
                frozen, stood, steps = self._freezes_at(stood), stage.here, 0
        return GapState(
            present.q, stage.pose, present.anchor, frozen, self._searched_at,
            stood=stood, steps=steps, growing=present.growing,
        )  # fmt: skip

    def _freezes_at(self, stood: Array | None) -> Array | None:
        """Present coordinates, if the patches touch and have hardly slid since `stood`: then pairs are frozen again."""
        if stood is None or not _has_hardly_slid(self.stage.here, stood, self.size):
            return None
        # Patches that are apart may meet with other pairs.
        return self.present.q.copy() if self.at(self.present.q).min(initial=np.inf) < _HELD * self.size else None

    def _frozen_at(self) -> Array | None:
        """See `Gaps`."""
        return None if self.moving else self._froze_at

    def accept(self, state: GapState) -> None:
        """See `Gaps`."""
        super().accept(state)
        if state.frozen is None:
            self._search_as(state)
        elif self.moving:  # they stand still again, or slid in a step that is given up
            self._freeze_at(state.frozen)

    def _take_rows(self, state: GapState) -> None:
        """See `Gaps`."""
        if state.frozen is not None:
            self._freeze_at(state.frozen)
        elif not self.moving:
            self.follow()

    @property
    def _searched_at(self) -> Anchor | None:
        """Where all points were searched last: those that faced the master are followed. None if none are."""
        stage = self.stage
        if isinstance(stage, Apart):
            return stage.anchor
        return stage.rows.search.anchor if isinstance(stage.rows, FollowedRows) else None

    def _search_as(self, state: GapState) -> None:
        """Follow the rows of the search that a state's rows come from."""
        anchor, now = state.chosen, self._searched_at
        if anchor is not None and (now is None or not now.equals(anchor)):
            self.follow()
            self._do_at(anchor, self.at)

    def _do_at(self, anchor: Anchor, what: Callable[[Array], object]) -> None:
        """Do something at an anchor's coordinates, with its growth."""
        growing, self.growing = self.growing, anchor.growing
        what(anchor.q)
        self.growing = growing

    def _freeze_at(self, q: Array) -> None:
        """Freeze the pairs at coordinates q, (n,)."""
        if self._stage_frozen is None or self._froze_at is None or not np.array_equal(q, self._froze_at):
            self._stage_frozen = self._freeze(self.project(*self.sides.places(q, self.growing))[0], q)
            self._froze_at = q
        self._put_stage(self._stage_frozen)

    def placed_rows(self) -> tuple[ContactPoints, Array, Array]:
        """See `Gaps.placed_rows`."""
        rows = self._pairing.rows
        return rows.points, rows.normals, rows.gap

    def follow(self) -> None:
        """Follow the present rows from now on, even if they are frozen."""
        stage = self.stage
        self._put_stage(Stage(stage.rows, stage.normals, stage.shares))

    # Frozen pairs.

    def _at_start(self) -> Stage:
        """The stage at the start."""
        pairing = self._pairing
        stage = self._stage_of(pairing.rows, pairing.values)
        if not all(side.kinematics.linear and not side.surface.wanders for side in self.sides):
            return stage
        linear = stage.by_pairs("gaps", lambda: self._linearised(stage, pairing.rows, pairing.pose))
        return Frozen(stage.rows, stage.normals, stage.shares, linear, pairing.values)

    def _freeze(self, rows: ContactRows, q: Array) -> Frozen:
        """The stage with these pairs frozen; their gaps belong to coordinates q, (n,)."""
        stage = self._stage_of(rows)
        return Frozen(stage.rows, stage.normals, stage.shares, self._linearised(stage, rows, q))

    def _stage_of(self, rows: ContactRows, shared: Shared = None) -> Stage:
        shares = (rows.points.nodes, rows.points.weights), (rows.master, -rows.weights)
        return Stage(PresentRows(rows.points, rows.leaves_at, self.sides, rows.unpaired), rows.normals, shares, shared)

    def _linearised(self, stage: Stage, rows: ContactRows, q: Array) -> LinearGaps:
        """Gaps of these pairs while they are frozen; their present gaps belong to coordinates q, (n,)."""
        H, drift = stage.on_coordinates(q), drift_rows(self.sides, stage.shares, rows)
        start = moved(rows.gap.copy(), H, -q)
        _ = weighted_rows(start, H), stage.normal  # so that these loops are compiled before a run begins
        return LinearGaps(H, start, drift, drift @ q, _HELD * self.size)

    def stance(self) -> Array:
        """See `Gaps.stance`."""
        return self.stage.here / self.size

    def stance_at(self, anchor: Anchor) -> Array:
        """See `Gaps`."""
        return seen_from(self.stage.rows.sides.places(anchor.q, anchor.growing), self.witnesses) / self.size

    def stage_at(self, anchor: Anchor, rows: PresentRows) -> Stage:
        """See `Gaps`."""
        x_s, x_m = self.sides.places(anchor.q, anchor.growing)
        slave, master = (replace(side.surface, points=x) for side, x in zip(self.sides, (x_s, x_m), strict=True))
        projection, start = self._projection(rows.points, slave, master), self.sides[1].surface
        places, nodes = rows.points.at(x_s), x_m[master.facets]
        past, _ = continue_past_ends(projection, places, nodes, start.ends_of_facets, self.size)
        hold(projection, np.flatnonzero(~past), places, nodes, start.others, self.size)
        shares = (rows.points.nodes, rows.points.weights), (master.facets[projection.facet], -projection.weights)
        stage = Stage(rows, projection.normal, shares)
        stage.here, stage.places, stage.of_anchor = seen_from([x_s, x_m], self.witnesses), [x_s, x_m], True
        return stage

    # Followed pairs.

    def at(self, q: Array) -> Array:
        """Gaps of the present rows, (nr,) [m], at coordinates q, (n,)."""
        stage, gap = self.stage.advance(self, q)
        super().return_to(Present(stage, q, stage.places, self.present.anchor, self.growing))  # it knows its pairs
        return gap

    def of_present(self, q: Array) -> Array:
        """See `Gaps.of_present`."""
        if isinstance(self.stage, Frozen):
            return self.stage.gap(q)
        kept = self.stage.keep_rows(self, q)
        if kept is None:
            return self.at(q)
        self._go_to_stage(kept[0], q)
        return kept[1]

    @property
    def has_past(self) -> bool:
        """See `Gaps.has_past`."""
        return isinstance(self.stage, Followed)

    @property
    def longest_reach(self) -> float:
        """See `Gaps.longest_reach`. Rows with larger gaps may be new at the next search."""
        return (NEAR - 2 * SEARCHED) * self.size

    def surface_gap(self, q: Array, dents: Sequence[Array] | None = None) -> float:
        """See `Gaps.surface_gap`."""
        x_s, x_m = self.sides.dented(q, self.growing, dents)
        direction = replace(self.slave.surface, points=x_s).normal_here
        master = replace(self.sides[1].surface, points=x_m)
        projection = closest_met(np.vstack([x_s, self.all_points.at(x_s)]), direction, master)
        return float(projection.gap[facing(projection, direction, self.size, ALONG_LINE)].min(initial=np.inf))

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """See `Gaps.closing`; the last entry bounds all points without rows, by their least gap and largest speed."""
        self.at(q)
        if not self.moving:
            return super().closing(q, q_t, q_tt)
        few = self.stage
        stage, gap = few.with_more_rows(self, q)
        self._go_to_stage(stage, q)
        x_s, x_m = self.sides.places(q, self.growing)
        beyond = (NEAR - 2 * SEARCHED) * self.size if len(gap) else self._distance(x_s, x_m)
        velocities, accelerations = (self._of_nodes(q, rates) for rates in (q_t, q_tt))
        mean = velocities[1].mean(axis=0)
        speed = sum(np.linalg.norm(v - mean, axis=1).max() for v in velocities)
        rates, changes = self._of_rows(velocities), self._of_rows(accelerations)
        self._go_to_stage(few, q)  # which keep what changes slowly, such as their flexibility
        return np.append(gap, beyond), np.append(rates, -speed), np.append(changes, 0.0)

    def widen(self, q: Array) -> Array:
        """See `Gaps.widen`."""
        gap = self.at(q)
        if self.moving:
            stage, gap = self.stage.with_more_rows(self, q)
            self._go_to_stage(stage, q)
        return gap

    def follow_pushed(
        self, lam: Array, gap: Array, least: float, on_nodes: Callable[[], Sequence[Array]], *, shared: bool
    ) -> bool:
        """See `Gaps.follow_pushed`.

        No row is pushed shut by more than both surfaces are pushed outwards. Where that is not known, as on skins, by
        other contacts, and between patches of one body, four times the largest gap of a closed row is taken.
        """
        most, lifting = NEAR * self.size, self.lifting
        if not (lifting or shared) or not self.leaves_out or self.within >= most:
            return False
        known = math.isfinite(lifting)
        limit, shuts = max(limit_at(least, self.reach), self.within), lifting * float(lam.sum()) if known else 0.0
        if self.reach + shuts > limit:
            parts = zip(self.sides, self.present.coordinates, on_nodes(), strict=True)
            shuts = min(shuts, sum(side.lifted(q, forces) for side, q, forces in parts))
        if shared or not known:
            shuts = max(shuts, WIDER * float(gap[lam > 0.0].max(initial=0.0)))
        lacks, within = self.reach + shuts > limit, min(ROOM * (self.reach + shuts), most)
        if lacks or within < self.within / 2:
            self.within = within
        return lacks

    def guesses(self, *, shared: bool) -> bool:
        """Whether it is a guess how far forces push rows shut; `shared` tells whether other contacts push them too."""
        return shared or not math.isfinite(self.lifting)

    def gaps_of_all(self, q: Array, ways: Sequence[Array]) -> tuple[Array, Array]:
        """Nodes and gaps [m] of all rows that face the master, (nr,) each, at coordinates q, (n,).

        The nodes of each side are moved by ways, (np, 3) [m], in the body's axes. Where contact wanders over a patch,
        only its near part is looked at.
        """
        rows, _ = self.project(*self.sides.dented(q, self.growing, ways))
        return rows.points.row_nodes, rows.gap

    @property
    def leaves_out(self) -> bool:
        """Whether rows are followed, and not all of them."""
        return isinstance(self.stage, Followed) and self.stage.rows.leaves_out

    @property
    def lifting(self) -> float:
        """How far a unit force may push rows shut that it does not act on, at most [m/N], see `Side.lifting`.

        It is infinite if it is not known.
        """
        return self._start.once("lifting", self._lifting)

    def _lifting(self) -> float:
        if self.sides.on_demand or self.between is not None:
            return math.inf
        return sum(side.lifting for side in self._start.rows.sides)

    def _of_nodes(self, q: Array, rates: Array) -> list[Array]:
        """Velocities of the nodes, (np, 3) for each side, at coordinates q, (n,), by the rates of these, (n,)."""
        sides = zip(self.sides, self.sides.split(q), self.sides.split(rates), strict=True)
        return [side.kinematics.velocities(*parts) for side, *parts in sides]

    def _of_rows(self, velocities: Sequence[Array]) -> Array:
        """Rates of the gaps of the present rows, (nr,), from velocities of the nodes, (np, 3) for each side."""
        stage = self.stage
        slave, master = (at_points(*share, v) for share, v in zip(stage.shares, velocities, strict=True))
        return stage.rows.points.average(np.einsum("pd,pd->p", stage.normals, slave + master))

    def _distance(self, x_s: Array, x_m: Array) -> float:
        """Least gap, or a lower bound [m]: if the patches are apart, the gap between balls around them."""
        centres = x_s.mean(axis=0), x_m.mean(axis=0)
        radii = [np.linalg.norm(x - centre, axis=1).max() for x, centre in zip((x_s, x_m), centres, strict=True)]
        between = math.dist(*centres) - float(sum(radii))
        return between if between > 0 else self.project(x_s, x_m)[1]

    def project(self, x_s: Array, x_m: Array) -> tuple[ContactRows, float]:
        """Rows of all points that face the master, and the least gap [m]."""
        slave, master = (replace(side.surface, points=x) for side, x in zip(self.sides, (x_s, x_m), strict=True))
        projection = self._projection(self.all_points, slave, master)
        paired = facing(projection, slave.normal_here, self.size, ALONG_LINE)
        least = projection.gap[paired].min(initial=np.hypot(projection.gap, projection.offset).min())
        return rows_of(self.all_points, projection, paired, slave, master, self.placement.approach), float(least)

    def _projection(self, points: ContactPoints, slave: Surface, master: Surface) -> Projection:
        """Closest points of some points of the slave on the master."""
        return closest_met(points.at(slave.points), self._normals_of(points, slave), master)

    def _normals_of(self, points: ContactPoints, slave: Surface) -> Array:
        """Normals of some points of the slave by which facets are theirs, (p, 3), or (3,) for all."""
        return slave.normal_here

    def met(self, places: Sequence[Array], points: ContactPoints) -> tuple[Projection, Array, Array, Array]:
        """See `Pair.met`."""
        slave, master = (replace(side.surface, points=x) for side, x in zip(self.sides, places, strict=True))
        found = self._projection(points, slave, master)
        return found, opposite(found.normal, self._normals_of(points, slave)), points.at(slave.points), master.points

    def met_at(self, q: Array, points: ContactPoints) -> tuple[Projection, Array, Array, Array]:
        """See `Pair.met_at`."""
        return self.met(self.sides.places(q, self.growing), points)

    def search(self, q: Array, within: float | None = None) -> tuple[Stage, Array]:
        """See `Pair`.

        Of sides that may meet anywhere, pairs begin in the first evaluation that finds them near each other, and end
        when they are apart again. So nothing depends on whether others asked for their gaps while they were apart.
        """
        self.searches += 1
        places, anchor = self.sides.places(q, self.growing), Anchor(q.copy(), NOTHING, self.growing)
        here = seen_from(places, self.witnesses)
        every, least = self.project(*places)
        near, at_least = (MET, 0.0) if self.anywhere else (NEAR, SEARCHED)
        within = near * self.size if within is None else within
        if least <= within:
            return Search(self, every, places[0], here, SEARCHED * self.size, anchor).choose(self, places, here)
        # If the patches are far apart, the next search waits until they may be near.
        reach = max(at_least * self.size, 0.25 * (least - within))
        points, index = every.points.of_rows(np.empty(0, dtype=np.int64))
        shares = (points.nodes, points.weights), (every.master[index], -every.weights[index])
        rows = PresentRows(points, every.leaves_at[:0], self.sides.following(self.witnesses), every.unpaired)
        return Apart(rows, every.normals[index], shares, here, reach, anchor), NOTHING

    def sides_with(self, points: ContactPoints, facets: Array) -> Sides:
        """The sides with the nodes of these points, and the master's nodes around facets, (p,) int array."""
        slave, master = (side.surface for side in self.sides)
        of_master = np.zeros(len(master.points), dtype=bool)
        of_master[master.facets[facets]] = True
        of_master[master.facets[of_master[master.facets].any(axis=1)]] = True
        of_master[self.witnesses[1]] = True
        of_slave = np.zeros(len(slave.points), dtype=bool)
        of_slave[points.nodes] = of_slave[self.witnesses[0]] = True
        return self.sides.following([np.flatnonzero(of_slave), np.flatnonzero(of_master)])


def _has_hardly_slid(here: Array, stood: Array, size: float) -> bool:
    """Whether a slave has slid by less than a small share of a facet's `size` [m] from one place to another.

    Places are those relative to the master, (3, 3) [m], see `witnesses.seen_from`.
    """
    return bool(abs(here - stood)[:, :2].max() < _STILL * _HELD * size)
