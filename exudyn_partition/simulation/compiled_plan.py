"""Exudyn adapter: what compiled runs need of a model, read from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..algebra.complementarity import REGULARISATION, Complementarity, regularised
from ..algebra.products import dense
from ..compiled.friction_plan import FrictionMemory, FrictionPlan
from ..compiled.moving import (
    Following,
    Moves,
    MovingPlan,
    Turning,
    anchors_of,
    can_follow,
    frames_of,
    growing_of,
    rows_of,
    surfaces_of,
)
from ..compiled.plan import Bodies, Core, FrozenPlan, StepPlan, joined_fields
from ..compiled.rubbing import Rubbing, rubbing_of
from ..compiled.start import Start
from ..contact.anchoring import SAME
from ..contact.between import Shares, shared_flexibility
from ..contact.followed import BULGE
from ..contact.formulations.coupled import CoupledContacts
from ..contact.formulations.coupled_friction import CoupledFriction
from ..contact.formulations.formulation import Together
from ..contact.gaps import GapState
from ..contact.linear_gaps import FlatRows, LinearGaps
from ..contact.memory import on_rows
from ..contact.patch_contact import PatchContact
from ..contact.patch_gaps import PatchGaps
from ..contact.rigid import RigidGaps
from ..contact.stages import NOTHING, Anchor
from ..contact.tangential import TangentialRows
from ..errors import CompiledRunError
from ..exudyn_bodies.item_work import acts_on_constant_mass
from ..exudyn_bodies.model import dofs_of
from ..exudyn_contacts.contact_group import groups_of
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..frames.floating import FloatingKinematics
from ..support.arrays import Array
from ..support.foreign import MainSystem
from ..support.optional import require
from .compiled_limits import has_friction, loaded_coordinate

# Contacts that are solved together at the start of a run, and what finds their forces.
Groups = Sequence[tuple[Together, Sequence[PatchContact]]]
Whole = tuple[Array, Sequence[Array], Core]  # see `CoupledFriction.whole_flexibility`


def read_plan(mbs: MainSystem, groups: Groups) -> StepPlan:
    """Plan of the compiled steps of a model that `check_held` has passed.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    groups : sequence of (Together, list of PatchContact)
        Contacts of each of `contacts_by_group` at the start of the run, and what finds their forces.

    Raises
    ------
    CompiledRunError
        If pairs slide at the start of the run.
    """
    bodies, contacts = partition_items(mbs)
    n = mbs.systemData.ODE2Size()
    mass, stiffness, damping, load = np.ones(n), *np.zeros((3, n))
    for item in bodies:
        dofs = dofs_of(mbs, item)
        mass[dofs], stiffness[dofs] = item.kinematics.mass, item.body.stiffness.diagonal()
        if item.frame == "floating":
            stiffness[dofs] = np.r_[np.zeros(6), item.body.basis.omega[6:] ** 2]
        if item.damping is not None:
            damping[dofs] = item.damping.matrix().diagonal()
        if len(pushed := np.asarray(mbs.GetObjectParameter(item["oGenericODE2"], "forceVector"))):
            load[dofs] = pushed
    for number in range(mbs.systemData.NumberOfLoads()):
        entry = mbs.GetLoad(number)
        load[loaded_coordinate(mbs, bodies, entry)] += entry["load"]
    return StepPlan(Bodies(mass, stiffness, damping, load), _contacts_plan(mbs, contacts, groups))


def contacts_by_group(contacts: Sequence[PartitionContact]) -> list[list[PartitionContact]]:
    """Contacts that are solved together, in the order of a plan: groups with friction come last."""
    return sorted(groups_of(contacts), key=has_friction)


def at_start(contacts: Sequence[PartitionContact]) -> list[tuple[Together, list[PatchContact]]]:
    """Contacts at the start of a run from the model's initial values, as `read_plan` takes them."""
    groups: list[tuple[Together, list[PatchContact]]] = []
    for group in contacts_by_group(contacts):
        members, together = [contact.mechanics.for_run("explicit") for contact in group], group[0].together
        groups.append((together.for_run(members), members))
    return groups


def _contacts_plan(
    mbs: MainSystem,
    contacts: Sequence[PartitionContact],
    groups: Groups,
) -> FrozenPlan:
    """Plan of all contacts, group by group."""
    ordered = contacts_by_group(contacts)
    n = sum(not has_friction(group) for group in ordered)
    blocks = [_blocks(together, members) for together, members in groups[:n]]
    fields, core = joined_fields([(of_group, core) for _, of_group, core in blocks])
    within_contacts = tuple(F for flexibilities, _, _ in blocks for F in flexibilities)
    without = [contact for group in ordered[:n] for contact in group]
    flat = _rows(mbs, without, [member for _, some in groups[:n] for member in some])
    names, moving = tuple(contact.name for contact in without), _moving(mbs, groups)
    friction = None if n == len(ordered) else _friction_plan(mbs, ordered[n:], groups[n:], moving)
    return FrozenPlan(names, flat, within_contacts, fields, core, friction, moving)


def _rows(mbs: MainSystem, contacts: Sequence[PartitionContact], members: Sequence[PatchContact]) -> FlatRows:
    """Gaps of the rows of some contacts; rows that follow the motion have no coordinates in them."""
    linear, normals, dofs = list[LinearGaps](), list[Array](), list[Array]()
    for contact, mechanics in zip(contacts, members, strict=True):
        gaps = mechanics.gaps
        if gaps.stage.linear is not None:
            linear.append(gaps.stage.linear)
            normals.append(gaps.stage.normal)
            dofs.append(np.concatenate([np.r_[part] for part in contact.slices(mbs)]))
        elif can_follow(gaps):
            n = len(rows_of(gaps))
            linear.append(LinearGaps(np.zeros((n, 0)), np.zeros(n), np.zeros((0, 0)), np.zeros(0), np.inf))
            normals.append(np.zeros((n, 3)))
            dofs.append(np.zeros(0, dtype=np.int64))
        else:
            raise CompiledRunError(
                f"pairs of contact {contact.name!r} slide where this run begins; take solver='exudyn'"
            )
    return FlatRows.of(linear, normals, dofs)


def _friction_plan(
    mbs: MainSystem,
    ordered: Sequence[Sequence[PartitionContact]],
    groups: Groups,
    moving: MovingPlan | None,
) -> FrictionPlan:
    """Plan of groups of contacts with friction."""
    contacts = [contact for group in ordered for contact in group]
    members = [mechanics for _, some in groups for mechanics in some]
    for contact, mechanics in zip(contacts, members, strict=True):
        if mechanics.gaps.moving and mechanics.gaps.may_freeze:
            raise CompiledRunError(
                f"pairs of contact {contact.name!r}, which has friction, slide where this run begins; take "
                "solver='exudyn'"
            )
    rows, ways, tangents = _rows(mbs, contacts, members), list[Array](), list[Array]()
    for mechanics in members:
        of_contact, nr = mechanics.rows, len(rows_of(mechanics.gaps))
        if mechanics.gaps.moving:
            ways.append(np.zeros((2 * nr, 0)))
            tangents.append(np.zeros((nr, 2, 3)))
        elif isinstance(of_contact, TangentialRows):
            derivative = dense(of_contact.jacobian(np.arange(nr)))
            ways.append(derivative.reshape(nr, 3, -1)[:, 1:].reshape(2 * nr, -1))
            tangents.append(of_contact.tangents)
        else:  # nothing moves them along tangents
            ways.append(np.zeros((2 * nr, mechanics.gaps.n)))
            tangents.append(np.zeros((nr, 2, 3)))
    wholes = [_whole(together, some) for together, some in groups]
    for (_, some), (F, _, _) in zip(groups, wholes, strict=True):
        if not any(mechanics.gaps.moving for mechanics in some):
            Complementarity(regularised(F))  # which checks it
    starts = np.cumsum([0, *(len(some) for _, some in groups)])
    laws = tuple(mechanics.friction for mechanics in members)
    names, flexibilities = tuple(contact.name for contact in contacts), tuple(F for F, _, _ in wholes)
    rubbing = None if moving is None else _rubbing(moving, groups, wholes)
    return FrictionPlan(names, rows, tuple(ways), np.concatenate(tangents), starts, flexibilities, laws, rubbing)


def _rubbing(moving: MovingPlan, groups: Groups, wholes: Sequence[Whole]) -> Rubbing | None:
    """Contacts with friction whose rows follow the motion, of groups with friction alone."""
    contacts, pairs = moving.rubbing, moving.rubbing_pairs
    if not contacts and not pairs:
        return None
    members = [mechanics for _, some in groups for mechanics in some]
    fields, core, numbers = list[Array](), dict[tuple[int, int], Array](), list[int]()
    for group, ((_, some), (_, of_group, between)) in enumerate(zip(groups, wholes, strict=True)):
        core |= {(len(numbers) + j, len(numbers) + k): S for (j, k), S in between.items()}
        fields += of_group
        numbers += [group] * len(some)
    rows = [members[one.contact].rows for one in (*contacts, *pairs)]
    return rubbing_of(contacts, pairs, rows, numbers, fields, core)


def friction_memory(groups: Sequence[Sequence[PatchContact]]) -> FrictionMemory:
    """What the rows of groups of contacts remember, as `compiled.run` takes it."""
    members = [contact for some in groups for contact in some]
    forces, slipped, speed, path, tractions = (list[Array]() for _ in range(5))
    for mechanics in members:
        memory, nodes = mechanics.state.memory, rows_of(mechanics.gaps)
        of_rows, in_axes = np.zeros((2, len(nodes), 3))
        in_axes[:, : memory.forces.shape[1] - 1] = memory.forces[nodes, 1:]
        tractions.append(in_axes)
        remembered = on_rows(mechanics.rows, memory.forces)
        present = np.searchsorted(nodes, mechanics.gaps.row_nodes)
        of_rows[present, : remembered.shape[1]] = remembered
        forces.append(of_rows)
        for kept, values in ((slipped, memory.slipped), (speed, memory.speed), (path, memory.path)):
            kept.append(values[nodes])
    all_forces = np.concatenate(forces)
    return FrictionMemory(
        all_forces, np.zeros_like(all_forces), np.concatenate(slipped), np.concatenate(speed), np.concatenate(path),
        np.array([mechanics.state.memory.dissipated for mechanics in members]), np.concatenate(tractions),
    )  # fmt: skip


def softened(plan: FrozenPlan, groups: Groups, shares: Shares) -> FrozenPlan:
    """The same contacts if only shares of the bodies' flexibilities yield, by the sides of all contacts of a plan."""
    n, places, blocks, wholes = 0, iter(shares), list[tuple[Sequence[Array], Core]](), list[Whole]()
    within_contacts = list[Array]()
    for together, members in groups:
        of_group = [next(places) for _ in members]
        if n < len(plan.names):
            of_contacts, fields, core = _blocks(together, members, of_group)
            blocks.append((fields, core))
            within_contacts += of_contacts
        else:
            wholes.append(_whole(together, members, of_group))
        n += len(members)
    fields, core = joined_fields(blocks)
    moving = plan.moving and plan.moving.softened([shares[j][0] for j in plan.moving.surfaces.contact])
    return replace(
        plan, own=tuple(within_contacts), fields=fields, core=core, moving=moving,
        friction=plan.friction and _softened_friction(plan, groups[-len(wholes) :], wholes, shares),
    )  # fmt: skip


def _softened_friction(plan: FrozenPlan, groups: Groups, wholes: Sequence[Whole], shares: Shares) -> FrictionPlan:
    """Contacts with friction with other flexibilities of their groups, see `softened`."""
    friction, rubbing = plan.friction, None
    assert friction is not None
    if friction.rubbing is not None and plan.moving is not None:
        rubbing = _rubbing(plan.moving, groups, wholes)
        of_surfaces = [shares[len(plan.names) + j][0] for j in friction.rubbing.surfaces.contact]
        rubbing = rubbing and rubbing._replace(surfaces=rubbing.surfaces.softened(of_surfaces))
    return friction.softened([F for F, _, _ in wholes], rubbing)


def _whole(together: Together, members: Sequence[PatchContact], shares: Shares | None = None) -> Whole:
    """See `CoupledFriction.whole_flexibility`; also of a contact alone."""
    if isinstance(together, CoupledFriction):
        return together.whole_flexibility(shares)
    (alone,) = members
    n = len(rows_of(alone.gaps))
    if alone.gaps.moving:
        F = np.zeros((3 * n, 3 * n))
    elif shares is None:
        F = alone.rows.flexibility(np.arange(n))
    else:
        F = shared_flexibility(alone.rows, shares[0])
    return F, [np.zeros((3 * n, 0))], {}


def _blocks(
    together: Together, members: Sequence[PatchContact], shares: Shares | None = None
) -> tuple[Sequence[Array], Sequence[Array], Core]:
    """See `CoupledContacts.blocks`; a contact alone whose rows move exchanges nothing."""
    if isinstance(together, CoupledContacts):
        return together.blocks(shares)
    sizes = [len(rows_of(member.gaps)) for member in members]
    return [np.zeros((n, n)) for n in sizes], [np.zeros((n, 0)) for n in sizes], {}


def _moving(mbs: MainSystem, groups: Groups) -> MovingPlan | None:
    """Bodies in floating frames and moving contacts; None if there are none."""
    turning, moves = _turning(mbs), moving_contacts(mbs, groups)
    if not turning and not any(moves):
        return None
    (rigid, pairs, *with_friction), bounds = map(tuple, moves), (BULGE, SAME, REGULARISATION)
    return MovingPlan(frames_of(turning), surfaces_of(rigid), rigid, pairs, bounds, *with_friction)


def _turning(mbs: MainSystem) -> list[Turning]:
    """Bodies in floating frames."""
    turning = []
    for item in partition_items(mbs)[0]:
        if isinstance(item.kinematics, FloatingKinematics):
            constant = acts_on_constant_mass(mbs, item, item.kinematics.acting)
            coupled = "coupling" in item.inertia_terms and not constant
            turning.append(Turning(item.kinematics, dofs_of(mbs, item), coupled))
    return turning


def moving_contacts(mbs: MainSystem, groups: Groups) -> Moves:
    """Contacts whose rows follow the motion; `groups` as `read_plan` takes."""
    bodies, contacts = partition_items(mbs)
    ordered, floating = contacts_by_group(contacts), [item for item in bodies if item.frame == "floating"]
    found, number = Moves.none(), 0
    first = sum(len(group) for group in ordered if not has_friction(group))
    for of_group, (together, members) in zip(ordered, groups, strict=True):
        for j, (contact, mechanics) in enumerate(zip(of_group, members, strict=True)):
            gaps = mechanics.gaps
            if gaps.moving and isinstance(gaps, RigidGaps | PatchGaps):
                items = [item for item, _ in contact.sides]
                fields = [np.zeros((0, 0)) for _ in items]
                if isinstance(together, CoupledContacts | CoupledFriction):
                    fields = [together.patch_fields(j, side) for side in range(len(items))]
                numbers = tuple(floating.index(item) if item in floating else -1 for item in items)
                dofs = np.concatenate([dofs_of(mbs, item) for item in items])
                rough, kinds = number >= first, (found.rigid, found.pairs, found.rubbing, found.rubbing_pairs)
                kind = kinds[2 * rough + isinstance(gaps, PatchGaps)]
                place = number - first if rough else number
                kind.append(Following(place, numbers, dofs, gaps, tuple(fields)))
            number += 1
    return found


def with_anchors(start: Start, moves: Moves) -> Start:
    """Return the start of a run with what its moving contacts remember."""
    rigid, _, rubbing, _ = moves
    pairs, rubbing_pairs = (
        tuple(replace(pair.gaps.accepted, anchor=pair.gaps.present.anchor) for pair in some)
        for some in (moves.pairs, moves.rubbing_pairs)
    )
    return replace(
        start, anchors=anchors_of(rigid, len(start.q)) if rigid else start.anchors, pairs=pairs,
        rubbing=anchors_of(rubbing, len(start.q)) if rubbing else start.rubbing, rubbing_pairs=rubbing_pairs,
    )  # fmt: skip


def follow_frozen(mbs: MainSystem, groups: Groups, pairs: Sequence[Following], end: Start) -> list[GapState]:
    """Let contacts with frozen pairs, without friction, be those of a plan whose rows follow facets.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    groups : sequence of (Together, list of PatchContact)
        As `read_plan` takes them.
    pairs : sequence of Following
        Those that follow facets already.
    end : Start
        Where a run has stopped, because pairs would slide.

    Returns
    -------
    States of all these contacts there, in the order of `moving_contacts`.
    """
    known = {id(pair.gaps): state for pair, state in zip(pairs, end.pairs or (), strict=True)}
    for of_group, (_, members) in zip(contacts_by_group(partition_items(mbs)[1]), groups, strict=True):
        for mechanics in () if has_friction(of_group) else members:
            gaps = mechanics.gaps
            if isinstance(gaps, PatchGaps) and not gaps.moving and can_follow(gaps):
                known[id(gaps)] = replace(gaps.accepted, anchor=gaps.present.anchor)
                gaps.follow()
    following = moving_contacts(mbs, groups).pairs
    return [replace(known[id(pair.gaps)], q=end.q[pair.dofs]) for pair in following]


def give_anchors(moves: Moves, state: Start) -> None:
    """Let contacts go on from a state of compiled steps."""
    for some, anchors in ((moves.rigid, state.anchors), (moves.rubbing, state.rubbing)):
        for s, contact in enumerate(some):
            assert anchors is not None
            if anchors.anchored[s]:
                growing = growing_of(contact.gaps, anchors.growing[s])
                contact.gaps.accept_anchor(Anchor(anchors.q[s, contact.dofs], NOTHING, growing))
    states = (*(state.pairs or ()), *(state.rubbing_pairs or ()))
    for pair, of_pair in zip((*moves.pairs, *moves.rubbing_pairs), states, strict=True):
        pair.gaps.begin(of_pair)
        if pair.gaps.may_freeze and pair.gaps.moving and len(pair.gaps.row_nodes):  # `Gaps.after` counts the last step
            pair.gaps.accept(replace(of_pair, steps=of_pair.steps - 1))


def initial_start(mbs: MainSystem) -> Start:
    """The model's initial values, as the start of a run."""
    data, initial = mbs.systemData, require("exudyn").ConfigurationType.Initial
    return Start(np.array(data.GetODE2Coordinates(initial)), np.array(data.GetODE2Coordinates_t(initial)))
