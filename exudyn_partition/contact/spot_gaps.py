"""The gap of a contact at one point that the mesh does not resolve, between the true surfaces of both sides.

One of both surfaces is a ball. The other one is a plane, a ball, a cylinder, a bore or a torus, of a body or rigid.
Or a torus touches a plane: the nearest point is that of the tube there, which is a ball for this. Or both are tori or
solid cylinders that cross: they touch where their middles are nearest. The row of the contact is the mean over a kernel
on each side (`surfaces.smooth_kernel`). It wanders over the patches with the point of contact: near its place it is
tilted, further away it is made anew. A patch may have several smooth faces; each two that touch have gaps of their own,
and where the surface goes on, they share the contact.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..errors import InputError, PenetrationError
from ..prediction.point_contact import PointContact
from ..support.arrays import Array
from ..support.attributes import FoundOnce
from ..surfaces.facing import PENETRATION_TOLERANCE
from ..surfaces.hulls import hull_distance
from ..surfaces.points import ContactPoints
from .anchoring import Anchoring
from .carrier import Carrier
from .gaps import Gaps, GapState, Placement
from .linear_gaps import LinearGaps
from .nearest_faces import NearestFaces
from .rigid import RigidPlane, RigidSurface
from .side import Side
from .sides import Sides
from .smooth_faces import SmoothFace
from .spot import Spot, SpotMaker
from .spot_stage import FrozenSpot, Meeting, Pose, SpotStage
from .stages import NOTHING, Anchor, Frozen, Present, PresentRows, Stage
from .touching import ROLES, Touching

_TILTED = 0.1  # of a kernel's radius: motion of the point of contact after which the kernel is made anew
_TOUCHES = 0.05  # of a facet's size: gap at the start up to which one of several points must have its kernel there
_STUCK = 0.25  # means of the logarithm of distances, under the kernel's pressure less under the traction of what sticks
_EVEN = 0.02  # relative difference of curvatures below which both axes of the ellipse are the same
_ALONG = 1e-3  # difference of a direction from the normal of contact, with a flexibility along this direction alone


class SpotRows(PresentRows):
    """The row of a contact at a point, with the spots of its sides.

    Parameters
    ----------
    points, leaves_at, sides
        See `PresentRows`.
    spots : list of Spot
    made_at : Anchor
        Where the spots were made: the flexibility is that under the kernels then, whatever tilts them.
    touching : tuple of (Touching, list of (3, 3) arrays, (3,) array)
        How its own faces touch there: axes of both sides, and the normal.
    inside : bool
        Whether the point is far from the ends of its faces.
    """

    spots: list[Spot]
    made_at: Anchor
    touching: tuple[Touching, list[Array], Array]
    inside: bool

    @FoundOnce
    def contact(self) -> PointContact:
        """Hertz's contact of its own faces there, which springs of friction keep.

        Surfaces that touch along a line have none, see `at_point`.
        """
        pair, axes, normal = self.touching
        return pair.contact(axes, normal)

    @property
    def even(self) -> bool:
        """Whether `contact` is so nearly a circle that its axes would turn with the least motion."""
        small, large = sorted(self.contact.curvatures)
        return large - small <= _EVEN * large

    @property
    def shear(self) -> tuple[float, float]:
        """Tangential moduli of both bodies along the ellipse of contact and across it, see `PointContact` [Pa]."""
        along, across = self.contact.shear_moduli(self.touching[0].materials)
        mean = (along + across) / 2
        return (mean, mean) if self.even else (along, across)

    def reaches(self, meeting: Meeting) -> bool:
        """Whether the point of contact is near the centres of the spots."""
        return all(
            np.linalg.norm(point - spot.kernel.centre) <= _TILTED * spot.radius
            for spot, point in zip(self.spots, meeting.points, strict=True)
        )

    @property
    def lacking(self) -> Array:
        """Flexibility to be added to that of the row, along the normal and across it, (2,) [m/N]."""
        return np.asarray(sum(spot.lacking for spot in self.spots))


class SpotGaps(Gaps):
    """Gap of the true surfaces of one or two patches, at the point where they are nearest.

    Parameters
    ----------
    sides : sequence of Side
        Slave, and master if that is a patch too.
    patches : sequence of int
        Numbers of their patches.
    surface : RigidPlane, RigidSphere or RigidCylinder, optional
        The master, if it is rigid, in the frame of the body that carries it.
    pose, motion
        See `rigid.RigidGaps`.
    faces : sequence of SmoothFace
        Face of each side's patch.

    Raises
    ------
    InputError
        If a surface is none of these, they touch at no point, or the patches do not hold the kernel.
    PenetrationError
        If the surfaces overlap at the start.
    """

    def __init__(
        self,
        sides: Sequence[Side],
        patches: Sequence[int],
        surface: RigidSurface | None = None,
        pose: Callable[[], tuple[Array, Array]] | None = None,
        motion: Callable[[], tuple[Array, Array]] | None = None,
        *,
        faces: Sequence[SmoothFace],
    ) -> None:
        self._surface, self.carrier = surface, Carrier(pose, motion)
        self.carried = pose is not None
        self.faces = tuple(faces)
        self._nearest = NearestFaces.of(sides, patches, surface, faces)
        self.own, self.makers = self._nearest.own, self._nearest.makers
        self._prepare(sides)

    @property
    def contact(self) -> PointContact:
        """Hertz's contact of the two surfaces, where they are."""
        if self.spot_rows.inside and self.own.round is not None:
            return self.own.round
        return self.spot_stage.contact

    def _prepare(self, sides: Sequence[Side]) -> None:
        """Find the spots at the start."""
        self.sides = Sides(sides)
        self.size = self._nearest.size
        self._middles = [maker.points.mean(axis=0) for maker in self.makers]
        self.anchoring = Anchoring(self)
        self._start_q = np.zeros(self.n)
        meeting = self._nearest.meeting(self._rough_poses(self._start_q, self.carrier.pose))
        if not self.carried:
            place = self._contact_place(meeting)
            self.sides = Sides(side.seen_from(place) for side in sides)
        slave = self.makers[0].points
        self._row_node = int(np.linalg.norm(slave - meeting.points[0], axis=1).argmin())
        start = Anchor(self._start_q, self.carrier.pose, NOTHING)
        meeting = self._meeting_at(start)
        rows = self._rows_where(meeting, start)
        stage, gap = self._stage_at(
            rows, rows.sides.places(self._start_q, self.growing), self._start_q, meeting=meeting
        )
        self._check_start(rows, stage, gap)
        self._start_rows = rows
        self.all_points, self.placement = rows.points, Placement(-stage.normals[0], float(gap[0]))
        self._start = self._frozen(stage, gap) if self._may_freeze else stage
        self.return_to(Present(self._start, self._start_q, self._start.places, None, NOTHING))

    def _contact_place(self, meeting: Meeting) -> Array:
        """Place of the point of contact on the slave at the start, (3,) [m]."""
        return self._rough_poses(self._start_q, self.carrier.pose)[0].out(meeting.points[0])

    def _check_start(self, rows: SpotRows, stage: SpotStage, gap: Array) -> None:
        """Raise if the spots cannot be computed, or if the true surfaces overlap at the start."""
        for maker, spot, side in zip(self.makers, rows.spots, self.sides, strict=True):
            alone = len(maker.face.facets) == len(side.surface.facets)
            touches = spot.covered and stage.share > 0.0 and (alone or gap[0] <= _TOUCHES * self.size)
            if touches or (alone and side.kinematics.linear and not side.surface.wanders):
                maker.check(spot)
            if touches or alone:
                _ = rows.contact  # raises an error if surfaces touch along a line
        for number, outward in enumerate(stage.meeting.outward):
            self._check_flexibility(number, outward)
        covered = all(spot.covered for spot in rows.spots) and not self._nearest.behind(stage.meeting, rows.spots)
        if covered and stage.meeting.gap < -PENETRATION_TOLERANCE * self.size:
            raise PenetrationError(
                f"the true surfaces overlap by {-stage.meeting.gap:.4g} m at the start; facets are chords, so that a "
                "ball is larger than its mesh. Move one body by at least that (referencePosition)"
            )

    def _check_flexibility(self, number: int, outward: Array) -> None:
        """Raise InputError if a side has no flexibility along the line of contact; its normal is in its axes."""
        side = self.sides[number]
        if not side.normal_only or isinstance(self.own.shapes[number].shape, RigidPlane):
            return
        line = side.kinematics.frame(np.zeros(side.n))[1] @ outward
        if side.surface.wanders or not side.kinematics.linear or 1 - line @ side.surface.direction > _ALONG:
            raise InputError(
                f"{ROLES[number]}: formulation 'hertz' needs the flexibility along the line of contact, "
                f"{line}, and wherever that turns, but the patch has it along {side.surface.direction} or along the "
                "normals of its nodes alone. Make the patch with axes='xyz'"
            )

    @property
    def _may_freeze(self) -> bool:
        """Whether the point of contact stays the same in the bodies, and gaps are linear in the coordinates."""
        ball_on_plane = self.own.ball == 0 and isinstance(self._surface, RigidPlane) and not self.carried
        stays = self._start_rows.inside and all(spot.covered for spot in self._start_rows.spots)
        return ball_on_plane and self.sides[0].kinematics.linear and stays

    def _frozen(self, stage: SpotStage, gap: Array) -> Frozen:
        H = stage.on_coordinates(self._start_q)
        no_drift = np.zeros((0, self.n)), np.zeros(0)
        frozen = FrozenSpot(stage.rows, stage.normals, stage.shares, LinearGaps(H, gap, *no_drift, 0.0))
        frozen.meeting, frozen.share = stage.meeting, stage.share
        frozen.contact = stage.contact
        return frozen

    # The true surfaces.

    def _rough_poses(self, q: Array, carried: Array, growing: Array = NOTHING) -> list[Pose]:
        """Poses of the sides by the mean motion of their patches, which depend on no spot.

        The rigid surface's carrier is at a pose, (12,).
        """
        poses = []
        both = zip(self.sides, self._middles, self.sides.split(q), self.sides.growths(growing), strict=True)
        for side, middle, part, products in both:
            place = replace(side, active=None).place(part, products).mean(axis=0)
            poses.append(Pose(place, middle, side.kinematics.frame(part)[1]))
        return self._all_poses(poses, carried)

    def _poses(
        self, places: Sequence[Array], weights: Sequence[Array], rows: SpotRows, axes: Sequence[Array], carried: Array
    ) -> list[Pose]:
        """Poses of the sides, with these axes, by the mean motion of the nodes of spots with their weights.

        The rigid surface's carrier is at a pose, (12,).
        """
        poses = []
        for x, share, spot, maker, turned in zip(places, weights, rows.spots, self.makers, axes, strict=True):
            nodes = spot.kernel.nodes
            poses.append(Pose(share @ x[nodes], share @ maker.points[nodes], turned))
        return self._all_poses(poses, carried)

    def _all_poses(self, poses: list[Pose], carried: Array) -> list[Pose]:
        """Poses of both sides, a rigid surface included."""
        return poses if self._surface is None else [*poses, self._rigid_pose(carried)]

    def _rigid_pose(self, carried: Array) -> Pose:
        if not len(carried):
            return Pose(-self.centre, np.zeros(3), np.eye(3))
        return Pose(carried[:3] - self.centre, np.zeros(3), carried[3:].reshape(3, 3))

    # Rows and stages.

    def _rows_at(self, anchor: Anchor) -> SpotRows:
        """The row with spots that are made where the surfaces are nearest at an anchor."""
        return self._rows_where(self._meeting_at(anchor), anchor)

    def _meeting_at(self, anchor: Anchor) -> Meeting:
        """Where the faces are nearest at an anchor, by the mean motion of patches."""
        return self._nearest.on_faces(self._rough_poses(anchor.q, anchor.pose, anchor.growing))[0]

    def _rows_where(self, meeting: Meeting, anchor: Anchor) -> SpotRows:
        """See `_rows_at`; `meeting` is where the surfaces are nearest."""
        where = zip(self.makers, meeting.points, meeting.outward, strict=True)
        spots = [maker.at(point, outward) for maker, point, outward in where]
        kernel, surface = spots[0].kernel, self.sides[0].surface
        n = len(surface.points)
        points = ContactPoints(
            nodes=kernel.nodes[None],
            weights=kernel.weights[None],
            mean=sp.csr_matrix(np.ones((1, 1))),
            row_nodes=np.array([self._row_node]),
            area=np.zeros(1),
            pressures=sp.csr_matrix((n, n)),
        )
        sides = self.sides.following([spot.kernel.nodes for spot in spots])
        rows = SpotRows(points, np.array([np.inf if all(spot.whole for spot in spots) else 0.0]), sides)
        rows.spots, rows.made_at = spots, anchor
        rows.inside = all(
            face.from_seam(point) > 2 * _TILTED * spot.radius + self._nearest.width and face.holds(point, outward)
            for face, spot, point, outward in zip(self.faces, spots, meeting.points, meeting.outward, strict=True)
        )
        rows.touching = self.own, self._axes(anchor.q, anchor.pose), meeting.normal
        return rows

    def _stage_at(
        self, rows: SpotRows, places: list[Array], q: Array, pose: Array | None = None, meeting: Meeting | None = None
    ) -> tuple[SpotStage, Array]:
        """Stage of a row with nodes at places, (np, 3) for each side [m], and its gap, (1,) [m].

        `q`, (n,), are the coordinates, and `pose` is that of the surface's carrier, by default the present one.
        `meeting` is where the faces are nearest, if that is known, as of bodies that are not deformed.
        """
        pose = self.carrier.pose if pose is None else pose
        weights = [spot.kernel.weights for spot in rows.spots]
        axes = [side.kinematics.frame(part)[1] for side, part in zip(self.sides, self.sides.split(q), strict=True)]
        if meeting is None or rows.inside:
            meeting = self._where(rows, self._poses(places, weights, rows, axes, pose))[0]
        where = zip(rows.spots, self.makers, meeting.points, meeting.outward, strict=True)
        weights = [
            spot.kernel.around(maker.points[spot.kernel.nodes], point, outward) for spot, maker, point, outward in where
        ]
        poses = self._poses(places, weights, rows, axes, pose)
        meeting, owners = self._where(rows, poses)
        stage = self._stage_where(rows, meeting, owners, poses)
        signs = (1.0, -1.0)
        stage.shares = tuple(
            (spot.kernel.nodes[None], sign * weight[None])
            for spot, weight, sign in zip(rows.spots, weights, signs, strict=False)
        )
        stage.places, stage.pose = places, pose
        stage.tilts = self._tilts(rows, places, stage)
        return stage, np.array([meeting.gap if stage.share > 0.0 else max(abs(meeting.gap), self.size)])

    def _where(self, rows: SpotRows, poses: list[Pose]) -> tuple[Meeting, tuple[int, ...]]:
        """See `NearestFaces.on_faces`; a point of rows that are far from the ends of faces stays on its own."""
        nearest = self._nearest
        return (nearest.meeting(poses), nearest.owners) if rows.inside else nearest.on_faces(poses)

    def _stage_where(self, rows: SpotRows, meeting: Meeting, owners: tuple[int, ...], poses: list[Pose]) -> SpotStage:
        """Stage of a row without its weights; poses are those of both sides."""
        stage = SpotStage(rows, meeting.normal[None].copy(), ())
        stage.meeting, stage.poses, stage.modulus = meeting, tuple(poses), self.own.modulus
        stage.shared_by = self._nearest.shared_by(meeting, owners, rows.inside)
        stage.share = math.prod(float(by.shares[0]) for by in stage.shared_by) * self._left(rows, meeting)
        return stage

    def _tilts(self, rows: SpotRows, places: list[Array], stage: SpotStage) -> tuple[Array, ...]:
        """See `SpotStage.tilts`."""
        tilts = []
        parts = zip(rows.spots, self.makers, places, stage.poses, stage.meeting.outward, strict=False)
        for spot, maker, x, pose, outward in parts:
            nodes = spot.kernel.nodes
            along = x[nodes] @ (pose.axes @ outward) - maker.points[nodes] @ outward
            tilts.append(along @ spot.kernel.slopes)
        return tuple(tilts)

    def _left(self, rows: SpotRows, meeting: Meeting) -> float:
        """Share of the contact that is left at the end of patches; none where surfaces do not touch."""
        if self._nearest.behind(meeting, rows.spots):
            return 0.0
        parts = zip(self.makers, rows.spots, meeting.points, meeting.outward, strict=True)
        return math.prod(
            spot.left(maker.points, maker.face.around, point, outward) for maker, spot, point, outward in parts
        )

    @property
    def spot_stage(self) -> SpotStage | FrozenSpot:
        """The stage, where the point of contact is known."""
        stage = self.stage
        assert isinstance(stage, SpotStage | FrozenSpot)
        return stage

    @property
    def beside(self) -> bool:
        """See `Gaps.beside`."""
        return self.spot_stage.share == 0.0

    def goes_on_as(self, other: SpotGaps) -> bool:
        """Whether another contact of the same patches shares this one, near seams of their faces."""
        same_master = self._surface == other._surface
        return same_master and all(face in near for near, face in zip(self._nearest.near, other.faces, strict=True))

    def least_distance(self, q: Array) -> float:
        """See `Gaps.least_distance`; faces are no nearer to each other than the surfaces on which they lie.

        Nor are they nearer than the hulls of their nodes, out of which they reach by `_reach_of`. Where surfaces and
        hulls overlap, it is the distance of the nodes of one face from the other surface, less a facet's size.
        """
        if self.carried:
            return -np.inf
        parts = zip(self._of_faces, self.sides.split(q), self.sides.growths(self.growing), strict=True)
        places = [side.seen.place(*part) for side, *part in parts]
        points = [maker.points[face.nodes] for maker, face in zip(self.makers, self.faces, strict=True)]
        axes = [side.kinematics.frame(part)[1] for side, part in zip(self.sides, self.sides.split(q), strict=True)]
        poses = [Pose(x.mean(axis=0), X.mean(axis=0), turn) for x, X, turn in zip(places, points, axes, strict=True)]
        both = zip(poses, points, places, strict=True)
        deformed = sum(float(np.linalg.norm(pose.out(X) - x, axis=1).max()) for pose, X, x in both)
        whole = self._all_poses(poses, self.carrier.pose)
        least = self._nearest.meeting(whole).gap - deformed
        if len(places) > 1:
            least = max(least, hull_distance(*places) - sum(map(self._reach_of, self.makers)))
        for number, x in enumerate(places if least <= 0.0 else ()):
            gaps = self.own.shapes[1 - number].shape.project(whole[1 - number].into(x))[0]
            least = max(least, float(gaps.min()) - self.size - deformed)
        return least

    @cached_property
    def _of_faces(self) -> list[Side]:
        """The sides, each with the nodes of the contact's own face alone."""
        return [side.following(face.nodes) for side, face in zip(self.sides, self.faces, strict=True)]

    def _reach_of(self, maker: SpotMaker) -> float:
        """How far from the nodes of its face a contact may be, which goes on beyond seams and ends [m]."""
        face = maker.face
        beyond = maker.widest if face.ends else 0.0
        return face.bulge + max(beyond, self._nearest.width if len(face.seam) else 0.0)

    @property
    def long_axis(self) -> Array:
        """Unit vector along the major semi-axis of `SpotRows.contact`, in space, (3,); of no meaning in a circle."""
        normal = self.spot_stage.meeting.normal
        bent = self.own.bending(self._axes(self.present.q, self.stage.pose), normal)
        size = 2 * max(self.spot_rows.contact.curvatures)
        return np.asarray(np.linalg.eigh(bent + size * np.outer(normal, normal))[1][:, 0])

    def _axes(self, q: Array, carried: Array) -> list[Array]:
        """Axes of both sides as columns, (3, 3), at coordinates and the pose of the rigid surface's carrier, (12,)."""
        axes = [side.kinematics.frame(part)[1] for side, part in zip(self.sides, self.sides.split(q), strict=True)]
        return axes if self._surface is None else [*axes, self._rigid_pose(carried).axes]

    def curved(self, tangents: Array) -> tuple[Array, Array]:
        """Tangential flexibility that curved bodies add between their kernels and a contact of mean semi-axis a.

        It is a factor, (2, 2) [m/N], times - log(a / 1 m), plus a part that is fixed, (2, 2) [m/N]. The tangents are
        (2, 3), in space.
        """
        factor, fixed = np.zeros((2, 2)), np.zeros((2, 2))
        for side, q, spot in zip(self.sides, self.present.coordinates, self.spot_rows.spots, strict=True):
            turned = tangents @ side.kinematics.frame(q)[1]
            curved = turned @ spot.curved @ turned.T
            factor += curved
            fixed += (math.log(spot.radius) - _STUCK) * curved
        return factor, fixed

    @property
    def spot_rows(self) -> SpotRows:
        """The present row with its spots."""
        rows = self.stage.rows
        assert isinstance(rows, SpotRows)
        return rows

    def _go_to_start(self) -> None:
        """See `Gaps`."""
        self._go_to_stage(self._start.for_run(), self._start_q)
        if self.carried:
            self.at(self._start_q)  # the carrier may be elsewhere

    def at(self, q: Array) -> Array:
        """See `Gaps.at`."""
        if isinstance(self.stage, Frozen):
            self._go_to_stage(self.stage, q)
            return self.stage.gap(q)
        pose, rows = self.carrier.pose, self.spot_rows
        stage, gap = self._stage_at(rows, rows.sides.places(q, self.growing), q, pose)
        if not rows.reaches(stage.meeting):
            rows = self._rows_at(Anchor(q.copy(), pose, self.growing))
            stage, gap = self._stage_at(rows, rows.sides.places(q, self.growing), q, pose)
        self._go_to_stage(stage, q)
        return gap

    def of_present(self, q: Array) -> Array:
        """See `Gaps.of_present`."""
        if isinstance(self.stage, Frozen):
            return self.at(q)
        rows = self.spot_rows
        stage, gap = self._stage_at(rows, rows.sides.places(q, self.growing), q)
        self._go_to_stage(stage, q)
        return gap

    def surface_gap(self, q: Array, dents: Sequence[Array] | None = None) -> float:
        """See `Gaps.surface_gap`; it is the gap of the true surfaces."""
        rows = self.spot_rows
        stage, gap = self._stage_at(rows, rows.sides.places(q, self.growing), q)
        if not rows.reaches(stage.meeting):
            rows = self._rows_at(Anchor(q.copy(), self.carrier.pose, self.growing))
            gap = self._stage_at(rows, rows.sides.places(q, self.growing), q)[1]
        return float(gap[0])

    # State.

    def after(self) -> GapState:
        """See `Gaps`."""
        return replace(super().after(), chosen=None if not self.moving else self.spot_rows.made_at)

    def accept(self, state: GapState) -> None:
        """See `Gaps`."""
        super().accept(state)
        self._take_rows(state)

    def _take_rows(self, state: GapState) -> None:
        """See `Gaps`."""
        if state.chosen is not None and not self.spot_rows.made_at.equals(state.chosen):
            rows = self._rows_at(state.chosen)
            q = self.present.q
            stage = self._stage_at(rows, rows.sides.places(q, self.growing), q)[0]
            self._put_stage(stage)

    def _at_state(self, state: GapState) -> Array:
        """See `Gaps`; the carrier may not be there yet."""
        if not len(state.pose):
            return self.at(state.q)
        rows = self.spot_rows
        stage, gap = self._stage_at(rows, rows.sides.places(state.q, self.growing), state.q, state.pose)
        self._go_to_stage(stage, state.q)
        return gap

    def stance(self) -> Array:
        """See `Gaps.stance`: the point of contact on each side."""
        return np.concatenate(self.spot_stage.meeting.points) / self.size

    def stage_at(self, anchor: Anchor, rows: PresentRows) -> Stage:
        """See `Gaps`."""
        assert isinstance(rows, SpotRows)
        stage = self._stage_at(rows, rows.sides.places(anchor.q, anchor.growing), anchor.q, anchor.pose)[0]
        stage.of_anchor = True
        return stage
