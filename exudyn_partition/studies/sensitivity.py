"""Derivatives of what an impact does by velocities, places, loads, damping and materials, from one compiled run."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
import scipy.sparse as sp

from ..algebra.blas_threads import one_blas_thread
from ..compiled.adjoint import Derivatives, backwards
from ..compiled.made_run import MadeRun
from ..compiled.plan import StepPlan
from ..compiled.run import EqualSteps, Histories, run
from ..compiled.start import Start
from ..contact.linear_gaps import FlatRows
from ..errors import CompiledRunError, InputError, RunError
from ..exudyn_bodies.body_results import nodes_around
from ..exudyn_bodies.model import validate_model
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..frames.floating import FloatingKinematics
from ..simulation.compiled_limits import check_held
from ..support.arrays import Array, Vector
from ..support.checks import read_only, validate_array, validate_choice, validate_vector
from ..support.foreign import MainSystem
from ..support.spelling import spelled
from .measures import flies_on
from .run_numbers import Number, at_times, energy_of_body, number_of_contact, number_of_friction, sums_of_history
from .variations import Variations, damping_power
from .varied_model import VariedModel

OfFriction = Literal["friction_impulse", "dissipated"]
OfContact = Literal["peak_force", "impulse", "duration", OfFriction]
OfHistory = Literal["velocity", "strain"]
OfBody = Literal[OfHistory, "energy"]
NumberName = Literal[OfContact, OfBody]
OF_FRICTION: tuple[OfFriction, ...] = get_args(OfFriction)
OF_CONTACT: tuple[OfContact, ...] = ("peak_force", "impulse", "duration", *OF_FRICTION)
OF_HISTORY: tuple[OfHistory, ...] = get_args(OfHistory)
NUMBERS: tuple[NumberName, ...] = (*OF_CONTACT, *OF_HISTORY, "energy")
_EDGE = 1e-9  # share of the largest force on a row, and of its largest yielding, that is none
_BY_LAW = ("static", "kinetic", "decay")


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """A number that follows from a run, or k numbers, and their derivatives; see `sensitivity`.

    Parameters
    ----------
    of : str
    value : float or (k,) array
    by : dict of PartitionBody or PartitionContact to dict of str to array or float
        Derivatives by what `run_many` varies: (3,) arrays for vectors, floats for numbers, and (n_elastic,) for a
        damping that has a ratio for each mode. Of k numbers, arrays have one dimension more, the first. E and rho are
        missing for bodies of no one material, and for those in floating frames. Of a contact with friction, that by
        its coefficient, "friction"; if the coefficient falls, by "static" and "kinetic" one and "decay" [s/m].
    steps : int
        Steps of the run.
    changes : int
        Steps in which rows have closed or opened, have begun to slip, or have ceased to. The derivatives are those of
        the steps as they are.
    edges : int
        Samples in which a row is at the edge of another status: there a derivative holds for one direction alone. It
        has neither a force nor a gap, as where bodies touch at the start, or sticks with all the force that friction
        bears, or slips by nothing.
    margin : float
        The least distance of a row from this edge in all samples, as a share of the largest force, or of the largest
        yielding of the rows. Changes by less than about this share change no status.
    """

    of: str
    value: float | Array
    by: Mapping[PartitionBody | PartitionContact, Mapping[str, Array | float]]
    steps: int
    changes: int
    edges: int
    margin: float

    @property
    def caution(self) -> str:
        """Says where the derivatives are one-sided; empty if they are not."""
        if not self.edges:
            return ""
        share = self.edges / (self.steps + 1)
        return (
            f"in {self.edges} of {self.steps + 1} samples ({share:.2g} of them) a row of contact is at the edge of "
            "another status: the derivatives hold for one direction alone"
        )

    def __repr__(self) -> str:
        numbers = f"{self.value:.6g}" if isinstance(self.value, float) else f"{len(self.value)} times"
        bodies = sum(isinstance(item, PartitionBody) for item in self.by)
        caution = f"; {self.caution}" if self.edges else ""
        return f"Sensitivity({self.of} {numbers}, by {bodies} bodies{caution})"


@spelled
def sensitivity(
    mbs: MainSystem,
    *,
    end_time: float,
    of: NumberName,
    at: PartitionContact | PartitionBody,
    direction: Vector = (0.0, 0.0, 1.0),
    point: Vector | None = None,
    rows: sp.csr_matrix | None = None,
    times: Array | Sequence[float] | None = None,
    weights: Array | None = None,
    values: Mapping[PartitionBody, Mapping[str, Any]] | None = None,
    step: float | None = None,
) -> Sensitivity:
    """Derivatives of numbers that follow from a compiled run, by the discrete adjoint of its steps.

    One run and one pass backwards give all derivatives. They are those of the steps as they were made, so that they
    agree with differences of `run_many` to round-off where no row changes its status meanwhile: closes, opens, begins
    to slip or ceases to. Where pairs slide while bodies fly apart after contact, the run goes on without contact, as in
    the ringing after a tap. Nothing is looked at afterwards, such as edges of patches: `solve_dynamic` warns of that.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        The model, assembled; see `solve_dynamic` for what compiled runs hold.
    end_time : float
        Time at which the run ends [s].
    of : {"peak_force", "impulse", "duration", "friction_impulse", "dissipated", "velocity", "strain", "energy"}
        Of a contact, as in `ManyRuns`: largest force [N], impulse [N s], time in contact [s]; of friction, its impulse
        on the slave along `direction` [N s], and the energy that it has taken [J]. Of a body: velocity along
        `direction` [m/s], what `rows` recover, kinetic and strain energy at the end [J].
    at : PartitionContact or PartitionBody
        Whose number it is.
    direction : (3,)
        Of a velocity, or of an impulse of friction.
    point : (3,), optional
        Whose velocity it is, in the body's own coordinates [m]. Default: the centre of mass.
    rows : (1, 3 nodes) csr matrix, optional
        Of a strain, or another value of nodal displacements, as from `recovery.gauge_rows`. It needs these rows.
    times : (m,) array, optional
        Times of velocities or strains [s]; values between steps are those of lines. Default: the end, a single number.
    weights : (k, m) array, optional
        Sums of the values at `times` are wanted, such as Fourier integrals. All k sums take one pass backwards.
    values : dict of PartitionBody or PartitionContact to dict of str to value, optional
        What differs from the model: one value of each name that `run_many` knows, such as E, or the "friction" of a
        contact. So an optimiser needs one model.
    step : float, optional
        Time step [s]. Default: that of `run_many`.

    Returns
    -------
    Sensitivity

    Raises
    ------
    CompiledRunError
        If compiled runs cannot hold the model, rows follow facets of another body, or rows with friction follow the
        motion; the message lists all reasons.
    InputError
        If an argument is wrong, or nothing touches.
    RunError
        If the run stops before its end, or bodies touch again after their pairs have slid.
    StepSizeError
        If the step is above the stability limit.
    """
    validate_model(mbs)
    check_held(mbs)
    validate_choice("of", of, NUMBERS)
    bodies, contacts = partition_items(mbs)
    expected = contacts if of in OF_CONTACT else bodies
    if at not in expected:
        kind = "CreatePartitionContact()" if of in OF_CONTACT else "CreatePartitionBody()"
        raise InputError(f"at: for {of!r} expected what {kind} returned for this model, got {type(at).__name__}")
    _check_friction(of, at)
    history = _History.checked(of, at, direction, point, rows, times, weights)
    model = VariedModel.of(mbs, end_time, step, _variations(values, bodies, contacts), None)
    plan = model.entries.plan(0, model.entries.contacts(0))
    _check_adjoint(model, plan)
    steps, start = EqualSteps(model.times.step, model.times.steps), model.entries.start(0)
    with one_blas_thread():
        plan, histories = _run(plan, start, steps)
        made = MadeRun(plan, steps, histories, start.friction)
        if isinstance(at, PartitionContact):
            place = model.contacts.index(at)
            if of in OF_FRICTION:
                along = np.asarray(direction, dtype=float)
                number = number_of_friction(of, place - len(plan.contacts.names), along, made)
            else:
                number = number_of_contact(of, place, made)
        elif history is None:
            number = energy_of_body(at.kinematics, model.places[at], made)
        else:
            number = history.number(model.places[at], steps, histories)
        yielding = [item for item in bodies if item.frame != "floating" and model.entries.touching(item)]
        parts = [made.part(model.entries.part(item, 0), model.entries.touching(item)) for item in yielding]
        derivatives_of, margins = backwards(made, number.weights, parts), made.margins
    derivatives = _Derivatives(model, plan, derivatives_of, number, yielding)
    single = history is None or history.times is None
    found_by: dict[PartitionBody | PartitionContact, dict[str, Array]] = {item: derivatives.by(item) for item in bodies}
    for place, contact in enumerate(model.contacts):
        if contact.mechanics.friction is not None:
            found_by[contact] = derivatives.by_friction(place)
    by = {item: {name: _shown(value, single) for name, value in of_item.items()} for item, of_item in found_by.items()}
    edges, margin = int(np.count_nonzero(margins < _EDGE)), float(margins.min(initial=np.inf))
    return Sensitivity(of, _shown(number.values, single), by, steps.count, made.changes, edges, margin)


def _check_friction(of: str, at: PartitionContact | PartitionBody) -> None:
    """Raise an error if a number of friction is wanted of a contact without friction."""
    if of in OF_FRICTION and isinstance(at, PartitionContact) and at.mechanics.friction is None:
        raise InputError(f"at: for {of!r} expected a contact with friction, got {at.name!r} without")


def _check_adjoint(model: VariedModel, plan: StepPlan) -> None:
    """Raise an error that names the bodies and contacts which the adjoint does not have."""
    moving = plan.contacts.moving
    if moving is None:
        return
    names, rough = plan.contacts.names, plan.contacts.friction
    pairs = [f"contact {names[pair.contact]!r} has rows that follow facets of another body" for pair in moving.pairs]
    pairs += [
        f"contact {rough.names[one.contact]!r} has friction, or moves with one that has it, and rows that follow the "
        "motion: of a floating frame, or a curved rigid surface"
        for one in (*moving.rubbing, *moving.rubbing_pairs)
        if rough is not None
    ]
    if pairs:
        listed = "".join(f"\n- {reason}" for reason in pairs)
        raise CompiledRunError(
            f"sensitivity: the pass back over the steps does not have all of this model:{listed}\n"
            "Take rows that stay where they are, or differences of ep.run_many"
        )


def _run(plan: StepPlan, start: Start, steps: EqualSteps) -> tuple[StepPlan, Histories]:
    """Run a plan to its end; pairs that slide in free flight after contact may slide on, unless rows close again."""
    made, told = run(plan, start, steps), "mbs: the run stopped after {} steps: {}"
    if made.stopped is None:
        return plan, made
    if not flies_on(made):
        raise RunError(told.format(made.made, made.stopped.text))
    contacts, friction = plan.contacts, plan.contacts.friction
    friction = friction and replace(friction, rows=_far_reaching(friction.rows))
    free = replace(plan, contacts=replace(contacts, rows=_far_reaching(contacts.rows), friction=friction))
    flown = run(free, start, steps)
    if flown.stopped or flown.values[made.made :, :, 0].any():
        raise RunError(told.format(made.made, f"{made.stopped.text}, and later touch again; end it before"))
    return free, flown


def _far_reaching(rows: FlatRows) -> FlatRows:
    """Rows whose pairs may slide as far as they wish."""
    return rows._replace(reach=np.full_like(rows.reach, np.inf))


def _shown(values: Array, single: bool) -> Array | float:
    """Derivatives of k numbers, (k, ...), or of a single one without that dimension."""
    shown = values[0] if single else values
    if not np.ndim(shown):
        return float(shown)
    read_only(shown)
    return shown


def _variations(values: object, bodies: Sequence[PartitionBody], contacts: Sequence[PartitionContact]) -> Variations:
    """What differs from the model, as the one entry of `run_many`."""
    if values is None:
        return Variations(1, {})
    if not isinstance(values, Mapping) or not all(isinstance(of_body, Mapping) for of_body in values.values()):
        raise InputError(
            f"values: expected a dict of body: dict of name: value, such as {{beam: {{'E': 2e11}}}}, got {values!r:.60}"
        )
    entry = {item: {name: [value] for name, value in of_body.items()} for item, of_body in values.items()}
    return Variations.checked(entry, bodies, contacts, argument="values")


@dataclass(frozen=True, eq=False)
class _History:
    """A value of a body, and its times [s].

    `value` is a function of coordinates and velocities at n samples, (n, n_dofs) each: it returns the value there,
    (n,), and its derivatives by them. `times` None is the end; with `weights`, (k, m), sums of values at times are
    wanted.
    """

    value: Callable[[Array, Array], tuple[Array, Array, Array]]
    times: Array | None
    weights: Array | None

    @classmethod
    def checked(
        cls, of: str, at: object, direction: Vector, point: object, rows: object, times: object, weights: object
    ) -> _History | None:
        """Check what is wanted; None for numbers that have no history."""
        direction = validate_vector("direction", direction)
        given = {"point": point, "rows": rows, "times": times, "weights": weights}
        known = {"velocity": {"point", "times", "weights"}, "strain": {"rows", "times", "weights"}}.get(of, set())
        for name, value in given.items():
            if value is not None and name not in known:
                raise InputError(f"{name}: expected None for {of!r}, got {type(value).__name__}")
        if of not in OF_HISTORY or not isinstance(at, PartitionBody):
            return None
        times = None if times is None else validate_array("times", times, (None,))
        if weights is not None:
            if times is None:
                raise InputError("weights: expected None without times, for they belong to these")
            weights = validate_array("weights", weights, (None, len(times)))
        place = None if point is None else validate_vector("point", point)
        return cls(_strain(at, rows) if of == "strain" else _velocity(at, direction, place), times, weights)

    def number(self, dofs: Array, steps: EqualSteps, made: Histories) -> Number:
        """Its values in a run, of a body with these coordinates."""
        n, end = len(made.q), steps.count * steps.step
        times = np.array([end]) if self.times is None else self.times
        if times.min(initial=0.0) < 0 or times.max(initial=0.0) > end * (1 + _EDGE):
            raise InputError(f"times: expected times from 0 to the end, {end:.6g} s, got {times.min():.6g} to "
                             f"{times.max():.6g} s")  # fmt: skip
        by_q, by_v = np.zeros((2, *made.q.shape))
        history, by_q[:, dofs], by_v[:, dofs] = self.value(made.q[:, dofs], made.v[:, dofs])
        return sums_of_history(history, by_q, by_v, at_times(times, self.weights, n, steps.step), made)


def _linear(by_q: Array, by_v: Array) -> Callable[[Array, Array], tuple[Array, Array, Array]]:
    """A value that is linear in coordinates and velocities, (n_dofs,) each, see `_History`."""
    return lambda q, q_t: (q @ by_q + q_t @ by_v, by_q, by_v)


def _velocity(item: PartitionBody, direction: Array, point: Array | None) -> Callable[..., tuple[Array, Array, Array]]:
    """Velocity of a point of a body, or of its centre of mass, along a direction, see `_History`."""
    kinematics, zero = item.kinematics, np.zeros(item.body.n_dofs)
    if not isinstance(kinematics, FloatingKinematics):
        mean = kinematics.mass_integral / item.body.total_mass
        return _linear(zero, direction @ (mean if point is None else item.velocity_rows(point)))
    if point is None:
        return _linear(zero, np.r_[direction, zero[3:]])
    nodes, weights = nodes_around(item.body, point)
    return functools.partial(kinematics.at(nodes).velocity_along, weights=weights, direction=direction)


def _strain(item: PartitionBody, rows: object) -> Callable[..., tuple[Array, Array, Array]]:
    """What a row recovers of a body, see `_History`."""
    kinematics, row = item.kinematics, _one_row(item, rows)
    if not isinstance(kinematics, FloatingKinematics):
        return _linear(row, np.zeros(item.body.n_dofs))
    growth = np.zeros(6) if kinematics.growth is None else item.body.growth_in(sp.csr_matrix(rows))[0]
    return functools.partial(kinematics.recovered, row=row, growth=growth)


def _one_row(item: PartitionBody, rows: object) -> Array:
    """Row of a strain by the coordinates, (n_dofs,)."""
    shape = rows.shape if isinstance(rows, sp.spmatrix | sp.sparray) else ()
    if shape[:1] != (1,):
        got = f"one of shape {shape}" if shape else type(rows).__name__
        raise InputError(
            f"rows: expected a sparse matrix with one row for 'strain', as of recovery.gauge_rows, got {got}"
        )
    by_coordinates: Array = np.asarray(item.body.reduced_rows(sp.csr_matrix(rows)))[0]
    return by_coordinates


class _Derivatives:
    """Derivatives of k numbers by what `run_many` varies.

    Parameters
    ----------
    model : VariedModel
    plan : StepPlan
        Of its one entry.
    found : Derivatives
    number : Number
    yielding : sequence of PartitionBody
        Whose flexibility is each of the parts in `found`.
    """

    def __init__(
        self,
        model: VariedModel,
        plan: StepPlan,
        by_steps: Derivatives,
        number: Number,
        yielding: Sequence[PartitionBody],
    ) -> None:
        self._model, self._plan, self._found, self._number = model, plan, by_steps, number
        self._flexibility = dict(zip(yielding, by_steps.flexibility, strict=True))

    def by(self, item: PartitionBody) -> dict[str, Array]:
        """Derivatives by the quantities of a body, (k,), (k, 3) or (k, n_elastic)."""
        model, by_steps, dofs = self._model, self._found, self._model.places[item]
        kinematics, values = item.kinematics, model.variations
        E, rho = (values.factor(item, name, 0) for name in ("E", "rho"))
        damping, load = by_steps.bodies.damping[:, dofs], by_steps.bodies.load[:, dofs]
        by_ratios = math.sqrt(E * rho) * damping[:, 6:] * model.entries.of_ratio_one[item][6:]
        gravity, ratio = values.of(item, "gravity", 0), values.of(item, "damping", 0)
        of_each_mode = isinstance(item.ratios, Sequence | np.ndarray) if ratio is None else ratio.ndim
        rigid = self._rigid(item)
        result = {
            "initialVelocity": by_steps.v[:, dofs] @ rigid[:, :3],
            "initialAngularVelocity": by_steps.v[:, dofs] @ rigid[:, 3:],
            "referencePosition": by_steps.q[:, dofs] @ rigid[:, :3],
            "gravity": rho * load @ np.array([kinematics.weight(axis) for axis in np.eye(3)]).T,
            "damping": by_ratios if of_each_mode else by_ratios.sum(axis=1),
        }
        material = item.body.material
        if material is None or item.frame == "floating" or (callable(item.ratios) and ratio is None):
            return result
        by_E, by_rho = damping_power(item.ratios) if ratio is None else (0.5, 0.5)
        of_damping = damping @ self._plan.bodies.damping[dofs]
        before = np.zeros(len(dofs)) if item.weight is None else item.weight
        weight = before if gravity is None else kinematics.weight(gravity)
        of_mass = self._of_matrix("mass", dofs) + rho * load @ weight
        result["rho"] = (of_mass + by_rho * of_damping) / (rho * material.rho)
        stiff = self._of_matrix("stiffness", dofs) + by_E * of_damping - self._flexibility.get(item, 0.0)
        result["E"] = stiff / (E * material.E)
        return result

    def _rigid(self, item: PartitionBody) -> Array:
        """Velocities of a body at the start, (n_dofs, 6), by its velocity and angular velocity in space."""
        kinematics = item.kinematics
        if not isinstance(kinematics, FloatingKinematics):
            return item.body.rigid
        start, rigid = self._model.entries.start(0).q[self._model.places[item]], np.zeros((item.body.n_dofs, 6))
        rigid[:3, :3], rigid[3:6, 3:] = np.eye(3), (kinematics.frame(start)[1] @ kinematics.node_axes).T
        return rigid

    def by_friction(self, place: int) -> dict[str, Array]:
        """Derivatives by the coefficients of a contact with friction, (k,); see `Sensitivity`."""
        contacts = self._plan.contacts
        assert contacts.friction is not None
        law = contacts.friction.laws[place - len(contacts.names)]
        by_law = self._found.friction[place - len(contacts.names)]
        assert law is not None
        if law.constant:
            return {"friction": by_law.sum(axis=0)}
        return dict(zip(_BY_LAW if law.decay is not None else _BY_LAW[:2], by_law, strict=False))

    def _of_matrix(self, name: Literal["mass", "stiffness"], dofs: Array) -> Array:
        """Derivatives by a factor of a body's masses or stiffnesses, (k,)."""
        by_numbers = getattr(self._found.bodies, name)[:, dofs]
        if self._number.explicit is not None:
            by_numbers = by_numbers + getattr(self._number.explicit, name)[dofs]
        by_factor: Array = by_numbers @ getattr(self._plan.bodies, name)[dofs]
        return by_factor
