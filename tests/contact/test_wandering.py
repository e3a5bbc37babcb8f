"""Contact that wanders over whole surfaces: a disc that rolls on a plate, and in a slot."""

import contextlib

import netgen.occ as occ
import numpy as np
import pytest
from oracles import box, compliant, floating, inertial, moved, relative, without_numba

import exudyn_partition as ep
from exudyn_partition.algebra.coulomb import Coulomb
from exudyn_partition.algebra.friction import SLIP
from exudyn_partition.contact import wandering
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.rigid import RigidGaps, RigidPlane
from exudyn_partition.contact.wandering import WanderingGaps, WanderingRigidGaps
from exudyn_partition.errors import EmptyRegionError, InputError, PenetrationError

MU = 0.3
R, WIDTH, DEEP = 5e-3, 3e-3, 60e-6  # coarse facets are hollow: their rows close late


@pytest.fixture(scope="module")
def disc():
    """A disc about the z axis, whose lowest point is the origin."""
    shape = occ.Cylinder(occ.Pnt(0, R, -WIDTH / 2), occ.Z, r=R, h=WIDTH)
    for face in shape.faces:
        face.name = "rim" if abs(face.center.z) < WIDTH / 4 else "side"
    return ep.fe_model(shape, ep.STEEL, maxh=2e-3)


@pytest.fixture(scope="module")
def plate():
    """A plate below the origin."""
    fem = ep.fe_model(box(0.016, 0.004, 0.004).Move(occ.gp_Vec(0, -0.002, -0.002)), ep.STEEL, maxh=1.7e-3)
    return fem, fem.points.max(axis=0)[1]


@pytest.fixture(scope="module")
def rim(disc):
    return ep.reduce(disc, ep.Partition.surface(disc, "rim", axes="xyz"), f_cut=20e3)


@pytest.fixture(scope="module")
def face(plate):
    fem, top = plate
    upper = ((-1, top - 1e-6, -1), (1, top + 1e-6, 1))
    return ep.reduce(fem, ep.Partition.surface(fem, upper, axes="xyz"), f_cut=20e3)


def turned(body, angle, way):
    """Coordinates of a disc in a floating frame that has turned about its axis and moved, (n,)."""
    side = floating(body, (0, 1e-6, 0))
    q = side.kinematics.moved(np.zeros(body.n_dofs), np.r_[np.zeros(5), angle, np.zeros(body.n_dofs - 6)])
    q[:3] += way
    return q


def forces(rim, face, places):
    law = compliant(WanderingGaps(floating(rim, (0, 1e-6, 0)), inertial(face)))
    found = []
    for angle, x in places:
        law.at(np.r_[turned(rim, angle, [x, -DEEP - 1e-6, 0]), np.zeros(face.n_dofs)])
        found.append(law.evaluation.resultant())
    return np.array(found)


def test_parts_have_the_force_of_the_whole_surfaces_wherever_contact_wanders(rim, face, monkeypatch):
    places = [(0.3 * i, R * (0.07 * i % 1.0)) for i in range(12)]
    parts = forces(rim, face, places)
    monkeypatch.setattr(wandering, "WINDOW", 1e3)
    np.testing.assert_allclose(parts, forces(rim, face, places), rtol=1e-9, atol=1e-9)
    assert parts[:, 1].min() > 20
    assert abs(parts[:, [0, 2]]).max() < 0.02 * parts[:, 1].min()


def test_rows_within_a_thin_elastic_wall_are_those_of_its_face_alone(round_body):
    """Also beyond half its thickness, where its other face is nearer: rows were pulled out behind, or lost."""
    t, found = 0.2e-3, []
    fem = ep.fe_model(box(4e-3, 4e-3, t).Move(occ.gp_Vec(0, 0, -t)), ep.STEEL, maxh=0.7e-3)
    top = fem.points.max(axis=0)[2]
    for bottom in (top - 1e-6, -1.0):
        part = ep.Partition.surface(fem, ((-1, -1, bottom), (1, 1, top + 1e-6)), axes="xyz")
        sheet, side = ep.reduce(fem, part, f_cut=20e3), floating(round_body, (0, 0, top))
        law = compliant(WanderingGaps(side, inertial(sheet)))
        for depth in (0.02e-3, 0.08e-3, 0.15e-3, 0.19e-3):
            law.at(np.r_[moved(side, [0, 0, -depth]), np.zeros(sheet.n_dofs)])
            found.append([law.gaps.at(law.gaps.present.q).min(), law.evaluation.resultant()[2]])
    assert found[3][0] < -0.9 * t
    np.testing.assert_allclose(found[4:], found[:4], rtol=1e-6)


def test_gaps_of_all_rows_need_no_evaluation_before(rim, face):
    """Rows of the parts that are near in this pose, and their gaps, wherever the disc was evaluated before."""
    gaps = WanderingGaps(floating(rim, (0, 1e-6, 0)), inertial(face))
    for angle, x in ((0.0, 0.0), (0.8, -0.8 * R)):
        q = np.r_[turned(rim, angle, [x, -DEEP - 1e-6, 0]), np.zeros(face.n_dofs)]
        ways = [np.zeros((len(side.surface.points), 3)) for side in gaps.sides]
        evaluated = gaps.for_run()
        evaluated.at(q)
        (nodes, gap), (known, right) = gaps.gaps_of_all(q, ways), evaluated.gaps_of_all(q, ways)
        assert gap.min() < -0.5 * DEEP
        np.testing.assert_array_equal(nodes, known)
        np.testing.assert_allclose(gap, right, rtol=0, atol=1e-15)


@pytest.mark.parametrize("kind", ["integrated", "node-to-segment"])
def test_gaps_go_on_from_a_state_where_they_slide_past_the_end_of_a_face(rim, face, kind):
    """The parts that are near each other are found after a facet of motion, and points after a part of a facet.

    Others found both at other places, so that other points were still followed past the end.
    """
    gaps, states, found = WanderingGaps(floating(rim, (0, 1e-6, 0)), inertial(face), kind).for_run(), [], []
    way = np.linspace(0.0, 1.0, 80)
    path = [np.r_[turned(rim, 0.9 * s, [5e-3 * s, -DEEP - 1e-6, 3.1e-3 * s]), np.zeros(face.n_dofs)] for s in way]
    for q in path:
        found.append((gaps.at(q), gaps.row_nodes))
        gaps.accept(gaps.after())
        states.append(gaps.accepted)
    for k in range(3, 60, 7):
        others = gaps.for_run()
        others.begin(states[k])
        for q, (gap, nodes) in zip(path[k + 1 :], found[k + 1 :], strict=True):
            again = others.at(q)
            others.accept(others.after())
            _, here, there = np.intersect1d(others.row_nodes, nodes, return_indices=True)  # more may be present
            np.testing.assert_allclose(again[here], gap[there], rtol=0, atol=1e-9 * gaps.size)
            assert again.min() == pytest.approx(gap.min(), abs=1e-9 * gaps.size)
    assert {state.parted.q[2] for state in states} > {states[0].parted.q[2]}


@pytest.mark.usefixtures("each_path")
@pytest.mark.parametrize("kind", ["integrated", "node-to-segment"])
def test_rows_that_slide_deep_in_a_thin_wall_stay_on_its_face(round_body, kind):
    """A point that is searched on its own, as beside a corner of facets, went to the wall's back, which is nearer."""
    t = 0.2e-3
    fem = ep.fe_model(box(4e-3, 4e-3, t).Move(occ.gp_Vec(0, 0, -t)), ep.STEEL, maxh=0.7e-3)
    sheet = ep.reduce(fem, ep.Partition.surface(fem, ((-1, -1, -1), (1, 1, 1)), axes="xyz"), f_cut=20e3)
    side = floating(round_body, (0, 0, 0))
    gaps = WanderingGaps(side, inertial(sheet), kind).for_run()
    for k in range(10):
        q = np.r_[moved(side, [39e-6 * k, 21e-6 * k, -0.15e-3]), np.zeros(sheet.n_dofs)]
        found, rows = gaps.at(q), gaps.row_nodes
        other = gaps.for_run()
        there = other.at(q)
        expected = dict(zip(other.row_nodes, there, strict=True))
        both = [i for i, row in enumerate(rows) if row in expected]
        np.testing.assert_allclose(found[both], [expected[rows[i]] for i in both], rtol=0, atol=1e-6 * t)
        assert found.min() == pytest.approx(-0.15e-3, rel=0.05)


def test_a_surface_presses_as_a_small_patch_on_the_same_mesh(disc, plate, rim, face):
    tip = ep.reduce(disc, ep.Partition.ball(disc, (0, 0, 0), 2.5e-3, axes="xyz"), f_cut=20e3)
    spot = ep.reduce(plate[0], ep.Partition.ball(plate[0], (0, 0, 0), 3e-3, axes="xyz"), f_cut=20e3)
    small = compliant(PatchGaps(inertial(tip), inertial(spot)))
    large = compliant(WanderingGaps(inertial(rim), inertial(face)))
    force = []
    for law, (slave, master) in ((small, (tip, spot)), (large, (rim, face))):
        law.at(np.r_[moved(inertial(slave), [0, -DEEP, 0]), np.zeros(master.n_dofs)])
        force.append(law.evaluation.resultant())
    assert force[0][1] > 20
    np.testing.assert_allclose(force[1], force[0], rtol=1e-6, atol=1e-6 * force[0][1])


def test_flexibility_along_local_normals(disc, rim):
    along = ep.reduce(disc, ep.Partition.surface(disc, "rim"), f_cut=20e3)
    normals = along.partition.patches[0].normals
    F = rim.flexibility().reshape(len(normals), 3, len(normals), 3)
    assert relative(along.flexibility(), np.einsum("ia,iajb,jb->ij", normals, F, normals)) < 1e-10
    assert np.linalg.eigvalsh(along.flexibility()).min() > 0


def test_force_is_the_gradient_of_its_potential(rim, face):
    law = compliant(WanderingGaps(floating(rim, (0, 1e-6, 0)), inertial(face)))
    at, step = [0.4e-3, -DEEP - 1e-6, 0], 1e-9
    force = -law.at(np.r_[turned(rim, 1.3, at), np.zeros(face.n_dofs)]).generalised[1]
    energy = [
        law.at(np.r_[turned(rim, 1.3, np.add(at, [0, way, 0])), np.zeros(face.n_dofs)]).stored for way in (-step, step)
    ]
    assert (energy[1] - energy[0]) / (2 * step) == pytest.approx(force, rel=1e-4)


def test_friction_of_parts_is_that_of_small_patches(disc, plate, rim, face):
    """The disc is pressed and then shifted by less than a row may slide."""
    tip = ep.reduce(disc, ep.Partition.ball(disc, (0, 0, 0), 2.5e-3, axes="xyz"), f_cut=20e3)
    spot = ep.reduce(plate[0], ep.Partition.ball(plate[0], (0, 0, 0), 3e-3, axes="xyz"), f_cut=20e3)
    found = []
    for gaps, slave, master in ((PatchGaps, tip, spot), (WanderingGaps, rim, face)):
        law = compliant(gaps(inertial(slave), inertial(master)), Coulomb(MU)).for_run("implicit")
        law.gaps.follow()
        for step, x in enumerate((0.0, 0.2e-6, 0.4e-6)):
            q = np.r_[moved(inertial(slave), [x, -DEEP, 0]), np.zeros(master.n_dofs)]
            law.accept(1e-6 * step)
            law.at(q)
        found.append(law.evaluation.resultant())
    assert found[0][0] < -1
    np.testing.assert_allclose(found[1], found[0], rtol=1e-3, atol=1e-3 * found[0][1])


def slid(rim, face, places):
    """Forces on a disc with friction, (n, 3) [N], its work [J], and rows that were closed, at angles and places x."""
    law = compliant(WanderingGaps(floating(rim, (0, 1e-6, 0)), inertial(face)), Coulomb(MU)).for_run("implicit")
    found, rows = [], set()
    for step, (angle, x) in enumerate(places):
        q = np.r_[turned(rim, angle, [x, -DEEP - 1e-6, 0]), np.zeros(face.n_dofs)]
        law.accept(1e-6 * step)
        law.at(q)
        found.append(law.evaluation.resultant())
        rows |= {*law.gaps.row_nodes[law.evaluation.index].tolist()}
    return np.array(found), law.evaluation.dissipated, rows


@pytest.mark.parametrize("spin", [-1.0, 1.0])
def test_a_disc_that_slides_while_it_wanders_over_both_surfaces(rim, face, spin):
    """Friction is that of Coulomb at every place, against the slip, and takes the force times the way."""
    angles = np.linspace(0.0, 0.9, 46)
    places = [(spin * angle, 0.5 * R * angle) for angle in angles]  # the rim's speed is +-R of the angle's
    forces, taken, rows = slid(rim, face, places)
    assert len(rows) > 12
    pressed, along = forces[3:, 1], forces[3:, 0]
    assert pressed.min() > 20
    side = np.sign(0.5 + spin)  # a disc that turns by +z moves its lowest point along +x
    np.testing.assert_allclose(along, -side * MU * pressed, rtol=5e-4)  # rows slip aside a little
    ways = np.diff(angles) * R * abs(0.5 + spin)
    push = abs(forces[:, 0])
    assert taken == pytest.approx(0.5 * ways @ (push[1:] + push[:-1]), rel=0.03)


def test_friction_of_parts_is_that_of_the_whole_surfaces_wherever_contact_wanders(rim, face, monkeypatch):
    """While the disc rolls, creeps, slides and rolls back, rows come and go: none is forgotten or kept too long."""
    angles = 0.6 * np.sin(np.linspace(0, np.pi, 40))
    places = [(-angle, R * angle * (1.0 + 0.05 * np.sin(7 * angle))) for angle in angles]
    parts, taken, rows = slid(rim, face, places)
    monkeypatch.setattr(wandering, "WINDOW", 1e3)
    whole, expected, others = slid(rim, face, places)
    np.testing.assert_allclose(parts, whole, rtol=0, atol=1e-7 * whole.max())
    assert taken == pytest.approx(expected, rel=1e-6)
    assert rows == others
    ratio = parts[:, 0] / parts[:, 1]
    assert ratio.min() < -0.02
    assert ratio.max() > 0.02
    assert abs(ratio).min() < 0.5 * MU


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ModelLimitWarning")  # a coarse mesh, few rows close
@pytest.mark.parametrize(("method", "step"), [("explicit", None), ("implicit", 0.4e-6)])
def test_a_spinning_disc_that_bounces_is_driven_by_friction_alone(rim, face, mbs, method, step):
    """In impacts all around its rim: the impulses along the face are those across it times the coefficient."""
    weight, gravity = rim.total_mass, np.array([0, -2e4, 0])
    spins = {"initialVelocity": [0, -0.5, 0], "initialAngularVelocity": [0, 0, 4000.0]}
    disc = ep.CreatePartitionBody(mbs, rim, frame="floating", referencePosition=[0, 2e-6, 0], gravity=gravity, **spins)
    plate = ep.CreatePartitionBody(mbs, face, frame="floating")
    contact = ep.CreatePartitionContact(mbs, disc, plate, friction=MU, passes="given")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=300e-6, method=method, step=step)
    slips = (contact.friction.states(result) == SLIP).any(axis=0)
    assert np.ptp(rim.points[rim.partition.patches[0].nodes[slips], 0]) > 0.5 * R
    across, along = (
        np.trapezoid(force, result.t)
        for force in (contact.force(result), contact.friction.tangential_force(result)[:, 0])
    )
    assert along == pytest.approx(-MU * across, rel=1e-3)
    assert along / weight < -0.3
    momentum = disc.momentum(result) + plate.momentum(result)
    fallen = weight * gravity * result.t[-1]
    assert abs(momentum[-1] - momentum[0] - fallen).max() < 1e-9 * abs(fallen).max()


def test_spots_appear_and_vanish(rim):
    """A disc in a slot touches one flank, none, and then the other one; one patch has both flanks."""
    wide, deep = 2 * R + 2e-6, 4e-3
    slot = occ.Box(occ.Pnt(-4e-3, -deep, -2e-3), occ.Pnt(4e-3, wide + deep, 2e-3))
    slot -= occ.Box(occ.Pnt(-4e-3, 0, -2e-3), occ.Pnt(3e-3, wide, 2e-3))
    fem = ep.fe_model(slot, ep.STEEL, maxh=2e-3)
    flanks = ((-1, -1e-9, -1), (2.9e-3, wide + 1e-9, 1))
    inner = ep.Partition.surface(fem, flanks)
    heights = fem.points[inner.patches[0].nodes, 1]
    assert np.unique(heights.round(6)).tolist() == [0.0, round(wide, 6)]
    body = ep.reduce(fem, inner, f_cut=5e3)
    law = compliant(WanderingGaps(inertial(rim, (-2e-3, 1e-6, 0)), inertial(body)))
    up = []
    for y in (-DEEP, 0.0, DEEP, 0.0, -DEEP):
        law.at(np.r_[moved(inertial(rim), [0, y, 0]), np.zeros(body.n_dofs)])
        up.append(law.evaluation.resultant()[1])
    assert up[0] > 5
    assert up[1] == up[3] == 0
    assert up[2] < -5
    assert up[4] == pytest.approx(up[0], rel=1e-9)


class Everywhere(RigidGaps):
    """All rows of a patch that goes around a body; it stands on its lowest ones."""

    def _direction(self, node):
        return -self.surface.normal


def test_rows_near_a_rigid_plane_have_the_force_of_all_rows(rim):
    """A disc that falls, rolls and is lifted; rows that are left out are no nearer than `closing` says."""
    side, plane = floating(rim, (0, 1e-6, 0)), RigidPlane(normal=(0, 1, 0))
    near, every = (compliant(kind(side, plane)) for kind in (WanderingRigidGaps, Everywhere))
    pressed = []
    for angle, height in [(0, 8e-3), (0, 6.5e-3), (0, 2e-3), (0, -DEEP), (0.3, -DEEP), (0.6, 5e-4), (0.6, -DEEP)]:
        q = turned(rim, angle, [-R * angle, height, 0])
        force, expected = near.at(q).generalised, every.at(q).generalised
        np.testing.assert_allclose(force, expected, rtol=0, atol=1e-6 * max(abs(expected).max(), 1.0))
        pressed.append(expected.any())
        gap, *_ = near.closing(q, 0.0 * q, 0.0 * q)
        gaps, left_out = every.gaps.at(q), ~np.isin(every.gaps.row_nodes, near.gaps.row_nodes)
        assert left_out.any()
        assert 0 < gap[-1] <= gaps[left_out].min()
        assert gap.min() <= gaps.min() + 1e-12
        assert near.gaps.at(q).min() == pytest.approx(gaps.min(), abs=1e-12)  # the nearest row is there at any height
        fresh = near.for_run()
        np.testing.assert_allclose(fresh.at(q).generalised, expected, rtol=0, atol=1e-6 * max(abs(expected).max(), 1.0))
    assert 1 < sum(pressed) < len(pressed)


def test_an_answer_that_is_asked_for_late_has_the_rows_of_its_own_place(rim):
    """A disc has rolled on to other rows. Answers of before, and those of then, are as of fresh contacts."""
    side, plane = floating(rim, (0, 1e-6, 0)), RigidPlane(normal=(0, 1, 0))
    law = compliant(WanderingRigidGaps(side, plane))
    here, there, between = (turned(rim, angle, [-R * angle, -DEEP, 0]) for angle in (0.0, 0.5, 0.02))
    kept, fresh, other = law.for_run(), law.for_run(), law.for_run()
    expected, answer = fresh.at(here), kept.at(here)
    state = expected.after(1e-6)
    kept.at(there)
    assert not np.array_equal(kept.gaps.row_nodes, answer.row_nodes)
    np.testing.assert_array_equal(answer.generalised, expected.generalised)
    late = answer.after(1e-6)
    np.testing.assert_array_equal(late.gaps.chosen.q, state.gaps.chosen.q)
    for contact, begin in ((fresh, state), (other, late)):
        contact.begin(begin, 1e-6)
    near = {"rtol": 0, "atol": 1e-9 * abs(answer.lam).sum()}
    np.testing.assert_allclose(other.at(between).generalised, fresh.at(between).generalised, **near)
    np.testing.assert_allclose(kept.at(there).generalised, law.for_run().at(there).generalised, **near)


def test_rows_that_close_before_they_are_chosen_again_are_present(rim):
    """However the disc moves: along both axes it comes further than each coordinate may change."""
    side, normal = floating(rim, (0, 1e-6, 0)), np.array([1, 1, 0]) / 2**0.5
    plane = RigidPlane(np.array([0, R, 0]) - R * normal, normal)
    every, closed = Everywhere(side, plane), 0
    for angle in np.linspace(0, 0.5, 11):
        near = WanderingRigidGaps(side, plane).for_run()
        first = turned(rim, angle, np.zeros(3))
        near.at(turned(rim, angle, [0, R, 0]))
        near.at(first)
        chosen = near.row_nodes
        q = turned(rim, angle, -0.99 * wandering.SOON * near.size * np.array([1, 1, 0]))
        near.at(q)
        np.testing.assert_array_equal(near.row_nodes, chosen)  # they were not chosen again
        due = every.row_nodes[every.at(q) < 0]
        assert np.isin(due, chosen).all()
        closed += np.count_nonzero(every.at(first)[np.isin(every.row_nodes, due)] > wandering.SOON * near.size)
    assert closed


def test_a_carrier_that_turns_with_the_body_brings_no_row_nearer(rim):
    """Rows that are left out come nearer by the speed relative to what carries the plane, which is none."""
    spin, axis, side = np.array([0, 300.0, 0]), np.array([5e-3, 0, 2e-3]), floating(rim, (0, 1e-4, 0))
    motion = {"pose": lambda: (axis, np.eye(3)), "motion": lambda: (np.zeros(3), spin)}
    gaps = WanderingRigidGaps(side, RigidPlane(normal=(0, 1, 0)), **motion).for_run()
    q, q_t = np.zeros(rim.n_dofs), np.zeros(rim.n_dofs)
    q_t[:3], q_t[3:6] = np.cross(spin, side.kinematics.frame(q)[0] - axis), spin
    gaps.at(q)
    _, rate, _ = gaps.closing(q, q_t, 0.0 * q)
    np.testing.assert_allclose(rate, 0, atol=1e-6)
    _, rate, _ = gaps.closing(q, 0.0 * q, 0.0 * q)
    away = np.linalg.norm(np.cross(spin, side.place(q) - axis), axis=1)
    assert rate[-1] == pytest.approx(-away.max(), rel=1e-9)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("kind", ["a rigid plane", "a patch", "a small patch"])
def test_rows_within_reach_are_present(rim, face, flat_body, round_body, kind, compiled):
    """A body rolls above a face, at several heights: all its rows are present whose gaps to the plane are smaller."""
    small = kind == "a small patch"
    side, plane = floating(rim, (0, 1e-6, 0)), RigidPlane(normal=(0, 1, 0))
    if small:
        side, plane = floating(round_body, (0, 0, 1e-6)), RigidPlane()
        gaps, every = PatchGaps(side, inertial(flat_body)), RigidGaps(side, plane)
    else:
        every = Everywhere(side, plane)
        gaps = WanderingRigidGaps(side, plane) if kind == "a rigid plane" else WanderingGaps(side, inertial(face))
    reach = min(gaps.longest_reach, 0.5 * gaps.size)
    gaps.reach_to(reach)
    run, seen, other = gaps.for_run(), 0, np.zeros(gaps.n - side.n)
    heights = reach * np.r_[np.linspace(2.0, -0.1, 20), np.linspace(-0.1, 0.9, 12)]
    with contextlib.nullcontext() if compiled else without_numba():
        for i, height in enumerate(heights):
            q = turned(rim, 0.02 * i, [-R * 0.02 * i, height, 0])
            if small:
                q = moved(side, [1e-5 * i, 0, height], [5e-4 * i, 0, 0])
            found, right = run.at(np.r_[q, other]), np.full(len(side.surface.points), np.nan)
            right[every.row_nodes] = every.at(q)
            due = np.flatnonzero(right < 0.99 * reach)
            assert np.isin(due, run.row_nodes).all()
            np.testing.assert_allclose(found, right[run.row_nodes], rtol=0, atol=1e-3 * gaps.size)
            seen += len(due)
    assert seen > 100


@pytest.mark.parametrize("compiled", [True, False])
def test_rows_that_a_bulging_surface_may_close_are_present(rim, face, compiled):
    """Those whose gaps are below a quarter of the depth, wherever the disc is pressed while it slides and rolls."""
    side, other, seen = floating(rim, (0, 1e-6, 0)), np.zeros(face.n_dofs), 0
    gaps, every = (WanderingGaps(side, inertial(face)).for_run() for _ in range(2))
    with contextlib.nullcontext() if compiled else without_numba():
        for i in range(20):
            x = 0.1 * gaps.size * i - 0.3 * R
            q = np.r_[turned(rim, x / R, [x, -0.3e-3, 0]), other]
            gaps.at(q)
            found = every.widen(q)
            due = (found < -0.25 * found.min()) & (found > 0.01 * gaps.size)
            assert np.isin(every.row_nodes[due], gaps.row_nodes).all()
            seen += np.count_nonzero(due)
    assert seen > 20


def test_wrong_starts_have_named_errors(rim, face, disc, mbs):
    with pytest.raises(PenetrationError, match="referencePosition"):
        WanderingGaps(inertial(rim, (0, -1e-4, 0)), inertial(face))
    with pytest.raises(EmptyRegionError, match="do not face"):
        WanderingGaps(inertial(rim, (0.03, -R, 0)), inertial(face))
    nodal = ep.reduce(disc, ep.Partition.surface(disc, "rim"), f_cut=200e3, basis="craig-bampton")
    items = [ep.CreatePartitionBody(mbs, body) for body in (nodal, face)]
    with pytest.raises(InputError, match="residual flexibility"):
        ep.CreatePartitionContact(mbs, *items, formulation="penalty")
