"""Rows between two bodies in compiled steps: loops follow them, and `PatchGaps` finds others where they cannot.

So these rows are those of Exudyn's runs, found by the same functions. Compiled loops go on from a search to the next
one. They stop where a patch has moved by a quarter of a facet, where rows may close that are not followed, and where
pairs begin to slide or have come to rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from types import ModuleType
from typing import Any, Protocol

import numpy as np

from ..contact.followed import BULGE, NEAR, WIDER, Apart, Followed
from ..contact.gaps import GapState
from ..contact.loops import flat_pair
from ..contact.patch_gaps import PATIENCE, ROOM, PatchGaps
from ..contact.side import Side
from ..contact.stages import NOTHING, Anchor, Frozen, Present, Stage
from ..contact.wandering import WanderingGaps
from ..support.arrays import Array
from ..surfaces.holders import FOLLOWED
from ..surfaces.pairs import STEPS, MovingPairs
from .moving import Following, MovingState, growing_of

FOLLOWING = FOLLOWED, STEPS, NEAR, PATIENCE, BULGE, ROOM, WIDER  # as loops take them
_NO_MATRIX = np.zeros((0, 0))


class AnchorState(Protocol):
    """What changes of several contacts in a run, as far as the search for rows needs it, see `MovingState`."""

    @property
    def anchored(self) -> Array:
        """Whether contacts have an anchor, (ns,) bool."""

    @property
    def anchors(self) -> Array:
        """Coordinates there, (ns, nq)."""

    @property
    def growing(self) -> Array:
        """Products by which both sides grew there, (ns, 12)."""

    @property
    def fresh(self) -> Array:
        """Whether contacts have found another anchor since the last sample, (ns,) bool."""

    @property
    def left(self) -> Array:
        """Whether closed rows have left their patch, (ns,) bool."""

    @property
    def left_at(self) -> Array:
        """Coordinates of the first such sample, (ns, nq)."""


class FollowedPair:
    """The rows between two bodies in a run; subclasses have their flexibility.

    Parameters
    ----------
    following : Following
    s : int
        Number of the contact among those of `state`.
    rows : slice
        All rows of its patch, among those of all contacts.
    state : AnchorState
    moving : MovingState
        By which bodies grow.
    loops : module or None
        `pair_kernels`, if loops are compiled.

    Attributes
    ----------
    s, contact : int
    gaps : PatchGaps
        Of this run.
    """

    gaps: PatchGaps

    def __init__(
        self, following: Following, s: int, rows: slice, state: AnchorState, moving: MovingState,
        loops: ModuleType | None,
    ) -> None:  # fmt: skip
        assert isinstance(following.gaps, PatchGaps)
        self.s, self.contact, self._following = s, following.contact, following
        self._anchors, self._moving, self._loops, self._rows = state, moving, loops, rows
        self.gaps = following.gaps.for_run()
        self._slots = np.empty(0, dtype=np.int64)
        self._stage: object = None  # frozen stage or rows that `_slots` belong to
        self._steps, self._known = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=bool)
        self._within = np.zeros(1)  # `gaps.within`, which loops share
        self._stood: Array | None = None
        self._room: tuple[Array, Array, Array]  # for gaps, normals and the slave's place, which loops share
        self.compiled: Any = None  # the present rows as loops take them

    def begin(self, before: GapState | None) -> None:
        """Begin a run where contacts are placed, or from the state at the end of another."""
        self.gaps.begin(before)
        before = self.gaps.accepted
        self._stage, self._known[0], self._anchors.left[self.s], self._within[0] = None, False, False, 0.0
        self._steps[0], self._stood = before.steps, before.stood

    def take_anchor(self, anchor: Anchor | None) -> None:
        """Have another anchor, or none."""
        state = self._anchors
        state.anchored[self.s] = anchor is not None
        if anchor is not None:
            state.anchors[self.s, self._following.dofs] = anchor.q
            state.growing[self.s] = both_growing(anchor.growing)
        if self._stage is not None:
            self._take_anchor()
            self._stage = None
            self._renew()

    def end(self, q: Array) -> GapState:
        """State at the model's coordinates q, (nq,)."""
        gaps, anchored = self.gaps, self._anchors.anchored[self.s]
        self._take_anchor()
        now = gaps.after()
        frozen = None if gaps.moving else now.frozen
        return replace(
            now, q=q[self._following.dofs], pose=NOTHING, anchor=gaps.present.anchor if anchored else None,
            frozen=frozen, stood=self._stood, steps=int(self._steps[0]), growing=growing_of(gaps, self.products),
        )  # fmt: skip

    @property
    def products(self) -> Array:
        """Products by which both sides grow now, (12,); zero if they do not."""
        none = np.zeros(6)
        return np.concatenate([none if b < 0 else self._moving.products[b] for b in self._following.bodies])

    def _take_anchor(self) -> None:
        """Let the gaps have the anchor that loops have found."""
        if self._anchors.anchored[self.s]:
            q, products = self._anchors.anchors[self.s, self._following.dofs], self._anchors.growing[self.s]
            there = Anchor(q, NOTHING, growing_of(self.gaps, products))
            known = self.gaps.present.anchor
            if known is None or not known.equals(there):
                self.gaps.accept_anchor(there)
        else:
            self.gaps.present.anchor = None

    def place(self, q: Array, q_before: Array, v: Array, h: Array) -> None:
        """Find the rows at the model's coordinates q, (nq,), and set the gaps of all rows of the patch among h.

        Parameters
        ----------
        q, q_before : (nq,) arrays
            Coordinates now, and at the end of the last step.
        v : (nq,) array
            Velocities by which bodies grow.
        h : (n,) array
            Gaps of the rows of all contacts [m].

        Raises
        ------
        ComplementarityError
            If places are not finite.
        """
        gaps = self.gaps
        both = zip(gaps.sides, gaps.sides.split(v[self._following.dofs]), strict=True)
        gaps.grow([side.kinematics.growing(part) for side, part in both])
        self.find_rows(q, q_before, h)

    def find_rows(self, q: Array, q_before: Array, h: Array) -> None:
        """See `place`; with bodies that grow as the gaps know it."""
        dofs, gaps = self._following.dofs, self.gaps
        self._take_anchor()
        if gaps.moving and gaps.may_freeze and self._steps[0] >= PATIENCE:
            self._come_to_rest(q_before[dofs])
        gaps.within = float(self._within[0])
        found = gaps.at(q[dofs])
        self._renew()
        own = h[self._rows]
        own[:] = self.beyond(found)
        own[self._slots] = found
        self._known[0] = False
        if self.compiled is not None:
            stage, (of_rows, normals, here) = gaps.stage, self._room
            self._known[0], of_rows[:], here[:] = True, found, stage.here
            normals[:] = stage.normal if isinstance(stage, Frozen) else stage.normals

    def beyond(self, gap: Array) -> float:
        """Gap of rows that are not present, which they cannot close, by those that are, (nr,) [m]."""
        return float(abs(gap).max()) if len(gap) else self.gaps.size

    def _come_to_rest(self, q: Array) -> None:
        """Freeze the pairs if they have hardly slid in many steps, the last of which ended at q, (n,)."""
        gaps = self.gaps
        if self.compiled is not None and isinstance(gaps.stage, Followed):  # where loops have followed it
            _, normals, here = self._room
            stage = Followed(gaps.stage.rows, normals.copy(), here.copy())
            gaps.return_to(Present(stage, q, None, gaps.present.anchor, gaps.growing))
        gaps.accept(GapState(q, NOTHING, gaps.present.anchor, stood=self._stood, steps=PATIENCE - 1))
        gaps.accept(gaps.after())
        self._steps[0], self._stood = gaps.accepted.steps, gaps.accepted.stood

    def _renew(self) -> None:
        """Let loops know the present rows, if these are others than before."""
        stage = self.gaps.stage
        present: object = stage if isinstance(stage, Frozen) else stage.rows
        if present == self._stage:
            return
        self._stage = present
        self._slots = self.gaps.all_points.rows_of(stage.rows.row_nodes)
        self.take_rows(stage)
        if self._loops is not None:
            self.compiled = self._for_loops(stage)

    def take_rows(self, stage: Stage) -> None:
        """Know that other rows are present, whose flexibility is not known."""
        raise NotImplementedError

    # As loops take them.

    @cached_property
    def _flexibilities(self) -> list[Array]:
        return [np.require(side.flexibility, float, ["C", "W"]) for side in self.gaps.sides]

    def _for_loops(self, stage: Stage) -> Any:
        """The present rows for compiled loops."""
        found = self._loops
        assert found is not None, "asked for what is only done at once"
        gaps, rows, anchor = self.gaps, stage.rows, self.gaps.present.anchor
        sides = rows.sides
        both = [self._side(place, side) for place, side in enumerate(sides)]
        p = len(stage.normals)
        at_here, along = np.zeros((3, 3)), [np.zeros((p, 1 if side.normal_only else 3)) for side in sides]
        shape = p, sides[1].surface.facets.shape[1]
        carriers = np.zeros(shape, dtype=np.int64), np.zeros(shape)
        if not isinstance(stage, Frozen) and p and anchor is not None:
            of_anchor = gaps.anchoring.stage(anchor)
            at_here[:], (carriers[0][:], carriers[1][:]) = of_anchor.here, of_anchor.shares[1]
            for kept, side, q in zip(along, sides, gaps.sides.split(anchor.q), strict=True):
                kept[:] = 1.0 if side.normal_only else side.kinematics.in_frame(q, of_anchor.normals)
        elif anchor is not None:
            at_here[:] = gaps.anchoring.stance(anchor) * gaps.size
        nr = len(self._slots)
        normals = np.array(stage.normal) if isinstance(stage, Frozen) else np.zeros((p, 3))
        self._room = np.zeros(nr), normals, np.zeros((3, 3))
        parted, part_reach = np.zeros((3, 3)), np.inf
        if isinstance(gaps, WanderingGaps):
            parted, part_reach = gaps.parted
        linear, reach, k = self._linear(stage), np.inf, 0
        if isinstance(stage, Followed):
            reach, k = stage.rows.search.reach, len(stage.rows.points.nodes)
        elif isinstance(stage, Apart):
            reach = stage.reach
        flat, before = self._flat(stage), (np.zeros(k, dtype=np.int64), np.zeros((6, k)))
        dofs = np.require(self._following.dofs, np.int64, ["C", "W"])
        return found.pair(
            self.contact, dofs, flat, *both, self._slots, float(gaps.size), float(reach), float(part_reach),
            parted, *self._room, at_here, *before, self._known, _writable(rows.leaves_at),
            *along, *carriers, int(isinstance(stage, Frozen)), int(gaps.may_freeze), *linear, self._steps,
            self._within, float(gaps.lifting), int(gaps.leaves_out),
        )  # fmt: skip

    def _side(self, place: int, side: Side) -> Any:
        """One side for compiled loops."""
        assert self._loops is not None
        x, fields = np.full((len(side.surface.points), 3), np.nan), _writable(self._following.fields[place])
        d, body = 1 if side.normal_only else 3, self._following.bodies[place]
        return self._loops.pair_side(body, d, x, self._flexibilities[place], fields)

    def _flat(self, stage: Stage) -> Any:
        """The points that are followed, with the nodes of both sides; no points where no rows are."""
        if isinstance(stage, Followed):
            return stage.rows.flat_pair
        gaps = self.gaps
        points, index = stage.rows.points.of_rows(np.empty(0, dtype=np.int64))
        none = MovingPairs(gaps.sides[1].surface, np.empty(0, dtype=np.int64), np.zeros((0, 2)))
        here = stage.here if isinstance(stage, Apart) else np.zeros((3, 3))
        empty = np.zeros(0), np.zeros((0, 12)), np.zeros(12)
        return flat_pair(none.followed(points, index, *gaps.witnesses, here, *empty), stage.rows.sides)

    @staticmethod
    def _linear(stage: Stage) -> tuple[Array, Array, Array, Array, float]:
        """Gaps of frozen rows for compiled loops."""
        if not isinstance(stage, Frozen):
            return _NO_MATRIX, np.zeros(0), _NO_MATRIX, np.zeros(0), 0.0
        linear = stage.linear
        H, start, drift, drift_start = map(_writable, (linear.H, linear.start, linear.drift, linear.drift_start))
        return H, start, drift, drift_start, float(linear.reach)

    # By NumPy.

    def renew_anchor(self, same: float) -> bool:
        """Take an anchor here if rows have moved by more than `same` since the last one; whether that was done."""
        gaps, state = self.gaps, self._anchors
        self._take_anchor()
        before = gaps.present.anchor
        anchor = gaps.anchoring.anchor(same)
        if anchor == before:
            return False
        state.anchored[self.s], state.fresh[self.s] = True, True
        state.anchors[self.s, self._following.dofs] = anchor.q
        state.growing[self.s] = both_growing(anchor.growing)
        if self.compiled is not None:
            self.compiled = self._for_loops(gaps.stage)
        return True

    def gaps_at(self, q: Array, q_before: Array, v: Array, h: Array) -> None:
        """See `place`; loops do not go on from it at the same coordinates."""
        self.place(q, q_before, v, h)
        self._known[0] = False

    def watch_edge(self, values: Array, h: Array, lam: Array, q: Array) -> None:
        """See `moving_kernels.watch_edges`; `values`, `h` and `lam` are of all contacts, and of all their rows."""
        state, leaves_at = self._anchors, self.gaps.stage.rows.leaves_at
        if not state.left[self.s] and values[self.contact, 1] > 0.0:
            depth, pushed = -h[self._rows][self._slots], lam[self._rows][self._slots] > 0.0
            if (pushed & ((leaves_at == 0.0) | (depth >= leaves_at))).any():
                state.left[self.s], state.left_at[self.s] = True, q

    def count_step(self) -> None:
        """Count a step of pairs that slide, and may be frozen again."""
        self._steps[0] += self.gaps.may_freeze and self.gaps.moving and len(self._slots) > 0


def both_growing(growing: Array) -> Array:
    """`Gaps.growing` of two sides, (12,); zero if none grows."""
    return growing if len(growing) else np.zeros(12)


def _writable(values: Any) -> Array:
    """Values as loops are compiled for: those of arrays that cannot be written to, or of another layout, are others."""
    return np.require(values, float, ["C", "W"])


class FollowedPairs:
    """Several contacts of two bodies in a run, as loops find them by their addresses.

    Parameters
    ----------
    pairs : sequence of FollowedPair
    first : int
        Number of the first one among those of their state.
    loops : module or None
        `pair_kernels`, if loops are compiled.
    """

    def __init__(self, pairs: Sequence[FollowedPair], first: int, loops: ModuleType | None) -> None:
        self._pairs, self._first, self._loops = pairs, first, loops
        self._addresses, self._held = np.zeros(len(pairs), dtype=np.int64), [None] * len(pairs)

    @cached_property
    def for_loops(self) -> Any:
        """These contacts as compiled loops take them; None if there are none. All have been held."""
        if not self._pairs:
            return None
        assert self._loops is not None, "asked for what is only done at once"
        return self._loops.pairs(self._addresses, self._pairs[0].compiled, self._first, FOLLOWING)

    def hold(self, number: int) -> None:
        """Let loops find the present rows of a contact."""
        one = self._pairs[number].compiled
        if self._loops is not None and one is not None and one != self._held[number]:
            assert one._numba_type_ == self._pairs[0].compiled._numba_type_, "loops would read others as the first one"
            self._held[number], self._addresses[number] = one, self._loops.address(one)

    def hold_all(self) -> None:
        """Let loops find the present rows of all contacts."""
        for number in range(len(self._pairs)):
            self.hold(number)
