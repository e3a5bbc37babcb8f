"""Compiled pass back over inertia forces and turns of floating frames; `frames_back` does the same by NumPy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numba.experimental import structref

from ..frames.kernels import angular_acceleration
from ..support.arrays import Array
from ..support.compiled import compiled, inlined, inner
from ..support.struct_kernels import StructType, define_struct
from .body_kernels import gathered
from .frames_back import FramesBack

if TYPE_CHECKING:
    from .plan import Bodies


@structref.register
class TurningType(StructType):
    """Type of `TurningBack` in compiled loops."""


class TurningBack(structref.StructRefProxy):
    """A `FramesBack` as one object."""


@structref.register
class PlaceType(StructType):
    """Type of `Place` in compiled loops."""


class Place(structref.StructRefProxy):
    """Inertia of a body at a deformation: see `frames_back._Place`, J by its components and C z', and room."""

    integrals: Array
    cross: Array
    tensor: Array
    by_place: Array
    J: Array
    C: Array
    nothing: Array
    J_by: Array
    C_by: Array


define_struct(TurningBack, TurningType, FramesBack._fields)
define_struct(Place, PlaceType, [*Place.__annotations__])


@compiled
def frames_of(*fields: Any) -> TurningBack:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return TurningBack(*fields)  # type: ignore[no-untyped-call]


@inner
def place_of(frames: FramesBack, s: int, b: int) -> Place:
    """Inertia of a body in a sample."""
    first, end = frames.places[b], frames.places[b + 1]
    n = end - first - 6
    integrals = frames.numbers[frames.integrals[b] :][: 6 * (n + 1) ** 2].reshape(6, n + 1, n + 1)
    cross = frames.numbers[frames.cross[b] :][: 3 * n * n].reshape(3, n, n)
    z, by_place, J, C = (
        gathered(frames.dofs, first + 6, end, frames.q[s]),
        np.empty((6, n)),
        np.empty(6),
        np.empty((3, n)),
    )
    for c in range(6):
        J[c] = integrals[c, 0, 0]
        for i in range(n):
            entry = integrals[c, i + 1, 0]
            for k in range(n):
                entry += integrals[c, i + 1, k + 1] * z[k]
            by_place[c, i] = entry
            J[c] += (entry + integrals[c, 0, i + 1]) * z[i]
    set_crossed(cross, z, -1.0, C)
    return Place(  # type: ignore[no-untyped-call]
        integrals, cross, frames.tensor[b], by_place, J, C, np.zeros(n), np.zeros((3, 3)), np.zeros((3, n))
    )


@inner
def set_crossed(cross: Array, z: Array, sign: float, result: Array) -> None:
    """Set the cross integrals of all shapes with the field of z, (3, n), times a sign."""
    for a in range(3):
        for i in range(len(z)):
            total = 0.0
            for k in range(len(z)):
                total += cross[a, i, k] * z[k]
            result[a, i] = sign * total


@inlined
def component(a: int, b: int) -> int:
    """Which of the six components an entry of a matrix is, see `inertia.PLACE`."""
    return a if a == b else 6 - a - b


@inner
def add_by_z(here: Place, result: Array) -> None:
    """Add derivatives by z, (n,), from those by J and C in its room, see `frames_back._Place`."""
    n, cross, by_place, J_by, C_by = here.C.shape[1], here.cross, here.by_place, here.J_by, here.C_by
    for a in range(3):
        for b in range(a + 1):
            share, c = 2 * (J_by[a, b] + J_by[b, a] if b < a else J_by[a, a]), component(a, b)
            for i in range(n):
                result[i] += share * by_place[c, i]
        for i in range(n):
            share = -C_by[a, i]
            for k in range(n):
                result[k] += share * cross[a, i, k]


@inner
def over_masses(here: Place, by: Array, torque: Array, force: Array, result: Array) -> None:
    """Set the adjoint of P by a torque and forces, (3 + n,), and that by J and C; see `frames_back._Place.on_mass`."""
    n, C, given, tensor, J_by, C_by = len(force), here.C, np.zeros(3), here.tensor, here.J_by, here.C_by
    for a in range(3):
        for b in range(3):
            given[a] += tensor[a, b] * by[b]
        for i in range(n):
            given[a] -= C[a, i] * by[3 + i]
    omega_t = angular_acceleration(here.J, C, torque, force)
    mu = angular_acceleration(here.J, C, given, here.nothing)
    for a in range(3):
        result[a] = mu[a]
        for b in range(3):
            J_by[a, b] = -mu[a] * omega_t[b]
    for i in range(n):
        on_mu, on_omega = 0.0, 0.0
        for a in range(3):
            on_mu += mu[a] * C[a, i]
            on_omega += omega_t[a] * C[a, i]
        for a in range(3):
            C_by[a, i] = mu[a] * (on_omega - force[i]) + omega_t[a] * (on_mu - by[3 + i])
        result[3 + i] = by[3 + i] - on_mu


@inner
def cross_product(u: Array, v: Array, result: Array) -> None:
    """Set the vector product of two vectors."""
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        result[a] = u[b] * v[c] - u[c] * v[b]


@inner
def over_force(
    here: Place, v: Array, crossed: Array, y: Array, z: Array, stiffness: Array, coupled: bool, by_z: Array, by_v: Array
) -> None:
    """Set derivatives by z, (n,), and velocities, (3 + n,), of inertia forces; see `frames_back._over_force`.

    `crossed`, (3, n), are the cross integrals with z's velocities.
    """
    n, b, C, J, J_by, C_by = len(z), here.by_place, here.C, here.J, here.J_by, here.C_by
    cross, integrals = here.cross, here.integrals
    omega, J_t, L, s, weights = v[:3], np.zeros(6), np.zeros(3), np.empty(6), np.empty(6)
    for c in range(6):
        for i in range(n):
            J_t[c] += 2 * b[c, i] * v[3 + i]
    for a in range(3):
        for k in range(3):
            L[a] += J[component(a, k)] * omega[k]
        for i in range(n):
            L[a] += C[a, i] * v[3 + i]
    p, q, r = omega
    weights[0], weights[1], weights[2] = p * p, q * q, r * r
    weights[3], weights[4], weights[5] = 2 * q * r, 2 * p * r, 2 * p * q
    by = y
    for i in range(n):
        by_z[i] = 0.0
    for a in range(3):
        for k in range(3):
            J_by[a, k] = 0.0
        for i in range(n):
            C_by[a, i] = 0.0
    if coupled:
        torque, force, by = np.empty(3), np.empty(n), np.empty(3 + n)
        cross_product(L, omega, torque)
        for a in range(3):
            for k in range(3):
                torque[a] -= J_t[component(a, k)] * omega[k]
        for i in range(n):
            force[i] = -stiffness[i] * z[i]
            for a in range(3):
                force[i] += 2 * omega[a] * crossed[a, i]
            for c in range(6):
                force[i] += weights[c] * b[c, i]
        over_masses(here, y, torque, force, by)
        for i in range(n):
            by_z[i] = stiffness[i] * (y[3 + i] - by[3 + i])
    of_torque, of_force = by[:3], by[3:]
    of_L, of_omega, stretch = np.empty(3), np.empty(3), np.zeros(6)
    cross_product(omega, of_torque, of_L)
    cross_product(of_torque, L, of_omega)
    for c in range(6):
        s[c] = 0.0
        for i in range(n):
            s[c] += b[c, i] * of_force[i]
    for a in range(3):
        by_v[a] = of_omega[a]
        for k in range(3):
            c = component(a, k)
            by_v[a] += J[c] * of_L[k] - J_t[c] * of_torque[k] + 2 * s[c] * omega[k]
            J_by[a, k] += of_L[a] * omega[k]
            stretch[c] -= of_torque[a] * omega[k]
        for i in range(n):
            by_v[a] += 2 * crossed[a, i] * of_force[i]
            C_by[a, i] += of_L[a] * v[3 + i]
    for i in range(n):
        total = 0.0
        for a in range(3):
            total += of_L[a] * C[a, i]
        for c in range(6):
            total += 2 * stretch[c] * b[c, i]
        by_v[3 + i] = total
    for i in range(n):
        twice = 2 * of_force[i]
        for a in range(3):
            share = twice * omega[a]
            for k in range(n):
                by_v[3 + k] += share * cross[a, i, k]
        for c in range(6):
            share = 2 * stretch[c] * v[3 + i] + weights[c] * of_force[i]
            for k in range(n):
                by_z[k] += share * integrals[c, i + 1, k + 1]
    add_by_z(here, by_z)


@inner
def complete(frames: FramesBack, b: int, bodies: Bodies, y: Array) -> None:
    """Complete the adjoint of accelerations over masses, (k, nq), of a body; see `frames_back.back_over_inertia`."""
    first, end, turn, dofs, of_a = frames.places[b], frames.places[b + 1], np.empty(3), frames.dofs, frames.a
    inverse = frames.inverse[b]
    for j in range(len(y)):
        for i in range(first, end):
            dof = dofs[i]
            y[j, dof] += of_a[j, dof] / bodies.mass[dof]
            of_a[j, dof] = 0.0
        for a in range(3):
            turn[a] = 0.0
            for k in range(3):
                dof = dofs[first + 3 + k]
                turn[a] += inverse[k, a] * bodies.mass[dof] * y[j, dof]
        for a in range(3):
            y[j, dofs[first + 3 + a]] = turn[a]


@inner
def end_of_step(
    frames: FramesBack, s: int, b: int, cross: Array, stiffness: Array, half_step: float
) -> tuple[Array, Array, Array]:
    """Velocities with which inertia forces are found, (3 + n,), angular velocity before, and cross integrals (3, n).

    The integrals are those with what shapes gain in the step; see `frames.kernels.end_velocities`.
    """
    first, end, dofs = frames.places[b] + 3, frames.places[b + 1], frames.dofs
    n, q, q_before, v_before = end - first - 3, frames.q[s], frames.q_before[s], frames.v_before[s]
    v, a_before = (
        gathered(frames.dofs, first, end, frames.turning[s]),
        gathered(frames.dofs, first, end, frames.a_before[s]),
    )
    gained, of_gained = np.empty(n), np.zeros((3, n))
    for i in range(3 + n):
        v[i] += half_step * a_before[i]
    for i in range(n):
        dof = dofs[first + 3 + i]
        v[3 + i] -= half_step * stiffness[i] * (q[dof] - q_before[dof])
        gained[i] = v[3 + i] - v_before[dof]
    if half_step > 0.0:
        set_crossed(cross, gained, 1.0, of_gained)
        for i in range(n):
            for a in range(3):
                v[3 + i] += 2 * half_step * v[a] * of_gained[a, i]
    return v, v[:3].copy(), of_gained


@inner
def back_over_inertia(
    frames: FramesBack, s: int, y: Array, q: Array, bodies: Bodies, half_step: float, touches: bool
) -> None:
    """See `frames_back.back_over_inertia`; adds to q, (k, nq). If contacts have forces, see `push_masses` there too."""
    u, q_then, v_then, given = frames.u, frames.q_then, frames.v_then, frames.by_turning[s]
    pushed, moved = frames.pushed, frames.moved
    for j in range(len(y)):
        for i in range(y.shape[1]):
            u[j, i], q_then[j, i], v_then[j, i] = given[j, i], 0.0, 0.0
    for b in range(len(frames.node_axes)):
        complete(frames, b, bodies, y)
    for j in range(len(y) if touches else 0):
        for i in range(y.shape[1]):
            pushed[j, i], moved[j, i] = y[j, i], 0.0
    for b in range(len(frames.node_axes)):
        here = place_of(frames, s, b)
        over_inertia(frames, here, s, b, y, q, bodies, half_step)
        if touches:
            push_masses(frames, here, s, b, y)


@inner
def over_inertia(
    frames: FramesBack, here: Place, s: int, b: int, y: Array, q: Array, bodies: Bodies, half_step: float
) -> None:
    """Go back over the inertia forces of a body."""
    first, end, dofs, cross = frames.places[b] + 3, frames.places[b + 1], frames.dofs, here.cross
    of_u, of_a, v_then, q_then = frames.u, frames.a, frames.v_then, frames.q_then
    stiffness = gathered(dofs, first + 3, end, bodies.stiffness)
    n, z = end - first - 3, gathered(dofs, first + 3, end, frames.q[s])
    v, omega, of_gained = end_of_step(frames, s, b, cross, stiffness, half_step)
    crossed, by_z, by_v, by_gained = np.empty((3, n)), np.empty(n), np.empty(3 + n), np.zeros(n)
    set_crossed(cross, v[3:], 1.0, crossed)
    for j in range(len(y)):
        own = gathered(dofs, first, end, y[j])
        over_force(here, v, crossed, own, z, stiffness, frames.coupled[b], by_z, by_v)
        for i in range(n):
            by_gained[i] = 0.0
        for i in range(n if half_step > 0.0 else 0):
            twice = 2 * half_step * by_v[3 + i]
            for a in range(3):
                share = twice * omega[a]
                by_v[a] += twice * of_gained[a, i]
                for k in range(n):
                    by_gained[k] += share * cross[a, i, k]
        for i in range(3):
            dof = dofs[first + i]
            of_u[j, dof] += by_v[i]
            of_a[j, dof] = half_step * by_v[i]
        for i in range(n):
            dof, total = dofs[first + 3 + i], by_v[3 + i] + by_gained[i]
            elastic = half_step * stiffness[i] * total
            of_u[j, dof] += total
            of_a[j, dof] = half_step * total
            v_then[j, dof] -= by_gained[i]
            q_then[j, dof] += elastic
            q[j, dof] += by_z[i] - elastic


@inner
def push_masses(frames: FramesBack, here: Place, s: int, b: int, y: Array) -> None:
    """See `frames_back.push_masses`, of a body."""
    first, end, axes, dofs = frames.places[b], frames.places[b + 1], frames.axes[s, b], frames.dofs
    pushed, moved = frames.pushed, frames.moved
    for j in range(len(y)):
        for a in range(3):
            total = 0.0
            for k in range(3):
                total += axes[k, a] * y[j, dofs[first + k]]
            pushed[j, dofs[first + a]] = total
    if not frames.constant[b]:
        force = gathered(dofs, first + 3, end, frames.force)
        found, by_z = np.empty(len(force)), np.empty(len(force) - 3)
        for j in range(len(y)):
            over_masses(here, gathered(dofs, first + 3, end, y[j]), force[:3], force[3:], found)
            for i in range(len(by_z)):
                by_z[i] = 0.0
            add_by_z(here, by_z)
            for i in range(len(found)):
                pushed[j, dofs[first + 3 + i]] = found[i]
            for i in range(len(by_z)):
                moved[j, dofs[first + 6 + i]] += by_z[i]


@inner
def turn_back(frames: FramesBack, s: int, h: float, q: Array, v: Array) -> None:
    """See `frames_back.turn_back`."""
    turn, dofs = np.empty(3), frames.dofs
    for b in range(len(frames.node_axes)):
        first, turns, ways = frames.places[b] + 3, frames.turns[s, b], frames.ways[s, b]
        for j in range(len(q)):
            for a in range(3):
                turn[a] = q[j, dofs[first + a]]
            for a in range(3):
                before, way = 0.0, 0.0
                for k in range(3):
                    before += turns[a, k] * turn[k]
                    way += ways[k, a] * turn[k]
                dof = dofs[first + a]
                q[j, dof] = before
                v[j, dof] += h * (way - before)


@inner
def add_growth(frames: FramesBack, s: int, b: int, j: int, by_products: Array) -> None:
    """Add derivatives by the angular velocity from those by its products, (6,), see `frames_back.by_growth`."""
    first, axes, omega, grows = frames.places[b] + 3, frames.node_axes[b], np.zeros(3), False
    for c in range(6):
        grows |= frames.products[s, b, c] != 0.0
    if not grows:
        return
    for a in range(3):
        for k in range(3):
            omega[a] += axes[a, k] * frames.turning[s, frames.dofs[first + k]]
    for a in range(3):
        total = 0.0
        for k in range(3):
            total += by_products[component(a, k)] * omega[k] * (2.0 if a == k else 1.0)
        for k in range(3):
            frames.u[j, frames.dofs[first + k]] += total * axes[a, k]
