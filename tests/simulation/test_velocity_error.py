"""Error of velocities in implicit steps, against the exact motion of oscillators, and the steps that follow from it."""

import numpy as np
import pytest

from exudyn_partition.simulation.velocity_error import BodyMotion, VelocityError

TOLERANCE = 1e-3


def at_start(masses, q_t, stored=0.0):
    masses = [np.asarray(mass, dtype=float) for mass in masses]
    now = BodyMotion(np.asarray(q_t, dtype=float), np.zeros(len(q_t)))
    return VelocityError.at_start(TOLERANCE, masses, now).jumped(1.0, now, stored)


def after(errors, step, q_t, q_tt):
    now = BodyMotion(np.asarray(q_t, dtype=float), np.asarray(q_tt, dtype=float))
    return errors.after(step, errors.judged(step, now))


class Oscillator:
    """A mass on a spring that swings with velocity v cos(w t) by the trapezoidal rule."""

    def __init__(self, w, v, mass=2.5):
        self.w, self.v, self.mass = w, v, mass

    def exact(self, t):
        u = self.v / self.w * np.sin(self.w * t)
        return u, self.v * np.cos(self.w * t), -(self.w**2) * u

    def step(self, u, v, h):
        u = (u * (1 - (self.w * h / 2) ** 2) + h * v) / (1 + (self.w * h / 2) ** 2)
        return u


@pytest.mark.parametrize("t", [0.1, 0.7, 2.0])
def test_the_error_is_how_far_a_trapezoidal_step_misplaces_an_oscillator(t):
    swing, h = Oscillator(w=3.0, v=0.2), 1e-3
    errors = at_start([[swing.mass]], [swing.v])
    errors = after(errors, h, [-swing.v], [0.0])  # the largest change of velocity is twice the amplitude
    u, v, a = swing.exact(t)
    errors = after(errors, h, [v], [a])
    end = swing.step(u, v, h)
    misplaced = abs(end - swing.exact(t + h)[0]) / h
    found = errors.error(h, BodyMotion(np.array([0.0]), np.array([-(swing.w**2) * end])))
    assert found == pytest.approx(misplaced / (2 * swing.v), rel=0.02)


@pytest.mark.parametrize("share", [1.0, 1e-1, 1e-2])
def test_steps_become_as_long_as_the_tolerance_allows_an_oscillator(share):
    """The error of a mode with a share of the velocity is (w s)^2 / 12 of this share."""
    swing, t, h, steps, found = Oscillator(w=1.0, v=share), 0.0, 1e-3, [], []
    errors = after(at_start([[swing.mass, swing.mass]], [0.0, 0.0]), h, [1.0, 0.0], [0.0, 0.0])
    for _ in range(800):
        t += h
        _, v, a = swing.exact(t)
        now = BodyMotion(np.array([0.0, v]), np.array([0.0, a]))
        end = errors.judged(h, now)
        found.append(end.error)
        errors = errors.after(h, end)
        h = errors.next_step(h)
        steps.append(h)
    allowed = np.sqrt(12 * 0.5 * TOLERANCE / share)
    assert 0.4 * allowed < np.mean(steps[-400:]) < 1.5 * allowed
    assert max(found) < 1.5 * TOLERANCE
    changes = np.count_nonzero(np.diff(steps[-400:]))
    assert changes < 400 / 15


def test_growing_steps_are_few():
    """Each growth costs a Jacobian: by half, and only if a step longer by more is allowed; what is too long shrinks."""
    errors = at_start([[1.0]], [0.0])
    assert errors.jumped(1.0, BodyMotion(np.zeros(1), np.zeros(1)), 0.0).next_step(1.0) == pytest.approx(1.0)
    errors, steps = after(errors, 1.0, [1.0], [0.0]), [1.0]
    for _ in range(60):
        errors = after(errors, steps[-1], [1.0], [0.0])
        steps.append(errors.next_step(steps[-1]))
    grown = np.unique(np.array(steps[1:]) / np.array(steps[:-1]))
    np.testing.assert_allclose(grown, [1.0, 1.5])
    kept = errors.jumped(0.8 * steps[-1], BodyMotion(np.ones(1), np.zeros(1)), 0.0)
    assert kept.next_step(steps[-1]) == steps[-1]
    shrunk = errors.jumped(0.25 * steps[-1], BodyMotion(np.ones(1), np.zeros(1)), 0.0)
    assert shrunk.next_step(steps[-1]) == pytest.approx(0.25 * steps[-1])


@pytest.mark.parametrize("share", [0.6, 0.1])
def test_a_share_of_the_tolerance_shortens_steps_by_its_root(share):
    """Their error, which is half of what is allowed, is of second order."""
    errors = at_start([[1.0]], [0.0])  # a step of 1 s follows one of 1 s
    assert errors.next_step(1.0) == 1.0
    for last in (1.0, 1.3):
        short = errors.next_step(last, share)
        assert short == pytest.approx(np.sqrt(share) if last**2 > 2 * share else last)
    assert errors.next_step(0.1, share) == pytest.approx(0.15)


def test_a_contact_that_closes_lengthens_no_step():
    """What vibrates since before it closed allows the same steps as then."""
    errors = after(at_start([[1.0]], [0.0]), 0.1, [1.0], [0.5])
    allowed = errors.next_step(1.0)
    assert allowed < 0.1
    now = BodyMotion(np.ones(1), np.array([0.5]))
    assert errors.jumped(10.0, now, 0.0).next_step(1.0) == pytest.approx(allowed)
    assert errors.jumped(0.1 * allowed, now, 0.0).next_step(1.0) == pytest.approx(0.1 * allowed)


def test_a_body_at_rest_is_judged_as_one_that_moved_with_a_hundredth_of_what_is_stored():
    moved, stands = after(at_start([[2.0]], [0.0]), 1.0, [1.0], [0.0]), at_start([[2.0]], [0.0], stored=100.0)
    now = BodyMotion(np.zeros(1), np.array([0.7]))
    assert stands.error(0.3, now) == pytest.approx(moved.error(0.3, now), rel=1e-12)


def test_energy_is_that_of_the_largest_changes_of_velocity_or_a_hundredth_of_what_is_stored():
    errors = at_start([[2.0], [3.0]], [1.0, 5.0], stored=40.0)
    assert errors.energy == pytest.approx(0.4)
    for q_t in ([0.0, 8.0], [0.5, 4.0]):  # 1 J and 13.5 J of one and the other at first
        errors = after(errors, 1.0, q_t, [0.0, 0.0])
        assert errors.energy == pytest.approx(14.5)


def test_a_step_with_too_large_an_error_is_replaced_by_one_with_the_allowed_error():
    errors = at_start([[1.0]], [0.0])
    assert errors.shorter_step(1.0, 1.9 * TOLERANCE) is None
    shorter = errors.shorter_step(1.0, 5 * TOLERANCE)
    assert 5 * TOLERANCE * shorter**2 == pytest.approx(0.5 * TOLERANCE)
    assert errors.shorter_step(1.0, 1e6 * TOLERANCE) == 0.25
    assert errors.shorter_step(1.0, 0.5 * TOLERANCE, share=0.1) == pytest.approx(np.sqrt(0.1))


def test_a_common_velocity_does_not_make_errors_look_small():
    found = []
    for common in (0.0, 1e6):
        errors = at_start([[1.0, 3.0]], [common, 0.0])
        errors = after(errors, 1.0, [common + 2.0, 1.0], [0.1, 0.0])
        found.append(errors.error(0.5, BodyMotion(np.array([common + 1.0, 0.0]), np.array([0.3, 0.2]))))
    assert found[1] == pytest.approx(found[0], rel=1e-6)
    assert found[0] > 0


@pytest.mark.parametrize("share", [1e-2, 1e-4])
def test_a_heavy_body_hardly_hides_the_errors_of_a_light_one(share):
    """Errors compare with the geometric mean of a body's energy and that of all: by the fourth root of its share."""
    heavy = (1 - share) / share * 0.1**2  # mass, at a speed of 1 m/s
    alone, beside = at_start([[1.0]], [0.0]), at_start([[1.0], [heavy]], [0.0, 0.0])
    alone = after(alone, 1.0, [0.1], [0.0])
    beside = after(beside, 1.0, [0.1, 1.0], [0.0, 0.0])
    now = BodyMotion(np.array([0.1]), np.array([0.7]))
    both = BodyMotion(np.array([0.1, 1.0]), np.array([0.7, 0.0]))
    assert beside.error(0.3, both) == pytest.approx(share**0.25 * alone.error(0.3, now), rel=1e-9)


def test_bodies_at_rest_are_compared_with_what_they_store():
    """Round-off of a preloaded body is no error; without any energy every change of acceleration is one."""
    noise = BodyMotion(np.array([1e-12]), np.array([1e-9]))
    assert at_start([[1.0]], [0.0], stored=1.0).error(1e-3, noise) < 1e-6
    still = BodyMotion(np.zeros(1), np.array([1e-9]))
    assert at_start([[1.0]], [0.0]).error(1e-3, still) == np.inf
    assert at_start([[1.0]], [0.0]).error(1e-3, BodyMotion(np.zeros(1), np.zeros(1))) == 0.0
