"""Impacts of bodies of one node each, whose answer is known."""

import numpy as np
import pytest
import scipy.sparse as sp

from exudyn_partition.algebra.coulomb import Coulomb
from exudyn_partition.prediction.modal_impact import ObliqueImpact
from exudyn_partition.prediction.pair_impact import ImpactSide, impact_between, tangents

LINE = np.array([0.0, 0.6, -0.8])  # from the first body to the other
MASSES, FLEXIBILITIES = (2.0, 0.5), (1e-8, 3e-8)


def point(mass, flexibility, sign, directions=3):
    """A mass with one node that yields by its flexibility; coordinates are displacements times the root of the mass."""
    return ImpactSide(
        directed=sp.csr_matrix(-sign * LINE[None]),
        plain=sp.csr_matrix(np.ones((1, 1))),
        shapes=np.eye(3) / np.sqrt(mass),
        flexibility=flexibility * np.eye(directions),
        omega=np.zeros(3),
    )


def strike(speed, directions=3, friction=None):
    sides = [point(*of, sign, directions) for *of, sign in zip(MASSES, FLEXIBILITIES, (1, -1), strict=True)]
    velocity = np.sqrt(MASSES[0]) * np.asarray(speed)
    return impact_between(sides, np.array([3e-6]), LINE, velocity, 1e-3, friction)


@pytest.mark.parametrize("directions", [1, 3])
def test_two_masses_swap_momentum_by_their_springs_in_series(directions):
    """Half a period of the relative mass on both springs, and velocities as of rigid bodies without loss."""
    impact, (m, M) = strike(0.3 * LINE, directions), MASSES
    reduced, stiffness = m * M / (m + M), 1 / sum(FLEXIBILITIES)
    contact = np.pi * np.sqrt(reduced / stiffness)
    t, force, velocity = impact.run(1.5 * contact, contact / 2000)
    assert np.ptp(t[force[:, 0] > 0]) == pytest.approx(contact, rel=2e-3)
    assert force.max() == pytest.approx(0.3 * np.sqrt(reduced * stiffness), rel=1e-4)
    after = velocity[-1].reshape(2, 3) / np.sqrt(MASSES)[:, None]
    np.testing.assert_allclose(after, 0.3 * np.array([[(m - M) / (m + M)], [2 * m / (m + M)]]) * LINE, atol=1e-4)


def test_friction_pushes_the_second_body_along_the_first_ones_sliding():
    """Gross slip: each tangential impulse is the coefficient times the normal one, opposite on both bodies."""
    across = tangents(LINE)
    np.testing.assert_allclose(across @ np.column_stack([LINE, across.T]), np.eye(2, 3, 1), atol=1e-14)
    impact = strike(0.3 * LINE + 2.0 * across[0], friction=Coulomb(0.1))
    assert isinstance(impact, ObliqueImpact)
    contact = np.pi * np.sqrt(np.prod(MASSES) / sum(MASSES) * sum(FLEXIBILITIES))
    *_, velocity = impact.run(1.5 * contact, contact / 2000)
    momentum = velocity.reshape(-1, 2, 3) * np.sqrt(MASSES)[:, None]
    change = momentum[-1] - momentum[0]
    np.testing.assert_allclose(change.sum(axis=0), 0, atol=1e-12)
    assert change[1] @ LINE > 0.1
    assert change[1] @ across[0] == pytest.approx(0.1 * (change[1] @ LINE), rel=2e-3)
    assert abs(change[1] @ across[1]) < 1e-9
