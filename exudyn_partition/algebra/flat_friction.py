"""A problem of friction in flat arrays, as compiled loops take it, see `friction.FrictionProblem`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..support.arrays import Array

TOLERANCE = 1e-12  # of the largest force; what is left adds up over the steps of a run that sticks
ROUNDING = 1e-12  # of the largest force or gap
PROGRESS = 0.3  # a step that leaves a larger share of the residual asks for new factors
NEWTON_STEPS = 30
CHORD_STEPS = 10  # with the same factors
FRICTION_LIMITS = TOLERANCE, ROUNDING, PROGRESS, NEWTON_STEPS, CHORD_STEPS  # as compiled loops take them
N_ROWS, N_CLOSED, STALE, STEPS, ITERATIONS, FACTORISATIONS = range(6)  # places in `FlatFriction.counts`


class FlatFriction(NamedTuple):
    """A problem of n rows, na of which are closed, with room for k; see `friction.FrictionProblem`.

    Matrices are their first numbers, row after row. All but F change in an answer.

    Parameters
    ----------
    counts : (6,) int array
        n; na; whether the factors are stale; steps made with them in this answer; iterations and factorisations so far.
    F : (9 k^2,) array
        Flexibility [m/N].
    inverse : (3 k,) array
        Scales of gaps and slips to forces [N/m].
    state : (k,) int8 array
    lam : (3 k,) array
        Forces [N].
    closed, place : (k,) int arrays
        The closed rows, and each row's place among them, -1 for others.
    scaled : (9 k^2,) array
        Transpose of the flexibility of the closed rows, scaled to forces.
    factors : (9 k^2,) array
        LU factors of the Jacobian, transposed.
    pivots : (3 k,) int32 array
    factorised : (k,) bool array
        Which closed rows slip in the factors.
    h, value, forces, step : (3 k,) arrays
        Of the closed rows: gaps and slips without forces, unbalanced forces, forces, and the last step [N].
    mu, x1, x2, length, bound : (k,) arrays
        Of the closed rows: coefficients, trial forces along both tangents, their length, and its bound [N].
    moves, squares : (36 k,), (12,) arrays
        Steps with the present factors, and their squares.
    """

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

    @classmethod
    def pool(cls, sizes: Sequence[int]) -> FlatFriction:
        """Room for several problems of these numbers of rows, one after the other in each array."""
        parts = [cls.of(k) for k in sizes]
        return cls(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))

    @classmethod
    def of(cls, k: int, F: Array | None = None, inverse: Array | None = None) -> FlatFriction:
        """Room for k rows, all of them open; with F and scales, (3 k,), the problem of all."""
        counts = np.zeros(6, dtype=np.int64)
        if F is None:
            F, inverse = np.empty(9 * k * k), np.empty(3 * k)
        else:
            counts[N_ROWS] = k
        assert inverse is not None
        return cls(
            counts, F, inverse, state=np.zeros(k, dtype=np.int8), lam=np.zeros(3 * k),
            closed=np.empty(k, dtype=np.int64), place=np.full(k, -1, dtype=np.int64),
            scaled=np.empty(9 * k * k), factors=np.empty(9 * k * k), pivots=np.empty(3 * k, dtype=np.int32),
            factorised=np.zeros(k, dtype=bool), h=np.empty(3 * k), value=np.empty(3 * k), forces=np.empty(3 * k),
            step=np.empty(3 * k), mu=np.empty(k), x1=np.empty(k), x2=np.empty(k), length=np.zeros(k),
            bound=np.zeros(k), moves=np.empty((CHORD_STEPS + 2) * 3 * k), squares=np.empty(CHORD_STEPS + 2),
        )  # fmt: skip
