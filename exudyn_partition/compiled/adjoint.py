"""Derivatives of a number that follows from a run, by the discrete adjoint of the very steps that were made.

One pass backwards gives the derivatives by start, masses, stiffnesses, damping, loads and flexibilities, however many
these are. Forces of contacts by compliance are Lipschitz in the coordinates, so that no jump conditions are needed.
Where a row is at the edge of another status in a step, derivatives are one-sided: without force and gap, or, with
friction, with all the force that it bears without slip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from ..support.arrays import Array
from .loops import Adjoint, go_back
from .made_run import MadeRun, OnFriction, Part, Window, columns
from .plan import Bodies
from .rows_back import RowsBack


class Weights(Protocol):
    """Derivatives of k numbers by what a run with n samples has kept."""

    @property
    def friction(self) -> OnFriction | None:
        """By what friction did, the same for all numbers."""

    @property
    def lam(self) -> sp.csr_matrix:
        """By forces on rows, (n, nr) [1/N], the same for all numbers."""

    @property
    def turning(self) -> Array | None:
        """By the velocities by which bodies in floating frames grow, (n, nq), the same for all numbers."""

    @property
    def count(self) -> int:
        """Number of numbers, k."""

    def of_block(self, block: slice) -> tuple[Array, Array]:
        """By coordinates and velocities at m samples, new arrays, (m, k, nq) each."""


@dataclass(frozen=True, eq=False)
class OneNumber:
    """Derivatives of one number, see `Weights`.

    Parameters
    ----------
    lam : (n, nr) csr matrix
    q : (n, nq) array
        By coordinates.
    v_end : (nq,) array
        By velocities at the end.
    friction : OnFriction, optional
    turning : (n, nq) array, optional
        By the velocities by which bodies in floating frames grow, see `FramesMotion`.
    """

    lam: sp.csr_matrix
    q: Array
    v_end: Array
    friction: OnFriction | None = None
    turning: Array | None = None

    count = 1

    def of_block(self, block: slice) -> tuple[Array, Array]:
        """See `Weights.of_block`."""
        by_q, n = self.q[block][:, None].copy(), len(self.q)
        by_v = np.zeros_like(by_q)
        if block.stop == n:
            by_v[-1, 0] = self.v_end
        return by_q, by_v


@dataclass(frozen=True, eq=False)
class Sums:
    """Derivatives of k sums over samples of one value, which follows from coordinates and velocities, see `Weights`.

    Parameters
    ----------
    lam : (n, nr) csr matrix
        Zero.
    samples : (n, k) array
        Weight of the value at each sample in each sum.
    q, v : (n, nq) arrays
        The value by coordinates and velocities at each sample.
    """

    lam: sp.csr_matrix
    samples: Array
    q: Array
    v: Array

    friction = turning = None

    @property
    def count(self) -> int:
        """See `Weights.count`."""
        return int(self.samples.shape[1])

    def of_block(self, block: slice) -> tuple[Array, Array]:
        """See `Weights.of_block`."""
        of_samples = self.samples[block][:, :, None]
        return of_samples * self.q[block][:, None], of_samples * self.v[block][:, None]


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of k numbers by a plan and its start.

    Parameters
    ----------
    q, v : (k, nq) arrays
        By coordinates and velocities at the start.
    bodies : Bodies
        By masses, stiffnesses, damping and loads, (k, nq) each.
    flexibility : (m, k) array
        By factors of m parts of the flexibility.
    friction : (nf, 3, k) array
        By static and kinetic coefficient and decay of each contact with friction, or of those that it moves.
    """

    q: Array
    v: Array
    bodies: Bodies
    flexibility: Array
    friction: Array


def backwards(run: MadeRun, weights: Weights, parts: Sequence[Part]) -> Derivatives:
    """Go back from the end of a run to its start.

    A step is u = v + h a / 2, q = q + h u, a = (f(q) + load - K q - D u) / M, v = u + h a / 2. With adjoints q', u',
    v', a' and y = a' / M, it gives back: K and D times -y, forces lambda' = H y + their weights. On closed rows
    F lambda = -h, so that h' = -F^-1 lambda'. Module `rows_back` has this, and what friction adds.

    Parameters
    ----------
    run : MadeRun
    weights : Weights
    parts : sequence of Part
        Of the flexibility.
    """
    h, made, k = run.steps.step, run.histories, weights.count
    middle = np.vstack([made.v[:1], made.v[1:] - 0.5 * h * made.a[1:]])
    adjoint, sums = Adjoint(*np.zeros((4, k, made.q.shape[1]))), Bodies(*np.zeros((4, k, made.q.shape[1])))
    of_rows = _RowsBackwards(run, weights, parts)
    for block in run.blocks(k):
        by_q, by_v = weights.of_block(block)
        window, rows = of_rows.begin(block)
        on_surfaces = None if rows is None else run.on_surfaces(window)
        frames = run.frames(block, weights.turning, adjoint.a)
        y = go_back(run.plan.bodies, by_q, by_v, h, block.start, adjoint, rows, on_surfaces, frames)
        of_rows.end(window, rows)
        if block.start in run.surfaces.edges:
            adjoint.add(*of_rows.by_anchors(block.start), begins=block.start == 0)
        new = [-np.einsum("ski,si->ki", y, motion[block]) for motion in (made.a, made.q, middle)]
        sums = Bodies(*(part + more for part, more in zip(sums, [*new, y.sum(axis=0)], strict=True)))
    adjoint.add(*of_rows.by_anchors(-1), begins=True)
    return Derivatives(adjoint.q, adjoint.v, sums, of_rows.flexibility, of_rows.by_law)


class _RowsBackwards:
    """Rows of contacts in a pass back, see `backwards`.

    Attributes
    ----------
    by_law : (nf, 3, k) array
    flexibility : (m, k) array
        See `Derivatives`.
    """

    def __init__(self, run: MadeRun, weights: Weights, parts: Sequence[Part]) -> None:
        self._run, self._weights, self._parts, k = run, weights, parts, weights.count
        self._later = np.zeros((k, run.B.shape[0])), np.zeros((k, len(run.normals) - run.plain))
        self.by_law = np.zeros((len(run.laws), 3, k))
        self.flexibility = np.zeros((len(parts), k))
        self._by_normals: list[Array | None] = [None] * len(run.surfaces.surfaces)

    def begin(self, block: slice) -> tuple[Window, RowsBack | None]:
        """What rows did in a block, and what the pass back over it needs; None if no row is closed."""
        w = self._run.window(block)
        return w, self._run.back(w, self._given(w), *self._later) if w.ways.any() else None

    def _given(self, w: Window) -> tuple[Array, Array]:
        """Weights by forces and slips of the rows of a window, (m, k, d) each."""
        forces, slips = np.zeros((2, len(w.ways), self._weights.count, len(w.directions)))
        lam = columns(self._weights.lam, w.samples, w.rows)[:, None]
        forces[:, :, : w.plain], w.of_rough(forces)[..., 0] = lam[:, :, : w.plain], lam[:, :, w.plain :]
        if self._weights.friction is not None:
            by_forces, by_slips = (part[:, None] for part in w.weights(self._weights.friction))
            w.of_rough(forces)[..., 1:], w.of_rough(slips)[..., 1:] = by_forces, by_slips
        return forces, slips

    def end(self, w: Window, back: RowsBack | None) -> None:
        """Take what the pass back over a block has found."""
        self._later = np.zeros_like(self._later[0]), np.zeros_like(self._later[1])
        if back is None:
            return
        self.by_law += self._run.by_law(w, back.by_mu)
        self.flexibility += self._run.by_parts(w, back.slips, back.F, self._parts)
        self._take_normals(w, back.slips)
        self._later[0][:, w.directions], self._later[1][:, w.rough] = back.forces, back.mu_next

    def _take_normals(self, w: Window, slips: Array) -> None:
        """Take derivatives by the normals on which the flexibility of rows on curved surfaces depends."""
        surfaces = self._run.surfaces
        for s, one in enumerate(surfaces.surfaces):
            if one.directed:
                new = surfaces.by_normals(s, w.samples.start, w.directions, slips, w.forces)
                before = self._by_normals[s]
                self._by_normals[s] = new if before is None else before + new

    def by_anchors(self, sample: int) -> tuple[Array, Array]:
        """Derivatives by a sample in which anchors were found, -1 is the start: of its coordinates and its velocities.

        They are (k, nq) each, and those of the sample before, as `Adjoint` has them after the sample.
        """
        surfaces, motion, there = self._run.surfaces, self._run.motion, max(sample, 0)
        by_q, by_v = np.zeros((2, self._weights.count, self._run.histories.q.shape[1]))
        for s, (one, by_normals) in enumerate(zip(surfaces.surfaces, self._by_normals, strict=True)):
            if by_normals is not None and surfaces.anchors[s, there] == sample:
                of_q, of_turning = one.by_anchor(there, by_normals)
                by_q, by_v = by_q + of_q, by_v + of_turning
                self._by_normals[s] = None
        if there == 0 or motion is None:
            return by_q, by_v
        before, of_step = motion.gone_back(there, by_q, self._run.steps.step)
        return before, by_v + of_step
