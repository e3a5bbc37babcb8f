"""The command line as a user calls it: what it prints, writes and returns."""

import json
import math
import re
import subprocess
import sys

import netgen.occ as occ
import numpy as np
import pytest
from oracles import LONGEST, without_numba

import exudyn_partition as ep
from exudyn_partition.cli import commands, doctor, main

BLOCK = ["--material", "steel", "--scale", "1e-3", "--maxh", "5e-3", "--at", "0", "0", "0.03", "--radius", "6e-3"]


@pytest.fixture(scope="module")
def step_file(tmp_path_factory):
    """A block of 10 x 20 x 30 mm, in millimetres as STEP files are."""
    path = tmp_path_factory.mktemp("step") / "block.step"
    occ.Box(occ.Pnt(-5, -10, 0), occ.Pnt(5, 10, 30)).WriteStep(str(path))
    return path


def call(capsys, *arguments):
    """Exit code, what stdout holds as JSON, and stderr."""
    code = main([*map(str, arguments), "--json"])
    out, err = capsys.readouterr()
    return code, json.loads(out), err


def test_a_step_file_in_millimetres_becomes_a_body(step_file, tmp_path, capsys, block, top):
    out = tmp_path / "block.npz"
    code, found, err = call(capsys, "reduce", step_file, *BLOCK, "--f-cut", "80e3", "-o", out)
    assert (code, err) == (0, "")
    expected, body = ep.reduce(block, top, f_cut=80e3), ep.load_body(out)
    assert found["mass_kg"] == pytest.approx(7800 * 0.01 * 0.02 * 0.03, rel=1e-9)
    np.testing.assert_allclose(found["size_m"], [0.01, 0.02, 0.03])
    assert found["dofs"] == body.n_dofs == sum(found["kept"].values())
    np.testing.assert_allclose(body.basis.omega[6:15], expected.basis.omega[6:15], rtol=0.02)
    assert found["patches"][0]["outward_normal"] == pytest.approx([0, 0, 1])
    assert found["left_out"] == list(body.left_out)
    # `info` reads the same from the file.
    code, again, _ = call(capsys, "info", out)
    assert code == 0
    assert again.items() <= found.items()
    code, table, _ = call(capsys, "info", out, "--table")
    assert table["coordinates"] == list(body.labels)
    assert main(["info", str(out)]) == 0
    assert "name none, nodes" in " ".join(capsys.readouterr().out.split())
    # Without its inside it is the same body in a smaller file, which says so.
    light = tmp_path / "light.npz"
    _, found, _ = call(capsys, "reduce", step_file, *BLOCK, "--f-cut", "80e3", "--no-inside", "-o", light)
    assert found["left_out"] == list(ep.load_body(light).left_out) != list(body.left_out)
    np.testing.assert_array_equal(ep.load_body(light).basis.shapes, body.without_inside().basis.shapes)
    assert light.stat().st_size < out.stat().st_size


def test_two_patches_and_a_tolerance(step_file, tmp_path, capsys):
    more = ["--at", 0, 0, 0, "--name", "top", "--name", "foot", "--tolerance", 0.05, "--speed", 0.5]
    code, found, err = call(capsys, "reduce", step_file, *BLOCK, *more, "-o", tmp_path / "b.npz")
    assert code == 0
    assert [patch["name"] for patch in found["patches"]] == ["top", "foot"]
    assert found["patches"][1]["centre_m"] == pytest.approx([0, 0, 0], abs=2e-3)
    reached = max(found["estimated_error"].values()) < 0.05
    assert reached or err.startswith("warning: ")  # the mesh is too coarse for more, which is said


def test_a_wrong_number_of_radii(step_file, tmp_path, capsys):
    arguments = ["reduce", step_file, *BLOCK, "--radius", 1e-3, "--radius", 1e-3, "--f-cut", 8e4, "-o", tmp_path / "b"]
    code, found, err = call(capsys, *arguments)
    assert (code, found["error"]) == (2, "CallError")
    assert "--radius: expected one, or one for each of 1 --at, got 3" in err


def test_an_estimate_is_hertz_s(capsys):
    balls = ["estimate", "--speed", 0.5, "--first", 0.0327, 0.01, "steel", "--second", 0.0327, 0.01, "steel"]
    code, found, err = call(capsys, *balls)
    hertz = ep.hertz.impact(0.0327 / 2, 0.5, 0.01, 0.01, ep.STEEL, ep.STEEL)
    assert code == 0
    assert found["peak_force_N"] == pytest.approx(hertz.peak_force)
    assert found["contact_radius_m"] == pytest.approx(hertz.contact_radius)
    assert found["duration_s"] == pytest.approx(hertz.duration)
    assert found["f_cut_Hz"] == pytest.approx(hertz.truncation_frequency())
    assert found["step_s"] == pytest.approx(1 / (25 * found["f_cut_Hz"]))
    assert found["yield_ratio"] == pytest.approx(hertz.yield_ratio)
    assert (found["yield_force_N"], found["yield_speed_m_s"]) == pytest.approx((hertz.yield_force, hertz.yield_speed))
    assert err.startswith("warning: the von Mises stress of the first body reaches")


@pytest.mark.parametrize(("material", "told"), [("210e9,0.3,7800,20e9", False), ("210e9,0.3,7800", True)])
def test_an_estimate_below_first_yield_or_of_unknown_strength(capsys, material, told):
    code, found, err = call(capsys, "estimate", "--speed", 0.5, "--first", 0.0327, 0.01, material)
    assert (code, err) == (0, "")
    assert ("left_out" in found) == told
    assert ("yield_ratio" in found) != told


@pytest.mark.parametrize(("material", "message"), [
    ("210e9,0.3,7800,355", "yield_stress: solids yield at .* Is it in MPa"), ("210e9,0.3,7800,3,55", "or with a yield"),
])  # fmt: skip
def test_wrong_yield_stresses_are_named(capsys, material, message):
    code, found, _ = call(capsys, "estimate", "--speed", 0.5, "--first", 0.0327, 0.01, material)
    assert code == 2
    assert re.search(message, found["message"])


def test_an_estimate_of_a_body_file_against_a_rigid_wall(capsys, tmp_path, bodies):
    bodies[0].save(tmp_path / "ball.npz")
    code, found, _ = call(capsys, "estimate", "--speed", 1, "--first", tmp_path / "ball.npz", 0.01, "210e9,0.3,7800")
    hertz = ep.hertz.impact(bodies[0].total_mass, 1.0, 0.01, math.inf, ep.STEEL)
    assert (code, found["peak_force_N"]) == (0, pytest.approx(hertz.peak_force))


def test_an_estimate_without_end_is_valid_json(capsys):
    rod = ["estimate", "--speed", 1, "--first", "inf", 0.01, "steel", "--impedance", 1000]
    code, found, _ = call(capsys, *rod)
    assert code == 0
    assert found["duration_s"] is None
    assert found["peak_force_N"] == pytest.approx(1000, rel=1e-3)


def test_the_doctor_finds_an_installation_that_works():
    """In a process of its own, as `python -m`: stdout holds JSON and nothing that Exudyn prints."""
    command = [sys.executable, "-m", "exudyn_partition", "doctor", "--json"]
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True, timeout=LONGEST).stdout)
    assert found["self_test"]["passed"]
    assert abs(found["self_test"]["errors"]["momentum"]) < 1e-9
    assert found["versions"]["exudyn"] == ep.versions()["exudyn"]
    assert "numba" in found["contact_loops"]


def test_the_doctor_says_that_numpy_does_the_work_of_numba():
    with without_numba():
        assert doctor.contact_loops().startswith("NumPy")


def test_the_doctor_says_what_is_missing(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ngsolve", None)
    code, found, _ = call(capsys, "doctor")
    assert code == 1
    ((name, reason),) = found["missing"].items()
    assert name.startswith("ngsolve")
    assert "ngsolve" in reason
    assert found["install"] == f'pip install --upgrade "{name}"'
    assert "self_test" not in found


def test_a_self_test_that_fails_fails(monkeypatch, capsys):
    """Told half the stiffness, Hertz's peak is further off than a mesh can be."""
    real, soft = doctor.impact, ep.Material(E=105e9, nu=0.3, rho=7800.0)
    monkeypatch.setattr(doctor, "impact", lambda *scene: real(*scene[:-1], soft))
    code, found, _ = call(capsys, "doctor")
    assert (code, found["self_test"]["passed"]) == (1, False)


def test_errors_go_to_stderr_and_warnings_too(tmp_path, capsys):
    assert main(["info", str(tmp_path / "nothing.npz")]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: path: expected a saved reduced body, but there is no file")
    huge = tmp_path / "huge.step"
    occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(10, 20, 30)).WriteStep(str(huge))
    arguments = ["reduce", huge, "--material", "steel", "--maxh", 10, "--at", 5, 10, 30, "--radius", 8, "--f-cut", 60]
    *_, err = call(capsys, *arguments, "-o", tmp_path / "b.npz")
    assert "warning: the body is 30 long and weighs" in err
    assert "scale=1e-3" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "the following arguments are required"),
        (["reduce", "x.step"], "-o/--out, --material, --at, --radius"),
        (["reduce", "x.step", "--material", "gold"], "expected steel, aluminium or E,nu,rho such as 210e9,0.3,7800"),
        (["estimate", "--speed", "fast", "--first", "1", "1", "steel"], "expected a number above zero, got 'fast'"),
        (["estimate", "--speed", "-1", "--first", "1", "1", "steel"], "expected a number above zero, got '-1'"),
        (["reduce", "x.step", "--f-cut", "nan"], "expected a number above zero, got 'nan'"),
    ],
)
def test_wrong_calls_end_with_2(arguments, message, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("first", "message"),
    [
        (["1", "0.01", "gold"], "--first: expected MASS RADIUS MATERIAL, .* got 'gold'"),
        (["1", "0.01", "rigid"], "--first: expected a material, only the second body may be rigid"),
        (["-1", "0.01", "steel"], "--first: expected MASS RADIUS MATERIAL, .* above zero, got '-1'"),
        (["1", "0", "steel"], "--first: expected MASS RADIUS MATERIAL, .* above zero, got '0'"),
    ],
)
def test_bodies_of_an_estimate_that_are_none_end_with_2(first, message, capsys):
    code, found, _ = call(capsys, "estimate", "--speed", 1, "--first", *first)
    assert (code, found["error"]) == (2, "CallError")
    assert re.match(message, found["message"])


@pytest.mark.parametrize("command", [[], ["reduce"], ["info"], ["estimate"], ["doctor"]])
def test_help_has_examples_that_parse(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([*command, "--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    examples = text.split("examples:")[1].replace("\\\n", " ").splitlines()
    calls = [line.split()[1:] for line in examples if line.strip().startswith("exudyn-partition")]
    assert calls
    for call_ in calls:
        commands.parser().parse_args(call_)


def test_a_table_is_readable(capsys):
    assert main(["estimate", "--first", "0.03", "0.01", "steel", "--speed", "1"]) == 0
    lines = dict(line.split("  ", 1) for line in capsys.readouterr().out.splitlines())
    assert float(lines["peak force [N]"]) > 100
    assert float(lines["contact radius [m]"]) < 1e-3
    assert float(lines["step [s]"]) < 1e-6


def test_a_source_is_not_replaced_by_its_body(step_file, tmp_path, capsys, monkeypatch):
    """It was, after the whole reduction: -o block.step."""
    content, link = step_file.read_bytes(), tmp_path / "link.npz"
    link.symlink_to(step_file)
    monkeypatch.setattr(commands, "fe_model", None)  # nothing is meshed
    for out in (step_file, step_file.parent / ".." / step_file.parent.name / step_file.name, link):
        code, found, _ = call(capsys, "reduce", step_file, *BLOCK, "--f-cut", 8e4, "-o", out)
        assert (code, found["error"]) == (1, "InputError")
        assert "is the source itself" in found["message"]
    assert step_file.read_bytes() == content


@pytest.mark.parametrize(
    ("out", "kind"),
    [("/proc/body.npz", "OutputError"), ("/dev/full", "InputError"), (".", "InputError"), ("no/b.npz", "InputError")],
)
def test_what_cannot_be_written_is_told_before_the_work(step_file, capsys, monkeypatch, tmp_path, out, kind):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(commands, "fe_model", None)
    code, found, err = call(capsys, "reduce", step_file, *BLOCK, "--f-cut", 8e4, "-o", out)
    assert (code, found["error"]) == (1, kind)
    assert err.startswith("error: --out: ")


@pytest.mark.parametrize("x", ["-0.005", "-5e-3", "-5E-03", "-.005"])
def test_points_may_have_negative_coordinates(step_file, block, tmp_path, capsys, monkeypatch, x):
    """They are no options: the body has no node near the point, which the message repeats."""
    monkeypatch.setattr(commands, "fe_model", lambda *arguments, **options: block)
    arguments = ["reduce", step_file, "--material", "steel", "--at", x, 0, x, "--radius", 1e-6, "--f-cut", 8e4]
    code, found, _ = call(capsys, *arguments, "-o", tmp_path / "b.npz")
    assert (code, found["error"]) == (1, "EmptyRegionError")
    assert "of (-0.005, 0, -0.005)" in found["message"]


def test_a_point_that_is_none(step_file, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(commands, "fe_model", None)
    arguments = ["reduce", step_file, "--material", "steel", "--at", "nan", 0, 0, "--radius", 1, "--f-cut", 1]
    code, found, _ = call(capsys, *arguments, "-o", tmp_path / "b.npz")
    assert (code, found["message"]) == (1, "--at: expected finite numbers, got nan at index (0,)")


def test_nobody_reads_what_is_printed():
    material = "210e9,0.3,7800"
    command = [sys.executable, "-m", "exudyn_partition", "estimate", "--first", "1", "0.01", material, "--speed", "1"]
    with open("/dev/full", "w") as full:  # noqa: PTH123
        run = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=LONGEST)
    assert run.returncode == 1
    assert run.stderr == "error: the result could not be printed: No space left on device\n"
