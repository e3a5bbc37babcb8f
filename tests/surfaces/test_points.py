"""Points and rows of a patch: they cover it once and carry a uniform pressure."""

from dataclasses import replace

import numpy as np
import pytest
from oracles import SIZE, box, hexahedra, quadratic, split, write_deck

import exudyn_partition as ep
from exudyn_partition.errors import MeshError
from exudyn_partition.fe.facets import nodal_area
from exudyn_partition.surfaces.points import ROWS, coarser_hats, contact_points
from exudyn_partition.surfaces.surface import Surface


@pytest.mark.parametrize("kind", ROWS)
def test_rows_cover_the_patch_once(round_body, kind):
    surface = round_body.surface(np.zeros(3))
    points = contact_points(surface, kind)
    np.testing.assert_allclose(points.mean.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(points.weights.sum(axis=1), 1.0, atol=1e-12)
    corners = surface.points[surface.facets[:, :3]]
    flat = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert points.area.sum() == pytest.approx(flat, rel=2e-3)
    assert (points.area >= 0).all()
    uniform = points.mean.T @ points.area if kind == "integrated" else points.area
    forces = np.zeros(len(surface.points))
    forces[points.row_nodes] = points.area
    corners = np.unique(surface.facets[:, :3])
    inner = np.setdiff1d(corners, surface.facets[np.isin(surface.facets, surface.rim).any(axis=1)])
    np.testing.assert_allclose((points.pressures @ forces)[inner], 1.0, rtol=0.05)
    assert uniform.sum() == pytest.approx(points.area.sum(), rel=1e-12)
    assert points.area.sum() == pytest.approx(contact_points(surface, ROWS[0]).area.sum(), rel=1e-12)


def test_integrated_rows_turn_uniform_pressure_into_consistent_nodal_forces(round_body):
    """On a quadratic facet the corners get nothing and the mid-side nodes a third of the area each."""
    points = contact_points(round_body.surface(np.zeros(3)), "integrated")
    on_points = points.mean.T @ points.area
    on_nodes = np.zeros(len(round_body.partition.patches[0].nodes))
    np.add.at(on_nodes, points.nodes, points.weights * on_points[:, None])
    facets = round_body.surface(np.zeros(3)).facets
    corners, middles = np.unique(facets[:, :3]), np.unique(facets[:, 3:])
    assert on_nodes.sum() == pytest.approx(points.area.sum(), rel=1e-12)
    assert abs(on_nodes[corners]).max() < 0.02 * on_nodes[middles].max()


def test_integrated_rows_of_cubic_facets_make_the_exact_forces_of_a_uniform_pressure():
    fem = ep.fe_model(box(0.01, 0.01, 0.005), ep.STEEL, order=3, maxh=6e-3)
    patch = ep.Partition.ball(fem, (0, 0, 0.005), 0.01).patches[0]
    surface = Surface.of(fem.points, patch, np.zeros(3))
    points = contact_points(surface, "integrated")
    on_nodes = np.zeros(len(patch.nodes))
    np.add.at(on_nodes, points.nodes, points.weights * (points.mean.T @ points.area)[:, None])
    np.testing.assert_allclose(on_nodes, nodal_area(surface.points, surface.facets), atol=1e-12 * on_nodes.max())
    nodal = contact_points(surface, "node-to-segment")
    np.testing.assert_allclose(nodal.area, on_nodes, atol=1e-12 * on_nodes.max())
    inner = np.setdiff1d(surface.facets[:, :3], surface.rim)
    np.testing.assert_allclose((nodal.pressures @ nodal.area)[inner], 1.0, rtol=0.15)


@pytest.mark.parametrize(("order", "spacing"), [(2, 2.0), (3, 1.5)])
def test_a_coarser_grid_holds_linear_functions_with_fewer_hats(order, spacing):
    """As many as the square of its spacing says, but for the rim."""
    fem = ep.fe_model(box(0.01, 0.01, 0.005), ep.STEEL, order=order, maxh=2.5e-3)
    surface = Surface.of(fem.points, ep.Partition.ball(fem, (0, 0, 0.005), 0.005).patches[0], np.zeros(3))
    hats, found = coarser_hats(surface)
    dense = hats[np.flatnonzero(hats.sum(axis=1) > 0)].toarray()
    assert found == spacing
    assert dense.min() >= 0
    np.testing.assert_allclose(dense.sum(axis=0), 1.0, atol=1e-12)
    plane = surface.points[:, :2]
    values = np.linalg.lstsq(dense.T, plane, rcond=None)[0]
    np.testing.assert_allclose(dense.T @ values, plane, atol=1e-12)
    assert dense.shape[1] / dense.shape[0] == pytest.approx(spacing**2, rel=0.25)


@pytest.mark.parametrize("kind", ROWS)
def test_facets_without_area(round_body, kind):
    surface = round_body.surface(np.zeros(3))
    points = surface.points.copy()
    points[surface.facets[3]] = points[surface.facets[3, 0]]
    with pytest.raises(MeshError, match="have no area, such as the one at"):
        contact_points(replace(surface, points=points), kind)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    "kinds", [["hexahedron"] * 18, ["wedge"] * 18, ["wedge"] * 6 + ["hexahedron"] * 12, ["foot", "hexahedron"] * 9]
)
def test_a_flat_face_with_rows_at_its_edges_keeps_a_uniform_pressure(tmp_path, kinds, order):
    """Quadrilaterals, triangles and both, also where all nodes of a triangle are at edges."""
    points, blocks = split(*hexahedra(3, 3, 2), kinds)
    if order == 2:
        points, blocks = quadratic(points, blocks)
    fem = ep.fe_model(write_deck(tmp_path / "block.inp", points, *blocks), ep.STEEL)
    patch = ep.Partition.surface(fem, plane=((0, 0, 0), (0, 0, -1))).patches[0]
    places = abs(fem.points[patch.nodes])
    np.testing.assert_array_equal(patch.ends, patch.nodes[np.isclose(places, SIZE / [2, 2, 1]).any(axis=1)])
    surface, found = Surface.of(fem.points, patch, np.zeros(3)), []
    for one in (surface, surface.without_edges):
        rows = contact_points(one, "integrated")
        found.append(np.zeros(len(patch.nodes)))
        np.add.at(found[-1], rows.nodes, rows.weights * (rows.mean.T @ rows.area)[:, None])
        np.testing.assert_allclose(rows.pressures @ rows.area, 1.0, rtol=1e-12)
    np.testing.assert_allclose(*found, atol=1e-12 * found[0].max())
