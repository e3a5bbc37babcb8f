"""Stages of a contact: the rows that are present, and what follows from them.

A stage does not change. `advance` gives the stage at other coordinates; while its rows stay frozen, it is the same one.
What follows from a stage is kept on it, and goes with it. So nobody needs to ask whether it still holds.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from ..algebra.products import largest_change, moved, weighted_rows
from ..support.arrays import Array
from ..surfaces.points import ContactPoints
from .linear_gaps import LinearGaps
from .pairings import Pairing
from .side import Side

if TYPE_CHECKING:
    from typing import Self

T = TypeVar("T")
Shares = Sequence[tuple[Array, Array]]  # for each side: nodes of the points, and their signed weights in the gap
NOTHING = np.empty(0)
Pressed = tuple[Array, Array, float]  # forces on rows, (nr,) [N], generalised forces, (n,), and the least gap [m]


class Pair(Protocol):
    """Two patches that may touch, as far as stages need them, see `patch_gaps.PatchGaps`.

    Attributes
    ----------
    sides : tuple of Side
    size : float
        Size of the master's facets [m].
    witnesses : list of (3,) int arrays
        Nodes by which each side is seen.
    """

    sides: tuple[Side, ...]
    size: float
    witnesses: list[Array]

    def places(self, q: Array) -> list[Array]:
        """See `Gaps.places`."""

    def places_of(self, sides: Sequence[Side], q: Array) -> list[Array]:
        """See `Gaps.places_of`."""

    def sides_with(self, points: ContactPoints, facets: Array) -> tuple[Side, ...]:
        """The sides with the nodes of these points, and those of the master around facets, (p,) int array."""

    def search(self, q: Array) -> tuple[Stage, Array]:
        """Find the pairs of all points at coordinates q, (n,); return the stage of those that can close, with gaps."""


class PresentRows:
    """Rows that are present for a while, in which the sides move.

    Parameters
    ----------
    points : ContactPoints
        Points of the rows.
    at_edge : (nr,) bool array
        Rows at the edge of the contact patch.
    sides : tuple of Side
        The sides, perhaps only with the nodes that these rows need.
    unpaired : int
        Number of the slave's points that faced nothing when the rows were found.
    """

    def __init__(self, points: ContactPoints, at_edge: Array, sides: tuple[Side, ...], unpaired: int = 0) -> None:
        self.points, self.row_nodes, self.area = points, points.row_nodes, points.area
        self.at_edge, self.sides, self.unpaired = at_edge, sides, unpaired
        self._slow: dict[Hashable, tuple[Array, Any, Array]] = {}

    def slowly(self, what: Hashable, stance: Array, by: float, make: Callable[[], T], index: Array = NOTHING) -> T:
        """Value that changes slowly with the places of the sides. It is kept while these change by at most `by`.

        Parameters
        ----------
        what : hashable
            Which value.
        stance : array
            Places of the sides to each other, see `Gaps.stance`.
        by : float
        make : callable
            Finds the value at the present places.
        index : int array, optional
            Rows that the value is about.
        """
        known = self._slow.get(what)
        if known is None or not largest_change(stance, known[0]) <= by or not np.array_equal(index, known[2]):
            known = self._slow[what] = stance, make(), index
        value: T = known[1]
        return value

    def known(self, what: Hashable) -> tuple[Array, Any, Array] | None:
        """Last value of `slowly`, with the places for which it was found; None if there is none."""
        return self._slow.get(what)

    def on(self, sides: tuple[Side, ...]) -> Self:
        """Return the same rows of sides with other flexibilities."""
        flexible = zip(self.sides, sides, strict=True)
        result = copy.copy(self)
        result.sides = tuple(replace(own, flexibility=side.flexibility) for own, side in flexible)
        result._slow = {}
        return result

    def again(self) -> Self:
        """Return the same rows for another run, with the values that are known so far."""
        result = copy.copy(self)
        result._slow = self._slow.copy()
        return result


class Stage:
    """Rows that move, of which it is not known where they go: the next coordinates give other ones.

    Parameters
    ----------
    rows : PresentRows
    normals : (p, 3) array
        Outward normals of the master at the contact points.
    shares : sequence of (array, array)
        Nodes of the points on each side, and their signed weights in the gap, (p, k) each.
    pairing : Pairing, optional
        The pairs at the start, if these are the rows there.

    Attributes
    ----------
    moving : bool
        Whether the rows follow the motion. If not, their gaps are linear in the coordinates.
    pressed : Pressed or None
        Forces that were found together with the gaps.
    here : (3, 3) array
        Where the slave is seen from the master [m], see `witnesses.seen_from`; zero while that changes nothing.
    pose : (12,) array
        `Gaps.carrier_pose` of the gaps; empty if nothing carries the surface.
    places : list of arrays or None
        Places of the nodes that are followed, (np, 3) for each side [m], where they were found together with the gaps.
    """

    moving = True
    pressed: Pressed | None = None
    here = np.zeros((3, 3))
    pose = NOTHING
    places: list[Array] | None = None

    def __init__(self, rows: PresentRows, normals: Array, shares: Shares, pairing: Pairing | None = None) -> None:
        self.rows, self.normals, self.shares, self.pairing = rows, normals, shares, pairing
        self._made: dict[Hashable, Any] = {}

    @cached_property
    def normal(self) -> Array:
        """(nr, 3) array: mean normal of each row."""
        return self.rows.points.average(self.normals)

    def on(self, sides: tuple[Side, ...]) -> Stage:
        """Return the same stage of sides with other flexibilities."""
        result = copy.copy(self)
        result.rows, result.pairing, result._made = self.rows.on(sides), None, {}
        return result

    def again(self) -> Stage:
        """Return the same stage for another run; one whose rows stay frozen is the same."""
        if not self.moving:
            return self
        result = copy.copy(self)
        result.rows, result._made = self.rows.again(), {}
        return result

    def once(self, what: Hashable, make: Callable[[], T]) -> T:
        """Value that follows from this stage alone; it is found when it is asked for first."""
        if what not in self._made:
            self._made[what] = make()
        value: T = self._made[what]
        return value

    def nodal_forces(self, lam: Array) -> list[Array] | None:
        """See `Gaps.nodal_forces`; None if there is no short way."""
        return None

    def generalised(self, lam: Array) -> Array | None:
        """See `Gaps.generalised`; None if there is no way shorter than that by the nodes."""
        return None

    def advance(self, pair: Pair, q: Array, asked: tuple[Any, ...] | None = None) -> tuple[Stage, Array]:
        """Return the stage at coordinates q, (n,), and the gaps of its rows, (nr,) [m].

        `asked` is what compiled loops need to find forces too, see `Gaps.pressed_at`.
        """
        return pair.search(q)

    def keep_rows(self, pair: Pair, q: Array) -> tuple[Stage, Array] | None:
        """Do as `advance` does, but with the same rows; None if that is not possible."""
        return None

    def with_more_rows(self, pair: Pair, q: Array) -> tuple[Stage, Array]:
        """Return the stage at the same coordinates with all rows that can touch next, and their gaps, (nr,) [m]."""
        return self, NOTHING


class Frozen(Stage):
    """Rows whose pairs stay the same, in frames that do not turn: gaps are linear in the coordinates.

    Parameters
    ----------
    rows, normals, shares, pairing
        See `Stage`.
    linear : LinearGaps
    """

    moving = False

    def __init__(
        self, rows: PresentRows, normals: Array, shares: Shares, linear: LinearGaps, pairing: Pairing | None = None
    ) -> None:
        super().__init__(rows, normals, shares, pairing)
        self.linear = linear

    def gap(self, q: Array) -> Array:
        """Gaps, (nr,) [m], at coordinates q, (n,)."""
        return moved(self.linear.start, self.linear.H, q)

    def generalised(self, lam: Array) -> Array:
        """See `Gaps.generalised`."""
        return weighted_rows(lam, self.linear.H)

    def advance(self, pair: Pair, q: Array, asked: tuple[Any, ...] | None = None) -> tuple[Stage, Array]:
        """See `Stage.advance`; when the pairs have slid, they are followed."""
        linear = self.linear
        if largest_change(linear.drift @ q, linear.drift_start) <= linear.reach:
            return self, self.gap(q)
        return pair.search(q)
