"""Several contacts on one body: through its residual flexibility, a force on one patch moves the others."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg

from ...errors import ComplementarityError
from ...frames.kinematics import Rows
from ...support.arrays import Array, consecutive
from ..gaps import dense
from .compliance import ComplianceContact
from .frictional_compliance import FrictionalCompliance

Compliant = ComplianceContact | FrictionalCompliance

_SWEEPS = 100
_SETTLED = 1e-11  # change of the forces in a sweep, relative
_SETTLED_WITH_FRICTION = 1e-9  # forces with friction are known to a tenth of it
_UNSETTLED = 1e-6  # relative change in the last sweep above which the forces are rejected


class CoupledContacts:
    """Compliance contacts that share bodies, solved together.

    The forces of all contacts minimise one potential, 1/2 lambda' F lambda + lambda' h over lambda >= 0, with F of all
    rows. Block Gauss-Seidel converges to the minimum, because F is positive definite. It converges fast, because one
    patch moves another only a little. With friction there is no potential, but the sweeps are the same: tangential
    forces push too, and tangential places are pushed by what the forces have changed since the last accepted step.

    Parameters
    ----------
    laws : list of ComplianceContact or FrictionalCompliance
    links : list of (int, int, int, int, (d np, d np) array)
        Numbers of a law and its side, of the other law and its side, and the body's flexibility between the patches
        [m/N].
    """

    def __init__(self, laws: Sequence[Compliant], links: list[tuple[int, int, int, int, Array]]) -> None:
        self.laws = [*laws]
        self._links: dict[tuple[int, int], list[tuple[int, int, Array]]] = {}
        for j, side, k, other_side, between in links:
            self._links.setdefault((j, k), []).append((side, other_side, between))
        self._neighbours = [[k for own, k in self._links if own == j] for j in range(len(laws))]
        self._at: Array | None = None
        self._inverse: Array | None = None
        self._rows: dict[tuple[int, int], Rows] = {}
        self._kept: dict[tuple[int, int], tuple[object, object, Array]] = {}
        self._frictional = any(law.friction is not None for law in laws)
        self._begin()

    def _begin(self) -> None:
        """Forget the forces of the last accepted step, which frictionless laws do not keep themselves."""
        self._since: list[float] = []
        self._last = [np.zeros(len(law.node_areas)) for law in self.laws]

    def for_run(self, laws: Sequence[Compliant]) -> CoupledContacts:
        """Return the same object for the laws of a run; flexibilities between constant rows are shared."""
        result = copy.copy(self)
        result.laws, result._at, result._inverse, result._rows = [*laws], None, None, {}
        result._begin()
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
        since = [law.since for law in self.laws]
        at = np.concatenate([state, since, *(law.gaps.carrier_pose for law in self.laws)])
        if self._frictional and self._since != since:
            self._since = since
            for law, last in zip(self.laws, self._last, strict=True):
                last[:] = 0.0
                last[law.row_nodes] = law.lam
        if self._at is None or not np.array_equal(at, self._at):
            self._at, self._forces, self._inverse = at, self._find(coordinates()), None
        return self._forces

    def stiffness(self, law: Compliant, other: Compliant) -> Array:
        """Change of forces on closed rows of `law` by gaps of closed rows of `other`, (na, nb) [N/m].

        All other gaps are held. With friction, rows have three directions each, as in `Law.row_stiffness`.
        """
        if self._inverse is None:
            self._closed = consecutive([len(law.directions(law.index)) for law in self.laws])
            self._inverse = self._frictional_stiffness() if self._frictional else np.linalg.inv(self._flexibility())
        rows, columns = self._closed[self.laws.index(law)], self._closed[self.laws.index(other)]
        return self._inverse[rows, columns]

    def _flexibility(self) -> Array:
        """Flexibility of the closed rows of all contacts, (n, n) [m/N]."""
        F = self._flexibility_between()
        for law, own in zip(self.laws, self._closed, strict=True):
            assert isinstance(law, ComplianceContact)
            F[own, own] = law.active_flexibility()
        return F

    def _flexibility_between(self) -> Array:
        """Flexibility of the closed rows of all contacts, (n, n) [m/N], with zero blocks for each contact's own."""
        F = np.zeros((self._closed[-1].stop,) * 2)
        for j, k in self._links:
            own, others = (law.directions(law.index) for law in (self.laws[j], self.laws[k]))
            F[self._closed[j], self._closed[k]] += self._between(j, k)[np.ix_(own, others)]
        return F

    def _frictional_stiffness(self) -> Array:
        """Changes of all forces by gaps and tangential places: d lambda = -D (dh + F_between d lambda)."""
        D = scipy.linalg.block_diag(*(law.row_stiffness() for law in self.laws))
        value: Array = np.linalg.solve(np.eye(len(D)) + D @ self._flexibility_between(), D)
        return value

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
        settled = _SETTLED_WITH_FRICTION if self._frictional else _SETTLED
        for _ in range(_SWEEPS):
            change = size = 0.0
            for j, law in enumerate(self.laws):
                pushing = [k for k in self._neighbours[j] if self.laws[k].pushes]
                if pushing or pushed_ever[j]:
                    before, pushed_ever[j] = law.forces, True
                    law.answer(gaps[j], sum((self._pushed(j, k) for k in pushing), np.zeros(before.shape)))
                    change += abs(law.forces - before).sum()
                size += law.lam.sum()
            if change <= settled * size:
                return
        if change > _UNSETTLED * size:
            raise ComplementarityError(
                f"the forces of {len(self.laws)} contacts on common bodies did not settle in {_SWEEPS} sweeps; the "
                f"last changed them by {change / size:.2g}. Patches that overlap or touch move each other too much: "
                "keep the patches apart, or join them to one patch"
            )

    def _pushed(self, j: int, k: int) -> Array:
        """What the forces of the k-th contact add to the places of the j-th, in the shape of its forces [m].

        These are gaps, and with friction also tangential places since the last accepted step.
        """
        law, other = self.laws[j], self.laws[k]
        pushed = self._moved(j, k, other.forces).reshape(law.forces.shape)
        if law.friction is not None:
            last = other.last_forces() if isinstance(other, FrictionalCompliance) else self._last[k][other.row_nodes]
            pushed[:, 1:] -= self._moved(j, k, last).reshape(-1, 3)[:, 1:]
        return pushed

    def _moved(self, j: int, k: int, forces: Array) -> Array:
        if self._constant(j) is not None and self._constant(k) is not None:
            return np.asarray(self._between(j, k) @ forces.ravel())
        value: Array = sum(
            rows @ (flexibility @ (columns.T @ forces.ravel()))
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
            self._rows[j, side] = self.laws[j].side_rows(side)
        return self._rows[j, side]
