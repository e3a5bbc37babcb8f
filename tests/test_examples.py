"""The examples as a user runs them; rod_on_plate and existing_model are in test_package."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import pytest

import exudyn_partition as ep

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def run_quick(name, folder):
    """Run an example with --quick; its result.json, and the path of the picture that it printed last."""
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), "--quick", "--out", str(folder)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300).stdout
    picture = Path(printed.strip().splitlines()[-1])
    assert picture == folder.resolve() / f"{name}.png"
    assert matplotlib.image.imread(picture).std() > 0.05
    result = json.loads((folder / "result.json").read_text())
    assert result["dofs"] < 150 < result["fe_dofs"]
    assert result["peak_force_N"]
    assert {"time", "steps", "step_s", "versions"} <= set(result)
    return result


def test_two_spheres(tmp_path):
    result = run_quick("two_spheres", tmp_path)
    # A mesh of two to three elements in the radius of contact; whole balls are 1 % stiffer than Hertz's half spaces.
    assert abs(result["error"]["peak_force"]) < 0.04
    assert abs(result["error"]["duration"]) < 0.08
    assert abs(result["error"]["velocity_after"]) < 1e-3
    assert result["momentum_error"] < 1e-9
    assert abs(result["energy_error"]) < 1e-4


def test_newtons_cradle(tmp_path):
    result = run_quick("newtons_cradle", tmp_path)
    assert result["error"]["force"] < 0.08
    assert result["error"]["velocity_after"] < 0.01
    assert result["momentum_error"] < 1e-9
    assert abs(result["energy_error"]) < 1e-4


def test_own_part(tmp_path):
    result = run_quick("own_part", tmp_path)
    assert result["error"]["mesh_file"] < 1e-6  # the same mesh, written and read
    assert result["mass_kg"] == pytest.approx(0.113, abs=5e-4)  # the unit was right
    assert result["momentum_error"] < 1e-9
    assert abs(result["energy_error"]) < 1e-3
    assert len(list((tmp_path / "frames").glob("*.vtu"))) == 20


def test_gauge_and_vibrometer(tmp_path):
    result = run_quick("gauge_and_vibrometer", tmp_path)
    assert result["error"]["force_by_gauges"] < 0.02
    assert result["error"]["force_by_laser"] < 0.02
    assert result["loudest_frequency_Hz"] == pytest.approx(result["bar_theory_Hz"], rel=5e-3)


def test_choose_accuracy(tmp_path):
    result = run_quick("choose_accuracy", tmp_path)
    for run in result["runs"]:
        assert run["true"]["force"] < run["tolerance"]
        assert max(run["estimated"].values()) < run["tolerance"]
        assert run["true"]["force"] == pytest.approx(run["estimated"]["force"], rel=0.5)
    coarse, fine = result["runs"]
    assert coarse["dofs"] < fine["dofs"]


def test_crank_slider(tmp_path):
    result = run_quick("crank_slider", tmp_path)
    assert result["energy_error"] < 1e-3  # work of the drive against what is stored and dissipated
    assert result["dissipated_J"] > 10
    # Hertz on the masses of the blocks, which the link pushes besides.
    mass, speed, R = 0.16581 * 0.13396 / (0.16581 + 0.13396), 3.4099, 0.010
    hertz = ep.hertz.impact(mass, speed, R, R, ep.STEEL, ep.STEEL).peak_force
    assert hertz < result["peak_force_N"] < 1.15 * hertz
    assert result["first_contact_s"] == pytest.approx(0.2e-3, abs=4e-6)


def test_the_tutorial_runs_from_first_to_last_cell(tmp_path):
    notebook = json.loads((EXAMPLES / "tutorial.ipynb").read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] or cell["execution_count"] for cell in cells)  # stored as it is written
    try:
        import nbclient
        import nbformat
    except ImportError:  # the extra `tutorial` is not installed: the same cells as a script, without a kernel
        script = "\n\n".join("".join(cell["source"]) for cell in cells)
        environment = os.environ | {"MPLBACKEND": "agg"}
        subprocess.run([sys.executable, "-c", script], cwd=tmp_path, env=environment, check=True, timeout=300)
    else:
        resources = {"metadata": {"path": str(tmp_path)}}
        read = nbformat.read(EXAMPLES / "tutorial.ipynb", as_version=4)
        nbclient.NotebookClient(read, timeout=300, resources=resources).execute()


def test_the_list_of_examples_is_complete():
    listed = re.findall(r"^\d+\. \[`?([\w.]+)`?\]\(([\w.]+)\)", (EXAMPLES / "README.md").read_text(), re.M)
    assert all(name == link for name, link in listed)
    assert sorted(name for name, _ in listed) == sorted(
        path.name for path in EXAMPLES.iterdir() if path.suffix in (".py", ".ipynb")
    )


@pytest.mark.parametrize("path", sorted(EXAMPLES.rglob("[a-z]*.py")), ids=lambda path: str(path.relative_to(EXAMPLES)))
def test_examples_can_be_read_at_one_sitting(path):
    """Who learns from an example reads all of it: 40 lines teach something, after 120 readers only skim."""
    assert 40 <= len(path.read_text().splitlines()) <= 120
