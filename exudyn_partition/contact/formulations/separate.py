"""Contacts of which each finds its forces alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...support.arrays import Array
from ..patch_contact import PatchContact


class Separate:
    """Contacts whose forces do not depend on each other within a step.

    Parameters
    ----------
    contacts : sequence of PatchContact
    """

    def __init__(self, contacts: Sequence[PatchContact]) -> None:
        self._contacts = [*contacts]

    def for_run(self, contacts: Sequence[PatchContact]) -> Separate:
        """See `formulation.Together`."""
        return Separate(contacts)

    def forces(self, coordinates: Sequence[Array]) -> list[Array]:
        """Generalised forces of each contact, (n,), at its coordinates, (n,)."""
        return [contact.at(q).generalised for contact, q in zip(self._contacts, coordinates, strict=True)]

    def stiffness(self, rows: Mapping[int, Array]) -> dict[tuple[int, int], Array]:
        """See `formulation.Together`."""
        return {(j, j): self._contacts[j].evaluation.stiffness_along(H) for j, H in rows.items()}

    def closed_stiffness(self, places: Sequence[int]) -> dict[tuple[int, int], Array]:
        """See `formulation.Together`."""
        alone = {j: self._contacts[j].closed_stiffness() for j in places}
        return {(j, j): K for j, K in alone.items() if K is not None}
