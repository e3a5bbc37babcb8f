"""Hertz's formulas against the values of cases.md."""

import math

import pytest

import exudyn_partition as ep
from exudyn_partition.errors import InputError

STEEL = ep.Material(E=210e9, nu=0.3, rho=7850.0)
MASS = 4 / 3 * math.pi * 0.01**3 * STEEL.rho


def test_equal_spheres():
    impact = ep.hertz.impact(MASS / 2, 0.5, 0.01, 0.01, STEEL, STEEL)
    assert impact.peak_force == pytest.approx(437.6, rel=1e-3)
    assert impact.approach == pytest.approx(11.7e-6, rel=5e-3)
    assert impact.duration == pytest.approx(69.1e-6, rel=2e-3)


def test_sphere_on_rigid_plane():
    impact = ep.hertz.impact(MASS, 0.5, 0.01, math.inf, STEEL)
    assert impact.peak_force == pytest.approx(1005, rel=1e-3)
    assert impact.approach == pytest.approx(10.2e-6, rel=5e-3)
    assert impact.duration == pytest.approx(60.2e-6, rel=2e-3)


def test_static_contact_radius():
    soft = ep.Material(E=1.40625e7, nu=0.25, rho=1.0)
    assert ep.hertz.contact_radius(1e4, 2.0, math.inf, soft) == pytest.approx(0.1, rel=1e-3)


def test_equation_30():
    radius = ep.hertz.contact_radius(800.0, 0.01, math.inf, ep.STEEL, ep.ALUMINIUM)
    assert radius == pytest.approx(0.47e-3, abs=0.005e-3)


def test_planes_have_no_hertz_contact():
    with pytest.raises(InputError, match="two planes"):
        ep.hertz.contact_radius(1.0, math.inf, math.inf, STEEL)
    with pytest.raises(InputError, match="radius_1"):
        ep.hertz.contact_radius(1.0, -1.0, math.inf, STEEL)
