"""What is measured of an impact, on motions that are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from exudyn_partition.frames.floating import FloatingKinematics
from exudyn_partition.frames.inertial import InertialKinematics
from exudyn_partition.studies.free_impact import free_impact, rigid_spin, speed_ratio, vibration_energy
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
