"""Joints in the Jacobian of static runs: how their reactions turn with bodies in floating frames."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp

from ..exudyn_bodies.model import user_function
from ..exudyn_bodies.reactions import Reactions
from ..exudyn_bodies.rotation_vectors import turns
from ..exudyn_contacts.partition_contact import partition_items
from ..support.arrays import Array
from ..support.foreign import Coordinates, ItemIndex, MainSystem, MatrixContainer, UserFunction
from ..support.optional import require


@contextlib.contextmanager
def turn_reactions(mbs: MainSystem) -> Iterator[None]:
    """Add to the Jacobian how reactions of joints turn with floating bodies, as Exudyn does with loads.

    Without it a hanging link has no stiffness against turns. In a strut that joints hold, the loads' share alone would
    keep Newton's method from settling near the load at which it buckles.
    """
    reactions, name = Reactions.of(mbs), "jacobianUserFunction"
    former = {}
    for item in partition_items(mbs)[0] if reactions.joints else ():
        number = item["oGenericODE2"]
        columns = np.array(mbs.systemData.GetObjectLTGODE2(number), dtype=int)
        if any(column in reactions.turning for column in columns.tolist()):
            former[number] = user_function(mbs.GetObjectParameter(number, name))
            mbs.SetObjectParameter(number, name, _with_reactions(reactions, columns, former[number]))
    try:
        yield
    finally:
        for number, function in former.items():
            mbs.SetObjectParameter(number, name, function or 0)


def _with_reactions(reactions: Reactions, columns: Array, own_function: UserFunction | None) -> UserFunction:
    """User function for a Jacobian: that of another function, and what reactions on a body change; see `Reactions`."""
    container = require("exudyn").MatrixContainer
    vectors = tuple(sorted({reactions.turning[i].start for i in columns.tolist() if i in reactions.turning}))

    def jacobian(
        mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates, fODE2: float, fODE2_t: float
    ) -> MatrixContainer:
        by_turns = reactions.stiffness_as_loads(mbs.systemData.GetAECoordinates(), columns)
        change = sp.csr_matrix(-fODE2 * by_turns) @ turns(mbs, vectors)[columns][:, columns]
        if own_function is None:
            return container(change)
        result = own_function(mbs, t, i, q, q_t, fODE2, fODE2_t)
        result.AddSparseMatrix(change, 1.0)
        return result

    return jacobian
