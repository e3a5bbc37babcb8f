"""Materials of input decks, and what is left out beside solid elements."""

import logging

import numpy as np
import pytest
from oracles import SIZE, hexahedra, split, write_deck

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MeshError

STEEL = ["*MATERIAL, NAME=Steel", "*ELASTIC", "2.1e11, 0.3", "*DENSITY", "7800.,"]
SECTION = ["*SOLID SECTION, ELSET=body, MATERIAL=STEEL"]


def deck(folder, *more, points=None):
    """The block as hexahedra, with more lines."""
    places, cells = hexahedra(2, 3, 4)
    return write_deck(folder / "block.inp", places if points is None else points, ("hexahedron", cells), more=more)


def test_the_material_of_a_deck_is_the_default_and_is_told(tmp_path, caplog):
    path = deck(tmp_path, *STEEL, *SECTION)
    with caplog.at_level(logging.INFO, "exudyn_partition"):
        fem = ep.fe_model(path)
    assert fem.material == ep.Material(E=2.1e11, nu=0.3, rho=7800.0)
    assert "material 'Steel' has E=2.1e+11, nu=0.3 and rho=7800, taken as SI units" in caplog.text
    given = ep.fe_model(path, ep.ALUMINIUM)
    assert given.material == ep.ALUMINIUM


def test_a_deck_in_millimetres(tmp_path, caplog):
    """t, mm and s; kg, mm and ms; and what is told of them."""
    points = 1e3 * hexahedra(2, 3, 4)[0]
    for E, rho in ((2.1e5, 7.8e-9), (210.0, 7.8e-6), (2.1e8, 7.8e-6), (2.1e5, 7.8e-3)):
        lines = ["*MATERIAL, NAME=STEEL", "*DENSITY", f"{rho}", "*ELASTIC, TYPE=ISOTROPIC", f"{E}, 0.3", *SECTION]
        path = deck(tmp_path, *lines, points=points)
        fem = ep.fe_model(path, scale=1e-3)
        assert fem.total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-12)
        assert fem.material.E == pytest.approx(2.1e11, rel=1e-12)
    path = deck(tmp_path, "*MATERIAL, NAME=STEEL", "*ELASTIC", "2.1e5, 0.3", "*DENSITY", "7.8e-9", points=points)
    with caplog.at_level(logging.INFO, "exudyn_partition"):
        fem = ep.fe_model(path)  # no section, but one material
    assert "taken as units of millimetres" in caplog.text
    assert fem.total_mass == pytest.approx(7.8e-9 * 1e9 * SIZE.prod(), rel=1e-12)
    with pytest.raises(InputError, match=r"With scale=0[.]0254 they are not converted"):
        ep.fe_model(path, scale=0.0254)


def test_a_material_for_each_section(tmp_path):
    lines = [*STEEL, "*MATERIAL, NAME=soft", "*ELASTIC", "7e10, 0.33", "*DENSITY", "2700."]
    lines += ["*ELSET, ELSET=low, GENERATE", "1, 12", "*ELSET, ELSET=high, GENERATE", "13, 24"]
    lines += ["*SOLID SECTION, ELSET=low, MATERIAL=steel", "*SOLID SECTION, ELSET=high, MATERIAL=SOFT"]
    fem = ep.fe_model(deck(tmp_path, *lines))
    assert set(fem.regions.E) == {2.1e11, 7e10}
    assert fem.total_mass == pytest.approx((7800 + 2700) / 2 * SIZE.prod(), rel=1e-12)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([], "has none for 'body'. Give material= of fe_model, such as ep.STEEL"),
        (SECTION, "has none for 'STEEL'"),
        ([*STEEL[:3], *SECTION], "'Steel' .*line [0-9]+.* has no density in the deck"),
        ([STEEL[0], *STEEL[3:], *SECTION], "has no modulus and no Poisson's ratio in the deck"),
        ([STEEL[0], "*ELASTIC, TYPE=ENGINEERING CONSTANTS", "1, 2, 3", *STEEL[3:], *SECTION], "expected ISOTROPIC"),
        (
            [STEEL[0], "*HYPERELASTIC, NEO HOOKE", "1e6, 1e-9", *STEEL[3:], *SECTION],
            r"'Steel' .*line [0-9]+.* is hyperelastic \(\*HYPERELASTIC, NEO HOOKE\), expected \*ELASTIC",
        ),
        (
            [STEEL[0], "*User Material, CONSTANTS=1", "1.", *STEEL[3:], *SECTION],
            r"a user's material \(\*USER MATERIAL\)",
        ),
        ([*STEEL[:3], "1.9e11, 0.3, 500.", *STEEL[3:], *SECTION], "elastic by temperature, expected one line"),
    ],
)
def test_what_a_deck_does_not_say_is_named(tmp_path, lines, said):
    with pytest.raises(InputError, match=f"material: .*{said}"):
        ep.fe_model(deck(tmp_path, *lines))


def test_other_sources_have_no_material(tmp_path):
    path = tmp_path / "mesh.vtu"
    path.write_text("")
    with pytest.raises(InputError, match=r"material: expected an ep.Material, such as ep.STEEL, got None"):
        ep.fe_model(path)


NASTRAN = ["MAT1,1,2.1+11,,0.3,7800.", "MAT1,2,7.0+10,2.63158+10,,2700.", "PSOLID,5,1", "PSOLID,6,2"]


def bulk(path, *cards, properties=(5, 5)):
    points, cells = hexahedra(1, 1, 2)
    lines = [f"GRID,{i},,{x!r},{y!r},{z!r}" for i, (x, y, z) in enumerate(points.tolist(), 1)]
    for number, (row, own) in enumerate(zip(cells + 1, properties, strict=True), 1):
        lines.append(f"CHEXA,{number},{own}," + ",".join(map(str, row[:6])) + ",+\n+," + ",".join(map(str, row[6:])))
    path.write_text("\n".join(["BEGIN BULK", *lines, *cards, "ENDDATA", ""]))
    return path


def test_materials_of_nastran(tmp_path):
    fem = ep.fe_model(bulk(tmp_path / "one.bdf", *NASTRAN))
    assert fem.material == ep.Material(E=2.1e11, nu=0.3, rho=7800.0)
    both = ep.fe_model(bulk(tmp_path / "two.bdf", *NASTRAN, properties=(5, 6)))
    assert set(both.regions.E) == {2.1e11, 7e10}
    np.testing.assert_allclose(sorted(m.nu for m in both.regions.materials), [0.3, 0.33], rtol=1e-4)
    scaled = ep.fe_model(bulk(tmp_path / "scaled.bdf", *NASTRAN, "PARAM,WTMASS,0.5"))
    assert scaled.material.rho == 3900
    with pytest.raises(InputError, match=r"material: .* has none"):
        ep.fe_model(bulk(tmp_path / "none.bdf"))


@pytest.mark.parametrize(
    ("card", "said"),
    [
        ("MAT9,1,1.+9,0.,0.,0.,0.,0.,1.+9", "'MAT9 1' .*line [0-9]+.* is anisotropic, expected MAT1"),
        ("MAT11,1,1.+9,1.+9,1.+9,.3,.3,.3,1.+8", "'MAT11 1' .* is orthotropic"),
        ("MATHP,1,1.+6,0.,1.+9", "'MATHP 1' .* is hyperelastic"),
    ],
)
def test_materials_of_nastran_that_are_not_isotropic_are_named(tmp_path, card, said):
    with pytest.raises(InputError, match=f"material: {said}.*Give material= of fe_model"):
        ep.fe_model(bulk(tmp_path / "one.bdf", card, "PSOLID,5,1"))
    assert ep.fe_model(bulk(tmp_path / "given.bdf", card, "PSOLID,5,1"), ep.STEEL).material == ep.STEEL


OTHERS = ["*ELEMENT, TYPE=S4, ELSET=skin", "101, 1, 6, 26, 21", "*SHELL SECTION, ELSET=skin, MATERIAL=STEEL", "0.001,",
          "*ELEMENT, TYPE=MASS, ELSET=point", "102, 1", "*MASS, ELSET=point", "5.,", "*ELEMENT, TYPE=SPRINGA, ELSET=s",
          "103, 1, 2", "*SPRING, ELSET=s", "", "1e5,"]  # fmt: skip


def test_only_solids_leaves_out_the_rest_by_name(tmp_path, caplog):
    alone = ep.fe_model(deck(tmp_path, *STEEL, *SECTION))
    path = deck(tmp_path, *OTHERS, *STEEL, *SECTION)
    with pytest.raises(MeshError, match="Give only_solids=True to leave them out, and put"):
        ep.fe_model(path)
    with caplog.at_level(logging.INFO, "exudyn_partition"):
        fem = ep.fe_model(path, only_solids=True)
    assert "left out 1 MASS, 1 SPRINGA, *SHELL SECTION, *MASS, *SPRING" in caplog.text
    assert abs(fem.stiffness - alone.stiffness).max() == 0
    assert len(fem.boundaries["skin"]) == 1
    with pytest.raises(InputError, match="only_solids: has no effect here"):
        ep.fe_model(tmp_path / "mesh.vtu", ep.STEEL, only_solids=True)


def test_only_solids_of_nastran(tmp_path, caplog):
    cards = ["CONM2,50,1,,3.", "PSHELL,9,1,0.001", "CQUAD4,51,9,1,2,4,3", "CBUSH,52,3,1,2"]
    path = bulk(tmp_path / "others.bdf", *NASTRAN, *cards)
    with pytest.raises(MeshError, match="Give only_solids=True to leave them out"):
        ep.fe_model(path)
    with caplog.at_level(logging.INFO, "exudyn_partition"):
        fem = ep.fe_model(path, only_solids=True)
    assert "left out 1 CBUSH, 1 CONM2, 1 CQUAD4, which are no solid elements" in caplog.text
    assert fem.total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-12)


def test_plane_elements_of_a_solid_section_are_left_out_too(tmp_path):
    points, cells = hexahedra(1, 1, 2)
    blocks = split(points, cells, ["hexahedron", "hexahedron"])[1]
    lines = ["*ELEMENT, TYPE=CPS4, ELSET=body", "11, 1, 2, 4, 3", *STEEL, *SECTION]
    path = write_deck(tmp_path / "plane.inp", points, *blocks, more=lines)
    with pytest.raises(MeshError, match=r"got 1 others of a .SOLID SECTION"):
        ep.fe_model(path)
    assert len(ep.fe_model(path, only_solids=True).cells) == 2
