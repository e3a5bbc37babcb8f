"""Two meshed spheres against Hertz, and the reduced model against the full FE one."""

import math

import exudyn as exu
import meshio
import numpy as np
import pytest
from oracles import SPHERE_MATERIAL, SPHERE_RADIUS

import exudyn_partition as ep

SPEED = 0.5


@pytest.fixture(scope="module")
def expected():
    mass = 4 / 3 * math.pi * SPHERE_RADIUS**3 * SPHERE_MATERIAL.rho
    return ep.hertz.impact(mass / 2, SPEED, SPHERE_RADIUS, SPHERE_RADIUS, SPHERE_MATERIAL, SPHERE_MATERIAL)


@pytest.fixture(scope="module")
def run(reduced_sphere, other_sphere, kept):
    mbs = exu.SystemContainer().AddSystem()
    upper, lower = reduced_sphere, ep.reduce(*other_sphere, f_cut=200e3, cache=kept)
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
    reference = ep.reference.simulate(bodies, end_time=45e-6, step=1e-6)  # the peak is at 35 us
    assert ep.compare(history, reference).error["force"] < 0.01
    assert reference.info["contact_nodes"] == contact.n_rows
    assert abs(reference.info["energy_error"]) < 1e-3


def test_stress_beneath_the_contact(run, sphere, other_sphere, expected, tmp_path):
    """Hertz's field of stress (Johnson, section 3.4) from the files for ParaView: von Mises 0.62 p0 at 0.48 a."""
    striker, target, contact, result = run
    pairs = [(striker, sphere[0]), (target, other_sphere[0])]
    peak = float(result.t[contact.force(result).argmax()])
    ep.output.write_paraview(tmp_path, result, pairs, fields=("stress", "von_mises"), times=[peak], surface=False)
    p0, a = 1.5 * expected.peak_force / (math.pi * expected.contact_radius**2), expected.contact_radius
    for name, (_, fem) in zip(("upper", "lower"), pairs, strict=True):
        data = meshio.read(tmp_path / f"{name}_0000.vtu").point_data
        depth, off_axis = abs(fem.points[:, 2]) / a, np.linalg.norm(fem.points[:, :2], axis=1) / a
        deepest = data["von_mises"].argmax()
        assert data["von_mises"][deepest] / p0 == pytest.approx(0.62, rel=0.08)
        assert 0.3 < depth[deepest] < 0.7
        on_axis = (off_axis < 0.2) & (0.2 < depth) & (depth < 1.5)
        assert on_axis.sum() > 20
        axial = data["stress"][on_axis, 2] / p0
        np.testing.assert_allclose(axial, -1 / (1 + depth[on_axis] ** 2), rtol=0.04)
