"""Two meshed spheres against Hertz, and the reduced model against the full FE one (cases.md)."""

import math

import exudyn as exu
import numpy as np
import pytest
from conftest import SPHERE_MATERIAL, SPHERE_RADIUS

import exudyn_partition as ep

SPEED = 0.5


@pytest.fixture(scope="module")
def expected():
    mass = 4 / 3 * math.pi * SPHERE_RADIUS**3 * SPHERE_MATERIAL.rho
    return ep.hertz.impact(mass / 2, SPEED, SPHERE_RADIUS, SPHERE_RADIUS, SPHERE_MATERIAL, SPHERE_MATERIAL)


@pytest.fixture(scope="module")
def run(sphere, other_sphere):
    mbs = exu.SystemContainer().AddSystem()
    upper, lower = (ep.reduce(*pair, f_cut=200e3) for pair in (sphere, other_sphere))
    striker = ep.CreatePartitionBody(mbs, upper, name="upper", initialVelocity=[0, 0, -SPEED])
    target = ep.CreatePartitionBody(mbs, lower, name="lower")
    contact = ep.CreatePartitionContact(mbs, striker, target)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=80e-6)
    return striker, target, contact, result


def test_peak_force_and_duration(run, expected):
    *_, contact, result = run
    history = result.history(contact)
    assert history.peak_force == pytest.approx(expected.peak_force, rel=0.03)
    assert history.contact_duration == pytest.approx(expected.duration, rel=0.03)


def test_the_spheres_swap_their_velocities(run):
    """Equal masses, elastic: only what stays as vibration is missing, and Hertz impacts leave next to none."""
    striker, target, _, result = run
    mass = striker.body.total_mass
    after = [item.momentum(result)[-1, 2] / mass for item in (striker, target)]
    np.testing.assert_allclose(after, [0, -SPEED], atol=5e-3 * SPEED)


def test_energy_and_momentum(run):
    striker, target, contact, result = run
    energy = striker.energy(result) + target.energy(result) + contact.energy(result)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-3)
    total = striker.momentum(result) + target.momentum(result)
    np.testing.assert_allclose(total - total[0], 0, atol=1e-9 * abs(total[0]).max())


def test_full_fe_model_with_the_same_rows_agrees(run, sphere, other_sphere):
    *_, contact, result = run
    history = result.history(contact)
    bodies = [
        ep.reference.FullBody(*sphere, velocity=(0, 0, -SPEED)),
        ep.reference.FullBody(*other_sphere),
    ]
    reference = ep.reference.simulate(bodies, end_time=80e-6, step=0.5e-6)
    assert ep.compare(history, reference).error["force"] < 0.01
    assert reference.info["contact_nodes"] == contact.n_rows
    assert abs(reference.info["energy_error"]) < 1e-3
