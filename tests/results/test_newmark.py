"""Energy that implicit steps take, against a calculation of generalized-alpha by hand."""

import numpy as np
import pytest

from exudyn_partition.results.newmark import Newmark

MASS = np.array([1.0, 2.0, 0.5])
K = np.array([[30.0, -10, 0], [-10, 50, -20], [0, -20, 400]])
LOAD = np.array([0.0, 1.0, 0.0])


def parameters(rho):
    """Chung and Hulbert's, by the spectral radius at infinity."""
    alpha_m, alpha_f = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    return Newmark(alpha_m, alpha_f, 0.25 * (1 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f)


def integrated(method, t):
    """Three masses on springs under a load that begins and ends: displacements, velocities, forces."""
    u, v = np.array([0.1, 0.0, -0.2]), np.array([0.0, 1.0, 0.0])
    load = np.where((t > t[-1] / 4) & (t < t[-1] / 2), 5.0, 0.0)[:, None] * LOAD
    a = (load[0] - K @ u) / MASS
    rows = [(u, v, load[0] - K @ u)]
    for h, before, after in zip(np.diff(t), load, load[1:], strict=False):
        predicted = u + h * v + h**2 * (0.5 - method.beta) * a
        shares = 1 - method.alpha_m, 1 - method.alpha_f
        rhs = shares[1] * (after - K @ predicted) + method.alpha_f * (before - K @ u) - method.alpha_m * MASS * a
        new = np.linalg.solve(shares[0] * np.diag(MASS) + shares[1] * h**2 * method.beta * K, rhs)
        u, v, a = predicted + h**2 * method.beta * new, v + h * ((1 - method.gamma) * a + method.gamma * new), new
        rows.append((u, v, after - K @ u))
    return *(np.array(column) for column in zip(*rows, strict=True)), load


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.9, 1.0])
@pytest.mark.parametrize("growth", [0.0, 1.0])
def test_energy_and_what_the_steps_took_are_what_the_load_gave(rho, growth):
    """Also with steps that become longer, and where a rate is not known to be a velocity, after some steps."""
    method = parameters(rho)
    t = np.cumsum(np.r_[0.0, 0.05 * (1 + growth * np.linspace(0, 1, 400))])
    u, v, _, load = integrated(method, t)
    energy = 0.5 * np.sum(MASS * v**2, axis=1) + 0.5 * np.einsum("ni,ij,nj->n", u, K, u)
    work = np.r_[0.0, np.cumsum(np.sum((load[1:] + load[:-1]) / 2 * np.diff(u, axis=0), axis=1))]
    taken = method.taken(t, u, v, MASS)
    np.testing.assert_allclose(energy + taken - work, energy[0], rtol=1e-9)
    unknown = method.taken(t, np.full_like(u, np.nan), v, MASS)
    np.testing.assert_allclose(np.diff(unknown)[100:], np.diff(taken)[100:], rtol=0, atol=1e-4 * energy[0])
    assert method.damps == (rho < 1)
    if rho < 0.9:
        assert taken[-1] > 0.2 * energy[0]
    elif rho == 1:
        assert not taken.any()


def test_a_run_without_steps():
    assert not parameters(0.5).taken(np.zeros(1), np.ones((1, 3)), np.ones((1, 3)), MASS).any()
