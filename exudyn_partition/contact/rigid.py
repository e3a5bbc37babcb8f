"""Rigid surfaces that a patch can meet: plane, sphere and cylinder, and the gaps of a patch to them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..errors import InputError, PenetrationError, RunError
from ..frames.kinematics import Rows
from ..support.arrays import Array, Vector, as_read_only
from ..support.attributes import FoundOnce
from ..support.checks import validate_flag, validate_positive, validate_vector
from ..surfaces.facing import PENETRATION_TOLERANCE
from ..surfaces.points import ContactPoints, RowKind
from . import loops
from .anchoring import Anchoring
from .carrier import Carrier
from .gaps import Gaps, GapState, Placement
from .linear_gaps import LinearGaps
from .pairings import points_of, values_on_plane
from .rigid_mesh import RigidMesh
from .side import Side
from .sides import Sides
from .stages import FEW, NOTHING, Anchor, Frozen, Present, PresentRows, Stage

_LEFT = 0.05  # of a row's depth: with less of a sheet before it, the row has passed through


class RigidSurface(Protocol):
    """A surface that gives the distance of points from it."""

    def project(self, x: Array) -> tuple[Array, Array]:
        """Gaps, (k,) [m], and outward unit normals, (k, 3), at points x, (k, 3)."""


@dataclass(frozen=True, eq=False)
class RigidPlane:
    """Half-space behind a plane.

    Parameters
    ----------
    point : (3,)
        A point on the plane [m].
    normal : (3,)
        Outward normal; any length.
    """

    point: Array = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    normal: Array = (0.0, 0.0, 1.0)  # type: ignore[assignment]

    if TYPE_CHECKING:  # any three numbers are accepted; they are kept as arrays

        def __init__(self, point: Vector = ..., normal: Vector = ...) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", validate_vector("point", self.point))
        object.__setattr__(self, "normal", _unit("normal", self.normal))

    def project(self, x: Array) -> tuple[Array, Array]:
        """Gaps, (k,) [m], and outward unit normals, (k, 3), at points x, (k, 3)."""
        # As arrays of their own: loops would be compiled again for normals that share memory.
        return (x - self.point) @ self.normal, np.tile(self.normal, (*x.shape[:-1], 1))

    @property
    def primitive(self) -> loops.Primitive:
        """The plane as loops take it."""
        return loops.Primitive(0, self.point, self.normal, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class RigidSphere:
    """Solid sphere.

    Parameters
    ----------
    center : (3,)
        Centre [m].
    radius : float
        Radius [m].
    """

    center: Array
    radius: float

    if TYPE_CHECKING:  # any three numbers are accepted; they are kept as arrays

        def __init__(self, center: Vector, radius: float) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", validate_vector("center", self.center))
        object.__setattr__(self, "radius", validate_positive("radius", self.radius, "m"))

    def project(self, x: Array) -> tuple[Array, Array]:
        """Gaps, (k,) [m], and outward unit normals, (k, 3), at points x, (k, 3)."""
        return _from_axis(x - self.center, self.radius)

    @property
    def primitive(self) -> loops.Primitive:
        """The sphere as loops take it."""
        return loops.Primitive(1, self.center, as_read_only(np.zeros(3)), self.radius, 1.0)


@dataclass(frozen=True, eq=False)
class RigidCylinder:
    """Solid cylinder of infinite length, or a bore.

    Parameters
    ----------
    point : (3,)
        A point on the axis [m].
    axis : (3,)
        Direction of the axis; any length.
    radius : float
        Radius [m].
    hollow : bool
        Whether it is a bore in which bodies move, such as a guide or the outer race of a bearing.
    """

    point: Array
    axis: Array
    radius: float
    hollow: bool = False

    if TYPE_CHECKING:  # any three numbers are accepted; they are kept as arrays

        def __init__(self, point: Vector, axis: Vector, radius: float, *, hollow: bool = ...) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", validate_vector("point", self.point))
        object.__setattr__(self, "axis", _unit("axis", self.axis))
        object.__setattr__(self, "radius", validate_positive("radius", self.radius, "m"))
        object.__setattr__(self, "hollow", validate_flag("hollow", self.hollow))

    def project(self, x: Array) -> tuple[Array, Array]:
        """Gaps, (k,) [m], and outward unit normals, (k, 3), at points x, (k, 3); those of a bore point to its axis."""
        arm = x - self.point
        gap, normal = _from_axis(arm - np.outer(arm @ self.axis, self.axis), self.radius)
        return (-gap, -normal) if self.hollow else (gap, normal)

    @property
    def primitive(self) -> loops.Primitive:
        """The cylinder as loops take it."""
        return loops.Primitive(1, self.point, self.axis, self.radius, -1.0 if self.hollow else 1.0)


Primitives = RigidPlane | RigidSphere | RigidCylinder  # loops know them


def _from_axis(arm: Array, radius: float) -> tuple[Array, Array]:
    distance = np.sqrt(np.einsum("kd,kd->k", arm, arm))
    return distance - radius, arm / np.maximum(distance, 1e-300)[:, None]


def _unit(name: str, vector: Array) -> Array:
    vector = validate_vector(name, vector)
    length = np.linalg.norm(vector)
    if length == 0:
        raise InputError(f"{name}: expected a vector of any length other than zero")
    value: Array = vector / length
    return as_read_only(value)


class OnRigid(Stage):
    """Rows on a primitive surface, which loops have placed.

    Parameters
    ----------
    rows : PresentRows
    normals : (p, 3) array
        Outward normals of the surface at their points.
    x : (np, 3) array
        Places of the nodes [m].
    where : Anchor
        Where slave and surface are.
    """

    places: list[Array]

    def __init__(self, rows: PresentRows, normals: Array, x: Array, where: Anchor) -> None:
        super().__init__(rows, normals, ((rows.points.nodes, rows.points.weights),))
        self.places, self.pose, self._q = [x], where.pose, where.q

    @FoundOnce
    def stance(self) -> Array:
        """See `Gaps.stance`; normals at the points in the body's axes, (p, 3)."""
        return self.rows.sides[0].kinematics.in_frame(self._q, self.normals)

    def moment(self, lam: Array, about: Array, places: Array) -> Array:
        """See `Stage.moment`; one compiled call."""
        return loops.rigid_moment(self.rows.flat, lam, self.normals, places, about)

    def acted(self, lam: Array, q: Array) -> tuple[Array, Array]:
        """See `Stage.acted`; compiled calls."""
        (side,) = self.rows.sides
        if not side.flattens:
            return super().acted(lam, q)
        return loops.pushed_rigid(self.rows.flat, lam, self.normals, side, q), self.resultant(lam)

    def jacobian(self, index: Array, q: Array) -> Rows:
        """See `Stage.jacobian`; one compiled call for few rows."""
        (side,) = self.rows.sides
        if len(index) > FEW or not side.flattens:
            return super().jacobian(index, q)
        return loops.rigid_rows(self.rows.flat, index, self.normals, side, q)


class RigidGaps(Gaps):
    """Gaps of a patch to a rigid surface, fixed or carried by a body.

    Gaps of a body in an inertial frame to a fixed plane are linear in the coordinates. All other gaps are found by
    projection in every evaluation.

    Parameters
    ----------
    slave : Side
    surface : RigidSurface
        Surface in the frame of the body that carries it.
    kind : {"integrated", "node-to-segment"}
    pose : callable, optional
        Returns the place of that frame, (3,) [m], and its rotation matrix, (3, 3). Default: the frame of space.
    motion : callable, optional
        Returns the velocity of that place [m/s] and the angular velocity in space [rad/s], (3,) each. Default: at rest.
    pressed : bool
        Whether the patch may start inside the surface.

    Raises
    ------
    PenetrationError
        If the patch starts inside the surface, unless `pressed`.
    InputError
        If the patch faces away from the surface.
    """

    def __init__(
        self,
        slave: Side,
        surface: RigidSurface,
        kind: RowKind = "integrated",
        pose: Callable[[], tuple[Array, Array]] | None = None,
        motion: Callable[[], tuple[Array, Array]] | None = None,
        *,
        pressed: bool = False,
    ) -> None:
        self.surface, self.carrier = surface, Carrier(pose, motion)
        self.carried, self._seen = pose is not None, surface
        if isinstance(surface, RigidPlane) and pose is None:
            middle = slave.surface.points.mean(axis=0)
            on_plane = middle - ((middle - surface.point) @ surface.normal) * surface.normal
            slave, self._seen = slave.seen_from(on_plane), RigidPlane(np.zeros(3), surface.normal)
        self.primitive = self._seen.primitive if isinstance(self._seen, Primitives) else None
        self.sides = Sides((slave,))
        self.size = slave.surface.facet_size
        self.all_points = points_of(slave, kind)
        self._start_q, self.anchoring = np.zeros(self.n), Anchoring(self)
        self._start, gap = self._stage_at(self._rows_at_start(), [slave.surface.points - slave.centre], self._start_q)
        self.return_to(Present(self._start, self._start_q, None, None, NOTHING))
        self.placement = self._face_surface(gap, pressed=pressed)
        linear = slave.kinematics.linear and not slave.surface.wanders
        if linear and isinstance(surface, RigidPlane) and pose is None:
            no_drift = np.zeros((0, self.n)), np.zeros(0)
            shared = values_on_plane(slave, kind, surface.normal)
            start = Stage(self._start.rows, self._start.normals, self._start.shares, shared)
            H = start.by_pairs("rows", lambda: start.on_coordinates(self._start_q))
            linear_gaps = LinearGaps(H, gap, *no_drift, 0.0)
            self._start = Frozen(start.rows, start.normals, start.shares, linear_gaps, shared)
        self._put_stage(self._start.for_run())

    def _entered(
        self, x: Array, outward: Array, q: Array, pose: Array, gap: Array, normals: Array
    ) -> tuple[Array, Array, Array]:
        """See `RigidMesh.entered`; all in space, but `outward`, which belongs to the slave as it was placed."""
        assert isinstance(self.surface, RigidMesh)
        place, axes = (pose[:3], pose[3:].reshape(3, 3)) if len(pose) else (np.zeros(3), np.eye(3))
        placed, now = (self.slave.kinematics.frame(coordinates)[1] for coordinates in (np.zeros(self.n), q))
        turned = outward @ placed @ now.T @ axes
        gap, normals, left = self.surface.entered((x - place) @ axes, turned, gap, normals @ axes)
        return gap, normals @ axes.T, left

    def placed_rows(self) -> tuple[ContactPoints, Array, Array]:
        """See `Gaps.placed_rows`."""
        gap, normals = self._projected(self.all_points.at(self.whole.surface.points - self.centre), self.carrier.pose)
        return self.all_points, normals, self.all_points.average(gap)

    def _rows_at_start(self) -> PresentRows:
        """Rows at the start."""
        return self._rows(self.all_points)

    def _rows(self, points: ContactPoints) -> PresentRows:
        at_rim = np.isin(points.row_nodes, self.slave.surface.rim)
        return PresentRows(points, np.where(at_rim, 0.0, np.inf), self.sides)

    def _stage_at(
        self, rows: PresentRows, places: list[Array], q: Array, pose: Array | None = None
    ) -> tuple[Stage, Array]:
        """Stage of some rows with the slave's nodes at `places`, one (np, 3) array [m], and gaps, (nr,) [m].

        `q`, (n,), are the coordinates, and `pose` is that of the surface's carrier, by default the present one.
        """
        pose, points = self.carrier.pose if pose is None else pose, rows.points
        gap, normals = self._projected(x := points.at(places[0]), pose)
        if isinstance(self.surface, RigidMesh) and gap.min(initial=0.0) < 0.0:
            outward = self.slave.surface.normals_at(points.nodes, points.weights)
            gap, normals, left = self._entered(x, outward, q, pose, gap, normals)
            if (left < -_LEFT * gap).any():
                through = int((left + gap).argmin())
                raise RunError(
                    f"RigidMesh: a row at {x[through]} m has passed through a part of the mesh that is "
                    f"{left[through] - gap[through]:.3g} m thick; behind it nothing would hold the row. Make that part "
                    "thicker on its back: it is rigid, so that its thickness has no other effect"
                )
        stage = Stage(rows, normals, ((rows.points.nodes, rows.points.weights),))
        stage.places, stage.pose = places, pose
        return stage, rows.points.average(gap)

    def _go_to_start(self) -> None:
        """See `Gaps`."""
        self._put_stage(self._start.for_run())
        self.at(self._start_q)  # sets the normals

    def at(self, q: Array) -> Array:
        """Gaps of the present rows, (nr,) [m], at coordinates q, (n,)."""
        stage = self.stage
        if isinstance(stage, Frozen):  # rows on a plane stay the same at any sliding
            self._go_to_stage(stage, q)
            return stage.gap(q)
        return self._gaps_at(q, self.carrier.pose)

    def _gaps_at(self, q: Array, pose: Array) -> Array:
        """Gaps at coordinates q, (n,), with the carrier of the surface at a pose."""
        stage, gap = self._placed(self.stage.rows, Anchor(q, pose, self.growing))
        self._go_to_stage(stage, q)
        return gap

    def _placed(self, rows: PresentRows, where: Anchor) -> tuple[Stage, Array]:
        """Stage of some rows where the slave and the surface's carrier are, and gaps, (nr,) [m]."""
        q, pose, growing = where.q, where.pose, where.growing
        if self.primitive is None or not loops.at_once():
            return self._stage_at(rows, rows.sides.places(q, growing), q, pose)
        (side,) = rows.sides
        x, points = side.places_begun(q, growing), rows.flat
        gap, normals = loops.rigid_gaps(points, side, self.primitive, q, pose, growing, x)
        return OnRigid(rows, normals, x, where), gap

    def _at_state(self, state: GapState) -> Array:
        """See `Gaps`; the carrier may not be there yet."""
        return self._gaps_at(state.q, state.pose) if len(state.pose) else self.at(state.q)

    def surface_gap(self, q: Array, dents: Sequence[Array] | None = None) -> float:
        """See `Gaps.surface_gap`; only for a surface that is fixed in space."""
        (nodes,) = Sides((self.whole,)).dented(q, self.growing, dents)
        gap, normals = self._seen.project(x := np.vstack([nodes, self.all_points.at(nodes)]))
        if isinstance(self.surface, RigidMesh) and gap.min() < 0.0:
            patch, every = self.whole.surface, np.arange(len(nodes))[:, None]
            carriers = (every, np.ones(every.shape)), (self.all_points.nodes, self.all_points.weights)
            gap = self._entered(
                x, np.vstack([patch.normals_at(*carrier) for carrier in carriers]), q, NOTHING, gap, normals
            )[0]
        return float(gap.min())

    @property
    def whole(self) -> Side:
        """The slave with all facets of its patch."""
        return self.slave

    def stance(self) -> Array:
        """See `Gaps.stance`."""
        if self.slave.normal_only:
            return np.zeros(1)
        stage = self.stage
        if isinstance(stage, OnRigid):
            return stage.stance
        return self.slave.kinematics.in_frame(self.present.q, stage.normals)

    def stage_at(self, anchor: Anchor, rows: PresentRows) -> Stage:
        """See `Gaps`."""
        stage = self._placed(rows, anchor)[0]
        stage.of_anchor = True
        return stage

    def _projected(self, x: Array, pose: Array) -> tuple[Array, Array]:
        """Gaps, (k,) [m], and normals in space, (k, 3), at points, (k, 3) [m], from the centre.

        `pose` is `Carrier.pose`.
        """
        if self.primitive is not None and loops.at_once():
            return loops.projected(self.primitive, x, pose)
        if not len(pose):
            return self._seen.project(x)
        place, axes = pose[:3], pose[3:].reshape(3, 3)
        gap, normals = self.surface.project((x - place) @ axes)
        return gap, normals @ axes.T

    def _direction(self, node: int) -> Array:
        """Outward normal with which the patch faces the surface, (3,)."""
        return self.slave.surface.direction

    def _face_surface(self, gap: Array, *, pressed: bool) -> Placement:
        """Find how the patch faces the surface at the start, where rows have gaps, (nr,) [m].

        `pressed` is whether an overlap is meant. A body that does not face the surface, and can turn, starts turned.

        Raises
        ------
        InputError
            If the patch faces away from the surface, and its body cannot turn.
        PenetrationError
            If rows begin inside the surface.
        """
        deepest, surface = int(gap.argmin()), self.slave.surface
        approach, node = -self.stage.normal[deepest], self.row_nodes[deepest]
        direction = self._direction(node)
        faced = bool(approach @ direction > 0)
        if not faced and (self.slave.kinematics.linear or surface.wanders):
            raise InputError(
                f"master: the slave's patch, with outward normal {direction}, faces away from the rigid "
                f"surface; the normal there is {-approach}. Turn the normal, or choose another patch"
            )
        if not pressed and gap[deepest] < -PENETRATION_TOLERANCE * self.size:
            raise PenetrationError(
                f"{np.count_nonzero(gap < 0)} of {len(gap)} contact rows start inside the rigid surface, the worst by "
                f"{-gap[deepest]:.4g} m at {surface.points[node]} m. Move the body by at least that "
                "(referencePosition)"
            )
        if not faced:  # a body that turns may face it later
            nearest = surface.points[node] + gap[deepest] * approach
            self._start_q = self.slave.turned_to(nearest, -approach, gap[deepest])
        return Placement(approach, float(gap.min()), faced, pressed)
