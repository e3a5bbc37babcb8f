"""Bodies of hexahedra, wedges, pyramids and mixed elements: matrices, frequencies, recovery, contact and files."""

import re

import exudyn as exu
import meshio
import numpy as np
import pytest
from oracles import SIZE, TOP, box, hexahedra, quadratic, split, write, write_deck

import exudyn_partition as ep
from exudyn_partition.algebra.krylov import eigenmodes, mass_normalised
from exudyn_partition.errors import InputError, MeshError, MeshQualityWarning
from exudyn_partition.fe.elements import BY_NAME
from exudyn_partition.support.once import once

KINDS = ("hexahedron", "wedge", "pyramid", "mixed")


def kinds_along(points, cells, kind):
    """Kind of each hexahedron; mixed: upright wedges beside hexahedra on pyramids on tetrahedra."""
    if kind != "mixed":
        return [kind] * len(cells)
    _, y, z = (points[cells].mean(axis=1) / SIZE).T
    chosen = [y < 0, z > 0.6, points[cells][:, 0, 2] > 0]
    return np.select(chosen, ["wedge", "hexahedron", "pyramid"], "foot").tolist()


def moved(points, by):
    """Points with those inside the box moved at random, by a share of the box."""
    inside = (abs(points[:, :2]) < 0.499 * SIZE[:2]).all(axis=1) & (abs(points[:, 2] / SIZE[2] - 0.5) < 0.499)
    shift = np.random.default_rng(0).uniform(-1, 1, points.shape) * by * SIZE
    return points + np.where(inside[:, None], shift, 0.0)


def blocks_of(kind, n=(3, 3, 6), order=2, by=0.03):
    points, cells = hexahedra(*n)
    found = split(moved(points, by), cells, kinds_along(points, cells, kind))
    return quadratic(*found) if order == 2 else found


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    folder, known = tmp_path_factory.mktemp("mixed"), {}

    def model(kind, *args, **options):
        key = (kind, args, *sorted(options.items()))
        if key not in known:
            points, blocks = blocks_of(kind, *args, **options)
            known[key] = ep.fe_model(
                write_deck(folder / "mesh.inp", points, *blocks), ep.STEEL, order=BY_NAME[blocks[0][0]].order
            )
        return known[key]

    return model


def frequencies(fem, f_max):
    modes = eigenmodes(fem.stiffness, fem.mass, mass_normalised(fem.rigid_modes, fem.mass), 2 * np.pi * f_max)
    return modes.omega / (2 * np.pi)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_volume_patch_test_and_rigid_motion(models, kind, order):
    fem = models(kind, order=order)
    assert fem.order == order
    assert fem.cell_volume.sum() == pytest.approx(SIZE.prod(), rel=2e-14)
    assert fem.mass.sum() / 3 == pytest.approx(ep.STEEL.rho * SIZE.prod(), rel=1e-13)
    assert fem.lumped_mass.sum() == pytest.approx(fem.total_mass, rel=1e-12)
    uniform = np.array([[0.3, 0.1, -0.2], [0.5, -0.4, 0.2], [0.1, 0.6, 0.2]])
    forces = (fem.stiffness @ (fem.points @ uniform.T).ravel()).reshape(-1, 3)
    inside = np.setdiff1d(np.arange(fem.n_nodes), fem.facets)
    assert len(inside) > 5
    assert abs(forces[inside]).max() < 1e-9 * abs(forces).max()
    assert abs(fem.stiffness @ fem.rigid_modes).max() < 1e-13 * abs(fem.stiffness).max()


@pytest.mark.parametrize("name", ["hexahedron20", "wedge15"])
def test_matrices_are_those_of_the_element_s_own_functions(models, name):
    """Integrated here with the functions of `fe.elements`, at more points; straight elements of right angles."""
    fem = models({"hexahedron20": "hexahedron", "wedge15": "wedge"}[name], (1, 1, 2), by=0.0)
    kind = BY_NAME[name]
    x, w = np.polynomial.legendre.leggauss(4)
    r, s, t = (grid.ravel() for grid in np.meshgrid(*[(x + 1) / 2] * 3, indexing="ij"))
    weight = np.einsum("i,j,k->ijk", w, w, w).ravel() / 8
    if name == "wedge15":
        weight, s = weight * (1 - r), s * (1 - r)
    values, slopes = kind.functions(np.column_stack([r, s, t]))
    lame, shear = ep.STEEL.lame, ep.STEEL.shear_modulus
    stiffness, mass = np.zeros((fem.n_dofs,) * 2), np.zeros((fem.n_nodes,) * 2)
    for row in fem.cells[:, kind.columns]:
        jacobian = np.einsum("kx,qkd->qxd", fem.points[row], slopes)
        gradient = slopes @ np.linalg.inv(jacobian)
        volume = weight * np.linalg.det(jacobian)
        products = np.einsum("q,qia,qjb->iajb", volume, gradient, gradient)
        own = lame * products + shear * products.transpose(0, 3, 2, 1)
        own += shear * np.einsum("iaja,xy->ixjy", products, np.eye(3))
        dofs = (3 * row[:, None] + np.arange(3)).ravel()
        stiffness[np.ix_(dofs, dofs)] += own.reshape(len(dofs), -1)
        mass[np.ix_(row, row)] += ep.STEEL.rho * np.einsum("q,qi,qj->ij", volume, values, values)
    np.testing.assert_allclose(fem.stiffness.toarray(), stiffness, atol=1e-12 * abs(stiffness).max())
    np.testing.assert_allclose(fem.mass[::3, ::3].toarray(), mass, atol=1e-12 * abs(mass).max())


@pytest.mark.parametrize("name", BY_NAME)
def test_the_mass_of_one_tapered_and_bent_element_is_exact(tmp_path, name):
    """By enough of Gauss' points on the element as a cube that has collapsed, on which it is smooth."""
    kind, way = BY_NAME[name], np.random.default_rng(4)
    x = kind.nodes + 0.05 * way.uniform(-1, 1, kind.nodes.shape)
    x[: kind.corners, :2] *= 1 - 0.6 * kind.nodes[: kind.corners, 2:]  # half as wide at its top
    x[kind.corners :] = x[kind.edges].mean(axis=1)[: len(x) - kind.corners]
    x[kind.corners :] += 0.08 * way.uniform(-1, 1, (len(x) - kind.corners, 3))
    x *= 0.1
    local, weight = kind.gauss(12)
    values, slopes = kind.functions(local)
    volume = weight * np.linalg.det(np.einsum("qnr,nd->qrd", slopes, x))
    assert volume.min() > 0
    fem = ep.fe_model(write(tmp_path / "one.vtu", x, (name, np.arange(len(x))[None])), ep.STEEL, order=kind.order)
    mass = fem.mass[::3, ::3].toarray() / ep.STEEL.rho
    wrong = mass - np.einsum("q,qa,qb->ab", volume, values, values)
    assert abs(wrong).max() < 1e-13 * abs(mass).max()


@pytest.mark.parametrize("top", [0.6, 0.05])
@pytest.mark.parametrize(("name", "foot"), [("hexahedron", 1 / 3), ("wedge", 1 / 12)])
def test_a_tapered_column_of_one_element_is_no_overlap(tmp_path, name, foot, top):
    """A slice at height z is the foot times s(z); its second moment is that of the foot, times s^4."""
    x = 0.1 * BY_NAME[name].nodes
    x[:, :2] *= 1 - 10 * (1 - top) * x[:, 2:]
    fem = ep.fe_model(write(tmp_path / "one.vtu", x, (name, np.arange(len(x))[None])), ep.STEEL, order=1)
    z, w = np.polynomial.legendre.leggauss(6)
    exact = 0.1**5 * foot * w @ (1 - (1 - top) * (z + 1) / 2) ** 4 / 2
    found = fem.points[:, 0] @ (fem.mass[::3, ::3] @ fem.points[:, 0])
    assert found / ep.STEEL.rho == pytest.approx(exact, rel=1e-12)


@pytest.fixture(scope="module")
def exact():
    """Frequencies of the block by cubic tetrahedra, right to some 1e-5."""
    return frequencies(ep.fe_model(box(*SIZE), ep.STEEL, order=3, maxh=4e-3), 9e4)[:4]


@pytest.mark.parametrize("kind", KINDS)
def test_frequencies_converge_with_the_fourth_power_of_the_size(models, exact, kind):
    errors = [frequencies(models(kind, n, by=0.0), 11e4)[:4] / exact - 1 for n in ((2, 4, 4), (3, 6, 6))]
    assert errors[1].min() > 0  # Rayleigh
    assert errors[1].max() < 4e-3
    assert (np.log(errors[0] / errors[1]) / np.log(1.5) > 3.2).all()


@pytest.mark.parametrize("kind", KINDS)
def test_recovery_of_a_uniform_strain(models, kind):
    fem = models(kind)
    gradient = 1e-4 * np.array([[1.0, 0.5, -0.2], [0.3, -0.4, 0.2], [0.1, 0.6, 0.7]])
    displacement = fem.points @ gradient.T
    strain = (gradient + gradient.T) / 2
    voigt = [*strain.diagonal(), *2 * strain[[1, 0, 0], [2, 2, 1]]]
    found = ep.recovery.nodal_strain(fem, displacement)
    np.testing.assert_allclose(found, np.tile(voigt, (fem.n_nodes, 1)), atol=1e-13)
    within = np.random.default_rng(0).uniform(-0.49, 0.49, (30, 3)) * SIZE + [0, 0, SIZE[2] / 2]
    moved_by = ep.recovery.displacement_rows(fem, within) @ displacement.ravel()
    np.testing.assert_allclose(moved_by.reshape(-1, 3), within @ gradient.T, atol=1e-14)
    strains = (ep.recovery.strain_rows(fem, within) @ displacement.ravel()).reshape(-1, 6)
    np.testing.assert_allclose(strains, np.tile(voigt, (30, 1)), atol=1e-13)
    with pytest.raises(InputError, match="lies outside the body"):
        ep.recovery.displacement_rows(fem, 2 * SIZE[None])


@once
def with_end(fem, way):
    """A block, reduced, with its upper or lower end as the region of impact: 1 or -1."""
    region = ep.Partition.surface(fem, plane=((0, 0, SIZE[2] if way > 0 else 0.0), (0, 0, way)))
    return ep.reduce(fem, region, basis="residual", f_cut=1e5)


def hit(upper, lower):
    """Force of a block that falls on another, face on face, a little aside."""
    bodies = with_end(upper, -1), with_end(lower, 1)
    mbs = exu.SystemContainer().AddSystem()
    place = [7e-4, 3e-4, SIZE[2] + 1e-7]
    falling = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=place, initialVelocity=[0, 0, -1.0])
    contact = ep.CreatePartitionContact(mbs, falling, ep.CreatePartitionBody(mbs, bodies[1]))
    mbs.Assemble()
    return contact.force(ep.solve_dynamic(mbs, end_time=18e-6, step=0.25e-6))


@pytest.fixture(scope="module")
def tetrahedra():
    return ep.fe_model(box(*SIZE), ep.STEEL, maxh=4.3e-3)


@pytest.fixture(scope="module")
def expected(tetrahedra, block):
    return hit(block, tetrahedra)


@pytest.mark.parametrize("on", ["tetrahedra", "itself"])
@pytest.mark.parametrize("kind", KINDS)
def test_an_impact_is_that_of_tetrahedra(models, tetrahedra, expected, kind, on):
    fem = models(kind, (3, 5, 6), by=0.0)
    pairs = [(fem, tetrahedra), (tetrahedra, fem)] if on == "tetrahedra" else [(fem, models(kind, (4, 6, 6), by=0.0))]
    for pair in pairs:
        force = hit(*pair)
        assert force.max() == pytest.approx(expected.max(), rel=5e-3)
        assert np.linalg.norm(force - expected) < 1e-2 * np.linalg.norm(expected)


def test_faces_of_triangles_and_quadrilaterals(models):
    fem = models("mixed")
    patch = ep.Partition.surface(fem, plane=(TOP, (0, 0, 1))).patches[0]
    assert patch.facets.shape == (12, 8)  # six of each
    np.testing.assert_allclose(patch.normals, np.tile([0, 0, 1.0], (len(patch.nodes), 1)), atol=1e-15)
    sides = ep.Partition.surface(fem, plane=((SIZE[0] / 2, 0, 0), (1, 0, 0)))  # quadrilaterals of wedges and others
    assert sides.patches[0].facets.shape == (18, 8)
    joint = ep.Partition.interface(fem, "top", plane=(TOP, (0, 0, 1)), kind="averaged").interfaces[0]
    np.testing.assert_allclose(joint.position, TOP, atol=1e-12)
    assert joint.weights.min() >= 0
    pressure = ep.Partition.load(fem, "pressure", plane=(TOP, (0, 0, 1))).loads[0].forces
    np.testing.assert_allclose(pressure.sum(axis=0), [0, 0, -SIZE[0] * SIZE[1]], atol=1e-16)


def test_triangles_on_a_quadrilateral(tmp_path):
    """The upper wedges' triangles meet the lower hexahedron's quadrilateral.

    Linear elements move together at their nodes, and the faces between them are not on the surface. If only one
    triangle is there, half of the quadrilateral would be; quadratic ones have a node that the quadrilateral has not.
    """
    points, cells = hexahedra(1, 1, 2)
    low = points[cells].mean(axis=1)[:, 2] < SIZE[2] / 2
    points, blocks = split(points, cells, np.where(low, "hexahedron", "wedge"))
    half = [blocks[0], (blocks[1][0], blocks[1][1][:1])]
    for places, found in (quadratic(points, blocks), (points, half)):
        path = write_deck(tmp_path / "cracked.inp", places, *found)
        at = 1 + next(i for i, line in enumerate(path.read_text().splitlines()) if line.startswith("2, ") and i > 2)
        message = (
            f"triangles of elements lie on quadrilaterals of others, the first is of element 2 ({path}, line {at})"
        )
        with pytest.raises(MeshError, match=re.escape(message)):
            ep.fe_model(path, ep.STEEL)
    path = write_deck(tmp_path / "joined.inp", points, *blocks)
    with pytest.warns(MeshQualityWarning, match="1 quadrilaterals of elements meet two triangles each"):
        fem = ep.fe_model(path, ep.STEEL)
    with pytest.raises(MeshError, match="triangles of elements lie on quadrilaterals of others"):
        ep.fe_model(path, ep.STEEL, order=2)
    assert fem.total_mass == pytest.approx(7800 * SIZE.prod(), rel=1e-12)
    assert len(fem.facets) == 5 + 4 + 2  # none between the bricks
    assert not (fem.points[fem.facets, 2] == SIZE[2] / 2).all(axis=1).any()


@pytest.mark.parametrize("kind", ["hexahedron", "mixed"])
def test_files_for_paraview_and_of_the_body(models, kind, tmp_path):
    fem = models(kind)
    body = ep.reduce(fem, ep.Partition.interface(fem, "foot", plane=((0, 0, 0), (0, 0, -1))), f_cut=9e4)
    body.save(tmp_path / "body.npz")
    np.testing.assert_array_equal(ep.load_body(tmp_path / "body.npz").facets, fem.facets)
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, 1.0])
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-6, step=5e-7)
    for surface in (False, True):
        folder = tmp_path / str(surface)
        ep.output.write_paraview(folder, result, [(item, fem)], fields=["von_mises", "velocity"], surface=surface)
        mesh = meshio.read(sorted(folder.glob("*.vtu"))[-1])
        if surface:
            assert set(mesh.cells_dict) <= {"quad8", "triangle6"}
            assert sum(map(len, mesh.cells)) == len(fem.facets)
        else:
            assert {name: len(rows) for name, rows in mesh.cells_dict.items()} == {k.name: len(r) for k, r in fem.kinds}
        np.testing.assert_allclose(mesh.point_data["velocity"], np.tile([0, 0, 1.0], (len(mesh.points), 1)), atol=1e-9)


def test_regions_go_along_with_elements_that_are_put_in_order(tmp_path):
    """Elements are taken kind by kind; each keeps its material."""
    points, blocks = blocks_of("mixed", order=1, by=0.0)
    deck = write_deck(tmp_path / "two.inp", points, *blocks[::-1])
    lines = deck.read_text().splitlines()
    height = np.concatenate([points[cells].mean(axis=1)[:, 2] for _, cells in blocks[::-1]])
    upper = np.flatnonzero(height > SIZE[2] / 2) + 1
    lower = np.flatnonzero(height <= SIZE[2] / 2) + 1
    for name, members in (("upper", upper), ("lower", lower)):
        lines += [f"*ELSET, ELSET={name}", *(f"{member}," for member in members)]
        lines += [f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"]
    deck.write_text("\n".join([*lines, ""]))
    fem = ep.fe_model(deck, {"upper": ep.STEEL, "lower": ep.ALUMINIUM}, order=1)
    centres = fem.points[fem.cells].mean(axis=1)[:, 2]
    np.testing.assert_array_equal(fem.regions.E == ep.STEEL.E, centres > SIZE[2] / 2)


def test_hexahedra_and_cubic_elements_are_told_apart(models):
    """A row of 20 nodes is a hexahedron or a cubic tetrahedron; the model says which."""
    fem = models("hexahedron", (1, 1, 2), by=0.0)
    assert repr(fem).startswith(f"FEModel({fem.n_nodes} nodes, 2 hexahedra of order 2")
    parts = [fem.points, fem.cells, fem.mass, fem.stiffness, fem.cell_mass, fem.material, {}]
    with pytest.raises((InputError, MeshError)):
        ep.FEModel(*parts)
    assert ep.FEModel(*parts, hexahedra=True).facets.shape == (10, 8)


SOFT = ep.Material(E=210e9, nu=0.3, rho=7800.0, yield_stress=3e8, hardening=1e9)


def dented(fem, folder):
    """Force of a block that hits a round rigid body and yields, and its plastic work."""
    region = ep.Partition.ball(fem, TOP, 4.5e-3, direction=(0, 0, 1), plastic_radius=4e-3)
    body = ep.reduce(fem, region, basis="residual", f_cut=1e5)
    body.save(folder / "body.npz")
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, ep.load_body(folder / "body.npz"), initialVelocity=[0, 0, 2.0])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidSphere((0, 0, SIZE[2] + 0.2 + 1e-8), 0.2))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=16e-6, step=2.5e-7)
    assert contact.plastic.strain(result)[-1] > 1e-3
    return contact.force(result), contact.plastic.work(result)[-1]


def test_zones_of_every_kind_yield_as_those_of_tetrahedra(tmp_path):
    refine = [ep.Refine(TOP, 5e-3, 1.4e-3)]
    expected, work = dented(ep.fe_model(box(*SIZE), SOFT, maxh=5e-3, refine=refine), tmp_path)
    for kind in ("hexahedron", "mixed"):
        points, cells = hexahedra(6, 12, 9)
        points, blocks = split(points, cells, kinds_along(points, cells, kind))
        fine = np.abs(points - [0, 0, SIZE[2]]) / (SIZE * [0.5, 0.5, 1])  # elements become small at the contact
        points = np.sign(points - TOP) * fine ** [1.4, 1.4, 1.8] * SIZE * [0.5, 0.5, 1] + TOP
        points, blocks = quadratic(points, blocks)
        fem = ep.fe_model(write_deck(tmp_path / "mesh.inp", points, *blocks), SOFT)
        force, own = dented(fem, tmp_path)
        assert force.max() == pytest.approx(expected.max(), rel=0.015)
        assert force.sum() == pytest.approx(expected.sum(), rel=0.03)  # first touch differs by the facets' size
        assert own == pytest.approx(work, rel=0.06)


def test_a_model_of_matrices_may_have_hexahedra(models):
    fem = models("hexahedron", (2, 2, 3))
    given = {"material": ep.STEEL}
    of_surface = ep.FEModel.from_matrices(fem.mass, fem.stiffness, fem.points, fem.facets, **given)
    assert of_surface.order == 2
    assert of_surface.max_size == pytest.approx(fem.max_size, rel=0.3)
    of_cells = ep.FEModel.from_matrices(fem.mass, fem.stiffness, fem.points, cells=fem.cells, hexahedra=True, **given)
    np.testing.assert_allclose(of_cells.cell_mass, fem.cell_mass, rtol=1e-13)
    np.testing.assert_array_equal(of_cells.facets, fem.facets)


def test_a_rigid_ball_hits_triangles_and_quadrilaterals(models, tmp_path):
    """Forces with friction, pressures and pictures of such a patch, from a body of a file; node to segment as well."""
    forces = {}
    for kind in ("mixed", "hexahedron"):
        fem = models(kind, (4, 7, 8), by=0.0)
        region = ep.Partition.ball(fem, TOP, 5e-3, direction=(0, 0, 1), axes="xyz")
        body = ep.reduce(fem, region, basis="residual", f_cut=1e5)
        body.save(tmp_path / "body.npz")
        for rows in ("integrated", "node-to-segment"):
            mbs = exu.SystemContainer().AddSystem()
            ball = ep.RigidSphere((4e-4, 3e-4, SIZE[2] + 4.0 + 1e-8), 4.0)
            item = ep.CreatePartitionBody(mbs, ep.load_body(tmp_path / "body.npz"), initialVelocity=[0.03, 0, 0.1])
            contact = ep.CreatePartitionContact(mbs, item, ball, rows=rows, friction=0.2)
            mbs.Assemble()
            result = ep.solve_dynamic(mbs, end_time=9e-6, step=2.5e-7)
            forces[kind, rows] = contact.force(result)
            pressure = contact.pressure(result).toarray()
            assert pressure.min() > -1e-3 * pressure.max()
        last = ep.output.write_paraview(tmp_path / kind, result, [(item, fem)], fields=["contact_pressure"])
        assert last is None or last
        drawn = ep.plot.pressure(None, result)
        assert drawn.collections
    for rows in ("integrated", "node-to-segment"):
        expected = forces["hexahedron", rows]
        assert forces["mixed", rows].max() == pytest.approx(expected.max(), rel=2e-2)
