"""The command that goes from STEP files to an impact: what it writes runs as it stands."""

import ast
import json
import runpy
from types import SimpleNamespace

import netgen.occ as occ
import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.cli import main
from exudyn_partition.cli.impact import script

RADIUS = 5.0  # [mm]
IMPACT = ["--scale", "1e-3", "--speed", "0.3", "--contact=-1e-3,0,0", "--tolerance", "0.1", "--duration", "40e-6"]


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    """A ball of 10 mm on the plane z = 0, in millimetres as STEP files are."""
    path = tmp_path_factory.mktemp("step") / "ball.step"
    occ.Sphere(occ.Pnt(-1, 0, RADIUS), RADIUS).WriteStep(str(path))
    return path


def call(capsys, *arguments):
    """Exit code, what stdout holds as JSON, and stderr."""
    code = main([*map(str, arguments), "--json"])
    out, err = capsys.readouterr()
    return code, json.loads(out), err


def test_a_step_file_becomes_a_script_that_runs(ball, tmp_path, capsys):
    arguments = ["--material", "210e9,0.3,7850", "--normal", "0,0,1", "-o", tmp_path / "out"]
    code, found, err = call(capsys, "impact", ball, *IMPACT, *arguments)
    assert (code, "error" in err) == (0, False)
    material = ep.Material(E=210e9, nu=0.3, rho=7850)
    body = ep.load_body(found["bodies"][0])
    hertz = ep.hertz.impact(body.total_mass, 0.3, 1e-3 * RADIUS, np.inf, material)
    assert found["peak_force_N"] == pytest.approx(hertz.peak_force, rel=0.1)
    assert found["estimated_error"]["total"] <= 0.1 / 1.25
    assert "How it was designed" in (tmp_path / "out" / "impact.html").read_text()
    # Anywhere else too: the script finds its bodies beside it.
    (tmp_path / "out").rename(tmp_path / "elsewhere")
    script = tmp_path / "elsewhere" / "impact.py"
    runpy.run_path(str(script), run_name="__main__")
    assert f"peak force {found['peak_force_N']:.4g} N" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "source: expected two STEP files, or one and --normal of a rigid plane, got 1 and no --normal"),
        (["--normal", "0,0,1", "--material", "steel", "--material", "steel"], "--material: expected one, or one for"),
    ],
)
def test_wrong_calls_are_named(ball, tmp_path, capsys, arguments, message):
    code, found, err = call(capsys, "impact", ball, *IMPACT, "--material", "steel", "-o", tmp_path / "o", *arguments)
    assert (code, found["error"]) == (2, "CallError")
    assert message in err
    assert not (tmp_path / "o").exists()


def test_a_point_that_is_none_is_refused(ball, tmp_path):
    with pytest.raises(SystemExit):
        main(["impact", str(ball), "--material", "steel", "--speed", "1", "--contact", "0,0", "-o", str(tmp_path)])


@pytest.mark.parametrize("name", ["ball_\U0001f600", "a\\N", 'a"""b', "it's", 'ends with "', "{x}"])
def test_any_name_of_a_file_stands_in_the_script(name):
    place = SimpleNamespace(points=np.zeros((2, 3)), normal=np.array([0.0, 0.0, -1.0]))
    design = SimpleNamespace(place=place, speed=1.0, duration=1e-4, error=0.01, step=1e-7)
    tree = ast.parse(script(design, [name, "other"], None))
    assert ast.get_docstring(tree).startswith(f"Impact of {name} on other at 1 m/s")
    texts = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    assert {name, f"{name}.npz"} <= set(texts)
