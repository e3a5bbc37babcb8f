"""FE models from Exudyn's FEMinterface: the same matrices as ours, from NGSolve, and files of Abaqus and ANSYS."""

from dataclasses import replace

import netgen.occ as occ
import numpy as np
import pytest
import scipy.sparse as sp
from exudyn.FEM import FEMinterface

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MeshError

ENDS = ["left", "right"]


def shape(bore=False):
    """A box with a notch or a bore, and two named faces."""
    bored = occ.Cylinder(occ.Pnt(0.02, 0.01, 0), occ.Z, r=0.006, h=0.02)
    box = occ.Box((0, 0, 0), (0.06, 0.02, 0.02)) - (bored if bore else occ.Box((0.01, 0, 0), (0.03, 0.008, 0.02)))
    box.faces.Min(occ.X).name, box.faces.Max(occ.X).name = ENDS
    return box


def imported(mesh, order, material=ep.STEEL):
    fem = FEMinterface()
    fem.ImportMeshFromNGsolve(mesh, material.rho, material.E, material.nu, meshOrder=order, boundaryNamesList=ENDS)
    return fem


@pytest.fixture(scope="module", params=[1, 2])
def both(request):
    """The model by us, and by Exudyn's import."""
    mesh = ep.generate_mesh(shape(), maxh=0.02)
    ours = ep.fe_model(mesh, ep.STEEL, order=request.param)
    return ours, imported(mesh, request.param)


def test_matrices_mesh_and_boundaries_are_those_of_our_own_model(both):
    ours, fem = both
    theirs = ep.from_feminterface(fem, ep.STEEL)
    np.testing.assert_array_equal(theirs.points, np.array(fem.nodes["Position"]))
    order = np.lexsort(np.round(ours.points, 9).T)[np.argsort(np.lexsort(np.round(theirs.points, 9).T))]
    np.testing.assert_allclose(ours.points[order], theirs.points, atol=1e-12)
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    for name in ("mass", "stiffness", "lumped_mass_matrix"):
        own, other = getattr(ours, name), getattr(theirs, name)
        assert abs(own[dofs][:, dofs] - other).max() < 1e-8 * abs(own).max()
    assert theirs.order == ours.order
    assert theirs.max_size == pytest.approx(ours.max_size, rel=1e-3)
    for end in ENDS:
        nodes = [np.unique(model.facets[model.boundaries[end]]) for model in (ours, theirs)]
        assert set(order[nodes[1]]) == set(nodes[0])


def test_bodies_with_curved_sides_vibrate_alike():
    """Exudyn places the mid-side nodes of curved sides a little differently."""
    mesh = ep.generate_mesh(shape(bore=True), maxh=0.02)
    omega = []
    for model in (ep.fe_model(mesh, ep.STEEL), ep.from_feminterface(imported(mesh, 2), ep.STEEL)):
        ends = [ep.Partition.interface(model, end, nodes=end) for end in ENDS]
        omega.append(ep.reduce(model, ends[0] | ends[1], f_cut=20e3).basis.omega[6:])
    np.testing.assert_allclose(*omega, rtol=3e-4)


def test_mid_side_nodes_of_a_coarse_ball_are_found():
    """The middle of an edge may be nearer to the mid-side node of another one."""
    mesh = ep.generate_mesh(occ.Sphere(occ.Pnt(0, 0, 0), 0.01), maxh=0.005)
    ours, theirs = ep.fe_model(mesh, ep.STEEL), ep.from_feminterface(imported(mesh, 2), ep.STEEL)
    assert theirs.cell_volume.sum() == pytest.approx(ours.cell_volume.sum(), rel=1e-3)
    assert theirs.mass.sum() / 3 == pytest.approx(theirs.cell_mass.sum(), rel=1e-6)


def test_linear_functions_on_curved_elements_are_refused():
    """They have no rigid rotation, so that the matrices of such an import resist one."""
    mesh = ep.generate_mesh(shape(bore=True), maxh=0.02)
    with pytest.raises(InputError, match=r"the mass matrix has .* mesh\.Curve"):
        ep.from_feminterface(imported(mesh, 1), ep.STEEL)


def test_straight_sides_are_advised_where_they_may_help():
    """They make other matrices of the same mesh."""
    mesh = ep.generate_mesh(shape(), maxh=0.03)
    steel = ep.STEEL
    with pytest.raises(InputError, match=r"a uniform .* stores .* mesh\.Curve"):
        ep.from_feminterface(imported(mesh, 1), ep.Material(E=2 * steel.E, nu=steel.nu, rho=steel.rho))


@pytest.mark.parametrize("kind", ["C3D10", "C3D8"])
def test_a_mesh_and_matrices_of_abaqus(tmp_path, kind, bricks):
    """Text files as Abaqus writes them, with numbers from one."""
    ours = bricks if kind == "C3D8" else ep.fe_model(shape(), ep.STEEL, maxh=0.03)
    lines = [f"{i}, {x!r}, {y!r}, {z!r}" for i, (x, y, z) in enumerate(ours.points.tolist(), 1)]
    cells = [", ".join(map(str, [i, *cell])) for i, cell in enumerate((ours.cells + 1).tolist(), 1)]
    (tmp_path / "part.inp").write_text(
        "\n".join(["*Part, name=Part-1", "*Node", *lines, f"*Element, type={kind}", *cells, "*End Part", ""])
    )
    fem = FEMinterface()
    fem.ImportFromAbaqusInputFile(str(tmp_path / "part.inp"), typeName="Part", name="Part-1")
    for name, matrix in (("Mass", ours.mass), ("Stiffness", ours.stiffness)):
        entries = matrix.tocoo()
        np.savetxt(
            tmp_path / name, np.column_stack([entries.row + 1, entries.col + 1, entries.data]), fmt="%d %d %.17g"
        )
        getattr(fem, f"Read{name}MatrixFromAbaqus")(str(tmp_path / name))
    model = ep.from_feminterface(fem, ours.material)
    np.testing.assert_array_equal(model.cells, ours.cells)
    assert abs(model.stiffness - ours.stiffness).max() < 1e-12 * abs(ours.stiffness).max()
    np.testing.assert_allclose(model.cell_mass, ours.cell_mass, rtol=2e-3)


def test_a_mesh_and_matrices_of_ansys(tmp_path, bricks):
    """Text files as ANSYS writes them: half of each matrix, in an order of its own, and commas for points."""
    order = np.random.default_rng(0).permutation(bricks.n_nodes)  # of the nodes in the matrices
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    n = bricks.n_dofs
    (tmp_path / "order").write_text("\n".join(["% nodes", f"{len(order)} 1", *map(str, order + 1)]) + "\n")
    places = [f"{i}\t" + "\t".join(map(repr, x)).replace(".", ",") for i, x in enumerate(bricks.points.tolist(), 1)]
    (tmp_path / "nodes.txt").write_text("\n".join(["Node Number\tX\tY\tZ", *places]) + "\n")
    cells = [f"{i}\tHex8\t" + "\t".join(map(str, cell)) for i, cell in enumerate((bricks.cells + 1).tolist(), 1)]
    (tmp_path / "cells.txt").write_text("\n".join(["Element Number\tElement Type\tNodes", *cells]) + "\n")
    fem = FEMinterface()
    fem.ReadNodalCoordinatesFromAnsys(str(tmp_path / "nodes.txt"))
    fem.ReadElementsFromAnsys(str(tmp_path / "cells.txt"))
    for name, matrix in (("Mass", bricks.mass), ("Stiffness", bricks.stiffness)):
        half = sp.tril(matrix[dofs][:, dofs]).tocoo()
        entries = [f"{i + 1} {j + 1} {x!r}" for i, j, x in zip(half.row, half.col, half.data.tolist(), strict=True)]
        (tmp_path / name).write_text("\n".join(["%%MatrixMarket", f"{n} {n} {half.nnz}", *entries]) + "\n")
        getattr(fem, f"Read{name}MatrixFromAnsys")(str(tmp_path / name), str(tmp_path / "order"))
    model = ep.from_feminterface(fem, bricks.material)
    np.testing.assert_array_equal(model.cells, bricks.cells)
    assert abs(model.stiffness - bricks.stiffness).max() < 1e-12 * abs(bricks.stiffness).max()
    assert abs(model.mass - bricks.mass).max() < 1e-12 * abs(bricks.mass).max()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rho": 7.85e-9}, r"material: the mass matrix has .* kg"),
        ({"rho": 1.006 * ep.STEEL.rho}, r"material: the mass matrix has .* kg"),
        ({"E": 1.003 * ep.STEEL.E}, "material: a uniform strain along x stores .* by the stiffness matrix"),
        ({"E": 70e9}, "material: a uniform strain along x stores .* by the stiffness matrix"),
        ({"E": 210e9 * 1.1, "nu": 0.2}, "material: a uniform (strain|shear) a"),
    ],
)
def test_another_material_than_that_of_the_matrices_is_named(both, changed, message):
    with pytest.raises(InputError, match=message):
        ep.from_feminterface(both[1], replace(ep.STEEL, **changed))


def wrong(fem, **changed):
    """A copy of a FEMinterface with other parts."""
    copy = FEMinterface()
    for name in ("nodes", "elements", "massMatrix", "stiffnessMatrix", "nodeSets"):
        setattr(copy, name, changed.get(name, getattr(fem, name)))
    return copy


def test_what_is_missing_or_does_not_fit_is_named(both):
    _, fem = both
    elements = fem.elements[0]["Tet4"]
    for changed, error, message in (
        ({"massMatrix": None}, InputError, "fem: has no sparse massMatrix"),
        ({"stiffnessMatrix": sp.identity(3, format="csr")}, MeshError, "fem: stiffnessMatrix has shape"),
        ({"massMatrix": fem.massMatrix * 1j}, MeshError, "fem: massMatrix: expected real numbers, got complex128"),
        ({"massMatrix": sp.triu(fem.massMatrix)}, MeshError, "fem: massMatrix: expected a symmetric matrix"),
        ({"stiffnessMatrix": sp.tril(fem.stiffnessMatrix)}, MeshError, "fem: stiffnessMatrix: expected a symmetric"),
        ({"nodes": {}}, InputError, "fem: expected nodes with positions only, got none"),
        ({"elements": []}, MeshError, "fem: expected elements of one kind, Tet4, Tet10, Hex8, got none"),
        ({"elements": [{"Name": "a", "Hex20": elements}]}, MeshError, "expected elements of one kind, .* got Hex20"),
        ({"elements": [{"Name": "a", "Tet10": elements}]}, MeshError, r"expected Tet10 of shape \(n, 10\)"),
        ({"elements": [{"Name": "a", "Tet4": elements + 10**6}]}, MeshError, "expected Tet4 .* node numbers from 0"),
        (
            {"elements": [{"Name": "a", "Tet4": elements[:-1]}]},
            InputError,
            "material: the mass matrix has",
        ),
    ):
        with pytest.raises(error, match=message):
            ep.from_feminterface(wrong(fem, **changed), ep.STEEL)
    for value in (None, "part.inp", FEMinterface):
        with pytest.raises(InputError, match="fem: expected a FEMinterface"):
            ep.from_feminterface(value, ep.STEEL)
    with pytest.raises(InputError, match="material: expected"):
        ep.from_feminterface(fem, 210e9)
