"""Where a contact finds the flexibility of its rows, and what it keeps from there.

The flexibility of rows that move changes with their pairs and normals. It is found at an *anchor*, a place where the
sides were, and kept while they have moved little since. The anchor is part of the state, see `Gaps.accepted`: the
flexibility follows from it, whatever came before. All else here saves time, and may be lost.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Protocol

from ..algebra.products import largest_change
from ..support.arrays import Array
from .side import LoadedNodes
from .sides import Sides
from .stages import NOTHING, Anchor, Present, PresentRows, Stage, T

SAME = 0.01  # of a facet's size, or change of normals: below it, rows keep their flexibility
_FROZEN = Anchor(NOTHING, NOTHING, NOTHING)  # of frozen rows, whose flexibility does not change


class Anchored(Protocol):
    """The part of `Gaps` that its anchoring needs."""

    present: Present
    stage: Stage
    sides: Sides

    def return_to(self, present: Present) -> None:
        """See `Gaps.return_to`."""

    def stance(self) -> Array:
        """See `Gaps.stance`."""

    def stance_at(self, anchor: Anchor) -> Array:
        """See `Gaps.stance_at`."""

    def stage_at(self, anchor: Anchor, rows: PresentRows) -> Stage:
        """See `Gaps.stage_at`."""


class Anchoring:
    """The anchor of the present rows of a contact, and what is found there.

    Parameters
    ----------
    gaps : Gaps
        Its `present` has the anchor.
    """

    def __init__(self, gaps: Anchored) -> None:
        self._gaps = gaps
        self._stance: tuple[object, object, Array] = (None, None, NOTHING)  # of rows at an anchor
        self._stage: tuple[object, object, Stage | None] = (None, None, None)  # of rows at an anchor
        self._loaded: dict[int, tuple[object, LoadedNodes]] = {}  # of what rows or side, for each side

    def anchor(self, same: float) -> Anchor:
        """The anchor. If the sides have moved by more than `same` since, this is where they are now.

        `same` is in sizes of a facet, or changes of normals.
        """
        gaps, here, stage = self._gaps, self._gaps.present, self._gaps.stage
        if not stage.moving:
            return _FROZEN
        if stage.rows.made_at is not None:
            here.anchor = stage.rows.made_at
            return here.anchor
        anchor, stance = here.anchor, gaps.stance()
        if anchor is None or not largest_change(stance, self.stance(anchor)) <= same:
            here.anchor = anchor = Anchor(here.q.copy(), stage.pose, here.growing)
            _ = stage.shares  # which are those of the present places only now
            self._stage = anchor, stage.rows, stage  # pairs that are followed need no projection anew
            self._stance = anchor, stage.rows, stance
        return anchor

    def stance(self, anchor: Anchor) -> Array:
        """`Gaps.stance` of the present rows at an anchor."""
        rows = self._gaps.stage.rows
        if self._stance[:2] != (anchor, rows):
            self._stance = anchor, rows, self._gaps.stance_at(anchor)
        return self._stance[2]

    def stage(self, anchor: Anchor) -> Stage:
        """The present rows with their pairs and normals at an anchor."""
        last_anchor, last_rows, stage = self._stage
        rows = self._gaps.stage.rows
        if stage is None or (last_anchor, last_rows) != (anchor, rows):
            stage = self._gaps.stage_at(anchor, rows)
            self._stage = anchor, rows, stage
        return stage

    def found_at(self, anchor: Anchor, make: Callable[[], T]) -> T:
        """Value that is found with the present rows, but with the places, pairs and normals at an anchor."""
        if anchor == _FROZEN:
            return make()
        gaps, now, stage = self._gaps, self._gaps.present, self.stage(anchor)
        if stage == now.stage:  # the anchor is here
            return make()
        gaps.return_to(Present(stage, anchor.q, stage.places, now.anchor, anchor.growing))
        try:
            return make()
        finally:
            gaps.return_to(now)

    def kept(self, what: Hashable, same: float, make: Callable[[], T], index: Array = NOTHING) -> T:
        """Value of this name that is found at the anchor, see `anchor` for `same`, and kept as long as that stays.

        `index` are the rows to which it belongs; by default, all.
        """
        anchor = self.anchor(same)
        return self._gaps.stage.rows.at_anchor(what, anchor, lambda: self.found_at(anchor, make), index)

    def loaded_nodes(self, place: int) -> LoadedNodes:
        """One side's nodes that carry the present rows, and perhaps nodes that carried earlier rows."""
        stage, side = self._gaps.stage, self._gaps.sides[place]
        nodes, owner = stage.shares[place][0], side if stage.rows.made_at is None else stage.rows
        known, loaded = self._loaded.get(place, (None, None))
        if loaded is None or known != owner or not loaded.carry(nodes):
            loaded = LoadedNodes.of(side, nodes)
            self._loaded[place] = owner, loaded
        return loaded
