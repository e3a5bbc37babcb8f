"""Contacts with friction whose rows follow the motion, on rigid surfaces and between two bodies, as a plan has them.

With friction, and in groups with a contact that has friction, rows have tangents. These follow an axis of the body, of
two bodies that of the master, and with them the forces of the step before, which are kept in the body's axes. How far
rows slide is the way of their places in space, of two bodies that relative to the master, along the present tangents.
Gaps, and when the flexibility is found again, are as in `moving`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..contact.anchoring import SAME as SAME_ALONE
from ..contact.normal_rows import NormalRows
from ..contact.tangential import SAME as SAME_IN_THREE
from ..contact.tangential import TangentialRows
from ..support.arrays import Array
from .moving import Following, Surfaces, surfaces_of


class Rubbing(NamedTuple):
    """The ns contacts of this kind, first those with rigid surfaces, then those of two bodies.

    Their numbers are those among the contacts with friction, see `FrictionPlan`.

    Parameters
    ----------
    surfaces : Surfaces
        Of those with rigid surfaces.
    pairs : tuple of Following
        Those of two bodies. Their rows are all of the slave's patch; where one is not present, its gap is infinite.
    groups : (ns,) int array
        Group of each.
    first_axis : (ns,) int array
        Axis of the body, or the master, from which tangents are made, if no normal is nearly along it.
    same : (ns,) array
        Change of the normals above which the flexibility is found again.
    links : (nl, 2) int array
        Contacts of a group, of which at least one is of this kind, the first of which the second one moves.
    cores : (nl,) int array
        Where the amplitudes of the first one's fields by those of the second one begin in `numbers`, (m, m).
    fields : (nc,) int array
        Where the fields of the rows of each contact with friction begin there, (3 nr, m).
    n_fields : int
        m; zero if these contacts exchange nothing.
    numbers : array
    """

    surfaces: Surfaces
    pairs: tuple[Following, ...]
    groups: Array
    first_axis: Array
    same: Array
    links: Array
    cores: Array
    fields: Array
    n_fields: int
    numbers: Array

    @property
    def contact(self) -> list[int]:
        """Their numbers."""
        return [*self.surfaces.contact.tolist(), *(pair.contact for pair in self.pairs)]


class RubbingState(NamedTuple):
    """What changes of them in a run; loops write to it. Rows are those of all contacts with friction.

    Parameters
    ----------
    normals : (np, 3) array
        At the points of all those with rigid surfaces.
    place, before : (nr, 3) arrays
        On these, mean place of each row's points, now and at the start of the step [m].
    nodes : (k, 3) array
        Places of all nodes of two bodies' patches at the start of the step, the slave's of each contact first [m]; NaN
        where they are not followed.
    nodes_from : (np + 1, 2) int array
        Where those of both sides of each of these np contacts begin.
    axes_before, growing_before : (ns, 3, 3), (ns, 12) arrays
        Axes of the master, and products by which both sides grew, at the start of the step.
    axes : (ns, 3, 3) array
        Of the bodies, or masters.
    axis : (ns,) int array
        Axis from which the tangents are made.
    anchored, anchors, along, growing
        See `MovingState`; `along` is that of rigid surfaces.
    found_axis : (ns,) int array
        Axis of the tangents with which the present flexibility was found; -1 if it is not that of the anchor.
    fresh : (ns,) bool array
        Whether contacts have found another flexibility since the last sample.
    lost : (1,) int array
        Number, among those of two bodies, of the contact for which other rows must be found; -1 if there is none.
    left, left_at
        See `MovingState`.
    numbers : array
        Those of `Rubbing`; fields of moving rows are written to it.
    """

    normals: Array
    place: Array
    before: Array
    nodes: Array
    nodes_from: Array
    axes_before: Array
    growing_before: Array
    axes: Array
    axis: Array
    anchored: Array
    anchors: Array
    along: Array
    growing: Array
    found_axis: Array
    fresh: Array
    lost: Array
    left: Array
    left_at: Array
    numbers: Array

    @classmethod
    def of(cls, rubbing: Rubbing, n_rows: int, n: int) -> RubbingState:
        """Room for a run with so many rows and n coordinates."""
        ns, points = len(rubbing.groups), int(rubbing.surfaces.firsts[-1])
        sizes = [len(side.surface.points) for pair in rubbing.pairs for side in pair.gaps.sides]
        begins = np.r_[np.cumsum([0, *sizes]), 0].reshape(-1, 2)
        axes = np.tile(np.eye(3), (ns, 1, 1))
        return cls(
            np.zeros((points, 3)), np.zeros((n_rows, 3)), np.zeros((n_rows, 3)), np.full((sum(sizes), 3), np.nan),
            begins, axes, np.zeros((ns, 12)), axes.copy(),
            np.zeros(ns, dtype=np.int64), np.zeros(ns, dtype=bool), np.zeros((ns, n)), np.zeros((points, 3)),
            np.zeros((ns, 12)), np.full(ns, -1), np.zeros(ns, dtype=bool),
            np.full(1, -1), np.zeros(ns, dtype=bool), np.zeros((ns, n)), rubbing.numbers.copy(),
        )  # fmt: skip


def rubbing_of(
    contacts: Sequence[Following],
    pairs: Sequence[Following],
    rows: Sequence[NormalRows | TangentialRows],
    groups: Sequence[int],
    fields: Sequence[Array],
    core: Mapping[tuple[int, int], Array],
) -> Rubbing:
    """Put these contacts one after the other.

    Parameters
    ----------
    contacts, pairs : sequences of Following
        Those with rigid surfaces, and of two bodies. Their numbers are those among the contacts with friction.
    rows : sequence of NormalRows or TangentialRows
        Present rows of each.
    groups : sequence of int
        Group of each contact with friction.
    fields : sequence of (3 nr, m) arrays
        Of the rows of each contact with friction; of moving ones, room. Groups may have other m.
    core : dict of (int, int) to (m, m) array
        Through which contacts with friction move each other.
    """
    every = [*contacts, *pairs]
    moving = {one.contact for one in every}
    links = [link for link in core if moving & {*link}]
    size = max((len(block) for block in core.values()), default=0)
    fields = [np.pad(W, ((0, 0), (0, size - W.shape[1]))) for W in fields]
    core = {link: np.pad(block, (0, size - len(block))) for link, block in core.items()}
    contacts, pairs = ([one._replace(fields=_of_nodes(one, size)) for one in some] for some in (contacts, pairs))
    parts = [*(core[link] for link in links), *fields]  # room of its own for each, even if they are equal
    numbers, places = np.concatenate([np.zeros(0), *map(np.ravel, parts)]), np.cumsum([0, *map(np.size, parts)])
    surfaces, directed = surfaces_of(contacts), [isinstance(of_rows, TangentialRows) for of_rows in rows]
    first = [int(abs(one.gaps.placement.approach).argmin()) for one in every]
    return Rubbing(
        surfaces, tuple(pairs), np.array([groups[one.contact] for one in every], dtype=np.int64),
        np.array(first, dtype=np.int64), np.where(directed, SAME_IN_THREE, SAME_ALONE),
        np.array(links, dtype=np.int64).reshape(-1, 2), places[: len(links)].copy(), places[len(links) : -1].copy(),
        size, numbers,
    )  # fmt: skip


def _of_nodes(one: Following, size: int) -> tuple[Array, ...]:
    """Fields of the nodes of a contact's patches, (d k, size) each."""
    found = []
    for side, fields in zip(one.gaps.sides, one.fields, strict=True):
        wide = np.zeros((0 if side.flexibility is None else len(side.flexibility), size))
        wide[: len(fields), : fields.shape[1]] = fields
        found.append(wide)
    return tuple(found)
