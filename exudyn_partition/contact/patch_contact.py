"""The contact of a patch in a run: it answers at coordinates, from its state at the end of the last accepted step."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..algebra.coulomb import Coulomb
from ..algebra.friction import OPEN, SLIP, STICK
from ..algebra.products import smallest
from ..errors import ComplementarityError, InputError, RunError
from ..support.arrays import Array
from ..support.attributes import copied
from ..support.checks import read_only
from .evaluation import ContactParts, Evaluation
from .gaps import Gaps
from .law import Forces, Law, LawMaker, Motion, Places, check_forces
from .memory import on_rows
from .normal_rows import NormalRows
from .plasticity.nodal_zones import NodalZones
from .plasticity.yielding_patches import YieldingPatches, Zones
from .row_forces import no_forces, no_memory
from .spot_directions import SpotDirections
from .spot_gaps import SpotGaps
from .state import ContactState
from .tangential import TangentialRows
from .viscosity import ViscousMemory, Yielding, shares

if TYPE_CHECKING:
    from typing import Self


_ROUND_OFF = 1e-9  # of forces times gaps: energy below zero that is less is none
_STICKING = 1e6  # coefficient of friction with which no row slips


class PatchContact:
    """A contact in a run. With friction, rows have three directions instead of one.

    Besides the present motion, forces depend on the state at the end of the last accepted step. `begin` and `accept`
    change it; an answer does not. So a repeated step begins from the same state. All else is kept to save time, and may
    be lost.

    Parameters
    ----------
    gaps : Gaps
    formulation : Formulation
        It makes the law, and the zones if bodies yield.
    friction : Coulomb, optional

    Attributes
    ----------
    formulation : Formulation
    parts : ContactParts
    state : ContactState
        At the end of the last accepted step.
    evaluation : Evaluation
        Last answer; at the start of a run, the forces of its state.
    secant : Secant or None
        Where zones flow in implicit and static steps, a guess for the next step of Newton's method.
    since : float
        Start of the present step [s].
    opening : float
        How much of an overlap that is meant is still open [m]: surfaces stand apart by that much more than they are
        placed. Load steps take it to zero.
    told : bool
        Whether other contacts need to know the forces at the end of the last accepted step.
    sticks : bool
        Whether all closed rows with friction stick, whatever its coefficient.
    iterations : int
        Iterations of the set of closed rows since the start of the run.
    """

    def __init__(self, gaps: Gaps, formulation: LawMaker, friction: Coulomb | None = None) -> None:
        gaps.begin()
        self.formulation = formulation
        tangential = SpotDirections if isinstance(gaps, SpotGaps) else TangentialRows
        rows = NormalRows(gaps) if friction is None else tangential(gaps)
        law, betas = formulation.law(rows), tuple(side.beta for side in gaps.sides)
        if law.ahead and (law.reach or law.memory):
            raise InputError(f"law {type(law).__name__}: it acts ahead of steps, where no law has a reach or a memory")
        if law.elastic and law.memory:
            raise InputError(f"law {type(law).__name__}: it has a memory, which only laws with elastic = False have")
        if law.reach:
            gaps.reach_to(law.reach)
        self.parts = ContactParts(rows, law, friction, None, betas if law.residual and any(betas) else None)
        self.parts = replace(self.parts, zones=formulation.zones(self))
        self._begin_run()

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
        result, rows = copied(self), type(self.rows)(self.gaps.for_run())
        betas = None if method == "static" else self.parts.betas
        result.parts = replace(self.parts, rows=rows, law=self.formulation.law(rows), betas=betas)
        if self.zones is not None:
            result.parts = replace(result.parts, zones=self.zones.for_run(method))
        result._begin_run()
        if method == "static":
            result._find_rates, result.opening = None, self.gaps.placement.overlap
            least = self.gaps.placement.clearance + result.opening if result.opening else np.inf
            result.evaluation = result._at_start(least)
        return result

    def _begin_run(self) -> None:
        """Be at the start of a run that goes on from no other."""
        self._n_nodes = len(self.gaps.slave.surface.points)
        memory = no_memory(self.rows)
        zones = () if self.zones is None else self.zones.start
        by_law = np.zeros((self._n_nodes, self.law.memory))
        self.state = ContactState(self.gaps.accepted, memory, ViscousMemory(), zones, law=by_law)
        self.secant = None if self.zones is None else self.zones.secant
        self._yielding: Yielding | None = None  # in the present step, if a flexibility is viscous
        self.since, self.opening, self.iterations = -math.inf, 0.0, 0
        self.sticks = self.told = False
        find = functools.partial(_refuse_rates, self.law) if self.law.elastic else functools.partial(_rates, self.rows)
        self._find_rates: Callable[[Motion | None], Array] | None = find  # None in statics
        self.evaluation = self._at_start(np.inf)
        self._no_force = np.zeros(self.gaps.n)
        read_only(self._no_force)

    def _at_start(self, least_gap: float) -> Evaluation:
        """Evaluation with which a run begins that goes on from no other."""
        n = len(self.gaps.row_nodes)
        forces = no_forces(self.rows.d, n)
        plastic = None if self.zones is None else self.zones.last(self.state.zones)
        return Evaluation(
            self.parts, self.state, self.since, forces, np.zeros(n), least_gap, plastic=plastic, begun=True
        )

    @property
    def rows(self) -> NormalRows | TangentialRows:
        """See `ContactParts`."""
        return self.parts.rows

    @property
    def gaps(self) -> Gaps:
        """Gaps of the rows."""
        return self.parts.rows.gaps

    @property
    def law(self) -> Law:
        """See `ContactParts`."""
        return self.parts.law

    @property
    def friction(self) -> Coulomb | None:
        """See `ContactParts`."""
        return self.parts.friction

    @property
    def zones(self) -> Zones | None:
        """See `ContactParts`."""
        return self.parts.zones

    @property
    def ahead(self) -> bool:
        """See `Law`."""
        return self.parts.law.ahead

    @property
    def compliant(self) -> bool:
        """See `Law`."""
        return self.parts.law.compliant

    @property
    def reach(self) -> float:
        """See `Law`."""
        return self.parts.law.reach

    @property
    def elastic(self) -> bool:
        """See `ContactParts`."""
        return self.parts.elastic

    @property
    def flows(self) -> bool:
        """See `ContactParts`."""
        return self.parts.flows

    @property
    def remembers(self) -> bool:
        """See `ContactParts`."""
        return self.parts.remembers

    @property
    def viscous(self) -> bool:
        """See `ContactParts`."""
        return self.parts.viscous

    @property
    def damped(self) -> bool:
        """See `ContactParts`."""
        return self.parts.damped

    @property
    def node_areas(self) -> Array:
        """See `ContactPoints.node_areas`, of all rows; results that are read without their model have it too."""
        return self.gaps.all_points.node_areas

    @property
    def node_pressures(self) -> sp.csr_matrix:
        """See `ContactPoints.pressures`, of all rows; results that are read without their model have it too."""
        return self.gaps.all_points.pressures

    # Answers.

    def at(self, q: Array, motion: Motion | None = None) -> Evaluation:
        """Answer at the coordinates q, (n,), of slave and master; `motion` is for laws that need velocities."""
        evaluation = self.answer(self.gap_at(q), motion=motion)
        while self.lacks_rows():
            evaluation = self.answer(self.gap_at(q), motion=motion)
        return evaluation

    def lacks_rows(self, *, shared: bool = False) -> bool:
        """Whether rows may close that were not present at the last answer; the next evaluation has them.

        `shared` tells whether other contacts push the rows too.
        """
        answer = self.evaluation
        if not (answer.index.size and self.parts.law.residual):
            return False
        return self.gaps.follow_pushed(answer.lam, answer.h, answer.least_gap, answer.nodal_forces, shared=shared)

    def gap_at(self, q: Array) -> Array:
        """Gaps of the present rows, (nr,) [m], at coordinates q, (n,), with the present `opening`."""
        gap = self.gaps.at(q)
        return gap + self.opening if self.opening else gap

    def answer(self, gap: Array, pushed: Array | None = None, motion: Motion | None = None) -> Evaluation:
        """Answer to gaps of the present rows, (nr,) [m], and to their sliding.

        `pushed`, (nr, d) [m], are displacements due to the forces of other contacts. Tangential ones count from the
        last accepted step.
        """
        lasting = self._begin_answer()
        if lasting is not None:
            pushed = lasting if pushed is None else pushed + lasting
        zones, earlier = self.zones, self.evaluation.plastic
        if not isinstance(zones, YieldingPatches):
            return self._answer(gap, gap, pushed, motion)
        by_others = np.zeros((len(gap), self.rows.d)) if pushed is None else pushed

        def respond(moved: Array) -> Array:
            # What others have pushed is no gap: its energy is stored there.
            return self._answer(gap + (moved - by_others)[:, 0], gap, moved, motion).on_rows

        plastic = zones.solve(self.state.zones, self.gaps.present.coordinates, self.rows, respond, by_others, earlier)
        self.evaluation = self.evaluation.with_zones(plastic)
        return self.evaluation

    def _begin_answer(self) -> Array | None:
        """Return displacements of the rows that last from earlier steps, (nr, d) [m]; None if there are none.

        Sliding counts from the present places if no step has begun.
        """
        if isinstance(self.rows, TangentialRows) and not self.rows.has_places:
            self.rows.record_places()
        if self.parts.betas is None:
            return None
        if self._yielding is None or not self._yielding.is_current(self.state.creep):
            self._yielding = Yielding(self.rows, self.state.creep)
        return self._yielding.lasting(self.last)

    def _answer(self, evaluated_gap: Array, gap: Array, pushed: Array | None, motion: Motion | None) -> Evaluation:
        """Answer to gaps, (nr,) [m], and displacements of the rows, (nr, d) [m].

        `evaluated_gap` are the gaps in `Evaluation`.
        """
        h, law = gap if pushed is None else gap + pushed[:, 0], self.parts.law
        least = smallest(h)
        if math.isnan(least):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        if least >= law.reach and not law.memory:
            return self.answered(self._all_open(), evaluated_gap, least)
        places = self._places(h, pushed, motion, least)
        forces = law.answer(places)
        check_forces(law, forces, len(h), self.rows.d)
        if not math.isfinite(float(forces.on_rows.sum()) + forces.power + forces.taken):
            _refuse_what_is_no_number(type(law).__name__, forces, motion)
        return self.answered(forces, evaluated_gap, least, places)

    def places(self, gap: Array, pushed: Array | None = None) -> Places:
        """Places of the present rows with gaps, (nr,) [m], for which others find the forces, see `answered`.

        For `pushed` see `answer`.
        """
        lasting = self._begin_answer()
        if lasting is not None:
            pushed = lasting if pushed is None else pushed + lasting
        return self._places(gap if pushed is None else gap + pushed[:, 0], pushed, None)

    def _places(self, gap: Array, pushed: Array | None, motion: Motion | None, least: float | None = None) -> Places:
        memory = self.state.law[self.gaps.row_nodes] if self.law.memory else None
        last = mu = find_way = None
        if isinstance(self.rows, TangentialRows):
            last, mu, find_way = self.last, self.coefficients, functools.partial(_way, self.rows, pushed)
        return Places(
            gap, None, last, mu, motion=motion, since=self.since, memory=memory, find_rates=self._find_rates,
            find_way=find_way, least=least,
        )  # fmt: skip

    def answered(self, forces: Forces, gap: Array, least_gap: float, places: Places | None = None) -> Evaluation:
        """Answer with forces on the present rows that were found elsewhere.

        Parameters
        ----------
        forces : Forces
        gap : (nr,) array
            Gaps without displacements by other contacts [m].
        least_gap : float
            Smallest gap of the rows with these [m].
        places : Places, optional
            Places for which the forces were found.
        """
        self.iterations += forces.iterations
        self.evaluation = Evaluation(
            self.parts,
            self.state,
            self.since,
            forces,
            gap,
            least_gap,
            places=places,
            yielding=self._yielding,
            plastic=self.evaluation.plastic,
            opening=self.opening,
        )
        return self.evaluation

    def opened(self, gap: Array, least_gap: float) -> Evaluation:
        """Answer with all rows open, see `answered`."""
        return self.answered(self._all_open(), gap, least_gap)

    def _all_open(self) -> Forces:
        """No forces on the present rows; the same object as long as all rows stay open."""
        last, n = self.evaluation.forces, len(self.gaps.row_nodes)
        if last.closed.size or len(last.on_rows) != n:
            return no_forces(self.rows.d, n)
        return last

    def zone_forces(self, q: Array) -> Array:
        """Generalised forces of zones alone, (n,), at coordinates q, (n,); rows act ahead of the step."""
        none = np.zeros(self.gaps.n)
        if not isinstance(self.zones, NodalZones):
            return none
        plastic = self.zones.at(self.state.zones, self.gaps.sides.split(q))
        self.evaluation = self.evaluation.in_step(self.state, self.since).with_zones(plastic)
        return plastic.generalised(none)

    def generalised(self) -> Array:
        """Generalised forces of the last answer, (n,), from which Newton's method learns where zones flow."""
        if not self.evaluation.pushes:
            return self._no_force
        force = self.evaluation.generalised
        if self.secant is not None:
            self.secant = self.secant.then(self.gaps.present.q, force)
        return force

    def corrected(self, of_rows: Array) -> Array:
        """Stiffness, (n, n), from that of the rows, (n, n): where zones flow, it explains Newton's last step."""
        plastic = self.evaluation.plastic
        if self.secant is None or plastic is None or not plastic.flowing:
            return of_rows
        return self.secant.corrected(of_rows)

    def carried_before(self, last: Array) -> list[Array]:
        """Forces that each side carried elastically at the end of the last accepted step, (nr, d) [N].

        Those of a side that yields at once are `last`, (nr, 3) [N].
        """
        if self._yielding is None:
            return [last[:, : self.rows.d]] * len(self.gaps.sides)
        return self._yielding.before

    @property
    def last(self) -> Array:
        """Forces on the present rows at the end of the last accepted step, (nr, 3) [N]; zero without friction."""
        if isinstance(self.rows, TangentialRows):
            return on_rows(self.rows, self.state.memory.forces)
        return np.zeros((len(self.gaps.row_nodes), 3))

    @property
    def coefficients(self) -> Array:
        """Coefficients of friction of the present rows in this step, (nr,); zero without friction."""
        nodes = self.gaps.row_nodes
        if self.sticks:
            return np.full(len(nodes), _STICKING)
        return np.zeros(len(nodes)) if self.friction is None else self.state.memory.coefficients(self.friction, nodes)

    def closed_stiffness(self, step: float = math.inf) -> Array | None:
        """Stiffness with all rows closed, (n, n), which limits explicit steps; None if it sets no limit.

        In steps of central differences of length `step` [s], it includes the viscosity of the flexibilities. Its forces
        belong to the velocity half a step before. So by h^2 omega^2 + 2 h d <= 4 they count twice.
        """
        law, rows, n = self.law, self.rows, self.gaps.n
        if self.parts.betas is not None and not math.isinf(step):
            gaps = self.gaps.for_run()
            gaps.yield_by(shares([2 * beta for beta in self.parts.betas], step))
            rows = type(rows)(gaps)
            law = self.formulation.law(rows)
        stiffness = law.closed_stiffness(rows)
        if stiffness is not None and np.shape(stiffness) != (n, n):
            raise InputError(
                f"law {type(law).__name__}: expected a closed_stiffness of shape {(n, n)}, on the coordinates of both "
                f"bodies, got {np.shape(stiffness)}"
            )
        return stiffness

    def press(self, gap: Array) -> tuple[float, int]:
        """Stored energy [J] and number of closed rows for gaps of the present rows, (nr,) [m], without friction."""
        n = len(gap)
        still, memory = np.zeros((n, self.rows.d - 1)), np.zeros((n, self.law.memory))
        forces = self.law.answer(Places(gap, still, np.zeros((n, 3)), np.zeros(n), memory=memory))
        energy = forces.energy(gap)
        if energy < -_ROUND_OFF * float(abs(forces.on_rows[:, 0]) @ abs(gap)):
            raise InputError(
                f"law {type(self.law).__name__}: expected a stored energy of zero where its forces begin, and more in "
                f"contact, got {energy:.3g} J. A law that pulls has a `reach`, and stores energy below zero there"
            )
        return energy, len(forces.closed)

    # State.

    def begin(
        self,
        state: ContactState | None = None,
        start: float | None = None,
        end: float | None = None,
        *,
        freezes: bool = False,
    ) -> None:
        """Begin a step from a state of this contact, or of the same one in another run, process or model.

        By default, the present step begins again, from the state that was accepted last.

        Parameters
        ----------
        state : ContactState, optional
        start : float, optional
            When the step begins [s]. Default: as before.
        end : float, optional
            When it ends [s]; viscous flexibilities need it.
        freezes : bool
            Whether pairs of a step that begins again are frozen where it begins, if they may be frozen.
        """
        if state is None:
            self._begin_step(self._accepted(end, freezes=freezes), self.since, self.opening)
            if not self.ahead:  # multipliers ahead of the step stay
                self._begin_evaluation()
        else:
            self._begin_step(state, self.since if start is None else start, state.opening)
            self._begin_evaluation()
            self._begin_at_rest()
        if self.zones is not None:
            self.evaluation = self.evaluation.with_zones(self.zones.last(self.state.zones))
        self._end_at(end)

    def _begin_step(self, state: ContactState, start: float, opening: float) -> None:
        """Be at the start of a step, at a time [s], in a state and with this `opening` [m]."""
        self.state, self.since, self.opening = state, start, opening
        self.gaps.begin(state.gaps)

    def _begin_evaluation(self) -> None:
        """Let the last answer be that of the state."""
        state = self.state
        gap, rows = self.gaps.at_state(state.gaps) + self.opening, self.rows
        if isinstance(rows, TangentialRows):
            rows.record_places()
        self.evaluation = Evaluation(
            self.parts,
            state,
            self.since,
            self._forces_in(state),
            gap,
            state.least_gap,
            opening=self.opening,
            begun=True,
        )

    def _forces_in(self, state: ContactState) -> Forces:
        """Forces on the present rows in a state."""
        nodes, rows, memory = self.gaps.row_nodes, self.rows, state.memory
        closed = np.flatnonzero(memory.forces[nodes, 0])
        if not isinstance(rows, TangentialRows):
            return Forces(memory.forces[nodes], closed, power=state.power)
        status = np.where(memory.slipped[nodes], SLIP, STICK).astype(np.int8)
        status[memory.forces[nodes, 0] == 0.0] = OPEN
        return Forces(on_rows(rows, memory.forces), closed, status, np.zeros((len(nodes), 2)), state.power)

    def _begin_at_rest(self) -> None:
        """Let viscous flexibilities be at rest, if the run before let all of them yield at once."""
        memory, creep = self.state.memory, self.state.creep
        if self.parts.betas is not None and memory.closed and not creep.elastic:
            lam = self.evaluation.on_rows
            at_rest = [lam] * len(self.gaps.sides)
            creep = ViscousMemory().after(self.rows, lam, at_rest, self._n_nodes, creep.dissipated)
            self.state = replace(self.state, creep=creep)

    @property
    def _answered(self) -> bool:
        """Whether an answer was found in the present step."""
        return self.evaluation.since == self.since and not self.evaluation.begun

    def at_end(self, end: float) -> ContactState:
        """State at the end of a run, at time `end` [s], with what its results tell of it."""
        evaluation = self.evaluation
        state = evaluation.after(end) if self._answered else self._accepted()
        return replace(state, stored=evaluation.stored, least_gap=float(evaluation.least_gap))

    def accept(self, start: float, end: float | None = None) -> None:
        """Begin a step at time `start` [s]. The step before ended there, with the last answer.

        Viscous flexibilities need the time `end` at which the step ends [s].
        """
        if start > self.since:
            evaluation, answered = self.evaluation, self._answered
            if answered and (self.remembers or self.told or self.damped) and evaluation.adds_to_state:
                self.state = evaluation.after(start)
                if self.zones is not None and evaluation.plastic is not None:
                    evaluation.plastic.check()
                    self.evaluation = evaluation.with_zones(self.zones.last(self.state.zones))
                gaps = self.state.gaps
            else:
                gaps = self.gaps.after()
            if not self.ahead:
                self.gaps.accept(gaps)
            if isinstance(self.rows, TangentialRows) and answered and not self.ahead:
                self.rows.record_places(gaps, soon=evaluation.index.size > 0)
        elif end is not None:
            self.state = self._accepted(end)
        self.since = start
        self._end_at(end)

    def _accepted(self, end: float | None = None, *, freezes: bool = False) -> ContactState:
        """State from which the present step begins, now that it ends at a time [s]; see `begin`.

        Ahead of the first step nothing moves. If the contact is closed then, its flexibility is at rest.
        """
        state, gaps, creep = self.state, self.gaps.accepted, self.state.creep
        if self.parts.betas is not None and end is not None and end > self.since and self._answered:
            yielding = self.gaps.yielding
            if yielding is not None and min(yielding) == 1.0 and not creep.elastic:
                creep = self.evaluation.creep_after
        if freezes and self.gaps.may_freeze:
            gaps = replace(gaps, frozen=gaps.q)
        return state if (gaps, creep) == (state.gaps, state.creep) else replace(state, gaps=gaps, creep=creep)

    def _end_at(self, end: float | None) -> None:
        """Let flexibilities yield as they do in a step up to a time [s]."""
        if self.parts.betas is not None and end is not None:
            self.gaps.yield_by(shares(self.parts.betas, end - self.since))

    # Results.

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """Gaps until forces begin, rates and accelerations of an open contact, see `Gaps.closing`."""
        gap, rate, acceleration = self.gaps.closing(q, q_t, q_tt)
        self.opened(self.evaluation.h, self.evaluation.least_gap)  # the rows may have changed
        return gap - self.reach, rate, acceleration

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
        of_rows = remembered[self.gaps.row_nodes]
        forces = of_rows[:, :1]
        if isinstance(self.rows, TangentialRows):
            forces = np.column_stack([of_rows[:, 0], self.rows.along(np.ascontiguousarray(of_rows[:, 1:]))])
        return self.rows.nodal_forces(forces)


def _way(rows: TangentialRows, pushed: Array | None) -> Array:
    """How far rows have slid along their tangents since the last accepted step, (nr, 2) [m]."""
    way = rows.way()
    return way if pushed is None else way + pushed[:, 1:]


def _rates(rows: NormalRows | TangentialRows, motion: Motion | None) -> Array:
    """Rates of rows, (nr, d) [m/s]; zero without a motion."""
    return np.zeros((len(rows.gaps.row_nodes), rows.d)) if motion is None else rows.rates(motion.q_t)


def _refuse_what_is_no_number(name: str, forces: Forces, motion: Motion | None) -> None:
    """Raise an error because of an answer of a law of this name to finite gaps that is not finite itself."""
    if motion is not None and not math.isfinite(float(motion.q_t.sum())):
        raise ComplementarityError("the velocities are not finite: the run has become unstable")
    values: dict[str, Array | float] = {"on_rows": forces.on_rows, "power": forces.power, "taken": forces.taken}
    wrong = " and ".join(key for key, value in values.items() if not np.isfinite(value).all())
    raise InputError(f"law {name}: expected finite numbers for finite gaps and velocities, got others in {wrong}")


def _refuse_rates(law: Law, motion: Motion | None) -> Array:
    """Raise an error if a law asks for rates."""
    raise InputError(f"law {type(law).__name__}: it asks for rates, which only laws with elastic = False have")
