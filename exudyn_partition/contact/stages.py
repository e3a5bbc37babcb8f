"""Stages of a contact: the rows that are present, and data derived from them.

A stage is immutable. `advance` returns the stage at other coordinates. While rows stay frozen, it is the same stage.
Data derived from a stage are kept on it, and vanish with it. So no code needs to check whether they are still valid.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar

import numpy as np

from ..algebra.products import joined, largest_change, moved, weighted_rows
from ..frames.kinematics import Rows
from ..frames.rotations import total_moment
from ..support.arrays import Array
from ..support.attributes import FoundOnce, copied
from ..surfaces.loops import at_points, on_nodes
from ..surfaces.points import ContactPoints
from ..surfaces.projection import Projection
from ..surfaces.rows import directed_matrix
from . import loops
from .linear_gaps import LinearGaps
from .sides import Sides

if TYPE_CHECKING:
    from typing import Self

    from .kernels import FlatPoints

T = TypeVar("T")
Shares = Sequence[tuple[Array, Array]]  # for each side: nodes of the points, and their signed weights in the gap
NOTHING = np.empty(0)
Shared = dict[Hashable, Any] | None
FEW = 64  # rows whose derivatives one call finds, row by row; those of more come from sparse matrices
OF_SIDE = "of one side"  # in the names of values that do not depend on what share of flexibilities yields


class Pair(Protocol):
    """The part of `patch_gaps.PatchGaps` that stages need: two patches that may touch.

    Attributes
    ----------
    sides : Sides
    size : float
        Size of the master's facets [m].
    witnesses : list of (3,) int arrays
        Nodes that give the pose of each side.
    within : float
        Gap up to which rows are present at least, because forces may push them shut [m].
    growing : (6 k,) array
        See `Gaps`.
    """

    sides: Sides
    size: float
    reach: float
    within: float
    furthest: float
    witnesses: list[Array]
    growing: Array

    def sides_with(self, points: ContactPoints, facets: Array) -> Sides:
        """The sides with the nodes of these points, and the master's nodes around facets, (p,) int array."""

    def met(self, places: Sequence[Array], points: ContactPoints) -> tuple[Projection, Array, Array, Array]:
        """Project some points of the slave on all facets, see `pairs.Meeting`, with nodes at places of both sides."""

    def met_at(self, q: Array, points: ContactPoints) -> tuple[Projection, Array, Array, Array]:
        """Do the same at coordinates q, (n,)."""

    def search(self, q: Array, within: float | None = None) -> tuple[Stage, Array]:
        """Find the pairs of all points at coordinates q, (n,); return the stage of rows that can close, and gaps.

        There are none if the patches are further apart than `within` [m], by default as far as rows are followed.
        """


@dataclass(frozen=True, eq=False)
class Anchor:
    """Pose at which a contact found the flexibility of its rows. Its flexibility follows from it, whatever came before.

    Parameters
    ----------
    q : (n,) array
        Coordinates of all sides.
    pose : (12,) array
        `Carrier.pose`; empty if no body carries a rigid surface.
    growing : (6 k,) array
        `Gaps.growing` of the k sides; empty if none grows.
    """

    q: Array
    pose: Array
    growing: Array

    def equals(self, anchor: Anchor) -> bool:
        """Whether the other anchor has the same place."""
        return self == anchor or bool(
            (self.q == anchor.q).all()  # array_equal takes longer
            and np.array_equal(self.pose, anchor.pose)
            and np.array_equal(self.growing, anchor.growing)
        )


class PresentRows:
    """Rows that stay present while the sides move.

    Parameters
    ----------
    points : ContactPoints
        Points of the rows.
    leaves_at : (nr,) array
        Depth at which contact of each row leaves the patch [m], see `surfaces.rows.ContactRows`.
    sides : Sides
        The sides, perhaps only with the nodes that these rows need.
    unpaired : int
        Number of the slave's points that faced nothing when the rows were found.

    Attributes
    ----------
    made_at : Anchor or None
        Where rows were made that have the flexibility of that place alone; None for others.
    """

    made_at: Anchor | None = None

    def __init__(self, points: ContactPoints, leaves_at: Array, sides: Sides, unpaired: int = 0) -> None:
        self.points, self.row_nodes, self.area = points, points.row_nodes, points.area
        self.leaves_at, self.sides, self.unpaired = leaves_at, sides, unpaired
        self._at_anchors: dict[Hashable, tuple[Anchor, Any, Array]] = {}

    @FoundOnce
    def at_edge(self) -> bool:
        """Whether contact leaves the patch at some of the rows."""
        return bool(np.isfinite(self.leaves_at).any())

    @FoundOnce
    def flat(self) -> FlatPoints:
        """Points of the rows, as compiled loops take them."""
        return loops.flat_points(self.points)

    def at_anchor(self, what: Hashable, anchor: Anchor, make: Callable[[], T], index: Array = NOTHING) -> T:
        """Value of these rows at an anchor; the last one is kept, and may be lost without changing an answer.

        Parameters
        ----------
        what : hashable
            Name of the value.
        anchor : Anchor
        make : callable
            Finds the value at the anchor.
        index : int array, optional
            Rows to which the value belongs.
        """
        kept = self._at_anchors.get(what)
        same_rows = kept is not None and len(index) == len(kept[2]) and (not len(index) or (index == kept[2]).all())
        if kept is None or not same_rows or not kept[0].equals(anchor):
            kept = self._at_anchors[what] = anchor, make(), index
        elif kept[0] != anchor:
            kept = self._at_anchors[what] = anchor, kept[1], index
        value: T = kept[1]
        return value

    def on(self, sides: Sides) -> Self:
        """Return the same rows for sides with other flexibilities."""
        flexible = zip(self.sides, sides, strict=True)
        result = copied(self)
        result.sides = Sides(replace(before, flexibility=side.flexibility) for before, side in flexible)
        result._at_anchors = {}
        return result

    def yielding(self) -> Self:
        """Return the same rows when other shares of flexibilities yield; what belongs to a side stays."""
        result = copied(self)
        result._at_anchors = {
            what: kept for what, kept in self._at_anchors.items() if isinstance(what, tuple) and OF_SIDE in what
        }
        return result

    def for_run(self) -> Self:
        """Return the same rows for another run, with the values known so far."""
        result = copied(self)
        result._at_anchors = self._at_anchors.copy()
        return result


class Standing(NamedTuple):
    """Which rows of a contact are present, and where their flexibility was found. It is kept while this stays equal.

    Parameters
    ----------
    rows : PresentRows
        Another object if other rows are present, or a side has another flexibility.
    anchor : Anchor
    axis : int
        Number of the axis that the tangents follow.
    """

    rows: PresentRows
    anchor: Anchor
    axis: int = 0


class Stage:
    """Rows whose motion is not known: other coordinates give another stage.

    Parameters
    ----------
    rows : PresentRows
    normals : (p, 3) array
        Outward normals of the master at the contact points.
    shares : sequence of (array, array)
        Nodes of the points on each side, and their signed weights in the gap, (p, k) each.
    shared : dict, optional
        Values that contacts with the same pairs at the start share, see `by_pairs`.

    Attributes
    ----------
    moving : bool
        Whether the rows follow the motion. If not, their gaps are linear in the coordinates.
    here : (3, 3) array
        Place of the slave relative to the master [m], see `witnesses.seen_from`; zero if nothing depends on it.
    pose : (12,) array
        `Carrier.pose` when the gaps were found; empty if no body carries the surface.
    places : list of arrays or None
        Places of the followed nodes, (np, 3) for each side [m], if they were found together with the gaps.
    of_anchor : bool
        Whether the stage is that of an anchor, at which only flexibilities are found.
    linear : LinearGaps or None
        Gaps of the rows as linear functions while they are frozen; None if they move.
    """

    moving = True
    linear: LinearGaps | None = None
    of_anchor = False
    here = np.zeros((3, 3))
    pose = NOTHING
    places: list[Array] | None = None

    def __init__(self, rows: PresentRows, normals: Array, shares: Shares, shared: Shared = None) -> None:
        self.rows, self.normals, self.shares, self.shared = rows, normals, shares, shared
        self._values: dict[Hashable, Any] = {}

    @FoundOnce
    def normal(self) -> Array:
        """(nr, 3) array: mean normal of each row."""
        return self.rows.points.average(self.normals)

    def resultant(self, lam: Array) -> Array:
        """Sum of forces on the slave, (3,) [N], from forces on the rows along their normals, (nr,) [N]."""
        if self.moving and loops.at_once():
            return loops.resultant(self.rows.flat, lam, self.normals)
        along: Array = lam @ self.normal
        return along

    def on(self, sides: Sides) -> Stage:
        """Return the same stage for sides with other flexibilities."""
        result = copied(self)
        result.rows, result.shared, result._values = self.rows.on(sides), None, {}
        return result

    def yielding(self) -> Stage:
        """Return the same stage when other shares of the sides' flexibilities yield."""
        result = copied(self)
        result.rows, result.shared, result._values = self.rows.yielding(), None, {}
        return result

    def for_run(self) -> Stage:
        """Return the same stage for another run; a stage with frozen rows returns itself."""
        if not self.moving:
            return self
        result = copied(self)
        result.rows, result._values = self.rows.for_run(), {}
        return result

    def once(self, what: Hashable, make: Callable[[], T]) -> T:
        """Value that follows from this stage alone; it is computed when it is needed first."""
        if what not in self._values:
            self._values[what] = make()
        value: T = self._values[what]
        return value

    def by_pairs(self, what: Hashable, make: Callable[[], T]) -> T:
        """Value that follows from the pairs alone, wherever the bodies are; it is kept unless the pairs move."""
        if self.shared is None:
            return make() if self.moving else self.once(what, make)
        if what not in self.shared:
            self.shared[what] = make()
        value: T = self.shared[what]
        return value

    # Forces, and rows on the coordinates. The pairs are fixed.

    def pushes(self, lam: Array) -> Array:
        """Forces on the slave at the points, (p, 3) [N], from forces on the rows along their normals, (nr,) [N]."""
        return loops.pushes(self.rows.points, lam, self.normals)

    def on_nodes(self, forces: Array) -> list[Array]:
        """Forces on the nodes of the patches, (np, 3) for each side [N].

        Parameters
        ----------
        forces : (p, 3) array
            Forces on the slave at the points, in axes of space [N].
        """
        sides = zip(self.shares, self.rows.sides, strict=True)
        return [on_nodes(*shares, forces, len(side.surface.points)) for shares, side in sides]

    def nodal_forces(self, lam: Array) -> list[Array]:
        """Forces on the nodes of the patches, (np, 3) for each side [N], from forces on the rows, (nr,) [N]."""
        return self.on_nodes(self.pushes(lam))

    def acted(self, lam: Array, q: Array) -> tuple[Array, Array]:
        """Generalised forces, (n,), and force on the slave, (3,) [N], from forces on the rows, (nr,) [N].

        The coordinates of both sides are q, (n,).
        """
        sides = self.rows.sides
        parts = zip(sides, sides.split(q), self.nodal_forces(lam), strict=True)
        return np.concatenate([side.generalised(part, forces) for side, part, forces in parts]), self.resultant(lam)

    def moment(self, lam: Array, about: Array, places: Array) -> Array:
        """Moment on the slave, (3,) [N m], from forces on the rows, (nr,) [N], see `moment_of`."""
        return self.moment_of(self.pushes(lam), about, places)

    def moment_of(self, forces: Array, about: Array, places: Array) -> Array:
        """Moment on the slave about a point, (3,) [N m].

        Parameters
        ----------
        forces : (p, 3) array
            Forces on the slave at the points [N].
        about : (3,) array
        places : (np, 3) array
            The point, and places of the slave's nodes; both count from the centre of the sides [m].
        """
        return total_moment(at_points(*self.shares[0], places) - about, forces)

    def jacobian(self, index: Array, q: Array) -> Rows:
        """Derivative of the gaps of some rows with respect to the coordinates, (na, n), at q, (n,)."""
        return self.on_coordinates(q, index)

    def on_coordinates(self, q: Array, index: Array | None = None) -> Rows:
        """Derivative of the gaps of some rows, by default of all, see `jacobian`; by sparse matrices."""
        mean, sides, parts = self.rows.points.mean, self.rows.sides, []
        mean = mean if index is None else mean[index]
        for (nodes, weights), side, side_q in zip(self.shares, sides, sides.split(q), strict=True):
            G = directed_matrix(nodes, weights, self.normals, len(side.surface.points))
            parts.append(side.on_coordinates(side_q, mean @ G))
        return joined(parts)

    # Motion.

    def advance(self, pair: Pair, q: Array) -> tuple[Stage, Array]:
        """Return the stage at coordinates q, (n,), and the gaps of its rows, (nr,) [m]."""
        return pair.search(q)

    def keep_rows(self, pair: Pair, q: Array) -> tuple[Stage, Array] | None:
        """Advance with the same rows; None if that is not possible."""
        return None

    def with_more_rows(self, pair: Pair, q: Array) -> tuple[Stage, Array]:
        """Return the stage at the same coordinates with all rows that can touch next, and their gaps, (nr,) [m]."""
        return self, NOTHING


class Frozen(Stage):
    """Rows with fixed pairs, in frames that do not turn, so that gaps are linear in the coordinates.

    Parameters
    ----------
    rows, normals, shares, shared
        See `Stage`.
    linear : LinearGaps
    """

    moving = False
    linear: LinearGaps

    def __init__(
        self, rows: PresentRows, normals: Array, shares: Shares, linear: LinearGaps, shared: Shared = None
    ) -> None:
        super().__init__(rows, normals, shares, shared)
        self.linear = linear

    def jacobian(self, index: Array, q: Array) -> Rows:
        """See `Stage.jacobian`."""
        return self.linear.H[index]

    def gap(self, q: Array) -> Array:
        """Gaps, (nr,) [m], at coordinates q, (n,)."""
        return moved(self.linear.start, self.linear.H, q)

    def acted(self, lam: Array, q: Array) -> tuple[Array, Array]:
        """See `Stage.acted`."""
        return weighted_rows(lam, self.linear.H), self.resultant(lam)

    def advance(self, pair: Pair, q: Array) -> tuple[Stage, Array]:
        """See `Stage.advance`; when the pairs have slid, they are followed."""
        linear = self.linear
        if largest_change(linear.drift @ q, linear.drift_start) <= linear.reach:
            return self, self.gap(q)
        return pair.search(q)


@dataclass(slots=True, eq=False)
class Present:
    """Where the rows of a contact are.

    Parameters
    ----------
    stage : Stage
    q : (n,) array
        Coordinates of all sides.
    known : list of (np, 3) arrays or None
        `places`; None until somebody asks.
    anchor : Anchor or None
        Where the flexibility was found that the rows have here; None until somebody asks.
    growing : (6 k,) array
        `Gaps.growing` of the k sides here; empty if none grows.
    """

    stage: Stage
    q: Array
    known: list[Array] | None
    anchor: Anchor | None
    growing: Array

    @property
    def places(self) -> list[Array]:
        """Places of the nodes that the rows need, (np, 3) for each side [m], from the centre; others are NaN."""
        if self.known is None:
            self.known = self.stage.rows.sides.places(self.q, self.growing)
        return self.known

    @property
    def coordinates(self) -> list[Array]:
        """Coordinates of each side, (n_dofs,)."""
        return self.stage.rows.sides.split(self.q)
