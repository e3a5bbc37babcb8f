"""Contacts with curved rigid surfaces in a pass back over the samples of a run, if frames do not turn.

Points of a patch are at x = x_0 + P q, with gaps g(x) to the surface. Gaps of the rows are h = A g, their forces lambda
push the points by p = A' lambda along the normals n = dg/dx. So the generalised forces are those of rows
B = A diag(n') P, which change with the motion. With the adjoint y of accelerations over masses, see
`adjoint.backwards`, the forces of a sample give to the adjoint of its coordinates::

    B' h' + P' diag(p C) P y,    C = d2g/dx2 = (1 - n n' - a a') / r

at a distance r from the centre or the axis a.

The flexibility of the rows is F = R F_b R', with R the rows on the nodes of the patch, by normals at the anchor: an
earlier sample, or the start. Between two samples in which anchors are found F stays as it is. In each such span it
takes the derivative dJ/dF, the sum of h' lambda' over its samples; by R and the normals it reaches the coordinates of
the anchor. What regularisation adds is taken as constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ..algebra.complementarity import REGULARISATION
from ..support.arrays import Array
from .moving import Anchors, MovingPlan
from .plain_moving import PlainSurface
from .plan import FrozenPlan

_ALL = slice(None)


class Stance(NamedTuple):
    """Points of a contact at m samples.

    Parameters
    ----------
    normals : (m, p, 3) array
    curved : (m, p) array
        One over the distance from the centre or axis, negative in a bore [1/m].
    """

    normals: Array
    curved: Array


class SurfaceBack:
    """A contact with a rigid surface whose rows follow the motion of a body in an inertial frame.

    Parameters
    ----------
    plan : MovingPlan
    s : int
        Its number among the contacts with rigid surfaces.

    Attributes
    ----------
    contact : int
        Its number in the plan.
    dofs : (n,) int array
    shapes : (v, 3, n) array
        Places of its nodes by the coordinates.
    mean : (nr, p) array
        A.
    directed : bool
        Whether the flexibility depends on the normals.
    """

    def __init__(self, plan: MovingPlan, s: int) -> None:
        self._plain = PlainSurface(plan.surfaces, s, None)
        plain = self._plain
        self.contact, self.dofs, self.mean, self.directed = plain.contact, plain.dofs, plain.mean, plain.d > 1
        self._points = slice(*plan.surfaces.firsts[s : s + 2])
        k, n = plain.on_points.shape[1], plain.rows_on_nodes.shape[1]
        self.shapes = plain.rows_on_nodes.reshape(k, 3, n)
        self._start = plain.on_points @ plain.start - plain.surface[1]

    def places(self, some: Array | slice = _ALL) -> Array:
        """Places of some points by the coordinates, P, (p, 3, n)."""
        k, _, n = self.shapes.shape
        on_points = self._plain.on_points[some]
        found: Array = (on_points @ self.shapes.reshape(k, 3 * n)).reshape(len(on_points), 3, n)
        return found

    def between(self, rows: Array) -> tuple[Array, Array, Array, Array]:
        """What is between some rows and the coordinates.

        Returns
        -------
        Rows by their points, (na, p), numbers of these, (p,), points by their nodes, (p, v), and numbers of these.
        """
        mean = self.mean[rows]
        points = np.flatnonzero(mean.any(axis=0))
        on_nodes = self._plain.on_points[points]
        nodes = np.flatnonzero(on_nodes.any(axis=0))
        return mean[:, points], points, on_nodes[:, nodes], nodes

    def _arms(self, q: Array, some: Array | slice) -> tuple[Array, Array]:
        """From the centre or axis to some points at coordinates of the model, (m, nq): (m, p, 3), sizes (m, p) [m]."""
        axis, places = self._plain.surface[2], self.places(some)
        p, _, n = places.shape
        arms = self._start[some] + (q[:, self.dofs] @ places.reshape(3 * p, n).T).reshape(len(q), p, 3)
        if axis.any():
            arms -= (arms @ axis)[:, :, None] * axis
        x, y, z = np.moveaxis(arms, 2, 0)
        return arms, np.maximum(np.sqrt(x * x + y * y + z * z), 1e-300)

    def at(self, q: Array, some: Array | slice = _ALL) -> Stance:
        """Some of its points at coordinates of the model, (m, nq)."""
        arms, distance = self._arms(q, some)
        curved = self._plain.surface[4] / distance
        return Stance(arms * curved[:, :, None], curved)

    def gaps(self, q: Array) -> Array:
        """Gaps of its rows at coordinates of the model, (m, nq): (m, nr) [m]."""
        _, _, _, radius, sign = self._plain.surface
        found: Array = sign * (self._arms(q, _ALL)[1] - radius) @ self.mean.T
        return found

    def gaps_by_coordinates(self, q: Array) -> tuple[Array, Array]:
        """Gaps of its rows at coordinates of the model, (nq,): (nr,) [m], and their derivatives, (nr, nq)."""
        normals, H = self.at(q[None]).normals[0], np.zeros((len(self.mean), len(q)))
        H[:, self.dofs] = self.mean @ np.einsum("pa,pan->pn", normals, self.places())
        return self.gaps(q[None])[0], H

    def on_nodes(self, along: Array, some: Array) -> Array:
        """Some rows on the values of its nodes that the flexibility has, (na, d k), by normals (p, 3)."""
        if not self.directed:
            return -self.mean[some] @ self._plain.on_points
        rows = np.stack([(self.mean[some] * along[:, a]) @ self._plain.on_points for a in range(3)], axis=2)
        return rows.reshape(len(some), 3 * rows.shape[1])

    @property
    def flexibility(self) -> Array:
        """Of its nodes, (d k, d k) [m/N]."""
        return self._plain.flexibility

    @property
    def fields(self) -> Array:
        """Fields of its nodes that contacts exchange, (d k, m)."""
        return self._plain.node_fields

    def by_normals(self, some: Array, by_nodes: Array) -> Array:
        """Derivatives by the normals at the anchor, (k, p, 3), from those by `on_nodes`, (k, na, d k)."""
        parts = by_nodes.reshape(*by_nodes.shape[:2], by_nodes.shape[2] // 3, 3)
        on_points = np.einsum("pv,kiva->kipa", self._plain.on_points, parts, optimize=True)
        return np.asarray(np.einsum("ip,kipa->kpa", self.mean[some], on_points, optimize=True))

    def by_coordinates(self, q: Array, by_normals: Array) -> Array:
        """Derivatives by the coordinates of the anchor, (k, n), from those by its normals, (k, p, 3)."""
        there, axis = self.at(q[None]), self._plain.surface[2]
        normals = there.normals[0]
        across = (
            by_normals
            - np.einsum("kpa,pa,pb->kpb", by_normals, normals, normals)
            - (by_normals @ axis)[:, :, None] * axis
        )
        places = self.places()
        return np.tensordot(across * there.curved[0][:, None], places, 2)

    @property
    def axis(self) -> Array:
        """See `loops.Primitive`."""
        axis: Array = self._plain.surface[2]
        return axis

    def at_start(self, anchors: Anchors | None, s: int) -> Array | None:
        """Normals at the anchor with which a run begins, (p, 3); None if there is none."""
        if anchors is None or not anchors.anchored[s]:
            return None
        return anchors.along[self._points]


class SurfacesBack:
    """All such contacts of a run that was made.

    Parameters
    ----------
    contacts : FrozenPlan
    q : (n, nq) array
        Coordinates of all samples.
    fresh : (n, ns) bool array
        See `loops.Samples`.
    anchors : Anchors or None
        With which the run began.
    """

    def __init__(self, contacts: FrozenPlan, q: Array, fresh: Array, anchors: Anchors | None) -> None:
        moving = contacts.moving
        count = 0 if moving is None else len(moving.rigid)
        self.surfaces = [SurfaceBack(moving, s) for s in range(count)] if moving is not None else []
        self._contacts, self._q, self._fresh, self._begins = contacts, q, fresh, anchors
        self._of_contact = {one.contact: s for s, one in enumerate(self.surfaces)}

    def rows(self, s: int) -> slice:
        """Rows of a contact among all."""
        return slice(*self._contacts.rows.starts[self.surfaces[s].contact :][:2])

    @cached_property
    def anchors(self) -> Array:
        """Samples in which each contact found the anchor that it has in a sample, (ns, n); -1 is the start."""
        n, count = len(self._q), len(self.surfaces)
        numbers = np.where(self._fresh[:, :count].T, np.arange(n), -1)
        return np.asarray(np.maximum.accumulate(numbers, axis=1)).reshape(count, n)

    def set_gaps(self, gaps: Array, q: Array) -> None:
        """Set the gaps of the rows of these contacts among all, (m, nr) [m], at coordinates (m, nq)."""
        for s, one in enumerate(self.surfaces):
            gaps[:, self.rows(s)] = one.gaps(q)

    @property
    def edges(self) -> Array:
        """Samples in which anchors are found, which are sorted."""
        return np.unique(self.anchors[self.anchors >= 0])

    def along(self, s: int, sample: int) -> Array:
        """Normals of a contact at the anchor that it has in a sample, (p, 3)."""
        one, anchor = self.surfaces[s], int(self.anchors[s, sample])
        before = one.at_start(self._begins, s) if anchor < 0 else None
        return one.at(self._q[max(anchor, 0)][None]).normals[0] if before is None else before

    def set_flexibility(self, F: Array, sample: int, rows: Array, others: Array) -> None:
        """Set the flexibility between some rows and others, (na, nb) [m/N], where it is that of moving contacts."""
        for s, one in enumerate(self.surfaces):
            own, here = self._own(s, rows)
            pushing, there = self._own(s, others)
            along = self.along(s, sample)
            left, right = one.on_nodes(along, own), one.on_nodes(along, pushing)
            moved = left @ one.flexibility
            mean = np.vdot(moved, left) / max(len(own), 1)
            F[np.ix_(here, there)] = moved @ right.T + REGULARISATION * mean * (own[:, None] == pushing)
            for (j, k), core in self._contacts.core.items():
                if j == one.contact:
                    columns, numbers = self._fields(k, sample, others)
                    F[np.ix_(here, numbers)] = left @ self._wide(s) @ core @ columns.T
                elif k == one.contact and j not in self._of_contact:
                    lines, numbers = self._fields(j, sample, rows)
                    F[np.ix_(numbers, there)] = lines @ core @ (right @ self._wide(s)).T

    def _own(self, s: int, rows: Array) -> tuple[Array, Array]:
        """Which rows of a contact some rows are, and where these are among them."""
        return _within(self.rows(s), rows)

    def _wide(self, s: int) -> Array:
        """Fields of the nodes of a contact, (d k, m), as many as all have."""
        fields = self.surfaces[s].fields
        m = self._contacts.fields[self.surfaces[s].contact].shape[1]
        return np.pad(fields, ((0, 0), (0, m - fields.shape[1])))

    def _fields(self, j: int, sample: int, rows: Array) -> tuple[Array, Array]:
        """Fields of those of some rows that are contact j's, (na, m), and where these are among them."""
        own, places = _within(slice(*self._contacts.rows.starts[j : j + 2]), rows)
        if j not in self._of_contact:
            return self._contacts.fields[j][own], places
        s = self._of_contact[j]
        return self.surfaces[s].on_nodes(self.along(s, sample), own) @ self._wide(s), places

    def copy_flexibility(self, F: Array, to: Array, rows: Array, some: Array) -> None:
        """Copy the flexibility of these contacts among rows, (d, d) [m/N], to that among some of them, by places."""
        for s in range(len(self.surfaces)):
            here = self._own(s, rows[some])[1]
            to[here], to[:, here] = F[np.ix_(some[here], some)], F[np.ix_(some, some[here])]

    def by_normals(self, s: int, sample: int, rows: Array, slips: Array, forces: Array) -> Array:
        """Derivatives of k numbers by the normals of the anchor that a contact has in a sample, (k, p, 3).

        `slips`, (m, k, d), are those by the gaps of some rows in samples with this anchor, `forces`, (m, d), theirs.
        """
        one, (own, here) = self.surfaces[s], self._own(s, rows)
        total = np.tensordot(slips[:, :, here], forces, (0, 0))
        total += np.tensordot(slips, forces[:, here], (0, 0)).transpose(0, 2, 1)
        by_nodes = total[:, :, here] @ (one.on_nodes(self.along(s, sample), own) @ one.flexibility)
        for (j, k), core in self._contacts.core.items():
            if j == one.contact and k != j:
                columns, numbers = self._fields(k, sample, rows)
                by_nodes += total[:, :, numbers] @ (columns @ core.T @ self._wide(s).T)
        return one.by_normals(own, by_nodes)


def _within(own: slice, rows: Array) -> tuple[Array, Array]:
    """Those of some rows that are within others, by their numbers there, and their places among the rows."""
    places = np.flatnonzero((rows >= own.start) & (rows < own.stop))
    return rows[places] - own.start, places


class SurfaceRows(NamedTuple):
    """Closed rows of such contacts in m samples, as the pass back takes them.

    There are n of them, on p points between v nodes of c contacts, whose bodies have up to n_dofs coordinates each.

    Parameters
    ----------
    place : (m,) int array
        Where each sample is in `normals`, `curved` and `push`, which have those with forces; -1 without any.
    rows : (n,) int array
        Their numbers in `RowsBack`.
    starts, columns, means : (n + 1,) int, (e,) int, (e,) arrays
        Points of each row, and how much they count.
    node_starts, nodes, weights : (p + 1,) int, (f,) int, (f,) arrays
        Nodes of each point, and how much they count.
    firsts, node_firsts : (c + 1,) int arrays
        First point and first node of each contact.
    counts : (c,) int array
        Number of coordinates of each body.
    dofs : (c, n_dofs) int array
    axes : (c, 3) array
        See `loops.Primitive`.
    shapes : (v, 3, n_dofs) array
        Places of the nodes by these coordinates.
    normals, curved, push : (ms, p, 3), (ms, p), (ms, p) arrays
        See `Stance`; forces on the points [N].
    """

    place: Array
    rows: Array
    starts: Array
    columns: Array
    means: Array
    node_starts: Array
    nodes: Array
    weights: Array
    firsts: Array
    node_firsts: Array
    counts: Array
    dofs: Array
    axes: Array
    shapes: Array
    normals: Array
    curved: Array
    push: Array

    @classmethod
    def of(cls, some: SurfacesBack, q: Array, rows: Array, lam: Array) -> SurfaceRows | None:
        """Those among rows, (nw,), with forces (m, nw) at coordinates of the model, (m, nq); None without any."""
        surfaces, n_dofs = some.surfaces, max((len(one.dofs) for one in some.surfaces), default=0)
        dofs, axes = np.zeros((len(surfaces), n_dofs), dtype=np.int64), np.zeros((len(surfaces), 3))
        within = [_within(some.rows(s), rows) for s in range(len(surfaces))]
        closed = np.concatenate([np.zeros(0, dtype=np.int64), *(here for _, here in within)])
        there = np.flatnonzero(lam[:, closed].any(axis=1))
        if not len(there):
            return None
        place, means, on_nodes = np.full(len(q), -1), list[Array](), list[Array]()
        shapes, at = list[Array](), list[tuple[Array, Array, Array]]()
        place[there] = np.arange(len(there))
        for s, (one, (own, here)) in enumerate(zip(surfaces, within, strict=True)):
            dofs[s, : len(one.dofs)], axes[s] = one.dofs, one.axis
            mean, used, points, nodes = one.between(own)
            means.append(mean)
            on_nodes.append(points)
            of_nodes = np.zeros((len(nodes), 3, n_dofs))
            of_nodes[:, :, : len(one.dofs)] = one.shapes[nodes]
            shapes.append(of_nodes)
            at.append((*one.at(q[there], used), lam[np.ix_(there, here)] @ mean))
        normals, curved, push = (np.concatenate(parts, axis=1) for parts in zip(*at, strict=True))
        return cls(
            place, closed, *_flat(means), *_flat(on_nodes), _ends([mean.shape[1] for mean in means]),
            _ends([len(of_nodes) for of_nodes in shapes]), np.array([len(one.dofs) for one in surfaces]), dofs, axes,
            np.concatenate(shapes), normals, curved, push,
        )  # fmt: skip

    def _points(self, s: int, y: Array) -> Array:
        """Ways of the points, (k, p, 3), by those of the coordinates, (k, nq)."""
        ways = np.zeros((len(y), len(self.push[0]), 3))
        for contact, n in enumerate(self.counts):
            own, nodes = self._own(contact)
            shapes = self.shapes[nodes, :, :n]
            ways[:, own] = np.einsum("pv,van,kn->kpa", self._on_nodes(contact), shapes, y[:, self.dofs[contact, :n]])
        return ways

    def _own(self, contact: int) -> tuple[slice, slice]:
        """Points and nodes of a contact."""
        return slice(*self.firsts[contact : contact + 2]), slice(*self.node_firsts[contact : contact + 2])

    def _on_nodes(self, contact: int) -> Array:
        """Points by nodes of a contact, (p, v)."""
        points, nodes = self._own(contact)
        entries = self.weights, self.nodes, self.node_starts
        found: Array = sp.csr_matrix(entries, (len(self.push[0]), len(self.shapes))).toarray()
        return found[points, nodes]

    def add_pushes(self, s: int, y: Array, by_forces: Array) -> Array:
        """Add derivatives by the forces, (k, d), by the adjoint of accelerations over masses, (k, nq), at sample s.

        Return the ways of the points, (k, p, 3), for `back`.
        """
        ways, there = self._points(s, y), self.place[s]
        if there >= 0:
            along = np.einsum("kpa,pa->kp", ways, self.normals[there])
            for row, (first, end) in zip(self.rows, _pairs(self.starts), strict=True):
                by_forces[:, row] += along[:, self.columns[first:end]] @ self.means[first:end]
        return ways

    def back(self, s: int, ways: Array, slips: Array, q: Array) -> None:
        """Add derivatives by the coordinates to q, (k, nq), by those by gaps, (k, d)."""
        there, on_points = self.place[s], np.zeros(ways.shape[:2])
        if there < 0:
            return
        for row, (first, end) in zip(self.rows, _pairs(self.starts), strict=True):
            on_points[:, self.columns[first:end]] += slips[:, row, None] * self.means[first:end]
        normals, share = self.normals[there], self.push[there] * self.curved[there]
        for contact, n in enumerate(self.counts):
            own, nodes = self._own(contact)
            normal, axis, way = normals[own], self.axes[contact], ways[:, own]
            across = way - np.einsum("kpa,pa,pb->kpb", way, normal, normal) - (way @ axis)[:, :, None] * axis
            of_points = on_points[:, own, None] * normal + share[own, None] * across
            shapes = self.shapes[nodes, :, :n]
            q[:, self.dofs[contact, :n]] += np.einsum("kpa,pv,van->kn", of_points, self._on_nodes(contact), shapes)


def _flat(parts: Sequence[Array]) -> tuple[Array, Array, Array]:
    """Entries of matrices on a diagonal that are not zero: starts of the lines, columns and values."""
    joined = sp.block_diag([sp.csr_matrix(part) for part in parts], format="csr")
    return joined.indptr.astype(np.int64), joined.indices.astype(np.int64), joined.data


def _ends(sizes: Sequence[int]) -> Array:
    return np.cumsum([0, *sizes])


def _pairs(starts: Array) -> Sequence[tuple[int, int]]:
    """First place and end of each part."""
    return [*zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True)]
