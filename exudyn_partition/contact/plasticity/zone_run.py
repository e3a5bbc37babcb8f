"""The plastic zone of a patch in a run: its present state, and how it moves the patch and the body.

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ...algebra.krylov import FreeBodyFlexibility, mass_normalised
from ...fe.model import node_dofs
from ...frames.kinematics import Kinematics
from ...plasticity.flow import PlasticState
from ...plasticity.zone import PlasticZone
from ...plasticity.zone_flexibility import ZoneFlexibility
from ...reduction.body import ReducedBody
from ...support.arrays import Array

if TYPE_CHECKING:
    from typing import Self

_NEAR = 0.3  # of the yield stress: points that lack less of flowing are looked at together with those that flow


@dataclass(frozen=True, eq=False)
class ZoneMotion:
    """A plastic zone in motion.

    Parameters
    ----------
    zone : PlasticZone
    flexibility : ZoneFlexibility or None
        Residual one; None if the zone's nodes are coordinates of the body (basis "free").
    kinematics : Kinematics
        Of the zone's nodes.
    start : PlasticState
        At the start of each run.
    """

    zone: PlasticZone
    flexibility: ZoneFlexibility | None
    kinematics: Kinematics
    start: PlasticState

    @classmethod
    def of(cls, kinematics: Kinematics, patch: int, state: PlasticState | None = None) -> ZoneMotion | None:
        """Zone of a patch of the body with these kinematics; None if nothing yields there."""
        body: ReducedBody = kinematics.body
        plastic = [number for number, one in enumerate(body.partition.patches) if one.plastic is not None]
        one = body.partition.patches[patch]
        region, material = one.plastic, one.material or body.material
        nodal = region is not None and np.isin(region.nodes, body.basis.nodal).all()
        if region is None or material is None or not (body.basis.zones or nodal):
            return None
        zone = PlasticZone(body.points, region, material)
        start = PlasticState.virgin(len(zone)) if state is None else state
        flexibility = body.basis.zones[plastic.index(patch)] if body.basis.zones else None
        return cls(zone, flexibility, kinematics.at(zone.nodes), start)

    def at_rest(self, state: PlasticState) -> Array:
        """Displacements of the zone's nodes in the body's axes by plastic strain alone, at rest, (nz, 3) [m]."""
        body, p = self.kinematics.body, self.zone.pseudo_forces(state.strain)
        rows = body.rows(self.zone.nodes)
        moved = np.asarray(rows @ deformed_at_rest(body, rows.T @ p))
        if self.flexibility is not None:
            moved += self.flexibility.own @ p
        return moved.reshape(-1, 3)


def deformed_at_rest(body: ReducedBody, force: Array) -> Array:
    """Coordinates of a body, (n_dofs,), that balanced forces on them, (n_dofs,), have deformed, at rest."""
    if not len(body.basis.nodal):
        elastic, found = body.basis.omega > 0, np.zeros(body.n_dofs)
        found[elastic] = force[elastic] / body.basis.omega[elastic] ** 2
        return found
    rigid = mass_normalised(body.rigid, body.mass)
    return FreeBodyFlexibility(body.stiffness, body.mass, rigid)(force[:, None])[:, 0]


class _Active:
    """Points of a zone that flow, have flowed or are near to it, and the nodes of their elements.

    Parameters
    ----------
    motion : ZoneMotion
    chosen : (g,) bool array
        The points.
    own : (3 nz, 3 nz) array
        Flexibility of the zone in the precision of the large products, which are what a step costs [m/N].

    Attributes
    ----------
    points : (k,) int array
    dofs : (m,) int array
        Displacements of their nodes, among those of the zone.
    across : (m, 3 nz) array
        Rows of `own`: between these and all nodes of the zone.
    of_patch : (m, r) array
        Flexibility between these and the rows of the patch [m/N].
    """

    def __init__(self, motion: ZoneMotion, chosen: Array, own: Array) -> None:
        self.points = np.flatnonzero(chosen)
        rows = motion.zone.strain[np.repeat(chosen, 6)]
        self.dofs = node_dofs(np.unique(rows.indices // 3))
        self._strain = rows[:, self.dofs]
        self._zone, self._force = motion.zone, sp.csr_matrix(self._strain.T)
        assert motion.flexibility is not None
        self.across: Array = own.take(self.dofs, axis=0)
        self._own = self.across.take(self.dofs, axis=1)
        self.of_patch = motion.flexibility.of_patch[self.dofs]
        self._rows = motion.kinematics.rows[self.dofs]

    def moved(self, q: Array, force: Array) -> Array:
        """Displacements of the nodes, (m,) [m], by the last coordinates and forces on the patch, (r,) [N]."""
        return np.asarray(self._rows @ q + self.of_patch @ force)

    def strains(self, moved: Array, p: Array) -> Array:
        """Deviatoric strains of the points, (k, 6): by displacements, (m,) [m], and by pseudo-forces p."""
        return np.asarray(self._strain @ (moved + self._own @ p.astype(self._own.dtype))).reshape(-1, 6)

    def push(self, p: Array) -> Array:
        """Displacements of all nodes of the zone, (3 nz,) [m], by pseudo-forces, (m,) [N]."""
        return np.asarray(p.astype(self.across.dtype) @ self.across)

    def generalised(self, p: Array) -> Array:
        """Forces on the last coordinates of the body, (n,), of pseudo-forces, (m,) [N]."""
        return np.asarray(self._rows.T @ p)

    def pseudo_forces(self, state: PlasticState) -> Array:
        """Pseudo-forces on these nodes, (m,) [N], of a state of these points."""
        return np.asarray(self._force @ self._zone.stress_volumes(state.strain, self.points).ravel())


class ZoneRun:
    """State of a plastic zone in a run.

    `committed` is the state at the end of the last accepted step. `present` is that of the step which is computed; it
    begins anew from `committed` with each evaluation.

    Attributes
    ----------
    zone : PlasticZone
    committed, present : PlasticState
    generalised : (n,) array
        Forces of the present pseudo-forces on the last coordinates of the body [N].
    work : float
        Plastic work since the start of the run, until now [J].
    """

    def __init__(self, motion: ZoneMotion) -> None:
        assert motion.flexibility is not None
        self.motion, self.zone, self.flexibility = motion, motion.zone, motion.flexibility
        self._own = self.flexibility.own
        # Von Mises stress is a norm: by the change of each coordinate and patch force it grows by no more than this.
        self._by_q, self._by_force = map(self._largest, (motion.kinematics.rows, self.flexibility.of_patch))
        self.reset()

    def _largest(self, columns: Array) -> Array:
        """Largest von Mises stress anywhere by each column of nodal displacements, (m,) [Pa]."""
        squares = np.asarray(self.zone.strain @ columns).reshape(len(self.zone), 6, -1) ** 2
        value: Array = self.zone.flow.of_strain(np.sqrt(squares.sum(axis=1).max(axis=0, initial=0.0)))
        return value

    def for_run(self, kind: type) -> Self:
        """Return the same zone in its start state, for another run with numbers of this dtype in large products."""
        result = copy.copy(self)
        result._own = self.flexibility.own.astype(kind, copy=False)
        result.reset()
        return result

    def reset(self) -> None:
        """Go back to the start."""
        self.work = self._committed_work = 0.0
        self.enter(self.motion.start)

    def enter(self, state: PlasticState) -> None:
        """Take a state as that of the end of an accepted step."""
        self.committed = state
        self._choose(state.equivalent > 0)
        self._at = self._committed_at = np.zeros(len(self._by_q)), np.zeros(len(self._by_force))
        self._margin, self._margin_at = -np.inf, self._at
        self._take(state, self._active.pseudo_forces(state.at(self._active.points)))
        self._hold()

    def _take(self, state: PlasticState, p: Array) -> None:
        """Enter a state with its pseudo-forces on the active nodes, (m,) [N]."""
        self.present, self._p = state, p
        self._moved = self._active.push(p)
        self.generalised = self._active.generalised(p)
        self._energy = self.zone.own_energy(state) - 0.5 * float(p @ self._moved[self._active.dofs])

    def _hold(self) -> None:
        """Take the present state as the committed one."""
        self._last = self._p, self._moved, self.generalised, self._energy
        self._step_before = np.zeros(len(self._p))
        self._moved_patch = self._p @ self._active.of_patch

    @property
    def flows(self) -> bool:
        """Whether points flow in the present state."""
        return self.present is not self.committed

    def commit(self) -> None:
        """Accept the present state."""
        if self.flows:
            step = self._p - self._last[0]
            self.committed = self.present
            self._hold()
            self._step_before, self._margin = step, -np.inf
        elif self._step_before.any():
            self._step_before = np.zeros(len(self._p))
        self._committed_at, self._committed_work = self._at, self.work

    def back(self) -> None:
        """Return to the committed state."""
        self.present, self.work = self.committed, self._committed_work
        self._p, self._moved, self.generalised, self._energy = self._last

    @property
    def guess(self) -> Array:
        """Pseudo-forces on the active nodes at the end of the step if they change as in the step before, (m,) [N]."""
        guess: Array = self._last[0] + self._step_before
        return guess

    def moved_patch(self, p: Array | None = None) -> Array:
        """Displacements of the patch's rows, (r,) [m], by pseudo-forces on active nodes; by the committed ones."""
        moved: Array = self._moved_patch if p is None else p @ self._active.of_patch
        return moved

    def stays_elastic(self, q: Array, force: Array) -> bool:
        """Whether no point yields at coordinates q, (n,), and forces on the patch, (r,) [N]: known without its strains.

        True is certain. False means that strains must be looked at.
        """
        self._at = q[len(q) - len(self._by_q) :].copy(), force
        by_q, by_force = (abs(now - then) for now, then in zip(self._at, self._margin_at, strict=True))
        return bool(self._margin >= by_q @ self._by_q + by_force @ self._by_force)

    def look(self) -> bool:
        """Whether points begin to flow at the coordinates and forces of `stays_elastic`, with the committed state."""
        excess = self._excess(self.committed)
        if excess.max() <= 0:
            self._margin, self._margin_at = -float(excess.max()), self._at
            return False
        self._include(excess)
        return True

    def answer(self, force: Array, p: Array) -> Array:
        """Pseudo-forces on the active nodes, (m,) [N], that follow from patch forces, (r,) [N], and pseudo-forces p."""
        self._at = self._at[0], force
        strain = self._active.strains(self._active.moved(*self._at), p)
        self._found = self.zone.flow.answer(strain, self.committed.at(self._active.points)), strain
        return self._active.pseudo_forces(self._found[0])

    def finish(self, p: Array) -> bool:
        """Enter the state that `answer` has found, with its pseudo-forces p. Whether no other point flows there.

        If one does, it is active from now on, and the answer must be found again.
        """
        active, (state, strain) = self._active, self._found
        self._take(self.committed.changed(active.points, state), p)
        excess = self._excess(self.present)
        excess[active.points] = -np.inf
        if excess.max() > 0:
            self._include(excess)
            return False
        before = active.strains(active.moved(*self._committed_at), self._last[0])
        work = self.zone.work((self.committed.at(active.points), before), (state, strain), active.points)
        self.work = self._committed_work + work
        return True

    def _excess(self, state: PlasticState) -> Array:
        """Von Mises stress beyond the flow stress, (g,) [Pa], with the present pseudo-forces."""
        q, force = self._at
        moved = self.motion.kinematics.rows @ q + self.flexibility.of_patch @ force + self._moved
        return self.zone.flow.excess(self.zone.flow.stress(self.zone.strains(moved), state), state)

    def _include(self, excess: Array) -> None:
        """Make points active that flow or are near to it, by their stress beyond the flow stress, (g,) [Pa]."""
        if not (excess[~self._chosen] > 0).any():
            return
        old, size = self._active.dofs, len(self._step_before)
        self._choose(self._chosen | (excess > -_NEAR * self.zone.flow.yield_stress))
        place = np.searchsorted(self._active.dofs, old)
        widened = np.zeros((2, len(self._active.dofs)))
        widened[:, place] = self._last[0], self._step_before[:size]
        self._last = widened[0], *self._last[1:]
        self._step_before = widened[1]

    def _choose(self, chosen: Array) -> None:
        self._chosen, self._active = chosen, _Active(self.motion, chosen, self._own)

    def stored(self) -> float:
        """Elastic energy that plastic strain adds, besides that of patch forces [J]."""
        return self._energy - float(self.generalised @ self._at[0])
