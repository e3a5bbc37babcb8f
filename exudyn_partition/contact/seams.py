"""How smooth faces that go on as each other share a contact near their seam, by the place of the contact alone.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..support.arrays import Array
from .smooth_faces import SmoothFace
from .true_surface import Torus, TrueSurface

_WIDTH = 0.08  # of the smallest radius of curvature: distance from a seam within which a contact is shared


class Shared(NamedTuple):
    """Faces of one side that share a contact, at its place on the first of them that has it.

    Parameters
    ----------
    surfaces : list of TrueSurface
        Of the faces.
    owner : int
        Number of the face on which the place is.
    shares : (m,) array
        Of the faces; their sum is one.
    slopes : (m, 3) array
        Derivatives of the shares by the place, in the body's axes [1/m].
    """

    surfaces: list[TrueSurface]
    owner: int
    shares: Array
    slopes: Array

    @classmethod
    def alone(cls, surface: TrueSurface) -> Shared:
        """A face that has all of the contact."""
        return cls([surface], 0, _ONE, _STILL)

    @property
    def varies(self) -> bool:
        """Whether the curvatures depend on the place."""
        return bool(self.slopes.any()) or any(
            share > 0.0 and isinstance(surface.shape, Torus)
            for share, surface in zip(self.shares, self.surfaces, strict=True)
        )

    @property
    def surface(self) -> TrueSurface:
        """That on which the place is."""
        return self.surfaces[self.owner]

    def bending(self, outward: Array) -> Array:
        """Curvatures that the contact has with its shares of the faces, see `TrueSurface.bending`, (3, 3) [1/m]."""
        if len(self.surfaces) == 1:
            return self.surfaces[0].bending(outward)
        parts = zip(self.shares, self.surfaces, strict=True)
        return np.asarray(sum(share * surface.bending(outward) for share, surface in parts if share))

    def bent(self, weights: Array, outward: Array) -> Array:
        """Derivative by the place, (3,), of the sum of weights, (3, 3), times `bending`."""
        result = np.zeros(3)
        for surface, share, slope in zip(self.surfaces, self.shares, self.slopes, strict=True):
            if share:
                result += share * surface.bent(weights, outward)
            if slope.any():
                result += float(np.sum(weights * surface.bending(outward))) * slope
        return result


_ONE, _STILL = np.ones(1), np.zeros((1, 3))


def shared(faces: Sequence[SmoothFace], owner: int, point: Array, outward: Array, width: float) -> Shared:
    """Shares of faces in a contact on one of them; those of the others end at a distance from their seams.

    At a seam each of two faces has half of it. Shares and their derivatives are continuous.

    Parameters
    ----------
    faces : sequence of SmoothFace
        The face on which the place is, and those that go on as it.
    owner : int
        Number of the former.
    point, outward : (3,) arrays
        Place [m], and outward unit normal there.
    width : float
        The distance [m].
    """
    odds, slopes = np.zeros(len(faces)), np.zeros((len(faces), 3))
    odds[owner] = 1.0
    for number, face in enumerate(faces):
        if number == owner:
            continue
        distance, away = face.beyond(point, outward)
        far = max(distance, 0.0) / width
        if far < 1.0:
            share = 0.5 - far * (15 - 10 * far**2 + 3 * far**4) / 16
            odds[number] = share / (1 - share)
            slopes[number] = -15 / 16 * (1 - far**2) ** 2 / (1 - share) ** 2 / width * away
    total = odds.sum()
    shares = odds / total
    slopes = (slopes - np.outer(shares, slopes.sum(axis=0))) / total
    return Shared([face.surface for face in faces], owner, shares, slopes)


def width_of(faces: Sequence[SmoothFace], largest_of_others: float) -> float:
    """Distance from a seam within which faces share a contact with a surface that has a largest curvature [1/m]: [m].

    It is the same for all faces that go on as each other, so that their shares sum to one.
    """
    return _WIDTH / (largest_curvature(faces) + largest_of_others)


def largest_curvature(faces: Sequence[SmoothFace]) -> float:
    """Largest curvature of faces and of all that go on as these [1/m]; zero if they are flat or hollow."""
    joined, left = list[SmoothFace](), [*faces]
    while left:
        face = left.pop()
        if face not in joined:
            joined.append(face)
            left.extend(face.neighbours)
    return max(face.surface.steepest for face in joined)
