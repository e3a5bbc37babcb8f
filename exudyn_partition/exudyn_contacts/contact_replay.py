"""Nodal forces and stored energy of a contact after a run: evaluated again at the samples, or read from the run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from weakref import WeakKeyDictionary

import numpy as np

from ..contact.patch_contact import PatchContact
from ..errors import InputError
from ..results.impacts import line_at
from ..support.arrays import Array
from ..support.checks import validate_result
from .contact_samples import ModelContact, RunSamples, growing_at, kept_rows
from .row_samples import RowSamples

_CENTRES = 9  # number of samples of a contact at which the centre of its force is found
# Energy of each contact, by its number and the size of its group, as long as the result exists.
_ENERGIES: WeakKeyDictionary[RunSamples, dict[tuple[int, int], Array]] = WeakKeyDictionary()


def nodal_forces(contact: ModelContact, result: RunSamples) -> list[Array]:
    """See `PartitionContact.nodal_forces`."""
    kept = _kept(contact, result)
    return _evaluated_on_nodes([contact], result)[0] if kept is None else kept


def forces_in_group(contacts: Sequence[ModelContact], result: RunSamples) -> list[list[Array]]:
    """Nodal forces of contacts of one group, see `PartitionContact.nodal_forces`; the group is evaluated once."""
    all_kept = [_kept(contact, result) for contact in contacts]
    others = [contact for contact, kept in zip(contacts, all_kept, strict=True) if kept is None]
    evaluated = iter(_evaluated_on_nodes(others, result) if others else [])
    return [next(evaluated) if kept is None else kept for kept in all_kept]


def _kept(contact: ModelContact, result: RunSamples) -> list[Array] | None:
    """Nodal forces of a contact as the run kept them; None if they follow from the coordinates."""
    mechanics = contact.mechanics
    if mechanics.gaps.carried:
        return _kept_of_carried(contact, result)
    pressed = mechanics.gaps.placement.overlap and result.method == "static"  # then forces depend on the load step
    remembers = mechanics.friction is not None or mechanics.zones is not None or mechanics.damped
    if remembers or pressed:
        return _kept_on_nodes(contact, result)
    if not mechanics.elastic:
        raise InputError("nodal_forces: multipliers are not known from coordinates; row_forces has what was stored")
    return None


def _evaluated_on_nodes(contacts: Sequence[ModelContact], result: RunSamples) -> list[list[Array]]:
    """Nodal forces of contacts that are solved together, evaluated again."""
    places = [contact.group.index(contact) for contact in contacts]
    at_times = [[parts[k].evaluation.nodal_forces() for k in places] for parts in _evaluated(contacts[0], result)]
    return [[np.array(side) for side in zip(*forces, strict=True)] for forces in zip(*at_times, strict=True)]


def force_centres(
    contact: ModelContact,
    result: RunSamples,
    force: Array,
    samples: tuple[int, int, int],
    times: tuple[float, float],
    along: Array,
) -> Array | None:
    """Centre of the contact force in space at two times, (2, 3) [m]; None if forces of rows are not known.

    It moves on a line through the centres at some samples from the first to the last, each counted by its force, and
    not beyond these. Multipliers jump from step to step: their centre stays at the mean over the contact.

    Parameters
    ----------
    contact : PartitionContact
    result : Result
    force : (n,) array
        Its force [N].
    samples : three ints
        The first one with a force, that of the largest force, and the last one.
    times : two floats
        [s]
    along : (3,) array
        Normal of the contact, to the slave.
    """
    item, (first, peak, last) = contact.sides[0][0], samples
    nodes = contact.mechanics.gaps.slave.surface.nodes
    try:
        if contact.mechanics.elastic or contact.mechanics.friction is not None or contact.mechanics.zones is not None:
            chosen = np.unique(np.append(np.linspace(first, last, _CENTRES).astype(int), peak))
            weights = nodal_forces(contact, result.at(result.t[chosen]))[0] @ along
        else:
            chosen = np.array([peak])
            rows = RowSamples(result.kept(contact), result.t[first : last + 1]).matrix()
            weights = np.asarray(rows.sum(axis=0))[:, : len(nodes)]
    except InputError:  # a result from a file
        return None
    pressed = weights.any(axis=1)
    chosen, weights, kinematics = chosen[pressed], weights[pressed], item.kinematics.at(nodes)
    if not len(chosen):
        return None
    places = [kinematics.place(q) for q in item.coordinates(result.at(result.t[chosen]))]
    centres = np.array([of @ at / of.sum() for of, at in zip(weights, places, strict=True)])
    return line_at(np.array(times), result.t[chosen], centres, force[chosen])


def stored_energy(contact: ModelContact, result: RunSamples) -> Array:
    """Energy that an elastic contact stored, (n,) [J]: as the run kept it, or computed from the coordinates."""
    if result.runs:
        return np.array(result.kept(contact).stored_at(result.t.tolist()))
    energies, size = _ENERGIES.setdefault(result, {}), len(contact.group)
    if (int(contact["sForce"]), size) not in energies:  # those of the group are found together
        found = np.array(
            [[mechanics.evaluation.stored for mechanics in parts] for parts in _evaluated(contact, result)]
        )
        for member, energy in zip(contact.group, found.T, strict=True):
            energies[int(member["sForce"]), size] = energy
    return energies[int(contact["sForce"]), size].copy()


def viscous_work(contact: ModelContact, result: RunSamples) -> Array:
    """Energy that viscous flexibilities and a damped law have taken since the start of the run, (n,) [J]."""
    validate_result(result)
    if not contact.mechanics.damped:
        return np.zeros(len(result.t))
    kept = result.kept(contact).viscous_works
    return np.array([kept.get(t, 0.0) for t in result.t.tolist()])


def _kept_of_carried(contact: ModelContact, result: RunSamples) -> list[Array]:
    """See `nodal_forces`. Another body moved the rigid surface, and results do not record that body's motion."""
    validate_result(result)
    run, sides = result.kept(contact), contact.mechanics.gaps.sides
    forces = [np.zeros((len(result.t), len(side.surface.points), 3)) for side in sides]
    closed = {t for t, *_ in run.samples}
    for i, t in enumerate(result.t):
        if t in closed:
            for on_side, now in zip(forces, run.on_nodes[t], strict=True):
                on_side[i] = now
    return forces


def _kept_on_nodes(contact: ModelContact, result: RunSamples) -> list[Array]:
    """See `nodal_forces`. They follow from the forces of rows that the run kept."""
    validate_result(result)
    mechanics = contact.mechanics.for_run("explicit")
    q, growing = np.hstack([item.coordinates(result) for item, _ in contact.sides]), growing_at(contact.sides, result)
    forces = [np.zeros((len(result.t), len(side.surface.points), 3)) for side in mechanics.gaps.sides]
    for i, nodes, lam, tangential, _ in kept_rows(contact, result):
        mechanics.gaps.grow(growing(i))
        on_sides = mechanics.forces_on_nodes(q[i], nodes, lam, tangential)
        for on_side, now in zip(forces, on_sides, strict=True):
            on_side[i] = now
    return forces


def _evaluated(contact: ModelContact, result: RunSamples) -> Iterator[Sequence[PatchContact]]:
    """Mechanics of the contacts that are solved together, at each time of `result`."""
    if contact.mechanics.gaps.carried:
        raise InputError(
            "contact: its forces are not known after the run where a body of another kind carries the rigid surface"
        )
    parts = [member.mechanics.for_run("explicit") for member in contact.group]
    together = contact.together.for_run(parts)
    growing = [growing_at(member.sides, result) for member in contact.group]
    histories = [np.hstack([item.coordinates(result) for item, _ in member.sides]) for member in contact.group]
    for i in range(len(result.t)):
        for mechanics, of_sides in zip(parts, growing, strict=True):
            mechanics.gaps.grow(of_sides(i))
        together.forces([q[i] for q in histories])
        yield parts
