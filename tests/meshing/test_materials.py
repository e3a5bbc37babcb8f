"""Bodies of several materials, or of a modulus that differs from place to place."""

import dataclasses

import meshio
import netgen.occ as occ
import numpy as np
import pytest
import scipy.optimize
import scipy.sparse.linalg as sla
from meshing.test_abaqus_decks import SECTIONS, SETS, deck
from meshing.test_regions import CELLS, POINTS, glued

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MeshError
from exudyn_partition.fe.material import Regions
from exudyn_partition.meshing.ngsolve_fem import surplus_of

# Without Poisson's effect a bar is one-dimensional.
HARD = ep.Material(E=200e9, nu=0.0, rho=8000.0, yield_stress=400e6)
SOFT = ep.Material(E=20e9, nu=0.0, rho=2000.0, yield_stress=50e6)
BOTH = {"hard": HARD, "soft": SOFT}
SIDE = 0.01


@pytest.fixture(scope="module")
def pair():
    """Two cubes side by side along x, hard and soft."""
    return ep.fe_model(glued("hard", "soft"), BOTH, maxh=5e-3)


def first_frequency(fem, near):
    """Lowest frequency above the six rigid ones whose motion is along x [Hz]."""
    omega2, modes = sla.eigsh(fem.stiffness, k=20, M=fem.mass, sigma=-((2 * np.pi * near) ** 2) / 100)
    along = np.linalg.norm(modes[::3], axis=0) > 0.98 * np.linalg.norm(modes, axis=0)
    return np.sqrt(omega2[along & (omega2 > (2 * np.pi * near / 10) ** 2)].min()) / (2 * np.pi)


def test_a_bar_of_two_materials_vibrates_as_the_exact_one():
    boxes = [occ.Box((0.1 * i, 0, 0), (0.1 * (i + 1), 4e-3, 4e-3)).mat(name) for i, name in enumerate(BOTH)]
    bar = ep.fe_model(occ.Glue(boxes), BOTH, maxh=8e-3)

    def free_ends(omega):
        """Of both halves: Z tan(k L), with Z = sqrt(E rho)."""
        return sum(np.sqrt(m.E * m.rho) * np.tan(0.1 * omega / m.bar_wave_speed) for m in BOTH.values())

    quarter = np.pi / 2 * SOFT.bar_wave_speed / 0.1  # the soft half against a wall
    exact = scipy.optimize.brentq(free_ends, 1.001 * quarter, 1.5 * quarter) / (2 * np.pi)
    assert first_frequency(bar, exact) == pytest.approx(exact, rel=1e-3)


def test_a_pulled_bar_has_one_stress_and_two_strains(pair):
    x, stress = pair.points[:, 0], 1e6
    strain = {name: stress / material.E for name, material in BOTH.items()}
    u = np.zeros_like(pair.points)
    u[:, 0] = np.minimum(x, SIDE) * strain["hard"] + np.maximum(x - SIDE, 0) * strain["soft"]
    inside = np.flatnonzero((x > 1e-9) & (x < 2 * SIDE - 1e-9))
    force = (pair.stiffness @ u.ravel()).reshape(-1, 3)
    assert abs(force[inside]).max() < 1e-9 * stress * SIDE**2
    assert force[x < 1e-9, 0].sum() == pytest.approx(-stress * SIDE**2)
    places = [[0.004, 0.004, 0.006], [0.016, 0.006, 0.004]]
    expected = np.r_[stress, np.zeros(5)]
    np.testing.assert_allclose(
        (ep.recovery.stress_rows(pair, places) @ u.ravel()).reshape(2, 6), [expected] * 2, atol=1e-3
    )
    np.testing.assert_allclose(ep.recovery.nodal_stress(pair, u), np.tile(expected, (pair.n_nodes, 1)), atol=1e-3)
    assert (ep.recovery.strain_rows(pair, places) @ u.ravel())[::6] == pytest.approx([*strain.values()])


def test_a_modulus_by_place_is_that_of_materials_which_differ_in_nothing_else(pair):
    soft = dataclasses.replace(HARD, E=SOFT.E)
    mesh = ep.generate_mesh(glued("hard", "soft"), maxh=5e-3)
    two = ep.fe_model(mesh, {"hard": HARD, "soft": soft})
    graded = ep.fe_model(
        ep.generate_mesh(glued("one", "one"), maxh=5e-3),
        HARD,
        modulus=lambda x: np.where(x[:, 0] < SIDE, HARD.E, SOFT.E),
    )
    assert abs(two.stiffness - graded.stiffness).max() < 1e-12 * abs(two.stiffness).max()
    assert abs(two.mass - graded.mass).max() < 1e-12 * abs(two.mass).max()
    assert graded.material.E == pytest.approx((HARD.E + SOFT.E) / 2, rel=1e-9)


def test_one_region_by_name_is_the_plain_model():
    mesh = ep.generate_mesh(glued("hard"), maxh=8e-3)
    one, plain = ep.fe_model(mesh, {"hard": HARD}), ep.fe_model(mesh, HARD)
    assert abs(one.stiffness - plain.stiffness).max() < 1e-14 * abs(plain.stiffness).max()
    assert one.material == plain.material
    assert one.resolved_frequency == pytest.approx(plain.resolved_frequency)


def test_means_of_one_modulus_are_that_modulus():
    """Whatever the volumes of elements are: bodies compare their materials."""
    material, rng = dataclasses.replace(HARD, E=2.1e11 / 3), np.random.default_rng(0)
    for n in range(1, 200):
        regions = Regions(("all",), (material,), np.zeros(n, dtype=int), np.full(n, material.E))
        assert regions.largest(rng.uniform(1e-12, 1e-9, n)) == material
        assert regions.of_cells(np.arange(n)) == material


def test_the_slower_material_limits_the_frequency(pair):
    hard, soft = (
        ep.fe_model(ep.generate_mesh(glued("one", "one"), maxh=5e-3), material).resolved_frequency
        for material in (HARD, SOFT)
    )
    assert soft <= pair.resolved_frequency < hard


@pytest.mark.parametrize(("side", "material"), [(0.0, HARD), (2 * SIDE, SOFT)])
def test_a_patch_knows_the_material_beneath_it(pair, side, material, tmp_path):
    part = ep.Partition.ball(pair, (side, SIDE / 2, SIDE / 2), 4e-3)
    assert part.patches[0].material == material
    body = ep.reduce(pair, part, f_cut=10e3)
    body.save(tmp_path / "body.npz")
    assert ep.load_body(tmp_path / "body.npz").partition.patches[0].material == material


def test_a_patch_over_both_materials_yields_as_the_weaker_one(pair):
    part = ep.Partition.ball(pair, (SIDE, SIDE / 2, SIDE), 6e-3)
    assert part.patches[0].material.yield_stress == SOFT.yield_stress


def test_a_zone_yields_by_its_own_material():
    plastic = dataclasses.replace(SOFT, hardening=0.0)
    fem = ep.fe_model(glued("hard", "soft"), {"hard": HARD, "soft": plastic}, maxh=5e-3)
    ends = [ep.Partition.ball(fem, (x, SIDE / 2, SIDE / 2), 5e-3) for x in (0.0, 2 * SIDE)]
    assert ends[0].patches[0].plastic is None
    assert ends[1].patches[0].plastic is not None
    with pytest.raises(InputError, match="expected elements of one material within"):
        ep.Partition.ball(fem, (2 * SIDE, SIDE / 2, SIDE / 2), 5e-3, plastic_radius=0.02)
    with pytest.raises(InputError, match="'everywhere' expects a body of one material"):
        ep.reference.FullBody(fem, ends[1], plastic="everywhere")


def test_surplus_functions_know_the_regions(pair):
    soft, hard = (surplus_of(ep.fe_model(glued("one", "one"), one, maxh=5e-3)) for one in (SOFT, HARD))
    both = surplus_of(pair)
    total = [surplus.stiffness.trace() for surplus in (soft, both, hard)]
    assert total[0] < total[1] < total[2]


MASS = (HARD.rho + SOFT.rho) * 1e-6


@pytest.mark.parametrize(
    ("name", "file_format", "data", "names"),
    [
        ("m.vtu", None, "material", ("1", "2")),
        ("m.msh", "gmsh22", "gmsh:physical", ("steel", "foam")),
        ("m.bdf", None, "nastran:ref", ("1", "2")),
    ],
)
def test_regions_of_files(tmp_path, name, file_format, data, names):
    cell_data = {data: [np.array([1, 2])]}
    if data.startswith("gmsh"):
        cell_data["gmsh:geometrical"] = [np.array([0, 0])]
    fields = {"steel": np.array([1, 3]), "foam": np.array([2, 3])} if file_format else {}
    mesh = meshio.Mesh(POINTS, [("hexahedron", CELLS)], cell_data=cell_data, field_data=fields)
    meshio.write(tmp_path / name, mesh, file_format=file_format)
    fem = ep.fe_model(tmp_path / name, dict(zip(names, (HARD, SOFT), strict=True)))
    assert fem.cell_mass == pytest.approx([HARD.rho * 1e-6, SOFT.rho * 1e-6])
    assert fem.centre_of_mass[2] == pytest.approx((HARD.rho * 0.5 + SOFT.rho * 1.5) / (HARD.rho + SOFT.rho) * 0.01)


@pytest.mark.parametrize(("after", "names"), [(SECTIONS.format("foam"), ("steel", "foam")), ("", ("a", "b"))])
def test_sections_of_abaqus(tmp_path, after, names):
    (tmp_path / "deck.inp").write_text(deck(elements=SETS, after=after))
    fem = ep.fe_model(tmp_path / "deck.inp", dict(zip(names, (HARD, SOFT), strict=True)))
    assert fem.cell_mass == pytest.approx([HARD.rho * 1e-6, SOFT.rho * 1e-6])


def test_elements_without_a_section(tmp_path):
    (tmp_path / "deck.inp").write_text(deck(elements=SETS, after="*SOLID SECTION, ELSET=a, MATERIAL=steel\n,"))
    with pytest.raises(
        MeshError, match=r"1 of 2 .* in no \*SOLID SECTION, the first is element 2 \(.*, line 17\); exp"
    ):
        ep.fe_model(tmp_path / "deck.inp", {"steel": HARD})


@pytest.mark.parametrize(
    ("material", "message"),
    [
        ({"hard": HARD}, "each region of shape, 'hard', 'soft', got 'hard'"),
        ({**BOTH, "more": HARD}, "got 'hard', 'soft', 'more'"),
        ({"hard": HARD, "soft": 1.0}, "one ep.Material for each name of a region, got float"),
        ({}, "got an empty dict"),
    ],
)
def test_names_that_do_not_fit(material, message):
    with pytest.raises(InputError, match=message):
        ep.fe_model(glued("hard", "soft"), material, maxh=0.01)


@pytest.mark.parametrize(
    ("modulus", "message"),
    [
        (lambda x: -np.ones(len(x)), "modulus: expected positive"),
        (lambda x: np.ones(3), "modulus: expected shape"),
        (lambda x: x.no, "modulus: expected a function of places.*raises AttributeError"),
        (200e9, "modulus: expected a function of places"),
    ],
)
def test_moduli_that_are_none(modulus, message):
    with pytest.raises(InputError, match=message):
        ep.fe_model(glued("hard"), HARD, maxh=0.01, modulus=modulus)
