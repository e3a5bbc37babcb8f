"""Contacts that share a body: which of them are solved together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..contact.formulations.formulation import SharedBody
from ..contact.smooth_faces import SmoothFace
from ..contact.spot_gaps import SpotGaps
from ..errors import InputError
from ..support.arrays import consecutive
from .contact_group import ContactGroup
from .partition_contact import PartitionContact


def groups_to_join(contact: PartitionContact, beside: Sequence[PartitionContact]) -> list[ContactGroup]:
    """Groups of contacts whose forces move the rows of a new one, or whose rows move by its forces.

    `beside` are the contacts that share a body with it. No group changes.

    Raises
    ------
    InputError
        If no formulation solves all of them together.
    """
    groups = _groups_of(contact, beside)
    if groups:
        contact.joined.check(groups)
    return groups


def _groups_of(contact: PartitionContact, beside: Sequence[PartitionContact]) -> list[ContactGroup]:
    """Groups of the contacts beside it that a contact is solved together with, each once."""
    groups: dict[ContactGroup, None] = {}
    anywhere, sides = contact.mechanics.gaps.anywhere, _places_of(contact)
    for neighbour in beside:
        same = sides == _places_of(neighbour)
        if same and (len(contact.sides) > 1 or contact.master is neighbour.master):
            raise InputError(
                f"slave, master: these two already have the contact {neighbour.name!r} between the same patches"
            )
        if anywhere and neighbour.mechanics.gaps.anywhere and neighbour.joined in groups:
            continue  # all of these have one formulation
        for place, (item, patch) in enumerate(contact.sides):
            for neighbour_place, (neighbour_item, neighbour_patch) in enumerate(neighbour.sides):
                if item != neighbour_item or contact.compliant != neighbour.compliant:
                    continue
                shared = SharedBody(
                    item.body,
                    item.name,
                    (patch, neighbour_patch),
                    item.kinematics.mass,
                    (_columns(contact)[place], _columns(neighbour)[neighbour_place]),
                    neighbour.name,
                )
                if contact.formulation.couples(contact.mechanics, neighbour.mechanics, shared):
                    groups[neighbour.joined] = None
    return [*groups]


def _places_of(contact: PartitionContact) -> tuple[set[Any], bool]:
    """Patches of a contact with the faces on which its point is, and whether it has rows at edges of the master.

    Between the same patches, such rows are a second contact, and so is each point of other faces.
    """
    return {*zip(contact.sides, _faces(contact), strict=True)}, contact.rows == "edges"


def _faces(contact: PartitionContact) -> Sequence[SmoothFace | None]:
    """Face of each side's patch on which its point is; none of contacts by rows."""
    gaps = contact.mechanics.gaps
    return gaps.faces if isinstance(gaps, SpotGaps) else [None] * len(contact.sides)


def _columns(contact: PartitionContact) -> list[slice]:
    """Places of the coordinates of each side among the contact's."""
    return consecutive([item.body.n_dofs for item, _ in contact.sides])
