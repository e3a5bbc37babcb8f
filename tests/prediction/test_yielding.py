"""First yield beneath Hertz's contact: stress by summing point loads, force and speed by closed forms."""

import math

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.integrate import quad

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.prediction import hertz
from exudyn_partition.prediction.yielding import Stress, von_mises_factor

HARD = ep.Material(E=210e9, nu=0.3, rho=7800.0, yield_stress=1e9)
SOFT = ep.Material(E=70e9, nu=0.2, rho=2700.0, yield_stress=0.3e9)
UNKNOWN = ep.Material(E=70e9, nu=0.2, rho=2700.0)


def on_the_axis(nu, ratio, z):
    """Von Mises stress at depth z beneath p0 = 1 on an ellipse with a = 1: the sum of Boussinesq's point loads."""
    g, w = leggauss(32)
    angle, share = ((g + 1) * np.pi / 4)[:, None], (w * np.pi)[:, None]  # four equal quarters
    edge = 1 / np.sqrt(np.cos(angle) ** 2 + (np.sin(angle) / ratio) ** 2)
    g, w = leggauss(120)
    u = (g + 1) * np.pi / 4
    r = edge * np.sin(u)
    load = np.cos(u) * r * edge * np.cos(u) * w * np.pi / 4 * share
    rho = np.hypot(r, z)
    common = (1 - 2 * nu) * (1 - z / rho) / r**2
    axial = -3 * z**3 / rho**5 / (2 * np.pi)
    radial = (common - 3 * z * r**2 / rho**5) / (2 * np.pi)
    hoop = -(common - (1 - 2 * nu) * z / rho**3) / (2 * np.pi)
    c, s = np.cos(angle) ** 2, np.sin(angle) ** 2
    x, y, z = ((load * part).sum() for part in (radial * c + hoop * s, radial * s + hoop * c, axial))
    return math.sqrt(((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) / 2)


@pytest.mark.parametrize(("nu", "ratio"), [(0.3, 1.0), (0.0, 1.0), (0.45, 0.6), (0.3, 0.6), (0.3, 0.15)])
def test_the_largest_stress_is_that_of_point_loads(nu, ratio):
    largest = max(on_the_axis(nu, ratio, z) for z in np.linspace(0.3, 0.8, 26) * ratio)
    assert von_mises_factor(nu, ratio) == pytest.approx(largest, rel=3e-4)


def test_a_long_contact_is_a_line():
    """McEwen's field beneath a line contact, in plane strain (Johnson, section 4.2)."""
    z, nu = np.linspace(0, 1.5, 2000), 0.3
    x, axial = -((1 + 2 * z**2) / np.sqrt(1 + z**2) - 2 * z), -1 / np.sqrt(1 + z**2)
    y = nu * (x + axial)
    stress = np.sqrt(((x - y) ** 2 + (y - axial) ** 2 + (axial - x) ** 2) / 2)
    assert von_mises_factor(nu, 0.0) == pytest.approx(stress.max(), rel=2e-3)


def test_first_yield_of_a_sphere_on_a_plane():
    """P_Y = pi^3 R^2 p0^3 / (6 E*^2) with p0 = 1.60 Y; Y changes it by the third power, and the speed by 5/2."""
    mass, R = 0.03, 0.01
    found = hertz.impact(mass, 0.5, R, math.inf, HARD, UNKNOWN)
    modulus = 1 / (1 / HARD.plane_strain_modulus + 1 / UNKNOWN.plane_strain_modulus)
    p_y = 1e9 / von_mises_factor(0.3)
    assert p_y == pytest.approx(1.60e9, rel=0.01)
    force = math.pi**3 * R**2 * p_y**3 / (6 * modulus**2)
    assert found.yield_force == pytest.approx(force, rel=1e-9)
    assert found.yield_ratio == pytest.approx((found.peak_force / force) ** (1 / 3), rel=1e-9)
    a = hertz.contact_radius(found.peak_force, R, math.inf, HARD, UNKNOWN)
    assert found.peak_pressure == pytest.approx(1.5 * found.peak_force / (math.pi * a**2), rel=1e-9)
    depth = (force / (4 / 3 * modulus * math.sqrt(R))) ** (2 / 3)
    work = quad(lambda d: 4 / 3 * modulus * math.sqrt(R) * d**1.5, 0, depth)[0]
    assert found.yield_speed == pytest.approx(math.sqrt(2 * work / mass), rel=1e-6)
    assert f"{found.yield_ratio:.3g} times the yield stress" in repr(found)


@pytest.mark.parametrize("impedance", [300.0, 3e3, 3e4])  # from waves to masses
def test_at_the_speed_of_first_yield_bodies_yield(impedance):
    arguments = (0.01, math.inf, HARD, SOFT)
    found = hertz.impact(0.03, 1.0, *arguments, impedance=impedance)
    again = hertz.impact(0.03, found.yield_speed, *arguments, impedance=impedance)
    assert again.yield_ratio == pytest.approx(1, rel=2e-3)


@pytest.mark.parametrize("speed", [0.01, 0.5, 5.0])
def test_the_plastic_zone_is_as_large_as_the_impact(speed):
    """Twice as large bodies at the same speed have twice as large stress fields; faster ones flow further around."""
    found, twice, slower = (
        hertz.impact(mass, v, R, math.inf, HARD, SOFT)
        for mass, v, R in ((0.03, speed, 0.01), (0.24, speed, 0.02), (0.03, 0.9 * speed, 0.01))
    )
    assert twice.plastic_radius == pytest.approx(2 * found.plastic_radius, rel=1e-9)
    share, before = (one.plastic_radius / one.contact_radius for one in (found, slower))
    assert share >= before * (1 - 1e-9) > 1.0  # an elastic contact is stressed most at half of its radius
    assert (share > 1.01 * before) == (found.yield_ratio > 2)


def test_in_a_soft_body_flow_reaches_further():
    found = [hertz.impact(0.03, 1.0, 0.01, math.inf, HARD, one).plastic_radius for one in (SOFT, HARD, UNKNOWN)]
    assert found[0] > 1.5 * found[1]
    assert found[1] > hertz.impact(0.03, 1.0, 0.01, math.inf, HARD, UNKNOWN).contact_radius
    assert hertz.impact(0.03, 0.5, 0.01, math.inf, UNKNOWN).plastic_radius is None


def test_waves_alone_limit_the_force():
    found = hertz.impact(math.inf, 0.5, 0.01, math.inf, SOFT, impedance=1e3)
    assert found.yield_speed == pytest.approx(found.yield_force / 1e3, rel=1e-6)


def test_the_body_that_yields_first_counts():
    for materials, weakest in (((HARD, SOFT), 1), ((SOFT, HARD), 0), ((HARD, UNKNOWN), 0), ((UNKNOWN, HARD), 1)):
        stress = Stress.beneath(100.0, (2e-4, 1e-4), materials)
        assert stress.weakest == weakest
        expected = stress.pressure * von_mises_factor(materials[weakest].nu, 0.5) / materials[weakest].yield_stress
        assert stress.yield_ratio == pytest.approx(expected)
        assert "second" in stress.advice(("first", "second")) or not weakest
    for materials in ((UNKNOWN,), (None, UNKNOWN)):
        stress = Stress.beneath(100.0, (2e-4, 1e-4), materials)
        assert stress.yield_ratio is stress.yield_force is stress.weakest is None
        assert stress.advice(("first", "second")) == ""
    unknown = hertz.impact(0.03, 0.5, 0.01, math.inf, UNKNOWN)
    assert unknown.yield_ratio is unknown.yield_force is unknown.yield_speed is None
    assert "yield" not in repr(unknown)


def test_a_flat_contact_is_pressed_like_a_bar():
    """An even pressure on a disc, whose moments are those of Hertz's on a disc 1.118 times as large."""
    radius, even = 1e-3, 0.25e9
    axes = (math.sqrt(5) / 2 * radius,) * 2
    stress = Stress.beneath(even * math.pi * radius**2, axes, [SOFT], mean=even)
    assert stress.pressure == pytest.approx(1.2 * even)
    assert stress.flat
    assert stress.von_mises == (even,)
    assert stress.yield_force == pytest.approx(stress.force * 0.3 / 0.25)


@pytest.mark.parametrize(("value", "message"), [
    (355, "yield_stress: solids yield at 1e-06 to 1 of Young's modulus.* got 355, .* Is it in MPa, and E in Pa"),
    (355e15, "yield_stress: solids yield"), (0.0, "yield_stress: expected"), (-1e8, "yield_stress: expected"),
    (math.nan, "yield_stress: expected"), ("355", "yield_stress: expected"), (True, "yield_stress: expected"),
])  # fmt: skip
def test_yield_stresses_that_are_none(value, message):
    with pytest.raises(InputError, match=message):
        ep.Material(E=210e9, nu=0.3, rho=7800.0, yield_stress=value)


def test_other_units_are_fine():
    assert ep.Material(E=210e3, nu=0.3, rho=7.8e-9, yield_stress=355).yield_stress == 355
    for material in (ep.STEEL, ep.ALUMINIUM):  # typical ones: between a soft grade and a hard one
        assert 5e-4 < material.yield_stress / material.E < 1e-2
