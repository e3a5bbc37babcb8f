"""Derivatives of what an impact does by velocities, places, loads, damping and materials, from one compiled run."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import scipy.sparse as sp

from ..algebra.blas_threads import one_blas_thread
from ..algebra.complementarity import regularised
from ..compiled.adjoint import Derivatives, Weights, backwards, flexibility_between, row_jacobian
from ..compiled.plan import Bodies, StepPlan
from ..compiled.run import EqualSteps, Histories, run
from ..contact.gaps import Gaps
from ..errors import InputError, RunError
from ..exudyn_bodies.held_damping import hold_damping
from ..exudyn_bodies.model import validate_model
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..frames.damping import damping_of
from ..results.impacts import closed_spans
from ..simulation.compiled_plan import at_start, check_held, dofs_of, in_groups, initial_start, read_plan
from ..simulation.run_plan import RunOptions, plan_run
from ..support.arrays import Array, Vector
from ..support.checks import read_only, validate_choice, validate_vector
from ..support.foreign import MainSystem
from ..support.spelling import spelled
from .variations import damping_power

OfContact = Literal["peak_force", "impulse", "duration"]
OfBody = Literal["velocity", "energy"]
Number = Literal[OfContact, OfBody]
OF_CONTACT: tuple[OfContact, ...] = get_args(OfContact)
NUMBERS: tuple[Number, ...] = (*OF_CONTACT, *get_args(OfBody))
_EDGE = 1e-9  # share of the largest force on a row, and of its largest yielding, that is none


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """A number that follows from a run, and its derivatives; see `sensitivity`.

    Parameters
    ----------
    of : str
    value : float
    by : dict of PartitionBody to dict of str to array or float
        Derivatives by what `run_many` varies: (3,) arrays for vectors, floats for numbers. E and rho are missing for
        bodies of no one material, and E where contacts move each other.
    changes : int
        Steps in which rows have closed or opened. The derivatives are those of the steps as they are.
    edges : int
        Samples in which a row has neither a force nor a gap, as where bodies touch at the start: there a derivative
        holds for one direction alone.
    """

    of: str
    value: float
    by: Mapping[PartitionBody, Mapping[str, Array | float]]
    changes: int
    edges: int

    def __repr__(self) -> str:
        return f"Sensitivity({self.of} {self.value:.6g}, by {len(self.by)} bodies)"


@spelled
def sensitivity(
    mbs: MainSystem,
    *,
    end_time: float,
    of: Number,
    at: PartitionContact | PartitionBody,
    direction: Vector = (0.0, 0.0, 1.0),
    step: float | None = None,
) -> Sensitivity:
    """Derivatives of a number that follows from a compiled run, by the discrete adjoint of its steps.

    One run and one pass backwards give all derivatives. They are those of the steps as they were made, so that they
    agree with differences of `run_many` to round-off where no row closes or opens meanwhile.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        The model, assembled; see `solve_dynamic` for what compiled runs hold.
    end_time : float
        Time at which the run ends [s].
    of : {"peak_force", "impulse", "duration", "velocity", "energy"}
        Of a contact, as in `ManyRuns`: largest force [N], impulse [N s], time in contact [s]. Of a body at the end:
        velocity of its centre of mass along `direction` [m/s], and kinetic and strain energy [J].
    at : PartitionContact or PartitionBody
        Whose number it is.
    direction : (3,)
        Of a velocity.
    step : float, optional
        Time step [s]. Default: that of `solve_dynamic`.

    Returns
    -------
    Sensitivity

    Raises
    ------
    CompiledRunError
        If compiled runs cannot hold the model; the message lists all reasons.
    InputError
        If an argument is wrong, or nothing touches.
    RunError
        If the run stops before its end.
    """
    validate_model(mbs)
    check_held(mbs)
    validate_choice("of", of, NUMBERS)
    bodies, contacts = partition_items(mbs)
    expected = contacts if of in OF_CONTACT else bodies
    if at not in expected:
        kind = "CreatePartitionContact()" if of in OF_CONTACT else "CreatePartitionBody()"
        raise InputError(f"at: for {of!r} expected what {kind} returned for this model, got {type(at).__name__}")
    direction = validate_vector("direction", direction)
    times = plan_run(mbs, RunOptions(end_time, start_time=0.0, step=step), None, None).times
    hold_damping(mbs)
    planned = [contact for group in in_groups(contacts) for contact in group]
    groups = at_start(contacts)
    gaps = [contact.gaps for _, members in groups for contact in members]
    plan, steps = read_plan(mbs, groups), EqualSteps(times.step, times.steps)
    places = {item: dofs_of(mbs, item) for item in bodies}
    with one_blas_thread():
        made = run(plan, initial_start(mbs), steps)
        if made.stopped:
            raise RunError(f"mbs: the run stopped after {made.made} steps: {made.stopped.text}")
        if isinstance(at, PartitionContact):
            value, weights = _of_contact(of, planned.index(at), plan, steps, made)
            explicit = None
        else:
            value, weights, explicit = _of_body(of, at, places[at], direction, plan, made)
        found = backwards(plan, steps, made, weights, _parts(plan, gaps))
    by = {item: _by(item, dofs, plan, found, explicit, planned) for item, dofs in places.items()}
    return Sensitivity(of, value, by, *_edges(plan, made))


def _parts(plan: StepPlan, gaps: Sequence[Gaps]) -> list[list[Array]]:
    """Parts of each contact's flexibility, by its sides, (nr, nr) [m/N]; none where contacts move each other."""
    if plan.contacts.core:
        return [[] for _ in gaps]
    return [[regularised(rows.side_flexibility(place)) for place in range(len(rows.sides))] for rows in gaps]


def _edges(plan: StepPlan, made: Histories) -> tuple[int, int]:
    """Steps in which closed rows change, and samples in which a row has neither a force nor a gap."""
    assert made.lam is not None
    lam, rows = made.lam, plan.contacts.rows
    sets = np.split(lam.indices, lam.indptr[1:-1])
    changes = sum(not np.array_equal(*pair) for pair in itertools.pairwise(sets))
    forces, yielding = lam.toarray(), lam @ flexibility_between(plan.contacts, np.arange(len(rows.start)))
    gaps = made.q @ row_jacobian(plan.contacts, made.q.shape[1]).T + rows.start + yielding
    small = (forces > 0.0) & (forces < _EDGE * forces.max())
    touching = (forces == 0.0) & (abs(gaps) < _EDGE * abs(yielding).max())
    return changes, int(np.count_nonzero((small | touching).any(axis=1)))


def _of_contact(of: str, j: int, plan: StepPlan, steps: EqualSteps, made: Histories) -> tuple[float, Weights]:
    """Number of contact j, and its weights."""
    assert made.lam is not None
    force, h, (n, nq) = made.values[:, j, 0], steps.step, made.q.shape
    rows, nothing = slice(*plan.contacts.rows.starts[j : j + 2]), np.zeros((n, nq))
    if not force.any():
        raise InputError(f"at: contact {plan.contacts.names[j]!r} never closes in this run")
    on_samples = np.zeros(n)
    if of == "peak_force":
        on_samples[force.argmax()] = 1.0
    elif of == "impulse":
        on_samples[:] = h
        on_samples[[0, -1]] = 0.5 * h
    else:
        value, by_q = _duration(j, plan, steps, made)
        return value, Weights(sp.csr_matrix(made.lam.shape), by_q, np.zeros(nq))
    closed = made.lam.copy()
    there = (closed.indices >= rows.start) & (closed.indices < rows.stop)
    closed.data = np.repeat(on_samples, np.diff(closed.indptr)) * there
    return float(on_samples @ force), Weights(closed, nothing, np.zeros(nq))


def _duration(j: int, plan: StepPlan, steps: EqualSteps, made: Histories) -> tuple[float, Array]:
    """Time in contact [s], and its derivatives by the coordinates of all samples, (n, nq)."""
    if plan.contacts.core:
        raise InputError("of: 'duration' is not known where contacts move each other; take another number")
    rows, (n, nq) = slice(*plan.contacts.rows.starts[j : j + 2]), made.q.shape
    H, by_q, total = row_jacobian(plan.contacts, nq)[rows], np.zeros((n, nq)), 0.0

    def crossing(inside: int, outside: int, sign: float) -> float:
        if not 0 <= outside < n:
            return sign * inside * steps.step
        gaps = [plan.contacts.rows.start[rows] + H @ made.q[s] for s in (inside, outside)]
        row_in, row_out = (int(gap.argmin()) for gap in gaps)
        g_in, g_out = float(gaps[0][row_in]), float(gaps[1][row_out])
        way, slope = (outside - inside) * steps.step, (g_in - g_out) ** 2
        by_q[inside] -= sign * way * g_out / slope * H[row_in]
        by_q[outside] += sign * way * g_in / slope * H[row_out]
        return sign * (inside * steps.step + way * g_in / (g_in - g_out))

    for first, last in closed_spans(made.values[:, j, 0]):
        total += crossing(last, last + 1, 1.0) + crossing(first, first - 1, -1.0)
    return total, by_q


def _of_body(
    of: str, item: PartitionBody, dofs: Array, direction: Array, plan: StepPlan, made: Histories
) -> tuple[float, Weights, Bodies | None]:
    """Number of a body at the end, its weights, and its derivatives by the bodies beside those by the motion."""
    assert made.lam is not None
    n, nq = made.q.shape
    q, v, by_q, by_v = made.q[-1], made.v[-1], np.zeros((n, nq)), np.zeros(nq)
    none = sp.csr_matrix(made.lam.shape)
    if of == "velocity":
        by_v[dofs] = direction @ item.kinematics.mass_integral / item.body.total_mass
        return float(by_v @ v), Weights(none, by_q, by_v), None
    mass, stiffness = np.zeros((2, nq))
    mass[dofs], stiffness[dofs] = 0.5 * v[dofs] ** 2, 0.5 * q[dofs] ** 2
    by_v[dofs], by_q[-1, dofs] = (plan.bodies.mass * v)[dofs], (plan.bodies.stiffness * q)[dofs]
    value = float(plan.bodies.mass @ mass + plan.bodies.stiffness @ stiffness)
    return value, Weights(none, by_q, by_v), Bodies(mass, stiffness, np.zeros(nq), np.zeros(nq))


def _by(
    item: PartitionBody,
    dofs: Array,
    plan: StepPlan,
    found: Derivatives,
    explicit: Bodies | None,
    contacts: Sequence[PartitionContact],
) -> dict[str, Array | float]:
    """Derivatives by what `run_many` varies of a body."""
    rigid, kinematics = item.body.rigid, item.kinematics
    mass, stiffness, damping, load = (part[dofs] for part in found.bodies)
    if explicit is not None:
        mass, stiffness = mass + explicit.mass[dofs], stiffness + explicit.stiffness[dofs]
    by_axes = np.array([kinematics.weight(axis) for axis in np.eye(3)])
    result: dict[str, Array | float] = {
        "initialVelocity": found.v[dofs] @ rigid[:, :3],
        "initialAngularVelocity": found.v[dofs] @ rigid[:, 3:],
        "referencePosition": found.q[dofs] @ rigid[:, :3],
        "gravity": by_axes @ load,
        "damping": float(damping_of(kinematics, 1.0).matrix().diagonal() @ damping),
    }
    read_only(*(value for value in result.values() if isinstance(value, np.ndarray)))
    material = item.body.material
    if material is None or callable(item.ratios):
        return result
    by_E, by_rho = damping_power(item.ratios)
    of_damping = float(plan.bodies.damping[dofs] @ damping)
    weight = np.zeros(len(dofs)) if item.weight is None else item.weight
    of_rho = float(plan.bodies.mass[dofs] @ mass + weight @ load) + by_rho * of_damping
    result["rho"] = of_rho / material.rho
    if not plan.contacts.core:
        sides = zip(contacts, found.flexibility, strict=True)
        of_sides = sum(
            part
            for contact, parts in sides
            for (side, _), part in zip(contact.sides, parts, strict=True)
            if side == item
        )
        result["E"] = (float(plan.bodies.stiffness[dofs] @ stiffness) + by_E * of_damping - of_sides) / material.E
    return result
