"""Points of a plastic zone that may flow in a step, and the flexibility of the nodes of their elements.

All of it follows from the zone and the choice of the points. It is kept to save time.
"""

from __future__ import annotations

import numpy as np

from ...algebra.sparse.flexibility import KeptFlexibility
from ...fe.model import node_dofs
from ...plasticity import loops
from ...plasticity.zone_flexibility import ZoneFlexibility
from ...support.arrays import Array
from .zone_motion import ZoneMotion
from .zone_state import ZoneState


class OrderedRows:
    """Flexibility of a small zone, dense, with the dofs that are loaded first, so that products need no copy.

    Like `KeptFlexibility`, by whose fronts its rows are found when they are needed first.

    Parameters
    ----------
    given : ZoneFlexibility
    kind : type
        Type of the numbers in the products.
    """

    def __init__(self, given: ZoneFlexibility, kind: type) -> None:
        n = len(given.own)
        self._given, self._filled = given, 0
        self._order, self._place = np.arange(n), np.arange(n)  # dofs in this order, and the place of each in it
        self._rows: Array = np.empty((n, n), kind)  # of the first dofs, by all in this order; the others take no memory

    def at(self, dofs: Array) -> FirstRows:
        """Flexibility by forces on some dofs, (m,), alone; only the last that was asked for can be used."""
        front, places = np.arange(len(dofs)), self._place[dofs]
        leave, come = np.setdiff1d(front, places), places[places >= len(dofs)]
        now, then = np.concatenate([leave, come]), np.concatenate([come, leave])
        self._order[now] = self._order[then]
        self._place[self._order[now]] = now
        rows = self._rows[: self._filled]
        rows[:, now] = rows[:, then]
        new = np.union1d(leave, front[self._filled :])
        for row, values in zip(new, self._given.rows(self._order[new]), strict=True):
            self._rows[row] = values.take(self._order)
        self._filled = len(dofs)
        return FirstRows(self._rows[: len(dofs)], self._place, self._place[dofs])


class FirstRows:
    """Flexibility by forces on the first of ordered dofs, like `LoadedDofs`.

    Parameters
    ----------
    rows : (m, n) array
        Displacements by unit forces there [m/N].
    place : (n,) int array
        Of each dof in this order.
    first : (m,) int array
        Places of the loaded dofs, as the forces are ordered.
    """

    def __init__(self, rows: Array, place: Array, first: Array) -> None:
        self._rows, self._place, self._first = rows, place, first

    def answer(self, forces: Array) -> tuple[Array, Array]:
        """Displacements of these dofs, (m,) [m], by forces on them, (m,) [N]; what `spread` needs of these forces."""
        force = np.empty(len(forces), self._rows.dtype)
        force[self._first] = forces
        moved = force @ self._rows[:, : len(forces)]
        return moved[self._first], np.concatenate([force, moved])

    def spread(self, answered: Array) -> Array:
        """Displacements of all dofs, (n,) [m], by the forces that were answered."""
        # A combination stays in double precision. Rounding may decide in which iteration a step settles. So a run that
        # goes on would differ from one run by what steps leave, not by rounding.
        force, moved = np.split(answered, 2)
        return np.concatenate([moved, force @ self._rows[:, len(force) :]])[self._place]


class ActivePoints:
    """Points of a zone that may flow in this step, and the nodes of their elements.

    Parameters
    ----------
    motion : ZoneMotion
    chosen : (g,) bool array
        The points.
    flexibility : OrderedRows or KeptFlexibility
        Flexibility of the zone.
    of_patch : (r, 3 nz) array
        Displacements of the zone's nodes due to unit forces on the rows of the patch [m/N].

    Attributes
    ----------
    points : (k,) int array
    part : PlasticZone
        The zone of these points.
    dofs : (m,) int array
        Displacements of their nodes, among those of the zone.
    """

    def __init__(
        self, motion: ZoneMotion, chosen: Array, flexibility: OrderedRows | KeptFlexibility, of_patch: Array
    ) -> None:
        self._chosen = chosen
        self.points, self.part = np.flatnonzero(chosen), motion.zone.part(chosen)
        self.dofs = node_dofs(self.part.nodes)
        self._flexibility = flexibility.at(self.dofs)
        self._of_patch = of_patch.take(self.dofs, axis=1)  # by rows, as loops want them
        self._rows = motion.kinematics.rows[self.dofs]
        self._strain: tuple[ZoneState, Array] | None = None

    def are_chosen(self, chosen: Array) -> bool:
        """Whether these are the points that are `chosen`, (g,) bool."""
        return np.array_equal(chosen, self._chosen)

    def moved(self, q: Array, before: Array) -> Array:
        """Displacements of the nodes, (m,) [m], due to the last coordinates, plus those of the zone in `before`."""
        return np.asarray(self._rows @ q + before[self.dofs])

    def by_patch(self, force: Array) -> Array:
        """Displacements of the nodes, (m,) [m], due to forces on the rows of the patch, (r,) [N]."""
        return loops.combined(self._of_patch, force)

    def at_patch(self, change: Array) -> Array:
        """Displacements of the rows of the patch, (r,) [m], due to a change of the pseudo-forces, (m,) [N]."""
        return np.asarray(self._of_patch @ change.astype(self._of_patch.dtype))

    def answer(self, change: Array) -> tuple[Array, Array]:
        """Displacements of the nodes, (m,) [m], due to a change of the pseudo-forces, (m,) [N]; what `spread` needs."""
        return self._flexibility.answer(change)

    def spread(self, answered: Array) -> Array:
        """Displacements of all nodes of the zone, (3 nz,) [m], due to what `answer` was asked for."""
        return self._flexibility.spread(answered)

    def generalised(self, change: Array) -> Array:
        """Forces on the last coordinates of the body, (n,), from a change of the pseudo-forces, (m,) [N]."""
        return np.asarray(self._rows.T @ change)

    def strain(self, state: ZoneState) -> Array:
        """Deviatoric strains of the points, (k, 6), in a state; those of the last one that was asked for are kept."""
        if state.strain is not None and self.are_chosen(state.active):
            return state.strain
        if self._strain is None or self._strain[0] is not state:
            moved = self.moved(state.q, state.applied.moved) + self.by_patch(state.by_patch)
            # Nothing flows. So this gives the strains quickly.
            self._strain = state, self.part.answer(moved, state.plastic.at(self.points))[1]
        return self._strain[1]
