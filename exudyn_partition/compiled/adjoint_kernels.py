"""Compiled pass back over the samples of a run; `loops.go_back` and `friction_back` do the same by NumPy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba.experimental import structref

from ..support.arrays import Array
from ..support.compiled import compiled, external, inner, unlocked
from ..support.struct_kernels import StructType, define_struct

if TYPE_CHECKING:
    from .loops import Adjoint
    from .plan import Bodies

OPEN, STICK, SLIP = 0, 1, 2
_dgetrf = external("cython_lapack", "dgetrf", 6)


@structref.register
class BackType(StructType):
    """Type of `Back` in compiled loops."""


class Back(structref.StructRefProxy):
    """A `FrictionBack` as one object, with room.

    `given` and `total`, (k, 3 n), are derivatives by forces, without and with those by slips; `factors` and `pivots`
    those of the Jacobian of each group; `before`, (nq, k), derivatives by the coordinates of the sample before.
    """

    status: Array
    mu: Array
    push: Array
    along: Array
    across: Array
    yielding: Array
    F: Array
    B: Array
    groups: Array
    by_forces: Array
    by_speed: Array
    slips: Array
    by_mu: Array
    forces: Array
    mu_next: Array
    given: Array
    total: Array
    factors: Array
    pivots: Array
    before: Array


define_struct(Back, BackType, [*Back.__annotations__])


@compiled
def back_of(*fields: Array) -> Back:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return Back(*fields)  # type: ignore[no-untyped-call]


@inner
def set_jacobian(rows: Back, s: int, first: int, end: int, J: Array) -> None:
    """Set how the rows of a group move as their forces change, (m, m), see `friction_back`."""
    m, status, F, t, line = len(J), rows.status[s], rows.F, np.empty((3, len(J))), 0
    mu, along, across, yielding = rows.mu[s], rows.along[s], rows.across[s], rows.yielding[s]
    for i in range(first, end):
        if status[i] == OPEN:
            continue
        for a in range(3):
            of_F, place = F[3 * i + a], 0
            for j in range(first, end):
                u, v, w = of_F[3 * j], of_F[3 * j + 1], of_F[3 * j + 2]
                if status[j] == STICK:
                    t[a, place], t[a, place + 1], t[a, place + 2] = u, v, w
                    place += 3
                elif status[j] == SLIP:
                    d1, d2 = along[j, 0], along[j, 1]
                    t[a, place], t[a, place + 1] = u + mu[j] * (d1 * v + d2 * w), d1 * w - d2 * v
                    place += 2
        slips, d1, d2 = status[i] == SLIP, across[i] * along[i, 0], across[i] * along[i, 1]
        for j in range(m):
            J[line, j], J[line + 1, j] = t[0, j], d1 * t[2, j] - d2 * t[1, j] if slips else t[1, j]
            if not slips:
                J[line + 2, j] = t[2, j]
        if slips:
            J[line + 1, line + 1] += yielding[i]
        line += 2 if slips else 3


@inner
def solve_transposed(J: Array, pivots: Array, x: Array) -> None:
    """Solve J' x = x by LAPACK's factors of J'."""
    m = len(J)
    for i in range(m):
        x[i], x[pivots[i] - 1] = x[pivots[i] - 1], x[i]
    for i in range(m):
        push, column = x[i], J[i]
        for a in range(i + 1, m):
            x[a] -= column[a] * push
    for i in range(m - 1, -1, -1):
        column = J[i]
        x[i] /= column[i]
        push = x[i]
        for a in range(i):
            x[a] -= column[a] * push


@inner
def solve_group(rows: Back, s: int, first: int, end: int, J: Array, pivots: Array, kept: bool) -> None:
    """Take what the forces of a group do from the slips; `rows.total`, (k, 3 n), are the derivatives by the forces."""
    m, status, mu, along, across = len(J), rows.status[s], rows.mu[s], rows.along[s], rows.across[s]
    if not kept:
        set_jacobian(rows, s, first, end, J)
        numbers = np.array([m, 0], np.int32)
        size = numbers.ctypes.data
        _dgetrf(size, size, J.ctypes.data, size, pivots.ctypes.data, size + numbers.itemsize)
        pivots[0] -= numbers[1] > m  # which never is; the array must live until here
    x = np.empty(m)
    for j in range(len(rows.total)):
        place, given, slips = 0, rows.total[j], rows.slips[s, j]
        for i in range(first, end):
            u, v, w = given[3 * i], given[3 * i + 1], given[3 * i + 2]
            if status[i] == STICK:
                x[place], x[place + 1], x[place + 2] = u, v, w
                place += 3
            elif status[i] == SLIP:
                d1, d2 = along[i, 0], along[i, 1]
                x[place], x[place + 1] = u + mu[i] * (d1 * v + d2 * w), d1 * w - d2 * v
                place += 2
        solve_transposed(J, pivots, x)
        place = 0
        for i in range(first, end):
            if status[i] == STICK:
                for a in range(3):
                    slips[3 * i + a] -= x[place + a]
                place += 3
            elif status[i] == SLIP:
                share = across[i] * x[place + 1]
                slips[3 * i] -= x[place]
                slips[3 * i + 1] += share * along[i, 1]
                slips[3 * i + 2] -= share * along[i, 0]
                place += 2


@inner
def add_moved(rows: Back, s: int, first: int, end: int, given: Array, sign: float, normals: bool) -> None:
    """Add the flexibility of a group times the slips of a sample to what is given, (k, 3 n)."""
    F = rows.F
    for j in range(len(given)):
        slips, to = rows.slips[s, j], given[j]
        for i in range(3 * first, 3 * end):
            slip, column = sign * slips[i], F[i]
            if slip != 0.0 and (normals or i % 3 > 0):
                for a in range(3 * first, 3 * end):
                    to[a] += slip * column[a]


@inner
def solve_groups(rows: Back, s: int) -> None:
    """Set slips of a sample and what they leave to the sample before. Jacobians are kept while the same rows stick."""
    n, after = rows.status.shape[1], min(s + 1, len(rows.status) - 1)
    for g in range(len(rows.groups) - 1):
        first, end, m, kept = rows.groups[g], rows.groups[g + 1], 0, s < after
        for i in range(first, end):
            m += 3 if rows.status[s, i] == STICK else 2 if rows.status[s, i] == SLIP else 0
            kept = kept and rows.status[s, i] != SLIP and rows.status[s, i] == rows.status[after, i]
        add_moved(rows, s, first, end, rows.total, 1.0, True)
        if m > 0:
            J = rows.factors[9 * first * n :][: m * m].reshape(m, m)
            solve_group(rows, s, first, end, J, rows.pivots[3 * first :], kept)
        add_moved(rows, s, first, end, rows.given, 1.0, True)
        add_moved(rows, s, first, end, rows.forces, -1.0, False)


@inner
def take_coordinates(rows: Back, s: int, y: Array) -> None:
    """Set derivatives by the forces of a sample, and add those of the next coefficients to slips."""
    status, nq = rows.status[s], len(y)
    for j in range(len(rows.given)):
        slips, given, total, forces = rows.slips[s, j], rows.given[j], rows.total[j], rows.forces[j]
        for i in range(len(given)):
            row, push = rows.B[i], 0.0
            if status[i // 3] != OPEN:
                push = rows.by_forces[s, j, i] + forces[i]
                for a in range(nq):
                    push += row[a] * y[a, j]
            given[i] = total[i] = push
            forces[i] = 0.0
        for i in range(len(status)):
            for a in range(2):
                slips[3 * i + 1 + a] += rows.mu_next[j, i] * rows.by_speed[s, i, a]


@inner
def back_over_rows(rows: Back, s: int, y: Array, q: Array) -> None:
    """Go back over the forces of sample s, see `friction_back`: add derivatives by its coordinates, (nq, k), to q."""
    nq, before = len(y), rows.before
    take_coordinates(rows, s, y)
    solve_groups(rows, s)
    for j in range(len(rows.given)):
        given, slips = rows.given[j], rows.slips[s, j]
        for i in range(rows.mu_next.shape[1]):
            turned = given[3 * i + 1] * rows.along[s, i, 0] + given[3 * i + 2] * rows.along[s, i, 1]
            rows.by_mu[s, j, i] = rows.mu_next[j, i] = rows.push[s, i] * turned
        for a in range(nq):
            before[a, j] = 0.0
        for i in range(len(slips)):
            slip, row = slips[i], rows.B[i]
            if slip != 0.0:
                for a in range(nq):
                    q[a, j] += slip * row[a]
                    if i % 3 > 0:
                        before[a, j] += slip * row[a]


@unlocked
def go_back(
    bodies: Bodies,
    by_rows: Array,
    by_q: Array,
    by_v: Array,
    h: float,
    starts: bool,
    adjoint: Adjoint,
    rows: Back | None,
    y: Array,
) -> None:
    """Go back over the samples of a block, see `loops.go_back`. Without friction its part is not compiled."""
    q, u, v = adjoint.q, adjoint.u, adjoint.v
    n, k = q.shape
    for s in range(len(y) - 1, -1, -1):
        begins = starts and s == 0
        for i in range(n):
            share = 0.5 * h / bodies.mass[i]
            for j in range(k):
                v[i, j] += by_v[s, i, j]
                y[s, i, j] = share * (u[i, j] if begins else u[i, j] + v[i, j])
        for i in range(n):
            for j in range(k):
                q[i, j] += by_q[s, i, j] - bodies.stiffness[i] * y[s, i, j]
        for i in range(len(by_rows)):
            for m in range(n):
                factor = by_rows[i, m]
                for j in range(k):
                    q[i, j] -= factor * y[s, m, j]
        if rows is not None:
            back_over_rows(rows, s, y[s], q)
        for i in range(n):
            for j in range(k):
                v[i, j] -= bodies.damping[i] * y[s, i, j]
                if not begins:
                    v[i, j] += h * q[i, j]
                    u[i, j] = v[i, j]
        if rows is not None:
            for i in range(n):
                for j in range(k):
                    q[i, j] -= rows.before[i, j]
