"""The writer of CalculiX' input, and CalculiX itself where it is installed."""

import meshio
import netgen.occ as occ
import numpy as np
import pytest
import scipy.sparse.linalg

import exudyn_partition as ep
from exudyn_partition.fe.shapes import TET_EDGES
from validation.calculix import axisymmetric, deck

BOX = occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(0.1, 0.03, 0.02))
needs_ccx = pytest.mark.skipif(deck.executable() is None, reason="ccx is not installed: apt install calculix-ccx")


@pytest.fixture(scope="module")
def fem():
    return ep.fe_model(BOX, ep.STEEL, maxh=0.02)


def test_the_mesh_that_is_written_is_the_one_that_is_read_back(fem, tmp_path):
    top = ep.Partition.ball(fem, (0.05, 0.015, 0.02), 0.02).patches[0]
    bottom = ep.Partition.ball(fem, (0.05, 0.015, 0), 0.02).patches[0]
    text = deck.impact_input([fem, fem], [top, bottom], [(0, 0, -0.5), (0, 0, 0)], deck.Pair(1e15), 1e-5, 1e-6)
    path = tmp_path / "job.inp"
    path.write_text(text)
    mesh = meshio.read(path)
    np.testing.assert_allclose(mesh.points, np.tile(fem.points, (2, 1)), atol=1e-12)
    cells = np.concatenate([block.data for block in mesh.cells if block.type == "tetra10"])
    np.testing.assert_array_equal(cells, np.vstack([fem.cells, fem.cells + fem.n_nodes]))
    assert "*FRICTION" not in text
    slips = deck.Pair(1e15, friction=0.3, stick_slope=1e14).cards()
    assert slips[slips.index("*FRICTION") + 1] == "0.3, 1e+14"


def test_faces_of_a_surface_are_those_of_the_patch(fem):
    patch = ep.Partition.ball(fem, (0.05, 0.015, 0.02), 0.02).patches[0]
    cells, faces = deck.patch_faces(fem, patch).T
    corners = fem.cells[cells[:, None], deck.FACES[faces - 1]]
    np.testing.assert_array_equal(np.sort(corners), np.sort(patch.facets[:, :3]))


def test_forces_are_read_at_their_times():
    block = """
 statistics for slave set S1, master set S2 and time  {t}

   total surface force (fx,fy,fz) and moment about the origin (mx,my,mz)

   -4.912716E-04  7.290451E-04  {f}  7.295401E-06  4.821860E-06 -3.642375E-11
"""
    dat = block.format(t="0.1000000E-05", f="2.5E+00") + block.format(t="0.2000000E-05", f="-8.0E-01")
    t, force = deck.contact_force(dat)
    np.testing.assert_allclose(t, [1e-6, 2e-6])
    np.testing.assert_allclose(force[:, 2], [2.5, -0.8])
    with pytest.raises(RuntimeError, match="got 0 at 0"):
        deck.contact_force("")


def elastic_frequencies(fem, mass, n):
    """The n lowest elastic frequencies of a free body [Hz]."""
    K, M = fem.stiffness.tocsc(), mass.tocsc()
    omega_squared = scipy.sparse.linalg.eigsh(K, k=6 + n, M=M, sigma=-1e6, return_eigenvectors=False)
    return np.sqrt(np.sort(omega_squared)[6:]) / (2 * np.pi)


def four_point_mass(fem):
    """Mass matrix integrated at four points an element, where quadratic shapes need fifteen."""
    a, b = 0.25 + 0.75 / 5**0.5, 0.25 - 0.25 / 5**0.5
    L = np.full((4, 4), b) + (a - b) * np.eye(4)
    shapes = np.hstack([L * (2 * L - 1), 4 * L[:, TET_EDGES[:, 0]] * L[:, TET_EDGES[:, 1]]])
    share = (shapes.T @ shapes / 4).ravel()
    rows, columns = np.repeat(fem.cells, 10, axis=1).ravel(), np.tile(fem.cells, (1, 10)).ravel()
    mass = scipy.sparse.csr_matrix(((fem.cell_mass[:, None] * share).ravel(), (rows, columns)))
    return scipy.sparse.kron(mass, np.eye(3))


@needs_ccx
@pytest.mark.parametrize(("maxh", "mass", "n", "limit"), [(20e-3, "four points", 4, 2e-6), (8e-3, "exact", 2, 1e-4)])
def test_frequencies_of_a_free_block_are_calculix_s(maxh, mass, n, limit, tmp_path):
    """Round-off with its way to integrate the mass; with ours a difference that the mesh makes small."""
    fem = ep.fe_model(BOX, ep.STEEL, maxh=maxh)
    dat, _ = deck.solve(deck.frequency_input(fem, 6 + n), tmp_path)
    expected = deck.frequencies(dat)
    assert abs(expected[:6]).max() < 1e-2 * expected[6]
    found = elastic_frequencies(fem, four_point_mass(fem) if mass == "four points" else fem.mass, n)
    np.testing.assert_allclose(found, expected[6:], rtol=limit)


def test_a_ball_and_a_round_plate_of_the_axisymmetric_deck_have_their_volume():
    sizes = 5e-3, 10e-3, 4e-3
    steel = ep.Material(E=210e9, nu=0.3, rho=7800.0)
    text = axisymmetric.impact_input((steel, steel), sizes, 1.0, deck.Pair(1e16), 0.3e-3, 2, 1.5, 1e-6, 10)
    cards = {}
    for line in text.splitlines():
        if line.startswith("*"):
            rows = cards.setdefault(line, [])
        else:
            rows.append(line)
    points = np.array([row.split(",")[1:3] for row in cards["*NODE"]], dtype=float)
    volumes = []
    for number in (1, 2):
        cells = np.array([row.split(",")[1:] for row in cards[f"*ELEMENT, TYPE=CAX8R, ELSET=B{number}"]], dtype=int) - 1
        ring = cells[:, [0, 4, 1, 5, 2, 6, 3, 7]]  # corners and mid-sides as polygons
        r, z = points[ring].transpose(2, 0, 1)
        after_r, after_z = np.roll(r, -1, axis=1), np.roll(z, -1, axis=1)
        twice = r * after_z - after_r * z
        assert (twice.sum(axis=1) > 0).all()
        volumes.append(np.pi / 3 * (twice * (r + after_r)).sum())  # Pappus
    np.testing.assert_allclose(volumes, [4 / 3 * np.pi * 5e-3**3, np.pi * 10e-3**2 * 4e-3], rtol=2e-3)


@needs_ccx
def test_an_error_of_calculix_is_told(tmp_path):
    with pytest.raises(RuntimeError, match="CalculiX stopped"):
        deck.solve("*NODE\n1, 0, 0, 0\n*STEP\n*STATIC\n*END STEP\n", tmp_path)
