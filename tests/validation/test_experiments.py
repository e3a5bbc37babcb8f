"""The theories of the experiments against the numbers that other programs gave, and what the data files say."""

import json
from pathlib import Path

import numpy as np
import pytest

import exudyn_partition as ep
from validation import trust
from validation.experiments import ball_on_beam, beam_theory, cgs1, common, half_spaces, tilted_bar, zener, zener_theory

FILES = sorted(common.DATA.glob("*.json"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_data_say_where_they_are_from_their_units_and_how_sure_they_are(path):
    data = json.loads(path.read_text())
    assert data.keys() >= {"title", "source", "kind", "setup", "units", "uncertainty"}
    assert all(isinstance(source, str) and source for source in data["source"])
    assert data["kind"].split()[0] in ("derived", "measured", "published")


def test_each_benchmark_has_data_and_a_figure():
    scripts = {path.stem for path in Path(common.__file__).parent.glob("*.py")}
    assert {path.stem for path in FILES} <= scripts
    for path in FILES:
        assert path.parents[1].joinpath(f"{path.stem}.png").exists()


@pytest.mark.parametrize("row", tilted_bar.DATA["rows"][::3], ids=lambda row: f"{row['length_m']}, {row['degrees']}")
def test_beam_theory_gives_the_restitution_and_the_contacts_of_a_tilted_bar(row):
    angle = np.radians(row["degrees"])
    found = tilted_bar.by_beam_theory(row["length_m"], angle, end=0.6e-3, step=5e-8, elements=60)
    assert tilted_bar.restitution(found.impulse, 0.0, row["length_m"], angle) == pytest.approx(row["e"], abs=1e-3)
    assert len(found.contacts()) == row["contacts"]
    assert found.force.max() == pytest.approx(row["peak_N"], rel=2e-3)
    assert 1e6 * found.contacts()[-1][1] == pytest.approx(row["end_us"], rel=1e-3)


def test_friction_that_slides_all_the_time_takes_its_coefficient_of_the_impulse():
    """A steep fast slip: the tip's spring has no time to stick."""
    omega, normal, along = np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 1.0])
    found = beam_theory.impact(omega, normal, [-1.0, 50.0], 1e6, 0.1, 1e-6, along=along, friction=0.2, ratio=0.8)
    assert found.impulse == pytest.approx(2.0, rel=1e-3)  # a mass of one on a spring that loses nothing
    assert found.impulse_along / found.impulse == pytest.approx(-0.2, rel=1e-2)


def test_beam_theory_gives_the_contacts_of_a_ball_on_a_beam():
    row = ball_on_beam.DATA["rows"][0]
    found, mass = ball_on_beam.by_beam_theory(row["length_m"], row["radius_m"], 3e-4)
    assert found.contacts()[0] == pytest.approx(row["contacts"][0], rel=2e-3, abs=1e-6)
    assert found.impulse / (mass * ball_on_beam.SPEED) - 1 == pytest.approx(row["e"], abs=1e-3)


def test_zeners_theory_is_that_of_the_table():
    assert zener.off_table() < 1e-4
    for row in zener.DATA["rows"]:
        found = zener_theory.impact(zener.BALL, zener.PLATE, zener.RADIUS, row["thickness_m"], row["speed_m_s"])
        assert found.e == pytest.approx(row["e"], abs=1e-4)
        assert found.force == pytest.approx(row["peak_N"], rel=1e-3)


def test_the_table_of_trust_is_that_of_the_stored_results():
    assert trust.table() in trust.PAGE.read_text()


def test_surfaces_of_equal_bodies_do_not_slip_by_the_normal_force():
    """Sideways motions by normal forces are the same on both, so that coupling changes nothing."""
    steel = ep.Material(E=210e9, nu=0.3, rho=7800.0)
    both = [
        half_spaces.impact(0.01, 0.03, (steel, steel), (0.1, 0.2), 0.3, coupled=coupled)["patch"]
        for coupled in (True, False)
    ]
    assert both[0] == pytest.approx(both[1], abs=1e-9)


def test_half_spaces_slide_by_coulomb():
    """Steep impacts of a ball: e_t = 1 - 2 mu / tan(a)."""
    steel = ep.Material(E=210e9, nu=0.3, rho=7800.0)
    found = half_spaces.impact(0.01, 0.03, (steel, steel), (1.0, 0.3), 0.1, coupled=False)
    assert found["centre"] == pytest.approx(1.0 - 2 * 0.1 * 0.3, rel=2e-3)
    assert found["normal"] == pytest.approx(0.3, rel=1e-3)


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.MeshQualityWarning")
def test_a_cylinder_on_a_block_carries_the_whole_load():
    """Its rows begin to slide in a load step, in which Newton's method settles slowly, and shorter ones follow."""
    half_width, pressure = cgs1.hertz()
    found, _ = cgs1.pressed(half_width, 0.3 * half_width)
    assert found["force_N_m"] == pytest.approx(cgs1.FORCE, rel=1e-6)
    assert found["half_width_m"] == pytest.approx(half_width, rel=0.02)
    assert found["pressure_Pa"] == pytest.approx(pressure, rel=0.02)
