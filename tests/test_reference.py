"""The full FE reference on a case with a closed answer, and histories."""

import numpy as np
import pytest
from conftest import box

import exudyn_partition as ep
from exudyn_partition.errors import InputError


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


def test_unreadable_histories(tmp_path):
    with pytest.raises(InputError, match="there is no"):
        ep.History.load(tmp_path / "missing.npz")
    np.savez(tmp_path / "other.npz", x=1)
    with pytest.raises(InputError, match="is no history of format 1"):
        ep.History.load(tmp_path / "other.npz")


def test_ctrl_c_ends_the_reference_with_what_it_has(bars):
    bodies = [ep.reference.FullBody(*bar, velocity=(0, 0, v)) for bar, v in zip(bars, (-0.1, 0.1), strict=True)]

    def stop(share):
        if share > 0.4:
            raise KeyboardInterrupt

    history = ep.reference.simulate(bodies, end_time=1.0, step=0.1, progress=stop)
    assert history.info["steps"] == 5
    assert len(history.t) == 6


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
