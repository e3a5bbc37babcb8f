"""Which faces of two patches may touch at a point: each such pair has a contact of its own with formulation "hertz"."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from ..contact.rigid import RigidSurface
from ..contact.side import Side
from ..contact.smooth_faces import Faces, SmoothFace, faces_of
from ..contact.touching import ROLES, touching
from ..errors import ContactPatchWarning, InputError
from ..support.warn import warn

Pair = tuple[SmoothFace, ...]


def point_pairs(sides: Sequence[Side], patches: Sequence[int], surface: RigidSurface | None) -> list[Pair]:
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

    Raises
    ------
    InputError
        If no two surfaces touch at a point, see `touching`.
    """
    faces = [faces_of(side, patch, role) for side, patch, role in zip(sides, patches, ROLES, strict=False)]
    found, refused = list[Pair](), list[InputError]()
    for pair in itertools.product(*(each.known for each in faces)):
        try:
            touching(sides, patches, surface, [face.surface for face in pair])
            found.append(pair)
        except InputError as error:
            refused.append(error)
    if not found:
        raise refused[0]
    if refused or any(each.unknown for each in faces):
        warn(_left_out(faces, found, surface), ContactPatchWarning)
    return found


def only_pair(sides: Sequence[Side], patches: Sequence[int], surface: RigidSurface | None) -> Pair:
    """Faces of two patches that touch at one point, see `point_pairs`.

    Raises
    ------
    InputError
        If they may touch at several points.
    """
    found = point_pairs(sides, patches, surface)
    if len(found) > 1:
        raise InputError(
            f"slave, master: these patches may touch at {len(found)} points, for they have several smooth faces "
            f"({'; '.join(_kinds(side) for side in zip(*found, strict=True))}). Give both in a list, "
            "CreatePartitionContact(mbs, [slave, master], formulation='hertz'), which returns a contact for each point"
        )
    return found[0]


def _kinds(faces: Sequence[SmoothFace]) -> str:
    """Kinds of faces, as "2 spheres, 1 plane"."""
    kinds = [_kind(face) for face in dict.fromkeys(faces)]
    return ", ".join(f"{kinds.count(kind)} {kind}{'s' * (kinds.count(kind) > 1)}" for kind in dict.fromkeys(kinds))


def _kind(face: SmoothFace) -> str:
    return type(face.surface.shape).__name__.removeprefix("Rigid").lower()


def _left_out(faces: Sequence[Faces], found: Sequence[Pair], surface: RigidSurface | None) -> str:
    """Warning of faces without a point of contact."""
    said = []
    for role, each, used in zip(ROLES, faces, zip(*found, strict=True), strict=False):
        left = [face for face in each.known if face not in used]
        parts = [_kinds(left)] * bool(left) + [f"{each.unknown} facets on no known surface"] * bool(each.unknown)
        said += [f"{role}: {', '.join(parts)}"] * bool(parts)
    if surface is None and not said:
        said = ["pairs of faces that would touch along a line or in a face"]
    return (
        f"formulation 'hertz' has {len(found)} point{'s' * (len(found) > 1)} between these patches. Left out, so that "
        f"nothing keeps them out of the other side, are: {'; '.join(said)}. Choose patches within round faces, or take "
        "formulation='compliance' if these touch"
    )
