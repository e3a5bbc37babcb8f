"""When impacts start and end, speeds there, and means of their forces, by straight lines that are known."""

import numpy as np
import pytest

from exudyn_partition.results.impacts import SubImpact, at_border, closed_spans, crossing


@pytest.mark.parametrize("way", [-1, 1])
@pytest.mark.parametrize("closes", [0.31, 0.5, 0.68])
def test_a_contact_starts_and_ends_where_a_straight_gap_vanishes(way, closes):
    """Also if more samples with a closed surface lie between, whose force is zero."""
    t = np.arange(0.0, 1.0, 0.1)
    gap = (t - closes) * way  # closed before, or after
    inside = 0 if way > 0 else len(t) - 1
    assert crossing(t, lambda i: gap[i], inside, len(t) if way > 0 else -1) == pytest.approx(closes)


def test_without_a_known_gap_a_contact_ends_with_the_next_sample():
    t = np.array([0.0, 0.1, 0.3, 0.7])
    assert crossing(t, None, 1, 4) == 0.3
    assert crossing(t, None, 1, -1) == 0.0
    assert crossing(t, None, 3, 4) == 0.7


@pytest.mark.parametrize(("way", "time"), [(-1, 0.52), (1, 0.58)])
def test_the_value_at_a_border_is_that_of_the_line_through_samples_without_a_force(way, time):
    """Bodies that gravity accelerates have other speeds at the border than at the sample beside it."""
    t = np.arange(0.0, 1.05, 0.1)
    speeds = 3.0 - 9.81 * t
    free = np.ones(len(t), dtype=bool)
    assert at_border(t, free, lambda i: speeds[i], time, way) == pytest.approx(3.0 - 9.81 * time)
    free[:] = False  # no other sample is free: the nearest value
    outside = 6 if way > 0 else 5
    assert at_border(t, free, lambda i: speeds[i], time, way) == speeds[outside]


def test_the_mean_force_times_the_duration_is_the_impulse():
    impact = SubImpact(start=0.25, end=0.75, impulse=3.0, peak=20.0)
    assert impact.mean_force == 6.0
    assert SubImpact(start=0.25, end=0.25, impulse=0.0, peak=20.0).mean_force == 0.0


@pytest.mark.parametrize(
    ("before", "after", "e"),
    [(2.0, 1.5, 0.75), (None, 1.5, None), (2.0, None, None), (-0.1, 1.0, None), (0.0, 1.0, None)],
)
def test_restitution_is_separation_over_approach(before, after, e):
    assert SubImpact(0.0, 1.0, 1.0, 2.0, speed_before=before, speed_after=after).restitution == e


def test_touches_by_round_off_are_no_impacts():
    """A body that lies on another one before it is hit; a touch that is weak, and none by round-off, stays."""
    force = np.zeros(30)
    force[[2, 7]], force[10:15], force[20:22] = 3e-9, 1000.0, 1e-3
    assert closed_spans(force) == [(10, 14), (20, 21)]
    assert closed_spans(1e-12 * force) == [(10, 14), (20, 21)]
    assert closed_spans(np.zeros(3)) == []
    assert closed_spans(np.full(3, 1e-9)) == [(0, 2)]
