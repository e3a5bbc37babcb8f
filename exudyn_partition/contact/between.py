"""Flexibility between the rows of contacts on common bodies, in full or through a few fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp

from ..algebra.block_complementarity import shared_fields
from ..algebra.sparse.skin_flexibility import Flexibility
from ..frames.kinematics import Rows
from ..support.arrays import Array
from .gaps import Gaps
from .stages import Standing

_NONE = np.zeros(1, dtype=bool)

# Of each contact and side: how much of the flexibility of its body counts.
Shares = Sequence[Sequence[float]]

# Numbers of a contact and its side, of another and its side, and the body's flexibility between the patches [m/N].
Link = tuple[int, int, int, int, Flexibility]


class HasRows(Protocol):
    """The part of a contact's rows that is needed here."""

    d: int

    @property
    def gaps(self) -> Gaps:
        """Gaps of the rows."""

    def side_rows(self, side: int) -> Rows:
        """Present rows on the flexibility coordinates of one side's patch, (nr, d np)."""

    def side_flexibility(self, place: int) -> Array:
        """Contribution of one side to the flexibility of the present rows, (d nr, d nr) [m/N]."""

    def standing(self) -> Standing:
        """Where the rows stand."""


class Between(Protocol):
    """Motion of the rows of each contact that forces on the rows of others cause."""

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Numbers of the contacts that move each other."""

    def versions(self) -> list[int]:
        """How often the data of each contact's rows were found, after a look whether they have moved since."""

    def flexibility(self, j: int, rows: Array, k: int, pushing_rows: Array) -> Array:
        """Motion of some rows of contact j due to unit forces on some rows of contact k, (na, nb) [m/N].

        Of contacts with friction, `rows` and `pushing_rows` are numbers of directions, see `tangential`.
        """

    def pushing(self, k: int, rows: Array, forces: Array) -> Any:
        """Forces on some rows of contact k, (na,) [N], as they reach others, even when k has other rows."""

    def moved(self, j: int, pushing: Mapping[int, Any]) -> Array:
        """Motion of all present rows of contact j, (d nr,) [m], by what contacts push others with, see `pushing`."""

    def closing(self, j: int, pushing: Mapping[int, Any]) -> Array:
        """Changes of the gaps in `moved`, (nr,) [m]."""

    def across(self, forces: Sequence[Sequence[Array]]) -> list[list[Array]]:
        """Displacements of the present rows of each side of each contact, (nr, d) [m], by forces on other contacts.

        `forces`, (nr, d) [N], are those on the rows of all contacts, as each of their sides carries them.
        """


class FlexibilityBetween(Between):
    """Motion through all nodes of the patches.

    Rows of a side are kept while they move little, because the many neighbours of a contact all need them.

    Parameters
    ----------
    rows : sequence of HasRows
        Of the contacts.
    links : sequence of Link
    """

    def __init__(self, rows: Sequence[HasRows], links: Sequence[Link]) -> None:
        self._contacts = rows
        self._links: dict[tuple[int, int], list[tuple[int, int, Flexibility]]] = {}
        for j, side, k, pushing_side, between in links:
            self._links.setdefault((j, k), []).append((side, pushing_side, between))
        self._kept: dict[tuple[int, int], tuple[Standing, Array, Array]] = {}
        self._sides = {(j, side) for j, side, *_ in links}
        self._versions = [0] * len(rows)

    def versions(self) -> list[int]:
        """See `Between`."""
        for j, side in self._sides:
            self._rows(j, side)
        return self._versions

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """See `Between`."""
        return [*self._links]

    def flexibility(self, j: int, rows: Array, k: int, pushing_rows: Array) -> Array:
        """See `Between`."""
        result = np.zeros((len(rows), len(pushing_rows)))
        for side, pushing_side, between in self._links.get((j, k), []):
            (left, used), (right, pushing) = self._rows(j, side), self._rows(k, pushing_side)
            result += self._yields(j, side) * (left[rows] @ between[np.ix_(used, pushing)] @ right[pushing_rows].T)
        return result

    def pushing(self, k: int, rows: Array, forces: Array) -> dict[int, tuple[Array, Array]]:
        """See `Between`; of each side, numbers of the patch's coordinates, and forces on these."""
        on_coordinates = {side: self._rows(k, side) for contact, side in self._sides if contact == k}
        return {side: (used, forces @ of_rows[rows]) for side, (of_rows, used) in on_coordinates.items()}

    def moved(self, j: int, pushing: Mapping[int, dict[int, tuple[Array, Array]]]) -> Array:
        """See `Between`."""
        result = np.zeros(self._contacts[j].d * len(self._contacts[j].gaps.row_nodes))
        for k, of_sides in pushing.items():
            for side, pushing_side, between in self._links.get((j, k), []):
                (left, used), (loaded, forces) = self._rows(j, side), of_sides[pushing_side]
                result += self._yields(j, side) * (left @ (between[np.ix_(used, loaded)] @ forces))
        return result

    def closing(self, j: int, pushing: Mapping[int, dict[int, tuple[Array, Array]]]) -> Array:
        """See `Between`."""
        return self.moved(j, pushing)[:: self._contacts[j].d]

    def across(self, forces: Sequence[Sequence[Array]]) -> list[list[Array]]:
        """See `Between`."""
        result = [[np.zeros_like(on_rows) for on_rows in sides] for sides in forces]
        for (j, k), links in self._links.items():
            for side, pushing_side, between in links:
                (left, used), (right, pushing) = self._rows(j, side), self._rows(k, pushing_side)
                moved = left @ (between[np.ix_(used, pushing)] @ (forces[k][pushing_side].ravel() @ right))
                result[j][side] += moved.reshape(result[j][side].shape)
        return result

    def _yields(self, j: int, side: int) -> float:
        """Share of the flexibility of a side's body that yields within the step."""
        yielding = self._contacts[j].gaps.yielding
        return 1.0 if yielding is None else yielding[side]

    def _rows(self, j: int, side: int) -> tuple[Array, Array]:
        """Present rows of a side on the coordinates that they need, (nr, m), and these coordinates' numbers, (m,)."""
        contact, kept = self._contacts[j], self._kept.get((j, side))
        standing = contact.standing()
        if kept is None or standing != kept[0]:
            matrix = contact.gaps.anchoring.found_at(standing.anchor, lambda: sp.csr_matrix(contact.side_rows(side)))
            used = np.unique(matrix.indices)
            kept = self._kept[j, side] = standing, matrix[:, used].toarray(), used
            self._versions[j] += 1
        return kept[1:]


@dataclass(frozen=True, eq=False)
class Exchange:
    """Displacement fields through which patches of common bodies move each other.

    Parameters
    ----------
    fields : dict of int to list of (int, (d np, m) array)
        For each contact, the number of a side and the fields of its patch. The fields of both sides of a contact are
        numbered together: the columns of a side are zero where the other side has its fields.
    core : dict of (int, int) to (m, m) array
        Amplitudes of the fields of one contact due to unit amplitudes of another [m/N].
    neighbours : dict of int to list of int
        Contacts that move the rows of each.
    """

    fields: dict[int, list[tuple[int, Array]]]
    core: dict[tuple[int, int], Array]
    neighbours: dict[int, list[int]]

    @classmethod
    def of(cls, links: Sequence[Link]) -> Exchange:
        """Find the fields of some links, see `CoupledContacts`. Equal patches of equal bodies are computed once."""
        blocks: dict[tuple[int, int], list[Array]] = {}
        for j, side, _, _, between in links:
            assert isinstance(between, np.ndarray)  # of others few fields are not known, see `Links.on_demand`
            blocks.setdefault((j, side), []).append(between)
        once: dict[tuple[object, ...], Array] = {}
        on_patches: dict[tuple[int, int], Array] = {}
        for patch, blocks_of_patch in blocks.items():
            key = tuple(map(_identity, blocks_of_patch))
            if key not in once:
                once[key] = shared_fields(blocks_of_patch)
            on_patches[patch] = once[key]
        places, ends = dict[tuple[int, int], int](), dict[int, int]()
        for (j, side), patch_fields in on_patches.items():
            places[j, side] = ends.get(j, 0)
            ends[j] = places[j, side] + patch_fields.shape[1]
        size = max(ends.values(), default=0)
        fields: dict[int, list[tuple[int, Array]]] = {}
        for (j, side), patch_fields in on_patches.items():
            wide = np.zeros((len(patch_fields), size))
            wide[:, places[j, side] : places[j, side] + patch_fields.shape[1]] = patch_fields
            fields.setdefault(j, []).append((side, wide))
        core: dict[tuple[int, int], Array] = {}
        products: dict[tuple[object, ...], Array] = {}
        for j, side, k, pushing_side, between in links:
            patch_fields, pushing_fields = on_patches[j, side], on_patches[k, pushing_side]
            assert isinstance(between, np.ndarray)
            both = (_identity(between), id(patch_fields), id(pushing_fields))
            if both not in products:
                products[both] = patch_fields.T @ between @ pushing_fields
            block, row, column = (
                core.setdefault((j, k), np.zeros((size, size))),
                places[j, side],
                places[k, pushing_side],
            )
            block[row : row + patch_fields.shape[1], column : column + pushing_fields.shape[1]] += products[both]
        neighbours: dict[int, list[int]] = {}
        for j, k in core:
            neighbours.setdefault(j, []).append(k)
        return cls(fields, core, neighbours)

    @cached_property
    def _of_sides(self) -> dict[tuple[int, int], Array]:
        return {(j, side): np.asarray(wide.any(axis=0)) for j, sides in self.fields.items() for side, wide in sides}

    def of_side(self, j: int, side: int) -> Array:
        """Which fields of contact j are those of a side, (m,) bool."""
        return self._of_sides.get((j, side), _NONE)

    def yielding(self, shares: Shares) -> dict[tuple[int, int], Array]:
        """Return `core` if only shares of the bodies' flexibilities yield, by the sides of the contacts."""
        core = {}
        for (j, k), block in self.core.items():
            rows = sum(share * self.of_side(j, side) for side, share in enumerate(shares[j]))
            core[j, k] = np.reshape(rows, (-1, 1)) * block
        return core


def shared_flexibility(rows: HasRows, shares: Sequence[float]) -> Array:
    """Flexibility of the present rows of a contact, (d nr, d nr) [m/N], with shares of those of its sides."""
    parts = [share * rows.side_flexibility(place) for place, share in enumerate(shares)]
    return np.asarray(np.sum(parts, axis=0))


class RowFields(Between):
    """Motion through few fields of the patches.

    Displacements of the rows in the fields change slowly. They are kept while the rows move little.

    Parameters
    ----------
    rows : sequence of HasRows
        Of the contacts.
    exchange : Exchange
    """

    def __init__(self, rows: Sequence[HasRows], exchange: Exchange) -> None:
        self._contacts, self._exchange = rows, exchange
        self._kept: dict[int, tuple[Standing, Array, Array]] = {}
        self._versions = [0] * len(rows)
        self._shares: list[tuple[float, ...] | None] = [None] * len(rows)
        self._core: Mapping[tuple[int, int], Array] = exchange.core

    def versions(self) -> list[int]:
        """See `Between`."""
        return self._versions

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """See `Between`."""
        return [*self._exchange.core]

    @property
    def core(self) -> Mapping[tuple[int, int], Array]:
        """`Exchange.core` by what yields of the bodies within the present step."""
        shares = [rows.gaps.yielding for rows in self._contacts]
        if shares != self._shares:
            self._shares, self._core = shares, self._exchange.yielding([yielding or (1.0, 1.0) for yielding in shares])
        return self._core

    def fields(self, j: int) -> Array:
        """Displacements of the rows of contact j, (d nr, m)."""
        return self._on_rows(j)[1]

    def normal(self, j: int) -> Array:
        """Changes of the gaps of the rows of contact j, (nr, m)."""
        return self._on_rows(j)[2]

    def flexibility(self, j: int, rows: Array, k: int, pushing_rows: Array) -> Array:
        """See `Between`."""
        return np.asarray(self.fields(j)[rows] @ self.core[j, k] @ self.fields(k)[pushing_rows].T)

    def pushing(self, k: int, rows: Array, forces: Array) -> Array:
        """See `Between`; forces on its fields, (m,)."""
        return np.asarray(forces @ self.fields(k)[rows])

    def amplitudes(self, j: int, pushing: Mapping[int, Array]) -> Array:
        """Amplitudes of the fields of contact j, (m,), by what pushes others, see `pushing`."""
        near = (k for k in self._exchange.neighbours.get(j, ()) if k in pushing)
        return sum((self.core[j, k] @ pushing[k] for k in near), np.zeros(self.fields(j).shape[1]))

    def moved(self, j: int, pushing: Mapping[int, Array]) -> Array:
        """See `Between`."""
        return np.asarray(self.fields(j) @ self.amplitudes(j, pushing))

    def closing(self, j: int, pushing: Mapping[int, Array]) -> Array:
        """See `Between`."""
        return np.asarray(self.normal(j) @ self.amplitudes(j, pushing))

    def across(self, forces: Sequence[Sequence[Array]]) -> list[list[Array]]:
        """See `Between`."""
        exchange, pushing = self._exchange, []
        for k, sides in enumerate(forces):
            on_fields = [f.ravel() @ self.fields(k) * exchange.of_side(k, side) for side, f in enumerate(sides)]
            pushing.append(sum(on_fields, np.zeros(1)))
        result = []
        for j, sides in enumerate(forces):
            near = exchange.neighbours.get(j, [])
            c = sum((exchange.core[j, k] @ pushing[k] for k in near), np.zeros(1))
            moved = [
                self.fields(j) @ (c * exchange.of_side(j, side)) if near else 0 * on_rows
                for side, on_rows in enumerate(sides)
            ]
            result.append([np.reshape(motion, on_rows.shape) for motion, on_rows in zip(moved, sides, strict=True)])
        return result

    def _on_rows(self, j: int) -> tuple[Standing, Array, Array]:
        rows, kept = self._contacts[j], self._kept.get(j)
        standing = rows.standing()
        if kept is None or standing != kept[0]:
            fields = rows.gaps.anchoring.found_at(standing.anchor, lambda: self._in_fields(j))
            kept = self._kept[j] = standing, fields, np.ascontiguousarray(fields[:: rows.d])
            self._versions[j] += 1
        return kept

    def _in_fields(self, j: int) -> Array:
        rows = self._contacts[j]
        moved = [rows.side_rows(side) @ fields for side, fields in self._exchange.fields.get(j, ())]
        return np.sum(moved, axis=0) if moved else np.zeros((rows.d * len(rows.gaps.row_nodes), 0))


def _identity(block: Array) -> tuple[int, tuple[int, ...], tuple[int, ...]]:
    """Key that is equal for two views of the same flexibility, but not for that and its transpose."""
    return block.__array_interface__["data"][0], block.shape, block.strides
