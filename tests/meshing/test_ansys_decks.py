"""Files that Ansys writes by CDWRITE (`.cdb`): the bar of a deck, components, materials, and what is not read."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io
from meshing.test_collapsed import as_hexahedra
from oracles import SIZE, hexahedra, quadratic, split, write_deck

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MeshError

POINTS, CELLS = hexahedra(2, 2, 2)
HIGH = [i for i, cell in enumerate(CELLS, 1) if POINTS[cell, 2].mean() > SIZE[2] / 2]
MATERIAL = """MPTEMP,R5.0, 1, 1,  0.00000000    ,
MPDATA,R5.0, 1,EX  ,       1, 1,  210.000000E+09,
MPDATA,R5.0, 1,PRXY,       1, 1, 0.300000000    ,
MPDATA,R5.0, 1,DENS,       1, 1,  7800.00000    ,
MP,EX,2,70e9
MP,NUXY,2,.33
MP,DENS,2,2700.
"""


def nodes(points, form="(3i9,6e21.13e3)"):
    rows = [f"{i:9}{0:9}{0:9}" + "".join(f"{x:21.13E}" for x in place) for i, place in enumerate(points.tolist(), 1)]
    return "\n".join([f"NBLOCK,6,SOLID,{len(points):10},{len(points):10}", form, *rows, "N,R5.3,LOC,       -1,", ""])


def elements(cells, material=lambda i: 1, number=1, width=10, first=1):
    rows = []
    for i, cell in enumerate((cells + 1).tolist(), first):
        values = [material(i), number, 1, 1, 0, 0, 0, 0, len(cell), 0, i, *cell]
        rows += ["".join(f"{v:{width}}" for v in part) for part in (values[:19], values[19:]) if part]
    return "\n".join([f"EBLOCK,19,SOLID,{len(cells):10},{len(cells):10}", f"(19i{width})", *rows, f"{-1:{width}}", ""])


def component(name, kind, numbers):
    rows = ["".join(f"{n:10}" for n in numbers[i : i + 8]) for i in range(0, len(numbers), 8)]
    return "\n".join([f"CMBLOCK,{name:8},{kind},{len(numbers):8}  ! of a user", "(8i10)", *rows, ""])


BAR = "/PREP7\nET,        1,185\n" + nodes(POINTS) + elements(CELLS)


@pytest.mark.parametrize("kind", ["hexahedron", "wedge", "foot"])
@pytest.mark.parametrize(("order", "solid"), [(1, 185), (1, 45), (2, "SOLID186")])
def test_a_bar_is_that_of_a_deck(tmp_path, kind, order, solid):
    """Wedges, pyramids and tetrahedra are hexahedra whose corners have fallen together."""
    above = "pyramid" if kind == "foot" else kind
    points, blocks = split(POINTS, CELLS, [kind if POINTS[cell, 2].min() == 0 else above for cell in CELLS])
    points, blocks = quadratic(points, blocks) if order == 2 else (points, blocks)
    expected = ep.fe_model(write_deck(tmp_path / "bar.inp", points, *blocks), ep.STEEL, order=order)
    path = tmp_path / "bar.cdb"
    ((_, cells),) = as_hexahedra(blocks, order)
    path.write_text(f"/PREP7\nET,1,{solid}\n" + nodes(points) + elements(cells))
    fem = ep.fe_model(path, ep.STEEL, order=order)
    np.testing.assert_allclose(fem.points, expected.points, atol=1e-15)
    assert fem.total_mass == pytest.approx(expected.total_mass, rel=1e-9)
    assert abs(fem.mass - expected.mass).max() < 1e-9 * abs(expected.mass).max()
    assert abs(fem.stiffness - expected.stiffness).max() < 1e-9 * abs(expected.stiffness).max()


def test_tetrahedra_without_middles(tmp_path):
    """Ansys writes those that a mesher left out as missing: they lie in the middle of edges."""
    ring = [1, 2, 3, 7, 4, 5, 1]
    cells = np.vstack([CELLS[:, [0, ring[i], ring[i + 1], 6]] for i in range(6)])
    path = tmp_path / "bar.cdb"
    path.write_text("ET,2,187\n" + nodes(POINTS) + elements(cells, number=2, width=9))
    fem = ep.fe_model(path, ep.STEEL)
    assert (fem.order, len(fem.cells)) == (2, 6 * len(CELLS))
    assert fem.total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-12)
    path.write_text(path.read_text().replace("187", "285"))
    assert ep.fe_model(path, ep.STEEL, order=1).n_nodes == len(POINTS)


def test_components_and_materials_of_the_file(tmp_path):
    foot = np.flatnonzero(POINTS[:, 2] == 0) + 1  # every third node
    path = tmp_path / "bar.cdb"
    parts = component("FOOT", "NODE", foot.tolist()) + component("HIGH", "ELEM", [HIGH[0], *HIGH[1:]])
    two = elements(CELLS, lambda i: 1 + (i in HIGH))
    path.write_text("ET,1,185\n" + nodes(POINTS) + two + parts + MATERIAL)
    fem = ep.fe_model(path, order=1)
    assert fem.total_mass == pytest.approx((7800 + 2700) / 2 * SIZE.prod(), rel=1e-12)
    assert abs(fem.points[fem.facets[fem.boundaries["FOOT"]], 2]).max() == 0
    half = ep.fe_model(path, solid="HIGH", order=1)
    assert (half.material.E, half.material.rho) == (70e9, 2700)
    assert half.total_mass == pytest.approx(2700 / 2 * SIZE.prod(), rel=1e-12)
    path.write_text(BAR + component("LOW", "ELEM", [1, -2, 5, -6]) + MATERIAL)  # ranges
    assert len(ep.read_bodies(path).rows("LOW")) == 4
    assert ep.fe_model(path, order=1).material.E == 210e9


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("/PREP7\nET,1,185\n", InputError, "expected a file of CDWRITE with a block of nodes"),
        (
            BAR.replace(",185", ",21"),
            MeshError,
            r"line \d+: element 1 is of type 21, expected solids of 45, .*only_sol",
        ),
        (BAR.replace("(19i10)", "(what)"), MeshError, r"line \d+: expected the format of the block in the next line"),
        (BAR.replace("(3i9", "(3i5"), MeshError, r"line \d+: expected a (whole )?number, got"),
        (BAR.replace(f"{-1:10}\n", "") + "x", MeshError, "expected a whole number, got 'x'"),
        (BAR + "MP,EX,1,210e9\nMP,EY,1,70e9\n", InputError, "is orthotropic, expected EX"),
        (BAR + "MPDATA,R5.0,2,EX,1,1,210e9,200e9\n", InputError, "given EX by temperature, expected one value"),
        (BAR, InputError, "'1' .* has no modulus and no Poisson's ratio and no density"),
    ],
)
def test_what_is_not_read_is_named(tmp_path, text, error, message):
    path = tmp_path / "bar.cdb"
    path.write_text(text)
    with pytest.raises(error, match=message):
        ep.fe_model(path, order=1)


def test_other_elements_beside_solids(tmp_path):
    contact, mass = (elements(CELLS[:1, :4], number=2, first=100) for _ in range(2))
    path = tmp_path / "bar.cdb"
    path.write_text("ET,2,CONTA174\n" + BAR + contact)
    assert ep.fe_model(path, ep.STEEL, order=1).n_nodes == len(POINTS)
    path.write_text("ET,2,MASS21\n" + BAR + mass)
    with pytest.raises(MeshError, match="element 100 is of type 21"):
        ep.fe_model(path, ep.STEEL, order=1)
    assert ep.fe_model(path, ep.STEEL, only_solids=True, order=1).n_nodes == len(POINTS)


def test_matrices_of_another_program_go_with_the_nodes_of_the_file(tmp_path):
    path = tmp_path / "bar.cdb"
    path.write_text(BAR + MATERIAL)
    own = ep.fe_model(path, order=1)
    scipy.io.mmwrite(tmp_path / "K.mtx", own.stiffness)
    scipy.io.mmwrite(tmp_path / "M.mtx", own.mass)
    fem = ep.read_matrices(tmp_path / "K.mtx", tmp_path / "M.mtx").fe_model(path)
    np.testing.assert_array_equal(fem.points, own.points)
    assert abs(fem.stiffness - own.stiffness).max() <= 1e-12 * abs(own.stiffness).max()


def test_files_that_ansys_wrote():
    examples = pytest.importorskip("ansys.mapdl.reader.examples")
    folder = Path(examples.__file__).parent
    fem = ep.fe_model(folder / "HexBeam.cdb", ep.STEEL, scale=1e-2)  # 1 x 1 x 5
    assert (fem.n_nodes, len(fem.cells)) == (321, 40)
    assert fem.cell_volume.sum() == pytest.approx(5 * 1e-6, rel=1e-12)
