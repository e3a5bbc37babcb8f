"""Numbers that follow from a compiled run, and their derivatives by its steps, for `sensitivity`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..compiled.adjoint import OneNumber, Sums, Weights
from ..compiled.made_run import MadeRun, OnFriction
from ..compiled.plan import Bodies
from ..compiled.run import Histories
from ..errors import InputError
from ..frames.floating import FloatingKinematics
from ..frames.kinematics import Kinematics
from ..results.impacts import closed_spans
from ..support.arrays import Array


@dataclass(frozen=True, eq=False)
class Number:
    """Numbers that follow from a run.

    Parameters
    ----------
    values : (k,) array
    weights : Weights
    explicit : Bodies or None
        Derivatives of one number by the bodies, beside those by the motion, (nq,) each.
    """

    values: Array
    weights: Weights
    explicit: Bodies | None = None


def number_of_contact(of: str, j: int, run: MadeRun) -> Number:
    """Number of contact j.

    Raises
    ------
    InputError
        If it never closes, or its duration is not known.
    """
    made, contacts = run.histories, run.plan.contacts
    assert made.lam is not None
    force, h, (n, nq) = made.values[:, j, 0], run.steps.step, made.q.shape
    rows, nothing = slice(*contacts.all_starts[j : j + 2]), np.zeros((n, nq))
    if not force.any():
        raise InputError(f"at: contact {contacts.all_names[j]!r} never closes in this run")
    on_samples = _of_impulse(n, h)
    if of == "peak_force":
        on_samples = np.zeros(n)
        on_samples[force.argmax()] = 1.0
    elif of == "duration":
        value, by_q, by_turning = _duration(j, run)
        weights = OneNumber(sp.csr_matrix(made.lam.shape), by_q, np.zeros(nq), turning=by_turning)
        return Number(np.array([value]), weights)
    closed = made.lam.copy()
    there = (closed.indices >= rows.start) & (closed.indices < rows.stop)
    closed.data = np.repeat(on_samples, np.diff(closed.indptr)) * there
    return Number(np.array([on_samples @ force]), OneNumber(closed, nothing, np.zeros(nq)))


def _of_impulse(n: int, step: float) -> Array:
    """Weights of n samples in an integral over time [s]."""
    weights = np.full(n, step)
    weights[[0, -1]] = 0.5 * step
    return weights


def number_of_friction(of: str, contact: int, direction: Array, run: MadeRun) -> Number:
    """Number of a contact with friction, the place of which is among those with tangents.

    Raises
    ------
    InputError
        If the contact has no friction, or the direction is that of its normals.
    """
    plan, made = run.plan.contacts.friction, run.histories
    assert plan is not None
    n, nq = made.q.shape
    if plan.laws[contact] is None:
        raise InputError(f"at: for {of!r} expected a contact with friction, got {plan.names[contact]!r} without")
    rows, samples, along = slice(*plan.rows.starts[contact : contact + 2]), np.zeros(n), np.zeros((plan.n_rows, 2))
    taken, closed = np.zeros(plan.n_rows, dtype=bool), made.values[:, contact - len(plan.names), 1] > 0.0
    if of == "friction_impulse":
        samples, along[rows] = _of_impulse(n, run.steps.step), plan.tangents[rows] @ direction
        if abs(along).max(initial=0.0) < 1e-6 * np.linalg.norm(direction):
            raise InputError(
                f"direction: expected one along the surfaces of contact {plan.names[contact]!r} for {of!r}, got "
                f"{direction.tolist()}, which is that of its normals"
            )
        value = float(samples @ made.friction[:, contact, :3] @ direction)
    else:
        value, taken[rows] = float(made.friction[-1, contact, 5]), True
    weighted = OnFriction(samples, along, taken, closed)
    nothing = sp.csr_matrix((n, len(made.peaks.lam)))
    return Number(np.array([value]), OneNumber(nothing, np.zeros((n, nq)), np.zeros(nq), weighted))


def _duration(j: int, run: MadeRun) -> tuple[float, Array, Array]:
    """Time in contact [s], and its derivatives by coordinates of all samples and velocities of growth, (n, nq) each."""
    made, contacts, h = run.histories, run.plan.contacts, run.steps.step
    if contacts.move_each_other:
        raise InputError("of: 'duration' is not known where contacts move each other; take another number")
    n, nq = made.q.shape
    by_q, by_turning, total = np.zeros((n, nq)), np.zeros((n, nq)), 0.0

    def crossing(inside: int, outside: int, sign: float) -> float:
        if not 0 <= outside < n:
            return sign * inside * h
        (g_in, *of_in), (g_out, *of_out) = run.smallest_gap(j, inside), run.smallest_gap(j, outside)
        way, slope = (outside - inside) * h, (g_in - g_out) ** 2
        for by, gap_in, gap_out in zip((by_q, by_turning), of_in, of_out, strict=True):
            by[inside] -= sign * way * g_out / slope * gap_in
            by[outside] += sign * way * g_in / slope * gap_out
        return sign * (inside * h + way * g_in / (g_in - g_out))

    for first, last in closed_spans(made.values[:, j, 0]):
        total += crossing(last, last + 1, 1.0) + crossing(first, first - 1, -1.0)
    return total, by_q, by_turning


def energy_of_body(kinematics: Kinematics, dofs: Array, run: MadeRun) -> Number:
    """Kinetic and strain energy at the end of a body with these coordinates [J]."""
    made, bodies = run.histories, run.plan.bodies
    assert made.lam is not None
    (n, nq), q, v = made.q.shape, made.q[-1], made.v[-1]
    by_q, by_v, mass, stiffness = np.zeros((n, nq)), *np.zeros((3, nq))
    if isinstance(kinematics, FloatingKinematics):
        z, K = q[dofs[6:]], bodies.stiffness[dofs[6:]]
        by_z, by_v[dofs] = kinematics.kinetic_energy_by(z, v[dofs])
        by_q[-1, dofs[6:]] = by_z + K * z
        value = float(kinematics.kinetic_energy(q[dofs], v[dofs])) + 0.5 * float(K @ z**2)
        return Number(np.array([value]), OneNumber(sp.csr_matrix(made.lam.shape), by_q, by_v))
    mass[dofs], stiffness[dofs] = 0.5 * v[dofs] ** 2, 0.5 * q[dofs] ** 2
    by_v[dofs], by_q[-1, dofs] = (bodies.mass * v)[dofs], (bodies.stiffness * q)[dofs]
    value = float(bodies.mass @ mass + bodies.stiffness @ stiffness)
    weights = OneNumber(sp.csr_matrix(made.lam.shape), by_q, by_v)
    return Number(np.array([value]), weights, Bodies(mass, stiffness, np.zeros(nq), np.zeros(nq)))


def sums_of_history(history: Array, by_q: Array, by_v: Array, samples: Array, made: Histories) -> Number:
    """Sums over samples, (n, k), of a value, (n,), whose derivatives by coordinates and velocities are (n, nq) each."""
    assert made.lam is not None
    return Number(samples.T @ history, Sums(sp.csr_matrix(made.lam.shape), samples, by_q, by_v))


def at_times(times: Array, weights: Array | None, n: int, step: float) -> Array:
    """Weights of n samples, (n, k), in values at times, (k,) [s], or in sums of them, weights (k, m).

    Between two samples a value goes along a line.
    """
    first = np.minimum((times / step).astype(int), n - 2)
    share, number = times / step - first, np.arange(len(times))
    places = np.r_[number, number], np.r_[first, first + 1]
    lines = sp.csr_matrix((np.r_[1.0 - share, share], places), (len(times), n))
    return np.asarray((lines.toarray() if weights is None else weights @ lines).T)
