"""The compliance law of frozen pairs: force, tangent and potential belong together."""

import numpy as np
import pytest
from oracles import TOP, relative

from exudyn_partition.contact.formulations.compliance import ComplianceContact
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.side import Side
from exudyn_partition.frames.inertial import InertialKinematics


@pytest.fixture(scope="module")
def law(bodies):
    return ComplianceContact(PatchGaps(*sides(bodies)))


def sides(bodies, slave_at=TOP):
    """Patches of two bodies, the first shifted."""
    return [
        Side.of(InertialKinematics(body, np.array(at))) for body, at in zip(bodies, (slave_at, (0, 0, 0)), strict=True)
    ]


def closing_state(law, bodies, depth, seed=0):
    """Bodies pushed into each other by `depth`, with some random deformation."""
    rng = np.random.default_rng(seed)
    n = [body.n_dofs for body in bodies]
    q = np.concatenate([-depth * bodies[0].rigid[:, 2], np.zeros(n[1])])
    return q + 0.2 * depth * rng.standard_normal(sum(n)) / abs(law.gaps.H).max() / np.sqrt(sum(n))


@pytest.mark.parametrize("seed", range(4))
def test_contact_force_jacobian_and_potential_against_finite_differences(law, bodies, seed):
    depth = 1e-6
    q = closing_state(law, bodies, depth, seed)
    force = law.force(q).copy()
    tangent = law.tangent()
    assert 0 < len(law.problem.index)
    rng = np.random.default_rng(seed)
    for _ in range(3):
        d = rng.standard_normal(len(q))
        d *= 1e-5 * depth / abs(law.gaps.H @ d).max()
        slope = law.force(q + d) - law.force(q - d)
        assert relative(-2 * tangent @ d, slope) < 1e-5
        work = law.potential(q + d) - law.potential(q - d)
        assert work == pytest.approx(-2 * force @ d, rel=1e-5)


def test_contact_pushes_both_bodies_with_the_same_force(law, bodies):
    force = law.force(closing_state(law, bodies, 1e-6))
    n = bodies[0].n_dofs
    on_slave, on_master = bodies[0].rigid[:, :3].T @ force[:n], bodies[1].rigid[:, :3].T @ force[n:]
    np.testing.assert_allclose(on_slave, [0, 0, law.lam.sum()], atol=1e-9 * law.lam.sum())
    np.testing.assert_allclose(on_master, -on_slave, atol=1e-9 * law.lam.sum())


def test_no_force_without_contact(law, bodies):
    q = -closing_state(law, bodies, 1e-6)
    assert not law.force(q).any()
    assert not law.tangent().any()
