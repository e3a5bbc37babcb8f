"""Gap rows of a patch in motion, and the generalised forces that forces on the rows make.

`Gaps.jacobian` is G_C of the paper (eq. 25-27).

Module `contact.patch_gaps` has the gaps to another patch, `contact.rigid` the gaps to rigid surfaces.

Theory: examples/site/theory.md, "Rows of gaps".
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..algebra.complementarity import Complementarity, regularised
from ..algebra.products import dense, joined, weighted_rows
from ..frames.kinematics import Rows
from ..frames.rotations import total_moment
from ..reduction.body import ReducedBody
from ..support.arrays import Array, consecutive
from ..surfaces.points import ContactPoints, at_points, on_nodes
from ..surfaces.rows import directed_matrix, point_matrix
from . import loops
from .linear_gaps import LinearGaps
from .side import LoadedNodes, Side, Standing

if TYPE_CHECKING:
    from typing import Self

BULGE = 0.25  # of the deepest row's depth: smaller gaps may close, because the surface bulges around a contact
_NOTHING = np.empty(0)
MANY = 50_000  # of what can be spared, see `Side.spares`: then only the nodes needed are followed
SAME = 0.01  # of a facet's size, or change of normals: below it, rows keep their flexibility
Pressed = tuple[Array, Array, float]  # forces on rows, (nr,) [N], generalised forces, (n,), and the least gap [m]


class Gaps:
    """Present gap rows of a patch, and the effects of forces on them. Subclasses say what the gaps lead to.

    Attributes
    ----------
    sides : tuple of Side
        Slave, and master if that is a patch too.
    n : int
        Number of coordinates of all sides.
    size : float
        Size of the facets, the scale of motion [m].
    moving : bool
        Whether rows follow the motion. If not, their gaps are linear in the coordinates.
    held : object
        An object; each time that rows are frozen, it is a new one.
    points : ContactPoints
        Points of the present rows. While rows move, only those are present that can touch soon.
    row_nodes : (nr,) int array
        Node of the slave's patch for each present row.
    area : (nr,) array
        Area that each row stands for [m2].
    at_edge : (nr,) bool array
        Rows at the edge of the contact patch.
    normals : (p, 3) array
        Outward normals of the master at the contact points.
    unpaired : int
        Number of contact points that face nothing.
    approach : (3,) array
        Unit vector along which the slave approached at the start.
    faced : bool
        Whether the slave faced its counterpart at the start. If not, the first rows are those of a pose in which it
        does. They give flexibility and stiffness; the first evaluation replaces them.
    searches : int
        Number of searches for the pairs of all points since the start of the run.
    carried : bool
        Whether an Exudyn body carries the rigid surface.
    between : (d np, d np) array or None
        Residual flexibility between the patches of both sides [m/N], if they are patches of one body.
    """

    sides: tuple[Side, ...]
    n: int
    size: float
    moving: bool
    held: object
    points: ContactPoints
    row_nodes: Array
    area: Array
    at_edge: Array
    normals: Array
    unpaired: int
    approach: Array
    faced: bool = True
    carried: bool = False
    between: Array | None = None
    searches: int = 0
    H: Rows
    _all: ContactPoints  # of the slave
    _flexibility: Array  # of all present rows
    _flexible_at: Standing | None = None
    _flexible_index: Array | None = None  # some present rows, and the flexibility between them
    _flexible_some: Array
    _loaded: Mapping[int, LoadedNodes] = MappingProxyType({})
    shares: Sequence[tuple[Array, Array]]  # for each side: nodes of the points, and their signed weights in the gap
    _q: Array
    _places: list[Array]
    _near_sides: tuple[Side, ...] | None = None
    evaluated_pose = _NOTHING  # `carrier_pose` at the last evaluation of the gaps
    _placed_at: Array | None = None  # the coordinates that `_places` belong to
    _normal: Array
    _normal_of: Array | None = None  # the normals whose mean is `_normal`

    def fresh(self) -> Self:
        """Return the same rows in their start state, for another run; constant data are shared."""
        result = copy.copy(self)
        result.searches = 0
        result.reset()
        return result

    def reset(self) -> None:
        """Go back to the start."""
        raise NotImplementedError

    def at(self, q: Array) -> Array:
        """Gaps of the present rows, (nr,) [m], at coordinates q, (n,)."""
        raise NotImplementedError

    def surface_gap(self, q: Array, dents: Sequence[Array] | None = None) -> float:
        """Gap of the slave's lowest point, among its nodes and contact points, at coordinates q, (n,) [m].

        It does not include the contact's own flexibility and does not depend on the present rows. It is negative where
        the surfaces, as the coordinates move them, lie within each other, and infinite if no point faces the master.
        `dents` are those of each side, see `Side.dent`.
        """
        raise NotImplementedError

    def dented(self, sides: Sequence[Side], q: Array, dents: Sequence[Array] | None) -> list[Array]:
        """Places of all nodes of some sides, (np, 3) for each [m], at coordinates q, (n,), with their dents."""
        own: Sequence[Array | None] = dents or [None] * len(sides)
        return [side.dented(part, dent) for side, part, dent in zip(sides, self.split(q), own, strict=True)]

    def pressed_at(self, q: Array, flexibility: Array, problem: tuple[Array, ...]) -> tuple[Array, Pressed | None]:
        """Gaps as `at` finds them, and the forces that the law would find from them, where one call can do both.

        `flexibility` is what `flexibility` returned last, `problem` the rows that can close and the problem of these.
        """
        return self.at(q), None

    def of_present(self, q: Array) -> Array:
        """Gaps of the present rows at coordinates q, (n,); unlike `at`, this keeps the rows: (nr,) [m]."""
        return self.at(q)

    @property
    def carrier_pose(self) -> Array:
        """Place and axes of a carried rigid surface, (12,), on which gaps depend too; empty if nothing carries it."""
        return _NOTHING

    @property
    def carrier_motion(self) -> Array:
        """Velocity and angular velocity of the body that carries the rigid surface, (6,) [m/s, rad/s], if one does."""
        return _NOTHING

    @property
    def constant_rows(self) -> object:
        """An object that stays the same as long as `side_rows` does; None if they may change in every evaluation."""
        return None if self.moving else self.held

    @property
    def linear(self) -> LinearGaps | None:
        """Gaps of the present rows as long as these are frozen; None if they move, or where it is not known."""
        return None

    @property
    def slave(self) -> Side:
        """The side whose points must not penetrate."""
        return self.sides[0]

    @property
    def node_areas(self) -> Array:
        """(np,) array: area of the row of each node of the slave's patch [m2]; zero for a node without a row."""
        areas = np.zeros(len(self.slave.surface.points))
        areas[self._all.row_nodes] = self._all.area
        return areas

    @property
    def node_pressures(self) -> sp.csr_matrix:
        """(np, np) csr matrix from forces of the rows to pressures around the nodes of the slave's patch [1/m2]."""
        return self._all.pressures

    @property
    def normal(self) -> Array:
        """(nr, 3) array: mean normal of each present row."""
        if self._normal_of is not self.normals:
            self._normal, self._normal_of = self.points.average(self.normals), self.normals
        return self._normal

    @property
    def bodies(self) -> list[ReducedBody]:
        """Reduced body of each side."""
        return [side.kinematics.body for side in self.sides]

    @property
    def near_sides(self) -> tuple[Side, ...]:
        """The sides; while rows are followed, only with the nodes that these need."""
        return self._near_sides or self.sides

    def follow_nodes(self, nodes: Sequence[Array] | None) -> None:
        """Follow only some nodes of each side, (k,) int arrays, where that saves time; None: all."""
        self._near_sides = self._placed_at = None
        if nodes is not None:
            self._near_sides = tuple(
                side.following(some) if side.spares(some) > MANY else side
                for side, some in zip(self.sides, nodes, strict=True)
            )

    def split(self, q: Array) -> list[Array]:
        """Split q, (n,), into the coordinates of each side."""
        n = self.sides[0].n
        return [q] if len(self.sides) == 1 else [q[:n], q[n:]]

    def moved(self, q: Array, way: Array) -> Array:
        """Coordinates, (n,), after an increment `way`, (n,), velocity times time, from q, (n,)."""
        parts = zip(self.sides, self.split(q), self.split(way), strict=True)
        return np.concatenate([side.kinematics.moved(*part) for side, *part in parts])

    def rigid_part(self, q_t: Array) -> Array:
        """Velocities, (n,), of the bodies' rigid motions within velocities q_t, (n,)."""
        parts = zip(self.sides, self.split(q_t), strict=True)
        return np.concatenate([side.kinematics.rigid_part(part) for side, part in parts])

    def way(self, q: Array, end: Array) -> Array:
        """Way, (n,), that leads from coordinates q to `end`, (n,): the inverse of `moved`."""
        parts = zip(self.sides, self.split(q), self.split(end), strict=True)
        return np.concatenate([side.kinematics.way(*part) for side, *part in parts])

    def accelerations(self, rows: Rows) -> Rows:
        """Accelerations of the coordinates, (n, nr), by unit forces on rows, (nr, n); csr if the rows are csr."""
        slices = consecutive([side.n for side in self.sides])
        parts = [
            side.kinematics.accelerations(q, rows[:, own].T)
            for side, q, own in zip(self.sides, self.split(self._q), slices, strict=True)
        ]
        return sp.vstack(parts, format="csr") if sp.issparse(rows) else np.vstack([*map(dense, parts)])

    def places(self, q: Array) -> list[Array]:
        """Places of the nodes of the patches, (np, 3) for each side [m], at coordinates q, (n,).

        Where contact wanders over a patch, only nodes that may touch soon are followed; the others are NaN.
        """
        return [side.place(part) for side, part in zip(self.sides, self.split(q), strict=True)]

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """Gaps of all rows that can touch next, (k,) [m], their rates [m/s] and accelerations [m/s2], pairs held.

        Parameters
        ----------
        q, q_t, q_tt : (n,) arrays
            Coordinates, their velocities and accelerations.
        """
        gap = self.at(q)
        H = self.jacobian(np.arange(len(gap)))
        return gap, H @ q_t, H @ q_tt

    @property
    def q(self) -> Array:
        """Last coordinates, (n,)."""
        return self._q

    @property
    def coordinates(self) -> list[Array]:
        """Last coordinates of each side, (n_dofs,)."""
        return self.split(self._q)

    def places_now(self) -> list[Array]:
        """Places of the nodes of `near_sides`, (np, 3) for each [m], at the last coordinates; NaN for other nodes."""
        if self._placed_at is not self._q:
            parts = zip(self.near_sides, self.split(self._q), strict=True)
            self._places, self._placed_at = [side.place(part) for side, part in parts], self._q
        return self._places

    def jacobian(self, index: Array) -> Rows:
        """Derivative of the gaps of some present rows by the coordinates, (na, n), pairs held."""
        if not self.moving:
            return self.H[index]
        mean, parts = self.points.mean[index], []
        for (nodes, weights), side, q in zip(self.shares, self.near_sides, self.split(self._q), strict=True):
            G = directed_matrix(nodes, weights, self.normals, len(side.surface.points))
            parts.append(side.on_coordinates(q, mean @ G))
        return joined(parts)

    def carrier_rows(self, index: Array) -> Array:
        """Derivative of the rates of some gaps by the velocities of the body that carries the surface, (na, 6)."""
        raise NotImplementedError

    def nodal_forces(self, lam: Array) -> list[Array]:
        """Forces on the nodes of the patches, (np, 3) for each side [N], from forces on the present rows, (nr,) [N]."""
        return self.on_nodes(self._pushes(lam))

    def _pushes(self, lam: Array) -> Array:
        """Forces on the slave at the present points, (p, 3) [N], from forces on the present rows, (nr,) [N]."""
        return loops.pushes(self.points, lam, self.normals)

    def on_nodes(self, forces: Array) -> list[Array]:
        """Forces on the nodes of the patches, (np, 3) for each side [N].

        Parameters
        ----------
        forces : (p, 3) array
            Forces on the slave at the present points, in axes of space [N].
        """
        sides = zip(self.shares, self.sides, strict=True)
        return [on_nodes(*shares, forces, len(side.surface.points)) for shares, side in sides]

    def generalised(self, lam: Array) -> Array:
        """Generalised forces, (n,), from forces on the present rows, (nr,) [N]."""
        if not self.moving:
            return weighted_rows(lam, self.H)
        return self._generalised(lam)

    def _generalised(self, lam: Array) -> Array:
        """Do the same for rows that move."""
        parts = zip(self.near_sides, self.split(self._q), self.nodal_forces(lam), strict=True)
        return np.concatenate([side.generalised(q, on_nodes) for side, q, on_nodes in parts])

    def resultant(self, lam: Array) -> Array:
        """Force on the slave, (3,) [N], from forces on the present rows, (nr,) [N]."""
        return lam @ self.normal

    def moment(self, lam: Array, point: Array) -> Array:
        """Moment on the slave about a point in space, (3,) [N m], from forces on the present rows, (nr,) [N]."""
        return self.moment_of(self._pushes(lam), point)

    def moment_of(self, forces: Array, point: Array) -> Array:
        """Moment on the slave about a point in space, (3,) [N m], of forces on it at the present points, (p, 3) [N]."""
        arms = at_points(*self.shares[0], self.places_now()[0]) - point
        return total_moment(arms, forces)

    def flexibility(self, index: Array) -> Array:
        """Residual flexibility between some present rows, (na, na) [m/N].

        It changes slowly with the places of the points on their facets. So it is kept while the points move little, and
        the same array is returned for the same rows.
        """
        standing = self.standing()
        if not standing.nearly(self._flexible_at, SAME):
            self._flexibility, self._flexible_at = self._all_flexibility(), standing
            self._flexible_index = None
        known = self._flexible_index
        if index is not known and (known is None or not np.array_equal(index, known)):
            self._flexible_index = index
            self._flexible_some = self._flexibility.take(index, axis=0).take(index, axis=1)
        return self._flexible_some

    def problem(self) -> Complementarity:
        """Return the problem of the forces on all present rows, regularised: rows on few points may be redundant.

        Raises
        ------
        IndefiniteMatrixError
            If the flexibility of the rows is not positive definite.
        """
        return Complementarity(regularised(self.flexibility(np.arange(len(self.row_nodes)))))

    def standing(self) -> Standing:
        """Where the rows stand at the last coordinates."""
        return Standing(self.row_nodes, self.sides, self.stance())

    def stance(self) -> Array:
        """Values that the flexibility of the rows depends on, scaled by the size of a facet or by one."""
        raise NotImplementedError

    def _all_flexibility(self) -> Array:
        n_rows = len(self.row_nodes)
        F = np.zeros((n_rows, n_rows))
        for place, (side, q) in enumerate(zip(self.sides, self.split(self._q), strict=True)):
            if side.flexibility is not None:
                F += self.loaded_nodes(place).flexibility(q, self.points, self.shares[place], self.normals)
        if self.between is not None:
            across = self.side_rows(0) @ (self.side_rows(1) @ self.between.T).T
            F += across + across.T
        return F

    def loaded_nodes(self, place: int) -> LoadedNodes:
        """One side's nodes that carry the present rows, and perhaps some more that have carried others."""
        side, nodes = self.sides[place], self.shares[place][0]
        known = self._loaded.get(place)
        if known is None or not known.are_of(side, nodes):
            known = LoadedNodes.of(side, nodes)
            self._loaded = {**self._loaded, place: known}  # runs do not share it
        return known

    def side_rows(self, side: int) -> Rows:
        """Present rows on the flexibility coordinates of one side's patch, (nr, d np)."""
        nodes, weights = self.shares[side]
        own, n = self.sides[side], len(self.sides[side].surface.points)
        if own.normal_only:
            rows = point_matrix(nodes, weights if side else -weights, n)  # contact pushes towards the inside
        else:
            along = own.kinematics.in_frame(self.split(self._q)[side], self.normals)
            rows = directed_matrix(nodes, weights, along, n)
        return self.points.mean @ rows


def needed(gap: Array) -> float:
    """Gap up to which rows must be present [m]: the smallest gap if open, what bulging may close if in contact."""
    least = float(gap.min(initial=np.inf))
    return max(least, -BULGE * least)
