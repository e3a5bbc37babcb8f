"""The full FE reference on a case with a closed answer, and histories."""

import signal

import pytest
from oracles import box, ctrl_c_after

import exudyn_partition as ep
from exudyn_partition.errors import InputError, StoppedRunWarning
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
    """Saint-Venant: force 0.4 for 20 units of time; the velocities swap exactly."""
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


def test_ctrl_c_ends_the_reference_with_what_it_has(bars):
    bodies = [ep.reference.FullBody(*bar, velocity=(0, 0, v)) for bar, v in zip(bars, (-0.1, 0.1), strict=True)]

    before = signal.getsignal(signal.SIGINT)
    with pytest.warns(StoppedRunWarning, match=r"interrupted by the user; .* kept up to t = 0\.5 s of 1 s"):
        history = ep.reference.simulate(bodies, end_time=1.0, step=0.1, progress=ctrl_c_after(0.4))
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
