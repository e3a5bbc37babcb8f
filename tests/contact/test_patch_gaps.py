"""Patches that slide, rigid surfaces, integrated rows, and the laws on them."""

import numpy as np
import pytest
from oracles import SPHERE_RADIUS, compliant, floating, inertial, moved, relative

import exudyn_partition as ep
from exudyn_partition.algebra.products import dense
from exudyn_partition.algebra.vectors import triangle_frame
from exudyn_partition.contact.normal_rows import NormalRows
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.frames.floating import FloatingKinematics
from exudyn_partition.surfaces.points import ROWS


@pytest.mark.parametrize("kind", ROWS)
def test_moving_pairs_are_the_frozen_ones_where_nothing_slides(round_body, flat_body, kind):
    laws = [compliant(PatchGaps(inertial(round_body), inertial(flat_body), kind)) for _ in range(2)]
    laws[1].gaps.follow()
    q = np.r_[moved(inertial(round_body), [0, 0, -4e-6]), np.zeros(flat_body.n_dofs)]
    frozen, moving = (law.at(q).generalised for law in laws)
    assert not laws[0].gaps.moving
    assert laws[1].gaps.moving
    assert laws[0].evaluation.lam.sum() > 50
    assert laws[1].evaluation.lam.sum() == pytest.approx(laws[0].evaluation.lam.sum(), rel=2e-3)
    assert relative(moving, frozen) < 5e-3


@pytest.mark.parametrize("kind", ROWS)
def test_sliding_over_facets(round_body, flat_body, kind):
    """The flat plate is as stiff here as there but for its mesh; the force has hardly a tangential part."""
    law = compliant(PatchGaps(inertial(round_body), inertial(flat_body), kind))
    force = []
    for x in np.linspace(0, 0.6e-3, 61):
        q = np.r_[moved(inertial(round_body), [x, 0.2 * x, -4e-6]), np.zeros(flat_body.n_dofs)]
        law.at(q)
        force.append(law.evaluation.resultant())
    force = np.array(force)
    assert law.gaps.moving
    assert abs(force[:, 2] / force[:, 2].mean() - 1).max() < 0.05
    assert abs(np.diff(force[:, 2])).max() < 0.02 * force[:, 2].mean()
    assert abs(force[:, :2]).max() < 1e-3 * force[:, 2].mean()


@pytest.mark.parametrize("frame", [inertial, floating])
@pytest.mark.parametrize("kind", ROWS)
def test_gaps_change_as_their_jacobian_says(round_body, flat_body, kind, frame):
    """Pairs held, and normals: those terms vanish at the closest point and for the flat master."""
    slave, master = frame(round_body, (0, 0, 2e-6)), inertial(flat_body)
    gaps = PatchGaps(slave, master, kind)
    turn = [1e-3, -2e-3, 0.1] if frame is floating else [1e-4, -2e-4, 0]
    q = np.r_[moved(slave, [0.1e-3, 0, -3e-6], turn), np.zeros(flat_body.n_dofs)]
    gaps.follow()
    gaps.at(q)
    rng, H = np.random.default_rng(0), gaps.jacobian(np.arange(len(gaps.row_nodes)))
    some = np.array([0, 2])
    by_matrices = dense(gaps.stage.on_coordinates(q, some))  # of many rows; those of few are one call
    np.testing.assert_allclose(dense(gaps.jacobian(some)), by_matrices, rtol=0, atol=1e-12 * abs(by_matrices).max())
    near = np.flatnonzero(gaps.at(q) < 10e-6)
    for _ in range(3):
        d = rng.standard_normal(gaps.n)
        d *= 1e-8 / abs(H @ d).max()
        if frame is floating:  # coordinates of rotation are a vector, velocities turn about the body's axes
            d[3:6] = 0
        slope = (gaps.at(q + d) - gaps.at(q - d)) / 2
        gaps.at(q)
        np.testing.assert_allclose(slope[near], (H @ d)[near], atol=2e-11)


@pytest.mark.parametrize("frame", [inertial, floating])
@pytest.mark.parametrize("kind", ROWS)
def test_forces_of_followed_rows_belong_to_their_gaps(round_body, flat_body, kind, frame):
    """Generalised forces of rows that slide are the transpose of their gaps' derivative, as power asks for."""
    slave = frame(round_body)
    law = compliant(PatchGaps(slave, inertial(flat_body), kind))
    for x in np.linspace(0, 0.1e-3, 4):
        force = law.at(np.r_[moved(slave, [x, 0, -4e-6]), np.zeros(flat_body.n_dofs)]).generalised
    H = law.gaps.jacobian(np.arange(len(law.evaluation.lam)))
    assert law.gaps.moving
    assert np.count_nonzero(law.evaluation.lam) > 1
    np.testing.assert_allclose(force, law.evaluation.lam @ H, rtol=0, atol=1e-11 * abs(force).max())


def test_the_flexibility_is_that_of_the_present_places(round_body, flat_body):
    """Within what it may change while points move by a hundredth of a facet; for rows that stay the same."""
    slave, some = floating(round_body), np.arange(5)
    gaps = PatchGaps(slave, floating(flat_body))
    first, found = None, None
    for n in range(31):
        q = np.r_[moved(slave, [n * 0.006 * gaps.size, 0, -4e-6]), np.zeros(flat_body.n_dofs)]
        gaps.at(q)
        if first is None or first[0] is not gaps.row_nodes:
            first = gaps.row_nodes, NormalRows(gaps).flexibility(some)
        found = NormalRows(gaps).flexibility(some)
    fresh = gaps.for_run()
    fresh.at(q)
    assert relative(first[1], found) > 0.02
    nodes = gaps.row_nodes[some]
    assert (
        relative(found, NormalRows(fresh).flexibility(np.array([list(fresh.row_nodes).index(node) for node in nodes])))
        < 0.01
    )


@pytest.mark.parametrize(("side", "motion"), [(0, [0, 0, -10.0, 0, 0, 0]), (1, [0, 0, 0, 300.0, -500.0, 0])])
def test_no_point_comes_nearer_than_closing_says(round_body, flat_body, side, motion):
    """While the patches are so far apart that no rows are left: the slave falls, or the master turns."""
    slave, master = floating(round_body, (0, 0, 2e-3)), floating(flat_body)
    gaps, parts = PatchGaps(slave, master), [np.zeros(slave.n), np.zeros(master.n)]
    q, step = np.concatenate(parts), 1e-4
    parts[side][:6] = motion
    q_t = np.concatenate(parts)
    gap, rate, _ = gaps.closing(q, q_t, 0.0 * q)
    assert len(gap) == 1
    later = gaps.surface_gap(gaps.sides.moved(q, step * q_t))
    assert gap[0] + step * rate[0] <= later + 1e-6  # contact points are that much above the lowest node
    assert later < gaps.surface_gap(q) - 1e-5
    assert rate[0] < 0


def test_no_row_that_closing_leaves_out_is_nearer_than_it_says(round_body, flat_body):
    """About a facet's size above the plate the lowest rows are told themselves, and one bound for all others."""
    slave = floating(round_body)
    gaps = PatchGaps(slave, floating(flat_body))
    for x in np.linspace(0, 0.2 * gaps.size, 4):
        q = np.r_[moved(slave, [x, 0, 0.97 * gaps.size]), np.zeros(flat_body.n_dofs)]
        gap, *_ = gaps.closing(q, 0.0 * q, 0.0 * q)
        every = gaps.project(*gaps.sides.places(q))[0]
        left_out = (abs(every.gap[:, None] - gap[:-1]) > 1e-9).all(axis=1)
        assert left_out.any()
        assert 0 < gap[-1] <= every.gap[left_out].min()


@pytest.mark.parametrize("kind", ROWS)
def test_what_closing_looks_at_changes_nothing(round_body, flat_body, kind):
    """Between steps a run asks which rows can touch next; forces stay, and so does what is known of the rows."""
    slave = floating(round_body)
    asked, other = (compliant(PatchGaps(slave, floating(flat_body), kind)) for _ in range(2))
    for i, x in enumerate(np.linspace(0, 0.1 * asked.gaps.size, 6)):
        q = np.r_[moved(slave, [x, 0, -4e-6]), np.zeros(flat_body.n_dofs)]
        np.testing.assert_allclose(
            asked.at(q).generalised, (expected := other.at(q).generalised), rtol=0, atol=1e-9 * abs(expected).max()
        )
        gaps, closed = asked.gaps, asked.evaluation.index
        rows, known = gaps.row_nodes, NormalRows(gaps).flexibility(closed)
        q_t = np.random.default_rng(i).standard_normal(len(q))
        gap, rate, change = asked.closing(q, q_t, 2.0 * q_t)
        assert len(gap) > len(rows) + 1
        assert gaps.row_nodes is rows
        assert NormalRows(gaps).flexibility(closed) is known
        order, own = np.argsort(gap)[: len(rows)], gaps.at(q)
        np.testing.assert_allclose(gap[order], np.sort(own), rtol=0, atol=1e-12)
        slope = gaps.jacobian(np.arange(len(rows))) @ q_t
        np.testing.assert_allclose(rate[order], slope[np.argsort(own)], rtol=0, atol=1e-6 * abs(slope).max())
        np.testing.assert_allclose(change[:-1], 2.0 * rate[:-1], rtol=1e-9)


def paths(round_body, slave):
    """Coordinates of the ball on its way: it comes down, slides over facets, tilts, jumps and leaves."""
    rng = np.random.default_rng(0)
    for k, u in enumerate(np.linspace(0, 1, 120)):
        depth = 5e-6 * np.sin(2 * np.pi * u) + 2e-6
        jump = 0.2e-3 * rng.standard_normal() if k % 40 == 39 else 0.0
        tilt = [2e-4 * np.sin(9 * u), 1e-4 * u, 0.0]
        yield moved(slave, [0.5e-3 * u + jump, 0.1e-3 * u, -depth], tilt)


@pytest.mark.parametrize("ball_is_slave", [True, False])
@pytest.mark.parametrize("kind", ROWS)
def test_rows_that_are_not_followed_are_open(round_body, flat_body, kind, ball_is_slave):
    """Against a search of all points at every place; and those that are have the gaps that it finds."""
    sides = (
        [inertial(round_body), inertial(flat_body)] if ball_is_slave else [inertial(flat_body), inertial(round_body)]
    )
    gaps = PatchGaps(*sides, kind)
    gaps.follow()
    fewest = np.inf
    for own in paths(round_body, inertial(round_body)):
        q = np.r_[own, np.zeros(flat_body.n_dofs)] if ball_is_slave else np.r_[np.zeros(flat_body.n_dofs), own]
        found = gaps.at(q)
        every = gaps.project(*gaps.sides.places(q))[0]
        expected = dict(zip(every.points.row_nodes, every.gap, strict=True))
        least = every.gap.min()
        assert found.min() == pytest.approx(least, abs=1e-10)
        followed = set(gaps.row_nodes)
        fewest = min(fewest, len(followed) / len(expected))
        assert all(gap > max(least, -0.25 * least) for node, gap in expected.items() if node not in followed)
        inner = [
            node in expected and within
            for node, within in zip(gaps.row_nodes, np.isinf(gaps.stage.rows.leaves_at), strict=True)
        ]
        np.testing.assert_allclose(found[inner], [expected[node] for node in gaps.row_nodes[inner]], atol=2e-10)
    assert fewest < 0.5


@pytest.fixture(scope="module")
def free_nodes(ball, kept):
    """The ball with coordinates for each node of its patch, which can then be put anywhere."""
    return ep.reduce(*ball, basis="craig-bampton", f_cut=150e3, cache=kept)


@pytest.mark.parametrize(("errors", "chosen"), [(1.9, True), (2.1, False)])
@pytest.mark.parametrize("bulges", [1.0, -1.0])
@pytest.mark.usefixtures("each_path")
def test_a_row_is_followed_before_it_closes_by_twice_the_error_of_those_that_are(
    free_nodes, flat_body, errors, chosen, bulges
):
    """Deformation is what rigid motion does not tell: here of one followed row, and of the nearest that is not."""
    ball = inertial(free_nodes)
    gaps = PatchGaps(ball, inertial(flat_body), "node-to-segment")
    gaps.follow()
    pressed = moved(ball, [0, 0, -4e-6])
    still = np.zeros(flat_body.n_dofs)
    found = gaps.at(np.r_[pressed, still])
    first, least = gaps.row_nodes, found.min()
    soon = -0.25 * least  # smaller gaps may close because the surface bulges
    every = gaps.project(*gaps.sides.places(np.r_[pressed, still]))[0]
    left_out = {
        gap: node for node, gap in zip(every.points.row_nodes, every.gap, strict=True) if node not in set(first)
    }
    nearest = min(left_out)
    error = (nearest - soon) / errors
    deformed, wrong, closing = first[found.argmax()], bulges * error, 1.05 * (soon - nearest)
    motion = np.zeros((len(free_nodes.partition.patches[0].nodes), 3))
    motion[[deformed, left_out[nearest]], 2] = wrong, (closing if chosen else 0.0)
    nodes = free_nodes.rows(free_nodes.partition.patches[0].nodes)
    own = np.linalg.lstsq(nodes, motion.ravel(), rcond=None)[0]
    after = gaps.at(np.r_[pressed + own, still])
    assert after.min() == pytest.approx(least, abs=1e-10)
    assert (gaps.row_nodes is first) is not chosen  # rows are chosen again only if that may be needed
    assert (left_out[nearest] in gaps.row_nodes) is chosen
    if chosen:
        (row,) = np.flatnonzero(gaps.row_nodes == left_out[nearest])
        assert after[row] == pytest.approx(nearest + closing, abs=1e-9)


def test_forces_are_the_same_wherever_both_bodies_are(round_body, flat_body):
    """Both turned by 70 degrees about an oblique axis and carried away."""
    turn = np.array([0.7, -0.5, 0.9])
    axes = FloatingKinematics(round_body, np.zeros(3), turn).frame(np.zeros(round_body.n_dofs))[1]
    answers = []
    for rotation, A in ((np.zeros(3), np.eye(3)), (turn, axes)):
        sides = (
            floating(round_body, A @ [0.1e-3, 0, 2e-6] + [1, 2, 3], rotation),
            floating(flat_body, [1.0, 2, 3], rotation),
        )
        law = compliant(PatchGaps(*sides))
        force = law.at(np.r_[moved(sides[0], A @ [0, 0, -5e-6]), np.zeros(flat_body.n_dofs)]).generalised
        answers.append((A.T @ law.evaluation.resultant(), force[6 : round_body.n_dofs]))
    np.testing.assert_allclose(answers[1][0], answers[0][0], rtol=1e-6, atol=1e-6 * answers[0][0][2])
    assert relative(answers[1][1], answers[0][1]) < 1e-6


def test_action_is_reaction_while_sliding(round_body, flat_body):
    """Linear and angular momentum: forces and moments on both bodies cancel."""
    slave, master = floating(round_body), floating(flat_body)
    law = compliant(PatchGaps(slave, master))
    q = np.r_[moved(slave, [0.3e-3, 0.1e-3, -4e-6], [1e-3, 2e-3, 0.2]), moved(master, [0, 0, 1e-7], [0, 1e-4, 0])]
    force = law.at(q).generalised
    parts = force[: slave.n], force[slave.n :]
    total, moment = np.zeros(3), np.zeros(3)
    for side, part, own in zip((slave, master), parts, law.gaps.sides.split(q), strict=True):
        r, A = side.kinematics.frame(own)
        total += part[:3]
        moment += np.cross(r, part[:3]) + A @ part[3:6]
    size = np.linalg.norm(law.evaluation.resultant())
    assert size > 50
    np.testing.assert_allclose(total, 0, atol=1e-12 * size)
    np.testing.assert_allclose(moment, 0, atol=1e-9 * size * SPHERE_RADIUS)


def test_patches_far_apart_have_no_rows_and_are_hardly_searched(round_body, flat_body, monkeypatch):
    gaps = PatchGaps(inertial(round_body), inertial(flat_body))
    gaps.follow()
    searches = []
    project = PatchGaps.project
    monkeypatch.setattr(PatchGaps, "project", lambda *a: searches.append(1) or project(*a))
    far = np.r_[moved(inertial(round_body), [0, 0, 0.3]), np.zeros(flat_body.n_dofs)]
    for height in np.geomspace(0.3, 1e-6, 1000):
        q = np.r_[moved(inertial(round_body), [0.2e-3 * np.sin(1e3 * height), 0, height]), np.zeros(flat_body.n_dofs)]
        gap = gaps.at(q)
        if height > 1.5 * gaps.size:
            assert not len(gap)
    assert len(searches) < 60
    assert 0 < gaps.closing(far, 0 * far, 0 * far)[0].min() < 0.301
    assert gap.min() == pytest.approx(project(gaps, *gaps.sides.places(q))[0].gap.min(), abs=1e-10)


def test_pairs_freeze_again_when_the_sliding_stops(round_body, flat_body):
    law = compliant(PatchGaps(inertial(round_body), inertial(flat_body)))
    q = np.r_[moved(inertial(round_body), [0.2e-3, 0, -4e-6]), np.zeros(flat_body.n_dofs)]
    law.at(q)
    assert law.gaps.moving
    moving = law.evaluation.lam.sum()
    for n in range(500):
        law.at(q)
        law.accept(float(n))
    assert not law.gaps.moving
    assert law.evaluation.lam.sum() == pytest.approx(moving, rel=1e-9)
    fresh, away = law.for_run(), q + 1e-4 * abs(q).max()
    fresh.begin(law.at_end(500.0), 500.0)
    assert not fresh.gaps.moving
    np.testing.assert_allclose(fresh.at(away).generalised, law.at(away).generalised, rtol=1e-12)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sense", [1, -1])
def test_pairs_that_slide_slowly_along_either_direction_do_not_freeze(round_body, flat_body, axis, sense):
    """At a hundredth of a facet in as many evaluations as a contact must stand still to freeze."""
    gaps = PatchGaps(inertial(round_body), inertial(flat_body))
    master = gaps.sides[1].surface.points[gaps.witnesses[1]]
    way = sense * triangle_frame(master)[1][:, axis]
    assert abs(way[2]) < 1e-9
    for x in 0.1 + 0.01 * np.arange(500) / 200:
        q = moved(inertial(round_body), x * gaps.size * way + [0, 0, -4e-6])
        gaps.at(np.r_[q, np.zeros(flat_body.n_dofs)])
        gaps.accept(gaps.after())
        assert gaps.moving


def test_points_past_the_master_s_edge_carry_nothing(round_body, flat_body):
    law = compliant(PatchGaps(inertial(round_body), inertial(flat_body)))
    for x in np.linspace(0, 6e-3, 61):
        law.at(np.r_[moved(inertial(round_body), [x, 0, -4e-6]), np.zeros(flat_body.n_dofs)])
        if law.evaluation.edge_reached() is not None:
            break
    assert 1.1e-3 < x < 1.7e-3  # the contact's radius is 0.2 mm, the patch's 1.6
    for further in np.linspace(x, 6e-3, 61):
        law.at(np.r_[moved(inertial(round_body), [further, 0, -4e-6]), np.zeros(flat_body.n_dofs)])
    assert not law.evaluation.lam.any()


def test_contact_tells_that_it_leaves_the_patch_before_its_circle_reaches_the_edge(round_body, flat_body):
    """The patch ends 0.4 mm beside the ball. Hertz's circle grows from a third of it, while pairs stay frozen."""
    ball = inertial(round_body, [1.2e-3, 0, 0])
    law = compliant(PatchGaps(ball, inertial(flat_body)))
    for radius in np.linspace(0.13e-3, 0.8e-3, 68):
        law.at(np.r_[moved(ball, [0, 0, -(radius**2) / SPHERE_RADIUS]), np.zeros(flat_body.n_dofs)])
        assert law.evaluation.lam.any()
        if (place := law.evaluation.edge_reached()) is not None:
            break
    assert not law.gaps.moving
    assert 0.2e-3 < radius < 0.4e-3
    assert np.linalg.norm(place[:2]) > 1.6e-3 - 0.35e-3  # at most a facet within the edge


def closed(round_body, flat_body):
    return np.r_[moved(inertial(round_body), [0, 0, -4e-6]), np.zeros(flat_body.n_dofs)]
