"""The plastic zone of a patch in a step: how it moves the patch and the body, as functions of the state before.

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...algebra.sparse.flexibility import KeptFlexibility
from ...plasticity import loops
from ...plasticity.flow import PlasticState
from ...support.arrays import Array
from ...support.attributes import copied
from .active_points import ActivePoints, OrderedRows
from .zone_motion import ZoneMotion
from .zone_state import Applied, Change, ZoneState

if TYPE_CHECKING:
    from typing import Self

_NEAR = 0.2  # of the yield stress: points that are nearer to flow are active together with those that flow
_FEW = 16  # besides the points that flow, at most as many plus 2 * _FEW are active
# Nodes of a zone up to which products are dense, and 3 to 4 times as quick. To make the rows of so many nodes takes a
# second, and grows with more than the square of their number; time of products by fronts grows little faster than it.
_MOST_DENSE = 1500
_SPARE = 4  # points are chosen again if so many times the flowing points and _FEW are active


class ZoneGuess(NamedTuple):
    """Where the iteration of a step begins: points that may flow, (g,) bool, and what the step changes."""

    active: Array
    change: Change


class Push(NamedTuple):
    """A change of the pseudo-forces on m active nodes and what it does, all linear in it.

    Parameters
    ----------
    change : (m,) array
        [N]
    moved, moved_patch : (m,), (r,) arrays
        Displacements of these nodes and of the patch's rows [m].
    first : float
        Share of the first guess, which moves all nodes as known.
    answered : array
        What `ActivePoints.spread` needs for the rest; a zero if there is none.
    """

    change: Array
    moved: Array
    moved_patch: Array
    first: float
    answered: Array


def combined(pushes: Sequence[Push], shares: Array) -> Push:
    """Combination of some pushes, by their shares, (k,): it needs no product."""
    return Push(*(sum(map(operator.mul, values, shares)) for values in zip(*pushes, strict=True)))


class Flowed(NamedTuple):
    """Radial return at the active points.

    Parameters
    ----------
    push : Push
        What has moved the nodes, besides the forces on the patch.
    force : (r,) array
        Forces on the rows of the patch [N].
    plastic : PlasticState
        Of the active points.
    strain : (k, 6) array
    led_to : (m,) array
        Change of the pseudo-forces on the active nodes in this step, by this flow [N].
    asks_for : (m,) array
        The same with what the step before has left to apply [N].
    """

    push: Push
    force: Array
    plastic: PlasticState
    strain: Array
    led_to: Array
    asks_for: Array


class _ElasticRange(NamedTuple):
    """Least distance of a state from flow [Pa], at coordinates, (n,), and patch forces, (r,) [N]."""

    applied: Applied
    distance: float
    q: Array
    force: Array


class YieldingZone:
    """A plastic zone that forces on its patch and motion of its body make flow. It has no mass of its own.

    A step finds only the change of the pseudo-forces, on the nodes of points that may flow in it. The pseudo-forces of
    earlier steps move the zone by a constant. The last guess of a step is what has moved the zone; what it lacks of the
    forces that it led to is left for the next step.

    A zone has no state. What it keeps to save time may be lost at any moment.

    Parameters
    ----------
    motion : ZoneMotion
    kind : type
        Type of the numbers in large products.

    Attributes
    ----------
    start : ZoneState
        At the start of each run.
    """

    def __init__(self, motion: ZoneMotion, kind: type = float) -> None:
        assert motion.flexibility is not None
        self.motion, self.flexibility = motion, motion.flexibility
        # Von Mises stress is a norm. These bound its growth for a unit change of each coordinate and patch force.
        self._by_q, self._by_force = map(self._largest, (motion.kinematics.rows, self.flexibility.of_patch))
        self.start = self._start()
        self._use(kind)

    def in_precision(self, kind: type) -> Self:
        """Return the same zone with numbers of this type in large products. It has kept nothing yet."""
        result = copied(self)
        result._use(kind)
        return result

    def _use(self, kind: type) -> None:
        """Have the flexibility in single or double precision, and drop what was found with the other."""
        given, single = self.flexibility, np.dtype(kind) == np.float32
        self._zone_flexibility: OrderedRows | KeptFlexibility
        if len(self.motion.zone.nodes) <= _MOST_DENSE:
            self._zone_flexibility = OrderedRows(given, kind)
        else:
            self._zone_flexibility = given.single_own if single else given.own
        self._of_patch: Array = given.single_of_patch if single else np.ascontiguousarray(given.of_patch.T)
        self._active: ActivePoints | None = None
        self._range: _ElasticRange | None = None

    def _largest(self, columns: Array) -> Array:
        """Largest von Mises stress anywhere for each column of nodal displacements, (m,) [Pa]."""
        zone = self.motion.zone
        virgin = PlasticState.virgin(len(zone))
        beyond = [zone.excess(column, virgin).max() for column in columns.T]
        return np.array(beyond) + zone.flow.yield_stress

    def _start(self) -> ZoneState:
        zone, plastic, rows = self.motion.zone, self.motion.start, self.motion.kinematics.rows
        p = zone.pseudo_forces(plastic.strain)
        moved = self.flexibility.own @ p if p.any() else np.zeros(len(p))
        left, generalised = np.zeros(len(p)), np.asarray(rows.T @ p)
        applied = self.with_energy(Applied(p, left, moved, p @ self.flexibility.of_patch, generalised, 0.0), plastic)
        at_rest = np.zeros(len(self._by_q)), np.zeros(len(self._by_force))
        return ZoneState(plastic, applied, applied.beyond(applied), *at_rest, 0.0, np.zeros(len(zone), dtype=bool))

    def with_energy(self, applied: Applied, plastic: PlasticState) -> Applied:
        """Return what is applied with its energy, in a plastic state."""
        energy = self.motion.zone.own_energy(plastic)
        return replace(applied, energy=energy - float((0.5 * applied.p + applied.left) @ applied.moved))

    def active(self, chosen: Array) -> ActivePoints:
        """Active points, of which the last ones are kept; `chosen` is (g,) bool."""
        if self._active is None or not self._active.are_chosen(chosen):
            self._active = ActivePoints(self.motion, chosen, self._zone_flexibility, self._of_patch)
        return self._active

    def step(self, state: ZoneState, q: Array, guess: ZoneGuess | None = None) -> ZoneStep:
        """Step that begins in this state and ends at coordinates q, (n,), of the body.

        By default the guess is that of the state.
        """
        guess = ZoneGuess(state.active, state.change) if guess is None else guess
        return ZoneStep(self, state, q[len(q) - len(self._by_q) :].copy(), guess)

    def stays_elastic(self, state: ZoneState, q: Array, force: Array) -> bool:
        """Whether a bound shows that no point yields from this state on, at coordinates and forces on the patch.

        True is certain. False means that strains must be computed, see `excess`.
        """
        elastic_range = self._range
        if elastic_range is None or elastic_range.applied is not state.applied:
            return False
        change = abs(q - elastic_range.q) @ self._by_q + abs(force - elastic_range.force) @ self._by_force
        return bool(elastic_range.distance >= change)

    def excess(self, plastic: PlasticState, q: Array, force: Array, by_flow: Array) -> Array:
        """Von Mises stress beyond the flow stress, (g,) [Pa], where pseudo-forces have moved the nodes, (3 nz,) [m]."""
        moved = self.motion.kinematics.rows @ q + loops.combined(self._of_patch, force) + by_flow
        return self.motion.zone.excess(moved, plastic)

    def flows(self, state: ZoneState, q: Array, force: Array) -> Array | None:
        """Stress beyond the flow stress, (g,) [Pa], with the plastic strain of a state; None if nothing flows."""
        if self.stays_elastic(state, q, force):
            return None
        excess = self.excess(state.plastic, q, force, state.applied.moved)
        if excess.max() > 0:
            return excess
        self._range = _ElasticRange(state.applied, -float(excess.max()), q, force)
        return None

    def near(self, excess: Array, flow: int) -> Array:
        """Points that flow or are nearest to flow, (g,) bool, given their stress beyond the flow stress, (g,) [Pa]."""
        most = min(2 * (flow + _FEW), len(excess))
        least = max(np.partition(excess, -most)[-most], -_NEAR * self.motion.zone.flow.yield_stress)
        near: Array = excess >= min(least, 0.0)
        return near


@dataclass(frozen=True, eq=False)
class ZoneStep:
    """A step of a plastic zone, from a state to coordinates of the body.

    Parameters
    ----------
    zone : YieldingZone
    state : ZoneState
        At the begin of the step.
    q : (n,) array
        Last coordinates of the body at its end.
    guess : ZoneGuess
    """

    zone: YieldingZone
    state: ZoneState
    q: Array
    guess: ZoneGuess

    @property
    def _active(self) -> ActivePoints:
        return self.zone.active(self.guess.active)

    def elastic(self, force: Array) -> ZoneState:
        """State after the step if no point flows, with forces on the patch, (r,) [N]."""
        state, (chosen, change) = self.state, self.guess
        goes_on = state.goes_on and not change.change.any()
        return ZoneState(state.plastic, state.applied, change.none(), self.q, force, state.work, chosen, goes_on)

    def begins_to_flow(self, force: Array) -> ZoneStep | None:
        """Return the step with the points active that flow with forces on the patch, (r,) [N]; None if none do."""
        excess = self.zone.flows(self.state, self.q, force)
        if excess is None:
            return None
        flow, chosen = int(np.count_nonzero(excess > 0)), self.guess.active
        if not (excess[~chosen] > 0).any() and np.count_nonzero(chosen) <= _SPARE * (flow + _FEW):
            return self
        return replace(self, guess=ZoneGuess(self.zone.near(excess, flow), self.guess.change))

    @property
    def first(self) -> Array:
        """First guess of the change of the pseudo-forces on the active nodes, (m,) [N]."""
        first: Array = self.guess.change.change[self._active.dofs]
        return first

    def push(self, change: Array | None = None) -> Push:
        """What a change of the pseudo-forces on the active nodes, (m,) [N], does.

        By default it is `first`, whose displacements are known.
        """
        active, guessed = self._active, self.guess.change
        if change is None:
            change = self.first
            if np.count_nonzero(guessed.change) == np.count_nonzero(change):  # all are active
                return Push(change, guessed.moved[active.dofs], guessed.moved_patch, 1.0, np.zeros(1))
        moved, answered = active.answer(change)
        return Push(change, moved, active.at_patch(change), 0.0, answered)

    def moved_patch(self, push: Push) -> Array:
        """Displacements of the patch's rows by all pseudo-forces, (r,) [m]."""
        value: Array = self.state.applied.moved_patch + push.moved_patch
        return value

    def size(self, change: Array) -> float:
        """Norm of the pseudo-forces [N] after a change on the active nodes, (m,) [N]."""
        p = self.state.applied.p.copy()
        p[self._active.dofs] += change
        return float(np.linalg.norm(p))

    def flow(self, push: Push, force: Array) -> Flowed:
        """Flow that follows from a push and forces on the patch, (r,) [N]."""
        active, (moved, before) = self._active, self._beginning
        plastic, strain, led_to = active.part.answer(moved + active.by_patch(force) + push.moved, before)
        return Flowed(push, force, plastic, strain, led_to, led_to + self.state.applied.left[active.dofs])

    @cached_property
    def _beginning(self) -> tuple[Array, PlasticState]:
        """Displacements of active nodes without patch forces and flow in this step, (m,) [m], and state before it."""
        active = self._active
        return active.moved(self.q, self.state.applied.moved), self.state.plastic.at(active.points)

    def after(self, flowed: Flowed) -> ZoneState | ZoneStep:
        """State after the step; if other points flow than this step assumes, the step to be done again in its place.

        That one is the same step, with these points active, and a guess of its answer.
        """
        zone, active, state, last = self.zone, self._active, self.state, self.state.applied
        push, force, at_points, strain, led_to, _ = flowed
        plastic = state.plastic.changed(active.points, at_points)
        p, left = last.p.copy(), last.left.copy()
        p[active.dofs] += push.change
        left[active.dofs] += led_to - push.change
        moved = last.moved + push.first * self.guess.change.moved
        if push.answered.any():
            moved += active.spread(push.answered)
        applied = Applied(p, left, moved, self.moved_patch(push), last.generalised + active.generalised(led_to), 0.0)
        change, excess = applied.beyond(last), zone.excess(plastic, self.q, force, moved)
        more = self._grown(excess)
        if more is not None:
            return replace(self, guess=ZoneGuess(more, change))
        before = self._beginning[1]
        flow = int(np.count_nonzero(at_points.equivalent > before.equivalent))
        goes_on = flow > 0 and len(active.points) <= _SPARE * (flow + _FEW)
        work = state.work + active.part.work((before, active.strain(state)), (at_points, strain))
        if state.excess is not None and goes_on:  # points that will flow if stress grows as it has
            more = self._grown(2 * excess - state.excess)
        now = zone.with_energy(applied, plastic), change, self.q, force, work
        if more is None:
            return ZoneState(plastic, *now, self.guess.active, goes_on, strain, excess)
        return ZoneState(plastic, *now, more, goes_on, excess=excess)

    def _grown(self, excess: Array) -> Array | None:
        """The active points, (g,) bool, and others that flow, and those near them; None if there are no others."""
        chosen = self.guess.active
        excess = np.where(chosen, -np.inf, excess)
        if excess.max() <= 0:
            return None
        flow = int(np.count_nonzero(excess > 0)) + int(np.count_nonzero(chosen)) // 2
        return np.asarray(chosen | self.zone.near(excess, flow))
