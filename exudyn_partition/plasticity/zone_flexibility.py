"""Residual flexibility of the nodes of a plastic zone, without a solution for each of them.

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..algebra.sparse.flexibility import KeptFlexibility
from ..support.arrays import Array
from ..support.checks import check_floats, read_only

_BLOCK = 96  # rows that are found together


@dataclass(frozen=True, eq=False)
class ZoneFlexibility:
    """Flexibility of a zone [m/N], of all motion or of what the kept shapes leave.

    Parameters
    ----------
    own : KeptFlexibility
        Of the zone's nodes by forces there, 3 nz dofs.
    of_patch : (3 nz, r) array
        Displacements of the zone's nodes by forces on the rows of the zone's patch.
    """

    own: KeptFlexibility
    of_patch: Array

    def __post_init__(self) -> None:
        check_floats("of_patch", self.of_patch, (len(self.own), None))
        read_only(self.of_patch)

    def __getstate__(self) -> dict[str, object]:
        """Return the fields alone, for pickle: rows are found again."""
        return {"own": self.own, "of_patch": self.of_patch}

    @cached_property
    def single_own(self) -> KeptFlexibility:
        """`own` in single precision: all runs with this body share it."""
        return self.own.single()

    @cached_property
    def single_of_patch(self) -> Array:
        """Transpose of `of_patch`, (r, 3 nz), in single precision: all runs with this body share it."""
        return np.ascontiguousarray(self.of_patch.T, np.float32)

    def rows(self, dofs: Array) -> Array:
        """Displacements of all nodes by unit forces on some of their dofs, (k,): (k, 3 nz) [m/N], which are kept."""
        known, rows = self._rows
        missing = dofs[~known[dofs]]
        for first in range(0, len(missing), _BLOCK):
            some = missing[first : first + _BLOCK]
            loaded = self.own.at(some)
            rows[some] = loaded.spread(loaded.answer(np.eye(len(some)))[1]).T
            known[some] = True
        return rows[dofs]

    @cached_property
    def _rows(self) -> tuple[Array, Array]:
        """Which rows are known, and all; those that are not take no memory."""
        n = len(self.own)
        return np.zeros(n, dtype=bool), np.empty((n, n))

    def without(self, at_zone: Array, at_patch: Array, omega: Array) -> ZoneFlexibility:
        """Return what is left without the static answer of shapes: F - Phi W^-2 Phi'.

        Parameters
        ----------
        at_zone, at_patch : (3 nz, k), (r, k) arrays
            Mass-normalised shapes.
        omega : (k,) array
            Their circular frequencies [rad/s].
        """
        weights = omega**-2.0
        return ZoneFlexibility(self.own.plus(at_zone, -weights), self.of_patch - ((at_patch * weights) @ at_zone.T).T)
