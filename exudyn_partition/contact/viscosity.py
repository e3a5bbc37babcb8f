"""Viscosity of the residual flexibility: stiffness-proportional damping of what the modes lack of the static answer.

The residual flexibility F of a side yields with the time beta of its body's damping: d + beta dd/dt = F lambda, or
d = F lambda_e with lambda_e + beta d lambda_e/dt = lambda. lambda_e are the forces that F carries elastically.

Theory: examples/site/theory.md, "Damping".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..support.arrays import Array
from .memory import by_nodes, normal_by_nodes, on_rows
from .normal_rows import NormalRows
from .tangential import TangentialRows

_NOTHING = 1e-12  # of the largest elastic forces so far: what is left of them moves nothing


Rows = NormalRows | TangentialRows


@dataclass(frozen=True, eq=False)
class ViscousMemory:
    """What a contact with viscous sides remembers of the last accepted step.

    Parameters
    ----------
    elastic, excess : tuple of (np, k) arrays
        For each side: forces that its flexibility carries elastically, and what the forces on the rows exceed them by
        [N]. They are stored at the slave's nodes, because rows appear and vanish. Empty if nothing is left of them.
    largest : float
        Largest elastic force so far [N].
    dissipated : float
        Energy that the viscosity has dissipated since the start of the run [J].
    """

    elastic: tuple[Array, ...] = ()
    excess: tuple[Array, ...] = ()
    largest: float = 0.0
    dissipated: float = 0.0

    def after(self, rows: Rows, lam: Array, elastic: Sequence[Array], n: int, taken: float) -> ViscousMemory:
        """Return the memory after the next step.

        Parameters
        ----------
        rows : Rows
        lam : (nr, d) array
            Forces on the rows at the end of the step [N].
        elastic : sequence of (nr, d) arrays
            Forces that each side carries elastically then [N].
        n : int
            Number of nodes of the slave's patch.
        taken : float
            Energy that was dissipated in the step [J].
        """
        most = max(float(abs(on_side).max(initial=0.0)) for on_side in elastic)
        largest, dissipated = max(most, self.largest), self.dissipated + taken
        if most <= _NOTHING * largest:
            return ViscousMemory(largest=largest, dissipated=dissipated)
        kept = tuple(_kept(rows, on_side, n) for on_side in elastic)
        excess = tuple(_kept(rows, lam - on_side, n) for on_side in elastic)
        return ViscousMemory(kept, excess, largest, dissipated)


def _kept(rows: Rows, forces: Array, n: int) -> Array:
    """Forces on the present rows, (nr, d) [N], stored for the n nodes of the slave's patch, (n, k)."""
    if isinstance(rows, TangentialRows):
        return by_nodes(rows, forces[:, 0], rows.tractions(forces), n)
    return normal_by_nodes(rows.gaps.row_nodes, forces, n)


def shares(times: Sequence[float], step: float) -> tuple[float, ...]:
    """Share h / (h + beta) of each side's flexibility that yields within a step h [s]; all of it if nothing moves.

    `times` are the times beta of the sides [s].
    """
    return tuple(step / (step + beta) if step > 0.0 else 1.0 for beta in times)


def moved(rows: Rows, forces: Sequence[Array]) -> list[Array]:
    """Displacements of the present rows by the residual flexibility of each side, (nr, d) each [m].

    `forces` are those on the rows, as each side carries them, (nr, d) each [N]. A body that touches itself moves one
    side by the forces on the other, too.
    """
    gaps, displacements = rows.gaps, []
    for place, (side, on_side) in enumerate(zip(gaps.sides, forces, strict=True)):
        some = rows.directions(np.flatnonzero(on_side.any(axis=1)))  # few rows of many carry forces
        if side.flexibility is None or not len(some):
            displacements.append(np.zeros_like(on_side))
        else:
            displacements.append((on_side.ravel()[some] @ rows.side_flexibility(place)[some]).reshape(on_side.shape))
    if gaps.between is not None:
        across = rows.across()
        displacements[0] += (across @ forces[1].ravel()).reshape(displacements[0].shape)
        displacements[1] += (forces[0].ravel() @ across).reshape(displacements[1].shape)
    return displacements


class Creep(NamedTuple):
    """State of the flexibilities of a contact's sides at an answer of its law.

    Parameters
    ----------
    elastic : list of (nr, d) arrays
        Forces that each side carries elastically [N].
    stored : float
        Energy that they store [J].
    taken : float
        Energy that the viscosity has dissipated in the step [J].
    """

    elastic: list[Array]
    stored: float
    taken: float


class Yielding:
    """How the flexibilities of a contact's sides yield in the present step, if some are viscous.

    Parameters
    ----------
    rows : NormalRows or TangentialRows
    memory : ViscousMemory
        Of the last accepted step.

    Attributes
    ----------
    before : list of (nr, d) arrays
        Forces that each side carried elastically at the end of the last accepted step [N].
    """

    def __init__(self, rows: Rows, memory: ViscousMemory) -> None:
        self.rows, self._memory, self._stage = rows, memory, rows.gaps.stage
        self.shares = rows.gaps.yielding_shares
        self.before = self._on_rows(memory.elastic)
        self._moved_before: list[Array] | None = None
        self._lasting: Array | None = None

    def is_current(self, memory: ViscousMemory) -> bool:
        """Whether this is still so: neither the memory, nor the rows, nor the step have changed."""
        return memory == self._memory and self.rows.gaps.stage == self._stage

    def _on_rows(self, kept: Sequence[Array]) -> list[Array]:
        if kept:
            return [on_rows(self.rows, on_side) for on_side in kept]
        none = np.zeros((len(self.rows.gaps.row_nodes), self.rows.d))
        return [none] * len(self.rows.gaps.sides)

    def lasting(self, last: Array) -> Array | None:
        """Displacements of the rows in this step beside those by its forces, (nr, d) [m]; None if there are none.

        Gaps still have a share of the displacements of the last step. Tangential places count from the end of that
        step, and a law takes off what the last forces would have moved them.

        Parameters
        ----------
        last : (nr, 3) array
            Forces on the rows at the end of the last accepted step [N].
        """
        if self._lasting is None and self._memory.elastic:
            moved_before = since = self._moved_before = moved(self.rows, self.before)
            if self.rows.d > 1:
                since = moved(self.rows, [last - on_side for on_side in self.before])
            self._lasting = lasting(self.shares, moved_before, since)
        return self._lasting

    def elastic(self, lam: Array) -> list[Array]:
        """Forces that each side carries elastically, (nr, d) [N], at forces lam, (nr, d) [N], on the rows."""
        both = zip(self.shares, self.before, strict=True)
        return [share * lam + (1.0 - share) * before for share, before in both]

    def creep(self, lam: Array, across: list[Array] | None, across_before: list[Array] | None) -> Creep:
        """State at the forces lam, (nr, d) [N], on the rows. Work in the step is found by the trapezoidal rule.

        `across` and `across_before` are displacements of each side by the elastic forces of other contacts, (nr, d)
        each [m], now and at the end of the last accepted step; None without any.
        """
        elastic, late = self.elastic(lam), self._on_rows(self._memory.excess)
        before = moved(self.rows, self.before) if self._moved_before is None else self._moved_before
        stored = taken = 0.0
        for side, (on_side, now) in enumerate(zip(elastic, moved(self.rows, elastic), strict=True)):
            way = now - before[side]
            if across is not None:
                now = now + across[side]
                way = way + across[side]
            if across_before is not None:
                way = way - across_before[side]
            stored += 0.5 * float(np.vdot(on_side, now))
            taken += 0.5 * float(np.vdot(lam - on_side + late[side], way))
        return Creep(elastic, stored, taken)


def lasting(shares: Sequence[float], by_elastic: Sequence[Array], since: Sequence[Array]) -> Array:
    """See `Yielding.lasting`, which gives displacements by the elastic forces, and by what `last` exceeds these [m]."""
    total = np.zeros_like(by_elastic[0])
    for share, elastic, more in zip(shares, by_elastic, since, strict=True):
        total[:, 0] += (1.0 - share) * elastic[:, 0]
        total[:, 1:] += share * more[:, 1:]
    return total
