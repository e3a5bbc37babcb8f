"""Gap rows of a patch in motion.

`Gaps.jacobian` is G_C of the paper (eq. 25-27).

Module `contact.patch_gaps` has the gaps to another patch, `contact.rigid` the gaps to rigid surfaces.

Theory: examples/site/theory.md, "Rows of gaps".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ..algebra.sparse.skin_flexibility import Flexibility
from ..errors import InputError
from ..frames.kinematics import Rows
from ..support.arrays import Array
from ..support.attributes import copied
from ..surfaces.points import ContactPoints
from .anchoring import Anchoring
from .carrier import Carrier
from .side import Side
from .sides import Sides
from .stages import NOTHING, Anchor, Present, PresentRows, Stage

if TYPE_CHECKING:
    from typing import Self

_ROUND_OFF = 1e-9  # relative difference of shares of a flexibility that are the same


@dataclass(frozen=True, eq=False)
class GapState:
    """Where the sides of a contact were at the end of a step, and what the gaps of later steps depend on besides.

    Parameters
    ----------
    q : (n,) array
        Coordinates of all sides.
    pose : (12,) array
        `Carrier.pose`; empty if no body carries a rigid surface.
    anchor : Anchor or None
        Where the flexibility of the rows was found; None if it was not yet.
    frozen : (n,) array or None
        Coordinates at which the pairs were found that are frozen; None while pairs are followed.
    chosen : Anchor or None
        Where the rows that can close were chosen, if contact wanders over a patch, or where all points were searched
        last, if pairs are followed.
    parted : Anchor or None
        Where the parts of two patches were found that are near each other, if contact wanders over one.
    stood : (3, 3) array or None
        Place of the slave relative to the master when it was last asked whether the patches slide [m].
    steps : int
        Number of steps since then.
    growing : (6 k,) array
        `Gaps.growing` of the k sides; empty if none grows.
    """

    q: Array
    pose: Array
    anchor: Anchor | None = None
    frozen: Array | None = None
    chosen: Anchor | None = None
    parted: Anchor | None = None
    stood: Array | None = None
    steps: int = 0
    growing: Array = field(default_factory=lambda: NOTHING)


@dataclass(frozen=True, eq=False)
class Placement:
    """How the sides of a contact are placed before a run.

    Parameters
    ----------
    approach : (3,) array
        Unit vector along which the slave approaches its counterpart.
    clearance : float
        Smallest gap of the rows [m].
    faced : bool
        Whether the slave faces its counterpart. If not, the first rows are those of a pose in which it does. They give
        flexibility and stiffness. The first evaluation replaces them.
    pressed : bool
        Whether an overlap is meant. Load steps close it.
    """

    approach: Array
    clearance: float
    faced: bool = True
    pressed: bool = False

    @property
    def overlap(self) -> float:
        """Largest overlap of the rows [m], if it is meant; else zero."""
        return max(-self.clearance, 0.0) if self.pressed else 0.0


class Gaps:
    """Gap rows of a patch in motion: which are present, and where. Subclasses define the counterpart.

    What follows from where the rows are is asked of their `stage`, as forces on the nodes, and of `present`. A run
    changes where the rows are, inputs of the next evaluation, and `accepted`; the sides change where contact wanders.

    Attributes
    ----------
    sides : Sides
    size : float
        Size of the facets, the scale of motion [m].
    all_points : ContactPoints
        Points of all rows of the slave's patch, whether they are present or not.
    placement : Placement
    between : (d np, d np) array, SkinBlock or None
        Residual flexibility between the patches of both sides [m/N], if they are patches of one body.
    carried : bool
        Whether an Exudyn body carries the rigid surface.
    carrier : Carrier
        What carries it.
    anywhere : bool
        Whether the sides may meet anywhere, and be far from each other for long.
    furthest : float
        Distance above which there are no rows [m].
    reach : float
        Gap at which forces begin [m]. Rows with smaller gaps are present.
    anchoring : Anchoring
        Where the flexibility of the rows is found.
    present : Present
        Where the rows are now.
    stage : Stage
        That of `present`: the present rows, and what is derived from them.
    accepted : GapState
        State at the end of the last accepted step. Each try of a step begins from it.
    growing : (6 k,) array
        Products of angular velocities by which each of the k sides grows in the next evaluation [rad2/s2], see `grow`:
        an input, as the pose of the carrier. Empty if none does.
    yielding : tuple of float or None
        Share of each side's flexibility that yields within the present step, see `viscosity`; None if all of it does.
    within : float
        Gap up to which rows are present at least, because forces may push them shut [m]: a guess, see `follow_pushed`.
    searches : int
        Number of searches for the pairs of all points since the start of the run.
    """

    sides: Sides
    size: float
    all_points: ContactPoints
    placement: Placement
    between: Flexibility | None = None
    carried: bool = False
    carrier: Carrier = Carrier()
    anywhere: bool = False
    furthest: float = np.inf
    reach: float = 0.0
    anchoring: Anchoring
    present: Present
    stage: Stage
    accepted: GapState
    growing: Array = NOTHING
    yielding: tuple[float, ...] | None = None
    within: float = 0.0
    searches: int = 0
    _start: Stage
    _start_q: Array

    def placed_rows(self) -> tuple[ContactPoints, Array, Array]:
        """Points of the rows as the sides are placed, normals there, (p, 3), and gaps of the rows, (nr,) [m]."""
        raise NotImplementedError

    def for_run(self) -> Self:
        """Return the same rows in their start state, for another run; constant data are shared."""
        result = copied(self)
        result.searches, result.yielding, result.within = 0, None, 0.0
        result.anchoring = Anchoring(result)
        result.begin()
        return result

    def _begin_at_start(self) -> None:
        """Go back to where the sides are placed."""
        self.growing, self.present = NOTHING, replace(self.present, anchor=None)
        self._go_to_start()
        self.accepted = GapState(self.present.q, self.stage.pose)
        self.accepted = self.after()

    def _go_to_start(self) -> None:
        """Take the rows of the start."""
        raise NotImplementedError

    # State.

    def after(self) -> GapState:
        """State after a step that ends in the last evaluation."""
        present = self.present
        return GapState(present.q, self.stage.pose, present.anchor, self._frozen_at(), growing=present.growing)

    def _frozen_at(self) -> Array | None:
        """Coordinates at which the pairs were found that are frozen; None if pairs are followed."""
        return None if self.moving else self._start_q

    def begin(self, state: GapState | None = None) -> None:
        """Begin a step from a state, by default where the sides are placed.

        A step that is repeated begins from `accepted`. The state may also be that of another run: gaps that have never
        moved then answer as those whose state it is.
        """
        if state is None:
            self._begin_at_start()
            return
        if state != self.accepted:
            self._begin_at_start()
            self._take_rows(state)
            self.growing = state.growing
        self.accept(state)

    def begin_grown(self) -> None:
        """Let the step begin with sides that are grown where they are placed, as `grow` has said."""
        self.return_to(replace(self.present, known=None, growing=self.growing))
        self.accept(replace(self.accepted, anchor=self.present.anchor, growing=self.growing))

    def accept(self, state: GapState) -> None:
        """Let the next step begin from a state: `after`, if the last one has ended here."""
        self.accepted = state
        if self.present.anchor != state.anchor:
            self.return_to(replace(self.present, anchor=state.anchor))

    def accept_anchor(self, anchor: Anchor) -> None:
        """Go on from an anchor that others have found, without a carrier."""
        self.present.anchor = anchor
        self.accepted = replace(self.accepted, anchor=anchor)

    def _take_rows(self, state: GapState) -> None:
        """Take the rows of a state."""

    def at_state(self, state: GapState) -> Array:
        """Go to where a state was reached, and return the gaps of its rows, (nr,) [m]."""
        growing, self.growing = self.growing, state.growing
        gap = self._at_state(state)
        self.growing = growing
        return gap

    def _at_state(self, state: GapState) -> Array:
        """See `at_state`."""
        return self.at(state.q)

    def at(self, q: Array) -> Array:
        """Gaps of the present rows, (nr,) [m], at coordinates q, (n,)."""
        raise NotImplementedError

    def follow_pushed(
        self, lam: Array, gap: Array, least: float, on_nodes: Callable[[], Sequence[Array]], *, shared: bool
    ) -> bool:
        """Follow all rows that forces may push shut, from the next evaluation on.

        Parameters
        ----------
        lam, gap : (nr,) arrays
            Normal forces on the present rows [N], and gaps without what others push [m].
        least : float
            Smallest gap [m].
        on_nodes : callable
            Finds these forces on the nodes of each side, (np, 3) [N].
        shared : bool
            Whether other contacts push the rows too.

        Returns
        -------
        bool
            Whether some rows that may close were not present.
        """
        return False

    def surface_gap(self, q: Array, dents: Sequence[Array] | None = None) -> float:
        """Gap of the slave's lowest point, among its nodes and contact points, at coordinates q, (n,) [m].

        It does not include the contact's own flexibility and does not depend on the present rows. It is
        negative where the surfaces overlap in the motion that the coordinates describe. It is infinite if no
        point faces the master. `dents` are those of each side, see `Side.dent`.
        """
        raise NotImplementedError

    def least_distance(self, q: Array) -> float:
        """Lower bound of all gaps at coordinates q, (n,) [m], if it is above zero; otherwise the sides may touch.

        Rows stay as they are. It is minus infinity if nothing is known.
        """
        return -np.inf

    def of_present(self, q: Array) -> Array:
        """Gaps of the present rows at coordinates q, (n,); unlike `at`, this keeps the rows: (nr,) [m]."""
        return self.at(q)

    def _go_to_stage(self, stage: Stage, q: Array) -> None:
        """Go to a stage at coordinates q, (n,)."""
        self.return_to(Present(stage, q, stage.places, self.present.anchor, self.growing))

    def return_to(self, present: Present) -> None:
        """Go to where the rows were."""
        self.present, self.stage = present, present.stage

    def _put_stage(self, stage: Stage) -> None:
        """Go to another stage at the same coordinates."""
        self.return_to(replace(self.present, stage=stage))

    @property
    def moving(self) -> bool:
        """Whether rows follow the motion. If not, their gaps are linear in the coordinates."""
        return self.stage.moving

    @property
    def beside(self) -> bool:
        """Whether the sides are nearest beside their faces now, so that the gap is no distance."""
        return False

    @property
    def has_past(self) -> bool:
        """Whether the rows depend on earlier evaluations while the sides are apart: then these may not be left out."""
        return False

    @property
    def may_freeze(self) -> bool:
        """Whether rows are frozen as long as their pairs do not slide: they depend linearly on the coordinates then."""
        return not self._start.moving

    @property
    def row_nodes(self) -> Array:
        """(nr,) int array: node of the slave's patch for each present row."""
        return self.stage.rows.row_nodes

    @property
    def area(self) -> Array:
        """(nr,) array: area that each present row stands for [m2]."""
        return self.stage.rows.area

    @property
    def centre(self) -> Array:
        """(3,) array: point of space near the contact, from which the sides' places count [m].

        So their rounding errors are not those of places far from the origin. A stiff patch turns these into forces.
        """
        return self.sides[0].centre

    @property
    def n(self) -> int:
        """Number of coordinates of all sides."""
        return self.sides.n

    @property
    def slave(self) -> Side:
        """The side whose points must not penetrate."""
        return self.sides[0]

    def exchange_flexibility(self, flexibility: Sequence[Flexibility | None]) -> None:
        """Give the sides' patches other residual flexibilities, (d np, d np) each [m/N]."""
        self.sides = Sides(replace(side, flexibility=F) for side, F in zip(self.sides, flexibility, strict=True))
        self._start = self._start.on(self.sides)
        self._put_stage(self.stage.on(self.sides))

    @property
    def longest_reach(self) -> float:
        """Largest `reach` [m]. Here all rows are present."""
        return np.inf

    def reach_to(self, reach: float) -> None:
        """Let forces begin at gaps of `reach` [m]; see the attribute.

        Raises
        ------
        InputError
            If rows are not followed as far.
        """
        if not 0.0 <= reach <= self.longest_reach:
            raise InputError(
                f"law: expected a reach from 0 to {self.longest_reach:.3g} m, up to which rows follow patches that "
                f"slide, with facets of {self.size:.3g} m; got {reach:.4g} m. Take a shorter reach, or coarser facets"
            )
        self.reach = reach

    def yield_by(self, shares: tuple[float, ...]) -> None:
        """Let only these shares of the sides' flexibilities yield, see `viscosity.shares`.

        Times of steps are rounded. Shares that differ by no more are the same, so that the flexibility is kept.
        """
        if self.yielding is None or not np.allclose(shares, self.yielding, rtol=_ROUND_OFF, atol=0.0):
            self.yielding = shares
            self._put_stage(self.stage.yielding())

    @property
    def yielding_shares(self) -> tuple[float, ...]:
        """`yielding`, for each side."""
        return self.yielding or (1.0,) * len(self.sides)

    def grow(self, growing: Sequence[Array]) -> None:
        """Let each side grow by products of angular velocities, (6,) or empty, see `Kinematics.growing`.

        Centrifugal forces deform a body beyond its coordinates, in a quasi-static way. Contact sees this growth, from
        the next evaluation on.
        """
        if len(growing) == 1:
            self.growing = growing[0]
        elif any([len(products) for products in growing]):
            self.growing = np.concatenate([products if len(products) else np.zeros(6) for products in growing])
        else:
            self.growing = NOTHING

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """Gaps of all rows that can touch next, (k,) [m], their rates [m/s] and accelerations [m/s2], for fixed pairs.

        Parameters
        ----------
        q, q_t, q_tt : (n,) arrays
            Coordinates, their velocities and accelerations.
        """
        gap = self.at(q)
        H = self.jacobian(np.arange(len(gap)))
        rate = H @ q_t
        if self.carried:  # the accelerations of the surface's carrier are not known here
            rate = rate + self.carrier.rows(self.stage, self.present.places[0]) @ self.carrier.motion
        return gap, rate, H @ q_tt

    def widen(self, q: Array) -> Array:
        """Take all rows that can touch next at coordinates q, (n,), and return their gaps, (k,) [m]."""
        return self.at(q)

    def jacobian(self, index: Array) -> Rows:
        """Derivative of the gaps of some present rows with respect to the coordinates, (na, n), for fixed pairs."""
        return self.stage.jacobian(index, self.present.q)

    # Flexibility, see `anchoring`.

    def stance(self) -> Array:
        """Values on which the flexibility of the rows depends: places divided by a facet's size, or directions."""
        raise NotImplementedError

    def stance_at(self, anchor: Anchor) -> Array:
        """`stance` of the present rows at an anchor."""
        return self.anchoring.found_at(anchor, self.stance)

    def stage_at(self, anchor: Anchor, rows: PresentRows) -> Stage:
        """Stage of some rows with their pairs and normals at an anchor."""
        raise NotImplementedError
