"""Impacts in modal coordinates with friction, of one row on a point mass that also vibrates."""

import numpy as np
import pytest
from oracles import each_way

import exudyn_partition as ep
from exudyn_partition.prediction.modal_impact import Impact, ObliqueImpact

SOFT = 1e-7  # flexibility of the row [m/N]


def impact(mu, along=0.3, modes=()):
    """A unit mass hits at 1 m/s; `modes` are circular frequencies of vibration along the normal and the tangent."""
    n = 3 + len(modes)
    H, H_t = np.zeros((1, n)), np.zeros((2, n))
    H[0, 0], H_t[0, 1], H_t[1, 2] = 1.0, 1.0, 1.0
    H[0, 3:], H_t[0, 3:] = 0.5, 0.3
    velocity = np.r_[-1.0, along, 0.0, np.zeros(len(modes))]
    omega = np.r_[0.0, 0.0, 0.0, modes]
    F = np.diag([SOFT, 1.2 * SOFT, 1.2 * SOFT])
    return ObliqueImpact(np.zeros(1), H, F[:1, :1], omega, velocity, 1e-3, H_t, F, ep.Coulomb(mu))


def impulse(found):
    t, force, _ = found
    return np.trapezoid(force, t, axis=0)


def test_gross_slip_has_coulombs_impulse():
    t, force, velocity = impact(0.05).run(2e-3, 1e-6)
    assert t[-1] == pytest.approx(2e-3)
    normal, along, across = impulse((t, force, velocity))
    assert normal == pytest.approx(2.0, rel=1e-3)
    assert along == pytest.approx(-0.05 * normal, rel=1e-2)
    assert across == 0.0
    assert velocity[-1, 1] == pytest.approx(0.3 + along, rel=1e-3)


def test_without_tangential_motion_the_normal_force_is_that_without_friction():
    modes = (2e4, 5e4)
    oblique = impact(0.3, along=0.0, modes=modes)
    free = Impact(oblique.gap, oblique.H, oblique.F, oblique.omega, oblique.velocity, oblique.size)
    frictionless = impact(1e-12, along=0.0, modes=modes)
    np.testing.assert_allclose(frictionless.run(1e-3, 1e-6)[1][:, :1], free.run(1e-3, 1e-6)[1], atol=1e-6 * 1e4)


def test_truncation_keeps_the_static_answer_in_all_directions():
    """Far below the modes that are cut, forces are as with them; without their flexibility, they would not be."""
    whole = impact(0.3, modes=(3e5, 4e5))
    short, keep = whole.truncated(1e5)
    assert keep.sum() == 3
    expected, found = impulse(whole.run(2e-3, 5e-7)), impulse(short.run(2e-3, 5e-7))
    np.testing.assert_allclose(found, expected, atol=5e-3 * abs(expected).max())
    added = short.F_all - whole.F_all
    np.testing.assert_allclose(added, added.T)
    assert added[0, 1] == pytest.approx(0.15 * (1 / 3e5**2 + 1 / 4e5**2))


def on_five_rows():
    """A ball of three modes on five rows, of which some close and open."""
    rng = np.random.default_rng(3)
    root, H = rng.standard_normal((5, 5)), np.column_stack([np.ones(5), 0.3 * rng.standard_normal((5, 3))])
    F = SOFT * (np.eye(5) + 0.05 * root @ root.T)
    omega, velocity = np.r_[0.0, 2e4, 4e4, 7e4], np.r_[-1.0, 0.0, 0.0, 0.0]
    return Impact(np.array([0.0, 1e-6, 2e-5, 1e-4, 1e-2]), H, F, omega, velocity, 1e-3)


def test_forces_of_rows_are_those_of_the_run_at_even_parts_of_its_impulse():
    pressed = on_five_rows()
    t, total, _ = pressed.run(1.5e-3, 1e-7)
    passed = np.cumsum(total[:, 0]) / total.sum()
    at = np.interp((np.arange(20) + 0.5) / 20, passed, t)
    forces = pressed.forces(1.5e-3, 1e-7, 20)
    assert forces.shape == (5, 20)
    assert (forces >= 0).all()
    assert ((forces > 0).any(axis=1) == pressed.loaded(1.5e-3, 1e-7)).all()
    np.testing.assert_allclose(forces.sum(axis=0), np.interp(at, t, total[:, 0]), rtol=0.02)


def test_compiled_loops_integrate_the_same_impact():
    pressed = on_five_rows()
    compiled, plain = each_way(lambda: (*pressed.run(1.5e-3, 1.3e-7), pressed.loaded(1.5e-3, 1.3e-7)))
    assert len(plain[0]) > 5000
    assert 1 < plain[3].sum() < 5
    for one, other in zip(compiled, plain, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-8 * abs(other).max())
