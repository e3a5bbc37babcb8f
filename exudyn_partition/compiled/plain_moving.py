"""What `moving_kernels` does, by NumPy, for those who have no numba and where compiled loops give up."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..algebra.block_complementarity import BlockComplementarity, FlatBlocks
from ..algebra.complementarity import Complementarity
from ..errors import ComplementarityError
from ..frames import loops
from ..frames.inertia_forces import TERMS, InertiaForces
from ..frames.kinematics import node_fields
from ..frames.rotations import composed, rotation_matrix
from ..reduction.inertia import PAIRS, InertiaIntegrals
from ..support.arrays import Array
from .moving import Frames, MovingPlan, MovingState, Surfaces
from .pair_rows import PairRows
from .plan import Bodies, FrozenPlan, Motion

_FIRST, _SECOND = np.array(PAIRS).T
_PASSES = 100


class PlainBody:
    """A body in a floating frame.

    Parameters
    ----------
    frames : Frames
    b : int
        Its number.
    bodies : Bodies or None
        Stiffness is that of these; None if only contacts are evaluated.
    """

    def __init__(self, frames: Frames, b: int) -> None:
        self.dofs, self.b, self._frames = frames.dofs[slice(*frames.places[b : b + 2])], b, frames
        n = len(self.dofs) - 6
        integrals = frames.numbers[frames.integrals[b] :][: 6 * (n + 1) ** 2].reshape(6, n + 1, n + 1)
        cross = frames.numbers[frames.cross[b] :][: 3 * n * n].reshape(3, n, n)
        self.inertia = InertiaIntegrals(integrals.copy(), cross.copy())
        self.terms = tuple(term for term in TERMS if term != "coupling" or frames.coupled[b])
        self.rotation, self.node_axes = frames.rotation[b], frames.node_axes[b]

    def grow(self, state: MovingState, v: Array) -> None:
        """Set by what products of angular velocities it grows at the model's velocities."""
        frames, b = self._frames, self.b
        of_node = v[self.dofs[3:6]]
        omega = self.node_axes @ of_node
        products = omega[_FIRST] * omega[_SECOND]
        fast, large = (
            not of_node @ of_node <= frames.slow[b],
            not abs(products) @ frames.largest[b] <= frames.least[b],
        )
        state.grows[b] = fast and large
        state.products[b] = products if state.grows[b] else 0.0

    def turn_on(self, m: Motion, h: float) -> None:
        """Compose its rotation with that of a step."""
        rotation = self.dofs[3:6]
        m.q[rotation] = composed(self.rotation + m.q_start[rotation], h * m.v[rotation]) - self.rotation

    def inertia_force(self, bodies: Bodies, m: Motion, half_step: float) -> Array:
        """Inertia forces on all but the translations, (3 + n,); for the arguments see `add_inertia`."""
        own, modes = self.dofs[3:], self.dofs[6:]
        z, v, stiffness = m.q[modes], m.v[own], bodies.stiffness[modes]
        if not v.any():
            return np.zeros(len(v))
        forces = InertiaForces(self.inertia, stiffness.__mul__, self.terms)
        if half_step > 0.0:
            v = forces.end_velocities(v, z - m.q_start[modes], m.v_start[own], m.a[own], half_step)
        return forces.force(v[:3], z, v[3:])

    def act(self, q: Array, force: Array) -> None:
        """Replace forces of contacts, (nq,), by those on the constant mass."""
        pushed = force[self.dofs]
        if pushed.any() and not self._frames.constant[self.b]:
            force[self.dofs] = loops.on_constant_mass(self.inertia, q[self.dofs[6:]], pushed)


class PlainSurface:
    """A contact with a rigid surface whose rows follow the motion.

    Parameters
    ----------
    surfaces : Surfaces
    s : int
        Its number.
    body : PlainBody or None
        Its body; None if that is in an inertial frame.
    """

    def __init__(self, surfaces: Surfaces, s: int, body: PlainBody | None) -> None:
        k, p, m, nr, n, d, n_fields = surfaces.sizes[s].tolist()
        self.contact, self.s, self.body, self.d = int(surfaces.contact[s]), s, body, d
        self.dofs, self.points = surfaces.dofs[slice(*surfaces.places[s : s + 2])], slice(*surfaces.firsts[s : s + 2])

        def matrix(name: str, rows: int, columns: int) -> Array:
            return surfaces.numbers[getattr(surfaces, name)[s] :][: rows * columns].reshape(rows, columns)

        self.start, self.arms = matrix("start", k, 3), matrix("arms", k, 3)
        self.rows_on_nodes, self._axes = matrix("rows", 3 * k, n), surfaces.axes[s]
        self.growth = matrix("growth", 3 * k, 6) if surfaces.growth[s] >= 0 else None
        self.flexibility, self.node_fields = matrix("flexibility", d * k, d * k), matrix("fields", d * k, n_fields)
        nodes, weights = surfaces.indices[surfaces.nodes[s] :][: p * m], matrix("weights", p, m).ravel()
        self.sparse_on_points = sp.csr_matrix((weights, nodes, np.arange(0, p * m + 1, m)), (p, k))
        begins = surfaces.indices[surfaces.begins[s] :][: nr + 1]
        columns, mean = surfaces.indices[surfaces.columns[s] :], surfaces.numbers[surfaces.mean[s] :]
        self.sparse_mean = sp.csr_matrix((mean[: begins[-1]], columns[: begins[-1]], begins), (nr, p))
        self.surface = surfaces.kind[s], surfaces.point[s], surfaces.axis[s], surfaces.radius[s], surfaces.sign[s]

    @cached_property
    def on_points(self) -> Array:
        """Values at its points by those of its nodes, (p, k)."""
        return np.asarray(self.sparse_on_points.toarray())

    @cached_property
    def mean(self) -> Array:
        """Its rows by its points, (nr, p)."""
        return np.asarray(self.sparse_mean.toarray())

    def gaps(self, state: MovingState, q: Array) -> Array:
        """Gaps of its rows, (nr,) [m]; sets the normals at its points."""
        gap, _, state.normals[self.points] = self.placed(state, q)
        return gap

    def placed(self, state: MovingState, q: Array) -> tuple[Array, Array, Array]:
        """Gaps of its rows, (nr,) [m], places of its points and normals there, (p, 3) [m]."""
        q_s, start, arms = q[self.dofs], self.start, self.arms
        if self.body is None:
            x = loops.moved_places(start, self.rows_on_nodes, q_s)
        else:
            if state.grows[self.body.b] and self.growth is not None:
                grown = node_fields(self.growth, state.products[self.body.b])
                start, arms = start + grown @ self._axes.T, arms + grown
            x = loops.places(q_s, start, self.body.rotation, self.body.node_axes, arms, self.rows_on_nodes)
        kind, point, axis, radius, sign = self.surface
        on_points = self.on_points @ x
        arm = on_points - point
        along = arm @ axis
        if kind == 0:
            gap, normals = along, np.tile(axis, (len(arm), 1))
        else:
            arm = arm - along[:, None] * axis
            distance = np.sqrt(np.einsum("pa,pa->p", arm, arm))
            gap = sign * (distance - radius)
            normals = sign * arm / np.maximum(distance, 1e-300)[:, None]
        return np.asarray(self.mean @ gap), on_points, normals

    def body_axes(self, q: Array) -> Array:
        """Axes of its body in space, as columns, (3, 3)."""
        if self.body is None:
            return np.eye(3)
        return np.asarray(rotation_matrix(self.body.rotation + q[self.dofs[3:6]]) @ self.body.node_axes.T)

    def anchor(self, blocks: FlatBlocks, state: MovingState, q: Array, same: float) -> bool:
        """See `anchor_surface`."""
        s, here = self.s, state.normals[self.points]
        far = not state.anchored[s]
        if self.d > 1:
            here = here @ self.body_axes(q)
            far = far or not abs(here - state.along[self.points]).max() <= same
        if far:
            state.anchored[s], state.fresh[s], state.found[s], state.anchors[s] = True, True, False, q
            state.growing[s, :6] = 0.0 if self.body is None else state.products[self.body.b]
            if self.d > 1:
                state.along[self.points] = here
        if state.found[s]:
            return False
        j, nr, k = self.contact, len(self.mean), len(self.start)
        along = state.along[self.points] if self.d > 1 else np.full((len(self.on_points), 1), -1.0)
        rows = np.einsum("rp,pk,pa->rka", self.mean, self.on_points, along).reshape(nr, self.d * k)
        own = rows @ self.flexibility @ rows.T
        self.own(blocks)[:], state.diagonal[self.rows(blocks)] = 0.5 * (own + own.T), own.diagonal()
        n_fields = self.node_fields.shape[1]
        blocks.numbers[blocks.fields[j] :][: n_fields * nr] = (rows @ self.node_fields).T.ravel()
        state.found[s], blocks.n_closed[j], state.added[s] = True, -1, -1.0
        return True

    def rows(self, blocks: FlatBlocks) -> slice:
        """Its rows among all."""
        return slice(*blocks.starts[self.contact : self.contact + 2])

    def own(self, blocks: FlatBlocks) -> Array:
        """Its flexibility, (nr, nr), regularised; a view."""
        nr = len(self.mean)
        return blocks.numbers[blocks.own[self.contact] :][: nr * nr].reshape(nr, nr)

    def fields(self, blocks: FlatBlocks) -> Array:
        """Its fields, (nr, m)."""
        n_fields, nr = self.node_fields.shape[1], len(self.mean)
        return blocks.numbers[blocks.fields[self.contact] :][: n_fields * nr].reshape(n_fields, nr).T

    def regularise(self, blocks: FlatBlocks, state: MovingState, gap: Array, bulge: float, share: float) -> None:
        """See `moving_kernels.regularise_rows`."""
        rows = self.rows(blocks)
        near, diagonal = gap < -bulge * gap.min(), state.diagonal[rows]
        state.near[rows] = near
        added = share * diagonal[near].sum() / max(np.count_nonzero(near), 1)
        if added != state.added[self.s]:
            state.added[self.s], blocks.n_closed[self.contact] = added, -1
            np.fill_diagonal(self.own(blocks), diagonal + added)

    def push(self, state: MovingState, q: Array, lam: Array, force: Array, values: Array) -> None:
        """See `forces_of_surface`."""
        pushes = (self.mean.T @ lam)[:, None] * state.normals[self.points]
        values[2:5] = pushes.sum(axis=0)
        self.act(q, pushes, force)

    def act(self, q: Array, pushes: Array, force: Array) -> None:
        """Add the generalised forces of forces on its points, (p, 3) [N]."""
        on_nodes = np.ascontiguousarray(self.on_points.T @ pushes)
        if self.body is None:
            force[self.dofs] += loops.on_shapes(self.rows_on_nodes, on_nodes)
        else:
            frame = self.body.rotation, self.body.node_axes
            force[self.dofs] += loops.generalised(q[self.dofs], *frame, self.arms, self.rows_on_nodes, on_nodes)


class PlainPair:
    """A contact of two bodies whose rows follow facets, as `PlainMoving` takes it.

    Parameters
    ----------
    rows : PairRows
    """

    def __init__(self, rows: PairRows) -> None:
        self._rows, self.contact, self.s = rows, rows.contact, rows.s

    def anchor(self, blocks: FlatBlocks, state: MovingState, q: Array, same: float) -> bool:
        """See `anchor_pair`."""
        return self._rows.anchor(same)

    def rows(self, blocks: FlatBlocks) -> slice:
        """Its rows among all."""
        return slice(*blocks.starts[self.contact : self.contact + 2])

    def own(self, blocks: FlatBlocks) -> Array:
        """Its flexibility, (nr, nr), regularised; a view."""
        return self._rows.own

    def fields(self, blocks: FlatBlocks) -> Array:
        """Its fields, (nr, m)."""
        return self._rows.fields.T

    def regularise(self, blocks: FlatBlocks, state: MovingState, gap: Array, bulge: float, share: float) -> None:
        """See `regularise_rows`."""
        self._rows.regularise(gap, bulge, share)

    def push(self, state: MovingState, q: Array, lam: Array, force: Array, values: Array) -> None:
        """See `forces_of_pairs`."""
        self._rows.push(lam, force, values)


class PlainMoving:
    """Moving contacts and bodies of a plan.

    Parameters
    ----------
    plan : MovingPlan
    state : MovingState
        Of a run, which this writes to.
    blocks : FlatBlocks
        Of the run.
    pairs : sequence of PairRows
        Contacts of two bodies.
    """

    def __init__(
        self, plan: MovingPlan, state: MovingState, blocks: FlatBlocks, pairs: Sequence[PairRows] = ()
    ) -> None:
        self._plan, self._state, self._blocks = plan, state, blocks
        self.bodies = [PlainBody(plan.frames, b) for b in range(len(plan.frames.rotation))]
        of_contacts = enumerate(plan.surfaces.body.tolist())
        self._rigid = [PlainSurface(plan.surfaces, s, self.bodies[b] if b >= 0 else None) for s, b in of_contacts]
        self._pairs = pairs
        self.surfaces: list[PlainSurface | PlainPair] = [*self._rigid, *map(PlainPair, pairs)]

    def gaps(self, m: Motion, v: Array, h: Array) -> None:
        """Set the gaps of moving rows among those of all, (nr,) [m], with bodies that grow as they turn at v, (nq,)."""
        for body in self.bodies:
            body.grow(self._state, v)
        for surface in self._rigid:
            h[surface.rows(self._blocks)] = surface.gaps(self._state, m.q)
        for pair in self._pairs:
            pair.gaps_at(m.q, m.q_start, v, h)

    def find(
        self, m: Motion, v: Array, h: Array, joint: BlockComplementarity, plan: FrozenPlan
    ) -> tuple[Array, Array, Array]:
        """Set the gaps as `gaps` does, and return what `settle` does, with all rows that may close."""
        taken = np.zeros(len(plan.own), dtype=np.int64)
        while True:
            self.gaps(m, v, h)
            lam, pushed, iterations = self.settle(m.q, h, joint, plan)
            taken += iterations
            if not any([pair.lacks_rows(lam, h, pushed) for pair in self._pairs]):
                return lam, pushed, taken

    def settle(self, q: Array, h: Array, joint: BlockComplementarity, plan: FrozenPlan) -> tuple[Array, Array, Array]:
        """Forces on all rows, (nr,) [N], gaps with displacements by other contacts, (nr,) [m], and iterations, (n,).

        `plan` has the contacts with frozen pairs, and `joint` is its solver in this run.

        Raises
        ------
        ComplementarityError
            If no closed rows settle.
        """
        blocks, state, (bulge, same, share) = self._blocks, self._state, self._plan.bounds
        ends = blocks.starts[1:-1]
        gaps, state.near[:] = np.split(h, ends), False
        iterations = np.zeros(len(gaps), dtype=np.int64)
        pushed, pressing, chosen = [*gaps], {j for j, gap in enumerate(gaps) if gap.min(initial=0.0) < 0.0}, set[int]()
        sources = {j: {k for i, k in plan.core if i == j} for j in range(len(gaps))}
        for surface in self.surfaces:
            if surface.contact in pressing:
                surface.anchor(blocks, state, q, same)
                surface.regularise(blocks, state, gaps[surface.contact], bulge, share)
        for _ in range(_PASSES):
            for surface in self.surfaces:
                j = surface.contact
                if sources[j] & pressing and surface.anchor(blocks, state, q, same):
                    surface.regularise(blocks, state, pushed[j] if j in chosen else gaps[j], bulge, share)
            lam, pushed = self._solved(gaps, joint, plan, pressing, iterations)
            before = {*pressing}
            pressing |= {j for j, forces in enumerate(lam) if forces.any()}
            again = pressing != before
            for surface in self.surfaces:
                j = surface.contact
                if (pushed[j][~state.near[surface.rows(blocks)]] < 0.0).any():
                    again = True
                    chosen.add(j)
                    pressing.add(j)
                    surface.anchor(blocks, state, q, same)
                    surface.regularise(blocks, state, pushed[j], bulge, share)
            if not again:
                return np.concatenate(lam), np.concatenate(pushed), iterations
        raise ComplementarityError(f"the rows that close in {len(gaps)} contacts did not settle in {_PASSES} passes")

    def _solved(
        self, gaps: list[Array], joint: BlockComplementarity, plan: FrozenPlan, pressing: set[int], iterations: Array
    ) -> tuple[list[Array], list[Array]]:
        """Forces and gaps of each contact with the present flexibilities; adds to the iterations of each."""
        if not pressing:
            return [np.zeros(len(gap)) for gap in gaps], [*gaps]
        blocks, of_moving = self._blocks, {surface.contact: surface for surface in self.surfaces}
        known = [j for j in range(len(gaps)) if j not in of_moving or self._state.found[of_moving[j].s]]
        own = {j: of_moving[j].own(blocks).copy() if j in of_moving else plan.own[j] for j in known}
        fields = {j: of_moving[j].fields(blocks) if j in of_moving else plan.fields[j] for j in known}
        problems = {j: Complementarity(own[j]) for j in known}
        if plan.core:
            found = joint.solve(problems, {j: gaps[j] for j in known}, fields)
            moved = joint.pushed
        else:
            found, moved = {j: problem.solve(gaps[j]) for j, problem in problems.items()}, {}
        iterations[known] += [problems[j].iterations for j in known]
        lam = [found.get(j, np.zeros(len(gap))) for j, gap in enumerate(gaps)]
        return lam, [moved.get(j, gap) for j, gap in enumerate(gaps)]

    def push(self, q: Array, lam: Array, force: Array, values: Array) -> None:
        """Add generalised forces, (nq,), of moving contacts, and set their resultants in values, (nc, 6)."""
        for surface in self.surfaces:
            surface.push(self._state, q, lam[surface.rows(self._blocks)], force, values[surface.contact])

    def act(self, q: Array, force: Array) -> None:
        """Replace forces of contacts, (nq,), by those on the constant masses."""
        for body in self.bodies:
            body.act(q, force)

    def turn_on(self, m: Motion, h: float) -> None:
        """Compose rotations in a step of length h [s]."""
        for body in self.bodies:
            body.turn_on(m, h)

    def inertia(self, bodies: Bodies, m: Motion, half_step: float) -> None:
        """Add inertia forces to those of contacts, see `add_inertia`."""
        for body in self.bodies:
            m.force[body.dofs[3:]] += body.inertia_force(bodies, m, half_step)

    def turn_accelerations(self, bodies: Bodies, m: Motion) -> None:
        """Set the angular accelerations, whose inertia is no diagonal."""
        for body in self.bodies:
            rotation = body.dofs[3:6]
            m.a[rotation] = self._plan.frames.inverse[body.b] @ (m.force + bodies.load)[rotation]
