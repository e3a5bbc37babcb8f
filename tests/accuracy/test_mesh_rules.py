"""Sizes by rule: wavelengths that are known, and what decides on the order."""

import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.accuracy.mesh_rules import (
    Sizes,
    bending_wavelength,
    count_of_dofs,
    curvature_for,
    energy_frequency,
    sizes_by_rule,
)
from exudyn_partition.meshing.netgen_mesh import CURVATURE

LONG_WAVE = 100.0  # frequency at which a bending wave is much longer than the plate is thick [Hz]


def test_long_bending_waves_are_kirchhoff_s():
    thickness, material = 1e-3, ep.ALUMINIUM
    stiffness = material.plane_strain_modulus * thickness**3 / 12
    k = (material.rho * thickness * (2 * np.pi * LONG_WAVE) ** 2 / stiffness) ** 0.25
    assert bending_wavelength(LONG_WAVE, thickness, material) == pytest.approx(2 * np.pi / k, rel=1e-3)
    assert bending_wavelength(LONG_WAVE, np.inf, material) == np.inf


def test_elements_follow_the_wave_and_the_contact():
    """At a quarter of the frequency bending waves of a thin plate are twice as long; blocks follow shear waves."""
    sides = np.array([0.08, 0.06, 0.004])
    plate = ep.fe_model(box(*sides), ep.ALUMINIUM, maxh=0.012)
    axes = (3e-4, 3e-4)
    fast, slow = (sizes_by_rule(plate, sides, f, axes, 0.04) for f in (4e3, 1e3))
    assert (fast.order, slow.order) == (3, 3)
    assert bending_wavelength(1e3, sides[2], ep.ALUMINIUM) > 1.9 * bending_wavelength(4e3, sides[2], ep.ALUMINIUM)
    assert fast.far == pytest.approx(bending_wavelength(4e3, sides[2], ep.ALUMINIUM) / 4, rel=0.02)
    assert slow.far == sides[0] / 3
    block = ep.fe_model(box(0.03, 0.03, 0.03), ep.STEEL, maxh=0.01)
    stocky = sizes_by_rule(block, np.full(3, 0.03), 20e3, axes, 0.01)
    assert stocky.far <= 0.03 / 1.3
    assert 0 < stocky.near < 3e-4
    assert sizes_by_rule(block, np.full(3, 0.03), 20e3, axes, 0.01, slave=True).near < stocky.near
    # A contact that is longer, and as wide, takes elements that are larger, but fewer of them across than along.
    long = sizes_by_rule(block, np.full(3, 0.03), 20e3, (1.2e-3, 3e-4), 0.01)
    assert stocky.near < long.near < 2 * stocky.near
    longer = sizes_by_rule(block, np.full(3, 0.03), 20e3, (4.8e-3, 3e-4), 0.01)
    assert longer.near == long.near < 1.1 * 3e-4  # its width alone counts then
    # The error at the contact falls with the cube of the size, so that the size follows the cube root of the tolerance.
    rough = sizes_by_rule(block, np.full(3, 0.03), 20e3, axes, 0.04)
    assert (rough.near / stocky.near) ** 3 == pytest.approx(4)
    finer = stocky.finer(None, 0.5)
    assert finer.far == stocky.far
    assert 0.45 * stocky.near <= finer.near <= 0.93 * stocky.near


def test_sizes_follow_the_rates_by_which_errors_fall():
    """Errors fall with powers of 2 far from the contact and 3.3 at it, within what one refinement changes."""
    old = Sizes(3, 0.01, 3e-4, "")
    for allowed in (0.3, 0.5, 0.65):
        new = old.finer(allowed, allowed)
        assert (new.far / old.far) ** 2 == pytest.approx(allowed)
        assert (new.near / old.near) ** 3.3 == pytest.approx(allowed)
    assert old.finer(1e-3, None).far == 0.45 * old.far
    assert old.finer(None, 0.99).near == 0.93 * old.near
    # Quadratic elements gain less by smaller ones.
    assert (Sizes(2, 0.01, 3e-4, "").finer(None, 0.5).near / old.near) ** 2.5 == pytest.approx(0.5)


def test_thin_walls_have_no_quadratic_elements():
    """These cannot hold the parabolic shear; in stocky bodies they are smaller than cubic ones of the same error."""
    sides, axes = np.array([0.08, 0.06, 0.004]), (3e-4, 3e-4)
    plate = ep.fe_model(box(*sides), ep.ALUMINIUM, maxh=0.012)
    assert sizes_by_rule(plate, sides, 4e3, axes, 0.01).quadratic() is None
    block = ep.fe_model(box(0.03, 0.03, 0.03), ep.STEEL, maxh=0.01)
    cubic = sizes_by_rule(block, np.full(3, 0.03), 20e3, axes, 0.01)
    other = cubic.quadratic()
    assert (cubic.order, other.order) == (3, 2)
    assert cubic.near / 2 < other.near < cubic.near
    assert cubic.far / 2 < other.far < cubic.far


def test_curved_sides_have_elements_enough_for_the_volume():
    """A tenth of the tolerance may be missed, which falls at least with the power 2.5 of their number in a radius."""
    missed, tolerance = 2e-3, 0.01
    needed = curvature_for(1.3, missed, tolerance)
    assert missed * (1.3 / needed) ** 2.5 == pytest.approx(0.1 * tolerance)
    assert curvature_for(1.3, 1.0, tolerance) == 1.5 * CURVATURE
    assert curvature_for(2.0, 1e-9, tolerance) == 1.3


@pytest.mark.parametrize("order", [1, 2, 3])
def test_dofs_are_counted_before_assembly(order):
    mesh = ep.generate_mesh(box(0.01, 0.02, 0.03), maxh=9e-3)
    expected = count_of_dofs(mesh, order)
    assert ep.fe_model(mesh, ep.STEEL, order=order).n_dofs == expected


def test_the_frequency_holds_99_percent_of_the_energy():
    """Of a half sine of length T: by quadrature of its spectrum, cos^2(pi f T) / (1 - (2 f T)^2)^2."""
    t, T = np.linspace(0, 2e-3, 4001), 1e-3
    force = np.where(t < T, np.sin(np.pi * t / T), 0.0)
    x = np.linspace(1e-6, 60, 600_001)
    density = np.cos(np.pi * x) ** 2 / (1 - 4 * x**2) ** 2
    share = np.cumsum(density) / density.sum()
    assert energy_frequency(t, force) * T == pytest.approx(x[np.searchsorted(share, 0.99)], rel=0.01)
    # A force that goes on at the end of its record is faded out, and still has a frequency.
    assert 0 < energy_frequency(t[:1000], force[:1000])


@pytest.mark.parametrize("steps", [10_000, 10_001])
def test_the_frequency_does_not_depend_on_the_last_spacing_of_a_record(steps):
    """Long runs keep every second step and the last one: a half sine has the same frequency in both records."""
    n = np.append(np.arange(0, steps, 2), steps)
    t, T = 2e-3 * n / steps, 1e-3
    force = np.where(t < T, np.sin(np.pi * t / T), 0.0)
    even = np.linspace(0, 2e-3, 4001)
    expected = energy_frequency(even, np.where(even < T, np.sin(np.pi * even / T), 0.0))
    assert energy_frequency(t, force) == pytest.approx(expected, rel=1e-3)


def test_too_few_samples_still_give_a_frequency():
    t, force = np.linspace(0, 1e-3, 101), np.zeros(101)
    force[50] = 1.0
    assert energy_frequency(t, force) == pytest.approx(0.25 * 100e3)
