"""Bulk data of Nastran: one bar in all forms of fields is one mesh; coordinate systems; what is not read is named."""

import numpy as np
import pytest
from oracles import SIZE, hexahedra

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MeshError

POINTS, CELLS = hexahedra(2, 3, 4)
POINTS = POINTS + 0.5  # so that all numbers fit into fields of eight
NUMBERS = np.arange(len(POINTS)) * 3 + 7


def fixed(fields, width=8, mark=("", "")):
    """Lines of a card in fields of a width, with the end of its line and the begin of the next."""
    name, *data = map(str, fields)
    name, (end, begin), many = (name, mark, 8) if width == 8 else (name + "*", mark, 4)
    rows = [data[i : i + many] for i in range(0, len(data), many)]
    heads = [name] + [begin] * (len(rows) - 1)
    ends = [end] * (len(rows) - 1) + [""]
    return "".join(
        (f"{head:8}" + f"{''.join(f'{field:{width}}' for field in row):64}" + last).rstrip() + "\n"
        for head, row, last in zip(heads, rows, ends, strict=True)
    )


def free(fields, many=8, mark=(",+", "+")):
    """Lines of a card in fields that commas end, likewise."""
    name, *data = map(str, fields)
    rows = [",".join(data[i : i + many]) for i in range(0, len(data), many)]
    return f"{mark[0]}\n{mark[1]},".join([f"{name},{rows[0]}", *rows[1:]]) + "\n"


def large(fields):
    return fixed(fields, 16, ("", "*"))


def real(x):
    return f"{x:.6f}"[:8]


def grids(card=fixed, number=real, places=POINTS, cp=""):
    return "".join(card(["GRID", n, cp, *map(number, x)]) for n, x in zip(NUMBERS, places, strict=True))


def solids(card=fixed, cells=CELLS):
    name = {8: "CHEXA", 4: "CTETRA", 10: "CTETRA"}[cells.shape[1]]
    return "".join(card([name, i, 1, *NUMBERS[cell]]) for i, cell in enumerate(cells, 1))


def bulk(*parts):
    return "SOL 103\nCEND\nTITLE = a bar\nBEGIN BULK\n" + "".join(parts) + "PSOLID,1,1\nENDDATA\n"


ROUNDED = np.array([[float(real(x)) for x in point] for point in POINTS])
OUT_OF_ORDER = [
    fixed(["CHEXA", i, 1, *NUMBERS[cell]], mark=(f"+C{i}", f"+C{i}")).splitlines() for i, cell in enumerate(CELLS)
]
DIALECTS = {
    "small fields, blank continuation": bulk(grids(), solids()),
    "small fields, a plus": bulk(grids(), solids(lambda fields: fixed(fields, mark=("+", "+")))),
    "small fields, marks": bulk(grids(), solids(lambda fields: fixed(fields, mark=("+A1", "+A1")))),
    "small fields, marks without a plus": bulk(grids(), solids(lambda fields: fixed(fields, mark=("KA1", "+A1")))),
    "continuations elsewhere": bulk(
        *(lines[0] + "\n" for lines in OUT_OF_ORDER), grids(), *(lines[1] + "\n" for lines in OUT_OF_ORDER[::-1])
    ),
    "commas": bulk(grids(free), solids(free)),
    "commas, nothing at the end of the line": bulk(grids(free), solids(lambda fields: free(fields, mark=("", "")))),
    "commas, blanks": bulk(grids(free), solids(free)).replace(",", " , "),
    "commas, marks": bulk(grids(free), solids(lambda fields: free(fields, mark=(",+X", "+X")))),
    "large fields": bulk(grids(large), solids(large)),
    "large fields with commas": bulk(
        grids(lambda fields: free([fields[0] + "*", *fields[1:]], 4, (",*", "*"))), solids(free)
    ),
    "tabs": bulk(grids(), "".join("\t".join([line[i : i + 8].strip() for i in range(0, 72, 8)]) + "\n"
                                  for line in solids().splitlines())),
    "small letters": bulk(grids(), solids()).lower(),
    "comments": bulk(grids(), solids()).replace("\n", "\n$ a comment, 1, 2\n").replace("SOL 103", "SOL 103 $ modes"),
    "exponents without E": bulk(grids(number=lambda x: f"{x * 1e1:.5f}"[:6] + "-1"), solids()),
    "exponents with D": bulk(grids(number=lambda x: f"{x * 1e1:.4f}"[:6] + "D-1", card=free), solids(free)),
    "small and large letters in marks": bulk(grids(), solids(lambda fields: fixed(fields, mark=("+a1", "+A1")))),
    "long lines in free fields": bulk(grids(free), solids(lambda fields: ",".join(map(str, fields)) + "\n")),
    "elements in either order": bulk(
        grids(), solids(cells=CELLS[::2]),
        solids(lambda fields: fixed([fields[0], 99 + fields[1], *fields[2:]]), CELLS[1::2][:, np.r_[4:8, 0:4]]),
    ),
    "no begin": grids() + solids() + "ENDDATA\n",
    "no end": bulk(grids(), solids()).replace("ENDDATA", ""),
    "after the end": bulk(grids(), solids()) + "GRID,999,,0.,0.,0.\n",
    "the system of all nodes is the basic one": bulk("GRDSET,,0,,,,0,456\n", grids(), solids()),
    "one node of no element, and links": bulk(grids(), "GRID,1,,9.,9.,9.\nRBE2,900,1,123456,7\n", solids()),
}  # fmt: skip


def assert_same_cells(cells):
    order = [np.lexsort(np.sort(rows, axis=1).T) for rows in (cells, CELLS)]
    np.testing.assert_array_equal(cells[order[0]], CELLS[order[1]])


@pytest.mark.parametrize("name", DIALECTS)
def test_one_bar_in_many_forms(tmp_path, name):
    path = tmp_path / "bar.bdf"
    path.write_text(DIALECTS[name])
    fem = ep.fe_model(path, ep.STEEL)
    np.testing.assert_allclose(fem.points, ROUNDED, atol=2e-5 if "D" in name or "E" in name else 1e-15)
    assert_same_cells(fem.cells)
    assert fem.total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-2 if "expo" in name else 1e-3)


LEVELS = "GRID,{0},,{1},{2},0.\n=,*(3),=,=,=,*(.05),==\n=(2)\n"
REPEATED = "".join(LEVELS.format(*node) for node in [(1, 0, 0), (2, 0.1, 0), (3, 0, 0.1)])


@pytest.mark.parametrize(
    "wedges",
    [
        "CPENTA,1,1,1,2,3,4,5,6\n=,*(1),=,*(3),*(3),*3,*3,*3,*3\n=1\n",
        fixed(["CPENTA", *"11123456"]) + 2 * fixed(["=", "*1", "=", *["*(3)"] * 6]),
        fixed(["CPENTA", *"11123456"]) + "=,2,=,4,5,6,7,8,9\n=,3,=,*3,*3,*3,*3,*3,*3\n",
    ],
)
def test_cards_that_repeat_the_one_before(tmp_path, wedges):
    path = tmp_path / "deck.bdf"
    path.write_text(bulk(REPEATED, wedges))
    fem = ep.fe_model(path, ep.STEEL)
    np.testing.assert_allclose(fem.points, [[*xy, z / 20] for xy in ((0, 0), (0.1, 0), (0, 0.1)) for z in range(4)])
    assert [kind.name for kind, _ in fem.kinds] == ["wedge"]
    assert len(fem.cells) == 3
    assert fem.total_mass == pytest.approx(7800 * 0.005 * 0.15, rel=1e-12)


def test_parts_of_a_deck_are_named_by_their_lines(tmp_path):
    path = tmp_path / "deck.bdf"
    path.write_text(bulk(REPEATED, "CPENTA,1,1,1,2,3,4,5,6\nCPENTA,8,1,7,8,9,10,11,12\n"))
    with pytest.raises(MeshError, match=r"got 2 parts .*element 1 \(.*, line 14\) and element 8 \(.*, line 15\)\. Mer"):
        ep.fe_model(path, ep.STEEL)


def test_included_files(tmp_path):
    (tmp_path / "mesh").mkdir()
    (tmp_path / "mesh" / "a long name.inc").write_text(grids() + "INCLUDE more.inc\n")
    (tmp_path / "mesh" / "more.inc").write_text(solids())
    path = tmp_path / "bar.nas"
    path.write_text(bulk("include 'mesh/\n    a long name.inc'\n"))
    np.testing.assert_array_equal(ep.fe_model(path, ep.STEEL).cells, CELLS)


@pytest.mark.parametrize(
    "include",
    [
        "INCLUDE = 'Mesh/grids.bdf'",
        'include "mesh/\nGRIDS.bdf"',
        "INCLUDE\n'mesh/grids.bdf'",
        "Include mesh\\Grids.BDF",
    ],
)
def test_spellings_of_include(tmp_path, include):
    (tmp_path / "mesh").mkdir()
    (tmp_path / "mesh" / "grids.bdf").write_text(grids())
    (tmp_path / "bar.bdf").write_text(bulk(include + "\n", solids()))
    assert_same_cells(ep.fe_model(tmp_path / "bar.bdf", ep.STEEL).cells)


def test_files_are_included_from_the_first_one_too(tmp_path):
    (tmp_path / "mesh").mkdir()
    (tmp_path / "mesh" / "grids.inc").write_text(grids() + "INCLUDE 'mesh/solids.inc'\n")
    (tmp_path / "mesh" / "solids.inc").write_text(solids())
    (tmp_path / "bar.dat").write_text(bulk("INCLUDE 'mesh/grids.inc'\n"))
    assert_same_cells(ep.fe_model(tmp_path / "bar.dat", ep.STEEL).cells)


def test_shells_beside_solids_may_have_blanks(tmp_path):
    """Shells of a surface name faces at most; axisymmetric elements are left out as shells are."""
    path = tmp_path / "deck.bdf"
    path.write_text(bulk(grids(), solids(), "CQUAD8,900,9,7,10,25,22\nCTRIAX6,901,1,7,10,13,16,19,22\n"))
    with pytest.raises(MeshError, match="got CTRIAX6, whose mass and stiffness would be missing"):
        ep.fe_model(path, ep.STEEL)
    np.testing.assert_array_equal(ep.fe_model(path, ep.STEEL, only_solids=True).cells, CELLS)


@pytest.fixture
def axes():
    """Axes of a system in columns, at random."""
    return np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


def local(places, origin, axes, kind):
    """Coordinates of places in a rectangular, cylindrical or spherical system, with angles in degrees."""
    x, y, z = axes.T @ (places - origin).T
    if kind == "R":
        return np.column_stack([x, y, z])
    turn = np.degrees(np.arctan2(y, x))
    if kind == "C":
        return np.column_stack([np.hypot(x, y), turn, z])
    radius = np.linalg.norm([x, y, z], axis=0)
    return np.column_stack([radius, np.degrees(np.arccos(z / radius)), turn])


def system(number, kind, origin, axes, reference="", card="CORD2"):
    points = np.vstack([origin, origin + 2 * axes[:, 2], origin + axes[:, 0] + 3 * axes[:, 2]])
    return large([f"{card}{kind}", number, reference, *(f"{x:.9E}" for x in points.ravel())])


@pytest.mark.parametrize("kind", "RCS")
@pytest.mark.parametrize("given", ["each node", "all nodes", "all nodes but some"])
def test_nodes_in_other_systems(tmp_path, axes, kind, given):
    if np.linalg.det(axes) < 0:
        axes = -axes
    origin = np.array([0.1, -0.2, 0.3])
    places = local(POINTS, origin, axes, kind)
    cp = np.full(len(POINTS), "7" if given == "each node" else "", dtype=object)
    if given == "all nodes but some":
        places[::2], cp[::2] = POINTS[::2], "0"
    path = tmp_path / "bar.bdf"
    written = [[f"{x:.9E}" for x in place] for place in places]
    nodes = "".join(large(["GRID", n, own, *x]) for n, own, x in zip(NUMBERS, cp, written, strict=True))
    default = "" if given == "each node" else "GRDSET,,7\n"
    path.write_text(bulk(nodes, default, solids(), system(7, kind, origin, axes)))
    fem = ep.fe_model(path, ep.STEEL)
    np.testing.assert_allclose(fem.points, POINTS, atol=1e-8)
    assert fem.total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-6)


@pytest.mark.parametrize("by_nodes", [False, True])
def test_systems_in_systems(tmp_path, axes, by_nodes):
    """The second system is given in the first, a cylindrical one, by places or by nodes."""
    axes = axes * np.linalg.det(axes)
    first, second = np.array([0.1, 0.2, 0.3]), np.array([-0.3, 0.4, 0.2])
    turned = axes[:, [1, 2, 0]]
    corners = local(np.vstack([second, second + turned[:, 2], second + turned[:, 0]]), first, axes, "C")
    texts = [[f"{x:.9E}" for x in corner] for corner in corners]
    if by_nodes:
        made = "".join(large(["GRID", 9001 + i, 5, *text]) for i, text in enumerate(texts))
        made += "CORD1R,4,1,2,3,8,9001,9002,9003\n" + "".join(f"GRID,{i},,{i}.,{i * i}.,0.\n" for i in (1, 2, 3))
    else:
        made = large(["CORD2R", 8, 5, *texts[0], *texts[1], *texts[2]])
    path = tmp_path / "bar.bdf"
    places = local(POINTS, second, turned, "R")
    path.write_text(bulk(system(5, "C", first, axes), made, grids(large, lambda x: f"{x:.9E}", places, 8), solids()))
    np.testing.assert_allclose(ep.fe_model(path, ep.STEEL).points, POINTS, atol=1e-7)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (["INCLUDE 'more.bdf'\n"], "line 5: expected a file to include, there is none at .*more.bdf"),
        (["CONM2,9,7,,0.5\n"], "line 5: expected solid elements alone, got CONM2, whose mass and stiffness"),
        (["CQUAD4,9,2,7,10,13,16\nPSHELL,2,1,.1\n"], "line 5: expected solid elements alone, got CQUAD4"),
        (["CHEXA,99,1,7,10,13,16\n"], "line 5: CHEXA 99 has 4 nodes, expected 8 or 20"),
        (["CTETRA,99,1,7,10,13,16,19,22\n,25,28,31,34,37\n"], "line 5: CTETRA 99 has 11 nodes, expected 4 or 10"),
        (["CTETRA,99,1,7,10,,16\n"], "line 5: CTETRA 99 has 3 nodes, expected 4 or 10, of which only those on edges"),
        (["CBAR,9,2,7,10,0.,0.,1.\nPBARL,2,1,,ROD\n,.1\n"], "line 5: expected solid elements alone, got CBAR"),
        (["CTETRA,99,1,7,10,13,x\n"], "line 5: expected a whole number in field 7 of CTETRA, got 'x'"),
        (["CTETRA,1,1,7,10,13,16\n"], "element 1 is there already"),
        (["CIHEX1,99,1,7,10,13,16,19,22,+\n+,25,28\n"], "line 5: expected CTETRA, .* got CIHEX1, which is not read"),
        (["EGRID,99,1,2,3\n"], "got EGRID, which is not read"),
        (["GRID,999,,1.,2.,x\n"], "line 5: expected a number in field 6 of GRID, got 'X'"),
        (["GRID,999,55,1.,2.,3.\n"], "line 5: there is no coordinate system 55"),
        (["GRID,7,,1.,2.,3.\n"], "node 7 has another place already"),
        (["GRID,999,5,1.,2.,3.\nCORD2R,5,5,0.,0.,0.,0.,0.,1.,+\n+,1.,0.,0.\n"], "got 5, which is defined by itself"),
        (
            ["GRID,999,5,1.,2.,3.\nCORD2R,5,,0.,0.,0.,0.,0.,1.,+\n+,0.,0.,2.\n"],
            "line 6: coordinate system 5: expected three",
        ),
        (["GRID,999,5,1.,2.,3.\nCORD1R,5,1,2,3\n"], "line 6: there is no node 1"),
        (["GRID,999,,1.,2.,3.,,,,,5\n"], "line 5: expected at most 8 fields after the name"),
        (["=,*(1),==\n"], "line 5: expected each card in full, got one that repeats"),
        (["GRID,900,,9.,9.,9.\n=(2)\n"], "line 6: expected each card in full, got one that repeats"),
        (["GRID,900,,9.,9.,9.\n=,*(1),==\n=(x)\n"], "line 7: expected each card in full, got one that repeats"),
        (["GRID,900,,9.,9.,9.\n=,*(x),==\n"], "line 6: expected a number in field 2 of GRID, got 'X'"),
        (["CHEXA,99,1,7,10,13,16,19,22\n,25,28\n=,*(1),==\n"], "line 7: expected each card in full, got one that"),
        (["CPENTA,99,1,7,10,13,16,19,22\n=,*(1),=,=,=,=,=,=,*1\n+,7\n"], "line 6: expected each card in full, got"),
        ([fixed(["PLOAD4", *range(9)], mark=("+P1", "+P2"))], "line 6: the continuation 'P2' belongs to no card"),
    ],
)
def test_what_is_not_read_is_named_by_its_line(tmp_path, parts, message):
    path = tmp_path / "deck.bdf"
    path.write_text(bulk(*parts, grids(), solids()))
    with pytest.raises(MeshError, match=message):
        ep.fe_model(path, ep.STEEL)


def test_a_file_without_cards(tmp_path):
    (tmp_path / "deck.bdf").write_text("BEGIN BULK\n$ nothing\nENDDATA\n")
    with pytest.raises(InputError, match="expected bulk data of Nastran, got no cards"):
        ep.fe_model(tmp_path / "deck.bdf", ep.STEEL)


@pytest.mark.parametrize(("second", "regions"), [("7", 1), ("8", 2)])
def test_properties_are_regions_by_their_materials(tmp_path, second, regions):
    text = bulk(grids(), solids()).replace("PSOLID,1,1\n", f"PSOLID,1,7\nPSOLID,2,{second}\n")
    first = fixed(["CHEXA", 1, 1, *NUMBERS[CELLS[0]]])
    path = tmp_path / "deck.bdf"
    path.write_text(text.replace(first, first.replace("1       1", "1       2", 1)))
    if regions == 1:
        assert ep.fe_model(path, ep.STEEL).total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-3)
        return
    with pytest.raises(MeshError, match="2 regions by Nastran's properties: '1', '2'"):
        ep.fe_model(path, ep.STEEL)
    fem = ep.fe_model(path, {"1": ep.STEEL, "2": ep.ALUMINIUM})
    assert fem.cell_mass[0] / fem.cell_mass[1] == pytest.approx(2700 / 7800, rel=1e-3)


def test_shells_and_lines_without_a_property_are_no_structure(tmp_path):
    path = tmp_path / "deck.bdf"
    more = "CQUAD4,900,9,7,10,25,22\nPSHELL,1,1,.1\nCBAR,901,8,7,10,0.,0.,1.\n"
    path.write_text(bulk(grids(), more, solids()))
    np.testing.assert_array_equal(ep.fe_model(path, ep.STEEL).cells, CELLS)
