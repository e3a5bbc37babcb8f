"""Plastic strain in a run: what is kept, and when."""

import numpy as np
import pytest

from exudyn_partition.errors import InputError
from exudyn_partition.plasticity import strain_history
from exudyn_partition.plasticity.flow import PlasticState
from exudyn_partition.plasticity.strain_history import StrainHistory

FIVE = range(5)  # stands for a zone of five points; only their number matters


def state(amount):
    """Two of the points have flowed by an amount."""
    strain = np.zeros((len(FIVE), 6))
    strain[1:3] = amount
    return PlasticState(strain, np.sqrt(2 / 3) * np.linalg.norm(strain, axis=1), np.zeros_like(strain))


def test_each_time_has_the_last_strain_before_it():
    history, first, second = StrainHistory(FIVE), state(0.0), state(0.25)
    for t, one in ((0.0, first), (1.0, first), (2.0, second), (3.0, second), (4.0, state(0.5))):
        history.keep(t, one)
    numbers = history.numbers(np.array([0.0, 1.5, 2.0, 3.5, 4.0, 9.0]))
    found = [history.strain(number)[1, 0] for number in numbers]
    np.testing.assert_array_equal(found, [0, 0, 0.25, 0.25, 0.5, 0.5])
    np.testing.assert_array_equal(history.strain(numbers[2]), second.strain)


def test_what_does_not_flow_any_more_takes_no_memory():
    """Points flow one after the other, as a dent grows and springs back; states are read in any order."""
    history, strain, states = StrainHistory(FIVE), np.zeros((len(FIVE), 6)), []
    for t in FIVE:
        strain = strain.copy()
        strain[t] = 0.25 + t
        states.append(PlasticState(strain, np.linalg.norm(strain, axis=1), np.zeros_like(strain)))
        history.keep(float(t), states[-1])
    assert [points.tolist() for points, _ in history.kept[1]] == [[0], [1], [2], [3], [4]]
    for number in (4, 1, 2, 0, 3):
        np.testing.assert_array_equal(history.strain(number), states[number].strain)
    history.keep(2.0, states[0])  # again, otherwise
    for number, expected in ((2, states[0]), (1, states[1]), (2, states[0])):
        np.testing.assert_array_equal(history.strain(number), expected.strain)


def test_a_sample_that_is_asked_for_again_replaces_the_first():
    history = StrainHistory(FIVE)
    for t, amount in ((0.0, 0.0), (1.0, 0.25), (1.0, 0.5)):
        history.keep(t, state(amount))
    assert history.strain(history.numbers(np.array([1.0]))[0])[2, 3] == 0.5
    assert history.strain(history.numbers(np.array([0.5]))[0])[2, 3] == 0.0


def test_samples_that_are_asked_for_again_take_no_more_memory(monkeypatch):
    monkeypatch.setattr(strain_history, "MOST", 20)
    history = StrainHistory(FIVE)
    for again in range(4):
        history.keep(1.0, state(1.0 + again))
    assert history.strain(history.numbers(np.array([1.0]))[0])[1, 0] == 4.0


def test_too_many_strains_are_not_kept(monkeypatch):
    monkeypatch.setattr(strain_history, "MOST", 20)
    history = StrainHistory(FIVE)
    for t in range(4):
        history.keep(float(t), state(1.0 + t))
    with pytest.raises(InputError, match="longer sample_period"):
        history.numbers(np.array([0.0]))
