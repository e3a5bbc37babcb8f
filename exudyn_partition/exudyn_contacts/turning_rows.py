"""Stiffness by rows of contacts that turn: constant forces on them get other levers and directions as bodies move.

The stiffness of contacts for fixed rows lacks it. A ball that lies in a bore would not swing, and one that is pressed
on a plane would resist turns, though it may roll.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ..exudyn_bodies.differences import WAY, Differences
from ..support.arrays import Array
from ..support.foreign import MainSystem
from .contact_object import carrying_nodes
from .contact_run import ContactRun
from .contact_samples import ModelContact
from .model_run import ModelRun

_LITTLE = 1e-4  # of a facet's size: rows are almost linear over it, and stay the same


def stiffness_of_turning_rows(mbs: MainSystem, run: ModelRun) -> Array:
    """Minus the changes of constant forces on closed rows with the model's coordinates, (nq, nq).

    The contacts must have been evaluated in the model's present state.
    """
    differences = Differences.of(mbs)
    K = np.zeros((differences.n,) * 2)
    for contact in run.contacts:
        member = run.contact_run(contact)
        answer, gaps = member.evaluation, member.mechanics.gaps
        if answer.index.size:
            nodes, there = answer.row_nodes[answer.index], gaps.present
            carrier = [mbs.systemData.GetNodeLTGODE2(node) for node in carrying_nodes(contact)]
            by = np.concatenate([member.dofs, *carrier])
            forces = partial(_forces, mbs, contact, member, nodes, answer.on_rows[answer.index])
            K[np.ix_(by, by)] -= differences.changes(forces, by, _ways(member, len(by)))
            gaps.return_to(there)
    return K


def _ways(member: ContactRun, n: int) -> Array:
    """Ways of n coordinates, first those of the bodies, that hardly move any node of the patches, (n,)."""
    gaps = member.mechanics.gaps
    places, here = partial(gaps.sides.places, growing=gaps.growing), gaps.present.q
    start, little = places(here), _LITTLE * gaps.size
    ways = np.full(n, min(WAY, little))
    for i in range(len(here)):
        q = here.copy()
        q[i] += WAY
        moved = max(np.nan_to_num(abs(x - x0)).max() for x, x0 in zip(places(q), start, strict=True))
        ways[i] = min(WAY, WAY * little / moved) if moved else ways[i]
    return ways


def _forces(mbs: MainSystem, contact: ModelContact, member: ContactRun, nodes: Array, forces: Array) -> Array:
    """Forces on the coordinates of bodies and carrier, (m,), in the model's present state.

    `forces`, (na, d) [N], are those on rows that belong to `nodes`, (na,).
    """
    rows = member.mechanics.rows
    rows.gaps.at(member.coordinates_in(mbs.systemData.GetODE2Coordinates(copy=False)))
    index = np.searchsorted(rows.gaps.row_nodes, nodes)
    on_rows = np.zeros((len(rows.gaps.row_nodes), forces.shape[1]))
    on_rows[index] = forces
    on_bodies = rows.acted(on_rows)[0]
    if contact.carrier is None or not carrying_nodes(contact):
        return on_bodies
    by_carrier = rows.carrier_rows(index) @ contact.carrier.by_coordinates(mbs)
    return np.concatenate([on_bodies, by_carrier.T @ forces.ravel()])
