"""The command that lets a part of a STEP file fall: what it writes, and that the numbers are those of mechanics."""

import json
import runpy

import netgen.occ as occ
import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.cli import main
from exudyn_partition.meshing.mesh_size import first_size

pytestmark = pytest.mark.filterwarnings("ignore")  # of coarse meshes, and of stresses
SIZE = (12.0, 9.0, 6.0)  # [mm]
DROP = ["--drop", "0.05", "--floor"]


@pytest.fixture(scope="module")
def part(tmp_path_factory):
    """A block in millimetres, as STEP files are."""
    path = tmp_path_factory.mktemp("step") / "part.step"
    occ.Box((0, 0, 0), SIZE).WriteStep(str(path))
    return path


def call(capsys, *arguments):
    """Exit code, what stdout holds as JSON, and stderr."""
    code = main([*map(str, arguments), "--json"])
    out, err = capsys.readouterr()
    return code, json.loads(out), err


def test_one_line_from_a_step_file_to_force_scene_and_report(part, tmp_path, capsys):
    out = tmp_path / "out"
    options = ["--maxh", "4e-3", "--f-cut", "60e3", "--duration", "60e-6", "--turn", "20,10,0", "-o", out]
    code, found, err = call(capsys, "impact", part, *DROP, *options)
    assert (code, "error" in err) == (0, False)
    mass = 7800 * np.prod(SIZE) * 1e-9
    assert found["mass_kg"] == pytest.approx(mass, rel=1e-6)
    assert found["speed_m_s"] == pytest.approx(np.sqrt(2 * 9.81 * 0.05))
    t, force = np.loadtxt(out / "force.csv", delimiter=",", skiprows=1).T
    assert found["peak_force_N"] == pytest.approx(force.max())
    assert force.max() > 10.0
    change = mass * (found["velocity_after_m_s"][2] + found["speed_m_s"] + 9.81 * t[-1])
    assert found["impulse_N_s"] == pytest.approx(change, rel=1e-4)  # vertical force by the trapezoidal rule
    assert "Drop of part from 0.05 m" in (out / "drop.html").read_text()
    assert "<canvas" in (out / "scene.html").read_text()
    assert ep.load_body(found["body"]).partition.patches[0].name == "skin"
    # Anywhere else too: the script finds its body beside it.
    out.rename(tmp_path / "elsewhere")
    script = tmp_path / "elsewhere" / "drop.py"
    runpy.run_path(str(script), run_name="__main__")
    assert f"peak force {found['peak_force_N']:.4g} N" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--drop", "0.5"], "--drop: expected --floor"),
        ([*DROP, "--speed", "1"], "--speed: belongs to an impact at a known point, not to --drop"),
        ([*DROP, "--material", "steel", "--material", "steel"], "--material: expected one for --drop, got 2"),
        (["--floor", "--material", "steel"], "--speed: expected one, of approach [m/s]. Or take --drop"),
        (["--speed", "1"], "--material: expected one"),
    ],
)
def test_wrong_calls_are_named(part, tmp_path, capsys, arguments, message):
    code, found, err = call(capsys, "impact", part, "-o", tmp_path / "o", *arguments)
    assert (code, found["error"]) == (2, "CallError")
    assert message in err
    assert not (tmp_path / "o").exists()


def test_two_parts_do_not_fall(part, tmp_path, capsys):
    code, found, _ = call(capsys, "impact", part, part, *DROP, "-o", tmp_path / "o")
    assert (code, found["message"]) == (2, "source: expected one STEP file for --drop, got 2")


def test_options_of_a_drop_alone(part, tmp_path, capsys):
    known = ["--material", "steel", "--speed", "1", "--contact", "0,0,0", "-o", tmp_path / "o"]
    code, found, _ = call(capsys, "impact", part, *known, "--turn", "1,2,3")
    assert (code, found["message"]) == (2, "--turn: belongs to --drop, give it with a height")


def test_a_negative_friction_is_refused(part):
    with pytest.raises(SystemExit):
        main(["impact", str(part), *DROP, "--friction=-0.1"])


def test_elements_are_as_large_as_walls_ask(part):
    """Of a thin plate twice its thickness, within bounds by the diagonal of others."""
    plate, thick = (100.0, 80.0, 4.0), 100.0
    diagonal, area = np.linalg.norm(plate), 2 * (100 * 80 + 100 * 4 + 80 * 4)
    assert first_size(diagonal, np.prod(plate), area) == pytest.approx(8.0, rel=0.1)
    cube = thick * np.sqrt(3)
    assert first_size(cube, thick**3, 6 * thick**2) == pytest.approx(cube / 12)
    assert first_size(cube, 1e-3 * thick**3, 6 * thick**2) == pytest.approx(cube / 60)


def test_the_mesh_is_fine_where_a_round_part_lands(tmp_path, capsys):
    """By Hertz, of a ball that is turned somehow; elements of its first mesh are ten times the contact."""
    source, radius = tmp_path / "ball.step", 5e-3
    occ.Sphere(occ.Pnt(1, 2, 3), 1e3 * radius).WriteStep(str(source))
    options = ["--maxh", "3e-3", "--duration", "60e-6", "--turn", "20,35,10", "-o", tmp_path / "out"]
    _, found, _ = call(capsys, "impact", source, *DROP, *options)
    right = ep.hertz.impact(found["mass_kg"], found["speed_m_s"], radius, np.inf, ep.STEEL)
    assert found["maxh_at_landing_m"] < right.contact_radius < 0.1 * found["maxh_m"]
    assert found["peak_force_N"] == pytest.approx(right.peak_force, rel=0.04)
    assert found["impulse_N_s"] == pytest.approx(2 * found["mass_kg"] * found["speed_m_s"], rel=0.02)
