"""Impacts on a grid beside Hertz and Coulomb, where energy goes, files that go on, and what is refused."""

import json
import math
import warnings
from concurrent.futures import ThreadPoolExecutor

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import InputError, ModelLimitWarning, PartitionError, PartitionWarning

R, MATERIAL, MU = 0.010, ep.Material(E=210e9, nu=0.3, rho=7850.0), 0.1
PLANE = ep.RigidPlane()


@pytest.fixture(scope="module")
def ball():
    """On its south pole, with a patch that yields in all directions."""
    refine = [ep.Refine((0, 0, 0), radius=0.4e-3, h=0.15e-3)]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, R), R), MATERIAL, maxh=5e-3, refine=refine)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), radius=0.5e-3, axes="xyz"), f_cut=80e3)


@pytest.fixture(scope="module")
def other():
    """A ball below the plane z = 0."""
    refine = [ep.Refine((0, 0, 0), radius=0.5e-3, h=0.2e-3)]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, -R), R), MATERIAL, maxh=5e-3, refine=refine)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), radius=0.7e-3, axes="xyz"), f_cut=80e3)


@pytest.fixture(scope="module")
def normal(ball):
    return ep.restitution_map((ball, PLANE), speed=(0.2, 0.3, 0.4))


@pytest.fixture(scope="module")
def oblique(ball):
    return ep.restitution_map((ball, PLANE), speed=0.5, angle=np.radians([0, 55, 65]), friction=(0, MU))


def test_a_ball_on_a_plane_rebounds_by_hertz(ball, normal):
    assert normal.shape == (1, 3, 1, 1)
    for i, speed in enumerate(normal.speed):
        hertz = ep.hertz.impact(ball.total_mass, speed, R, math.inf, MATERIAL)
        found = {name: values[0, i, 0, 0] for name, values in normal.values.items()}
        assert found["restitution"] == pytest.approx(1.0, abs=0.01)
        assert found["peak_force"] == pytest.approx(hertz.peak_force, rel=0.02)
        assert found["span"] == found["contact_time"] == pytest.approx(hertz.duration, rel=0.03)
        assert found["impulse"] == pytest.approx(ball.total_mass * speed * (1 + found["restitution"]), rel=1e-3)
        assert found["contacts"] == found["over"] == 1
        assert np.isnan(found["tangential_restitution"])
        assert found["friction_share"] == found["plastic_share"] == found["vibration_second"] == 0


def test_what_a_free_ball_does_not_rebound_with_it_vibrates_with(normal):
    np.testing.assert_allclose(normal["rigid_share"], normal["restitution"] ** 2, atol=1e-6)
    total = normal["rigid_share"] + normal["vibration_first"]
    np.testing.assert_allclose(total - 1, normal["balance"], atol=1e-6)
    np.testing.assert_allclose(normal["balance"], 0, atol=1e-3)


def test_the_centre_of_a_contact_slides_with_the_ball(ball):
    """The ball spins when it leaves; beside its lowest point this would count as normal speed."""
    found = ep.restitution_map((ball, PLANE), speed=10.0, angle=np.arccos(0.03), friction=0.1)
    normal_speed = 0.3
    by_impulse = found["impulse"] / (ball.total_mass * normal_speed) - 1
    np.testing.assert_allclose(found["restitution"], by_impulse, atol=2e-3)


def test_sliding_impacts_are_coulombs_and_turn_the_ball(ball, oblique):
    """Steeper than arctan(7 mu), friction slides to the end: its impulse is mu times the normal one."""
    smooth, rough = ({name: values[0, 0, 1:, k] for name, values in oblique.values.items()} for k in (0, 1))
    np.testing.assert_allclose(smooth["impulse_ratio"], 0)
    np.testing.assert_allclose(smooth["tangential_restitution"], -1, atol=1e-3)  # facets turn the ball a little
    np.testing.assert_allclose(smooth["spin"], 0, atol=1e-3 * oblique.speed[0] / R)
    np.testing.assert_allclose(rough["impulse_ratio"], MU, rtol=5e-3)
    v = oblique.speed[0] * np.sin(oblique.angle[1:])
    lost = MU * rough["impulse"] / ball.total_mass
    np.testing.assert_allclose(rough["centre_tangential"], 1 - lost / v, rtol=2e-3)
    np.testing.assert_allclose(rough["tangential_restitution"], 3.5 * lost / v - 1, atol=5e-3)  # of a solid ball
    np.testing.assert_allclose(-rough["spin"], 2.5 * lost / R, rtol=1e-2)
    away = np.cos(oblique.angle[1:]) * rough["restitution"] * oblique.speed[0]
    np.testing.assert_allclose(np.tan(rough["rebound_angle"]), v * rough["centre_tangential"] / away, rtol=5e-3)
    np.testing.assert_allclose(rough["balance"], 0, atol=1e-3)
    assert (rough["friction_share"] > 0.05).all()


def test_energy_of_an_impact_that_yields_is_counted():
    """A block of aluminium hits a rigid ball."""
    soft = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=100e6, hardening=500e6)
    shape, fine = occ.Box(occ.Pnt(-5e-3, -5e-3, 0), occ.Pnt(5e-3, 5e-3, 8e-3)), ep.Refine((0, 0, 0), 0.5e-3, 0.25e-3)
    fem = ep.fe_model(shape, soft, maxh=4e-3, refine=[fine], grading=0.6)
    part = ep.Partition.ball(fem, (0, 0, 0), 0.6e-3, direction=(0, 0, -1), plastic_radius=0.9e-3)
    pair = ep.reduce(fem, part, f_cut=100e3), ep.RigidSphere((0, 0, -5e-3), 5e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PartitionWarning)  # of a coarse zone
        found = ep.restitution_map(pair, speed=(0.1, 0.5))
    slow, fast = found["restitution"].ravel()
    assert fast < slow < 1
    np.testing.assert_allclose(found["rigid_share"], found["restitution"] ** 2, rtol=2e-2)  # it hardly spins
    assert (found["plastic_share"] > 0.05).all()
    parts = ("rigid", "plastic", "contact", "friction")
    total = sum(found[f"{part}_share"] for part in parts) + found["vibration_first"]
    np.testing.assert_allclose(total, 1, atol=2e-3)
    np.testing.assert_allclose(total - 1, found["balance"], atol=1e-9)


def test_two_balls_exchange_their_speed(ball, other):
    found = ep.restitution_map((ball, other), speed=0.3, duration=150e-6)
    hertz = ep.hertz.impact(ball.total_mass / 2, 0.3, R, R, MATERIAL, MATERIAL)
    assert found["peak_force"].item() == pytest.approx(hertz.peak_force, rel=0.02)
    assert found["restitution"].item() == pytest.approx(1.0, abs=0.01)
    assert found["vibration_second"].item() == pytest.approx(found["vibration_first"].item(), abs=2e-3)


def test_a_file_goes_on_and_a_line_that_was_cut_off_is_computed_again(ball, tmp_path):
    path = tmp_path / "map.jsonl"
    first = ep.restitution_map((ball, PLANE), speed=(0.2, 0.3), file=path)
    assert first.info["new"] == 2
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:2]) + lines[2][:40])
    again = ep.restitution_map((ball, PLANE), speed=(0.2, 0.25, 0.3), file=path)
    assert again.info["new"] == 2
    np.testing.assert_array_equal(again["peak_force"].ravel()[[0, 2]], first["peak_force"].ravel())
    assert ep.restitution_map((ball, PLANE), speed=(0.2, 0.25), file=path).info["new"] == 0
    assert len(path.read_text().splitlines()) == 4


def test_a_file_of_other_bodies_or_of_something_else_is_refused(ball, other, tmp_path):
    path = tmp_path / "map.jsonl"
    ep.restitution_map((ball, PLANE), speed=0.2, file=path)
    with pytest.raises(InputError, match="is of other bodies"):
        ep.restitution_map((other, ep.RigidPlane(normal=(0, 0, -1))), speed=0.2, file=path)
    with pytest.raises(InputError, match="is of other duration"):
        ep.restitution_map((ball, PLANE), speed=0.2, duration=1e-4, file=path)
    for text in ("no json\n", "[1]\n", json.dumps({"study": 9}) + "\n"):
        path.write_text(text)
        with pytest.raises(InputError, match="holds no study"):
            ep.restitution_map((ball, PLANE), speed=0.2, file=path)


def test_a_function_of_place_and_an_executor_of_the_user_give_the_same(ball, normal):
    with ThreadPoolExecutor(1) as executor:
        found = ep.restitution_map(lambda place: (ball, PLANE), speed=normal.speed[:2], place=(1, 2), workers=executor)
    for place in (0, 1):
        np.testing.assert_allclose(found["peak_force"][place].ravel(), normal["peak_force"].ravel()[:2], rtol=1e-9)


def test_processes_give_the_same(ball, normal):
    found = ep.restitution_map((ball, PLANE), speed=normal.speed[:2], workers=2)
    np.testing.assert_allclose(found["peak_force"].ravel(), normal["peak_force"].ravel()[:2], rtol=1e-9)


def test_progress_ends_at_one(ball):
    told = []
    ep.restitution_map((ball, PLANE), speed=(0.2, 0.3), progress=told.append)
    assert told[-1] == 1.0
    assert told == sorted(told)


def test_a_warning_of_impacts_is_told_once_with_their_number(ball):
    """Fast balls reach the edge of their patch."""
    with pytest.warns(PartitionWarning) as caught:
        ep.restitution_map((ball, PLANE), speed=(3.0, 4.0), duration=80e-6)
    assert len(caught) == len({w.category for w in caught})
    assert any(str(w.message).startswith("2 of 2 runs warn, the first: ") for w in caught)


def test_impacts_that_hardly_turn_are_compiled_and_the_same(ball, normal, oblique):
    """What the ball turns by comes from its facets, and from friction, which turns it little until it leaves."""
    assert normal.info["compiled"].all()
    assert oblique.info["compiled"].all()
    exact = ep.restitution_map((ball, PLANE), speed=normal.speed[:1], largest_turn=0.0)
    assert exact.info["compiled"].all()  # in floating frames too
    for name, values in exact.values.items():
        tolerance = {"rtol": 1e-6, "atol": 1e-8} if name != "spin" else {"atol": 1e-3 * exact.speed[0] / R}
        np.testing.assert_allclose(normal[name][:, :1], values, **tolerance)


def test_compiled_impacts_with_friction_are_the_same(ball, oblique):
    exact = ep.restitution_map((ball, PLANE), speed=0.5, angle=oblique.angle[1:2], friction=MU, largest_turn=0.0)
    assert exact.info["compiled"].all()  # in floating frames too, see `test_compiled_moving`
    for name in ("restitution", "tangential_restitution", "impulse_ratio", "peak_force", "friction_share", "spin"):
        np.testing.assert_allclose(oblique[name][:, :, 1:2, 1:], exact[name], rtol=2e-3)


def by_exudyn(velocity, ball, other=None, duration=80e-6):
    """Largest force of an impact in floating frames, by Exudyn's steps."""
    mbs = exu.SystemContainer().AddSystem()
    falls = ep.CreatePartitionBody(
        mbs, ball, frame="floating", initialVelocity=velocity, referencePosition=[0, 0, 4 * -velocity[2] / 2e6]
    )
    met = PLANE if other is None else ep.CreatePartitionBody(mbs, other, frame="floating")
    contact = ep.CreatePartitionContact(mbs, falls, met)
    mbs.Assemble()
    return contact.force(ep.solve_dynamic(mbs, end_time=duration)).max()


def test_impacts_in_which_bodies_turn_are_run_in_floating_frames(ball, other):
    """By compiled steps, on rigid surfaces and of two bodies; here they hit a little beside where those of a map do."""
    velocity = 0.2 * np.array([np.sin(np.radians(50)), 0.0, -np.cos(np.radians(50))])
    for second, met in ((None, PLANE), (other, other)):
        found = ep.restitution_map((ball, met), speed=0.2, angle=np.radians(50), largest_turn=1e-12)
        assert found.info["compiled"].all()
        assert found["peak_force"].item() == pytest.approx(by_exudyn(velocity, ball, second), rel=5e-3)


def test_impacts_whose_pairs_slide_in_contact(ball, other):
    """Pairs that slide as the balls fly apart, or while they touch."""
    found = ep.restitution_map((ball, other), speed=0.3, angle=np.radians([0, 5, 70]), duration=150e-6)
    assert found.info["compiled"].all()
    assert (found["over"] == 1).all()
    np.testing.assert_allclose(found["restitution"], 1.0, atol=0.02)
    velocity = 0.3 * np.array([np.sin(np.radians(70)), 0.0, -np.cos(np.radians(70))])
    assert found["peak_force"].ravel()[2] == pytest.approx(by_exudyn(velocity, ball, other, 150e-6), rel=0.01)


def test_an_impact_that_may_go_on_is_told(ball):
    with pytest.warns(ModelLimitWarning, match="1 of 1 impacts may not be over"):
        ep.restitution_map((ball, PLANE), speed=0.3, duration=1e-6)


def test_a_map_is_stored_and_shown(normal, oblique, tmp_path):
    path = tmp_path / "map.npz"
    oblique.save(path)
    loaded = ep.RestitutionMap.load(path)
    for name, values in oblique.values.items():
        np.testing.assert_array_equal(loaded[name], values)
    table = loaded.to_dataframe()
    assert len(table) == 6
    assert table["peak force [N]"].max() == oblique["peak_force"].max()
    axes = oblique.plot(quantity="impulse_ratio", over="angle")
    assert axes.get_xlabel() == "angle [rad]"
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["friction 0", "friction 0.1"]
    assert normal.plot().get_xlabel() == "speed [m/s]"
    with pytest.raises(InputError, match="quantity: expected"):
        normal.plot(quantity="e")
    with pytest.raises(InputError, match="there is no file"):
        ep.RestitutionMap.load(tmp_path / "none.npz")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"speed": 0.0}, "speed: expected speeds above zero"),
        ({"speed": []}, "speed: expected at least one number"),
        ({"speed": (0.2, 0.2)}, "speed: expected numbers that differ"),
        ({"speed": "fast"}, "speed"),
        ({"speed": 0.2, "angle": 45.0}, r"np\.radians"),
        ({"speed": 0.2, "angle": -0.1}, "angle: expected angles from the normal"),
        ({"speed": 0.2, "friction": -0.1}, "friction: expected coefficients"),
        ({"speed": 0.2, "place": 1.0}, "place: expected none beside given bodies"),
        ({"speed": 0.2, "along": (0, 0, 1)}, "along: expected a direction along the surface"),
        ({"speed": 0.2, "duration": -1.0}, "duration"),
        ({"speed": 0.2, "largest_turn": -1e-3}, "largest_turn: expected an angle in rad, zero or above"),
        ({"speed": 0.2, "workers": 0}, "workers"),
        ({"speed": 0.2, "file": 3}, "file"),
    ],
)
def test_wrong_calls_are_named(ball, options, message):
    with pytest.raises(InputError, match=message):
        ep.restitution_map((ball, PLANE), **options)


def test_wrong_bodies_are_named(ball):
    for wrong in (ball, (ball,), (PLANE, ball), (ball, "plane"), None):
        with pytest.raises(InputError, match=r"bodies.*expected \(ReducedBody"):
            ep.restitution_map(wrong, speed=0.2)
    with pytest.raises(InputError, match=r"bodies\(0\): expected"):
        ep.restitution_map(lambda place: ball, speed=0.2)
    with pytest.raises(InputError, match="touches as it is placed"):
        ep.restitution_map((ball, ep.RigidPlane((0, 0, -1.0))), speed=0.2)


def test_the_point_of_a_failed_impact_is_named(ball):
    with pytest.raises(PartitionError, match=r"at place=0\.0, speed=0\.2,"):
        ep.restitution_map((ball, ep.RigidPlane((0, 0, 1e-3))), speed=0.2)  # they overlap


def test_friction_that_a_patch_does_not_carry_is_refused_before_any_impact(monkeypatch):
    fem = ep.fe_model(occ.Box((-0.01, -0.01, 0), (0.01, 0.01, 0.02)), MATERIAL, maxh=0.01)
    bodies = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), radius=6e-3), f_cut=60e3), PLANE
    monkeypatch.delattr("exudyn_partition.studies.free_impact.solve_dynamic")
    with pytest.raises(InputError, match="friction: needs the residual flexibility of tangential forces"):
        ep.restitution_map(bodies, speed=1.0, friction=(0.0, 0.3), duration=1e-5)
