"""Decks of Abaqus and CalculiX: one bar in many forms of writing is one mesh; what is not read is named by its line."""

import logging
import re

import numpy as np
import pytest
from oracles import SIZE, hexahedra

import exudyn_partition as ep
from exudyn_partition.errors import EmptyRegionError, InputError, MeshError

CUBE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1.0]])
PAIR = 0.01 * np.vstack([CUBE, np.add(CUBE[4:], [0, 0, 1])]), np.array([np.arange(8), np.arange(4, 12)])
POINTS, CELLS = hexahedra(2, 3, 4)
MIDDLES = POINTS[CELLS[:, :2]].mean(axis=1)
FOOT = np.flatnonzero(POINTS[:, 0] == POINTS[:, 0].min()) + 1  # numbers of the deck, 1 to 20
ON_FOOT = np.flatnonzero(np.isin(CELLS + 1, FOOT).any(axis=1))  # elements, whose face S6 is on the foot
SECTION = "*MATERIAL, NAME=EL\n*ELASTIC\n210e9, .3\n*SOLID SECTION, ELSET=ALL, MATERIAL=EL\n"
HEAD = "*ELEMENT, TYPE=C3D8, ELSET=ALL\n"


def numbers(values, a_line=8, end=""):
    """Lines of so many numbers each."""
    rows = [values[i : i + a_line] for i in range(0, len(values), a_line)]
    return "".join(", ".join(map(str, row)) + f"{end}\n" for row in rows)


def nodes(points, first=1, end=""):
    return "".join(f"{i}, {x:.17g}, {y:.17g}, {z:.17g}{end}\n" for i, (x, y, z) in enumerate(points.tolist(), first))


def elements(cells, first=1, a_line=9, end=""):
    return "".join(numbers([i, *cell], a_line, end) for i, cell in enumerate((cells + 1).tolist(), first))


MESH = f"*NODE\n{nodes(POINTS)}{HEAD}{elements(CELLS)}"
SET = f"*NSET, NSET=FOOT\n{numbers(FOOT)}"
HALVES = f"*NSET, NSET=A\n{numbers(FOOT[:5])}*NSET, NSET=B\n{numbers(FOOT[5:])}"
OF_FOOT = numbers(ON_FOOT + 1)
SKIN = [cell[[0, 3, 7, 4]] + 1 for cell in CELLS[ON_FOOT]]
PART = f"*PART, NAME=bar\n{MESH}{SECTION}*END PART\n"
INSIDE = f"{PART}*ASSEMBLY, NAME=a\n*INSTANCE, NAME=bar-1, PART=bar\n*END INSTANCE\n"


DIALECTS = {
    "plain": MESH + SET + SECTION,
    "comments between all lines": (MESH + SET + SECTION).replace("\n", "\n** between, 1, 2\n"),
    "blank lines and fields": (MESH + SET + SECTION).replace("\n", " , \n\n").replace("ALL , ", "ALL"),
    "small letters, blanks in keywords": (MESH + SET + SECTION).lower().replace(", ", " ,  ").replace("foot", "FOOT"),
    "lines end as on Windows": (MESH + SET + SECTION).replace("\n", "\r\n"),
    "options continue": (MESH + SET + SECTION).replace("C3D8, ELSET=ALL", "C3D8,\n ELSET=ALL"),
    "two sections of nodes": f"*NODE\n{nodes(POINTS[:20])}*NODE, NSET=REST\n{nodes(POINTS[20:], 21)}{HEAD}"
    + elements(CELLS) + SET,
    "nodes that are there twice": f"*NODE\n{nodes(POINTS)}*NODE, NSET=FOOT\n{nodes(POINTS[:20])}{HEAD}"
    + elements(CELLS),
    "elements over several lines": f"*NODE\n{nodes(POINTS)}{HEAD}{elements(CELLS, a_line=4, end=',')}{SET}{SECTION}",
    "two sections of elements": f"*NODE\n{nodes(POINTS)}{HEAD}{elements(CELLS[:7])}{HEAD}{elements(CELLS[7:], 8)}{SET}",
    "sets before nodes": SET + SECTION + MESH,
    "exponents of Fortran": re.sub(r"(\d\.\d+)(?=[,\n])", r"\1D0", MESH) + SET,
    "text before the first keyword": ">**\nA bar,\n" + MESH + SET,
    "nodes on edges beyond those of the type": f"*NODE\n{nodes(POINTS)}{nodes(MIDDLES, 1001)}{HEAD}"
    + "".join(numbers([i, *cell, 1000 + i], 10) for i, cell in enumerate((CELLS + 1).tolist(), 1)) + SET,
    "an instance in a flat deck": MESH + SET.replace("FOOT", "FOOT, INSTANCE=Part-1-1"),
    "a part alone, and its section beside it": PART.replace(SECTION, SET) + SECTION,
    "sections that later ones replace": MESH + SET + SECTION.replace("EL\n", "OTHER\n") + SECTION,
    "normals of nodes": f"*NODE\n{nodes(POINTS, end=', 1., 0., 0.')}{HEAD}{elements(CELLS)}{SET}",
    "two sets in a line": MESH + HALVES + "*NSET, NSET=FOOT\nA, B\n",
    "sets in two lines, mixed with numbers": MESH + f"*NSET, NSET=A\n{numbers(FOOT[:5])}"
    + f"*NSET, NSET=FOOT\nA, {FOOT[5]}\n{numbers(FOOT[6:])}",
    "a set that is continued": MESH + f"*NSET, NSET=FOOT\n{numbers(FOOT[:5])}*NSET, NSET=Foot\n{numbers(FOOT[5:])}",
    "GENERATE, two numbers": MESH + f"*NSET, NSET=FOOT, GENERATE\n{FOOT[0]}, {FOOT[-1]}\n",
    "GENERATE, three numbers in two lines": MESH
    + f"*NSET, GENERATE, NSET=FOOT\n{FOOT[0]}, {FOOT[-1]}, 2\n{FOOT[1]}, {FOOT[-1]}, 2,\n",
    "nodes of elements": MESH + "*ELEMENT, TYPE=R3D4, ELSET=skin\n"
    + "".join(numbers([100 + i, *face]) for i, face in enumerate(SKIN)) + "*NSET, NSET=FOOT, ELSET=skin\n",
    "a name in quotes": MESH + SET.replace("FOOT", '"the, foot"') + '*NSET, NSET=FOOT\n"The, foot"\n',
    "surface of elements": MESH + f"*ELSET, ELSET=low\n{OF_FOOT}*SURFACE, NAME=FOOT, TYPE=ELEMENT\nlow, S6\n",
    "surface of single elements": MESH + "*SURFACE, NAME=FOOT\n" + "".join(f"{i + 1}, S6\n" for i in ON_FOOT),
    "surface of nodes": MESH + SET.replace("FOOT", "n") + "*SURFACE, TYPE=NODE, NAME=FOOT\nn\n",
    "an instance of a part": INSIDE + SET.replace("FOOT", "FOOT, INSTANCE=bar-1") + "*END ASSEMBLY\n",
    "a set of the part": INSIDE.replace(SECTION, SET + SECTION) + "*END ASSEMBLY\n",
    "a set of an instance's set": INSIDE.replace(SECTION, SET.replace("FOOT", "n") + SECTION)
    + "*NSET, NSET=FOOT\nbar-1.n\n*END ASSEMBLY\n",
    "an internal set of the assembly": INSIDE + f"*ELSET, ELSET=_s, INTERNAL, INSTANCE=bar-1\n{OF_FOOT}"
    + "*SURFACE, NAME=FOOT\n_s, S6\n*END ASSEMBLY\n",
    "a mesh of the instance": "*PART, NAME=p\n*END PART\n*ASSEMBLY\n*INSTANCE, NAME=i, PART=p\n" + MESH + SET
    + "*END INSTANCE\n",
    "skin and edges as Gmsh writes them": f"*Heading\n x\n*NODE\n{nodes(POINTS)}******* E L E M E N T S *************\n"
    + "*ELEMENT, type=T3D2, ELSET=Line1\n1, 1, 2\n*ELEMENT, type=CPS4, ELSET=FOOT\n"
    + "".join(numbers([2 + i, *face]) for i, face in enumerate(SKIN))
    + HEAD.replace("ALL", "Volume1") + elements(CELLS, 100),
}  # fmt: skip


def feet(fem):
    """Facets on the foot of the bar, found by their places."""
    return np.flatnonzero((fem.points[fem.facets, 0] == POINTS[:, 0].min()).all(axis=1))


@pytest.mark.parametrize("name", DIALECTS)
def test_one_bar_in_many_forms(tmp_path, name):
    path = tmp_path / "bar.inp"
    path.write_text(DIALECTS[name], newline="")
    fem = ep.fe_model(path, ep.STEEL)
    np.testing.assert_array_equal(fem.points, POINTS)
    np.testing.assert_array_equal(fem.cells, CELLS)
    np.testing.assert_array_equal(fem.boundaries["FOOT"], feet(fem))
    assert len(feet(fem)) == 12


@pytest.mark.parametrize("inside", [True, False])
def test_included_files(tmp_path, inside):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "nodes.inc").write_text(f"** nodes\n{nodes(POINTS)}")
    (tmp_path / "parts" / "more.inc").write_text(f"{HEAD}{elements(CELLS)}*INCLUDE, INPUT=set.inc\n")
    (tmp_path / "parts" / "set.inc").write_text(SET)
    begin = "*NODE\n*INCLUDE, INPUT=parts/nodes.inc\n" if inside else "*NODE, INPUT=parts\\nodes.inc\n"
    path = tmp_path / "bar.inp"
    path.write_text(begin + "*Include,\n input=parts/more.inc\n" + SECTION)
    fem = ep.fe_model(path, ep.STEEL)
    np.testing.assert_array_equal(fem.points, POINTS)
    np.testing.assert_array_equal(fem.boundaries["FOOT"], feet(fem))


@pytest.mark.parametrize(
    "include",
    [
        "*INCLUDE, INPUT='the parts/Nodes.inc'",
        '* include , Input = "THE PARTS/nodes.INC"',
        "*INCLUDE, INPUT=the parts\\nodes.inc,",
        "*INCLUDE INPUT=the parts/Nodes.inc",
        "*INCLUDE\n, INPUT=\n** a comment\nthe parts/Nodes.inc",
        '*INCLUDE, INPUT="the parts/\nNodes.inc"',
    ],
)
def test_spellings_of_include(tmp_path, include):
    """Capitals of files do not matter on Windows, where many decks were written."""
    (tmp_path / "the parts").mkdir()
    (tmp_path / "the parts" / "Nodes.inc").write_text(nodes(POINTS))
    path = tmp_path / "bar.inp"
    path.write_text(f"*NODE\n{include}\n{HEAD}{elements(CELLS)}")
    np.testing.assert_array_equal(ep.fe_model(path, ep.STEEL).points, POINTS)
    path.write_text(f"*NODE, NSET=all,\n INPUT='the parts/nodes.inc'\n{HEAD}{elements(CELLS)}")
    np.testing.assert_array_equal(ep.fe_model(path, ep.STEEL).points, POINTS)


@pytest.mark.parametrize("name", ["C:\\work\\Job 1\\nodes.inc", "/home/other/nodes.inc", "../elsewhere/NODES.INC"])
def test_files_of_another_computer_are_taken_from_beside_the_deck(tmp_path, name):
    (tmp_path / "nodes.inc").write_text(nodes(POINTS))
    path = tmp_path / "bar.inp"
    path.write_text(f"*NODE\n*INCLUDE, INPUT={name}\n{HEAD}{elements(CELLS)}")
    np.testing.assert_array_equal(ep.fe_model(path, ep.STEEL).points, POINTS)


def test_an_instance_is_shifted_then_turned(tmp_path):
    line = "*INSTANCE, NAME=bar-1, PART=bar\n"
    path = tmp_path / "bar.inp"
    path.write_text(INSIDE.replace(line, line + "1., 2., 3.\n0.5, 0., 0., 0.5, 0., 1., 90.\n"))
    x, y, z = np.add(POINTS, [1, 2, 3]).T
    fem = ep.fe_model(path, ep.STEEL)
    np.testing.assert_allclose(fem.points, np.column_stack([0.5 - y, x - 0.5, z]), atol=1e-14)
    assert fem.total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-9)


def test_nodes_in_other_systems(tmp_path):
    ring = CUBE * [0.01, 60, 0.02] + [0.02, 0, 0]
    path = tmp_path / "sector.inp"
    path.write_text(
        "*SYSTEM\n1., 0., 0., 1., 1., 0., 0., 0., 0.\n*NODE, SYSTEM=C\n"
        + nodes(ring) + "*SYSTEM\n*ELEMENT, TYPE=C3D8\n" + elements(PAIR[1][:1])
    )  # fmt: skip
    fem = ep.fe_model(path, ep.STEEL)
    # Local x is y, local y is -x, from (1, 0, 0) on.
    angle = np.radians(ring[:, 1])
    expected = np.column_stack([1 - ring[:, 0] * np.sin(angle), ring[:, 0] * np.cos(angle), ring[:, 2]])
    np.testing.assert_allclose(fem.points, expected, atol=1e-15)
    assert fem.total_mass == pytest.approx(7800 * 0.5 * np.sin(np.pi / 3) * (0.03**2 - 0.02**2) * 0.02)


@pytest.mark.parametrize("kind", [4, 10, 8])
def test_numbers_of_faces(tmp_path, kind):
    corners = CUBE if kind == 8 else np.vstack([np.zeros(3), np.eye(3)])
    edges = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)] if kind == 10 else []
    points = 0.01 * np.vstack([corners, *(corners[list(edge)].mean(axis=0) for edge in edges)])
    path = tmp_path / "one.inp"
    surfaces = "".join(f"*SURFACE, NAME=S{i}\nALL, S{i}\n" for i in range(1, 7 if kind == 8 else 5))
    path.write_text(
        f"*NODE\n{nodes(points)}*ELEMENT, TYPE=C3D{kind}, ELSET=ALL\n{elements(np.arange(kind)[None])}"
        f"{surfaces}*SURFACE, NAME=skin\nALL\n"
    )
    fem = ep.fe_model(path, ep.STEEL, order=2 if kind == 10 else 1)
    assert len(fem.boundaries["skin"]) == len(fem.facets)
    cube = {"S1": (2, 0), "S2": (2, 1), "S3": (1, 0), "S4": (0, 1), "S5": (1, 1), "S6": (0, 0)}
    for name, (axis, side) in (cube if kind == 8 else {"S1": (2, 0), "S2": (1, 0), "S4": (0, 0)}).items():
        (facet,) = fem.boundaries[name]
        np.testing.assert_allclose(fem.points[fem.facets[facet], axis], 0.01 * side, atol=1e-15)
    if kind != 8:
        (facet,) = fem.boundaries["S3"]
        np.testing.assert_allclose(fem.points[fem.facets[facet]].sum(axis=1), 0.01)


def deck(*, nodes="*NODE", before="", elements=("*ELEMENT, TYPE=C3D8",) * 2, after=""):
    """A deck of two cubes, one on the other."""
    lines = [before, nodes, *(f"{i + 1}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(PAIR[0]))]
    for i, (keyword, cell) in enumerate(zip(elements, PAIR[1] + 1, strict=True)):
        lines += [keyword, f"{i + 1}, " + ", ".join(map(str, cell))]
    return "\n".join([line for line in [*lines, after] if line]) + "\n"


SETS = ("*ELEMENT, TYPE=C3D8, ELSET=a", "*ELEMENT, TYPE=C3D8, ELSET=b")
SECTIONS = "*SOLID SECTION, ELSET=a, MATERIAL=steel\n,\n*SOLID SECTION, ELSET=b, MATERIAL={}\n,"


@pytest.mark.parametrize(
    "text",
    [
        deck(),
        deck(elements=SETS, after=SECTIONS.format("Steel")),
        deck(before="*HEADING\n*PART, NAME=p", after="*END PART\n*ASSEMBLY\n*INSTANCE, NAME=i, PART=p\n*END INSTANCE"),
        deck(before="*PART, NAME=q\n*END PART\n*PART, NAME=p", after="*END PART"),
        deck(after="*NODE, NSET=reference\n99, 1.0, 0.0, 0.0\n*NSET, NSET=far\n99, 1000"),
        deck(after="*ELEMENT, TYPE=B31\n8, 1, 2\n*TIE, NAME=t\na, b\n*ELEMENT, TYPE=DCOUP3D\n9, 3"),
    ],
)
def test_decks_of_one_body(tmp_path, text):
    path = tmp_path / "deck.inp"
    path.write_text(text)
    assert ep.fe_model(path, ep.STEEL).total_mass == pytest.approx(7800 * 2e-6)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (deck(elements=SETS, after=SECTIONS.format("foam")), r"2 regions by \*SOLID SECTION: 'steel', 'foam'\."),
        (deck(elements=SETS), r"2 regions by \*ELEMENT, ELSET: 'a', 'b'"),
        (deck(after="*INCLUDE, INPUT=none.inp"), r"line 18: expected a file to include, there is none at .*none\.inp"),
        (deck(after="*INCLUDE"), r"line 18: \*INCLUDE needs INPUT="),
        (deck(after="*INCLUDE, INPUT=deck.inp"), "expected files that do not include each other"),
        (deck(after="*NCOPY, OLD SET=a, NEW SET=b, CHANGE NUMBER=20, SHIFT\n0,0,1"), r"line 18: .* got \*NCOPY"),
        (deck(nodes="*NODE, SYSTEM=S"), "line 1: expected SYSTEM=R or C, got S"),
        (deck(nodes="*SYSTEM\n0, 0, 0, 1, 0, 0\n*NODE"), r"line 1: \*SYSTEM needs three points"),
        (deck(after="*INSTANCE, NAME=i, PART=p\n*END INSTANCE"), "line 18: expected PART= of a part that is there"),
        (deck(after="*MASS, ELSET=m\n0.3"), r"line 18: .*solid elements alone, got \*MASS, whose mass and stiffness"),
        (deck(after="*Shell Section, elset=s,\n material=steel\n1e-3"), r"got \*SHELL SECTION"),
        (deck(after="*ELEMENT, TYPE=T3D2, ELSET=t\n8, 1, 2\n*SOLID SECTION, ELSET=t"), r"got 1 others of a \*SOLID"),
        (deck(after="*ELEMENT, TYPE=SPRINGA, ELSET=t\n8, 1, 2"), "line 18: elements of TYPE=SPRINGA are not read"),
        (deck(after="*ELEMENT, TYPE=C3D8\n8, 1, 2, 3\n"), "line 19: element 8 of TYPE=C3D8 has 3 nodes, expected 8"),
        (deck(after="*ELEMENT, TYPE=C3D4\n8, 1, 2, 3, 4, 5\n"), "line 19: element 8 of TYPE=C3D4 has 5 nodes, expec"),
        (deck(after="*ELEMENT, TYPE=C3D8\n2, 1, 2, 3, 4, 5, 6, 7, 8"), "line 19: element 2 is there already"),
        (deck(after="*ELEMENT, TYPE=C3D8\n3, 1, 2, 3, 4, 5, 6, 7, 77"), "the first is element 3 with node 77"),
        (deck(after="*ELEMNT, TYPE=c3d8\n9, 1, 2, 3, 4, 5, 6, 7, 8"), r"line 18: expected \*ELEMENT with TYPE=c3d8"),
        (deck(after="*NSET, NSET=a\n99999999999999999\n"), "line 19: expected whole numbers up to"),
        (deck(after="*NODE\n3, 0., 0., 1."), "line 18: node 3 has another place already"),
        (deck(after="*NODE\n3.5, 0., 0., 1."), "line 19: expected a node's whole number and its place"),
        (deck(after="*NODE\n33, 0., nan, 1."), "line 19: expected a node's whole number and its place"),
        (deck(after="*NODE\n33 0. 0. 1."), "line 19: expected numbers, separated by commas, got '33 0. 0. 1.'"),
        (deck(after="*NSET, NSET=a\nb\n"), "line 19: there is no set of nodes 'b'"),
        (deck(after="*NSET, NSET=a\nb\n*NSET, NSET=b\na\n"), "expected sets of others, got '[ab]', which contains"),
        (deck(after="*NSET, NSET=a, GENERATE\n1, 5, 0\n"), "line 19: GENERATE needs an ascending range, got '1, 5, 0'"),
        (deck(after="*NSET, NSET=a, GENERATE\n1\n"), "line 19: GENERATE needs first, last and increment, got '1'"),
        (
            deck(before="*PART, NAME=p", after="*END PART\n*INSTANCE, NAME=j, PART=p\n*END INSTANCE\n"
                 "*NSET, NSET=a, INSTANCE=i\n1\n"),
            "line 23: there is no instance 'i'",
        ),
        (deck().replace("2, 5, 6", "2, 6, 5, 6"), "line 17: element 2 of TYPE=C3D8 has 9 nodes, expected 8"),
        (deck(after="*NODE\n13, .01, .01, .03\n*ELEMENT, TYPE=C3D4\n3, 9, 10, 11, 13\n4, 9, 10, 13, 11\n"),
         r"1 of 2 elements are inverted .* element 4 \(.*deck.inp, line 22\), a tetra of nodes \[9, 10, 13, 11\]"),
        (deck(after="*NSET\n1\n"), r"line 18: \*NSET needs NSET="),
        (deck(after="*SURFACE, NAME=s\n1, S7\n"), "line 19: expected a face S1 to S6 of these elements, got S7"),
    ],
)  # fmt: skip
def test_what_is_not_read_is_named_by_its_line(tmp_path, text, message):
    path = tmp_path / "deck.inp"
    path.write_text(text)
    with pytest.raises(MeshError, match=message):
        ep.fe_model(path, ep.STEEL)


def test_several_instances_are_refused_by_their_names(tmp_path):
    line = "*INSTANCE, NAME=bar-1, PART=bar\n"
    path = tmp_path / "deck.inp"
    path.write_text(INSIDE.replace(line, line + "*END INSTANCE\n" + line.replace("bar-1", "bar-2") + "1., 0., 0.\n"))
    at = 1 + path.read_text().splitlines().index(elements(CELLS).splitlines()[0])
    begin = re.escape(" and ".join([f"element 1 ({path}, line {at})"] * 2))
    message = f"got 2 parts that share no face, .* which begin with {begin}.* by solid=, of 'bar-1', 'bar-2'"
    with pytest.raises(MeshError, match=message):
        ep.fe_model(path, ep.STEEL)


def test_an_instance_of_a_rigid_surface_is_left_out(tmp_path):
    path = tmp_path / "deck.inp"
    rigid = "*PART, NAME=r\n" + MESH.replace("C3D8", "R3D4").partition("*ELEMENT")[0]
    rigid += "*ELEMENT, TYPE=R3D4, ELSET=R\n" + "".join(numbers([i, *face]) for i, face in enumerate(SKIN))
    path.write_text(
        rigid + "*END PART\n" + INSIDE + "*INSTANCE, NAME=r-1, PART=r\n0., 0., 9.\n*END INSTANCE\n"
        + SET.replace("FOOT", "FOOT, INSTANCE=bar-1")
    )  # fmt: skip
    fem = ep.fe_model(path, ep.STEEL)
    np.testing.assert_array_equal(fem.points, POINTS)
    np.testing.assert_array_equal(fem.boundaries["FOOT"], feet(fem))


def test_a_named_face_inside_the_body(tmp_path):
    path = tmp_path / "deck.inp"
    path.write_text(MESH + "*SURFACE, NAME=inside\n1, S2\n")
    fem = ep.fe_model(path, ep.STEEL)
    for call, argument in (
        (ep.Partition.surface, "faces"),
        (ep.Partition.load, "faces"),
        (ep.Partition.interface, "nodes"),
    ):
        with pytest.raises(EmptyRegionError, match=f"{argument}: .* no face of 'inside' is there; it lies inside"):
            call(*(fem, "inside") if call == ep.Partition.surface else (fem, "name", "inside"))


def test_a_file_that_is_no_deck(tmp_path):
    (tmp_path / "deck.inp").write_text("/PREP7\nN,1,0,0,0\n")
    with pytest.raises(InputError, match=r"deck\.inp, line 1: expected keywords that begin with \*, got '/PREP7'"):
        ep.fe_model(tmp_path / "deck.inp", ep.STEEL)


def test_other_integration_is_told(tmp_path, caplog):
    (tmp_path / "bar.inp").write_text(MESH.replace("C3D8", "C3D8R"))
    with caplog.at_level(logging.INFO, "exudyn_partition"):
        fem = ep.fe_model(tmp_path / "bar.inp", ep.STEEL)
    assert any("24 C3D8R are taken with full integration" in message for message in caplog.messages)
    assert fem.total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-12)
