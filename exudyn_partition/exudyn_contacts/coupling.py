"""Contacts that share a body: whether forces of one move the patches of another, and who solves them together."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..contact.formulations.compliance import ComplianceContact
from ..contact.formulations.coupled import CoupledContacts
from ..contact.formulations.two_pass import TwoPass
from ..errors import InputError, ModelLimitWarning
from ..exudyn_bodies.partition_body import PartitionBody
from ..support.arrays import Array
from .central_differences import MultiplierStep

if TYPE_CHECKING:
    from .contact_items import PartitionContact

_COUPLED = 1e-4  # residual flexibility between two patches over their own, below which contacts do not feel it


def check_shared_bodies(contact: PartitionContact, others: list[PartitionContact]) -> None:
    """Solve contacts together whose forces move each other's patches; refuse what cannot be."""
    coupled = [contact]
    for other in others:
        for item, patch in contact.sides:
            for other_item, other_patch in other.sides:
                if item is not other_item or contact.multipliers != other.multipliers:
                    continue
                if contact.multipliers:
                    if patch == other_patch or _moves_nodes_of(contact, other, item):
                        coupled += [c for c in other.group if c not in coupled]
                elif patch == other_patch:
                    raise InputError(
                        f"body {item.name!r}: its patch {patch} already has the contact {other.name!r}; each would "
                        "take its residual flexibility for itself. Make a patch for each contact (Partition.ball(...) "
                        "| Partition.ball(...)), or take basis='free' with formulation='lagrange'"
                    )
                elif _coupling(item, patch, other_patch) > _COUPLED:
                    both = (contact, other)
                    if all(isinstance(c.law, ComplianceContact) for c in both):
                        coupled += [c for c in other.group if c not in coupled]
                    elif all(isinstance(c.law, ComplianceContact | TwoPass) for c in both):
                        _warn_of_coupled_flexibility(item, patch, other_patch)
    if len(coupled) == 1:
        return
    if contact.multipliers:
        stepper = MultiplierStep(coupled)
        for member in coupled:
            member.group, member.stepper = coupled, stepper
    else:
        together = CoupledContacts([c.law for c in coupled], _links(coupled))
        for member in coupled:
            member.group, member.together = coupled, together


def _links(contacts: list[PartitionContact]) -> list[tuple[int, int, int, int, Array]]:
    """Which sides of the contacts push which others, and the flexibility between their patches."""
    sides = [(j, s, item, patch) for j, c in enumerate(contacts) for s, (item, patch) in enumerate(c.sides)]
    return [
        (j, s, k, r, item.body.flexibility(patch, other_patch))
        for j, s, item, patch in sides
        for k, r, other, other_patch in sides
        if j != k and item is other and item.body.basis.flexibility is not None
    ]


def _moves_nodes_of(contact: PartitionContact, other: PartitionContact, item: PartitionBody) -> bool:
    """Whether multipliers of one contact move gaps of the other, through a body of both."""
    inverse_mass = sp.diags(1 / item.kinematics.mass)
    G, others = (c.rows_on(item) for c in (contact, other))
    coupling = abs(G @ inverse_mass @ others.T).max()
    return bool(coupling > 1e-9 * abs(G @ inverse_mass @ G.T).max())


def _coupling(item: PartitionBody, patch: int, other: int) -> float:
    """Residual flexibility between two patches, relative to their own."""
    if item.body.basis.flexibility is None:
        return 0.0
    own, others = (np.linalg.norm(item.body.flexibility(i), 2) for i in (patch, other))
    return float(np.linalg.norm(item.body.flexibility(patch, other), 2) / np.sqrt(own * others))


def _warn_of_coupled_flexibility(item: PartitionBody, patch: int, other: int) -> None:
    warnings.warn(
        f"body {item.name!r}: the residual flexibility couples its patches {patch} and {other} by "
        f"{_coupling(item, patch, other):.1%}, which contacts with passes='two' neglect; forces on one may be off by "
        "about that share of the other's. Take one pass, or a higher f_cut",
        ModelLimitWarning,
        stacklevel=4,
    )
