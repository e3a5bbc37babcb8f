"""Contacts with rigid surfaces whose rows follow the motion in a pass back over the samples of a run.

These are curved surfaces, or those of bodies in floating frames: there all this is in the body's axes, see
`frames_back`. Points of a patch are at x = x_0 + P q, with gaps g(x) to the surface. Gaps of the rows are h = A g,
their forces lambda push the points by p = A' lambda along the normals n = dg/dx. So the generalised forces are those
of rows B = A diag(n') P, which change with the motion. With the adjoint y of accelerations over masses, see
`adjoint.backwards`, the forces of a sample give to the adjoint of its coordinates::

    B' h' + P' diag(p C) P y,    C = d2g/dx2 = (1 - n n' - a a') / r

at a distance r from the centre or the axis a; planes have no C. There all points have one normal, so that the mean of
the points of a row stands for all of them, with A = 1.

The flexibility of the rows is F = R F_b R', with R the rows on the nodes of the patch, by normals at the anchor: an
earlier sample, or the start. In a floating frame these are normals in the body's axes. Between two samples in which
anchors are found F stays as it is. In each such span it takes the derivative dJ/dF, the sum of h' lambda' over its
samples; by R and the normals it reaches the coordinates of the anchor. What regularisation adds is taken as constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ..algebra.complementarity import REGULARISATION
from ..support.arrays import Array
from .frames_back import FramesBack, FramesMotion, by_growth, push_masses
from .moving import Anchors, MovingPlan
from .plain_moving import PlainSurface
from .plan import FrozenPlan

_ALL = slice(None)


class Stance(NamedTuple):
    """Points of a contact at m samples.

    Parameters
    ----------
    normals : (m, 3, p) array
    curved : (m, p) array
        One over the distance from the centre or axis, negative in a bore [1/m].
    """

    normals: Array
    curved: Array


class SurfaceBack:
    """A contact with a rigid surface whose rows follow the motion of a body.

    Parameters
    ----------
    plan : MovingPlan
    s : int
        Its number among the contacts with rigid surfaces.
    motion : FramesMotion
        Of the run.

    Attributes
    ----------
    contact, body : int
        Its number in the plan, and that of its body among those in floating frames; -1 for others.
    dofs : (n,) int array
    shapes : (v, 3, n) array
        Places of its nodes by the coordinates; in a floating frame see `frames_back`, without deformation. On a
        plane, nodes and points are both the means of the rows.
    arms, growth : (v, 3), (v, 3, 6) arrays
        Of its nodes in a floating frame, else zero.
    mean : (nr, p) csr matrix
        A.
    directed : bool
        Whether the flexibility depends on the normals.
    """

    def __init__(self, plan: MovingPlan, s: int, motion: FramesMotion) -> None:
        self._plain, self._motion, self.body = PlainSurface(plan.surfaces, s, None), motion, int(plan.surfaces.body[s])
        plain = self._plain
        self.contact, self.dofs, self.directed = plain.contact, plain.dofs, plain.d > 1
        self._points = slice(*plan.surfaces.firsts[s : s + 2])
        k, n = len(plain.start), plain.rows_on_nodes.shape[1]
        self.mean, self._of_nodes = plain.sparse_mean, plain.sparse_on_points
        of_places, self._on_places = sp.identity(k, format="csr"), self._of_nodes
        if self._flat:
            of_places = self._of_nodes = self.mean @ self._of_nodes
            self.mean = self._on_places = sp.identity(self.mean.shape[0], format="csr")

        def at_places(values: Array) -> Array:
            found: Array = of_places @ values.reshape(k, -1)
            return found.reshape(-1, *values.shape[1:])

        self._shapes = at_places(plain.rows_on_nodes.reshape(k, 3, n))
        self.arms, self.growth = np.zeros((len(self._shapes), 3)), np.zeros((len(self._shapes), 3, 6))
        self.shapes = self._shapes
        if self.body >= 0:
            self.arms = at_places(plain.arms)
            turning = np.cross(motion.frames.node_axes[self.body].T, self.arms[:, None]).swapaxes(1, 2)
            translation = np.broadcast_to(np.eye(3), (len(self.arms), 3, 3))
            self.shapes = np.concatenate([translation, turning, self._shapes], axis=2)
        if plain.growth is not None:
            self.growth = at_places(plain.growth.reshape(k, 3, 6))
        self._start = self._on_places @ at_places(plain.start) - plain.surface[1]

    def _on_points(self, values: Array, some: Array | slice) -> Array:
        """Values at some points, (p, ...), by those at the nodes, (v, ...)."""
        if self._flat:
            return values[some]
        found: Array = self._on_places[some] @ values.reshape(len(values), -1)
        return found.reshape(-1, *values.shape[1:])

    def between(self, rows: Array) -> tuple[sp.csr_matrix, Array, sp.csr_matrix, Array]:
        """What is between some rows and the coordinates.

        Returns
        -------
        Rows by their points, (na, p), numbers of these, (p,), points by their nodes, (p, v), and numbers of these.
        """
        mean, points = _compact(self.mean[rows])
        return mean, points, *_compact(self._on_places[points])

    def _moved(self, samples: Array, dofs: Array, shapes: Array) -> Array:
        """Ways of p points, (m, 3, p), by coordinates and their shapes, (p, 3, n)."""
        p, _, n = shapes.shape
        found: Array = self._motion.q[np.ix_(samples, dofs)] @ shapes.transpose(2, 1, 0).reshape(n, 3 * p)
        return found.reshape(len(samples), 3, p)

    def _ways(self, samples: Array, some: Array | slice) -> Array:
        """How some points have moved in space, (m, 3, p), from q = 0."""
        motion, b = self._motion, self.body
        if b < 0:
            return self._moved(samples, self.dofs, self._on_points(self.shapes, some))
        grown = self._moved(samples, self.dofs[6:], self._on_points(self._shapes, some))
        if (products := motion.products[samples, b]).any():
            of_products = self._on_points(self.growth, some).transpose(2, 1, 0)
            grown += (products @ of_products.reshape(6, -1)).reshape(grown.shape)
        turned: Array = motion.change[samples, b] @ self._on_points(self.arms, some).T
        turned += motion.axes[samples, b] @ grown
        turned += motion.q[np.ix_(samples, self.dofs[:3])][:, :, None]
        return turned

    def _arms(self, samples: Array, some: Array | slice) -> tuple[Array, Array]:
        """From the centre or axis to some points in some samples, (m,): (m, 3, p), sizes (m, p) [m]."""
        arms, axis = self._ways(samples, some), self._plain.surface[2]
        arms += self._start[some].T
        if axis.any():
            arms -= axis[:, None] * _along(arms, axis)[:, None]
        distance = np.sqrt(np.einsum("map,map->mp", arms, arms))
        return arms, np.maximum(distance, 1e-300, out=distance)

    @property
    def _flat(self) -> bool:
        """Whether the surface is a plane."""
        return bool(self._plain.surface[0] == 0)

    def at(self, samples: Array, some: Array | slice = _ALL) -> Stance:
        """Some of its points in some samples, (m,); in a floating frame, normals are in the body's axes."""
        _, _, axis, _, sign = self._plain.surface
        if self._flat:
            normals = np.broadcast_to(axis[:, None], (len(samples), 3, len(self._start[some])))
            curved = np.zeros((len(samples), normals.shape[2]))
        else:
            normals, distance = self._arms(samples, some)
            curved = sign / distance
            normals *= curved[:, None]
        if self.body >= 0:
            normals = self._motion.axes[samples, self.body].swapaxes(1, 2) @ normals
        return Stance(normals, curved)

    def axes(self, samples: Array) -> Array:
        """Axis of the surface, see `loops.Primitive`, in some samples, (m, 3); in a floating frame in the body's."""
        axis = np.broadcast_to(self._plain.surface[2], (len(samples), 3))
        return axis if self.body < 0 else np.einsum("ma,mab->mb", axis, self._motion.axes[samples, self.body])

    def gaps(self, samples: Array) -> Array:
        """Gaps of its rows in some samples, (m,): (m, nr) [m]."""
        _, _, axis, radius, sign = self._plain.surface
        if self._flat:
            along: Array = self._start @ axis + _along(self._ways(samples, _ALL), axis)
            return along
        found: Array = sign * (self._arms(samples, _ALL)[1] - radius) @ self.mean.T
        return found

    def by_gaps(self, sample: int, rows: Array) -> tuple[Array, Array]:
        """Derivatives of the gaps of some rows in a sample by the coordinates and turning of the model, (nr, nq)."""
        normals = self.at(np.array([sample])).normals[0].T
        return self._by_places(sample, self.mean[rows].toarray()[:, :, None] * normals)

    def _by_places(self, sample: int, by_points: Array) -> tuple[Array, Array]:
        """Derivatives by coordinates and turning of the model in a sample, (k, nq), from those by points, (k, p, 3)."""
        motion, b = self._motion, self.body
        by_q, by_turning = np.zeros((2, len(by_points), motion.q.shape[1]))
        by_nodes = _applied(self._on_places.T, by_points)
        by_q[:, self.dofs] = np.einsum("kva,van->kn", by_nodes, self.shapes, optimize=True)
        if b >= 0:
            moved = self._shapes @ motion.q[sample, self.dofs[6:]] + self.growth @ motion.products[sample, b]
            turn = np.cross(moved, by_nodes).sum(axis=1)
            by_q[:, self.dofs[3:6]] += turn @ motion.frames.node_axes[b]
            by_q[:, self.dofs[:3]] = by_q[:, self.dofs[:3]] @ motion.axes[sample, b].T
            by_turning[:, self.dofs[3:6]] = motion.by_growth(
                sample, b, np.einsum("kva,vac->kc", by_nodes, self.growth, optimize=True)
            )
        return by_q, by_turning

    def on_nodes(self, along: Array, some: Array) -> Array:
        """Some rows on the values of its nodes that the flexibility has, (na, d k), by normals (p, 3)."""
        mean = self.mean[some]
        if not self.directed:
            return -np.asarray((mean @ self._of_nodes).toarray())
        rows = np.stack([(mean.multiply(along[:, a]).tocsr() @ self._of_nodes).toarray() for a in range(3)], axis=2)
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
        k, na, size = by_nodes.shape
        on_points = _applied(self._of_nodes, by_nodes.reshape(k * na, size // 3, 3))
        on_points = on_points.reshape(k, na, self._of_nodes.shape[0], 3)
        return np.asarray(np.einsum("ip,kipa->kpa", self.mean[some].toarray(), on_points, optimize=True))

    def by_anchor(self, sample: int, by_normals: Array) -> tuple[Array, Array]:
        """Derivatives by coordinates and turning in the sample of an anchor, from those by its normals, (k, p, 3)."""
        samples = np.array([sample])
        there, axis = self.at(samples), self.axes(samples)[0]
        normals = there.normals[0].T
        across = (
            by_normals
            - np.einsum("kpa,pa,pb->kpb", by_normals, normals, normals)
            - (by_normals @ axis)[:, :, None] * axis
        )
        by_q, by_turning = self._by_places(sample, across * there.curved[0][:, None])
        if self.body >= 0:  # in its axes, normals turn against it
            turn = np.cross(by_normals, normals).sum(axis=1)
            by_q[:, self.dofs[3:6]] += turn @ self._motion.frames.node_axes[self.body]
        return by_q, by_turning

    def at_start(self, anchors: Anchors | None, s: int) -> Array | None:
        """Normals at the anchor with which a run begins, (p, 3); None if there is none."""
        if anchors is None or not anchors.anchored[s]:
            return None
        along = anchors.along[self._points]
        return np.tile(along[0], (len(self._start), 1)) if self._flat else along


class SurfacesBack:
    """All such contacts of a run that was made.

    Parameters
    ----------
    contacts : FrozenPlan
    motion : FramesMotion or None
        Of all samples; None if nothing moves but frozen pairs.
    fresh : (n, ns) bool array
        See `loops.Samples`.
    anchors : Anchors or None
        With which the run began.
    """

    def __init__(
        self, contacts: FrozenPlan, motion: FramesMotion | None, fresh: Array, anchors: Anchors | None
    ) -> None:
        moving, self.surfaces = contacts.moving, list[SurfaceBack]()
        if moving is not None and motion is not None:
            self.surfaces = [SurfaceBack(moving, s, motion) for s in range(len(moving.rigid))]
        self._contacts, self._fresh, self._begins = contacts, fresh, anchors
        self._of_contact = {one.contact: s for s, one in enumerate(self.surfaces)}

    def rows(self, s: int) -> slice:
        """Rows of a contact among all."""
        return slice(*self._contacts.rows.starts[self.surfaces[s].contact :][:2])

    @cached_property
    def anchors(self) -> Array:
        """Samples in which each contact found the anchor that it has in a sample, (ns, n); -1 is the start."""
        n, count = len(self._fresh), len(self.surfaces)
        numbers = np.where(self._fresh[:, :count].T, np.arange(n), -1)
        return np.asarray(np.maximum.accumulate(numbers, axis=1)).reshape(count, n)

    def set_gaps(self, gaps: Array, samples: Array) -> None:
        """Set the gaps of the rows of these contacts among all, (m, nr) [m], in some samples, (m,)."""
        for s, one in enumerate(self.surfaces):
            gaps[:, self.rows(s)] = one.gaps(samples)

    @property
    def edges(self) -> Array:
        """Samples in which anchors are found, which are sorted."""
        return np.unique(self.anchors[self.anchors >= 0])

    def along(self, s: int, sample: int) -> Array:
        """Normals of a contact at the anchor that it has in a sample, (p, 3)."""
        one, anchor = self.surfaces[s], int(self.anchors[s, sample])
        before = one.at_start(self._begins, s) if anchor < 0 else None
        return one.at(np.array([max(anchor, 0)])).normals[0].T if before is None else before

    def set_flexibility(self, F: Array, sample: int, rows: Array, others: Array) -> None:
        """Set the flexibility between some rows and others, (na, nb) [m/N], where it is that of moving contacts."""
        for s, one in enumerate(self.surfaces):
            own, here = self._own(s, rows)
            pushing, there = self._own(s, others)
            along = self.along(s, sample)
            left = one.on_nodes(along, own)
            right = left if np.array_equal(own, pushing) else one.on_nodes(along, pushing)
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
    bodies : (c,) int array
        Numbers of the bodies among those in floating frames; -1 for others.
    arms, growth : (v, 3), (v, 3, 6) arrays
        See `SurfaceBack`.
    shapes : (v, 3, n_dofs) array
        Places of the nodes by these coordinates; in a floating frame as they are in a sample, see `turn`.
    axes : (ms, c, 3) array
        See `SurfaceBack.axes`.
    normals, curved, push : (ms, 3, p), (ms, p), (ms, p) arrays
        See `SurfaceBack.at`; forces on the points [N].
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
    bodies: Array
    arms: Array
    growth: Array
    shapes: Array
    axes: Array
    normals: Array
    curved: Array
    push: Array

    @classmethod
    def of(cls, some: SurfacesBack, samples: slice, rows: Array, lam: Array) -> SurfaceRows | None:
        """Those among rows, (nw,), with forces (m, nw) in some samples; None without any."""
        surfaces, n_dofs = some.surfaces, max((len(one.dofs) for one in some.surfaces), default=0)
        dofs = np.zeros((len(surfaces), n_dofs), dtype=np.int64)
        within = [_within(some.rows(s), rows) for s in range(len(surfaces))]
        closed = np.concatenate([np.zeros(0, dtype=np.int64), *(here for _, here in within)])
        there = np.flatnonzero(lam[:, closed].any(axis=1))
        if not len(there):
            return None
        place, axes = np.full(len(lam), -1), list[Array]()
        means, on_nodes = list[sp.csr_matrix](), list[sp.csr_matrix]()
        of_nodes, at, numbers = list[tuple[Array, ...]](), list[tuple[Array, Array, Array]](), samples.start + there
        place[there] = np.arange(len(there))
        for s, (one, (own, here)) in enumerate(zip(surfaces, within, strict=True)):
            dofs[s, : len(one.dofs)] = one.dofs
            mean, used, points, nodes = one.between(own)
            means.append(mean)
            on_nodes.append(points)
            shapes = np.zeros((len(nodes), 3, n_dofs))
            shapes[:, :, : len(one.dofs)] = one.shapes[nodes]
            of_nodes.append((one.arms[nodes], one.growth[nodes], shapes))
            axes.append(one.axes(numbers))
            at.append((*one.at(numbers, used), np.asarray(lam[np.ix_(there, here)] @ mean)))
        normals, curved, push = (_joined(parts, -1) for parts in zip(*at, strict=True))
        arms, growth, all_shapes = (_joined(parts, 0) for parts in zip(*of_nodes, strict=True))
        return cls(
            place, closed, *_flat(means), *_flat(on_nodes), _ends([mean.shape[1] for mean in means]),
            _ends([len(part[0]) for part in of_nodes]), np.array([len(one.dofs) for one in surfaces]), dofs,
            np.array([one.body for one in surfaces]), arms, growth, all_shapes,
            np.stack(axes, axis=1), normals, curved, push,
        )  # fmt: skip

    def _ways_of_nodes(self, contact: int, y: Array) -> Array:
        """Ways of the nodes of a contact, (k, v, 3), by those of the coordinates, (k, nq)."""
        n, (_, nodes) = self.counts[contact], self._own(contact)
        return np.asarray(np.einsum("van,kn->kva", self.shapes[nodes, :, :n], y[:, self.dofs[contact, :n]]))

    def _points(self, y: Array) -> Array:
        """Ways of the points, (k, p, 3), by those of the coordinates, (k, nq)."""
        ways = np.zeros((len(y), len(self.push[0]), 3))
        for contact in range(len(self.counts)):
            of_nodes = self._ways_of_nodes(contact, y)
            ways[:, self._own(contact)[0]] = np.einsum("pv,kva->kpa", self._on_nodes(contact), of_nodes)
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
        ways, there = self._points(y), self.place[s]
        if there >= 0:
            along = np.einsum("kpa,ap->kp", ways, self.normals[there])
            for row, (first, end) in zip(self.rows, _pairs(self.starts), strict=True):
                by_forces[:, row] += along[:, self.columns[first:end]] @ self.means[first:end]
        return ways

    def _by_nodes(self, s: int, contact: int, ways: Array, slips: Array) -> Array:
        """Derivatives by places of the nodes of a contact, (k, v, 3), by those by gaps, (k, d)."""
        there, (own, _) = self.place[s], self._own(contact)
        on_points = np.zeros(ways.shape[:2])
        for row, (first, end) in zip(self.rows, _pairs(self.starts), strict=True):
            on_points[:, self.columns[first:end]] += slips[:, row, None] * self.means[first:end]
        normals, share, axis = (
            self.normals[there, :, own].T,
            self.push[there] * self.curved[there],
            self.axes[there, contact],
        )
        way = ways[:, own]
        across = way - np.einsum("kpa,pa,pb->kpb", way, normals, normals) - (way @ axis)[:, :, None] * axis
        of_points = on_points[:, own, None] * normals + share[own, None] * across
        return np.asarray(np.einsum("kpa,pv->kva", of_points, self._on_nodes(contact)))

    def back(self, s: int, ways: Array, slips: Array, q: Array) -> None:
        """Add derivatives by the coordinates to q, (k, nq), by those by gaps, (k, d)."""
        if self.place[s] < 0:
            return
        for contact, n in enumerate(self.counts):
            shapes, by_nodes = self.shapes[self._own(contact)[1], :, :n], self._by_nodes(s, contact, ways, slips)
            q[:, self.dofs[contact, :n]] += np.einsum("kva,van->kn", by_nodes, shapes)

    def turn(self, frames: FramesBack, s: int, y: Array) -> None:
        """Set how contacts push bodies in floating frames in sample s: ways of coordinates by y, (k, nq), shapes.

        Also sets what the derivatives by coordinates, in bodies' axes, have of the masses on which forces act.
        """
        frames.pushed[:], frames.moved[:], frames.force[:] = y, 0.0, 0.0
        for contact, b in enumerate(self.bodies if self.place[s] >= 0 else ()):
            if b >= 0:
                n, (_, nodes) = self.counts[contact], self._own(contact)
                dofs, axes = self.dofs[contact, :n], frames.node_axes[b]
                moved = self.arms[nodes] + self.shapes[nodes, :, 6:n] @ frames.q[s, dofs[6:]]
                self.shapes[nodes, :, 3:6] = np.cross(axes.T, moved[:, None]).swapaxes(1, 2)
                forces = self._forces(s, contact)
                frames.force[dofs] += np.einsum("va,van->n", forces, self.shapes[nodes, :, :n])
        push_masses(frames, s, y)

    def _forces(self, s: int, contact: int) -> Array:
        """Forces on the nodes of a contact, (v, 3)."""
        there, (own, _) = self.place[s], self._own(contact)
        pushes = self.push[there, own, None] * self.normals[there, :, own].T
        return np.asarray(self._on_nodes(contact).T @ pushes)

    def turn_back(self, frames: FramesBack, s: int, ways: Array, slips: Array, q: Array) -> None:
        """Add derivatives by coordinates in bodies' axes, and what frames do that turn with forces, to q, (k, nq).

        `back` has added to `frames.moved` before.
        """
        moved = frames.moved
        for contact, b in enumerate(self.bodies if self.place[s] >= 0 else ()):
            if b < 0:
                continue
            n, (_, nodes) = self.counts[contact], self._own(contact)
            dofs, axes, growth = self.dofs[contact, :n], frames.node_axes[b], self.growth[nodes]
            forces, by_nodes = self._forces(s, contact), self._by_nodes(s, contact, ways, slips)
            of_nodes = self._ways_of_nodes(contact, frames.pushed) - frames.pushed[:, None, dofs[:3]]
            grown = growth @ frames.products[s, b]
            turn = (np.cross(of_nodes, forces) + np.cross(grown, by_nodes)).sum(axis=1)
            moved[:, dofs[3:6]] += turn @ axes
            pulled = np.cross(forces, (frames.pushed[:, dofs[3:6]] @ axes.T)[:, None])
            moved[:, dofs[6:]] += np.einsum("kva,van->kn", pulled, self.shapes[nodes, :, 6:n])
            by_products = np.einsum("kva,vac->kc", by_nodes, growth)
            frames.u[:, dofs[3:6]] += by_growth(frames.turning[s, dofs[3:6]], axes, frames.products[s, b], by_products)
        for b in range(len(frames.node_axes)):
            place = frames.body(b)[0][:3]
            moved[:, place] = moved[:, place] @ frames.axes[s, b].T
        q += moved


def _flat(parts: Sequence[sp.csr_matrix]) -> tuple[Array, Array, Array]:
    """Entries of matrices on a diagonal: starts of the lines, columns and values."""
    starts, columns, values, end, width = [np.zeros(1, dtype=np.int64)], list[Array](), list[Array](), 0, 0
    for part in parts:
        starts.append(part.indptr[1:] + end)
        columns.append(part.indices + width)
        values.append(part.data)
        end, width = end + part.nnz, width + part.shape[1]
    return np.concatenate(starts), np.concatenate(columns).astype(np.int64), np.concatenate(values)


def _compact(some: sp.csr_matrix) -> tuple[sp.csr_matrix, Array]:
    """A matrix without the columns that are empty, and the numbers of the others."""
    used = np.zeros(some.shape[1], dtype=bool)
    used[some.indices] = True
    columns = np.flatnonzero(used)
    places = np.cumsum(used) - 1
    return sp.csr_matrix((some.data, places[some.indices], some.indptr), (some.shape[0], len(columns))), columns


def _applied(matrix: sp.csr_matrix, values: Array) -> Array:
    """Apply a matrix, (p, v), to vectors at v places, (k, v, 3): (k, p, 3)."""
    (p, v), k = matrix.shape, len(values)
    found: Array = matrix @ values.transpose(1, 0, 2).reshape(v, 3 * k)
    return found.reshape(p, k, 3).transpose(1, 0, 2)


def _along(vectors: Array, axis: Array) -> Array:
    """What vectors, (m, 3, p), are along an axis, (3,)."""
    found: Array = axis[0] * vectors[:, 0] + axis[1] * vectors[:, 1] + axis[2] * vectors[:, 2]
    return found


def _joined(parts: Sequence[Array], axis: int) -> Array:
    """Arrays one after the other, in memory line by line; a single one is not copied if it is so already."""
    return np.ascontiguousarray(parts[0] if len(parts) == 1 else np.concatenate(parts, axis=axis))


def _ends(sizes: Sequence[int]) -> Array:
    return np.cumsum([0, *sizes])


def _pairs(starts: Array) -> Sequence[tuple[int, int]]:
    """First place and end of each part."""
    return [*zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True)]
