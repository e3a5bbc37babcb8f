"""STEP files: their endings, and files that crash their reader."""

import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.meshing import step_files

BLOCK = box(0.01, 0.02, 0.03)


@pytest.mark.parametrize("name", ["block.STP", "block.Step", "block.stp"])
def test_endings_of_step_files_in_any_case(tmp_path, name):
    BLOCK.WriteStep(str(tmp_path / "block.step"))
    (tmp_path / "block.step").rename(tmp_path / name)
    assert ep.fe_model(tmp_path / name, ep.STEEL, maxh=0.02).total_mass == pytest.approx(7800 * 6e-6, rel=1e-9)


def test_a_step_file_that_crashes_its_reader(tmp_path, monkeypatch):
    path = tmp_path / "block.step"
    BLOCK.WriteStep(str(path))
    monkeypatch.setattr(step_files, "TRIAL", "import os; os.abort()")
    with pytest.raises(InputError, match=r"could not be read by Netgen \(its reader crashes, exit code -6\)"):
        ep.fe_model(path, ep.STEEL, maxh=0.02)
    monkeypatch.undo()
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in lines if "CARTESIAN_POINT" not in line))
    with pytest.raises(InputError, match=r"could not be read|expected a solid, got none"):
        ep.fe_model(path, ep.STEEL, maxh=0.02)
