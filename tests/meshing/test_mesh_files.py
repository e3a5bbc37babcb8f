"""Meshes from files: the file's nodes and geometry, hexahedra in contact, and files that cannot be used."""

import io
import logging
import re
import sys
import threading

import exudyn as exu
import meshio
import netgen.occ as occ
import numpy as np
import pytest
from oracles import SIZE, TOP, box, hexahedra, quadratic, split, write, write_deck

import exudyn_partition as ep
from exudyn_partition.algebra.krylov import eigenmodes, mass_normalised
from exudyn_partition.errors import InputError, MeshError, MeshQualityWarning, MissingPackageError
from exudyn_partition.fe.shapes import shape_functions


def shuffled(fem):
    """Points and cells with nodes in another order, and that order."""
    order = np.random.default_rng(0).permutation(fem.n_nodes)
    return fem.points[order], np.argsort(order)[fem.cells], order


def assert_same_matrices(got, expected, order, tolerance=1e-9):
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    for name in ("mass", "stiffness"):
        wanted = getattr(expected, name)[dofs][:, dofs]
        assert abs(getattr(got, name) - wanted).max() < tolerance * abs(wanted).max(), name


def surface_volume(fem):
    """Volume inside the facets by the divergence theorem, exact for each kind of facet."""
    x, w = np.polynomial.legendre.leggauss(4)
    r, s = np.meshgrid((x + 1) / 2, (x + 1) / 2)
    weight = np.outer(w, w).ravel() / 4
    local = np.column_stack([r.ravel(), s.ravel()])
    if fem.facets.shape[1] != 4:  # a square collapsed to a triangle
        weight = weight * (1 - local[:, 0])
        local[:, 1] *= 1 - local[:, 0]
    values, *derivatives = shape_functions(local, fem.facets.shape[1]).swapaxes(0, 1)
    nodes = fem.points[fem.facets]
    position = np.einsum("qn,fnd->fqd", values, nodes)
    a, b = np.einsum("iqn,fnd->ifqd", derivatives, nodes)
    return np.einsum("q,fqd,fqd->", weight, position, np.cross(a, b)) / 3


def frequencies(fem, f_max):
    modes = eigenmodes(fem.stiffness, fem.mass, mass_normalised(fem.rigid_modes, fem.mass), 2 * np.pi * f_max)
    return modes.omega / (2 * np.pi)


@pytest.fixture(scope="module")
def small():
    """Linear and quadratic models of a box with few elements."""
    return {order: ep.fe_model(box(*SIZE), ep.STEEL, order=order, maxh=0.01) for order in (1, 2, 3)}


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("name", "file_format"),
    [("b.vtu", None), ("b.msh", "gmsh"), ("b.msh", "gmsh22"), ("b.inp", None), ("b.bdf", None), ("b.NAS", "nastran")],
)
def test_every_format_gives_the_matrices_of_the_direct_model(small, tmp_path, capfd, name, file_format, order):
    points, cells, numbers = shuffled(small[order])
    points = points + 0.05  # meshio cannot write negative numbers to Nastran's fields
    path = write(tmp_path / name, points, cells, file_format=file_format)
    capfd.readouterr()
    fem = ep.fe_model(str(path), ep.STEEL, order=order)
    np.testing.assert_allclose(fem.points, points, rtol=1e-11)
    np.testing.assert_array_equal(fem.cells, cells)
    assert_same_matrices(fem, small[order], numbers)
    assert not any(capfd.readouterr())  # meshio tries its reader of Ansys on .msh, and says so


def test_quadratic_elements_keep_their_own_mid_side_nodes(tmp_path):
    sphere = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), 0.01), ep.STEEL, maxh=5e-3)
    points, cells, numbers = shuffled(sphere)
    fem = ep.fe_model(write(tmp_path / "sphere.vtu", points, cells), ep.STEEL)
    assert fem.total_mass == pytest.approx(surface_volume(fem) * 7800, rel=1e-12)
    assert fem.total_mass == pytest.approx(4 / 3 * np.pi * 0.01**3 * 7800, rel=5e-3)
    assert_same_matrices(fem, sphere, numbers)
    uniform = np.tile([1.0, 0, 0], fem.n_nodes)
    assert uniform @ fem.mass @ uniform == pytest.approx(fem.total_mass, rel=1e-12)


@pytest.mark.parametrize("order", [2, 3])
def test_linear_tetrahedra_can_be_raised(small, order, tmp_path):
    linear = small[1]
    fem = ep.fe_model(write(tmp_path / "box.vtu", linear.points, linear.cells), ep.STEEL, order=order)
    np.testing.assert_allclose(fem.points[: linear.n_nodes], linear.points, atol=1e-16)
    assert fem.order == order
    assert_same_matrices(fem, small[order], np.arange(fem.n_nodes))


def test_linear_tetrahedra_bend_too_stiffly_and_say_so(tmp_path):
    bar = ep.fe_model(box(0.04, 0.01, 0.01), ep.STEEL, maxh=5e-3, order=1)
    path = write(tmp_path / "bar.vtu", bar.points, bar.cells)
    with pytest.warns(MeshQualityWarning, match=r"bar\.vtu holds linear tetrahedra, .* Give order=2"):
        linear = ep.fe_model(path, ep.STEEL)
    raised = ep.fe_model(path, ep.STEEL, order=2)
    assert frequencies(linear, 60e3)[0] > 1.2 * frequencies(raised, 60e3)[0]


def test_mass_and_facets_of_distorted_hexahedra(tmp_path):
    points, cells = hexahedra(2, 3, 4)
    points = points + 1e-3 * np.random.default_rng(0).uniform(-1, 1, points.shape)
    fem = ep.fe_model(write(tmp_path / "skew.vtu", points, cells), ep.STEEL)
    assert fem.facets.shape == (2 * (2 * 3 + 3 * 4 + 4 * 2), 4)
    assert fem.total_mass == pytest.approx(surface_volume(fem) * 7800, rel=1e-12)
    assert fem.lumped_mass.sum() == pytest.approx(fem.total_mass, rel=1e-12)
    assert repr(fem).startswith("FEModel(60 nodes, 24 hexahedra of order 1")


def test_frequencies_of_hexahedra_converge_to_those_of_quadratic_tetrahedra(bricks, tmp_path):
    assert bricks.total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-12)
    assert bricks.max_size == pytest.approx(2.5e-3)
    coarse = ep.fe_model(write(tmp_path / "coarse.vtu", *hexahedra(2, 4, 6)), ep.STEEL)
    exact = frequencies(ep.fe_model(box(*SIZE), ep.STEEL, maxh=3e-3), 80e3)[:4]
    errors = [frequencies(fem, 90e3)[:4] / exact - 1 for fem in (coarse, bricks)]
    assert errors[1].min() > 0  # conforming elements are too stiff
    assert errors[1].max() < 0.03
    np.testing.assert_allclose(errors[0] / errors[1], 4, rtol=0.15)  # second order


def test_a_ball_hits_hexahedra_as_it_hits_tetrahedra(bricks, ball, block, top):
    forces = []
    for fem, partition in ((bricks, ep.Partition.ball(bricks, TOP, 6e-3)), (block, top)):
        mbs = exu.SystemContainer().AddSystem()
        bodies = [ep.reduce(*pair, basis="residual", f_cut=150e3) for pair in (ball, (fem, partition))]
        striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0])
        target = ep.CreatePartitionBody(mbs, bodies[1])
        contact = ep.CreatePartitionContact(mbs, striker, target)
        mbs.Assemble()
        forces.append(contact.force(ep.solve_dynamic(mbs, end_time=60e-6, step=0.5e-6)))
    on_hexahedra, on_tetrahedra = forces
    assert on_hexahedra[-1] == 0
    assert on_hexahedra.sum() == pytest.approx(on_tetrahedra.sum(), rel=1e-3)
    assert on_hexahedra.max() == pytest.approx(on_tetrahedra.max(), rel=0.1)  # few nodes touch on meshes this coarse


def test_gmsh_names_boundaries(small, tmp_path):
    fem = small[2]
    top = fem.facets[(fem.points[fem.facets, 2] > SIZE[2] - 1e-9).all(axis=1)]
    tags = [np.full(len(fem.cells), 1), np.full(len(top), 1)]  # volumes and surfaces are numbered apart
    path = write(
        tmp_path / "named.msh",
        fem.points,
        fem.cells,
        ("triangle6", top),
        file_format="gmsh22",
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={"steel": np.array([1, 3]), "top": np.array([1, 2])},
    )
    got = ep.fe_model(path, ep.STEEL)
    assert set(got.boundaries) == {"top"}
    assert {*got.boundaries["top"]} == {*np.flatnonzero((fem.points[fem.facets, 2] > SIZE[2] - 1e-9).all(axis=1))}


GMSH_4 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
2
2 1 "base"
3 1 "steel"
$EndPhysicalNames
$Entities
0 0 1 1
1 0 0 0 1 1 0 1 1 0
1 0 0 0 1 1 1 1 1 1 1
$EndEntities
$Nodes
1 4 10 40
3 1 0 4
40
10
30
20
0 0 0
0.01 0 0
0 0.01 0
0 0 0.01
$EndNodes
$Elements
2 2 1 2
2 1 2 1
1 40 30 10
3 1 4 1
2 40 10 30 20
$EndElements
"""


def test_a_file_as_gmsh_writes_it(tmp_path):
    (tmp_path / "one.msh").write_text(GMSH_4)
    fem = ep.fe_model(tmp_path / "one.msh", ep.STEEL, order=1)
    np.testing.assert_array_equal(fem.cells, [[0, 1, 2, 3]])
    assert fem.total_mass == pytest.approx(7800e-6 / 6)
    assert set(fem.boundaries) == {"base"}
    assert set(fem.facets[fem.boundaries["base"]].ravel()) == {0, 1, 2}


def test_abaqus_names_boundaries(tmp_path):
    points, cells = hexahedra(1, 2, 3)
    bottom = cells[points[cells[:, 0], 2] == 0][:, :4]
    sets = {"solid": [np.arange(len(cells)), []], "bottom": [[], np.arange(len(bottom))]}
    sets = {name: [np.array(rows, dtype=int) for rows in blocks] for name, blocks in sets.items()}
    path = write(tmp_path / "named.inp", points, cells, ("quad", bottom), cell_sets=sets)
    fem = ep.fe_model(path, ep.STEEL)
    assert set(fem.boundaries) == {"bottom"}
    assert len(fem.boundaries["bottom"]) == len(bottom) == 2
    np.testing.assert_allclose(fem.points[fem.facets[fem.boundaries["bottom"]], 2], 0)


@pytest.mark.parametrize("kind", [4, 8])
def test_sets_of_nodes_name_boundaries(small, tmp_path, kind):
    points, cells = hexahedra(1, 2, 3) if kind == 8 else (small[1].points, small[1].cells)
    sets = {"foot": np.flatnonzero(np.isclose(points[:, 2], points[:, 2].min())), "corner": np.array([0])}
    fem = ep.fe_model(write(tmp_path / "sets.inp", points, cells, point_sets=sets), ep.STEEL, order=1)
    assert set(fem.boundaries) == {"foot"}  # a node alone spans no face
    assert set(fem.facets[fem.boundaries["foot"]].ravel()) == set(sets["foot"])
    assert set(ep.Partition.interface(fem, "foot", "foot").interfaces[0].nodes) == set(sets["foot"])
    nameless = ep.fe_model(write(tmp_path / "none.vtu", points, cells), ep.STEEL, order=1)
    with pytest.raises(InputError, match=r"nodes: expected numbers, for no boundary .* has a name, got 'foot'"):
        ep.Partition.interface(nameless, "foot", "foot")


def test_step_files_are_meshed_as_shapes(tmp_path):
    box(*SIZE).WriteStep(str(tmp_path / "block.step"))
    fem = ep.fe_model(tmp_path / "block.step", ep.STEEL, maxh=0.01)
    assert fem.order == 2
    assert fem.total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-9)


@pytest.mark.parametrize("kind", [4, 10, 8])
def test_elements_that_are_all_mirrored_are_turned(small, tmp_path, kind):
    if kind == 8:
        points, cells = hexahedra(1, 2, 3)
    else:
        fem = small[1 if kind == 4 else 2]
        points, cells = fem.points, fem.cells
    fem = ep.fe_model(write(tmp_path / "mirror.vtu", points * [-1, 1, 1], cells), ep.STEEL, order=1 + (kind == 10))
    assert fem.total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-12)
    assert surface_volume(fem) == pytest.approx(SIZE.prod(), rel=1e-12)
    np.testing.assert_array_equal(np.sort(fem.cells), np.sort(cells))


def refused(path, *patterns, error=MeshError, **options):
    for pattern in patterns:
        with pytest.raises(error, match=pattern):
            ep.fe_model(path, ep.STEEL, **options)


def test_unusable_elements(tmp_path):
    points, cells = hexahedra(1, 1, 2)
    polyhedra = ("VTK_LAGRANGE_WEDGE", cells[:1, [0, 1, 2, 4, 5, 6]])
    quadratic = ("tetra10", np.arange(10)[None])
    path = tmp_path / "mesh.vtu"
    refused(write(path, points, ("quad", cells[:, :4])), "expected solid elements, got 2 quad. Export the vol")
    refused(write(path, points, polyhedra), "expected some of hexahedron, .*, got 1 VTK_LAGRANGE_WEDGE. Mesh the body")
    refused(
        write(path, points, cells, quadratic), "got 2 hexahedron, 1 tetra10. Mesh the body with elements of one order"
    )
    collapsed = cells.copy()
    collapsed[1, 5] = collapsed[1, 4]
    used, numbers = np.unique(collapsed, return_inverse=True)
    refused(write(path, points[used], numbers.reshape(-1, 8)), "1 of 2 elements have a node twice, and are no wedges,")


@pytest.mark.parametrize("name", ["mesh.vtu", "mesh.inp"])
def test_nodes_of_no_element_are_left_out(tmp_path, name, caplog):
    points, cells = hexahedra(1, 2, 3)
    foot = np.flatnonzero(points[:, 2] == 0)
    alone = ep.fe_model(write(tmp_path / f"alone_{name}", points, cells, point_sets={"foot": foot}), ep.STEEL)
    beside, cells = np.vstack([[9.0, 9, 9], points, [8.0, 8, 8]]), cells + 1
    path = write(tmp_path / name, beside, cells, point_sets={"foot": np.append(foot + 1, 0)})
    with caplog.at_level(logging.INFO, "exudyn_partition"):
        fem = ep.fe_model(path, ep.STEEL)
    assert f"{path}: left out 2 nodes of no volume element" in caplog.messages
    np.testing.assert_array_equal(fem.points, points)
    np.testing.assert_array_equal(fem.cells, alone.cells)
    assert set(fem.boundaries) == set(alone.boundaries)
    for boundary, facets in alone.boundaries.items():
        np.testing.assert_array_equal(fem.boundaries[boundary], facets)


def test_inverted_and_flat_elements(small, tmp_path):
    path = tmp_path / "mesh.vtu"
    points, cells = hexahedra(1, 1, 4)
    mixed = cells.copy()
    mixed[1:3] = mixed[1:3][:, [4, 5, 6, 7, 0, 1, 2, 3]]
    refused(write(path, points, mixed), r"2 of 4 elements are inverted or have no volume, the first is element 1 ")
    flat = points.copy()
    flat[flat[:, 2] == SIZE[2], 2] = 0.75 * SIZE[2]
    refused(write(path, flat, cells), r"1 of 4 elements .* element 3 \(counted from 0\), a hexahedron of nodes \[3, ")
    bent = np.array(small[2].points)
    bent[small[2].cells[7, 4]] += 0.02
    refused(write(path, bent, small[2].cells), "are inverted or have no volume")


def test_several_parts(tmp_path):
    points, cells = hexahedra(1, 1, 3)
    far, few = hexahedra(1, 1, 2)
    path = write(tmp_path / "mesh.vtu", np.vstack([points, far + 0.1]), np.vstack([few + len(points), cells]))
    refused(path, "expected one connected body, got 2 parts that share no face, of 3, 2 elements. Merge coincident")
    boxes = [box(*SIZE), box(*SIZE).Move(occ.Vec(0.1, 0, 0))]
    two = occ.Glue([one.mat("steel") for one in boxes])
    with pytest.raises(MeshError, match="got 2 parts"):
        ep.fe_model(two, ep.STEEL, maxh=0.02)


def test_parts_that_an_edge_joins_are_a_hinge(tmp_path):
    points, cells = hexahedra(2, 2, 1)
    beside = next(k for k in range(1, 4) if len(np.intersect1d(cells[0], cells[k])) == 2)
    used, numbers = np.unique(cells[[0, beside]], return_inverse=True)
    path = write(tmp_path / "mesh.vtu", points[used], numbers.reshape(2, 8))
    refused(path, "expected one connected body, got 2 parts that share no face, of 1, 1 elements")


TETRAHEDRA = np.array([[0, 1, 2, 3], [0, 2, 1, 4], [0, 1, 2, 5]])
CORNERS = 0.01 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1], [0.3, 0.3, 2.0]])
CORNERS_AND_FAR = np.vstack([CORNERS, CORNERS + 0.1])


def quadratic_bar():
    """Two hexahedra, of which the second has a node of its own on an edge of the face between them."""
    points, ((kind, cells),) = quadratic(*split(*hexahedra(1, 1, 2), ["hexahedron"] * 2))
    shared = np.intersect1d(cells[0, 8:], cells[1, 8:])[0]
    cells[1, cells[1] == shared] = len(points)
    return np.vstack([points, points[shared]]), [(kind, cells)]


@pytest.mark.parametrize(
    ("points", "blocks", "said"),
    [
        (CORNERS_AND_FAR, [("tetra", TETRAHEDRA[[0]] + 6), ("tetra", TETRAHEDRA[:2])],
         r"got 2 parts that share no face, of 2, 1 elements, which begin with element 2 (line 17) and element 1 "
         "(line 15). Merge coincident"),
        (CORNERS_AND_FAR, [("tetra", TETRAHEDRA[:1]), ("tetra10", np.arange(10)[None])],
         "got 1 tetra, 1 tetra10, the first of each order are element 1 (line 15) and element 2 (line 17). Mesh the"),
        (CORNERS, [("tetra", TETRAHEDRA[[0, 1, 1]])],
         "the first are element 2 (line 10) and element 3 (line 11), of the same nodes"),
        (CORNERS, [("tetra", TETRAHEDRA)],
         "the first to element 1 (line 9), element 2 (line 10), element 3 (line 11), so that some of them overlap"),
        (CORNERS, [("tetra", TETRAHEDRA[[0, 2]])],
         "face that they share, the first are element 1 (line 9) and element 2 (line 10). A node lies"),
        (*quadratic_bar(),
         "1 edges have several mid-side nodes, expected one each that all elements on an edge share, the first is one "
         "of element 1 (line 36) and element 2 (line 38). Merge"),
    ],
)  # fmt: skip
def test_decks_of_no_one_body_are_refused_by_their_elements_lines(tmp_path, points, blocks, said):
    path = write_deck(tmp_path / "deck.inp", points, *blocks)
    refused(path, re.escape(said.replace("(line", f"({path}, line")))


def test_mid_side_nodes_that_neighbours_do_not_share(small, tmp_path):
    fem = small[2]
    inner = np.setdiff1d(fem.cells[:, 4:], fem.facets)[0]
    cells = fem.cells.copy()
    element = np.flatnonzero((cells == inner).any(axis=1))[0]
    cells[element, cells[element] == inner] = fem.n_nodes
    path = write(tmp_path / "mesh.vtu", np.vstack([fem.points, fem.points[inner]]), cells)
    refused(path, "mid-side nodes, expected one each that all elements on an edge share. Merge coincident nodes")


@pytest.mark.parametrize("suffix", [".vtu", ".msh", ".inp", ".bdf", ".step", ".unknown"])
def test_missing_and_unreadable_files(tmp_path, suffix, capfd):
    path = tmp_path / f"mesh{suffix}"
    refused(path, "source: expected a file, there is none at .*mesh", error=InputError, maxh=1e-3)
    path.write_text("what is this?\n")
    refused(path, rf"mesh\{suffix}(: expected| could not be read by)", error=InputError, maxh=1e-3)


@pytest.mark.parametrize(
    ("name", "converter"), [("a.k", "LS-PrePost"), ("a.x_t", "STEP"), ("A.DB", "CDWRITE"), ("a.odb", "input deck")]
)
def test_files_that_nobody_reads_name_what_converts_them(tmp_path, name, converter):
    (tmp_path / name).write_text("x")
    refused(tmp_path / name, f"have no reader here, .*{converter}", error=InputError)


def test_what_a_format_needs_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    (tmp_path / "mesh.med").touch()
    with pytest.raises(MissingPackageError, match=r"h5py is needed to read .*pip install h5py"):
        ep.fe_model(tmp_path / "mesh.med", ep.STEEL)


@pytest.mark.parametrize("results", ["many", "partial"])
def test_results_beside_a_mesh_of_med_are_left_out(small, tmp_path, results):
    """As Code_Aster writes them: several fields of different components, some on some kinds of elements alone."""
    h5py, fem = pytest.importorskip("h5py"), small[2]
    skin = fem.facets[:, :3]
    data = {"run_DEPL": np.ones((fem.n_nodes, 3)), "run_TEMP": np.ones(fem.n_nodes)}
    path = tmp_path / "results.med"
    blocks = [("triangle", skin), ("tetra10", fem.cells)]
    cell_data = {"run_SIEF": [np.ones((len(rows), 6)) for _, rows in blocks]}
    cell_data["cell_tags"] = [np.full(len(rows), -1 - i) for i, (_, rows) in enumerate(blocks)]
    file = meshio.Mesh(fem.points, blocks, point_data=data, cell_data=cell_data)
    file.field_data = {"med:nom": [["DX", "DY", "DZ"], ["TEMP"], ["SIXX", "SIYY", "SIZZ", "SIXY", "SIXZ", "SIYZ"]]}
    file.write(path)
    if results == "partial":  # and a family that is 0 is not written
        with h5py.File(path, "a") as written:
            (steps,) = written["ENS_MAA"].values()
            (step,) = steps.values()
            del step["MAI/TR3/FAM"]
            for field in written["CHA"].values():
                for at in field.values():
                    at.pop("MAI.TR3", None)
    assert_same_matrices(ep.fe_model(path, ep.STEEL), fem, np.arange(fem.n_nodes))


@pytest.mark.parametrize(("name", "order", "expected"), [("hexahedron", 3, "1 or 2"), ("tetra10", 1, "2")])
def test_orders_that_the_file_s_elements_do_not_have(small, tmp_path, name, order, expected):
    points, cells = hexahedra(1, 2, 3) if name == "hexahedron" else (small[2].points, small[2].cells)
    path = write(tmp_path / "mesh.vtu", points, cells)
    refused(path, f"holds {name}, expected {expected}, got {order}", error=InputError, order=order)


@pytest.mark.parametrize("kinds", [["hexahedron"], ["wedge"], ["foot", "pyramid", "hexahedron", "hexahedron"]])
def test_linear_elements_of_a_file_are_raised(tmp_path, kinds):
    """They are those of a file with the nodes in the middle of edges."""
    points, cells = hexahedra(1, 1, 4)
    linear = split(points, cells, np.resize(kinds, len(cells)) if len(kinds) == 1 else kinds)
    wanted = quadratic(*linear)
    expected = ep.fe_model(write(tmp_path / "quadratic.vtu", wanted[0], *wanted[1]), ep.STEEL)
    fem = ep.fe_model(write(tmp_path / "linear.vtu", linear[0], *linear[1]), ep.STEEL, order=2)
    assert fem.order == 2
    np.testing.assert_array_equal(fem.points[: len(linear[0])], linear[0])
    np.testing.assert_allclose(fem.points, expected.points)
    assert_same_matrices(fem, expected, np.arange(fem.n_nodes))


def test_what_other_threads_print_while_a_file_is_read_is_not_swallowed(tmp_path, monkeypatch):
    path, out = tmp_path / "block.vtu", io.StringIO()

    def read(_):
        other = threading.Thread(target=lambda: print("from elsewhere", end=""))
        other.start()
        other.join()
        print("of the reader")
        raise RuntimeError

    path.write_text("")
    monkeypatch.setattr(meshio, "read", read)
    monkeypatch.setattr(sys, "stdout", out)
    with pytest.raises(InputError, match="of the reader"):
        ep.fe_model(path, ep.STEEL)
    assert out.getvalue() == "from elsewhere"
