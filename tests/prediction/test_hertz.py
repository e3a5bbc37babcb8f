"""Hertz's formulas and Zener's impacts against values of the closed forms, and limits."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import beta, betaincinv

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.prediction import hertz

STEEL = ep.Material(E=210e9, nu=0.3, rho=7850.0)
MASS = 4 / 3 * math.pi * 0.01**3 * STEEL.rho
SPHERE_ON_PLANE = (0.01, math.inf, STEEL)
STIFFNESS = 4 / 3 * STEEL.plane_strain_modulus * 0.1
REFERENCE = Path(__file__).resolve().parents[2] / "examples" / "rod_on_plate_reference.npz"

masses = st.floats(1e-3, 1e3)
speeds = st.floats(1e-2, 10)
ratios = st.floats(1e-3, 20)  # of the limits by mass and by impedance


def limits(mass, speed, impedance):
    return (STIFFNESS**0.4 * (1.25 * mass * speed**2) ** 0.6, impedance * speed)


def with_ratio(mass, speed, ratio):
    return limits(mass, speed, math.inf)[0] / ratio / speed


def test_equal_spheres():
    impact = hertz.impact(hertz.effective(MASS, MASS), 0.5, 0.01, 0.01, STEEL, STEEL)
    assert impact.peak_force == pytest.approx(437.6, rel=1e-3)
    assert impact.approach == pytest.approx(11.7e-6, rel=5e-3)
    assert impact.duration == pytest.approx(69.1e-6, rel=2e-3)


def test_sphere_on_rigid_plane():
    impact = hertz.impact(hertz.effective(MASS, math.inf), 0.5, *SPHERE_ON_PLANE)
    assert impact.peak_force == pytest.approx(1005, rel=1e-3)
    assert impact.approach == pytest.approx(10.2e-6, rel=5e-3)
    assert impact.duration == pytest.approx(60.2e-6, rel=2e-3)


@settings(max_examples=20, deadline=None)
@given(masses, speeds)
def test_masses_alone_in_closed_form(mass, speed):
    impact = hertz.impact(mass, speed, *SPHERE_ON_PLANE)
    assert impact.peak_force == pytest.approx(limits(mass, speed, math.inf)[0], rel=1e-8)
    assert STIFFNESS * impact.approach**1.5 == pytest.approx(impact.peak_force, rel=1e-8)
    assert impact.duration == pytest.approx(0.8 * beta(0.4, 0.5) * impact.approach / speed, rel=1e-8)
    assert impact.contact_radius == pytest.approx(hertz.contact_radius(impact.peak_force, *SPHERE_ON_PLANE), rel=1e-8)
    assert np.trapezoid(impact.force, impact.t) == pytest.approx(2 * mass * speed, rel=1e-5)


@settings(max_examples=20, deadline=None)
@given(st.floats(1, 1e5), speeds)
def test_impedances_alone_in_closed_form(impedance, speed):
    """u' = 1 - u^(3/2), with u the approach over its limit."""
    impact = hertz.impact(math.inf, speed, *SPHERE_ON_PLANE, impedance=impedance)
    assert impact.peak_force == pytest.approx(impedance * speed, rel=1e-9)
    assert impact.approach == pytest.approx((impedance * speed / STIFFNESS) ** (2 / 3), rel=1e-9)
    assert math.isinf(impact.duration)
    rise = quad(lambda u: 1 / (1 - u**1.5), 0.1 ** (2 / 3), 0.9 ** (2 / 3))[0]
    assert impact.rise_time == pytest.approx(rise * impact.approach / speed, rel=1e-4)


def test_rods_of_saint_venant():
    """Two bars, and a bar on a wall; a stiff contact of a heavy body comes to the same force."""
    bar = ep.Material(E=1.0, nu=0.0, rho=1.0)
    impedance = hertz.effective(hertz.rod_impedance(bar, 4.0), hertz.rod_impedance(bar, 4.0))
    assert hertz.impact(math.inf, 0.2, *SPHERE_ON_PLANE, impedance=impedance).peak_force == pytest.approx(0.4)
    wall = hertz.rod_impedance(ep.Material(E=210e9, nu=0.0, rho=7800.0), math.pi * 1e-4)
    stiff = ep.Material(E=1e20, nu=0.3, rho=1.0)
    for contact, mass in ((SPHERE_ON_PLANE, math.inf), ((0.01, math.inf, stiff), 1e3)):
        assert hertz.impact(mass, 0.1, *contact, impedance=wall).peak_force == pytest.approx(1270.8, rel=1e-3)


def test_plate_impedance():
    """The plate of rod on plate: D = 818.3 N m, rho h = 13.5 kg/m2."""
    assert hertz.plate_impedance(ep.ALUMINIUM, 0.005) == pytest.approx(8 * math.sqrt(818.3 * 13.5), rel=1e-4)


@settings(max_examples=20, deadline=None)
@given(masses, speeds, ratios)
def test_mass_and_impedance_keep_momentum_energy_and_limits(mass, speed, ratio):
    impedance = with_ratio(mass, speed, ratio)
    impact = hertz.impact(mass, speed, *SPHERE_ON_PLANE, impedance=impedance)
    assert impact.peak_force <= min(limits(mass, speed, impedance)) * (1 + 1e-9)
    assert impact.force.max() == pytest.approx(impact.peak_force, rel=1e-4)
    assert impact.t[-1] == impact.duration
    assert STIFFNESS * impact.approach**1.5 == pytest.approx(impact.peak_force, rel=1e-9)
    after = speed - np.trapezoid(impact.force, impact.t) / mass
    lost = np.trapezoid(impact.force**2, impact.t) / impedance
    assert mass * after**2 / 2 + lost == pytest.approx(mass * speed**2 / 2, rel=1e-3)


@settings(max_examples=10, deadline=None)
@given(masses, speeds, ratios, st.floats(1.01, 10))
def test_more_of_anything_means_more_force(mass, speed, ratio, factor):
    impedance = with_ratio(mass, speed, ratio)

    def peak(mass=mass, speed=speed, impedance=impedance, E=210e9):
        return hertz.impact(mass, speed, 0.01, math.inf, ep.Material(E, 0.3, 1.0), impedance=impedance).peak_force

    least, tolerance = peak(), 1 + 1e-8
    assert peak(mass=factor * mass) * tolerance >= least
    assert peak(impedance=factor * impedance) * tolerance >= least
    assert peak(E=factor * 210e9) * tolerance >= least
    assert peak(speed=factor * speed) > least


def rod_with_reflections(mass, impedance):
    """Peak force of a uniform rod on a wall, k = speed = 1: each wave returns doubled after 2 mass / impedance."""
    delay = 200
    step = 2 * mass / impedance / delay
    force, returned = [0.0], [0.0]
    y = 0.0
    while y >= 0:
        n = len(force)
        returned.append(returned[n - delay] + force[n - delay] if n >= delay else 0.0)
        for _ in range(20):  # the contact, finer than the wave
            middle = y + step / 40 * (1 - (max(y, 0) ** 1.5 + 2 * returned[n]) / impedance)
            y += step / 20 * (1 - (max(middle, 0) ** 1.5 + 2 * returned[n]) / impedance)
        force.append(max(y, 0) ** 1.5)
    return max(force)


@pytest.mark.parametrize("ratio", [0.1, 0.5, 1.0, 2.0, 10.0])
def test_a_rod_between_compact_body_and_wave_guide(ratio):
    """The lower limit is above its peak and nearer to it than mass and impedance together, which are below."""
    impedance = 1.25**0.6 / ratio
    peak = rod_with_reflections(1.0, impedance)
    lower = min(1.25**0.6, impedance)
    unit = ep.Material(E=0.75, nu=0.0, rho=1.0)  # k = 1
    together = hertz.impact(1.0, 1.0, 1.0, math.inf, unit, impedance=impedance).peak_force
    assert together < peak < lower * 1.005
    assert abs(lower - peak) < abs(together - peak)


def test_hertz_pulse_holds_the_same_periods_at_any_size():
    """The pulse from t = 2/5 B(y^(5/2); 2/5, 1/2) d / v, resampled: another way to the same periods."""
    y = betaincinv(0.4, 0.5, np.linspace(0, 1, 4001)) ** 0.4
    t = np.linspace(0, 0.5, 4001)
    pulse = np.r_[y, y[-2::-1]] ** 1.5
    expected = ep.truncation_frequency(np.r_[t, 1 - t[-2::-1]], pulse)
    for mass, speed in ((MASS, 0.5), (30.0, 0.01)):
        impact = hertz.impact(mass, speed, *SPHERE_ON_PLANE)
        assert impact.truncation_frequency() * impact.duration == pytest.approx(expected, rel=1e-3)


def test_what_lasts_for_ever_has_no_truncation_frequency():
    with pytest.raises(InputError, match="contact without end"):
        hertz.impact(math.inf, 1.0, *SPHERE_ON_PLANE, impedance=100.0).truncation_frequency()


def test_rod_on_plate_before_any_mesh():
    """Estimates beside the stored full FE history: the force until waves return, and the truncation frequency."""
    rod, plate = ep.STEEL.rho * math.pi * 0.01**2 * (0.79 + 0.02 / 3), ep.ALUMINIUM.rho * 0.25**2 * 0.005
    impedance = hertz.effective(
        hertz.rod_impedance(ep.STEEL, math.pi * 0.01**2), hertz.plate_impedance(ep.ALUMINIUM, 0.005)
    )
    history = ep.History.load(REFERENCE)
    contact = (0.596, 0.01, math.inf, ep.STEEL, ep.ALUMINIUM)
    limit = hertz.impact(math.inf, *contact, impedance=impedance)
    assert limit.peak_force == pytest.approx(history.until(150e-6).peak_force, rel=0.02)
    assert history.peak_force < hertz.impact(hertz.effective(rod, plate), *contact).peak_force
    estimate = hertz.impact(hertz.effective(rod, plate), *contact, impedance=impedance).truncation_frequency()
    assert estimate == pytest.approx(ep.truncation_frequency(history.t, history.force), rel=0.2)


def test_static_contact_radius():
    soft = ep.Material(E=1.40625e7, nu=0.25, rho=1.0)
    assert hertz.contact_radius(1e4, 2.0, math.inf, soft) == pytest.approx(0.1, rel=1e-3)


def test_equation_30():
    radius = hertz.contact_radius(800.0, 0.01, math.inf, ep.STEEL, ep.ALUMINIUM)
    assert radius == pytest.approx(0.47e-3, abs=0.005e-3)


@pytest.mark.parametrize(("ball", "socket"), [(0.01, 0.0101), (0.01, 0.02), (0.002, 1.0)])
def test_a_ball_in_its_socket_is_a_larger_ball_on_a_plane(ball, socket):
    """Johnson, Contact Mechanics, section 4.2: 1 / R = 1 / R1 + 1 / R2, with a concave surface's radius below zero."""
    R, E = 1 / (1 / ball - 1 / socket), STEEL.plane_strain_modulus / 2
    assert hertz.contact_radius(50.0, ball, -socket, STEEL, STEEL) == pytest.approx((3 * 50.0 * R / (4 * E)) ** (1 / 3))
    assert hertz.contact_radius(50.0, -socket, ball, STEEL, STEEL) == pytest.approx((3 * 50.0 * R / (4 * E)) ** (1 / 3))
    found, plane = (hertz.impact(0.1, 0.5, *radii, STEEL, STEEL) for radii in ((ball, -socket), (R, math.inf)))
    assert found.peak_force == pytest.approx(plane.peak_force, rel=1e-9)
    assert found.duration == pytest.approx(plane.duration, rel=1e-9)
    assert found.peak_pressure == pytest.approx(1.5 * found.peak_force / (math.pi * found.contact_radius**2), rel=1e-9)


@pytest.mark.parametrize("radii", [(0.01, -0.01), (0.01, -0.009), (-0.01, -0.02), (-0.01, math.inf), (math.inf, -0.01)])
def test_surfaces_that_fit_touch_at_no_point(radii):
    with pytest.raises(InputError, match="radius_1, radius_2: expected surfaces that touch at a point"):
        hertz.contact_radius(1.0, *radii, STEEL)


def test_planes_have_no_hertz_contact():
    with pytest.raises(InputError, match="two planes"):
        hertz.contact_radius(1.0, math.inf, math.inf, STEEL)
    with pytest.raises(InputError, match="radius_1"):
        hertz.contact_radius(1.0, -1.0, math.inf, STEEL)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"mass": 0.0}, "mass: expected"),
        ({"mass": math.nan}, "mass: expected"),
        ({"mass": "heavy"}, "mass: expected"),
        ({"mass": math.inf}, "at least one of them finite"),
        ({"speed": -1.0}, "speed: expected"),
        ({"speed": math.inf}, "speed: expected"),
        ({"impedance": 0.0}, "impedance: expected"),
        ({"radius_1": math.inf}, "two planes"),
    ],
)
def test_bad_input_of_impacts(changed, message):
    fine = {"mass": 1.0, "speed": 1.0, "radius_1": 0.01, "radius_2": math.inf, "material_1": STEEL}
    with pytest.raises(InputError, match=message):
        hertz.impact(**{**fine, **changed})


def test_bad_input_of_impedances():
    with pytest.raises(InputError, match="area"):
        hertz.rod_impedance(STEEL, 0.0)
    with pytest.raises(InputError, match="thickness"):
        hertz.plate_impedance(STEEL, -1.0)
    with pytest.raises(InputError, match="second"):
        hertz.effective(1.0, 0.0)


def test_an_impact_prints_itself_in_a_line():
    text = str(hertz.impact(0.03, 1.0, 0.01, math.inf, ep.STEEL))
    assert re.fullmatch(
        r"HertzImpact\(peak force \d+ N, approach \S+ m, .*, contact radius \S+ m, 10\.6 times the yield stress\)", text
    )
    assert len(text) < 170


IMPACT = {
    "mass": 1.0,
    "speed": 1.0,
    "radius_1": 0.01,
    "radius_2": 0.01,
    "material_1": STEEL,
    "material_2": STEEL,
    "impedance": math.inf,
}


@pytest.mark.parametrize("name", IMPACT)
@pytest.mark.parametrize("value", ["x", True, math.nan, -1, 1e-300, 1e300, [1], np.ones(2), 1j], ids=str)
def test_what_is_no_impact_is_named(name, value):
    if name.startswith("radius") and type(value) is int:
        value = 0  # a hollow has a radius below zero
    with pytest.raises(InputError, match=f"^{name}: expected "):
        hertz.impact(**{**IMPACT, name: value})


@settings(deadline=None, max_examples=20)
@given(*(st.floats(-30, 30) for _ in range(4)))
def test_impacts_of_any_size_are_impacts_or_refused(mass, speed, radius, impedance):
    """Over 60 orders of magnitude: finite, no more than either limit, or an error of ours."""
    mass, speed, radius, impedance = (10.0**x for x in (mass, speed, radius, impedance))
    try:
        found = hertz.impact(mass, speed, radius, math.inf, STEEL, impedance=impedance)
    except InputError as error:
        assert "mass, impedance: the force would rise" in str(error)  # noqa: PT017, for it may also do without
        return
    by_mass = (4 / 3 * STEEL.plane_strain_modulus * math.sqrt(radius)) ** 0.4 * (1.25 * mass * speed**2) ** 0.6
    assert 0 < found.peak_force < 1.0001 * min(by_mass, impedance * speed)
    assert 0 < found.rise_time < found.duration < math.inf
    assert np.isfinite(found.force).all()


@pytest.mark.parametrize("call", [lambda x: hertz.rod_impedance(x, 1.0), lambda x: hertz.plate_impedance(x, 1.0)])
def test_what_is_no_material_is_named(call):
    with pytest.raises(InputError, match=r"material: expected what .* a Material, got str"):
        call("steel")
