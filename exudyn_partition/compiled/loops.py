"""Explicit steps of a plan: compiled if numba is there, else by NumPy, which is slow.

No other module of `compiled` knows which. Module `kernels` beside it has the compiled loop.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..algebra.block_complementarity import LIMITS
from ..contact.loops import flat_contacts
from ..errors import ComplementarityError
from ..support.arrays import Array
from ..support.compiled import kernels
from .plan import GroupPlan, StepPlan

N_VALUES = 6  # of each contact, see `frozen.FrozenContacts`
UNSTABLE = "the gaps are not finite: the run has become unstable"


class Motion(NamedTuple):
    """State of a run within a step; the loop writes to its arrays.

    Parameters
    ----------
    q, v, a : (nq,) arrays
        Coordinates, velocities and accelerations.
    q_start, v_start : (nq,) arrays
        Coordinates and velocities at the start of the step.
    force, part : (nq,) arrays
        Generalised forces of all contacts, and of one group.
    """

    q: Array
    v: Array
    a: Array
    q_start: Array
    v_start: Array
    force: Array
    part: Array

    @classmethod
    def of(cls, n: int) -> Motion:
        """Room for n coordinates."""
        return cls(*np.zeros((7, n)))


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
        nq, nc = len(plan.mass), len(plan.names)
        q, v = np.empty((2, n if motion else 0, nq))
        kept = n if rows else 0
        return cls(q, v, np.empty((n, nc, N_VALUES)), np.empty((kept, nc)), np.empty((kept, plan.n_rows)))


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
    def of(cls, plan: StepPlan) -> Peaks:
        """Room for a plan's contacts, without a force."""
        nc = len(plan.names)
        return cls(np.zeros(nc), np.zeros(plan.n_rows), np.zeros((nc, len(plan.mass))))


class Group:
    """Room in which a group's forces are found.

    Parameters
    ----------
    plan : GroupPlan

    Attributes
    ----------
    blocks : FlatBlocks
    values : (n, 6) array
        See `frozen.FrozenContacts`.
    stored : (n,) array
        Energy that each contact stores [J].
    """

    def __init__(self, plan: GroupPlan) -> None:
        self.plan, self.blocks = plan, plan.fresh_blocks()
        n = len(plan.names)
        self.h, self.values, self.stored = np.zeros(len(self.blocks.lam)), np.zeros((n, N_VALUES)), np.zeros(n)

    def forget(self) -> None:
        """Begin without a guess of the closed rows."""
        self.blocks.forget()
        self.blocks.iterations[:] = 0

    def _slides(self, q: Array) -> int | None:
        """Number of the first contact whose pairs slide at coordinates q, (nq,); None if none do."""
        rows = self.plan.rows
        for j, (dofs, drift, start) in enumerate(self._drifts):
            if not abs(drift @ q[dofs] - start).max(initial=0.0) <= rows.reach[j]:
                return j
        return None

    @property
    def _drifts(self) -> list[tuple[Array, Array, Array]]:
        """Coordinates of each contact, (n,), how its pairs slide, (k, n), and where they begin, (k,)."""
        rows, found = self.plan.rows, []
        for j in range(len(self.plan.names)):
            dofs = rows.dofs[rows.places[j] : rows.places[j + 1]]
            start = rows.drift_start[rows.drift_starts[j] : rows.drift_starts[j + 1]]
            drift = rows.numbers[rows.drift[j] :][: len(start) * len(dofs)].reshape(len(start), len(dofs))
            found.append((dofs, drift, start))
        return found

    @property
    def _rows(self) -> list[tuple[slice, Array, Array, Array]]:
        """Rows of each contact, its coordinates, (n,), H', (n, nr), and normals, (nr, 3)."""
        rows, found = self.plan.rows, []
        for j in range(len(self.plan.names)):
            part, dofs = slice(rows.starts[j], rows.starts[j + 1]), rows.dofs[rows.places[j] : rows.places[j + 1]]
            n, nr = len(dofs), part.stop - part.start
            H = rows.numbers[rows.H[j] :][: n * nr].reshape(n, nr)
            normals = rows.numbers[rows.normals[j] :][: 3 * nr].reshape(nr, 3)
            found.append((part, dofs, H, normals))
        return found

    def find(self, q: Array, force: Array) -> str:
        """Find the forces at coordinates q, (nq,), by NumPy, and add them to `force`, (nq,); return what prevents it."""
        if not np.isfinite(q).all():
            return UNSTABLE
        if (slides := self._slides(q)) is not None:
            return f"pairs of contact {self.plan.names[slides]!r} begin to slide, which compiled steps do not follow"
        rows, parts, blocks = self.plan.rows, self._rows, self.blocks
        for part, dofs, H, _ in parts:
            self.h[part] = rows.start[part] + q[dofs] @ H
        try:
            lam, pushed, iterations = forces_of(self.plan, self.h, blocks.active)
        except ComplementarityError as error:
            return str(error)
        blocks.lam[:], blocks.pushed[:], blocks.active[:] = lam, pushed, lam > 0.0
        blocks.n_closed[:] = -1
        blocks.iterations[:] += iterations
        for j, (part, dofs, H, normals) in enumerate(parts):
            push = lam[part]
            force[dofs] += H @ push
            self.values[j] = [push.sum(), np.count_nonzero(push), *(push @ normals), pushed[part].min(initial=np.inf)]
            self.stored[j] = -0.5 * push @ self.h[part]
        return ""


def forces_of(plan: GroupPlan, h: Array, active: Array) -> tuple[Array, Array, Array]:
    """Forces on all rows of a group, (nr,) [N], for gaps h, (nr,) [m], and a guess of the closed rows, (nr,) bool.

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
    problems = [problem.fresh() for problem in plan.problems]
    for problem, guess in zip(problems, np.split(active, ends), strict=True):
        problem.set_active(guess)
    parts = dict(enumerate(np.split(h, ends)))
    if n == 1:
        lam = [problems[0].solve(parts[0])]
        pushed = h.copy()
    else:
        found = plan.joint.solve(dict(enumerate(problems)), parts, dict(enumerate(plan.fields)))
        lam, pushed = [found[j] for j in range(n)], np.concatenate([plan.joint.pushed[j] for j in range(n)])
    return np.concatenate(lam), pushed, np.array([problem.iterations for problem in problems])


class Stepper:
    """Explicit steps of a plan, as Exudyn's VelocityVerlet makes them.

    Damping forces belong to the velocities in the middle of a step::

        v' = v + h a / 2,    q = q + h v',    a = M^-1 (f(q) + load - K q - D v'),    v = v' + h a / 2.

    Parameters
    ----------
    plan : StepPlan

    Attributes
    ----------
    motion : Motion
    peaks : Peaks
    groups : list of Group
    """

    def __init__(self, plan: StepPlan) -> None:
        self.plan, self.groups = plan, [Group(group) for group in plan.groups]
        self.motion, self.peaks, self._kernels = Motion.of(len(plan.mass)), Peaks.of(plan), kernels("compiled")
        self._flat: tuple[Any, ...] = ()
        if self._kernels:
            parts = ((g, (g.h, g.values, g.stored)) for g in self.groups)
            self._flat = tuple(flat_contacts(g.plan.rows, g.blocks, *results) for g, results in parts)

    def begin(self, q: Array, v: Array, a: Array | None = None) -> str:
        """Begin at coordinates and velocities, (nq,), with accelerations, (nq,); by default those that forces give.

        Return what prevents it, see `advance`.
        """
        m = self.motion
        for group in self.groups:
            group.forget()
        self.peaks.force[:] = 0.0
        m.q[:], m.v[:] = q, v
        if not (self._kernels and self._kernels.push(self._flat, m.q, m.force, m.part, LIMITS) < 0):
            if stopped := self._find():
                return stopped
        if a is None:
            _accelerate(self.plan, m)
        else:
            m.a[:] = a
        return ""

    def advance(self, h: float, count: int, between: int, samples: Samples) -> tuple[int, str]:
        """Make steps of length h [s].

        Parameters
        ----------
        h : float
        count : int
            Number of steps.
        between : int
            Steps from one sample to the next; the first sample is after so many.
        samples : Samples

        Returns
        -------
        Number of steps made, and what stopped them; empty if nothing did. Then the motion is at the start of a step.
        """
        made, m = 0, self.motion
        while made < count:
            before = made
            if self._kernels and not made % between:
                left = Samples(*(part[made // between :] for part in samples))
                more, failed = self._kernels.advance(
                    self.plan.flat, self._flat, m, left, self.peaks, LIMITS, h, count - made, between
                )
                made += more
                if failed < 0:
                    break
            else:
                _drift(m, h)
            stopped = self._finish(h)  # compiled loops give up where closed rows do not settle soon
            if stopped:
                return made, stopped
            made += 1
            if not made % between:
                self.keep(samples, made // between - 1)
            assert made > before
        return made, ""

    def _finish(self, h: float) -> str:
        """Finish a step whose coordinates have moved, by NumPy; return what prevents it."""
        m = self.motion
        if stopped := self._find():
            m.q[:], m.v[:] = m.q_start, m.v_start
            return stopped
        _accelerate(self.plan, m)
        m.v[:] += 0.5 * h * m.a
        self._watch()
        return ""

    def _find(self) -> str:
        """Find the forces at the present coordinates by NumPy; return what prevents it."""
        m = self.motion
        m.force[:] = 0.0
        return next(filter(None, (group.find(m.q, m.force) for group in self.groups)), "")

    def _watch(self) -> None:
        """Keep the largest force of each contact."""
        contact = row = 0
        for group in self.groups:
            starts = group.blocks.starts
            for j, force in enumerate(group.values[:, 0]):
                if force > self.peaks.force[contact]:
                    self.peaks.force[contact], self.peaks.q[contact] = force, self.motion.q
                    part = slice(starts[j], starts[j + 1])
                    self.peaks.lam[row + part.start : row + part.stop] = group.blocks.lam[part]
                contact += 1
            row += len(group.blocks.lam)

    def keep(self, samples: Samples, place: int) -> None:
        """Write the present state to a place of samples."""
        if len(samples.q):
            samples.q[place], samples.v[place] = self.motion.q, self.motion.v
        samples.values[place] = np.concatenate([group.values for group in self.groups])
        if len(samples.stored):
            samples.stored[place] = np.concatenate([group.stored for group in self.groups])
            samples.lam[place] = np.concatenate([group.blocks.lam for group in self.groups])


def _drift(m: Motion, h: float) -> None:
    """Move coordinates to the end of a step, and velocities to its middle."""
    m.q_start[:], m.v_start[:] = m.q, m.v
    m.v[:] += 0.5 * h * m.a
    m.q[:] += h * m.v


def _accelerate(plan: StepPlan, m: Motion) -> None:
    """Set accelerations from coordinates, velocities and contact forces."""
    m.a[:] = (m.force + plan.load - plan.stiffness @ m.q - plan.damping @ m.v) / plan.mass

