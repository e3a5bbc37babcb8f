"""Gaps between two patches wherever their bodies have moved: frozen pairs while they hold, followed ones after that.

Pairs hold as long as the patches have not slid along each other: gaps are linear then, h = h0 + H q, and cost one
product. When they have slid by 2 % of a facet, every evaluation takes positions from the bodies' coordinates and
projects the contact points anew, starting from where they were: Newton's iteration on the facet, and a search for those
that have left it. A search of all points, with a tree, comes when the patches have moved by a quarter of a facet. When
the sliding stops, pairs are frozen again. So the motion decides, and nobody has to know it beforehand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..body import ReducedBody
from ..errors import ComplementarityError
from ..fem import node_dofs
from .points import ContactPoints, contact_points
from .rows import EDGE_TOLERANCE, ContactRows, directed_matrix, facing, pair_surfaces, point_matrix, rows_of
from .surface import Array, Surface, closest_points, follow

_HELD = 0.02  # of a facet's size: sliding up to which frozen pairs hold
_STILL = 0.1  # of that: sliding within _PATIENCE evaluations below which pairs are frozen again
_PATIENCE = 200
_SEARCHED = 0.25  # of a facet's size: motion after which all points are projected anew
_ON_EDGE = 1e-6  # of a facet's size: round-off of a point that lies on the patch
_NEAR = 1.0  # of a facet's size: points with smaller gaps are followed between searches


@dataclass(frozen=True, eq=False)
class Side:
    """A patch in motion.

    Parameters
    ----------
    surface : Surface
        Where it starts.
    kinematics : InertialKinematics or like it
        Of the patch's nodes.
    flexibility : (d np, d np) array or None
        Residual flexibility of the patch's nodes [m/N], d = 1 along `surface.direction` or 3 along the body's axes.
    """

    surface: Surface
    kinematics: Any
    flexibility: Array | None = None

    @property
    def n(self) -> int:
        """Number of coordinates of its body."""
        return self.kinematics.body.n_dofs

    @classmethod
    def of(cls, kinematics: Any, patch: int = 0) -> Side:
        """Patch of a body with these kinematics, where it is at the start; with its flexibility if it has one."""
        body: ReducedBody = kinematics.body
        surface = body.surface(np.zeros(3), patch)
        own = kinematics.at(body.partition.patches[patch].nodes)
        start = np.zeros(body.n_dofs)
        placed = replace(surface, points=own.place(start), direction=own.frame(start)[1] @ surface.direction)
        return cls(placed, own, None if body.basis.flexibility is None else body.flexibility(patch))


class Gaps:
    """Rows of a patch against something: what they are now, and what forces on them do. Subclasses say where to.

    Attributes
    ----------
    sides : tuple of Side
        Slave, and master if that is a patch too.
    n : int
        Number of their coordinates.
    size : float
        Facets' size, the measure of motion [m].
    moving : bool
        Whether rows follow the motion; if not, their gaps are linear in the coordinates.
    held : object
        Another one each time that rows are frozen.
    row_nodes : (nr,) int array
        The slave's patch node of each present row; of moving ones, those that can touch soon.
    area : (nr,) array
        Area that each row stands for [m2].
    at_edge : (nr,) bool array
        Rows at the edge of what can touch.
    normals : (p, 3) array
        Outward normals of the master at the contact points.
    unpaired : int
        Contact points that face nothing.
    approach : (3,) array
        Unit vector along which the slave approached at the start.
    """

    sides: tuple[Side, ...]
    n: int
    size: float
    moving: bool
    held: Any
    row_nodes: Array
    area: Array
    at_edge: Array
    normals: Array
    unpaired: int
    approach: Array
    H: Any
    _all: ContactPoints  # of the slave
    _mean: Array | None  # (nr, p): rows by points; None if each row is one point
    _shares: Sequence[tuple[Array, Array]]  # of each side: nodes of the points, and their signed weights in the gap
    _q: Array

    def reset(self) -> None:
        """Go back to the start, before a new run."""
        raise NotImplementedError

    def at(self, q: Array) -> Array:
        """Gaps of the present rows, (nr,) [m], at coordinates q, (n,)."""
        raise NotImplementedError

    @property
    def slave(self) -> Side:
        """The side whose points are kept out."""
        return self.sides[0]

    @property
    def node_areas(self) -> Array:
        """(np,) array: area of the row of each of the slave's patch nodes [m2]; zero where there is none."""
        areas = np.zeros(len(self.slave.surface.points))
        areas[self._all.row_nodes] = self._all.area
        return areas

    @property
    def node_pressures(self) -> sp.csr_matrix:
        """(np, np) csr matrix: pressures around the slave's patch nodes by the forces of their rows [1/m2]."""
        return self._all.pressures

    @property
    def normal(self) -> Array:
        """(nr, 3) array: mean normal of each present row."""
        return self.normals if self._mean is None else self._mean @ self.normals

    def split(self, q: Array) -> list[Array]:
        """Coordinates of each side, of q, (n,)."""
        n = self.sides[0].n
        return [q] if len(self.sides) == 1 else [q[:n], q[n:]]

    def places(self, q: Array) -> list[Array]:
        """Places of the patches' nodes, (np, 3) of each side [m], at coordinates q, (n,)."""
        return [side.kinematics.place(part) for side, part in zip(self.sides, self.split(q), strict=True)]

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """Gaps of all that can touch next, (k,) [m], their rates [m/s] and accelerations [m/s2], pairs held.

        Parameters
        ----------
        q, q_t, q_tt : (n,) arrays
            Coordinates, their velocities and accelerations.
        """
        gap = self.at(q)
        H = self.jacobian(np.arange(len(gap)))
        return gap, H @ q_t, H @ q_tt

    def places_now(self) -> list[Array]:
        """Places of the patches' nodes, (np, 3) of each side [m], at the last coordinates."""
        return self.places(self._q)

    def jacobian(self, index: Array) -> Any:
        """Derivative of some present rows' gaps by the coordinates, (na, n), pairs held."""
        if not self.moving:
            return self.H[index]
        points = index if self._mean is None else np.arange(len(self.normals))
        parts = []
        for (nodes, weights), side, q in zip(self._shares, self.sides, self.split(self._q), strict=True):
            G = directed_matrix(nodes[points], weights[points], self.normals[points], len(side.surface.points))
            G = G @ side.kinematics.jacobian(q)
            parts.append(G if self._mean is None else self._mean[index] @ G)
        return _joined(parts)

    def nodal_forces(self, lam: Array) -> list[Array]:
        """Forces on the patches' nodes, (np, 3) of each side [N], of forces on the present rows, (nr,) [N]."""
        at_points = lam if self._mean is None else lam @ self._mean
        active = np.flatnonzero(at_points)
        forces = at_points[active, None] * self.normals[active]
        result = []
        for (nodes, weights), side in zip(self._shares, self.sides, strict=True):
            on_nodes = np.zeros((len(side.surface.points), 3))
            np.add.at(on_nodes, nodes[active], weights[active, :, None] * forces[:, None, :])
            result.append(on_nodes)
        return result

    def generalised(self, lam: Array) -> Array:
        """Generalised forces, (n,), of forces on the present rows, (nr,) [N]."""
        if not self.moving:
            return lam @ self.H
        parts = zip(self.sides, self.split(self._q), self.nodal_forces(lam), strict=True)
        return np.concatenate([side.kinematics.generalised(q, on_nodes) for side, q, on_nodes in parts])

    def resultant(self, lam: Array) -> Array:
        """Force on the slave, (3,) [N], of forces on the present rows, (nr,) [N]."""
        return (lam if self._mean is None else lam @ self._mean) @ self.normals

    def moment(self, lam: Array, point: Array) -> Array:
        """Moment on the slave, (3,) [N m], of forces on the present rows, (nr,) [N], about a point in space, (3,)."""
        at_points = lam if self._mean is None else lam @ self._mean
        (nodes, weights), x = self._shares[0], self.places_now()[0]
        arms = np.einsum("pk,pkd->pd", weights, x[nodes]) - point
        return np.cross(arms, at_points[:, None] * self.normals).sum(axis=0)

    def flexibility(self, index: Array) -> Array:
        """Residual flexibility between some present rows, (na, na) [m/N]."""
        mean, points = None, index
        if self._mean is not None:
            mean = self._mean[index]
            points = np.flatnonzero(mean.any(axis=0))
            mean = mean[:, points]
        F = np.zeros((len(index),) * 2)
        for (nodes, weights), side, q in zip(self._shares, self.sides, self.split(self._q), strict=True):
            if side.flexibility is not None:
                along = side.kinematics.in_frame(q, self.normals[points])
                F += _row_flexibility(side, nodes[points], weights[points], along, mean)
        return F

    def side_rows(self, side: int) -> Any:
        """Present rows on the flexibility of one of the sides' patches, (nr, d np)."""
        nodes, weights = self._shares[side]
        own, n = self.sides[side], len(self.sides[side].surface.points)
        if len(np.asarray(own.flexibility)) == n:
            rows = point_matrix(nodes, -abs(weights), n)  # contact pushes inwards
        else:
            along = own.kinematics.in_frame(self.split(self._q)[side], self.normals)
            rows = directed_matrix(nodes, weights, along, n)
        return rows if self._mean is None else self._mean @ rows


def _row_flexibility(side: Side, nodes: Array, weights: Array, along: Array, mean: Array | None) -> Array:
    """Flexibility of rows, the means (nr, p) of points that are weighted nodes, (p, k), of the patch."""
    n, F = len(side.surface.points), np.asarray(side.flexibility)
    # Along the line of contact alone, a point's flexibility is that of its nodes, whatever its own direction.
    normal_only = len(F) == n
    if normal_only and mean is None and nodes.shape[1] == 1:
        return F[np.ix_(nodes[:, 0], nodes[:, 0])]
    used = np.flatnonzero(np.bincount(nodes.ravel(), minlength=n))
    place = np.empty(n, dtype=np.int64)
    place[used] = np.arange(len(used))
    if normal_only:
        rows, dofs = point_matrix(place[nodes], weights, len(used)), used
    else:
        rows, dofs = directed_matrix(place[nodes], weights, along, len(used)), node_dofs(used)
    if mean is not None:
        rows = mean @ rows
    return rows @ (rows @ F[np.ix_(dofs, dofs)]).T


class PatchGaps(Gaps):
    """Gaps between two patches in motion.

    Parameters
    ----------
    slave, master : Side
    kind : {"node-to-segment", "integrated"}

    Raises
    ------
    EmptyRegionError, PenetrationError
        As `rows.pair_surfaces`.
    """

    def __init__(self, slave: Side, master: Side, kind: str = "node-to-segment") -> None:
        self.sides = (slave, master)
        self._all = contact_points(slave.surface, kind)
        self._start = pair_surfaces(slave.surface, master.surface, kind)
        self.size, self.approach = self._start.facet_size, self._start.approach
        self.n = sum(side.n for side in self.sides)
        self._linear = slave.kinematics.linear and master.kinematics.linear
        self._witnesses = [side.kinematics.at(side.surface.nodes[_spread(side.surface.points)]) for side in self.sides]
        self.held, self.moving = None, True
        self.reset()

    def reset(self) -> None:
        """Go back to the pairs at the start, before a new run."""
        self._since = 0
        self._searched_at: Array | None = None
        self._stood_at: Array | None = None
        if self.moving or self.held is not self._start:
            self._hold(self._start, np.zeros(self.n))
            self.moving = not self._linear

    # Frozen pairs.

    def _hold(self, rows: ContactRows, q: Array) -> None:
        """Freeze these pairs, whose gaps are those at q."""
        self._take(rows)
        self.moving, self.held, self._q = True, rows, q
        if self._linear:
            self.H = self.jacobian(np.arange(len(rows)))
            self._gap = rows.gap - self.H @ q
            self._drift = self._drift_rows(rows)
            self._drift_start = self._drift @ q
            self.moving = False

    def _take(self, rows: ContactRows) -> None:
        """Make these the present rows."""
        self._points, self._facet, self._local = rows.points, rows.facet.copy(), rows.local
        self._mean = None if rows.points.nodal else rows.points.mean.toarray()
        self._shares = (rows.points.nodes, rows.points.weights), (rows.master, -rows.weights)
        self.row_nodes, self.area, self.at_edge = rows.points.row_nodes, rows.points.area, rows.at_edge
        self.normals, self.unpaired = rows.normals, rows.unpaired

    def _drift_rows(self, rows: ContactRows) -> Array:
        """Rows of the sliding of some pairs along two tangents, (6, n)."""
        some = _spread(rows.points.at(self.slave.surface.points))
        blocks = []
        for tangent in np.linalg.svd(rows.approach[None])[2][1:]:
            along, block = np.tile(tangent, (len(some), 1)), []
            for (nodes, weights), side in zip(self._shares, self.sides, strict=True):
                G = directed_matrix(nodes[some], weights[some], along, len(side.surface.points))
                block.append(_dense(G @ side.kinematics.rows))
            blocks.append(block)
        return np.block(blocks)

    # Pairs that follow.

    def at(self, q: Array) -> Array:
        """Gaps of the present rows, (nr,) [m], at coordinates q, (n,)."""
        if not self.moving:
            if abs(self._drift @ q - self._drift_start).max() <= _HELD * self.size:
                self._q = q
                return self._gap + self.H @ q
            self.moving, self._since, self._searched_at = True, 0, None
        self._q = q
        witnesses = [w.place(part) for w, part in zip(self._witnesses, self.split(q), strict=True)]
        moved = self._has_moved(np.vstack(witnesses))
        if not moved and not len(self.row_nodes):
            return np.empty(0)
        x_s, x_m = self.places(q)
        if moved:
            self._search(x_s, x_m)
        gap = self._follow(x_s, x_m)
        self._since += 1
        if self._since >= _PATIENCE and self._linear:
            self._since = 0
            # Only where they touch: pairs of patches far apart are not those that will meet.
            if self._stands_still(*witnesses) and gap.min(initial=np.inf) < _HELD * self.size:
                rows = self._project(x_s, x_m)[0]
                self._hold(rows, q)
                return rows.gap
        return gap

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """As `Gaps.closing`; with what is no row yet, as near as it can be and as fast as the patches are."""
        found = super().closing(q, q_t, q_tt)
        if not self.moving:
            return found
        beyond = (_NEAR - 2 * _SEARCHED) * self.size
        if not len(found[0]):
            x_s, x_m = self.places(q)
            beyond = self._project(x_s, x_m, _NEAR * self.size)[1]
        of_slave, of_master = (
            side.kinematics.velocities(*parts)
            for side, *parts in zip(self.sides, self.split(q), self.split(q_t), strict=True)
        )
        mean = of_master.mean(axis=0)
        speed = sum(np.linalg.norm(v - mean, axis=1).max() for v in (of_slave, of_master))
        gap, rate, acceleration = found
        return np.append(gap, beyond), np.append(rate, -speed), np.append(acceleration, 0.0)

    def _has_moved(self, here: Array) -> bool:
        """Whether points may meet other facets than at the last search, by the witnesses' places."""
        if not np.isfinite(here).all():
            raise ComplementarityError("the patches are nowhere: the run has become unstable")
        if self._searched_at is not None and abs(here - self._searched_at).max() <= self._reach:
            return False
        self._searched_at = here
        return True

    def _project(self, x_s: Array, x_m: Array, near: float = np.inf) -> tuple[ContactRows, float]:
        """Rows of the points whose gaps are below `near` [m] and of those that share a row with them; least gap."""
        slave, master = (replace(side.surface, points=x) for side, x in zip(self.sides, (x_s, x_m), strict=True))
        found = closest_points(self._all.at(x_s), x_m[master.facets])
        paired = facing(found, slave.normal_here, self.size)
        least = found.gap[paired].min(initial=np.hypot(found.gap, found.offset).min())
        if np.isfinite(near):
            close = (paired & (found.gap < near)).astype(float)
            beside = self._all.mean.T @ (self._all.mean @ close > 0)
            paired &= beside > 0
        return rows_of(self._all, found, paired, slave, master, self.approach), float(least)

    def _search(self, x_s: Array, x_m: Array) -> None:
        rows, least = self._project(x_s, x_m, _NEAR * self.size)
        self._take(rows)
        self._gone, self._past = np.zeros((2, len(rows.facet)), dtype=bool)
        # Far apart, the next search comes when the patches may have come near.
        self._reach = max(_SEARCHED * self.size, 0.25 * (least - _NEAR * self.size))

    def _follow(self, x_s: Array, x_m: Array) -> Array:
        facets = self.sides[1].surface.facets
        x = self._points.at(x_s)
        pairs, left = follow(x, x_m[facets[self._facet]], self._facet, self._local)
        left &= ~self._past
        if left.any():
            found = closest_points(x[left], x_m[facets])
            for name in ("facet", "local", "weights", "normal", "gap"):
                getattr(pairs, name)[left] = getattr(found, name)
            # Points that look past the edge of the patch are left alone until the next search.
            self._past[left] = found.offset > _ON_EDGE * self.size
            self._gone[left] = found.offset > EDGE_TOLERANCE * self.size
        self._local, self.normals = pairs.local, pairs.normal
        self._shares = self._shares[0], (facets[self._facet], -pairs.weights)
        gap = np.where(self._gone, self.size, pairs.gap) if self._gone.any() else pairs.gap
        return gap if self._mean is None else self._mean @ gap

    def _stands_still(self, of_slave: Array, of_master: Array) -> bool:
        """Whether the patches have hardly slid since this was asked last, by the witnesses' places."""
        here = of_slave - of_master.mean(axis=0)
        here -= np.outer(here @ self.approach, self.approach)
        last, self._stood_at = self._stood_at, here
        return last is not None and bool(abs(here - last).max() < _STILL * _HELD * self.size)


def _spread(points: Array) -> Array:
    """Three points far from each other."""
    first = int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())
    second = int(np.linalg.norm(points - points[first], axis=1).argmax())
    both = np.linalg.norm(points - points[first], axis=1) * np.linalg.norm(points - points[second], axis=1)
    return np.unique([first, second, int(both.argmax())])


def _dense(matrix: Any) -> Array:
    return matrix.toarray() if sp.issparse(matrix) else matrix


def _joined(parts: list[Any]) -> Any:
    """Side by side, (nr, n): csr if all of them are."""
    return sp.hstack(parts, format="csr") if all(map(sp.issparse, parts)) else np.hstack([*map(_dense, parts)])
