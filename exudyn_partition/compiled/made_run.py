"""A run that was made, as the pass back over its samples takes it: what its rows of contacts did.

A step leaves the forces of rows with friction and how far these have slipped to the next one: ways along the tangents
are w = T (q - q_before) + F (lambda - lambda_before). If the coefficient falls, the speed of slip goes there too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ..algebra.complementarity import REGULARISATION
from ..algebra.coulomb import Coulomb, coefficients
from ..algebra.friction import OPEN, SLIP
from ..support.arrays import Array
from .frames_back import FramesBack, FramesMotion
from .friction_plan import FrictionMemory, FrictionPlan
from .loops import ContactParts
from .plan import FrozenPlan, StepPlan
from .rows_back import SLIPS, STICKS, RowsBack
from .run import EqualSteps, Histories
from .surfaces_back import SurfaceRows, SurfacesBack

_MOST = 1000  # samples that are gone back over at a time
_NUMBERS = 1 << 21  # of adjoints and slips that are kept at a time: 16 MB


class OnFriction(NamedTuple):
    """Derivatives of one number by what friction did, beside those by normal forces.

    Parameters
    ----------
    samples : (m,) array
    along : (nf, 2) array
        By tangential forces: a weight of each sample times one of each row and tangent.
    taken : (nf,) bool array
        Rows whose work is the number.
    closed : (m,) bool array
        Samples in which the contact of these rows is closed, with which this work counts.
    """

    samples: Array
    along: Array
    taken: Array
    closed: Array


class Part(NamedTuple):
    """A part of the flexibility.

    Parameters
    ----------
    directions : (e,) int array
        Numbers of the directions of its rows, which are sorted.
    F : (e, e) array
        [m/N]; zero for rows that follow the motion on rigid surfaces, whose flexibility is that of their body alone.
    """

    directions: Array
    F: Array


class Window(NamedTuple):
    """What rows did in m samples: n rows that are closed there, or just before or after, the last nf with tangents.

    Parameters
    ----------
    samples : slice
    rows, rough : (n,), (nf,) int arrays
        Numbers among all rows, and among those with tangents.
    directions : (d,) int array
        Numbers of the directions of these rows.
    ways : (m, n) int8 array
        See `RowsBack`.
    forces : (m, d) array
        [N]
    before : (m, 3 nf) array
        Forces of the step before on rows with tangents [N].
    slips, after : (m, nf, 2) arrays
        How far rows slip in the step, and in the step after [m].
    slipped, speed, mu : (m, nf) arrays
        Whether they slipped in the step before, how fast [m/s], and their coefficients.
    """

    samples: slice
    rows: Array
    rough: Array
    directions: Array
    ways: Array
    forces: Array
    before: Array
    slips: Array
    after: Array
    slipped: Array
    speed: Array
    mu: Array

    @property
    def plain(self) -> int:
        """Number of rows without tangents."""
        return len(self.rows) - len(self.rough)

    @property
    def normals(self) -> Array:
        """Places of the normals among the directions, (n,)."""
        places: Array = np.r_[: self.plain, self.plain : len(self.directions) : 3]
        return places

    def of_rough(self, values: Array) -> Array:
        """Values by direction, (..., d), of rows with tangents: (..., nf, 3), a view."""
        parts: Array = values[..., self.plain :].reshape(*values.shape[:-1], len(self.rough), 3)
        return parts

    def weights(self, of: OnFriction) -> tuple[Array, Array]:
        """Derivatives of a number by tangential forces and slips, (m, nf, 2) each.

        The work of friction is -w (lambda_before + lambda) / 2 in each step at whose end the contact is closed.
        """
        m, last = len(self.slips), len(of.samples)
        numbers = np.arange(self.samples.start, self.samples.start + m)
        forces = (of.samples[numbers, None] * (self.ways[:, self.plain :] > 0))[:, :, None] * of.along[self.rough]
        halves = -0.5 * of.taken[self.rough][:, None]
        now, then = (
            ((0 < some) & (some < last) & of.closed[np.minimum(some, last - 1)])[:, None, None] * halves
            for some in (numbers, numbers + 1)
        )
        forces += now * self.slips + (numbers > 0)[:, None, None] * then * self.after  # the first step has no forces
        return forces, now * (self.before + self.forces[:, self.plain :]).reshape(m, len(self.rough), 3)[:, :, 1:]


@dataclass(frozen=True, eq=False)
class MadeRun:
    """What was run, and what came of it.

    Normals of rows without tangents are the first directions. Rows of contacts with friction, and of those that they
    move, follow with their normals and tangents, one row after the other.

    Parameters
    ----------
    plan : StepPlan
    steps : EqualSteps
        With a sample after each step.
    histories : Histories
        With coordinates and forces on rows, of a run that no earlier one went ahead of.
    memory : FrictionMemory, optional
        With which rows with friction began; its forces are those before the first two samples. Default: nothing.
    """

    plan: StepPlan
    steps: EqualSteps
    histories: Histories
    memory: FrictionMemory | None = None

    @property
    def laws(self) -> tuple[Coulomb | None, ...]:
        """Laws of the contacts whose rows have tangents."""
        friction = self.plan.contacts.friction
        return () if friction is None else friction.laws

    @property
    def plain(self) -> int:
        """Number of rows without tangents."""
        return len(self.plan.contacts.rows.start)

    @cached_property
    def normals(self) -> Array:
        """Directions of the normals of all rows, (nr,)."""
        return self._first(np.arange(self.plan.contacts.n_rows))

    @cached_property
    def B(self) -> Array:
        """Derivatives of the gaps and tangential places of all rows by the coordinates, (d, nq)."""
        return _jacobian(self.plan.contacts, self.histories.q.shape[1])

    @cached_property
    def F(self) -> Array:
        """Flexibility of all rows, (d, d) [m/N], that of rows with friction regularised as in the steps."""
        return _flexibility(self.plan.contacts)

    def part(self, contacts: FrozenPlan, some: Sequence[int]) -> Part:
        """Flexibility of some contacts by a plan in which only a part of it yields."""
        starts = self._first(contacts.all_starts)
        numbers = [np.arange(*starts[j : j + 2]) for j in sorted(some)]
        directions = np.concatenate([np.zeros(0, dtype=np.int64), *numbers])
        return Part(directions, _flexibility(contacts)[np.ix_(directions, directions)])

    @cached_property
    def motion(self) -> FramesMotion | None:
        """Bodies in floating frames; None if nothing moves but frozen pairs."""
        moving, made = self.plan.contacts.moving, self.histories
        return None if moving is None else FramesMotion.of(moving.frames, made.q, made.v, made.a, self.steps.step)

    @cached_property
    def surfaces(self) -> SurfacesBack:
        """Contacts with rigid surfaces whose rows follow the motion. B and F have zeros for them."""
        made = self.histories
        return SurfacesBack(self.plan.contacts, self.motion, made.fresh, made.start.anchors)

    def flexibility(self, sample: int, some: Array, others: Array) -> Array:
        """Flexibility between some directions and others in a sample, (na, nb) [m/N]."""
        block: Array = self.F[np.ix_(some, others)]
        self.surfaces.set_flexibility(block, sample, some, others)
        return block

    def smallest_gap(self, j: int, sample: int) -> tuple[float, Array, Array]:
        """Smallest gap of the rows of a contact in a sample [m], and its derivatives, (nq,) each.

        They are those by the coordinates, and by the velocities by which bodies in floating frames grow.
        """
        q, rows = self.histories.q[sample], slice(*self.plan.contacts.all_starts[j : j + 2])
        for surface in self.surfaces.surfaces:
            if surface.contact == j:
                gaps = surface.gaps(np.array([sample]))[0]
                by_q, by_turning = surface.by_gaps(sample, gaps.argmin(keepdims=True))
                return float(gaps.min()), by_q[0], by_turning[0]
        H = self.B[self.normals[rows]]
        gaps = self.gap_starts[rows] + H @ q
        return float(gaps.min()), H[gaps.argmin()], np.zeros(len(q))

    @cached_property
    def gap_starts(self) -> Array:
        """Gaps of all rows at coordinates of zero, (nr,) [m]."""
        contacts = self.plan.contacts
        rows = contacts.rows.start
        return rows if contacts.friction is None else np.concatenate([rows, contacts.friction.rows.start])

    @cached_property
    def forces(self) -> sp.csr_matrix:
        """Forces along all directions, (n, d) [N]."""
        lam, friction = self.histories.lam, self.plan.contacts.friction
        assert lam is not None
        if friction is None:
            return lam
        along = self.histories.traction @ sp.block_diag(friction.tangents.swapaxes(1, 2), format="csr")
        joined, tangents = sp.hstack([lam, along], format="csr"), np.setdiff1d(np.arange(len(self.B)), self.normals)
        places = np.concatenate([self.normals, tangents])
        return sp.csr_matrix((joined.data, places[joined.indices], joined.indptr), joined.shape)

    @property
    def changes(self) -> int:
        """Steps in which rows have closed or opened, have begun to slip, or have ceased to."""
        lam, status = self.histories.lam, self.histories.status
        assert lam is not None
        assert status is not None
        on = np.hstack([lam.toarray() > 0.0, status.toarray() == SLIP])
        return int(np.count_nonzero((on[1:] != on[:-1]).any(axis=1)))

    def blocks(self, k: int) -> list[slice]:
        """Samples in parts that take little memory with k numbers each, the last ones first."""
        on = np.zeros(len(self.B), dtype=bool)
        on[self.forces.indices] = True
        size, n = np.count_nonzero(on) + self.B.shape[1], len(self.histories.q)
        most, blocks = max(min(_MOST, _NUMBERS // (size * k)), 1), list[slice]()
        for first, last in pairwise(np.unique([0, *self.surfaces.edges, n]).tolist()):  # with one flexibility each
            blocks += [slice(begin, min(begin + most, last)) for begin in range(first, last, most)]
        return blocks[::-1]

    def window(self, samples: slice) -> Window:
        """Find what rows did in some samples."""
        made, plain, begins = self.histories, self.plain, samples.start < 2
        assert made.lam is not None
        assert made.status is not None
        some = slice(max(samples.start - 2, 0), min(samples.stop + 1, len(made.q)))
        memory = self.memory or FrictionMemory.none(made.status.shape[1], len(self.laws))
        closed = np.zeros(self.plan.contacts.n_rows, dtype=bool)
        closed[plain:] = begins & (memory.forces[:, 0] > 0.0)
        for part, top in ((made.lam, 0), (made.status, plain)):
            closed[top + part.indices[part.indptr[some.start] : part.indptr[some.stop]]] = True
        rows = np.flatnonzero(closed)
        rough, directions = rows[rows >= plain] - plain, self._directions(rows)
        forces, status = columns(self.forces, some, directions), columns(made.status, some, rough)
        first, nf = len(rows) - len(rough), len(rough)
        now, slipped = forces[:, first:], np.concatenate([status[:1], status[:-1]]) == SLIP
        before = np.concatenate([now[:1], now[:-1]])
        if begins:  # the forces of the start are found, but no step is made
            before[:2], slipped[:2] = memory.forces[rough].ravel(), memory.slipped[rough]
        tangents = directions[first:].reshape(-1, 3)[:, 1:].ravel()
        places = made.q[some] @ self.B[tangents].T
        slips = np.diff(places, axis=0, prepend=places[:1])
        slips += (now - before) @ self.F[np.ix_(directions[first:], tangents)]
        slips = slips.reshape(len(forces), nf, 2) * (np.maximum(now, before)[:, ::3, None] > 0.0)
        speed = np.hypot(*np.moveaxis(slips, 2, 0)) / self.steps.step
        speed = slipped * np.concatenate([speed[:1], speed[:-1]])
        if begins:
            speed[:2] = memory.speed[rough]
        here = slice(samples.start - some.start, samples.stop - some.start)
        after = np.concatenate([slips, np.zeros_like(slips[:1])])[here.start + 1 : here.stop + 1]
        ways, mu = np.array([0, STICKS, SLIPS])[status], np.zeros_like(speed)
        for i, law in enumerate(self._laws(rough)):
            if law is None:
                ways[:, i] = status[:, i] != OPEN
            else:
                mu[:, i] = coefficients(law, slipped[:, i], speed[:, i])
        ways = np.hstack([forces[:, :first] > 0.0, ways]).astype(np.int8)
        return Window(
            samples, rows, rough, directions, ways[here], forces[here], before[here], slips[here], after, slipped[here],
            speed[here], mu[here],
        )  # fmt: skip

    @property
    def margins(self) -> Array:
        """How near a row is to another status (open, sticking, slipping) in each sample, (n,): derivatives end there.

        It is the smallest one over the rows. For a closed row it is its force, for one that slips how much more force
        would make it stick, both as a share of the largest force. For an open row it is its gap, as a share of the
        largest distance by which rows yield.
        """
        of_samples = np.concatenate([self._margins(self.window(block)) for block in reversed(self.blocks(1))])
        smallest: Array = (of_samples[:, :2] / np.maximum(of_samples[:, 2:].max(axis=0), 1e-300)).min(axis=1)
        return smallest

    def _margins(self, w: Window) -> Array:
        """Margins of the samples of a window, (m, 2) [N, m], the largest forces and the largest yielding, (m, 2)."""
        first, push = w.plain, w.forces[:, w.normals]
        off, along = push.copy(), w.of_rough(w.forces)[:, :, 1:]
        slips = self._stiffness(w) * np.hypot(w.slips[:, :, 0], w.slips[:, :, 1])
        sticks = w.mu * push[:, first:] - np.hypot(along[:, :, 0], along[:, :, 1])
        for way, distance in ((STICKS, sticks), (SLIPS, slips)):
            there = w.ways[:, first:] == way
            off[:, first:][there] = np.minimum(distance, push[:, first:])[there]
        moved, q = self.forces[w.samples] @ self.F[:, self.normals], self.histories.q[w.samples]
        gaps = q @ self.B[self.normals].T + self.gap_starts
        if self.surfaces.surfaces:
            moved = w.forces @ self.flexibility(w.samples.start, w.directions, self.normals)
            self.surfaces.set_gaps(gaps, np.arange(w.samples.start, w.samples.stop))
        gaps = abs(gaps + moved)
        gaps[:, w.rows] = np.where(w.ways == 0, gaps[:, w.rows], np.inf)
        closest = np.where(w.ways == 0, np.inf, off).min(axis=1, initial=np.inf), gaps.min(axis=1, initial=np.inf)
        largest = push.max(axis=1, initial=0.0), abs(moved).max(axis=1, initial=0.0)
        return np.column_stack([*closest, *largest])

    def back(self, w: Window, given: tuple[Array, Array], forces: Array, mu_next: Array) -> RowsBack:
        """What the pass back needs of a window.

        Parameters
        ----------
        w : Window
        given : two (m, k, d) arrays
            Derivatives of k numbers by the forces and slips of its rows.
        forces : (k, d) array
            The same by all forces, of what the samples after leave.
        mu_next : (k, nf) array
            By the coefficients of all rows in the sample after.
        """
        first, d, (k, nq) = w.plain, len(w.directions), (len(forces), self.B.shape[1])
        stiffness, laws = self._stiffness(w), self._laws(w.rough)
        push = np.ascontiguousarray(w.forces[:, first::3])
        trial = w.of_rough(w.forces)[:, :, 1:] - stiffness[:, None] * w.slips
        length = np.hypot(trial[:, :, 0], trial[:, :, 1])
        slides = (w.ways[:, first:] == SLIPS) & (length > 0.0)  # nothing moves rows whose trial force is zero
        along, share = np.zeros(trial.shape), np.zeros(length.shape)
        np.divide(trial, length[:, :, None], out=along, where=slides[:, :, None])
        np.divide(w.mu * push, length, out=share, where=slides)
        yielding = np.where(slides, np.maximum(1.0 - share, 0.0) / stiffness, 1.0)
        groups = np.searchsorted(w.rows, _groups(self.plan.contacts))
        numbers, longest = np.repeat(np.arange(len(groups) - 1), np.diff(groups)), -np.count_nonzero(w.ways, axis=0)
        return RowsBack(
            first, w.ways, w.mu, push, along, share, yielding,
            self.flexibility(w.samples.start, w.directions, w.directions), self.B[w.directions], groups,
            np.lexsort((longest, numbers)), given[0], self._by_speed(w, laws), given[1],
            np.zeros((len(push), k, len(w.rough))), np.ascontiguousarray(forces[:, w.directions]),
            np.ascontiguousarray(mu_next[:, w.rough]), np.zeros((k, d)), np.zeros((k, d)), np.zeros(d * d),
            np.zeros(d, dtype=np.int64), np.zeros((d, 3), dtype=np.int64), np.zeros((k, nq)),
        )  # fmt: skip

    def on_surfaces(self, w: Window) -> SurfaceRows | None:
        """Closed rows of a window that follow the motion on rigid surfaces."""
        rows, forces = w.rows[: w.plain], w.forces[:, : w.plain]
        return SurfaceRows.of(self.surfaces, w.samples, rows, forces)

    def frames(self, samples: slice, by_turning: Array | None, a: Array) -> FramesBack | None:
        """Bodies in floating frames in some samples; None if there are none. For the arguments see there."""
        moving = self.plan.contacts.moving
        if self.motion is None or moving is None or not len(moving.frames.rotation):
            return None
        given = np.zeros((samples.stop - samples.start, *a.shape))
        if by_turning is not None:
            given += by_turning[samples, None]
        return FramesBack.of(self.motion, samples, given, a)

    def by_law(self, w: Window, by_mu: Array) -> Array:
        """Derivatives of k numbers by static and kinetic coefficient and decay of each contact, (nc, 3, k).

        `by_mu`, (m, k, nf), are those by the coefficients of the rows of a window.
        """
        by_coefficients = np.zeros((len(self.laws), 3, by_mu.shape[1]))
        contacts = self._frictional_contacts(w.rough)
        for contact, law in enumerate(self.laws):
            if law is None:
                continue
            of_contact = contacts == contact
            slipped, speed = w.slipped[:, of_contact], w.speed[:, of_contact]
            share = np.where(slipped, _share(law, speed), 1.0)
            falls = 0.0 if law.decay is None else _fall(law) * share * speed / law.decay**2 * slipped
            for place, by in enumerate((share, 1.0 - share, falls + 0.0 * share)):
                by_coefficients[contact, place] = np.einsum("ski,si->k", by_mu[:, :, of_contact], by)
        return by_coefficients

    def by_parts(self, w: Window, slips: Array, flexibility: Array, parts: Sequence[Part]) -> Array:
        """Derivatives of k numbers by factors of m parts of the flexibility, (m, k).

        `slips`, (m, k, d), are those by the gaps and slips of the rows of a window, and `flexibility`, (d, d), is
        theirs.
        """
        derivatives, known = np.zeros((len(parts), slips.shape[1])), dict[bytes, Array]()
        for p, (directions, F) in enumerate(parts):
            if not len(directions):
                continue
            places = np.minimum(np.searchsorted(directions, w.directions), len(directions) - 1)
            here = np.flatnonzero(directions[places] == w.directions)
            if not len(here):
                continue
            places = places[here]
            F_here = F[np.ix_(places, places)]
            self.surfaces.copy_flexibility(flexibility, F_here, w.directions, here)
            if (key := here.tobytes()) not in known:
                known[key] = self._by_flexibility(w, slips, here)
            derivatives[p] = np.einsum("kij,ij->k", known[key], F_here)
        return derivatives

    def _by_flexibility(self, w: Window, slips: Array, here: Array) -> Array:
        """Derivatives of k numbers by the flexibility between some directions, (k, d, d); see `by_parts`."""
        if here[-1] - here[0] == len(here) - 1:
            some: Array | slice = slice(int(here[0]), int(here[-1]) + 1)  # a view
        else:
            some = here
        products, rough = _products(slips[:, :, some], w.forces[:, some]), np.flatnonzero(here >= w.plain)
        if len(rough):  # rows yield along the tangents by changes of forces
            tangents = rough[~np.isin(here[rough], w.normals)]
            before = w.before[:, here[rough] - w.plain]
            products[:, tangents[:, None], rough] -= _products(slips[:, :, here[tangents]], before)
        return products

    def _stiffness(self, w: Window) -> Array:
        """By which slips of rows are scaled to forces, (nf,) [N/m]."""
        found: Array = np.mean(1.0 / w.of_rough(self.F.diagonal()[w.directions])[:, 1:], axis=1)
        return found

    def _by_speed(self, w: Window, laws: Sequence[Coulomb | None]) -> Array:
        """Derivative of the next coefficients by how far rows slip, (m, nf, 2) [1/m]."""
        by_slips, h = np.zeros(w.slips.shape), self.steps.step
        for i, law in enumerate(laws):
            if law is not None and law.decay is not None:
                way = np.hypot(w.slips[:, i, 0], w.slips[:, i, 1])
                slope = -_fall(law) * _share(law, way / h) / (law.decay * h)
                slides = w.ways[:, w.plain + i] == SLIPS
                by_slips[:, i] = (slides * slope / np.maximum(way, 1e-300))[:, None] * w.slips[:, i]
        return by_slips

    def _directions(self, rows: Array) -> Array:
        """All directions of some rows, which are sorted."""
        rough = rows[rows >= self.plain]
        found: Array = np.concatenate(
            [rows[: len(rows) - len(rough)], (self._first(rough)[:, None] + np.arange(3)).ravel()]
        )
        return found

    def _first(self, rows: Array) -> Array:
        """First direction of each of some rows."""
        found: Array = np.where(rows < self.plain, rows, 3 * rows - 2 * self.plain)
        return found

    def _frictional_contacts(self, rough: Array) -> Array:
        """Contacts of some rows with tangents, by their place among those."""
        friction = self.plan.contacts.friction
        found: Array = rough if friction is None else np.searchsorted(friction.rows.starts, rough, side="right") - 1
        return found

    def _laws(self, rough: Array) -> list[Coulomb | None]:
        """Laws of some rows with tangents."""
        return [self.laws[contact] for contact in self._frictional_contacts(rough)]


def columns(matrix: sp.csr_matrix, lines: slice, some: Array) -> Array:
    """Some columns of some lines of a sparse matrix, as an array."""
    begin, end = matrix.indptr[lines.start], matrix.indptr[lines.stop]
    dense = np.zeros((lines.stop - lines.start, len(some)), matrix.dtype)
    if begin == end or not len(some):
        return dense
    places = np.full(matrix.shape[1], -1)
    places[some] = np.arange(len(some))
    numbers = np.repeat(np.arange(len(dense)), np.diff(matrix.indptr[lines.start : lines.stop + 1]))
    at = places[matrix.indices[begin:end]]
    there = at >= 0
    dense[numbers[there], at[there]] = matrix.data[begin:end][there]
    return dense


def _products(slips: Array, forces: Array) -> Array:
    """Sums of slips, (m, k, d), times forces, (m, e), over samples: (k, d, e)."""
    m, k, d = slips.shape
    return np.asarray(slips.reshape(m, k * d).T @ forces).reshape(k, d, forces.shape[1])


def _groups(contacts: FrozenPlan) -> Array:
    """First row of each group of contacts whose rows move each other, and the end."""
    joined = {inner for j, k in contacts.core for inner in range(min(j, k) + 1, max(j, k) + 1)}
    first, friction = [j for j in range(len(contacts.names)) if j not in joined], contacts.friction
    starts, end = contacts.rows.starts[first], contacts.rows.starts[-1]
    found: Array = np.append(starts, end if friction is None else end + friction.rows.starts[friction.groups])
    return found


def _flexibility(contacts: FrozenPlan) -> Array:
    """See `MadeRun.F`."""
    starts, n, friction = contacts.rows.starts, len(contacts.rows.start), contacts.friction
    F = np.zeros((n + (0 if friction is None else 3 * friction.n_rows),) * 2)
    for j, of_contact in enumerate(contacts.own):
        rows = slice(*starts[j : j + 2])
        F[rows, rows] = of_contact
    for (j, k), core in contacts.core.items():
        rows, others = (slice(*starts[i : i + 2]) for i in (j, k))
        F[rows, others] += contacts.fields[j] @ core @ contacts.fields[k].T
    if friction is not None:
        F[n:, n:] = _frictional_flexibility(friction)
    return F


def _frictional_flexibility(plan: FrictionPlan) -> Array:
    """Flexibility of all rows with tangents, (3 n, 3 n) [m/N], regularised contact by contact as in the steps."""
    F = np.zeros((3 * plan.n_rows,) * 2)
    for group, block in enumerate(plan.flexibilities):
        own = slice(3 * plan.rows_of(group).start, 3 * plan.rows_of(group).stop)
        F[own, own] = block
    diagonal = F.reshape(-1)[:: len(F) + 1].reshape(-1, 3)
    for j, law in enumerate(plan.laws):
        rows, d = slice(*plan.rows.starts[j : j + 2]), 1 if law is None else 3
        diagonal[rows, :d] += REGULARISATION * diagonal[rows, :d].mean()
    return F


def _jacobian(contacts: FrozenPlan, n: int) -> Array:
    """Derivatives of the gaps and tangential places of all rows by n coordinates, (d, n)."""
    parts, friction = [np.zeros((0, n))], contacts.friction
    for j in range(len(contacts.names)):
        part = ContactParts.of(contacts, j)
        H = np.zeros((part.H.shape[1], n))
        H[:, part.dofs] = part.H.T
        parts.append(H)
    for j in range(0 if friction is None else len(friction.names)):
        assert friction is not None
        part, T = ContactParts.of(friction, j), friction.ways[j]
        B = np.zeros((part.H.shape[1], 3, n))
        B[:, 0, part.dofs], B[:, 1:, part.dofs] = part.H.T, T.reshape(len(B), 2, -1)
        parts.append(B.reshape(-1, n))
    return np.vstack(parts)


def _fall(law: Coulomb) -> float:
    """By how much the coefficient falls at most."""
    return 0.0 if law.kinetic is None else law.static - law.kinetic


def _share(law: Coulomb, speed: Array) -> Array:
    """Share of this fall that is not yet there at some speeds of slip."""
    return np.zeros_like(speed) if law.decay is None else np.exp(-speed / law.decay)
