"""Forces that ring: flat faces and facets that pass by, told from real oscillations; impacts, speeds and means."""

import re
from types import SimpleNamespace

import exudyn as exu
import numpy as np
import pytest
from oracles import box
from scipy.integrate import solve_ivp

import exudyn_partition as ep
from exudyn_partition.errors import InputError, ModelLimitWarning, YieldWarning
from exudyn_partition.results.impacts import joined, ringing, rings_by_facets, running_mean
from exudyn_partition.results.newmark import Newmark
from exudyn_partition.simulation.reviews.ringing import damping_steps

LENGTH, SIDE, SPEED = 0.2, 0.01, 1.0
STEEL = ep.Material(E=210e9, nu=0.0, rho=7800.0, yield_stress=60e6)  # the mean stress of the impact is 40 MPa
LASTS = 2 * LENGTH / STEEL.bar_wave_speed
PLATEAU = STEEL.rho * STEEL.bar_wave_speed * SIDE**2 * SPEED
F_CUT = 8 / LASTS


@pytest.fixture(scope="module")
def rod():
    fem = ep.fe_model(box(SIDE, SIDE, LENGTH), STEEL, maxh=SIDE)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 0.75 * SIDE), f_cut=F_CUT)


def on_wall(rod, *, frame="inertial", damping=None, contacts=1, **options):
    """The rod's flat end meets a rigid plane, once or on several rods; result, first rod, first contact."""
    mbs = exu.SystemContainer().AddSystem()
    pairs = []
    for i in range(contacts):
        place, way = [0.1 * i, 0, 1e-6], [0, 0, -SPEED]
        item = ep.CreatePartitionBody(
            mbs, rod, frame=frame, damping=damping, referencePosition=place, initialVelocity=way
        )
        pairs.append((item, ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), name=f"wall {i}")))
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=1.5 * LASTS, **options), *pairs[0]


@pytest.mark.parametrize("frame", ["inertial", "floating"])
@pytest.mark.filterwarnings("ignore:the force rings")
def test_a_flat_rod_on_a_wall_has_saint_venant_s_impact(rod, frame):
    """Force rho c A v for 2 L / c, and the speed turns round; vibration keeps the rest."""
    result, _, contact = on_wall(rod, frame=frame)
    (impact,) = contact.impacts(result, merge=1 / F_CUT)
    assert impact.end - impact.start == pytest.approx(LASTS, rel=0.06)
    assert impact.mean_force == pytest.approx(PLATEAU, rel=0.04)
    assert impact.speed_before == pytest.approx(SPEED, rel=1e-9)
    assert impact.speed_after == pytest.approx(SPEED, rel=0.06)
    assert impact.impulse == pytest.approx(rod.total_mass * (impact.speed_before + impact.speed_after), rel=1e-3)
    means = contact.mean_force(result)
    assert means.max() == pytest.approx(PLATEAU, rel=0.06)
    assert contact.force(result).max() > 2 * PLATEAU
    np.testing.assert_array_equal(means, contact.mean_force(result, contact.ringing(result).window))
    middle = np.searchsorted(result.t, impact.start + LASTS / 2)
    assert contact.mean_force(result, 0.7 * LASTS)[middle] == pytest.approx(PLATEAU, rel=0.03)
    for wrong in ({"merge": -1.0}, {"merge": "long"}):
        with pytest.raises(InputError, match="merge: expected a time"):
            contact.impacts(result, **wrong)
    with pytest.raises(InputError, match="window: expected"):
        contact.mean_force(result, 0.0)


def test_the_ringing_is_said_of_every_contact_with_its_own_numbers(rod):
    with pytest.warns(ModelLimitWarning, match="the force rings") as caught:
        result, _, contact = on_wall(rod, contacts=2)
    said = str(caught[0].message)
    assert "'wall 0' at t" in said
    assert "'wall 1' at t" in said
    rings = contact.ringing(result)
    force = contact.force(result)
    assert f"{1e-3 / rings.period:.3g} kHz, peak {force.max():.4g} N" in said
    spectrum = abs(np.fft.rfft((force - contact.mean_force(result))[force > 0], 1 << 14))
    frequency = np.fft.rfftfreq(1 << 14, result.step)[spectrum.argmax()]
    assert 1 / rings.period == pytest.approx(frequency, rel=0.1)


@pytest.mark.parametrize("options", [
    {"method": "implicit", "spectral_radius": 0.3, "step": 0.1 / F_CUT},
    {"damping": lambda f: np.where(f > 0.7 * F_CUT, 0.3, 0.0)},
])  # fmt: skip
def test_damping_that_smooths_a_force_is_not_advised_and_tells_the_energy_that_it_takes(rod, options):
    with pytest.warns(ModelLimitWarning) as caught:
        result, item, contact = on_wall(rod, **options)
    rings, taken = (
        next(str(w.message) for w in caught if said in str(w.message)) for said in ("rings", "damping took")
    )
    assert "spectral_radius" not in rings
    assert "ratio" not in rings
    energy = item.energy(result) + contact.energy(result)
    (told,) = map(float, re.findall(r"([\d.]+)%", taken))
    assert told == pytest.approx(100 * (1 - energy[-1] / energy[0]), abs=0.5)
    assert ("less damping of modes" in taken) == ("damping" in options)  # each with a remedy of its own
    assert ("shorter steps" in taken and "spectral_radius" in taken) == ("step" in options)


@pytest.mark.filterwarnings("ignore:the force rings")
def test_a_yield_warning_of_a_peak_that_rings_says_so_and_comes_once(rod, tmp_path):
    with pytest.warns(YieldWarning) as caught:
        result, _, contact = on_wall(rod, contacts=3)
    (said,) = (str(w.message) for w in caught if w.category is YieldWarning)
    assert "the worst of 3 contacts beyond first yield" in said
    assert "below it, so that this may be a false alarm" in said
    assert contact.mean_force(result).max() < 60e6 * SIDE**2 < contact.force(result).max()
    page = result.report(tmp_path / "run.html").read_text()
    assert page.count("it rings: read means") == 3
    assert page.count("so that this may be a false alarm") == 1  # of contacts that are all alike


def test_parts_of_an_impact_are_joined(mbs, marble):
    """Two bounces of a ball, by their times and impulses, and as one impact."""
    assert joined([(0, 1), (1.5, 2), (2.6, 3)], 0.55) == [[0, 1], [2]]
    options = {"gravity": [0, 0, -2e4], "initialVelocity": [0.3, 0, -0.5], "referencePosition": [0, 0, 5e-3]}
    item = ep.CreatePartitionBody(mbs, marble, **options)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch="south")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=0.14e-3, step=0.2e-6)
    first, second = contact.impacts(result)
    (both,) = contact.impacts(result, merge=1e-3)
    assert (both.parts, both.start, both.end) == (2, first.start, second.end)
    assert both.impulse == pytest.approx(first.impulse + second.impulse, rel=1e-12)
    speeds = first.speed_before, second.speed_after  # at places of their own: the ball slides
    assert (both.speed_before, both.speed_after) == pytest.approx(speeds, rel=1e-5)
    assert first.speed_before == pytest.approx(0.5, rel=1e-2)
    (unfinished,) = contact.impacts(ep.solve_dynamic(mbs, end_time=10e-6, step=0.2e-6))
    assert unfinished.speed_after is None
    assert second.speed_before == pytest.approx(first.speed_after, rel=1e-2)  # it falls as fast as it rose


def test_pulses_and_what_a_basis_resolves_do_not_ring():
    t = np.linspace(0, 1, 2001)
    pulse = np.maximum(np.sin(3 * np.pi * t), 0.0)
    assert ringing(t, pulse, 2.0) is None  # two pulses, however short they are
    spike = np.where(t < 0.6, 1.0, 0.0) + 0.7 * np.exp(-((t / 0.02 - 2) ** 2))
    found = ringing(t, spike, 0.15)
    assert found.peak == pytest.approx(1.7, rel=1e-3)
    assert 1.0 < found.mean < 1.2
    assert ringing(t, spike, 0.03) is None  # which resolves it
    for period, rings in ((0.02, True), (0.2, False)):
        force = pulse * (1 + 0.9 * np.cos(2 * np.pi * t / period))
        found = ringing(t, force, 0.03)
        assert (found is not None) == rings
        if found is not None:
            assert found.period == pytest.approx(period, rel=0.05)
            assert found.mean == pytest.approx(1.0, abs=0.03)
    mean = running_mean(t, t**2, 0.1)
    np.testing.assert_allclose(mean[100:-100], t[100:-100] ** 2 + 0.1**2 / 12, atol=1e-6)


@pytest.mark.parametrize(("wave", "lift", "told"), [(0.1e-6, 0.0, True), (0.0, 0.0, False), (0.1e-6, 1.2, False)])
def test_facets_that_pass_are_told_from_a_follower_that_leaves_its_cam(wave, lift, told):
    """A mass on a unilateral spring over the waves of a mesh; a base that falls as fast as `lift` times the load."""
    mass, k, damper, load, rate, turn = 0.2, 2e8, 40.0, 60.0, 5e3, 2 * np.pi / 4e-3
    assert np.sqrt(k / mass) / (2 * np.pi * rate) == pytest.approx(1.0, rel=0.01)

    def force(t, x, v):
        fall = lift * load / mass / turn**2 * (1 - np.cos(turn * t))
        return np.maximum(k * (wave * np.sin(2 * np.pi * rate * t) - fall - x) - damper * v, 0.0)

    def rates(t, y):
        return [y[1], (force(t, *y) - load) / mass]

    times = np.linspace(0, 0.02, 2001)
    path = solve_ivp(rates, (0, times[-1]), [-load / k, 0.0], t_eval=times, rtol=1e-6, atol=1e-11, max_step=2e-5).y
    found = rings_by_facets(times, force(times, *path), rate)
    assert (found is not None) == told
    if found is not None:
        assert found == pytest.approx(rate, rel=0.1)


def run_of(method, step, radius=None):
    """As much of a result as the advice asks: method, step, and what generalized-alpha took of a spectral radius."""
    alphas = {} if radius is None else {"alpha_m": (2 * radius - 1) / (1 + radius), "alpha_f": radius / (1 + radius)}
    newmark = Newmark(**alphas, beta=0.25, gamma=0.5) if alphas else None
    return SimpleNamespace(method=method, step=step, newmark=newmark)


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_run_that_is_implicit_is_not_told_to_be(method):
    """It only needs other steps, and more damping of what they do not resolve."""
    advice = damping_steps(run_of(method, 1e-6, 0.9 if method == "implicit" else None), 5e3)
    assert ("method='implicit'" in advice) == (method == "explicit")
    assert "spectral_radius=0.3" in advice
    assert "steps of 0.0002 s or longer" in advice


@pytest.mark.parametrize("radius", [0.0, 0.3])
def test_a_run_is_not_told_to_damp_as_it_does(radius):
    """Only to take longer steps; and nothing, if it has these too."""
    advice = damping_steps(run_of("implicit", 1e-6, radius), 5e3)
    assert "spectral_radius" not in advice
    assert "steps of 0.0002 s or longer" in advice
    assert damping_steps(run_of("implicit", 3e-4, radius), 5e3) == ""
    assert "longer" not in damping_steps(run_of("implicit", 3e-4, 0.9), 5e3)
