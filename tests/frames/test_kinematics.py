"""Kinematics of nodes in both frames: places, velocities, generalised forces, histories."""

import numpy as np
import pytest
from oracles import PLACE, TURNED, each_way, without_numba
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.frames import loops
from exudyn_partition.frames.floating import FloatingKinematics
from exudyn_partition.frames.inertial import InertialKinematics
from exudyn_partition.frames.rotations import rotation_matrix

# --- kinematics of nodes


@pytest.fixture(params=["inertial", "floating", "floating off the node's axes"])
def kinematics(request, plank, body):
    nodes = plank[1].patch_nodes
    if "floating" in request.param:
        node_rotation = np.array([0.3, -0.2, 0.9]) if "off" in request.param else None
        return FloatingKinematics(body, PLACE, Rotation.from_matrix(TURNED).as_rotvec(), nodes, node_rotation)
    return InertialKinematics(body, PLACE, nodes)


def moved(kinematics, q, q_t, dt):
    """Coordinates after dt at constant velocities."""
    after = q + dt * q_t
    if isinstance(kinematics, FloatingKinematics):
        axes = Rotation.from_matrix(kinematics.frame(q)[1] @ kinematics.node_axes)
        turn = axes * Rotation.from_rotvec(dt * q_t[3:6])
        after[3:6] = turn.as_rotvec() - kinematics.rotation
    return after


def test_the_way_between_places_and_the_rigid_part_of_a_motion(kinematics):
    """The way leads back to where `moved` went, also through large turns; a rigid motion moves no node in the body."""
    rng = np.random.default_rng(2)
    q, q_t = 0.3 * rng.standard_normal((2, kinematics.body.n_dofs))
    np.testing.assert_allclose(kinematics.way(q, kinematics.moved(q, q_t)), q_t, atol=1e-12)
    rigid = kinematics.rigid_part(q_t)
    np.testing.assert_allclose(kinematics.rigid_part(rigid), rigid, atol=1e-12)
    np.testing.assert_allclose(kinematics.momentum(rigid), kinematics.momentum(q_t), atol=1e-12)


def test_coordinates_from_the_basis_and_forces_on_it(kinematics):
    """Motions of the basis keep their momentum and energy as coordinates, and forces have the same power on both."""
    rng = np.random.default_rng(3)
    body, to_coordinates = kinematics.body, kinematics.from_basis
    motions, forces = rng.standard_normal((2, body.n_dofs, 3))
    q_t, on_basis, start = to_coordinates @ motions, to_coordinates.T @ forces, np.zeros(body.n_dofs)
    np.testing.assert_allclose(on_basis.T @ motions, forces.T @ q_t, atol=1e-10 * abs(forces.T @ q_t).max())
    for motion, coordinates in zip(motions.T, q_t.T, strict=True):
        np.testing.assert_allclose(to_coordinates @ motion, coordinates, atol=1e-12 * abs(coordinates).max())
        energy = motion @ (body.mass @ motion) / 2
        np.testing.assert_allclose(kinematics.kinetic_energy(start, coordinates), energy, rtol=1e-9)


def test_nodes_that_rotation_moves_outwards_turn_where_they_are(plank, kept):
    """Places and velocities have the growth by centrifugal forces: at a constant spin, one is the rate of the other."""
    spinning = ep.reduce(*plank, f_cut=20e3, cache=kept)
    kinematics = FloatingKinematics(spinning, PLACE, Rotation.from_matrix(TURNED).as_rotvec(), plank[1].patch_nodes)
    q, q_t, dt = np.zeros(spinning.n_dofs), np.zeros(spinning.n_dofs), 1e-7
    q_t[3:6] = [300.0, -200.0, 2e3]
    still = kinematics.place(q)
    growing = kinematics.growing(q_t)
    grown = np.linalg.norm(kinematics.place(q, growing) - still, axis=1)
    velocities = kinematics.velocities(q, q_t)
    later, earlier = (kinematics.place(moved(kinematics, q, q_t, way), growing) for way in (dt, -dt))
    difference = later - earlier
    error = np.linalg.norm(velocities - difference / (2 * dt), axis=1)
    assert grown.min() > 1e-7
    assert error.max() < 1e-2 * np.linalg.norm(q_t[3:6]) * grown.min()
    np.testing.assert_array_equal(kinematics.place(q), still)


def test_velocities_and_forces_of_nodes(kinematics):
    """Velocities by finite differences of places; generalised forces by their power on all motions."""
    rng = np.random.default_rng(1)
    n = kinematics.body.n_dofs
    q, q_t = 1e-3 * rng.standard_normal((2, n))
    forces = rng.standard_normal((len(kinematics.arms), 3))
    if isinstance(kinematics, FloatingKinematics):
        q[3:6], q_t[3:6] = [0.3, 0.8, -0.4], [0.02, -0.03, 0.05]
    dt = 1e-3
    difference = kinematics.place(moved(kinematics, q, q_t, dt)) - kinematics.place(moved(kinematics, q, q_t, -dt))
    np.testing.assert_allclose(kinematics.velocities(q, q_t), difference / (2 * dt), atol=1e-8)
    power = [np.sum(forces * kinematics.velocities(q, unit)) for unit in np.eye(n)]
    np.testing.assert_allclose(kinematics.generalised(q, forces), power, atol=1e-12 * abs(np.array(power)).max())
    np.testing.assert_allclose(
        kinematics.place(q), kinematics.place(np.zeros(n)) + kinematics.displacements(q), atol=1e-15
    )


def test_the_mean_velocity_is_that_of_rigid_motion_at_any_point(kinematics):
    """At the place of a node it is the node's velocity, if the body moves as a rigid one; vibration adds nothing."""
    rng = np.random.default_rng(4)
    n = kinematics.body.n_dofs
    q = np.zeros(n)
    if isinstance(kinematics, FloatingKinematics):
        q[:6] = rng.standard_normal(6)
    q_t = rng.standard_normal(n)
    rigid = kinematics.rigid_part(q_t)
    at_nodes = kinematics.velocities(q, rigid)
    for motion in (rigid, q_t):
        mean = [kinematics.mean_velocity(q, motion, place) for place in kinematics.place(q)]
        np.testing.assert_allclose(mean, at_nodes, rtol=1e-9, atol=1e-9 * abs(at_nodes).max())


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_momenta_and_energies_are_sums_over_the_nodes(plank, body, frame):
    """With the FE mass between the velocities of all nodes; about any point, at a place far from that at the start."""
    fem, nodes = plank[0], np.arange(plank[0].n_nodes)
    rng = np.random.default_rng(5)
    q, q_t, point = *(1e-3 * rng.standard_normal((2, body.n_dofs))), np.array([3.0, -1.0, 2.0])
    if frame == "floating":
        kinematics = FloatingKinematics(body, PLACE, Rotation.from_matrix(TURNED).as_rotvec(), nodes)
        q[:6], q_t[:6] = rng.standard_normal((2, 6))
    else:  # whose angular momentum is of first order in deformation and rotation
        kinematics = InertialKinematics(body, PLACE, nodes)
        q = body.rigid[:, :3] @ rng.standard_normal(3)
    M = fem.mass if body.basis.mass == "consistent" else fem.lumped_mass_matrix
    velocity, places = kinematics.velocities(q, q_t), kinematics.place(q)
    impulse = (M @ velocity.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(kinematics.momentum(q_t), impulse.sum(axis=0), rtol=1e-8)
    turning = np.cross(places - point, impulse).sum(axis=0)
    np.testing.assert_allclose(kinematics.angular_momentum(q, q_t, point), turning, rtol=1e-8)
    np.testing.assert_allclose(kinematics.kinetic_energy(q, q_t), np.sum(velocity * impulse) / 2, rtol=1e-8)
    gravity = np.array([1.0, -2.0, 9.0])
    on_nodes = (M @ np.tile(gravity, fem.n_nodes)).reshape(-1, 3)
    np.testing.assert_allclose(kinematics.weight(gravity), kinematics.generalised(q, on_nodes), atol=1e-8)


def test_accelerations_are_forces_over_the_mass_of_all_motion(plank, body):
    """The mass matrix is the FE one between the velocities that unit rates of all coordinates give the nodes."""
    fem = plank[0]
    floating = FloatingKinematics(body, PLACE, Rotation.from_matrix(TURNED).as_rotvec(), np.arange(fem.n_nodes))
    M = fem.mass if body.basis.mass == "consistent" else fem.lumped_mass_matrix
    rng = np.random.default_rng(6)
    q = np.r_[np.zeros(6), 1e-3 * rng.standard_normal(body.n_dofs - 6)]
    unit = np.array([floating.velocities(q, rate).ravel() for rate in np.eye(body.n_dofs)])
    mass = unit @ (M @ unit.T)
    forces = rng.standard_normal(body.n_dofs) * np.sqrt(np.diag(mass))
    found = mass @ floating.accelerations(q, forces)
    np.testing.assert_allclose(found, forces, rtol=1e-6, atol=1e-6 * abs(forces).max())


def test_places_seen_from_near_have_rounding_errors_of_their_ways(kinematics):
    """As large as ways of 1e-12 m allow, wherever the body is; far places alone have errors of 1e-17 m."""
    rng = np.random.default_rng(4)
    q = rng.standard_normal(kinematics.body.n_dofs)
    expected = (kinematics.place(1e-5 * q) - kinematics.place(-1e-5 * q)) / 2e-5
    here = kinematics.place(0 * q)
    for found in each_way(lambda: [kinematics.seen_from(x).place(1e-12 * q)[i] for i, x in enumerate(here[:5])]):
        np.testing.assert_allclose(np.array(found) / 1e-12, expected[:5], atol=1e-8 * abs(expected).max())
    turned = 0.3 * q
    np.testing.assert_allclose(*each_way(lambda: kinematics.place(turned)), atol=1e-15)
    np.testing.assert_allclose(
        kinematics.place(np.array([q, turned])), [kinematics.place(q), kinematics.place(turned)], atol=1e-14
    )


def test_unloaded_nodes_are_left_out_without_effect(kinematics, monkeypatch):
    rng = np.random.default_rng(3)
    q, forces = 1e-3 * rng.standard_normal(kinematics.body.n_dofs), rng.standard_normal((len(kinematics.arms), 3))
    forces[::2] = 0.0
    found = []
    for large in (0, np.inf):
        monkeypatch.setattr(loops, "LARGE", large)
        with without_numba():  # compiled loops pass over them
            found.append(kinematics.generalised(q, forces))
    np.testing.assert_allclose(*found, rtol=1e-12, atol=1e-12 * abs(found[1]).max())


def test_histories_are_one_state_after_the_other(kinematics):
    rng = np.random.default_rng(2)
    q, q_t = 1e-3 * rng.standard_normal((2, 4, kinematics.body.n_dofs))
    for method, arguments in (
        (kinematics.place, (q,)), (kinematics.displacements, (q,)), (kinematics.deformation, (q,)),
        (kinematics.velocities, (q, q_t)), (kinematics.momentum, (q_t,)), (kinematics.kinetic_energy, (q, q_t)),
        (kinematics.rigid_motion, (q,)), (kinematics.elastic, (q,)),
        (lambda *both: kinematics.angular_momentum(*both, PLACE), (q, q_t)),
    ):  # fmt: skip
        each = [method(*one) for one in zip(*arguments, strict=True)]
        np.testing.assert_allclose(method(*arguments), each, atol=1e-12 * abs(np.array(each)).max())


def test_the_reference_place_is_the_mesh_turned_and_shifted(plank, body):
    nodes = plank[1].patch_nodes
    kinematics = FloatingKinematics(body, PLACE, Rotation.from_matrix(TURNED).as_rotvec()).at(nodes)
    np.testing.assert_allclose(
        kinematics.place(np.zeros(body.n_dofs)), PLACE + body.points[nodes] @ TURNED.T, atol=1e-12
    )


def test_rotation_matrices():
    vectors = np.array([[0, 0, 0], [1e-9, 0, 0], [0.1, 0.2, -0.3], [2, -2, 1], [0, 0, 2 * np.pi]])
    np.testing.assert_allclose(rotation_matrix(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-14)
