"""Times of pictures: each impact has its own, however short it is and however many there are."""

import numpy as np
import pytest

from exudyn_partition.present.frame_times import frame_times, slow_spans, spans_of

T = np.linspace(0, 1, 100_001)


def pulses(*impacts):
    """Half sines: (start, duration, largest force)."""
    force = np.zeros(len(T))
    for start, duration, largest in impacts:
        inside = (T > start) & (T < start + duration)
        force[inside] = largest * np.sin(np.pi * (T[inside] - start) / duration)
    return force


def test_each_impact_has_a_dozen_and_its_peak():
    impacts = (0.1234, 1e-3, 50.0), (0.5, 2e-3, 20.0), (0.9, 5e-4, 70.0)
    force = pulses(*impacts)
    times = frame_times(T, [force], 50, 100)
    assert np.isin(np.linspace(0, 1, 50), times).all()
    assert (np.diff(times) > 0).all()
    for start, duration, _ in impacts:
        inside = np.flatnonzero((T > start) & (T < start + duration))
        assert T[inside[force[inside].argmax()]] in times
        assert np.count_nonzero((times >= start - 2e-5) & (times <= start + duration + 2e-5)) >= 12
    assert len(times) <= 50 + 3 * 13


def test_a_long_impact_needs_its_peak_alone():
    force = pulses((0.2, 0.6, 5.0))
    times = frame_times(T, [force], 50, 100)
    assert len(times) == 51
    assert T[force.argmax()] in times


def test_of_many_impacts_each_has_fewer_and_the_strongest_some():
    many = [((i + 0.5) / 40, 1e-3, 1.0 + i) for i in range(40)]
    times = frame_times(T, [pulses(*many)], 10, 130)
    assert len(times) <= 140
    for start, duration, _ in many:
        assert np.count_nonzero((times >= start) & (times <= start + duration)) >= 1
    times = frame_times(T, [pulses(*many)], 10, 30)
    seen = [np.count_nonzero((times > start - 2e-5) & (times < start + 1e-3 + 2e-5)) > 1 for start, *_ in many]
    assert seen == [False] * 30 + [True] * 10
    assert len(frame_times(T, [pulses(*many)], 10, 2)) == 10


def test_times_in_contact_that_are_close_are_one_impact():
    force = pulses((0.1, 1e-3, 1.0), (0.1015, 1e-3, 1.0), (0.2, 1e-3, 1.0))
    spans = spans_of([force], T)
    assert [T[first] for first, _ in spans] == pytest.approx([0.1, 0.2], abs=1e-4)
    assert T[spans[0][1]] == pytest.approx(0.1025, abs=1e-4)
    pulled = spans_of([-force], T)
    assert pulled == spans


def test_only_what_is_short_is_slow():
    forces = [pulses((0.1, 1e-3, 1.0), (0.5, 0.3, 1.0)), pulses((0.1005, 1e-3, 1.0))]
    ((start, end),) = slow_spans(T, forces, 0.1)
    assert start == pytest.approx(0.1, abs=5e-4)
    assert end == pytest.approx(0.1015, abs=5e-4)
    assert slow_spans(T, [pulses()], 0.1) == []
