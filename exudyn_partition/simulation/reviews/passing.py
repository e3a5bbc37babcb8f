"""Bodies that enter what they touch beside their patches, where nothing holds them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ...errors import ContactPatchWarning
from ...exudyn_bodies.other_bodies import surface_motion
from ...exudyn_bodies.partition_body import PartitionBody
from ...fe.facets import flat_triangles
from ...reduction.body import ReducedBody
from ...support.arrays import Array
from ...support.once import once
from ...surfaces.surface import closest_points
from ..result import called
from .reviewed_run import Finding, ReviewedContact, ReviewedRun, evenly, size_of

_SAMPLES, _NODES = 32, 300  # largest numbers of samples, and of nodes beside patches, that are looked at
_WAYS = 200  # directions in which a body reaches furthest with a corner, which may be the first to enter
_CLOSELY = 8  # largest number of samples at which nodes that may lie within a body are looked at
_DEEP = 1e-3  # depth of a node over its body's size
_DEEP_IN_FACETS = 0.1  # the same over a facet's size, for bodies: facets lie beside curved faces
_ROUND_OFF = 1e-7  # of a facet's size


def passing(run: ReviewedRun) -> Iterator[Finding]:
    """Bodies that enter what they touch beside their patches in all contacts, for example after a turn."""
    if run.result.method == "static":
        return
    # Patches of a body that meet another body or a surface, by its identity: surfaces of users may have no hash.
    met: dict[tuple[PartitionBody, int], frozenset[int]] = {}
    for contact in run.result.contacts:
        for (item, number), opposite in zip(contact.sides, (contact.master, contact.slave), strict=False):
            met[item, id(opposite)] = met.get((item, id(opposite)), frozenset()) | {number}
    for history in run.contacts:
        contact = history.contact
        if contact.master != contact.slave and contact.rows != "edges" and history.kept.edge is None:
            yield from _entered(run, history, met)


def _entered(
    run: ReviewedRun, history: ReviewedContact, met: Mapping[tuple[PartitionBody, int], frozenset[int]]
) -> Iterator[Finding]:
    """Finding on a body of a contact that has entered the other side beside its patches.

    `met` are the numbers of the patches with which each body meets something, by the `id` of this.
    """
    contact, result = history.contact, run.result
    chosen = evenly(len(result.t), _SAMPLES)
    dent = np.maximum(history.pressed[chosen], 0.0)  # which the motion does not know
    sides = [item for item, _ in contact.sides]
    for item, opposite in zip(sides, sides[::-1] if len(sides) > 1 else [contact.master], strict=True):
        deep = _DEEP * size_of(item.body)
        if not isinstance(opposite, PartitionBody) and contact.carrier is None and run.body(item).way < deep:
            continue  # nothing that was outside at the start can be so deep
        nodes = _beside(item.body, met[item, id(opposite)])
        places = item.kinematics.at(nodes).place(run.body(item).q[chosen])
        if isinstance(opposite, PartitionBody):
            depth = _depths_in_body(places, opposite, run.body(opposite).q[chosen])
        else:
            motion = surface_motion(contact.carrier, result.others, result.t[chosen])
            if motion is None:
                continue
            place, axes = motion
            on_surface = places if contact.carrier is None else (places - place[:, None]) @ axes
            depth = -opposite.project(on_surface.reshape(-1, 3))[0].reshape(on_surface.shape[:2])
        entered = np.where(depth[0] < 0.0, depth, 0.0) > dent[:, None] + deep
        if entered.any():
            sample, node = np.argwhere(entered)[0]
            what = called(opposite) if isinstance(opposite, PartitionBody) else "the rigid surface"
            yield Finding(
                f"{called(contact)}: at t = {result.t[chosen[sample]]:.6g} s {called(item)} is "
                f"{depth[sample, node]:.3g} m within {what} at {places[sample, node]} m, beside its patch, where "
                "nothing holds it. Has it turned? Take a patch that reaches there, as by Partition.surface; or ignore "
                "this if the real surface ends before",
                ContactPatchWarning,
            )
            return


@once
def _beside(body: ReducedBody, patches: frozenset[int]) -> Array:
    """Some nodes on a body's boundary, (k,), beside some of its patches, given by their numbers."""
    nodes = np.unique(body.facets)
    for number in patches:
        nodes = np.setdiff1d(nodes, body.partition.patches[number].nodes)
    if len(nodes) <= _NODES:
        return nodes
    furthest = nodes[(body.points[nodes] @ _directions(_WAYS).T).argmax(axis=0)]
    return np.union1d(nodes[:: len(nodes) // _NODES + 1], furthest)


def _directions(n: int) -> Array:
    """Unit vectors spread evenly over a sphere, on a spiral, (n, 3)."""
    height, angle = 1 - (2 * np.arange(n) + 1) / n, np.pi * (3 - 5**0.5) * np.arange(n)
    across = np.sqrt(1 - height**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), height])


@once
def _boundary(body: ReducedBody) -> tuple[Array, Array]:
    """Triangles on a body's boundary, (k, 3) int, and its nodes there, (m,), ascending."""
    return flat_triangles(body.facets)[0], np.unique(body.facets)


def _depths_in_body(places: Array, body: PartitionBody, q: Array) -> Array:
    """How deep nodes at places, (m, k, 3) [m], lie within a body at coordinates, (m, n): (m, k) [m], -inf outside.

    A box around the body tells it for most samples. Of the others, some are looked at.
    """
    depth = np.full(places.shape[:2], -np.inf)
    facets, boundary = _boundary(body.body)
    some = body.kinematics.at(boundary[:: len(boundary) // _NODES + 1]).place(q)
    low, high = some.min(axis=1, keepdims=True), some.max(axis=1, keepdims=True)
    within = ((places > low) & (places < high)).all(axis=2)
    samples = np.flatnonzero(within.any(axis=1))
    if not len(samples):
        return depth
    samples, corners = samples[:: len(samples) // _CLOSELY + 1], np.searchsorted(boundary, facets)
    for i, surface in zip(samples, body.kinematics.at(boundary).place(q[samples]), strict=True):
        x = surface[corners]
        size = np.linalg.norm(x[:, 1] - x[:, 0], axis=1)
        closest = closest_points(places[i, within[i]], x)
        facet_size = size[closest.facet]
        is_deep = (closest.gap < -_DEEP_IN_FACETS * facet_size) & (closest.offset <= _ROUND_OFF * facet_size)
        depth[i, within[i]] = np.where(is_deep, -closest.gap, -np.inf)
    return depth
