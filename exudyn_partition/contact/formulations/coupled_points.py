"""Contacts at points of common bodies, by Hertz's law: each point moves the others through its body.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".
"""

from __future__ import annotations

import numpy as np

from ...support.arrays import Array
from .coupled_zones import CoupledZones


class CoupledPoints(CoupledZones):
    """Contacts at points that share bodies, patches too.

    Each in turn finds its force for the displacements that the others cause. It needs few sweeps: far from a point, its
    force moves the body less than at the point itself.
    """

    _by_fields = False

    def _begin(self) -> None:
        super()._begin()
        self._blocks: dict[tuple[int, int], tuple[tuple[int, int], Array]] = {}

    def _find(self, gaps: list[Array]) -> None:
        """See `Coupled`."""
        self._versions = [*self._between.versions()]
        super()._find(gaps)

    def _moved(self, j: int, k: int, forces: Array) -> Array:
        """See `CoupledZones`; it is found from the flexibility between both rows, which is kept."""
        versions = self._versions[j], self._versions[k]
        kept = self._blocks.get((j, k))
        if kept is None or kept[0] != versions:
            rows = (np.arange(self.contacts[place].rows.d) for place in (j, k))
            kept = self._blocks[j, k] = versions, self._between.flexibility(j, next(rows), k, next(rows))
        return kept[1] @ forces.ravel()

    def _settle(self, gaps: list[Array], lasting: list[Array]) -> None:
        """See `CoupledZones`; half of what forces do on ways by other forces is stored, by each contact its part."""
        super()._settle(gaps, lasting)
        for j, contact in enumerate(self.contacts):
            pushing = self._pushing(j)
            if contact.evaluation.index.size and pushing:
                pushed = sum(self._moved(j, k, self.contacts[k].evaluation.on_rows) for k in pushing)
                half = 0.5 * float(np.dot(contact.evaluation.on_rows.ravel(), pushed))
                contact.evaluation = contact.evaluation.with_stored(contact.evaluation.stored + half)
