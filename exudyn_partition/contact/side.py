"""A contact patch in motion: its surface, kinematics, residual flexibility, and plastic zone."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from scipy.spatial.transform import Rotation

from ..algebra.products import congruence
from ..algebra.sparse.skin_flexibility import Flexibility
from ..fe.model import node_dofs
from ..frames.kinematics import STILL, Kinematics, Rows
from ..plasticity.flow import PlasticState
from ..reduction.body import ReducedBody
from ..support.arrays import Array
from ..surfaces.points import ContactPoints
from ..surfaces.surface import Surface
from . import loops
from .plasticity.zone_motion import ZoneMotion

if TYPE_CHECKING:
    from ..frames.node_kernels import FlatNodes

_FEW = 0.25  # share of forces up to which reading their rows of a matrix alone is faster


@dataclass(frozen=True, eq=False)
class Side:
    """A patch in motion.

    Parameters
    ----------
    surface : Surface
        The patch at the start.
    kinematics : InertialKinematics or similar
        Kinematics of the patch's nodes.
    flexibility : (d np, d np) array, SkinBlock or None
        Residual flexibility of the patch's nodes [m/N]: d = 1 along `surface.direction`, d = 3 along the body's axes.
        That of a large skin is found on demand.
    zone : ZoneMotion or None
        Plastic zone beneath the patch.
    active : (k,) int array or None
        Nodes of the patch that are followed, as rows of `surface.points`. Default: all.
    centre : (3,) array
        Point of space from which `place` counts [m]; those of `surface` and of all else count from the origin.
    beta : float
        Time with which the flexibility yields [s], see `viscosity`; zero if it yields at once.
    """

    surface: Surface
    kinematics: Kinematics
    flexibility: Flexibility | None = None
    zone: ZoneMotion | None = None
    active: Array | None = None
    centre: Array = field(default_factory=lambda: np.zeros(3))
    beta: float = 0.0

    @cached_property
    def n(self) -> int:
        """Number of coordinates of its body."""
        return self.kinematics.body.n_dofs

    @property
    def n_followed(self) -> int:
        """Number of nodes of the patch that are followed."""
        return len(self.surface.points if self.active is None else self.active)

    @cached_property
    def near(self) -> Kinematics | None:
        """Kinematics of the nodes that are followed; None if all are."""
        return None if self.active is None else self.kinematics.some(self.active)

    @cached_property
    def seen(self) -> Kinematics:
        """Kinematics of the nodes that are followed, seen from the centre."""
        return (self.kinematics if self.near is None else self.near).seen_from(self.centre)

    @cached_property
    def flat(self) -> FlatNodes:
        """The nodes that are followed, as compiled loops take them."""
        return self.seen.flat(np.arange(self.n_followed) if self.active is None else self.active)

    @cached_property
    def flattens(self) -> bool:
        """Whether loops find places and generalised forces of its nodes from `flat`; not if its rows are sparse."""
        return isinstance(self.kinematics.rows, np.ndarray)

    def places_begun(self, q: Array, growing: Array = STILL) -> Array:
        """Room for places of the patch's nodes, (np, 3) [m]; loops set those in `flat`, others are as in `place`."""
        if not self.flattens:
            return self.place(q, growing)
        places = np.empty(self.surface.points.shape)
        if self.active is not None:
            places.fill(np.nan)
        return places

    @cached_property
    def normal_only(self) -> bool:
        """Whether the flexibility is that of nodes along the line of contact, for normals of any direction."""
        return self.flexibility is not None and len(self.flexibility) == len(self.surface.points)

    @property
    def on_demand(self) -> bool:
        """Whether its flexibility is found on demand, so that only rows that may close should ask for it."""
        return self.flexibility is not None and not isinstance(self.flexibility, np.ndarray)

    @classmethod
    def of(cls, kinematics: Kinematics, patch: int = 0, state: PlasticState | None = None, beta: float = 0.0) -> Side:
        """Patch of the body with these kinematics, at the start, with its flexibility if the basis has one.

        `state` is that of its plastic zone; None if it never yielded. `beta` is the body's damping in proportion to
        its stiffness [s].
        """
        body: ReducedBody = kinematics.body
        surface = body.surface(np.zeros(3), patch)
        of_patch = kinematics.at(body.partition.patches[patch].nodes)
        flexibility = None if body.basis.flexibility is None else body.flexibility(patch)
        beta = 0.0 if flexibility is None else beta
        side = cls(surface, of_patch, flexibility, ZoneMotion.of(kinematics, patch, state), beta=beta)
        start = np.zeros(body.n_dofs)
        return replace(side, surface=side._placed(start, surface.direction))

    @cached_property
    def lifting(self) -> float:
        """Largest motion of a node outwards by a unit force inwards on another one [m/N].

        It is zero where forces only press nodes inwards, as on stocky bodies, and if flexibility is found on demand.
        """
        F, n = self.flexibility, len(self.surface.points)
        if not isinstance(F, np.ndarray):
            return 0.0
        if not self.normal_only:
            outward = self._outward_in_frame
            pushed = np.einsum("id,idm->im", outward, F.reshape(n, 3, 3 * n))
            F = np.einsum("imd,md->im", pushed.reshape(n, n, 3), outward)
        return max(-float(F.min(initial=0.0)), 0.0)

    def lifted(self, q: Array, forces: Array) -> float:
        """How far forces on its nodes, (np, 3) [N], move a node outwards by its flexibility [m].

        It is zero if they move none outwards. The forces press. The coordinates are q, (n,).
        """
        if self.normal_only:
            return -float(self._moved(np.sqrt(np.einsum("id,id->i", forces, forces))).min(initial=0.0))
        moved = self._moved(self.kinematics.in_frame(q, forces).ravel())
        return float(np.einsum("id,id->i", moved.reshape(-1, 3), self._outward_in_frame).max(initial=0.0))

    def _moved(self, forces: Array) -> Array:
        """Product of the flexibility and forces, (n,), of which few are mostly not zero."""
        some = np.flatnonzero(forces)
        if not isinstance(self.flexibility, np.ndarray) or len(some) > _FEW * len(forces):
            return np.asarray(self.flexibility @ forces)
        return np.asarray(forces[some] @ self.flexibility[some])

    @cached_property
    def _outward_in_frame(self) -> Array:
        """`outward` in the body's axes, (np, 3)."""
        return self.outward @ self.kinematics.frame(np.zeros(self.n))[1]

    @property
    def outward(self) -> Array:
        """Outward unit normals at the patch's nodes, at the start, (np, 3)."""
        nodes = np.arange(len(self.surface.points))[:, None]
        return self.surface.normals_at(nodes, np.ones(nodes.shape))

    def grown(self, ways: Array) -> Side:
        """Return the side with its surface moved outwards at the start, by a way at each node, (np,) [m]."""
        by, axes = ways[:, None] * self.outward, self.kinematics.frame(np.zeros(self.n))[1]
        surface = replace(self.surface, points=self.surface.points + by)
        return replace(self, surface=surface, kinematics=self.kinematics.displaced(by @ axes))

    def seen_from(self, point: Array) -> Side:
        """Return the side with places that count from a point of space, (3,) [m]."""
        return replace(self, centre=point)

    def part(self, facets: Array, nodes: Array) -> Side:
        """Return the side that follows some facets, (k,) int array, and some more nodes of its patch, (m,) int array.

        Nodes keep their numbers. Its methods take time in proportion to the number of followed nodes.
        """
        followed = self.surface.facets[facets]
        return replace(self, surface=replace(self.surface, facets=followed)).following(np.union1d(followed, nodes))

    def spares(self, nodes: Array) -> int:
        """Measure of the work that is saved if only some nodes, (k,), are followed.

        It is the number of row entries that need not be read.
        """
        return 3 * (self.n_followed - len(nodes)) * self.n

    def following(self, nodes: Array) -> Side:
        """Return the side that follows some nodes of its patch, (k,) int array; its facets stay the same."""
        return replace(self, active=nodes)

    def place(self, q: Array, growing: Array = STILL) -> Array:
        """Places of the patch's nodes at coordinates q, (n,): (np, 3) [m], NaN for nodes that are not followed.

        They count from `centre`. `growing` are products by which the body grows, see `Kinematics.growing`.
        """
        if self.active is None:
            return self.seen.place(q, growing)
        places = np.empty(self.surface.points.shape)
        places.fill(np.nan)
        places[self.active] = self.seen.place(q, growing)
        return places

    def dent(self, strain: Array) -> Array:
        """Displacements of the patch's nodes due to plastic strain, (g, 6), beyond the coordinates: (np, 3) [m].

        They are in the body's axes. They are zero where the nodes of the plastic zone are coordinates themselves.
        """
        displacements = np.zeros(self.surface.points.shape)
        if self.zone is None or self.zone.flexibility is None:
            return displacements
        moved = self.zone.zone.pseudo_forces(strain) @ self.zone.flexibility.of_patch
        if self.normal_only:
            return np.outer(moved, self.kinematics.frame(np.zeros(self.n))[1].T @ self.surface.direction)
        displacements[:] = moved.reshape(-1, 3)
        return displacements

    def dented(self, q: Array, growing: Array, dent: Array | None) -> Array:
        """Places of the patch's nodes, (np, 3) [m], from `place`, plus the displacements of `dent`, if any."""
        places = self.place(q, growing)
        return places if dent is None else places + dent @ self.kinematics.frame(q)[1].T

    def generalised(self, q: Array, forces: Array) -> Array:
        """Generalised forces, (n,), from forces on the patch's nodes, (np, 3) [N]."""
        if self.near is None:
            return self.kinematics.generalised(q, forces)
        return self.near.generalised(q, forces[self.active])

    def on_coordinates(self, q: Array, rows: sp.csr_matrix) -> Rows:
        """Rows on the coordinates' velocities, (m, n), from rows on the velocities of the patch's nodes, (m, 3 np)."""
        if self.near is None or self.active is None:
            return self.kinematics.on_coordinates(q, rows)
        return self.near.on_coordinates(q, rows[:, node_dofs(self.active)])

    def at(self, q: Array) -> Surface:
        """The patch at coordinates q, (n,)."""
        return self._placed(q, self.kinematics.frame(np.zeros(self.n))[1].T @ self.surface.direction)

    def _placed(self, q: Array, direction: Array) -> Surface:
        """The patch at coordinates q, (n,); `direction`, (3,), is in the body's axes."""
        return replace(self.surface, points=self.kinematics.place(q), direction=self.kinematics.frame(q)[1] @ direction)

    def turned_to(self, point: Array, normal: Array, distance: float) -> Array:
        """Coordinates, (n,), at which the patch of a floating body faces a point of a surface.

        `point`, (3,), lies on the surface, and `normal`, (3,), is its normal there. The centre of the patch is placed
        at `distance` [m] from the point along the normal.
        """
        way = np.zeros(self.n)
        turn = Rotation.align_vectors(-normal[None], self.surface.direction[None])[0]
        start = Rotation.from_rotvec(self.kinematics.rotation)
        way[3:6] = (start.inv() * turn * start).as_rotvec()
        q = self.kinematics.moved(np.zeros(self.n), way)
        q[:3] += point + distance * normal - self.kinematics.place(q).mean(axis=0)
        return q


class LoadedNodes:
    """Nodes of a side's patch that carry the present rows, with the flexibility between them.

    Parameters
    ----------
    side : Side
    column : (np,) int array
        The number of each node of the patch among these nodes; -1 for others.
    nodes : (n,) int array
    """

    def __init__(self, side: Side, column: Array, nodes: Array) -> None:
        self.side, self.column, self.nodes = side, column, nodes

    @classmethod
    def of(cls, side: Side, nodes: Array) -> LoadedNodes:
        """Nodes that carry some points, (p, k) int array, as loaded nodes."""
        column = np.full(len(side.surface.points), -1)
        column[nodes] = 0
        used = np.flatnonzero(column == 0)
        column[used] = np.arange(len(used))
        return cls(side, column, used)

    @cached_property
    def F(self) -> Array:
        """Part of `side.flexibility` for these nodes, (d n, d n) [m/N]."""
        dofs = self.nodes if self.side.normal_only else node_dofs(self.nodes)
        assert self.side.flexibility is not None
        part: Array = self.side.flexibility[np.ix_(dofs, dofs)]
        return part

    def carry(self, nodes: Array) -> bool:
        """Whether the nodes of some points, (p, k) int array, are among these nodes."""
        return bool(self.column[nodes].min(initial=0) >= 0)

    def flexibility(self, q: Array, points: ContactPoints, shares: tuple[Array, Array], normals: Array) -> Array:
        """Contribution of this side to the flexibility of rows, (nr, nr) [m/N], at its coordinates q, (n_dofs,).

        Parameters
        ----------
        q : (n_dofs,) array
        points : ContactPoints
            Points of the rows.
        shares : (p, k) int array, (p, k) array
            Nodes of the points, and their signed weights in the gap.
        normals : (p, 3) array
        """
        nodes, weights = self.column[shares[0]], shares[1]
        along = np.ones((len(normals), 1)) if self.side.normal_only else self.side.kinematics.in_frame(q, normals)
        return congruence(loops.rows_along(points, nodes, weights, along, len(self.nodes)), self.F)

    def directed_flexibility(self, rows: Array) -> Array:
        """Contribution of this side to the flexibility of rows with directions, (3 na, 3 na) [m/N].

        `rows`, (3 na, 3 n), act on the flexibility coordinates of these nodes.
        """
        return congruence(rows, self.F, threes=True)
