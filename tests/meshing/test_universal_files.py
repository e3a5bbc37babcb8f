"""Universal files (`.unv`): the bar of a deck from each kind of elements, its groups, and what is not read."""

import itertools

import numpy as np
import pytest
from oracles import SIZE, hexahedra, quadratic, split, write_deck

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MeshError
from exudyn_partition.fe.elements import BY_NAME

DESCRIPTORS = {"tetra": 111, "tetra10": 118, "wedge": 112, "wedge15": 113, "hexahedron": 115, "hexahedron20": 116}
# Faces around which the format lists corners and the nodes between them, below and above.
RINGS = {"tetra10": [[0, 1, 2]], "wedge15": [[0, 1, 2], [3, 4, 5]], "hexahedron20": [[0, 1, 2, 3], [4, 5, 6, 7]]}


def around(kind):
    """Order of the nodes of a quadratic element in the format: a ring, the middles of upright edges, what is above."""
    edges = {frozenset(ends): BY_NAME[kind].corners + i for i, ends in enumerate(BY_NAME[kind].edges.tolist())}
    rings = [[n for i, a in enumerate(ring) for n in (a, edges[frozenset((a, ring[(i + 1) % len(ring)]))])]
             for ring in RINGS[kind]]  # fmt: skip
    foot, above = rings[0], rings[1] if len(rings) > 1 else [3]
    low = RINGS[kind][0]
    high = RINGS[kind][1] if len(RINGS[kind]) > 1 else [3] * 3
    return [*foot, *(edges[frozenset(pair)] for pair in zip(low, high, strict=True)), *above]


def dataset(number, lines):
    return "    -1\n" + f"{number:6}\n" + "".join(f"{line}\n" for line in lines) + "    -1\n"


def integers(values):
    return "".join(f"{value:10}" for value in values)


def rows(values, a_line=8):
    return [integers(values[i : i + a_line]) for i in range(0, len(values), a_line)]


def nodes(points):
    lines = []
    for i, x in enumerate(points.tolist(), 1):
        lines += [integers([i, 1, 1, 11]), "".join(f"{value:25.16E}".replace("E", "D") for value in x)]
    return dataset(2411, lines)


def elements(blocks, material=lambda i: 1, more=()):
    lines, number = [*more], 0
    for kind, cells in blocks:
        order = around(kind) if kind in RINGS else slice(None)
        for cell in cells:
            number += 1
            lines += [integers([number, DESCRIPTORS[kind], 1, material(number), 7, len(cell)])]
            lines += rows((cell[order] + 1).tolist())
    return dataset(2412, lines)


def group(name, kind, numbers):
    members = [value for number in numbers for value in (kind, number, 0, 0)]
    return dataset(2467, [integers([1, 0, 0, 0, 0, 0, 0, len(numbers)]), name, *rows(members)])


@pytest.mark.parametrize("kind", ["hexahedron", "wedge", "tetra"])
@pytest.mark.parametrize("order", [1, 2])
def test_a_bar_is_that_of_a_deck(tmp_path, kind, order):
    points, cells = hexahedra(1, 2, 2)
    if kind == "tetra":  # six around a diagonal of each hexahedron
        ring = [1, 2, 3, 7, 4, 5, 1]
        blocks = [("tetra", np.vstack([cells[:, [0, a, b, 6]] for a, b in itertools.pairwise(ring)]))]
    else:
        points, blocks = split(points, cells, [kind] * len(cells))
    points, blocks = quadratic(points, blocks) if order == 2 else (points, blocks)
    path = tmp_path / "bar.unv"
    path.write_text(nodes(points) + elements(blocks))
    expected = ep.fe_model(write_deck(tmp_path / "bar.inp", points, *blocks), ep.STEEL, order=order)
    fem = ep.fe_model(path, ep.STEEL, order=order)
    np.testing.assert_array_equal(fem.points, expected.points)
    np.testing.assert_array_equal(fem.cells, expected.cells)
    assert fem.total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-12)


POINTS, CELLS = hexahedra(2, 2, 2)
HIGH = [i for i, cell in enumerate(CELLS, 1) if POINTS[cell, 2].mean() > SIZE[2] / 2]


def test_groups_name_faces_and_bodies(tmp_path):
    foot = (np.flatnonzero(POINTS[:, 2] == 0) + 1).tolist()
    path = tmp_path / "bar.unv"
    path.write_text(nodes(POINTS) + elements([("hexahedron", CELLS)]) + group("foot", 7, foot) + group("high", 8, HIGH))
    fem = ep.fe_model(path, ep.STEEL, order=1)
    assert abs(fem.points[fem.facets[fem.boundaries["foot"]], 2]).max() == 0
    half = ep.fe_model(path, ep.STEEL, solid="high", order=1)
    assert half.total_mass == pytest.approx(fem.total_mass / 2, rel=1e-12)
    assert half.points[:, 2].min() == pytest.approx(SIZE[2] / 2)


def test_materials_and_lines_beside(tmp_path):
    path = tmp_path / "bar.unv"
    beam = [integers([99, 21, 1, 1, 7, 2]), integers([0, 1, 1]), integers([1, 2])]
    path.write_text(
        dataset(164, [f"{1:10}SI: Meters (newton)", "  1.0D+00  1.0D+00"])
        + nodes(POINTS) + elements([("hexahedron", CELLS)], lambda i: 1 + (i in HIGH), beam)
    )  # fmt: skip
    with pytest.raises(MeshError, match=r"2 regions by materials: '1', '2'"):
        ep.fe_model(path, ep.STEEL, order=1)
    fem = ep.fe_model(path, {"1": ep.STEEL, "2": ep.ALUMINIUM}, order=1)
    assert fem.total_mass == pytest.approx((7800 + ep.ALUMINIUM.rho) / 2 * SIZE.prod(), rel=1e-12)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("no file of this kind\n", InputError, "expected a universal file with a dataset of nodes"),
        (elements([("hexahedron", CELLS)], more=[integers([9, 117, 1, 1, 7, 1]), integers([1])]), MeshError,
         r"line \d+: element 9 is of kind 117, expected 111 \(tetra\).* Mesh with tetrahedra"),
        (elements([("hexahedron", CELLS)], more=[integers([9, 161, 1, 1, 7, 1]), integers([1])]), MeshError,
         r"element 9 is of kind 161.* Give only_solids=True"),
        (elements([("hexahedron", CELLS[:, :7])]), MeshError, "element 1 has 7 nodes, expected 8"),
        (elements([("hexahedron", CELLS + 1000)]), MeshError, "name nodes that are not in the file"),
        (dataset(2412, [integers([1, 115, 1, 1, 7, 8]), "1 2 x"]), MeshError, "expected whole numbers, got '1 2 x'"),
    ],
)  # fmt: skip
def test_what_is_not_read_is_named(tmp_path, text, error, message):
    path = tmp_path / "bar.unv"
    path.write_text(text if error is InputError else nodes(POINTS) + text)
    with pytest.raises(error, match=message):
        ep.fe_model(path, ep.STEEL)


def test_springs_are_left_out_if_asked(tmp_path):
    path = tmp_path / "bar.unv"
    mass = [integers([99, 161, 1, 1, 7, 1]), integers([1])]
    path.write_text(nodes(POINTS) + elements([("hexahedron", CELLS)], more=mass))
    assert ep.fe_model(path, ep.STEEL, only_solids=True, order=1).n_nodes == len(POINTS)
