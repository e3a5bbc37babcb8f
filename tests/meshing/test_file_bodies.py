"""One body of a file that holds several: by each kind of name it is the body that a file of its own would give."""

import logging
import re

import meshio
import numpy as np
import pytest
from oracles import SIZE, hexahedra

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MeshError

LOW, CELLS = hexahedra(2, 1, 3)
X, Y, Z = map(float, SIZE)
HIGH, HIGH_CELLS = LOW + np.array([0, 0, Z]), CELLS  # it stands on the first one, with nodes of its own
POINTS, BOTH = np.vstack([LOW, HIGH]), np.vstack([CELLS, HIGH_CELLS + len(LOW)])
OWNER = np.repeat([0, 1], len(CELLS))
DECK_STEEL = "*MATERIAL, NAME=STEEL\n*ELASTIC\n210e9, .3\n*DENSITY\n7800.\n"
DECK_ALLOY = "*MATERIAL, NAME=ALLOY\n*ELASTIC\n70e9, .3\n*DENSITY\n2700.\n"


def nodes(points, first=1):
    return "*NODE\n" + "".join(f"{i}, {x!r}, {y!r}, {z!r}\n" for i, (x, y, z) in enumerate(points.tolist(), first))


def elements(cells, name, first=1):
    lines = (", ".join(map(str, [i, *row])) for i, row in enumerate((cells + 1).tolist(), first))
    return f"*ELEMENT, TYPE=C3D8, ELSET={name}\n" + "\n".join(lines) + "\n"


FLAT = nodes(POINTS) + elements(CELLS, "EROD") + elements(BOTH[len(CELLS) :], "EPIN", len(CELLS) + 1)
TOP = [i for i, cell in enumerate(CELLS, 1) if (LOW[cell, 2] > Z - 1e-9).any()]  # of the rod, whose face S2 it is
FOOT = [i + len(CELLS) for i, cell in enumerate(CELLS, 1) if (LOW[cell, 2] < 1e-9).any()]
SECTIONS = (
    f"{DECK_STEEL}{DECK_ALLOY}*SOLID SECTION, ELSET=EROD, MATERIAL=STEEL\n*SOLID SECTION, ELSET=EPIN, MATERIAL=ALLOY\n"
)
SURFACES = "".join(
    f"*SURFACE, NAME={name}\n" + "".join(f"{i}, {face}\n" for i in rows)
    for name, rows, face in (("TOP", TOP, "S2"), ("FOOT", FOOT, "S1"))
)
PART = f"*PART, NAME=bar\n{nodes(LOW)}{elements(CELLS, 'ALL')}*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL\n*END PART\n"
INSTANCES = f"""{PART}*ASSEMBLY, NAME=a
*INSTANCE, NAME=rod, PART=bar
*END INSTANCE
*INSTANCE, NAME=pin, PART=bar
0., 0., {Z!r}
*END INSTANCE
*END ASSEMBLY
{DECK_STEEL}"""
PROPERTIES = "".join(
    "CHEXA," + ",".join(map(str, [i, 1 + owner, *row[:6]])) + ",+\n+," + ",".join(map(str, row[6:])) + "\n"
    for i, (owner, row) in enumerate(zip(OWNER, (BOTH + 1).tolist(), strict=True), 1)
)
BULK = (
    "BEGIN BULK\n" + "".join(f"GRID,{i},,{x:.6f},{y:.6f},{z:.6f}\n" for i, (x, y, z) in enumerate(POINTS.tolist(), 1))
    + PROPERTIES + "PSOLID,1,7\nPSOLID,2,8\nMAT1,7,210.+9,,0.3,7800.\nMAT1,8,70.+9,,0.3,2700.\nENDDATA\n"
)  # fmt: skip


def mesh_file(path, **options):
    """A file of both bars by meshio."""
    tags = options.pop("cell_tags", {})
    file_format = options.pop("file_format", None)
    mesh = meshio.Mesh(POINTS, [("hexahedron", BOTH)], **options)
    if tags:
        mesh.cell_tags = tags
    mesh.write(path, file_format=file_format)


FILES = {  # name, content, name of the upper bar
    "element sets": ("deck.inp", FLAT, "EPIN"),
    "small letters": ("deck.inp", FLAT, "epin"),
    "materials": ("deck.inp", FLAT + SECTIONS, "ALLOY"),
    "a material by its kind": ("deck.inp", FLAT + SECTIONS, "material ALLOY"),
    "a set of sets": ("deck.inp", FLAT + "*ELSET, ELSET=high\nEPIN\n", "high"),
    "instances": ("deck.inp", INSTANCES, "pin"),
    "a set of an instance": ("deck.inp", INSTANCES, "pin.ALL"),
    "a set of the assembly": ("deck.inp", INSTANCES.replace(
        "*END ASSEMBLY", f"*ELSET, ELSET=up, INSTANCE=pin, GENERATE\n1, {len(CELLS)}\n*END ASSEMBLY"), "up"),
    "pieces without names": ("deck.inp", FLAT.replace("EROD", "E").replace("EPIN", "E"), "E.2"),
    "properties": ("deck.bdf", BULK, "2"),
    "materials of Nastran": ("deck.bdf", BULK, "8"),
    "pieces": ("mesh.vtu", {}, "body.2"),
    "data of VTU": ("mesh.vtu", {"cell_data": {"MaterialIDs": [OWNER + 3]}}, "4"),
    "physical groups": ("mesh.msh", {"file_format": "gmsh22",
        "cell_data": {"gmsh:physical": [OWNER + 1], "gmsh:geometrical": [OWNER + 1]},
        "field_data": {"rod": np.array([1, 3]), "pin": np.array([2, 3])}}, "pin"),
    "volumes": ("mesh.msh", {"file_format": "gmsh22", "cell_data": {
        "gmsh:physical": [0 * OWNER], "gmsh:geometrical": [OWNER + 1]}}, "2"),
    "groups of MED": ("mesh.med", {"cell_data": {"cell_tags": [-6 - OWNER]}, "cell_tags":
        {-6: ["rod", "all"], -7: ["pin", "all"]}}, "pin"),
    "sets": ("mesh.f3grid", {"cell_sets": {"rod": [np.flatnonzero(OWNER == 0)], "pin": [np.flatnonzero(OWNER)]}},
             "zone:pin:1"),
}  # fmt: skip


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Model of the upper bar from a file of its own."""
    path = tmp_path_factory.mktemp("alone") / "mesh.vtu"
    meshio.Mesh(HIGH, [("hexahedron", HIGH_CELLS)]).write(path)
    return ep.fe_model(path, ep.STEEL, order=1)


def made(tmp_path, name):
    ending, content, chosen = FILES[name]
    path = tmp_path / ending
    if isinstance(content, str):
        path.write_text(content)
    else:
        mesh_file(path, **content)
    return path, chosen


@pytest.mark.parametrize("name", FILES)
def test_a_body_is_that_of_a_file_of_its_own(tmp_path, alone, name):
    path, chosen = made(tmp_path, name)
    fem = ep.fe_model(path, ep.STEEL, solid=chosen, order=1)
    np.testing.assert_allclose(fem.points, alone.points, atol=1e-6 if path.suffix == ".bdf" else 1e-15)
    np.testing.assert_array_equal(fem.cells, alone.cells)
    tolerance = 1e-4 if path.suffix == ".bdf" else 1e-12  # six digits of places
    for matrix in ("mass", "stiffness"):
        wanted = getattr(alone, matrix)
        assert abs(getattr(fem, matrix) - wanted).max() < tolerance * abs(wanted).max()


@pytest.mark.parametrize("name", FILES)
def test_without_a_name_the_bodies_are_named(tmp_path, name):
    path, _ = made(tmp_path, name)
    bodies = ep.read_bodies(path)
    assert len(bodies.names) == 2
    listed = re.escape(", ".join(map(repr, bodies.names)))
    material = dict.fromkeys({"STEEL", "ALLOY"}, ep.STEEL) if "material" in name and path.suffix == ".inp" else ep.STEEL
    with pytest.raises(MeshError, match=rf"got 2 (parts that share no face.* solid=, of {listed}\.|regions)"):
        ep.fe_model(path, material)
    with pytest.raises(InputError, match=rf"solid: expected one of {listed}.* got 'nut'"):
        ep.fe_model(path, ep.STEEL, solid="nut")


def test_an_assembly_of_a_deck_has_the_deck_s_materials(tmp_path):
    path = tmp_path / "deck.inp"
    path.write_text(FLAT + SECTIONS)
    bodies = ep.read_bodies(path)
    assert bodies.names == ("EROD", "EPIN")
    models = ep.fe_models(bodies, {"EROD": None, "EPIN": None}, order=1)
    volume = np.prod(SIZE)
    masses = {name: fem.total_mass for name, fem in models.items()}
    assert masses == pytest.approx({"EROD": 7800 * volume, "EPIN": 2700 * volume}, rel=1e-12)
    assert models["EPIN"].points[:, 2].min() == pytest.approx(Z)
    mixed = ep.fe_models(bodies, {"STEEL": ep.ALUMINIUM, "EPIN": None}, order=1)
    assert mixed["STEEL"].total_mass == pytest.approx(ep.ALUMINIUM.rho * volume, rel=1e-12)


def test_lengths_are_scaled_once(tmp_path):
    path = tmp_path / "deck.inp"
    path.write_text(INSTANCES.replace(nodes(LOW), nodes(1e3 * LOW)).replace(f"0., {Z!r}", f"0., {1e3 * Z!r}"))
    bodies = ep.read_bodies(path, scale=1e-3)
    for fem in (
        ep.fe_model(bodies, ep.STEEL, solid="pin", order=1),
        ep.fe_model(path, ep.STEEL, solid="pin", scale=1e-3, order=1),
        ep.fe_models(bodies, {"pin": ep.STEEL}, order=1)["pin"],
    ):
        np.testing.assert_allclose(fem.points.max(axis=0), HIGH.max(axis=0), rtol=1e-12)
    assert f"{X:.4g} x {Y:.4g} x {Z:.4g} m around" in str(bodies)


@pytest.mark.parametrize(
    ("lines", "kind", "surfaces"),
    [
        ("*TIE, NAME=t\nFOOT, TOP\n", "tie", ("FOOT", "TOP")),
        ("*CONTACT PAIR, INTERACTION=i, TYPE=SURFACE TO SURFACE\nfoot, top\n", "contact", ("FOOT", "TOP")),
        ("", "touch", ("", "")),
    ],
)
def test_ties_and_contacts_of_a_deck_are_named(tmp_path, lines, kind, surfaces):
    path = tmp_path / "deck.inp"
    path.write_text(FLAT + SURFACES + lines)
    bodies = ep.read_bodies(path)
    ((found, names, by),) = bodies.pairs
    assert (found, by) == (kind, surfaces)
    assert set(names) == {"EROD", "EPIN"}
    assert f"{kind}: " in str(bodies)
    models = ep.fe_models(bodies, {"EROD": ep.STEEL, "EPIN": ep.STEEL}, order=1)
    for name, surface in zip(names, surfaces, strict=True):
        if surface:  # it is a boundary of that body alone
            assert len(models[name].boundaries[surface])
            assert surface not in models[({*names} - {name}).pop()].boundaries


@pytest.mark.parametrize(("card", "kind"), [("BGSET,100,1,2,0.001", "tie"), ("BCTSET,100,1,2,0.2", "contact")])
def test_surfaces_for_contact_of_nastran(tmp_path, card, kind):
    """They name an element and three corners of its face."""
    lines = []
    for number, rows, corners in ((1, TOP, [4, 5, 6]), (2, FOOT, [2, 1, 0])):
        entries = [str(n) for i in rows for n in (i, *(BOTH[i - 1][corners] + 1))]
        lines.append(f"BSURFS,{number},,,," + ",".join(entries[:4]))
        lines += ["+," + ",".join(entries[k : k + 8]) for k in range(4, len(entries), 8)]
    path = tmp_path / "deck.bdf"
    path.write_text(BULK.replace("ENDDATA", "\n".join([*lines, card, "ENDDATA"])))
    bodies = ep.read_bodies(path)
    assert bodies.pairs == ((kind, bodies.names, ("BSURFS 1", "BSURFS 2")),)
    rod, pin = ep.fe_models(bodies, dict.fromkeys(bodies.names, ep.STEEL), order=1).values()
    for fem, surface in ((rod, "BSURFS 1"), (pin, "BSURFS 2")):
        facets = fem.facets[fem.boundaries[surface]]
        assert len(facets) == len(TOP)
        np.testing.assert_allclose(fem.points[facets, 2], Z, atol=1e-6)


def test_a_tie_of_instances_by_their_surfaces(tmp_path):
    inside = "".join(f"*SURFACE, NAME={name}\n{rows}\n" for name, rows in (("TOP", "ALL, S2"), ("FOOT", "ALL, S1")))
    tied = INSTANCES.replace("*END PART", f"{inside}*END PART").replace(
        "*END ASSEMBLY", "*TIE, NAME=t\npin.FOOT, rod.TOP\n*END ASSEMBLY"
    )
    path = tmp_path / "deck.inp"
    path.write_text(tied)
    assert ep.read_bodies(path).pairs == (("tie", ("pin", "rod"), ("pin.FOOT", "rod.TOP")),)


@pytest.mark.parametrize(("gap", "touch"), [(0.0, True), (1e-4, True), (3e-3, False)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_bodies_that_touch_by_geometry(tmp_path, gap, touch, mirrored):
    """Facets are some 5 mm long; elements of some programs list their nodes in the order that mirrors them."""
    cells = BOTH.copy()
    if mirrored:
        cells[::2] = cells[::2][:, [4, 5, 6, 7, 0, 1, 2, 3]]
    path = tmp_path / "mesh.vtu"
    meshio.Mesh(np.vstack([LOW, HIGH + np.array([2e-3, 0, gap])]), [("hexahedron", cells)]).write(path)
    pairs = ep.read_bodies(path).pairs
    assert pairs == ((("touch", ("body.1", "body.2"), ("", "")),) if touch else ())


def test_a_name_that_is_of_several_bodies_or_of_a_part_of_one(tmp_path):
    path = tmp_path / "deck.inp"
    path.write_text(FLAT + "*ELSET, ELSET=ends, GENERATE\n1, 12, 11\n*ELSET, ELSET=half, GENERATE\n1, 6, 2\n")
    with pytest.raises(MeshError, match=r"'ends': expected one connected body, got 2 .* solid=, of 'EROD', 'EPIN'\."):
        ep.fe_model(path, ep.STEEL, solid="ends")
    with pytest.raises(MeshError, match=r"got \d parts that share no face.*which begin with element 1 "):
        ep.fe_model(path, ep.STEEL, solid="half")


def test_a_body_of_other_elements_than_the_rest(tmp_path):
    """A file of linear and of quadratic elements, and of a body with a damaged element."""
    path = tmp_path / "mesh.vtu"
    tetra = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    tet10 = np.vstack(
        [tetra, [tetra[[i, j]].mean(axis=0) for i, j in ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))]]
    )
    points = np.vstack([LOW, 0.01 * tet10 + 1.0])
    meshio.Mesh(points, [("hexahedron", CELLS), ("tetra10", len(LOW) + np.arange(10)[None])]).write(path)
    with pytest.raises(
        MeshError, match=r"elements of one order, best tetra10. Or choose one by solid=, of 'body.1', '"
    ):
        ep.fe_model(path, ep.STEEL)
    assert ep.fe_model(path, ep.STEEL, solid="body.1", order=1).total_mass == pytest.approx(7800 * np.prod(SIZE))
    assert ep.fe_model(path, ep.STEEL, solid="body.2").total_mass == pytest.approx(7800 * 1e-6 / 6)


def test_models_that_share_elements_are_refused(tmp_path, caplog):
    path = tmp_path / "deck.inp"
    path.write_text(FLAT + SECTIONS)
    bodies = ep.read_bodies(path)
    with pytest.raises(InputError, match=r"materials: 6 elements are of 'EROD' and of 'STEEL', whose mass would count"):
        ep.fe_models(bodies, {"EROD": None, "STEEL": None})
    with pytest.raises(InputError, match="maxh: a mesh is taken as it is"):
        ep.fe_models(bodies, {"EROD": None}, maxh=1e-3)
    with pytest.raises(InputError, match="only_solids: has no effect here"):
        ep.fe_model(bodies, solid="EROD", only_solids=True)
    with caplog.at_level(logging.INFO, "exudyn_partition"):
        ep.fe_models(bodies, {"EROD": None}, order=1)
    assert any(message.endswith("left out the bodies EPIN") for message in caplog.messages)


def test_groups_of_faces_and_nodes_in_med_are_boundaries(tmp_path):
    """Only element sets of Abaqus and physical groups of Gmsh were."""
    sides = CELLS[:, [[4, 5, 6, 7]]].reshape(-1, 4)
    top = sides[(LOW[sides, 2] > Z - 1e-9).all(axis=1)]
    low = np.where(LOW[:, 2] < 1e-9, 3, 0)
    mesh = meshio.Mesh(
        LOW, [("hexahedron", CELLS), ("quad", top)], point_data={"point_tags": low},
        cell_data={"cell_tags": [np.full(len(CELLS), -6), np.full(len(top), -8)]},
    )  # fmt: skip
    mesh.cell_tags, mesh.point_tags = {-6: ["bar"], -8: ["top"]}, {3: ["foot"]}
    mesh.write(tmp_path / "mesh.med")
    fem = ep.fe_model(tmp_path / "mesh.med", ep.STEEL, order=1)
    heights = {name: fem.points[fem.facets[rows], 2] for name, rows in fem.boundaries.items()}
    assert set(heights) == {"top", "foot"}
    assert heights["top"].min() == pytest.approx(Z)
    assert abs(heights["foot"]).max() < 1e-12
