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
from .reviewed_run import ContactHistory, Finding, ReviewedRun, evenly

_SAMPLES = 3  # that are looked at beside the largest force: each takes a search as at the start of a run
_DEEP = 0.25  # depth of a row without force by the largest depth without flexibility; near edges, 0.1 is usual


def pushed_shut(run: ReviewedRun) -> Iterator[Finding]:
    """Contacts in which forces push rows shut further than it was guessed.

    Not those with dents, which open rows, nor press fits whose overlap load steps close.
    """
    for history in run.contacts:
        gaps = history.contact.mechanics.gaps
        if gaps.overlap and run.result.method == "static":
            continue
        guessed = isinstance(gaps, PatchGaps) and gaps.guesses(shared=len(history.contact.group) > 1)
        elastic = history.contact.mechanics.law.residual and history.contact.mechanics.zones is None
        if guessed and elastic and history.force.any():
            yield from _not_followed(run, history)


def _not_followed(run: ReviewedRun, history: ContactHistory) -> Iterator[Finding]:
    contact, closed = history.contact, np.flatnonzero(history.force)
    samples = np.unique(np.append(closed[evenly(len(closed), _SAMPLES)], history.force.argmax()))
    depths = np.array([_depth_without_row(run, history, int(sample)) for sample in samples])
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


def _depth_without_row(run: ReviewedRun, history: ContactHistory, sample: int) -> float:
    """Largest depth of a row without a force at a sample [m], with all nodes where forces move them."""
    contact = history.contact
    q = np.concatenate([run.body(item).q[sample] for item, _ in contact.sides])
    gaps = contact.mechanics.gaps.fresh()
    assert isinstance(gaps, PatchGaps)
    gaps.grow(growing_at(contact.sides, run.result)(sample))
    gaps.at(q)
    if not gaps.moving:  # then all rows are present
        return 0.0
    try:
        ways = _displacements(run, contact, sample)
    except InputError:  # forces on nodes are not known
        return 0.0
    nodes, gap = gaps.gaps_of_all(q, ways)
    closed, forces = history.rows.at_sample(sample)
    return -float(gap[~np.isin(nodes, closed[forces > 0.0])].min(initial=0.0))


def _displacements(run: ReviewedRun, contact: PartitionContact, sample: int) -> list[Array]:
    """Ways of the nodes of each side by the forces of all contacts of its bodies, (np, 3) each [m], in the body's axes.

    These are the ways by residual flexibility, which are not among the coordinates.
    """
    pushed = dict[tuple[PartitionBody, int], Array]()
    now = run.result.at(run.result.t[sample : sample + 1])
    bodies = {item for item, _ in contact.sides}
    beside = [member for member in contact.group if not bodies.isdisjoint(item for item, _ in member.sides)]
    for member, on_sides in zip(beside, forces_in_group(beside, now), strict=True):
        parts = zip(member.sides, member.mechanics.gaps.sides, on_sides, strict=False)
        for (item, patch), side, forces in parts:
            on_body = side.kinematics.in_frame(run.body(item).q[sample], forces[0])
            pushed[item, patch] = pushed.get((item, patch), 0.0) + on_body
    return [
        _moved(item, patch, side, pushed)
        for (item, patch), side in zip(contact.sides, contact.mechanics.gaps.sides, strict=True)
    ]


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
