"""A package of somebody else's, installed by pip into a folder: what it adds works by its name."""

import subprocess
import sys

import exudyn as exu
import meshio
import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.support.plugins import added_choice

PROJECT = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"
[project]
name = "tiny-plugin"
version = "1.0"
[project.entry-points."exudyn_partition.bases"]
coarse = "tiny_plugin:coarse"
gone = "tiny_plugin:gone"
[project.entry-points."exudyn_partition.formulations"]
soft = "tiny_plugin:Soft"
[project.entry-points."exudyn_partition.readers"]
tiny = "tiny_plugin:read"
[tool.hatch.build.targets.wheel]
include = ["tiny_plugin.py"]
"""
CODE = """
import meshio
from exudyn_partition.contact.formulations.choices import Penalty
from exudyn_partition.reduction.basis import contact_adapted

def coarse(fem, partition, f_cut, progress):
    return contact_adapted(fem, partition, f_cut / 2, progress)

class Soft(Penalty):
    def __init__(self):
        super().__init__(1e12)

def read(path):
    return meshio.read(path, file_format="vtu")
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The package, in a folder of its own."""
    source, target = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("installed")
    (source / "pyproject.toml").write_text(PROJECT)
    (source / "tiny_plugin.py").write_text(CODE)
    options = ["-q", "--no-deps", "--no-index", "--no-build-isolation", "--target", str(target)]
    subprocess.run([sys.executable, "-m", "pip", "install", *options, str(source)], check=True)
    with pytest.MonkeyPatch.context() as context:
        context.syspath_prepend(target)
        yield target


def test_a_basis_by_its_name(installed, block, top):
    found = ep.reduce(block, top, f_cut=80e3, basis="coarse")
    expected = ep.reduce(block, top, f_cut=40e3)
    np.testing.assert_allclose(found.basis.omega, expected.basis.omega, rtol=1e-9)
    with pytest.raises(InputError, match=r"bases: 'gone' of tiny-plugin \(tiny_plugin:gone\) cannot be imported"):
        ep.reduce(block, top, f_cut=80e3, basis="gone")
    with pytest.raises(InputError, match=r"basis: expected one of 'free', .*, 'coarse', 'gone', got 'fine'"):
        ep.reduce(block, top, f_cut=80e3, basis="fine")


def test_a_formulation_by_its_name(installed, bodies):
    mbs = exu.SystemContainer().AddSystem()
    first = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=[0, 0, 0.03])
    contact = ep.CreatePartitionContact(mbs, first, ep.CreatePartitionBody(mbs, bodies[1]), formulation="soft")
    assert type(contact.mechanics.formulation).__module__ == "tiny_plugin"
    with pytest.raises(InputError, match=r"formulation: expected one of 'compliance', .*, 'soft', got 'hard'"):
        ep.CreatePartitionContact(mbs, first, ep.RigidPlane(), formulation="hard")


def test_a_reader_by_the_ending_of_files(installed, block, tmp_path):
    meshio.Mesh(block.points, [("tetra10", block.cells)]).write(tmp_path / "block.vtu")
    (tmp_path / "block.vtu").rename(tmp_path / "block.tiny")
    read = ep.fe_model(tmp_path / "block.tiny", ep.STEEL)
    assert read.total_mass == pytest.approx(block.total_mass, rel=1e-9)
    (tmp_path / "block.tiny").rename(tmp_path / "block.none")
    with pytest.raises(InputError, match="meshio"):
        ep.fe_model(tmp_path / "block.none", ep.STEEL)


def test_what_is_no_name_is_refused_as_a_wrong_choice():
    """An array cannot be compared with names."""
    for value in (np.zeros(3), ["free"], 5, None):
        with pytest.raises(InputError, match=r"basis: expected one of 'free', .*got"):
            added_choice("basis", value, ["free", "coarse"], "bases")
