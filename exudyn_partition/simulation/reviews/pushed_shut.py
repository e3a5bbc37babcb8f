"""Rows that forces push shut, and that nobody follows: they have no force, though surfaces lie in each other there.

Where contact slides, rows are followed as far as forces may push them shut. For skins on demand, contacts on a common
body, and patches of one body this distance is a guess, see `PatchGaps.follow_pushed`. At some samples, this
review looks at all rows, with the nodes where all forces move them: no row without a force may be deep.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...contact.patch_gaps import PatchGaps
from ...contact.side import Side
from ...errors import InputError
from ...exudyn_bodies.partition_body import PartitionBody
from ...exudyn_contacts.contact_replay import forces_in_group
from ...exudyn_contacts.contact_samples import growing_at
from ...exudyn_contacts.partition_contact import PartitionContact
from ...support.arrays import Array
from ..result import called, when
from .reviewed_run import Finding, ReviewedContact, ReviewedRun, evenly

_SAMPLES = 3  # that are looked at beside the largest force: each takes a search as at the start of a run
_DEEP = 0.25  # depth of a row without force by the largest depth without flexibility; near edges, 0.1 is usual


def pushed_shut(run: ReviewedRun) -> Iterator[Finding]:
    """Contacts in which forces push rows shut further than it was guessed.

    Not those with dents, which open rows, nor press fits whose overlap load steps close.
    """
    for history in run.contacts:
        gaps = history.contact.mechanics.gaps
        if gaps.placement.overlap and run.result.method == "static":
            continue
        guessed = isinstance(gaps, PatchGaps) and gaps.guesses(shared=len(history.contact.group) > 1)
        elastic = history.contact.mechanics.law.residual and history.contact.mechanics.zones is None
        if guessed and elastic and history.force.any():
            yield from _not_followed(run, history)


def _not_followed(run: ReviewedRun, history: ReviewedContact) -> Iterator[Finding]:
    contact, closed = history.contact, np.flatnonzero(history.force)
    samples = np.unique(np.append(closed[evenly(len(closed), _SAMPLES)], history.force.argmax()))
    try:
        pushed = _forces_beside(run, contact, samples)
    except InputError:  # forces on nodes are not known
        return
    depths = np.array(
        [
            _depth_without_row(run, history, int(sample), {patch: forces[k] for patch, forces in pushed.items()})
            for k, sample in enumerate(samples)
        ]
    )
    worst = int((depths / np.maximum(history.pressed[samples], 1e-300)).argmax())
    depth, sample = depths[worst], samples[worst]
    if depth > _DEEP * history.pressed[sample] > 0.0:
        yield Finding(
            f"{called(contact)} at {when(run.result, run.result.t[sample])}: forces push rows shut that are not "
            f"followed, by {depth:.3g} m, with {history.pressed[sample]:.3g} m of the deepest row. Their forces are "
            "missing. How far forces push is a guess where the flexibility is found on demand, where several contacts "
            "push a body, and where a body touches itself. Take patches of their own (Partition.ball) that are small "
            "enough to be known in full, or one patch for contacts that are near each other"
        )


def _forces_beside(
    run: ReviewedRun, contact: PartitionContact, samples: Array
) -> dict[tuple[PartitionBody, int], Array]:
    """Forces of all contacts of a contact's bodies at some samples, (k,) int, on the nodes of each patch.

    They are (k, np, 3) each [N], in the body's axes.
    """
    pushed = dict[tuple[PartitionBody, int], Array]()
    bodies = {item for item, _ in contact.sides}
    beside = [member for member in contact.group if not bodies.isdisjoint(item for item, _ in member.sides)]
    for member, on_sides in zip(beside, forces_in_group(beside, run.result.at(run.result.t[samples])), strict=True):
        parts = zip(member.sides, member.mechanics.gaps.sides, on_sides, strict=False)
        for (item, patch), side, forces in parts:
            at_samples = zip(run.body(item).q[samples], forces, strict=True)
            on_body = np.array([side.kinematics.in_frame(q, now) for q, now in at_samples])
            pushed[item, patch] = pushed.get((item, patch), 0.0) + on_body
    return pushed


def _depth_without_row(
    run: ReviewedRun, history: ReviewedContact, sample: int, pushed: dict[tuple[PartitionBody, int], Array]
) -> float:
    """Largest depth of a row without a force at a sample [m], with all nodes where forces `pushed` move them.

    They move by residual flexibility, which is not among the coordinates.
    """
    contact = history.contact
    q = np.concatenate([run.body(item).q[sample] for item, _ in contact.sides])
    gaps = contact.mechanics.gaps.for_run()
    assert isinstance(gaps, PatchGaps)
    gaps.grow(growing_at(contact.sides, run.result)(sample))
    if gaps.may_freeze:
        gaps.at(q)
        if not gaps.moving:  # then all rows are present
            return 0.0
    parts = zip(contact.sides, gaps.sides, strict=True)
    nodes, gap = gaps.gaps_of_all(q, [_moved(item, patch, side, pushed) for (item, patch), side in parts])
    closed, forces = history.rows.at_sample(sample)
    return -float(gap[~np.isin(nodes, closed[forces > 0.0])].min(initial=0.0))


def _moved(item: PartitionBody, patch: int, side: Side, pushed: dict[tuple[PartitionBody, int], Array]) -> Array:
    """Ways of the nodes of a patch by forces on the nodes of all patches of its body, (np, 3) [m]."""
    body = item.body
    if side.flexibility is None:  # its nodes move by coordinates alone
        return np.zeros((len(side.surface.points), 3))
    along, total = _directions(item, patch, side), np.zeros(len(side.surface.points) * (1 if side.normal_only else 3))
    for (other, number), forces in pushed.items():
        if other == item:
            loads = np.einsum("nd,ndk->nk", forces, _directions(item, number, side)).ravel()
            total += body.flexibility(patch, number) @ loads
    return np.asarray(np.einsum("nk,ndk->nd", total.reshape(along.shape[0], -1), along))


def _directions(item: PartitionBody, patch: int, side: Side) -> Array:
    """Directions of a patch's flexibility at its nodes, (np, 3, k), in the body's axes."""
    of_patch = item.body.partition.patches[patch]
    n = len(of_patch.nodes)
    if not side.normal_only:
        return np.broadcast_to(np.eye(3), (n, 3, 3))
    normals: Array | Sequence[float] = of_patch.direction if of_patch.normals is None else of_patch.normals
    return np.broadcast_to(normals, (n, 3))[:, :, None]
