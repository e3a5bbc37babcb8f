"""Patches that slide, rigid surfaces, integrated rows, and the laws on them."""

from dataclasses import replace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from conftest import SPHERE_RADIUS, box, relative

import exudyn_partition as ep
from exudyn_partition.contact.formulations.compliance import ComplianceContact
from exudyn_partition.contact.formulations.penalty import PenaltyContact, bed_stiffness
from exudyn_partition.contact.formulations.two_pass import TwoPass
from exudyn_partition.contact.gaps import Side
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.rigid import RigidCylinder, RigidGaps, RigidPlane, RigidSphere
from exudyn_partition.errors import ContactPatchWarning, InputError, MeshError, PenetrationError
from exudyn_partition.frames.floating import FloatingKinematics
from exudyn_partition.frames.inertial import InertialKinematics
from exudyn_partition.frames.rotations import rotation_matrix
from exudyn_partition.surfaces.pairs import MovingPairs
from exudyn_partition.surfaces.points import ROWS, contact_points
from exudyn_partition.surfaces.surface import closest_points


@pytest.fixture(scope="module")
def plate():
    """A steel plate, 16 x 16 x 5 mm, its upper face at z = 0, fine in the middle."""
    shape = box(0.016, 0.016, 0.005).Move((0, 0, -0.005))
    fem = ep.fe_model(shape, ep.STEEL, maxh=4e-3, refine=[ep.Refine((0, 0, 0), 1.2e-3, 0.35e-3)], grading=0.5)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1.6e-3, axes="xyz"), f_cut=120e3)


@pytest.fixture(scope="module")
def ball(request):
    """The session's ball with all three directions."""
    shape = occ.Sphere(occ.Pnt(0, 0, SPHERE_RADIUS), SPHERE_RADIUS)
    fem = ep.fe_model(shape, ep.STEEL, maxh=3.5e-3, refine=[ep.Refine((0, 0, 0), 0.6e-3, 0.25e-3)], grading=0.5)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1.0e-3, axes="xyz"), f_cut=150e3)


def inertial(body, at=(0.0, 0.0, 0.0)):
    return Side.of(InertialKinematics(body, np.array(at)))


def floating(body, at=(0.0, 0.0, 0.0), rotation=(0.0, 0.0, 0.0)):
    return Side.of(FloatingKinematics(body, np.array(at), np.array(rotation)))


def moved(side, translation, rotation=(0.0, 0.0, 0.0)):
    """Coordinates of a side whose body has moved as a whole."""
    if isinstance(side.kinematics, FloatingKinematics):
        return np.r_[translation, rotation, np.zeros(side.n - 6)]
    return side.kinematics.body.rigid @ np.r_[translation, rotation]


@pytest.mark.parametrize("kind", ROWS)
def test_rows_cover_the_patch_once(ball, kind):
    surface = ball.surface(np.zeros(3))
    points = contact_points(surface, kind)
    np.testing.assert_allclose(points.mean.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(points.weights.sum(axis=1), 1.0, atol=1e-12)
    corners = surface.points[surface.facets[:, :3]]
    flat = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert points.area.sum() == pytest.approx(flat, rel=2e-3)
    assert (points.area >= 0).all()
    uniform = points.mean.T @ points.area if kind == "integrated" else points.area
    forces = np.zeros(len(surface.points))
    forces[points.row_nodes] = points.area
    corners = np.unique(surface.facets[:, :3])
    inner = np.setdiff1d(corners, surface.facets[np.isin(surface.facets, surface.rim).any(axis=1)])
    np.testing.assert_allclose((points.pressures @ forces)[inner], 1.0, rtol=0.05)
    assert uniform.sum() == pytest.approx(points.area.sum(), rel=1e-12)
    assert points.area.sum() == pytest.approx(contact_points(surface, ROWS[0]).area.sum(), rel=1e-12)


def test_integrated_rows_turn_uniform_pressure_into_consistent_nodal_forces(ball):
    """On a quadratic facet the corners get nothing and the mid-side nodes a third of the area each."""
    points = contact_points(ball.surface(np.zeros(3)), "integrated")
    on_points = points.mean.T @ points.area
    on_nodes = np.zeros(len(ball.partition.patches[0].nodes))
    np.add.at(on_nodes, points.nodes, points.weights * on_points[:, None])
    facets = ball.surface(np.zeros(3)).facets
    corners, middles = np.unique(facets[:, :3]), np.unique(facets[:, 3:])
    assert on_nodes.sum() == pytest.approx(points.area.sum(), rel=1e-12)
    assert abs(on_nodes[corners]).max() < 0.02 * on_nodes[middles].max()


@pytest.mark.parametrize("kind", ROWS)
def test_facets_without_area(ball, kind):
    surface = ball.surface(np.zeros(3))
    points = surface.points.copy()
    points[surface.facets[3]] = points[surface.facets[3, 0]]
    with pytest.raises(MeshError, match="have no area, such as the one at"):
        contact_points(replace(surface, points=points), kind)


@pytest.mark.parametrize("kind", ROWS)
def test_moving_pairs_are_the_frozen_ones_where_nothing_slides(ball, plate, kind):
    laws = [ComplianceContact(PatchGaps(inertial(ball), inertial(plate), kind)) for _ in range(2)]
    laws[1].gaps.moving, laws[1].gaps._searched_at = True, None
    q = np.r_[moved(inertial(ball), [0, 0, -4e-6]), np.zeros(plate.n_dofs)]
    frozen, moving = (law.force(q) for law in laws)
    assert not laws[0].gaps.moving
    assert laws[1].gaps.moving
    assert laws[0].lam.sum() > 50
    assert laws[1].lam.sum() == pytest.approx(laws[0].lam.sum(), rel=2e-3)
    assert relative(moving, frozen) < 5e-3


@pytest.mark.parametrize("kind", ROWS)
def test_sliding_over_facets(ball, plate, kind):
    """The flat plate is as stiff here as there but for its mesh; the force has hardly a tangential part."""
    law = ComplianceContact(PatchGaps(inertial(ball), inertial(plate), kind))
    force = []
    for x in np.linspace(0, 0.6e-3, 61):
        q = np.r_[moved(inertial(ball), [x, 0.2 * x, -4e-6]), np.zeros(plate.n_dofs)]
        law.force(q)
        force.append(law.resultant())
    force = np.array(force)
    assert law.gaps.moving
    assert abs(force[:, 2] / force[:, 2].mean() - 1).max() < 0.05
    assert abs(np.diff(force[:, 2])).max() < 0.02 * force[:, 2].mean()
    assert abs(force[:, :2]).max() < 1e-3 * force[:, 2].mean()


@pytest.mark.parametrize("frame", [inertial, floating])
@pytest.mark.parametrize("kind", ROWS)
def test_gaps_change_as_their_jacobian_says(ball, plate, kind, frame):
    """Pairs held, and normals: those terms vanish at the closest point and for the flat master."""
    slave, master = frame(ball, (0, 0, 2e-6)), inertial(plate)
    gaps = PatchGaps(slave, master, kind)
    turn = [1e-3, -2e-3, 0.1] if frame is floating else [1e-4, -2e-4, 0]
    q = np.r_[moved(slave, [0.1e-3, 0, -3e-6], turn), np.zeros(plate.n_dofs)]
    gaps.moving = True
    gaps.at(q)
    rng, H = np.random.default_rng(0), gaps.jacobian(np.arange(len(gaps.row_nodes)))
    near = np.flatnonzero(gaps.at(q) < 10e-6)
    for _ in range(3):
        d = rng.standard_normal(gaps.n)
        d *= 1e-8 / abs(H @ d).max()
        if frame is floating:  # coordinates of rotation are a vector, velocities turn about the body's axes
            d[3:6] = 0
        slope = (gaps.at(q + d) - gaps.at(q - d)) / 2
        gaps.at(q)
        np.testing.assert_allclose(slope[near], (H @ d)[near], atol=2e-11)


def paths(ball, slave):
    """Coordinates of the ball on its way: it comes down, slides over facets, tilts, jumps and leaves."""
    rng = np.random.default_rng(0)
    for k, u in enumerate(np.linspace(0, 1, 120)):
        depth = 5e-6 * np.sin(2 * np.pi * u) + 2e-6
        jump = 0.2e-3 * rng.standard_normal() if k % 40 == 39 else 0.0
        tilt = [2e-4 * np.sin(9 * u), 1e-4 * u, 0.0]
        yield moved(slave, [0.5e-3 * u + jump, 0.1e-3 * u, -depth], tilt)


@pytest.mark.parametrize("ball_is_slave", [True, False])
@pytest.mark.parametrize("kind", ROWS)
def test_rows_that_are_not_followed_are_open(ball, plate, kind, ball_is_slave):
    """Against a search of all points at every place; and those that are have the gaps that it finds."""
    sides = [inertial(ball), inertial(plate)] if ball_is_slave else [inertial(plate), inertial(ball)]
    gaps = PatchGaps(*sides, kind)
    gaps.moving, fewest = True, np.inf
    for own in paths(ball, inertial(ball)):
        q = np.r_[own, np.zeros(plate.n_dofs)] if ball_is_slave else np.r_[np.zeros(plate.n_dofs), own]
        found = gaps.at(q)
        gaps._since = 0  # never frozen again
        every = gaps._project(*gaps.places(q))[0]
        expected = dict(zip(every.points.row_nodes, every.gap, strict=True))
        least = every.gap.min()
        assert found.min() == pytest.approx(least, abs=1e-10)
        followed = set(gaps.row_nodes)
        fewest = min(fewest, len(followed) / len(expected))
        assert all(gap > max(least, -0.25 * least) for node, gap in expected.items() if node not in followed)
        inner = [node in expected and not edge for node, edge in zip(gaps.row_nodes, gaps.at_edge, strict=True)]
        np.testing.assert_allclose(found[inner], [expected[node] for node in gaps.row_nodes[inner]], atol=2e-10)
    assert fewest < 0.5


@pytest.mark.parametrize("quadratic", [True, False])
def test_points_that_are_followed_over_facets_are_on_the_closest(ball, plate, quadratic):
    surface = ball.surface(np.zeros(3))
    facets = surface.facets if quadratic else surface.facets[:, :3]
    surface = replace(surface, facets=facets)
    neighbour, edge = surface.neighbours
    inner = neighbour >= 0
    mine = np.nonzero(inner)
    np.testing.assert_array_equal(neighbour[neighbour[inner], edge[inner]], mine[0])
    np.testing.assert_array_equal(edge[neighbour[inner], edge[inner]], mine[1])
    rng = np.random.default_rng(1)
    x = np.c_[rng.uniform(-0.3e-3, 0.3e-3, (40, 2)), np.full(40, -5e-6)]
    found = closest_points(x, surface.points[facets])
    pairs = MovingPairs(surface, found.facet, found.local)
    start = pairs.facet.copy()
    for _ in range(50):
        x = x + np.array([4e-6, 2e-6, 0.0])
        followed, gone = pairs.follow(np.arange(40), x, surface.points)
        assert not gone.any()
        found = closest_points(x, surface.points[facets])
        np.testing.assert_allclose(followed.gap, found.gap, rtol=1e-4)
    assert (pairs.facet != start).mean() > 0.5


def test_forces_are_the_same_wherever_both_bodies_are(ball, plate):
    """Both turned by 70 degrees about an oblique axis and carried away."""
    turn = np.array([0.7, -0.5, 0.9])
    axes = FloatingKinematics(ball, np.zeros(3), turn).frame(np.zeros(ball.n_dofs))[1]
    answers = []
    for rotation, A in ((np.zeros(3), np.eye(3)), (turn, axes)):
        sides = floating(ball, A @ [0.1e-3, 0, 2e-6] + [1, 2, 3], rotation), floating(plate, [1.0, 2, 3], rotation)
        law = ComplianceContact(PatchGaps(*sides))
        force = law.force(np.r_[moved(sides[0], A @ [0, 0, -5e-6]), np.zeros(plate.n_dofs)])
        answers.append((A.T @ law.resultant(), force[6 : ball.n_dofs]))
    np.testing.assert_allclose(answers[1][0], answers[0][0], rtol=1e-6, atol=1e-6 * answers[0][0][2])
    assert relative(answers[1][1], answers[0][1]) < 1e-6


def test_action_is_reaction_while_sliding(ball, plate):
    """Linear and angular momentum: forces and moments on both bodies cancel."""
    slave, master = floating(ball), floating(plate)
    law = ComplianceContact(PatchGaps(slave, master))
    q = np.r_[moved(slave, [0.3e-3, 0.1e-3, -4e-6], [1e-3, 2e-3, 0.2]), moved(master, [0, 0, 1e-7], [0, 1e-4, 0])]
    force = law.force(q)
    parts = force[: slave.n], force[slave.n :]
    total, moment = np.zeros(3), np.zeros(3)
    for side, part, own in zip((slave, master), parts, law.gaps.split(q), strict=True):
        r, A = side.kinematics.frame(own)
        total += part[:3]
        moment += np.cross(r, part[:3]) + A @ part[3:6]
    size = np.linalg.norm(law.resultant())
    assert size > 50
    np.testing.assert_allclose(total, 0, atol=1e-12 * size)
    np.testing.assert_allclose(moment, 0, atol=1e-9 * size * SPHERE_RADIUS)


def test_patches_far_apart_have_no_rows_and_are_hardly_searched(ball, plate, monkeypatch):
    gaps = PatchGaps(inertial(ball), inertial(plate))
    gaps.moving, searches = True, []
    project = PatchGaps._project
    monkeypatch.setattr(PatchGaps, "_project", lambda *a: searches.append(1) or project(*a))
    far = np.r_[moved(inertial(ball), [0, 0, 0.3]), np.zeros(plate.n_dofs)]
    for height in np.geomspace(0.3, 1e-6, 1000):
        q = np.r_[moved(inertial(ball), [0.2e-3 * np.sin(1e3 * height), 0, height]), np.zeros(plate.n_dofs)]
        gap = gaps.at(q)
        if height > 1.5 * gaps.size:
            assert not len(gap)
    assert len(searches) < 60
    assert 0 < gaps.closing(far, 0 * far, 0 * far)[0].min() < 0.301
    assert gap.min() == pytest.approx(project(gaps, *gaps.places(q))[0].gap.min(), abs=1e-10)


@pytest.mark.parametrize("surface", [None, ep.RigidPlane()])
def test_a_body_that_faces_away_turns_until_it_hits(ball, plate, surface):
    """A rolling ball of which the patch points aside at first, against the same when it nearly faces the plate."""
    omega, speed, late = 200.0, 0.5, 0.2  # [rad/s], [m/s], rad before the patch is lowest
    forces = []
    for angle in (1.6, late):
        wait = (angle - late) / omega
        turn = rotation_matrix(np.array([angle, 0.0, 0.0]))
        centre = np.array([0.0, 0.0, SPHERE_RADIUS + 1e-6 + speed * angle / omega])
        mbs = exu.SystemContainer().AddSystem()
        roll, down = [-omega, 0.0, 0.0], [0.0, 0.0, -speed]
        slave = ep.CreatePartitionBody(
            mbs, ball, frame="floating", referencePosition=centre - turn @ ball.centre_of_mass,
            referenceRotation=turn, initialVelocity=down, initialAngularVelocity=roll,
        )  # fmt: skip
        contact = ep.CreatePartitionContact(mbs, slave, surface or ep.CreatePartitionBody(mbs, plate))
        mbs.Assemble()
        assert contact.law.gaps.faced == (angle == late)
        assert any("do not face" in sentence for sentence in contact.left_out) == (angle != late)
        limit = ep.stability_limit(mbs)
        result = ep.solve_dynamic(mbs, end_time=wait + 1.2e-3, step=0.4e-6)
        force = contact.force(result)[result.t > wait]
        forces.append((force.max(), force.sum() * result.step, limit))
    np.testing.assert_allclose(forces[0][:2], forces[1][:2], rtol=5e-3)
    assert forces[0][2] == pytest.approx(forces[1][2], rel=0.03)
    assert forces[0][0] > 100


def test_a_contact_that_never_faces_says_so(ball):
    mbs = exu.SystemContainer().AddSystem()
    slave = ep.CreatePartitionBody(mbs, ball, frame="floating", initialVelocity=[0, 0, -1])
    ep.CreatePartitionContact(mbs, slave, ep.RigidPlane((0, 0, 0.1), (0, 0, -1)), name="ceiling")
    mbs.Assemble()
    with pytest.warns(ContactPatchWarning, match="'ceiling' never closed, and at the start .* did not face"):
        ep.solve_dynamic(mbs, end_time=1e-5, step=1e-6)


def test_pairs_freeze_again_when_the_sliding_stops(ball, plate):
    law = ComplianceContact(PatchGaps(inertial(ball), inertial(plate)))
    q = np.r_[moved(inertial(ball), [0.2e-3, 0, -4e-6]), np.zeros(plate.n_dofs)]
    law.force(q)
    assert law.gaps.moving
    moving = law.lam.sum()
    for _ in range(500):
        law.force(q)
    assert not law.gaps.moving
    assert law.lam.sum() == pytest.approx(moving, rel=1e-9)


def test_points_past_the_master_s_edge_carry_nothing(ball, plate):
    law = ComplianceContact(PatchGaps(inertial(ball), inertial(plate)))
    for x in np.linspace(0, 6e-3, 61):
        law.force(np.r_[moved(inertial(ball), [x, 0, -4e-6]), np.zeros(plate.n_dofs)])
        if law.edge_reached() is not None:
            break
    assert 1.1e-3 < x < 1.7e-3  # the contact's radius is 0.2 mm, the patch's 1.6
    for further in np.linspace(x, 6e-3, 61):
        law.force(np.r_[moved(inertial(ball), [further, 0, -4e-6]), np.zeros(plate.n_dofs)])
    assert not law.lam.any()


@pytest.mark.parametrize("surface", [
    RigidPlane((0, 0, 0), (0, 0, 2.0)),
    RigidSphere((0, 0, -0.02), 0.02),
    RigidCylinder((0, 0, -0.02), (3.0, 0, 0), 0.02),
])  # fmt: skip
def test_gap_to_rigid_surfaces(ball, surface):
    gaps = RigidGaps(inertial(ball), surface, "node-to-segment")
    x = ball.points[ball.partition.patches[0].nodes] + [0, 0, 5e-6]
    expected = {
        RigidPlane: x[:, 2],
        RigidSphere: np.linalg.norm(x - [0, 0, -0.02], axis=1) - 0.02,
        RigidCylinder: np.hypot(x[:, 1], x[:, 2] + 0.02) - 0.02,
    }[type(surface)]
    np.testing.assert_allclose(gaps.at(moved(inertial(ball), [0, 0, 5e-6])), expected, atol=1e-12)
    assert gaps.moving == (not isinstance(surface, RigidPlane))


def test_a_rigid_surface_that_is_carried(ball):
    """Contact with a plane that a body turns is that of the patch turned the other way."""
    A = FloatingKinematics(ball, np.zeros(3), np.array([0.4, 0.2, -0.3])).frame(np.zeros(ball.n_dofs))[1]
    place = np.array([0.1, 0.2, 0.3])
    side = floating(ball, place, (0.4, 0.2, -0.3))
    law = ComplianceContact(RigidGaps(side, RigidPlane(), pose=lambda: (place, A)))
    law.force(moved(side, A @ [0, 0, -4e-6]))
    at_rest = ComplianceContact(RigidGaps(inertial(ball), RigidPlane()))
    at_rest.force(moved(inertial(ball), [0, 0, -4e-6]))
    assert at_rest.lam.sum() > 100
    assert law.lam.sum() == pytest.approx(at_rest.lam.sum(), rel=1e-6)
    np.testing.assert_allclose(A.T @ law.resultant(), at_rest.resultant(), rtol=1e-6, atol=1e-6 * at_rest.lam.sum())


def test_bad_rigid_surfaces(ball):
    with pytest.raises(PenetrationError, match="start inside the rigid surface"):
        RigidGaps(inertial(ball, (0, 0, -1e-4)), RigidPlane())
    with pytest.raises(InputError, match="faces away"):
        RigidGaps(inertial(ball), RigidPlane((0, 0, -1), (0, 0, -1)))
    with pytest.raises(InputError, match="normal: expected a vector"):
        RigidPlane((0, 0, 0), (0, 0, 0))
    with pytest.raises(InputError, match="radius"):
        RigidSphere((0, 0, 0), -1.0)


def closed(ball, plate):
    return np.r_[moved(inertial(ball), [0, 0, -4e-6]), np.zeros(plate.n_dofs)]


def test_penalty_layer_yields_as_the_residual_flexibility_does(ball, plate):
    """Under uniform pressure alike; a small contact gets no help from what lies around it, and is softer by a few."""
    sides = inertial(ball), inertial(plate)
    compliance, gaps = ComplianceContact(PatchGaps(*sides)), PatchGaps(*sides)
    layer = PenaltyContact(gaps, bed_stiffness(gaps))
    q = closed(ball, plate)
    for law in (compliance, layer):
        law.force(q)
    A = gaps.area
    pressed = A @ gaps.flexibility(np.arange(len(A))) @ A  # by a unit pressure
    assert layer.stiffness * pressed == pytest.approx(A.sum(), rel=1e-12)
    assert 0.25 < layer.lam.sum() / compliance.lam.sum() < 0.5


@pytest.mark.parametrize("law_of", [ComplianceContact, lambda gaps: PenaltyContact(gaps, bed_stiffness(gaps))])
def test_two_passes_are_the_mean_of_both(ball, plate, law_of):
    there, back = (law_of(PatchGaps(*sides)) for sides in (
        (inertial(ball), inertial(plate)), (inertial(plate), inertial(ball))
    ))  # fmt: skip
    both = TwoPass(there, back)
    q = closed(ball, plate)
    force, tangent = both.force(q), both.tangent()
    assert both.lam.sum() == pytest.approx((there.lam.sum() + back.lam.sum()) / 2, rel=1e-12)
    np.testing.assert_allclose(both.resultant()[2], both.lam.sum(), rtol=1e-3)
    d = 1e-12 * np.random.default_rng(0).standard_normal(len(q))
    assert relative(both.force(q + d) - both.force(q - d), -2 * tangent @ d) < 1e-4
    work = both.potential(q + d) - both.potential(q - d)
    assert work == pytest.approx(-2 * force @ d, rel=1e-3)
    assert both.node_areas.sum() == pytest.approx((there.node_areas.sum() + back.node_areas.sum()) / 2, rel=1e-12)
