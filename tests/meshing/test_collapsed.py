"""Elements whose nodes have fallen together are the wedges, pyramids and tetrahedra that they are; blank middles."""

import logging

import numpy as np
import pytest
from oracles import SIZE, hexahedra, quadratic, split, write_deck

import exudyn_partition as ep
from exudyn_partition.errors import MeshError
from exudyn_partition.fe.elements import BY_NAME, HEX_EDGES

CORNERS = {
    "hexahedron": [0, 1, 2, 3, 4, 5, 6, 7],
    "wedge": [0, 1, 2, 2, 3, 4, 5, 5],
    "pyramid": [0, 1, 2, 3, 4, 4, 4, 4],
    "tetra": [0, 1, 2, 2, 3, 3, 3, 3],
}
# Rotations of a hexahedron, as orders of its corners: the node that falls on another may be any.
TURNS = [[0, 1, 2, 3, 4, 5, 6, 7], [1, 2, 3, 0, 5, 6, 7, 4], [4, 5, 1, 0, 7, 6, 2, 3], [3, 2, 6, 7, 0, 1, 5, 4]]
# Wedges with an edge or a triangle that has fallen together.
OF_WEDGES = {"pyramid": [0, 1, 4, 3, 2, 4], "tetra": [0, 1, 2, 3, 3, 3]}


def as_hexahedra(blocks, order):
    """Elements as hexahedra whose corners have fallen together, each turned in another way."""
    rows = []
    for kind, cells in blocks:
        name, middles = kind.rstrip("0123456789"), BY_NAME[kind]
        known = {frozenset(ends): middles.corners + i for i, ends in enumerate(middles.edges.tolist())}
        for number, cell in enumerate(cells):
            corners = np.array(CORNERS[name])[TURNS[number % len(TURNS)]]
            row = corners.tolist()
            if order == 2:
                row += [known.get(frozenset(ends), ends[0]) for ends in corners[HEX_EDGES].tolist()]
            rows.append(cell[row])
    return [("hexahedron20" if order == 2 else "hexahedron", np.array(rows))]


def bar(order):
    points, cells = hexahedra(1, 2, 3)
    _, y, z = (points[cells].mean(axis=1) / SIZE).T
    kinds = np.select([y < 0, z > 0.7, z > 0.4], ["wedge", "hexahedron", "pyramid"], "foot")
    found = split(points, cells, kinds)
    return quadratic(*found) if order == 2 else found


@pytest.mark.parametrize("order", [1, 2])
def test_collapsed_hexahedra_are_the_elements_that_they_are(tmp_path, order, caplog):
    points, blocks = bar(order)
    faces = "*SURFACE, NAME=top\n" + "".join(f"body, S{i}\n" for i in range(1, 7))
    plain = ep.fe_model(write_deck(tmp_path / "plain.inp", points, *blocks), ep.STEEL)
    with caplog.at_level(logging.INFO, "exudyn_partition"):
        path = write_deck(tmp_path / "bar.inp", points, *as_hexahedra(blocks, order), more=[faces])
        fem = ep.fe_model(path, ep.STEEL)
    assert any("elements with nodes that have fallen together" in message for message in caplog.messages)
    counts = {kind.name: len(rows) for kind, rows in fem.kinds}
    assert counts == {kind: len(cells) for kind, cells in blocks}
    np.testing.assert_array_equal(fem.points, plain.points)
    assert len(fem.boundaries["top"]) == len(fem.facets)
    # NGSolve integrates pyramids near their tips, where they are no polynomials, by the order of their nodes.
    for got, wanted in ((fem.mass, plain.mass), (fem.stiffness, plain.stiffness)):
        assert abs(got - wanted).max() < 1e-10 * abs(wanted).max()


@pytest.mark.parametrize("kind", OF_WEDGES)
def test_collapsed_wedges(tmp_path, kind):
    points, blocks = bar(1)
    rows = dict(blocks)
    parts = [(name, cells) for name, cells in blocks if name != kind] + [("wedge", rows[kind][:, OF_WEDGES[kind]])]
    plain = ep.fe_model(write_deck(tmp_path / "plain.inp", points, *blocks), ep.STEEL)
    fem = ep.fe_model(write_deck(tmp_path / "bar.inp", points, *parts), ep.STEEL)
    assert abs(fem.stiffness - plain.stiffness).max() < 1e-10 * abs(plain.stiffness).max()


def test_tetrahedra_alone_are_tetrahedra(tmp_path):
    points, blocks = bar(1)
    tetrahedra = dict(blocks)["tetra"][:2]
    used, numbers = np.unique(tetrahedra, return_inverse=True)
    deck = write_deck(tmp_path / "two.inp", points[used], *as_hexahedra([("tetra", numbers.reshape(-1, 4))], 1))
    fem = ep.fe_model(deck, ep.STEEL, order=1)
    assert fem.tetrahedral
    assert fem.total_mass == pytest.approx(7800 * SIZE.prod() / 36, rel=1e-12)  # one of six pyramids, of six bricks


@pytest.mark.parametrize("wrong", [{6: 0}, {1: 0}, {5: 4, 3: 0}])
def test_what_is_no_known_element_is_named(tmp_path, wrong):
    points, cells = hexahedra(1, 1, 2)
    for column, other in wrong.items():
        cells[1, column] = cells[1, other]
    path = write_deck(tmp_path / "bar.inp", points, ("hexahedron", cells))
    with pytest.raises(
        MeshError, match=r"1 of 2 elements have a node twice, .* element 2 \(.*bar.inp, line 16\), a hex"
    ):
        ep.fe_model(path, ep.STEEL)


def test_blank_nodes_on_edges_are_those_of_neighbours_or_new_ones(tmp_path, caplog):
    """Nastran's elements may leave out nodes on their edges, which then are straight."""
    points, blocks = quadratic(*split(*hexahedra(1, 2, 3), ["foot", *["hexahedron"] * 5]))
    order = {"hexahedron20": [*range(12), *range(16, 20), *range(12, 16)]}
    names = {"hexahedron20": "CHEXA", "pyramid13": "CPYRAM", "tetra10": "CTETRA"}
    lines, number = ["BEGIN BULK", "PSOLID,1,1"], 0
    lines += [f"GRID,{i},,{x!r},{y!r},{z!r}" for i, (x, y, z) in enumerate(points.tolist(), 1)]
    everywhere = np.bincount(np.concatenate([cells.ravel() for _, cells in blocks]))
    for kind, cells in blocks:
        for cell in cells:
            number += 1
            nodes = [str(n + 1) for n in cell]
            corners = BY_NAME[kind].corners
            for k in range(corners + number % 3, len(nodes), 4):
                nodes[k] = ""
            if number == 1:  # this node then is in no element
                nodes = [n if not n or everywhere[int(n) - 1] > 1 or i < corners else "" for i, n in enumerate(nodes)]
            row = [str(number), "1", *[nodes[i] for i in order.get(kind, range(len(nodes)))]]
            lines += [f"{',' if i else names[kind] + ','}{','.join(row[i : i + 8])}" for i in range(0, len(row), 8)]
    (tmp_path / "bar.bdf").write_text("\n".join([*lines, "ENDDATA\n"]))
    with caplog.at_level(logging.INFO, "exudyn_partition"):
        fem = ep.fe_model(tmp_path / "bar.bdf", ep.STEEL)
    assert any("mid-side nodes that no element has were put in the middle" in message for message in caplog.messages)
    plain = ep.fe_model(write_deck(tmp_path / "bar.inp", points, *blocks), ep.STEEL)
    assert len(fem.points) == len(points)
    places = [np.lexsort(model.points.round(9).T) for model in (fem, plain)]
    np.testing.assert_allclose(fem.points[places[0]], plain.points[places[1]], atol=1e-15)
    dofs = [(3 * place[:, None] + np.arange(3)).ravel() for place in places]
    K, expected = (model.stiffness[own][:, own] for model, own in zip((fem, plain), dofs, strict=True))
    assert abs(K - expected).max() < 1e-12 * abs(expected).max()
