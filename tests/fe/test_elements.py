"""Kinds of volume elements: their functions, integrals and faces, and how they fit together."""

import numpy as np
import pytest

from exudyn_partition.fe.elements import BY_NAME, HEXAHEDRA, faces_of, hexahedron_faces, kinds_of, rows_of_cells
from exudyn_partition.fe.facets import by_shape, folded
from exudyn_partition.fe.mesh_quality import volume_inside
from exudyn_partition.fe.shapes import shape_functions

KINDS = list(BY_NAME.values())


def named(kind):
    return kind.name


def inside(kind, n=20):
    """Points in an element."""
    shares = np.random.default_rng(0).dirichlet(np.ones(kind.corners), n)
    return shares @ kind.nodes[: kind.corners]


def bent(kind):
    """An element with every node moved, as one row of cells."""
    shift = 0.06 * np.random.default_rng(1).standard_normal(kind.nodes.shape)
    return kind.nodes @ np.array([[1.0, 0.1, 0], [0, 1.2, 0.2], [0.1, 0, 0.9]]) + shift, kind.of_row[None]


@pytest.mark.parametrize("kind", KINDS, ids=named)
def test_functions_are_one_at_their_node_and_sum_to_one(kind):
    values, _ = kind.functions(kind.nodes)
    np.testing.assert_allclose(values, np.eye(len(kind.nodes)), atol=1e-14)
    values, slopes = kind.functions(inside(kind))
    np.testing.assert_allclose(values.sum(axis=1), 1, atol=1e-13)
    np.testing.assert_allclose(values @ kind.nodes, inside(kind), atol=1e-13)
    step = 1e-6
    for axis, by in enumerate(step * np.eye(3)):
        ahead, behind = (kind.functions(inside(kind) + sign * by)[0] for sign in (1, -1))
        np.testing.assert_allclose(slopes[:, :, axis], (ahead - behind) / (2 * step), atol=1e-7)


@pytest.mark.parametrize("kind", KINDS, ids=named)
def test_functions_on_a_face_are_those_of_its_facet(kind):
    """So elements of all kinds fit together, and contact rows to both sides of a face."""
    faces, number = faces_of(kind.of_row[None], hexahedra=True)
    faces = faces[number.ravel() >= 0]
    assert len(faces) == {8: 6, 6: 5, 5: 5, 4: 4}[kind.corners]
    for rows, columns in by_shape(faces):
        for nodes in faces[rows][:, columns]:
            local = np.random.default_rng(0).dirichlet(np.ones(3), 9)[:, :2]
            on_facet = shape_functions(local, len(nodes))[:, 0]
            values, _ = kind.functions(on_facet @ kind.nodes[nodes])
            expected = np.zeros_like(values)
            expected[:, nodes] = on_facet
            np.testing.assert_allclose(values, expected, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS, ids=named)
def test_volumes_are_exact_whatever_the_sides_are(kind):
    points, cell = bent(kind)
    jacobian = np.einsum("qkd,kx->qdx", kind.gradients, points)
    faces, number = faces_of(cell, hexahedra=True)
    volume, _ = volume_inside(points, faces[number.ravel() >= 0])
    assert np.linalg.det(jacobian) @ kind.rule[1] == pytest.approx(volume, rel=2e-14)


@pytest.mark.parametrize("kind", KINDS, ids=named)
def test_lumped_masses_are_positive_and_those_of_the_diagonal(kind):
    shares = kind.mass_shares
    assert shares.sum() == pytest.approx(1, rel=1e-14)
    assert (shares[kind.columns] > 0).all()
    assert not np.delete(shares, kind.columns).any()


def test_rows_of_cells_tell_their_kinds():
    for n, kinds in HEXAHEDRA.items():
        blocks = [(kind.name, np.arange(len(kind.nodes))[None] + 100 * i) for i, kind in enumerate(kinds.values())]
        cells, hexahedra = rows_of_cells(blocks)
        assert hexahedra
        assert cells.shape == (4, n)
        for (kind, rows), (name, nodes) in zip(kinds_of(cells, True), blocks, strict=True):
            assert kind.name == name
            np.testing.assert_array_equal(cells[rows][:, kind.columns], nodes)
    tetrahedra = np.array([[0, 1, 2, 3]])
    assert not rows_of_cells([("tetra", tetrahedra)])[1]


def test_a_face_between_two_kinds_has_one_number():
    """A wedge on a hexahedron by a quadrilateral, and a pyramid on the wedge's triangle's neighbour by another."""
    blocks = [
        ("hexahedron", np.array([[0, 1, 2, 3, 4, 5, 6, 7]])),
        ("wedge", np.array([[1, 8, 2, 5, 9, 6]])),
        ("pyramid", np.array([[4, 5, 6, 7, 10]])),
        ("tetra", np.array([[5, 9, 6, 10]])),
    ]
    faces, number = faces_of(*rows_of_cells(blocks))
    count = np.bincount(number[number >= 0])
    assert np.count_nonzero(count == 2) == 4  # hexahedron to wedge and pyramid; tetrahedron to wedge and pyramid
    assert np.count_nonzero(number < 0) == 1 + 1 + 2
    triangles = faces[folded(faces) & (number.ravel() >= 0)]
    assert len(triangles) == 2 + 4 + 4


def test_faces_of_hexahedra_of_20_nodes_have_the_middles_of_their_edges():
    kind = BY_NAME["hexahedron20"]
    for face in hexahedron_faces(20):
        corners, middles = kind.nodes[face[:4]], kind.nodes[face[4:]]
        np.testing.assert_array_equal(middles, (corners + np.roll(corners, -1, axis=0)) / 2)
