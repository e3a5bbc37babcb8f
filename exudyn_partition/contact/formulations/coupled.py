"""Several contacts on one body: through its residual flexibility, a force on one patch moves the others."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence

import numpy as np

from ...errors import ComplementarityError
from ...frames.kinematics import Rows
from ...support.arrays import Array, consecutive
from ..gaps import dense
from .compliance import ComplianceContact

_SWEEPS = 100
_SETTLED = 1e-11  # change of the forces in a sweep, relative
_UNSETTLED = 1e-6  # relative change in the last sweep above which the forces are rejected


class CoupledContacts:
    """Compliance contacts that share bodies, solved together.

    The forces of all contacts minimise one potential, 1/2 lambda' F lambda + lambda' h over lambda >= 0, with F of all
    rows. Block Gauss-Seidel converges to the minimum, because F is positive definite. It converges fast, because one
    patch moves another only a little.

    Parameters
    ----------
    laws : list of ComplianceContact
    links : list of (int, int, int, int, (d np, d np) array)
        Numbers of a law and its side, of the other law and its side, and the body's flexibility between the patches
        [m/N].
    """

    def __init__(self, laws: Sequence[ComplianceContact], links: list[tuple[int, int, int, int, Array]]) -> None:
        self.laws = [*laws]
        self._links: dict[tuple[int, int], list[tuple[int, int, Array]]] = {}
        for j, side, k, other_side, between in links:
            self._links.setdefault((j, k), []).append((side, other_side, between))
        self._neighbours = [[k for own, k in self._links if own == j] for j in range(len(laws))]
        self._at: Array | None = None
        self._inverse: Array | None = None
        self._rows: dict[tuple[int, int], Rows] = {}
        self._kept: dict[tuple[int, int], tuple[object, object, Array]] = {}

    def for_run(self, laws: Sequence[ComplianceContact]) -> CoupledContacts:
        """Return the same object for the laws of a run; flexibilities between constant rows are shared."""
        result = copy.copy(self)
        result.laws, result._at, result._inverse, result._rows = [*laws], None, None, {}
        return result

    def forces(self, coordinates: Sequence[Array]) -> list[Array]:
        """Generalised forces of each contact, (n,), at its coordinates, (n,)."""
        return self.forces_at(np.concatenate(coordinates), lambda: coordinates)

    def forces_at(self, state: Array, coordinates: Callable[[], Sequence[Array]]) -> list[Array]:
        """Generalised forces of each contact, (n,), in a state of the model.

        Every contact asks for its forces in the same state; they are computed once. Where a body carries a rigid
        surface, its place is part of the state.

        Parameters
        ----------
        state : (m,) array
            Values that determine the coordinates of all contacts.
        coordinates : callable
            Returns the coordinates of each contact, (n,). It is called only when the state has changed.
        """
        at = np.concatenate([state, *(law.gaps.carrier_pose for law in self.laws)])
        if self._at is None or not np.array_equal(at, self._at):
            self._at, self._forces, self._inverse = at, self._find(coordinates()), None
        return self._forces

    def stiffness(self, law: ComplianceContact, other: ComplianceContact) -> Array:
        """Change of forces on closed rows of `law` by gaps of closed rows of `other`, (na, nb) [N/m].

        All other gaps are held.
        """
        if self._inverse is None:
            self._inverse = np.linalg.inv(self._flexibility())
        rows, columns = self._closed[self.laws.index(law)], self._closed[self.laws.index(other)]
        return self._inverse[rows, columns]

    def _flexibility(self) -> Array:
        """Flexibility of the closed rows of all contacts, (n, n) [m/N]."""
        self._closed = consecutive([len(law.index) for law in self.laws])
        F = np.zeros((self._closed[-1].stop,) * 2)
        for law, own in zip(self.laws, self._closed, strict=True):
            F[own, own] = law.active_flexibility()
        for j, k in self._links:
            between = self._between(j, k)[np.ix_(self.laws[j].index, self.laws[k].index)]
            F[self._closed[j], self._closed[k]] += between
        return F

    def _find(self, coordinates: Sequence[Array]) -> list[Array]:
        self._rows.clear()
        gaps = [law.gaps.at(q) for law, q in zip(self.laws, coordinates, strict=True)]
        for law, h in zip(self.laws, gaps, strict=True):
            law.answer(h)
        if sum(law.index.size > 0 for law in self.laws) > 1:
            self._settle(gaps)
        return [law.generalised() for law in self.laws]

    def _settle(self, gaps: list[Array]) -> None:
        pushed_ever = [False] * len(self.laws)  # the other laws already have their answer
        for _ in range(_SWEEPS):
            change = size = 0.0
            for j, law in enumerate(self.laws):
                pushing = [k for k in self._neighbours[j] if self.laws[k].index.size]
                if pushing or pushed_ever[j]:
                    before, pushed_ever[j] = law.lam, True
                    law.answer(gaps[j], sum((self._pushed(j, k) for k in pushing), np.zeros(len(law.lam))))
                    change += abs(law.lam - before).sum()
                size += law.lam.sum()
            if change <= _SETTLED * size:
                return
        if change > _UNSETTLED * size:
            raise ComplementarityError(
                f"the forces of {len(self.laws)} contacts on common bodies did not settle in {_SWEEPS} sweeps; the "
                f"last changed them by {change / size:.2g}. Patches that overlap or touch move each other too much: "
                "keep the patches apart, or join them to one patch"
            )

    def _pushed(self, j: int, k: int) -> Array:
        """What the forces of the k-th contact add to the gaps of the j-th, (nr,) [m]."""
        lam = self.laws[k].lam
        if self._constant(j) is not None and self._constant(k) is not None:
            return self._between(j, k) @ lam
        value: Array = sum(
            rows @ (flexibility @ (columns.T @ lam))
            for side, other_side, flexibility in self._links[j, k]
            for rows, columns in [(self._side_rows(j, side), self._side_rows(k, other_side))]
        )
        return value

    def _between(self, j: int, k: int) -> Array:
        """Flexibility between the rows of two contacts, (nr, nr) [m/N], kept as long as the rows stay the same."""
        stay = self._constant(j), self._constant(k)
        kept = self._kept.get((j, k))
        if kept is not None and None not in stay and kept[0] is stay[0] and kept[1] is stay[1]:
            return kept[2]
        blocks = [
            dense(self._side_rows(j, side) @ (self._side_rows(k, other_side) @ between.T).T)
            for side, other_side, between in self._links[j, k]
        ]
        F = np.sum(blocks, axis=0)
        self._kept[j, k] = (*stay, F)
        value: Array = F
        return value

    def _constant(self, j: int) -> object:
        return self.laws[j].gaps.constant_rows

    def _side_rows(self, j: int, side: int) -> Rows:
        if (j, side) not in self._rows:
            self._rows[j, side] = self.laws[j].gaps.side_rows(side)
        return self._rows[j, side]
