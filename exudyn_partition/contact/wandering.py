"""Gaps between two patches over which contact wanders. Only parts that are near each other are followed.

The parts are found with trees of the patches' nodes. They are found again when the patches have moved by a facet. So
the cost of a step depends on the near parts, not on the size of the patches. Several spots may be near at once. They
appear and vanish as the patches move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..algebra.products import largest_change
from ..support.arrays import Array
from ..surfaces.facing import closest_met, facing
from ..surfaces.near import LIMIT, NODE_TO_FACET, NearParts, near_rows
from ..surfaces.points import ContactPoints
from ..surfaces.rows import ContactRows
from ..surfaces.surface import Surface, closest_points
from ..surfaces.witnesses import seen_from, spread
from . import loops
from .followed import SEARCHED, Followed
from .gaps import GapState
from .patch_gaps import PatchGaps
from .rigid import OnRigid, RigidGaps
from .side import Side
from .sides import Sides
from .stages import NOTHING, Anchor, Present, PresentRows, Stage

WINDOW = 1.0  # of a facet's size: motion after which the parts are found again
_THREE = np.arange(3)
_FAR = 4.0  # of a facet's size: sides whose boxes are farther apart than that are not looked at more closely
SOON = 0.15  # of a facet's size: rows with smaller gaps are chosen, and after this motion chosen again


class WanderingGaps(PatchGaps):
    """Gaps between two patches; contact wanders over at least one of them, see `Partition.surface`.

    Pairs are never frozen.

    Parameters
    ----------
    slave, master : Side
    kind : {"integrated", "node-to-segment"}

    Raises
    ------
    EmptyRegionError, PenetrationError
        See `near.pair_wandering`.
    """

    _parted_at: Array | None
    _parted: Anchor | None
    _part_reach: float

    def _go_to_start(self) -> None:
        """See `Gaps`."""
        self.sides, self._parted_at, self._parted = self._start.rows.sides, None, None
        self._three = [side.kinematics.some(some) for side, some in zip(self.sides, self.witnesses, strict=True)]
        super()._go_to_start()

    def after(self) -> GapState:
        """See `Gaps`."""
        return replace(super().after(), parted=self._parted)

    def accept(self, state: GapState) -> None:
        """See `Gaps`."""
        if state.parted is not None and (self._parted is None or not self._parted.equals(state.parted)):
            self._do_at(state.parted, self._part)
        super().accept(state)

    def at(self, q: Array) -> Array:
        """See `Gaps.at`."""
        if isinstance(self.stage, Followed):  # following rows finds how far the patches have moved
            gap, stage = super().at(q), self.stage
            if isinstance(stage, Followed) and self._is_near(stage.here):
                return gap
        self._part_if_moved(q)
        return super().at(q)

    def _is_near(self, here: Array) -> bool:
        """Whether the parts are still those that are near each other, with the slave at a place, (3, 3) [m]."""
        return self._parted_at is not None and largest_change(here, self._parted_at) <= self._part_reach

    @property
    def parted(self) -> tuple[Array, float]:
        """Place of the slave, (3, 3) [m], at which the present parts were found, and motion that ends them [m]."""
        assert self._parted_at is not None
        return self._parted_at, self._part_reach

    def of_present(self, q: Array) -> Array:
        """See `Gaps.of_present`."""
        return super().of_present(q) if self._parted_at is not None else self.at(q)

    @property
    def longest_reach(self) -> float:
        """See `Gaps.longest_reach`."""
        return (LIMIT - 2 * SEARCHED) * self.size

    def search(self, q: Array, within: float | None = None) -> tuple[Stage, Array]:
        """See `PatchGaps.search`; the parts are found where pairs of sides that may meet anywhere begin."""
        stage, gap = super().search(q, within)
        begins = self.anywhere and within is None and isinstance(stage, Followed) and not self.has_past
        if begins and (self._seen(q) != self._parted_at).any():
            self._part(q)
            return super().search(q)
        return stage, gap

    def _seen(self, q: Array) -> Array:
        """Place of the slave relative to the master at coordinates q, (n,): (3, 3) [m]."""
        parts = zip(self._three, self.sides.split(q), self.sides.growths(self.growing), strict=True)
        places = [three.place(*part) for three, *part in parts]
        return seen_from(places, [_THREE, _THREE])

    def _part_if_moved(self, q: Array) -> None:
        """Find the parts that are near each other at coordinates q, (n,), unless they are known."""
        if not self._is_near(self._seen(q)):
            self._part(q)

    def _part(self, q: Array) -> None:
        """Find the parts that are near each other at coordinates q, (n,)."""
        near, here = self._near_parts(q), self._seen(q)
        self._least, self._apart_by_far = near.least, not len(near.nodes)
        if not self._apart_by_far:
            self._near_points = near.points(self.all_points)
        both = zip(self._start.rows.sides, (near.slave_facets, near.master_facets), self.witnesses, strict=True)
        self.sides = Sides(side.part(facets, witnesses) for side, facets, witnesses in both)
        self.follow()
        self._parted_at, self._parted = here, Anchor(q.copy(), NOTHING, self.growing)
        self._part_reach = max(WINDOW * self.size, 0.25 * (near.least - LIMIT * self.size))

    def least_distance(self, q: Array) -> float:
        """See `Gaps.least_distance`; by boxes around the sides, by nodes, or by the slave's points if they are near."""
        places = self._start.rows.sides.places(q, self.growing)
        lower, upper = ([pick(x, axis=0) for x in places] for pick in (np.min, np.max))
        between = np.maximum(np.maximum(lower[0] - upper[1], lower[1] - upper[0]), 0.0)
        apart = float(np.linalg.norm(between))
        if apart > _FAR * self.size:
            return apart
        near = self._near_parts(q)
        if not len(near.nodes):
            return near.least
        sides, points = self._start.rows.sides, near.points(self.all_points)
        master = places[1][sides[1].surface.facets[near.master_facets]]
        closest = closest_points(points.at(places[0]), master)
        return float(np.hypot(closest.gap, closest.offset).min(initial=near.least if not len(points.nodes) else np.inf))

    def _near_parts(self, q: Array) -> NearParts:
        sides = self._start.rows.sides
        slave, master = (
            replace(side.surface, points=x) for side, x in zip(sides, sides.places(q, self.growing), strict=True)
        )
        return NearParts.of(slave, master, (LIMIT + WINDOW) * self.size)

    def project(self, x_s: Array, x_m: Array) -> tuple[ContactRows, float]:
        """Rows of the near points that face the master, and the least gap [m]."""
        if self._apart_by_far:
            return self._pairing.rows, self._least
        slave, master = (replace(side.surface, points=x) for side, x in zip(self.sides, (x_s, x_m), strict=True))
        return near_rows(self._near_points, slave, master, self.placement.approach)

    def _normals_of(self, points: ContactPoints, slave: Surface) -> Array:
        """See `PatchGaps`."""
        return slave.normals_at(points.nodes, points.weights)

    def surface_gap(self, q: Array, dents: Sequence[Array] | None = None) -> float:
        """See `Gaps.surface_gap`; a lower bound if the patches are far apart."""
        near = self._near_parts(q)
        if not len(near.nodes):
            return near.least
        sides, facets = self._start.rows.sides, (near.slave_facets, near.master_facets)
        points, nodes_at = near.points(self.all_points), sides.dented(q, self.growing, dents)
        slave, master = (
            replace(side.surface, points=x, facets=side.surface.facets[some])
            for side, x, some in zip(sides, nodes_at, facets, strict=True)
        )
        nodes = near.nodes[:, None]
        carriers = (points.nodes, points.weights), (nodes, np.ones(nodes.shape))
        places = np.vstack([points.at(slave.points), slave.points[near.nodes]])
        normals = np.vstack([slave.normals_at(*carrier) for carrier in carriers])
        projection = closest_met(places, normals, master)
        return float(projection.gap[facing(projection, normals, self.size)].min(initial=np.inf))

    def gaps_of_all(self, q: Array, ways: Sequence[Array]) -> tuple[Array, Array]:
        """See `PatchGaps.gaps_of_all`."""
        self._part_if_moved(q)
        return super().gaps_of_all(q, ways)

    def _distance(self, x_s: Array, x_m: Array) -> float:
        return self._near_parts(self.present.q).least if self._apart_by_far else self.project(x_s, x_m)[1]


@dataclass(frozen=True, eq=False)
class Choice:
    """Rows that may close soon, and how long that holds.

    Parameters
    ----------
    anchor : Anchor
        Where the patch was when they were chosen.
    here : (3, 3) array
        Places of three nodes relative to the surface then [m].
    reach : float
        Motion of these places after which rows are chosen again [m].
    beyond : float
        Until then, points without rows have larger gaps [m].
    side : Side
        The part of the patch around the rows.
    """

    anchor: Anchor
    here: Array
    reach: float
    beyond: float
    side: Side


class ChosenRows(PresentRows):
    """Present rows with the choice by which they are present; None at the start."""

    choice: Choice | None = None


class WanderingRigidGaps(RigidGaps):
    """Gaps to a rigid surface of a patch over which contact wanders; see `RigidGaps`.

    Only rows that may close soon are present. They are chosen again when the patch has moved by a part of a facet.
    """

    _choice: Choice | None = None  # that of the present rows

    def _rows_at_start(self) -> PresentRows:
        """See `RigidGaps`. It also keeps the whole patch, and points that witness its motion."""
        self._whole, self._witnesses = self.slave, spread(self.slave.surface.points)
        gap = self._projected(self.slave.surface.points - self.centre, self.carrier.pose)[0]
        return self._rows_of(np.flatnonzero(gap <= gap.min() + SOON * self.size))

    def _direction(self, node: int) -> Array:
        direction: Array = self.slave.surface.normals_at(np.array([[node]]), np.ones((1, 1)))[0]
        return direction

    def _rows_of(self, nodes: Array) -> ChosenRows:
        rows = self._rows(self.all_points.of_rows(np.isin(self.all_points.row_nodes, nodes))[0])
        return ChosenRows(rows.points, rows.leaves_at, rows.sides)

    def return_to(self, present: Present) -> None:
        """See `Gaps`."""
        super().return_to(present)
        rows = present.stage.rows
        choice = rows.choice if isinstance(rows, ChosenRows) else None
        if choice != self._choice:
            self._choice = choice
            self.sides = Sides((self._whole if choice is None else choice.side,))

    def after(self) -> GapState:
        """See `Gaps`."""
        return replace(super().after(), chosen=None if self._choice is None else self._choice.anchor)

    def accept(self, state: GapState) -> None:
        """See `Gaps`."""
        super().accept(state)
        self._take_rows(state)

    def _take_rows(self, state: GapState) -> None:
        """See `Gaps`."""
        if state.chosen is not None and (self._choice is None or state.chosen != self._choice.anchor):
            self._choose(state.chosen)

    def at(self, q: Array) -> Array:
        """See `Gaps.at`."""
        choice, pose, rows = self._choice, self.carrier.pose, self.stage.rows
        if choice is not None:
            stage, gap, is_near = self._placed_as_chosen(rows, Anchor(q, pose, self.growing), choice)
            if is_near:
                self._go_to_stage(stage, q)
                return gap
        self._choose(Anchor(q.copy(), pose, self.growing))
        return self._gaps_at(q, pose)

    def _placed_as_chosen(self, rows: PresentRows, where: Anchor, choice: Choice) -> tuple[Stage, Array, bool]:
        """See `RigidGaps._placed`; also whether the rows of a choice are still those that may close."""
        q, pose, growing = where.q, where.pose, where.growing
        if self.primitive is None or not loops.at_once():
            stage, gap = self._placed(rows, where)
            return stage, gap, stage.places is not None and self._is_near(stage.places[0], pose, choice)
        (side,) = rows.sides
        x, seen = side.places_begun(q, growing), (self._witnesses, choice.here)
        gap, normals, way = loops.near_gaps(rows.flat, side, self.primitive, (q, pose, growing), x, *seen)
        return OnRigid(rows, normals, x, where), gap, way <= choice.reach

    def of_present(self, q: Array) -> Array:
        """See `Gaps.of_present`."""
        if self._choice is None:
            return self.at(q)
        return super().at(q)

    def least_distance(self, q: Array) -> float:
        """See `Gaps.least_distance`; not known while a body carries the surface."""
        if self.carried:
            return -np.inf
        places = self._whole.place(q, self.growing)
        by_nodes = float(self._projected(places, NOTHING)[0].min()) - NODE_TO_FACET * self._whole.surface.longest
        if by_nodes > _FAR * self.size:
            return by_nodes
        return float(self._projected(self.all_points.at(places), NOTHING)[0].min())

    def _here(self, places: Array, pose: Array) -> Array:
        """Places of three nodes relative to the surface, (3, 3) [m].

        `places` are those of the patch's nodes, (np, 3), and `pose` is that of the surface's carrier.
        """
        x: Array = places[self._witnesses]
        return x if not len(pose) else (x - pose[:3]) @ pose[3:].reshape(3, 3)

    def _is_near(self, places: Array, pose: Array, choice: Choice) -> bool:
        """Whether rows of a choice are still those that may close, with nodes at places, (np, 3) [m]."""
        return largest_change(self._here(places, pose), choice.here) <= choice.reach

    def _choose(self, anchor: Anchor) -> None:
        """Choose the rows that may close until the patch has moved by `Choice.reach`, and the nearest rows."""
        places = self._whole.place(anchor.q, anchor.growing)
        gap = self._projected(places, anchor.pose)[0]
        least, soon = float(gap.min()) - self.reach, SOON * self.size
        reach = max(soon, 0.25 * (least - 2 * soon))
        nodes = np.flatnonzero(gap < self.reach + max(2 * soon, least + soon))
        facets = np.flatnonzero(np.isin(self._whole.surface.facets, nodes).any(axis=1))
        part = self._whole.part(facets, self._witnesses)
        self.sides = Sides((part,))
        rows, beyond = self._rows_of(nodes), self.reach + max(least, 2 * soon) - reach
        rows.choice = Choice(anchor, self._here(places, anchor.pose), reach, beyond, part)
        self._put_stage(Stage(rows, self.stage.normals, self.stage.shares))  # `at` finds these two

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """See `Gaps.closing`; the last entry bounds all points without rows, by their least gap and largest speed."""
        gap, rate, acceleration = super().closing(q, q_t, q_tt)
        kinematics = self._whole.kinematics
        velocity = kinematics.velocities(q, q_t)
        if self.carried:
            motion, arms = self.carrier.motion, kinematics.place(q, self.growing) - self.carrier.pose[:3]
            velocity = velocity - motion[:3] - np.cross(motion[3:], arms)
        speed = float(np.linalg.norm(velocity, axis=1).max())
        beyond = np.inf if self._choice is None else self._choice.beyond
        return np.append(gap, beyond), np.append(rate, -speed), np.append(acceleration, 0.0)

    @property
    def whole(self) -> Side:
        """See `RigidGaps.whole`."""
        return self._whole
