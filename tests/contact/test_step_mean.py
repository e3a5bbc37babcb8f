"""Forces that are constant within a step, in generalized-alpha."""

import numpy as np
import pytest

from exudyn_partition.contact.step_mean import GeneralizedAlpha, StepMean


def weights_of(radius):
    """Of generalized-alpha with a spectral radius (Chung, Hulbert 1993)."""
    alpha_m, alpha_f = (2 * radius - 1) / (radius + 1), radius / (radius + 1)
    gamma = 0.5 + alpha_f - alpha_m
    return GeneralizedAlpha(alpha_m, alpha_f, (gamma + 0.5) ** 2 / 4, gamma)


@pytest.mark.parametrize("radius", [0.5, 0.9, 1.0])
def test_the_momentum_changes_by_the_mean_force_in_each_step(radius):
    """A mass in generalized-alpha, under forces that jump, and long after them, in steps of several lengths."""
    weights, mean = weights_of(radius), StepMean.none(1)
    mass, q, v, q_tt, a = 2.0, 0.0, 1.0, 0.0, 0.0
    random = np.random.default_rng(1)
    forces = np.r_[random.choice([0.0, 1.0, 5.0], 40), np.zeros(40)]
    for step, force in zip(random.choice([0.1, 0.05, 0.02], 80), forces, strict=True):
        applied, mean = mean.after(weights, np.array([force]))
        applied = applied[0] / mass
        ahead = ((1 - weights.alpha_f) * applied + weights.alpha_f * q_tt - weights.alpha_m * a) / (1 - weights.alpha_m)
        q_end = q + step * v + step**2 * ((0.5 - weights.beta) * a + weights.beta * ahead)
        v_end = v + step * ((1 - weights.gamma) * a + weights.gamma * ahead)
        assert v_end - v == pytest.approx(step * force / mass, abs=1e-12)
        if radius == 1.0:  # the trapezoidal rule
            assert q_end - q == pytest.approx(0.5 * step * (v + v_end), abs=1e-12)
        q, v, q_tt, a = q_end, v_end, applied, ahead


@pytest.mark.parametrize("radius", [0.5, 0.9])
def test_a_steady_force_is_applied_as_it_is_and_nothing_is_left_long_after_it(radius):
    weights, mean, force = weights_of(radius), StepMean.none(1), np.array([3.0])
    found = []
    for now in [force] * 400 + [0 * force] * 400:
        applied, mean = mean.after(weights, now)
        found.append(applied[0])
    assert found[399] == pytest.approx(3.0, rel=1e-9)
    assert found[-1] == 0.0
