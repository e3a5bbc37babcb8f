"""Bodies that have fallen tip until they stand: as if rigid, on all that is beneath, not on the first row that touches.

A body on three feet touches with one of them first. On that one alone it has no equilibrium near its place, and
Newton's method would throw it about. So bodies tip and sink until the energy of their weights and of springs on these
motions is least, while no row is deeper than a small distance. The springs are those that hold resting bodies in
statics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..algebra.complementarity import Complementarity, regularised
from ..algebra.products import dense
from ..exudyn_bodies.model import dofs_of
from ..exudyn_bodies.partition_body import PartitionBody, largest_way
from ..exudyn_contacts.partition_contact import PartitionContact
from ..support.arrays import Array
from ..support.foreign import MainSystem

_MOST_TIPS = 20  # gaps are found anew as often as this
_FURTHEST = 0.05  # of a body's size: what tips further than this falls over
_STEP = 1.0  # of a facet: largest motion for which gaps are taken as linear


@dataclass(frozen=True, eq=False)
class _Standing:
    """Motions in which a body may come to stand.

    Parameters
    ----------
    item : PartitionBody
    places : (n,) int array
        Its coordinates among the model's.
    motions : (n, 3) array
        A motion along its gravity, and turns about two axes across that; each with a kinetic energy of one half.
    pushed : (3,) array
        Its weight along these motions.
    """

    item: PartitionBody
    places: Array
    motions: Array
    pushed: Array

    @classmethod
    def of(cls, mbs: MainSystem, item: PartitionBody, way: Array) -> _Standing:
        """A body whose coordinates change by `way`, (n,), along its gravity."""
        kinematics = item.kinematics
        rigid = np.column_stack([kinematics.rigid_part(unit) for unit in np.eye(len(way))])
        rigid = np.linalg.qr(rigid)[0][:, :6] if len(way) > 6 else rigid
        rest = np.zeros(len(way))
        moments = [
            np.concatenate([kinematics.momentum(motion), kinematics.angular_momentum(rest, motion, np.zeros(3))])
            for motion in rigid.T
        ]
        down = kinematics.momentum(way)
        across = np.linalg.svd(down[None, :])[2][1:]  # two directions across gravity
        turns = rigid @ np.linalg.solve(np.array(moments).T, np.vstack([np.zeros((3, 2)), across.T]))
        motions = np.column_stack([way, turns])
        motions /= np.sqrt(np.einsum("nk,n,nk->k", motions, kinematics.mass, motions))
        return cls(
            item=item,
            places=dofs_of(mbs, item),
            motions=motions,
            pushed=motions.T @ item.weight,
        )

    def moved(self, q: Array, amounts: Array) -> Array:
        """The body's coordinates, (n,), after amounts, (3,), of its motions from the model's coordinates q, (nq,)."""
        return self.item.kinematics.moved(q[self.places], self.motions @ amounts)

    def way(self, q: Array, amounts: Array) -> float:
        """How far its outermost nodes move by these amounts [m]."""
        return largest_way(self.item, q[self.places], self.moved(q, amounts))


def tipped(
    mbs: MainSystem,
    q: Array,
    ways: dict[PartitionBody, Array],
    contacts: Sequence[PartitionContact],
    springs: dict[PartitionBody, float],
    touching: float,
) -> Array | None:
    """Coordinates, (nq,), at which bodies stand, with closed rows as deep as `touching`; None if one would fall over.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    q : (nq,) array
        Coordinates at which bodies have fallen.
    ways : dict of PartitionBody to (n,) array
        Change of its coordinates by a motion along its gravity, of each body that has fallen.
    contacts : sequence of PartitionContact
    springs : dict of PartitionBody to float
        Stiffness of the springs on its motions, by the mass [1/s2].
    touching : float
        Depth of rows at which bodies stand, and the largest change that is none [m].
    """
    standing = [_Standing.of(mbs, item, way) for item, way in ways.items()]
    near = [contact for contact in contacts if any(item in ways for item, _ in contact.sides)]
    if not standing or not near:
        return None
    stiffness = np.repeat([springs[body.item] for body in standing], 3)
    free = np.concatenate([body.pushed for body in standing]) / stiffness
    step = _STEP * min(contact.slave_facet_size for contact in near)
    limits = [_FURTHEST * float(np.ptp(body.item.body.points, axis=0).max()) for body in standing]
    at, amounts, change = q.copy(), np.zeros(len(free)), np.inf
    for _ in range(_MOST_TIPS):
        gap, H = _rows(mbs, at, near, standing)
        wanted = free.copy()
        if len(gap):
            F = regularised((H / stiffness) @ H.T)
            lam = Complementarity(F).solve(gap + touching + H @ (free - amounts))  # so that the rows are closed
            wanted += (H.T @ lam) / stiffness
        parts = np.split(wanted - amounts, len(standing))
        change = max(body.way(at, part) for body, part in zip(standing, parts, strict=True))
        amounts = amounts + min(1.0, step / max(change, step)) * (wanted - amounts)
        for body, part in zip(standing, np.split(amounts, len(standing)), strict=True):
            at[body.places] = body.moved(q, part)
        if any(
            body.way(q, part) > limit
            for body, part, limit in zip(standing, np.split(amounts, len(standing)), limits, strict=True)
        ):
            return None
        if change <= touching:
            return at
    return None


def _rows(
    mbs: MainSystem, q: Array, contacts: Sequence[PartitionContact], standing: Sequence[_Standing]
) -> tuple[Array, Array]:
    """Gaps of all rows that may touch, (nr,) [m], and their changes by the motions of the bodies, (nr, 3 nb)."""
    number, gaps, changes = {body.item: i for i, body in enumerate(standing)}, [], []
    for contact in contacts:
        rows = contact.mechanics.for_run("static").gaps
        gap = rows.widen(np.concatenate([q[place] for place in contact.slices(mbs)]))
        if not len(gap):
            continue
        H = dense(rows.jacobian(np.arange(len(gap))))
        change, column = np.zeros((len(gap), 3 * len(standing))), 0
        for item, _ in contact.sides:
            n = item.body.n_dofs
            if item in number:
                i = number[item]
                change[:, 3 * i : 3 * i + 3] += H[:, column : column + n] @ standing[i].motions
            column += n
        gaps.append(gap)
        changes.append(change)
    if not gaps:
        return np.zeros(0), np.zeros((0, 3 * len(standing)))
    return np.concatenate(gaps), np.vstack(changes)
