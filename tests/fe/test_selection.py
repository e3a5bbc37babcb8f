"""Faces by their geometry: bores, pins and flat sides have the areas that they should, whoever made the mesh."""

import meshio
import netgen.occ as occ
import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import EmptyRegionError, InputError, SelectionWarning
from exudyn_partition.fe.facets import area_vectors

L, W, H, R = 0.06, 0.02, 0.01, 0.004


@pytest.fixture(scope="module")
def lug():
    """A plate of 60 x 20 x 10 mm with two bores of radius 4 mm through its height."""
    plate = occ.Box((0, 0, 0), (L, W, H))
    for x in (0.015, 0.045):
        plate -= occ.Cylinder(occ.Pnt(x, W / 2, -H), occ.Z, r=R, h=3 * H)
    return ep.fe_model(plate, ep.STEEL, maxh=6e-3)


def area(fem, partition):
    """Area of the only load of a partition [m2]."""
    (pattern,) = partition.loads
    return np.linalg.norm(pattern.forces, axis=1).sum()


@pytest.mark.parametrize("x", [0.015, 0.045])
def test_a_bore_by_its_cylinder(lug, x):
    """The nodes are those that CAD put on the bore, and the joint sits on its axis."""
    pin = ep.Partition.interface(lug, "pin", cylinder=((x, W / 2, 0.3), (0, 0, -2.0), R)).interfaces[0]
    away = np.hypot(lug.points[:, 0] - x, lug.points[:, 1] - W / 2)
    on = np.flatnonzero(abs(away - R) < 0.02 * R)
    np.testing.assert_array_equal(pin.nodes, on)
    np.testing.assert_allclose(pin.position, (x, W / 2, H / 2), atol=1e-8)


def test_both_bores_about_one_axis_are_told_and_one_can_be_taken():
    """Two lugs of a fork have bores on one axis."""
    fork = occ.Box((0, 0, 0), (0.03, W, 0.03)) - occ.Box((0.01, -1, 0.01), (1, 1, 0.02))
    fork -= occ.Cylinder(occ.Pnt(0.02, W / 2, -1), occ.Z, r=R, h=2.0)
    fem = ep.fe_model(fork, ep.STEEL, maxh=6e-3)
    bore = {"cylinder": ((0.02, W / 2, 0), (0, 0, 1), R)}
    with pytest.warns(SelectionWarning, match=r"cylinder: caught 2 separate faces: .*near="):
        both = ep.Partition.interface(fem, "pin", **bore).interfaces[0]
    lower = ep.Partition.interface(fem, "pin", **bore, near=(0.02, W / 2, 0)).interfaces[0]
    upper = ep.Partition.interface(fem, "pin", **bore, near=(0.02, W / 2, 0.03)).interfaces[0]
    np.testing.assert_array_equal(np.union1d(lower.nodes, upper.nodes), both.nodes)
    assert fem.points[lower.nodes, 2].max() <= 0.01 + 1e-9
    assert fem.points[upper.nodes, 2].min() >= 0.02 - 1e-9


def test_flat_faces_by_plane_and_point(lug):
    top = W * L - 2 * np.pi * R**2
    found = ep.Partition.load(lug, "top", plane=((0, 0, H), (0, 0, 3.0)), direction=(0, 0, 1))
    assert area(lug, found) == pytest.approx(top, rel=2e-3)  # chords instead of arcs
    near = ep.Partition.load(lug, "top", near=(0.001, 0.001, H), direction=(0, 0, 1))
    np.testing.assert_array_equal(found.loads[0].nodes, near.loads[0].nodes)
    side = ep.Partition.surface(lug, plane=((0, 0, 0), (0, -1, 0))).patches[0]
    assert np.linalg.norm(area_vectors(lug.points, side.facets), axis=1).sum() == pytest.approx(L * H, rel=1e-12)
    bore = ep.Partition.surface(lug, near=(0.015 + R, W / 2, H / 2)).patches[0]
    assert np.linalg.norm(area_vectors(lug.points, bore.facets), axis=1).sum() == pytest.approx(
        2 * np.pi * R * H, rel=0.05
    )


def test_a_mesh_from_a_file_has_no_names_but_faces(lug, tmp_path):
    meshio.write_points_cells(tmp_path / "lug.vtu", lug.points, [("tetra10", lug.cells)])
    fem = ep.fe_model(tmp_path / "lug.vtu", ep.STEEL)
    pin = ep.Partition.interface(fem, "pin", cylinder=((0.015, W / 2, 0), (0, 0, 1), R)).interfaces[0]
    np.testing.assert_allclose(pin.position, (0.015, W / 2, H / 2), atol=1e-8)


def test_a_coarse_bore_is_one_face(tmp_path):
    """Six chords around a bore meet at 60 degrees."""
    angle = np.linspace(0, 2 * np.pi, 7)[:-1]
    inner, outer = ([(r * np.cos(a), r * np.sin(a)) for a in angle] for r in (1.0, 2.0))
    points = np.array([(*p, z) for z in (0.0, 1.0) for ring in (inner, outer) for p in ring])
    cells = []
    for i in range(6):
        j = (i + 1) % 6
        cells.append([i, i + 6, j + 6, j, i + 12, i + 18, j + 18, j + 12])
    meshio.write_points_cells(tmp_path / "ring.vtu", 0.01 * points, [("hexahedron", np.array(cells))])
    fem = ep.fe_model(tmp_path / "ring.vtu", ep.STEEL)
    found = ep.Partition.interface(fem, "bore", cylinder=((0, 0, 0), (0, 0, 1), 0.01)).interfaces[0]
    assert len(found.nodes) == 12


@pytest.mark.parametrize(
    ("kwargs", "error", "said"),
    [
        (
            {"cylinder": ((0.015, W / 2, 0), (0, 0, 1), 0.005)},
            EmptyRegionError,
            r"radii of faces about this axis \[m\]: 0\.004",
        ),
        ({"plane": ((0, 0, 0), (0, 0, 1))}, EmptyRegionError, r"are away from it, along the normal, by \[m\]: 0\.01"),
        (
            {"cylinder": ((0, 0, 0), (0, 0, 0), R)},
            InputError,
            "direction of the axis: expected a vector that has a length",
        ),
        ({"cylinder": (0, 0, 1)}, InputError, "cylinder, point of the axis"),
        ({"plane": (0, 0, 1)}, InputError, r"plane: expected \(point, outward normal\)"),
        ({}, InputError, "expected faces, or one or more of the others, got none"),
        ({"nodes": [1, 2, 3], "near": (0, 0, 0)}, InputError, "nodes: expected nodes, or a cylinder"),
        ({"near": (0, 0)}, InputError, "near"),
    ],
)
def test_what_catches_nothing_says_what_is_there(lug, kwargs, error, said):
    with pytest.raises(error, match=said):
        ep.Partition.interface(lug, "pin", **kwargs)
