"""What validation/paper measures with, on signals of known answer."""

import numpy as np
import pytest

from validation.paper import impact, mechanism
from validation.paper.statements import cells, failures, statement


def test_only_disagreements_that_are_not_understood_fail():
    rows = [
        statement("within", 1, 1.05, 0.05, 0.1),
        statement("beyond", 1, 1.2, 0.2, 0.1),
        statement("understood", 1, 1.2, -0.2, 0.1, known=True, why="another mesh"),
        statement("shape", "peak", "none", agrees=False),
        statement("not judged", 1, 2, 1.0),
    ]
    assert failures(rows) == ["beyond", "shape"]
    assert [cells(row)[4] for row in rows] == ["yes", "NO", "NO", "NO", ""]


def test_arrival_is_at_a_tenth_of_the_first_front():
    t = np.linspace(0, 1e-3, 1001)
    velocity = np.zeros((len(t), 3))
    velocity[:, 2] = -0.6 + 0.07 * np.clip((t - 0.15e-3) / 0.05e-3, 0, 1)  # the front, then what comes back
    velocity[:, 2] += 0.5 * np.clip((t - 0.4e-3) / 0.1e-3, 0, 1)
    assert impact.arrival(t, velocity) == pytest.approx(0.155e-3, abs=2e-6)


def test_high_frequencies_are_told_from_slow_motion():
    t = np.sort(np.random.default_rng(0).uniform(0, 20e-3, 20000))
    slow, fast = 3 * np.sin(2 * np.pi * 25 * t), 0.2 * np.sin(2 * np.pi * 8e3 * t)
    start = 10e-3
    (before, fast_before), (_, fast_after) = mechanism.windows(t, slow + np.where(t > start, fast, 0), start)
    assert before == pytest.approx(3, rel=1e-3)
    assert fast_before < 0.01
    assert fast_after == pytest.approx(0.2 / np.sqrt(2), rel=0.03)
