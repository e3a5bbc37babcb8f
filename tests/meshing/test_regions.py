"""Meshes of several regions, and elements that overlap: named, never taken."""

import meshio
import netgen.occ as occ
import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import MeshError

CUBE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1.0]])
POINTS = 0.01 * np.vstack([CUBE, np.add(CUBE[4:], [0, 0, 1])])  # two cubes, one on the other
CELLS = np.array([np.arange(8), np.arange(4, 12)])


def glued(*names):
    """Boxes side by side, each with its name or none."""
    boxes = [occ.Box((0.01 * i, 0, 0), (0.01 * (i + 1), 0.01, 0.01)) for i in range(len(names))]
    for box, name in zip(boxes, names, strict=True):
        if name:
            box.mat(name)
    return occ.Glue(boxes)


def refused(source, *patterns, **options):
    for pattern in patterns:
        with pytest.raises(MeshError, match=pattern):
            ep.fe_model(source, ep.STEEL, **options)


@pytest.mark.parametrize("names", [("steel", "copper"), ("steel", None), (None, None)])
def test_shapes_and_meshes_of_several_solids(names):
    shape = glued(*names)
    listed = ", ".join(f"{i}: {repr(name) if name else 'without name'}" for i, name in enumerate(names))
    refused(shape, f"expected a body of one material, got 2 regions by solids: {listed}", maxh=0.01)
    refused(ep.generate_mesh(shape, maxh=0.01), f"mesh: expected a body of one material, got 2 regions .*{listed}")


def test_solids_of_one_name_are_one_region():
    fem = ep.fe_model(glued("steel", "steel"), ep.STEEL, maxh=0.01)
    assert fem.total_mass == pytest.approx(7800 * 2e-6, rel=1e-9)


def test_a_shape_without_a_solid():
    refused(occ.Rectangle(1, 1).Face(), "shape: expected a solid, got none", maxh=0.5)


@pytest.mark.parametrize(
    ("name", "file_format", "data", "field_data", "listed"),
    [
        ("m.vtu", None, "material", {}, "by material: '1', '2'"),
        ("m.msh", "gmsh22", "gmsh:physical", {"steel": [1, 3], "foam": [2, 3]}, "groups: 'steel', 'foam'"),
        ("m.msh", "gmsh22", "gmsh:geometrical", {}, "by Gmsh's volumes: '1', '2'"),
        ("m.bdf", None, "nastran:ref", {}, "by Nastran's properties: '1', '2'"),
        ("m.mesh", None, "medit:ref", {}, "by medit:ref: '1', '2'"),
    ],
)
def test_files_of_several_regions(tmp_path, name, file_format, data, field_data, listed):
    field_data = {key: np.array(value) for key, value in field_data.items()}
    for tags in ([1, 2], [2, 2]):
        cell_data = {data: [np.array(tags)]}
        if data.startswith("gmsh"):
            other = {"gmsh:physical", "gmsh:geometrical"} - {data}
            cell_data[other.pop()] = [np.array([0, 0])]
        mesh = meshio.Mesh(POINTS, [("hexahedron", CELLS)], cell_data=cell_data, field_data=field_data)
        meshio.write(tmp_path / name, mesh, file_format=file_format)
        if tags == [1, 2]:
            refused(tmp_path / name, f"m.*: expected a body of one material, got 2 regions .*{listed}")
        else:
            assert ep.fe_model(tmp_path / name, ep.STEEL).total_mass == pytest.approx(7800 * 2e-6)


def test_results_of_an_analysis_are_no_regions(tmp_path):
    mesh = meshio.Mesh(POINTS, [("hexahedron", CELLS)], cell_data={"stress in material axes": [np.array([1.5, 2.5])]})
    mesh.write(tmp_path / "m.vtu")
    assert ep.fe_model(tmp_path / "m.vtu", ep.STEEL, order=1).n_nodes == 12


def test_elements_that_are_there_twice(tmp_path):
    path = tmp_path / "twice.vtu"
    turned = CELLS[1, [1, 2, 3, 0, 5, 6, 7, 4]]
    meshio.Mesh(POINTS, [("hexahedron", np.vstack([CELLS, turned]))]).write(path)
    refused(path, "1 of 3 elements are there twice, the first are elements 1 and 2")


def test_faces_of_three_elements_and_elements_that_overlap(tmp_path):
    path = tmp_path / "mesh.vtu"
    points = 0.01 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1], [0.3, 0.3, 2.0]])
    meshio.Mesh(points, [("tetra", [[0, 1, 2, 3], [0, 2, 1, 4], [0, 1, 2, 5]])]).write(path)
    refused(
        path, r"1 faces belong to more than two elements, the first to elements 0, 1, 2 \(counted from 0\)", order=1
    )
    meshio.Mesh(points[[0, 1, 2, 3, 5]], [("tetra", [[0, 1, 2, 3], [0, 1, 2, 4]])]).write(path)
    refused(path, "1 pairs of elements overlap, for both lie on the same side .* elements 0 and 1", order=1)
