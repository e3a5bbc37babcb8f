"""A body of cubic elements against a quadratic one: the way from a shape to forces, files and pictures."""

import exudyn as exu
import meshio
import netgen.occ as occ
import numpy as np
import pytest
from oracles import SPHERE_MATERIAL

import exudyn_partition as ep
from exudyn_partition.fe.facets import area_vectors
from exudyn_partition.fe.shapes import tetrahedron_functions
from exudyn_partition.present import view
from exudyn_partition.present.output import write_paraview
from exudyn_partition.reduction import recovery

RADIUS, SPEED = 5e-3, 0.3
MASS = SPHERE_MATERIAL.rho * 4 / 3 * np.pi * RADIUS**3
HERTZ = ep.hertz.impact(MASS / 2, SPEED, RADIUS, RADIUS, SPHERE_MATERIAL, SPHERE_MATERIAL)
A = HERTZ.contact_radius


def marble(order, h, up):
    """FE model and body of a ball that touches the origin from above or below."""
    shape = occ.Sphere(occ.Pnt(0, 0, RADIUS if up else -RADIUS), RADIUS)
    fine = ep.Refine((0, 0, 0), 2 * A, h * A)
    fem = ep.fe_model(shape, SPHERE_MATERIAL, order=order, maxh=4e-3, refine=[fine], grading=0.6)
    part = ep.Partition.ball(fem, (0, 0, 0), 2.9 * A, direction=(0, 0, -1 if up else 1))
    return fem, ep.reduce(fem, part, f_cut=150e3)


@pytest.fixture(scope="module")
def cubic():
    return marble(3, 0.8, True)


@pytest.fixture(scope="module")
def quadratic():
    return marble(2, 0.5, False)


def collide(upper, lower, **options):
    mbs = exu.SystemContainer().AddSystem()
    striker = ep.CreatePartitionBody(mbs, upper, name="upper", initialVelocity=[0, 0, -SPEED])
    target = ep.CreatePartitionBody(mbs, lower, name="lower")
    contact = ep.CreatePartitionContact(mbs, striker, target, **options)
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=40e-6), striker, target, contact


@pytest.mark.parametrize("options", [{}, {"passes": "given"}, {"passes": "given", "rows": "node-to-segment"}])
def test_cubic_and_quadratic_spheres_meet_as_hertz_says(cubic, quadratic, options):
    """With the rows of either."""
    result, striker, target, contact = collide(cubic[1], quadratic[1], **options)
    force = contact.force(result)
    assert force.max() == pytest.approx(HERTZ.peak_force, rel=0.03)
    momentum = striker.momentum(result)[:, 2] + target.momentum(result)[:, 2]
    np.testing.assert_allclose(momentum, momentum[0], rtol=1e-9)
    assert striker.momentum(result)[-1, 2] == pytest.approx(0.0, abs=0.01 * MASS * SPEED)


def test_files_and_pictures_of_cubic_bodies(cubic, quadratic, tmp_path):
    """VTK's cells of order 3 hold the body's volume, and the stress beneath the contact is Hertz's (Johnson 3.4)."""
    fem, body = cubic
    body.save(tmp_path / "body.npz")
    again = ep.load_body(tmp_path / "body.npz")
    result, striker, target, contact = collide(again, quadratic[1], passes="given")  # the cubic side has the rows
    pairs, peak = [(striker, fem), (target, quadratic[0])], float(result.t[contact.force(result).argmax()])
    write_paraview(tmp_path, result, pairs, fields=("displacement", "von_mises"), times=[peak], surface=False)
    mesh = meshio.read(tmp_path / "upper_0000.vtu")
    cells = mesh.cells_dict["VTK_LAGRANGE_TETRAHEDRON"]
    np.testing.assert_array_equal(cells, fem.cells)
    at = np.random.default_rng(0).dirichlet(np.ones(4), 400)[:, 1:]
    slopes = tetrahedron_functions(at, 20)[1]
    volume = np.linalg.det(np.einsum("eka,qkb->eqab", mesh.points[cells], slopes)).mean(axis=1).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=5e-3)  # points at random
    # Nodes of VTK's cells: thirds of the edges 01, 12, 20, 03, 13, 23, then faces 013, 123, 023, 012.
    corners = mesh.points[cells[:, :4]]
    ends = np.array([(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)])
    on_edges = np.stack([(2 * corners[:, a] + corners[:, b]) / 3 for a, b in (ends.T, ends.T[::-1])], axis=2)
    on_faces = corners[:, [(0, 1, 3), (1, 2, 3), (0, 2, 3), (0, 1, 2)]].mean(axis=2)
    straight = np.concatenate([corners, on_edges.reshape(len(cells), -1, 3), on_faces], axis=1)
    size = np.ptp(corners, axis=1).max(axis=1)
    assert (np.linalg.norm(mesh.points[cells] - straight, axis=2) < 0.15 * size[:, None]).all()
    p0 = 1.5 * HERTZ.peak_force / (np.pi * A**2)
    data = mesh.point_data
    assert data["von_mises"].max() / p0 == pytest.approx(0.62, rel=0.1)
    assert 0.3 < fem.points[data["von_mises"].argmax(), 2] / A < 0.7
    write_paraview(tmp_path, result, fields=("displacement", "contact_pressure"), times=[peak])
    surface = meshio.read(tmp_path / "upper_0000.vtu")
    assert [block.type for block in surface.cells] == ["VTK_LAGRANGE_TRIANGLE"]
    facets = surface.cells[0].data
    pressure = surface.point_data["contact_pressure"]
    area = np.linalg.norm(area_vectors(surface.points, facets), axis=1)
    on_corners = pressure[facets[:, :3]]
    # It is linear between corners, which cuts off the top.
    assert 0.75 < area @ on_corners.mean(axis=1) / contact.force(result).max() < 1.02
    np.testing.assert_allclose(pressure[facets[:, 9]], on_corners.mean(axis=1), atol=1e-9 * p0)
    np.testing.assert_allclose(pressure[facets[:, 3]], on_corners @ [2 / 3, 1 / 3, 0], atol=1e-9 * p0)
    shown = view.picture(result, peak, size=(120, 90))
    assert shown.shape == (90, 120, 3)
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) > 20
    gauge = ep.StrainGauge((0, 0, RADIUS), (0, 0, 1), 1e-3)
    assert np.isfinite(recovery.gauge_rows(fem, [gauge]) @ body.displacement(striker.coordinates(result)[-1]).ravel())
