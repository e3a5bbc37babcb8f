"""Rigid surfaces: gaps to them, surfaces that a body carries, and surfaces that are none."""

import numpy as np
import pytest
from oracles import compliant, floating, inertial, moved
from scipy.spatial.transform import Rotation

from exudyn_partition.algebra.coulomb import Coulomb
from exudyn_partition.algebra.products import dense
from exudyn_partition.contact import loops
from exudyn_partition.contact.normal_rows import NormalRows
from exudyn_partition.contact.rigid import RigidCylinder, RigidGaps, RigidPlane, RigidSphere
from exudyn_partition.contact.tangential import TangentialRows
from exudyn_partition.errors import InputError, PenetrationError
from exudyn_partition.frames.floating import FloatingKinematics


@pytest.mark.parametrize("surface", [
    RigidPlane((0, 0, 0), (0, 0, 2.0)),
    RigidSphere((0, 0, -0.02), 0.02),
    RigidCylinder((0, 0, -0.02), (3.0, 0, 0), 0.02),
    RigidCylinder((0, 0, 0.02), (3.0, 0, 0), 0.02, hollow=True),
])  # fmt: skip
def test_gap_to_rigid_surfaces(round_body, surface):
    gaps = RigidGaps(inertial(round_body), surface, "node-to-segment")
    x = round_body.points[round_body.partition.patches[0].nodes] + [0, 0, 5e-6]
    expected = {
        RigidPlane: x[:, 2],
        RigidSphere: np.linalg.norm(x - [0, 0, -0.02], axis=1) - 0.02,
        RigidCylinder: np.hypot(x[:, 1], x[:, 2] + 0.02) - 0.02,
    }[type(surface)]
    if getattr(surface, "hollow", False):
        expected = 0.02 - np.hypot(x[:, 1], x[:, 2] - 0.02)
    np.testing.assert_allclose(gaps.at(moved(inertial(round_body), [0, 0, 5e-6])), expected, atol=1e-12)
    assert gaps.moving == (not isinstance(surface, RigidPlane))


def test_a_rigid_surface_that_is_carried(round_body):
    """Contact with a plane that a body turns is that of the patch turned the other way."""
    A = FloatingKinematics(round_body, np.zeros(3), np.array([0.4, 0.2, -0.3])).frame(np.zeros(round_body.n_dofs))[1]
    place = np.array([0.1, 0.2, 0.3])
    side = floating(round_body, place, (0.4, 0.2, -0.3))
    law = compliant(RigidGaps(side, RigidPlane(), pose=lambda: (place, A)))
    law.at(moved(side, A @ [0, 0, -4e-6]))
    at_rest = compliant(RigidGaps(inertial(round_body), RigidPlane()))
    at_rest.at(moved(inertial(round_body), [0, 0, -4e-6]))
    assert at_rest.evaluation.lam.sum() > 100
    assert law.evaluation.lam.sum() == pytest.approx(at_rest.evaluation.lam.sum(), rel=1e-6)
    np.testing.assert_allclose(
        A.T @ law.evaluation.resultant(),
        at_rest.evaluation.resultant(),
        rtol=1e-6,
        atol=1e-6 * at_rest.evaluation.lam.sum(),
    )


@pytest.mark.parametrize("surface", [RigidPlane(), RigidCylinder((0, 0, -0.02), (1.0, 0.3, 0), 0.02)])
def test_rows_change_with_the_motion_of_the_carrier(round_body, surface):
    """Gaps and ways along the tangents, where the carrier stands far from the origin, shifts and turns."""
    turn, place = np.array([0.4, 0.2, -0.3]), np.array([0.1, 0.2, 0.3])
    A = Rotation.from_rotvec(turn).as_matrix()
    v, w, now = np.array([0.3, -0.2, 0.1]), np.array([-0.5, 0.7, 1.1]), {"t": 0.0}

    def pose():
        return place + now["t"] * v, Rotation.from_rotvec(now["t"] * w).as_matrix() @ A

    side = floating(round_body, place, turn)
    gaps = RigidGaps(side, surface, pose=pose, motion=lambda: (v, w))
    q, rows = moved(side, A @ [0, 0, 3e-6]), TangentialRows(gaps)
    every = np.arange(len(gaps.at(q)))
    rows.record_places()
    found = (rows.carrier_rows(every) @ np.r_[v, w]).reshape(-1, 3)
    np.testing.assert_allclose(
        found[:, 0], gaps.carrier.rows(gaps.stage, gaps.present.places[0]) @ np.r_[v, w], rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(rows.rates(np.zeros(len(q))), found, rtol=0, atol=1e-12)
    _, rate, _ = gaps.closing(q, np.zeros(len(q)), np.zeros(len(q)))
    np.testing.assert_allclose(rate[: len(every)], found[:, 0], rtol=0, atol=1e-12)
    changes = []
    for now["t"] in (-1e-6, 1e-6):
        changes.append(np.column_stack([gaps.at(q), rows.way()]))
    np.testing.assert_allclose((changes[1] - changes[0]) / 2e-6, found, rtol=0, atol=1e-5 * abs(found).max())


@pytest.mark.parametrize("friction", [None, 0.3])
@pytest.mark.parametrize("surface", [RigidPlane(), RigidCylinder((0, 0, -0.02), (1.0, 0.3, 0), 0.02)])
def test_the_carrier_bears_the_reaction(round_body, surface, friction):
    """By virtual work: what closed rows change with the carrier's motion; and the patch bears the opposite force."""
    turn, place = np.array([0.4, 0.2, -0.3]), np.array([0.1, 0.2, 0.3])
    A, side = Rotation.from_rotvec(turn).as_matrix(), floating(round_body, place, turn)
    law = compliant(RigidGaps(side, surface, pose=lambda: (place, A)), friction and Coulomb(friction))
    for n, way in enumerate([(0, 0, 0), (0, 0, -4e-6), (1e-6, 2e-6, -5e-6)]):
        law.at(moved(side, A @ way))
        law.accept(float(n))
    force = law.evaluation.on_carrier(place)
    np.testing.assert_allclose(
        force,
        law.evaluation.row_carrier().T @ law.evaluation.on_rows[law.evaluation.index].ravel(),
        rtol=1e-9,
        atol=1e-9,
    )
    (on_patch,), elsewhere = law.evaluation.nodal_forces(), place + np.array([0.3, -0.1, 0.2])
    np.testing.assert_allclose(on_patch.sum(axis=0), -force[:3], rtol=1e-9)
    assert (-A.T @ force[:3])[2] > 50
    moment = np.cross(law.gaps.centre + law.gaps.present.places[0] - elsewhere, on_patch).sum(axis=0)
    np.testing.assert_allclose(law.evaluation.on_carrier(elsewhere)[3:], -moment, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("friction", [None, 0.3])
def test_moments_of_a_contact_far_from_the_origin(round_body, friction):
    """Points count from a place near the contact; moments about any point in space are those of the nodes' forces."""
    place, point = np.array([3.0, -2.0, 0.5]), np.array([0.3, 1.0, -0.7])
    side = inertial(round_body, place)
    law = compliant(RigidGaps(side, RigidPlane(place)), friction and Coulomb(friction))
    for n, way in enumerate([(0, 0, 0), (0, 0, -4e-6), (2e-6, 0, -4e-6)]):
        law.at(moved(side, way))
        law.accept(float(n))
    x = place + way + round_body.points[round_body.partition.patches[0].nodes]
    moment = np.cross(x - point, law.evaluation.nodal_forces()[0]).sum(axis=0)
    np.testing.assert_allclose(law.evaluation.moment(point), moment, rtol=1e-9)
    assert np.linalg.norm(moment) > 50


def test_the_gap_of_a_surface_is_that_of_its_lowest_point(flat_body):
    """Which lies within a facet, where a small sphere stands before a plate."""
    surface = inertial(flat_body).surface
    middle = surface.points[surface.facets[0, :3]].mean(axis=0)
    sphere = RigidSphere(np.add(middle, [0, 0, 1e-3 + 2e-6]), 1e-3)
    gap = RigidGaps(inertial(flat_body), sphere).surface_gap(np.zeros(flat_body.n_dofs))
    assert 2e-6 <= gap < sphere.project(surface.points)[0].min() - 1e-6


def test_bad_rigid_surfaces(round_body):
    with pytest.raises(PenetrationError, match="start inside the rigid surface"):
        RigidGaps(inertial(round_body, (0, 0, -1e-4)), RigidPlane())
    with pytest.raises(InputError, match="faces away"):
        RigidGaps(inertial(round_body), RigidPlane((0, 0, -1), (0, 0, -1)))
    with pytest.raises(InputError, match="normal: expected a vector"):
        RigidPlane((0, 0, 0), (0, 0, 0))
    with pytest.raises(InputError, match="radius"):
        RigidSphere((0, 0, 0), -1.0)


@pytest.mark.parametrize("carried", [False, True])
@pytest.mark.parametrize(
    "surface",
    [
        RigidPlane((0.1, 0.2, 0.3), (1.0, 2.0, -1.0)),
        RigidSphere((0.1, 0.2, 0.3), 0.05),
        RigidCylinder((0.1, 0.2, 0.3), (1.0, 2.0, -1.0), 0.05),
        RigidCylinder((0.1, 0.2, 0.3), (1.0, 2.0, -1.0), 0.05, hollow=True),
    ],
)
def test_loops_project_points_as_the_surface_does(surface, carried):
    """One compiled call finds gaps and normals in space, also where a body carries the surface."""
    if not loops.at_once():
        pytest.skip("only compiled loops do it in one call")
    rng = np.random.default_rng(1)
    x, place, axes = rng.normal(size=(7, 3)), rng.normal(size=3), Rotation.from_rotvec([0.3, -0.4, 0.5]).as_matrix()
    gap, normals = surface.project((x - place) @ axes if carried else x)
    found = loops.projected(surface.primitive, x, np.concatenate([place, axes.ravel()]) if carried else np.empty(0))
    assert found[0] == pytest.approx(gap, abs=1e-14)
    assert found[1] == pytest.approx(normals @ axes.T if carried else normals, abs=1e-14)


def test_an_anchor_keeps_the_growth_that_was_there(round_body):
    """The body turns, finds its flexibility, and stops: another contact goes on from there with the same one."""
    gaps = RigidGaps(floating(round_body), RigidSphere(np.array([0.0, 0.0, -2e-3]), 2e-3))
    (side,), every = gaps.sides, np.arange(len(gaps.row_nodes))
    q, still = np.zeros(side.n), np.empty(0)
    gaps.grow([side.kinematics.growing(1e4 * np.eye(side.n)[3])])
    gaps.at(q)
    F, state, other = NormalRows(gaps).flexibility(every), gaps.after(), gaps.for_run()
    other.begin(state)
    other.grow([still])
    other.at(q)
    np.testing.assert_allclose(NormalRows(other).flexibility(every), F, rtol=0, atol=1e-14 * abs(F).max())
    np.testing.assert_array_equal(other.after().anchor.growing, state.growing)
    slow = gaps.for_run()
    slow.at(q)
    assert abs(NormalRows(slow).flexibility(every) - F).max() > 1e-9 * abs(F).max()


def test_one_call_places_nodes_and_pushes_them_as_the_kinematics_do(round_body):
    """Of a body that turns, grows by that, and meets a sphere."""
    if not loops.at_once():
        pytest.skip("numba is not installed")
    gaps = RigidGaps(floating(round_body), RigidSphere(np.array([0.0, 0.0, -2e-3]), 1e-3))
    (side,), rows = gaps.stage.rows.sides, gaps.stage.rows
    rng = np.random.default_rng(2)
    q = 1e-6 * rng.normal(size=side.n)
    q[3:6] = 0.3, -0.2, 0.5
    for omega in (0.0, 3e3):
        growing = side.kinematics.growing(omega * np.eye(side.n)[3])
        grows = side.kinematics.spin is not None and omega > 0.0
        assert bool(len(growing)) == grows
        x = side.places_begun(q, growing)
        gap, normals = loops.rigid_gaps(rows.flat, side, gaps.primitive, q, np.empty(0), growing, x)
        np.testing.assert_allclose(x, side.place(q, growing), rtol=0, atol=1e-15)
        of_points, expected = gaps.surface.project(rows.points.at(side.place(q, growing)))
        np.testing.assert_allclose(gap, rows.points.average(of_points), rtol=0, atol=1e-14)
        np.testing.assert_allclose(normals, expected, rtol=0, atol=1e-11)
    lam = rng.uniform(0.1, 1.0, size=len(gap))
    pushed = loops.pushed_rigid(rows.flat, lam, normals, side, q)
    forces = rows.points.spread(lam)[:, None] * normals
    on_nodes = np.zeros((len(x), 3))
    np.add.at(on_nodes, rows.points.nodes, rows.points.weights[:, :, None] * forces[:, None, :])
    by_nodes = side.kinematics.generalised(q, on_nodes)
    np.testing.assert_allclose(pushed, by_nodes, rtol=0, atol=1e-12 * abs(by_nodes).max())
    np.testing.assert_allclose(loops.resultant(rows.flat, lam, normals), forces.sum(axis=0), rtol=1e-12)
    about = np.array([1e-3, -2e-3, 4e-3])
    moment = np.cross(rows.points.at(x) - about, forces).sum(axis=0)
    np.testing.assert_allclose(loops.rigid_moment(rows.flat, lam, normals, x, about), moment, rtol=1e-11)
    gaps.at(q)
    some = np.array([1, 4])
    by_matrices = dense(gaps.stage.on_coordinates(q, some))
    np.testing.assert_allclose(gaps.jacobian(some), by_matrices, rtol=0, atol=1e-12 * abs(by_matrices).max())
    along = normals @ side.kinematics.frame(q)[1]
    np.testing.assert_allclose(side.kinematics.in_frame(q, normals), along, rtol=0, atol=1e-15)


@pytest.mark.parametrize("carried", [False, True])
def test_one_call_finds_how_far_nodes_have_come_from_where_they_were(round_body, carried):
    """As seen from a sphere that may turn with a carrier; gaps and normals are those without this question."""
    if not loops.at_once():
        pytest.skip("numba is not installed")
    gaps, rng = (
        RigidGaps(floating(round_body), RigidSphere(np.array([0.0, 0.0, -2e-3]), 1e-3)),
        np.random.default_rng(3),
    )
    (side,), rows, still = gaps.stage.rows.sides, gaps.stage.rows, np.empty(0)
    place, axes = 1e-3 * rng.normal(size=3), Rotation.from_rotvec([0.3, -0.4, 0.5]).as_matrix()
    pose = np.concatenate([place, axes.ravel()]) if carried else still
    q, nodes, here = 1e-6 * rng.normal(size=side.n), np.array([0, 5, 3]), 1e-3 * rng.normal(size=(3, 3))
    x, again = side.places_begun(q, still), side.places_begun(q, still)
    found = loops.near_gaps(rows.flat, side, gaps.primitive, (q, pose, still), x, nodes, here)
    expected = loops.rigid_gaps(rows.flat, side, gaps.primitive, q, pose, still, again)
    for a, b in zip(found, expected, strict=False):
        np.testing.assert_array_equal(a, b)
    seen = (x[nodes] - place) @ axes if carried else x[nodes]
    assert found[2] == pytest.approx(abs(seen - here).max(), rel=1e-12)
    here[1, 2] = np.nan
    assert np.isnan(loops.near_gaps(rows.flat, side, gaps.primitive, (q, pose, still), x, nodes, here)[2])
