"""Where smooth faces of two sides are nearest: those of a contact at a point, or others that go on as these.

Surfaces of faces have no ends; faces end at seams, where another face goes on, and at edges. All is a function of the
poses of both sides.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import InputError
from .rigid import RigidCylinder, RigidPlane, RigidSphere, RigidSurface
from .seams import Shared, largest_curvature, shared, width_of
from .side import Side
from .smooth_faces import SmoothFace
from .spot import Spot, SpotMaker
from .spot_stage import Meeting, Pose
from .touching import ROLES, Touching, touching
from .true_surface import TrueSurface, nearest_places

_APART = 0.75  # of the walls of both bodies: faces that overlap by more are on far sides, and the bodies are apart


@dataclass(frozen=True, eq=False)
class NearestFaces:
    """Faces of both sides that share a contact at a point.

    Parameters
    ----------
    near : list of list of SmoothFace
        Of each side that is a body: the contact's own face, then those that go on as it and touch the other side.
    pairs : dict of tuple of int to Touching
        How faces of both sides touch, by their numbers; the first is that of the contact's own faces.
    makers : list of SpotMaker
        Of the sides that are bodies.
    wall : float
        Thickness of what is behind the surface of a rigid side [m]; zero without one.
    size : float
        Smallest size of a facet of both sides [m].
    """

    near: list[list[SmoothFace]]
    pairs: dict[tuple[int, ...], Touching]
    makers: list[SpotMaker]
    wall: float
    size: float

    @classmethod
    def of(
        cls, sides: Sequence[Side], patches: Sequence[int], surface: RigidSurface | None, faces: Sequence[SmoothFace]
    ) -> NearestFaces:
        """Those of two sides, of which the second may be a rigid surface; see `SpotGaps` for what is raised."""

        def touches(chosen: Sequence[SmoothFace]) -> Touching | None:
            try:
                return touching(sides, patches, surface, [face.surface for face in chosen])
            except InputError:
                return None

        own, near = touching(sides, patches, surface, [face.surface for face in faces]), [[face] for face in faces]
        for number, face in enumerate(faces):
            for other in face.neighbours:
                if touches([*faces[:number], other, *faces[number + 1 :]]) is not None:
                    near[number].append(other)
        pairs = {(0,) * len(near): own}
        for numbers in itertools.product(*(range(len(of_side)) for of_side in near)):
            chosen = [of_side[number] for of_side, number in zip(near, numbers, strict=True)]
            if numbers not in pairs and (pair := touches(chosen)) is not None:
                pairs[numbers] = pair
        parts = zip(sides, faces, own.materials, ROLES, strict=False)
        makers = [SpotMaker(*each) for each in parts]
        return cls(near, pairs, makers, _thickness(surface), min(side.surface.facet_size for side in sides))

    @cached_property
    def faces(self) -> list[SmoothFace]:
        """The contact's own faces."""
        return [of_side[0] for of_side in self.near]

    @cached_property
    def own(self) -> Touching:
        """How these touch."""
        return next(iter(self.pairs.values()))

    @cached_property
    def owners(self) -> tuple[int, ...]:
        """Their numbers."""
        return (0,) * len(self.near)

    @cached_property
    def width(self) -> float:
        """Distance from a seam within which faces share the contact [m]."""
        curvatures = [largest_curvature([face]) for face in self.faces]
        curvatures += [shape.steepest for shape in self.own.shapes[len(self.faces) :]]
        return width_of(self.faces[:1], curvatures[1])

    def meeting(self, poses: Sequence[Pose], pair: Touching | None = None) -> Meeting:
        """Where the surfaces of the own faces are nearest, or of a pair of others, without the ends of faces."""
        pair = pair or self.own
        if pair.ball is None:
            return self._of_tubes(poses, pair.shapes)
        shapes, ball, second = pair.shapes, pair.ball, 1 - pair.ball
        facing = shapes[second].shape
        towards = facing.normal if isinstance(facing, RigidPlane) else np.zeros(3)
        form = shapes[ball].ball_at(-(poses[second].axes @ towards) @ poses[ball].axes)
        assert form is not None
        centre, radius = form
        place = poses[ball].out(centre)
        gap, normal = facing.project(poses[second].into(place)[None])
        outward = poses[second].axes @ normal[0]
        foot = poses[second].into(place) - gap[0] * normal[0]
        of_ball = -outward @ poses[ball].axes
        points, normals = {second: foot, ball: centre + radius * of_ball}, {second: normal[0], ball: of_ball}
        sides = range(len(self.near))
        return Meeting(
            float(gap[0]) - radius,
            outward if second == 1 else -outward,
            [points[n] for n in sides],
            [normals[n] for n in sides],
        )

    def _of_tubes(self, poses: Sequence[Pose], shapes: Sequence[TrueSurface]) -> Meeting:
        """See `meeting`; both sides are tubes or cylinders."""
        middles = []
        for pose, shape in zip(poses, shapes, strict=True):
            middle = shape.middle
            assert middle is not None
            middles.append(middle._replace(centre=pose.out(middle.centre), axis=pose.axes @ middle.axis))
        places = nearest_places(*middles)
        arm = places[0] - places[1]
        distance = float(np.linalg.norm(arm))
        outward = arm / distance
        points, normals = [], []
        for pose, middle, place, facing in zip(poses, middles, places, (-outward, outward), strict=True):
            points.append(pose.into(place + middle.radius * facing))
            normals.append(facing @ pose.axes)
        n = len(self.near)
        return Meeting(distance - middles[0].radius - middles[1].radius, outward, points[:n], normals[:n])

    def on_faces(self, poses: Sequence[Pose]) -> tuple[Meeting, tuple[int, ...]]:
        """Where the faces are nearest, with those that go on as them, and the numbers of these on each side.

        Off its face, the point of contact is at the end of that.
        """
        if not any(len(face.seam) for face in self.faces):
            return self.meeting(poses), self.owners
        best, bound = None, math.inf
        for numbers, pair in self.pairs.items():
            meeting = self.meeting(poses, pair)
            if meeting.gap >= bound or (best is not None and self.behind(meeting)):
                continue  # faces are no nearer to each other than the surfaces on which they lie
            meeting = self._between_ends(numbers, meeting, pair.shapes, poses)
            if meeting.gap < bound and self._covers(numbers, meeting):
                best, bound = (meeting, numbers), math.inf if self.behind(meeting) else meeting.gap
        assert best is not None
        return best

    def _between_ends(
        self, numbers: tuple[int, ...], meeting: Meeting, shapes: Sequence[TrueSurface], poses: Sequence[Pose]
    ) -> Meeting:
        """The meeting of faces by their numbers, at their ends; the gap is above zero if both are beyond these."""
        faces = [of_side[number] for of_side, number in zip(self.near, numbers, strict=True)]
        for side, face in enumerate(faces):
            if len(face.seam):
                meeting = self._within(side, face, meeting, shapes, poses)
        # The end of the second face may have moved the point on the first one, whose surface has no end.
        point, outward = meeting.points[0], meeting.outward[0]
        if meeting.gap > 0.0 or len(faces) == 1 or faces[0].from_seam(point) <= self.width:
            return meeting
        if faces[0].holds(point, outward):
            return meeting
        return meeting._replace(gap=max(-meeting.gap, self.size))

    def _within(
        self, number: int, face: SmoothFace, meeting: Meeting, shapes: Sequence[TrueSurface], poses: Sequence[Pose]
    ) -> Meeting:
        """The meeting of a face of one side, at the end of the face if it is beyond that."""
        points, outward = meeting.points[number], meeting.outward[number]
        if face.holds(points, outward):
            return meeting
        end, second = face.nearest_on_seam(points), 1 - number
        into = poses[second].into(poses[number].out(end))
        gap, normal = shapes[second].shape.project(into[None])
        facing = poses[second].axes @ normal[0]
        places, normals = {number: end, second: into - gap[0] * normal[0]}, {second: normal[0]}
        normals[number] = -facing @ poses[number].axes
        sides = range(len(self.near))
        return Meeting(
            float(gap[0]),
            facing if second == 1 else -facing,
            [places[n] for n in sides],
            [normals[n] for n in sides],
        )

    def _covers(self, numbers: tuple[int, ...], meeting: Meeting) -> bool:
        """Whether faces beside the own ones, by their numbers, have the point of contact: surfaces have no ends."""
        return all(
            of_side[number].covers(point, outward)
            for of_side, number, point, outward in zip(self.near, numbers, meeting.points, meeting.outward, strict=True)
            if number
        )

    def behind(self, meeting: Meeting, spots: Sequence[Spot] = ()) -> bool:
        """Whether surfaces overlap that do not touch there, as the lower face of a plate and a ball above it.

        No contact is as deep as a facet is long. Faces on the far sides of two bodies overlap by the walls of both and
        what is between these. Others overlap beside their ends. Where the spots are given, walls and ends are those at
        these.
        """
        depth = -meeting.gap
        if depth <= self.size:
            return False
        beside = not all(spot.whole for spot in spots)
        return beside or depth > _APART * self._walls(meeting, spots)

    def _walls(self, meeting: Meeting, spots: Sequence[Spot]) -> float:
        """Thickness of both bodies behind the point of contact [m]."""
        if spots:
            walls = [spot.wall for spot in spots]
        else:
            both = zip(self.makers, meeting.points, meeting.outward, strict=True)
            walls = [maker.wall(point, outward) for maker, point, outward in both]
        return sum(walls) + self.wall

    def shared_by(self, meeting: Meeting, owners: tuple[int, ...], inside: bool) -> tuple[Shared, ...]:
        """How faces of both sides share a contact at a point on those with these numbers, far `inside` or not."""
        result = []
        for of_side, owner, point, outward in zip(self.near, owners, meeting.points, meeting.outward, strict=True):
            if inside or len(of_side) == 1:
                result.append(Shared.alone(of_side[owner].surface))
            else:
                result.append(shared(of_side, owner, point, outward, self.width))
        return (*result, *map(Shared.alone, self.own.shapes[len(result) :]))


def _thickness(surface: RigidSurface | None) -> float:
    """Thickness of what is behind a rigid surface [m]; zero where there is none."""
    if isinstance(surface, RigidSphere) or (isinstance(surface, RigidCylinder) and not surface.hollow):
        return 2 * surface.radius
    return 0.0 if surface is None else math.inf
