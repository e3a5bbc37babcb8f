"""Several contacts on one body: its residual flexibility lets a force on one patch move the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import ComplementarityError
from .compliance import ComplianceContact

Array = np.ndarray

_SWEEPS = 100
_SETTLED = 1e-11  # change of the forces in a sweep, relative
_UNSETTLED = 1e-6  # change in the last sweep from which forces are no answer


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

    def __init__(self, laws: list[ComplianceContact], links: list[tuple[int, int, int, int, Array]]) -> None:
        self.laws, self.links = laws, links
        self._at: Array | None = None

    def reset(self) -> None:
        """Forget the last run."""
        self._at = None
        for law in self.laws:
            law.reset()

    def forces(self, coordinates: Sequence[Array]) -> list[Array]:
        """Generalised forces of each contact, at the coordinates of each, (n,).

        Every contact asks for its own at the same coordinates; they are found once.
        """
        at = np.concatenate(coordinates)
        if self._at is None or not np.array_equal(at, self._at):
            self._at, self._forces = at, self._find(coordinates)
        return self._forces

    def _find(self, coordinates: Sequence[Array]) -> list[Array]:
        gaps = [law.gaps.at(q) for law, q in zip(self.laws, coordinates, strict=True)]
        for law, h in zip(self.laws, gaps, strict=True):
            law.answer(h)
        if sum(law.index.size > 0 for law in self.laws) > 1:
            self._settle(gaps)
        return [law.generalised() for law in self.laws]

    def _settle(self, gaps: list[Array]) -> None:
        of = [law.gaps for law in self.laws]
        links = [
            (j, of[j].side_rows(side), F, k, of[k].side_rows(other_side).T) for j, side, k, other_side, F in self.links
        ]
        for _ in range(_SWEEPS):
            change = size = 0.0
            for j, law in enumerate(self.laws):
                before, pushed = law.lam, np.zeros(len(law.lam))
                for own, rows, F, k, push in links:
                    if own == j and self.laws[k].index.size:
                        pushed += rows @ (F @ (push @ self.laws[k].lam))
                law.answer(gaps[j], pushed)
                change += abs(law.lam - before).sum()
                size += law.lam.sum()
            if change <= _SETTLED * size:
                return
        if change > _UNSETTLED * size:
            raise ComplementarityError(
                f"the forces of {len(self.laws)} contacts on common bodies did not settle in {_SWEEPS} sweeps, the "
                f"last changed them by {change / size:.2g}. Patches that overlap or touch move each other too much: "
                "keep them apart, or make one of them"
            )
