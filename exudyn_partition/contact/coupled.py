"""Several contacts on one body: its residual flexibility lets a force on one patch move the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .compliance import ComplianceContact

Array = np.ndarray

_SWEEPS = 100
_SETTLED = 1e-11  # change of the forces in a sweep, relative


@dataclass(eq=False)
class CoupledContacts:
    """Compliance contacts that share bodies, solved together.

    Forces of all contacts minimise one potential, 1/2 lambda' F lambda + lambda' h over lambda >= 0 with F of all rows.
    Block Gauss-Seidel descends to it, for F is positive definite, and fast, for patches move each other little.

    Parameters
    ----------
    laws : list of ComplianceContact
    links : list of (int, int, int, int, (d np, d np) array)
        Law and side, other law and side, and the body's flexibility between the patch of the first and of the other.
    """

    laws: list[ComplianceContact] = field(default_factory=list)
    links: list[tuple[int, int, int, int, Array]] = field(default_factory=list)

    def forces(self, coordinates: Sequence[Array]) -> list[Array]:
        """Generalised forces of each contact, at the coordinates of each, (n,)."""
        gaps = [law.gaps.at(q) for law, q in zip(self.laws, coordinates, strict=True)]
        for law, h in zip(self.laws, gaps, strict=True):
            law.answer(h)
        if sum(law.index.size > 0 for law in self.laws) > 1:
            self._settle(gaps)
        return [law.generalised() for law in self.laws]

    def _settle(self, gaps: list[Array]) -> None:
        for _ in range(_SWEEPS):
            change = size = 0.0
            for j, law in enumerate(self.laws):
                before = law.lam
                law.answer(gaps[j], self._pushed(j))
                change += abs(law.lam - before).sum()
                size += law.lam.sum()
            if change <= _SETTLED * size:
                break

    def _pushed(self, j: int) -> Array:
        """What the forces of the other contacts add to the gaps of the j-th."""
        law = self.laws[j]
        pushed = np.zeros(len(law.lam))
        for own, side, k, other_side, F in self.links:
            other = self.laws[k]
            if own == j and other.index.size:
                at_nodes = other.gaps.side_rows(other_side, other.index).T @ other.lam[other.index]
                pushed += law.gaps.side_rows(side, np.arange(len(pushed))) @ (F @ at_nodes)
        return pushed
