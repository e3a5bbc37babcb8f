"""Truncation frequencies of signals of known content."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import brentq

import exudyn_partition as ep
from exudyn_partition.errors import InputError


def half_sine(n, length=1.0, start=0.0):
    """A half sine that lasts one unit of time with n steps, in a record of a length."""
    t = np.arange(round(length * n) + 1) / n
    return t, np.where((t >= start) & (t <= start + 1), np.sin(np.pi * (t - start)), 0)


@pytest.mark.parametrize("tolerance", [0.003, 0.01, 0.1])
def test_half_sine_by_its_transform(tolerance):
    """|X(f)| = 2/pi |cos(pi f)| / |1 - 4 f^2|, with the energy 1/4 at f > 0."""

    def energy(f):
        return (2 / np.pi * np.cos(np.pi * f) / (1 - 4 * f**2)) ** 2

    def beyond(f):
        return 0.25 - quad(energy, 0, f, limit=200)[0]

    highest = brentq(lambda f: beyond(f) - tolerance**2 * 0.25, 0.6, 20, xtol=1e-10)
    assert ep.truncation_frequency(*half_sine(4000, 2), tolerance=tolerance) == pytest.approx(2 * highest, rel=1e-3)


@settings(max_examples=30, deadline=None)
@given(st.integers(200, 3000), st.floats(1, 40), st.floats(0, 1), st.floats(1e-3, 1e3), st.floats(1e-6, 1e3))
def test_neither_sampling_nor_record_nor_scale_count(n, length, where, size, unit):
    """Nor where the pulse lies, also between two samples: the kinks at its ends are the worst that sampling meets."""
    expected = ep.truncation_frequency(*half_sine(4000, 2))
    t, x = half_sine(n, length, where * (length - 1))
    assert ep.truncation_frequency(t * unit, size * x) * unit == pytest.approx(expected, rel=0.01)


def test_a_low_pass_there_changes_the_signal_by_the_tolerance():
    t, x = half_sine(1000, 20, 7.3)
    x = x + 0.3 * np.roll(x, 2500) * np.sin(20 * t)
    highest = ep.truncation_frequency(t, x, tolerance=0.02) / 2
    spectrum = np.fft.rfft(x)
    spectrum[np.fft.rfftfreq(len(x), t[1]) > highest] = 0
    change = np.linalg.norm(np.fft.irfft(spectrum, len(x)) - x) / np.linalg.norm(x)
    assert change == pytest.approx(0.02, rel=0.05)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.02, 0.3), st.integers(7, 40), st.floats(0, 2 * math.pi), st.floats(-5, 5))
def test_sum_of_sinusoids(length, per_period, phase, offset):
    """Lines at 1, 7 and 22 kHz; the last holds too little to change the signal by the tolerance."""
    t = np.arange(0, length, 1 / (7e3 * per_period))
    x = offset + sum(
        a * np.sin(2 * np.pi * f * t + phase * f / 1e3) for a, f in ((1, 1e3), (0.05, 7e3), (0.002, 2.2e4))
    )
    highest = ep.truncation_frequency(t, x, window="hann") / 2
    assert highest == pytest.approx(7e3, abs=2 / length)
    assert ep.truncation_frequency(t, x, window="hann", tolerance=0.1) / 2 == pytest.approx(1e3, abs=2 / length)


def test_less_tolerance_keeps_more():
    values = [ep.truncation_frequency(*half_sine(1000, 3), tolerance=tolerance) for tolerance in (0.1, 0.03, 0.01)]
    assert values == sorted(values)


def test_records_that_do_not_show_their_content_are_refused():
    t, x = half_sine(200, 3)
    with pytest.raises(InputError, match="begins and ends at rest"):
        ep.truncation_frequency(t[:100], x[:100])
    with pytest.raises(InputError, match="sample finer"):
        ep.truncation_frequency(t[::20], x[::20])
    with pytest.raises(InputError, match="sample finer"):
        ep.truncation_frequency(t, np.random.default_rng(0).normal(size=len(t)), window="hann")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"t": np.r_[0:100, 105:606]}, "equally spaced"),
        ({"t": np.zeros(601)}, "equally spaced"),
        ({"t": np.arange(5)}, "x: expected shape"),
        ({"x": np.full(601, np.nan)}, "finite"),
        ({"x": np.full(601, 3.0), "window": "hann"}, "a signal that changes"),
        ({"tolerance": 1.0}, "tolerance"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"window": "hamming"}, "'none', 'hann'"),
    ],
)
def test_bad_input(changed, message):
    t, x = half_sine(200, 3)
    with pytest.raises(InputError, match=message):
        ep.truncation_frequency(**{"t": t, "x": x, **changed})
