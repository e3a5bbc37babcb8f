"""Contacts that share a body: which of them are solved together."""

from __future__ import annotations

from ..contact.formulations.formulation import SharedBody
from ..errors import InputError
from ..exudyn_bodies.partition_body import PartitionBody
from ..support.arrays import Array, consecutive
from .partition_contact import PartitionContact


def solve_together(contact: PartitionContact, others: list[PartitionContact]) -> None:
    """Join a new contact to those whose forces move its rows, and to those whose rows move by its forces.

    Raises
    ------
    InputError
        If no formulation solves both together.
    """
    group = coupled_with(contact, others)
    together = contact.formulation.together([member.mechanics for member in group], _Links(group))
    for member in group:
        member.group, member.together = group, together


def coupled_with(contact: PartitionContact, others: list[PartitionContact]) -> list[PartitionContact]:
    """Return the contact and all that it is solved together with, directly or through other contacts."""
    group = {contact: None}  # an ordered set
    bodies = {item for item, _ in contact.sides}
    for other in others:
        if not any(item in bodies for item, _ in other.sides):
            continue
        if _same_sides(contact, other):
            raise InputError(
                f"slave, master: these two already have the contact {other.name!r} between the same patches"
            )
        for place, (item, patch) in enumerate(contact.sides):
            for other_place, (other_item, other_patch) in enumerate(other.sides):
                if item != other_item or contact.compliant != other.compliant:
                    continue
                shared = SharedBody(
                    item.body,
                    item.name,
                    (patch, other_patch),
                    item.kinematics.mass,
                    (_columns(contact)[place], _columns(other)[other_place]),
                    other.name,
                )
                if contact.formulation.couples(contact.mechanics, other.mechanics, shared):
                    group |= dict.fromkeys(other.group)
    return [*group]


def _same_sides(contact: PartitionContact, other: PartitionContact) -> bool:
    """Whether two contacts are between the same patches, or of the same patch with the same rigid surface.

    The rows at the edges of the master are a second contact.
    """
    sides, others = (({*each.sides}, each.rows == "edges") for each in (contact, other))
    return sides == others and (len(contact.sides) > 1 or contact.master is other.master)


def _columns(contact: PartitionContact) -> list[slice]:
    """Places of the coordinates of each side among the contact's."""
    return consecutive([item.body.n_dofs for item, _ in contact.sides])


class _Links:
    """See `formulation.Links`.

    Parameters
    ----------
    contacts : list of PartitionContact
    """

    def __init__(self, contacts: list[PartitionContact]) -> None:
        self._contacts = contacts

    @property
    def shared(self) -> bool:
        """Whether contacts share a patch."""
        sides = [side for contact in self._contacts for side in {*contact.sides}]
        return len(set(sides)) < len(sides)

    def __call__(self) -> list[tuple[int, int, int, int, Array]]:
        """Pairs of sides of which one pushes the other, and the flexibility between their patches."""
        of_body: dict[PartitionBody, list[tuple[int, int, PartitionBody, int]]] = {}
        for j, contact in enumerate(self._contacts):
            for s, (item, patch) in enumerate(contact.sides):
                if item.body.basis.flexibility is not None:
                    of_body.setdefault(item, []).append((j, s, item, patch))
        return [
            (j, s, k, r, item.body.flexibility(patch, other_patch))
            for sides in of_body.values()
            for j, s, item, patch in sides
            for k, r, _, other_patch in sides
            if j != k
        ]
