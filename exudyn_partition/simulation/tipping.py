"""Bodies that have fallen tip until they stand: as if rigid, on all that is beneath, not on the first row that touches.

A body on three feet touches with one of them first. On that one alone it has no equilibrium near its place, and
Newton's method would throw it about. So bodies tip and sink until the energy of their weights and of springs on these
motions is least, while no row is deeper than a small distance. The springs are those that hold resting bodies in
statics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..algebra.complementarity import Complementarity, regularised
from ..algebra.products import dense
from ..exudyn_bodies.model import dofs_of
from ..exudyn_bodies.partition_body import PartitionBody, largest_way
from ..exudyn_contacts.partition_contact import PartitionContact
from ..support.arrays import Array
from ..support.foreign import MainSystem

_MOST_TIPS = 50  # gaps are found anew as often as this
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
    motions : (n, k) array
        Rigid motions, each with a kinetic energy of one half.
    pushed : (k,) array
        Its weight and loads along these motions.
    """

    item: PartitionBody
    places: Array
    motions: Array
    pushed: Array

    @classmethod
    def of(cls, mbs: MainSystem, item: PartitionBody, force: Array, slides: bool) -> _Standing:
        """A body with a generalised force, (n,). What `slides` also moves across its gravity and turns about it."""
        kinematics = item.kinematics
        rigid = np.column_stack([kinematics.rigid_part(unit) for unit in np.eye(len(force))])
        rigid = np.linalg.qr(rigid)[0][:, :6] if len(force) > 6 else rigid
        rest = np.zeros(len(force))
        moments = [
            np.concatenate([kinematics.momentum(motion), kinematics.angular_momentum(rest, motion, np.zeros(3))])
            for motion in rigid.T
        ]
        down = kinematics.momentum(item.weight / kinematics.mass)
        axes = np.linalg.svd(down[None, :])[2]  # along gravity, and two directions across
        turns = rigid @ np.linalg.solve(np.array(moments).T, np.vstack([np.zeros((3, 3)), axes.T]))
        ways = np.column_stack([kinematics.weight(axis) / kinematics.mass for axis in axes])
        motions = np.column_stack([ways, turns] if slides else [ways[:, 0], turns[:, 1:]])
        motions /= np.sqrt(np.einsum("nk,n,nk->k", motions, kinematics.mass, motions))
        return cls(item, dofs_of(mbs, item), motions, motions.T @ force)

    def moved(self, q: Array, amounts: Array) -> Array:
        """The body's coordinates, (n,), after amounts, (k,), of its motions from the model's coordinates q, (nq,)."""
        return self.item.kinematics.moved(q[self.places], self.motions @ amounts)


def tipped(
    mbs: MainSystem,
    q: Array,
    forces: Mapping[PartitionBody, Array],
    contacts: Sequence[PartitionContact],
    springs: Mapping[PartitionBody, float],
    touching: float,
    *,
    slides: bool,
) -> Array | None:
    """Coordinates, (nq,), at which bodies stand, with closed rows as deep as `touching`; None if one would fall over.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    q : (nq,) array
        Coordinates at which bodies have fallen.
    forces : dict of PartitionBody to (n,) array
        Weight and loads of each body that has fallen, as generalised forces.
    contacts : sequence of PartitionContact
    springs : dict of PartitionBody to float
        Stiffness of the springs on its motions, by the mass [1/s2].
    touching : float
        Depth of rows at which bodies stand, and the largest change that is none [m].
    slides : bool
        Whether bodies also move across their gravity, as into a hollow. If not, they sink and tip alone.
    """
    standing = [_Standing.of(mbs, item, force, slides) for item, force in forces.items()]
    near = [contact for contact in contacts if any(item in forces for item, _ in contact.sides)]
    if not standing or not near:
        return None
    stiffness = np.concatenate([np.full(len(body.pushed), springs[body.item]) for body in standing])
    free = np.concatenate([body.pushed for body in standing]) / stiffness
    step = _STEP * min(contact.slave_facet_size for contact in near)
    at = q.copy()
    for _ in range(_MOST_TIPS):
        gap, H = _rows(mbs, at, near, standing)
        wanted = free
        if len(gap):
            F = regularised((H / stiffness) @ H.T)
            lam = Complementarity(F).solve(gap + touching + H @ free)  # so that the rows are closed
            wanted = free + (H.T @ lam) / stiffness
        ways = np.split(wanted, len(standing))
        change = max(
            largest_way(body.item, at[body.places], body.moved(at, way))
            for body, way in zip(standing, ways, strict=True)
        )
        if change <= touching:
            return at
        for body, way in zip(standing, ways, strict=True):
            at[body.places] = body.moved(at, min(1.0, step / change) * way)
        if any(_far(body.item, q[body.places], at[body.places]) for body in standing):
            return None
    return None


def _far(item: PartitionBody, start: Array, end: Array) -> bool:
    """Whether a body has moved so far that it falls over; `start` and `end` are its coordinates, (n,)."""
    return largest_way(item, start, end) > _FURTHEST * float(np.ptp(item.body.points, axis=0).max())


def _rows(
    mbs: MainSystem, q: Array, contacts: Sequence[PartitionContact], standing: Sequence[_Standing]
) -> tuple[Array, Array]:
    """Gaps of all rows that may touch, (nr,) [m], and their changes by the motions of the bodies, (nr, k nb)."""
    k, number = standing[0].motions.shape[1], {body.item: i for i, body in enumerate(standing)}
    gaps, changes = [np.zeros(0)], [np.zeros((0, k * len(standing)))]
    for contact in contacts:
        rows = contact.mechanics.for_run("static").gaps
        gap = rows.widen(np.concatenate([q[place] for place in contact.slices(mbs)]))
        if not len(gap):
            continue
        H = dense(rows.jacobian(np.arange(len(gap))))
        change, column = np.zeros((len(gap), k * len(standing))), 0
        for item, _ in contact.sides:
            n = item.body.n_dofs
            if item in number:
                i = number[item]
                change[:, k * i : k * (i + 1)] += H[:, column : column + n] @ standing[i].motions
            column += n
        gaps.append(gap)
        changes.append(change)
    return np.concatenate(gaps), np.vstack(changes)
