"""Errors of one history against another."""

from dataclasses import replace

import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import InputError


def test_errors_of_a_history():
    t = np.linspace(0, 1, 101)
    wave = np.column_stack([0 * t, 0 * t, np.sin(t)])
    reference = ep.History(t.copy(), t**2, {"P": wave + 3.0}, {"time_s": 10.0})
    run = ep.History(t[::2].copy(), 1.1 * t[::2] ** 2, {"P": 1.02 * wave[::2] + 3.0}, {"time_s": 0.1})
    comparison = ep.compare(run, reference)
    assert comparison.error["force"] == pytest.approx(0.1, rel=1e-2)
    assert comparison.error["P"] == pytest.approx(0.02, rel=1e-2)
    assert comparison.speedup == pytest.approx(100)
    half = ep.History(t[:51].copy(), t[:51] ** 2, {"P": wave[:51].copy()}, {"time_s": 0.1})
    assert ep.compare(half, reference).reference_time_s == pytest.approx(10 * 51 / 101)
    with pytest.raises(InputError, match="has no velocity of P"):
        ep.compare(ep.History(t.copy(), t.copy(), {}), reference)


def test_tangential_forces_are_compared_as_vectors():
    t = np.linspace(0, 1, 101)
    along = np.column_stack([t**2, 0 * t, 0 * t])
    reference = ep.History(t, t**2, {}, tangential_force=along)
    run = ep.History(t, t**2, {}, tangential_force=along + 0.1 * along[:, [1, 0, 2]])
    assert ep.compare(run, reference).error == pytest.approx({"force": 0.0, "tangential": 0.1})
    still = replace(reference, tangential_force=0 * along)
    assert set(ep.compare(still, still).error) == {"force"}
    smooth = replace(reference, tangential_force=None)
    with pytest.raises(InputError, match=r"run: is frictionless.*CreatePartitionContact"):
        ep.compare(smooth, reference)
    with pytest.raises(InputError, match=r"reference: is frictionless.*reference\.simulate"):
        ep.compare(run, smooth)


def wave(start, end, force=1.0, speed=1.0):
    """A history of 101 samples."""
    t = np.linspace(start, end, 101)
    return ep.History(t, force * np.sin(t) ** 2, {"P": speed * np.column_stack([0 * t, 0 * t, np.sin(t)])})


def test_histories_that_share_no_time_are_not_compared():
    """They gave an error of zero or one, of no sample or of the first run's last value held on."""
    for other in (wave(2, 3), wave(-2, -1), wave(1, 2)):
        with pytest.raises(InputError, match=r"expected a time in common.* from 0 to 1 s"):
            ep.compare(wave(0, 1), other)
    later = ep.compare(wave(0, 2), wave(1, 3))  # on the samples of the second that lie within the first
    assert later.error["force"] < 1e-3
    assert later.end_time == 2


def test_nothing_has_no_relative_error():
    with pytest.raises(InputError, match="reference: has no contact force in the common time"):
        ep.compare(wave(0, 1), wave(0, 1, force=0.0))
    with pytest.raises(InputError, match="reference: has no change of the velocity of P"):
        ep.compare(wave(0, 1), wave(0, 1, speed=0.0))


def test_an_unknown_run_time():
    """Of `collect`, or of a run that the clock did not see."""
    assert np.isnan(ep.Comparison({"force": 0.1}, float("nan"), 1.0, 1.0).speedup)
    assert np.isnan(ep.Comparison({"force": 0.1}, 0.0, 1.0, 1.0).speedup)
    with pytest.raises(InputError, match=r"time_s'\]: expected a time in s"):
        ep.compare(wave(0, 1), replace(wave(0, 1), info={"time_s": "fast"}))
