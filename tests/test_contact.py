"""Surfaces, gap rows, complementarity and the contact laws."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.optimize
from conftest import TOP, relative
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import exudyn_partition as ep
from exudyn_partition.algebra import complementarity
from exudyn_partition.algebra.complementarity import Complementarity
from exudyn_partition.contact.formulations.compliance import ComplianceContact
from exudyn_partition.contact.formulations.forward_increment import ForwardIncrement
from exudyn_partition.contact.formulations.lagrange import LagrangeContact
from exudyn_partition.contact.gaps import Side
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.errors import (
    ComplementarityError,
    EmptyRegionError,
    IndefiniteMatrixError,
    InputError,
    PenetrationError,
    RunError,
)
from exudyn_partition.fe.shapes import shape_functions
from exudyn_partition.frames.inertial import InertialKinematics
from exudyn_partition.surfaces.rows import pair_surfaces
from exudyn_partition.surfaces.surface import Surface, closest_points

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def dome(height=0.1):
    """One quadratic facet bent upwards."""
    middle = (CORNERS + np.roll(CORNERS, -1, axis=0)) / 2 + [0, 0, height]
    return np.vstack([CORNERS, middle])


def saddle(height=0.1):
    """One quad, not a parallelogram, with its corners up and down in turn."""
    return np.array([[0.0, 0, height], [1, 0, -height], [1.1, 0.9, height], [0, 1, -height]])


@pytest.mark.parametrize("n_nodes", [3, 6, 4])
def test_shape_functions_reproduce_positions_and_their_derivatives(n_nodes):
    local = np.random.default_rng(0).random((20, 2)) / 2
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) if n_nodes == 4 else dome(0.0)[:n_nodes]
    values, *derivatives = shape_functions(local, n_nodes).swapaxes(0, 1)
    np.testing.assert_allclose(values.sum(axis=1), 1, atol=1e-14)
    np.testing.assert_allclose((values @ nodes)[:, :2], local, atol=1e-14)
    for i, h in enumerate(1e-6 * np.eye(2)):
        slope = (shape_functions(local + h, n_nodes)[:, 0] - shape_functions(local - h, n_nodes)[:, 0]) / 2e-6
        np.testing.assert_allclose(derivatives[i], slope, atol=1e-9)


@pytest.mark.parametrize("facet", [dome, saddle])
@settings(max_examples=60, deadline=None)
@given(
    foot=arrays(float, 2, elements=st.floats(-0.4, 1.2)),
    lift=st.floats(-0.3, 0.3),
    height=st.floats(-0.1, 0.1),
)
def test_closest_point_is_the_nearest_of_the_whole_facet(facet, foot, lift, height):
    """Within a third of a facet's size; further away a curved facet may have several nearest points."""
    point = np.array([*foot, lift])
    nodes = facet(height)
    got = closest_points(point[None], nodes[None])
    grid = np.array([(i / 60, j / 60) for i in range(61) for j in range(61 if len(nodes) == 4 else 61 - i)])
    nearest = np.linalg.norm(shape_functions(grid, len(nodes))[:, 0] @ nodes - point, axis=1).min()
    distance = np.linalg.norm(got.weights[0] @ nodes - point)
    assert distance <= nearest + 1e-9
    assert np.hypot(got.gap[0], got.offset[0]) == pytest.approx(distance, abs=1e-12)


def test_gap_to_a_sphere(sphere):
    """Points around a quadratic mesh of a sphere: the gap is their distance from it, inside negative."""
    fem, partition = sphere
    surface = Surface.of(fem.points, partition.patches[0], np.zeros(3))
    around = np.random.default_rng(0).uniform(-0.15e-3, 0.15e-3, (50, 2))
    for height in (-5e-6, 5e-6):
        z = 0.01 - np.sqrt(0.01**2 - (around**2).sum(axis=1)) - height
        got = closest_points(np.column_stack([around, z]), surface.points[surface.facets])
        np.testing.assert_allclose(got.gap, height, atol=2e-8)


@pytest.mark.parametrize("distance", [0.005, 0.5])
def test_closest_point_from_afar(distance):
    """Of a curved facet the foot of the normal, however far: Gauss and Newton's steps would go past it."""
    nodes = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0.03], [0.5, 0.5, 0.05], [0, 0.5, 0.04]]) * 1e-3
    local = np.array([[0.2, 0.3], [0.5, 0.1], [0.1, 0.7]])
    shape = shape_functions(local, 6) @ nodes
    normal = np.cross(shape[:, 1], shape[:, 2])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    found = closest_points(shape[:, 0] + distance * normal, nodes[None])
    np.testing.assert_allclose(found.local, local, atol=1e-9)
    np.testing.assert_allclose(found.gap, distance, rtol=1e-12)


@pytest.fixture(scope="module")
def surfaces(sphere, other_sphere):
    fem, partition = sphere
    other, other_partition = other_sphere
    return Surface.of(fem.points, partition.patches[0], np.zeros(3)), Surface.of(
        other.points, other_partition.patches[0], np.zeros(3)
    )


def test_action_is_reaction_and_rigid_motion_opens_the_gap(surfaces):
    slave, master = surfaces
    rows = pair_surfaces(slave, master)
    G_s, G_m = rows.matrices(len(slave.points), len(master.points))
    push = np.random.default_rng(0).random(len(rows))
    forces = [(G.T @ push).reshape(-1, 3) for G in (G_s, G_m)]
    np.testing.assert_allclose(forces[0].sum(axis=0), -forces[1].sum(axis=0), atol=1e-12)
    np.testing.assert_allclose(G_s @ np.tile([0, 0, 1.0], len(slave.points)), rows.normal[:, 2], atol=1e-12)
    # Lifted by 3 um, the reference gaps of the same pairs are that much larger along their normals.
    lifted = pair_surfaces(replace(slave, points=slave.points + np.array([0, 0, 3e-6])), master)
    assert relative(lifted.gap, rows.gap + 3e-6 * rows.normal[:, 2]) < 1e-3


def test_gap_between_two_spheres(surfaces):
    rows = pair_surfaces(*surfaces, "node-to-segment")
    r = np.linalg.norm(surfaces[0].points[rows.points.row_nodes, :2], axis=1)
    np.testing.assert_allclose(rows.gap, r**2 / 0.01, atol=1e-7)


@pytest.mark.parametrize("ball_is_slave", [True, False])
def test_pairs_do_not_depend_on_the_way_to_go(bodies, ball_is_slave):
    """From 0.2 m above: the flat patch gives the line, the ball's own normal is off by its mesh."""
    target = bodies[1].surface(np.zeros(3))
    touching, apart = (bodies[0].surface(np.add(TOP, [0, 0, height])) for height in (0.0, 0.2))
    pairs = [(ball, target) if ball_is_slave else (target, ball) for ball in (touching, apart)]
    near, far = (pair_surfaces(*both) for both in pairs)
    np.testing.assert_array_equal(near.points.row_nodes, far.points.row_nodes)
    sizes = [len(surface.points) for surface in pairs[0]]
    for ours, theirs in zip(far.interpolation(*sizes), near.interpolation(*sizes), strict=True):
        np.testing.assert_allclose(ours.toarray(), theirs.toarray(), atol=2e-3)
    np.testing.assert_allclose(far.gap, near.gap + 0.2 * abs(far.normal[:, 2]), atol=1e-7)


def test_a_direction_that_is_given_leads(sphere, other_sphere):
    """Two spheres a metre apart: along the mesh's own mean normals they would miss each other."""
    (fem, part), (other, other_part) = sphere, other_sphere
    given = ep.Partition.ball(fem, (0, 0, 0), 0.45e-3, direction=[0, 0, -1])
    master = Surface.of(other.points, other_part.patches[0], np.zeros(3))
    touching = pair_surfaces(Surface.of(fem.points, given.patches[0], np.zeros(3)), master)
    apart = pair_surfaces(Surface.of(fem.points, given.patches[0], np.array([0, 0, 1.0])), master)
    np.testing.assert_array_equal(touching.points.row_nodes, apart.points.row_nodes)
    np.testing.assert_allclose(apart.gap, touching.gap + abs(touching.normal[:, 2]), rtol=1e-6)
    with pytest.raises(EmptyRegionError):
        pair_surfaces(Surface.of(fem.points, part.patches[0], np.array([0, 0, 1.0])), master)


def test_penetration_at_the_start(surfaces):
    slave, master = surfaces
    pushed = replace(slave, points=slave.points - [0, 0, 1e-4])
    with pytest.raises(PenetrationError, match=r"start inside the other body, the worst by .* Move one body"):
        pair_surfaces(pushed, master)


def test_patches_that_do_not_face_each_other(surfaces):
    slave, master = surfaces
    with pytest.raises(EmptyRegionError, match=r"none of the .* contact points of the slave faces a facet"):
        pair_surfaces(replace(slave, points=slave.points + np.array([0.05, 0, 0])), master)
    with pytest.raises(EmptyRegionError, match="outward normals"):
        pair_surfaces(replace(slave, direction=-slave.direction), master)


def conditions(F, h, lam):
    w = F @ lam + h
    scale = abs(h).max() + 1e-300
    assert (lam >= 0).all()
    assert w.min() > -1e-9 * scale
    assert abs(lam * w).max() <= 1e-9 * scale * max(lam.max(), 1e-300)


@pytest.mark.parametrize("patience", [10, 0])
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(1, 40), shift=st.floats(-3, 3))
def test_complementarity_conditions(patience, seed, n, shift):
    """Also with no patience at all, which leaves single pivots alone to find the answer."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n + 2))
    F = A @ A.T + 1e-3 * np.eye(n)
    problem = Complementarity(F)
    before, complementarity._PATIENCE = complementarity._PATIENCE, patience
    try:
        for _ in range(3):  # warm-started from the last active set
            h = rng.standard_normal(n) + shift
            lam = problem.solve(h)
            conditions(F, h, lam)
            L = np.linalg.cholesky(F)  # the oracle: min |L' x + L^-1 h| over x >= 0
            expected = scipy.optimize.nnls(L.T, -np.linalg.solve(L, h), maxiter=1000)[0]
            np.testing.assert_allclose(lam, expected, atol=1e-6 * (1 + expected.max()))
    finally:
        complementarity._PATIENCE = before


def test_an_unchanged_active_set_takes_one_iteration():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((60, 80))
    problem = Complementarity(A @ A.T)
    h = rng.standard_normal(60)
    problem.solve(h)
    before = problem.iterations
    problem.solve(1.001 * h)
    assert problem.iterations == before + 1


def test_bad_complementarity_problems():
    with pytest.raises(IndefiniteMatrixError, match="not positive definite"):
        Complementarity(np.array([[1.0, 2.0], [2.0, 1.0]]))
    with pytest.raises(IndefiniteMatrixError, match="symmetric"):
        Complementarity(np.array([[1.0, 0.5], [0.0, 1.0]]))
    with pytest.raises(ComplementarityError, match="not finite"):
        Complementarity(np.eye(2)).solve(np.array([1.0, np.nan]))


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


@pytest.fixture(scope="module")
def nodal(pair_of):
    """Ball and block in the paper's basis."""
    return pair_of("free")


def placed(mbs, bodies, position=TOP):
    """Partition bodies of a model, the first shifted."""
    return [ep.CreatePartitionBody(mbs, bodies[0], referencePosition=position), ep.CreatePartitionBody(mbs, bodies[1])]


def test_formulations_name_the_bases_that_they_need(mbs, bodies, nodal):
    flexible, massive = placed(mbs, bodies), placed(mbs, nodal)
    with pytest.raises(InputError, match="'compliance' needs a residual flexibility"):
        ep.CreatePartitionContact(mbs, *massive)
    with pytest.raises(InputError, match="'lagrange' needs contact patches that move"):
        ep.CreatePartitionContact(mbs, *flexible, formulation="lagrange")


def test_multipliers_notice_a_solver_that_is_not_central_differences(nodal):
    gaps = PatchGaps(*sides(nodal), "node-to-segment")
    law = LagrangeContact(gaps)
    q = np.zeros(sum(body.n_dofs for body in nodal))
    v = np.concatenate([-nodal[0].rigid[:, 2], np.zeros(nodal[1].n_dofs)])
    h, together = 1e-9, ForwardIncrement([law], [np.arange(len(q))])
    (c,) = together.increment([(q, v, 0 * q)], h)
    gap = gaps.held.gap + law.G @ (q + h * (v + h * c))
    assert gap.min() > -1e-18
    together.increment([(q + h * (v + h * c), v, 0 * q)], h)  # the step that central differences take
    with pytest.raises(RunError, match="needs Exudyn's explicit solver VelocityVerlet"):
        together.increment([(q + h * v, v, 0 * q)], h)


class FlatRows:
    """Gaps of a plate of two coordinates, heave and tilt, on forty rows: all but two are redundant."""

    n, size, moving, row_nodes = 2, 1.0, False, np.arange(40)
    H = np.column_stack([np.ones(40), np.linspace(-1, 1, 40)])
    slave = SimpleNamespace(surface=SimpleNamespace(points=np.zeros((40, 3))))

    def reset(self):
        self.held = self

    def at(self, q):
        return self.H @ q

    def jacobian(self, index):
        return self.H[index]

    def moved(self, q, way):
        return q + way

    def accelerations(self, rows):
        return rows.T / np.array([[2.0], [0.5]])  # mass and inertia


def test_redundant_rows_have_a_unique_total_force():
    """The plate falls flat: the impulse of all multipliers together stops it in a step."""
    law, h, mass = LagrangeContact(FlatRows()), 1e-3, 2.0
    falling = np.zeros(2), np.array([-1.0, 0.0]), np.zeros(2)
    (push,) = ForwardIncrement([law], [np.arange(2)]).increment([falling], h)
    assert law.lam.sum() == pytest.approx(mass * 1.0 / h, rel=1e-8)
    np.testing.assert_allclose(push, [1.0 / h, 0.0], atol=1e-6 / h)
    assert (law.lam >= 0).all()
