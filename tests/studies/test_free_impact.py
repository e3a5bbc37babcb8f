"""What is measured of an impact, on motions that are known."""

from types import SimpleNamespace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.frames.floating import FloatingKinematics
from exudyn_partition.frames.inertial import InertialKinematics
from exudyn_partition.studies.free_impact import free_impact, is_over, rigid_spin, speed_ratio, vibration_energy
from exudyn_partition.studies.impact_setup import Point

VELOCITY, SPIN = np.array([0.3, -0.2, 0.1]), np.array([10.0, -20.0, 30.0])


def moving(body, frame, modes=0.0):
    """The body at its place; at the end it flies, spins, and its modes have this speed."""
    q_t = np.zeros(body.n_dofs)
    if frame == "floating":
        kinematics = FloatingKinematics(body, np.zeros(3), np.zeros(3))
        q_t[:3], q_t[3:6], q_t[6:] = VELOCITY, SPIN, modes
    else:
        kinematics = InertialKinematics(body, np.zeros(3))
        q_t[6:] = modes
        q_t += body.rigid @ np.r_[VELOCITY, SPIN]
    q = np.zeros((2, body.n_dofs))
    motion = np.array([0 * q_t, q_t])
    return SimpleNamespace(
        kinematics=kinematics,
        coordinates=lambda ends: q,
        coordinates_t=lambda ends: motion,
        energy=lambda ends: kinematics.kinetic_energy(q, motion),
    )


def test_spin_about_each_axis(round_body, frame):
    np.testing.assert_allclose(rigid_spin(moving(round_body, frame), None), SPIN, rtol=1e-9)


def test_vibration_is_what_a_rigid_body_of_the_same_momenta_lacks(round_body, frame):
    """Modes are orthogonal to rigid motion and of unit mass."""
    assert len(round_body.basis.omega) == round_body.n_dofs
    expected = 0.5 * (round_body.n_dofs - 6) * 0.02**2
    np.testing.assert_allclose(
        vibration_energy(moving(round_body, frame, 0.02), None), [0, expected], rtol=1e-6, atol=1e-15
    )


@pytest.mark.parametrize("sign", [1, -1])
def test_a_ratio_to_nothing_is_not_defined(sign):
    assert speed_ratio(0.3, sign * 0.2, 1.0) == pytest.approx(sign * 1.5)
    assert np.isnan(speed_ratio(0.3, sign * 1e-12, 1.0))


@pytest.mark.filterwarnings("ignore")
def test_the_impulse_along_the_surface_does_not_depend_on_which_body_is_named_first(round_body, flat_body):
    """Friction slows what slides, so that its impulse is the friction's coefficient times the normal one."""
    point = Point(0.0, 0.5, np.radians(60.0), 0.1)
    for pair in ((round_body, flat_body), (flat_body, round_body)):
        found = free_impact(pair, point, np.array([1.0, 0, 0]), 20e-6)
        assert found["impulse_ratio"] == pytest.approx(0.1, rel=0.02)
        lost = found["impulse_ratio"] * found["impulse"] * sum(1 / body.total_mass for body in pair)
        assert found["centre_tangential"] == pytest.approx(1 - lost / (0.5 * np.sin(np.radians(60.0))), abs=1e-3)


@pytest.mark.filterwarnings("ignore")
def test_restitution_does_not_depend_on_how_long_a_body_that_spins_is_watched(round_body):
    """Nothing acts on the ball after the contact."""
    point = Point(0.0, 0.5, np.radians(65.0), 0.2)
    short, long = (
        free_impact((round_body, ep.RigidPlane()), point, np.array([1.0, 0, 0]), lasts) for lasts in (1e-4, 2e-3)
    )
    assert abs(short["spin"]) > 10
    for name in ("restitution", "tangential_restitution"):
        assert long[name] == pytest.approx(short[name], abs=1e-3)


@pytest.mark.filterwarnings("ignore")
def test_an_impact_is_watched_until_it_is_over(round_body):
    """Also where the time that was asked for ends within the contact."""
    pair, point = (round_body, ep.RigidPlane()), Point(0.0, 0.3, 0.0, 0.0)
    whole, cut = (free_impact(pair, point, None, lasts) for lasts in (1e-4, 2.5e-5))
    assert whole["contact_time"] > 2.5e-5
    assert whole["over"] == cut["over"] == 1
    for name in ("restitution", "contact_time", "impulse"):
        assert cut[name] == pytest.approx(whole[name], rel=1e-6)


@pytest.mark.filterwarnings("ignore")
def test_a_frame_that_does_not_move_changes_restitution_by_no_more_than_the_body_turns():
    """A bar that falls on its edge, tilted, spins after the impact."""
    lasts, turn = 60e-6, 5e-3
    fem = ep.fe_model(_tilted_bar(), ep.STEEL, maxh=4e-3, refine=[ep.Refine((0, 0, 0), 0.6e-3, 0.3e-3)])
    bar = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 0.9e-3, direction=(0, 0, -1)), f_cut=60e3)
    pair, point = (bar, ep.RigidPlane()), Point(0.0, 0.5, 0.0, 0.0)
    fixed, floating = (free_impact(pair, point, None, lasts, largest) for largest in (turn, 0.0))
    assert (fixed["compiled"], floating["compiled"]) == (1.0, 1.0)
    turned = abs(floating["spin"]) * floating["span"]
    assert 1e-4 < turned < turn
    assert 1e-6 < abs(fixed["restitution"] - floating["restitution"]) < 0.6 * turned


def _tilted_bar():
    """A bar with a round end, tilted by 40 degrees, on its lowest point, the origin."""
    radius, tilt = 3e-3, np.radians(40.0)
    axis = (np.sin(tilt), 0.0, np.cos(tilt))
    end = occ.Sphere(occ.Pnt(0, 0, radius), radius)
    return end + occ.Cylinder(occ.Pnt(0, 0, radius), occ.Vec(*axis), r=radius, h=20e-3)


def test_bodies_that_are_drawn_a_little_within_each_other_begin_apart(round_body):
    """The same impact follows: a start within each other would be refused, or give its stored energy to the rebound."""
    point = Point(0.0, 2.0, 0.0, 0.0)
    drawn, within = (
        free_impact((round_body, ep.RigidPlane((0, 0, overlap))), point, None, 5e-5) for overlap in (0.0, 1.5e-6)
    )
    assert abs(within["balance"]) < 1e-3
    for name in ("restitution", "contact_time", "peak_force", "impulse"):
        assert within[name] == pytest.approx(drawn[name], rel=3e-3)


@pytest.mark.filterwarnings("ignore")
def test_restitution_of_two_bodies_is_that_of_their_impulse(round_body, flat_body):
    """Newton's: m1 m2 / (m1 + m2) times the change of the speed against each other."""
    found = free_impact((round_body, flat_body), Point(0.0, 0.4, 0.0, 0.0), None, 5e-5)
    m1, m2 = round_body.total_mass, flat_body.total_mass
    expected = m1 * m2 / (m1 + m2) * 0.4 * (1 + found["restitution"])
    assert found["impulse"] == pytest.approx(expected, rel=1e-3)


@pytest.mark.filterwarnings("ignore")
def test_the_span_of_an_impact_is_from_its_first_contact_to_its_last(round_body):
    """A thin bar swings back and hits the ball again: the span has the flight between."""
    shape = box(0.012, 0.08, 0.003).Move((0, 0, -0.003))
    fem = ep.fe_model(shape, ep.STEEL, maxh=8e-3, refine=[ep.Refine((0, 0, 0), 1e-3, 0.4e-3)])
    bar = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1.2e-3), f_cut=40e3)
    found = free_impact((round_body, bar), Point(0.0, 0.3, 0.0, 0.0), None, 3e-4)
    assert found["contacts"] > 1
    assert found["span"] > 1.1 * found["contact_time"]


def is_over_in_flight(mbs, body, height, velocity, spin, deformation, rates, beneath=None):
    """Whether the contact of a ball with a plane, or with a body that hit it from beneath, is over in its flight."""
    state = {"frame": "floating", "initialVelocity": velocity, "initialAngularVelocity": spin}
    ball = ep.CreatePartitionBody(mbs, body, referencePosition=[0, 0, height], **state)
    second = ep.RigidPlane() if beneath is None else ep.CreatePartitionBody(mbs, beneath, frame="floating")
    contact = ep.CreatePartitionContact(mbs, ball, second, passes="given")
    mbs.Assemble()
    data, initial = mbs.systemData, exu.ConfigurationType.Initial
    rest = np.zeros(0 if beneath is None else beneath.n_dofs)
    data.SetODE2Coordinates(data.GetODE2Coordinates(initial) + np.r_[np.zeros(6), deformation, rest], initial)
    data.SetODE2Coordinates_t(data.GetODE2Coordinates_t(initial) + np.r_[np.zeros(6), rates, rest], initial)
    result = ep.solve_dynamic(mbs, end_time=1e-9, step=1e-9)
    if beneath is None:
        return is_over([ball], contact, result, np.array([0, 0, -1.0]))
    return is_over([second, ball], contact, result, np.array([0, 0, 1.0]))


@pytest.mark.parametrize("spin", [[0, 0, 0], [0, 90.0, 0], [0, -90.0, 0], [90.0, 0, 0], [-90.0, 0, 0]])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("with_body", [False, True])
def test_a_contact_is_over_only_if_the_bodies_part(mbs, round_body, flat_body, sign, spin, with_body):
    """Where they are nearest to each other: the border of the patch may do the opposite."""
    still, beneath = np.zeros(round_body.n_dofs - 6), flat_body if with_body else None
    assert is_over_in_flight(mbs, round_body, 1e-3, [0, 0, 0.03 * sign], spin, still, still, beneath) is (sign > 0)


@pytest.mark.parametrize(
    ("height", "over", "phase"),
    [(0.9, False, "passes"), (0.9, False, "up"), (1.1, True, "passes"), (1.1, True, "up"), (1.1, True, "down")],
)
def test_a_contact_is_over_if_all_modes_together_do_not_reach_the_plane(mbs, round_body, height, over, phase):
    """They vibrate so that their largest displacements, together, move the patch as far as their energy can."""
    kinematics = FloatingKinematics(round_body, np.zeros(3), np.zeros(3), round_body.partition.patches[0].nodes[:1])
    squares, modes = np.linalg.eigh(kinematics.elastic_stiffness)
    reach, row = 1e-5, kinematics.rows[2] @ modes
    largest = reach * row / squares / (row**2 / squares).sum()
    deformation = modes @ largest * {"passes": 0, "up": 1, "down": -1}[phase]
    rates = modes @ (largest * np.sqrt(squares)) * (phase == "passes")
    assert is_over_in_flight(mbs, round_body, height * reach, [0, 0, 0.1], [0, 0, 0], deformation, rates) is over
