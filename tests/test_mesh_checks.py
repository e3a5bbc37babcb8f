"""What a mesh says of itself, what it would take, and what Netgen, meshio and threads must not do to the process."""

import io
import sys
import threading
from dataclasses import replace

import meshio
import netgen.occ as occ
import numpy as np
import pytest
from conftest import box

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MemoryLimitError, MeshError, MeshQualityWarning, UnitsWarning
from exudyn_partition.fe.mesh_quality import check_mesh
from exudyn_partition.meshing import mesh_size, step_files

BLOCK = box(0.01, 0.02, 0.03)


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

    with pytest.warns(MeshQualityWarning, match=r"mesh: \d elements have a mid-side node 0.35 of an edge away"):
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

    with pytest.warns(MeshQualityWarning, match=r"elements have less than 0\.01 of the shape quality"):
        changed(block, tmp_path / "flat.vtu", change)


def test_volume_and_inertia_against_the_surface(block):
    check_mesh(block)
    with pytest.raises(MeshError, match=r"elements have a volume of 6\.006e-06 m3, its surface encloses 6e-06 m3"):
        check_mesh(replace(block, cell_mass=1.001 * block.cell_mass))
    with pytest.raises(MeshError, match=r"second moments of its mass matrix are .* expected the same within 0\.1 %"):
        check_mesh(replace(block, mass=1.002 * block.mass))


def test_a_mesh_that_misses_its_shape():
    ball = occ.Sphere(occ.Pnt(0, 0, 0), 0.01)
    mesh = ep.generate_mesh(ball, maxh=0.005)
    assert ep.fe_model(mesh, ep.STEEL).total_mass == pytest.approx(4.18879e-6 * 7800, rel=0.01)


@pytest.mark.parametrize("grading", [1e-6, 0.01, 5, float("nan"), None])
def test_gradings_that_netgen_does_not_survive(grading):
    with pytest.raises(InputError, match="grading: expected"):
        ep.generate_mesh(BLOCK, maxh=0.01, grading=grading)


def test_boxes_without_size():
    for corner in (np.nan, np.inf):
        with pytest.raises(InputError, match="shape: expected a body of finite size"):
            ep.fe_model(occ.Box((0, 0, 0), (corner, 1, 1)), ep.STEEL, maxh=0.1)


def test_a_mesh_beyond_memory_is_refused_at_once():
    """A shape in millimetres meshed by metres; and what the estimate is worth where a mesh can be made."""
    with pytest.raises(MemoryLimitError, match=r"would be about 2\.2e\+11 and take .* GB, of .* GB .*millimetres"):
        ep.fe_model(box(10, 20, 30), ep.STEEL, maxh=5e-3)
    with pytest.raises(MemoryLimitError, match="refinement included"):
        ep.fe_model(BLOCK, ep.STEEL, maxh=5e-3, refine=ep.Refine((0, 0, 0.015), 5e-3, 4.5e-5))


@pytest.mark.parametrize(
    ("size", "maxh", "refine"), [((1, 1, 1), 0.1, ()), ((1, 1, 0.02), 0.1, ()), ((1, 1, 1), 0.2, 0.03)]
)
def test_the_estimated_number_of_elements(monkeypatch, size, maxh, refine):
    fine = [ep.Refine((0, 0, 1), 0.1, refine)] if refine else []
    shape = box(*size)
    monkeypatch.setattr(mesh_size, "available_memory", lambda: (0.0, 0.0))
    with pytest.raises(MemoryLimitError) as caught:
        ep.generate_mesh(shape, maxh=maxh, refine=fine)
    estimated = float(str(caught.value).split("would be about ")[1].split()[0].rstrip(","))
    monkeypatch.undo()
    assert 0.5 < ep.generate_mesh(shape, maxh=maxh, refine=fine).ne / estimated < 2


def test_matrices_beyond_memory_are_refused(monkeypatch, block, tmp_path):
    meshio.Mesh(block.points, [("tetra10", block.cells)]).write(tmp_path / "block.vtu")
    monkeypatch.setattr(mesh_size, "available_memory", lambda: (1e6, 1e6))
    with pytest.raises(MemoryLimitError, match=r"the matrices of 520 nodes would take about 0\.00988 GB, of 0\.001 GB"):
        ep.fe_model(tmp_path / "block.vtu", ep.STEEL)


@pytest.mark.parametrize("option", [{"maxh": 1e-3}, {"refine": ep.Refine((0, 0, 0), 1e-3, 1e-4)}, {"grading": 0.5}])
def test_options_of_meshing_beside_a_mesh(block, tmp_path, option):
    meshio.Mesh(block.points, [("tetra10", block.cells)]).write(tmp_path / "block.vtu")
    for source in (tmp_path / "block.vtu", ep.generate_mesh(BLOCK, maxh=0.02)):
        with pytest.raises(InputError, match=f"{next(iter(option))}: a mesh is taken as it is, .* no effect"):
            ep.fe_model(source, ep.STEEL, **option)


@pytest.mark.parametrize("source", [None, 3, [1, 2], {}, b"rod.step"])
def test_what_is_no_source(source):
    with pytest.raises(InputError, match=r"(source|shape): expected"):
        ep.fe_model(source, ep.STEEL, maxh=1e-3)


@pytest.mark.parametrize("name", ["block.STP", "block.Step", "block.stp"])
def test_endings_of_step_files_in_any_case(tmp_path, name):
    BLOCK.WriteStep(str(tmp_path / "block.step"))
    (tmp_path / "block.step").rename(tmp_path / name)
    assert ep.fe_model(tmp_path / name, ep.STEEL, maxh=0.02).total_mass == pytest.approx(7800 * 6e-6, rel=1e-9)


def test_a_step_file_that_crashes_its_reader(tmp_path, monkeypatch):
    path = tmp_path / "block.step"
    BLOCK.WriteStep(str(path))
    monkeypatch.setattr(step_files, "_TRIAL", "import os; os.abort()")
    with pytest.raises(InputError, match=r"could not be read by Netgen \(its reader crashes, exit code -6\)"):
        ep.fe_model(path, ep.STEEL, maxh=0.02)
    monkeypatch.undo()
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in lines if "CARTESIAN_POINT" not in line))
    with pytest.raises(InputError, match=r"could not be read|expected a solid, got none"):
        ep.fe_model(path, ep.STEEL, maxh=0.02)


def test_threads_take_turns_and_standard_output_comes_back(block, tmp_path):
    meshio.Mesh(block.points, [("tetra10", block.cells)]).write(tmp_path / "block.vtu")
    (tmp_path / "broken.vtu").write_text("rubbish")
    failed = []

    def work(length):
        try:
            for _ in range(2):
                made = ep.fe_model(box(0.01, 0.02, length), ep.STEEL, maxh=0.02)
                np.testing.assert_allclose(made.total_mass, 7800 * 2e-4 * length, rtol=1e-9)
                read = ep.fe_model(tmp_path / "block.vtu", ep.STEEL)
                np.testing.assert_array_equal(read.points, block.points)
                with pytest.raises(InputError):
                    ep.fe_model(tmp_path / "broken.vtu", ep.STEEL)
        except BaseException as error:  # also pytest's own
            failed.append(error)

    before = sys.stdout
    threads = [threading.Thread(target=work, args=(0.01 * i,)) for i in range(1, 5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failed
    assert sys.stdout is before


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


@pytest.mark.parametrize(
    ("size", "maxh", "said"),
    [
        ((10e-6, 20e-6, 30e-6), 1e-5, r"is 3e-05 long .* scaled twice"),
        ((0.2e-3, 0.2e-3, 1), 5e-3, "drawn in two units"),
        ((0.79, 1.18, 0.39), 0.4, r"in inches by 0\.0254"),  # a part of 0.047 kg
    ],
)
def test_sizes_of_few_bodies(size, maxh, said):
    with pytest.warns(UnitsWarning, match=said):
        ep.fe_model(box(*size), ep.STEEL, maxh=maxh)
