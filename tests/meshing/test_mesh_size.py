"""What a mesh says of itself, what it would take, and what Netgen, meshio and threads must not do to the process."""

import re

import meshio
import netgen.occ as occ
import numpy as np
import pytest
from netgen.meshing import MeshingParameters
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MemoryLimitError, UnitsWarning
from exudyn_partition.meshing import mesh_size

BLOCK = box(0.01, 0.02, 0.03)
FILLETED = 0.008, 0.010, 0.012


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


@pytest.mark.parametrize(
    ("h", "said"), [(None, "36,000 elements with 54,000 nodes"), (0.02, "larger maxh"), (0.005, "refine: a larger h")]
)
def test_a_large_mesh_is_told_before_it_is_made(caplog, h, said):
    """With what decides its size. A small one is not told."""
    balls = [] if h is None else [ep.Refine((0, 0, 1), 0.1, h)]
    with caplog.at_level("INFO"):
        mesh_size.check_memory_of_mesh(1.0, 1.0, 6.0, 0.1, [], 0.3, 2)
        assert not caplog.text
        mesh_size.check_memory_of_mesh(1.0, 1.0, 6.0, 0.05, balls, 0.3, 2)
    assert said in caplog.text


def with_fillets():
    block = box(*FILLETED)
    return block.MakeFillet(block.edges, 2e-3)


def test_a_mesh_that_fillets_decide_is_told_before_it_is_made(caplog, monkeypatch):
    """Its size, and that `maxh` does not decide it; the mesh is the one that Netgen makes without that look."""
    monkeypatch.setattr(mesh_size, "LARGE", 300.0)
    with caplog.at_level("INFO"):
        mesh = ep.generate_mesh(with_fillets(), maxh=5e-3)
    said = next(record.getMessage() for record in caplog.records if "are to come" in record.getMessage())
    assert "small faces of the shape, down to 0.001 m" in said
    assert "maxh does not decide" in said
    estimated = float(said.split("some ")[1].split()[0].replace(",", ""))
    assert 0.5 < mesh.ne / estimated < 2
    assert mesh.ne > 5 * 4.5 * np.prod(FILLETED) / 5e-3**3  # elements of 5 mm that fill the block
    parameters = MeshingParameters(maxh=5e-3, grading=0.3, curvaturesafety=2.0)
    plain = occ.OCCGeometry(with_fillets()).GenerateMesh(mp=parameters)
    np.testing.assert_array_equal(mesh.ngmesh.Coordinates(), plain.Coordinates())


def test_advice_on_maxh_comes_before_a_mesh(caplog, monkeypatch):
    """The size that is named as a first choice, and the one that is named for fewer nodes, make such meshes."""
    with pytest.raises(InputError, match=r"largest element size \[m\]; 0\.0031 m would do for a first look"):
        ep.fe_model(BLOCK, ep.STEEL)
    monkeypatch.setattr(mesh_size, "LARGE", 3e3)
    with caplog.at_level("INFO"):
        ep.fe_model(BLOCK, ep.STEEL, maxh=2e-3)
    larger, nodes = re.search(r"fewer, (\S+) m some (\S+) nodes", caplog.text).groups()
    fem = ep.fe_model(BLOCK, ep.STEEL, maxh=float(larger))
    assert 0.5 < fem.n_nodes / float(nodes.replace(",", "")) < 2


def test_elements_are_fine_in_an_ellipsoid_along_its_long_axis_and_estimated():
    """At its ends as in its middle, and not beside it, where a ball of that length would have fine elements too."""
    long = ep.Refine((0, 0, 1), 0.1, 0.05, long_axis=(0.4, 0, 0))
    mesh = ep.generate_mesh(box(1, 1, 1), maxh=0.3, refine=[long], grading=0.7)
    assert 0.5 < len(long.points()) / long.n_points < 2
    vertices = mesh.ngmesh.Coordinates()

    def around(place):
        return int((abs(vertices - place).max(axis=1) < 0.12).sum())

    ends, middle, beside = [around((x, 0, 1)) for x in (-0.25, 0.25)], around((0, 0, 1)), around((0, 0.4, 1))
    assert min(ends) > 0.5 * middle
    assert beside < 0.5 * min(ends)
    assert mesh.ne < 0.6 * ep.generate_mesh(box(1, 1, 1), maxh=0.3, refine=[ep.Refine((0, 0, 1), 0.4, 0.05)]).ne
    with pytest.raises(InputError, match="long_axis: expected a vector of at least radius"):
        ep.Refine((0, 0, 1), 0.1, 0.05, long_axis=(0.05, 0, 0))


def test_matrices_beyond_memory_are_refused(monkeypatch, block, tmp_path):
    meshio.Mesh(block.points, [("tetra10", block.cells)]).write(tmp_path / "block.vtu")
    monkeypatch.setattr(mesh_size, "available_memory", lambda: (1e6, 1e6))
    with pytest.raises(MemoryLimitError, match=r"the matrices of 520 nodes would take about 0\.00988 GB, of 0\.001 GB"):
        ep.fe_model(tmp_path / "block.vtu", ep.STEEL)


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
