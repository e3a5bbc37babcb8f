"""What a mesh says of itself: nodes far off, bent edges, slivers, volume and inertia."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
import scipy.sparse as sp

import exudyn_partition as ep
from exudyn_partition.errors import MeshError, MeshQualityWarning
from exudyn_partition.fe.mesh_quality import check_inside, warn_of_damage


def changed(block, path, change):
    """FE model of the block's mesh after a change of its points."""
    points = np.array(block.points)
    change(points)
    meshio.Mesh(points, [("tetra10", block.cells)]).write(path)
    return ep.fe_model(path, ep.STEEL)


def test_a_node_far_outside(block, tmp_path):
    """A corner far off, with straight edges to it: no element is inverted, and the volume is the surface's."""
    corner = int(np.linalg.norm(block.points - [0.005, 0.01, 0.03], axis=1).argmin())

    def change(points):
        points[corner] += 0.1
        straighten(points, block)

    with pytest.warns(MeshQualityWarning, match=rf"mesh: 1 nodes lie .* the first is {corner} .*at \(0.105") as caught:
        fem = changed(block, tmp_path / "far.vtu", change)
    assert caught[0].filename == __file__
    assert np.ptp(fem.points[:, 2]) == pytest.approx(0.13)


def straighten(points, fem):
    for cell in fem.cells:
        for ends, node in edges(cell):
            points[node] = points[ends].mean(axis=0)


def edges(cell):
    """Ends and middle of each edge of a quadratic tetrahedron."""
    pairs = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]]
    return [(cell[pair], cell[4 + i]) for i, pair in enumerate(pairs)]


def test_a_mid_side_node_off_its_edge(block, tmp_path):
    node = next(n for n in block.facets[:, 3] if abs(block.points[n, 0] - 0.005) < 1e-9)
    (a, b), _ = next((ends, n) for cell in block.cells for ends, n in edges(cell) if n == node)
    along = block.points[b] - block.points[a]

    def change(points):
        points[node] += [0.4 * np.linalg.norm(along), 0, 0]

    with pytest.warns(MeshQualityWarning, match=r"mesh: \d elements have a node 0.35 of an edge away"):
        changed(block, tmp_path / "bent.vtu", change)


def test_slivers_among_good_elements(block, tmp_path):
    """A corner pressed almost into the face behind it."""
    touching = np.bincount(block.cells[:, :4].ravel(), minlength=block.n_nodes)
    cell = next(cell for cell in block.cells[:, :4] if 1 in touching[cell]) if 1 in touching else None
    if cell is None:
        cell = block.cells[
            np.flatnonzero((touching[block.cells[:, :4]] == touching[touching > 0].min()).any(axis=1))[0], :4
        ]
    tip = cell[touching[cell].argmin()]
    others = cell[cell != tip]

    def change(points):
        a, b, c = points[others]
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        points[tip] -= 0.9995 * ((points[tip] - a) @ normal) * normal
        straighten(points, block)

    with pytest.warns(MeshQualityWarning, match=r"elements have less than 0\.01 of the shape quality .* file damaged"):
        fem = changed(block, tmp_path / "flat.vtu", change)
    with pytest.warns(MeshQualityWarning, match="Take a smaller maxh, a Refine there, or a shape without") as caught:
        warn_of_damage(fem, meshed=True)  # no file is damaged where the library made the mesh
    assert "damaged" not in str(caught[0].message)


def test_volume_and_inertia_against_the_surface(block):
    check_inside(block)
    with pytest.raises(MeshError, match=r"elements have a volume of 6\.00003e-06 m3, its surface encloses 6e-06 m3"):
        check_inside(replace(block, cell_mass=1.000005 * block.cell_mass))
    squared = ((block.points - block.centre_of_mass) ** 2).sum(axis=1)
    outwards = block.lumped_mass * (squared / np.average(squared, weights=block.lumped_mass) - 1)
    moved = block.mass + sp.diags(np.repeat(0.05 * outwards, 3), format="csr")
    with pytest.raises(MeshError, match=r"second moments of its mass matrix are .* expected the same within 0\.1 %"):
        check_inside(replace(block, mass=moved))
