"""Corrections of a stiffness by what a force did in the last step; combinations of guesses of a fixed point."""

import numpy as np

from exudyn_partition.algebra.secants import DEPTH, Anderson, Secant


def test_the_corrected_stiffness_explains_the_last_step_and_keeps_what_lies_across():
    rng = np.random.default_rng(0)
    stiff, soft = (a @ a.T for a in rng.standard_normal((2, 5, 5)))
    q, step = rng.standard_normal((2, 5))
    first = Secant().then(q, -soft @ q)
    np.testing.assert_array_equal(first.corrected(stiff), stiff)  # there was no step yet
    corrected = first.then(q + step, -soft @ (q + step)).corrected(stiff)
    np.testing.assert_allclose(corrected @ step, soft @ step)
    across = np.linalg.svd(step[None])[2][1:].T
    np.testing.assert_allclose(corrected @ across, stiff @ across)


def test_rounding_tells_nothing():
    """A step as small as what an inner iteration leaves behind would correct the stiffness by noise."""
    secant, stiffness = Secant().then(np.zeros(3), np.ones(3)), np.eye(3)
    secant = secant.then(np.full(3, 1e-9), np.ones(3) + 1e-6)
    np.testing.assert_array_equal(secant.corrected(stiffness), stiffness)


def test_arrays_may_change_after_they_were_seen():
    """As a solver's own arrays do, which it overwrites in each iteration."""
    q, force = np.zeros(2), np.array([3.0, 1.0])
    secant = Secant().then(q, force)
    q += [1.0, 0.0]
    force -= [2.0, 0.0]
    np.testing.assert_allclose(secant.then(q, force).corrected(np.eye(2)), [[2.0, 0.0], [0.0, 1.0]])


def test_shares_give_the_combination_of_guesses_whose_change_is_least():
    """For a linear map, by a search among all combinations whose shares have the sum 1; the oldest guesses are lost."""
    rng = np.random.default_rng(3)
    turn, away, x = 0.3 * rng.standard_normal((20, 20)), rng.standard_normal(20), np.zeros(20)
    anderson, guesses = Anderson(), []
    for _ in range(DEPTH + 3):
        guesses.append(x)
        x = anderson.guess(x, turn @ x + away)
        last = np.array(guesses[-len(anderson.shares) :])
        changes = last @ turn.T + away - last
        apart = np.diff(changes, axis=0)
        least = (
            changes[-1] - apart.T @ np.linalg.lstsq(apart.T, changes[-1], rcond=None)[0] if len(apart) else changes[0]
        )
        assert len(last) == min(len(guesses), DEPTH + 1)
        np.testing.assert_allclose(anderson.shares.sum(), 1.0)
        np.testing.assert_allclose(anderson.shares @ changes, least, rtol=0, atol=1e-10)
        np.testing.assert_allclose(anderson.least, np.linalg.norm(least), rtol=1e-6)
        np.testing.assert_allclose(x, anderson.shares @ (last + changes), rtol=0, atol=1e-10)
