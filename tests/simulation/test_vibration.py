"""Energy of bodies in motion and vibration, against the bodies' kinematics and sums over modes."""

import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.simulation.vibration import Vibration


@pytest.fixture(scope="module")
def nodal(marble_parts):
    """A body that keeps the nodes of its patches, and so has no modes with frequencies alone."""
    return ep.reduce(*marble_parts, basis="free", f_cut=300e3)


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_kinetic_energy_is_the_sum_of_all_bodies(mbs, marble, nodal, frame):
    rng = np.random.default_rng(1)
    items = [ep.CreatePartitionBody(mbs, body, frame=frame) for body in (marble, nodal)]
    motions = [rng.standard_normal(item.body.n_dofs) for item in items]
    expected = sum(float(item.kinematics.kinetic_energy(0 * v, v)) for item, v in zip(items, motions, strict=True))
    assert Vibration(items).kinetic_energy(np.concatenate(motions)) == pytest.approx(expected, rel=1e-9)


def test_the_fastest_mode_is_that_up_to_which_the_energy_is_small(mbs, marble):
    rng = np.random.default_rng(2)
    items = [ep.CreatePartitionBody(mbs, marble, frame=frame) for frame in ("inertial", "floating")]
    q, q_t = 1e-6 * rng.standard_normal((2, 2 * marble.n_dofs))
    omega = marble.basis.omega[6:]
    modes = np.r_[6 : marble.n_dofs], np.r_[marble.n_dofs + 6 : 2 * marble.n_dofs]
    energies = np.concatenate([q_t[own] ** 2 + (omega * q[own]) ** 2 for own in modes]) / 2
    frequencies = np.tile(omega, 2) / (2 * np.pi)
    vibration = Vibration(items)
    for share in (0.0, 0.1, 0.5, 0.9):
        least = share * energies.sum()
        expected = max(f for f in frequencies if energies[frequencies >= f].sum() > least)
        assert vibration.fastest(q, q_t, least) == pytest.approx(expected)
    assert vibration.fastest(q, q_t, energies.sum() * (1 + 1e-9)) == 0.0


def test_vibration_of_kept_nodes_counts_as_that_of_the_cut(mbs, marble, nodal):
    """Beside a body with modes, which are slower and faster than the other body's frequency."""
    items = [ep.CreatePartitionBody(mbs, body) for body in (nodal, marble)]
    energy, vibration = 3.0, Vibration(items)
    q, q_t = np.zeros((2, nodal.n_dofs + marble.n_dofs))
    shape = items[0].kinematics.deformed(np.eye(nodal.n_dofs)[-1])
    q[: nodal.n_dofs] = shape * np.sqrt(2 * energy / (shape @ (nodal.stiffness @ shape)))
    assert vibration.fastest(q, q_t, 0.99 * energy) == pytest.approx(nodal.f_cut)
    assert vibration.fastest(q, q_t, 1.01 * energy) == 0.0
    q[:], q_t[: nodal.n_dofs] = 0.0, shape * np.sqrt(2 * energy / (shape @ (nodal.mass @ shape)))
    assert vibration.fastest(q, q_t, 0.99 * energy) == pytest.approx(nodal.f_cut)
    assert vibration.fastest(q, q_t, 1.01 * energy) == 0.0
    slow = int(np.argmin(marble.basis.omega[6:])) + 6
    q_t[nodal.n_dofs + slow] = np.sqrt(2 * energy)
    assert vibration.fastest(q, q_t, 1.01 * energy) == pytest.approx(marble.basis.omega[slow] / (2 * np.pi))


def test_without_bodies_nothing_vibrates():
    none = Vibration([])
    assert none.kinetic_energy(np.zeros(0)) == none.fastest(np.zeros(0), np.zeros(0), 0.0) == 0.0
