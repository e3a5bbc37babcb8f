"""FE models of shapes: curved elements, names of boundaries, units, and shapes that cannot be meshed."""

import logging

import netgen.occ as occ
import ngsolve
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.algebra.krylov import eigenmodes, mass_normalised
from exudyn_partition.errors import InputError, LockingError, MeshError, UnitsWarning


def test_quadratic_elements_follow_a_sphere():
    shape = occ.Sphere(occ.Pnt(0, 0, 0), 0.01)
    exact = 4 / 3 * np.pi * 0.01**3 * 7800
    mesh = ep.generate_mesh(shape, maxh=4e-3)
    curved, straight = (ep.fe_model(mesh, ep.STEEL, order=order) for order in (2, 1))
    assert abs(curved.total_mass / exact - 1) < 3e-3
    assert straight.total_mass / exact < 0.97
    on_surface = np.linalg.norm(curved.points[np.unique(curved.facets)], axis=1)
    np.testing.assert_allclose(on_surface, 0.01, rtol=5e-3)
    assert mesh.GetCurveOrder() == 2  # the caller's mesh is left as it was


def test_cubic_elements_follow_a_sphere_more_closely():
    """Mass and inertia about the centre of spheres of few elements, by order."""
    shape = occ.Sphere(occ.Pnt(0, 0, 0), 0.01)
    mass = 4 / 3 * np.pi * 0.01**3 * 7800
    missed = []
    for order in (2, 3):
        fem = ep.fe_model(shape, ep.STEEL, order=order, maxh=8e-3)
        inertia = np.diag(fem.rigid_modes.T @ (fem.mass @ fem.rigid_modes))
        missed.append(abs(inertia / ([mass] * 3 + [0.4 * mass * 0.01**2] * 3) - 1).max())
        assert fem.order == order
    assert missed[1] < 5e-4 < 2e-3 < missed[0]
    assert fem.total_mass == pytest.approx(mass, rel=3e-4)
    mesh = ep.generate_mesh(shape, maxh=8e-3)  # curved with order 2, which cubic elements hold
    quadratic, cubic = (ep.fe_model(mesh, ep.STEEL, order=order) for order in (2, 3))
    assert cubic.total_mass == pytest.approx(quadratic.total_mass, rel=1e-12)
    np.testing.assert_allclose(cubic.centre_of_mass, quadratic.centre_of_mass, atol=1e-12)


def test_boundaries_keep_their_names():
    shape = box(0.01, 0.02, 0.03)
    shape.faces.Max(occ.Z).name = "top"
    fem = ep.fe_model(shape, ep.STEEL, maxh=8e-3)
    assert fem.points[fem.facets[fem.boundaries["top"]], 2] == pytest.approx(0.03)
    assert sum(map(len, fem.boundaries.values())) == len(fem.facets)


def test_millimetres_with_an_si_material_warn():
    with pytest.warns(UnitsWarning, match="scale it by 1e-3"):
        ep.fe_model(box(10, 20, 30), ep.STEEL, maxh=10)


@pytest.mark.parametrize(("E", "rho"), [(210e3, 7.8e-9), (1.0, 1.0)])
def test_other_systems_of_units_do_not_warn(E, rho):
    fem = ep.fe_model(box(10, 20, 30), ep.Material(E=E, nu=0.3, rho=rho), maxh=10)
    assert fem.total_mass == pytest.approx(6000 * rho)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"order": 4, "maxh": 1e-3}, "order: expected 1, 2 or 3"),
        ({}, "maxh"),
        ({"maxh": -1.0}, "maxh: expected a finite number above zero"),
    ],
)
def test_bad_options(arguments, message):
    with pytest.raises(InputError, match=message):
        ep.fe_model(box(0.01, 0.01, 0.01), ep.STEEL, **arguments)


def test_not_a_shape():
    with pytest.raises(InputError, match="expected an OCC shape"):
        ep.fe_model([1, 2, 3], ep.STEEL, maxh=1e-3)


def test_surface_mesh_is_refused():
    mesh = ngsolve.Mesh(occ.OCCGeometry(occ.Rectangle(1, 1).Face(), dim=2).GenerateMesh(maxh=0.5))
    with pytest.raises(MeshError, match="three-dimensional"):
        ep.fe_model(mesh, ep.STEEL)


def test_nearly_incompressible_material_in_linear_and_quadratic_elements():
    """Linear elements lock; quadratic ones hardly change their lowest mode from nu = 0.499 to 0.4999."""
    lowest = []
    for nu in (0.499, 0.4999):
        rubber = ep.Material(E=210e9, nu=nu, rho=7800.0)
        with pytest.raises(LockingError, match=r"expected at most 0.49 .* Take quadratic tetrahedra"):
            ep.fe_model(box(0.01, 0.02, 0.03), rubber, maxh=5e-3, order=1)
        fem = ep.fe_model(box(0.01, 0.02, 0.03), rubber, maxh=5e-3)
        rigid = mass_normalised(fem.rigid_modes, fem.mass)
        lowest.append(eigenmodes(fem.stiffness, fem.mass, rigid, 2 * np.pi * 50e3).omega[0])
    assert lowest[1] == pytest.approx(lowest[0], rel=5e-3)


def tube(wall):
    """A tube of 10 mm radius."""
    cylinders = (occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=r, h=0.03) for r in (0.010, 0.010 - wall))
    return next(cylinders) - next(cylinders)


def test_elements_that_curving_turns_inside_out():
    """Two of them across a thin wall: their mass would be 3 % too large, silently."""
    mesh = ep.generate_mesh(tube(0.5e-3), maxh=0.02, grading=0.9)
    with pytest.raises(MeshError, match=r"\d+ of \d+ elements are inverted .* a smaller maxh, or refine there"):
        ep.fe_model(mesh, ep.STEEL)
    assert ep.fe_model(mesh, ep.STEEL, order=1).total_mass > 0
    fine = ep.fe_model(tube(1.5e-3), ep.STEEL, maxh=4e-3)
    exact = np.pi * (0.010**2 - 0.0085**2) * 0.03 * ep.STEEL.rho
    np.testing.assert_allclose(fine.total_mass, exact, rtol=1e-3)


@pytest.mark.parametrize("wall", [0.5e-3, 1e-3])
def test_a_shape_is_meshed_again_where_curving_turns_elements_inside_out(wall):
    fem = ep.fe_model(tube(wall), ep.STEEL, maxh=5e-3, grading=0.9)
    exact = np.pi * (0.010**2 - (0.010 - wall) ** 2) * 0.03 * ep.STEEL.rho
    np.testing.assert_allclose(fem.total_mass, exact, rtol=2e-3)


def test_balls_that_come_one_after_the_other_are_in_each_trial():
    """An iterator was used up by the first mesh, so that the next one had no finer elements."""
    ball = ep.Refine((0.010, 0, 0.03), 1e-3, 0.2e-3)
    counts = {ep.fe_model(tube(0.5e-3), ep.STEEL, maxh=5e-3, refine=given, grading=0.9).n_nodes
              for given in ([ball], iter([ball]))}  # fmt: skip
    assert len(counts) == 1


def test_a_shape_is_not_meshed_again_for_what_other_meshes_do_not_mend(caplog):
    """Linear elements of rubber lock in any mesh: four more of them would only take time."""
    rubber = ep.Material(E=1e7, nu=0.4999, rho=1100.0)
    with caplog.at_level(logging.INFO, "exudyn_partition"), pytest.raises(LockingError):
        ep.fe_model(tube(1e-3), rubber, maxh=5e-3, order=1)
    assert sum(message.startswith("mesh: ") for message in caplog.messages) == 1
    assert not any("meshed again" in message for message in caplog.messages)


def test_a_corner_of_an_element_that_curving_turns_inside_out():
    """A rod with a ball's end: one element has 0.7 % less volume than NGSolve integrates."""
    rod = occ.Cylinder(occ.Pnt(0, 0, -0.058), occ.Z, r=0.010, h=0.048) + occ.Sphere(occ.Pnt(0, 0, -0.010), 0.010)
    refined = [ep.Refine((0, 0, 0), 0.5e-3, 0.16e-3)]
    fem = ep.fe_model(rod, ep.STEEL, maxh=5e-3, refine=refined, grading=0.5)
    np.testing.assert_allclose(fem.total_mass, rod.mass * ep.STEEL.rho, rtol=2e-3)


def test_a_shape_that_netgen_cannot_mesh():
    shell = occ.Sphere(occ.Pnt(0, 0, 0), 0.01) - occ.Sphere(occ.Pnt(0, 0, 0), 0.0097)
    with pytest.raises(MeshError, match=r"Netgen could not mesh it with maxh=0.02 m .* Take a smaller maxh"):
        ep.generate_mesh(shell, maxh=0.02, grading=0.9)


def test_a_mesh_that_is_curved_beyond_the_elements_order():
    mesh = ep.generate_mesh(occ.Sphere(occ.Pnt(0, 0, 0), 0.01), maxh=0.01)
    mesh.Curve(3)
    with pytest.raises(MeshError, match=r"curved with order 3, expected at most 2.*mesh.Curve\(2\)"):
        ep.fe_model(mesh, ep.STEEL)
