"""Broad phase of contacts between bodies that may meet anywhere: which of them may touch soon.

All others sleep: nobody evaluates them. A contact sleeps while all its gaps are larger than a part of a facet. For
this, the gaps are bounded from below. Then each step bounds by how much they can have become smaller: by the change of
the bodies' coordinates alone, for all contacts at once. So a step costs as much as the contacts that are awake.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from ..contact.patch_contact import PatchContact
from ..contact.side import Side
from ..support.arrays import Array

_MARGIN = 0.15  # of a facet's size: contacts that may have smaller gaps are awake; forces elsewhere may bulge a surface
_SPARE = 0.1  # of a facet's size: how much larger gaps must be to stay asleep, for the next look is due then
_AGAIN = 0.3  # of a facet's size: how much larger they must be to fall asleep
_LONGER = 1.1  # how much longer than undeformed the arms of a body in a floating frame may be


class BroadPhase:
    """Contacts of a group that may touch soon.

    Parameters
    ----------
    contacts : sequence of PatchContact
        Of the group, in a run.
    dofs : sequence of (n,) int arrays
        Numbers of each contact's coordinates in the model.
    n : int
        Number of the model's coordinates.

    Attributes
    ----------
    awake : tuple of int
        Numbers of the contacts that may touch soon; the same object as long as these stay the same.
    looks : int
        How often the distance of the sides of a contact was bounded by their nodes.
    """

    def __init__(self, contacts: Sequence[PatchContact], dofs: Sequence[Array], n: int) -> None:
        self._contacts, self._dofs = [*contacts], [*dofs]
        rows, of_side = list[sp.csr_matrix](), dict[tuple[int, bytes], int]()
        number = np.zeros((len(contacts), 2), dtype=np.int64)  # of each contact's sides; the first one never moves
        for j, (contact, places) in enumerate(zip(contacts, dofs, strict=True)):
            ends = np.cumsum([side.n for side in contact.gaps.sides])
            for s, (side, columns) in enumerate(zip(contact.gaps.sides, np.split(places, ends[:-1]), strict=True)):
                key = int(columns[0]), side.surface.nodes.tobytes()
                if key not in of_side:
                    of_side[key] = len(of_side) + 1
                    rows.append(sp.csr_matrix((motion_bound(side), columns, [0, len(columns)]), shape=(1, n)))
                number[j, s] = of_side[key]
        self._sides, self._motion = number, sp.csr_matrix(sp.vstack([sp.csr_matrix((1, n)), *rows]))
        self._from = np.zeros(n)
        self._sleeps = np.zeros(len(contacts), dtype=bool)
        # Bodies of other kinds, which carry surfaces, may move at any speed: these contacts never sleep.
        sleeping = [contact.gaps.anywhere and not contact.gaps.carried for contact in contacts]
        self._left = np.where(sleeping, 0.0, np.inf)
        self.awake, self.looks = tuple(range(len(contacts))), 0

    def look(self, q: Array) -> tuple[int, ...]:
        """Numbers of the contacts that may touch soon at the model's coordinates q, (n,)."""
        moved = (self._motion @ abs(q - self._from))[self._sides].sum(axis=1)
        left = self._left - moved
        ended = np.flatnonzero(~(left > 0.0))
        if len(ended) and np.isfinite(q.sum()):  # otherwise contacts that are awake tell that the run is unstable
            self._from, self._left = q.copy(), left
            for j in ended.tolist():
                self._look_at(j, q)
            if (awake := tuple(np.flatnonzero(~self._sleeps).tolist())) != self.awake:
                self.awake = awake
        return self.awake

    def closing(self, j: int, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """Bounds of the gap of a contact that sleeps, its rate and acceleration, (1,) each, at its coordinates q, (n,).

        These are what `PatchContact.closing` returns.
        """
        changes = np.zeros((len(self._from), 3))
        changes[self._dofs[j]] = abs(np.column_stack([q - self._from[self._dofs[j]], q_t, q_tt]))
        moved, rate, acceleration = (self._motion @ changes)[self._sides[j]].sum(axis=0)
        gap = self._left[j] + _MARGIN * self._contacts[j].gaps.size - moved
        return np.array([gap]), np.array([-rate]), np.array([-acceleration])

    def _look_at(self, j: int, q: Array) -> None:
        """Bound the distance of a contact's sides, and by how much they may move until the next look."""
        contact, self.looks = self._contacts[j], self.looks + 1
        size = contact.gaps.size
        least = contact.gaps.least_distance(q[self._dofs[j]])
        apart = least - _MARGIN * size
        at_rest = not contact.gaps.has_past and not contact.state.creep.elastic
        self._sleeps[j] = apart > (_SPARE if self._sleeps[j] else _AGAIN) * size and at_rest
        self._left[j] = apart if self._sleeps[j] else max(_AGAIN * size - apart, _SPARE * size)
        if self._sleeps[j]:
            contact.opened(contact.evaluation.h, least)


def motion_bound(side: Side) -> Array:
    """Weights of the changes of a body's coordinates, (n,): their sum bounds the motion of all nodes of a patch [m]."""
    kinematics = side.kinematics
    if sp.issparse(kinematics.rows):
        shapes = np.sqrt(3.0) * np.asarray(abs(kinematics.rows).max(axis=0).todense()).ravel()
    else:
        rows = kinematics.rows.reshape(len(kinematics.nodes), 3, kinematics.rows.shape[1])
        shapes = np.sqrt(np.einsum("kdn,kdn->kn", rows, rows).max(axis=0))
    if kinematics.linear:
        return np.asarray(shapes)
    arm = _LONGER * float(np.linalg.norm(kinematics.arms, axis=1).max())
    return np.concatenate([np.ones(3), np.full(3, arm), shapes])
