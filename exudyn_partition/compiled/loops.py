"""Explicit steps of a plan: compiled if numba is there, else by NumPy, which is slow.

No other module of `compiled` knows which. Module `kernels` beside it has the compiled loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from ..algebra.block_complementarity import LIMITS, BlockComplementarity, FlatBlocks
from ..algebra.flat_friction import FRICTION_LIMITS
from ..algebra.loops import friction_object
from ..contact.gaps import GapState
from ..contact.loops import evaluate_frozen, flat_contacts, rows_object
from ..errors import ComplementarityError
from ..support.arrays import Array
from ..support.compiled import kernels
from .followed_pairs import FollowedPairs
from .frames_back import FramesBack, back_over_inertia, turn_back
from .friction_plan import CHOICES, N_FRICTION, FlatFrictionRows, FrictionPlan, FrictionState
from .friction_steps import FrictionSteps
from .moving import Anchors, Following, MovingPlan, MovingState
from .pair_rows import PairRows
from .plain_moving import PlainBody, PlainMoving
from .plain_rubbing import PlainRubbing
from .plan import Bodies, FrozenPlan, Motion, StepPlan
from .rows_back import RowsBack, back_over_rows
from .rubbing import Rubbing, RubbingState
from .rubbing_pairs import RubbingPair
from .start import Start
from .surfaces_back import SurfaceRows

N_VALUES = 6  # of each contact, see `frozen.FrozenContacts`


class Stop(NamedTuple):
    """Why steps cannot go on.

    Parameters
    ----------
    kind : {"slides", "unstable", "unsettled"}
        Pairs begin to slide, coordinates are not finite, or closed rows do not settle.
    text : str
    rough : bool
        Whether the pairs that slide have friction.
    """

    kind: Literal["slides", "unstable", "unsettled"]
    text: str
    rough: bool = False


class Samples(NamedTuple):
    """Room for samples. Motion, or `stored` and `lam`, need not be kept.

    Parameters
    ----------
    q, v, a : (n, nq) arrays
        Coordinates, velocities and accelerations.
    values : (n, nc, 6) array
        Of each contact, see `frozen.FrozenContacts`.
    stored : (n, nc) array
        Energy that each contact stores [J].
    lam : (n, nr) array
        Normal forces on all rows [N].
    friction : (n, nf, 7) array
        Of each contact with friction, see `contact_run.ContactRun.friction_values`.
    traction, status : (n, 3 k), (n, k) arrays
        Tangential forces in space on the rows of these contacts [N], and whether they stick or slip.
    fresh : (n, ns) bool array
        Whether moving contacts have found another flexibility since the sample before; those with friction come last.
    """

    q: Array
    v: Array
    a: Array
    values: Array
    stored: Array
    lam: Array
    friction: Array
    traction: Array
    status: Array
    fresh: Array

    @classmethod
    def of(cls, plan: StepPlan, n: int, *, motion: bool, rows: bool) -> Samples:
        """Room for n samples; `motion` and `rows` say whether coordinates and forces on rows are kept."""
        contacts, friction, nq = plan.contacts, plan.contacts.friction, len(plan.bodies.mass)
        nc, nr, (q, v, a), kept = len(contacts.all_names), contacts.n_rows, np.empty((3, n * motion, nq)), n * rows
        nf, k = (0, 0) if friction is None else (len(friction.names), friction.n_rows)
        of_friction = np.empty((n, nf, N_FRICTION)), np.empty((kept, 3 * k)), np.empty((kept, k), dtype=np.int8)
        moving = contacts.moving
        of_rubbing = 0 if friction is None or friction.rubbing is None else len(friction.rubbing.groups)
        fresh = np.zeros((n, of_rubbing + (0 if moving is None else len(moving.contact))), dtype=bool)
        values, stored, lam = np.empty((n, nc, N_VALUES)), np.empty((kept, nc)), np.empty((kept, nr))
        return cls(q, v, a, values, stored, lam, *of_friction, fresh)


class Peaks(NamedTuple):
    """Largest force of each contact so far, and how deep rows were pressed.

    Parameters
    ----------
    force : (nc,) array
        [N]
    lam : (nr,) array
        Normal forces on the rows of each contact then [N].
    q : (nc, nq) array
        Coordinates then.
    depth : (nr,) array
        Largest depth of each row while it was closed, by the coordinates alone [m]; minus infinity if it never was.
    """

    force: Array
    lam: Array
    q: Array
    depth: Array

    @classmethod
    def of(cls, contacts: FrozenPlan, n: int) -> Peaks:
        """Room for some contacts and n coordinates, without a force."""
        nc = len(contacts.all_names)
        return cls(np.zeros(nc), np.zeros(contacts.n_rows), np.zeros((nc, n)), np.full(contacts.n_rows, -np.inf))


class ContactParts(NamedTuple):
    """Matrices of one contact as views of flat arrays.

    Parameters
    ----------
    rows : slice
        Its rows among all.
    dofs : (n,) int array
        Numbers of its coordinates.
    H : (n, nr) array
        Gaps by the coordinates, transposed.
    normals : (nr, 3) array
    drift : (k, n) array
        How its pairs slide by the coordinates.
    drift_start : (k,) array
        Where they were found [m].
    reach : float
        How far they may slide [m].
    """

    rows: slice
    dofs: Array
    H: Array
    normals: Array
    drift: Array
    drift_start: Array
    reach: float

    @classmethod
    def of(cls, plan: FrozenPlan | FrictionPlan, j: int) -> ContactParts:
        """Parts of contact j."""
        flat = plan.rows
        rows, dofs = slice(*flat.starts[j : j + 2]), flat.dofs[slice(*flat.places[j : j + 2])]
        start = flat.drift_start[slice(*flat.drift_starts[j : j + 2])]
        n, nr = len(dofs), rows.stop - rows.start

        def matrix(begin: int, k: int, m: int) -> Array:
            return flat.numbers[begin:][: k * m].reshape(k, m)

        H, normals = matrix(flat.H[j], n, nr), matrix(flat.normals[j], nr, 3)
        return cls(rows, dofs, H, normals, matrix(flat.drift[j], len(start), n), start, float(flat.reach[j]))

    def slide(self, q: Array) -> bool:
        """Whether pairs slide at coordinates q, (nq,)."""
        return bool(not abs(self.drift @ q[self.dofs] - self.drift_start).max(initial=0.0) <= self.reach)


class RubbingSteps:
    """Contacts with friction whose rows follow the motion, in a run.

    Parameters
    ----------
    plan : Rubbing
    flat : FlatFrictionRows
        Of this run.
    friction : FrictionState
    n : int
        Number of coordinates.
    """

    def __init__(self, plan: Rubbing, flat: FlatFrictionRows, friction: FrictionState, n: int) -> None:
        self._plan, self._flat, self._friction = plan, flat, friction
        self.state = RubbingState.of(plan, len(flat.tangents), n)
        self._first = len(plan.surfaces.contact)
        self._sides: Any = ()  # which loops find by their addresses
        self.pairs = list[RubbingPair]()

    def follow(self, moving: MovingState) -> None:
        """Know the state by which bodies grow."""
        plan, loops = self._plan, kernels("compiled", "pair_kernels") if self._plan.pairs else None
        rest = plan, self.state, self._flat, self._friction, moving, loops
        self.pairs = [RubbingPair(one, number, *rest) for number, one in enumerate(plan.pairs)]
        self._held = FollowedPairs(self.pairs, self._first, loops)

    def for_loops(self, contacts: Sequence[Following], state: MovingState) -> Any:
        """The contacts as compiled loops take them; `contacts` are those with rigid surfaces."""
        moving, found = kernels("compiled", "moving_kernels"), kernels("compiled", "rubbing_kernels")
        assert found is not None, "asked for what is only done at once"
        assert moving is not None, "asked for what is only done at once"
        self._sides = moving.rigid_sides(contacts)
        return found.rubs_of(self._plan, self.state, state, self._sides, self._held.for_loops)

    def plain(self, moving: MovingState, bodies: Sequence[PlainBody]) -> PlainRubbing:
        """The contacts by NumPy."""
        return PlainRubbing(self._plan, self.state, self._flat, moving, bodies, self.pairs)

    @property
    def lost(self) -> int:
        """See `MovingSteps.lost`, of contacts of two bodies among these."""
        return int(self.state.lost[0])

    def place(self, number: int, m: Motion) -> None:
        """Find the rows of a contact of two bodies anew."""
        self.pairs[number].place_rows(m.q, m.q_start)
        self._held.hold(number)

    def hold(self) -> None:
        """Let loops find the present rows of all contacts of two bodies."""
        self._held.hold_all()

    def begin(self, start: Start) -> None:
        """Begin a run, or go back to its state."""
        for pair, before in zip(self.pairs, start.rubbing_pairs or [None] * len(self.pairs), strict=True):
            pair.begin(before)

    def take_anchors(self, start: Start) -> None:
        """Have the anchors of a state; None are none."""
        state, first, anchors = self.state, self._first, start.rubbing
        state.anchored[:], state.fresh[:], state.found_axis[:] = False, False, -1
        if anchors is not None:
            state.anchored[:first], state.anchors[:first] = anchors.anchored, anchors.q
            state.along[:], state.growing[:first] = anchors.along, anchors.growing
        for number, pair in enumerate(self.pairs):
            pair.take_anchor(None if start.rubbing_pairs is None else start.rubbing_pairs[number].anchor)
        self.hold()

    def anchors(self) -> Anchors:
        """Present anchors of contacts with rigid surfaces."""
        state, n = self.state, self._first
        kept = state.anchored[:n], state.anchors[:n], state.along, state.growing[:n]
        return Anchors(*(part.copy() for part in kept))


class MovingSteps:
    """Bodies in floating frames and moving contacts in a run.

    Parameters
    ----------
    plan : MovingPlan
    blocks : FlatBlocks
        Of the run.
    n : int
        Number of coordinates.
    rubbing : RubbingSteps or None
        Those of them with friction on rigid surfaces.
    """

    def __init__(self, plan: MovingPlan, blocks: FlatBlocks, n: int, rubbing: RubbingSteps | None) -> None:
        self._plan, self._blocks, self._rubbing = plan, blocks, rubbing
        self._state, self._step = plan.state(int(blocks.starts[-1]), n), 0.0
        self._turning: Array | None = None  # at the start, until a step is made
        first, loops = len(plan.surfaces.contact), kernels("compiled", "pair_kernels") if plan.pairs else None
        self._pairs = [PairRows(one, first + i, self._state, blocks, loops) for i, one in enumerate(plan.pairs)]
        self._sides: Any = ()  # of contacts with rigid surfaces, which loops find by their addresses
        self._held = FollowedPairs(self._pairs, first, loops)
        if rubbing is not None:
            rubbing.follow(self._state)

    @cached_property
    def for_loops(self) -> Any:
        """Bodies, contacts and state as compiled loops take them."""
        found = kernels("compiled", "moving_kernels")
        assert found is not None, "asked for what is only done at once"
        self._sides = found.rigid_sides(self._plan.rigid)
        return found.moving_of(self._plan, self._state, self._sides, self._held.for_loops)

    @cached_property
    def rubs(self) -> Any:
        """Contacts with friction as compiled loops take them; None if there are none."""
        return None if self._rubbing is None else self._rubbing.for_loops(self._plan.rubbing, self._state)

    @cached_property
    def plain(self) -> PlainMoving:
        """The same by NumPy."""
        return PlainMoving(self._plan, self._state, self._blocks, self._pairs)

    def place(self, number: int, m: Motion, v: Array, h: Array) -> None:
        """Find the rows of a contact of two bodies anew, see `PairRows.place`."""
        pair = self._pairs[number]
        pair.place(m.q, m.q_start, v, h)
        self._held.hold(number)

    def stand(self, m: Motion, v: Array, h: Array) -> None:
        """Let contacts of two bodies, and those that rub, be where the motion is; the next evaluation is elsewhere."""
        for pair in self._pairs:
            pair.gaps_at(m.q, m.q, v, h)
        self._held.hold_all()
        self.stand_rubbing(m, v)

    def stand_rubbing(self, m: Motion, v: Array) -> None:
        """Let contacts with friction slide from where the motion is."""
        if (rubbing := self.plain_rubbing) is not None:
            for body in self.plain.bodies:
                body.grow(self._state, v)
            rubbing.stand(m.q)
        if self._rubbing is not None:
            self._rubbing.hold()

    @cached_property
    def plain_rubbing(self) -> PlainRubbing | None:
        """Contacts with friction by NumPy."""
        return None if self._rubbing is None else self._rubbing.plain(self._state, self.plain.bodies)

    @property
    def lost(self) -> int:
        """Number of the contact of two bodies for which loops need other rows; -1 if there is none."""
        return int(self._state.lost[0])

    @property
    def rubbing_pairs(self) -> RubbingSteps | None:
        """Contacts with friction, if some are of two bodies."""
        return self._rubbing if self._rubbing is not None and self._rubbing.pairs else None

    @property
    def places_pairs(self) -> bool:
        """Whether there are contacts of two bodies."""
        return bool(self._pairs)

    def place_all(self, m: Motion, v: Array, h: Array) -> None:
        """Find the rows of all contacts of two bodies."""
        for number in range(len(self._pairs)):
            self.place(number, m, v, h)

    def count_step(self) -> None:
        """Count a step that loops have not made whole, and let them find the rows and anchors that it has found."""
        for pair in self._pairs:
            pair.count_step()
        self._held.hold_all()
        if self._rubbing is not None:
            self._rubbing.hold()

    def watch_edges(self, values: Array, h: Array, lam: Array, friction: FrictionState | None, q: Array) -> None:
        """See `moving_kernels.watch_edges`."""
        for pair in self._pairs:
            pair.watch_edge(values, h, lam, q)
        if friction is not None and self._rubbing is not None:
            for rough in self._rubbing.pairs:
                rough.watch_edge(friction.values, friction.gap, friction.lam[:, 0], q)

    def keep_fresh(self, fresh: Array) -> None:
        """See `moving_kernels.keep_fresh`."""
        n, state = len(self._state.fresh), self._state
        fresh[:n], state.fresh[:] = state.fresh, False
        if self._rubbing is not None:
            fresh[n:], self._rubbing.state.fresh[:] = self._rubbing.state.fresh, False

    def left(self, first: int) -> dict[int, Array]:
        """See `run.Histories`; contacts with friction have numbers from `first` on."""
        state = self._state
        found = {pair.contact: state.left_at[pair.s].copy() for pair in self._pairs if state.left[pair.s]}
        if (rubbing := self._rubbing) is not None:
            rough = [pair for pair in rubbing.pairs if rubbing.state.left[pair.s]]
            found |= {first + pair.contact: rubbing.state.left_at[pair.s].copy() for pair in rough}
        return found

    def begin(self, start: Start) -> None:
        """Begin a run, or go back to its state; without anchors, contacts have none."""
        self._step, self._turning = 0.0, start.turning
        for pair, before in zip(self._pairs, start.pairs or [None] * len(self._pairs), strict=True):
            pair.begin(before)
        if self._rubbing is not None:
            self._rubbing.begin(start)
        self.take_anchors(start)

    def take_anchors(self, start: Start) -> None:
        """Have the anchors of a state. What an evaluation there finds is lost before the first step, as in Exudyn."""
        state = self._state
        state.anchored[:], state.fresh[:], state.found[:], state.added[:] = False, False, state.frozen, -1.0
        self._blocks.n_closed[:] = -1
        if (anchors := start.anchors) is not None:
            first = len(anchors.anchored)
            state.anchored[:first], state.anchors[:first] = anchors.anchored, anchors.q
            state.along[:], state.growing[:first] = anchors.along, anchors.growing
        if self._rubbing is not None:
            self._rubbing.take_anchors(start)
        for number, pair in enumerate(self._pairs):
            pair.take_anchor(None if start.pairs is None else start.pairs[number].anchor)
        self._held.hold_all()

    def step(self, h: float) -> None:
        """Know that steps of a length h [s] follow."""
        self._step, self._turning = h, None

    def turning(self, m: Motion) -> Array:
        """Velocities by which bodies grow now, see `Start`: those in the middle of the last step."""
        return m.v - 0.5 * self._step * m.a if self._turning is None else self._turning

    def anchors(self) -> Anchors:
        """Present anchors of contacts with rigid surfaces."""
        state, n = self._state, len(self._plan.surfaces.contact)
        kept = state.anchored[:n], state.anchors[:n], state.along, state.growing[:n]
        return Anchors(*(values.copy() for values in kept))

    def anchors_of_rubbing(self) -> Anchors | None:
        """The same of contacts with friction."""
        return None if self._rubbing is None else self._rubbing.anchors()

    def pairs(self, q: Array) -> tuple[GapState, ...]:
        """States of contacts of two bodies at coordinates q, (nq,)."""
        return tuple(pair.end(q) for pair in self._pairs)

    def pairs_of_rubbing(self, q: Array) -> tuple[GapState, ...] | None:
        """The same of contacts with friction."""
        return None if self._rubbing is None else tuple(pair.end(q) for pair in self._rubbing.pairs)


class Stepper:
    """Explicit steps of a plan, as Exudyn's VelocityVerlet makes them.

    Damping forces belong to the velocities in the middle of a step::

        v' = v + h a / 2,    q = q + h v',    a = M^-1 (f(q) + load - K q - D v'),    v = v' + h a / 2.

    Parameters
    ----------
    contacts : FrozenPlan
        Contacts of the plans, which may have different bodies.
    n : int
        Number of coordinates.

    Attributes
    ----------
    motion : Motion
    peaks : Peaks
    values, stored : (nc, 6), (nc,) arrays
        Values of each contact, see `frozen.FrozenContacts`, and the energy that it stores [J].
    iterations : int
        Of the closed rows of all contacts since the start.
    """

    _plan: StepPlan
    _joint: BlockComplementarity | None
    _rough: FlatFrictionRows  # of contacts with friction
    _plain_friction: FrictionSteps | None

    def __init__(self, contacts: FrozenPlan, n: int) -> None:
        self.contacts, self._kernels, nc = contacts, kernels("compiled"), len(contacts.names)
        self.motion, self.peaks, self._blocks = Motion.of(n), Peaks.of(contacts, n), contacts.blocks_of_run()
        count = len(contacts.all_names)
        self._h, self.stored = np.zeros(len(contacts.rows.start)), np.zeros(count)
        self.values = np.zeros((count, N_VALUES))
        self._parts = [ContactParts.of(contacts, j) for j in range(nc)]
        self._flat: Any = None  # contacts without friction; if all have it, loops are not compiled for others
        if self._kernels and (nc or contacts.friction is None):
            of_frozen = self.values[:nc], self.stored[:nc]
            self._flat = flat_contacts(contacts.rows, self._blocks, self._h, *of_frozen)
        self._friction: FrictionState | None = None
        self._loop: Any = None  # the same, as compiled loops take it
        self._looped = False  # whether these have found the last forces that a step of loops did not find
        rubbing = None
        if contacts.friction is not None:
            self._friction = contacts.friction.state(self.values[nc:], self.stored[nc:])
            self._rough = contacts.friction.flat()
            if self._kernels:
                self._loop = friction_of(self._rough, self._friction)
            self._friction_parts = [ContactParts.of(contacts.friction, j) for j in range(count - nc)]
            if contacts.friction.rubbing is not None:
                rubbing = RubbingSteps(contacts.friction.rubbing, self._rough, self._friction, n)
        self._moving = None if contacts.moving is None else MovingSteps(contacts.moving, self._blocks, n, rubbing)

    @property
    def iterations(self) -> int:
        """See the class."""
        of_friction = 0 if self._friction is None else self._friction.iterations.sum()
        return int(self._blocks.iterations.sum() + of_friction)

    @property
    def left(self) -> dict[int, Array]:
        """See `run.Histories`."""
        return {} if self._moving is None else self._moving.left(len(self.contacts.names))

    @property
    def closed(self) -> Array:
        """Whether each contact has closed rows, (nc,) bool."""
        return np.asarray(self.values[:, 1] > 0.0)

    def begin(self, plan: StepPlan, start: Start) -> Stop | None:
        """Begin a plan; return what prevents it, see `advance`.

        With accelerations and a memory of rows with friction, that memory has the forces that the plan begins with.
        """
        self._plan, self._joint, self._plain_friction, m = plan, None, None, self.motion
        self._blocks.forget()
        self._blocks.iterations[:] = 0
        self.peaks.force[:], self.peaks.depth[:] = 0.0, -np.inf
        m.q[:], m.v[:], m.q_start[:] = start.q, start.v, start.q
        if self._friction is not None:
            assert plan.contacts.friction is not None
            self._friction.begin(plan.contacts.friction, start.friction)
        if self._moving is not None:
            self._moving.begin(start)
        turning = m.v if start.turning is None else start.turning
        if why := self._find_at_once(turning, place=True):
            return why
        known = start.a is not None and start.friction is not None
        if self._moving is not None:
            self._moving.stand_rubbing(m, turning)
        if self._friction is not None and (why := self._begin_friction(known=known)):
            return why
        if self._moving is not None:
            self._moving.plain.act(m.q, m.force)
        if start.a is None:
            self._accelerate(0.0)
        else:
            m.a[:] = start.a
        self._watch()
        if self._moving is not None:
            self._moving.take_anchors(start)
        return None

    def _evaluated(self, turning: Array) -> bool:
        """Find the forces of contacts without friction by compiled loops; return whether that was done.

        `turning`, (nq,), are velocities by which bodies in floating frames grow.
        """
        m = self.motion
        if self._kernels is None:
            return False
        if self._moving is None:
            if self._flat is None:
                m.force[:] = 0.0
                return True
            return evaluate_frozen(self._flat, m.q, m.force) >= 0
        where = self._moving.for_loops, m.q, turning, m.force
        return int(self._kernels.evaluate_moving(self._flat, *where, LIMITS)) >= 0

    def _find_at_once(self, turning: Array, *, place: bool = False) -> Stop | None:
        """Find the forces of contacts without friction, by compiled loops if they settle; return what prevents it.

        Rows of two bodies are found where loops cannot follow them; with `place`, of all.
        """
        m, moving = self.motion, self._moving
        if moving is not None and moving.places_pairs and self._kernels is not None:
            if not np.isfinite(m.q).all():
                return self._prevents((), ())
            try:
                if place:
                    moving.place_all(m, turning, self._h)
                else:
                    moving.place(moving.lost, m, turning, self._h)
                while not self._evaluated(turning):
                    if moving.lost < 0:
                        return self._find_others(turning)
                    moving.place(moving.lost, m, turning, self._h)
            except ComplementarityError as error:
                return Stop("unsettled", str(error))
            return None
        return None if self._evaluated(turning) else self._find_others(turning)

    def _begin_friction(self, *, known: bool) -> Stop | None:
        """Find the forces of contacts with friction with which a run begins, see `begin`; return what prevents it."""
        m, friction = self.motion, self._friction
        if known:
            assert friction is not None
            self._plain().recall(friction, m.q, m.force)
            return None
        if self._kernels is not None and self._found_by_loops():
            return None
        return self._find_friction_by_numpy()

    def _found_by_loops(self) -> bool:
        """Add the forces of contacts with friction by compiled loops; whether they find them.

        Rows of two bodies are found where loops cannot follow them.
        """
        m, moving = self.motion, self._moving
        assert self._kernels is not None
        rubs, pairs = (None, None) if moving is None else (moving.rubs, moving.rubbing_pairs)
        lost = -1 if pairs is None else pairs.lost
        while True:
            if pairs is not None and lost >= 0:
                if not np.isfinite(m.q).all():
                    return False
                pairs.place(lost, m)
            if self._kernels.find_friction(self._loop, rubs, m.q, m.q_start, m.force):
                return True
            lost = -1 if pairs is None else pairs.lost
            if lost < 0:
                return False

    def _plain(self) -> FrictionSteps:
        """Contacts with friction by NumPy."""
        if self._plain_friction is None:
            assert self._plan.contacts.friction is not None
            rubbing = None if self._moving is None else self._moving.plain_rubbing
            self._plain_friction = FrictionSteps(self._plan.contacts.friction, self._rough, rubbing)
        return self._plain_friction

    def state(self) -> Start:
        """Present state, in arrays of its own."""
        m, friction, moving = self.motion, self._friction, self._moving
        return Start(
            m.q.copy(), m.v.copy(), m.a.copy(),
            friction=None if friction is None else friction.memory.copy(),
            turning=None if moving is None else moving.turning(m).copy(),
            anchors=None if moving is None else moving.anchors(),
            pairs=None if moving is None else moving.pairs(m.q),
            rubbing=None if moving is None else moving.anchors_of_rubbing(),
            rubbing_pairs=None if moving is None else moving.pairs_of_rubbing(m.q),
        )  # fmt: skip

    def go_back(self, state: Start) -> None:
        """Go back to an earlier state of this run."""
        m = self.motion
        m.q[:], m.v[:], m.a[:] = state.q, state.v, state.a
        if self._friction is not None:
            self._friction.go_back(state.friction)
        if self._moving is not None:
            self._moving.begin(state)
            self._moving.stand(m, m.v if state.turning is None else state.turning, self._h)
            self._moving.take_anchors(state)

    def advance(self, h: float, first: int, count: int, between: int, samples: Samples) -> tuple[int, Stop | None]:
        """Make steps of length h [s] with the numbers `first` to `count`, from 1 on.

        Parameters
        ----------
        h : float
        first, count : int
        between : int
            Steps from one sample to the next: step number i writes sample i / `between` - 1.
        samples : Samples

        Returns
        -------
        Number of the last step that was made, and what stopped the steps; None if nothing did. Then the motion is at
        the start of a step.
        """
        m = self.motion
        rubs = moving = None
        if self._moving is not None:
            self._moving.step(h)
            if self._kernels:
                rubs, moving = self._moving.rubs, self._moving.for_loops
        for_loops = self._plan.bodies, self._flat, self._loop, rubs, moving, m, samples, self.peaks, LIMITS, h
        while first <= count:
            if self._kernels:
                first = self._kernels.advance(*for_loops, first, count, between)
                if first > count:
                    break
            else:
                m.q_start[:], m.v_start[:] = m.q, m.v
                m.v[:] += 0.5 * h * m.a
                m.q[:] += h * m.v
                if self._moving is not None:
                    self._moving.plain.turn_on(m, h)
            if why := self._find():
                m.q[:], m.v[:] = m.q_start, m.v_start
                return first - 1, why
            if self._friction is not None:
                self._accept_friction(h)
            if self._moving is not None:
                self._moving.plain.act(m.q, m.force)
                self._moving.count_step()
            self._accelerate(0.5 * h)
            m.v[:] += 0.5 * h * m.a
            self._watch()
            if not first % between:
                self.keep(samples, first // between - 1)
            first += 1
        return count, None

    def _find(self) -> Stop | None:
        """Find the forces at the present coordinates; return what prevents it.

        Compiled loops give up where closed rows do not settle soon, or other rows must be found.
        """
        moving, pairs = self._moving, None if self._moving is None else self._moving.rubbing_pairs
        if self._kernels is not None and pairs is not None and pairs.lost >= 0:  # other forces are known
            return self._find_friction()
        if self._kernels is not None and moving is not None and moving.lost >= 0:
            why = self._find_at_once(self.motion.v)
        else:
            why = self._find_others(self.motion.v)
        return self._find_friction() if why is None and self._friction is not None else why

    def _prevents(self, names: Sequence[str], parts: Sequence[ContactParts], *, rough: bool = False) -> Stop | None:
        """What prevents that forces of some contacts are found at the present coordinates."""
        q = self.motion.q
        if not np.isfinite(q).all():
            return Stop("unstable", "the gaps are not finite: the run has become unstable")
        for name, part in zip(names, parts, strict=True):
            if part.slide(q):
                text = f"pairs of contact {name!r} begin to slide, which compiled steps do not follow"
                return Stop("slides", text, rough)
        return None

    def _find_friction(self) -> Stop | None:
        """Add the forces of contacts with friction, see `_find`."""
        of_two = self._moving is not None and self._moving.rubbing_pairs is not None
        try:
            self._looped = self._kernels is not None and of_two and self._found_by_loops()
        except ComplementarityError as error:
            return Stop("unsettled", str(error))
        return None if self._looped else self._find_friction_by_numpy()

    def _accept_friction(self, h: float) -> None:
        """Take the forces of contacts with friction as those at the end of a step of length h [s]."""
        assert self._friction is not None
        if self._looped and self._kernels is not None:
            self._kernels.accept_friction(self._loop, None if self._moving is None else self._moving.rubs, h)
        else:
            self._plain().accept(self._friction, h)

    def _find_friction_by_numpy(self) -> Stop | None:
        """Add the forces of contacts with friction by NumPy; return what prevents it."""
        m, friction, plan = self.motion, self._friction, self.contacts.friction
        assert friction is not None
        assert plan is not None
        if why := self._prevents(plan.names, self._friction_parts, rough=True):
            return why
        friction.forget()
        try:
            self._plain().find(friction, m.q, m.q_start, m.force)
        except ComplementarityError as error:
            return Stop("unsettled", str(error))
        return None

    def _find_others(self, turning: Array) -> Stop | None:
        """Find the forces of contacts without friction by NumPy, see `_evaluated`; return what prevents it."""
        m, plan, blocks = self.motion, self.contacts, self._blocks
        if why := self._prevents(plan.names, self._parts):
            return why
        for part in self._parts:
            self._h[part.rows] = plan.rows.start[part.rows] + m.q[part.dofs] @ part.H
        self._joint = self._joint or plan.joint()
        try:
            if self._moving is not None:
                lam, pushed, iterations = self._moving.plain.find(m, turning, self._h, self._joint, plan)
            else:
                lam, pushed, iterations = forces_of(plan, self._joint, self._h, blocks.active)
        except ComplementarityError as error:
            return Stop("unsettled", str(error))
        blocks.lam[:], blocks.pushed[:], blocks.active[:], blocks.n_closed[:] = lam, pushed, lam > 0.0, -1
        blocks.iterations[:] += iterations
        m.force[:] = 0.0
        for j, part in enumerate(self._parts):
            push, gap = lam[part.rows], pushed[part.rows]
            m.force[part.dofs] += part.H @ push
            self.values[j] = [push.sum(), np.count_nonzero(push), *(push @ part.normals), gap.min(initial=np.inf)]
            self.stored[j] = -0.5 * push @ self._h[part.rows]
        if self._moving is not None:
            self._moving.plain.push(m.q, lam, m.force, self.values)
        return None

    def _accelerate(self, half_step: float) -> None:
        """Set accelerations from coordinates, velocities half a step [s] before, and contact forces."""
        m, bodies = self.motion, self._plan.bodies
        if self._moving is not None:
            self._moving.plain.inertia(bodies, m, half_step)
        m.a[:] = (m.force + bodies.load - (bodies.stiffness * m.q + bodies.damping * m.v)) / bodies.mass
        if self._moving is not None:
            self._moving.plain.turn_accelerations(bodies, m)

    def _watch(self) -> None:
        """Keep the largest force of each contact, and the depths of closed rows."""
        starts, lam, depth = self.contacts.all_starts, self._lam(), self.peaks.depth
        gaps = self._h if self._friction is None else np.concatenate([self._h, self._friction.gap])
        np.maximum(depth, -gaps, out=depth, where=lam > 0.0)
        for j, force in enumerate(self.values[:, 0]):
            if force > self.peaks.force[j]:
                rows = slice(*starts[j : j + 2])
                self.peaks.force[j], self.peaks.q[j] = force, self.motion.q
                self.peaks.lam[rows] = lam[rows]

    def _lam(self) -> Array:
        """Normal forces on all rows, (nr,) [N]."""
        lam: Array = self._blocks.lam
        return lam if self._friction is None else np.concatenate([lam, self._friction.lam[:, 0]])

    def keep(self, samples: Samples, place: int) -> None:
        """Write the present state to a place of samples."""
        if len(samples.q):
            samples.q[place], samples.v[place], samples.a[place] = self.motion.q, self.motion.v, self.motion.a
        samples.values[place] = self.values
        if len(samples.stored):
            samples.stored[place], samples.lam[place] = self.stored, self._lam()
        if self._moving is not None:
            self._moving.watch_edges(self.values, self._h, self._blocks.lam, self._friction, self.motion.q)
            self._moving.keep_fresh(samples.fresh[place])
        if self._friction is not None:
            s = self._friction
            samples.friction[place] = s.friction
            if len(samples.stored):
                traction = np.einsum("rk,rkd->rd", s.lam[:, 1:], self._rough.tangents)
                samples.traction[place], samples.status[place] = traction.ravel(), s.status


def friction_of(rows: FlatFrictionRows, state: FrictionState) -> Any:
    """All contacts with friction as compiled loops take them."""
    found, (flat, *arrays), (memory, *changing, pool) = kernels("compiled", "rough_kernels"), rows, state
    assert found is not None, "asked for what is only done at once"
    objects = rows_object(flat), friction_object(pool), friction_object(pool)
    return found.friction_of(*objects, *arrays, *memory, *changing, FRICTION_LIMITS, CHOICES)


def forces_of(plan: FrozenPlan, joint: BlockComplementarity, h: Array, active: Array) -> tuple[Array, Array, Array]:
    """Forces on all rows, (nr,) [N], for gaps h, (nr,) [m], and a guess of the closed rows, (nr,) bool, by NumPy.

    `joint` is the plan's, see `FrozenPlan.joint`, in this run.

    Returns
    -------
    The forces, gaps with the displacements that other contacts cause, (nr,) [m], and iterations of each contact, (n,).

    Raises
    ------
    ComplementarityError
        If no closed rows settle.
    """
    n, ends = len(plan.names), plan.rows.starts[1:-1]
    if h.min(initial=0.0) >= 0.0:
        return np.zeros(len(h)), h.copy(), np.zeros(n, dtype=np.int64)
    problems, gaps = [problem.without_guess() for problem in plan.problems], dict(enumerate(np.split(h, ends)))
    for problem, guess in zip(problems, np.split(active, ends), strict=True):
        problem.set_active(guess)
    if plan.core:
        found = joint.solve(dict(enumerate(problems)), gaps, dict(enumerate(plan.fields)))
        lam, pushed = [found[j] for j in range(n)], np.concatenate([joint.pushed[j] for j in range(n)])
    else:
        lam, pushed = [problem.solve(gaps[j]) for j, problem in enumerate(problems)], h.copy()
    return np.concatenate(lam), pushed, np.array([problem.iterations for problem in problems])


class Adjoint(NamedTuple):
    """Adjoints of k numbers between two samples; `go_back` writes to them.

    Parameters
    ----------
    q, u, v : (k, nq) arrays
        Of coordinates, of velocities in the middle of the step after the sample, and of velocities.
    a : (k, nq) array
        Of accelerations, from inertia forces of the step after the sample.
    """

    q: Array
    u: Array
    v: Array
    a: Array

    def add(self, by_q: Array, by_v: Array, *, begins: bool) -> None:
        """Add derivatives by coordinates and velocities, (k, nq), of a sample over which `go_back` has gone.

        Unless that is the start, they are those of the sample before, and of velocities in the middle of the step.
        """
        self.q[:] += by_q
        self.v[:] += by_v
        if not begins:
            self.u[:] += by_v


def go_back(
    bodies: Bodies,
    by_q: Array,
    by_v: Array,
    h: float,
    first: int,
    adjoint: Adjoint,
    rows: RowsBack | None,
    on_surfaces: SurfaceRows | None,
    frames: FramesBack | None,
) -> Array:
    """Go back over m samples.

    Parameters
    ----------
    bodies : Bodies
    by_q, by_v : (m, k, nq) arrays
        Derivatives of the numbers by coordinates and velocities at the samples.
    h : float
        Step [s].
    first : int
        Number of the first of these samples, 0 for the start of the run.
    adjoint : Adjoint
    rows : RowsBack or None
        Closed rows; their slips and what comes from coefficients are set.
    on_surfaces : SurfaceRows or None
        Those of them that follow the motion on rigid surfaces.
    frames : FramesBack or None
        Bodies in floating frames; its `a` is that of the adjoint.

    Returns
    -------
    (m, k, nq) array
        Adjoint of the accelerations over the masses, at all samples.
    """
    by_q, by_v = np.ascontiguousarray(by_q), np.ascontiguousarray(by_v)  # loops are compiled for each order
    y = np.empty_like(by_q)
    loops, of_bodies = kernels("compiled", "adjoint_kernels"), kernels("compiled", "frames_back_kernels")
    if loops and of_bodies:
        of_rows, of_surfaces = rows and loops.back_of(*rows), on_surfaces and loops.surfaces_of(*on_surfaces)
        of_frames = frames and of_bodies.frames_of(*frames)
        loops.go_back(bodies, by_q, by_v, h, first, adjoint, of_rows, of_surfaces, of_frames, y)
        return y
    q, u, v, _ = adjoint
    for s in range(len(y) - 1, -1, -1):
        begins = first + s == 0
        v += by_v[s]
        y[s] = 0.5 * h / bodies.mass * (u if begins else u + v)
        if frames is not None:
            q += back_over_inertia(frames, s, y[s], bodies.mass, bodies.stiffness, 0.0 if begins else 0.5 * h)
        q += by_q[s] - bodies.stiffness * y[s]
        along, before = (0.0, 0.0) if rows is None else _back_over_rows(rows, on_surfaces, frames, s, y[s])
        q += along
        v -= bodies.damping * y[s]
        if frames is not None:
            v += frames.u
            if not begins:
                turn_back(frames, s, h, q, v)
        if not begins:
            v += h * q
            u[:] = v
        q -= before
        if frames is not None:
            q += frames.q_then
            v += frames.v_then
        if rows is not None and first + s == 1:  # the first step goes on from the memory of the start
            rows.forces[:], rows.mu_next[:] = 0.0, 0.0
    return y


def _back_over_rows(
    rows: RowsBack, on_surfaces: SurfaceRows | None, frames: FramesBack | None, s: int, y: Array
) -> tuple[Array, Array]:
    """See `rows_back.back_over_rows`; also of rows that follow the motion on rigid surfaces."""
    if on_surfaces is None:
        return back_over_rows(rows, s, y)
    if frames is None:
        ways = on_surfaces.add_pushes(s, y, rows.by_forces[s])
        along, before = back_over_rows(rows, s, y)
        on_surfaces.back(s, ways, rows.slips[s], along)
        return along, before
    on_surfaces.turn(frames, s, y)
    ways = on_surfaces.add_pushes(s, frames.pushed, rows.by_forces[s])
    along, before = back_over_rows(rows, s, y)
    on_surfaces.back(s, ways, rows.slips[s], frames.moved)
    on_surfaces.turn_back(frames, s, ways, rows.slips[s], along)
    return along, before
