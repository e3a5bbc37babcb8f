"""Several contacts on one patch: against the whole problem, against a patch each, and in Exudyn's solvers."""

from types import SimpleNamespace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import MARBLE_RADIUS as R

import exudyn_partition as ep
from exudyn_partition.algebra.complementarity import Complementarity, regularised
from exudyn_partition.algebra.friction import OPEN, SLIP, STICK
from exudyn_partition.algebra.products import dense
from exudyn_partition.contact.formulations.choices import Compliance
from exudyn_partition.contact.normal_rows import NormalRows
from exudyn_partition.errors import InputError
from exudyn_partition.support.arrays import consecutive

APART, MU = 1.7e-3, 0.3  # between the places where marbles hit [m]; coefficient of friction


@pytest.fixture(scope="module")
def plate_of(kept):
    """A thick plate below z = 0 whose top has one patch that all marbles hit, or one for each of the first two."""
    shape = occ.Box(occ.Pnt(-8e-3, -6e-3, -5e-3), occ.Pnt(8e-3, 6e-3, 0))
    places = [(-APART / 2, 0, 0), (APART / 2, 0, 0)]
    fem = ep.fe_model(shape, ep.STEEL, maxh=4e-3, refine=[ep.Refine(p, 0.6e-3, 0.2e-3) for p in places], grading=0.6)

    def patch(place, radius, name, axes):
        return ep.Partition.ball(fem, place, radius, name=name, axes=axes)

    def plate(shared, axes="normal"):
        if shared:
            part = patch((0, 0, 0), 1.6e-3, "top", axes)
        else:
            part = patch(places[0], 0.6e-3, "left", axes) | patch(places[1], 0.6e-3, "right", axes)
        return ep.reduce(fem, part, f_cut=150e3, cache=kept)

    return plate


@pytest.fixture(scope="module")
def rough_marble(marble_parts, kept):
    """The marble with a south pole that has friction."""
    south = ep.Partition.ball(marble_parts[0], (0, 0, -R), 0.5e-3, name="south", axes="xyz")
    return ep.reduce(marble_parts[0], south, f_cut=300e3, cache=kept)


def hit(plate, marble, patches, speeds=(0.2, 0.1), frame="inertial", along=0.0, frictions=(None, None)):
    """Model, plate, marbles and contacts: marbles fall on the plate side by side."""
    mbs = exu.SystemContainer().AddSystem()
    target = ep.CreatePartitionBody(mbs, plate, frame=frame)
    marbles, contacts = [], []
    for side, patch, speed, friction in zip((-1, 1), patches, speeds, frictions, strict=True):
        place = {"referencePosition": [side * APART / 2, 0, R + 1e-7], "initialVelocity": [side * along, 0, -speed]}
        marbles.append(ep.CreatePartitionBody(mbs, marble, frame=frame, **place))
        named = {"slavePatch": "south", "masterPatch": patch}
        contacts.append(ep.CreatePartitionContact(mbs, marbles[-1], target, friction=friction, **named))
    mbs.Assemble()
    return mbs, [target, *marbles], contacts


def test_forces_are_those_of_the_whole_problem(plate_of, marble):
    _, _, contacts = hit(plate_of(True), marble, ["top", "top"])
    laws, together = [contact.mechanics for contact in contacts], contacts[0].together
    together = together.for_run(laws)
    n, m = laws[0].gaps.n, marble.n_dofs
    F_plate, F_marble = contacts[0].sides[1][0].body.flexibility(), marble.flexibility("south")
    for depths in ((2e-6, 1e-6), (1e-6, 0.6e-6), (0.6e-6, 3e-6)):
        q = [np.r_[-depth * marble.rigid[:, 2], np.zeros(n - m)] for depth in depths]
        forces = together.forces(q)
        own, top = ([np.asarray(law.rows.side_rows(side) @ np.eye(len(F))) for law in laws] for side, F in (
            (0, F_marble), (1, F_plate),
        ))  # fmt: skip
        F = np.vstack(top) @ F_plate @ np.vstack(top).T
        at = 0
        for rows in own:
            F[at : at + len(rows), at : at + len(rows)] += rows @ F_marble @ rows.T
            at += len(rows)
        F.flat[:: len(F) + 1] *= 1 + 1e-9
        h = np.concatenate([law.gaps.at(x) for law, x in zip(laws, q, strict=True)])
        lam = Complementarity(F).solve(h)
        assert abs(F[: len(own[0]), len(own[0]) :] @ lam[len(own[0]) :]).max() > -1e-3 * h.min()  # they push
        np.testing.assert_allclose(np.concatenate([law.evaluation.lam for law in laws]), lam, atol=1e-6 * lam.max())
        for law, force, x in zip(laws, forces, q, strict=True):
            np.testing.assert_allclose(
                force, law.gaps.stage.linear.H.T @ law.evaluation.lam, atol=1e-12 * abs(force).max()
            )
            assert len(x) == len(force)


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_two_marbles_on_one_patch_as_on_a_patch_each(plate_of, marble, frame):
    force, energies = [], []
    for shared in (True, False):
        mbs, items, contacts = hit(plate_of(shared), marble, ["top"] * 2 if shared else ["left", "right"], frame=frame)
        result = ep.solve_dynamic(mbs, end_time=16e-6, step=0.1e-6)
        force.append([contact.force(result) for contact in contacts])
        energies.append(sum(item.energy(result) for item in (*items, *contacts)))
        momentum = sum(item.momentum(result)[:, 2] for item in items)
        np.testing.assert_allclose(momentum, momentum[0], rtol=1e-9)
    assert np.max(force, axis=2).min() > 10
    np.testing.assert_allclose(*force, atol=5e-3 * np.max(force))
    for energy in energies:
        assert abs(energy / energy[0] - 1).max() < 2e-4


def test_implicit_steps_know_how_the_contacts_push_each_other(plate_of, marble):
    found = []
    for method in ("explicit", "implicit"):
        mbs, items, _ = hit(plate_of(True), marble, ["top", "top"])
        result = ep.solve_dynamic(mbs, end_time=12e-6, step=0.1e-6, method=method)
        found.append([item.momentum(result)[-1, 2] for item in items])
    np.testing.assert_allclose(*found, rtol=3e-3)
    assert result.work.newton_iterations < 4 * result.steps


@pytest.mark.parametrize("frictions", [(MU, MU), (MU, None)])
def test_forces_with_friction_are_those_of_the_whole_problem(plate_of, rough_marble, frictions):
    """In steps in which marbles press, slide apart and come back; also if one of them is smooth."""
    plate, marble = plate_of(True, "xyz"), rough_marble
    contacts = hit(plate, marble, ["top", "top"], frictions=frictions)[2]
    laws = [contact.mechanics.for_run("implicit") for contact in contacts]
    together, still = contacts[0].together.for_run(laws), np.zeros(plate.n_dofs)
    of_sides = [[dense(law.rows.side_rows(side)) for law in laws] for side in (0, 1)]
    F = np.vstack(of_sides[1]) @ plate.flexibility() @ np.vstack(of_sides[1]).T
    parts = consecutive(list(map(len, of_sides[0])))
    for part, rows in zip(parts, of_sides[0], strict=True):
        F[part, part] += rows @ marble.flexibility("south") @ rows.T
    F = regularised(F)
    states, last, before = set(), np.zeros(len(F)), None
    for n, (press, along) in enumerate([(1.0, 0.0), (1.5, 0.1), (1.5, 0.4), (1.0, 0.35), (1.2, -0.3), (0.2, -0.3)]):
        for law in laws:
            law.accept(float(n))
        ways = [np.r_[side * along * 1e-6, 0, -press * deep] for side, deep in ((1, 2e-6), (-1, 1.2e-6))]
        q = [np.r_[marble.rigid[:, :3] @ way, still] for way in ways]
        together.forces(q)
        h, before = -F @ last, before or q  # sliding counts from the first places
        for part, law, x, start in zip(parts, laws, q, before, strict=True):
            h[part] += dense(law.rows.jacobian(np.arange(len(law.gaps.row_nodes)))) @ (x - start)
            h[part][:: law.rows.d] = law.gaps.at(x)
        found, before = np.concatenate([law.evaluation.on_rows.ravel() for law in laws]), q
        w = h + F @ found
        for part, law in zip(parts, laws, strict=True):
            lam, slid = (values[part].reshape(-1, law.rows.d) for values in (found, w))
            depth, force = 1e-6, found.max()
            assert lam[:, 0].min() >= 0
            assert slid[:, 0].min() > -1e-8 * depth
            assert abs(lam[:, 0] * slid[:, 0]).max() < 1e-8 * depth * force
            if law.rows.d == 3:
                along, bound, way = np.hypot(*lam[:, 1:].T), MU * lam[:, 0], np.hypot(*slid[:, 1:].T)
                assert (along - bound).max() < 1e-8 * force
                assert ((bound - along) * way).max() < 1e-8 * depth * force  # what slides has all of its friction
                assert abs(along[:, None] * slid[:, 1:] + way[:, None] * lam[:, 1:]).max() < 1e-8 * depth * force
                states |= {*law.evaluation.status.tolist()}
        last = found
    assert states == {OPEN, STICK, SLIP}


def test_two_sliding_marbles_on_one_patch_as_on_a_patch_each(plate_of, rough_marble):
    """Explicit and implicit steps: forces along both directions, energy with what friction takes, and momentum."""
    runs = [(True, "explicit", 0.1e-6), (False, "explicit", 0.1e-6), (True, "implicit", 0.2e-6)]
    forces, scale = [], rough_marble.total_mass * 0.2
    for shared, method, step in runs:
        patches = ["top"] * 2 if shared else ["left", "right"]
        sliding = {"along": 0.1, "frictions": (MU, MU), "frame": "floating"}
        mbs, items, contacts = hit(plate_of(shared, "xyz"), rough_marble, patches, **sliding)
        result = ep.solve_dynamic(mbs, end_time=12e-6, step=step, method=method)
        slid = [contact.friction.tangential_force(result)[:, 0] for contact in contacts]
        found = np.array([*(contact.force(result) for contact in contacts), *slid])
        times = np.linspace(0, 12e-6, 61)
        forces.append([np.interp(times, result.t, force) for force in found])
        assert abs(found[2:]).max(axis=1).min() > 2
        momentum = sum(item.momentum(result) for item in items)
        assert abs(momentum - momentum[0]).max() < 1e-9 * scale
        energy = sum(item.energy(result) for item in (*items, *contacts))
        lost = sum(contact.dissipated_energy(result) for contact in contacts)
        assert lost[-1] > 0.01 * energy[0]
        assert abs((energy + lost) / energy[0] - 1).max() < 3e-4
    assert result.work.newton_iterations < 4 * result.steps
    assert abs(np.subtract(forces[0], forces[1])).max() < 5e-3 * np.max(forces)
    assert abs(np.subtract(forces[0], forces[2])).max() < 1e-2 * np.max(forces)


@pytest.mark.parametrize("patches", [["top", "top"], ["left", "right"]])
def test_a_run_goes_on_from_another_one_within_the_impacts(plate_of, rough_marble, patches):
    """By other steps: marbles that stick or slide in a frame that moves still do, with the same forces."""
    plate, sliding = plate_of(patches[0] == "top", "xyz"), {"along": 0.1, "frictions": (MU, MU), "frame": "floating"}
    whole, parts = (hit(plate, rough_marble, patches, **sliding) for _ in range(2))
    expected = ep.solve_dynamic(whole[0], end_time=12e-6, step=0.1e-6)
    first = ep.solve_dynamic(parts[0], end_time=6e-6, step=0.1e-6)
    then = ep.solve_dynamic(parts[0], end_time=12e-6, step=0.1e-6, method="implicit", go_on=True)
    for one, contact in zip(whole[2], parts[2], strict=True):
        for force in (lambda c, r: c.force(r), lambda c, r: c.friction.tangential_force(r)[:, 0]):
            size, at_once = abs(force(one, expected)).max(), force(one, expected)
            assert abs(force(contact, then)[0] - force(contact, first)[-1]) < 0.02 * size
            gone_on = np.interp(expected.t, then.t, force(contact, then))
            assert abs(gone_on - at_once)[expected.t >= then.t[0]].max() < 0.03 * size


def test_rows_are_made_once_while_they_stay(plate_of, marble, monkeypatch):
    """All neighbours of a contact ask for its rows, in each sweep of each evaluation."""
    _, _, contacts = hit(plate_of(True), marble, ["top", "top"])
    laws, made, rows_of = [contact.mechanics for contact in contacts], [], NormalRows.side_rows
    monkeypatch.setattr(NormalRows, "side_rows", lambda rows, side: made.append(rows) or rows_of(rows, side))
    together = contacts[0].together.for_run(laws)
    still = np.zeros(laws[0].gaps.n - marble.n_dofs)
    forces = [
        np.concatenate(together.forces([np.r_[-depth * marble.rigid[:, 2], still]] * 2)) for depth in (1e-6, 2e-6)
    ]
    assert abs(forces[1]).max() > abs(forces[0]).max() > 0
    assert len(made) == 2  # the plate's side of each


def test_contacts_that_yield_share_no_patch():
    """Nor are they solved with others that share one."""
    elastic, yielding = (SimpleNamespace(flows=flows, formulation=Compliance()) for flows in (False, True))
    shared = SimpleNamespace(patches=(1, 1), name="rail", neighbour="first")
    for pair in ((elastic, yielding), (yielding, elastic)):
        with pytest.raises(InputError, match="'rail': its patch 1 already has the contact 'first'"):
            Compliance().couples(*pair, shared)
    with pytest.raises(InputError, match="one of these has plastic zones"):
        Compliance().check_group(flows=True, whole=True)


def test_formulations_that_share_no_patch(plate_of, marble, mbs):
    target = ep.CreatePartitionBody(mbs, plate_of(True))
    balls = [ep.CreatePartitionBody(mbs, marble, referencePosition=[x, 0, R + 1e-7]) for x in (-1e-3, 1e-3)]
    ep.CreatePartitionContact(mbs, balls[0], target, slavePatch="south")
    with pytest.raises(InputError, match="its patch 0 already has the contact"):
        ep.CreatePartitionContact(mbs, balls[1], target, slavePatch="south", formulation="penalty")


@pytest.fixture(scope="module")
def grooved():
    """FE model of a ball, facets of its lower part, and the normals of two planes beneath."""
    normals = np.array([[1, 0, 1], [-1, 0, 1]]) / np.sqrt(2)
    fine = [ep.Refine(-R * normal, 0.3e-3, 0.08e-3) for normal in normals]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), ep.STEEL, maxh=2.5e-3, refine=fine, grading=0.6)
    return fem, np.flatnonzero(fem.points[fem.facets[:, :3], 2].mean(axis=1) < -0.5 * R), normals


def in_groove(mbs, grooved, velocity, axes="normal", friction=None):
    """Result, ball and contacts of a ball that falls into the groove."""
    fem, below, normals = grooved
    body = ep.reduce(fem, ep.Partition.surface(fem, below, name="below", axes=axes), f_cut=100e3)
    ball = ep.CreatePartitionBody(mbs, body, initialVelocity=velocity)
    planes = [ep.RigidPlane(-(R + 1e-6) * normal, normal) for normal in normals]
    contacts = [ep.CreatePartitionContact(mbs, ball, plane, friction=friction) for plane in planes]
    with pytest.raises(InputError, match="these two already have the contact"):
        ep.CreatePartitionContact(mbs, ball, planes[0])
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=60e-6), ball, contacts


def test_a_ball_in_a_groove_of_two_rigid_planes(mbs, grooved):
    """Both planes press on one patch of the ball, alike; the same plane is not taken twice."""
    result, ball, contacts = in_groove(mbs, grooved, [0, 0, -0.5])
    force = [contact.force(result) for contact in contacts]
    assert force[0].max() > 10
    np.testing.assert_allclose(*force, atol=0.02 * force[0].max())  # the meshes of both places differ
    momentum = ball.momentum(result)[-1] / ball.body.total_mass
    np.testing.assert_allclose(momentum, [0, 0, 0.5], atol=5e-3)


def test_a_ball_slides_along_a_groove(mbs, grooved):
    """Both planes brake it, each by friction with its normal force: together by sqrt 2 of what it weighs."""
    result, ball, contacts = in_groove(mbs, grooved, [0, 6.0, -0.2], axes="xyz", friction=MU)
    taken = ball.momentum(result)[-1] - ball.momentum(result)[0]
    assert taken[2] > 0.3 * ball.body.total_mass
    assert taken[1] / taken[2] == pytest.approx(-np.sqrt(2) * MU, rel=2e-3)
    energy = ball.energy(result) + sum(each.energy(result) + each.dissipated_energy(result) for each in contacts)
    swings = 0.5 * ball.body.total_mass * 0.2**2
    assert abs(energy - energy[0]).max() < 1e-2 * swings


def test_a_contact_that_another_one_closes(mbs):
    """The edge of a box between two planes: pressed on the one, it bulges towards the other, which enters later."""
    fem = ep.fe_model(occ.Box((0, 0, 0), (0.01, 0.01, 0.01)), ep.STEEL, maxh=3e-3)
    body = ep.reduce(fem, ep.Partition.ball(fem, (0, 5e-3, 0), 3e-3, axes="xyz"), f_cut=100e3)
    item = ep.CreatePartitionBody(mbs, body)
    normals = [(1, 0, 0), (0, 0, 1)]
    contacts = [ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, 0), normal)) for normal in normals]

    def run():
        return contacts[0].together.for_run([contact.mechanics.for_run("explicit") for contact in contacts])

    both, one = (body.rigid[:, 0] * x + body.rigid[:, 2] * z for x, z in ((-1e-6, -1e-6), (1e-9, -3e-6)))
    later, first = run(), run()
    assert all(force.any() for force in later.forces([one, one]))
    for found, expected in zip(later.forces([both, both]), first.forces([both, both]), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * abs(expected).max())


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ContactPatchWarning")  # the box turns onto its faces
@pytest.mark.parametrize("rows", ["integrated", "node-to-segment"])
def test_nodes_of_an_edge_that_two_planes_press_with_friction(mbs, rows):
    """They have more directions than they can move; what the planes take and give balances, in every direction."""
    fem = ep.fe_model(occ.Box((0, 0, 0), (0.01, 0.01, 0.01)), ep.STEEL, maxh=3e-3)
    body = ep.reduce(fem, ep.Partition.ball(fem, (0, 5e-3, 0), 3e-3, axes="xyz"), f_cut=100e3)
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[-0.1, 0.05, -0.1])
    planes = [ep.RigidPlane((0, 0, 0), normal) for normal in [(1, 0, 0), (0, 0, 1)]]
    contacts = [ep.CreatePartitionContact(mbs, item, plane, friction=MU, rows=rows) for plane in planes]
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=40e-6)
    assert result.t[-1] == pytest.approx(40e-6)
    pushes = [np.trapezoid(c.force(result), result.t) for c in contacts]
    along = [[np.trapezoid(x, result.t) for x in c.friction.tangential_force(result).T] for c in contacts]
    impulse = np.sum(along, axis=0) + np.array([pushes[0], 0, pushes[1]])
    momentum = item.momentum(result)
    assert abs(momentum[-1] - momentum[0] - impulse).max() < 1e-2 * max(pushes)
    energy = item.energy(result) + sum(each.energy(result) + each.dissipated_energy(result) for each in contacts)
    assert abs(energy / energy[0] - 1).max() < 2e-3
    assert energy[0] - (item.energy(result) + sum(each.energy(result) for each in contacts))[-1] > 0.02 * energy[0]
