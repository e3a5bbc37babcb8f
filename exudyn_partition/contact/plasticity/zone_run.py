"""The plastic zone of a patch in a run: its present state, and how it moves the patch and the body.

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

import copy
import operator
from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...algebra.krylov import mass_normalised
from ...algebra.secants import DEPTH
from ...algebra.sparse.flexibility import FreeBodyFlexibility, KeptFlexibility
from ...fe.model import node_dofs
from ...frames.kinematics import Kinematics
from ...plasticity import loops
from ...plasticity.flow import PlasticState
from ...plasticity.zone import PlasticZone
from ...plasticity.zone_flexibility import ZoneFlexibility
from ...reduction.body import ReducedBody
from ...support.arrays import Array
from .zone_state import Applied, Change, ZoneState

if TYPE_CHECKING:
    from typing import Self

_NEAR = 0.2  # of the yield stress: points that are nearer to flow are active together with those that flow
_FEW = 16  # besides the points that flow, at most as many plus 2 * _FEW are active
# Nodes of a zone up to which products are dense, and 3 to 4 times as quick. To make the rows of so many nodes takes a
# second, and grows with more than the square of their number; time of products by fronts grows little faster than it.
_MOST_DENSE = 1500
_SPARE = 4  # points are chosen again if so many times the flowing points and _FEW are active


@dataclass(frozen=True, eq=False)
class ZoneMotion:
    """A plastic zone in motion.

    Parameters
    ----------
    zone : PlasticZone
    flexibility : ZoneFlexibility or None
        Residual flexibility; None if the zone's nodes are coordinates of the body (basis "free").
    kinematics : Kinematics
        Kinematics of the zone's nodes.
    start : PlasticState
        State at the start of each run.
    """

    zone: PlasticZone
    flexibility: ZoneFlexibility | None
    kinematics: Kinematics
    start: PlasticState

    @classmethod
    def of(cls, kinematics: Kinematics, patch: int, state: PlasticState | None = None) -> ZoneMotion | None:
        """Zone of a patch of the body with these kinematics; None if nothing yields there."""
        body: ReducedBody = kinematics.body
        plastic = [number for number, one in enumerate(body.partition.patches) if one.plastic is not None]
        one = body.partition.patches[patch]
        region, material = one.plastic, one.material or body.material
        nodal = region is not None and np.isin(region.nodes, body.basis.nodal).all()
        if region is None or material is None or not (body.basis.zones or nodal):
            return None
        zone = PlasticZone(body.points, region, material)
        start = PlasticState.virgin(len(zone)) if state is None else state
        flexibility = body.basis.zones[plastic.index(patch)] if body.basis.zones else None
        return cls(zone, flexibility, kinematics.at(zone.nodes), start)

    def at_rest(self, state: PlasticState) -> Array:
        """Displacements of the zone's nodes due to plastic strain alone, at rest, in the body's axes, (nz, 3) [m]."""
        body, p = self.kinematics.body, self.zone.pseudo_forces(state.strain)
        rows = body.rows(self.zone.nodes)
        moved = np.asarray(rows @ deformed_at_rest(body, rows.T @ p))
        if self.flexibility is not None:
            moved += self.flexibility.own @ p
        return moved.reshape(-1, 3)


def deformed_at_rest(body: ReducedBody, force: Array) -> Array:
    """Coordinates of a body at rest, (n_dofs,), deformed by balanced forces on the coordinates, (n_dofs,)."""
    if not len(body.basis.nodal):
        elastic, found = body.basis.omega > 0, np.zeros(body.n_dofs)
        found[elastic] = force[elastic] / body.basis.omega[elastic] ** 2
        return found
    rigid = mass_normalised(body.rigid, body.mass)
    return FreeBodyFlexibility(body.stiffness, body.mass, rigid)(force[:, None])[:, 0]


class OrderedRows:
    """Flexibility of a small zone, dense, with the dofs that are loaded first, so that products need no copy.

    Like `KeptFlexibility`, by whose fronts its rows are found when they are needed first.

    Parameters
    ----------
    given : ZoneFlexibility
    kind : type
        Type of the numbers in the products.
    """

    def __init__(self, given: ZoneFlexibility, kind: type) -> None:
        n = len(given.own)
        self._given, self._filled = given, 0
        self._order, self._place = np.arange(n), np.arange(n)  # dofs in this order, and the place of each in it
        self._rows: Array = np.empty((n, n), kind)  # of the first dofs, by all in this order; the others take no memory

    def at(self, dofs: Array) -> FirstRows:
        """Flexibility by forces on some dofs, (m,), alone; only the last that was asked for can be used."""
        front, places = np.arange(len(dofs)), self._place[dofs]
        leave, come = np.setdiff1d(front, places), places[places >= len(dofs)]
        now, then = np.concatenate([leave, come]), np.concatenate([come, leave])
        self._order[now] = self._order[then]
        self._place[self._order[now]] = now
        rows = self._rows[: self._filled]
        rows[:, now] = rows[:, then]
        new = np.union1d(leave, front[self._filled :])
        for row, values in zip(new, self._given.rows(self._order[new]), strict=True):
            self._rows[row] = values.take(self._order)
        self._filled = len(dofs)
        return FirstRows(self._rows[: len(dofs)], self._place, self._place[dofs])


class FirstRows:
    """Flexibility by forces on the first of ordered dofs, like `LoadedDofs`.

    Parameters
    ----------
    rows : (m, n) array
        Displacements by unit forces there [m/N].
    place : (n,) int array
        Of each dof in this order.
    first : (m,) int array
        Places of the loaded dofs, as the forces are ordered.
    """

    def __init__(self, rows: Array, place: Array, first: Array) -> None:
        self._rows, self._place, self._first = rows, place, first

    def answer(self, forces: Array) -> tuple[Array, Array]:
        """Displacements of these dofs, (m,) [m], by forces on them, (m,) [N]; what `spread` needs of these forces."""
        force = np.empty(len(forces), self._rows.dtype)
        force[self._first] = forces
        found = force @ self._rows[:, : len(forces)]
        return found[self._first], np.concatenate([force, found])

    def spread(self, answered: Array) -> Array:
        """Displacements of all dofs, (n,) [m], by the forces that were answered."""
        # A combination stays in double precision. Rounding may decide in which iteration a step settles. So a run that
        # goes on would differ from one run by what steps leave, not by rounding.
        force, found = np.split(answered, 2)
        return np.concatenate([found, force @ self._rows[:, len(force) :]])[self._place]


class _Active:
    """Points of a zone that may flow in this step, and the nodes of their elements.

    Parameters
    ----------
    motion : ZoneMotion
    chosen : (g,) bool array
        The points.
    own : OrderedRows or KeptFlexibility
        Flexibility of the zone.
    of_patch : (r, 3 nz) array
        Displacements of the zone's nodes due to unit forces on the rows of the patch [m/N].

    Attributes
    ----------
    points : (k,) int array
    part : PlasticZone
        The zone of these points.
    dofs : (m,) int array
        Displacements of their nodes, among those of the zone.
    """

    def __init__(self, motion: ZoneMotion, chosen: Array, own: OrderedRows | KeptFlexibility, of_patch: Array) -> None:
        self.points, self.part = np.flatnonzero(chosen), motion.zone.part(chosen)
        self.dofs = node_dofs(self.part.nodes)
        self._own = own.at(self.dofs)
        self._of_patch = of_patch.take(self.dofs, axis=1)  # by rows, as loops want them
        self._rows = motion.kinematics.rows[self.dofs]

    def moved(self, q: Array, before: Array) -> Array:
        """Displacements of the nodes, (m,) [m], due to the last coordinates, plus those of the zone in `before`."""
        return np.asarray(self._rows @ q + before[self.dofs])

    def by_patch(self, force: Array) -> Array:
        """Displacements of the nodes, (m,) [m], due to forces on the rows of the patch, (r,) [N]."""
        return loops.combined(self._of_patch, force)

    def at_patch(self, change: Array) -> Array:
        """Displacements of the rows of the patch, (r,) [m], due to a change of the pseudo-forces, (m,) [N]."""
        return np.asarray(self._of_patch @ change.astype(self._of_patch.dtype))

    def answer(self, change: Array) -> tuple[Array, Array]:
        """Displacements of the nodes, (m,) [m], due to a change of the pseudo-forces, (m,) [N]; what `spread` needs."""
        return self._own.answer(change)

    def spread(self, answered: Array) -> Array:
        """Displacements of all nodes of the zone, (3 nz,) [m], due to what `answer` was asked for."""
        return self._own.spread(answered)

    def generalised(self, change: Array) -> Array:
        """Forces on the last coordinates of the body, (n,), from a change of the pseudo-forces, (m,) [N]."""
        return np.asarray(self._rows.T @ change)


class _Pushed(NamedTuple):
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
        What `_Active.spread` needs for the rest; a zero if there is none.
    """

    change: Array
    moved: Array
    moved_patch: Array
    first: float
    answered: Array


class ZoneRun:
    """State of a plastic zone in a run.

    `state` is that of the last accepted step. `present` is what plastic flow leaves in the step that is being computed.
    Each evaluation starts again from `state`. A step finds only the change of the pseudo-forces, on the nodes of points
    that may flow in it. The pseudo-forces of earlier steps move the zone by a constant. The last guess of a step is
    what has moved the zone; what it lacks of the forces that it led to is left for the next step.

    Attributes
    ----------
    zone : PlasticZone
    state : ZoneState
        At the end of the last accepted step.
    present : PlasticState
    flows : bool
        Whether points flow in the present state.
    goes_on : bool
        Whether points flowed in the last accepted step, and the next one begins with the same points or more.
    moved_patch : (r,) array
        Displacements of the patch's rows due to the pseudo-forces of earlier steps, and to what `push` took [m].
    work : float
        Plastic work since the start of the run [J].
    """

    state: ZoneState
    _now: Applied
    _first: Change  # first guess of the present step
    _pushed: _Pushed
    _pushes: deque[_Pushed]  # of the present step, the last ones
    _begin: tuple[Array, PlasticState] | None  # of active points: without the changes of this step
    _strain: Array | None  # of active points, at the end of the last accepted step
    _found: tuple[PlasticState, Array, Array]  # with strains, and what the pushed change has led to
    _flows_on = False  # whether the step after the present state has the same active points, or more
    _excess_found: Array  # of all points, in the present state

    def __init__(self, motion: ZoneMotion) -> None:
        assert motion.flexibility is not None
        self.motion, self.zone, self.flexibility = motion, motion.zone, motion.flexibility
        self._use(float)
        # Von Mises stress is a norm. These bound its growth for a unit change of each coordinate and patch force.
        self._by_q, self._by_force = map(self._largest, (motion.kinematics.rows, self.flexibility.of_patch))
        self.reset()

    def _largest(self, columns: Array) -> Array:
        """Largest von Mises stress anywhere for each column of nodal displacements, (m,) [Pa]."""
        virgin = PlasticState.virgin(len(self.zone))
        beyond = [self.zone.excess(np.ascontiguousarray(column), virgin).max() for column in columns.T]
        return np.array(beyond) + self.zone.flow.yield_stress

    def for_run(self, kind: type) -> Self:
        """Return the same zone in its start state, for another run with numbers of this dtype in large products."""
        result = copy.copy(self)
        result._use(kind)
        result.reset()
        return result

    def _use(self, kind: type) -> None:
        """Take numbers of this dtype in large products."""
        given, single = self.flexibility, np.dtype(kind) == np.float32
        self._own: OrderedRows | KeptFlexibility
        if len(self.zone.nodes) <= _MOST_DENSE:
            self._own = OrderedRows(given, kind)
        else:
            self._own = given.single_own if single else given.own
        self._of_patch: Array = given.single_of_patch if single else np.ascontiguousarray(given.of_patch.T)

    def reset(self) -> None:
        """Go back to the start."""
        plastic, none = self.motion.start, np.zeros(len(self.zone), dtype=bool)
        p = self.zone.pseudo_forces(plastic.strain)
        moved = self.flexibility.own @ p if p.any() else np.zeros(len(p))
        generalised = np.asarray(self.motion.kinematics.rows.T @ p)
        applied = Applied(p, np.zeros(len(p)), moved, p @ self.flexibility.of_patch, generalised, 0.0)
        nothing = _no_change(applied)
        at = np.zeros(len(self._by_q)), np.zeros(len(self._by_force))
        self.begin(ZoneState(plastic, self._with_energy(applied, plastic), nothing, *at, 0.0, none))

    def begin(self, state: ZoneState) -> None:
        """Begin from a state."""
        self.flows = False
        self._choose(state.active)
        self._at = self._margin_at = state.q, state.by_patch
        self._margin = -np.inf
        self.accept(state)
        self.back()

    def after(self) -> ZoneState:
        """State after a step that ends with the last answer."""
        state, active = self.state, self._chosen
        if not self.flows:
            change = self._first
            goes_on = state.goes_on and not change.change.any()
            if change.change.any():
                change = _no_change(self._now)
            return ZoneState(state.plastic, self._now, change, *self._at, self.work, active, goes_on)
        if state.excess is not None and self._flows_on:
            active = self._grown(2 * self._excess_found - state.excess)
        strain = self._found[1] if active is self._chosen else None  # of active points
        change = self._beyond(state.applied)
        found = self.present, self._now, change, *self._at, self.work, active
        return ZoneState(*found, self._flows_on, strain, self._excess_found)

    def accept(self, state: ZoneState) -> None:
        """Accept the step whose end this state is, see `after`."""
        if self.flows:
            self._margin = -np.inf
        self.state, self.flows = state, False
        self.retry()

    def retry(self) -> None:
        """Begin the step again, from the state that was accepted last."""
        if self.state.active is not self._chosen:
            self._choose(self.state.active)
        self._first, self._strain, self._begin = self.state.change, self.state.strain, None

    @property
    def goes_on(self) -> bool:
        """Whether points flowed in the last accepted step, and the next one begins with the same points or more."""
        return self.state.goes_on

    def _with_energy(self, now: Applied, plastic: PlasticState) -> Applied:
        energy = self.zone.own_energy(plastic) - float((0.5 * now.p + now.left) @ now.moved)
        return replace(now, energy=energy)

    def _beyond(self, last: Applied) -> Change:
        """What the present state has applied since the last one."""
        now = self._now
        return Change(now.p - last.p, now.moved - last.moved, now.moved_patch - last.moved_patch)

    def back(self) -> None:
        """Return to the state that was accepted last."""
        self.present, self.flows, self.work = self.state.plastic, False, self.state.work
        self._now, self.moved_patch = self.state.applied, self.state.applied.moved_patch

    @property
    def generalised(self) -> Array:
        """Forces on the last coordinates of the body, (n,) [N], from the present pseudo-forces."""
        return self._now.generalised

    @property
    def moved_patch_before(self) -> Array:
        """Displacements of the patch's rows, (r,) [m], due to the pseudo-forces of earlier steps."""
        return self.state.applied.moved_patch

    @property
    def guess(self) -> Array:
        """Guess for the change of the pseudo-forces on the active nodes, (m,) [N]: that of the step before."""
        guess: Array = self._first.change[self._active.dofs]
        return guess

    def size(self, change: Array) -> float:
        """Norm of the pseudo-forces [N] after a change on the active nodes, (m,) [N]."""
        p = self.state.applied.p.copy()
        p[self._active.dofs] += change
        return float(np.linalg.norm(p))

    def push(self, change: Array | None = None) -> None:
        """Take a guessed change of the pseudo-forces on the active nodes, (m,) [N], for `moved_patch` and `answer`.

        By default it is `guess`, whose displacements are known.
        """
        active, first, guess = self._active, self._first, self.guess
        if change is None:
            self._pushes = deque(maxlen=DEPTH + 1)
        if change is None and np.count_nonzero(first.change) == np.count_nonzero(guess):  # all are active
            pushed = _Pushed(guess, first.moved[active.dofs], first.moved_patch, 1.0, np.zeros(1))
        else:
            change = guess if change is None else change
            moved, answered = active.answer(change)
            pushed = _Pushed(change, moved, active.at_patch(change), 0.0, answered)
        self._pushes.append(pushed)
        self._take(pushed)

    def combine(self, shares: Array) -> Array:
        """Take a combination of the last k changes, by their shares, (k,), like `push`; return it, (m,) [N]."""
        last = zip(*list(self._pushes)[-len(shares) :], strict=True)
        self._take(_Pushed(*(sum(map(operator.mul, one, shares)) for one in last)))
        return self._pushed.change

    def _take(self, pushed: _Pushed) -> None:
        self._pushed, self.moved_patch = pushed, self.state.applied.moved_patch + pushed.moved_patch

    def move(self, q: Array) -> None:
        """Take coordinates of the body, (n,), as the present ones."""
        self._at, self._begin = (q[len(q) - len(self._by_q) :].copy(), self._at[1]), None

    def stays_elastic(self, force: Array) -> bool:
        """Whether a bound shows that no point yields with forces on the patch, (r,) [N].

        True is certain. False means that strains must be computed.
        """
        self._at = self._at[0], force
        by_q, by_force = (abs(now - then) for now, then in zip(self._at, self._margin_at, strict=True))
        return bool(self._margin >= by_q @ self._by_q + by_force @ self._by_force)

    def look(self) -> bool:
        """Whether points begin to flow at the present coordinates and forces, with the committed state."""
        excess = self._excess(self.state.plastic, self._now.moved)
        if excess.max() <= 0:
            self._margin, self._margin_at = -float(excess.max()), self._at
            return False
        flow = int(np.count_nonzero(excess > 0))
        if (excess[~self._chosen] > 0).any() or len(self._active.points) > _SPARE * (flow + _FEW):
            self._choose(self._near(excess, flow))
        return True

    def answer(self, force: Array) -> Array:
        """Change of pseudo-forces on active nodes, (m,) [N], that follows from `push` and forces on the patch, (r,)."""
        moved, before = self._beginning()
        self._at, active = (self._at[0], force), self._active
        state, strain, led_to = active.part.answer(moved + active.by_patch(force) + self._pushed.moved, before)
        self._found = state, strain, led_to
        found: Array = led_to + self.state.applied.left[active.dofs]
        return found

    def _beginning(self) -> tuple[Array, PlasticState]:
        """Displacements of active nodes without patch forces and flow in this step, (m,) [m], and committed state."""
        if self._begin is None:
            active = self._active
            self._begin = active.moved(self._at[0], self.state.applied.moved), self.state.plastic.at(active.points)
        return self._begin

    def finish(self) -> bool:
        """Enter the state of the last `answer`; return whether no other point flows.

        If another point flows, it becomes active, and the answer must be found again.
        """
        active, (state, strain, led_to), before = self._active, self._found, self._beginning()[1]
        pushed, last = self._pushed, self.state.applied
        self.present, self.flows = self.state.plastic.changed(active.points, state), True
        p, left = last.p.copy(), last.left.copy()
        p[active.dofs] += pushed.change
        left[active.dofs] += led_to - pushed.change
        moved = last.moved + pushed.first * self._first.moved
        if pushed.answered.any():
            moved += active.spread(pushed.answered)
        generalised = last.generalised + active.generalised(led_to)
        self._now = Applied(p, left, moved, self.moved_patch, generalised, 0.0)
        self._excess_found = self._excess(self.present, moved)
        if self._grow(self._excess_found):
            self._first = self._beyond(last)
            return False
        self._now = self._with_energy(self._now, self.present)
        flow = int(np.count_nonzero(state.equivalent > before.equivalent))
        self._flows_on = flow > 0 and len(active.points) <= _SPARE * (flow + _FEW)
        work = active.part.work((before, self._committed_strain(before)), (state, strain))
        self.work = self.state.work + work
        return True

    def _committed_strain(self, before: PlasticState) -> Array:
        """Deviatoric strains of the active points, (k, 6), at the end of the last accepted step, in state `before`."""
        if self._strain is None:
            active, state = self._active, self.state
            moved = active.moved(state.q, state.applied.moved) + active.by_patch(state.by_patch)
            self._strain = active.part.answer(moved, before)[1]  # nothing flows; so this gives the strains quickly
        return self._strain

    def _grow(self, excess: Array) -> bool:
        """Make other points that flow active, and those near them, by stresses beyond the flow stress, (g,) [Pa]."""
        grown = self._grown(excess)
        if grown is self._chosen:
            return False
        self._choose(grown)
        return True

    def _grown(self, excess: Array) -> Array:
        """The active points, (g,) bool, and others that flow, and those near them; the same array if there are none."""
        excess = np.where(self._chosen, -np.inf, excess)
        if excess.max() <= 0:
            return self._chosen
        flow = int(np.count_nonzero(excess > 0)) + len(self._active.points) // 2
        return np.asarray(self._chosen | self._near(excess, flow))

    def _excess(self, state: PlasticState, by_flow: Array) -> Array:
        """Von Mises stress beyond the flow stress, (g,) [Pa], where pseudo-forces have moved the nodes, (3 nz,) [m]."""
        q, force = self._at
        moved = self.motion.kinematics.rows @ q + loops.combined(self._of_patch, force) + by_flow
        return self.zone.excess(moved, state)

    def _near(self, excess: Array, flow: int) -> Array:
        """Points that flow or are nearest to flow, (g,) bool, given their stress beyond the flow stress, (g,) [Pa]."""
        most = min(2 * (flow + _FEW), len(excess))
        least = max(np.partition(excess, -most)[-most], -_NEAR * self.zone.flow.yield_stress)
        near: Array = excess >= min(least, 0.0)
        return near

    def _choose(self, chosen: Array) -> None:
        self._chosen, self._active = chosen, _Active(self.motion, chosen, self._own, self._of_patch)
        self._begin = self._strain = None

    def stored(self) -> float:
        """Elastic energy that plastic strain adds to the energy of the patch forces [J]."""
        return self._now.energy - float(self.generalised @ self._at[0])


def _no_change(applied: Applied) -> Change:
    return Change(*(np.zeros(len(one)) for one in (applied.p, applied.moved, applied.moved_patch)))
