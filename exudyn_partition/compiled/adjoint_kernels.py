"""Compiled pass back over the samples of a run; `loops.go_back` and `friction_back` do the same by NumPy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..support.arrays import Array
from ..support.compiled import external, inner, unlocked

if TYPE_CHECKING:
    from .friction_back import FrictionBack
    from .loops import Adjoint
    from .plan import Bodies

OPEN, STICK, SLIP = 0, 1, 2
_dgetrf = external("cython_lapack", "dgetrf", 6)


@inner
def set_jacobian(rows: FrictionBack, s: int, first: int, end: int, J: Array) -> None:
    """Set how the rows of a group move as their forces change, (m, m), and factorise its transpose, see `_ways`."""
    m, status, t = len(J), rows.status[s], np.empty((3, len(J)))
    line = 0
    for i in range(first, end):
        if status[i] == OPEN:
            continue
        for a in range(3):
            of_F, place = rows.F[3 * i + a], 0
            for j in range(first, end):
                u, v, w = of_F[3 * j], of_F[3 * j + 1], of_F[3 * j + 2]
                if status[j] == STICK:
                    t[a, place], t[a, place + 1], t[a, place + 2] = u, v, w
                    place += 3
                elif status[j] == SLIP:
                    d1, d2 = rows.along[s, j, 0], rows.along[s, j, 1]
                    t[a, place], t[a, place + 1] = u + rows.mu[s, j] * (d1 * v + d2 * w), d1 * w - d2 * v
                    place += 2
        if status[i] == STICK:
            for a in range(3):
                for j in range(m):
                    J[line + a, j] = t[a, j]
            line += 3
        else:
            d1, d2 = rows.across[s, i] * rows.along[s, i, 0], rows.across[s, i] * rows.along[s, i, 1]
            for j in range(m):
                J[line, j], J[line + 1, j] = t[0, j], d1 * t[2, j] - d2 * t[1, j]
            J[line + 1, line + 1] += rows.yielding[s, i]
            line += 2


@inner
def solve_group(
    rows: FrictionBack, s: int, first: int, end: int, given: Array, J: Array, pivots: Array, kept: bool
) -> None:
    """Take what the forces of a group do from the slips; `given`, (k, 3 n), are the derivatives by the forces."""
    m, status, slips = len(J), rows.status[s], rows.slips[s]
    if not kept:
        set_jacobian(rows, s, first, end, J)
        numbers = np.array([m, 0], np.int32)
        size = numbers.ctypes.data
        _dgetrf(size, size, J.ctypes.data, size, pivots.ctypes.data, size + numbers.itemsize)
        pivots[0] -= numbers[1] > m  # which never is; the array must live until here
    x = np.empty(m)
    for j in range(len(given)):
        place, of_number = 0, given[j]
        for i in range(first, end):
            u, v, w = of_number[3 * i], of_number[3 * i + 1], of_number[3 * i + 2]
            if status[i] == STICK:
                x[place], x[place + 1], x[place + 2] = u, v, w
                place += 3
            elif status[i] == SLIP:
                d1, d2 = rows.along[s, i, 0], rows.along[s, i, 1]
                x[place], x[place + 1] = u + rows.mu[s, i] * (d1 * v + d2 * w), d1 * w - d2 * v
                place += 2
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
        place = 0
        for i in range(first, end):
            if status[i] == STICK:
                for a in range(3):
                    slips[j, 3 * i + a] -= x[place + a]
                place += 3
            elif status[i] == SLIP:
                share = rows.across[s, i] * x[place + 1]
                slips[j, 3 * i] -= x[place]
                slips[j, 3 * i + 1] += share * rows.along[s, i, 1]
                slips[j, 3 * i + 2] -= share * rows.along[s, i, 0]
                place += 2


@inner
def add_moved(rows: FrictionBack, s: int, first: int, end: int, given: Array, sign: float, normals: bool) -> None:
    """Add the flexibility of a group times the slips of a sample to what is given, (k, 3 n)."""
    slips = rows.slips[s]
    for j in range(len(given)):
        for i in range(3 * first, 3 * end):
            slip, column = sign * slips[j, i], rows.F[i]
            if slip != 0.0 and (normals or i % 3 > 0):
                for a in range(3 * first, 3 * end):
                    given[j, a] += slip * column[a]


@inner
def group_of(rows: FrictionBack, s: int, first: int, end: int) -> tuple[int, bool, bool]:
    """How many forces of a group may change, whether all closed rows stick, and whether they are those of s + 1."""
    m, sticks, same, status, after = 0, True, s + 1 < len(rows.status), rows.status[s], min(s + 1, len(rows.status) - 1)
    for i in range(first, end):
        m += 3 if status[i] == STICK else 2 if status[i] == SLIP else 0
        sticks = sticks and status[i] != SLIP
        same = same and status[i] == rows.status[after, i]
    return m, sticks, same


@inner
def solve_groups(rows: FrictionBack, s: int, given: Array, total: Array, factors: Array, pivots: Array) -> None:
    """Set slips of a sample and what they leave to the sample before; `given` are derivatives by forces, (k, 3 n).

    `factors` has the Jacobian of each group, which is kept while the same rows stick.
    """
    n, k = rows.status.shape[1], len(given)
    for g in range(len(rows.groups) - 1):
        first, end = rows.groups[g], rows.groups[g + 1]
        m, sticks, same = group_of(rows, s, first, end)
        add_moved(rows, s, first, end, total, 1.0, True)
        if m > 0:
            J = factors[9 * first * n :][: m * m].reshape(m, m)
            solve_group(rows, s, first, end, total, J, pivots[3 * first :], sticks and same)
        for j in range(k):
            for i in range(3 * first, 3 * end):
                rows.forces[j, i] = 0.0
        add_moved(rows, s, first, end, given, 1.0, True)
        add_moved(rows, s, first, end, rows.forces, -1.0, False)


@inner
def add_to_coordinates(rows: FrictionBack, s: int, q: Array, before: Array) -> None:
    """Add derivatives by coordinates, (nq, k), and set those of the sample before, see `friction_back`."""
    for j in range(q.shape[1]):
        for i in range(len(rows.B)):
            slip, row = rows.slips[s, j, i], rows.B[i]
            if slip != 0.0:
                for a in range(len(q)):
                    q[a, j] += slip * row[a]
                    if i % 3 > 0:
                        before[a, j] += slip * row[a]


@inner
def back_over_rows(
    rows: FrictionBack, s: int, y: Array, factors: Array, pivots: Array, q: Array, before: Array
) -> None:
    """Go back over the forces of sample s, see `friction_back`; derivatives by coordinates are added and set."""
    n, (k, size), nq = rows.status.shape[1], rows.forces.shape, len(y)
    given, total, status, slips = np.zeros((k, size)), np.zeros((k, size)), rows.status[s], rows.slips[s]
    closed = False
    for i in range(n):
        closed = closed or status[i] != OPEN
    for j in range(k):
        for a in range(nq):
            before[a, j] = 0.0
        for i in range(size):
            row, push = rows.B[i], 0.0
            if status[i // 3] != OPEN:
                push = rows.by_forces[s, j, i] + rows.forces[j, i]
                for a in range(nq):
                    push += row[a] * y[a, j]
            given[j, i] = total[j, i] = push
        for i in range(n):
            for a in range(2):
                slips[j, 3 * i + 1 + a] += rows.mu_next[j, i] * rows.by_speed[s, i, a]
    if closed:
        solve_groups(rows, s, given, total, factors, pivots)
        add_to_coordinates(rows, s, q, before)
    for j in range(k):
        for i in range(n):
            turned = given[j, 3 * i + 1] * rows.along[s, i, 0] + given[j, 3 * i + 2] * rows.along[s, i, 1]
            rows.by_mu[s, j, i] = rows.mu_next[j, i] = rows.push[s, i] * turned
        for i in range(0 if closed else size):
            rows.forces[j, i] = 0.0


@unlocked
def go_back(
    bodies: Bodies,
    by_rows: Array,
    by_q: Array,
    by_v: Array,
    h: float,
    starts: bool,
    adjoint: Adjoint,
    rows: FrictionBack | None,
    y: Array,
) -> None:
    """Go back over the samples of a block, see `loops.go_back`. Without friction its part is not compiled."""
    q, u, v = adjoint.q, adjoint.u, adjoint.v
    n, k = q.shape
    before = np.zeros((n, k))
    if rows is not None:
        size = rows.F.shape[0]
        factors, pivots = np.empty(size * size), np.empty(size, np.int32)
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
            back_over_rows(rows, s, y[s], factors, pivots, q, before)
        for i in range(n):
            for j in range(k):
                v[i, j] -= bodies.damping[i] * y[s, i, j]
                if not begins:
                    v[i, j] += h * q[i, j]
                    u[i, j] = v[i, j]
                q[i, j] -= before[i, j]
