"""What a contact answers at some coordinates: the forces on its rows and all that follows from them, as one value."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..algebra.coulomb import Coulomb
from ..algebra.friction import SLIP
from ..algebra.products import Solved, dense
from ..errors import InputError, RunError
from ..frames.kinematics import Rows
from ..support.arrays import Array
from ..support.attributes import FoundOnce
from .law import Forces, Law, Places, Slope
from .memory import RowMemory
from .normal_rows import NormalRows
from .plasticity.yielding_patches import Zones, ZonesAnswer
from .row_forces import RowForces
from .state import ContactState
from .tangential import TangentialRows
from .viscosity import Creep, ViscousMemory, Yielding

_HELD = 0.75  # share of closed rows: if no more slip, those that stick hold the contact
_LEAST_WAY = 1e-3  # of the longest: secants count no shorter ones, which may be zero


@dataclass(frozen=True, eq=False)
class ContactParts:
    """What a contact consists of in a run.

    Parameters
    ----------
    rows : NormalRows or TangentialRows
        Present rows with d = 1 direction each, with friction d = 3.
    law : Law
    friction : Coulomb or None
    zones : YieldingPatches or NodalZones or None
        Plastic zones beneath the patches. Any law can have them.
    betas : tuple of float or None
        Times with which the residual flexibilities of the sides yield [s], see `viscosity`; None if all yield at once.
    """

    rows: NormalRows | TangentialRows
    law: Law
    friction: Coulomb | None
    zones: Zones | None
    betas: tuple[float, ...] | None

    @property
    def viscous(self) -> bool:
        """Whether a residual flexibility yields with time, see `viscosity`."""
        return self.betas is not None

    @FoundOnce
    def elastic(self) -> bool:
        """Whether forces follow from the coordinates alone and have a potential."""
        return self.law.elastic and not self.remembers and not self.law.ahead

    @FoundOnce
    def remembers(self) -> bool:
        """Whether forces within steps depend on those of earlier steps."""
        by_law = self.law.memory > 0 or (self.friction is not None and not self.law.ahead)
        return by_law or self.zones is not None or self.viscous

    @property
    def flows(self) -> bool:
        """Whether a contact yields, so that its forces depend on more than places and friction."""
        return self.zones is not None or not self.law.elastic

    @FoundOnce
    def damped(self) -> bool:
        """Whether a viscous flexibility or the law itself may take energy."""
        return self.viscous or not (self.law.elastic or self.law.ahead)


class Evaluation(RowForces):
    """Answer of a contact at some coordinates. It does not change.

    Parameters
    ----------
    parts : ContactParts
    state : ContactState
        At the end of the last accepted step, from which the answer follows.
    since : float
        Start of the present step [s].
    forces : Forces
        On the present rows.
    h : (nr,) array
        Gaps [m], with displacements by zones, and without those by other contacts.
    least_gap : float
        Smallest gap of the present rows, without the deformation by the contact's own flexibility [m].
    places : Places, optional
        Places of the rows for which the law found the forces; None if all are open.
    yielding : Yielding, optional
        How viscous flexibilities yield in this step.
    plastic : ZonesAnswer, optional
        What plastic zones do in it.
    opening : float
        How much of an overlap that is meant is still open [m].
    begun : bool
        Whether these are the forces of `state` itself, with which a run begins.
    """

    _way: Array | None = None  # see `Places`; without friction, nobody asks
    _last: Array | None = None
    _across: list[Array] | None = None  # displacements of viscous sides by the elastic forces of other contacts [m]
    _across_before: list[Array] | None = None  # the same at the end of the last accepted step

    def __init__(
        self,
        parts: ContactParts,
        state: ContactState,
        since: float,
        forces: Forces,
        h: Array,
        least_gap: float,
        *,
        places: Places | None = None,
        yielding: Yielding | None = None,
        plastic: ZonesAnswer | None = None,
        opening: float = 0.0,
        begun: bool = False,
    ) -> None:
        super().__init__(parts.rows, forces)
        self.parts, self.state, self.since, self.h, self.least_gap = parts, state, since, h, least_gap
        if places is not None and parts.friction is not None:
            self._way, self._last = places.way, places.last
        self._yielding, self.plastic = yielding, plastic
        self.opening, self.begun = opening, begun

    def pushed_by(self, across: list[Array], before: list[Array] | None) -> Evaluation:
        """Return the same answer with displacements of viscous sides by other contacts, now and in the last step."""
        return self._with(_across=across, _across_before=before)

    def in_step(self, state: ContactState, since: float) -> Evaluation:
        """Return the same answer in a step that begins at a time [s] from a state."""
        return self._with(state=state, since=since, begun=False)

    def with_zones(self, plastic: ZonesAnswer) -> Evaluation:
        """Return the same answer with what plastic zones do."""
        return self._with(plastic=plastic)

    def _with(self, **changes: Any) -> Evaluation:
        result = object.__new__(Evaluation)
        vars(result).update(vars(self), **changes)
        for derived in ("generalised", "stored", "_creep"):
            vars(result).pop(derived, None)
        return result

    # Forces.

    @property
    def slips(self) -> Array:
        """How far the present rows have slipped since the last accepted step, (nr, 2) [m]."""
        slips = self.forces.slips
        return np.zeros((len(self.on_rows), 2)) if slips is None else slips

    @property
    def pushes(self) -> bool:
        """Whether rows are closed, or zones may push."""
        return self.index.size > 0 or self.plastic is not None

    @FoundOnce
    def generalised(self) -> Array:
        """Generalised forces, (n,), by rows and zones."""
        return self.by_rows if self.plastic is None else self.plastic.generalised(self.by_rows)

    def edge_reached(self) -> Array | None:
        """Place of a row with which contact leaves its patch, (3,) [m]; None if there is none. Pulls do not count."""
        law, rows = self.parts.law, self._present.stage.rows
        if not rows.at_edge:
            return None
        closed = self.index[self.lam[self.index] > 0.0] if law.reach else self.index
        if not closed.size:
            return None
        leaves_at = rows.leaves_at[closed]
        # Closed rows without a flexibility of their own have no depth that would tell how far contact reaches.
        reached = -self.h[closed] >= leaves_at if law.compliant else np.isfinite(leaves_at)
        leaving = closed[reached | (leaves_at == 0.0)]
        if not len(leaving):
            return None
        gaps = self._there().gaps
        value: Array = gaps.centre + gaps.present.places[0][rows.row_nodes[leaving[0]]]
        return value

    # Stiffness.

    def row_jacobian(self) -> Rows:
        """Derivative of the places of closed rows with respect to the coordinates, (d na, n)."""
        return self._there().jacobian(self.index)

    def row_carrier(self) -> Array:
        """Derivative of the rates of closed rows with respect to the velocities of a surface's carrier, (d na, 6)."""
        return self._there().carrier_rows(self.index)

    def row_stiffness(self) -> Array:
        """Minus the derivative of forces on closed rows with respect to their places, (d na, d na) [N/m]."""
        return dense(self._slope()) if self.index.size else np.zeros((0, 0))

    def _slope(self) -> Slope:
        if self.forces.stiffness is None:
            raise NotImplementedError(
                f"{type(self.parts.law).__name__} answers without `stiffness`, which implicit and static runs need, "
                "see `contact.law.Forces`"
            )
        return self._of_closed_rows("stiffness", self.forces.stiffness)

    def _of_closed_rows(self, name: str, find: Callable[[], Slope]) -> Slope:
        """Return a slope that the law gives; raises InputError if it is not one of the closed rows."""
        n, law = self.index.size * self.rows.d, type(self.parts.law).__name__
        if not callable(find):
            raise InputError(
                f"law {law}: expected a function without arguments as `{name}`, got {type(find).__name__}; write "
                f"{name}=lambda: ..."
            )
        slope = find()
        if not isinstance(slope, Solved) and np.shape(slope) != (n, n):
            raise InputError(
                f"law {law}: expected a {name} of shape {(n, n)}, of the closed rows alone, got {np.shape(slope)}"
            )
        return slope

    def tangent(self) -> Array:
        """Contact stiffness -d force / d q, (n, n), of closed rows, for fixed pairs."""
        if not self.index.size or self.parts.law.ahead:
            return np.zeros((self.rows.gaps.n,) * 2)
        return self.stiffness_along(self.row_jacobian())

    def stiffness_along(self, H: Rows) -> Array:
        """Stiffness H' K H, (m, m), where K is `row_stiffness` and H, (d na, m), are ways of closed rows."""
        return dense(H.T @ (self._slope() @ H))

    def damping(self) -> Array | None:
        """Minus the derivative of forces on closed rows with respect to their rates, (d na, d na) [N s/m], or None."""
        if self.forces.damping is None or not self.index.size:
            return None
        return dense(self._of_closed_rows("damping", self.forces.damping))

    def slip_secants(self, H: Array) -> Array:
        """Stiffness, (m, m), if friction opposed slips in proportion to the ways of rows; zero where many rows stick.

        `H`, (d na, m), is the derivative of the places of closed rows.
        """
        slipping = np.flatnonzero(self.status[self.index] == SLIP)
        K = np.zeros((H.shape[1],) * 2)
        if self._way is None or len(slipping) <= _HELD * len(self.index):
            return K
        rows = self.index[slipping]
        forces, ways = self.on_rows[rows, 1:], np.hypot(*self._way[rows].T)
        size = np.hypot(*forces.T)
        some = (size > 0.0) & (ways > 0.0)
        directions = forces[some] / size[some, None]
        along = np.einsum("it,itm->im", directions, H.reshape(-1, 3, len(K))[slipping[some], 1:])
        secants = size[some] / np.maximum(ways[some], _LEAST_WAY * ways.max())
        return np.asarray(along.T @ (secants[:, None] * along))

    # Energy.

    @FoundOnce
    def stored(self) -> float:
        """Energy that the contact stores [J]."""
        if self.begun:
            return self.state.stored
        rows = 0.0
        if self._yielding is not None:
            rows = self._creep.stored
        elif self.index.size and not self.parts.law.ahead:
            rows = self.forces.energy(self.h)
        return rows if self.plastic is None else rows + self.plastic.stored

    @property
    def viscous_work(self) -> float:
        """Energy that the viscosity of the flexibilities has dissipated since the start of the run [J]."""
        taken = self.state.creep.dissipated
        return taken if self.begun or self._yielding is None else taken + self._creep.taken

    def law_work(self, end: float) -> float:
        """Energy that the law itself has dissipated since the start of the run [J], if the step ends at time `end` [s].

        Its power is integrated by the trapezoidal rule. Ahead of the first step it has taken nothing.
        """
        step, taken = end - self.since, self.state.dissipated
        if self.begun or not math.isfinite(step):
            return taken
        return taken + self.forces.taken + 0.5 * step * (self.state.power + self.forces.power)

    @property
    def dissipated(self) -> float:
        """Energy that friction has dissipated since the start of the run [J]."""
        within = not self.begun and self.parts.friction is not None and not self.parts.law.ahead
        return self.state.memory.dissipated + (self._sliding[1] if within and self.index.size else 0.0)

    @FoundOnce
    def _sliding(self) -> tuple[Array, float]:
        """Slip of the rows since the last accepted step, (nr, 2) [m], and the energy that it dissipates [J].

        The energy is found by the trapezoidal rule. The force at the end of the step alone would give too much or too
        little.
        """
        slips = self.forces.slips
        if slips is None or self._last is None:
            raise RunError(
                f"law {type(self.parts.law).__name__}: with friction, its answers need `slips`, how far the rows "
                "have slipped since the last accepted step, see `contact.law.Forces`"
            )
        return slips, -0.5 * float(np.vdot(slips, (self._last + self.on_rows)[:, 1:]))

    # Viscous flexibilities.

    @FoundOnce
    def _creep(self) -> Creep:
        """State of viscous flexibilities."""
        assert self._yielding is not None
        self._there()
        return self._yielding.creep(self.on_rows, self._across, self._across_before)

    def carried(self) -> list[Array]:
        """Forces that each side carries elastically, (nr, d) [N]."""
        if self._yielding is None:
            return [self.on_rows] * len(self.rows.gaps.sides)
        return self._yielding.elastic(self.on_rows)

    # State.

    @property
    def adds_to_state(self) -> bool:
        """Whether a step that ends with this answer may change more of the state than where the rows are."""
        open_then = not (self.index.size or self.state.memory.closed) and self.opening == self.state.opening
        return not open_then or self.plastic is not None or self.parts.damped

    def after(self, end: float) -> ContactState:
        """State after a step that ends at time `end` [s] with this answer."""
        if self.parts.remembers and end <= self.since:  # the answer belongs to the start of a step
            return self.state
        self._there()
        return ContactState(
            self.rows.gaps.after(),
            self._memory_after(end - self.since),
            self.creep_after,
            () if self.plastic is None else self.plastic.after,
            self.opening,
            power=self.forces.power,
            dissipated=self.law_work(end),
            law=self._law_memory_after,
        )

    @property
    def _law_memory_after(self) -> Array:
        """What the law remembers of the slave's nodes after this answer, (np, k)."""
        if self.forces.memory is None:
            return self.state.law
        remembered = self.state.law.copy()
        remembered[self.row_nodes] = self.forces.memory
        return remembered

    def _memory_after(self, step: float) -> RowMemory:
        """What rows remember of this answer after a step [s]."""
        memory = self.state.memory
        if self.parts.law.ahead or self.parts.friction is None:
            return memory.with_forces(self.at_nodes(len(memory.path)))
        closed = self.index.size > 0
        if not (closed or memory.closed):
            return memory
        slips, taken = self._sliding if closed else (np.zeros((len(self.on_rows), 2)), 0.0)
        return self.memory_after(memory, slips, np.hypot(*slips.T) / step, taken)

    @property
    def creep_after(self) -> ViscousMemory:
        """What viscous flexibilities remember of this answer."""
        memory = self.state.creep
        if self._yielding is None or not (self.index.size or memory.elastic):
            return memory
        creep, n = self._creep, len(self.state.memory.path)
        return memory.after(self._there(), self.on_rows, creep.elastic, n, creep.taken)
