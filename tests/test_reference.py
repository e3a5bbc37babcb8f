"""The full FE reference on a case with a closed answer, and histories."""

import os
import signal
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from conftest import box

import exudyn_partition as ep
from exudyn_partition.errors import InputError, StoppedRunWarning
from exudyn_partition.reference.integrator import HHT
from exudyn_partition.surfaces.rows import pair_surfaces


@pytest.fixture(scope="module")
def bars():
    """Two equal square bars without lateral contraction, end to end (Saint-Venant)."""
    material = ep.Material(E=1.0, nu=0.0, rho=1.0)
    upper = ep.fe_model(box(2, 2, 10), material, maxh=0.7)
    lower = ep.fe_model(box(2, 2, 10).Move((0, 0, -10)), material, maxh=0.77)
    return [(fem, ep.Partition.ball(fem, (0, 0, 0), 3.0)) for fem in (upper, lower)]


@pytest.fixture(scope="module")
def impact(bars):
    bodies = [ep.reference.FullBody(*bar, velocity=(0, 0, v)) for bar, v in zip(bars, (-0.1, 0.1), strict=True)]
    points = {"far end": (0, (0, 0, 10)), "other end": (1, (0, 0, -10))}
    return ep.reference.simulate(bodies, end_time=30.0, step=0.05, points=points)


def test_two_bars(impact):
    """cases.md: force 0.4 for 20 units of time; the velocities swap exactly."""
    plateau = (impact.t > 2) & (impact.t < 14)
    assert impact.force[plateau].mean() == pytest.approx(0.4, rel=5e-3)
    assert impact.force[plateau].std() < 0.02 * 0.4
    assert impact.contact_duration == pytest.approx(20, rel=0.01)
    assert impact.impulse == pytest.approx(0.4 * 20, rel=0.015)
    assert impact.velocity["far end"][impact.t > 22, 2].mean() == pytest.approx(0.1, rel=0.03)
    assert impact.velocity["other end"][impact.t > 22, 2].mean() == pytest.approx(-0.1, rel=0.03)


def test_flat_faces_take_energy_but_give_none(impact):
    """With the contact's part in Newmark's acceleration, these bars gained three times their energy."""
    assert -0.02 < impact.info["energy_error"] <= 1e-9


def test_histories_survive_saving(impact, tmp_path):
    impact.save(tmp_path / "history.npz")
    loaded = ep.History.load(tmp_path / "history.npz")
    np.testing.assert_allclose(loaded.force, impact.force, rtol=1e-6)
    np.testing.assert_allclose(loaded.velocity["far end"], impact.velocity["far end"], rtol=1e-6)
    assert loaded.info == impact.info


def test_a_history_is_found_by_the_name_it_was_saved_under(impact, tmp_path):
    """NumPy appends npz to a name without it, so that "run" was there and could not be loaded."""
    impact.save(tmp_path / "run")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    np.testing.assert_array_equal(ep.History.load(tmp_path / "run").t, impact.t)


@pytest.mark.parametrize("content", [b"", b"text", b"\x93NUMPY\x01\x00", b"PK\x03\x04damaged"])
def test_what_is_no_history_is_not_taken_for_a_pickle(content, tmp_path):
    path = tmp_path / "odd"
    path.write_bytes(content)
    with pytest.raises(InputError, match="is no history, or a damaged one") as caught:
        ep.History.load(path)
    assert "pickle" not in str(caught.value)


def test_a_history_that_was_cut_off_is_not_loaded(impact, tmp_path):
    impact.save(tmp_path / "run")
    whole = (tmp_path / "run").read_bytes()
    for end in np.linspace(1, len(whole) - 1, 20).astype(int):
        (tmp_path / "run").write_bytes(whole[:end])
        with pytest.raises(InputError, match="damaged"):
            ep.History.load(tmp_path / "run")


def test_unreadable_histories(tmp_path):
    with pytest.raises(InputError, match="there is none at"):
        ep.History.load(tmp_path / "missing.npz")
    np.savez(tmp_path / "other.npz", x=1)
    with pytest.raises(InputError, match="is no history of format 1"):
        ep.History.load(tmp_path / "other.npz")


def test_ctrl_c_ends_the_reference_with_what_it_has(bars):
    bodies = [ep.reference.FullBody(*bar, velocity=(0, 0, v)) for bar, v in zip(bars, (-0.1, 0.1), strict=True)]

    def stop(share):
        if share > 0.4:
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    with pytest.warns(StoppedRunWarning, match=r"interrupted by the user; .* kept up to t = 0\.5 s of 1 s"):
        history = ep.reference.simulate(bodies, end_time=1.0, step=0.1, progress=stop)
    assert signal.getsignal(signal.SIGINT) is before
    assert history.info["steps"] == 5
    assert len(history.t) == 6


def test_steps_that_are_none(bars):
    bodies = [ep.reference.FullBody(*bar) for bar in bars]
    with pytest.raises(InputError, match=r"step: expected at most the end time, 1 s, got 2 s"):
        ep.reference.simulate(bodies, end_time=1.0, step=2.0)
    with pytest.raises(InputError, match=r"step: 1 s in steps of 1e-20 s are 1e\+20 steps"):
        ep.reference.simulate(bodies, end_time=1.0, step=1e-20)


def test_rows_of_other_bodies(bars):
    """They used to reach beyond the end of the smaller patch's matrix."""
    full = [ep.reference.FullBody(*bar) for bar in bars]
    rows = pair_surfaces(full[0].surface, full[1].surface)
    small = [ep.reference.FullBody(fem, ep.Partition.ball(fem, (0, 0, 0), 0.8)) for fem, _ in bars]
    with pytest.raises(InputError, match="rows: are of other patches"):
        ep.reference.simulate(small, end_time=1.0, step=0.1, rows=rows)
    with pytest.raises(InputError, match="partition: is of a mesh with"):
        ep.reference.FullBody(bars[0][0], bars[1][1])


def test_bad_arguments(bars):
    body = ep.reference.FullBody(*bars[0])
    with pytest.raises(InputError, match="bodies: expected two"):
        ep.reference.simulate([body], end_time=1.0)
    with pytest.raises(InputError, match="alpha"):
        ep.reference.simulate([body, body], end_time=1.0, alpha=0.5)
    with pytest.raises(InputError, match="mass: expected one of"):
        ep.reference.FullBody(*bars[0], mass="none")


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


def test_histories_of_finite_ascending_samples():
    t = np.linspace(0, 1, 11)
    for bad, message in (
        ((t, np.full(11, np.nan), {}), "force: expected finite numbers, got nan"),
        ((t[::-1], t, {}), "t: expected times that ascend"),
        ((t, t, {"P": t}), r"P: expected shape \(11, 3\)"),
        ((t, t[:5], {}), r"force: expected shape \(11,\)"),
        ((t[:0], t[:0], {}), "t: expected at least one sample"),
    ):
        with pytest.raises(InputError, match=message):
            ep.History(*bad)
    mine = np.zeros(11)
    ep.History(t, mine, {})
    mine[0] = 1.0  # what was given stays its owner's


def test_an_unknown_run_time():
    """Of `collect`, or of a run that the clock did not see."""
    assert np.isnan(ep.Comparison({"force": 0.1}, float("nan"), 1.0, 1.0).speedup)
    assert np.isnan(ep.Comparison({"force": 0.1}, 0.0, 1.0, 1.0).speedup)
    with pytest.raises(InputError, match=r"time_s'\]: expected a time in s"):
        ep.compare(wave(0, 1), replace(wave(0, 1), info={"time_s": "fast"}))


@pytest.mark.parametrize("alpha", [0.0, 0.1, 0.3])
def test_the_integrator_is_of_second_order_and_keeps_or_loses_energy(alpha):
    """A mass on a spring, let go with a velocity: u = v / w sin(w t)."""
    one, errors = sp.csr_matrix([[1.0]]), []
    for steps in (50, 100, 200):
        hht = HHT(one, 4.0 * one, one, 3.0 / steps, alpha=alpha, velocity=np.array([2.0]))
        energy = hht.energy()
        for _ in range(steps):
            hht.predict()
            hht.correct(np.zeros(1))
        errors.append(abs(hht.u[0] - np.sin(6.0)))
        assert hht.energy() == pytest.approx(energy, rel=1e-12) if alpha == 0 else hht.energy() < energy
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.3)


def test_forces_that_the_compliance_asks_for_close_the_gap_at_the_end_of_a_step():
    M, K = sp.csr_matrix(np.diag([1.0, 2.0])), sp.csr_matrix([[2.0, -1.0], [-1.0, 1.0]])
    G = sp.csr_matrix([[0.0, -1.0]])
    hht = HHT(M, K, G, 0.1, velocity=np.array([0.0, 1.0]))
    force = np.linalg.solve(hht.compliance(), -hht.predict())
    hht.correct(force)
    assert G @ hht.u == pytest.approx(0.0, abs=1e-15)
