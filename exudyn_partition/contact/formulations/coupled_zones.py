"""Contacts on common bodies with plastic zones: each in turn finds its forces, until all of them settle."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg

from ...errors import ComplementarityError
from ...support.arrays import Array
from .coupled import Coupled, flexibility_between

_SWEEPS = 100
_SETTLED = 1e-11  # relative change of the forces in a sweep
_SETTLED_WITH_FRICTION = 1e-9  # forces with friction are computed to a tenth of it
_UNSETTLED = 1e-5  # relative change in the last sweep above which the forces are rejected; zones settle to 1e-4


class CoupledZones(Coupled):
    """Contacts of which some have plastic zones.

    A zone iterates its flow together with the forces on its contact's rows. So each contact in turn finds its forces
    for the displacements that the others cause (block Gauss-Seidel). This converges fast, because one patch moves
    another only a little. Tangential forces count too. Tangential places move by the change of the forces since the
    last accepted step.
    """

    def _begin(self) -> None:
        super()._begin()
        self._known_neighbours: dict[int, list[int]] | None = None
        self._frictional = any(contact.friction is not None for contact in self.contacts)
        for contact in self.contacts:
            contact.told = True

    def _linearised(self, closed: Sequence[slice]) -> Callable[[int, Array], Array]:
        """See `Coupled`: d lambda = -D (dh + F_between d lambda)."""
        directions = {j: contact.rows.directions(contact.evaluation.index) for j, contact in enumerate(self.contacts)}
        D = scipy.linalg.block_diag(*(contact.evaluation.row_stiffness() for contact in self.contacts))
        F = flexibility_between(self._between, dict(enumerate(closed)), directions)
        K = np.linalg.solve(np.eye(len(D)) + D @ F, D)
        return lambda k, way: K[:, closed[k]] @ way

    def _find(self, gaps: list[Array]) -> None:
        """See `Coupled`."""
        for contact, h in zip(self.contacts, gaps, strict=True):
            contact.answer(h)
        lasting = self._lasting([*map(self._last_of, range(len(gaps)))]) if self._viscous else []
        if lasting or any(map(self._pushes, range(len(gaps)))):
            self._settle(gaps, lasting)

    @property
    def _neighbours(self) -> dict[int, list[int]]:
        """Contacts that may move the rows of each."""
        if self._known_neighbours is None:
            self._known_neighbours = {}
            for j, k in self._between.pairs:
                self._known_neighbours.setdefault(j, []).append(k)
        return self._known_neighbours

    def _pushing(self, j: int) -> list[int]:
        """Contacts whose forces move the rows of contact j."""
        return [k for k in self._neighbours.get(j, ()) if self._pushes(k)]

    def _pushes(self, j: int) -> bool:
        """Whether forces of a contact, or those at the end of the last accepted step, move the rows of others."""
        contact = self.contacts[j]
        return contact.evaluation.index.size > 0 or contact.state.memory.closed

    def _settle(self, gaps: list[Array], lasting: list[Array]) -> None:
        """Let contacts answer in turn, with what the others push, until their forces hardly change."""
        pushed_ever = [bool(lasting)] * len(self.contacts)  # contacts that nothing has pushed have their answer
        settled = _SETTLED_WITH_FRICTION if self._frictional else _SETTLED
        for _ in range(_SWEEPS):
            change = size = 0.0
            for j, contact in enumerate(self.contacts):
                pushing = self._pushing(j)
                if pushing or pushed_ever[j]:
                    before, pushed_ever[j] = contact.evaluation.on_rows, True
                    start = lasting[j] if lasting else np.zeros(before.shape)
                    answer = contact.answer(gaps[j], sum((self._pushed(j, k) for k in pushing), start))
                    change += abs(answer.on_rows - before).sum()
                size += contact.evaluation.lam.sum()
            if change <= settled * size:
                return
        if change > _UNSETTLED * size:
            raise ComplementarityError(
                f"the forces of {len(self.contacts)} contacts on common bodies did not settle in {_SWEEPS} sweeps; the "
                f"last changed them by {change / size:.2g}. Patches that overlap or touch move each other too much: "
                "keep the patches apart, or join them to one patch"
            )

    def _pushed(self, j: int, k: int) -> Array:
        """Displacements that the forces of contact k add to the places of contact j, in the shape of its forces [m].

        These are gaps, and with friction also tangential places since the last accepted step.
        """
        contact, neighbour = self.contacts[j], self.contacts[k]
        pushed = self._moved(j, k, neighbour.evaluation.on_rows).reshape(contact.evaluation.on_rows.shape)
        if contact.friction is not None:
            pushed[:, 1:] -= self._moved(j, k, self._last_of(k)[:, : neighbour.rows.d]).reshape(-1, 3)[:, 1:]
        return pushed

    def _last_of(self, k: int) -> Array:
        """Forces on the rows of contact k at the end of the last accepted step, (nr, 3) [N]."""
        contact = self.contacts[k]
        if contact.friction is not None:
            return contact.last
        nodes = contact.gaps.row_nodes
        last = np.zeros((len(nodes), 3))
        last[:, :1] = contact.state.memory.forces[nodes]
        return last

    def _moved(self, j: int, k: int, forces: Array) -> Array:
        pushing = self._between.pushing(k, np.arange(forces.size), forces.ravel())
        return self._between.moved(j, {k: pushing})
