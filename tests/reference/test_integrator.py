"""The integrator of full FE models: order, energy, and forces that close gaps."""

import numpy as np
import pytest
import scipy.sparse as sp

from exudyn_partition.reference.integrator import HHT


@pytest.mark.parametrize("alpha", [0.0, 0.1, 0.3])
def test_the_integrator_is_of_second_order_and_keeps_or_loses_energy(alpha):
    """A mass on a spring, let go with a velocity: u = v / w sin(w t)."""
    one, errors = sp.csr_matrix([[1.0]]), []
    for steps in (50, 100, 200):
        hht = HHT(one, 4.0 * one, one, 3.0 / steps, alpha=alpha, velocity=np.array([2.0]))
        energy = hht.energy()
        for _ in range(steps):
            hht.predict()
            hht.correct(np.zeros(1))
        errors.append(abs(hht.u[0] - np.sin(6.0)))
        assert hht.energy() == pytest.approx(energy, rel=1e-12) if alpha == 0 else hht.energy() < energy
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.3)


def test_forces_that_the_compliance_asks_for_close_the_gap_at_the_end_of_a_step():
    M, K = sp.csr_matrix(np.diag([1.0, 2.0])), sp.csr_matrix([[2.0, -1.0], [-1.0, 1.0]])
    G = sp.csr_matrix([[0.0, -1.0]])
    hht = HHT(M, K, G, 0.1, velocity=np.array([0.0, 1.0]))
    force = np.linalg.solve(hht.compliance(), -hht.predict())
    hht.correct(force)
    assert G @ hht.u == pytest.approx(0.0, abs=1e-15)
