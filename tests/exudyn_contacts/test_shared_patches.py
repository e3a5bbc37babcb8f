"""Several contacts on one patch: against the whole problem, against a patch each, and in Exudyn's solvers."""

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import MARBLE_RADIUS as R

import exudyn_partition as ep
from exudyn_partition.algebra.complementarity import Complementarity
from exudyn_partition.contact.normal_rows import NormalRows
from exudyn_partition.errors import InputError

APART = 1.7e-3  # between the places where marbles hit


@pytest.fixture(scope="module")
def plate_of(kept):
    """A thick plate below z = 0 whose top has one patch that all marbles hit, or one for each of the first two."""
    shape = occ.Box(occ.Pnt(-8e-3, -6e-3, -5e-3), occ.Pnt(8e-3, 6e-3, 0))
    places = [(-APART / 2, 0, 0), (APART / 2, 0, 0)]
    fem = ep.fe_model(shape, ep.STEEL, maxh=4e-3, refine=[ep.Refine(p, 0.6e-3, 0.2e-3) for p in places], grading=0.6)
    whole = ep.Partition.ball(fem, (0, 0, 0), 1.6e-3, name="top")
    left, right = (ep.Partition.ball(fem, p, 0.6e-3, name=n) for p, n in zip(places, ("left", "right"), strict=True))
    return lambda shared: ep.reduce(fem, whole if shared else left | right, f_cut=150e3, cache=kept)


def hit(plate, marble, patches, speeds=(0.2, 0.1), frame="inertial"):
    """Model, plate, marbles and contacts: marbles fall on the plate side by side."""
    mbs = exu.SystemContainer().AddSystem()
    target = ep.CreatePartitionBody(mbs, plate, frame=frame)
    marbles, contacts = [], []
    for side, patch, speed in zip((-1, 1), patches, speeds, strict=True):
        place = {"referencePosition": [side * APART / 2, 0, R + 1e-7], "initialVelocity": [0, 0, -speed]}
        marbles.append(ep.CreatePartitionBody(mbs, marble, frame=frame, **place))
        named = {"slavePatch": "south", "masterPatch": patch}
        contacts.append(ep.CreatePartitionContact(mbs, marbles[-1], target, **named))
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
        np.testing.assert_allclose(np.concatenate([law.lam for law in laws]), lam, atol=1e-6 * lam.max())
        for law, force, x in zip(laws, forces, q, strict=True):
            np.testing.assert_allclose(force, law.gaps.linear.H.T @ law.lam, atol=1e-12 * abs(force).max())
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


def test_formulations_that_share_no_patch(plate_of, marble, mbs):
    target = ep.CreatePartitionBody(mbs, plate_of(True))
    balls = [ep.CreatePartitionBody(mbs, marble, referencePosition=[x, 0, R + 1e-7]) for x in (-1e-3, 1e-3)]
    ep.CreatePartitionContact(mbs, balls[0], target, slavePatch="south")
    with pytest.raises(InputError, match="its patch 0 already has the contact"):
        ep.CreatePartitionContact(mbs, balls[1], target, slavePatch="south", formulation="penalty")


def test_a_ball_in_a_groove_of_two_rigid_planes(mbs):
    """Both planes press on one patch of the ball, alike; the same plane is not taken twice."""
    normals = np.array([[1, 0, 1], [-1, 0, 1]]) / np.sqrt(2)
    fine = [ep.Refine(-R * normal, 0.3e-3, 0.08e-3) for normal in normals]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), ep.STEEL, maxh=2.5e-3, refine=fine, grading=0.6)
    below = np.flatnonzero(fem.points[fem.facets[:, :3], 2].mean(axis=1) < -0.5 * R)
    body = ep.reduce(fem, ep.Partition.surface(fem, below, name="below"), f_cut=100e3)
    ball = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -0.5])
    planes = [ep.RigidPlane(-(R + 1e-6) * normal, normal) for normal in normals]
    contacts = [ep.CreatePartitionContact(mbs, ball, plane) for plane in planes]
    with pytest.raises(InputError, match="these two already have the contact"):
        ep.CreatePartitionContact(mbs, ball, planes[0])
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=60e-6)
    force = [contact.force(result) for contact in contacts]
    assert force[0].max() > 10
    np.testing.assert_allclose(*force, atol=0.02 * force[0].max())  # the meshes of both places differ
    momentum = ball.momentum(result)[-1] / body.total_mass
    np.testing.assert_allclose(momentum, [0, 0, 0.5], atol=5e-3)


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
