"""Compiled loops of contact with friction; `friction` does the same by NumPy and LAPACK."""

from __future__ import annotations

import numpy as np
from numba.experimental import structref

from ..support.arrays import Array
from ..support.compiled import compiled, external, inner
from ..support.struct_kernels import StructType, define_struct
from .product_kernels import matrix_at

FrictionLimits = tuple[float, float, float, int, int]  # see `flat_friction.FRICTION_LIMITS`

N_ROWS, N_CLOSED, STALE, STEPS, ITERATIONS, FACTORISATIONS = range(6)  # see `flat_friction`
N_COUNTS = 6
OPEN, STICK, SLIP = 0, 1, 2
_dgetrf = external("cython_lapack", "dgetrf", 6)


@structref.register
class FrictionObjectType(StructType):
    """Type of `FrictionObject` in compiled loops."""


class FrictionObject(structref.StructRefProxy):
    """A `FlatFriction` as one object: to pass each of its arrays takes long, and longer to compile."""

    counts: Array
    F: Array
    inverse: Array
    state: Array
    lam: Array
    closed: Array
    place: Array
    scaled: Array
    factors: Array
    pivots: Array
    factorised: Array
    h: Array
    value: Array
    forces: Array
    step: Array
    mu: Array
    x1: Array
    x2: Array
    length: Array
    bound: Array
    moves: Array
    squares: Array


define_struct(FrictionObject, FrictionObjectType, [*FrictionObject.__annotations__])


@compiled
def friction_object(*arrays: Array) -> FrictionObject:
    """Make one of its arrays; unlike its own constructor, this is kept on disk."""
    return FrictionObject(*arrays)  # type: ignore[no-untyped-call]


@inner
def turn_to(p: FrictionObject, pool: FrictionObject, number: int, row: int, square: int, k: int, chord: int) -> None:
    """Take the problem with a number out of `FlatFriction.pool`: k rows, after so many rows, and entries of F."""
    m = chord + 2
    p.counts = pool.counts[N_COUNTS * number : N_COUNTS * (number + 1)]
    p.F = pool.F[square : square + 9 * k * k]
    p.scaled = pool.scaled[square : square + 9 * k * k]
    p.factors = pool.factors[square : square + 9 * k * k]
    p.inverse = pool.inverse[3 * row : 3 * (row + k)]
    p.lam = pool.lam[3 * row : 3 * (row + k)]
    p.pivots = pool.pivots[3 * row : 3 * (row + k)]
    p.h = pool.h[3 * row : 3 * (row + k)]
    p.value = pool.value[3 * row : 3 * (row + k)]
    p.forces = pool.forces[3 * row : 3 * (row + k)]
    p.step = pool.step[3 * row : 3 * (row + k)]
    p.state = pool.state[row : row + k]
    p.closed = pool.closed[row : row + k]
    p.place = pool.place[row : row + k]
    p.factorised = pool.factorised[row : row + k]
    p.mu = pool.mu[row : row + k]
    p.x1 = pool.x1[row : row + k]
    p.x2 = pool.x2[row : row + k]
    p.length = pool.length[row : row + k]
    p.bound = pool.bound[row : row + k]
    p.moves = pool.moves[3 * m * row : 3 * m * (row + k)]
    p.squares = pool.squares[m * number : m * (number + 1)]


@inner
def law_of(value: Array, lam: Array, mu: Array, x1: Array, x2: Array, length: Array, bound: Array) -> float:
    """Replace places h + F lambda by the forces that the law leaves unbalanced, see `friction_residual`."""
    largest = 0.0
    for i in range(len(mu)):
        k = 3 * i
        x1[i], x2[i] = lam[k + 1] - value[k + 1], lam[k + 2] - value[k + 2]
        length[i] = np.sqrt(x1[i] * x1[i] + x2[i] * x2[i])
        bound[i] = mu[i] * max(lam[k], 0.0)
        share = min(1.0, bound[i] / (length[i] + 1e-300))
        value[k + 1], value[k + 2] = lam[k + 1] - share * x1[i], lam[k + 2] - share * x2[i]
        largest = max(largest, abs(value[k]), abs(value[k + 1]), abs(value[k + 2]))
    return largest


@compiled
def friction_residual(places: Array, lam: Array, mu: Array) -> tuple[Array, Array, Array, Array, Array, float]:
    """Forces that the law of friction leaves unbalanced, see `closed_rows.ClosedRows.residual`.

    Parameters
    ----------
    places : (3 na,) array
        h + F lambda, scaled to forces.
    lam : (3 na,) array
    mu : (na,) array

    Returns
    -------
    Unbalanced forces, (3 na,), trial forces along both tangents, their length, their bound, (na,) each, and the largest
    unbalanced force.
    """
    n, value = len(mu), places.copy()
    x1, x2, length, bound = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    largest = law_of(value, lam, mu, x1, x2, length, bound)
    return value, x1, x2, length, bound, largest


@inner
def corrected_chord(
    factors: Array, pivots: Array, value: Array, moves: Array, squares: Array, count: int, x: Array
) -> float:
    """Set x to the step of `chord_step`; return its largest entry."""
    n = len(value)
    for i in range(n):
        x[i] = -value[i]
    for j in range(n):
        x[j], x[pivots[j]] = x[pivots[j]], x[j]
    for j in range(n):
        for i in range(j + 1, n):
            x[i] -= factors[j, i] * x[j]
    for j in range(n - 1, -1, -1):
        x[j] /= factors[j, j]
        for i in range(j):
            x[i] -= factors[j, i] * x[j]
    for m in range(count):
        share = 0.0
        for i in range(n):
            share += moves[m, i] * x[i]
        share /= squares[m]
        for i in range(n):
            x[i] = x[i] + share * moves[m + 1, i] if m + 1 < count else x[i] / (1.0 - share)
    square, largest = 0.0, 0.0
    for i in range(n):
        moves[count, i] = x[i]
        square += x[i] * x[i]
        largest = max(largest, abs(x[i]))
    squares[count] = square
    return largest


@compiled
def chord_step(
    factors: Array, pivots: Array, value: Array, moves: Array, squares: Array, count: int
) -> tuple[Array, float]:
    """Newton step by LU factors of LAPACK, transposed, corrected by the steps before, see `ClosedRows.step`.

    It is kept in `moves`, and returned with its largest entry.
    """
    x = np.empty(len(value))
    return x, corrected_chord(factors, pivots, value, moves, squares, count, x)


@inner
def close_rows(p: FrictionObject) -> None:
    """Take the rows that are in `closed`, as many as the counts say."""
    n, na = p.counts[N_ROWS], p.counts[N_CLOSED]
    F, scaled = matrix_at(p.F, 0, 3 * n, 3 * n), matrix_at(p.scaled, 0, 3 * na, 3 * na)
    for row in range(n):
        p.place[row] = -1
    for i in range(na):
        p.place[p.closed[i]] = i
    for j in range(na):
        for b in range(3):
            of_F, of_scaled = F[3 * p.closed[j] + b], scaled[3 * j + b]
            for i in range(na):
                k = 3 * p.closed[i]
                for a in range(3):
                    of_scaled[3 * i + a] = p.inverse[k + a] * of_F[k + a]
    p.counts[STALE], p.counts[STEPS] = 1, 0


@inner
def close_by_state(p: FrictionObject) -> None:
    """Take the rows whose state is not open."""
    na = 0
    for row in range(p.counts[N_ROWS]):
        if p.state[row] != OPEN:
            p.closed[na] = row
            na += 1
    p.counts[N_CLOSED] = na
    close_rows(p)


@inner
def residual(p: FrictionObject) -> float:
    """Largest force that the law leaves unbalanced."""
    na = p.counts[N_CLOSED]
    scaled, value = matrix_at(p.scaled, 0, 3 * na, 3 * na), p.value[: 3 * na]
    for i in range(3 * na):
        value[i] = p.h[i]
    for j in range(3 * na):
        push, column = p.forces[j], scaled[j]
        if push != 0.0:
            for i in range(3 * na):
                value[i] += push * column[i]
    return law_of(value, p.forces, p.mu[:na], p.x1, p.x2, p.length, p.bound)


@inner
def load(p: FrictionObject, h: Array, mu: Array) -> float:
    """Take the problem for the closed rows, with their last forces; return the largest residual."""
    p.counts[STEPS] = 0
    for i in range(p.counts[N_CLOSED]):
        row = p.closed[i]
        p.mu[i] = mu[row]
        for a in range(3):
            p.h[3 * i + a] = p.inverse[3 * row + a] * h[row, a]
            p.forces[3 * i + a] = p.lam[3 * row + a]
    return residual(p)


@inner
def factorise(p: FrictionObject) -> None:
    """Factorise the Jacobian at the last residual; unless forces were guessed, all rows stick."""
    na, guessed = p.counts[N_CLOSED], False
    m = 3 * na
    for i in range(m):
        guessed = guessed or p.forces[i] != 0.0
    J, scaled = matrix_at(p.factors, 0, m, m), p.scaled
    for i in range(m * m):
        p.factors[i] = scaled[i]
    for i in range(na):
        p.factorised[i] = guessed and p.length[i] > p.bound[i]
    for j in range(m):
        column = J[j]
        for i in range(na):
            if p.factorised[i]:
                k, d1, d2 = 3 * i, p.x1[i] / p.length[i], p.x2[i] / p.length[i]
                turned = p.bound[i] / p.length[i] * (d1 * column[k + 2] - d2 * column[k + 1])
                column[k + 1], column[k + 2] = -d2 * turned, d1 * turned
    for i in range(na):
        if p.factorised[i]:
            k, d1, d2, c = 3 * i, p.x1[i] / p.length[i], p.x2[i] / p.length[i], p.bound[i] / p.length[i]
            J[k + 1, k + 1] += d1 * d1 + (1.0 - c) * d2 * d2
            J[k + 2, k + 2] += d2 * d2 + (1.0 - c) * d1 * d1
            J[k + 2, k + 1] += c * d1 * d2
            J[k + 1, k + 2] += c * d1 * d2
            J[k, k + 1] -= d1 * p.mu[i]
            J[k, k + 2] -= d2 * p.mu[i]
    numbers = np.array([m, 0], np.int32)
    size = numbers.ctypes.data
    _dgetrf(size, size, p.factors.ctypes.data, size, p.pivots.ctypes.data, size + numbers.itemsize)
    for i in range(m):
        p.pivots[i] -= 1
    p.counts[STALE], p.counts[STEPS] = numbers[1] < 0, 0  # which never is; the array must live until here
    p.counts[FACTORISATIONS] += 1


@inner
def keep_forces(p: FrictionObject) -> None:
    """Keep the forces, and the states that they show."""
    for row in range(p.counts[N_ROWS]):
        i = p.place[row]
        if i < 0:
            p.state[row] = OPEN
        else:
            p.state[row] = SLIP if p.length[i] > p.bound[i] else STICK
        for a in range(3):
            p.lam[3 * row + a] = 0.0 if i < 0 else p.forces[3 * i + a]


@inner
def exchange(p: FrictionObject, h: Array, leaves: float, enters: float) -> bool:
    """Open closed rows whose forces are below a bound, close rows whose gaps are; whether there were any.

    Not all are opened.
    """
    n, na, some, left = p.counts[N_ROWS], p.counts[N_CLOSED], False, False
    F, state = matrix_at(p.F, 0, 3 * n, 3 * n), np.empty(n, np.int8)
    for row in range(n):
        i = p.place[row]
        if i >= 0:
            state[row] = OPEN if p.forces[3 * i] < leaves else STICK
            some = some or state[row] == OPEN
        else:
            gap, of_row = h[row, 0], F[3 * row]
            for j in range(na):
                k = 3 * p.closed[j]
                for a in range(3):
                    gap += of_row[k + a] * p.forces[3 * j + a]
            state[row] = STICK if gap < enters else OPEN
            some = some or state[row] == STICK
        left = left or state[row] == STICK
    if not some:
        return False
    keep_forces(p)
    for row in range(n):
        if not left and h[row, 0] < 0.0:
            p.state[row] = STICK
        elif state[row] == OPEN:
            p.state[row] = OPEN
        elif p.state[row] == OPEN:
            p.state[row] = STICK
        if state[row] == OPEN:
            for a in range(3):
                p.lam[3 * row + a] = 0.0
    close_by_state(p)
    return True


@inner
def bring_within_law(p: FrictionObject) -> None:
    """Take from forces the rounding by which they are beyond the law."""
    for i in range(p.counts[N_CLOSED]):
        k = 3 * i
        p.forces[k] = max(p.forces[k], 0.0)
        length = np.sqrt(p.forces[k + 1] * p.forces[k + 1] + p.forces[k + 2] * p.forces[k + 2])
        share = min(1.0, p.bound[i] / (length + 1e-300))
        p.forces[k + 1] *= share
        p.forces[k + 2] *= share


@inner
def iterate_friction(p: FrictionObject, h: Array, mu: Array, limits: FrictionLimits) -> bool:
    """See `newton_friction`."""
    tolerance, rounding, progress, most, chord = limits
    deepest, share, size = 0.0, np.inf, load(p, h, mu)
    for row in range(p.counts[N_ROWS]):
        deepest = max(deepest, abs(h[row, 0]))
    for _ in range(most + 1):
        largest = 0.0
        for i in range(3 * p.counts[N_CLOSED]):
            largest = max(largest, abs(p.forces[i]))
        settled = size <= rounding * largest or share * size <= tolerance * largest
        if settled or p.counts[STEPS] == 1:
            if exchange(p, h, -rounding * largest, -rounding * deepest):
                size, share = load(p, h, mu), np.inf
            elif settled:
                bring_within_law(p)
                keep_forces(p)
                return True
        if p.counts[STALE]:
            factorise(p)
        m, before = 3 * p.counts[N_CLOSED], size
        p.counts[ITERATIONS] += 1
        p.counts[STEPS] += 1
        steps = p.counts[STEPS]
        farthest = corrected_chord(
            matrix_at(p.factors, 0, m, m), p.pivots, p.value[:m], p.moves[: (chord + 2) * m].reshape(chord + 2, m),
            p.squares, steps - 1, p.step,
        )  # fmt: skip
        for i in range(m):
            p.forces[i] += p.step[i]
        size = residual(p)
        share = farthest / before if before != 0.0 else 0.0
        stale = (steps > 1 and size > progress * before) or steps > chord
        for i in range(p.counts[N_CLOSED]):
            stale = stale or (p.length[i] > p.bound[i]) != p.factorised[i]
        p.counts[STALE] = stale
    return False


@compiled
def newton_friction(p: FrictionObject, h: Array, mu: Array, fresh: bool, limits: FrictionLimits) -> bool:
    """Iterate from the last forces; return whether they settled, see `friction.FrictionProblem`.

    Parameters
    ----------
    p : FrictionObject
    h : (n, 3) array
    mu : (n,) array
    fresh : bool
        Whether other rows are in `closed` than before.
    limits
        See `flat_friction.FRICTION_LIMITS`.
    """
    if fresh:
        close_rows(p)
    return iterate_friction(p, h, mu, limits)
