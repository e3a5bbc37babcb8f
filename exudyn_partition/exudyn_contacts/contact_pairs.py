"""Which pairs of a list of bodies and rigid surfaces get contacts: those near each other, and skins with everything."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..contact.rigid import RigidSurface
from ..errors import EmptyRegionError, InputError
from ..exudyn_bodies.carriers import pose, validate_carrier
from ..exudyn_bodies.model import registered
from ..exudyn_bodies.partition_body import PartitionBody
from ..reduction.body import ReducedBody
from ..support.arrays import Array
from ..support.checks import listed, validate_positive
from ..support.foreign import MainSystem, ObjectIndex
from ..surfaces.near import faces_near, near_patches
from .contact_plan import RIGID, BodyPatch, SideOf, side_at_start

CarriedSurface = tuple[RigidSurface, ObjectIndex | None]  # and the body that carries it; None if it is fixed in space


class FoundPair(NamedTuple):
    """A pair that gets a contact.

    Parameters
    ----------
    slave : (PartitionBody, int)
    master : (PartitionBody, int) or RigidSurface
    anywhere : bool
        Whether both may touch anywhere at any time: one of the patches is the skin of its body.
    carrier : exudyn.ObjectIndex, optional
        The body that carries the rigid surface. Default: it is fixed in space.
    """

    slave: BodyPatch
    master: BodyPatch | RigidSurface
    anywhere: bool
    carrier: ObjectIndex | None = None


def pairs_of(
    mbs: MainSystem, members: object, within: float | None, side_of: SideOf = side_at_start
) -> list[FoundPair]:
    """Pairs of a list of bodies and rigid surfaces that get contacts.

    The skin of a body meets all other members, wherever they are. Other patches meet what they face nearby.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    members : sequence of PartitionBody, RigidSurface, or (RigidSurface, exudyn.ObjectIndex)
        The latter is a surface and the body that carries it.
    within : float, optional
        Distance up to which a pair gets a contact [m]. Default: any distance for skins; the radius of the smaller patch
        for others.
    side_of : callable
        Finds the side of a body and the number of one of its patches.

    Raises
    ------
    InputError
        If members are not at least two, each of them once, with a body among them.
    EmptyRegionError
        If there are no pairs.
    """
    bodies, surfaces = _members(mbs, members)
    if within is not None:
        within = validate_positive("within", within, "m")
    sides = [(item, patch) for item in bodies for patch in range(len(item.body.partition.patches))]
    placed = [side_of(*side).surface for side in sides]
    skins = [is_skin(item.body, patch) for item, patch in sides]
    owners = [place for place, item in enumerate(bodies) for _ in item.body.partition.patches]
    boxes = [np.array([surface.points.min(axis=0), surface.points.max(axis=0)]) for surface in placed]

    def between_bodies() -> Iterator[tuple[int, int, bool]]:
        near = [] if all(skins) else near_patches(placed, owners, within)
        yield from ((i, j, False) for i, j in near if not (skins[i] or skins[j]))
        for i, j in zip(*np.triu_indices(len(sides), 1), strict=True):
            if (skins[i] or skins[j]) and owners[i] != owners[j]:
                if within is None or _apart(boxes[i], boxes[j]) <= within:
                    yield int(i), int(j), True

    pairs = [FoundPair(sides[i], sides[j], anywhere) for i, j, anywhere in between_bodies()]
    for surface, carrier in surfaces:
        for side, patch, skin in zip(sides, placed, skins, strict=True):
            projected = _projected(mbs, surface, carrier, patch.points)
            if (skin and within is None) or faces_near(patch, *projected, within, anywhere=skin):
                pairs.append(FoundPair(side, surface, skin, carrier))
    if not pairs:
        raise EmptyRegionError(
            f"slave: no two patches of these {len(bodies)} bodies face each other nearby. Give a larger distance by "
            "within=, name the pairs in a call each, or reduce the bodies with skin=True for contact anywhere"
        )
    return pairs


def _members(mbs: MainSystem, members: object) -> tuple[list[PartitionBody], list[CarriedSurface]]:
    """Bodies and rigid surfaces of a list."""
    expected = (
        "slave: expected a list of what CreatePartitionBody returns, and of rigid surfaces if there are any. One that "
        "a body carries is a pair in the list, (surface, body)"
    )
    if (items := listed(members)) is None:
        raise InputError(f"{expected}, got {type(members).__name__}")
    bodies, surfaces = list[PartitionBody](), list[CarriedSurface]()
    for i, item in enumerate(items):
        carried = isinstance(item, tuple) and len(item) == 2
        surface, carrier = item if carried else (item, None)
        if isinstance(item, PartitionBody):
            bodies.append(item)
        elif isinstance(surface, RIGID):
            if carried:
                validate_carrier(f"slave: body of index {i}", mbs, carrier)
            surfaces.append((surface, carrier))
        else:
            raise InputError(f"{expected}, got {type(item).__name__} at index {i}")
    _check_members(mbs, bodies, surfaces)
    return bodies, surfaces


def _check_members(mbs: MainSystem, bodies: Sequence[PartitionBody], surfaces: Sequence[CarriedSurface]) -> None:
    """Raise InputError unless something can touch, and each member is given once and belongs to the model."""
    given = [*bodies, *(surface for surface, _ in surfaces)]
    if len(given) < 2 or not bodies or len(set(map(id, given))) < len(given):
        raise InputError(
            f"slave: expected at least one body and something that it can touch, each of them once, got {len(bodies)} "
            f"bodies and {len(surfaces)} rigid surfaces"
        )
    known = [*registered(mbs).bodies.values()]
    for item in bodies:
        if item not in known:
            raise InputError(f"slave: body {item.name!r} belongs to another model, or to this one before a Reset")


def _projected(
    mbs: MainSystem, surface: RigidSurface, carrier: ObjectIndex | None, points: Array
) -> tuple[Array, Array]:
    """Gaps, (k,) [m], and outward normals, (k, 3), of a rigid surface at points in space, (k, 3)."""
    if carrier is None:
        return surface.project(points)
    place, axes = pose(mbs, carrier)()
    gap, normals = surface.project((points - place) @ axes)
    return gap, normals @ axes.T


def is_skin(body: ReducedBody, patch: int) -> bool:
    """Whether contact wanders over a patch that has all faces of the body, but for those beside its other ones."""
    partition = body.partition
    candidate = partition.patches[patch]
    if not candidate.wanders:
        return False
    others = [each.nodes for i, each in enumerate(partition.patches) if i != patch]
    taken = np.concatenate([np.empty(0, dtype=np.int64), *others, *(joint.nodes for joint in partition.interfaces)])
    free = body.facets[~np.isin(body.facets, taken).any(axis=1)]
    return bool(len(free)) and bool(np.isin(free, candidate.nodes).all())


def _apart(first: Array, second: Array) -> float:
    """Distance of two boxes, each by its lower and upper corner, (2, 3) [m]."""
    return float(np.linalg.norm(np.maximum(np.maximum(first[0] - second[1], second[0] - first[1]), 0.0)))
