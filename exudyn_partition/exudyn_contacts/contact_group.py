"""Contacts of a model that are solved together in every run."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

from ..algebra.sparse.skin_flexibility import Flexibility, SkinFlexibility
from ..contact.formulations.formulation import Formulation, Together
from ..exudyn_bodies.partition_body import PartitionBody


class ContactGroup:
    """Contacts whose forces are found together.

    It grows while contacts are created. Where two groups become one, the work is in proportion to the smaller one, so
    that chains of contacts may be long. Who finds the forces is known when somebody asks.

    Parameters
    ----------
    contact : PartitionContact
        The first of them.

    Attributes
    ----------
    members : list of PartitionContact
    """

    def __init__(self, contact: Any) -> None:
        self.members = [contact]
        self._formulation: Formulation = contact.formulation
        self._sides: set[tuple[PartitionBody, int]] = {*contact.sides}
        self._flows, self._whole = bool(contact.mechanics.flows), _on_demand(contact)
        self._together: Together | None = None  # found when somebody asks; new members need another one

    @property
    def together(self) -> Together:
        """Finds the forces of all members; each run has its own."""
        if self._together is None:
            members = [*self.members]
            self._together = self._formulation.together([member.mechanics for member in members], Links(members))
        return self._together

    def check(self, others: Sequence[ContactGroup]) -> tuple[bool, bool]:
        """Check that this group and others can be solved together, as one.

        Return whether some of them yield, and whether flexibilities are needed in full, see `Formulation.check_group`.

        Raises
        ------
        InputError
            If the formulation cannot do so.
        """
        groups = [self, *others]
        shared = any(not one._sides.isdisjoint(two._sides) for one, two in itertools.combinations(groups, 2))
        flows, whole = any(group._flows for group in groups), shared or any(group._whole for group in groups)
        self._formulation.check_group(flows=flows, whole=whole)
        return flows, whole

    def join(self, others: Sequence[ContactGroup]) -> None:
        """Become one group with others: the largest of them takes the members of all.

        Raises
        ------
        InputError
            See `check`. Then no group has changed.
        """
        flows, whole = self.check(others)
        largest, *smaller = sorted([self, *others], key=lambda group: len(group.members), reverse=True)
        largest._flows, largest._whole, largest._formulation = flows, whole, self._formulation
        for group in smaller:
            largest.members += group.members
            largest._sides |= group._sides
            for member in group.members:
                member.joined = largest
        largest._together = None


def groups_of(contacts: Iterable[Any]) -> list[list[Any]]:
    """Members of the groups to which contacts belong, each group once."""
    return [group.members for group in dict.fromkeys(contact.joined for contact in contacts)]


class Links:
    """See `formulation.Links`.

    Parameters
    ----------
    contacts : list of PartitionContact
    """

    def __init__(self, contacts: Sequence[Any]) -> None:
        self._contacts = contacts

    def some(self, places: Sequence[int]) -> Links:
        """See `formulation.Links`."""
        return Links([self._contacts[j] for j in places])

    @property
    def shared(self) -> bool:
        """Whether contacts share a patch."""
        sides = [side for contact in self._contacts for side in {*contact.sides}]
        return len(set(sides)) < len(sides)

    @property
    def on_demand(self) -> bool:
        """See `formulation.Links`."""
        return any(map(_on_demand, self._contacts))

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


def _on_demand(contact: Any) -> bool:
    """Whether the flexibility of a body in contact is found on demand."""
    return any(isinstance(item.body.basis.flexibility, SkinFlexibility) for item, _ in contact.sides)
