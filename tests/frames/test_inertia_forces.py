"""Inertia of deformed bodies: integrals and forces by brute force, and their derivatives."""

import numpy as np
import pytest
from oracles import SPIN, box, each_way, in_frame

import exudyn_partition as ep
from exudyn_partition.fe.model import rigid_modes
from exudyn_partition.frames.inertia_forces import TERMS, InertiaForces, StepStart


@pytest.fixture(scope="module", params=["contact-adapted", "residual", "craig-bampton", "free", "all nodes"])
def any_body(request, plank):
    """A body in its frame, and the FE mass of its basis."""
    fem, part = plank
    if request.param == "all nodes":  # the full FE model
        fem = ep.fe_model(box(0.03, 0.02, 0.01), ep.STEEL, maxh=0.02, order=1)
        part = ep.Partition.ball(fem, (0, 0, 0.01), 0.1, contact_radius=0.02)
    basis = "free" if request.param == "all nodes" else request.param
    body = ep.reduce(fem, part, basis=basis, f_cut=20e3)
    return in_frame(body), fem.mass if body.basis.mass == "consistent" else fem.lumped_mass_matrix


def state(body, seed=0):
    """Angular velocity, elastic coordinates large enough to see their squares, and their velocities."""
    rng = np.random.default_rng(seed)
    n = body.n_dofs - 6
    return SPIN, 2e-3 * rng.standard_normal(n) / np.arange(1, n + 1), rng.standard_normal(n)


def fields(kinematics, z, z_t):
    """Arms from the centre of mass and elastic velocities of all nodes, (N, 3)."""
    return kinematics.arms + (kinematics.rows @ z).reshape(-1, 3), (kinematics.rows @ z_t).reshape(-1, 3)


# --- integrals and forces


def test_integrals_against_the_fe_mass(any_body):
    kinematics, mass = any_body
    omega, z, z_t = state(kinematics.body)
    arms, u_t = fields(kinematics, z, z_t)
    v = np.cross(omega, arms) + u_t
    momentum = (mass @ v.ravel()).reshape(-1, 3)
    inertia = kinematics.inertia
    np.testing.assert_allclose(inertia.angular_momentum(omega, z, z_t), np.cross(arms, momentum).sum(axis=0), rtol=1e-9)
    assert inertia.kinetic_energy(omega, z, z_t) == pytest.approx((v * momentum).sum() / 2, rel=1e-9)
    rotations = rigid_modes(kinematics.arms)[:, 3:]
    np.testing.assert_allclose(inertia.tensor, rotations.T @ (mass @ rotations), atol=1e-9 * inertia.tensor.max())
    J, C = inertia.of_place(z)
    np.testing.assert_allclose(J @ omega + C @ z_t, inertia.angular_momentum(omega, z, z_t), rtol=1e-9)
    deformed = (mass @ (arms - kinematics.arms).ravel()).reshape(-1, 3)
    crossed = np.cross(u_t, deformed).sum(axis=0)
    np.testing.assert_allclose(inertia.crossed(z) @ z_t, crossed, rtol=0, atol=1e-9 * np.linalg.norm(crossed))


def test_mean_axes(any_body):
    """Deformation of unit mass, without momentum, that spans with rigid motion all that the basis does."""
    kinematics, _ = any_body
    body, axes = kinematics.body, kinematics.mean_axes
    E = axes.expand(np.eye(body.n_dofs - 6)).T
    M = body.mass.toarray()
    np.testing.assert_allclose(E.T @ M @ E, np.eye(body.n_dofs - 6), atol=1e-12)
    np.testing.assert_allclose(body.rigid.T @ M @ E, 0, atol=1e-12 * abs(M @ body.rigid).max())
    assert np.linalg.matrix_rank(np.hstack([body.rigid, E])) == body.n_dofs
    rng = np.random.default_rng(4)
    q, z = rng.standard_normal((3, body.n_dofs)), rng.standard_normal((3, body.n_dofs - 6))
    np.testing.assert_allclose(
        axes.deformation(axes.expand(z) + rng.standard_normal((3, 6)) @ body.rigid.T), z, atol=1e-10
    )
    np.testing.assert_allclose(axes.restrict(q), q @ E, atol=1e-12 * abs(E).max() * body.n_dofs)
    K = body.stiffness.toarray()
    np.testing.assert_allclose(kinematics.elastic_stiffness, E.T @ K @ E, atol=1e-12 * abs(E.T @ K @ E).max())
    np.testing.assert_allclose(kinematics.elastic_force(z[0]), E.T @ K @ E @ z[0], rtol=1e-6, atol=1e-9 * abs(K).max())


def test_integrals_of_histories(body):
    inertia = in_frame(body).inertia
    states = [state(body, seed) for seed in range(3)]
    together = [np.array(part) for part in zip(*states, strict=True)]
    for method in (inertia.angular_momentum, inertia.kinetic_energy):
        np.testing.assert_allclose(method(*together), [method(*one) for one in states], rtol=1e-12)


def test_accelerations_balance_all_virtual_motion(any_body):
    """The principle of virtual power with the FE mass: no rotation nor shape finds force left over."""
    kinematics, mass = any_body
    omega, z, z_t = state(kinematics.body)
    elastic = kinematics.elastic_force(z)
    force = InertiaForces(kinematics.inertia, kinematics.elastic_force).force(omega, z, z_t)
    omega_t = np.linalg.solve(kinematics.inertia.tensor, force[:3])
    z_tt = force[3:] - elastic
    arms, u_t = fields(kinematics, z, z_t)
    u_tt = fields(kinematics, z, z_tt)[1]
    turning = np.cross(omega_t, arms) + np.cross(omega, np.cross(omega, arms)) + 2 * np.cross(omega, u_t)
    inertia = (mass @ (u_tt + turning).ravel()).reshape(-1, 3)
    scale = np.linalg.norm(np.cross(arms, inertia), axis=1).sum()
    np.testing.assert_allclose(np.cross(arms, inertia).sum(axis=0), 0, atol=1e-9 * scale)
    np.testing.assert_allclose(inertia.sum(axis=0), 0, atol=1e-9 * abs(inertia).sum())
    np.testing.assert_allclose(kinematics.rows.T @ inertia.ravel(), -elastic, atol=1e-9 * abs(elastic).max())


@pytest.mark.parametrize("terms", [(name,) for name in TERMS if name != "coupling"] + [tuple(TERMS)[:3]])
def test_derivatives_by_finite_differences(body, terms):
    kinematics = in_frame(body)
    forces = InertiaForces(kinematics.inertia, kinematics.elastic_force, terms)
    omega, z, z_t = state(body)
    x, n = np.concatenate([z, omega, z_t]), len(z)
    got = np.hstack(forces.derivatives(omega, z, z_t))

    def at(x):
        return forces.force(x[n : n + 3], x[:n], x[n + 3 :])

    # The forces are cubic, so that differences of this size are exact but for their third derivatives.
    steps = 1e-4 * np.concatenate([np.full(n, 1e-3), np.full(3, 300.0), np.ones(n)])
    expected = np.array([(at(x + d) - at(x - d)) / (2 * d.sum()) for d in np.diag(steps)]).T
    for block in (slice(0, 3), slice(3, None)):
        np.testing.assert_allclose(got[block], expected[block], atol=1e-6 * abs(expected[block]).max())


def test_compiled_forces_are_those_of_numpy(plank):
    fem, part = plank
    kinematics = in_frame(ep.reduce(fem, part, f_cut=20e3))
    omega, z, z_t = state(kinematics.body)
    forces = InertiaForces(kinematics.inertia, kinematics.elastic_force)
    q, q_t = np.r_[np.zeros(6), z], np.r_[np.zeros(3), omega, z_t]
    compiled, plain = each_way(lambda: forces.on_body(q, q_t))
    np.testing.assert_allclose(compiled, plain, rtol=1e-10, atol=1e-12 * abs(plain).max())
    assert not np.array_equal(compiled, plain)  # sums in another order: both ways ran
    for one, other in zip(*each_way(lambda: forces.derivatives(omega, z, z_t)), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12 * abs(other).max())
    start = StepStart(0.1, 0.5 * z, 0.9 * q_t[3:], np.linspace(-1.0, 1.0, len(q_t) - 3))
    compiled, plain = each_way(lambda: forces.on_body(q, q_t, start))
    np.testing.assert_allclose(compiled, plain, rtol=1e-10, atol=1e-12 * abs(plain).max())


def test_compiled_motion_is_that_of_numpy(plank):
    fem, part = plank
    kinematics = in_frame(ep.reduce(fem, part, f_cut=20e3))
    rng = np.random.default_rng(1)
    q = np.r_[0.1, 0.2, 0.3, 0.4, -2.0, 0.7, state(kinematics.body)[1]]
    forces, outer = rng.normal(size=kinematics.arms.shape), rng.normal(size=len(q))
    forces[::2] = 0.0

    def motion():
        return (
            kinematics.place(q),
            kinematics.place(np.zeros(len(q))),
            kinematics.generalised(q, forces),
            kinematics.on_constant_mass(q, outer),
        )

    for compiled, plain in zip(*each_way(motion), strict=True):
        np.testing.assert_allclose(compiled, plain, rtol=1e-10, atol=1e-12 * abs(plain).max())
