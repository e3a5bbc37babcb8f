"""Files of Gmsh with all entities saved, in text and in binary; counts that files say."""

import struct

import meshio
import numpy as np
import pytest
from oracles import SIZE, hexahedra

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MeshError

POINTS, CELLS = hexahedra(2, 3, 4)
FOOT = CELLS[POINTS[CELLS[:, 0], 2] == 0][:, [0, 3, 2, 1]]
SIDE = CELLS[POINTS[CELLS[:, 0], 0] == POINTS[:, 0].min()][:, [0, 4, 7, 3]]
GROUPS = {"foot": (2, 2), "steel": (3, 1)}  # dimension and number of physical groups


def row(binary, *parts):
    """Numbers of one line, each part a kind and its numbers."""
    if binary:
        return b"".join(struct.pack(f"<{len(values)}{kind}", *values) for kind, values in parts)
    return (" ".join(str(value) for _, values in parts for value in values) + "\n").encode()


def save_all(path, *, binary, of_volume=(1,)):
    """Write the bar, and a point and a side that are in no group, in format 4.1 as Gmsh does with Mesh.SaveAll."""

    def rows(kind, values):
        return b"".join(row(binary, (kind, one)) for one in values)

    def entity(tag, dimension, groups):
        bounds = [("Q", [0])] if dimension else []
        box = [0.0] * (6 if dimension else 3)
        return row(binary, ("i", [tag]), ("d", box), ("Q", [len(groups)]), ("i", groups), *bounds)

    def block(head, *content):
        return row(binary, ("i", head), ("Q", [len(content[0][1])])) + b"".join(rows(*one) for one in content)

    points, first, elements = POINTS.tolist(), 2, [block([0, 9, 15], ("Q", [[1, 1]]))]
    for dimension, tag, kind, cells in ((2, 1, 3, FOOT), (2, 2, 3, SIDE), (3, 1, 5, CELLS)):
        numbered = [[first + i, *cell] for i, cell in enumerate((cells + 2).tolist())]
        elements.append(block([dimension, tag, kind], ("Q", numbered)))
        first += len(cells)
    nodes = [block([0, 9, 0], ("Q", [[1]]), ("d", [[9.0, 9.0, 9.0]]))]
    nodes.append(block([3, 1, 0], ("Q", [[i + 2] for i in range(len(points))]), ("d", points)))
    names = "".join(f'{dimension} {tag} "{name}"\n' for name, (dimension, tag) in GROUPS.items())
    sections = {
        "MeshFormat": b"4.1 1 8\n" + struct.pack("<i", 1) + b"\n" if binary else b"4.1 0 8\n",
        "PhysicalNames": f"{len(GROUPS)}\n{names}".encode(),
        "Entities": rows("Q", [[1, 0, 2, 1]]) + entity(9, 0, []) + entity(1, 2, [2]) + entity(2, 2, [])
        + entity(1, 3, of_volume),
        "Nodes": rows("Q", [[2, len(points) + 1, 1, len(points) + 1]]) + b"".join(nodes),
        "Elements": rows("Q", [[4, first - 1, 1, first - 1]]) + b"".join(elements),
    }  # fmt: skip
    path.write_bytes(
        b"".join(
            b"$%s\n%s%s$End%s\n" % (name.encode(), content, b"" if content.endswith(b"\n") else b"\n", name.encode())
            for name, content in sections.items()
        )
    )
    return path


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("of_volume", [(1,), ()])
def test_entities_of_no_group_are_read(tmp_path, binary, of_volume):
    fem = ep.fe_model(save_all(tmp_path / "all.msh", binary=binary, of_volume=of_volume), ep.STEEL)
    np.testing.assert_array_equal(fem.points, POINTS)
    np.testing.assert_array_equal(fem.cells, CELLS)
    assert fem.total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-12)
    assert set(fem.boundaries) == {"foot"}
    on_foot = np.flatnonzero((fem.points[fem.facets, 2] == 0).all(axis=1))
    np.testing.assert_array_equal(fem.boundaries["foot"], on_foot)


def first_format(path):
    """The bar in Gmsh's format 1, its foot in the second physical group."""
    nodes = "".join(f"{i} {x!r} {y!r} {z!r}\n" for i, (x, y, z) in enumerate(POINTS.tolist(), 2))
    rows = [(3, 2, cell) for cell in (FOOT + 2).tolist()] + [(5, 1, cell) for cell in (CELLS + 2).tolist()]
    elements = "".join(
        f"{i} {kind} {group} {group} {len(cell)} {' '.join(map(str, cell))}\n"
        for i, (kind, group, cell) in enumerate(rows, 1)
    )
    path.write_text(f"$NOD\n{len(POINTS)}\n{nodes}$ENDNOD\n$ELM\n{len(rows)}\n{elements}$ENDELM\n")
    return path


def test_the_first_format(tmp_path):
    path = first_format(tmp_path / "m.msh")
    fem = ep.fe_model(path, ep.STEEL)
    np.testing.assert_array_equal(fem.points, POINTS)
    np.testing.assert_array_equal(fem.cells, CELLS)
    path.write_text(path.read_text().replace(f"$NOD\n{len(POINTS)}", f"$NOD\n{len(POINTS) + 1}"))
    with pytest.raises(InputError, match="could not be read by meshio"):
        ep.fe_model(path, ep.STEEL)


FORMATS = [("m.msh", "gmsh22"), ("m.msh", "gmsh"), ("m.vtu", None), ("m.vtk", None)]


@pytest.mark.parametrize(
    ("name", "file_format", "options"),
    [*((*one, {"binary": binary}) for one in FORMATS for binary in (False, True)), ("m.mesh", None, {})],
)
def test_what_a_reader_loses_is_found(tmp_path, monkeypatch, name, file_format, options):
    """A reader drops the last element, or a node, of a file in each format that says how many it has."""
    meshio.write(tmp_path / name, meshio.Mesh(POINTS, [("hexahedron", CELLS)]), file_format, **options)
    assert ep.fe_model(tmp_path / name, ep.STEEL).n_nodes == len(POINTS)
    read = meshio.read
    assert ep.fe_model(tmp_path / name, ep.STEEL).n_nodes == len(POINTS)

    def without_an_element(path):
        mesh = read(path)
        mesh.cells[0].data = mesh.cells[0].data[:-1]
        return mesh

    monkeypatch.setattr(meshio, "read", without_an_element)
    with pytest.raises(MeshError, match=r"it says that it has 24 (volume )?elements, of which meshio reads 23"):
        ep.fe_model(tmp_path / name, ep.STEEL)

    def without_a_node(path):
        mesh = read(path)
        mesh.points = mesh.points[:-1]
        return mesh

    monkeypatch.setattr(meshio, "read", without_a_node)
    with pytest.raises(MeshError, match="it says that it has 60 nodes, of which meshio reads 59"):
        ep.fe_model(tmp_path / name, ep.STEEL)
