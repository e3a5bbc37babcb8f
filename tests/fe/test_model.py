"""FE models: mass, surface, rigid motion, and frequencies against analytic values."""

from dataclasses import replace

import netgen.occ as occ
import ngsolve
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.algebra.krylov import eigenmodes, mass_normalised
from exudyn_partition.errors import InputError, MeshError


def frequencies(fem, f_max, mass=None):
    mass = fem.mass if mass is None else mass
    rigid = mass_normalised(fem.rigid_modes, mass)
    return eigenmodes(fem.stiffness, mass, rigid, 2 * np.pi * f_max)


def test_rigid_modes_strain_nothing(block):
    stretch = block.points.ravel()  # u = x, a strain of one
    assert abs(block.stiffness @ block.rigid_modes).max() < 1e-10 * abs(block.stiffness @ stretch).max()


def test_mass_centre_and_inertia_of_a_block(block):
    m = 7800 * 0.01 * 0.02 * 0.03
    assert block.total_mass == pytest.approx(m, rel=1e-12)
    np.testing.assert_allclose(block.centre_of_mass, [0, 0, 0.015], atol=1e-12)
    inertia = block.rigid_modes.T @ (block.mass @ block.rigid_modes)
    expected = [m] * 3 + [m / 12 * s for s in (0.02**2 + 0.03**2, 0.01**2 + 0.03**2, 0.01**2 + 0.02**2)]
    np.testing.assert_allclose(inertia, np.diag(expected), atol=1e-10)
    np.testing.assert_allclose(block.inertia_tensor, np.diag(expected[3:]), rtol=1e-12, atol=1e-12 * expected[3])


def test_inertia_of_a_skew_body_of_two_materials_is_what_ngsolve_integrates():
    """A bar beside a ball, far from the origin, on the axes of neither."""
    bar = occ.Box((0, 0, 0), (0.06, 0.02, 0.01)).Rotate(occ.Axis((0, 0, 0), occ.gp_Vec(1, 2, 3)), 40)
    ball = occ.Sphere(occ.gp_Pnt(0, 0, 0), 0.015)
    shape = occ.Glue([ball.mat("ball"), (bar - ball).mat("bar")]).Move((0.3, -0.2, 0.1))
    materials = {"ball": ep.STEEL, "bar": ep.ALUMINIUM}
    mesh = ep.generate_mesh(shape, maxh=0.02)
    fem = ep.fe_model(mesh, materials)

    density = mesh.MaterialCF({name: material.rho for name, material in materials.items()})
    place = ngsolve.CF((ngsolve.x, ngsolve.y, ngsolve.z))

    def integral(f):
        return np.array(ngsolve.Integrate(density * f, mesh, order=8))

    mass = integral(ngsolve.CF(1.0))
    centre = integral(place) / mass
    second = integral(ngsolve.OuterProduct(place, place)).reshape(3, 3) - mass * np.outer(centre, centre)
    expected = np.trace(second) * np.eye(3) - second
    assert fem.total_mass == pytest.approx(mass, rel=1e-10)
    np.testing.assert_allclose(fem.centre_of_mass, centre, rtol=1e-10)
    np.testing.assert_allclose(fem.inertia_tensor, expected, atol=1e-9 * np.trace(expected))
    assert abs(expected[0, 1]) > 0.01 * np.trace(expected)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_lumped_mass_is_positive_and_complete(order):
    fem = ep.fe_model(box(0.01, 0.02, 0.03), ep.STEEL, order=order, maxh=8e-3)
    assert fem.order == order
    assert fem.lumped_mass.min() > 0
    assert fem.lumped_mass.sum() == pytest.approx(fem.total_mass, rel=1e-12)
    ratio = fem.lumped_mass / fem.mass.diagonal()[::3]  # HRZ: proportional in each element, and all are alike
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-9)


def test_cubic_elements_hold_cubic_motion():
    """Strain energy and mean square of u_x = x^2 y + z^3 in a box, against their integrals."""
    a, b, c = 0.01, 0.02, 0.03
    fem = ep.fe_model(box(a, b, c), ep.STEEL, order=3, maxh=0.015)
    x, y, z = fem.points.T
    u = np.zeros_like(fem.points)
    u[:, 0] = x**2 * y + z**3

    def mean(side, power):
        """Mean of a power of a coordinate over a side that is centred."""
        return (side / 2) ** power / (power + 1)

    volume, lame, shear = a * b * c, ep.STEEL.lame, ep.STEEL.shear_modulus
    energy = (lame + 2 * shear) * 4 * mean(a, 2) * mean(b, 2) + shear * (mean(a, 4) + 9 * c**4 / 5)
    assert u.ravel() @ (fem.stiffness @ u.ravel()) == pytest.approx(energy * volume, rel=1e-10)
    square = mean(a, 4) * mean(b, 2) + c**6 / 7
    assert u.ravel() @ (fem.mass @ u.ravel()) == pytest.approx(ep.STEEL.rho * square * volume, rel=1e-10)


def test_facets_close_the_surface_and_point_outward(block):
    a, b, c = (block.points[block.facets[:, i]] for i in range(3))
    area = np.cross(b - a, c - a) / 2
    np.testing.assert_allclose(area.sum(axis=0), 0, atol=1e-15)
    volume = np.einsum("ij,ij->", area, (a + b + c) / 3) / 3
    assert volume == pytest.approx(0.01 * 0.02 * 0.03, rel=1e-12)
    # Mid-side nodes lie between the corners that they belong to.
    middle = (block.points[block.facets[:, :3]] + block.points[block.facets[:, [1, 2, 0]]]) / 2
    np.testing.assert_allclose(block.points[block.facets[:, 3:]], middle, atol=1e-15)


def test_longitudinal_and_torsional_frequencies_of_a_round_bar():
    bar = ep.Material(E=210e9, nu=0.0, rho=7800.0)  # no lateral contraction: bar theory is exact
    fem = ep.fe_model(occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=0.01, h=0.4), bar, maxh=0.01)
    modes = frequencies(fem, 14e3)
    f = modes.omega / (2 * np.pi)
    shapes = modes.vectors.reshape(-1, 3, len(f))
    mass = fem.lumped_mass @ shapes[:, 2] ** 2
    axial = f[mass > 0.9]
    np.testing.assert_allclose(axial[:2], np.array([1, 2]) * bar.bar_wave_speed / 0.8, rtol=1e-4)
    turning = fem.points[:, :1] * shapes[:, 1] - fem.points[:, 1:2] * shapes[:, 0]
    torsion = f[np.sqrt(fem.lumped_mass @ turning**2) > 0.9 * 0.01 / np.sqrt(2)]
    np.testing.assert_allclose(torsion[:2], np.array([1, 2]) * bar.shear_wave_speed / 0.8, rtol=3e-3)


def test_bending_frequency_of_a_slender_bar():
    fem = ep.fe_model(box(0.008, 0.01, 0.4), ep.STEEL, maxh=0.01)
    lowest = frequencies(fem, 300.0).omega[0] / (2 * np.pi)
    radius_of_gyration = 0.008 / np.sqrt(12)
    euler = 22.373 / (2 * np.pi * 0.4**2) * ep.STEEL.bar_wave_speed * radius_of_gyration
    # Shear and rotary inertia lower it, by about 100 (r / L)^2 = 0.3 % (Timoshenko).
    assert 0.995 < lowest / euler < 0.999


def test_first_frequencies_of_a_square_plate():
    material = ep.Material(E=70e9, nu=0.3, rho=2700.0)
    fem = ep.fe_model(box(0.2, 0.2, 0.002), material, maxh=0.012)
    lowest = frequencies(fem, 450.0).omega
    D = material.E * 0.002**3 / 12 / (1 - 0.3**2)
    thin = np.array([13.489, 19.789, 24.432]) / 0.2**2 * np.sqrt(D / (2700 * 0.002))  # Leissa 1973, free, nu = 0.3
    np.testing.assert_allclose(lowest[:3], thin, rtol=0.012)


def test_lumped_and_consistent_frequencies_enclose_each_other(block):
    f_max = 80e3
    consistent = frequencies(block, f_max).omega[:4]
    lumped = frequencies(block, f_max, block.lumped_mass_matrix).omega[:4]
    np.testing.assert_allclose(lumped, consistent, rtol=0.05)


def test_a_held_or_misordered_stiffness_is_refused(block):
    held = block.stiffness.tolil()
    held[0, 0] *= 2
    with pytest.raises(MeshError, match="rigid motion gives forces"):
        ep.FEModel(block.points, block.cells, block.mass, held.tocsr(), block.cell_mass, block.material, {})


def test_not_finite_points(block):
    points = np.array(block.points)
    points[3, 1] = np.nan
    with pytest.raises(InputError, match=r"points: expected finite numbers, got nan at index \(3, 1\)"):
        ep.FEModel(points, block.cells, block.mass, block.stiffness, block.cell_mass, block.material, {})


@pytest.mark.parametrize(
    ("field", "change", "message"),
    [
        ("cell_mass", lambda x: x * np.nan, "cell_mass: expected finite numbers"),
        ("cell_mass", lambda x: x[:3], r"cell_mass: expected shape \("),
        ("cell_mass", lambda x: -x, "elements have no mass"),
        ("cells", lambda x: x + 0.5, "cells: expected integers"),
        ("cells", lambda x: x + 100, "cells: expected node numbers from 0 to"),
        ("stiffness", lambda x: -x, "diagonal entries are not positive"),
        ("mass", lambda x: 0 * x, "diagonal entries are not positive"),
    ],
)
def test_inconsistent_models_are_refused(block, field, change, message):
    with pytest.raises(InputError, match=message):
        replace(block, **{field: change(getattr(block, field))})
