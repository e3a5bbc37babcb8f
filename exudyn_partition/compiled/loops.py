"""Explicit steps of a plan: compiled if numba is there, else by NumPy, which is slow.

No other module of `compiled` knows which. Module `kernels` beside it has the compiled loop.
"""

from __future__ import annotations

from functools import cached_property
from types import ModuleType
from typing import Any, Literal, NamedTuple

import numpy as np

from ..algebra.block_complementarity import LIMITS, BlockComplementarity, FlatBlocks
from ..contact.loops import evaluate_frozen, flat_contacts
from ..errors import ComplementarityError
from ..support.arrays import Array
from ..support.compiled import kernels
from .moving import Anchors, MovingPlan
from .plain_moving import PlainMoving
from .plan import Bodies, FrozenPlan, Motion, StepPlan

N_VALUES = 6  # of each contact, see `frozen.FrozenContacts`


class Stop(NamedTuple):
    """Why steps cannot go on.

    Parameters
    ----------
    kind : {"slides", "unstable", "unsettled"}
        Pairs begin to slide, coordinates are not finite, or closed rows do not settle.
    text : str
    """

    kind: Literal["slides", "unstable", "unsettled"]
    text: str


class Samples(NamedTuple):
    """Room for samples. Without rows, `q` and `v`, or `stored` and `lam`, are not kept.

    Parameters
    ----------
    q, v : (n, nq) arrays
    values : (n, nc, 6) array
        Of each contact, see `frozen.FrozenContacts`.
    stored : (n, nc) array
        Energy that each contact stores [J].
    lam : (n, nr) array
        Forces on all rows [N].
    """

    q: Array
    v: Array
    values: Array
    stored: Array
    lam: Array

    @classmethod
    def of(cls, plan: StepPlan, n: int, *, motion: bool, rows: bool) -> Samples:
        """Room for n samples; `motion` and `rows` say whether coordinates and forces on rows are kept."""
        nq, nc, nr = len(plan.bodies.mass), len(plan.contacts.names), len(plan.contacts.rows.start)
        (q, v), kept = np.empty((2, n if motion else 0, nq)), n if rows else 0
        return cls(q, v, np.empty((n, nc, N_VALUES)), np.empty((kept, nc)), np.empty((kept, nr)))


class Peaks(NamedTuple):
    """Largest force of each contact so far.

    Parameters
    ----------
    force : (nc,) array
        [N]
    lam : (nr,) array
        Forces on the rows of each contact then [N].
    q : (nc, nq) array
        Coordinates then.
    """

    force: Array
    lam: Array
    q: Array

    @classmethod
    def of(cls, contacts: FrozenPlan, n: int) -> Peaks:
        """Room for some contacts and n coordinates, without a force."""
        nc = len(contacts.names)
        return cls(np.zeros(nc), np.zeros(len(contacts.rows.start)), np.zeros((nc, n)))


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
    def of(cls, plan: FrozenPlan, j: int) -> ContactParts:
        """Parts of contact j."""
        flat = plan.rows
        rows, dofs = slice(*flat.starts[j : j + 2]), flat.dofs[slice(*flat.places[j : j + 2])]
        start, (n, nr) = flat.drift_start[slice(*flat.drift_starts[j : j + 2])], (len(dofs), len(plan.own[j]))

        def matrix(begin: int, k: int, m: int) -> Array:
            return flat.numbers[begin:][: k * m].reshape(k, m)

        H, normals = matrix(flat.H[j], n, nr), matrix(flat.normals[j], nr, 3)
        return cls(rows, dofs, H, normals, matrix(flat.drift[j], len(start), n), start, float(flat.reach[j]))

    def slide(self, q: Array) -> bool:
        """Whether pairs slide at coordinates q, (nq,)."""
        return bool(not abs(self.drift @ q[self.dofs] - self.drift_start).max(initial=0.0) <= self.reach)


def _moving_kernels() -> ModuleType:
    found = kernels("compiled", "moving_kernels")
    assert found is not None
    return found


class MovingSteps:
    """Bodies in floating frames and moving contacts in a run.

    Parameters
    ----------
    plan : MovingPlan
    blocks : FlatBlocks
        Of the run.
    n : int
        Number of coordinates.

    Attributes
    ----------
    step : float
        Length of the last step [s].
    """

    def __init__(self, plan: MovingPlan, blocks: FlatBlocks, n: int) -> None:
        self.plan, self.step, self._blocks = plan, 0.0, blocks
        self._state = plan.state(int(blocks.starts[-1]), n)

    @cached_property
    def for_loops(self) -> tuple[Any, Any, Any]:
        """Bodies, contacts and state as compiled loops take them."""
        kernel, plan = _moving_kernels(), self.plan
        return kernel.flat_frames(plan.frames), kernel.flat_surfaces(plan.surfaces), kernel.flat_state(self._state)

    @cached_property
    def plain(self) -> PlainMoving:
        """The same by NumPy."""
        return PlainMoving(self.plan, self._state, self._blocks)

    def begin(self, anchors: Anchors | None) -> None:
        """Begin a run with anchors; without any, contacts have none."""
        state, self.step = self._state, 0.0
        state.anchored[:], state.found[:], state.added[:] = False, False, -1.0
        self._blocks.n_closed[:] = -1
        if anchors is not None:
            state.anchored[:], state.anchors[:], state.along[:] = anchors.anchored, anchors.q, anchors.along

    def anchors(self) -> Anchors:
        """Present anchors."""
        state = self._state
        return Anchors(state.anchored.copy(), state.anchors.copy(), state.along.copy())


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
    stored : (nc,) array
        Energy that each contact stores [J].
    iterations : int
        Of the closed rows of all contacts since the start.
    """

    _plan: StepPlan
    _joint: BlockComplementarity | None

    def __init__(self, contacts: FrozenPlan, n: int) -> None:
        self.contacts, self._kernels, count = contacts, kernels("compiled"), len(contacts.names)
        self.motion, self.peaks, self._blocks = Motion.of(n), Peaks.of(contacts, n), contacts.fresh_blocks()
        self._h, self.stored = np.zeros(len(contacts.rows.start)), np.zeros(count)
        self._values = np.zeros((count, N_VALUES))
        self._parts = [ContactParts.of(contacts, j) for j in range(count)]
        self._moving = None if contacts.moving is None else MovingSteps(contacts.moving, self._blocks, n)
        self._flat: Any = None
        if self._kernels:
            self._flat = flat_contacts(contacts.rows, self._blocks, self._h, self._values, self.stored)

    @property
    def iterations(self) -> int:
        """See the class."""
        return int(self._blocks.iterations.sum())

    @property
    def closed(self) -> Array:
        """Whether each contact has closed rows, (nc,) bool."""
        return np.asarray(self._values[:, 1] > 0.0)

    def begin(
        self,
        plan: StepPlan,
        q: Array,
        v: Array,
        a: Array | None = None,
        turning: Array | None = None,
        anchors: Anchors | None = None,
    ) -> Stop | None:
        """Begin a plan at coordinates and velocities, (nq,), with accelerations, (nq,), or those that forces give.

        For the other arguments see `run.Start`. Return what prevents it, see `advance`.
        """
        self._plan, self._joint, m = plan, None, self.motion
        self._blocks.forget()
        self._blocks.iterations[:] = 0
        self.peaks.force[:] = 0.0
        m.q[:], m.v[:] = q, v
        if self._moving:
            self._moving.begin(anchors)
        turning = m.v if turning is None else turning
        if not self._evaluated(turning) and (why := self._find(turning)):
            return why
        if a is None:
            self._accelerate(0.0)
        else:
            m.a[:] = a
        self._watch()
        return None

    def _evaluated(self, turning: Array) -> bool:
        """Find the forces at the present coordinates by compiled loops; return whether that was done.

        `turning`, (nq,), are velocities by which bodies in floating frames grow.
        """
        if self._kernels is None:
            return False
        if self._moving is None:
            return evaluate_frozen(self._flat, self.motion.q, self.motion.force) >= 0
        moving, m = self._moving, self.motion
        where = *moving.for_loops, m.q, turning, m.force
        return int(_moving_kernels().evaluate_moving(self._flat, *where, LIMITS, moving.plan.bounds)) >= 0

    def moving_state(self) -> tuple[Array | None, Anchors | None]:
        """Velocities by which bodies in floating frames grow now, and anchors, see `run.Start`."""
        if self._moving is None:
            return None, None
        m = self.motion
        return m.v - 0.5 * self._moving.step * m.a, self._moving.anchors()

    def state(self) -> tuple[Array, Array, Array]:
        """Present coordinates, velocities and accelerations, (nq,) each."""
        m = self.motion
        return m.q.copy(), m.v.copy(), m.a.copy()

    def go_back(self, state: tuple[Array, Array, Array], anchors: Anchors | None = None) -> None:
        """Go back to an earlier state of this run, with the anchors of `moving_state` there."""
        m = self.motion
        m.q[:], m.v[:], m.a[:] = state
        if self._moving:
            self._moving.begin(anchors)

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
        if self._moving:
            self._moving.step = h
        while first <= count:
            if self._kernels:
                first = self._advanced(h, first, count, between, samples)
                if first > count:
                    break
            else:
                m.q_start[:], m.v_start[:] = m.q, m.v
                m.v[:] += 0.5 * h * m.a
                m.q[:] += h * m.v
                if self._moving:
                    self._moving.plain.turn_on(m, h)
            if why := self._find(m.v):  # compiled loops give up where closed rows do not settle soon
                m.q[:], m.v[:] = m.q_start, m.v_start
                return first - 1, why
            self._accelerate(0.5 * h)
            m.v[:] += 0.5 * h * m.a
            self._watch()
            if not first % between:
                self.keep(samples, first // between - 1)
            first += 1
        return count, None

    def _advanced(self, h: float, first: int, count: int, between: int, samples: Samples) -> int:
        """Make steps by compiled loops; return the first that they have not made."""
        bodies, m, steps = self._plan.bodies, self.motion, (h, first, count, between)
        if self._moving is None:
            assert self._kernels is not None
            return int(self._kernels.advance(bodies, self._flat, m, samples, self.peaks, LIMITS, *steps))
        moving = self._moving
        results = m, samples, self.peaks, LIMITS, moving.plan.bounds
        return int(_moving_kernels().advance_moving(bodies, self._flat, *moving.for_loops, *results, *steps))

    def _find(self, turning: Array) -> Stop | None:
        """Find the forces at the present coordinates by NumPy, see `_evaluated`; return what prevents it."""
        m, plan, blocks = self.motion, self.contacts, self._blocks
        if not np.isfinite(m.q).all():
            return Stop("unstable", "the gaps are not finite: the run has become unstable")
        for name, part in zip(plan.names, self._parts, strict=True):
            if part.slide(m.q):
                return Stop("slides", f"pairs of contact {name!r} begin to slide, which compiled steps do not follow")
            self._h[part.rows] = plan.rows.start[part.rows] + m.q[part.dofs] @ part.H
        self._joint = self._joint or plan.joint()
        try:
            if self._moving:
                self._moving.plain.gaps(m.q, turning, self._h)
                lam, pushed = self._moving.plain.settle(m.q, self._h, self._joint, plan)
                iterations = np.zeros(len(plan.names), dtype=np.int64)
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
            self._values[j] = [push.sum(), np.count_nonzero(push), *(push @ part.normals), gap.min(initial=np.inf)]
            self.stored[j] = -0.5 * push @ self._h[part.rows]
        if self._moving:
            self._moving.plain.push(m.q, lam, m.force, self._values)
        return None

    def _accelerate(self, half_step: float) -> None:
        """Set accelerations from coordinates, velocities half a step [s] before, and contact forces."""
        m, bodies = self.motion, self._plan.bodies
        if self._moving and self._kernels:
            _moving_kernels().accelerate_moving(bodies, self._moving.for_loops[0], m, half_step)
            return
        if self._moving:
            self._moving.plain.inertia(bodies, m, half_step)
        m.a[:] = (m.force + bodies.load - (bodies.stiffness * m.q + bodies.damping * m.v)) / bodies.mass
        if self._moving:
            self._moving.plain.turn_accelerations(bodies, m)

    def _watch(self) -> None:
        """Keep the largest force of each contact."""
        for j, part in enumerate(self._parts):
            if self._values[j, 0] > self.peaks.force[j]:
                self.peaks.force[j], self.peaks.q[j] = self._values[j, 0], self.motion.q
                self.peaks.lam[part.rows] = self._blocks.lam[part.rows]

    def keep(self, samples: Samples, place: int) -> None:
        """Write the present state to a place of samples."""
        if len(samples.q):
            samples.q[place], samples.v[place] = self.motion.q, self.motion.v
        samples.values[place] = self._values
        if len(samples.stored):
            samples.stored[place], samples.lam[place] = self.stored, self._blocks.lam


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
    problems, gaps = [problem.fresh() for problem in plan.problems], dict(enumerate(np.split(h, ends)))
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
    q, u, v : (nq, k) arrays
        Of coordinates, of velocities in the middle of the step after the sample, and of velocities.
    """

    q: Array
    u: Array
    v: Array


def go_back(
    bodies: Bodies, by_rows: Array, by_q: Array, by_v: Array, h: float, starts: bool, adjoint: Adjoint
) -> Array:
    """Go back over the m samples of a block in which the same rows are closed.

    Parameters
    ----------
    bodies : Bodies
    by_rows : (nq, nq) array
        Stiffness of the closed rows; (0, nq) without such rows.
    by_q, by_v : (m, nq, k) arrays
        Derivatives of the numbers by coordinates and velocities at the samples.
    h : float
        Step [s].
    starts : bool
        Whether the first sample of the block is that of the start.
    adjoint : Adjoint

    Returns
    -------
    (m, nq, k) array
        Adjoint of the accelerations over the masses, at all samples.
    """
    y = np.empty_like(by_q)
    if loops := kernels("compiled"):
        loops.go_back(bodies, by_rows, by_q, by_v, h, starts, adjoint, y)
        return y
    share, stiffness, damping = 0.5 * h / bodies.mass[:, None], bodies.stiffness[:, None], bodies.damping[:, None]
    q, u, v = adjoint
    for s in range(len(y) - 1, -1, -1):
        begins = starts and s == 0
        v += by_v[s]
        y[s] = share * (u if begins else u + v)
        q += by_q[s] - stiffness * y[s]
        if len(by_rows):
            q -= by_rows @ y[s]
        v -= damping * y[s]
        if not begins:
            v += h * q
            u[:] = v
    return y
