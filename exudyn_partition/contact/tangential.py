"""Tangential directions of gap rows: the sliding of the rows, and the effects of forces along the tangents.

A row has its normal direction and two tangents, perpendicular to the row's mean normal. Its gap is the weighted mean of
its points' gaps. Its tangential place is the same mean of their places relative to the master. The order of a row's
directions is normal, first tangent, second tangent. Direction k of row i has the number 3 i + k.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..algebra.products import congruence, dense, joined, product
from ..algebra.vectors import cross
from ..errors import InputError
from ..fe.model import node_dofs
from ..frames.kinematics import Rows
from ..frames.rotations import total_moment
from ..support.arrays import Array
from ..surfaces.loops import at_points
from . import loops
from .gaps import Gaps, GapState
from .normal_rows import rates_of
from .side import LoadedNodes
from .stages import NOTHING, OF_SIDE, Anchor, Standing

SAME = 0.02  # of a facet's size, or change of normals: below it, rows keep their flexibility in three directions
_MANY = 1000  # rows above which the flexibility of all, (3 nr, 3 nr), is not kept
STEEP = 0.9  # cosine between a row's normal and the axis of its tangents, above which another axis is taken


class TangentialRows:
    """The present rows of a contact with their tangents.

    Sliding counts from the places that `record_places` recorded. The offset between slave and master turns with the
    master, so that a common motion of both is no sliding. Forces on the master act at the slave's points.

    Parameters
    ----------
    gaps : Gaps
        The normals and pairs of its last evaluation are those of the rows.

    Raises
    ------
    InputError
        If a side has a flexibility for normal forces only.
    """

    def __init__(self, gaps: Gaps) -> None:
        for side in gaps.sides:
            if side.flexibility is not None and side.normal_only:
                raise InputError(
                    "friction: needs the residual flexibility of tangential forces, but the contact patch carries that "
                    "of its normal alone; make it by Partition.ball(..., axes='xyz')"
                )
        self.gaps = gaps
        self._first = int(abs(gaps.placement.approach).argmin())
        self._axis = self._first  # of the last present rows: those at an anchor follow it
        self._places: list[Array] | None = None
        self._places_of: object = None
        self.forget_places()

    d = 3

    def directions(self, index: Array) -> Array:
        """Numbers of the three directions of some rows, (3 na,)."""
        return directions(index)

    def tractions(self, forces: Array) -> Array:
        """Tangential forces in space, (nr, 3) [N], from forces along the directions of rows, (nr, 3) [N]."""
        return self.in_space(forces[:, 1:])

    def moment(self, forces: Array, point: Array) -> Array:
        """Moment on the slave about a point in space, (3,) [N m], from forces along the rows, (nr, 3) [N]."""
        gaps = self.gaps
        return gaps.stage.moment_of(self.at_points(forces), point - gaps.centre, gaps.present.places[0])

    def forget_places(self) -> None:
        """Forget the places that `record_places` recorded: nothing has slid."""
        self._from: Anchor | GapState | None = None

    def record_places(self, here: GapState | None = None, *, soon: bool = True) -> None:
        """Count sliding from the present places; unless sliding is needed `soon`, compute them when it is needed.

        `here` is the state of the gaps at these places, if somebody has it.
        """
        gaps = self.gaps
        self._from = here or Anchor(gaps.present.q, gaps.stage.pose, gaps.present.growing)
        self._places = gaps.present.places if soon and gaps.moving else None
        self._places_of = gaps.stage.rows.sides

    def record_places_at(self, q: Array, pose: Array) -> None:
        """Count sliding from the places at coordinates q, (n,), with the rigid surface's carrier at a pose, (12,)."""
        self._from, self._places = Anchor(q, pose, self.gaps.growing), None

    @property
    def has_places(self) -> bool:
        """Whether `record_places` has recorded any."""
        return self._from is not None

    @property
    def axes(self) -> Array:
        """Axes of the body that the tangents follow, as columns, (3, 3): the master, or else the slave."""
        gaps = self.gaps
        return gaps.stage.once("axes", lambda: gaps.sides[-1].kinematics.frame(gaps.present.coordinates[-1])[1])

    @property
    def tangents(self) -> Array:
        """Two tangents of each row, (nr, 2, 3)."""
        return self._followed()[1]

    @property
    def axis(self) -> int:
        """Number of the axis from which the tangents are made."""
        return self._followed()[0]

    def _followed(self) -> tuple[int, Array]:
        """Axis from which tangents are made, and the tangents, (nr, 2, 3), to the present normals."""
        stage, axis = self.gaps.stage, self._axis
        if stage.of_anchor:
            along = stage.once(("tangents", axis), lambda: loops.tangents_of(stage.normal, self.axes[:, axis])[0])
            return axis, along
        self._axis, along = stage.once("tangents", self._suitable)
        return self._axis, along

    def _suitable(self) -> tuple[int, Array]:
        """The first axis that no normal is nearly along, and tangents; whatever axis rows had before."""
        best, least = (self._first, NOTHING), np.inf
        for axis in (self._first, (self._first + 1) % 3, (self._first + 2) % 3):
            tangents, cosines = loops.tangents_of(self.gaps.stage.normal, self.axes[:, axis])
            steepest = float(cosines.max(initial=0.0))
            if steepest < least:
                best, least = (axis, tangents), steepest
            if steepest <= STEEP:
                return axis, tangents
        return best

    def in_space(self, along: Array) -> Array:
        """Vectors in space, (nr, 3), of components along the tangents, (nr, 2)."""
        return loops.in_space(self.tangents, along)

    def along(self, vectors: Array) -> Array:
        """Components along the tangents, (nr, 2), of vectors in space, (nr, 3)."""
        return loops.along(self.tangents, vectors)

    def way(self) -> Array:
        """How far the rows have slid along their tangents since `record_places`, (nr, 2) [m]."""
        gaps = self.gaps
        if self._from is None:
            return np.zeros((len(gaps.row_nodes), 2))
        if not gaps.moving:
            return np.asarray(self._all_rows() @ (gaps.present.q - self._from.q)).reshape(-1, 3)[:, 1:]
        if self._places is None or self._places_of is not gaps.stage.rows.sides:  # other sides follow other nodes
            self._places, self._places_of = gaps.sides.places(self._from.q, self._from.growing), gaps.stage.rows.sides
        now = gaps.present.places
        if not gaps.carried and gaps.sides[-1].kinematics.linear:
            moved = [x - before for x, before in zip(now, self._places, strict=True)]
            return self.along(self._offsets(moved))
        return self.along(self._offsets(now) - self._carried(self._offsets(self._places), self._from))

    def rates(self, q_t: Array) -> Array:
        """See `rates_of`."""
        return rates_of(self, q_t)

    def _offsets(self, places: list[Array]) -> Array:
        """Mean place of each row's points, relative to the master if that is a patch, (nr, 3) [m]."""
        gaps = self.gaps
        parts = zip(gaps.stage.shares, places, strict=True)
        apart = [at_points(nodes, weights, x) for (nodes, weights), x in parts]
        return gaps.stage.rows.points.average(apart[0] if len(apart) == 1 else apart[0] + apart[1])

    def _carried(self, offsets: Array, then: Anchor | GapState) -> Array:
        """Offsets, (nr, 3), from where the sides were, carried to the present place by the master's motion."""
        gaps = self.gaps
        if len(gaps.sides) == 2:
            master = gaps.sides[1].kinematics
            return offsets if master.linear else offsets @ master.frame(gaps.sides.split(then.q)[1])[1] @ self.axes.T
        if not gaps.carried:
            return offsets
        (place, axes), (place_now, axes_now) = (
            (pose[:3], pose[3:].reshape(3, 3)) for pose in (then.pose, gaps.stage.pose)
        )
        value: Array = place_now + (offsets - place) @ axes @ axes_now.T
        return value

    def jacobian(self, index: Array) -> Rows:
        """Derivative of some rows' places with respect to the coordinates, (3 na, n), for fixed pairs."""
        if not self.gaps.moving:
            return self._all_rows()[directions(index)]
        return self._rows_on_coordinates(index)

    def _all_rows(self) -> Rows:
        """Jacobian of all rows while pairs are frozen, (3 nr, n)."""
        return self.gaps.stage.once("directed rows", self._rows_on_coordinates)

    def _rows_on_coordinates(self, index: Array | None = None) -> Rows:
        gaps, parts = self.gaps, []
        index = np.arange(len(gaps.row_nodes)) if index is None else index
        for place, (side, q) in enumerate(zip(gaps.stage.rows.sides, gaps.present.coordinates, strict=True)):
            used, weights = self._node_weights(place, index)
            G = _directed(used, weights, self.tangents[index], len(side.surface.points))
            parts.append(side.on_coordinates(q, G))
        return _interleaved(gaps.jacobian(index), joined(parts))

    def _node_weights(self, place: int, index: Array) -> tuple[Array, Array]:
        """Nodes of one side's patch in some rows, (k,), and their signed weights in each row, (na, k)."""
        stage = self.gaps.stage
        (row, point, share), (nodes, weights) = stage.rows.points.triplets, stage.shares[place]
        n_rows, (used, column) = len(self.gaps.row_nodes), self._used(place)
        cells = column[nodes[point]] + len(used) * row[:, None]
        sums = np.bincount(cells.ravel(), (share[:, None] * weights[point]).ravel(), minlength=n_rows * len(used))
        return used, sums.reshape(n_rows, len(used))[index]

    def _used(self, place: int) -> tuple[Array, Array]:
        """Nodes of one side's patch in the present rows, (k,), and each node's number among them, (np,)."""
        nodes = self.gaps.stage.shares[place][0]
        present = np.bincount(nodes.ravel(), minlength=len(self.gaps.sides[place].surface.points)) > 0
        return np.flatnonzero(present), np.cumsum(present) - 1

    def side_rows(self, place: int) -> Rows:
        """Present rows on the flexibility coordinates of one side's patch, (3 nr, 3 np); csr for a large skin."""
        loaded, rows = self._some_side_rows(place, np.arange(len(self.gaps.row_nodes)))
        if self.gaps.sides[place].on_demand:
            return self._on_patch(loaded, rows)
        result = np.zeros((len(rows), 3 * len(loaded.column)))
        result[:, node_dofs(loaded.nodes)] = rows
        return result

    @staticmethod
    def _on_patch(loaded: LoadedNodes, rows: Array) -> sp.csr_matrix:
        """Rows on the coordinates of loaded nodes, (m, 3 k), as rows on those of the patch, (m, 3 np)."""
        some = sp.csr_matrix(rows)
        columns = node_dofs(loaded.nodes)[some.indices]
        return sp.csr_matrix((some.data, columns, some.indptr), shape=(len(rows), 3 * len(loaded.column)))

    def _some_side_rows(self, place: int, index: Array) -> tuple[LoadedNodes, Array]:
        """Nodes of one side's patch, k of them, and some rows on their flexibility coordinates, (3 na, 3 k).

        Where flexibility is found on demand, they are the nodes of these rows alone; else of all present rows.
        """
        gaps, stage, side = self.gaps, self.gaps.stage, self.gaps.sides[place]
        q, points = gaps.present.coordinates[place], stage.rows.points
        in_body = side.kinematics.in_frame(q, self.tangents[index].reshape(-1, 3)).reshape(len(index), 2, 3)
        (nodes, weights), normals = stage.shares[place], stage.normals
        if side.on_demand:
            points, numbers = points.of_rows(index)
            nodes, weights, normals = nodes[numbers], weights[numbers], normals[numbers]
            loaded, index = LoadedNodes.of(side, nodes), np.arange(len(index))
        else:
            loaded = gaps.anchoring.loaded_nodes(place)
        normals, carried = side.kinematics.in_frame(q, normals), (loaded.column[nodes], weights)
        return loaded, loops.directed_rows(points, index, *carried, normals, in_body, len(loaded.nodes))

    def flexibility(self, index: Array | None = None) -> Array:
        """Residual flexibility between the directions of some present rows, (3 na, 3 na) [m/N]; by default of all.

        It is kept while the points move little, like `NormalRows.flexibility`.
        """
        index = np.arange(len(self.gaps.row_nodes)) if index is None else index
        gaps, axis = self.gaps, self.axis
        find = self._part_of_whole if self._keeps_whole else self._flexibility
        return gaps.anchoring.kept(("directed", axis), SAME, lambda: find(index), index)

    @property
    def _keeps_whole(self) -> bool:
        """Whether the flexibility of all rows is kept: while pairs are frozen, unless there are many."""
        return not self.gaps.moving and len(self.gaps.row_nodes) <= _MANY and not self.gaps.sides.on_demand

    @property
    def _whole(self) -> Array:
        """Flexibility of all rows while pairs are frozen, (3 nr, 3 nr) [m/N]."""
        everything = np.arange(len(self.gaps.row_nodes))
        return self.gaps.stage.once(("directed", self.axis), lambda: self._flexibility(everything))

    def _part_of_whole(self, index: Array) -> Array:
        some = directions(index)
        return self._whole.take(some, axis=0).take(some, axis=1)

    def pushing(self, index: Array) -> Array:
        """See `law.RowDirections`."""
        if self._keeps_whole:
            return self._whole[::3].take(directions(index), axis=1)
        return self.gaps.anchoring.found_at(self.gaps.anchoring.anchor(SAME), lambda: self._pushing(index))

    def _pushing(self, index: Array) -> Array:
        """See `pushing`; found from the sides' flexibilities, and that between them."""
        everything, some, gaps = np.arange(len(self.gaps.row_nodes)), directions(index), self.gaps
        moved, of_sides = np.zeros((len(everything), len(some))), dict[int, tuple[LoadedNodes, Array]]()
        for place, (side, share) in enumerate(zip(gaps.sides, gaps.yielding_shares, strict=True)):
            if side.flexibility is not None:
                of_sides[place] = loaded, rows = self._some_side_rows(place, everything)
                moved += share * product(rows[::3], product(rows[some], loaded.F, threes=True).T)
        if gaps.between is not None:
            (loaded, rows), (loaded_master, pushed) = of_sides[0], of_sides[1]
            between = gaps.between[np.ix_(node_dofs(loaded.nodes), node_dofs(loaded_master.nodes))]
            across = (rows[::3] @ between) @ pushed[some].T + (rows[some] @ between @ pushed[::3].T).T
            moved += gaps.yielding_shares[0] * across
        return moved

    def _flexibility(self, index: Array) -> Array:
        parts = [self._part(place, index) for place, side in enumerate(self.gaps.sides) if side.flexibility is not None]
        return np.asarray(sum(parts, self._across(index)))

    def _across(self, index: Array) -> Array:
        """Flexibility between both sides if one body touches itself, (3 na, 3 na) [m/N]; else zero."""
        if self.gaps.between is None:
            return np.zeros((3 * len(index),) * 2)
        across, yielding = self.across(index), self.gaps.yielding
        return across + across.T if yielding is None else yielding[0] * (across + across.T)

    def standing(self) -> Standing:
        """Where the rows stand; tangents that follow another axis count as other rows."""
        gaps = self.gaps
        return Standing(gaps.stage.rows, gaps.anchoring.anchor(SAME), self.axis)

    def _part(self, place: int, index: Array) -> Array:
        """Contribution of one side to the flexibility of some rows, (3 na, 3 na) [m/N]."""
        loaded, rows = self._some_side_rows(place, index)
        F, yielding = loaded.directed_flexibility(rows), self.gaps.yielding
        return F if yielding is None else yielding[place] * F

    def side_flexibility(self, place: int) -> Array:
        """See `NormalRows.side_flexibility`; in three directions, (3 nr, 3 nr) [m/N]."""
        gaps, everything = self.gaps, np.arange(len(self.gaps.row_nodes))

        def make() -> Array:
            loaded, rows = self._some_side_rows(place, everything)
            return congruence(rows, loaded.F, threes=True)

        return gaps.anchoring.kept((OF_SIDE, place, self.axis), SAME, make)

    def across(self, index: Array | None = None) -> Array:
        """See `NormalRows.across`; of some rows, by default of all, in three directions, (3 na, 3 na) [m/N]."""
        index = np.arange(len(self.gaps.row_nodes)) if index is None else index
        (loaded, rows), (loaded_master, pushed) = (self._some_side_rows(place, index) for place in (0, 1))
        assert self.gaps.between is not None
        between = self.gaps.between[np.ix_(node_dofs(loaded.nodes), node_dofs(loaded_master.nodes))]
        return np.asarray(rows @ between @ pushed.T)

    def carrier_rows(self, index: Array) -> Array:
        """Derivative of the rates of some rows with respect to the velocities of the surface's carrier, (3 na, 6)."""
        gaps = self.gaps
        of_normals = gaps.carrier.rows(gaps.stage, gaps.present.places[0])[index]
        arms = self._offsets(gaps.present.places)[index] - gaps.carrier.pose[:3]
        along = self.tangents[index]
        turning = np.cross(arms[:, None, :], along)
        of_tangents = -np.concatenate([along, turning], axis=2).swapaxes(0, 1).reshape(-1, 6)
        return np.asarray(_interleaved(of_normals, of_tangents))

    def at_points(self, lam: Array) -> Array:
        """Forces on the slave at the present points, (p, 3) [N], from forces along the directions of rows, (nr, 3)."""
        return loops.at_points(self.gaps.stage.rows.points, lam, self.tangents, self.gaps.stage.normals)

    def nodal_forces(self, lam: Array) -> list[Array]:
        """Forces on the nodes of the patches, (np, 3) for each side [N], from forces along the rows, (nr, 3) [N]."""
        forces = self.at_points(lam)
        on_nodes = self.gaps.stage.on_nodes(forces)
        if len(on_nodes) == 2 and not self.gaps.sides[1].kinematics.linear:
            active = np.flatnonzero(forces.any(axis=1))
            on_nodes[1] += self._couple_on_master(active, forces[active])
        return on_nodes

    def _couple_on_master(self, active: Array, forces: Array) -> Array:
        """Couple on the master's nodes, (np, 3) [N], so that the master's forces act at the slave's points.

        The gap separates a tangential force on the slave from its opposite on the master. Alone, both would turn the
        pair. The couple acts on the patch as on a rigid body.
        """
        (nodes, weights), (master_nodes, master_weights) = self.gaps.stage.shares
        x, x_m = self.gaps.present.places
        apart = at_points(nodes[active], weights[active], x)
        apart += at_points(master_nodes[active], master_weights[active], x_m)
        followed = self.gaps.stage.rows.sides[1].active
        turned = np.arange(len(x_m)) if followed is None else followed
        arms = x_m[turned] - x_m[turned].mean(axis=0)
        inertia = np.eye(3) * (arms**2).sum() - arms.T @ arms
        turn = np.linalg.solve(inertia, -total_moment(apart, forces))
        couple = np.zeros_like(x_m)
        couple[turned] = cross(np.tile(turn, (len(arms), 1)), arms)
        return couple

    def acted(self, lam: Array) -> tuple[Array, Array]:
        """See `Stage.acted`; of forces along the directions of the rows, (nr, 3) [N], second is that of normals.

        Who asks for it has tangential forces in space.
        """
        gaps, along = self.gaps, self.gaps.stage.resultant(lam[:, 0])
        if not gaps.moving:
            return np.asarray(self._all_rows().T @ lam.ravel()), along
        parts = zip(gaps.stage.rows.sides, gaps.present.coordinates, self.nodal_forces(lam), strict=True)
        return np.concatenate([side.generalised(q, on_nodes) for side, q, on_nodes in parts]), along


def directions(index: Array) -> Array:
    """Numbers of all three directions of some rows, (3 na,)."""
    value: Array = (3 * np.asarray(index)[:, None] + np.arange(3)).ravel()
    return value


def _directed(nodes: Array, weights: Array, along: Array, n_nodes: int) -> sp.csr_matrix:
    """Rows on nodal displacements, (2 nr, 3 np), from weights of some nodes, (nr, k), along two vectors, (nr, 2, 3).

    All rows along the first vectors come first.
    """
    row, column = np.nonzero(weights)
    values = weights[row, column, None, None] * along[row]
    columns = np.tile((3 * nodes[column, None] + np.arange(3)).ravel(), 2)
    ends = 3 * np.searchsorted(row, np.arange(len(weights) + 1))
    starts = np.concatenate([ends, ends[1:] + 3 * len(row)])
    data = np.concatenate([values[:, 0].ravel(), values[:, 1].ravel()])
    return sp.csr_matrix((data, columns, starts), shape=(2 * len(weights), 3 * n_nodes))


def _interleaved(normal: Rows, tangential: Rows) -> Rows:
    """Rows of normals, (nr, n), and of first and then second tangents, (2 nr, n), in the order of the directions."""
    n_rows = normal.shape[0]
    place = np.arange(3 * n_rows).reshape(3, n_rows).T.ravel()
    if sp.issparse(normal) and sp.issparse(tangential):
        return sp.vstack([normal, tangential], format="csr")[place]
    return np.vstack([dense(normal), dense(tangential)])[place]
