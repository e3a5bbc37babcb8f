"""Which faces of two patches may touch at a point: each such pair has a contact of its own with formulation "hertz"."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from ..contact.rigid import RigidSurface
from ..contact.side import Side
from ..contact.smooth_faces import Faces, SmoothFace, faces_of
from ..contact.touching import ROLES, touching
from ..errors import ContactPatchWarning, InputError
from ..support.warn import warn

Pair = tuple[SmoothFace, ...]


def point_pairs(
    sides: Sequence[Side], patches: Sequence[int], surface: RigidSurface | None, *, carried: bool = False
) -> list[Pair]:
    """Pairs of smooth faces of two patches, or faces that touch a rigid surface, at a point.

    A warning says which faces are left out, for nothing keeps these out of the other side.

    Parameters
    ----------
    sides : sequence of Side
        Slave, and master if that is a patch too.
    patches : sequence of int
        Numbers of their patches.
    surface : RigidSurface, optional
        The master, if it is rigid.
    carried : bool
        Whether a body carries it, so that its axes are not known.

    Raises
    ------
    InputError
        If no two surfaces touch at a point, see `touching`.
    """
    faces = [faces_of(side, patch, role) for side, patch, role in zip(sides, patches, ROLES, strict=False)]
    axes = [side.kinematics.frame(np.zeros(side.n))[1] for side in sides] + [np.eye(3)] * (surface is not None)
    pairs, refused, left = list[Pair](), list[InputError](), list[list[str]]()
    for pair in itertools.product(*(each.known for each in faces)):
        try:
            found = touching(sides, patches, surface, [face.surface for face in pair])
            if not carried:
                found.check_crossing(axes)
            pairs.append(pair)
        except InputError as error:
            refused.append(error)
            left.append([_kind(face.surface.shape) for face in pair] + [_kind(surface)] * (surface is not None))
    if not pairs:
        raise refused[0]
    if refused or any(each.unknown for each in faces):
        warn(_left_out(faces, left, len(pairs)), ContactPatchWarning)
    return pairs


def only_pair(
    sides: Sequence[Side], patches: Sequence[int], surface: RigidSurface | None, *, carried: bool = False
) -> Pair:
    """Faces of two patches that touch at one point, see `point_pairs`.

    Raises
    ------
    InputError
        If they may touch at several points.
    """
    pairs = point_pairs(sides, patches, surface, carried=carried)
    if len(pairs) > 1:
        raise InputError(
            f"slave, master: these patches may touch at {len(pairs)} points, for they have several smooth faces "
            f"({'; '.join(_kinds(side) for side in zip(*pairs, strict=True))}). Give both in a list, "
            "CreatePartitionContact(mbs, [slave, master], formulation='hertz'), which returns a contact for each point"
        )
    return pairs[0]


def _kinds(faces: Sequence[SmoothFace]) -> str:
    """Kinds of faces, as "2 spheres, 1 plane"."""
    kinds = [_kind(face.surface.shape) for face in dict.fromkeys(faces)]
    return ", ".join(f"{kinds.count(kind)} {kind}{'s' * (kinds.count(kind) > 1)}" for kind in dict.fromkeys(kinds))


def _kind(shape: object) -> str:
    return type(shape).__name__.removeprefix("Rigid").lower()


def _left_out(faces: Sequence[Faces], left: Sequence[Sequence[str]], points: int) -> str:
    """Warning of pairs of faces, by their kinds, and facets without a point of contact."""
    named = [" on ".join(pair) for pair in left]
    said = [f"{kind} ({named.count(kind)})" for kind in dict.fromkeys(named)]
    said += [
        f"{each.unknown} facets of the {role} on no known surface"
        for role, each in zip(ROLES, faces, strict=False)
        if each.unknown
    ]
    return (
        f"formulation 'hertz' has {points} point{'s' * (points > 1)} between these patches. Left out, so that nothing "
        f"keeps them out of each other, are faces that do not touch at a point: {', '.join(said)}. Choose patches "
        "within round faces, or take formulation='compliance' if these touch"
    )
