"""Contacts that share a body: which of them are solved together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from ..algebra.sparse.skin_flexibility import Flexibility, SkinFlexibility
from ..contact.formulations.formulation import SharedBody
from ..contact.smooth_faces import SmoothFace
from ..contact.spot_gaps import SpotGaps
from ..errors import InputError
from ..exudyn_bodies.partition_body import PartitionBody
from ..support.arrays import consecutive
from .partition_contact import PartitionContact


def solve_together(contact: PartitionContact, beside: Sequence[PartitionContact]) -> None:
    """Join a new contact to those whose forces move its rows, and to those whose rows move by its forces.

    `beside` are the contacts that share a body with it.

    Raises
    ------
    InputError
        If no formulation solves both together.
    """
    group = [contact, *itertools.chain(*_groups_of(contact, beside))]
    together = contact.formulation.together([member.mechanics for member in group], _Links(group))
    for member in group:
        member.group, member.together = group, together


def _groups_of(contact: PartitionContact, beside: Sequence[PartitionContact]) -> list[list[PartitionContact]]:
    """Groups of the contacts beside it that a contact is solved together with, each once."""
    groups: dict[int, list[PartitionContact]] = {}
    anywhere = contact.mechanics.gaps.anywhere
    for neighbour in beside:
        if _same_sides(contact, neighbour):
            raise InputError(
                f"slave, master: these two already have the contact {neighbour.name!r} between the same patches"
            )
        if anywhere and neighbour.mechanics.gaps.anywhere and id(neighbour.group) in groups:
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
                    groups[id(neighbour.group)] = neighbour.group
    return [*groups.values()]


class Joining:
    """Contacts of a list of bodies, which are joined as they are made; who finds their forces is known at the end.

    There may be thousands of them, of which each shares its bodies with hundreds.
    """

    def __init__(self) -> None:
        self._new: list[PartitionContact] = []

    def join(self, contact: PartitionContact, beside: Sequence[PartitionContact]) -> None:
        """Join a new contact to those beside it whose forces move its rows; see `solve_together`."""
        groups = _groups_of(contact, beside)
        group = groups[0] if groups else []
        for other in groups[1:]:
            group.extend(other)
            for member in other:
                member.group = group
        group.append(contact)
        contact.group = group
        self._new.append(contact)

    def end(self) -> None:
        """Let the contacts of each group find their forces together."""
        for group in {id(contact.group): contact.group for contact in self._new}.values():
            together = group[0].formulation.together([member.mechanics for member in group], _Links(group))
            for member in group:
                member.together = together


def _same_sides(contact: PartitionContact, neighbour: PartitionContact) -> bool:
    """Whether two contacts are between the same patches, or of the same patch with the same rigid surface.

    The rows at the edges of the master are a second contact, and so is each point of other faces.
    """
    sides, neighbour_sides = (
        ({*zip(member.sides, _faces(member), strict=True)}, member.rows == "edges") for member in (contact, neighbour)
    )
    return sides == neighbour_sides and (len(contact.sides) > 1 or contact.master is neighbour.master)


def _faces(contact: PartitionContact) -> Sequence[SmoothFace | None]:
    """Face of each side's patch on which its point is; none of contacts by rows."""
    gaps = contact.mechanics.gaps
    return gaps.faces if isinstance(gaps, SpotGaps) else [None] * len(contact.sides)


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

    def some(self, places: Sequence[int]) -> _Links:
        """See `formulation.Links`."""
        return _Links([self._contacts[j] for j in places])

    @property
    def shared(self) -> bool:
        """Whether contacts share a patch."""
        sides = [side for contact in self._contacts for side in {*contact.sides}]
        return len(set(sides)) < len(sides)

    @property
    def on_demand(self) -> bool:
        """See `formulation.Links`."""
        bodies = (item.body for contact in self._contacts for item, _ in contact.sides)
        return any(isinstance(body.basis.flexibility, SkinFlexibility) for body in bodies)

    def __call__(self) -> list[tuple[int, int, int, int, Flexibility]]:
        """Pairs of sides of which one pushes the other, and the flexibility between their patches."""
        of_body: dict[PartitionBody, list[tuple[int, int, PartitionBody, int]]] = {}
        for j, contact in enumerate(self._contacts):
            for s, (item, patch) in enumerate(contact.sides):
                if item.body.basis.flexibility is not None:
                    of_body.setdefault(item, []).append((j, s, item, patch))
        return [
            (j, s, k, r, item.body.flexibility(patch, neighbour_patch))
            for sides in of_body.values()
            for j, s, item, patch in sides
            for k, r, _, neighbour_patch in sides
            if j != k
        ]
