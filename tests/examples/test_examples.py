"""The examples as a user runs them, with `--quick`."""

import importlib
import json
import re
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import matplotlib.pyplot as plt
import numpy as np
import pytest
from oracles import LONGEST
from scipy.stats import sobol_indices, uniform

import exudyn_partition as ep
from validation.experiments import tilted_bar

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def check_files(name, folder, printed):
    """Result of a run: what it wrote, beside the picture whose path it printed last."""
    picture = Path(printed.strip().splitlines()[-1])
    assert picture == folder.resolve() / f"{name}.png"
    assert matplotlib.image.imread(picture).std() > 0.05
    return json.loads((folder / "result.json").read_text())


def run_quick(name, folder, capsys, *more):
    """Call an example's `main`; imports of a process of its own would take as long as a small mesh."""
    returned = importlib.import_module(name).main(["--quick", "--out", str(folder), *more])
    plt.close("all")
    result = check_files(name, folder, capsys.readouterr().out)
    assert result == json.loads(json.dumps(returned))
    return result


def check_impact(result):
    """What every example of an impact says of itself."""
    assert result["dofs"] < 150 < result["fe_dofs"]
    assert result["peak_force_N"]
    assert {"time", "steps", "step_s", "versions"} <= set(result)


def test_rod_on_plate_as_a_script(tmp_path):
    """In a process of its own, as the README calls it."""
    command = [sys.executable, str(EXAMPLES / "rod_on_plate.py"), "--quick", "--end-time", "0.34e-3"]
    command += ["--out", str(tmp_path)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True, timeout=LONGEST).stdout
    result = check_files("rod_on_plate", tmp_path, printed)
    assert result["error"]["force"] < 0.01
    assert result["error"]["velocity_p1"] < 0.01
    assert result["error"]["velocity_p2"] < 0.03
    assert result["dofs"] <= 150 < result["fe_dofs"]
    assert result["momentum_error"] < 1e-6
    assert abs(result["energy_error"]) < 1e-3
    # A wave returns from the rod's far end after 0.31 ms; until the plate answers, the force is that of two impedances.
    assert 450 < result["peak_force_N"] < 800
    assert result["time"]["reference_s"] > 50 * result["time"]["online_s"]
    assert set(result["time"]) == {"mesh_s", "fem_s", "reduce_s", "online_s", "reference_s"}


def test_existing_model(tmp_path, capsys):
    result = run_quick("existing_model", tmp_path, capsys)
    assert result["error"]["tip_displacement"] < 1e-3
    assert result["error"]["deflection"] < 0.02
    assert result["largest_deflection_m"] > 1e-4
    assert result["dofs"] < 60 < result["fe_dofs"]
    assert set(result["time"]) == {"reduce_s", "online_s", "cms_reduce_s", "cms_online_s"}


def test_two_spheres(tmp_path, capsys):
    result = run_quick("two_spheres", tmp_path, capsys)
    check_impact(result)
    # A mesh of two to three elements in the radius of contact; whole balls are 1 % stiffer than Hertz's half spaces.
    assert abs(result["error"]["peak_force"]) < 0.04
    assert abs(result["error"]["duration"]) < 0.08
    assert abs(result["error"]["velocity_after"]) < 1e-3
    assert result["momentum_error"] < 1e-9
    assert abs(result["energy_error"]) < 1e-4


def test_newtons_cradle(tmp_path, capsys):
    result = run_quick("newtons_cradle", tmp_path, capsys)
    check_impact(result)
    assert result["error"]["force"] < 0.08
    assert result["error"]["velocity_after"] < 0.01
    assert result["momentum_error"] < 1e-9
    assert abs(result["energy_error"]) < 1e-4


def test_own_part(tmp_path, capsys):
    result = run_quick("own_part", tmp_path, capsys)
    check_impact(result)
    assert result["error"]["mesh_file"] < 1e-6  # the same mesh, written and read
    assert result["mass_kg"] == pytest.approx(0.113, abs=5e-4)  # the unit was right
    assert result["momentum_error"] < 1e-9
    assert abs(result["energy_error"]) < 1e-3
    assert 0.01 < result["taken_by_damping"] < 0.5
    assert len(list((tmp_path / "frames").glob("*.vtu"))) == 20


def test_gauge_and_vibrometer(tmp_path, capsys):
    result = run_quick("gauge_and_vibrometer", tmp_path, capsys)
    check_impact(result)
    assert result["error"]["force_by_gauges"] < 0.02
    assert result["error"]["force_by_laser"] < 0.02
    assert result["loudest_frequency_Hz"] == pytest.approx(result["bar_theory_Hz"], rel=5e-3)


def test_choose_accuracy(tmp_path, capsys):
    result = run_quick("choose_accuracy", tmp_path, capsys)
    check_impact(result)
    for run in result["runs"]:
        assert run["true"]["force"] < run["tolerance"]
        assert max(run["estimated"].values()) < run["tolerance"]
        assert run["true"]["force"] == pytest.approx(run["estimated"]["force"], rel=0.5)
    coarse, fine = result["runs"]
    assert coarse["dofs"] < fine["dofs"]


def test_take_elsewhere(tmp_path, capsys):
    result = run_quick("take_elsewhere", tmp_path, capsys)
    assert result["error"]["force"] < 1e-6
    assert result["peak_force_N"] > 1000
    assert result["dofs"] < 100 < result["fe_dofs"]
    assert {"legend.txt", "mass.mtx", "stiffness.mtx", "contact_pole_flexibility.mtx"} <= {*result["files"]}


@pytest.mark.filterwarnings("ignore:.*the facets do not resolve")  # the quick mesh is coarse
def test_assembly(tmp_path, capsys):
    result = run_quick("assembly", tmp_path, capsys)
    assert result["solids"] == ["crank", "link", "block"]
    assert abs(result["error"]["speed"]) < 0.01
    assert result["peak_force_N"] > 1000
    assert result["dofs"] < 150 < result["fe_dofs"]


def test_crank_slider(tmp_path, capsys):
    result = run_quick("crank_slider", tmp_path, capsys)
    check_impact(result)
    assert result["energy_error"] < 1e-3  # work of the drive against what is stored and dissipated
    assert result["dissipated_J"] > 10
    # Hertz on the masses of the blocks, which the link pushes besides.
    mass, speed, R = 0.16581 * 0.13396 / (0.16581 + 0.13396), 3.4099, 0.010
    hertz = ep.hertz.impact(mass, speed, R, R, ep.STEEL, ep.STEEL).peak_force
    assert hertz < result["peak_force_N"] < 1.15 * hertz
    assert result["first_contact_s"] == pytest.approx(0.2e-3, abs=4e-6)


def test_cam_follower(tmp_path, capsys):
    result = run_quick("cam_follower", tmp_path, capsys)
    assert result["error.force"] < 0.1
    assert result["preload_N"] == pytest.approx(1250, rel=1e-3)  # the spring's force; the run begins at rest
    assert result["parts_at_rad_s"] is None
    assert result["lift_off_speed_rad_s"] > 500


def test_gear_pair(tmp_path, capsys):
    result = run_quick("gear_pair", tmp_path, capsys)
    normal_force = 100 / (40e-3 * np.cos(np.radians(20)))  # torque by the radius of the base circle
    assert result["status"] == ["finished", "finished"]
    assert result["error.force"] < 0.03  # it rings a little
    assert result["crossed_m"] > result["backlash_m"]
    assert result["peak_force_N"] > 2 * normal_force  # a force that comes at once, without a blow, doubles
    # A pair of teeth yields by some 14 N/(mm um), ISO 6336; two pairs bear, and in part one.
    least, most = (way / (normal_force / (8e-3 * 14e9)) for way in result["transmission_error_m"])
    assert 0.5 < least < most < 1.2


def test_the_tutorial_runs_from_first_to_last_cell(tmp_path, monkeypatch):
    notebook = json.loads((EXAMPLES / "tutorial.ipynb").read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] or cell["execution_count"] for cell in cells)  # stored as it is written
    monkeypatch.chdir(tmp_path)
    try:
        import nbclient
        import nbformat
    except ImportError:  # the extra `tutorial` is not installed: the same cells one after the other, without a kernel
        names = {}
        for cell in cells:
            exec("".join(cell["source"]), names)
        plt.close("all")
    else:
        resources = {"metadata": {"path": str(tmp_path)}}
        read = nbformat.read(EXAMPLES / "tutorial.ipynb", as_version=4)
        nbclient.NotebookClient(read, timeout=LONGEST, resources=resources).execute()


def test_the_list_of_examples_is_complete():
    listed = re.findall(r"^\d+\. \[`?([\w.]+)`?\]\(([\w.]+)\)", (EXAMPLES / "README.md").read_text(), re.M)
    assert all(name == link for name, link in listed)
    assert sorted(name for name, _ in listed) == sorted(
        path.name for path in EXAMPLES.iterdir() if path.suffix in (".py", ".ipynb")
    )


PROGRAMS = sorted({*EXAMPLES.rglob("[a-z]*.py")} - {*(EXAMPLES / "site").rglob("*.py")})


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: str(path.relative_to(EXAMPLES)))
def test_examples_can_be_read_at_one_sitting(path):
    """Who learns from an example reads all of it: 40 lines teach something, after 120 readers only skim."""
    assert 40 <= len(path.read_text().splitlines()) <= 120


def test_restitution(tmp_path, capsys):
    slow, fast = run_quick("restitution", tmp_path, capsys)["impacts"]
    assert 0.5 < fast["restitution"] < slow["restitution"] < 0.95
    assert 3 < fast["dent_m"] / slow["dent_m"] < 12  # energy by force: the depth grows about as the speed
    for one in (slow, fast):
        assert one["rebound_share"] + one["vibration_share"] + one["plastic_share"] == pytest.approx(1, abs=1e-3)
        assert one["vibration_share"] > 0


def test_quiet_pin(tmp_path, capsys):
    """With the weight of rigid theory the pin has hardly an impulse; the bending hammer wants less weight."""
    result = run_quick("quiet_pin", tmp_path, capsys)
    lightest, _, rigid = (abs(value) for value in result["impulse_on_pin_Ns"].values())
    assert rigid < 0.25 * lightest
    assert 0.01 < result["weight_kg"] < result["rigid_weight_kg"]
    assert result["force_on_pin_N"]["best"] < 0.5 * result["force_on_pin_N"]["most"]
    _, by_speed = result["relative_sensitivity"]["nose"]
    assert by_speed == pytest.approx(6 / 5, rel=0.05)  # Hertz: as the speed to the 6/5


def test_hammer_test(tmp_path, capsys):
    """The modulus of steel, the ratios that were measured, and frequencies that go with the root of the modulus."""
    result = run_quick("hammer_test", tmp_path, capsys)
    data = importlib.import_module("models.hammer_test")
    assert result["modulus_Pa"] == pytest.approx(201e9, rel=5e-3)  # by modes 2 to 5 of the beam: 200.9 to 201.7 GPa
    np.testing.assert_allclose(result["ratios"], data.RATIOS, rtol=0.02)
    np.testing.assert_allclose(result["frequencies_Hz"], result["by_modes_Hz"], rtol=2.5e-3)
    first, *others = result["difference"]
    assert first < -0.015  # the foam, which also damps this mode
    assert max(map(abs, others)) < 0.01


# The quick mesh is coarse: slow, light heads close three rows. Restitution follows from the bar.
@pytest.mark.filterwarnings("ignore:.* closed rows or fewer:exudyn_partition.errors.ModelLimitWarning")
def test_impact_map(tmp_path, capsys):
    """Arrows have the restitution of the map, and for a light head the slope of a curve through the map."""
    result = run_quick("impact_map", tmp_path, capsys)
    assert (result["impacts"], result["failed"]) == (64, 0)
    assert result["value_error"] < 1e-3
    light = [number for number, (i, _) in enumerate(result["places"]) if i == 1]
    restitution, arrows = np.array(result["restitution"]), np.array(result["arrows"])
    columns, apart = [result["places"][number][1] for number in light], np.log(5.0 / 0.1) / 7
    cubics = np.polyfit(apart * np.arange(4), restitution[:4, columns], 3)  # few rows close: slopes jump a little
    slopes = [np.polyval(np.polyder(cubic), apart) for cubic in cubics.T]
    assert arrows[light, 2].mean() == pytest.approx(np.mean(slopes), rel=0.1)
    assert (np.diff(restitution[:4], axis=0) < 0).all()  # a heavier head leaves more of its energy in the bar
    assert max(map(max, result["contacts"])) > 1
    assert len(ep.Study.load(tmp_path / "quick.jsonl")) == 64


def test_buffer_design(tmp_path, capsys):
    """Both conditions are met exactly, and what does so is near the answer by Hertz."""
    example = importlib.import_module("buffer_design")
    result = run_quick("buffer_design", tmp_path, capsys)
    assert result["success"]
    assert result["impulse"] == pytest.approx(example.IMPULSE, rel=1e-4)
    assert result["duration"] == pytest.approx(example.DURATION, rel=1e-4)
    assert result["modulus_Pa"] == pytest.approx(
        result["hertz"][0], rel=0.15
    )  # which goes with the duration to the -2.5
    assert result["speed_m_s"] == pytest.approx(result["hertz"][1], rel=0.01)
    assert result["peak_force"] == pytest.approx(result["hertz_peak_N"], rel=0.03)
    np.testing.assert_allclose(result["slopes"], [[0.4, 1.2], [0.0, 1.0], [-0.4, -0.2]], rtol=0, atol=0.02)


def test_sobol_indices(tmp_path, capsys):
    """Of the same few points, the laws of Coulomb and Hertz give nearly the same indices as the impacts do."""
    example = importlib.import_module("sobol_indices")
    example.main(["--quick", "--workers", "1", "--out", str(tmp_path)])
    plt.close("all")
    result = check_files("sobol_indices", tmp_path, capsys.readouterr().out)
    ranges = [uniform(low, high - low) for low, high in example.RANGES.values()]

    def by_laws(points):
        laws = ([law[name](x) for name, x in zip(example.RANGES, points, strict=True)] for law in example.LAWS.values())
        return np.array([np.prod(factors, axis=0) for factors in laws])

    indices = sobol_indices(func=by_laws, n=2, dists=ranges, rng=np.random.default_rng(0))
    for i, name in enumerate(example.LAWS):
        for kind, values in (("first order", indices.first_order), ("total", indices.total_order)):
            np.testing.assert_allclose(result[f"{name}, {kind}"]["computed"], values[i], atol=0.03)


def test_exact_indices_are_those_that_many_points_give():
    """With more points, SciPy's estimates go to the closed form of a product."""
    example = importlib.import_module("sobol_indices")
    ranges = [uniform(low, high - low) for low, high in example.RANGES.values()]
    for law in example.LAWS.values():
        indices = sobol_indices(
            func=lambda points, law=law: np.prod(
                [law[name](x) for name, x in zip(example.RANGES, points, strict=True)], axis=0
            )[None],
            n=2**14,
            dists=ranges,
            rng=np.random.default_rng(0),
        )
        first, total = example.expected(law)
        np.testing.assert_allclose(indices.first_order, first, atol=2e-3)
        np.testing.assert_allclose(indices.total_order, total, atol=2e-3)


def test_gym_arm(tmp_path, capsys):
    """The blow has the force that was asked for; a rigid arm needs a smaller torque for it."""
    pytest.importorskip("gymnasium")
    result = run_quick("gym_arm", tmp_path, capsys)
    assert abs(result["error"]["force"]) < 0.1
    assert 1.0 < result["torque_Nm"] / result["rigid_torque_Nm"] < 2.0


def test_the_arm_is_an_environment_of_gymnasium():
    """By the checker that gymnasium brings."""
    env_checker = pytest.importorskip("gymnasium.utils.env_checker")
    model = importlib.import_module("models.gym_arm")
    env_checker.check_env(model.HittingArm(*model.arm(quick=True)), skip_render_check=True)


def test_restitution_map(tmp_path, capsys):
    """Against beam theory, and the rigid model with the law against the flexible bar between the map's points."""
    result = run_quick("restitution_map", tmp_path, capsys, "--workers", "1")
    (found,) = result["impacts"]
    for tilt, e, contacts in zip(found["tilt"], found["restitution"], found["contacts"], strict=True):
        theory = tilted_bar.by_beam_theory(found["length_m"], np.radians(tilt), end=0.4e-3, step=5e-8, elements=40)
        assert e == pytest.approx(tilted_bar.restitution(theory.impulse, 0.0, 0.1, np.radians(tilt)), abs=0.02)
        assert contacts == len(theory.contacts())
    assert abs(np.array(found["balance"])).max() < 1e-3
    assert result["spin_rigid_rad_s"] == pytest.approx(result["spin_flexible_rad_s"], rel=0.02)
    assert result["new"] == 9
