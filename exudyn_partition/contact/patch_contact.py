"""The contact of a patch in a run: its rows, the forces on them, and its memory. Its law finds the forces."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..algebra.coulomb import Coulomb
from ..algebra.friction import OPEN, SLIP, STICK
from ..algebra.products import dense, smallest
from ..errors import ComplementarityError, InputError, RunError
from ..frames.kinematics import Rows
from ..support.arrays import Array
from .gaps import Gaps
from .law import Forces, Law, LawMaker, Motion, Places
from .memory import RowMemory, by_nodes, on_rows
from .normal_rows import NormalRows
from .plasticity.nodal_zones import NodalZones
from .plasticity.yielding_patches import YieldingPatches, Zones
from .state import ContactState
from .tangential import TangentialRows
from .viscosity import Creep, ViscousMemory, Yielding, shares

if TYPE_CHECKING:
    from typing import Self


_HELD = 0.75  # share of closed rows: if no more slip, those that stick hold the contact
_STICKING = 1e6  # coefficient of friction with which no row slips
_LEAST_WAY = 1e-3  # of the longest: secants count no shorter ones, which may be zero


class PatchContact:
    """A contact in a run: its rows, the forces on them, and its memory of the last accepted step.

    With friction, rows have three directions instead of one. Plastic zones are a part that any law can have. Besides
    the present motion, forces depend on the state at the end of the last accepted step. Only `accept` changes it. So a
    repeated step begins from the same state. All else is kept to save time, and may be lost.

    Parameters
    ----------
    gaps : Gaps
    formulation : Formulation
        It makes the law, and the zones if bodies yield.
    friction : Coulomb, optional

    Attributes
    ----------
    rows : NormalRows or TangentialRows
        Present rows with d = 1 direction each, with friction d = 3.
    law : Law
    zones : YieldingPatches or NodalZones or None
        Plastic zones beneath the patches.
    plastic : ZonesAnswer or None
        What the zones do in the last answer.
    secant : Secant or None
        Where zones flow in implicit and static steps, a guess for the next step of Newton's method.
    forces : (nr, d) array
        Forces on the present rows [N].
    index : (na,) int array
        Rows that are closed.
    least_gap : float
        Smallest gap of the present rows, without the deformation by the contact's own flexibility [m].
    state : ContactState
        At the end of the last accepted step.
    betas : tuple of float or None
        Times with which the residual flexibilities of the sides yield [s], see `viscosity`; None if all yield at once.
    since : float
        Start of the present step [s].
    opening : float
        How much of an overlap that is meant is still open [m]: surfaces stand apart by that much more than they are
        placed. Load steps take it to zero.
    told : bool
        Whether other contacts need to know the forces at the end of the last accepted step.
    sticks : bool
        Whether all closed rows with friction stick, whatever its coefficient.
    h : (nr,) array
        Gaps at the last answer [m], see `stored`.
    """

    h: Array
    forces: Array
    index: Array
    _at: Places  # of the last answer

    def __init__(self, gaps: Gaps, formulation: LawMaker, friction: Coulomb | None = None) -> None:
        gaps.reset()
        self.formulation, self.friction = formulation, friction
        self.rows: NormalRows | TangentialRows = NormalRows(gaps) if friction is None else TangentialRows(gaps)
        self.law: Law = formulation.law(self.rows)
        if self.law.reach:
            if self.ahead:
                raise InputError(f"law {type(self.law).__name__}: it acts ahead of steps, where no law has a reach")
            gaps.begin_at(self.law.reach)
        self.zones: Zones | None = formulation.zones(self)
        betas = tuple(side.beta for side in gaps.sides)
        self.betas = betas if self.law.residual and any(betas) else None
        self._reset()

    def for_run(self, method: str = "explicit") -> Self:
        """Return the contact at the start of a run with this method; this one does not change.

        Raises
        ------
        RunError
            If this contact cannot run with this method.
        """
        if method == "static" and self.ahead:
            raise RunError(
                "contact with formulation 'lagrange' has no statics, nor has any law ahead of steps: it acts on "
                "velocities, and needs Exudyn's explicit solver VelocityVerlet, or generalized-alpha (solve_dynamic). "
                "Take a basis with residual flexibility and formulation='compliance' for static runs, or press slowly "
                "in a damped run"
            )
        result = copy.copy(self)
        result.rows = self.rows.fresh(self.gaps.fresh())
        result.law = self.law.fresh(result.rows)
        result.zones = None if self.zones is None else self.zones.for_run(method)
        result._reset()
        if method == "static":
            result.betas, result._find_rates = None, None
            result.opening = self.gaps.overlap
            if self.gaps.overlap:
                result.least_gap = self.gaps.clearance + result.opening
        return result

    def _reset(self) -> None:
        self._n_nodes = len(self.gaps.slave.surface.points)
        memory = RowMemory.none(self._n_nodes, 4 if self.rows.d == 3 else 1)
        zones = () if self.zones is None else self.zones.start
        self.plastic = None if self.zones is None else self.zones.last(zones)
        self.secant = None if self.zones is None else self.zones.secant
        self.state = ContactState(self.gaps.accepted, memory, ViscousMemory(), zones)
        self._begun: ContactState | None = None  # state at the start of the run, until the first answer
        self.yielding: Yielding | None = None  # in the present step, if a flexibility is viscous
        self._creep: Creep | None = None  # at the present answer, once it is asked for
        self.least_gap, self.since, self.opening = np.inf, -math.inf, 0.0
        self.sticks = self.told = False
        find = functools.partial(_refuse_rates, self.law) if self.law.elastic else functools.partial(_rates, self.rows)
        self._find_rates: Callable[[Motion | None], Array] | None = find  # None in statics
        self._zero = np.zeros(self.gaps.n)
        self.open_rows()
        self._answered = False

    @property
    def gaps(self) -> Gaps:
        """Gaps of the rows."""
        return self.rows.gaps

    @property
    def memory(self) -> RowMemory:
        """Forces on the rows at the end of the last accepted step, and their slip."""
        return self.state.memory

    @property
    def creep(self) -> ViscousMemory:
        """What viscous flexibilities remember of the last accepted step."""
        return self.state.creep

    @property
    def lam(self) -> Array:
        """Normal forces on the present rows, (nr,) [N]."""
        value: Array = self.forces[:, 0]
        return value

    @property
    def status(self) -> Array:
        """Whether each present row is open, sticks or slips, (nr,) int8; closed rows without friction slip."""
        if self._status is not None:
            return self._status
        status = np.full(len(self.forces), OPEN, dtype=np.int8)
        status[self.index] = SLIP
        return status

    @property
    def compliant(self) -> bool:
        """Whether closed rows yield through a flexibility or layer of the contact itself."""
        return self.law.compliant

    @property
    def reach(self) -> float:
        """Gap at which forces begin [m]."""
        return self.law.reach

    @property
    def ahead(self) -> bool:
        """Whether forces are found ahead of each step, and are constant within it."""
        return self.law.ahead

    @property
    def elastic(self) -> bool:
        """Whether forces follow from the coordinates alone and have a potential."""
        return self.law.elastic and not self.remembers and not self.ahead

    @property
    def remembers(self) -> bool:
        """Whether forces within steps depend on those of earlier steps."""
        return self.zones is not None or self.viscous or (self.friction is not None and not self.ahead)

    @property
    def viscous(self) -> bool:
        """Whether a residual flexibility yields with time, see `viscosity`."""
        return self.betas is not None

    @property
    def damped(self) -> bool:
        """Whether a viscous flexibility or the law itself may take energy."""
        return self.viscous or not (self.law.elastic or self.ahead)

    @property
    def needs_motion(self) -> bool:
        """Whether forces need more than the coordinates and the memory: velocities, or the step."""
        return self.ahead or not self.law.elastic

    @property
    def pushes(self) -> bool:
        """Whether rows are closed, or zones may push."""
        return self.index.size > 0 or self.zones is not None

    @property
    def iterations(self) -> int:
        """Iterations of the set of closed rows since the start of the run."""
        return self.law.iterations

    @property
    def searches(self) -> int:
        """Searches for the pairs of all points since the start of the run."""
        return self.gaps.searches

    # Forces.

    def evaluate(self, motion: Motion) -> Array:
        """Generalised contact force, (n,), in the present state of the solver."""
        if not self.ahead:
            return self.force(motion.q, motion)
        self._answered = True
        if not isinstance(self.zones, NodalZones):
            return self._zero
        self.plastic = self.zones.at(self.state.zones, self.gaps.split(motion.q))
        return self.plastic.generalised(self._zero)

    def force(self, q: Array, motion: Motion | None = None) -> Array:
        """Generalised contact force, (n,), at the coordinates q, (n,), of slave and master."""
        self.answer(self.gap_at(q), motion=motion)
        return self.generalised()

    def gap_at(self, q: Array) -> Array:
        """Gaps of the present rows, (nr,) [m], at coordinates q, (n,), with the present `opening`."""
        gap = self.gaps.at(q)
        return gap + self.opening if self.opening else gap

    def answer(self, gap: Array, pushed: Array | None = None, motion: Motion | None = None) -> None:
        """Find the forces on the present rows from their gaps, (nr,) [m], and from their sliding.

        `pushed`, (nr, d) [m], are displacements due to the forces of other contacts. Tangential ones count from the
        last accepted step.
        """
        self._begin_answer()
        lasting = None if self.yielding is None else self.yielding.lasting(self.last)
        if lasting is not None:
            pushed = lasting if pushed is None else pushed + lasting
        if not isinstance(self.zones, YieldingPatches):
            self._answer(gap, pushed, motion)
            self.h = gap
            return

        def respond(moved: Array) -> Array:
            self._answer(gap, moved, motion)
            return self.forces

        more = np.zeros((len(gap), self.rows.d)) if pushed is None else pushed
        parts = self.gaps.coordinates
        self.plastic = self.zones.solve(self.state.zones, parts, self.rows, respond, more, self.plastic)
        self.h = self.h - more[:, 0]  # what others have pushed is no gap: its energy is stored here

    def _begin_answer(self) -> None:
        """Sliding counts from the present places if no step has begun."""
        self._answered, self._begun = True, None
        if isinstance(self.rows, TangentialRows) and not self.rows.held:
            self.rows.hold()
        if self.betas is not None:
            self._creep = None
            if self.yielding is None or not self.yielding.holds(self.creep):
                self.yielding = Yielding(self.rows, self.creep)

    def _answer(self, gap: Array, pushed: Array | None, motion: Motion | None) -> None:
        self.h = h = gap if pushed is None else gap + pushed[:, 0]
        self.least_gap = smallest(h)
        if math.isnan(self.least_gap):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        if self.least_gap >= self.law.reach:
            if self.index.size or len(self.forces) != len(h):
                self.open_rows()
            return
        forces = self.law.answer(self._places(h, pushed, motion))
        if np.shape(forces.on_rows) != (len(h), self.rows.d):
            raise InputError(
                f"law {type(self.law).__name__}: expected forces of shape {(len(h), self.rows.d)}, rows by directions, "
                f"got {np.shape(forces.on_rows)}"
            )
        if forces.power and self.law.elastic:
            raise InputError(f"law {type(self.law).__name__}: it takes energy, which only laws with elastic = False do")
        self.take(forces)

    def places(self, gap: Array) -> Places:
        """Places of the present rows with gaps, (nr,) [m], for which others find the forces and let them be taken."""
        self._begin_answer()
        lasting = None if self.yielding is None else self.yielding.lasting(self.last)
        return self._places(gap if lasting is None else gap + lasting[:, 0], lasting, None)

    def _places(self, gap: Array, pushed: Array | None, motion: Motion | None) -> Places:
        known = gap, self._way(pushed), self.last, self.coefficients
        self._at = Places(*known, motion=motion, since=self.since, find_rates=self._find_rates)
        return self._at

    def _way(self, pushed: Array | None) -> Array:
        """How far rows have slid along their tangents since the last accepted step, (nr, 2) [m]."""
        way = self.rows.way()
        return way if pushed is None else way + pushed[:, 1:]

    def take(self, forces: Forces) -> None:
        """Set the forces on the present rows."""
        self._answered, self._begun = True, None
        self.forces, self.index, self._status, self._slips, self._power = forces
        self._traction: Array | None = None
        self._slid: tuple[Array, float] | None = None  # see `_sliding`

    def open_rows(self) -> None:
        """Open all rows."""
        n = len(self.gaps.row_nodes)
        self.take(Forces(np.zeros((n, self.rows.d)), np.empty(0, dtype=np.int64)))

    def generalised(self) -> Array:
        """Generalised forces, (n,), from the present forces on rows, and from zones."""
        force = self.rows.generalised(self.forces) if self.index.size else self._zero
        if self.plastic is None:
            return force
        force = self.plastic.generalised(force)
        if self.secant is not None:
            self.secant = self.secant.then(self.gaps.q, force)
        return force

    @property
    def last(self) -> Array:
        """Forces on the present rows at the end of the last accepted step, (nr, 3) [N]; zero without friction."""
        if isinstance(self.rows, TangentialRows):
            return on_rows(self.rows, self.memory.forces)
        return np.zeros((len(self.gaps.row_nodes), 3))

    @property
    def coefficients(self) -> Array:
        """Coefficients of friction of the present rows in this step, (nr,); zero without friction."""
        nodes = self.gaps.row_nodes
        if self.sticks:
            return np.full(len(nodes), _STICKING)
        return np.zeros(len(nodes)) if self.friction is None else self.memory.coefficients(self.friction, nodes)

    # Stiffness and energy.

    def row_jacobian(self) -> Rows:
        """Derivative of the places of closed rows with respect to the coordinates, (d na, n)."""
        return self.rows.jacobian(self.index)

    def row_carrier(self) -> Array:
        """Derivative of the rates of closed rows with respect to the velocities of a surface's carrier, (d na, 6)."""
        return self.rows.carrier_rows(self.index)

    def row_stiffness(self) -> Array:
        """Minus the derivative of forces on closed rows with respect to their places, (d na, d na) [N/m]."""
        return dense(self.law.stiffness()) if self.index.size else np.zeros((0, 0))

    def tangent(self) -> Array:
        """Contact stiffness -d force / d q, (n, n), of closed rows and zones, for fixed pairs."""
        K = np.zeros((self.gaps.n,) * 2)
        if self.index.size and not self.ahead:
            H = self.row_jacobian()
            K = dense(H.T @ (self.law.stiffness() @ H))
        return self.corrected(K)

    def corrected(self, of_rows: Array) -> Array:
        """Stiffness, (n, n), from that of the rows, (n, n): where zones flow, it explains Newton's last step."""
        if self.secant is None or self.plastic is None or not self.plastic.flowing:
            return of_rows
        return self.secant.corrected(of_rows)

    def damping(self) -> Array | None:
        """Minus the derivative of forces on closed rows with respect to their rates, (d na, d na) [N s/m], or None."""
        found = self.law.damping() if self.index.size and not self.ahead else None
        return None if found is None else dense(found)

    def slip_secants(self, H: Array) -> Array:
        """Stiffness, (m, m), if friction opposed slips in proportion to the ways of rows; zero where many rows stick.

        `H`, (d na, m), is the derivative of the places of closed rows.
        """
        slipping = np.flatnonzero(self.status[self.index] == SLIP)
        K = np.zeros((H.shape[1],) * 2)
        if len(slipping) <= _HELD * len(self.index):
            return K
        rows = self.index[slipping]
        forces, ways = self.forces[rows, 1:], np.hypot(*self._at.way[rows].T)
        size = np.hypot(*forces.T)
        some = (size > 0.0) & (ways > 0.0)
        directions = forces[some] / size[some, None]
        along = np.einsum("it,itm->im", directions, H.reshape(-1, 3, len(K))[slipping[some], 1:])
        secants = size[some] / np.maximum(ways[some], _LEAST_WAY * ways.max())
        return np.asarray(along.T @ (secants[:, None] * along))

    def closed_stiffness(self, step: float = math.inf) -> Array | None:
        """Stiffness with all rows closed, (n, n), which limits explicit steps; None if it sets no limit.

        In steps of central differences of length `step` [s], it includes the viscosity of the flexibilities. Its forces
        belong to the velocity half a step before. So by h^2 omega^2 + 2 h d <= 4 they count twice.
        """
        if self.betas is None or math.isinf(step):
            return self.law.closed_stiffness(self.rows)
        gaps = self.gaps.fresh()
        gaps.yield_by(shares([2 * beta for beta in self.betas], step))
        rows = self.rows.fresh(gaps)
        return self.law.fresh(rows).closed_stiffness(rows)

    def press(self, gap: Array) -> tuple[float, int]:
        """Stored energy [J] and number of closed rows for gaps of the present rows, (nr,) [m], without friction."""
        n = len(gap)
        self.take(self.law.answer(Places(gap, np.zeros((n, self.rows.d - 1)), np.zeros((n, 3)), np.zeros(n))))
        return self.law.stored(gap, self.forces), len(self.index)

    def potential(self, q: Array) -> float:
        """Energy stored in the contact [J] at coordinates q, (n,)."""
        self.force(q)
        return self.stored()

    def stored(self) -> float:
        """Energy stored at present [J]."""
        if self._begun is not None:
            return self._begun.stored
        if self.yielding is not None:
            own = self._crept(self.yielding).stored
        else:
            own = self.law.stored(self.h, self.forces) if self.index.size and not self.ahead else 0.0
        return own if self.plastic is None else own + self.plastic.stored

    @property
    def shares(self) -> tuple[float, ...]:
        """Share of each side's flexibility that yields within the present step, see `viscosity.shares`."""
        return self.gaps.yielding or (1.0,) * len(self.gaps.sides)

    def carried_before(self, last: Array) -> list[Array]:
        """Forces that each side carried elastically at the end of the last step, (nr, d) [N].

        Those of a side that yields at once are `last`, (nr, 3) [N].
        """
        return [last[:, : self.rows.d]] * len(self.gaps.sides) if self.yielding is None else self.yielding.before

    def carried(self) -> list[Array]:
        """Forces that each side carries elastically at the present answer, (nr, d) [N]."""
        return [self.forces] * len(self.gaps.sides) if self.yielding is None else self.yielding.elastic(self.forces)

    def _crept(self, yielding: Yielding) -> Creep:
        """State of viscous flexibilities at the present answer."""
        if self._creep is None:
            self._creep = yielding.creep(self.forces)
        return self._creep

    def viscous_work(self) -> float:
        """Energy that the viscosity of the flexibilities has dissipated since the start of the run [J]."""
        if not self._answered or self.yielding is None:
            return self.creep.dissipated
        return self.creep.dissipated + self._crept(self.yielding).taken

    def law_work(self, end: float) -> float:
        """Energy that the law itself has dissipated since the start of the run [J], if the step ends at time `end` [s].

        Its power is integrated by the trapezoidal rule. Ahead of the first step it has taken nothing.
        """
        step, taken = end - self.since, self.state.dissipated
        within = self._answered and math.isfinite(step)
        return taken + 0.5 * step * (self.state.power + self._power) if within else taken

    def dissipated(self) -> float:
        """Energy that friction has dissipated since the start of the run [J]."""
        within = self._answered and self.friction is not None and not self.ahead and self.index.size > 0
        return self.memory.dissipated + (self._sliding()[1] if within else 0.0)

    def _sliding(self) -> tuple[Array, float]:
        """Slip of the rows since the last accepted step, (nr, 2) [m], and the energy that it dissipates [J].

        The energy is found by the trapezoidal rule. The force at the end of the step alone would give too much or too
        little.
        """
        if self._slid is None:
            slips = self.slips
            if self._slips is None:
                raise RunError(
                    f"law {type(self.law).__name__}: with friction, its answers need `slips`, how far the rows have "
                    "slipped since the last accepted step, see `contact.law.Forces`"
                )
            self._slid = slips, -0.5 * float(np.vdot(slips, (self._at.last + self.forces)[:, 1:]))
        return self._slid

    # State.

    def begin(self, state: ContactState, t: float) -> None:
        """Begin at time t [s] from a state of this contact, or of the same one in another run, process or model."""
        self.h = self.gaps.begin(state.gaps) + state.opening
        if isinstance(self.rows, TangentialRows):
            self.rows.hold()
        self.plastic = None if self.zones is None else self.zones.last(state.zones)
        self.state, self.since, self.opening = state, t, state.opening
        nodes, memory = self.gaps.row_nodes, state.memory
        closed = np.flatnonzero(memory.forces[nodes, 0])
        if isinstance(self.rows, TangentialRows):
            status = np.where(memory.slipped[nodes], SLIP, STICK).astype(np.int8)
            status[memory.forces[nodes, 0] == 0.0] = OPEN
            self.take(Forces(on_rows(self.rows, memory.forces), closed, status, np.zeros((len(nodes), 2))))
        else:
            self.take(Forces(memory.forces[nodes], closed))
        if self.betas is not None and memory.closed and not state.creep.elastic:  # of a run in which all yields at once
            at_rest = [self.forces] * len(self.gaps.sides)
            creep = ViscousMemory().after(self.rows, self.forces, at_rest, self._n_nodes, state.creep.dissipated)
            self.state = replace(state, creep=creep)
        self.least_gap, self._answered, self._begun = state.least_gap, False, state
        self._power = state.power

    def after(self, end: float) -> ContactState:
        """State after a step that ends at time `end` [s] with the last answer."""
        if not self._answered:
            return replace(self.state, gaps=self.gaps.accepted)
        if self.remembers and end <= self.since:  # the answer belongs to the start of a step
            return self.state
        if self.ahead or self.friction is None:
            memory = self.memory.with_forces(self._at_nodes())
        else:
            memory = self._slid_memory(end - self.since)
        zones = () if self.plastic is None else self.plastic.after
        return ContactState(
            self.gaps.after(),
            memory,
            self._crept_memory(),
            zones,
            self.opening,
            power=self._power,
            dissipated=self.law_work(end),
        )

    def at_end(self, end: float) -> ContactState:
        """State at the end of a run, at time `end` [s], with what its results tell of it."""
        return replace(self.after(end), stored=self.stored(), least_gap=float(self.least_gap))

    def accept(self, start: float) -> None:
        """Begin a step at time `start` [s]. The step before ended there, with the last answer."""
        if start > self.since:
            closed = self.index.size > 0
            if self._answered and (self.remembers or self.told or self.damped):
                self.state = self.after(start)
                if self.zones is not None and self.plastic is not None:
                    self.plastic.check()
                    self.plastic = self.zones.last(self.state.zones)
                gaps = self.state.gaps
            else:
                gaps = self.gaps.after()
            if not self.ahead:
                self.gaps.accept(gaps)
            if isinstance(self.rows, TangentialRows) and self._answered and not self.ahead:
                self.rows.hold(soon=closed)
        self.since, self._answered = start, False

    def retry(self) -> None:
        """Begin the step again, from the state that was accepted last."""
        self.gaps.retry()
        self.plastic = None if self.zones is None else self.zones.last(self.state.zones)

    def take_step(self, end: float) -> None:
        """Take the time [s] at which forces are evaluated next: viscous flexibilities depend on the step up to it.

        Ahead of the first step nothing moves. If the contact is closed then, its flexibility is at rest.
        """
        if self.betas is None:
            return
        step, before = end - self.since, self.gaps.yielding
        if step > 0.0 and self._answered and before is not None and min(before) == 1.0 and not self.creep.elastic:
            self.state = replace(self.state, creep=self._crept_memory())
        self.gaps.yield_by(shares(self.betas, step))

    def _crept_memory(self) -> ViscousMemory:
        """What viscous flexibilities remember of the last answer."""
        if self.yielding is None or not (self.index.size or self.creep.elastic):
            return self.creep
        now = self._crept(self.yielding)
        return self.creep.after(self.rows, self.forces, now.elastic, self._n_nodes, now.taken)

    def _slid_memory(self, step: float) -> RowMemory:
        """What rows with friction remember of the last answer, after a step [s]."""
        closed = self.index.size > 0
        if not (closed or self.memory.closed):
            return self.memory
        slips, taken = self._sliding() if closed else (np.zeros((len(self.forces), 2)), 0.0)
        return self.slid_memory(slips, np.hypot(*slips.T) / step, taken)

    def slid_memory(self, slips: Array, speeds: Array, taken: float) -> RowMemory:
        """What rows with friction remember of the present forces; see `RowMemory.after`."""
        assert isinstance(self.rows, TangentialRows)
        return self.memory.after(self.rows, self.lam, self.traction, self.status, slips, speeds, taken)

    def remember(self, memory: RowMemory) -> None:
        """Take what is remembered of forces that are found ahead of steps."""
        self.state = replace(self.state, memory=memory)

    def _at_nodes(self) -> Array:
        """Present forces stored for the nodes of the slave's patch, as in `RowMemory`."""
        if isinstance(self.rows, TangentialRows):
            return by_nodes(self.rows, self.lam, self.traction, self._n_nodes)
        found = np.zeros((self._n_nodes, 1))
        found[self.gaps.row_nodes] = self.forces
        return found

    # Results.

    @property
    def slips(self) -> Array:
        """How far the present rows have slipped since the last accepted step, (nr, 2) [m]."""
        return np.zeros((len(self.forces), 2)) if self._slips is None else self._slips

    @property
    def traction(self) -> Array:
        """Tangential forces on the present rows in space, (nr, 3) [N]; zero without friction."""
        if self._traction is None:
            self._traction = self.rows.tractions(self.forces)
        return self._traction

    @property
    def slip_path(self) -> Array:
        """Path that the row of each node of the slave's patch has slipped in the steps so far, (np,) [m]."""
        return self.memory.path

    @property
    def row_nodes(self) -> Array:
        """Node of the slave's patch for each present row, (nr,)."""
        return self.gaps.row_nodes

    @property
    def node_areas(self) -> Array:
        """Area of the row of each node of the slave's patch, (np,) [m2]; zero for a node without a row."""
        return self.gaps.node_areas

    @property
    def node_pressures(self) -> sp.csr_matrix:
        """Matrix from forces of the rows to pressures around the nodes of the slave's patch, (np, np) [1/m2]."""
        return self.gaps.node_pressures

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """Gaps until forces begin, rates and accelerations of an open contact, see `Gaps.closing`."""
        gap, rate, acceleration = self.gaps.closing(q, q_t, q_tt)
        self.open_rows()  # the rows may have changed
        return gap - self.reach, rate, acceleration

    def resultant(self) -> Array:
        """Force on the slave, (3,) [N]."""
        along = self.gaps.resultant(self.lam)
        return along if self.friction is None else along + self.traction.sum(axis=0)

    def moment(self, point: Array) -> Array:
        """Moment on the slave about a point in space, (3,) [N m]."""
        return self.rows.moment(self.forces, point) if self.index.size else np.zeros(3)

    def on_carrier(self, point: Array) -> Array:
        """Force on the body that carries the rigid surface, and moment about a point in space, (6,) [N, N m]."""
        return -np.concatenate([self.resultant(), self.moment(point)])

    def nodal_forces(self) -> list[Array]:
        """Forces on the nodes of the patches, in axes of space, (np, 3) for each side [N]."""
        return self.rows.nodal_forces(self.forces)

    def forces_on_nodes(self, q: Array, nodes: Array, lam: Array, traction: Array) -> list[Array]:
        """Forces on the nodes of the patches, like `nodal_forces`, from rows that were closed at coordinates q, (n,).

        Parameters
        ----------
        q : (n,) array
        nodes : (na,) int array
            Nodes of the slave's patch to which the rows belong.
        lam, traction : (na,), (na, 3) arrays
            Normal forces on the rows, and tangential forces in space [N]; the latter are zero without friction.
        """
        self.gaps.at(q)
        remembered = np.zeros((self._n_nodes, 4))
        remembered[nodes, 0], remembered[nodes, 1:] = lam, traction
        found = remembered[self.gaps.row_nodes]
        forces = found[:, :1]
        if isinstance(self.rows, TangentialRows):
            forces = np.column_stack([found[:, 0], self.rows.along(np.ascontiguousarray(found[:, 1:]))])
        return self.rows.nodal_forces(forces)

    def edge_reached(self) -> Array | None:
        """Place of a row with which contact leaves its patch, (3,) [m]; None if there is none. Pulling rows do not."""
        closed = self.index[self.lam[self.index] > 0.0] if self.reach else self.index
        if not closed.size:
            return None
        leaves_at = self.gaps.leaves_at[closed]
        # Closed rows without a flexibility of their own have no depth that would tell how far contact reaches.
        reached = -self.h[closed] >= leaves_at if self.compliant else np.isfinite(leaves_at)
        rows = closed[reached | (leaves_at == 0.0)]
        if not len(rows):
            return None
        value: Array = self.gaps.centre + self.gaps.places_now()[0][self.gaps.row_nodes[rows[0]]]
        return value


def _rates(rows: NormalRows | TangentialRows, motion: Motion | None) -> Array:
    """Rates of rows, (nr, d) [m/s]; zero without a motion."""
    return np.zeros((len(rows.gaps.row_nodes), rows.d)) if motion is None else rows.rates(motion.q_t)


def _refuse_rates(law: Law, motion: Motion | None) -> Array:
    """Raise an error if a law asks for rates."""
    raise InputError(f"law {type(law).__name__}: it asks for rates, which only laws with elastic = False have")
